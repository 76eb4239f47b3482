//! The sample URDFs through the importer and the reader of device files.

use std::{
    fs,
    path::{Path, PathBuf},
};

use dynid_import::{Imported, device_from_urdf};
use dynid_model::{Device, JointKind};

fn imported(name: &str) -> (Imported, Device) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/urdf").join(format!("{name}.urdf"));
    let imported = device_from_urdf(&fs::read_to_string(&path).unwrap(), &path).unwrap();
    let device = Device::parse(&imported.toml, &PathBuf::from(format!("{name}.toml")));
    let device = device.unwrap_or_else(|error| panic!("{error}\n{}", imported.toml));
    (imported, device)
}

#[test]
fn every_sample_is_read_back() {
    let joints = [
        ("gimbal", 6),
        ("gripper", 3),
        ("oblique", 5),
        ("odd", 2),
        ("pan_tilt_tool", 2),
        ("scara", 4),
        ("seven_joint", 7),
        ("six_axis", 6),
        ("torso", 8),
    ];
    for (name, n_joints) in joints {
        let (_, device) = imported(name);
        assert_eq!(device.joints.len(), n_joints, "{name}");
        assert!(device.end_point.is_some(), "{name}");
        let all: Vec<usize> = (0..n_joints).collect();
        assert!(device.configuration_of(&all).is_some(), "{name}");
    }
}

#[test]
fn chains_are_identified_from_the_tip() {
    let (_, arm) = imported("scara");
    let free: Vec<&[usize]> = arm.configurations.iter().map(|configuration| &configuration.free[..]).collect();
    assert_eq!(free, [&[0][..], &[1], &[2], &[3], &[2, 3], &[1, 2, 3], &[0, 1, 2, 3]]);
    let methods: Vec<_> = arm.methods.iter().map(|method| (method.name.as_str(), &method.sequence[..])).collect();
    assert_eq!(methods, [("isolated", &[4, 3, 2, 1][..]), ("coupling", &[4, 5, 6, 7]), ("together", &[7])]);
    let (_, torso) = imported("torso");
    assert_eq!(torso.methods.iter().map(|method| method.name.as_str()).collect::<Vec<_>>(), ["isolated", "together"]);
}

#[test]
fn limits_kinds_and_losses_are_kept() {
    let (_, scara) = imported("scara");
    let [_, _, quill, spin] = &scara.joints[..] else { panic!() };
    assert_eq!(
        (quill.kind, quill.position_limits, quill.speed_limit, quill.torque_limit),
        (JointKind::Prismatic, [0.0, 0.18], 1.1, 250.0)
    );
    assert_eq!((spin.kind, spin.position_limits), (JointKind::Revolute, [f64::NEG_INFINITY, f64::INFINITY]));
    let effects: Vec<_> =
        scara.effects.iter().map(|own| (own.id.as_str(), own.joint.unwrap(), own.values[0].1.value)).collect();
    let expected = [
        ("viscous", 0, 0.9),
        ("coulomb", 0, 2.2),
        ("viscous", 1, 0.4),
        ("coulomb", 1, 1.1),
        ("viscous", 2, 35.0),
        ("coulomb", 2, 12.0),
        ("viscous", 3, 0.01),
    ];
    assert_eq!(effects, expected);
}

/// What a follower loses is felt by its leader: 11 + 11, 3 + 3.
#[test]
fn losses_of_followers_are_the_leaders() {
    let (imported, gripper) = imported("gripper");
    let values: Vec<f64> = gripper.effects.iter().map(|own| own.values[0].1.value).collect();
    assert_eq!(values, [22.0, 6.0]);
    insta::assert_snapshot!(imported.notes.join("\n"), @"
    `damping` became the effect `viscous` of 1 joint
    `friction` became the effect `coulomb` of 1 joint
    joints that follow others are no joints of the device, and their limits are left out: finger_right_joint = q1, tip = -2*q2 + 0.15, slide_guard = 0.35*q1 - 0.003
    the end point is taken to be the origin of link `thumb_tip`
    ");
}

#[test]
fn a_whole_file() {
    insta::assert_snapshot!(imported("odd").0.toml, @r#"
    # odd "one" \ ä: written by `dynid device import`.
    #
    # - no body has the inertia of link `b"1` (principal moments 1.0000e-3, 1.0000e-2, 1.1200e-2 kg*m^2: the last exceeds the sum of the others by 2.00e-4): the two smaller moments were raised by 1.00e-4 kg*m^2 each
    # - joint `swing` states a speed limit of 0, which is taken as unknown
    # - joint `swing` states a torque limit of 0, which is taken as unknown
    # - joint `slide` states no range of motion, so it has no ends here
    # - `damping` became the effect `viscous` of 1 joint
    # - the end point is taken to be the origin of link `tip`
    # - angles of these joints are near quarter turns, but are written with too few digits to be taken for them (write pi/2 in the device file where that is meant; the equations become shorter): swing
    # - left out: 1 <controller_position> (nothing here knows it)
    # - left out: 1 <material> (a device file has no shapes)
    # - left out: 1 <safety_controller> (settings of a controller)
    title = "odd \"one\" \\ ä"
    source = "Imported from odd.urdf"

    # What the numbers of this file are in. Only SI; stating it keeps degrees and millimetres out.
    [units]
    angle = "rad"
    length = "m"
    mass = "kg"
    inertia = "kg*m^2"
    time = "s"
    command = "N*m"

    # How the robot is mounted is a guess: its base stands upright.
    [base]
    gravity = 9.81
    up = [0, 0, 1.0]

    # A frame is its parent's, moved by xyz, turned by roll, pitch and yaw (about fixed x, then y, then z), then turned about or
    # moved along its axis.
    [kinematics]
    convention = "transform"
    frames = [
      { name = "b\"1", parent = "base", xyz = [0, 0, 1.0], rpy = [1.5708, 0, 0], axis = [1.0, 0, 0], turn = "q0" },
      { name = "tip", parent = "b\"1", xyz = [0.25, 0, 0], axis = [0, 3, 4], slide = "q1" },
    ]

    # Where a hand or a tool would be: the origin of link tip. A guess.
    [end_point]
    frame = "tip"
    point = [0, 0, 0]

    [[joint]]               # q0
    title = "swing"
    position = [-1, 1]
    speed = inf
    torque = inf

    [[joint]]               # q1
    title = "slide"
    position = [-inf, inf]
    speed = 1
    torque = 10
    command = "N"

    # Bounds of the numbers below: fractions of the values. A description states none; these are guesses.
    [bounds]
    mass = 0.5
    centroid = 0.3
    inertia = 1.2

    # no body has the inertia of link `b"1` (principal moments 1.0000e-3, 1.0000e-2, 1.1200e-2 kg*m^2: the last exceeds the sum of the others by 2.00e-4): the two smaller moments were raised by 1.00e-4 kg*m^2 each
    [[link]]                # 1
    title = "b\"1"
    frame = "b\"1"
    m = 1.0
    x = 0.1
    y = 0
    z = 0
    Ixx = 0.0011
    Ixy = 0
    Ixz = 0
    Iyy = 0.0101
    Iyz = 0
    Izz = 0.0112

    [[link]]                # 2
    title = "tip"
    frame = "tip"
    m = 5E-1
    x = 0
    y = 0
    z = 0
    Ixx = 1e-3
    Ixy = 0
    Ixz = 0
    Iyy = 1e-3
    Iyz = 0
    Izz = 1e-3

    [identification]
    configurations = [
      [0],
      [1],
      [0, 1],
    ]

    [[identification.method]]
    name = "isolated"
    sequence = [2, 1]

    [[identification.method]]
    name = "coupling"
    sequence = [2, 3]

    [[identification.method]]
    name = "together"
    sequence = [3]

    [[effect]]
    id = "viscous"
    joint = 1
    Fv = { value = 150.0, lower = 0, upper = 300.0 }
    "#);
}

#[test]
fn notes_name_what_has_no_place() {
    insta::assert_snapshot!(imported("six_axis").0.notes.join("\n"), @"
    left out, because they stand still: base_link
    `damping` became the effect `viscous` of 6 joints
    `friction` became the effect `coulomb` of 6 joints
    the end point is taken to be the origin of link `tool0`; its orientation is left out
    left out: 7 <collision> (a device file has no shapes)
    left out: 6 <transmission> (torques are those of the joints; gear ratios and motor constants are stated in a model)
    left out: 7 <visual> (a device file has no shapes)
    ");
    insta::assert_snapshot!(imported("torso").0.notes.join("\n"), @"
    left out, because they stand still: pelvis
    the end point is taken to be the origin of link `left_hand`; its orientation is left out
    left out: 1 <gazebo> (settings of a simulator)
    ");
}

/// Every number of the six-axis arm stands in the device file as it stands in the URDF.
#[test]
fn texts_of_numbers_are_kept() {
    let toml = imported("six_axis").0.toml;
    for kept in [
        "xyz = [0.07, 0, 0.12], rpy = [\"-pi/2\", 0, 0]",
        "m = 9.6",
        "Iyz = 0.00011",
        "position = [-2.8, 2.8]",
        "[0, 0.08, 0], rpy = [\"-pi/2\", 0, \"pi\"]",
    ] {
        assert!(toml.contains(kept), "{kept}\n{toml}");
    }
}

/// What other readers of URDFs pass over: blanks and a mark of the encoding before the declaration, prefixes nobody declared.
#[test]
fn sloppy_xml_is_read() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/urdf/scara.urdf");
    let text = fs::read_to_string(&path).unwrap();
    let sloppy = format!(
        "\u{feff}\n  {}",
        text.replace("<link name=\"inner\">", "<link name=\"inner\"><old:shape old:size=\"1\"/>")
    );
    let (expected, found) = (device_from_urdf(&text, &path).unwrap(), device_from_urdf(&sloppy, &path).unwrap());
    let after_notes = |toml: &str| toml.split_once("title = ").unwrap().1.to_owned();
    assert_eq!(after_notes(&found.toml), after_notes(&expected.toml));
}

/// A device keeps the name `base` for what stands still.
#[test]
fn base_may_move() {
    let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/urdf/scara.urdf")).unwrap();
    let renamed = text.replace("\"base_link\"", "\"ground\"").replace("\"inner\"", "\"base\"");
    let imported = device_from_urdf(&renamed, Path::new("arm.urdf")).unwrap();
    let device = Device::parse(&imported.toml, Path::new("arm.toml")).unwrap();
    assert!(device.frames.iter().any(|frame| frame.name == "base_link"));
    assert_eq!(device.links[0].title, "base");
}

#[test]
fn the_end_point_is_where_the_user_says() {
    let of = |link: &str| dynid_import::device_from_description(END, Path::new("arm.urdf"), Some(link));
    let imported = of("camera").unwrap();
    let device = dynid_model::Device::parse(&imported.toml, Path::new("arm.toml")).unwrap();
    let point = device.end_point.as_ref().expect("an end point");
    assert_eq!((device.frames[point.frame].name.as_str(), point.point[0]), ("upper", 0.25));
    assert!(
        imported.notes.contains(&"the end point is the origin of link `camera`".to_owned()),
        "{:?}",
        imported.notes
    );
    insta::assert_snapshot!([of("camra"), of("ground")].map(|refused| refused.unwrap_err().to_string()).join("\n"), @r#"
    there is no link `camra` for the end point
     --> arm.urdf:1:1
      |
    1 | <robot name="arm">
      | ^^^^^^
      = help: did you mean `camera`? known: ground, upper, camera, fore
    link `ground` does not move: it is no end point
     --> arm.urdf:1:1
      |
    1 | <robot name="arm">
      | ^^^^^^
      = help: name a link that a joint moves
    "#);
}

const END: &str = r#"<robot name="arm">
  <link name="ground"/>
  <link name="upper"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="camera"/>
  <link name="fore"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="shoulder" type="continuous"><parent link="ground"/><child link="upper"/><axis xyz="0 0 1"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/><origin xyz="0.5 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="mount" type="fixed"><parent link="upper"/><child link="camera"/><origin xyz="0.25 0 0"/></joint>
</robot>
"#;

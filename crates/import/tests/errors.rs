//! What is wrong in a URDF: one error each, at its place, with the remedy.

use std::path::Path;

use dynid_import::device_from_urdf;
use insta::assert_snapshot;

fn error(text: &str) -> String {
    device_from_urdf(text, Path::new("arm.urdf")).unwrap_err().to_string()
}

const BODY: &str =
    r#"<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"#;

/// A pendulum whose line `number` is replaced.
fn pendulum_with(number: usize, line: &str) -> String {
    let mut lines = vec![
        r#"<robot name="pendulum">"#.to_owned(),
        r#"  <link name="ground"/>"#.to_owned(),
        format!(r#"  <link name="rod">{BODY}</link>"#),
        r#"  <joint name="pivot" type="revolute">"#.to_owned(),
        r#"    <parent link="ground"/>"#.to_owned(),
        r#"    <child link="rod"/>"#.to_owned(),
        r#"    <axis xyz="0 1 0"/>"#.to_owned(),
        r#"    <limit lower="-1" upper="1" velocity="2" effort="3"/>"#.to_owned(),
        r#"  </joint>"#.to_owned(),
        r#"</robot>"#.to_owned(),
    ];
    lines[number - 1] = line.to_owned();
    lines.join("\n")
}

/// The pendulum with these lines before its end.
fn pendulum_and(lines: &str) -> String {
    pendulum_with(10, &format!("{lines}\n</robot>"))
}

fn joint(name: &str, kind: &str, parent: &str, child: &str, more: &str) -> String {
    format!(r#"  <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{more}</joint>"#)
}

#[test]
fn the_pendulum_itself_is_right() {
    let imported = device_from_urdf(&pendulum_with(2, r#"  <link name="ground"/>"#), Path::new("arm.urdf")).unwrap();
    assert_eq!(imported.notes, ["the end point is taken to be the origin of link `rod`"]);
}

#[test]
fn of_the_file() {
    assert_snapshot!(error("<robot name='a'>\n  <link name='b'>\n</robot>"), @"
    this is no XML: expected 'link' tag, not 'robot'
     --> arm.urdf:3:1
      |
    3 | </robot>
      | ^
      = help: mend the file, or write it again with the program that made it
    ");
    assert_snapshot!(error(""), @"
    this is no XML: the document does not have a root node
     --> arm.urdf:1:1
      |
    1 | 
      | ^
      = help: mend the file, or write it again with the program that made it
    ");
    assert_snapshot!(error("<sdf version='1.7'>\n</sdf>"), @r#"
    expected `<robot>`, found `<sdf>`
     --> arm.urdf:1:1
      |
    1 | <sdf version='1.7'>
      | ^^^^
      = help: a URDF has one element `<robot name="..">` with all others in it
    "#);
    assert_snapshot!(error("<robot name='a'/>"), @"
    the robot has no link
     --> arm.urdf:1:1
      |
    1 | <robot name='a'/>
      | ^^^^^^
      = help: a URDF has `<link>` and `<joint>` elements; was this one cut short?
    ");
}

#[test]
fn of_xacro() {
    assert_snapshot!(error("<robot name='a' xmlns:xacro='http://www.ros.org/wiki/xacro'>\n  <xacro:arm side='left'/>\n</robot>"), @"
    xacro is left in: the element `xacro:arm`
     --> arm.urdf:2:3
      |
    2 |   <xacro:arm side='left'/>
      |   ^^^^
      = help: this file is a template; run xacro first, e.g. `xacro robot.urdf.xacro > robot.urdf`
    ");
    assert_snapshot!(error("<robot name='a'>\n  <xacro:include filename='b'/>\n</robot>"), @"
    xacro is left in: the prefix `xacro:`
     --> arm.urdf:2:4
      |
    2 |   <xacro:include filename='b'/>
      |    ^
      = help: this file is a template; run xacro first, e.g. `xacro robot.urdf.xacro > robot.urdf`
    ");
    assert_snapshot!(error(&pendulum_with(7, r#"    <axis xyz="0 ${reflect} 0"/>"#)), @r#"
    xacro is left in: `xyz="0 ${reflect} 0"`
     --> arm.urdf:7:11
      |
    7 |     <axis xyz="0 ${reflect} 0"/>
      |           ^^^^^^^^^^^^^^^^^^^^
      = help: this file is a template; run xacro first, e.g. `xacro robot.urdf.xacro > robot.urdf`
    "#);
}

#[test]
fn of_links() {
    assert_snapshot!(error(&pendulum_with(2, "  <link/>")), @r#"
    `<link>` has no `name`
     --> arm.urdf:2:3
      |
    2 |   <link/>
      |   ^^^^^
      = help: add the attribute `name=".."`
    "#);
    assert_snapshot!(error(&pendulum_with(2, r#"  <link name="rod"/>"#)), @r#"
    there is already a link `rod`
     --> arm.urdf:3:3
      |
    3 |   <link name="rod"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
      |   ^^^^^
      = help: links have different names
    "#);
    assert_snapshot!(error(&pendulum_with(3, r#"  <link name="rod"/>"#)), @r#"
    no link has an `<inertial>`: the file describes shapes, not dynamics
     --> arm.urdf:1:1
      |
    1 | <robot name="pendulum">
      | ^^^^^^
      = help: add mass, centroid and inertia to the links, as guesses if need be; a fit improves them
    "#);
    let with =
        |inertial: &str| pendulum_with(3, &format!("  <link name=\"rod\"><inertial>{inertial}</inertial></link>"));
    assert_snapshot!(error(&with("<mass value='1'/>")), @r#"
    the `<inertial>` of link `rod` has no `<inertia>`
     --> arm.urdf:3:20
      |
    3 |   <link name="rod"><inertial><mass value='1'/></inertial></link>
      |                    ^^^^^^^^^
      = help: add `<inertia ixx=".." ixy=".." ixz=".." iyy=".." iyz=".." izz=".."/>`
    "#);
    assert_snapshot!(error(&with("<mass value='-1'/>")), @r#"
    the mass of link `rod` is negative: -1 kg
     --> arm.urdf:3:43
      |
    3 |   <link name="rod"><inertial><mass value='-1'/></inertial></link>
      |                                           ^^
      = help: a mass is at least 0
    "#);
    assert_snapshot!(error(&with("<mass value='1 kg'/>")), @r#"
    `value` of `<mass>`: `kg` is no number
     --> arm.urdf:3:45
      |
    3 |   <link name="rod"><inertial><mass value='1 kg'/></inertial></link>
      |                                             ^^
      = help: write a number such as 0.5 or 1e-3
    "#);
    assert_snapshot!(error(&with("<mass value='inf'/>")), @r#"
    `value` must be finite
     --> arm.urdf:3:43
      |
    3 |   <link name="rod"><inertial><mass value='inf'/></inertial></link>
      |                                           ^^^
      = help: give a number
    "#);
    assert_snapshot!(error(&with("<mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='-1' iyz='0' izz='1'/>")), @r#"
    no body has a negative moment of inertia: `iyy` of link `rod`
     --> arm.urdf:3:85
      |
    3 |   <link name="rod"><inertial><mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='-1' iyz='0' izz='1'/></inertial></link>
      |                                                                                     ^^
      = help: moments are about the centroid, in kg m^2, and at least 0; only ixy, ixz and iyz may be negative
    "#);
    assert_snapshot!(error(&with("<mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0'/>")), @r#"
    `<inertia>` has no `izz`
     --> arm.urdf:3:47
      |
    3 |   <link name="rod"><inertial><mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0'/></inertial></link>
      |                                               ^^^^^^^^
      = help: add the attribute `izz=".."`
    "#);
    assert_snapshot!(error(&with("<origin xyz='0 0'/><mass value='1'/><inertia/>")), @r#"
    `<inertia>` has no `ixx`
     --> arm.urdf:3:66
      |
    3 |   <link name="rod"><inertial><origin xyz='0 0'/><mass value='1'/><inertia/></inertial></link>
      |                                                                  ^^^^^^^^
      = help: add the attribute `ixx=".."`
    "#);
}

#[test]
fn of_joints() {
    assert_snapshot!(error(&pendulum_with(4, r#"  <joint name="pivot" type="planar">"#)), @r#"
    joint `pivot` is planar: a device has joints of one variable each
     --> arm.urdf:4:29
      |
    4 |   <joint name="pivot" type="planar">
      |                             ^^^^^^
      = help: write it as `fixed`, or as several revolute and prismatic joints with links of no mass between
    "#);
    assert_snapshot!(error(&pendulum_with(4, r#"  <joint name="pivot" type="revolut">"#)), @r#"
    unknown type `revolut` of joint `pivot`
     --> arm.urdf:4:29
      |
    4 |   <joint name="pivot" type="revolut">
      |                             ^^^^^^^
      = help: did you mean `revolute`? known: revolute, continuous, prismatic, fixed
    "#);
    assert_snapshot!(error(&pendulum_with(4, r#"  <joint name="pivot" type="fixed">"#)), @r#"
    no joint moves
     --> arm.urdf:1:1
      |
    1 | <robot name="pendulum">
      | ^^^^^^
      = help: a device has a joint at least; make one `revolute` or `prismatic`
    "#);
    assert_snapshot!(error(&pendulum_with(5, r#"    <parent link="grund"/>"#)), @r#"
    unknown parent link `grund`
     --> arm.urdf:5:19
      |
    5 |     <parent link="grund"/>
      |                   ^^^^^
      = help: did you mean `ground`? known: ground, rod
    "#);
    assert_snapshot!(error(&pendulum_with(6, "")), @r#"
    joint `pivot` has no `<child>`
     --> arm.urdf:4:3
      |
    4 |   <joint name="pivot" type="revolute">
      |   ^^^^^^
      = help: add `<child link=".."/>`
    "#);
    assert_snapshot!(error(&pendulum_with(6, r#"    <child link="bar"/>"#)), @r#"
    unknown child link `bar`
     --> arm.urdf:6:18
      |
    6 |     <child link="bar"/>
      |                  ^^^
      = help: known: ground, rod
    "#);
    assert_snapshot!(error(&pendulum_with(7, r#"    <axis xyz="0 0 0"/>"#)), @r#"
    the axis of joint `pivot` has length 0
     --> arm.urdf:7:16
      |
    7 |     <axis xyz="0 0 0"/>
      |                ^^^^^
      = help: give a direction, e.g. `xyz="0 0 1"`
    "#);
    assert_snapshot!(error(&pendulum_with(7, r#"    <axis xyz="0 O 1"/>"#)), @r#"
    `xyz` of `<axis>`: `O` is no number
     --> arm.urdf:7:18
      |
    7 |     <axis xyz="0 O 1"/>
      |                  ^
      = help: write a number such as 0.5 or 1e-3
    "#);
    assert_snapshot!(error(&pendulum_with(8, r#"    <dynamics damping="-0.1"/>"#)), @r#"
    the damping of joint `pivot` is negative: it would drive the joint
     --> arm.urdf:8:24
      |
    8 |     <dynamics damping="-0.1"/>
      |                        ^^^^
      = help: turn the sign around, or remove it
    "#);
}

#[test]
fn of_the_tree() {
    let second = joint("strut", "fixed", "ground", "rod", "");
    assert_snapshot!(error(&pendulum_and(&second)), @r#"
    link `rod` is the child of two joints, `pivot` and `strut`: a loop
      --> arm.urdf:10:72
       |
    10 |   <joint name="strut" type="fixed"><parent link="ground"/><child link="rod"/></joint>
       |                                                                        ^^^
       = help: a device is a tree; leave out the joint that closes the loop
    "#);
    assert_snapshot!(error(&pendulum_and(r#"  <link name="lost"/>"#)), @r#"
    no joint carries link `lost`, nor link `ground`
      --> arm.urdf:10:3
       |
    10 |   <link name="lost"/>
       |   ^^^^^
       = help: one link stands still and carries all others; add a joint, `fixed` if it does not move
    "#);
    let around = [
        r#"  <link name="a"/>"#,
        r#"  <link name="b"/>"#,
        &joint("ab", "fixed", "a", "b", ""),
        &joint("ba", "fixed", "b", "a", ""),
    ];
    assert_snapshot!(error(&pendulum_and(&around.join("\n"))), @r#"
    link `a` is carried, through others, by itself: a loop
      --> arm.urdf:13:3
       |
    13 |   <joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint>
       |   ^^^^^^
       = help: one link stands still and carries all others; turn one of the joints around
    "#);
    let massless = [r#"  <link name="hand"/>"#, &joint("wrist", "continuous", "rod", "hand", "")];
    assert_snapshot!(error(&pendulum_and(&massless.join("\n"))), @r#"
    joint `wrist` moves no mass: neither link `hand` nor what it carries has any
      --> arm.urdf:11:3
       |
    11 |   <joint name="wrist" type="continuous"><parent link="rod"/><child link="hand"/></joint>
       |   ^^^^^^
       = help: add an `<inertial>` to link `hand`, or make the joint `fixed`
    "#);
    let twice = [format!(r#"  <link name="hand">{BODY}</link>"#), joint("pivot", "continuous", "rod", "hand", "")];
    assert_snapshot!(error(&pendulum_and(&twice.join("\n"))), @r#"
    there is already a joint `pivot`
      --> arm.urdf:11:3
       |
    11 |   <joint name="pivot" type="continuous"><parent link="rod"/><child link="hand"/></joint>
       |   ^^^^^^
       = help: joints have different names
    "#);
}

#[test]
fn of_mimics() {
    let hands = |kind: &str, first: &str, second: &str| {
        let link = |name: &str| format!(r#"  <link name="{name}">{BODY}</link>"#);
        let lines = [
            link("left"),
            link("right"),
            joint("l", kind, "rod", "left", first),
            joint("r", kind, "rod", "right", second),
        ];
        pendulum_and(&lines.join("\n"))
    };
    assert_snapshot!(error(&hands("continuous", r#"<mimic joint="pivot"/>"#, r#"<mimic joint="l"/>"#)), @r#"
    joint `r` mimics `l`, which itself mimics `pivot`
      --> arm.urdf:13:92
       |
    13 |   <joint name="r" type="continuous"><parent link="rod"/><child link="right"/><mimic joint="l"/></joint>
       |                                                                                            ^
       = help: mimic `pivot` instead, with both multipliers and offsets put together
    "#);
    assert_snapshot!(error(&hands("continuous", r#"<mimic joint="r"/>"#, r#"<mimic joint="l"/>"#)), @r#"
    joint `l` mimics `r`, which itself mimics `l`
      --> arm.urdf:12:91
       |
    12 |   <joint name="l" type="continuous"><parent link="rod"/><child link="left"/><mimic joint="r"/></joint>
       |                                                                                           ^
       = help: one of them must be free
    "#);
    assert_snapshot!(error(&hands("continuous", "", r#"<mimic joint="pivo"/>"#)), @r#"
    joint `r` mimics `pivo`, which is no joint
      --> arm.urdf:13:92
       |
    13 |   <joint name="r" type="continuous"><parent link="rod"/><child link="right"/><mimic joint="pivo"/></joint>
       |                                                                                            ^^^^
       = help: did you mean `pivot`? known: pivot, l
    "#);
    assert_snapshot!(error(&hands("prismatic", "", r#"<mimic joint="l" multiplier="0"/>"#)), @r#"
    joint `r` mimics `l` with the factor 0
      --> arm.urdf:13:106
       |
    13 |   <joint name="r" type="prismatic"><parent link="rod"/><child link="right"/><mimic joint="l" multiplier="0"/></joint>
       |                                                                                                          ^
       = help: a joint that does not move is `fixed`
    "#);
    assert_snapshot!(error(&hands("prismatic", "", r#"<mimic joint="pivot" multiplier="0.02"/>"#)), @r#"
    joint `r` is a distance and mimics `pivot`, which is an angle
      --> arm.urdf:13:91
       |
    13 |   <joint name="r" type="prismatic"><parent link="rod"/><child link="right"/><mimic joint="pivot" multiplier="0.02"/></joint>
       |                                                                                           ^^^^^
       = help: a device's joints follow joints of their own kind; leave the mimic out
    "#);
}

#[test]
fn what_would_take_too_long_or_too_deep_is_refused() {
    let prefixes = |count: usize| {
        let elements: String = (0..count).map(|number| format!("<p{number}:a/>")).collect();
        error(&format!("<robot>{elements}</robot>"))
    };
    assert!(prefixes(33).contains("prefixes are declared nowhere"), "{}", prefixes(33));
    assert!(!prefixes(31).contains("prefixes"), "{}", prefixes(31));
    let links: String = (0..5000).map(|number| format!("<link name=\"l{number}\"/>")).collect();
    let many = error(&format!("<robot name=\"many\">{links}</robot>"));
    assert!(many.contains("5000 links, more than 4096"), "{many}");
    // One line of 100 000 characters: the error shows what stands around the place.
    assert!(many.len() < 2000, "{} bytes", many.len());
    let chain = |joints: usize| -> String {
        let joint = |number: usize| {
            format!(
                "<joint name=\"j{number}\" type=\"continuous\"><parent link=\"l{number}\"/><child link=\"l{next}\"/></joint><link \
                 name=\"l{next}\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" \
                 iyz=\"0\"/></inertial></link>\n",
                next = number + 1
            )
        };
        format!("<robot name=\"chain\">\n<link name=\"l0\"/>\n{}</robot>", (0..joints).map(joint).collect::<String>())
    };
    // The line of the first that is too many.
    let long = error(&chain(300));
    assert!(long.contains("300 joints move, more than 256") && long.contains("arm.urdf:259:1"), "{long}");
    assert!(dynid_import::device_from_urdf(&chain(256), Path::new("chain.urdf")).is_ok());
    let bodies = "<body><inertial pos=\"0 0 0\" mass=\"1\" diaginertia=\"1 1 1\"/>".repeat(20_000);
    let deep = format!("<mujoco><worldbody>{bodies}{}</worldbody></mujoco>", "</body>".repeat(20_000));
    let deep = dynid_import::device_from_mjcf(&deep, Path::new("deep.xml")).unwrap_err().to_string();
    assert!(deep.contains("nested more than 256 elements deep"), "{deep}");
}

//! Values written back into descriptions, against Pinocchio and MuJoCo, which read the files by code of their own.
//!
//! Each sample is imported, its links and effects are changed, and the changed device is written back. What the other program computes
//! from that file must be what the changed device computes. `DYNID_PYTHON` and `DYNID_URDF_FOLDER` are as for the tests of the import.

#[path = "../../import/tests/support/mod.rs"]
mod support;

use std::fs;
use std::path::{Path, PathBuf};

use dynid_export::{Format, as_description};
use dynid_import::{Imported, device_from_description};
use dynid_model::{Device, ModelError, device_named};
use dynid_random::Random;
use dynid_user_model::{EffectInstance, Model};
use insta::assert_snapshot;
use serde_json::Value;
use support::{Other, asked, assert_same, files_in};
use toml_edit::{DocumentMut, Item, value};

const PINOCCHIO: Other =
    Other { module: "pinocchio", package: "pin", script: "../../import/tests/by_pinocchio.py", import: changed_device };

const MUJOCO: Other =
    Other { module: "mujoco", package: "mujoco", script: "../../import/tests/by_mujoco.py", import: changed_device };

/// The device that a description was written from: it lies beside it.
fn changed_device(_: &str, path: &Path) -> Result<Imported, ModelError> {
    Ok(Imported { toml: fs::read_to_string(path.with_extension("toml")).unwrap(), notes: Vec::new() })
}

/// A device file with other bodies and other effects. A body more on each link keeps them such that bodies can be so.
fn changed(toml: &str) -> String {
    let mut document: DocumentMut = toml.parse().unwrap();
    let mut random = Random::new(3);
    let number = |item: &Item| item.as_float().or(item.as_integer().map(|own| own as f64)).unwrap();
    for link in document["link"].as_array_of_tables_mut().unwrap().iter_mut() {
        let keys = dynid_model::Link::SYMBOLS;
        let own = keys.map(|key| number(&link[key]));
        let mass = 0.3 * own[0] + 0.01;
        let place = random.vector(3, -0.1, 0.1);
        let inertia = [0.004, 0.0003, -0.0002, 0.005, 0.0004, 0.0035].map(|moment| moment * (1.0 + own[0]));
        // About the common centroid: both bodies are moved by the reduced mass.
        let total = own[0] + mass;
        let reduced = own[0] * mass / total;
        let arm: Vec<f64> = (0..3).map(|axis| place[axis] - own[1 + axis]).collect();
        let square: f64 = arm.iter().map(|own| own * own).sum();
        let mut values = vec![total];
        values.extend((0..3).map(|axis| (own[0] * own[1 + axis] + mass * place[axis]) / total));
        for (at, (row, column)) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].into_iter().enumerate() {
            let moved = if row == column { square } else { 0.0 } - arm[row] * arm[column];
            values.push(own[4 + at] + inertia[at] + reduced * moved);
        }
        keys.iter().zip(values).for_each(|(key, own)| link[key] = value(own));
    }
    if let Some(effects) = document.get_mut("effect").and_then(Item::as_array_of_tables_mut) {
        for effect in effects.iter_mut() {
            for key in ["Fv", "Fc", "Ia"] {
                if let Some(own) = effect.get(key).filter(|own| !own.is_inline_table()).map(number) {
                    effect[key] = value(0.75 * own);
                }
            }
        }
    }
    document.to_string()
}

/// Writes the changed device of each description back into it; the new files, which have their devices beside them.
fn written_back(files: &[PathBuf], format: Format, folder: &Path) -> Vec<PathBuf> {
    let mut written = Vec::new();
    for (number, file) in files.iter().enumerate() {
        // What cannot be imported is the importer's to test.
        let Ok(text) = fs::read_to_string(file) else { continue };
        let Ok(imported) = device_from_description(&text, file, None) else { continue };
        let name =
            format!("{}_{number}", file.file_stem().unwrap().to_string_lossy().to_lowercase().replace(['-', '.'], "_"));
        fs::write(folder.join(format!("{name}.toml")), changed(&imported.toml)).unwrap();
        let device =
            device_named(&format!("{name}.toml"), folder).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let exported = as_description(&Model::of_device(device), format, &text, file)
            .unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let path = folder.join(&name).with_extension(file.extension().unwrap());
        fs::write(&path, &exported.text).unwrap();
        assert_only_numbers_differ(&text, &exported.text, file);
        assert_imported_again(device, &exported.text, &path);
        written.push(path);
    }
    written
}

/// Without bodies and losses, both texts are the same.
fn assert_only_numbers_differ(original: &str, exported: &str, file: &Path) {
    assert_ne!(original, exported, "{}", file.display());
    assert_eq!(without_values(original), without_values(exported), "{}", file.display());
}

/// A text without `<inertial>`, `<dynamics>`, the losses of an MJCF's joints, blanks, and the mark of an element without children.
fn without_values(text: &str) -> String {
    let mut rest = text;
    let mut kept = String::new();
    while let Some(start) = rest.find('<') {
        kept.push_str(&rest[..start]);
        let tag = &rest[start..];
        let end = tag.find('>').unwrap() + 1;
        let is_empty = tag[..end].ends_with("/>");
        if tag.starts_with("<inertial") && !is_empty {
            rest = tag.split_once("</inertial>").unwrap().1;
        } else {
            let is_value = tag.starts_with("<inertial") || tag.starts_with("<dynamics");
            let is_joint = tag.starts_with("<joint");
            kept.push_str(&if is_value {
                String::new()
            } else if is_joint {
                without_losses(&tag[..end])
            } else {
                tag[..end].to_owned()
            });
            rest = &tag[end..];
        }
    }
    kept.push_str(rest);
    kept.retain(|character| !character.is_whitespace());
    ["link", "body", "joint"].iter().fold(kept, |kept, name| kept.replace(&format!("></{name}>"), "/>"))
}

fn without_losses(tag: &str) -> String {
    let mut tag = tag.to_owned();
    for attribute in [" damping=", " frictionloss=", " armature="] {
        if let Some(start) = tag.find(attribute) {
            let value = start + attribute.len();
            let quote = &tag[value..=value];
            let end = value + 1 + tag[value + 1..].find(quote).unwrap() + 1;
            tag.replace_range(start..end, "");
        }
    }
    tag
}

/// Where all values are there already, nothing but what is within quotes changes.
#[test]
fn nothing_but_values_changes() {
    let file = &samples("urdf", "urdf").into_iter().find(|file| file.ends_with("six_axis.urdf")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let written = written_back(std::slice::from_ref(file), Format::Urdf, folder.path());
    let outside_quotes = |path: &Path| -> Vec<String> {
        fs::read_to_string(path).unwrap().split('"').step_by(2).map(str::to_owned).collect()
    };
    assert_eq!(outside_quotes(file), outside_quotes(&written[0]));
}

/// Imported again, it is the same device: bodies to rounding, effects to the last digit but one.
fn assert_imported_again(device: &Device, text: &str, path: &Path) {
    let imported = device_from_description(text, path, None).unwrap();
    let again = Device::parse(&imported.toml, Path::new("again.toml")).unwrap();
    assert_eq!(again.links.len(), device.links.len(), "{}", path.display());
    for (own, again) in device.links.iter().zip(&again.links) {
        let (own, again) = (own.values(), again.values());
        for part in [0..1, 1..4, 4..10] {
            let size = own[part.clone()].iter().fold(1e-6_f64, |size, value| size.max(value.abs()));
            part.for_each(|at| {
                assert!((own[at] - again[at]).abs() <= 1e-12 * size, "{}: {own:?} {again:?}", path.display())
            });
        }
    }
    assert_eq!(again.effects.len(), device.effects.len(), "{}", path.display());
    for (own, again) in device.effects.iter().zip(&again.effects) {
        assert_eq!((&own.id, own.joint), (&again.id, again.joint));
        let (own, again) = (own.values[0].1.value, again.values[0].1.value);
        assert!((own - again).abs() <= 1e-14 * own.abs(), "{}: {own} {again}", path.display());
    }
}

fn samples(folder: &str, extension: &str) -> Vec<PathBuf> {
    files_in(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../import/tests").join(folder), extension)
}

#[test]
fn samples_agree_with_pinocchio() {
    let (folder, files) = (tempfile::tempdir().unwrap(), samples("urdf", "urdf"));
    let written = written_back(&files, Format::Urdf, folder.path());
    assert_eq!(written.len(), files.len());
    assert_same(&PINOCCHIO, &written, false);
}

#[test]
fn robots_of_a_folder_agree_with_pinocchio() {
    let Ok(from) = std::env::var("DYNID_URDF_FOLDER") else {
        eprintln!("SKIPPED: DYNID_URDF_FOLDER names no folder of URDFs");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let written = written_back(&files_in(Path::new(&from), "urdf"), Format::Urdf, folder.path());
    assert_same(&PINOCCHIO, &written, true);
}

#[test]
fn samples_agree_with_mujoco() {
    let (folder, files) = (tempfile::tempdir().unwrap(), samples("mjcf", "xml"));
    let written = written_back(&files, Format::Mjcf, folder.path());
    assert_eq!(written.len(), files.len());
    assert_same(&MUJOCO, &written, false);
}

/// Springs, rotors, damping, friction and gravity in a file with classes of defaults, in which angles are degrees.
#[test]
fn the_whole_model_agrees_with_mujoco() {
    let folder = tempfile::tempdir().unwrap();
    let file = &samples("mjcf", "xml").into_iter().find(|file| file.ends_with("two_arms.xml")).unwrap();
    let text = fs::read_to_string(file).unwrap();
    fs::write(folder.path().join("arms.toml"), changed(&device_from_description(&text, file, None).unwrap().toml))
        .unwrap();
    let mut model = Model::of_device(device_named("arms.toml", folder.path()).unwrap());
    let n = model.device.joints.len();
    model.effects.retain(|own| own.effect.id == "rotor_inertia" || own.joint == Some(0));
    let add = |model: &mut Model, id: &str, joint: usize, values: &[f64]| {
        let mut instance = EffectInstance::new(model.device, id, Some(joint), None).unwrap();
        instance.parameters.iter_mut().zip(values).for_each(|(own, value)| own.value = *value);
        model.effects.push(instance);
    };
    (1..n).for_each(|joint| add(&mut model, "viscous", joint, &[0.3 + 0.1 * joint as f64]));
    (0..n).for_each(|joint| add(&mut model, "spring", joint, &[2.0 + joint as f64, 0.2 * joint as f64 - 0.5]));
    add(&mut model, "payload", 2, &[0.4, 0.05, -0.02, 0.3]);
    model.set_value("base.gz", 8.5).unwrap();
    let exported = as_description(&model, Format::Mjcf, &text, file).unwrap();
    assert_eq!(exported.notes.len(), 1, "{:?}", exported.notes);
    assert!(exported.notes[0].starts_with("`payload` at joint 2 became a part of link"), "{:?}", exported.notes);
    let path = folder.path().join("arms.xml");
    fs::write(&path, &exported.text).unwrap();

    let whole = Other { script: "whole_by_mujoco.py", ..MUJOCO };
    let Some(answers) = asked(&whole, &[path]) else { return };
    let all: Vec<usize> = (0..n).collect();
    let numbers =
        |value: &Value| -> Vec<f64> { value.as_array().unwrap().iter().map(|own| own.as_f64().unwrap()).collect() };
    let names = answers[0]["joints"].as_array().unwrap();
    let titles: Vec<&str> = model.device.joints.iter().map(|joint| joint.title.as_str()).collect();
    assert_eq!(names.iter().map(|name| name.as_str().unwrap()).collect::<Vec<_>>(), titles);
    let coulomb = |joint: usize| {
        let own = model.effects_at(joint).find(|own| own.effect.id == "coulomb");
        own.map_or(0.0, |own| own.value("Fc").unwrap())
    };
    assert_eq!(numbers(&answers[0]["frictionloss"]), all.iter().map(|joint| coulomb(*joint)).collect::<Vec<_>>());
    assert!(coulomb(0) > 0.0);
    let coulomb_is_a_constraint = |own: &EffectInstance| own.effect.id != "coulomb";
    model.effects.retain(coulomb_is_a_constraint);
    let system = model.system(&all, |_| 0.0).unwrap();
    let mut scratch = system.scratch();
    let (mut torque, mut dx) = (vec![0.0; n], vec![0.0; system.n_states()]);
    for state in answers[0]["states"].as_array().unwrap() {
        let [q, dq, ddq, expected] = ["q", "dq", "ddq", "torque"].map(|key| numbers(&state[key]));
        let x = [q, dq].concat();
        system.missing_torque(&mut scratch, 0.0, (&x, &ddq), &vec![0.0; n], &mut dx, &mut torque);
        let size = expected.iter().fold(0.0_f64, |size, own| size.max(own.abs()));
        for (found, expected) in torque.iter().zip(&expected) {
            assert!((found - expected).abs() <= 1e-9 * size, "{torque:?} {expected:?}");
        }
    }
}

/// A sum from which nothing is left for the link that carries the others, beside what these state.
#[test]
fn a_light_sum_goes_to_the_carrier() {
    let folder = tempfile::tempdir().unwrap();
    let file = &samples("urdf", "urdf").into_iter().find(|file| file.ends_with("gripper.urdf")).unwrap();
    let text = fs::read_to_string(file).unwrap();
    let imported = device_from_description(&text, file, None).unwrap();
    fs::write(folder.path().join("light.toml"), &imported.toml).unwrap();
    let device = device_named("light.toml", folder.path()).unwrap();
    let mut model = Model::of_device(device);
    let link = device.links.iter().position(|link| link.title == "wrist").unwrap();
    let values = [0.3, 0.01, 0.0, 0.05, 0.001, 0.0001, 0.0, 0.0011, 0.0, 0.0008];
    model.links[link].iter_mut().zip(values).for_each(|(own, value)| own.value = value);
    let exported = as_description(&model, Format::Urdf, &text, file).unwrap();
    assert_eq!(
        exported.notes,
        [
            "link `wrist` carries the mass of `palm` too, which have none now: no body is what the sum leaves beside what they stated"
        ]
    );
    assert_eq!(exported.text.matches("<inertial>").count(), text.matches("<inertial>").count());
    assert_eq!(exported.text.matches("<mass value=\"0\"/>").count(), 1);
    let again =
        Device::parse(&device_from_description(&exported.text, file, None).unwrap().toml, Path::new("again.toml"))
            .unwrap();
    assert_eq!(again.links[link].values(), values);
    // The others keep their text, and so does all when nothing has changed.
    let same = as_description(&Model::of_device(device), Format::Urdf, &text, file).unwrap();
    assert_eq!((same.text.as_str(), same.notes.len()), (text.as_str(), 0));
}

/// A link without mass, with a shape from which a reader could take one.
#[test]
fn a_link_whose_mass_is_taken_away_has_none_for_other_readers() {
    const ARM: &str = r#"<robot name="arm">
  <link name="ground"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <link name="tool">
    <inertial><mass value="0.5"/><inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial>
    <collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
  </link>
  <joint name="shoulder" type="continuous"><parent link="ground"/><child link="upper"/><axis xyz="0 1 0"/></joint>
  <joint name="mount" type="fixed"><parent link="upper"/><child link="tool"/><origin xyz="0.4 0 0"/></joint>
</robot>
"#;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("light.urdf");
    let mut document: DocumentMut = device_from_description(ARM, &path, None).unwrap().toml.parse().unwrap();
    document["link"].as_array_of_tables_mut().unwrap().iter_mut().for_each(|link| link["m"] = value(0.4));
    fs::write(path.with_extension("toml"), document.to_string()).unwrap();
    let device = device_named("light.toml", folder.path()).unwrap();
    let exported = as_description(&Model::of_device(device), Format::Urdf, ARM, &path).unwrap();
    assert_eq!(exported.notes.len(), 1, "{:?}", exported.notes);
    fs::write(&path, &exported.text).unwrap();
    assert_imported_again(device, &exported.text, &path);
    assert_same(&MUJOCO, std::slice::from_ref(&path), false);
    assert_same(&PINOCCHIO, &[path], false);
}

/// What the import mends is mended in the description too, whether or not the values changed since.
#[test]
fn a_mended_body_takes_the_place_of_the_impossible_one() {
    const ARM: &str = r#"<robot name="arm">
  <link name="ground"/>
  <link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.05"/></inertial></link>
  <joint name="s" type="continuous"><parent link="ground"/><child link="upper"/><axis xyz="0 1 0"/></joint>
</robot>
"#;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mended.urdf");
    let imported = device_from_description(ARM, &path, None).unwrap();
    assert_eq!(imported.notes.iter().filter(|note| note.starts_with("no body has")).count(), 1, "{:?}", imported.notes);
    fs::write(path.with_extension("toml"), &imported.toml).unwrap();
    let device = device_named("mended.toml", folder.path()).unwrap();
    let exported = as_description(&Model::of_device(device), Format::Urdf, ARM, &path).unwrap();
    assert_eq!(
        exported.notes,
        [
            "no body has the inertia that the description states of link `upper`; it has the device's now, which the import mended"
        ]
    );
    // The smaller moments rise by half of what the largest exceeds their sum by.
    assert!(
        exported.text.contains(r#"ixx="0.025" ixy="0" ixz="0" iyy="0.025" iyz="0" izz="0.05""#),
        "{}",
        exported.text
    );
    let again = device_from_description(&exported.text, &path, None).unwrap();
    assert!(!again.notes.iter().any(|note| note.starts_with("no body has")), "{:?}", again.notes);
}

/// What is no XML is that, not a description of another format.
#[test]
fn a_broken_description_is_told_as_it_is() {
    let model = Model::of_device(dynid_model::device("planar2r").unwrap());
    let error = as_description(&model, Format::Mjcf, "<mujoco>\n  <worldbody>\n", Path::new("arm.xml")).unwrap_err();
    assert!(error.to_string().contains("this is no XML") && error.to_string().contains("arm.xml"), "{error}");
}

/// Elements that the description does not have are added; what it has no place for is told.
#[test]
fn effects_find_their_place_or_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let file = &samples("urdf", "urdf").into_iter().find(|file| file.ends_with("gripper.urdf")).unwrap();
    let text = fs::read_to_string(file).unwrap();
    fs::write(folder.path().join("grip.toml"), device_from_description(&text, file, None).unwrap().toml).unwrap();
    let device = device_named("grip.toml", folder.path()).unwrap();
    let mut model = Model::of_device(device);
    for (id, value) in
        [("viscous", 0.7), ("rotor_inertia", 0.02), ("spring", 3.0), ("gain", 1.0), ("torque_offset", 0.25)]
    {
        let mut instance = EffectInstance::new(device, id, Some(0), None).unwrap();
        instance.parameters[0].value = value;
        model.effects.push(instance);
    }
    // The follower's alone is more than the sum: 6 = 3 + 3 before.
    let coulomb = model.effects.iter().position(|own| own.effect.id == "coulomb").unwrap();
    model.effects[coulomb].parameters[0].value = 2.0;
    let exported = as_description(&model, Format::Urdf, &text, file).unwrap();
    assert_eq!(
        exported.notes,
        [
            "`rotor_inertia` of joint `pitch`, 0.02, has no place in a URDF",
            "joint `finger_left_joint` has the whole `coulomb` of the joints that follow it, which have none now",
            "`spring` at joint 0 has no place in a URDF: Ks = 3.0, qeq = 0.0",
            "`torque_offset` at joint 0 has no place in a URDF: offset = 0.25",
        ]
    );
    let again =
        Device::parse(&device_from_description(&exported.text, file, None).unwrap().toml, Path::new("again.toml"))
            .unwrap();
    let effects: Vec<_> = again.effects.iter().map(|own| (own.id.as_str(), own.joint, own.values[0].1.value)).collect();
    assert_eq!(effects, [("viscous", Some(0), 0.7), ("viscous", Some(1), 22.0), ("coulomb", Some(1), 2.0)]);
    assert!(exported.text.contains("<dynamics damping=\"0.7\"/>"), "{}", exported.text);
}

fn refused(model: &Model, text: &str) -> String {
    as_description(model, Format::Urdf, text, Path::new("arm.urdf")).unwrap_err().to_string()
}

#[test]
fn another_robot_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name: &str| {
        fs::read_to_string(samples("urdf", "urdf").into_iter().find(|file| file.ends_with(name)).unwrap()).unwrap()
    };
    let text = read("scara.urdf");
    fs::write(
        folder.path().join("arm.toml"),
        device_from_description(&text, Path::new("arm.urdf"), None).unwrap().toml,
    )
    .unwrap();
    let model = Model::of_device(device_named("arm.toml", folder.path()).unwrap());
    assert_snapshot!(refused(&model, &read("odd.urdf")), @r#"
    this describes a robot of 2 joints, the model's device `arm` has 4
     --> arm.urdf:4:1
      |
    4 | <robot name="odd &quot;one&quot; \ &#228;">
      | ^^^^^^
      = help: name the file that `dynid device import` made the model's device from, or import this one and fit anew
    "#);
    assert_snapshot!(refused(&model, &text.replace("joint name=\"quill", "joint name=\"spindle")), @r#"
    joint 2 is `spindle` here, and `quill` in the model's device `arm`
      --> arm.urdf:41:3
       |
    41 |   <joint name="spindle" type="prismatic">
       |   ^^^^^^
       = help: name the file that `dynid device import` made the model's device from, or import this one and fit anew
    "#);
    assert_snapshot!(refused(&model, &text.replace("0.325 0 0.04", "0.327 0 0.04")), @r#"
    the model's device `arm` has frame `outer` elsewhere than this description
      --> arm.urdf:34:3
       |
    34 |   <link name="outer">
       |   ^^^^^
       = help: name the file that `dynid device import` made the model's device from, or import this one and fit anew
    "#);
    assert_snapshot!(refused(&model, "<robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\"><xacro:arm/></robot>"), @r#"
    xacro is left in: the element `xacro:arm`
     --> arm.urdf:1:52
      |
    1 | <robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>
      |                                                    ^^^^
      = help: this file is a template; run xacro first, e.g. `xacro robot.urdf.xacro > robot.urdf`
    "#);
    assert_snapshot!(refused(&model, "<mujoco/>"), @"arm.urdf: this is an MJCF (its root element is `mujoco`); write it with `--as mjcf`, or name a description of the format that you want");
}

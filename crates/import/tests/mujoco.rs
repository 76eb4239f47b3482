//! Devices imported from MJCFs against MuJoCo.
//!
//! `DYNID_PYTHON` names a Python that has `mujoco` (else `python3`); where there is none, this is skipped aloud.

mod support;

use std::{fs, path::Path};

use dynid_import::device_from_mjcf;
use dynid_model::Device;
use insta::assert_snapshot;
use support::{Other, assert_same, files_in};

const MUJOCO: Other = Other { module: "mujoco", package: "mujoco", script: "by_mujoco.py", import: device_from_mjcf };

#[test]
fn samples_agree_with_mujoco() {
    let files = files_in(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mjcf"), "xml");
    assert!(files.len() >= 2);
    assert_same(&MUJOCO, &files, false);
}

#[test]
fn classes_and_limits_are_read() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mjcf/two_arms.xml");
    let imported = device_from_mjcf(&fs::read_to_string(&path).unwrap(), &path).unwrap();
    let device = Device::parse(&imported.toml, Path::new("two_arms.toml")).unwrap();
    let limits = |joint: usize| device.joints[joint].position_limits.map(f64::to_degrees).map(f64::round);
    assert_eq!((limits(1), limits(2)), ([-120.0, 120.0], [-10.0, 140.0]));
    assert_eq!(device.joints[1].torque_limit, 45.0);
    assert_eq!(device.joints[5].position_limits, [f64::NEG_INFINITY, f64::INFINITY]);
    let value = |id: &str, joint: usize| {
        let effect = device.effects.iter().find(|own| own.id == id && own.joint == Some(joint));
        effect.map(|own| own.values[0].1.value)
    };
    assert_eq!((value("rotor_inertia", 2), value("rotor_inertia", 3)), (Some(0.02), Some(0.003)));
    assert_eq!((value("viscous", 2), value("viscous", 3)), (Some(0.4), None));
    assert_eq!((value("coulomb", 0), value("coulomb", 5)), (Some(0.7), None));
    assert_snapshot!(imported.notes.join("\n"), @"
    left out, because they stand still: pedestal
    `damping` became the effect `viscous` of 5 joints
    `friction` became the effect `coulomb` of 4 joints
    `armature` became the effect `rotor_inertia` of 6 joints
    the end point is taken to be the origin of link `left_tool`; its orientation is left out
    left out: 1 of <actuator>
    ");
}

fn error(text: &str) -> String {
    device_from_mjcf(text, Path::new("arm.xml")).unwrap_err().to_string()
}

fn arm(body: &str) -> String {
    format!("<mujoco>\n<worldbody>\n<body name='rod'>\n{body}\n</body>\n</worldbody>\n</mujoco>")
}

#[test]
fn what_is_wrong_is_pointed_at() {
    assert_snapshot!(error("<robot/>"), @"
    expected `<mujoco>`, found `<robot>`
     --> arm.xml:1:1
      |
    1 | <robot/>
      | ^^^^^^
      = help: an MJCF has one element `<mujoco>` with all others in it
    ");
    assert_snapshot!(error("<mujoco>\n  <include file='a.xml'/>\n</mujoco>"), @r#"
    `<include>` is left in
     --> arm.xml:2:3
      |
    2 |   <include file='a.xml'/>
      |   ^^^^^^^^
      = help: save the compiled model first: `mujoco.mj_saveLastXML("robot.xml", model)` writes all bodies out
    "#);
    assert_snapshot!(error("<mujoco/>"), @"
    there is no `<worldbody>`
     --> arm.xml:1:1
      |
    1 | <mujoco/>
      | ^^^^^^^
      = help: bodies stand in it
    ");
    assert_snapshot!(error(&arm("<freejoint/>")), @"
    body `rod` moves freely: a device has joints of one variable each
     --> arm.xml:4:1
      |
    4 | <freejoint/>
      | ^^^^^^^^^^
      = help: remove the joint, so that the body stands still, or write three hinges for a ball
    ");
    assert_snapshot!(error(&arm("<joint/>\n<geom size='1'/>")), @"
    body `rod` takes its mass from shapes, which are not read here
     --> arm.xml:5:1
      |
    5 | <geom size='1'/>
      | ^^^^^
      = help: state an `<inertial>`; MuJoCo computes it: body_mass, body_ipos, body_iquat and body_inertia of its model
    ");
    assert_snapshot!(error(&arm("<joint/>")), @"
    no link has an `<inertial>`: the file describes shapes, not dynamics
     --> arm.xml:1:1
      |
    1 | <mujoco>
      | ^^^^^^^
      = help: add mass, centroid and inertia to the links, as guesses if need be; a fit improves them
    ");
    assert_snapshot!(error(&arm("<joint class='stiff'/>")), @"
    unknown class `stiff`
     --> arm.xml:4:1
      |
    4 | <joint class='stiff'/>
      | ^^^^^^
      = help: there is none to choose from
    ");
    assert_snapshot!(error(&arm("<inertial pos='0 0 0' mass='1'/>")), @r#"
    the `<inertial>` of body `rod` states no inertia
     --> arm.xml:4:1
      |
    4 | <inertial pos='0 0 0' mass='1'/>
      | ^^^^^^^^^
      = help: add `diaginertia="xx yy zz"`
    "#);
    assert_snapshot!(error(&arm("<inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/>\n<joint axis='0 0 0'/>")), @r#"
    the axis of joint `rod 1` has length 0
     --> arm.xml:5:14
      |
    5 | <joint axis='0 0 0'/>
      |              ^^^^^
      = help: give a direction, e.g. `axis="0 0 1"`
    "#);
    assert_snapshot!(error(&arm("<inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/>\n<joint ref='10'/>")), @"
    joint `rod 1` is not 0 where it stands in the file
     --> arm.xml:5:13
      |
    5 | <joint ref='10'/>
      |             ^^
      = help: turn the body instead, and remove `ref`
    ");
    assert_snapshot!(error(&arm("<inertial pos='0 0 0' mass='1' diaginertia='1 1 -1'/>\n<joint/>")), @"
    no body has a negative moment of inertia: body `rod`
     --> arm.xml:4:1
      |
    4 | <inertial pos='0 0 0' mass='1' diaginertia='1 1 -1'/>
      | ^^^^^^^^^
      = help: moments are about the centroid, and at least 0
    ");
}

//! The shipped devices and effects are what their sources say.

use std::{f64::consts::PI, path::Path};

use dynid_model::{Convention, Device, JointKind, Place, Scope, device, devices, effect, effects};

type Transform = [[f64; 4]; 4];

fn product(a: &Transform, b: &Transform) -> Transform {
    std::array::from_fn(|row| std::array::from_fn(|column| (0..4).map(|k| a[row][k] * b[k][column]).sum()))
}

fn rotation(axis: usize, angle: f64) -> Transform {
    let (sine, cosine) = angle.sin_cos();
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut matrix = translation([0.0; 3]);
    matrix[u][u] = cosine;
    matrix[u][v] = -sine;
    matrix[v][u] = sine;
    matrix[v][v] = cosine;
    matrix
}

fn translation(by: [f64; 3]) -> Transform {
    std::array::from_fn(|row| {
        std::array::from_fn(|column| match (row, column) {
            (row, 3) if row < 3 => by[row],
            (row, column) => f64::from(u8::from(row == column)),
        })
    })
}

fn chain(parts: &[Transform]) -> Transform {
    parts.iter().fold(translation([0.0; 3]), |sum, part| product(&sum, part))
}

/// Base to frame, from the device's own table.
fn pose(device: &Device, name: &str, q: &[f64]) -> Transform {
    let frame = device.frames.iter().find(|frame| frame.name == name).unwrap();
    let value = |expression: &dynid_model::Expression| {
        expression
            .evaluate(&|symbol| match dynid_model::device::joint_variable(symbol) {
                Some(joint) => q.get(joint).copied(),
                None => device.lengths.iter().find(|length| length.symbol == symbol).map(|length| length.value),
            })
            .unwrap()
    };
    let [theta, d, a, alpha] = [&frame.theta, &frame.d, &frame.a, &frame.alpha].map(value);
    let about_z = chain(&[rotation(2, theta), translation([0.0, 0.0, d])]);
    let about_x = chain(&[translation([a, 0.0, 0.0]), rotation(0, alpha)]);
    let own = match device.convention {
        Convention::Standard => product(&about_z, &about_x),
        Convention::Modified => product(&about_x, &about_z),
    };
    match frame.parent {
        Some(parent) => product(&pose(device, &device.frames[parent].name, q), &own),
        None => own,
    }
}

fn assert_same(a: &Transform, b: &Transform) {
    for (row_a, row_b) in a.iter().zip(b) {
        for (x, y) in row_a.iter().zip(row_b) {
            assert!((x - y).abs() < 1e-10, "{a:?}\n{b:?}");
        }
    }
}

#[test]
fn all_devices_are_there_and_complete() {
    for id in ["double_pendulum", "freedom6s", "oscillator", "planar2r", "servo_pendulum", "staubli_tx40"] {
        let device = device(id).unwrap_or_else(|| panic!("{id} is not shipped"));
        let n_joints = device.joints.len();
        for joint in 0..n_joints {
            assert!(device.configuration_of(&[joint]).is_some(), "{id}: joint {joint} alone");
        }
        let all: Vec<usize> = (0..n_joints).collect();
        assert!(device.configuration_of(&all).is_some(), "{id}: all joints");
    }
    for device in devices() {
        for default in &device.effects {
            assert!(effect(&default.id).is_some(), "{}: {}", device.id, default.id);
        }
    }
}

#[test]
fn all_effects_are_there() {
    let ids: Vec<&str> = effects().iter().map(|effect| effect.id.as_str()).collect();
    for id in [
        "coulomb",
        "friction_bias",
        "friction_coupled",
        "gain",
        "input_coupling",
        "lugre",
        "rotor_coupling",
        "rotor_inertia",
        "spring",
        "stribeck",
        "torque_offset",
        "viscous",
    ] {
        assert!(ids.contains(&id), "{id}");
    }
    let lugre = effect("lugre").unwrap();
    let symbols: Vec<&str> = lugre.parameters.iter().map(|parameter| parameter.symbol.as_str()).collect();
    assert_eq!(symbols, ["sigma0", "sigma1", "sigma2", "vs", "Fs", "Fc"]);
    assert_eq!(lugre.place, Place::Joint);
}

#[test]
fn staubli_frames_are_the_urdf_s() {
    // Joint origins (xyz, roll-pitch-yaw) of the URDF, which writes pi with twelve digits; each joint turns about its own z.
    let origins: [([f64; 3], [f64; 3]); 6] = [
        ([0.0, 0.0, 0.320], [0.0, 0.0, 0.0]),
        ([0.0, 0.0, 0.0], [-PI / 2.0, 0.0, 0.0]),
        ([0.225, 0.0, 0.035], [0.0, 0.0, 0.0]),
        ([0.0, -0.225, 0.0], [PI / 2.0, 0.0, 0.0]),
        ([0.0, 0.0, 0.0], [-PI / 2.0, 0.0, 0.0]),
        ([0.0, 0.0, 0.0], [PI / 2.0, PI, 0.0]),
    ];
    let device = device("staubli_tx40").unwrap();
    let q = [0.3, -0.7, 1.1, 0.4, -0.9, 2.0];
    let mut urdf = translation([0.0; 3]);
    for (joint, (xyz, [roll, pitch, yaw])) in origins.into_iter().enumerate() {
        urdf = chain(&[
            urdf,
            translation(xyz),
            rotation(2, yaw),
            rotation(1, pitch),
            rotation(0, roll),
            rotation(2, q[joint]),
        ]);
        assert_same(&pose(device, &format!("f{}", joint + 1), &q), &urdf);
    }
}

#[test]
fn staubli_inertia_is_turned_into_the_link_frame() {
    // Link 2 in the URDF: diag(0.009, 0.038, 0.040), ixz 0.002, in axes turned by yaw -pi/2.
    let turn = rotation(2, -PI / 2.0);
    let given = [[0.009, 0.0, 0.002], [0.0, 0.038, 0.0], [0.002, 0.0, 0.040]];
    let turned = |row: usize, column: usize| -> f64 {
        (0..3)
            .flat_map(|i| (0..3).map(move |j| (i, j)))
            .map(|(i, j)| turn[row][i] * given[i][j] * turn[column][j])
            .sum()
    };
    let [.., xx, xy, xz, yy, yz, zz] = device("staubli_tx40").unwrap().links[1].values();
    let expected = [(xx, 0, 0), (xy, 0, 1), (xz, 0, 2), (yy, 1, 1), (yz, 1, 2), (zz, 2, 2)];
    for (value, row, column) in expected {
        assert!((value - turned(row, column)).abs() < 1e-12, "I[{row}][{column}]");
    }
}

#[test]
fn freedom6s_chains_close() {
    let device = device("freedom6s").unwrap();
    assert_eq!(device.up, [0.0, 0.0, 1.0]);
    let q = [0.2, -0.3, 0.4, 0.5, -0.6, 0.7];
    // Thesis section 3.1: the origin of fe of the second chain lies one length of link 2 from f3 of the first along z.
    let (elbow, rod) = (pose(device, "b3", &q), pose(device, "be", &q));
    let distance: f64 = (0..3).map(|axis| (elbow[axis][3] - rod[axis][3]).powi(2)).sum::<f64>().sqrt();
    assert!((distance - 0.23).abs() < 1e-12);
    // Link 4's orientation does not depend on q2.
    let mut other = q;
    other[2] = -1.0;
    let turned = pose(device, "be", &other);
    for axis in 0..3 {
        for column in 0..3 {
            assert!((rod[axis][column] - turned[axis][column]).abs() < 1e-12);
        }
    }
    // Link 1's frame: turned by q0 + pi/2, with all its lengths 0.
    assert_same(&pose(device, "ce", &q), &rotation(2, q[0] + PI / 2.0));
    // The handle's frame turns with q5 before q4.
    assert_eq!(
        device.joints_moving(device.frames.iter().position(|frame| frame.name == "a5").unwrap()),
        [0, 1, 2, 3, 5]
    );
    assert_eq!(device.last_link_moved_by(4), Some(6));
}

#[test]
fn kinds_of_joints_are_found() {
    assert_eq!(device("oscillator").unwrap().joints[0].kind, JointKind::Prismatic);
    assert_eq!(device("planar2r").unwrap().joints[1].kind, JointKind::Revolute);
    assert_eq!(device("oscillator").unwrap().up, [0.0; 3]);
    assert_eq!(effect("viscous").unwrap().parameters[0].unit_at(JointKind::Prismatic, "N"), "N*s/m");
    assert_eq!(effect("gain").unwrap().parameters[0].unit_at(JointKind::Revolute, "V"), "N*m/V");
    assert_eq!(effect("gain").unwrap().parameters[0].unit_at(JointKind::Revolute, "N*m"), "1");
}

#[test]
fn structure_digest_follows_structure_not_values() {
    let text = include_str!("../devices/planar2r.toml");
    let parse = |text: &str| Device::parse(text, Path::new("planar2r.toml")).unwrap();
    let digest = parse(text).structure_digest();
    assert_eq!(digest.len(), 64);
    for (from, to) in [
        ("m = 1.2", "m = 1.3"),
        ("L1 = 0.4", "L1 = 0.5"),
        ("\"shoulder\"", "\"hip\""),
        ("gravity = 9.81", "gravity = 1.62"),
    ] {
        assert!(text.contains(from));
        assert_eq!(parse(&text.replace(from, to)).structure_digest(), digest, "{to}");
    }
    for (from, to) in [
        ("\"L2\", alpha = 0", "\"L2\", alpha = \"pi/2\""),
        ("\"standard\"", "\"modified\""),
        ("up = [0, 1, 0]", "up = [\"0.6\", \"0.8\", 0]"),
        ("[[0], [1], [0, 1]]", "[[1], [0], [0, 1]]"),
        ("frame = \"f2\"", "frame = \"f1\""),
    ] {
        assert!(text.contains(from), "{from}");
        let changed = text.replace(from, to);
        if let Ok(device) = Device::parse(&changed, Path::new("planar2r.toml")) {
            assert_ne!(device.structure_digest(), digest, "{to}");
        } else {
            assert!(from.starts_with("frame"), "{from}: moving no link is refused");
        }
    }
}

/// Torque of an effect at one joint, with the values given by name.
fn torque(id: &str, values: &[(&str, f64)]) -> f64 {
    let lookup = |symbol: &str| values.iter().find(|(name, _)| *name == symbol).map(|(_, value)| *value);
    effect(id).unwrap().evaluate(&lookup).unwrap().0[0]
}

#[test]
fn memoryless_friction_never_drives() {
    let laws = effects().iter().filter(|effect| {
        effect.family.as_deref() == Some("friction") && effect.states.is_empty() && effect.scope == Scope::Joint
    });
    let mut n_laws = 0;
    // friction_drift is a change of other friction, and a general curve may be one: these may have either sign.
    for law in laws.filter(|law| law.id != "friction_drift" && !law.general) {
        n_laws += 1;
        for dq in [-3.0, -0.05, -1e-4, 0.0, 1e-4, 0.05, 3.0] {
            for part in [0.01, 0.5, 1.0] {
                let mut values = vec![("dq", dq), ("load", -2.0), ("q", 0.3), ("t", 5.0)];
                for own in &law.parameters {
                    values.push((&own.symbol, own.lower + part * (own.upper - own.lower)));
                }
                assert!(torque(&law.id, &values) * dq >= 0.0, "{} at dq = {dq}: {values:?}", law.id);
            }
        }
    }
    assert!(n_laws >= 6);
}

#[test]
fn lugre_slides_on_the_stribeck_curve() {
    let (sigma0, sigma1, sigma2, vs, stiction, coulomb): (f64, f64, f64, f64, f64, f64) =
        (6.7, 0.07, 0.06, 0.75, 0.06, 0.012);
    for dq in [-1.3_f64, -0.01, 0.2, 2.0] {
        // At constant speed the bristles rest at z = g sign(v) / sigma0 (Eq. 3.7 with dz/dt = 0).
        let level = coulomb + (stiction - coulomb) * (-(dq / vs).powi(2)).exp();
        let z = level * dq.signum() / sigma0;
        let values = [
            ("sigma0", sigma0),
            ("sigma1", sigma1),
            ("sigma2", sigma2),
            ("vs", vs),
            ("Fs", stiction),
            ("Fc", coulomb),
            ("dq", dq),
            ("z", z),
        ];
        let lookup = |symbol: &str| values.iter().find(|(name, _)| *name == symbol).map(|(_, value)| *value);
        let (outputs, rates) = effect("lugre").unwrap().evaluate(&lookup).unwrap();
        assert!(rates[0].abs() < 1e-12);
        assert!((outputs[0] - (level * dq.signum() + sigma2 * dq)).abs() < 1e-14);
    }
}

#[test]
fn coupled_friction_acts_alike_on_both_joints() {
    let law = effect("friction_coupled").unwrap();
    let at = |dq: f64, dq_from: f64| {
        let values = [("Fv", 0.6), ("Fc", 2.0), ("v_eps", 0.01), ("dq", dq), ("dq_from", dq_from)];
        let lookup = |symbol: &str| values.iter().find(|(name, _)| *name == symbol).map(|(_, value)| *value);
        law.evaluate(&lookup).unwrap().0
    };
    let (one, other) = (at(0.4, -0.1), at(-0.1, 0.4));
    assert_eq!([one[0], one[1]], [other[1], other[0]]);
    assert!((one[0] - (0.6 * -0.1 + 2.0 * (0.3f64 / 0.01).tanh())).abs() < 1e-14);
}

#[test]
fn friction_bias_scales_the_whole_friction_on_one_side() {
    let bias = |q: f64| torque("friction_bias", &[("bias", 1.85), ("q", q), ("qeq", 0.1), ("friction", 0.02)]);
    assert!((bias(0.0) + 0.02 - 1.85 * 0.02).abs() < 1e-15);
    assert_eq!(bias(0.2), 0.0);
}

use super::*;

fn entry(id: &str, from: Option<usize>, values: &[(&str, f64)]) -> EffectEntry {
    let values = values.iter().map(|&(symbol, value)| (symbol.to_owned(), value)).collect();
    EffectEntry { id: id.to_owned(), joint: 0, from, values }
}

/// What resists at `joint`.
fn load(joints: &[JointEffects], joint: usize, q: &[f64], dq: &[f64], states: &[f64], rates: &mut [f64]) -> f64 {
    let moment = Moment { joint, q, dq, time: 0.0, torque: 0.0, commands: &[] };
    -joints[joint].torque(&moment, 0.0, states, rates)
}

#[test]
fn drive_offsets_and_couples_before_the_gain() {
    let entries = [
        entry("gain", None, &[("Kp", 2.0)]),
        entry("torque_offset", None, &[("offset", 0.5)]),
        entry("input_coupling", Some(1), &[("gain", -0.25)]),
    ];
    let joints = by_joint(&entries, 2).unwrap();
    assert_eq!(joints[0].drive.torque(1.0, &[1.0, 4.0], 0.0, 0.0), 2.0 * (1.0 + 0.5 - 1.0));
    assert_eq!(joints[1].drive.torque(4.0, &[1.0, 4.0], 0.0, 0.0), 4.0);
}

/// Sliding steadily, the bristles stand still at `g(v)/sigma0 * sign(v)`; the friction is then `g(v) + sigma2 v`.
#[test]
fn lugre_slides_at_its_level() {
    let symbols = [("sigma0", 6.0), ("sigma1", 0.1), ("sigma2", 0.02), ("vs", 0.1), ("Fs", 0.05), ("Fc", 0.03)];
    let joints = by_joint(&[entry("lugre", None, &symbols)], 1).unwrap();
    let v = -0.07_f64;
    let level = 0.03 + 0.02 * (-0.49_f64).exp();
    let mut rate = [f64::NAN];
    let torque = load(&joints, 0, &[0.0], &[v], &[-level / 6.0], &mut rate);
    assert!(rate[0].abs() < 1e-15 && (torque - (-level + 0.02 * v)).abs() < 1e-15);
}

#[test]
fn bias_scales_all_friction_below_the_rest_position_and_nothing_else() {
    let entries = [
        entry("spring", None, &[("Ks", 3.0), ("qeq", 0.2)]),
        entry("viscous", None, &[("Fv", 0.5)]),
        entry("friction_bias", None, &[("bias", 1.5)]),
    ];
    let joints = by_joint(&entries, 1).unwrap();
    let load = |q: f64| load(&joints, 0, &[q], &[2.0], &[], &mut []);
    assert!((load(0.1) - (3.0 * -0.1 + 1.5)).abs() < 1e-15);
    assert!((load(0.3) - (3.0 * 0.1 + 1.0)).abs() < 1e-15);
}

#[test]
fn stribeck_falls_from_stiction_to_coulomb() {
    let symbols = [("Fs", 0.9), ("Fc", 0.4), ("vs", 0.1), ("v_eps", 1e-6)];
    let joints = by_joint(&[entry("stribeck", None, &symbols)], 1).unwrap();
    let load = |v: f64| load(&joints, 0, &[0.0], &[v], &[], &mut []);
    assert!((load(1e-4) - 0.9).abs() < 1e-5 && (load(10.0) - 0.4).abs() < 1e-15 && load(-10.0) == -load(10.0));
}

#[test]
fn coupled_friction_acts_on_both_joints() {
    let entries = [entry("friction_coupled", Some(1), &[("Fv", 0.5), ("Fc", 2.0), ("v_eps", 1e-6)])];
    let joints = by_joint(&entries, 2).unwrap();
    let load = |joint: usize| load(&joints, joint, &[0.0, 0.0], &[3.0, -4.0], &[], &mut []);
    assert_eq!((load(0), load(1)), (0.5 * -4.0 - 2.0, 0.5 * 3.0 - 2.0));
}

#[test]
fn unknown_effects_and_missing_values_are_errors() {
    assert!(by_joint(&[entry("magic", None, &[])], 1).unwrap_err().contains("magic"));
    assert!(by_joint(&[entry("gain", None, &[])], 1).unwrap_err().contains("`Kp` is missing"));
}

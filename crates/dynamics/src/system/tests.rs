//! Tests of systems on the kernels of [`super::fixtures`].

use super::fixtures::*;
use super::*;

#[test]
fn the_drive_path_runs_in_its_fixed_order() {
    // Given in the wrong order; coupling enters before the gain.
    let effects = [placed(&GAIN, 1, None, &[3.0]), placed(&INPUT_COUPLING, 1, Some(0), &[-0.5])];
    let system = System::new(&ARM, 2, vec![1.0, 0.1, 0.1, 1.0, 0.1, 0.1], Vec::new(), &effects).unwrap();
    let mut scratch = system.scratch();
    system.drive(&mut scratch, 0.0, &[0.0; 4], &[2.0, 1.5], &mut [0.0; 4]);
    assert_eq!(scratch.drive, [2.0, 3.0 * (1.5 - 0.5 * 2.0)]);
    assert!(system.steady_drive());
}

#[test]
fn friction_bias_scales_the_whole_friction_below_the_rest_position() {
    let effects = [
        placed(&FRICTION_BIAS, 0, None, &[1.5]),
        placed(&VISCOUS, 0, None, &[2.0]),
        placed(&SPRING, 0, None, &[0.0, 0.3]),
    ];
    let system = System::new(&PENDULUM, 1, vec![1.0, 0.0, 1.0], Vec::new(), &effects).unwrap();
    let mut dx = [0.0; 2];
    system.derivative(&mut system.scratch(), 0.0, &[0.2, 1.0], &[0.0], &mut dx);
    assert_eq!(dx, [1.0, -3.0]);
    system.derivative(&mut system.scratch(), 0.0, &[0.4, 1.0], &[0.0], &mut dx);
    assert_eq!(dx, [1.0, -2.0]);
}

#[test]
fn accelerations_satisfy_the_inverse_dynamics() {
    let system = full_arm();
    let x = [0.7, -0.4, 0.9, -1.3, 0.5, 0.01, -0.02];
    let mut dx = [0.0; 7];
    let mut scratch = system.scratch();
    system.derivative(&mut scratch, 0.0, &x, &[0.6, -0.2], &mut dx);
    let mut tau = [0.0; 2];
    ARM.functions.inverse_dynamics(system.prepared(), &x[..2], &x[2..4], &dx[2..4], &mut tau);
    tau[1] += 0.004 * dx[3]; // rotor inertia
    for joint in 0..2 {
        let applied = scratch.drive[joint] - scratch.load[joint];
        assert!((tau[joint] - applied).abs() < 1e-12, "joint {joint}: {} for {applied}", tau[joint]);
    }
}

/// With a drive path that has states, springs that read friction, and inertia that is added; and systems that differ in values.
#[test]
fn eight_systems_have_the_bits_of_each_alone() {
    let arm = |lane: usize| {
        let mut system = full_arm();
        let scaled =
            |values: &[f64]| values.iter().map(|value| value * (1.0 + 0.01 * lane as f64)).collect::<Vec<f64>>();
        let (link, effects) = (scaled(system.link_parameters()), scaled(system.effect_parameters()));
        system.set_parameters(&link, &effects);
        system
    };
    let pendulum = |lane: usize| {
        let effects = [
            placed(&INPUT_LAG, 0, None, &[0.02]),
            placed(&GAIN, 0, None, &[1.0 + 0.1 * lane as f64]),
            placed(&FRICTION_BIAS, 0, None, &[1.5]),
            placed(&LUGRE, 0, None, &[6.7, 0.05, 0.01, 0.1, 0.06, 0.04]),
            placed(&VISCOUS, 0, None, &[2.0]),
            placed(&SPRING, 0, None, &[0.1, 0.3]),
        ];
        System::new(&PENDULUM, 1, vec![1.0, 0.1, 1.0], Vec::new(), &effects).unwrap()
    };
    for systems in [std::array::from_fn::<System, 8, _>(arm), std::array::from_fn(pendulum)] {
        let number = |lane: usize, row: usize| (1.3 * lane as f64 + 0.7 * row as f64).sin() * 0.4;
        let rows = |from: usize, count: usize| -> Vec<[f64; 8]> {
            (from..from + count).map(|row| std::array::from_fn(|lane| number(lane, row))).collect()
        };
        let (n, n_joints, n_states) = (systems[0].n_free(), systems[0].n_joints(), systems[0].n_states());
        let (x, command, external) = (rows(0, n_states), rows(20, n_joints), rows(30, n));
        let t = rows(40, 1)[0];
        let mut eight = EightSystems::new(systems.each_ref()).unwrap();
        let mut dx = vec![[0.0; 8]; n_states];
        eight.drive(t, &x, &command, &mut dx);
        eight.motion(t, &x, &external, &mut dx);
        for (lane, system) in systems.iter().enumerate() {
            let of = |rows: &[[f64; 8]]| -> Vec<f64> { rows.iter().map(|row| row[lane]).collect() };
            let mut alone = vec![0.0; n_states];
            let scratch = &mut system.scratch();
            system.derivative_under(scratch, t[lane], &of(&x), &of(&command), &of(&external), &mut alone);
            assert_eq!(of(&dx), alone, "lane {lane} of {system:?}");
        }
    }
    let (one, other) = (arm(0), pendulum(0));
    assert!(EightSystems::new([&one, &one, &one, &other, &one, &one, &one, &one]).is_none());
}

#[test]
fn a_missing_value_is_an_error() {
    let wrong = System::new(&PENDULUM, 1, vec![1.0], Vec::new(), &[]).unwrap_err();
    assert_eq!(wrong.to_string(), "parameters of the kernel: 1 values given, 3 needed");
}

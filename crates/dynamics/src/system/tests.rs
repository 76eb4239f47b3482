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

#[test]
fn a_missing_value_is_an_error() {
    let wrong = System::new(&PENDULUM, 1, vec![1.0], Vec::new(), &[]).unwrap_err();
    assert_eq!(wrong.to_string(), "parameters of the kernel: 1 values given, 3 needed");
}

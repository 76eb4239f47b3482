use std::f64::consts::PI;

use super::*;
use crate::{
    experiment::{Hold, Role, Run, Settings},
    log::Log,
    system::tests::{ARM, GAIN, INPUT_COUPLING, LUGRE, ROTOR_INERTIA, SPRING, VISCOUS, placed},
};

/// Masses, centroids, inertias of the two links.
const LINKS: [f64; 6] = [1.2, 0.21, 0.02, 0.8, 0.17, 0.011];

/// The arm with effects of every kind that the torque error knows.
fn arm() -> System {
    let effects = [
        placed(&GAIN, 0, None, &[1.4]),
        placed(&GAIN, 1, None, &[0.8]),
        placed(&INPUT_COUPLING, 1, Some(0), &[-0.2]),
        placed(&SPRING, 0, None, &[0.9, 0.5]),
        placed(&LUGRE, 0, None, &[8.0, 0.4, 0.05, 0.2, 0.5, 0.3]),
        placed(&VISCOUS, 1, None, &[0.02]),
        placed(&ROTOR_INERTIA, 1, None, &[0.004]),
    ];
    System::new(&ARM, 2, LINKS.to_vec(), Vec::new(), &effects).expect("the arm is complete")
}

/// A smooth motion of both joints with made-up torques.
fn run() -> Run {
    let t: Vec<f64> = (0..1200).map(|k| 0.01 * f64::from(k)).collect();
    let wave = |scale: f64, hertz: f64, phase: f64| -> Vec<f64> {
        t.iter().map(|t| scale * (2.0 * PI * hertz * t + phase).sin()).collect()
    };
    let log = Log {
        q: vec![wave(0.8, 0.31, 0.2), wave(1.1, 0.47, 1.0)],
        tau: vec![wave(3.0, 0.5, 0.7), wave(1.0, 0.9, 0.1)],
        t,
        reference: None,
        mask: None,
    };
    let settings = Settings {
        cutoff_hz: Some(5.0),
        decimate: 4,
        min_speed: vec![0.0; 2],
        hold: Hold::Linear,
        ..Settings::default()
    };
    Run { file: "arm.csv".to_owned(), role: Role::Fit, free: vec![0, 1], configuration: 1, log, settings }
}

#[test]
fn a_torque_that_fits_the_motion_leaves_no_error() {
    // A slow motion, whose torque the filter passes: tau = D ddq + h by the closed form.
    let mut run = run();
    let (a, b) = (0.8, 1.1);
    let (u, v) = (2.0 * PI * 0.31, 2.0 * PI * 0.47);
    let system = System::new(&ARM, 2, LINKS.to_vec(), Vec::new(), &[]).expect("the arm is complete");
    for k in 0..run.log.len() {
        let (p, r) = (u * run.log.t[k] + 0.2, v * run.log.t[k] + 1.0);
        let mut tau = [0.0; 2];
        (ARM.inverse_dynamics)(
            system.prepared(),
            &[a * p.sin(), b * r.sin()],
            &[a * u * p.cos(), b * v * r.cos()],
            &[-a * u * u * p.sin(), -b * v * v * r.sin()],
            &mut tau,
        );
        run.log.tau[0][k] = tau[0];
        run.log.tau[1][k] = tau[1];
    }
    for joint in torque_error(&system, &run).expect("long enough") {
        let percent = joint.percent().expect("there is torque");
        assert!(percent < 0.05, "joint {}: {percent} %", joint.joint);
    }
}

#[test]
fn error_and_linear_equations_agree() {
    let (system, motion) = (arm(), Motion::of(&run()).expect("long enough"));
    let rigid = rigid_columns(&system, &motion);
    let linear = linearise(&system, &motion, &rigid);
    for (joint, linear) in along(&system, &motion).iter().zip(&linear) {
        let scale = joint.residual.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
        for (a, b) in joint.residual.iter().zip(&linear.residual) {
            assert!((a - b).abs() < 1e-12 * scale, "{a} {b}");
        }
    }
}

/// Central differences of the torque error by every effect parameter and every lump.
#[test]
fn gradients_agree_with_differences() {
    let (system, motion) = (arm(), Motion::of(&run()).expect("long enough"));
    let rigid = rigid_columns(&system, &motion);
    let linear = linearise(&system, &motion, &rigid);
    let parameters = system.effect_parameters().to_vec();
    for parameter in 0..parameters.len() {
        let step = 1e-5 * parameters[parameter].abs();
        let at = |sign: f64| {
            let mut moved = parameters.clone();
            moved[parameter] += sign * step;
            let mut system = system.clone();
            system.set_parameters(&LINKS, &moved);
            along(&system, &motion)
        };
        let (low, high) = (at(-1.0), at(1.0));
        for slot in 0..2 {
            let difference: Vec<f64> = low[slot]
                .residual
                .iter()
                .zip(&high[slot].residual)
                .map(|(low, high)| (high - low) / (2.0 * step))
                .collect();
            let exact = linear[slot].by_parameter[parameter].clone().unwrap_or_else(|| vec![0.0; difference.len()]);
            let size = difference.iter().fold(1e-3_f64, |size, value| size.max(value.abs()));
            for (difference, exact) in difference.iter().zip(&exact) {
                let name = &system.effect_names()[parameter];
                assert!((difference - exact).abs() < 1e-6 * size, "{name}: {difference} {exact}");
            }
        }
    }
    for slot in 0..2 {
        for (lump, column) in rigid[slot].iter().enumerate() {
            let mut sum = vec![0.0; motion.len()];
            for (k, sum) in sum.iter_mut().enumerate() {
                let (q, dq, ddq) = (
                    [motion.q[0][k], motion.q[1][k]],
                    [motion.dq[0][k], motion.dq[1][k]],
                    [motion.ddq[0][k], motion.ddq[1][k]],
                );
                let mut unit = [0.0; 5];
                unit[lump] = 1.0;
                let mut tau = [0.0; 2];
                (ARM.inverse_dynamics)(&unit, &q, &dq, &ddq, &mut tau);
                *sum = tau[slot];
            }
            match column {
                Some(column) => {
                    for (a, b) in motion.filtered(&sum).iter().zip(column) {
                        assert!((a - b).abs() < 1e-9, "{a} {b}");
                    }
                }
                None => assert!(sum.iter().all(|value| *value == 0.0)),
            }
        }
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let (system, motion) = (arm(), Motion::of(&run()).expect("long enough"));
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| along(&system, &motion))
    };
    assert_eq!(with(1), with(3));
}

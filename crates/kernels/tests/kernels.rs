//! Kernels that are made at run time: against those that are compiled in, and against the plant.

#[path = "../../../codegen/equations/tests/robots/mod.rs"]
mod robots;
#[path = "../../../generated/tests/support/mod.rs"]
mod support;

use std::path::Path;

use dynid_generated::{Kernel, Lanes, N_SIGNALS};
use dynid_kernels::{KernelError, batch, kernel};
use dynid_model::{Device, device_named};
use dynid_plant::random::Noise;
use robots::{chain, random_robot_of};
use support::{Case, assert_matrix, assert_vector, cases_of, dot};

/// What two derivations may differ by, relative to the size of what they compute (see `support`, "sizes").
const TOLERANCE: f64 = 1e-12;

/// A shipped device, read as a user's file.
fn as_file(device: &Device) -> &'static Device {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../model/devices");
    device_named(&format!("{}.toml", device.id), &folder).unwrap()
}

/// The device of the library and the one of the file, and their kernels.
fn both() -> impl Iterator<Item = (&'static Device, &'static Kernel, &'static Kernel)> {
    dynid_model::devices().iter().flat_map(|shipped| {
        let own = as_file(shipped);
        let kernels = move |free: &Vec<usize>| (own, kernel(own, free).unwrap(), kernel(shipped, free).unwrap());
        shipped.configurations.iter().map(|known| &known.free).map(kernels)
    })
}

#[test]
fn what_ships_is_compiled_in_and_a_file_is_not() {
    for (own, made, compiled_in) in both() {
        assert!(dynid_generated::kernels().iter().any(|known| std::ptr::eq(*known, compiled_in)), "{}", own.id);
        assert!(!dynid_generated::kernels().iter().any(|known| std::ptr::eq(*known, made)), "{}", own.id);
        assert!(std::ptr::eq(made, kernel(own, made.free).unwrap()), "it is made once");
    }
}

#[test]
fn both_have_the_same_values() {
    for (own, made, compiled_in) in both() {
        assert_eq!(
            (made.free, made.locked, made.configuration),
            (compiled_in.free, compiled_in.locked, compiled_in.configuration)
        );
        for case in cases_of(own, made, Noise::new(3), 20) {
            let other = case.in_kernel(compiled_in);
            let torque_size = case.torque_size();
            let (d, expected_d) = (case.inertia(), other.inertia());
            assert_matrix(&d, &expected_d, &expected_d, TOLERANCE, || format!("D, {case}"));
            let (coriolis, expected) = (case.coriolis(), other.coriolis());
            assert_vector(&coriolis, &expected, &case.coriolis_size(), TOLERANCE, || format!("C, {case}"));
            let pairs = [
                ("phi", case.gravity(), other.gravity(), case.gravity_size()),
                ("h", case.bias(), other.bias(), case.bias_size()),
                ("tau", case.inverse_dynamics(&case.ddq), other.inverse_dynamics(&case.ddq), torque_size.clone()),
            ];
            for (name, made, compiled_in, size) in pairs {
                assert_vector(&made, &compiled_in, &size, TOLERANCE, || format!("{name}, {case}"));
            }
            let lumps = &case.prepared[..made.n_lumps];
            let tau: Vec<f64> = case.regressor().chunks(made.n_lumps).map(|row| dot(row, lumps)).collect();
            assert_vector(&tau, &other.inverse_dynamics(&case.ddq), &torque_size, TOLERANCE, || format!("Y, {case}"));
            let again = case.inverse_dynamics(&case.forward_dynamics(&tau));
            let size: Vec<f64> = again.iter().zip(&torque_size).map(|(a, b)| 1e3 * a.abs().max(*b)).collect();
            assert_vector(&again, &tau, &size, TOLERANCE, || format!("tau of ddq, {case}"));
            let (_, by_q, by_dq) = case.inverse_dynamics_gradient();
            let (_, expected_by_q, expected_by_dq) = other.inverse_dynamics_gradient();
            for (made, compiled_in) in [(by_q, expected_by_q), (by_dq, expected_by_dq)] {
                let largest = compiled_in.iter().chain(&torque_size).fold(0.0_f64, |size, entry| size.max(entry.abs()));
                let size = vec![largest; made.len()];
                assert_vector(&made, &compiled_in, &size, TOLERANCE, || format!("gradient, {case}"));
            }
        }
    }
}

/// By algebra for what ships, by moving every parameter for what is made.
#[test]
fn both_depend_on_the_same_parameters() {
    for (own, made, compiled_in) in both() {
        let sorted = |kernel: &Kernel| {
            let mut names = kernel.appearing.to_vec();
            names.sort_unstable();
            names
        };
        assert_eq!(sorted(made), sorted(compiled_in), "{} {:?}", own.id, made.free);
    }
}

#[test]
fn lanes_have_the_bits_of_numbers_alone() {
    for (own, made, _) in both() {
        let pair: Vec<Case> = cases_of(own, made, Noise::new(5), 2).collect();
        let join =
            |a: &[f64], b: &[f64]| -> Vec<Lanes> { a.iter().zip(b).map(|(&a, &b)| Lanes::new([a, b])).collect() };
        let lanes = |of: fn(&Case) -> &Vec<f64>| join(of(&pair[0]), of(&pair[1]));
        let (prepared, q) = (lanes(|case| &case.prepared), lanes(|case| &case.q));
        let (dq, ddq) = (lanes(|case| &case.dq), lanes(|case| &case.ddq));
        let n = made.free.len();
        let empty = |length: usize| vec![Lanes::new([f64::NAN; 2]); length];
        let (mut d, mut y) = (empty(n * n), empty(n * made.n_lumps));
        let (mut tau, mut by_q, mut by_dq) = (empty(n), empty(n * n), empty(n * n));
        made.functions.inertia_lanes(&prepared, &q, &mut d);
        made.functions.regressor_lanes(&prepared, &q, &dq, &ddq, &mut y);
        made.functions.inverse_dynamics_gradient_lanes(&prepared, &q, &dq, &ddq, &mut tau, &mut by_q, &mut by_dq);
        let alone: Vec<_> =
            pair.iter().map(|case| (case.inertia(), case.regressor(), case.inverse_dynamics_gradient())).collect();
        let gradients = || alone.iter().map(|of| &of.2).collect::<Vec<_>>();
        let (a, b) = (&alone[0], &alone[1]);
        assert_eq!(d, join(&a.0, &b.0), "{} {:?}", own.id, made.free);
        assert_eq!(y, join(&a.1, &b.1));
        assert_eq!(tau, join(&gradients()[0].0, &gradients()[1].0));
        assert_eq!(by_q, join(&gradients()[0].1, &gradients()[1].1));
        assert_eq!(by_dq, join(&gradients()[0].2, &gradients()[1].2));
    }
}

/// More states than one thread takes, and not a multiple of eight.
#[test]
fn a_batch_has_the_bits_of_one_state_after_the_other() {
    for (own, made, compiled_in) in both() {
        for kernel in [made, compiled_in] {
            let cases: Vec<Case> = cases_of(own, kernel, Noise::new(13), 21).collect();
            let rows =
                |of: fn(&Case) -> &Vec<f64>| cases.iter().flat_map(of).copied().collect::<Vec<f64>>().repeat(100);
            let (q, dq, tau) = (rows(|case| &case.q), rows(|case| &case.dq), rows(|case| &case.ddq));
            let prepared = &cases[0].prepared;
            let (mut batch, mut alone) = (vec![f64::NAN; q.len()], vec![f64::NAN; q.len()]);
            batch::forward_dynamics(kernel, prepared, [&q, &dq, &tau], &mut batch);
            let n = kernel.free.len();
            for (state, ddq) in alone.chunks_exact_mut(n).enumerate() {
                let of = |rows: &'_ [f64]| rows[state * n..(state + 1) * n].to_vec();
                kernel.functions.forward_dynamics(prepared, &of(&q), &of(&dq), &of(&tau), ddq);
            }
            assert_eq!(batch, alone, "{} {:?}", own.id, kernel.free);
        }
    }
}

#[test]
fn all_batches_have_the_bits_of_one_state_after_the_other() {
    for (own, made, compiled_in) in both() {
        for kernel in [made, compiled_in] {
            let n = kernel.free.len();
            let cases: Vec<Case> = cases_of(own, kernel, Noise::new(17), 1025).collect();
            let prepared = &cases[0].prepared;
            let rows = |of: fn(&Case) -> &Vec<f64>| cases.iter().flat_map(of).copied().collect::<Vec<f64>>();
            let (q, dq, ddq) = (rows(|case| &case.q), rows(|case| &case.dq), rows(|case| &case.ddq));
            let empty = |width: usize| vec![f64::NAN; cases.len() * n * width];
            let (mut d, mut phi, mut h, mut tau) = (empty(n), empty(1), empty(1), empty(1));
            let (mut tau_too, mut by_q, mut by_dq) = (empty(1), empty(n), empty(n));
            batch::inertia(kernel, prepared, &q, &mut d);
            batch::gravity(kernel, prepared, &q, &mut phi);
            batch::bias(kernel, prepared, [&q, &dq], &mut h);
            batch::inverse_dynamics(kernel, prepared, [&q, &dq, &ddq], &mut tau);
            let results = [&mut tau_too[..], &mut by_q, &mut by_dq];
            batch::inverse_dynamics_gradient(kernel, prepared, [&q, &dq, &ddq], results);
            for state in 0..cases.len() {
                let row = |rows: &[f64], width: usize| rows[state * n * width..(state + 1) * n * width].to_vec();
                let (q, dq, ddq) = (row(&q, 1), row(&dq, 1), row(&ddq, 1));
                let alone = |width: usize| vec![f64::NAN; n * width];
                let (mut own_d, mut own_phi, mut own_h) = (alone(n), alone(1), alone(1));
                kernel.functions.inertia(prepared, &q, &mut own_d);
                kernel.functions.gravity(prepared, &q, &mut own_phi);
                kernel.functions.bias(prepared, &q, &dq, &mut own_h);
                assert_eq!([row(&d, n), row(&phi, 1), row(&h, 1)], [own_d, own_phi, own_h], "{} {state}", own.id);
                let (mut own_tau, mut own_by_q, mut own_by_dq) = (alone(1), alone(n), alone(n));
                kernel.functions.inverse_dynamics(prepared, &q, &dq, &ddq, &mut own_tau);
                assert_eq!(row(&tau, 1), own_tau, "{} {state}", own.id);
                let results = (&mut own_tau, &mut own_by_q, &mut own_by_dq);
                kernel.functions.inverse_dynamics_gradient(prepared, &q, &dq, &ddq, results.0, results.1, results.2);
                assert_eq!([row(&tau_too, 1), row(&by_q, n), row(&by_dq, n)], [own_tau, own_by_q, own_by_dq]);
            }
        }
    }
}

/// Torque to acceleration and back again: the two Jacobians are each other's inverse, and differences of positions agree.
#[test]
fn derivatives_of_accelerations_undo_those_of_torques() {
    for (own, _, kernel) in both() {
        let n = kernel.free.len();
        for case in cases_of(own, kernel, Noise::new(19), 3) {
            let (prepared, mut ddq) = (&case.prepared, vec![f64::NAN; n]);
            let mut by = [(); 3].map(|()| vec![f64::NAN; n * n]);
            let [by_q, by_dq, by_tau] = &mut by;
            let given = [&case.q[..], &case.dq, &case.ddq];
            batch::forward_dynamics_gradient(kernel, prepared, given, [&mut ddq, by_q, by_dq, by_tau]);
            let unit = product(n, &case.inertia(), by_tau);
            for (place, entry) in unit.iter().enumerate() {
                let expected = f64::from(u8::from(place / n == place % n));
                assert!((entry - expected).abs() < 1e-7, "{}: {unit:?}", own.id);
            }
            for column in 0..n {
                const STEP: f64 = 1e-6;
                let moved = |which: usize, by: f64| {
                    let mut own = [case.q.clone(), case.dq.clone()];
                    own[which][column] += by;
                    let mut ddq = vec![f64::NAN; n];
                    kernel.functions.forward_dynamics(prepared, &own[0], &own[1], &case.ddq, &mut ddq);
                    ddq
                };
                for (which, by) in [&by[0], &by[1]].into_iter().enumerate() {
                    let (above, below) = (moved(which, STEP), moved(which, -STEP));
                    let size = ddq.iter().chain(by).fold(1.0_f64, |size, entry| size.max(entry.abs()));
                    for row in 0..n {
                        let expected = (above[row] - below[row]) / (2.0 * STEP);
                        let found = by[row * n + column];
                        assert!((found - expected).abs() < 1e-5 * size, "{}: {found} {expected}", own.id);
                    }
                }
            }
        }
    }
}

/// Of two n x n matrices.
fn product(n: usize, a: &[f64], b: &[f64]) -> Vec<f64> {
    let entry = |place: usize| (0..n).map(|k| a[place / n * n + k] * b[k * n + place % n]).sum();
    (0..n * n).map(entry).collect()
}

#[test]
fn derivatives_of_prepared_values_are_those_of_differences() {
    for (own, made, _) in both() {
        let case = cases_of(own, made, Noise::new(6), 1).next().unwrap();
        let n_parameters = case.parameters.len();
        let mut jacobian = vec![f64::NAN; made.prepared.len() * n_parameters];
        made.functions.prepare_gradient(&case.parameters, &case.locked, &mut jacobian);
        let largest = jacobian.iter().fold(1.0_f64, |size, entry| size.max(entry.abs()));
        for column in 0..n_parameters {
            let (above, below) = (case.prepared_with(column, 1e-6), case.prepared_with(column, -1e-6));
            for (row, (above, below)) in above.iter().zip(&below).enumerate() {
                let (found, expected) = (jacobian[row * n_parameters + column], (above - below) / 2e-6);
                assert!((found - expected).abs() <= 1e-7 * largest, "{}: {row} {column}: {found} {expected}", own.id);
            }
        }
    }
}

fn agrees_with_the_plant(device: &'static Device, free: &[usize], seed: u64) {
    for case in cases_of(device, kernel(device, free).unwrap(), Noise::new(seed), 3) {
        let (d, h) = case.plant_inertia_and_bias();
        assert_matrix(&case.inertia(), &d, &d, TOLERANCE, || format!("D, {case}"));
        assert_vector(&case.bias(), &h, &case.bias_size(), TOLERANCE, || format!("h, {case}"));
        let (tau, expected) = (case.inverse_dynamics(&case.ddq), case.plant_inverse_dynamics());
        assert_vector(&tau, &expected, &case.torque_size(), TOLERANCE, || format!("tau, {case}"));
    }
}

/// One to ten joints, revolute and prismatic, branches, every convention, also with some of them locked.
#[test]
fn of_random_robots_kernels_agree_with_the_plant() {
    for seed in 0..200 {
        let device: &'static Device = Box::leak(Box::new(random_robot_of(seed, 1 + seed as usize % 10, seed % 3 == 0)));
        let all: Vec<usize> = (0..device.joints.len()).collect();
        let every_other: Vec<usize> = all.iter().copied().step_by(2).collect();
        for free in [all, every_other] {
            agrees_with_the_plant(device, &free, seed);
        }
    }
}

/// So many locked joints that what they turn cannot be multiplied out: below the free ones, above and between them.
#[test]
fn many_joints_may_be_locked() {
    for at_right_angles in [false, true] {
        let device: &'static Device = Box::leak(Box::new(chain(16, at_right_angles)));
        for free in [vec![0], vec![8], vec![15], vec![2, 3, 14]] {
            agrees_with_the_plant(device, &free, 1);
        }
    }
}

/// Joints that are free together in no configuration of a device that ships.
#[test]
fn any_joints_may_be_free() {
    let device = dynid_model::device("freedom6s").unwrap();
    let made = kernel(device, &[1, 3]).unwrap();
    assert_eq!((made.configuration, made.free, made.locked), (None, &[1, 3][..], &[0, 2, 4, 5][..]));
    for case in cases_of(device, made, Noise::new(9), 20) {
        let (tau, expected) = (case.inverse_dynamics(&case.ddq), case.plant_inverse_dynamics());
        assert_vector(&tau, &expected, &case.torque_size(), TOLERANCE, || format!("tau, {case}"));
    }
    for wrong in [&[][..], &[3, 1], &[1, 1], &[6]] {
        let refused = kernel(device, wrong);
        assert!(matches!(refused, Err(KernelError::NoSuchJoints { .. })), "{wrong:?}: {refused:?}");
    }
}

#[test]
fn effects_have_the_bits_of_those_compiled_in() {
    for shipped in dynid_model::effects() {
        let made = dynid_kernels::effect(Box::leak(Box::new(shipped.clone()))).unwrap();
        let compiled_in = dynid_kernels::effect(shipped).unwrap();
        let mut noise = Noise::new(11);
        for _ in 0..20 {
            let mut draw = |count: usize| -> Vec<f64> { (0..count).map(|_| 0.2 + noise.uniform()).collect() };
            let (parameters, signals, states) = (draw(made.n_parameters), draw(N_SIGNALS), draw(made.n_states));
            let value = |kernel: &dynid_generated::EffectKernel| {
                let n_rows = kernel.n_outputs + kernel.n_states;
                let mut jacobian = vec![f64::NAN; n_rows * (parameters.len() + N_SIGNALS + states.len())];
                let (mut outputs, mut rates) = (vec![f64::NAN; kernel.n_outputs], vec![f64::NAN; kernel.n_states]);
                kernel.functions.eval(&parameters, &signals, &states, &mut outputs, &mut rates);
                let alone = (outputs.clone(), rates.clone());
                kernel.functions.eval_gradient(&parameters, &signals, &states, &mut outputs, &mut rates, &mut jacobian);
                (alone, outputs, rates, jacobian)
            };
            assert_eq!(value(made), value(compiled_in), "{}", shipped.id);
        }
    }
}

#[test]
fn end_points_have_the_values_of_those_compiled_in() {
    for shipped in dynid_model::devices() {
        let (made, compiled_in) =
            (dynid_kernels::end_point(as_file(shipped)).unwrap(), dynid_kernels::end_point(shipped).unwrap());
        assert_eq!(made.is_some(), compiled_in.is_some(), "{}", shipped.id);
        let (Some(made), Some(compiled_in)) = (made, compiled_in) else { continue };
        assert_eq!(
            (made.frame, made.n_joints, made.parameters),
            (compiled_in.frame, compiled_in.n_joints, compiled_in.parameters)
        );
        let q: Vec<f64> = (0..made.n_joints).map(|joint| 0.3 * joint as f64 - 0.5).collect();
        let lengths: Vec<f64> = shipped.lengths.iter().map(|length| length.value).collect();
        let place = |end_point: &dynid_generated::EndPoint| {
            let (mut position, mut rotation, mut jacobian) = ([0.0; 3], [0.0; 9], vec![0.0; 6 * end_point.n_joints]);
            end_point.functions.motion(&lengths, &q, &mut position, &mut rotation, &mut jacobian);
            (position, rotation, jacobian)
        };
        assert_eq!(place(made), place(compiled_in), "{}", shipped.id);
    }
}

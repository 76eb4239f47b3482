//! Every kernel of every device meets a second derivation: the numeric plant, which shares no code with `codegen`.

mod support;

use dynid_generated::{Eight, Width, kernels};
use dynid_plant::random::Noise;
use support::{Case, STATES, assert_matrix, assert_vector, cases, dot, equations, input_value};

/// What two derivations may differ by, relative to the size of what they compute (see `support`, "sizes").
const TOLERANCE: f64 = 1e-12;

#[test]
fn every_configuration_has_a_kernel() {
    let expected: Vec<(&str, usize, &[usize])> = dynid_model::devices()
        .iter()
        .flat_map(|device| {
            let configurations = device.configurations.iter().enumerate();
            configurations.map(|(index, configuration)| (device.id.as_str(), index + 1, configuration.free.as_slice()))
        })
        .collect();
    let found: Vec<(&str, usize, &[usize])> =
        kernels().iter().map(|kernel| (kernel.device, kernel.configuration.unwrap_or_default(), kernel.free)).collect();
    assert_eq!(found, expected);
}

/// A parameter appears in the equations of a configuration exactly where the plant's torque changes with it.
#[test]
fn a_kernel_says_which_parameters_the_torque_depends_on() {
    for kernel in kernels() {
        let device = dynid_model::device(kernel.device).unwrap();
        let cases: Vec<Case> = cases(kernel, Noise::new(19), 3).collect();
        for number in 1..=device.links.len() {
            for symbol in dynid_model::Link::SYMBOLS {
                let name = format!("link.{number}.{symbol}");
                let matters = cases.iter().any(|case| {
                    let moved = case.plant_inverse_dynamics_with(&name, 0.01);
                    let pairs = moved.into_iter().zip(case.plant_inverse_dynamics()).zip(case.torque_size());
                    pairs.into_iter().any(|((moved, torque), size)| (moved - torque).abs() > 1e-10 * size)
                });
                let appears = kernel.appearing.contains(&name.as_str());
                assert_eq!(appears, matters, "{name}, {} {:?}", kernel.device, kernel.free);
                assert!(!appears || kernel.parameters.contains(&name.as_str()), "`prepare` takes {name}");
            }
        }
    }
}

#[test]
fn kernels_match_the_plant() {
    for kernel in kernels() {
        for case in cases(kernel, Noise::new(7), STATES) {
            let (d, h) = case.plant_inertia_and_bias();
            assert_matrix(&case.inertia(), &d, &d, TOLERANCE, || format!("D, {case}"));
            assert_vector(&case.gravity(), &case.plant_gravity(), &case.gravity_size(), TOLERANCE, || {
                format!("phi, {case}")
            });
            assert_vector(&case.bias(), &h, &case.bias_size(), TOLERANCE, || format!("h, {case}"));
            assert_vector(
                &case.inverse_dynamics(&case.ddq),
                &case.plant_inverse_dynamics(),
                &case.torque_size(),
                TOLERANCE,
                || format!("tau, {case}"),
            );

            let (d_too, h_too) = case.inertia_and_bias();
            assert_matrix(&d_too, &d, &d, TOLERANCE, || format!("D of D and h, {case}"));
            assert_vector(&h_too, &h, &case.bias_size(), TOLERANCE, || format!("h of D and h, {case}"));
        }
    }
}

#[test]
fn coriolis_matrix_matches_the_plant() {
    for kernel in kernels() {
        // The plant's polarisation is slow: fewer states here, all of them for C dq.
        for case in cases(kernel, Noise::new(8), STATES / 20) {
            let expected = case.plant_coriolis();
            assert_vector(&case.coriolis(), &expected, &case.coriolis_size(), TOLERANCE, || format!("C, {case}"));
        }
        for case in cases(kernel, Noise::new(9), STATES) {
            let moving: Vec<f64> = case.coriolis().chunks(kernel.free.len()).map(|row| dot(row, &case.dq)).collect();
            let (_, h) = case.plant_inertia_and_bias();
            let sum: Vec<f64> = moving.iter().zip(case.plant_gravity()).map(|(c, phi)| c + phi).collect();
            assert_vector(&sum, &h, &case.bias_size(), TOLERANCE, || format!("C dq + phi, {case}"));
        }
    }
}

/// The accelerations are those for which the plant asks the same torques.
#[test]
fn forward_dynamics_undoes_the_plant() {
    for kernel in kernels() {
        for case in cases(kernel, Noise::new(10), STATES) {
            let tau = case.plant_inverse_dynamics();
            let ddq = case.forward_dynamics(&tau);
            let (d, h) = case.plant_inertia_and_bias();
            let n = kernel.free.len();
            for row in 0..n {
                let inertial: Vec<f64> = (0..n).map(|column| d[row * n + column] * ddq[column]).collect();
                let residual = inertial.iter().sum::<f64>() + h[row] - tau[row];
                let size = inertial.iter().map(|term| term.abs()).sum::<f64>() + h[row].abs() + tau[row].abs();
                assert!(residual.abs() <= TOLERANCE * size, "ddq, {case}: {residual:e} of {size:e}");
            }
        }
    }
}

#[test]
fn inertia_matrix_is_symmetric_and_positive_definite() {
    for kernel in kernels() {
        for case in cases(kernel, Noise::new(11), STATES) {
            let n = kernel.free.len();
            let d = nalgebra::DMatrix::from_row_slice(n, n, &case.inertia());
            assert_eq!(d, d.transpose(), "{case}");
            assert!(d.cholesky().is_some(), "{case}");
        }
    }
}

/// `dD/dt - 2 C` is skew-symmetric, that is `dD/dt = C + C^T`; `dD/dt` by differences of the plant's D.
#[test]
fn rate_of_inertia_is_twice_the_symmetric_part_of_coriolis() {
    for kernel in kernels() {
        for case in cases(kernel, Noise::new(12), STATES / 10) {
            let n = kernel.free.len();
            let (rate, c, size) = (case.plant_rate_of_inertia(), case.coriolis(), case.coriolis_size());
            for row in 0..n {
                for column in 0..n {
                    let (rate, symmetric) = (rate[row * n + column], c[row * n + column] + c[column * n + row]);
                    assert!(
                        (rate - symmetric).abs() <= 1e-7 * size[row * n + column],
                        "({row}, {column}) of {case}: {rate:e} {symmetric:e}"
                    );
                }
            }
        }
    }
}

/// Where a device has a configuration with every joint free, every other one is a part of it.
#[test]
fn subset_equations_are_the_full_ones_with_locked_joints_still() {
    for kernel in kernels() {
        let full = kernels().iter().find(|full| full.device == kernel.device && full.locked.is_empty());
        let Some(full) = full.filter(|full| full.configuration != kernel.configuration) else { continue };
        for case in cases(kernel, Noise::new(13), STATES / 10) {
            let whole = case.in_kernel(full);
            let (d, h) = whole.inertia_and_bias();
            let rows = kernel.free;
            let n = full.free.len();
            let part: Vec<f64> =
                rows.iter().flat_map(|i| rows.iter().map(|j| d[i * n + j]).collect::<Vec<_>>()).collect();
            assert_matrix(&case.inertia(), &part, &part, TOLERANCE, || format!("D, {case}"));
            let part: Vec<f64> = rows.iter().map(|i| h[*i]).collect();
            assert_vector(&case.bias(), &part, &case.bias_size(), TOLERANCE, || format!("h, {case}"));
        }
    }
}

#[test]
fn regressor_times_lumps_is_the_torque() {
    for kernel in kernels() {
        for case in cases(kernel, Noise::new(14), STATES) {
            let lumps = &case.prepared[..kernel.n_lumps];
            let tau: Vec<f64> = case.regressor().chunks(kernel.n_lumps).map(|row| dot(row, lumps)).collect();
            assert_vector(&tau, &case.plant_inverse_dynamics(), &case.torque_size(), TOLERANCE, || {
                format!("Y lumps, {case}")
            });
        }
    }
}

#[test]
fn gradient_matches_central_differences_of_the_plant() {
    for kernel in kernels() {
        for case in cases(kernel, Noise::new(15), STATES / 20) {
            let (tau, by_q, by_dq) = case.inverse_dynamics_gradient();
            assert_vector(&tau, &case.plant_inverse_dynamics(), &case.torque_size(), TOLERANCE, || {
                format!("tau, {case}")
            });
            let n = kernel.free.len();
            let step = 1e-6;
            for (name, jacobian, shift) in [
                ("q", by_q, (|case, joint, by| Case::shifted_q(case, joint, by)) as fn(&Case, usize, f64) -> Case),
                ("dq", by_dq, |case, joint, by| Case::shifted_dq(case, joint, by)),
            ] {
                let size = tau.iter().chain(&jacobian).fold(0.0f64, |size, entry| size.max(entry.abs()));
                for joint in 0..n {
                    let above = shift(&case, joint, step).plant_inverse_dynamics();
                    let below = shift(&case, joint, -step).plant_inverse_dynamics();
                    for row in 0..n {
                        let difference = (above[row] - below[row]) / (2.0 * step);
                        let error = (jacobian[row * n + joint] - difference).abs();
                        assert!(error <= 1e-7 * size, "d tau{row} / d {name}{joint}, {case}: {error:e} of {size:e}");
                    }
                }
            }
        }
    }
}

#[test]
fn gradient_of_prepare_matches_central_differences() {
    for kernel in kernels() {
        let case = cases(kernel, Noise::new(16), 1).next().unwrap();
        let n_parameters = kernel.parameters.len();
        let mut jacobian = vec![f64::NAN; kernel.prepared.len() * n_parameters];
        kernel.functions.prepare_gradient(&case.parameters, &case.locked, &mut jacobian);
        for column in 0..n_parameters {
            let step = 1e-6;
            let (below, above) = (case.prepared_with(column, -step), case.prepared_with(column, step));
            for row in 0..kernel.prepared.len() {
                let difference = (above[row] - below[row]) / (2.0 * step);
                let error = (jacobian[row * n_parameters + column] - difference).abs();
                assert!(
                    error <= 1e-7 * (1.0 + difference.abs()),
                    "{} by {}",
                    kernel.prepared[row],
                    kernel.parameters[column]
                );
            }
        }
    }
}

/// The emitted Rust computes what the text says: the interpreter reads the same `.kir`.
#[test]
fn compiled_kernels_match_the_interpreter() {
    for kernel in kernels() {
        let program = equations(kernel).program;
        for case in cases(kernel, Noise::new(17), STATES / 10) {
            let values = program.evaluate(|input| input_value(&case, input));
            let at = |name: String| values[program.outputs().iter().position(|(known, _)| *known == name).unwrap()];
            let vector = |prefix: &str| kernel.free.iter().map(|i| at(format!("{prefix}_{i}"))).collect::<Vec<f64>>();
            let d: Vec<f64> = kernel
                .free
                .iter()
                .flat_map(|&i| kernel.free.iter().map(move |&j| (i.min(j), i.max(j))))
                .map(|(i, j)| at(format!("D_{i}_{j}")))
                .collect();
            assert_matrix(&case.inertia(), &d, &d, 1e-13, || format!("D, {case}"));
            assert_vector(&case.bias(), &vector("h"), &case.bias_size(), 1e-13, || format!("h, {case}"));
            assert_vector(&case.inverse_dynamics(&case.ddq), &vector("tau"), &case.torque_size(), 1e-13, || {
                format!("tau, {case}")
            });
        }
    }
}

/// Without friction and torque, kinetic and potential energy only change places.
#[test]
fn energy_is_kept() {
    for kernel in kernels() {
        for case in cases(kernel, Noise::new(18), 3) {
            let (before, swing) = case.energy();
            let after = case.swung_freely(0.2, 2_000).energy().0;
            let change = (after - before).abs() / swing;
            assert!(change <= 1e-10, "{case}: energy changes by {change:e} of its size");
        }
    }
}

/// Forward dynamics has the same bits alone and among eight, whatever the processor's registers hold.
#[test]
fn eight_states_have_the_bits_of_each_alone() {
    for kernel in kernels() {
        let mut cases: Vec<Case> = cases(kernel, Noise::new(12), 64).collect();
        // Beyond what the fast reduction of an angle holds for, and nowhere.
        cases[9].q[0] = 3e8;
        cases[17].q[0] = f64::NAN;
        for eight in cases.chunks(8) {
            let prepared = &eight[0].prepared;
            let rows = |of: fn(&Case) -> &[f64]| -> Vec<Eight> {
                (0..kernel.free.len()).map(|slot| std::array::from_fn(|lane| of(&eight[lane])[slot])).collect()
            };
            let states = [rows(|case| &case.q), rows(|case| &case.dq), rows(|case| &case.ddq)].concat();
            let given = [prepared.iter().map(|value| [*value; 8]).collect(), states].concat();
            for width in Width::all() {
                let mut ddq = vec![[0.0; 8]; kernel.free.len()];
                kernel.functions.forward_dynamics_of_eight(width, &given, &mut ddq);
                for (lane, case) in eight.iter().enumerate() {
                    let mut alone = vec![0.0; kernel.free.len()];
                    kernel.functions.forward_dynamics(prepared, &case.q, &case.dq, &case.ddq, &mut alone);
                    for (row, alone) in ddq.iter().zip(alone) {
                        let is_same = row[lane].to_bits() == alone.to_bits() || (row[lane].is_nan() && alone.is_nan());
                        assert!(is_same, "{width:?}, lane {lane}, {case}: {} for {alone}", row[lane]);
                    }
                }
            }
        }
    }
}

use std::f64::consts::PI;

use proptest::prelude::*;

use super::*;
use dynid_dynamics::{
    simulate::Intersample, system::PlacedEffect, system::fixtures::ARM, system::fixtures::GAIN,
    system::fixtures::PENDULUM, system::fixtures::ROTOR_INERTIA, system::fixtures::VISCOUS, system::fixtures::placed,
};
use dynid_logs::{experiment::Role, experiment::Run, experiment::Settings, log::Log};
use dynid_random::Random;

const ITERATIONS: usize = 60;

/// Mass, centroid along x and moment of inertia about z of the arm's links.
const LINKS: [[f64; 3]; 2] = [[1.2, 0.21, 0.02], [0.8, 0.17, 0.011]];

/// A parameter within wide bounds.
fn wide(value: f64) -> Parameter {
    Parameter { value, lower: -1e3, upper: 1e3, fixed: false }
}

/// All ten parameters of a link that has mass, centroid along x and three equal moments of inertia.
fn link(number: usize, [m, x, izz]: [f64; 3], of: impl Fn(&str, f64) -> Parameter) -> Vec<(String, Parameter)> {
    let values = [m, x, 0.0, 0.0, izz, 0.0, 0.0, izz, 0.0, izz];
    let named = Link::SYMBOLS.iter().zip(values);
    named.map(|(symbol, value)| (format!("link.{number}.{symbol}"), of(symbol, value))).collect()
}

fn effect_parameters(effects: &[PlacedEffect], of: impl Fn(f64) -> Parameter) -> Vec<(String, Parameter)> {
    let named = effects.iter().flat_map(|effect| effect.names.iter().zip(&effect.parameters));
    named.map(|(name, value)| (name.clone(), of(*value))).collect()
}

/// A log of a given system that moves as wished: torques from its own equations, with white noise.
fn play(system: &System, torque_noise: f64, seed: u64) -> TorqueRun {
    let n = system.n_free();
    let mut noise = Random::new(seed);
    let n_samples = 3000;
    let step = 0.01;
    let waves: [[(f64, f64, f64); 3]; 2] = [
        [(0.7, 0.21, 0.3), (0.3, 0.67, 1.0), (0.1, 1.31, 2.0)],
        [(0.9, 0.29, 1.3), (0.25, 0.83, 0.2), (0.1, 1.57, 0.9)],
    ];
    let mut log = Log {
        t: (0..n_samples).map(|k| step * k as f64).collect(),
        tau: vec![Vec::new(); n],
        q: vec![Vec::new(); n],
        reference: None,
        mask: None,
        left_out: Vec::new(),
    };
    for k in 0..n_samples {
        let t = log.t[k];
        let derivative = |order: usize| -> Vec<f64> {
            let wave = |&(size, hertz, phase): &(f64, f64, f64)| {
                let w = 2.0 * PI * hertz;
                size * w.powi(order as i32) * (w * t + phase + 0.5 * PI * order as f64).sin()
            };
            waves[..n].iter().map(|waves| waves.iter().map(wave).sum()).collect()
        };
        let (q, dq, ddq) = (derivative(0), derivative(1), derivative(2));
        let mut tau = vec![0.0; n];
        system.kernel().functions.inverse_dynamics(system.prepared(), &q, &dq, &ddq, &mut tau);
        for (parameter, name) in system.effect_parameters().iter().zip(system.effect_names()) {
            let joint: usize = name.split('.').nth(1).and_then(|joint| joint.parse().ok()).expect("joint.<i>.");
            match name.split('.').nth(2).expect("joint.<i>.<effect>") {
                "viscous" => tau[joint] += parameter * dq[joint],
                "rotor_inertia" => tau[joint] += parameter * ddq[joint],
                _ => {}
            }
        }
        for (parameter, name) in system.effect_parameters().iter().zip(system.effect_names()) {
            if name.ends_with(".gain.Kp") {
                let joint: usize = name.split('.').nth(1).and_then(|joint| joint.parse().ok()).expect("joint.<i>.");
                tau[joint] /= parameter;
            }
        }
        for joint in 0..n {
            log.tau[joint].push(tau[joint] + torque_noise * noise.normal());
            log.q[joint].push(q[joint]);
        }
    }
    let settings = Settings {
        cutoff_hz: Some(8.0),
        decimate: 1,
        min_speed: vec![0.0; n],
        intersample: Intersample::FirstOrder,
        ..Settings::default()
    };
    let run = Run {
        file: "made.csv".to_owned(),
        role: Role::Fit,
        free: (0..n).collect(),
        payload: None,
        configuration: 1,
        log,
        settings,
    };
    let motion = Motion::of(&run).expect("long enough");
    TorqueRun { name: run.file.clone(), role: Role::Fit, system: system.clone(), motion }
}

fn arm_effects() -> Vec<PlacedEffect> {
    vec![
        placed(&VISCOUS, 0, None, &[0.3]),
        placed(&VISCOUS, 1, None, &[0.2]),
        placed(&ROTOR_INERTIA, 1, None, &[0.004]),
    ]
}

fn arm() -> System {
    System::new(&ARM, 2, LINKS.concat(), Vec::new(), &arm_effects()).expect("the arm is complete")
}

/// Start values: all off by a third, all free.
fn arm_start() -> Vec<(String, Parameter)> {
    let off = |_: &str, value: f64| wide(1.3 * value);
    let mut start = link(1, LINKS[0], off);
    start.extend(link(2, LINKS[1], off));
    start.extend(effect_parameters(&arm_effects(), |value| wide(0.7 * value)));
    start
}

fn value(fit: &TorqueFit, name: &str) -> f64 {
    fit.parameters.iter().find(|parameter| parameter.name == name).map_or(f64::NAN, |parameter| parameter.value)
}

/// The kernel's lumps at a fit's values.
fn lumps(fit: &TorqueFit) -> Vec<f64> {
    let inputs: Vec<f64> = ARM.parameters.iter().map(|name| value(fit, name)).collect();
    let mut lumps = vec![0.0; 5];
    ARM.functions.prepare(&inputs, &[], &mut lumps);
    lumps
}

#[test]
fn without_noise_the_base_parameters_are_found() {
    let run = play(&arm(), 0.0, 1);
    let fit = fit(&[run], &arm_start(), &[], ITERATIONS, &mut |_, _| {}).expect("there is data");
    assert_eq!(fit.status, FitStatus::NotIdentifiable);
    // Five lumps of which two are proportional (L1 m2 x2 and m2 x2), two viscous parameters, the rotor's inertia.
    assert_eq!(fit.rank, 7);
    for (found, expected) in lumps(&fit).iter().zip(arm().prepared()) {
        assert!((found / expected - 1.0).abs() < 2e-4, "{found} {expected}");
    }
    for (name, expected) in
        [("joint.0.viscous.Fv", 0.3), ("joint.1.viscous.Fv", 0.2), ("joint.1.rotor_inertia.Ia", 0.004)]
    {
        assert!((value(&fit, name) / expected - 1.0).abs() < 5e-3, "{name} {}", value(&fit, name));
        assert!(fit.parameters.iter().any(|parameter| parameter.name == name && parameter.identifiable));
    }
    assert!(fit.cost_after < fit.cost_before);
}

#[test]
fn what_is_not_identifiable_is_named_and_keeps_its_start() {
    let run = play(&arm(), 0.01, 2);
    let start = arm_start();
    let fit = fit(&[run], &start, &[], ITERATIONS, &mut |_, _| {}).expect("there is data");
    // Mass and moment of link 1 act only in combinations; of link 2's mass, centroid and moment two lumps and, through
    // the first link's, a third.
    let flat: Vec<&str> = fit.parameters.iter().filter(|p| !p.identifiable).map(|p| p.name.as_str()).collect();
    for name in ["link.1.m", "link.1.x", "link.1.Izz", "link.1.Ixx"] {
        assert!(flat.contains(&name), "{name} in {flat:?}");
    }
    assert!(!fit.flat.is_empty());
    for (name, parameter) in &start {
        if ["Ixx", "Ixy", "Ixz", "Iyy", "Iyz"].iter().any(|symbol| name.ends_with(symbol)) {
            let found = value(&fit, name);
            assert!((found - parameter.value).abs() < 1e-3 * 0.02, "{name} moved to {found}");
        }
    }
    assert!(fit.parameters.iter().all(|parameter| parameter.identifiable == parameter.std_error.is_some()));
}

/// Of many noisy logs, about 95 % of the estimates lie within two standard errors.
#[test]
fn standard_errors_are_honest() {
    let system = arm();
    let names = ["joint.0.viscous.Fv", "joint.1.viscous.Fv", "joint.1.rotor_inertia.Ia"];
    let (mut inside, mut total) = (0, 0);
    for seed in 0..40 {
        let fit = fit(&[play(&system, 0.05, 100 + seed)], &arm_start(), &[], ITERATIONS, &mut |_, _| {})
            .expect("there is data");
        for (name, expected) in names.iter().zip([0.3, 0.2, 0.004]) {
            let parameter = fit.parameters.iter().find(|parameter| parameter.name == *name).expect("is fitted");
            let error = (parameter.value - expected) / parameter.std_error.expect("is identifiable");
            inside += usize::from(error.abs() < 2.0);
            total += 1;
        }
    }
    let share = f64::from(inside as u32) / f64::from(total);
    assert!((0.88..=1.0).contains(&share), "{inside} of {total}");
}

fn pendulum(mass: Parameter, centroid: Parameter) -> (System, Vec<(String, Parameter)>) {
    let effects =
        [placed(&GAIN, 0, None, &[0.1]), placed(&VISCOUS, 0, None, &[0.04]), placed(&ROTOR_INERTIA, 0, None, &[0.002])];
    let system = System::new(&PENDULUM, 1, vec![0.49, 0.1, 0.0], Vec::new(), &effects).expect("complete");
    let fixed = |value: f64| Parameter { fixed: true, ..wide(value) };
    let mut start = link(1, [0.49, 0.1, 0.0], |symbol, value| match symbol {
        "m" => mass,
        "x" => centroid,
        _ => fixed(value),
    });
    start.extend(effect_parameters(&effects, |value| Parameter { lower: 0.0, ..wide(1.5 * value) }));
    (system, start)
}

#[test]
fn a_known_weight_makes_the_gain_identifiable() {
    let fixed = |value: f64| Parameter { fixed: true, ..wide(value) };
    let (system, start) = pendulum(fixed(0.49), fixed(0.1));
    let fit = fit(&[play(&system, 1e-3, 3)], &start, &[], ITERATIONS, &mut |_, _| {}).expect("there is data");
    assert_eq!((fit.status, fit.rank, fit.parameters.len()), (FitStatus::Converged, 3, 3));
    for (parameter, expected) in fit.parameters.iter().zip([0.1, 0.04, 0.002]) {
        let error = parameter.std_error.expect("is identifiable");
        assert!((parameter.value - expected).abs() < 4.0 * error + 1e-3 * expected, "{parameter:?}");
        assert!(error < 0.05 * expected, "{parameter:?}");
    }
}

#[test]
fn an_unknown_weight_leaves_the_scale_open() {
    let fixed = |value: f64| Parameter { fixed: true, ..wide(value) };
    let (system, start) = pendulum(wide(0.49), fixed(0.1));
    let fit = fit(&[play(&system, 1e-3, 4)], &start, &[], ITERATIONS, &mut |_, _| {}).expect("there is data");
    assert_eq!((fit.status, fit.rank), (FitStatus::NotIdentifiable, 3));
    assert_eq!(fit.flat.len(), 1);
    let names: Vec<&str> = fit.flat[0].iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["link.1.m", "joint.0.gain.Kp", "joint.0.viscous.Fv", "joint.0.rotor_inertia.Ia"]);
    // Along it everything grows in proportion.
    let ratio = |name: &str, entry: usize| fit.flat[0][entry].1 / value(&fit, name);
    let first = ratio("link.1.m", 0);
    for (entry, name) in names.iter().enumerate().take(3) {
        assert!((ratio(name, entry) / first - 1.0).abs() < 0.02, "{name}");
    }
}

#[test]
fn a_bound_that_holds_is_said() {
    let mut start = arm_start();
    let (_, viscous) = start.iter_mut().find(|(name, _)| name == "joint.1.viscous.Fv").expect("is there");
    *viscous = Parameter { value: 0.1, lower: 0.0, upper: 0.15, fixed: false };
    let fit = fit(&[play(&arm(), 0.01, 5)], &start, &[], ITERATIONS, &mut |_, _| {}).expect("there is data");
    assert_eq!(fit.status, FitStatus::HeldByBound);
    let parameter = fit.parameters.iter().find(|p| p.name == "joint.1.viscous.Fv").expect("is fitted");
    assert!(parameter.held && (parameter.value - 0.15).abs() < 1e-6, "{parameter:?}");
    assert_eq!(parameter.std_error, None);
}

/// A start that breaks an order is mended; an order that the truth breaks holds the two together, between what each would be alone.
#[test]
fn one_parameter_stays_above_another() {
    let mut start = arm_start();
    for (name, parameter) in &mut start {
        match name.as_str() {
            "joint.0.viscous.Fv" => *parameter = Parameter { value: 0.1, lower: 0.0, upper: 1.0, fixed: false },
            "joint.1.viscous.Fv" => *parameter = Parameter { value: 0.4, lower: 0.0, upper: 1.0, fixed: false },
            _ => {}
        }
    }
    let run = play(&arm(), 0.01, 5);
    let [first, second] = ["joint.0.viscous.Fv", "joint.1.viscous.Fv"].map(str::to_owned);
    let fitted = |order: (&String, &String)| {
        let orders = [(order.0.clone(), order.1.clone())];
        fit(std::slice::from_ref(&run), &start, &orders, ITERATIONS, &mut |_, _| {}).expect("there is data")
    };
    let found = fitted((&first, &second));
    let (one, two) = (value(&found, &first), value(&found, &second));
    assert!((one - 0.3).abs() < 0.02 && (two - 0.2).abs() < 0.02, "{one} {two}");
    let held = fitted((&second, &first));
    let (one, two) = (value(&held, &first), value(&held, &second));
    assert!(two >= one && two - one < 1e-3 && one > 0.18 && one < 0.32, "{one} {two}");
}

/// The second moment of `I = diag(1, 1, 2 (1 - e))` is `diag(1 - e, 1 - e, e)`; it is singular to within a millionth of the trace of 4.
#[test]
fn a_flat_body_is_at_its_physical_limit() {
    let body = |e: f64| [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 2.0 * (1.0 - e)];
    assert!(at_limit(&body(0.0)) && at_limit(&body(3e-6)));
    assert!(!at_limit(&body(5e-6)) && !at_limit(&body(0.5)));
}

/// The slopes of what a step minimises, its prior and its hold included, are those of its value.
#[test]
fn a_step_goes_down_the_slope_of_what_it_minimises() {
    let run = play(&arm(), 0.01, 4);
    let layout = Layout::new(&[&run], &arm_start()).expect("a layout");
    let rigid = [rigid_columns(&run.system, &run.motion)];
    let data = Data::new(&layout, &[&run], &rigid, &layout.start, false);
    let layout = layout.touched(&data);
    let from: Vec<f64> = layout.start.iter().map(|x| 1.1 * x + 0.01).collect();
    let weighted = Weighted::new(&layout, &data, &data.deviations(), &from, 0.1);
    let x: Vec<f64> = layout.start.iter().enumerate().map(|(k, x)| x + 0.003 * (k as f64 + 1.0)).collect();
    let Quadratic { cost, gradient, hessian } = weighted.expand(&x);
    assert_eq!(cost, weighted.value(&x));
    for k in 0..x.len() {
        let at = |step: f64| {
            let mut x = x.clone();
            x[k] += step;
            weighted.expand(&x)
        };
        let step = 1e-5 * layout.scale[k];
        let (high, low) = (at(step), at(-step));
        let off = ((high.cost - low.cost) / (2.0 * step) - gradient[k]).abs();
        assert!(off < 1e-5 * gradient[k].abs().max(1e-3 * hessian[(k, k)] * layout.scale[k]), "{k}: off by {off}");
    }
}

/// Those pairs are told whose estimates are hardly told apart.
#[test]
fn strong_correlations_are_named() {
    let names = ["a", "b", "c"].map(str::to_owned);
    let correlation = DMatrix::from_row_slice(3, 3, &[1.0, 0.94, -0.97, 0.94, 1.0, 0.96, -0.97, 0.96, 1.0]);
    let standing = Standing {
        rank: 3,
        condition: 1.0,
        identifiable: vec![true; 3],
        std_error: vec![Some(1.0); 3],
        correlation,
        flat: vec![vec![0.0, 1.0, -0.5]],
    };
    let pair = |one: &str, other: &str, correlation: f64| (one.to_owned(), other.to_owned(), correlation);
    assert_eq!(correlated(&standing, &names), [pair("a", "c", -0.97), pair("b", "c", 0.96)]);
    assert_eq!(named(&standing, &names), [[("b".to_owned(), 1.0), ("c".to_owned(), -0.5)]]);
}

#[test]
fn what_cannot_be_fitted_is_said() {
    let mut progress = |_: usize, _: f64| {};
    let start = arm_start();
    let run = play(&arm(), 0.01, 6);
    let validate = TorqueRun { role: Role::Validate, ..run.clone() };
    insta::assert_snapshot!(fit(&[validate], &start, &[], ITERATIONS, &mut progress).expect_err("no run"), @r#"the experiment has no run with role = "fit"; give one that role"#);
    let fixed: Vec<_> = start.iter().map(|(name, p)| (name.clone(), Parameter { fixed: true, ..*p })).collect();
    insta::assert_snapshot!(fit(std::slice::from_ref(&run), &fixed, &[], ITERATIONS, &mut progress).expect_err("all fixed"), @"no parameter of the model can be moved by these runs: all are fixed or act on other joints; free one (remove fixed = true) or add an effect");
    insta::assert_snapshot!(fit(std::slice::from_ref(&run), &start[1..], &[], ITERATIONS, &mut progress).expect_err("incomplete"), @"the equations need `link.1.m`, which the model does not give; add it to the model's values");
    let mut still = run.clone();
    still.motion.used[1].fill(false);
    insta::assert_snapshot!(fit(&[still], &start, &[], ITERATIONS, &mut progress).expect_err("no samples"), @"made.csv: no sample of joint 1 counts: min_speed, mask and the filter's edges leave none; lower min_speed or lengthen the log");
    let mut flat = start.clone();
    for (name, parameter) in &mut flat {
        if name.ends_with("xx") || name.ends_with("yy") {
            *parameter = Parameter { value: 0.0, fixed: true, ..*parameter };
        }
    }
    insta::assert_snapshot!(fit(&[run], &flat, &[], ITERATIONS, &mut progress).expect_err("no body"), @"link 1: its fixed moments of inertia and its bounds leave no body that could exist; free them (fixed = false) or widen the bounds");
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let runs = [play(&arm(), 0.02, 7), play(&arm(), 0.02, 8)];
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| fit(&runs, &arm_start(), &[], ITERATIONS, &mut |_, _| {}).expect("there is data"))
    };
    assert_eq!(with(1).parameters, with(4).parameters);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Whatever the noise, however wrong the start and tight the bounds: every link is a body, every value in bounds.
    #[test]
    fn results_are_physical_and_within_bounds(seed in 0..1000_u64, noise in 0.0..3.0_f64, off in 0.3..2.5_f64, room in 0.05..3.0_f64) {
        let run = play(&arm(), noise, seed);
        let start: Vec<(String, Parameter)> = arm_start()
            .into_iter()
            .map(|(name, parameter)| {
                let value = off * parameter.value;
                let width = room * value.abs().max(0.01);
                (name, Parameter { value, lower: value - width, upper: value + width, fixed: false })
            })
            .collect();
        let fit = fit(&[run], &start, &[], ITERATIONS, &mut |_, _| {}).expect("there is data");
        prop_assert!(fit.status.may_update_model(), "{:?}", fit.status);
        for (name, parameter) in &start {
            let found = value(&fit, name);
            prop_assert!(found.is_nan() || (parameter.lower..=parameter.upper).contains(&found), "{name} {found}");
        }
        for number in [1, 2] {
            let inertial: [f64; 10] = std::array::from_fn(|symbol| {
                let name = format!("link.{number}.{}", Link::SYMBOLS[symbol]);
                let start = start.iter().find(|(other, _)| *other == name).map_or(0.0, |(_, p)| p.value);
                let found = value(&fit, &name);
                if found.is_nan() { start } else { found }
            });
            let least = pseudo_inertia::pseudo_inertia(&inertial).symmetric_eigenvalues().min();
            prop_assert!(least > -1e-12, "link {number}: {inertial:?} {least}");
        }
    }
}

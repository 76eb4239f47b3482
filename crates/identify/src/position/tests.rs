use super::*;
use crate::{FitStatus, plan::Plan};
use dynid_dynamics::{
    simulate::Scheme, system::PlacedEffect, system::fixtures::GAIN, system::fixtures::LUGRE,
    system::fixtures::PENDULUM, system::fixtures::SPRING, system::fixtures::placed,
};
use dynid_random::Random;

/// Inertia, gain, spring and LuGre friction of one joint, much like a wrist joint of a haptic device.
const TRUTH: [f64; 4] = [0.06, -0.05, 0.25e-3, 6.5];
const SPRING_TRUTH: [f64; 2] = [0.025, -0.25];
const LUGRE_TRUTH: [f64; 6] = [1.2, 0.008, 0.006, 0.2, 0.022, 0.016];

fn effects(gain: f64, spring: &[f64], lugre: &[f64]) -> Vec<PlacedEffect> {
    vec![placed(&GAIN, 0, None, &[gain]), placed(&SPRING, 0, None, spring), placed(&LUGRE, 0, None, lugre)]
}

fn system() -> System {
    let effects = effects(TRUTH[3], &SPRING_TRUTH, &LUGRE_TRUTH);
    System::new(&PENDULUM, 1, TRUTH[..3].to_vec(), Vec::new(), &effects).unwrap()
}

/// Logs of the true system, noise included.
fn runs(seed: u64, span_s: f64) -> Vec<FitRun> {
    let system = system();
    let mut noise = Random::new(seed);
    let samples = (span_s * 100.0) as usize + 1;
    let time: Vec<f64> = (0..samples).map(|k| k as f64 * 0.01).collect();
    [(0.006, 2.0, 0.1), (0.010, 3.5, -0.2)]
        .into_iter()
        .enumerate()
        .map(|(number, (amplitude, rate, q0))| {
            let command: Vec<f64> = time
                .iter()
                .map(|t| amplitude * ((rate * t).cos() + 0.4 * (2.7 * rate * t + 0.1 * t * t).sin()))
                .collect();
            let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
            let motion = simulate::simulate(&system, &input, &[q0], &simulate::Options::default()).unwrap();
            let position = motion.q.iter().map(|q| q + 2e-4 * noise.normal()).collect();
            FitRun {
                name: format!("run {number}"),
                system: system.clone(),
                time: time.clone(),
                command,
                position,
                intersample: Intersample::ZeroOrder,
                weights: vec![1.0],
                from_s: 0.0,
                first_half: 1.0,
                moving: false,
            }
        })
        .collect()
}

/// All parameters unknown but the gain, which scales everything else; starts off by `factor`.
pub fn problem(seed: u64, span_s: f64, off: f64) -> PositionProblem {
    let runs = runs(seed, span_s);
    let system = &runs[0].system;
    let mut signs = Random::new(seed + 99);
    let names =
        system.kernel().parameters.iter().map(|name| (*name).to_owned()).chain(system.effect_names().iter().cloned());
    let values = system.link_parameters().iter().chain(system.effect_parameters());
    let mut unknowns = Vec::new();
    let mut known = BTreeMap::new();
    for (name, &value) in names.zip(values) {
        if name.ends_with("Kp") || name == "link.1.m" || name.ends_with("Izz") {
            known.insert(name, value);
            continue;
        }
        let start = value * (1.0 + off * signs.normal().signum());
        let reach = 2.0 * value.abs();
        unknowns.push(Unknown {
            name,
            value: start,
            expected: start,
            lower: if value < 0.0 { value - reach } else { 0.1 * value },
            upper: value + reach,
        });
    }
    for axis in ["Ixx", "Ixy", "Ixz", "Iyy", "Iyz"] {
        known.insert(
            format!("link.1.{axis}"),
            if axis.len() == 3 && axis.as_bytes()[1] == axis.as_bytes()[2] { 2e-4 } else { 0.0 },
        );
    }
    let inequalities = vec![("joint.0.lugre.Fs".to_owned(), "joint.0.lugre.Fc".to_owned())];
    PositionProblem { runs, unknowns, known, inequalities, prior: None }
}

fn truth(name: &str) -> f64 {
    let system = system();
    if let Some(index) = system.kernel().parameters.iter().position(|known| *known == name) {
        return system.link_parameters()[index];
    }
    let index = system.effect_names().iter().position(|known| known == name).unwrap();
    system.effect_parameters()[index]
}

#[test]
fn a_poor_start_reaches_the_noise_and_the_truth_within_its_errors() {
    let mut problem = problem(3, 15.0, 0.3);
    for unknown in &mut problem.unknowns {
        if unknown.name.ends_with("Fs") {
            unknown.value = unknown.value.max(0.025);
        }
    }
    let fit = fit(&problem, &Options::default(), &mut |_| SearchControl::Continue).unwrap();
    for run in &fit.runs {
        assert!(run.rmse[0] < 1.03 * 2e-4, "{}: {} rad", run.name, run.rmse[0]);
    }
    assert!((fit.variance_ratio - 1.0).abs() < 0.15, "{}", fit.variance_ratio);
    for parameter in &fit.parameters {
        let error = (parameter.value - truth(&parameter.name)).abs();
        assert!(
            error < 4.0 * parameter.std_error.expect("is determined"),
            "{}: off by {error}, {:?}",
            parameter.name,
            parameter
        );
    }
    assert!((fit.runs[0].initial[0] - 0.1).abs() < 3e-4 && (fit.runs[1].initial[0] + 0.2).abs() < 3e-4);
}

#[test]
fn the_thread_count_does_not_change_a_bit() {
    let problem = problem(5, 4.0, 0.05);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let fit = pool.install(|| fit(&problem, &Options::default(), &mut |_| SearchControl::Continue)).unwrap();
        fit.parameters.iter().map(|parameter| parameter.value.to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(on(1), on(2));
}

/// Gain, inertia, stiffness and friction scaled together move alike: the fit says so and stays finite.
#[test]
fn a_common_scale_is_reported_as_undetermined() {
    let mut problem = problem(7, 6.0, 0.0);
    for (name, value) in std::mem::take(&mut problem.known) {
        let unit = matches!(name.as_str(), "link.1.m" | "link.1.Izz" | "joint.0.gain.Kp");
        if unit {
            problem.unknowns.push(Unknown { name, value, expected: value, lower: 0.2 * value, upper: 3.0 * value });
        } else {
            problem.known.insert(name, value);
        }
    }
    let fit = fit(&problem, &Options::default(), &mut |_| SearchControl::Continue).unwrap();
    assert!(!fit.undetermined.is_empty());
    for parameter in &fit.parameters {
        assert_eq!(parameter.std_error.is_some(), parameter.identifiable && !parameter.at_bound, "{parameter:?}");
    }
    assert!(fit.parameters.iter().any(|parameter| parameter.std_error.is_none()));
    assert!(matches!(fit.status, FitStatus::NotIdentifiable | FitStatus::HeldByBound), "{:?}", fit.status);
    let message: Vec<&str> =
        fit.undetermined.iter().flat_map(|way| &way.parts).map(|(name, _)| name.as_str()).collect();
    assert!(message.contains(&"joint.0.gain.Kp"), "{:?}", fit.undetermined);
}

#[test]
fn starts_that_cannot_be_are_errors() {
    let good = problem(1, 1.0, 0.0);
    let message = |change: &dyn Fn(&mut PositionProblem)| {
        let mut problem = good.clone();
        change(&mut problem);
        fit(&problem, &Options::default(), &mut |_| SearchControl::Continue).unwrap_err().to_string()
    };
    let fs = good.unknowns.iter().position(|unknown| unknown.name.ends_with("Fs")).unwrap();
    assert!(message(&|p| p.unknowns[fs].value = 0.015).contains("joint.0.lugre.Fs = 0.015 starts below"));
    assert!(message(&|p| p.unknowns[0].value = 9.0).contains("outside its bounds"));
    assert!(message(&|p| p.unknowns[0].upper = -9.0).contains("lies above the upper bound"));
    assert!(message(&|p| p.runs.clear()).contains("no run to fit to"));
    assert!(message(&|p| p.unknowns.clear()).contains("nothing is unknown"));
    assert!(message(&|p| p.runs[0].from_s = 5.0).contains("too few"));
    assert!(message(&|p| p.runs[0].position.truncate(5)).contains("measured positions: 5 values given"));
    let spin = |p: &mut PositionProblem| {
        p.unknowns.push(Unknown { name: "link.1.Izz".to_owned(), value: 1.0, expected: 1.0, lower: 0.5, upper: 2.0 });
    };
    assert!(message(&spin).contains("link 1 starts with an inertia that no body has"), "nor has any within its bounds");
}

/// A start next to zero is no reason to stay there: the weak prior is as wide as the range.
#[test]
fn the_prior_is_as_wide_for_a_start_next_to_zero() {
    for start in [0.0, 1e-9, 1e-6, -1e-6] {
        let mut unknown =
            Unknown { name: "joint.0.spring.qeq".to_owned(), value: start, expected: start, lower: -1.0, upper: 1.0 };
        assert_eq!(unknown.spread(), 1.0, "{start}");
        unknown.upper = f64::INFINITY;
        assert_eq!(unknown.spread(), 1.0, "{start} without a bound");
    }
    let mut ends = Vec::new();
    for start in [0.0, 1e-9, 1e-6] {
        let mut problem = problem(3, 6.0, 0.0);
        let rest = problem.unknowns.iter_mut().find(|unknown| unknown.name.ends_with("qeq")).unwrap();
        (rest.value, rest.expected, rest.lower, rest.upper) = (start, start, -1.0, 1.0);
        let fit = fit(&problem, &Options::default(), &mut |_| SearchControl::Continue).unwrap();
        let rest = fit.parameters.iter().find(|parameter| parameter.name.ends_with("qeq")).unwrap();
        assert!((rest.value - SPRING_TRUTH[1]).abs() < 0.05, "from {start}: {rest:?}");
        ends.push(rest.value);
    }
    assert!(ends.iter().all(|end| (end - ends[0]).abs() < 1e-3), "{ends:?}");
}

/// Weights that are the same everywhere change nothing, standard errors included; uneven ones (Eq. 4.2) are no better
/// than even ones.
#[test]
fn standard_errors_do_not_believe_in_weights() {
    let even = problem(3, 8.0, 0.0);
    let fitted = |weight: f64, first_half: f64| {
        let mut problem = even.clone();
        for run in &mut problem.runs {
            run.weights = vec![weight];
            run.first_half = first_half;
        }
        fit(&problem, &Options::default(), &mut |_| SearchControl::Continue).unwrap()
    };
    let (one, three, uneven) = (fitted(1.0, 1.0), fitted(3.0, 1.0), fitted(1.0, 0.2));
    assert!((three.variance_ratio / one.variance_ratio - 1.0).abs() < 1e-3, "{}", three.variance_ratio);
    assert!((uneven.variance_ratio - 1.0).abs() < 0.2, "{}", uneven.variance_ratio);
    // Half of a log that hardly counts tells hardly anything.
    let half = fitted(1.0, 0.02);
    let without = {
        let mut problem = even.clone();
        problem.runs.iter_mut().for_each(|run| run.from_s = 4.0);
        fit(&problem, &Options::default(), &mut |_| SearchControl::Continue).unwrap()
    };
    for (half, without) in half.parameters.iter().zip(&without.parameters) {
        let ratio = half.std_error.expect("is determined") / without.std_error.expect("is determined");
        assert!((0.7..1.3).contains(&ratio), "{}: {ratio}", half.name);
    }
    let mut worse = 0;
    for ((one, three), uneven) in one.parameters.iter().zip(&three.parameters).zip(&uneven.parameters) {
        let [one_error, three_error, uneven_error] =
            [one, three, uneven].map(|parameter| parameter.std_error.expect("is determined"));
        assert!((three_error / one_error - 1.0).abs() < 0.02, "{}: {one_error}, {three_error}", one.name);
        assert!(uneven_error > 0.9 * one_error, "{}: {one_error}, {uneven_error}", one.name);
        worse += usize::from(uneven_error > 1.02 * one_error);
    }
    assert!(worse > one.parameters.len() / 2, "{worse} of {} know less", one.parameters.len());
}

/// The first seconds of a log may be spoiled: cut, they change nothing (thesis Eq. 4.3).
#[test]
fn a_spoiled_beginning_can_be_cut() {
    let mut problem = problem(3, 15.0, 0.1);
    for unknown in problem.unknowns.iter_mut().filter(|unknown| unknown.name.ends_with("Fs")) {
        unknown.value = unknown.value.max(0.025);
    }
    for run in &mut problem.runs {
        for (k, q) in run.position.iter_mut().enumerate().take(200).skip(5) {
            *q += 0.01 * (k as f64).sin();
        }
        run.from_s = 3.0;
    }
    let fit = fit(&problem, &Options::default(), &mut |_| SearchControl::Continue).unwrap();
    assert!(fit.status.may_update_model() && (fit.variance_ratio - 1.0).abs() < 0.15, "{:?}", fit.status);
    for parameter in &fit.parameters {
        let error = (parameter.value - truth(&parameter.name)).abs();
        let reach = 4.0 * parameter.std_error.expect("is determined");
        assert!(error < reach, "{}: off by {error}, {parameter:?}", parameter.name);
    }
}

/// The first seconds of a log are taken away: what is left begins in motion, and only a fit that knows so explains it.
#[test]
fn a_log_that_begins_in_motion_has_an_initial_speed() {
    const AWAY: usize = 140;
    let fitted = |moving: bool| {
        let mut problem = problem(5, 12.0, 0.0);
        for run in &mut problem.runs {
            run.time.drain(..AWAY);
            run.command.drain(..AWAY);
            run.position.drain(..AWAY);
            run.moving = moving;
        }
        fit(&problem, &Options::default(), &mut |_| SearchControl::Continue).unwrap()
    };
    let moving = fitted(true);
    for run in &moving.runs {
        assert_eq!(run.initial.len(), 2, "position and speed");
        assert!(run.initial[1].abs() > 0.02, "{}: {} rad/s", run.name, run.initial[1]);
        // What the bristles remember of the time before is not known, so that a little is left.
        assert!(run.rmse[0] < 1.2 * 2e-4, "{}: {} rad", run.name, run.rmse[0]);
    }
    assert!(fitted(false).cost > 2.0 * moving.cost, "taken for at rest it cannot be explained");
}

/// What the runs tell one by one adds up to what the fit of them says, cut beginnings and all.
#[test]
fn informations_of_the_runs_add_up_to_that_of_the_fit() {
    let mut problem = problem(4, 10.0, 0.02);
    problem.runs[0].from_s = 2.0;
    let options = Options::default();
    let fit = fit(&problem, &options, &mut |_| SearchControl::Continue).unwrap();
    let n = fit.parameters.len();
    let sum = motions(&problem, &fit, &options)
        .unwrap()
        .iter()
        .fold(DMatrix::zeros(n, n), |sum, motion| sum + &motion.information / fit.widening());
    for row in 0..n {
        for column in 0..n {
            let size = (fit.information[(row, row)] * fit.information[(column, column)]).sqrt();
            let error = (sum[(row, column)] - fit.information[(row, column)]).abs();
            assert!(error <= 1e-6 * size, "{row}, {column}: off by {error} of {size}");
        }
    }
}

/// A step of a sequence that ended with two ordered values equal, up to the solver's tolerance, can be gone on from; one
/// that breaks the order cannot.
#[test]
fn an_order_may_be_broken_by_rounding_only() {
    let mut problem = problem(4, 10.0, 0.0);
    let [(larger, smaller)] = problem.inequalities.as_slice() else { panic!("one order") };
    let place = |name: &str| problem.unknowns.iter().position(|unknown| unknown.name == name).unwrap();
    let (larger, smaller) = (place(larger), place(smaller));
    let value = problem.unknowns[smaller].value;
    problem.unknowns[larger].value = value * (1.0 - 1e-9);
    assert_eq!(check(&problem), Ok(()));
    problem.unknowns[larger].value = value * (1.0 - 1e-3);
    assert!(matches!(check(&problem), Err(PositionFitError::StartUnequal { .. })));
}

/// A run whose joint rests for eight seconds, its noise being 2e-4 rad. Its bristles' time constant shortens with the speed: what
/// few steps can follow while the joint is slow, they cannot when it is fast.
fn stiff_only_later() -> FitRun {
    const STIFF: [f64; 6] = [30.0, 0.008, 0.006, 0.2, 0.022, 0.016];
    let effects = effects(TRUTH[3], &SPRING_TRUTH, &STIFF);
    let mut run = runs(5, 12.0).swap_remove(0);
    run.system = System::new(&PENDULUM, 1, TRUTH[..3].to_vec(), Vec::new(), &effects).unwrap();
    for (t, command) in run.time.iter().zip(&mut run.command) {
        *command = if *t < 8.0 { 0.0 } else { 0.005 * (12.0 * t).sin() };
    }
    let mut noise = Random::new(6);
    run.position = simulated(&run, 60).unwrap().into_iter().map(|q| q + 2e-4 * noise.normal()).collect();
    run
}

fn simulated(run: &FitRun, substeps: usize) -> Result<Vec<f64>, SimulationError> {
    let input = run.input();
    let options = simulate::Options::per_sample(substeps);
    simulate::simulate(&run.system, &input, &[-0.25], &options).map(|trajectory| trajectory.q)
}

#[test]
fn a_run_that_is_stiff_only_later_takes_more_steps_only_then() {
    let run = stiff_only_later();
    let alone = alone(&run);
    let evaluator = Evaluator::new(&alone).unwrap();
    let plan = evaluator.rough_plan(&evaluator.start(&alone), 0.0);
    let mean = |schemes: &[Scheme]| Plan::new(vec![schemes.to_vec()]).mean_steps();
    let (resting, moving) = plan.of_run(0).split_at(801);
    assert!(mean(&resting[100..]) < 3.0 && mean(moving) > 2.0 * mean(&resting[100..]), "{plan:?}");
    let judged = judge(&run, &Options::default()).unwrap();
    assert!(judged.rmse[0] < 1.05 * 2e-4, "{} rad", judged.rmse[0]);
}

#[test]
fn a_run_that_is_stiff_only_later_can_be_fitted_to() {
    let run = stiff_only_later();
    let values = run.system.effect_names().iter().cloned().zip(run.system.effect_parameters().iter().copied());
    let (spring, known): (Vec<_>, Vec<_>) = values.partition(|(name, _)| name.contains("spring"));
    let links = run.system.kernel().parameters.iter().map(|name| (*name).to_owned());
    let known = known.into_iter().chain(links.zip(run.system.link_parameters().iter().copied())).collect();
    let unknown = |(name, value): &(String, f64)| {
        let start = 1.05 * value;
        Unknown { name: name.clone(), value: start, expected: start, lower: -1.0, upper: 1.0 }
    };
    let unknowns = spring.iter().map(unknown).collect();
    let problem = PositionProblem { runs: vec![run], unknowns, known, inequalities: Vec::new(), prior: None };
    for start in [Start::Near, Start::Poor] {
        let fit = fit(&problem, &Options { start, ..Options::default() }, &mut |_| SearchControl::Continue).unwrap();
        assert_eq!(fit.status, FitStatus::Converged, "{start:?}");
        assert!(fit.runs[0].rmse[0] < 1.05 * 2e-4, "{start:?}: {} rad", fit.runs[0].rmse[0]);
        for ((name, value), estimate) in spring.iter().zip(&fit.parameters) {
            assert_eq!(name, &estimate.name);
            assert!((estimate.value - value).abs() < 0.02 * value.abs(), "{start:?}, {name}: {}", estimate.value);
        }
    }
}

/// What decides in the end is exact beside the noise, and where every interval is stated, that is what is done.
#[test]
fn the_last_plan_moves_no_position_by_more_than_a_hundredth_of_the_noise() {
    for run in [runs(7, 12.0).swap_remove(1), stiff_only_later()] {
        let alone = alone(&run);
        let evaluator = Evaluator::new(&alone).unwrap();
        let start = evaluator.start(&alone);
        let simulated = |stated: Option<Steps>| {
            Search::Final.at(&evaluator, &start, stated).simulated(&start).unwrap().swap_remove(0)
        };
        let planned = simulated(None);
        let options = simulate::Options::per_sample(240);
        let fine = simulate::simulate(&run.system, &run.input(), &start, &options).unwrap().q;
        let moved = planned.iter().zip(&fine).map(|(planned, fine)| (planned - fine).abs()).fold(0.0, f64::max);
        assert!(moved < 0.01 * 2e-4, "{moved} rad");
        assert_eq!(simulated(Some(Steps::PerSample(240))), fine);
    }
}

/// A fit ends where one does whose every interval takes many steps, and says what that says.
#[test]
fn a_planned_fit_ends_where_many_steps_do() {
    let problem = problem(3, 8.0, 0.05);
    let fitted = |steps: Option<Steps>| {
        fit(&problem, &Options { steps, ..Options::default() }, &mut |_| SearchControl::Continue).unwrap()
    };
    let (planned, many) = (fitted(None), fitted(Some(Steps::PerSample(120))));
    assert!((planned.cost / many.cost - 1.0).abs() < 1e-4, "{} is not {}", planned.cost, many.cost);
    for (planned, many) in planned.parameters.iter().zip(&many.parameters) {
        let reach = 0.05 * many.std_error.expect("is determined");
        assert!((planned.value - many.value).abs() < reach, "{planned:?} is not {many:?}");
    }
}

#[test]
fn a_start_that_is_near_its_logs_needs_no_observer() {
    let is_led = |off: f64| {
        let problem = problem(5, 8.0, off);
        let mut observers = Vec::new();
        let mut watch = |progress: &Progress| {
            observers.push(progress.observer);
            SearchControl::Stop
        };
        let stopped = fit(&problem, &Options::default(), &mut watch);
        assert!(matches!(stopped, Err(PositionFitError::Interrupted { .. })), "{stopped:?}");
        observers.iter().any(|observer| *observer > 0.0)
    };
    assert!(!is_led(0.0), "the truth");
    assert!(is_led(0.3));
}

/// One run, of which nothing but its initial position is unknown.
fn alone(run: &FitRun) -> PositionProblem {
    let (unknowns, known, inequalities) = (Vec::new(), BTreeMap::new(), Vec::new());
    PositionProblem { runs: vec![run.clone()], unknowns, known, inequalities, prior: None }
}

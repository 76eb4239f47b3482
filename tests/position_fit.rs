//! The position fit on logs of the independent plant: how sure it says it is, and from how far off it gets there.

use dynid_dynamics::simulate::Steps;
use std::fs;

use dynid_identify::SearchControl;
use dynid_identify::{position, position::FitRun, position::Options, position::PositionFit, position::PositionProblem};
use dynid_logs::{experiment::Experiment, experiment::Role};
use dynid_plant::{
    effects::EffectEntry,
    random::Noise,
    recipe::{Cosine, Recipe, RunEntry},
};
use dynid_user_model::Model;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Noise of the logs [rad], and what their last digit counts.
const NOISE: f64 = 2e-4;
const QUANTUM: f64 = 1e-4;

/// The device's own model, every value up to this share off.
fn model(off: f64, seed: u64) -> Model {
    let mut noise = Noise::new(seed);
    let mut model = Model::of_device(dynid_model::device("freedom6s").expect("a shipped device"));
    let values: Vec<(String, f64)> = model.parameters().into_iter().map(|(name, known)| (name, known.value)).collect();
    for (name, value) in values.into_iter().filter(|(name, _)| name.starts_with("joint.")) {
        model.set_value(&name, value * (1.0 + off * (2.0 * noise.uniform() - 1.0))).expect("its own name");
    }
    model
}

/// Logs without noise that the plant shows with the values of `truth`.
fn logs(truth: &Model, runs: Vec<RunEntry>) -> Vec<FitRun> {
    let effects = truth.effects.iter().map(|instance| EffectEntry {
        id: instance.effect.id.clone(),
        joint: instance.joint.expect("the device has effects of joints only"),
        from: instance.from,
        values: instance
            .effect
            .parameters
            .iter()
            .zip(instance.values())
            .map(|(parameter, value)| (parameter.symbol.clone(), value))
            .collect(),
    });
    let recipe = Recipe {
        device: truth.device.id.clone(),
        seed: 1,
        sample_s: 0.01,
        steps_per_sample: 120,
        noise_rms: 0.0,
        quantum: 0.0,
        start: vec![0.0, 0.2, 0.0, 0.3, -0.28, -0.4],
        effects: effects.collect(),
        runs,
        ..Recipe::default()
    };
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, text) in dynid_plant::recipe::make(&recipe, truth.device).expect("the recipe can be played") {
        fs::write(folder.path().join(name), text).expect("the folder is writable");
    }
    let experiment =
        Experiment::read_with(&folder.path().join("experiment.toml"), dynid_model::devices()).expect("an experiment");
    let fitted = experiment.runs.iter().filter(|run| run.role == Role::Fit);
    fitted.map(|run| FitRun::of_run(truth, run).expect("a configuration of the device")).collect()
}

/// What an encoder makes of a position.
fn measured(position: f64, noise: &mut Noise) -> f64 {
    ((position + NOISE * noise.gaussian()) / QUANTUM).round() * QUANTUM
}

fn chirp(joint: usize, amplitude: f64, phase: f64, duration_s: f64) -> Cosine {
    Cosine { joint, amplitude, hz: 0.2, hz_per_s: 3.0 / duration_s, phase }
}

fn run(number: usize, free: &[usize], duration_s: f64, torque: Vec<Cosine>) -> RunEntry {
    RunEntry {
        file: format!("run-{number}.csv"),
        free: free.to_vec(),
        role: "fit".to_owned(),
        duration_s,
        torque,
        ..RunEntry::default()
    }
}

fn fitted(model: &Model, runs: Vec<FitRun>, start: impl Fn(&str, f64) -> f64, substeps: usize) -> PositionFit {
    let mut problem = PositionProblem::of_model(model, []).expect("a problem without runs");
    problem.unknowns.retain(|unknown| runs.iter().any(|run| run.occurs(&unknown.name)));
    for unknown in &mut problem.unknowns {
        unknown.value = start(&unknown.name, unknown.value).clamp(unknown.lower, unknown.upper);
        unknown.expected = unknown.value;
    }
    for (larger, smaller) in problem.inequalities.clone() {
        let place = |name: &str| problem.unknowns.iter().position(|unknown| unknown.name == name);
        if let (Some(larger), Some(smaller)) = (place(&larger), place(&smaller)) {
            let value = problem.unknowns[smaller].value.min(problem.unknowns[larger].value);
            problem.unknowns[smaller].value = value;
        }
    }
    problem.runs = runs;
    position::fit(&problem, &Options { steps: Some(Steps::PerSample(substeps)), ..Options::default() }, &mut |_| {
        SearchControl::Continue
    })
    .expect("the fit comes to an end")
}

/// A combination of parameters that the log shows: how far it is off and its standard error.
struct Shown {
    name: String,
    error: f64,
    std_error: f64,
}

/// With an unknown gain, everything at the joint can grow together: what the log shows are ratios to the gain, and what
/// no torque enters. Left out is what leans on the ranges of the parameters (here the cable, which the weight
/// of the handle looks like), for those are no data.
fn shown(fit: &PositionFit, truth: &Model) -> Vec<Shown> {
    /// An interval leans on the ranges if ranges ten times as wide widen it by more than this factor.
    const LEANING: f64 = 1.05;
    const GAIN: &str = "joint.4.gain.Kp";
    let n = fit.parameters.len();
    let place = |name: &str| fit.parameters.iter().position(|found| found.name == name).expect("it is unknown");
    let exact = |name: &str| truth.parameter(name).expect("its own name").value;
    let wide = DMatrix::from_diagonal(&DVector::from_fn(n, |k, _| {
        let known = truth.parameter(&fit.parameters[k].name).expect("its own name");
        (5.0 * (known.upper - known.lower)).powi(-2)
    }));
    let from_data = (&fit.information + wide).cholesky().expect("positive definite").inverse();
    let gain = fit.parameters[place(GAIN)].value;
    let mut message = Vec::new();
    for (index, found) in fit.parameters.iter().enumerate().filter(|(_, found)| found.name.starts_with("joint.4")) {
        let name = found.name.as_str();
        let mut gradient = DVector::zeros(n);
        let error = if name == GAIN {
            continue;
        } else if name.ends_with("qeq") || name.ends_with("vs") {
            gradient[index] = 1.0;
            found.value - exact(name)
        } else {
            gradient[index] = 1.0 / gain;
            gradient[place(GAIN)] = -found.value / (gain * gain);
            found.value / gain - exact(name) / exact(GAIN)
        };
        let std_error = |covariance: &DMatrix<f64>| gradient.dot(&(covariance * &gradient)).sqrt();
        if std_error(&from_data) <= LEANING * std_error(&fit.covariance) {
            message.push(Shown { name: name.to_owned(), error, std_error: std_error(&fit.covariance) });
        }
    }
    message
}

/// Honest errors: of 100 logs that differ by their noise, the 95 % intervals hold the truth in 90 to 99.
#[test]
fn intervals_cover_the_truth_as_often_as_they_say() {
    const SEEDS: u64 = 100;
    let truth = model(0.1, 3);
    let torque = vec![chirp(4, 0.005, 0.4, 10.0), chirp(4, 0.002, 2.0, 4.0)];
    let clean = logs(&truth, vec![run(1, &[4], 10.0, torque)]);
    let fits: Vec<Vec<Shown>> = (0..SEEDS)
        .into_par_iter()
        .map(|seed| {
            let mut noise = Noise::new(1000 + seed);
            let mut runs = clean.clone();
            for run in &mut runs {
                run.position.iter_mut().for_each(|q| *q = measured(*q, &mut noise));
            }
            let start = |name: &str, value: f64| if name.starts_with("link") { value } else { 1.01 * value };
            shown(&fitted(&truth, runs, start, 30), &truth)
        })
        .collect();
    let names: Vec<&str> = fits[0].iter().map(|shown| shown.name.as_str()).collect();
    assert!(names.len() >= 6, "the log shows {names:?}");
    let (mut covered, mut message) = (0, 0);
    for name in names {
        let all = fits.iter().flatten().filter(|shown| shown.name == name);
        let n_all = all.clone().count();
        let n_covered = all.filter(|shown| shown.error.abs() <= 1.96 * shown.std_error).count();
        println!("{name}: {n_covered} of {n_all}");
        assert_eq!(n_all as u64, SEEDS, "{name} is shown by every log");
        assert!((90..=99).contains(&n_covered), "{name}: {n_covered} of {n_all}");
        covered += n_covered;
        message += n_all;
    }
    let share = covered as f64 / message as f64;
    assert!((0.93..=0.97).contains(&share), "{share} of all");
}

/// Links off by 30 %, joints by 50 %, all in random directions: nearly every start ends at the same cost.
#[test]
fn starts_from_far_off_end_at_the_same_cost() {
    const SEEDS: u64 = 10;
    let truth = model(0.1, 5);
    let torque = vec![chirp(4, 0.006, 0.4, 15.0), chirp(5, 0.012, 1.5, 12.0)];
    let mut runs = logs(&truth, vec![run(1, &[4, 5], 15.0, torque)]);
    let mut noise = Noise::new(77);
    for run in &mut runs {
        run.position.iter_mut().for_each(|q| *q = measured(*q, &mut noise));
    }
    let device = model(0.0, 0);
    let fits: Vec<PositionFit> = (0..SEEDS)
        .into_par_iter()
        .map(|seed| {
            // Every parameter has a sign of its own, whichever order they come in.
            let start = |name: &str, value: f64| {
                let salt = name.bytes().fold(seed, |salt, byte| salt.wrapping_mul(31).wrapping_add(u64::from(byte)));
                let sign = if Noise::new(salt).uniform() < 0.5 { -1.0 } else { 1.0 };
                value * (1.0 + sign * if name.starts_with("link") { 0.3 } else { 0.5 })
            };
            fitted(&device, runs.clone(), start, 30)
        })
        .collect();
    let best = fits.iter().map(|fit| fit.cost).fold(f64::INFINITY, f64::min);
    for fit in &fits {
        println!("cost {:.1}, {} iterations, {:?}", fit.cost, fit.iterations, fit.status);
    }
    let samples = runs[0].position.len() as f64;
    let rms = fits.iter().flat_map(|fit| &fit.runs[0].rmse).fold(0.0_f64, |worst, rmse| worst.max(*rmse));
    assert!(
        rms < 1.05 * NOISE.hypot(QUANTUM / 12.0_f64.sqrt()),
        "noise only is left: {rms}, {} of samples",
        best / samples
    );
    let reached = fits.iter().filter(|fit| fit.cost <= 1.01 * best).count();
    assert!(reached >= 9, "{reached} of {SEEDS} reach {best}");
}

//! The problems that benchmarks and peers solve.
#![allow(dead_code)] // each includer takes its part

use anyhow::{Context, Result};
use dynid_dynamics::{simulate, simulate::Input, simulate::Intersample, system::System};
use dynid_identify::{position::FitRun, position::PositionProblem};
use dynid_random::Random;
use dynid_user_model::Model;

/// Where the simulation of all joints starts [rad].
pub const START: [f64; 6] = [0.0, 0.15, -0.05, 0.35, -0.25, -0.4];

/// The thesis's coupled inputs (Table 4.7): amplitude and its rise [N*m], frequency and its rise [rad/s], phase [rad].
const CHIRPS: [[f64; 5]; 6] = [
    [0.02, 0.0, 1.0, 2.0, std::f64::consts::FRAC_PI_2],
    [0.008, 0.01, 1.0, 1.0, 0.0],
    [0.01, 0.01, 1.0, 0.5, 0.0],
    [0.008, 0.002, 0.5, 0.5, 0.0],
    [0.0045, -0.002, 0.5, 2.5, std::f64::consts::FRAC_PI_2],
    [0.0055, -0.003, 0.5, 2.0, 0.0],
];

/// The Freedom 6S with all joints free.
pub fn all_joints() -> Result<System> {
    let model = Model::of_device(dynid_model::device("freedom6s").context("the library has the Freedom 6S")?);
    let free: Vec<usize> = (0..model.device.joints.len()).collect();
    Ok(model.system(&free, |_| 0.0)?)
}

/// Times and commands of 60 s at 100 Hz.
pub fn coupled_commands() -> (Vec<f64>, Vec<f64>) {
    let time: Vec<f64> = (0..=6000).map(|k| f64::from(k) * 0.01).collect();
    let command = time
        .iter()
        .flat_map(|t| {
            CHIRPS.map(|[size, rise, rate, sweep, phase]| {
                (size + rise / 60.0 * t) * ((rate + sweep / 60.0 * t) * t + phase).cos()
            })
        })
        .collect();
    (time, command)
}

/// The joint that is free.
pub const JOINT: usize = 4;
/// Relative error of the start, alternating in sign: links, then effects.
const OFF: [f64; 2] = [0.05, 0.12];
/// Standard deviation of the log's noise [rad].
pub const NOISE: f64 = 2e-4;

/// A log that `model` explains, with the model's own system.
fn log(model: &Model) -> Result<FitRun> {
    let system = model.system(&[JOINT], |_| 0.0)?;
    let time: Vec<f64> = (0..=6000).map(|k| f64::from(k) * 0.01).collect();
    let mut command = vec![0.0; time.len() * system.n_joints()];
    for (row, t) in command.chunks_exact_mut(system.n_joints()).zip(&time) {
        row[JOINT] = 0.005 * ((0.5 + 2.5 / 60.0 * t) * t).cos();
    }
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let motion = simulate::simulate(&system, &input, &[-0.28], &simulate::Options::default())?;
    let mut noise = Random::new(11);
    let position = motion.q.iter().map(|q| q + NOISE * noise.normal()).collect();
    Ok(FitRun {
        name: "chirp".to_owned(),
        system,
        time,
        command,
        position,
        intersample: Intersample::ZeroOrder,
        weights: vec![1.0],
        first_half: 1.0,
        moving: false,
        from_s: f64::NEG_INFINITY,
    })
}

/// The fit of one joint: 13 unknowns, a 60 s log at 100 Hz, started as far off as the thesis's guesses are.
pub fn one_joint_problem() -> Result<PositionProblem> {
    let truth = Model::of_device(dynid_model::device("freedom6s").context("the library has the Freedom 6S")?);
    let run = log(&truth)?;
    let mut problem = PositionProblem::of_model(&truth, [])?;
    problem.unknowns.retain(|unknown| run.occurs(&unknown.name));
    for (index, unknown) in problem.unknowns.iter_mut().enumerate() {
        let off = OFF[usize::from(unknown.name.starts_with("joint"))];
        let sign = if index % 2 == 0 { 1.0 } else { -1.0 };
        unknown.value = (unknown.value * (1.0 + sign * off)).clamp(unknown.lower, unknown.upper);
        unknown.expected = unknown.value;
    }
    problem.runs.push(run);
    Ok(problem)
}

//! The problems that benchmarks and peers solve.
#![allow(dead_code)] // each includer takes its part

pub mod long_log;

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
    let model = freedom6s()?;
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

/// Steps of a sample: the thesis's, and the peers'.
pub const SUBSTEPS: usize = 60;
/// The joint that is free.
pub const JOINT: usize = 4;
/// Where it starts [rad].
pub const JOINT_START: f64 = -0.28;
/// Relative error of the start, alternating in sign: links, then effects.
const OFF: [f64; 2] = [0.05, 0.12];
/// Standard deviation of the log's noise [rad].
pub const NOISE: f64 = 2e-4;

/// A log of a minute or so that `model` explains, with the model's own system.
fn log(model: &Model, seconds: u32, seed: u64) -> Result<FitRun> {
    let system = model.system(&[JOINT], |_| 0.0)?;
    let time: Vec<f64> = (0..=100 * seconds).map(|k| f64::from(k) * 0.01).collect();
    let mut command = vec![0.0; time.len() * system.n_joints()];
    for (row, t) in command.chunks_exact_mut(system.n_joints()).zip(&time) {
        row[JOINT] = 0.005 * ((0.5 + 2.5 / f64::from(seconds) * t) * t).cos();
    }
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let motion = simulate::simulate(&system, &input, &[JOINT_START], &simulate::Options::per_sample(SUBSTEPS))?;
    let mut noise = Random::new(seed);
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

/// The Freedom 6S as its device file gives it.
fn freedom6s() -> Result<Model> {
    Ok(Model::of_device(dynid_model::device("freedom6s").context("the library has the Freedom 6S")?))
}

/// The fit of `truth`'s parameters that `is_unknown` to `runs`, started as far off as the thesis's guesses are.
fn started_off(truth: &Model, runs: Vec<FitRun>, is_unknown: impl Fn(&str) -> bool) -> Result<PositionProblem> {
    let mut problem = PositionProblem::of_model(truth, [])?;
    problem.unknowns.retain(|unknown| runs.iter().any(|run| run.occurs(&unknown.name)) && is_unknown(&unknown.name));
    for (index, unknown) in problem.unknowns.iter_mut().enumerate() {
        let off = OFF[usize::from(unknown.name.starts_with("joint"))];
        let sign = if index % 2 == 0 { 1.0 } else { -1.0 };
        unknown.value = (unknown.value * (1.0 + sign * off)).clamp(unknown.lower, unknown.upper);
        unknown.expected = unknown.value;
    }
    problem.runs = runs;
    Ok(problem)
}

/// The Freedom 6S with that joint free.
pub fn one_joint() -> Result<System> {
    Ok(freedom6s()?.system(&[JOINT], |_| 0.0)?)
}

/// The fit of one joint: 13 unknowns, a 60 s log at 100 Hz, started as far off as the thesis's guesses are.
pub fn one_joint_problem() -> Result<PositionProblem> {
    let truth = freedom6s()?;
    let run = log(&truth, 60, 11)?;
    started_off(&truth, vec![run], |_| true)
}

/// The same fit to several logs of so many seconds, each with its own noise.
pub fn one_joint_runs(n_runs: usize, seconds: u32) -> Result<PositionProblem> {
    let truth = freedom6s()?;
    let runs = (0..n_runs as u64).map(|run| log(&truth, seconds, 11 + run)).collect::<Result<_>>()?;
    started_off(&truth, runs, |_| true)
}

/// The same joint without a friction that has states, which fewer programs know: centroid and inertia of the link, viscous
/// friction and a spring are unknown.
pub fn linear_joint_problem() -> Result<PositionProblem> {
    let mut truth = freedom6s()?;
    truth.remove_effect("lugre", Some(JOINT), None)?;
    truth.add_effect("viscous", Some(JOINT), None)?;
    truth.set_value(&format!("joint.{JOINT}.viscous.Fv"), 0.002)?;
    let run = log(&truth, 60, 11)?;
    const UNKNOWN: [&str; 6] = ["link.7.x", "link.7.y", "link.7.Izz", "viscous.Fv", "spring.Ks", "spring.qeq"];
    started_off(&truth, vec![run], |name| UNKNOWN.iter().any(|unknown| name.ends_with(unknown)))
}

/// The Freedom 6S with all joints free and, beside its own effects, curves over position and over the turn at every joint: many unknowns.
/// With it, which of its effects' parameters a fit may move.
pub fn many_unknowns() -> Result<(System, Vec<String>)> {
    let mut model = freedom6s()?;
    let free: Vec<usize> = (0..model.device.joints.len()).collect();
    for joint in &free {
        for effect in ["torque_over_position", "torque_over_turn"] {
            model.add_effect(effect, Some(*joint), None)?;
        }
    }
    let system = model.system(&free, |_| 0.0)?;
    let moves = |name: &&String| model.parameter(name).is_some_and(|parameter| !parameter.fixed);
    let names = system.effect_names().iter().filter(moves).cloned().collect();
    Ok((system, names))
}

/// A device file of a chain of `n` joints with lengths, angles and links from a seed.
pub fn random_chain(n: usize) -> String {
    let mut random = Random::new(10);
    let mut text = String::from(
        "title = \"chain\"\nsource = \"a seed\"\n[units]\nangle = \"rad\"\nlength = \"m\"\nmass = \"kg\"\ninertia = \"kg*m^2\"\n\
         time = \"s\"\ncommand = \"N*m\"\n[base]\ngravity = 9.81\nup = [0, 0, 1]\n[kinematics]\nconvention = \"standard\"\nframes = [\n",
    );
    for joint in 0..n {
        let parent = if joint == 0 { "base".to_owned() } else { format!("f{}", joint - 1) };
        let [d, a] = [random.between(-0.3, 0.3), random.between(0.1, 0.4)];
        // As robots are built: axes are parallel or at right angles.
        let alpha = ["0", "pi/2", "-pi/2"][(random.between(0.0, 3.0) as usize).min(2)];
        text += &format!(
            "  {{ name = \"f{joint}\", parent = \"{parent}\", theta = \"q{joint}\", d = {d}, a = {a}, alpha = \"{alpha}\" }},\n"
        );
    }
    text += "]\n";
    for joint in 0..n {
        text += &format!("[[joint]]\ntitle = \"{joint}\"\nposition = [-inf, inf]\nspeed = inf\ntorque = inf\n");
    }
    text += "[bounds]\nmass = 0.5\ncentroid = 0.3\ninertia = 0.5\n";
    for joint in 0..n {
        let [x, y, z] = [0.0; 3].map(|_| random.between(-0.1, 0.1));
        let [ixy, ixz, iyz] = [0.0; 3].map(|_| random.between(-0.002, 0.002));
        text += &format!(
            "[[link]]\ntitle = \"{joint}\"\nframe = \"f{joint}\"\nm = {}\nx = {x}\ny = {y}\nz = {z}\nIxx = 0.02\nIxy = {ixy}\n\
             Ixz = {ixz}\nIyy = 0.021\nIyz = {iyz}\nIzz = 0.022\n",
            random.between(0.5, 2.0)
        );
    }
    let all: Vec<usize> = (0..n).collect();
    text + &format!("[identification]\nconfigurations = [{all:?}]\n")
}

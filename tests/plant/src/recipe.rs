//! A recipe for data: a device, its true parameters and effects, inputs, noise; and the logs that come of it.
//!
//! ```toml
//! device = "planar2r"
//! seed = 1
//! sample_s = 0.01          # one row of the log; the command is held over it
//! steps_per_sample = 120   # Runge-Kutta steps
//! noise_rms = 2e-4         # rad or m
//! quantum = 1e-4           # rad or m
//! start = [0.1, 0.2]       # positions; everything starts at rest
//!
//! [parameters]             # where the truth differs from the device file
//! "link.1.m" = 1.2
//!
//! [[effect]]
//! id = "viscous"
//! joint = 0
//! Fv = 0.1
//!
//! [[run]]
//! file = "swing.csv"
//! free = [0]
//! role = "fit"
//! duration_s = 10.0
//! # amplitude * cos(2 pi (hz + hz_per_s / 2 * t) t + phase), summed per joint
//! torque = [{ joint = 0, amplitude = 0.3, hz = 0.8 }]
//! ```

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt::Write;

use dynid_model::{Device, Link};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::Mechanism;
use crate::effects::{self, EffectEntry, JointEffects, Moment};
use crate::random::Noise;

/// What to make.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Id of the device.
    pub device: String,
    /// Of the noise; every run continues the sequence.
    pub seed: u64,
    /// Time from row to row (s).
    pub sample_s: f64,
    /// Runge-Kutta steps from row to row.
    pub steps_per_sample: usize,
    /// Standard deviation of the position noise of free joints (rad or m).
    pub noise_rms: f64,
    /// Logged positions are multiples of this (rad or m); 0 for none.
    pub quantum: f64,
    /// Position of every joint at the start of every run.
    pub start: Vec<f64>,
    /// True values that differ from the device file, by name.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
    /// True effects.
    #[serde(default, rename = "effect")]
    pub effects: Vec<EffectEntry>,
    /// Logs to make.
    #[serde(rename = "run")]
    pub runs: Vec<RunEntry>,
}

/// One log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunEntry {
    /// Its file name.
    pub file: String,
    /// Joints that move; all others stay at their start.
    pub free: Vec<usize>,
    /// `fit` or `validate`.
    pub role: String,
    /// s
    pub duration_s: f64,
    /// Sum of cosines per joint.
    pub torque: Vec<Cosine>,
}

/// `amplitude * cos(2 pi (hz + hz_per_s / 2 * t) t + phase)` at one joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cosine {
    /// The joint commanded.
    pub joint: usize,
    /// N*m or N.
    pub amplitude: f64,
    /// Frequency at the start (Hz).
    pub hz: f64,
    /// How fast it rises, for a chirp (Hz/s).
    #[serde(default)]
    pub hz_per_s: f64,
    /// rad
    #[serde(default)]
    pub phase: f64,
}

/// Name -> text of every file: the logs and `experiment.toml`.
pub type Files = BTreeMap<String, String>;

/// Plays the recipe on `device`.
pub fn make(recipe: &Recipe, device: &Device) -> Result<Files, String> {
    let plant = Plant::new(recipe, device)?;
    let traces = recipe.runs.iter().map(|run| plant.play(run)).collect::<Result<Vec<Trace>, String>>()?;
    Ok(plant.files(&traces))
}

fn true_values(recipe: &Recipe, device: &Device) -> Result<BTreeMap<String, f64>, String> {
    let mut values = BTreeMap::new();
    for (number, link) in (1..).zip(&device.links) {
        for (symbol, parameter) in Link::SYMBOLS.iter().zip(&link.inertial) {
            values.insert(format!("link.{number}.{symbol}"), parameter.value);
        }
    }
    for length in &device.lengths {
        values.insert(format!("length.{}", length.symbol), length.value);
    }
    for (axis, up) in ["x", "y", "z"].iter().zip(device.up) {
        values.insert(format!("base.g{axis}"), device.gravity * up);
    }
    for (name, value) in &recipe.parameters {
        match values.get_mut(name) {
            Some(slot) => *slot = *value,
            None => return Err(format!("the device has no parameter `{name}`")),
        }
    }
    Ok(values)
}

/// A recipe with its numbers put in, ready to be played.
#[derive(Debug)]
pub struct Plant<'a> {
    recipe: &'a Recipe,
    mechanism: Mechanism,
    effects: Vec<JointEffects>,
}

/// What one run did.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Commanded torque of every joint, a row per sample.
    pub commands: Vec<Vec<f64>>,
    /// What the encoders of the free joints would show without noise and quantisation, a row per sample.
    pub seen: Vec<Vec<f64>>,
}

impl<'a> Plant<'a> {
    /// Puts the recipe's numbers into `device`.
    pub fn new(recipe: &'a Recipe, device: &Device) -> Result<Self, String> {
        if recipe.device != device.id {
            return Err(format!("the recipe is for device `{}`, not `{}`", recipe.device, device.id));
        }
        if recipe.start.len() != device.joints.len() {
            return Err(format!("`start` has {} positions for {} joints", recipe.start.len(), device.joints.len()));
        }
        let effects = effects::by_joint(&recipe.effects, device.joints.len())?;
        let mut values = true_values(recipe, device)?;
        effects::carry(&effects, device, &mut values)?;
        let mechanism = Mechanism::new(device, &|name| values.get(name).copied().unwrap_or(f64::NAN));
        Ok(Self { recipe, mechanism, effects })
    }

    /// Plays one run.
    pub fn play(&self, run: &RunEntry) -> Result<Trace, String> {
        let n_joints = self.mechanism.n_joints();
        let named = run.free.iter().chain(run.torque.iter().map(|wave| &wave.joint));
        if let Some(joint) = named.copied().find(|&joint| joint >= n_joints) {
            return Err(format!("{}: the device has no joint {joint}", run.file));
        }
        let sample_s = self.recipe.sample_s;
        let n_rows = (run.duration_s / sample_s).round() as usize + 1;
        let commands: Vec<Vec<f64>> = (0..n_rows)
            .map(|row| (0..n_joints).map(|joint| command(run, joint, row as f64 * sample_s)).collect())
            .collect();
        let mut play = Play::new(self, &run.free);
        let mut seen = Vec::with_capacity(n_rows);
        for row in 0..n_rows {
            seen.push(play.seen());
            if row + 1 < n_rows {
                play.sample(&commands, row)?;
            }
        }
        Ok(Trace { commands, seen })
    }

    /// The logs that its runs leave, and `experiment.toml`.
    pub fn files(&self, traces: &[Trace]) -> Files {
        let recipe = self.recipe;
        let mut noise = Noise::new(recipe.seed);
        let mut files = Files::new();
        let mut experiment = format!(
            "# Made by dynid-plant: seed {}, position noise {} rms, quantum {}.\n\
             # tau is held from its row to the next. Every run starts at rest with undeflected bristles.\n\
             device = \"{}\"\n",
            recipe.seed, recipe.noise_rms, recipe.quantum, recipe.device
        );
        for (run, trace) in recipe.runs.iter().zip(traces) {
            let RunEntry { file, free, role, .. } = run;
            let _ = write!(experiment, "\n[[run]]\nfile = \"{file}\"\nfree = {free:?}\nrole = \"{role}\"\n");
            files.insert(file.clone(), self.log(run, trace, &mut noise));
        }
        files.insert("experiment.toml".to_owned(), experiment);
        files
    }

    /// The log that a run leaves.
    fn log(&self, run: &RunEntry, trace: &Trace, noise: &mut Noise) -> String {
        let recipe = self.recipe;
        let n_joints = self.mechanism.n_joints();
        let names = |kind: &str| (0..n_joints).map(|joint| format!(",{kind}{joint}")).collect::<String>();
        let mut log = format!("t{}{}\n", names("tau"), names("q"));
        for (row, (commands, seen)) in trace.commands.iter().zip(&trace.seen).enumerate() {
            let _ = write!(log, "{}", trimmed(row as f64 * recipe.sample_s, 6));
            for command in commands {
                let _ = write!(log, ",{}", trimmed(*command, 6));
            }
            for joint in 0..n_joints {
                // a locked joint is held by its brake: its encoder shows one angle
                let q = match run.free.iter().position(|&free| free == joint) {
                    Some(slot) => seen[slot] + recipe.noise_rms * noise.gaussian(),
                    None => self.effects[joint].seen(recipe.start[joint]),
                };
                let shown = if recipe.quantum > 0.0 { (q / recipe.quantum).round() * recipe.quantum } else { q };
                let _ = write!(log, ",{}", trimmed(shown, 9));
            }
            log.push('\n');
        }
        log
    }
}

/// Commanded torque, rounded as the log shows it.
fn command(run: &RunEntry, joint: usize, time: f64) -> f64 {
    let waves = run.torque.iter().filter(|wave| wave.joint == joint);
    let torque: f64 = waves
        .map(|wave| {
            let turns = (wave.hz + 0.5 * wave.hz_per_s * time) * time;
            wave.amplitude * (TAU * turns + wave.phase).cos()
        })
        .sum();
    (torque * 1e6).round() / 1e6
}

/// Fixed decimals without trailing zeros, and no `-0`.
fn trimmed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// Everything that moves.
struct Play<'a> {
    plant: &'a Plant<'a>,
    /// With the locked joints held.
    mechanism: Mechanism,
    free: &'a [usize],
    /// Positions and speeds of the free joints, then the states of all effects.
    state: Vec<f64>,
    /// What leaves the lag of every free joint's drive.
    lagged: Vec<f64>,
}

/// A stretch of time over which nothing arrives anew at any drive.
struct Stretch<'a> {
    /// s
    start: f64,
    /// As the log shows them.
    commands: &'a [f64],
    /// What enters the lag of every free joint's drive.
    entering: &'a [f64],
    /// What left the lag at the start.
    before: &'a [f64],
}

impl<'a> Play<'a> {
    fn new(plant: &'a Plant<'a>, free: &'a [usize]) -> Self {
        let n_states: usize = free.iter().map(|&joint| plant.effects[joint].n_states()).sum();
        let mut state = vec![0.0; 2 * free.len() + n_states];
        for (slot, &joint) in free.iter().enumerate() {
            state[slot] = plant.recipe.start[joint];
        }
        let mechanism = plant.mechanism.holding(free, &plant.recipe.start);
        Self { plant, mechanism, free, state, lagged: vec![0.0; free.len()] }
    }

    /// What the encoders would show without noise.
    fn seen(&self) -> Vec<f64> {
        self.free.iter().zip(&self.state).map(|(&joint, &q)| self.plant.effects[joint].seen(q)).collect()
    }

    /// From one row to the next, in stretches that end where a delayed command arrives: a staircase stays a staircase.
    fn sample(&mut self, commands: &[Vec<f64>], row: usize) -> Result<(), String> {
        let recipe = self.plant.recipe;
        let (sample_s, start) = (recipe.sample_s, row as f64 * recipe.sample_s);
        let mut ends: Vec<f64> =
            self.free.iter().map(|&joint| self.plant.effects[joint].drive.delay.rem_euclid(sample_s)).collect();
        ends.push(sample_s);
        ends.retain(|end| *end > 1e-9 * sample_s);
        ends.sort_by(f64::total_cmp);
        ends.dedup();
        let mut from = 0.0;
        for end in ends {
            let middle = start + 0.5 * (from + end);
            let entering: Vec<f64> = self
                .free
                .iter()
                .map(|&joint| {
                    let drive = &self.plant.effects[joint].drive;
                    let arrived = (middle - drive.delay) / sample_s;
                    // before the log its first command stands; the cast takes what is negative to row 0
                    drive.before_lag(commands[arrived as usize][joint])
                })
                .collect();
            let before = self.lagged.clone();
            let stretch =
                Stretch { start: start + from, commands: &commands[row], entering: &entering, before: &before };
            let steps = ((end - from) / sample_s * recipe.steps_per_sample as f64 - 1e-6).ceil().max(1.0);
            let step = (end - from) / steps;
            for k in 0..steps as usize {
                self.step(&stretch, k as f64 * step, step)?;
            }
            for (slot, &joint) in self.free.iter().enumerate() {
                self.lagged[slot] = self.plant.effects[joint].drive.lagged(before[slot], entering[slot], end - from);
            }
            from = end;
        }
        Ok(())
    }

    /// One step of the classical fourth-order Runge-Kutta method, `elapsed` seconds into the stretch.
    fn step(&mut self, stretch: &Stretch<'_>, elapsed: f64, step: f64) -> Result<(), String> {
        let state = &self.state;
        let ahead = |slope: &[f64], part: f64| -> Vec<f64> {
            state.iter().zip(slope).map(|(x, k)| x + part * step * k).collect()
        };
        let k1 = self.rates(state, stretch, elapsed)?;
        let k2 = self.rates(&ahead(&k1, 0.5), stretch, elapsed + 0.5 * step)?;
        let k3 = self.rates(&ahead(&k2, 0.5), stretch, elapsed + 0.5 * step)?;
        let k4 = self.rates(&ahead(&k3, 1.0), stretch, elapsed + step)?;
        for (index, x) in self.state.iter_mut().enumerate() {
            *x += step / 6.0 * (k1[index] + 2.0 * (k2[index] + k3[index]) + k4[index]);
        }
        Ok(())
    }

    fn rates(&self, state: &[f64], stretch: &Stretch<'_>, elapsed: f64) -> Result<Vec<f64>, String> {
        let n = self.free.len();
        let (mut q, mut dq) = (self.plant.recipe.start.clone(), vec![0.0; self.plant.recipe.start.len()]);
        for (slot, &joint) in self.free.iter().enumerate() {
            q[joint] = state[slot];
            dq[joint] = state[n + slot];
        }
        let (mut inertia, bias) = self.mechanism.inertia_and_bias(self.free, &q, &state[n..2 * n]);
        let mut rates = vec![0.0; state.len()];
        let mut force = DVector::zeros(n);
        let mut used = 2 * n;
        for (slot, &joint) in self.free.iter().enumerate() {
            let effects = &self.plant.effects[joint];
            let own = used..used + effects.n_states();
            used = own.end;
            let time = stretch.start + elapsed;
            let lagged = effects.drive.lagged(stretch.before[slot], stretch.entering[slot], elapsed);
            let motor = effects.drive.torque(lagged, stretch.commands, q[joint], time);
            let moment = Moment { joint, q: &q, dq: &dq, time, torque: motor, commands: stretch.commands };
            force[slot] = effects.torque(&moment, motor, &state[own.clone()], &mut rates[own]) - bias[slot];
            inertia[slot * n + slot] += effects.rotor_inertia;
            for &(other, rotor) in &effects.rotor_couplings {
                if let Some(other) = self.free.iter().position(|&free| free == other) {
                    inertia[slot * n + other] += rotor;
                    inertia[other * n + slot] += rotor;
                }
            }
        }
        let factors = DMatrix::from_row_slice(n, n, &inertia)
            .cholesky()
            .ok_or("the inertia matrix is not positive: no body has these parameters")?;
        let acceleration = factors.solve(&force);
        if !acceleration.iter().all(|a| a.is_finite()) {
            return Err("the motion diverges: take more steps per sample".to_owned());
        }
        rates[..n].copy_from_slice(&state[n..2 * n]);
        rates[n..2 * n].copy_from_slice(acceleration.as_slice());
        Ok(rates)
    }
}

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
//!
//! In closed loop a [`Controller`] moves the machine along a run's `reference`, which is written as `torque` is and counts
//! from the start; the log then holds what it commanded.

mod controller;

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt::Write;

use dynid_model::{Device, Link};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::Mechanism;
use crate::effects::{self, EffectEntry, JointEffects, Moment};
use crate::random::Noise;

pub use controller::Controller;
use controller::Loop;

/// What to make.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
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
    /// Standard deviation of the noise of the logged torques of free joints, one entry a joint (N*m or N); empty for none.
    #[serde(default)]
    pub torque_noise_rms: Vec<f64>,
    /// What moves the machine in runs that have a reference.
    #[serde(default)]
    pub controller: Option<Controller>,
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
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
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
    #[serde(default)]
    pub torque: Vec<Cosine>,
    /// Sum of cosines per joint that the controller follows, from the start on; with one, `torque` is not played.
    #[serde(default)]
    pub reference: Vec<Cosine>,
    /// Effects that the machine has in this run alone.
    #[serde(default, rename = "effect")]
    pub effects: Vec<EffectEntry>,
}

impl RunEntry {
    /// Whether the controller moves the machine.
    pub fn is_closed_loop(&self) -> bool {
        !self.reference.is_empty()
    }
}

/// `amplitude * cos(2 pi (hz + hz_per_s / 2 * t) t + phase)` at one joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cosine {
    /// The joint commanded.
    pub joint: usize,
    /// N*m or N; of a reference, rad or m.
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
    machine: Machine,
    /// As it is in runs that have effects of their own, by number of the run.
    altered: BTreeMap<usize, Machine>,
}

/// The device with its numbers, and its effects.
#[derive(Debug)]
struct Machine {
    mechanism: Mechanism,
    effects: Vec<JointEffects>,
}

impl Machine {
    fn new(recipe: &Recipe, device: &Device, entries: &[EffectEntry]) -> Result<Self, String> {
        let effects = effects::by_joint(entries, device.joints.len())?;
        let mut values = true_values(recipe, device)?;
        effects::carry(&effects, device, &mut values)?;
        let mechanism = Mechanism::new(device, &|name| values.get(name).copied().unwrap_or(f64::NAN));
        Ok(Self { mechanism, effects })
    }
}

/// What one run did.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Commanded torque of every joint, a row per sample.
    pub commands: Vec<Vec<f64>>,
    /// What the encoders of the free joints would show without noise and quantisation, a row per sample.
    pub seen: Vec<Vec<f64>>,
    /// What they showed to the controller, a row per sample; empty in open loop, where nothing depends on it.
    pub shown: Vec<Vec<f64>>,
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
        let n_joints = device.joints.len();
        if let Some(controller) = &recipe.controller {
            controller.check(n_joints)?;
        }
        if ![0, n_joints].contains(&recipe.torque_noise_rms.len()) {
            return Err(format!(
                "`torque_noise_rms` has {} values for {n_joints} joints",
                recipe.torque_noise_rms.len()
            ));
        }
        let mut altered = BTreeMap::new();
        for (number, run) in recipe.runs.iter().enumerate().filter(|(_, run)| !run.effects.is_empty()) {
            let entries: Vec<EffectEntry> = recipe.effects.iter().chain(&run.effects).cloned().collect();
            altered.insert(number, Machine::new(recipe, device, &entries)?);
        }
        Ok(Self { recipe, machine: Machine::new(recipe, device, &recipe.effects)?, altered })
    }

    /// Plays one run.
    pub fn play(&self, run: &RunEntry) -> Result<Trace, String> {
        let n_joints = self.machine.mechanism.n_joints();
        let waves = run.torque.iter().chain(&run.reference);
        let named = run.free.iter().chain(waves.map(|wave| &wave.joint));
        if let Some(joint) = named.copied().find(|&joint| joint >= n_joints) {
            return Err(format!("{}: the device has no joint {joint}", run.file));
        }
        let recipe = self.recipe;
        let number = recipe.runs.iter().position(|own| own.file == run.file).unwrap_or_default();
        let mut control = match &recipe.controller {
            Some(controller) if run.is_closed_loop() => {
                Some((Loop::new(controller, &run.free), Noise::new(recipe.seed ^ ((number as u64 + 1) << 48))))
            }
            None if run.is_closed_loop() => return Err(format!("{}: the recipe has no `controller`", run.file)),
            _ => None,
        };
        let n_rows = (run.duration_s / recipe.sample_s).round() as usize + 1;
        let mut play = Play::new(recipe, self.machine_of(run), &run.free);
        let mut trace = Trace { commands: Vec::with_capacity(n_rows), seen: Vec::new(), shown: Vec::new() };
        for row in 0..n_rows {
            let time = row as f64 * recipe.sample_s;
            let seen = play.seen();
            trace.commands.push(match &mut control {
                Some((control, noise)) => {
                    let shown: Vec<f64> = seen.iter().map(|q| recipe.encoder(*q, noise)).collect();
                    let reference: Vec<f64> = (0..n_joints).map(|joint| recipe.reference(run, joint, time)).collect();
                    let commands = control.command(recipe.sample_s, &reference, &shown, n_joints);
                    trace.shown.push(shown);
                    commands
                }
                None => (0..n_joints).map(|joint| sum(&run.torque, joint, time)).map(as_logged).collect(),
            });
            trace.seen.push(seen);
            if row + 1 < n_rows {
                play.sample(&trace.commands, row)?;
            }
        }
        Ok(trace)
    }

    /// The fastest rate (1/s) at which the free joints' motion and states relax or turn, about the start at rest: what a step
    /// of the integration has to resolve.
    ///
    /// # Errors
    /// A machine that cannot be played.
    pub fn fastest_rate(&self, free: &[usize]) -> Result<f64, String> {
        Play::new(self.recipe, &self.machine, free).fastest_rate()
    }

    /// The diagonal of the inertia matrix at the start, rotors included: one entry a free joint.
    pub fn inertia_at_start(&self, free: &[usize]) -> Vec<f64> {
        let n = free.len();
        let (inertia, _) = self.machine.mechanism.inertia_and_bias(free, &self.recipe.start, &vec![0.0; n]);
        free.iter()
            .enumerate()
            .map(|(slot, &joint)| inertia[slot * n + slot] + self.machine.effects[joint].rotor_inertia)
            .collect()
    }

    fn machine_of(&self, run: &RunEntry) -> &Machine {
        let number = self.recipe.runs.iter().position(|own| own.file == run.file);
        number.and_then(|number| self.altered.get(&number)).unwrap_or(&self.machine)
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
            if let (Some(controller), true) = (&recipe.controller, run.is_closed_loop()) {
                experiment.push_str("controller = \"controller.toml\"\n");
                files.insert("controller.toml".to_owned(), controller.file(recipe.quantum));
            }
            files.insert(file.clone(), self.log(run, trace, &mut noise));
        }
        files.insert("experiment.toml".to_owned(), experiment);
        files
    }

    /// The log that a run leaves.
    fn log(&self, run: &RunEntry, trace: &Trace, noise: &mut Noise) -> String {
        let recipe = self.recipe;
        let n_joints = self.machine.mechanism.n_joints();
        let names = |kind: &str| (0..n_joints).map(|joint| format!(",{kind}{joint}")).collect::<String>();
        let references = if run.is_closed_loop() { names("ref") } else { String::new() };
        let mut log = format!("t{}{}{references}\n", names("tau"), names("q"));
        for (row, (commands, seen)) in trace.commands.iter().zip(&trace.seen).enumerate() {
            let time = row as f64 * recipe.sample_s;
            let _ = write!(log, "{}", trimmed(time, 6));
            for (joint, command) in commands.iter().enumerate() {
                let noise = match recipe.torque_noise_rms.get(joint) {
                    Some(rms) if run.free.contains(&joint) => rms * noise.gaussian(),
                    _ => 0.0,
                };
                let _ = write!(log, ",{}", trimmed(command + noise, 6));
            }
            for joint in 0..n_joints {
                // a locked joint is held by its brake: its encoder shows one angle
                let shown = match run.free.iter().position(|&free| free == joint) {
                    Some(slot) => match trace.shown.get(row) {
                        Some(shown) => shown[slot],
                        None => recipe.encoder(seen[slot], noise),
                    },
                    None => recipe.rounded(self.machine.effects[joint].seen(recipe.start[joint])),
                };
                let _ = write!(log, ",{}", trimmed(shown, 9));
            }
            if run.is_closed_loop() {
                for joint in 0..n_joints {
                    let _ = write!(log, ",{}", trimmed(recipe.reference(run, joint, time), 9));
                }
            }
            log.push('\n');
        }
        log
    }
}

impl Recipe {
    /// What an encoder shows of a position.
    fn encoder(&self, q: f64, noise: &mut Noise) -> f64 {
        self.rounded(q + self.noise_rms * noise.gaussian())
    }

    fn rounded(&self, q: f64) -> f64 {
        if self.quantum > 0.0 { (q / self.quantum).round() * self.quantum } else { q }
    }

    /// Where the controller is to bring a joint.
    fn reference(&self, run: &RunEntry, joint: usize, time: f64) -> f64 {
        self.start[joint] + sum(&run.reference, joint, time)
    }
}

fn sum(waves: &[Cosine], joint: usize, time: f64) -> f64 {
    let waves = waves.iter().filter(|wave| wave.joint == joint);
    waves
        .map(|wave| {
            let turns = (wave.hz + 0.5 * wave.hz_per_s * time) * time;
            wave.amplitude * (TAU * turns + wave.phase).cos()
        })
        .sum()
}

/// Torques are rounded as the log shows them.
fn as_logged(torque: f64) -> f64 {
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
    recipe: &'a Recipe,
    effects: &'a [JointEffects],
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
    fn new(recipe: &'a Recipe, machine: &'a Machine, free: &'a [usize]) -> Self {
        let effects = &machine.effects;
        let n_states: usize = free.iter().map(|&joint| effects[joint].n_states()).sum();
        let mut state = vec![0.0; 2 * free.len() + n_states];
        for (slot, &joint) in free.iter().enumerate() {
            state[slot] = recipe.start[joint];
        }
        let mechanism = machine.mechanism.holding(free, &recipe.start);
        Self { recipe, effects, mechanism, free, state, lagged: vec![0.0; free.len()] }
    }

    /// Of the linearised motion, by differences.
    fn fastest_rate(&self) -> Result<f64, String> {
        const NUDGE: f64 = 1e-6;
        let still = vec![0.0; self.effects.len()];
        let nothing = vec![0.0; self.free.len()];
        let stretch = Stretch { start: 0.0, commands: &still, entering: &nothing, before: &nothing };
        let n = self.state.len();
        let mut jacobian = DMatrix::zeros(n, n);
        for column in 0..n {
            let at = |by: f64| {
                let mut state = self.state.clone();
                state[column] += by;
                self.rates(&state, &stretch, 0.0)
            };
            let (after, before) = (at(NUDGE)?, at(-NUDGE)?);
            for row in 0..n {
                jacobian[(row, column)] = (after[row] - before[row]) / (2.0 * NUDGE);
            }
        }
        Ok(jacobian.complex_eigenvalues().iter().map(|value| value.norm()).fold(0.0, f64::max))
    }

    /// What the encoders would show without noise.
    fn seen(&self) -> Vec<f64> {
        self.free.iter().zip(&self.state).map(|(&joint, &q)| self.effects[joint].seen(q)).collect()
    }

    /// From one row to the next, in stretches that end where a delayed command arrives: a staircase stays a staircase.
    fn sample(&mut self, commands: &[Vec<f64>], row: usize) -> Result<(), String> {
        let recipe = self.recipe;
        let (sample_s, start) = (recipe.sample_s, row as f64 * recipe.sample_s);
        let mut ends: Vec<f64> =
            self.free.iter().map(|&joint| self.effects[joint].drive.delay.rem_euclid(sample_s)).collect();
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
                    let drive = &self.effects[joint].drive;
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
                self.lagged[slot] = self.effects[joint].drive.lagged(before[slot], entering[slot], end - from);
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
        let (mut q, mut dq) = (self.recipe.start.clone(), vec![0.0; self.recipe.start.len()]);
        for (slot, &joint) in self.free.iter().enumerate() {
            q[joint] = state[slot];
            dq[joint] = state[n + slot];
        }
        let (mut inertia, bias) = self.mechanism.inertia_and_bias(self.free, &q, &state[n..2 * n]);
        let mut rates = vec![0.0; state.len()];
        let mut force = DVector::zeros(n);
        let mut used = 2 * n;
        for (slot, &joint) in self.free.iter().enumerate() {
            let effects = &self.effects[joint];
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

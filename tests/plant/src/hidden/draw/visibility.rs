//! How much the logs show of a hidden effect.
//!
//! The measure is a proxy, made of a window at the beginning of the first run, played without noise:
//!
//! - In open loop the signal is the position of each free joint, over the standard deviation of a logged position.
//! - In closed loop it is the torque of each free joint, over the standard deviation of a torque error in a band of 10 Hz:
//!   the noise of the logged torque, and the acceleration that position noise fakes there, times the joint's inertia. One
//!   sample counts as `2 * 10 Hz / rate` independent ones.
//!
//! `d` is the signal's derivative by the effect's amplitude (its values are moved away from the one that does nothing by 2 %
//! of their distance to it), in units of the amplitude. From it the derivatives by the values of the model's own effects at the same joint are
//! projected out, but not those by links, nor by other joints' effects. The norm of what is left, times the root of how many windows the fitted runs
//! hold, is by how many standard errors the amplitude differs from nothing.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::belief::{self, Gains};
use super::instrument::{Drive, Instrument};
use super::machine::Machine;
use crate::effects::EffectEntry;
use crate::hidden::is_numerical;
use crate::recipe::{Plant, Recipe, RunEntry, Trace};

/// At least so many standard errors of the amplitude show an effect.
pub const SHOWS: f64 = 5.0;

/// How much the logs show of a hidden effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Visibility {
    /// How far the effect moves each free joint: root mean square over the noise.
    pub moves_by_noises: Vec<f64>,
    /// By how many standard errors the effect's amplitude differs from nothing.
    pub standard_errors: f64,
    /// Whether these are at least [`SHOWS`].
    pub shows: bool,
}

/// A part of a run, played by machines that differ a little.
pub(super) struct Window<'a> {
    machine: &'a Machine,
    instrument: &'a Instrument,
    gains: Gains,
    recipe: Recipe,
    run: RunEntry,
    /// Standard deviation of the signal of each free joint; in closed loop as if its samples were independent.
    deviations: Vec<f64>,
}

/// Relative change of values for a derivative.
const STEP: f64 = 0.02;
/// In strokes.
const FARTHEST: f64 = 16.0;
/// Of the torque error (Hz).
const BAND_HZ: f64 = 10.0;

impl<'a> Window<'a> {
    /// Of the first run of `recipe`.
    pub(super) fn new(
        recipe: &Recipe,
        machine: &'a Machine,
        instrument: &'a Instrument,
        gains: Gains,
        inertia: &[f64],
    ) -> Self {
        let longest_s = match machine.free.len() {
            0..=2 => 15.0,
            3..=4 => 8.0,
            _ => 5.0,
        };
        let mut run = recipe.runs[0].clone();
        run.effects.clear();
        run.duration_s = run.duration_s.min(longest_s);
        let floor = instrument.noise_floor();
        let band_hz = BAND_HZ.min(0.25 * instrument.rate_hz);
        let independent = (2.0 * band_hz / instrument.rate_hz).min(1.0);
        let faked = (TAU * band_hz).powi(2) * floor * (independent / 5.0).sqrt();
        let deviations = machine.free.iter().zip(inertia).map(|(&joint, inertia)| match machine.drive {
            Drive::OpenLoop => floor,
            Drive::ClosedLoop => {
                let logged = recipe.torque_noise_rms.get(joint).copied().unwrap_or(0.0);
                (logged.powi(2) + (inertia * faked).powi(2)).sqrt() / independent.sqrt()
            }
        });
        let deviations = deviations.collect();
        let recipe = Recipe {
            noise_rms: 0.0,
            quantum: 0.0,
            torque_noise_rms: Vec::new(),
            runs: vec![run.clone()],
            ..recipe.clone()
        };
        Self { machine, instrument, gains, recipe, run, deviations }
    }

    /// Of `hidden`, which is one of the effects of the machine `with`; `without` is the machine without it.
    pub(super) fn visibility(
        &self,
        hidden: &EffectEntry,
        with: &[EffectEntry],
        without: &[EffectEntry],
    ) -> Result<Visibility, String> {
        let base = self.play(with)?;
        self.check(&base)?;
        let other = self.play(without)?;
        let moves_by_noises = (0..self.machine.free.len())
            .map(|slot| {
                let squares = base.seen.iter().zip(&other.seen).map(|(one, other)| (one[slot] - other[slot]).powi(2));
                (squares.sum::<f64>() / base.seen.len() as f64).sqrt() / self.instrument.noise_floor()
            })
            .collect();
        let mut slope = self.slope_by_amplitude(&base, hidden, with)?;
        let mut directions: Vec<Vec<f64>> = Vec::new();
        for own in with.iter().filter(|own| own.joint == hidden.joint && *own != hidden) {
            for (symbol, value) in &own.values {
                let is_open = !is_numerical(&own.id, symbol)
                    && dynid_model::effect(&own.id).is_some()
                    && !belief::is_fixed(self.machine, own, symbol, self.gains);
                if is_open && *value != 0.0 {
                    let rate = |entry: &EffectEntry, other: &str, value: f64| {
                        if entry == own && other == symbol { value } else { 0.0 }
                    };
                    let mut direction = self.slope(&base, with, &rate)?;
                    directions.iter().for_each(|earlier| project_out(&mut direction, earlier));
                    directions.push(direction);
                }
            }
        }
        directions.iter().for_each(|direction| project_out(&mut slope, direction));
        let windows = self.instrument.fitted_s() / self.run.duration_s;
        let standard_errors = norm(&slope) * windows.sqrt();
        Ok(Visibility { moves_by_noises, standard_errors, shows: standard_errors >= SHOWS })
    }

    /// The machine stays about where it is meant to move.
    fn check(&self, trace: &Trace) -> Result<(), String> {
        for (slot, &joint) in self.machine.free.iter().enumerate() {
            let farthest = trace.seen.iter().map(|row| (row[slot] - trace.seen[0][slot]).abs()).fold(0.0, f64::max);
            if farthest > FARTHEST * self.machine.strokes[joint] {
                return Err(format!("joint {joint} runs away"));
            }
        }
        Ok(())
    }

    /// Derivative of the signals by the amplitude of an effect, in units of it.
    fn slope_by_amplitude(
        &self,
        base: &Trace,
        hidden: &EffectEntry,
        entries: &[EffectEntry],
    ) -> Result<Vec<f64>, String> {
        self.slope(base, entries, &|entry, symbol, value| {
            if entry == hidden { distance(&entry.id, symbol, value) } else { 0.0 }
        })
    }

    /// Derivative of the signals by all values at once, each moving at its own rate.
    fn slope(
        &self,
        base: &Trace,
        entries: &[EffectEntry],
        rate: &dyn Fn(&EffectEntry, &str, f64) -> f64,
    ) -> Result<Vec<f64>, String> {
        let mut moved = entries.to_vec();
        for (moved, entry) in moved.iter_mut().zip(entries) {
            for (symbol, value) in &mut moved.values {
                *value += STEP * rate(entry, symbol, *value);
            }
        }
        let (base, moved) = (self.signals(base), self.signals(&self.play(&moved)?));
        Ok(moved.iter().zip(&base).map(|(one, other)| (one - other) / STEP).collect())
    }

    fn play(&self, effects: &[EffectEntry]) -> Result<Trace, String> {
        let recipe = Recipe { effects: effects.to_vec(), ..self.recipe.clone() };
        Plant::new(&recipe, self.machine.device)?.play(&self.run)
    }

    /// Over their standard deviations.
    fn signals(&self, trace: &Trace) -> Vec<f64> {
        let mut signals = Vec::new();
        for (slot, (&joint, deviation)) in self.machine.free.iter().zip(&self.deviations).enumerate() {
            match self.machine.drive {
                Drive::OpenLoop => signals.extend(trace.seen.iter().map(|row| row[slot] / deviation)),
                Drive::ClosedLoop => signals.extend(trace.commands.iter().map(|row| row[joint] / deviation)),
            }
        }
        signals
    }
}

/// From the value that does nothing; a value without one, or with one at infinity, counts from 0. Joints, and the values of laws
/// outside of the library that are no size, do not move.
fn distance(id: &str, symbol: &str, value: f64) -> f64 {
    let Some(effect) = dynid_model::effect(id) else {
        return if ["other", "v_eps", "q0", "k", "hz", "period", "growth", "tau"].contains(&symbol) {
            0.0
        } else {
            value
        };
    };
    let has_null = |symbol: &str| effect.parameter(symbol).is_some_and(|parameter| parameter.null.is_some());
    let null = effect.parameter(symbol).and_then(|parameter| parameter.null);
    match null.filter(|null| null.abs() < 10.0 * value.abs().max(1.0)) {
        Some(null) => value - null,
        None if has_null(symbol) => value,
        // A rest position, a period, a speed: no amplitude.
        None => 0.0,
    }
}

fn project_out(vector: &mut [f64], direction: &[f64]) {
    let square: f64 = direction.iter().map(|x| x * x).sum();
    if square > 0.0 {
        let share = vector.iter().zip(direction).map(|(one, other)| one * other).sum::<f64>() / square;
        vector.iter_mut().zip(direction).for_each(|(x, other)| *x -= share * other);
    }
}

fn norm(vector: &[f64]) -> f64 {
    vector.iter().map(|x| x * x).sum::<f64>().sqrt()
}

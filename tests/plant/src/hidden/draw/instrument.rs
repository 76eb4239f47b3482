//! How a case is measured.

use serde::{Deserialize, Serialize};

use super::dice::Dice;
use crate::hidden::rounded;

/// What moves the machine while it is logged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Drive {
    /// Commands that were made before.
    OpenLoop,
    /// A controller.
    ClosedLoop,
}

/// How a case is measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Instrument {
    /// Samples a second.
    pub rate_hz: f64,
    /// Standard deviation of the position noise (rad or m).
    pub noise_rms: f64,
    /// Logged positions are multiples of this (rad or m); 0 for none.
    pub quantum: f64,
    /// Of each run (s).
    pub duration_s: f64,
    /// With one run none is held out.
    pub n_runs: usize,
    /// What moves the machine.
    pub drive: Drive,
    /// Noise of the logged torques, as a share of what a joint is commanded (rms).
    pub torque_noise: f64,
    /// Torques are logged with an offset and in a unit that is not quite known.
    pub torque_is_scaled: bool,
}

/// More rows than this has no experiment: longer runs are cut.
const ROWS: f64 = 150_000.0;
/// Shortest run (s).
const SHORTEST_S: f64 = 6.0;
const NICE_HZ: [f64; 7] = [50.0, 100.0, 125.0, 200.0, 250.0, 500.0, 1000.0];

impl Instrument {
    /// Of a machine of so many free joints, whose joints move about so far (rad or m), in one run at least.
    pub(super) fn draw(dice: &mut Dice, drive: Drive, n_free: usize, stroke: f64, at_least: usize) -> Self {
        let rate_hz = if dice.chance(0.5) { *dice.pick(&NICE_HZ) } else { dice.log(50.0, 1000.0) };
        // A position that drowns in noise is no measurement.
        let largest = f64::min(2e-3, stroke / 40.0);
        let noise_rms = dice.log(1e-5, largest);
        let quantum = if dice.chance(0.4) { 0.0 } else { dice.log(1e-5, largest) };
        let n_runs = (1 + dice.below(6)).max(at_least);
        // Large arms are simulated for minutes otherwise, by the plant as by the program.
        let longest_s = if n_free > 3 { 120.0 } else { 360.0 };
        let longest_s = f64::min(longest_s, ROWS / rate_hz) / n_runs as f64;
        let duration_s = dice.log(SHORTEST_S, 120.0).min(longest_s).max(SHORTEST_S);
        let is_measured = drive == Drive::ClosedLoop && dice.chance(0.5);
        Self {
            rate_hz,
            noise_rms,
            quantum,
            duration_s: rounded((duration_s * rate_hz).round() / rate_hz),
            n_runs,
            drive,
            torque_noise: if is_measured { dice.log(2e-3, 5e-2) } else { 0.0 },
            torque_is_scaled: is_measured && dice.chance(0.6),
        }
    }

    /// Standard deviation of what the logs show of a position that stands still.
    pub fn noise_floor(&self) -> f64 {
        (self.noise_rms * self.noise_rms + self.quantum * self.quantum / 12.0).sqrt()
    }

    /// Seconds of the runs that are fitted to.
    pub(super) fn fitted_s(&self) -> f64 {
        self.duration_s * (self.n_runs - self.n_held_out()) as f64
    }

    /// Runs that are held out, the last ones: a third, one at least unless there is only one run.
    pub(super) fn n_held_out(&self) -> usize {
        if self.n_runs == 1 { 0 } else { self.n_runs.div_ceil(3) }
    }
}

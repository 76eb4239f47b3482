//! From the command to the motor's torque: `command -> delay -> dead zone -> saturation -> lag -> offset -> coupling ->
//! gain`. The command is a staircase, so between two of its steps everything up to the lag is known exactly: the lag
//! approaches its input as `exp(-t/tau)`.

use super::Values;

/// The drive of one joint.
#[derive(Debug, Clone, Default)]
pub struct Drive {
    /// How late the command arrives (s).
    pub delay: f64,
    distortion: Option<Distortion>,
    dead_zone: f64,
    saturation: Option<f64>,
    /// Time constant (s); 0 for none.
    lag: f64,
    offset: f64,
    /// (from, gain)
    couplings: Vec<(usize, f64)>,
    gain: Option<f64>,
    modulation: Option<Modulation>,
}

/// A bent characteristic of the amplifier, outside of the library.
#[derive(Debug, Clone, Copy)]
enum Distortion {
    /// `c + k3 c^3`
    Cubic { k3: f64 },
    /// `sign(c) sqrt(c0 |c|)`: equal to `c` at `c0`.
    Root { c0: f64 },
}

/// A gain that is not constant, outside of the library.
#[derive(Debug, Clone, Copy)]
enum Modulation {
    /// `1 + a sin(k q)`
    Position { a: f64, k: f64 },
    /// `1 - a (1 - exp(-t/tau))`
    Droop { a: f64, tau: f64 },
}

impl Drive {
    /// Takes up an effect of the drive; false for one that is none.
    pub(super) fn read(&mut self, id: &str, values: &Values<'_>) -> Result<bool, String> {
        let value = |symbol: &str| values.get(symbol);
        match id {
            "gain" => self.gain = Some(value("Kp")?),
            "torque_offset" => self.offset += value("offset")?,
            "input_coupling" => self.couplings.push((values.from()?, value("gain")?)),
            "input_delay" => self.delay += value("delay")?,
            "dead_zone" => self.dead_zone = value("width")?,
            "saturation" => self.saturation = Some(value("limit")?),
            "input_lag" => self.lag = value("T")?,
            "command_cubic" => self.distortion = Some(Distortion::Cubic { k3: value("k3")? }),
            "command_root" => self.distortion = Some(Distortion::Root { c0: value("c0")? }),
            "gain_ripple" => self.modulation = Some(Modulation::Position { a: value("a")?, k: value("k")? }),
            "gain_droop" => self.modulation = Some(Modulation::Droop { a: value("a")?, tau: value("tau")? }),
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// What enters the lag when `command` has arrived.
    pub fn before_lag(&self, command: f64) -> f64 {
        let bent = match self.distortion {
            None => command,
            Some(Distortion::Cubic { k3 }) => command + k3 * command * command * command,
            Some(Distortion::Root { c0 }) => (c0 * command.abs()).sqrt().copysign(command),
        };
        let passed = if bent.abs() <= self.dead_zone { 0.0 } else { bent - self.dead_zone.copysign(bent) };
        match self.saturation {
            Some(limit) => passed.clamp(-limit, limit),
            None => passed,
        }
    }

    /// What leaves the lag `elapsed` seconds after it stood at `before`, its input being `target` all the while.
    pub fn lagged(&self, before: f64, target: f64, elapsed: f64) -> f64 {
        if self.lag > 0.0 { target + (before - target) * (-elapsed / self.lag).exp() } else { target }
    }

    /// The motor's torque, from what leaves the lag. `commands` are all joints', as logged; `q` is the joint's.
    pub fn torque(&self, lagged: f64, commands: &[f64], q: f64, time: f64) -> f64 {
        let coupled: f64 = self.couplings.iter().map(|&(from, gain)| gain * commands[from]).sum();
        let factor = match self.modulation {
            None => 1.0,
            Some(Modulation::Position { a, k }) => 1.0 + a * (k * q).sin(),
            Some(Modulation::Droop { a, tau }) => 1.0 - a * (1.0 - (-time / tau).exp()),
        };
        self.gain.unwrap_or(1.0) * factor * (lagged + self.offset + coupled)
    }
}

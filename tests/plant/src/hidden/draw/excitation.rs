//! What a machine is made to do.

use std::f64::consts::{FRAC_PI_2, TAU};

use super::dice::Dice;
use super::instrument::{Drive, Instrument};
use super::machine::Machine;
use crate::hidden::rounded;
use crate::recipe::{Controller, Cosine, RunEntry};

/// All runs; the last ones are held out.
pub(super) fn runs(machine: &Machine, instrument: &Instrument, dice: &mut Dice) -> Vec<RunEntry> {
    let n_fitted = instrument.n_runs - instrument.n_held_out();
    (1..=instrument.n_runs)
        .map(|number| {
            let role = if number <= n_fitted { "fit" } else { "validate" };
            let (torque, reference) = match machine.drive {
                Drive::OpenLoop => (commands(machine, instrument, dice), Vec::new()),
                Drive::ClosedLoop => (Vec::new(), references(machine, instrument, dice)),
            };
            RunEntry {
                file: format!("run-{number}.csv"),
                free: machine.free.clone(),
                role: role.to_owned(),
                duration_s: instrument.duration_s,
                torque,
                reference,
                ..RunEntry::default()
            }
        })
        .collect()
}

/// Sines from slow to fast, one in three runs with one that sweeps; all begin at zero.
fn commands(machine: &Machine, instrument: &Instrument, dice: &mut Dice) -> Vec<Cosine> {
    let drive = dice.log(0.75, 1.25);
    let is_swept = dice.chance(0.33);
    let [(slowest, _), .., (fastest, _)] = machine.habits.waves;
    let mut waves = Vec::new();
    for &joint in &machine.free {
        for (index, (hz, share)) in machine.habits.waves.into_iter().enumerate() {
            let size = drive * machine.habits.command[joint] * share * dice.between(0.7, 1.3);
            let hz = dice.log(hz / 1.3, hz * 1.3).max(0.7 / instrument.duration_s);
            let mut wave = wave(joint, size, hz, dice);
            if index == 2 && is_swept {
                (wave.hz, wave.amplitude) = (slowest, rounded(1.6 * wave.amplitude));
                wave.hz_per_s = rounded((fastest - slowest) / instrument.duration_s);
            }
            waves.push(wave);
        }
    }
    waves
}

/// Sines whose speeds are alike, so that the slow ones go far.
fn references(machine: &Machine, instrument: &Instrument, dice: &mut Dice) -> Vec<Cosine> {
    let mut waves = Vec::new();
    let slowest = f64::max(0.08, 0.8 / instrument.duration_s);
    for &joint in &machine.free {
        for _ in 0..3 + dice.below(3) {
            let hz = dice.log(slowest, 1.3);
            let size = machine.strokes[joint] * dice.between(0.3, 0.6) / (1.0 + hz / 0.4);
            waves.push(wave(joint, size, hz, dice));
        }
    }
    waves
}

fn wave(joint: usize, amplitude: f64, hz: f64, dice: &mut Dice) -> Cosine {
    Cosine { joint, amplitude: rounded(amplitude), hz: rounded(hz), hz_per_s: 0.0, phase: dice.sign() * FRAC_PI_2 }
}

/// Gains that answer within what the sampling allows; `inertia` is of the free joints.
pub(super) fn controller(machine: &Machine, instrument: &Instrument, inertia: &[f64], dice: &mut Dice) -> Controller {
    let bandwidth_hz = f64::min(instrument.rate_hz / 30.0, 2.5) * dice.between(0.7, 1.2);
    let turning = TAU * bandwidth_hz;
    let n_joints = machine.device.joints.len();
    let mut gains = Controller {
        proportional: vec![0.0; n_joints],
        derivative: vec![0.0; n_joints],
        smoothing: rounded(
            (-TAU * f64::min(10.0 * bandwidth_hz, 0.25 * instrument.rate_hz) / instrument.rate_hz).exp(),
        ),
    };
    for (&joint, inertia) in machine.free.iter().zip(inertia) {
        let own = machine.effects.iter().find(|entry| entry.id == "gain" && entry.joint == joint);
        let gain = own.map_or(1.0, |own| own.values["Kp"]);
        gains.proportional[joint] = rounded(inertia * turning * turning / gain);
        gains.derivative[joint] = rounded(1.4 * inertia * turning / gain);
    }
    gains
}

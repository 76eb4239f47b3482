//! `dynid excite --between`: the torques that tell two rival models apart.

use std::path::PathBuf;

use anyhow::bail;
use dynid_excite::{
    Excitation,
    between::{self, Between, ExpectedRatio, Rivals, Settings},
    fourier::Limits,
};
use dynid_format::number;
use dynid_model::{Device, Quantity};
use dynid_user_model::Model;
use serde_json::{Value, json};

use super::{Arguments, Kind, Planned, per_joint, unit};

/// What the torques tell, and of what.
pub struct Ratio {
    models: [String; 2],
    expected: ExpectedRatio,
    noise: Vec<f64>,
}

/// The two models of `--between`; `None` where it is not given.
pub fn rivals(paths: &[PathBuf]) -> anyhow::Result<Option<[Model; 2]>> {
    let [a, b] = paths else { return Ok(None) };
    let rivals = [Model::load(a)?, Model::load(b)?];
    let [of_a, of_b] = &rivals;
    if !of_a.device.is_same_as(of_b.device) {
        bail!(
            "{} is a model of device `{}`, {} of `{}`; give two of one device",
            a.display(),
            of_a.device.id,
            b.display(),
            of_b.device.id
        );
    }
    Ok(Some(rivals))
}

/// The torques, and the motion that the first model expects.
pub fn planned(
    arguments: &Arguments,
    [a, b]: &[Model; 2],
    free: &[usize],
    pose: Vec<f64>,
    limits: &Limits,
    (duration_s, sample_s): (f64, f64),
) -> anyhow::Result<Planned> {
    if arguments.quantity == Some(Kind::Reference) {
        bail!("--as reference: --between plays torques, open loop; leave --as out");
    }
    if arguments.harmonics < 2 {
        bail!("--harmonics {}: expected at least 2", arguments.harmonics);
    }
    super::check_nyquist(arguments.harmonics as f64 / arguments.period, sample_s)?;
    let noise = match per_joint("position-noise", &arguments.position_noise, free.len())? {
        Some(noise) => match noise.iter().find(|noise| !(**noise > 0.0 && noise.is_finite())) {
            Some(wrong) => bail!("--position-noise {wrong}: expected a positive number"),
            None => noise,
        },
        None => limits.position.iter().map(|range| assumed(*range)).collect(),
    };
    let settings = Settings {
        period_s: arguments.period,
        harmonics: arguments.harmonics,
        duration_s,
        sample_s,
        noise: noise.clone(),
        evaluations: arguments.evaluations,
        seed: arguments.seed,
    };
    let Between { time, command, motion, expected } =
        between::optimised(&Rivals { a, b, free, pose: &pose }, limits, &settings)?;
    let mut excitation = Excitation::still(Quantity::Torque, free, &pose, time);
    for (&joint, command) in free.iter().zip(command) {
        excitation.values[joint] = command;
    }
    let title = format!(
        "{} harmonics of 1/{} Hz between two models, seed {}",
        arguments.harmonics, arguments.period, arguments.seed
    );
    let models = [0, 1].map(|index: usize| arguments.between[index].display().to_string());
    let ratio = Some(Ratio { models, expected, noise });
    Ok(Planned { title, excitation, start: pose, path: Some(motion), expected: None, ratio, notes: Vec::new() })
}

/// Noise of a sensor that nobody has described.
fn assumed([low, high]: [f64; 2]) -> f64 {
    const SHARE: f64 = 1e-4;
    let range = high - low;
    SHARE * if range.is_finite() { range } else { 1.0 }
}

impl Ratio {
    /// For people.
    pub fn text(&self, device: &Device, free: &[usize]) -> String {
        let [a, b] = &self.models;
        let ExpectedRatio { log_likelihood_ratio, as_given, absorbing } = &self.expected;
        let noise: Vec<String> = self
            .noise
            .iter()
            .zip(free)
            .map(|(noise, &joint)| format!("{} {}", number(*noise), unit(device, joint, Quantity::Position)))
            .collect();
        format!(
            "\nExpected log likelihood ratio of {a} over {b}, if {a} is true: {}\n(position noise {}; {} before the {absorbing} \
             unknowns of {b}, initial positions included, absorb what they can, to first order)\n",
            number(*log_likelihood_ratio),
            noise.join(", "),
            number(*as_given)
        )
    }

    /// For programs.
    pub fn json(&self) -> Value {
        json!({
            "models": self.models,
            "expected_log_likelihood_ratio": self.expected.log_likelihood_ratio,
            "as_given": self.expected.as_given,
            "absorbing": self.expected.absorbing,
            "position_noise": self.noise,
        })
    }
}

//! What pictures ask for: series over time, and errors over what they may follow.

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use dynid_judge::compare::{RunComparison, locate::Signal};
use dynid_logs::{experiment::Run, motion::Motion};
use dynid_signal::{power_spectrum, straight};
use serde::Deserialize;
use serde_json::{Value, json};

use super::App;
use super::answer::{Answered, Asked, Refusal, blocking};
use super::compared::{error_named, found};
use super::logs::{loaded, position_unit};
use super::series::Window;

#[derive(Deserialize)]
pub struct SeriesAsked {
    of: Of,
    names: Vec<String>,
    #[serde(flatten)]
    window: Window,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Of {
    Experiment { experiment: String, run: usize },
    Compared { key: String, run: usize },
}

/// `POST api/series`
pub async fn series(State(app): State<Arc<App>>, Asked(asked): Asked<SeriesAsked>) -> Answered {
    blocking(move || {
        let SeriesAsked { of, names, window } = asked;
        let drawn = names.iter().map(|name| {
            let trace = match &of {
                Of::Experiment { experiment, run } => loaded(&app, experiment)?.trace(*run, name)?,
                Of::Compared { key, run } => found(&app, key)?.trace(*run, name)?,
            };
            Ok(trace.columns(name, window))
        });
        Ok(Json(json!({ "series": drawn.collect::<Result<Vec<Value>, Refusal>>()? })))
    })
    .await
}

#[derive(Deserialize)]
pub struct ScatterAsked {
    key: String,
    run: usize,
    joint: usize,
    against: Against,
    /// `torque` or `position`; without it, that of torque where there is one.
    error: Option<String>,
}

#[derive(Deserialize, Clone, Copy, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Against {
    Speed,
    Position,
    Load,
    Time,
    Frequency,
}

/// `POST api/scatter`
pub async fn scatter(State(app): State<Arc<App>>, Asked(asked): Asked<ScatterAsked>) -> Answered {
    blocking(move || {
        let comparison = found(&app, &asked.key)?;
        let (run, compared) = comparison.run(asked.run)?;
        let slot = run.free.iter().position(|joint| *joint == asked.joint);
        let slot = slot.ok_or_else(|| Refusal::missing(format!("joint {} is not free in this run", asked.joint)))?;
        let default = if compared.torque.is_empty() { Signal::Position } else { Signal::Torque };
        let error = error_named(asked.error.as_deref())?.unwrap_or(default);
        let samples = Samples::of(run, compared, slot, error)?;
        let device = comparison.device();
        let (position, command) = (position_unit(device, asked.joint), &device.joints[asked.joint].command_unit);
        let unit = if error == Signal::Torque { command.as_str() } else { position };
        let (label, x_unit, x) = match asked.against {
            Against::Frequency => return Ok(Json(samples.spectrum(error, unit)?)),
            Against::Speed => ("speed", format!("{position}/s"), &samples.speed),
            Against::Position => ("position", position.to_owned(), &samples.position),
            Against::Load => ("commanded torque", command.clone(), &samples.load),
            Against::Time => ("time", "s".to_owned(), &samples.time),
        };
        let mut answer = samples.bins(x);
        answer["error"] = json!(error);
        answer["x_label"] = label.into();
        answer["x_unit"] = x_unit.into();
        answer["y_unit"] = unit.into();
        Ok(Json(answer))
    })
    .await
}

/// An error of a joint with what it may follow; one entry a sample that counts.
struct Samples {
    /// Between two samples that lie beside each other (s).
    step: f64,
    /// Which of the evenly spaced samples of the run each is.
    place: Vec<usize>,
    time: Vec<f64>,
    position: Vec<f64>,
    speed: Vec<f64>,
    load: Vec<f64>,
    error: Vec<f64>,
}

impl Samples {
    fn of(run: &Run, compared: &RunComparison, slot: usize, error: Signal) -> Result<Self, Refusal> {
        let joint = run.free[slot];
        let motion = Motion::of(run)?;
        let none = || Refusal::missing("this joint has no such error in this run; the comparison says why");
        let at = |values: &[f64]| motion.kept.iter().map(|&k| values[k]).collect::<Vec<f64>>();
        let (values, used) = match error {
            Signal::Torque => {
                let torque = compared.torque.get(slot).ok_or_else(none)?;
                (torque.residual.clone(), torque.used.clone())
            }
            Signal::Position => {
                let simulated = compared.simulated.as_ref().ok_or_else(none)?;
                let residual: Vec<f64> =
                    run.log.q[joint].iter().zip(&simulated[slot]).map(|(measured, own)| measured - own).collect();
                (at(&straight(&run.log.t, &residual, &motion.grid)), vec![true; motion.kept.len()])
            }
        };
        let place: Vec<usize> = (0..used.len()).filter(|place| used[*place]).collect();
        let counted = |values: Vec<f64>| place.iter().map(|place| values[*place]).collect::<Vec<f64>>();
        Ok(Self {
            step: motion.grid.step * motion.kept.get(1).copied().unwrap_or(1) as f64,
            time: counted(motion.kept.iter().map(|&k| motion.grid.time(k)).collect()),
            position: counted(at(&motion.q[slot])),
            speed: counted(at(&motion.dq[slot])),
            load: counted(motion.filtered(&motion.command[joint])),
            error: counted(values),
            place,
        })
    }

    /// Quartiles of the error in bins of equal counts.
    fn bins(&self, x: &[f64]) -> Value {
        /// Bins at most, and samples of each at least.
        const BINS: (usize, usize) = (60, 20);
        let mut order: Vec<usize> = (0..x.len()).collect();
        order.sort_by(|a, b| x[*a].total_cmp(&x[*b]));
        let n_bins = (x.len() / BINS.1).clamp(1, BINS.0);
        let mut columns = [const { Vec::new() }; 4];
        let mut counts = Vec::new();
        for bin in 0..n_bins {
            let own = &order[x.len() * bin / n_bins..x.len() * (bin + 1) / n_bins];
            let mut errors: Vec<f64> = own.iter().map(|k| self.error[*k]).collect();
            errors.sort_by(f64::total_cmp);
            let quartile = |share: usize| errors.get(share * errors.len().saturating_sub(1) / 4).copied();
            let middle = own.get(own.len() / 2).map(|k| x[*k]);
            for (column, value) in columns.iter_mut().zip([middle, quartile(1), quartile(2), quartile(3)]) {
                column.push(value);
            }
            counts.push(own.len());
        }
        let [x, low, middle, high] = columns;
        json!({ "x": x, "low": low, "middle": middle, "high": high, "count": counts })
    }

    /// Amplitudes of the error over frequency, neighbours together where there are many: of the longest stretch of samples that lie
    /// beside each other, since those across a gap are not evenly spaced.
    fn spectrum(&self, error: Signal, unit: &str) -> Result<Value, Refusal> {
        const MOST: usize = 400;
        let stretches = self.place.chunk_by(|one, next| one + 1 == *next).scan(0, |end, stretch| {
            *end += stretch.len();
            Some(*end - stretch.len()..*end)
        });
        // Of equals the first.
        let longest = stretches.reduce(|longest, next| if next.len() > longest.len() { next } else { longest });
        let longest = longest.unwrap_or_default();
        let found = power_spectrum(&self.error[longest.clone()], self.step).ok_or_else(|| {
            Refusal::missing("nowhere do enough samples that count lie beside each other for a spectrum; choose another error or run")
        })?;
        let (resolution, density) = (found.resolution_hz, found.density);
        let together = density.len().div_ceil(MOST).max(1);
        // The amplitude of the sine that has the power of the band.
        let amplitude = |band: &[f64]| (2.0 * band.iter().sum::<f64>() * resolution).sqrt();
        let middle: Vec<f64> = density.chunks(together).map(amplitude).collect();
        let bands = density.chunks(together).enumerate();
        let x: Vec<f64> =
            bands.map(|(band, own)| resolution * ((band * together) as f64 + 0.5 * (own.len() - 1) as f64)).collect();
        let note = (longest.len() < self.error.len()).then(|| {
            let (from, to) = (self.time[longest.start], self.time[longest.end - 1]);
            format!("Where this error does not count, e.g. in slow stretches, there is a gap: the spectrum is that of {from:.2} s to {to:.2} s, the longest stretch without one.")
        });
        Ok(json!({
            "error": error, "x_label": "frequency", "x_unit": "Hz", "y_unit": unit,
            "x": x, "low": null, "middle": middle, "high": null, "count": null, "note": note,
        }))
    }
}

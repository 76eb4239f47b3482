//! Plain waves: cosine, chirp, multisine.

use std::f64::consts::PI;

/// A wave of amplitude one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wave {
    /// `cos(2 pi f t)`
    Cosine {
        /// Hz
        frequency: f64,
    },
    /// `cos(2 pi (f0 t + (f1 - f0) t^2 / 2 T))`: the frequency runs straight from `from` to `to`.
    Chirp {
        /// Hz
        from: f64,
        /// Hz
        to: f64,
    },
    /// Harmonics `k/T` from `from` to `to` with Schroeder's phases `-pi k (k-1)/N` (Schroeder 1970), which keep the peak
    /// low. Several joints share the harmonics out in turn, so that what each does can be told apart.
    Multisine {
        /// Hz
        from: f64,
        /// Hz
        to: f64,
    },
}

impl Wave {
    /// The highest frequency in it (Hz).
    pub fn highest(&self) -> f64 {
        match *self {
            Self::Cosine { frequency } => frequency,
            Self::Chirp { from, to } | Self::Multisine { from, to } => from.max(to),
        }
    }

    /// Its values for each of `n` joints at the times `time`, which span the period `span_s`: peaks are 1. `None` where a
    /// multisine has fewer harmonics than joints.
    ///
    /// Cosines and chirps of several joints are shifted against each other by `pi/n`.
    pub fn values(&self, n: usize, time: &[f64], span_s: f64) -> Option<Vec<Vec<f64>>> {
        (0..n).map(|slot| self.of_joint(slot, n, time, span_s)).collect()
    }

    fn of_joint(&self, slot: usize, n: usize, time: &[f64], span_s: f64) -> Option<Vec<f64>> {
        let shift = PI * slot as f64 / n as f64;
        match *self {
            Self::Cosine { frequency } => Some(time.iter().map(|t| (2.0 * PI * frequency * t + shift).cos()).collect()),
            Self::Chirp { from, to } => {
                let rate = (to - from) / span_s;
                Some(time.iter().map(|t| (2.0 * PI * (from + 0.5 * rate * t) * t + shift).cos()).collect())
            }
            Self::Multisine { from, to } => {
                let first = (from * span_s - 1e-9).ceil().max(1.0) as usize;
                let last = (to * span_s + 1e-9).floor() as usize;
                let own: Vec<usize> = (first..=last).skip(slot).step_by(n).collect();
                if own.is_empty() {
                    return None;
                }
                let count = own.len() as f64;
                let phase = |k: usize| -PI * (k * (k + 1)) as f64 / count;
                let sum = |t: &f64| -> f64 {
                    let harmonic =
                        |(k, harmonic): (usize, &usize)| (2.0 * PI * *harmonic as f64 * t / span_s + phase(k)).cos();
                    own.iter().enumerate().map(harmonic).sum()
                };
                let values: Vec<f64> = time.iter().map(sum).collect();
                let peak = values.iter().fold(0.0_f64, |peak, value| peak.max(value.abs()));
                Some(values.iter().map(|value| value / peak).collect())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::times;

    #[test]
    fn a_chirp_runs_through_its_frequencies() {
        let time = times(20.0, 0.001);
        let values = Wave::Chirp { from: 0.5, to: 2.0 }.values(1, &time, 20.0).unwrap().remove(0);
        let crossings = |from: f64, to: f64| {
            let pairs = values.windows(2).zip(&time).filter(|(_, t)| (from..to).contains(*t));
            pairs.filter(|(pair, _)| pair[0] < 0.0 && pair[1] >= 0.0).count()
        };
        // so many periods: the integral of the frequency
        assert!((crossings(0.0, 4.0) as f64 - 2.6).abs() <= 1.0 && (crossings(16.0, 20.0) as f64 - 7.4).abs() <= 1.0);
    }

    /// Schroeder's phases: a crest factor near that of one sine, where equal phases have sqrt(2 N).
    #[test]
    fn a_multisine_has_a_low_peak_and_its_harmonics_alone() {
        let time = &times(10.0, 0.005)[..2000];
        let joints = Wave::Multisine { from: 0.1, to: 4.0 }.values(2, time, 10.0).unwrap();
        for (slot, values) in joints.iter().enumerate() {
            let rms = (values.iter().map(|value| value * value).sum::<f64>() / 2000.0).sqrt();
            let crest = values.iter().fold(0.0_f64, |peak, value| peak.max(value.abs())) / rms;
            assert!(crest < 2.0, "{crest}");
            let share = |harmonic: usize| {
                let angle = |t: &f64| 2.0 * PI * harmonic as f64 * t / 10.0;
                let cosine: f64 = time.iter().zip(values).map(|(t, value)| angle(t).cos() * value).sum();
                let sine: f64 = time.iter().zip(values).map(|(t, value)| angle(t).sin() * value).sum();
                cosine.hypot(sine) / 2000.0
            };
            for harmonic in 1..=41 {
                let expected = harmonic <= 40 && (harmonic - 1) % 2 == slot;
                assert_eq!(share(harmonic) > 0.02, expected, "joint {slot}, harmonic {harmonic}");
            }
        }
        let too_many = Wave::Multisine { from: 0.1, to: 0.1 }.values(2, time, 10.0);
        assert_eq!(too_many, None);
    }
}

//! Zero-phase low-pass and central differences on a uniform grid.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// A fourth-order Butterworth low-pass for uniformly sampled signals, applied forwards and backwards.
///
/// The analogue prototype `|H|^2 = 1 / (1 + (w/wc)^8)` is brought to discrete time by the bilinear transform with the
/// cut-off prewarped, so that one pass has gain `1/sqrt(2)` and both together 1/2 at the cut-off (Oppenheim & Schafer,
/// Discrete-Time Signal Processing, section 7.3). Two sections of second order in series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lowpass {
    sections: [Section; 2],
    /// Samples by which both ends are extended.
    padding: usize,
}

/// `y[k] = b0 x[k] + b1 x[k-1] + b2 x[k-2] - a1 y[k-1] - a2 y[k-2]`
#[derive(Debug, Clone, Copy, PartialEq)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
}

impl Lowpass {
    /// The filter of `cutoff_hz` for signals sampled at `rate_hz`; `None` unless `0 < cutoff_hz < rate_hz / 2`.
    pub fn new(cutoff_hz: f64, rate_hz: f64) -> Option<Self> {
        // The poles of order 4 lie at angles of pi/8 and 3 pi/8 from the negative real axis.
        Self::of_sections(cutoff_hz, rate_hz, [Some((PI / 8.0).cos()), Some((3.0 * PI / 8.0).cos())])
    }

    /// The filter of second order: one pass has `|H|^2 = 1 / (1 + (w/wc)^4)`. What it takes away, forwards and backwards, is
    /// what the zero-phase high-pass of second order leaves: their gains add up to one.
    pub fn second_order(cutoff_hz: f64, rate_hz: f64) -> Option<Self> {
        Self::of_sections(cutoff_hz, rate_hz, [Some(FRAC_1_SQRT_2), None])
    }

    /// Sections by their damping; without one a section lets everything pass.
    fn of_sections(cutoff_hz: f64, rate_hz: f64, damping: [Option<f64>; 2]) -> Option<Self> {
        if !(cutoff_hz > 0.0 && cutoff_hz < 0.5 * rate_hz) {
            return None;
        }
        let warped = (PI * cutoff_hz / rate_hz).tan();
        let section = |damping: Option<f64>| {
            let Some(damping) = damping else { return Section { b: [1.0, 0.0, 0.0], a: [0.0, 0.0] } };
            // 1 / (s^2 + 2 damping s + 1) with s = (1 - z^-1) / (warped (1 + z^-1))
            let squared = warped * warped;
            let norm = 1.0 / (1.0 + 2.0 * damping * warped + squared);
            let b = squared * norm;
            let a = [2.0 * (squared - 1.0) * norm, (1.0 - 2.0 * damping * warped + squared) * norm];
            Section { b: [b, 2.0 * b, b], a }
        };
        let sections = damping.map(section);
        // Three periods of the cut-off: by then the slowest pole has fallen to exp(-2 pi 3 sin(pi/8)) < 1e-3.
        let padding = (3.0 * rate_hz / cutoff_hz - 1e-6).ceil() as usize;
        Some(Self { sections, padding })
    }

    /// `signal` without what lies above the cut-off, in phase with it.
    ///
    /// Both ends are extended by the signal turned about its end points, and each pass starts in the steady state of
    /// its first sample (Gustafsson 1996 discusses the alternatives).
    pub fn apply(&self, signal: &[f64]) -> Vec<f64> {
        let n_samples = signal.len();
        let (Some(&first), Some(&last)) = (signal.first(), signal.last()) else { return Vec::new() };
        let padding = self.padding.min(n_samples - 1);
        let mut padded = Vec::with_capacity(n_samples + 2 * padding);
        padded.extend((1..=padding).rev().map(|k| 2.0 * first - signal[k]));
        padded.extend_from_slice(signal);
        padded.extend((1..=padding).map(|k| 2.0 * last - signal[n_samples - 1 - k]));
        self.pass(&mut padded);
        padded.reverse();
        self.pass(&mut padded);
        padded.reverse();
        padded.drain(..padding);
        padded.truncate(n_samples);
        padded
    }

    /// Number of samples at either end, two periods of the cut-off, that depend on how the signal was extended there.
    pub fn settling(&self) -> usize {
        self.padding.saturating_mul(2).div_ceil(3)
    }

    /// One causal pass, in place.
    fn pass(&self, signal: &mut [f64]) {
        for section in self.sections {
            let Some(&start) = signal.first() else { return };
            let [b0, b1, b2] = section.b;
            let [a1, a2] = section.a;
            // Transposed direct form II; states in which a constant `start` passes with gain 1.
            let mut s1 = (1.0 - b0) * start;
            let mut s2 = (b2 - a2) * start;
            for x in &mut *signal {
                let y = b0 * *x + s1;
                s1 = b1 * *x - a1 * y + s2;
                s2 = b2 * *x - a2 * y;
                *x = y;
            }
        }
    }
}

/// Every `factor`-th sample, the first included. What lies above the new Nyquist frequency must be filtered out before.
pub fn decimate(signal: &[f64], factor: usize) -> Vec<f64> {
    signal.iter().step_by(factor.max(1)).copied().collect()
}

/// Weights of central differences over three, five, seven and nine samples: of the first derivative for the samples at
/// distance 1, 2, .. (their negatives before the middle); errors `step^2 x^(3)/6`, .., `step^8 x^(9)/630`.
const FIRST: [&[f64]; 4] = [
    &[1.0 / 2.0],
    &[2.0 / 3.0, -1.0 / 12.0],
    &[3.0 / 4.0, -3.0 / 20.0, 1.0 / 60.0],
    &[4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0],
];
/// The same of the second derivative, alike on both sides; the middle's is minus twice their sum. Errors
/// `step^2 x^(4)/12`, .., `step^8 x^(10)/3150`.
const SECOND: [&[f64]; 4] = [
    &[1.0],
    &[4.0 / 3.0, -1.0 / 12.0],
    &[3.0 / 2.0, -3.0 / 20.0, 1.0 / 90.0],
    &[8.0 / 5.0, -1.0 / 5.0, 8.0 / 315.0, -1.0 / 560.0],
];

/// First derivative by time of a signal sampled every `step` seconds: central differences over nine samples, over fewer
/// near the ends, one-sided over three at the ends. Zeros for fewer than three samples.
pub fn first_derivative(x: &[f64], step: f64) -> Vec<f64> {
    let n = x.len();
    if n < 3 {
        return vec![0.0; n];
    }
    (0..n)
        .map(|k| {
            let difference = match k {
                0 => (-3.0 * x[0] + 4.0 * x[1] - x[2]) / 2.0,
                _ if k == n - 1 => (3.0 * x[k] - 4.0 * x[k - 1] + x[k - 2]) / 2.0,
                _ => {
                    let weights = FIRST[k.min(n - 1 - k).min(FIRST.len()) - 1];
                    weights.iter().zip(1..).map(|(weight, far)| weight * (x[k + far] - x[k - far])).sum()
                }
            };
            difference / step
        })
        .collect()
}

/// Second derivative by time of a signal sampled every `step` seconds: central differences over nine samples, over fewer
/// near the ends, where the end's own value is its neighbour's. Zeros for fewer than three samples.
pub fn second_derivative(x: &[f64], step: f64) -> Vec<f64> {
    let n = x.len();
    if n < 3 {
        return vec![0.0; n];
    }
    (0..n)
        .map(|k| {
            let middle = k.clamp(1, n - 2);
            let weights = SECOND[middle.min(n - 1 - middle).min(SECOND.len()) - 1];
            let around = |far: usize| (x[middle + far] - x[middle]) + (x[middle - far] - x[middle]);
            let difference: f64 = weights.iter().zip(1..).map(|(weight, far)| weight * around(far)).sum();
            difference / (step * step)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE: f64 = 200.0;

    fn sine(hertz: f64, n_samples: usize) -> Vec<f64> {
        (0..n_samples).map(|k| (2.0 * PI * hertz * k as f64 / RATE).sin()).collect()
    }

    /// `1 / (1 + (tan(pi f/rate) / tan(pi fc/rate))^8)`: the Butterworth gain of one pass, squared, with the bilinear
    /// transform's warped frequency.
    fn gain(hertz: f64, cutoff: f64) -> f64 {
        let ratio = (PI * hertz / RATE).tan() / (PI * cutoff / RATE).tan();
        1.0 / (1.0 + ratio.powi(8))
    }

    #[test]
    fn sine_keeps_its_phase_and_takes_the_butterworth_gain() {
        for hertz in [1.0, 6.0, 8.0, 12.0, 30.0] {
            let signal = sine(hertz, 4000);
            let filtered = Lowpass::new(8.0, RATE).expect("below Nyquist").apply(&signal);
            for k in 1000..3000 {
                let expected = gain(hertz, 8.0) * signal[k];
                assert!((filtered[k] - expected).abs() < 1e-9, "{hertz} Hz, sample {k}: {} {expected}", filtered[k]);
            }
        }
    }

    #[test]
    fn a_constant_passes_unchanged_and_a_line_once_the_ends_are_past() {
        let filter = Lowpass::new(10.0, RATE).expect("below Nyquist");
        assert!(filter.apply(&[3.25; 50]).iter().all(|value| (value - 3.25).abs() < 1e-12));
        let line: Vec<f64> = (0..400).map(|k| 3.0 - 0.25 * f64::from(k)).collect();
        let filtered = filter.apply(&line);
        for (k, (before, after)) in line.iter().zip(&filtered).enumerate() {
            let tolerance = if (filter.settling()..400 - filter.settling()).contains(&k) { 1e-4 } else { 2e-2 };
            assert!((before - after).abs() < tolerance, "{k}: {before} {after}");
        }
    }

    #[test]
    fn impulse_response_is_symmetric_and_sums_to_one() {
        let mut impulse = vec![0.0; 2001];
        impulse[1000] = 1.0;
        let response = Lowpass::new(8.0, RATE).expect("below Nyquist").apply(&impulse);
        assert!((response.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        for k in 0..900 {
            assert!((response[1000 - k] - response[1000 + k]).abs() < 1e-15);
        }
    }

    /// scipy 1.17.1: `b, a = signal.butter(4, 0.2); signal.filtfilt(b, a, x, padlen=30)` with
    /// `x[k] = sin(0.37 k) + 0.5 (-1)^k + 0.02 k`, 40 samples.
    #[test]
    fn agrees_with_an_independent_implementation() {
        let alternating = |k: i32| if k % 2 == 0 { 0.5 } else { -0.5 };
        let x: Vec<f64> = (0..40).map(|k| (0.37 * f64::from(k)).sin() + alternating(k) + 0.02 * f64::from(k)).collect();
        let filter = Lowpass::new(0.1, 1.0).expect("below Nyquist");
        assert_eq!(filter.padding, 30);
        let filtered = filter.apply(&x);
        for (k, expected) in SCIPY_FILTFILT {
            assert!((filtered[k] - expected).abs() < 1e-12, "sample {k}: {} {expected}", filtered[k]);
        }
    }

    const SCIPY_FILTFILT: [(usize, f64); 5] = [
        (0, 0.5000751038604047),
        (1, 0.6734752082439243),
        (7, 0.6290692685033377),
        (25, 0.670576422538389),
        (39, 1.2376344758744608),
    ];

    #[test]
    fn no_filter_at_or_above_nyquist() {
        assert_eq!(Lowpass::new(100.0, RATE), None);
        assert_eq!(Lowpass::new(0.0, RATE), None);
        assert_eq!(Lowpass::new(f64::NAN, RATE), None);
    }

    #[test]
    fn short_signals_stay_finite() {
        let filter = Lowpass::new(1.0, RATE).expect("below Nyquist");
        assert_eq!(filter.apply(&[]), Vec::<f64>::new());
        assert!((filter.apply(&[2.0])[0] - 2.0).abs() < 1e-12);
        assert!(filter.apply(&[1.0, 2.0, 5.0]).iter().all(|value| value.is_finite()));
    }

    /// Differences of a polynomial of degree 8 are exact four samples inside, of degree 4 two inside, of degree 2 everywhere.
    #[test]
    fn differences_are_exact_for_polynomials() {
        let step = 0.1;
        let at = |k: usize| step * k as f64;
        let quartic: Vec<f64> = (0..12).map(|k| at(k).powi(4) - 2.0 * at(k).powi(3) + at(k)).collect();
        let (first, second) = (first_derivative(&quartic, step), second_derivative(&quartic, step));
        for k in 2..10 {
            let t = at(k);
            assert!((first[k] - (4.0 * t.powi(3) - 6.0 * t * t + 1.0)).abs() < 1e-12);
            assert!((second[k] - (12.0 * t * t - 12.0 * t)).abs() < 1e-10);
        }
        let octic: Vec<f64> = (0..12).map(|k| at(k).powi(8) - at(k).powi(7)).collect();
        let (first, second) = (first_derivative(&octic, step), second_derivative(&octic, step));
        for k in 4..8 {
            let t = at(k);
            assert!((first[k] - (8.0 * t.powi(7) - 7.0 * t.powi(6))).abs() < 1e-12);
            assert!((second[k] - (56.0 * t.powi(6) - 42.0 * t.powi(5))).abs() < 1e-11);
        }
        let parabola: Vec<f64> = (0..12).map(|k| 3.0 * at(k) * at(k) - at(k)).collect();
        for (k, (first, second)) in
            first_derivative(&parabola, step).iter().zip(second_derivative(&parabola, step)).enumerate()
        {
            assert!((first - (6.0 * at(k) - 1.0)).abs() < 1e-11);
            assert!((second - 6.0).abs() < 1e-9);
        }
        assert_eq!(first_derivative(&[1.0, 2.0], step), [0.0, 0.0]);
    }

    #[test]
    fn decimation_keeps_the_first_of_every_few() {
        assert_eq!(decimate(&[0.0, 1.0, 2.0, 3.0, 4.0], 2), [0.0, 2.0, 4.0]);
        assert_eq!(decimate(&[0.0, 1.0], 1), [0.0, 1.0]);
    }
}

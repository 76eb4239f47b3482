//! In which frequencies an error lies, and whether two near ones beat.
//!
//! By chance a position error is white. A torque error then is what two derivatives and the filters make of that noise: its
//! power grows with the fourth power of the frequency up to the cut-off. What a band has by chance is the larger of what white
//! noise and that noise would have there.

use rustfft::{FftPlanner, num_complex::Complex};

use super::{Finding, FindingKind, Signal, trace::Trace};

/// A band is reported when it holds this share of the squared error, ..
const BAND_SHARE: f64 = 0.5;
/// .. so many times what white noise would put there.
const DENSER: f64 = 5.0;

/// The second line of a beat has at least this share of the first one's power.
const SECOND_LINE: f64 = 0.2;
/// Two lines farther apart than this share of their frequency are heard apart, not as a beat.
const NEAR: f64 = 0.3;
/// Both lines of a beat together hold at least this share of the squared error.
const BEAT_SHARE: f64 = 0.3;

/// The dominant band, and a beat if there is one.
pub fn findings(trace: &Trace) -> Vec<Finding> {
    let power = periodogram(trace);
    let total: f64 = power.iter().sum();
    let resolution = 1.0 / (trace.step * 2.0 * (power.len() - 1).max(1) as f64);
    let n_seen = ((trace.bandwidth_hz / resolution) as usize).clamp(1, power.len());
    if total <= 0.0 || power.len() < 64 {
        return Vec::new();
    }
    let mut findings = Vec::new();
    // The shortest band, of equal ratio to both sides of its middle, that holds half of the power.
    let mut sums = vec![0.0];
    for value in &power {
        sums.push(sums[sums.len() - 1] + value);
    }
    let held = |from: usize, to: usize| (sums[to + 1] - sums[from]) / total;
    let mut to = 1;
    let mut shortest: Option<(usize, usize)> = None;
    for from in 1..power.len() {
        to = to.max(from);
        while to + 1 < power.len() && held(from, to) < BAND_SHARE {
            to += 1;
        }
        if held(from, to) < BAND_SHARE {
            break;
        }
        if shortest.is_none_or(|(low, high)| to - from < high - low) {
            shortest = Some((from, to));
        }
    }
    if let Some((from, to)) = shortest {
        let share = held(from, to);
        let expected = by_chance(trace, resolution, power.len(), n_seen, from, to);
        if share > DENSER * expected && n_seen >= 16 {
            let [low_hz, high_hz] = [(from as f64 - 0.5) * resolution, (to as f64 + 0.5) * resolution];
            findings.push(trace.finding(FindingKind::LiesInBand { low_hz, high_hz }, share, expected));
        }
    }
    findings.extend(beat(trace, &power, total, resolution, n_seen));
    findings
}

fn beat(trace: &Trace, power: &[f64], total: f64, resolution: f64, n_seen: usize) -> Option<Finding> {
    // Lines: peaks with the leakage of the Hann window, two bins to each side.
    let line = |k: usize| power[k.saturating_sub(2)..(k + 3).min(power.len())].iter().sum::<f64>() / total;
    let mut peaks: Vec<usize> =
        (4..power.len() - 2).filter(|&k| power[k] > power[k - 1] && power[k] >= power[k + 1]).collect();
    peaks.sort_by(|a, b| power[*b].total_cmp(&power[*a]));
    let first = *peaks.first()?;
    let second = *peaks.iter().skip(1).find(|second| second.abs_diff(first) > 4)?;
    let (low_hz, high_hz) = (first.min(second) as f64 * resolution, first.max(second) as f64 * resolution);
    let chance = |k: usize| by_chance(trace, resolution, power.len(), n_seen, k.saturating_sub(2), k + 2);
    let (share, expected) = (line(first) + line(second), (chance(first) + chance(second)).min(1.0));
    let is_beat = power[second] > SECOND_LINE * power[first] && high_hz - low_hz < NEAR * low_hz;
    if !is_beat || share < BEAT_SHARE || share < DENSER * expected {
        return None;
    }
    Some(trace.finding(FindingKind::Beats { low_hz, high_hz }, share, expected))
}

/// The share of the power of noise that lies in bins `from..=to`.
pub(super) fn by_chance(trace: &Trace, resolution: f64, n_bins: usize, n_seen: usize, from: usize, to: usize) -> f64 {
    let white = (to + 1 - from) as f64 / n_seen as f64;
    if trace.error == Signal::Position {
        return white.min(1.0);
    }
    // The positions pass the zero-phase filter, and so does the torque that they need: gain 1 / (1 + (f/fc)^8) twice.
    let noise = |k: usize| {
        let ratio = k as f64 * resolution / trace.bandwidth_hz;
        ratio.powi(4) / (1.0 + ratio.powi(8)).powi(4)
    };
    let total: f64 = (1..n_bins).map(noise).sum();
    let inside: f64 = (from.max(1)..=to.min(n_bins - 1)).map(noise).sum();
    white.max(inside / total.max(f64::MIN_POSITIVE)).min(1.0)
}

/// Power of the error, freed of its mean, by frequency: the whole run under one Hann window, so that near lines are told apart.
pub(super) fn periodogram(trace: &Trace) -> Vec<f64> {
    let centred = trace.centred();
    let n = centred.len();
    let mut buffer: Vec<Complex<f64>> = centred
        .iter()
        .enumerate()
        .map(|(k, value)| {
            let window = 0.5 - 0.5 * (std::f64::consts::TAU * k as f64 / n as f64).cos();
            Complex::new(window * value, 0.0)
        })
        .collect();
    FftPlanner::new().plan_fft_forward(n).process(&mut buffer);
    buffer[..n / 2 + 1].iter().map(Complex::norm_sqr).collect()
}

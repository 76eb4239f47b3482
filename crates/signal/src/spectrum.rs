//! Power spectra, and how far a motion reaches above its noise.

use std::f64::consts::PI;

use rustfft::{FftPlanner, num_complex::Complex};

/// Longest segment that is transformed, in samples.
const SEGMENT: usize = 4096;

/// A motion counts as seen while its power density exceeds so many times that of the noise.
const SEEN: f64 = 4.0;

/// One-sided power spectral density.
#[derive(Debug, Clone, PartialEq)]
pub struct PowerSpectrum {
    /// Distance between frequencies (Hz); entry `k` of `density` belongs to `k * resolution_hz`.
    pub resolution_hz: f64,
    /// Power density [unit^2/Hz].
    pub density: Vec<f64>,
}

/// Mean of the periodograms of half-overlapping segments, each freed of its straight line and weighted by a Hann window
/// (Welch 1967). The density integrates to the signal's variance. `None` for fewer than eight samples.
pub fn power_spectrum(signal: &[f64], step: f64) -> Option<PowerSpectrum> {
    let length = signal.len().min(SEGMENT);
    if length < 8 {
        return None;
    }
    let window: Vec<f64> = (0..length).map(|k| 0.5 - 0.5 * (2.0 * PI * k as f64 / length as f64).cos()).collect();
    let scale = 2.0 * step / window.iter().map(|w| w * w).sum::<f64>();
    let transform = FftPlanner::new().plan_fft_forward(length);
    let mut density = vec![0.0; length / 2 + 1];
    let starts: Vec<usize> = (0..=signal.len() - length).step_by(length / 2).collect();
    for &start in &starts {
        let segment = &signal[start..start + length];
        let mut buffer: Vec<Complex<f64>> =
            without_line(segment).zip(&window).map(|(x, w)| Complex::new(x * w, 0.0)).collect();
        transform.process(&mut buffer);
        for (sum, value) in density.iter_mut().zip(&buffer) {
            *sum += scale * value.norm_sqr() / starts.len() as f64;
        }
    }
    Some(PowerSpectrum { resolution_hz: 1.0 / (step * length as f64), density })
}

/// The signal minus its least-squares straight line.
fn without_line(signal: &[f64]) -> impl Iterator<Item = f64> {
    let n = signal.len() as f64;
    let middle = 0.5 * (n - 1.0);
    let mean = signal.iter().sum::<f64>() / n;
    let moment: f64 = signal.iter().enumerate().map(|(k, x)| (k as f64 - middle) * x).sum();
    let slope = moment / (n * (n * n - 1.0) / 12.0);
    signal.iter().enumerate().map(move |(k, x)| x - mean - slope * (k as f64 - middle))
}

/// The highest frequency (Hz) up to which a measured position exceeds its noise floor: the median power density above
/// half of the Nyquist frequency. `None` where no motion is seen.
pub fn motion_bandwidth(position: &[f64], step: f64) -> Option<f64> {
    let spectrum = power_spectrum(position, step)?;
    let mut upper = spectrum.density[spectrum.density.len() / 2..].to_vec();
    let middle = upper.len() / 2;
    let floor = *upper.select_nth_unstable_by(middle, f64::total_cmp).1;
    // Three neighbours together, so that a single bin of the noise does not count as motion.
    let last = spectrum.density.windows(3).rposition(|three| three.iter().sum::<f64>() / 3.0 > SEEN * floor)?;
    Some((last + 1) as f64 * spectrum.resolution_hz)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_random::Random;

    /// A sine of amplitude 3 has the power 4.5, found at its frequency.
    #[test]
    fn power_of_a_sine_is_half_its_amplitude_squared() {
        let step = 0.01;
        let signal: Vec<f64> = (0..6000).map(|k| 3.0 * (2.0 * PI * 7.3 * step * f64::from(k)).sin()).collect();
        let spectrum = power_spectrum(&signal, step).expect("long enough");
        let power: f64 = spectrum.density.iter().sum::<f64>() * spectrum.resolution_hz;
        assert!((power - 4.5).abs() < 0.01, "{power}");
        let (peak, _) = spectrum.density.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).expect("not empty");
        assert!((peak as f64 * spectrum.resolution_hz - 7.3).abs() < spectrum.resolution_hz);
    }

    #[test]
    fn a_straight_line_has_no_power() {
        let line: Vec<f64> = (0..500).map(|k| 4.0 + 0.3 * f64::from(k)).collect();
        let spectrum = power_spectrum(&line, 0.01).expect("long enough");
        assert!(spectrum.density.iter().all(|density| *density < 1e-20));
        assert_eq!(power_spectrum(&line[..7], 0.01), None);
    }

    /// Two sines in noise: the faster one sets the bandwidth.
    #[test]
    fn bandwidth_reaches_to_the_fastest_motion_above_the_noise() {
        let step = 0.005;
        let mut random = Random::new(1);
        let position: Vec<f64> = (0..20_000)
            .map(|k| step * f64::from(k))
            .map(|t| (2.0 * PI * 0.8 * t).sin() + 0.01 * (2.0 * PI * 11.0 * t).sin() + 1e-3 * random.between(-0.5, 0.5))
            .collect();
        let bandwidth = motion_bandwidth(&position, step).expect("there is motion");
        assert!((bandwidth - 11.0).abs() < 0.3, "{bandwidth}");
    }
}

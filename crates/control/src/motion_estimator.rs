//! Position, speed and acceleration of now, from sampled and rounded positions.
//!
//! Fading-memory polynomial filters (Morrison 1969, "Introduction to Sequential Smoothing and Prediction"): at every sample
//! the parabola and the cubic that fit all past samples best by least squares, the one `k` samples ago weighed by
//! `theta^(2k)`. As a recursion, with `z_i = T^i / i! d^i q / dt^i`: `z <- F z + g e`, `e = y - (F z)_0`, F the binomials.
//! All poles are at `theta = exp(-p T)`, `p = 2 pi f`. Position and speed are the parabola's, the acceleration is the cubic's;
//! the parabola's poles are twice as far up.
//!
//! Why not a low-pass filter: what a filter delays is felt. An acceleration that comes `tau` late makes of the inertia
//! `J` that is taken off a damping of `-J tau omega^2`, which is soon more than all friction of the device, and negative.
//! A polynomial knows the present instead of a mean of the past: with `s` over `p` the speed is `(1 + 3 s) / (1 + s)^3` and
//! the acceleration `(1 + 4 s) / (1 + s)^4` times what it should be, without any group delay. What is left is of third
//! order, `-20 (omega / p)^3` of the acceleration's phase, and the way from the sample to the middle of the time over which
//! the torque acts; for both the polynomials are evaluated a little ahead of the sample.
//!
//! Why not a speed that is known better still, the cubic's `(1 + 4 s + 6 s^2) / (1 + s)^4`: that is 1.3 where its phase passes
//! 0, at half the poles' frequency, so a light joint whose friction is carried to more than three quarters would drive
//! itself there. The two that are used stay behind their phase at all frequencies (but for the little ahead).

use nalgebra::DMatrix;

/// Position, speed and acceleration of some joints.
///
/// A joint that rests on the edge between two counts of its encoder flickers. Readings pass a play of one count first, and
/// what flickers by one count no longer moves anything. What it costs is half a count of position at each reversal.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimator {
    sample_s: f64,
    half_quantum: f64,
    parabola_gains: [f64; 3],
    cubic_gains: [f64; 4],
    /// In samples: ahead for position and speed, and for the acceleration.
    ahead: [f64; 2],
    joints: Vec<Joint>,
}

/// The polynomials of one joint: `T^i / i!` times the i-th derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Joint {
    /// Behind the play.
    reading: f64,
    parabola: [f64; 3],
    cubic: [f64; 4],
    started: bool,
}

impl Estimator {
    /// Up to this frequency (Hz) felt inertia and damping should be right: a hand's slow motion.
    pub const BAND_HZ: f64 = 2.0;

    /// A filter that is later than this at the band's edge (rad) is too slow for the band, and left as it is.
    const LATEST: f64 = 1.2;

    /// Poles of the speed over those of the acceleration, which is the noisier one: a numerical choice. What a speed lags, and
    /// be it of third order, is felt as inertia of a light joint with much friction.
    const SPEED_POLES: i32 = 2;

    /// For `n` joints sampled every `sample_s`, with the acceleration's poles at `bandwidth_hz`. `quantum` is one count of the encoders [rad
    /// or m], 0 where there is none. `delay_samples` is how many samples after a reading the torques that follow from it
    /// begin to act: 0 at once, 1 with the next sample.
    pub fn new(n: usize, sample_s: f64, bandwidth_hz: f64, quantum: f64, delay_samples: usize) -> Self {
        let p = std::f64::consts::TAU * bandwidth_hz;
        let theta = (-p * sample_s).exp();
        let left = 1.0 - theta;
        let quick = theta.powi(Self::SPEED_POLES);
        let parabola_gains =
            [1.0 - quick.powi(3), 1.5 * (1.0 - quick).powi(2) * (1.0 + quick), 0.5 * (1.0 - quick).powi(3)];
        let cubic_gains = [
            1.0 - theta.powi(4),
            left.powi(2) * (11.0 + 14.0 * theta + 11.0 * theta * theta) / 6.0,
            left.powi(3) * (1.0 + theta),
            left.powi(4) / 6.0,
        ];
        // A torque that is held over a sample acts half a sample late.
        let ahead = delay_samples as f64 + 0.5;
        // So far ahead, d, `Im H` is 0 at the band's edge, and a little positive (which damps) below:
        // `arg(p^4 + (4 p^3 + d p^4) s)` makes up for `4 arg(s + p)` and the way to the middle of the torque's time.
        let edge = std::f64::consts::TAU * Self::BAND_HZ;
        let late = 4.0 * (edge / p).atan() + edge * ahead * sample_s;
        let further = if late < Self::LATEST { (late.tan() * p / edge - 4.0) / (p * sample_s) } else { ahead };
        let joint = Joint::at(0.0, false);
        let half_quantum = 0.5 * quantum;
        Self { sample_s, half_quantum, parabola_gains, cubic_gains, ahead: [ahead, further], joints: vec![joint; n] }
    }

    /// One joint's cubic as a matrix equation: `z <- A z + b reading` and `ddq = c z`, without the play.
    pub(super) fn matrices(&self) -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>) {
        let binomials = [1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 2.0, 3.0, 0.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 1.0];
        let onwards = DMatrix::from_row_slice(4, 4, &binomials);
        let gains = DMatrix::from_column_slice(4, 1, &self.cubic_gains);
        let predicted = onwards.rows(0, 1).into_owned();
        let [_, far] = self.ahead;
        let square = self.sample_s * self.sample_s;
        let acceleration = DMatrix::from_row_slice(1, 4, &[0.0, 0.0, 2.0 / square, 6.0 * far / square]);
        (&onwards - &gains * predicted, gains, acceleration)
    }

    /// Forgets the past: the next reading is taken for that of a joint at rest.
    pub fn restart(&mut self) {
        for joint in &mut self.joints {
            joint.started = false;
        }
    }

    /// Takes the readings of a sample and gives positions, speeds and accelerations of the time at which torques that follow
    /// from it act. A reading that is no number is left out: the joint is taken to go on as it did.
    pub fn tick(&mut self, readings: &[f64], q: &mut [f64], dq: &mut [f64], ddq: &mut [f64]) {
        let t = self.sample_s;
        let [near, far] = self.ahead;
        let outputs = q.iter_mut().zip(dq).zip(ddq);
        for ((joint, &reading), ((q, dq), ddq)) in self.joints.iter_mut().zip(readings).zip(outputs) {
            joint.take(reading, self.half_quantum, &self.parabola_gains, &self.cubic_gains);
            let ([p0, p1, p2], [_, _, c2, c3]) = (joint.parabola, joint.cubic);
            *q = p0 + near * (p1 + near * p2);
            *dq = (p1 + near * 2.0 * p2) / t;
            *ddq = (2.0 * c2 + far * 6.0 * c3) / (t * t);
        }
    }
}

impl Joint {
    fn at(reading: f64, started: bool) -> Self {
        Self { reading, parabola: [reading, 0.0, 0.0], cubic: [reading, 0.0, 0.0, 0.0], started }
    }

    fn take(&mut self, reading: f64, half_quantum: f64, parabola_gains: &[f64; 3], cubic_gains: &[f64; 4]) {
        let known = reading.is_finite();
        if known {
            if !self.started {
                *self = Self::at(reading, true);
                return;
            }
            self.reading = self.reading.max(reading - half_quantum).min(reading + half_quantum);
        }
        let [p0, p1, p2] = self.parabola;
        let [c0, c1, c2, c3] = self.cubic;
        correct(&mut self.parabola, [p0 + p1 + p2, p1 + 2.0 * p2, p2], self.reading, known, parabola_gains);
        let onwards = [c0 + c1 + c2 + c3, c1 + 2.0 * c2 + 3.0 * c3, c2 + 3.0 * c3, c3];
        correct(&mut self.cubic, onwards, self.reading, known, cubic_gains);
        // Readings beyond all bounds are not carried on: the next one is a new start.
        if !self.parabola.iter().chain(&self.cubic).all(|z| z.is_finite()) {
            *self = Self::at(0.0, false);
        }
    }
}

/// A polynomial one sample on, corrected by the reading where there is one.
fn correct<const N: usize>(z: &mut [f64; N], onwards: [f64; N], reading: f64, known: bool, gains: &[f64; N]) {
    let error = if known { reading - onwards[0] } else { 0.0 };
    for ((z, onwards), gain) in z.iter_mut().zip(onwards).zip(gains) {
        *z = onwards + gain * error;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn last(estimator: &mut Estimator, position: impl Fn(f64) -> f64, samples: usize) -> [f64; 3] {
        let (mut q, mut dq, mut ddq) = ([0.0], [0.0], [0.0]);
        for k in 0..samples {
            estimator.tick(&[position(k as f64 * estimator.sample_s)], &mut q, &mut dq, &mut ddq);
        }
        [q[0], dq[0], ddq[0]]
    }

    /// A parabola's position and speed and a cubic's acceleration are known without any error, and told for the time at which
    /// the torque acts.
    #[test]
    fn polynomials_are_known_exactly() {
        let mut estimator = Estimator::new(1, 1e-3, 20.0, 0.0, 1);
        let [near, far] = estimator.ahead.map(|ahead| 1.0 + ahead * 1e-3);
        let position = |t: f64| 0.3 + 0.7 * t - 2.0 * t * t;
        let [q, dq, _] = last(&mut estimator, position, 1001);
        assert!((q - position(near)).abs() < 1e-9, "{q}");
        assert!((dq - (0.7 - 4.0 * near)).abs() < 1e-7, "{dq}");
        estimator.restart();
        let [.., ddq] = last(&mut estimator, |t| position(t) + 5.0 * t * t * t, 1001);
        assert!((ddq - (-4.0 + 30.0 * far)).abs() < 1e-4, "{ddq}");
    }

    /// The poles are where they are said to be: after a jump the innovations follow `((1 - 1/z) / (1 - theta/z))^n`.
    #[test]
    fn their_poles_are_all_at_theta() {
        let estimator = Estimator::new(1, 1e-3, 20.0, 0.0, 0);
        for (gains, pole_hz) in [(&estimator.parabola_gains[..], 40.0), (&estimator.cubic_gains, 20.0)] {
            let theta = (-TAU * pole_hz * 1e-3_f64).exp();
            // coefficients of the quotient, factor by factor
            let mut expected = vec![0.0; 30];
            expected[0] = 1.0;
            for _ in gains {
                let mut last = (0.0, 0.0);
                for value in &mut expected {
                    let out = *value - last.0 + theta * last.1;
                    last = (*value, out);
                    *value = out;
                }
            }
            let mut z = [0.0; 4];
            for (k, expected) in expected.iter().enumerate() {
                let next = [z[0] + z[1] + z[2] + z[3], z[1] + 2.0 * z[2] + 3.0 * z[3], z[2] + 3.0 * z[3], z[3]];
                let error = f64::from(u8::from(k == 0)) - next[0];
                assert!((error - expected).abs() < 1e-12, "sample {k}: {error} for {expected}");
                z = std::array::from_fn(|i| next[i] + gains.get(i).unwrap_or(&0.0) * error);
            }
        }
    }

    /// In the band of a hand's slow motion the acceleration has the right size and no phase error that would be felt.
    #[test]
    fn an_acceleration_in_the_band_is_in_phase() {
        for frequency in [0.2, 0.5, 1.0, 2.0] {
            let mut estimator = Estimator::new(1, 1e-3, 20.0, 0.0, 1);
            let omega = TAU * frequency;
            let (mut cosine, mut sine, mut n) = (0.0, 0.0, 0);
            let (mut q, mut dq, mut ddq) = ([0.0], [0.0], [0.0]);
            let period = (1000.0 / frequency) as usize;
            for k in 0..3 * period {
                estimator.tick(&[(omega * k as f64 * 1e-3).sin()], &mut q, &mut dq, &mut ddq);
                if k >= 2 * period {
                    let (s, c) = (omega * (k as f64 + 1.5) * 1e-3).sin_cos();
                    (sine, cosine, n) = (sine + ddq[0] * s, cosine + ddq[0] * c, n + 1);
                }
            }
            let scale = -2.0 / f64::from(n) / (omega * omega);
            let (real, imaginary) = (scale * sine, scale * cosine);
            assert!((real - 1.0).abs() < 0.08, "{frequency} Hz: {real}");
            assert!((-0.001..0.015).contains(&imaginary), "{frequency} Hz: {imaginary}");
        }
    }

    /// A joint that rests on the edge between two counts is at rest.
    #[test]
    fn flicker_by_one_count_is_no_motion() {
        let mut estimator = Estimator::new(1, 1e-3, 20.0, 1e-4, 1);
        let mut flicker = 0;
        let reading = |t: f64| 0.2 + 1e-4 * f64::from((t * 1e3) as u32 * 7 % 5 % 2);
        for k in 0..10 {
            flicker += u32::from(reading(f64::from(k) * 1e-3) > 0.2);
        }
        assert!(flicker > 2);
        let [q, dq, ddq] = last(&mut estimator, reading, 2000);
        assert!((q - 0.2).abs() < 1.01e-4 && dq.abs() < 1e-12 && ddq.abs() < 1e-9, "{q} {dq} {ddq}");
    }

    /// A reading that is no number changes nothing.
    #[test]
    fn a_missing_reading_is_bridged() {
        let mut estimator = Estimator::new(1, 1e-3, 20.0, 0.0, 0);
        let position = |t: f64| if (0.5..0.51).contains(&t) { f64::NAN } else { 0.1 + 0.4 * t };
        let [q, dq, _] = last(&mut estimator, position, 601);
        assert!((q - (0.1 + 0.4 * 0.6005)).abs() < 1e-9 && (dq - 0.4).abs() < 1e-9, "{q} {dq}");
    }
}

//! Torques that are functions of position: springs, cogging, hysteresis.

use std::f64::consts::TAU;

use super::{Moment, Values};

/// One law at one joint.
#[derive(Debug, Clone, Copy)]
pub(super) enum Load {
    Spring {
        stiffness: f64,
        rest: f64,
    },
    /// `k[n] s^n` with `s = q - middle`, from the second order on
    Polynomial {
        k: [f64; 6],
        middle: f64,
    },
    Cogging {
        cosine: f64,
        sine: f64,
        period: f64,
    },
    /// Cubic B-spline on six equal knots from `low` to `high`
    Spline {
        coefficients: [f64; 8],
        low: f64,
        high: f64,
    },
    /// Amplitudes of cosine and sine of each harmonic
    Harmonics {
        amplitudes: [[f64; 2]; 4],
        period: f64,
    },
    /// Reid's damping, whose sign turns over a travel: `stiffness |q - rest| z`.
    Hysteresis {
        stiffness: f64,
        travel: f64,
    },
}

impl Load {
    /// The law of that id; `None` for an id of no such law.
    pub(super) fn read(id: &str, values: &Values<'_>) -> Result<Option<Self>, String> {
        let value = |symbol: &str| values.get(symbol);
        Ok(Some(match id {
            "spring" => Self::Spring { stiffness: value("Ks")?, rest: value("qeq")? },
            "spring_cubic" => Self::Polynomial { k: [0.0, 0.0, 0.0, value("K3")?, 0.0, 0.0], middle: value("q_mid")? },
            "spring_polynomial" => Self::Polynomial {
                k: [0.0, 0.0, value("K2")?, value("K3")?, 0.0, value("K5")?],
                middle: value("q_mid")?,
            },
            "cogging" => Self::Cogging { cosine: value("A")?, sine: value("B")?, period: value("period")? },
            "torque_over_position" => {
                Self::Spline { coefficients: coefficients(values)?, low: value("q_low")?, high: value("q_high")? }
            }
            "torque_over_turn" => {
                let mut amplitudes = [[0.0; 2]; 4];
                for (n, amplitudes) in amplitudes.iter_mut().enumerate() {
                    *amplitudes = [value(&format!("A{}", n + 1))?, value(&format!("B{}", n + 1))?];
                }
                Self::Harmonics { amplitudes, period: value("period")? }
            }
            "hysteresis" => Self::Hysteresis { stiffness: value("Kh")?, travel: value("travel")? },
            _ => return Ok(None),
        }))
    }

    /// Of a spring.
    pub(super) fn rest_position(&self) -> Option<f64> {
        match *self {
            Self::Spring { rest, .. } => Some(rest),
            _ => None,
        }
    }

    pub(super) fn n_states(&self) -> usize {
        usize::from(matches!(self, Self::Hysteresis { .. }))
    }

    /// Torque that resists the motion, where the joint's spring rests at `rest`; writes the rates of the law's states.
    pub(super) fn torque(&self, moment: &Moment<'_>, rest: f64, states: &[f64], rates: &mut [f64]) -> f64 {
        let q = moment.position();
        match *self {
            Self::Spring { stiffness, rest } => stiffness * (q - rest),
            Self::Polynomial { k, middle } => k.iter().rev().fold(0.0, |sum, k| sum * (q - middle) + k),
            Self::Hysteresis { stiffness, travel } => {
                let (dq, branch) = (moment.speed(), states[0]);
                // forwards the branch tends to 1, backwards to -1
                rates[0] = dq.abs() * (1.0_f64.copysign(dq) - branch) / travel;
                stiffness * (q - rest).abs() * branch
            }
            Self::Spline { coefficients, low, high } => spline(&coefficients, low, high, q),
            // Clenshaw's summation
            Self::Harmonics { amplitudes, period } => {
                let (s, c) = (TAU * q / period).sin_cos();
                let summed = |part: usize| {
                    let next =
                        |[first, second]: [f64; 2], own: &[f64; 2]| [own[part] + 2.0 * c * first - second, first];
                    amplitudes.iter().rev().fold([0.0; 2], next)
                };
                let ([cosines, second], [sines, _]) = (summed(0), summed(1));
                cosines * c - second + sines * s
            }
            Self::Cogging { cosine, sine, period } => {
                let (s, c) = (TAU * q / period).sin_cos();
                cosine * c + sine * s
            }
        }
    }
}

/// Of a spline's eight.
pub(super) fn coefficients(values: &Values<'_>) -> Result<[f64; 8], String> {
    let mut found = [0.0; 8];
    for (k, coefficient) in found.iter_mut().enumerate() {
        *coefficient = values.get(&format!("c{k}"))?;
    }
    Ok(found)
}

/// A cubic B-spline on six equal knots by de Boor's recursion; constant beyond the outer ones.
pub(super) fn spline(coefficients: &[f64; 8], low: f64, high: f64, at: f64) -> f64 {
    let place = 5.0 * (at.max(low).min(high) - low) / (high - low);
    let interval = place.floor().clamp(0.0, 4.0);
    let mut d: [f64; 4] = std::array::from_fn(|k| coefficients[interval as usize + k]);
    for level in 1..4 {
        for k in (level..4).rev() {
            // the knot at which this coefficient's bump begins
            let knot = interval + k as f64 - 3.0;
            let share = (place - knot) / (4 - level) as f64;
            d[k] = (1.0 - share) * d[k - 1] + share * d[k];
        }
    }
    d[3]
}

//! Friction laws: torque that resists the motion, as a function of speed, load and time, some with a memory.

use super::{
    Moment, Values,
    load::{coefficients, spline},
};

/// One law at one joint.
#[derive(Debug, Clone, Copy)]
pub(super) enum Friction {
    Viscous { fv: f64 },
    ViscousAsymmetric { forwards: f64, backwards: f64 },
    Coulomb { fc: f64, v_eps: f64 },
    CoulombAsymmetric { forwards: f64, backwards: f64, v_eps: f64 },
    Stribeck { fs: f64, fc: f64, vs: f64, v_eps: f64 },
    Lugre(Lugre),
    Turner { s1: f64, v1: f64, fk: f64, v4: f64, s2: f64 },
    Dahl { sigma0: f64, fc: f64 },
    Drift { fd: f64, tau: f64, v_eps: f64 },
    QuadraticDrag { cd: f64 },
    Spline { coefficients: [f64; 8], v_max: f64 },
    Coupled(Coupled),
}

/// Bristles that bend (thesis Eqs 3.6-3.8).
#[derive(Debug, Clone, Copy)]
pub(super) struct Lugre {
    sigma0: f64,
    sigma1: f64,
    sigma2: f64,
    vs: f64,
    fs: f64,
    fc: f64,
}

/// Friction of two joints that share a shaft: each feels the other's speed and the sign of their sum.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coupled {
    other: usize,
    fv: f64,
    fc: f64,
    v_eps: f64,
}

impl Lugre {
    /// How fast the bristles bend, and the friction they give.
    fn rate_and_torque(&self, dq: f64, bend: f64) -> (f64, f64) {
        let level = stribeck(self.fs, self.fc, dq / self.vs);
        let rate = dq - self.sigma0 * dq.abs() / level * bend;
        (rate, self.sigma0 * bend + self.sigma1 * rate + self.sigma2 * dq)
    }
}

/// From `fs` at rest to `fc` at speed; `ratio` is the speed in units of the Stribeck speed.
fn stribeck(fs: f64, fc: f64, ratio: f64) -> f64 {
    fc + (fs - fc) * (-ratio * ratio).exp()
}

/// Thesis Fig. 3.4: a steep rise to the stiction `s1 v1`, a fall to the kinetic friction `fk` at `v4` along half a
/// period of the smooth step `u^2 (3 - 2u)`, and the viscous slope `s2` from there.
fn turner(speed: f64, [s1, v1, fk, v4, s2]: [f64; 5]) -> f64 {
    let peak = s1 * v1;
    if speed <= v1 {
        return s1 * speed;
    }
    if speed >= v4 {
        return fk + s2 * (speed - v4);
    }
    let u = (speed - v1) / (v4 - v1);
    peak - (peak - fk) * u * u * (3.0 - 2.0 * u)
}

/// What part of the motion still bends the contact.
fn dq_share(torque: f64, fc: f64, speed: f64) -> f64 {
    if speed < 0.0 { speed * (1.0 + torque / fc) } else { speed * (1.0 - torque / fc) }
}

/// One law, and what it does at another joint.
type Read = (Friction, Option<(usize, Friction)>);

impl Friction {
    /// The law of that id and, for a pair, the law at the other joint; `None` for an id of no such law.
    pub(super) fn read(id: &str, values: &Values<'_>) -> Result<Option<Read>, String> {
        let value = |symbol: &str| values.get(symbol);
        let law = match id {
            "viscous" => Self::Viscous { fv: value("Fv")? },
            "viscous_asymmetric" => Self::ViscousAsymmetric { forwards: value("Fv_p")?, backwards: value("Fv_n")? },
            "coulomb" => Self::Coulomb { fc: value("Fc")?, v_eps: value("v_eps")? },
            "coulomb_asymmetric" => {
                Self::CoulombAsymmetric { forwards: value("Fc_p")?, backwards: value("Fc_n")?, v_eps: value("v_eps")? }
            }
            "stribeck" => {
                Self::Stribeck { fs: value("Fs")?, fc: value("Fc")?, vs: value("vs")?, v_eps: value("v_eps")? }
            }
            "lugre" => Self::Lugre(Lugre {
                sigma0: value("sigma0")?,
                sigma1: value("sigma1")?,
                sigma2: value("sigma2")?,
                vs: value("vs")?,
                fs: value("Fs")?,
                fc: value("Fc")?,
            }),
            "turner" => Self::Turner {
                s1: value("s1")?,
                v1: value("v1")?,
                fk: value("Fk")?,
                v4: value("v4")?,
                s2: value("s2")?,
            },
            "dahl" => Self::Dahl { sigma0: value("sigma0")?, fc: value("Fc")? },
            "friction_drift" => Self::Drift { fd: value("Fd")?, tau: value("tau")?, v_eps: value("v_eps")? },
            "friction_over_speed" => Self::Spline { coefficients: coefficients(values)?, v_max: value("v_max")? },
            "quadratic_drag" => Self::QuadraticDrag { cd: value("Cd")? },
            "friction_coupled" => {
                let (other, fv, fc, v_eps) = (values.from()?, value("Fv")?, value("Fc")?, value("v_eps")?);
                let here = Self::Coupled(Coupled { other, fv, fc, v_eps });
                let there = Self::Coupled(Coupled { other: values.entry.joint, fv, fc, v_eps });
                return Ok(Some((here, Some((other, there)))));
            }
            _ => return Ok(None),
        };
        Ok(Some((law, None)))
    }

    pub(super) fn n_states(&self) -> usize {
        match self {
            Self::Lugre(_) | Self::Dahl { .. } => 1,
            _ => 0,
        }
    }

    /// Torque that resists the motion; writes the rates of the law's states.
    pub(super) fn torque(&self, moment: &Moment<'_>, states: &[f64], rates: &mut [f64]) -> f64 {
        let speed = moment.speed();
        match *self {
            Self::Viscous { fv } => fv * speed,
            Self::ViscousAsymmetric { forwards, backwards } => (if speed > 0.0 { forwards } else { backwards }) * speed,
            Self::Coulomb { fc, v_eps } => fc * (speed / v_eps).tanh(),
            Self::CoulombAsymmetric { forwards, backwards, v_eps } => {
                (if speed > 0.0 { forwards } else { backwards }) * (speed / v_eps).tanh()
            }
            Self::Stribeck { fs, fc, vs, v_eps } => stribeck(fs, fc, speed / vs) * (speed / v_eps).tanh(),
            Self::Lugre(lugre) => {
                let (rate, torque) = lugre.rate_and_torque(speed, states[0]);
                rates[0] = rate;
                torque
            }
            Self::Turner { s1, v1, fk, v4, s2 } => turner(speed.abs(), [s1, v1, fk, v4, s2]).copysign(speed),
            // Dahl 1968 as a function of the torque, dF/dt = sigma0 (1 - F/Fc sign(dq)) dq, here for F/sigma0
            Self::Dahl { sigma0, fc } => {
                let torque = sigma0 * states[0];
                rates[0] = dq_share(torque, fc, speed);
                torque
            }
            Self::Drift { fd, tau, v_eps } => fd * ((-moment.time / tau).exp() - 1.0) * (speed / v_eps).tanh(),
            Self::Spline { coefficients, v_max } => spline(&coefficients, -v_max, v_max, speed),
            Self::QuadraticDrag { cd } => cd * speed.abs() * speed,
            Self::Coupled(Coupled { other, fv, fc, v_eps }) => {
                let other = moment.dq[other];
                fv * other + fc * ((speed + other) / v_eps).tanh()
            }
        }
    }
}

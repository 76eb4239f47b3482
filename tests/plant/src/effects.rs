//! The plant's own physical effects: what stands between commanded torque and motion.
//!
//! Torque on joint i: `Kp (command_i + offset + sum of gain * command_from)`, less the load: the spring, and all
//! friction laws, also those shared with another joint, times `bias` where `q < qeq`.

use std::collections::BTreeMap;

use serde::Deserialize;

/// An effect as a recipe writes it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct EffectEntry {
    /// Id of the effect, as in the library of effects.
    pub id: String,
    /// Joint that it acts on.
    pub joint: usize,
    /// The other joint of a pair.
    pub from: Option<usize>,
    /// Values by symbol; all must be given.
    #[serde(flatten)]
    pub values: BTreeMap<String, f64>,
}

/// All effects at one joint.
#[derive(Debug, Clone, Default)]
pub struct JointEffects {
    gain: Option<f64>,
    offset: f64,
    /// (from, gain)
    input_couplings: Vec<(usize, f64)>,
    /// (stiffness, rest position)
    spring: Option<(f64, f64)>,
    frictions: Vec<Friction>,
    bias: Option<f64>,
    coupled: Vec<CoupledFriction>,
    /// Added to the joint's diagonal entry of D.
    pub rotor_inertia: f64,
    /// (other joint, inertia): added to both off-diagonal entries of D; held at one joint of the pair.
    pub rotor_couplings: Vec<(usize, f64)>,
}

#[derive(Debug, Clone, Copy)]
enum Friction {
    Viscous { fv: f64 },
    Coulomb { fc: f64, v_eps: f64 },
    Stribeck { fs: f64, fc: f64, vs: f64, v_eps: f64 },
    Lugre(Lugre),
}

/// Bristles that bend (thesis Eqs 3.6-3.8).
#[derive(Debug, Clone, Copy)]
struct Lugre {
    sigma0: f64,
    sigma1: f64,
    sigma2: f64,
    vs: f64,
    fs: f64,
    fc: f64,
}

/// Friction of two joints that share a shaft: each feels the other's speed and the sign of their sum.
#[derive(Debug, Clone, Copy)]
struct CoupledFriction {
    other: usize,
    fv: f64,
    fc: f64,
    v_eps: f64,
}

impl Lugre {
    /// How fast the bristles bend, and the friction they give.
    fn rate_and_torque(&self, dq: f64, bend: f64) -> (f64, f64) {
        let ratio = dq / self.vs;
        let level = self.fc + (self.fs - self.fc) * (-ratio * ratio).exp();
        let rate = dq - self.sigma0 * dq.abs() / level * bend;
        (rate, self.sigma0 * bend + self.sigma1 * rate + self.sigma2 * dq)
    }
}

/// Sorts the entries of a recipe by joint. An unknown effect or a missing value is an error that says so.
pub fn by_joint(entries: &[EffectEntry], n_joints: usize) -> Result<Vec<JointEffects>, String> {
    let mut joints = vec![JointEffects::default(); n_joints];
    for entry in entries {
        let place = format!("effect `{}` at joint {}", entry.id, entry.joint);
        if entry.joint >= n_joints || entry.from.is_some_and(|from| from >= n_joints) {
            return Err(format!("{place}: the device has joints 0..={}", n_joints - 1));
        }
        let value =
            |symbol: &str| entry.values.get(symbol).copied().ok_or_else(|| format!("{place}: `{symbol}` is missing"));
        let from = || entry.from.ok_or_else(|| format!("{place}: `from` is missing"));
        let joint = &mut joints[entry.joint];
        match entry.id.as_str() {
            "gain" => joint.gain = Some(value("Kp")?),
            "torque_offset" => joint.offset += value("offset")?,
            "input_coupling" => joint.input_couplings.push((from()?, value("gain")?)),
            "spring" => joint.spring = Some((value("Ks")?, value("qeq")?)),
            "rotor_inertia" => joint.rotor_inertia += value("Ia")?,
            "rotor_coupling" => joint.rotor_couplings.push((from()?, value("Ia")?)),
            "friction_bias" => joint.bias = Some(value("bias")?),
            "viscous" => joint.frictions.push(Friction::Viscous { fv: value("Fv")? }),
            "coulomb" => joint.frictions.push(Friction::Coulomb { fc: value("Fc")?, v_eps: value("v_eps")? }),
            "stribeck" => joint.frictions.push(Friction::Stribeck {
                fs: value("Fs")?,
                fc: value("Fc")?,
                vs: value("vs")?,
                v_eps: value("v_eps")?,
            }),
            "lugre" => joint.frictions.push(Friction::Lugre(Lugre {
                sigma0: value("sigma0")?,
                sigma1: value("sigma1")?,
                sigma2: value("sigma2")?,
                vs: value("vs")?,
                fs: value("Fs")?,
                fc: value("Fc")?,
            })),
            "friction_coupled" => {
                let (other, fv, fc, v_eps) = (from()?, value("Fv")?, value("Fc")?, value("v_eps")?);
                joint.coupled.push(CoupledFriction { other, fv, fc, v_eps });
                joints[other].coupled.push(CoupledFriction { other: entry.joint, fv, fc, v_eps });
            }
            other => return Err(format!("{place}: the plant knows no effect `{other}`")),
        }
    }
    Ok(joints)
}

impl JointEffects {
    /// Number of bristle states.
    pub fn n_states(&self) -> usize {
        self.frictions.iter().filter(|friction| matches!(friction, Friction::Lugre(_))).count()
    }

    /// Torque that the drive delivers for the commands of all joints.
    pub fn drive(&self, joint: usize, commands: &[f64]) -> f64 {
        let coupled: f64 = self.input_couplings.iter().map(|&(from, gain)| gain * commands[from]).sum();
        self.gain.unwrap_or(1.0) * (commands[joint] + self.offset + coupled)
    }

    /// Torque that resists the motion; writes the rates of the bristle states.
    pub fn load(&self, joint: usize, q: &[f64], dq: &[f64], states: &[f64], rates: &mut [f64]) -> f64 {
        let (q_here, speed) = (q[joint], dq[joint]);
        let mut friction = 0.0;
        let mut state = 0;
        for law in &self.frictions {
            friction += match *law {
                Friction::Viscous { fv } => fv * speed,
                Friction::Coulomb { fc, v_eps } => fc * (speed / v_eps).tanh(),
                Friction::Stribeck { fs, fc, vs, v_eps } => {
                    let ratio = speed / vs;
                    (fc + (fs - fc) * (-ratio * ratio).exp()) * (speed / v_eps).tanh()
                }
                Friction::Lugre(lugre) => {
                    let (rate, torque) = lugre.rate_and_torque(speed, states[state]);
                    rates[state] = rate;
                    state += 1;
                    torque
                }
            };
        }
        for pair in &self.coupled {
            friction += pair.fv * dq[pair.other] + pair.fc * ((speed + dq[pair.other]) / pair.v_eps).tanh();
        }
        let (stiffness, rest) = self.spring.unwrap_or((0.0, 0.0));
        if let Some(bias) = self.bias
            && q_here < rest
        {
            friction *= bias;
        }
        stiffness * (q_here - rest) + friction
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(id: &str, from: Option<usize>, values: &[(&str, f64)]) -> EffectEntry {
        let values = values.iter().map(|&(symbol, value)| (symbol.to_owned(), value)).collect();
        EffectEntry { id: id.to_owned(), joint: 0, from, values }
    }

    #[test]
    fn drive_offsets_and_couples_before_the_gain() {
        let entries = [
            entry("gain", None, &[("Kp", 2.0)]),
            entry("torque_offset", None, &[("offset", 0.5)]),
            entry("input_coupling", Some(1), &[("gain", -0.25)]),
        ];
        let joints = by_joint(&entries, 2).unwrap();
        assert_eq!(joints[0].drive(0, &[1.0, 4.0]), 2.0 * (1.0 + 0.5 - 1.0));
        assert_eq!(joints[1].drive(1, &[1.0, 4.0]), 4.0);
    }

    /// Sliding steadily, the bristles stand still at `g(v)/sigma0 * sign(v)`; the friction is then `g(v) + sigma2 v`.
    #[test]
    fn lugre_slides_at_its_level() {
        let symbols = [("sigma0", 6.0), ("sigma1", 0.1), ("sigma2", 0.02), ("vs", 0.1), ("Fs", 0.05), ("Fc", 0.03)];
        let joints = by_joint(&[entry("lugre", None, &symbols)], 1).unwrap();
        let v = -0.07_f64;
        let level = 0.03 + 0.02 * (-0.49_f64).exp();
        let mut rate = [f64::NAN];
        let torque = joints[0].load(0, &[0.0], &[v], &[-level / 6.0], &mut rate);
        assert!(rate[0].abs() < 1e-15 && (torque - (-level + 0.02 * v)).abs() < 1e-15);
    }

    #[test]
    fn bias_scales_all_friction_below_the_rest_position_and_nothing_else() {
        let entries = [
            entry("spring", None, &[("Ks", 3.0), ("qeq", 0.2)]),
            entry("viscous", None, &[("Fv", 0.5)]),
            entry("friction_bias", None, &[("bias", 1.5)]),
        ];
        let joints = by_joint(&entries, 1).unwrap();
        let load = |q: f64| joints[0].load(0, &[q], &[2.0], &[], &mut []);
        assert!((load(0.1) - (3.0 * -0.1 + 1.5)).abs() < 1e-15);
        assert!((load(0.3) - (3.0 * 0.1 + 1.0)).abs() < 1e-15);
    }

    #[test]
    fn stribeck_falls_from_stiction_to_coulomb() {
        let symbols = [("Fs", 0.9), ("Fc", 0.4), ("vs", 0.1), ("v_eps", 1e-6)];
        let joints = by_joint(&[entry("stribeck", None, &symbols)], 1).unwrap();
        let load = |v: f64| joints[0].load(0, &[0.0], &[v], &[], &mut []);
        assert!((load(1e-4) - 0.9).abs() < 1e-5 && (load(10.0) - 0.4).abs() < 1e-15 && load(-10.0) == -load(10.0));
    }

    #[test]
    fn coupled_friction_acts_on_both_joints() {
        let entries = [entry("friction_coupled", Some(1), &[("Fv", 0.5), ("Fc", 2.0), ("v_eps", 1e-6)])];
        let joints = by_joint(&entries, 2).unwrap();
        let load = |joint: usize| joints[joint].load(joint, &[0.0, 0.0], &[3.0, -4.0], &[], &mut []);
        assert_eq!((load(0), load(1)), (0.5 * -4.0 - 2.0, 0.5 * 3.0 - 2.0));
    }

    #[test]
    fn unknown_effects_and_missing_values_are_errors() {
        assert!(by_joint(&[entry("magic", None, &[])], 1).unwrap_err().contains("magic"));
        assert!(by_joint(&[entry("gain", None, &[])], 1).unwrap_err().contains("`Kp` is missing"));
    }
}

//! Hand-written kernels to test against: a pendulum, a planar two-link arm, and a few effects.

use dynid_generated::{EffectKernel, EffectTable, Eight, Kernel, KernelTable, LANES, Lanes, Signal};
use dynid_signal_chain::{Place, Stage};

use super::*;

/// Gravity of the test devices [m/s^2].
pub const GRAVITY: f64 = 9.81;

/// A function of numbers, lane by lane.
fn each_lane<const I: usize, const O: usize>(
    inputs: [&[Lanes]; I],
    outputs: [&mut [Lanes]; O],
    of: impl Fn([&[f64]; I], [&mut [f64]; O]),
) {
    let mut results = outputs.each_ref().map(|output| vec![[0.0; LANES]; output.len()]);
    for lane in 0..LANES {
        let inputs = inputs.map(|input| input.iter().map(|value| value.to_array()[lane]).collect::<Vec<f64>>());
        let mut own = results.each_ref().map(|result| vec![0.0; result.len()]);
        of(inputs.each_ref().map(Vec::as_slice), own.each_mut().map(Vec::as_mut_slice));
        for (result, own) in results.iter_mut().zip(&own) {
            result.iter_mut().zip(own).for_each(|(result, own)| result[lane] = *own);
        }
    }
    for (output, result) in outputs.into_iter().zip(results) {
        output.iter_mut().zip(result).for_each(|(output, result)| *output = Lanes::new(result));
    }
}

/// A function of numbers, one after the other.
fn each_of_eight(given: &[Eight], results: &mut [Eight], of: impl Fn(&[f64], &mut [f64])) {
    for lane in 0..8 {
        let given: Vec<f64> = given.iter().map(|row| row[lane]).collect();
        let mut own = vec![0.0; results.len()];
        of(&given, &mut own);
        results.iter_mut().zip(own).for_each(|(row, own)| row[lane] = own);
    }
}

fn forward_dynamics_of_eight(kernel: &Kernel, given: &[Eight], ddq: &mut [Eight]) {
    let n = kernel.free.len();
    each_of_eight(given, ddq, |given, ddq| {
        let (prepared, moving) = given.split_at(kernel.prepared.len());
        kernel.functions.forward_dynamics(prepared, &moving[..n], &moving[n..2 * n], &moving[2 * n..], ddq);
    });
}

fn eval_of_eight(kernel: &EffectKernel, given: &[Eight], results: &mut [Eight]) {
    each_of_eight(given, results, |given, results| {
        let (parameters, rest) = given.split_at(kernel.n_parameters);
        let (signals, states) = rest.split_at(N_SIGNALS);
        let (outputs, rates) = results.split_at_mut(kernel.n_outputs);
        kernel.functions.eval(parameters, signals, states, outputs, rates);
    });
}

/// A pendulum: `tau = (I + m x^2) ddq + g m x sin q`; lumps `I + m x^2` and `m x`.
pub static PENDULUM: Kernel = Kernel {
    device: "pendulum",
    configuration: Some(1),
    free: &[0],
    locked: &[],
    parameters: &["link.1.m", "link.1.x", "link.1.Izz"],
    appearing: &["link.1.m", "link.1.x", "link.1.Izz"],
    prepared: &["J", "mx"],
    n_lumps: 2,
    operations: &[],
    functions: &KernelTable {
        forward_dynamics_of_eight: |_, given, ddq| forward_dynamics_of_eight(&PENDULUM, given, ddq),
        prepare: |p, _, out| {
            out[0] = p[2] + p[0] * p[1] * p[1];
            out[1] = p[0] * p[1];
        },
        prepare_gradient: |p, _, j| {
            j.copy_from_slice(&[p[1] * p[1], 2.0 * p[0] * p[1], 1.0, p[1], p[0], 0.0]);
        },
        inertia: |l, _, d| d[0] = l[0],
        coriolis: |_, _, _, c| c[0] = 0.0,
        gravity: |l, q, phi| phi[0] = GRAVITY * l[1] * q[0].sin(),
        bias: |l, q, _, h| h[0] = GRAVITY * l[1] * q[0].sin(),
        inertia_and_bias: |l, q, _, d, h| {
            d[0] = l[0];
            h[0] = GRAVITY * l[1] * q[0].sin();
        },
        inverse_dynamics: |l, q, _, ddq, tau| tau[0] = l[0] * ddq[0] + GRAVITY * l[1] * q[0].sin(),
        forward_dynamics: |l, q, _, tau, ddq| ddq[0] = (tau[0] - GRAVITY * l[1] * q[0].sin()) / l[0],
        regressor: |_, q, _, ddq, y| y.copy_from_slice(&[ddq[0], GRAVITY * q[0].sin()]),
        inverse_dynamics_gradient: |l, q, _, ddq, tau, by_q, by_dq| {
            tau[0] = l[0] * ddq[0] + GRAVITY * l[1] * q[0].sin();
            by_q[0] = GRAVITY * l[1] * q[0].cos();
            by_dq[0] = 0.0;
        },
        inertia_lanes: |l, q, d| each_lane([l, q], [d], |[l, q], [d]| PENDULUM.functions.inertia(l, q, d)),
        regressor_lanes: |l, q, dq, ddq, y| {
            each_lane([l, q, dq, ddq], [y], |[l, q, dq, ddq], [y]| PENDULUM.functions.regressor(l, q, dq, ddq, y));
        },
        inverse_dynamics_gradient_lanes: |l, q, dq, ddq, tau, by_q, by_dq| {
            each_lane([l, q, dq, ddq], [tau, by_q, by_dq], |[l, q, dq, ddq], [tau, by_q, by_dq]| {
                PENDULUM.functions.inverse_dynamics_gradient(l, q, dq, ddq, tau, by_q, by_dq);
            });
        },
    },
};

/// Length of the first link of the two-link arm \[m\].
const L1: f64 = 0.4;

fn arm_regressor(q: &[f64], dq: &[f64], ddq: &[f64]) -> [f64; 10] {
    let (s2, c2) = q[1].sin_cos();
    let both = ddq[0] + ddq[1];
    let weight1 = GRAVITY * q[0].cos();
    let weight12 = GRAVITY * (q[0] + q[1]).cos();
    let coupling = c2 * (2.0 * ddq[0] + ddq[1]) - s2 * (2.0 * dq[0] + dq[1]) * dq[1];
    [
        ddq[0],
        both,
        coupling,
        weight1,
        weight12, // joint 0
        0.0,
        both,
        c2 * ddq[0] + s2 * dq[0] * dq[0],
        0.0,
        weight12, // joint 1
    ]
}

fn arm_torque(l: &[f64], q: &[f64], dq: &[f64], ddq: &[f64]) -> [f64; 2] {
    let y = arm_regressor(q, dq, ddq);
    [(0..5).map(|k| y[k] * l[k]).sum(), (0..5).map(|k| y[5 + k] * l[k]).sum()]
}

/// A planar two-link arm in a vertical plane; five lumps, linear in them.
pub static ARM: Kernel = Kernel {
    device: "arm",
    configuration: Some(1),
    free: &[0, 1],
    locked: &[],
    parameters: &["link.1.m", "link.1.x", "link.1.Izz", "link.2.m", "link.2.x", "link.2.Izz"],
    appearing: &["link.1.m", "link.1.x", "link.1.Izz", "link.2.m", "link.2.x", "link.2.Izz"],
    prepared: &["p1", "p2", "p3", "g1", "g2"],
    n_lumps: 5,
    operations: &[],
    functions: &KernelTable {
        forward_dynamics_of_eight: |_, given, ddq| forward_dynamics_of_eight(&ARM, given, ddq),
        prepare: |p, _, out| {
            out[0] = p[2] + p[0] * p[1] * p[1] + p[3] * L1 * L1;
            out[1] = p[5] + p[3] * p[4] * p[4];
            out[2] = L1 * p[3] * p[4];
            out[3] = p[0] * p[1] + p[3] * L1;
            out[4] = p[3] * p[4];
        },
        prepare_gradient: |p, _, j| {
            #[rustfmt::skip]
            j.copy_from_slice(&[
                p[1] * p[1], 2.0 * p[0] * p[1], 1.0, L1 * L1,     0.0,               0.0,
                0.0,         0.0,               0.0, p[4] * p[4], 2.0 * p[3] * p[4], 1.0,
                0.0,         0.0,               0.0, L1 * p[4],   L1 * p[3],         0.0,
                p[1],        p[0],              0.0, L1,          0.0,               0.0,
                0.0,         0.0,               0.0, p[4],        p[3],              0.0,
            ]);
        },
        inertia: |l, q, d| {
            let c2 = q[1].cos();
            d.copy_from_slice(&[l[0] + l[1] + 2.0 * l[2] * c2, l[1] + l[2] * c2, l[1] + l[2] * c2, l[1]]);
        },
        coriolis: |l, q, dq, c| {
            let h = -l[2] * q[1].sin();
            c.copy_from_slice(&[h * dq[1], h * (dq[0] + dq[1]), -h * dq[0], 0.0]);
        },
        gravity: |l, q, phi| phi.copy_from_slice(&arm_torque(l, q, &[0.0; 2], &[0.0; 2])),
        bias: |l, q, dq, h| h.copy_from_slice(&arm_torque(l, q, dq, &[0.0; 2])),
        inertia_and_bias: |l, q, dq, d, h| {
            ARM.functions.inertia(l, q, d);
            ARM.functions.bias(l, q, dq, h);
        },
        inverse_dynamics: |l, q, dq, ddq, tau| tau.copy_from_slice(&arm_torque(l, q, dq, ddq)),
        forward_dynamics: |l, q, dq, tau, ddq| {
            let mut d = [0.0; 4];
            ARM.functions.inertia(l, q, &mut d);
            let h = arm_torque(l, q, dq, &[0.0; 2]);
            ddq.copy_from_slice(&[tau[0] - h[0], tau[1] - h[1]]);
            solve::solve(2, &mut d, ddq);
        },
        regressor: |_, q, dq, ddq, y| y.copy_from_slice(&arm_regressor(q, dq, ddq)),
        inverse_dynamics_gradient: |l, q, dq, ddq, tau, by_q, by_dq| {
            tau.copy_from_slice(&arm_torque(l, q, dq, ddq));
            let (s2, c2) = q[1].sin_cos();
            let weight1 = -GRAVITY * l[3] * q[0].sin();
            let weight12 = -GRAVITY * l[4] * (q[0] + q[1]).sin();
            let coupling = -s2 * (2.0 * ddq[0] + ddq[1]) - c2 * (2.0 * dq[0] + dq[1]) * dq[1];
            by_q.copy_from_slice(&[
                weight1 + weight12,
                l[2] * coupling + weight12,
                weight12,
                l[2] * (-s2 * ddq[0] + c2 * dq[0] * dq[0]) + weight12,
            ]);
            by_dq.copy_from_slice(&[
                -2.0 * l[2] * s2 * dq[1],
                -2.0 * l[2] * s2 * (dq[0] + dq[1]),
                2.0 * l[2] * s2 * dq[0],
                0.0,
            ]);
        },
        inertia_lanes: |l, q, d| each_lane([l, q], [d], |[l, q], [d]| ARM.functions.inertia(l, q, d)),
        regressor_lanes: |l, q, dq, ddq, y| {
            each_lane([l, q, dq, ddq], [y], |[l, q, dq, ddq], [y]| ARM.functions.regressor(l, q, dq, ddq, y));
        },
        inverse_dynamics_gradient_lanes: |l, q, dq, ddq, tau, by_q, by_dq| {
            each_lane([l, q, dq, ddq], [tau, by_q, by_dq], |[l, q, dq, ddq], [tau, by_q, by_dq]| {
                ARM.functions.inverse_dynamics_gradient(l, q, dq, ddq, tau, by_q, by_dq);
            });
        },
    },
};

const Q: usize = Signal::Q as usize;
const DQ: usize = Signal::Dq as usize;

/// `Kp * command`
pub static GAIN: EffectKernel = EffectKernel {
    id: "gain",
    n_parameters: 1,
    n_states: 0,
    n_outputs: 1,
    functions: &EffectTable {
        eval_of_eight: |_, given, results| eval_of_eight(&GAIN, given, results),
        eval: |p, s, _, out, _| out[0] = p[0] * s[Signal::Command as usize],
        eval_gradient: |p, s, _, out, _, j| {
            out[0] = p[0] * s[Signal::Command as usize];
            j.fill(0.0);
            j[0] = s[Signal::Command as usize];
            j[1 + Signal::Command as usize] = p[0];
        },
        eval_lanes: |p, s, z, out, rates| {
            each_lane([p, s, z], [out, rates], |[p, s, z], [out, rates]| GAIN.functions.eval(p, s, z, out, rates));
        },
        eval_gradient_lanes: |p, s, z, out, rates, j| {
            each_lane([p, s, z], [out, rates, j], |[p, s, z], [out, rates, j]| {
                GAIN.functions.eval_gradient(p, s, z, out, rates, j);
            });
        },
    },
};

/// `command + gain * command_from`
pub static INPUT_COUPLING: EffectKernel = EffectKernel {
    id: "input_coupling",
    n_parameters: 1,
    n_states: 0,
    n_outputs: 1,
    functions: &EffectTable {
        eval_of_eight: |_, given, results| eval_of_eight(&INPUT_COUPLING, given, results),
        eval: |p, s, _, out, _| out[0] = s[Signal::Command as usize] + p[0] * s[Signal::CommandFrom as usize],
        eval_gradient: |p, s, _, out, _, j| {
            out[0] = s[Signal::Command as usize] + p[0] * s[Signal::CommandFrom as usize];
            j.fill(0.0);
            j[0] = s[Signal::CommandFrom as usize];
            j[1 + Signal::Command as usize] = 1.0;
            j[1 + Signal::CommandFrom as usize] = p[0];
        },
        eval_lanes: |p, s, z, out, rates| {
            each_lane([p, s, z], [out, rates], |[p, s, z], [out, rates]| {
                INPUT_COUPLING.functions.eval(p, s, z, out, rates)
            });
        },
        eval_gradient_lanes: |p, s, z, out, rates, j| {
            each_lane([p, s, z], [out, rates, j], |[p, s, z], [out, rates, j]| {
                INPUT_COUPLING.functions.eval_gradient(p, s, z, out, rates, j);
            });
        },
    },
};

/// A first-order lag of the command: `rate = (command - y) / time`.
pub static INPUT_LAG: EffectKernel = EffectKernel {
    id: "input_lag",
    n_parameters: 1,
    n_states: 1,
    n_outputs: 1,
    functions: &EffectTable {
        eval_of_eight: |_, given, results| eval_of_eight(&INPUT_LAG, given, results),
        eval: |p, s, z, out, rates| {
            out[0] = z[0];
            rates[0] = (s[Signal::Command as usize] - z[0]) / p[0];
        },
        eval_gradient: |p, s, z, out, rates, j| {
            out[0] = z[0];
            rates[0] = (s[Signal::Command as usize] - z[0]) / p[0];
            j.fill(0.0);
            let width = 1 + N_SIGNALS + 1;
            j[width - 1] = 1.0;
            j[width] = -rates[0] / p[0];
            j[width + 1 + Signal::Command as usize] = 1.0 / p[0];
            j[2 * width - 1] = -1.0 / p[0];
        },
        eval_lanes: |p, s, z, out, rates| {
            each_lane([p, s, z], [out, rates], |[p, s, z], [out, rates]| INPUT_LAG.functions.eval(p, s, z, out, rates));
        },
        eval_gradient_lanes: |p, s, z, out, rates, j| {
            each_lane([p, s, z], [out, rates, j], |[p, s, z], [out, rates, j]| {
                INPUT_LAG.functions.eval_gradient(p, s, z, out, rates, j);
            });
        },
    },
};

/// `Ks * (q - qeq)`
pub static SPRING: EffectKernel = EffectKernel {
    id: "spring",
    n_parameters: 2,
    n_states: 0,
    n_outputs: 1,
    functions: &EffectTable {
        eval_of_eight: |_, given, results| eval_of_eight(&SPRING, given, results),
        eval: |p, s, _, out, _| out[0] = p[0] * (s[Q] - p[1]),
        eval_gradient: |p, s, _, out, _, j| {
            out[0] = p[0] * (s[Q] - p[1]);
            j.fill(0.0);
            j[0] = s[Q] - p[1];
            j[1] = -p[0];
            j[2 + Q] = p[0];
        },
        eval_lanes: |p, s, z, out, rates| {
            each_lane([p, s, z], [out, rates], |[p, s, z], [out, rates]| SPRING.functions.eval(p, s, z, out, rates));
        },
        eval_gradient_lanes: |p, s, z, out, rates, j| {
            each_lane([p, s, z], [out, rates, j], |[p, s, z], [out, rates, j]| {
                SPRING.functions.eval_gradient(p, s, z, out, rates, j);
            });
        },
    },
};

/// `Fv * dq`
pub static VISCOUS: EffectKernel = EffectKernel {
    id: "viscous",
    n_parameters: 1,
    n_states: 0,
    n_outputs: 1,
    functions: &EffectTable {
        eval_of_eight: |_, given, results| eval_of_eight(&VISCOUS, given, results),
        eval: |p, s, _, out, _| out[0] = p[0] * s[DQ],
        eval_gradient: |p, s, _, out, _, j| {
            out[0] = p[0] * s[DQ];
            j.fill(0.0);
            j[0] = s[DQ];
            j[1 + DQ] = p[0];
        },
        eval_lanes: |p, s, z, out, rates| {
            each_lane([p, s, z], [out, rates], |[p, s, z], [out, rates]| VISCOUS.functions.eval(p, s, z, out, rates));
        },
        eval_gradient_lanes: |p, s, z, out, rates, j| {
            each_lane([p, s, z], [out, rates, j], |[p, s, z], [out, rates, j]| {
                VISCOUS.functions.eval_gradient(p, s, z, out, rates, j);
            });
        },
    },
};

/// The whole friction times `bias` where `q < qeq`.
pub static FRICTION_BIAS: EffectKernel = EffectKernel {
    id: "friction_bias",
    n_parameters: 1,
    n_states: 0,
    n_outputs: 1,
    functions: &EffectTable {
        eval_of_eight: |_, given, results| eval_of_eight(&FRICTION_BIAS, given, results),
        eval: |p, s, _, out, _| {
            let below = f64::from(u8::from(s[Q] < s[Signal::Qeq as usize]));
            out[0] = below * (p[0] - 1.0) * s[Signal::Friction as usize];
        },
        eval_gradient: |p, s, _, out, _, j| {
            let below = f64::from(u8::from(s[Q] < s[Signal::Qeq as usize]));
            out[0] = below * (p[0] - 1.0) * s[Signal::Friction as usize];
            j.fill(0.0);
            j[0] = below * s[Signal::Friction as usize];
            j[1 + Signal::Friction as usize] = below * (p[0] - 1.0);
        },
        eval_lanes: |p, s, z, out, rates| {
            each_lane([p, s, z], [out, rates], |[p, s, z], [out, rates]| {
                FRICTION_BIAS.functions.eval(p, s, z, out, rates)
            });
        },
        eval_gradient_lanes: |p, s, z, out, rates, j| {
            each_lane([p, s, z], [out, rates, j], |[p, s, z], [out, rates, j]| {
                FRICTION_BIAS.functions.eval_gradient(p, s, z, out, rates, j);
            });
        },
    },
};

/// Rotor inertia `Ia`, added to the diagonal of D.
pub static ROTOR_INERTIA: EffectKernel = EffectKernel {
    id: "rotor_inertia",
    n_parameters: 1,
    n_states: 0,
    n_outputs: 1,
    functions: &EffectTable {
        eval_of_eight: |_, given, results| eval_of_eight(&ROTOR_INERTIA, given, results),
        eval: |p, _, _, out, _| out[0] = p[0],
        eval_gradient: |p, _, _, out, _, j| {
            out[0] = p[0];
            j.fill(0.0);
            j[0] = 1.0;
        },
        eval_lanes: |p, s, z, out, rates| {
            each_lane([p, s, z], [out, rates], |[p, s, z], [out, rates]| {
                ROTOR_INERTIA.functions.eval(p, s, z, out, rates)
            });
        },
        eval_gradient_lanes: |p, s, z, out, rates, j| {
            each_lane([p, s, z], [out, rates, j], |[p, s, z], [out, rates, j]| {
                ROTOR_INERTIA.functions.eval_gradient(p, s, z, out, rates, j);
            });
        },
    },
};

/// LuGre friction (thesis Eqs 3.6 to 3.8): `sigma0 sigma1 sigma2 vs Fs Fc`.
pub static LUGRE: EffectKernel = EffectKernel {
    id: "lugre",
    n_parameters: 6,
    n_states: 1,
    n_outputs: 1,
    functions: &EffectTable {
        eval_of_eight: |_, given, results| eval_of_eight(&LUGRE, given, results),
        eval: |p, s, z, out, rates| {
            let v = s[DQ];
            let g = p[5] + (p[4] - p[5]) * (-(v / p[3]).powi(2)).exp();
            rates[0] = v - p[0] * v.abs() / g * z[0];
            out[0] = p[0] * z[0] + p[1] * rates[0] + p[2] * v;
        },
        eval_gradient: |p, s, z, out, rates, j| {
            let v = s[DQ];
            let bell = (-(v / p[3]).powi(2)).exp();
            let g = p[5] + (p[4] - p[5]) * bell;
            let pull = p[0] * v.abs() / g;
            rates[0] = v - pull * z[0];
            out[0] = p[0] * z[0] + p[1] * rates[0] + p[2] * v;
            j.fill(0.0);
            let (output, rate) = j.split_at_mut(6 + N_SIGNALS + 1);
            let by_g = pull * z[0] / g;
            rate[0] = -v.abs() / g * z[0];
            rate[3] = by_g * (p[4] - p[5]) * bell * 2.0 * v * v / p[3].powi(3);
            rate[4] = by_g * bell;
            rate[5] = by_g * (1.0 - bell);
            let g_by_v = (p[4] - p[5]) * bell * -2.0 * v / (p[3] * p[3]);
            rate[6 + DQ] = 1.0 - p[0] * v.signum() / g * z[0] + by_g * g_by_v;
            rate[6 + N_SIGNALS] = -pull;
            for (output, rate) in output.iter_mut().zip(rate.iter()) {
                *output = p[1] * rate;
            }
            output[0] += z[0];
            output[1] += rates[0];
            output[2] += v;
            output[6 + DQ] += p[2];
            output[6 + N_SIGNALS] += p[0];
        },
        eval_lanes: |p, s, z, out, rates| {
            each_lane([p, s, z], [out, rates], |[p, s, z], [out, rates]| LUGRE.functions.eval(p, s, z, out, rates));
        },
        eval_gradient_lanes: |p, s, z, out, rates, j| {
            each_lane([p, s, z], [out, rates, j], |[p, s, z], [out, rates, j]| {
                LUGRE.functions.eval_gradient(p, s, z, out, rates, j);
            });
        },
    },
};

/// Places an effect of this file; parameter symbols are those of the design.
pub fn placed(kernel: &'static EffectKernel, joint: usize, from: Option<usize>, parameters: &[f64]) -> PlacedEffect {
    let symbols: &[&str] = match kernel.id {
        "gain" => &["Kp"],
        "input_coupling" => &["gain"],
        "input_lag" => &["time"],
        "spring" => &["Ks", "qeq"],
        "viscous" => &["Fv"],
        "friction_bias" => &["bias"],
        "rotor_inertia" => &["Ia"],
        _ => &["sigma0", "sigma1", "sigma2", "vs", "Fs", "Fc"],
    };
    let place = match kernel.id {
        "gain" | "input_coupling" | "input_lag" => Place::Actuator,
        "rotor_inertia" => Place::Link,
        _ => Place::Joint,
    };
    let uses: &[Signal] = match kernel.id {
        "gain" | "input_lag" => &[Signal::Command],
        "input_coupling" => &[Signal::Command, Signal::CommandFrom],
        "spring" => &[Signal::Q],
        "friction_bias" => &[Signal::Q, Signal::Qeq, Signal::Friction],
        "rotor_inertia" => &[],
        _ => &[Signal::Dq],
    };
    let middle = from.map_or(String::new(), |from| format!("{from}."));
    PlacedEffect {
        kernel,
        place,
        stage: match kernel.id {
            "gain" => Some(Stage::Gain),
            "input_coupling" => Some(Stage::Coupling),
            "input_lag" => Some(Stage::Lag),
            _ => None,
        },
        is_friction: matches!(kernel.id, "viscous" | "lugre"),
        joint: Some(joint),
        from,
        names: symbols.iter().map(|symbol| format!("joint.{joint}.{}.{middle}{symbol}", kernel.id)).collect(),
        parameters: parameters.to_vec(),
        state_names: (0..kernel.n_states).map(|_| format!("joint.{joint}.{}.z", kernel.id)).collect(),
        initial_states: vec![0.0; kernel.n_states],
        states_at_speed: Vec::new(),
        link: None,
        outputs: vec![if place == Place::Link { Output::Inertia } else { Output::Torque }],
        uses: SignalSet::of(uses),
    }
}

/// The arm with every kind of effect.
pub fn full_arm() -> System {
    let links = vec![1.2, 0.21, 0.02, 0.8, 0.17, 0.011];
    let effects = [
        placed(&GAIN, 0, None, &[1.4]),
        placed(&GAIN, 1, None, &[0.8]),
        placed(&INPUT_COUPLING, 1, Some(0), &[-0.2]),
        placed(&INPUT_LAG, 0, None, &[0.03]),
        placed(&SPRING, 0, None, &[0.9, 2.5]),
        placed(&SPRING, 1, None, &[0.3, -0.1]),
        placed(&LUGRE, 0, None, &[3.0, 0.4, 0.05, 0.2, 0.5, 0.3]),
        placed(&LUGRE, 1, None, &[2.0, 0.2, 0.03, 0.1, 0.2, 0.1]),
        placed(&FRICTION_BIAS, 0, None, &[1.5]),
        placed(&VISCOUS, 1, None, &[0.02]),
        placed(&ROTOR_INERTIA, 1, None, &[0.004]),
    ];
    System::new(&ARM, 2, links, Vec::new(), &effects).expect("the arm is complete")
}

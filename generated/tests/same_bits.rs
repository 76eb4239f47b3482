//! The bits that the kernels compute for numbers alone, as digests: the same on every machine, whatever its processor has.
//! (`eight_states_have_the_bits_of_each_alone` ties those of several states at once to them.)
//!
//! A digest changes with the equations, the emitted text and the random states (`support`). Where it changes without these, a compiler or
//! a processor rounds in another way.

mod support;

use std::fmt::Write as _;

use dynid_generated::{N_SIGNALS, effects, end_point, kernels};
use dynid_plant::random::Noise;
use support::{Case, cases};

/// States per kernel and points per effect.
const COUNT: usize = 20;

/// Digest of numbers in the order in which they are taken.
#[derive(Default)]
struct Bits(Vec<u8>);

impl Bits {
    /// All are numbers: what is none was not written.
    fn take(&mut self, values: &[f64]) {
        for value in values {
            assert!(!value.is_nan());
            self.0.extend(value.to_bits().to_le_bytes());
        }
    }

    fn digest(&self) -> String {
        dynid_model::sha256_hex(&self.0)[..16].to_owned()
    }
}

fn all_of(case: &Case, bits: &mut Bits) {
    bits.take(&case.prepared);
    bits.take(&case.inertia());
    bits.take(&case.bias());
    bits.take(&case.gravity());
    bits.take(&case.coriolis());
    bits.take(&case.inverse_dynamics(&case.ddq));
    bits.take(&case.forward_dynamics(&case.ddq));
    bits.take(&case.regressor());
    let (d, h) = case.inertia_and_bias();
    let (tau, by_q, by_dq) = case.inverse_dynamics_gradient();
    [d, h, tau, by_q, by_dq].iter().for_each(|values| bits.take(values));
}

/// Between 0 and 1 above `low`.
fn some(noise: &mut Noise, count: usize, low: f64) -> Vec<f64> {
    (0..count).map(|_| low + noise.uniform()).collect()
}

fn unwritten(count: usize) -> Vec<f64> {
    vec![f64::NAN; count]
}

#[test]
fn of_every_kernel_and_effect() {
    let mut table = String::new();
    for kernel in kernels() {
        let mut bits = Bits::default();
        cases(kernel, Noise::new(41), COUNT).for_each(|case| all_of(&case, &mut bits));
        let name = format!("{} c{:02}", kernel.device, kernel.configuration.unwrap_or_default());
        writeln!(table, "{name:<20} {}", bits.digest()).unwrap();
    }
    let mut noise = Noise::new(42);
    for point in dynid_model::devices().iter().filter_map(|device| end_point(&device.id)) {
        let mut bits = Bits::default();
        for _ in 0..COUNT {
            let lengths = some(&mut noise, point.parameters.len(), 0.2);
            let q = some(&mut noise, point.n_joints, -0.5);
            let (mut position, mut rotation, mut jacobian) = (unwritten(3), unwritten(9), unwritten(6 * q.len()));
            point.functions.motion(&lengths, &q, &mut position, &mut rotation, &mut jacobian);
            [position, rotation, jacobian].iter().for_each(|values| bits.take(values));
        }
        let name = format!("{} end", point.device);
        writeln!(table, "{name:<20} {}", bits.digest()).unwrap();
    }
    for effect in effects() {
        let mut bits = Bits::default();
        for _ in 0..COUNT {
            let parameters = some(&mut noise, effect.n_parameters, 0.2);
            let (signals, states) = (some(&mut noise, N_SIGNALS, -0.5), some(&mut noise, effect.n_states, -0.5));
            let (mut outputs, mut rates) = (unwritten(effect.n_outputs), unwritten(effect.n_states));
            effect.functions.eval(&parameters, &signals, &states, &mut outputs, &mut rates);
            bits.take(&outputs);
            bits.take(&rates);
            let width = parameters.len() + signals.len() + states.len();
            let mut jacobian = unwritten((outputs.len() + rates.len()) * width);
            effect.functions.eval_gradient(&parameters, &signals, &states, &mut outputs, &mut rates, &mut jacobian);
            [outputs, rates, jacobian].iter().for_each(|values| bits.take(values));
        }
        writeln!(table, "{:<20} {}", effect.id, bits.digest()).unwrap();
    }
    insta::assert_snapshot!(table);
}

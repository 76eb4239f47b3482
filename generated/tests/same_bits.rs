//! The bits that every kernel computes, as digests: the same on every machine, whatever its processor has.
//!
//! A snapshot that changes without a change of the kernels' text means that a compiler or a processor rounds in another way.

mod support;

use std::fmt::Write as _;

use dynid_generated::{N_SIGNALS, effects, kernels};
use dynid_plant::random::Noise;
use sha2::{Digest as _, Sha256};
use support::{Case, cases};

/// States per kernel and points per effect.
const COUNT: usize = 20;

/// Digest of numbers in the order in which they are taken.
#[derive(Default)]
struct Bits(Sha256);

impl Bits {
    fn take(&mut self, values: &[f64]) {
        for value in values {
            // A processor chooses the sign of what is no number.
            let value = if value.is_nan() { f64::NAN } else { *value };
            self.0.update(value.to_bits().to_le_bytes());
        }
    }

    fn digest(self) -> String {
        self.0.finalize().iter().take(8).fold(String::new(), |mut text, byte| {
            write!(text, "{byte:02x}").expect("a string takes all");
            text
        })
    }
}

fn all_of(case: &Case, bits: &mut Bits) {
    bits.take(&case.prepared);
    bits.take(&case.gravity());
    bits.take(&case.coriolis());
    bits.take(&case.inverse_dynamics(&case.ddq));
    bits.take(&case.forward_dynamics(&case.ddq));
    bits.take(&case.regressor());
    let (d, h) = case.inertia_and_bias();
    let (tau, by_q, by_dq) = case.inverse_dynamics_gradient();
    [d, h, tau, by_q, by_dq].iter().for_each(|values| bits.take(values));
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
    for effect in effects() {
        let mut bits = Bits::default();
        for _ in 0..COUNT {
            let mut some = |count: usize, low: f64| (0..count).map(|_| low + noise.uniform()).collect::<Vec<f64>>();
            let (parameters, signals, states) =
                (some(effect.n_parameters, 0.2), some(N_SIGNALS, -0.5), some(effect.n_states, -0.5));
            let (mut outputs, mut rates) = (vec![0.0; effect.n_outputs], vec![0.0; effect.n_states]);
            let width = parameters.len() + signals.len() + states.len();
            let mut jacobian = vec![0.0; (outputs.len() + rates.len()) * width];
            let functions = effect.functions;
            functions.eval_gradient(&parameters, &signals, &states, &mut outputs, &mut rates, &mut jacobian);
            [outputs, rates, jacobian].iter().for_each(|values| bits.take(values));
        }
        writeln!(table, "{:<20} {}", effect.id, bits.digest()).unwrap();
    }
    insta::assert_snapshot!(table);
}

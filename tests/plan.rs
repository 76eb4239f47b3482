//! What appears in the equations, found a second time: from the kernels' numbers instead of by algebra.
//!
//! A link parameter appears when the torques change with it in some state: `d tau / d p = Y d lumps / d p`. At random
//! states, lengths and angles a sum that vanishes identically (`s^2 + c^2 - 1`) leaves rounding alone.

use std::collections::BTreeSet;

use dynid_generated::Kernel;
use dynid_plant::random::Noise;

const STATES: usize = 6;
/// Below this share of the largest derivative is rounding; values, angles and rates are all of order one.
const ROUNDING: f64 = 1e-9;

fn appearing(kernel: &Kernel) -> BTreeSet<String> {
    let (n, n_lumps, n_parameters) = (kernel.free.len(), kernel.n_lumps, kernel.parameters.len());
    let mut random = Noise::new(11);
    let mut appearing = BTreeSet::new();
    for _ in 0..STATES {
        let mut draw = |length: usize, low: f64, high: f64| -> Vec<f64> {
            (0..length).map(|_| low + (high - low) * random.uniform()).collect()
        };
        let parameters = draw(n_parameters, 0.5, 1.5);
        let locked = draw(kernel.locked.len(), -3.0, 3.0);
        let [q, dq, ddq] = [draw(n, -3.0, 3.0), draw(n, -3.0, 3.0), draw(n, -3.0, 3.0)];
        let mut prepared = vec![0.0; kernel.prepared.len()];
        (kernel.prepare)(&parameters, &locked, &mut prepared);
        let mut by_parameter = vec![0.0; kernel.prepared.len() * n_parameters];
        (kernel.prepare_gradient)(&parameters, &locked, &mut by_parameter);
        let mut regressor = vec![0.0; n * n_lumps];
        (kernel.regressor)(&prepared, &q, &dq, &ddq, &mut regressor);
        let mut derivatives = Vec::new();
        for (column, name) in kernel.parameters.iter().enumerate().filter(|(_, name)| name.starts_with("link.")) {
            for row in 0..n {
                let terms = (0..n_lumps)
                    .map(|lump| regressor[row * n_lumps + lump] * by_parameter[lump * n_parameters + column]);
                derivatives.push(((*name).to_owned(), terms.sum::<f64>().abs()));
            }
        }
        let largest = derivatives.iter().fold(0.0, |largest: f64, (_, size)| largest.max(*size));
        appearing.extend(derivatives.into_iter().filter(|(_, size)| *size > ROUNDING * largest).map(|(name, _)| name));
    }
    appearing
}

#[test]
fn algebra_and_numbers_agree_on_what_appears() {
    assert!(!dynid_generated::kernels().is_empty());
    for kernel in dynid_generated::kernels() {
        let by_numbers = appearing(kernel);
        let by_algebra = dynid::plan::appearing(kernel);
        assert_eq!(by_numbers, by_algebra, "{} configuration {}", kernel.device, kernel.configuration);
    }
}

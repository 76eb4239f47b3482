//! What a call of a kernel costs, on one core, through the table that every caller uses.
//!
//! Ids: `<kernel>/<device>/<free joints>`, e.g. `inertia/freedom6s/all`. Sines and cosines are part of every kernel;
//! `sincos/<n>` is what n angles cost alone.
//!
//! Calls do not wait for each other, except those of `forward_dynamics/<device>/<free joints>`: as in a simulation, a
//! call needs what the one before gave. `forward_dynamics/<device>/<free joints>_throughput` is without that, and
//! `.._of_eight_in_<lanes>` is the call of eight states at once in registers of so many.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use dynid_generated::{EffectKernel, Eight, Kernel, N_SIGNALS, Scalar, Width, effect, kernel};
use dynid_model::{Device, device};

/// What is measured: device, free joints, and how the set is called.
const CASES: [(&str, &[usize], &str); 4] = [
    ("freedom6s", &[0, 1, 2, 3, 4, 5], "all"),
    ("freedom6s", &[4], "joint4"),
    ("freedom6s", &[0, 1], "joints01"),
    ("staubli_tx40", &[0, 1, 2, 3, 4, 5], "all"),
];

/// A body for links that a device file makes points of mass, or nothing: with those, D may have no inverse.
const BODY: [f64; 10] = [0.2, 0.0, 0.0, 0.03, 3e-4, 0.0, 0.0, 3e-4, 0.0, 2e-4];

/// A kernel with the device's own parameter values at a state where no sine is 0.
struct Case {
    kernel: &'static Kernel,
    parameters: Vec<f64>,
    prepared: Vec<f64>,
    q: Vec<f64>,
    dq: Vec<f64>,
    tau: Vec<f64>,
}

impl Case {
    fn new(id: &str, free: &[usize]) -> Case {
        let Some(device) = device(id) else { panic!("the library has no `{id}`") };
        let Some(kernel) = device.configuration_of(free).and_then(|number| kernel(id, number)) else {
            panic!("{id} has no configuration with the joints {free:?} free")
        };
        let parameters: Vec<f64> = kernel.parameters.iter().map(|name| value(device, name)).collect();
        let locked: Vec<f64> = kernel.locked.iter().map(|&joint| 0.3 + 0.1 * joint as f64).collect();
        let mut prepared = vec![0.0; kernel.prepared.len()];
        kernel.functions.prepare(&parameters, &locked, &mut prepared);
        let per_joint = |of: fn(f64) -> f64| -> Vec<f64> { free.iter().map(|&joint| of(joint as f64)).collect() };
        let (q, dq, tau) =
            (per_joint(|joint| 0.4 - 0.15 * joint), per_joint(|joint| 0.7 - 0.2 * joint), per_joint(f64::sin));
        let mut ddq = vec![f64::NAN; free.len()];
        kernel.functions.forward_dynamics(&prepared, &q, &dq, &tau, &mut ddq);
        assert!(ddq.iter().all(|ddq| ddq.is_finite()), "{id}, joints {free:?}: ddq {ddq:?}");
        Case { kernel, parameters, prepared, q, dq, tau }
    }

    fn n(&self) -> usize {
        self.q.len()
    }
}

/// The value of a parameter as the device file gives it; links without mass or inertia have [`BODY`].
fn value(device: &Device, name: &str) -> f64 {
    let parts: Vec<&str> = name.split('.').collect();
    let found = match parts.as_slice() {
        ["link", number, symbol] => number.parse::<usize>().ok().and_then(|number| {
            let place = dynid_model::Link::SYMBOLS.iter().position(|known| known == symbol)?;
            let values = device.links.get(number.checked_sub(1)?)?.values();
            let is_body = [0, 4, 7, 9].iter().all(|&place| values[place] > 0.0);
            Some(if is_body { values[place] } else { BODY[place] })
        }),
        ["length", symbol] => device.lengths.iter().find(|length| length.symbol == *symbol).map(|length| length.value),
        ["base", "gx"] => Some(device.gravity * device.up[0]),
        ["base", "gy"] => Some(device.gravity * device.up[1]),
        ["base", "gz"] => Some(device.gravity * device.up[2]),
        _ => None,
    };
    found.unwrap_or_else(|| panic!("`{name}` is a parameter of {}", device.id))
}

fn kernels(criterion: &mut Criterion) {
    for (id, free, set) in CASES {
        let case = Case::new(id, free);
        let (kernel, n) = (case.kernel, case.n());
        let prepared = black_box(case.prepared.clone());
        let mut vector = vec![0.0; n];
        let mut matrix = vec![0.0; n * n];
        let mut second = vec![0.0; n * n];
        let mut regressor = vec![0.0; n * kernel.n_lumps];

        let mut q = case.q.clone();
        criterion.bench_function(&format!("forward_dynamics/{id}/{set}"), |bencher| {
            bencher.iter(|| {
                kernel.functions.forward_dynamics(&prepared, &q, &case.dq, &case.tau, &mut vector);
                // The posture hardly moves, but the next call has to wait for this one.
                for ((q, start), ddq) in q.iter_mut().zip(&case.q).zip(&vector) {
                    *q = start + 1e-9 * ddq;
                }
            });
        });
        criterion.bench_function(&format!("forward_dynamics/{id}/{set}_throughput"), |bencher| {
            bencher.iter(|| {
                kernel.functions.forward_dynamics(&prepared, black_box(&case.q), &case.dq, &case.tau, &mut vector);
            });
        });
        let given = [&prepared, &case.q, &case.dq, &case.tau].into_iter().flatten();
        let given: Vec<Eight> = given.map(|value| [*value; 8]).collect();
        let mut accelerations = vec![[0.0; 8]; n];
        for width in Width::all() {
            let id = format!("forward_dynamics/{id}/{set}_of_eight_in_{}", width.lanes());
            criterion.bench_function(&id, |bencher| {
                bencher.iter(|| {
                    kernel.functions.forward_dynamics_of_eight(width, black_box(&given), &mut accelerations);
                });
            });
        }
        criterion.bench_function(&format!("inertia/{id}/{set}"), |bencher| {
            bencher.iter(|| {
                kernel.functions.inertia(&prepared, black_box(&case.q), &mut matrix);
            });
        });
        criterion.bench_function(&format!("bias/{id}/{set}"), |bencher| {
            bencher.iter(|| {
                kernel.functions.bias(&prepared, black_box(&case.q), &case.dq, &mut vector);
            });
        });
        criterion.bench_function(&format!("inertia_and_bias/{id}/{set}"), |bencher| {
            bencher.iter(|| {
                kernel.functions.inertia_and_bias(&prepared, black_box(&case.q), &case.dq, &mut matrix, &mut vector);
            });
        });
        criterion.bench_function(&format!("regressor/{id}/{set}"), |bencher| {
            bencher.iter(|| {
                kernel.functions.regressor(&prepared, black_box(&case.q), &case.dq, &case.tau, &mut regressor);
            });
        });
        criterion.bench_function(&format!("inverse_dynamics_gradient/{id}/{set}"), |bencher| {
            bencher.iter(|| {
                let (q, dq, ddq) = (black_box(&case.q), &case.dq, &case.tau);
                kernel.functions.inverse_dynamics_gradient(
                    &prepared,
                    q,
                    dq,
                    ddq,
                    &mut vector,
                    &mut matrix,
                    &mut second,
                );
            });
        });
        let locked = vec![0.3; kernel.locked.len()];
        let mut jacobian = vec![0.0; kernel.prepared.len() * case.parameters.len()];
        criterion.bench_function(&format!("prepare_gradient/{id}/{set}"), |bencher| {
            bencher.iter(|| kernel.functions.prepare_gradient(black_box(&case.parameters), &locked, &mut jacobian));
        });
    }
}

/// The friction law that a simulation evaluates at every stage of every step.
fn effects(criterion: &mut Criterion) {
    let Some(EffectKernel { functions, .. }) = effect("lugre") else { panic!("the library has no `lugre`") };
    // sigma0, sigma1, sigma2, vs, Fs, Fc
    let parameters = black_box([6.7, 0.05, 0.01, 0.1, 0.06, 0.04]);
    let (signals, states) = ([0.1; N_SIGNALS], [1e-3]);
    let (mut outputs, mut rates, mut jacobian) = ([0.0], [0.0], [0.0; 2 * (6 + N_SIGNALS + 1)]);
    criterion.bench_function("effect/lugre", |bencher| {
        bencher.iter(|| {
            functions.eval(&parameters, black_box(&signals), &states, &mut outputs, &mut rates);
        });
    });
    criterion.bench_function("effect_gradient/lugre", |bencher| {
        bencher.iter(|| {
            functions.eval_gradient(&parameters, black_box(&signals), &states, &mut outputs, &mut rates, &mut jacobian);
        });
    });
}

fn sines_and_cosines(criterion: &mut Criterion) {
    criterion.bench_function("sincos/1", |bencher| bencher.iter(|| f64::sines_cosines(black_box([0.4]))));
    let angles = [0.4, 0.7, -0.3, 1.9, 2.2, -1.1];
    criterion.bench_function("sincos/6", |bencher| bencher.iter(|| f64::sines_cosines(black_box(angles))));
}

criterion_group!(benches, kernels, effects, sines_and_cosines);
criterion_main!(benches);

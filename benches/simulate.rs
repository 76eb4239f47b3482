//! How long a simulation takes: 60 s of the Freedom 6S, all joints free, LuGre friction, Runge-Kutta at 1/6 ms.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use dynid::{
    model::Model,
    simulate::{Hold, Input, Options, simulate},
    system::System,
};

/// The thesis's coupled inputs (Table 4.7): amplitude and its rise [N*m], frequency and its rise [rad/s], phase [rad].
const CHIRPS: [[f64; 5]; 6] = [
    [0.02, 0.0, 1.0, 2.0, std::f64::consts::FRAC_PI_2],
    [0.008, 0.01, 1.0, 1.0, 0.0],
    [0.01, 0.01, 1.0, 0.5, 0.0],
    [0.008, 0.002, 0.5, 0.5, 0.0],
    [0.0045, -0.002, 0.5, 2.5, std::f64::consts::FRAC_PI_2],
    [0.0055, -0.003, 0.5, 2.0, 0.0],
];

fn all_joints(criterion: &mut Criterion) {
    let Some(device) = dynid_model::device("freedom6s") else { return };
    let model = Model::of_device(device);
    let free: Vec<usize> = (0..device.joints.len()).collect();
    let system = match System::of_model(&model, &free, |_| 0.0) {
        Ok(system) => system,
        Err(error) => panic!("{error}"),
    };
    let time: Vec<f64> = (0..=6000).map(|k| f64::from(k) * 0.01).collect();
    let command: Vec<f64> = time
        .iter()
        .flat_map(|t| {
            CHIRPS.map(|[size, rise, rate, sweep, phase]| {
                (size + rise / 60.0 * t) * ((rate + sweep / 60.0 * t) * t + phase).cos()
            })
        })
        .collect();
    let input = Input { time: &time, command: &command, hold: Hold::Zero };
    let start = [0.0, 0.15, -0.05, 0.35, -0.25, -0.4];
    let mut group = criterion.benchmark_group("simulate/freedom6s");
    group.sample_size(10);
    group.bench_function("all_60s", |bencher| {
        bencher.iter(|| simulate(black_box(&system), &input, &start, &Options::default()).is_ok());
    });
    group.finish();
}

criterion_group!(benches, all_joints);
criterion_main!(benches);

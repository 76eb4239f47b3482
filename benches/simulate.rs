//! How long a simulation takes: 60 s of the Freedom 6S, all joints free, LuGre friction, Runge-Kutta at 1/6 ms and in adapted steps.

mod shared;

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use dynid_dynamics::{simulate::Input, simulate::Intersample, simulate::Options, simulate::simulate};

fn all_joints(criterion: &mut Criterion) {
    let system = match shared::all_joints() {
        Ok(system) => system,
        Err(error) => panic!("{error}"),
    };
    let (time, command) = shared::coupled_commands();
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let mut group = criterion.benchmark_group("simulate/freedom6s");
    group.sample_size(10);
    let stated = Options::per_sample(shared::SUBSTEPS);
    for (name, options) in [("all_60s", stated), ("all_60s_adapted", Options::default())] {
        group.bench_function(name, |bencher| {
            bencher.iter(|| simulate(black_box(&system), &input, &shared::START, &options).is_ok());
        });
    }
    group.finish();
}

criterion_group!(benches, all_joints);
criterion_main!(benches);

//! How long a simulation takes: 60 s of the Freedom 6S, all joints free, LuGre friction, Runge-Kutta at 1/6 ms.

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
    group.bench_function("all_60s", |bencher| {
        bencher.iter(|| simulate(black_box(&system), &input, &shared::START, &Options::default()).is_ok());
    });
    group.finish();
}

criterion_group!(benches, all_joints);
criterion_main!(benches);

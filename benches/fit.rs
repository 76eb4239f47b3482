//! How long a position fit takes: one joint, 13 unknowns, a 60 s log at 100 Hz, started as far
//! off as the thesis's guesses are from its results; and of the same joint with friction that needs no state, 6 unknowns.

mod shared;

use criterion::{Criterion, criterion_group, criterion_main};
use dynid_identify::SearchControl;
use dynid_identify::{position, position::Options, position::PositionProblem};

fn joints(criterion: &mut Criterion) {
    measure(criterion, "one_joint", shared::one_joint_problem());
    measure(criterion, "linear_joint", shared::linear_joint_problem());
}

fn measure(criterion: &mut Criterion, name: &str, problem: anyhow::Result<PositionProblem>) {
    let problem = match problem {
        Ok(problem) => problem,
        Err(error) => panic!("{error}"),
    };
    let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(1).build() else { return };
    let fit = || pool.install(|| position::fit(&problem, &Options::default(), &mut |_| SearchControl::Continue));
    match fit() {
        Ok(fit) => {
            assert!(fit.runs[0].rmse[0] < 1.03 * shared::NOISE, "the noise is reached: {} rad", fit.runs[0].rmse[0])
        }
        Err(error) => panic!("{error}"),
    }
    let mut group = criterion.benchmark_group("fit/freedom6s");
    group.sample_size(10);
    group.bench_function(name, |bencher| bencher.iter(|| fit().is_ok()));
    group.finish();
}

criterion_group!(benches, joints);
criterion_main!(benches);

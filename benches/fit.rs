//! How long a position fit takes: one joint, 13 unknowns, a 60 s log at 100 Hz, Runge-Kutta at 1/6 ms, started as far
//! off as the thesis's guesses are from its results.

use criterion::{Criterion, criterion_group, criterion_main};
use dynid::{
    fit::{
        position::{self, FitRun, Options, PositionProblem},
        sqp::Watch,
    },
    model::Model,
    simulate::{self, Hold, Input},
    system::System,
};

/// The joint that is free.
const JOINT: usize = 4;
/// Relative error of the start, alternating in sign: links, then effects.
const OFF: [f64; 2] = [0.05, 0.12];
/// Standard deviation of the log's noise [rad].
const NOISE: f64 = 2e-4;

/// White noise of a fixed seed: sums of twelve uniform numbers.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// A log that `model` explains, with the model's own system.
fn log(model: &Model) -> FitRun {
    let system = match System::of_model(model, &[JOINT], |_| 0.0) {
        Ok(system) => system,
        Err(error) => panic!("{error}"),
    };
    let time: Vec<f64> = (0..=6000).map(|k| f64::from(k) * 0.01).collect();
    let mut command = vec![0.0; time.len() * system.n_joints()];
    for (row, t) in command.chunks_exact_mut(system.n_joints()).zip(&time) {
        row[JOINT] = 0.005 * ((0.5 + 2.5 / 60.0 * t) * t).cos();
    }
    let input = Input { time: &time, command: &command, hold: Hold::Zero };
    let motion = match simulate::simulate(&system, &input, &[-0.28], &simulate::Options::default()) {
        Ok(motion) => motion,
        Err(error) => panic!("{error}"),
    };
    let mut noise = Noise(11);
    let position = motion.q.iter().map(|q| q + NOISE * noise.next()).collect();
    FitRun {
        name: "chirp".to_owned(),
        system,
        time,
        command,
        position,
        hold: Hold::Zero,
        weights: vec![1.0],
        from_s: f64::NEG_INFINITY,
        first_half: 1.0,
    }
}

fn problem() -> Option<PositionProblem> {
    let truth = Model::of_device(dynid_model::device("freedom6s")?);
    let run = log(&truth);
    let mut problem = PositionProblem::of_model(&truth, []).ok()?;
    problem.unknowns.retain(|unknown| run.occurs(&unknown.name));
    for (index, unknown) in problem.unknowns.iter_mut().enumerate() {
        let off = OFF[usize::from(unknown.name.starts_with("joint"))];
        let sign = if index % 2 == 0 { 1.0 } else { -1.0 };
        unknown.value = (unknown.value * (1.0 + sign * off)).clamp(unknown.lower, unknown.upper);
        unknown.expected = unknown.value;
    }
    problem.runs.push(run);
    Some(problem)
}

fn one_joint(criterion: &mut Criterion) {
    let Some(problem) = problem() else { return };
    let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(1).build() else { return };
    let fit = || pool.install(|| position::fit(&problem, &Options::default(), &mut |_| Watch::Continue));
    match fit() {
        Ok(fit) => assert!(fit.runs[0].rmse[0] < 1.03 * NOISE, "the noise is reached: {} rad", fit.runs[0].rmse[0]),
        Err(error) => panic!("{error}"),
    }
    let mut group = criterion.benchmark_group("fit/freedom6s");
    group.sample_size(10);
    group.bench_function("one_joint", |bencher| bencher.iter(|| fit().is_ok()));
    group.finish();
}

criterion_group!(benches, one_joint);
criterion_main!(benches);

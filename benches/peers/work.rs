//! The work that the peers do, as JSON on stdout: the commands of the benchmark `simulate/freedom6s/all_60s` and where they
//! lead, what `forward_dynamics/freedom6s/all` gives, and the logs of the fits with the starts of their unknowns. With it, what these cost us, measured
//! as the peers measure themselves: in CPU seconds of one thread, which do not depend on what else the machine does.
//!
//! `cargo run --release --example peers_work`, mostly by `cargo xtask bench --peers`.

#[path = "../shared/mod.rs"]
mod shared;

use std::{fs, hint::black_box, time::Instant};

use anyhow::ensure;
use dynid_dynamics::simulate::{self, Input, Intersample, Options, Predictor, simulate};
use dynid_dynamics::system::System;
use dynid_generated::{Eight, Lanewise, Scalar, Width};
use dynid_identify::sensitivity::{self, Columns, Lumps};
use dynid_identify::{SearchControl, position, position::PositionProblem};
use serde_json::{Value, json};

fn main() -> anyhow::Result<()> {
    let system = shared::all_joints()?;
    let (time, command) = shared::coupled_commands();
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let stated = Options::per_sample(shared::SUBSTEPS);
    let motion = simulate(&system, &input, &shared::START, &stated)?;
    let n = system.n_joints();
    let per_joint = |of: fn(f64) -> f64| -> Vec<f64> { (0..n).map(|joint| of(joint as f64)).collect() };
    let (q, dq, tau) =
        (per_joint(|joint| 0.4 - 0.15 * joint), per_joint(|joint| 0.7 - 0.2 * joint), per_joint(f64::sin));
    let mut ddq = vec![0.0; n];
    system.kernel().functions.forward_dynamics(system.prepared(), &q, &dq, &tau, &mut ddq);
    let simulated = fastest(5, || {
        simulate(black_box(&system), &input, &shared::START, &stated)?;
        Ok(())
    })?;
    let calls = 200_000;
    let (mut moved, mut next) = (q.clone(), ddq.clone());
    let called = fastest(5, || {
        for _ in 0..calls {
            system.kernel().functions.forward_dynamics(system.prepared(), &moved, &dq, &tau, &mut next);
            // The posture hardly moves, but the next call has to wait for this one.
            for ((moved, q), next) in moved.iter_mut().zip(&q).zip(&next) {
                *moved = q + 1e-9 * next;
            }
        }
        Ok(())
    })?;
    let problem = shared::one_joint_problem()?;
    let linear = shared::linear_joint_problem()?;
    let run = &problem.runs[0];
    let alone = shared::one_joint()?;
    let mut adapted = Vec::new();
    for (what, system, input, start) in [
        ("one joint", &alone, run.input(), [shared::JOINT_START].as_slice()),
        ("six joints", &system, input, shared::START.as_slice()),
    ] {
        adapted.extend(adapted_steps(what, system, &input, start)?);
    }
    let work = json!({
        "lanes": in_lanes(&system, [&q, &dq, &tau], called / f64::from(calls))?,
        "adapted": adapted,
        "ours": {
            "forward_dynamics": called / f64::from(calls),
            "simulate": simulated,
            "fit": fitted(&problem)?,
            "linear_fit": fitted(&linear)?,
        },
        "simulate": {
            "commands": command,
            "start": shared::START,
            "last": motion.q[motion.q.len() - shared::START.len()..],
        },
        "forward_dynamics": { "q": q, "dq": dq, "tau": tau, "ddq": ddq },
        "fit": fit(&problem),
        "linear_fit": fit(&linear),
    });
    println!("{work}");
    Ok(())
}

/// What forward dynamics costs a state where eight are computed at once, by the width of the registers; and what it would cost if it were
/// nothing but its additions, multiplications and divisions, none of which waited for another. `alone`: what one state costs.
fn in_lanes(system: &System, states: [&[f64]; 3], alone: f64) -> anyhow::Result<Vec<Value>> {
    /// Additions and multiplications of the sine and the cosine of an angle (`generated/src/trigonometry.rs`).
    const OF_AN_ANGLE: usize = 50;
    const CALLS: u32 = 100_000;
    let kernel = system.kernel();
    let given: Vec<Eight> = [system.prepared(), &states.concat()].concat().iter().map(|value| [*value; 8]).collect();
    let mut results = vec![[0.0; 8]; kernel.free.len()];
    let found = kernel.operations.iter().find(|operations| operations.kernel == "forward_dynamics");
    let counted = found.map_or(0, |of| of.adds + of.muls + of.divs + OF_AN_ANGLE * of.sincos);
    let row =
        |lanes: usize, seconds: f64, floor: Option<f64>| json!({ "lanes": lanes, "seconds": seconds, "floor": floor });
    let mut rows = vec![row(1, alone, None)];
    for width in Width::all() {
        let called = fastest(9, || {
            for _ in 0..CALLS {
                kernel.functions.forward_dynamics_of_eight(width, black_box(&given), &mut results);
            }
            Ok(())
        })?;
        let mut sums = [[0.0; 8]; Arithmetic::SUMS];
        let computed = fastest(9, || {
            for _ in 0..CALLS {
                width.of_eight(&Arithmetic, black_box(&[[0.5; 8], [0.25; 8]]), &mut sums);
                black_box(&sums);
            }
            Ok(())
        })?;
        let floor = computed / Arithmetic::OPERATIONS as f64 * counted as f64;
        rows.push(row(width.lanes(), called / f64::from(8 * CALLS), Some(floor / f64::from(8 * CALLS))));
    }
    Ok(rows)
}

/// As many additions as multiplications, of which so many wait for none of the others.
struct Arithmetic;

impl Arithmetic {
    const SUMS: usize = 12;
    const ROUNDS: usize = 40;
    const OPERATIONS: usize = 2 * Self::SUMS * Self::ROUNDS;
}

impl Lanewise<2, { Arithmetic::SUMS }> for Arithmetic {
    #[inline(always)]
    fn of<S: Scalar>(&self, [factor, added]: &[S; 2]) -> [S; Self::SUMS] {
        let mut sums = [*added; Self::SUMS];
        for _ in 0..Self::ROUNDS {
            for sum in &mut sums {
                *sum = *sum * *factor + *added;
            }
        }
        sums
    }
}

/// What a simulation and its gradient by all unknowns cost with as many steps as the peers take, and with as few as a tolerance asks for;
/// and how far the latter are from steps ten times as short as the former.
fn adapted_steps(what: &str, system: &System, input: &Input<'_>, start: &[f64]) -> anyhow::Result<[Value; 2]> {
    /// What an interval of the gradient's motion may err by [rad].
    const TOLERANCE: f64 = 1e-6;
    let away = |q: &[f64], fine: &[f64]| q.iter().zip(fine).fold(0.0_f64, |most, (q, fine)| most.max((q - fine).abs()));
    let fine = simulate(system, input, start, &Options::per_sample(10 * shared::SUBSTEPS))?.q;
    let stated = Options::per_sample(shared::SUBSTEPS);
    let simulated = |options: &Options| {
        fastest(5, || {
            black_box(simulate(black_box(system), input, start, options)?);
            Ok(())
        })
    };
    let row = |what: String, stated_s: f64, adapted_s: f64, away: f64| json!({ "what": what, "stated_s": stated_s, "adapted_s": adapted_s, "away": away });
    let own = simulate(system, input, start, &Options::default())?.q;
    let simulation =
        row(format!("{what}, 60 s"), simulated(&stated)?, simulated(&Options::default())?, away(&own, &fine));
    let columns = Columns::new(system, |_| true, Lumps::Wanted);
    // Predictions that nothing corrects are a simulation.
    let rates = vec![0.0; system.n_free()];
    let predictor = Predictor { position: &fine, rates: &rates, schemes: &[] };
    let planned = simulate::plan(system, input, &predictor, start, &vec![TOLERANCE; system.n_free()])?;
    let predictor = Predictor { schemes: &planned.schemes, ..predictor };
    let observe = |_: usize, q: &[f64], by: &[f64]| {
        black_box((q, by));
    };
    let with_stated = fastest(2, || Ok(sensitivity::simulate(system, &columns, input, start, &stated, observe)?))?;
    let with_adapted =
        fastest(3, || Ok(sensitivity::predict(system, &columns, input, &predictor, start, &stated, observe)?))?;
    let gradient = row(
        format!("its gradient by {} unknowns, steps planned once", columns.count()),
        with_stated,
        with_adapted,
        away(&planned.predicted, &fine),
    );
    Ok([simulation, gradient])
}

/// The log and the start of a fit.
fn fit(problem: &PositionProblem) -> Value {
    let run = &problem.runs[0];
    let unknowns = problem.unknowns.iter().map(
        |unknown| json!({ "name": unknown.name, "start": unknown.value, "lower": unknown.lower, "upper": unknown.upper }),
    );
    let commands = run.command.chunks(run.system.n_joints()).map(|row| row[shared::JOINT]);
    json!({
        "joint": shared::JOINT,
        "commands": commands.collect::<Vec<_>>(),
        "position": run.position,
        "noise": shared::NOISE,
        "unknowns": unknowns.collect::<Vec<_>>(),
    })
}

/// CPU seconds of a fit on one thread.
fn fitted(problem: &PositionProblem) -> anyhow::Result<f64> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| {
        fastest(3, || {
            let fit = position::fit(problem, &Default::default(), &mut |_| SearchControl::Continue)?;
            let rmse = fit.runs[0].rmse[0];
            ensure!(rmse < 1.03 * shared::NOISE, "the noise is not reached: {rmse} rad");
            Ok(())
        })
    })
}

/// CPU seconds of this thread in the fastest of several runs.
fn fastest(runs: usize, mut run: impl FnMut() -> anyhow::Result<()>) -> anyhow::Result<f64> {
    let mut least = f64::INFINITY;
    for _ in 0..runs {
        let (began, cpu) = (Instant::now(), thread_s());
        run()?;
        let wall = began.elapsed().as_secs_f64();
        least = least.min(thread_s().zip(cpu).map_or(wall, |(now, before)| now - before));
    }
    Ok(least)
}

/// CPU time of this thread so far (s); `None` where the system does not tell, and wall time has to do.
fn thread_s() -> Option<f64> {
    let nanoseconds = fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(1e-9 * nanoseconds.split_whitespace().next()?.parse::<f64>().ok()?)
}

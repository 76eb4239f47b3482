//! Cost against size: each work at growing sizes, each size in a process of its own, as JSON on stdout.
//!
//! `cargo run --release --example size_work`, mostly by `cargo xtask bench --peers`;
//! `cargo run --release --example size_work -- read_log 3600` does one work at one size.

#[path = "../shared/mod.rs"]
mod shared;

use std::{
    fs,
    hint::black_box,
    process::{Command, Stdio},
    time::Instant,
};

use anyhow::{Context, Result, bail, ensure};
use dynid::{CheckSettings, Experiment, Model};
use dynid_dynamics::simulate::{Input, Intersample, Options};
use dynid_identify::{
    SearchControl, position,
    sensitivity::{self, Columns, Lumps},
};
use serde_json::{Value, json};

/// One work.
struct Work {
    name: &'static str,
    /// What is done.
    what: &'static str,
    /// What grows.
    size: &'static str,
    sizes: &'static [usize],
    /// Seconds of one of it.
    measure: fn(usize) -> Result<f64>,
}

const JOINTS: &[usize] = &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10];
const LENGTHS: &[usize] = &[10, 60, 300, 900, 3600];

const WORKS: [Work; 6] = [
    Work {
        name: "forward_dynamics",
        what: "one acceleration of a random chain, by a kernel made at run time",
        size: "joints",
        sizes: JOINTS,
        measure: forward_dynamics,
    },
    Work {
        name: "first_sample",
        what: "from the text of a device file to its first acceleration",
        size: "joints",
        sizes: JOINTS,
        measure: first_sample,
    },
    Work {
        name: "gradient",
        what: "simulation of 20 s of six joints at 100 Hz, with the gradient of its positions",
        size: "unknowns",
        sizes: &[8, 10, 20, 40, 60, 80, 100, 125, 150],
        measure: gradient,
    },
    Work {
        name: "read_log",
        what: "reading a log of one joint at 1 kHz",
        size: "seconds of log",
        sizes: LENGTHS,
        measure: read_log,
    },
    Work {
        name: "check",
        what: "`check` of that log, after reading",
        size: "seconds of log",
        sizes: LENGTHS,
        measure: check,
    },
    Work {
        name: "fit",
        what: "position fit of one joint, 13 unknowns, to logs of 10 s at 100 Hz on two threads",
        size: "runs",
        sizes: &[1, 2, 5, 10, 20, 50],
        measure: fit,
    },
];

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [] => {
            let all = WORKS.iter().map(at_all_sizes).collect::<Result<Vec<_>>>()?;
            println!("{}", Value::from(all));
        }
        [name, size] => {
            let work = WORKS.iter().find(|work| work.name == name);
            let work = work.with_context(|| format!("there is no work `{name}`"))?;
            let seconds = (work.measure)(size.parse()?)?;
            println!("{}", json!({ "seconds": seconds, "peak_kb": peak_kb() }));
        }
        _ => bail!("say nothing, or a work and its size"),
    }
    Ok(())
}

/// A work at each of its sizes, and the exponent of the power law through the larger half of them.
fn at_all_sizes(work: &Work) -> Result<Value> {
    let mut points = Vec::new();
    let mut logarithms = Vec::new();
    for size in work.sizes {
        eprintln!("{} of {size} {}", work.name, work.size);
        let mut child = Command::new(std::env::current_exe()?);
        let output = child.args([work.name, &size.to_string()]).stderr(Stdio::inherit()).output()?;
        ensure!(output.status.success(), "{} of {size} {} ended with {}", work.name, work.size, output.status);
        let measured: Value = serde_json::from_slice(&output.stdout)?;
        let seconds = measured["seconds"].as_f64().context("a work says its seconds")?;
        logarithms.push(((*size as f64).ln(), seconds.ln()));
        points.push(json!({ "size": size, "seconds": seconds, "peak_kb": measured["peak_kb"] }));
    }
    let larger = &logarithms[logarithms.len() / 2..];
    Ok(json!({
        "name": work.name,
        "what": work.what,
        "size": work.size,
        "points": points,
        "exponent": slope(larger),
    }))
}

/// Slope of the least-squares line through points.
fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let (x, y) = points.iter().fold((0.0, 0.0), |(x, y), point| (x + point.0 / n, y + point.1 / n));
    let products = points.iter().map(|point| ((point.0 - x) * (point.1 - y), (point.0 - x).powi(2)));
    let (both, one) = products.fold((0.0, 0.0), |sum, own| (sum.0 + own.0, sum.1 + own.1));
    both / one
}

/// The most memory that this process had; `None` where the system does not tell.
fn peak_kb() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix("kB")?.trim().parse().ok())
}

/// Seconds of the fastest of several runs.
fn fastest(runs: usize, mut run: impl FnMut() -> Result<()>) -> Result<f64> {
    let mut least = f64::INFINITY;
    for _ in 0..runs {
        let began = Instant::now();
        run()?;
        least = least.min(began.elapsed().as_secs_f64());
    }
    Ok(least)
}

/// A chain's kernel, its parameters prepared.
fn chain(n: usize) -> Result<(&'static dynid_generated::Kernel, Vec<f64>)> {
    let folder = tempfile::tempdir()?;
    fs::write(folder.path().join("chain.toml"), shared::random_chain(n))?;
    let device = dynid_model::device_named("chain.toml", folder.path())?;
    let model = Model::of_device(device);
    let system = model.system(&(0..n).collect::<Vec<_>>(), |_| 0.0)?;
    Ok((system.kernel(), system.prepared().to_vec()))
}

/// Calls that wait for each other, as in a simulation.
fn forward_dynamics(n: usize) -> Result<f64> {
    const CALLS: usize = 20_000;
    let (kernel, prepared) = chain(n)?;
    let still: Vec<f64> = (0..n).map(|joint| 0.4 - 0.15 * joint as f64).collect();
    let dq: Vec<f64> = (0..n).map(|joint| 0.7 - 0.2 * joint as f64).collect();
    let tau: Vec<f64> = (0..n).map(|joint| (joint as f64).sin()).collect();
    let (mut q, mut ddq) = (still.clone(), vec![0.0; n]);
    let seconds = fastest(10, || {
        for _ in 0..CALLS {
            kernel.functions.forward_dynamics(&prepared, black_box(&q), &dq, &tau, &mut ddq);
            for ((q, still), ddq) in q.iter_mut().zip(&still).zip(&ddq) {
                *q = still + 1e-9 * ddq;
            }
        }
        Ok(())
    })?;
    ensure!(ddq.iter().all(|ddq| ddq.is_finite()), "a chain of {n} joints has no acceleration: {ddq:?}");
    Ok(seconds / CALLS as f64)
}

/// Once only: what is made stays made.
fn first_sample(n: usize) -> Result<f64> {
    let began = Instant::now();
    let (kernel, prepared) = chain(n)?;
    let (q, mut ddq) = (vec![0.1; n], vec![0.0; n]);
    kernel.functions.forward_dynamics(&prepared, &q, &q, &q, &mut ddq);
    black_box(&ddq);
    Ok(began.elapsed().as_secs_f64())
}

fn gradient(n: usize) -> Result<f64> {
    let (system, names) = shared::many_unknowns()?;
    // The initial positions are unknown in any case.
    let n_effects = n.checked_sub(system.n_free()).context("more unknowns than initial positions")?;
    let unknown = names.get(..n_effects).with_context(|| format!("there are only {} parameters", names.len()))?;
    let columns = Columns::new(&system, |name| unknown.iter().any(|known| known == name), Lumps::Known);
    ensure!(columns.count() == n, "{} columns for {n} unknowns", columns.count());
    let (time, command) = shared::coupled_commands();
    let (time, command) = (&time[..2001], &command[..2001 * system.n_joints()]);
    let input = Input { time, command, intersample: Intersample::ZeroOrder };
    fastest(2, || {
        let observe = |_: usize, q: &[f64], by: &[f64]| {
            black_box((q, by));
        };
        Ok(sensitivity::simulate(
            &system,
            &columns,
            &input,
            &shared::START,
            &Options::per_sample(shared::SUBSTEPS),
            observe,
        )?)
    })
}

fn read_log(seconds: usize) -> Result<f64> {
    let folder = tempfile::tempdir()?;
    let experiment = shared::long_log::write(folder.path(), seconds)?;
    fastest(3, || {
        let read = Experiment::load(&experiment)?;
        ensure!(read.runs[0].log.len() == 1000 * seconds, "a log of {} samples", read.runs[0].log.len());
        Ok(())
    })
}

fn check(seconds: usize) -> Result<f64> {
    let folder = tempfile::tempdir()?;
    let experiment = Experiment::load(shared::long_log::write(folder.path(), seconds)?)?;
    let model = Model::of_device(experiment.device);
    fastest(1, || {
        black_box(dynid::check(&model, &experiment, &CheckSettings::default())?);
        Ok(())
    })
}

fn fit(n_runs: usize) -> Result<f64> {
    let problem = shared::one_joint_runs(n_runs, 10)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build()?;
    fastest(if n_runs < 10 { 3 } else { 1 }, || {
        let fit = pool.install(|| position::fit(&problem, &Default::default(), &mut |_| SearchControl::Continue))?;
        let worst = fit.runs.iter().map(|run| run.rmse[0]).fold(0.0, f64::max);
        ensure!(worst < 1.1 * shared::NOISE, "the noise is not reached: {worst} rad");
        Ok(())
    })
}

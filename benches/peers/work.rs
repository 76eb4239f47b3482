//! The work that the peers do, as JSON on stdout: the commands of the benchmark `simulate/freedom6s/all_60s` and where they
//! lead, what `forward_dynamics/freedom6s/all` gives, and the logs of the fits with the starts of their unknowns.
//!
//! `cargo run --release --example peers_work`, mostly by `cargo xtask bench --peers`.

#[path = "../shared/mod.rs"]
mod shared;

use dynid_dynamics::{simulate::Input, simulate::Intersample, simulate::Options, simulate::simulate};
use dynid_identify::position::PositionProblem;
use serde_json::{Value, json};

fn main() -> anyhow::Result<()> {
    let system = shared::all_joints()?;
    let (time, command) = shared::coupled_commands();
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let motion = simulate(&system, &input, &shared::START, &Options::default())?;
    let n = system.n_joints();
    let per_joint = |of: fn(f64) -> f64| -> Vec<f64> { (0..n).map(|joint| of(joint as f64)).collect() };
    let (q, dq, tau) =
        (per_joint(|joint| 0.4 - 0.15 * joint), per_joint(|joint| 0.7 - 0.2 * joint), per_joint(f64::sin));
    let mut ddq = vec![0.0; n];
    system.kernel().functions.forward_dynamics(system.prepared(), &q, &dq, &tau, &mut ddq);
    let work = json!({
        "simulate": {
            "commands": command,
            "start": shared::START,
            "last": motion.q[motion.q.len() - shared::START.len()..],
        },
        "forward_dynamics": { "q": q, "dq": dq, "tau": tau, "ddq": ddq },
        "fit": fit(&shared::one_joint_problem()?),
        "linear_fit": fit(&shared::linear_joint_problem()?),
    });
    println!("{work}");
    Ok(())
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

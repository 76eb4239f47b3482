//! The work that the peers do, as JSON on stdout: the commands of the benchmark `simulate/freedom6s/all_60s` and where they
//! lead, and the log of `fit/freedom6s/one_joint` with the start of its unknowns.
//!
//! `cargo run --release --example peers_work`, mostly by `cargo xtask bench --peers`.

#[path = "../shared/mod.rs"]
mod shared;

use dynid_dynamics::{simulate::Input, simulate::Intersample, simulate::Options, simulate::simulate};
use serde_json::json;

fn main() -> anyhow::Result<()> {
    let system = shared::all_joints()?;
    let (time, command) = shared::coupled_commands();
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let motion = simulate(&system, &input, &shared::START, &Options::default())?;
    let problem = shared::one_joint_problem()?;
    let run = &problem.runs[0];
    let n_joints = run.system.n_joints();
    let unknowns = problem.unknowns.iter().map(
        |unknown| json!({ "name": unknown.name, "start": unknown.value, "lower": unknown.lower, "upper": unknown.upper }),
    );
    let work = json!({
        "simulate": {
            "commands": command,
            "start": shared::START,
            "last": motion.q[motion.q.len() - shared::START.len()..],
        },
        "fit": {
            "joint": shared::JOINT,
            "commands": run.command.chunks(n_joints).map(|row| row[shared::JOINT]).collect::<Vec<_>>(),
            "position": run.position,
            "noise": shared::NOISE,
            "unknowns": unknowns.collect::<Vec<_>>(),
        },
    });
    println!("{work}");
    Ok(())
}

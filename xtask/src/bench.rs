//! `cargo xtask bench`: the criterion benchmarks of the workspace, and with `--peers` other programs at the same work.

mod page;
mod peers;

use std::fs;

use anyhow::Context;
use serde_json::Value;

use crate::shell;

/// Runs the benchmarks.
#[derive(clap::Args)]
pub struct Arguments {
    /// Only benchmarks whose id contains this, e.g. `forward_dynamics/freedom6s/all`.
    filter: Option<String>,
    /// Measure CasADi's C, Pinocchio, MuJoCo, mujoco.sysid, and numba with scipy on the same robot and the same work in the same run, then
    /// how our costs grow with size, and write docs/speed.md. Needs Python 3.11 with pip and a C and a C++ compiler; a peer that cannot run
    /// says why.
    #[arg(long, conflicts_with = "filter")]
    peers: bool,
}

/// Runs them; criterion prints the times and keeps them in `target/criterion`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if arguments.peers {
        return compare();
    }
    criterion(arguments.filter.as_deref())
}

fn criterion(filter: Option<&str>) -> anyhow::Result<()> {
    let mut command = shell::cargo(&["bench", "--package", "dynid", "--benches"]);
    if let Some(filter) = filter {
        command.args(["--", filter]);
    }
    shell::succeed(&mut command)
}

/// Work that others do too.
struct Work {
    /// Our benchmark.
    id: &'static str,
    /// What it is.
    what: &'static str,
    /// The key of its seconds, ours and the peers'.
    key: &'static str,
    /// What says whether a peer did the same.
    check: Check,
}

/// The number of a peer that says whether it did the same work.
enum Check {
    /// The largest difference of its final positions from ours (rad).
    Positions,
    /// The largest difference of its accelerations from ours, as a share of the largest.
    Accelerations,
    /// What its fit leaves of the logged position, root mean square (rad), and whether that is the noise, under these keys.
    Noise(&'static str, &'static str),
}

const WORKS: [Work; 4] = [
    Work {
        id: "forward_dynamics/freedom6s/all",
        what: "one acceleration of the Freedom 6S, all six joints free; a call needs what the one before gave",
        key: "forward_dynamics",
        check: Check::Accelerations,
    },
    Work {
        id: "simulate/freedom6s/all_60s",
        what: "60 s of it with LuGre friction and cable springs, at steps of 1/6 ms (Runge-Kutta of fourth order)",
        key: "simulate",
        check: Check::Positions,
    },
    Work {
        id: "fit/freedom6s/one_joint",
        what: "fit of simulated to logged positions: one joint, 13 unknowns, a log of 60 s at 100 Hz",
        key: "fit",
        check: Check::Noise("rmse", "noise_reached"),
    },
    Work {
        id: "fit/freedom6s/linear_joint",
        what: "the same with viscous instead of LuGre friction, 6 unknowns (ours has the initial position too; MuJoCo steps by 1 ms)",
        key: "linear_fit",
        check: Check::Noise("linear_rmse", "linear_noise_reached"),
    },
];

impl Check {
    /// What it says of a peer.
    fn verdict(&self, peer: &Value) -> String {
        /// Farther from our final positions than this (rad), or from our accelerations (as a share), a peer has computed something else.
        const AWAY: f64 = 1e-6;
        let number = |key: &str| peer[key].as_f64().unwrap_or(f64::NAN);
        let (away, what) = match self {
            Self::Positions => (number("away"), "rad from our final positions"),
            Self::Accelerations => (number("ddq_away"), "of the largest acceleration from ours"),
            Self::Noise(rmse, reached) if peer[reached] == Value::Bool(true) => {
                return format!("yes: reaches the noise, {:.2e} rad", number(rmse));
            }
            Self::Noise(rmse, _) => return format!("NO: stops at {:.2e} rad", number(rmse)),
        };
        format!("{}: {away:.0e} {what}", if away <= AWAY { "yes" } else { "NO" })
    }
}

/// One line of the table.
struct Row {
    work: &'static str,
    by: String,
    seconds: f64,
    /// Over our seconds.
    ratio: f64,
    same: String,
}

fn compare() -> anyhow::Result<()> {
    let folder = shell::root().join("target/peers");
    fs::create_dir_all(&folder)?;
    let work = folder.join("work.json");
    let text = example("peers_work")?;
    fs::write(&work, &text)?;
    let ours: Value = serde_json::from_str(&text).context("peers_work prints JSON")?;
    let measured = peers::measured(&folder, &work);
    let rows = rows(&ours["ours"], &measured)?;
    page::print(&rows, &measured);
    let sizes: Value = serde_json::from_str(&example("size_work")?).context("size_work prints JSON")?;
    page::write(&WORKS, &rows, &ours, &measured, &sizes)
}

/// What an example of the package prints.
fn example(name: &str) -> anyhow::Result<String> {
    let arguments = ["run", "--release", "--quiet", "--package", "dynid", "--example", name];
    shell::stdout_of(&mut shell::cargo(&arguments))
}

fn rows(ours: &Value, measured: &Value) -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for work in &WORKS {
        let own = ours[work.key].as_f64().with_context(|| format!("peers_work says what {} costs us", work.id))?;
        rows.push(Row { work: work.id, by: "dynid".to_owned(), seconds: own, ratio: 1.0, same: String::new() });
        for peer in measured["peers"].as_array().into_iter().flatten() {
            let Some(seconds) = peer[work.key].as_f64() else { continue };
            let by = peer["name"].as_str().unwrap_or_default().to_owned();
            rows.push(Row { work: work.id, by, seconds, ratio: seconds / own, same: work.check.verdict(peer) });
        }
    }
    Ok(rows)
}

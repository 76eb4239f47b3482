//! `cargo xtask bench`: the criterion benchmarks of the workspace, and with `--peers` other programs at the same work.

mod page;
mod peers;

use std::fs;
use std::path::PathBuf;

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
    /// The peers' key for its seconds.
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
    let ids: Vec<&str> = WORKS.iter().map(|work| work.id).collect();
    criterion(Some(&format!("^({})$", ids.join("|"))))?;
    let folder = shell::root().join("target/peers");
    fs::create_dir_all(&folder)?;
    let work = folder.join("work.json");
    fs::write(&work, example("peers_work")?)?;
    let measured = peers::measured(&folder, &work);
    let rows = rows(&measured)?;
    page::print(&rows, &measured);
    let sizes: Value = serde_json::from_str(&example("size_work")?).context("size_work prints JSON")?;
    page::write(&WORKS, &rows, &measured, &sizes)
}

/// What an example of the package prints.
fn example(name: &str) -> anyhow::Result<String> {
    let arguments = ["run", "--release", "--quiet", "--package", "dynid", "--example", name];
    shell::stdout_of(&mut shell::cargo(&arguments))
}

fn rows(measured: &Value) -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for work in &WORKS {
        let own = ours(work.id)?;
        rows.push(Row { work: work.id, by: "dynid".to_owned(), seconds: own, ratio: 1.0, same: String::new() });
        for peer in measured["peers"].as_array().into_iter().flatten() {
            let Some(seconds) = peer[work.key].as_f64() else { continue };
            let by = peer["name"].as_str().unwrap_or_default().to_owned();
            rows.push(Row { work: work.id, by, seconds, ratio: seconds / own, same: work.check.verdict(peer) });
        }
    }
    Ok(rows)
}

/// The fastest sample of a benchmark's last run, in seconds: what else the machine does makes no sample faster.
fn ours(id: &str) -> anyhow::Result<f64> {
    let file: PathBuf = ["target/criterion", &grouped(id), "new/sample.json"].iter().collect();
    let flat: PathBuf = ["target/criterion", &id.replace('/', "_"), "new/sample.json"].iter().collect();
    let root = shell::root();
    let path = [root.join(file), root.join(flat)].into_iter().find(|path| path.exists());
    let path = path.with_context(|| format!("criterion has kept nothing of {id}"))?;
    let text = fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))?;
    let sample: Value = serde_json::from_str(&text).with_context(|| format!("reading {}", path.display()))?;
    let numbers = |key: &str| sample[key].as_array().into_iter().flatten().filter_map(Value::as_f64);
    let fastest = numbers("times").zip(numbers("iters")).map(|(time, calls)| 1e-9 * time / calls).reduce(f64::min);
    fastest.with_context(|| format!("{id} has samples in {}", path.display()))
}

/// Criterion's folder of a benchmark in a group: `simulate/freedom6s` and `all_60s`.
fn grouped(id: &str) -> String {
    match id.rsplit_once('/') {
        Some((group, name)) => format!("{}/{name}", group.replace('/', "_")),
        None => id.to_owned(),
    }
}

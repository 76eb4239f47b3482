//! `cargo xtask bench`: the criterion benchmarks of the workspace, and with `--peers` other programs at the same work.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::Context;
use serde_json::Value;

use crate::shell;

/// Runs the benchmarks.
#[derive(clap::Args)]
pub struct Arguments {
    /// Only benchmarks whose id contains this, e.g. `forward_dynamics/freedom6s/all`.
    filter: Option<String>,
    /// Measure Pinocchio, C by CasADi, and numba with scipy on the same robot and the same work in the same run, and
    /// print one table. Needs Python 3.11 with pip, and for the first two a compiler; a peer that cannot run says why.
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

/// What is compared: our benchmark, the peers' key for it, and the number that says whether a peer did the same work.
const WORK: [(&str, &str, &str); 3] = [
    ("simulate/freedom6s/all_60s", "simulate", "away"),
    ("fit/freedom6s/one_joint", "fit", "rmse"),
    ("forward_dynamics/freedom6s/all", "forward_dynamics", "away"),
];

/// Farther from our final positions than this (rad), a peer has simulated something else.
const AWAY: f64 = 1e-6;

fn compare() -> anyhow::Result<()> {
    for (id, ..) in WORK {
        criterion(Some(&format!("^{id}$")))?;
    }
    let folder = shell::root().join("target/peers");
    fs::create_dir_all(&folder)?;
    let work = folder.join("work.json");
    let arguments = ["run", "--release", "--quiet", "--package", "dynid", "--example", "peers_work"];
    fs::write(&work, shell::stdout_of(&mut shell::cargo(&arguments))?)?;
    let peers = match measured(&folder, &work) {
        Ok(peers) => peers,
        Err(error) => {
            eprintln!("no peer was measured: {error:#}");
            Value::Null
        }
    };
    print(&peers)
}

/// What the peers' script prints, run in an environment of its own.
fn measured(folder: &Path, work: &Path) -> anyhow::Result<Value> {
    let scripts = shell::root().join("benches/peers");
    let environment = folder.join("venv");
    let python = environment.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
    if !python.exists() {
        shell::succeed(Command::new("python3").args(["-m", "venv"]).arg(&environment).stdin(Stdio::null()))?;
    }
    let mut install = Command::new(&python);
    install.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-r"]);
    shell::succeed(install.arg(scripts.join("requirements.txt")).stdin(Stdio::null()))?;
    let mut run = Command::new(&python);
    run.arg("-B").arg(scripts.join("run.py")).arg(work).stdin(Stdio::null());
    let text = shell::stdout_of(&mut run)?;
    serde_json::from_str(&text).context("the peers' script prints JSON")
}

/// Median of a benchmark's last run in seconds.
fn ours(id: &str) -> anyhow::Result<f64> {
    let file: PathBuf = ["target/criterion", &id.replace('/', "_"), "new/estimates.json"].iter().collect();
    let grouped: PathBuf = ["target/criterion", &grouped(id), "new/estimates.json"].iter().collect();
    let root = shell::root();
    let path = [root.join(grouped), root.join(file)].into_iter().find(|path| path.exists());
    let path = path.with_context(|| format!("criterion has kept nothing of {id}"))?;
    let text = fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))?;
    let estimates: Value = serde_json::from_str(&text).with_context(|| format!("reading {}", path.display()))?;
    let median = estimates["median"]["point_estimate"].as_f64().with_context(|| format!("{id} has a median"))?;
    Ok(1e-9 * median)
}

/// Criterion's folder of a benchmark in a group: `simulate/freedom6s` and `all_60s`.
fn grouped(id: &str) -> String {
    match id.rsplit_once('/') {
        Some((group, name)) => format!("{}/{name}", group.replace('/', "_")),
        None => id.to_owned(),
    }
}

fn print(peers: &Value) -> anyhow::Result<()> {
    println!("\n{:<34} {:<12} {:>12} {:>8}  the same work?", "work", "by", "seconds", "ratio");
    for (id, key, check) in WORK {
        let own = ours(id)?;
        println!("{id:<34} {:<12} {own:>12.3e} {:>8.2}", "dynid", 1.0);
        for (name, result) in peers.as_object().into_iter().flatten() {
            let Some(seconds) = result[key].as_f64() else { continue };
            let number = result[check].as_f64().unwrap_or(f64::NAN);
            let verdict = match check {
                "away" if number <= AWAY => format!("yes: final positions within {number:.0e} rad of ours"),
                "away" => format!("NO: final positions {number:.0e} rad from ours"),
                _ if result["noise_reached"] == Value::Bool(true) => {
                    format!("yes: reaches the noise, {number:.3e} rad")
                }
                _ => format!("NO: stops at {number:.3e} rad"),
            };
            println!("{id:<34} {name:<12} {seconds:>12.3e} {:>8.2}  {verdict}", seconds / own);
        }
    }
    for (name, result) in peers.as_object().into_iter().flatten() {
        if let Some(why) = result["missing"].as_str() {
            println!("{name} is missing: {why}");
        }
    }
    Ok(())
}

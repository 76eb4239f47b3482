//! Putting the program through a case as a user would: files in a folder, and its verbs one after another.
//!
//! An answer is right if the true effect at the true place comes first and the held-out error is at most [`EXPLAINED`] times the
//! noise floor once it is added; or if the verdict is the right one. What is physically the same elsewhere (a pair whose joints
//! are alike, a body on the same link) counts as right. [`fit_the_truth`] asks whether plant and program agree at all.

use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use serde_json::Value;

use super::{Case, Kind, Spot, noise_floor};
use crate::recipe::Files;

/// How far above the noise floor the held-out error may stay when the effect has been added.
pub const EXPLAINED: f64 = 1.5;

/// What came of a case.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// As `diagnose` says it.
    pub verdict: String,
    /// What it ranks first.
    pub first: Option<Spot>,
    /// Place of the right answer in its ranking, from 1.
    pub rank: Option<usize>,
    /// Right answers that it names together with the first.
    pub tied: bool,
    /// Held-out error of the believed model, refitted, over the noise floor.
    pub before: Option<f64>,
    /// The same once what is ranked first has been added and fitted.
    pub after: Option<f64>,
    /// Whether the formula that `diagnose` discovers holds the term it must; `None` where that is not asked.
    pub discovered: Option<bool>,
    /// Seconds that `diagnose` took.
    pub seconds: f64,
    /// Whether the answer is right.
    pub right: bool,
}

/// The program, and a folder with a case's files.
struct Bench<'a> {
    program: &'a Path,
    folder: &'a Path,
}

/// Writes a case's files into `folder`, over what is there.
///
/// # Errors
/// A machine that cannot be played, a folder that cannot be written.
pub fn write(case: &Case, folder: &Path) -> Result<(), String> {
    write_files(case.files()?, folder)
}

/// Writes files into `folder`, over what is there.
///
/// # Errors
/// A folder that cannot be written.
pub fn write_files(files: Files, folder: &Path) -> Result<(), String> {
    let told = |path: &Path, error: std::io::Error| format!("{}: {error}", path.display());
    fs::create_dir_all(folder).map_err(|error| told(folder, error))?;
    for (name, text) in files {
        let path = folder.join(name);
        fs::write(&path, text).map_err(|error| told(&path, error))?;
    }
    Ok(())
}

/// fit, diagnose, add, fit, compare.
///
/// # Errors
/// A verb that fails where it must not, or an answer that cannot be read.
pub fn run(case: &Case, folder: &Path, program: &Path) -> Result<Outcome, String> {
    let bench = Bench { program, folder };
    let fitted = bench.fit("believed", "fitted")?;
    // a model that lacks what holds a joint may have no best fit: then diagnosis begins from what is believed
    let model = if fitted { "fitted" } else { "believed" };
    let before = bench.held_out(model)?;

    let started = Instant::now();
    let diagnosis = bench.json(&["diagnose", "experiment.toml", "--model", &toml(model), "--json"])?;
    let seconds = started.elapsed().as_secs_f64();
    bench.keep("diagnosis.json", &diagnosis)?;
    let verdict = diagnosis["verdict"].as_str().ok_or("diagnose says no `verdict`")?.to_owned();
    let ranking = diagnosis["ranking"].as_array().ok_or("diagnose says no `ranking`")?;
    let spots = ranking.iter().map(spot).collect::<Result<Vec<Spot>, String>>()?;
    let rank = spots.iter().position(|spot| case.accepted.contains(spot)).map(|index| index + 1);
    let first = spots.first().cloned();
    let tied = ranking.first().and_then(|first| first["confounded_with"].as_array()).is_some_and(|others| {
        others.iter().filter_map(|other| spot(other).ok()).any(|other| case.accepted.contains(&other))
    });

    let mut after = None;
    if let (Some(first), "missing_effect") = (&first, verdict.as_str()) {
        bench.add(first, model)?;
        after = if bench.fit("better", "better-fitted")? { bench.held_out("better-fitted")? } else { None };
    }
    let discovered = if case.kind == Kind::Outside && !case.terms.is_empty() && verdict == "unexplained" {
        Some(discovers(&case.terms, &diagnosis["discovered"]))
    } else {
        None
    };
    let right = match case.kind {
        Kind::Hidden | Kind::TwoAtOnce => {
            verdict == "missing_effect" && rank == Some(1) && after.is_some_and(|after| after <= EXPLAINED)
        }
        Kind::Nothing | Kind::PayloadInOneRun => verdict == "nothing_missing",
        Kind::Outside => verdict == "unexplained",
    };
    Ok(Outcome { verdict, first, rank, tied, before, after, discovered, seconds, right })
}

/// Held-out error over the noise floor when the true model is fitted: plant and program agree about every effect.
///
/// # Errors
/// As [`run`]; a fit that ends without a model.
pub fn fit_the_truth(folder: &Path, program: &Path) -> Result<f64, String> {
    let bench = Bench { program, folder };
    if !bench.fit("true", "true-fitted")? {
        return Err("the true model has no best fit".to_owned());
    }
    bench.held_out("true-fitted")?.ok_or_else(|| "the true model has no position error".to_owned())
}

impl fmt::Display for Spot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.from {
            Some(from) => write!(f, "{} {from}->{}", self.effect, self.joint),
            None => write!(f, "{} {}", self.effect, self.joint),
        }
    }
}

pub(super) fn spot(entry: &Value) -> Result<Spot, String> {
    let index = |key: &str| entry[key].as_u64().map(|joint| joint as usize);
    let effect = entry["effect"].as_str().ok_or("an entry of the ranking names no `effect`")?;
    // an effect of the whole device has no joint; no case hides one
    Ok(Spot { effect: effect.to_owned(), joint: index("joint").unwrap_or(usize::MAX), from: index("from") })
}

fn toml(stem: &str) -> String {
    format!("{stem}.toml")
}

impl Bench<'_> {
    /// Fits; false where the fit ended without a model.
    fn fit(&self, from: &str, to: &str) -> Result<bool, String> {
        let (from, to) = (toml(from), toml(to));
        let arguments =
            ["fit", "experiment.toml", "--model", &from, "--error", "position", "--out", &to, "--force", "--json"];
        let (status, text) = self.call(&arguments)?;
        match status {
            0 => Ok(true),
            1 => Ok(false),
            _ => Err(format!("`dynid {}` failed: {text}", arguments.join(" "))),
        }
    }

    /// Held-out position error over the noise floor; `None` where the model has none.
    fn held_out(&self, model: &str) -> Result<Option<f64>, String> {
        let comparison = self.json(&["compare", "experiment.toml", "--model", &toml(model), "--json"])?;
        Ok(comparison["rmse_validate"].as_f64().map(|rmse| rmse / noise_floor()))
    }

    fn add(&self, spot: &Spot, model: &str) -> Result<(), String> {
        let (joint, model) = (spot.joint.to_string(), toml(model));
        let from = spot.from.map(|from| from.to_string());
        let mut arguments = vec!["add", &spot.effect, "--joint", &joint];
        if let Some(from) = &from {
            arguments.extend(["--from", from]);
        }
        arguments.extend(["--model", &model, "--out", "better.toml", "--force"]);
        match self.call(&arguments)? {
            (0, _) => Ok(()),
            (_, text) => Err(format!("`dynid {}` failed: {text}", arguments.join(" "))),
        }
    }

    /// What a verb prints with `--json`.
    fn json(&self, arguments: &[&str]) -> Result<Value, String> {
        let (status, text) = self.call(arguments)?;
        if status > 1 {
            return Err(format!("`dynid {}` failed: {text}", arguments.join(" ")));
        }
        serde_json::from_str(&text).map_err(|error| format!("`dynid {}` prints no JSON: {error}", arguments.join(" ")))
    }

    /// Exit status, and stdout or, of what failed, stderr.
    fn call(&self, arguments: &[&str]) -> Result<(i32, String), String> {
        let output = Command::new(self.program)
            .args(arguments)
            .current_dir(self.folder)
            .stdin(Stdio::null())
            .output()
            .map_err(|error| format!("starting {}: {error}", self.program.display()))?;
        let status = output.status.code().ok_or_else(|| format!("`dynid {}` was killed", arguments.join(" ")))?;
        let told = if status > 1 { output.stderr } else { output.stdout };
        Ok((status, String::from_utf8_lossy(&told).into_owned()))
    }

    fn keep(&self, name: &str, value: &Value) -> Result<(), String> {
        let path: PathBuf = self.folder.join(name);
        let text = serde_json::to_string_pretty(value).map_err(|error| error.to_string())?;
        fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()))
    }
}

/// Whether a formula that a diagnosis discovered, at any joint, holds one of these terms.
pub(super) fn discovers(wanted: &[String], discovered: &Value) -> bool {
    let elsewhere = discovered["elsewhere"].as_array().into_iter().flatten();
    let terms =
        std::iter::once(discovered).chain(elsewhere).filter_map(|formula| formula["terms"].as_array()).flatten();
    let found: Vec<&str> = terms.filter_map(|term| term["term"].as_str()).collect();
    wanted.iter().any(|wanted| found.iter().any(|found| is_term(found, wanted)))
}

/// Whether a discovered product such as `load3 * sin(9*q3)` is of exactly these signals, such as `tau3*sin(q3)`: whatever the
/// harmonic, and the torque that a drive delivers being its command's.
fn is_term(found: &str, wanted: &str) -> bool {
    let factor = |factor: &str| match factor.split_once('(') {
        Some((function, angle)) => format!("{function}({}", angle.rsplit('*').next().unwrap_or(angle)),
        None => factor.replace("load", "tau").replace("command", "tau"),
    };
    let mut found: Vec<String> = found.split(" * ").map(factor).collect();
    let mut wanted: Vec<&str> = wanted.split('*').collect();
    found.sort_unstable();
    wanted.sort_unstable();
    found == wanted
}

#[cfg(test)]
mod tests {
    use super::is_term;

    #[test]
    fn products_are_compared_by_their_signals() {
        assert!(is_term("load3 * sin(9*q3)", "tau3*sin(q3)") && is_term("sin(q5) * dq5", "dq5*sin(q5)"));
        assert!(is_term("dq0 * dq0", "dq0*dq0") && is_term("q1 * sign(dq0)", "q1*sign(dq0)"));
        assert!(is_term("load0 * load0 * load0", "tau0*tau0*tau0"));
        for wrong in ["load3 * cos(9*q3)", "load3", "load3 * sin(9*q3) * dq3", "|load3| * sin(q3)", "load2 * sin(q3)"] {
            assert!(!is_term(wrong, "tau3*sin(q3)"), "{wrong}");
        }
    }
}

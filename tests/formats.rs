//! The same log in every format is the same experiment, the same fit and the same guess.

use std::{fs, ops::ControlFlow, path::Path};

use assert_cmd::Command;
use dynid::{Experiment, FitSettings, Model};
use tempfile::TempDir;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const ENDINGS: [&str; 7] = ["csv", "csv.gz", "csv.zst", "parquet", "feather", "mat", "mcap"];

/// A folder with the tour's first log of this ending.
fn folder(ending: &str) -> TempDir {
    let folder = TempDir::new().unwrap();
    let files = if ending == "csv" { "src/tour" } else { "crates/tables/tests/files" };
    let name = format!("wrist-1.{ending}");
    fs::copy(Path::new(ROOT).join(files).join(&name), folder.path().join(name)).unwrap();
    folder
}

/// The first part is to be fitted to; columns of messages have names of their own.
fn experiment(ending: &str) -> (TempDir, Experiment) {
    let folder = folder(ending);
    let of_joint = |joint: usize| {
        format!(
            "q{joint} = \"/joint_states.position[joint_{joint}]\"\ntau{joint} = \"/joint_states.effort[joint_{joint}]\"\n"
        )
    };
    let columns: String = if ending == "mcap" { (0..6).map(of_joint).collect() } else { String::new() };
    let run = |role: &str, rows: &str| {
        format!("[[run]]\nfile = \"wrist-1.{ending}\"\nfree = [4, 5]\nrole = \"{role}\"\nrows = {rows}\n")
    };
    let runs = run("fit", "[0, 600]") + &run("validate", "[600, 801]");
    let path = folder.path().join("experiment.toml");
    fs::write(&path, format!("device = \"freedom6s\"\n[columns]\n{columns}{runs}")).unwrap();
    let experiment = Experiment::load(path).unwrap_or_else(|error| panic!("{ending}: {error}"));
    (folder, experiment)
}

#[test]
fn every_format_is_the_same_experiment_and_the_same_fit() {
    let (_folder, text) = experiment("csv");
    let believed = Model::load(Path::new(ROOT).join("src/tour/believed.toml")).unwrap();
    let fit = |experiment: &Experiment| {
        let fitted = dynid::fit(&believed, experiment, &FitSettings::default(), &mut |_| ControlFlow::Continue(()));
        format!("{:?}", fitted.unwrap().model.parameters())
    };
    let fitted = fit(&text);
    for ending in &ENDINGS[1..] {
        let (_folder, own) = experiment(ending);
        assert_eq!(own.digest, text.digest, "{ending}");
        let same = own.runs.iter().zip(&text.runs).all(|(own, text)| own.log == text.log);
        assert!(same && own.runs.len() == text.runs.len(), "{ending}");
    }
    // Of equal experiments one fit tells as much as all.
    let (_folder, own) = experiment("parquet");
    assert_eq!(fit(&own), fitted);
}

#[test]
fn new_takes_every_format() {
    for ending in ENDINGS {
        let folder = folder(ending);
        let log = format!("wrist-1.{ending}");
        let run = Command::cargo_bin("dynid")
            .unwrap()
            .current_dir(folder.path())
            .args(["new", &log, "--device", "freedom6s"])
            .assert();
        let said = String::from_utf8_lossy(&run.get_output().stdout).into_owned();
        run.success();
        let experiment = Experiment::load(folder.path().join("experiment.toml")).unwrap();
        assert!(experiment.runs.iter().all(|run| run.free == [4, 5]), "{ending}: {said}");
        let (_folder, text) = self::experiment("csv");
        assert_eq!(experiment.runs[0].log.q[4][..500], text.runs[0].log.q[4][..500], "{ending}: {said}");
    }
}

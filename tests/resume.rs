//! A fit that was stopped goes on where it was and ends at the same bytes as one that was not.

use dynid_dynamics::simulate::Steps;
use std::fs;
use std::path::Path;

use crate::wrist::folder;
use dynid_identify::SearchControl;
use dynid_identify::position::Options;
use dynid_identify::starts::Starts;
use dynid_identify::{checkpoint, checkpoint::Identity};
use dynid_identify::{identify::ErrorSignal, identify::FitTask, identify::State, identify::identify_as};
use dynid_logs::{experiment::Experiment, experiment::Run};
use dynid_user_model::Model;

fn experiment(folder: &Path) -> Experiment {
    Experiment::read_with(&folder.join("experiment.toml"), dynid_model::devices()).unwrap()
}

fn position() -> FitTask {
    FitTask::plain(ErrorSignal::Position, Options { steps: Some(Steps::PerSample(20)), ..Options::default() })
}

/// Fits, stops after so many iterations, writes and reads the checkpoint, goes on, and so on to the end. Returns the
/// model's file, how often it was stopped, and how many iterations the last stretch had.
fn fitted(folder: &Path, how: &FitTask, every: usize) -> (String, usize, usize) {
    let experiment = experiment(folder);
    let runs: Vec<&Run> = experiment.runs.iter().collect();
    let model = Model::load(folder.join("believed.toml")).unwrap();
    let path = folder.join("out.toml.checkpoint");
    let identity = Identity::new(&model, &experiment, &runs, how);
    let mut state = State::default();
    let mut stops = 0;
    loop {
        let mut seen = 0;
        let found = identify_as(&model, &[], &experiment, &runs, how, state, &mut |_, state| {
            seen += 1;
            checkpoint::write(&path, &identity, state.expect("a position fit has a state")).unwrap();
            if seen == every { SearchControl::Stop } else { SearchControl::Continue }
        });
        match found {
            Ok(found) => return (found.model.to_toml(), stops, seen),
            Err(error) if error.interrupted_after().is_some() => stops += 1,
            Err(other) => panic!("{other}"),
        }
        state = checkpoint::read(&path, &identity).unwrap();
    }
}

#[test]
fn however_often_it_is_stopped_the_model_is_the_same() {
    let folder = folder();
    let (whole, stops, iterations) = fitted(folder.path(), &position(), usize::MAX);
    assert_eq!(stops, 0);
    assert!(iterations > 4, "{iterations} iterations");
    for every in [1, iterations / 2, iterations - 1] {
        let (again, stops, _) = fitted(folder.path(), &position(), every);
        assert!(stops >= 1, "stopped every {every} iterations");
        assert!(again == whole, "stopped {stops} times, every {every} iterations:\n{again}\n{whole}");
    }
}

#[test]
fn so_it_is_along_a_method_and_from_several_starts() {
    let folder = folder();
    let how = FitTask {
        method: Some("isolated".to_owned()),
        starts: Starts { count: 2, seed: 1, ..Starts::default() },
        ..position()
    };
    let (whole, _, iterations) = fitted(folder.path(), &how, usize::MAX);
    let every = iterations / 6;
    let (again, stops, _) = fitted(folder.path(), &how, every.max(1));
    assert!(stops >= 4, "stopped {stops} times, in steps and starts");
    assert!(again == whole, "{again}\n{whole}");
}

#[test]
fn a_checkpoint_of_another_fit_is_refused() {
    let folder = folder();
    let experiment = experiment(folder.path());
    let runs: Vec<&Run> = experiment.runs.iter().collect();
    let mut model = Model::load(folder.path().join("believed.toml")).unwrap();
    let how = position();
    let path = folder.path().join("out.toml.checkpoint");
    let identity = Identity::new(&model, &experiment, &runs, &how);
    let message = |identity: &Identity| checkpoint::read(&path, identity).unwrap_err().to_string();
    assert!(message(&identity).contains("there is no checkpoint"), "{}", message(&identity));

    checkpoint::write(&path, &identity, &State::default()).unwrap();
    assert!(checkpoint::read(&path, &identity).is_ok());
    let finer = FitTask { options: Options { steps: Some(Steps::PerSample(30)), ..how.options }, ..how.clone() };
    let other = message(&Identity::new(&model, &experiment, &runs, &finer));
    assert!(other.contains("belongs to another fit: the request was") && other.contains("--substeps 30 "), "{other}");
    let other = message(&Identity::new(&model, &experiment, &runs[..2], &how));
    assert!(other.contains("the data was"), "{other}");
    model.set_value("link.7.m", 0.061).unwrap();
    let other = message(&Identity::new(&model, &experiment, &runs, &how));
    assert!(other.contains("the model was"), "{other}");

    // Of an older program, whose state may have been another.
    let kept = fs::read_to_string(&path).unwrap();
    let own = kept.lines().find(|line| line.starts_with("format = ")).unwrap();
    fs::write(&path, kept.replace(own, "format = 1").replace("[state", "[once")).unwrap();
    let other = message(&identity);
    assert!(other.contains("the program was") && other.contains("(format 1)"), "{other}");

    fs::write(&path, "x = [").unwrap();
    assert!(message(&identity).contains("cannot be read"), "{}", message(&identity));
    fs::write(&path, kept.replace(own, &format!("format = '{}'", "7".repeat(50_000)))).unwrap();
    assert!(message(&identity).len() < 3000, "{}", message(&identity));
}

/// Through the binary: Ctrl-C, then `kill -9`, then to the end.
#[cfg(unix)]
mod through_the_binary {
    use super::*;
    use std::process::{Child, Command, ExitStatus, Stdio};
    use std::time::{Duration, Instant};

    fn fit(folder: &Path, out: &str, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_dynid"));
        command.args(["fit", "experiment.toml", "--model", "believed.toml", "--substeps", "120", "--out", out]);
        command.args(more).current_dir(folder).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// Sends a signal once a checkpoint newer than `before` is there.
    fn stopped(mut child: Child, checkpoint: &Path, before: Option<&str>, signal: &str) -> (ExitStatus, String) {
        let deadline = Instant::now() + Duration::from_secs(60);
        while fs::read_to_string(checkpoint).ok().as_deref() == before {
            assert!(Instant::now() < deadline && child.try_wait().unwrap().is_none(), "no checkpoint was written");
            std::thread::sleep(Duration::from_millis(2));
        }
        let sent = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
        assert!(sent.success());
        let output = child.wait_with_output().unwrap();
        (output.status, String::from_utf8(output.stdout).unwrap())
    }

    #[test]
    fn ctrl_c_and_kill_lose_nothing() {
        let folder = folder();
        let whole = fit(folder.path(), "whole.toml", &[]).status().unwrap();
        assert!(whole.success());

        let checkpoint = folder.path().join("again.toml.checkpoint");
        let child = fit(folder.path(), "again.toml", &[]).spawn().unwrap();
        let (status, message) = stopped(child, &checkpoint, None, "-INT");
        assert_eq!(status.code(), Some(130), "{message}");
        assert!(message.contains("--resume goes on from again.toml.checkpoint"), "{message}");
        assert!(!folder.path().join("again.toml").exists());

        let refused = fit(folder.path(), "again.toml", &[]).output().unwrap();
        assert_eq!(refused.status.code(), Some(2), "a checkpoint that is left is not overwritten");
        assert!(String::from_utf8(refused.stderr).unwrap().contains("is left of a fit that was stopped"));

        let before = fs::read_to_string(&checkpoint).unwrap();
        let child = fit(folder.path(), "again.toml", &["--resume"]).spawn().unwrap();
        let (status, _) = stopped(child, &checkpoint, Some(&before), "-KILL");
        assert_eq!(status.code(), None, "killed");

        let end = fit(folder.path(), "again.toml", &["--resume"]).output().unwrap();
        assert!(end.status.success(), "{}", String::from_utf8_lossy(&end.stderr));
        let read = |name: &str| fs::read(folder.path().join(name)).unwrap();
        assert!(read("again.toml") == read("whole.toml"), "the same bytes");
        assert!(!checkpoint.exists(), "a fit that is done leaves no checkpoint");
    }
}

//! The same work on many experiments: in any order, by any number of workers, however often it is stopped.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::wrist;

/// What a command prints with `--json`, and its exit status.
fn dynid(folder: &Path, arguments: &[&str]) -> (Value, i32) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_dynid")).arg("--json").args(arguments).current_dir(folder).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let json = serde_json::from_slice(&output.stdout).unwrap_or(Value::String(said));
    (json, output.status.code().unwrap())
}

/// A folder with the tour's logs and a table of nights: two robots with two nights each, all of the same logs.
fn nights() -> tempfile::TempDir {
    let folder = wrist::folder();
    let mut table = "robot,night,experiment\n".to_owned();
    for (robot, night) in [("a", 2), ("a", 10), ("b", 2), ("b", 10)] {
        table += &format!("{robot},{night},experiment.toml\n");
    }
    fs::write(folder.path().join("nights.csv"), table).unwrap();
    folder
}

const FIT: [&str; 6] = ["fit", "{experiment}", "--model", "believed.toml", "--out", "{out}.toml"];

fn make(folder: &Path, fit: &[&str]) -> Value {
    let (made, status) = dynid(folder, &[&["job", "jobs", "--from", "nights.csv", "--"], fit].concat());
    assert_eq!(status, 0, "{made}");
    made
}

/// Name -> content of all files of a folder.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap().flatten();
    entries.map(|own| (own.file_name().into_string().unwrap(), fs::read(own.path()).unwrap())).collect()
}

#[test]
fn shares_of_the_jobs_come_to_the_files_of_all_of_them() {
    let folder = nights();
    let path = folder.path();
    assert_eq!(make(path, &FIT)["written"], 4);
    assert_eq!(make(path, &FIT)["written"], 0, "jobs are named by what they are");
    let (whole, status) = dynid(path, &["job", "jobs", "--out", "whole", "--at-once", "1"]);
    assert_eq!((&whole["done"], &whole["left"], status), (&json!(4), &json!(0), 0));
    for share in ["2/2", "1/2"] {
        let (done, status) = dynid(path, &["job", "jobs", "--out", "shares", "--shard", share, "--at-once", "2"]);
        assert_eq!((&done["jobs"], &done["done"], status), (&json!(2), &json!(2), 0), "{done}");
    }
    let [whole, shares] = ["whole", "shares"].map(|name| files(&path.join(name)));
    assert_eq!(whole.keys().collect::<Vec<_>>(), shares.keys().collect::<Vec<_>>());
    for (name, content) in &whole {
        // Each result names the model that was written beside it.
        let text = String::from_utf8(content.clone()).unwrap();
        assert_eq!(text.replace("whole/", "shares/").into_bytes(), shares[name], "{name}");
    }
    // Nothing is done twice.
    let before = files(&path.join("whole"));
    assert_eq!(dynid(path, &["job", "jobs", "--out", "whole"]).0["done"], 4);
    assert!(before == files(&path.join("whole")));
    // A worker that was killed between what the verb wrote and its result: it is done again, and another run beside it does not hurt.
    let lost = whole.keys().find(|name| name.ends_with(".json")).unwrap();
    fs::remove_file(path.join("whole").join(lost)).unwrap();
    let beside =
        Command::new(env!("CARGO_BIN_EXE_dynid")).args(["job", "jobs", "--out", "whole"]).current_dir(path).spawn();
    assert_eq!(dynid(path, &["job", "jobs", "--out", "whole", "--again"]).0["failed"], json!([]));
    beside.unwrap().wait().unwrap();
    assert!(before == files(&path.join("whole")));
    // A night that is told twice is refused:
    let one = whole.keys().find(|name| name.ends_with(".json")).unwrap();
    fs::copy(path.join("whole").join(one), path.join("again.json")).unwrap();
    let (error, status) = dynid(path, &["fleet", "whole", "again.json"]);
    assert!(status == 2 && error.as_str().unwrap().contains("already; leave one of them out"), "{error}");
    // The answer of few nights says that they are:
    let (fleet, status) = dynid(path, &["fleet", "whole", "--out", "fleet.html"]);
    assert_eq!((status, &fleet["robots"], &fleet["nights"]), (0, &json!(["a", "b"]), &json!(["2", "10"])));
    assert_eq!(fleet["events"], json!([]), "{fleet:#}");
    assert!(fs::read_to_string(path.join("fleet.html")).unwrap().contains("No robot has the four nights"));
}

#[cfg(unix)]
#[test]
fn work_that_was_stopped_goes_on_to_the_same_bytes() {
    let folder = nights();
    let path = folder.path();
    let slow = [&FIT[..], &["--error", "position", "--substeps", "60"]].concat();
    make(path, &slow);
    assert_eq!(dynid(path, &["job", "jobs", "--out", "whole"]).1, 0);
    let results = |out: &str| files(&path.join(out)).keys().filter(|name| name.ends_with(".json")).count();
    // By Ctrl-C, and by a kill that nobody hears: then the jobs' own processes end with their stdin.
    for (out, signal) in [("asked", "INT"), ("killed", "KILL")] {
        let mut times = 0;
        while !path.join(out).is_dir() || results(out) < 4 {
            let mut child = Command::new(env!("CARGO_BIN_EXE_dynid"))
                .args(["job", "jobs", "--out", out])
                .current_dir(path)
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            if times < 3 {
                let wait = Duration::from_millis(400 + 300 * times);
                let begun = Instant::now();
                while begun.elapsed() < wait && child.try_wait().unwrap().is_none() {
                    std::thread::sleep(Duration::from_millis(10));
                }
                let _ = Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status();
            }
            child.wait().unwrap();
            times += 1;
            assert!(times < 20, "{out}: it does not come to its end");
        }
        assert!(times > 1, "{out}: it was stopped");
        let [whole, own] = ["whole", out].map(|name| files(&path.join(name)));
        for (name, content) in whole {
            let text = String::from_utf8(content).unwrap().replace("whole/", &format!("{out}/"));
            // How often a search went on is no part of what it came to.
            assert!(own[&name] == text.into_bytes(), "{out}: {name}");
        }
        assert_eq!(
            files(&path.join(out)).len(),
            files(&path.join("whole")).len(),
            "{out}: what is left of work that is done"
        );
    }
}

/// The model that a job writes names a device file by where both lie.
#[test]
fn a_job_with_a_device_of_its_own_writes_a_model_that_can_be_used() {
    let folder = nights();
    let path = folder.path();
    let (device, status) = dynid(path, &["devices", "--file", "freedom6s"]);
    assert_eq!(status, 0, "{device}");
    fs::write(path.join("mine.toml"), device["file"].as_str().unwrap()).unwrap();
    for name in ["believed.toml", "experiment.toml"] {
        let text = fs::read_to_string(path.join(name)).unwrap();
        fs::write(path.join(name), text.replace("device = \"freedom6s\"", "device = \"mine.toml\"")).unwrap();
    }
    fs::write(path.join("nights.csv"), "robot,night,experiment\na,1,experiment.toml\n").unwrap();
    make(path, &FIT);
    let (done, status) = dynid(path, &["job", "jobs", "--out", "results"]);
    assert_eq!((&done["done"], status), (&json!(1), 0), "{done}");
    let fitted = files(&path.join("results")).into_keys().find(|name| name.ends_with(".toml")).unwrap();
    let (compared, _) = dynid(path, &["compare", "experiment.toml", "--model", &format!("results/{fitted}")]);
    assert!(compared["runs"].is_array(), "{compared}");
}

/// Also where a verb writes a folder, and was killed before its result was written.
#[test]
fn a_job_whose_output_is_a_folder_is_done_again() {
    let folder = nights();
    let path = folder.path();
    make(path, &["simulate", "{experiment}", "--model", "believed.toml", "--out-dir", "{out}"]);
    assert_eq!(dynid(path, &["job", "jobs", "--out", "whole"]).1, 0);
    let results = || fs::read_dir(path.join("whole")).unwrap().flatten().map(|own| own.path());
    let result = results().find(|own| own.extension().is_some()).unwrap();
    fs::remove_file(result).unwrap();
    let (done, status) = dynid(path, &["job", "jobs", "--out", "whole"]);
    assert_eq!((&done["done"], status), (&json!(4), 0), "{done}");
}

#[test]
fn what_cannot_be_done_is_said_in_its_place() {
    let folder = nights();
    let path = folder.path();
    make(
        path,
        &["fit", "{experiment}", "--model", "believed.toml", "--only", "joint.9.viscous.Fv", "--out", "{out}.toml"],
    );
    let (done, status) = dynid(path, &["job", "jobs", "--out", "results"]);
    let failed = done["failed"].as_array().unwrap();
    assert_eq!((failed.len(), status), (4, 1), "{done}");
    let result = fs::read_to_string(path.join(format!("results/{}.json", failed[0].as_str().unwrap()))).unwrap();
    let result: Value = serde_json::from_str(&result).unwrap();
    assert!(result["error"].as_str().unwrap().contains("joint.9.viscous.Fv") && result["status"] == 2, "{result}");

    // A log that is no longer the one that the job was made for.
    fs::remove_dir_all(path.join("jobs")).unwrap();
    make(path, &FIT);
    let log = fs::read_to_string(path.join("wrist-1.csv")).unwrap();
    fs::write(path.join("wrist-1.csv"), log.replacen("0.", "0.0", 1)).unwrap();
    let (done, status) = dynid(path, &["job", "jobs", "--out", "other"]);
    assert_eq!((done["failed"].as_array().unwrap().len(), status), (4, 1));
    let words = files(&path.join("other")).into_values().map(|own| String::from_utf8(own).unwrap()).collect::<String>();
    assert!(words.contains("wrist-1.csv is not the file that the job was made for"), "{words}");

    let job = fs::read_dir(path.join("jobs")).unwrap().flatten().next().unwrap().path();
    fs::write(&job, fs::read_to_string(&job).unwrap().replace("believed", "other")).unwrap();
    for (arguments, expected) in [
        (&["job", "jobs", "--out", "results"][..], "is not the one it is named by"),
        (&["job", "jobs", "--shard", "4/3"], "expected I/N with 1 <= I <= N"),
        (
            &["job", "jobs", "--from", "nights.csv", "--", "fit", "{nihgt}"],
            "unknown column `nihgt`; did you mean `night`",
        ),
        (&["fleet", "jobs"], "nothing in these files says what a fit found"),
    ] {
        let (said, status) = dynid(path, arguments);
        assert!(status == 2 && said.as_str().is_some_and(|said| said.contains(expected)), "{arguments:?}: {said}");
    }
}

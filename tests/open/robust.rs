//! What may happen to a page that is left open all day.

use std::fs::OpenOptions;

use super::*;

fn read(folder: &Path, name: &str) -> Vec<u8> {
    fs::read(folder.join(name)).unwrap()
}

/// A fit that takes its time, whose checkpoints are of the same size.
fn fit(out: &str) -> [&str; 8] {
    ["fit", "experiment.toml", "--model", "believed.toml", "--substeps", "120", "--out", out]
}

/// A new server finds what one that was killed has left: its fit has ended, too, and goes on.
#[cfg(target_os = "linux")]
#[test]
fn a_server_that_is_killed_loses_nothing() {
    let folder = wrist::folder();
    let path = folder.path();
    let mut server = Server::new(path, &[]);
    let id = server.run(&fit("again.toml"));
    server.wait(id, |job| job["progress"].as_array().unwrap().len() > 1);
    server.child.kill().unwrap();
    server.child.wait().unwrap();
    let here = path.canonicalize().unwrap();
    let works_here = |entry: std::io::Result<fs::DirEntry>| {
        entry.is_ok_and(|entry| fs::read_link(entry.path().join("cwd")).is_ok_and(|place| place == here))
    };
    let begun = Instant::now();
    while fs::read_dir("/proc").unwrap().any(works_here) {
        assert!(begun.elapsed() < Duration::from_secs(60), "the fit goes on alone");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(!path.join("again.toml").exists());

    let server = Server::new(path, &[]);
    let files = server.get("api/folder").ok();
    let kind = |name: &str| {
        files["files"].as_array().unwrap().iter().find(|file| file["path"] == name).map(|file| file["kind"].clone())
    };
    assert_eq!(kind("again.toml.checkpoint"), Some(json!("checkpoint")));
    let resumed = server.done(&[&fit("again.toml")[..], &["--resume"]].concat());
    assert_eq!(resumed["state"], "done", "{resumed}");
    assert_eq!(server.done(&fit("whole.toml"))["state"], "done");
    assert!(read(path, "again.toml") == read(path, "whole.toml"), "the same bytes");
    assert!(!path.join("again.toml.checkpoint").exists());
}

/// What others write while a fit runs: the experiment is the one that the fit began with, and an output that came is kept.
#[test]
fn a_file_that_is_edited_during_a_fit_is_kept() {
    let folder = wrist::folder();
    let path = folder.path();
    let server = Server::new(path, &[]);
    let whole = server.done(&fit("whole.toml"));
    assert_eq!(whole["state"], "done", "{whole}");
    let [one, other] = ["one.toml", "other.toml"].map(|out| server.run(&fit(out)));
    for id in [one, other] {
        server.wait(id, |job| job["last"]["progress"] == "iteration");
    }
    fs::write(path.join("other.toml"), "# mine\n").unwrap();
    let before = server.get(EXPERIMENT).ok();
    let text = fs::read_to_string(path.join("experiment.toml")).unwrap();
    fs::write(path.join("experiment.toml"), text.replace("\"validate\"", "\"fit\"")).unwrap();
    let over = |id: u64| server.wait(id, |job| job["state"] != "running");
    assert_eq!(over(one)["state"], "done");
    assert!(read(path, "one.toml") == read(path, "whole.toml"));
    let refused = over(other);
    assert!(refused["error"].as_str().unwrap().contains("other.toml exists already and is kept"), "{refused}");
    assert_eq!((&refused["state"], read(path, "other.toml")), (&json!("failed"), b"# mine\n".to_vec()));
    assert!(path.join("other.toml.checkpoint").exists(), "and what was found is not lost");
    assert_ne!(server.get(EXPERIMENT).ok()["digest"], before["digest"]);
}

#[test]
fn a_log_that_grows_is_read_again() {
    let folder = tour();
    let path = folder.path();
    let log = fs::read_to_string(path.join("wrist-1.csv")).unwrap();
    let lines: Vec<&str> = log.lines().collect();
    let half = lines.len() / 2;
    fs::write(path.join("wrist-1.csv"), lines[..half].join("\n") + "\n").unwrap();
    let server = Server::new(path, &[]);
    let key = || {
        let asked = json!({ "experiment": "experiment.toml", "model": "believed.toml" });
        server.post("api/compared", &asked).ok()["key"].clone()
    };
    let before = key();
    let mut file = OpenOptions::new().append(true).open(path.join("wrist-1.csv")).unwrap();
    for (number, line) in lines.iter().enumerate().skip(half).take(5) {
        let (one, other) = line.split_at(line.rfind(',').unwrap());
        write!(file, "{one}").unwrap();
        assert!(server.get(EXPERIMENT).error(422).contains("wrist-1.csv:"), "a row that is half there");
        writeln!(file, "{other}").unwrap();
        assert_eq!(server.get(EXPERIMENT).ok()["runs"][0]["samples"], json!(number));
    }
    assert_ne!(key(), before);
}

#[test]
fn twenty_pages_are_answered_at_once() {
    let folder = tour();
    let server = Server::new(folder.path(), &[]);
    let page = |number: usize| {
        let stream = server.send("GET", &server.at("api/events"), &[], b"");
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let mut lines = BufReader::new(stream).lines().map(Result::unwrap);
        lines.find(String::is_empty).unwrap();
        let compared =
            server.post("api/compared", &json!({ "experiment": "experiment.toml", "model": "believed.toml" })).ok();
        let series = json!({ "of": { "key": compared["key"], "run": 0 }, "names": ["residual:4"], "width": 100 });
        assert_eq!(server.post("api/series", &series).ok()["series"][0]["t"].as_array().unwrap().len(), 100);
        let out = format!("page-{number}.toml");
        let tried = json!({ "experiment": "experiment.toml", "model": "believed.toml", "values": {}, "out": out });
        server.post("api/tried", &tried).ok();
        server.post("api/tried", &tried).error(409);
        lines.find(|line| line.starts_with("data: ") && line.contains(&out)).unwrap();
        compared["key"].clone()
    };
    let keys: Vec<Value> = std::thread::scope(|scope| {
        let pages: Vec<_> = (0..20).map(|number| scope.spawn(move || page(number))).collect();
        pages.into_iter().map(|page| page.join().unwrap()).collect()
    });
    assert!(keys.iter().all(|key| *key == keys[0]));
}

/// A disk of its own, where the system lets one be made.
#[cfg(target_os = "linux")]
struct SmallDisk(TempDir);

#[cfg(target_os = "linux")]
impl SmallDisk {
    fn new() -> Option<Self> {
        let folder = TempDir::new().unwrap();
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=2m", "tmpfs"]).arg(folder.path()).output();
        mounted.is_ok_and(|output| output.status.success()).then(|| Self(folder))
    }
}

#[cfg(target_os = "linux")]
impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("--lazy").arg(self.0.path()).status();
    }
}

#[test]
fn what_a_killed_server_left_of_an_upload_is_removed() {
    let folder = tempfile::tempdir().unwrap();
    let left = folder.path().join(".new.csv.1-0.partial");
    fs::write(&left, "t,q0").unwrap();
    let _server = Server::new(folder.path(), &[]);
    assert!(!left.exists());
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_one_clear_message() {
    let Some(disk) = SmallDisk::new() else {
        println!("NOT TESTED: no small disk may be mounted here; run as root");
        return;
    };
    let path = disk.0.path();
    for (name, text) in dynid::tour::FILES {
        fs::write(path.join(name), text).unwrap();
    }
    let server = Server::new(path, &[]);
    let upload = |bytes: &[u8]| {
        server.raw(
            "POST",
            &server.at("api/upload?name=new.csv"),
            &[("Content-Type", "application/octet-stream")],
            bytes,
        )
    };
    let names = || {
        let mut names: Vec<_> = fs::read_dir(path).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    let clear = |before: &Vec<std::ffi::OsString>, message: &str, name: &str| {
        assert!(message.contains(&format!("cannot write {name}")) && message.contains("No space left"), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
        assert_eq!(&names(), before, "nothing is left");
    };
    clear(&names(), &upload(&b"t,q0\n0,1\n".repeat(300_000)).error(422), "new.csv");
    let mut filler = fs::File::create(path.join(".filler")).unwrap();
    while filler.write(&[0; 4096]).is_ok_and(|written| written > 0) {}
    drop(filler);
    let before = names();
    let clear = |message: &str, name: &str| clear(&before, message, name);
    clear(&upload(b"t,q0\n0,1\n").error(422), "new.csv");
    let write = json!({ "path": "mine.toml", "text": "a = 1", "replaces": null });
    clear(&server.post("api/write", &write).error(422), "mine.toml");
    let digest = server.get("api/file?path=experiment.toml").ok()["digest"].clone();
    let edit = json!({ "path": "experiment.toml", "replaces": digest, "changes": [{ "keys": ["run", 0, "role"], "value": "validate" }] });
    clear(&server.post("api/edit", &edit).error(422), "experiment.toml");
    assert_eq!(server.get("api/file?path=experiment.toml").ok()["digest"], digest);
    let tried = json!({ "experiment": "experiment.toml", "model": "believed.toml", "values": {}, "out": "try.toml" });
    clear(&server.post("api/tried", &tried).error(422), "try.toml");
    let fit = server.done(&["fit", "experiment.toml", "--model", "believed.toml", "--out", "fitted.toml"]);
    assert_eq!(fit["state"], "failed", "{fit}");
    clear(fit["error"].as_str().unwrap(), "fitted.toml");
}

//! The whole program: verbs with damaged arguments, paths, encodings and files, in a folder of its own each.
//!
//! A run fails that ends by a signal or with another status than 0, 1, 2 or 130, that speaks of a panic, that goes on for more than
//! [`HANGS_AFTER`] behind its end or the stop that it was sent, that prints JSON that is none, or writes a number that is none.

use std::{
    collections::BTreeMap,
    ffi::OsString,
    fs,
    io::Read,
    ops::Range,
    os::unix::{fs::symlink, process::ExitStatusExt},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use anyhow::Context;
use serde_json::Value;

use crate::{
    draw::Draw,
    mutate::{self, NUMBERS, csv},
    parent::HANGS_AFTER,
    readers::root,
};

/// Verbs that may well go on for longer than an input may take.
const LONG: [&str; 10] =
    ["fit", "diagnose", "plan", "excite", "wall", "ladder", "report", "compare", "simulate", "job"];

/// What a run of [`LONG`] may work before it is asked to stop, as by Ctrl-C.
const STOPPED_AFTER: Duration = Duration::from_secs(6);

/// Address space of a run, by `ulimit -v`.
const MEMORY_KIB: u64 = 4 << 20;

/// The verbs. Each word is an argument; of `open`, which serves until it is stopped, there is [`crate::server`].
const COMMANDS: &[&str] = &[
    "new wrist-1.csv wrist-2.csv --device freedom6s --out made --force",
    "new wrist-1.csv --device robot.urdf --out made --column q0=q4 --free 4,5",
    "new odd.csv --device arm.toml --out made --column t=time --free 0",
    "devices",
    "devices arm.toml",
    "devices freedom6s --file",
    "devices --check arm.toml",
    "device import robot.urdf --out imported.toml",
    "device import robot.xml --out imported.toml --end-point tool",
    "plan planar2r --method isolated",
    "plan arm.toml --base",
    "plan --model believed.toml",
    "excite freedom6s --list",
    "excite planar2r --signal cosine --free 0 --amplitude 0.2 --frequency 1 --duration 1 --rate 100 --out played.csv",
    "excite planar2r --signal chirp --free 0,1 --amplitude 0.2,0.1 --from 0.1 --to 5 --duration 2 --out played.parquet --picture p.svg",
    "excite planar2r --signal multisine --free 1 --amplitude 0.2 --from 0.5 --to 2 --duration 2 --out played.arrow",
    "simulate experiment.toml --model believed.toml --out-dir simulated",
    "simulate rich.toml --model believed.toml --out-dir simulated --format parquet --substeps 2",
    "check experiment.toml --model believed.toml",
    "check experiment.toml --free 4,5",
    "check rich.toml --model believed.toml",
    "fit experiment.toml --model believed.toml --out out.toml --iterations 3",
    "fit experiment.toml --model believed.toml --out out.toml --error torque --force",
    "fit experiment.toml --model believed.toml --out out.toml --error position --substeps 2 --iterations 2",
    "fit experiment.toml --model believed.toml --out out.toml --only joint.4.* --iterations 3 --starts 2 --seed 1",
    "fit rich.toml --model believed.toml --out out.toml --error torque --from-s 0.02 --clip",
    "fit experiment.toml --model believed.toml --out out.toml --resume",
    "compare experiment.toml --model believed.toml",
    "compare experiment.toml --model believed.toml --picture p.svg --report p.html --force",
    "compare experiment.toml --model fitted.toml --error torque",
    "compare rich.toml --model believed.toml --free 4",
    "diagnose experiment.toml --model believed.toml --error torque --depth 1 --save d.json --out out.toml",
    "add coulomb --joint 4 --model believed.toml --out out.toml --set Fc=0.02",
    "add mine --joint 4 --model believed.toml --out out.toml",
    "add input_coupling --joint 4 --from 5 --model believed.toml --out out.toml",
    "ladder experiment.toml believed.toml fitted.toml --out l.svg --report l.html",
    "report experiment.toml believed.toml fitted.toml --out r.html",
    "table believed.toml fitted.toml --out t.html",
    "table believed.toml fitted.toml",
    "table believed.toml --out t.csv",
    "export fitted.toml --as json",
    "export fitted.toml --as c --out robot.c --free 4,5",
    "export fitted.toml --as urdf --out out.urdf",
    "export fitted.toml --as mjcf --out out.xml",
    "export own.toml --as c --out robot.c --posture 0,0",
    "wall show setting",
    "wall compare --setting setting.toml --hands 1 --wall wall.toml",
    "wall run --setting setting.toml --wall wall.toml",
    "job jobs --out results --at-once 1",
    "job made --from jobs.csv -- table {robot}",
    "fleet results --out f.html --estimates e.csv",
    "fleet nights.csv --out f.html",
    "inputs freedom6s",
];

/// Files that the commands name.
struct Files {
    all: BTreeMap<String, Vec<u8>>,
    /// What is mixed into others.
    others: Vec<Vec<u8>>,
}

impl Files {
    fn new() -> anyhow::Result<Self> {
        let read = |path: &str| fs::read(root().join(path)).with_context(|| format!("no file {path}"));
        let mut all = BTreeMap::new();
        for number in 1..=3 {
            let name = format!("wrist-{number}.csv");
            let text = String::from_utf8(read(&format!("src/tour/{name}"))?)?;
            all.insert(name, text.split_inclusive('\n').take(50).collect::<String>().into_bytes());
        }
        for (name, path) in [
            ("experiment.toml", "src/tour/experiment.toml"),
            ("rich.toml", "tests/fuzz/corpus/experiment/rich.toml"),
            ("believed.toml", "src/tour/believed.toml"),
            ("fitted.toml", "tests/fuzz/corpus/model/fitted.toml"),
            ("own.toml", "tests/fuzz/corpus/model/own.toml"),
            ("odd.csv", "tests/fuzz/corpus/csv/quoted.csv"),
            ("arm.toml", "model/devices/planar2r.toml"),
            ("robot.urdf", "tests/own_robot/arm.urdf"),
            ("robot.xml", "crates/import/tests/mjcf/arm.xml"),
            ("setting.toml", "crates/haptics/src/wall/shipped/setting.toml"),
            ("wall.toml", "crates/haptics/src/wall/shipped/pd.toml"),
            ("effects/mine.toml", "model/effects/coulomb.toml"),
            ("out.toml.checkpoint", "tests/fuzz/corpus/checkpoint-fit/x.toml"),
            ("jobs/one.json", "tests/fuzz/corpus/job/one.json"),
            ("results/one.json", "tests/fuzz/corpus/job/one.json"),
        ] {
            all.insert(name.to_owned(), read(path)?);
        }
        all.insert("jobs.csv".to_owned(), b"robot,night\nbelieved.toml,1\nfitted.toml,2\n".to_vec());
        let nights: String =
            (0..20).map(|night| format!("arm,{night},{}\n", 0.1 + 0.001 * f64::from(night % 3))).collect();
        all.insert("nights.csv".to_owned(), format!("robot,night,joint.1.viscous.Fv\n{nights}").into_bytes());
        let others = all.values().cloned().collect();
        Ok(Self { all, others })
    }

    /// Writes them into an empty folder, some of them changed; and what else a path may be.
    fn put(&self, folder: &Path, draw: &mut Draw) -> anyhow::Result<()> {
        let changed: Vec<&String> = if draw.one_in(3) {
            Vec::new()
        } else {
            let names: Vec<&String> = self.all.keys().collect();
            (0..draw.size(3)).map(|_| *draw.of_these(&names)).collect()
        };
        for (name, bytes) in &self.all {
            let path = folder.join(name);
            fs::create_dir_all(path.parent().unwrap_or(folder))?;
            let bytes = match (changed.contains(&name), name.ends_with(".csv")) {
                (false, _) => bytes.clone(),
                (true, true) => csv::of(bytes, &self.others, draw),
                (true, false) => mutate::of_text(&String::from_utf8_lossy(bytes), &self.others, draw),
            };
            fs::write(path, bytes)?;
        }
        fs::create_dir_all(folder.join("folder.toml"))?;
        fs::write(folder.join("empty.toml"), "")?;
        fs::write(folder.join("with space.csv"), &self.all["wrist-1.csv"])?;
        fs::write(folder.join("new\nline.csv"), &self.all["wrist-1.csv"])?;
        fs::write(folder.join("gelenk\u{e4}\u{1f916}.toml"), &self.all["believed.toml"])?;
        symlink("believed.toml", folder.join("link.toml"))?;
        symlink("loop.toml", folder.join("loop.toml"))?;
        symlink("nowhere.toml", folder.join("dangling.toml"))?;
        // A pipe that nobody writes to, and devices: where they may not be made, paths that are not there.
        for (name, kind) in [("fifo.csv", "p"), ("null", "c 1 3"), ("zero", "c 1 5")] {
            let mut command = Command::new("mknod");
            command.arg(folder.join(name)).args(kind.split(' ')).stderr(Stdio::null());
            let _ = command.status();
        }
        Ok(())
    }
}

const PATHS: [&str; 20] = [
    "fifo.csv",
    "null",
    "zero",
    "folder.toml",
    "empty.toml",
    "with space.csv",
    "new\nline.csv",
    "gelenk\u{e4}\u{1f916}.toml",
    "link.toml",
    "loop.toml",
    "dangling.toml",
    "nowhere/x.toml",
    "wrist-1.csv",
    "believed.toml",
    "experiment.toml",
    "robot.urdf",
    ".",
    "",
    "-",
    "made",
];

const FLAGS: [&str; 14] = [
    "--json",
    "--force",
    "--free",
    "--model",
    "--effects",
    "--seed",
    "--iterations",
    "--substeps",
    "--out",
    "--error",
    "--help",
    "--progress",
    "--starts",
    "--depth",
];

/// The arguments of a run.
fn arguments(draw: &mut Draw) -> Vec<OsString> {
    let mut words: Vec<String> = draw.of_these(COMMANDS).split(' ').map(str::to_owned).collect();
    if draw.one_in(2) {
        words.push("--json".to_owned());
    }
    let n_changes = if draw.one_in(2) { 0 } else { draw.size(3) };
    for _ in 0..n_changes {
        let at = draw.below(words.len());
        match draw.below(10) {
            0..=2 => words[at] = (*draw.of_these(&PATHS)).to_owned(),
            3 | 4 => words[at] = (*draw.of_these(&NUMBERS)).to_owned(),
            5 => {
                words[at] = (*draw
                    .of_these(&["é", "Δ", "a\nb", "'", "\"", "4,5,", ",", "4,4", "joint.*", "q0", "🤖", "=", "0:1"]))
                .to_owned()
            }
            6 => drop(words.remove(at)),
            7 => words.insert(at, (*draw.of_these(&FLAGS)).to_owned()),
            8 => {
                let own = words[at].clone();
                words.push(own);
            }
            _ => {
                let new = format!("{},{}", draw.of_these(&NUMBERS), draw.of_these(&NUMBERS));
                words[at] = new;
            }
        }
        if words.is_empty() {
            break;
        }
    }
    let mut arguments: Vec<OsString> =
        words.into_iter().filter(|word| !word.contains('\0')).map(OsString::from).collect();
    if draw.one_in(100) && !arguments.is_empty() {
        use std::os::unix::ffi::OsStringExt;
        let at = draw.below(arguments.len());
        arguments[at] = OsString::from_vec(vec![0x66, 0xff, 0x80]);
    }
    arguments
}

/// How runs ended.
#[derive(Debug, Default)]
pub struct Runs {
    pub statuses: BTreeMap<i32, u64>,
    pub stopped: u64,
    pub slowest_s: f64,
    pub failures: Vec<(u64, String)>,
}

/// So many runs of a program.
pub fn runs(program: &Path, from: u64, count: u64, seed: u64, failures: &Path) -> anyhow::Result<Runs> {
    let program = program.canonicalize().with_context(|| format!("there is no program {}", program.display()))?;
    let files = Files::new()?;
    let all = Mutex::new(Runs::default());
    share_out(from..from + count, 1, |own| {
        for number in own {
            let (ended, wrong) = run(&program, &files, seed, number, failures)?;
            let mut all = all.lock().unwrap_or_else(PoisonError::into_inner);
            *all.statuses.entry(ended.status.unwrap_or(-1)).or_default() += 1;
            all.stopped += u64::from(ended.was_stopped);
            all.slowest_s = all.slowest_s.max(ended.seconds);
            if let Some(wrong) = wrong {
                eprintln!("run {number}: {wrong}");
                all.failures.push((number, wrong));
            }
        }
        Ok(())
    })?;
    Ok(all.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// Shares numbers out among as many workers as there are processors, so many at a time.
pub fn share_out(
    numbers: Range<u64>,
    at_a_time: u64,
    work: impl Fn(Range<u64>) -> anyhow::Result<()> + Sync,
) -> anyhow::Result<()> {
    let next = AtomicU64::new(numbers.start);
    let worker = || -> anyhow::Result<()> {
        loop {
            let from = next.fetch_add(at_a_time, Ordering::Relaxed);
            if from >= numbers.end {
                return Ok(());
            }
            // What one cannot do, none can.
            work(from..(from + at_a_time).min(numbers.end))
                .inspect_err(|_| next.store(numbers.end, Ordering::Relaxed))?;
        }
    };
    let n_workers = thread::available_parallelism().map_or(1, usize::from);
    thread::scope(|scope| {
        let workers: Vec<_> = (0..n_workers).map(|_| scope.spawn(worker)).collect();
        for worker in workers {
            worker.join().map_err(|_| anyhow::anyhow!("a thread of the fuzzer panicked"))??;
        }
        Ok(())
    })
}

/// The program in this folder, with one thread and no more memory than is allowed; it ends when its input does.
pub fn limited(program: &Path, folder: &Path) -> Command {
    let mut command = Command::new("sh");
    command
        .args(["-c", &format!("ulimit -v {MEMORY_KIB}; exec \"$0\" \"$@\"")])
        .arg(program)
        .arg("--stop-with-stdin")
        .current_dir(folder)
        .env("RAYON_NUM_THREADS", "1")
        .env_remove("DYNID_EFFECTS");
    command
}

/// Whether a text tells of a panic or of what ends a program as surely.
pub fn says_panic(text: &str) -> bool {
    ["panicked at", "RUST_BACKTRACE", "overflowed its stack"].iter().any(|word| text.contains(word))
}

/// How a run ended.
struct Ended {
    /// None by a signal, or where it had to be killed.
    status: Option<i32>,
    was_stopped: bool,
    hung: bool,
    seconds: f64,
    out: Vec<u8>,
    err: Vec<u8>,
}

fn run(
    program: &Path,
    files: &Files,
    seed: u64,
    number: u64,
    failures: &Path,
) -> anyhow::Result<(Ended, Option<String>)> {
    let mut draw = Draw::of(seed, "binary", number);
    let folder = tempfile::tempdir()?;
    let arguments = arguments(&mut draw);
    files.put(folder.path(), &mut draw)?;
    let before = contents(folder.path())?;
    let ended = ended(program, &arguments, folder.path())?;
    let wrong = judged(&ended, &arguments, &before, program, folder.path())?;
    let wrong = match wrong {
        Some(wrong) => {
            let kept = failures.join(format!("run-{number}"));
            if kept.exists() {
                fs::remove_dir_all(&kept)?;
            }
            fs::create_dir_all(&kept)?;
            for (path, bytes) in contents(folder.path())? {
                let to = kept.join(path.strip_prefix(folder.path())?);
                fs::create_dir_all(to.parent().unwrap_or(&kept))?;
                fs::write(to, bytes)?;
            }
            fs::write(kept.join("arguments"), format!("{arguments:?}\n{}", String::from_utf8_lossy(&ended.err)))?;
            Some(format!("{wrong}; dynid {arguments:?}; {}", kept.display()))
        }
        None => None,
    };
    Ok((ended, wrong))
}

fn ended(program: &Path, arguments: &[OsString], folder: &Path) -> anyhow::Result<Ended> {
    let mut child = limited(program, folder)
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()?;
    let (mut out, mut err) = (child.stdout.take(), child.stderr.take());
    let errors = thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(pipe) = &mut err {
            let _ = pipe.read_to_end(&mut bytes);
        }
        bytes
    });
    let outputs = thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(pipe) = &mut out {
            let _ = pipe.read_to_end(&mut bytes);
        }
        bytes
    });
    let started = Instant::now();
    // Who waits for a pipe that nobody writes to, or reads what has no end, works on nothing.
    let waits = arguments.iter().any(|own| own == "fifo.csv" || own == "zero");
    let is_long = !waits && arguments.iter().any(|own| LONG.iter().any(|verb| own == verb));
    let (mut stopped, mut hung) = (None, false);
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if is_long && stopped.is_none() && started.elapsed() > STOPPED_AFTER {
            drop(child.stdin.take());
            stopped = Some(Instant::now());
        }
        if stopped.unwrap_or(started).elapsed() > HANGS_AFTER && (stopped.is_some() || !is_long) {
            hung = true;
            child.kill()?;
        }
        thread::sleep(Duration::from_millis(3));
    };
    let joined = |thread: thread::JoinHandle<Vec<u8>>| thread.join().unwrap_or_default();
    Ok(Ended {
        // Ctrl-C ends what listens to nothing by its signal, of which a shell makes 130.
        status: status.code().or((status.signal() == Some(2)).then_some(130)),
        was_stopped: stopped.is_some(),
        hung,
        seconds: started.elapsed().as_secs_f64(),
        out: joined(outputs),
        err: joined(errors),
    })
}

/// Every file in a folder and those below it; what is none, and is not to be read, is left out.
pub fn contents(folder: &Path) -> anyhow::Result<BTreeMap<PathBuf, Vec<u8>>> {
    let mut found = BTreeMap::new();
    let mut waiting = vec![folder.to_owned()];
    while let Some(folder) = waiting.pop() {
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            match fs::symlink_metadata(&path) {
                Ok(own) if own.is_dir() => waiting.push(path),
                Ok(own) if own.is_file() => {
                    let bytes = fs::read(&path)?;
                    found.insert(path, bytes);
                }
                _ => {}
            }
        }
    }
    Ok(found)
}

/// What is wrong with a run.
fn judged(
    ended: &Ended,
    arguments: &[OsString],
    before: &BTreeMap<PathBuf, Vec<u8>>,
    program: &Path,
    folder: &Path,
) -> anyhow::Result<Option<String>> {
    let err = String::from_utf8_lossy(&ended.err);
    if ended.hung {
        return Ok(Some(format!("hangs for {} s", HANGS_AFTER.as_secs())));
    }
    if says_panic(&err) {
        return Ok(Some(format!("panics: {}", err.chars().take(300).collect::<String>())));
    }
    let Some(status @ (0..=2 | 130)) = ended.status else {
        return Ok(Some(format!("ends with {:?}: {}", ended.status, err.chars().take(300).collect::<String>())));
    };
    if err.len() > 100_000 {
        return Ok(Some(format!("says {} bytes", err.len())));
    }
    // What stands behind `--` is for others.
    let own_arguments = arguments.split(|own| own == "--").next().unwrap_or_default();
    let after = contents(folder)?;
    if status == 2 && !ended.was_stopped {
        // A fit that was told to begin anew may replace what an older one had kept, and fail later.
        let begins_anew =
            own_arguments.first().is_some_and(|verb| verb == "fit") && own_arguments.iter().any(|own| own == "--force");
        let may_be_replaced = |path: &Path| {
            begins_anew && path.extension().is_some_and(|own| own == "checkpoint") && after.contains_key(path)
        };
        let changed = before.iter().find(|(path, bytes)| after.get(*path) != Some(bytes) && !may_be_replaced(path));
        if let Some((path, _)) = changed {
            return Ok(Some(format!("was refused and changed {}", path.display())));
        }
    }
    if status > 1 {
        return Ok(None);
    }
    let wants_json = own_arguments.iter().any(|own| own == "--json")
        && !own_arguments.iter().any(|own| own == "--help" || own == "-h");
    if wants_json {
        let Ok(_) = serde_json::from_slice::<Value>(&ended.out) else {
            let text = String::from_utf8_lossy(&ended.out);
            return Ok(Some(format!("prints JSON that is none: {}", text.chars().take(200).collect::<String>())));
        };
    } else if !arguments.iter().any(|own| own == "--file") {
        // A file may be called `inf`.
        let given = arguments.iter().filter_map(|own| own.to_str()).filter(|own| !own.is_empty());
        let said = given.fold(String::from_utf8_lossy(&ended.out).into_owned(), |said, own| said.replace(own, "\""));
        if let Some(found) = no_number(&said) {
            return Ok(Some(format!("prints a number that is none: {found}")));
        }
    }
    for (path, bytes) in after.iter().filter(|(path, bytes)| before.get(*path) != Some(bytes)) {
        let ending = path.extension().unwrap_or_default().to_string_lossy();
        let text = String::from_utf8_lossy(bytes);
        let wrong = match ending.as_ref() {
            "json" => serde_json::from_str::<Value>(&text).err().map(|error| error.to_string()),
            "toml" | "svg" | "c" | "csv" | "urdf" | "xml" => no_number(&text),
            "html" => no_number(&without_scripts(&text)),
            _ => None,
        };
        if let Some(wrong) = wrong {
            return Ok(Some(format!("writes a number that is none into {}: {wrong}", path.display())));
        }
    }
    if status == 0 && arguments.first().is_some_and(|verb| verb == "fit") {
        return fitted_is_no_worse(ended, arguments, program, folder);
    }
    Ok(None)
}

/// A NaN or an infinity as a program writes it, with what stands around. Bounds may be infinite.
fn no_number(text: &str) -> Option<String> {
    let is_part = |own: char| own.is_alphanumeric() || own == '_';
    for word in ["NaN", "nan", "inf"] {
        for (at, _) in text.match_indices(word) {
            let before = text[..at].chars().next_back();
            let after = text[at + word.len()..].chars().next();
            if before.is_some_and(is_part) || after.is_some_and(is_part) {
                continue;
            }
            let line_start = text[..at].rfind('\n').map_or(0, |place| place + 1);
            let line = text[line_start..].lines().next().unwrap_or("");
            // What a user's file calls so is quoted, or a bound.
            let is_quoted = matches!(before, Some('"' | '`' | '/' | '\''))
                || line.trim_start().starts_with('#')
                || line.contains("/*")
                || line.contains("written: ");
            let is_bound =
                word == "inf" && (line.contains("lower") || line.contains("upper") || line.contains("bound"));
            if !is_quoted && !is_bound {
                return Some(line.chars().take(200).collect());
            }
        }
    }
    None
}

fn without_scripts(page: &str) -> String {
    let mut kept = String::new();
    let mut rest = page;
    while let Some(start) = rest.find("<script") {
        kept.push_str(&rest[..start]);
        let end = rest[start..].find("</script>").map_or(rest.len(), |end| start + end);
        rest = &rest[end..];
    }
    kept + rest
}

/// A fit whose model is farther from the held-out runs than the one that it began with says so.
fn fitted_is_no_worse(
    ended: &Ended,
    arguments: &[OsString],
    program: &Path,
    folder: &Path,
) -> anyhow::Result<Option<String>> {
    let after_flag = |flag: &str| {
        let at = arguments.iter().position(|own| own == flag)?;
        arguments.get(at + 1)
    };
    let (Some(model), Some(out), Some(experiment)) = (after_flag("--model"), after_flag("--out"), arguments.get(1))
    else {
        return Ok(None);
    };
    let held_out = |model: &OsString| -> anyhow::Result<Option<[f64; 2]>> {
        let arguments = ["compare".into(), experiment.clone(), "--model".into(), model.clone(), "--json".into()];
        let own = self::ended(program, &arguments, folder)?;
        let value: Value = serde_json::from_slice(&own.out).unwrap_or(Value::Null);
        Ok(value["rmse_validate"].as_f64().zip(value["torque_percent_validate"].as_f64()).map(|(a, b)| [a, b]))
    };
    let (Some(before), Some(after)) = (held_out(model)?, held_out(out)?) else { return Ok(None) };
    let said = [&ended.out[..], &ended.err].concat();
    let said = String::from_utf8_lossy(&said).contains("held-out runs are farther");
    let is_worse = after.iter().zip(before).any(|(after, before)| *after > 1.02 * before);
    if is_worse && !said {
        return Ok(Some(format!("the held-out errors grew from {before:?} to {after:?}, and the fit does not say so")));
    }
    Ok(None)
}

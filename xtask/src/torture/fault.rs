//! One fault, and what must be so after it.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::{PermissionsExt, chown};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context, bail, ensure};
use dynid_random::Random;

use super::disk::Disk;
use super::server::Server;
use super::work::{Again, Work};

/// What is done to a command.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub enum Kind {
    /// SIGKILL, at a moment drawn from the time of an undisturbed run.
    Kill,
    /// SIGKILL, while a file is being written.
    KillAtWrite,
    /// SIGINT, at such a moment.
    Interrupt,
    /// No room for one more byte, from such a moment on, or from the start.
    FullDisk,
    /// No writing, from such a moment on, or from the start.
    ReadOnly,
    /// The same command twice.
    Twice,
    /// A log of other content, from such a moment on.
    Log,
    /// The folder of the outputs goes.
    Removed,
}

impl Kind {
    pub const ALL: [Self; 8] = [
        Self::Kill,
        Self::KillAtWrite,
        Self::Interrupt,
        Self::FullDisk,
        Self::ReadOnly,
        Self::Twice,
        Self::Log,
        Self::Removed,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::Kill => "kill",
            Self::KillAtWrite => "kill-at-write",
            Self::Interrupt => "interrupt",
            Self::FullDisk => "full-disk",
            Self::ReadOnly => "read-only",
            Self::Twice => "twice",
            Self::Log => "log",
            Self::Removed => "removed",
        }
    }

    pub fn in_words(self) -> &'static str {
        match self {
            Self::Kill => "killed at a random moment",
            Self::KillAtWrite => "killed while a file is written",
            Self::Interrupt => "interrupted at a random moment",
            Self::FullDisk => "the disk is full",
            Self::ReadOnly => "nothing may be written",
            Self::Twice => "two at once on one output",
            Self::Log => "a log changes, or is cut short",
            Self::Removed => "the folder of the outputs is removed",
        }
    }

    /// A wall reads no log.
    pub fn is_for(self, work: &Work) -> bool {
        !(self == Self::Log && work.name == "wall-tune")
    }
}

type Files = BTreeMap<String, Vec<u8>>;

/// An undisturbed run.
pub struct Reference {
    seconds: f64,
    /// All files, but for those of the base.
    outputs: Files,
}

impl Reference {
    pub fn of(work: &Work, base: &Path, place: &Path, program: &Path) -> anyhow::Result<Self> {
        copy(base, place)?;
        let begun = Instant::now();
        let mut running = Running::start(work, place, program, &[], Limit::None)?;
        let end = running.end()?;
        ensure!(end.status.code() == Some(0), "{}: {}", end.status, end.said);
        let seconds = begun.elapsed().as_secs_f64();
        let outputs = new_files(base, place)?;
        ensure!(!outputs.is_empty(), "it wrote nothing");
        Ok(Self { seconds, outputs })
    }
}

/// What a fault met.
pub struct Seen {
    /// The command ran.
    pub met: bool,
    /// A checkpoint or a result was there.
    pub kept: bool,
    /// It was gone on from.
    pub resumed: bool,
}

/// How a child is kept from writing, where no disk can be mounted or another way is tried.
#[derive(Clone, Copy, PartialEq)]
enum Limit {
    None,
    /// No file longer than so many blocks (RLIMIT_FSIZE).
    FileSize(u64),
    /// As a user who is not root.
    Nobody,
}

const NOBODY: u32 = 65534;
const LONGEST: Duration = Duration::from_secs(120);

struct Running {
    child: Child,
    place: PathBuf,
    server: Option<(Server, u64)>,
}

struct End {
    status: ExitStatus,
    said: String,
}

impl Running {
    fn start(work: &Work, place: &Path, program: &Path, more: &[&str], limit: Limit) -> anyhow::Result<Self> {
        let arguments: Vec<String> = work.arguments.iter().chain(more).map(|word| (*word).to_owned()).collect();
        let mut command = match limit {
            Limit::FileSize(blocks) => {
                let mut shell = Command::new("sh");
                // Without the trap the kernel would kill it instead of saying why.
                shell.args(["-c", &format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"")]).arg(program);
                shell
            }
            Limit::Nobody | Limit::None => Command::new(program),
        };
        if limit == Limit::Nobody {
            command.uid(NOBODY).gid(NOBODY);
        }
        if work.by_server {
            command.args(["open", "--no-browser"]);
        } else {
            command.args(&arguments);
        }
        // Its words go through a pipe: a file would be one more that may not be written.
        command.current_dir(place).stdin(Stdio::null()).stderr(Stdio::piped());
        command.stdout(if work.by_server { Stdio::piped() } else { Stdio::null() });
        command.env("RAYON_NUM_THREADS", "1");
        let mut child = command.spawn()?;
        let server = if work.by_server {
            let server = Server::of(&mut child)?;
            let id = server.start(&arguments)?;
            Some((server, id))
        } else {
            None
        };
        Ok(Self { child, place: place.canonicalize()?, server })
    }

    /// Whether the command has ended.
    fn is_over(&mut self) -> bool {
        let server = self.server.as_ref().is_some_and(|(server, id)| server.state(*id).is_ok_and(|(over, _)| over));
        server || matches!(self.child.try_wait(), Ok(Some(_)))
    }

    fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        // It may have ended.
        let _ = Command::new("kill").args([&format!("-{name}"), &id]).stderr(Stdio::null()).status();
    }

    /// Waits for the end, of its children, too.
    fn end(&mut self) -> anyhow::Result<End> {
        let end = self.own_end()?;
        settled(&self.place)?;
        Ok(end)
    }

    /// Waits for the end; another may still work in its folder.
    fn own_end(&mut self) -> anyhow::Result<End> {
        let mut told = String::new();
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait()? {
                break status;
            }
            if let Some((server, id)) = &self.server
                && let Ok((true, error)) = server.state(*id)
            {
                told = error;
                self.signal("INT");
            }
            if begun.elapsed() > LONGEST {
                self.child.kill()?;
                self.child.wait()?;
                bail!("it did not end within {} s", LONGEST.as_secs());
            }
            sleep(Duration::from_millis(2));
        };
        let mut said = String::new();
        if let Some(mut stderr) = self.child.stderr.take() {
            std::io::Read::read_to_string(&mut stderr, &mut said)?;
        }
        said.push_str(&told);
        Ok(End { status, said })
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // Most have ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Waits until no process works in a folder.
fn settled(place: &Path) -> anyhow::Result<()> {
    let begun = Instant::now();
    while works_in(place) {
        ensure!(begun.elapsed() < LONGEST, "what was started goes on alone");
        sleep(Duration::from_millis(2));
    }
    Ok(())
}

/// Whether a process has this working folder.
fn works_in(place: &Path) -> bool {
    let Ok(processes) = fs::read_dir("/proc") else { return false };
    let is_here = |entry: fs::DirEntry| fs::read_link(entry.path().join("cwd")).is_ok_and(|own| own == place);
    processes.flatten().any(is_here)
}

fn copy(from: &Path, to: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}

fn files(folder: &Path) -> anyhow::Result<Files> {
    fn into(folder: &Path, root: &Path, found: &mut Files) -> anyhow::Result<()> {
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() {
                into(&path, root, found)?;
            } else {
                let name = path.strip_prefix(root)?.display().to_string();
                found.insert(name, fs::read(&path)?);
            }
        }
        Ok(())
    }
    let mut found = Files::new();
    into(folder, folder, &mut found)?;
    found.remove(".filler");
    Ok(found)
}

/// Files that the base has not; those that it has must be as they were.
fn new_files(base: &Path, place: &Path) -> anyhow::Result<Files> {
    let mut all = files(place)?;
    for (name, content) in files(base)? {
        let own = all.remove(&name).with_context(|| format!("{name} is gone"))?;
        ensure!(own == content, "{name} was changed");
    }
    Ok(all.into_iter().map(|(name, content)| (name, without_times(content))).collect())
}

/// A saved answer tells how long it took.
fn without_times(content: Vec<u8>) -> Vec<u8> {
    let Ok(text) = std::str::from_utf8(&content) else { return content };
    if !text.contains("wall_seconds") {
        return content;
    }
    let lines = text.lines().filter(|line| !line.contains("\"wall_seconds\""));
    lines.collect::<Vec<_>>().join("\n").into_bytes()
}

fn is_checkpoint(name: &str) -> bool {
    name.ends_with(".checkpoint")
}

/// What is being written, or is locked by who writes.
fn is_partial(name: &str) -> bool {
    name.ends_with(".partial") || is_lock(name)
}

/// Whether anything of what has been done stands on the disk.
fn has_kept(place: &Path, base: &Path, partials: bool) -> bool {
    let Ok(files) = files(place) else { return false };
    files.keys().any(|name| !base.join(name).exists() && is_partial(name) == partials)
}

/// Makes a fault; an error is what must not be.
pub fn one(
    kind: Kind,
    work: &Work,
    whole: &Reference,
    base: &Path,
    place: &Path,
    program: &Path,
    seed: u64,
) -> anyhow::Result<Seen> {
    let mut random = Random::new(seed);
    let moment = Duration::from_secs_f64(whole.seconds * random.unit());
    let from_start = random.unit() < 0.25;
    let other_way = random.unit() < 0.5;
    let size = random.unit();
    let needs_disk = matches!(kind, Kind::FullDisk | Kind::ReadOnly) && !(other_way && from_start);
    let disk = if needs_disk { Disk::mount(place).ok() } else { None };
    copy(base, place)?;
    let is_limited = matches!(kind, Kind::FullDisk | Kind::ReadOnly) && disk.is_none();
    let limit = match kind {
        Kind::FullDisk if is_limited => Limit::FileSize((size * 12.0) as u64),
        Kind::ReadOnly if is_limited => {
            let out = place.join("out");
            if chown(&out, Some(NOBODY), None).is_ok() {
                fs::set_permissions(&out, fs::Permissions::from_mode(0o555))?;
                Limit::Nobody
            } else {
                fs::set_permissions(&out, fs::Permissions::from_mode(0o555))?;
                Limit::None
            }
        }
        _ => Limit::None,
    };
    let but = (size * 24.0) as u64 * 4096;
    if let (Some(disk), true) = (&disk, from_start) {
        match kind {
            Kind::FullDisk => disk.fill(but)?,
            _ => drop(disk.lock()),
        }
    }

    let mut running = Running::start(work, place, program, &[], limit)?;
    let mut other = if kind == Kind::Twice { Some(Running::start(work, place, program, &[], limit)?) } else { None };
    if kind == Kind::KillAtWrite {
        let mut times = 1 + (size * 6.0) as usize;
        let mut was = false;
        while !running.is_over() {
            let is = has_kept(place, base, true);
            times -= usize::from(is && !was);
            was = is;
            if times == 0 {
                break;
            }
        }
    } else if !(matches!(kind, Kind::Twice) || is_limited || from_start && disk.is_some()) {
        let begun = Instant::now();
        while begun.elapsed() < moment && !running.is_over() {
            sleep(Duration::from_millis(1));
        }
    }
    let met = !running.is_over();
    let kept = has_kept(place, base, false);
    let log = place.join("fitted.csv");
    let mut changed = Vec::new();
    match kind {
        Kind::Kill | Kind::KillAtWrite => running.signal("KILL"),
        Kind::Interrupt => running.signal("INT"),
        Kind::FullDisk | Kind::ReadOnly => {
            if let (Some(disk), false) = (&disk, from_start) {
                match kind {
                    Kind::FullDisk => disk.fill(if other_way { 0 } else { but })?,
                    // Who writes just now keeps it writable for a moment.
                    _ => while !disk.lock() && !running.is_over() {},
                }
            }
        }
        Kind::Twice => {}
        Kind::Log => {
            let text = fs::read(&log)?;
            changed = if other_way {
                text[..(text.len() as f64 * size) as usize].to_vec()
            } else {
                // Another sample of the same form.
                let mut lines: Vec<&[u8]> = text.split_inclusive(|byte| *byte == b'\n').collect();
                let number = 20 + (size * (lines.len() - 40) as f64) as usize;
                lines[number] = lines[number - 1];
                lines.concat()
            };
            fs::write(&log, &changed)?;
        }
        Kind::Removed => {
            // Somebody may write into it between the two steps of a removal.
            while place.join("out").exists() && fs::remove_dir_all(place.join("out")).is_err() {}
        }
    }
    // Each server is ended by itself, so that neither waits for the other's.
    let end = running.own_end()?;
    let others_end = other.as_mut().map(Running::own_end).transpose()?;
    settled(&running.place)?;
    if let Some(disk) = &disk {
        disk.mend();
    }
    if limit == Limit::Nobody || kind == Kind::ReadOnly {
        fs::set_permissions(place.join("out"), fs::Permissions::from_mode(0o755))?;
        chown(place.join("out"), Some(0), None).ok();
    }

    let ends: Vec<&End> = std::iter::once(&end).chain(&others_end).collect();
    ends.iter().try_for_each(|end| is_true(kind, work, end))?;
    if kind == Kind::Twice && !ends.iter().any(|end| end.status.code() == Some(0)) {
        bail!("neither of the two came to its end: {} / {}", ends[0].said, ends[1].said);
    }
    let mut is_as_changed = false;
    if kind == Kind::Log {
        // What was kept belongs to the log as it was, and says so.
        let again = again(work, place, base)?;
        if again.contains(&"--resume") {
            let end = Running::start(work, place, program, &again, Limit::None)?.end()?;
            let told = end.said.contains("belongs to another fit") || end.said.contains("fitted.csv");
            ensure!(told && !end.said.contains("panicked"), "a checkpoint was taken for another log's: {}", end.said);
        }
        is_as_changed = fs::read(&log)? == changed;
        fs::copy(base.join("fitted.csv"), &log)?;
    }
    ensure!(kind != Kind::Log || is_as_changed, "the log was written to");
    if kind == Kind::Removed {
        fs::create_dir_all(place.join("out"))?;
    }
    let left = new_files(base, place)?;
    for (name, content) in &left {
        if is_checkpoint(name) || is_partial(name) {
            ensure!(!is_partial(name) || is_lock(name) || was_killed(kind), "{name} is left");
            continue;
        }
        let expected = whole.outputs.get(name).with_context(|| format!("{name} is no output"))?;
        // A wall that was stopped is the best so far; a log that changed before it was read is another log; a job that could not write has failed.
        let may_differ = (kind == Kind::Interrupt && work.name == "wall-tune")
            || kind == Kind::Log
            || (work.again == Again::Failed && name.ends_with(".json"));
        if may_differ {
            let text = std::str::from_utf8(content)?;
            let parses = match name.rsplit('.').next() {
                Some("toml") => toml::from_str::<toml::Table>(text).is_ok(),
                Some("json") => serde_json::from_str::<serde_json::Value>(text).is_ok(),
                _ => true,
            };
            ensure!(parses, "{name} is not whole");
        } else {
            ensure!(content == expected, "{name} is not that of an undisturbed run");
        }
    }
    let is_done = end.status.code() == Some(0) && !work.by_server;
    if is_done && !matches!(kind, Kind::Removed) {
        let missing = whole.outputs.keys().find(|name| !left.contains_key(*name));
        ensure!(missing.is_none(), "it ended with 0, and {missing:?} is missing");
    }

    let more = again(work, place, base)?;
    let resumed = more.contains(&"--resume") || (left.keys().any(|name| is_checkpoint(name)));
    let end = Running::start(work, place, program, &more, Limit::None)?.end()?;
    ensure!(end.status.code() == Some(0), "going on with {more:?} ended with {}: {}", end.status, end.said);
    let came = new_files(base, place)?;
    if let Some(name) = whole.outputs.keys().find(|name| came.get(*name) != whole.outputs.get(*name)) {
        bail!("gone on with {more:?}, {name} is not that of an undisturbed run");
    }
    if let Some(name) = came.keys().find(|name| !whole.outputs.contains_key(*name)) {
        bail!("gone on with {more:?}, {name} is still left");
    }
    Ok(Seen { met, kept, resumed })
}

/// The lock of a job that is not done.
fn is_lock(name: &str) -> bool {
    name.ends_with(".lock")
}

/// A signal that nobody hears, or that comes before it is listened for, leaves what is half written.
fn was_killed(kind: Kind) -> bool {
    matches!(kind, Kind::Kill | Kind::KillAtWrite | Kind::Interrupt)
}

/// Options with which a disturbed command goes on.
fn again(work: &Work, place: &Path, base: &Path) -> anyhow::Result<Vec<&'static str>> {
    let has_checkpoint = new_files_names(base, place)?.iter().any(|name| is_checkpoint(name));
    Ok(match work.again {
        Again::Resume if has_checkpoint => vec!["--force", "--resume"],
        Again::Resume | Again::Force => vec!["--force"],
        Again::Failed => vec!["--again"],
    })
}

fn new_files_names(base: &Path, place: &Path) -> anyhow::Result<Vec<String>> {
    Ok(files(place)?.into_keys().filter(|name| !base.join(name).exists()).collect())
}

/// Whether exit status and message are as they must be.
fn is_true(kind: Kind, work: &Work, end: &End) -> anyhow::Result<()> {
    let End { status, said } = end;
    ensure!(!said.contains("panicked"), "it panicked: {said}");
    let killed = matches!(kind, Kind::Kill | Kind::KillAtWrite);
    match (status.code(), status.signal()) {
        (Some(0), _) if said.is_empty() || !work.by_server => Ok(()),
        // A server ends well whatever became of what it ran.
        (Some(0..=2), _) => {
            let causes: &[&str] = match kind {
                Kind::FullDisk => &["No space left", "File too large", "os error 28"],
                Kind::ReadOnly => &["Read-only", "read-only", "Permission denied"],
                Kind::Twice => &["exists already", "is left of a fit", "No such file"],
                Kind::Log => &["fitted.csv", "is not the file that the job was made for"],
                Kind::Removed => &["there is no folder", "No such file", "cannot"],
                Kind::Kill | Kind::KillAtWrite | Kind::Interrupt => &["interrupt", "stopped"],
            };
            let is_named = ["out/", "fitted", ".checkpoint", "lacks", "out "].iter().any(|name| said.contains(name));
            // Which of its jobs failed, and why, stands in their results.
            let is_by_job = work.again == Again::Failed && status.code() == Some(1);
            ensure!(
                is_by_job || (causes.iter().any(|cause| said.contains(cause)) && is_named),
                "it ended with {status} and does not say why: {said:?}"
            );
            Ok(())
        }
        (Some(130), _) if kind == Kind::Interrupt => Ok(()),
        (_, Some(9)) if killed => Ok(()),
        (_, Some(2)) if kind == Kind::Interrupt => Ok(()),
        _ => bail!("it ended with {status}: {said}"),
    }
}

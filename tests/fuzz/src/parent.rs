//! Starts workers, one a core, ends those that hang, and adds up what they found.

use std::{
    collections::VecDeque,
    fs,
    path::Path,
    process::{Command, Stdio},
    sync::{Mutex, PoisonError},
    thread,
    time::{Duration, Instant},
};

use anyhow::Context;
use serde_json::Value;

use crate::{
    readers::{READERS, Reader},
    worker,
};

/// What an input may take before it is said to hang.
pub const HANGS_AFTER: Duration = Duration::from_secs(20);

/// Inputs of a worker: what readers keep as long as a process lives stays small.
const PORTION: u64 = 4000;

/// What all workers of a reader found.
#[derive(Debug, Default, Clone)]
pub struct Found {
    pub inputs: u64,
    pub seconds: f64,
    pub accepted: u64,
    pub refused: u64,
    pub slowest_s: f64,
    pub slowest: u64,
    pub most_bytes: u64,
    pub most: u64,
    /// Number of the input, and what went wrong.
    pub failures: Vec<(u64, String)>,
}

struct Portion {
    reader: &'static Reader,
    from: u64,
    to: u64,
}

/// Tries so many inputs, parted among these readers.
pub fn readers(
    only: Option<&'static Reader>,
    inputs: u64,
    seed: u64,
    failures: &Path,
) -> anyhow::Result<Vec<(&'static Reader, Found)>> {
    let chosen: Vec<&'static Reader> =
        READERS.iter().filter(|own| only.is_none_or(|only| only.name == own.name)).collect();
    let shares: u64 = chosen.iter().map(|reader| reader.share).sum();
    let mut portions = Vec::new();
    for reader in &chosen {
        let count = (inputs * reader.share).div_ceil(shares);
        for from in (0..count).step_by(PORTION as usize) {
            portions.push(Portion { reader, from, to: (from + PORTION).min(count) });
        }
    }
    // Every reader early: what fails is seen soon.
    portions.sort_by_key(|portion| portion.from);
    let waiting = Mutex::new(VecDeque::from(portions));
    let found: Vec<Mutex<Found>> = chosen.iter().map(|_| Mutex::default()).collect();
    let folder = tempfile::tempdir()?;
    let n_workers = thread::available_parallelism().map_or(1, usize::from);
    thread::scope(|scope| {
        let workers: Vec<_> = (0..n_workers)
            .map(|number| {
                let progress = folder.path().join(number.to_string());
                let (waiting, found, chosen) = (&waiting, &found, &chosen);
                scope.spawn(move || -> anyhow::Result<()> {
                    loop {
                        let next = waiting.lock().unwrap_or_else(PoisonError::into_inner).pop_front();
                        let Some(portion) = next else { return Ok(()) };
                        let own = portion_of(&portion, seed, &progress, failures)?;
                        let place = chosen.iter().position(|reader| reader.name == portion.reader.name);
                        if let Some(place) = place {
                            found[place].lock().unwrap_or_else(PoisonError::into_inner).add(own);
                        }
                    }
                })
            })
            .collect();
        for worker in workers {
            worker.join().map_err(|_| anyhow::anyhow!("a thread of the fuzzer panicked"))??;
        }
        anyhow::Ok(())
    })?;
    let found = found.into_iter().map(|own| own.into_inner().unwrap_or_else(PoisonError::into_inner));
    Ok(chosen.into_iter().zip(found).collect())
}

impl Found {
    fn add(&mut self, other: Self) {
        self.inputs += other.inputs;
        self.seconds += other.seconds;
        self.accepted += other.accepted;
        self.refused += other.refused;
        if other.slowest_s > self.slowest_s {
            (self.slowest_s, self.slowest) = (other.slowest_s, other.slowest);
        }
        if other.most_bytes > self.most_bytes {
            (self.most_bytes, self.most) = (other.most_bytes, other.most);
        }
        self.failures.extend(other.failures);
    }
}

/// Goes on behind an input that ended its worker.
fn portion_of(portion: &Portion, seed: u64, progress: &Path, failures: &Path) -> anyhow::Result<Found> {
    let mut all = Found::default();
    let mut from = portion.from;
    while from < portion.to {
        let Portion { reader, to, .. } = *portion;
        match tried(reader, seed, from, to, progress, failures)? {
            Ok(found) => {
                all.add(found);
                break;
            }
            Err((number, what)) => {
                let corpus: Vec<Vec<u8>> = reader.corpus()?.into_iter().map(|(_, bytes)| bytes).collect();
                let file = worker::saved(reader, failures, number, &reader.input(&corpus, seed, number))?;
                let what = format!("{what}: {file}");
                eprintln!("{} {number}: {what}", reader.name);
                // What the lost worker had accepted before is tried anew, so that counts are right.
                if number > from
                    && let Ok(found) = tried(reader, seed, from, number, progress, failures)?
                {
                    all.add(found);
                }
                all.add(Found { inputs: 1, failures: vec![(number, what)], ..Found::default() });
                from = number + 1;
            }
        }
    }
    Ok(all)
}

/// What a worker found, or at which input it ended and how.
fn tried(
    reader: &Reader,
    seed: u64,
    from: u64,
    to: u64,
    progress: &Path,
    failures: &Path,
) -> anyhow::Result<Result<Found, (u64, String)>> {
    fs::write(progress, from.to_le_bytes())?;
    let mut child = Command::new(std::env::current_exe()?)
        .args(["--seed", &seed.to_string(), "--reader", reader.name, "--failures"])
        .arg(failures)
        .args(["--worker", &format!("{from}..{to}"), "--progress"])
        .arg(progress)
        // One input at a time, and a worker a core.
        .env("RAYON_NUM_THREADS", "1")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .context("cannot start a worker")?;
    let at = || -> anyhow::Result<u64> {
        let bytes = fs::read(progress)?;
        Ok(bytes.first_chunk().map_or(from, |own| u64::from_le_bytes(*own)))
    };
    let mut since = (at()?, Instant::now());
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        let now = at()?;
        if now != since.0 {
            since = (now, Instant::now());
        } else if since.1.elapsed() > HANGS_AFTER {
            child.kill()?;
            child.wait()?;
            return Ok(Err((now, format!("takes more than {} s", HANGS_AFTER.as_secs()))));
        }
        thread::sleep(Duration::from_millis(20));
    };
    let output = child.wait_with_output()?;
    if status.success() {
        let value: Value = serde_json::from_slice(&output.stdout).context("a worker printed no JSON")?;
        let whole = |key: &str| value[key].as_u64().unwrap_or(0);
        let number = |key: &str| value[key].as_f64().unwrap_or(0.0);
        let failed = value["failed"].as_array().into_iter().flatten();
        let failures = failed
            .map(|own| {
                (own["input"].as_u64().unwrap_or(0), format!("{} {}", own["what"].as_str().unwrap_or(""), own["file"]))
            })
            .inspect(|(number, what)| eprintln!("{} {number}: {what}", reader.name))
            .collect();
        return Ok(Ok(Found {
            inputs: whole("inputs"),
            seconds: number("seconds"),
            accepted: whole("accepted"),
            refused: whole("refused"),
            slowest_s: number("slowest_s"),
            slowest: whole("slowest"),
            most_bytes: whole("most_bytes"),
            most: whole("most"),
            failures,
        }));
    }
    let said = String::from_utf8_lossy(&output.stderr);
    let line = said.lines().find(|line| !line.trim().is_empty()).unwrap_or("").chars().take(200).collect::<String>();
    let number = at()?;
    anyhow::ensure!(!line.starts_with("error: "), "a worker of {} failed: {line}", reader.name);
    Ok(Err((number, format!("ended its worker ({status}): {line}"))))
}

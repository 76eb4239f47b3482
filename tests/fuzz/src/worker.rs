//! A process that tries inputs one after another, and tells its parent which, should it not survive one.

use std::{
    cell::RefCell,
    fs::{self, File},
    os::unix::fs::FileExt,
    panic::{AssertUnwindSafe, catch_unwind, set_hook},
    path::Path,
    time::Instant,
};

use serde_json::{Value, json};

use crate::{
    memory,
    readers::{Place, Reader},
};

/// Bytes that reading one input may take beside what the process had before: a worker that would take more ends.
pub const MEMORY: usize = 512 << 20;

thread_local! {
    static PANIC: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Tries the inputs `from..to`; what it found is printed as JSON.
pub fn work(reader: &Reader, seed: u64, from: u64, to: u64, progress: &Path, failures: &Path) -> anyhow::Result<()> {
    set_hook(Box::new(|info| {
        let place = info.location().map_or(String::new(), ToString::to_string);
        let payload = info.payload();
        let text = payload.downcast_ref().map(|text: &&str| (*text).to_owned());
        let told = text.or_else(|| payload.downcast_ref().cloned()).unwrap_or_else(|| "a panic".to_owned());
        PANIC.with(|panic| *panic.borrow_mut() = Some(format!("{told} ({place})")));
    }));
    let folder = tempfile::tempdir()?;
    let place = Place::new(folder.path())?;
    let corpus: Vec<Vec<u8>> = reader.corpus()?.into_iter().map(|(_, bytes)| bytes).collect();
    let progress = File::options().write(true).create(true).truncate(false).open(progress)?;
    let began = Instant::now();
    let (mut accepted, mut refused, mut failed) = (0_u64, 0_u64, Vec::new());
    let (mut slowest, mut most) = ((0.0, from), (0, from));
    for number in from..to {
        let input = reader.input(&corpus, seed, number);
        progress.write_all_at(&number.to_le_bytes(), 0)?;
        let held = memory::begin();
        memory::limit(held + MEMORY);
        let started = Instant::now();
        let tried = catch_unwind(AssertUnwindSafe(|| (reader.read)(&place, &input)));
        let seconds = started.elapsed().as_secs_f64();
        memory::limit(usize::MAX);
        let taken = memory::most().saturating_sub(held);
        if seconds > slowest.0 {
            slowest = (seconds, number);
        }
        if taken > most.0 {
            most = (taken, number);
        }
        let wrong = match tried {
            Ok(Ok(true)) => {
                accepted += 1;
                continue;
            }
            Ok(Ok(false)) => {
                refused += 1;
                continue;
            }
            Ok(Err(wrong)) => wrong,
            Err(_) => PANIC.with(|panic| panic.take()).unwrap_or_else(|| "a panic".to_owned()),
        };
        let name = saved(reader, failures, number, &input)?;
        failed.push(json!({ "input": number, "what": wrong, "file": name }));
    }
    let told: Value = json!({
        "inputs": to - from,
        "seconds": began.elapsed().as_secs_f64(),
        "accepted": accepted,
        "refused": refused,
        "failed": failed,
        "slowest_s": slowest.0,
        "slowest": slowest.1,
        "most_bytes": most.0,
        "most": most.1,
    });
    println!("{told}");
    Ok(())
}

/// Keeps an input that failed.
pub fn saved(reader: &Reader, failures: &Path, number: u64, input: &[u8]) -> anyhow::Result<String> {
    let folder = failures.join(reader.name);
    fs::create_dir_all(&folder)?;
    let path = folder.join(format!("{number}.{}", reader.ending));
    fs::write(&path, input)?;
    Ok(path.display().to_string())
}

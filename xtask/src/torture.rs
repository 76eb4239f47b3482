//! `cargo xtask torture`: disturbs the program on purpose and looks at what it leaves.
//!
//! Every fault happens in a fresh folder. Then all outputs must be those of an undisturbed run, or absent, the exit status and the message must be
//! true, and the same command, gone on with, must end at the bytes of the undisturbed run with no other file left.

mod disk;
mod fault;
mod server;
mod work;

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, bail};

use crate::shell;
use fault::{Kind, Reference, Seen};

/// Disturbs the program.
#[derive(clap::Args)]
pub struct Arguments {
    /// So many faults, over all kinds and commands in turn.
    #[arg(long, default_value_t = 560)]
    faults: usize,
    /// What their moments are drawn from.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only faults of this kind.
    #[arg(long, value_enum)]
    kind: Option<Kind>,
    /// Only faults of this command, e.g. `fit-method`.
    #[arg(long)]
    command: Option<String>,
    /// This program instead of the release build, which is brought up to date first.
    #[arg(long)]
    program: Option<PathBuf>,
}

#[derive(Default, Clone)]
struct Row {
    faults: usize,
    /// Of those in which the fault met the command while it ran: before and after something was kept.
    before: usize,
    after: usize,
    /// Gone on with from what was kept.
    resumed: usize,
    failures: usize,
}

/// A few faults, for every change: what must be so after them holds whenever they come.
pub fn short() -> anyhow::Result<()> {
    run(&Arguments { faults: 16, seed: 1, kind: None, command: None, program: Some(shell::built_for_tests("dynid")?) })
}

/// Faults over all kinds and commands.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let program = match &arguments.program {
        Some(program) => program.canonicalize().with_context(|| program.display().to_string())?,
        None => {
            shell::succeed(&mut shell::cargo(&["build", "--release", "--locked"]))?;
            shell::root().join("target/release/dynid")
        }
    };
    let cases: Vec<(Kind, &work::Work)> = (work::ALL.iter())
        .filter(|work| arguments.command.as_ref().is_none_or(|name| name == work.name))
        .flat_map(|work| Kind::ALL.map(|kind| (kind, work)))
        .filter(|(kind, work)| kind.is_for(work) && arguments.kind.is_none_or(|own| own == *kind))
        .collect();
    if cases.is_empty() {
        return Err(crate::BadInput("no such fault of no such command".to_owned()).into());
    }
    let folder = shell::root().join(format!("target/torture/{}-{}", arguments.seed, std::process::id()));
    let base = folder.join("base");
    work::base(&base, &program)?;
    let mut references = BTreeMap::new();
    for (_, work) in &cases {
        if !references.contains_key(work.name) {
            let reference = Reference::of(work, &base, &folder.join(format!("whole-{}", work.name)), &program);
            references.insert(work.name, reference.with_context(|| format!("{} undisturbed", work.name))?);
        }
    }
    let rows: Mutex<BTreeMap<Kind, Row>> = Mutex::default();
    let next = AtomicUsize::new(0);
    let worker = || {
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= arguments.faults {
                break;
            }
            let (kind, work) = cases[number % cases.len()];
            let place = folder.join(format!("{number:04}-{}-{}", kind.name(), work.name));
            let found = fault::one(kind, work, &references[work.name], &base, &place, &program, {
                arguments.seed.wrapping_mul(1_000_003).wrapping_add(number as u64)
            });
            let Ok(mut rows) = rows.lock() else { break };
            let row = rows.entry(kind).or_default();
            row.faults += 1;
            match found {
                Ok(Seen { met, kept, resumed }) => {
                    row.before += usize::from(met && !kept);
                    row.after += usize::from(met && kept);
                    row.resumed += usize::from(resumed);
                    // It is in the way of nothing.
                    let _ = fs::remove_dir_all(&place);
                }
                Err(error) => {
                    row.failures += 1;
                    println!(
                        "FAILED: --seed {} fault {number}, {} of {}: {error:#}; kept: {}",
                        arguments.seed,
                        kind.name(),
                        work.name,
                        place.display()
                    );
                }
            }
        }
    };
    let at_once = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| (0..at_once).for_each(|_| drop(scope.spawn(worker))));

    let rows = rows.into_inner().map_err(|_| anyhow::anyhow!("a worker panicked"))?;
    println!("| fault | faults | before anything was kept | after | gone on from what was kept | failures |");
    println!("| --- | --- | --- | --- | --- | --- |");
    let mut all = Row::default();
    for (kind, row) in &rows {
        print_row(kind.in_words(), row);
        all.faults += row.faults;
        all.before += row.before;
        all.after += row.after;
        all.resumed += row.resumed;
        all.failures += row.failures;
    }
    print_row("all", &all);
    if all.faults < arguments.faults {
        bail!("only {} of {} faults were made", all.faults, arguments.faults);
    }
    if all.failures > 0 {
        bail!("{} of {} faults left damage, or were told wrongly", all.failures, all.faults);
    }
    fs::remove_dir_all(&folder)?;
    Ok(())
}

fn print_row(name: &str, row: &Row) {
    let Row { faults, before, after, resumed, failures } = row;
    println!("| {name} | {faults} | {before} | {after} | {resumed} | {failures} |");
}

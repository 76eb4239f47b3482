//! `cargo run --release -p dynid-fuzz -- --inputs 10000000 --seed 1` damages files that are right in many ways and gives them to every
//! reader of the program, by the calls that the program makes; `--binary target/release/dynid --runs 20000` does the same to the whole
//! program, and `--server target/release/dynid --requests 10000` to the server of its page. An input fails that ends the process or
//! panics, takes more than 20 s, takes more memory than [`worker::MEMORY`], is refused with an error that says nothing, or is accepted
//! with a number that is none.
//!
//! The input of a number is the same wherever it is made: each is drawn from the seed, the reader's name and its number (`readers`,
//! `mutate`, `draw`). Workers (`worker`) are processes, so that one that is lost is an input that is found; their parent (`parent`) makes
//! that input again and keeps it. What was mended lies in `corpus/<reader>`, and is tried before anything else.

mod binary;
mod draw;
mod memory;
mod mutate;
mod parent;
mod readers;
mod server;
mod worker;

use std::{collections::BTreeMap, fmt::Display, path::PathBuf, process::ExitCode};

use anyhow::Context;
use clap::Parser;

use parent::Found;
use readers::Reader;

#[global_allocator]
static COUNTING: memory::Counting = memory::Counting;

/// Gives damaged input to every reader of the program, to the program or to its server.
#[derive(Parser)]
#[command(name = "dynid-fuzz", max_term_width = 100)]
struct Arguments {
    /// Inputs, of all readers together.
    #[arg(long, default_value_t = 100_000)]
    inputs: u64,
    /// What all inputs are drawn from.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One reader alone.
    #[arg(long)]
    reader: Option<String>,
    /// Runs this program on damaged arguments and files, instead of the readers.
    #[arg(long, value_name = "PATH")]
    binary: Option<PathBuf>,
    /// Runs of the program.
    #[arg(long, default_value_t = 1000)]
    runs: u64,
    /// Gives damaged requests to the server of this program's page, instead.
    #[arg(long, value_name = "PATH", conflicts_with = "binary")]
    server: Option<PathBuf>,
    /// Requests of the server.
    #[arg(long, default_value_t = 10_000)]
    requests: u64,
    /// The first run's or request's number.
    #[arg(long, default_value_t = 0)]
    from: u64,
    /// Where inputs that failed are kept.
    #[arg(long, default_value = "target/fuzz")]
    failures: PathBuf,
    /// Writes the input of this number of the reader to stdout, to look at.
    #[arg(long)]
    show: Option<u64>,
    /// What a worker is to do: `from..to`.
    #[arg(long, hide = true, requires = "progress")]
    worker: Option<String>,
    #[arg(long, hide = true)]
    progress: Option<PathBuf>,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

/// Whether nothing failed.
fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    let only = match &arguments.reader {
        Some(name) => Some(Reader::named(name).with_context(|| {
            let known: Vec<&str> = readers::READERS.iter().map(|reader| reader.name).collect();
            format!("there is no reader `{name}`; there are {}", known.join(", "))
        })?),
        None => None,
    };
    if let (Some(reader), Some(number)) = (only, arguments.show) {
        use std::io::Write;
        let corpus: Vec<Vec<u8>> = reader.corpus()?.into_iter().map(|(_, bytes)| bytes).collect();
        std::io::stdout().write_all(&reader.input(&corpus, arguments.seed, number))?;
        return Ok(true);
    }
    if let (Some(range), Some(progress), Some(reader)) = (&arguments.worker, &arguments.progress, only) {
        let (from, to) = range.split_once("..").context("a range is `from..to`")?;
        worker::work(reader, arguments.seed, from.parse()?, to.parse()?, progress, &arguments.failures)?;
        return Ok(true);
    }
    if let Some(program) = &arguments.binary {
        let found = binary::runs(program, arguments.from, arguments.runs, arguments.seed, &arguments.failures)?;
        println!(
            "{} runs: {}; {} were stopped, the slowest took {:.1} s, {} failed",
            found.statuses.values().sum::<u64>(),
            counted(&found.statuses),
            found.stopped,
            found.slowest_s,
            found.failures.len()
        );
        return Ok(found.failures.is_empty());
    }
    if let Some(program) = &arguments.server {
        let numbers = arguments.from..arguments.from + arguments.requests;
        let found = server::requests(program, numbers, arguments.seed, &arguments.failures)?;
        println!(
            "{} requests: {}; the slowest took {:.1} s, {} failed",
            found.statuses.values().sum::<u64>(),
            counted(&found.statuses),
            found.slowest_s,
            found.failures.len()
        );
        return Ok(found.failures.is_empty());
    }
    let found = parent::readers(only, arguments.inputs, arguments.seed, &arguments.failures)?;
    Ok(told(&found))
}

/// `12 with 0, 3 with 1`
fn counted(statuses: &BTreeMap<impl Display, u64>) -> String {
    statuses.iter().map(|(status, count)| format!("{count} with {status}")).collect::<Vec<_>>().join(", ")
}

/// Prints the table; whether nothing failed.
fn told(found: &[(&Reader, Found)]) -> bool {
    println!(
        "| reader | inputs | a second | accepted | refused | slowest (s) | most memory (MiB) | failed |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- |"
    );
    let mut all = Found::default();
    for (reader, own) in found {
        row(reader.name, own);
        all.inputs += own.inputs;
        all.seconds += own.seconds;
        all.accepted += own.accepted;
        all.refused += own.refused;
        all.slowest_s = all.slowest_s.max(own.slowest_s);
        all.most_bytes = all.most_bytes.max(own.most_bytes);
        all.failures.extend(own.failures.iter().cloned());
    }
    row("all", &all);
    all.failures.is_empty()
}

fn row(name: &str, own: &Found) {
    let a_second = own.inputs as f64 / own.seconds.max(1e-9);
    println!(
        "| {name} | {} | {a_second:.0} | {} | {} | {:.2} | {:.1} | {} |",
        own.inputs,
        own.accepted,
        own.refused,
        own.slowest_s,
        own.most_bytes as f64 / f64::from(1 << 20),
        own.failures.len()
    );
}

//! Draws: one call of `diagnose` on every case, scored; a run that is stopped goes on from the cases that are done.
//!
//! A case has a folder of its own, `target/hidden-effects/draw-7/042`, with its files, `diagnosis.json` and `outcome.json`.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow, bail};
use dynid_plant::hidden::draw::{self, Card, DrawnCase, Drive};
use dynid_plant::hidden::score::{Outcome, Score};
use dynid_plant::hidden::{noise_floor, trial};

use super::{AGREED, Arguments, each, scores};
use crate::{BadInput, shell};

/// The draw of the cases of [`ci`].
const CI_DRAW: u32 = 0;
/// Their numbers: one or two joints, short logs, every kind but a body in one run, which takes a minute.
const CI: [usize; 12] = [18, 19, 22, 84, 103, 121, 152, 191, 196, 212, 236, 242];
/// So many of them must be right.
const CI_RIGHT: usize = 8;

/// A card and the draw that it is of.
type Drawn = (u32, Card);

/// Runs, writes or fits the cases of the draws asked for.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let mut cards = Vec::new();
    for &draw in &arguments.draw {
        cards.extend(chosen(arguments, draw)?);
    }
    if let Some(folder) = &arguments.write {
        each(&cards, arguments.jobs, &|(draw, card)| {
            let case = made(*draw, card)?;
            let folder = folder.join(&case.name);
            write(&case, &folder)?;
            println!("{}", folder.display());
            Ok(())
        })?;
        return Ok(());
    }
    let bench = Bench::new(arguments)?;
    if arguments.truth {
        return fit_the_truths(&cards, arguments.jobs, &bench);
    }
    let outcomes = bench.outcomes(&cards, arguments.jobs)?;
    let page = scores::page(&outcomes, arguments.jobs);
    println!("\n{page}");
    if arguments.write_docs {
        let path = shell::root().join("docs/hidden-effects.md");
        fs::write(&path, page).with_context(|| path.display().to_string())?;
        println!("written: {}", path.display());
    }
    Ok(())
}

/// Runs the twelve.
pub fn ci(arguments: &Arguments) -> anyhow::Result<()> {
    let deck = draw::deck(CI_DRAW);
    let is_meant = |card: &Card| CI.contains(&card.number);
    let cards: Vec<Drawn> = deck.into_iter().filter(is_meant).map(|card| (CI_DRAW, card)).collect();
    let outcomes = Bench::new(arguments)?.outcomes(&cards, arguments.jobs)?;
    let n_right = outcomes.iter().filter(|outcome| outcome.score.right).count();
    println!("\n{n_right} of {} right; at least {CI_RIGHT} must be", outcomes.len());
    if n_right < CI_RIGHT { Err(anyhow!("the program finds less than it did")) } else { Ok(()) }
}

fn chosen(arguments: &Arguments, draw: u32) -> anyhow::Result<Vec<Drawn>> {
    let mut cards = draw::deck(draw);
    cards.truncate(arguments.cases);
    let is_meant = |card: &Card, word: &str| match word.parse::<usize>() {
        Ok(number) => card.number == number,
        Err(_) => card.effects.iter().any(|id| id.contains(word)),
    };
    if let Some(word) = arguments.words.iter().find(|word| !cards.iter().any(|card| is_meant(card, word))) {
        let message = format!("draw {draw} has no case `{word}`: give a number of 1..={} or an effect", cards.len());
        return Err(BadInput(message).into());
    }
    cards.retain(|card| {
        arguments.only.is_none_or(|only| only.kind() == card.kind)
            && (arguments.words.is_empty() || arguments.words.iter().any(|word| is_meant(card, word)))
    });
    Ok(cards.into_iter().map(|card| (draw, card)).collect())
}

fn made(draw: u32, card: &Card) -> anyhow::Result<DrawnCase> {
    draw::case(draw, card).map_err(|reason| anyhow!(reason))
}

fn write(case: &DrawnCase, folder: &Path) -> anyhow::Result<()> {
    let files = case.files().map_err(|reason| anyhow!("{}: {reason}", case.name))?;
    trial::write_files(files, folder).map_err(|reason| anyhow!(reason))
}

/// The program that is put to the test, and where.
struct Bench {
    folder: PathBuf,
    program: PathBuf,
    digest: String,
    commit: String,
    timeout: Duration,
}

impl Bench {
    fn new(arguments: &Arguments) -> anyhow::Result<Self> {
        let program = arguments.built_program()?;
        let bytes = fs::read(&program).with_context(|| program.display().to_string())?;
        let timeout = Duration::try_from_secs_f64(arguments.timeout)
            .map_err(|_| BadInput(format!("--timeout {} is no time", arguments.timeout)))?;
        Ok(Self {
            folder: shell::root().join("target/hidden-effects"),
            digest: dynid_model::sha256_hex(&bytes),
            commit: commit()?,
            program,
            timeout,
        })
    }

    fn folder_of(&self, draw: u32, card: &Card) -> PathBuf {
        self.folder.join(format!("draw-{draw}")).join(format!("{:03}", card.number))
    }

    fn outcomes(&self, cards: &[Drawn], jobs: usize) -> anyhow::Result<Vec<Outcome>> {
        println!("{}", scores::HEADER);
        each(cards, jobs, &|(draw, card)| {
            let folder = self.folder_of(*draw, card);
            let outcome = match self.earlier(&folder) {
                Some(outcome) => outcome,
                None => self.tried(&made(*draw, card)?, &folder)?,
            };
            println!("{}", scores::row(&outcome));
            Ok(outcome)
        })
    }

    /// What the same program was worth on the same case; one that was stopped by a shorter time is asked again.
    fn earlier(&self, folder: &Path) -> Option<Outcome> {
        let text = fs::read_to_string(folder.join("outcome.json")).ok()?;
        let outcome: Outcome = serde_json::from_str(&text).ok()?;
        let is_same = outcome.edition == draw::EDITION && outcome.program == self.digest;
        let had_time = outcome.score.is_answered || outcome.timeout_s >= self.timeout.as_secs_f64();
        (is_same && had_time).then_some(outcome)
    }

    fn tried(&self, case: &DrawnCase, folder: &Path) -> anyhow::Result<Outcome> {
        // What another program left, checkpoints above all, is nothing to go on from.
        if folder.exists() {
            fs::remove_dir_all(folder).with_context(|| folder.display().to_string())?;
        }
        write(case, folder)?;
        let (answer, seconds) = self.diagnosed(folder)?;
        let score = match answer {
            Ok(diagnosis) => Score::of(case, &diagnosis).unwrap_or_else(|reason| Score::without_answer(&reason)),
            Err(reason) => Score::without_answer(&reason),
        };
        let outcome = Outcome {
            program: self.digest.clone(),
            commit: self.commit.clone(),
            timeout_s: self.timeout.as_secs_f64(),
            ..Outcome::of(case, score, seconds)
        };
        let path = folder.join("outcome.json");
        let text = serde_json::to_string_pretty(&outcome)?;
        fs::write(&path, text + "\n").with_context(|| path.display().to_string())?;
        Ok(outcome)
    }

    /// What `diagnose` prints, or why there is nothing, and the seconds until then.
    fn diagnosed(&self, folder: &Path) -> anyhow::Result<(Result<serde_json::Value, String>, f64)> {
        let path = |name: &str| folder.join(name);
        let created = |name: &str| File::create(path(name)).with_context(|| path(name).display().to_string());
        let started = Instant::now();
        let mut child = Command::new(&self.program)
            .args(["diagnose", "experiment.toml", "--model", "believed.toml", "--json"])
            .current_dir(folder)
            .stdin(Stdio::null())
            // into files: a pipe that nobody empties would stop the program
            .stdout(created("diagnosis.json")?)
            .stderr(created("diagnose.log")?)
            .spawn()
            .with_context(|| format!("starting {}", self.program.display()))?;
        let status = loop {
            match child.try_wait()? {
                Some(status) => break Some(status),
                None if started.elapsed() > self.timeout => {
                    child.kill()?;
                    child.wait()?;
                    break None;
                }
                None => std::thread::sleep(Duration::from_millis(20)),
            }
        };
        let seconds = started.elapsed().as_secs_f64();
        let answer = match status {
            None => Err(format!("no answer in {:.0} s", self.timeout.as_secs_f64())),
            Some(status) if status.success() => serde_json::from_str(&fs::read_to_string(path("diagnosis.json"))?)
                .map_err(|error| format!("no JSON: {error}")),
            Some(status) if status.code().is_none() => bail!("{} was killed", self.program.display()),
            Some(_) => {
                let told = fs::read_to_string(path("diagnose.log"))?;
                Err(format!("failed: {}", told.lines().last().unwrap_or_default()))
            }
        };
        Ok((answer, seconds))
    }
}

/// What the program was built from.
fn commit() -> anyhow::Result<String> {
    let git = |arguments: &[&str]| {
        let mut command = Command::new("git");
        command.args(arguments).current_dir(shell::root());
        shell::stdout_of(&mut command).map(|said| said.trim().to_owned())
    };
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    let is_changed = !git(&["status", "--porcelain", "--untracked-files=no"])?.is_empty();
    Ok(if is_changed { format!("{commit} with changes") } else { commit })
}

/// Fits the machines' own models to the positions of open-loop runs: what is left of held-out runs is the noise, or plant
/// and program disagree about an effect.
fn fit_the_truths(cards: &[Drawn], jobs: usize, bench: &Bench) -> anyhow::Result<()> {
    println!("| case | held-out error over the noise floor |\n| --- | --- |");
    let agree = each(cards, jobs, &|(draw, card)| {
        let case = made(*draw, card)?;
        let can_tell = case.instrument.drive == Drive::OpenLoop && case.instrument.n_runs > 1;
        if case.true_model.is_none() || !can_tell {
            return Ok(None);
        }
        let folder = bench.folder_of(*draw, card).join("truth");
        write(&case, &folder)?;
        let ratio = trial::fit_the_truth(&folder, &bench.program);
        let ratio = ratio.map(|ratio| ratio * noise_floor() / case.instrument.noise_floor());
        match &ratio {
            Ok(ratio) => println!("| {} | {ratio:.3} |", case.name),
            Err(reason) => println!("| {} | {reason} |", case.name),
        }
        Ok(Some(ratio.is_ok_and(|ratio| ratio <= AGREED)))
    })?;
    let agree: Vec<bool> = agree.into_iter().flatten().collect();
    let n_agree = agree.iter().filter(|agree| **agree).count();
    println!("\n{n_agree} of {} at most {AGREED} times the noise floor", agree.len());
    if n_agree < agree.len() { Err(anyhow!("plant and program disagree")) } else { Ok(()) }
}

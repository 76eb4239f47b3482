//! `dynid diagnose`: which physical effect is missing, and where.

use std::ffi::OsStr;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use anyhow::bail;
use dynid::diagnose::{self, Diagnosis, Discovered, Event, Finished, Options, Ranked, Verdict};
use dynid::error::Error;
use dynid::experiment::{Experiment, Run};
use dynid::fit::position::PositionFitError;
use dynid::identify::ErrorKind;
use dynid::model::Model;
use dynid::output::{Overwrite, check_output, write_new};
use dynid::report::number;
use dynid_model::sha256_hex;
use indicatif::ProgressBar;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::fit::Kind;
use super::inputs;
use super::interrupt::Interrupt;
use super::table::{Align, Table};
use super::{Answer, Outcome};

/// Say which physical effect a model lacks, at which joint, and how sure that is.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid diagnose experiment.toml --model fitted.toml
  dynid diagnose experiment.toml --model fitted.toml --out better.toml      write the model with what is missing
  dynid diagnose experiment.toml --model fitted.toml --depth 3              up to three effects, one after the other
  dynid diagnose experiment.toml --model fitted.toml --free 4,5             only runs with just these joints free

The model is fitted first. Every effect of the library is then tried at every place without a fit: how much of what is left
would it explain if the model's own parameters may make up for it? The best are fitted for good, and the runs that were
not fitted (role \"validate\") decide. Ctrl-C keeps the fits that are done; the same command goes on from them.

Verdicts: missing_effect, nothing_missing (what is left is noise), unexplained (no effect of the library explains it).
delta BIC below 0 means that an effect is worth its parameters.")]
pub struct Arguments {
    /// The experiment: which logs there are and what was free in each.
    experiment: PathBuf,
    /// The model; without it, the device's default.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Only runs in which exactly these joints are free, e.g. `--free 4` or `--free 4,5`.
    #[arg(long, value_delimiter = ',', value_name = "JOINTS")]
    free: Option<Vec<usize>>,
    /// Which error decides; without it, the one that `dynid fit` would make small.
    #[arg(long, value_enum)]
    error: Option<Kind>,
    /// Look for so many effects, one after the other.
    #[arg(long, value_name = "N", default_value_t = 1)]
    depth: usize,
    /// Fit so many suspects for good at most, and what the first of them contain.
    #[arg(long, value_name = "N", default_value_t = Options::default().refits)]
    refits: usize,
    /// Write the fitted model with the effects that were found.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the effect file of a formula that was discovered where no effect of the library explains the logs.
    #[arg(long, value_name = "FILE")]
    discovered: Option<PathBuf>,
    /// Write the diagnosis as JSON, e.g. for `dynid report`.
    #[arg(long, value_name = "FILE")]
    save: Option<PathBuf>,
    /// Overwrite outputs that are there.
    #[arg(long)]
    force: bool,
}

/// Diagnoses.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let started = Instant::now();
    let overwrite = Overwrite::if_forced(arguments.force);
    let outputs: Vec<&PathBuf> =
        [&arguments.out, &arguments.save, &arguments.discovered].into_iter().flatten().collect();
    for (index, output) in outputs.iter().enumerate() {
        if outputs[..index].contains(output) {
            bail!("{} is asked for twice; give each output a file of its own", output.display());
        }
        check_output(output, overwrite)?;
    }
    let experiment = inputs::experiment(&arguments.experiment)?;
    let model = inputs::model(arguments.model.as_deref(), &experiment)?;
    let runs: Vec<&Run> = inputs::runs(&experiment, arguments.free.as_deref())?;
    let options = Options {
        error: arguments.error.map(ErrorKind::from),
        depth: arguments.depth.max(1),
        refits: arguments.refits.max(1),
        ..Options::default()
    };
    let kept = Kept::new(arguments, &experiment, &model, &runs, &options);
    if kept.path.is_none() {
        eprintln!("note: no folder to keep fits in can be written: a stopped diagnosis will begin anew");
    }
    let finished = kept.read();
    let so_far = Mutex::new(finished.clone());
    let unsaved: Mutex<Option<Error>> = Mutex::new(None);
    let interrupt = Interrupt::listen()?;
    let bar = ProgressBar::new_spinner();
    bar.enable_steady_tick(Duration::from_millis(200));
    let tell = |event: &Event<'_>| {
        bar.set_message(message(event, started.elapsed().as_secs_f64()));
        if let Event::Refitted(key, refit) = event
            && let Ok(mut so_far) = so_far.lock()
        {
            so_far.insert((*key).to_owned(), (*refit).clone());
            if let Err(error) = kept.write(&so_far)
                && let Ok(mut unsaved) = unsaved.lock()
            {
                *unsaved = Some(error);
            }
        }
    };
    let stop = || interrupt.is_asked() || unsaved.lock().is_ok_and(|unsaved| unsaved.is_some());
    let found = diagnose::diagnose(&model, &experiment, &runs, &options, &finished, &tell, &stop);
    bar.finish_and_clear();
    if let Ok(Some(error)) = unsaved.into_inner() {
        return Err(error.into());
    }
    let found = match found {
        Err(Error::PositionFit(PositionFitError::Interrupted { .. })) => {
            let count = so_far.lock().map_or(0, |so_far| so_far.len());
            return Ok(interrupted(kept.path.as_deref(), count));
        }
        found => found?,
    };
    let wall_seconds = started.elapsed().as_secs_f64();
    let mut json = serde_json::to_value(&found)?;
    if let Some(object) = json.as_object_mut() {
        object.insert("wall_seconds".to_owned(), json!(wall_seconds));
    }
    let mut text = told(&found, wall_seconds);
    if let Some(out) = &arguments.out {
        if let Some(better) = &found.better {
            write_new(out, &better.to_toml(), overwrite)?;
            let _ = writeln!(text, "written: {}", out.display());
        } else {
            let _ = writeln!(text, "nothing to add, so {} was not written", out.display());
        }
    }
    if let Some(path) = &arguments.discovered {
        let discovered = found.discovered.as_ref();
        match (discovered, discovered.and_then(|discovered| discovered.effect_file.as_ref())) {
            (_, Some(file)) => {
                write_new(path, file, overwrite)?;
                let _ = writeln!(text, "written: {}", path.display());
            }
            (Some(_), None) => {
                let _ = writeln!(
                    text,
                    "no effect file can say the formula (it needs the signals of two other joints), so {} was not written",
                    path.display()
                );
            }
            (None, None) => {
                let _ = writeln!(text, "nothing was discovered, so {} was not written", path.display());
            }
        }
    }
    if let Some(save) = &arguments.save {
        write_new(save, &format!("{}\n", serde_json::to_string_pretty(&json)?), overwrite)?;
        let _ = writeln!(text, "written: {}", save.display());
    }
    text.push_str(&next(arguments, &found));
    kept.remove()?;
    Ok(Outcome { text, json, answer: Answer::Yes })
}

fn message(event: &Event<'_>, seconds: f64) -> String {
    match event {
        Event::FittingModel => format!("fitting the model itself, {seconds:.0} s"),
        Event::Screened(done, of) => format!("screening: {done} of {of} suspects, {seconds:.0} s"),
        Event::Comparing(count) => format!("comparing {count} suspects on a tether, {seconds:.0} s"),
        Event::Refitting(suspect) => format!("fitting with {suspect}, {seconds:.0} s"),
        Event::Refitted(_, refit) => match &refit.suspect {
            Some(suspect) => format!("fitted with {suspect}, {seconds:.0} s"),
            None => format!("fitted the model itself, {seconds:.0} s"),
        },
    }
}

fn told(found: &Diagnosis, wall_seconds: f64) -> String {
    let mut text = String::new();
    for sentence in &found.sentences {
        let _ = writeln!(text, "{sentence}");
    }
    let _ = writeln!(text, "({} error, {wall_seconds:.1} s)", found.error);
    for note in &found.notes {
        let _ = writeln!(text, "note: {note}");
    }
    if !found.ranking.is_empty() {
        text.push('\n');
        text.push_str(&table(found));
        for ranked in found.ranking.iter().take(3) {
            text.push_str(&evidence(ranked));
        }
    }
    if let Some(discovered) = &found.discovered {
        text.push_str(&formula(discovered));
    }
    if !found.refused.is_empty() {
        let _ = writeln!(text, "\nNo credit:");
        for alike in found.refused.chunk_by(|one, next| one.reason == next.reason) {
            let suspects: Vec<String> = alike.iter().map(|refused| refused.suspect.to_string()).collect();
            let _ = writeln!(text, "  {}: {}", suspects.join(", "), alike[0].reason);
        }
    }
    if !found.moved.is_empty() {
        let _ = writeln!(text, "\nMoved between runs:");
        for moved in &found.moved {
            let change = moved.change_in_std_errors;
            let _ = writeln!(text, "  {} in {}: by {change:+.1} standard errors", moved.parameter, moved.run);
        }
    }
    if !found.places.is_empty() {
        let _ = writeln!(text, "\nWhere the model fails:");
        for place in &found.places {
            let _ = writeln!(text, "  {}, joint {}: {}", place.run, place.joint, place.what);
        }
    }
    text
}

fn formula(discovered: &Discovered) -> String {
    let mut text = format!("\nDiscovered at joint {}: {}\n", discovered.joint, discovered.formula);
    for term in &discovered.terms {
        let _ = writeln!(
            text,
            "  {}: {} +- {} {}, chosen in {:.0} % of random halves of the data",
            term.term,
            number(term.coefficient),
            number(term.std_error),
            term.unit,
            100.0 * term.chosen_in
        );
    }
    let _ = writeln!(
        text,
        "  squared torque error explained: {:.0} % of the runs fitted to, {:.0} % of the held-out runs",
        100.0 * discovered.explained_fit,
        100.0 * discovered.explained_validate
    );
    for other in &discovered.elsewhere {
        let _ = writeln!(
            text,
            "  another at joint {}: {} ({:.0} % of the held-out runs)",
            other.joint,
            other.formula,
            100.0 * other.explained_validate
        );
    }
    text
}

fn table(found: &Diagnosis) -> String {
    let mut table = Table::new(&[
        ("effect", Align::Left),
        ("held-out position before", Align::Right),
        ("after", Align::Right),
        ("held-out torque before", Align::Right),
        ("after", Align::Right),
        ("delta BIC", Align::Right),
        ("fits as well", Align::Left),
    ]);
    let position = |rmse: Option<f64>| rmse.map_or("-".to_owned(), number);
    let torque = |percent: Option<f64>| percent.map_or("-".to_owned(), |percent| format!("{percent:.1} %"));
    for ranked in &found.ranking {
        let others: Vec<String> = ranked.confounded_with.iter().map(ToString::to_string).collect();
        table.row([
            ranked.suspect.to_string(),
            position(ranked.rmse_validate_before),
            position(ranked.rmse_validate_after),
            torque(ranked.torque_percent_before),
            torque(ranked.torque_percent_after),
            format!("{:+.0}", ranked.delta_bic),
            others.join(", "),
        ]);
    }
    table.text()
}

fn evidence(ranked: &Ranked) -> String {
    let mut text = format!("\n{}\n", ranked.suspect);
    for own in &ranked.parameters {
        let error = own.std_error.map_or(String::new(), |error| format!(" +- {}", number(error)));
        let _ = writeln!(text, "  {} = {}{error}", own.name, number(own.value));
    }
    for line in &ranked.evidence_for {
        let _ = writeln!(text, "  for: {line}");
    }
    for line in &ranked.evidence_against {
        let _ = writeln!(text, "  against: {line}");
    }
    if let Some(experiment) = &ranked.experiment {
        let _ = writeln!(text, "  to tell it from the others: {experiment}");
    }
    text
}

/// The commands that come next.
fn next(arguments: &Arguments, found: &Diagnosis) -> String {
    if let Some(discovered) = &found.discovered
        && discovered.effect_file.is_some()
    {
        return after_discovery(arguments, discovered);
    }
    if found.verdict != Verdict::MissingEffect {
        return String::new();
    }
    let Some(best) = found.ranking.first() else { return String::new() };
    let model = arguments.model.as_deref().map_or("fitted.toml".to_owned(), |path| path.display().to_string());
    let joint = best.suspect.joint.map_or(String::new(), |joint| format!(" --joint {joint}"));
    let from = best.suspect.from.map_or(String::new(), |from| format!(" --from {from}"));
    let experiment = arguments.experiment.display();
    let asked = as_asked(arguments);
    format!(
        "\nNext:\n  dynid add {}{joint}{from} --model {model} --out better.toml\n  dynid fit {experiment}{asked} --model \
         better.toml --out better-fitted.toml\n",
        best.suspect.effect
    )
}

/// Which runs and which error, as the options that were given say.
fn as_asked(arguments: &Arguments) -> String {
    let joints: Option<Vec<String>> =
        arguments.free.as_ref().map(|free| free.iter().map(ToString::to_string).collect());
    let free = joints.map_or(String::new(), |joints| format!(" --free {}", joints.join(",")));
    let error = arguments.error.map_or(String::new(), |error| format!(" --error {}", ErrorKind::from(error)));
    free + &error
}

/// The commands that put a discovered effect to use.
fn after_discovery(arguments: &Arguments, discovered: &Discovered) -> String {
    let model = arguments.model.as_deref().map_or("fitted.toml".to_owned(), |path| path.display().to_string());
    let experiment = arguments.experiment.display();
    let asked = as_asked(arguments);
    let Some(path) = &arguments.discovered else {
        return format!("\nNext:\n  dynid diagnose {experiment}{asked} --model {model} --discovered discovered.toml\n");
    };
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.map_or(".".to_owned(), |folder| folder.display().to_string());
    let id = path.file_stem().unwrap_or_default().to_string_lossy();
    let from = discovered.from.map_or(String::new(), |from| format!(" --from {from}"));
    format!(
        "\nNext:\n  DYNID_EFFECTS={folder} cargo build --release\n  dynid add {id} --joint {}{from} --model {model} --out \
         better.toml\n  dynid fit {experiment}{asked} --model better.toml --out better-fitted.toml\n",
        discovered.joint
    )
}

fn interrupted(path: Option<&Path>, count: usize) -> Outcome {
    let text = path.map_or_else(
        || "stopped; its fits are lost: no folder in which to keep them could be written\n".to_owned(),
        |path| format!("stopped; {count} fits are kept in {}: the same command goes on from there\n", path.display()),
    );
    let path = path.map(|path| path.display().to_string());
    let fits = if path.is_some() { count } else { 0 };
    Outcome {
        text,
        json: json!({ "interrupted": true, "checkpoint": path, "fits": fits }),
        answer: Answer::Interrupted,
    }
}

/// Raised whenever a refit, or what it starts from, changes its meaning: fits of another program are not mixed in.
const FORMAT: u32 = 8;

/// Fits that are done, for a diagnosis that is stopped.
struct Kept {
    /// Where; nowhere if no folder can be written.
    path: Option<PathBuf>,
    identity: String,
}

#[derive(Serialize, Deserialize)]
struct File {
    identity: String,
    fits: Finished,
}

impl Kept {
    fn new(arguments: &Arguments, experiment: &Experiment, model: &Model, runs: &[&Run], options: &Options) -> Self {
        let believed = &model.believed;
        let mut text = format!(
            "{FORMAT} {} {} {} {believed:?} {options:?}",
            env!("CARGO_PKG_VERSION"),
            experiment.digest,
            model.digest()
        );
        for run in runs {
            let _ = write!(text, "\n{} {} {:?} {:?}", run.file, run.role, run.free, run.settings);
        }
        // What is looked for depends on the library as well.
        for effect in dynid_model::effects() {
            let _ = write!(text, "\n{effect:?}");
        }
        let identity = sha256_hex(text.as_bytes());
        let path = place(arguments.model.as_ref().unwrap_or(&arguments.experiment), &identity);
        Self { path, identity }
    }

    /// What an earlier, stopped diagnosis of the same left.
    fn read(&self) -> Finished {
        let text = self.path.as_ref().and_then(|path| std::fs::read_to_string(path).ok());
        let file = text.and_then(|text| toml::from_str::<File>(&text).ok());
        file.filter(|file| file.identity == self.identity).map(|file| file.fits).unwrap_or_default()
    }

    fn write(&self, fits: &Finished) -> Result<(), Error> {
        let Some(path) = &self.path else { return Ok(()) };
        let file = File { identity: self.identity.clone(), fits: fits.clone() };
        let unwritable = |reason: String| Error::Unwritable {
            path: path.clone(),
            source: std::io::Error::new(std::io::ErrorKind::InvalidData, reason),
        };
        let text = toml::to_string(&file).map_err(|error| unwritable(error.to_string()))?;
        let text =
            format!("# Fits of a stopped diagnosis; the same `dynid diagnose` goes on from it and removes it.\n{text}");
        write_new(path, &text, Overwrite::Force)
    }

    fn remove(&self) -> Result<(), Error> {
        let Some(path) = &self.path else { return Ok(()) };
        dynid::checkpoint::remove(path).map_err(|source| Error::Unwritable { path: path.clone(), source })
    }
}

/// Where to keep fits: beside the input, or in the working folder, since logs are often kept where nothing can be written.
fn place(input: &Path, identity: &str) -> Option<PathBuf> {
    let beside = |path: &OsStr| {
        let mut name = path.to_owned();
        name.push(format!(".diagnosis-{}.checkpoint", &identity[..8]));
        PathBuf::from(name)
    };
    let places = [Some(beside(input.as_os_str())), input.file_name().map(beside)];
    places.into_iter().flatten().find(|path| check_output(path, Overwrite::Force).is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fits_are_kept_beside_the_input_or_in_the_working_folder() {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("believed.toml");
        assert_eq!(
            place(&input, "0123456789"),
            Some(folder.path().join("believed.toml.diagnosis-01234567.checkpoint"))
        );
        let missing = folder.path().join("no/believed.toml");
        assert_eq!(place(&missing, "0123456789"), Some(PathBuf::from("believed.toml.diagnosis-01234567.checkpoint")));
    }

    #[test]
    fn what_is_kept_nowhere_is_said_to_be_lost() {
        let kept = Kept { path: None, identity: "0123456789".to_owned() };
        kept.write(&Finished::default()).unwrap();
        assert!(kept.read().is_empty());
        kept.remove().unwrap();
        let outcome = interrupted(None, 3);
        assert!(outcome.text.contains("its fits are lost"), "{}", outcome.text);
        assert_eq!(outcome.json["fits"], 0);
    }
}

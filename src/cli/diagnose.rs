//! `dynid diagnose`: which physical effect is missing, and where.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

use anyhow::bail;
use dynid::{DiagnoseSettings, Diagnosis, ErrorSignal, Experiment, Model, Ranked, Run, Verdict};
use dynid_diagnose::{Discovered, Event, Finished, Options, RejectedCandidate, Speaks};
use dynid_files::{Overwrite, check_output, write_new};
use dynid_format::number;
use dynid_model::sha256_hex;
use dynid_sentences::diagnosis as sentences;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::fit::Kind;
use super::inputs;
use super::interrupt::Interrupt;
use super::table::{Align, Table};
use super::{Answer, Outcome, progress};

/// Say which physical effect a model lacks, at which joint, and how sure that is.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid diagnose experiment.toml --model fitted.toml
  dynid diagnose experiment.toml --model fitted.toml --out better.toml      write the model with what is missing
  dynid diagnose experiment.toml --model fitted.toml --depth 3              up to three effects, one after the other
  dynid diagnose experiment.toml --model fitted.toml --free 4,5             only runs with just these joints free

The model is fitted so that its one-step predictions make the logs likeliest, and every effect of the library is asked at every
place what it would add to that likelihood. The most promising are fitted, and the likelihood of all runs, those held out (role
\"validate\") included, decides; it goes on while another effect explains what is left. With --error position the model is trusted altogether
between samples, with --error torque only within the bandwidth of the torque error's filter. Ctrl-C keeps the fits that are done; the same command goes on from them.

Verdicts: missing_effect, nothing_missing (what is left is noise), unexplained (no effect of the library explains it).
delta BIC below 0 means that an effect is worth its parameters.")]
pub struct Arguments {
    /// The experiment: which logs there are and what was free in each.
    pub experiment: PathBuf,
    /// The model; without it, the device's default.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Only runs in which exactly these joints are free, e.g. `--free 4` or `--free 4,5`.
    #[arg(long, value_delimiter = ',', value_name = "JOINTS")]
    free: Option<Vec<usize>>,
    /// Trust the model as this error does, instead of as the logs make likeliest.
    #[arg(long, value_enum)]
    error: Option<Kind>,
    /// Look for so many effects, one after the other; without it, for as many as it pays.
    #[arg(long, value_name = "N")]
    depth: Option<usize>,
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
    let runs: Vec<&Run> = experiment.runs_with_free(arguments.free.as_deref())?;
    let mut settings = DiagnoseSettings {
        free: arguments.free.clone(),
        error: arguments.error.map(ErrorSignal::from),
        depth: arguments.depth,
        finished: Finished::new(),
    };
    let kept = Kept::new(arguments, &experiment, &model, &runs, &settings.options());
    if !kept.is_possible() {
        let places: Vec<String> = kept.places.iter().map(|path| path.display().to_string()).collect();
        say!("note: fits cannot be kept in {}: if this diagnosis is stopped, it begins anew", places.join(", nor in "));
    }
    settings.finished = kept.read();
    if !settings.finished.is_empty() {
        say!("note: goes on from {} of a stopped diagnosis", fits(settings.finished.len()));
    }
    let so_far = Mutex::new(settings.finished.clone());
    let interrupt = Interrupt::listen()?;
    let hear = |event: &Event<'_>| {
        let done = match event {
            Event::Searched(key, state) => Some((*key, (*state).clone())),
            _ => None,
        };
        if let Some((key, fit)) = done
            && let Ok(mut so_far) = so_far.lock()
        {
            so_far.insert(key.to_owned(), fit);
            // A fit that cannot be kept is still good for this diagnosis.
            let _ = kept.write(&so_far);
        }
    };
    let found = progress::of_diagnosis(&hear, &|| interrupt.is_asked(), |progress| {
        dynid::diagnose(&model, &experiment, &settings, progress)
    });
    if found.as_ref().is_err_and(|error| error.interrupted_after().is_some()) {
        let so_far = so_far.into_inner().unwrap_or_default();
        return Ok(interrupted(kept.write(&so_far), so_far.len()));
    }
    let found = found?;
    let wall_seconds = started.elapsed().as_secs_f64();
    let mut json = sentences::json(&found)?;
    if let Some(object) = json.as_object_mut() {
        object.insert("wall_seconds".to_owned(), json!(wall_seconds));
    }
    let mut text = as_text(&found, wall_seconds);
    if let Some(out) = &arguments.out {
        if let Some(better) = &found.better {
            write_new(out, &better.to_toml_at(out), overwrite)?;
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
    for left in kept.remove() {
        let _ = writeln!(text, "note: {} is of no more use, but could not be removed", left.display());
    }
    Ok(Outcome { text, json, answer: Answer::Yes })
}

fn as_text(found: &Diagnosis, wall_seconds: f64) -> String {
    let mut text = String::new();
    for sentence in sentences::sentences(found) {
        let _ = writeln!(text, "{sentence}");
    }
    let _ = writeln!(text, "({} error, {wall_seconds:.1} s)", found.error);
    for note in sentences::notes(found) {
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
    if !found.rejected.is_empty() {
        let _ = writeln!(text, "\nNo credit:");
        // What reads alike is said once, whatever digits the numbers have beyond those that are told.
        let reason = |rejected: &RejectedCandidate| sentences::rejection(&rejected.reason);
        for alike in found.rejected.chunk_by(|one, next| reason(one) == reason(next)) {
            let candidates: Vec<String> = alike.iter().map(|rejected| rejected.candidate.to_string()).collect();
            let _ = writeln!(text, "  {}: {}", candidates.join(", "), reason(&alike[0]));
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
            let what = sentences::place(place);
            let _ = writeln!(text, "  {}, joint {}: {what}", place.finding.run, place.finding.joint);
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
        "  explained of what is above the noise, one step ahead: {:.0} % of the runs fitted to, {:.0} % of the held-out runs",
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
            ranked.candidate.to_string(),
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
    let mut text = format!("\n{}\n", ranked.candidate);
    for own in &ranked.parameters {
        let error = own.std_error.map_or(String::new(), |error| format!(" +- {}", number(error)));
        let _ = writeln!(text, "  {} = {}{error}", own.name, number(own.value));
    }
    for line in sentences::evidence_that(Speaks::For, ranked) {
        let _ = writeln!(text, "  for: {line}");
    }
    for line in sentences::evidence_that(Speaks::Against, ranked) {
        let _ = writeln!(text, "  against: {line}");
    }
    if let Some(experiment) = &ranked.experiment {
        let _ = writeln!(text, "  to tell it from the others: {}", sentences::experiment(experiment));
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
    let joint = best.candidate.joint.map_or(String::new(), |joint| format!(" --joint {joint}"));
    let from = best.candidate.from.map_or(String::new(), |from| format!(" --from {from}"));
    let experiment = arguments.experiment.display();
    let asked = as_asked(arguments);
    format!(
        "\nNext:\n  dynid add {}{joint}{from} --model {model} --out better.toml\n  dynid fit {experiment}{asked} --model \
         better.toml --out better-fitted.toml\n",
        best.candidate.effect
    )
}

/// Which runs and which error, as the options that were given say.
fn as_asked(arguments: &Arguments) -> String {
    let joints: Option<Vec<String>> =
        arguments.free.as_ref().map(|free| free.iter().map(ToString::to_string).collect());
    let free = joints.map_or(String::new(), |joints| format!(" --free {}", joints.join(",")));
    let error = arguments.error.map_or(String::new(), |error| format!(" --error {}", ErrorSignal::from(error)));
    free + &error
}

/// The commands that put a discovered effect to use.
fn after_discovery(arguments: &Arguments, discovered: &Discovered) -> String {
    let model = arguments.model.as_deref().map_or("fitted.toml".to_owned(), |path| path.display().to_string());
    let experiment = arguments.experiment.display();
    let asked = as_asked(arguments);
    let Some(path) = &arguments.discovered else {
        return format!(
            "\nNext:\n  mkdir effects\n  dynid diagnose {experiment}{asked} --model {model} --discovered \
             effects/discovered.toml\n"
        );
    };
    let own = Path::new("effects");
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    // A folder of effects holds nothing else, and the one beside every model is found without being named.
    let moved =
        folder.map_or_else(|| format!("  mkdir effects && mv {} effects/\n", path.display()), |_| String::new());
    let folder = folder.unwrap_or(own);
    let beside = arguments.model.as_ref().unwrap_or(&arguments.experiment).with_file_name("effects");
    let is_found = folder == own && beside == own;
    let effects = if is_found { String::new() } else { format!(" --effects {}", folder.display()) };
    let id = path.file_stem().unwrap_or_default().to_string_lossy();
    let from = discovered.from.map_or(String::new(), |from| format!(" --from {from}"));
    format!(
        "\nNext:\n{moved}  dynid add {id} --joint {}{from} --model {model}{effects} --out better.toml\n  dynid fit {experiment}{asked} \
         --model better.toml{effects} --out better-fitted.toml\n",
        discovered.joint
    )
}

fn fits(count: usize) -> String {
    if count == 1 { "1 fit".to_owned() } else { format!("{count} fits") }
}

/// What a diagnosis says that was stopped after `count` fits, which are kept in `path`.
fn interrupted(path: Option<&Path>, count: usize) -> Outcome {
    let text = match path {
        _ if count == 0 => "stopped before a fit was done: the same command begins anew\n".to_owned(),
        Some(path) => {
            let are = if count == 1 { "is" } else { "are" };
            format!("stopped; {} {are} kept in {}: the same command goes on from there\n", fits(count), path.display())
        }
        None => format!("stopped; {} lost, since no folder could be written to\n", fits(count)),
    };
    let path = path.map(|path| path.display().to_string());
    let fits = if path.is_some() { count } else { 0 };
    Outcome {
        text,
        json: json!({ "interrupted": true, "checkpoint": path, "fits": fits }),
        answer: Answer::Interrupted,
    }
}

/// Raised whenever a refit, or what it starts from, changes its meaning: fits of another program are not mixed in.
const FORMAT: u32 = 19;

/// Fits that are done, for a diagnosis that is stopped.
struct Kept {
    /// Where they may be, the first that can be written to being the one to take.
    places: Vec<PathBuf>,
    identity: String,
}

#[derive(Serialize, Deserialize)]
struct File {
    identity: String,
    fits: Finished,
}

impl Kept {
    fn new(arguments: &Arguments, experiment: &Experiment, model: &Model, runs: &[&Run], options: &Options) -> Self {
        let prior = &model.prior;
        let mut text = format!(
            "{FORMAT} {} {} {} {} {prior:?} {options:?}",
            env!("CARGO_PKG_VERSION"),
            experiment.digest,
            model.device.structure_digest(),
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
        let input = arguments.model.as_ref().unwrap_or(&arguments.experiment);
        let output = arguments.out.as_deref().or(arguments.save.as_deref());
        Self { places: places(output, input, Path::new(""), &identity), identity }
    }

    /// Whether there is a place that can be written to.
    fn is_possible(&self) -> bool {
        self.places.iter().any(|path| check_output(path, Overwrite::Force).is_ok())
    }

    /// What an earlier, stopped diagnosis of the same left, wherever it could be kept then.
    fn read(&self) -> Finished {
        let file = |path: &PathBuf| parsed(&dynid_files::read(path).ok()?);
        let files = self.places.iter().filter_map(file).filter(|file| file.identity == self.identity);
        files.flat_map(|file| file.fits).collect()
    }

    /// Where the fits are kept now, if there are any and a place takes them.
    fn write(&self, fits: &Finished) -> Option<&Path> {
        if fits.is_empty() {
            return None;
        }
        let text = toml::to_string(&File { identity: self.identity.clone(), fits: fits.clone() }).ok()?;
        let text =
            format!("# Fits of a stopped diagnosis; the same `dynid diagnose` goes on from it and removes it.\n{text}");
        let written = self.places.iter().find(|path| write_new(path, &text, Overwrite::Force).is_ok());
        written.map(PathBuf::as_path)
    }

    /// Removes them; returns what could not be removed.
    fn remove(&self) -> Vec<&Path> {
        let left = self.places.iter().filter(|path| dynid_identify::checkpoint::remove(path).is_err());
        left.map(PathBuf::as_path).collect()
    }
}

fn parsed(text: &str) -> Option<File> {
    toml::from_str(text).ok()
}

pub(super) fn is_checkpoint(text: &str) -> bool {
    parsed(text).is_some()
}

/// Where fits may be kept: beside what is to be written, beside the input, or in the working folder `here`, since logs often lie where nothing can
/// be written.
fn places(output: Option<&Path>, input: &Path, here: &Path, identity: &str) -> Vec<PathBuf> {
    let name = input.file_name().unwrap_or_default().to_string_lossy();
    let name = format!("{name}.diagnosis-{}.checkpoint", &identity[..8]);
    let beside = output.into_iter().chain([input]).map(|path| path.with_file_name(&name));
    let mut places: Vec<PathBuf> = Vec::new();
    for place in beside.chain([here.join(&name)]) {
        if !places.contains(&place) {
            places.push(place);
        }
    }
    places
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    const IDENTITY: &str = "0123456789";

    /// Makes sure that nobody, not even root, can write a file there.
    fn block(path: &Path) {
        fs::create_dir(path).unwrap();
    }

    fn some_fits(folder: &Path) -> (Kept, Finished) {
        let (logs, here) = (folder.join("logs"), folder.join("here"));
        fs::create_dir(&logs).unwrap();
        fs::create_dir(&here).unwrap();
        let places = places(None, &logs.join("experiment.toml"), &here, IDENTITY);
        let state = serde_json::from_value(json!({
            "plan": [], "iterations": 1, "cost": null, "is_done": false,
            "search": {
                "x": [], "damping": 1.0, "growth": 2.0, "idle": 0, "is_shortened": false, "iterations": 1, "half_spaces": [],
            }
        }));
        let fits = Finished::from([("the model itself".to_owned(), state.unwrap())]);
        (Kept { places, identity: IDENTITY.to_owned() }, fits)
    }

    #[test]
    fn fits_are_kept_beside_the_input_or_in_the_working_folder() {
        let folder = tempfile::tempdir().unwrap();
        let (kept, fits) = some_fits(folder.path());
        let [beside, here] = kept.places.as_slice() else { panic!("two places") };
        assert!(kept.is_possible() && kept.read().is_empty());
        assert_eq!(kept.write(&fits), Some(beside.as_path()));
        fs::remove_file(beside).unwrap();
        block(beside);
        assert!(kept.is_possible());
        assert_eq!(kept.write(&fits), Some(here.as_path()));
        fs::remove_dir(beside).unwrap();
        assert_eq!(kept.read().len(), 1, "what is kept here is found when the other can be written again");
        assert!(kept.remove().is_empty() && !here.exists());
    }

    #[test]
    fn fits_are_kept_beside_what_is_to_be_written_first() {
        let [out, input, here] = ["out/found.json", "logs/experiment.toml", "."].map(Path::new);
        let places = places(Some(out), input, here, IDENTITY);
        let folders: Vec<&Path> = places.iter().filter_map(|place| place.parent()).collect();
        assert_eq!(folders, ["out", "logs", "."].map(Path::new));
        assert!(places.iter().all(|place| place.ends_with("experiment.toml.diagnosis-01234567.checkpoint")));
    }

    #[test]
    fn what_is_kept_nowhere_is_said_to_be_lost() {
        let folder = tempfile::tempdir().unwrap();
        let (kept, fits) = some_fits(folder.path());
        kept.places.iter().for_each(|path| block(path));
        assert!(!kept.is_possible());
        let outcome = interrupted(kept.write(&fits), fits.len());
        assert_eq!(outcome.text, "stopped; 1 fit lost, since no folder could be written to\n");
        assert_eq!(outcome.json["fits"], 0);
        assert!(kept.write(&Finished::default()).is_none(), "no fits, no file");
    }
}

//! All that is known of a model and its logs on one page.

use std::ops::ControlFlow;

use dynid_format::number;
use dynid_identify::{FitError, position::FitRun};
use dynid_judge::{compare::Finding, compare::locate::locate, ladder::Ladder, ladder::Rung};
use dynid_logs::quality;
use dynid_logs::{experiment::Experiment, experiment::Role, experiment::Run};
use dynid_report::{
    self as page, DataQuality, Figures, LadderSection, Provenance, Ranking, Section, Sheet, TorqueTerms, Verdict, Where,
};
use dynid_report::{ShownErrors, run_panels};
use dynid_sentences as sentences;
use dynid_torque as torque;
use dynid_user_model::Model;
use serde_json::Value;

use crate::progress::Done;
use crate::{Error, LadderSettings, ladder};

/// What stands on the page beside what models and logs say.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReportSettings {
    /// A diagnosis as `dynid diagnose --json` prints it ([`dynid_sentences::diagnosis::json`]); one of any version will do.
    pub diagnosis: Option<Value>,
    /// The commands that led here.
    pub commands: Vec<String>,
}

/// One page (HTML, opens with no network) about the last of `models`, each with what it is called; the ones before it stand on
/// the ladder: verdict, ladder, where model and logs part, measured against simulated, the torque by physical term, the
/// diagnosis, parameters, the quality of the logs, and where everything came from. `progress` hears of every model.
///
/// # Errors
/// No model; as [`ladder()`].
///
/// ```
/// use std::ops::ControlFlow;
/// # let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/tour");
/// let experiment = dynid::Experiment::load(format!("{folder}/experiment.toml"))?;
/// let model = dynid::Model::load(format!("{folder}/believed.toml"))?;
/// let models = [("believed".to_owned(), model)];
/// let report = dynid::report(&models, &experiment, &Default::default(), &|_| ControlFlow::Continue(()))?;
/// assert!(report.page().starts_with("<!doctype html>"));
/// # Ok::<(), dynid::Error>(())
/// ```
pub fn report<'a>(
    models: &'a [(String, Model)],
    experiment: &'a Experiment,
    settings: &ReportSettings,
    progress: &(dyn Fn(Done) -> ControlFlow<()> + Sync),
) -> Result<Report<'a>, Error> {
    if models.is_empty() {
        return Err(Error::NoModel);
    }
    Report::new(models, experiment, settings, ladder(models, experiment, &LadderSettings::default(), progress)?)
}

/// Everything on the page.
pub struct Report<'a> {
    experiment: &'a Experiment,
    models: &'a [(String, Model)],
    runs: Vec<&'a Run>,
    ladder: Ladder,
    /// Of the subject.
    findings: Vec<Finding>,
    /// Of the model before it.
    findings_before: Vec<Finding>,
    diagnosis: Option<Value>,
    terms: TorqueTerms,
    occurs: Vec<bool>,
    quality: DataQuality,
    commands: Vec<String>,
}

impl<'a> Report<'a> {
    /// Takes apart what was compared; the last of `models` is the subject.
    fn new(
        models: &'a [(String, Model)],
        experiment: &'a Experiment,
        settings: &ReportSettings,
        ladder: Ladder,
    ) -> Result<Self, Error> {
        let runs: Vec<&Run> = experiment.runs.iter().collect();
        let Some(((_, subject), rung)) = models.last().zip(ladder.rungs.last()) else { return Err(Error::NoModel) };
        let findings = locate(subject, &runs, &rung.comparison);
        let before = models.len().checked_sub(2).map(|before| (&models[before].1, &ladder.rungs[before].comparison));
        let findings_before = before.map_or_else(Vec::new, |(model, comparison)| locate(model, &runs, comparison));
        let mut terms = TorqueTerms::default();
        for run in &runs {
            // A run without torque error is said among the notes of the comparison.
            if let Ok(joints) = torque::terms(subject, run) {
                let unit = |joint: usize| subject.device.joints[joint].command_unit.clone();
                terms
                    .runs
                    .push((run.file.clone(), joints.into_iter().map(|own| (own.clone(), unit(own.joint))).collect()));
            }
        }
        let systems = runs
            .iter()
            .map(|run| FitRun::of_run(subject, run))
            .collect::<Result<Vec<FitRun>, _>>()
            .map_err(FitError::from)?;
        let occurs = subject.names().iter().map(|name| systems.iter().any(|run| run.occurs(name))).collect();
        let quality = DataQuality { runs: runs.iter().map(|run| quality::of_run(run)).collect() };
        Ok(Self {
            experiment,
            models,
            runs,
            ladder,
            findings,
            findings_before,
            diagnosis: settings.diagnosis.clone(),
            terms,
            occurs,
            quality,
            commands: settings.commands.clone(),
        })
    }

    /// Where the subject and its logs part, the most telling first.
    pub fn findings(&self) -> &[Finding] {
        &self.findings
    }

    /// What was found of the logs themselves, run by run.
    pub fn quality(&self) -> &DataQuality {
        &self.quality
    }

    fn subject(&self) -> (&str, &Model) {
        let (name, model) = &self.models[self.models.len() - 1];
        (name, model)
    }

    /// The verdict, in three sentences: how far off, whether the lineage paid, and what is missing or where it shows.
    pub fn sentences(&self) -> Vec<String> {
        let (name, _) = self.subject();
        let rung = &self.ladder.rungs[self.ladder.rungs.len() - 1];
        let held_out = self.experiment.runs.iter().any(|run| run.role == Role::Validate);
        let on = if held_out { "the held-out runs" } else { "the runs it was fitted to (none is held out)" };
        let (rmse, percent) = if held_out {
            (rung.rmse_validate, rung.torque_percent_validate)
        } else {
            (rung.rmse_fit, rung.torque_percent_fit)
        };
        // A simulation that has lost a log says nothing by its size.
        let role = if held_out { Role::Validate } else { Role::Fit };
        let is_lost = |rung: &Rung| {
            self.runs.iter().zip(&rung.comparison.runs).any(|(run, compared)| run.role == role && compared.lost)
        };
        let rmse = rmse.filter(|_| !is_lost(rung));
        let mut parts = Vec::new();
        if let Some(rmse) = rmse {
            let times = match self.ladder.noise_floor.filter(|floor| *floor > 0.0) {
                Some(floor) => format!(" ({:.2} times the noise of the logs)", rmse / floor),
                None => String::new(),
            };
            parts.push(format!("a position error of {} RMS{times}", number(rmse)));
        }
        if let Some(percent) = percent {
            parts.push(format!("a torque error of {percent:.1} %"));
        }
        let mut sentences = vec![if parts.is_empty() {
            format!("{name} has no error that can be computed on {on}.")
        } else {
            format!("On {on}, {name} has {}.", parts.join(" and "))
        }];
        let first = &self.ladder.rungs[0];
        let fell = |before: Option<f64>, after: Option<f64>| before.zip(after).filter(|(_, after)| *after > 0.0);
        let rmse_first = if held_out { first.rmse_validate } else { first.rmse_fit };
        let position = fell(rmse_first.filter(|_| !is_lost(first)), rmse);
        let torque = if held_out {
            fell(first.torque_percent_validate, percent)
        } else {
            fell(first.torque_percent_fit, percent)
        };
        if self.models.len() > 1 {
            let added: Vec<&str> =
                self.ladder.rungs.iter().flat_map(|rung| rung.added.iter().map(String::as_str)).collect();
            let with = if added.is_empty() { String::new() } else { format!(" with {}", added.join(", ")) };
            sentences.push(match (position, torque) {
                (Some((before, after)), _) => format!(
                    "Since {} the position error went from {} to {}{with}.",
                    first.model,
                    number(before),
                    number(after)
                ),
                (None, Some((before, after))) => {
                    format!("Since {} the torque error went from {before:.1} to {after:.1} %{with}.", first.model)
                }
                (None, None) => format!("It has {} models before it.", self.models.len() - 1),
            });
        }
        let reported = self.diagnosis.as_ref().and_then(answer);
        sentences.push(match (reported, self.findings.first()) {
            (Some(reported), _) => reported,
            (None, Some(finding)) => {
                let what = sentences::finding::sentence(finding);
                format!("Most telling of what is left: {}, joint {}: {what}.", finding.run, finding.joint)
            }
            (None, None) => "Nothing of what is left differs from chance.".to_owned(),
        });
        sentences
    }

    fn sections<T>(&self, with: impl FnOnce(&[&dyn Section]) -> T) -> T {
        let (_, subject) = self.subject();
        let rung = &self.ladder.rungs[self.ladder.rungs.len() - 1];
        let verdict = Verdict { sentences: self.sentences() };
        let ladder = LadderSection { ladder: &self.ladder };
        let name_before = self.models.len().checked_sub(2).map(|before| self.models[before].0.as_str());
        let place =
            Where { findings: &self.findings, before: name_before.map(|name| (name, self.findings_before.as_slice())) };
        // Held-out runs first: they are what a model is judged by.
        let mut order: Vec<usize> = (0..self.runs.len()).collect();
        order.sort_by_key(|index| self.runs[*index].role != Role::Validate);
        let mut panels = Vec::new();
        let mut means = Vec::new();
        for index in order {
            let compared = &rung.comparison.runs[index];
            panels.extend(run_panels(subject.device, self.runs[index], compared, ShownErrors::Both));
            for joint in compared.joints.iter().filter(|joint| !joint.means.is_empty()) {
                let meanings = sentences::compare::meanings(joint).join(" ");
                means.push(format!("{}, joint {}: {meanings}", compared.file, joint.joint));
            }
            let notes = sentences::compare::notes(compared);
            means.extend(notes.iter().map(|note| format!("{}: {note}", compared.file)));
        }
        let overlays = Figures {
            title: "Measured against the model".to_owned(),
            panels,
            note: "Above: measured (wide and pale) and model (thin). Below: what is left; the band is twice the log's noise. \
                   Buttons, arrow keys, + and \u{2212} zoom; so does the wheel after a click; drag to move; double-click for all."
                .to_owned(),
        };
        let means = page::Sentences { title: "What is left, in words".to_owned(), sentences: means };
        let sheet = Sheet { model: subject, occurs: self.occurs.clone() };
        let mut provenance = Provenance::of_models(self.experiment, self.models);
        provenance.commands.clone_from(&self.commands);
        let ranking = self.diagnosis.as_ref().map(|diagnosis| Ranking { diagnosis });
        let mut sections: Vec<&dyn Section> = vec![&verdict, &ladder, &place];
        if let Some(ranking) = &ranking {
            sections.push(ranking);
        }
        sections.extend([&overlays as &dyn Section, &means]);
        if !self.terms.runs.is_empty() {
            sections.push(&self.terms);
        }
        sections.extend([&sheet as &dyn Section, &self.quality, &provenance]);
        with(&sections)
    }

    /// The headings of its sections.
    pub fn titles(&self) -> Vec<String> {
        self.sections(|sections| sections.iter().map(|section| section.title().to_owned()).collect())
    }

    /// The page.
    pub fn page(&self) -> String {
        let (name, model) = self.subject();
        self.sections(|sections| page::page(&format!("{name}: {}", model.device.title), sections))
    }
}

/// What a diagnosis comes to: all that it says after its first sentence, which tells how far off the model was.
fn answer(diagnosis: &Value) -> Option<String> {
    let sentences = page::sentences(diagnosis);
    let answer = if sentences.len() > 1 { &sentences[1..] } else { &sentences[..] };
    (!answer.is_empty()).then(|| answer.join(" "))
}

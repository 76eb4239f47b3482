//! Which physical effect is missing, and where.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

use dynid_diagnose::{self as diagnosis, Diagnosis, Event, Finished, Options};
use dynid_identify::identify::ErrorSignal;
use dynid_logs::experiment::Experiment;
use dynid_user_model::Model;

use crate::{Error, check_device};

/// How to diagnose.
#[derive(Debug, Clone, Default)]
pub struct DiagnoseSettings {
    /// Only runs in which exactly these joints are free; `None` for all runs.
    pub free: Option<Vec<usize>>,
    /// Which error decides; `None` for the likelihood of the logs.
    pub error: Option<ErrorSignal>,
    /// How many effects are looked for, one after the other; `None` for as many as it pays.
    pub depth: Option<usize>,
    /// Searches that an earlier, stopped diagnosis of the same reported ([`Event::Searched`]): it goes on from them to the same answer.
    pub finished: Finished,
}

impl DiagnoseSettings {
    /// As the diagnosis takes them.
    pub fn options(&self) -> Options {
        Options { error: self.error, depth: self.depth }
    }
}

/// How far a diagnosis is.
#[derive(Debug)]
pub enum DiagnoseProgress<'a> {
    /// Something began or was done.
    Event(&'a Event<'a>),
    /// It works on; sent often, so that a stop is heard soon.
    Working,
}

/// Asks which effect of the library `model` lacks, at which joint, how sure that is and what else it could be: the model is
/// fitted by the prediction-error method, every effect at every place is asked without a fit what it would add to the likelihood of the
/// logs, and the most promising are fitted and judged by that of all runs, those that no fit saw included. `progress` hears of each step, from several threads, and may stop it.
///
/// # Errors
/// A model of another device; no such runs, none to fit to, or runs too short to tell anything; stopped by `progress`
/// ([`Error::interrupted_after`]).
///
/// ```
/// use std::ops::ControlFlow;
/// # let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/tour");
/// let experiment = dynid::Experiment::load(format!("{folder}/experiment.toml"))?;
/// let model = dynid::Model::load(format!("{folder}/believed.toml"))?;
/// let found = dynid::diagnose(&model, &experiment, &Default::default(), &|_| ControlFlow::Continue(()))?;
/// assert_eq!(found.verdict, dynid::Verdict::MissingEffect);
/// assert_eq!(found.ranking[0].candidate.to_string(), "`input_coupling` from joint 5 to joint 4");
/// # Ok::<(), dynid::Error>(())
/// ```
pub fn diagnose(
    model: &Model,
    experiment: &Experiment,
    settings: &DiagnoseSettings,
    progress: &(dyn Fn(DiagnoseProgress<'_>) -> ControlFlow<()> + Sync),
) -> Result<Diagnosis, Error> {
    check_device(model, experiment)?;
    let runs = experiment.runs_with_free(settings.free.as_deref())?;
    let stopped = AtomicBool::new(false);
    let hear = |what: DiagnoseProgress<'_>| {
        if progress(what).is_break() {
            stopped.store(true, Ordering::Relaxed);
        }
    };
    let tell = |event: &Event<'_>| hear(DiagnoseProgress::Event(event));
    let stop = || {
        hear(DiagnoseProgress::Working);
        stopped.load(Ordering::Relaxed)
    };
    let mut found = diagnosis::diagnose(model, &runs, &settings.options(), &settings.finished, &tell, &stop)?;
    if let Some(better) = &mut found.better {
        record(better, model, experiment);
    }
    Ok(found)
}

/// Writes into a model that was fitted on the way what it comes from, as a fit records it: the model that was handed in.
fn record(fitted: &mut Model, parent: &Model, experiment: &Experiment) {
    let Some(record) = &mut fitted.fit else { return };
    record.data_digest.clone_from(&experiment.digest);
    record.parent_digest = parent.digest();
    let names = record.std_error.keys().chain(&record.not_identifiable).chain(&record.at_bound);
    fitted.prior.extend(names.filter_map(|name| Some((name.clone(), parent.prior(name)?))));
}

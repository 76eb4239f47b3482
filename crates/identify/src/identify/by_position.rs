//! Fits of the position error, of all runs at once or along a method's sequence, reported like every other.

use dynid_model::Device;
use nalgebra::DMatrix;
use rayon::prelude::*;

use super::{
    Best, Correlation, ErrorSignal, FitResult, FitTask, FittedParameter, Progress, StartResult, State, StepSummary,
};
use crate::FitError;
use crate::{
    FitStatus, position, position::FitRun, position::Options, position::PositionFit, position::PositionFitError,
    position::RunError, sequence, sequence::Sequence, sequence::SequenceFit, sequence::Step, sequence::Weighting,
    starts,
};
use dynid_logs::{experiment::Role, experiment::Run};
use dynid_optimise::sqp::SearchControl;
use dynid_plan as plan;
use dynid_user_model::Model;

/// Fits `model` to the position error of those of `runs` that are for it, from every start.
///
/// # Errors
/// The device has no such method; a run that the method has no step for; as [`position::fit`].
pub(super) fn by_position(
    model: &Model,
    runs: &[&Run],
    how: &FitTask,
    from: State,
    watch: &mut dyn FnMut(&Progress, &State) -> SearchControl,
) -> Result<FitResult, FitError> {
    let mut notes = Vec::new();
    let mut configurations: &[usize] = &[];
    let mut weights: &[Vec<f64>] = &[];
    let sequence;
    if let Some(method) = how.method.as_deref() {
        sequence = plan::sequence(model, method)?;
        configurations = &sequence;
        check_configurations(model.device, (method, configurations), runs)?;
        notes.extend(passed_over(model.device, (method, configurations), runs));
        if how.weighting == Weighting::OfMethod {
            let known = model.device.methods.iter().find(|known| known.name == method);
            weights = known.map_or(&[], |known| &known.weights);
            if weights.is_empty() {
                notes.push(format!("method {method} has no weights of its own: every error counts by its noise"));
            }
        }
    }
    let used: Vec<&Run> = runs
        .iter()
        .copied()
        .filter(|run| configurations.is_empty() || configurations.contains(&run.configuration))
        .collect();
    let systems = if how.starts.count > 1 {
        fitted(&used).map(|run| FitRun::of_run(model, run)).collect::<Result<Vec<FitRun>, _>>()?
    } else {
        Vec::new()
    };
    let occurs = |name: &str| systems.iter().any(|run| run.occurs(name));
    let mut state = from;
    let mut failure = None;
    let count = how.starts.count.max(1);
    for number in state.tried.len()..=count {
        let start = if number < count {
            starts::draw(model, &occurs, how.starts.seed, number)
        } else {
            let Some(prior) = model.at_prior().filter(|_| how.starts.prior && is_poor(state.best.as_ref())) else {
                break;
            };
            prior
        };
        let sequence = Sequence { prior: model, start: &start, runs, configurations, weights };
        let resumed = std::mem::take(&mut state.sequence);
        let fit = sequence::fit(&sequence, &how.options, resumed, &mut |reported, carried| {
            state.sequence.clone_from(carried);
            let progress = Progress {
                iteration: reported.progress.iteration,
                cost: reported.progress.cost,
                step: Some(reported.progress.step),
                observer: reported.progress.observer,
                configuration: reported.configuration,
                start: number,
            };
            watch(&progress, &state)
        });
        state.sequence = sequence::State::default();
        match fit {
            Ok(fit) => keep(&mut state, number, fit),
            Err(error @ PositionFitError::Interrupted { .. }) => return Err(error.into()),
            Err(error) => {
                state.tried.push(StartResult { cost: None, ended: error.to_string(), iterations: 0 });
                failure.get_or_insert(error);
            }
        }
    }
    let Some(Best { start, mut joint, steps }) = state.best else {
        return Err(failure.unwrap_or(PositionFitError::NoRun).into());
    };
    if start == count {
        notes.push(
            "the search from the model's values came to no good end; that from the prior values is kept".to_owned(),
        );
    }
    joint.iterations = state.tried.iter().map(|tried| tried.iterations).sum();
    notes.extend(made_bodies(&steps, &joint));
    let budget = if configurations.is_empty() {
        Vec::new()
    } else {
        let sequence = Sequence { prior: model, start: model, runs, configurations, weights };
        sequence::budget(&sequence, &steps, &joint, &how.options)?
    };
    let cost_before = how.tell_start.then(|| cost_at(model, &used, &how.options)).transpose()?;
    let mut found = result(model, joint, cost_before);
    found.best_start = start;
    found.tried = if state.tried.len() > 1 { state.tried } else { Vec::new() };
    found.steps = steps.iter().map(|step| step_summary(model.device, step)).collect();
    found.notes = notes;
    found.budget = budget;
    Ok(found)
}

/// A run to fit to that the method has no step for is a mistake, not something to pass over.
fn check_configurations(
    device: &Device,
    (method, configurations): (&str, &[usize]),
    runs: &[&Run],
) -> Result<(), FitError> {
    let Some(run) = fitted(runs).find(|run| !configurations.contains(&run.configuration)) else { return Ok(()) };
    let own: Vec<String> =
        configurations.iter().map(|number| format!("{:?}", device.configurations[number - 1].free)).collect();
    let others: Vec<&str> = device
        .methods
        .iter()
        .filter(|other| other.sequence.contains(&run.configuration))
        .map(|other| other.name.as_str())
        .collect();
    let remedy = match others.as_slice() {
        [] => "give the run the role \"validate\", or leave it out".to_owned(),
        [other, ..] => format!("use --method {other} for it, give it the role \"validate\", or leave it out"),
    };
    let what =
        format!("method `{method}` has no step for its free joints {:?} (it frees {})", run.free, own.join(", "));
    Err(FitError::OtherConfiguration { run: run.file.clone(), what, remedy })
}

/// Steps of the method without a run to fit to.
fn passed_over(device: &Device, (method, configurations): (&str, &[usize]), runs: &[&Run]) -> Option<String> {
    let missing: Vec<String> = configurations
        .iter()
        .filter(|number| !fitted(runs).any(|run| run.configuration == **number))
        .map(|number| format!("{:?}", device.configurations[number - 1].free))
        .collect();
    let plural = if missing.len() == 1 { "a step" } else { "steps" };
    (!missing.is_empty()).then(|| {
        format!("{plural} of method {method} without a run to fit to, passed over: free {}", missing.join(", "))
    })
}

/// Links whose start no body has.
fn made_bodies(steps: &[Step], joint: &PositionFit) -> Vec<String> {
    let mut links: Vec<usize> =
        steps.iter().map(|step| &step.fit).chain([joint]).flat_map(|fit| fit.moved.iter().copied()).collect();
    links.sort_unstable();
    links.dedup();
    let reported = |link: usize| {
        format!("no body has the inertia that link {link} starts with; the fit started from that of a body near by")
    };
    links.into_iter().map(reported).collect()
}

/// Whether a search has lost its way, or may have: no minimum, or one far from the noise.
fn is_poor(best: Option<&Best>) -> bool {
    /// A joint's error over its noise beyond which a minimum is worth another search.
    const FAR: f64 = 2.0;
    let is_far = |run: &RunError| run.rmse.iter().zip(&run.noise).any(|(rmse, noise)| *rmse > FAR * noise);
    best.is_none_or(|best| !best.joint.status.may_update_model() || best.joint.runs.iter().any(is_far))
}

fn keep(state: &mut State, start: usize, fit: SequenceFit) {
    let SequenceFit { steps, mut joint, .. } = fit;
    let iterations = joint.iterations + steps.iter().map(|step| step.fit.iterations).sum::<usize>();
    state.tried.push(StartResult { cost: Some(joint.cost), ended: joint.status.as_str().to_owned(), iterations });
    // A minimum is better than what is none, however low; then the lower cost; then the earlier start.
    let rank = |status: FitStatus, cost: f64| (!status.may_update_model(), cost);
    let is_better = state.best.as_ref().is_none_or(|best| {
        rank(joint.status, joint.cost).partial_cmp(&rank(best.joint.status, best.joint.cost))
            == Some(std::cmp::Ordering::Less)
    });
    if is_better {
        joint.runs.iter_mut().for_each(|run| run.simulated.clear());
        state.best = Some(Best { start, joint, steps });
    }
}

pub(super) fn fitted<'a>(runs: &[&'a Run]) -> impl Iterator<Item = &'a Run> {
    runs.iter().copied().filter(|run| run.role == Role::Fit)
}

fn result(before: &Model, fit: PositionFit, cost_before: Option<f64>) -> FitResult {
    let model = fit.applied_to(before);
    let names: Vec<&str> = fit.parameters.iter().map(|own| own.name.as_str()).collect();
    let correlations = correlations(&names, &fit.covariance);
    let PositionFit { status, parameters, undetermined, iterations, runs, .. } = fit;
    let parameters = parameters
        .into_iter()
        .map(|estimate| FittedParameter {
            start: before.parameter(&estimate.name).map_or(f64::NAN, |parameter| parameter.value),
            name: estimate.name,
            value: estimate.value,
            std_error: estimate.std_error,
            identifiable: estimate.identifiable,
            held: estimate.at_bound,
        })
        .collect();
    FitResult {
        model,
        error: ErrorSignal::Position,
        status,
        iterations,
        cost_before,
        cost_after: cost(&runs),
        parameters,
        open: undetermined.into_iter().map(|direction| direction.parts).collect(),
        correlations,
        tried: Vec::new(),
        best_start: 0,
        steps: Vec::new(),
        budget: Vec::new(),
        notes: Vec::new(),
    }
}

/// The strongest correlations between parameters, from their covariance.
pub(super) fn correlations(names: &[&str], covariance: &DMatrix<f64>) -> Vec<Correlation> {
    /// Weaker ones are not worth telling, and no more than so many are.
    const WEAKEST: f64 = 0.5;
    const AT_MOST: usize = 20;
    let mut pairs = Vec::new();
    for row in 0..names.len() {
        for column in row + 1..names.len() {
            let size = (covariance[(row, row)] * covariance[(column, column)]).sqrt();
            let value = covariance[(row, column)] / size;
            if value.abs() >= WEAKEST {
                pairs.push((row, column, value));
            }
        }
    }
    pairs.sort_by(|a, b| b.2.abs().total_cmp(&a.2.abs()).then((a.0, a.1).cmp(&(b.0, b.1))));
    pairs.truncate(AT_MOST);
    let name = |index: usize| names[index].to_owned();
    pairs.into_iter().map(|(row, column, value)| Correlation { one: name(row), other: name(column), value }).collect()
}

fn step_summary(device: &Device, step: &Step) -> StepSummary {
    let free = device.configurations[step.configuration - 1].free.clone();
    let rmse = (0..free.len())
        .map(|slot| {
            let (sum, count) = step.fit.runs.iter().fold((0.0, 0.0), |(sum, count), run| {
                (sum + run.samples as f64 * run.rmse[slot].powi(2), count + run.samples as f64)
            });
            (sum / f64::max(count, 1.0)).sqrt()
        })
        .collect();
    let status = step.fit.status.as_str().to_owned();
    StepSummary { configuration: step.configuration, free, status, iterations: step.fit.iterations, rmse }
}

/// Cost of the runs that are fitted to; infinite where one cannot be simulated to its end, for then it is larger than
/// any number says.
pub(super) fn cost_at(model: &Model, runs: &[&Run], options: &Options) -> Result<f64, FitError> {
    let runs = fitted(runs).map(|run| FitRun::of_run(model, run)).collect::<Result<Vec<FitRun>, _>>()?;
    let errors: Option<Vec<RunError>> = runs.par_iter().map(|run| position::judge(run, options).ok()).collect();
    Ok(errors.map_or(f64::INFINITY, |errors| cost(&errors)))
}

/// Half the sum of squared position errors, each joint's over the noise of its log.
fn cost(runs: &[RunError]) -> f64 {
    let of_run = |run: &RunError| -> f64 {
        run.rmse.iter().zip(&run.noise).map(|(rmse, noise)| (rmse / noise).powi(2)).sum::<f64>() * run.samples as f64
    };
    0.5 * runs.iter().map(of_run).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{identify::FitResult, identify::identify};
    use dynid_dynamics::simulate::Steps;
    use dynid_logs::experiment::Experiment;
    use dynid_model::physical_consistency::check_body;

    /// A wrist's logs fitted from a handle that turns too heavily for its own shape.
    fn fitted_from(izz: f64) -> FitResult {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/wrist");
        let experiment = Experiment::read_with(&folder.join("experiment.toml"), dynid_model::devices());
        let experiment = experiment.expect("the wrist's");
        let runs: Vec<&Run> = experiment.runs.iter().take(1).collect();
        let mut model = Model::load(folder.join("believed.toml")).expect("the wrist's");
        model
            .set("link.7.Izz", dynid_model::Parameter { value: izz, lower: 0.0, upper: 1e-3, fixed: false })
            .expect("it");
        let options = Options { steps: Some(Steps::PerSample(10)), ..Options::default() };
        identify(&model, &experiment, &runs, ErrorSignal::Position, &options, &mut |_| ()).expect("a fit")
    }

    #[test]
    fn a_start_that_no_body_has_is_reported() {
        let reported = fitted_from(4e-4);
        assert_eq!(reported.notes.len(), 1, "{:?}", reported.notes);
        assert!(reported.notes[0].contains("link 7 starts with"), "{}", reported.notes[0]);
        assert_eq!(check_body(&reported.model.links[6].map(|parameter| parameter.value)), Ok(()));
        assert!(fitted_from(2e-5).notes.is_empty(), "a body's inertia is nothing to tell");
    }
}

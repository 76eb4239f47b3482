//! A change between runs, told from a missing effect: does every run by itself agree with the model, with other values?

use crate::missing::Logs;
use crate::{DiagnoseError, Moved};
use dynid_identify::FitError;
use dynid_logs::{experiment::Role, experiment::Run};
use dynid_user_model::Model;

/// Parameters that differ between runs which the model explains one by one, largest change first; none where a run is not
/// explained even by itself, or where there is but one.
pub(super) fn moved(work: &Logs<'_>, base: &Model) -> Result<Vec<Moved>, DiagnoseError> {
    /// Smaller changes are chance.
    const LEAST: f64 = 5.0;
    /// As many are reported.
    const AT_MOST: usize = 12;
    let runs: Vec<Run> =
        work.fit.iter().chain(&work.held_out).map(|run| Run { role: Role::Fit, ..run.clone() }).collect();
    if runs.len() < 2 {
        return Ok(Vec::new());
    }
    let mut fits = Vec::with_capacity(runs.len());
    for (index, run) in runs.iter().enumerate() {
        let alone = Logs { fit: vec![run.clone()], held_out: Vec::new(), ..work.clone() };
        let fitted = alone.base(base, &format!("run {} by itself", index + 1)).map_err(FitError::from)?;
        if !fitted.is_whole(&work.settings) {
            return Ok(Vec::new());
        }
        fits.push(fitted.fit);
    }
    let mut moved: Vec<Moved> = Vec::new();
    for parameter in base.names() {
        let known: Vec<(usize, f64, f64)> = fits
            .iter()
            .enumerate()
            .filter_map(|(index, fit)| {
                let own = fit.parameters.iter().find(|own| own.name == parameter && own.identifiable)?;
                Some((index, own.value, own.std_error.filter(|error| *error > 0.0)?))
            })
            .collect();
        if known.len() < 2 {
            continue;
        }
        // Each run against the mean of the others, weighed by what they know: two that agree show the third.
        let change = |index: &usize, value: f64, error: f64| {
            let others = known.iter().filter(|(other, ..)| other != index);
            let (weight, sum) = others.fold((0.0, 0.0), |(weight, sum), (_, value, error)| {
                (weight + error.powi(-2), sum + value * error.powi(-2))
            });
            (value - sum / weight) / (error * error + 1.0 / weight).sqrt()
        };
        let farthest = known
            .iter()
            .map(|(index, value, error)| (*index, change(index, *value, *error)))
            .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        if let Some((index, change_in_std_errors)) = farthest.filter(|(_, change)| change.abs() >= LEAST) {
            moved.push(Moved { parameter, run: runs[index].file.clone(), change_in_std_errors });
        }
    }
    moved.sort_by(|a, b| {
        b.change_in_std_errors
            .abs()
            .total_cmp(&a.change_in_std_errors.abs())
            .then_with(|| a.parameter.cmp(&b.parameter))
    });
    moved.truncate(AT_MOST);
    Ok(moved)
}

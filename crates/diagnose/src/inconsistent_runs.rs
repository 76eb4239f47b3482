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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{self, Oscillator};

    /// Three runs of one mass, the spring of one of which is stiffer: it is named, with how far it is from what the others say.
    #[test]
    fn the_run_whose_spring_was_changed_is_named() {
        let run = |stiffness: f64, cubic: f64, (seconds, number): (f64, u64)| {
            let sines = [(0.02, 1.0), (0.01, 3.7)];
            let mut run = Oscillator { stiffness, cubic }.run(&sines, seconds, (Role::Fit, number));
            run.file = number.to_string();
            run
        };
        let model = fixtures::model(1.0, "");
        let (one, two, three) = (run(1.1, 0.0, (12.0, 1)), run(1.3, 0.0, (6.0, 2)), run(1.1, 0.0, (4.0, 3)));
        let of = |fit: &[&Run], held_out: &[&Run]| {
            let clone = |runs: &[&Run]| runs.iter().map(|run| (*run).clone()).collect::<Vec<_>>();
            let work = Logs::new(&model, clone(fit), clone(held_out));
            moved(&work, &model).expect("fits")
        };
        let found = of(&[&one, &two], &[&three]);
        let spring = found.iter().find(|moved| moved.parameter == "joint.0.spring.Ks").expect("it moved");
        assert_eq!(spring.run, "2");
        let alone = |run: &Run| {
            let work = Logs::new(&model, vec![run.clone()], Vec::new());
            let fitted = work.base(&model, "alone").expect("a fit");
            let own = fitted.fit.parameters.into_iter().find(|own| own.name == "joint.0.spring.Ks").expect("Ks");
            (own.value, own.std_error.expect("it is fitted"))
        };
        let [(a, e), (b, f), (c, g)] = [&one, &two, &three].map(alone);
        let weight = e.powi(-2) + g.powi(-2);
        let others = (a * e.powi(-2) + c * g.powi(-2)) / weight;
        let expected = (b - others) / (f * f + weight.recip()).sqrt();
        assert!((spring.change_in_std_errors / expected - 1.0).abs() < 1e-6, "{spring:?} {expected}");
        let sizes: Vec<f64> = found.iter().map(|moved| moved.change_in_std_errors.abs()).collect();
        assert!(sizes.is_sorted_by(|a, b| a >= b) && sizes.iter().all(|size| *size >= 5.0), "{sizes:?}");

        assert_eq!(of(&[&one, &three], &[]), [], "they agree");
        assert_eq!(of(&[&two], &[]), [], "there is no other");
        assert_eq!(of(&[&one, &run(1.1, 400.0, (6.0, 4))], &[]), [], "one is not explained by itself");
    }
}

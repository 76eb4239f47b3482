//! A change between runs, told from a missing effect: does every run by itself agree with the model, with other values?

use crate::candidate::{candidates, joined_link};
use crate::missing::{Fitted, Logs};
use crate::score_test::Start;
use crate::{Candidate, DiagnoseError, Moved};
use dynid_identify::FitError;
use dynid_identify::prediction::PredictionFit;
use dynid_logs::{experiment::Role, experiment::Run};
use dynid_model::Parameter;
use dynid_user_model::Model;

/// Changes of less standard errors are chance.
const LEAST: f64 = 5.0;
/// As many are reported.
const AT_MOST: usize = 12;

/// Parameters that differ between runs which the model explains one by one, largest change first: its own or, where these do not tell and
/// the others do not explain one run, those of a body that is carried there. None where there is but one run, or more than one that is not
/// explained by itself.
pub(super) fn moved(work: &Logs<'_>, base: &Model) -> Result<Vec<Moved>, DiagnoseError> {
    // A run may have been parted.
    let mut runs: Vec<Vec<Run>> = Vec::new();
    for part in work.fit.iter().chain(&work.held_out).map(|run| Run { role: Role::Fit, ..run.clone() }) {
        match runs.iter_mut().find(|parts| parts[0].file == part.file) {
            Some(parts) => parts.push(part),
            None => runs.push(vec![part]),
        }
    }
    if runs.len() < 2 {
        return Ok(Vec::new());
    }
    let (mut fits, mut unexplained) = (Vec::with_capacity(runs.len()), None);
    for (index, parts) in runs.iter().enumerate() {
        let alone = Logs { fit: parts.clone(), held_out: Vec::new(), ..work.clone() };
        let fitted = alone.base(base, &format!("run {} by itself", index + 1)).map_err(FitError::from)?;
        if fitted.is_whole(&work.settings) {
            fits.push(fitted.fit);
        } else if unexplained.replace(index).is_some() {
            return Ok(Vec::new());
        }
    }
    let mut moved = if unexplained.is_none() { moved_between(base, &runs, &fits) } else { Vec::new() };
    // Values that one run does not determine by itself may differ all the same.
    for index in 0..runs.len() {
        if moved.is_empty() && unexplained.is_none_or(|unexplained| unexplained == index) && !(work.stop)() {
            moved = carried(work, base, &runs, index);
        }
    }
    moved.sort_by(|a, b| {
        let sizes = [b, a].map(|moved| moved.change_in_std_errors.abs());
        sizes[0].total_cmp(&sizes[1]).then_with(|| a.parameter.cmp(&b.parameter))
    });
    moved.truncate(AT_MOST);
    Ok(moved)
}

/// Parameters of `base` by which fits to one run each differ.
fn moved_between(base: &Model, runs: &[Vec<Run>], fits: &[PredictionFit]) -> Vec<Moved> {
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
            moved.push(Moved { parameter, run: runs[index][0].file.clone(), change_in_std_errors });
        }
    }
    moved
}

/// Parameters of a body with which one run is explained as `base` explains the others together; none if it explains this one with them.
fn carried(work: &Logs<'_>, base: &Model, runs: &[Vec<Run>], index: usize) -> Vec<Moved> {
    let own = &runs[index];
    let others =
        runs.iter().enumerate().filter(|(other, _)| *other != index).flat_map(|(_, parts)| parts.clone()).collect();
    let others = Logs { fit: others, held_out: own.clone(), ..work.clone() };
    let known = others.base(base, &format!("all but run {}", index + 1)).ok();
    let differs = |known: &Fitted| known.is_whole(&work.settings) && !others.holds_elsewhere(known);
    let Some(known) = known.filter(differs) else { return Vec::new() };
    let mut known = known.model;
    for (name, parameter) in known.parameters() {
        // The names are the model's own.
        let _known = known.set(&name, Parameter { fixed: true, ..parameter });
    }
    let alone = Logs { given: &known, fit: own.clone(), held_out: Vec::new(), ..work.clone() };
    let is_body = |body: &Candidate| {
        let place = body.law().zip(body.joint);
        place.is_some_and(|(law, joint)| joined_link(&known, law, joint).is_some())
    };
    let mut best: Option<Fitted> = None;
    for body in candidates(&known, &own.iter().collect::<Vec<_>>()).into_iter().filter(is_body) {
        let starts = alone.promising(&body).unwrap_or_default();
        let Some(start) = starts.first().map(Start::stepped) else { continue };
        let Ok(fitted) = alone.base(&start, &format!("run {} with {body}", index + 1)) else { continue };
        // No run is held out.
        let score = |fitted: &Fitted| fitted.fit.log_likelihood - fitted.price();
        if fitted.is_whole(&work.settings) && best.as_ref().is_none_or(|best| score(best) < score(&fitted)) {
            best = Some(fitted);
        }
    }
    let parameters = best.into_iter().flat_map(|best| best.fit.parameters).filter(|own| own.identifiable);
    let moved = parameters.filter_map(|parameter| {
        let change_in_std_errors = parameter.value / parameter.std_error.filter(|error| *error > 0.0)?;
        let run = own[0].file.clone();
        Some(Moved { parameter: parameter.name, run, change_in_std_errors })
    });
    moved.filter(|moved| moved.change_in_std_errors.abs() >= LEAST).collect()
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

    /// Three runs of one mass, which is known, and in one of them more of it: the body that is carried there is named.
    #[test]
    fn a_body_that_is_carried_in_one_run_is_found() {
        let plant = Oscillator { stiffness: 1.1, cubic: 0.0 };
        let sines = [(0.02, 1.0), (0.01, 3.7)];
        let run = |load: f64, number: u64| {
            let run = plant.run_carrying(load, &sines, 6.0, (Role::Fit, number));
            Run { file: number.to_string(), ..run }
        };
        let mut model = fixtures::model(1.0, "");
        for (name, parameter) in model.parameters() {
            let fixed = name.starts_with("link.");
            model.set(&name, Parameter { fixed, ..parameter }).expect("its own");
        }
        let of = |loads: [f64; 3]| {
            let [one, two, three] = [1, 2, 3].map(|number| run(loads[number as usize - 1], number));
            moved(&Logs::new(&model, vec![one, two], vec![three]), &model).expect("fits")
        };
        for (loads, carrying) in [([0.0, 2e-4, 0.0], "2"), ([0.0, 0.0, 2e-4], "3")] {
            let found = of(loads);
            assert_eq!(found[0].parameter, "joint.0.payload.m");
            assert!(found.iter().all(|moved| moved.run == carrying), "{found:?}");
        }
        assert_eq!(of([0.0; 3]), []);
        assert_eq!(of([2e-4, 3e-4, 0.0]), [], "two are not explained");
    }
}

//! A formula for what no effect of the library explains: sparse regression of the errors of one-step predictions on how these answer
//! to torques that are products of the signals at hand.
//!
//! The model's own unknowns are taken out of the errors and of every candidate column. A few terms are chosen by forward selection
//! with exchanges; what counts is what is chosen again from random halves of the data (stability selection, Meinshausen & Buehlmann
//! 2010), and in the end the runs that were not used decide. Where they do not agree, nothing is written.
//!
//! At most three terms are chosen, must be chosen again from 80 % of random halves (or others that say much the same), and must take
//! away of the held-out runs 30 % of the squares of what they say there, which must be more than chance. The drive's own torque alone is
//! no candidate and is taken out of every candidate that has it as a factor: it would explain any error by undoing the drive. As a model
//! that is held to its logs firmly shows other things than one that runs nearly free, terms are asked at a few rates, like effects.

mod along;
mod file;
mod select;
mod term;

use std::collections::BTreeSet;
use std::sync::OnceLock;

use dynid_model::unit::Unit;
use rayon::prelude::*;
use serde::Serialize;

use self::{
    along::Along,
    file::effect_file,
    select::{Choice, Normal, Reduced, Rules},
    term::{Term, dictionary},
};
use super::statement::{ActsOn, Statement};
use crate::missing::{Fitted, Logs};
use crate::score_test::RATES;
use crate::{runs, settings::Settings};
use dynid_identify::FitError;
use dynid_logs::experiment::Run;
use dynid_random::Random;
use dynid_user_model::Model;

/// A formula that explains a part of the errors of predictions.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Discovered {
    /// The device's joint index.
    pub joint: usize,
    /// The other joint whose signals it needs, where it is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<usize>,
    /// What it adds to.
    pub acts_on: ActsOn,
    /// In words and signs, e.g. `0.0078 * sin(6*q5) * dq5`.
    pub formula: String,
    /// Its terms, most telling first.
    pub terms: Vec<DiscoveredTerm>,
    /// Share of the squared errors of one-step predictions above the noise that it explains on the runs fitted to, the model's own
    /// unknowns being free with and without it.
    pub explained_fit: f64,
    /// The same on the held-out runs, with the values of the runs fitted to.
    pub explained_validate: f64,
    /// The effect file that says it; `None` where an effect cannot.
    pub effect_file: Option<String>,
    /// Formulas for other joints, each found as if nothing were missing elsewhere.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub elsewhere: Vec<Discovered>,
}

/// One term of a formula.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DiscoveredTerm {
    /// A product of signals, e.g. `sin(6*q5) * dq5`.
    pub term: String,
    /// Torque that resists, or part of the command, per unit of the product.
    pub coefficient: f64,
    /// One standard deviation.
    pub std_error: f64,
    /// Of the coefficient.
    pub unit: String,
    /// Share of the random halves of the data that choose it, or what those data do not tell from it.
    pub chosen_in: f64,
}

/// Random halves of the data.
const HALVES: usize = 30;
/// A term must be chosen in this share of them.
const STABLE: f64 = 0.8;
/// Length of the pieces that halves are made of (s), and into how many pieces the runs are cut at least.
const PIECE_S: f64 = 2.0;
const PIECES: f64 = 16.0;
/// At most so many terms.
const TERMS: usize = 3;
/// The held-out runs must keep this share of what a formula says of them: where the coefficients were right, they would keep all.
const WORTH: f64 = 0.3;
/// Candidates that are kept for the choice, per step of a first pass.
const KEPT: usize = 40;
/// Errors that the first pass looks at.
const GLANCE: usize = 8_000;

/// Looks for a formula for what `model`, fitted to `runs`, leaves of them; `None` where none is worth writing.
///
/// # Errors
/// No run to fit to; a model that makes no equations for a run or cannot be simulated at any rate.
pub fn discover(model: &Model, runs: &[&Run]) -> Result<Option<Discovered>, FitError> {
    let seen = model.looked_at(&runs::split(runs), Settings::default().search.samples);
    let (fit, held_out) = runs::by_role(&seen);
    let work = Logs::new(model, fit, held_out);
    let base = work.first_base("base")?;
    Ok(best(&work, &base))
}

/// A formula for what `base` leaves of its logs.
pub(super) fn best(work: &Logs<'_>, base: &Fitted) -> Option<Discovered> {
    let views = Views::new(work, base);
    let joints = base.fit.joints.iter().map(|own| own.joint);
    let mut found: Vec<Formula> = joints.filter_map(|joint| Search::new(&views, joint)?.best(TERMS)).collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut found = found.into_iter().map(|found| found.said);
    let mut best = found.next()?;
    best.elsewhere = found.collect();
    Some(best)
}

/// By how much a formula of one term at `joint` would raise the log likelihood of all runs, less its price; `None` where there is none.
pub(super) fn promise(work: &Logs<'_>, base: &Fitted, joint: usize) -> Option<f64> {
    Some(Search::new(&Views::new(work, base), joint)?.best(1)?.score - base.score())
}

/// What a diagnosis says where a formula was found.
pub(super) fn statement(found: &Discovered) -> Statement {
    Statement::FormulaExplains {
        joint: found.joint,
        acts_on: found.acts_on,
        formula: found.formula.clone(),
        percent: 100.0 * found.explained_validate,
    }
}

/// A formula and its log likelihood of all runs, less the price of its terms.
struct Formula {
    score: f64,
    said: Discovered,
}

/// The logs along the predictions of a model: at each of the rates their beginnings, and, once a joint's search asks for it, all that
/// was fitted to and all that was held out.
struct Views<'a> {
    work: &'a Logs<'a>,
    base: &'a Fitted,
    beginnings: Vec<Option<Along>>,
    whole: Vec<OnceLock<Option<(Along, Along)>>>,
}

impl<'a> Views<'a> {
    fn new(work: &'a Logs<'a>, base: &'a Fitted) -> Self {
        let beginnings = work.beginnings_of(GLANCE);
        let at = |rate: &f64| Along::fitted(work, base, &beginnings, *rate);
        let whole = RATES.iter().map(|_| OnceLock::new()).collect();
        Self { work, base, beginnings: RATES.par_iter().map(at).collect(), whole }
    }

    /// The runs fitted to and those held out, at one of the rates.
    fn whole(&self, rate: usize) -> Option<&(Along, Along)> {
        let Self { work, base, .. } = self;
        let new = || {
            let fit = Along::fitted(work, base, &work.fit, RATES[rate])?;
            let held_out = fit.held_out(work, base, RATES[rate])?;
            Some((fit, held_out))
        };
        self.whole[rate].get_or_init(new).as_ref()
    }
}

/// The search at one joint, at the rates where one term says most.
struct Search<'a> {
    joint: usize,
    base: &'a Fitted,
    fit: &'a Along,
    held_out: &'a Along,
    terms: Vec<Term>,
    /// Part of the drive's own torque that was taken out of each term.
    shares: Vec<f64>,
    /// How many terms were asked, and how often one of them may be chance.
    asked: usize,
    chance: f64,
}

impl<'a> Search<'a> {
    fn new(views: &'a Views<'_>, joint: usize) -> Option<Self> {
        let Views { work, base, .. } = views;
        let free: BTreeSet<usize> = work.fit.iter().flat_map(|run| run.free.iter().copied()).collect();
        let free: Vec<usize> = free.into_iter().collect();
        let kinds: Vec<_> = base.model.device.joints.iter().map(|joint| joint.kind).collect();
        let all = dictionary(joint, &free, &kinds);
        let asked = views.beginnings.par_iter().enumerate().filter_map(|(rate, along)| {
            let along = along.as_ref()?;
            let shares = along.shares(joint, &all);
            let (kept, log_likelihood) = along.telling(joint, &all, &shares)?;
            Some((log_likelihood, rate, kept, shares))
        });
        let asked: Vec<_> = asked.collect();
        let (_, rate, kept, shares) = asked.into_iter().max_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))?;
        let (fit, held_out) = views.whole(rate)?;
        Some(Self {
            joint,
            base,
            fit,
            held_out,
            terms: kept.iter().map(|index| all[*index].clone()).collect(),
            shares: kept.iter().map(|index| shares[*index]).collect(),
            asked: all.len(),
            chance: work.settings.chance,
        })
    }

    fn choose(&self, reduced: &Reduced, independent: f64, most: usize) -> Choice {
        let complexity: Vec<f64> = self.terms.iter().map(Term::complexity).collect();
        let may_join = |chosen: &[usize]| {
            may_join(self.joint, &chosen.iter().map(|index| &self.terms[*index]).collect::<Vec<_>>())
        };
        reduced.select(&Rules { independent, complexity: &complexity, may_join: &may_join, most })
    }

    /// The formula of at most so many terms; `None` where there is nothing worth writing.
    fn best(&self, most: usize) -> Option<Formula> {
        let answers = self.fit.answers(self.joint, &self.terms, &self.shares);
        let pieces = self.fit.pieces(&answers);
        let whole = sum(&pieces)?;
        let reduced = whole.reduced(&self.fit.prior())?;
        // What the held-out runs do not keep of a long one they may keep of a shorter one.
        (1..=most).rev().find_map(|most| self.formula(&pieces, &whole, &reduced, most))
    }

    fn formula(&self, pieces: &[Normal], whole: &Normal, reduced: &Reduced, most: usize) -> Option<Formula> {
        let (prior, samples) = (self.fit.prior(), self.fit.samples());
        let choice = self.choose(reduced, samples, most);
        let shares = self.stability(pieces, reduced, &choice.chosen, most);
        let chosen: Vec<(usize, f64)> =
            choice.chosen.iter().copied().zip(shares).filter(|(_, share)| *share >= STABLE).collect();
        let indices: Vec<usize> = chosen.iter().map(|(index, _)| *index).collect();
        if indices.is_empty() {
            return None;
        }
        let (coefficients, inverse, left) = reduced.solve(&indices)?;
        let without = whole.own_steps(&prior, &[], &[])?;
        let with = whole.own_steps(&prior, &indices, &coefficients)?;
        let terms: Vec<(Term, f64)> =
            indices.iter().map(|&index| self.terms[index].clone()).zip(coefficients.iter().copied()).collect();
        let (without, with) = (self.fit.steps(&without), self.fit.steps(&with));
        let judged_by = |along: &Along| {
            let (terms, shares): (Vec<Term>, Vec<f64>) =
                indices.iter().map(|&index| (self.terms[index].clone(), self.shares[index])).unzip();
            along.left(&along.answers(self.joint, &terms, &shares), &coefficients, (&without, &with))
        };
        let (fitted, judged) = (judged_by(self.fit), judged_by(self.held_out));
        // Squares in units of what is left of the runs fitted to.
        let unit = left / samples;
        let kept: f64 = judged.iter().map(|run| run.before - run.after).sum();
        let said: f64 = judged.iter().map(|run| run.said).sum();
        // What the formula itself takes away, and not other values of the parameters beside it.
        let own: f64 = judged.iter().map(|run| run.parameters - run.after).sum();
        let after: f64 = judged.iter().map(|run| run.after).sum();
        let explained = explained(&judged);
        // Of so many terms the best gains less by chance.
        let unit_there = unit.max(after / self.held_out.samples());
        let is_no_chance = 0.5 * kept / unit_there >= (self.asked as f64 / self.chance).ln();
        let is_kept = is_no_chance && own >= WORTH * said;
        if !(is_kept && judged.iter().all(Left::is_good)) {
            return None;
        }
        let deviation = unit.sqrt();
        let mut reported: Vec<DiscoveredTerm> = Vec::new();
        for (place, ((own, coefficient), (_, share))) in terms.iter().zip(&chosen).enumerate() {
            reported.push(DiscoveredTerm {
                term: own.label(self.joint),
                coefficient: *coefficient,
                std_error: deviation * inverse[(place, place)].max(0.0).sqrt(),
                unit: self.unit(own),
                chosen_in: *share,
            });
        }
        let formula = formula(&reported);
        let others: BTreeSet<usize> = terms.iter().flat_map(|(term, _)| term.others(self.joint)).collect();
        let price = 0.5 * terms.len() as f64 * samples.ln();
        let score =
            self.fit.log_likelihood(left, unit) + self.held_out.log_likelihood(after, unit) - self.base.price() - price;
        Some(Formula {
            score,
            said: Discovered {
                joint: self.joint,
                from: if others.len() == 1 { others.first().copied() } else { None },
                effect_file: effect_file(self.joint, &terms, &formula),
                elsewhere: Vec::new(),
                acts_on: if terms.iter().all(|(term, _)| term.is_command()) { ActsOn::Command } else { ActsOn::Motion },
                formula,
                terms: reported,
                explained_fit: self::explained(&fitted),
                explained_validate: explained,
            },
        })
    }

    fn unit(&self, term: &Term) -> String {
        let unit = term.coefficient_unit();
        let joint = self.base.model.device.joints.get(self.joint);
        let command = joint.map_or("command", |joint| joint.command_unit.as_str());
        match (Unit::parse(&unit), Unit::parse(command), joint) {
            (Ok(unit), Ok(command), Some(joint)) => unit.at(joint.kind).with_command(&command).to_string(),
            _ => unit,
        }
    }

    /// In which share of random halves each of `chosen` is chosen, or what stands for it.
    fn stability(&self, pieces: &[Normal], whole: &Reduced, chosen: &[usize], most: usize) -> Vec<f64> {
        let mut random = Random::new(0x0D15_C0FE);
        let halves: Vec<Vec<usize>> = (0..HALVES)
            .map(|_| {
                let mut order: Vec<(f64, usize)> = (0..pieces.len()).map(|index| (random.unit(), index)).collect();
                order.sort_by(|a, b| a.0.total_cmp(&b.0));
                let mut half: Vec<usize> =
                    order.iter().take(pieces.len().div_ceil(2)).map(|(_, index)| *index).collect();
                half.sort_unstable();
                half
            })
            .collect();
        let prior = self.fit.prior();
        let choice = |half: &Vec<usize>| -> Option<Vec<usize>> {
            let half = sum(half.iter().map(|&piece| &pieces[piece]))?;
            Some(self.choose(&half.reduced(&prior)?, 0.5 * self.fit.samples(), most).chosen)
        };
        let choices: Vec<Vec<usize>> = halves.par_iter().map(|half| choice(half).unwrap_or_default()).collect();
        let share = |index: &usize| {
            choices.iter().filter(|choice| whole.stands_for(choice, *index, chosen)).count() as f64 / HALVES as f64
        };
        chosen.iter().map(share).collect()
    }
}

/// Several pieces together.
fn sum<'n>(pieces: impl IntoIterator<Item = &'n Normal>) -> Option<Normal> {
    let mut pieces = pieces.into_iter();
    let mut sum = pieces.next()?.clone();
    pieces.for_each(|piece| sum.add(piece));
    Some(sum)
}

/// Squared errors of one run, weighed.
#[derive(Debug, Default)]
struct Left {
    before: f64,
    after: f64,
    /// With the parameters that stand beside the formula in the runs fitted to, but without it; and of what it says.
    parameters: f64,
    said: f64,
    /// Of the noise of the logs.
    noise: f64,
}

impl Left {
    fn above_noise(&self) -> f64 {
        (self.before - self.noise).max(0.0)
    }

    /// Whether a run in which the formula has something to say agrees with it.
    fn is_good(&self) -> bool {
        self.said < WORTH * self.above_noise() || self.after <= self.before
    }
}

/// What share of what is above the noise is explained: all, where nothing is left above it.
fn explained(runs: &[Left]) -> f64 {
    let gone: f64 = runs.iter().map(|run| run.before - run.after).sum();
    let above: f64 = runs.iter().map(Left::above_noise).sum();
    gone / above.max(gone).max(f64::MIN_POSITIVE)
}

/// Whether terms may stand in one formula for what acts at a joint: so that one effect can say it, or one of them is of all the other
/// joints that any is of.
fn may_join(joint: usize, terms: &[&Term]) -> bool {
    let commands = terms.iter().filter(|term| term.is_command()).count();
    if commands > 0 && commands < terms.len() {
        return false;
    }
    let others: Vec<BTreeSet<usize>> = terms.iter().map(|term| term.others(joint)).collect();
    let all: BTreeSet<usize> = others.iter().flatten().copied().collect();
    all.len() <= 1 || others.iter().any(|others| others.len() == all.len())
}

/// `0.0078 * sin(6*q5) * dq5 - 0.2 * t`
fn formula(terms: &[DiscoveredTerm]) -> String {
    let mut text = String::new();
    for term in terms {
        let sign = match (text.is_empty(), term.coefficient < 0.0) {
            (true, true) => "-",
            (true, false) => "",
            (false, true) => " - ",
            (false, false) => " + ",
        };
        text.push_str(&format!("{sign}{} * {}", digits(term.coefficient.abs()), term.term));
    }
    text
}

/// Four digits, in ASCII.
fn digits(value: f64) -> String {
    let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    if (1e-4..1e5).contains(&rounded) || rounded == 0.0 { format!("{rounded}") } else { format!("{rounded:e}") }
}

#[cfg(test)]
mod tests {
    use dynid_logs::experiment::Role;

    use super::*;
    use crate::fixtures::{self, Oscillator};

    /// A spring that stiffens, of which the model knows nothing: a formula of one term says it, with its coefficient and how sure that is,
    /// and explains the runs held out.
    #[test]
    fn a_spring_that_stiffens_is_a_formula() {
        const K3: f64 = 400.0;
        let plant = Oscillator { stiffness: 1.1, cubic: K3 };
        let fit = plant.run(&[(0.02, 1.0), (0.01, 3.7)], 12.0, (Role::Fit, 5));
        let held_out = plant.run(&[(0.025, 1.3)], 8.0, (Role::Validate, 6));
        let model = fixtures::model(1.0, "");
        let found = discover(&model, &[&fit, &held_out]).expect("a search").expect("a formula");
        assert_eq!((found.joint, found.from, found.acts_on), (0, None, ActsOn::Motion));
        let [term] = found.terms.as_slice() else { panic!("{:?}", found.terms) };
        assert_eq!((&*term.term, &*term.unit), ("q0 * q0 * q0", "N/m^3"));
        // To first order, along what the model without it predicts.
        assert!((term.coefficient / K3 - 1.0).abs() < 0.1 && term.std_error < 0.02 * K3, "{term:?}");
        assert_eq!(term.chosen_in, 1.0);
        assert!(found.explained_fit > 0.95 && found.explained_validate > 0.95, "{found:?}");
        assert!(found.elsewhere.is_empty(), "there is no other joint");

        // What one term promises to first order, at rates that stay, is most of what a fit with the law comes to.
        let work = Logs::new(&model, vec![fit], vec![held_out]);
        let base = work.base(&model, "base").expect("a fit");
        let promised = promise(&work, &base, 0).expect("a formula");
        let mut with = base.model.clone();
        with.add_effect("spring_cubic", Some(0), None).expect("it may be there");
        let fitted = work.base(&with, "with").expect("a fit");
        let gain = fitted.score() - base.score();
        assert!(promised > 0.5 * gain && promised < 1.1 * gain, "{promised} of {gain}");
    }

    /// One that hardly stiffens has its formula, too, though the run held out has much less of it than those fitted to; to first order it is
    /// worth what a fit with the law comes to.
    #[test]
    fn a_formula_must_hold_elsewhere_as_far_as_it_says_something_there() {
        let sines = [(0.02, 1.0), (0.01, 3.7)];
        let of = |cubic: f64| Oscillator { stiffness: 1.1, cubic };
        // Not there, or the other way round: the stiffness that stands beside it is nearer all the same.
        for elsewhere in [0.0, -60.0] {
            let fit = of(60.0).run(&sines, 12.0, (Role::Fit, 5));
            let held_out = of(elsewhere).run(&[(0.025, 1.3)], 8.0, (Role::Validate, 6));
            let found = discover(&fixtures::model(1.0, ""), &[&fit, &held_out]).expect("a search");
            assert!(found.is_none(), "{found:?}");
        }
        for cubic in [15.0, 30.0, 60.0] {
            let plant = of(cubic);
            let fit = plant.run(&sines, 12.0, (Role::Fit, 5));
            let held_out = plant.run(&[(0.025, 1.3)], 8.0, (Role::Validate, 6));
            let model = fixtures::model(1.0, "");
            let work = Logs::new(&model, vec![fit], vec![held_out]);
            let base = work.base(&model, "base").expect("a fit");
            let found = best(&work, &base).expect("a formula");
            let [term] = found.terms.as_slice() else { panic!("{:?}", found.terms) };
            assert_eq!(term.term, "q0 * q0 * q0");
            assert!((term.coefficient / cubic - 1.0).abs() < 0.05, "{term:?}");
            assert!(found.explained_validate > 0.9, "{found:?}");
            let promised = promise(&work, &base, 0).expect("a formula");
            let mut with = base.model.clone();
            with.add_effect("spring_cubic", Some(0), None).expect("it may be there");
            let fitted = work.base(&with, "with").expect("a fit");
            let gain = fitted.score() - base.score();
            assert!(promised > 0.9 * gain && promised < 1.01 * gain, "{promised} of {gain}");
        }
    }

    /// Where the model has all that is there, no formula is worth writing.
    #[test]
    fn noise_is_no_formula() {
        let plant = Oscillator { stiffness: 1.1, cubic: 0.0 };
        let fit = plant.run(&[(0.02, 1.0), (0.01, 3.7)], 12.0, (Role::Fit, 5));
        let held_out = plant.run(&[(0.025, 1.3)], 8.0, (Role::Validate, 6));
        let found = discover(&fixtures::model(1.0, ""), &[&fit, &held_out]).expect("a search");
        assert!(found.is_none(), "{found:?}");
    }

    #[test]
    fn terms_join_that_one_effect_can_say() {
        use super::term::Factor::{Command, Position, Speed};
        let [own, second, third] = [0, 1, 2].map(|joint| Term::new(vec![Position(joint)]));
        let [of_second, of_both] = [1, 2].map(|joint| Term::new(vec![Speed(1), Position(joint)]));
        let command = Term::new(vec![Command(1)]);
        let joined = |terms: &[&Term]| may_join(0, terms);
        assert!(joined(&[&own]) && joined(&[&own, &second, &of_second]) && joined(&[&command]));
        assert!(!joined(&[&own, &command]) && !joined(&[&second, &command]), "one acts on the motor, one resists");
        assert!(!joined(&[&second, &third]) && !joined(&[&own, &second, &third]), "two other joints, and no product");
        assert!(joined(&[&second, &of_both]) && joined(&[&of_both, &third, &own]));
    }

    #[test]
    fn what_is_explained_is_a_share_of_what_is_above_the_noise() {
        let left = |before: f64, after: f64, said: f64| Left { before, after, said, parameters: before, noise: 10.0 };
        assert_eq!(explained(&[left(110.0, 60.0, 0.0), left(30.0, 20.0, 0.0)]), 0.5);
        assert_eq!(explained(&[left(8.0, 4.0, 0.0)]), 1.0, "there was nothing above it");
        assert_eq!(explained(&[]), 0.0);
        // A run in which the formula says little may become a little worse.
        assert!(left(110.0, 111.0, 29.0).is_good() && !left(110.0, 111.0, 31.0).is_good());
        assert!(left(110.0, 109.0, 500.0).is_good());
    }

    #[test]
    fn a_formula_is_written_with_four_digits_and_the_signs_of_its_terms() {
        let term = |coefficient: f64, term: &str| DiscoveredTerm {
            term: term.to_owned(),
            coefficient,
            std_error: 0.0,
            unit: String::new(),
            chosen_in: 1.0,
        };
        assert_eq!(formula(&[term(0.007_812_34, "dq5"), term(-0.2, "t")]), "0.007812 * dq5 - 0.2 * t");
        assert_eq!(formula(&[term(-123_456.0, "q0"), term(2e-9, "q1")]), "-1.235e5 * q0 + 2e-9 * q1");
        assert_eq!([0.0, 99_999.0, 1e-4].map(digits), ["0", "1e5", "0.0001"]);
    }
}

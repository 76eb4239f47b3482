//! One queue of fits: an arm is a candidate at its place with values to start from. All get a few iterations, then the better half goes on
//! (successive halving, Jamieson and Talwalkar 2016); fits go on from where they stopped.

use rayon::prelude::*;

use dynid_identify::SearchControl;
use dynid_identify::prediction::{PredictionProblem, Search, State};
use dynid_user_model::Model;

use crate::candidate::Candidate;
use crate::settings::Settings;

/// A fit that may be worth going on with.
pub struct Arm {
    /// What is added to the model; `None` for the model itself.
    pub candidate: Option<Candidate>,
    /// The start.
    pub model: Model,
    /// For what is kept of it.
    pub key: String,
    /// What is fitted.
    pub problem: PredictionProblem,
    /// What its unknowns cost, in log likelihood.
    pub price: f64,
    /// How far it is.
    pub state: Option<State>,
    /// What it had reached before the last round.
    pub before: f64,
}

impl Arm {
    /// What it has reached, with the price of its unknowns: lower is better; infinite where it cannot be simulated.
    pub fn cost(&self) -> f64 {
        self.state.as_ref().and_then(|state| state.cost).map_or(f64::INFINITY, |cost| cost + self.price)
    }

    fn is_done(&self) -> bool {
        self.state.as_ref().is_none_or(|state| state.is_done)
    }
}

/// Runs the arms; those that reach most come first. `recall` knows states of an earlier, stopped diagnosis; `keep` hears of new ones.
pub fn race(
    mut arms: Vec<Arm>,
    settings: &Settings,
    recall: &(dyn Fn(&str) -> Option<State> + Sync),
    keep: &(dyn Fn(&str, &State) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Vec<Arm> {
    let (mut steps, most) = settings.linearisations;
    for round in 0.. {
        arms.par_iter_mut().for_each(|arm| {
            arm.before = arm.cost();
            if (round > 0 && arm.is_done()) || stop() {
                return;
            }
            let key = format!("{}, round {round}", arm.key);
            if let Some(state) = recall(&key) {
                arm.state = Some(state);
                return;
            }
            let Ok(mut search) = Search::new(&arm.problem, arm.state.take()) else { return };
            let iterations = settings.of_round(steps, &search);
            search.advance(&settings.search, iterations, &mut |_| {
                if stop() { SearchControl::Stop } else { SearchControl::Continue }
            });
            if !stop() {
                keep(&key, search.state());
            }
            arm.state = Some(search.state().clone());
        });
        arms.sort_by(|one, other| one.cost().total_cmp(&other.cost()).then_with(|| one.key.cmp(&other.key)));
        let is_over = arms.iter().take(settings.last).all(|arm| arm.is_done() || arm.cost().is_infinite());
        if is_over || stop() || steps > most {
            break;
        }
        arms.truncate((arms.len() / 2).max(settings.last));
        // What falls so slowly that it would not come to the best within as many rounds is no rival.
        let best = arms.first().map_or(f64::INFINITY, Arm::cost);
        let may_come = |arm: &Arm| arm.cost() - best <= settings.rounds * (arm.before - arm.cost()).max(0.0);
        arms.retain(|arm| round == 0 || arm.is_done() || may_come(arm));
        steps *= 2;
    }
    arms
}

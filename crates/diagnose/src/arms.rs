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

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Mutex;

    use dynid_logs::experiment::Role;

    use super::*;
    use crate::fixtures::{self, Oscillator, candidate};

    /// One law that is there and five that are not, each at its guess: half of them go on, and the one comes first.
    #[test]
    fn the_better_half_goes_on_and_the_best_comes_first() {
        let run = Oscillator { stiffness: 1.1, cubic: 400.0 }.run(&[(0.02, 1.0), (0.01, 3.7)], 6.0, (Role::Fit, 5));
        let base = fixtures::model(1.0, "");
        let arms = |effects: &[&str]| -> Vec<Arm> {
            let arm = |effect: &&str| {
                let mut model = base.clone();
                model.add_effect(effect, Some(0), None).expect("it may be there");
                let problem =
                    PredictionProblem::of_model(&model, &|_| None, std::slice::from_ref(&run)).expect("a problem");
                Arm {
                    candidate: Some(candidate(effect)),
                    model,
                    key: (*effect).to_owned(),
                    problem,
                    price: 7.0,
                    state: None,
                    before: f64::INFINITY,
                }
            };
            effects.iter().map(arm).collect()
        };
        let laws = ["coulomb", "dahl", "friction_load", "spring_cubic", "stribeck", "torque_offset"];
        let settings = Settings { linearisations: (2, 8), last: 2, ..Settings::default() };
        let kept: Mutex<BTreeMap<String, State>> = Mutex::default();
        let keep = |key: &str, state: &State| {
            kept.lock().unwrap().insert(key.to_owned(), state.clone());
        };
        let raced = race(arms(&laws), &settings, &|_| None, &keep, &|| false);
        assert_eq!(raced[0].key, "spring_cubic");
        assert!(raced.len() <= 3 && raced.windows(2).all(|pair| pair[0].cost() <= pair[1].cost()));
        let reached = |arm: &Arm| arm.state.as_ref().and_then(|state| state.cost).expect("it was predicted");
        assert!((raced[0].cost() - reached(&raced[0]) - 7.0).abs() < 1e-9);
        let kept = kept.into_inner().unwrap();
        let in_round = |round: usize| -> Vec<&str> {
            let end = format!(", round {round}");
            kept.keys().filter_map(|key| key.strip_suffix(end.as_str())).collect()
        };
        assert_eq!(in_round(0), laws);
        let cost = |law: &str, round: usize| kept[&format!("{law}, round {round}")].cost.unwrap_or(f64::INFINITY);
        let mut better = laws;
        better.sort_by(|a, b| cost(a, 0).total_cmp(&cost(b, 0)));
        let mut better: Vec<&str> =
            better[..3].iter().copied().filter(|law| !kept[&format!("{law}, round 0")].is_done).collect();
        better.sort_unstable();
        assert_eq!(in_round(1), better);
        assert!(cost("spring_cubic", 1) < cost("spring_cubic", 0));
        let iterations = |round: usize| {
            let state = &kept[&format!("spring_cubic, round {round}")];
            state.iterations + state.search.iterations
        };
        // The start and two more, then twice as many.
        assert_eq!((iterations(0), iterations(1)), (3, 7));

        // What is kept is not made again, and gives the same.
        let recall = |key: &str| kept.get(key).cloned();
        let nothing = |key: &str, _: &State| panic!("{key} is made again");
        let again = race(arms(&laws), &settings, &recall, &nothing, &|| false);
        let costs = |arms: &[Arm]| arms.iter().map(|arm| (arm.key.clone(), arm.cost().to_bits())).collect::<Vec<_>>();
        assert_eq!(costs(&again), costs(&raced));
        // Who stops gets the arms as they are.
        let stopped = race(arms(&laws), &settings, &|_| None, &nothing, &|| true);
        assert!(stopped.len() == laws.len() && stopped.iter().all(|arm| arm.cost().is_infinite()));
    }
}

//! A better wall, found by trying it under many hands (thesis section 6.2.2).
//!
//! The covariance matrix adaptation evolution strategy (Hansen & Ostermeier 2001) varies a wall's numbers; what it makes
//! small is the chatter over hands, approaches and plants that differ, with a price on walls that are softer than asked, that
//! let the joint bounce out, or that give out energy.

use rayon::prelude::*;
use serde::Serialize;

use super::{
    Measures, Setting, WallError, WallFile,
    contact::{Plant, played},
};
use crate::{
    control::{Law, LinearLaw, Partition, RuleTable, Wall},
    model::Model,
    random::Random,
};

/// What a wall is tuned for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// Static stiffness that a wall should have [N*m/rad or N/m].
    pub stiffness: f64,
    /// Share of the time that the joint may be outside.
    pub outside: f64,
    /// Energy that a wall may give out (J).
    pub energy_out: f64,
    /// As many walls are tried at most.
    pub evaluations: usize,
    /// What trials, hands and plants are drawn from.
    pub seed: u64,
    /// The drive delivers up to this factor more than the model says.
    pub drive: f64,
}

/// A tuned wall.
#[derive(Debug, Clone, PartialEq)]
pub struct Tuned {
    /// It.
    pub wall: WallFile,
    /// What it costs; see [`Told::cost`].
    pub cost: f64,
    /// Walls that were tried.
    pub evaluations: usize,
}

/// How far a tuning is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Told {
    /// Walls tried.
    pub evaluations: usize,
    /// The last one's cost: mean and half the largest logarithm of the chatter in mrad, plus prices.
    pub cost: f64,
}

/// Tunes the gains of a spring and damper.
///
/// # Errors
/// The model makes no equations.
pub fn tune_linear(
    model: &Model,
    setting: &Setting,
    start: (&LinearLaw, f64),
    goal: &Goal,
    told: &(dyn Fn(Told) -> bool + Sync),
) -> Result<Tuned, WallError> {
    let (law, scale) = start;
    let make = |x: &[f64]| Law::Linear(LinearLaw { k1: law.k1 * x[0].exp(), k2: law.k2 * x[1].exp(), offset: 0.0 });
    tune(model, setting, ("PD wall, tuned", scale), 2, &make, goal, told)
}

/// Numbers of a tuned rule table, each as the logarithm of a factor on its start.
const N_RULE_NUMBERS: usize = 10;

/// Tunes a monotone rule table over the fuzzy sets of another. It pushes with a static part that grows with the depth from
/// set to set, and damps, less so at the surface and on the way out. The linear law that it starts from is one of the tables.
///
/// # Errors
/// The model makes no equations.
pub fn tune_rules(
    model: &Model,
    setting: &Setting,
    sets: (&Partition, &Partition),
    start: (&LinearLaw, f64),
    goal: &Goal,
    told: &(dyn Fn(Told) -> bool + Sync),
) -> Result<Tuned, WallError> {
    let (law, scale) = start;
    let make = |x: &[f64]| Law::Rules(monotone(sets.0, sets.1, law, x));
    tune(model, setting, ("fuzzy wall, tuned", scale), N_RULE_NUMBERS, &make, goal, told)
}

/// The table that the numbers `x` make of a linear law.
fn monotone(position: &Partition, velocity: &Partition, law: &LinearLaw, x: &[f64]) -> RuleTable {
    /// Sets below the surface that have a number of their own.
    const OWN: usize = 5;
    /// Speed up to which the first damping holds; beyond, the second adds to it [rad/s or m/s].
    const SLOW: f64 = 2.5;
    /// Damping at the surface over that inside, and on the way out over that on the way in, where the numbers are 0.
    const AT_SURFACE: f64 = 1.0;
    const ON_THE_WAY_OUT: f64 = 1.0;
    let factor: Vec<f64> = x.iter().map(|x| x.exp()).collect();
    let peaks = position.peaks();
    let surface = peaks.iter().position(|peak| *peak >= 0.0).unwrap_or(peaks.len() - 1);
    let mut statics = vec![0.0; peaks.len()];
    for index in (0..surface).rev() {
        let own = factor[(surface - 1 - index).min(OWN)];
        statics[index] = statics[index + 1] + own * law.k1 * (peaks[index + 1] - peaks[index]);
    }
    let damping = |speed: f64| law.k2 * (factor[6] * speed.min(SLOW) + factor[7] * (speed - SLOW).max(0.0));
    let at_surface = (AT_SURFACE * factor[8]).min(1.0);
    let on_the_way_out = (ON_THE_WAY_OUT * factor[9]).min(1.0);
    let output = |rate: f64, index: usize| {
        let share = if index >= surface { at_surface } else { 1.0 };
        // Nothing is asked outside of the wall. So that the table never falls, what stands there is at least what stands at the
        // surface.
        let damped = match (rate < 0.0, index > surface) {
            (true, true) => 0.0,
            (true, false) => -share * damping(-rate),
            (false, _) => at_surface * on_the_way_out * damping(rate),
        };
        // Adding to nothing makes a negative zero a plain one.
        0.0 + damped - statics[index]
    };
    let outputs = velocity.peaks().iter().flat_map(|rate| (0..peaks.len()).map(|index| output(*rate, index))).collect();
    // Every output is finite where the numbers are.
    RuleTable::new(position.clone(), velocity.clone(), outputs)
        .unwrap_or_else(|_| RuleTable::of_linear(position.clone(), velocity.clone(), law))
}

/// Numbers further than this from their start, as logarithms, are not tried.
const FAR: f64 = 3.0;

fn tune(
    model: &Model,
    setting: &Setting,
    (title, scale): (&str, f64),
    n: usize,
    make: &(dyn Fn(&[f64]) -> Law + Sync),
    goal: &Goal,
    told: &(dyn Fn(Told) -> bool + Sync),
) -> Result<Tuned, WallError> {
    let mut random = Random::new(goal.seed);
    let hands = setting.hand.population(setting.spread, setting.hands, goal.seed);
    let plants = hands.iter().map(|_| other_plant(model, setting, goal, &mut random)).collect::<Result<Vec<_>, _>>()?;
    let cost = |x: &[f64]| -> f64 {
        let away: f64 = x.iter().map(|x| (x.abs() - FAR).max(0.0)).sum();
        let near: Vec<f64> = x.iter().map(|x| x.clamp(-FAR, FAR)).collect();
        let Ok(wall) = Wall::new(make(&near), scale, setting.sample_s, setting.torque_limit) else { return f64::MAX };
        let asked: Vec<(usize, usize)> = (0..hands.len())
            .flat_map(|hand| (0..setting.approaches.len()).map(move |approach| (hand, approach)))
            .collect();
        let costs: Vec<f64> = asked
            .par_iter()
            .map(|&(hand, approach)| {
                let contact = played(&plants[hand], setting, &wall, &hands[hand], &setting.approaches[approach]);
                let measures = contact.ok().and_then(|contact| Measures::of(&contact, &wall));
                measures.map_or(UNUSABLE, |measures| price(&measures, goal))
            })
            .collect();
        let largest = costs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        costs.iter().sum::<f64>() / costs.len() as f64 + 0.5 * largest + away * away
    };
    let done = std::sync::atomic::AtomicUsize::new(0);
    let stopped = std::sync::atomic::AtomicBool::new(false);
    let objective = |x: &cmaes::DVector<f64>| -> f64 {
        use std::sync::atomic::Ordering::Relaxed;
        if stopped.load(Relaxed) {
            return f64::MAX;
        }
        let cost = cost(x.as_slice());
        if told(Told { evaluations: done.fetch_add(1, Relaxed) + 1, cost }) {
            stopped.store(true, Relaxed);
        }
        cost
    };
    let build = cmaes::CMAESOptions::new(vec![0.0; n], 0.5)
        .seed(goal.seed)
        .max_function_evals(goal.evaluations)
        .tol_fun(1e-4)
        .tol_x(1e-3)
        .build(objective);
    let start = vec![0.0; n];
    let best = build.ok().and_then(|mut search| search.run().overall_best);
    let x: Vec<f64> = best.map_or(start, |best| best.point.iter().map(|x| x.clamp(-FAR, FAR)).collect());
    let evaluations = done.load(std::sync::atomic::Ordering::Relaxed);
    let wall = WallFile { title: title.to_owned(), scale, law: rounded(make(&x)), passive: false };
    Ok(Tuned { cost: cost(&x), wall, evaluations })
}

/// What a wall costs that cannot be simulated, or is never met.
const UNUSABLE: f64 = 50.0;

/// Logarithm of the chatter, and prices for what a goal does not allow.
fn price(measures: &Measures, goal: &Goal) -> f64 {
    /// Less chatter than this [rad or m] is none: the encoder's last digit.
    const NONE: f64 = 5e-5;
    /// One mrad.
    const UNIT: f64 = 1e-3;
    const PRICE: f64 = 30.0;
    let softer = (goal.stiffness / measures.stiffness.max(0.01 * goal.stiffness)).ln().max(0.0);
    let outside = (measures.outside - goal.outside).max(0.0);
    let energy = (measures.energy_out / goal.energy_out - 1.0).clamp(0.0, 1.0);
    (measures.chatter_rms.max(NONE) / UNIT).ln() + PRICE * (softer + outside) + energy
}

/// The plant as the model's standard errors allow it, with a drive that delivers somewhat more.
fn other_plant(model: &Model, setting: &Setting, goal: &Goal, random: &mut Random) -> Result<Plant, WallError> {
    let mut drawn = model.clone();
    if let Some(fit) = &model.fit {
        let mut values = std::collections::BTreeMap::new();
        for (name, error) in &fit.std_error {
            if let Some(parameter) = model.parameter(name) {
                values.insert(name.clone(), parameter.value + error * random.normal());
            }
        }
        drawn = model.with_values(&|name| values.get(name).copied());
    }
    let delivered = random.between(1.0, goal.drive.max(1.0));
    Ok(Plant::new(&drawn, setting)?.delivering(delivered))
}

/// Numbers of a file that people read: four digits.
fn rounded(law: Law) -> Law {
    let digits = |value: f64| {
        if value == 0.0 || !value.is_finite() {
            return value;
        }
        let unit = 10.0_f64.powi(3 - value.abs().log10().floor() as i32);
        (value * unit).round() / unit
    };
    match law {
        Law::Linear(law) => Law::Linear(LinearLaw { k1: digits(law.k1), k2: digits(law.k2), offset: law.offset }),
        Law::Rules(table) => {
            let outputs = table.outputs().iter().copied().map(digits).collect();
            let (position, velocity) = (table.position().clone(), table.velocity().clone());
            RuleTable::new(position, velocity, outputs).map_or(Law::Rules(table), Law::Rules)
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::wall::shipped;

    proptest! {
        /// Whatever the search tries, the table never pushes less for being deeper or approached faster.
        #[test]
        fn every_table_that_is_tried_is_monotone(x in prop::collection::vec(-3.0..3.0_f64, N_RULE_NUMBERS)) {
            let Law::Rules(table) = shipped("fuzzy").expect("shipped").law else { panic!("rules") };
            let law = LinearLaw { k1: 220.0, k2: 8.0, offset: 0.0 };
            let tried = monotone(table.position(), table.velocity(), &law, &x);
            prop_assert!(tried.is_monotone());
            let Law::Rules(told) = rounded(Law::Rules(tried)) else { panic!("rules") };
            prop_assert!(told.is_monotone());
        }
    }
    /// The law that a tuning starts from is among the tables that it tries, inside the wall.
    #[test]
    fn the_start_is_the_linear_law() {
        let Law::Rules(table) = shipped("fuzzy").expect("shipped").law else { panic!("rules") };
        let law = LinearLaw { k1: 220.0, k2: 8.0, offset: 0.0 };
        let start = monotone(table.position(), table.velocity(), &law, &[0.0; N_RULE_NUMBERS]);
        for (position, velocity) in [(-0.01, 0.3), (-0.0125, -1.8), (-0.3, 4.0), (-0.002, -2.4)] {
            let (told, expected) = (start.output(position, velocity), law.output(position, velocity));
            assert!((told - expected).abs() < 1e-9, "{position} {velocity}: {told} for {expected}");
        }
    }
}

//! A better wall, found by trying it under many hands (thesis section 6.2.2).
//!
//! The covariance matrix adaptation evolution strategy ([`dynid_optimise::cma_es`], with the full matrix, for a wall's few
//! numbers are tied to each other) varies a wall's numbers; what it makes small is the chatter over hands, approaches and plants that differ, with a price on walls that are softer than asked, that
//! let the joint bounce out, or that give out energy.
//!
//! Hands and plants are drawn from streams of their own. Plants differ by [`Model::off_by_errors`], each parameter by itself,
//! because a `[fit]` table holds no covariances; the controller keeps the gain of the model itself. Numbers are rounded
//! only where that costs no more than the start.

use rayon::prelude::*;
use serde::Serialize;

use super::{
    Measures, Setting, WallError, WallFile,
    contact::Plant,
    eight::{Meeting, all_played},
};
use dynid_control::{Law, LinearLaw, Partition, RuleTable, VirtualTool, Wall};
use dynid_optimise::cma_es;
use dynid_random::Random;
use dynid_user_model::Model;

/// What a wall is tuned for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// Static stiffness that a wall should have [N*m/rad or N/m].
    pub stiffness: f64,
    /// Share of the time that the joint may be outside.
    pub outside: f64,
    /// Energy that a wall may give out (J).
    pub energy_out: f64,
    /// About as many walls are tried: the search ends with a whole generation.
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
    /// What it costs; see [`TuneProgress::cost`].
    pub cost: f64,
    /// What the start cost.
    pub cost_at_start: f64,
    /// Walls that were tried.
    pub evaluations: usize,
}

/// How far a tuning is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TuneProgress {
    /// Walls tried.
    pub evaluations: usize,
    /// The last one's cost: mean and half the largest logarithm of the chatter in mrad, plus prices.
    pub cost: f64,
}

/// What a tuning varies, by factors on its start.
#[derive(Debug, Clone, PartialEq)]
pub enum Family {
    /// The gains of a spring and damper.
    Linear(LinearLaw),
    /// A monotone rule table over these fuzzy sets. It pushes with a static part that grows with the depth from set to set, and
    /// damps, less so at the surface and on the way out. The linear law that it starts from is one of the tables.
    Rules {
        /// Fuzzy sets of the position.
        position: Partition,
        /// Fuzzy sets of the velocity.
        velocity: Partition,
        /// The start.
        linear: LinearLaw,
    },
    /// A wall behind a virtual coupling: tool, wall and coupling.
    Coupled(VirtualTool),
    /// A leaky spring with its damper. The element's share is at most a half, or that of the start where that is more.
    Leaky {
        /// Spring and damper.
        linear: LinearLaw,
        /// The element's stiffness over the spring's.
        stiffness: f64,
        /// The element's largest share.
        share: f64,
    },
}

impl Family {
    /// Where nothing better is known: a spring of the stiffness `k1`, in the law's units, and a damper that suits it.
    pub fn linear_start(k1: f64) -> LinearLaw {
        LinearLaw { k1, k2: LEAD_S * k1, offset: 0.0 }
    }

    /// A virtual coupling that feels as stiff as this spring: a wall three times as stiff behind a coupling, with a tool that
    /// follows faster than the controller's ticks.
    pub fn coupled_start(linear: &LinearLaw) -> VirtualTool {
        let LinearLaw { k1, k2, .. } = *linear;
        VirtualTool {
            inertia: LEAD_S * k2,
            wall_stiffness: 3.0 * k1,
            wall_damping: 3.0 * k2,
            stiffness: 1.5 * k1,
            damping: 1.5 * k2,
        }
    }

    /// How many numbers are varied.
    fn n_numbers(&self) -> usize {
        match self {
            Self::Linear(_) => 2,
            Self::Rules { .. } => N_RULE_NUMBERS,
            Self::Coupled(_) => 5,
            Self::Leaky { .. } => 4,
        }
    }

    /// What a tuned wall of the family is called.
    fn title(&self) -> &'static str {
        match self {
            Self::Linear(_) => "PD wall, tuned",
            Self::Rules { .. } => "fuzzy wall, tuned",
            Self::Coupled(_) => "wall behind a virtual coupling, tuned",
            Self::Leaky { .. } => "leaky wall, tuned",
        }
    }

    /// The law that the numbers `x`, logarithms of factors on the start, make.
    fn law(&self, x: &[f64]) -> Law {
        let times = |law: &LinearLaw| LinearLaw { k1: law.k1 * x[0].exp(), k2: law.k2 * x[1].exp(), offset: 0.0 };
        match self {
            Self::Linear(law) => Law::Linear(times(law)),
            Self::Rules { position, velocity, linear } => Law::Rules(monotone(position, velocity, linear, x)),
            Self::Coupled(tool) => Law::Coupled(VirtualTool {
                inertia: tool.inertia * x[0].exp(),
                wall_stiffness: tool.wall_stiffness * x[1].exp(),
                wall_damping: tool.wall_damping * x[2].exp(),
                stiffness: tool.stiffness * x[3].exp(),
                damping: tool.damping * x[4].exp(),
            }),
            Self::Leaky { linear, stiffness, share } => Law::Leaky {
                linear: times(linear),
                stiffness: stiffness * x[2].exp(),
                share: (share * x[3].exp()).min(MOST_SHARE.max(*share)),
            },
        }
    }
}

/// Damping over stiffness of the gains that a tuning starts from (s): about the lag of a sampled wall.
const LEAD_S: f64 = 0.03;

/// An element that takes away more than half of the spring on the way out leaves little that pushes back.
const MOST_SHARE: f64 = 0.5;

/// Numbers of a tuned rule table, each as the logarithm of a factor on its start.
const N_RULE_NUMBERS: usize = 10;

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

/// Tunes a wall whose law has `scale` units of torque for one of its output. The start is tried first, and what comes out is
/// never worse than it, as its file has it.
///
/// # Errors
/// What [`WallError`] says of the model, before a wall is tried. A wall with which the loop diverges is only a bad one.
pub fn tune(
    model: &Model,
    setting: &Setting,
    family: &Family,
    scale: f64,
    goal: &Goal,
    reported: &(dyn Fn(TuneProgress) -> bool + Sync),
) -> Result<Tuned, WallError> {
    // Hands and plants are drawn from streams of their own.
    let mut random = Random::new(!goal.seed);
    let hands = setting.hand.population(setting.spread, setting.hands, goal.seed);
    let plants = hands.iter().map(|_| other_plant(model, setting, goal, &mut random)).collect::<Result<Vec<_>, _>>()?;
    let asked: Vec<(usize, usize)> =
        (0..hands.len()).flat_map(|hand| (0..setting.approaches.len()).map(move |approach| (hand, approach))).collect();
    let cost_of = |law: &Law| -> Result<f64, WallError> {
        let Ok(wall) = Wall::new(law.clone(), scale, setting.sample_s, setting.torque_limit) else {
            return Ok(f64::MAX);
        };
        let meetings: Vec<Meeting<'_>> = asked
            .iter()
            .map(|&(hand, approach)| Meeting {
                plant: &plants[hand],
                wall: &wall,
                hand: &hands[hand],
                approach: &setting.approaches[approach],
            })
            .collect();
        let contacts = all_played(setting, &meetings);
        let costs: Vec<Result<f64, WallError>> = contacts
            .into_par_iter()
            .map(|contact| match contact {
                Ok(contact) => Ok(Measures::of(&contact, &wall).map_or(UNUSABLE, |measures| price(&measures, goal))),
                Err(WallError::Diverged { .. }) => Ok(UNUSABLE),
                Err(error) => Err(error),
            })
            .collect();
        let costs = costs.into_iter().collect::<Result<Vec<f64>, WallError>>()?;
        let largest = costs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Ok(costs.iter().sum::<f64>() / costs.len() as f64 + 0.5 * largest)
    };
    let cost = |x: &[f64]| -> Result<f64, WallError> {
        let away: f64 = x.iter().map(|x| (x.abs() - FAR).max(0.0)).sum();
        let near: Vec<f64> = x.iter().map(|x| x.clamp(-FAR, FAR)).collect();
        Ok(cost_of(&family.law(&near))? + away * away)
    };
    let done = std::sync::atomic::AtomicUsize::new(0);
    let stopped = std::sync::atomic::AtomicBool::new(false);
    let heard = |cost: f64| -> f64 {
        use std::sync::atomic::Ordering::Relaxed;
        if reported(TuneProgress { evaluations: done.fetch_add(1, Relaxed) + 1, cost }) {
            stopped.store(true, Relaxed);
        }
        cost
    };
    let start = vec![0.0; family.n_numbers()];
    // What is wrong with more than a wall is so with the first one.
    let at_start = heard(cost(&start)?);
    let objective = |x: &[f64]| -> f64 {
        if stopped.load(std::sync::atomic::Ordering::Relaxed) {
            return f64::MAX;
        }
        heard(cost(x).unwrap_or(f64::MAX))
    };
    let options = cma_es::Options {
        covariance: cma_es::Covariance::Full,
        spread: 0.5,
        evaluations: goal.evaluations.saturating_sub(1),
        seed: goal.seed,
        tolerance: Some(cma_es::Tolerance { cost: 1e-4, step: 1e-3 }),
    };
    let (best, least) = cma_es::minimise(&objective, (start.clone(), at_start), &options);
    let evaluations = done.load(std::sync::atomic::Ordering::Relaxed);
    let found =
        (least < at_start).then(|| rounded(family.law(&best.iter().map(|x| x.clamp(-FAR, FAR)).collect::<Vec<f64>>())));
    // Rounding may cost more than little was gained.
    let (mut law, mut cost) = (family.law(&start), at_start);
    for rounded in found.into_iter().chain([rounded(law.clone())]) {
        let its_cost = cost_of(&rounded)?;
        if its_cost <= at_start {
            (law, cost) = (rounded, its_cost);
            break;
        }
    }
    let wall = WallFile { title: family.title().to_owned(), scale, law, passive: false, base: None };
    Ok(Tuned { cost, cost_at_start: at_start, wall, evaluations })
}

/// What a wall costs that cannot be simulated, or is never met.
const UNUSABLE: f64 = 1000.0;

/// Logarithm of the chatter, and prices for what a goal does not allow.
fn price(measures: &Measures, goal: &Goal) -> f64 {
    /// Less chatter than this [rad or m] is none: the encoder's last digit.
    const NONE: f64 = 5e-5;
    /// One mrad.
    const UNIT: f64 = 1e-3;
    const PRICE: f64 = 30.0;
    /// A wall that gives out more than it may pays more for that than it could save in chatter.
    const ENERGY_PRICE: f64 = 3.0;
    let softer = (goal.stiffness / measures.stiffness.max(0.01 * goal.stiffness)).ln().max(0.0);
    let outside = (measures.outside - goal.outside).max(0.0);
    let energy = (measures.energy_out / goal.energy_out).max(1.0).ln();
    (measures.chatter_rms.max(NONE) / UNIT).ln() + PRICE * (softer + outside) + ENERGY_PRICE * energy
}

/// The plant as the model's standard errors allow it, with a drive that delivers somewhat more. The controller has the model.
fn other_plant(model: &Model, setting: &Setting, goal: &Goal, random: &mut Random) -> Result<Plant, WallError> {
    let drawn = model.off_by_errors(random);
    let delivered = random.between(1.0, goal.drive.max(1.0));
    Ok(Plant::taken_for(model, &drawn, setting)?.delivering(delivered))
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
    let linear = |law: LinearLaw| LinearLaw { k1: digits(law.k1), k2: digits(law.k2), offset: law.offset };
    match law {
        Law::Linear(law) => Law::Linear(linear(law)),
        Law::Rules(table) => {
            let outputs = table.outputs().iter().copied().map(digits).collect();
            let (position, velocity) = (table.position().clone(), table.velocity().clone());
            RuleTable::new(position, velocity, outputs).map_or(Law::Rules(table), Law::Rules)
        }
        Law::Coupled(tool) => Law::Coupled(VirtualTool {
            inertia: digits(tool.inertia),
            wall_stiffness: digits(tool.wall_stiffness),
            wall_damping: digits(tool.wall_damping),
            stiffness: digits(tool.stiffness),
            damping: digits(tool.damping),
        }),
        Law::Leaky { linear: own, stiffness, share } => {
            Law::Leaky { linear: linear(own), stiffness: digits(stiffness), share: digits(share) }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::wall::shipped;
    use dynid_user_model::FitRecord;

    proptest! {
        /// Whatever the search tries, the table never pushes less for being deeper or approached faster.
        #[test]
        fn every_table_that_is_tried_is_monotone(x in prop::collection::vec(-3.0..3.0_f64, N_RULE_NUMBERS)) {
            let Law::Rules(table) = shipped("fuzzy").expect("shipped").law else { panic!("rules") };
            let law = LinearLaw { k1: 220.0, k2: 8.0, offset: 0.0 };
            let tried = monotone(table.position(), table.velocity(), &law, &x);
            prop_assert!(tried.is_monotone());
            let Law::Rules(reported) = rounded(Law::Rules(tried)) else { panic!("rules") };
            prop_assert!(reported.is_monotone());
        }
    }

    /// A leak that is larger than a search makes any is a start like others, and its share grows no further.
    #[test]
    fn a_leaky_start_is_what_it_was() {
        let linear = LinearLaw { k1: 220.0, k2: 8.0, offset: 0.0 };
        for (share, most) in [(0.3, MOST_SHARE), (0.8, 0.8)] {
            let family = Family::Leaky { linear, stiffness: 1.5, share };
            assert_eq!(family.law(&[0.0; 4]), Law::Leaky { linear, stiffness: 1.5, share });
            let Law::Leaky { share: grown, .. } = family.law(&[0.0, 0.0, 0.0, 2.0]) else { panic!("a leaky wall") };
            assert_eq!(grown, most);
        }
    }

    /// An error of the drive's gain reaches the wall: the controller does not know it.
    #[test]
    fn a_plant_whose_gain_is_off_delivers_another_torque_than_was_asked_for() {
        let setting = Setting::shipped().expect("shipped");
        let mut model = Model::of_device(setting.device);
        let gain = "joint.0.gain.Kp";
        let error = 0.2 * model.parameter(gain).expect("its own").value;
        model.fit = Some(FitRecord { std_error: [(gain.to_owned(), error)].into(), ..FitRecord::default() });
        let goal = Goal { stiffness: 6.6, outside: 0.03, energy_out: 4e-3, evaluations: 1, seed: 1, drive: 1.0 };
        let mut random = Random::new(1);
        let delivered: Vec<f64> = (0..50)
            .map(|_| {
                let plant = other_plant(&model, &setting, &goal, &mut random).expect("a plant");
                1.0 / (plant.system.inverse_drive().expect("a drive")[0] * plant.gain)
            })
            .collect();
        let square: f64 = delivered.iter().map(|delivered| (delivered - 1.0).powi(2)).sum();
        let scatter = (square / 50.0).sqrt();
        assert!((0.1..0.3).contains(&scatter), "{scatter} for 0.2");
    }

    /// A start that is only as good as its unrounded numbers is given back as it is.
    #[test]
    fn rounding_makes_no_start_worse() {
        let setting = Setting { hands: 1, ..Setting::shipped().expect("shipped") };
        let model = Model::of_device(setting.device);
        let mut as_they_were = 0;
        for k1 in [333.349, 417.149, 460.749] {
            // Softer by the rounding, the wall would be softer than asked.
            let goal =
                Goal { stiffness: 0.03 * k1, outside: 0.03, energy_out: 4e-3, evaluations: 2, seed: 3, drive: 1.3 };
            let start = LinearLaw { k1, k2: 15.92, offset: 0.0 };
            let tuned = tune(&model, &setting, &Family::Linear(start), 0.03, &goal, &|_| true).expect("a wall");
            assert!(tuned.cost <= tuned.cost_at_start, "{k1}: {} of {}", tuned.cost, tuned.cost_at_start);
            as_they_were += usize::from(tuned.wall.law == Law::Linear(start));
        }
        assert!(as_they_were > 0, "of no start did the rounding cost anything");
    }

    /// The law that a tuning starts from is among the tables that it tries, inside the wall.
    #[test]
    fn the_start_is_the_linear_law() {
        let Law::Rules(table) = shipped("fuzzy").expect("shipped").law else { panic!("rules") };
        let law = LinearLaw { k1: 220.0, k2: 8.0, offset: 0.0 };
        let start = monotone(table.position(), table.velocity(), &law, &[0.0; N_RULE_NUMBERS]);
        for (position, velocity) in [(-0.01, 0.3), (-0.0125, -1.8), (-0.3, 4.0), (-0.002, -2.4)] {
            let (reported, expected) = (start.output(position, velocity), law.output(position, velocity));
            assert!((reported - expected).abs() < 1e-9, "{position} {velocity}: {reported} for {expected}");
        }
    }
}

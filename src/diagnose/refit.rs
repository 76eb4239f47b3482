//! Real fits of a suspect, judged on the held-out runs: only these decide.

use std::collections::BTreeMap;

use dynid_model::Parameter;
use serde::{Deserialize, Serialize};

use super::{
    FEW_JOINTS,
    candidate::{Suspect, instance},
    verdict,
};
use crate::{
    compare::{Comparison, compare},
    error::Error,
    experiment::{Experiment, Role, Run},
    fit::{
        FitStatus,
        identifiability::correlation_time,
        position::{self, noise_of_log},
        sqp::Watch,
        starts::Starts,
    },
    identify::{self, ErrorKind, How, Identified},
    model::Model,
};

/// A model that was fitted, and what it leaves.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Refit {
    /// What was added to the model that is diagnosed; `None` for that model itself.
    pub suspect: Option<Suspect>,
    /// The fitted model, as a file.
    pub model: String,
    /// How the fit ended.
    pub status: FitStatus,
    /// The suspect's own parameters; of the model itself all that moved.
    pub parameters: Vec<Own>,
    /// Number of unknowns that the suspect brings beyond those that it takes the place of.
    pub unknowns: f64,
    /// Root mean square of the position error over the runs to fit to [rad or m].
    pub rmse_fit: Option<f64>,
    /// The same over the held-out runs.
    pub rmse_validate: Option<f64>,
    /// `100 |torque error| / |torque|` over the runs to fit to.
    pub torque_percent_fit: Option<f64>,
    /// The same over the held-out runs.
    pub torque_percent_validate: Option<f64>,
    /// What is left at each joint, of the error that was fitted.
    pub left: Vec<Left>,
    /// What is left of every block, where all blocks were held out in turn: it counts as what is held out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub blocks: Vec<Left>,
}

/// A suspect's parameter after the refit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Own {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// One standard deviation.
    pub std_error: Option<f64>,
    /// On a bound where the effect does not vanish.
    pub at_bound: bool,
    /// Whether the runs determine it.
    pub identifiable: bool,
}

/// What is left at a joint over the runs of one role.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Left {
    /// The device's joint index.
    pub joint: usize,
    /// Whether the runs are held out.
    pub held_out: bool,
    /// Sum of squared errors.
    pub squares: f64,
    /// Samples.
    pub samples: f64,
    /// Successive samples that share one independent error.
    pub correlation: f64,
    /// Sum of squares that noise alone would leave; `None` where it is not known.
    pub noise_squares: Option<f64>,
    /// Whether every run's error is white.
    pub white: bool,
}

impl Left {
    /// The error in units of the noise; `None` where that is not known.
    pub fn ratio(&self) -> Option<f64> {
        self.noise_squares.map(|noise| (self.squares / noise.max(f64::MIN_POSITIVE)).sqrt())
    }
}

impl Refit {
    /// The fitted model.
    ///
    /// # Errors
    /// Never for a refit of this program; a checkpoint that was tampered with.
    pub fn parsed(&self) -> Result<Model, Error> {
        Ok(Model::parse(&self.model, std::path::Path::new("refitted.toml"))?)
    }

    /// Whether it is of a model as it was, its fit having been given up.
    pub(super) fn was_given_up(&self) -> bool {
        self.suspect.is_none() && self.parameters.is_empty()
    }

    /// Whether every error is a number.
    pub fn is_finite(&self) -> bool {
        self.left.iter().chain(&self.blocks).all(|left| left.squares.is_finite())
    }

    /// What is left on the runs held out, or on those fitted to.
    pub fn side(&self, held_out: bool) -> impl Iterator<Item = &Left> {
        let left = if held_out && !self.blocks.is_empty() { &self.blocks } else { &self.left };
        left.iter().filter(move |left| left.held_out == held_out)
    }

    /// What is left on the held-out runs, or where there are none on those that were fitted.
    pub fn judged(&self) -> impl Iterator<Item = &Left> {
        self.side(self.left.iter().any(|left| left.held_out))
    }

    /// The same as far as it does not come from other folds.
    #[must_use]
    pub fn of_one_fold(&self) -> Self {
        Self { blocks: Vec::new(), ..self.clone() }
    }

    /// Cost per sample and joint of the runs fitted to, as a fit tells it; `None` where the noise is not known.
    pub fn cost(&self) -> Option<f64> {
        let (mut cost, mut samples) = (0.0, 0.0);
        for left in self.side(false) {
            cost += 0.5 * left.samples * left.squares / left.noise_squares?.max(f64::MIN_POSITIVE);
            samples += left.samples;
        }
        (samples > 0.0).then(|| cost / samples)
    }

    /// The largest error of any judged joint, in units of its noise; `None` where the noise is not known.
    pub fn worst_ratio(&self) -> Option<f64> {
        self.judged().map(Left::ratio).try_fold(0.0_f64, |worst, ratio| Some(worst.max(ratio?)))
    }

    /// Whether nothing but white noise is left.
    pub fn is_white(&self) -> bool {
        self.judged().all(|left| left.white)
    }
}

/// What a refit is measured by while it goes on; costs are per sample.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Marks {
    /// What another suspect's fit has reached: a fit that stays far above it is given up.
    pub reached: Option<f64>,
    /// Low enough not to try another start.
    pub enough: Option<f64>,
    /// Whether a fit that stays poor is followed to its end all the same.
    pub thorough: bool,
}

/// How long a fit that stays poor is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Patience {
    /// A valley is flat where so many iterations lower the cost by less than `share`.
    iterations: usize,
    share: f64,
    /// Whether a fit that follows the logs not even on a tether is given up, rather than taken as it is.
    gives_up: bool,
}

/// For a suspect, one of many.
pub(super) const FOR_A_SUSPECT: Patience = Patience { iterations: 8, share: 0.01, gives_up: false };
/// For the model itself, from whose values all suspects are screened.
const FOR_THE_MODEL: Patience = Patience { iterations: 20, share: 0.02, gives_up: true };

/// How to refit.
#[derive(Debug, Clone, Copy)]
pub struct Judge<'a> {
    /// Which error.
    pub error: ErrorKind,
    /// Its experiment.
    pub experiment: &'a Experiment,
    /// All runs, those to fit to and those held out.
    pub runs: &'a [&'a Run],
    /// How finely.
    pub options: position::Options,
}

impl Judge<'_> {
    /// Fits `start` and tells what is left. `base` is the model that the suspect was added to.
    ///
    /// # Errors
    /// The model makes no equations, the fit cannot start, it is given up or `stop` says so.
    pub fn refit(
        &self,
        suspect: Option<&Suspect>,
        base: &Model,
        start: &Model,
        marks: Marks,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Refit, Error> {
        let patience = match suspect {
            _ if marks.thorough => None,
            None => Some(FOR_THE_MODEL),
            Some(_) => Some(FOR_A_SUSPECT),
        };
        let found = self.fit(start, patience, marks.reached, stop)?;
        let own = |name: &str| suspect.is_none_or(|suspect| is_own(suspect, start, name));
        let parameters: Vec<Own> = found
            .parameters
            .iter()
            .filter(|parameter| own(&parameter.name))
            .map(|parameter| Own {
                name: parameter.name.clone(),
                value: parameter.value,
                std_error: parameter.std_error,
                at_bound: parameter.held && !is_null(start, &parameter.name, parameter.value),
                identifiable: parameter.identifiable,
            })
            .collect();
        let unknowns = self.added_unknowns(&found.model, base);
        let suspect = suspect.cloned();
        Ok(Refit { suspect, status: found.status, parameters, unknowns, ..self.as_it_is(&found.model)? })
    }

    /// What a model leaves that is not fitted.
    ///
    /// # Errors
    /// The model makes no equations.
    pub(super) fn as_it_is(&self, model: &Model) -> Result<Refit, Error> {
        let comparison = compare(model, self.runs)?;
        Ok(Refit {
            suspect: None,
            status: FitStatus::IterationLimit,
            parameters: Vec::new(),
            unknowns: 0.0,
            rmse_fit: comparison.rmse_fit,
            rmse_validate: comparison.rmse_validate,
            torque_percent_fit: comparison.torque_percent_fit,
            torque_percent_validate: comparison.torque_percent_validate,
            left: left(&comparison, self.runs, self.error),
            blocks: Vec::new(),
            model: model.to_toml(),
        })
    }

    /// How many unknowns that the runs depend on `model` has more than `base`.
    pub(super) fn added_unknowns(&self, model: &Model, base: &Model) -> f64 {
        count(model, self.runs) - count(base, self.runs)
    }

    /// Fits `start` to the runs that are for it; a fit that stays poor is followed no longer than `patience` lasts.
    ///
    /// # Errors
    /// As [`Judge::refit`].
    pub(super) fn fit(
        &self,
        start: &Model,
        patience: Option<Patience>,
        reached: Option<f64>,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Identified, Error> {
        /// A fit that can reach what another reached is not so far from it after so many iterations.
        const PATIENCE: usize = 15;
        const FAR: f64 = 30.0;
        /// What leaves this many times the cost of noise is poor.
        const POOR: f64 = 16.0;
        /// With a tether of this rate [1/s] or a looser one only a model that is right leaves mere noise.
        const LOOSE: f64 = 30.0;
        /// Cost per sample with such a tether beyond which following the fit of many joints, whose every step takes long, to a
        /// minimum without one is worth no time: accelerations are off by what moves a joint thirty noises in a thirtieth of a
        /// second.
        const HOPELESS: f64 = 500.0;
        // From where else to start is the diagnosis's own matter.
        let starts = Starts { believed: false, ..Starts::default() };
        let how = How { starts, tell_start: false, ..How::plain(self.error, self.options) };
        let only_noise = reached.is_some_and(|reached| reached < verdict::COST_AT_THE_FLOOR);
        let has_many_joints = self.runs.iter().any(|run| run.free.len() > FEW_JOINTS);
        // The last with a loose tether.
        let mut at_loose = 0.0;
        // Of the iterations without a tether.
        let mut costs: Vec<f64> = Vec::new();
        // Those whose cost may be compared with what another reached.
        let mut tries = 0;
        let mut watch = |told: &identify::Progress, _: Option<&identify::State>| {
            if told.tether == 0.0 {
                costs.push(told.cost);
            }
            tries += usize::from(told.tether == 0.0 || (only_noise && told.tether <= LOOSE));
            if told.tether == LOOSE {
                at_loose = told.cost;
            }
            let is_hopeless = has_many_joints && at_loose > HOPELESS && told.tether < LOOSE;
            let is_far = reached.is_some_and(|reached| told.cost > FAR * reached);
            if stop() || (is_far && tries >= PATIENCE) {
                return Watch::Stop;
            }
            let is_poor = self.error == ErrorKind::Position && told.cost > POOR * verdict::COST_AT_THE_FLOOR;
            let Some(patience) = patience.filter(|_| is_poor) else { return Watch::Continue };
            if is_hopeless && patience.gives_up {
                return Watch::Stop;
            }
            let earlier = costs.len().checked_sub(patience.iterations + 1).map(|index| costs[index]);
            let is_flat = earlier.is_some_and(|earlier| told.cost > (1.0 - patience.share) * earlier);
            if is_flat || is_hopeless { Watch::Enough } else { Watch::Continue }
        };
        identify::identify_as(start, self.experiment, self.runs, &how, identify::State::default(), &mut watch)
    }
}

/// Number of unknown effect parameters that the runs depend on.
fn count(model: &Model, runs: &[&Run]) -> f64 {
    let free = |joint: usize| runs.iter().any(|run| run.free.contains(&joint));
    let effects = model.effects.iter().filter(|own| own.joint.is_none_or(free));
    effects.flat_map(|own| &own.parameters).filter(|parameter| !parameter.fixed).count() as f64
}

fn is_own(suspect: &Suspect, model: &Model, name: &str) -> bool {
    instance(model, suspect).is_some_and(|own| (0..own.parameters.len()).any(|index| own.parameter_name(index) == name))
}

/// Whether the parameter of that name is where its effect vanishes.
fn is_null(model: &Model, name: &str, value: f64) -> bool {
    model.effects.iter().any(|own| {
        own.effect.parameters.iter().enumerate().any(|(index, parameter)| {
            let Parameter { lower, upper, .. } = own.parameters[index];
            let near = 1e-3 * if (upper - lower).is_finite() { upper - lower } else { 1.0 };
            own.parameter_name(index) == name && parameter.null.is_some_and(|null| (value - null).abs() <= near)
        })
    })
}

/// What `comparison` leaves at each joint.
pub(super) fn left(comparison: &Comparison, runs: &[&Run], error: ErrorKind) -> Vec<Left> {
    let mut sums: BTreeMap<(usize, bool), Left> = BTreeMap::new();
    let mut add = |joint: usize,
                   held_out: bool,
                   squares: f64,
                   samples: f64,
                   correlation: f64,
                   noise: Option<f64>,
                   white: bool| {
        let sum = sums.entry((joint, held_out)).or_insert(Left {
            joint,
            held_out,
            squares: 0.0,
            samples: 0.0,
            correlation: 1.0,
            noise_squares: Some(0.0),
            white: true,
        });
        sum.correlation = (sum.correlation * sum.samples + correlation * samples) / (sum.samples + samples).max(1.0);
        sum.squares += squares;
        sum.samples += samples;
        sum.noise_squares = sum.noise_squares.zip(noise).map(|(sum, noise)| sum + noise * noise * samples);
        sum.white &= white;
    };
    for (told, run) in comparison.runs.iter().zip(runs) {
        let held_out = run.role == Role::Validate;
        for (slot, joint) in told.joints.iter().enumerate() {
            if error == ErrorKind::Torque {
                let Some(torque) = told.torque.get(slot) else { continue };
                let used = torque.residual.iter().zip(&torque.used).filter(|(_, used)| **used);
                let squares: f64 = used.map(|(value, _)| value * value).sum();
                if torque.n_used() == 0 {
                    continue;
                }
                // A stage that takes the command away takes the error along; that explains nothing.
                let share = torque.delivered_share().unwrap_or(1.0).min(1.0);
                let squares = squares / (share * share).max(f64::MIN_POSITIVE);
                let correlation = correlation_time(&torque.residual, &torque.used);
                add(joint.joint, held_out, squares, torque.n_used() as f64, correlation, None, false);
            } else if let (Some(rmse), Some(simulated)) = (joint.rmse, &told.simulated) {
                let measured = &run.log.q[joint.joint];
                // A joint that stands still here moves in another run, or tells nothing.
                let noise_floor = if joint.noise_floor > 0.0 {
                    joint.noise_floor
                } else {
                    runs.iter().map(|other| noise_of_log(&other.log.q[joint.joint])).fold(0.0, f64::max)
                };
                if noise_floor == 0.0 {
                    continue;
                }
                let residual: Vec<f64> =
                    measured.iter().zip(&simulated[slot]).map(|(measured, model)| measured - model).collect();
                let samples = residual.len() as f64;
                let correlation = correlation_time(&residual, &vec![true; residual.len()]);
                let noise = Some(noise_floor);
                add(joint.joint, held_out, rmse * rmse * samples, samples, correlation, noise, joint.white);
            } else {
                // A run that cannot be simulated to its end is not one without error.
                let noise = Some(joint.noise_floor);
                add(joint.joint, held_out, f64::INFINITY, run.log.t.len() as f64, 1.0, noise, false);
            }
        }
    }
    sums.into_values().collect()
}

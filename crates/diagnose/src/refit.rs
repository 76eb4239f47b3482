//! What a fitted model leaves of the logs: shown beside the likelihood, which decides.

use std::collections::BTreeMap;

use dynid_model::Parameter;
use serde::Serialize;

use super::candidate::{Candidate, instance};
use crate::DiagnoseError;
use dynid_check::excitation::moves;
use dynid_identify::{FitStatus, identify::ErrorSignal, position::noise_of};
use dynid_judge::{compare::Comparison, compare::compare};
use dynid_logs::{experiment::Role, experiment::Run, noise::noise_of_log};
use dynid_signal::is_white;
use dynid_user_model::{EffectInstance, FitRecord, Model};

/// A model that was fitted, and what it leaves.
#[derive(Debug, Clone)]
pub struct Refit {
    /// What was added to the model that is diagnosed; `None` for that model itself.
    pub candidate: Option<Candidate>,
    /// The model, as a file.
    pub model: String,
    /// How its values were found; `None` where they are those that were given.
    pub record: Option<FitRecord>,
    /// How the fit ended.
    pub status: FitStatus,
    /// The candidate's own parameters; of the model itself all that moved.
    pub parameters: Vec<EffectParameter>,
    /// Number of unknowns that the candidate brings beyond those that it takes the place of.
    pub unknowns: f64,
    /// Root mean square of the position error over the held-out runs [rad or m].
    pub rmse_validate: Option<f64>,
    /// `100 |torque error| / |torque|` over the held-out runs.
    pub torque_percent_validate: Option<f64>,
    /// What is left at each joint, of the error that is shown.
    pub left: Vec<JointResidual>,
    /// The largest error of a one-step prediction over the noise of its log.
    pub one_step: Option<f64>,
}

/// A candidate's parameter after the refit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EffectParameter {
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
#[derive(Debug, Clone, PartialEq)]
pub struct JointResidual {
    /// The device's joint index.
    pub joint: usize,
    /// Whether the runs are held out.
    pub held_out: bool,
    /// Sum of squared errors.
    pub squares: f64,
    /// Samples.
    pub samples: f64,
    /// Sum of squares that noise alone would leave; `None` where it is not known.
    pub noise_squares: Option<f64>,
    /// Whether every run's error is white.
    pub white: bool,
}

impl JointResidual {
    /// The error in units of the noise; `None` where that is not known.
    pub fn ratio(&self) -> Option<f64> {
        self.noise_squares.map(|noise| (self.squares / noise.max(f64::MIN_POSITIVE)).sqrt())
    }
}

impl Refit {
    /// The model.
    ///
    /// # Errors
    /// Never for a refit of this program; a checkpoint that was tampered with.
    pub fn parsed(&self) -> Result<Model, DiagnoseError> {
        let mut model = Model::parse(&self.model, std::path::Path::new("refitted.toml"))?;
        model.fit = self.record.clone().or(model.fit);
        Ok(model)
    }

    /// What is left on the runs held out, or on those fitted to.
    pub fn side(&self, held_out: bool) -> impl Iterator<Item = &JointResidual> {
        self.left.iter().filter(move |left| left.held_out == held_out)
    }

    /// What is left of every joint on the held-out runs; of one that is free in none of them, on those that were fitted.
    pub fn judged(&self) -> impl Iterator<Item = &JointResidual> {
        let is_held_out = |joint: usize| self.side(true).any(|left| left.joint == joint);
        self.side(true).chain(self.side(false).filter(move |left| !is_held_out(left.joint)))
    }

    /// The largest error of any judged joint, in units of its noise; `None` where the noise is not known, or nothing is.
    pub fn worst_ratio(&self) -> Option<f64> {
        self.judged().map(JointResidual::ratio).reduce(|worst, ratio| Some(worst?.max(ratio?))).flatten()
    }

    /// Whether nothing but white noise is left.
    pub fn is_white(&self) -> bool {
        self.judged().all(|left| left.white)
    }
}

/// What is shown of fitted models.
#[derive(Debug, Clone, Copy)]
pub struct Judge<'a> {
    /// Which error.
    pub shown: ErrorSignal,
    /// All runs, those to fit to and those held out.
    pub runs: &'a [&'a Run],
}

impl Judge<'_> {
    /// What a model leaves as it is.
    ///
    /// # Errors
    /// The model makes no equations.
    pub(super) fn as_it_is(&self, model: &Model) -> Result<Refit, DiagnoseError> {
        let comparison = compare(model, self.runs)?;
        Ok(Refit {
            candidate: None,
            status: FitStatus::IterationLimit,
            parameters: Vec::new(),
            unknowns: 0.0,
            rmse_validate: comparison.rmse_validate,
            torque_percent_validate: comparison.torque_percent_validate,
            left: left(&comparison, self.runs, self.shown),
            one_step: None,
            record: None,
            model: model.to_toml(),
        })
    }
}

/// Number of unknown effect parameters that the runs depend on.
pub(super) fn count<'a>(model: &Model, runs: impl IntoIterator<Item = &'a Run>) -> f64 {
    let runs: Vec<&Run> = runs.into_iter().collect();
    let acts = |own: &EffectInstance, run: &Run| {
        own.joint.is_none_or(|joint| run.free.contains(&joint)) && own.acts_with(run.payload.as_deref())
    };
    let effects = model.effects.iter().filter(|own| runs.iter().any(|run| acts(own, run)));
    effects.flat_map(|own| &own.parameters).filter(|parameter| !parameter.fixed).count() as f64
}

pub(super) fn is_own(candidate: &Candidate, model: &Model, name: &str) -> bool {
    instance(model, candidate)
        .is_some_and(|own| (0..own.parameters.len()).any(|index| own.parameter_name(index) == name))
}

/// Whether the parameter of that name is where its effect vanishes.
pub(super) fn is_null(model: &Model, name: &str, value: f64) -> bool {
    model.effects.iter().any(|own| {
        own.effect.parameters.iter().enumerate().any(|(index, parameter)| {
            let Parameter { lower, upper, .. } = own.parameters[index];
            let near = 1e-3 * if (upper - lower).is_finite() { upper - lower } else { 1.0 };
            own.parameter_name(index) == name && parameter.null.is_some_and(|null| (value - null).abs() <= near)
        })
    })
}

/// What `comparison` leaves at each joint.
pub(super) fn left(comparison: &Comparison, runs: &[&Run], error: ErrorSignal) -> Vec<JointResidual> {
    let mut sums: BTreeMap<(usize, bool), JointResidual> = BTreeMap::new();
    let mut add = |joint: usize, held_out: bool, squares: f64, samples: f64, noise: Option<f64>, white: bool| {
        let sum = sums.entry((joint, held_out)).or_insert(JointResidual {
            joint,
            held_out,
            squares: 0.0,
            samples: 0.0,
            noise_squares: Some(0.0),
            white: true,
        });
        sum.squares += squares;
        sum.samples += samples;
        sum.noise_squares = sum.noise_squares.zip(noise).map(|(sum, noise)| sum + noise * noise * samples);
        sum.white &= white;
    };
    for (reported, run) in comparison.runs.iter().zip(runs) {
        let held_out = run.role == Role::Validate;
        for (slot, joint) in reported.joints.iter().enumerate() {
            if error == ErrorSignal::Torque {
                let Some(torque) = reported.torque.get(slot) else { continue };
                let used = torque.residual.iter().zip(&torque.used).filter(|(_, used)| **used);
                let squares: f64 = used.map(|(value, _)| value * value).sum();
                if torque.n_used() == 0 {
                    continue;
                }
                // A stage that takes the command away takes the error along; that explains nothing.
                let share = torque.delivered_share().unwrap_or(1.0).min(1.0);
                let squares = squares / (share * share).max(f64::MIN_POSITIVE);
                add(joint.joint, held_out, squares, torque.n_used() as f64, None, false);
            } else if let (Some(rmse), Some(simulated)) = (joint.rmse, &reported.simulated) {
                let measured = &run.log.q[joint.joint];
                // A joint that stands still here moves in another run, or tells nothing.
                let noise_floor = if joint.noise_floor > 0.0 {
                    joint.noise_floor
                } else {
                    runs.iter().map(|other| noise_of_log(&other.log.q[joint.joint])).fold(0.0, f64::max)
                };
                // What moves without noise has as much as a fit takes it to have.
                let noise_floor =
                    if moves(run, joint.joint) { noise_floor.max(noise_of(measured)) } else { noise_floor };
                if noise_floor == 0.0 {
                    continue;
                }
                let mut residual: Vec<f64> =
                    measured.iter().zip(&simulated[slot]).map(|(measured, model)| measured - model).collect();
                let (mut squares, mut white) = (rmse * rmse * residual.len() as f64, joint.white);
                // What a fit does not see is not judged either.
                let cut = run.n_cut().min(residual.len());
                if cut == residual.len() {
                    continue;
                }
                if cut > 0 {
                    residual.drain(..cut);
                    squares = residual.iter().map(|error| error * error).sum();
                    white = is_white(&residual);
                }
                let samples = residual.len() as f64;
                add(joint.joint, held_out, squares, samples, Some(noise_floor), white);
            } else {
                // A run that cannot be simulated to its end is not one without error.
                let noise = Some(joint.noise_floor);
                add(joint.joint, held_out, f64::INFINITY, run.log.t.len() as f64, noise, false);
            }
        }
    }
    sums.into_values().collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::fixtures::{self, Oscillator, close};

    /// A fit that left nothing, not even a file.
    pub(crate) fn empty() -> Refit {
        Refit {
            candidate: None,
            model: String::new(),
            record: None,
            status: FitStatus::Converged,
            parameters: Vec::new(),
            unknowns: 0.0,
            rmse_validate: None,
            torque_percent_validate: None,
            left: Vec::new(),
            one_step: None,
        }
    }

    #[test]
    fn a_joint_that_is_free_in_no_held_out_run_is_judged_by_the_others() {
        let left = |joint, held_out, squares| JointResidual {
            joint,
            held_out,
            squares,
            samples: 1.0,
            noise_squares: Some(1.0),
            white: true,
        };
        let refit = Refit { left: vec![left(4, false, 9.0), left(4, true, 1.0), left(5, false, 400.0)], ..empty() };
        assert_eq!(refit.judged().map(|left| (left.joint, left.held_out)).collect::<Vec<_>>(), [(4, true), (5, false)]);
        assert_eq!(refit.worst_ratio(), Some(20.0));
        assert_eq!(empty().worst_ratio(), None, "nothing is judged");
    }

    #[test]
    fn a_parameter_is_null_where_its_effect_vanishes_within_a_thousandth_of_its_bounds() {
        let text = "device = \"planar2r\"\n[[effect]]\nid = \"coulomb\"\njoint = 1\nFc = { value = 0.1, lower = 0.0, upper = 2.0 }\n";
        let model = Model::parse(text, std::path::Path::new("made.toml")).expect("a model");
        let is_null_at = |name: &str, value: f64| is_null(&model, name, value);
        assert!(is_null_at("joint.1.coulomb.Fc", 0.0) && is_null_at("joint.1.coulomb.Fc", 0.0019));
        assert!(!is_null_at("joint.1.coulomb.Fc", 0.0021) && !is_null_at("joint.1.coulomb.Fc", 2.0));
        assert!(!is_null_at("joint.1.coulomb.v_eps", 0.0), "nowhere in this one does friction vanish");
        assert!(!is_null_at("joint.0.coulomb.Fc", 0.0), "no such parameter");
    }

    /// Sums over the runs of a role of what a comparison says of each, a beginning that is cut being left out.
    #[test]
    fn what_is_left_is_summed_by_joint_and_role() {
        let model = fixtures::model(1.0, "");
        let plant = Oscillator { stiffness: 1.1, cubic: 0.0 };
        let mut runs = [(6.0, (Role::Fit, 5)), (4.0, (Role::Fit, 6)), (5.0, (Role::Validate, 7))]
            .map(|(seconds, role)| plant.run(&[(0.02, 1.0), (0.01, 3.7)], seconds, role));
        runs[0].settings.from_s = Some(0.995);
        let all: Vec<&Run> = runs.iter().collect();
        let compared = compare(&model, &all).expect("a comparison");
        let found = left(&compared, &all, ErrorSignal::Position);
        let [fitted, held_out] = found.as_slice() else { panic!("{found:?}") };
        assert_eq!((fitted.joint, fitted.held_out, held_out.held_out), (0, false, true));
        assert_eq!((fitted.samples, held_out.samples), (500.0 + 400.0, 500.0));
        let squares = |run: usize, first: usize| -> f64 {
            let simulated = &compared.runs[run].simulated.as_ref().expect("it is simulated")[0];
            runs[run].log.q[0].iter().zip(simulated).skip(first).map(|(y, q)| (y - q).powi(2)).sum()
        };
        close(fitted.squares, squares(0, 100) + squares(1, 0));
        close(held_out.squares, squares(2, 0));
        let noise = |run: usize| compared.runs[run].joints[0].noise_floor.max(noise_of(&runs[run].log.q[0])).powi(2);
        close(fitted.noise_squares.expect("it is known"), 500.0 * noise(0) + 400.0 * noise(1));
        close(held_out.ratio().expect("it is known"), (squares(2, 0) / (500.0 * noise(2))).sqrt());
        assert!(!fitted.white && !held_out.white, "the spring is off");
        // Of the torque error each sample that counts, and of what the drive delivers.
        let found = left(&compared, &all, ErrorSignal::Torque);
        let [fitted, held_out] = found.as_slice() else { panic!("{found:?}") };
        let of = |run: usize| &compared.runs[run].torque[0];
        let squares = |run: usize| -> f64 {
            let used = of(run).residual.iter().zip(&of(run).used).filter(|(_, used)| **used);
            used.map(|(residual, _)| residual * residual).sum()
        };
        assert_eq!(of(0).delivered_share(), Some(1.0));
        close(fitted.squares, squares(0) + squares(1));
        close(held_out.squares, squares(2));
        assert_eq!(held_out.samples, of(2).n_used() as f64);
        assert_eq!((fitted.noise_squares, fitted.white), (None, false));
        let saturated = fixtures::model(1.0, "[[effect]]\nid = \"saturation\"\njoint = 0\nlimit = 0.01\n");
        let compared = compare(&saturated, &all).expect("a comparison");
        let torque = &compared.runs[2].torque[0];
        let share = torque.delivered_share().expect("it is known");
        assert!(share > 0.1 && share < 0.9, "{share}");
        let used = torque.residual.iter().zip(&torque.used).filter(|(_, used)| **used);
        let squares: f64 = used.map(|(residual, _)| residual * residual).sum();
        close(left(&compared, &all, ErrorSignal::Torque)[1].squares, squares / (share * share));
        // How many unknown parameters of effects there are: the gain is fixed.
        assert_eq!((count(&model, all.iter().copied()), count(&saturated, all.iter().copied())), (3.0, 4.0));
        assert_eq!(count(&model, &[]), 0.0, "nothing depends on them");
        // A payload's count where it is carried.
        let box_of = "[[effect]]\nid = \"payload\"\njoint = 0\npayload = \"box\"\nm = { value = 0.1, fixed = false }\n";
        let carrying = Run { payload: Some("box".to_owned()), ..runs[0].clone() };
        let carried = fixtures::model(1.0, box_of);
        assert_eq!((count(&carried, all.iter().copied()), count(&carried, [&carrying])), (3.0, 7.0));
    }
}

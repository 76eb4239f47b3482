//! From a user's model to what is computed with: a [`System`], or [`Kinematics`].

use std::collections::BTreeSet;

use dynid_generated::Signal;
use dynid_kernels::KernelError;
use dynid_logs::experiment::Run;
use dynid_logs::part;
use dynid_model::Effect;
use dynid_signal::statistics::rms;

use dynid_dynamics::kinematics::{Kinematics, KinematicsError};
use dynid_dynamics::system::{Output, PlacedEffect, SignalSet, System, SystemError};

use crate::{EffectInstance, Model};

impl Model {
    /// The equations of this model with the joints `free`, the others locked at `position_of(joint)` [rad or m], and no payload.
    ///
    /// # Errors
    /// Joints that the device does not have, equations or an effect's function that cannot be made, a value that is missing.
    pub fn system(&self, free: &[usize], position_of: impl Fn(usize) -> f64) -> Result<System, SystemError> {
        self.system_carrying(None, free, position_of)
    }

    /// The equations of this model in a run: with its free joints, the others locked where they were on the average, and what it carries.
    ///
    /// # Errors
    /// As [`Model::system`].
    pub fn system_of(&self, run: &Run) -> Result<System, SystemError> {
        self.system_carrying(run.payload.as_deref(), &run.free, |joint| run.log.mean_position(joint))
    }

    /// By how much each commanded torque accelerates the free joints where a run begins ([`System::accelerations_by_command`]); `None` where
    /// the model makes no equations for the run.
    #[must_use]
    pub fn accelerations_by_command(&self, run: &Run) -> Option<Vec<Vec<f64>>> {
        let system = self.system_of(run).ok()?;
        let position: Vec<f64> = run.free.iter().map(|joint| run.log.q[*joint][0]).collect();
        let usual: Vec<f64> = run.log.tau.iter().map(|tau| rms(tau)).collect();
        Some(system.accelerations_by_command(&position, &usual))
    }

    /// What is looked at of `runs`: the stretches that their masks let count, thinned where there are more samples than `enough` and fewer
    /// tell the same ([`part::looked_at`]).
    #[must_use]
    pub fn looked_at<'a>(&self, runs: impl IntoIterator<Item = &'a Run>, enough: usize) -> Vec<Run> {
        part::looked_at(runs, enough, &|run| self.accelerations_by_command(run))
    }

    /// As [`Model::system`], with what the machine carries.
    ///
    /// # Errors
    /// As [`Model::system`].
    pub fn system_carrying(
        &self,
        payload: Option<&str>,
        free: &[usize],
        position_of: impl Fn(usize) -> f64,
    ) -> Result<System, SystemError> {
        let kernel = dynid_kernels::kernel(self.device, free).map_err(no_kernel)?;
        let values: std::collections::BTreeMap<String, f64> =
            self.parameters().into_iter().map(|(name, parameter)| (name, parameter.value)).collect();
        let link_parameters = kernel
            .parameters
            .iter()
            .map(|name| {
                let missing = || SystemError::MissingParameter { name: (*name).to_owned() };
                values.get(*name).copied().ok_or_else(missing)
            })
            .collect::<Result<_, _>>()?;
        let locked = kernel.locked.iter().map(|joint| position_of(*joint)).collect();
        let acting = self.effects.iter().filter(|own| own.acts_with(payload));
        let effects = acting.map(|own| self.placed(own)).collect::<Result<Vec<_>, SystemError>>()?;
        let system = System::new(kernel, self.device.joints.len(), link_parameters, locked, &effects)?;
        Ok(system.fusing(&dynid_kernels::Fuser))
    }

    /// One of the model's effects for a [`System`], with the link that it joins where it is a body.
    ///
    /// # Errors
    /// An effect without a kernel.
    pub fn placed(&self, instance: &EffectInstance) -> Result<PlacedEffect, SystemError> {
        let link = instance.joint.and_then(|joint| self.device.last_link_moved_by(joint));
        Ok(PlacedEffect { link: link.map(|index| index + 1), ..instance.placed()? })
    }

    /// The end point of this model at a posture of all joints, of which the `free` ones will move.
    ///
    /// # Errors
    /// As [`Kinematics::new`].
    pub fn kinematics(&self, free: &[usize], posture: &[f64]) -> Result<Kinematics, KinematicsError> {
        let no_kernel = |error: KernelError| KinematicsError::NoKernel { why: error.to_string() };
        let end_point = dynid_kernels::end_point(self.device).map_err(no_kernel)?;
        let end_point = end_point.ok_or_else(|| KinematicsError::NoEndPoint { device: self.device.id.clone() })?;
        Kinematics::new(end_point, free, posture, |name| Some(self.parameter(name)?.value))
    }
}

fn no_kernel(error: KernelError) -> SystemError {
    SystemError::NoKernel { why: error.to_string() }
}

impl EffectInstance {
    /// The effect for a [`System`], with its values; which link a body joins is the device's to say.
    pub fn placed(&self) -> Result<PlacedEffect, SystemError> {
        let effect = self.effect;
        let kernel = dynid_kernels::effect(effect).map_err(no_kernel)?;
        let names: Vec<String> = (0..effect.parameters.len()).map(|index| self.parameter_name(index)).collect();
        let place = self.place_name();
        Ok(PlacedEffect {
            kernel,
            place: effect.place,
            stage: effect.stage,
            is_friction: effect.family.as_deref() == Some("friction"),
            joint: self.joint,
            from: self.from,
            names,
            parameters: self.values(),
            state_names: effect.states.iter().map(|state| format!("{place}.{}", state.symbol)).collect(),
            initial_states: effect.states.iter().map(|state| state.initial).collect(),
            states_at_speed: (0..effect.states.len()).filter(|state| effect.states[*state].starts_at_speed).collect(),
            link: None,
            outputs: effect.outputs.iter().map(|(name, _)| Output::named(name)).collect(),
            uses: signals_of(effect),
        })
    }
}

/// The signals that an effect's formulas read; a parameter hides a signal of its name.
fn signals_of(effect: &Effect) -> SignalSet {
    let mut symbols = BTreeSet::new();
    let formulas = effect.terms.iter().chain(&effect.outputs).map(|(_, formula)| formula);
    for formula in formulas.chain(effect.states.iter().map(|state| &state.rate)) {
        formula.for_each_symbol(&mut |symbol| {
            symbols.insert(symbol.to_owned());
        });
    }
    let none: &[Signal] = &[];
    symbols
        .iter()
        .filter(|symbol| effect.parameter(symbol).is_none())
        .filter_map(|symbol| SignalSet::named(symbol))
        .fold(SignalSet::of(none), SignalSet::union)
}

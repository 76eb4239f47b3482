//! Adding effects to a model and taking them out.

use dynid_model::{Effect, Parameter, Scope, did_you_mean, effect, effects, instance::instance_name};

use super::{EffectInstance, Model};
use dynid_format::UnknownName;

/// An effect that cannot be added or taken out.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EffectError {
    /// An id that no effect has.
    #[error(transparent)]
    Unknown(#[from] UnknownName),
    /// It cannot stand where it was put, or does not stand there.
    #[error("{message}; {help}")]
    Place {
        /// What is wrong.
        message: String,
        /// What to do.
        help: String,
    },
}

/// What [`Model::add_effect`] did.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Added {
    /// "`lugre` at joint 3".
    pub label: String,
    /// Labels of the effects whose place it took.
    pub replaced: Vec<String>,
    /// Names of the new effect's parameters.
    pub parameters: Vec<String>,
}

impl Model {
    /// Adds an effect with the device's values or its first guesses. It takes the place of the effects that it contains
    /// (e.g. `lugre` that of `coulomb` and `viscous`) and keeps the values of what they share.
    ///
    /// # Errors
    /// An unknown effect or joint; an effect that is there already, or that a larger one there contains.
    pub fn add_effect(&mut self, id: &str, joint: Option<usize>, from: Option<usize>) -> Result<Added, EffectError> {
        let effect = effect(id).ok_or_else(|| UnknownName {
            kind: "effect",
            name: id.to_owned(),
            help: did_you_mean(id, effects().iter().map(|effect| effect.id.as_str())),
        })?;
        self.check_place(effect, joint, from)?;
        let label = instance_name(id, joint, from);
        if self.effects.iter().any(|other| other.is(id, joint, from)) {
            return Err(EffectError::Place {
                message: format!("the model has {label} already"),
                help: "change its parameters in the model file".to_owned(),
            });
        }
        let contains = |larger: &Effect, smaller: &str| larger.replaces.iter().any(|replaced| replaced.id == smaller);
        let same_place = |other: &EffectInstance| other.joint == joint && other.from == from && other.payload.is_none();
        for other in self.effects.iter().filter(|other| same_place(other)) {
            let rivals = effect.alternatives.is_some() && effect.alternatives == other.effect.alternatives;
            if contains(other.effect, id) || (rivals && !contains(effect, &other.effect.id)) {
                return Err(EffectError::Place {
                    message: format!("the model has {}, which takes the place of `{id}`", other.label()),
                    help: format!("remove {} first", other.label()),
                });
            }
        }
        let Some(mut added) = EffectInstance::new(self.device, id, joint, from) else {
            return Err(EffectError::Place {
                message: format!("`{id}` is no effect"),
                help: "see `dynid devices`".to_owned(),
            });
        };
        let mut carried = vec![false; added.parameters.len()];
        let mut replaced = Vec::new();
        let mut position = self.effects.len();
        for replacement in &effect.replaces {
            let found = self.effects.iter().position(|other| other.is(&replacement.id, joint, from));
            let Some(found) = found else { continue };
            let old = self.effects.remove(found);
            position = position.min(found).min(self.effects.len());
            replaced.push(old.label());
            for (own, theirs) in &replacement.carry {
                let target = effect.parameters.iter().position(|parameter| parameter.symbol == *own);
                if let (Some(target), Some(value)) = (target, old.value(theirs)) {
                    added.parameters[target] = holding(added.parameters[target], value);
                    carried[target] = true;
                }
            }
        }
        keep_inequalities(&mut added, &carried);
        let parameters = (0..added.parameters.len()).map(|index| added.parameter_name(index)).collect();
        self.effects.insert(position, added);
        self.forget_fit();
        Ok(Added { label, replaced, parameters })
    }

    /// As [`Model::add_effect`], the effect standing where it vanishes: every parameter that has a null value and is not
    /// taken over from an effect that it replaces is there.
    ///
    /// # Errors
    /// As [`Model::add_effect`].
    pub fn add_effect_at_null(
        &mut self,
        id: &str,
        joint: Option<usize>,
        from: Option<usize>,
    ) -> Result<Added, EffectError> {
        let before = self.clone();
        let added = self.add_effect(id, joint, from)?;
        if let Some(instance) = self.effects.iter_mut().find(|own| own.is(id, joint, from)) {
            let effect = instance.effect;
            let mut carried = vec![false; effect.parameters.len()];
            for (index, own) in effect.parameters.iter().enumerate() {
                carried[index] = before.hands_over(effect, &own.symbol, joint, from);
                if let Some(null) = own.null.filter(|_| !carried[index]) {
                    let default = instance.parameters[index];
                    instance.parameters[index] = holding(default, null);
                }
            }
            keep_inequalities(instance, &carried);
        }
        Ok(added)
    }

    /// Whether a parameter of `effect` takes its value from an effect that it would replace at this place.
    pub fn hands_over(&self, effect: &Effect, symbol: &str, joint: Option<usize>, from: Option<usize>) -> bool {
        effect.replaces.iter().any(|replaced| {
            replaced.carry.iter().any(|(own, _)| own == symbol)
                && self.effects.iter().any(|other| other.is(&replaced.id, joint, from))
        })
    }

    /// The model with the values of another of the same device, parameter by parameter; an effect in whose place the other
    /// has a larger one gets back what that carries over from it.
    #[must_use]
    pub fn with_values_of(&self, other: &Self) -> Self {
        let mut model = self.with_values(&|name| other.parameter(name).map(|parameter| parameter.value));
        for larger in other.effects.iter().filter(|larger| larger.payload.is_none()) {
            for smaller in &larger.effect.replaces {
                let own = model.effects.iter_mut().find(|own| own.is(&smaller.id, larger.joint, larger.from));
                let Some(own) = own else { continue };
                for (theirs, symbol) in &smaller.carry {
                    let place = own.effect.parameters.iter().position(|parameter| parameter.symbol == *symbol);
                    let Some((place, value)) = place.zip(larger.value(theirs)) else { continue };
                    let Parameter { lower, upper, fixed, .. } = own.parameters[place];
                    if !fixed {
                        own.parameters[place].value = value.clamp(lower, upper);
                    }
                }
            }
        }
        model
    }

    /// Takes an effect out.
    ///
    /// # Errors
    /// The model does not have it.
    pub fn remove_effect(&mut self, id: &str, joint: Option<usize>, from: Option<usize>) -> Result<(), EffectError> {
        let found = self.effects.iter().position(|other| other.is(id, joint, from));
        let Some(found) = found else {
            let labels: Vec<String> = self.effects.iter().map(EffectInstance::label).collect();
            return Err(EffectError::Place {
                message: format!("the model has no {}", instance_name(id, joint, from)),
                help: format!("it has {}", labels.join(", ")),
            });
        };
        self.effects.remove(found);
        self.forget_fit();
        Ok(())
    }

    /// What a fit found holds for the model that it was given; the prior values stay.
    fn forget_fit(&mut self) {
        self.fit = None;
        let names = self.names();
        self.prior.retain(|name, _| names.contains(name));
    }

    fn check_place(&self, effect: &Effect, joint: Option<usize>, from: Option<usize>) -> Result<(), EffectError> {
        let id = &effect.id;
        let wrong = |message: String, help: &str| Err(EffectError::Place { message, help: help.to_owned() });
        match (effect.scope, joint, from) {
            (Scope::Joint, Some(_), None) | (Scope::Pair, Some(_), Some(_)) | (Scope::Device, None, None) => {}
            (Scope::Joint, ..) => return wrong(format!("`{id}` acts on one joint"), "give `--joint <i>` alone"),
            (Scope::Pair, ..) => {
                return wrong(format!("`{id}` acts on a pair of joints"), "give `--joint <i>` and `--from <j>`");
            }
            (Scope::Device, ..) => return wrong(format!("`{id}` acts on the whole device"), "leave the joints out"),
        }
        for index in [joint, from].into_iter().flatten() {
            if index >= self.device.joints.len() {
                let last = self.device.joints.len() - 1;
                return wrong(
                    format!("device `{}` has no joint {index}", self.device.id),
                    &format!("its joints are 0 to {last}"),
                );
            }
        }
        if joint.is_some() && joint == from {
            return wrong(format!("`{id}` couples two different joints"), "give another `--from`");
        }
        Ok(())
    }
}

/// A carried value keeps the new parameter's bounds, widened to hold it.
fn holding(default: Parameter, value: f64) -> Parameter {
    super::widened(default, value)
}

/// A carried value may break an inequality with a first guess (`Fs > Fc`): the guess then keeps its ratio to the other.
fn keep_inequalities(added: &mut EffectInstance, carried: &[bool]) {
    let effect = added.effect;
    for (left, comparison, right) in &effect.inequalities {
        let index_of = |symbol: &str| effect.parameters.iter().position(|parameter| parameter.symbol == symbol);
        let (Some(left), Some(right)) = (index_of(left), index_of(right)) else { continue };
        let holds = comparison.holds(added.parameters[left].value, added.parameters[right].value);
        let (guess, known) = if carried[right] { (left, right) } else { (right, left) };
        if holds || carried[guess] {
            continue;
        }
        let ratio = effect.parameters[guess].initial / effect.parameters[known].initial;
        let value = added.parameters[known].value * ratio;
        added.parameters[guess] = holding(added.parameters[guess], value);
    }
}

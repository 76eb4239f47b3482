//! The user's model: a device, the effects that it is assumed to have, and parameter values, read from a TOML file and written
//! back ([`Model`], [`EffectInstance`]).
//!
//! - A model file lists all of its effects. A parameter that it does not state has the device's value, or the effect's first
//!   guess where the device has no such effect.
//! - Parameters have one order everywhere: links, lengths, gravity, then effects in the order of the file. Their names are those
//!   of `dynid-model` ("Names of parameters" there).
//! - A value outside bounds that the file states beside it is an error. A plain number outside the device's bounds widens them
//!   and leaves a line in [`Model::notes`].
//! - [`Model::to_toml`] keeps the comments, the order and the digits of the file that was read. [`Model::digest`] covers every
//!   parameter, but neither `[fit]` nor `[believed]`.
//! - [`Model::add_effect`] removes the effects that the new one's file lists under `[replaces]` and carries shared values over.
//! - [`FitRecord`] is the table `[fit]`: digests, costs, standard errors, flags, the method and its error budget. It holds no
//!   covariances.
//! - [`Model::prior`] is the table `[believed]`: the value that each fitted parameter had before the first fit of a series. It is
//!   kept by `add`, and a fit that does not converge from the model's values starts again from there.
//! - [`Model::system`] and [`Model::kinematics`] make what is computed with.

mod assemble;
mod clip;
mod edit;
mod fit_record;
mod payloads;
mod perturbed;
mod read;
#[cfg(test)]
mod tests;
mod write;

use std::collections::BTreeMap;

use dynid_model::{Device, Effect, JointKind, Link, Parameter, did_you_mean, instance::instance_name};

pub use edit::{Added, EffectError};
pub use fit_record::{ErrorShare, FitRecord, Source};
pub use payloads::UnknownPayload;
pub use read::device_of;

use dynid_format::UnknownName;

/// A device, the effects it is believed to have, and parameter values.
///
/// ```
/// use dynid_user_model::Model;
/// let mut model = Model::of_device(dynid_model::device("planar2r").expect("a shipped device"));
/// model.set_value("link.2.m", 0.8)?;
/// let again = Model::parse(&model.to_toml(), "planar.toml".as_ref()).expect("what it wrote itself");
/// assert_eq!(again.parameter("link.2.m").map(|mass| mass.value), Some(0.8));
/// # Ok::<(), dynid_format::UnknownName>(())
/// ```
#[derive(Debug, Clone)]
pub struct Model {
    /// The mechanism.
    pub device: &'static Device,
    /// As [`Device::links`], each in the order of [`Link::SYMBOLS`].
    pub links: Vec<[Parameter; 10]>,
    /// As [`Device::lengths`] \[m\].
    pub lengths: Vec<Parameter>,
    /// Gravity times the unit vector that points up, in the base frame [m/s^2].
    pub base: [Parameter; 3],
    /// In the order of the file.
    pub effects: Vec<EffectInstance>,
    /// How the values were found, if a fit found them.
    pub fit: Option<FitRecord>,
    /// The value that each fitted parameter had before the first fit of a series.
    pub prior: BTreeMap<String, f64>,
    /// What a person should know about the file, e.g. values outside the device's bounds.
    pub notes: Vec<String>,
    /// Text that the model was read from, kept so that writing it keeps its comments.
    origin: Option<String>,
}

/// An effect at its place, with its parameters.
#[derive(Debug, Clone)]
pub struct EffectInstance {
    /// The law.
    pub effect: &'static Effect,
    /// The joint it acts on; `None` for an effect of the whole device.
    pub joint: Option<usize>,
    /// The other joint of a pair.
    pub from: Option<usize>,
    /// It acts only in runs that carry the payload of this name; `None` for an effect of the machine, which always acts.
    pub payload: Option<String>,
    /// In the order of [`Effect::parameters`].
    pub parameters: Vec<Parameter>,
}

/// Components of gravity, as in parameter names.
const BASE_SYMBOLS: [&str; 3] = ["gx", "gy", "gz"];

impl Model {
    /// The device's default model.
    pub fn of_device(device: &'static Device) -> Self {
        let effects = device
            .effects
            .iter()
            .filter_map(|default| EffectInstance::new(device, &default.id, default.joint, default.from))
            .collect();
        Self {
            device,
            links: device.links.iter().map(|link| link.inertial).collect(),
            lengths: device.lengths.iter().map(|length| Parameter::known(length.value)).collect(),
            base: device.up.map(|component| Parameter::known(device.gravity * component)),
            effects,
            fit: None,
            prior: BTreeMap::new(),
            notes: Vec::new(),
            origin: None,
        }
    }

    /// Every parameter's name, in the model's order.
    pub fn names(&self) -> Vec<String> {
        self.places().into_iter().map(|(name, _)| name).collect()
    }

    /// Every parameter with its name, in the model's order.
    pub fn parameters(&self) -> Vec<(String, Parameter)> {
        self.places().into_iter().map(|(name, place)| (name, *self.at(place))).collect()
    }

    /// The parameter of that name.
    pub fn parameter(&self, name: &str) -> Option<Parameter> {
        self.place(name).map(|place| *self.at(place))
    }

    /// The value that the parameter of that name had before the first fit of a series; its own where none was fitted.
    pub fn prior(&self, name: &str) -> Option<f64> {
        self.prior.get(name).copied().or_else(|| self.parameter(name).map(|parameter| parameter.value))
    }

    /// The model with other values of the parameters that are not fixed, within their bounds; those for which `value` is
    /// `None` stay.
    pub fn with_values(&self, value: &dyn Fn(&str) -> Option<f64>) -> Self {
        let mut model = self.clone();
        for (name, parameter) in self.parameters().into_iter().filter(|(_, parameter)| !parameter.fixed) {
            if let Some(value) = value(&name) {
                // The name is the model's own.
                let _ = model.set_value(&name, value.clamp(parameter.lower, parameter.upper));
            }
        }
        model
    }

    /// The model with the prior values before the first fit of a series; `None` where those are its own.
    pub fn at_prior(&self) -> Option<Self> {
        let prior = self.with_values(&|name| self.prior(name));
        (prior.digest() != self.digest()).then_some(prior)
    }

    /// The parameter of that name.
    ///
    /// # Errors
    /// [`UnknownName`], with the nearest name.
    pub fn require(&self, name: &str) -> Result<Parameter, UnknownName> {
        self.parameter(name).ok_or_else(|| self.unknown(name))
    }

    /// Changes a value, not its bounds.
    ///
    /// # Errors
    /// [`UnknownName`], with the nearest name.
    pub fn set_value(&mut self, name: &str, value: f64) -> Result<(), UnknownName> {
        let parameter = self.require(name)?;
        self.set(name, Parameter { value, ..parameter })
    }

    /// Changes a parameter.
    ///
    /// # Errors
    /// [`UnknownName`], with the nearest name.
    pub fn set(&mut self, name: &str, parameter: Parameter) -> Result<(), UnknownName> {
        let place = self.place(name).ok_or_else(|| self.unknown(name))?;
        *self.at_mut(place) = parameter;
        Ok(())
    }

    /// The unit of the parameter of that name, e.g. `N*m*s/rad`.
    pub fn unit(&self, name: &str) -> Option<String> {
        Some(match self.place(name)? {
            ParameterPlace::Link(_, 0) => "kg".to_owned(),
            ParameterPlace::Link(_, 1..=3) | ParameterPlace::Length(_) => "m".to_owned(),
            ParameterPlace::Link(..) => "kg*m^2".to_owned(),
            ParameterPlace::Base(_) => "m/s^2".to_owned(),
            ParameterPlace::Effect(instance, index) => {
                let instance = &self.effects[instance];
                let joint = instance.joint.map(|joint| &self.device.joints[joint]);
                let kind = joint.map_or(JointKind::Revolute, |joint| joint.kind);
                let command = joint.map_or("command", |joint| joint.command_unit.as_str());
                instance.effect.parameters[index].unit_at(kind, command)
            }
        })
    }

    /// The machine's own effects at a joint (of a pair: its `joint`), in the order of the file.
    pub fn effects_at(&self, joint: usize) -> impl Iterator<Item = &EffectInstance> {
        self.effects.iter().filter(move |instance| instance.joint == Some(joint) && instance.payload.is_none())
    }

    fn unknown(&self, name: &str) -> UnknownName {
        let names = self.names();
        UnknownName {
            kind: "parameter",
            name: name.to_owned(),
            help: did_you_mean(name, names.iter().map(String::as_str)),
        }
    }

    fn places(&self) -> Vec<(String, ParameterPlace)> {
        let mut places = Vec::new();
        for link in 0..self.links.len() {
            for (index, symbol) in Link::SYMBOLS.iter().enumerate() {
                places.push((format!("link.{}.{symbol}", link + 1), ParameterPlace::Link(link, index)));
            }
        }
        for (index, length) in self.device.lengths.iter().enumerate() {
            places.push((format!("length.{}", length.symbol), ParameterPlace::Length(index)));
        }
        for (axis, symbol) in BASE_SYMBOLS.iter().enumerate() {
            if self.device.up[axis] != 0.0 {
                places.push((format!("base.{symbol}"), ParameterPlace::Base(axis)));
            }
        }
        for (instance, effect) in self.effects.iter().enumerate() {
            for index in 0..effect.parameters.len() {
                places.push((effect.parameter_name(index), ParameterPlace::Effect(instance, index)));
            }
        }
        places
    }

    /// As [`Model::places`], without making every name: fits set parameters by name in their inner loops.
    fn place(&self, name: &str) -> Option<ParameterPlace> {
        let parts: Vec<&str> = name.split('.').collect();
        let number = |text: &str| text.parse::<usize>().ok().filter(|number| number.to_string() == text);
        let effect = |id: &str, joint: Option<usize>, from: Option<usize>, symbol: &str| {
            let (id, payload) = id.split_once('@').map_or((id, None), |(id, payload)| (id, Some(payload)));
            let is_it = |own: &EffectInstance| own.stands_at(id, joint, from) && own.payload.as_deref() == payload;
            let instance = self.effects.iter().position(is_it)?;
            let own = &self.effects[instance].effect.parameters;
            Some(ParameterPlace::Effect(instance, own.iter().position(|parameter| parameter.symbol == symbol)?))
        };
        match parts.as_slice() {
            ["link", link, symbol] => {
                let link = number(link)?.checked_sub(1).filter(|link| *link < self.links.len())?;
                Some(ParameterPlace::Link(link, Link::SYMBOLS.iter().position(|own| own == symbol)?))
            }
            ["length", symbol] => {
                self.device.lengths.iter().position(|length| length.symbol == *symbol).map(ParameterPlace::Length)
            }
            ["base", symbol] => {
                let axis = BASE_SYMBOLS.iter().position(|own| own == symbol)?;
                (self.device.up[axis] != 0.0).then_some(ParameterPlace::Base(axis))
            }
            ["joint", joint, id, symbol] => effect(id, Some(number(joint)?), None, symbol),
            ["joint", joint, id, from, symbol] => effect(id, Some(number(joint)?), Some(number(from)?), symbol),
            ["device", id, symbol] => effect(id, None, None, symbol),
            _ => None,
        }
    }

    fn at(&self, place: ParameterPlace) -> &Parameter {
        match place {
            ParameterPlace::Link(link, index) => &self.links[link][index],
            ParameterPlace::Length(index) => &self.lengths[index],
            ParameterPlace::Base(axis) => &self.base[axis],
            ParameterPlace::Effect(instance, index) => &self.effects[instance].parameters[index],
        }
    }

    fn at_mut(&mut self, place: ParameterPlace) -> &mut Parameter {
        match place {
            ParameterPlace::Link(link, index) => &mut self.links[link][index],
            ParameterPlace::Length(index) => &mut self.lengths[index],
            ParameterPlace::Base(axis) => &mut self.base[axis],
            ParameterPlace::Effect(instance, index) => &mut self.effects[instance].parameters[index],
        }
    }
}

#[derive(Debug, Clone, Copy)]
enum ParameterPlace {
    Link(usize, usize),
    Length(usize),
    Base(usize),
    Effect(usize, usize),
}

impl EffectInstance {
    /// The effect with the device's values, or its own first guesses; `None` for an unknown id.
    pub fn new(device: &Device, id: &str, joint: Option<usize>, from: Option<usize>) -> Option<Self> {
        let effect = dynid_model::effect(id)?;
        let parameters = effect
            .parameters
            .iter()
            .map(|own| default_parameter(device, effect, (joint, from), &own.symbol).unwrap_or_else(|| own.parameter()))
            .collect();
        Some(Self { effect, joint, from, payload: None, parameters })
    }

    /// The value of a parameter by its symbol.
    pub fn value(&self, symbol: &str) -> Option<f64> {
        let index = self.effect.parameters.iter().position(|parameter| parameter.symbol == symbol)?;
        self.parameters.get(index).map(|parameter| parameter.value)
    }

    /// The values in the order in which kernels take them.
    pub fn values(&self) -> Vec<f64> {
        self.parameters.iter().map(|parameter| parameter.value).collect()
    }

    /// `joint.3.lugre.sigma0`, `joint.4.input_coupling.5.gain`, `joint.5.payload@box.m`, `device.<effect>.<symbol>`.
    pub fn parameter_name(&self, index: usize) -> String {
        format!("{}.{}", self.place_name(), self.effect.parameters[index].symbol)
    }

    /// A parameter's name without its symbol: `joint.3.lugre`, `joint.4.input_coupling.5`, `joint.5.payload@box`.
    pub fn place_name(&self) -> String {
        let payload = self.payload.iter().map(|name| format!("@{name}"));
        let id: String = std::iter::once(self.effect.id.clone()).chain(payload).collect();
        match (self.joint, self.from) {
            (Some(joint), Some(from)) => format!("joint.{joint}.{id}.{from}"),
            (Some(joint), None) => format!("joint.{joint}.{id}"),
            _ => format!("device.{id}"),
        }
    }

    /// "`lugre` at joint 3", "`payload` at joint 5 with `box`", for messages.
    pub fn label(&self) -> String {
        let place = instance_name(&self.effect.id, self.joint, self.from);
        self.payload.as_ref().map_or(place.clone(), |name| format!("{place} with `{name}`"))
    }

    /// Whether both are the same effect at the same place, whatever their values.
    pub fn is_same_place(&self, other: &Self) -> bool {
        other.stands_at(&self.effect.id, self.joint, self.from) && self.payload == other.payload
    }

    /// Whether it acts in a run that carries `payload`, or nothing.
    pub fn acts_with(&self, payload: Option<&str>) -> bool {
        self.payload.is_none() || self.payload.as_deref() == payload
    }

    /// Whether it is this effect of the machine at this place.
    pub fn is(&self, id: &str, joint: Option<usize>, from: Option<usize>) -> bool {
        self.stands_at(id, joint, from) && self.payload.is_none()
    }

    fn stands_at(&self, id: &str, joint: Option<usize>, from: Option<usize>) -> bool {
        self.effect.id == id && self.joint == joint && self.from == from
    }
}

/// What a parameter is where a model file does not state it: the device's, if its default model has this effect at this
/// place, or the effect's own first guess.
fn default_parameter(
    device: &Device,
    effect: &Effect,
    (joint, from): (Option<usize>, Option<usize>),
    symbol: &str,
) -> Option<Parameter> {
    let own = effect.parameter(symbol)?.parameter();
    let of_device = device
        .effects
        .iter()
        .find(|default| default.id == effect.id && default.joint == joint && default.from == from)
        .and_then(|default| default.values.iter().find(|(name, _)| name == symbol));
    Some(of_device.map_or(own, |(_, parameter)| *parameter))
}

/// Default bounds, widened so that a stated value lies within.
fn widened(default: Parameter, value: f64) -> Parameter {
    Parameter { value, lower: default.lower.min(value), upper: default.upper.max(value), fixed: default.fixed }
}

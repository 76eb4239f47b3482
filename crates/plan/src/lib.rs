//! Planning of an identification: which joints to lock and free, in which order, and which parameters each configuration reveals
//! ([`plan`], [`sequence`]; the thesis's Figure 4.2).
//!
//! - [`linear`]: the parameters in which the torques are linear, and the regressor;
//! - [`base`]: base parameters, the identifiable combinations, with exact factors ([`base::base_parameters`]);
//! - [`symbolic`]: recognises these factors as polynomials in the lengths;
//! - [`unidentifiable`]: directions in the space of parameters that change no motion.
//!
//! A method is one of the device's, or [`FOUND`]: then the next configuration is the one with the fewest new unknowns that still
//! reveals something.
//!
//! A link parameter *appears* in a configuration when it stands in the equations of motion of its free joints, the angles of
//! the locked joints being general: what ships knows it by algebra, of other kernels it is found by moving each. Appearing is not
//! being identifiable: parameters may act only together.

pub mod base;
mod found;
pub mod linear;
pub mod symbolic;
pub mod unidentifiable;

use std::collections::{BTreeMap, BTreeSet};

use dynid_generated::Kernel;
use dynid_kernels::KernelError;
use dynid_model::{Link, Method};

use dynid_dynamics::system::SystemError;
use dynid_format::UnknownName;
use dynid_user_model::Model;

/// A method's steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Name of the method.
    pub method: String,
    /// In order.
    pub steps: Vec<Step>,
    /// Link parameters that appear in no step.
    pub never: Vec<String>,
    /// What no step reveals.
    pub unreachable: Vec<Unreachable>,
}

/// Why no experiment can reveal a parameter.
pub const NOWHERE: &str = "it stands in no equation of motion";

/// A parameter that no step reveals.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unreachable {
    /// E.g. `link.1.Ixx`.
    pub name: String,
    /// The reason.
    pub why: &'static str,
}

/// One step: a configuration and what it depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Place in the method, from 1.
    pub number: usize,
    /// Number of the device's configuration, from 1.
    pub configuration: usize,
    /// Free joints.
    pub free: Vec<usize>,
    /// Everything that its equations depend on and that may be unknown, in the model's order.
    pub parameters: Vec<String>,
    /// Those of them that no earlier step had.
    pub new_parameters: Vec<String>,
}

/// Why nothing can be planned.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// A model and free joints that do not make equations.
    #[error(transparent)]
    System(#[from] SystemError),
    /// Free joints without a kernel.
    #[error(transparent)]
    Kernel(#[from] KernelError),
    /// A method that the device does not have.
    #[error(transparent)]
    UnknownMethod(#[from] UnknownName),
}

/// Name of the method whose sequence the program finds itself.
pub const FOUND: &str = "found";

/// The configurations of a method, in order, by number from 1. Every device has the method [`FOUND`].
///
/// # Errors
/// The device has no such method; for [`FOUND`] also one without a configuration.
pub fn sequence(model: &Model, method: &str) -> Result<Vec<usize>, PlanError> {
    let methods = &model.device.methods;
    if let Some(Method { sequence, .. }) = methods.iter().find(|known| known.name == method) {
        return Ok(sequence.clone());
    }
    if method == FOUND {
        return found::sequence(model);
    }
    let known = methods.iter().map(|known| known.name.as_str()).chain([FOUND]);
    Err(UnknownName::among("method", method, known).into())
}

/// The method that a device is planned by unless another is asked for: its first, else [`FOUND`].
pub fn default_method(model: &Model) -> &str {
    model.device.methods.first().map_or(FOUND, |method| &method.name)
}

/// The steps of a method of the model's device.
///
/// # Errors
/// The device has no such method, or a configuration has no kernel.
pub fn plan(model: &Model, method: &str) -> Result<Plan, PlanError> {
    let device = model.device;
    let sequence = sequence(model, method)?;
    let mut seen = BTreeSet::new();
    let mut steps = Vec::new();
    for (number, &configuration) in (1..).zip(&sequence) {
        let free = device.configurations.get(configuration - 1).map_or_else(Vec::new, |known| known.free.clone());
        let kernel = dynid_kernels::kernel(device, &free)?;
        let parameters = depends_on(model, kernel);
        let new_parameters = parameters.iter().filter(|name| seen.insert((*name).clone())).cloned().collect();
        steps.push(Step { number, configuration, free, parameters, new_parameters });
    }
    let links = model.names().into_iter().filter(|name| name.starts_with("link."));
    let never = links.filter(|name| !seen.contains(name)).collect();
    let unreachable = unreachable(model, &seen)?;
    Ok(Plan { method: method.to_owned(), steps, never, unreachable })
}

/// What no step reveals, and why.
fn unreachable(model: &Model, seen: &BTreeSet<String>) -> Result<Vec<Unreachable>, PlanError> {
    let everywhere: Vec<usize> = (0..model.device.joints.len()).collect();
    let together = dynid_kernels::kernel(model.device, &everywhere)?;
    let mut anywhere = BTreeSet::new();
    for configuration in &model.device.configurations {
        anywhere.extend(depends_on(model, dynid_kernels::kernel(model.device, &configuration.free)?));
    }
    let mut unreachable = Vec::new();
    for (name, parameter) in model.parameters() {
        let known = name.starts_with("length.") || name.starts_with("base.") || parameter.fixed;
        if seen.contains(&name) || (known && !name.starts_with("link.")) {
            continue;
        }
        let why = if anywhere.contains(&name) {
            "another configuration of the device reveals it"
        } else if !name.starts_with("link.") {
            "its joints are free in no configuration"
        } else if together.appearing.contains(&name.as_str()) {
            "it acts where joints move together that no configuration frees together"
        } else {
            NOWHERE
        };
        unreachable.push(Unreachable { name, why });
    }
    Ok(unreachable)
}

/// Link parameters that appear, then those parameters of the free joints' effects that may be unknown.
fn depends_on(model: &Model, kernel: &Kernel) -> Vec<String> {
    let links = appearing(kernel);
    let mut parameters: Vec<String> = model.names().into_iter().filter(|name| links.contains(name)).collect();
    for instance in model.effects.iter().filter(|own| own.acts_with(None)) {
        let acts = [instance.joint, instance.from].into_iter().flatten().any(|joint| kernel.free.contains(&joint));
        if acts || (instance.joint.is_none() && instance.from.is_none()) {
            let unknown = instance.parameters.iter().enumerate().filter(|(_, parameter)| !parameter.fixed);
            parameters.extend(unknown.map(|(index, _)| instance.parameter_name(index)));
        }
    }
    parameters
}

/// Names of the link parameters on which the torques of the kernel's free joints depend.
pub fn appearing(kernel: &Kernel) -> BTreeSet<String> {
    let links = kernel.appearing.iter().filter(|name| name.starts_with("link."));
    links.map(|name| (*name).to_owned()).collect()
}

impl Plan {
    /// Step in which each link parameter first appears: per link, in the order of [`Link::SYMBOLS`].
    pub fn first_steps(&self, n_links: usize) -> Vec<[Option<usize>; 10]> {
        let mut first: BTreeMap<&str, usize> = BTreeMap::new();
        for step in &self.steps {
            for name in &step.new_parameters {
                first.insert(name, step.number);
            }
        }
        (1..=n_links)
            .map(|link| Link::SYMBOLS.map(|symbol| first.get(format!("link.{link}.{symbol}").as_str()).copied()))
            .collect()
    }
}

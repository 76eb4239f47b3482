//! Which parameters each configuration reveals: a method's steps, and what is new in each (the thesis's Figure 4.2).
//!
//! A link parameter *appears* in a configuration when it stands in the equations of motion of its free joints, angles of
//! the locked joints being general and `s^2 + c^2 = 1` being reduced: derive found that by algebra. Appearing is not
//! being identifiable: parameters may act only together.

use std::collections::{BTreeMap, BTreeSet};

use dynid_generated::Kernel;
use dynid_model::{Link, Method, did_you_mean};

use crate::{error::Error, model::Model, system::SystemError};

/// A method's steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Name of the method.
    pub method: String,
    /// In order.
    pub steps: Vec<Step>,
    /// Link parameters that appear in no step.
    pub never: Vec<String>,
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

/// The steps of a method of the model's device.
///
/// # Errors
/// The device has no such method, or a configuration has no kernel.
pub fn plan(model: &Model, method: &str) -> Result<Plan, Error> {
    let device = model.device;
    let Some(Method { name, sequence, .. }) = device.methods.iter().find(|known| known.name == method) else {
        return Err(Error::UnknownName {
            kind: "method",
            name: method.to_owned(),
            help: did_you_mean(method, device.methods.iter().map(|known| known.name.as_str())),
        });
    };
    let mut seen = BTreeSet::new();
    let mut steps = Vec::new();
    for (number, &configuration) in (1..).zip(sequence) {
        let free = device.configurations.get(configuration - 1).map_or_else(Vec::new, |known| known.free.clone());
        let kernel = dynid_generated::kernel(&device.id, configuration).ok_or_else(|| {
            Error::from(SystemError::NoConfiguration {
                device: device.id.clone(),
                free: free.clone(),
                known: device.configurations.iter().map(|known| known.free.clone()).collect(),
            })
        })?;
        let parameters = depends_on(model, kernel);
        let new_parameters = parameters.iter().filter(|name| seen.insert((*name).clone())).cloned().collect();
        steps.push(Step { number, configuration, free, parameters, new_parameters });
    }
    let links = model.names().into_iter().filter(|name| name.starts_with("link."));
    Ok(Plan { method: name.clone(), steps, never: links.filter(|name| !seen.contains(name)).collect() })
}

/// Link parameters that appear, then those parameters of the free joints' effects that may be unknown.
fn depends_on(model: &Model, kernel: &Kernel) -> Vec<String> {
    let links = appearing(kernel);
    let mut parameters: Vec<String> = model.names().into_iter().filter(|name| links.contains(name)).collect();
    for instance in &model.effects {
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
    let Some(structure) = dynid_generated::structure(kernel.device) else { return BTreeSet::new() };
    let links = kernel.parameters.iter().filter(|name| name.starts_with("link."));
    links.filter(|name| structure.appears(name, kernel.free)).map(|name| (*name).to_owned()).collect()
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

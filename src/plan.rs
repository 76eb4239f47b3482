//! Which parameters each configuration reveals: a method's steps, and what is new in each (the thesis's Figure 4.2).
//!
//! A link parameter *appears* in a configuration when the torques of its free joints change with it in some state:
//! `d tau / d p = Y(q, dq, ddq) d lumps / d p` from the configuration's own kernel, with general angles of the locked
//! joints. It is judged at random states, lengths and gravity, where a sum that vanishes identically (`s^2 + c^2 - 1`)
//! leaves rounding alone and any other sum leaves something, so the answer is exact but for coincidences of
//! probability zero. Appearing is not being identifiable: parameters may act only together.

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

/// Random states that are looked at.
const STATES: usize = 6;
/// A derivative below this share of the largest one is rounding; values, angles and rates are all of order one.
const ROUNDING: f64 = 1e-9;

/// Names of the link parameters on which the torques of the kernel's free joints depend.
pub fn appearing(kernel: &Kernel) -> BTreeSet<String> {
    let (n, n_lumps, n_parameters) = (kernel.free.len(), kernel.n_lumps, kernel.parameters.len());
    let mut random = Random { state: 0x5EED };
    let mut appearing = BTreeSet::new();
    for _ in 0..STATES {
        let parameters: Vec<f64> = (0..n_parameters).map(|_| random.between(0.5, 1.5)).collect();
        let locked: Vec<f64> = kernel.locked.iter().map(|_| random.between(-3.0, 3.0)).collect();
        let [q, dq, ddq]: [Vec<f64>; 3] = std::array::from_fn(|_| (0..n).map(|_| random.between(-3.0, 3.0)).collect());
        let mut prepared = vec![0.0; kernel.prepared.len()];
        (kernel.prepare)(&parameters, &locked, &mut prepared);
        let mut by_parameter = vec![0.0; kernel.prepared.len() * n_parameters];
        (kernel.prepare_gradient)(&parameters, &locked, &mut by_parameter);
        let mut regressor = vec![0.0; n * n_lumps];
        (kernel.regressor)(&prepared, &q, &dq, &ddq, &mut regressor);
        let links = || kernel.parameters.iter().enumerate().filter(|(_, name)| name.starts_with("link."));
        let derivative = |row: usize, column: usize| {
            let lumps = 0..n_lumps;
            lumps.map(|lump| regressor[row * n_lumps + lump] * by_parameter[lump * n_parameters + column]).sum::<f64>()
        };
        let entries: Vec<(&str, f64)> = links()
            .flat_map(|(column, name)| (0..n).map(move |row| (*name, row, column)))
            .map(|(name, row, column)| (name, derivative(row, column).abs()))
            .collect();
        let largest = entries.iter().fold(0.0, |largest: f64, (_, size)| largest.max(*size));
        let seen = entries.into_iter().filter(|(_, size)| *size > ROUNDING * largest);
        appearing.extend(seen.map(|(name, _)| name.to_owned()));
    }
    appearing
}

/// SplitMix64 (Steele, Lea & Flood 2014): the same states in every run.
struct Random {
    state: u64,
}

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.state;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        bits ^= bits >> 31;
        low + (high - low) * (bits >> 11) as f64 / (1_u64 << 53) as f64
    }
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

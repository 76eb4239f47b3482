//! Bodies that join a link, such as a payload.
//!
//! A kernel's lumps are linear in a link's mass, first moment and inertia about the frame's origin, and these add up when
//! bodies are joined. So a body adds what `prepare` makes of a device that consists of it alone; nothing is divided by
//! a mass, and a body without one adds exactly nothing.

use dynid_generated::{Kernel, N_SIGNALS};
use dynid_signal_chain::LINK_SYMBOLS;

use super::{Element, MAX_OUTPUTS, NONE, Output, PlacedEffect, System};

/// A body's effect and where its numbers go.
#[derive(Clone)]
pub(super) struct Body {
    element: Element,
    /// Output, and the kernel's parameter of the link that it stands for.
    places: Vec<(usize, usize)>,
}

impl Body {
    /// `None` for an effect that is none, or whose link the kernel does not know.
    pub(super) fn new(effect: &PlacedEffect, element: &Element, kernel: &Kernel) -> Option<Self> {
        let link = effect.link?;
        let place = |(index, output): (usize, &Output)| {
            let Output::Body(symbol) = output else { return None };
            let name = format!("link.{link}.{}", LINK_SYMBOLS.get(*symbol)?);
            Some((index, kernel.parameters.iter().position(|known| *known == name)?))
        };
        let places: Vec<(usize, usize)> = effect.outputs.iter().enumerate().filter_map(place).collect();
        (!places.is_empty()).then(|| Self { element: element.clone(), places })
    }
}

impl System {
    /// Adds the bodies to what the kernel has prepared, and notes how that changes with their parameters.
    pub(super) fn join_bodies(&mut self) {
        self.lumps_by_parameter.clear();
        if self.bodies.is_empty() {
            return;
        }
        let kernel = self.kernel;
        let n_parameters = kernel.parameters.len();
        let is_of_link = |name: &str| name.starts_with("link.");
        let mut massless = self.link_parameters.clone();
        for (value, _) in massless.iter_mut().zip(kernel.parameters).filter(|(_, name)| is_of_link(name)) {
            *value = 0.0;
        }
        let (mut with, mut without) = (vec![0.0; self.prepared.len()], vec![0.0; self.prepared.len()]);
        let mut by_link = vec![0.0; self.prepared.len() * n_parameters];
        kernel.functions.prepare(&massless, &self.locked, &mut without);
        for body in &self.bodies {
            let Body { element, places } = body;
            let parameters = &self.effect_parameters[element.p..element.p + element.np];
            let mut outputs = [0.0; MAX_OUTPUTS];
            let n_outputs = element.kernel.n_outputs;
            let columns = element.np + N_SIGNALS;
            let mut jacobian = vec![0.0; n_outputs * columns];
            let signals = [0.0; N_SIGNALS];
            let outputs = &mut outputs[..n_outputs];
            element.kernel.functions.eval_gradient(parameters, &signals, &[], outputs, &mut [], &mut jacobian);
            let mut alone = massless.clone();
            places.iter().for_each(|&(output, place)| alone[place] = outputs[output]);
            kernel.functions.prepare(&alone, &self.locked, &mut with);
            kernel.functions.prepare_gradient(&alone, &self.locked, &mut by_link);
            for (prepared, (with, without)) in self.prepared.iter_mut().zip(with.iter().zip(&without)) {
                *prepared += with - without;
            }
            for parameter in 0..element.np {
                let by_parameter = |lump: usize| -> f64 {
                    let chain = |&(output, place): &(usize, usize)| {
                        by_link[lump * n_parameters + place] * jacobian[output * columns + parameter]
                    };
                    places.iter().map(chain).sum()
                };
                let lumps = (0..kernel.n_lumps).map(by_parameter).collect();
                self.lumps_by_parameter.push((element.p + parameter, lumps));
            }
        }
    }

    /// True where an effect's outputs are those of a body.
    pub(super) fn is_body(effect: &PlacedEffect) -> bool {
        effect.outputs.iter().any(|output| matches!(output, Output::Body(_)))
    }

    /// Derivatives of the lumps by the parameters of bodies: effect parameter and one value a lump.
    pub(super) fn lumps_by_parameter(&self) -> &[(usize, Vec<f64>)] {
        &self.lumps_by_parameter
    }

    /// A link effect that acts on no joint by itself.
    pub(super) fn adds_inertia(element: &Element) -> bool {
        element.torque != NONE && element.joint.slot != NONE
    }
}

//! Commands that arrive late.

use dynid_generated::N_SIGNALS;

use super::{Element, System};

/// A joint whose commands arrive late.
#[derive(Clone)]
pub struct Delay {
    /// The device's joint index.
    pub joint: usize,
    /// By how much (s).
    pub span_s: f64,
    /// Its derivatives: effect parameter and value.
    pub by_parameter: Vec<(usize, f64)>,
    pub(super) element: Element,
}

impl Delay {
    pub(super) fn new(joint: usize, element: Element) -> Self {
        Self { joint, span_s: 0.0, by_parameter: Vec::new(), element }
    }

    /// Brings it up to date.
    pub(super) fn prepare(&mut self, effect_parameters: &[f64]) {
        let Element { kernel, p, np, torque: output, .. } = self.element;
        let mut outputs = vec![0.0; kernel.n_outputs];
        let columns = np + N_SIGNALS;
        let mut jacobian = vec![0.0; kernel.n_outputs * columns];
        let parameters = &effect_parameters[p..p + np];
        kernel.functions.eval_gradient(parameters, &[0.0; N_SIGNALS], &[], &mut outputs, &mut [], &mut jacobian);
        // What has not been commanded yet cannot arrive.
        let comes_late = outputs[output] > 0.0;
        self.span_s = if comes_late { outputs[output] } else { 0.0 };
        self.by_parameter = (0..np).map(|k| (p + k, jacobian[output * columns + k])).collect();
    }
}

impl System {
    /// Joints whose commands arrive late; whoever integrates hands the commands over as they arrive.
    pub fn delays(&self) -> &[Delay] {
        &self.delays
    }
}

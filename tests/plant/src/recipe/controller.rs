//! What moves a machine in closed loop: sampled proportional and filtered derivative action on the position error.
//!
//! `tau[k] = P e[k] + D f[k]` with `e = reference - shown`, `de[k] = (e[k] - e[k-1]) / sample_s`, `de[0] = 0`, and
//! `f[k] = s f[k-1] + (1 - s) de[k-1]`: a low-pass filter of first order that answers one sample late. A controller file
//! writes it as `a2 = -s`, `b1 = 1 - s`, the rest 0.

use serde::{Deserialize, Serialize};

use super::as_logged;

/// Gains of all joints and a filter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Controller {
    /// N*m/rad or N/m
    pub proportional: Vec<f64>,
    /// N*m*s/rad or N*s/m
    pub derivative: Vec<f64>,
    /// `s`, from 0 for no filter to below 1.
    pub smoothing: f64,
}

impl Controller {
    pub(super) fn check(&self, n_joints: usize) -> Result<(), String> {
        for gains in [&self.proportional, &self.derivative] {
            if gains.len() != n_joints {
                return Err(format!("the controller has {} gains for {n_joints} joints", gains.len()));
            }
        }
        if (0.0..1.0).contains(&self.smoothing) { Ok(()) } else { Err("`smoothing` is not in 0..1".to_owned()) }
    }

    /// `controller.toml`.
    pub(super) fn file(&self, quantum: f64) -> String {
        let Self { proportional, derivative, smoothing } = self;
        let mut text = format!(
            "P = {proportional:?}\nD = {derivative:?}\nfilter = {{ a2 = {:?}, a3 = 0.0, b1 = {:?}, b2 = 0.0 }}\n",
            -smoothing,
            1.0 - smoothing
        );
        if quantum > 0.0 {
            text.push_str(&format!("position_quantum = {quantum:?}\n"));
        }
        text
    }
}

/// A controller at work on the free joints.
pub(super) struct Loop<'a> {
    controller: &'a Controller,
    free: &'a [usize],
    /// Of each free joint: the last error, its rate, the filtered rate.
    past: Vec<Option<[f64; 3]>>,
}

impl<'a> Loop<'a> {
    pub(super) fn new(controller: &'a Controller, free: &'a [usize]) -> Self {
        Self { controller, free, past: vec![None; free.len()] }
    }

    /// Torques of all `n_joints` joints; `reference` is of all, `shown` of the free ones.
    pub(super) fn command(&mut self, sample_s: f64, reference: &[f64], shown: &[f64], n_joints: usize) -> Vec<f64> {
        let Controller { proportional, derivative, smoothing } = self.controller;
        let mut commands = vec![0.0; n_joints];
        for ((&joint, shown), past) in self.free.iter().zip(shown).zip(&mut self.past) {
            let error = reference[joint] - shown;
            let (rate, filtered) = match *past {
                Some([last, rate, filtered]) => {
                    ((error - last) / sample_s, smoothing * filtered + (1.0 - smoothing) * rate)
                }
                None => (0.0, 0.0),
            };
            *past = Some([error, rate, filtered]);
            commands[joint] = as_logged(proportional[joint] * error + derivative[joint] * filtered);
        }
        commands
    }
}

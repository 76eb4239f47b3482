//! Sampled joint control: proportional and filtered derivative action on the position error (thesis section 4.5).
//!
//! At every sample k: `e = ref - q`, `de[k] = (e[k] - e[k-1]) / (t[k] - t[k-1])` with `de[0] = 0`,
//! `f[k] = -a2 f[k-1] - a3 f[k-2] + b1 de[k-1] + b2 de[k-2]` (Eq. 4.7), `tau[k] = P e[k] + D f[k]`, held until the next
//! sample. The controller sees what the log shows: positions through the sensors, rounded to the log's quantum.

use std::f64::consts::FRAC_1_SQRT_2;

use super::{Course, Input, Intersample, Options, Recorder, SimulationError, Stepper, Trajectory, check};
use crate::system::System;

/// A controller's gains, filter and limits.
#[derive(Debug, Clone, PartialEq)]
pub struct Controller {
    /// Proportional gain of each joint of the device [N*m/rad or N/m].
    pub proportional: Vec<f64>,
    /// Derivative gain of each joint [N*m*s/rad or N*s/m].
    pub derivative: Vec<f64>,
    /// The filter of the error's derivative.
    pub filter: Filter,
    /// Largest torque of each joint; `inf` where there is no limit.
    pub limit: Vec<f64>,
    /// Positions reach the controller in whole multiples of this [rad or m]; 0 for exact ones.
    pub position_quantum: f64,
    /// Torques leave it in whole multiples of this; 0 for exact ones.
    pub torque_quantum: f64,
}

/// A second-order low-pass filter with one sample of delay (Eq. 4.7, with `a1 = 1`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filter {
    /// Factor on the last output, on the left-hand side.
    pub a2: f64,
    /// Factor on the output before it.
    pub a3: f64,
    /// Factor on the last input.
    pub b1: f64,
    /// Factor on the input before it.
    pub b2: f64,
}

impl Filter {
    /// The thesis's filter: 15 Hz at 100 samples a second, coefficients as printed.
    pub const THESIS: Self = Self { a2: -0.8073, a3: 0.2638, b1: 0.2789, b2: 0.1775 };

    /// The output (Eq. 4.7) after the last two inputs and the last two outputs, the later of each first.
    pub fn output(&self, [input1, input2, output1, output2]: [f64; 4]) -> f64 {
        -self.a2 * output1 - self.a3 * output2 + self.b1 * input1 + self.b2 * input2
    }

    /// The step-invariant Butterworth filter of second order, which the thesis's is.
    pub fn butterworth(cutoff_hz: f64, sample_s: f64) -> Self {
        let decay = std::f64::consts::TAU * cutoff_hz * sample_s * FRAC_1_SQRT_2;
        let (sine, cosine) = decay.sin_cos();
        let shrink = (-decay).exp();
        Self {
            a2: -2.0 * shrink * cosine,
            a3: shrink * shrink,
            b1: 1.0 - shrink * (cosine + sine),
            b2: shrink * shrink + shrink * (sine - cosine),
        }
    }
}

/// A controller at work on the free joints.
struct Loop<'a> {
    controller: &'a Controller,
    free: &'a [usize],
    last_error: Vec<f64>,
    /// `de[k-1]`, `de[k-2]`, `f[k-1]`, `f[k-2]` of each free joint.
    past: Vec<[f64; 4]>,
}

impl<'a> Loop<'a> {
    fn new(controller: &'a Controller, free: &'a [usize]) -> Self {
        Self { controller, free, last_error: vec![f64::NAN; free.len()], past: vec![[0.0; 4]; free.len()] }
    }

    /// The torques of the sample at which the log shows `position`; `elapsed_s` since the last one.
    fn command(&mut self, elapsed_s: f64, reference: &[f64], position: &[f64], command: &mut [f64]) {
        let Controller { proportional, derivative, filter, limit, .. } = self.controller;
        for (slot, &joint) in self.free.iter().enumerate() {
            let error = reference[joint] - round_to(position[slot], self.controller.position_quantum);
            let last = self.last_error[slot];
            let rate = if last.is_nan() { 0.0 } else { (error - last) / elapsed_s };
            let [rate1, _, filtered1, _] = self.past[slot];
            let filtered = filter.output(self.past[slot]);
            self.last_error[slot] = error;
            self.past[slot] = [rate, rate1, filtered, filtered1];
            let torque = proportional[joint] * error + derivative[joint] * filtered;
            command[joint] = round_to(torque, self.controller.torque_quantum).clamp(-limit[joint], limit[joint]);
        }
    }
}

/// The nearest multiple of a quantum; the value itself where there is none.
pub fn round_to(value: f64, quantum: f64) -> f64 {
    if quantum > 0.0 { (value / quantum).round() * quantum } else { value }
}

/// Simulates from rest at `q0` under `controller`, which follows `reference` (all joints, one row a sample). Returns the
/// motion and the commanded torques (all joints, one row a sample).
pub fn simulate(
    system: &System,
    controller: &Controller,
    time: &[f64],
    reference: &[f64],
    q0: &[f64],
    options: &Options,
) -> Result<(Trajectory, Vec<f64>), SimulationError> {
    let n_joints = system.n_joints();
    check(system, &Input { time, command: reference, intersample: Intersample::ZeroOrder }, q0)?;
    for gains in [&controller.proportional, &controller.derivative, &controller.limit] {
        if gains.len() != n_joints {
            return Err(SimulationError::Length {
                what: "gains of the controller",
                found: gains.len(),
                expected: n_joints,
            });
        }
    }
    let n = system.n_free();
    let mut stepper = Stepper::new(system, &system.rest(q0));
    let mut recorder = Recorder::new(system, time.len());
    let mut control = Loop::new(controller, system.kernel().free);
    let mut commands = vec![0.0; time.len() * n_joints];
    let mut course = Course::new(system, time, options, None);
    for sample in 0..time.len() {
        recorder.take(system, time[sample], &stepper.x, options)?;
        let shown = &recorder.trajectory.q[sample * n..];
        let elapsed_s = if sample > 0 { time[sample] - time[sample - 1] } else { 0.0 };
        let row = sample * n_joints..(sample + 1) * n_joints;
        control.command(elapsed_s, &reference[row.clone()], shown, &mut commands[row]);
        if sample + 1 < time.len() {
            let given = Input { time, command: &commands, intersample: Intersample::ZeroOrder };
            course.cross(&mut stepper, system, &given, sample);
        }
    }
    Ok((recorder.finish(stepper.x), commands))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{system::fixtures::PENDULUM, system::fixtures::VISCOUS, system::fixtures::placed};

    /// The thesis prints the filter with four digits.
    #[test]
    fn the_thesis_filter_is_a_step_invariant_butterworth() {
        let ours = Filter::butterworth(15.0, 0.01);
        let printed = Filter::THESIS;
        for (ours, printed) in
            [(ours.a2, printed.a2), (ours.a3, printed.a3), (ours.b1, printed.b1), (ours.b2, printed.b2)]
        {
            assert!((ours - printed).abs() < 1.5e-4, "{ours} for {printed}");
        }
    }

    fn controller(proportional: f64, derivative: f64) -> Controller {
        Controller {
            proportional: vec![proportional],
            derivative: vec![derivative],
            filter: Filter::THESIS,
            limit: vec![f64::INFINITY],
            position_quantum: 0.0,
            torque_quantum: 0.0,
        }
    }

    fn body() -> System {
        System::new(&PENDULUM, 1, vec![0.0, 0.0, 0.02], Vec::new(), &[placed(&VISCOUS, 0, None, &[0.05])]).unwrap()
    }

    #[test]
    fn a_controlled_joint_settles_at_its_reference() {
        let time: Vec<f64> = (0..1001).map(|k| f64::from(k) * 0.01).collect();
        let reference = vec![0.3; time.len()];
        let (motion, commands) =
            simulate(&body(), &controller(0.5, 0.05), &time, &reference, &[0.0], &Options::default()).unwrap();
        assert!((motion.q[1000] - 0.3).abs() < 1e-6, "{}", motion.q[1000]);
        assert!((commands[0] - 0.15).abs() < 1e-15, "the first command is P e: {}", commands[0]);
    }

    /// Replaying the commanded torques in open loop gives the same motion.
    #[test]
    fn commands_are_held_over_their_sample() {
        let time: Vec<f64> = (0..301).map(|k| f64::from(k) * 0.01).collect();
        let reference: Vec<f64> = time.iter().map(|t| 0.2 * (4.0 * t).sin()).collect();
        let mut controller = controller(0.8, 0.04);
        controller.limit = vec![0.05];
        controller.position_quantum = 1e-4;
        let (motion, commands) =
            simulate(&body(), &controller, &time, &reference, &[0.1], &Options::default()).unwrap();
        assert!(commands.iter().all(|torque| torque.abs() <= 0.05) && commands.contains(&-0.05));
        let input = Input { time: &time, command: &commands, intersample: Intersample::ZeroOrder };
        let replayed = super::super::simulate(&body(), &input, &[0.1], &Options::default()).unwrap();
        assert_eq!(motion, replayed);
    }
}

//! What a controller asks of the equations: which commands make a wanted torque, which position a reading means, and
//! what the joint effects take at a given motion.

use dynid_generated::Signal;

use super::{Element, MAX_OUTPUTS, N_SIGNALS, NONE, Scratch, System};

/// The linear part of the drive path: `torque = matrix command + offset`, over the free joints.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveMap {
    /// n_free x n_free, row-major.
    pub matrix: Vec<f64>,
    /// Torque of each free joint without a command.
    pub offset: Vec<f64>,
}

/// Why a controller cannot speak to a model's drives, or understand its sensors.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum InverseError {
    /// Commands that do not determine the torques.
    #[error("the drive path of the model makes no torque at some free joint: is a gain 0, or do two couplings cancel?")]
    NoDrive,
    /// A sensor effect without an inverse.
    #[error(
        "the model's sensor at joint {joint} shows the same at every position; give its scale a value that is not 0"
    )]
    NoSensor {
        /// The device's joint index.
        joint: usize,
    },
}

impl System {
    /// Composes the stages of the drive path that are affine in the commands and remember nothing: gains, offsets,
    /// couplings. Any other stage (a lag, a dead zone, a limit, an elastic joint) is taken to pass what reaches it.
    /// Locked joints get no command.
    pub fn drive_map(&self) -> DriveMap {
        let n = self.n_free();
        let mut matrix: Vec<f64> = (0..n * n).map(|place| f64::from(u8::from(place % (n + 1) == 0))).collect();
        let mut offset = vec![0.0; n];
        for element in &self.actuators {
            let (slot, from) = (element.joint.slot, element.from.slot);
            let Some([constant, by_own, by_from]) = self.affine(element) else { continue };
            for value in &mut matrix[slot * n..(slot + 1) * n] {
                *value *= by_own;
            }
            offset[slot] = by_own * offset[slot] + constant;
            if from != NONE {
                matrix[slot * n + from] += by_from;
            }
        }
        DriveMap { matrix, offset }
    }

    /// Commands of the free joints per torque, n_free x n_free, row-major.
    pub fn inverse_drive(&self) -> Result<Vec<f64>, InverseError> {
        let n = self.n_free();
        nalgebra::DMatrix::from_row_slice(n, n, &self.drive_map().matrix)
            .try_inverse()
            .filter(|inverse| inverse.iter().all(|entry| entry.is_finite()))
            .map(|inverse| inverse.transpose().as_slice().to_vec())
            .ok_or(InverseError::NoDrive)
    }

    /// Constant, slope by the own command and slope by the other joint's of an actuator stage, where it is affine.
    fn affine(&self, element: &Element) -> Option<[f64; 3]> {
        /// Commands at which the stage is tried, own and the other joint's.
        const TRIED: [[f64; 2]; 5] = [[-3.0, 0.5], [0.25, -2.0], [7.0, 7.0], [-0.01, 0.0], [0.02, 11.0]];
        /// Relative to the numbers that are added.
        const ROUNDING: f64 = 1e-12;
        if element.nz > 0 || element.joint.slot == NONE {
            return None;
        }
        let x = self.rest(&vec![0.0; self.n_free()]);
        let at = |[own, from]: [f64; 2]| {
            let mut outputs = [0.0; MAX_OUTPUTS];
            let mut signals = [0.0; N_SIGNALS];
            signals[Signal::Command as usize] = own;
            signals[Signal::Load as usize] = own;
            signals[Signal::CommandFrom as usize] = from;
            self.evaluate(element, &signals, &x, &mut outputs, &mut []);
            outputs[element.torque]
        };
        let constant = at([0.0, 0.0]);
        let (by_own, by_from) = (at([1.0, 0.0]) - constant, at([0.0, 1.0]) - constant);
        let is_affine = TRIED.iter().all(|&[own, from]| {
            let parts = [constant, by_own * own, by_from * from];
            let size: f64 = parts.iter().map(|part| part.abs()).sum();
            (at([own, from]) - parts.iter().sum::<f64>()).abs() <= ROUNDING * (size + constant.abs() + 1.0)
        });
        is_affine.then_some([constant, by_own, by_from])
    }

    /// What a reading of each free joint's position means: `position = slope reading + offset`, as `(slope, offset)`.
    pub fn sensor_map(&self) -> Result<Vec<(f64, f64)>, InverseError> {
        let n = self.n_free();
        let reading = |position: f64| {
            let x = self.rest(&vec![position; n]);
            let mut shown = vec![0.0; n];
            self.measure(0.0, &x, &mut shown);
            shown
        };
        let (at_zero, at_one) = (reading(0.0), reading(1.0));
        let maps = at_zero.iter().zip(&at_one).map(|(zero, one)| (1.0 / (one - zero), -zero / (one - zero)));
        let is_known = |(slope, offset): &(f64, f64)| slope.is_finite() && offset.is_finite();
        let reported = |(map, joint): ((f64, f64), &usize)| {
            Some(map).filter(is_known).ok_or(InverseError::NoSensor { joint: *joint })
        };
        maps.zip(self.kernel().free).map(reported).collect()
    }

    /// What a hand must add at each free joint so that the motion in `x` goes on with `ddq` under the torques of all joints
    /// that arrive: `D ddq + h + load - drive`. The rates of the effects' states go into `dx`.
    pub fn missing_torque(
        &self,
        scratch: &mut Scratch,
        t: f64,
        (x, ddq): (&[f64], &[f64]),
        command: &[f64],
        dx: &mut [f64],
        missing: &mut [f64],
    ) {
        let n = self.n_free();
        self.effects_alone(scratch, t, x, command, dx);
        self.kernel.functions.inverse_dynamics(&self.prepared, &x[..n], &x[n..2 * n], ddq, missing);
        self.add_inertia_torque(ddq, missing);
        for (slot, missing) in missing.iter_mut().enumerate() {
            *missing += scratch.load[slot] - scratch.drive[slot];
        }
    }

    /// The drive's torques and the loads at `x`, into `scratch`, and the rates of the effects' states, into `dx`.
    pub fn effects_alone(&self, scratch: &mut Scratch, t: f64, x: &[f64], command: &[f64], dx: &mut [f64]) {
        if self.drive_is_read {
            self.drive(scratch, t, x, command, dx);
        }
        self.loads(scratch, t, x, dx);
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{GAIN, INPUT_COUPLING, full_arm, placed};
    use super::*;

    /// The map of the stages that are linear is what the drive path makes of a command.
    #[test]
    fn the_drive_map_is_the_drive_path() {
        let effects = [
            placed(&GAIN, 0, None, &[1.4]),
            placed(&GAIN, 1, None, &[0.8]),
            placed(&INPUT_COUPLING, 1, Some(0), &[-0.2]),
            placed(&INPUT_COUPLING, 0, Some(1), &[0.7]),
        ];
        let links = full_arm().link_parameters().to_vec();
        let system = System::new(full_arm().kernel(), 2, links, Vec::new(), &effects).unwrap();
        let map = system.drive_map();
        let command = [0.3, -1.7];
        let mut scratch = system.scratch();
        let x = system.rest(&[0.1, 0.2]);
        system.drive(&mut scratch, 0.0, &x, &command, &mut vec![0.0; x.len()]);
        for slot in 0..2 {
            let torque = map.matrix[2 * slot] * command[0] + map.matrix[2 * slot + 1] * command[1] + map.offset[slot];
            assert!((torque - scratch.drive[slot]).abs() < 1e-14, "{torque} for {}", scratch.drive[slot]);
        }
    }
}

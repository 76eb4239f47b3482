//! Where the end point of a model is, how fast it moves, and which torques a force there asks of the joints.
//!
//! `v = J dq`, `w = J_w dq`, and by virtual work `tau = J^T f + J_w^T m`, all in base axes. The functions behind it are the
//! device's kernels ([`dynid_generated::EndPoint`]); after it is made, nothing here allocates, fails or panics.

use dynid_generated::EndPoint;

/// A vector in base axes.
pub type Vector = [f64; 3];

/// The end point at one posture, some joints of which are free.
#[derive(Debug, Clone)]
pub struct Kinematics {
    end_point: &'static EndPoint,
    lengths: Vec<f64>,
    free: Vec<usize>,
    /// Of all joints; those that are not free stay.
    q: Vec<f64>,
    position: Vector,
    /// Row-major, from the point's frame to the base's.
    rotation: [f64; 9],
    /// 6 x n, row-major: velocity, angular velocity.
    jacobian: Vec<f64>,
}

/// Why a model has no kinematics.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum KinematicsError {
    /// The device's file names no end point.
    #[error(
        "device `{device}` has no end point; name the frame that the handle is fixed to in its file: [end_point] with frame = \
         \"..\""
    )]
    NoEndPoint {
        /// Its id.
        device: String,
    },
    /// The device's frames make no chain to it.
    #[error("{why}")]
    NoKernel {
        /// What is wrong.
        why: String,
    },
    /// A posture that is not one of the device.
    #[error("the posture has {found} positions, device `{device}` {expected} joints; give one position per joint")]
    Posture {
        /// The device's id.
        device: String,
        /// How many positions came.
        found: usize,
        /// How many are needed.
        expected: usize,
    },
    /// A model without one of the lengths that the device has.
    #[error(
        "the model of `{device}` gives no value to `{name}`, which its end point depends on; make it of this device"
    )]
    Length {
        /// The device's id.
        device: String,
        /// The parameter's name.
        name: &'static str,
    },
    /// A free joint that does not exist.
    #[error("device `{device}` has no joint {joint}; joints count from 0")]
    Joint {
        /// The device's id.
        device: String,
        /// As given.
        joint: usize,
    },
}

impl Kinematics {
    /// Of a device's end point at a posture of all its joints, of which the `free` ones will move; `length` says what the lengths of its
    /// file are.
    ///
    /// # Errors
    /// A posture that is not one position per joint; a joint that the device does not have; a
    /// length that nothing is known of.
    pub fn new(
        end_point: &'static EndPoint,
        free: &[usize],
        posture: &[f64],
        length: impl Fn(&str) -> Option<f64>,
    ) -> Result<Self, KinematicsError> {
        let named = || end_point.device.to_owned();
        if posture.len() != end_point.n_joints {
            let (found, expected) = (posture.len(), end_point.n_joints);
            return Err(KinematicsError::Posture { device: named(), found, expected });
        }
        if let Some(&joint) = free.iter().find(|joint| **joint >= posture.len()) {
            return Err(KinematicsError::Joint { device: named(), joint });
        }
        let lengths = end_point
            .parameters
            .iter()
            .map(|name| length(name).ok_or_else(|| KinematicsError::Length { device: named(), name }));
        let mut kinematics = Self {
            end_point,
            lengths: lengths.collect::<Result<Vec<f64>, KinematicsError>>()?,
            free: free.to_vec(),
            q: posture.to_vec(),
            position: [0.0; 3],
            rotation: [0.0; 9],
            jacobian: vec![0.0; 6 * posture.len()],
        };
        kinematics.refresh();
        Ok(kinematics)
    }

    /// Moves the free joints to `q`.
    pub fn move_to(&mut self, q: &[f64]) {
        for (&joint, q) in self.free.iter().zip(q) {
            self.q[joint] = *q;
        }
        self.refresh();
    }

    fn refresh(&mut self) {
        let Self { end_point, lengths, q, position, rotation, jacobian, .. } = self;
        end_point.functions.motion(lengths, q, position, rotation, jacobian);
    }

    /// Its free joints.
    pub fn free(&self) -> &[usize] {
        &self.free
    }

    /// The device's id.
    pub fn device(&self) -> &'static str {
        self.end_point.device
    }

    /// Number of free joints.
    pub fn n_free(&self) -> usize {
        self.free.len()
    }

    /// Where it is \[m\].
    pub fn position(&self) -> Vector {
        self.position
    }

    /// The axes of the point's frame, as columns: row-major rotation from it to the base's.
    pub fn rotation(&self) -> [f64; 9] {
        self.rotation
    }

    /// Row `row` of the 6 x n Jacobian (velocity, then angular velocity) at free joint `slot`.
    pub fn jacobian(&self, row: usize, slot: usize) -> f64 {
        self.jacobian[row * self.q.len() + self.free[slot]]
    }

    /// Velocity [m/s] and angular velocity [rad/s] at the speeds `dq` of the free joints.
    pub fn velocity(&self, dq: &[f64]) -> [Vector; 2] {
        let along = |row: usize| dq.iter().enumerate().map(|(slot, dq)| self.jacobian(row, slot) * dq).sum();
        [[along(0), along(1), along(2)], [along(3), along(4), along(5)]]
    }

    /// Torques at the free joints that do the work of a force \[N\] at the point and a moment \[N*m\] on its frame.
    pub fn torques(&self, force: Vector, moment: Vector, torques: &mut [f64]) {
        for (slot, torque) in torques.iter_mut().enumerate() {
            *torque = (0..3)
                .map(|row| self.jacobian(row, slot) * force[row] + self.jacobian(row + 3, slot) * moment[row])
                .sum();
        }
    }
}

/// `a . b`
pub fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a + factor b`
pub fn plus(a: Vector, factor: f64, b: Vector) -> Vector {
    [a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(device: &str, free: &[usize], posture: &[f64]) -> Result<Kinematics, KinematicsError> {
        let lengths = &dynid_model::device(device).expect("a shipped device").lengths;
        let value = |name: &str| {
            let own = lengths.iter().find(|length| name.strip_prefix("length.") == Some(&length.symbol))?;
            Some(own.value)
        };
        let no_end_point = || KinematicsError::NoEndPoint { device: device.to_owned() };
        let end_point = dynid_generated::end_point(device).ok_or_else(no_end_point)?;
        Kinematics::new(end_point, free, posture, value)
    }

    fn arm(posture: &[f64]) -> Kinematics {
        of("freedom6s", &[0, 1, 2, 3, 4, 5], posture).expect("an end point")
    }

    /// A force does the same work at the point as its torques do at the joints.
    #[test]
    fn torques_and_force_do_the_same_work() {
        let arm = arm(&[0.3, -0.4, 0.5, 0.2, -1.0, 0.7]);
        let dq = [0.3, -1.2, 0.8, 2.0, 0.1, -0.6];
        let (force, moment) = ([1.0, -2.0, 0.5], [0.1, 0.7, -0.3]);
        let mut torques = [0.0; 6];
        arm.torques(force, moment, &mut torques);
        let [velocity, angular] = arm.velocity(&dq);
        let at_joints: f64 = torques.iter().zip(&dq).map(|(torque, dq)| torque * dq).sum();
        assert!((at_joints - dot(force, velocity) - dot(moment, angular)).abs() < 1e-14);
    }

    #[test]
    fn free_joints_move_and_the_others_stay() {
        let posture = [0.3, -0.4, 0.5, 0.2, -1.0, 0.7];
        let mut one = of("freedom6s", &[2], &posture).expect("an end point");
        one.move_to(&[0.9]);
        let other = arm(&[0.3, -0.4, 0.9, 0.2, -1.0, 0.7]);
        assert_eq!((one.position(), one.rotation()), (other.position(), other.rotation()));
        assert_eq!(one.velocity(&[1.0]), other.velocity(&[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]));
    }

    #[test]
    fn what_has_no_kinematics_says_so() {
        let error = of("double_pendulum", &[0, 1], &[0.0, 0.0]).expect_err("it has none");
        assert!(error.to_string().contains("[end_point]"), "{error}");
        let wrong = |free: &[usize], posture: &[f64]| of("planar2r", free, posture).expect_err("no arm");
        assert!(matches!(wrong(&[0], &[0.0]), KinematicsError::Posture { found: 1, expected: 2, .. }));
        assert!(matches!(wrong(&[0, 2], &[0.0, 0.0]), KinematicsError::Joint { joint: 2, .. }));
        // what calls itself the device and has not its lengths
        let end_point = dynid_generated::end_point("planar2r").expect("an end point");
        let error = Kinematics::new(end_point, &[0, 1], &[0.0, 0.0], |_| None).expect_err("a length is missing");
        assert!(matches!(error, KinematicsError::Length { .. }), "{error}");
        assert!(error.to_string().contains("length."), "{error}");
    }
}

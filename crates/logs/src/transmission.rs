//! Between the motors that a drive logs and the joints that they move: gears, coupled wrists, cables over several joints.
//!
//! `motor positions = ratio * joint positions`, and by the principle of virtual work
//! `joint torques = ratio^T * motor torques` (Siciliano et al. 2009, section 7.1, of gears; Tsai 1999, chapter 7, of coupled ones).

use nalgebra::DMatrix;

/// Which motors move which joints, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Transmission {
    /// The joints that these motors move.
    pub joints: Vec<usize>,
    /// Columns of the motors' positions; none where they are not logged.
    pub position: Vec<String>,
    /// Columns of the motors' torques or currents; none where they are not logged.
    pub torque: Vec<String>,
    /// Columns of the motors' commanded positions; none where they are not logged.
    pub reference: Vec<String>,
    /// Joint positions of motor positions, where these are logged: n_joints x n_motors [rad or m per unit of `position`].
    joint_per_motor: DMatrix<f64>,
    /// Joint torques of the torque columns: n_joints x n_motors [N*m or N per unit of `torque`].
    torque_per_motor: DMatrix<f64>,
}

impl Transmission {
    /// A transmission of columns of positions, torques and references. `ratio` has one row a motor: by how much it turns for a unit of
    /// each joint; `motor_constant` is each motor's torque for a unit of its torque column, 1 where that is for the model to say.
    ///
    /// # Errors
    /// Motors that leave a joint undetermined.
    pub fn new(
        joints: Vec<usize>,
        [position, torque, reference]: [Vec<String>; 3],
        ratio: &[Vec<f64>],
        motor_constant: Vec<f64>,
    ) -> Result<Self, String> {
        let ratio = DMatrix::from_fn(ratio.len(), joints.len(), |motor, joint| ratio[motor][joint]);
        let torque_per_motor = ratio.transpose() * DMatrix::from_diagonal(&motor_constant.into());
        let asks_for_positions = !position.is_empty() || !reference.is_empty();
        let joint_per_motor = if asks_for_positions { inverse(&ratio)? } else { ratio.transpose() };
        Ok(Self { joints, position, torque, reference, joint_per_motor, torque_per_motor })
    }

    /// Positions of the joints, in their order, of those of the motors.
    pub fn joint_positions(&self, motors: &[Vec<f64>]) -> Vec<Vec<f64>> {
        combined(&self.joint_per_motor, motors)
    }

    /// Torques of the joints, in their order, of the torque columns.
    pub fn joint_torques(&self, motors: &[Vec<f64>]) -> Vec<Vec<f64>> {
        combined(&self.torque_per_motor, motors)
    }
}

/// Joint positions of motor positions; of more motors than joints those that fit them best.
fn inverse(ratio: &DMatrix<f64>) -> Result<DMatrix<f64>, String> {
    let (n_motors, n_joints) = ratio.shape();
    let svd = ratio.clone().svd(true, true);
    let largest = svd.singular_values.iter().fold(0.0, |largest: f64, value| largest.max(*value));
    if svd.rank(largest * f64::EPSILON * n_motors.max(n_joints) as f64) < n_joints {
        return Err(format!("the ratios of {n_motors} motors do not determine the positions of {n_joints} joints"));
    }
    let exact = if ratio.is_square() { ratio.clone().try_inverse() } else { None };
    match exact {
        Some(inverse) => Ok(inverse),
        None => svd.pseudo_inverse(0.0).map_err(str::to_owned),
    }
}

/// One signal a row of the matrix; what has no share in it is left out, so that it keeps its bits.
fn combined(matrix: &DMatrix<f64>, signals: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let n_samples = signals.first().map_or(0, Vec::len);
    let row = |row: usize| {
        let shares: Vec<(f64, &Vec<f64>)> = signals
            .iter()
            .enumerate()
            .map(|(k, signal)| (matrix[(row, k)], signal))
            .filter(|(share, _)| *share != 0.0)
            .collect();
        (0..n_samples).map(|sample| shares.iter().map(|(share, signal)| share * signal[sample]).sum()).collect()
    };
    (0..matrix.nrows()).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(ratio: &[Vec<f64>], n_joints: usize) -> Result<Transmission, String> {
        let names = |kind: &str| (0..ratio.len()).map(|motor| format!("{kind}{motor}")).collect();
        Transmission::new((0..n_joints).collect(), [names("m"), names("i"), Vec::new()], ratio, vec![1.0; ratio.len()])
    }

    /// What the motors do is what the joints do, whatever the ratios.
    #[test]
    fn power_is_the_same_on_both_sides() {
        for ratio in [
            vec![vec![100.0, 0.0], vec![0.0, -80.0]],
            vec![vec![50.0, 50.0], vec![50.0, -50.0]],
            vec![vec![3.0, 0.5], vec![-2.0, 1.0], vec![0.4, 7.0]],
        ] {
            let transmission = of(&ratio, 2).unwrap();
            let (dq, torque): ([f64; 2], Vec<f64>) = ([0.3, -1.7], (0..ratio.len()).map(|k| 0.2 + k as f64).collect());
            let motor_speed: Vec<f64> = ratio.iter().map(|row| row[0] * dq[0] + row[1] * dq[1]).collect();
            let columns = |values: &[f64]| values.iter().map(|value| vec![*value]).collect::<Vec<_>>();
            let joint_torque = transmission.joint_torques(&columns(&torque));
            let of_motors: f64 = motor_speed.iter().zip(&torque).map(|(speed, torque)| speed * torque).sum();
            let of_joints: f64 = dq.iter().zip(&joint_torque).map(|(speed, torque)| speed * torque[0]).sum();
            assert!((of_motors - of_joints).abs() < 1e-12 * of_motors.abs(), "{of_motors} {of_joints}");
            let back = transmission.joint_positions(&columns(&motor_speed));
            assert!(back.iter().zip(dq).all(|(own, dq)| (own[0] - dq).abs() < 1e-12), "{back:?}");
        }
    }

    #[test]
    fn motors_that_leave_a_joint_open() {
        assert_eq!(
            of(&[vec![1.0, 1.0], vec![2.0, 2.0]], 2).unwrap_err(),
            "the ratios of 2 motors do not determine the positions of 2 joints"
        );
    }
}

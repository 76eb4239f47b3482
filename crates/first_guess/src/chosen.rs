//! The columns that an experiment needs, on the way to a guess.

use dynid_model::{Device, JointKind};

use crate::Quantity;
use crate::guess::{ColumnGuess, Factor, Remark};

/// The columns that were chosen.
pub(crate) struct Chosen {
    /// Time, then positions, torques, references by joint.
    pub columns: Vec<ColumnGuess>,
    pub is_time_unit_known: bool,
    pub is_position_unit_known: bool,
    /// What the torque column of each joint holds, where that is not the joint's command.
    pub not_commands: Vec<Option<Quantity>>,
    /// Speed column of each joint, and the factor that its name's unit has.
    pub speeds: Vec<Option<(String, Option<f64>)>>,
    pub mask: Option<String>,
    /// Free joints of each log.
    pub free: Vec<Vec<usize>>,
    pub remarks: Vec<Remark>,
}

impl Chosen {
    pub fn time(&self) -> &ColumnGuess {
        &self.columns[0]
    }

    pub fn of_kind(&self, kind: &str) -> impl Iterator<Item = &ColumnGuess> {
        self.columns.iter().filter(move |column| column.kind() == kind)
    }
}

/// Puts a factor on the positions and references of revolute joints.
pub(crate) fn scale_positions(device: &Device, columns: &mut [ColumnGuess], factor: &Factor) {
    for column in columns {
        let is_angle = column.joint().is_some_and(|joint| device.joints[joint].kind == JointKind::Revolute);
        if is_angle && matches!(column.kind(), "q" | "ref") && column.factors.is_empty() {
            column.factors.push(factor.clone());
        }
    }
}

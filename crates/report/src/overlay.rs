//! Measured against the model: one picture of a joint's position or torque.

use dynid_judge::{compare::Comparison, compare::JointComparison, compare::RunComparison};
use dynid_logs::experiment::Run;
use dynid_model::{Device, JointKind};

use crate::plot::Panel;

/// Which of the two errors is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShownErrors {
    /// Commanded torque minus what the measured motion needs.
    Torque,
    /// Measured minus simulated position.
    Position,
    /// Both.
    Both,
}

/// Pictures of a run: position and torque of each joint.
pub fn run_panels(device: &Device, run: &Run, compared: &RunComparison, shown: ShownErrors) -> Vec<Panel> {
    let mut panels = Vec::new();
    for (slot, joint) in compared.joints.iter().enumerate() {
        let kind = device.joints[joint.joint].kind;
        if shown != ShownErrors::Torque {
            panels.extend(position_panel(run, compared, slot, joint, kind));
        }
        if shown != ShownErrors::Position {
            panels.extend(torque_panel(compared, slot, &device.joints[joint.joint].command_unit));
        }
    }
    panels
}

/// Pictures of all runs.
pub fn panels(device: &Device, runs: &[&Run], comparison: &Comparison, shown: ShownErrors) -> Vec<Panel> {
    runs.iter().zip(&comparison.runs).flat_map(|(run, compared)| run_panels(device, run, compared, shown)).collect()
}

fn position_panel(
    run: &Run,
    compared: &RunComparison,
    slot: usize,
    joint: &JointComparison,
    kind: JointKind,
) -> Option<Panel> {
    Some(Panel {
        title: format!("{}, joint {}, {}", compared.file, joint.joint, compared.role),
        quantity: "position".to_owned(),
        unit: if kind == JointKind::Prismatic { "m" } else { "rad" }.to_owned(),
        time: run.log.t.clone(),
        measured: run.log.q[joint.joint].clone(),
        predicted: compared.simulated.as_ref()?.get(slot)?.clone(),
        noise_floor: Some(joint.noise_floor),
    })
}

fn torque_panel(compared: &RunComparison, slot: usize, unit: &str) -> Option<Panel> {
    let error = compared.torque.get(slot)?;
    // samples that do not count leave gaps
    let counted = |values: &[f64]| -> Vec<f64> {
        values.iter().zip(&error.used).map(|(&value, &used)| if used { value } else { f64::NAN }).collect()
    };
    let predicted: Vec<f64> = error.torque.iter().zip(&error.residual).map(|(tau, left)| tau - left).collect();
    Some(Panel {
        title: format!("{}, joint {}, {}", compared.file, error.joint, compared.role),
        quantity: "torque".to_owned(),
        unit: unit.to_owned(),
        time: error.time.clone(),
        measured: counted(&error.torque),
        predicted: counted(&predicted),
        noise_floor: None,
    })
}

//! Whether a device has the frames of a description where the description has them.

use std::collections::BTreeMap;
use std::path::Path;

use dynid_model::{Convention, Device, ModelError, Source};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::REMEDY;
use crate::{draft::Draft, urdf::Robot, write};

/// Frames that are nearer to each other [rad or m] may be the same: somebody wrote pi/2 for 1.571 in the device file.
const EDITED: f64 = 1e-3;

/// Frames that are farther apart [rad or m] are not the same for rounding alone.
const ROUNDING: f64 = 1e-9;

/// Postures, at which all frames must be in the same places: each joint variable is this, times one more than its number.
const POSTURES: [f64; 3] = [0.0, 0.37, -0.83];

/// # Errors
/// A frame that the device does not have, or has elsewhere.
pub(super) fn compare(
    source: &Source,
    robot: &Robot,
    draft: &Draft,
    device: &Device,
    notes: &mut Vec<String>,
) -> Result<(), ModelError> {
    let other = Device::parse(&write::device_file(draft), Path::new("description.toml"))?;
    let mut farthest = 0.0_f64;
    for posture in POSTURES {
        let (expected, found) = (poses(&other, posture), poses(device, posture));
        for frame in &draft.frames {
            let place =
                robot.links.iter().find(|link| link.name == frame.name).map_or(&robot.place, |link| &link.place);
            let Some(own) = found.get(frame.name.as_str()) else {
                let message = format!("the model's device `{}` has no frame `{}`", device.id, frame.name);
                return Err(source.error(place.clone(), message).help(REMEDY));
            };
            let between = expected[frame.name.as_str()].inverse() * own;
            let distance = between.translation.vector.norm().max(between.rotation.angle());
            if distance > EDITED || distance.is_nan() {
                let message = format!(
                    "the model's device `{}` has frame `{}` elsewhere than this description",
                    device.id, frame.name
                );
                return Err(source.error(place.clone(), message).help(REMEDY));
            }
            farthest = farthest.max(distance);
        }
    }
    if farthest > ROUNDING {
        notes.push(format!(
            "the device's frames are up to {farthest:.1e} rad or m from where the description has them; its own stay in the description"
        ));
    }
    Ok(())
}

/// Where the frames of a device stand in its base.
fn poses(device: &Device, posture: f64) -> BTreeMap<&str, Isometry3<f64>> {
    let value = |symbol: &str| {
        let length = device.lengths.iter().find(|length| length.symbol == symbol).map(|length| length.value);
        length.or_else(|| Some(posture * (1.0 + dynid_model::device::joint_variable(symbol)? as f64)))
    };
    let mut poses: Vec<Isometry3<f64>> = Vec::new();
    for frame in &device.frames {
        // The reader of device files lets no other symbols pass.
        let [theta, d, a, alpha] = [&frame.theta, &frame.d, &frame.a, &frame.alpha]
            .map(|formula| formula.evaluate(&value).unwrap_or(f64::NAN));
        let about_z = along_and_about(Vector3::z_axis(), d, theta);
        let about_x = along_and_about(Vector3::x_axis(), a, alpha);
        let step = match device.convention {
            Convention::Standard => about_z * about_x,
            Convention::Modified => about_x * about_z,
        };
        poses.push(frame.parent.map_or_else(Isometry3::identity, |parent| poses[parent]) * step);
    }
    device.frames.iter().map(|frame| frame.name.as_str()).zip(poses).collect()
}

fn along_and_about(axis: nalgebra::Unit<Vector3<f64>>, distance: f64, angle: f64) -> Isometry3<f64> {
    let translation = Translation3::from(axis.into_inner() * distance);
    Isometry3::from_parts(translation, UnitQuaternion::from_axis_angle(&axis, angle))
}

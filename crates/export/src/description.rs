//! A model's values in the URDF or the MJCF that its device was imported from.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use dynid_import::{Described, Format, Identified, JointValues};
use dynid_model::ModelError;
use dynid_user_model::{EffectInstance, Model};

use crate::{Exported, bodies};

/// Why a model's values do not go into a description.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The description is wrong, or none of the model's device.
    #[error(transparent)]
    Description(#[from] ModelError),
    /// The description is of another format than what is asked for.
    #[error("{}: this is {}; write it with `--as {}`, or name a description of the format that you want", path.display(), name_of(*found), option_of(*found))]
    OtherFormat {
        /// The file.
        path: PathBuf,
        /// What it is.
        found: Format,
    },
}

fn name_of(format: Format) -> &'static str {
    match format {
        Format::Urdf => "no MJCF",
        Format::Mjcf => "an MJCF (its root element is `mujoco`)",
    }
}

fn option_of(format: Format) -> &'static str {
    match format {
        Format::Urdf => "urdf",
        Format::Mjcf => "mjcf",
    }
}

/// The text of a description, which lies at `path` and which the model's device was imported from, with the model's values; all
/// other text stays.
///
/// # Errors
/// What is wrong in the description, or where it is none of the model's device.
pub fn as_description(model: &Model, format: Format, text: &str, path: &Path) -> Result<Exported, ExportError> {
    let found = Format::of(text, path)?;
    if found != format {
        return Err(ExportError::OtherFormat { path: path.to_owned(), found });
    }
    let identified = Identified {
        bodies: bodies_by_frame(model),
        joints: (0..model.device.joints.len()).map(|joint| values_at(model, joint)).collect(),
        gravity: model.base.map(|component| -component.value),
    };
    let Described { text, mut notes } = dynid_import::description_with(text, path, model.device, &identified)?;
    notes.extend(left_out(model, format));
    notes.extend(not_alone(model));
    Ok(Exported { text, notes })
}

/// Links that are fixed to one frame move as one.
fn bodies_by_frame(model: &Model) -> BTreeMap<String, [f64; 10]> {
    let mut by_frame: BTreeMap<String, [f64; 10]> = BTreeMap::new();
    for (link, values) in model.device.links.iter().zip(&bodies::joined(model).links) {
        let body = values.map(|parameter| parameter.value);
        let frame = model.device.frames[link.frame].name.clone();
        by_frame.entry(frame).and_modify(|sum| *sum = bodies::sum(sum, &body)).or_insert(body);
    }
    by_frame
}

/// The effects that descriptions have numbers for.
fn values_at(model: &Model, joint: usize) -> JointValues {
    let value = |id: &str, symbol: &str| {
        let own = model.effects_at(joint).find(|instance| instance.is(id, Some(joint), None));
        own.and_then(|instance| instance.value(symbol)).unwrap_or(0.0)
    };
    JointValues {
        viscous: value("viscous", "Fv"),
        coulomb: value("coulomb", "Fc"),
        rotor_inertia: value("rotor_inertia", "Ia"),
        stiffness: value("spring", "Ks"),
        rest_position: value("spring", "qeq"),
    }
}

/// A sentence for each thing that a description has no place for. Rotors, which URDFs lack, are the import's to tell.
fn left_out(model: &Model, format: Format) -> Vec<String> {
    let file = if format == Format::Urdf { "a URDF" } else { "an MJCF" };
    let is_written = |instance: &&EffectInstance| {
        let has_place = match instance.effect.id.as_str() {
            "viscous" | "coulomb" | "rotor_inertia" => true,
            "spring" => format == Format::Mjcf,
            _ => false,
        };
        has_place && instance.from.is_none() && instance.payload.is_none()
    };
    let mut notes = Vec::new();
    for instance in &model.effects {
        if let Some((link, _)) = bodies::body_of(model, instance) {
            let title = &model.device.links[link].title;
            notes.push(format!("{} became a part of link `{title}`", instance.label()));
        } else if !is_written(&instance) && !is_nothing(instance) {
            let values = instance.effect.parameters.iter().zip(&instance.parameters);
            let values: Vec<String> = values.map(|(own, now)| format!("{} = {:?}", own.symbol, now.value)).collect();
            notes.push(format!("{} has no place in {file}: {}", instance.label(), values.join(", ")));
        }
    }
    for (length, parameter) in model.device.lengths.iter().zip(&model.lengths) {
        if length.value != parameter.value {
            notes.push(format!(
                "length.{} is {:?} m in the model; the description keeps what it says, {:?} m in the device",
                length.symbol, parameter.value, length.value
            ));
        }
    }
    notes
}

/// Logs determine some values only together with others.
fn not_alone(model: &Model) -> Option<String> {
    let names = model.fit.as_ref().map_or(&[][..], |fit| &fit.not_identifiable);
    let count = names.iter().filter(|name| model.parameter(name).is_some()).count();
    (count > 0).then(|| {
        format!(
            "values that the logs determined only together with others, not each by itself: {count} (`not alone` in \
             `dynid table`)"
        )
    })
}

/// Whether an effect is where it vanishes.
fn is_nothing(instance: &EffectInstance) -> bool {
    let parameters = instance.effect.parameters.iter().zip(&instance.parameters);
    let mut nulls = parameters.filter_map(|(own, now)| Some(now.value == own.null?));
    nulls.all(|is_null| is_null)
}

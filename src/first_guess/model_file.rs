//! The text of a model to begin with: the device's own values, said where they come from.

use std::fmt::Write;
use std::path::Path;

use dynid_model::Device;
use dynid_user_model::{EffectInstance, Model};

use super::experiment_file::quoted;

/// The model of a device's own values, to lie in `folder`: as TOML. Effects are those that the device states; none is invented.
pub fn model_file(device: &'static Device, folder: &Path) -> String {
    let model = Model::of_device(device);
    let mut text = format!(
        "# Written by `dynid new`: the device's own values, to fit from. A fit moves what is not fixed, within its bounds.\n\
         device = {}\n\n\
         # Links, lengths and gravity are the device file's. State another value so, and hold it where it is known:\n\
         # [link.1]\n# m = {{ value = {:?}, fixed = true }}\n",
        quoted(&device.name_from(folder)),
        device.links.first().map_or(1.0, |link| link.inertial[0].value)
    );
    match model.effects.as_slice() {
        [] => text.push_str("\n# The device file states no effects beside the rigid body, and none is guessed here.\n"),
        effects => {
            text.push_str("\n# The effects that the device file states.\n");
            effects.iter().for_each(|effect| write_effect(&mut text, &model, effect));
        }
    }
    let without: Vec<String> = (0..device.joints.len())
        .filter(|joint| model.effects_at(*joint).next().is_none())
        .map(|joint| format!("{joint} ({})", device.joints[joint].title))
        .collect();
    if !without.is_empty() {
        let _ = writeln!(
            text,
            "\n# No friction is stated at joint {}. `dynid diagnose` says which is missing; `dynid add` adds one.",
            without.join(", ")
        );
    }
    text
}

fn write_effect(text: &mut String, model: &Model, own: &EffectInstance) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "[[effect]]\nid = {}", quoted(&own.effect.id));
    if let Some(from) = own.from {
        let _ = writeln!(text, "from = {from}");
    }
    if let Some(joint) = own.joint {
        let _ = writeln!(text, "joint = {joint}  # {}", model.device.joints[joint].title);
    }
    for (index, (parameter, described)) in own.parameters.iter().zip(&own.effect.parameters).enumerate() {
        let unit = model.unit(&own.parameter_name(index)).unwrap_or_default();
        let fate = if parameter.fixed {
            "held".to_owned()
        } else {
            format!("fitted within {:?} .. {:?}", parameter.lower, parameter.upper)
        };
        let _ = writeln!(text, "{} = {:?}  # {unit}; {fate}", described.symbol, parameter.value);
    }
    text.push('\n');
}

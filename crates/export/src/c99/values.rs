//! The model's values as constants.

use std::fmt::Write;

use dynid_user_model::Model;

use super::{Parts, one_line, section};
use crate::bodies;

/// Parameters of the equations, locked positions, lengths of the end point, parameters of the effects, states at the start.
pub(super) fn write_values(parts: &Parts, text: &mut String) -> std::fmt::Result {
    let Parts { model, system, kernels, prefix } = parts;
    section("The model's values.", text)?;
    let with_bodies = bodies::joined(model);
    let value = |name: &str| with_bodies.parameter(name).map_or(f64::NAN, |parameter| parameter.value);
    let named = |names: &[String]| -> Vec<(String, f64)> {
        names.iter().map(|name| (documented(model, name), value(name))).collect()
    };
    write_array(&format!("const double {prefix}_parameters"), &named(&kernels.parameters), text)?;
    let of_joint = |joint: &usize| format!("joint {joint}: {}", model.device.joints[*joint].title);
    let locked = system.kernel().locked.iter().map(of_joint).zip(system.locked().iter().copied());
    write_array(&format!("const double {prefix}_locked"), &locked.collect::<Vec<_>>(), text)?;
    write_array(&format!("const double {prefix}_lengths"), &named(&kernels.lengths), text)?;
    write_array(&format!("const double {prefix}_effect_parameters"), &named(system.effect_names()), text)?;
    let states = system.state_names().iter().cloned().zip(system.initial_states().iter().copied());
    write_array(&format!("const double {prefix}_initial_states"), &states.collect::<Vec<_>>(), text)?;
    write_prepare_model(parts, text)
}

/// `joint.3.coulomb.Fc [N*m]`
fn documented(model: &Model, name: &str) -> String {
    let unit = model.unit(name).filter(|unit| !unit.is_empty() && unit != "1");
    unit.map_or_else(|| name.to_owned(), |unit| format!("{name} [{unit}]"))
}

fn write_prepare_model(Parts { kernels, prefix, .. }: &Parts, text: &mut String) -> std::fmt::Result {
    writeln!(text, "void {prefix}_prepare_model(double prepared[{}])\n{{", kernels.n_prepared)?;
    writeln!(text, "    {prefix}_prepare({prefix}_parameters, {prefix}_locked, prepared);\n}}\n")
}

/// An array of documented numbers; C has none of length 0, so that such a one has an element that nobody reads.
fn write_array(declaration: &str, values: &[(String, f64)], text: &mut String) -> std::fmt::Result {
    writeln!(text, "{declaration}[{}] = {{", values.len().max(1))?;
    if values.is_empty() {
        writeln!(text, "    0.0,  /* there is none */")?;
    }
    for (name, value) in values {
        writeln!(text, "    {},  /* {} */", dynid_kernels::c_number(*value), one_line(name))?;
    }
    writeln!(text, "}};\n")
}

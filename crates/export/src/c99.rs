//! A model as one C99 file.

mod effects;
mod head;
mod values;

use std::fmt::Write;

use dynid_dynamics::system::{Part, System, SystemError};
use dynid_kernels::{CFunction, CKernels};
use dynid_model::{Device, Effect};
use dynid_user_model::Model;

use crate::Exported;
use effects::write_effects;
use head::write_head;
use values::write_values;

/// What the parts of the file are made from.
struct Parts<'a> {
    model: &'a Model,
    system: &'a System,
    kernels: &'a CKernels,
    /// What every name begins with: the device's id.
    prefix: &'a str,
}

/// The model with the joints `free` (ascending), the others locked at `posture` (one position per joint of the device, rad or m),
/// as one C99 file that needs `<math.h>` and `<stdint.h>` and nothing else.
///
/// # Errors
/// As [`Model::system`].
pub fn as_c99(model: &Model, free: &[usize], posture: &[f64]) -> Result<Exported, SystemError> {
    let system = model.system(free, |joint| posture.get(joint).copied().unwrap_or(0.0))?;
    let prefix = prefix_of(model.device);
    let kernels = dynid_kernels::c_kernels(model.device, free, &laws(model, &system), &prefix)
        .map_err(|error| SystemError::NoKernel { why: error.to_string() })?;
    let parts = Parts { model, system: &system, kernels: &kernels, prefix: &prefix };
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = write(&parts, &mut text);
    Ok(Exported { text, notes: notes(&parts) })
}

/// The device's id as an identifier of C.
fn prefix_of(device: &Device) -> String {
    let name: String = device.id.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if name.starts_with(|first: char| first.is_ascii_alphabetic()) { name } else { format!("device_{name}") }
}

/// The laws that the free joints have, each once, in the order of the model.
fn laws(model: &Model, system: &System) -> Vec<&'static Effect> {
    let mut laws: Vec<&'static Effect> = Vec::new();
    for instance in &model.effects {
        let is_used = [Part::Drive, Part::Friction, Part::Load, Part::Sensor]
            .into_iter()
            .flat_map(|part| system.part(part))
            .any(|element| element.kernel.id == instance.effect.id);
        if is_used && !laws.iter().any(|law| law.id == instance.effect.id) {
            laws.push(instance.effect);
        }
    }
    laws
}

fn write(parts: &Parts, text: &mut String) -> std::fmt::Result {
    let Parts { kernels, prefix, .. } = parts;
    let guard = prefix.to_uppercase();
    write_head(parts, text)?;
    writeln!(text, "#ifndef {guard}_DECLARATIONS_ONLY\n\n#include <math.h>\n#include <stdint.h>\n")?;
    writeln!(text, "#ifdef __clang__\n#pragma STDC FP_CONTRACT OFF\n#endif\n")?;
    writeln!(text, "{}", kernels.helpers)?;
    section("The equations of motion of the rigid bodies.", text)?;
    for own in kernels.equations.iter().chain(&kernels.end_point) {
        unless_left_out(own, &guard, text, |text| write_function(own, text))?;
    }
    write_values(parts, text)?;
    section("Laws of effects: outputs and rates of states from parameters, signals and states.", text)?;
    for own in &kernels.laws {
        write_function(own, text)?;
    }
    section("The whole model.", text)?;
    write_effects(parts, text)?;
    writeln!(text, "#endif /* {guard}_DECLARATIONS_ONLY */")
}

fn section(title: &str, text: &mut String) -> std::fmt::Result {
    writeln!(text, "/* --- {title} {} */\n", "-".repeat(104_usize.saturating_sub(title.len())))
}

/// What no torque needs and what compilers take most time for: derivatives, and the matrix that is one.
const DERIVATIVES: [&str; 3] = ["coriolis", "regressor", "inverse_dynamics_gradient"];

/// Lets whoever compiles the file leave derivatives out.
fn unless_left_out(
    function: &CFunction,
    guard: &str,
    text: &mut String,
    write: impl FnOnce(&mut String) -> std::fmt::Result,
) -> std::fmt::Result {
    if !DERIVATIVES.iter().any(|name| function.name.ends_with(&format!("_{name}"))) {
        return write(text);
    }
    writeln!(text, "#ifndef {guard}_WITHOUT_DERIVATIVES")?;
    write(text)?;
    writeln!(text, "#endif\n")
}

fn write_function(function: &CFunction, text: &mut String) -> std::fmt::Result {
    writeln!(text, "/* {} */\n{}", one_line(&function.title), function.definition)
}

/// What may stand in a comment of C.
fn one_line(text: &str) -> String {
    let text: String = text.chars().map(|character| if character.is_control() { ' ' } else { character }).collect();
    text.replace("*/", "* /").replace("/*", "/ *")
}

fn notes(parts: &Parts) -> Vec<String> {
    let delays = parts.system.delays().iter().filter(|delay| delay.span_s > 0.0).map(|delay| {
        format!(
            "the command of joint {} arrives {} s late; the file takes commands as they arrive, so that a simulation keeps them back itself",
            delay.joint, delay.span_s
        )
    });
    let payloads = parts.model.effects.iter().filter(|own| own.payload.is_some()).map(|own| {
        format!("{} is left out: the file is of the robot as it is without what it carries in some runs", own.label())
    });
    delays.chain(payloads).collect()
}

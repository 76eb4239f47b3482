//! The functions of the whole model: what they do with the effects, one after another.

use std::fmt::Write;

use dynid_dynamics::system::{Element, End, NONE, Part};
use dynid_generated::{N_SIGNALS, Signal};

use super::{Parts, head::MODEL_FUNCTIONS, head::prototype_of, one_line};

/// All but `prepare_model`, in the order of [`MODEL_FUNCTIONS`].
pub(super) fn write_effects(parts: &Parts, text: &mut String) -> std::fmt::Result {
    let bodies = [drive, load, inertia, torque, accelerations, measure];
    for ((_, prototype), body) in MODEL_FUNCTIONS[1..].iter().zip(bodies) {
        writeln!(text, "{}\n{{", prototype_of(parts, prototype))?;
        body(parts, text)?;
        writeln!(text, "}}\n")?;
    }
    Ok(())
}

fn drive(parts: &Parts, text: &mut String) -> std::fmt::Result {
    text.push_str("    (void)t; (void)q; (void)dq; (void)states; (void)command; (void)rates;\n");
    for (slot, joint) in parts.system.kernel().free.iter().enumerate() {
        writeln!(text, "    drive[{slot}] = command[{joint}];")?;
    }
    for element in parts.system.part(Part::Drive) {
        let slot = element.joint.slot;
        let of_signal = |signal| match signal {
            Signal::Load | Signal::Command => Some(format!("drive[{slot}]")),
            Signal::CommandFrom => Some(format!("command[{}]", element.from.joint)),
            _ => None,
        };
        write_law(parts, element, &of_signal, text)?;
        writeln!(text, "        drive[{slot}] = outputs[{}];", element.torque)?;
        if element.torque_from != NONE && element.from.slot != NONE {
            writeln!(text, "        drive[{}] += outputs[{}];", element.from.slot, element.torque_from)?;
        }
        text.push_str("    }\n");
    }
    Ok(())
}

fn load(parts: &Parts, text: &mut String) -> std::fmt::Result {
    text.push_str("    (void)t; (void)q; (void)dq; (void)states; (void)drive; (void)rates;\n");
    let n = parts.system.n_free();
    writeln!(text, "    for (int k = 0; k < {n}; k++) {{\n        load[k] = 0.0;\n    }}")?;
    let of_drive = |element: &Element| (element.joint.slot != NONE).then(|| format!("drive[{}]", element.joint.slot));
    for element in parts.system.part(Part::Friction) {
        let of_signal = |signal| if signal == Signal::Load { of_drive(element) } else { None };
        write_law(parts, element, &of_signal, text)?;
        deliver(element, text)?;
    }
    let loads = parts.system.part(Part::Load);
    if loads.iter().any(|element| element.uses.contains(Signal::Friction)) {
        writeln!(text, "    double friction[{n}];")?;
        writeln!(text, "    for (int k = 0; k < {n}; k++) {{\n        friction[k] = load[k];\n    }}")?;
    }
    for element in loads {
        let of_signal = |signal| match signal {
            Signal::Load => of_drive(element),
            Signal::Friction if element.joint.slot != NONE => Some(format!("friction[{}]", element.joint.slot)),
            _ => None,
        };
        write_law(parts, element, &of_signal, text)?;
        deliver(element, text)?;
    }
    Ok(())
}

/// Adds an element's torques to the joints that it acts on, and closes its block.
fn deliver(element: &Element, text: &mut String) -> std::fmt::Result {
    if element.joint.slot != NONE {
        writeln!(text, "        load[{}] += outputs[{}];", element.joint.slot, element.torque)?;
    }
    if element.torque_from != NONE && element.from.slot != NONE {
        writeln!(text, "        load[{}] += outputs[{}];", element.from.slot, element.torque_from)?;
    }
    text.push_str("    }\n");
    Ok(())
}

/// Opens a block in which a law fills `outputs`. `of_signal` gives what the place of the law knows beside motion and time.
fn write_law(
    Parts { system, prefix, .. }: &Parts,
    element: &Element,
    of_signal: &dyn Fn(Signal) -> Option<String>,
    text: &mut String,
) -> std::fmt::Result {
    let first_state = element.z - 2 * system.n_free();
    let motion = |end: &End, array: &str, locked: f64| match end {
        End { joint: NONE, .. } => None,
        End { slot: NONE, .. } => Some(dynid_kernels::c_number(locked)),
        End { slot, .. } => Some(format!("{array}[{slot}]")),
    };
    let of_motion = |signal: Signal| -> Option<String> {
        match signal {
            Signal::Q => motion(&element.joint, "q", element.joint.angle),
            Signal::Dq => motion(&element.joint, "dq", 0.0),
            Signal::QFrom => motion(&element.from, "q", element.from.angle),
            Signal::DqFrom => motion(&element.from, "dq", 0.0),
            Signal::T => Some("t".to_owned()),
            Signal::Qeq if element.qeq != NONE => Some(format!("{prefix}_effect_parameters[{}]", element.qeq)),
            _ => None,
        }
    };
    let read = |own: Signal| element.uses.contains(own).then(|| of_signal(own).or_else(|| of_motion(own))).flatten();
    let signals: Vec<String> = SIGNALS.into_iter().map(|own| read(own).unwrap_or_else(|| "0.0".to_owned())).collect();
    let at = if element.joint.joint == NONE { String::new() } else { format!(" at joint {}", element.joint.joint) };
    let id = element.kernel.id;
    writeln!(text, "    {{ /* {}{at} */", one_line(id))?;
    writeln!(text, "        const double signals[{N_SIGNALS}] = {{{}}};", signals.join(", "))?;
    writeln!(text, "        double outputs[{}];", element.kernel.n_outputs)?;
    let [states, rates] = ["states", "rates"].map(|array| {
        // What has no state is given none.
        if element.nz == 0 { "0".to_owned() } else { format!("{array} + {first_state}") }
    });
    writeln!(
        text,
        "        {prefix}_law_{id}({prefix}_effect_parameters + {}, signals, {states}, outputs, {rates});",
        element.p
    )
}

/// In their order in the slice that laws read.
const SIGNALS: [Signal; N_SIGNALS] = [
    Signal::Q,
    Signal::Dq,
    Signal::Ddq,
    Signal::T,
    Signal::Load,
    Signal::Friction,
    Signal::Qeq,
    Signal::QFrom,
    Signal::DqFrom,
    Signal::Command,
    Signal::CommandFrom,
];

fn inertia(parts: &Parts, text: &mut String) -> std::fmt::Result {
    writeln!(text, "    {}_inertia(prepared, q, D);", parts.prefix)?;
    add_inertia(parts, text)
}

fn add_inertia(parts: &Parts, text: &mut String) -> std::fmt::Result {
    let n = parts.system.n_free();
    parts.system.added_inertia().iter().try_for_each(|(row, column, value)| {
        writeln!(text, "    D[{}] += {};", row * n + column, dynid_kernels::c_number(*value))
    })
}

fn torque(parts: &Parts, text: &mut String) -> std::fmt::Result {
    let Parts { system, prefix, .. } = parts;
    let n = system.n_free();
    writeln!(text, "    double load[{n}], rigid[{n}], rates[{}];", system.initial_states().len().max(1))?;
    writeln!(text, "    {prefix}_load(t, q, dq, states, drive, load, rates);")?;
    writeln!(text, "    {prefix}_inverse_dynamics(prepared, q, dq, ddq, rigid);")?;
    for (row, column, value) in system.added_inertia() {
        writeln!(text, "    rigid[{row}] += {} * ddq[{column}];", dynid_kernels::c_number(*value))?;
    }
    writeln!(text, "    for (int k = 0; k < {n}; k++) {{\n        tau[k] = rigid[k] + load[k];\n    }}")
}

fn accelerations(parts: &Parts, text: &mut String) -> std::fmt::Result {
    let Parts { system, prefix, .. } = parts;
    let n = system.n_free();
    writeln!(text, "    double torque[{n}], load[{n}];")?;
    writeln!(text, "    {prefix}_drive(t, q, dq, states, command, torque, rates);")?;
    writeln!(text, "    for (int k = 0; k < {n}; k++) {{\n        torque[k] += external[k];\n    }}")?;
    writeln!(text, "    {prefix}_load(t, q, dq, states, torque, load, rates);")?;
    writeln!(text, "    for (int k = 0; k < {n}; k++) {{\n        torque[k] -= load[k];\n    }}")?;
    if system.added_inertia().is_empty() {
        return writeln!(text, "    {prefix}_forward_dynamics(prepared, q, dq, torque, ddq);");
    }
    writeln!(text, "    double D[{}], h[{n}];", n * n)?;
    writeln!(text, "    {prefix}_inertia_and_bias(prepared, q, dq, D, h);")?;
    add_inertia(parts, text)?;
    text.push_str(&SOLVE.replace("SIZE", &n.to_string()));
    Ok(())
}

/// `D ddq = torque - h` by `L diag(d) L^T`; below the diagonal of D stands L in the end, on it the reciprocal of d.
const SOLVE: &str = "    for (int row = 0; row < SIZE; row++) {
        for (int column = 0; column < row; column++) {
            for (int k = 0; k < column; k++) {
                D[row * SIZE + column] -= D[row * SIZE + k] * D[column * SIZE + k];
            }
        }
        double pivot = D[row * SIZE + row];
        for (int column = 0; column < row; column++) {
            const double scaled = D[row * SIZE + column];
            D[row * SIZE + column] = scaled * D[column * SIZE + column];
            pivot -= scaled * D[row * SIZE + column];
        }
        D[row * SIZE + row] = 1.0 / pivot;
    }
    for (int row = 0; row < SIZE; row++) {
        torque[row] -= h[row];
        for (int k = 0; k < row; k++) {
            torque[row] -= D[row * SIZE + k] * torque[k];
        }
    }
    for (int row = SIZE - 1; row >= 0; row--) {
        torque[row] *= D[row * SIZE + row];
        for (int k = row + 1; k < SIZE; k++) {
            torque[row] -= D[k * SIZE + row] * torque[k];
        }
    }
    for (int k = 0; k < SIZE; k++) {
        ddq[k] = torque[k];
    }
";

fn measure(parts: &Parts, text: &mut String) -> std::fmt::Result {
    let n = parts.system.n_free();
    text.push_str("    (void)t;\n");
    writeln!(text, "    for (int k = 0; k < {n}; k++) {{\n        shown[k] = q[k];\n    }}")?;
    for element in parts.system.part(Part::Sensor) {
        let slot = element.joint.slot;
        write_law(parts, element, &|signal| (signal == Signal::Q).then(|| format!("shown[{slot}]")), text)?;
        writeln!(text, "        shown[{slot}] = outputs[{}];\n    }}", element.torque)?;
    }
    Ok(())
}

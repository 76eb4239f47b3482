//! What the file is, its sizes, and its declarations.

use std::fmt::Write;

use super::{Parts, one_line, unless_left_out};

pub(super) fn write_head(parts: &Parts, text: &mut String) -> std::fmt::Result {
    let Parts { model, system, kernels, prefix } = parts;
    let guard = prefix.to_uppercase();
    let joints = |joints: &[usize]| {
        let named = joints.iter().map(|joint| format!("{joint} ({})", model.device.joints[*joint].title));
        if joints.is_empty() { "none".to_owned() } else { named.collect::<Vec<_>>().join(", ") }
    };
    let kernel = system.kernel();
    writeln!(text, "/* {}: identified dynamics in C99, written by `dynid export`.", one_line(&model.device.title))?;
    writeln!(text, " *\n * device {}; model sha256 {}", one_line(&model.device.id), model.digest())?;
    writeln!(text, " * free joints: {}", one_line(&joints(kernel.free)))?;
    writeln!(text, " * locked joints: {}", one_line(&joints(kernel.locked)))?;
    text.push_str(&ABOUT.replace("PREFIX", prefix).replace("GUARD", &guard));
    writeln!(text, "#ifndef {guard}_DYNAMICS_H\n#define {guard}_DYNAMICS_H\n")?;
    for (name, what, size) in [
        ("N_FREE", "free joints", system.n_free()),
        ("N_JOINTS", "joints", system.n_joints()),
        ("N_LOCKED", "locked joints", kernel.locked.len()),
        ("N_PARAMETERS", "model parameters of the equations", kernels.parameters.len()),
        ("N_PREPARED", "values that prepare makes", kernels.n_prepared),
        ("N_LUMPS", "the first of them, in which the torque is linear", kernels.n_lumps),
        ("N_STATES", "states of the effects", system.initial_states().len()),
    ] {
        writeln!(text, "#define {guard}_{name} {size}  /* {what} */")?;
    }
    writeln!(text, "\n#ifdef __cplusplus\nextern \"C\" {{\n#endif\n")?;
    for own in kernels.equations.iter().chain(&kernels.end_point) {
        unless_left_out(own, &guard, text, |text| {
            writeln!(text, "/* {} */\n{};\n", one_line(&own.title), own.prototype)
        })?;
    }
    let lengths = [
        ("parameters", kernels.parameters.len()),
        ("locked", kernel.locked.len()),
        ("lengths", kernels.lengths.len()),
        ("effect_parameters", system.effect_parameters().len()),
        ("initial_states", system.initial_states().len()),
    ];
    for (name, length) in lengths {
        writeln!(text, "extern const double {prefix}_{name}[{}];", length.max(1))?;
    }
    text.push('\n');
    for (does, prototype) in MODEL_FUNCTIONS {
        writeln!(text, "/* {does} */\n{};\n", prototype_of(parts, prototype))?;
    }
    writeln!(text, "#ifdef __cplusplus\n}}\n#endif\n\n#endif /* {guard}_DYNAMICS_H */\n")
}

/// Functions of the whole model: what they do, and their heads with `N` for the free joints, `J` for all and `P` for what is prepared.
pub(super) const MODEL_FUNCTIONS: [(&str, &str); 7] = [
    (
        "What the equations need, from the model's values: once at the start.",
        "void PREFIX_prepare_model(double prepared[P])",
    ),
    (
        "What the drives deliver to the free joints under the commands of all joints, and the rates of the states on that way.",
        "void PREFIX_drive(double t, const double q[N], const double dq[N], const double *states, const double command[J], double drive[N], double *rates)",
    ),
    (
        "What resists motion at the free joints (friction, springs, ..) while the drives deliver `drive`, and the rates of its states.",
        "void PREFIX_load(double t, const double q[N], const double dq[N], const double *states, const double drive[N], double load[N], double *rates)",
    ),
    (
        "Inertia matrix, rotors included.",
        "void PREFIX_model_inertia(const double prepared[P], const double q[N], double D[N*N])",
    ),
    (
        "Torque that the drives must deliver for the accelerations `ddq`: rigid bodies, rotors, friction, springs. Laws that read the delivered torque take `drive` for it; zeros will do where there are none.",
        "void PREFIX_model_torque(const double prepared[P], double t, const double q[N], const double dq[N], const double ddq[N], const double *states, const double drive[N], double tau[N])",
    ),
    (
        "Accelerations of the free joints, and rates of the effects' states, under the commands of all joints and torques from outside (zeros without any). Together with dq they are the derivative of (q, dq, states).",
        "void PREFIX_model_accelerations(const double prepared[P], double t, const double q[N], const double dq[N], const double *states, const double command[J], const double external[N], double ddq[N], double *rates)",
    ),
    ("What the sensors show of the positions.", "void PREFIX_measure(double t, const double q[N], double shown[N])"),
];

/// A head with its sizes.
pub(super) fn prototype_of(Parts { system, kernels, prefix, .. }: &Parts, prototype: &str) -> String {
    let n = system.n_free();
    let sizes = [("[N*N]", n * n), ("[N]", n), ("[J]", system.n_joints()), ("[P]", kernels.n_prepared)];
    let sized = |text: String, (from, to): (&str, usize)| text.replace(from, &format!("[{to}]"));
    sizes.into_iter().fold(prototype.replace("PREFIX", prefix), sized)
}

const ABOUT: &str = " *
 * Compile it as it is; it needs nothing but <math.h> and <stdint.h>:
 *     cc -std=c99 -O2 -c PREFIX.c                  (link with -lm)
 * Other files get the declarations from the same file:
 *     #define GUARD_DECLARATIONS_ONLY
 *     #include \"PREFIX.c\"
 * Of a robot of many joints, -DGUARD_WITHOUT_DERIVATIVES leaves out what takes compilers long: PREFIX_coriolis, PREFIX_regressor and
 * PREFIX_inverse_dynamics_gradient.
 * Without -std=c99 (or with -ffast-math) compilers contract or reorder operations: results then differ in the last digits.
 *
 * Units are SI: rad, rad/s, rad/s^2 and N*m of revolute joints; m, m/s, m/s^2 and N of prismatic ones; commands as they were
 * logged. Vectors are in the order of the free joints, but for `command`, which has all joints; matrices are row by row.
 * Nothing is allocated and nothing is kept between calls. No result may be written over an argument, but for the functions of the
 * rigid bodies, which read all before they write.
 *
 * At the start:          PREFIX_prepare_model(prepared);
 *                        states = PREFIX_initial_states (GUARD_N_STATES of them; where that is 0, pass any pointer)
 * To carry the robot:    PREFIX_gravity(prepared, q, tau);
 * To move it:            PREFIX_model_torque(prepared, t, q, dq, ddq, states, drive, tau);
 * To simulate it:        PREFIX_model_accelerations(prepared, t, q, dq, states, command, external, ddq, rates);
 *
 * PREFIX_gravity, PREFIX_inertia, PREFIX_bias, PREFIX_inverse_dynamics, PREFIX_forward_dynamics, .. are of the rigid bodies alone,
 * without rotors, friction and springs; the functions whose names have `model` in them are of the whole. `load` and friction are
 * positive along dq when they resist. `t` (s) counts from the start of a run. A command that the model delays is taken as it arrives.
 */

";

//! The C99 file, compiled, against the kernels and the systems of Rust.
//!
//! That the Rust is right is tested where it is made; here only the writing is compared. `CC` names a compiler other than `cc`; where there is none, this is skipped aloud.

use std::fmt::Write;
use std::fs;
use std::process::Command;

use dynid_dynamics::system::System;
use dynid_export::as_c99;
use dynid_model::{Effect, Scope};
use dynid_random::Random;
use dynid_user_model::{EffectInstance, Model};

/// Relative to the largest number of the same result.
const TOLERANCE: f64 = 1e-12;

const STATES: usize = 5;

/// A program that calls the functions of a file and prints what they fill.
struct Calls {
    prefix: String,
    body: String,
    expected: Vec<(String, Vec<f64>)>,
}

impl Calls {
    fn new(model: &Model) -> Self {
        let prefix = model.device.id.clone();
        let body = format!(
            "    double prepared[{}_N_PREPARED];\n    {prefix}_prepare_model(prepared);\n",
            prefix.to_uppercase()
        );
        Self { prefix, body, expected: Vec::new() }
    }

    /// Calls `<prefix>_<function>` with `arguments`, of which those that are text stand as they are; the results of these lengths must
    /// be what is `expected`.
    fn call(&mut self, function: &str, arguments: &[Argument], expected: &[&[f64]]) {
        self.body.push_str("    {\n");
        let mut passed = Vec::new();
        for (number, argument) in arguments.iter().enumerate() {
            match argument {
                Argument::Text(text) => passed.push((*text).to_owned()),
                Argument::Number(number) => passed.push(format!("{number:?}")),
                Argument::Array(values) => {
                    let list: Vec<String> = values.iter().map(|value| format!("{value:?}")).collect();
                    let list = if list.is_empty() { "0".to_owned() } else { list.join(", ") };
                    let _ = writeln!(self.body, "        const double a{number}[] = {{{list}}};");
                    passed.push(format!("a{number}"));
                }
            }
        }
        for (number, expected) in expected.iter().enumerate() {
            let _ = writeln!(self.body, "        double r{number}[{}];", expected.len().max(1));
            passed.push(format!("r{number}"));
            self.expected.push((format!("{}_{function}, result {number}", self.prefix), expected.to_vec()));
        }
        let _ = writeln!(self.body, "        {}_{function}({});", self.prefix, passed.join(", "));
        for (number, expected) in expected.iter().enumerate() {
            let _ = writeln!(self.body, "        show(r{number}, {});", expected.len());
        }
        self.body.push_str("    }\n");
    }

    /// Largest relative error; `None` where there is no compiler.
    fn check(&self, file: &str) -> Option<f64> {
        let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
        if !Command::new(&compiler).arg("--version").output().is_ok_and(|output| output.status.success()) {
            eprintln!("SKIPPED: `{compiler}` is no C compiler (CC names another)");
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        let (prefix, guard) = (&self.prefix, self.prefix.to_uppercase());
        let main = format!(
            "#include <stdio.h>\n#define {guard}_DECLARATIONS_ONLY\n#include \"{prefix}.c\"\n\
             static void show(const double *values, int n)\n{{\n    for (int k = 0; k < n; k++) printf(\"%.17g \", values[k]);\n    \
             printf(\"\\n\");\n}}\nint main(void)\n{{\n{}    return 0;\n}}\n",
            self.body
        );
        fs::write(folder.path().join("main.c"), main).unwrap();
        fs::write(folder.path().join(format!("{prefix}.c")), file).unwrap();
        let strict = ["-std=c99", "-pedantic-errors", "-Wall", "-Wextra", "-Werror", "-O2"];
        let output = Command::new(compiler)
            .args(strict)
            .args(["main.c", &format!("{prefix}.c"), "-o", "main", "-lm"])
            .current_dir(folder.path())
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let output = Command::new(folder.path().join("main")).output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        assert_eq!(text.lines().count(), self.expected.len());
        let mut largest = 0.0_f64;
        for (line, (what, expected)) in text.lines().zip(&self.expected) {
            let found: Vec<f64> = line.split_whitespace().map(|word| word.parse().unwrap()).collect();
            assert_eq!(found.len(), expected.len(), "{what}");
            let size = expected.iter().fold(f64::MIN_POSITIVE, |size, value| size.max(value.abs()));
            for (found, expected) in found.iter().zip(expected) {
                let error = (found - expected).abs() / size;
                assert!(error <= TOLERANCE, "{what}: {found:?} for {expected:?}");
                largest = largest.max(error);
            }
        }
        Some(largest)
    }
}

#[derive(Clone, Copy)]
enum Argument<'a> {
    Text(&'a str),
    Number(f64),
    Array(&'a [f64]),
}
use Argument::{Array, Number, Text};

/// Every kernel, at random states.
fn assert_kernels_are_the_same(device: &str, free: &[usize]) {
    let mut model = Model::of_device(dynid_model::device(device).unwrap());
    let n_joints = model.device.joints.len();
    let mut random = Random::new(7);
    // Not every device that ships states bodies.
    for link in &mut model.links {
        let values = [vec![1.0], random.vector(3, -0.2, 0.2), vec![0.03, 0.002, -0.001, 0.02, 0.004, 0.04]].concat();
        link.iter_mut().zip(values).for_each(|(own, value)| own.value = value);
    }
    let posture = random.vector(n_joints, -1.0, 1.0);
    let system = model.system(free, |joint| posture[joint]).unwrap();
    let (kernel, functions, n) = (system.kernel(), system.kernel().functions, free.len());
    let of_rust = system.prepared();
    let mut calls = Calls::new(&model);
    for _ in 0..STATES {
        let [q, dq, ddq, tau] = [2.0, 3.0, 10.0, 1.0].map(|size| random.vector(n, -size, size));
        let zeros = |length: usize| vec![0.0; length];
        let (mut d, mut c, mut phi, mut h) = (zeros(n * n), zeros(n * n), zeros(n), zeros(n));
        functions.inertia(of_rust, &q, &mut d);
        calls.call("inertia", &[Text("prepared"), Array(&q)], &[&d]);
        functions.coriolis(of_rust, &q, &dq, &mut c);
        calls.call("coriolis", &[Text("prepared"), Array(&q), Array(&dq)], &[&c]);
        functions.gravity(of_rust, &q, &mut phi);
        calls.call("gravity", &[Text("prepared"), Array(&q)], &[&phi]);
        functions.bias(of_rust, &q, &dq, &mut h);
        calls.call("bias", &[Text("prepared"), Array(&q), Array(&dq)], &[&h]);
        calls.call("inertia_and_bias", &[Text("prepared"), Array(&q), Array(&dq)], &[&d, &h]);
        let (mut torque, mut accelerations) = (zeros(n), zeros(n));
        functions.inverse_dynamics(of_rust, &q, &dq, &ddq, &mut torque);
        calls.call("inverse_dynamics", &[Text("prepared"), Array(&q), Array(&dq), Array(&ddq)], &[&torque]);
        functions.forward_dynamics(of_rust, &q, &dq, &tau, &mut accelerations);
        calls.call("forward_dynamics", &[Text("prepared"), Array(&q), Array(&dq), Array(&tau)], &[&accelerations]);
        let (mut by_q, mut by_dq) = (zeros(n * n), zeros(n * n));
        functions.inverse_dynamics_gradient(of_rust, &q, &dq, &ddq, &mut torque, &mut by_q, &mut by_dq);
        let motion = [Text("prepared"), Array(&q), Array(&dq), Array(&ddq)];
        calls.call("inverse_dynamics_gradient", &motion, &[&torque, &by_q, &by_dq]);
        if let Some(point) = dynid_kernels::end_point(model.device).unwrap() {
            let all = random.vector(n_joints, -2.0, 2.0);
            let lengths: Vec<f64> = model.lengths.iter().map(|own| own.value).collect();
            let (mut position, mut rotation, mut jacobian) = (zeros(3), zeros(9), zeros(6 * n_joints));
            point.functions.motion(&lengths, &all, &mut position, &mut rotation, &mut jacobian);
            let given = [Array(&lengths), Array(&all)];
            calls.call("end_point_pose", &given, &[&position, &rotation]);
            calls.call("end_point_motion", &given, &[&position, &rotation, &jacobian]);
        }
    }
    assert_eq!(kernel.free, free);
    let file = as_c99(&model, free, &posture).unwrap().text;
    if let Some(error) = calls.check(&file) {
        eprintln!("{device}, free {free:?}: largest error {error:.1e}");
    }
}

#[test]
fn kernels_are_those_of_rust() {
    for (device, free) in [
        ("freedom6s", &[0, 1, 2, 3, 4, 5][..]),
        ("freedom6s", &[1, 4]),
        ("staubli_tx40", &[0, 1, 2, 3, 4, 5]),
        ("planar2r", &[0, 1]),
    ] {
        assert_kernels_are_the_same(device, free);
    }
}

/// The regressor is of the file's own lumps: with the ones that it prepares it must give the torque without what no lump has.
#[test]
fn the_regressor_is_that_of_the_lumps() {
    let model = Model::of_device(dynid_model::device("planar2r").unwrap());
    let mut calls = Calls::new(&model);
    let [q, dq, ddq] = [0.4, -1.3, 2.0].map(|value| vec![value, 0.7 * value]);
    let mut torque = vec![0.0; 2];
    let system = model.system(&[0, 1], |_| 0.0).unwrap();
    system.kernel().functions.inverse_dynamics(system.prepared(), &q, &dq, &ddq, &mut torque);
    calls.body.push_str(
        "    const double q[] = {0.4, 0.27999999999999997}, dq[] = {-1.3, -0.9099999999999999}, ddq[] = {2.0, 1.4};\n    \
         double y[2 * PLANAR2R_N_LUMPS], tau[2] = {0.0, 0.0};\n    planar2r_regressor(prepared, q, dq, ddq, y);\n    \
         for (int row = 0; row < 2; row++)\n        for (int k = 0; k < PLANAR2R_N_LUMPS; k++)\n            \
         tau[row] += y[row * PLANAR2R_N_LUMPS + k] * prepared[k];\n    show(tau, 2);\n",
    );
    calls.expected.push(("regressor times lumps".to_owned(), torque));
    calls.check(&as_c99(&model, &[0, 1], &[]).unwrap().text);
}

/// A value of an effect's parameter that is neither its first guess nor where it vanishes.
fn typical(effect: &Effect, random: &mut Random) -> Vec<f64> {
    let between = |initial: f64, lower: f64, upper: f64, share: f64| {
        (initial * (1.0 + 0.3 * share) + 0.02 * share).clamp(lower, upper)
    };
    let shares = random.vector(effect.parameters.len(), 0.2, 1.0);
    effect.parameters.iter().zip(shares).map(|(own, share)| between(own.initial, own.lower, own.upper, share)).collect()
}

fn with(effects: &[&str], joints: (usize, usize), random: &mut Random) -> Model {
    let mut model = Model::of_device(dynid_model::device("planar2r").unwrap());
    model.effects.clear();
    for id in effects {
        let effect = dynid_model::effect(id).unwrap();
        let (joint, from) = match effect.scope {
            Scope::Joint => (Some(joints.0), None),
            Scope::Pair => (Some(joints.0), Some(joints.1)),
            Scope::Device => (None, None),
        };
        let mut instance = EffectInstance::new(model.device, id, joint, from).unwrap();
        let values = typical(effect, random);
        instance.parameters.iter_mut().zip(values).for_each(|(own, value)| own.value = value);
        model.effects.push(instance);
    }
    model
}

fn assert_model_is_the_same(model: &Model, free: &[usize]) {
    let mut random = Random::new(11);
    let posture = [0.3, -0.7];
    let system: System = model.system(free, |joint| posture[joint]).unwrap();
    let n = free.len();
    let n_states = system.n_states() - 2 * n;
    let mut scratch = system.scratch();
    let mut calls = Calls::new(model);
    for _ in 0..STATES {
        let mut x = random.vector(2 * n, -1.5, 1.5);
        x.extend(random.vector(n_states, -0.01, 0.01));
        let (command, external) = (random.vector(2, -1.0, 1.0), random.vector(n, -1.0, 1.0));
        let ddq = random.vector(n, -5.0, 5.0);
        let t = 0.7;
        let (q, dq, states) = (&x[..n], &x[n..2 * n], &x[2 * n..]);
        let mut dx = vec![0.0; x.len()];
        system.derivative_under(&mut scratch, t, &x, &command, &external, &mut dx);
        let motion = [Number(t), Array(q), Array(dq), Array(states)];
        let [t_, q_, dq_, states_] = motion;
        let given = [Text("prepared"), t_, q_, dq_, states_, Array(&command), Array(&external)];
        calls.call("model_accelerations", &given, &[&dx[n..2 * n], &dx[2 * n..]]);
        system.effects_alone(&mut scratch, t, &x, &command, &mut dx);
        let drive = scratch.drive.clone();
        let mut torque = vec![0.0; n];
        system.missing_torque(&mut scratch, t, (&x, &ddq), &command, &mut dx, &mut torque);
        torque.iter_mut().zip(&drive).for_each(|(torque, drive)| *torque += drive);
        let given = [Text("prepared"), t_, q_, dq_, Array(&ddq), states_, Array(&drive)];
        calls.call("model_torque", &given, &[&torque]);
        let mut shown = vec![0.0; n];
        system.measure(t, &x, &mut shown);
        calls.call("measure", &[Number(t), Array(q)], &[&shown]);
    }
    calls.check(&as_c99(model, free, &posture).unwrap().text);
}

/// Each effect of the library alone, at either joint and with the other one locked.
#[test]
fn every_effect_is_the_one_of_rust() {
    let mut random = Random::new(5);
    for effect in dynid_model::effects() {
        assert_model_is_the_same(&with(&[&effect.id], (1, 0), &mut random), &[0, 1]);
    }
    for effect in ["friction_coupled", "rotor_coupling", "input_coupling", "payload"] {
        assert_model_is_the_same(&with(&[effect], (1, 0), &mut random), &[1]);
        assert_model_is_the_same(&with(&[effect], (0, 1), &mut random), &[1]);
    }
}

/// What effects do to each other: the order of the drive path, the rest position, the sum of the friction, the rotor.
#[test]
fn effects_together_are_those_of_rust() {
    let mut random = Random::new(6);
    let whole = [
        "gain",
        "input_lag",
        "torque_offset",
        "input_coupling",
        "joint_elasticity",
        "spring",
        "hysteresis",
        "friction_bias",
        "lugre",
        "viscous",
        "friction_coupled",
        "rotor_inertia",
        "rotor_coupling",
        "payload",
        "sensor_scale",
        "sensor_offset",
        "friction_load",
    ];
    for joints in [(0, 1), (1, 0)] {
        assert_model_is_the_same(&with(&whole, joints, &mut random), &[0, 1]);
    }
}

/// A command that is late is told, since no function of the file can keep it back.
#[test]
fn delays_are_noted() {
    let model = with(&["input_delay"], (1, 0), &mut Random::new(1));
    let notes = as_c99(&model, &[0, 1], &[]).unwrap().notes;
    assert_eq!(notes.len(), 1);
    assert!(notes[0].starts_with("the command of joint 1 arrives "), "{notes:?}");
}

/// What a robot carries in some runs is no part of it, and that is told.
#[test]
fn payloads_of_runs_are_told() {
    let mut model = Model::of_device(dynid_model::device("planar2r").unwrap());
    let without = as_c99(&model, &[0, 1], &[]).unwrap();
    let mut payload = EffectInstance::new(model.device, "payload", Some(1), None).unwrap();
    payload.payload = Some("box".to_owned());
    model.effects.push(payload);
    let with = as_c99(&model, &[0, 1], &[]).unwrap();
    assert_eq!(
        with.notes,
        [
            "`payload` at joint 1 with `box` is left out: the file is of the robot as it is without what it carries in some runs"
        ]
    );
    assert_eq!(without.notes, [""; 0]);
}

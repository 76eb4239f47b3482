use std::f64::consts::PI;

use dynid_model::Scope;

use super::*;
use dynid_dynamics::{
    simulate::Intersample, system::fixtures::ARM, system::fixtures::GAIN, system::fixtures::INPUT_COUPLING,
    system::fixtures::LUGRE, system::fixtures::ROTOR_INERTIA, system::fixtures::SPRING, system::fixtures::VISCOUS,
    system::fixtures::placed,
};
use dynid_logs::{experiment::Role, experiment::Run, experiment::Settings, log::Log};
use dynid_user_model::Model;

/// Masses, centroids, inertias of the two links.
const LINKS: [f64; 6] = [1.2, 0.21, 0.02, 0.8, 0.17, 0.011];

/// The arm with effects of every kind that the torque error knows.
fn arm() -> System {
    let effects = [
        placed(&GAIN, 0, None, &[1.4]),
        placed(&GAIN, 1, None, &[0.8]),
        placed(&INPUT_COUPLING, 1, Some(0), &[-0.2]),
        placed(&SPRING, 0, None, &[0.9, 0.5]),
        placed(&LUGRE, 0, None, &[8.0, 0.4, 0.05, 0.2, 0.5, 0.3]),
        placed(&VISCOUS, 1, None, &[0.02]),
        placed(&ROTOR_INERTIA, 1, None, &[0.004]),
    ];
    System::new(&ARM, 2, LINKS.to_vec(), Vec::new(), &effects).expect("the arm is complete")
}

/// A smooth motion of both joints with made-up torques.
fn run() -> Run {
    let t: Vec<f64> = (0..1200).map(|k| 0.01 * f64::from(k)).collect();
    let wave = |scale: f64, hertz: f64, phase: f64| -> Vec<f64> {
        t.iter().map(|t| scale * (2.0 * PI * hertz * t + phase).sin()).collect()
    };
    let log = Log {
        q: vec![wave(0.8, 0.31, 0.2), wave(1.1, 0.47, 1.0)],
        tau: vec![wave(3.0, 0.5, 0.7), wave(1.0, 0.9, 0.1)],
        t,
        reference: None,
        mask: None,
        left_out: Vec::new(),
    };
    let settings = Settings {
        cutoff_hz: Some(5.0),
        decimate: 4,
        min_speed: vec![0.0; 2],
        intersample: Intersample::FirstOrder,
        ..Settings::default()
    };
    Run {
        file: "arm.csv".to_owned(),
        role: Role::Fit,
        free: vec![0, 1],
        payload: None,
        configuration: 1,
        log,
        settings,
    }
}

#[test]
fn a_torque_that_fits_the_motion_leaves_no_error() {
    // A slow motion, whose torque the filter passes: tau = D ddq + h by the closed form.
    let mut run = run();
    let (a, b) = (0.8, 1.1);
    let (u, v) = (2.0 * PI * 0.31, 2.0 * PI * 0.47);
    let system = System::new(&ARM, 2, LINKS.to_vec(), Vec::new(), &[]).expect("the arm is complete");
    for k in 0..run.log.len() {
        let (p, r) = (u * run.log.t[k] + 0.2, v * run.log.t[k] + 1.0);
        let mut tau = [0.0; 2];
        ARM.functions.inverse_dynamics(
            system.prepared(),
            &[a * p.sin(), b * r.sin()],
            &[a * u * p.cos(), b * v * r.cos()],
            &[-a * u * u * p.sin(), -b * v * v * r.sin()],
            &mut tau,
        );
        run.log.tau[0][k] = tau[0];
        run.log.tau[1][k] = tau[1];
    }
    for mut joint in torque_error(&system, &run).expect("long enough") {
        let percent = joint.percent().expect("there is torque");
        assert!(percent < 0.05, "joint {}: {percent} %", joint.joint);
        joint.residual.fill(f64::NAN);
        assert_eq!(joint.percent(), None, "what is no number is no percentage");
    }
}

#[test]
fn error_and_linear_equations_agree() {
    let (system, motion) = (arm(), Motion::of(&run()).expect("long enough"));
    let rigid = rigid_columns(&system, &motion);
    let linear = linearise(&system, &motion, &rigid);
    for (joint, linear) in along(&system, &motion).iter().zip(&linear) {
        let scale = joint.residual.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
        for (a, b) in joint.residual.iter().zip(&linear.residual) {
            assert!((a - b).abs() < 1e-12 * scale, "{a} {b}");
        }
    }
}

/// Central differences of the torque error by every effect parameter and every lump.
#[test]
fn gradients_agree_with_differences() {
    let (system, motion) = (arm(), Motion::of(&run()).expect("long enough"));
    let rigid = rigid_columns(&system, &motion);
    let linear = linearise(&system, &motion, &rigid);
    let parameters = system.effect_parameters().to_vec();
    for parameter in 0..parameters.len() {
        let step = 1e-5 * parameters[parameter].abs();
        let at = |sign: f64| {
            let mut moved = parameters.clone();
            moved[parameter] += sign * step;
            let mut system = system.clone();
            system.set_parameters(&LINKS, &moved);
            along(&system, &motion)
        };
        let (low, high) = (at(-1.0), at(1.0));
        for slot in 0..2 {
            let difference: Vec<f64> = low[slot]
                .residual
                .iter()
                .zip(&high[slot].residual)
                .map(|(low, high)| (high - low) / (2.0 * step))
                .collect();
            let exact = linear[slot].by_parameter[parameter].clone().unwrap_or_else(|| vec![0.0; difference.len()]);
            let size = difference.iter().fold(1e-3_f64, |size, value| size.max(value.abs()));
            for (difference, exact) in difference.iter().zip(&exact) {
                let name = &system.effect_names()[parameter];
                assert!((difference - exact).abs() < 1e-6 * size, "{name}: {difference} {exact}");
            }
        }
    }
    for slot in 0..2 {
        for (lump, column) in rigid[slot].iter().enumerate() {
            let mut sum = vec![0.0; motion.len()];
            for (k, sum) in sum.iter_mut().enumerate() {
                let (q, dq, ddq) = (
                    [motion.q[0][k], motion.q[1][k]],
                    [motion.dq[0][k], motion.dq[1][k]],
                    [motion.ddq[0][k], motion.ddq[1][k]],
                );
                let mut unit = [0.0; 5];
                unit[lump] = 1.0;
                let mut tau = [0.0; 2];
                ARM.functions.inverse_dynamics(&unit, &q, &dq, &ddq, &mut tau);
                *sum = tau[slot];
            }
            match column {
                Some(column) => {
                    for (a, b) in motion.filtered(&sum).iter().zip(column) {
                        assert!((a - b).abs() < 1e-9, "{a} {b}");
                    }
                }
                None => assert!(sum.iter().all(|value| *value == 0.0)),
            }
        }
    }
}

#[path = "../../../tests/library_effects/values.rs"]
mod values;

/// The two-link arm with an effect of the library, springs and viscous friction.
fn arm_with(effect: &dynid_model::Effect) -> System {
    let mut model = Model::of_device(dynid_model::device("planar2r").expect("a shipped device"));
    model.effects.clear();
    for joint in [0, 1] {
        for id in ["spring", "viscous"] {
            model.add_effect(id, Some(joint), None).expect("an effect of the library");
        }
    }
    let (joint, from) = match effect.scope {
        Scope::Joint => (Some(1), None),
        Scope::Pair => (Some(0), Some(1)),
        Scope::Device => (None, None),
    };
    if !model.effects.iter().any(|own| own.effect.id == effect.id && own.joint == joint) {
        model.add_effect(&effect.id, joint, from).expect("an effect of the library");
    }
    for own in model.effects.iter_mut().filter(|own| own.effect.id == effect.id && own.joint == joint) {
        for (parameter, about) in own.parameters.iter_mut().zip(&effect.parameters) {
            let value = values::VALUES.iter().find(|(id, symbol, _)| *id == effect.id && *symbol == about.symbol);
            parameter.value = value.map_or(parameter.value, |(.., value)| *value);
        }
    }
    model.system(&[0, 1], |_| 0.0).expect("a configuration of the device")
}

/// Torque error and its derivatives with every effect of the library, also those of the drive path whose states follow
/// command and motion.
#[test]
fn gradients_by_every_effect_agree_with_differences() {
    let mut run = run();
    run.log.tau.iter_mut().flatten().for_each(|torque| *torque *= 4.0);
    let motion = Motion::of(&run).expect("long enough");
    let mut wrong = Vec::new();
    for effect in dynid_model::effects() {
        // What the sensor shows is taken for the motion; the torque error does not know its parameters.
        if effect.place == dynid_model::Place::Sensor {
            continue;
        }
        let system = arm_with(effect);
        let rigid = rigid_columns(&system, &motion);
        let linear = linearise(&system, &motion, &rigid);
        let links = system.link_parameters().to_vec();
        let parameters = system.effect_parameters().to_vec();
        let mut met = 0;
        for (parameter, name) in system.effect_names().iter().enumerate() {
            let at = |change: f64| {
                let mut moved = parameters.clone();
                moved[parameter] += change;
                let mut system = system.clone();
                system.set_parameters(&links, &moved);
                along(&system, &motion)
            };
            // Impacts amplify a change: it must stay small in the torque too.
            let exact = linear.iter().filter_map(|joint| joint.by_parameter[parameter].as_ref()).flatten();
            let largest = exact.fold(1e-3_f64, |size, value| size.max(value.abs()));
            let step = (1e-6 / largest).min(1e-5 * parameters[parameter].abs().max(1e-1));
            let (low, high) = (at(-step), at(step));
            for slot in 0..2 {
                let pairs = low[slot].residual.iter().zip(&high[slot].residual);
                let difference: Vec<f64> = pairs.map(|(low, high)| (high - low) / (2.0 * step)).collect();
                let zeros = vec![0.0; difference.len()];
                let exact = linear[slot].by_parameter[parameter].as_ref().unwrap_or(&zeros);
                let size = difference.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
                let errors = difference.iter().zip(exact).map(|(a, b)| (a - b).abs());
                let error = errors.fold(0.0_f64, f64::max);
                met += usize::from(size > 0.0 && name.contains(&format!(".{}.", effect.id)));
                if error > 1e-5 * size.max(1e-3) {
                    wrong.push(format!("with {}: {name} at {slot}: {error:.2e} of {size:.2e}", effect.id));
                }
            }
        }
        assert!(met > 0, "{} does not enter the torque error", effect.id);
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The terms add up to the command also where effects build on others.
#[test]
fn terms_add_up_where_effects_read_each_other() {
    let mut model = Model::of_device(dynid_model::device("planar2r").expect("a shipped device"));
    model.effects.clear();
    for joint in [0, 1] {
        for id in ["spring", "lugre", "friction_bias", "friction_load", "dead_zone", "saturation"] {
            model.add_effect(id, Some(joint), None).expect("an effect of the library");
        }
    }
    for (id, symbol, value) in values::VALUES {
        for joint in [0, 1] {
            let name = format!("joint.{joint}.{id}.{symbol}");
            if model.parameter(&name).is_some() {
                model.set_value(&name, value).expect("a parameter");
            }
        }
    }
    for joint in terms(&model, &run()).expect("a configuration of the device") {
        let names: Vec<&str> = joint.terms.iter().map(|(name, _)| name.as_str()).collect();
        let effects = ["spring", "lugre", "friction_bias", "friction_load", "dead_zone"];
        assert!(effects.iter().all(|name| names.contains(name)), "joint {}: {names:?}", joint.joint);
        let size = joint.rms(&joint.command);
        for (k, command) in joint.command.iter().enumerate() {
            let sum: f64 = joint.terms.iter().map(|(_, values)| values[k]).sum();
            assert!((sum - command).abs() < 1e-9 * size, "joint {}, sample {k}: {sum} {command}", joint.joint);
        }
    }
}

/// Systems that share what they can along a motion: each gets what it would get alone, whoever came before.
#[test]
fn what_is_remembered_changes_nothing() {
    let motion = Motion::of(&run()).expect("long enough");
    let memory = Memory::default();
    let mut systems = vec![arm()];
    for parameter in 0..arm().effect_parameters().len() {
        let mut system = arm();
        let mut effects = system.effect_parameters().to_vec();
        effects[parameter] *= 1.25;
        system.set_parameters(&LINKS, &effects);
        systems.push(system);
    }
    for link in 0..LINKS.len() {
        let mut links = LINKS;
        links[link] *= 1.25;
        let mut system = arm();
        let effects = system.effect_parameters().to_vec();
        system.set_parameters(&links, &effects);
        systems.push(system);
    }
    let others = [placed(&LUGRE, 1, None, &[8.0, 0.4, 0.05, 0.2, 0.5, 0.3]), placed(&GAIN, 0, None, &[1.4])];
    systems.push(System::new(&ARM, 2, LINKS.to_vec(), Vec::new(), &others).expect("the arm is complete"));
    // Laws that read a rest position, another law beside the drive's own states, and one that all states hang together with.
    let lugre = placed(&LUGRE, 0, None, &[8.0, 0.4, 0.05, 0.2, 0.5, 0.3]);
    let springs = [0.5, 0.7].map(|qeq| placed(&SPRING, 0, None, &[0.9, qeq]));
    for spring in springs {
        let effects = [lugre.clone(), spring];
        systems.push(System::new(&ARM, 2, LINKS.to_vec(), Vec::new(), &effects).expect("the arm is complete"));
    }
    let mut bristles_bent = lugre.clone();
    bristles_bent.initial_states = vec![0.01];
    systems.push(System::new(&ARM, 2, LINKS.to_vec(), Vec::new(), &[bristles_bent]).expect("the arm is complete"));
    systems.push(arm());
    let mut seen = Vec::new();
    for system in &systems {
        let alone: Vec<Vec<f64>> = along(system, &motion).into_iter().map(|joint| joint.residual).collect();
        assert!(residuals(system, &motion, &memory) == alone, "{:?}", system.effect_parameters());
        seen.push(alone);
    }
    assert!(seen[0] == seen[seen.len() - 1] && seen[1..seen.len() - 1].iter().all(|other| *other != seen[0]));
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let (system, motion) = (arm(), Motion::of(&run()).expect("long enough"));
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| along(&system, &motion))
    };
    assert_eq!(with(1), with(3));
}

//! The damping that a device has of its own: what a passive wall can count on.

use super::{Setting, WallError};
use dynid_dynamics::system::System;
use dynid_user_model::Model;

/// The viscous part of a joint's friction.
#[derive(Debug, Clone, PartialEq)]
pub struct OwnDamping {
    /// By how much steady friction grows with speed [N*m*s/rad or N*s/m]; 0 where it does not. Dry friction, which does not, is
    /// not in it.
    pub value: f64,
    /// Names of the parameters that it comes from.
    pub from: Vec<String>,
}

/// What the setting's joint has of it, by the model: the slope of its steady friction between the slowest approach's speed and
/// twice that, in the direction in which it is smaller. The states of friction are at rest for that, so that a bristle's
/// damping does not count.
///
/// # Errors
/// The model makes no equations.
pub fn own_damping(model: &Model, setting: &Setting) -> Result<OwnDamping, WallError> {
    /// Changes of a parameter, and slopes that count as changed by it; both relative.
    const CHANGE: f64 = 0.1;
    const CHANGED: f64 = 1e-6;
    let mut system = model.system(&[setting.joint], |joint| setting.posture[joint])?;
    let speed = setting.approaches.iter().map(|approach| approach.peak).fold(f64::INFINITY, f64::min);
    let value = slope(&system, speed);
    // Slopes are differences of torques: what is rounding is so beside these.
    let size = value.abs() + steady(&system, speed).abs().max(steady(&system, -speed).abs()) / speed;
    if value <= CHANGED * size {
        return Ok(OwnDamping { value: 0.0, from: Vec::new() });
    }
    let (links, effects) = (system.link_parameters().to_vec(), system.effect_parameters().to_vec());
    let mut from = Vec::new();
    for (index, name) in system.effect_names().to_vec().into_iter().enumerate() {
        let mut changed = effects.clone();
        changed[index] *= 1.0 + CHANGE;
        system.set_parameters(&links, &changed);
        if (slope(&system, speed) - value).abs() > CHANGED * size {
            from.push(name);
        }
    }
    Ok(if from.is_empty() { OwnDamping { value: 0.0, from } } else { OwnDamping { value, from } })
}

/// The smaller slope of both directions.
fn slope(system: &System, speed: f64) -> f64 {
    let grows = |speed: f64| (steady(system, 2.0 * speed) - steady(system, speed)) / speed;
    grows(speed).min(grows(-speed))
}

/// What the joint's effects take at a steady speed, once the friction's states have come to rest.
fn steady(system: &System, speed: f64) -> f64 {
    /// Newton steps; of most laws the first is exact.
    const STEPS: usize = 20;
    let mut x = system.rest(&[0.0]);
    x[1] = speed;
    let (mut scratch, mut rate, command) = (system.scratch(), vec![0.0; x.len()], vec![0.0; system.n_joints()]);
    for _ in 0..STEPS {
        system.effects_alone(&mut scratch, 0.0, &x, &command, &mut rate);
        let at = rate.clone();
        for state in 2..x.len() {
            let (own, step) = (x[state], 1e-6 * (1.0 + x[state].abs()));
            x[state] = own + step;
            system.effects_alone(&mut scratch, 0.0, &x, &command, &mut rate);
            let by_own = (rate[state] - at[state]) / step;
            x[state] = if by_own < 0.0 { own - at[state] / by_own } else { own };
        }
    }
    system.effects_alone(&mut scratch, 0.0, &x, &command, &mut rate);
    scratch.load[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_viscous_part_of_lugre_counts_and_its_bristles_do_not() {
        let setting = Setting::shipped().expect("shipped");
        let model = Model::of_device(setting.device);
        let reported = own_damping(&model, &setting).expect("equations");
        let sigma2 = model.parameter("joint.0.lugre.sigma2").expect("it is there").value;
        assert!((reported.value - sigma2).abs() < 1e-9 * sigma2, "{reported:?}");
        assert_eq!(reported.from, ["joint.0.lugre.sigma2"]);
    }

    #[test]
    fn of_two_directions_the_smaller_counts_and_dry_friction_not_at_all() {
        let setting = Setting::shipped().expect("shipped");
        let mut model = Model::of_device(setting.device);
        model.remove_effect("lugre", Some(0), None).expect("it is there");
        let nothing = own_damping(&model, &setting).expect("equations");
        assert_eq!((nothing.value, nothing.from.len()), (0.0, 0));
        model.add_effect("coulomb", Some(0), None).expect("added");
        model.set_value("joint.0.coulomb.Fc", 0.2).expect("its own");
        assert_eq!(own_damping(&model, &setting).expect("equations").value, 0.0);
        model.add_effect("viscous", Some(0), None).expect("added");
        model.set_value("joint.0.viscous.Fv", 0.3).expect("its own");
        let reported = own_damping(&model, &setting).expect("equations");
        assert!((reported.value - 0.3).abs() < 1e-9 && reported.from == ["joint.0.viscous.Fv"], "{reported:?}");
    }

    /// Friction that falls with speed damps nothing, and no damping is not a negative one.
    #[test]
    fn friction_that_falls_with_speed_damps_nothing() {
        let setting = Setting::shipped().expect("shipped");
        let mut model = Model::of_device(setting.device);
        model.remove_effect("lugre", Some(0), None).expect("it is there");
        model.add_effect("stribeck", Some(0), None).expect("added");
        for (name, value) in [("Fc", 0.05), ("Fs", 0.4), ("vs", 2.0)] {
            model.set_value(&format!("joint.0.stribeck.{name}"), value).expect("its own");
        }
        let reported = own_damping(&model, &setting).expect("equations");
        assert_eq!((reported.value, reported.from.len()), (0.0, 0), "{reported:?}");
        // A damper that is stronger than the fall is reported with it.
        model.add_effect("viscous", Some(0), None).expect("added");
        model.set_value("joint.0.viscous.Fv", 2.0).expect("its own");
        let reported = own_damping(&model, &setting).expect("equations");
        assert!(reported.value > 0.0 && reported.value < 2.0 && reported.from.len() == 4, "{reported:?}");
    }
}

//! What a hand feels of a device whose controller carries it by a model that is not quite right.

use dynid::{
    felt::{Options, survey},
    model::{FitRecord, Model},
};
use dynid_plant::random::Noise;

/// The device's own model, its joints' effects and its links' masses and inertias up to this share off.
fn off_by(share: f64, seed: u64) -> Model {
    let mut noise = Noise::new(seed);
    let mut model = Model::of_device(dynid_model::device("freedom6s").expect("a shipped device"));
    let values: Vec<(String, f64)> = model.parameters().into_iter().map(|(name, known)| (name, known.value)).collect();
    for (name, value) in values.into_iter().filter(|(name, _)| !name.starts_with("base.")) {
        model.set_value(&name, value * (1.0 + share * (2.0 * noise.uniform() - 1.0))).expect("its own name");
    }
    model
}

/// Half of the bare device at most, for a hand's slow motion, at every joint, although gains, frictions, springs and links
/// of the device are each up to 5 % off what is believed of them.
#[test]
fn less_than_half_of_the_device_is_felt() {
    let believed = off_by(0.0, 1);
    let options = Options { frequencies: vec![0.5, 1.0, 2.0], ..Options::new(6) };
    let survey =
        survey(&off_by(0.05, 3), &believed, &[0, 1, 2, 3, 4, 5], &options).expect("a model that can be carried");
    for joint in &survey.joints {
        let worst = joint.worst(0.0, 2.0);
        assert!(worst.inertia < 0.5 && worst.damping < 0.5, "joint {}: {worst:?}", joint.joint);
        assert!(worst.inertia_drawn.is_none() && joint.drawn.is_empty(), "no standard errors, nothing to draw");
    }
}

/// A model with standard errors is drawn from; the same seed gives the same draws, and larger errors leave more.
#[test]
fn models_off_by_their_standard_errors_leave_more() {
    let of = |relative: f64| {
        let mut believed = off_by(0.0, 1);
        let errors = believed
            .parameters()
            .into_iter()
            .filter(|(name, _)| name.starts_with("joint.4"))
            .map(|(name, known)| (name, relative * known.value.abs()));
        believed.fit = Some(FitRecord { std_error: errors.collect(), ..FitRecord::default() });
        let options = Options { frequencies: vec![1.0], draws: 3, ..Options::new(6) };
        survey(&off_by(0.0, 1), &believed, &[4], &options).expect("a model that can be carried")
    };
    let (small, large) = (of(0.01), of(0.1));
    assert_eq!(small, of(0.01));
    assert_eq!(small.joints[0].drawn.len(), 3);
    let left = |survey: &dynid::felt::Survey| survey.joints[0].worst(0.0, 2.0).damping_drawn.expect("drawn");
    assert!(left(&large) > left(&small), "{} {}", left(&large), left(&small));
}

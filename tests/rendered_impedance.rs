//! What a hand feels of a device whose controller carries it by a model that is not quite right.

use dynid_haptics::{rendered_impedance::Options, rendered_impedance::survey};
use dynid_plant::random::Noise;
use dynid_user_model::{FitRecord, Model};

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
    let prior = off_by(0.0, 1);
    let options = Options { frequencies: vec![0.5, 1.0, 2.0], ..Options::new(6) };
    let survey = survey(&off_by(0.05, 3), &prior, &[0, 1, 2, 3, 4, 5], &options).expect("a model that can be carried");
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
        let mut prior = off_by(0.0, 1);
        let errors = prior
            .parameters()
            .into_iter()
            .filter(|(name, _)| name.starts_with("joint.4"))
            .map(|(name, known)| (name, relative * known.value.abs()));
        prior.fit = Some(FitRecord { std_error: errors.collect(), ..FitRecord::default() });
        let options = Options { frequencies: vec![1.0], draws: 3, ..Options::new(6) };
        survey(&off_by(0.0, 1), &prior, &[4], &options).expect("a model that can be carried")
    };
    let (small, large) = (of(0.01), of(0.1));
    assert_eq!(small, of(0.01));
    assert_eq!(small.joints[0].drawn.len(), 3);
    let left = |survey: &dynid_haptics::rendered_impedance::Survey| {
        survey.joints[0].worst(0.0, 2.0).damping_drawn.expect("drawn")
    };
    assert!(left(&large) > left(&small), "{} {}", left(&large), left(&small));
}

fn feel(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output =
        assert_cmd::Command::cargo_bin("dynid").expect("the program").args(["wall", "feel"]).args(arguments).output();
    let output = output.expect("it runs");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("text");
    (output.status.code(), text(output.stdout), text(output.stderr))
}

#[test]
fn the_verb_tells_and_draws_what_is_felt() {
    let folder = tempfile::tempdir().expect("a folder");
    let picture = folder.path().join("felt.svg");
    let out = picture.to_str().expect("text");
    let arguments = ["--free", "4", "--frequencies", "2,1", "--out", out];
    let (status, text, errors) = feel(&arguments);
    assert_eq!(status, Some(0), "{errors}");
    assert!(text.contains("joint 4: up to 2 Hz at most"), "{text}");
    let drawn = std::fs::read_to_string(&picture).expect("the picture");
    assert!(drawn.contains("joint 4: felt inertia") && drawn.contains("carried") && !drawn.contains("NaN"), "{drawn}");
    let (status, _, errors) = feel(&arguments);
    assert!(status == Some(2) && errors.contains("--force"), "{errors}");
    let (_, text, _) = feel(&["--free", "4", "--frequencies", "2,1", "--json"]);
    let message: serde_json::Value = serde_json::from_str(&text).expect("one object");
    let joint = &message["joints"][0];
    assert_eq!(joint["joint"], 4);
    assert_eq!(joint["bare"][0]["frequency_hz"], 1.0);
    assert!(joint["left"]["inertia"].as_f64().is_some_and(|left| left < 0.5), "{joint}");
}

#[test]
fn what_cannot_be_felt_is_refused() {
    for (arguments, said) in [
        (&["--inertia", "1.5"][..], "the share of the inertia is 1.5"),
        (&["--free", "1,9"], "no free joints [1, 9]"),
        (&["--frequencies", "100"], "at most a twentieth of the controller's rate"),
        (&["--amplitude", "0"], "the amplitude is 0"),
        (&["--rate", "0"], "--rate takes a positive number"),
    ] {
        let (status, text, errors) = feel(arguments);
        assert!(status == Some(2) && text.is_empty(), "{arguments:?}: {text}");
        let one_line = errors.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(one_line.contains(said), "{arguments:?}: {errors}");
    }
}

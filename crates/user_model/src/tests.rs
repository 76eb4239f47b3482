use std::collections::BTreeMap;
use std::path::Path;

use dynid_model::{Parameter, device, devices};

use crate::{ErrorShare, Source};
use dynid_random::Random;

use super::{FitRecord, Model};

fn parse(text: &str) -> Model {
    Model::parse(text, Path::new("model.toml")).unwrap_or_else(|error| panic!("{error}"))
}

fn refused(text: &str) -> String {
    Model::parse(text, Path::new("model.toml")).unwrap_err().to_string()
}

const COMMENTED: &str = r#"# what we believe
device = "freedom6s"

[link.2]
m = 0.376              # kg, weighed
x = { value = -0.0023, lower = -0.01, upper = 0.01 }   # from CAD

# friction
[[effect]]
id = "lugre"
joint = 3
sigma0 = 6.70          # stiff

[[effect]]
id = "input_coupling"
from = 5
joint = 4
gain = -0.2
"#;

fn share() -> ErrorShare {
    let source = |configuration, rms| Source { configuration, rms };
    ErrorShare {
        configuration: 9,
        joint: 3,
        noise_floor: 2e-4,
        rmse: 2.1e-4,
        remaining: 5e-5,
        from: vec![source(8, 3e-5), source(9, 4e-5)],
        range: 0.0,
        carried: vec![source(8, 9e-5)],
    }
}

#[test]
fn default_model_has_every_parameter_in_order() {
    let names = Model::of_device(device("freedom6s").unwrap()).names();
    assert_eq!(names.len(), 7 * 10 + 9 + 1 + 6 * (1 + 6 + 2));
    assert_eq!(&names[..2], ["link.1.m", "link.1.x"]);
    assert_eq!(names[70], "length.L1x");
    assert_eq!(names[79], "base.gz");
    assert_eq!(names[80], "joint.0.gain.Kp");
    assert_eq!(names.last().unwrap(), "joint.5.spring.qeq");
}

#[test]
fn a_file_states_its_effects_and_what_differs() {
    let model = parse(COMMENTED);
    let reference = device("freedom6s").unwrap();
    assert_eq!(model.effects.len(), 2);
    assert_eq!(model.parameter("link.2.m").unwrap().value, 0.376);
    assert_eq!(model.parameter("link.2.m").unwrap().lower, reference.links[1].inertial[0].lower);
    assert_eq!(model.parameter("link.2.x").unwrap().upper, 0.01);
    assert_eq!(model.parameter("link.2.y").unwrap(), reference.links[1].inertial[2], "not stated");
    assert_eq!(model.parameter("joint.3.lugre.Fs").unwrap().value, 0.06, "the device's, not the effect's first guess");
    assert_eq!(model.parameter("joint.4.input_coupling.5.gain").unwrap().value, -0.2);
    assert_eq!(model.parameter("joint.3.spring.Ks"), None);
    assert!(model.notes.is_empty(), "{:?}", model.notes);
}

#[test]
fn writing_keeps_comments_order_and_digits() {
    let mut model = parse(COMMENTED);
    assert_eq!(model.to_toml(), COMMENTED);
    model.set_value("link.2.m", 0.4).unwrap();
    model.set_value("link.2.x", 0.002).unwrap();
    model.set_value("link.7.Izz", 2.5e-5).unwrap();
    model.set_value("joint.3.lugre.sigma1", 0.05).unwrap();
    model.add_effect("spring", Some(3), None).unwrap();
    model.fit = Some(FitRecord {
        error: "torque".to_owned(),
        status: "converged".to_owned(),
        data_digest: "d".to_owned(),
        parent_digest: "p".to_owned(),
        cost_before: Some(2.0),
        cost_after: 1.0,
        not_identifiable: vec!["link.2.y".to_owned(), "link.3.z".to_owned()],
        std_error: [("link.2.m".to_owned(), 0.01), ("link.2.y".to_owned(), f64::INFINITY)].into(),
        at_bound: vec!["link.7.Izz".to_owned()],
        method: Some("coupling".to_owned()),
        budget: vec![share()],
    });
    model.prior = [("link.2.m".to_owned(), 0.5)].into();
    let text = model.to_toml();
    insta::assert_snapshot!(text);
    let again = parse(&text);
    assert_eq!(again.parameters(), model.parameters());
    assert_eq!(again.digest(), model.digest());
    assert_eq!(again.fit.as_ref().unwrap().budget, [share()]);
    assert_eq!(again.fit.as_ref().unwrap().at_bound, ["link.7.Izz"]);
    assert_eq!(again.prior["link.2.m"], 0.5);
    assert_eq!(again.fit.as_ref().unwrap().method.as_deref(), Some("coupling"));
    assert_eq!(again.fit.as_ref().unwrap().not_identifiable.len(), 2);
    assert_eq!(again.fit.as_ref().unwrap().std_error.len(), 1, "an infinite standard error is left out");
    assert_eq!(again.to_toml(), text);
}

/// What a record says of no parameter of the model is noted, with the nearest name, and left out.
#[test]
fn an_unknown_name_that_was_prior_is_noted() {
    let mut text = Model::of_device(device("freedom6s").expect("in the library")).to_toml();
    text.push_str("\n[believed]\n\"link.2.m\" = 0.5\n\"link.2.mm\" = 0.5\n");
    let model = parse(&text);
    assert_eq!(model.prior.keys().collect::<Vec<_>>(), ["link.2.m"]);
    let message = model.notes.iter().find(|note| note.contains("[believed]")).expect("a note");
    assert!(message.contains("`link.2.mm`") && message.contains("`link.2.m`"), "{message}");
}

/// Over many draws each parameter scatters by its standard error; what all gains have in common is the torques' scale, and
/// is drawn for nothing that has it.
#[test]
fn drawn_models_scatter_as_the_standard_errors_say() {
    let mut model = Model::of_device(device("freedom6s").expect("in the library"));
    let gains: Vec<String> = model.names().into_iter().filter(|name| name.ends_with(".gain.Kp")).collect();
    let mut errors: BTreeMap<String, f64> =
        gains.iter().map(|name| (name.clone(), 0.05 * model.parameter(name).expect("its own").value)).collect();
    errors.insert("joint.0.lugre.vs".to_owned(), 0.002);
    let spring = model.parameter("joint.0.spring.Ks").expect("its own").value;
    errors.insert("joint.0.spring.Ks".to_owned(), 0.13 * spring);
    let mut random = Random::new(5);
    assert_eq!(model.off_by_errors(&mut random).digest(), model.digest(), "without a fit there are no errors");
    model.fit = Some(FitRecord { std_error: errors, ..FitRecord::default() });
    let n = 2000;
    let drawn: Vec<Model> = (0..n).map(|_| model.off_by_errors(&mut random)).collect();
    let scatter = |name: &str| {
        let at = |model: &Model| model.parameter(name).expect("its own").value;
        let square: f64 = drawn.iter().map(|drawn| (at(drawn) - at(&model)).powi(2)).sum();
        (square / f64::from(n)).sqrt()
    };
    // standard errors of a scatter: 1.6 %; here within five of them
    for (name, expected) in [("joint.0.lugre.vs", 0.002), ("joint.0.spring.Ks", 0.12 * spring)] {
        assert!((scatter(name) / expected - 1.0).abs() < 0.08, "{name}: {} for {expected}", scatter(name));
    }
    // Gains, all 5 % off together, leave rounding.
    assert_eq!(gains.len(), 6);
    for name in &gains {
        let value = model.parameter(name).expect("its own").value;
        assert!(scatter(name) < 1e-6 * value, "{name}: {} of {value}", scatter(name));
    }
    assert_eq!(scatter("link.2.m"), 0.0);
}

#[test]
fn every_default_model_survives_its_file() {
    for device in devices() {
        let model = Model::of_device(device);
        let text = model.to_toml();
        let again = parse(&text);
        assert_eq!(again.parameters(), model.parameters(), "{}", device.id);
        assert_eq!(again.digest(), model.digest());
        assert_eq!(again.to_toml(), text, "{}", device.id);
    }
}

#[test]
fn bounds_and_fixed_survive_both_ways_of_writing() {
    let values = [-0.01, 0.4];
    for value in values {
        for (lower, upper) in [(-1.0, 1.0), (value, value), (f64::NEG_INFINITY, f64::INFINITY)] {
            for fixed in [false, true] {
                let parameter = Parameter { value, lower, upper, fixed };
                for text in [
                    "device = \"planar2r\"\n".to_owned(),
                    format!("device = \"planar2r\"\nlink.1.x = {value}\nlength.L1 = {{ value = 1 }}"),
                ] {
                    let mut model = parse(&text);
                    for name in ["link.1.x", "length.L1"] {
                        model.set(name, parameter).unwrap();
                    }
                    let again = parse(&model.to_toml());
                    for name in ["link.1.x", "length.L1"] {
                        let read = again.parameter(name).unwrap();
                        assert_eq!((read.value, read.lower, read.upper), (value, lower, upper), "{}", model.to_toml());
                        assert_eq!(read.fixed, fixed, "{name}: {}", model.to_toml());
                    }
                }
            }
        }
    }
}

#[test]
fn a_larger_law_replaces_the_smaller_and_keeps_what_they_share() {
    let mut model = parse(
        "device = \"planar2r\"\n[[effect]]\nid = \"viscous\"\njoint = 0\nFv = 0.07\n[[effect]]\nid = \"coulomb\"\njoint = 0\nFc = 0.3\n",
    );
    let added = model.add_effect("stribeck", Some(0), None).unwrap();
    assert_eq!(added.replaced, ["`coulomb` at joint 0"]);
    assert_eq!(model.parameter("joint.0.stribeck.Fc").unwrap().value, 0.3);
    let stiction = model.parameter("joint.0.stribeck.Fs").unwrap();
    assert!((stiction.value - 0.6).abs() < 1e-15, "keeps the ratio of the first guesses: {stiction:?}");
    let added = model.add_effect("lugre", Some(0), None).unwrap();
    assert_eq!(added.replaced, ["`stribeck` at joint 0", "`viscous` at joint 0"]);
    assert_eq!(model.parameter("joint.0.lugre.sigma2").unwrap().value, 0.07);
    assert_eq!(model.parameter("joint.0.lugre.Fs").unwrap().value, stiction.value);
    assert_eq!(model.effects.len(), 1);
    insta::assert_snapshot!(
        ["coulomb", "lugre", "columb"]
            .map(|id| model.add_effect(id, Some(0), None).unwrap_err().to_string())
            .join("\n")
    );
    assert!(model.add_effect("coulomb", Some(1), None).is_ok());
    assert!(model.add_effect("coulomb", Some(2), None).unwrap_err().to_string().contains("no joint 2"));
    assert!(model.add_effect("rotor_coupling", Some(1), None).unwrap_err().to_string().contains("--from"));
    model.remove_effect("lugre", Some(0), None).unwrap();
    assert!(model.remove_effect("lugre", Some(0), None).is_err());
    parse(&model.to_toml());
}

#[test]
fn a_value_outside_the_device_s_bounds_is_said() {
    let model = parse("device = \"planar2r\"\n[link.1]\nm = 9.0\n");
    assert_eq!(model.notes.len(), 1);
    assert!(model.notes[0].contains("link.1.m = 9 lies outside"), "{:?}", model.notes);
    assert_eq!(model.parameter("link.1.m").unwrap().upper, 9.0);
}

#[test]
fn unknown_parameter_names_the_nearest() {
    let mut model = Model::of_device(device("planar2r").unwrap());
    let error = model.set_value("link.2.Ixz2", 1.0).unwrap_err().to_string();
    assert!(error.starts_with("unknown parameter `link.2.Ixz2`; did you mean `link.2.Ixz`?"), "{error}");
}

#[test]
fn wrong_files_are_reported_with_place_and_remedy() {
    let wrong = [
        "device = \"freedom7s\"\n",
        "link.1.m = 1\n",
        "device = \"planar2r\"\n[link.3]\nm = 1\n",
        "device = \"planar2r\"\n[link.01]\nm = 1\n",
        "device = \"planar2r\"\n[link.1]\nmass = 1\n",
        "device = \"planar2r\"\n[link.1]\nm = -1\n",
        "device = \"planar2r\"\n[link.1]\nm = nan\n",
        "device = \"planar2r\"\n[link.1]\nm = 1.2\nIzz = 0.5\n",
        "device = \"planar2r\"\n[link.1]\nm = { value = 1.0, lower = 2.0, upper = 3.0 }\n",
        "device = \"planar2r\"\n[link.1]\nm = { value = 1.0, lower = 3.0, upper = 2.0 }\n",
        "device = \"planar2r\"\n[link.1]\nm = { lower = 1.0 }\n",
        "device = \"planar2r\"\n[[effect]]\nid = \"viscos\"\njoint = 0\n",
        "device = \"planar2r\"\n[[effect]]\nid = \"viscous\"\n",
        "device = \"planar2r\"\n[[effect]]\nid = \"viscous\"\njoint = 2\n",
        "device = \"planar2r\"\n[[effect]]\nid = \"viscous\"\njoint = 1\nfv = 1\n",
        "device = \"planar2r\"\n[[effect]]\nid = \"viscous\"\njoint = 1\n[[effect]]\nid = \"viscous\"\njoint = 1\n",
        "device = \"planar2r\"\n[[effect]]\nid = \"lugre\"\njoint = 1\nFs = 0.1\nFc = 0.2\n",
        "device = \"planar2r\"\n[[effect]]\nid = \"lugre\"\njoint = 1\n[[effect]]\nid = \"coulomb\"\njoint = 1\n",
        "device = \"planar2r\"\n[base]\ngz = 9.81\n",
        "device = \"planar2r\"\n[length]\nL3 = 1\n",
        "device = \"planar2r\"\nmass = 3\n",
        "device = \"planar2r\n",
    ];
    let message = wrong.map(refused).join("\n\n");
    insta::assert_snapshot!(message);
}

/// A fit ends where both are equal, up to rounding; what it writes can be read.
#[test]
fn an_order_may_be_broken_by_rounding() {
    let text = "device = \"planar2r\"\n[[effect]]\nid = \"lugre\"\njoint = 1\nFs = 0.1999999999\nFc = 0.2\n";
    assert!(Model::parse(text, Path::new("fitted.toml")).is_ok());
}

#[test]
fn names_find_their_parameters() {
    for device in devices() {
        let model = Model::of_device(device);
        for (name, parameter) in model.parameters() {
            assert_eq!(model.parameter(&name), Some(parameter), "{name}");
            assert!(model.unit(&name).is_some_and(|unit| !unit.is_empty()));
            assert_eq!(model.parameter(&format!("{name}.x")), None);
        }
        for name in ["", "link", "link.0.m", "link.01.m", "link.99.m", "joint.0", "joint.+0.gain.Kp", "device.gain.Kp"]
        {
            assert_eq!(model.parameter(name), None, "{name}");
        }
    }
    let servo = Model::of_device(device("servo_pendulum").unwrap());
    assert_eq!(servo.unit("joint.0.gain.Kp").as_deref(), Some("N*m/V"));
    let oscillator = Model::of_device(device("oscillator").unwrap());
    assert_eq!(oscillator.unit("joint.0.viscous.Fv").as_deref(), Some("N*s/m"));
    assert_eq!(oscillator.unit("joint.0.gain.Kp").as_deref(), Some("1"));
}

/// What `turner` took over from `coulomb` and `viscous` is theirs again in a model that has those.
#[test]
fn a_smaller_law_gets_back_what_a_larger_one_took_over() {
    let before = parse(
        r#"device = "freedom6s"

[[effect]]
id = "coulomb"
joint = 4
Fc = 0.01

[[effect]]
id = "viscous"
joint = 4
Fv = 0.02
"#,
    );
    let mut larger = before.clone();
    larger.add_effect("turner", Some(4), None).unwrap();
    larger.set_value("joint.4.turner.Fk", 0.03).unwrap();
    larger.set_value("joint.4.turner.s2", 0.04).unwrap();
    larger.set_value("link.6.Izz", 1.25 * before.parameter("link.6.Izz").unwrap().value).unwrap();
    let after = before.with_values_of(&larger);
    assert_eq!(after.parameter("joint.4.coulomb.Fc").unwrap().value, 0.03);
    assert_eq!(after.parameter("joint.4.viscous.Fv").unwrap().value, 0.04);
    assert_eq!(after.parameter("link.6.Izz"), larger.parameter("link.6.Izz"));
    assert_eq!(after.effects.len(), before.effects.len());
}

const SHARED: &str = "device = \"planar2r\"\n\n[[effect]] # both alike\nid = \"viscous\"\njoint = \"all\"\nFv = 0.2\n\n\
                      [[effect]]\nid = \"coulomb\"\njoint = [1, 0]\n";

#[test]
fn one_table_for_several_joints() {
    let mut model = Model::parse(SHARED, "shared.toml".as_ref()).unwrap();
    let labels: Vec<String> = model.effects.iter().map(super::EffectInstance::label).collect();
    assert_eq!(
        labels,
        ["`viscous` at joint 0", "`viscous` at joint 1", "`coulomb` at joint 1", "`coulomb` at joint 0"]
    );
    assert_eq!(model.parameter("joint.1.viscous.Fv").unwrap().value, 0.2);
    // What stays alike stays one table.
    assert_eq!(model.to_toml(), SHARED);
    for joint in [0, 1] {
        model.set_value(&format!("joint.{joint}.viscous.Fv"), 0.3).unwrap();
    }
    assert_eq!(model.to_toml(), SHARED.replace("0.2", "0.3"));
    model.set_value("joint.1.viscous.Fv", 0.1).unwrap();
    let text = model.to_toml();
    let again = Model::parse(&text, "shared.toml".as_ref()).unwrap();
    assert_eq!(again.digest(), model.digest(), "{text}");
    assert_eq!(text.matches("# both alike").count(), 2, "{text}");
    assert!(text.contains("joint = [1, 0]"), "{text}");
    model.remove_effect("coulomb", Some(0), None).unwrap();
    let again = Model::parse(&model.to_toml(), "shared.toml".as_ref()).unwrap();
    assert_eq!(again.digest(), model.digest(), "{}", model.to_toml());
}

const LADEN: &str = "device = \"planar2r\"\n[[effect]]\nid = \"payload\"\njoint = 1\nm = 0.2\n\
                     [[effect]]\nid = \"payload\"\njoint = 1\npayload = \"box\"\nm = 0.5\n\
                     [[effect]]\nid = \"viscous\"\njoint = 1\npayload = \"box\"\n";

#[test]
fn effects_of_a_payload() {
    let mut model = Model::parse(LADEN, "laden.toml".as_ref()).unwrap();
    let masses = ["joint.1.payload.m", "joint.1.payload@box.m"];
    assert_eq!(masses.map(|name| model.parameter(name).unwrap().value), [0.2, 0.5]);
    assert_eq!(model.effects[1].label(), "`payload` at joint 1 with `box`");
    assert!(model.names().iter().all(|name| model.parameter(name).is_some()));
    // Without the box only the first acts.
    let bare = model.system(&[1], |_| 0.0).unwrap();
    assert_eq!(bare.effect_names().iter().filter(|name| name.contains('@')).count(), 0);
    assert!(bare.effect_names().contains(&"joint.1.payload.m".to_owned()));
    model.set_value("joint.1.payload@box.m", 0.7).unwrap();
    assert_eq!(model.to_toml(), LADEN.replace("m = 0.5", "m = 0.7"));
    // A machine may have the effect that a payload has.
    assert!(model.add_effect("viscous", Some(1), None).is_ok());
    let wrong = |old: &str, new: &str| Model::parse(&LADEN.replacen(old, new, 1), "laden.toml".as_ref()).unwrap_err();
    assert!(wrong("\"box\"", "\"a box\"").to_string().contains("is no name of a payload"));
    assert!(wrong("m = 0.2\n", "payload = \"box\"\n").to_string().contains("stands twice"));
}

//! `dynid ladder`: the error falls rung by rung, each rung is the child of the one before, and what was added pays.

use std::fs;

use crate::lineage::{lineage, message, refused};
use serde_json::Value;

#[test]
fn the_error_falls_to_the_noise_when_the_hidden_effect_is_added() {
    let folder = lineage();
    let models = ["believed.toml", "fitted.toml", "better.toml", "better-fitted.toml"];
    let call = |more: &[&str]| message(folder.path(), &[&["ladder", "experiment.toml"], &models[..], more].concat());
    let json: Value =
        serde_json::from_str(&call(&["--json", "--out", "ladder.svg", "--report", "ladder.html"])).unwrap();
    let rungs = json["rungs"].as_array().unwrap();
    assert_eq!(rungs.len(), 4);
    let lineage: Vec<&Value> = rungs.iter().map(|rung| &rung["lineage"]).collect();
    assert_eq!(lineage, [&Value::Null, &"fitted".into(), &"added".into(), &"fitted".into()]);
    assert_eq!(rungs[2]["added"], serde_json::json!(["joint.4.input_coupling.5"]));
    assert_eq!(rungs[3]["added"], serde_json::json!([]));
    let free: Vec<u64> = rungs.iter().map(|rung| rung["free_parameters"].as_u64().unwrap()).collect();
    assert_eq!(free, [6, 6, 7, 7], "two springs and two dampers; the gains are fixed");

    let noise = json["noise_floor"].as_f64().unwrap();
    let held_out = |rung: usize| rungs[rung]["rmse_validate"].as_f64().unwrap();
    assert!(held_out(1) > 50.0 * noise && held_out(3) < 1.5 * noise, "{} {} {noise}", held_out(1), held_out(3));
    assert!(rungs[3]["bic"].as_f64().unwrap() < rungs[1]["bic"].as_f64().unwrap() - 100.0);
    for joint in rungs[3]["joints"].as_array().unwrap() {
        assert!(joint["rmse_validate"].as_f64().unwrap() < 1.5 * joint["noise_floor"].as_f64().unwrap(), "{joint}");
        assert!(joint["torque_percent_validate"].as_f64().unwrap() < 5.0, "{joint}");
    }
    // The errors of one-step predictions are the noise where nothing is missing, and the model needs no correction.
    let predicted = |rung: usize| rungs[rung]["predictions"]["validate"]["joints"].as_array().unwrap().clone();
    for own in predicted(3) {
        let (times, correction) = (own["times_noise"].as_f64().unwrap(), own["correction"].as_f64().unwrap());
        assert!((0.9..1.1).contains(&times) && correction < 0.05, "{own}");
    }
    assert!(predicted(1).iter().any(|own| own["correction"].as_f64().unwrap() > 0.5), "{:?}", predicted(1));
    // The criterion by hand: both joints have as many samples, and a variance is their errors' and a little rounding.
    let n = json["independent_samples"].as_f64().unwrap();
    let fit = rungs[3]["predictions"]["fit"]["joints"].as_array().unwrap();
    let of_joint = |own: &Value| n / 2.0 * (2.0 * own["deviation"].as_f64().unwrap().ln() + 1.0);
    let bic = fit.iter().map(of_joint).sum::<f64>() + 7.0 * n.ln();
    assert!((bic - rungs[3]["bic"].as_f64().unwrap()).abs() < 0.5, "{bic} {}", rungs[3]["bic"]);
    assert!(json["bic_formula"].as_str().unwrap().starts_with("BIC = "));

    let picture = fs::read_to_string(folder.path().join("ladder.svg")).unwrap();
    assert_eq!(picture.matches("class=\"mark").count(), 4 * 2 * 2, "4 models, 2 joints, 2 errors");
    assert!(picture.contains("class=\"floor\""));
    let page = fs::read_to_string(folder.path().join("ladder.html")).unwrap();
    assert!(page.contains("+ joint.4.input_coupling.5") && page.contains("better-fitted"));

    let text = call(&[]);
    assert!(text.contains("each model is the child of the one before it"), "{text}");
    let added = ["believed.toml", "fitted.toml", "better-fitted.toml"];
    let text = message(folder.path(), &[&["ladder", "experiment.toml"], &added[..]].concat());
    assert!(text.contains("each model is the child of the one before it"), "with the effect added between: {text}");
    let turned = ["ladder", "experiment.toml", "better-fitted.toml", "fitted.toml"];
    let json: Value = serde_json::from_str(&message(folder.path(), &[&turned[..], &["--json"]].concat())).unwrap();
    let note = &json["typed_notes"][0];
    assert_eq!((&note["kind"], &note["model"]), (&"not_a_child".into(), &"fitted".into()), "{}", json["notes"]);
    let text = message(folder.path(), &turned);
    assert!(
        text.contains("fitted is not the child of better-fitted") && text.contains("\u{2212} joint.4.input_coupling.5"),
        "{text}"
    );
}

#[test]
fn what_cannot_be_put_on_a_ladder_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in dynid::tour::FILES {
        fs::write(folder.path().join(name), text).unwrap();
    }
    fs::write(folder.path().join("other.toml"), "device = \"planar2r\"\n").unwrap();
    fs::write(folder.path().join("mine.svg"), "mine").unwrap();
    let bad = |arguments: &[&str]| refused(folder.path(), &[&["ladder", "experiment.toml"], arguments].concat());
    assert!(bad(&["believed.toml", "absent.toml"]).contains("absent.toml"));
    let message = bad(&["believed.toml", "other.toml", "--out", "new.svg"]);
    assert!(message.contains("`planar2r`") && message.contains("`freedom6s`"), "{message}");
    let message = bad(&["believed.toml", "--out", "mine.svg"]);
    assert!(message.contains("mine.svg exists already") && message.contains("--force"), "{message}");
    assert!(bad(&["believed.toml", "--out", "one", "--report", "one"]).contains("a file of its own"));
    assert!(bad(&["believed.toml", "--out", "no/such/new.svg"]).contains("there is no folder"));
    assert!(refused(folder.path(), &["ladder", "absent.toml", "believed.toml"]).contains("absent.toml"));
    assert_eq!(fs::read_to_string(folder.path().join("mine.svg")).unwrap(), "mine");
    assert!(!folder.path().join("new.svg").exists());
}

//! `dynid report`: one page that needs no network and holds everything; the same bytes whatever the number of threads.

use std::fs;
use std::path::Path;

use crate::lineage::{lineage, message, refused};
use crate::page::{is_well_formed, opens_with_no_network};
use assert_cmd::Command;
use serde_json::{Value, json};

fn diagnosis() -> Value {
    json!({
        "verdict": "missing_effect",
        "sentences": [
            "Refitted, the model leaves 664 times the noise.",
            "Missing: `input_coupling` from joint 5 to joint 4.",
            "It could as well be `backlash` at joint 4."
        ],
        "ranking": [{
            "effect": "input_coupling", "joint": 4, "from": 5, "rmse_validate_before": 0.098, "rmse_validate_after": 2.1e-4,
            "delta_bic": -5000.0, "confounded_with": [], "evidence_for": ["the error follows joint 5's torque"],
            "evidence_against": ["<none>"]
        }],
        "unknown to this page": {"a": 1}
    })
}

#[test]
fn the_page_holds_everything_and_reaches_nothing() {
    let folder = lineage();
    fs::write(folder.path().join("diagnosis.json"), diagnosis().to_string()).unwrap();
    let call = ["report", "experiment.toml", "believed.toml", "fitted.toml", "better-fitted.toml", "--diagnosis"];
    let call = [&call[..], &["diagnosis.json", "--out"]].concat();
    let json: Value =
        serde_json::from_str(&message(folder.path(), &[&call[..], &["page.html", "--json"]].concat())).unwrap();
    assert_eq!(json["sentences"].as_array().unwrap().len(), 3, "{json}");
    let answer = "Missing: `input_coupling` from joint 5 to joint 4. It could as well be `backlash` at joint 4.";
    assert_eq!(json["sentences"][2], answer);
    let page = fs::read_to_string(folder.path().join("page.html")).unwrap();
    opens_with_no_network(&page);
    is_well_formed(&page);
    for heading in [
        "Verdict",
        "The ladder",
        "Where they part",
        "Which effect is missing",
        "Measured against the model",
        "What the torque is made of",
        "Parameters",
        "The logs",
        "Where this came from",
    ] {
        assert!(page.contains(&format!("<h2>{heading}</h2>")), "{heading}");
        assert!(json["sections"].as_array().unwrap().contains(&heading.into()), "{heading}");
    }
    // 3 runs, 2 joints: position, torque, terms; two ladders.
    assert_eq!(page.matches("<svg class=\"dynid-plot\"").count(), 3 * 2 * 3 + 2);
    for part in [
        "the error follows joint 5&#39;s torque",
        "&lt;none&gt;",
        "@media print",
        "input_coupling from 5",
        "joint.4.input_coupling.5.gain",
        "dynid ladder experiment.toml believed.toml fitted.toml better-fitted.toml",
        ">fixed<",
    ] {
        assert!(page.contains(part) || page.contains(&part.replace("&#39;", "'")), "{part}");
    }
    let digest = Value::from(json["quality"][0]["run"].as_str().unwrap());
    assert_eq!(digest, "wrist-1.csv");

    for threads in ["1", "3"] {
        let out = format!("page-{threads}.html");
        let call = [&call[..], &[out.as_str()]].concat();
        let mut command = Command::cargo_bin("dynid").unwrap();
        command.args(&call).env("RAYON_NUM_THREADS", threads).current_dir(folder.path()).assert().success();
        let other = fs::read_to_string(folder.path().join(&out)).unwrap().replace(&out, "page.html");
        assert!(other == page, "{threads} threads make another page");
    }
    fit_of_a_poor_model_is_located(folder.path());
}

/// What the fitted model without the effect leaves is located at the right joint and called by the right name.
fn fit_of_a_poor_model_is_located(folder: &Path) {
    let json: Value =
        serde_json::from_str(&message(folder, &["compare", "experiment.toml", "--model", "fitted.toml", "--json"]))
            .unwrap();
    let first = &json["where"][0];
    assert_eq!((&first["joint"], &first["other"]), (&4.into(), &5.into()), "{first}");
    assert_eq!(first["kind"], "other_torque", "{first}");
    let typed = &first["finding"];
    assert_eq!((&typed["kind"], &typed["joint"]), (&"follows_other".into(), &5.into()), "{first}");
    assert_eq!(typed["signal"], "command", "{first}");
    assert!(typed["per_unit"].as_f64().is_some_and(|per_unit| per_unit != 0.0), "{first}");
    assert!(first["share"].as_f64().unwrap() > 0.9 && first["expected"].as_f64().unwrap() < 0.05, "{first}");
    let joint = &json["runs"][0]["joints"][0];
    assert!(joint["whiteness"].as_f64().unwrap() > 37.6 && joint["white"] == false, "{joint}");
    let along =
        joint["inputs"].as_array().unwrap().iter().find(|own| own["input"] == 5 && own["error"] == "torque").unwrap();
    assert!(along["value"].as_f64().unwrap() > 0.9, "{along}");
}

#[test]
fn what_makes_no_page_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    for (name, text) in dynid::tour::FILES {
        put(name, text);
    }
    put("other.toml", "device = \"planar2r\"\n");
    put("mine.html", "mine");
    put("words.json", "not JSON");
    put("empty.json", "{}");
    let bad = |arguments: &[&str]| refused(folder.path(), &[&["report", "experiment.toml"], arguments].concat());
    assert!(bad(&["absent.toml", "--out", "new.html"]).contains("absent.toml"));
    assert!(bad(&["believed.toml", "other.toml", "--out", "new.html"]).contains("`planar2r`"));
    let message = bad(&["believed.toml", "--out", "mine.html"]);
    assert!(message.contains("mine.html exists already") && message.contains("--force"), "{message}");
    for (file, what) in [("absent.json", "cannot read"), ("words.json", "not JSON"), ("empty.json", "no `verdict`")] {
        let message = bad(&["believed.toml", "--out", "new.html", "--diagnosis", file]);
        assert!(
            message.contains(file) && message.contains(what) && message.contains("dynid diagnose --json"),
            "{message}"
        );
    }
    assert!(
        refused(folder.path(), &["report", "absent.toml", "believed.toml", "--out", "new.html"])
            .contains("absent.toml")
    );
    assert_eq!(fs::read_to_string(folder.path().join("mine.html")).unwrap(), "mine");
    assert!(!folder.path().join("new.html").exists());
}

#[test]
fn the_terms_of_the_torque_add_up_to_the_command() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in dynid::tour::FILES {
        fs::write(folder.path().join(name), text).unwrap();
    }
    let experiment =
        dynid_logs::experiment::Experiment::read_with(&folder.path().join("experiment.toml"), dynid_model::devices())
            .unwrap();
    let mut model = dynid_user_model::Model::load(folder.path().join("believed.toml")).unwrap();
    model.add_effect("input_coupling", Some(4), Some(5)).unwrap();
    model.set_value("joint.4.input_coupling.5.gain", -0.3).unwrap();
    model.add_effect("coulomb", Some(5), None).unwrap();
    let joints = dynid_torque::terms(&model, &experiment.runs[0]).unwrap();
    assert_eq!(joints.len(), 2);
    for joint in joints {
        let names: Vec<&str> = joint.terms.iter().map(|(name, _)| name.as_str()).collect();
        let own = if joint.joint == 4 { "input_coupling from 5" } else { "coulomb" };
        for name in ["inertia", "Coriolis", "gravity", "spring", "viscous", own, "what is left"] {
            assert!(names.contains(&name), "joint {}: {name} is not in {names:?}", joint.joint);
        }
        let size = joint.rms(&joint.command);
        for (k, command) in joint.command.iter().enumerate() {
            let sum: f64 = joint.terms.iter().map(|(_, values)| values[k]).sum();
            assert!((sum - command).abs() < 1e-9 * size, "joint {}, sample {k}: {sum} {command}", joint.joint);
        }
    }
}

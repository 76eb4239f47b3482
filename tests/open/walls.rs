//! Walls that are moved by hand.

use super::*;

/// A setting file of the shipped one's, changed.
fn setting(folder: &Path, name: &str, changes: &[(&str, &str)]) {
    let change = |text: String, (from, to): &(&str, &str)| {
        assert!(text.contains(from), "{from}");
        text.replacen(from, to, 1)
    };
    let text = changes.iter().fold(dynid_haptics::wall::SETTING.to_owned(), change);
    fs::write(folder.join(name), text).unwrap();
}

fn touch(server: &Server, setting: Option<&str>, wall: &str, changes: Value) -> Response {
    server.post("api/wall", &json!({ "model": null, "setting": setting, "wall": wall, "changes": changes }))
}

/// The filter of the velocity goes by the clock of the controller.
#[test]
fn another_sample_rate_is_another_setting() {
    let folder = TempDir::new().unwrap();
    setting(folder.path(), "fast.toml", &[("sample_s = 0.01 ", "sample_s = 0.0025 ")]);
    setting(
        folder.path(),
        "fastest.toml",
        &[("sample_s = 0.01 ", "sample_s = 0.00025 "), ("step_s = 0.0005", "step_s = 0.00025")],
    );
    let server = Server::new(folder.path(), &[]);
    for (file, rate) in [("fast.toml", 400.0), ("fastest.toml", 4000.0)] {
        let moved = touch(&server, None, "pd", json!({ "sample_rate": rate })).ok();
        let written = touch(&server, Some(file), "pd", json!({})).ok();
        assert_eq!((&moved["torque"], &moved["felt"]), (&written["torque"], &written["felt"]), "{rate} Hz");
    }
}

/// A gain of zero can be moved, and no number of a law has other bounds than the law.
#[test]
fn bounds_are_those_of_the_law() {
    let folder = TempDir::new().unwrap();
    let wall = "title = \"spring\"\ntorque_per_unit = 0.5\n[linear]\nk1 = 10.0\nk2 = 0.0\n";
    fs::write(folder.path().join("spring.toml"), wall).unwrap();
    let server = Server::new(folder.path(), &[]);
    let plain = touch(&server, None, "spring.toml", json!({})).ok();
    let change = |answer: &Value, key: &str| {
        answer["changes"].as_array().unwrap().iter().find(|own| own["key"] == key).unwrap().clone()
    };
    for key in ["k1", "k2"] {
        let own = change(&plain, key);
        assert_eq!((&own["lower"], &own["upper"]), (&json!(0.0), &json!(null)), "{key}");
    }
    let damped = touch(&server, None, "spring.toml", json!({ "k2": 5.0 })).ok();
    assert_eq!(change(&damped, "k2")["value"], 5.0);
    assert_ne!(plain["torque"], damped["torque"]);
    let leaky = touch(&server, None, "leaky", json!({})).ok();
    assert_eq!(change(&leaky, "leak.share")["upper"], 1.0);
    touch(&server, None, "leaky", json!({ "leak.share": 1.5 })).error(400);
    // The limit of the torque is 1 N*m, one of the output 0.03 N*m.
    let rules = touch(&server, None, "fuzzy", json!({})).ok();
    let rules =
        rules["changes"].as_array().unwrap().iter().filter(|own| own["key"].as_str().unwrap().starts_with("rules."));
    let most: Vec<f64> = rules.map(|own| own["upper"].as_f64().unwrap()).collect();
    assert!(most.len() > 3 && most.iter().all(|most| *most >= 1.0 / 0.03), "{most:?}");
}

/// A handle that slides is measured in m and N.
#[test]
fn units_are_those_of_the_joint() {
    let folder = TempDir::new().unwrap();
    let path = folder.path();
    let server = Server::new(path, &[]);
    let turning = touch(&server, None, "coupled", json!({})).ok();
    let unit = |answer: &Value, key: &str| {
        let own = answer["changes"].as_array().unwrap().iter().find(|own| own["key"] == key).unwrap();
        own["unit"].as_str().unwrap().to_owned()
    };
    let units = |answer: &Value, keys: &[&str]| -> Vec<String> {
        keys.iter().map(|key| answer["units"][key].as_str().unwrap().to_owned()).collect()
    };
    let keys = ["position", "torque", "stiffness", "settled_position", "energy_out"];
    assert_eq!(units(&turning, &keys), ["rad", "N*m", "N*m/rad", "rad", "J"]);
    let shown = turning["felt"]["measures"].as_object().unwrap().keys();
    assert!(shown.into_iter().all(|key| turning["units"][key].is_string()), "{turning}");
    assert_eq!(unit(&turning, "coupling.inertia"), "s^2/rad");
    assert_eq!(unit(&turning, "sample_rate"), "Hz");
    let device = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/model/devices/oscillator.toml")).unwrap();
    let device = device
        .replace("m = 6e-6", "m = 0.1")
        .replace("[1e-7, 1e-3]", "[0.01, 1.0]")
        .replace("value = 2e-4", "value = 0.01");
    fs::write(
        path.join("rail.toml"),
        device.replace("value = 1.0, lower = 0.0, upper = 100.0", "value = 0.0, lower = 0.0, upper = 100.0"),
    )
    .unwrap();
    setting(path, "setting.toml", &[("\"freedom6s\"", "\"rail.toml\"")]);
    let sliding = touch(&server, Some("setting.toml"), "pd", json!({})).ok();
    assert_eq!(units(&sliding, &keys), ["m", "N", "N/m", "m", "J"]);
    assert_eq!((unit(&sliding, "k1"), unit(&sliding, "k2")), ("1/m".to_owned(), "s/m".to_owned()));
}

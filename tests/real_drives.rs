//! What real drives need: motors behind gears and couplings, a payload in some runs, effects of several joints in one table.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use dynid_model::device;
use dynid_plant::recipe::{self, Recipe};
use serde_json::Value;
use tempfile::TempDir;

fn dynid(folder: &Path, arguments: &[&str]) -> Value {
    let mut program = Command::new(env!("CARGO_BIN_EXE_dynid"));
    let output = program.args(arguments).arg("--json").current_dir(folder).output().expect("it runs");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

/// Logs of a two-joint arm by the plant, the files named `<name>-one.csv` (to fit) and `<name>-two.csv` (held out).
fn play(folder: &Path, name: &str, seed: u64, payload: &str) {
    let run = |file: &str, role: &str, hz: f64| {
        format!(
            "[[run]]\nfile = \"{name}-{file}.csv\"\nfree = [0, 1]\nrole = \"{role}\"\nduration_s = 6.0\n\
             torque = [{{ joint = 0, amplitude = 3.0, hz = {:?} }}, {{ joint = 1, amplitude = 1.2, hz = {hz:?} }}, \
             {{ joint = 1, amplitude = 0.7, hz = {:?} }}]\n",
            0.7 * hz,
            2.6 * hz
        )
    };
    let text = format!(
        "device = \"planar2r\"\nseed = {seed}\nsample_s = 0.01\nsteps_per_sample = 20\nnoise_rms = 1e-4\nquantum = 0.0\n\
         start = [-1.4, 0.2]\n[parameters]\n[[effect]]\nid = \"viscous\"\njoint = 0\nFv = 0.3\n\
         [[effect]]\nid = \"viscous\"\njoint = 1\nFv = 0.15\n{payload}{}{}",
        run("one", "fit", 0.5),
        run("two", "validate", 0.6)
    );
    let recipe: Recipe = toml::from_str(&text).unwrap();
    for (name, text) in recipe::make(&recipe, device("planar2r").unwrap()).unwrap() {
        fs::write(folder.join(name), text).unwrap();
    }
}

/// One table for all joints; masses and lengths are the device's, and known.
fn model(folder: &Path, more: &str) {
    let fixed = ["m", "x", "y", "z", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"];
    let device = device("planar2r").unwrap();
    let links: String = device
        .links
        .iter()
        .zip(1..)
        .map(|(link, number)| {
            let values = link.inertial.iter().zip(fixed);
            let values: String = values
                .map(|(own, symbol)| format!("{symbol} = {{ value = {:?}, fixed = true }}\n", own.value))
                .collect();
            format!("[link.{number}]\n{values}")
        })
        .collect();
    let text =
        format!("device = \"planar2r\"\n{links}[[effect]]\nid = \"viscous\"\njoint = \"all\"\nFv = 0.05\n{more}");
    fs::write(folder.join("believed.toml"), text).unwrap();
}

fn values(fit: &Value) -> BTreeMap<String, f64> {
    let of = |own: &Value| Some((own["name"].as_str()?.to_owned(), own["value"].as_f64()?));
    fit["parameters"].as_array().expect("parameters").iter().filter_map(of).collect()
}

/// A box that the arm carries in some runs is fitted to those, and everything else to all of them.
#[test]
fn a_payload_in_some_runs() {
    let folder = TempDir::new().unwrap();
    let box_of_plant = "[[effect]]\nid = \"payload\"\njoint = 1\nm = 0.4\nx = 0.05\ny = -0.02\nz = 0.0\n";
    play(folder.path(), "bare", 3, "");
    play(folder.path(), "laden", 4, box_of_plant);
    let run = |file: &str, role: &str, payload: &str| {
        format!("[[run]]\nfile = \"{file}.csv\"\nfree = [0, 1]\nrole = \"{role}\"\n{payload}")
    };
    let carried = "payload = \"box\"\n";
    let experiment = [
        "device = \"planar2r\"\n".to_owned(),
        run("bare-one", "fit", ""),
        run("laden-one", "fit", carried),
        run("bare-two", "validate", ""),
        run("laden-two", "validate", carried),
    ];
    fs::write(folder.path().join("experiment.toml"), experiment.concat()).unwrap();
    model(
        folder.path(),
        "[[effect]] # what the gripper holds in some runs\nid = \"payload\"\njoint = 1\npayload = \"box\"\nm = 0.1\nz = { value = 0.0, fixed = true }\n",
    );

    let fit = dynid(folder.path(), &["fit", "experiment.toml", "--model", "believed.toml", "--out", "fitted.toml"]);
    let found = values(&fit);
    for (name, truth, within) in [
        ("joint.0.viscous.Fv", 0.3, 1e-3),
        ("joint.1.viscous.Fv", 0.15, 1e-3),
        ("joint.1.payload@box.m", 0.4, 4e-3),
        ("joint.1.payload@box.x", 0.05, 4e-3),
        ("joint.1.payload@box.y", -0.02, 4e-3),
    ] {
        let value = found.get(name).unwrap_or_else(|| panic!("{name} was fitted: {fit}"));
        assert!((value - truth).abs() < within, "{name} = {value}, truly {truth}");
    }
    // The table of all joints is two now, since they differ; the comment and the payload's name stay.
    let text = fs::read_to_string(folder.path().join("fitted.toml")).unwrap();
    assert!(
        text.contains("joint = 0\n") && text.contains("# what the gripper holds") && text.contains("payload = \"box\""),
        "{text}"
    );
    // Bare and laden runs are not held to predict each other.
    dynid(folder.path(), &["check", "experiment.toml", "--model", "fitted.toml"]);
    let misspelt = experiment.concat().replacen("payload = \"box\"", "payload = \"bxo\"", 1);
    fs::write(folder.path().join("misspelt.toml"), misspelt).unwrap();
    let mut program = Command::new(env!("CARGO_BIN_EXE_dynid"));
    let arguments = ["check", "misspelt.toml", "--model", "fitted.toml"];
    let refused = program.args(arguments).current_dir(folder.path()).output().unwrap();
    let told = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{told}");
    assert!(told.contains("carries `bxo`") && told.contains("did you mean `box`"), "{told}");
    let compared = dynid(folder.path(), &["compare", "experiment.toml", "--model", "fitted.toml"]);
    for run in compared["runs"].as_array().expect("runs") {
        for joint in run["joints"].as_array().expect("joints") {
            let size = joint["rmse"].as_f64().expect("a number");
            assert!(size < 2e-3, "{run}");
        }
    }
}

/// Logs of motors behind a coupling are the logs of the joints, and give the same fit; what a unit of current is, is found.
#[test]
fn motors_behind_a_coupling() {
    let folder = TempDir::new().unwrap();
    play(folder.path(), "joints", 3, "");
    let (ratio, constants) = ([[50.0, 40.0], [50.0, -40.0]], [0.05, 0.08]);
    for file in ["one", "two"] {
        let text = fs::read_to_string(folder.path().join(format!("joints-{file}.csv"))).unwrap();
        let mut lines = text.lines();
        assert_eq!(lines.next(), Some("t,tau0,tau1,q0,q1"));
        let mut motors = "time,motor_a,motor_b,current_a,current_b\n".to_owned();
        for line in lines {
            let row: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
            let [t, tau0, tau1, q0, q1] = row[..] else { panic!("five cells") };
            let motor = ratio.map(|[by0, by1]| by0 * q0 + by1 * q1);
            // tau = ratio^T (constant current), solved by hand for this coupling
            let (sum, difference) = (tau0 / 50.0, tau1 / 40.0);
            let current = [(sum + difference) / 2.0 / constants[0], (sum - difference) / 2.0 / constants[1]];
            motors += &format!("{t:?},{:?},{:?},{:?},{:?}\n", motor[0], motor[1], current[0], current[1]);
        }
        fs::write(folder.path().join(format!("motors-{file}.csv")), motors).unwrap();
    }
    let runs = |name: &str| {
        let run = |file: &str, role: &str| {
            format!("[[run]]\nfile = \"{name}-{file}.csv\"\nfree = [0, 1]\nrole = \"{role}\"\n")
        };
        run("one", "fit") + &run("two", "validate")
    };
    let transmission = "columns = { t = \"time\" }\n[transmission]\nposition = [\"motor_a\", \"motor_b\"]\n\
                        torque = [\"current_a\", \"current_b\"]\nratio = [[50, 40], [50, -40]]\n";
    fs::write(folder.path().join("joints.toml"), format!("device = \"planar2r\"\n{}", runs("joints"))).unwrap();
    let known = format!("device = \"planar2r\"\n{transmission}motor_constant = [0.05, 0.08]\n{}", runs("motors"));
    fs::write(folder.path().join("known.toml"), known).unwrap();
    fs::write(folder.path().join("unknown.toml"), format!("device = \"planar2r\"\n{transmission}{}", runs("motors")))
        .unwrap();

    let fitted = |experiment: &str, out: &str| {
        values(&dynid(folder.path(), &["fit", experiment, "--model", "believed.toml", "--out", out]))
    };
    model(folder.path(), "");
    let (of_joints, of_motors) = (fitted("joints.toml", "a.toml"), fitted("known.toml", "b.toml"));
    for (name, value) in &of_joints {
        assert!((value - of_motors[name]).abs() < 1e-7 * value.abs(), "{name}: {value} and {}", of_motors[name]);
    }
    // Of unlike motors each joint has half the sum of both, and what the difference brings of the other's command.
    let coupled =
        |joint: usize, from: usize| format!("[[effect]]\nid = \"input_coupling\"\njoint = {joint}\nfrom = {from}\n");
    let gain = "[[effect]]\nid = \"gain\"\njoint = [0, 1]\nKp = { value = 0.03, lower = 0.001, upper = 1.0 }\n";
    model(folder.path(), &(gain.to_owned() + &coupled(0, 1) + &coupled(1, 0)));
    let found = fitted("unknown.toml", "c.toml");
    let (mean, difference) = ((constants[0] + constants[1]) / 2.0, (constants[0] - constants[1]) / 2.0);
    for (name, truth) in [
        ("joint.0.gain.Kp", mean),
        ("joint.1.gain.Kp", mean),
        ("joint.0.input_coupling.1.gain", difference * 50.0 / 40.0 / mean),
        ("joint.1.input_coupling.0.gain", difference * 40.0 / 50.0 / mean),
        ("joint.0.viscous.Fv", 0.3),
    ] {
        assert!((found[name] / truth - 1.0).abs() < 1e-2, "{name} is not {truth}: {found:?}");
    }
}

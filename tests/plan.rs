//! What appears in the equations, found a second time: from the kernels' numbers instead of by algebra.
//!
//! A link parameter appears when the torques change with it in some state: `d tau / d p = Y d lumps / d p`. At random
//! states, lengths and angles a sum that vanishes identically (`s^2 + c^2 - 1`) leaves rounding alone.

use std::collections::BTreeSet;
use std::path::Path;

use assert_cmd::Command;
use dynid_generated::Kernel;
use dynid_plan::base::base_parameters;
use dynid_plant::random::Noise;
use dynid_user_model::Model;
use nalgebra::DMatrix;
use serde_json::Value;
use tempfile::TempDir;

const STATES: usize = 6;
/// Below this share of the largest derivative is rounding; values, angles and rates are all of order one.
const ROUNDING: f64 = 1e-9;

/// Derivative of the torques by the kernel's parameters, at `[q, dq, ddq]`: regressor times derivative of the lumps.
fn by_parameter(kernel: &Kernel, parameters: &[f64], locked: &[f64], [q, dq, ddq]: &[Vec<f64>; 3]) -> DMatrix<f64> {
    let (n, n_lumps, n_parameters) = (kernel.free.len(), kernel.n_lumps, kernel.parameters.len());
    let mut prepared = vec![0.0; kernel.prepared.len()];
    kernel.functions.prepare(parameters, locked, &mut prepared);
    let mut lumps = vec![0.0; kernel.prepared.len() * n_parameters];
    kernel.functions.prepare_gradient(parameters, locked, &mut lumps);
    let mut regressor = vec![0.0; n * n_lumps];
    kernel.functions.regressor(&prepared, q, dq, ddq, &mut regressor);
    let lumps = DMatrix::from_row_slice(n_lumps, n_parameters, &lumps[..n_lumps * n_parameters]);
    DMatrix::from_row_slice(n, n_lumps, &regressor) * lumps
}

fn appearing(kernel: &Kernel) -> BTreeSet<String> {
    let (n, n_parameters) = (kernel.free.len(), kernel.parameters.len());
    let mut random = Noise::new(11);
    let mut appearing = BTreeSet::new();
    for _ in 0..STATES {
        let mut draw = |length: usize, low: f64, high: f64| -> Vec<f64> {
            (0..length).map(|_| low + (high - low) * random.uniform()).collect()
        };
        let parameters = draw(n_parameters, 0.5, 1.5);
        let locked = draw(kernel.locked.len(), -3.0, 3.0);
        let motion = [draw(n, -3.0, 3.0), draw(n, -3.0, 3.0), draw(n, -3.0, 3.0)];
        let by_parameter = by_parameter(kernel, &parameters, &locked, &motion);
        let mut derivatives = Vec::new();
        for (column, name) in kernel.parameters.iter().enumerate().filter(|(_, name)| name.starts_with("link.")) {
            for row in 0..n {
                derivatives.push(((*name).to_owned(), by_parameter[(row, column)].abs()));
            }
        }
        let largest = derivatives.iter().fold(0.0, |largest: f64, (_, size)| largest.max(*size));
        appearing.extend(derivatives.into_iter().filter(|(_, size)| *size > ROUNDING * largest).map(|(name, _)| name));
    }
    appearing
}

#[test]
fn algebra_and_numbers_agree_on_what_appears() {
    assert!(!dynid_generated::kernels().is_empty());
    for kernel in dynid_generated::kernels() {
        let by_numbers = appearing(kernel);
        let by_algebra = dynid_plan::appearing(kernel);
        assert_eq!(by_numbers, by_algebra, "{} {:?}", kernel.device, kernel.free);
    }
}

/// The number of base parameters, found a second way: from derivatives of the kernels' lumps by mass, centroid and inertia
/// about the centroid of random bodies, at the device's lengths.
#[test]
fn base_parameters_are_as_many_as_independent_torques() {
    for device in dynid_model::devices() {
        let mut model = Model::of_device(device);
        model.effects.clear();
        for kernel in dynid_generated::kernels().iter().filter(|kernel| kernel.device == device.id) {
            let base = base_parameters(&model, &[kernel.free.to_vec()]).unwrap();
            assert_eq!(rank(&model, kernel), base.rank(), "{} {:?}", device.id, kernel.free);
        }
    }
}

fn rank(model: &Model, kernel: &Kernel) -> usize {
    let (n, n_parameters) = (kernel.free.len(), kernel.parameters.len());
    let links: Vec<usize> = (0..n_parameters).filter(|&index| kernel.parameters[index].starts_with("link.")).collect();
    let mut random = Noise::new(19);
    let mut draw = |length: usize, low: f64, high: f64| -> Vec<f64> {
        (0..length).map(|_| low + (high - low) * random.uniform()).collect()
    };
    let mut parameters = draw(n_parameters, 0.5, 1.5);
    for (value, name) in parameters.iter_mut().zip(kernel.parameters).filter(|(_, name)| !name.starts_with("link.")) {
        *value = model.parameter(name).unwrap().value;
    }
    let n_motions = 80;
    let mut rows = DMatrix::zeros(n_motions * n, links.len());
    for motion in 0..n_motions {
        let locked = draw(kernel.locked.len(), -3.0, 3.0);
        let state = [draw(n, -3.0, 3.0), draw(n, -3.0, 3.0), draw(n, -3.0, 3.0)];
        let by_parameter = by_parameter(kernel, &parameters, &locked, &state);
        rows.rows_mut(motion * n, n).copy_from(&by_parameter.select_columns(&links));
    }
    let lengths: Vec<f64> = rows.column_iter().map(|column| column.norm()).collect();
    let largest = lengths.iter().fold(0.0_f64, |largest, length| largest.max(*length));
    let columns: Vec<_> = rows
        .column_iter()
        .zip(&lengths)
        .filter(|(_, length)| **length > ROUNDING * largest)
        .map(|(column, length)| column / *length)
        .collect();
    let singular = DMatrix::from_columns(&columns).singular_values();
    singular.iter().filter(|value| **value > ROUNDING * singular.max()).count()
}

fn plan(folder: &Path, arguments: &[&str]) -> Value {
    let mut command = Command::cargo_bin("dynid").unwrap();
    let output = command.current_dir(folder).arg("plan").args(arguments).arg("--json").assert().success();
    serde_json::from_slice(&output.get_output().stdout).unwrap()
}

fn texts(list: &Value) -> Vec<&str> {
    list.as_array().unwrap().iter().map(|text| text.as_str().unwrap()).collect()
}

/// An arm with six revolute joints whose last three axes meet has 36 base parameters of links; its rotors, of which those
/// of the first two joints turn like the links, frictions and offsets add to them.
#[test]
fn an_industrial_arm_is_planned_for() {
    let folder = TempDir::new().unwrap();
    let plan = plan(folder.path(), &["staubli_tx40", "--method", "found"]);
    assert_eq!(plan["method"], "found");
    let base = &plan["base_parameters"];
    let combinations = texts(&base["combinations"]);
    assert_eq!(combinations.iter().filter(|message| message.starts_with("link.")).count(), 36);
    assert_eq!(base["rank"], combinations.len());
    assert_eq!(base["exact"], true);
    assert!(combinations.contains(&"link.2.mx + a3*link.3.m + a3*link.4.m + a3*link.5.m + a3*link.6.m"));
    assert!(plan["flat_directions"].as_array().unwrap().iter().all(|flat| flat["scale"] == false));
    let steps = plan["configurations"].as_array().unwrap();
    assert_eq!(steps.last().unwrap()["free"], serde_json::json!([0, 1, 2, 3, 4, 5]));
}

/// A model says which effects there are and what is known: with one gain known, the answer has no free scale.
#[test]
fn a_model_with_a_known_gain_has_no_scale() {
    let folder = TempDir::new().unwrap();
    let model = |fixed: &str| {
        format!(
            "device = \"planar2r\"\n\n[[effect]]\nid = \"gain\"\njoint = 0\nKp = {{ value = 2.0{fixed} }}\n\n\
             [[effect]]\nid = \"viscous\"\njoint = 0\nFv = 0.1\n\n[[effect]]\nid = \"gain\"\njoint = 1\nKp = 3.0\n"
        )
    };
    std::fs::write(folder.path().join("model.toml"), model("")).unwrap();
    let free = plan(folder.path(), &["--model", "model.toml", "--method", "found"]);
    let flat = free["flat_directions"].as_array().unwrap();
    assert_eq!(flat.len(), 1, "{flat:?}");
    assert_eq!(flat[0]["scale"], true);
    assert_eq!(texts(&flat[0]["fix_one_of"]), ["joint.0.gain.Kp", "joint.0.viscous.Fv", "joint.1.gain.Kp"]);
    std::fs::write(folder.path().join("model.toml"), model(", fixed = true")).unwrap();
    let known = plan(folder.path(), &["--model", "model.toml"]);
    assert_eq!(known["flat_directions"], serde_json::json!([]));
}

#[test]
fn base_parameters_are_written_out() {
    let mut command = Command::cargo_bin("dynid").unwrap();
    let output = command.args(["plan", "planar2r", "--base"]).assert().success();
    insta::assert_snapshot!(String::from_utf8_lossy(&output.get_output().stdout));
}

/// One joint at a time never shows what only acts where joints move together.
#[test]
fn what_a_method_does_not_reach_is_reported() {
    let folder = TempDir::new().unwrap();
    let why = |plan: &Value, name: &str| {
        let missing = plan["unreachable"].as_array().unwrap().iter().find(|missing| missing["name"] == name);
        missing.map(|missing| missing["why"].as_str().unwrap().to_owned())
    };
    let isolated = plan(folder.path(), &["staubli_tx40", "--method", "isolated"]);
    let other = "another configuration of the device reveals it";
    assert_eq!(why(&isolated, "link.2.Ixz").as_deref(), Some(other));
    assert_eq!(why(&isolated, "link.1.Ixx").as_deref(), Some("it stands in no equation of motion"));
    let found = plan(folder.path(), &["staubli_tx40", "--method", "found"]);
    assert_eq!(why(&found, "link.2.Ixz"), None);
}

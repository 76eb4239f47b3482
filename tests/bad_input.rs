//! Bad input, through the binary: one clear error, exit status 2, nothing on stdout, nothing written.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use tempfile::TempDir;

/// A small experiment of the two-link arm that is right.
const EXPERIMENT: &str = "device = \"planar2r\"\n\n[[run]]\nfile = \"swing.csv\"\nfree = [1]\nrole = \"fit\"\n";

/// A small log that is right.
fn log() -> String {
    let mut text = String::from("t,tau0,tau1,q0,q1\n");
    for k in 0..200 {
        let t = f64::from(k) * 0.01;
        text.push_str(&format!("{t:.2},0,{:.4},0.1,{:.5}\n", (3.0 * t).cos(), 0.2 * (3.0 * t).sin()));
    }
    text
}

/// A small model that is right.
const MODEL: &str =
    "device = \"planar2r\"\n\n[link.2]\nm = 0.7\n\n[[effect]]\nid = \"viscous\"\njoint = 1\nFv = 0.02\n";

/// A folder with the three files.
fn folder() -> TempDir {
    let folder = TempDir::new().unwrap();
    put(&folder, "experiment.toml", EXPERIMENT);
    put(&folder, "swing.csv", &log());
    put(&folder, "model.toml", MODEL);
    folder
}

fn put(folder: &TempDir, name: &str, text: &str) {
    fs::write(folder.path().join(name), text).unwrap();
}

fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut contents: Vec<(String, Vec<u8>)> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap())
        .filter(|entry| entry.path().is_file())
        .map(|entry| (entry.file_name().to_string_lossy().into_owned(), fs::read(entry.path()).unwrap()))
        .collect();
    contents.sort();
    contents
}

/// Runs `dynid` in the folder; it must refuse and leave the folder as it was. Returns what it said.
fn refused(folder: &TempDir, arguments: &[&str]) -> String {
    let before = contents(folder.path());
    let output = Command::cargo_bin("dynid").unwrap().args(arguments).current_dir(folder.path()).output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?} said: {message}");
    assert!(output.stdout.is_empty(), "{arguments:?} wrote to stdout");
    assert_eq!(message.matches("error: ").count(), 1, "one error, not more: {message}");
    assert!(message.starts_with("error: "), "{message}");
    assert!(before == contents(folder.path()), "{arguments:?} changed files");
    message.replace(&folder.path().display().to_string(), "[folder]")
}

/// The smallest device file of the library with one thing replaced.
fn device_with(from: &str, to: &str) -> TempDir {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("model/devices/planar2r.toml");
    let text = fs::read_to_string(file).unwrap().replace("\r\n", "\n");
    assert!(text.contains(from), "`{from}` is in the device file");
    let folder = TempDir::new().unwrap();
    put(&folder, "arm.toml", &text.replacen(from, to, 1));
    folder
}

fn device_refused(from: &str, to: &str) -> String {
    refused(&device_with(from, to), &["devices", "--check", "arm.toml"])
}

const FIT: [&str; 6] = ["fit", "experiment.toml", "--model", "model.toml", "--out", "fitted.toml"];

#[test]
fn the_inputs_that_the_others_are_made_from_are_right() {
    let folder = device_with("m = 1.2", "m = 1.2");
    Command::cargo_bin("dynid")
        .unwrap()
        .args(["devices", "--check", "arm.toml"])
        .current_dir(folder.path())
        .assert()
        .success();
    let folder = self::folder();
    Command::cargo_bin("dynid")
        .unwrap()
        .args(["compare", "experiment.toml", "--model", "model.toml", "--error", "torque"])
        .current_dir(folder.path())
        .assert()
        .success();
}

#[test]
fn a_row_that_names_an_unknown_joint() {
    insta::assert_snapshot!(device_refused("theta = \"q1\"", "theta = \"q2\""));
}

#[test]
fn a_row_that_names_an_unknown_frame() {
    insta::assert_snapshot!(device_refused("parent = \"f1\"", "parent = \"f7\""));
}

#[test]
fn a_cycle_of_frames() {
    insta::assert_snapshot!(device_refused("parent = \"base\"", "parent = \"f2\""));
}

#[test]
fn a_missing_unit() {
    insta::assert_snapshot!(device_refused("mass = \"kg\"\n", ""));
}

#[test]
fn a_negative_mass() {
    insta::assert_snapshot!(device_refused("m = 1.2", "m = -1.2"));
}

#[test]
fn a_negative_mass_in_a_model() {
    let folder = folder();
    put(&folder, "model.toml", &MODEL.replace("m = 0.7", "m = -0.7"));
    insta::assert_snapshot!(refused(&folder, &FIT));
}

#[test]
fn an_inertia_that_no_body_has() {
    insta::assert_snapshot!(device_refused("Izz = 1.612e-2", "Izz = 9.0e-2"));
}

#[test]
fn a_log_without_a_column() {
    let folder = folder();
    put(&folder, "swing.csv", &log().replacen("q1", "angle", 1));
    insta::assert_snapshot!(refused(&folder, &FIT));
}

#[test]
fn a_log_with_nan() {
    let folder = folder();
    put(&folder, "swing.csv", &log().replacen("0.50,0,", "0.50,NaN,", 1));
    insta::assert_snapshot!(refused(&folder, &FIT));
}

#[test]
fn a_log_whose_time_runs_backwards() {
    let folder = folder();
    put(&folder, "swing.csv", &log().replacen("\n0.50,", "\n0.05,", 1));
    insta::assert_snapshot!(refused(&folder, &FIT));
}

#[test]
fn a_log_that_is_a_header_only() {
    let folder = folder();
    put(&folder, "swing.csv", "t,tau0,tau1,q0,q1\n");
    insta::assert_snapshot!(refused(&folder, &FIT));
}

#[test]
fn a_run_that_names_a_free_joint_twice() {
    let folder = folder();
    put(&folder, "experiment.toml", &EXPERIMENT.replace("[1]", "[1, 1]"));
    insta::assert_snapshot!(refused(&folder, &["fit", "experiment.toml", "--out", "fitted.toml"]));
}

#[test]
fn a_device_file_that_is_not_there() {
    let folder = folder();
    put(&folder, "experiment.toml", &EXPERIMENT.replace("planar2r", "my_arm.toml"));
    insta::assert_snapshot!(refused(&folder, &["fit", "experiment.toml", "--out", "fitted.toml"]));
}

#[test]
fn a_device_file_that_is_wrong() {
    let folder = device_with("theta = \"q1\"", "theta = \"q2\"");
    put(&folder, "model.toml", "device = \"arm.toml\"\n");
    insta::assert_snapshot!(refused(&folder, &["plan", "--model", "model.toml"]));
}

#[test]
fn a_model_for_another_device() {
    let folder = folder();
    put(&folder, "model.toml", "device = \"double_pendulum\"\n");
    insta::assert_snapshot!(refused(&folder, &FIT));
}

#[test]
fn an_unknown_effect() {
    let folder = folder();
    put(&folder, "model.toml", &MODEL.replace("viscous", "viscos"));
    insta::assert_snapshot!(refused(&folder, &FIT));
}

#[test]
fn an_unknown_parameter_of_an_effect() {
    let folder = folder();
    put(&folder, "model.toml", &MODEL.replace("Fv", "Fw"));
    insta::assert_snapshot!(refused(&folder, &FIT));
}

#[test]
fn an_unknown_parameter_of_a_link() {
    let folder = folder();
    put(&folder, "model.toml", &MODEL.replace("m = 0.7", "Ixxx = 0.7"));
    insta::assert_snapshot!(refused(&folder, &FIT));
}

#[test]
fn an_unknown_device() {
    let folder = folder();
    insta::assert_snapshot!(refused(&folder, &["devices", "planar3r"]));
}

#[test]
fn an_unknown_method() {
    let folder = folder();
    insta::assert_snapshot!(refused(&folder, &["plan", "planar2r", "--method", "isolate"]));
}

#[test]
fn an_output_that_cannot_be_written() {
    let folder = folder();
    let mut arguments = FIT;
    arguments[5] = "no/such/folder/fitted.toml";
    insta::assert_snapshot!(refused(&folder, &arguments));
}

#[test]
fn an_output_that_exists() {
    let folder = folder();
    put(&folder, "fitted.toml", "mine\n");
    insta::assert_snapshot!(refused(&folder, &FIT));
}

#[test]
fn an_experiment_that_is_not_there() {
    let folder = TempDir::new().unwrap();
    insta::assert_snapshot!(refused(&folder, &["compare", "experiment.toml", "--model", "model.toml"]));
}

#[test]
fn a_controller_with_a_limit_below_zero() {
    let folder = folder();
    let log: String =
        log().lines().enumerate().map(|(k, row)| format!("{row},{}\n", if k == 0 { "ref1" } else { "0" })).collect();
    put(&folder, "swing.csv", &log);
    put(&folder, "control.toml", "P = [0, 2]\nD = [0, 0.1]\nlimit = [1, -0.5]\n");
    put(&folder, "experiment.toml", &EXPERIMENT.replace("[[run]]", "[[run]]\ncontroller = \"control.toml\""));
    insta::assert_snapshot!(refused(&folder, &["compare", "experiment.toml", "--model", "model.toml"]));
}

/// A model that a position fit can start from.
const HELD: &str = "device = \"planar2r\"\n\n[link.2]\nm = { value = 0.7, fixed = true }\n\n[[effect]]\nid = \"lugre\"\njoint = 1\n\
                    sigma0 = 1.0\nFs = 0.02\nFc = 0.01\n\n[[effect]]\nid = \"spring\"\njoint = 1\nKs = 0.5\nqeq = 0.0\n";

/// What a fit of `HELD`, with one thing replaced, is refused for.
fn fit_refused(from: &str, to: &str, more: &[&str]) -> String {
    assert!(HELD.contains(from), "`{from}` is in the model");
    let folder = folder();
    put(&folder, "model.toml", &HELD.replacen(from, to, 1));
    let arguments: Vec<&str> = FIT.iter().chain(more).copied().collect();
    refused(&folder, &arguments)
}

#[test]
fn bounds_that_cross() {
    insta::assert_snapshot!(fit_refused("Ks = 0.5", "Ks = { value = 0.5, lower = 1.0, upper = 0.1 }", &[]));
}

#[test]
fn a_start_outside_its_bounds() {
    insta::assert_snapshot!(fit_refused("Ks = 0.5", "Ks = { value = 0.5, lower = 0.6, upper = 1.0 }", &[]));
}

#[test]
fn a_start_outside_its_bounds_is_clipped_on_request() {
    let folder = folder();
    put(&folder, "model.toml", &MODEL.replace("m = 0.7", "m = { value = 0.7, lower = 0.8, upper = 0.9 }"));
    let output = Command::cargo_bin("dynid")
        .unwrap()
        .args(FIT)
        .args(["--clip", "--error", "torque"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{message}");
    assert!(message.contains("link.2.m started at 0.7, outside its bounds 0.8 .. 0.9; clipped to 0.8"), "{message}");
}

#[test]
fn a_start_that_no_body_can_be_is_moved_on_request() {
    let folder = folder();
    let impossible = "[link.2]\nIxx = 1e-4\nIyy = 1e-4\nIzz = 1e-2\n";
    put(&folder, "model.toml", &MODEL.replace("[link.2]\n", impossible));
    let arguments = [FIT.as_slice(), &["--error", "torque"]].concat();
    assert!(refused(&folder, &arguments).contains("no body has the inertial parameters of link 2"));
    let output =
        Command::cargo_bin("dynid").unwrap().args(&arguments).arg("--clip").current_dir(folder.path()).output();
    let output = output.unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{message}");
    assert!(message.contains("link 2 started with an inertia that no body has"), "{message}");
}

#[test]
fn static_friction_below_coulomb_friction() {
    insta::assert_snapshot!(fit_refused("Fs = 0.02", "Fs = 0.005", &[]));
}

#[test]
fn no_free_joint() {
    let folder = folder();
    put(&folder, "experiment.toml", &EXPERIMENT.replace("free = [1]", "free = []"));
    insta::assert_snapshot!(refused(&folder, &FIT));
}

#[test]
fn a_log_too_short_for_the_cut_of_its_transient() {
    insta::assert_snapshot!(fit_refused("Fs", "Fs", &["--from-s", "1.95"]));
}

#[test]
fn a_fixed_parameter_among_the_unknowns() {
    insta::assert_snapshot!(fit_refused("Fs", "Fs", &["--only", "joint.1.spring.Ks,link.2.m"]));
}

#[test]
fn weights_of_no_method() {
    insta::assert_snapshot!(fit_refused("Fs", "Fs", &["--weights", "method"]));
}

#[test]
fn a_run_of_another_configuration_than_the_methods() {
    let folder = folder();
    let rows: String = log()
        .lines()
        .enumerate()
        .map(|(k, row)| {
            if k == 0 {
                "t,tau0,tau1,tau2,tau3,tau4,tau5,q0,q1,q2,q3,q4,q5\n".to_owned()
            } else {
                format!("{row},0,0,0,0,0,0,0,0\n")
            }
        })
        .collect();
    put(&folder, "swing.csv", &rows);
    put(&folder, "experiment.toml", &EXPERIMENT.replace("planar2r", "freedom6s").replace("[1]", "[4, 5]"));
    insta::assert_snapshot!(refused(&folder, &["fit", "experiment.toml", "--method", "isolated", "--out", "f.toml"]));
}

#[test]
fn a_resumption_of_nothing() {
    insta::assert_snapshot!(fit_refused("Fs", "Fs", &["--resume"]));
}

const DIAGNOSE: [&str; 4] = ["diagnose", "experiment.toml", "--model", "model.toml"];

#[test]
fn a_diagnosis_of_a_run_too_short_to_tell() {
    let folder = folder();
    let short: Vec<String> = log().lines().take(41).map(str::to_owned).collect();
    put(&folder, "swing.csv", &(short.join("\n") + "\n"));
    insta::assert_snapshot!("too_short_in_parts", refused(&folder, &DIAGNOSE));
    let held_out = "\n[[run]]\nfile = \"other.csv\"\nfree = [1]\nrole = \"validate\"\n";
    put(&folder, "other.csv", &log());
    put(&folder, "experiment.toml", &format!("{EXPERIMENT}{held_out}"));
    insta::assert_snapshot!("too_short", refused(&folder, &DIAGNOSE));
}

#[test]
fn a_diagnosis_of_runs_in_which_nothing_moves() {
    let folder = folder();
    let still: String = log()
        .lines()
        .enumerate()
        .map(|(k, row)| match row.rsplit_once(',') {
            Some((row, _)) if k > 0 => format!("{row},0.30000\n"),
            _ => format!("{row}\n"),
        })
        .collect();
    put(&folder, "swing.csv", &still);
    insta::assert_snapshot!(refused(&folder, &DIAGNOSE));
}

#[test]
fn a_diagnosis_with_no_run_to_fit_to() {
    let folder = folder();
    put(&folder, "experiment.toml", &EXPERIMENT.replace("\"fit\"", "\"validate\""));
    insta::assert_snapshot!(refused(&folder, &DIAGNOSE));
}

#[test]
fn a_model_with_two_alternatives_at_one_joint() {
    let folder = folder();
    let two = "\n[[effect]]\nid = \"dahl\"\njoint = 1\n\n[[effect]]\nid = \"stribeck\"\njoint = 1\n";
    put(&folder, "model.toml", &format!("{MODEL}{two}"));
    insta::assert_snapshot!(refused(&folder, &DIAGNOSE));
}

#[test]
fn a_model_with_an_effect_beside_one_that_contains_it() {
    let folder = folder();
    put(&folder, "model.toml", &format!("{MODEL}\n[[effect]]\nid = \"turner\"\njoint = 1\n"));
    insta::assert_snapshot!(refused(&folder, &DIAGNOSE));
}

#[test]
fn a_free_joint_that_the_device_lacks() {
    let folder = folder();
    put(&folder, "experiment.toml", &EXPERIMENT.replace("free = [1]", "free = [7]"));
    insta::assert_snapshot!(refused(&folder, &DIAGNOSE));
}

#[test]
fn a_ladder_of_models_of_two_devices() {
    let folder = folder();
    put(&folder, "other.toml", "device = \"double_pendulum\"\n");
    insta::assert_snapshot!(refused(&folder, &["ladder", "experiment.toml", "model.toml", "other.toml"]));
}

//! `dynid add`: a model with one effect more, and nothing else changed.

use assert_cmd::Command;
use predicates::prelude::*;

fn dynid() -> Command {
    Command::cargo_bin("dynid").expect("the binary is built")
}

const MODEL: &str = "\
# what we believe of the arm
device = \"planar2r\"

[[effect]]            # a motor drives the first joint
id = \"viscous\"
joint = 0
Fv = 0.05             # from the data sheet
";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("model.toml"), MODEL).expect("a file");
    folder
}

#[test]
fn the_effect_stands_where_it_vanishes_and_the_file_keeps_its_comments() {
    let folder = folder();
    let run = |arguments: &[&str]| dynid().current_dir(&folder).args(arguments).assert();
    run(&["add", "coulomb", "--joint", "0,1", "--model", "model.toml", "--out", "better.toml"])
        .success()
        .stdout(predicate::str::contains("`coulomb` at joint 1"));
    let better = std::fs::read_to_string(folder.path().join("better.toml")).expect("written");
    for kept in
        ["# what we believe of the arm", "# a motor drives the first joint", "Fv = 0.05", "# from the data sheet"]
    {
        assert!(better.contains(kept), "{kept} is gone:\n{better}");
    }
    let model: toml::Table = better.parse().expect("TOML");
    let effects = model["effect"].as_array().expect("effects");
    assert_eq!(effects.len(), 3);
    for effect in &effects[1..] {
        assert_eq!(effect["id"].as_str(), Some("coulomb"));
        let value = effect["Fc"].as_float().or_else(|| effect["Fc"]["value"].as_float());
        assert_eq!(value, Some(0.0), "{effect}");
    }
    // Nothing is overwritten.
    run(&["add", "coulomb", "--joint", "0", "--model", "model.toml", "--out", "better.toml"])
        .code(2)
        .stderr(predicate::str::contains("better.toml exists already"));
}

#[test]
fn a_larger_law_takes_over_what_it_shares() {
    let folder = folder();
    let run = |arguments: &[&str]| dynid().current_dir(&folder).args(arguments).assert();
    run(&["add", "lugre", "--joint", "0", "--set", "sigma0=2", "--model", "model.toml", "--out", "lugre.toml"])
        .success()
        .stdout(predicate::str::contains("in place of `viscous` at joint 0"));
    let model: toml::Table =
        std::fs::read_to_string(folder.path().join("lugre.toml")).expect("written").parse().expect("TOML");
    let effects = model["effect"].as_array().expect("effects");
    assert_eq!(effects.len(), 1);
    let value = |symbol: &str| {
        effects[0].get(symbol).and_then(|value| value.as_float().or_else(|| value.get("value")?.as_float()))
    };
    assert_eq!((value("sigma2"), value("sigma0")), (Some(0.05), Some(2.0)));
    // The smaller law is inside of it.
    run(&["add", "coulomb", "--joint", "0", "--model", "lugre.toml", "--out", "no.toml"])
        .code(2)
        .stderr(predicate::str::contains("takes the place of `coulomb`"));
    assert!(!folder.path().join("no.toml").exists());
}

#[test]
fn what_cannot_be_is_one_error() {
    let folder = folder();
    let run = |arguments: &[&str]| {
        dynid()
            .current_dir(&folder)
            .args(["add"])
            .args(arguments)
            .args(["--model", "model.toml", "--out", "no.toml"])
            .assert()
            .code(2)
    };
    run(&["coulom", "--joint", "0"]).stderr(predicate::str::contains("did you mean `coulomb`"));
    run(&["coulomb", "--joint", "7"]).stderr(predicate::str::contains("has no joint 7"));
    run(&["coulomb"]).stderr(predicate::str::contains("acts on one joint"));
    run(&["input_coupling", "--joint", "0"]).stderr(predicate::str::contains("acts on a pair of joints"));
    run(&["viscous", "--joint", "0"]).stderr(predicate::str::contains("already"));
    run(&["coulomb", "--joint", "0", "--set", "Fq=1"])
        .stderr(predicate::str::contains("--set Fq=1: `coulomb` at joint 0 has no `Fq`"));
    run(&["coulomb", "--joint", "0", "--set", "Fc=-1"])
        .stderr(predicate::str::contains("--set Fc=-1: joint.0.coulomb.Fc lies between 0 and"));
    assert!(!folder.path().join("no.toml").exists(), "nothing is written beside an error");
}

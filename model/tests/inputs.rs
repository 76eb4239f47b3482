//! Inputs by name: what the files say, and what is told of wrong ones.

use std::path::Path;

use dynid_model::{Device, ModelError, NamedInput, Quantity, device, inputs};

#[test]
fn the_thesis_tables_are_there() {
    let all = inputs(dynid_model::device("freedom6s").unwrap());
    let count = |table: &str| all.iter().filter(|input| input.name.starts_with(table)).count();
    assert_eq!(["table-4.3", "table-4.4", "table-4.5", "table-4.7", "table-4.9"].map(count), [6, 35, 1, 5, 1]);
    let find = |name: &str| all.iter().find(|input| input.name == name).unwrap();
    // Table 4.7, joint 4: (0.0045 - (0.002/60) t) cos((0.5 + (2.5/60) t) t + pi/2)
    let chirp = find("table-4.7-configuration-1");
    let (t, joint) = (7.0_f64, chirp.joints[0]);
    let expected = (0.0045 - 0.002 / 60.0 * t) * ((0.5 + 2.5 / 60.0 * t) * t + std::f64::consts::FRAC_PI_2).cos();
    assert!((joint.joint, chirp.quantity) == (4, Quantity::Torque) && (joint.at(t) - expected).abs() < 1e-15);
    assert_eq!(find("table-4.9").quantity, Quantity::Position);
    assert!(find("table-4.4-configuration-1-test-5").note.is_some(), "a frequency in brackets");
}

#[test]
fn a_device_without_inputs_has_none() {
    assert!(inputs(dynid_model::device("planar2r").unwrap()).is_empty());
}

fn error(text: &str) -> ModelError {
    let device: &Device = device("planar2r").unwrap();
    NamedInput::parse(text, Path::new("inputs/planar2r.toml"), device).unwrap_err()
}

#[test]
fn wrong_inputs_are_told_with_their_place() {
    let input = |change: (&str, &str)| {
        let text = "source = \"ours\"\n[[input]]\nname = \"a\"\nfree = [1]\nquantity = \"torque\"\nduration_s = 1\n\
                    sample_s = 0.01\njoints = [{ joint = 1, amplitude = [1], frequency = [2, 0.1] }]\n";
        assert!(text.contains(change.0), "{change:?}");
        let error = error(&text.replace(change.0, change.1));
        format!("{}:{}: {} | {}", error.line(), error.column(), error.message(), error.remedy().unwrap_or(""))
    };
    let told = [
        ("[1]\nq", "[2]\nq"),
        ("\"torque\"", "\"speed\""),
        ("duration_s = 1", "duration_s = -1"),
        ("joint = 1", "joint = 0"),
        ("[2, 0.1]", "[2, 0.1, 3]"),
        ("[[input]]", "[[inputs]]"),
    ]
    .map(input);
    insta::assert_snapshot!(told.join("\n"));
}

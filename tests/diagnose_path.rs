//! The ways that diagnoses go, step by step, as snapshots: what each candidate promised, what every search came to, what was
//! concluded. Whether an answer is right, other tests ask; these show a change of the procedure that changes no answer, to whoever
//! reviews it.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::sync::Mutex;

use dynid_diagnose::{Event, Finished, Options};
use dynid_identify::identify::ErrorSignal;
use tempfile::TempDir;

use crate::diagnose::{SWINGS, VISCOUS, answer, arm, arm_without_its_friction};
use crate::discover::both_joints;
use crate::figures::lines;

/// A line for each search, then one for each part of the answer.
fn path(folder: &Path, options: &Options) -> String {
    let searches: Mutex<BTreeMap<String, String>> = Mutex::default();
    let hear = |event: &Event<'_>| {
        if let Event::Searched(key, state) = event {
            let cost = state.cost.map_or_else(|| "cannot be predicted".to_owned(), |cost| format!("{cost:.1}"));
            let linearisations = state.iterations + state.search.iterations;
            searches.lock().unwrap().insert((*key).to_owned(), format!("{cost}, {linearisations} linearisations"));
        }
    };
    let found = answer(folder, options, &Finished::new(), &hear, &|| false).unwrap();
    let mut text = String::new();
    for (key, search) in searches.into_inner().unwrap() {
        let _ = writeln!(text, "{key}: {search}");
    }
    let _ = write!(text, "\n{}", lines(&serde_json::to_value(&found).unwrap()));
    text
}

/// Of an arm with these effects in these runs, and a model that knows of some.
fn path_of(effects: &str, runs: &str, believed: &str) -> String {
    let folder = arm(&format!("[parameters]\n{effects}"), runs);
    fs::write(folder.path().join("believed.toml"), format!("device = \"planar2r\"\n{believed}")).unwrap();
    path(folder.path(), &Options::default())
}

const WAVES: [(f64, f64); 3] = [(0.21, 1.2), (0.63, 0.8), (1.7, 0.5)];

#[test]
fn one_effect_of_one_joint() {
    let folder: TempDir = arm_without_its_friction();
    insta::assert_snapshot!(path(folder.path(), &Options::default()));
}

/// More than twice as long as the beginnings that promises and races rest on.
#[test]
fn long_runs() {
    let run = |file: &str, role: &str, hz: f64| {
        format!(
            "[[run]]\nfile = \"{file}\"\nfree = [1]\nrole = \"{role}\"\nduration_s = 35.0\ntorque = [{{ joint = 1, amplitude = \
             0.9, hz = {hz:?} }}, {{ joint = 1, amplitude = 0.5, hz = 1.3, hz_per_s = 0.02 }}]\n"
        )
    };
    let runs = [run("one.csv", "fit", 0.4), run("two.csv", "fit", 0.53), run("three.csv", "validate", 0.61)].concat();
    let missing = "[[effect]]\nid = \"coulomb\"\njoint = 1\nFc = 0.1\nv_eps = 0.01\n";
    insta::assert_snapshot!(path_of(&format!("{VISCOUS}{missing}"), &runs, VISCOUS));
}

#[test]
fn by_the_torque_error() {
    let folder = arm_without_its_friction();
    let options = Options { error: Some(ErrorSignal::Torque), ..Options::default() };
    insta::assert_snapshot!(path(folder.path(), &options));
}

#[test]
fn two_effects_of_two_joints() {
    let missing = "[[effect]]\nid = \"coulomb\"\njoint = 1\nFc = 0.1\nv_eps = 0.01\n[[effect]]\nid = \"torque_offset\"\njoint = 0\noffset = 0.4\n";
    insta::assert_snapshot!(path_of(&format!("{VISCOUS}{missing}"), &both_joints(&WAVES, 5.0), VISCOUS));
}

#[test]
fn nothing_of_two_joints() {
    let believed = VISCOUS.replace("0.6\n", "0.5\n");
    insta::assert_snapshot!(path_of(VISCOUS, &both_joints(&WAVES, 4.0), &believed));
}

#[test]
fn a_law_of_no_library() {
    let missing = "[[effect]]\nid = \"viscous_position\"\njoint = 1\nF = 0.2\nk = 3.0\n";
    insta::assert_snapshot!(path_of(&format!("{VISCOUS}{missing}"), SWINGS, VISCOUS));
}

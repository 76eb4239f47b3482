//! What a diagnosis says of runs that are not all that one would wish for.
//!
//! The machines and their logs are the plant's (`tests/plant`), which shares no code with the program.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use assert_cmd::Command;

use dynid_diagnose::{
    DiagnoseError, Diagnosis, Event, Finished, Note, Options, Statement, Verdict, candidates, diagnose,
};
use dynid_identify::identify::ErrorSignal;
use dynid_logs::{experiment::Experiment, experiment::Run};
use dynid_model::Parameter;
use dynid_plant::hidden::{Case, Kind, table, trial};
use dynid_plant::recipe::{self, Recipe};
use dynid_user_model::Model;
use serde_json::Value;
use tempfile::TempDir;

/// The case of that kind and name (without its number), with runs so short.
fn case(kind: Kind, name: &str, duration_s: f64) -> Case {
    let mut cases = table::cases();
    let is_meant = |case: &Case| case.kind == kind && case.name.ends_with(name);
    let index = cases.iter().position(is_meant).expect("a case of the table");
    let mut case = cases.swap_remove(index);
    for run in case.truth.runs.iter_mut().chain(&mut case.without.runs) {
        run.duration_s = duration_s;
    }
    case
}

fn played(case: &Case) -> TempDir {
    let folder = TempDir::new().unwrap();
    trial::write(case, folder.path()).unwrap();
    folder
}

fn diagnosed(folder: &Path) -> Value {
    let model = ["diagnose", "experiment.toml", "--model", "believed.toml"];
    let arguments = [model.as_slice(), &["--json"]].concat();
    let output = Command::cargo_bin("dynid").unwrap().args(arguments).current_dir(folder).assert().success();
    serde_json::from_slice(&output.get_output().stdout).unwrap()
}

fn has_note(diagnosis: &Value, kind: &str) -> bool {
    diagnosis["typed_notes"].as_array().unwrap().iter().any(|note| note["kind"] == kind)
}

/// The same with runs that are all to be fitted to, and only two of them.
fn without_held_out_runs(kind: Kind, name: &str) -> TempDir {
    let mut case = case(kind, name, 12.0);
    case.truth.runs.truncate(2);
    case.truth.runs.iter_mut().for_each(|run| run.role = "fit".to_owned());
    played(&case)
}

/// Without a held-out run the last third of every run is held out, and the answer is the same.
#[test]
fn without_a_held_out_run_the_last_parts_are_held_out() {
    let folder = without_held_out_runs(Kind::Hidden, "servo_pendulum-0-stribeck");
    let diagnosis = diagnosed(folder.path());
    assert!(has_note(&diagnosis, "last_part_held_out"), "{}", diagnosis["typed_notes"]);
    assert_eq!(diagnosis["verdict"], "missing_effect", "{diagnosis:#}");
    let ranking = diagnosis["ranking"].as_array().unwrap();
    let first = &ranking[0];
    assert_eq!((&first["effect"], &first["joint"]), (&"stribeck".into(), &0.into()), "{diagnosis:#}");
    let floor = dynid_plant::hidden::noise_floor();
    assert!(first["rmse_validate_after"].as_f64().unwrap() < 1.2 * floor, "{diagnosis:#}");
    assert!(first["rmse_validate_before"].as_f64().unwrap() > 10.0 * floor, "{diagnosis:#}");
}

/// Nothing is found in parts of runs of a machine that lacks nothing.
#[test]
fn parts_find_nothing_where_nothing_is_missing() {
    let folder = without_held_out_runs(Kind::Nothing, "servo_pendulum-0-coulomb");
    let diagnosis = diagnosed(folder.path());
    assert_eq!(diagnosis["verdict"], "nothing_missing", "{diagnosis:#}");
    assert!(has_note(&diagnosis, "last_part_held_out"), "{}", diagnosis["typed_notes"]);
    let ratio = diagnosis["worst_ratio"].as_f64().unwrap();
    assert!((0.9..1.2).contains(&ratio), "{ratio}");
}

/// The library's own answer about the files of a folder.
pub fn answer(
    folder: &Path,
    options: &Options,
    finished: &Finished,
    tell: &(dyn Fn(&Event<'_>) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Diagnosis, DiagnoseError> {
    let experiment = Experiment::read_with(&folder.join("experiment.toml"), dynid_model::devices()).unwrap();
    let model = Model::load(folder.join("believed.toml")).unwrap();
    let runs: Vec<&Run> = experiment.runs.iter().collect();
    diagnose(&model, &runs, options, finished, tell, stop)
}

/// Cables were laid anew after the first run: the spring is stiffer in the other two. No effect is missing.
#[test]
fn what_moved_between_runs_is_distinguished_from_what_is_missing() {
    let case = case(Kind::Nothing, "freedom6s-5-coulomb", 8.0);
    let folder = played(&case);
    let mut later = case.truth.clone();
    let spring = later.effects.iter_mut().find(|entry| entry.id == "spring" && entry.joint == 5).unwrap();
    *spring.values.get_mut("Ks").unwrap() *= 1.3;
    let files = recipe::make(&later, dynid_model::device("freedom6s").unwrap()).unwrap();
    for run in &later.runs[1..] {
        fs::write(folder.path().join(&run.file), &files[&run.file]).unwrap();
    }
    let options = Options::default();
    let found = answer(folder.path(), &options, &Finished::new(), &|_| (), &|| false).unwrap();
    assert_eq!(found.verdict, Verdict::NothingMissing, "{:#?}", found.statements);
    let most = found.moved.first().expect("something moved");
    assert_eq!((most.parameter.as_str(), most.run.as_str()), ("joint.5.spring.Ks", later.runs[0].file.as_str()));
    // The others' value is larger.
    assert!(most.change_in_std_errors < -10.0, "{most:?}");
    assert!(found.statements.contains(&Statement::ValuesMoved { most: most.clone() }), "{:#?}", found.statements);
}

/// A machine whose second link lacks an effect, in two runs, both to be fitted to.
pub fn arm(effects: &str, runs: &str) -> TempDir {
    let text = format!(
        "device = \"planar2r\"\nseed = 11\nsample_s = 0.01\nsteps_per_sample = 20\nnoise_rms = 1e-4\nquantum = 1e-5\nstart = \
         [-1.5707963267948966, 0.0]\n{effects}{runs}"
    );
    let recipe: Recipe = toml::from_str(&text).unwrap();
    let folder = TempDir::new().unwrap();
    for (name, text) in recipe::make(&recipe, dynid_model::device("planar2r").unwrap()).unwrap() {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

pub const VISCOUS: &str =
    "[[effect]]\nid = \"viscous\"\njoint = 0\nFv = 0.6\n[[effect]]\nid = \"viscous\"\njoint = 1\nFv = 0.15\n";
pub const SWINGS: &str = "[[run]]\nfile = \"one.csv\"\nfree = [1]\nrole = \"fit\"\nduration_s = 6.0\n\
                      torque = [{ joint = 1, amplitude = 0.9, hz = 0.4 }, { joint = 1, amplitude = 0.5, hz = 1.3 }]\n\
                      [[run]]\nfile = \"two.csv\"\nfree = [1]\nrole = \"fit\"\nduration_s = 6.0\n\
                      torque = [{ joint = 1, amplitude = 0.8, hz = 0.7 }, { joint = 1, amplitude = 0.4, hz = 1.9 }]\n";

/// A machine whose second joint has Stribeck's friction, which the model that is beside its runs lacks.
pub fn arm_without_its_friction() -> TempDir {
    let stribeck = "[[effect]]\nid = \"stribeck\"\njoint = 1\nFc = 0.1\nFs = 0.2\nvs = 0.1\nv_eps = 0.01\n";
    let folder = arm(&format!("[parameters]\n{VISCOUS}{stribeck}"), SWINGS);
    let experiment = fs::read_to_string(folder.path().join("experiment.toml")).unwrap();
    let held_out = experiment.replacen("role = \"fit\"", "role = \"validate\"", 1);
    assert_ne!(experiment, held_out);
    fs::write(folder.path().join("experiment.toml"), held_out).unwrap();
    fs::write(folder.path().join("believed.toml"), format!("device = \"planar2r\"\n{VISCOUS}")).unwrap();
    folder
}

fn json(found: &Diagnosis) -> String {
    serde_json::to_string_pretty(found).unwrap()
}

/// Stopped while candidates are compared and gone on with from its checkpoint's text, a diagnosis ends at the same answer, without
/// doing again what was done.
#[test]
fn a_diagnosis_that_was_stopped_goes_on() {
    let folder = arm_without_its_friction();
    let searched: Mutex<Vec<String>> = Mutex::default();
    let hear = |event: &Event<'_>| {
        if let Event::Searched(key, _) = event {
            searched.lock().unwrap().push((*key).to_owned());
        }
    };
    let whole = answer(folder.path(), &Options::default(), &Finished::new(), &hear, &|| false).unwrap();
    assert_eq!(whole.verdict, Verdict::MissingEffect, "{:#?}", whole.statements);
    let mut all = std::mem::take(&mut *searched.lock().unwrap());
    all.sort();
    let n_all = all.len();
    all.dedup();
    assert_eq!(all.len(), n_all, "every search has a key of its own");

    let kept: Mutex<Finished> = Mutex::default();
    let asked = AtomicBool::new(false);
    let keep = |event: &Event<'_>| {
        if let Event::Searched(key, state) = event {
            kept.lock().unwrap().insert((*key).to_owned(), (*state).clone());
            asked.fetch_or(key.contains(" > "), Ordering::SeqCst);
        }
    };
    let stopped = answer(folder.path(), &Options::default(), &Finished::new(), &keep, &|| asked.load(Ordering::SeqCst));
    assert!(stopped.is_err(), "it was asked to stop");
    let kept = kept.into_inner().unwrap();
    assert!((2..n_all).contains(&kept.len()), "{} of {n_all} searches were done", kept.len());
    // As the checkpoint keeps them.
    let text = toml::to_string(&BTreeMap::from([("fits", &kept)])).unwrap();
    let mut read: BTreeMap<String, Finished> = toml::from_str(&text).unwrap();
    let finished = read.remove("fits").unwrap();
    let again = answer(folder.path(), &Options::default(), &finished, &hear, &|| false).unwrap();
    assert_eq!(json(&again), json(&whole));
}

/// At any number of threads a diagnosis ends at the same answer.
#[test]
fn a_diagnosis_does_not_change_with_the_threads() {
    let folder = arm_without_its_friction();
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            json(&answer(folder.path(), &Options::default(), &Finished::new(), &|_| (), &|| false).unwrap())
        })
    };
    assert_eq!(with_threads(1), with_threads(3));
}

/// Where an error is asked for, the model is trusted as that error does, and what is missing is the same.
#[test]
fn an_error_that_is_asked_for_finds_the_same() {
    let folder = arm_without_its_friction();
    for error in [ErrorSignal::Position, ErrorSignal::Torque] {
        let options = Options { error: Some(error), ..Options::default() };
        let found = answer(folder.path(), &options, &Finished::new(), &|_| (), &|| false).unwrap();
        assert_eq!(found.error, error.to_string());
        let ranking: Vec<_> = found.ranking.iter().map(|own| (own.candidate.to_string(), own.delta_bic)).collect();
        assert_eq!(ranking[0].0, "`stribeck` at joint 1", "{error}: {ranking:?}");
    }
}

/// A body joins the last link, which both joints move: it is considered once, unless one that is known is held at its values.
#[test]
fn a_body_is_considered_once_a_link() {
    let hanging = "[[run]]\nfile = \"three.csv\"\nfree = [0]\nrole = \"fit\"\nduration_s = 1.0\ntorque = []\n";
    let folder = arm(&format!("[parameters]\n{VISCOUS}"), &format!("{SWINGS}{hanging}"));
    let experiment = Experiment::read_with(&folder.path().join("experiment.toml"), dynid_model::devices()).unwrap();
    let runs: Vec<&Run> = experiment.runs.iter().collect();
    let places = |model: &Model, effect: &str| -> Vec<Option<usize>> {
        let all = candidates(model, &runs).into_iter();
        all.filter(|candidate| candidate.effect == effect).map(|candidate| candidate.joint).collect()
    };
    let mut model = Model::of_device(dynid_model::device("planar2r").unwrap());
    assert_eq!(places(&model, "payload"), [Some(0)]);
    assert_eq!(places(&model, "rotor_inertia"), [Some(0), Some(1)], "a rotor is its joint's own");
    model.add_effect("payload", Some(1), None).unwrap();
    assert_eq!(places(&model, "payload"), []);
    for symbol in ["m", "x", "y", "z"] {
        let name = format!("joint.1.payload.{symbol}");
        let own = model.parameter(&name).unwrap();
        model.set(&name, Parameter { fixed: true, ..own }).unwrap();
    }
    assert_eq!(places(&model, "payload"), [Some(0)], "beside one that is known there may be another");
}

/// Of a joint that is free but hangs still the logs tell nothing, and which of its parameters that concerns is said.
#[test]
fn what_the_runs_leave_open_is_named() {
    let hanging = |file: &str, joint: usize, role: &str| {
        format!("[[run]]\nfile = \"{file}\"\nfree = [{joint}]\nrole = \"{role}\"\nduration_s = 6.0\ntorque = []\n")
    };
    let hanging =
        [hanging("three.csv", 0, "validate"), hanging("four.csv", 0, "fit"), hanging("five.csv", 1, "fit")].concat();
    let folder = arm(&format!("[parameters]\n{VISCOUS}"), &format!("{SWINGS}{hanging}"));
    let coulomb = "[[effect]]\nid = \"coulomb\"\njoint = 0\nFc = 0.1\n";
    fs::write(folder.path().join("believed.toml"), format!("device = \"planar2r\"\n{VISCOUS}{coulomb}")).unwrap();
    let options = Options::default();
    let found = answer(folder.path(), &options, &Finished::new(), &|_| (), &|| false).unwrap();
    let still = Note::StandsStill {
        run: "five.csv".to_owned(),
        joint: 1,
        range_in_noises: 10.0,
        parameters: vec!["joint.1.viscous.Fv".to_owned()],
    };
    assert!(found.notes.contains(&still), "{:#?}", found.notes);
    let open = found.notes.iter().find_map(|note| match note {
        Note::NotDetermined { parameters, links, joints, still, .. } => Some((parameters, links, joints, still)),
        _ => None,
    });
    let (parameters, links, joints, still) = open.expect("some parameters are left open");
    assert_eq!(*parameters, ["joint.0.viscous.Fv", "joint.0.coulomb.Fc"]);
    assert!(*links > 0, "nor those of links");
    assert_eq!((joints.as_slice(), still.as_slice()), (&[0][..], &[0][..]));
}

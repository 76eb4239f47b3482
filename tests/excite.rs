//! `dynid excite` as a user runs it: what it writes, that a simulation plays it, and what it refuses.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;
use tempfile::TempDir;

fn dynid(folder: &Path, arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("dynid").unwrap().current_dir(folder).args(arguments).assert()
}

fn json(folder: &Path, arguments: &[&str]) -> Value {
    let arguments = [arguments, &["--json"]].concat();
    serde_json::from_slice(&dynid(folder, &arguments).success().get_output().stdout).unwrap()
}

/// Header and columns of a log.
fn columns(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let header: Vec<String> = lines.next().unwrap().split(',').map(str::to_owned).collect();
    let mut columns = vec![Vec::new(); header.len()];
    for line in lines {
        for (column, cell) in columns.iter_mut().zip(line.split(',')) {
            column.push(cell.parse().unwrap());
        }
    }
    (header, columns)
}

#[test]
fn inputs_of_the_thesis_are_played_by_name() {
    let folder = TempDir::new().unwrap();
    let list = json(folder.path(), &["excite", "freedom6s", "--list"]);
    assert_eq!(list["inputs"].as_array().unwrap().len(), 48);
    let name = "table-4.7-configuration-1";
    let message = json(folder.path(), &["excite", "freedom6s", "--input", name, "--out", "run.csv"]);
    assert_eq!(message["free"], serde_json::json!([4, 5]));
    let (header, columns) = columns(&folder.path().join("run.csv"));
    assert_eq!(header, ["t", "tau0", "tau1", "tau2", "tau3", "tau4", "tau5"]);
    assert_eq!(columns[0].len(), 6001);
    assert!(columns[1..5].iter().flatten().all(|torque| *torque == 0.0));
    for (k, t) in columns[0].iter().enumerate() {
        let expected = (0.0055 - 0.003 / 60.0 * t) * ((0.5 + 2.0 / 60.0 * t) * t).cos();
        assert!((columns[6][k] - expected).abs() < 1e-9, "{t} s");
    }
}

/// Planned, then simulated, before any robot moves: the motion is the one that was planned with.
#[test]
fn a_planned_run_can_be_simulated() {
    let folder = TempDir::new().unwrap();
    let path = folder.path();
    let excite = "excite planar2r --free 0,1 --signal optimised --position-limits=-2:-1,-0.5:0.5 --as torque --period 2 \
                  --rate 500 --evaluations 100 --out run.csv --picture run.svg";
    let message = json(path, &excite.split_whitespace().collect::<Vec<_>>());
    assert!(fs::read_to_string(path.join("run.svg")).unwrap().contains("joint 1: torque"));
    let start: Vec<f64> = message["start"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    let experiment = format!(
        "device = \"planar2r\"\n\n[[run]]\nfile = \"run.csv\"\nfree = [0, 1]\nrole = \"validate\"\nstart = {start:?}\nhold = \"linear\"\n"
    );
    fs::write(path.join("experiment.toml"), &experiment).unwrap();
    let simulated = json(path, &["simulate", "experiment.toml", "--out-dir", "simulated", "--substeps", "10"]);
    assert_eq!(simulated["runs"][0]["joints"][0]["rmse"], Value::Null, "nothing to compare with");
    let (header, motion) = columns(&path.join("simulated/run.csv"));
    assert_eq!(header, ["t", "tau0", "tau1", "q0", "q1"]);
    let moved = |column: usize| {
        let bounds = motion[column].iter().fold((f64::MAX, f64::MIN), |(low, high), q| (low.min(*q), high.max(*q)));
        bounds.1 - bounds.0
    };
    assert!(moved(3) > 0.3 && moved(4) > 0.3, "{} {}", moved(3), moved(4));
    for (joint, [low, high]) in [[-2.0, -1.0], [-0.5, 0.5]].into_iter().enumerate() {
        let q = &motion[3 + joint];
        assert!(q.iter().all(|q| (low - 1e-3..high + 1e-3).contains(q)), "joint {joint}");
        assert!((q[0] - start[joint]).abs() < 1e-12 && (q[q.len() - 1] - q[0]).abs() < 1e-3, "it comes back");
    }

    // nothing was measured, so nothing is fitted or compared
    for verb in [&["compare", "experiment.toml"][..], &["fit", "experiment.toml", "--out", "fitted.toml"]] {
        let output = dynid(path, verb).code(2).get_output().stderr.clone();
        let message = String::from_utf8(output).unwrap();
        assert!(message.contains("experiment.toml:7:9") && message.contains("only planned"), "{message}");
    }
    let short = experiment.replace(&format!("{start:?}"), "[0.0]");
    fs::write(path.join("experiment.toml"), short).unwrap();
    let output =
        dynid(path, &["simulate", "experiment.toml", "--out-dir", "again"]).code(2).get_output().stderr.clone();
    assert!(String::from_utf8(output).unwrap().contains("found 1 positions"));
}

/// References of a closed-loop run need no torques.
#[test]
fn references_are_followed_by_a_controller() {
    let folder = TempDir::new().unwrap();
    let path = folder.path();
    let excite = "excite planar2r --free 1 --signal multisine --to 1 --amplitude 0.3 --as reference --duration 5 \
                  --pose=-1.5,0.2 --out run.csv";
    let message = json(path, &excite.split_whitespace().collect::<Vec<_>>());
    assert_eq!(message["quantity"], "positions");
    fs::write(path.join("controller.toml"), "P = [0, 20]\nD = [0, 1]\ncutoff_hz = 20\n").unwrap();
    let experiment = format!(
        "device = \"planar2r\"\n[[run]]\nfile = \"run.csv\"\nfree = [1]\nrole = \"validate\"\nstart = {}\ncontroller = \"controller.toml\"\n",
        message["start"]
    );
    fs::write(path.join("experiment.toml"), experiment).unwrap();
    json(path, &["simulate", "experiment.toml", "--out-dir", "simulated"]);
    let (_, motion) = columns(&path.join("simulated/run.csv"));
    assert!(motion[2].iter().any(|torque| torque.abs() > 0.01), "the controller commands");
}

/// Same input, same bits, any number of threads; another seed, another motion.
#[test]
fn a_seed_gives_one_motion() {
    let folder = TempDir::new().unwrap();
    let run = |threads: &str, seed: &str, out: &str| {
        let arguments = format!(
            "excite planar2r --free 0,1 --signal optimised --period 5 --harmonics 3 --evaluations 60 --seed {seed} --out {out}"
        );
        let mut command = Command::cargo_bin("dynid").unwrap();
        command.current_dir(folder.path()).env("RAYON_NUM_THREADS", threads);
        command.args(arguments.split_whitespace()).assert().success();
        fs::read(folder.path().join(out)).unwrap()
    };
    let one = run("1", "1", "one.csv");
    assert_eq!(one, run("3", "1", "three.csv"));
    assert_ne!(one, run("1", "2", "other.csv"));
}

#[test]
fn what_cannot_be_played_is_reported_and_nothing_is_written() {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join("mine.csv"), "mine\n").unwrap();
    let refused = [
        "freedom6s --input table-4.7-configuration3 --out run.csv",
        "planar2r --input table-1 --out run.csv",
        "freedom6s --free 0,7 --signal cosine --frequency 1 --amplitude 1 --out run.csv",
        "planar2r --free 0 --signal cosine --frequency 1 --amplitude 1 --duration -5 --out run.csv",
        "planar2r --free 0 --signal chirp --from 1 --to 60 --amplitude 1 --out run.csv",
        "planar2r --free 0 --signal optimised --period 0.05 --out run.csv",
        "freedom6s --input table-4.5 --rate 0.2 --out run.csv",
        "planar2r --free 0,1 --signal optimised --torque-limit 0.001 --out run.csv",
        "planar2r --free 0,1 --signal cosine --frequency 1 --amplitude 9 --torque-limit 5 --out run.csv",
        "planar2r --free 0,1 --signal cosine --frequency 1 --amplitude 9 --as reference --out run.csv",
        "planar2r --free 0,1 --signal cosine --frequency 1 --amplitude 1,2,3 --out run.csv",
        "planar2r --free 0,1 --signal optimised --position-limits=1:-1 --out run.csv",
        "planar2r --free 0,1 --signal optimised --harmonics 1 --out run.csv",
        "planar2r --free 0,1 --signal cosine --frequency 1 --amplitude 0.1 --out mine.csv",
        "planar2r --free 0,1 --out run.csv",
        "planar2r --free 0 --signal cosine --frequency 1 --amplitude 1 --duration 1e12 --out run.csv",
        "planar2r --free 0 --signal cosine --frequency 1 --amplitude 1 --out run.csv --picture run.csv",
    ];
    let message = refused.map(|arguments| {
        let arguments: Vec<&str> = std::iter::once("excite").chain(arguments.split_whitespace()).collect();
        let output = dynid(folder.path(), &arguments).code(2).get_output().clone();
        assert!(output.stdout.is_empty(), "{arguments:?}");
        let error = String::from_utf8(output.stderr).unwrap();
        let first = error.lines().next().unwrap_or_default().to_owned();
        format!("{}\n  {first}\n", arguments.join(" "))
    });
    insta::assert_snapshot!(message.concat());
    assert_eq!(fs::read_to_string(folder.path().join("mine.csv")).unwrap(), "mine\n");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// A command in volts is limited by what makes the device's largest torque, 0.52 N*m: 2 V at 0.26 N*m/V.
#[test]
fn a_limit_of_torque_is_none_of_voltage() {
    let folder = TempDir::new().unwrap();
    let model = "device = \"servo_pendulum\"\n[[effect]]\nid = \"gain\"\njoint = 0\nKp = 0.26\n";
    fs::write(folder.path().join("model.toml"), model).unwrap();
    let excite = |amplitude: &str| {
        let words = "excite servo_pendulum --model model.toml --free 0 --signal cosine --frequency 1 --duration 2 --out run.csv --amplitude";
        dynid(folder.path(), &words.split_whitespace().chain([amplitude]).collect::<Vec<_>>())
    };
    let message = String::from_utf8(excite("2.1").code(2).get_output().stderr.clone()).unwrap();
    assert!(message.contains("2.0"), "{message}");
    excite("1.9").success();
}

/// The torques that tell a spring that stiffens from a straight one: the ratio is that of two simulations.
#[test]
fn two_models_are_told_apart() {
    let folder = TempDir::new().unwrap();
    let path = folder.path();
    let straight = "device = \"oscillator\"\n[link.1]\nm = { value = 8e-4, fixed = true }\n[[effect]]\nid = \"gain\"\njoint = 0\n\
                    [[effect]]\nid = \"viscous\"\njoint = 0\nFv = { value = 0.006, fixed = true }\n[[effect]]\nid = \"spring\"\n\
                    joint = 0\nKs = { value = 1.0, fixed = true }\nqeq = { value = 0.0, fixed = true }\n";
    let cubic = format!("{straight}[[effect]]\nid = \"spring_cubic\"\njoint = 0\nK3 = 50.0\n");
    fs::write(path.join("straight.toml"), straight).unwrap();
    fs::write(path.join("cubic.toml"), cubic).unwrap();
    let excite = "excite --between cubic.toml straight.toml --free 0 --position-limits=-0.05:0.05 --torque-limit 0.1 \
                  --position-noise 1e-4 --period 2 --harmonics 3 --evaluations 60 --out run.csv";
    let message = json(path, &excite.split_whitespace().collect::<Vec<_>>());
    let said = &message["between"];
    assert_eq!(said["models"], serde_json::json!(["cubic.toml", "straight.toml"]));
    let experiment =
        "device = \"oscillator\"\n[[run]]\nfile = \"run.csv\"\nfree = [0]\nrole = \"validate\"\nstart = [0.0]\n";
    fs::write(path.join("experiment.toml"), experiment).unwrap();
    let played = |model: &str| {
        let (file, out) = (format!("{model}.toml"), format!("of-{model}"));
        json(path, &["simulate", "experiment.toml", "--model", &file, "--out-dir", &out]);
        columns(&path.join(out).join("run.csv")).1.swap_remove(2)
    };
    let (a, b) = (played("cubic"), played("straight"));
    assert!(a.iter().chain(&b).all(|q| q.abs() < 0.0501), "within the limits of position");
    let ratio = 0.5 * a.iter().zip(&b).map(|(a, b)| ((a - b) / 1e-4).powi(2)).sum::<f64>();
    let as_given = said["as_given"].as_f64().unwrap();
    assert!((as_given / ratio - 1.0).abs() < 1e-3, "{as_given} {ratio}");
    // Only where it starts is unknown.
    assert_eq!(said["absorbing"], 1);
    let left = said["expected_log_likelihood_ratio"].as_f64().unwrap();
    assert!(left > 100.0 && left <= as_given, "{left} {as_given}");
    let output = dynid(path, &["excite", "--between", "cubic.toml", "cubic.toml", "--free", "0", "--out", "no.csv"]);
    let message = String::from_utf8(output.code(2).get_output().stderr.clone()).unwrap();
    assert!(message.contains("limits neither of torque nor of position"), "{message}");
}

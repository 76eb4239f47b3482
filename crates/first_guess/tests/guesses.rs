//! Guesses against logs that the plant makes, in many headers and units: what was done to a log is what must be guessed.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

use dynid_check::FindingKind;
use dynid_first_guess::{
    Factor, FactorReason, FirstGuess, FirstGuessError, Known, Quantity, Remark, RoleReason, WhyColumn, first_guess,
};
use dynid_logs::experiment::Role;
use dynid_model::Device;
use tempfile::TempDir;

const DEVICE: &str = "planar2r";

/// A two-link arm that hangs and is shaken; `CLOSED` instead follows references.
const RECIPE: &str = r#"
device = "planar2r"
seed = 42
sample_s = 0.01
steps_per_sample = 20
noise_rms = 1e-5
quantum = 0.0
start = [-1.5, 0.1]

[parameters]
"link.1.m" = 1.25
"link.2.m" = 0.84

[[effect]]
id = "viscous"
joint = 0
Fv = 0.067

[[effect]]
id = "coulomb"
joint = 0
Fc = 0.15
v_eps = 0.05

[[effect]]
id = "viscous"
joint = 1
Fv = 0.022

[[effect]]
id = "coulomb"
joint = 1
Fc = 0.07
v_eps = 0.05
"#;

const SHAKEN: &str = r#"
[[run]]
file = "shaken.csv"
free = [0, 1]
role = "fit"
duration_s = 20.0
torque = [
  { joint = 0, amplitude = 1.5, hz = 0.37 },
  { joint = 0, amplitude = 1.0, hz = 0.91, phase = 1.0 },
  { joint = 1, amplitude = 0.4, hz = 0.53, phase = 0.3 },
  { joint = 1, amplitude = 0.3, hz = 1.37, phase = 2.0 },
]
"#;

const CHIRPED: &str = r#"
[[run]]
file = "chirped.csv"
free = [0, 1]
role = "validate"
duration_s = 10.0
torque = [
  { joint = 0, amplitude = 2.0, hz = 0.2, hz_per_s = 0.05 },
  { joint = 1, amplitude = 0.5, hz = 0.4, hz_per_s = 0.04, phase = 1.0 },
]
"#;

const ELBOW: &str = r#"
[[run]]
file = "elbow.csv"
free = [1]
role = "fit"
duration_s = 10.0
torque = [{ joint = 1, amplitude = 0.6, hz = 0.7 }, { joint = 1, amplitude = 0.4, hz = 1.9 }]
"#;

const CLOSED: &str = r#"
[controller]
proportional = [20.0, 5.0]
derivative = [1.5, 0.2]
smoothing = 0.5

[[run]]
file = "closed.csv"
free = [0, 1]
role = "fit"
duration_s = 20.0
reference = [
  { joint = 0, amplitude = 0.4, hz = 0.4 },
  { joint = 0, amplitude = 0.2, hz = 0.9 },
  { joint = 1, amplitude = 0.5, hz = 0.5 },
  { joint = 1, amplitude = 0.3, hz = 1.1 },
]
"#;

/// A log: names and columns.
#[derive(Clone)]
struct Log {
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
}

impl Log {
    fn rename(&mut self, names: &[(&str, &str)]) {
        for (from, to) in names {
            let place = self.place(from);
            self.names[place] = (*to).to_owned();
        }
    }

    fn place(&self, name: &str) -> usize {
        self.names.iter().position(|own| own == name).unwrap_or_else(|| panic!("{name} of {:?}", self.names))
    }

    fn change(&mut self, name: &str, change: impl FnMut(f64) -> f64) {
        let place = self.place(name);
        let values = self.columns[place].iter().copied().map(change).collect();
        self.columns[place] = values;
    }

    fn add(&mut self, name: &str, values: Vec<f64>) {
        self.names.push(name.to_owned());
        self.columns.push(values);
    }

    /// Central differences of a position: a speed column as a drive makes it.
    fn speed_of(&self, name: &str) -> Vec<f64> {
        let (t, q) = (&self.columns[self.place("t")], &self.columns[self.place(name)]);
        let last = t.len() - 1;
        (0..t.len())
            .map(|k| {
                let (from, to) = (k.saturating_sub(1), (k + 1).min(last));
                (q[to] - q[from]) / (t[to] - t[from])
            })
            .collect()
    }

    fn text(&self) -> String {
        let mut text = self.names.join(",") + "\n";
        for row in 0..self.columns[0].len() {
            let cells: Vec<String> = self.columns.iter().map(|column| column[row].to_string()).collect();
            text += &(cells.join(",") + "\n");
        }
        text
    }
}

fn device() -> &'static Device {
    dynid_model::device(DEVICE).expect("a shipped device")
}

/// The plant's logs of these runs, by file.
fn logs(runs: &[&str]) -> BTreeMap<String, Log> {
    let recipe = toml::from_str(&(RECIPE.to_owned() + &runs.concat())).expect("a recipe");
    let files = dynid_plant::recipe::make(&recipe, device()).expect("it can be played");
    let logs = files.into_iter().filter(|(name, _)| name.ends_with(".csv")).map(|(name, text)| {
        let mut lines = text.lines();
        let names: Vec<String> = lines.next().expect("a header").split(',').map(str::to_owned).collect();
        let mut columns = vec![Vec::new(); names.len()];
        for line in lines {
            for (column, cell) in columns.iter_mut().zip(line.split(',')) {
                column.push(cell.parse().expect("a number"));
            }
        }
        (name, Log { names, columns })
    });
    logs.collect()
}

fn shaken() -> Log {
    logs(&[SHAKEN])["shaken.csv"].clone()
}

fn guess_of_files(files: &[(&str, &str)], known: &Known) -> Result<FirstGuess, FirstGuessError> {
    let folder = TempDir::new().expect("a folder");
    let paths: Vec<PathBuf> = files.iter().map(|(name, _)| folder.path().join(name)).collect();
    for (path, (_, text)) in paths.iter().zip(files) {
        std::fs::write(path, text).expect("the folder is writable");
    }
    first_guess(device(), &paths, known)
}

fn guess(log: &Log) -> FirstGuess {
    guess_of_files(&[("log.csv", &log.text())], &Known::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// The error without the temporary folder.
fn refused(text: &str) -> String {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("log.csv");
    std::fs::write(&path, text).expect("the folder is writable");
    let error = first_guess(device(), &[path], &Known::default()).expect_err("it cannot be guessed");
    error.to_string().replace(&format!("{}/", folder.path().display()), "")
}

fn named(guess: &FirstGuess) -> Vec<(&str, &str)> {
    guess.columns.iter().map(|own| (own.logical.as_str(), own.name.as_str())).collect()
}

fn scale(guess: &FirstGuess, logical: &str) -> f64 {
    guess.column(logical).unwrap_or_else(|| panic!("no {logical}")).scale()
}

#[test]
fn a_log_in_the_projects_own_words_needs_nothing() {
    let guess = guess(&shaken());
    assert_eq!(named(&guess), [("t", "t"), ("q0", "q0"), ("q1", "q1"), ("tau0", "tau0"), ("tau1", "tau1")]);
    assert!(guess.columns.iter().all(|own| own.factors.is_empty() && own.why == WhyColumn::OwnName));
    assert_eq!(guess.findings, []);
    assert_eq!(guess.remarks, [Remark::OpenLoop]);
    assert!(!guess.is_straight && !guess.repeats_times && guess.mask.is_none());
    assert!(guess.runs.iter().all(|run| run.free == [0, 1]));
}

#[test]
fn foreign_headers_are_understood_in_any_order() {
    let headers: [[&str; 5]; 7] = [
        [
            "time",
            "/joint_states/position[0]",
            "/joint_states/position[1]",
            "/joint_states/effort[0]",
            "/joint_states/effort[1]",
        ],
        ["timestamp", "position_0", "position_1", "torque_0", "torque_1"],
        ["Time (s)", "q_1", "q_2", "tau_1", "tau_2"],
        ["t", "pos.joint1", "pos.joint2", "eff.joint1_torque", "eff.joint2_torque"],
        ["elapsed", "shoulder_pos", "elbow_pos", "shoulder_effort", "elbow_effort"],
        ["timestamp", "actual_q_0", "actual_q_1", "target_moment_0", "target_moment_1"],
        ["Time [s]", "Axis1.ActPos", "Axis2.ActPos", "Axis1.ActTorque", "Axis2.ActTorque"],
    ];
    let own = shaken();
    for header in headers {
        for order in [[0, 1, 2, 3, 4], [4, 3, 2, 1, 0], [2, 4, 1, 0, 3]] {
            let mut log = own.clone();
            log.rename(&["t", "q0", "q1", "tau0", "tau1"].into_iter().zip(header).collect::<Vec<_>>());
            let places = order.map(|place| log.place(header[place]));
            let log = Log {
                names: places.map(|place| log.names[place].clone()).to_vec(),
                columns: places.map(|place| log.columns[place].clone()).to_vec(),
            };
            let guess = guess(&log);
            let expected: Vec<(&str, &str)> = ["t", "q0", "q1", "tau0", "tau1"].into_iter().zip(header).collect();
            assert_eq!(named(&guess), expected);
            assert!(guess.columns.iter().all(|own| own.scale() == 1.0), "{header:?}: {:?}", guess.columns);
        }
    }
}

#[test]
fn degrees_are_told_by_the_motion_and_by_the_name() {
    let mut log = shaken();
    log.change("q0", f64::to_degrees);
    log.change("q1", f64::to_degrees);
    let by_motion = guess(&log);
    for joint in ["q0", "q1"] {
        let own = by_motion.column(joint).expect("a position");
        assert!((own.scale() - PI / 180.0).abs() < 1e-12, "{own:?}");
        assert!(
            matches!(own.factors[0].reason, FactorReason::Finding { finding: FindingKind::Degrees { .. } }),
            "{own:?}"
        );
    }
    log.rename(&[("q0", "q0 [deg]"), ("q1", "q1 [deg]")]);
    let by_name = guess(&log);
    assert_eq!(
        by_name.column("q0").map(|own| own.factors[0].reason.clone()),
        Some(FactorReason::UnitInName { unit: "degrees" })
    );
    assert_eq!(by_name.findings, []);
}

#[test]
fn a_speed_beside_the_position_tells_degrees_and_the_unit_of_time() {
    for (unit, factor) in [(1.0, 1.0), (1e3, 1e-3), (1e6, 1e-6), (1e9, 1e-9)] {
        let mut log = shaken();
        let speeds = [log.speed_of("q0"), log.speed_of("q1")];
        for (joint, speed) in speeds.into_iter().enumerate() {
            log.change(&format!("q{joint}"), f64::to_degrees);
            log.add(&format!("qd{joint}"), speed);
        }
        log.change("t", |t| unit * (t + 1000.0));
        let guess = guess(&log);
        assert_eq!(scale(&guess, "t"), factor);
        assert!((scale(&guess, "q1") - PI / 180.0).abs() < 1e-12);
        assert!(matches!(guess.column("q1").unwrap().factors[0].reason, FactorReason::Speed { .. }));
        assert_eq!(guess.unused, ["qd0", "qd1"]);
    }
}

#[test]
fn speeds_of_exchanged_joints_are_told() {
    let mut log = shaken();
    let (first, second) = (log.speed_of("q0"), log.speed_of("q1"));
    log.add("qd0", second);
    log.add("qd1", first.into_iter().map(|speed| -speed).collect());
    let guess = guess(&log);
    let exchanged = Remark::SpeedOfOtherJoint { column: "qd0".to_owned(), joint: 0, fits: 1 };
    assert!(guess.remarks.contains(&exchanged), "{:?}", guess.remarks);
}

#[test]
fn the_unit_of_time_is_told_by_the_sample_rate() {
    for (name, unit, factor) in
        [("time", 1e3, 1e-3), ("stamp", 1e6, 1e-6), ("timestamp", 1e9, 1e-9), ("t_ms", 1e3, 1e-3)]
    {
        let mut log = shaken();
        log.change("t", |t| (unit * (t + 100.0)).round());
        log.rename(&[("t", name)]);
        let guess = guess(&log);
        assert_eq!(scale(&guess, "t"), factor, "{name}");
        let is_by_name = matches!(guess.columns[0].factors[0].reason, FactorReason::UnitInName { .. });
        assert_eq!(is_by_name, name == "t_ms");
    }
}

#[test]
fn a_torque_of_wrong_sign_or_in_thousandths_is_put_right() {
    let mut log = shaken();
    log.change("tau1", |tau| -tau);
    let flipped = guess(&log);
    assert_eq!((scale(&flipped, "tau0"), scale(&flipped, "tau1")), (1.0, -1.0));
    assert_eq!(flipped.findings, []);

    let mut log = shaken();
    log.change("tau0", |tau| 1000.0 * tau);
    log.change("tau1", |tau| -1000.0 * tau);
    log.change("q0", f64::to_degrees);
    log.change("q1", f64::to_degrees);
    let both = guess(&log);
    assert_eq!((scale(&both, "tau0"), scale(&both, "tau1")), (1e-3, -1e-3));
    assert!((scale(&both, "q0") - PI / 180.0).abs() < 1e-12);
    assert_eq!(both.findings, []);
}

#[test]
fn a_current_gets_the_factor_that_the_motion_needs() {
    let mut log = shaken();
    log.change("tau0", |tau| tau / 2.5);
    log.change("tau1", |tau| tau / -1.2);
    log.rename(&[("tau0", "actual_current_0"), ("tau1", "actual_current_1")]);
    let guess = guess(&log);
    for (logical, constant) in [("tau0", 2.5), ("tau1", -1.2)] {
        let own = guess.column(logical).expect("a torque");
        // The device's values are 5 % off, and friction is in it.
        assert!((own.scale() / constant - 1.0).abs() < 0.2, "{own:?}");
        assert!(matches!(own.factors[0].reason, FactorReason::Needed { quantity: Quantity::Current, .. }), "{own:?}");
    }
}

#[test]
fn encoders_that_begin_anew_are_put_together() {
    let wrap = |turn: f64, counts: bool| {
        move |q: f64| {
            let own = (q + PI).rem_euclid(TAU) / TAU * turn;
            if counts { own.floor() } else { own }
        }
    };
    for (turn, counts) in [(TAU, false), (360.0, false), (16384.0, true)] {
        let mut log = shaken();
        log.change("q0", |q| q - 1.6);
        log.change("q0", wrap(turn, counts));
        if turn == 360.0 {
            log.change("q1", f64::to_degrees);
        }
        let guess = guess(&log);
        let own = guess.column("q0").expect("a position");
        assert_eq!(own.turn, Some(turn));
        assert!((own.scale() - TAU / turn).abs() < 1e-12, "{own:?}");
        assert!((scale(&guess, "q1") - if turn == 360.0 { PI / 180.0 } else { 1.0 }).abs() < 1e-12);
        let wraps = |own: &dynid_check::Finding| matches!(own.kind, FindingKind::EncoderWrap { .. });
        assert!(!guess.findings.iter().any(wraps), "{:?}", guess.findings);
    }
}

#[test]
fn repeated_stamps_are_left_out_and_counted() {
    let mut log = shaken();
    for column in &mut log.columns {
        let row = column[500];
        column.insert(500, row);
    }
    let guess = guess(&log);
    assert!(guess.repeats_times);
    let count = guess.remarks.iter().find_map(|remark| match remark {
        Remark::RepeatedTimes { count, .. } => Some(*count),
        _ => None,
    });
    assert_eq!(count, Some(1));
}

#[test]
fn a_saturated_torque_is_said() {
    let mut log = shaken();
    log.change("tau0", |tau| tau.clamp(-1.2, 1.2));
    let guess = guess(&log);
    let is_said = |own: &dynid_check::Finding| {
        own.joint == Some(0) && matches!(&own.kind, FindingKind::Saturated { levels, .. } if *levels == [-1.2, 1.2])
    };
    assert!(guess.findings.iter().any(is_said), "{:?}", guess.findings);
}

#[test]
fn a_reference_that_is_followed_is_a_closed_loop() {
    let closed = logs(&[CLOSED])["closed.csv"].clone();
    let guess = guess(&closed);
    assert!(guess.column("ref0").is_some() && guess.column("ref1").is_some(), "{:?}", named(&guess));
    assert!(matches!(guess.remarks[0], Remark::ClosedLoop { correlation } if correlation > 0.5), "{:?}", guess.remarks);

    // A reference that nothing follows, and a command without a quantity: what is played is the torque.
    let mut log = shaken();
    log.rename(&[("tau0", "cmd_0"), ("tau1", "cmd_1")]);
    let open = self::guess(&log);
    assert_eq!(
        open.column("tau1").map(|own| (own.name.as_str(), &own.why)),
        Some(("cmd_1", &WhyColumn::IsNotFollowed))
    );
    assert!(open.remarks.contains(&Remark::OpenLoop));
}

#[test]
fn joints_that_stand_are_locked_and_the_last_run_with_the_same_joints_is_held_out() {
    let logs = logs(&[SHAKEN, CHIRPED, ELBOW]);
    let texts: Vec<(&str, String)> =
        ["shaken.csv", "chirped.csv", "elbow.csv"].into_iter().map(|name| (name, logs[name].text())).collect();
    let files: Vec<(&str, &str)> = texts.iter().map(|(name, text)| (*name, text.as_str())).collect();
    let guess = guess_of_files(&files, &Known::default()).expect("good logs");
    let said: Vec<(&[usize], Role)> = guess.runs.iter().map(|run| (run.free.as_slice(), run.role)).collect();
    assert_eq!(said, [(&[0, 1][..], Role::Fit), (&[0, 1], Role::Validate), (&[1], Role::Fit)]);

    let two = guess_of_files(&[files[2], files[0]], &Known::default()).expect("good logs");
    let roles: Vec<Role> = two.runs.iter().map(|run| run.role).collect();
    assert_eq!(roles, [Role::Validate, Role::Fit], "no other run moves the shoulder");

    let named = [("arm-test.csv", files[0].1), ("arm-train.csv", files[1].1)];
    let guess = guess_of_files(&named, &Known::default()).expect("good logs");
    assert_eq!(guess.runs[0].role, Role::Validate);
    assert!(matches!(guess.runs[0].why, RoleReason::Name { .. }));
}

#[test]
fn of_a_single_log_the_last_quarter_is_held_out_and_begins_in_motion() {
    let log = shaken();
    let guess = guess(&log);
    let n_rows = log.columns[0].len();
    let [fit, held_out] = &guess.runs[..] else { panic!("{:?}", guess.runs) };
    assert_eq!((fit.rows, held_out.rows), (Some([0, n_rows - n_rows / 4]), Some([n_rows - n_rows / 4, n_rows])));
    assert!(!fit.moving && held_out.moving && held_out.role == Role::Validate);
}

#[test]
fn what_a_person_says_goes_first() {
    let mut log = shaken();
    log.rename(&[("tau0", "a"), ("tau1", "b")]);
    let text = log.text();
    let said = |pairs: &[(&str, &str)]| Known {
        columns: pairs.iter().map(|(logical, name)| ((*logical).to_owned(), (*name).to_owned())).collect(),
        free: None,
    };
    let guess = guess_of_files(&[("log.csv", &text)], &said(&[("tau0", "a"), ("tau1", "b")])).expect("all is said");
    assert_eq!(guess.column("tau1").map(|own| own.name.as_str()), Some("b"));
    let wrong = guess_of_files(&[("log.csv", &text)], &said(&[("tau7", "a")])).expect_err("no such joint");
    assert!(wrong.to_string().starts_with("`tau7` is no column of an experiment of `planar2r`"), "{wrong}");
    let wrong = guess_of_files(&[("log.csv", &text)], &said(&[("tau0", "c")])).expect_err("no such column");
    assert!(wrong.to_string().contains("there is no column `c` to be `tau0`"), "{wrong}");
    let known = Known { free: Some(vec![2]), ..Known::default() };
    let wrong = guess_of_files(&[("log.csv", &text)], &known).expect_err("no such joint");
    assert!(wrong.to_string().contains("has no joint 2, its joints are 0 to 1"), "{wrong}");
}

#[test]
fn what_cannot_be_guessed_is_one_error_with_a_remedy() {
    let log = shaken();
    let without = |name: &str| {
        let mut log = log.clone();
        log.rename(&[(name, "temperature")]);
        refused(&log.text())
    };
    assert_eq!(
        without("q1"),
        "log.csv: no column is the position of joint 1 (elbow); the columns are `t`, `tau0`, `tau1`, `q0`, `temperature`. \
         Name it with `--column q1=NAME`; a locked joint needs one as well, of where it stands"
    );
    assert_eq!(
        without("tau0"),
        "log.csv: no column is the torque of joint 0 (shoulder); the columns are `t`, `temperature`, `tau1`, `q0`, `q1`. \
         Name it with `--column tau0=NAME`; if it was locked, say which joints were free: `--free 0,1`"
    );
    let mut timeless = log.clone();
    timeless.rename(&[("t", "temperature")]);
    timeless.change("temperature", |t| t.sin());
    assert_eq!(
        refused(&timeless.text()),
        "log.csv: no column is the time: none is named so and rises from row to row, and none rises evenly; the columns are \
         `temperature`, `tau0`, `tau1`, `q0`, `q1`. Name it with `--column t=NAME`"
    );
    let mut parts = log.clone();
    parts.rename(&[("t", "stamp.sec")]);
    parts.add("stamp.nanosec", parts.columns[0].iter().map(|t| (t.fract() * 1e9).round()).collect());
    parts.change("stamp.sec", f64::floor);
    assert_eq!(
        refused(&parts.text()),
        "log.csv: the time is in two columns, `stamp.sec` and `stamp.nanosec`; write their sum into one column, in seconds"
    );
    assert_eq!(
        refused("t,q0,q1,tau0,tau1\n0,1,1,1,1\n0.1,1,1,1\n"),
        "log.csv:3: the row has 4 cells, the header 5 names; expected as many: give each column one name, take lines above the \
         header out, and write decimal points, not commas"
    );
    assert_eq!(refused(""), "log.csv: the log has no header; expected a header line and rows of numbers below it");
    assert_eq!(
        refused("t,q0,q1,tau0,tau1\n"),
        "log.csv: the log has a header but no rows; expected a header line and rows of numbers below it"
    );
    assert_eq!(
        refused("0,1,2,3,4\n1,1,2,3,4\n"),
        "log.csv:1: the first line holds numbers (`0`); expected the names of the columns there: add a line with them"
    );
    let still = "t,q0,q1,tau0,tau1\n".to_owned() + &(0..99).map(|k| format!("{k},1,2,3,4\n")).collect::<String>();
    assert_eq!(
        refused(&still),
        "log.csv: no joint moves by more than its noise; leave the log out, or name the joints that were free with `--free`"
    );
}

/// Of the arm shaken for a while; one row of so many is kept.
fn every(mut log: Log, rows: usize) -> Log {
    log.columns.iter_mut().for_each(|column| *column = column.iter().copied().step_by(rows).collect());
    log
}

#[test]
fn a_slow_log_in_seconds_stays_in_seconds() {
    let slow = every(shaken(), 20);
    for name in ["t", "time"] {
        let mut log = slow.clone();
        log.rename(&[("t", name)]);
        assert_eq!(scale(&guess(&log), "t"), 1.0, "{name} at 5 Hz");
    }
    let mut log = shaken();
    log.change("t", |t| (1000.0 * t).round());
    let guess = guess(&log);
    assert_eq!(scale(&guess, "t"), 1.0, "the project's own name");
    let far_apart = Remark::RowsFarApart { column: "t".to_owned(), step_s: 10.0 };
    assert!(guess.remarks.contains(&far_apart), "{:?}", guess.remarks);
}

fn saying(pairs: &[(&str, &str)]) -> Known {
    let columns = pairs.iter().map(|(logical, name)| ((*logical).to_owned(), (*name).to_owned())).collect();
    Known { columns, free: None }
}

#[test]
fn each_column_is_a_current_or_a_torque_by_its_own_name_and_unit() {
    let mut log = shaken();
    log.change("tau1", |tau| tau / -1.2);
    let is_current = |guess: &FirstGuess, logical: &str, constant: f64| {
        let own = guess.column(logical).expect("a torque");
        let is_needed = matches!(own.factors[..], [Factor { reason: FactorReason::Needed { .. }, .. }]);
        is_needed && (own.scale() / constant - 1.0).abs() < 0.2
    };
    // One said that says nothing, one that is a current.
    let mut mixed = log.clone();
    mixed.rename(&[("tau0", "drive_x"), ("tau1", "current_1")]);
    let own = guess_of_files(&[("log.csv", &mixed.text())], &saying(&[("tau0", "drive_x"), ("tau1", "current_1")]));
    let own = own.expect("all is said");
    assert_eq!(scale(&own, "tau0"), 1.0);
    assert!(is_current(&own, "tau1", -1.2), "{:?}", own.columns);
    // The unit alone says it, of one that is said and of one that is found.
    for name in ["motor [A]", "motor_1_A [A]", "tau1 [A]"] {
        let mut log = log.clone();
        log.rename(&[("tau1", name)]);
        let own = guess_of_files(&[("log.csv", &log.text())], &saying(&[("tau1", name)])).expect("it is said");
        assert!(is_current(&own, "tau1", -1.2), "{name}: {:?}", own.columns);
    }
    let mut milli = log.clone();
    milli.change("tau0", |tau| 1000.0 * tau / 2.5);
    milli.change("tau1", |tau| 1000.0 * tau);
    milli.rename(&[("tau0", "tau0 [mA]"), ("tau1", "tau1 [mA]")]);
    let own = guess(&milli);
    for (logical, constant) in [("tau0", 2.5), ("tau1", -1.2)] {
        // In amperes first, as the name says, then the torque of one.
        let factors: Vec<&FactorReason> = own.column(logical).unwrap().factors.iter().map(|own| &own.reason).collect();
        assert!(
            matches!(factors[..], [FactorReason::UnitInName { unit: "mA" }, FactorReason::Needed { .. }]),
            "{factors:?}"
        );
        assert!((scale(&own, logical) * 1000.0 / constant - 1.0).abs() < 0.2, "{:?}", own.columns);
    }
}

#[test]
fn a_unit_of_something_else_is_no_factor_and_is_told() {
    let mut log = shaken();
    log.rename(&[("q0", "q0_ms"), ("q1", "q1 [mm]")]);
    let guess = guess(&log);
    assert_eq!((scale(&guess, "q0"), scale(&guess, "q1")), (1.0, 1.0));
    for (column, unit, logical) in [("q0_ms", "ms", "q0"), ("q1 [mm]", "mm", "q1")] {
        let (column, logical) = (column.to_owned(), logical.to_owned());
        let told = Remark::UnitOfOther { column, unit, logical };
        assert!(guess.remarks.contains(&told), "{:?}", guess.remarks);
    }
}

#[test]
fn lost_rows_are_no_turn() {
    let mut log = shaken();
    let degrees = |t: f64, k: f64| 40.0 * (k * t).sin();
    let t = log.columns[log.place("t")].clone();
    let (q0, q1) = (log.place("q0"), log.place("q1"));
    log.columns[q0] = t.iter().map(|t| degrees(*t, 0.5)).collect();
    log.columns[q1] = t.iter().map(|t| degrees(*t, 0.4)).collect();
    // Rows are lost until the position has moved by about 2 pi degrees.
    let from = (0..t.len()).find(|k| degrees(t[*k], 0.5) > 3.0).expect("it moves");
    let to = (from..t.len()).find(|k| degrees(t[*k], 0.5) > 3.0 + TAU).expect("it moves on");
    log.columns.iter_mut().for_each(|column| drop(column.drain(from + 1..to)));
    let guess = guess(&log);
    assert_eq!(guess.column("q0").expect("a position").turn, None);
}

#[test]
fn references_that_are_said_are_taken() {
    let closed = logs(&[CLOSED])["closed.csv"].clone();
    for follows in [true, false] {
        let mut log = closed.clone();
        log.rename(&[("ref0", "soll_x"), ("ref1", "soll_y")]);
        if !follows {
            log.change("soll_x", |reference| -reference);
        }
        let said = saying(&[("ref0", "soll_x"), ("ref1", "soll_y")]);
        let guess = guess_of_files(&[("log.csv", &log.text())], &said).expect("all is said");
        for (logical, name) in [("ref0", "soll_x"), ("ref1", "soll_y")] {
            let own = guess.column(logical).map(|own| (own.name.as_str(), &own.why));
            assert_eq!(own, Some((name, &WhyColumn::Said)), "{:?}", named(&guess));
        }
        assert!(matches!(guess.remarks[0], Remark::ClosedLoop { .. }), "{:?}", guess.remarks);
        let half =
            guess_of_files(&[("log.csv", &log.text())], &saying(&[("ref0", "soll_x")])).expect_err("one is left");
        assert!(half.to_string().contains("no column is the reference of joint 1 (elbow)"), "{half}");
    }
}

#[test]
fn a_log_of_another_header_is_told_before_anything_is_asked_of_it() {
    let (one, mut two) = (shaken(), shaken());
    two.rename(&[("q0", "angle_a"), ("q1", "angle_b")]);
    let files = [("one.csv", &*one.text()), ("two.csv", &*two.text())];
    let error = guess_of_files(&files, &Known::default()).expect_err("other names").to_string();
    assert!(error.contains("two.csv: column `q0` of") && error.contains("`angle_a`"), "{error}");
}

#[test]
fn a_time_that_is_no_number_is_told_with_its_place() {
    let header = "t;q0;q1;tau0;tau1\n";
    let rows = |from: &str, to: &str| -> String {
        (0..99).map(|k| format!("0.{k:02};1;2;3;4\n").replace(from, to)).collect::<String>()
    };
    assert_eq!(
        refused(&(header.to_owned() + &rows(".", ","))),
        "log.csv:2: column `t` is named a time, but `0,00` is no number; write decimal points, not commas"
    );
    assert_eq!(
        refused(&(header.to_owned() + "s;rad;rad;Nm;Nm\n" + &rows("", ""))),
        "log.csv:2: column `t` is named a time, but `s` is no number; take lines between the header and the numbers out; a name \
         may say the unit, as in `t [ms]`"
    );
    assert_eq!(
        refused(&(header.to_owned() + &rows(";", ";")).replace(';', " ")),
        "log.csv:1: the header is a single cell, `t q0 q1 tau0 tau1`; part the cells of all rows by commas, semicolons or tabs"
    );
    assert_eq!(
        refused(&(header.to_owned() + &rows("0.50", "-"))),
        "log.csv:52: column `t` is named a time, but `-` is no number; repair the row, or take it out"
    );
}

#[test]
fn stamps_that_stand_twice_each_are_a_time() {
    let mut log = shaken();
    log.columns.iter_mut().for_each(|column| *column = column.iter().flat_map(|value| [*value, *value]).collect());
    let guess = guess(&log);
    assert_eq!(guess.columns[0].name, "t");
    assert!(guess.repeats_times);
}

/// An arm that turns and reaches out, in degrees and millimetres.
#[test]
fn each_joint_has_its_own_unit() {
    let text = include_str!("../../../model/devices/planar2r.toml")
        .replace("theta = \"q1\", d = 0", "theta = 0, d = \"q1\"")
        .replace(
            "# q1\ntitle = \"elbow\"\nposition = [\"-pi\", \"pi\"]",
            "\ntitle = \"slide\"\nposition = [-1.0, 1.0]",
        );
    let device = Device::parse(&text, Path::new("slide.toml")).unwrap_or_else(|error| panic!("{error}"));
    let device: &'static Device = Box::leak(Box::new(device));
    let rows: String = (0..800)
        .map(|k| {
            let t = 0.01 * f64::from(k);
            let (q0, q1) = (40.0 * (2.0 * t).sin(), 300.0 * (3.0 * t).sin());
            format!("{t},{q0},{q1},{},{}\n", 2.0 * (2.0 * t).sin(), (3.0 * t).sin())
        })
        .collect();
    let folder = TempDir::new().expect("a folder");
    for header in ["time [s],q0 [deg],q1 [mm],tau0 [Nm],tau1 [N]", "time [s],q0_deg,q1_mm,tau0_Nm,tau1_N"] {
        let path = folder.path().join("log.csv");
        std::fs::write(&path, format!("{header}\n{rows}")).expect("the folder is writable");
        let guess = first_guess(device, &[path], &Known::default()).unwrap_or_else(|error| panic!("{error}"));
        assert!((scale(&guess, "q0") - PI / 180.0).abs() < 1e-15 && scale(&guess, "q1") == 1e-3, "{:?}", guess.columns);
        let is_of_other = |remark: &Remark| matches!(remark, Remark::UnitOfOther { .. });
        assert!(!guess.remarks.iter().any(is_of_other), "{:?}", guess.remarks);
    }
}

#[test]
fn names_that_are_said_are_said_once_and_as_they_are() {
    let text = shaken().text();
    for name in ["q01", "q+1", "q", "t0"] {
        let error = guess_of_files(&[("log.csv", &text)], &saying(&[(name, "q1")])).expect_err(name).to_string();
        assert!(error.starts_with(&format!("`{name}` is no column of an experiment of `planar2r`")), "{error}");
    }
    let twice = guess_of_files(&[("log.csv", &text)], &saying(&[("q0", "q0"), ("q0", "q1")])).expect_err("two");
    assert_eq!(twice.to_string(), "`q0` is said twice, to be `q0` and `q1`; name one column of the log");
}

#[test]
fn a_joint_that_never_moves_needs_no_factor() {
    let mut log = logs(&[ELBOW])["elbow.csv"].clone();
    let zeros = vec![0.0; log.columns[0].len()];
    if !log.names.iter().any(|name| name == "tau0") {
        log.add("tau0", zeros);
    }
    log.rename(&[("tau0", "current_0"), ("tau1", "current_1")]);
    let guess = guess(&log);
    let asks = |remark: &Remark| matches!(remark, Remark::UnknownFactor { joint: 0, .. });
    assert!(!guess.remarks.iter().any(asks), "{:?}", guess.remarks);
}

#[test]
fn an_unevenly_named_time_is_found_by_its_rise() {
    let mut log = shaken();
    log.rename(&[("t", "x")]);
    let guess = guess(&log);
    assert_eq!(guess.columns[0].why, WhyColumn::RisesEvenly);
}

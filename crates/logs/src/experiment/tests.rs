use std::{fs, sync::OnceLock};

use dynid_model::{Configuration, Convention, Device, Joint, JointKind};
use insta::assert_snapshot;
use tempfile::TempDir;

use super::*;

/// Two joints; what these tests need of a device, no more.
fn devices() -> &'static [Device] {
    static DEVICES: OnceLock<Vec<Device>> = OnceLock::new();
    DEVICES.get_or_init(|| {
        let joint = Joint {
            kind: JointKind::Revolute,
            title: String::new(),
            position_limits: [-3.0, 3.0],
            speed_limit: f64::INFINITY,
            torque_limit: f64::INFINITY,
            command_unit: "N*m".to_owned(),
        };
        vec![Device {
            id: "arm".to_owned(),
            file: None,
            title: String::new(),
            source: String::new(),
            convention: Convention::Standard,
            gravity: 9.81,
            up: [0.0, 0.0, 1.0],
            lengths: Vec::new(),
            joints: vec![joint.clone(), joint],
            frames: Vec::new(),
            links: Vec::new(),
            configurations: vec![Configuration { free: vec![1] }, Configuration { free: vec![0, 1] }],
            methods: Vec::new(),
            end_point: None,
            effects: Vec::new(),
        }]
    })
}

const GOOD_LOG: &str = "t,tau0,tau1,q0,q1\n0,1,2,3,4\n0.1,1,2,3,4.5\n0.2,1,2,3,5\n";
const GOOD: &str = "device = \"arm\"\n[[run]]\nfile = \"log.csv\"\nfree = [0, 1]\nrole = \"fit\"\n";

fn read(experiment: &str, log: &str) -> (TempDir, Result<Experiment, ExperimentError>) {
    let folder = TempDir::new().expect("a temporary folder");
    fs::write(folder.path().join("experiment.toml"), experiment).expect("the folder is writable");
    fs::write(folder.path().join("log.csv"), log).expect("the folder is writable");
    let result = Experiment::read_with(&folder.path().join("experiment.toml"), devices());
    (folder, result)
}

/// The error, without the temporary folder's name.
fn refusal(experiment: &str, log: &str) -> String {
    let (folder, result) = read(experiment, log);
    let text = result.expect_err("the experiment is not usable").to_string();
    text.replace(&format!("{}/", folder.path().display()), "")
}

/// Blanks around a cell are no part of it, also where it is quoted or its encoder's turns are counted.
#[test]
fn reads_cells_with_blanks_around_them() {
    let experiment = format!("{GOOD}turn = {{ q1 = 6 }}\nrows = [1, 3]\n");
    let log = "t,tau0,tau1,q0,q1\r\n 0 ,1,2,3,5\r\n\t0.1, 1 ,\" 2\",3 ,\t0.5 \r\n0.2,1,2,  3,1\r\n";
    let (_folder, result) = read(&experiment, log);
    let log = &result.expect("the experiment is good").runs[0].log;
    assert_eq!((&log.t[..], &log.tau[1][..], &log.q[0][..]), (&[0.1, 0.2][..], &[2.0, 2.0][..], &[3.0, 3.0][..]));
    assert_eq!(log.q[1], [6.5, 7.0]);
    let refused = refusal(GOOD, "t,tau0,tau1,q0,q1\n0,1,2,3,4\n0.1,1, much ,3,4\n");
    assert_snapshot!(refused, @"log.csv:3: column `tau1`, row 1: expected a finite number, found `much`; repair or cut the row (rows = [from, to] keeps a part of a log) (run 1 of experiment.toml)");
}

#[test]
fn reads_columns_scale_rows_mask_and_settings() {
    let experiment = "
        device = \"arm\"
        cutoff_hz = 8
        min_speed = [0.1, 0.2]
        [[run]]
        file = \"log.csv\"
        free = [1]
        role = \"validate\"
        columns = { tau1 = \"current\", q1 = \"angle\" }
        scale = { tau1 = 10.0, q1 = 0.5 }
        rows = [1, 3]
        mask = \"on\"
        decimate = 2
        hold = \"linear\"
        min_speed = [0.3]
    ";
    let log = " t , current, q0, angle, on, text\n0,1,7,2,1,a\n1,2,7,4,0,b\n3,3,7,6,1,c\nignored,,,,,\n";
    let (_folder, result) = read(experiment, log);
    let experiment = result.expect("the experiment is good");
    let run = &experiment.runs[0];
    assert_eq!((run.configuration, run.role, run.file.as_str()), (1, Role::Validate, "log.csv"));
    assert_eq!(run.log.t, [1.0, 3.0]);
    assert_eq!(run.log.tau, [vec![0.0, 0.0], vec![20.0, 30.0]]);
    assert_eq!(run.log.q, [vec![7.0, 7.0], vec![2.0, 3.0]]);
    assert_eq!(run.log.mask, Some(vec![false, true]));
    assert_eq!(run.log.reference, None);
    assert_eq!(run.log.sample_time(), 2.0);
    assert_eq!(
        run.settings,
        Settings {
            cutoff_hz: Some(8.0),
            decimate: 2,
            min_speed: vec![0.0, 0.3],
            intersample: Intersample::FirstOrder,
            ..Settings::default()
        }
    );
    assert_eq!(experiment.runs_of(Role::Fit).count(), 0);
}

#[test]
fn reads_references_where_every_free_joint_has_one() {
    let experiment = GOOD.replace("[0, 1]", "[1]");
    let (_folder, result) = read(&experiment, "t,tau1,q0,q1,ref1\n0,1,2,3,4\n1,1,2,3,5\n");
    let reference = result.expect("the experiment is good").runs[0].log.reference.clone();
    assert_eq!(reference, Some(vec![vec![2.0, 2.0], vec![4.0, 5.0]]));
    let (_folder, result) = read(GOOD, "t,tau0,tau1,q0,q1,ref1\n0,1,2,3,4,5\n1,1,2,3,4,5\n");
    assert_eq!(result.expect("the experiment is good").runs[0].log.reference, None);
}

#[test]
fn references_that_are_asked_for_must_be_there() {
    let mapped = format!("{GOOD}columns = {{ ref0 = \"goal\" }}\n");
    assert_snapshot!(refusal(&mapped, GOOD_LOG), @r#"log.csv: column `goal` is missing; the log has `t`, `tau0`, `tau1`, `q0`, `q1`. If it has another name there, say so in the experiment: columns = { ref0 = "its name in the log" } (run 1 of experiment.toml)"#);
    let twice = GOOD_LOG.replace("tau0,tau1,q0,q1", "tau0,tau1,q0,q1,ref0,ref0").replace("\n", ",0,0\n");
    assert_snapshot!(refusal(GOOD, &twice.replacen(",0,0\n", "\n", 1)), @"log.csv: column `ref0` stands twice in the header; rename one of them (run 1 of experiment.toml)");
    let (folder, _) = read(GOOD, GOOD_LOG);
    fs::write(folder.path().join("control.toml"), "").expect("the folder is writable");
    fs::write(folder.path().join("experiment.toml"), format!("{GOOD}controller = \"control.toml\"\n"))
        .expect("writable");
    let result = Experiment::read_with(&folder.path().join("experiment.toml"), devices());
    let message = result.expect_err("no references").to_string();
    assert_snapshot!(message.replace(&format!("{}/", folder.path().display()), ""), @r#"experiment.toml:6:14: controller: log.csv lacks the references that it follows: ref0, ref1; log them; where they have other names, say so: columns = { ref0 = "..." }"#);
}

#[test]
fn digest_follows_the_numbers_only() {
    let digest = |experiment: &str, log: &str| read(experiment, log).1.expect("good").digest;
    let good = digest(GOOD, GOOD_LOG);
    assert_eq!(good.len(), 64);
    assert_eq!(good, digest(&GOOD.replace("free", "# said so\nfree"), GOOD_LOG));
    assert_ne!(good, digest(GOOD, &GOOD_LOG.replace("4.5", "4.6")));
    assert_ne!(good, digest(&GOOD.replace("\"fit\"", "\"validate\""), GOOD_LOG));
}

/// Sets of free joints that the device does not list are numbered on from those that it does.
#[test]
fn any_joints_may_be_free() {
    let twice = format!("{}\n{}", GOOD.replace("[0, 1]", "[0]"), &GOOD[GOOD.find("[[run]]").expect("a run")..]);
    let (_folder, result) = read(&twice, GOOD_LOG);
    let numbers: Vec<usize> = result.expect("it is good").runs.iter().map(|run| run.configuration).collect();
    assert_eq!(numbers, [3, 2]);
}

#[test]
fn turns_that_an_encoder_forgets_are_counted() {
    let log = "t,tau0,tau1,q0,q1\n0,0,0,170,3\n1,0,0,-175,3\n2,0,0,179,3\n3,0,0,-170,3\n4,0,0,100,3\n";
    let experiment = format!("{GOOD}scale = {{ q0 = -0.5 }}\nturn = {{ q0 = 360 }}\n");
    let (_folder, result) = read(&experiment, log);
    let q0 = result.expect("the experiment is good").runs[0].log.q[0].clone();
    assert_eq!(q0, [-85.0, -92.5, -89.5, -95.0, -50.0], "in the log's own unit a turn is 360");
    let (_folder, result) = read(&format!("{experiment}rows = [1, 4]\n"), log);
    let part = result.expect("the experiment is good").runs[0].log.q[0].clone();
    assert_eq!(part, q0[1..4], "a part of a log is where the whole one is");
}

#[test]
fn rows_whose_time_is_repeated_are_left_out_where_the_experiment_says_so() {
    let log = "t,tau0,tau1,q0,q1\n0,1,2,3,4\n0,9,9,9,9\n0.1,1,2,3,5\n0.1,9,9,9,nan\n0.2,1,2,3,6\n";
    let (_folder, result) = read(&format!("{GOOD}repeated_times = \"skip\"\n"), log);
    let own = result.expect("the experiment is good").runs[0].log.clone();
    assert_eq!((own.t, own.q[1].clone()), (vec![0.0, 0.1, 0.2], vec![4.0, 5.0, 6.0]));
    assert_eq!(own.left_out, [1, 3]);
}

#[test]
fn semicolons_and_tabs_part_cells_as_well() {
    let expected = read(GOOD, GOOD_LOG).1.expect("the experiment is good").digest;
    for delimiter in [";", "\t"] {
        let (_folder, result) = read(GOOD, &GOOD_LOG.replace(',', delimiter));
        assert_eq!(result.expect("the experiment is good").digest, expected);
    }
}

#[test]
fn bad_experiments_are_refused_with_place_and_remedy() {
    let refused = |experiment: &str| refusal(experiment, GOOD_LOG);
    assert_snapshot!(refused("device = arm"), @"experiment.toml:1:10: string values must be quoted, expected literal string; write it as TOML: `key = value`, runs under `[[run]]`");
    assert_snapshot!(refused(&GOOD.replace("device", "devise")), @"experiment.toml:1:1: unknown key `devise`; did you mean `device`? the keys here are device, run, columns, scale, turn, repeated_times, cutoff_hz, decimate, min_speed, mask, hold, controller, from_s, first_half, moving, payload, transmission");
    assert_snapshot!(refused(&GOOD.replace("\"arm\"", "\"arn\"")), @r#"experiment.toml:1:10: there is no device `arn`; known: double_pendulum, freedom6s, oscillator, planar2r, servo_pendulum, staubli_tx40; a device of your own is named by its file: "arn.toml""#);
    assert_snapshot!(refused("device = \"arm\"\n"), @"experiment.toml:2:1: the experiment has no run; add one: [[run]] with file, free and role");
    let many = format!("device = \"arm\"\n{}", "[[run]]\n".repeat(4097));
    assert_snapshot!(refused(&many), @"experiment.toml:2:1: the experiment has 4097 runs, more than 4096; keep at most 4096; the others are an experiment of their own");
    assert_snapshot!(refused(&GOOD.replace("[0, 1]", "[0, 0]")), @"experiment.toml:4:12: free: joint 0 is named twice; name each joint once");
    assert_snapshot!(refused(&GOOD.replace("[0, 1]", "[0, 2]")), @"experiment.toml:4:12: free: `arm` has no joint 2, its joints are 0 to 1; name each joint by its index");
    assert_snapshot!(refused(&GOOD.replace("\"fit\"", "\"train\"")), @r#"experiment.toml:5:8: role: expected "fit" or "validate", found "train"; say "fit" for a run that parameters are fitted to, "validate" for a held-out run"#);
    assert_snapshot!(refused(&GOOD.replace("role = \"fit\"\n", "")), @r#"experiment.toml:2:1: run 1 does not say `role`; add "fit" or "validate""#);
    assert_snapshot!(refused(&format!("{GOOD}cutof_hz = 3.0\n")), @"experiment.toml:6:1: unknown key `cutof_hz`; did you mean `cutoff_hz`? the keys here are file, free, role, columns, scale, turn, repeated_times, rows, cutoff_hz, decimate, min_speed, mask, hold, controller, from_s, first_half, moving, start, payload, transmission");
    assert_snapshot!(refused(&format!("{GOOD}cutoff_hz = -3.0\n")), @"experiment.toml:6:13: cutoff_hz: expected a positive frequency [Hz], found `-3.0`; correct the value");
    assert_snapshot!(refused(&format!("{GOOD}decimate = 0\n")), @"experiment.toml:6:12: decimate: expected a whole number from 1, found `0`; correct the value");
    assert_snapshot!(refused(&format!("{GOOD}min_speed = [0.1, 0.1, 0.1]\n")), @"experiment.toml:6:13: min_speed: found 3 speeds for 2 free joints; give one a free joint of the run, or one for each of the device's 2 joints");
    assert_snapshot!(refused(&format!("{GOOD}columns = {{ tau2 = \"a\" }}\n")), @"experiment.toml:6:13: columns: there is no column `tau2` of `arm`; did you mean `tau0`? the columns are t, tau0, q0, ref0, tau1, q1, ref1");
    assert_snapshot!(refused(&format!("{GOOD}scale = {{ tau0 = \"a\" }}\n")), @r#"experiment.toml:6:18: scale.tau0: expected a finite number other than 0, e.g. scale = { tau0 = 10.0 }, found `"a"`; correct the value"#);
    assert_snapshot!(refused(&format!("{GOOD}rows = [1]\n")), @"experiment.toml:6:8: rows: expected two row numbers, rows = [from, to], to excluded, found `[1]`; correct the value");
    assert_snapshot!(refused(&format!("{GOOD}turn = {{ q0 = 0 }}\n")), @"experiment.toml:6:15: turn.q0: expected a positive number, e.g. turn = { q0 = 360 }, found `0`; correct the value");
    assert_snapshot!(refused(&format!("{GOOD}repeated_times = \"keep\"\n")), @r#"experiment.toml:6:18: repeated_times: expected "refuse" or "skip", found "keep"; say "skip" where a row with the time of the row before is to be left out"#);
    assert_snapshot!(refused(&format!("{GOOD}hold = \"cubic\"\n")), @r#"experiment.toml:6:8: hold: expected "zero" or "linear", found "cubic"; say "zero" where the torque of a row acts until the next row, "linear" where it runs straight between them"#);
    assert_snapshot!(refused(&format!("{GOOD}controller = \"control.toml\"\n")), @"experiment.toml:6:14: controller: there is no file control.toml; give the path of the controller file, relative to the experiment");
}

#[test]
fn bad_logs_are_refused_with_row_column_and_remedy() {
    let refused = |log: &str| refusal(GOOD, log);
    assert_snapshot!(refused(""), @"log.csv: the log has no header; expected a header line and rows of numbers below it (run 1 of experiment.toml)");
    assert_snapshot!(refused("t,tau0,tau1,q0,q1\n"), @"log.csv: the log has a header but no rows; expected a header line and rows of numbers below it (run 1 of experiment.toml)");
    assert_snapshot!(refused("t,tau0,tau1,q0,q1\n0,1,2,3,4\n"), @"log.csv: the log has a single row; expected a header line and rows of numbers below it (run 1 of experiment.toml)");
    assert_snapshot!(refused(&GOOD_LOG.replace("tau1", "tau_2")), @r#"log.csv: column `tau1` is missing; the log has `t`, `tau0`, `tau_2`, `q0`, `q1`; the nearest name is `tau_2`. If it has another name there, say so in the experiment: columns = { tau1 = "tau_2" } (run 1 of experiment.toml)"#);
    assert_snapshot!(refused(&GOOD_LOG.replace("tau1", "tau0")), @"log.csv: column `tau0` stands twice in the header; rename one of them (run 1 of experiment.toml)");
    assert_snapshot!(refused(&GOOD_LOG.replace("4.5", "NaN")), @"log.csv:3: column `q1`, row 1: expected a finite number, found `NaN`; repair or cut the row (rows = [from, to] keeps a part of a log) (run 1 of experiment.toml)");
    assert_snapshot!(refused(&GOOD_LOG.replace(",4.5", "")), @"log.csv:3: column `q1`, row 1: expected a finite number, found nothing; repair or cut the row (rows = [from, to] keeps a part of a log) (run 1 of experiment.toml)");
    assert_snapshot!(refused(&GOOD_LOG.replace("4.5", "fast")), @"log.csv:3: column `q1`, row 1: expected a finite number, found `fast`; repair or cut the row (rows = [from, to] keeps a part of a log) (run 1 of experiment.toml)");
    assert_snapshot!(refused(&GOOD_LOG.replace("0.2,", "0.05,")), @"log.csv:4: column `t`, row 2: time runs backwards (0.1 s, then 0.05 s); sort the log, or split it where it restarts (rows = [from, to]) (run 1 of experiment.toml)");
    assert_snapshot!(refused(&GOOD_LOG.replace("0.2,", "0.1,")), @r#"log.csv:4: column `t`, row 2: time stands still (0.1 s, then 0.1 s); leave such rows out (repeated_times = "skip" in the experiment), or give each its own time (run 1 of experiment.toml)"#);
    // The first in the file, whichever column it is in; and of a row whose time is wrong, the other cells.
    let two = GOOD_LOG.replace("2,3,4.5", "2,x,4.5").replace("0.2,1", "0.2,y");
    assert_snapshot!(refused(&two), @"log.csv:3: column `q0`, row 1: expected a finite number, found `x`; repair or cut the row (rows = [from, to] keeps a part of a log) (run 1 of experiment.toml)");
    let both = GOOD_LOG.replace("0.2,1,2,3,5", "0.05,1,2,3,z").replace('\n', "\r\n");
    assert_snapshot!(refused(&both), @"log.csv:4: column `q1`, row 2: expected a finite number, found `z`; repair or cut the row (rows = [from, to] keeps a part of a log) (run 1 of experiment.toml)");
    assert_snapshot!(refusal(&format!("{GOOD}rows = [1, 4]\n"), GOOD_LOG), @"log.csv: rows = [1, 4] lies outside the log, which has 3 rows; expected 0 <= from < to <= 3 (run 1 of experiment.toml)");
    assert_snapshot!(refusal(&format!("{GOOD}mask = \"used\"\n"), GOOD_LOG), @r#"log.csv: column `used` is missing; the log has `t`, `tau0`, `tau1`, `q0`, `q1`. If it has another name there, say so in the experiment: mask = "its name in the log" (run 1 of experiment.toml)"#);
    assert_snapshot!(refusal(&GOOD.replace("log.csv", "lag.csv"), GOOD_LOG), @"lag.csv: cannot be read: No such file or directory (os error 2); give the path of a log, relative to the experiment file (run 1 of experiment.toml)");
}

/// The motors of a coupled wrist: both turn with joint 0, and against each other with joint 1.
const MOTORS: &str = "[transmission]\nposition = [\"m0\", \"m1\"]\ntorque = [\"i0\", \"i1\"]\nratio = [[50, 40], [50, -40]]\n\
                      motor_constant = [0.05, 0.1]\n";
const MOTOR_LOG: &str = "t,m0,m1,i0,i1\n0,310,-10,1,2\n0.1,330,-30,1,2\n0.2,350,-50,1,-2\n";

#[test]
fn joints_of_motors() {
    let (_folder, experiment) =
        read(&format!("{GOOD}{}", MOTORS.replace("[transmission]", "[run.transmission]")), MOTOR_LOG);
    let log = &experiment.expect("a good experiment").runs[0].log;
    for (found, expected) in log.q.iter().flatten().zip([3.0, 3.0, 3.0, 4.0, 4.5, 5.0]) {
        assert!((found - expected).abs() < 1e-14, "{:?}", log.q);
    }
    let torque = |i0: f64, i1: f64, sign: f64| {
        if sign > 0.0 { 50.0 * (0.05 * i0 + 0.1 * i1) } else { 40.0 * (0.05 * i0 - 0.1 * i1) }
    };
    for (joint, sign) in [(0, 1.0), (1, -1.0)] {
        for (found, (i0, i1)) in log.tau[joint].iter().zip([(1.0, 2.0), (1.0, 2.0), (1.0, -2.0)]) {
            assert!((found - torque(i0, i1, sign)).abs() < 1e-12, "joint {joint}: {found}");
        }
    }
}

/// Columns of motors go by their own names.
#[test]
fn motors_have_units_too() {
    let motors = MOTORS.replace("[transmission]", "scale = { m0 = 0.5, i1 = 10 }\n[run.transmission]");
    let log = "t,m0,m1,i0,i1\n0,620,-10,1,0.2\n0.1,660,-30,1,0.2\n0.2,700,-50,1,-0.2\n";
    let (_folder, scaled) = read(&format!("{GOOD}{motors}"), log);
    let plain = MOTORS.replace("[transmission]", "[run.transmission]");
    let (_other, plain) = read(&format!("{GOOD}{plain}"), MOTOR_LOG);
    let (scaled, plain) = (scaled.expect("a good experiment"), plain.expect("a good experiment"));
    assert_eq!(scaled.runs[0].log, plain.runs[0].log);
}

/// Gears alone, encoders at the joints: `ratio` as a list, and positions that are logged as ever.
#[test]
fn gears_of_some_joints() {
    let text = format!(
        "{GOOD}[run.transmission]\njoints = [1]\ntorque = [\"current\"]\nratio = [100]\nmotor_constant = [0.02]\n"
    );
    let (_folder, experiment) = read(&text, "t,tau0,q0,q1,current\n0,1,2,3,4\n0.1,1,2,3,4.5\n");
    let log = &experiment.expect("a good experiment").runs[0].log;
    assert_eq!((&log.tau[1], &log.q[1]), (&vec![8.0, 9.0], &vec![3.0, 3.0]));
}

#[test]
fn what_is_wrong_with_a_transmission() {
    let of = |old: &str, new: &str| {
        let motors = MOTORS.replace("[transmission]", "[run.transmission]");
        assert!(motors.contains(old), "{old}");
        format!("{GOOD}{}", motors.replace(old, new))
    };
    let errors = [
        ("ratio = [[50, 40], [50, -40]]\n", ""),
        ("[[50, 40], [50, -40]]", "[[50, 40], [100, 80]]"),
        ("[[50, 40], [50, -40]]", "[[50, 40]]"),
        ("[[50, 40], [50, -40]]", "[[50, 40, 1], [50, -40, 1]]"),
        ("[\"i0\", \"i1\"]", "[\"i0\"]"),
        ("\"m1\"", "\"m2\""),
        ("[run.transmission]\n", "columns = { q1 = \"m1\" }\n[run.transmission]\n"),
        ("[run.transmission]\n", "[run.transmission]\njoints = [0, 2]\n"),
        ("ratio", "gear"),
        ("[run.transmission]\n", "turn = { q0 = 360 }\n[run.transmission]\n"),
        ("[run.transmission]\n", "[run.transmission]\njoints = [1, 1]\n"),
        ("[run.transmission]\n", "[run.transmission]\njoints = []\n"),
        ("position = [\"m0\", \"m1\"]\ntorque = [\"i0\", \"i1\"]\n", ""),
        ("[[50, 40], [50, -40]]\nmotor", "[50, 40]\njoints = [1]\nmotor"),
        ("[0.05, 0.1]", "[0.05, 0]"),
        ("[run.transmission]\n", "scale = { m2 = 0.1 }\n[run.transmission]\n"),
    ];
    let told: Vec<String> = errors.iter().map(|(old, new)| refusal(&of(old, new), MOTOR_LOG)).collect();
    assert_snapshot!(told.join("\n"));
}

#[test]
fn a_payload_has_a_name() {
    let (_folder, experiment) = read(
        &format!(
            "payload = \"box\"\n{GOOD}[[run]]\nfile = \"log.csv\"\nfree = [1]\nrole = \"fit\"\npayload = \"two\"\n"
        ),
        GOOD_LOG,
    );
    let runs = experiment.expect("a good experiment").runs;
    assert_eq!(runs.iter().map(|run| run.payload.as_deref()).collect::<Vec<_>>(), [Some("box"), Some("two")]);
    assert_snapshot!(refusal(&format!("{GOOD}payload = \"a box\"\n"), GOOD_LOG), @"experiment.toml:6:11: `a box` is no name of a payload; use letters, digits and `_`; choose another name, also for the effects of the model that it stands for");
}

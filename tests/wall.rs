//! Walls as a user meets them: the thesis's chatter, what the fuzzy walls make of it, and files that are wrong.

use std::path::Path;

use assert_cmd::Command;
use dynid_control::{FilteredVelocity, Law, LinearLaw, Wall};
use dynid_dynamics::simulate::control::Filter;
use dynid_haptics::{wall, wall::Approach, wall::Case, wall::Measures, wall::Setting, wall::contact};
use dynid_user_model::Model;

fn dynid() -> Command {
    Command::cargo_bin("dynid").expect("the program")
}

fn compared(arguments: &[&str]) -> Vec<serde_json::Value> {
    let all = [&["wall", "compare", "--json"], arguments].concat();
    let output = dynid().args(all).assert().success().get_output().stdout.clone();
    let answer: serde_json::Value = serde_json::from_slice(&output).expect("JSON");
    answer["cases"].as_array().expect("cases").clone()
}

fn of<'a>(cases: &'a [serde_json::Value], controller: &str) -> Vec<&'a serde_json::Value> {
    cases.iter().filter(|case| case["controller"] == controller).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2])
}

/// Sixteen hands that nothing was tuned on, three speeds.
#[test]
fn fuzzy_walls_are_still_where_the_thesis_pd_chatters() {
    let cases = compared(&[]);
    let value = |case: &serde_json::Value, key: &str| case[key].as_f64().expect("a number");
    let pd = of(&cases, "pd");
    assert_eq!(pd.len(), 48);
    for speed in ["slow", "medium", "fast"] {
        let own: Vec<_> = pd.iter().filter(|case| case["speed"] == speed).collect();
        let peaks = median(own.iter().map(|case| value(case, "peak_to_peak")).collect());
        let frequency = median(own.iter().map(|case| value(case, "frequency")).collect());
        assert!((0.015..0.045).contains(&peaks) && (6.0..10.0).contains(&frequency), "{speed}: {peaks} {frequency}");
    }
    let ratios = |controller: &str| -> Vec<f64> {
        let own = of(&cases, controller);
        assert_eq!(own.len(), pd.len(), "{controller}");
        pd.iter().zip(own).map(|(pd, own)| value(pd, "chatter_rms") / value(own, "chatter_rms")).collect()
    };
    let consistent = ratios("fuzzy");
    let calm = consistent.iter().filter(|ratio| **ratio >= 5.0).count();
    assert!(median(consistent) >= 10.0 && calm * 10 >= 48 * 9, "{calm} of 48");
    for (case, ratio) in of(&cases, "fuzzy_tuned").into_iter().zip(ratios("fuzzy_tuned")) {
        assert!(ratio >= 10.0, "{case}: {ratio}");
        assert!(value(case, "stiffness") >= 6.0 && value(case, "outside") <= 0.05, "{case}");
        assert!(value(case, "energy_out") <= 5e-3, "{case}");
    }
    // A better spring and damper stands beside it, and is no stiller at its stiffness.
    assert!(median(ratios("pd_tuned")) >= 10.0);
    for speed in ["slow", "medium", "fast"] {
        let typical = |controller: &str, key: &str| {
            let own = of(&cases, controller).into_iter().filter(|case| case["speed"] == speed);
            median(own.map(|case| value(case, key)).collect())
        };
        assert!(typical("fuzzy_tuned", "stiffness") >= typical("pd_tuned", "stiffness"), "{speed}");
        assert!(typical("fuzzy_tuned", "chatter_rms") <= typical("pd_tuned", "chatter_rms"), "{speed}");
    }
}

/// What other programs read stays; what stands beside is reported when asked.
#[test]
fn walls_of_other_kinds_stand_beside_when_asked() {
    let names = |cases: &[serde_json::Value]| -> Vec<String> {
        let mut names: Vec<String> =
            cases.iter().map(|case| case["controller"].as_str().expect("a name").to_owned()).collect();
        names.dedup();
        names
    };
    let five = ["pd", "pd_tuned", "fuzzy_literal", "fuzzy", "fuzzy_tuned"];
    let few = ["--hands", "2"];
    assert_eq!(names(&compared(&few)), five);
    let cases = compared(&["--all"]);
    assert_eq!(names(&cases), [&five[..], &["coupled", "passive", "leaky"]].concat());
    assert_eq!(names(&compared(&["--hands", "2", "--wall", "leaky,pd"])), ["leaky", "pd"]);
    let value = |case: &serde_json::Value, key: &str| case[key].as_f64().expect("a number");
    let all = |controller: &str, key: &str| -> Vec<f64> {
        of(&cases, controller).into_iter().map(|case| value(case, key)).collect()
    };
    // The tuned ones are stiffer and far stiller than PD, whoever touches them.
    for controller in ["coupled", "leaky"] {
        let chatter = all("pd", "chatter_rms").into_iter().zip(all(controller, "chatter_rms"));
        assert!(chatter.into_iter().all(|(pd, own)| own < pd / 5.0), "{controller}");
        assert!(all(controller, "stiffness").into_iter().all(|own| own >= 6.0), "{controller}");
        assert!(all(controller, "energy_out").into_iter().all(|own| own <= 5e-3), "{controller}");
    }
    // Passivity control takes some of the energy out of the chatter, at this rate and delay far from all of it.
    assert!(median(all("passive", "energy_out")) < 0.5 * median(all("pd", "energy_out")));
    assert!(median(all("passive", "chatter_rms")) < median(all("pd", "chatter_rms")));
    assert!(median(all("passive", "energy_out")) > 5e-3);
}

/// What the observer of a passivity controller books is the energy of the simulation, of torques that act late. At 1 kHz, where
/// a tick is short beside the hand's motion, a spring without a damper gives out less than a fifth with it of what it gives
/// without.
#[test]
fn a_passivity_observer_books_the_energy_of_the_simulation() {
    let mut setting = Setting::shipped().expect("shipped");
    setting.position_quantum = 0.0;
    for (sample_s, delay_samples) in [(0.01, 1), (0.001, 0), (0.001, 1), (0.001, 3)] {
        setting.sample_s = sample_s;
        setting.delay_samples = delay_samples;
        setting.filter = Filter::butterworth(0.15 / sample_s, sample_s);
        let spring = LinearLaw { k1: 400.0, k2: 0.0, offset: 0.0 };
        let plain = Wall::new(Law::Linear(spring), 0.03, sample_s, setting.torque_limit).expect("a wall");
        let passive = plain.clone().passive(delay_samples);
        let model = Model::of_device(setting.device);
        let played = contact(&model, &setting, &passive, &setting.hand, &setting.approaches[1]).expect("a contact");
        // Once more over the same positions, to look at the observer.
        let mut again = passive.clone();
        let mut velocity = FilteredVelocity::new(setting.filter, sample_s);
        let (mut taken, mut forgotten) = (0.0, 0);
        for tick in 0..played.position.len() {
            let position = played.position[tick];
            if tick > 0 {
                taken -= played.torque[tick - 1] * (position - played.position[tick - 1]);
            }
            let answered = again.tick(position, velocity.tick(position));
            if let Some(acts) = played.torque.get(tick + delay_samples) {
                assert_eq!(answered, *acts, "tick {tick}");
            }
            let observed = again.observed_energy().expect("it is watched");
            // Between contacts it forgets what was taken; never what was given out.
            if observed < taken - 1e-12 && position >= 0.0 {
                taken = observed;
                forgotten += 1;
            }
            assert!(
                (observed - taken).abs() < 1e-12,
                "{sample_s} s, {delay_samples} late, tick {tick}: {observed} {taken}"
            );
        }
        assert!(forgotten < played.position.len() / 2);
        if sample_s < 0.01 {
            let energy = |wall: &Wall| {
                let contact = contact(&model, &setting, wall, &setting.hand, &setting.approaches[1]);
                Measures::of(&contact.expect("a contact"), wall).expect("it is met").energy_out
            };
            let (without, with) = (energy(&plain), energy(&passive));
            println!("{delay_samples} late: {without} J, {with} J");
            assert!(with < 0.2 * without, "{delay_samples} late: {with} J of {without} J");
        }
    }
}

/// What the tuned walls still show at a fast approach is how the handle comes to rest, not chatter: a wall that is asked at once,
/// exactly and ten times as often shows as much.
#[test]
fn the_tuned_walls_are_near_the_floor_of_the_measure() {
    let setting = Setting::shipped().expect("shipped");
    let model = Model::of_device(setting.device);
    let tuned = wall::shipped("pd_tuned").expect("shipped");
    let typical = |setting: &Setting| {
        let walls = [("own".to_owned(), tuned.wall(setting).expect("a wall"))];
        let cases = wall::compare(&model, setting, &walls).expect("contacts");
        let fast = cases.iter().filter(|case| case.speed == "fast").map(|case| case.measures.chatter_rms);
        median(fast.collect())
    };
    let sampled = typical(&setting);
    let exact = Setting {
        sample_s: 1e-3,
        delay_samples: 0,
        position_quantum: 0.0,
        filter: Filter::butterworth(300.0, 1e-3),
        ..setting.clone()
    };
    let floor = typical(&exact);
    assert!(floor < 3e-4 && sampled < 1.1 * floor, "{sampled} over {floor}");
    let dead = wall::chatter_floor(&setting, &setting.approaches[2]);
    assert!(dead < floor, "a dead stop leaves less: {dead}");
}

fn settled(cases: &[Case], speed: &str) -> f64 {
    median(cases.iter().filter(|case| case.speed == speed).map(|case| case.measures.settled_position).collect())
}

/// Section 5.7.2: the faster the approach, the deeper the wall seems; it is the torque that the arm goes on holding with.
#[test]
fn a_faster_approach_settles_deeper_because_the_arm_holds_harder() {
    let mut setting = Setting::shipped().expect("shipped");
    let model = Model::of_device(setting.device);
    let walls = [("pd".to_owned(), wall::shipped("pd").expect("shipped").wall(&setting).expect("a wall"))];
    let cases = wall::compare(&model, &setting, &walls).expect("contacts");
    let depths = ["slow", "medium", "fast"].map(|speed| settled(&cases, speed));
    assert!(depths[0] > depths[1] + 0.005 && depths[1] > depths[2] + 0.005, "{depths:?}");
    setting.approaches.iter_mut().for_each(|approach| approach.hold = Some(0.2));
    let mut walls = walls.to_vec();
    for still in ["pd_tuned", "fuzzy", "fuzzy_tuned"] {
        walls.push((still.to_owned(), wall::shipped(still).expect("shipped").wall(&setting).expect("a wall")));
    }
    let cases = wall::compare(&model, &setting, &walls).expect("contacts");
    let spread = |name: &str, hand: usize, value: fn(&Measures) -> f64| {
        let of = cases.iter().filter(|case| case.controller == name && case.hand == hand);
        of.map(|case| value(&case.measures))
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], value| [least.min(value), most.max(value)])
    };
    let apart = |name: &str, hand: usize| {
        let [deepest, highest] = spread(name, hand, |measures| measures.settled_position);
        highest - deepest
    };
    // At walls that are still, every hand settles equally deep, however fast it came.
    for still in ["pd_tuned", "fuzzy", "fuzzy_tuned"] {
        let apart: Vec<f64> = (0..setting.hands).map(|hand| apart(still, hand)).collect();
        assert!(apart.iter().all(|apart| *apart < 0.002), "{still}: {apart:?}");
    }
    // At the thesis's every hand does whose approaches end in one cycle of chatter. The chatter of some hand may have two, a wide
    // one inside the wall and a narrow one that comes out of it; it is the approach that decides between them.
    let mut in_one = 0;
    for hand in 0..setting.hands {
        let [narrow, wide] = spread("pd", hand, |measures| measures.peak_to_peak);
        if wide < 1.2 * narrow {
            in_one += 1;
            assert!(apart("pd", hand) < 0.002, "hand {hand}: {}", apart("pd", hand));
        }
    }
    assert!(in_one * 10 >= 9 * setting.hands, "{in_one} of {}", setting.hands);
}

/// Without friction and springs the joint settles where springs balance: wall, grip and arm, by hand.
#[test]
fn a_still_hand_settles_where_the_springs_balance() {
    let setting = Setting::shipped().expect("shipped");
    let mut model = Model::of_device(setting.device);
    let others: Vec<String> =
        model.effects.iter().filter(|own| own.joint == Some(0)).map(|own| own.effect.id.clone()).collect();
    for id in others.iter().filter(|id| *id != "gain") {
        model.remove_effect(id, Some(0), None).expect("it is there");
    }
    let (scale, law) = (0.03, LinearLaw { k1: 200.0, k2: 8.0, offset: 0.0 });
    let wall = Wall::new(Law::Linear(law), scale, setting.sample_s, setting.torque_limit).expect("a wall");
    let approach = Approach { name: "steady".to_owned(), peak: 1.0, hold: Some(0.3) };
    let contact = contact(&model, &setting, &wall, &setting.hand, &approach).expect("a contact");
    let measures = Measures::of(&contact, &wall).expect("it is met");
    // wall * q + grip * (q - place) = 0 and grip * (q - place) - arm * place - hold = 0
    let (stiffness, grip, arm) = (scale * law.k1, setting.hand.grip_stiffness, setting.hand.arm_stiffness);
    let place = |q: f64| q * (stiffness + grip) / grip;
    let q = -0.3 / (stiffness + arm * place(1.0));
    assert!((measures.settled_position - q).abs() < 1e-4, "{} for {q}", measures.settled_position);
    assert!(measures.energy_out < 1e-3 && measures.outside == 0.0, "{measures:?}");
}

/// A tuning tries its start first and gives back nothing worse, and its file names the command that makes it.
#[test]
fn a_tuning_is_never_worse_than_its_start() {
    let folder = tempfile::tempdir().expect("a folder");
    for law in ["linear", "rules", "coupled", "leaky"] {
        let arguments = ["wall", "tune", "--law", law, "--start", "pd_tuned", "--stiffness", "7", "--hands", "2"];
        let more = ["--evaluations", "3", "--out", "new.toml", "--json"];
        let run = || {
            let output =
                dynid().current_dir(folder.path()).args(arguments).args(more).arg("--force").assert().success();
            let answer: serde_json::Value = serde_json::from_slice(&output.get_output().stdout).expect("JSON");
            (answer, std::fs::read_to_string(folder.path().join("new.toml")).expect("written"))
        };
        let (answer, file) = run();
        assert!(answer["cost"].as_f64() <= answer["cost_at_start"].as_f64(), "{answer}");
        let command = format!(
            "`dynid wall tune --law {law} --hands 2 --start pd_tuned --stiffness 7 --evaluations 3 --out new.toml`"
        );
        assert!(file.contains(&command), "{file}");
        assert_eq!(run().1, file, "the same bytes");
    }
}

/// What a model's drive does beside its gain is played; only a late command is refused.
#[test]
fn a_lag_of_the_drive_is_played_and_a_delay_is_refused() {
    let setting = Setting::shipped().expect("shipped");
    let wall = wall::shipped("pd_tuned").expect("shipped").wall(&setting).expect("a wall");
    let played = |model: &Model| contact(model, &setting, &wall, &setting.hand, &setting.approaches[0]);
    let plain = Model::of_device(setting.device);
    let chatter = |model: &Model| {
        let contact = played(model).expect("a contact");
        Measures::of(&contact, &wall).expect("it is met").chatter_rms
    };
    let mut lagging = plain.clone();
    lagging.add_effect("input_lag", Some(0), None).expect("added");
    lagging.set_value("joint.0.input_lag.T", 0.03).expect("its own");
    assert!(chatter(&lagging) > 2.0 * chatter(&plain), "{} {}", chatter(&lagging), chatter(&plain));
    let mut late = plain.clone();
    late.add_effect("input_delay", Some(0), None).expect("added");
    late.set_value("joint.0.input_delay.delay", 0.02).expect("its own");
    let message = played(&late).expect_err("late").to_string();
    assert!(
        message.contains("joint 0") && message.contains("0.02 s late") && message.contains("delay_samples"),
        "{message}"
    );
    // Nor is a wall tuned on it: no trial of it could tell one wall from another.
    let folder = tempfile::tempdir().expect("a folder");
    let tune = ["tune", "--model", "late.toml", "--hands", "1", "--evaluations", "2", "--out", "new.toml"];
    let message = wrong(folder.path(), "late.toml", &late.to_toml(), &tune);
    assert!(message.contains("0.02 s late") && !folder.path().join("new.toml").exists(), "{message}");
}

/// Hands that never come to the wall leave no numbers, and none is made up.
#[test]
fn walls_that_no_hand_meets_are_reported_with_dashes() {
    let folder = tempfile::tempdir().expect("a folder");
    let setting = String::from_utf8(dynid().args(["wall", "show", "setting"]).assert().get_output().stdout.clone());
    let setting = setting.expect("text");
    // An arm without strength gets nowhere in the time that a fast approach takes.
    let weak = setting.replacen("arm_stiffness = 4.0", "arm_stiffness = 1e-4", 1);
    let weak =
        weak.replacen("arm_damping = 0.8", "arm_damping = 1e-4", 1).replacen("slow = 0.7, medium = 1.5, ", "", 1);
    std::fs::write(folder.path().join("s.toml"), weak).expect("written");
    let arguments = ["wall", "compare", "--setting", "s.toml", "--hands", "1", "--wall", "pd,fuzzy"];
    let output = dynid().current_dir(folder.path()).args(arguments).assert().success().get_output().clone();
    let message = String::from_utf8(output.stdout).expect("text");
    assert!(!message.contains("NaN") && !message.contains("inf"), "{message}");
    assert!(message.contains('\u{2014}') && message.contains("fuzzy: no hand met both it and pd"), "{message}");
    let note = String::from_utf8(output.stderr).expect("text");
    assert!(note.contains("2 approaches never came to the wall"), "{note}");
}

/// A tuning starts from what its help names, and says so of the rest.
#[test]
fn a_tuning_starts_from_gains_or_from_its_own_kind() {
    let folder = tempfile::tempdir().expect("a folder");
    let tune = |law: &str, start: &str| {
        let arguments = ["wall", "tune", "--law", law, "--start", start, "--hands", "1", "--evaluations", "1"];
        dynid().current_dir(folder.path()).args(arguments).args(["--force", "--out", "new.toml"]).assert()
    };
    for law in ["leaky", "coupled"] {
        tune(law, law).success();
    }
    // A start whose share is beyond what a search tries is still the start.
    let leaky = wall::library().find(|(name, _)| *name == "leaky").expect("carried").1;
    std::fs::write(folder.path().join("l.toml"), leaky.replacen("share = 0.5", "share = 0.8", 1)).expect("written");
    tune("leaky", "l.toml").success();
    let refused = |law: &str, start: &str| -> String {
        String::from_utf8(tune(law, start).code(2).get_output().stderr.clone()).expect("text")
    };
    for (law, start) in [("rules", "fuzzy"), ("linear", "leaky"), ("leaky", "coupled"), ("coupled", "fuzzy")] {
        let message = refused(law, start);
        assert!(message.contains(&format!("--start {start}")) && message.contains("a wall of gains"), "{message}");
    }
    let message = refused("linear", "passive");
    assert!(message.contains("--start passive") && message.contains("`passive = true`"), "{message}");
    std::fs::write(folder.path().join("l.toml"), leaky.replacen("share = 0.5", "share = 0.0", 1)).expect("written");
    let message = refused("leaky", "l.toml");
    assert!(message.contains("share is 0") && message.contains("positive"), "{message}");
}

fn wrong(folder: &Path, name: &str, text: &str, arguments: &[&str]) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("written");
    let output = dynid().current_dir(folder).arg("wall").args(arguments).assert().code(2).get_output().clone();
    assert!(output.stdout.is_empty());
    String::from_utf8(output.stderr).expect("text")
}

#[test]
fn bad_input_is_reported_once_with_its_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let shown = |name: &str| {
        let output = dynid().args(["wall", "show", name]).assert().success().get_output().stdout.clone();
        String::from_utf8(output).expect("text")
    };
    let (setting, fuzzy) = (shown("setting"), shown("fuzzy"));
    let message = wrong(
        folder.path(),
        "w.toml",
        &fuzzy.replacen("0.0, 0.005", "0.005, 0.0", 1),
        &["compare", "--wall", "pd,w.toml"],
    );
    assert!(message.contains("w.toml:") && message.contains("does not lie above that before it"), "{message}");
    let message = wrong(
        folder.path(),
        "s.toml",
        &setting.replacen("step_s = 0.0005", "step_s = 0.05", 1),
        &["compare", "--setting", "s.toml"],
    );
    assert!(message.contains("s.toml:") && message.contains("longer than the controller's sample time"), "{message}");
    // Without a limit, gains a thousand times too high tear the joint away.
    let setting = setting.replacen("torque_limit = 1.0", "torque_limit = 1e12", 1);
    std::fs::write(folder.path().join("u.toml"), setting).expect("written");
    let mut pd = shown("pd");
    pd = pd.replacen("k2 = 100.0", "k2 = 1e6", 1);
    let message = wrong(folder.path(), "p.toml", &pd, &["run", "--wall", "p.toml", "--setting", "u.toml"]);
    assert!(message.contains("wall `p`, slow approach, the typical hand: the closed loop diverges at"), "{message}");
    assert!(message.contains("joint 0"), "{message}");
    let message = wrong(folder.path(), "p.toml", &pd, &["compare", "--wall", "pd,p.toml", "--setting", "u.toml"]);
    assert!(message.contains("wall `p`, slow approach, hand 0: the closed loop diverges at"), "{message}");
    let report = ["report", "--wall", "pd,p.toml", "--setting", "u.toml", "--out", "page.html"];
    let message = wrong(folder.path(), "p.toml", &pd, &report);
    assert!(message.contains("wall `p`, slow approach, the typical hand: the closed loop diverges at"), "{message}");
    assert!(!folder.path().join("page.html").exists());
    // A tuning multiplies its start.
    for (from, to) in [("k1 = 100.0", "k1 = -3.0"), ("k2 = 100.0", "k2 = 0.0")] {
        let start = shown("pd").replacen(from, to, 1);
        let message = wrong(folder.path(), "n.toml", &start, &["tune", "--start", "n.toml", "--out", "new.toml"]);
        assert!(message.contains("n.toml") && message.contains(&to[..2]) && message.contains("positive"), "{message}");
    }
    let message = wrong(folder.path(), "n.toml", "", &["tune", "--start", "fuzzy", "--out", "new.toml"]);
    assert!(message.contains("--start fuzzy") && message.contains("[linear]"), "{message}");
    assert!(!folder.path().join("new.toml").exists());
    let message = wrong(folder.path(), "x.toml", "", &["compare", "--wall", "fuzy"]);
    assert!(message.contains("unknown wall `fuzy`") && message.contains("fuzzy"), "{message}");
}

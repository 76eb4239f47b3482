//! A plane in space under the whole device: what must hold whatever the numbers are, and what a user meets.

use std::path::Path;

use assert_cmd::Command;
use dynid_control::{CompensationRatios, Law, LinearLaw, Wall};
use dynid_haptics::{wall, wall::Approach, wall::Measures};
use dynid_haptics::{wall::space, wall::space::Case, wall::space::Contact, wall::space::Setting, wall::space::contact};
use dynid_model::Parameter;
use dynid_plant::Mechanism;
use dynid_report::SpaceReport;
use dynid_user_model::Model;

fn dynid() -> Command {
    Command::cargo_bin("dynid").expect("the program")
}

fn parsed(text: &str) -> Setting {
    Setting::parse(text, Path::new("space.toml"), None).unwrap_or_else(|error| panic!("{error:?}"))
}

/// The model of a device with nothing but gains: no friction, no springs.
fn bare(device: &str) -> Model {
    let mut model = Model::of_device(dynid_model::device(device).expect("a shipped device"));
    model.effects.retain(|own| own.effect.id == "gain");
    model
}

fn fast(setting: &Setting) -> Approach {
    setting.reaching.approaches.last().expect("approaches").clone()
}

fn played(model: &Model, setting: &Setting, wall: &str, carried: Option<CompensationRatios>) -> (Wall, Contact) {
    let wall = setting.wall(&wall::shipped(wall).expect("shipped")).expect("a wall");
    let message =
        contact(model, setting, &wall, (&setting.people.typical, &fast(setting)), carried).expect("a contact");
    (wall, message)
}

/// A device with one sliding joint: the plane across it is the wall at the joint.
#[test]
fn a_plane_across_one_joint_is_the_wall_at_the_joint() {
    const COMMON: &str = "
        [controller]
        sample_s = 0.01
        delay_samples = 1
        position_quantum = 1e-4
        cutoff_hz = 15.0
        LIMIT
        [hand]
        INERTIA
        grip_stiffness = 40.0
        grip_damping = 0.1
        arm_stiffness = 4.0
        arm_damping = 0.8
        tightening = 0.5
        spread = 1.5
        count = 4
        seed = 1
        [approach]
        START
        aim = [0.03, 0.03]
        hold = [0.10, 0.08]
        relax_s = 0.15
        speeds = { slow = 0.7, fast = 2.6 }
        [simulation]
        step_s = 0.0005
        after_s = 2.5";
    let joint = COMMON
        .replace("LIMIT", "torque_limit = 1.0")
        .replace("INERTIA", "inertia = 0.03")
        .replace("START", "start = 0.4");
    let joint = wall::Setting::parse(&format!("device = \"oscillator\"\njoint = 0\n{joint}"), Path::new("j.toml"))
        .expect("a setting");
    let plane = COMMON
        .replace("LIMIT", "force_limit = 1.0")
        .replace("INERTIA", "mass = 0.03\nturning_stiffness = 1.0\nturning_damping = 0.0\nshakes = 0.5")
        .replace("START", "");
    let plane = "[plane]\npoint = [0.3, -0.2, 0.0]\nnormal = [0, 0, 1]\n".to_owned() + &plane;
    let plane = parsed(&format!("device = \"oscillator\"\nposture = [0.4]\n{plane}"));
    let mut model = bare("oscillator");
    model.set_value("link.1.m", 0.045).expect("a parameter");
    for wall in ["pd", "pd_tuned", "fuzzy", "leaky"] {
        for approach in &joint.approaches {
            for hand in joint.hand.population(joint.spread, joint.hands, joint.seed) {
                let file = wall::shipped(wall).expect("shipped");
                let (at_joint, in_space) = (file.wall(&joint).expect("a wall"), plane.wall(&file).expect("a wall"));
                let one = wall::contact(&model, &joint, &at_joint, &hand, approach).expect("a contact");
                let other = contact(&model, &plane, &in_space, (&hand, approach), None).expect("a contact");
                assert!(one.touched.is_some() && one.touched == other.along.touched, "{wall}");
                for (a, b) in one.position.iter().zip(&other.along.position) {
                    assert!((a - b).abs() < 1e-9, "{wall}: {a} {b}");
                }
                for (a, b) in one.torque.iter().zip(&other.along.torque) {
                    assert!((a - b).abs() < 1e-9, "{wall}: {a} {b}");
                }
                let measures = other.measures(&in_space, plane.lever).expect("a contact");
                let of_joint = Measures::of(&one, &at_joint).expect("a contact");
                assert!((measures.energy_out - of_joint.energy_out).abs() < 1e-9);
                assert!((measures.stiffness - of_joint.stiffness).abs() < 1e-9);
                let coupling = other.coupling(&plane).expect("a contact");
                assert!(coupling.slip == 0.0 && coupling.turned == 0.0);
            }
        }
    }
}

/// With the other joints locked, a plane across the handle's circle about joint 0 is the thesis's wall at joint 0, but for
/// the curvature of the circle.
#[test]
fn with_the_others_locked_a_plane_is_nearly_the_wall_at_the_joint() {
    let joint = wall::Setting::shipped().expect("shipped");
    let text = space::SETTING
        .replace("posture = [0.20, -0.41, 0.14, 0.0, 0.0, 0.0]", "free = [0]\nposture = [0.4, 0.0, 0.0, 0.0, 0.0, 0.0]")
        .replace("normal = [0.6, -0.48, 0.64]", "normal = [0.7546, -0.6562, 0.0]")
        .replace("torque_limits = [1.0, 1.0, 1.0, 0.3, 0.3, 0.3]", "torque_limits = [1.0]")
        // nor does the hand mind that the handle turns with the joint, as it does on the joint's own wall
        .replace("turning_stiffness = 2.0", "turning_stiffness = 1e-9")
        .replace("turning_damping = 0.02", "turning_damping = 0.0");
    let plane = parsed(&text);
    // Friction would leave each where it happened to stop.
    let model = bare("freedom6s");
    let file = wall::shipped("pd_tuned").expect("shipped");
    let (at_joint, in_space) = (file.wall(&joint).expect("a wall"), plane.wall(&file).expect("a wall"));
    for (slow, own) in joint.approaches.iter().zip(&plane.reaching.approaches) {
        let one = wall::contact(&model, &joint, &at_joint, &joint.hand, slow).expect("a contact");
        let hand = &plane.people.typical;
        let other = contact(&model, &plane, &in_space, (hand, own), None).expect("a contact");
        let one = Measures::of(&one, &at_joint).expect("it is met");
        let other = other.measures(&in_space, plane.lever).expect("it is met");
        let depth = other.settled_position / plane.lever;
        assert!((depth - one.settled_position).abs() < 0.03 * depth.abs(), "{depth} {}", one.settled_position);
        let stiffness = other.stiffness * plane.lever * plane.lever;
        assert!((stiffness - one.stiffness).abs() < 0.01 * stiffness, "{stiffness} {}", one.stiffness);
    }
}

/// What the hand and the wall put in is what the device then has: kinetic energy and height, by the plant.
#[test]
fn energy_is_accounted_for() {
    let text = space::SETTING.replace("step_s = 0.0005", "step_s = 0.0001").replace("after_s = 3.0", "after_s = 2.2");
    let setting = parsed(&text);
    let model = bare("freedom6s");
    let plant = Mechanism::new(model.device, &|name| model.parameter(name).map_or(0.0, |own| own.value));
    let (_, message) = played(&model, &setting, "pd", None);
    let energy = |tick: usize| plant.energy(&message.q[tick], &message.dq[tick]).iter().sum::<f64>();
    let (start, mut given, mut largest) = (energy(0), 0.0, 0.0_f64);
    let mut wall_share = 0.0_f64;
    for tick in 1..message.q.len() {
        given += message.given(tick - 1);
        wall_share = wall_share.max(given.abs());
        let missing = energy(tick) - start - given - message.hand_work[tick];
        largest = largest.max(missing.abs());
    }
    assert!(message.along.touched.is_some() && wall_share > 0.01, "{wall_share}");
    assert!(largest < 1e-6, "{largest} J are lost, of {wall_share} J that the wall moved");
}

/// At rest the wall's torques are those of the hand: `J^T n F + J^T f + J_w^T m = 0`, the weight being carried. What the hand
/// does at rest follows from its springs.
#[test]
fn what_settles_is_in_equilibrium() {
    let text = space::SETTING.replace("position_quantum = 1e-4", "position_quantum = 0.0");
    let setting = parsed(&text.replace("after_s = 3.0", "after_s = 25.0"));
    let model = bare("freedom6s");
    let (_, message) = played(&model, &setting, "pd_tuned", Some(CompensationRatios::WEIGHT));
    let last = message.q.len() - 1;
    let (hand, normal) = (&setting.people.typical, setting.plane.normal);
    let mut arm = model.kinematics(&setting.free, &setting.posture).expect("an end point");
    let (start, axes) = (arm.position(), arm.rotation());
    let away = setting.plane.distance(start);
    arm.move_to(&message.q[last]);
    let (point, hold) = (arm.position(), setting.reaching.hold_after(&fast(&setting)));
    // The arm's spring pulls to the foot of the way, the grip's spring is in series with it.
    let force = [0, 1, 2].map(|k| {
        let foot = start[k] - away * normal[k];
        let (grip, pull) = (hand.grip_stiffness, hand.arm_stiffness);
        let place = (pull * foot - hold * normal[k] + grip * point[k]) / (pull + grip);
        grip * (place - point[k])
    });
    // Half the antisymmetric part of R R0^T is the sine of the turn about its axis.
    let turned =
        nalgebra::Matrix3::from_row_slice(&arm.rotation()) * nalgebra::Matrix3::from_row_slice(&axes).transpose();
    let sine = [turned.m32 - turned.m23, turned.m13 - turned.m31, turned.m21 - turned.m12].map(|own| 0.5 * own);
    let moment = sine.map(|own| -setting.turning[0] * own);
    let mut torques = [0.0; 6];
    arm.torques(force, moment, &mut torques);
    for slot in 0..6 {
        assert!(message.dq[last][slot].abs() < 1e-7, "it has settled: {:?}", message.dq[last]);
        let sum = torques[slot] + message.torque[last][slot];
        assert!(sum.abs() < 1e-6, "joint {slot}: {} and {}", torques[slot], message.torque[last][slot]);
    }
    assert!(message.torque[last].iter().any(|torque| torque.abs() > 0.05), "{:?}", message.torque[last]);
    // and the wall's torques are those of a force along its normal
    let mut by_normal = [0.0; 6];
    arm.torques(normal.map(|own| own * message.along.torque[last]), [0.0; 3], &mut by_normal);
    assert!((0..6).all(|slot| (by_normal[slot] - message.torque[last][slot]).abs() < 1e-6));
}

/// Gravity is along the first axis: turned about it, plane and arm together, nothing else changes.
#[test]
fn turning_plane_and_arm_together_turns_everything() {
    let turn = 0.3_f64;
    let text = space::SETTING.replace("position_quantum = 1e-4", "position_quantum = 0.0");
    let setting = parsed(&text);
    let mut turned = setting.clone();
    let (sine, cosine) = turn.sin_cos();
    let about_z = |[x, y, z]: [f64; 3]| [cosine * x - sine * y, sine * x + cosine * y, z];
    turned.plane.normal = about_z(setting.plane.normal);
    turned.plane.point = about_z(setting.plane.point);
    turned.posture[0] += turn;
    let mut model = Model::of_device(setting.device);
    // a spring at the first joint knows where it is
    model.effects.retain(|own| own.joint != Some(0) || own.effect.id == "gain");
    for carried in [None, Some(CompensationRatios::WEIGHT)] {
        let (_, one) = played(&model, &setting, "pd_tuned", carried);
        let (_, other) = played(&model, &turned, "pd_tuned", carried);
        assert!(one.along.touched.is_some() && one.along.touched == other.along.touched);
        for tick in 0..one.q.len() {
            let apart = (0..6).map(|slot| {
                let shifted = if slot == 0 { turn } else { 0.0 };
                (other.q[tick][slot] - one.q[tick][slot] - shifted).abs()
            });
            let apart = apart.fold((one.along.position[tick] - other.along.position[tick]).abs(), f64::max);
            assert!(apart < 1e-9, "{apart} at tick {tick}");
        }
    }
}

/// The thesis's gains chatter in space as they do at the joint, tuned ones do not; a slanted plane moves several joints; and
/// with the weight carried a hand slips less and settles deeper.
#[test]
fn tuned_gains_are_still_in_space_too() {
    let cases = |more: &[&str]| {
        let all = [&["wall", "space", "--json", "--hands", "6"], more].concat();
        let output = dynid().args(all).assert().success().get_output().stdout.clone();
        let message: serde_json::Value = serde_json::from_slice(&output).expect("JSON");
        message["cases"].as_array().expect("cases").clone()
    };
    let bare = cases(&[]);
    assert_eq!(bare.len(), 3 * 3 * 6);
    let of = |cases: &[serde_json::Value], wall: &str, value: &dyn Fn(&serde_json::Value) -> f64| {
        let own = cases.iter().filter(|case| case["controller"] == wall && case["speed"] != "slow");
        wall::median(own.map(value).collect())
    };
    let number = |key: &'static str| move |case: &serde_json::Value| case[key].as_f64().expect("a number");
    let slip = |case: &serde_json::Value| case["coupling"]["settled_slip"].as_f64().expect("a number");
    assert!((7.0..11.0).contains(&of(&bare, "pd", &number("frequency"))));
    assert!(of(&bare, "pd", &number("chatter_rms")) > 1e-3);
    for wall in ["pd_tuned", "fuzzy_tuned"] {
        let ratio = of(&bare, "pd", &number("chatter_rms")) / of(&bare, wall, &number("chatter_rms"));
        assert!(ratio > 20.0, "{wall}: {ratio}");
        assert!(of(&bare, wall, &number("stiffness")) > 3.0 * of(&bare, "pd", &number("stiffness")));
    }
    let moved = |joint: usize| of(&bare, "pd_tuned", &|case| case["coupling"]["moved"][joint].as_f64().unwrap().abs());
    assert!((0..4).all(|joint| moved(joint) > 0.005), "{:?}", [0, 1, 2, 3].map(moved));
    let carried = cases(&["--compensate", "--wall", "pd_tuned"]);
    assert!(of(&carried, "pd_tuned", &slip) < of(&bare, "pd_tuned", &slip));
    let depth = |cases: &[serde_json::Value]| -of(cases, "pd_tuned", &number("settled_position"));
    assert!(depth(&bare) < 0.8 * depth(&carried), "{} {}", depth(&bare), depth(&carried));
}

/// What couples the joints while they move is their inertia: where a share of it is carried, the hand slips less. It takes a
/// fast controller.
#[test]
fn a_share_of_the_inertia_carried_lessens_the_slip() {
    let text = space::SETTING.replace("sample_s = 0.01 ", "sample_s = 0.001 ");
    let setting = parsed(&text);
    assert_eq!(setting.sampling.sample_s, 0.001);
    let model = Model::of_device(setting.device);
    let slip = |shares: CompensationRatios| {
        let (_, message) = played(&model, &setting, "pd_tuned", Some(shares));
        message.coupling(&setting).expect("it is met").settled_slip
    };
    let (none, fifth) = (slip(CompensationRatios::WEIGHT), slip(CompensationRatios { inertia: 0.2, friction: 0.0 }));
    assert!(fifth < 0.9 * none, "{fifth} of {none}");
}

/// A joint that reaches its limit shortens the force, and the measures say so.
#[test]
fn a_reached_limit_is_reported_and_the_force_keeps_its_direction() {
    let mut setting = Setting::shipped().expect("shipped");
    setting.torque_limits = vec![0.02; 6];
    let model = Model::of_device(setting.device);
    let law = Law::Linear(LinearLaw { k1: 474.2, k2: 17.13, offset: 0.0 });
    let wall = Wall::new(law, 0.03, setting.sampling.sample_s, 10.0).expect("a wall");
    let hand = (&setting.people.typical, &fast(&setting));
    let message = contact(&model, &setting, &wall, hand, Some(CompensationRatios::WEIGHT)).expect("a contact");
    let coupling = message.coupling(&setting).expect("it is met");
    assert!(coupling.limited > 0.9, "{coupling:?}");
    let largest = coupling.torque.iter().copied().fold(0.0, f64::max);
    assert!((largest - 0.02).abs() < 1e-12 && coupling.torque.iter().all(|torque| *torque <= 0.02 + 1e-12));
    // What acts from a tick on was asked for a tick before it, at the positions that were shown then.
    let mut arm = model.kinematics(&setting.free, &setting.posture).expect("an end point");
    let mut shortened = 0;
    for tick in 1..message.q.len() {
        let quantum = setting.sampling.position_quantum;
        arm.move_to(&message.q[tick - 1].iter().map(|q| (q / quantum).round() * quantum).collect::<Vec<f64>>());
        let mut expected = [0.0; 6];
        arm.torques(setting.plane.normal.map(|own| own * message.along.torque[tick]), [0.0; 3], &mut expected);
        let apart = (0..6).map(|slot| (expected[slot] - message.torque[tick][slot]).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-12, "{apart} N*m at tick {tick}, {} of the force", message.share[tick]);
        shortened += usize::from(message.share[tick] < 1.0);
    }
    assert!(shortened > 100, "{shortened}");
}

/// What no hand came to is said to be so on the page, which holds no dashes of medians of nothing.
#[test]
fn a_page_of_walls_that_no_hand_met_says_so() {
    let mut setting = Setting::shipped().expect("shipped");
    setting.people.count = 2;
    let model = Model::of_device(setting.device);
    let named = |name: &str| (name.to_owned(), setting.wall(&wall::shipped(name).expect("shipped")).expect("a wall"));
    let walls = [named("pd"), named("pd_tuned")];
    let cases = space::compare(&model, &setting, &walls, Some(CompensationRatios::WEIGHT)).expect("contacts");
    let some: Vec<Case> =
        cases.iter().filter(|case| case.controller == "pd" && case.speed != "slow").cloned().collect();
    let felt = |cases: &[Case]| {
        let report =
            SpaceReport::new(&model, &setting, &walls, cases, Some(CompensationRatios::WEIGHT)).expect("a report");
        report.sections()[0].html()
    };
    let (all, some) = (felt(&cases), felt(&some));
    assert!(!all.contains("no hand came to it"), "{all}");
    assert!(some.contains("<p><code>pd_tuned</code>: no hand came to it.</p>"), "{some}");
    // four rows of six: the slow approach to the one, all three to the other
    assert_eq!(some.matches("<td colspan=\"8\">no hand came to it</td>").count(), 4, "{some}");
    assert!(!some.contains("NaN") && !some.contains('\u{2014}'), "{some}");
}

/// Joints that slide are reported in mm and N.
#[test]
fn sliding_joints_have_units_of_their_own() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = space::SETTING
        .replace("freedom6s", "oscillator")
        .replace("posture = [0.20, -0.41, 0.14, 0.0, 0.0, 0.0]", "posture = [0.12]")
        .replace("point = [-0.2, -0.23, 0.0]", "point = [0, 0, 0]")
        .replace("normal = [0.6, -0.48, 0.64]", "normal = [0, 0, 1]")
        .replace("torque_limits = [1.0, 1.0, 1.0, 0.3, 0.3, 0.3]", "torque_limits = [inf]");
    std::fs::write(folder.path().join("s.toml"), text).expect("written");
    let mut model = bare("oscillator");
    let mass = model.parameter("link.1.m").expect("a parameter");
    model.set("link.1.m", Parameter { value: 0.3, upper: 1.0, ..mass }).expect("a parameter");
    std::fs::write(folder.path().join("m.toml"), model.to_toml()).expect("written");
    let asked = ["wall", "space", "--setting", "s.toml", "--model", "m.toml", "--hands", "2", "--wall", "pd_tuned"];
    let run = dynid().current_dir(folder.path()).args(asked).args(["--out", "page.html"]).assert().success();
    let message = String::from_utf8(run.get_output().stdout.clone()).expect("text");
    assert!(message.contains("q0, mm") && !message.contains("q0, mrad"), "{message}");
    let page = std::fs::read_to_string(folder.path().join("page.html")).expect("written");
    assert!(page.contains("force [N]") && !page.contains("torque [N*m]"));
}

/// The start is judged by the model that is given, not by the device's own lengths.
#[test]
fn the_start_is_that_of_the_model() {
    let mut model = Model::of_device(dynid_model::device("planar2r").expect("a shipped device"));
    let lengths: Vec<String> = model.names().into_iter().filter(|name| name.starts_with("length.")).collect();
    assert!(!lengths.is_empty());
    let postured = ["posture = [0.20, -0.41, 0.14, 0.0, 0.0, 0.0]", "posture = [0.3, 1.2]"];
    let place = model.kinematics(&[0, 1], &[0.3, 1.2]).expect("an end point").position();
    for name in &lengths {
        let value = model.parameter(name).expect("a length").value;
        model.set_value(name, 2.0 * value).expect("a length");
    }
    let far = model.kinematics(&[0, 1], &[0.3, 1.2]).expect("an end point").position();
    // The plane is across the way from the one end point to the other, between them; its normal points to the farther.
    let way = [0, 1, 2].map(|k| far[k] - place[k]);
    let length = way.iter().map(|own| own * own).sum::<f64>().sqrt();
    assert!(length > 0.1, "{length}");
    let text = space::SETTING
        .replace("freedom6s", "planar2r")
        .replace(postured[0], postured[1])
        .replace("[-0.2, -0.23, 0.0]", &format!("{:?}", [0, 1, 2].map(|k| 0.5 * (place[k] + far[k]))))
        .replace("[0.6, -0.48, 0.64]", &format!("{:?}", way.map(|own| own / length)))
        .replace("torque_limits = [1.0, 1.0, 1.0, 0.3, 0.3, 0.3]", "");
    let path = Path::new("s.toml");
    let started = Setting::parse(&text, path, Some(&model));
    assert!(started.is_ok(), "{}", started.expect_err("no start"));
    let message = Setting::parse(&text, path, None).expect_err("the device's own lengths").to_string();
    assert!(message.contains("inside of the wall"), "{message}");
}

fn wrong(folder: &Path, text: &str) -> String {
    std::fs::write(folder.join("s.toml"), text).expect("written");
    let asked = ["wall", "space", "--setting", "s.toml", "--out", "page.html"];
    let output = dynid().current_dir(folder).args(asked).assert().code(2).get_output().clone();
    assert!(output.stdout.is_empty() && !folder.join("page.html").exists());
    String::from_utf8(output.stderr).expect("text")
}

#[test]
fn bad_input_is_reported_once_with_its_place_and_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = dynid().args(["wall", "show", "space"]).assert().success().get_output().stdout.clone();
    let good = String::from_utf8(output).expect("text");
    let posture = "posture = [0.20, -0.41, 0.14, 0.0, 0.0, 0.0]";
    let cases = [
        ("normal = [0.6, -0.48, 0.64]", "normal = [0.6, -0.48, 0.7]", "has length", "divided by its length"),
        ("normal = [0.6, -0.48, 0.64]", "normal = [0.6, -0.48]", "three components", "base frame"),
        (posture, "posture = [-0.3, 0.3, -0.1, 0, 0, 0]", "inside of the wall", "start outside"),
        (posture, "posture = [0.20, -0.41, 0.14, 0.0, 0.0, \"pi/2\"]", "singular posture", "bend the arm"),
        (posture, "posture = [0.2]", "6 joints", "one position per joint"),
        ("device = \"freedom6s\"\n", "device = \"double_pendulum\"\n", "one position per joint", "2 joints"),
        ("mass = 0.32", "mass = 0", "`mass` is 0", "positive"),
        ("shakes = 0.15 ", "# ", "`shakes`", "positive number"),
        ("hold = [0.33, 0.86]", "hold = [-0.33, 0.86]", "pull out of the wall", "from 0"),
        ("hold = [0.33, 0.86]", "hold = [0.33]", "two numbers", "m/s"),
        (posture, "free = [5, 4]\nposture = [0.20, -0.41, 0.14, 0, 0, 0]", "joint 4 after joint 5", "[4, 5]"),
        (posture, "free = [4, 5, 5]\nposture = [0.20, -0.41, 0.14, 0, 0, 0]", "joint 5 after joint 5", "[4, 5]"),
        ("torque_limits = [1.0, 1.0, ", "torque_limits = [1.0, ", "has 5 numbers", "per free joint"),
    ];
    for (from, to, what, remedy) in cases {
        assert!(good.contains(from), "{from}");
        let message = wrong(folder.path(), &good.replacen(from, to, 1));
        assert!(message.contains("s.toml:") && message.contains(what) && message.contains(remedy), "{to}: {message}");
    }
    // a device without an end point, and a plane that it cannot move towards
    let other = |device: &str, posture: &str| {
        let text = good.replacen("freedom6s", device, 1).replacen(posture_line(&good), posture, 1);
        text.lines().filter(|line| !line.starts_with("torque_limits")).collect::<Vec<_>>().join("\n")
    };
    let message = wrong(folder.path(), &other("double_pendulum", "posture = [0.3, 0.4]"));
    assert!(
        message.contains("s.toml:") && message.contains("no end point") && message.contains("[end_point]"),
        "{message}"
    );
    let flat = other("planar2r", "posture = [0.3, 0.4]").replacen("[0.6, -0.48, 0.64]", "[0, 0, -1]", 1);
    let message = wrong(folder.path(), &flat.replacen("point = [-0.2, -0.23, 0.0]", "point = [0, 0, 0.1]", 1));
    assert!(message.contains("s.toml:") && message.contains("no joint moves the end point along"), "{message}");
}

fn posture_line(text: &str) -> &str {
    text.lines().find(|line| line.starts_with("posture")).expect("a posture")
}

/// The page stands alone, says what it was made from, and is not overwritten; any number of threads makes the same.
#[test]
fn the_page_holds_the_pictures_and_is_the_same_for_any_number_of_threads() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = |threads: &str, out: &str| {
        let asked = ["wall", "space", "--hands", "2", "--wall", "pd", "--compensate", "--json", "--out", out];
        dynid().current_dir(folder.path()).env("RAYON_NUM_THREADS", threads).args(asked).assert()
    };
    let one = run("1", "a.html").success().get_output().stdout.clone();
    let two = run("2", "b.html").success().get_output().stdout.clone();
    assert_eq!(one, two);
    let page = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("written");
    assert_eq!(page("a.html"), page("b.html").replace("b.html", "a.html"));
    let html = page("a.html");
    for heading in ["What a hand feels", "The way of the end point", "Depth", "Torques of the joints", "came from"] {
        assert!(html.contains(heading), "{heading}");
    }
    assert_eq!(html.matches("<svg class=\"dynid-plot\"").count(), 3 + 3 + 1);
    for outside in ["http", "src=", "href=", "@import", "url("] {
        assert!(!html.contains(outside), "{outside} in the page");
    }
    let message = run("1", "a.html").code(2).get_output().stderr.clone();
    assert!(String::from_utf8(message).expect("text").contains("--force"));
    assert_eq!(page("a.html"), html);
}

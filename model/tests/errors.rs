//! Every mistake in a device or effect file is told with its place, what was expected, and the remedy.

use std::path::Path;

use dynid_model::{Device, Effect};

const DEVICE: &str = include_str!("../devices/planar2r.toml");
const EFFECT: &str = include_str!("../effects/lugre.toml");

/// The error after replacing one piece of a good text.
fn told<T: std::fmt::Debug>(
    good: &str,
    from: &str,
    to: &str,
    parse: impl Fn(&str) -> Result<T, dynid_model::ModelError>,
) -> String {
    assert!(good.contains(from), "`{from}` is not in the file");
    let title = format!("--- `{}` -> `{}`", from.replace('\n', " "), to.replace('\n', " "));
    match parse(&good.replacen(from, to, 1)) {
        Ok(_) => panic!("accepted: {title}"),
        Err(error) => format!("{title}\n{error}"),
    }
}

fn device_errors(changes: &[(&str, &str)]) -> String {
    let parse = |text: &str| Device::parse(text, Path::new("arm.toml"));
    changes.iter().map(|(from, to)| told(DEVICE, from, to, parse)).collect::<Vec<_>>().join("\n\n")
}

#[test]
fn kinematics() {
    let told = device_errors(&[
        ("theta = \"q1\"", "theta = \"q7\""),
        ("a = \"L2\"", "a = \"L9\""),
        ("a = \"L2\"", "a = \"2 * L1 + M1\""),
        ("parent = \"f1\"", "parent = \"g1\""),
        ("parent = \"base\"", "parent = \"f2\""),
        ("parent = \"f1\"", "parent = \"f2\""),
        ("name = \"f2\"", "name = \"f1\""),
        ("theta = \"q1\"", "theta = 0"),
        ("theta = \"q1\"", "theta = \"q1 * q1\""),
        ("theta = \"q1\"", "theta = \"0 * q1\""),
        ("theta = \"q1\"", "theta = \"sin(q1)\""),
        ("theta = \"q1\"", "theta = \"q1 + L1\""),
        ("theta = \"q1\", d = 0", "theta = \"q1\", d = \"q1\""),
        ("theta = \"q1\"", "theta = \"q1 +\""),
        ("theta = \"q1\"", "theta = \"q1 + sinn(2)\""),
        ("theta = \"q1\", ", ""),
        ("\"standard\"", "\"standart\""),
        ("L1 = 0.4", "q1 = 0.4"),
        ("frame = \"f2\"", "frame = \"f3\""),
        ("frame = \"f2\"", "frame = \"f1\""),
        ("[end_point]\nframe = \"f2\"", "[end_point]\nframe = \"f3\""),
        ("[end_point]\nframe = \"f2\"", "[end_point]"),
        ("[end_point]", "[end_point]\npoint = [0, 1]"),
        ("[end_point]", "[end_point]\nwhere = 1"),
    ]);
    insta::assert_snapshot!(told);
}

#[test]
fn general_frames() {
    let first = "{ name = \"f1\", parent = \"base\", theta = \"q0\", d = 0, a = \"L1\", alpha = 0 }";
    let second = "{ name = \"f2\", parent = \"f1\", theta = \"q1\", d = 0, a = \"L2\", alpha = 0 }";
    let good = DEVICE
        .replacen("\"standard\"", "\"transform\"", 1)
        .replacen(first, "{ name = \"f1\", parent = \"base\", turn = \"q0\" }", 1)
        .replacen(
            second,
            "{ name = \"f2\", parent = \"f1\", xyz = [\"L1\", 0, 0], rpy = [0, 0, 0], turn = \"q1\" }",
            1,
        );
    let parse = |text: &str| Device::parse(text, Path::new("arm.toml"));
    assert!(parse(&good).is_ok(), "{:?}", parse(&good));
    let changes = [
        ("xyz = [\"L1\", 0, 0]", "xyz = [\"L1\", 0]"),
        ("xyz = [\"L1\", 0, 0]", "xyz = [\"L1\", \"q0\", 0]"),
        ("xyz = [\"L1\", 0, 0]", "xyz = [\"L9\", 0, 0]"),
        ("rpy = [0, 0, 0]", "rpy = [0, \"L1\", 0]"),
        ("rpy = [0, 0, 0]", "rpy = [0, 0, 0], matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]"),
        ("rpy = [0, 0, 0]", "matrix = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]"),
        ("rpy = [0, 0, 0]", "matrix = [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]"),
        ("rpy = [0, 0, 0]", "axis = [0, 0, 0]"),
        ("turn = \"q1\"", "turn = \"q1 * q1\""),
        ("turn = \"q1\"", "slide = \"q0\""),
        ("turn = \"q1\"", "turn = \"q1\", slide = \"q0\""),
        ("turn = \"q1\"", "theta = \"q1\""),
    ];
    let told: Vec<String> = changes.iter().map(|(from, to)| told(&good, from, to, parse)).collect();
    insta::assert_snapshot!(told.join("\n\n"));
}

#[test]
fn three_frames_in_a_cycle_are_all_named() {
    let row = "  { name = \"f2\", parent = \"f1\"";
    let rows = format!(
        "  {{ name = \"g1\", parent = \"g3\", theta = 0, d = 0, a = 0, alpha = 0 }},
  {{ name = \"g2\", parent = \"g1\", theta = 0, d = 0, a = 0, alpha = 0 }},
  {{ name = \"g3\", parent = \"g2\", theta = 0, d = 0, a = 0, alpha = 0 }},\n{row}"
    );
    let told = device_errors(&[(row, &rows)]);
    insta::assert_snapshot!(told);
}

#[test]
fn rows_may_stand_in_any_order() {
    let lines: Vec<&str> = DEVICE.lines().collect();
    let first = lines.iter().position(|line| line.contains("name = \"f1\"")).unwrap();
    let mut swapped = lines.clone();
    swapped.swap(first, first + 1);
    let device = Device::parse(&swapped.join("\n"), Path::new("planar2r.toml")).unwrap();
    assert_eq!(device.frames[0].name, "f1");
    assert_eq!(device.structure_digest(), dynid_model::device("planar2r").unwrap().structure_digest());
}

#[test]
fn quantities() {
    let told = device_errors(&[
        ("mass = \"kg\"\n", ""),
        ("command = \"N*m\"\n", ""),
        ("mass = \"kg\"", "mass = \"g\""),
        ("angle = \"rad\"", "angle = \"deg\""),
        ("command = \"N*m\"", "command = \"Nm\""),
        ("[units]", "[unit]"),
        ("m = 1.2", "m = -1.2"),
        ("m = 1.2", "m = { value = 1.2, lower = -0.1, upper = 2 }"),
        ("m = 1.2", "m = { value = 1.2, lower = 2, upper = 1 }"),
        ("m = 1.2", "m = { value = 1.2, lower = 2, upper = 3 }"),
        ("m = 1.2", "m = { value = 1.2, low = 1 }"),
        ("m = 1.2", "m = \"heavy\""),
        ("m = 1.2\n", ""),
        ("Izz = 1.612e-2", "Izz = 3.3e-2"),
        ("Ixy = 0.0", "Ixy = 0.1"),
        ("up = [0, 1, 0]", "up = [0, 2, 0]"),
        ("up = [0, 1, 0]", "up = [0, \"cos(b1)\", 0]"),
        ("up = [0, 1, 0]", "up = [0, 1]"),
        ("gravity = 9.81", "gravity = -9.81"),
        ("position = [\"-pi\", \"pi\"]", "position = [\"pi\", \"-pi\"]"),
        ("speed = 10.0\n", ""),
        ("torque = 20.0", "torque = 0"),
        ("mass = 0.5", "mass = [1, 0]"),
    ]);
    insta::assert_snapshot!(told);
}

#[test]
fn identification_and_effects() {
    let told = device_errors(&[
        ("[[0], [1], [0, 1]]", "[[0], [2]]"),
        ("[[0], [1], [0, 1]]", "[[0, 0]]"),
        ("[[0], [1], [0, 1]]", "[[0], [1], [0, 1], [1, 0]]"),
        ("[[0], [1], [0, 1]]", "[[0], []]"),
        ("sequence = [2, 1]", "sequence = [2, 4]"),
        ("sequence = [2, 1]", "sequence = [0]"),
        ("sequence = [2, 1]", "sequence = [2, 1]\nweights = [[1]]"),
        ("sequence = [2, 1]", "sequence = [2, 1]\nweights = [[1], [1, 2]]"),
        ("name = \"coupling\"", "name = \"isolated\""),
        ("id = \"viscous\"", "id = \"viscuos\""),
        ("id = \"viscous\"\njoint = 0", "id = \"viscous\"\njoint = 5"),
        ("id = \"viscous\"\njoint = 0", "id = \"viscous\""),
        ("Fv = 0.05", "Fw = 0.05"),
        ("Fv = 0.05", "Fv = -0.05"),
        ("id = \"viscous\"\njoint = 1", "id = \"viscous\"\njoint = 0"),
        (
            "[[effect]]\nid = \"viscous\"\njoint = 1",
            "[[effect]]\nid = \"stribeck\"\njoint = 0\n[[effect]]\nid = \"viscous\"\njoint = 1",
        ),
    ]);
    insta::assert_snapshot!(told);
}

#[test]
fn effects() {
    let parse = |text: &str| Effect::parse(text, Path::new("lugre.toml"));
    let changes = [
        ("rate = \"z_rate\"", "rate = \"z_rat\""),
        ("exp(-(ratio * ratio))", "exp(-(dq * dq))"),
        ("g = \"Fc + (Fs - Fc)", "g = \"Fc + (Fs - vs)"),
        ("sigma2 * dq\"", "sigma2 * q\""),
        ("rate = \"z_rate\"", "rate = \"z\""),
        ("unit = \"N*m/rad\"", "unit = \"N*m\""),
        ("unit = \"N*m/rad\"\n", ""),
        ("unit = \"N*m/rad\"", "unit = \"lbf\""),
        ("sigma2 * dq\"", "sigma2 * dq + Fc\""),
        ("null = 0.0\n", "null = 0.1\n"),
        ("initial = 1.0", "initial = -1.0"),
        ("symbol = \"sigma1\"", "symbol = \"sigma0\""),
        ("symbol = \"sigma1\"", "symbol = \"dq\""),
        ("symbol = \"sigma1\"", "symbol = \"mut\""),
        ("[terms]\n", "[terms]\nloop = \"dq\"\n"),
        ("inequalities = [\"Fs > Fc\"]", "inequalities = [\"Fs > Fd\"]"),
        ("inequalities = [\"Fs > Fc\"]", "inequalities = [\"Fs < Fc\"]"),
        ("place = \"joint\"", "place = \"joints\""),
        ("place = \"joint\"", "place = \"link\""),
        ("place = \"joint\"", "place = \"actuator\""),
        ("torque = \"sigma0", "force = \"sigma0"),
        ("seen_as = ", "seen = "),
        ("sigma2 = \"Fv\"", "sigma3 = \"Fv\""),
    ];
    let text: Vec<String> = changes.iter().map(|(from, to)| told(EFFECT, from, to, parse)).collect();
    insta::assert_snapshot!(text.join("\n\n"));
}

/// A user's own effect with a wrong formula: what the build prints of the file.
#[test]
fn wrong_formulas() {
    let parse = |text: &str| Effect::parse(text, Path::new("friction.toml"));
    let coulomb = include_str!("../effects/coulomb.toml");
    let law = coulomb.lines().find(|line| line.starts_with("torque = ")).expect("its law");
    let formulas = [
        "Fc * tanh(dp / v_eps)",
        "Fc * tanh(dq / v_eps",
        "Fc * tanh(dq / v_eps))",
        "Fc * tanh(dq / (v_eps]",
        "Fc * tanhh(dq / v_eps)",
        "Fc * tanh(dq, v_eps)",
        "Fc * tanh(dq / v_eps) +",
        "Fc tanh(dq / v_eps)",
        "Fc * dq ^ 2",
        "Fc * tanh(dq)",
        "Fc * dq",
        "Fc * tanh(dq / v_eps) + 0.1",
        "load_from * tanh(dq / v_eps)",
        "",
    ];
    let mut text: Vec<String> =
        formulas.iter().map(|formula| told(coulomb, law, &format!("torque = \"{formula}\""), parse)).collect();
    text.push(told(coulomb, law, "", parse));
    let null = coulomb.lines().find(|line| line.starts_with("null = ")).expect("its null");
    text.push(told(coulomb, &format!("{null}\n"), "", parse));
    insta::assert_snapshot!(text.join("\n\n"));
}

#[test]
fn ids_are_module_names() {
    let device = |name: &str| Device::parse(DEVICE, Path::new(name)).map(|device| device.id);
    let effect = |name: &str| Effect::parse(EFFECT, Path::new(name)).map(|effect| effect.id);
    for name in ["arm", "arm_2", "a1"] {
        let file = format!("{name}.toml");
        assert_eq!((device(&file).unwrap(), effect(&file).unwrap()), (name.to_owned(), name.to_owned()));
    }
    for name in
        ["my-arm", "Arm", "2r", "_arm", "", "gr\u{fc}n", "my arm", "loop", "gen", "kernel", "effect_library", "src"]
    {
        let file = format!("{name}.toml");
        for error in [device(&file).unwrap_err(), effect(&file).unwrap_err()] {
            let told = error.to_string();
            assert!(told.contains("the id `") && told.contains("rename the file"), "{told}");
        }
    }
    insta::assert_snapshot!(device("my-arm.toml").unwrap_err());
}

#[test]
fn a_law_that_breaks_at_rest_is_refused() {
    // At its null value this one is 0/0 where the joint stands still.
    let text = EFFECT.replacen("sigma2 * dq\"", "sigma2 * dq / abs(dq) * vs\"", 1);
    let error = Effect::parse(&text, Path::new("lugre.toml")).unwrap_err();
    assert!(error.message().contains("does not vanish"), "{error}");
}

/// Where each place's laws must vanish to, and what a law that does not is told.
#[test]
fn a_law_that_does_not_vanish_is_refused_at_every_place() {
    let effect = |place: &str, outputs: &str| {
        format!(
            "title = \"t\"\n{place}\nseen_as = \"s\"\nnot_seen_as = \"n\"\nsource = \"o\"\n\
             [[parameter]]\nsymbol = \"k\"\nunit = \"1\"\ntitle = \"t\"\ninitial = 0.5\nlower = 0\nupper = 1\nnull = 0\norigin = \"physics\"\n\
             [[parameter]]\nsymbol = \"c\"\nunit = \"N*m/command\"\ntitle = \"t\"\ninitial = 1\nlower = 1\nupper = 1\norigin = \"physics\"\n\
             [[parameter]]\nsymbol = \"a\"\nunit = \"s\"\ntitle = \"t\"\ninitial = 1\nlower = 1\nupper = 1\norigin = \"physics\"\n\
             [[parameter]]\nsymbol = \"w\"\nunit = \"kg\"\ntitle = \"t\"\ninitial = 1\nlower = 1\nupper = 1\norigin = \"physics\"\n\
             [[parameter]]\nsymbol = \"j\"\nunit = \"kg*m^2\"\ntitle = \"t\"\ninitial = 1\nlower = 1\nupper = 1\norigin = \"physics\"\n\
             [[parameter]]\nsymbol = \"r\"\nunit = \"rad\"\ntitle = \"t\"\ninitial = 1\nlower = 1\nupper = 1\norigin = \"physics\"\n\
             [[parameter]]\nsymbol = \"d\"\nunit = \"m\"\ntitle = \"t\"\ninitial = 1\nlower = 1\nupper = 1\norigin = \"physics\"\n\
             [output]\n{outputs}\n"
        )
    };
    let joint = |place: &str| format!("place = \"{place}\"\nscope = \"joint\"");
    let pair = |place: &str| format!("place = \"{place}\"\nscope = \"pair\"");
    let stage = |stage: &str| format!("{}\nstage = \"{stage}\"", joint("actuator"));
    // What vanishes, and what does not.
    let cases = [
        (stage("delay"), "delay = \"k * a\"", "delay = \"(k + 1) * a\""),
        (stage("lag"), "torque = \"(1 + k) * command\"", "torque = \"k * command\""),
        (stage("gain"), "torque = \"(k + c / c) * c * command\"", "torque = \"(k + 1.5) * c * command\""),
        (joint("transmission"), "torque = \"(1 + k) * load\"", "torque = \"k * load\""),
        (
            pair("transmission"),
            "torque = \"load\"\ntorque_from = \"k * load\"",
            "torque = \"load\"\ntorque_from = \"load\"",
        ),
        (joint("joint"), "torque = \"k * load\"", "torque = \"load\""),
        (
            pair("joint"),
            "torque = \"k * load\"\ntorque_from = \"-k * load\"",
            "torque = \"k * load\"\ntorque_from = \"load\"",
        ),
        (joint("link"), "inertia = \"k * j\"", "inertia = \"j\""),
        (joint("link"), "m = \"k * w\"\nx = \"d\"", "m = \"w\"\nx = \"d\""),
        (joint("link"), "Ixx = \"k * j\"", "Ixx = \"j\""),
        (joint("sensor"), "position = \"(1 + k) * q\"", "position = \"q + r\""),
    ];
    for (place, vanishes, remains) in &cases {
        Effect::parse(&effect(place, vanishes), Path::new("e.toml")).unwrap_or_else(|error| panic!("{place}\n{error}"));
        let error = Effect::parse(&effect(place, remains), Path::new("e.toml")).expect_err(place).to_string();
        assert!(error.contains("does not vanish at the null values (k = 0)") && error.contains("e.toml:"), "{error}");
    }
}

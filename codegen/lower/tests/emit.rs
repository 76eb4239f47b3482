//! The emitted Rust, as a person reviews it.

use std::path::Path;

use dynid_lower::Kir;
use dynid_lower::c99::{Linkage, definition};
use dynid_lower::effect::EffectKernels;
use dynid_lower::emit::{configuration_module, effects_module, end_point_module};
use dynid_lower::end_point::EndPoint;
use dynid_lower::kernel::Configuration;
use dynid_model::Effect;

fn planar2r() -> Configuration {
    Configuration::new(&Kir::parse(include_str!("kir/planar2r.kir"), Path::new("planar2r.kir")).unwrap()).unwrap()
}

#[test]
fn planar2r_module() {
    insta::assert_snapshot!(configuration_module(&planar2r(), &["link.1.m".to_owned()]).unwrap());
}

#[test]
fn a_missing_output_is_named() {
    let text = include_str!("kir/planar2r.kir").replace("output h_1", "output other");
    let kir = Kir::parse(&text, Path::new("planar2r.kir")).unwrap();
    insta::assert_snapshot!(Configuration::new(&kir).unwrap_err(), @"planar2r, configuration 1: output `h_1` is missing; write the equations anew with `cargo xtask gen --device planar2r --config 1`");
}

/// A function beyond the cap is cut into parts that pass shared terms in an array.
#[test]
fn long_functions_are_split() {
    let mut lines = vec!["let t0 = sin(q0);".to_owned()];
    for number in 1..3_000 {
        lines.push(format!("let t{number} = t{} * q0 + link_1_m;", number - 1));
    }
    lines.push("output tau_0 = t2999 + t5;".to_owned());
    let head =
        "device long\nconfiguration 1\nfree 0\nlocked none\nmodel sha256 0\nparameter link.1.m kg\nposition q0 rad\n";
    let text = format!("{head}{}\noutput D_0_0 = link_1_m;\noutput h_0 = link_1_m;\n", lines.join("\n"));
    let kir = Kir::parse(&text, Path::new("long.kir")).unwrap();
    let module = configuration_module(&Configuration::new(&kir).unwrap(), &[]).unwrap();
    let body =
        &module[module.find("pub fn inverse_dynamics<").unwrap()..module.find("pub fn forward_dynamics<").unwrap()];
    let interesting = body.lines().filter(|line| !line.contains("let t") || line.contains("shared"));
    insta::assert_snapshot!(interesting.collect::<Vec<_>>().join("\n"));
}

/// What a formula reads but nothing defines.
#[test]
fn an_unknown_symbol_of_an_effect_is_named() {
    let mut effect = dynid_model::effect("viscous").unwrap().clone();
    effect.parameters.clear();
    insta::assert_snapshot!(dynid_lower::effect::EffectKernels::new(&effect).unwrap_err(), @"effect `viscous`: `torque` reads `Fv`, which is none of its parameters, states, terms or signals (q, dq, ddq, t, load, friction, qeq, q_from, dq_from, command, command_from)");
}

/// A law of every operation; what is emitted of it has brackets only where they are needed.
const EVERYTHING: &str = r#"
title = "Everything"
place = "joint"
scope = "joint"
seen_as = "all"
not_seen_as = "none"
source = "Made up"

[[parameter]]
symbol = "F"
unit = "N*m"
title = "size"
initial = 0.5
lower = 0.0
upper = 1.0
null = 0.0
origin = "physics"

[[parameter]]
symbol = "width"
unit = "rad"
title = "width"
initial = 0.5
lower = 0.1
upper = 1.0
origin = "physics"

[[parameter]]
symbol = "vs"
unit = "rad/s"
title = "speed"
initial = 0.5
lower = 0.1
upper = 1.0
origin = "physics"

[terms]
x = "q / width"
v = "dq / vs"
height = "max(min(x, 1), -1) - (abs(v) - (x - 2))"
slope = "tan(x) / (sqrt(2 + abs(v)) / exp(x)) * ln(1 + x * x)"
turn = "sin(x) * cos(x) - tanh(-v) / (exp(-x) * (2 + v * v))"

[output]
torque = "if x > v { F * (height - slope) } else { -(F * turn) - F * sign(v) }"
"#;

fn everything() -> EffectKernels {
    EffectKernels::new(&Effect::parse(EVERYTHING, Path::new("everything.toml")).unwrap()).unwrap()
}

#[test]
fn effects_and_their_table() {
    let lugre = EffectKernels::new(dynid_model::effect("lugre").unwrap()).unwrap();
    insta::assert_snapshot!(effects_module(&[everything(), lugre]).unwrap());
}

#[test]
fn the_same_law_in_c() {
    insta::assert_snapshot!(definition("law", "own", &everything().eval, Linkage::Internal));
}

#[test]
fn where_the_end_point_is() {
    let end_point = EndPoint::new(dynid_model::device("planar2r").unwrap()).unwrap().expect("it has one");
    insta::assert_snapshot!(end_point_module(&end_point).unwrap());
}

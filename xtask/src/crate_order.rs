//! The order of crates: each may need only those of lower layers, so that every crate can be read, built and tested
//! with nothing but what is below it.
//!
//! All dependencies between members of the workspace count: normal ones, those of build scripts and those of tests.
//! The plant that makes tests' data stands low enough to be everybody's; no kind of dependency is excepted.

use std::collections::BTreeMap;

use anyhow::bail;

use crate::workspace::{self, Member};

/// Every crate of the workspace and what it is, from the lowest layer to the highest.
const LAYERS: &[&[(&str, &str)]] = &[
    &[
        ("dynid-random", "random numbers from a stated seed"),
        ("dynid-signal-chain", "where an effect sits between command and log, and the symbols of links"),
    ],
    &[
        ("dynid-model", "devices, effects and inputs as data, and their reader"),
        ("dynid-optimise", "optimisers, and what they leave open"),
        ("dynid-signal", "sampled signals: filters, spectra and their statistics"),
        ("dynid-tables", "files that hold logs, as columns of numbers"),
    ],
    &[
        ("dynid-files", "reading and writing whole files"),
        ("dynid-fleet", "what has changed on which of many robots"),
        ("dynid-lower", "named equations and effects to Rust and C"),
        ("dynid-plant", "an independent derivation, which tests are made of"),
        ("dynid-format", "how numbers and names are written for people"),
    ],
    &[("dynid-equations", "a device to its equations, over any exact arithmetic")],
    &[("dynid-derive", "the same by computer algebra"), ("dynid-generated", "the kernels of every device and effect")],
    &[
        ("dynid-compile", "programs to machine code, while the process runs"),
        ("dynid-dynamics", "equations with numbers: motion, torque, end point"),
    ],
    &[("dynid-kernels", "the kernels of any device, free joints and effect: compiled in, or made")],
    &[
        ("dynid-import", "other descriptions of robots to device files, and values back into them"),
        ("dynid-control", "what a real-time loop links"),
        ("dynid-logs", "experiments and their logs"),
    ],
    &[("dynid-user-model", "the user's model: effects, values, and the record of its fit")],
    &[
        ("dynid-export", "the user's model to what other programs read"),
        ("dynid-haptics", "virtual walls under simulated hands"),
        ("dynid-plan", "what the configurations of a device reveal"),
        ("dynid-torque", "the torque of a measured motion"),
    ],
    &[("dynid-identify", "from a model and logs to a fitted model")],
    &[
        ("dynid-check", "what logs cannot answer, and what looks wrong in them"),
        ("dynid-excite", "what to play so that motion tells the parameters, or two models apart"),
        ("dynid-judge", "how far a model is from logs, and where"),
    ],
    &[
        ("dynid-diagnose", "which physical effect a model lacks, and where"),
        ("dynid-first-guess", "what the header and the numbers of logs suggest"),
    ],
    &[("dynid-sentences", "findings as sentences, for text, page and JSON")],
    &[("dynid-report", "results for people: pictures and pages")],
    &[
        ("dynid", "the library that users see, and the program"),
        ("dynid-browser", "the live page in a real browser"),
        ("xtask", "the project's own commands"),
    ],
    &[
        ("dynid-fuzz", "every reader, the program and its server under damaged input"),
        ("dynid-python", "the library for Python"),
    ],
];

/// Packages that must be nowhere below a crate, whoever asks for them.
const NEVER_BELOW: &[(&str, &[&str], &str)] = &[
    (
        "dynid-control",
        &["serde", "csv", "toml", "rayon", "dynid-files", "dynid-compile"],
        "a real-time loop links it: it reads no files, starts no threads and compiles nothing",
    ),
    ("dynid-dynamics", &["serde", "dynid-files", "dynid-compile"], "a real-time loop links it: it reads no files"),
];

/// Fails on a dependency that points upwards, on a crate that has no place, and on what must not be below a crate.
pub fn check() -> anyhow::Result<()> {
    let members = workspace::members()?;
    let mut wrong = out_of_order(&members, LAYERS);
    for (name, barred, why) in NEVER_BELOW {
        for package in workspace::built_from(name, "normal")? {
            if barred.contains(&package.as_str()) {
                wrong.push(format!(
                    "`{name}` has `{package}` below it ({why}); `cargo tree -p {name} -e normal -i {package}` shows by \
                     what: take that dependency out"
                ));
            }
        }
    }
    if !wrong.is_empty() {
        bail!("{}", wrong.join("\n"));
    }
    println!("{} crates in {} layers, each needs only lower ones", members.len(), LAYERS.len());
    Ok(())
}

fn out_of_order(members: &[Member], layers: &[&[(&str, &str)]]) -> Vec<String> {
    let mut layer_of = BTreeMap::new();
    let mut wrong = Vec::new();
    for (layer, crates) in layers.iter().enumerate() {
        for (name, _) in *crates {
            if layer_of.insert(*name, layer).is_some() {
                wrong.push(format!("xtask/src/crate_order.rs names `{name}` twice; keep one of its places"));
            }
            if !members.iter().any(|member| member.name == *name) {
                wrong.push(format!(
                    "xtask/src/crate_order.rs names `{name}`, which the workspace does not have; remove it"
                ));
            }
        }
    }
    for member in members {
        let Some(layer) = layer_of.get(member.name.as_str()) else {
            wrong.push(format!(
                "`{}` has no place in the order of crates; name it in xtask/src/crate_order.rs, above all that it needs",
                member.name
            ));
            continue;
        };
        for dependency in &member.dependencies {
            let Some(other) = layer_of.get(dependency.package.as_str()) else { continue };
            if other >= layer {
                wrong.push(format!(
                    "{}: `{}` needs `{}` ([{}]), which is {} it; move what is shared to a crate below both, or change \
                     the order in xtask/src/crate_order.rs",
                    workspace::shown(&member.manifest),
                    member.name,
                    dependency.package,
                    dependency.kind.table(),
                    if other == layer { "beside" } else { "above" },
                ));
            }
        }
    }
    wrong
}

#[cfg(test)]
mod tests {
    use super::out_of_order;
    use crate::workspace::{Dependency, Kind, Member};

    fn member(name: &str, needs: &[(&str, Kind)]) -> Member {
        let dependency = |(package, kind): &(&str, Kind)| Dependency {
            package: (*package).to_owned(),
            identifier: (*package).to_owned(),
            kind: *kind,
            features: Vec::new(),
        };
        Member {
            name: name.to_owned(),
            manifest: format!("{name}/Cargo.toml").into(),
            dependencies: needs.iter().map(dependency).collect(),
            targets: Vec::new(),
        }
    }

    const LAYERS: &[&[(&str, &str)]] = &[&[("low", ""), ("lower", "")], &[("high", "")]];

    #[test]
    fn dependencies_point_downwards() {
        let members =
            [member("low", &[("serde", Kind::Normal)]), member("lower", &[]), member("high", &[("low", Kind::Normal)])];
        assert_eq!(out_of_order(&members, LAYERS), [""; 0]);
    }

    #[test]
    fn a_dependency_upwards_or_sideways_is_told_of_every_kind() {
        let members = [
            member("low", &[("high", Kind::Normal), ("high", Kind::Development)]),
            member("lower", &[("low", Kind::Build)]),
            member("high", &[]),
        ];
        let wrong = out_of_order(&members, LAYERS);
        assert_eq!(wrong.len(), 3, "{wrong:?}");
        assert!(wrong[0].starts_with("low/Cargo.toml: `low` needs `high` ([dependencies]), which is above it"));
        assert!(wrong[1].contains("([dev-dependencies])"));
        assert!(wrong[2].contains("([build-dependencies]), which is beside it"));
    }

    #[test]
    fn a_crate_without_a_place_and_a_place_without_a_crate_are_told() {
        let wrong = out_of_order(&[member("low", &[]), member("high", &[]), member("new", &[])], LAYERS);
        assert_eq!(wrong.len(), 2, "{wrong:?}");
        assert!(wrong[0].contains("names `lower`, which the workspace does not have"));
        assert!(wrong[1].contains("`new` has no place"));
    }

    #[test]
    fn the_crates_keep_their_order() {
        super::check().unwrap();
    }
}

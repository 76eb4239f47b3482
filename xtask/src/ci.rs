//! `cargo xtask ci`: every check that a change must pass, on a machine that has a Rust toolchain and, for the live page, Chromium, for the
//! wheel Python, for the book mdBook.

use std::collections::BTreeMap;
use std::fs;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, bail};
use dynid_lower::Kir;

use crate::{
    api, book, browser, crate_order, dependency_cycles, licences, shell, size, snapshots, unused, wheel, workspace,
};

/// Runs every check.
#[derive(clap::Args)]
pub struct Arguments {
    /// Leave out what compiles Symbolica: the tests of `derive`, and that
    /// `generated/` is what it writes.
    #[arg(long)]
    quick: bool,
}

type Check = fn() -> anyhow::Result<()>;

/// Crates that must build without Symbolica.
const WITHOUT_ALGEBRA: [&str; 5] = ["dynid", "dynid-equations", "dynid-generated", "dynid-lower", "dynid-model"];

/// Runs the checks in order and stops at the first that fails.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let mut checks: Vec<(&str, Check)> = vec![
        ("formatting", formatting),
        ("the order of crates", crate_order::check),
        ("no circle between folders", dependency_cycles::check),
        ("unused dependencies", unused::check),
        ("size of the diagnosis", size::print),
        ("the facade's public API", api::check),
        ("no computer algebra in what users build", without_algebra),
        ("equations belong to the models", equations_match_models),
        ("lints", lints),
        ("the library without the program", library_alone),
        ("tests", tests),
        ("the live page in a browser", browser::tests),
        ("the wheel for Python", wheel::tests),
        ("the loop as a program", example),
        ("documentation", documentation),
        ("the book", book::build),
        ("licences", licences::check),
    ];
    #[cfg(unix)]
    checks.extend([
        ("damaged requests to the page", crate::fuzz::short as Check),
        ("faults on purpose", crate::torture::short),
    ]);
    if !arguments.quick {
        checks.push(("lints of derive", derive_lints));
        checks.push(("tests of derive", derive_tests));
        checks.push(("equations are what derive writes", equations_are_fresh));
    }
    let started = Instant::now();
    let n_checks = checks.len();
    for (number, (title, check)) in (1..).zip(checks) {
        eprintln!("\n== {number}/{n_checks} {title}");
        let begun = Instant::now();
        check().with_context(|| format!("{title} failed"))?;
        eprintln!("== {number}/{n_checks} {title}: passed in {:.0} s", begun.elapsed().as_secs_f64());
    }
    eprintln!("\nall {n_checks} checks passed in {:.0} s", started.elapsed().as_secs_f64());
    Ok(())
}

fn formatting() -> anyhow::Result<()> {
    shell::succeed(&mut shell::cargo(&["fmt", "--all", "--check"]))
}

fn lints() -> anyhow::Result<()> {
    shell::succeed(&mut shell::cargo_on_all("clippy", &["--all-targets", "--", "-D", "warnings"]))
}

/// What only the program needs. (`anyhow`, which it needs too, comes with the compiler of kernels.)
const OF_THE_PROGRAM: [&str; 3] = ["clap", "indicatif", "signal-hook"];

/// A program that only computes compiles nothing of the command line.
fn library_alone() -> anyhow::Result<()> {
    let without = ["--package", "dynid", "--no-default-features", "--locked"];
    let tree = ["tree", "--edges", "normal", "--prefix", "none"];
    let tree = shell::stdout_of(&mut shell::cargo(&[&tree[..], &without].concat()))?;
    let named = |line: &&str| OF_THE_PROGRAM.iter().any(|name| line.split(' ').next() == Some(name));
    if let Some(line) = tree.lines().find(named) {
        bail!("the library without its feature `cli` depends on {line}; make it optional, as a part of `cli`");
    }
    let lint = ["clippy", "--release", "--lib"];
    shell::succeed(shell::cargo(&[&lint[..], &without].concat()).args(["--", "-D", "warnings"]))
}

/// The example that goes through the loop ends well, and brings the error down to the noise.
fn example() -> anyhow::Result<()> {
    let mut library = Command::new(shell::built_for_tests("examples/library")?);
    let said = shell::stdout_of(library.current_dir(shell::root()))?;
    print!("{said}");
    let last =
        said.lines().rev().find_map(|line| line.strip_prefix("better: ")?.split(' ').next()?.parse::<f64>().ok());
    match last {
        Some(rmse) if rmse < 1.5 * dynid_plant::hidden::noise_floor() => Ok(()),
        _ => bail!("examples/library.rs did not bring the error of the held-out runs down to the noise of its logs"),
    }
}

/// Unit, integration and doc tests; then the snapshots that they did not ask for.
fn tests() -> anyhow::Result<()> {
    let references = shell::root().join("target/snapshot-references.txt");
    if let Some(folder) = references.parent() {
        fs::create_dir_all(folder)?;
    }
    fs::write(&references, "")?;
    let mut command = shell::cargo_test(&["--no-fail-fast"]);
    command.env("INSTA_UPDATE", "no").env("INSTA_SNAPSHOT_REFERENCES_FILE", &references);
    shell::succeed(&mut command)?;
    // derive's own snapshots are looked at by its own tests
    snapshots::check(&shell::root(), &references)
}

fn documentation() -> anyhow::Result<()> {
    let mut command = shell::cargo_on_all("doc", &["--no-deps", "--document-private-items"]);
    shell::succeed(command.env("RUSTDOCFLAGS", "-D warnings"))
}

/// Symbolica is compiled only by those who change a device's structure.
fn without_algebra() -> anyhow::Result<()> {
    for package in WITHOUT_ALGEBRA {
        let packages = workspace::built_from(package, "normal,build")?;
        if let Some(name) = packages.iter().find(|name| name.starts_with("symbolica")) {
            bail!("{package} depends on {name}; only `dynid-derive` may");
        }
    }
    Ok(())
}

/// Every configuration has its equations, made of the device as it is now, and there are no others.
fn equations_match_models() -> anyhow::Result<()> {
    let folder = shell::root().join("generated");
    let mut expected = BTreeMap::new();
    for device in dynid_model::devices() {
        for number in 1..=device.configurations.len() {
            expected.insert(format!("{}/c{number:02}.kir", device.id), device.structure_digest());
        }
    }
    let n_expected = expected.len();
    for entry in fs::read_dir(&folder).with_context(|| format!("reading {}", folder.display()))? {
        let path = entry?.path();
        let device = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if !path.is_dir() || ["src", "tests", "benches"].contains(&device.as_str()) {
            continue;
        }
        for entry in fs::read_dir(&path)? {
            let path = entry?.path();
            if path.extension().is_none_or(|extension| extension != "kir") {
                continue;
            }
            let name = format!("{device}/{}", path.file_name().unwrap_or_default().to_string_lossy());
            let digest = expected
                .remove(&name)
                .with_context(|| format!("generated/{name}: no device asks for it; remove it"))?;
            let kir = Kir::parse(&fs::read_to_string(&path)?, &path)?;
            if kir.model_sha256 != digest {
                bail!("generated/{name}: made for another structure of the device; run `cargo xtask gen`");
            }
        }
    }
    if let Some(name) = expected.keys().next() {
        bail!("generated/{name} is missing; run `cargo xtask gen`");
    }
    println!("{n_expected} configurations, each with the equations of its device as it stands");
    Ok(())
}

fn derive_lints() -> anyhow::Result<()> {
    shell::succeed(&mut shell::cargo(&[
        "clippy",
        "--release",
        "--package",
        "dynid-derive",
        "--all-targets",
        "--locked",
        "--target-dir",
        "target/derive",
        "--",
        "-D",
        "warnings",
    ]))
}

/// One after another: an unlicensed Symbolica runs once at a time on a machine.
fn derive_tests() -> anyhow::Result<()> {
    let mut command = shell::cargo(&[
        "test",
        "--release",
        "--package",
        "dynid-derive",
        "--locked",
        "--target-dir",
        "target/derive",
        "--",
        "--test-threads=1",
    ]);
    shell::succeed(command.env("INSTA_UPDATE", "no").env("SYMBOLICA_HIDE_BANNER", "1"))
}

fn equations_are_fresh() -> anyhow::Result<()> {
    shell::succeed(&mut shell::cargo(&["xtask", "gen", "--check"]))
}

#[cfg(test)]
mod tests {
    #[test]
    fn no_computer_algebra_below_what_users_build() {
        super::without_algebra().unwrap();
    }
}

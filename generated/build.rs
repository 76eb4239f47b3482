//! Lowers the equations (`<device>/c<NN>.kir`), the kinematics of the end points and the effects to Rust.
//!
//! Where a device's equations are missing or belong to another structure of the device, they are derived anew, with the arithmetic of
//! our own. An effect's edit, and no edit at all, never derive anything.

#[path = "build/structure.rs"]
mod structure;

use std::error::Error;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use dynid_equations::{Options, exact::Exact};
use dynid_lower::effect::EffectKernels;
use dynid_lower::emit::{configuration_module, effects_module, end_point_module};
use dynid_lower::end_point::EndPoint;
use dynid_lower::kernel::Configuration;
use dynid_lower::{Kir, KirError};
use dynid_model::Device;

fn main() {
    if let Err(error) = build() {
        println!("cargo::error={}", error.to_string().replace('\n', " "));
    }
}

fn build() -> Result<(), Box<dyn Error>> {
    let equations = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR")?);
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=build");

    let mut library = String::new();
    let (mut table, mut end_points) = (Vec::new(), Vec::new());
    for device in dynid_model::devices() {
        let folder = equations.join(&device.id);
        // Cargo takes a missing path for changed, every time; a folder that appears changes the one above.
        let watched = if folder.is_dir() { &folder } else { &equations };
        println!("cargo::rerun-if-changed={}", watched.display());
        writeln!(library, "/// Kernels of `{}`, a module per configuration.", device.id)?;
        writeln!(library, "pub mod {} {{", device.id)?;
        let derived = device_equations(device, &folder)?;
        let appearing = structure::appearing(device, &derived.structure)?;
        for (kir, appearing) in derived.equations.iter().zip(&appearing) {
            let configuration = Configuration::new(kir)?;
            let name = format!("c{:02}", configuration.number);
            let path = out.join(format!("{}_{name}.rs", device.id));
            fs::write(&path, configuration_module(&configuration, appearing)?)?;
            writeln!(library, "#[allow(non_snake_case, unused_variables, clippy::all)]")?;
            writeln!(library, "#[path = {path:?}]\npub mod {name};")?;
            table.push(format!("&{}::{name}::KERNEL", device.id));
        }
        if let Some(end_point) = EndPoint::new(device)? {
            let path = out.join(format!("{}_end_point.rs", device.id));
            fs::write(&path, end_point_module(&end_point)?)?;
            writeln!(
                library,
                "#[allow(non_snake_case, unused_variables, clippy::all)]\n#[path = {path:?}]\npub mod end_point;"
            )?;
            end_points.push(format!("&{}::end_point::END_POINT", device.id));
        }
        writeln!(library, "}}")?;
    }
    writeln!(library, "static KERNELS: &[&Kernel] = &[{}];", table.join(", "))?;
    writeln!(library, "static END_POINTS: &[&EndPoint] = &[{}];", end_points.join(", "))?;

    let effects = dynid_model::effects().iter().map(EffectKernels::new).collect::<Result<Vec<_>, _>>()?;
    let path = out.join("effect_library.rs");
    fs::write(&path, effects_module(&effects)?)?;
    writeln!(library, "/// Every effect's generic functions, a module per effect.")?;
    writeln!(library, "#[allow(non_snake_case, unused_variables, clippy::all)]")?;
    writeln!(library, "#[path = {path:?}]\npub mod effect_library;")?;
    fs::write(out.join("library.rs"), library)?;
    Ok(())
}

/// The equations of all configurations of a device: those that are checked in, or else derived ones.
fn device_equations(device: &Device, checked_in: &Path) -> Result<Derived, Box<dyn Error>> {
    let reason = match read(device, checked_in, |path| fs::read_to_string(path).ok())? {
        Found::Current(derived) => return Ok(derived),
        Found::Stale(reason) => reason,
    };
    let again = format!("run `cargo xtask gen --device {}` and commit the result", device.id);
    println!("cargo::warning={}: {reason}; they were derived anew for this build; {again}", device.id);
    let files = dynid_equations::generate::<Exact>(device, &Options::default())?;
    match read(device, Path::new(&device.id), |path| files.get(path).cloned())? {
        Found::Current(derived) => Ok(derived),
        Found::Stale(reason) => Err(format!("{}: derived anew, but {reason}", device.id).into()),
    }
}

/// What is known about a device.
struct Derived {
    /// One per configuration.
    equations: Vec<Kir>,
    /// The text of `structure.toml`.
    structure: String,
}

/// What a folder of equations is worth.
enum Found {
    /// Those of the device as it is.
    Current(Derived),
    /// Not so, and why.
    Stale(String),
}

fn read(device: &Device, folder: &Path, text: impl Fn(&Path) -> Option<String>) -> Result<Found, KirError> {
    let digest = device.structure_digest();
    let other = || Ok(Found::Stale("the equations belong to another structure of the device".to_owned()));
    let mut equations = Vec::new();
    for number in 1..=device.configurations.len() {
        let path = folder.join(format!("c{number:02}.kir"));
        let Some(text) = text(&path) else {
            return Ok(Found::Stale(format!("the equations of configuration {number} do not exist")));
        };
        let kir = Kir::parse(&text, &path)?;
        if kir.model_sha256 != digest {
            return other();
        }
        equations.push(kir);
    }
    let Some(structure) = text(&folder.join("structure.toml")) else {
        return Ok(Found::Stale("`structure.toml` does not exist".to_owned()));
    };
    if !structure.contains(&digest) {
        return other();
    }
    Ok(Found::Current(Derived { equations, structure }))
}

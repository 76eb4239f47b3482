//! Embeds `devices/*.toml`, `effects/*.toml` and `inputs/*.toml` after reading them with the crate's own readers: a shipped file that
//! is wrong fails the build, with an error that points at the line.

// The readers are compiled here a second time; what only the library offers is unused.
#![allow(dead_code, unused_imports, missing_docs)]

#[path = "src/device.rs"]
mod device;
#[path = "src/device_reader.rs"]
mod device_reader;
#[path = "src/document.rs"]
mod document;
#[path = "src/effect.rs"]
mod effect;
#[path = "src/effect_reader.rs"]
mod effect_reader;
#[path = "src/error.rs"]
mod error;
#[path = "src/expression.rs"]
mod expression;
#[path = "src/identifier.rs"]
mod identifier;
#[path = "src/input.rs"]
mod input;
#[path = "src/instance.rs"]
mod instance;
#[path = "src/parameter.rs"]
mod parameter;
#[path = "src/parser.rs"]
mod parser;
#[path = "src/physical_consistency.rs"]
mod physical_consistency;
#[path = "src/shipped.rs"]
mod shipped;
#[path = "src/transform.rs"]
mod transform;
#[path = "src/unit.rs"]
mod unit;

use std::{env, fmt::Write, fs, io, path::Path, process::ExitCode};

use device::{Device, Link};
use expression::Expression;
use parameter::Parameter;

fn main() -> ExitCode {
    println!("cargo::rerun-if-changed=devices");
    println!("cargo::rerun-if-changed=effects");
    println!("cargo::rerun-if-changed=inputs");
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            for line in message.lines() {
                println!("cargo::error={line}");
            }
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), String> {
    let root = env::var("CARGO_MANIFEST_DIR").map_err(|error| error.to_string())?;
    let out = env::var("OUT_DIR").map_err(|error| error.to_string())?;
    let read = |folder: &str| {
        let shown = format!("model/{folder}");
        files(&Path::new(&root).join(folder), &shown).map_err(|error| format!("reading {shown}: {error}"))
    };
    let (device_files, effect_files, input_files) = (read("devices")?, read("effects")?, read("inputs")?);
    let pairs: Vec<(&str, &str)> = effect_files.iter().map(|file| (file.shown.as_str(), file.text.as_str())).collect();
    let effects = shipped::read_effects(&pairs).map_err(|error| error.to_string())?;
    let mut devices = Vec::new();
    for file in &device_files {
        let device = Device::parse_with(&file.text, Path::new(&file.shown), &effects);
        devices.push(device.map_err(|error| error.to_string())?);
    }
    for file in &input_files {
        let path = Path::new(&file.shown);
        let id = path.file_stem().unwrap_or_default();
        let device = devices.iter().find(|device| id == device.id.as_str());
        let device = device.ok_or_else(|| format!("{}: no device has this name; rename the file", file.shown))?;
        input::NamedInput::parse(&file.text, path, device).map_err(|error| error.to_string())?;
    }
    let mut code = String::new();
    for (name, files) in
        [("DEVICE_FILES", &device_files), ("EFFECT_FILES", &effect_files), ("INPUT_FILES", &input_files)]
    {
        // Writing to a string cannot fail.
        let _ = writeln!(code, "const {name}: &[(&str, &str)] = &[");
        for file in files {
            let _ = writeln!(code, "    ({:?}, include_str!({:?})),", file.shown, file.path);
        }
        let _ = writeln!(code, "];");
    }
    fs::write(Path::new(&out).join("library.rs"), code).map_err(|error| format!("writing library.rs: {error}"))
}

struct File {
    /// Absolute.
    path: String,
    /// From the repository's root, for messages.
    shown: String,
    text: String,
}

/// The TOML files of a folder, by name. Messages show it as `shown`.
fn files(folder: &Path, shown: &str) -> io::Result<Vec<File>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            let stem = path.file_name().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
            let text = fs::read_to_string(&path)?;
            files.push(File { path: path.display().to_string(), shown: format!("{shown}/{stem}"), text });
        }
    }
    files.sort_by(|a, b| a.shown.cmp(&b.shown));
    Ok(files)
}

//! `cargo xtask gen`: derive writes (or checks) the equations, lower counts the kernels made of them.
//!
//! derive runs in a cargo of its own with its own target folder, so that Symbolica is compiled for this command alone
//! and never for `cargo build`.

use std::fmt::Write;
use std::fs;
use std::process::Stdio;

use anyhow::{Context, bail};
use dynid_lower::Kir;
use dynid_lower::kernel::Configuration;
use serde_json::{Value, json};

use crate::{BadInput, shell};

/// Derives the equations and prints the kernels.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cargo xtask gen                                  all devices
  cargo xtask gen --device freedom6s --config 1    one configuration
  cargo xtask gen --check                          fails where a file in generated/ is not what derive writes

The first run compiles Symbolica, which takes minutes; later runs take seconds a device.")]
pub struct Arguments {
    /// Only this device.
    #[arg(long)]
    device: Option<String>,
    /// Only this configuration of it, counted from 1.
    #[arg(long, requires = "device", value_name = "N")]
    config: Option<usize>,
    /// Write nothing; fail where a file is not what would be written.
    #[arg(long)]
    check: bool,
    /// Print one JSON array on stdout, an object per kernel, and nothing else there.
    #[arg(long)]
    json: bool,
}

/// Runs derive, then reads what stands in `generated/`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let files = files(arguments)?;
    derive(arguments)?;
    let mut reported = Vec::new();
    let mut text = String::new();
    for (device, number) in files {
        let path = shell::root().join("generated").join(&device).join(format!("c{number:02}.kir"));
        let source = fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))?;
        let kir = Kir::parse(&source, &path)?;
        let configuration = Configuration::new(&kir)?;
        reported.extend(kernels(&configuration));
        describe(&mut text, &kir, &configuration);
    }
    if arguments.json {
        println!("{}", Value::Array(reported));
    } else {
        print!("{text}");
    }
    Ok(())
}

/// Device and number of every configuration that the arguments ask for.
fn files(arguments: &Arguments) -> anyhow::Result<Vec<(String, usize)>> {
    let devices = dynid_model::devices();
    let known = || devices.iter().map(|device| device.id.as_str()).collect::<Vec<_>>().join(", ");
    if let Some(id) = &arguments.device
        && dynid_model::device(id).is_none()
    {
        bail!(BadInput(format!("there is no device `{id}`; known are {}", known())));
    }
    let mut files = Vec::new();
    for device in devices.iter().filter(|device| arguments.device.as_ref().is_none_or(|id| *id == device.id)) {
        let n_configurations = device.configurations.len();
        if let Some(number) = arguments.config
            && !(1..=n_configurations).contains(&number)
        {
            bail!(BadInput(format!("{} has configurations 1 to {n_configurations}, not {number}", device.id)));
        }
        let numbers = (1..=n_configurations).filter(|number| arguments.config.is_none_or(|asked| asked == *number));
        files.extend(numbers.map(|number| (device.id.clone(), number)));
    }
    Ok(files)
}

fn derive(arguments: &Arguments) -> anyhow::Result<()> {
    let mut command = shell::cargo(&[
        "run",
        "--release",
        "--locked",
        "--package",
        "dynid-derive",
        "--target-dir",
        "target/derive",
        "--",
    ]);
    if let Some(device) = &arguments.device {
        command.args(["--device", device]);
    }
    if let Some(number) = arguments.config {
        command.args(["--config", &number.to_string()]);
    }
    if arguments.check {
        command.arg("--check");
    }
    // stdout is for the kernels
    command.stdout(stderr_of_ours()).env("SYMBOLICA_HIDE_BANNER", "1");
    shell::succeed(&mut command)
}

/// A child's stdout joined to our stderr.
fn stderr_of_ours() -> Stdio {
    Stdio::from(std::io::stderr())
}

/// What a kernel is called in print: by its symbol where the field has one.
fn symbol(function: &str) -> &str {
    match function {
        "inertia" => "D",
        "coriolis" => "C",
        "gravity" => "phi",
        "bias" => "h",
        "inertia_and_bias" => "D and h",
        "inverse_dynamics" => "tau",
        "regressor" => "Y",
        other => other,
    }
}

fn kernels(configuration: &Configuration) -> Vec<Value> {
    let prepare = &configuration.prepare_counts;
    let of = |function: &dynid_lower::kernel::Function| {
        let counts = function.program.operations();
        json!({
            "device": configuration.device,
            "configuration": configuration.number,
            "kernel": symbol(function.name),
            "form": function.form,
            "adds": counts.adds,
            "muls": counts.muls,
            "divs": counts.divs,
            "sincos": counts.sincos,
            "prepare_ops": prepare.arithmetic(),
            "parameters": configuration.parameters,
        })
    };
    configuration.functions.iter().filter(|function| function.name != "prepare").map(of).collect()
}

fn describe(text: &mut String, kir: &Kir, configuration: &Configuration) {
    let joints = |joints: &[usize]| match joints {
        [] => "none".to_owned(),
        _ => joints.iter().map(|joint| format!("q{joint}")).collect::<Vec<_>>().join(" "),
    };
    let _ = writeln!(
        text,
        "{} configuration {}: free {}, locked {}",
        configuration.device,
        configuration.number,
        joints(&configuration.free),
        joints(&configuration.locked)
    );
    for form in &kir.forms {
        let _ = writeln!(text, "  {:<4} {} ({})", form.outputs, form.form, form.reason);
    }
    let _ = writeln!(text, "  {:<26} {:>6} {:>6} {:>5} {:>7}", "kernel", "adds", "muls", "divs", "sincos");
    for function in &configuration.functions {
        let counts = function.program.operations();
        let _ = writeln!(
            text,
            "  {:<26} {:>6} {:>6} {:>5} {:>7}",
            symbol(function.name),
            counts.adds,
            counts.muls,
            counts.divs,
            counts.sincos
        );
    }
    let _ = writeln!(
        text,
        "  {} parameters in {} prepared values, {} of them lumps of link parameters:",
        configuration.parameters.len(),
        configuration.prepared.len(),
        configuration.n_lumps
    );
    let mut line = String::new();
    for name in &configuration.parameters {
        if line.len() + name.len() > 100 {
            let _ = writeln!(text, "   {line}");
            line.clear();
        }
        line.push(' ');
        line.push_str(name);
    }
    let _ = writeln!(text, "   {line}\n");
}

//! `dynid-derive`: device -> `generated/<device>/cNN.kir` and `structure.toml`.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use dynid_derive::{
    ByAlgebra,
    output::{self, Mode},
    session,
};
use dynid_equations::Options;
use dynid_model::Device;

/// Said by `--help`.
const HELP: &str = "\
Forms devices' equations of motion and writes them as text.

Usage: dynid-derive [OPTIONS]

  --device <ID>         only this device
  --config <NUMBER>     only this configuration, from 1
  --check               write nothing; fail where a file is not what would be written
  --device-file <PATH>  a device file instead of the shipped devices
  --out <FOLDER>        where <device>/cNN.kir is written [default: the workspace's `generated`]
  --json                print the forms and their costs as JSON
  --help                print this";

/// What the command line asks for. It is read by hand: an argument parser's features would change those that Symbolica
/// is compiled with, and tests and runs would each compile it.
#[derive(Default)]
struct Arguments {
    device: Option<String>,
    config: Option<usize>,
    check: bool,
    device_file: Option<PathBuf>,
    out: Option<PathBuf>,
    json: bool,
    help: bool,
}

impl Arguments {
    fn parse(mut words: impl Iterator<Item = String>) -> anyhow::Result<Arguments> {
        let mut arguments = Arguments::default();
        while let Some(word) = words.next() {
            let mut value = || words.next().with_context(|| format!("`{word}` needs a value; see --help"));
            match word.as_str() {
                "--device" => arguments.device = Some(value()?),
                "--config" => {
                    let text = value()?;
                    let number = text.parse().with_context(|| format!("`--config {text}` is no number from 1"))?;
                    arguments.config = Some(number);
                }
                "--device-file" => arguments.device_file = Some(value()?.into()),
                "--out" => arguments.out = Some(value()?.into()),
                "--check" => arguments.check = true,
                "--json" => arguments.json = true,
                "--help" | "-h" => arguments.help = true,
                _ => bail!("`{word}` is no argument; see --help"),
            }
        }
        Ok(arguments)
    }
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse(std::env::args().skip(1))?;
    if arguments.help {
        println!("{HELP}");
        return Ok(());
    }
    let mode = if arguments.check { Mode::Check } else { Mode::Write };
    let out = arguments.out.clone().unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../generated"));
    let _session = session::start()?;
    let mut told = Vec::new();
    for device in &devices(&arguments)? {
        if let Some(number) = arguments.config.filter(|&number| number == 0 || number > device.configurations.len()) {
            let n = device.configurations.len();
            bail!(
                "device `{}` has configurations 1 to {n}, not {number}; see `[identification]` of its file",
                device.id
            );
        }
        let files = dynid_equations::generate::<ByAlgebra>(device, &Options { configuration: arguments.config })?;
        for (path, text) in &files {
            if output::put(&out.join(path), text, mode)? {
                eprintln!("wrote {}", out.join(path).display());
            }
            told.extend(forms(path, text));
        }
        if arguments.config.is_none() {
            output::sweep(&out.join(&device.id), &files, &out, mode)?;
        }
    }
    if arguments.json {
        println!("[{}]", told.join(",\n"));
    } else {
        told.iter().for_each(|line| println!("{line}"));
    }
    Ok(())
}

fn devices(arguments: &Arguments) -> anyhow::Result<Vec<Device>> {
    if let Some(path) = &arguments.device_file {
        let text = std::fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
        return Ok(vec![Device::parse(&text, path)?]);
    }
    match &arguments.device {
        None => Ok(dynid_model::devices().to_vec()),
        Some(id) => match dynid_model::device(id) {
            Some(device) => Ok(vec![device.clone()]),
            None => {
                let known: Vec<&str> = dynid_model::devices().iter().map(|device| device.id.as_str()).collect();
                bail!("there is no device `{id}`; known: {}", known.join(", "))
            }
        },
    }
}

/// The header's `form` lines as JSON objects.
fn forms(path: &Path, text: &str) -> Vec<String> {
    let header = |key: &str| text.lines().find_map(|line| line.strip_prefix(key)).unwrap_or_default().to_owned();
    if path.extension().is_none_or(|extension| extension != "kir") {
        return Vec::new();
    }
    let (device, configuration) = (header("device "), header("configuration "));
    text.lines()
        .filter_map(|line| line.strip_prefix("form "))
        .filter_map(|form| {
            let (outputs, rest) = form.split_once(' ')?;
            let (form, reason) = rest.split_once(": ")?;
            Some(format!(
                "{{\"device\":\"{device}\",\"configuration\":{configuration},\"outputs\":\"{outputs}\",\
                 \"form\":\"{form}\",\"reason\":\"{reason}\"}}"
            ))
        })
        .collect()
}

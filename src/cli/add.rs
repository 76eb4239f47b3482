//! `dynid add`: a model with one effect more.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::anyhow;
use dynid::{Addition, Model};
use dynid_files::{Overwrite, check_output, write_new};
use dynid_format::number;
use dynid_model::Parameter;
use serde_json::json;

use super::{Answer, Outcome};

/// Add a physical effect to a model, where it does nothing yet; a fit then finds its values.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid add coulomb --joint 2 --model fitted.toml --out better.toml
  dynid add coulomb --joint 0,1,2 --model fitted.toml --out better.toml          at each of these joints
  dynid add input_coupling --from 5 --joint 4 --model fitted.toml --out better.toml
  dynid add lugre --joint 3 --set sigma0=6.7 --model fitted.toml --out better.toml

The effect starts where it vanishes, so that the model does what it did; `dynid fit` gives such an effect a first estimate
from the logs before it moves everything. A law that contains another takes its place (lugre that of coulomb) and keeps
what they share. Comments and order of the model file stay.")]
pub struct Arguments {
    /// The effect, by its name in the library (a file of model/effects without its ending).
    effect: String,
    /// The joint it acts on, or several, each of which gets one.
    #[arg(long, value_delimiter = ',', value_name = "JOINTS")]
    joint: Option<Vec<usize>>,
    /// The other joint of a pair.
    #[arg(long, value_name = "JOINT")]
    from: Option<usize>,
    /// The model to add it to.
    #[arg(long)]
    pub model: PathBuf,
    /// Where to write the model with it.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Values to start from, e.g. `--set Fc=0.02`; without them the effect starts where it vanishes.
    #[arg(long, value_delimiter = ',', value_name = "SYMBOL=VALUE")]
    set: Vec<String>,
    /// Overwrite the output if it is there.
    #[arg(long)]
    force: bool,
}

/// Adds and writes.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let overwrite = Overwrite::if_forced(arguments.force);
    check_output(&arguments.out, overwrite)?;
    let mut model = Model::load(&arguments.model)?;
    let joints: Vec<Option<usize>> = match &arguments.joint {
        Some(joints) => joints.iter().copied().map(Some).collect(),
        None => vec![None],
    };
    let values = values(&arguments.set)?;
    let mut text = String::new();
    let mut reported = Vec::new();
    for joint in joints {
        let addition =
            Addition { effect: arguments.effect.clone(), joint, from: arguments.from, values: values.clone() };
        let (better, added) = dynid::add(&model, &addition).map_err(|error| of_option(error, &arguments.set))?;
        model = better;
        let _ = writeln!(text, "added: {}", added.label);
        for replaced in &added.replaced {
            let _ = writeln!(text, "  in place of {replaced}, whose values it keeps where they share them");
        }
        let mut parameters = Vec::new();
        for name in &added.parameters {
            let Parameter { value, lower, upper, fixed } = model.require(name)?;
            let unit = model.unit(name).unwrap_or_default();
            let range = if fixed { "fixed".to_owned() } else { format!("from {} to {}", number(lower), number(upper)) };
            let _ = writeln!(text, "  {name} = {} {unit} ({range})", number(value));
            parameters.push(json!({ "name": name, "value": value, "unit": unit, "fixed": fixed }));
        }
        reported.push(json!({ "added": added.label, "replaced": added.replaced, "parameters": parameters }));
    }
    write_new(&arguments.out, &model.to_toml_at(&arguments.out), overwrite)?;
    let _ = writeln!(text, "written: {}; `dynid fit` finds its values", arguments.out.display());
    let json = json!({ "added": reported, "out": arguments.out.display().to_string() });
    Ok(Outcome { text, json, answer: Answer::Yes })
}

/// An error about a value, said of the option that gave it.
fn of_option(error: dynid::Error, settings: &[String]) -> anyhow::Error {
    let symbol = match &error {
        dynid::Error::NoSuchSymbol { symbol, .. } => symbol.as_str(),
        dynid::Error::OutsideBounds { name, .. } => name.rsplit('.').next().unwrap_or(name),
        _ => return error.into(),
    };
    let is_its = |setting: &&String| setting.split('=').next().is_some_and(|own| own.trim() == symbol);
    match settings.iter().find(is_its) {
        Some(setting) => anyhow!("--set {setting}: {error}"),
        None => error.into(),
    }
}

/// Symbols and values of `SYMBOL=VALUE`.
fn values(settings: &[String]) -> anyhow::Result<Vec<(String, f64)>> {
    let value = |setting: &String| {
        let (symbol, value) = setting
            .split_once('=')
            .ok_or_else(|| anyhow!("--set {setting}: give a symbol and its value, e.g. --set Fc=0.02"))?;
        let value = value.trim();
        let number = value.parse().ok().filter(|value: &f64| value.is_finite());
        let number = number.ok_or_else(|| anyhow!("--set {setting}: `{value}` is not a number"))?;
        Ok((symbol.trim().to_owned(), number))
    };
    settings.iter().map(value).collect()
}

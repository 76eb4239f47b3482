//! `dynid plan`: which joints to free, in which order, and which parameters each step reveals.

use std::path::PathBuf;

use anyhow::bail;
use dynid::model::Model;
use dynid::plan::{self, Plan};
use dynid_model::Link;
use serde_json::{Value, json};

use super::table::{Align, Table};
use super::{Answer, Outcome, devices};

/// Say which parameters each step of an identification method reveals.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid plan freedom6s --method isolated      one joint free at a time
  dynid plan freedom6s --method coupling      one joint more in every step
  dynid plan freedom6s --method isolated --model believed.toml

A parameter is new in the first step whose equations of motion depend on it. Which do is computed from the equations,
for general angles of the locked joints. Parameters of effects are those of the free joints that are not fixed.")]
pub struct Arguments {
    /// Id of a device, e.g. `freedom6s`.
    device: String,
    /// A sequence of configurations of the device, e.g. `isolated` or `coupling`.
    #[arg(long)]
    method: String,
    /// A model whose effects count instead of the device's default ones.
    #[arg(long)]
    model: Option<PathBuf>,
}

/// Works the plan out.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let device = devices::find(&arguments.device)?;
    let model = match &arguments.model {
        Some(path) => Model::load(path)?,
        None => Model::of_device(device),
    };
    if model.device.id != device.id {
        bail!("the model is of device `{}`, not of `{}`; give a model of that device", model.device.id, device.id);
    }
    let plan = plan::plan(&model, &arguments.method)?;
    let configurations: Vec<Value> = plan
        .steps
        .iter()
        .map(|step| {
            json!({
                "number": step.number,
                "configuration": step.configuration,
                "free": step.free,
                "new_parameters": step.new_parameters,
                "parameters": step.parameters,
            })
        })
        .collect();
    let json = json!({
        "device": device.id,
        "method": plan.method,
        "configurations": configurations,
        "never": plan.never,
    });
    Ok(Outcome { text: told(&model, &plan), json, answer: Answer::Yes })
}

fn told(model: &Model, plan: &Plan) -> String {
    let joints = |free: &[usize]| free.iter().map(|joint| format!("q{joint}")).collect::<Vec<_>>().join(" ");
    let mut text = format!("{}, method {}\n\n", model.device.id, plan.method);
    let mut steps = Table::new(&[
        ("step", Align::Left),
        ("free", Align::Left),
        ("link parameters", Align::Right),
        ("new", Align::Right),
        ("effect parameters", Align::Right),
        ("new", Align::Right),
    ]);
    for step in &plan.steps {
        let links = |names: &[String]| names.iter().filter(|name| name.starts_with("link.")).count();
        let (all, new) = (links(&step.parameters), links(&step.new_parameters));
        steps.row([
            step.number.to_string(),
            joints(&step.free),
            all.to_string(),
            new.to_string(),
            (step.parameters.len() - all).to_string(),
            (step.new_parameters.len() - new).to_string(),
        ]);
    }
    text.push_str(&steps.text());
    text.push_str("\nThe step in which each link parameter first appears (\u{b7}: never):\n\n");
    let columns: Vec<(&str, Align)> =
        std::iter::once(("link", Align::Left)).chain(Link::SYMBOLS.map(|symbol| (symbol, Align::Right))).collect();
    let mut matrix = Table::new(&columns);
    for (number, row) in (1..).zip(plan.first_steps(model.device.links.len())) {
        let cell = |step: Option<usize>| step.map_or_else(|| "\u{b7}".to_owned(), |step| step.to_string());
        let cells: Vec<String> = std::iter::once(format!("{number}")).chain(row.map(cell)).collect();
        matrix.cells(cells);
    }
    text.push_str(&matrix.text());
    let n_links = 10 * model.device.links.len();
    text.push_str(&format!(
        "\n{} of {n_links} link parameters appear. Appearing is not being identifiable: some act only together.\n",
        n_links - plan.never.len()
    ));
    text
}

//! `dynid plan`: which joints to free, in which order, and which parameters each step reveals.

use std::path::PathBuf;

use anyhow::bail;
use dynid_model::Link;
use dynid_plan::{self as plan, NOWHERE, Plan, Unreachable};
use dynid_plan::{base::BaseParameters, base::base_parameters};
use dynid_plan::{
    unidentifiable::Circumstances, unidentifiable::UnidentifiableDirection, unidentifiable::unidentifiable_directions,
};
use dynid_user_model::Model;
use serde_json::{Value, json};

use super::table::{Align, Table};
use super::{Answer, Outcome, devices};

/// Say which parameters each step of an identification method reveals.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid plan freedom6s --method isolated      one joint free at a time
  dynid plan freedom6s --method coupling      one joint more in every step
  dynid plan staubli_tx40 --method found      a sequence that the program finds
  dynid plan planar2r --base                  write every base parameter out
  dynid plan --model believed.toml            with the effects and the fixed parameters of a model

A parameter is new in the first step whose equations of motion depend on it. Which do is computed from the equations,
for general angles of the locked joints. Parameters of effects are those of the free joints that are not fixed.

Base parameters are the combinations that a motion can reveal. They are written in the mass m, the first moments mx, my,
mz and the inertia J about the origin of the link's frame, in which torques are linear: mx = m*x,
Jxx = Ixx + m*(y^2 + z^2), Jxy = Ixy - m*x*y, and so on.")]
pub struct Arguments {
    /// Id of a device, e.g. `freedom6s`; not needed with a model.
    #[arg(required_unless_present = "model")]
    pub device: Option<String>,
    /// A sequence of configurations of the device, e.g. `isolated` or `coupling`; `found` lets the program find one. Without
    /// it, the device's first, or `found` where it has none.
    #[arg(long)]
    method: Option<String>,
    /// A model whose effects and fixed parameters count instead of the device's default ones.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Write every base parameter out.
    #[arg(long)]
    base: bool,
}

/// What is known of one step or of all together.
struct Reach {
    base: BaseParameters,
    directions: Vec<UnidentifiableDirection>,
}

impl Reach {
    fn of(model: &Model, free: &[Vec<usize>]) -> anyhow::Result<Self> {
        let base = base_parameters(model, free)?;
        let bare = |free: &Vec<usize>| Circumstances { free: free.clone(), payload: None };
        let circumstances: Vec<Circumstances> = free.iter().map(bare).collect();
        let directions = unidentifiable_directions(model, &circumstances, &base)?;
        Ok(Self { base, directions })
    }

    fn json(&self, model: &Model) -> (Value, Value) {
        let reported: Vec<String> =
            self.base.combinations.iter().map(|combination| self.base.formula(combination)).collect();
        let base = json!({
            "rank": self.base.rank(),
            "rank_at_one_pose": self.base.rank_at_one_pose.iter().max(),
            "combinations": reported,
            "exact": self.base.is_exact(),
            "alone": self.base.alone(),
            "identifiable_alone": self.base.identifiable_alone(model),
            "vanishing": self.base.vanishing(),
        });
        let directions = self.directions.iter().map(|direction| {
            let changes: Vec<Value> = direction
                .changes
                .iter()
                .map(|(name, change)| json!({ "name": name, "relative_change": change }))
                .collect();
            json!({ "scale": direction.is_scale(), "changes": changes, "fix_one_of": direction.fix_one_of })
        });
        (base, directions.collect())
    }
}

/// Works the plan out.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let device = arguments.device.as_deref().map(devices::find).transpose()?;
    let model = match (&arguments.model, device) {
        (Some(path), _) => Model::load(path)?,
        (None, Some(device)) => Model::of_device(device),
        (None, None) => bail!("nothing to plan for; name a device, or give a model with `--model`"),
    };
    if let Some(device) = device.filter(|device| !model.device.is_same_as(device)) {
        bail!("the model is of device `{}`, not of `{}`; give a model of that device", model.device.id, device.id);
    }
    let method = arguments.method.as_deref().unwrap_or(plan::default_method(&model));
    let plan = plan::plan(&model, method)?;
    let free: Vec<Vec<usize>> = plan.steps.iter().map(|step| step.free.clone()).collect();
    let steps = free.chunks(1).map(|alone| Reach::of(&model, alone)).collect::<anyhow::Result<Vec<_>>>()?;
    let together = Reach::of(&model, &free)?;
    let configurations: Vec<Value> = plan
        .steps
        .iter()
        .zip(&steps)
        .map(|(step, reach)| {
            let (base, directions) = reach.json(&model);
            json!({
                "number": step.number,
                "configuration": step.configuration,
                "free": step.free,
                "new_parameters": step.new_parameters,
                "parameters": step.parameters,
                "base_parameters": base,
                "flat_directions": directions,
            })
        })
        .collect();
    let (base, directions) = together.json(&model);
    let unreachable: Vec<Value> =
        plan.unreachable.iter().map(|missing| json!({ "name": missing.name, "why": missing.why })).collect();
    let json = json!({
        "device": model.device.id,
        "method": plan.method,
        "configurations": configurations,
        "never": plan.never,
        "unreachable": unreachable,
        "base_parameters": base,
        "flat_directions": directions,
    });
    let mut text = as_text(&model, &plan, &steps);
    text.push_str(&base_as_text(&model, &together.base, arguments.base));
    text.push_str(&unidentifiable_as_text(&together.directions));
    Ok(Outcome { text, json, answer: Answer::Yes })
}

/// How many base parameters there are, and, where wanted, which.
fn base_as_text(model: &Model, base: &BaseParameters, all: bool) -> String {
    let of_links = base.combinations.iter().filter(|combination| combination.leading < base.n_link).count();
    let mut text = format!(
        "\nTogether the steps reveal {of_links} base parameters of links, {} more of effects whose torque is linear in them.\n",
        base.rank() - of_links
    );
    let alone = base.identifiable_alone(model);
    if !alone.is_empty() {
        text.push_str(&format!(
            "Of the link parameters {} can be identified alone: {}.\n",
            alone.len(),
            compact(&alone)
        ));
    }
    if all {
        text.push_str("\nBase parameters:\n\n");
        for combination in &base.combinations {
            text.push_str(&format!("  {}\n", base.formula(combination)));
        }
        text.push_str(
            "\nmx = m*x; J is the inertia about the origin of the link's frame: Jxx = Ixx + m*(y^2 + z^2), Jxy = Ixy - m*x*y, ..\n",
        );
    } else {
        text.push_str("`--base` writes them out.\n");
    }
    text
}

fn unidentifiable_as_text(directions: &[UnidentifiableDirection]) -> String {
    let mut text = String::new();
    for direction in directions {
        let is_effect = |name: &str| name.starts_with("joint.") || name.starts_with("device.");
        if direction.is_scale() {
            let effects: Vec<String> =
                direction.changes.iter().map(|(name, _)| name.clone()).filter(|name| is_effect(name)).collect();
            text.push_str(&format!(
                "\nThe answer is up to one scale. No motion changes if these grow in one proportion:\n  {}\n",
                by_joint(&effects)
            ));
            let n_links = direction.changes.len() - effects.len();
            if n_links > 0 {
                text.push_str(&format!("  and {n_links} base parameters of links\n"));
            }
            let others: Vec<String> =
                direction.fix_one_of.iter().filter(|name| !effects.contains(name)).cloned().collect();
            let or = if others.is_empty() { String::new() } else { format!(", or of {}", compact(&others)) };
            text.push_str(&format!("Fix one of the {} parameters of effects{or}.\n", effects.len()));
        } else {
            let changes: Vec<String> =
                direction.changes.iter().map(|(name, change)| format!("{name} ({change:+.4})")).collect();
            text.push_str(&format!("\nNo motion changes if these change in proportion:\n  {}\n", changes.join("\n  ")));
            if !direction.fix_one_of.is_empty() {
                text.push_str(&format!("Fix one of {}.\n", compact(&direction.fix_one_of)));
            }
        }
    }
    text
}

/// `joint.0.gain.Kp, joint.1.gain.Kp` as `joints 0, 1: gain.Kp`, one line for the joints with the same parameters.
fn by_joint(names: &[String]) -> String {
    let mut joints: Vec<(&str, Vec<String>)> = Vec::new();
    for name in names {
        let (joint, rest) = name.strip_prefix("joint.").and_then(|name| name.split_once('.')).unwrap_or(("", name));
        match joints.iter_mut().find(|(known, _)| *known == joint) {
            Some((_, own)) => own.push(rest.to_owned()),
            None => joints.push((joint, vec![rest.to_owned()])),
        }
    }
    let mut groups: Vec<(Vec<&str>, Vec<String>)> = Vec::new();
    for (joint, own) in joints {
        match groups.iter_mut().find(|(_, known)| *known == own) {
            Some((members, _)) => members.push(joint),
            None => groups.push((vec![joint], own)),
        }
    }
    let line = |(members, own): &(Vec<&str>, Vec<String>)| match members.as_slice() {
        [""] => compact(own),
        [joint] => format!("joint {joint}: {}", compact(own)),
        _ => format!("joints {}: {}", members.join(", "), compact(own)),
    };
    groups.iter().map(line).collect::<Vec<_>>().join("\n  ")
}

/// `link.7.Ixx, link.7.Ixy, link.6.m` as `link.7.{Ixx, Ixy}, link.6.m`.
fn compact(names: &[String]) -> String {
    let split = |name: &str| name.rsplit_once('.').map(|(place, symbol)| (place.to_owned(), symbol.to_owned()));
    let mut groups: Vec<(String, Vec<String>)> = Vec::new();
    for name in names {
        let (place, symbol) = split(name).unwrap_or((String::new(), name.clone()));
        match groups.iter_mut().find(|(known, _)| *known == place) {
            Some((_, symbols)) => symbols.push(symbol),
            None => groups.push((place, vec![symbol])),
        }
    }
    let reported = groups.iter().map(|(place, symbols)| match symbols.as_slice() {
        [symbol] => format!("{place}.{symbol}"),
        _ => format!("{place}.{{{}}}", symbols.join(", ")),
    });
    wrapped(&reported.collect::<Vec<_>>().join(", "))
}

/// Broken at spaces so that no line is long.
fn wrapped(text: &str) -> String {
    const WIDTH: usize = 110;
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let line = lines.last_mut().map_or(0, |line| line.len());
        if line > 0 && line + word.len() > WIDTH {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines.join("\n  ")
}

fn as_text(model: &Model, plan: &Plan, reaches: &[Reach]) -> String {
    let joints = |free: &[usize]| free.iter().map(|joint| format!("q{joint}")).collect::<Vec<_>>().join(" ");
    let mut text = format!("{}, method {}\n\n", model.device.id, plan.method);
    let mut steps = Table::new(&[
        ("step", Align::Left),
        ("free", Align::Left),
        ("link parameters", Align::Right),
        ("new", Align::Right),
        ("effect parameters", Align::Right),
        ("new", Align::Right),
        ("base parameters", Align::Right),
        ("at one pose", Align::Right),
    ]);
    for (step, Reach { base, .. }) in plan.steps.iter().zip(reaches) {
        let links = |names: &[String]| names.iter().filter(|name| name.starts_with("link.")).count();
        let (all, new) = (links(&step.parameters), links(&step.new_parameters));
        steps.row([
            step.number.to_string(),
            joints(&step.free),
            all.to_string(),
            new.to_string(),
            (step.parameters.len() - all).to_string(),
            (step.new_parameters.len() - new).to_string(),
            base.rank().to_string(),
            base.rank_at_one_pose.iter().max().map_or_else(String::new, usize::to_string),
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
    let elsewhere: Vec<&Unreachable> = plan
        .unreachable
        .iter()
        .filter(|missing| !plan.never.contains(&missing.name) || missing.why != NOWHERE)
        .collect();
    for missing in elsewhere {
        text.push_str(&format!("{} is not reached: {}.\n", missing.name, missing.why));
    }
    text
}

//! Cases that nobody has seen: machine, instrument, belief and what is hidden are drawn from a seed.
//!
//! A draw is a [`deck()`] of cards that say what is asked, and [`case`] makes the case of a card: a machine that ships, an
//! [`Instrument`], a place that the effect suits, a size in proportion to what the machine does, and a belief that is off by
//! 2 to 20 %. What cannot be played, or does not show in the logs ([`Visibility`]), is drawn again with the next sub-seed.
//!
//! Only devices that ship are drawn; `draw/machine.rs` says where another source of machines would go.

mod belief;
mod deck;
mod dice;
mod excitation;
mod instrument;
mod machine;
mod place;
mod size;
mod visibility;

use std::collections::BTreeMap;

use serde_json::{Value, json};

pub use deck::{Card, N_CASES, deck};
pub use instrument::{Drive, Instrument};
pub use visibility::{SHOWS, Visibility};

use super::{Kind, Spot, device, same_things};
use crate::effects::EffectEntry;
use crate::recipe::{Files, Plant, Recipe, Trace};
use belief::Gains;
use dice::Dice;
use machine::{Links, Machine};
use size::Motions;
use visibility::Window;

/// Raised whenever a case of a draw changes: answers to other cases are not gone on from.
pub const EDITION: u32 = 1;

/// A case of a draw.
#[derive(Debug, Clone)]
pub struct DrawnCase {
    /// Seed of the draw.
    pub draw: u32,
    /// What it asks.
    pub card: Card,
    /// E.g. `7-042-planar2r-01-coulomb`.
    pub name: String,
    /// How the machine is measured.
    pub instrument: Instrument,
    /// The machine and its runs.
    pub truth: Recipe,
    /// Joints that move in all runs.
    pub free: Vec<usize>,
    /// What the believed model lacks.
    pub hidden: Vec<HiddenEffect>,
    /// Products of signals of which a discovered formula must hold one; none where no sum of products says the law.
    pub terms: Vec<String>,
    /// Where a body is carried in one run alone, the name of the run.
    pub run_with_payload: Option<String>,
    /// `model.toml` of what is believed.
    pub believed: String,
    /// `model.toml` of the truth; none where no model can say it.
    pub true_model: Option<String>,
}

/// An effect that the believed model lacks.
#[derive(Debug, Clone)]
pub struct HiddenEffect {
    /// With its true values.
    pub entry: EffectEntry,
    /// Answers that are right, the effect itself first; empty for a law outside of the library.
    pub accepted: Vec<Spot>,
    /// How much the logs show of it.
    pub visibility: Visibility,
}

impl DrawnCase {
    /// All files of the case: logs, `experiment.toml`, `believed.toml`, `truth.json`, and `true.toml` where there is one.
    ///
    /// # Errors
    /// A machine that cannot be played.
    pub fn files(&self) -> Result<Files, String> {
        let plant = Plant::new(&self.truth, device(&self.truth.device))?;
        let traces = self.truth.runs.iter().map(|run| plant.play(run)).collect::<Result<Vec<Trace>, String>>()?;
        let mut files = plant.files(&traces);
        files.insert("believed.toml".to_owned(), self.believed.clone());
        if let Some(model) = &self.true_model {
            files.insert("true.toml".to_owned(), model.clone());
        }
        let truth = serde_json::to_string_pretty(&self.told()).map_err(|error| error.to_string())?;
        files.insert("truth.json".to_owned(), truth + "\n");
        Ok(files)
    }

    fn told(&self) -> Value {
        let hidden = |hidden: &HiddenEffect| {
            let accepted: Vec<String> = hidden.accepted.iter().map(ToString::to_string).collect();
            json!({
                "effect": hidden.entry,
                "accepted": accepted,
                "moves_by_noises": hidden.visibility.moves_by_noises,
                "standard_errors": hidden.visibility.standard_errors,
                "shows": hidden.visibility.shows,
            })
        };
        json!({
            "draw": self.draw,
            "number": self.card.number,
            "name": self.name,
            "kind": self.card.kind.as_str(),
            "device": self.truth.device,
            "free": self.free,
            "instrument": self.instrument,
            "noise_floor": self.instrument.noise_floor(),
            "hidden": self.hidden.iter().map(hidden).collect::<Vec<Value>>(),
            "terms": self.terms,
            "run_with_payload": self.run_with_payload,
        })
    }
}

/// So many sub-seeds are tried for a case.
const ATTEMPTS: u64 = 80;

/// Makes the case of a card.
///
/// # Errors
/// No sub-seed gives a machine that can be played and shows what is hidden in it: what the last one failed by.
pub fn case(draw: u32, card: &Card) -> Result<DrawnCase, String> {
    let mut reason = String::new();
    for attempt in 0..ATTEMPTS {
        let seed = 0x0d1d_0000_0000_0000 ^ (u64::from(draw) << 24) ^ ((card.number as u64) << 8) ^ attempt;
        match attempted(draw, card, seed) {
            Ok(case) => return Ok(case),
            Err(error) => reason = error,
        }
    }
    Err(format!("case {} of draw {draw}: {reason}", card.number))
}

fn attempted(draw: u32, card: &Card, seed: u64) -> Result<DrawnCase, String> {
    let mut dice = Dice::new(seed);
    let dice = &mut dice;
    let choice = if card.is_arm { machine::arm(dice) } else { machine::any(dice) };
    let (needed, hides_payload) = (card.effects.iter().any(|id| place::needs_known_links(id)), is_payload(card));
    let at_least = if hides_payload { 3 } else { 1 };
    let stroke = machine_stroke(&choice);
    let mut instrument = Instrument::draw(dice, choice.drive, choice.free.len(), stroke, at_least);
    let links = if needed || hides_payload || instrument.torque_is_scaled { Links::Known } else { Links::Any };
    let mut machine = Machine::draw(&choice, links, dice);
    if instrument.torque_is_scaled {
        instrument.torque_is_scaled = log_torques_in_other_units(&mut machine, dice);
    }
    let gains = if instrument.torque_is_scaled { Gains::Open } else { Gains::Stated };

    let places = places_of(card, &machine, dice)?;
    let mut truth = recipe(seed, &machine, &instrument, dice)?;
    let inertia = Plant::new(&truth, machine.device)?.inertia_at_start(&machine.free);
    if machine.drive == Drive::ClosedLoop {
        truth.controller = Some(excitation::controller(&machine, &instrument, &inertia, dice));
    }
    let motions = measured(&truth, &machine, &instrument)?;
    if instrument.torque_noise > 0.0 {
        let noise = |joint: usize| motions.get(&joint).map_or(0.0, |own| own.command * instrument.torque_noise);
        truth.torque_noise_rms = (0..machine.device.joints.len()).map(|joint| super::rounded(noise(joint))).collect();
    }
    let hidden: Vec<EffectEntry> =
        places.iter().map(|(id, at)| size::sized(id, *at, &machine, &motions, instrument.duration_s, dice)).collect();

    let rest = without(&machine, &hidden, dice);
    truth.effects = with(&rest, &hidden);
    truth.steps_per_sample = steps(&truth, &machine, &motions)?;
    check_steps(&truth, &machine, &instrument)?;
    let window = Window::new(&truth, &machine, &instrument, gains, &inertia);
    let mut seen = Vec::new();
    for (index, entry) in hidden.iter().enumerate() {
        let others: Vec<EffectEntry> =
            hidden.iter().enumerate().filter(|(other, _)| *other != index).map(|(_, entry)| entry.clone()).collect();
        let visibility = window.visibility(entry, &truth.effects, &with(&rest, &others))?;
        if !visibility.shows {
            return Err(format!("`{}` does not show", entry.id));
        }
        let accepted = if dynid_model::effect(&entry.id).is_some() {
            same_things(entry, machine.device, &machine.free)
        } else {
            Vec::new()
        };
        seen.push(HiddenEffect { entry: entry.clone(), accepted, visibility });
    }

    let mut run_with_payload = None;
    if hides_payload {
        truth.effects.clone_from(&rest);
        let run = dice.below(truth.runs.len());
        truth.runs[run].effects.clone_from(&hidden);
        run_with_payload = Some(truth.runs[run].file.clone());
    }
    let believed = belief::believed(&machine, &rest, links, gains, dice);
    let can_be_said = card.kind != Kind::Outside && !hides_payload;
    let true_model = can_be_said.then(|| belief::true_model(&machine, &truth.effects, gains));
    let terms = match (card.kind, hidden.first()) {
        (Kind::Outside, Some(law)) => {
            let other = law.values.get("other").map(|other| *other as usize);
            place::terms(&law.id, (law.joint, law.from), other)
        }
        _ => Vec::new(),
    };
    Ok(DrawnCase {
        draw,
        name: name(draw, card, &machine),
        card: card.clone(),
        instrument,
        free: machine.free.clone(),
        truth,
        hidden: seen,
        terms,
        run_with_payload,
        believed,
        true_model,
    })
}

fn is_payload(card: &Card) -> bool {
    card.kind == Kind::PayloadInOneRun
}

fn machine_stroke(choice: &machine::Choice) -> f64 {
    let strokes = machine::strokes(choice.device);
    choice.free.iter().map(|&joint| strokes[joint]).fold(f64::INFINITY, f64::min)
}

fn name(draw: u32, card: &Card, machine: &Machine) -> String {
    let joints: String = machine.free.iter().map(usize::to_string).collect();
    let what = if card.effects.is_empty() { card.kind.as_str().to_owned() } else { card.effects.join("+") };
    format!("{draw}-{:03}-{}-{joints}-{what}", card.number, machine.device.id)
}

/// The log's torques have an offset, and a unit that is known to a few per cent: to the model that is a gain. False where the
/// device's commands have a gain of their own, or a spring would take up the offset.
fn log_torques_in_other_units(machine: &mut Machine, dice: &mut Dice) -> bool {
    if machine.free.iter().any(|&joint| machine.has("gain", joint) || machine.has("spring", joint)) {
        return false;
    }
    let entry = |id: &str, symbol: &str, joint: usize, value: f64| {
        let values = [(symbol.to_owned(), super::rounded(value))].into();
        EffectEntry { id: id.to_owned(), joint, from: None, values }
    };
    for joint in machine.free.clone() {
        machine.effects.push(entry("gain", "Kp", joint, 1.0 + dice.between(-0.2, 0.2)));
        if !machine.has("torque_offset", joint) {
            let size = machine.habits.coulomb[joint] * dice.between(-0.5, 0.5);
            machine.effects.push(entry("torque_offset", "offset", joint, size));
        }
    }
    true
}

/// A place for each effect of the card.
fn places_of(card: &Card, machine: &Machine, dice: &mut Dice) -> Result<Vec<(String, place::Joints)>, String> {
    let payload = ["payload".to_owned()];
    let effects = if is_payload(card) { payload.as_slice() } else { card.effects.as_slice() };
    effects
        .iter()
        .map(|id| {
            let places = place::places(id, machine);
            if places.is_empty() {
                return Err(format!("`{id}` has no place in {} {:?}", machine.device.id, machine.free));
            }
            Ok((id.clone(), *dice.pick(&places)))
        })
        .collect()
}

/// The machine as it is, and its runs.
fn recipe(seed: u64, machine: &Machine, instrument: &Instrument, dice: &mut Dice) -> Result<Recipe, String> {
    let mut recipe = Recipe {
        device: machine.device.id.clone(),
        seed,
        sample_s: 1.0 / instrument.rate_hz,
        steps_per_sample: 1,
        noise_rms: instrument.noise_rms,
        quantum: instrument.quantum,
        start: machine.start.clone(),
        parameters: machine.parameters.clone(),
        effects: machine.effects.clone(),
        runs: excitation::runs(machine, instrument, dice),
        ..Recipe::default()
    };
    recipe.steps_per_sample = steps(&recipe, machine, &Motions::new())?;
    Ok(recipe)
}

/// What the joints of the machine do in the beginning of its first run.
fn measured(truth: &Recipe, machine: &Machine, instrument: &Instrument) -> Result<Motions, String> {
    let mut run = truth.runs[0].clone();
    run.duration_s = run.duration_s.min(8.0);
    let quiet = Recipe { noise_rms: 0.0, quantum: 0.0, runs: vec![run.clone()], ..truth.clone() };
    let motions = size::measure(&Plant::new(&quiet, machine.device)?, &run, machine, truth.sample_s)?;
    for (joint, motion) in &motions {
        if !motion.moves(instrument.noise_floor(), machine.strokes[*joint]) {
            return Err(format!("joint {joint} hardly moves, or runs away"));
        }
    }
    Ok(motions)
}

/// Effects of the machine, all that is hidden among them; a law takes the place of what it replaces.
fn with(rest: &[EffectEntry], hidden: &[EffectEntry]) -> Vec<EffectEntry> {
    let mut effects = rest.to_vec();
    for entry in hidden {
        let replaces = dynid_model::effect(&entry.id).map(|effect| effect.replaces.as_slice()).unwrap_or_default();
        effects.retain(|own| own.joint != entry.joint || !replaces.iter().any(|replaced| replaced.id == own.id));
        effects.push(entry.clone());
    }
    effects
}

/// Effects of the believed model: those of the machine without what is hidden, and without another law of the same kind
/// that would do as well.
fn without(machine: &Machine, hidden: &[EffectEntry], dice: &mut Dice) -> Vec<EffectEntry> {
    let mut rest = machine.effects.clone();
    for entry in hidden {
        rest.retain(|own| (&own.id, own.joint, own.from) != (&entry.id, entry.joint, entry.from));
        let alternatives = dynid_model::effect(&entry.id).and_then(|effect| effect.alternatives.as_deref());
        let here = |rest: &[EffectEntry], id: &str| rest.iter().any(|own| own.id == id && own.joint == entry.joint);
        let had_lugre = here(&rest, "lugre") || entry.id == "lugre";
        if alternatives.is_none() {
            continue;
        }
        let replaces_coulomb = !["coulomb", "lugre"].contains(&entry.id.as_str());
        let keeps_coulomb = alternatives == Some("viscous_friction") || (replaces_coulomb && dice.chance(0.6));
        let goes = |own: &EffectEntry| own.id == "lugre" || (own.id == "coulomb" && !keeps_coulomb);
        rest.retain(|own| own.joint != entry.joint || !goes(own));
        if had_lugre && keeps_coulomb {
            rest.push(machine::coulomb(entry.joint, &machine.habits, dice));
        }
        if entry.id != "viscous" && !here(&rest, "viscous") {
            rest.push(machine::viscous(entry.joint, &machine.habits, dice));
        }
    }
    rest
}

/// Shortest step of the integration (s): a machine that needs a shorter one is no case.
const SHORTEST_STEP_S: f64 = 1e-5;
/// Longest step (s).
const LONGEST_STEP_S: f64 = 1e-3;

/// Steps from sample to sample that resolve the fastest of the machine: its motion at rest, and what relaxes over a travel at
/// the speeds that it reaches.
fn steps(recipe: &Recipe, machine: &Machine, motions: &Motions) -> Result<usize, String> {
    let mut fastest = Plant::new(recipe, machine.device)?.fastest_rate(&machine.free)?;
    for entry in &recipe.effects {
        let speed = motions.get(&entry.joint).map_or(1.0, size::Motion::fastest);
        let value = |symbol: &str| entry.values.get(symbol).copied();
        let own = match (entry.id.as_str(), value("sigma0"), value("Fc"), value("travel")) {
            ("backlash", ..) => 4e3,
            (_, Some(stiffness), Some(level), _) => stiffness * speed / level,
            (_, _, _, Some(travel)) => speed / travel,
            _ => 0.0,
        };
        fastest = fastest.max(own);
    }
    // Positions of an open loop must be right far below the noise; a loop that is closed forgives.
    let resolved = if machine.drive == Drive::OpenLoop { 0.4 } else { 1.0 };
    let step_s = LONGEST_STEP_S.min(resolved / fastest);
    if step_s < SHORTEST_STEP_S {
        return Err(format!("the machine would need steps of {step_s:.1e} s"));
    }
    Ok((recipe.sample_s / step_s).ceil().max(1.0) as usize)
}

/// In open loop half as long steps must give the same motion: one that tells them apart is chaotic, and no model would follow
/// its log.
fn check_steps(truth: &Recipe, machine: &Machine, instrument: &Instrument) -> Result<(), String> {
    if machine.drive == Drive::ClosedLoop {
        return Ok(());
    }
    let mut run = truth.runs[0].clone();
    run.duration_s = run.duration_s.min(if machine.free.len() > 2 { 6.0 } else { 30.0 });
    let play = |steps_per_sample: usize| {
        let recipe = Recipe { steps_per_sample, ..truth.clone() };
        Plant::new(&recipe, machine.device)?.play(&run)
    };
    let (once, twice) = (play(truth.steps_per_sample)?, play(2 * truth.steps_per_sample)?);
    for slot in 0..machine.free.len() {
        let squares = once.seen.iter().zip(&twice.seen).map(|(one, other)| (one[slot] - other[slot]).powi(2));
        let rms = (squares.sum::<f64>() / once.seen.len() as f64).sqrt();
        if rms > STEPS_SHOW * instrument.noise_floor() {
            return Err("the motion depends on the steps of the integration".to_owned());
        }
    }
    Ok(())
}

/// In noises.
const STEPS_SHOW: f64 = 0.3;

/// How many cases of a draw hide each effect.
pub fn hidden_in(cards: &[Card]) -> BTreeMap<&str, usize> {
    let mut counts = BTreeMap::new();
    for id in cards.iter().flat_map(|card| &card.effects) {
        *counts.entry(id.as_str()).or_insert(0) += 1;
    }
    counts
}

#[cfg(test)]
mod tests;

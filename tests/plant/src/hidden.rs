//! Cases with a known answer: logs of a machine that has one effect more than the model that is believed of it.
//!
//! [`mod@draw`] draws everything about a case at random, and [`score`] judges one call of the program on it. The rest of this module
//! is the fixed table:
//!
//! A case is made from its number and a variation: the machine, whose parameters are a few per cent off the device file's; three runs of
//! it, noisy and quantised; the believed model, which lacks the hidden effect and is a few per cent off again; and what
//! counts as the right answer. [`table`] lists them, [`trial`] puts the program through them.
//!
//! The files of a case: the logs, `experiment.toml`, `believed.toml`, `true.toml` (the machine as a model; none for an effect
//! outside of the library) and `truth.json` (the answer, and by how many noises the effect moves each joint).

pub mod draw;
pub mod score;
pub mod table;
pub mod trial;

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;

use dynid_model::{Device, Link, Origin, Place, Scope};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::effects::EffectEntry;
use crate::random::Noise;
use crate::recipe::{Cosine, Files, Plant, Recipe, RunEntry, Trace};

/// Standard deviation of the position noise [rad or m].
pub const NOISE: f64 = 2e-4;
/// Logged positions are multiples of this [rad or m].
pub const QUANTUM: f64 = 1e-4;

/// What the logs show of a position that stands still: noise, and the rounding to a quantum.
pub fn noise_floor() -> f64 {
    (NOISE * NOISE + QUANTUM * QUANTUM / 12.0).sqrt()
}

/// What is asked of the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// The machine has an effect of the library that the believed model lacks.
    Hidden,
    /// The believed model lacks nothing.
    Nothing,
    /// The machine has an effect that no library has.
    Outside,
    /// The machine has two effects of the library that the believed model lacks.
    TwoAtOnce,
    /// The machine carries a body in one run that it does not carry in the others.
    PayloadInOneRun,
}

impl Kind {
    /// As the command line and `truth.json` write it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Hidden => "hidden",
            Self::Nothing => "nothing",
            Self::Outside => "outside",
            Self::TwoAtOnce => "two_at_once",
            Self::PayloadInOneRun => "payload_in_one_run",
        }
    }
}

/// An effect at its place.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Spot {
    /// Id of the effect.
    pub effect: String,
    /// The joint that it acts on.
    pub joint: usize,
    /// The other joint of a pair.
    pub from: Option<usize>,
}

/// One case.
#[derive(Debug, Clone)]
pub struct Case {
    /// Position in the table, from 1.
    pub number: usize,
    /// E.g. `freedom6s-3-coulomb`.
    pub name: String,
    /// What is asked.
    pub kind: Kind,
    /// The machine and its runs.
    pub truth: Recipe,
    /// Joints that move in all runs.
    pub free: Vec<usize>,
    /// The effect that the believed model lacks.
    pub hidden: Option<EffectEntry>,
    /// The same machine without it.
    pub without: Recipe,
    /// Answers that are right, the hidden effect first.
    pub accepted: Vec<Spot>,
    /// Products of signals of which a discovered formula must hold one; none where no sum of products says the law.
    pub terms: Vec<String>,
    /// `model.toml` of what is believed.
    pub believed: String,
    /// `model.toml` of the truth; none where no library can say it.
    pub true_model: Option<String>,
}

impl Case {
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
        let contribution = self.contribution(&traces)?;
        let truth = serde_json::to_string_pretty(&self.told(&contribution)).map_err(|error| error.to_string())?;
        files.insert("truth.json".to_owned(), truth + "\n");
        Ok(files)
    }

    /// How far the hidden effect moves each free joint in the held-out run: root mean square over the noise.
    fn contribution(&self, traces: &[Trace]) -> Result<Vec<f64>, String> {
        let (Some(_), Some(run), Some(with)) = (&self.hidden, self.truth.runs.last(), traces.last()) else {
            return Ok(Vec::new());
        };
        let without = Plant::new(&self.without, device(&self.truth.device))?.play(run)?;
        let rms = |slot: usize| {
            let square = |(a, b): (&Vec<f64>, &Vec<f64>)| (a[slot] - b[slot]).powi(2);
            let sum: f64 = with.seen.iter().zip(&without.seen).map(square).sum();
            (sum / with.seen.len() as f64).sqrt() / NOISE
        };
        Ok((0..self.free.len()).map(rms).collect())
    }

    fn told(&self, contribution: &[f64]) -> Value {
        let spot = |spot: &Spot| {
            let mut told = json!({ "effect": spot.effect, "joint": spot.joint });
            if let Some(from) = spot.from {
                told["from"] = json!(from);
            }
            told
        };
        json!({
            "number": self.number,
            "name": self.name,
            "kind": self.kind.as_str(),
            "device": self.truth.device,
            "free": self.free,
            "hidden": self.hidden,
            "accepted": self.accepted.iter().map(spot).collect::<Vec<Value>>(),
            "terms": self.terms,
            "noise_floor": noise_floor(),
            "moves_by_noises": contribution,
        })
    }
}

/// What the table says of a case.
#[derive(Debug, Clone)]
pub struct Plan {
    kind: Kind,
    device: &'static str,
    free: Vec<usize>,
    friction: &'static str,
    hidden: Option<&'static str>,
    links_within: Option<f64>,
    fixed: Vec<&'static str>,
    removed: Vec<&'static str>,
    or: Vec<&'static str>,
    terms: Vec<&'static str>,
    drive: f64,
    off: f64,
}

impl Plan {
    fn new(
        kind: Kind,
        device: &'static str,
        free: &[usize],
        friction: &'static str,
        hidden: Option<&'static str>,
    ) -> Self {
        Self {
            kind,
            device,
            free: free.to_vec(),
            friction,
            hidden,
            links_within: None,
            fixed: Vec::new(),
            removed: Vec::new(),
            or: Vec::new(),
            terms: Vec::new(),
            drive: 1.0,
            off: 0.04,
        }
    }

    /// Links are known to within this fraction, and the believed model says so.
    #[must_use]
    fn links_within(mut self, fraction: f64) -> Self {
        self.links_within = Some(fraction);
        self
    }

    /// The believed model knows this parameter, e.g. `spring.qeq@0`.
    #[must_use]
    fn fixed(mut self, what: &'static str) -> Self {
        self.fixed.push(what);
        self
    }

    /// Neither machine nor model has this effect of the device's, e.g. `spring@0`.
    #[must_use]
    fn no(mut self, what: &'static str) -> Self {
        self.removed.push(what);
        self
    }

    /// Physically the same thing there.
    #[must_use]
    fn or(mut self, what: &'static str) -> Self {
        self.or.push(what);
        self
    }

    /// A product of signals that shows that a discovered formula has found the law.
    #[must_use]
    fn term(mut self, what: &'static str) -> Self {
        self.terms.push(what);
        self
    }

    /// Commands are this much larger.
    #[must_use]
    fn drive(mut self, factor: f64) -> Self {
        self.drive = factor;
        self
    }

    /// Believed parameters are off by up to this fraction.
    #[must_use]
    fn off(mut self, fraction: f64) -> Self {
        self.off = fraction;
        self
    }
}

/// `id@joint<from symbol=value ..`
fn parse(text: &str) -> EffectEntry {
    let mut words = text.split_whitespace();
    let place = words.next().unwrap_or_default();
    let (id, place) = place.split_once('@').expect("an effect of the table is written `id@joint`");
    let (joint, from) = match place.split_once('<') {
        Some((joint, from)) => (joint, Some(from)),
        None => (place, None),
    };
    let number = |text: &str| text.parse().expect("joints of the table are numbers");
    let mut values: BTreeMap<String, f64> = words
        .map(|word| {
            let (symbol, value) = word.split_once('=').expect("values of the table are written `symbol=value`");
            (symbol.to_owned(), value.parse().expect("values of the table are numbers"))
        })
        .collect();
    for parameter in dynid_model::effect(id).map(|effect| effect.parameters.as_slice()).unwrap_or_default() {
        if parameter.origin == Origin::Numerical {
            values.entry(parameter.symbol.clone()).or_insert(parameter.initial);
        }
    }
    EffectEntry { id: id.to_owned(), joint: number(joint), from: from.map(number), values }
}

/// The effect with each value up to 15 % nearer to the one that does nothing, or farther; where there is none, or at
/// infinity, up to 15 % larger or smaller. What is no size, a joint or the width of a sign, stays.
fn varied(mut entry: EffectEntry, seed: u64) -> EffectEntry {
    const BY: f64 = 0.15;
    /// Of laws that no library has.
    const NO_SIZES: [&str; 2] = ["other", "v_eps"];
    let mut noise = Noise::new(0x0d1d_8000 + seed);
    let effect = dynid_model::effect(&entry.id);
    for (symbol, value) in &mut entry.values {
        let parameter = effect.and_then(|effect| effect.parameter(symbol));
        let null = parameter.and_then(|parameter| parameter.null).filter(|null| null.abs() < 10.0 * value.abs());
        let null = null.unwrap_or(0.0);
        let is_size = match parameter {
            Some(parameter) => parameter.origin != Origin::Numerical,
            None => !NO_SIZES.contains(&symbol.as_str()),
        };
        if is_size {
            *value = rounded(null + (*value - null) * (1.0 + BY * between(&mut noise)));
        }
    }
    entry
}

fn device(id: &str) -> &'static Device {
    dynid_model::device(id).expect("the table names devices of the library")
}

/// How the joints of a device are driven, damped and started; what its file leaves open or asks for otherwise.
struct Habits {
    /// Size of the commands of each joint.
    command: &'static [f64],
    /// Frequencies (Hz) and shares of the commands' size.
    waves: [(f64, f64); 5],
    /// Where each joint starts [rad or m], unless it has a spring.
    start: &'static [f64],
    /// N*m*s/rad
    viscous: &'static [f64],
    /// N*m
    coulomb: &'static [f64],
    /// Values of the machine, and of the believed model, that are not the device file's.
    links: &'static [(&'static str, f64)],
}

/// From slow, where friction and springs show, to fast, where inertia and lags do.
const WAVES: [(f64, f64); 5] = [(0.11, 0.6), (0.37, 0.4), (1.1, 0.3), (2.7, 0.27), (4.6, 0.2)];

fn habits(device: &str) -> Habits {
    match device {
        "freedom6s" => Habits {
            command: &[0.02, 0.018, 0.02, 0.008, 0.0038, 0.007],
            waves: WAVES,
            start: &[0.0, 0.1, 0.0, 0.2, -0.3, -0.4],
            viscous: &[0.03, 0.03, 0.04, 0.06, 0.006, 0.01],
            coulomb: &[0.004, 0.004, 0.008, 0.012, 0.0015, 0.004],
            links: &[],
        },
        "planar2r" => Habits {
            command: &[2.5, 0.8],
            waves: WAVES,
            start: &[-1.4, 0.2],
            viscous: &[0.6, 0.15],
            coulomb: &[0.2, 0.1],
            links: &[],
        },
        "double_pendulum" => Habits {
            command: &[1.5, 0.5],
            waves: WAVES,
            start: &[0.2, -0.2],
            viscous: &[0.25, 0.06],
            coulomb: &[0.08, 0.05],
            links: &[],
        },
        "servo_pendulum" => {
            Habits { command: &[4.0], waves: WAVES, start: &[0.3], viscous: &[0.04], coulomb: &[0.02], links: &[] }
        }
        "oscillator" => Habits {
            command: &[0.06],
            waves: [(0.5, 0.6), (2.1, 0.5), (4.4, 0.4), (6.3, 0.3), (9.0, 0.4)],
            start: &[0.02],
            viscous: &[0.006],
            coulomb: &[0.006],
            links: &[("link.1.m", 8e-4)],
        },
        "staubli_tx40" => Habits {
            command: &[25.0, 30.0, 15.0, 4.0, 5.0, 2.0],
            waves: WAVES,
            start: &[0.3, -0.4, 1.1, 0.2, 0.6, -0.3],
            viscous: &[8.0, 5.5, 2.0, 1.1, 1.8, 0.7],
            coulomb: &[7.0, 8.0, 6.5, 2.4, 3.2, 1.2],
            links: &[],
        },
        other => panic!("no case knows how to drive `{other}`"),
    }
}

/// Makes the case of that number from its plan. Variation 0 hides what the plan says; others differ in machine, belief, runs and
/// noise, and hide an effect that is somewhat larger or smaller.
#[must_use]
pub fn make(number: usize, plan: &Plan, variation: u32) -> Case {
    let seed = (u64::from(variation) << 32) + number as u64;
    let mut noise = Noise::new(0x0d1d_0000 + seed);
    let device = device(plan.device);
    let habits = habits(plan.device);
    let hidden = plan.hidden.map(parse).map(|hidden| if variation == 0 { hidden } else { varied(hidden, seed) });

    let rest = rest_of(plan, device, &habits, &mut noise);
    let mut effects = rest.clone();
    if let Some(hidden) = &hidden {
        let replaced: Vec<&str> = dynid_model::effect(&hidden.id)
            .map(|effect| effect.replaces.iter().map(|replaced| replaced.id.as_str()).collect())
            .unwrap_or_default();
        effects.retain(|entry| entry.joint != hidden.joint || !replaced.contains(&entry.id.as_str()));
        effects.push(hidden.clone());
    }
    let parameters = true_links(plan, device, &habits, &mut noise);
    let mut start: Vec<f64> = habits.start.iter().map(|start| start + 0.1 * between(&mut noise)).collect();
    if plan.device == "oscillator" {
        start[0] *= 0.2;
    }
    let name = format!(
        "{}-{}-{}",
        plan.device,
        plan.free.iter().map(usize::to_string).collect::<String>(),
        hidden.as_ref().map_or_else(|| plan.friction.to_owned(), |hidden| hidden.id.clone())
    );
    let truth = Recipe {
        device: plan.device.to_owned(),
        seed,
        sample_s: 0.01,
        steps_per_sample: 80,
        noise_rms: NOISE,
        quantum: QUANTUM,
        start,
        parameters,
        effects,
        runs: runs(plan, &habits, &mut noise),
        ..Recipe::default()
    };
    let without = Recipe { effects: rest.clone(), ..truth.clone() };
    let believed = believed(plan, device, &habits, &rest, &mut noise);
    let true_model = (plan.kind != Kind::Outside).then(|| true_model(plan, device, &truth));
    let mut accepted: Vec<Spot> = Vec::new();
    if let (Some(hidden), Kind::Hidden) = (&hidden, plan.kind) {
        let entries = std::iter::once(hidden.clone()).chain(plan.or.iter().map(|or| parse(or)));
        accepted = entries.flat_map(|entry| same_things(&entry, device, &plan.free)).collect();
    }
    let terms = plan.terms.iter().map(|&term| term.to_owned()).collect();
    Case {
        number,
        name: format!("{number:02}-{name}"),
        kind: plan.kind,
        free: plan.free.clone(),
        hidden,
        without,
        accepted,
        terms,
        believed,
        true_model,
        truth,
    }
}

/// An effect, and where else it would be the same: a pair whose joints are alike, a body on the same link.
fn same_things(entry: &EffectEntry, device: &Device, free: &[usize]) -> Vec<Spot> {
    let own = Spot { effect: entry.id.clone(), joint: entry.joint, from: entry.from };
    let mut spots = vec![own.clone()];
    let Some(effect) = dynid_model::effect(&entry.id) else {
        return spots;
    };
    let gives_both = effect.outputs.iter().any(|(name, _)| name == "torque_from");
    if let (Scope::Pair, Some(from)) = (effect.scope, entry.from)
        && (gives_both || effect.place == Place::Link)
    {
        spots.push(Spot { joint: from, from: Some(entry.joint), ..own.clone() });
    }
    if effect.place == Place::Link && effect.outputs.len() > 1 {
        let link = device.last_link_moved_by(entry.joint);
        let others = free.iter().filter(|&&joint| joint != entry.joint && device.last_link_moved_by(joint) == link);
        spots.extend(others.map(|&joint| Spot { joint, ..own.clone() }));
    }
    spots
}

/// Uniform in -1..1.
fn between(noise: &mut Noise) -> f64 {
    2.0 * noise.uniform() - 1.0
}

/// Four significant digits: what a person would write.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// The machine's effects apart from the hidden one.
fn rest_of(plan: &Plan, device: &Device, habits: &Habits, noise: &mut Noise) -> Vec<EffectEntry> {
    let mut rest = Vec::new();
    let entry = |id: &str, joint: usize, values: &[(&str, f64)]| {
        let values = values.iter().map(|&(symbol, value)| (symbol.to_owned(), rounded(value))).collect();
        EffectEntry { id: id.to_owned(), joint, from: None, values }
    };
    let is_removed = |id: &str, joint: usize| plan.removed.iter().any(|removed| *removed == format!("{id}@{joint}"));
    for &joint in &plan.free {
        for effect in device.effects.iter().filter(|effect| effect.joint == Some(joint)) {
            let is_friction = ["viscous", "coulomb", "lugre"].contains(&effect.id.as_str());
            if is_removed(&effect.id, joint) || (is_friction && (effect.id != "lugre" || plan.friction != "lugre")) {
                continue;
            }
            let values: Vec<(&str, f64)> = effect
                .values
                .iter()
                .map(|(symbol, parameter)| {
                    let value = match (parameter.fixed, symbol.as_str()) {
                        (true, _) => parameter.value,
                        (_, "qeq") => parameter.value + 0.05 * between(noise) * parameter.upper.min(1.0),
                        _ => parameter.value * (1.0 + 0.08 * between(noise)),
                    };
                    (symbol.as_str(), value)
                })
                .collect();
            rest.push(entry(&effect.id, joint, &values));
        }
        let fv = habits.viscous[joint] * (1.0 + 0.1 * between(noise));
        let fc = habits.coulomb[joint] * (1.0 + 0.1 * between(noise));
        if ["viscous", "coulomb"].contains(&plan.friction) && !is_removed("viscous", joint) {
            rest.push(entry("viscous", joint, &[("Fv", fv)]));
        }
        if plan.friction == "coulomb" && !is_removed("coulomb", joint) {
            rest.push(entry("coulomb", joint, &[("Fc", fc), ("v_eps", 0.01)]));
        }
    }
    rest
}

/// Inertial parameters of the machine: of each link, mass, centroid and inertia are off by a factor each, so that it stays
/// a body.
fn true_links(plan: &Plan, device: &Device, habits: &Habits, noise: &mut Noise) -> BTreeMap<String, f64> {
    let spread = plan.links_within.map_or(0.04, |within| f64::min(0.04, 0.6 * within));
    let mut values = BTreeMap::new();
    for (number, link) in (1..).zip(&device.links) {
        let factors = [0, 1, 2].map(|_| 1.0 + spread * between(noise));
        for (index, (symbol, parameter)) in Link::SYMBOLS.iter().zip(&link.inertial).enumerate() {
            let name = format!("link.{number}.{symbol}");
            let stated = habits.links.iter().find(|(own, _)| *own == name).map(|(_, value)| *value);
            let is_known = parameter.fixed || parameter.lower == parameter.upper;
            if is_known && stated.is_none() {
                continue;
            }
            let factor = factors[if index == 0 { 0 } else { 1 + usize::from(index > 3) }];
            let value = stated.unwrap_or(parameter.value);
            if value != 0.0 {
                values.insert(name, rounded(value * factor));
            }
        }
    }
    values
}

/// Two runs to fit to, the second a chirp, and one to judge by. All commands start at zero.
fn runs(plan: &Plan, habits: &Habits, noise: &mut Noise) -> Vec<RunEntry> {
    let mut sines = |size: f64| -> Vec<Cosine> {
        let mut waves = Vec::new();
        for &joint in &plan.free {
            for (hz, share) in habits.waves {
                waves.push(Cosine {
                    joint,
                    amplitude: rounded(size * plan.drive * habits.command[joint] * share),
                    hz: rounded(hz * (1.0 + 0.15 * between(noise))),
                    hz_per_s: 0.0,
                    phase: if noise.uniform() < 0.5 { FRAC_PI_2 } else { -FRAC_PI_2 },
                });
            }
        }
        waves
    };
    let (first, mut second, third) = (sines(1.0), sines(0.8), sines(0.9));
    let slowest = habits.waves[0].0;
    let fastest = habits.waves[4].0;
    for (index, wave) in second.iter_mut().enumerate() {
        match index % habits.waves.len() {
            // from slow to fast in 30 s, one of the joints from fast to slow
            2 if (index / habits.waves.len()).is_multiple_of(2) => {
                (wave.hz, wave.hz_per_s) = (slowest, rounded((fastest - slowest) / 30.0));
                wave.amplitude *= 1.6;
            }
            2 => {
                (wave.hz, wave.hz_per_s) = (fastest, rounded(-(fastest - slowest) / 30.0));
                wave.amplitude *= 1.6;
            }
            _ => {}
        }
    }
    [("fit-1.csv", "fit", first), ("fit-2.csv", "fit", second), ("validate.csv", "validate", third)]
        .map(|(file, role, torque)| RunEntry {
            file: file.to_owned(),
            free: plan.free.clone(),
            role: role.to_owned(),
            duration_s: 30.0,
            torque,
            ..RunEntry::default()
        })
        .into()
}

/// What is believed: the device file's links, and the machine's effects without the hidden one, both a few per cent off.
fn believed(plan: &Plan, device: &Device, habits: &Habits, rest: &[EffectEntry], noise: &mut Noise) -> String {
    let mut text = format!(
        "# What is believed before anything is fitted. Links are the device file's{}.\n",
        plan.links_within.map_or_else(String::new, |within| format!(", known to {} %", 100.0 * within))
    );
    let _ = writeln!(text, "device = \"{}\"", device.id);
    for (number, link) in (1..).zip(&device.links) {
        let mut lines = String::new();
        for (symbol, parameter) in Link::SYMBOLS.iter().zip(&link.inertial) {
            let stated = habits.links.iter().find(|(own, _)| *own == format!("link.{number}.{symbol}"));
            let is_known = parameter.fixed || parameter.lower == parameter.upper;
            match (stated, plan.links_within) {
                (Some((_, value)), _) => {
                    let _ = writeln!(lines, "{symbol} = {}", rounded(value * (1.0 + plan.off * between(noise))));
                }
                (None, Some(within)) if !is_known && parameter.value != 0.0 => {
                    let value = parameter.value;
                    let reach = within * value.abs();
                    let (lower, upper) = (rounded(value - reach), rounded(value + reach));
                    let _ = writeln!(lines, "{symbol} = {{ value = {value}, lower = {lower}, upper = {upper} }}");
                }
                _ => {}
            }
        }
        if !lines.is_empty() {
            let _ = write!(text, "\n[link.{number}]\n{lines}");
        }
    }
    for entry in rest {
        let off = |symbol: &str, value: f64, noise: &mut Noise| {
            let is_known = is_known(plan, device, entry, symbol);
            match symbol {
                _ if is_known => value,
                "qeq" => value + 0.5 * plan.off * between(noise) * if device.id == "oscillator" { 0.1 } else { 1.0 },
                _ => value * (1.0 + plan.off * between(noise)),
            }
        };
        text.push_str(&table_of(entry, &mut |symbol, value| {
            let value = rounded(off(symbol, value, noise));
            if is_known(plan, device, entry, symbol) && !is_numerical(&entry.id, symbol) {
                format!("{{ value = {value}, fixed = true }}")
            } else {
                format!("{value}")
            }
        }));
    }
    text
}

/// Whether the believed model knows a value: the gains of a device whose links are all unknown, what the device file
/// fixes, what the plan fixes, and choices of the numerics.
fn is_known(plan: &Plan, device: &Device, entry: &EffectEntry, symbol: &str) -> bool {
    let of_device = device.effects.iter().find(|effect| effect.joint == Some(entry.joint) && effect.id == entry.id);
    let is_fixed =
        of_device.is_some_and(|effect| effect.values.iter().any(|(own, parameter)| own == symbol && parameter.fixed));
    let links_are_known = device.links.iter().all(|link| link.inertial.iter().all(|p| p.lower == p.upper));
    is_fixed
        || is_numerical(&entry.id, symbol)
        || (symbol == "Kp" && !links_are_known)
        || plan.fixed.iter().any(|fixed| *fixed == format!("{}.{symbol}@{}", entry.id, entry.joint))
}

fn is_numerical(id: &str, symbol: &str) -> bool {
    dynid_model::effect(id)
        .and_then(|effect| effect.parameter(symbol))
        .is_some_and(|parameter| parameter.origin == Origin::Numerical)
}

fn table_of(entry: &EffectEntry, value: &mut dyn FnMut(&str, f64) -> String) -> String {
    let mut text = format!("\n[[effect]]\nid = \"{}\"\n", entry.id);
    if let Some(from) = entry.from {
        let _ = writeln!(text, "from = {from}");
    }
    let _ = writeln!(text, "joint = {}", entry.joint);
    for (symbol, own) in &entry.values {
        let _ = writeln!(text, "{symbol} = {}", value(symbol, *own));
    }
    text
}

/// The machine as a model: what a perfect fit would find.
fn true_model(plan: &Plan, device: &Device, truth: &Recipe) -> String {
    let mut text = format!("# The machine as it is.\ndevice = \"{}\"\n", truth.device);
    for number in 1..=device.links.len() {
        let prefix = format!("link.{number}.");
        let of_link: Vec<(&str, f64)> =
            truth.parameters.iter().filter_map(|(name, value)| Some((name.strip_prefix(&prefix)?, *value))).collect();
        if !of_link.is_empty() {
            let _ = write!(text, "\n[link.{number}]\n");
            for (symbol, value) in of_link {
                let _ = writeln!(text, "{symbol} = {value}");
            }
        }
    }
    for entry in &truth.effects {
        text.push_str(&table_of(entry, &mut |symbol, value| {
            if is_known(plan, device, entry, symbol) && !is_numerical(&entry.id, symbol) {
                format!("{{ value = {value}, fixed = true }}")
            } else {
                format!("{value}")
            }
        }));
    }
    text
}

#[cfg(test)]
mod tests {
    use dynid_model::physical_consistency::check_body;

    use super::*;
    use crate::effects::outside;

    #[test]
    fn every_effect_of_the_library_is_hidden_somewhere() {
        let cases = table::cases();
        for effect in dynid_model::effects().iter().filter(|effect| !effect.general) {
            let is_hidden = |case: &Case| case.hidden.as_ref().is_some_and(|hidden| hidden.id == effect.id);
            assert!(cases.iter().any(is_hidden), "no case hides `{}`", effect.id);
        }
        let outside = |case: &&Case| case.kind == Kind::Outside;
        for case in cases.iter().filter(outside) {
            let id = &case.hidden.as_ref().unwrap().id;
            assert!(outside::IDS.contains(&id.as_str()) && dynid_model::effect(id).is_none(), "{id}");
        }
    }

    #[test]
    fn links_are_bodies() {
        for case in table::cases() {
            let device = device(&case.truth.device);
            for (number, link) in (1..).zip(&device.links) {
                let value = |index: usize| {
                    let name = format!("link.{number}.{}", Link::SYMBOLS[index]);
                    case.truth.parameters.get(&name).copied().unwrap_or(link.inertial[index].value)
                };
                check_body(&std::array::from_fn(value)).unwrap_or_else(|reason| panic!("{}: {reason}", case.name));
            }
        }
    }

    /// What a believed or true model states, as a recipe does.
    #[derive(serde::Deserialize)]
    struct Stated {
        #[serde(default)]
        effect: Vec<toml::Table>,
    }

    #[test]
    fn believed_models_lack_the_effect_and_are_a_little_off_otherwise() {
        for case in table::cases() {
            let believed: Stated = toml::from_str(&case.believed).unwrap();
            assert_eq!(believed.effect.len(), case.without.effects.len(), "{}", case.name);
            for (stated, entry) in believed.effect.iter().zip(&case.without.effects) {
                assert_eq!(stated["id"].as_str(), Some(entry.id.as_str()), "{}", case.name);
                for (symbol, value) in &entry.values {
                    let told = &stated[symbol];
                    let told = told.get("value").unwrap_or(told);
                    let told = told.as_float().or(told.as_integer().map(|value| value as f64)).unwrap();
                    let reach = if symbol == "qeq" { 0.03 } else { 0.051 * value.abs() };
                    assert!((told - value).abs() <= reach, "{}: {symbol} = {told}, not {value}", case.name);
                }
            }
            let is_hidden = |entry: &EffectEntry| case.hidden.as_ref() == Some(entry);
            assert_eq!(case.truth.effects.iter().any(is_hidden), case.kind != Kind::Nothing, "{}", case.name);
            assert!(!case.without.effects.iter().any(is_hidden), "{}", case.name);
        }
    }

    #[test]
    fn the_table_is_as_large_as_it_must_be_and_the_same_again() {
        let (cases, again) = (table::cases(), table::cases());
        for (kind, at_least) in [(Kind::Hidden, 60), (Kind::Nothing, 20), (Kind::Outside, 10)] {
            assert!(cases.iter().filter(|case| case.kind == kind).count() >= at_least);
        }
        for (one, other) in cases.iter().zip(&again) {
            assert_eq!((&one.truth, &one.believed), (&other.truth, &other.believed));
        }
        // To four digits a value may come out the same.
        let mut n_varied = 0;
        for (one, other) in (1..8).flat_map(|variation| cases.iter().zip(table::varied(variation)).collect::<Vec<_>>())
        {
            assert_eq!((&one.name, &one.free), (&other.name, &other.free));
            assert!(one.truth.parameters != other.truth.parameters || one.truth.start != other.truth.start);
            assert_ne!(one.truth.runs, other.truth.runs);
            assert_ne!(one.truth.seed, other.truth.seed);
            if let (Some(one), Some(other)) = (&one.hidden, &other.hidden) {
                n_varied += usize::from(one != other);
                for (symbol, value) in &one.values {
                    let is_joint = symbol == "other";
                    assert!(!is_joint || other.values[symbol] == *value, "{other:?}");
                    assert!(
                        (other.values[symbol] - value).abs() <= 0.151 * value.abs(),
                        "{symbol}: {one:?}, {other:?}"
                    );
                }
            }
        }
        let n_hidden = cases.iter().filter(|case| case.hidden.is_some()).count();
        assert!(n_varied > 7 * n_hidden - 10, "{n_varied} of {}", 7 * n_hidden);
    }

    #[test]
    fn free_joints_are_a_configuration() {
        for case in table::cases() {
            assert!(device(&case.truth.device).configuration_of(&case.free).is_some(), "{}", case.name);
        }
    }
}

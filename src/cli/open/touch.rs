//! A virtual wall under a simulated hand, as `dynid wall run` plays it, with numbers of wall and controller changed by hand.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use dynid_control::{Law, RuleTable};
use dynid_haptics::wall::{SLOWEST_HZ, Sampling, Setting, WallFile};
use serde::Deserialize;
use serde_json::{Value, json};
use toml_edit::DocumentMut;

use super::App;
use super::answer::{Answered, Asked, Refusal, blocking};
use super::files::put;
use super::logs::units_of;
use crate::cli::wall;

#[derive(Deserialize)]
pub struct TouchAsked {
    model: Option<String>,
    setting: Option<String>,
    wall: String,
    #[serde(default)]
    changes: BTreeMap<String, f64>,
    hand: Option<usize>,
    speed: Option<String>,
    /// Where to write the changed wall.
    out: Option<String>,
}

/// `POST api/wall`
pub async fn touch(State(app): State<Arc<App>>, Asked(asked): Asked<TouchAsked>) -> Answered {
    blocking(move || {
        let place = |path: &Option<String>| path.as_deref().map(|path| app.folder.place(path)).transpose();
        let (model, setting, out) = (place(&asked.model)?, place(&asked.setting)?, place(&asked.out)?);
        if asked.wall.contains(['/', '.']) {
            app.folder.place(&asked.wall)?;
        }
        for document in model.iter().chain(&setting) {
            app.folder.check_references(document)?;
        }
        let setting = match setting {
            Some(path) => SettingText { text: dynid_files::read(&path)?, path },
            None => SettingText { text: dynid_haptics::wall::SETTING.to_owned(), path: "setting.toml".into() },
        };
        let mut at_work = Setting::parse(&setting.text, &setting.path)?;
        let (name, mut file) = wall::wall_of(&asked.wall)?;
        let model = app.effects.known(wall::model_of(model.as_deref(), at_work.device))?;
        let movable: Vec<(Change, f64)> = changes(&file, &at_work);
        for (key, value) in &asked.changes {
            let (change, _) = movable.iter().find(|(change, _)| change.key == *key).ok_or_else(|| {
                Refusal::bad(format!("`{key}` is no number of this wall; its answer lists them under `changes`"))
            })?;
            change.check(*value)?;
            match change.what {
                What::SampleRate => at_work = setting.sampled(1.0 / value, at_work.step_s)?,
                What::Gain(gain) => gain(&mut file.law).into_iter().for_each(|own| *own = *value),
                What::Rule(index) => set_rule(&mut file, index, *value)?,
            }
        }
        let setting = at_work;
        let played = wall::played(&model, &setting, (&name, &file), asked.speed.as_deref(), asked.hand)?;
        if let Some(out) = out {
            let _alone = app.writing();
            put(&out, &file.to_toml(&format!("Changed by hand from `{name}` on the page of `dynid open`.")), false)?;
        }
        let wall::Played { contact, measures, felt } = played;
        let t: Vec<f64> = (0..contact.position.len()).map(|tick| tick as f64 * contact.sample_s).collect();
        let deepest = contact.position.iter().fold(0.0_f64, |deepest, position| deepest.max(-position));
        let changes = movable.iter().map(|(change, value)| {
            let value = asked.changes.get(&change.key).copied().unwrap_or(*value);
            json!({ "key": change.key, "value": value, "lower": change.lower, "upper": change.upper, "unit": change.unit })
        });
        Ok(Json(json!({
            "t": t,
            "position": contact.position,
            "torque": contact.torque,
            "wall": 0.0,
            "units": units(&setting),
            "depth_max": deepest,
            "chatter": measures.chatter_rms,
            "felt": felt,
            "changes": changes.collect::<Vec<Value>>(),
        })))
    })
    .await
}

/// The text of a setting, and where it stands.
struct SettingText {
    text: String,
    path: PathBuf,
}

impl SettingText {
    /// The setting with another time between two ticks (s): read anew, for its filter goes by the same clock. A step of the simulation
    /// is no longer than that.
    fn sampled(&self, sample_s: f64, step_s: f64) -> Result<Setting, Refusal> {
        let mut document: DocumentMut = self.text.parse()?;
        document["controller"]["sample_s"] = toml_edit::value(sample_s);
        document["simulation"]["step_s"] = toml_edit::value(step_s.min(sample_s));
        Ok(Setting::parse(&document.to_string(), &self.path)?)
    }
}

/// Units of what is shown, by the joint that meets the wall.
fn units(setting: &Setting) -> Value {
    let (position, torque) = units_of(setting.device, setting.joint);
    json!({
        "position": position,
        "torque": torque,
        "depth_max": position,
        "chatter_rms": position,
        "peak_to_peak": position,
        "settled_position": position,
        "frequency": "Hz",
        "stiffness": format!("{torque}/{position}"),
        "energy_out": "J",
        // A share of the time.
        "outside": "1",
    })
}

/// A number that can be moved.
struct Change {
    key: String,
    what: What,
    /// What a wall's law and a setting's reader take, not what is wise; infinite where that has no end.
    lower: f64,
    upper: f64,
    unit: String,
}

#[derive(Clone, Copy)]
enum What {
    Gain(Gain),
    Rule(usize),
    SampleRate,
}

/// The place of a number in a law.
type Gain = for<'a> fn(&'a mut Law) -> Option<&'a mut f64>;

/// What a gain makes of the motion.
#[derive(Clone, Copy)]
enum Kind {
    Share,
    Stiffness,
    Damping,
    Inertia,
}

impl Kind {
    /// The unit of a gain from positions in this unit to the output of the law, which has none: one of it is `torque_per_unit`.
    fn unit(self, position: &str) -> String {
        match self {
            Self::Share => String::new(),
            Self::Stiffness => format!("1/{position}"),
            Self::Damping => format!("s/{position}"),
            Self::Inertia => format!("s^2/{position}"),
        }
    }
}

/// The gains that laws have.
const GAINS: [(&str, Kind, Gain); 9] = [
    ("k1", Kind::Stiffness, |law| {
        if let Law::Linear(own) | Law::Leaky { linear: own, .. } = law { Some(&mut own.k1) } else { None }
    }),
    ("k2", Kind::Damping, |law| {
        if let Law::Linear(own) | Law::Leaky { linear: own, .. } = law { Some(&mut own.k2) } else { None }
    }),
    ("leak.stiffness", Kind::Share, |law| if let Law::Leaky { stiffness, .. } = law { Some(stiffness) } else { None }),
    ("leak.share", Kind::Share, |law| if let Law::Leaky { share, .. } = law { Some(share) } else { None }),
    ("coupling.inertia", Kind::Inertia, |law| if let Law::Coupled(own) = law { Some(&mut own.inertia) } else { None }),
    ("coupling.wall_stiffness", Kind::Stiffness, |law| {
        if let Law::Coupled(own) = law { Some(&mut own.wall_stiffness) } else { None }
    }),
    ("coupling.wall_damping", Kind::Damping, |law| {
        if let Law::Coupled(own) = law { Some(&mut own.wall_damping) } else { None }
    }),
    (
        "coupling.stiffness",
        Kind::Stiffness,
        |law| if let Law::Coupled(own) = law { Some(&mut own.stiffness) } else { None },
    ),
    ("coupling.damping", Kind::Damping, |law| if let Law::Coupled(own) = law { Some(&mut own.damping) } else { None }),
];

/// What can be moved, and where it stands.
fn changes(file: &WallFile, setting: &Setting) -> Vec<(Change, f64)> {
    let (position, _) = units_of(setting.device, setting.joint);
    let mut changes = Vec::new();
    let mut law = file.law.clone();
    for (key, kind, gain) in GAINS {
        if let Some(value) = gain(&mut law).copied() {
            // A wall resists; one of a file that helps along may go on to.
            let (lower, upper) = (value.min(0.0), if key == "leak.share" { 1.0 } else { f64::INFINITY });
            let unit = kind.unit(position);
            changes.push((Change { key: key.to_owned(), what: What::Gain(gain), lower, upper, unit }, value));
        }
    }
    if let Law::Rules(table) = &file.law {
        for (index, value) in table.outputs().iter().enumerate() {
            let (row, column) = (index / table.position().len(), index % table.position().len());
            let key = format!("rules.{}.{}", table.velocity().names()[row], table.position().names()[column]);
            // What is beyond the limit of the torque does nothing more.
            let most = (setting.torque_limit / file.scale).max(value.abs());
            let what = What::Rule(index);
            changes.push((Change { key, what, lower: -most, upper: most, unit: String::new() }, *value));
        }
    }
    // Chatter that a slower controller has does not show, and the reader of settings refuses it.
    let (lower, upper) = ((2.0 * SLOWEST_HZ).next_up(), 1.0 / Sampling::SHORTEST_S);
    let unit = "Hz".to_owned();
    let rate = Change { key: "sample_rate".to_owned(), what: What::SampleRate, lower, upper, unit };
    changes.push((rate, 1.0 / setting.sample_s));
    changes
}

impl Change {
    fn check(&self, value: f64) -> Result<(), Refusal> {
        // An infinite end is none.
        if value.is_finite() && (self.lower..=self.upper).contains(&value) {
            return Ok(());
        }
        Err(Refusal::bad(format!("{} = {value} lies outside of {} to {}", self.key, self.lower, self.upper)))
    }
}

fn set_rule(file: &mut WallFile, index: usize, value: f64) -> Result<(), Refusal> {
    if let Law::Rules(table) = &file.law {
        let mut outputs = table.outputs().to_vec();
        outputs[index] = value;
        file.law = Law::Rules(RuleTable::new(table.position().clone(), table.velocity().clone(), outputs)?);
    }
    // Rules that were changed do not come from a linear law any more.
    file.base = None;
    Ok(())
}

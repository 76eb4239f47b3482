//! A virtual wall under a simulated hand, as `dynid wall run` plays it, with numbers of wall and controller changed by hand.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use dynid_control::{Law, RuleTable};
use dynid_haptics::wall::{Setting, WallFile};
use serde::Deserialize;
use serde_json::{Value, json};

use super::App;
use super::answer::{Answered, Asked, Refusal, blocking};
use super::files::put;
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
        let mut setting = setting.map_or_else(Setting::shipped, |path| Setting::load(&path))?;
        let (name, mut file) = wall::wall_of(&asked.wall)?;
        let model = app.effects.known(wall::model_of(model.as_deref(), setting.device))?;
        // What can be moved is told with the bounds that the values as they stand give.
        let movable: Vec<(Change, f64)> = changes(&file, &setting);
        for (key, value) in &asked.changes {
            let (change, _) = movable.iter().find(|(change, _)| change.key == *key).ok_or_else(|| {
                Refusal::bad(format!("`{key}` is no number of this wall; its answer lists them under `changes`"))
            })?;
            change.make(*value, &mut file, &mut setting)?;
        }
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
            "depth_max": deepest,
            "chatter": measures.chatter_rms,
            "felt": felt,
            "changes": changes.collect::<Vec<Value>>(),
        })))
    })
    .await
}

/// A number that can be moved.
struct Change {
    key: String,
    what: What,
    lower: f64,
    upper: f64,
    unit: &'static str,
}

#[derive(Clone, Copy)]
enum What {
    Gain(Gain),
    Rule(usize),
    SampleRate,
}

/// The place of a number in a law.
type Gain = for<'a> fn(&'a mut Law) -> Option<&'a mut f64>;

/// The gains that laws have.
const GAINS: [(&str, Gain); 9] = [
    ("k1", |law| if let Law::Linear(own) | Law::Leaky { linear: own, .. } = law { Some(&mut own.k1) } else { None }),
    ("k2", |law| if let Law::Linear(own) | Law::Leaky { linear: own, .. } = law { Some(&mut own.k2) } else { None }),
    ("leak.stiffness", |law| if let Law::Leaky { stiffness, .. } = law { Some(stiffness) } else { None }),
    ("leak.share", |law| if let Law::Leaky { share, .. } = law { Some(share) } else { None }),
    ("coupling.inertia", |law| if let Law::Coupled(own) = law { Some(&mut own.inertia) } else { None }),
    ("coupling.wall_stiffness", |law| if let Law::Coupled(own) = law { Some(&mut own.wall_stiffness) } else { None }),
    ("coupling.wall_damping", |law| if let Law::Coupled(own) = law { Some(&mut own.wall_damping) } else { None }),
    ("coupling.stiffness", |law| if let Law::Coupled(own) = law { Some(&mut own.stiffness) } else { None }),
    ("coupling.damping", |law| if let Law::Coupled(own) = law { Some(&mut own.damping) } else { None }),
];

/// What can be moved, and where it stands.
fn changes(file: &WallFile, setting: &Setting) -> Vec<(Change, f64)> {
    /// Rates of a controller (Hz).
    const RATES: (f64, f64) = (10.0, 10_000.0);
    let mut changes = Vec::new();
    let mut law = file.law.clone();
    for (key, gain) in GAINS {
        if let Some(value) = gain(&mut law).copied() {
            let (lower, upper) =
                if key == "leak.share" { (0.0, 1.0) } else { (value.min(0.0) * 4.0, value.max(0.0) * 4.0) };
            changes.push((Change { key: key.to_owned(), what: What::Gain(gain), lower, upper, unit: "" }, value));
        }
    }
    if let Law::Rules(table) = &file.law {
        let largest = table.outputs().iter().fold(0.0_f64, |largest, output| largest.max(output.abs()));
        for (index, value) in table.outputs().iter().enumerate() {
            let (row, column) = (index / table.position().len(), index % table.position().len());
            let key = format!("rules.{}.{}", table.velocity().names()[row], table.position().names()[column]);
            let (lower, upper) = (-2.0 * largest, 2.0 * largest);
            changes.push((Change { key, what: What::Rule(index), lower, upper, unit: "" }, *value));
        }
    }
    let (lower, upper) = RATES;
    let rate = Change { key: "sample_rate".to_owned(), what: What::SampleRate, lower, upper, unit: "Hz" };
    changes.push((rate, 1.0 / setting.sample_s));
    changes
}

impl Change {
    fn make(&self, value: f64, file: &mut WallFile, setting: &mut Setting) -> Result<(), Refusal> {
        if !(self.lower..=self.upper).contains(&value) {
            return Err(Refusal::bad(format!(
                "{} = {value} lies outside of {} to {}",
                self.key, self.lower, self.upper
            )));
        }
        match self.what {
            What::Gain(gain) => gain(&mut file.law).into_iter().for_each(|own| *own = value),
            What::Rule(index) => {
                if let Law::Rules(table) = &file.law {
                    let mut outputs = table.outputs().to_vec();
                    outputs[index] = value;
                    file.law = Law::Rules(RuleTable::new(table.position().clone(), table.velocity().clone(), outputs)?);
                }
                // Rules that were changed do not come from a linear law any more.
                file.base = None;
            }
            What::SampleRate => {
                setting.sample_s = 1.0 / value;
                setting.step_s = setting.step_s.min(setting.sample_s);
            }
        }
        Ok(())
    }
}

//! What has changed on which robot.

use dynid_fleet::{Analysis, Change, Event, Lacking, Shape, Unlike};
use dynid_format::number;
use serde_json::{Value, json};

/// The answer in one sentence.
pub fn verdict(analysis: &Analysis) -> String {
    let (robots, nights) = (analysis.robots.len(), analysis.nights.len());
    if analysis.looks == 0 {
        return "No robot has the four nights that a change needs to be seen.".to_owned();
    }
    let mut changed: Vec<String> = analysis.events().into_iter().map(|own| own.robot).collect();
    changed.dedup();
    match changed.len() {
        0 => format!("Nothing has changed in {nights} nights that could not be chance; robots looked at: {robots}."),
        count => format!("In {nights} nights {count} of {robots} robots changed: {}.", changed.join(", ")),
    }
}

/// What happened to a robot: its surest change, and what else changed at that time.
pub fn event(event: &Event) -> String {
    let said: Vec<String> = event.changes.iter().map(change).collect();
    format!("{} since {}: {}", event.robot, event.night, said.join("; "))
}

/// What changed, by how much, and how sure that is.
pub fn change(own: &Change) -> String {
    let Change { quantity, shape, from, to, by, std_error, chance, .. } = own;
    let [from, to, by, std_error] = [*from, *to, *by, *std_error].map(number);
    let how = match shape {
        Shape::Step => format!("{from} -> {to} (by {by} \u{b1} {std_error})"),
        Shape::Drift => format!("drifts from {from} to {to} (by {by} \u{b1} {std_error} a night)"),
        Shape::Stray => format!("{to} instead of {from} in this night alone"),
    };
    format!("`{quantity}` {how}, by chance {}", probability(*chance))
}

/// A night that stands alone.
pub fn stray(own: &Change) -> String {
    format!("{} in {}: {}", own.robot, own.night, change(own))
}

/// A robot that is unlike the others.
pub fn unlike(own: &Unlike) -> String {
    let [value, std_error, middle, spread] = [own.value, own.std_error, own.middle, own.spread].map(number);
    format!(
        "{}: `{}` is {value} \u{b1} {std_error}, those of the fleet are {middle} \u{b1} {spread}",
        own.robot, own.quantity
    )
}

/// A robot without what others have.
pub fn lacking(own: &Lacking) -> String {
    format!("{}: its model has no `{}`, which {} others have", own.robot, own.quantity, own.others)
}

fn probability(chance: f64) -> String {
    if chance < 1e-3 {
        "in fewer than 1 of 1000 fleets".to_owned()
    } else {
        format!("in {} % of fleets", number(100.0 * chance))
    }
}

/// All that an analysis says.
///
/// # Errors
/// None that these values can cause.
pub fn json(analysis: &Analysis) -> serde_json::Result<Value> {
    let mut json = serde_json::to_value(analysis)?;
    json["what"] = verdict(analysis).into();
    let events = analysis.events();
    json["events"] = serde_json::to_value(&events)?;
    for (own, entry) in events.iter().zip(json["events"].as_array_mut().into_iter().flatten()) {
        entry["what"] = json!(event(own));
    }
    crate::each(&mut json, "unlike", &analysis.unlike, |own, entry| {
        entry["what"] = unlike(own).into();
        Ok(())
    })?;
    crate::each(&mut json, "lacking", &analysis.lacking, |own, entry| {
        entry["what"] = lacking(own).into();
        Ok(())
    })?;
    Ok(json)
}

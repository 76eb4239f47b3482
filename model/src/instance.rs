//! `[[effect]]` tables: an effect at its place, in device files and in users' models alike.

use crate::{
    device::DefaultEffect,
    document::{Entry, Table},
    effect::{Effect, Place, Scope, Stage},
    error::{ModelError, did_you_mean},
    parameter::Parameter,
};

/// Gives the parameter (value and bounds) that stands where a file says nothing, or says only a value:
/// `(effect, (joint, from), symbol, stated value)`.
pub type DefaultParameter<'a> =
    dyn Fn(&Effect, (Option<usize>, Option<usize>), &str, Option<f64>) -> Option<Parameter> + 'a;

/// Values that differ by less than this share are equal: as near as a fit comes to an order that it keeps.
pub const EQUAL: f64 = 1e-6;

/// Reads one `[[effect]]` table: one effect a joint that it names. Only the parameters that stand in the file are in `values`.
///
/// # Errors
/// An unknown effect, joint or parameter, a value outside its bounds; with its place.
pub fn read_instances(
    table: &Table,
    n_joints: usize,
    effects: &[Effect],
    default: &DefaultParameter,
) -> Result<Vec<DefaultEffect>, ModelError> {
    let entry = table.required("id", "\"<effect>\"")?;
    let id = entry.text()?;
    let Some(effect) = effects.iter().find(|effect| effect.id == id) else {
        let known = did_you_mean(id, effects.iter().map(|effect| effect.id.as_str()));
        return Err(entry.error(format!("unknown effect `{id}`")).help(known));
    };
    let place = |key: &str| {
        table
            .required(key, "<joint>")
            .map_err(|error| error.help(format!("`{id}` acts on {}; add `{key} = <joint>`", scope_text(effect.scope))))
    };
    let from = match effect.scope {
        Scope::Pair => Some(read_joint(&place("from")?, id, n_joints)?),
        Scope::Joint | Scope::Device => None,
    };
    let joints: Vec<Option<usize>> = match effect.scope {
        Scope::Device => vec![None],
        Scope::Joint | Scope::Pair => {
            let named = read_joints(&place("joint")?, id, from, n_joints)?;
            named.into_iter().map(Some).collect()
        }
    };
    let payload = table.optional("payload").map(|entry| read_payload(&entry)).transpose()?;
    joints
        .into_iter()
        .map(|joint| {
            if joint.is_some() && joint == from {
                return Err(
                    table.error(format!("effect `{id}` couples joint {} with itself", joint.unwrap_or_default()))
                );
            }
            let values = read_values(table, effect, (joint, from), default)?;
            Ok(DefaultEffect { id: id.to_owned(), joint, from, payload: payload.clone(), values })
        })
        .collect()
}

fn read_joint(entry: &Entry, id: &str, n_joints: usize) -> Result<usize, ModelError> {
    let joint = entry.index()?;
    if joint >= n_joints {
        return Err(entry
            .error(format!("unknown joint {joint} for effect `{id}`"))
            .help(format!("the device has joints 0..{}", n_joints - 1)));
    }
    Ok(joint)
}

/// `3`, `[0, 1, 3]` or `"all"`: all but the other joint of a pair.
fn read_joints(entry: &Entry, id: &str, from: Option<usize>, n_joints: usize) -> Result<Vec<usize>, ModelError> {
    if let Ok(word) = entry.text() {
        if word != "all" {
            return Err(entry
                .error(format!("`{word}` is no joint for effect `{id}`"))
                .help("name a joint by its index, several as `[0, 1]`, or every one as \"all\""));
        }
        return Ok((0..n_joints).filter(|joint| Some(*joint) != from).collect());
    }
    let Ok(entries) = entry.array() else { return Ok(vec![read_joint(entry, id, n_joints)?]) };
    if entries.is_empty() {
        return Err(entry.error(format!("no joint is named for effect `{id}`")).help("name one, or remove the table"));
    }
    let mut joints = Vec::new();
    for entry in entries {
        let joint = read_joint(&entry, id, n_joints)?;
        if joints.contains(&joint) {
            return Err(entry.error(format!("joint {joint} is named twice for effect `{id}`")).help("name it once"));
        }
        joints.push(joint);
    }
    Ok(joints)
}

/// The name of a payload: a part of parameter names.
///
/// # Errors
/// Other than letters, digits and `_`.
pub fn check_payload(name: &str) -> Result<(), String> {
    if !name.is_empty() && name.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_') {
        return Ok(());
    }
    Err(format!("`{name}` is no name of a payload; use letters, digits and `_`"))
}

fn read_payload(entry: &Entry) -> Result<String, ModelError> {
    let name = entry.text()?;
    check_payload(name).map_err(|message| entry.error(message))?;
    Ok(name.to_owned())
}

/// The parameters of one effect that stand in its table.
fn read_values(
    table: &Table,
    effect: &Effect,
    (joint, from): (Option<usize>, Option<usize>),
    default: &DefaultParameter,
) -> Result<Vec<(String, Parameter)>, ModelError> {
    let id = &effect.id;
    let what = instance_name(id, joint, from);
    let places: &[&str] = match effect.scope {
        Scope::Joint => &["joint"],
        Scope::Pair => &["from", "joint"],
        Scope::Device => &[],
    };
    let mut values = Vec::new();
    for (key, span) in table.keys() {
        if ["id", "payload"].contains(&key) || places.contains(&key) {
            continue;
        }
        if effect.parameter(key).is_none() {
            let symbols = effect.parameters.iter().map(|parameter| parameter.symbol.as_str());
            let known = did_you_mean(key, symbols.chain(places.iter().copied()));
            return Err(table.source.error(span, format!("`{id}` has no parameter `{key}`")).help(known));
        }
        let entry = table.required(key, "<number>")?;
        let fallback = |value: f64| {
            default(effect, (joint, from), key, Some(value)).unwrap_or(Parameter {
                value,
                lower: f64::NEG_INFINITY,
                upper: f64::INFINITY,
                fixed: false,
            })
        };
        values.push((key.to_owned(), entry.parameter(&fallback)?));
    }
    for (left, comparison, right) in &effect.inequalities {
        let value_of = |symbol: &str| {
            values
                .iter()
                .find(|(name, _)| name == symbol)
                .map(|(_, parameter)| *parameter)
                .or_else(|| default(effect, (joint, from), symbol, None))
                .map_or(f64::NAN, |parameter| parameter.value)
        };
        let (a, b) = (value_of(left), value_of(right));
        // Equality is the limit of the inequality and is allowed (thesis Eq. 4.1); a fit reaches it up to rounding.
        let is_equal = (a - b).abs() <= EQUAL * (a.abs() + b.abs());
        if !is_equal && !comparison.holds(a, b) {
            let place = [left, right].into_iter().find(|symbol| table.optional(symbol.as_str()).is_some());
            let span = place.map_or(table.span.clone(), |symbol| table.key_span(symbol));
            let sign = comparison.symbol();
            return Err(table
                .source
                .error(span, format!("{what} needs `{left} {sign} {right}`, found {left} = {a} and {right} = {b}"))
                .help("change one of the two"));
        }
    }
    Ok(values)
}

/// Refuses an effect that stands twice at one place, two alternatives at one joint, and an effect beside one that contains it; those of
/// a payload only meet those of the same payload.
///
/// # Errors
/// At the later of the two tables.
pub fn check_instances(instances: &[(&Table, DefaultEffect)], effects: &[Effect]) -> Result<(), ModelError> {
    let alternatives = |instance: &DefaultEffect| {
        effects.iter().find(|effect| effect.id == instance.id).and_then(|effect| effect.alternatives.clone())
    };
    let contains = |larger: &DefaultEffect, smaller: &DefaultEffect| {
        let effect = effects.iter().find(|effect| effect.id == larger.id);
        effect.is_some_and(|effect| effect.replaces.iter().any(|replaced| replaced.id == smaller.id))
    };
    // Of a drive there is one delay and one transmission a joint, whatever the robot carries.
    let stands_alone = |instance: &DefaultEffect| {
        let effect = effects.iter().find(|effect| effect.id == instance.id);
        effect.is_some_and(|effect| effect.place == Place::Transmission || effect.stage == Some(Stage::Delay))
    };
    for (index, (table, later)) in instances.iter().enumerate() {
        let meets = |earlier: &DefaultEffect| {
            let one_is_the_machines = earlier.payload.is_none() || later.payload.is_none();
            earlier.payload == later.payload || (one_is_the_machines && stands_alone(later))
        };
        for (_, earlier) in instances[..index].iter().filter(|(_, earlier)| meets(earlier)) {
            if (&earlier.id, earlier.joint, earlier.from) == (&later.id, later.joint, later.from) {
                return Err(table
                    .error(format!("{} stands twice", instance_name(&later.id, later.joint, later.from)))
                    .help(
                        "remove one of the two; where a table is of several joints, take the joint out of its list",
                    ));
            }
            let group = alternatives(later);
            if earlier.joint == later.joint && group.is_some() && group == alternatives(earlier) {
                let place = later.joint.map_or("of the device".to_owned(), |joint| format!("at joint {joint}"));
                return Err(table
                    .error(format!("`{}` and `{}` {place} are alternatives", earlier.id, later.id))
                    .help("keep one of the two"));
            }
            if (earlier.joint, earlier.from) == (later.joint, later.from)
                && let Some((larger, smaller)) =
                    [(earlier, later), (later, earlier)].into_iter().find(|(larger, smaller)| contains(larger, smaller))
            {
                return Err(table
                    .error(format!(
                        "{} contains `{}`, which stands beside it",
                        instance_name(&larger.id, larger.joint, larger.from),
                        smaller.id
                    ))
                    .help(format!("remove `{}`: the two would do the same thing twice", smaller.id)));
            }
        }
    }
    Ok(())
}

/// "`lugre` at joint 3", "`input_coupling` from joint 5 to joint 4".
pub fn instance_name(id: &str, joint: Option<usize>, from: Option<usize>) -> String {
    match (joint, from) {
        (Some(joint), Some(from)) => format!("`{id}` from joint {from} to joint {joint}"),
        (Some(joint), None) => format!("`{id}` at joint {joint}"),
        _ => format!("`{id}`"),
    }
}

fn scope_text(scope: Scope) -> &'static str {
    match scope {
        Scope::Joint => "one joint",
        Scope::Pair => "a pair of joints",
        Scope::Device => "the whole device",
    }
}

//! From the text of an effect file to a checked [`Effect`]. The format is described in `effects/README.md`.

use std::path::Path;

use crate::{
    Expression,
    device::{JointKind, Link},
    document::{self, Entry, Table},
    effect::{
        Effect, EffectParameter, EffectState, Measure, Origin, Place, REST_POSITION, Replacement, SIGNALS, Scan, Scope,
        Stage,
    },
    error::{ModelError, Source, did_you_mean},
    expression::Comparison,
    identifier::{is_keyword, read_id},
    unit::{Dimension, Unit, dimension},
};

impl Effect {
    /// Reads an effect. The id is the file's stem.
    ///
    /// # Errors
    /// The first thing that is wrong, with its place: unknown symbols, units that do not fit, a law that does not
    /// vanish at its null values.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ModelError> {
        let source = Source::new(path, text);
        let document = document::parse(&source)?;
        let root = Table::root(&source, &document);
        let id = read_id(&root, path)?;
        root.only(&[
            "title",
            "place",
            "scope",
            "stage",
            "family",
            "general",
            "alternatives",
            "inequalities",
            "seen_as",
            "not_seen_as",
            "source",
            "parameter",
            "state",
            "terms",
            "output",
            "replaces",
        ])?;
        let place = *choice(&root.required("place", "\"joint\"")?, &PLACES)?;
        let scope = *choice(&root.required("scope", "\"joint\"")?, &SCOPES)?;
        let text_of = |key: &str| Ok(root.required(key, "\"..\"")?.text()?.to_owned());
        let optional_text = |key: &str| root.optional(key).map(|entry| entry.text().map(str::to_owned)).transpose();
        let stage = match (place, root.optional("stage")) {
            (Place::Actuator, _) => Some(*choice(&root.required("stage", "\"gain\"")?, &STAGES)?),
            (_, None) => None,
            (_, Some(entry)) => {
                return Err(entry
                    .error("only an actuator effect has a stage of the drive path")
                    .help("remove `stage`"));
            }
        };
        let parameters = read_parameters(&root)?;
        let mut effect = Self {
            id,
            title: text_of("title")?,
            place,
            scope,
            family: optional_text("family")?,
            alternatives: optional_text("alternatives")?,
            general: root.optional("general").map_or(Ok(false), |entry| entry.flag())?,
            replaces: Vec::new(),
            stage,
            parameters,
            states: Vec::new(),
            terms: Vec::new(),
            outputs: Vec::new(),
            inequalities: Vec::new(),
            seen_as: text_of("seen_as")?,
            not_seen_as: text_of("not_seen_as")?,
            source: text_of("source")?,
        };
        read_formulas(&root, &mut effect)?;
        read_inequalities(&root, &mut effect)?;
        read_replaces(&root, &mut effect)?;
        check_units(&root, &effect)?;
        check_null(&root, &effect)?;
        Ok(effect)
    }
}

const PLACES: [(&str, Place); 5] = [
    ("actuator", Place::Actuator),
    ("transmission", Place::Transmission),
    ("joint", Place::Joint),
    ("link", Place::Link),
    ("sensor", Place::Sensor),
];

const SCOPES: [(&str, Scope); 3] = [("joint", Scope::Joint), ("pair", Scope::Pair), ("device", Scope::Device)];

const STAGES: [(&str, Stage); 7] = [
    ("delay", Stage::Delay),
    ("dead_zone", Stage::DeadZone),
    ("saturation", Stage::Saturation),
    ("lag", Stage::Lag),
    ("offset", Stage::Offset),
    ("coupling", Stage::Coupling),
    ("gain", Stage::Gain),
];

const ORIGINS: [(&str, Origin); 2] = [("physics", Origin::Physics), ("numerical", Origin::Numerical)];

fn choice<'c, T>(entry: &Entry, choices: &'c [(&str, T)]) -> Result<&'c T, ModelError> {
    let found = entry.text()?;
    choices.iter().find(|(name, _)| *name == found).map(|(_, value)| value).ok_or_else(|| {
        entry
            .error(format!("unknown word `{found}` for {}", entry.what))
            .help(did_you_mean(found, choices.iter().map(|(name, _)| *name)))
    })
}

/// The signals that a formula may name at its place.
fn signals(place: Place, scope: Scope, stage: Option<Stage>) -> Vec<&'static str> {
    let mut names = match place {
        Place::Actuator if stage == Some(Stage::Delay) => return vec![],
        Place::Actuator => vec!["command"],
        Place::Transmission => vec!["q", "dq", "t", "load"],
        Place::Joint => vec!["q", "dq", "t", "load", "friction", "qeq"],
        Place::Link => vec![],
        Place::Sensor => vec!["q", "t"],
    };
    if scope == Scope::Pair {
        match place {
            Place::Actuator => names.push("command_from"),
            Place::Link => {}
            _ => names.extend(["q_from", "dq_from"]),
        }
    }
    names
}

/// Unit of a signal at a revolute joint.
fn signal_unit(signal: &str) -> &'static str {
    match signal {
        "q" | "q_from" | "qeq" => "rad",
        "dq" | "dq_from" => "rad/s",
        "ddq" => "rad/s^2",
        "t" => "s",
        "command" | "command_from" => "command",
        _ => "N*m",
    }
}

/// The outputs that a place asks for, with their units; for a link, those that it may give.
fn output_units(effect: &Effect) -> Vec<(&'static str, &'static str)> {
    match effect.place {
        Place::Actuator if effect.stage == Some(Stage::Delay) => vec![("delay", "s")],
        Place::Actuator if effect.stage == Some(Stage::Gain) => vec![("torque", "N*m")],
        Place::Actuator => vec![("torque", "command")],
        Place::Joint | Place::Transmission if effect.scope == Scope::Pair => {
            vec![("torque", "N*m"), ("torque_from", "N*m")]
        }
        Place::Joint | Place::Transmission => vec![("torque", "N*m")],
        Place::Sensor => vec![("position", "rad")],
        Place::Link => {
            let bodies = Link::SYMBOLS.map(|symbol| match symbol {
                "m" => (symbol, "kg"),
                "x" | "y" | "z" => (symbol, "m"),
                _ => (symbol, "kg*m^2"),
            });
            [("inertia", "kg*m^2")].into_iter().chain(bodies).collect()
        }
    }
}

fn read_unit(entry: &Entry) -> Result<Unit, ModelError> {
    Unit::parse(entry.text()?).map_err(|message| {
        entry.error(message).help("give the SI unit at a revolute joint, e.g. `N*m*s/rad`; `1` where there is none")
    })
}

fn required_unit<'a>(table: &Table<'a>, symbol: &str) -> Result<Entry<'a>, ModelError> {
    table.optional("unit").ok_or_else(|| {
        table
            .error(format!("the unit of `{symbol}` is missing"))
            .help("add e.g. `unit = \"N*m*s/rad\"`; `1` where there is none")
    })
}

fn read_parameters(root: &Table) -> Result<Vec<EffectParameter>, ModelError> {
    let mut parameters: Vec<EffectParameter> = Vec::new();
    for table in root.tables("parameter", "parameter", 1)? {
        table.only(&["symbol", "unit", "title", "initial", "lower", "upper", "null", "origin", "fixed", "scan"])?;
        let entry = table.required("symbol", "\"Fc\"")?;
        let symbol = new_symbol(&entry, parameters.iter().map(|parameter| parameter.symbol.as_str()))?;
        let table = &table.named(format!("parameter `{symbol}`"));
        let unit = read_unit(&required_unit(table, &symbol)?)?;
        let initial_entry = table.required("initial", "<number>")?;
        let initial = initial_entry.finite()?;
        let lower = table.required("lower", "-inf")?.number()?;
        let upper = table.required("upper", "inf")?.number()?;
        if lower > upper {
            let entry = table.required("lower", "-inf")?;
            return Err(entry
                .error(format!("the bounds of `{symbol}` cross: lower {lower} is above upper {upper}"))
                .help("exchange them"));
        }
        if !(lower..=upper).contains(&initial) {
            return Err(initial_entry
                .error(format!("the initial value {initial} of `{symbol}` is outside its bounds {lower} .. {upper}"))
                .help("change the value or the bounds"));
        }
        let origin = *choice(&table.required("origin", "\"physics\"")?, &ORIGINS)?;
        parameters.push(EffectParameter {
            unit: unit.to_string(),
            title: table.required("title", "\"<what it means>\"")?.text()?.to_owned(),
            initial,
            lower,
            upper,
            null: table.optional("null").map(|entry| entry.number()).transpose()?,
            origin,
            fixed: match table.optional("fixed") {
                Some(entry) => entry.flag()?,
                None => origin == Origin::Numerical,
            },
            symbol,
            scan: table.optional("scan").map(|entry| read_scan(&entry)).transpose()?,
        });
    }
    Ok(parameters)
}

/// What the values of a `scan` may be multiples of, by their names.
const MEASURES: [(&str, Measure); 12] = [
    ("value", Measure::Value),
    ("speed", Measure::Speed),
    ("position", Measure::Position),
    ("per_range", Measure::PerRange),
    ("range", Measure::Range),
    ("command", Measure::Command),
    ("torque", Measure::Torque),
    ("stiffness", Measure::Stiffness),
    ("compliance", Measure::Compliance),
    ("damping", Measure::Damping),
    ("inertia", Measure::Inertia),
    ("duration", Measure::Duration),
];

/// `scan = { of = "speed", at = [0.03, 0.1, 0.3] }`, or `at = { from = 1, to = 20, step = 0.5 }`.
fn read_scan(entry: &Entry) -> Result<Scan, ModelError> {
    /// More would be a slip of the pen.
    const AT_MOST: f64 = 1000.0;
    let table = entry.table("a table { of, at }")?;
    table.only(&["of", "at"])?;
    let of = *choice(&table.required("of", "\"speed\"")?, &MEASURES)?;
    let at_entry = table.required("at", "[0.1, 0.3]")?;
    let at = if at_entry.is_table() {
        let range = at_entry.table("a table { from, to, step }")?;
        range.only(&["from", "to", "step"])?;
        let from = range.required("from", "1")?.finite()?;
        let to = range.required("to", "20")?.finite()?;
        let step = range.required("step", "0.5")?.finite()?;
        let count = ((to - from) / step + 1e-9).floor() + 1.0;
        if !(1.0..=AT_MOST).contains(&count) {
            return Err(at_entry
                .error(format!("from {from} to {to} in steps of {step} are not 1 to {AT_MOST} values"))
                .help("give a positive step and from <= to"));
        }
        (0..count as usize).map(|k| from + step * k as f64).collect()
    } else {
        at_entry.array()?.iter().map(Entry::finite).collect::<Result<Vec<f64>, _>>()?
    };
    if at.is_empty() {
        return Err(at_entry.error("there is nothing to try").help("give at least one number"));
    }
    Ok(Scan { of, at })
}

/// A symbol that is a name, not taken by a signal, a word of `[[effect]]` tables or an earlier symbol.
fn new_symbol<'t>(entry: &Entry, mut taken: impl Iterator<Item = &'t str>) -> Result<String, ModelError> {
    let symbol = entry.text()?;
    if is_keyword(symbol) {
        return Err(entry.error(format!("`{symbol}` is a keyword of Rust")).help("choose another name"));
    }
    if Expression::parse(symbol) != Ok(Expression::Symbol(symbol.to_owned())) {
        return Err(entry.error(format!("`{symbol}` is not a name")).help("use letters, digits and `_`"));
    }
    // A parameter may be called `qeq`: it is then the rest position that other effects at the joint see.
    if (SIGNALS.contains(&symbol) && symbol != REST_POSITION) || ["id", "joint", "from", "payload"].contains(&symbol) {
        return Err(entry
            .error(format!("`{symbol}` is taken: it names a signal or a place"))
            .help("choose another name"));
    }
    if taken.any(|other| other == symbol) {
        return Err(entry.error(format!("there is already a symbol `{symbol}`")).help("choose another name"));
    }
    Ok(symbol.to_owned())
}

fn read_formulas(root: &Table, effect: &mut Effect) -> Result<(), ModelError> {
    let parameters: Vec<String> = effect.parameters.iter().map(|parameter| parameter.symbol.clone()).collect();
    let state_tables = root.tables("state", "state", 1)?;
    let mut states: Vec<String> = Vec::new();
    for table in &state_tables {
        table.only(&["symbol", "unit", "initial", "rate"])?;
        let entry = table.required("symbol", "\"z\"")?;
        states.push(new_symbol(&entry, parameters.iter().chain(&states).map(String::as_str))?);
    }
    let mut known: Vec<String> =
        signals(effect.place, effect.scope, effect.stage).into_iter().map(str::to_owned).collect();
    known.extend(parameters.iter().chain(&states).cloned());
    if let Some(entry) = root.optional("terms") {
        let terms = entry.table("[terms]")?;
        for (name, span) in terms.keys() {
            if known.iter().any(|other| other == name) || SIGNALS.contains(&name) {
                let error = root.source.error(span, format!("there is already a symbol `{name}`"));
                return Err(error.help("choose another name for the term"));
            }
            if is_keyword(name) {
                let error = root.source.error(span, format!("`{name}` is a keyword of Rust"));
                return Err(error.help("choose another name for the term"));
            }
            let formula = read_formula(&terms.required(name, "\"..\"")?, &known)?;
            effect.terms.push((name.to_owned(), formula));
            known.push(name.to_owned());
        }
    }
    for (table, symbol) in state_tables.iter().zip(states) {
        let unit = read_unit(&required_unit(table, &symbol)?)?.to_string();
        let (initial, starts_at_speed) = read_start(table, effect.place, &unit)?;
        effect.states.push(EffectState {
            unit,
            initial,
            starts_at_speed,
            rate: read_formula(&table.required("rate", "\"dq\"")?, &known)?,
            symbol,
        });
    }
    let output = root.table("output", "one formula per output of the place")?;
    let allowed = output_units(effect);
    let names: Vec<&str> = allowed.iter().map(|(name, _)| *name).collect();
    output.only(&names)?;
    for name in names {
        match output.optional(name) {
            Some(entry) => effect.outputs.push((name.to_owned(), read_formula(&entry, &known)?)),
            None if effect.place == Place::Link => {}
            None => {
                return Err(output
                    .error(format!("the output `{name}` is missing"))
                    .help(format!("add `{name} = \"..\"` to [output]")));
            }
        }
    }
    if effect.outputs.is_empty() {
        return Err(output.error("the effect has no output").help("add e.g. `inertia = \"Ia\"` to [output]"));
    }
    Ok(())
}

/// Where a state starts: at a number, or at the speed of its joint.
fn read_start(table: &Table, place: Place, unit: &str) -> Result<(f64, bool), ModelError> {
    let entry = table.required("initial", "0")?;
    if entry.text().ok() != Some("dq") {
        return Ok((entry.finite()?, false));
    }
    if !matches!(place, Place::Transmission | Place::Joint) {
        return Err(entry.error("nothing has the speed `dq` at this place").help("give a number"));
    }
    if unit != "rad/s" {
        return Err(entry
            .error(format!("a state in [{unit}] cannot start as the speed `dq` [rad/s]"))
            .help("give a number"));
    }
    Ok((0.0, true))
}

fn read_formula(entry: &Entry, known: &[String]) -> Result<Expression, ModelError> {
    let formula = entry.expression()?;
    let mut unknown = None;
    formula.for_each_symbol(&mut |symbol| {
        if unknown.is_none() && !known.iter().any(|name| name == symbol) {
            unknown = Some(symbol.to_owned());
        }
    });
    match unknown {
        None => Ok(formula),
        Some(symbol) => Err(entry
            .symbol_error(&symbol, format!("unknown symbol `{symbol}` in {}", entry.what))
            .help(did_you_mean(&symbol, known.iter().map(String::as_str)))),
    }
}

fn read_inequalities(root: &Table, effect: &mut Effect) -> Result<(), ModelError> {
    let Some(entry) = root.optional("inequalities") else { return Ok(()) };
    for entry in entry.array()? {
        let text = entry.text()?;
        let halves = text
            .split_once('>')
            .map(|(a, b)| (a, Comparison::Greater, b))
            .or_else(|| text.split_once('<').map(|(a, b)| (a, Comparison::Less, b)));
        let Some((left, comparison, right)) = halves else {
            return Err(entry.error(format!("`{text}` is no inequality")).help("write e.g. `Fs > Fc`"));
        };
        let (left, right) = (left.trim(), right.trim());
        let mut initial = [0.0; 2];
        for (value, symbol) in initial.iter_mut().zip([left, right]) {
            let Some(parameter) = effect.parameter(symbol) else {
                let known = did_you_mean(symbol, effect.parameters.iter().map(|parameter| parameter.symbol.as_str()));
                return Err(entry.symbol_error(symbol, format!("unknown parameter `{symbol}`")).help(known));
            };
            *value = parameter.initial;
        }
        if !comparison.holds(initial[0], initial[1]) {
            return Err(entry
                .error(format!("the initial values {} and {} break `{text}`", initial[0], initial[1]))
                .help("change an initial value"));
        }
        effect.inequalities.push((left.to_owned(), comparison, right.to_owned()));
    }
    Ok(())
}

fn read_replaces(root: &Table, effect: &mut Effect) -> Result<(), ModelError> {
    let Some(entry) = root.optional("replaces") else { return Ok(()) };
    let table = entry.table("[replaces]")?;
    for (id, _) in table.keys() {
        let carried = table.required(id, "{}")?.table(&format!("`{id}` of [replaces]"))?;
        let mut carry = Vec::new();
        for (own, span) in carried.keys() {
            if effect.parameter(own).is_none() {
                let known = did_you_mean(own, effect.parameters.iter().map(|parameter| parameter.symbol.as_str()));
                return Err(root.source.error(span, format!("unknown parameter `{own}`")).help(known));
            }
            carry.push((own.to_owned(), carried.required(own, "\"..\"")?.text()?.to_owned()));
        }
        effect.replaces.push(Replacement { id: id.to_owned(), carry });
    }
    Ok(())
}

/// What an effect replaces must be an effect, and what it carries over its parameter.
///
/// # Errors
/// At the name that is unknown. `text` and `path` are those of `effect`.
pub fn check_replaces(effect: &mut Effect, text: &str, path: &Path, all: &[Effect]) -> Result<(), ModelError> {
    let source = Source::new(path, text);
    let document = document::parse(&source)?;
    let Some(entry) = Table::root(&source, &document).optional("replaces") else { return Ok(()) };
    let table = entry.table("[replaces]")?;
    let own: Vec<String> = effect.parameters.iter().map(|parameter| parameter.symbol.clone()).collect();
    for replacement in &mut effect.replaces {
        let Some(other) = all.iter().find(|other| other.id == replacement.id) else {
            let error = source.error(table.key_span(&replacement.id), format!("unknown effect `{}`", replacement.id));
            return Err(error.help(did_you_mean(&replacement.id, all.iter().map(|other| other.id.as_str()))));
        };
        for (own, theirs) in &replacement.carry {
            if other.parameter(theirs).is_none() {
                let carried = table.required(&other.id, "{}")?.table("replaces")?;
                let known = did_you_mean(theirs, other.parameters.iter().map(|parameter| parameter.symbol.as_str()));
                let error =
                    carried.required(own, "\"..\"")?.error(format!("`{}` has no parameter `{theirs}`", other.id));
                return Err(error.help(known));
            }
        }
        for symbol in &own {
            if other.parameter(symbol).is_some() && !replacement.carry.iter().any(|(carried, _)| carried == symbol) {
                replacement.carry.push((symbol.clone(), symbol.clone()));
            }
        }
    }
    Ok(())
}

/// Formulas must have the unit of what they stand for, at a revolute and at a prismatic joint.
fn check_units(root: &Table, effect: &Effect) -> Result<(), ModelError> {
    for kind in [JointKind::Revolute, JointKind::Prismatic] {
        // Units were parsed before; one that cannot be is a number here and would show as a mismatch.
        let of = |unit: &str| Unit::parse(unit).map_or(Dimension::NUMBER, |unit| unit.at(kind).dimension());
        let mut known: Vec<(&str, Dimension)> = Vec::new();
        // Parameters first: one called `qeq` hides the signal.
        known.extend(effect.parameters.iter().map(|parameter| (parameter.symbol.as_str(), of(&parameter.unit))));
        known.extend(effect.states.iter().map(|state| (state.symbol.as_str(), of(&state.unit))));
        known.extend(SIGNALS.iter().map(|signal| (*signal, of(signal_unit(signal)))));
        let check = |known: &[(&str, Dimension)], formula: &Expression, entry: &Entry, expected: Option<Dimension>| {
            let lookup = |symbol: &str| known.iter().find(|(name, _)| *name == symbol).map(|(_, found)| *found);
            let joint = if kind == JointKind::Revolute { "a revolute" } else { "a prismatic" };
            let found = dimension(formula, &lookup).map_err(|error| {
                let message = format!("{} (at {joint} joint)", error.message);
                match &error.symbol {
                    Some(symbol) => entry.symbol_error(symbol, message),
                    None => entry.error(message),
                }
                .help("check the `unit` of each parameter and the formula")
            })?;
            match (found, expected) {
                (Some(found), Some(expected)) if found != expected => Err(entry
                    .error(format!(
                        "{} must be in [{expected}], but the formula is in [{found}] (at {joint} joint)",
                        entry.what
                    ))
                    .help("check the `unit` of each parameter and the formula")),
                _ => Ok(found.unwrap_or(Dimension::NUMBER)),
            }
        };
        if let Some(entry) = root.optional("terms") {
            let table = entry.table("[terms]")?;
            for (name, formula) in &effect.terms {
                let found = check(&known, formula, &table.required(name, "\"..\"")?, None)?;
                known.push((name, found));
            }
        }
        for (state, table) in effect.states.iter().zip(root.tables("state", "state", 1)?) {
            let rate = of(&state.unit).times(of("s"), -1);
            check(&known, &state.rate, &table.required("rate", "\"..\"")?, Some(rate))?;
        }
        let output = root.table("output", "formulas")?;
        let units = output_units(effect);
        for (name, formula) in &effect.outputs {
            let expected = units.iter().find(|(output, _)| output == name).map(|(_, unit)| of(unit));
            check(&known, formula, &output.required(name, "\"..\"")?, expected)?;
        }
    }
    Ok(())
}

/// How many random points the null check looks at.
const NULL_SAMPLES: u64 = 200;

/// At its null values an effect changes nothing, whatever the signals and its states.
fn check_null(root: &Table, effect: &Effect) -> Result<(), ModelError> {
    let output = root.table("output", "formulas")?;
    if !effect.parameters.iter().any(|parameter| parameter.null.is_some()) {
        return Err(root
            .error("no parameter has a null value, so the effect can never vanish")
            .help("add `null = ..` to the parameters that switch the effect off"));
    }
    for sample in 0..NULL_SAMPLES {
        let mut random = Random::seeded(sample);
        let mut values: Vec<(&str, f64)> = Vec::new();
        for parameter in &effect.parameters {
            let free = if parameter.lower.is_finite() && parameter.upper.is_finite() {
                parameter.lower + (parameter.upper - parameter.lower) * random.unit()
            } else {
                parameter.initial * (0.5 + random.unit())
            };
            values.push((&parameter.symbol, parameter.null.unwrap_or(free)));
        }
        for state in &effect.states {
            // At rest in every other sample; elsewhere as if the effect had been on before.
            let moved = if sample % 2 == 0 { 0.0 } else { 2.0 * random.unit() - 1.0 };
            values.push((&state.symbol, state.initial + moved));
        }
        for signal in SIGNALS {
            // Every fourth sample stands still: laws must hold there too.
            let still = sample % 4 == 0 && matches!(signal, "dq" | "dq_from" | "ddq");
            values.push((signal, if still { 0.0 } else { 4.0 * random.unit() - 2.0 }));
        }
        let lookup = |symbol: &str| values.iter().find(|(name, _)| *name == symbol).map(|(_, value)| *value);
        let Ok((outputs, rates)) = effect.evaluate(&lookup) else { continue };
        for (index, (name, _)) in effect.outputs.iter().enumerate() {
            let (value, neutral, meaning) = what_vanishes(effect, name, index, &outputs, &lookup);
            // Not `>`: what is no number must not pass.
            let vanishes = (value - neutral).abs() <= 1e-12 * (1.0 + neutral.abs());
            if !vanishes {
                let entry = output.required(name, "\"..\"")?;
                let nulls: Vec<String> = effect
                    .parameters
                    .iter()
                    .filter_map(|parameter| Some(format!("{} = {}", parameter.symbol, parameter.null?)))
                    .collect();
                return Err(entry
                    .error(format!(
                        "`{name}` does not vanish at the null values ({}): it is {value:.3e} where {meaning} is expected{}",
                        nulls.join(", "),
                        if neutral == 0.0 { String::new() } else { format!(", {neutral:.3e}") },
                    ))
                    .help("correct the formula, or give the parameters that switch it off another `null`"));
            }
        }
        if let Some(index) = rates.iter().position(|rate| !rate.is_finite()) {
            let tables = root.tables("state", "state", 1)?;
            let entry = tables[index].required("rate", "\"..\"")?;
            return Err(
                entry.error(format!("the rate of `{}` is not finite at the null values", effect.states[index].symbol))
            );
        }
    }
    Ok(())
}

/// Of an output: its value, what it must be where the effect is off, and how to call that. The centroid of a body counts
/// by the body's mass: where there is no mass, it can be anywhere.
fn what_vanishes(
    effect: &Effect,
    name: &str,
    index: usize,
    outputs: &[f64],
    lookup: &dyn Fn(&str) -> Option<f64>,
) -> (f64, f64, &'static str) {
    let signal = |name: &str| lookup(name).unwrap_or_default();
    match (effect.place, name) {
        (Place::Actuator, "torque") => (outputs[index], signal("command"), "the command"),
        (Place::Transmission, "torque") => (outputs[index], signal("load"), "the load"),
        (Place::Sensor, _) => (outputs[index], signal("q"), "the true position"),
        (Place::Link, "x" | "y" | "z") => {
            let mass = effect.outputs.iter().position(|(other, _)| other == "m").map_or(0.0, |mass| outputs[mass]);
            (mass * outputs[index], 0.0, "0 times the mass")
        }
        _ => (outputs[index], 0.0, "0"),
    }
}

/// A small generator (splitmix64) for the points of the null check: the same in every build.
struct Random(u64);

impl Random {
    fn seeded(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15))
    }

    /// Uniform in 0..1.
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

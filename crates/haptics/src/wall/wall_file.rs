//! A wall as a file: gains, fuzzy sets and rules are data.

use std::fmt::Write;
use std::path::Path;

use dynid_model::{
    ModelError, Source, did_you_mean,
    document::{self, Entry, Table},
};

use super::{
    Setting,
    setting::{not_negative, positive},
};
use dynid_control::{Law, LinearLaw, Partition, PartitionError, RuleTable, VirtualTool, Wall, WallError};
use dynid_files::DocumentError;

/// A wall's law, and what a unit of its output is.
#[derive(Debug, Clone, PartialEq)]
pub struct WallFile {
    /// What it is.
    pub title: String,
    /// Torque at the joint for one unit of the law's output [N*m or N], the drive's gain included.
    pub scale: f64,
    /// How it resists.
    pub law: Law,
    /// Whether a passivity controller watches it.
    pub passive: bool,
    /// The linear law that rules were made from (Eq. 5.5), where the file states it.
    pub base: Option<LinearLaw>,
}

impl WallFile {
    /// Reads a wall file.
    ///
    /// # Errors
    /// A file that cannot be read, or the first thing that is wrong in it, with its place.
    pub fn load(path: &Path) -> Result<Self, DocumentError> {
        Ok(Self::parse(&dynid_files::read(path)?, path)?)
    }

    /// Reads the text of a wall file; `path` is for messages.
    ///
    /// # Errors
    /// The first thing that is wrong, with its place.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ModelError> {
        let source = Source::new(path, text);
        let document = document::parse(&source)?;
        let root = Table::root(&source, &document);
        root.only(&[
            "title",
            "torque_per_unit",
            "passive",
            "linear",
            "position",
            "velocity",
            "outputs",
            "rules",
            "coupling",
            "leak",
        ])?;
        let entry = root.required("torque_per_unit", "N*m (or N) for one unit of the law's output")?;
        let scale = entry.finite()?;
        if scale <= 0.0 {
            return Err(entry.error(format!("`torque_per_unit` is {scale}")).help("give a positive number"));
        }
        let (law, base) = law(&root)?;
        Ok(Self {
            title: root.required("title", "what the wall is")?.text()?.to_owned(),
            scale,
            law,
            base,
            passive: root.optional("passive").map_or(Ok(false), |entry| entry.flag())?,
        })
    }

    /// The wall at work in a setting.
    ///
    /// # Errors
    /// None that a file which was read and a setting which was read could have.
    pub fn wall(&self, setting: &Setting) -> Result<Wall, WallError> {
        self.at_work(setting.sample_s, setting.delay_samples, setting.torque_limit)
    }

    /// The wall asked every `sample_s`, answering so many ticks late, with torques up to `limit`.
    pub(super) fn at_work(&self, sample_s: f64, delay_samples: usize, limit: f64) -> Result<Wall, WallError> {
        let wall = Wall::new(self.law.clone(), self.scale, sample_s, limit)?;
        Ok(if self.passive { wall.passive(delay_samples) } else { wall })
    }

    /// The file, every output of a rule as a number.
    pub fn to_toml(&self, comment: &str) -> String {
        let mut text = String::new();
        for line in comment.lines() {
            let _ = writeln!(text, "# {line}");
        }
        let _ = writeln!(text, "title = {:?}\ntorque_per_unit = {:?}", self.title, self.scale);
        if self.passive {
            text.push_str("passive = true\n");
        }
        match &self.law {
            Law::Rules(table) => {
                for (key, partition) in [("position", table.position()), ("velocity", table.velocity())] {
                    let _ = writeln!(text, "\n[{key}]\nsets = {:?}", partition.names());
                    let _ = writeln!(text, "peaks = {:?}", partition.peaks());
                }
                let _ = writeln!(
                    text,
                    "\n# A row for each set of the velocity, an output for each of the position.\n[rules]"
                );
                for (row, name) in table.velocity().names().iter().enumerate() {
                    let n = table.position().len();
                    let _ = writeln!(text, "{name} = {:?}", &table.outputs()[row * n..(row + 1) * n]);
                }
            }
            Law::Linear(law) | Law::Leaky { linear: law, .. } => {
                let _ = writeln!(text, "\n[linear]\nk1 = {:?}\nk2 = {:?}", law.k1, law.k2);
            }
            Law::Coupled(tool) => {
                let VirtualTool { inertia, wall_stiffness, wall_damping, stiffness, damping } = tool;
                let _ = writeln!(text, "\n[coupling]\ninertia = {inertia:?}\nwall_stiffness = {wall_stiffness:?}");
                let _ =
                    writeln!(text, "wall_damping = {wall_damping:?}\nstiffness = {stiffness:?}\ndamping = {damping:?}");
            }
        }
        if let Some(base) = &self.base {
            let _ = writeln!(text, "\n[linear]\nk1 = {:?}\nk2 = {:?}", base.k1, base.k2);
        }
        if let Law::Leaky { stiffness, share, .. } = &self.law {
            let _ = writeln!(text, "\n[leak]\nstiffness = {stiffness:?}\nshare = {share:?}");
        }
        text
    }
}

/// The law, and the linear one that its rules were made from.
fn law(root: &Table<'_>) -> Result<(Law, Option<LinearLaw>), ModelError> {
    const ALWAYS: [&str; 3] = ["title", "torque_per_unit", "passive"];
    // A table that the law does not read would say something that is not so.
    let reads = |own: &[&str]| root.only(&[&ALWAYS, own].concat());
    if root.optional("coupling").is_some() {
        reads(&["coupling"])?;
        let table = root.table("coupling", "the virtual coupling")?;
        table.only(&["inertia", "wall_stiffness", "wall_damping", "stiffness", "damping"])?;
        let number = |key: &str| positive(&table, key);
        let tool = VirtualTool {
            inertia: number("inertia")?,
            wall_stiffness: number("wall_stiffness")?,
            wall_damping: number("wall_damping")?,
            stiffness: number("stiffness")?,
            damping: number("damping")?,
        };
        return Ok((Law::Coupled(tool), None));
    }
    let linear = match root.optional("linear") {
        Some(entry) => {
            let table = entry.table("[linear]")?;
            table.only(&["k1", "k2"])?;
            let gain = |key: &str| table.required(key, "a gain")?.finite();
            Some(LinearLaw { k1: gain("k1")?, k2: gain("k2")?, offset: 0.0 })
        }
        None => None,
    };
    if root.optional("rules").is_some() {
        reads(&["linear", "position", "velocity", "outputs", "rules"])?;
        return Ok((Law::Rules(rules(root, linear.as_ref())?), linear));
    }
    reads(&["linear", "leak"])?;
    let Some(linear) = linear else {
        return Err(root.error("the wall has no law").help("give [linear], [rules] or [coupling]"));
    };
    let Some(entry) = root.optional("leak") else { return Ok((Law::Linear(linear), None)) };
    let table = entry.table("[leak]")?;
    table.only(&["stiffness", "share"])?;
    let (stiffness, share) = (not_negative(&table, "stiffness")?, not_negative(&table, "share")?);
    if share > 1.0 {
        let entry = table.required("share", "a number from 0 to 1")?;
        return Err(entry
            .error(format!(
                "`share` is {share}: the element would take away more than the spring gives, and the wall pull inwards"
            ))
            .help("give a number from 0 to 1"));
    }
    Ok((Law::Leaky { linear, stiffness, share }, None))
}

/// Fuzzy sets and rules.
fn rules(root: &Table<'_>, linear: Option<&LinearLaw>) -> Result<RuleTable, ModelError> {
    let (position, velocity) = (partition(root, "position")?, partition(root, "velocity")?);
    for (key, sets, reaches) in [
        ("position", &position, position.peaks()[0] < 0.0 && position.peaks()[position.len() - 1] >= 0.0),
        ("velocity", &velocity, velocity.peaks()[0] < 0.0 && velocity.peaks()[velocity.len() - 1] > 0.0),
    ] {
        if !reaches {
            let (from, to) = (sets.peaks()[0], sets.peaks()[sets.len() - 1]);
            let entry = root.table(key, "fuzzy sets")?.required("peaks", "one ascending number for each set")?;
            let message = format!("the sets of the {key} cover {from} to {to}, not what is on both sides of 0");
            return Err(entry
                .error(message)
                .help("the wall is below position 0, and one comes to it and leaves it: add sets"));
        }
    }
    let table = root.table("rules", "a row for each set of the velocity")?;
    table.only(&velocity.names().iter().map(String::as_str).collect::<Vec<&str>>())?;
    let named = match root.optional("outputs") {
        Some(entry) => Some(entry.table("[outputs]: where the linear law is taken, e.g. N2 = [\"N2\", \"Z0\"]")?),
        None => None,
    };
    let reader = Reader { position: &position, velocity: &velocity, linear, named };
    let mut outputs = Vec::with_capacity(position.len() * velocity.len());
    for (row, name) in velocity.names().iter().enumerate() {
        let entry = table.required(name, "an output for each set of the position")?;
        let cells = entry.array()?;
        if cells.len() != position.len() {
            let message =
                format!("the rules of `{name}` are {}, the sets of the position {}", cells.len(), position.len());
            return Err(entry.error(message).help("give one output for each set of the position"));
        }
        for (column, cell) in cells.iter().enumerate() {
            outputs.push(reader.output(cell, row, column)?);
        }
    }
    RuleTable::new(position, velocity, outputs).map_err(|error| table.error(error.to_string()))
}

fn partition(root: &Table<'_>, key: &str) -> Result<Partition, ModelError> {
    let table = root.table(key, "fuzzy sets: names `sets` and where each is 1, `peaks`")?;
    table.only(&["sets", "peaks"])?;
    let sets = table.required("sets", "[\"N1\", \"Z0\", \"P1\"]")?;
    let names =
        sets.array()?.iter().map(|name| Ok(name.text()?.to_owned())).collect::<Result<Vec<String>, ModelError>>()?;
    let entry = table.required("peaks", "one ascending number for each set")?;
    let entries = entry.array()?;
    let peaks = entries.iter().map(Entry::finite).collect::<Result<Vec<f64>, _>>()?;
    Partition::new(names.clone(), peaks).map_err(|error| {
        let place = match &error {
            PartitionError::Order { name, .. } => {
                names.iter().position(|own| own == name).and_then(|index| entries.get(index)).unwrap_or(&entry)
            }
            PartitionError::Name { .. } => &sets,
            _ => &entry,
        };
        place.error(error.to_string()).help("list the sets from the lowest peak to the highest, without gaps")
    })
}

/// Reads outputs of rules.
struct Reader<'a> {
    position: &'a Partition,
    velocity: &'a Partition,
    linear: Option<&'a LinearLaw>,
    named: Option<Table<'a>>,
}

impl Reader<'_> {
    /// A number; `"="`, what the linear law gives there (Eq. 5.5); or the name of an output, with a factor or without.
    fn output(&self, cell: &Entry<'_>, row: usize, column: usize) -> Result<f64, ModelError> {
        let Ok(text) = cell.text() else { return cell.finite() };
        if text == "=" {
            return self.linear_at(cell, column, row);
        }
        let (name, factor) = text.split_once('*').unwrap_or((text, "1"));
        let factor: f64 =
            factor.trim().parse().ok().filter(|factor: &f64| factor.is_finite()).ok_or_else(|| {
                cell.error(format!("`{text}`: the factor is no number")).help("write e.g. \"N5*1.6\"")
            })?;
        let name = name.trim();
        let Some(named) = &self.named else {
            return Err(cell
                .error(format!("unknown output `{name}`"))
                .help("give it in [outputs], or write a number or \"=\""));
        };
        let Some(place) = named.optional(name) else {
            let keys = named.keys();
            let known = did_you_mean(name, keys.iter().map(|(name, _)| *name));
            return Err(cell.error(format!("unknown output `{name}`")).help(known));
        };
        let sets = place.array()?;
        let [position, velocity] = sets.as_slice() else {
            return Err(place
                .error("an output stands at a set of the position and one of the velocity")
                .help("[\"N2\", \"Z0\"]"));
        };
        let index = |entry: &Entry<'_>, partition: &Partition| -> Result<usize, ModelError> {
            let name = entry.text()?;
            let found = partition.names().iter().position(|own| own == name);
            let known = did_you_mean(name, partition.names().iter().map(String::as_str));
            found.ok_or_else(|| entry.error(format!("unknown fuzzy set `{name}`")).help(known))
        };
        Ok(factor * self.linear_at(cell, index(position, self.position)?, index(velocity, self.velocity)?)?)
    }

    fn linear_at(&self, cell: &Entry<'_>, position: usize, velocity: usize) -> Result<f64, ModelError> {
        let Some(linear) = self.linear else {
            return Err(cell
                .error("there is no linear law to take this output from")
                .help("give [linear] with k1 and k2"));
        };
        Ok(linear.output(self.position.peaks()[position], self.velocity.peaks()[velocity]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{wall::library, wall::shipped};

    fn table(name: &str) -> (RuleTable, LinearLaw) {
        let Law::Rules(table) = shipped(name).expect("shipped").law else { panic!("{name} has rules") };
        (
            table,
            if name == "fuzzy" {
                LinearLaw { k1: 100.0, k2: 0.5, offset: 0.0 }
            } else {
                LinearLaw { k1: 100.0, k2: 100.0, offset: 0.0 }
            },
        )
    }

    /// Figure 5.6 as printed: which entries are modified, and to what; the rest is Eq. 5.5, and zero outside.
    #[test]
    fn both_tables_are_those_of_figure_5_6() {
        for name in ["fuzzy_literal", "fuzzy"] {
            let (table, law) = table(name);
            let at = |position: &str, velocity: &str| {
                let column = table.position().names().iter().position(|own| own == position).expect("a set");
                let row = table.velocity().names().iter().position(|own| own == velocity).expect("a set");
                (row, column, law.output(table.position().peaks()[column], table.velocity().peaks()[row]))
            };
            let (n1, n2, n5) = (at("N2", "P1").2, at("N2", "Z0").2, at("N2", "N3").2);
            let (p1, p2) = (at("N2", "P2").2, at("N2", "P3").2);
            let mut modified = std::collections::BTreeMap::new();
            let mut change = |position: &str, velocities: &[&str], output: f64| {
                for velocity in velocities {
                    let (row, column, _) = at(position, velocity);
                    modified.insert((row, column), output);
                }
            };
            let five = ["N3", "N2", "N1", "Z0", "P1"];
            for (column, factor) in [("N6", 2.0), ("N5", 2.0), ("N4", 1.6)] {
                change(column, &five, factor * n5);
                change(column, &["P2"], p1);
                change(column, &["P3"], p2);
            }
            change("N3", &["N3", "N2", "N1", "Z0"], n2);
            change("N3", &["P1"], n1);
            change("N3", &["P2"], p1);
            change("N3", &["P3"], p2);
            change("N2", &["N3", "N2", "N1"], n2);
            change("N1", &["N2", "N1", "Z0", "P1"], n2);
            change("N1", &["P2"], p1);
            change("N1", &["P3"], p2);
            change("Z0", &["N2", "N1", "Z0", "P1", "P2"], 1.6 * n5);
            change("Z0", &["P3"], p1);
            change("Z0", &["P4"], p2);
            for (row, velocity) in table.velocity().names().iter().enumerate() {
                for (column, position) in table.position().names().iter().enumerate() {
                    let base = if position.starts_with('P') { 0.0 } else { at(position, velocity).2 };
                    let expected = modified.get(&(row, column)).copied().unwrap_or(base);
                    assert_eq!(table.rule(row, column), expected, "{name}: {velocity}, {position}");
                }
            }
        }
        // the labels of the column N2 change sign between P1 and P2 in the consistent table only
        let (consistent, _) = table("fuzzy");
        assert!(consistent.output(-0.010, 1.25) < 0.0 && consistent.output(-0.010, 2.5) > 0.0);
        let (literal, _) = table("fuzzy_literal");
        assert!(literal.output(-0.010, 1.25) > 0.0);
    }

    /// Section 5.5.3: q = -0.0125, dq = 1.8 falls to N1 twice and P1 twice.
    #[test]
    fn the_worked_example_of_the_text() {
        for (name, n1, p1) in [("fuzzy", -0.375, 0.25), ("fuzzy_literal", 124.0, 249.0)] {
            let (table, _) = table(name);
            let up = (1.8 - 1.25) / 1.25;
            let expected = (1.0 - up) * n1 + up * p1;
            assert!((table.output(-0.0125, 1.8) - expected).abs() < 1e-12 * expected.abs().max(1.0), "{name}");
        }
    }

    #[test]
    fn what_is_shipped_is_read_and_written_again() {
        for (name, _) in library() {
            let file = shipped(name).expect("shipped");
            let again = WallFile::parse(&file.to_toml("once more"), Path::new("again.toml")).expect("written");
            assert_eq!(again, file, "{name}");
        }
        let tool = VirtualTool { inertia: 0.1, wall_stiffness: 3.0, wall_damping: 5.0, stiffness: 1.0, damping: 2.0 };
        let linear = LinearLaw { k1: 100.0, k2: 2.0, offset: 0.0 };
        for law in [Law::Coupled(tool), Law::Leaky { linear, stiffness: 2.0, share: 0.3 }] {
            let file = WallFile { title: "another".to_owned(), scale: 0.5, law, passive: true, base: None };
            assert_eq!(WallFile::parse(&file.to_toml("once"), Path::new("again.toml")).expect("written"), file);
        }
        let (tuned, _) = table("fuzzy_tuned");
        assert!(tuned.is_monotone(), "the tuned table is monotone");
    }

    #[test]
    fn wrong_files_are_reported_with_their_place() {
        let reported = |from: &str, to: &str| {
            let text = include_str!("shipped/fuzzy.toml");
            assert!(text.contains(from), "{from}");
            WallFile::parse(&text.replacen(from, to, 1), Path::new("w.toml")).expect_err("wrong").to_string()
        };
        let order = reported("-0.020, -0.015", "-0.015, -0.020");
        assert!(order.contains("the peak -0.02 of `N3` does not lie above") && order.contains("w.toml:"), "{order}");
        let size = reported("P6 = [\"=\", ", "P6 = [");
        assert!(size.contains("the rules of `P6` are 12, the sets of the position 13"), "{size}");
        let unknown = reported("\"N5*2\"", "\"N7*2\"");
        assert!(unknown.contains("unknown output `N7`"), "{unknown}");
        let no_law = WallFile::parse("title = \"x\"\ntorque_per_unit = 1", Path::new("w.toml")).expect_err("none");
        assert!(no_law.to_string().contains("no law"));
        let leaky = |share: &str| {
            let text = include_str!("shipped/leaky.toml").replacen("share = 0.5", share, 1);
            WallFile::parse(&text, Path::new("w.toml")).map_err(|error| error.to_string())
        };
        assert!(leaky("share = 1.0").is_ok());
        for (share, reported) in [("share = 1.01", "`share` is 1.01"), ("share = -0.1", "`share` is -0.1")] {
            let error = leaky(share).expect_err("out of range");
            assert!(
                error.contains("w.toml:") && error.contains(reported) && error.contains("give a number from 0"),
                "{error}"
            );
        }
    }
}

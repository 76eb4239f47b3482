//! From the text of a device file to a checked [`Device`]. The format is described in `devices/README.md`.

use std::{collections::BTreeMap, path::Path};

use crate::{
    Expression,
    device::{
        Configuration, Convention, Device, EndPoint, Frame, Joint, JointKind, Length, Link, Method, joint_variable,
    },
    document::{self, Entry, Table},
    effect::Effect,
    error::{ModelError, Source, did_you_mean},
    expression::BinaryOperator,
    identifier::read_id,
    instance::{check_instances, read_instances},
    parameter::Parameter,
    physical_consistency::{Impossible, check_body},
    transform::{GeneralFrames, Motion, Rotation, distance_from_rotation, roll_pitch_yaw},
    unit::Unit,
};

/// The name of the frame that stands still.
const BASE: &str = "base";

/// Joints of a device: a humanoid with hands has about seventy, and equations grow faster than their number.
pub const MOST_JOINTS: usize = 256;

/// A vector component smaller than this is the rounding error of an exact zero.
const EXACT_ZERO: f64 = 1e-12;

impl Device {
    /// Reads a device whose default effects are among `effects`. The id is the file's stem.
    ///
    /// # Errors
    /// The first thing that is wrong, with its place.
    pub fn parse_with(text: &str, path: &Path, effects: &[Effect]) -> Result<Self, ModelError> {
        Self::parse_as(text, path, effects, |root| read_id(root, path))
    }

    pub(crate) fn parse_as(
        text: &str,
        path: &Path,
        effects: &[Effect],
        id: impl FnOnce(&Table) -> Result<String, ModelError>,
    ) -> Result<Self, ModelError> {
        let source = Source::new(path, text);
        let document = document::parse(&source)?;
        let root = Table::root(&source, &document);
        let id = id(&root)?;
        root.only(&[
            "title",
            "source",
            "units",
            "base",
            "kinematics",
            "lengths",
            "end_point",
            "joint",
            "link",
            "bounds",
            "identification",
            "effect",
        ])?;
        let command_unit = read_units(&root)?;
        let lengths = read_lengths(&root)?;
        let (gravity, up) = read_base(&root)?;
        let joint_tables = root.tables("joint", "joint", 0)?;
        if joint_tables.is_empty() {
            return Err(root
                .error("the device has no joint")
                .help("add `[[joint]]` for each joint variable q0, q1, .."));
        }
        if joint_tables.len() > MOST_JOINTS {
            let message = format!("the device has {} joints, more than {MOST_JOINTS}", joint_tables.len());
            return Err(joint_tables[MOST_JOINTS]
                .error(message)
                .help("describe what moves together as a device of its own"));
        }
        let (convention, frames, kinds) = read_frames(&root, joint_tables.len(), &lengths)?;
        let joints = joint_tables
            .iter()
            .enumerate()
            .map(|(joint, table)| read_joint(table, kinds.get(&joint).copied(), joint, &command_unit))
            .collect::<Result<Vec<_>, _>>()?;
        let end_point = read_end_point(&root, &frames)?;
        let links = read_links(&root, &frames)?;
        let (configurations, methods) = read_identification(&root, joints.len())?;
        let mut defaults = Vec::new();
        let effect_tables = root.tables("effect", "effect", 1)?;
        for table in &effect_tables {
            if let Some(entry) = table.optional("payload") {
                return Err(entry
                    .error("a device carries no payload")
                    .help("put the effect into a model, where runs may carry it"));
            }
            let read = read_instances(table, joints.len(), effects, &|effect, _, symbol, _| {
                effect.parameter(symbol).map(crate::effect::EffectParameter::parameter)
            })?;
            defaults.extend(read.into_iter().map(|effect| (table, effect)));
        }
        check_instances(&defaults, effects)?;
        let device = Self {
            id,
            file: None,
            title: root.required("title", "\"<one line for people>\"")?.text()?.to_owned(),
            source: root.required("source", "\"<where the numbers come from>\"")?.text()?.to_owned(),
            convention,
            gravity,
            up,
            lengths,
            joints,
            frames,
            end_point,
            links,
            configurations,
            methods,
            effects: defaults.into_iter().map(|(_, effect)| effect).collect(),
        };
        for (joint, table) in joint_tables.iter().enumerate() {
            if device.last_link_moved_by(joint).is_none() {
                return Err(table
                    .error(format!("joint {joint} moves no link, so its equation of motion is empty"))
                    .help(format!("fix a link to a frame that `q{joint}` moves")));
            }
        }
        Ok(device)
    }
}

/// `[units]`: what the numbers below are in. Everything is SI; stating it keeps degrees and millimetres out.
fn read_units(root: &Table) -> Result<String, ModelError> {
    const FIXED: [(&str, &str); 5] =
        [("angle", "rad"), ("length", "m"), ("mass", "kg"), ("inertia", "kg*m^2"), ("time", "s")];
    let units = root.table(
        "units",
        "angle = \"rad\", length = \"m\", mass = \"kg\", inertia = \"kg*m^2\", time = \"s\", command = \"N*m\"",
    )?;
    units.only(&["angle", "length", "mass", "inertia", "time", "command"])?;
    for (quantity, expected) in FIXED {
        let entry = unit_entry(&units, quantity, expected)?;
        let found = entry.text()?;
        let same = Unit::parse(found).is_ok_and(|unit| unit.to_string() == expected);
        if !same {
            return Err(entry
                .error(format!("the unit of {quantity} must be `{expected}`, found `{found}`"))
                .help(format!("convert the numbers of this file to {expected}")));
        }
    }
    let entry = unit_entry(&units, "command", "N*m")?;
    let text = entry.text()?;
    match Unit::parse(text) {
        Ok(unit) => Ok(unit.to_string()),
        Err(message) => {
            Err(entry.error(message).help("give the unit of the logged command, e.g. `N*m`, `N`, `V` or `A`"))
        }
    }
}

fn unit_entry<'a>(units: &Table<'a>, quantity: &str, expected: &str) -> Result<Entry<'a>, ModelError> {
    units.optional(quantity).ok_or_else(|| {
        units
            .error(format!("the unit of {quantity} is missing in [units]"))
            .help(format!("add `{quantity} = \"{expected}\"`"))
    })
}

fn read_lengths(root: &Table) -> Result<Vec<Length>, ModelError> {
    let Some(entry) = root.optional("lengths") else { return Ok(Vec::new()) };
    let table = entry.table("[lengths]")?;
    let mut lengths = Vec::new();
    for (symbol, span) in table.keys() {
        let is_symbol = Expression::parse(symbol) == Ok(Expression::Symbol(symbol.to_owned()));
        if !is_symbol || joint_variable(symbol).is_some() {
            let message = format!("`{symbol}` cannot name a length");
            return Err(root
                .source
                .error(span, message)
                .help("use a name such as `L5`; `q0`, `q1`, .. and `pi` are taken"));
        }
        let value = table.required(symbol, "<metres>")?.finite()?;
        lengths.push(Length { symbol: symbol.to_owned(), value });
    }
    Ok(lengths)
}

/// `[base]`: the magnitude of gravity, and which way is up as expressions of named angles.
fn read_base(root: &Table) -> Result<(f64, [f64; 3]), ModelError> {
    let base = root.table("base", "`gravity` [m/s^2] and `up`, the unit vector that points up")?;
    base.only(&["gravity", "angles", "up"])?;
    let entry = base.required("gravity", "9.81")?;
    let gravity = entry.finite()?;
    if gravity < 0.0 {
        return Err(entry.error(format!("gravity is a magnitude, found {gravity}")).help("turn `up` around instead"));
    }
    if gravity == 0.0 {
        return Ok((0.0, [0.0; 3]));
    }
    let mut angles = BTreeMap::new();
    if let Some(entry) = base.optional("angles") {
        let table = entry.table("`angles` of [base]")?;
        for (symbol, _) in table.keys() {
            angles.insert(symbol, table.required(symbol, "<rad>")?.finite()?);
        }
    }
    let entry = base.required("up", "[0, 0, 1]")?;
    let entries = entry.array()?;
    if entries.len() != 3 {
        let message = format!("`up` has three components, found {}", entries.len());
        return Err(entry.error(message).help("write e.g. `up = [0, 0, 1]`"));
    }
    let mut up = [0.0; 3];
    for (component, entry) in up.iter_mut().zip(&entries) {
        let value = entry.expression()?.evaluate(&|symbol| angles.get(symbol).copied());
        *component = value.map_err(|symbol| {
            let known = did_you_mean(&symbol, angles.keys().copied());
            entry.symbol_error(&symbol, format!("unknown base angle `{symbol}`")).help(known)
        })?;
        if component.abs() < EXACT_ZERO {
            *component = 0.0;
        }
    }
    let norm = up.iter().map(|component| component * component).sum::<f64>().sqrt();
    // Not `>`: a norm that is no number must not pass.
    if (norm - 1.0).abs() <= 1e-9 {
        Ok((gravity, up))
    } else {
        Err(entry.error(format!("`up` must have length 1, found {norm}")).help("divide its components by that"))
    }
}

type Kinematics = (Convention, Vec<Frame>, BTreeMap<usize, JointKind>);

/// The columns of a table of Denavit-Hartenberg rows, and what a joint variable in them measures.
const COLUMNS: [(&str, JointKind); 4] = [
    ("theta", JointKind::Revolute),
    ("d", JointKind::Prismatic),
    ("a", JointKind::Prismatic),
    ("alpha", JointKind::Revolute),
];

fn read_frames(root: &Table, n_joints: usize, lengths: &[Length]) -> Result<Kinematics, ModelError> {
    let kinematics = root.table("kinematics", "`convention` and `frames`")?;
    kinematics.only(&["convention", "frames"])?;
    let entry = kinematics.required("convention", "\"standard\"")?;
    // A general transform is rows of the standard convention.
    let (convention, is_general) = match entry.text()? {
        "standard" => (Convention::Standard, false),
        "modified" => (Convention::Modified, false),
        "transform" => (Convention::Standard, true),
        other => {
            return Err(entry.error(format!("unknown convention `{other}`")).help(format!(
                "{}; `standard` is Rz(theta) Tz(d) Tx(a) Rx(alpha), `modified` is Rx(alpha) Tx(a) Rz(theta) Tz(d), `transform` \
                 is Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll) and a turn or slide of any axis",
                did_you_mean(other, ["standard", "modified", "transform"])
            )));
        }
    };
    let tables = kinematics.tables("frames", "frame", 1)?;
    if tables.is_empty() {
        return Err(kinematics.error("the device has no frame").help(
            "add rows such as { name = \"f1\", parent = \"base\", theta = \"q0\", d = 0, a = 0, alpha = 0 } to `frames`",
        ));
    }
    let mut names: Vec<&str> = Vec::new();
    for table in &tables {
        if is_general {
            table.only(&["name", "parent", "xyz", "rpy", "matrix", "axis", "turn", "slide"])?;
        } else {
            table.only(&["name", "parent", "theta", "d", "a", "alpha"])?;
        }
        let entry = table.required("name", "\"<name>\"")?;
        let name = entry.text()?;
        if name == BASE || names.contains(&name) {
            return Err(entry.error(format!("there is already a frame `{name}`")).help("frames have different names"));
        }
        names.push(name);
    }
    let mut cells = Cells { n_joints, lengths, kinds: BTreeMap::new() };
    let mut parents = Vec::new();
    let mut rows = Vec::new();
    for (table, name) in tables.iter().zip(&names) {
        let table = &table.named(format!("frame `{name}`"));
        let entry = table.required("parent", "\"base\"")?;
        let parent = entry.text()?;
        let parent = if parent == BASE {
            None
        } else {
            let index = names.iter().position(|name| *name == parent).ok_or_else(|| {
                let known = did_you_mean(parent, names.iter().copied().chain([BASE]));
                entry.error(format!("unknown parent frame `{parent}` of frame `{name}`")).help(known)
            })?;
            Some(index)
        };
        parents.push(parent);
        rows.push(Some(if is_general { Own::General(cells.general(table)?) } else { Own::Row(cells.row(table)?) }));
    }
    // Frames may stand in any order; parents come first from here on.
    let mut place: Vec<Option<usize>> = vec![None; rows.len()];
    let mut frames = Vec::new();
    let mut general = GeneralFrames::default();
    let mut n_placed = 0;
    while let Some(waiting) = place.iter().position(Option::is_none) {
        let ready = (waiting..rows.len())
            .find(|row| place[*row].is_none() && parents[*row].is_none_or(|parent| place[parent].is_some()));
        let Some(ready) = ready else { return Err(cycle_error(&tables, &names, &parents, &place)) };
        let parent = parents[ready].and_then(|parent| place[parent]);
        place[ready] = Some(n_placed);
        n_placed += 1;
        match rows[ready].take() {
            Some(Own::Row([theta, d, a, alpha])) => {
                frames.push(Frame { name: names[ready].to_owned(), parent, theta, d, a, alpha });
            }
            Some(Own::General((xyz, rotation, motion))) => general.add(names[ready], parent, xyz, rotation, motion),
            None => {}
        }
    }
    frames.extend(general.rows);
    let kinds = cells.kinds.into_iter().map(|(joint, (kind, _))| (joint, kind)).collect();
    Ok((convention, frames, kinds))
}

/// What a table says of a frame.
enum Own {
    Row([Expression; 4]),
    General(General),
}

/// Place, rotation, and what moves about or along which axis.
type General = ([Expression; 3], Rotation, Option<(Motion, [f64; 3])>);

/// Reads what stands in the rows of a table.
struct Cells<'a> {
    n_joints: usize,
    lengths: &'a [Length],
    /// What the joint variables met so far measure, and where that was seen.
    kinds: BTreeMap<usize, (JointKind, String)>,
}

impl Cells<'_> {
    /// theta, d, a and alpha.
    fn row(&mut self, table: &Table) -> Result<[Expression; 4], ModelError> {
        let mut row = [(); 4].map(|()| Expression::Number(0.0));
        for (cell, (column, kind)) in row.iter_mut().zip(COLUMNS) {
            let entry = table.required(column, "0")?;
            *cell = read_cell(&entry, kind, self.n_joints, self.lengths, &mut self.kinds)?;
        }
        Ok(row)
    }

    /// A general frame.
    fn general(&mut self, table: &Table) -> Result<General, ModelError> {
        let xyz = match table.optional("xyz") {
            Some(entry) => self.lengths(&entry)?,
            None => [(); 3].map(|()| Expression::Number(0.0)),
        };
        let rotation = match (table.optional("rpy"), table.optional("matrix")) {
            (Some(_), Some(matrix)) => {
                return Err(matrix
                    .error(format!("{} states `rpy` and `matrix`", table.what))
                    .help("state one of them"));
            }
            (Some(rpy), None) => roll_pitch_yaw(constants(&rpy, "roll, pitch and yaw")?),
            (None, Some(matrix)) => read_rotation(&matrix)?,
            (None, None) => roll_pitch_yaw([0.0; 3]),
        };
        let motion = match (table.optional("turn"), table.optional("slide")) {
            (Some(_), Some(slide)) => {
                let error = slide.error(format!("{} states `turn` and `slide`", table.what));
                return Err(error.help("state one of them; a second joint is a frame of its own"));
            }
            (Some(turn), None) => Some(Motion::Turn(self.cell(&turn, JointKind::Revolute)?)),
            (None, Some(slide)) => Some(Motion::Slide(self.cell(&slide, JointKind::Prismatic)?)),
            (None, None) => None,
        };
        let axis = table.optional("axis").map(|entry| read_axis(&entry)).transpose()?.unwrap_or([0.0, 0.0, 1.0]);
        Ok((xyz, rotation, motion.map(|motion| (motion, axis))))
    }

    fn cell(&mut self, entry: &Entry, kind: JointKind) -> Result<Expression, ModelError> {
        read_cell(entry, kind, self.n_joints, self.lengths, &mut self.kinds)
    }

    fn lengths(&mut self, entry: &Entry) -> Result<[Expression; 3], ModelError> {
        let mut lengths = [(); 3].map(|()| Expression::Number(0.0));
        for (length, own) in lengths.iter_mut().zip(three(entry, "x, y and z [m]")?) {
            *length = self.cell(&own, JointKind::Prismatic)?;
            let mut moves = None;
            length.for_each_symbol(&mut |symbol| moves = moves.or(joint_variable(symbol)));
            if let Some(joint) = moves {
                let error = own.error(format!("`q{joint}` stands in {}, which does not move", entry.what));
                return Err(error.help(format!("write `axis` and `slide = \"q{joint}\"`")));
            }
        }
        Ok(lengths)
    }
}

fn three<'a>(entry: &Entry<'a>, what: &str) -> Result<[Entry<'a>; 3], ModelError> {
    <[Entry; 3]>::try_from(entry.array()?).map_err(|found| {
        entry.error(format!("{} has {} components", entry.what, found.len())).help(format!("give {what}"))
    })
}

fn constants(entry: &Entry, what: &str) -> Result<[f64; 3], ModelError> {
    let mut values = [0.0; 3];
    for (value, own) in values.iter_mut().zip(three(entry, what)?) {
        *value = own.finite()?;
    }
    Ok(values)
}

fn read_rotation(entry: &Entry) -> Result<Rotation, ModelError> {
    let mut rotation = [[0.0; 3]; 3];
    for (row, own) in rotation.iter_mut().zip(three(entry, "three rows of three numbers")?) {
        *row = constants(&own, "a row of three numbers")?;
    }
    let distance = distance_from_rotation(&rotation);
    if distance < 1e-9 {
        return Ok(rotation);
    }
    let what = if distance.is_finite() { "it is no rotation" } else { "it mirrors" };
    Err(entry
        .error(format!("{}: {what}: R R^T is not the identity, or its determinant not 1", entry.what))
        .help("columns are the axes of the frame in its parent's; give ten digits, or `rpy` instead"))
}

/// A direction, made one of length 1.
fn read_axis(entry: &Entry) -> Result<[f64; 3], ModelError> {
    let axis = constants(entry, "x, y and z of the axis")?;
    let length = axis.iter().map(|component| component * component).sum::<f64>().sqrt();
    if length > 0.0 {
        return Ok(axis.map(|component| component / length));
    }
    Err(entry.error("the axis has length 0").help("give a direction, e.g. [0, 0, 1]"))
}

/// `[end_point]`: the frame that the point is fixed to, and where it lies in it.
fn read_end_point(root: &Table, frames: &[Frame]) -> Result<Option<EndPoint>, ModelError> {
    let Some(entry) = root.optional("end_point") else { return Ok(None) };
    let table = entry.table("[end_point]")?;
    table.only(&["frame", "point"])?;
    let frame = read_frame(&table, frames)?;
    let Some(entry) = table.optional("point") else { return Ok(Some(EndPoint { frame, point: [0.0; 3] })) };
    let point = entry.array()?.iter().map(Entry::finite).collect::<Result<Vec<f64>, _>>()?;
    let point = <[f64; 3]>::try_from(point).map_err(|point| {
        let message = format!("`point` has three coordinates, found {}", point.len());
        entry.error(message).help("write e.g. `point = [0, 0, 0.05]`")
    })?;
    Ok(Some(EndPoint { frame, point }))
}

/// The frame that a table names.
fn read_frame(table: &Table, frames: &[Frame]) -> Result<usize, ModelError> {
    let entry = table.required("frame", "\"<frame>\"")?;
    let name = entry.text()?;
    frames.iter().position(|frame| frame.name == name).ok_or_else(|| {
        let known = did_you_mean(name, frames.iter().map(|frame| frame.name.as_str()));
        entry.error(format!("unknown frame `{name}` of {}", table.what)).help(known)
    })
}

/// One cell of the table; `kind` is what a joint variable in it measures.
fn read_cell(
    entry: &Entry,
    kind: JointKind,
    n_joints: usize,
    lengths: &[Length],
    kinds: &mut BTreeMap<usize, (JointKind, String)>,
) -> Result<Expression, ModelError> {
    let expression = entry.expression()?;
    let mut symbols = Vec::new();
    expression.for_each_symbol(&mut |symbol| symbols.push(symbol.to_owned()));
    let mut moves = false;
    for symbol in &symbols {
        let Some(joint) = joint_variable(symbol) else {
            if !lengths.iter().any(|length| length.symbol == *symbol) {
                let known = lengths.iter().map(|length| length.symbol.clone());
                let known: Vec<String> = known.chain((0..n_joints).map(|joint| format!("q{joint}"))).collect();
                return Err(entry
                    .symbol_error(symbol, format!("unknown length or joint `{symbol}` in {}", entry.what))
                    .help(format!(
                        "{}; lengths are declared in [lengths]",
                        did_you_mean(symbol, known.iter().map(String::as_str))
                    )));
            }
            if kind == JointKind::Revolute {
                return Err(entry
                    .symbol_error(symbol, format!("{} is an angle [rad], but `{symbol}` is a length [m]", entry.what))
                    .help("only joint variables, numbers and `pi` stand in an angle"));
            }
            continue;
        };
        if joint >= n_joints {
            let known: Vec<String> = (0..n_joints).map(|joint| format!("q{joint}")).collect();
            return Err(entry
                .symbol_error(symbol, format!("unknown joint `{symbol}` in {}: the device has {n_joints}", entry.what))
                .help(did_you_mean(symbol, known.iter().map(String::as_str))));
        }
        moves = true;
        let (earlier, place) = kinds.entry(joint).or_insert_with(|| (kind, entry.what.clone()));
        if *earlier != kind {
            let message =
                format!("`{symbol}` is {} in {}, but {} in {place}", measure(kind), entry.what, measure(*earlier));
            return Err(entry
                .symbol_error(symbol, message)
                .help("a joint variable is either an angle (theta, alpha) or a distance (d, a), not both"));
        }
    }
    if kind == JointKind::Prismatic && !is_polynomial(&expression) {
        let message = format!("{} must be a sum of products of lengths, joint variables and numbers", entry.what);
        return Err(entry.error(message).help("give what is computed from lengths otherwise a length of its own"));
    }
    let affine = expression.affine();
    if moves && affine.is_none() {
        return Err(entry
            .error(format!(
                "{} must be a sum of joint variables with constant factors, found `{expression}`",
                entry.what
            ))
            .help("write e.g. `-q2 - pi/2`"));
    }
    let factor = |symbol: &String| affine.as_ref().and_then(|sum| sum.coefficients.get(symbol)).copied().unwrap_or(0.0);
    if let Some(idle) = symbols.iter().find(|own| joint_variable(own).is_some() && factor(own).abs() < EXACT_ZERO) {
        return Err(entry
            .symbol_error(idle, format!("`{idle}` has the factor 0 in {}", entry.what))
            .help("leave it out, or give it its factor"));
    }
    Ok(expression)
}

/// What the equations can hold of a length: quotients by numbers are the only ones.
fn is_polynomial(length: &Expression) -> bool {
    if length.constant().is_some() {
        return true;
    }
    match length {
        Expression::Number(_) | Expression::Symbol(_) => true,
        Expression::Negate(x) => is_polynomial(x),
        Expression::Binary(BinaryOperator::Divide, a, b) => is_polynomial(a) && b.constant().is_some_and(|b| b != 0.0),
        Expression::Binary(_, a, b) => is_polynomial(a) && is_polynomial(b),
        Expression::Call(..) | Expression::IfElse(..) => false,
    }
}

fn measure(kind: JointKind) -> &'static str {
    match kind {
        JointKind::Revolute => "an angle",
        JointKind::Prismatic => "a distance",
    }
}

/// Some rows wait for each other: names one cycle.
fn cycle_error(tables: &[Table], names: &[&str], parents: &[Option<usize>], place: &[Option<usize>]) -> ModelError {
    let mut row = place.iter().position(Option::is_none).unwrap_or(0);
    let mut path = Vec::new();
    while !path.contains(&row) {
        path.push(row);
        row = parents[row].unwrap_or(row);
    }
    let start = path.iter().position(|visited| *visited == row).unwrap_or(0);
    let cycle: Vec<&str> = path[start..].iter().chain([&row]).map(|row| names[*row]).collect();
    let span = tables[row].optional("parent").map_or(tables[row].span.clone(), |entry| entry.span);
    tables[row]
        .source
        .error(span, format!("the frames form a cycle, each the parent of the one before: {}", cycle.join(" -> ")))
        .help("one of them must have `parent = \"base\"` or a frame outside of the cycle")
}

fn read_joint(table: &Table, kind: Option<JointKind>, joint: usize, command_unit: &str) -> Result<Joint, ModelError> {
    table.only(&["title", "kind", "position", "speed", "torque", "command"])?;
    let Some(kind) = kind else {
        return Err(table
            .error(format!("joint {joint} moves no frame: `q{joint}` stands in no row of `frames`"))
            .help(format!("put `q{joint}` into a row, or remove this [[joint]]")));
    };
    if let Some(entry) = table.optional("kind") {
        let stated = match entry.text()? {
            "revolute" => JointKind::Revolute,
            "prismatic" => JointKind::Prismatic,
            other => {
                return Err(entry
                    .error(format!("unknown kind `{other}` of joint {joint}"))
                    .help(did_you_mean(other, ["revolute", "prismatic"])));
            }
        };
        if stated != kind {
            return Err(entry
                .error(format!(
                    "joint {joint} is said to be {stated:?}, but `q{joint}` is {} in the frames",
                    measure(kind)
                ))
                .help("leave `kind` out, or correct the row"));
        }
    }
    let entry = table.required("position", "[<lowest>, <highest>]")?;
    let limits = entry.array()?;
    let [lowest, highest] = limits.as_slice() else {
        let message = format!("{} must have two entries, found {}", entry.what, limits.len());
        return Err(entry.error(message).help("write [lowest, highest]; `inf` where there is no end"));
    };
    let position_limits = [lowest.number()?, highest.number()?];
    if position_limits[0] >= position_limits[1] {
        return Err(entry
            .error(format!("{} must rise, found {} .. {}", entry.what, position_limits[0], position_limits[1]))
            .help("write the lowest position first"));
    }
    let positive = |key: &str| {
        let entry = table.required(key, "inf")?;
        match entry.number()? {
            value if value > 0.0 => Ok(value),
            value => Err(entry
                .error(format!("{} must be positive, found {value}", entry.what))
                .help("write `inf` where it is unknown")),
        }
    };
    Ok(Joint {
        kind,
        title: table.required("title", "\"<name for people>\"")?.text()?.to_owned(),
        position_limits,
        speed_limit: positive("speed")?,
        torque_limit: positive("torque")?,
        command_unit: match table.optional("command") {
            Some(entry) => Unit::parse(entry.text()?).map_err(|message| entry.error(message))?.to_string(),
            None => command_unit.to_owned(),
        },
    })
}

/// How bounds follow from a value where a link gives only that.
enum BoundsRule {
    /// `value -+ fraction * |value|`
    Fraction(f64),
    /// The same for all links.
    Range(f64, f64),
}

fn read_links(root: &Table, frames: &[Frame]) -> Result<Vec<Link>, ModelError> {
    let tables = root.tables("link", "link", 1)?;
    if tables.is_empty() {
        return Err(root
            .error("the device has no link")
            .help("add `[[link]]` with its frame and ten inertial parameters"));
    }
    let bounds =
        root.table("bounds", "`mass`, `centroid` and `inertia`, each a fraction of the value or [lowest, highest]")?;
    bounds.only(&["mass", "centroid", "inertia"])?;
    let rules = [read_rule(&bounds, "mass")?, read_rule(&bounds, "centroid")?, read_rule(&bounds, "inertia")?];
    let mut links = Vec::new();
    for table in &tables {
        let mut known = vec!["title", "frame"];
        known.extend(Link::SYMBOLS);
        table.only(&known)?;
        let frame = read_frame(table, frames)?;
        let mut inertial = [Parameter::known(0.0); 10];
        for (index, (parameter, symbol)) in inertial.iter_mut().zip(Link::SYMBOLS).enumerate() {
            let entry = table.required(symbol, "<number>")?;
            let (rule, positive) = match index {
                0 => (&rules[0], true),
                1..=3 => (&rules[1], false),
                _ => (&rules[2], matches!(symbol, "Ixx" | "Iyy" | "Izz")),
            };
            *parameter = entry.parameter(&|value| bounds_of(rule, value, positive))?;
            if index == 0 {
                check_mass(&entry, &table.what, parameter)?;
            }
        }
        let link =
            Link { frame, title: table.required("title", "\"<name for people>\"")?.text()?.to_owned(), inertial };
        check_body(&link.values()).map_err(|impossible| impossible_link(table, &impossible))?;
        links.push(link);
    }
    Ok(links)
}

/// Refuses a mass that is negative or may become so.
///
/// # Errors
/// At the mass.
pub fn check_mass(entry: &Entry, link: &str, mass: &Parameter) -> Result<(), ModelError> {
    let (verb, least) = if mass.value < 0.0 { ("is", mass.value) } else { ("may become", mass.lower) };
    if least >= 0.0 {
        return Ok(());
    }
    Err(entry
        .error(format!("the mass of {link} {verb} negative: {least} kg"))
        .help("a mass and its lower bound are at least 0"))
}

/// The error for a link that no body can be, at its first inertia.
pub fn impossible_link(table: &Table, impossible: &Impossible) -> ModelError {
    let key = if matches!(impossible, Impossible::NegativeMass(_)) { "m" } else { "Ixx" };
    let span = table.optional(key).map_or(table.span.clone(), |entry| entry.span);
    table
        .source
        .error(span, format!("no body has the inertial parameters of {}: {impossible}", table.what))
        .help("the sum of any two principal moments about the centroid is at least the third; check signs and digits")
}

fn read_rule(bounds: &Table, key: &str) -> Result<BoundsRule, ModelError> {
    let entry = bounds.required(key, "0.5")?;
    if !entry.is_array() {
        return match entry.finite()? {
            fraction if fraction >= 0.0 => Ok(BoundsRule::Fraction(fraction)),
            fraction => Err(entry
                .error(format!("{} must not be negative, found {fraction}", entry.what))
                .help("give a fraction such as 0.5, or [lowest, highest]")),
        };
    }
    match entry.array()?.as_slice() {
        [lower, upper] => match (lower.number()?, upper.number()?) {
            (lower, upper) if lower <= upper => Ok(BoundsRule::Range(lower, upper)),
            (lower, upper) => {
                Err(entry.error(format!("{} cross: {lower} is above {upper}", entry.what)).help("exchange them"))
            }
        },
        _ => Err(entry
            .error(format!("{} must be a fraction or [lowest, highest]", entry.what))
            .help("write e.g. `0.5` or `[0.0, 10.0]`")),
    }
}

/// Masses and principal inertias stay positive: the lower bound is cut at 1 % of the value (0 for a range).
fn bounds_of(rule: &BoundsRule, value: f64, positive: bool) -> Parameter {
    let (lower, upper) = match *rule {
        BoundsRule::Fraction(fraction) => {
            let lower = value - fraction * value.abs();
            (if positive && value > 0.0 { lower.max(0.01 * value) } else { lower }, value + fraction * value.abs())
        }
        BoundsRule::Range(lower, upper) => (if positive && value >= 0.0 { lower.max(0.0) } else { lower }, upper),
    };
    Parameter { value, lower, upper, fixed: lower == upper }
}

fn read_identification(root: &Table, n_joints: usize) -> Result<(Vec<Configuration>, Vec<Method>), ModelError> {
    let table = root.table("identification", "`configurations`, a list of lists of free joints")?;
    table.only(&["configurations", "method"])?;
    let entry = table.required("configurations", "[[0]]")?;
    let mut configurations: Vec<Configuration> = Vec::new();
    for (index, row) in entry.array()?.iter().enumerate() {
        let mut free = Vec::new();
        for joint_entry in row.array()? {
            let joint = joint_entry.index()?;
            if joint >= n_joints {
                let last = n_joints - 1;
                return Err(joint_entry
                    .error(format!(
                        "configuration {} frees joint {joint}, but the device has joints 0..{last}",
                        index + 1
                    ))
                    .help("joints count from 0, in the order of the [[joint]] tables"));
            }
            if free.contains(&joint) {
                let message = format!("configuration {} names joint {joint} twice", index + 1);
                return Err(joint_entry.error(message).help("name each free joint once"));
            }
            free.push(joint);
        }
        free.sort_unstable();
        if free.is_empty() {
            let message = format!("configuration {} frees no joint", index + 1);
            return Err(row.error(message).help("name the joints that are free together, e.g. [0, 1]"));
        }
        if let Some(earlier) = configurations.iter().position(|configuration| configuration.free == free) {
            return Err(row
                .error(format!("configuration {} frees the same joints as configuration {}", index + 1, earlier + 1))
                .help("remove one of the two"));
        }
        configurations.push(Configuration { free });
    }
    if configurations.is_empty() {
        return Err(entry
            .error("there is no configuration")
            .help("name the joints that are free together, e.g. [[0], [0, 1]]"));
    }
    let mut methods: Vec<Method> = Vec::new();
    for method in table.tables("method", "method", 1)? {
        method.only(&["name", "sequence", "weights"])?;
        let entry = method.required("name", "\"isolated\"")?;
        let name = entry.text()?.to_owned();
        if methods.iter().any(|earlier| earlier.name == name) {
            let message = format!("there is already a method `{name}`");
            return Err(entry.error(message).help("methods have different names"));
        }
        let mut sequence = Vec::new();
        for step in method.required("sequence", "[1, 2]")?.array()? {
            let number = step.index()?;
            if number == 0 || number > configurations.len() {
                return Err(step
                    .error(format!(
                        "method `{name}` names configuration {number}, but there are 1..{}",
                        configurations.len()
                    ))
                    .help("configurations count from 1, in the order of `configurations`"));
            }
            sequence.push(number);
        }
        let mut weights = Vec::new();
        if let Some(entry) = method.optional("weights") {
            let rows = entry.array()?;
            if rows.len() != sequence.len() {
                let message =
                    format!("method `{name}` has {} steps and {} rows of weights", sequence.len(), rows.len());
                return Err(entry.error(message).help("give one row of weights per step"));
            }
            for (row, number) in rows.iter().zip(&sequence) {
                let values = row.array()?.iter().map(|weight| weight.finite()).collect::<Result<Vec<_>, _>>()?;
                let n_free = configurations[number - 1].free.len();
                if values.len() != n_free || values.iter().any(|weight| *weight < 0.0) {
                    return Err(row
                        .error(format!(
                            "configuration {number} frees {n_free} joint(s), found {} weights",
                            values.len()
                        ))
                        .help("give one weight, at least 0, per free joint"));
                }
                weights.push(values);
            }
        }
        methods.push(Method { name, sequence, weights });
    }
    Ok((configurations, methods))
}

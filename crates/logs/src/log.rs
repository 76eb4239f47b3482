//! Logs of a robot: a table ([`dynid_tables`]) with time, commanded torques and measured positions, in SI units.
//!
//! Columns: `t` (s), `tau<i>` [N*m or N], `q<i>` [rad or m] and optionally `ref<i>` [rad or m], where `i` is the
//! device's joint index. Columns of motors take their place where the experiment says how they move the joints
//! ([`crate::transmission`]). Sampling need not be uniform. Every number that is used must be finite and time must rise.

mod columns;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use dynid_tables::{Table, TableError};
use sha2::{Digest, Sha256};

use dynid_model::nearest;

use crate::transmission::Transmission;
use columns::{Column, read_rows};

/// What a run's log holds. Every inner vector has one entry a sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Log {
    /// Time of each sample, rising (s).
    pub t: Vec<f64>,
    /// Commanded torque of each joint of the device [N*m, or N at a prismatic joint]; zero for a locked joint whose
    /// torque is not logged.
    pub tau: Vec<Vec<f64>>,
    /// Measured position of each joint of the device [rad, or m at a prismatic joint].
    pub q: Vec<Vec<f64>>,
    /// Commanded position of each joint of the device [rad or m], where the log has one for every free joint; a
    /// locked joint's is its measured position where it is not logged.
    pub reference: Option<Vec<Vec<f64>>>,
    /// False where the sample leaves the torque error.
    pub mask: Option<Vec<bool>>,
    /// Rows of the file that were left out because they repeat a time, ascending; none where no file was read.
    pub left_out: Vec<usize>,
}

impl Log {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// True without samples; no log that was read is.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// Median time between samples (s).
    pub fn sample_time(&self) -> f64 {
        dynid_signal::median_step(&self.t)
    }

    /// Mean measured position of `joint` [rad or m]: where a locked joint stands.
    pub fn mean_position(&self, joint: usize) -> f64 {
        let q = &self.q[joint];
        q.iter().sum::<f64>() / q.len() as f64
    }

    /// Feeds every number that a fit may use to `hash`.
    pub fn digest(&self, hash: &mut Sha256) {
        // A hash takes many bytes at once quicker than a number at a time.
        let mut bytes = Vec::new();
        let mut column = |values: &[f64]| {
            hash.update((values.len() as u64).to_le_bytes());
            for some in values.chunks(512) {
                bytes.clear();
                bytes.extend(some.iter().flat_map(|value| value.to_le_bytes()));
                hash.update(&bytes);
            }
        };
        column(&self.t);
        let reference = self.reference.iter().flatten();
        for values in self.tau.iter().chain(&self.q).chain(reference) {
            column(values);
        }
        if let Some(mask) = &self.mask {
            column(&mask.iter().map(|&used| f64::from(u8::from(used))).collect::<Vec<_>>());
        }
    }
}

/// Which columns of a table make a log, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct LogFormat {
    /// Number of joints of the device.
    pub n_joints: usize,
    /// Free joints: their torque must be logged.
    pub free: Vec<usize>,
    /// A log's own name of a column: (`tau0`, `tau_1`).
    pub columns: Vec<(String, String)>,
    /// Factor that brings a column to SI: (`tau0`, 10.0).
    pub scale: Vec<(String, f64)>,
    /// A column of an encoder that begins anew after each turn, and how much a turn is in the log's own unit: (`q0`, 360.0).
    pub turn: Vec<(String, f64)>,
    /// What becomes of a row whose time is that of the row before.
    pub repeated: Repeated,
    /// Rows `from..to` of the data (0 is the first row below the header); everything when absent.
    pub rows: Option<[usize; 2]>,
    /// Column whose zeros leave the torque error.
    pub mask: Option<String>,
    /// Where the joints of a planned run start [rad or m]: its log has no measured positions, and [`Log::q`] stays there.
    pub start: Option<Vec<f64>>,
    /// A controller gives the torques: a planned run has none in its log.
    pub has_controller: bool,
    /// The log has motors instead of these joints.
    pub transmission: Option<Transmission>,
}

/// What becomes of a row whose time is that of the row before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Repeated {
    /// The log is refused.
    #[default]
    Refuse,
    /// The row is left out.
    Skip,
}

/// Why a log cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The file cannot be opened, or is no table.
    #[error("{path}: cannot be read: {reason}; give the path of a log, relative to the experiment file", path = path.display())]
    Unreadable {
        /// The log.
        path: PathBuf,
        /// As the system tells it.
        reason: String,
    },
    /// Nothing at all, or a header without rows.
    #[error("{path}: the log has {found}; expected a header line and rows of numbers below it", path = path.display())]
    Empty {
        /// The log.
        path: PathBuf,
        /// `no header`, `a header but no rows`, ...
        found: String,
    },
    /// A column that is needed is not in the header.
    #[error("{path}: column `{column}` is missing; the log has {available}{hint}. If it has another name there, say so in the experiment: {remedy}", path = path.display())]
    MissingColumn {
        /// The log.
        path: PathBuf,
        /// Name looked for in the header.
        column: String,
        /// The header, quoted.
        available: String,
        /// `; the nearest name is ...` or nothing.
        hint: String,
        /// What to write in the experiment.
        remedy: String,
    },
    /// Two columns of one name.
    #[error("{path}: column `{column}` stands twice in the header; rename one of them", path = path.display())]
    DuplicateColumn {
        /// The log.
        path: PathBuf,
        /// Its name.
        column: String,
    },
    /// A cell that holds no finite number.
    #[error("{place}: column `{column}`, row {row}: expected a finite number, found {found}; repair or cut the row (rows = [from, to] keeps a part of a log)", place = place(path, *line))]
    NotANumber {
        /// The log.
        path: PathBuf,
        /// Line of the file, from 1, where it has lines.
        line: Option<u64>,
        /// Row of the data, from 0.
        row: usize,
        /// Its name in the file.
        column: String,
        /// The cell, quoted, or `nothing`.
        found: String,
    },
    /// Time must rise from row to row.
    #[error("{place}: column `{column}`, row {row}: time {what} ({before} s, then {now} s); {remedy}", place = place(path, *line))]
    TimeNotRising {
        /// The log.
        path: PathBuf,
        /// Line of the file, from 1, where it has lines.
        line: Option<u64>,
        /// Row of the data, from 0.
        row: usize,
        /// Name of the time column.
        column: String,
        /// `runs backwards` or `stands still`.
        what: &'static str,
        /// Time of the row before (s).
        before: f64,
        /// Time of this row (s).
        now: f64,
        /// What to do.
        remedy: &'static str,
    },
    /// `rows` reaches past the end.
    #[error("{path}: rows = [{from}, {to}] lies outside the log, which has {n_rows} rows; expected 0 <= from < to <= {n_rows}", path = path.display())]
    RowsOutOfRange {
        /// The log.
        path: PathBuf,
        /// First row asked for.
        from: usize,
        /// One past the last row asked for.
        to: usize,
        /// Rows that there are.
        n_rows: usize,
    },
}

/// A file, and a line of it, as messages begin.
pub fn place(path: &Path, line: Option<u64>) -> String {
    let line = line.map_or(String::new(), |line| format!(":{line}"));
    format!("{}{line}", path.display())
}

impl LogError {
    /// Why the file at `path` is no table.
    pub fn of_table(path: &Path, error: TableError) -> Self {
        let path = path.to_owned();
        match error {
            TableError::NoHeader => Self::Empty { path, found: "no header".to_owned() },
            error => Self::Unreadable { path, reason: error.to_string() },
        }
    }
}

/// Reads the log at `path`.
pub fn read(path: &Path, format: &LogFormat) -> Result<Log, LogError> {
    let table = Table::open(path).map_err(|error| LogError::of_table(path, error))?;
    of_table(path, &table, format)
}

/// The log that a table holds; `path` is for messages.
pub fn of_table(path: &Path, table: &Table, format: &LogFormat) -> Result<Log, LogError> {
    let header = Header { path, names: table.names(), format };
    let find = |logical: &str| header.find(logical);
    let joints = 0..format.n_joints;
    let mut t = find("t")?;
    let mut tau = joints
        .clone()
        .map(|joint| match find(&format!("tau{joint}")) {
            _ if format.comes_from_motors(Kind::Torque, joint) => Ok(None),
            Err(LogError::MissingColumn { .. }) if !format.is_free(joint) || format.is_controlled_plan() => Ok(None),
            found => found.map(Some),
        })
        .collect::<Result<Vec<_>, _>>()?;
    let mut q = joints
        .clone()
        .map(|joint| match format.start {
            _ if format.comes_from_motors(Kind::Position, joint) => Ok(None),
            Some(_) => Ok(None),
            None => find(&format!("q{joint}")).map(Some),
        })
        .collect::<Result<Vec<_>, _>>()?;
    let mut reference = joints
        .map(|joint| (joint, format!("ref{joint}")))
        .map(|(joint, name)| match find(&name) {
            _ if format.comes_from_motors(Kind::Reference, joint) => Ok(None),
            Err(LogError::MissingColumn { .. }) if !format.is_mapped(&name) => Ok(None),
            found => found.map(Some),
        })
        .collect::<Result<Vec<_>, _>>()?;
    let mut motors = Motors::find(&header)?;
    let has_reference = |joint: usize| format.comes_from_motors(Kind::Reference, joint) || reference[joint].is_some();
    let is_followed = format.free.iter().all(|joint| has_reference(*joint));
    if !is_followed {
        reference.iter_mut().for_each(|column| *column = None);
    }
    let mut mask = format.mask.as_ref().map(|name| header.named(name, "mask")).transpose()?;

    let mut columns: Vec<&mut Column> = vec![&mut t];
    columns.extend(tau.iter_mut().flatten());
    columns.extend(q.iter_mut().flatten());
    columns.extend(motors.columns());
    columns.extend(reference.iter_mut().flatten());
    columns.extend(mask.iter_mut());
    let n_rows = table.n_rows();
    let [from, to] = format.rows.unwrap_or([0, n_rows]);
    if format.rows.is_some() && (from >= to || to > n_rows) {
        return Err(LogError::RowsOutOfRange { path: path.to_owned(), from, to, n_rows });
    }
    let left_out = read_rows(path, table, from..to, format.repeated, &mut columns)?;
    let n_samples = t.values.len();
    if n_samples < 2 {
        let found = if n_rows == 0 { "a header but no rows" } else { "a single row" };
        return Err(LogError::Empty { path: path.to_owned(), found: found.to_owned() });
    }

    let mut of_motors = motors.at_joints(format);
    let mut filled =
        |columns: Vec<Option<Column>>, kind: Kind, otherwise: &dyn Fn(usize) -> Vec<f64>| -> Vec<Vec<f64>> {
            let values = columns.into_iter().enumerate().map(|(joint, column)| {
                let own = of_motors.remove(&(kind, joint)).or(column.map(|column| column.values));
                own.unwrap_or_else(|| otherwise(joint))
            });
            values.collect()
        };
    let q =
        filled(q, Kind::Position, &|joint| vec![format.start.as_ref().map_or(0.0, |start| start[joint]); n_samples]);
    let tau = filled(tau, Kind::Torque, &|_| vec![0.0; n_samples]);
    let has_reference = is_followed && (reference.iter().any(Option::is_some) || !motors.reference.is_empty());
    let reference = has_reference.then(|| filled(reference, Kind::Reference, &|joint| q[joint].clone()));
    Ok(Log {
        t: t.values,
        tau,
        q,
        reference,
        mask: mask.map(|column| column.values.iter().map(|&value| value != 0.0).collect()),
        left_out,
    })
}

/// What a log has of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Position,
    Torque,
    Reference,
}

/// The motors' columns.
struct Motors {
    position: Vec<Column>,
    torque: Vec<Column>,
    reference: Vec<Column>,
}

impl Motors {
    /// Those that the format names; of a planned run the ones that it needs.
    fn find(header: &Header<'_>) -> Result<Self, LogError> {
        let mut motors = Self { position: Vec::new(), torque: Vec::new(), reference: Vec::new() };
        let Some(transmission) = &header.format.transmission else { return Ok(motors) };
        let all = |names: &[String]| -> Result<Vec<Column>, LogError> {
            names.iter().map(|name| header.named(name, "transmission")).collect()
        };
        if header.format.start.is_none() {
            motors.position = all(&transmission.position)?;
        }
        if !header.format.is_controlled_plan() {
            motors.torque = all(&transmission.torque)?;
        }
        motors.reference = all(&transmission.reference)?;
        Ok(motors)
    }

    fn columns(&mut self) -> impl Iterator<Item = &mut Column> {
        self.position.iter_mut().chain(&mut self.torque).chain(&mut self.reference)
    }

    /// What they are at the joints that they move.
    fn at_joints(&mut self, format: &LogFormat) -> BTreeMap<(Kind, usize), Vec<f64>> {
        let mut found = BTreeMap::new();
        let Some(transmission) = &format.transmission else { return found };
        let kinds = [Kind::Position, Kind::Torque, Kind::Reference];
        for (kind, columns) in kinds.into_iter().zip([&mut self.position, &mut self.torque, &mut self.reference]) {
            let values: Vec<Vec<f64>> = columns.iter_mut().map(|column| std::mem::take(&mut column.values)).collect();
            if values.is_empty() {
                continue;
            }
            let joints = match kind {
                Kind::Torque => transmission.joint_torques(&values),
                Kind::Position | Kind::Reference => transmission.joint_positions(&values),
            };
            found.extend(transmission.joints.iter().zip(joints).map(|(joint, values)| ((kind, *joint), values)));
        }
        found
    }
}

impl LogFormat {
    /// Whether the log has this of motors instead of the joint.
    fn comes_from_motors(&self, kind: Kind, joint: usize) -> bool {
        self.transmission.as_ref().is_some_and(|transmission| {
            let columns = match kind {
                Kind::Position => &transmission.position,
                Kind::Torque => &transmission.torque,
                Kind::Reference => &transmission.reference,
            };
            !columns.is_empty() && transmission.joints.contains(&joint)
        })
    }

    fn is_free(&self, joint: usize) -> bool {
        self.free.contains(&joint)
    }

    fn is_controlled_plan(&self) -> bool {
        self.start.is_some() && self.has_controller
    }

    /// Whether the experiment says which column of the log this is.
    fn is_mapped(&self, logical: &str) -> bool {
        self.columns.iter().any(|(name, _)| name == logical)
    }
}

/// The header of a log, to find columns in.
struct Header<'a> {
    path: &'a Path,
    names: &'a [String],
    format: &'a LogFormat,
}

impl Header<'_> {
    /// The column of the project's name `logical`, through the experiment's column map.
    fn find(&self, logical: &str) -> Result<Column, LogError> {
        let mapped = self.format.columns.iter().find(|(name, _)| name == logical);
        self.named(mapped.map_or(logical, |(_, name)| name), logical)
    }

    fn named(&self, name: &str, logical: &str) -> Result<Column, LogError> {
        let mut places = self.names.iter().enumerate().filter(|(_, other)| *other == name).map(|(index, _)| index);
        let Some(index) = places.next() else {
            let guess = nearest(name, self.names.iter().map(String::as_str).filter(|other| !self.is_taken(other)));
            let example = guess.unwrap_or("its name in the log");
            return Err(LogError::MissingColumn {
                path: self.path.to_owned(),
                column: name.to_owned(),
                available: self.names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", "),
                hint: guess.map_or(String::new(), |guess| format!("; the nearest name is `{guess}`")),
                remedy: match logical {
                    "mask" => format!("mask = \"{example}\""),
                    "transmission" => format!("transmission = {{ .. }} names it `{example}`"),
                    _ => format!("columns = {{ {logical} = \"{example}\" }}"),
                },
            });
        };
        if places.next().is_some() {
            return Err(LogError::DuplicateColumn { path: self.path.to_owned(), column: name.to_owned() });
        }
        // A column of a motor goes by its own name.
        let known = if logical == "transmission" { name } else { logical };
        let of = |numbers: &[(String, f64)]| numbers.iter().find(|(other, _)| other == known).map(|(_, own)| *own);
        let scale = of(&self.format.scale).unwrap_or(1.0);
        let turn = of(&self.format.turn).map(|turn| turn * scale.abs());
        Ok(Column { index, name: name.to_owned(), scale, turn, before: None, values: Vec::new() })
    }

    /// True for the project's own name of another column.
    fn is_taken(&self, name: &str) -> bool {
        let joint = |prefix| name.strip_prefix(prefix).and_then(|index| index.parse::<usize>().ok());
        let joint = joint("tau").or_else(|| joint("q")).or_else(|| joint("ref"));
        name == "t" || joint.is_some_and(|joint| joint < self.format.n_joints)
    }
}

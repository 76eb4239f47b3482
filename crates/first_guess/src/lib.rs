//! What the header and the numbers of logs suggest of an experiment, before anybody has described it.
//!
//! [`first_guess`] reads logs as they stand and says, each with its reason ([`guess`]):
//!
//! - which column is the time, which are the positions, torques and references of which joint (`names`, `columns`);
//! - in which units they are and with which sign: by the unit in a name, by the sample rate, by a speed column beside a
//!   position (`speed`), by encoders that begin anew (`turns`), and by what the device's own values need for the motion
//!   (`corrections`, which asks `dynid_check`);
//! - which joints were free, whether a run begins in motion, and which run to hold out (`runs`).
//!
//! What cannot be guessed is a [`FirstGuessError`] that says how to state it. Nothing is fitted, nothing is written.

mod chosen;
mod columns;
mod corrections;
pub mod guess;
mod names;
mod runs;
mod speed;
mod table;
mod time;
mod turns;

use std::fmt;
use std::path::PathBuf;

use dynid_dynamics::{simulate::Intersample, system::SystemError};
use dynid_logs::log::{LogError, place};
use dynid_model::Device;
use serde::Serialize;

use chosen::scale_positions;

pub use guess::{ColumnGuess, Factor, FactorReason, Remark, RoleReason, RunGuess, WhyColumn, WhyFree};
pub use names::Quantity;

/// What a person knows better.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Known {
    /// Which column is what: (`tau0`, the log's own name of it).
    pub columns: Vec<(String, String)>,
    /// The joints that were free in every log; guessed from the motion where this is `None`.
    pub free: Option<Vec<usize>>,
}

/// What logs suggest.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FirstGuess {
    /// The columns that an experiment needs: time, then positions, torques, references by joint.
    pub columns: Vec<ColumnGuess>,
    /// Columns that are not used.
    pub unused: Vec<String>,
    /// Whether rows whose time is that of the row before have to be left out.
    pub repeats_times: bool,
    /// Whether torques run straight from row to row, instead of standing still.
    pub is_straight: bool,
    /// A column whose zeros mark rows to leave out of the torque error.
    pub mask: Option<String>,
    /// The logs, or parts of a log.
    pub runs: Vec<RunGuess>,
    /// What was seen beside that.
    #[serde(rename = "typed_remarks")]
    pub remarks: Vec<Remark>,
    /// What still looks wrong, as `dynid check` finds it.
    pub findings: Vec<dynid_check::Finding>,
}

/// Why nothing can be guessed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FirstGuessError {
    /// A log that cannot be read.
    #[error(transparent)]
    Log(#[from] Box<LogError>),
    /// A file that is not there, or no table.
    #[error("{}: cannot be read: {reason}; give the path of a log", path.display())]
    Unreadable {
        /// The log.
        path: PathBuf,
        /// As the system tells it.
        reason: String,
    },
    /// No logs.
    #[error("there is no log to look at; name at least one file")]
    NoLogs,
    /// The first line holds numbers.
    #[error("{}:1: the first line holds numbers (`{number}`); expected the names of the columns there: add a line with them", path.display())]
    NumbersForHeader {
        /// The log.
        path: PathBuf,
        /// One of them.
        number: String,
    },
    /// A header that nothing parts into cells.
    #[error("{}:1: the header is a single cell, `{header}`; part the cells of all rows by commas, semicolons or tabs", path.display())]
    OneCell {
        /// The log.
        path: PathBuf,
        /// Its header.
        header: String,
    },
    /// A row of another number of cells than the header.
    #[error("{}:{line}: the row has {n_cells} cells, the header {n_names} names; expected as many: give each column one name, take lines above the header out, and write decimal points, not commas", path.display())]
    RaggedRow {
        /// The log.
        path: PathBuf,
        /// From 1.
        line: u64,
        /// In the row.
        n_cells: usize,
        /// In the header.
        n_names: usize,
    },
    /// A log of another header than the first one.
    #[error("{}: column `{column}` of {} is missing; it has {available}. Make one experiment of the logs of each header", path.display(), first.display())]
    OtherHeader {
        /// The log.
        path: PathBuf,
        /// Which name it lacks.
        column: String,
        /// The first log.
        first: PathBuf,
        /// Its own header.
        available: String,
    },
    /// No column can be the time.
    #[error("{}: no column is the time: none is named so and rises from row to row, and none rises evenly; the columns are {available}. Name it with `--column t=NAME`", path.display())]
    NoTime {
        /// The log.
        path: PathBuf,
        /// The header.
        available: String,
    },
    /// A column named a time, with a cell that is no number.
    #[error("{}: column `{column}` is named a time, but `{cell}` is no number; {remedy}", place(path, *line))]
    TimeIsNoNumber {
        /// The log.
        path: PathBuf,
        /// From 1, where the file has lines.
        line: Option<u64>,
        /// The column.
        column: String,
        /// What stands there.
        cell: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The time is in two columns.
    #[error("{}: the time is in two columns, `{whole}` and `{part}`; write their sum into one column, in seconds", path.display())]
    TimeInParts {
        /// The log.
        path: PathBuf,
        /// Seconds.
        whole: String,
        /// What is below a second.
        part: String,
    },
    /// A joint without a column.
    #[error("{}: no column is the {lacking} of joint {joint} ({title}); the columns are {available}. Name it with `--column {}{joint}=NAME`; {}", path.display(), lacking.kind(), lacking.remedy())]
    NoColumn {
        /// The log.
        path: PathBuf,
        /// Of what.
        lacking: Lacking,
        /// The device's joint index.
        joint: usize,
        /// Its title.
        title: String,
        /// The header.
        available: String,
    },
    /// A name of `Known::columns` that the project does not have.
    #[error(
        "`{name}` is no column of an experiment of `{device}`; the columns are t, and of each joint, from 0 to {last}, tau, q and ref with its number: tau0, q0, ref0"
    )]
    NoSuchLogical {
        /// As asked for.
        name: String,
        /// The device.
        device: String,
        /// Its last joint.
        last: usize,
    },
    /// A name of `Known::columns` that stands there twice.
    #[error("`{name}` is said twice, to be `{first}` and `{second}`; name one column of the log")]
    SaidTwice {
        /// As asked for.
        name: String,
        /// The log's own name.
        first: String,
        /// The other one.
        second: String,
    },
    /// A name of `Known::columns` that the log does not have.
    #[error("{}: there is no column `{name}` to be `{logical}`; the columns are {available}", path.display())]
    NoSuchColumn {
        /// The log.
        path: PathBuf,
        /// As asked for.
        name: String,
        /// What it was to be.
        logical: String,
        /// The header.
        available: String,
    },
    /// A joint of `Known::free` that the device does not have.
    #[error("`{device}` has no joint {joint}, its joints are 0 to {last}; name the free joints by their indices")]
    NoSuchJoint {
        /// As asked for.
        joint: usize,
        /// The device.
        device: String,
        /// Its last joint.
        last: usize,
    },
    /// No joint moves in a log.
    #[error("{}: no joint moves by more than its noise; leave the log out, or name the joints that were free with `--free`", path.display())]
    NothingMoves {
        /// The log.
        path: PathBuf,
    },
    /// A device that makes no equations for a log.
    #[error(transparent)]
    System(#[from] SystemError),
}

/// What a joint must have a column of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lacking {
    /// Every joint.
    Position,
    /// Every joint that moves.
    Torque,
    /// Every joint that moves, where one has a reference that a person named.
    Reference,
}

impl Lacking {
    /// The project's name of such columns.
    fn kind(self) -> &'static str {
        match self {
            Self::Position => "q",
            Self::Torque => "tau",
            Self::Reference => "ref",
        }
    }

    fn remedy(self) -> &'static str {
        match self {
            Self::Position => "a locked joint needs one as well, of where it stands",
            Self::Torque => "if it was locked, say which joints were free: `--free 0,1`",
            Self::Reference => "without it, those that are named are of no use: leave them out",
        }
    }
}

impl fmt::Display for Lacking {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Position => "position",
            Self::Torque => "torque",
            Self::Reference => "reference",
        })
    }
}

impl From<LogError> for FirstGuessError {
    fn from(error: LogError) -> Self {
        Self::Log(Box::new(error))
    }
}

/// Says what the logs of a robot hold, from their header and their numbers. The values of `device` need only be of the right
/// size. All logs must have the header of the first.
///
/// # Errors
/// A log that cannot be read; a time, a position or the torque of a joint that moves which no column seems to be.
pub fn first_guess(device: &'static Device, logs: &[PathBuf], known: &Known) -> Result<FirstGuess, FirstGuessError> {
    check_known(device, known)?;
    let tables = logs.iter().map(|path| table::read(path)).collect::<Result<Vec<_>, _>>()?;
    let Some(first) = tables.first() else { return Err(FirstGuessError::NoLogs) };
    let mut chosen = columns::choose(device, &tables, known)?;
    let mut remarks: Vec<Remark> = tables.iter().flat_map(table::Table::said).collect();
    remarks.append(&mut chosen.remarks);

    turns::factors(device, &tables, &mut chosen);
    let told = speed::compare(&tables, &chosen);
    remarks.extend(told.remarks);
    time::factor(&tables, &mut chosen, told.time.as_ref(), &mut remarks);
    told.position.iter().for_each(|factor| scale_positions(device, &mut chosen.columns, factor));
    let repeats_times = time::repeated(&tables, &chosen, &mut remarks);

    let mut guess = FirstGuess {
        unused: columns::unused(first, &chosen),
        mask: chosen.mask,
        columns: chosen.columns,
        repeats_times,
        is_straight: false,
        runs: Vec::new(),
        remarks,
        findings: Vec::new(),
    };
    let mut read = runs::read(device, &tables, &guess, &chosen.free)?;
    corrections::apply(device, &mut read, &mut guess, &chosen.not_commands)?;
    let why_free = if known.free.is_some() { WhyFree::Said } else { WhyFree::Moves };
    guess.runs = runs::guess(&tables, &read, why_free);
    Ok(guess)
}

fn check_known(device: &Device, known: &Known) -> Result<(), FirstGuessError> {
    let last = device.joints.len() - 1;
    let id = || device.id.clone();
    let kinds = ["q", "tau", "ref"];
    let names: Vec<String> = (0..=last).flat_map(|joint| kinds.map(|kind| format!("{kind}{joint}"))).collect();
    for (place, (name, second)) in known.columns.iter().enumerate() {
        if name != "t" && !names.contains(name) {
            return Err(FirstGuessError::NoSuchLogical { name: name.clone(), device: id(), last });
        }
        if let Some((_, first)) = known.columns[..place].iter().find(|(before, _)| before == name) {
            let (name, first, second) = (name.clone(), first.clone(), second.clone());
            return Err(FirstGuessError::SaidTwice { name, first, second });
        }
    }
    match known.free.iter().flatten().find(|joint| **joint > last) {
        Some(&joint) => Err(FirstGuessError::NoSuchJoint { joint, device: id(), last }),
        None => Ok(()),
    }
}

impl FirstGuess {
    /// How torques run between rows.
    pub fn intersample(&self) -> Intersample {
        if self.is_straight { Intersample::FirstOrder } else { Intersample::ZeroOrder }
    }

    /// What is guessed of the project's column `logical`.
    pub fn column(&self, logical: &str) -> Option<&ColumnGuess> {
        self.columns.iter().find(|column| column.logical == logical)
    }
}

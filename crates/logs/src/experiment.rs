//! Experiments: which logs there are, what was free in each, what each is for and how it is filtered.
//!
//! An `experiment.toml` names a device and lists runs; paths in it are relative to it. What is said above the first
//! `[[run]]` holds for every run that does not say otherwise.

use std::{
    fmt,
    path::{Path, PathBuf},
};

use dynid_model::{Device, document::MOST_TABLES, instance::check_payload, nearest};
use dynid_tables::Table;
use sha2::{Digest, Sha256};
use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use crate::{log, log::Log, log::LogError, log::LogFormat, log::Repeated, transmission::Transmission};
use dynid_dynamics::simulate::Intersample;

/// A list of runs of one device.
///
/// ```
/// use dynid_logs::experiment::{Experiment, Role};
/// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../src/tour/experiment.toml");
/// let experiment = Experiment::load(path)?;
/// let held_out = experiment.runs.iter().filter(|run| run.role == Role::Validate);
/// assert_eq!(held_out.map(|run| run.log.len()).sum::<usize>(), 801);
/// # Ok::<(), dynid_logs::experiment::ExperimentError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Experiment {
    /// The file that it was read from.
    pub path: PathBuf,
    /// The mechanism.
    pub device: &'static Device,
    /// In the order of the file; never empty.
    pub runs: Vec<Run>,
    /// SHA-256 (hex) of every number that the runs hold, after row selection and scaling.
    pub digest: String,
}

/// One log and what it is for.
#[derive(Debug, Clone)]
pub struct Run {
    /// As it stands in the experiment.
    pub file: String,
    /// Whether a fit may use it.
    pub role: Role,
    /// Free joints, ascending.
    pub free: Vec<usize>,
    /// What the robot carries: the effects of this name act, and no others that have one.
    pub payload: Option<String>,
    /// Number of the device's configuration with these free joints, from 1. Sets that are none are numbered on from the last, in the
    /// order of the runs.
    pub configuration: usize,
    /// Its samples.
    pub log: Log,
    /// How it is processed.
    pub settings: Settings,
}

impl Run {
    /// When the run began, as its log counts time (s).
    pub fn began_s(&self) -> f64 {
        self.settings.began_s.or_else(|| self.log.t.first().copied()).unwrap_or(0.0)
    }

    /// Whether what moved the joints did not depend on where they were, as far as the experiment says.
    pub fn is_open_loop(&self) -> bool {
        self.settings.controller.is_none() && self.log.reference.is_none()
    }

    /// Whether the experiment says how the torque error is to be filtered or masked.
    pub fn is_prepared_for_torque_error(&self) -> bool {
        let Settings { cutoff_hz, decimate, min_speed, .. } = &self.settings;
        cutoff_hz.is_some() || *decimate > 1 || self.log.mask.is_some() || min_speed.iter().any(|speed| *speed > 0.0)
    }

    /// How many samples of the beginning leave the position error of a fit.
    pub fn n_cut(&self) -> usize {
        let (Some(span), Some(first)) = (self.settings.from_s, self.log.t.first()) else { return 0 };
        self.log.t.partition_point(|t| *t < first + span)
    }

    /// Its file, and where a part of the log is a run of its own, which part.
    pub fn label(&self) -> String {
        match self.log.t.first().map(|first| first - self.began_s()) {
            Some(from) if from > 0.0 => format!("{} from {from:.1} s on", self.file),
            _ => self.file.clone(),
        }
    }

    /// Times of the samples, counted from the beginning of the run (s): the effects' time, whatever clock the log has.
    pub fn elapsed_s(&self) -> Vec<f64> {
        let began_s = self.began_s();
        self.log.t.iter().map(|t| t - began_s).collect()
    }
}

/// What a run is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// Parameters are fitted to it.
    Fit,
    /// Held out: a fitted model is judged by it.
    Validate,
}

impl fmt::Display for Role {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Fit => "fit",
            Self::Validate => "validate",
        })
    }
}

/// How a run is processed.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Cut-off of the zero-phase filter of the torque error (Hz); chosen from the log when absent.
    pub cutoff_hz: Option<f64>,
    /// The torque error keeps one of so many samples; 1 keeps all.
    pub decimate: usize,
    /// Slower samples leave the torque error: one entry a joint of the device [rad/s or m/s].
    pub min_speed: Vec<f64>,
    /// How the commanded torque runs between samples.
    pub intersample: Intersample,
    /// Controller of a closed-loop run.
    pub controller: Option<PathBuf>,
    /// So much of the log's beginning leaves the position error of a fit (s) (the transient cut of the thesis's
    /// Eq. 4.3).
    pub from_s: Option<f64>,
    /// Weight of the position error in the first half of the log (thesis Eq. 4.2: 0.5); 1 is neutral.
    pub first_half: f64,
    /// The log begins while the joints move: a position fit estimates their initial speeds with their initial positions.
    pub moving: bool,
    /// Where all joints of a planned run start [rad or m]: it was not played on the robot yet and has no measured positions.
    pub start: Option<Vec<f64>>,
    /// When the run began, as its log counts time (s), where the log is a later part of it; else its first sample.
    pub began_s: Option<f64>,
}

impl Default for Settings {
    /// What holds where an experiment says nothing, for a device of no joints.
    fn default() -> Self {
        Self {
            cutoff_hz: None,
            decimate: 1,
            min_speed: Vec::new(),
            intersample: Intersample::ZeroOrder,
            controller: None,
            from_s: None,
            first_half: 1.0,
            moving: false,
            start: None,
            began_s: None,
        }
    }
}

/// Why an experiment cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExperimentError {
    /// The file cannot be opened.
    #[error("{path}: cannot be read: {source}; give the path of an experiment file", path = path.display())]
    Unreadable {
        /// The experiment.
        path: PathBuf,
        /// As the system tells it.
        source: std::io::Error,
    },
    /// Something in the file is not as it must be.
    #[error("{path}:{line}:{column}: {message}; {remedy}", path = path.display())]
    Invalid {
        /// The experiment.
        path: PathBuf,
        /// From 1.
        line: usize,
        /// From 1, in characters.
        column: usize,
        /// What was expected and what was found.
        message: String,
        /// What to do.
        remedy: String,
    },
    /// No run has just these joints free.
    #[error("{path}: no run has just the joints {wanted:?} free; its runs have {known}", path = path.display())]
    NoRunWithFree {
        /// The experiment.
        path: PathBuf,
        /// Ascending.
        wanted: Vec<usize>,
        /// What the runs have.
        known: String,
    },
    /// What is said of a run that no file describes is not as it must be.
    #[error("{run}: {message}; {remedy}")]
    Given {
        /// Its log.
        run: String,
        /// What was expected and what was found.
        message: String,
        /// What to do.
        remedy: String,
    },
    /// The log of such a run cannot be used.
    #[error(transparent)]
    GivenLog(Box<LogError>),
    /// A log of it cannot be used.
    #[error("{error} (run {run} of {experiment})", experiment = experiment.display())]
    Log {
        /// The experiment.
        experiment: PathBuf,
        /// Number of the run, from 1.
        run: usize,
        /// What is wrong with the log.
        error: Box<LogError>,
    },
}

const EXPERIMENT_KEYS: [&str; 17] = [
    "device",
    "run",
    "columns",
    "scale",
    "turn",
    "repeated_times",
    "cutoff_hz",
    "decimate",
    "min_speed",
    "mask",
    "hold",
    "controller",
    "from_s",
    "first_half",
    "moving",
    "payload",
    "transmission",
];
pub(crate) const RUN_KEYS: [&str; 20] = [
    "file",
    "free",
    "role",
    "columns",
    "scale",
    "turn",
    "repeated_times",
    "rows",
    "cutoff_hz",
    "decimate",
    "min_speed",
    "mask",
    "hold",
    "controller",
    "from_s",
    "first_half",
    "moving",
    "start",
    "payload",
    "transmission",
];

impl Experiment {
    /// Reads an experiment with all its logs.
    ///
    /// # Errors
    /// The first thing that is wrong with the file or a log, with its place and a remedy.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ExperimentError> {
        Self::read_with(path.as_ref(), dynid_model::devices())
    }

    /// As [`Experiment::load`], with runs that are only planned: they say where they `start` instead of having measured
    /// positions.
    ///
    /// # Errors
    /// As [`Experiment::load`].
    pub fn load_planned(path: impl AsRef<Path>) -> Result<Self, ExperimentError> {
        Self::read_planned(path.as_ref(), dynid_model::devices())
    }

    /// The runs in which exactly these joints are free, in their order; all runs without a choice.
    ///
    /// # Errors
    /// There is none.
    pub fn runs_with_free(&self, free: Option<&[usize]>) -> Result<Vec<&Run>, ExperimentError> {
        let Some(free) = free else { return Ok(self.runs.iter().collect()) };
        let mut wanted = free.to_vec();
        wanted.sort_unstable();
        wanted.dedup();
        let runs: Vec<&Run> = self.runs.iter().filter(|run| run.free == wanted).collect();
        if !runs.is_empty() {
            return Ok(runs);
        }
        let mut known: Vec<String> = self.runs.iter().map(|run| format!("{:?}", run.free)).collect();
        known.dedup();
        Err(ExperimentError::NoRunWithFree { path: self.path.clone(), wanted, known: known.join(", ") })
    }

    /// Reads the experiment at `path` with all its logs; its device is one of `devices`, or that of a device file.
    pub fn read_with(path: &Path, devices: &'static [Device]) -> Result<Self, ExperimentError> {
        Self::read_as(path, devices, Planned::Refused)
    }

    /// As [`Experiment::read_with`], with runs that are only planned: they say where they `start` instead of having
    /// measured positions.
    pub fn read_planned(path: &Path, devices: &'static [Device]) -> Result<Self, ExperimentError> {
        Self::read_as(path, devices, Planned::Allowed)
    }

    fn read_as(path: &Path, devices: &'static [Device], planned: Planned) -> Result<Self, ExperimentError> {
        let text = dynid_model::document::read_text(path)
            .map_err(|source| ExperimentError::Unreadable { path: path.to_owned(), source })?;
        let file = File { path, text: &text };
        let document = DeTable::parse(&text).map_err(|error| {
            let remedy = "write it as TOML: `key = value`, runs under `[[run]]`";
            file.invalid(error.span().unwrap_or(0..0).start, error.message().to_owned(), remedy)
        })?;
        let top = document.get_ref();
        file.known_keys(top, &EXPERIMENT_KEYS)?;

        let device = file.device(top, devices)?;
        let Some(runs) = top.get("run") else {
            let remedy = "add one: [[run]] with file, free and role";
            return Err(file.invalid(text.len(), "the experiment has no run".to_owned(), remedy));
        };
        let entries = file.array(runs, "run", "[[run]] tables")?;
        if entries.is_empty() {
            let remedy = "add one: [[run]] with file, free and role";
            return Err(file.invalid(runs.span().start, "the experiment has no run".to_owned(), remedy));
        }
        if entries.len() > MOST_TABLES {
            let message = format!("the experiment has {} runs, more than {MOST_TABLES}", entries.len());
            let remedy = format!("keep at most {MOST_TABLES}; the others are an experiment of their own");
            return Err(file.invalid(runs.span().start, message, &remedy));
        }
        let mut hash = Sha256::new();
        let mut read = Vec::with_capacity(entries.len());
        let mut numbers = Numbers::new(device);
        for (index, entry) in entries.iter().enumerate() {
            let table = entry.get_ref().as_table().ok_or_else(|| file.wrong_type(entry, "run", "a [[run]] table"))?;
            file.known_keys(table, &RUN_KEYS)?;
            if let (Some(start), Planned::Refused) = (table.get("start"), planned) {
                let message = format!("start: run {} is only planned, it has no measured positions", index + 1);
                let remedy = "`dynid simulate` shows what a model would do; play it on the robot, log the positions and take \
                              `start` out";
                return Err(file.invalid(start.span().start, message, remedy));
            }
            let source = RunSource { file: &file, device, top, table, start: entry.span().start, number: index + 1 };
            // A hash is made in one thread: meanwhile the next log is read in all others.
            let (run, ()) = rayon::join(|| source.read(None), || feed(&mut hash, read.last()));
            let run = run?;
            read.push(Run { configuration: numbers.of(&run.free), ..run });
        }
        feed(&mut hash, read.last());
        Ok(Self { path: path.to_owned(), device, runs: read, digest: hexadecimal(hash) })
    }

    /// The experiment of these runs of `device`, whose configurations are numbered anew; `path` is for messages.
    ///
    /// # Panics
    /// Without a run.
    pub fn of_runs(path: &Path, device: &'static Device, mut runs: Vec<Run>) -> Self {
        assert!(!runs.is_empty(), "an experiment has runs");
        let mut hash = Sha256::new();
        let mut numbers = Numbers::new(device);
        for run in &mut runs {
            run.configuration = numbers.of(&run.free);
            feed(&mut hash, Some(run));
        }
        Self { path: path.to_owned(), device, runs, digest: hexadecimal(hash) }
    }

    /// The runs of one role, in order.
    pub fn runs_of(&self, role: Role) -> impl Iterator<Item = &Run> {
        self.runs.iter().filter(move |run| run.role == role)
    }
}

/// Feeds every number of a run to `hash`.
fn feed(hash: &mut Sha256, run: Option<&Run>) {
    let Some(run) = run else { return };
    hash.update([run.role as u8]);
    hash.update((run.configuration as u64).to_le_bytes());
    run.log.digest(hash);
    run.payload.iter().for_each(|name| hash.update(format!("payload {name}\n")));
}

fn hexadecimal(hash: Sha256) -> String {
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Whether runs without measured positions may be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Planned {
    Allowed,
    Refused,
}

/// One `[[run]]` on its way to a [`Run`].
pub(crate) struct RunSource<'a> {
    pub(crate) file: &'a File<'a>,
    pub(crate) device: &'static Device,
    pub(crate) top: &'a DeTable<'a>,
    pub(crate) table: &'a DeTable<'a>,
    /// Byte at which the run starts.
    pub(crate) start: usize,
    /// From 1.
    pub(crate) number: usize,
}

/// Numbers of the sets of free joints: those of the device's configurations, then further ones in the order of the runs.
struct Numbers {
    device: &'static Device,
    others: Vec<Vec<usize>>,
}

impl Numbers {
    fn new(device: &'static Device) -> Self {
        Self { device, others: Vec::new() }
    }

    fn of(&mut self, free: &[usize]) -> usize {
        if let Some(number) = self.device.configuration_of(free) {
            return number;
        }
        let known = self.others.iter().position(|other| other == free);
        let place = known.unwrap_or_else(|| {
            self.others.push(free.to_vec());
            self.others.len() - 1
        });
        self.device.configurations.len() + 1 + place
    }
}

impl<'a> RunSource<'a> {
    /// With the log that is `given`, else that of its file.
    pub(crate) fn read(&self, given: Option<&Table>) -> Result<Run, ExperimentError> {
        let file = self.file;
        let name = file.string(self.required("file", "the path of a log")?, "file")?;
        let columns = self.pairs("columns", "a name, e.g. columns = { tau0 = \"tau_1\" }", |value| {
            value.get_ref().as_str().map(str::to_owned)
        })?;
        let free = match (self.table.get("free"), given) {
            (None, Some(table)) => self.moving(table, &columns)?,
            _ => self.free(self.required("free", "the free joints, e.g. free = [0, 1]")?)?,
        };
        let role_value = self.required("role", "\"fit\" or \"validate\"")?;
        let role = match file.string(role_value, "role")? {
            "fit" => Role::Fit,
            "validate" => Role::Validate,
            other => {
                let message = format!("role: expected \"fit\" or \"validate\", found \"{other}\"");
                let remedy = "say \"fit\" for a run that parameters are fitted to, \"validate\" for a held-out run";
                return Err(file.invalid(role_value.span().start, message, remedy));
            }
        };
        let format = LogFormat {
            n_joints: self.device.joints.len(),
            columns,
            scale: self.pairs("scale", "a finite number other than 0, e.g. scale = { tau0 = 10.0 }", |value| {
                number(value).filter(|factor| *factor != 0.0)
            })?,
            turn: self.pairs("turn", "a positive number, e.g. turn = { q0 = 360 }", |value| {
                number(value).filter(|turn| *turn > 0.0)
            })?,
            repeated: self.repeated()?,
            rows: self.rows()?,
            mask: match self.setting("mask") {
                Some(value) => Some(file.string(value, "mask")?.to_owned()),
                None => None,
            },
            free: free.clone(),
            start: self.start()?,
            has_controller: self.setting("controller").is_some(),
            // What is planned is planned for the joints.
            transmission: match (self.setting("transmission"), self.table.get("start")) {
                (Some(value), None) => Some(self.transmission(value)?),
                _ => None,
            },
        };
        let payload = self.setting("payload").map(|value| self.payload(value)).transpose()?.flatten();
        let settings = self.settings(&free)?;
        let path = file.relative(name);
        let log = match given {
            Some(table) => log::of_table(&path, table, &format),
            None => log::read(&path, &format),
        };
        let log = log.map_err(|error| ExperimentError::Log {
            experiment: file.path.to_owned(),
            run: self.number,
            error: Box::new(error),
        })?;
        if let (Some(value), None) = (self.setting("controller"), &log.reference) {
            let columns: Vec<String> = free.iter().map(|joint| format!("ref{joint}")).collect();
            let message = format!("controller: {name} lacks the references that it follows: {}", columns.join(", "));
            let remedy =
                format!("log them; where they have other names, say so: columns = {{ {} = \"...\" }}", columns[0]);
            return Err(file.invalid(value.span().start, message, &remedy));
        }
        // Whoever knows the other runs numbers the configurations that the device does not have.
        let configuration = self.device.configuration_of(&free).unwrap_or(self.device.configurations.len() + 1);
        Ok(Run { file: name.to_owned(), role, free, payload, configuration, log, settings })
    }

    /// The free joints, ascending.
    fn free(&self, value: &Spanned<DeValue<'a>>) -> Result<Vec<usize>, ExperimentError> {
        let file = self.file;
        let mut free = self.joints(value, "free")?;
        if free.is_empty() {
            let message = format!("free: no joint is free in run {}, so nothing in it moves", self.number);
            let remedy = "name the joints that were not locked, e.g. free = [0], or leave the run out";
            return Err(file.invalid(value.span().start, message, remedy));
        }
        free.sort_unstable();
        Ok(free)
    }

    /// Joints of the device, in the order of the file.
    fn joints(&self, value: &Spanned<DeValue<'a>>, key: &str) -> Result<Vec<usize>, ExperimentError> {
        let file = self.file;
        let mut joints = Vec::new();
        for entry in file.array(value, key, &format!("joint indices, e.g. {key} = [0, 1]"))? {
            let joint = index(entry).filter(|joint| *joint < self.device.joints.len()).ok_or_else(|| {
                let last = self.device.joints.len() - 1;
                let message = match index(entry) {
                    Some(joint) => {
                        format!("{key}: `{}` has no joint {joint}, its joints are 0 to {last}", self.device.id)
                    }
                    None => format!("{key}: expected joints of `{}` (0 to {last})", self.device.id),
                };
                file.invalid(entry.span().start, message, "name each joint by its index")
            })?;
            if joints.contains(&joint) {
                let message = format!("{key}: joint {joint} is named twice");
                return Err(file.invalid(entry.span().start, message, "name each joint once"));
            }
            joints.push(joint);
        }
        Ok(joints)
    }

    /// Where all joints of a planned run start.
    fn start(&self) -> Result<Option<Vec<f64>>, ExperimentError> {
        let Some(value) = self.table.get("start") else { return Ok(None) };
        let n_joints = self.device.joints.len();
        let what = format!("one position for each of the {n_joints} joints [rad or m]");
        let entries = self.file.array(value, "start", &what)?;
        if entries.len() != n_joints {
            let message = format!("start: found {} positions, expected {what}", entries.len());
            return Err(self.file.invalid(value.span().start, message, "give one for every joint, locked ones too"));
        }
        let position = |entry: &&Spanned<DeValue<'a>>| {
            number(entry).ok_or_else(|| self.file.wrong_type(entry, "start", "a finite position"))
        };
        entries.iter().map(position).collect::<Result<Vec<f64>, _>>().map(Some)
    }

    /// What the run carries; an empty name is nothing.
    fn payload(&self, value: &Spanned<DeValue<'a>>) -> Result<Option<String>, ExperimentError> {
        let name = self.file.string(value, "payload")?;
        if name.is_empty() {
            return Ok(None);
        }
        check_payload(name).map_err(|message| {
            let remedy = "choose another name, also for the effects of the model that it stands for";
            self.file.invalid(value.span().start, message, remedy)
        })?;
        Ok(Some(name.to_owned()))
    }

    /// What stands between the logged motors and the joints.
    fn transmission(&self, value: &Spanned<DeValue<'a>>) -> Result<Transmission, ExperimentError> {
        let file = self.file;
        let what = "a table with position, torque and ratio";
        let table = value.get_ref().as_table().ok_or_else(|| file.wrong_type(value, "transmission", what))?;
        file.known_keys(table, &["joints", "position", "torque", "reference", "ratio", "motor_constant"])?;
        let wrong = |message: String, remedy: &str| file.invalid(value.span().start, message, remedy);
        let joints = match table.get("joints") {
            Some(value) => self.joints(value, "transmission.joints")?,
            None => (0..self.device.joints.len()).collect(),
        };
        let columns = |key: &str| -> Result<Vec<String>, ExperimentError> {
            let Some(value) = table.get(key) else { return Ok(Vec::new()) };
            let names = file.array(value, key, "names of columns, one a motor")?;
            names.into_iter().map(|name| Ok(file.string(name, key)?.to_owned())).collect()
        };
        let (position, torque, reference) = (columns("position")?, columns("torque")?, columns("reference")?);
        let n_motors = position.len().max(torque.len());
        if joints.is_empty() {
            return Err(wrong("transmission: it moves no joint".to_owned(), "name the joints that the motors move"));
        }
        if n_motors == 0 {
            let message = "transmission: neither `position` nor `torque` names a column".to_owned();
            return Err(wrong(message, "name the columns of the motors, e.g. position = [\"m0\", \"m1\"]"));
        }
        let ratio = table.get("ratio").ok_or_else(|| {
            let remedy = "add ratio = [100, 80], turns of each motor for a turn of its joint; or one row a motor with one number a joint";
            wrong("transmission: `ratio` is missing".to_owned(), remedy)
        })?;
        let ratio = self.ratio(ratio, n_motors, joints.len())?;
        let motor_constant = match table.get("motor_constant") {
            Some(value) => self.numbers(value, "motor_constant", n_motors, "motor")?,
            None => vec![1.0; n_motors],
        };
        if motor_constant.contains(&0.0) {
            return Err(wrong(
                "motor_constant: a motor of 0 makes no torque".to_owned(),
                "give what a unit of its column is [N*m], or leave `motor_constant` out where it is unknown",
            ));
        }
        for (key, columns) in [("position", &position), ("torque", &torque), ("reference", &reference)] {
            if columns.len() != n_motors && !columns.is_empty() {
                let message = format!("transmission: {key} names {} columns for {n_motors} motors", columns.len());
                return Err(wrong(message, "name the column of every motor"));
            }
        }
        let given = [("q", &position), ("tau", &torque), ("ref", &reference)];
        let given = given.into_iter().filter(|(_, columns)| !columns.is_empty());
        let names: Vec<String> =
            given.flat_map(|(kind, _)| joints.iter().map(move |joint| format!("{kind}{joint}"))).collect();
        let doubly = names.into_iter().find(|name| {
            let stands_in = |key: &str| {
                self.setting(key)
                    .and_then(|value| value.get_ref().as_table())
                    .is_some_and(|own| own.get(name.as_str()).is_some())
            };
            ["columns", "scale", "turn"].into_iter().any(stands_in)
        });
        if let Some(name) = doubly {
            let message =
                format!("transmission: `{name}` comes from the motors, but stands in columns, scale or turn too");
            return Err(wrong(message, "remove it there, or take the joint out of transmission.joints"));
        }
        Transmission::new(joints, [position, torque, reference], &ratio, motor_constant).map_err(|message| {
            wrong(format!("transmission: {message}"), "check `ratio`: its rows are motors, its columns joints")
        })
    }

    /// One row a motor: turns for a turn of each joint. A plain number is a motor's own joint.
    fn ratio(
        &self,
        value: &Spanned<DeValue<'a>>,
        n_motors: usize,
        n_joints: usize,
    ) -> Result<Vec<Vec<f64>>, ExperimentError> {
        let rows = self.file.array(value, "ratio", "one number a motor, or one row a motor")?;
        if n_motors != n_joints && rows.iter().any(|row| number(row).is_some()) {
            let message =
                format!("ratio: {n_motors} motors move {n_joints} joints, so no motor has a joint of its own");
            let remedy = "give one row a motor with one number a joint, e.g. [[50, 40], [50, -40]]";
            return Err(self.file.invalid(value.span().start, message, remedy));
        }
        if rows.len() != n_motors {
            let message = format!("ratio: found {} rows for {n_motors} motors", rows.len());
            return Err(self.file.invalid(value.span().start, message, "give one row, or one number, for every motor"));
        }
        let row = |(motor, row): (usize, &Spanned<DeValue<'a>>)| match number(row) {
            Some(ratio) => Ok((0..n_joints).map(|joint| if joint == motor { ratio } else { 0.0 }).collect()),
            None => self.numbers(row, "ratio", n_joints, "joint"),
        };
        rows.into_iter().enumerate().map(row).collect()
    }

    fn numbers(
        &self,
        value: &Spanned<DeValue<'a>>,
        key: &str,
        count: usize,
        of: &str,
    ) -> Result<Vec<f64>, ExperimentError> {
        let what = format!("{count} numbers, one a {of}");
        let entries = self.file.array(value, key, &what)?;
        let wrong = || self.file.wrong_type(value, key, &what);
        if entries.len() != count {
            return Err(wrong());
        }
        entries.into_iter().map(|entry| number(entry).ok_or_else(wrong)).collect()
    }

    fn repeated(&self) -> Result<Repeated, ExperimentError> {
        let file = self.file;
        let Some(value) = self.setting("repeated_times") else { return Ok(Repeated::Refuse) };
        match file.string(value, "repeated_times")? {
            "refuse" => Ok(Repeated::Refuse),
            "skip" => Ok(Repeated::Skip),
            other => {
                let message = format!("repeated_times: expected \"refuse\" or \"skip\", found \"{other}\"");
                let remedy = "say \"skip\" where a row with the time of the row before is to be left out";
                Err(file.invalid(value.span().start, message, remedy))
            }
        }
    }

    fn rows(&self) -> Result<Option<[usize; 2]>, ExperimentError> {
        let Some(value) = self.table.get("rows") else { return Ok(None) };
        let wrong = || self.file.wrong_type(value, "rows", "two row numbers, rows = [from, to], to excluded");
        match value.get_ref().as_array() {
            Some(array) if array.len() == 2 => {
                let from = index(&array[0]).ok_or_else(wrong)?;
                let to = index(&array[1]).ok_or_else(wrong)?;
                Ok(Some([from, to]))
            }
            _ => Err(wrong()),
        }
    }

    fn settings(&self, free: &[usize]) -> Result<Settings, ExperimentError> {
        let file = self.file;
        let cutoff_hz = match self.setting("cutoff_hz") {
            Some(value) => Some(
                number(value)
                    .filter(|hertz| *hertz > 0.0)
                    .ok_or_else(|| file.wrong_type(value, "cutoff_hz", "a positive frequency [Hz]"))?,
            ),
            None => None,
        };
        let decimate = match self.setting("decimate") {
            Some(value) => index(value)
                .filter(|factor| *factor >= 1)
                .ok_or_else(|| file.wrong_type(value, "decimate", "a whole number from 1"))?,
            None => 1,
        };
        let min_speed = match self.setting("min_speed") {
            Some(value) => self.min_speed(value, free)?,
            None => vec![0.0; self.device.joints.len()],
        };
        let intersample = match self.setting("hold") {
            Some(value) => match file.string(value, "hold")? {
                "zero" => Intersample::ZeroOrder,
                "linear" => Intersample::FirstOrder,
                other => {
                    let message = format!("hold: expected \"zero\" or \"linear\", found \"{other}\"");
                    let remedy = "say \"zero\" where the torque of a row acts until the next row, \"linear\" where it runs straight between them";
                    return Err(file.invalid(value.span().start, message, remedy));
                }
            },
            None => Intersample::ZeroOrder,
        };
        let controller = match self.setting("controller") {
            Some(value) => {
                let name = file.string(value, "controller")?;
                let path = file.relative(name);
                if !path.is_file() {
                    let message = format!("controller: there is no file {}", path.display());
                    let remedy = "give the path of the controller file, relative to the experiment";
                    return Err(file.invalid(value.span().start, message, remedy));
                }
                Some(path)
            }
            None => None,
        };
        let from_s = match self.setting("from_s") {
            Some(value) => Some(number(value).filter(|span| *span >= 0.0).ok_or_else(|| {
                file.wrong_type(value, "from_s", "a time after the log's first sample [s], not negative")
            })?),
            None => None,
        };
        let first_half = match self.setting("first_half") {
            Some(value) => number(value)
                .filter(|weight| *weight > 0.0)
                .ok_or_else(|| file.wrong_type(value, "first_half", "a positive weight, e.g. 0.5"))?,
            None => 1.0,
        };
        let moving = match self.setting("moving") {
            Some(value) => value
                .get_ref()
                .as_bool()
                .ok_or_else(|| file.wrong_type(value, "moving", "true where the log begins in motion, else false"))?,
            None => false,
        };
        let start = self.start()?;
        Ok(Settings {
            cutoff_hz,
            decimate,
            min_speed,
            intersample,
            controller,
            from_s,
            first_half,
            moving,
            start,
            began_s: None,
        })
    }

    /// One speed a joint of the device, or one a free joint.
    fn min_speed(&self, value: &Spanned<DeValue<'a>>, free: &[usize]) -> Result<Vec<f64>, ExperimentError> {
        let file = self.file;
        let n_joints = self.device.joints.len();
        let what = "one speed a joint [rad/s or m/s], not negative";
        let mut speeds = Vec::new();
        for entry in file.array(value, "min_speed", what)? {
            let speed = number(entry).filter(|speed| *speed >= 0.0);
            speeds.push(speed.ok_or_else(|| file.wrong_type(entry, "min_speed", what))?);
        }
        if speeds.len() == n_joints {
            return Ok(speeds);
        }
        if speeds.len() == free.len() {
            let mut all = vec![0.0; n_joints];
            free.iter().zip(&speeds).for_each(|(&joint, &speed)| all[joint] = speed);
            return Ok(all);
        }
        let message = format!("min_speed: found {} speeds for {} free joints", speeds.len(), free.len());
        let remedy = format!("give one a free joint of the run, or one for each of the device's {n_joints} joints");
        Err(file.invalid(value.span().start, message, &remedy))
    }

    /// What the run says, else what the experiment says.
    fn setting(&self, key: &str) -> Option<&'a Spanned<DeValue<'a>>> {
        self.table.get(key).or_else(|| self.top.get(key))
    }

    pub(crate) fn required(&self, key: &str, what: &str) -> Result<&'a Spanned<DeValue<'a>>, ExperimentError> {
        self.table.get(key).ok_or_else(|| {
            let message = format!("run {} does not say `{key}`", self.number);
            self.file.invalid(self.start, message, &format!("add {what}"))
        })
    }

    /// A table from the project's column names to values of one kind.
    fn pairs<T>(
        &self,
        key: &str,
        what: &str,
        read: impl Fn(&Spanned<DeValue<'a>>) -> Option<T>,
    ) -> Result<Vec<(String, T)>, ExperimentError> {
        let file = self.file;
        let Some(value) = self.setting(key) else { return Ok(Vec::new()) };
        let table = value.get_ref().as_table().ok_or_else(|| file.wrong_type(value, key, "a table"))?;
        let mut names = vec!["t".to_owned()];
        for joint in 0..self.device.joints.len() {
            names.extend([format!("tau{joint}"), format!("q{joint}"), format!("ref{joint}")]);
        }
        if key != "columns" {
            names.extend(self.motor_columns());
        }
        let mut pairs = Vec::new();
        for (name, entry) in table.iter() {
            let name_text: &str = name.get_ref();
            if !names.iter().any(|known| known == name_text) {
                let message = format!("{key}: there is no column `{name_text}` of `{}`", self.device.id);
                let remedy = format!("{}the columns are {}", did_you_mean(name_text, &names), names.join(", "));
                return Err(file.invalid(name.span().start, message, &remedy));
            }
            let wrong = || file.wrong_type(entry, &format!("{key}.{name_text}"), what);
            pairs.push((name_text.to_owned(), read(entry).ok_or_else(wrong)?));
        }
        Ok(pairs)
    }
}

impl RunSource<'_> {
    /// Names that `[transmission]` has for columns of the log.
    fn motor_columns(&self) -> Vec<String> {
        let Some(table) = self.setting("transmission").and_then(|value| value.get_ref().as_table()) else {
            return Vec::new();
        };
        let lists =
            ["position", "torque", "reference"].into_iter().filter_map(|key| table.get(key)?.get_ref().as_array());
        lists.flat_map(|list| list.iter()).filter_map(|name| Some(name.get_ref().as_str()?.to_owned())).collect()
    }
}

/// The experiment file, to say where something stands in it.
pub(crate) struct File<'a> {
    pub(crate) path: &'a Path,
    pub(crate) text: &'a str,
}

impl<'a> File<'a> {
    pub(crate) fn invalid(&self, offset: usize, message: String, remedy: &str) -> ExperimentError {
        // Offsets are those of the parser, which stand between characters.
        let before = self.text.get(..offset).unwrap_or(self.text);
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        ExperimentError::Invalid {
            path: self.path.to_owned(),
            line: before.matches('\n').count() + 1,
            column: before[line_start..].chars().count() + 1,
            message,
            remedy: remedy.to_owned(),
        }
    }

    fn wrong_type(&self, value: &Spanned<DeValue<'_>>, key: &str, expected: &str) -> ExperimentError {
        let found = self.text.get(value.span()).unwrap_or_default().lines().next().unwrap_or_default();
        let message = format!("{key}: expected {expected}, found `{found}`");
        self.invalid(value.span().start, message, "correct the value")
    }

    fn device(&self, top: &DeTable<'_>, devices: &'static [Device]) -> Result<&'static Device, ExperimentError> {
        let Some(value) = top.get("device") else {
            let ids: Vec<&str> = devices.iter().map(|device| device.id.as_str()).collect();
            let remedy = format!("add device = \"..\" as the first line: a device file, or one of {}", ids.join(", "));
            return Err(self.invalid(0, "the experiment does not say its device".to_owned(), &remedy));
        };
        let name = self.string(value, "device")?;
        if let Some(device) = devices.iter().find(|device| device.id == name) {
            return Ok(device);
        }
        let folder = self.path.parent().unwrap_or(Path::new(""));
        dynid_model::device_named(name, folder)
            .map_err(|error| self.invalid(value.span().start, error.to_string(), &error.remedy()))
    }

    pub(crate) fn known_keys(&self, table: &DeTable<'_>, known: &[&str]) -> Result<(), ExperimentError> {
        for (key, _) in table.iter() {
            let name: &str = key.get_ref();
            if !known.contains(&name) {
                let remedy = format!("{}the keys here are {}", did_you_mean(name, known), known.join(", "));
                return Err(self.invalid(key.span().start, format!("unknown key `{name}`"), &remedy));
            }
        }
        Ok(())
    }

    pub(crate) fn string<'v>(&self, value: &'v Spanned<DeValue<'_>>, key: &str) -> Result<&'v str, ExperimentError> {
        value.get_ref().as_str().ok_or_else(|| self.wrong_type(value, key, "a text in quotes"))
    }

    fn array<'v>(
        &self,
        value: &'v Spanned<DeValue<'a>>,
        key: &str,
        what: &str,
    ) -> Result<Vec<&'v Spanned<DeValue<'a>>>, ExperimentError> {
        let array = value.get_ref().as_array().ok_or_else(|| self.wrong_type(value, key, what))?;
        Ok(array.iter().collect())
    }

    /// A path of the experiment, relative to its file.
    pub(crate) fn relative(&self, name: &str) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(name)
    }
}

/// A finite number, written as an integer or a float.
fn number(value: &Spanned<DeValue<'_>>) -> Option<f64> {
    let text = match value.get_ref() {
        DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str(),
        DeValue::Float(float) => float.as_str(),
        _ => return None,
    };
    text.replace('_', "").parse().ok().filter(|number: &f64| number.is_finite())
}

/// A whole number from 0.
fn index(value: &Spanned<DeValue<'_>>) -> Option<usize> {
    match value.get_ref() {
        DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str().replace('_', "").parse().ok(),
        _ => None,
    }
}

/// `did you mean ..? `, or nothing where no name is near.
fn did_you_mean<S: AsRef<str>>(name: &str, known: &[S]) -> String {
    nearest(name, known.iter().map(AsRef::as_ref)).map_or(String::new(), |near| format!("did you mean `{near}`? "))
}

#[cfg(test)]
mod tests;

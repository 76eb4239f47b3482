//! Where a wall is met: device, joint, sampling, hands and approaches, as a file.

use std::path::Path;

use dynid_model::{
    Device, ModelError, Source,
    document::{self, Entry, Table},
};

use super::{
    hand::Hand,
    measure::{SLOWEST_HZ, TO_S},
};
use dynid_dynamics::simulate::control::Filter;
use dynid_files::DocumentError;
use dynid_user_model::device_of;

/// Where a wall is met.
#[derive(Debug, Clone)]
pub struct Setting {
    /// The mechanism.
    pub device: &'static Device,
    /// The joint that meets the wall; the others are locked.
    pub joint: usize,
    /// Positions of all joints [rad or m]: the locked ones stay there.
    pub posture: Vec<f64>,
    /// Time between two ticks of the controller (s).
    pub sample_s: f64,
    /// Ticks from a measurement to the torque that answers it.
    pub delay_samples: usize,
    /// Positions reach the controller in whole multiples of this [rad or m]; 0 for exact ones.
    pub position_quantum: f64,
    /// Largest torque of the wall at the joint [N*m or N].
    pub torque_limit: f64,
    /// What the controller makes of differences of positions (Eq. 4.7).
    pub filter: Filter,
    /// Longest integration step (s).
    pub step_s: f64,
    /// How long after the first contact a simulation goes on (s).
    pub after_s: f64,
    /// The typical hand.
    pub hand: Hand,
    /// Every number of a hand lies within this factor of the typical one.
    pub spread: f64,
    /// How many hands there are.
    pub hands: usize,
    /// What they are drawn from.
    pub seed: u64,
    /// Where an approach starts [rad or m], outside of the wall.
    pub start: f64,
    /// An approach with peak speed v aims at `-(aim[0] + aim[1] v)` [rad or m].
    pub aim: [f64; 2],
    /// After contact the arm holds with the torque `hold[0] + hold[1] v` [N*m or N] against the wall.
    pub hold: [f64; 2],
    /// How fast, after contact, the arm gives up its aim and takes to holding (s).
    pub relax_s: f64,
    /// How fast one approaches.
    pub approaches: Vec<Approach>,
}

/// How fast one approaches.
#[derive(Debug, Clone, PartialEq)]
pub struct Approach {
    /// E.g. `slow`.
    pub name: String,
    /// Largest speed of the arm's planned motion [rad/s or m/s].
    pub peak: f64,
    /// The torque with which the arm holds, where it is not what the speed says [N*m or N].
    pub hold: Option<f64>,
}

impl Setting {
    /// As many hands are simulated at most.
    pub const MOST_HANDS: usize = 100_000;

    /// The setting that the program carries.
    ///
    /// # Errors
    /// Never, as tests see to.
    pub fn shipped() -> Result<Self, DocumentError> {
        Ok(Self::parse(super::SETTING, Path::new("setting.toml"))?)
    }

    /// Reads a setting file.
    ///
    /// # Errors
    /// A file that cannot be read, or the first thing that is wrong in it, with its place.
    pub fn load(path: &Path) -> Result<Self, DocumentError> {
        Ok(Self::parse(&dynid_files::read(path)?, path)?)
    }

    /// Reads the text of a setting file; `path` is for messages.
    ///
    /// # Errors
    /// The first thing that is wrong, with its place.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ModelError> {
        let source = Source::new(path, text);
        let document = document::parse(&source)?;
        let root = Table::root(&source, &document);
        root.only(&["device", "joint", "posture", "controller", "hand", "approach", "simulation"])?;
        let device = device_of(&root)?;
        let n_joints = device.joints.len();
        let entry = root.required("joint", "the joint's number")?;
        let joint = entry.index()?;
        if joint >= n_joints {
            let help = format!("its joints are 0 to {}", n_joints - 1);
            return Err(entry.error(format!("device `{}` has no joint {joint}", device.id)).help(help));
        }
        let posture = posture(&root, n_joints)?;
        let controller = root.table("controller", "how the controller is sampled")?;
        controller.only(&["sample_s", "delay_samples", "position_quantum", "torque_limit", "cutoff_hz"])?;
        let Sampling { sample_s, delay_samples, position_quantum, filter, step_s, after_s } =
            Sampling::read(&root, &controller)?;
        let hand = root.table("hand", "who moves the handle")?;
        hand.only(&[&["inertia"], &People::KEYS[..]].concat())?;
        let People { typical, spread, count, seed } = People::read(&hand, "inertia", Some(Hand::SHAKES))?;
        let approach = root.table("approach", "how the wall is approached")?;
        approach.only(&[&["start"], &Reaching::KEYS[..]].concat())?;
        let Reaching { aim, hold, relax_s, approaches } = Reaching::read(&approach)?;
        Ok(Self {
            device,
            joint,
            posture,
            sample_s,
            delay_samples,
            position_quantum,
            torque_limit: positive(&controller, "torque_limit")?,
            filter,
            step_s,
            after_s,
            hand: typical,
            spread,
            hands: count,
            seed,
            start: positive(&approach, "start")?,
            aim,
            hold,
            relax_s,
            approaches,
        })
    }

    /// The torque with which the arm holds against the wall after an approach [N*m or N].
    pub fn hold_after(&self, approach: &Approach) -> f64 {
        self.reaching().hold_after(approach)
    }

    pub(super) fn sampling(&self) -> Sampling {
        let Self { sample_s, delay_samples, position_quantum, filter, step_s, after_s, .. } = *self;
        Sampling { sample_s, delay_samples, position_quantum, filter, step_s, after_s }
    }

    pub(super) fn reaching(&self) -> Reaching {
        let Self { aim, hold, relax_s, .. } = *self;
        Reaching { aim, hold, relax_s, approaches: self.approaches.clone() }
    }
}

/// How the controller is sampled, and the device simulated between its ticks.
#[derive(Debug, Clone, Copy)]
pub struct Sampling {
    /// Time between two ticks of the controller (s).
    pub sample_s: f64,
    /// Ticks from a measurement to the torque that answers it.
    pub delay_samples: usize,
    /// Positions are rounded to multiples of it [rad or m]; 0 for exact ones.
    pub position_quantum: f64,
    /// What the controller makes of differences of positions (Eq. 4.7).
    pub filter: Filter,
    /// Longest integration step (s).
    pub step_s: f64,
    /// How long after the first contact a simulation goes on (s).
    pub after_s: f64,
}

impl Sampling {
    /// Controllers that are faster are not simulated (s).
    pub const SHORTEST_S: f64 = 1e-5;

    /// How many steps of the integration a sample takes, and how long they are (s).
    pub(super) fn steps(&self) -> (usize, f64) {
        let steps = (self.sample_s / self.step_s - 1e-9).ceil().max(1.0) as usize;
        (steps, self.sample_s / steps as f64)
    }

    pub(super) fn read(root: &Table<'_>, controller: &Table<'_>) -> Result<Self, ModelError> {
        let simulation = root.table("simulation", "how the device is simulated")?;
        simulation.only(&["step_s", "after_s"])?;
        let sample_s = within(controller, "sample_s", (Self::SHORTEST_S, 1.0))?;
        let step_s = within(&simulation, "step_s", (1e-6, 1.0))?;
        if step_s > sample_s {
            let entry = simulation.required("step_s", "")?;
            let message = format!("`step_s` is {step_s}, longer than the controller's sample time {sample_s}");
            return Err(entry.error(message).help("simulate at least one step for every tick of the controller"));
        }
        let after_s = within(&simulation, "after_s", (0.0, 600.0))?;
        if after_s < TO_S {
            let message =
                format!("`after_s` is {after_s}: how still the wall is shows up to {TO_S} s after the contact");
            return Err(simulation.required("after_s", "")?.error(message).help(format!("give at least {TO_S}")));
        }
        if sample_s >= 1.0 / (2.0 * SLOWEST_HZ) {
            let message =
                format!("`sample_s` is {sample_s}: chatter above {SLOWEST_HZ} Hz does not show in its samples");
            return Err(controller.required("sample_s", "")?.error(message).help("sample faster"));
        }
        Ok(Self {
            sample_s,
            delay_samples: up_to(controller, "delay_samples", (0, 1000))?,
            position_quantum: not_negative(controller, "position_quantum")?,
            filter: Filter::butterworth(positive(controller, "cutoff_hz")?, sample_s),
            step_s,
            after_s,
        })
    }
}

/// Who holds the handle.
#[derive(Debug, Clone, Copy)]
pub struct People {
    /// The typical hand.
    pub typical: Hand,
    /// Every number of a hand lies within this factor of the typical one.
    pub spread: f64,
    /// How many hands there are.
    pub count: usize,
    /// What they are drawn from.
    pub seed: u64,
}

impl People {
    pub(super) const KEYS: [&'static str; 9] = [
        "grip_stiffness",
        "grip_damping",
        "arm_stiffness",
        "arm_damping",
        "tightening",
        "shakes",
        "spread",
        "count",
        "seed",
    ];

    /// `inertia` is the key of the hand's; `shakes` is what it is where the file does not say, if it may leave it out.
    pub(super) fn read(hand: &Table<'_>, inertia: &str, shakes: Option<f64>) -> Result<Self, ModelError> {
        let spread = positive(hand, "spread")?;
        if spread < 1.0 {
            return Err(hand
                .required("spread", "")?
                .error(format!("`spread` is {spread}"))
                .help("give a factor from 1"));
        }
        let shakes = match shakes.filter(|_| hand.optional("shakes").is_none()) {
            Some(usual) => usual,
            None => positive(hand, "shakes")?,
        };
        Ok(Self {
            typical: Hand {
                inertia: positive(hand, inertia)?,
                grip_stiffness: positive(hand, "grip_stiffness")?,
                grip_damping: positive(hand, "grip_damping")?,
                arm_stiffness: positive(hand, "arm_stiffness")?,
                arm_damping: positive(hand, "arm_damping")?,
                tightening: not_negative(hand, "tightening")?,
                shakes,
            },
            spread,
            count: up_to(hand, "count", (1, Setting::MOST_HANDS))?,
            seed: hand.required("seed", "1")?.index()? as u64,
        })
    }

    /// All of them.
    pub fn all(&self) -> Vec<Hand> {
        self.typical.population(self.spread, self.count, self.seed)
    }
}

/// What the arm does.
#[derive(Debug, Clone)]
pub struct Reaching {
    /// An approach with peak speed v aims at `-(aim[0] + aim[1] v)` [rad or m].
    pub aim: [f64; 2],
    /// After contact the arm holds with `hold[0] + hold[1] v` [N*m or N] against the wall.
    pub hold: [f64; 2],
    /// How fast, after contact, the arm gives up its aim and takes to holding (s).
    pub relax_s: f64,
    /// How fast one approaches.
    pub approaches: Vec<Approach>,
}

impl Reaching {
    pub(super) const KEYS: [&'static str; 4] = ["aim", "hold", "relax_s", "speeds"];

    pub(super) fn read(approach: &Table<'_>) -> Result<Self, ModelError> {
        let aim = pair(approach, "aim")?;
        if !(aim[0] > 0.0 && aim[1] >= 0.0) {
            let message = format!("`aim` is [{}, {}]: the arm would not aim into the wall", aim[0], aim[1]);
            return Err(approach
                .required("aim", "")?
                .error(message)
                .help("give a positive depth, and what speed adds to it"));
        }
        let read = Self {
            aim,
            hold: pair(approach, "hold")?,
            relax_s: positive(approach, "relax_s")?,
            approaches: approaches(approach)?,
        };
        if let Some(own) = read.approaches.iter().find(|own| read.hold_after(own) < 0.0) {
            let held = read.hold_after(own);
            let message =
                format!("`hold` is {held} after the {} approach: the arm would pull out of the wall", own.name);
            let help = "give numbers from 0: what the arm pushes with, and what speed adds to it";
            return Err(approach.required("hold", "")?.error(message).help(help));
        }
        Ok(read)
    }

    /// What the arm holds against the wall with after an approach [N*m or N].
    pub fn hold_after(&self, approach: &Approach) -> f64 {
        approach.hold.unwrap_or(self.hold[0] + self.hold[1] * approach.peak)
    }
}

/// `posture`: one position per joint, all 0 where it is not given.
pub(super) fn posture(root: &Table<'_>, n_joints: usize) -> Result<Vec<f64>, ModelError> {
    let Some(entry) = root.optional("posture") else { return Ok(vec![0.0; n_joints]) };
    let posture = entry.array()?.iter().map(Entry::finite).collect::<Result<Vec<f64>, _>>()?;
    if posture.len() != n_joints {
        let message = format!("`posture` has {} positions, the device {n_joints} joints", posture.len());
        return Err(entry.error(message).help("give one position per joint"));
    }
    Ok(posture)
}

fn approaches(table: &Table<'_>) -> Result<Vec<Approach>, ModelError> {
    let speeds = table.table("speeds", "{ slow = 0.7 }")?;
    let named = |(name, _): (&str, _)| {
        let peak = within(&speeds, name, (1e-2, 1e3))?;
        Ok(Approach { name: name.to_owned(), peak, hold: None })
    };
    let approaches = speeds.keys().into_iter().map(named).collect::<Result<Vec<Approach>, ModelError>>()?;
    if approaches.is_empty() {
        return Err(speeds.error("there is no speed to approach with").help("give one, e.g. slow = 0.7"));
    }
    Ok(approaches)
}

/// A positive number within what can be simulated.
fn within(table: &Table<'_>, key: &str, (least, most): (f64, f64)) -> Result<f64, ModelError> {
    let value = positive(table, key)?;
    if (least..=most).contains(&value) {
        return Ok(value);
    }
    let entry = table.required(key, "a positive number")?;
    Err(entry.error(format!("`{key}` is {value}")).help(format!("give a number from {least} to {most}")))
}

/// A whole number up to `most`.
fn up_to(table: &Table<'_>, key: &str, (least, most): (usize, usize)) -> Result<usize, ModelError> {
    let entry = table.required(key, "a whole number")?;
    let value = entry.index()?;
    if (least..=most).contains(&value) {
        return Ok(value);
    }
    Err(entry.error(format!("`{key}` is {value}")).help(format!("give a number from {least} to {most}")))
}

pub(super) fn positive(table: &Table<'_>, key: &str) -> Result<f64, ModelError> {
    let entry = table.required(key, "a positive number")?;
    let value = entry.finite()?;
    if value > 0.0 { Ok(value) } else { Err(entry.error(format!("`{key}` is {value}")).help("give a positive number")) }
}

pub(super) fn not_negative(table: &Table<'_>, key: &str) -> Result<f64, ModelError> {
    let entry = table.required(key, "a number from 0")?;
    let value = entry.finite()?;
    if value >= 0.0 { Ok(value) } else { Err(entry.error(format!("`{key}` is {value}")).help("give a number from 0")) }
}

fn pair(table: &Table<'_>, key: &str) -> Result<[f64; 2], ModelError> {
    let entry = table.required(key, "[0.1, 0.08]")?;
    let values = entry.array()?.iter().map(Entry::finite).collect::<Result<Vec<f64>, _>>()?;
    <[f64; 2]>::try_from(values).map_err(|_| {
        entry.error(format!("`{key}` takes two numbers")).help("a constant, and what each rad/s or m/s of speed adds")
    })
}

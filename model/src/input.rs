//! Inputs by name: what was played on a device in a published experiment, as data in `inputs/<device>.toml`.

use std::path::Path;

use crate::{
    device::Device,
    document::{self, Entry, Table},
    error::{ModelError, Source},
};

/// An input of a published experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedInput {
    /// E.g. `table-4.7-configuration-3`.
    pub name: String,
    /// What is known of it beyond the numbers, e.g. that the experimenters left it out of their fit.
    pub note: Option<String>,
    /// Free joints, ascending: a configuration of the device.
    pub free: Vec<usize>,
    /// What the numbers are.
    pub quantity: Quantity,
    /// s
    pub duration_s: f64,
    /// s
    pub sample_s: f64,
    /// One a joint that moves.
    pub joints: Vec<JointInput>,
}

/// What an input commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Torques, open loop [N*m or N].
    Torque,
    /// Positions, which a controller follows [rad or m].
    Position,
}

/// `A(t) cos(omega(t) t + phase)` with `A(t) = amplitude[0] + amplitude[1] t`, `omega(t) = frequency[0] + frequency[1] t`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointInput {
    /// The device's joint index.
    pub joint: usize,
    /// [N*m or rad], and per second.
    pub amplitude: [f64; 2],
    /// [rad/s], and [rad/s^2].
    pub frequency: [f64; 2],
    /// rad
    pub phase: f64,
}

impl JointInput {
    /// Its value at `t` (s).
    pub fn at(&self, t: f64) -> f64 {
        let amplitude = self.amplitude[0] + self.amplitude[1] * t;
        let frequency = self.frequency[0] + self.frequency[1] * t;
        amplitude * (frequency * t + self.phase).cos()
    }
}

impl NamedInput {
    /// The highest frequency that a joint passes through within `duration_s` [rad/s]: the phase `omega(t) t` grows by
    /// `frequency[0] + 2 frequency[1] t`.
    pub fn highest_frequency(&self, duration_s: f64) -> f64 {
        let ends = |joint: &JointInput| {
            joint.frequency[0].abs().max((joint.frequency[0] + 2.0 * joint.frequency[1] * duration_s).abs())
        };
        self.joints.iter().map(ends).fold(0.0, f64::max)
    }

    /// Reads the inputs of a device.
    ///
    /// # Errors
    /// The first thing that is wrong, with its place.
    pub fn parse(text: &str, path: &Path, device: &Device) -> Result<Vec<Self>, ModelError> {
        let source = Source::new(path, text);
        let document = document::parse(&source)?;
        let root = Table::root(&source, &document);
        root.only(&["source", "input"])?;
        root.required("source", "\"where the inputs come from\"")?.text()?;
        let mut inputs: Vec<Self> = Vec::new();
        for table in root.tables("input", "input", 1)? {
            let input = Self::of_table(&table, device)?;
            if inputs.iter().any(|known| known.name == input.name) {
                return Err(table.error(format!("there are two inputs `{}`", input.name)).help("rename one of them"));
            }
            inputs.push(input);
        }
        Ok(inputs)
    }

    fn of_table(table: &Table<'_>, device: &Device) -> Result<Self, ModelError> {
        table.only(&["name", "note", "free", "quantity", "duration_s", "sample_s", "joints"])?;
        let name = table.required("name", "\"table-1\"")?.text()?.to_owned();
        let note = table.optional("note").map(|note| note.text().map(str::to_owned)).transpose()?;
        let free_entry = table.required("free", "[0, 1]")?;
        let mut free = free_entry.array()?.iter().map(Entry::index).collect::<Result<Vec<usize>, _>>()?;
        free.sort_unstable();
        if device.configuration_of(&free).is_none() {
            let message = format!("no configuration of `{}` has the free joints {free:?}", device.id);
            return Err(free_entry.error(message).help("name the free joints of one of the device's configurations"));
        }
        let quantity_entry = table.required("quantity", "\"torque\"")?;
        let quantity = match quantity_entry.text()? {
            "torque" => Quantity::Torque,
            "position" => Quantity::Position,
            other => {
                let message = format!("`quantity` is `{other}`");
                return Err(quantity_entry.error(message).help("write \"torque\" or \"position\""));
            }
        };
        let positive = |key: &str| -> Result<f64, ModelError> {
            let entry = table.required(key, "a time in seconds")?;
            match entry.finite()? {
                value if value > 0.0 => Ok(value),
                value => Err(entry.error(format!("`{key}` is {value}")).help("give a positive time in seconds")),
            }
        };
        let joints_what = "`{ joint = 0, amplitude = [1], frequency = [1], phase = 0 }`";
        let joints = table.tables("joints", "joint", 1)?;
        if joints.is_empty() {
            return Err(table.error("the input moves no joint").help(format!("add `joints` with {joints_what}")));
        }
        let joints = joints
            .iter()
            .map(|own| {
                own.only(&["joint", "amplitude", "frequency", "phase"])?;
                let joint_entry = own.required("joint", "0")?;
                let joint = joint_entry.index()?;
                if !free.contains(&joint) {
                    let message = format!("joint {joint} is not free in this input");
                    return Err(joint_entry.error(message).help("add it to `free`, or leave its input out"));
                }
                let line = |key: &str| -> Result<[f64; 2], ModelError> {
                    let entry = own.required(key, "[at the start, growth per second]")?;
                    let numbers = entry.array()?.iter().map(Entry::finite).collect::<Result<Vec<f64>, _>>()?;
                    match numbers.as_slice() {
                        [start] => Ok([*start, 0.0]),
                        [start, growth] => Ok([*start, *growth]),
                        _ => Err(entry
                            .error(format!("`{key}` has {} numbers", numbers.len()))
                            .help("give its value at the start and, if it changes, its growth per second")),
                    }
                };
                let phase = own.optional("phase").map_or(Ok(0.0), |phase| phase.finite())?;
                Ok(JointInput { joint, amplitude: line("amplitude")?, frequency: line("frequency")?, phase })
            })
            .collect::<Result<_, _>>()?;
        let (duration_s, sample_s) = (positive("duration_s")?, positive("sample_s")?);
        Ok(Self { name, note, free, quantity, duration_s, sample_s, joints })
    }
}

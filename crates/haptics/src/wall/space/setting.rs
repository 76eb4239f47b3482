//! Where a plane is met: device, posture, plane, sampling, hands and approaches, as a file.

use std::path::Path;

use dynid_model::{
    Device, ModelError, Source,
    document::{self, Entry, Table},
};
use nalgebra::DMatrix;

use crate::{
    wall::WallFile, wall::setting::People, wall::setting::Reaching, wall::setting::Sampling,
    wall::setting::not_negative, wall::setting::positive, wall::setting::posture,
};
use dynid_control::{Plane, Wall, WallError};
use dynid_dynamics::{kinematics::Kinematics, kinematics::dot};
use dynid_files::DocumentError;
use dynid_user_model::{Model, device_of};

/// Where a plane is met.
#[derive(Debug, Clone)]
pub struct Setting {
    /// The mechanism.
    pub device: &'static Device,
    /// Joints that are free, ascending; the others are locked.
    pub free: Vec<usize>,
    /// Positions of all joints [rad or m] at the start, where the end point rests outside of the wall.
    pub posture: Vec<f64>,
    /// The wall.
    pub plane: Plane,
    /// Walls are asked as if the plane were a joint's, with its handle at this lever \[m\]; 1 for walls in m and N.
    pub lever: f64,
    /// How the controller is sampled.
    pub sampling: Sampling,
    /// Largest force of the wall \[N\].
    pub force_limit: f64,
    /// The wall's share of what the free joints make is at most this [N*m or N]; what the device is carried with comes on top.
    pub torque_limits: Vec<f64>,
    /// The hands.
    pub people: People,
    /// Stiffness [N*m/rad] and damping [N*m*s/rad] with which the typical hand holds the handle's orientation; of other hands
    /// they are as much firmer as the grip is.
    pub turning: [f64; 2],
    /// What the arm does.
    pub reaching: Reaching,
}

impl Setting {
    /// Smallest singular value of the Jacobian that a hand can work with, over the largest; angles count at the lever.
    const SINGULAR: f64 = 1e-3;

    /// The setting that the program carries.
    ///
    /// # Errors
    /// Never, as tests see to.
    pub fn shipped() -> Result<Self, DocumentError> {
        Ok(Self::parse(super::SETTING, Path::new("space.toml"), None)?)
    }

    /// Reads a setting file, whose plane `model` is to meet; without one, or with that of another device, the device as its
    /// own file has it.
    ///
    /// # Errors
    /// A file that cannot be read, or the first thing that is wrong in it, with its place.
    pub fn load(path: &Path, model: Option<&Model>) -> Result<Self, DocumentError> {
        Ok(Self::parse(&dynid_files::read(path)?, path, model)?)
    }

    /// Reads the text of a setting file, as [`Setting::load`] does; `path` is for messages.
    ///
    /// # Errors
    /// The first thing that is wrong, with its place.
    pub fn parse(text: &str, path: &Path, model: Option<&Model>) -> Result<Self, ModelError> {
        let source = Source::new(path, text);
        let document = document::parse(&source)?;
        let root = Table::root(&source, &document);
        root.only(&["device", "free", "posture", "plane", "controller", "hand", "approach", "simulation"])?;
        let device = device_of(&root)?;
        let n_joints = device.joints.len();
        let free = free(&root, device)?;
        let posture = posture(&root, n_joints)?;
        let table = root.table("plane", "where the wall is")?;
        table.only(&["point", "normal", "lever"])?;
        let plane = plane(&table)?;
        let lever = if table.optional("lever").is_some() { positive(&table, "lever")? } else { 1.0 };
        let controller = root.table("controller", "how the controller is sampled")?;
        controller.only(&[
            "sample_s",
            "delay_samples",
            "position_quantum",
            "force_limit",
            "torque_limits",
            "cutoff_hz",
        ])?;
        let sampling = Sampling::read(&root, &controller)?;
        let hand = root.table("hand", "who moves the handle")?;
        hand.only(&[&["mass", "turning_stiffness", "turning_damping"], &People::KEYS[..]].concat())?;
        let approach = root.table("approach", "how the wall is approached")?;
        approach.only(&Reaching::KEYS)?;
        let setting = Self {
            device,
            posture,
            plane,
            lever,
            sampling,
            force_limit: positive(&controller, "force_limit")?,
            torque_limits: torque_limits(&controller, device, &free)?,
            people: People::read(&hand, "mass", None)?,
            turning: [positive(&hand, "turning_stiffness")?, not_negative(&hand, "turning_damping")?],
            reaching: Reaching::read(&approach)?,
            free,
        };
        let place = root.optional("posture").map_or(table.span.clone(), |entry| entry.span);
        let started = match model.filter(|model| model.device.is_same_as(device)) {
            Some(model) => setting.start(model),
            None => setting.start(&Model::of_device(device)),
        };
        started.map_err(|error| source.error(place, error.to_string()).help("see `dynid wall show space`"))?;
        Ok(setting)
    }

    /// Where the end point of `model` starts.
    ///
    /// # Errors
    /// A device without an end point, or a posture that nothing can start at.
    pub(super) fn start(&self, model: &Model) -> Result<Kinematics, super::super::WallError> {
        let kinematics = model.kinematics(&self.free, &self.posture)?;
        let distance = self.plane.distance(kinematics.position());
        if distance <= 0.0 {
            return Err(super::StartError::Inside { distance }.into());
        }
        let along = |slot: usize| dot(self.plane.normal, [0, 1, 2].map(|row| kinematics.jacobian(row, slot)));
        let reach = (0..self.free.len()).map(|slot| along(slot).abs()).fold(0.0, f64::max);
        let values = scaled_transpose(&kinematics, self.lever).singular_values();
        if reach <= Self::SINGULAR * values.max() {
            return Err(super::StartError::Unreachable.into());
        }
        let ratio = values.min() / values.max();
        if ratio < Self::SINGULAR {
            return Err(super::StartError::Singular { ratio }.into());
        }
        Ok(kinematics)
    }

    /// A wall of a file at work here.
    ///
    /// # Errors
    /// None that a file which was read and a setting which was read could have.
    pub fn wall(&self, file: &WallFile) -> Result<Wall, WallError> {
        file.at_work(self.sampling.sample_s, self.sampling.delay_samples, self.force_limit * self.lever)
    }
}

/// `J^T`, free joints x 6, angles counted at `lever`.
pub(super) fn scaled_transpose(kinematics: &Kinematics, lever: f64) -> DMatrix<f64> {
    DMatrix::from_fn(kinematics.n_free(), 6, |slot, row| {
        kinematics.jacobian(row, slot) * if row < 3 { 1.0 } else { lever }
    })
}

fn free(root: &Table<'_>, device: &Device) -> Result<Vec<usize>, ModelError> {
    let n_joints = device.joints.len();
    let Some(entry) = root.optional("free") else { return Ok((0..n_joints).collect()) };
    let mut free = Vec::new();
    for own in entry.array()? {
        let joint = own.index()?;
        if joint >= n_joints {
            let help = format!("its joints are 0 to {}", n_joints - 1);
            return Err(own.error(format!("device `{}` has no joint {joint}", device.id)).help(help));
        }
        free.push(joint);
    }
    if let Some(pair) = free.windows(2).find(|pair| pair[0] >= pair[1]) {
        let (mut sorted, message) = (free.clone(), format!("`free` names joint {} after joint {}", pair[1], pair[0]));
        sorted.sort_unstable();
        sorted.dedup();
        let help = format!("name every joint once, ascending, as `torque_limits` has them: {sorted:?}");
        return Err(entry.error(message).help(help));
    }
    Ok(free)
}

fn plane(table: &Table<'_>) -> Result<Plane, ModelError> {
    let normal = vector(table, "normal")?;
    let length = dot(normal, normal).sqrt();
    if (length - 1.0).abs() > 1e-3 {
        let entry = table.required("normal", "[0, 0, 1]")?;
        let unit = normal.map(|component| (component / length * 1e4).round() / 1e4);
        let help = if length > 0.0 {
            format!("it points out of the wall; divided by its length it is {unit:?}")
        } else {
            "it points out of the wall, e.g. [0, 0, 1]".to_owned()
        };
        return Err(entry.error(format!("`normal` has length {length:.4}, not 1")).help(help));
    }
    Ok(Plane { point: vector(table, "point")?, normal: normal.map(|component| component / length) })
}

fn vector(table: &Table<'_>, key: &str) -> Result<[f64; 3], ModelError> {
    let entry = table.required(key, "[0, 0, 1]")?;
    let values = entry.array()?.iter().map(Entry::finite).collect::<Result<Vec<f64>, _>>()?;
    <[f64; 3]>::try_from(values).map_err(|values| {
        let message = format!("`{key}` has three components, found {}", values.len());
        entry.error(message).help("give x, y and z in the base frame")
    })
}

/// One number a free joint, or the device's own.
fn torque_limits(controller: &Table<'_>, device: &Device, free: &[usize]) -> Result<Vec<f64>, ModelError> {
    let Some(entry) = controller.optional("torque_limits") else {
        return Ok(free.iter().map(|joint| device.joints[*joint].torque_limit).collect());
    };
    let limits = entry.array()?.iter().map(Entry::number).collect::<Result<Vec<f64>, _>>()?;
    if limits.len() != free.len() {
        let message = format!("`torque_limits` has {} numbers, {} joints are free", limits.len(), free.len());
        return Err(entry.error(message).help("give one number per free joint, `inf` where there is no limit"));
    }
    if let Some(limit) = limits.iter().find(|limit| limit.is_nan() || **limit <= 0.0) {
        return Err(entry.error(format!("`torque_limits` holds {limit}")).help("give positive numbers"));
    }
    Ok(limits)
}

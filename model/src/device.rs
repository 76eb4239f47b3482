//! A mechanism: joints, Denavit-Hartenberg frames, links and the configurations in which it is identified.

use std::path::PathBuf;

use sha2::{Digest, Sha256};

use crate::{Expression, Parameter};

/// A mechanism as its file describes it, checked.
///
/// ```
/// let arm = dynid_model::device("planar2r").expect("a shipped device");
/// assert_eq!(arm.joints.len(), 2);
/// assert_eq!(arm.configuration_of(&[0, 1]).map(|number| arm.configurations[number - 1].free.clone()), Some(vec![0, 1]));
/// ```
#[derive(Debug, Clone)]
pub struct Device {
    /// The file's stem, e.g. `freedom6s`.
    pub id: String,
    /// Where its file lies, for a device that is not one of the library's.
    pub file: Option<PathBuf>,
    /// One line for people.
    pub title: String,
    /// Where the numbers come from.
    pub source: String,
    /// How a row of the frames table is read.
    pub convention: Convention,
    /// Magnitude of gravity [m/s^2].
    pub gravity: f64,
    /// Unit vector that points up, in the base frame; zero without gravity. The potential is `V = gravity * up . sum(m_i p_i)` (thesis
    /// Eq. B.4). Components that are exactly zero never enter the equations; the others stay symbols
    /// `base.gx`, `base.gy`, `base.gz` of value `gravity * up`.
    pub up: [f64; 3],
    /// Length symbols of the frames table.
    pub lengths: Vec<Length>,
    /// Joints `q0..`, in order.
    pub joints: Vec<Joint>,
    /// Parents come before their children.
    pub frames: Vec<Frame>,
    /// The point of the device that a hand or a tool is at, where the file names one.
    pub end_point: Option<EndPoint>,
    /// Links `1..`, in order.
    pub links: Vec<Link>,
    /// Which joints are free together, numbered from 1 in this order. Sets are unique.
    pub configurations: Vec<Configuration>,
    /// Sequences of configurations, e.g. the thesis's Tables 4.2 and 4.6.
    pub methods: Vec<Method>,
    /// Effects that a model of this device starts with.
    pub effects: Vec<DefaultEffect>,
}

/// How a row (theta, d, a, alpha) becomes a transform.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Convention {
    /// `Rz(theta) Tz(d) Tx(a) Rx(alpha)` (thesis Eq. 3.1; Spong & Vidyasagar).
    Standard,
    /// `Rx(alpha) Tx(a) Rz(theta) Tz(d)` (Craig).
    Modified,
}

/// A length symbol and its value \[m\].
#[derive(Debug, Clone, PartialEq)]
pub struct Length {
    /// As it stands in the frames table, e.g. `L5`. Its parameter name is `length.L5`.
    pub symbol: String,
    /// Its value \[m\].
    pub value: f64,
}

/// One joint variable.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Revolute or prismatic: found from where its variable stands in the frames table, or stated.
    pub kind: JointKind,
    /// For people, e.g. `roll`.
    pub title: String,
    /// Range of motion [rad or m].
    pub position_limits: [f64; 2],
    /// Largest speed [rad/s or m/s]; `inf` where unknown.
    pub speed_limit: f64,
    /// Largest torque or force [N*m or N]; `inf` where unknown.
    pub torque_limit: f64,
    /// Unit of the logged command, before the plant gain: `N*m`, `N`, `V`, ...
    pub command_unit: String,
}

/// What a joint variable measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// An angle \[rad\].
    Revolute,
    /// A distance \[m\].
    Prismatic,
}

impl Device {
    /// The joints that move a frame: those whose variable stands in its row or in an ancestor's, ascending.
    pub fn joints_moving(&self, frame: usize) -> Vec<usize> {
        let mut moving = vec![false; self.joints.len()];
        let mut next = Some(frame);
        while let Some(index) = next {
            let frame = &self.frames[index];
            for expression in [&frame.theta, &frame.d, &frame.a, &frame.alpha] {
                expression.for_each_symbol(&mut |symbol| {
                    if let Some(flag) = joint_variable(symbol).and_then(|joint| moving.get_mut(joint)) {
                        *flag = true;
                    }
                });
            }
            next = frame.parent;
        }
        (0..moving.len()).filter(|joint| moving[*joint]).collect()
    }

    /// The last link that a joint moves, from 0: what is mounted on the joint's axis far end.
    pub fn last_link_moved_by(&self, joint: usize) -> Option<usize> {
        (0..self.links.len()).rev().find(|link| self.joints_moving(self.links[*link].frame).contains(&joint))
    }

    /// The number (from 1) of the configuration whose free joints are exactly these, in any order.
    pub fn configuration_of(&self, free: &[usize]) -> Option<usize> {
        let mut sorted = free.to_vec();
        sorted.sort_unstable();
        self.configurations.iter().position(|configuration| configuration.free == sorted).map(|index| index + 1)
    }

    /// Whether both are one mechanism: the same device, or files of one name with the same structure.
    pub fn is_same_as(&self, other: &Device) -> bool {
        std::ptr::eq(self, other) || (self.id == other.id && self.structure_digest() == other.structure_digest())
    }

    /// SHA-256 (hex) of what the equations of motion depend on: convention, which components of `up` vanish, joint
    /// kinds, rows, parents, the frame of each link, configurations. Values, names and texts for people are not in it.
    pub fn structure_digest(&self) -> String {
        use std::fmt::Write;
        let mut text = String::new();
        let up: String = self.up.iter().map(|component| if *component == 0.0 { '0' } else { 'g' }).collect();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "dynid structure 1\nconvention {:?}\nup {up}", self.convention);
        for joint in &self.joints {
            let _ = writeln!(text, "joint {:?}", joint.kind);
        }
        for Frame { parent, theta, d, a, alpha, .. } in &self.frames {
            let parent = parent.map_or("base".to_owned(), |parent| parent.to_string());
            let _ = writeln!(text, "frame {parent}: {theta}; {d}; {a}; {alpha}");
        }
        for link in &self.links {
            let _ = writeln!(text, "link {}", link.frame);
        }
        for configuration in &self.configurations {
            let _ = writeln!(text, "configuration {:?}", configuration.free);
        }
        sha256_hex(text.as_bytes())
    }
}

/// `q12` -> 12; `None` for a symbol that is no joint variable.
pub fn joint_variable(symbol: &str) -> Option<usize> {
    let digits = symbol.strip_prefix('q')?;
    let canonical = digits == "0" || (!digits.starts_with('0') && digits.bytes().all(|byte| byte.is_ascii_digit()));
    if canonical { digits.parse().ok() } else { None }
}

/// SHA-256 in hexadecimal.
pub fn sha256_hex(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// One row of a Denavit-Hartenberg table. Symbols: `q0..` and lengths.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Unique, e.g. `a3`.
    pub name: String,
    /// Index of the parent frame; `None` for the base.
    pub parent: Option<usize>,
    /// Rotation about z \[rad\]: affine in revolute joint variables with integer factors.
    pub theta: Expression,
    /// Translation along z \[m\].
    pub d: Expression,
    /// Translation along x \[m\].
    pub a: Expression,
    /// Rotation about x \[rad\]: affine in revolute joint variables with integer factors.
    pub alpha: Expression,
}

/// The point of a device that a hand or a tool is at. It does not enter the equations of motion.
#[derive(Debug, Clone, PartialEq)]
pub struct EndPoint {
    /// Index into [`Device::frames`] of the frame that it is fixed to.
    pub frame: usize,
    /// Where it lies in that frame \[m\].
    pub point: [f64; 3],
}

/// A rigid body. The ten inertial parameters are its mass \[kg\], centroid \[m\] and inertia about the centroid
/// [kg m^2], in the axes of its frame: `m x y z Ixx Ixy Ixz Iyy Iyz Izz` ([`Link::SYMBOLS`]). The inertia matrix is
/// `[[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz], [Ixz, Iyz, Izz]]`: its products are entries of the matrix (thesis
/// Appendix C), not the negated integrals' absolute values.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Index into [`Device::frames`] of the frame that the link is fixed to.
    pub frame: usize,
    /// For people.
    pub title: String,
    /// In the order of [`Link::SYMBOLS`].
    pub inertial: [Parameter; 10],
}

impl Link {
    /// Symbols of the inertial parameters, in order; parameter names are `link.<number>.<symbol>`.
    pub const SYMBOLS: [&'static str; 10] = dynid_signal_chain::LINK_SYMBOLS;

    /// The values, without bounds.
    pub fn values(&self) -> [f64; 10] {
        self.inertial.map(|parameter| parameter.value)
    }
}

/// Which joints are free; all others are locked at angles that stay general.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Configuration {
    /// Ascending joint indices.
    pub free: Vec<usize>,
}

/// A named sequence of configurations in which the device is identified.
#[derive(Debug, Clone, PartialEq)]
pub struct Method {
    /// E.g. `isolated`, `coupling`.
    pub name: String,
    /// Configuration numbers (from 1), in order. Step `k` of a method is `sequence[k - 1]`.
    pub sequence: Vec<usize>,
    /// Weight of each free joint's error, per step (thesis Table 4.6); empty where all are 1.
    pub weights: Vec<Vec<f64>>,
}

/// An effect at its place, as a device's default model or a user's model lists it.
#[derive(Debug, Clone, PartialEq)]
pub struct DefaultEffect {
    /// Id of an [`crate::Effect`].
    pub id: String,
    /// The joint it acts on; `None` for an effect of the whole device.
    pub joint: Option<usize>,
    /// The other joint of a pair.
    pub from: Option<usize>,
    /// It acts only in runs that carry the payload of this name.
    pub payload: Option<String>,
    /// Values given by symbol; others take the effect's initial ones.
    pub values: Vec<(String, Parameter)>,
}

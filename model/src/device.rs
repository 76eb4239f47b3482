//! A mechanism: joints, Denavit-Hartenberg frames, links and the configurations in which it is identified.

use crate::{Expression, Parameter};

/// A mechanism as its file describes it, checked.
#[derive(Debug, Clone)]
pub struct Device {
    /// The file's stem, e.g. `freedom6s`.
    pub id: String,
    /// One line for people.
    pub title: String,
    /// Where the numbers come from.
    pub source: String,
    /// How a row of the frames table is read.
    pub convention: Convention,
    /// Magnitude of gravity [m/s^2].
    pub gravity: f64,
    /// Unit vector that points up, in the base frame. The potential is `V = gravity * up . sum(m_i p_i)` (thesis
    /// Eq. B.4). Components that are exactly zero never enter the equations; the others stay symbols
    /// `base.gx`, `base.gy`, `base.gz` of value `gravity * up`.
    pub up: [f64; 3],
    /// Length symbols of the frames table.
    pub lengths: Vec<Length>,
    /// Joints `q0..`, in order.
    pub joints: Vec<Joint>,
    /// Parents come before their children.
    pub frames: Vec<Frame>,
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

/// A length symbol and its value [m].
#[derive(Debug, Clone, PartialEq)]
pub struct Length {
    /// As it stands in the frames table, e.g. `L5`. Its parameter name is `length.L5`.
    pub symbol: String,
    /// Its value [m].
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
}

/// What a joint variable measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// An angle [rad].
    Revolute,
    /// A distance [m].
    Prismatic,
}

/// One row of a Denavit-Hartenberg table. Symbols: `q0..` and lengths.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Unique, e.g. `a3`.
    pub name: String,
    /// Index of the parent frame; `None` for the base.
    pub parent: Option<usize>,
    /// Rotation about z [rad]: affine in revolute joint variables with integer factors.
    pub theta: Expression,
    /// Translation along z [m].
    pub d: Expression,
    /// Translation along x [m].
    pub a: Expression,
    /// Rotation about x [rad]: affine in revolute joint variables with integer factors.
    pub alpha: Expression,
}

/// A rigid body. The ten inertial parameters are its mass [kg], centroid [m] and inertia about the centroid
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
    pub const SYMBOLS: [&'static str; 10] = ["m", "x", "y", "z", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"];
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

/// An effect of a device's default model.
#[derive(Debug, Clone, PartialEq)]
pub struct DefaultEffect {
    /// Id of an [`crate::Effect`].
    pub id: String,
    /// The joint it acts on; `None` for an effect of the whole device.
    pub joint: Option<usize>,
    /// The other joint of a pair.
    pub from: Option<usize>,
    /// Values given by symbol; others take the effect's initial ones.
    pub values: Vec<(String, Parameter)>,
}

//! A device file before it is text.

use std::collections::BTreeSet;

use crate::{number::Number, pose::Turned, urdf::Kind};

#[derive(Debug)]
pub(crate) struct Draft {
    pub title: String,
    /// The acceleration of free fall in base axes \[m/s^2\].
    pub gravity: [f64; 3],
    /// Where the numbers come from.
    pub source: String,
    pub frames: Vec<Frame>,
    pub joints: Vec<Joint>,
    pub links: Vec<Link>,
    pub end_point: EndPoint,
    pub effects: Vec<Effect>,
    pub notes: Vec<String>,
}

#[derive(Debug)]
pub(crate) struct Frame {
    pub name: String,
    pub parent: Option<usize>,
    pub xyz: [Number; 3],
    pub turned: Turned,
    pub axis: [Number; 3],
    pub is_angle: bool,
    /// The joint variable that moves it, and how: `-q2 + pi/2`.
    pub joint: usize,
    pub motion: String,
}

#[derive(Debug)]
pub(crate) struct Joint {
    pub title: String,
    pub kind: Kind,
    pub position: [Number; 2],
    pub speed: Number,
    pub torque: Number,
}

#[derive(Debug)]
pub(crate) struct Link {
    pub title: String,
    pub frame: usize,
    /// In the order of [`dynid_model::Link::SYMBOLS`].
    pub inertial: [Number; 10],
    /// What stands above it in the file.
    pub remark: Option<String>,
}

#[derive(Debug)]
pub(crate) struct EndPoint {
    pub frame: usize,
    pub point: [Number; 3],
    /// The link of the description that it is.
    pub name: String,
}

#[derive(Debug)]
pub(crate) struct Effect {
    pub id: &'static str,
    pub joint: usize,
    pub symbol: &'static str,
    pub value: Number,
}

impl Draft {
    /// Whether the joints stand one after another: each frame is moved by the first joint, the second, .. up to one of them.
    pub fn is_chain(&self) -> bool {
        let mut moved_by: Vec<BTreeSet<usize>> = Vec::new();
        for frame in &self.frames {
            let mut joints = frame.parent.map_or(BTreeSet::new(), |parent| moved_by[parent].clone());
            joints.insert(frame.joint);
            moved_by.push(joints);
        }
        moved_by.iter().all(|joints| joints.iter().copied().eq(0..joints.len()))
    }
}

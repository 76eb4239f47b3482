//! What the coupling of the joints does to a hand at a plane.

use serde::Serialize;

use super::{Contact, Setting, contact::turned_by};
use crate::{
    control::Wall,
    kinematics::{Vector, dot, plus},
    wall::{FROM_S, Measures, SETTLED_S, TO_S},
};

/// What the coupling of the joints does to a hand at a plane. "Settled" is the mean of the last [`SETTLED_S`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coupling {
    /// How far the end point came along the wall at most, from where it met it \[m\].
    pub slip: f64,
    /// How far along the wall it settled from there \[m\].
    pub settled_slip: f64,
    /// By how much the handle had turned when it settled \[rad\].
    pub turned: f64,
    /// By how much each free joint had moved when it settled [rad or m].
    pub moved: Vec<f64>,
    /// Largest torque of the wall at each free joint [N*m or N].
    pub torque: Vec<f64>,
    /// Share of the time from [`FROM_S`] to [`TO_S`] after the contact in which a joint's limit shortened the force.
    pub limited: f64,
}

impl Contact {
    /// How still and how solid the wall felt along its normal [m, N].
    pub fn measures(&self, wall: &Wall, lever: f64) -> Option<Measures> {
        Measures::along(&self.along, |distance| wall.static_torque(distance / lever) / lever, |tick| self.given(tick))
    }

    /// What happened beside; `None` where the wall was never met.
    pub fn coupling(&self, setting: &Setting) -> Option<Coupling> {
        let touched = self.along.touched?;
        let n_ticks = self.q.len();
        let rate_hz = 1.0 / self.along.sample_s;
        let met = self.point[touched];
        let settled = n_ticks - ((SETTLED_S * rate_hz).round() as usize).clamp(1, n_ticks);
        let count = (n_ticks - settled) as f64;
        let mean = |value: &dyn Fn(usize) -> f64| (settled..n_ticks).map(value).sum::<f64>() / count;
        let ways: Vec<Vector> =
            self.point.iter().map(|point| along_the_wall(plus(*point, -1.0, met), setting.plane.normal)).collect();
        let end = [0, 1, 2].map(|k| mean(&|tick| ways[tick][k]));
        let axes = [0, 1, 2].map(|k| mean(&|tick| turned_by(&self.rotation[touched], &self.rotation[tick])[k]));
        let n_free = self.q[touched].len();
        let moved = (0..n_free).map(|slot| mean(&|tick| self.q[tick][slot]) - self.q[touched][slot]);
        let torque =
            (0..n_free).map(|slot| self.torque[touched..].iter().map(|torque| torque[slot].abs()).fold(0.0, f64::max));
        let tick = |after_s: f64| (touched + (after_s * rate_hz).round() as usize).min(n_ticks);
        let counted = &self.share[tick(FROM_S)..tick(TO_S)];
        Some(Coupling {
            slip: ways[touched..].iter().map(|way| dot(*way, *way).sqrt()).fold(0.0, f64::max),
            settled_slip: dot(end, end).sqrt(),
            turned: dot(axes, axes).sqrt().min(1.0).asin(),
            moved: moved.collect(),
            torque: torque.collect(),
            limited: counted.iter().filter(|share| **share < 1.0).count() as f64 / counted.len().max(1) as f64,
        })
    }
}

/// A way without its part along the normal.
fn along_the_wall(way: Vector, normal: Vector) -> Vector {
    plus(way, -dot(way, normal), normal)
}

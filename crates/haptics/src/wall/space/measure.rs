//! What the coupling of the joints does to a hand at a plane.

use serde::Serialize;

use super::{
    Contact, Setting,
    contact::{cosine_of_turn, turned_by},
};
use crate::{wall::FROM_S, wall::Measures, wall::SETTLED_S, wall::TO_S};
use dynid_control::Wall;
use dynid_dynamics::{kinematics::Vector, kinematics::dot, kinematics::plus};

/// What the coupling of the joints does to a hand at a plane. "Settled" is the mean of the last [`SETTLED_S`]; what moved since
/// the wall was met is counted from [`Contact::met`].
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
        Measures::along(&self.along, wall, lever, |tick| self.given(tick))
    }

    /// What happened beside; `None` where the wall was never met.
    pub fn coupling(&self, setting: &Setting) -> Option<Coupling> {
        let touched = self.along.touched?;
        let n_ticks = self.q.len();
        let rate_hz = 1.0 / self.along.sample_s;
        let met = self.met()?;
        let settled = n_ticks - ((SETTLED_S * rate_hz).round() as usize).clamp(1, n_ticks);
        let count = (n_ticks - settled) as f64;
        let mean = |value: &dyn Fn(usize) -> f64| (settled..n_ticks).map(value).sum::<f64>() / count;
        let ways: Vec<Vector> = self
            .point
            .iter()
            .map(|point| along_the_wall(plus(*point, -1.0, met.point), setting.plane.normal))
            .collect();
        let end = [0, 1, 2].map(|k| mean(&|tick| ways[tick][k]));
        let sine = [0, 1, 2].map(|k| mean(&|tick| turned_by(&met.rotation, &self.rotation[tick])[k]));
        let cosine = mean(&|tick| cosine_of_turn(&met.rotation, &self.rotation[tick]));
        let n_free = met.q.len();
        let moved = (0..n_free).map(|slot| mean(&|tick| self.q[tick][slot]) - met.q[slot]);
        let torque =
            (0..n_free).map(|slot| self.torque[touched..].iter().map(|torque| torque[slot].abs()).fold(0.0, f64::max));
        let tick = |after_s: f64| (touched + (after_s * rate_hz).round() as usize).min(n_ticks);
        let counted = &self.share[tick(FROM_S)..tick(TO_S)];
        Some(Coupling {
            slip: ways[touched..].iter().map(|way| dot(*way, *way).sqrt()).fold(0.0, f64::max),
            settled_slip: dot(end, end).sqrt(),
            turned: dot(sine, sine).sqrt().atan2(cosine),
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

#[cfg(test)]
mod tests {
    use super::*;

    /// An end point that comes at 0.8 m/s along the normal and goes on along the wall while the handle turns; its joints are
    /// made up: the first one is the depth.
    fn moved(angle: impl Fn(f64) -> f64) -> (Setting, Contact) {
        let setting = Setting::shipped().expect("shipped");
        let (normal, point) = (setting.plane.normal, setting.plane.point);
        // at right angles to the normal
        let aside = [0.8, 0.36, -0.48];
        assert!(dot(normal, aside).abs() < 1e-12);
        let aside = aside.map(|own| own / dot(aside, aside).sqrt());
        let mut reported = Contact::begun(0.01);
        for tick in 0..300 {
            // the plane is passed at 0.0975 s, three quarters of the way from a tick to the next
            let t = f64::from(tick) * 0.01 - 0.0975;
            let distance = (-0.8 * t).max(-0.01);
            let way = (0.4 * t).min(0.02);
            let (sine, cosine) = angle(t).sin_cos();
            reported.along.position.push(distance);
            reported.along.velocity.push(0.0);
            reported.along.torque.push(0.0);
            reported.point.push(plus(plus(point, distance, normal), way, aside));
            reported.rotation.push([cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0]);
            reported.q.push(vec![distance, way]);
            reported.dq.push(vec![0.0; 2]);
            reported.torque.push(vec![0.0; 2]);
            reported.share.push(1.0);
            reported.hand_work.push(0.0);
        }
        reported.along.touched = reported.along.position.iter().position(|distance| *distance < 0.0);
        (setting, reported)
    }

    /// At a coarse rate the first tick inside is far along already: slip, turn and ways of the joints start where the plane
    /// was passed.
    #[test]
    fn what_moved_is_counted_from_where_the_plane_was_passed() {
        let (setting, reported) = moved(|t| (0.5 * t).min(0.1));
        assert_eq!(reported.along.touched, Some(10));
        let met = reported.met().expect("it was met");
        assert!(setting.plane.distance(met.point).abs() < 1e-15 && met.q[0].abs() < 1e-15);
        let coupling = reported.coupling(&setting).expect("it was met");
        assert!((coupling.slip - 0.02).abs() < 1e-12 && (coupling.settled_slip - 0.02).abs() < 1e-12, "{coupling:?}");
        assert!((coupling.moved[0] + 0.01).abs() < 1e-12 && (coupling.moved[1] - 0.02).abs() < 1e-12, "{coupling:?}");
        assert!((coupling.turned - 0.1).abs() < 1e-6, "{}", coupling.turned);
    }

    #[test]
    fn a_turn_beyond_a_right_angle_is_reported_as_it_is() {
        for angle in [0.3, 1.5, 1.7, 2.5, 3.1] {
            let (setting, reported) = moved(|t| if t < 0.05 { 0.0 } else { angle });
            let turned = reported.coupling(&setting).expect("it was met").turned;
            assert!((turned - angle).abs() < 1e-9, "{turned} for {angle}");
        }
    }
}

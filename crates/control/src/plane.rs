//! A wall that is a plane in space, felt at the end point of the whole device.
//!
//! The depth is `n . (x(q) - p)` and its rate `n . J dq`; a wall of one dimension ([`Wall`]) makes the force `F` of them, and
//! the joints make it together: `tau = J^T n F`. Commands follow by the inverse of the model's drive path.
//!
//! Joints that cannot make their torques make less of all of them: a force that is cut at single joints would point
//! elsewhere, and push along the wall.

use super::Wall;
use dynid_dynamics::{kinematics::Kinematics, kinematics::dot, kinematics::plus, system::InverseError, system::System};

/// A plane in the base frame; the wall is on the side that the normal points away from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// A point of it \[m\].
    pub point: [f64; 3],
    /// Unit vector out of the wall.
    pub normal: [f64; 3],
}

impl Plane {
    /// How far a point is outside \[m\]; negative inside of the wall.
    pub fn distance(&self, point: [f64; 3]) -> f64 {
        dot(self.normal, plus(point, -1.0, self.point))
    }
}

/// A plane at work.
#[derive(Debug, Clone)]
pub struct PlaneWall {
    plane: Plane,
    wall: Wall,
    lever: f64,
    kinematics: Kinematics,
    /// Slope and offset of each free joint's sensor.
    sensors: Vec<(f64, f64)>,
    /// Commands per torque, n_free x n_free.
    inverse_drive: Vec<f64>,
    free: Vec<usize>,
    limits: Vec<f64>,
    q: Vec<f64>,
    dq: Vec<f64>,
    torque: Vec<f64>,
    command: Vec<f64>,
    force: f64,
    share: f64,
}

/// Why no plane can be felt.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlaneError {
    /// A normal that is no unit vector.
    #[error("the plane's normal has length {length}: give a unit vector (divide its components by that)")]
    Normal {
        /// Its length.
        length: f64,
    },
    /// A number that must be positive.
    #[error("the {what} is {value}: give a positive number")]
    NotPositive {
        /// Which.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A vector of the wrong length.
    #[error("{found} torque limits given, the system has {expected} free joints; give one each")]
    Limits {
        /// How many came.
        found: usize,
        /// How many are needed.
        expected: usize,
    },
    /// Kinematics of something else.
    #[error(
        "the kinematics are of the joints {found:?} of `{device}`, the system is of {expected:?}; make both of one model and one set of free joints"
    )]
    OtherJoints {
        /// The kinematics' device.
        device: &'static str,
        /// Their free joints.
        found: Vec<usize>,
        /// The system's.
        expected: Vec<usize>,
    },
    /// Drives or sensors that cannot be inverted.
    #[error(transparent)]
    Inverse(#[from] InverseError),
}

impl PlaneWall {
    /// Feels `plane` through `wall`, at the end point that `kinematics` follow. `wall` is asked with depths over `lever`
    /// \[m\], and what it answers is a torque at that lever: 1 m for a wall in m and N, the handle's lever for a wall that was
    /// made for a joint. `limits` are the largest torques [N*m or N] of the free joints, `inf` where there are none.
    ///
    /// # Errors
    /// A normal, lever or limit that is none; a drive path or sensor that cannot be inverted.
    pub fn new(
        system: &System,
        kinematics: Kinematics,
        plane: Plane,
        (wall, lever): (Wall, f64),
        limits: &[f64],
    ) -> Result<Self, PlaneError> {
        let length = dot(plane.normal, plane.normal).sqrt();
        if length.is_nan() || (length - 1.0).abs() > 1e-6 {
            return Err(PlaneError::Normal { length });
        }
        let (n, expected) = (system.n_free(), system.kernel().free);
        if kinematics.device() != system.kernel().device || kinematics.free() != expected {
            let (device, found) = (kinematics.device(), kinematics.free().to_vec());
            return Err(PlaneError::OtherJoints { device, found, expected: expected.to_vec() });
        }
        if limits.len() != n {
            return Err(PlaneError::Limits { found: limits.len(), expected: n });
        }
        let positive = limits.iter().map(|limit| ("torque limit", *limit)).chain([("lever", lever)]);
        for (what, value) in positive {
            if value.is_nan() || value <= 0.0 {
                return Err(PlaneError::NotPositive { what, value });
            }
        }
        let inverse_drive = system.inverse_drive()?;
        let sensors = system.sensor_map()?;
        Ok(Self {
            plane,
            wall,
            lever,
            kinematics,
            sensors,
            inverse_drive,
            free: system.kernel().free.to_vec(),
            limits: limits.to_vec(),
            q: vec![0.0; n],
            dq: vec![0.0; n],
            torque: vec![0.0; n],
            command: vec![0.0; system.n_joints()],
            force: 0.0,
            share: 1.0,
        })
    }

    /// The commands of all joints of the device (0 for those that are not free) until the next tick, at positions `q` and
    /// speeds `dq` of the free joints as their sensors show them. What is no number is answered with nothing.
    pub fn tick(&mut self, q: &[f64], dq: &[f64]) -> &[f64] {
        self.command.fill(0.0);
        self.torque.fill(0.0);
        (self.force, self.share) = (0.0, 1.0);
        let n = self.sensors.len();
        let known = [q, dq].iter().all(|own| own.len() == n && own.iter().all(|value| value.is_finite()));
        if known {
            self.feel(q, dq);
        } else {
            // The wall has to know that time goes on: what it answered before acts meanwhile.
            self.wall.tick(f64::NAN, f64::NAN);
        }
        &self.command
    }

    /// Force along the normal that the last tick asked for \[N\], as the joints' limits let it pass.
    pub fn force(&self) -> f64 {
        self.force
    }

    /// Torques at the free joints that the last tick asked for [N*m or N].
    pub fn torques(&self) -> &[f64] {
        &self.torque
    }

    /// The share of the wall's force that the limits of the joints let pass at the last tick: 1 where none was reached.
    pub fn share(&self) -> f64 {
        self.share
    }

    /// The wall along the normal.
    pub fn wall(&self) -> &Wall {
        &self.wall
    }

    fn feel(&mut self, q: &[f64], dq: &[f64]) {
        for (slot, &(slope, offset)) in self.sensors.iter().enumerate() {
            self.q[slot] = slope * q[slot] + offset;
            self.dq[slot] = slope * dq[slot];
        }
        self.kinematics.move_to(&self.q);
        let normal = self.plane.normal;
        let distance = self.plane.distance(self.kinematics.position());
        let rate = dot(normal, self.kinematics.velocity(&self.dq)[0]);
        let force = self.wall.tick(distance / self.lever, rate / self.lever) / self.lever;
        self.kinematics.torques(normal.map(|component| component * force), [0.0; 3], &mut self.torque);
        let asked = self.torque.iter().zip(&self.limits).map(|(torque, limit)| torque.abs() / limit);
        let most = asked.fold(1.0, f64::max);
        let n = self.torque.len();
        self.torque.iter_mut().for_each(|torque| *torque /= most);
        (self.force, self.share) = (force / most, 1.0 / most);
        for (slot, &joint) in self.free.iter().enumerate() {
            let row = &self.inverse_drive[slot * n..(slot + 1) * n];
            self.command[joint] = row.iter().zip(&self.torque).map(|(per_torque, torque)| per_torque * torque).sum();
        }
        if !self.command.iter().all(|command| command.is_finite()) {
            self.command.fill(0.0);
            self.torque.fill(0.0);
            (self.force, self.share) = (0.0, 1.0);
        }
        self.wall.delivered(self.force * self.lever);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Law, LinearLaw};
    use dynid_dynamics::system::fixtures::{GAIN, INPUT_COUPLING, placed};

    const POSTURE: [f64; 6] = [0.2, -0.3, 0.4, 0.1, -0.5, 0.6];
    const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];

    fn normal() -> [f64; 3] {
        [2.0 / 7.0, -3.0 / 7.0, 6.0 / 7.0]
    }

    fn at_work(lever: f64, limits: &[f64]) -> Result<PlaneWall, PlaneError> {
        at_work_on(&freedom(&[]), lever, limits)
    }

    fn at_work_on(system: &System, lever: f64, limits: &[f64]) -> Result<PlaneWall, PlaneError> {
        let kinematics = arm(&ALL);
        // 1 mm inside
        let plane = Plane { point: plus(kinematics.position(), 1e-3, normal()), normal: normal() };
        let law = Law::Linear(LinearLaw { k1: 1000.0, k2: 10.0, offset: 0.0 });
        let wall = Wall::new(law, 1.0, 1e-3, 1e9).expect("a wall");
        PlaneWall::new(system, kinematics, plane, (wall, lever), limits)
    }

    /// The device with a gain at each joint and input couplings `(joint, from)`. Its links do not matter here.
    fn freedom(couplings: &[(usize, usize)]) -> System {
        let mut kernels = dynid_generated::kernels().iter();
        let kernel =
            kernels.find(|kernel| kernel.device == "freedom6s" && kernel.free == ALL).expect("a configuration");
        let gains = ALL.map(|joint| placed(&GAIN, joint, None, &[0.8 + 0.1 * joint as f64]));
        let couplings = couplings.iter().map(|&(joint, from)| placed(&INPUT_COUPLING, joint, Some(from), &[-0.2]));
        let effects: Vec<_> = gains.into_iter().chain(couplings).collect();
        let links = vec![0.1; kernel.parameters.len()];
        System::new(kernel, ALL.len(), links, Vec::new(), &effects).expect("a system")
    }

    fn arm(free: &[usize]) -> Kinematics {
        let lengths = &dynid_model::device("freedom6s").expect("a shipped device").lengths;
        let value = |name: &str| {
            let own = lengths.iter().find(|length| name.strip_prefix("length.") == Some(&length.symbol))?;
            Some(own.value)
        };
        let end_point = dynid_generated::end_point("freedom6s").expect("an end point");
        Kinematics::new(end_point, free, &POSTURE, value).expect("a posture")
    }

    /// The force that torques at the joints make: `f` with `J^T f = tau`, from the three joints that move the point.
    fn force_of(torques: &[f64]) -> [f64; 3] {
        let arm = arm(&ALL);
        let transposed = nalgebra::Matrix3::from_fn(|slot, row| arm.jacobian(row, slot));
        let solved = transposed.try_inverse().expect("no singular posture")
            * nalgebra::Vector3::from_column_slice(&torques[..3]);
        solved.into()
    }

    #[test]
    fn the_force_is_along_the_normal_and_as_large_as_the_law_says() {
        let mut wall = at_work(1.0, &[f64::INFINITY; 6]).expect("a plane");
        wall.tick(&POSTURE, &[0.0; 6]);
        // 1000 N/m, 1 mm
        assert!((wall.force() - 1.0).abs() < 1e-12 && wall.share() == 1.0, "{}", wall.force());
        let force = force_of(wall.torques());
        assert!((0..3).all(|k| (force[k] - normal()[k]).abs() < 1e-12), "{force:?}");
        assert!(wall.torques()[3..].iter().all(|torque| torque.abs() < 1e-15), "the wrist turns about the point");
        // the rate: 10 N s/m against the point's own velocity
        let dq = [0.3, 0.2, -0.4, 1.0, 1.0, 1.0];
        let arm = arm(&ALL);
        wall.tick(&POSTURE, &dq);
        let expected = 1.0 - 10.0 * dot(normal(), arm.velocity(&dq)[0]);
        assert!((wall.force() - expected).abs() < 1e-12, "{} for {expected}", wall.force());
        // a wall of a joint with the handle at a lever: the same spring at that lever
        let mut wall = at_work(0.5, &[f64::INFINITY; 6]).expect("a plane");
        wall.tick(&POSTURE, &[0.0; 6]);
        assert!((wall.force() - 4.0).abs() < 1e-12, "{}", wall.force());
    }

    #[test]
    fn limits_shorten_the_force_and_do_not_turn_it() {
        let mut free = at_work(1.0, &[f64::INFINITY; 6]).expect("a plane");
        free.tick(&POSTURE, &[0.0; 6]);
        let largest = free.torques().iter().fold(0.0_f64, |most, torque| most.max(torque.abs()));
        let limits = [0.25 * largest; 6];
        let mut held = at_work(1.0, &limits).expect("a plane");
        held.tick(&POSTURE, &[0.0; 6]);
        assert!((held.share() - 0.25).abs() < 1e-12 && (held.force() - 0.25).abs() < 1e-12, "{}", held.share());
        let force = force_of(held.torques());
        assert!((0..3).all(|k| (force[k] - 0.25 * normal()[k]).abs() < 1e-12), "{force:?}");
        assert!(held.torques().iter().all(|torque| torque.abs() <= limits[0] * (1.0 + 1e-15)));
    }

    /// Joint 1 swings 0.03 rad to and fro.
    fn swing(tick: i32) -> [f64; 6] {
        let mut q = POSTURE;
        q[1] += 0.03 * (f64::from(tick) * 0.02).sin();
        q
    }

    /// The observer books the forces that the joints' limits let pass, when they act; what is no reading passes time, too, as
    /// it does for a wall alone.
    #[test]
    fn the_observer_books_what_the_joints_make() {
        for (delay, limit, missing) in [(0, 2e-3, 0), (1, 2e-3, 0), (2, 2e-3, 0), (0, f64::INFINITY, 7), (2, 2e-3, 7)] {
            let lever = 0.4;
            let mut felt = at_work(lever, &[limit; 6]).expect("a plane");
            felt.wall = felt.wall.passive(delay);
            let mut alone = felt.wall.clone();
            let mut arm = arm(&ALL);
            let mut forces = std::collections::VecDeque::from(vec![0.0; delay]);
            let (mut taken, mut last, mut most, mut shortened) = (0.0_f64, None, 0.0_f64, false);
            for tick in 0..700 {
                let q = swing(tick);
                arm.move_to(&q);
                let distance = felt.plane.distance(arm.position());
                if let (Some(last), Some(force)) = (last, forces.front().filter(|_| forces.len() > delay)) {
                    taken -= force * (distance - last);
                    forces.pop_front();
                }
                if missing > 0 && tick % missing == 3 {
                    felt.tick(&[f64::NAN; 6], &[0.0; 6]);
                    alone.tick(f64::NAN, 0.0);
                } else {
                    felt.tick(&q, &[0.0; 6]);
                    alone.tick(distance / lever, 0.0);
                    alone.delivered(felt.force() * lever);
                }
                let observed = felt.wall().observed_energy().expect("it is watched");
                if missing == 0 {
                    // Outside what was taken is forgotten.
                    if distance >= 0.0 && forces.iter().all(|force| *force == 0.0) {
                        taken = taken.min(0.0);
                    }
                    assert!((observed - taken).abs() < 1e-14, "{delay} late, tick {tick}: {observed} for {taken}");
                }
                assert_eq!(Some(observed), alone.observed_energy(), "{delay} late, tick {tick}");
                most = most.max(observed);
                shortened |= felt.share() < 1.0;
                forces.push_back(felt.force());
                last = Some(distance);
            }
            assert!(most > 1e-6 && shortened == limit.is_finite(), "{most}");
        }
    }

    /// Commands that are no numbers are not given, and what was not given is not booked.
    #[test]
    fn a_force_that_is_not_given_is_not_booked() {
        let mut felt = at_work(1.0, &[1e-3; 6]).expect("a plane");
        felt.wall = felt.wall.passive(0);
        felt.inverse_drive.fill(f64::INFINITY);
        felt.tick(&swing(0), &[0.0; 6]);
        assert_eq!((felt.force(), felt.share()), (0.0, 1.0));
        assert!(felt.tick(&swing(40), &[0.0; 6]).iter().all(|command| *command == 0.0));
        assert!(felt.torques().iter().all(|torque| *torque == 0.0));
        assert_eq!(felt.wall().observed_energy(), Some(0.0));
    }

    /// What reaches the joints behind gains and couplings is what the wall asked for.
    #[test]
    fn commands_make_the_torques_through_the_drive_path() {
        let system = freedom(&[(4, 5), (1, 2)]);
        let mut wall = at_work_on(&system, 1.0, &[f64::INFINITY; 6]).expect("a plane");
        let command = wall.tick(&POSTURE, &[0.0; 6]).to_vec();
        let (mut scratch, x) = (system.scratch(), system.rest(&POSTURE));
        system.drive(&mut scratch, 0.0, &x, &command, &mut vec![0.0; x.len()]);
        for (drive, torque) in scratch.drive.iter().zip(wall.torques()) {
            assert!((drive - torque).abs() < 1e-14, "{drive} for {torque}");
        }
    }

    #[test]
    fn what_is_no_plane_is_reported() {
        let system = freedom(&[]);
        let law = Law::Linear(LinearLaw { k1: 1.0, k2: 0.0, offset: 0.0 });
        let wall = Wall::new(law, 1.0, 1e-3, 1.0).expect("a wall");
        let try_with = |normal: [f64; 3], lever: f64, limits: &[f64]| {
            let kinematics = arm(&ALL);
            PlaneWall::new(&system, kinematics, Plane { point: [0.0; 3], normal }, (wall.clone(), lever), limits)
        };
        let limits = [1.0; 6];
        assert!(try_with([0.0, 0.0, 1.0], 1.0, &limits).is_ok());
        assert!(matches!(try_with([0.0, 0.0, 2.0], 1.0, &limits), Err(PlaneError::Normal { .. })));
        assert!(matches!(try_with([0.0, 0.0, f64::NAN], 1.0, &limits), Err(PlaneError::Normal { .. })));
        assert!(matches!(try_with([0.0, 0.0, 1.0], 0.0, &limits), Err(PlaneError::NotPositive { .. })));
        assert!(matches!(try_with([0.0, 0.0, 1.0], 1.0, &limits[1..]), Err(PlaneError::Limits { .. })));
        let kinematics = arm(&ALL[1..]);
        let plane = Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
        let other = PlaneWall::new(&system, kinematics, plane, (wall.clone(), 1.0), &limits);
        assert!(matches!(other, Err(PlaneError::OtherJoints { .. })));
    }
}

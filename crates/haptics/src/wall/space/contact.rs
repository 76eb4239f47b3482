//! One approach to a plane: the whole device and the hand between the controller's ticks, the wall at them.

use nalgebra::DVector;

use super::{Setting, setting::scaled_transpose};
use crate::{
    wall, wall::Approach, wall::Hand, wall::WallError, wall::encounter::Encounter, wall::encounter::Held,
    wall::hand::Plan, wall::hand::Wanted, wall::setting::Sampling,
};
use dynid_control::{Compensation, CompensationRatios, Estimator, FilteredVelocity, PlaneWall, Wall};
use dynid_dynamics::{kinematics::Kinematics, kinematics::Vector, kinematics::dot, kinematics::plus, system::System};
use dynid_user_model::Model;

/// Poles of the acceleration that the inertia is carried by (Hz).
const BANDWIDTH_HZ: f64 = 20.0;

/// What happened, tick by tick. Vectors stand in base axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Contact {
    /// Along the normal: distance from the plane \[m\], its rate \[m/s\], and the wall's force \[N\].
    pub along: wall::Contact,
    /// Where the end point was \[m\].
    pub point: Vec<Vector>,
    /// The handle's axes as columns, row-major.
    pub rotation: Vec<[f64; 9]>,
    /// Positions of the free joints [rad or m].
    pub q: Vec<Vec<f64>>,
    /// Speeds of the free joints [rad/s or m/s].
    pub dq: Vec<Vec<f64>>,
    /// The wall's torques at the free joints from that tick to the next [N*m or N].
    pub torque: Vec<Vec<f64>>,
    /// The share of the wall's force that the limits of the joints let pass.
    pub share: Vec<f64>,
    /// Energy that the hand has put into the device since the start (J).
    pub hand_work: Vec<f64>,
}

/// Where the end point passed the plane: between the last tick outside and the first one inside of the wall, as if it had
/// moved evenly from the one to the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Met {
    /// Where that was \[m\].
    pub point: Vector,
    /// The handle's axes as columns, row-major.
    pub rotation: [f64; 9],
    /// Positions of the free joints [rad or m].
    pub q: Vec<f64>,
}

impl Contact {
    /// One without a tick yet.
    pub(super) fn begun(sample_s: f64) -> Self {
        Self {
            along: wall::Contact::begun(sample_s),
            point: Vec::new(),
            rotation: Vec::new(),
            q: Vec::new(),
            dq: Vec::new(),
            torque: Vec::new(),
            share: Vec::new(),
            hand_work: Vec::new(),
        }
    }

    /// Where the wall was met; `None` where it never was.
    pub fn met(&self) -> Option<Met> {
        let inside = self.along.touched?;
        let outside = inside.saturating_sub(1);
        let [from, to] = [outside, inside].map(|tick| self.along.position[tick]);
        let share = if from > to { (from / (from - to)).clamp(0.0, 1.0) } else { 1.0 };
        let between = |from: f64, to: f64| from + share * (to - from);
        Some(Met {
            point: std::array::from_fn(|k| between(self.point[outside][k], self.point[inside][k])),
            rotation: std::array::from_fn(|k| between(self.rotation[outside][k], self.rotation[inside][k])),
            q: self.q[outside].iter().zip(&self.q[inside]).map(|(from, to)| between(*from, *to)).collect(),
        })
    }

    /// Energy that the wall gives out from a tick to the next (J): exact, for the torques are held, where the drive delivers
    /// what is commanded.
    pub fn given(&self, tick: usize) -> f64 {
        let moved = self.q[tick + 1].iter().zip(&self.q[tick]).map(|(after, before)| after - before);
        self.torque[tick].iter().zip(moved).map(|(torque, moved)| torque * moved).sum()
    }
}

/// The device of a setting, ready to meet planes.
pub(super) struct Plant {
    system: System,
    kinematics: Kinematics,
    /// Commands that act at the start, without the wall.
    first: Vec<f64>,
    /// Force and moment of the hand that hold the device at rest there.
    holding: [Vector; 2],
    carrying: Option<(Compensation, Estimator)>,
}

impl Plant {
    pub(super) fn new(
        model: &Model,
        setting: &Setting,
        carried: Option<CompensationRatios>,
    ) -> Result<Self, WallError> {
        let system = model.system(&setting.free, |joint| setting.posture[joint])?;
        let kinematics = setting.start(model)?;
        let start: Vec<f64> = setting.free.iter().map(|joint| setting.posture[*joint]).collect();
        let rest = vec![0.0; start.len()];
        let mut first = vec![0.0; system.n_joints()];
        let mut carrying = None;
        if let Some(shares) = carried {
            let Sampling { sample_s, position_quantum, delay_samples, .. } = setting.sampling;
            let mut own = Compensation::new(system.clone(), shares, sample_s)?;
            let mut shown = rest.clone();
            system.measure(0.0, &system.rest(&start), &mut shown);
            first.copy_from_slice(own.tick(&shown, &rest, &rest));
            own.restart();
            let estimator = Estimator::new(start.len(), sample_s, BANDWIDTH_HZ, position_quantum, delay_samples);
            carrying = Some((own, estimator));
        }
        // What is missing for the device to rest, as force and moment at the handle: the least of those that do it.
        let (mut scratch, x) = (system.scratch(), system.rest(&start));
        let (mut rates, mut missing) = (x.clone(), rest.clone());
        system.missing_torque(&mut scratch, 0.0, (&x, &rest), &first, &mut rates, &mut missing);
        let transpose = scaled_transpose(&kinematics, setting.lever);
        let wrench = transpose.svd(true, true).solve(&DVector::from_vec(missing), 0.0);
        // The posture is not singular, or there were no kinematics.
        let wrench = wrench.map_or([0.0; 6], |wrench| std::array::from_fn(|row| wrench[row]));
        let [x, y, z, about_x, about_y, about_z] = wrench;
        let holding = [[x, y, z], [about_x, about_y, about_z].map(|moment| moment * setting.lever)];
        Ok(Self { system, kinematics, first, holding, carrying })
    }
}

/// A hand that holds the end point.
struct Handle {
    kinematics: Kinematics,
    n_free: usize,
    plane: dynid_control::Plane,
    /// Where it started, and the axes of the handle there.
    start: Vector,
    axes: [f64; 9],
    plan: Plan,
    /// The distance that the plan starts at.
    distance: f64,
    turning: [f64; 2],
    holding: [Vector; 2],
}

impl Held<3> for Handle {
    fn handle(&mut self, x: &[f64]) -> [Vector; 2] {
        self.kinematics.move_to(&x[..self.n_free]);
        [self.kinematics.position(), self.kinematics.velocity(&x[self.n_free..2 * self.n_free])[0]]
    }

    fn torques(&mut self, x: &[f64], force: Vector, torques: &mut [f64]) {
        let spin = self.kinematics.velocity(&x[self.n_free..2 * self.n_free])[1];
        let [stiffness, damping] = self.turning;
        let turned = turned_by(&self.axes, &self.kinematics.rotation());
        let moment = plus(plus(self.holding[1], -stiffness, turned), -damping, spin);
        self.kinematics.torques(plus(self.holding[0], 1.0, force), moment, torques);
    }

    fn wanted(&self, t: f64, touched: Option<f64>) -> Wanted<3> {
        let Wanted { position: [distance], velocity: [rate], hold: [hold] } = self.plan.at(t, touched);
        let normal = self.plane.normal;
        Wanted {
            position: plus(self.start, distance - self.distance, normal),
            velocity: normal.map(|component| component * rate),
            hold: normal.map(|component| component * hold),
        }
    }

    fn distance(&self, handle: Vector) -> f64 {
        self.plane.distance(handle)
    }
}

/// `sin(angle) axis` of the turn that takes one set of axes to another (columns, row-major): half the sum of the cross
/// products of the axes. A spring on it has the potential `k (1 - cos(angle))`.
pub(super) fn turned_by(from: &[f64; 9], to: &[f64; 9]) -> Vector {
    let mut sum = [0.0; 3];
    for column in 0..3 {
        let axis = |rotation: &[f64; 9]| [0, 1, 2].map(|row| rotation[3 * row + column]);
        let (a, b) = (axis(from), axis(to));
        for (k, (i, j)) in [(1, 2), (2, 0), (0, 1)].into_iter().enumerate() {
            sum[k] += 0.5 * (a[i] * b[j] - a[j] * b[i]);
        }
    }
    sum
}

/// `cos(angle)` of the same turn.
pub(super) fn cosine_of_turn(from: &[f64; 9], to: &[f64; 9]) -> f64 {
    let trace: f64 = from.iter().zip(to).map(|(a, b)| a * b).sum();
    0.5 * (trace - 1.0)
}

/// Plays one approach of `hand` against `wall`, the controller carrying the device by its model where shares are given.
///
/// # Errors
/// [`WallError::Diverged`]; what [`WallError`] says of the model and the start.
pub fn contact(
    model: &Model,
    setting: &Setting,
    wall: &Wall,
    (hand, approach): (&Hand, &Approach),
    carried: Option<CompensationRatios>,
) -> Result<Contact, WallError> {
    played(&Plant::new(model, setting, carried)?, setting, wall, hand, approach)
}

pub(super) fn played(
    plant: &Plant,
    setting: &Setting,
    wall: &Wall,
    hand: &Hand,
    approach: &Approach,
) -> Result<Contact, WallError> {
    let Plant { system, kinematics, first, holding, carrying } = plant;
    let (n_free, n_joints, plane) = (system.n_free(), system.n_joints(), setting.plane);
    let impedance = (wall.clone(), setting.lever);
    let mut impedance = PlaneWall::new(system, kinematics.clone(), plane, impedance, &setting.torque_limits)?;
    let mut carrying = carrying.clone();
    let mut speeds = vec![FilteredVelocity::new(setting.sampling.filter, setting.sampling.sample_s); n_free];
    let still = vec![0.0; n_free];
    let [mut dq, mut own_q, mut own_dq, mut own_ddq] = [(); 4].map(|()| still.clone());
    let distance = plane.distance(kinematics.position());
    let plan = Plan::new(distance, &setting.reaching, approach);
    let firmer = hand.grip_stiffness / setting.people.typical.grip_stiffness;
    let mut handle = Handle {
        kinematics: kinematics.clone(),
        n_free,
        plane,
        start: kinematics.position(),
        axes: kinematics.rotation(),
        plan,
        distance,
        turning: setting.turning.map(|own| own * firmer),
        holding: *holding,
    };
    // Commands, then what the wall asked for: torques, force, the share of it that passed.
    let mut acting = first.clone();
    acting.extend(&still);
    acting.extend([0.0, 1.0]);
    let start: Vec<f64> = setting.free.iter().map(|joint| setting.posture[*joint]).collect();
    let encounter = Encounter {
        system,
        sampling: setting.sampling,
        hand,
        start: &start,
        // An arm that does not get to the wall in three times the planned time never does.
        patience_s: 3.0 * plan.duration_s(),
        first: &acting,
    };
    let control = |shown: &[f64], answer: &mut [f64]| {
        for ((dq, velocity), shown) in dq.iter_mut().zip(&mut speeds).zip(shown) {
            *dq = velocity.tick(*shown);
        }
        answer[..n_joints].copy_from_slice(impedance.tick(shown, &dq));
        answer[n_joints..n_joints + n_free].copy_from_slice(impedance.torques());
        answer[n_joints + n_free] = impedance.force();
        answer[n_joints + n_free + 1] = impedance.share();
        if let Some((compensation, estimator)) = &mut carrying {
            // The weight alone needs no motion.
            let carried = if compensation.shares() == CompensationRatios::WEIGHT {
                compensation.tick(shown, &still, &still)
            } else {
                estimator.tick(shown, &mut own_q, &mut own_dq, &mut own_ddq);
                compensation.tick(&own_q, &own_dq, &own_ddq)
            };
            answer.iter_mut().zip(carried).for_each(|(answer, carried)| *answer += carried);
        }
    };
    let mut seen = kinematics.clone();
    let mut reported = Contact::begun(setting.sampling.sample_s);
    reported.along.touched = encounter.play(&mut handle, control, |tick| {
        let (q, dq) = (&tick.device[..n_free], &tick.device[n_free..2 * n_free]);
        seen.move_to(q);
        reported.along.position.push(plane.distance(seen.position()));
        reported.along.velocity.push(dot(plane.normal, seen.velocity(dq)[0]));
        reported.along.torque.push(tick.acting[n_joints + n_free]);
        reported.point.push(seen.position());
        reported.rotation.push(seen.rotation());
        reported.q.push(q.to_vec());
        reported.dq.push(dq.to_vec());
        reported.torque.push(tick.acting[n_joints..n_joints + n_free].to_vec());
        reported.share.push(tick.acting[n_joints + n_free + 1]);
        reported.hand_work.push(tick.hand_work);
    })?;
    Ok(reported)
}

//! A hand that holds the handle, and the arm that moves it.

use super::{Approach, setting::Reaching};
use dynid_generated::Scalar;
use dynid_random::Random;

/// Hand and arm about the joint, in the units of its torque and position. The grip couples the hand's inertia to the
/// handle; the arm pulls the hand along the motion that it plans (impedance of grip and arm in series, after Kuchenbecker,
/// Park & Niemeyer 2003).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hand {
    /// Inertia of the hand [kg m^2 or kg].
    pub inertia: f64,
    /// Stiffness of the grip.
    pub grip_stiffness: f64,
    /// Damping of the grip.
    pub grip_damping: f64,
    /// Stiffness of the arm.
    pub arm_stiffness: f64,
    /// Damping of the arm.
    pub arm_damping: f64,
    /// By which share the grip tightens at most when the handle shakes.
    pub tightening: f64,
    /// Speed of the handle against the hand at which the grip is as tight as it gets [rad/s or m/s].
    pub shakes: f64,
}

/// How fast the grip follows the shaking (s).
const GRIP_S: f64 = 0.1;

impl Hand {
    /// [`Hand::shakes`] of a hand on a joint \[rad/s\].
    pub const SHAKES: f64 = 0.5;

    /// Length of the state of a hand that moves in `D` directions: where it is, how fast, and how much the handle shakes.
    pub(super) const fn n_states(directions: usize) -> usize {
        2 * directions + 1
    }

    /// At rest with the handle.
    pub(super) fn rest<const D: usize>(place: [f64; D]) -> impl Iterator<Item = f64> {
        place.into_iter().chain([0.0; D]).chain([0.0])
    }

    /// The hand's rates, holding a handle at `position` that moves with `velocity`. Answers what the grip does to the handle.
    pub(super) fn rates<const D: usize>(
        &self,
        handle: [[f64; D]; 2],
        wanted: &Wanted<D>,
        hand: &[f64],
        rates: &mut [f64],
    ) -> [f64; D] {
        let Wanted { position, velocity, hold } = wanted;
        grip(&self.numbers(), handle, [position, velocity, hold], hand, rates)
    }

    /// What [`grip`] takes.
    pub(super) fn numbers(&self) -> [f64; 7] {
        let Self { inertia, grip_stiffness, grip_damping, arm_stiffness, arm_damping, tightening, shakes } = *self;
        [inertia, grip_stiffness, grip_damping, arm_stiffness, arm_damping, tightening, shakes]
    }

    /// Hands that differ: every number but `tightening` lies within the factor `spread` of this one's, evenly in its logarithm.
    pub fn population(self, spread: f64, count: usize, seed: u64) -> Vec<Self> {
        let mut random = Random::new(seed);
        let mut near = |value: f64| value * spread.powf(random.between(-1.0, 1.0));
        (0..count)
            .map(|_| Self {
                inertia: near(self.inertia),
                grip_stiffness: near(self.grip_stiffness),
                grip_damping: near(self.grip_damping),
                arm_stiffness: near(self.arm_stiffness),
                arm_damping: near(self.arm_damping),
                tightening: self.tightening,
                shakes: self.shakes,
            })
            .collect()
    }
}

/// The rates of a hand's state and what the grip does to the handle; `wanted`: position, velocity and hold.
#[inline(always)]
pub(super) fn grip<S: Scalar, const D: usize>(
    numbers: &[S; 7],
    [position, velocity]: [[S; D]; 2],
    wanted: [&[S; D]; 3],
    hand: &[S],
    rates: &mut [S],
) -> [S; D] {
    let [inertia, grip_stiffness, grip_damping, arm_stiffness, arm_damping, tightening, most] = *numbers;
    let [zero, one] = [S::constant(0.0), S::constant(1.0)];
    let shakes = hand[2 * D];
    let shaken = shakes / most;
    let shaken = S::if_less(shaken, zero, zero, S::if_less(one, shaken, one, shaken));
    let tightness = one + tightening * shaken;
    let (mut grip, mut slips) = ([zero; D], zero);
    for k in 0..D {
        let (place, speed) = (hand[k], hand[D + k]);
        let slip = velocity[k] - speed;
        let held = tightness * (grip_stiffness * (position[k] - place) + grip_damping * slip);
        let arm = arm_stiffness * (wanted[0][k] - place) + arm_damping * (wanted[1][k] - speed);
        rates[k] = speed;
        rates[D + k] = (arm + held - wanted[2][k]) / inertia;
        grip[k] = -held;
        slips = slips + slip * slip;
    }
    // the root of a square is the amount, to the last bit
    rates[2 * D] = (slips.sqrt() - shakes) / S::constant(GRIP_S);
    grip
}

/// What the arm wants: a motion of least jerk (Flash & Hogan 1985) from the start to the aim, whose largest speed is that of
/// the approach; from the first contact on it gives up its aim for the wall's surface, and holds against it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plan {
    start: f64,
    length: f64,
    duration_s: f64,
    relax_s: f64,
    hold: f64,
}

/// What the arm wants at a time, in `D` directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Wanted<const D: usize> {
    pub(super) position: [f64; D],
    pub(super) velocity: [f64; D],
    /// Torque or force into the wall: positive against the direction.
    pub(super) hold: [f64; D],
}

impl Plan {
    /// From `start`, the distance of the wall's surface.
    pub(super) fn new(start: f64, reaching: &Reaching, approach: &Approach) -> Self {
        let aim = -(reaching.aim[0] + reaching.aim[1] * approach.peak);
        let length = aim - start;
        // The speed of 10 s^3 - 15 s^4 + 6 s^5 is largest half-way: 15/8 of the mean.
        let duration_s = 1.875 * length.abs() / approach.peak;
        Self { start, length, duration_s, relax_s: reaching.relax_s, hold: reaching.hold_after(approach) }
    }

    pub(super) fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// At `t` (s) since the start, `touched` being when the wall was first met.
    pub(super) fn at(&self, t: f64, touched: Option<f64>) -> Wanted<1> {
        let share = (t / self.duration_s).clamp(0.0, 1.0);
        let path = share.powi(3) * (10.0 - 15.0 * share + 6.0 * share * share);
        let speed = 30.0 * share * share * (1.0 - share) * (1.0 - share) / self.duration_s;
        let (position, velocity) = (self.start + self.length * path, self.length * speed);
        let Some(touched) = touched else {
            return Wanted { position: [position], velocity: [velocity], hold: [0.0] };
        };
        let left = (-(t - touched).max(0.0) / self.relax_s).exp();
        Wanted {
            position: [left * position],
            velocity: [left * (velocity - position / self.relax_s)],
            hold: [self.hold * (1.0 - left)],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wall::Setting;

    #[test]
    fn the_plan_peaks_at_the_speed_it_is_asked_for() {
        let setting = Setting::shipped().expect("shipped");
        for approach in &setting.approaches {
            let plan = Plan::new(setting.start, &setting.reaching(), approach);
            let times = (0..=1000).map(|k| f64::from(k) * plan.duration_s() / 1000.0);
            let fastest = times.map(|t| plan.at(t, None).velocity[0].abs()).fold(0.0, f64::max);
            assert!((fastest - approach.peak).abs() < 1e-6 * approach.peak, "{fastest} for {}", approach.peak);
            // the velocity is that of the position, also once the wall is met
            for touched in [None, Some(0.1)] {
                let (before, after) = (plan.at(0.2 - 1e-6, touched), plan.at(0.2 + 1e-6, touched));
                let slope = (after.position[0] - before.position[0]) / 2e-6;
                assert!((slope - plan.at(0.2, touched).velocity[0]).abs() < 1e-6, "{slope}");
            }
        }
    }

    #[test]
    fn hands_differ_within_their_spread() {
        let typical = Setting::shipped().expect("shipped").hand;
        let hands = typical.population(1.5, 200, 7);
        let ratios: Vec<f64> = hands.iter().map(|hand| hand.grip_stiffness / typical.grip_stiffness).collect();
        assert!(ratios.iter().all(|ratio| (1.0 / 1.5..=1.5).contains(ratio)));
        assert!(ratios.iter().any(|ratio| *ratio > 1.4) && ratios.iter().any(|ratio| *ratio < 0.72));
        assert_eq!(hands, typical.population(1.5, 200, 7));
    }
}

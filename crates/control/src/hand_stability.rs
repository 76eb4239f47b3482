//! How much inertia a controller may take off a device before a hand and the device swing up each other.
//!
//! Linear, one joint: device of inertia J with viscous friction, held by a hand (a mass between two springs with dampers:
//! grip and arm), carried by a share of J through the [`super::Estimator`], its delay and a zero-order hold. All of it is
//! one matrix from sample to sample, and stable where no eigenvalue lies outside of the unit circle. Not for use in a tick.

use nalgebra::DMatrix;

use super::Estimator;

/// A hand at a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Holding {
    /// Of the hand, about the joint [kg*m^2 or kg].
    pub inertia: f64,
    /// Between device and hand [N*m/rad or N/m].
    pub grip_stiffness: f64,
    /// Between device and hand [N*m*s/rad or N*s/m].
    pub grip_damping: f64,
    /// Between hand and ground [N*m/rad or N/m].
    pub arm_stiffness: f64,
    /// Between hand and ground [N*m*s/rad or N*s/m].
    pub arm_damping: f64,
}

/// The largest share of the inertia `inertia` of a joint with the viscous friction `damping` up to which, from 0 on, the
/// device is stable in the hand, or by itself. To a hundredth; 0 where it is not stable even without.
pub fn largest_inertia_share(
    (inertia, damping): (f64, f64),
    hand: Option<&Holding>,
    sample_s: f64,
    bandwidth_hz: f64,
    delay_samples: usize,
) -> f64 {
    let stable = |percent: &u32| {
        let share = f64::from(*percent) / 100.0;
        spectral_radius(&closed_loop((inertia, damping), share, hand, sample_s, bandwidth_hz, delay_samples))
            < 1.0 + 1e-9
    };
    let first_unstable = (0..=100).find(|percent| !stable(percent)).unwrap_or(101);
    f64::from(first_unstable.max(1) - 1) / 100.0
}

/// From one sample to the next: `[q, dq, q_hand, dq_hand, z0..z3, torques under way]`.
fn closed_loop(
    (inertia, damping): (f64, f64),
    share: f64,
    hand: Option<&Holding>,
    sample_s: f64,
    bandwidth_hz: f64,
    delay_samples: usize,
) -> DMatrix<f64> {
    let mechanical = if hand.is_some() { 4 } else { 2 };
    // Torque as one more state that stands still, so that one exponential holds it over the sample.
    let mut rate = DMatrix::<f64>::zeros(mechanical + 1, mechanical + 1);
    rate[(0, 1)] = 1.0;
    rate[(1, 1)] = -damping / inertia;
    rate[(1, mechanical)] = 1.0 / inertia;
    if let Some(hand) = hand {
        rate[(2, 3)] = 1.0;
        for (row, sign, body) in [(1, -1.0, inertia), (3, 1.0, hand.inertia)] {
            rate[(row, 0)] += sign * hand.grip_stiffness / body;
            rate[(row, 1)] += sign * hand.grip_damping / body;
            rate[(row, 2)] -= sign * hand.grip_stiffness / body;
            rate[(row, 3)] -= sign * hand.grip_damping / body;
        }
        rate[(3, 2)] -= hand.arm_stiffness / hand.inertia;
        rate[(3, 3)] -= hand.arm_damping / hand.inertia;
    }
    let held = (rate * sample_s).exp();
    let (estimate, read, acceleration) = Estimator::new(1, sample_s, bandwidth_hz, 0.0, delay_samples).matrices();
    let n = mechanical + 4 + delay_samples;
    let mut next = DMatrix::<f64>::zeros(n, n);
    // The estimate of this sample, from the last one's and this sample's reading, then the torque that it asks for.
    let mut seen = DMatrix::<f64>::zeros(4, n);
    seen.view_mut((0, mechanical), (4, 4)).copy_from(&estimate);
    seen.view_mut((0, 0), (4, 1)).copy_from(&read);
    let asked = acceleration * &seen * (share * inertia);
    next.view_mut((0, 0), (mechanical, mechanical)).copy_from(&held.view((0, 0), (mechanical, mechanical)));
    let by_torque = held.view((0, mechanical), (mechanical, 1)).into_owned();
    if delay_samples == 0 {
        let mut own = next.view_mut((0, 0), (mechanical, n));
        own += &by_torque * &asked;
    } else {
        next.view_mut((0, mechanical + 4), (mechanical, 1)).copy_from(&by_torque);
        for late in 1..delay_samples {
            next[(mechanical + 4 + late - 1, mechanical + 4 + late)] = 1.0;
        }
        next.view_mut((n - 1, 0), (1, n)).copy_from(&asked);
    }
    next.view_mut((mechanical, 0), (4, n)).copy_from(&seen);
    next
}

fn spectral_radius(matrix: &DMatrix<f64>) -> f64 {
    matrix.complex_eigenvalues().iter().map(|value| value.norm()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HAND: Holding =
        Holding { inertia: 0.03, grip_stiffness: 40.0, grip_damping: 0.1, arm_stiffness: 4.0, arm_damping: 0.8 };

    /// By itself a device can be carried up to nearly all of its inertia: until `a Re H` is 1 where `Im H` is 0.
    #[test]
    fn a_free_device_bears_nearly_all() {
        let share = largest_inertia_share((0.045, 0.003), None, 1e-3, 20.0, 1);
        assert!((0.90..=0.94).contains(&share), "{share}");
    }

    /// A hand of little damping bears less than one of much.
    #[test]
    fn a_hand_bears_what_it_damps() {
        let loose = Holding { grip_damping: 0.02, arm_damping: 0.2, ..HAND };
        let firm = Holding { grip_damping: 0.5, arm_damping: 2.0, ..HAND };
        let of = |hand: &Holding| largest_inertia_share((0.045, 0.003), Some(hand), 1e-3, 20.0, 1);
        let shares = [of(&loose), of(&HAND), of(&firm)];
        assert!(shares[0] < shares[1] && shares[1] < shares[2], "{shares:?}");
    }

    /// What the documentation of [`crate::Compensation`] says of hands and encoders.
    #[test]
    fn poles_further_up_bear_more() {
        for (bandwidth_hz, this, worst) in [(20.0, 0.40, 0.24), (40.0, 0.55, 0.40), (80.0, 0.72, 0.60)] {
            let of = |hand: &Holding| largest_inertia_share((0.045, 0.0035), Some(hand), 1e-3, bandwidth_hz, 1);
            let found = of(&HAND);
            assert!((found - this).abs() < 0.03, "{bandwidth_hz} Hz: {found}");
            let corners = (0..8).map(|corner: u32| {
                let factor = |bit: u32| if corner >> bit & 1 == 1 { 1.5 } else { 1.0 / 1.5 };
                of(&Holding {
                    inertia: HAND.inertia * factor(0),
                    grip_stiffness: HAND.grip_stiffness * factor(1),
                    grip_damping: HAND.grip_damping * factor(2),
                    arm_damping: HAND.arm_damping * factor(2),
                    ..HAND
                })
            });
            let found = corners.fold(1.0, f64::min);
            assert!((found - worst).abs() < 0.03, "{bandwidth_hz} Hz: {found}");
        }
    }

    /// The matrix tells what a run of the estimator shows.
    #[test]
    fn the_matrix_is_the_loop() {
        let (inertia, damping, share) = (0.045, 0.003, 0.5);
        let matrix = closed_loop((inertia, damping), share, None, 1e-3, 20.0, 1);
        let mut state = nalgebra::DVector::zeros(matrix.nrows());
        state[0] = 0.1;
        // The estimator begins at the first reading.
        let mut estimator = Estimator::new(1, 1e-3, 20.0, 0.0, 1);
        state[2] = 0.1;
        let (mut q, mut dq, mut under_way) = (0.1, 0.5, 0.0);
        state[1] = dq;
        let (mut p, mut v, mut a) = ([0.0], [0.0], [0.0]);
        estimator.tick(&[q], &mut p, &mut v, &mut a);
        for k in 0..200 {
            // The matrix has seen the first reading twice, which changes nothing while the estimate is at rest there.
            if k > 0 {
                estimator.tick(&[q], &mut p, &mut v, &mut a);
            }
            let decay = (-damping / inertia * 1e-3_f64).exp();
            let end = under_way / damping;
            let travelled = end * 1e-3 + (dq - end) * (1.0 - decay) * inertia / damping;
            (q, dq) = (q + travelled, end + (dq - end) * decay);
            under_way = share * inertia * a[0];
            state = &matrix * state;
            assert!((state[0] - q).abs() < 1e-9 && (state[1] - dq).abs() < 1e-7, "{k}: {} {q}", state[0]);
        }
    }
}

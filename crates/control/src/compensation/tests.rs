use proptest::prelude::*;

use super::*;
use dynid_dynamics::{system::InverseError, system::PlacedEffect};
use dynid_dynamics::{
    system::fixtures::ARM, system::fixtures::FRICTION_BIAS, system::fixtures::GAIN, system::fixtures::INPUT_COUPLING,
    system::fixtures::LUGRE, system::fixtures::PENDULUM, system::fixtures::ROTOR_INERTIA, system::fixtures::SPRING,
    system::fixtures::VISCOUS, system::fixtures::placed,
};

const WHOLE: CompensationRatios = CompensationRatios { inertia: 1.0, friction: 1.0 };

/// A two-link arm with effects of every kind; `p` are numbers around 1.
fn arm(p: &[f64]) -> System {
    let links = vec![1.2 * p[0], 0.21 * p[1], 0.02 * p[2], 0.8 * p[3], 0.17 * p[4], 0.011 * p[5]];
    let effects: [PlacedEffect; 10] = [
        placed(&GAIN, 0, None, &[1.4 * p[6]]),
        placed(&GAIN, 1, None, &[0.8 * p[7]]),
        placed(&INPUT_COUPLING, 1, Some(0), &[-0.2 * p[8]]),
        placed(&SPRING, 0, None, &[0.9, 0.4]),
        placed(&SPRING, 1, None, &[0.3 * p[9], -0.1]),
        placed(&LUGRE, 0, None, &[3.0 * p[10], 0.4, 0.05, 0.2, 0.5, 0.3]),
        placed(&LUGRE, 1, None, &[2.0, 0.2, 0.03, 0.1, 0.2 * p[11], 0.1]),
        placed(&FRICTION_BIAS, 0, None, &[1.5]),
        placed(&VISCOUS, 1, None, &[0.02]),
        placed(&ROTOR_INERTIA, 1, None, &[0.01]),
    ];
    System::new(&ARM, 2, links, Vec::new(), &effects).unwrap()
}

proptest! {
    /// Under the commands that carry a motion the equations of motion go on with just this motion: drive path, loads,
    /// memory and forward dynamics together undo what compensation did.
    #[test]
    fn commands_make_the_motion_that_they_carry(
        p in prop::collection::vec(0.5..2.0_f64, 12),
        motion in prop::collection::vec(-2.0..2.0_f64, 6),
        ticks in 1..40_usize,
    ) {
        let system = arm(&p);
        let mut compensation = Compensation::new(system.clone(), WHOLE, 1e-3).unwrap();
        let (q, dq, ddq) = (&motion[..2], &motion[2..4], &motion[4..]);
        for _ in 1..ticks {
            compensation.tick(q, dq, ddq);
        }
        let mut x = compensation.x.clone();
        x[..4].copy_from_slice(&motion[..4]);
        let command = compensation.tick(q, dq, ddq).to_vec();
        let mut dx = vec![0.0; x.len()];
        system.derivative(&mut system.scratch(), 0.0, &x, &command, &mut dx);
        for slot in 0..2 {
            prop_assert!((dx[2 + slot] - ddq[slot]).abs() < 1e-9 * (1.0 + ddq[slot].abs()), "{dx:?} for {ddq:?}");
        }
    }

    /// What a share leaves is linear in it, and at rest only gravity and springs are carried.
    #[test]
    fn shares_leave_gravity_and_springs_alone(motion in prop::collection::vec(-2.0..2.0_f64, 6), share in 0.0..1.0_f64) {
        let system = arm(&[1.0; 12]);
        let (q, dq, ddq) = (&motion[..2], &motion[2..4], &motion[4..]);
        let torque = |shares: CompensationRatios, dq: &[f64], ddq: &[f64]| {
            let mut compensation = Compensation::new(system.clone(), shares, 1e-3).unwrap();
            compensation.tick(q, dq, ddq);
            compensation.torques().to_vec()
        };
        let none = CompensationRatios { inertia: 0.0, friction: 0.0 };
        let rest = torque(WHOLE, &[0.0; 2], &[0.0; 2]);
        let whole = torque(WHOLE, dq, ddq);
        let part = torque(CompensationRatios { inertia: share, friction: share }, dq, ddq);
        for slot in 0..2 {
            prop_assert!((torque(none, dq, ddq)[slot] - rest[slot]).abs() < 1e-12);
            let expected = rest[slot] + share * (whole[slot] - rest[slot]);
            prop_assert!((part[slot] - expected).abs() < 1e-11, "{} for {expected}", part[slot]);
        }
    }
}

fn rubbing(sigma0: f64) -> Compensation {
    let effects = [placed(&LUGRE, 0, None, &[sigma0, 0.0, 0.0, 0.1, 0.03, 0.03])];
    let system = System::new(&PENDULUM, 1, vec![0.0, 0.0, 0.02], Vec::new(), &effects).unwrap();
    Compensation::new(system, CompensationRatios { inertia: 0.0, friction: 1.0 }, 1e-3).unwrap()
}

/// Bristles follow a held speed as `z = Fc / sigma0 (1 - exp(-sigma0 dq t / Fc))`, at any tick.
#[test]
fn bristles_bend_as_their_equation_says() {
    let (sigma0, speed) = (6.0, 0.5);
    let mut compensation = rubbing(sigma0);
    for k in 0..50 {
        compensation.tick(&[0.0], &[speed], &[0.0]);
        let expected = 0.03 * (1.0 - (-sigma0 * speed * f64::from(k) * 1e-3 / 0.03).exp());
        assert!((compensation.torques()[0] - expected).abs() < 1e-14, "tick {k}");
    }
}

/// However stiff the bristles, a tick does not make them swing.
#[test]
fn stiff_bristles_are_stable() {
    let mut compensation = rubbing(1e5);
    for k in 0..1000 {
        let speed = if k < 500 { 1.0 } else { -1.0 };
        compensation.tick(&[0.0], &[speed], &[0.0]);
        assert!(compensation.torques()[0].abs() <= 0.03 * (1.0 + 1e-12), "tick {k}: {:?}", compensation.torques());
    }
    assert!((compensation.torques()[0] + 0.03).abs() < 1e-12);
}

/// A motion that is not known commands nothing and leaves no trace.
#[test]
fn what_is_no_number_commands_nothing() {
    let (mut one, mut other) = (rubbing(6.0), rubbing(6.0));
    one.tick(&[0.0], &[0.3], &[0.0]);
    other.tick(&[0.0], &[0.3], &[0.0]);
    assert_eq!(one.tick(&[0.0], &[f64::NAN], &[0.0]), [0.0]);
    assert_eq!(one.tick(&[0.0], &[], &[0.0]), [0.0]);
    assert_eq!(one.tick(&[0.1], &[0.2], &[0.0]), other.tick(&[0.1], &[0.2], &[0.0]));
}

#[test]
fn what_cannot_be_carried_is_refused() {
    let system = |gain: f64| {
        System::new(&PENDULUM, 1, vec![0.0, 0.0, 0.02], Vec::new(), &[placed(&GAIN, 0, None, &[gain])]).unwrap()
    };
    let of = |gain: f64, shares: CompensationRatios, sample_s: f64| {
        Compensation::new(system(gain), shares, sample_s).unwrap_err()
    };
    assert_eq!(of(0.0, WHOLE, 1e-3), InverseError::NoDrive.into());
    assert_eq!(of(1.0, WHOLE, 0.0), CompensationError::Sample { value: 0.0 });
    let shares = CompensationRatios { friction: 1.2, ..WHOLE };
    assert_eq!(of(1.0, shares, 1e-3), CompensationError::Share { of: "friction", value: 1.2 });
}

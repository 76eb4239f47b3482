use super::*;
use crate::system::tests::{LUGRE, PENDULUM, SPRING, VISCOUS, placed};

fn options(frequencies: &[f64]) -> Options {
    Options { frequencies: frequencies.to_vec(), amplitude: 0.01, ..Options::new(1) }
}

/// Izz 0.02 and no weight, with a spring and viscous friction.
fn body() -> System {
    let effects = [placed(&VISCOUS, 0, None, &[0.05]), placed(&SPRING, 0, None, &[0.3, 0.0])];
    System::new(&PENDULUM, 1, vec![0.0, 0.0, 0.02], Vec::new(), &effects).unwrap()
}

/// Inertia, damping and stiffness of a linear body are felt as they are.
#[test]
fn a_linear_body_is_felt_as_it_is() {
    for frequency in [0.3, 1.0, 4.0] {
        let felt = felt(&body(), None, &options(&[frequency]), 0, frequency);
        assert!((felt.inertia - 0.02).abs() < 1e-9, "{felt:?}");
        assert!((felt.damping - 0.05).abs() < 1e-9, "{felt:?}");
        assert!((felt.stiffness - 0.3).abs() < 1e-9, "{felt:?}");
    }
}

/// Weight near the lower rest position is a spring of m g l.
#[test]
fn weight_is_felt_as_a_spring() {
    let pendulum = System::new(&PENDULUM, 1, vec![0.5, 0.2, 0.01], Vec::new(), &[]).unwrap();
    let felt = felt(&pendulum, None, &options(&[1.0]), 0, 1.0);
    assert!((felt.inertia - 0.03).abs() < 1e-5, "{felt:?}");
    assert!((felt.stiffness - 0.5 * 0.2 * crate::system::tests::GRAVITY).abs() < 1e-4, "{felt:?}");
}

/// Sliding friction is felt as `4 F / (pi A omega)`.
#[test]
fn dry_friction_is_felt_as_its_describing_function() {
    let effects = [placed(&LUGRE, 0, None, &[500.0, 0.0, 0.0, 0.1, 0.02, 0.02])];
    let plant = System::new(&PENDULUM, 1, vec![0.0, 0.0, 0.02], Vec::new(), &effects).unwrap();
    let options = Options { amplitude: 0.3, ..options(&[1.0]) };
    let felt = felt(&plant, None, &options, 0, 1.0);
    let expected = 4.0 * 0.02 / (std::f64::consts::PI * 0.3 * TAU);
    assert!((felt.damping / expected - 1.0).abs() < 0.02, "{felt:?} for {expected}");
}

/// A perfect model of a linear body at a high rate leaves what the shares leave.
#[test]
fn a_perfect_model_leaves_nearly_nothing() {
    let options = Options { sample_s: 1e-4, bandwidth_hz: 200.0, quantum: 0.0, substeps: 1, ..options(&[1.0]) };
    let shares = Shares { inertia: 1.0, friction: 1.0 };
    let carrier = Compensation::new(body(), shares, options.sample_s).unwrap();
    let felt = felt(&body(), Some(&carrier), &options, 0, 1.0);
    assert!(felt.inertia.abs() < 1e-3 * 0.02, "{felt:?}");
    assert!(felt.damping.abs() < 1e-3 * 0.05, "{felt:?}");
    assert!(felt.stiffness.abs() < 1e-3 * 0.3, "{felt:?}");
}

/// With half of everything half is felt.
#[test]
fn a_share_leaves_the_rest() {
    let options = Options { sample_s: 1e-4, bandwidth_hz: 200.0, quantum: 0.0, substeps: 1, ..options(&[1.0]) };
    let carrier = Compensation::new(body(), Shares { inertia: 0.5, friction: 0.25 }, options.sample_s).unwrap();
    let felt = felt(&body(), Some(&carrier), &options, 0, 1.0);
    assert!((felt.inertia / 0.02 - 0.5).abs() < 1e-3, "{felt:?}");
    assert!((felt.damping / 0.05 - 0.75).abs() < 1e-3, "{felt:?}");
}

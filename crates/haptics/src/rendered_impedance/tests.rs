use super::*;
use dynid_dynamics::{simulate::Commands, simulate::Intersample, simulate::Stepper};
use dynid_dynamics::{
    system::fixtures::LUGRE, system::fixtures::PENDULUM, system::fixtures::SPRING, system::fixtures::VISCOUS,
    system::fixtures::placed,
};

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
        let impedance = impedance(&body(), None, &options(&[frequency]), 0, frequency);
        assert!((impedance.inertia - 0.02).abs() < 1e-9, "{impedance:?}");
        assert!((impedance.damping - 0.05).abs() < 1e-9, "{impedance:?}");
        assert!((impedance.stiffness - 0.3).abs() < 1e-9, "{impedance:?}");
    }
}

/// Weight near the lower rest position is a spring of m g l.
#[test]
fn weight_is_felt_as_a_spring() {
    let pendulum = System::new(&PENDULUM, 1, vec![0.5, 0.2, 0.01], Vec::new(), &[]).unwrap();
    let impedance = impedance(&pendulum, None, &options(&[1.0]), 0, 1.0);
    assert!((impedance.inertia - 0.03).abs() < 1e-5, "{impedance:?}");
    assert!(
        (impedance.stiffness - 0.5 * 0.2 * dynid_dynamics::system::fixtures::GRAVITY).abs() < 1e-4,
        "{impedance:?}"
    );
}

/// Sliding friction is felt as `4 F / (pi A omega)`.
#[test]
fn dry_friction_is_felt_as_its_describing_function() {
    let effects = [placed(&LUGRE, 0, None, &[500.0, 0.0, 0.0, 0.1, 0.02, 0.02])];
    let plant = System::new(&PENDULUM, 1, vec![0.0, 0.0, 0.02], Vec::new(), &effects).unwrap();
    let options = Options { amplitude: 0.3, ..options(&[1.0]) };
    let impedance = impedance(&plant, None, &options, 0, 1.0);
    let expected = 4.0 * 0.02 / (std::f64::consts::PI * 0.3 * TAU);
    assert!((impedance.damping / expected - 1.0).abs() < 0.02, "{impedance:?} for {expected}");
}

/// A perfect model of a linear body at a high rate leaves what the shares leave.
#[test]
fn a_perfect_model_leaves_nearly_nothing() {
    let options = Options { sample_s: 1e-4, bandwidth_hz: 200.0, quantum: 0.0, substeps: 1, ..options(&[1.0]) };
    let shares = CompensationRatios { inertia: 1.0, friction: 1.0 };
    let carrier = Compensation::new(body(), shares, options.sample_s).unwrap();
    let impedance = impedance(&body(), Some(&carrier), &options, 0, 1.0);
    assert!(impedance.inertia.abs() < 1e-3 * 0.02, "{impedance:?}");
    assert!(impedance.damping.abs() < 1e-3 * 0.05, "{impedance:?}");
    assert!(impedance.stiffness.abs() < 1e-3 * 0.3, "{impedance:?}");
}

/// With half of everything half is felt.
#[test]
fn a_share_leaves_the_rest() {
    let options = Options { sample_s: 1e-4, bandwidth_hz: 200.0, quantum: 0.0, substeps: 1, ..options(&[1.0]) };
    let carrier =
        Compensation::new(body(), CompensationRatios { inertia: 0.5, friction: 0.25 }, options.sample_s).unwrap();
    let impedance = impedance(&body(), Some(&carrier), &options, 0, 1.0);
    assert!((impedance.inertia / 0.02 - 0.5).abs() < 1e-3, "{impedance:?}");
    assert!((impedance.damping / 0.05 - 0.75).abs() < 1e-3, "{impedance:?}");
}

/// The six joints of the shipped device, carried and pushed off, and nobody holds them; the device is each parameter up to
/// `off` from what is believed of it. By how much a joint still trembles after 2.5 s at most: its speed beside the mean of those
/// 25 ms before and after, in rad/s.
fn trembling(off: f64, seed: u64) -> f64 {
    let device = dynid_model::device("freedom6s").unwrap();
    let controller_model = Model::of_device(device);
    let mut random = Random::new(seed);
    let mut truth = controller_model.clone();
    for (name, known) in controller_model.parameters().into_iter().filter(|(name, _)| !name.starts_with("base.")) {
        truth.set_value(&name, known.value * (1.0 + off * random.between(-1.0, 1.0))).unwrap();
    }
    let free = [0, 1, 2, 3, 4, 5];
    let system = |model: &Model| model.system(&free, |_| 0.0).unwrap();
    let (plant, options) = (system(&truth), Options::new(6));
    let carrier =
        Compensation::new(system(&controller_model), CompensationRatios::default(), options.sample_s).unwrap();
    let mut controller = Controller::new(&carrier, &options);
    let mut x = plant.rest(&[0.05, 0.1, 0.0, 0.2, -0.2, -0.3]);
    x[6..12].copy_from_slice(&[0.5, -0.4, 0.5, 1.0, -1.0, 1.0]);
    let mut stepper = Stepper::new(&plant, &x);
    let (mut command, mut next) = (vec![0.0; 6], vec![0.0; 6]);
    let mut speeds: Vec<Vec<f64>> = Vec::new();
    for k in 0..3000 {
        let t = f64::from(k) * options.sample_s;
        controller.tick(&plant, t, &stepper.x, &mut next);
        let rows = Commands { time: &[t], rows: &command, n_joints: 6, intersample: Intersample::ZeroOrder };
        stepper.held(&plant, t, t + options.sample_s, 8, &command, &rows);
        std::mem::swap(&mut command, &mut next);
        speeds.push(stepper.x[6..12].to_vec());
    }
    let beside = |k: usize, joint: usize| speeds[k][joint] - 0.5 * (speeds[k - 25][joint] + speeds[k + 25][joint]);
    (2500..2975).flat_map(|k| (0..6).map(move |joint| (k, joint))).fold(0.0, |most, (k, joint)| {
        let tremble: f64 = beside(k, joint);
        if tremble.is_finite() { most.max(tremble.abs()) } else { f64::INFINITY }
    })
}

/// Friction and inertia that are carried together leave a light joint stable, late as the controller is: what the push stirs
/// up dies out.
#[test]
fn a_carried_device_that_is_let_go_does_not_tremble() {
    for (off, seed) in [(0.0, 1), (0.05, 2), (0.05, 3)] {
        let most = trembling(off, seed);
        assert!(most < 0.03, "{off}, {seed}: {most}");
    }
}

use std::f64::consts::TAU;

use super::*;
use crate::{
    system::fixtures::ARM, system::fixtures::GRAVITY, system::fixtures::LUGRE, system::fixtures::PENDULUM,
    system::fixtures::SPRING, system::fixtures::VISCOUS, system::fixtures::full_arm, system::fixtures::placed,
};

fn times(samples: usize, step: f64) -> Vec<f64> {
    (0..samples).map(|k| k as f64 * step).collect()
}

fn pendulum(effects: &[crate::system::PlacedEffect]) -> System {
    System::new(&PENDULUM, 1, vec![0.5, 0.3, 0.01], Vec::new(), effects).unwrap()
}

#[test]
fn a_swinging_pendulum_keeps_its_period() {
    let system = pendulum(&[]);
    let (time, command) = (times(1001, 0.01), vec![0.0; 1001]);
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let swing = simulate(&system, &input, &[1e-3], &Options::per_sample(60)).unwrap();
    let rate = (GRAVITY * 0.15 / (0.01 + 0.5 * 0.09)).sqrt();
    // Amplitude 1e-3 lengthens the period by 1/16 of its square: 6e-8.
    for (t, q) in time.iter().zip(&swing.q) {
        assert!((q - 1e-3 * (rate * t).cos()).abs() < 1e-3 * 1e-5, "at {t} s of {} s", TAU / rate);
    }
}

#[test]
fn energy_is_kept_without_friction() {
    let links = vec![1.2, 0.21, 0.02, 0.8, 0.17, 0.011];
    let system = System::new(&ARM, 2, links, Vec::new(), &[]).unwrap();
    let (time, command) = (times(501, 0.01), vec![0.0; 1002]);
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let motion = simulate(&system, &input, &[0.4, 0.3], &Options::per_sample(60)).unwrap();
    let energy = |q: &[f64], dq: &[f64]| {
        let mut d = [0.0; 4];
        ARM.functions.inertia(system.prepared(), q, &mut d);
        let kinetic = 0.5 * (d[0] * dq[0] * dq[0] + 2.0 * d[1] * dq[0] * dq[1] + d[3] * dq[1] * dq[1]);
        let lumps = system.prepared();
        kinetic + GRAVITY * (lumps[3] * q[0].sin() + lumps[4] * (q[0] + q[1]).sin())
    };
    let start = energy(&motion.q[..2], &motion.dq[..2]);
    for (q, dq) in motion.q.chunks(2).zip(motion.dq.chunks(2)) {
        assert!((energy(q, dq) - start).abs() < 1e-9, "{} J instead of {start} J", energy(q, dq));
    }
}

/// `J ddq + Fv dq + Ks (q - qeq) = 0`, whose solution is a decaying cosine.
#[test]
fn an_oscillator_follows_its_exact_solution() {
    let effects = [placed(&VISCOUS, 0, None, &[0.08]), placed(&SPRING, 0, None, &[3.0, 0.5])];
    let system = System::new(&PENDULUM, 1, vec![0.0, 0.0, 0.05], Vec::new(), &effects).unwrap();
    let (time, command) = (times(301, 0.01), vec![0.0; 301]);
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let motion = simulate(&system, &input, &[0.9], &Options::per_sample(60)).unwrap();
    let decay: f64 = 0.08 / (2.0 * 0.05);
    let rate = (3.0 / 0.05 - decay * decay).sqrt();
    for (t, q) in time.iter().zip(&motion.q) {
        let exact = 0.5 + 0.4 * (-decay * t).exp() * ((rate * t).cos() + decay / rate * (rate * t).sin());
        assert!((q - exact).abs() < 1e-10, "{q} instead of {exact} at {t} s");
    }
}

#[test]
fn a_held_torque_acts_over_its_sample_and_a_linear_one_between() {
    let system = System::new(&PENDULUM, 1, vec![0.0, 0.0, 2.0], Vec::new(), &[]).unwrap();
    let time = [0.0, 0.1, 0.3];
    let command = [4.0, 8.0, 0.0];
    let held = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let motion = simulate(&system, &held, &[1.0], &Options::per_sample(60)).unwrap();
    let expected = [1.0, 1.0 + 0.01, 1.01 + 0.2 * 0.2 + 0.5 * 4.0 * 0.04];
    for (q, expected) in motion.q.iter().zip(expected) {
        assert!((q - expected).abs() < 1e-12, "{q} instead of {expected}");
    }
    let linear = Input { intersample: Intersample::FirstOrder, ..held };
    let motion = simulate(&system, &linear, &[1.0], &Options::per_sample(60)).unwrap();
    // ddq = 2 + 20 t over the first sample: q = t^2 + 20 t^3 / 6
    assert!((motion.q[1] - (1.0 + 0.01 + 20.0 * 1e-3 / 6.0)).abs() < 1e-12);
    assert!((motion.dq[1] - (0.2 + 0.1)).abs() < 1e-12);
}

/// The same law with forward Euler at a step a hundred times finer.
#[test]
fn lugre_agrees_with_an_independent_fine_integration() {
    let law = [1.2, 0.008, 0.006, 0.2, 0.022, 0.016];
    let effects = [placed(&LUGRE, 0, None, &law), placed(&SPRING, 0, None, &[0.025, -0.25])];
    let inertia = 4e-4;
    let system = System::new(&PENDULUM, 1, vec![0.0, 0.0, inertia], Vec::new(), &effects).unwrap();
    let time = times(201, 0.01);
    let command: Vec<f64> = time.iter().map(|t| 0.04 * (3.0 * t).cos()).collect();
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let motion = simulate(&system, &input, &[-0.2], &Options::per_sample(60)).unwrap();
    let (mut q, mut v, mut z): (f64, f64, f64) = (-0.2, 0.0, 0.0);
    let steps = 20_000;
    let mut largest: f64 = 0.0;
    for sample in 0..200 {
        largest = largest.max((q - motion.q[sample]).abs());
        let step = 0.01 / f64::from(steps);
        for _ in 0..steps {
            let stribeck = law[5] + (law[4] - law[5]) * (-(v / law[3]) * (v / law[3])).exp();
            let z_rate = v - law[0] * v.abs() / stribeck * z;
            let friction = law[0] * z + law[1] * z_rate + law[2] * v;
            let acceleration = (command[sample] - friction - 0.025 * (q + 0.25)) / inertia;
            q += step * v;
            v += step * acceleration;
            z += step * z_rate;
        }
    }
    let range = motion.q.iter().fold(0.0_f64, |range, q| range.max((q + 0.2).abs()));
    assert!(range > 0.3, "the joint breaks away: {range} rad");
    assert!(largest < 2e-6, "{largest} rad apart");
}

#[test]
fn a_diverging_motion_is_an_error_that_says_when_and_where() {
    let effects = [placed(&SPRING, 0, None, &[-500.0, 0.0])];
    let system = pendulum(&effects);
    let (time, command) = (times(101, 0.01), vec![0.0; 101]);
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let error = simulate(&system, &input, &[0.1], &Options::per_sample(60)).unwrap_err();
    let SimulationError::Diverged { time_s, joint: 0 } = error else { panic!("{error}") };
    assert!((0.05..0.5).contains(&time_s), "{time_s}");
}

#[test]
fn inputs_that_do_not_fit_are_errors() {
    let system = full_arm();
    let run = |time: &[f64], command: &[f64], q0: &[f64]| {
        let input = Input { time, command, intersample: Intersample::ZeroOrder };
        simulate(&system, &input, q0, &Options::per_sample(60)).unwrap_err().to_string()
    };
    assert_eq!(run(&[0.0, 0.1], &[0.0; 3], &[0.0; 2]), "commanded torques: 3 values given, 4 needed");
    assert_eq!(run(&[0.0, 0.1], &[0.0; 4], &[0.0; 1]), "initial positions: 1 values given, 2 needed");
    assert_eq!(run(&[0.0, 0.0], &[0.0; 4], &[0.0; 2]), "time does not run forward at sample 1");
    assert_eq!(run(&[0.0, f64::NAN], &[0.0; 4], &[0.0; 2]), "time does not run forward at sample 1");
}

#[test]
fn a_gap_in_the_log_takes_more_steps() {
    let grid = Grid::new(&[0.0, 0.01, 0.02, 0.03, 0.04], 6);
    assert_eq!(grid.steps(0.0, 0.01), 6);
    assert_eq!(grid.steps(0.0, 0.01 + 1e-9), 6);
    assert_eq!(grid.steps(0.0, 0.1), 60);
    assert_eq!(grid.steps(0.0, 1e-6), 1);
}

/// A pendulum whose bristles are a hundred times as stiff as its motion.
fn stiff(schemes: &[Scheme], time: &[f64], command: &[f64], rates: &[f64]) -> Vec<f64> {
    let effects = [placed(&LUGRE, 0, None, &[2000.0, 20.0, 0.05, 0.01, 0.5, 0.4]), placed(&VISCOUS, 0, None, &[0.02])];
    let position: Vec<f64> = time.iter().map(|t| 0.3 * (4.0 * t).sin()).collect();
    let predictor = Predictor { position: &position, rates, schemes };
    let input = Input { time, command, intersample: Intersample::FirstOrder };
    predict(&pendulum(&effects), &input, &predictor, &[0.0], &Options::per_sample(60)).unwrap().q
}

/// `J ddq + Fv dq + Ks (q - qeq) = 0`, whose fast part decays within a thousandth of the slow one.
#[test]
fn implicit_steps_come_to_the_exact_solution_with_the_third_power_of_their_length() {
    let (damping, stiffness, inertia) = (8.0, 40.0, 0.01);
    let effects = [placed(&VISCOUS, 0, None, &[damping]), placed(&SPRING, 0, None, &[stiffness, 0.5])];
    let system = System::new(&PENDULUM, 1, vec![0.0, 0.0, inertia], Vec::new(), &effects).unwrap();
    let (time, command) = (times(101, 0.05), vec![0.0; 101]);
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let position = vec![0.0; 101];
    let root = ((damping / inertia).powi(2) / 4.0 - stiffness / inertia).sqrt();
    let (slow, fast) = (-damping / (2.0 * inertia) + root, -damping / (2.0 * inertia) - root);
    assert!(fast / slow > 100.0);
    let exact = |t: f64| 0.5 + 0.4 * (fast * (slow * t).exp() - slow * (fast * t).exp()) / (fast - slow);
    let error = |scheme: Scheme| {
        let schemes = [scheme; 100];
        let predictor = Predictor { position: &position, rates: &[0.0], schemes: &schemes };
        let found = predict(&system, &input, &predictor, &[0.9], &Options::per_sample(60)).unwrap();
        // After the first intervals, in which the fast part decays.
        time.iter().zip(&found.q).skip(4).fold(0.0_f64, |most, (t, q)| most.max((q - exact(*t)).abs()))
    };
    let errors = [1, 2, 4, 8].map(|steps| error(Scheme::Implicit(steps)));
    assert!(errors[0] < 1e-3, "{errors:?}");
    assert!(errors.windows(2).all(|pair| pair[1] < pair[0] / 5.0), "{errors:?}");
}

#[test]
fn implicit_steps_stay_stable_and_come_to_what_explicit_ones_come_to() {
    let time = times(151, 0.01);
    let command: Vec<f64> = time.iter().map(|t| 1.5 * (9.0 * t).sin()).collect();
    let exact = stiff(&[Scheme::Explicit(512); 150], &time, &command, &[0.0]);
    for (steps, most) in [(1, 1e-2), (8, 1e-3), (64, 1e-5)] {
        let found = stiff(&[Scheme::Implicit(steps); 150], &time, &command, &[0.0]);
        let error = found.iter().zip(&exact).fold(0.0_f64, |error, (a, b)| error.max((a - b).abs()));
        assert!(error < most, "{error} with {steps} steps");
    }
}

#[test]
fn a_plan_keeps_its_tolerance_and_spends_steps_where_they_are_needed() {
    let time = times(151, 0.01);
    let command: Vec<f64> = time.iter().map(|t| 1.5 * (9.0 * t).sin()).collect();
    let effects = [placed(&LUGRE, 0, None, &[2000.0, 20.0, 0.05, 0.01, 0.5, 0.4]), placed(&VISCOUS, 0, None, &[0.02])];
    let position: Vec<f64> = time.iter().map(|t| 0.3 * (4.0 * t).sin()).collect();
    let predictor = Predictor { position: &position, rates: &[50.0], schemes: &[] };
    let input = Input { time: &time, command: &command, intersample: Intersample::FirstOrder };
    let exact = stiff(&[Scheme::Explicit(512); 150], &time, &command, &[50.0]);
    for tolerance in [1e-4, 1e-6] {
        let planned = plan(&pendulum(&effects), &input, &predictor, &[0.0], &[tolerance]).unwrap();
        let found = stiff(&planned.schemes, &time, &command, &[50.0]);
        let error = found.iter().zip(&exact).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        // Errors of an interval are forgotten within 1/50 s, two samples.
        assert!(error < 5.0 * tolerance, "{error} at {tolerance}");
        let cheap = planned.schemes.iter().filter(|scheme| scheme.steps() <= 2).count();
        assert!(cheap > 0 && cheap < 150, "{cheap} of 150 at {tolerance}");
    }
}

/// Bristles so stiff that no number of explicit steps of an interval is stable: where nothing keeps the tolerance, motions that begin
/// side by side still stay so, and with them the derivatives.
#[test]
fn a_plan_that_keeps_no_tolerance_is_stable() {
    let effects = [placed(&LUGRE, 0, None, &[2e7, 2e3, 0.05, 0.01, 0.5, 0.4]), placed(&VISCOUS, 0, None, &[0.02])];
    let system = pendulum(&effects);
    let time = times(151, 0.01);
    let command: Vec<f64> = time.iter().map(|t| 1.5 * (9.0 * t).sin()).collect();
    let position: Vec<f64> = time.iter().map(|t| 0.3 * (4.0 * t).sin()).collect();
    let predictor = Predictor { position: &position, rates: &[50.0], schemes: &[] };
    let input = Input { time: &time, command: &command, intersample: Intersample::FirstOrder };
    let planned = plan(&system, &input, &predictor, &[0.0], &[1e-18]).unwrap();
    let predictor = Predictor { schemes: &planned.schemes, ..predictor };
    let moved = |nudge: f64| predict(&system, &input, &predictor, &[nudge], &Options::per_sample(60)).unwrap().q;
    let nudge = 1e-9;
    let apart = moved(0.0).iter().zip(moved(nudge)).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
    assert!(planned.schemes.contains(&Scheme::FINEST) && apart < 10.0 * nudge, "{apart}");
}

/// Adapted steps against the exact solution of an oscillator, and against steps of 1/600 of a sample where bristles stick and slip; of held
/// and of straight commands, with a gap in the samples.
#[test]
fn adapted_steps_stay_near_the_exact_motion() {
    let most = |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
    let effects = [placed(&VISCOUS, 0, None, &[0.08]), placed(&SPRING, 0, None, &[3.0, 0.5])];
    let system = System::new(&PENDULUM, 1, vec![0.0, 0.0, 0.05], Vec::new(), &effects).unwrap();
    let (mut time, command) = (times(301, 0.01), vec![0.0; 301]);
    let decay: f64 = 0.08 / (2.0 * 0.05);
    let rate = (3.0 / 0.05 - decay * decay).sqrt();
    let exact = |t: f64| 0.5 + 0.4 * (-decay * t).exp() * ((rate * t).cos() + decay / rate * (rate * t).sin());
    for share in [1e-5, 1e-7] {
        let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
        let options = Options { steps: Steps::Within(share), ..Options::default() };
        let adapted = simulate(&system, &input, &[0.9], &options).unwrap();
        let exact: Vec<f64> = time.iter().map(|t| exact(*t)).collect();
        assert!(most(&adapted.q, &exact) < 20.0 * share, "{:e} at {share:e}", most(&adapted.q, &exact));
    }
    time[200..].iter_mut().for_each(|t| *t += 0.07);
    let command: Vec<f64> = time.iter().map(|t| 1.5 * (3.0 * t).sin()).collect();
    let effects = [placed(&LUGRE, 0, None, &[200.0, 2.0, 0.05, 0.1, 0.5, 0.4]), placed(&VISCOUS, 0, None, &[0.02])];
    for intersample in [Intersample::ZeroOrder, Intersample::FirstOrder] {
        let input = Input { time: &time, command: &command, intersample };
        let run = |options: Options| simulate(&pendulum(&effects), &input, &[0.0], &options).unwrap().q;
        let (adapted, fine) = (run(Options::default()), run(Options::per_sample(600)));
        let (error, farthest) = (most(&adapted, &fine), fine.iter().fold(0.0_f64, |most, q| most.max(q.abs())));
        assert!(error < 2e-5 * farthest, "{error:e} of {farthest} with {intersample:?}");
    }
}

/// A gap of a second in a log that stands at rest so far: bristles that swing at 600 rad/s in it need more than the samples around it do, and
/// shorter steps are asked of it where less may be left.
#[test]
fn adapted_steps_of_a_gap_keep_their_share() {
    let effects = [placed(&LUGRE, 0, None, &[2e4, 20.0, 0.05, 0.01, 5.0, 4.0])];
    let system = pendulum(&effects);
    let mut time = times(61, 0.1);
    time[30..].iter_mut().for_each(|t| *t += 1.0);
    let mut command = vec![0.0; 61];
    command[29] = 2.0;
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let run = |steps: Steps| {
        let options = Options { steps, ..Options::default() };
        simulate(&system, &input, &[0.0], &options).unwrap().q
    };
    let most = |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
    let fine = run(Steps::PerSample(6000));
    // What moves less than a millimetre or so counts as if it did.
    let farthest = fine.iter().fold(1e-3_f64, |most, q| most.max(q.abs()));
    for share in [Steps::ADAPTIVE_SHARE, 1e-6] {
        let steps = Steps::Within(share);
        let (rough, finer) = (most(&run(steps), &fine), most(&run(steps.finer()), &fine));
        assert!(rough < 30.0 * share * farthest, "{rough:e} of {farthest} at {share:e}");
        assert!(finer < 30.0 * share / 16.0 * farthest, "{finer:e} of {farthest} at a sixteenth of {share:e}");
    }
}

/// A share that no steps keep takes those that err least.
#[test]
fn adapted_steps_that_keep_nothing_err_least() {
    let effects = [placed(&LUGRE, 0, None, &[200.0, 2.0, 0.05, 0.1, 0.5, 0.4]), placed(&VISCOUS, 0, None, &[0.02])];
    let (system, time) = (pendulum(&effects), times(101, 0.01));
    let command: Vec<f64> = time.iter().map(|t| 1.5 * (3.0 * t).sin()).collect();
    let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
    let run = |steps: Steps| simulate(&system, &input, &[0.0], &Options { steps, ..Options::default() }).unwrap().q;
    let fine = run(Steps::PerSample(2000));
    let error = |steps: Steps| run(steps).iter().zip(&fine).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
    let (least, many) = (error(Steps::Within(1e-20)), error(Steps::PerSample(128)));
    assert!(least < many, "{least:e}, and {many:e} with many steps");
}

/// A run in a closed loop takes the same adapted steps as its commands played again.
#[test]
fn adapted_steps_are_the_same_in_a_closed_loop() {
    let effects = [placed(&LUGRE, 0, None, &[200.0, 2.0, 0.05, 0.1, 0.5, 0.4])];
    let time = times(301, 0.01);
    let reference: Vec<f64> = time.iter().map(|t| 0.3 * (4.0 * t).sin()).collect();
    let controller = control::Controller {
        proportional: vec![3.0],
        derivative: vec![0.1],
        filter: control::Filter::THESIS,
        limit: vec![f64::INFINITY],
        position_quantum: 1e-4,
        torque_quantum: 0.0,
    };
    let options = Options::default();
    let (motion, commands) =
        control::simulate(&pendulum(&effects), &controller, &time, &reference, &[0.1], &options).unwrap();
    let input = Input { time: &time, command: &commands, intersample: Intersample::ZeroOrder };
    assert_eq!(simulate(&pendulum(&effects), &input, &[0.1], &options).unwrap(), motion);
}

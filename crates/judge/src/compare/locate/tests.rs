//! Synthetic errors whose cause is known.

use std::f64::consts::TAU;

use super::{
    Finding, FindingKind, OtherSignal, OwnSignal, Region, Signal, Third, Twin, between_runs, of_trace,
    spectrum::{by_chance, periodogram},
    trace::{Signals, Trace},
};
use dynid_random::Random;
use dynid_signal::{Lowpass, second_derivative};

const STEP: f64 = 0.01;
const N: usize = 6000;

/// Speed and acceleration of a position that is a sum of sines: amplitude, frequency (Hz), phase.
fn moved(joint: usize, waves: &[(f64, f64, f64)], command: &[(f64, f64, f64)]) -> Signals {
    let sum = |waves: &[(f64, f64, f64)], order: i32, turn: f64| -> Vec<f64> {
        (0..N)
            .map(|k| {
                waves
                    .iter()
                    .map(|(a, hz, phase)| {
                        a * (TAU * hz).powi(order) * (TAU * (hz * STEP * k as f64 + turn) + phase).sin()
                    })
                    .sum()
            })
            .collect()
    };
    Signals {
        joint,
        q: sum(waves, 0, 0.0),
        dq: sum(waves, 1, 0.25),
        ddq: sum(waves, 2, 0.5),
        command: sum(command, 0, 0.0),
    }
}

/// Joint 4 moves over a radian and a half, joint 5 at frequencies of its own.
fn trace(residual: impl Fn(&Signals, &Signals, usize) -> f64, noise: f64) -> Trace {
    let own = moved(4, &[(0.5, 0.37, 0.1), (0.3, 0.83, 1.0)], &[(0.8, 0.37, 0.9), (0.6, 1.13, 0.3)]);
    let other = moved(5, &[(0.4, 0.59, 0.4), (0.2, 1.31, 2.0)], &[(0.5, 0.71, 0.2), (0.4, 1.57, 1.2)]);
    let mut random = Random::new(17);
    let residual = (0..N).map(|k| residual(&own, &other, k) + noise * random.normal()).collect();
    Trace {
        start_s: 0.0,
        run: "made.csv".to_owned(),
        run_index: 0,
        joint: 4,
        error: Signal::Torque,
        unit: "N*m".to_owned(),
        position_unit: "rad".to_owned(),
        is_local: true,
        step: STEP,
        bandwidth_hz: 0.5 / STEP,
        residual,
        used: vec![true; N],
        own,
        others: vec![other],
        rest: 0.0,
    }
}

fn first(trace: &Trace) -> Finding {
    of_trace(trace).into_iter().next().expect("something is found")
}

/// Whether an error is proportional to that signal of its joint.
fn follows(finding: &Finding, asked: OwnSignal) -> bool {
    matches!(finding.kind, FindingKind::Follows { signal, .. } if signal == asked)
}

/// Whether an error lies at reversals or low speed, which are mostly the same samples.
fn is_slow(finding: &Finding) -> bool {
    matches!(finding.kind, FindingKind::LiesIn { region: Region::Reversals { .. } | Region::LowSpeed { .. }, .. })
}

#[test]
fn noise_gives_nothing() {
    for seed in 0..20 {
        let mut made = trace(|_, _, _| 0.0, 0.0);
        let mut random = Random::new(seed);
        made.residual = (0..N).map(|_| random.normal()).collect();
        assert_eq!(of_trace(&made), [], "white, seed {seed}");
        // Noise with memory, as a filter leaves it, of 10 samples or so.
        let mut smooth = 0.0;
        let mut smoother = 0.0;
        for value in &mut made.residual {
            smooth += 0.2 * (*value - smooth);
            smoother += 0.2 * (smooth - smoother);
            *value = smoother;
        }
        made.bandwidth_hz = 4.0;
        let message: Vec<Finding> = of_trace(&made)
            .into_iter()
            .filter(|finding| !matches!(finding.kind, FindingKind::LiesInBand { .. }))
            .collect();
        assert_eq!(message, [], "with memory, seed {seed}");
    }
}

/// What two derivatives and two filters make of position noise is narrow, but it is noise.
#[test]
fn the_noise_of_accelerations_gives_nothing() {
    let filter = dynid_signal::Lowpass::new(12.0, 1.0 / STEP).expect("below Nyquist");
    for seed in 0..20 {
        let mut made = trace(|_, _, _| 0.0, 0.0);
        made.bandwidth_hz = 12.0;
        let position = filter.apply(&Random::new(seed).vector(N, -1.0, 1.0));
        made.residual = filter.apply(&dynid_signal::second_derivative(&position, STEP));
        assert_eq!(of_trace(&made), [], "seed {seed}");
    }
}

#[test]
fn an_offset_is_reported_with_its_size() {
    let found = first(&trace(|_, _, _| 0.02, 0.005));
    let FindingKind::Offset { constant } = found.kind else { panic!("{found:?}") };
    // four standard errors
    assert!((constant - 0.02).abs() < 4.0 * 0.005 / (N as f64).sqrt(), "{constant}");
    assert!((found.share - 16.0 / 17.0).abs() < 0.01, "{found:?}");
}

#[test]
fn friction_is_reported_by_the_sign_of_the_speed() {
    let found = first(&trace(|own, _, k| 0.03 * (own.dq[k] / 1e-3).tanh(), 0.01));
    assert!(follows(&found, OwnSignal::SpeedSign), "{found:?}");
    assert!(found.share > 0.85 && found.expected < 0.01, "{found:?}");
}

#[test]
fn what_lies_at_reversals_is_reported_there() {
    let found = of_trace(&trace(|own, _, k| 0.05 * (-(own.dq[k] / 0.1).powi(2)).exp() * own.ddq[k].signum(), 0.003));
    let reversal = found.iter().find(|finding| is_slow(finding)).expect("located");
    assert!(reversal.share > 0.7 && reversal.expected < 0.3, "{found:?}");
}

/// Reversals are slow, and at the ends of the range: three names of the same samples make one finding, the most telling first.
#[test]
fn what_only_looks_like_another_place_is_named_beside_it() {
    let mut random = Random::new(23);
    let mut made = trace(|_, _, _| 0.0, 0.0);
    let turning = made.own.dq.clone();
    made.residual = turning.iter().map(|dq| random.normal() * if dq.abs() < 0.15 { 3.0 } else { 0.3 }).collect();
    let found = of_trace(&made);
    let FindingKind::LiesIn { region, also } = &found[0].kind else { panic!("{found:?}") };
    let is_turning = |region: &Region| matches!(region, Region::Reversals { .. } | Region::LowSpeed { .. });
    assert!(is_turning(region) && also.iter().any(|also| is_turning(&also.region)), "{found:?}");
    assert_eq!(found.iter().filter(|finding| is_slow(finding)).count(), 1, "{found:?}");
    // Two places that have nothing to do with each other remain two.
    let n = made.residual.len();
    let mut random = Random::new(24);
    made.residual = turning
        .iter()
        .enumerate()
        .map(|(k, dq)| {
            random.normal() * if dq.abs() < 0.15 { 3.0 } else { 0.3 } * if 3 * k > 2 * n { 4.0 } else { 1.0 }
        })
        .collect();
    let found = of_trace(&made);
    let is_late = |finding: &Finding| {
        matches!(finding.kind, FindingKind::LiesIn { region: Region::PartOfRun { third: Third::Last }, .. })
    };
    assert!(found.iter().any(is_late), "{found:?}");
    assert!(found.iter().any(is_slow), "{found:?}");
}

#[test]
fn what_both_errors_say_is_said_once() {
    let made = trace(|own, _, k| 0.03 * (own.dq[k] / 1e-3).tanh(), 0.01);
    let torque = first(&made);
    let position = Finding { error: Signal::Position, share: 0.4, rank: 0.4, ..torque.clone() };
    let elsewhere = Finding { joint: 3, ..position.clone() };
    let message = super::twins_together(vec![position, elsewhere.clone(), torque.clone()]);
    assert_eq!(message.len(), 2);
    assert_eq!((message[0].error, message[0].share), (Signal::Torque, torque.share));
    assert_eq!(message[0].twin, Some(Twin { error: Signal::Position, share: 0.4 }));
    assert_eq!(message[1], elsewhere);
}

#[test]
fn what_differs_between_the_errors_is_said_twice() {
    let torque = first(&trace(|own, _, k| 0.03 * (own.dq[k] / 1e-3).tanh(), 0.01));
    let position = Finding { error: Signal::Position, ..torque.clone() };
    let parts = [Third::First, Third::Last].map(|third| Finding {
        kind: FindingKind::LiesIn { region: Region::PartOfRun { third }, also: Vec::new() },
        error: if third == Third::First { Signal::Torque } else { Signal::Position },
        ..torque.clone()
    });
    assert_eq!(super::twins_together(parts.to_vec()), parts);
    let runs = [torque.clone(), Finding { run_index: 1, ..position.clone() }];
    assert_eq!(super::twins_together(runs.to_vec()), runs, "two runs of one log");
    let in_band = |finding: &Finding, [low_hz, high_hz]: [f64; 2]| Finding {
        kind: FindingKind::LiesInBand { low_hz, high_hz },
        ..finding.clone()
    };
    let apart = [in_band(&torque, [1.0, 2.0]), in_band(&position, [5.0, 8.0])];
    assert_eq!(super::twins_together(apart.to_vec()), apart);
    let near = vec![in_band(&torque, [1.0, 2.0]), in_band(&position, [1.8, 3.0])];
    assert_eq!(super::twins_together(near).len(), 1);
}

#[test]
fn a_repetition_in_position_is_reported_with_its_period() {
    let found = first(&trace(|own, _, k| 0.01 * (14.0 * own.q[k] + 0.3).sin(), 0.004));
    let FindingKind::Repeats { period, amplitude } = found.kind else { panic!("{found:?}") };
    assert!((period * 14.0 / TAU - 1.0).abs() < 0.06, "{period}");
    assert!((amplitude / 0.01 - 1.0).abs() < 0.2, "{amplitude}");
}

#[test]
fn a_spring_is_reported_by_position() {
    let found = first(&trace(|own, _, k| 0.05 * own.q[k].powi(3), 0.002));
    let FindingKind::FollowsSmoothly { coefficients, rest } = found.kind else { panic!("{found:?}") };
    assert!((coefficients[2] - 0.05).abs() < 0.005 && rest == 0.0, "{found:?}");
}

#[test]
fn another_joints_torque_is_reported_with_the_joint() {
    let found = first(&trace(|_, other, k| -0.2 * other.command[k], 0.02));
    let FindingKind::FollowsOther { joint: 5, signal: OtherSignal::Command, per_unit } = found.kind else {
        panic!("{found:?}");
    };
    assert!((per_unit + 0.2).abs() < 0.002, "{per_unit}");
}

#[test]
fn a_drift_and_an_end_are_reported() {
    let found = first(&trace(|_, _, k| 0.02 * (k as f64 / N as f64 - 0.5), 0.002));
    let FindingKind::Drifts { change, duration_s } = found.kind else { panic!("{found:?}") };
    assert!((change - 0.02).abs() < 4e-4 && (duration_s - STEP * N as f64).abs() < 1e-9, "{found:?}");
    let mut random = Random::new(3);
    let mut late = trace(|_, _, _| 0.0, 0.0);
    late.residual = (0..N).map(|k| random.normal() * if 3 * k > 2 * N { 3.0 } else { 0.5 }).collect();
    let region = Region::PartOfRun { third: Third::Last };
    assert_eq!(first(&late).kind, FindingKind::LiesIn { region, also: Vec::new() });
}

#[test]
fn two_causes_are_reported_one_after_the_other() {
    let found = of_trace(&trace(|own, other, k| 0.03 * (own.dq[k] / 1e-3).tanh() - 0.03 * other.command[k], 0.003));
    let other_command =
        |found: &Finding| matches!(found.kind, FindingKind::FollowsOther { signal: OtherSignal::Command, .. });
    assert!(follows(&found[0], OwnSignal::SpeedSign), "{found:?}");
    assert!(found.iter().any(other_command), "{found:?}");
    let is_constant = |found: &Finding| matches!(found.kind, FindingKind::Offset { .. });
    assert!(!found.iter().any(|found| follows(found, OwnSignal::Command) || is_constant(found)), "{found:?}");
}

/// A fit without Coulomb friction makes the viscous friction too large: the error is the one minus too much of the other.
#[test]
fn a_law_that_another_one_stood_in_for_is_reported_with_its_own_size() {
    let mut made = trace(|own, _, k| 0.03 * (own.dq[k] / 1e-2).tanh(), 0.001);
    let (own, e) = (&made.own.dq, &made.residual);
    let stood_in: f64 =
        own.iter().zip(e).map(|(dq, e)| dq * e).sum::<f64>() / own.iter().map(|dq| dq * dq).sum::<f64>();
    made.residual = own.iter().zip(e).map(|(dq, e)| e - stood_in * dq).collect();
    let found = of_trace(&made);
    let [
        FindingKind::Follows { signal: OwnSignal::SpeedSign, per_unit: friction },
        FindingKind::Follows { signal: OwnSignal::Speed, per_unit: viscous },
    ] = [&found[0].kind, &found[1].kind]
    else {
        panic!("{found:?}");
    };
    assert!((friction - 0.03).abs() < 0.002, "{friction}");
    assert!((viscous + stood_in).abs() < 0.1 * stood_in, "{viscous}");
    let orders = found[..2].iter().map(|found| found.regression.as_ref().map(|step| step.order));
    assert!(orders.eq([Some(1), Some(2)]), "{found:?}");
}

#[test]
fn near_frequencies_beat() {
    let found = of_trace(&trace(
        |_, _, k| {
            let t = STEP * k as f64;
            0.01 * ((TAU * 2.1 * t).sin() + 0.8 * (TAU * 2.35 * t).sin())
        },
        0.001,
    ));
    let beat = found.iter().find_map(|finding| match finding.kind {
        FindingKind::Beats { low_hz, high_hz } => Some((low_hz, high_hz)),
        _ => None,
    });
    let (low_hz, high_hz) = beat.expect("it beats");
    // the lines are told to a bin of 1/60 Hz
    assert!((low_hz - 2.1).abs() < 0.01 && ((high_hz - low_hz).recip() - 4.0).abs() < 0.15, "{low_hz} {high_hz}");
}

#[test]
fn means_that_differ_between_runs_are_reported() {
    let mut traces: Vec<Trace> = (0..3)
        .map(|run| {
            let mut random = Random::new(90 + run);
            let mut made = trace(|_, _, _| 0.0, 0.0);
            made.residual = (0..N).map(|_| random.normal()).collect();
            made.run = format!("{run}.csv");
            made
        })
        .collect();
    assert_eq!(between_runs(&traces), []);
    traces[1].residual.iter_mut().for_each(|value| *value += 0.5);
    let found = between_runs(&traces);
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].run, "1.csv");
    let FindingKind::DiffersBetweenRuns { here, overall } = found[0].kind else { panic!("{found:?}") };
    assert!((here - 0.5).abs() < 0.06 && (overall - 0.5 / 3.0).abs() < 0.04, "{found:?}");
}

/// A run with a large and slow error hardly knows its mean: that it is off tells nothing of the others.
#[test]
fn a_mean_that_is_hardly_known_does_not_differ() {
    const STRETCH: usize = 600;
    let mut traces: Vec<Trace> = (0..3)
        .map(|run| {
            let mut random = Random::new(40 + run);
            let mut made = trace(|_, _, _| 0.0, 0.0);
            made.residual = (0..N).map(|_| random.normal()).collect();
            made.run = format!("{run}.csv");
            made
        })
        .collect();
    let mut random = Random::new(7);
    let slow: Vec<f64> = (0..N / STRETCH).map(|_| 30.0 * random.normal()).collect();
    traces[0].residual.iter_mut().enumerate().for_each(|(k, value)| *value += slow[k / STRETCH]);
    // Two standard errors of its mean.
    let off = 2.0 * 30.0 / (slow.len() as f64).sqrt() - traces[0].mean();
    traces[0].residual.iter_mut().for_each(|value| *value += off);
    assert_eq!(between_runs(&traces), []);
}

/// Without every fifth sample, and every other sample of the first quarter.
fn partly_used(mut made: Trace) -> Trace {
    made.used = (0..N).map(|k| k % 5 != 0 && (4 * k > N || k % 2 == 0)).collect();
    made.residual.iter_mut().zip(&made.used).filter(|(_, used)| !**used).for_each(|(value, _)| *value = 0.0);
    made
}

/// All that is said of errors whose causes are known, as a snapshot: whether it is right, the other tests ask.
#[test]
fn everything_that_is_found() {
    let smooth_sign = |dq: f64| (dq / 1e-3).tanh();
    let spread = |own: &Signals, k: usize| if own.dq[k].abs() < 0.15 { 3.0 } else { 0.3 };
    let noise: Vec<f64> = {
        let mut random = Random::new(29);
        (0..N).map(|_| random.normal()).collect()
    };
    let mut of_position = trace(|own, other, k| 0.03 * own.q[k].powi(2) + 0.02 * other.q[k], 0.01);
    (of_position.error, of_position.is_local) = (Signal::Position, false);
    let mut about_a_rest = trace(|own, _, k| if own.q[k] < 0.2 { 0.03 * smooth_sign(own.dq[k]) } else { 0.0 }, 0.004);
    about_a_rest.rest = 0.2;
    let mut short = trace(|own, _, k| 0.02 * own.dq[k], 0.02);
    short.used = (0..N).map(|k| k < 80).collect();
    short.residual.iter_mut().skip(80).for_each(|value| *value = 0.0);
    let lines =
        |hz: [f64; 2]| trace(|_, _, k| hz.iter().map(|hz| 0.02 * (TAU * hz * STEP * k as f64).sin()).sum(), 0.01);
    let made = [
        ("friction and too little damping", trace(|own, _, k| 0.03 * smooth_sign(own.dq[k]) - 0.01 * own.dq[k], 0.004)),
        ("drag", trace(|own, _, k| 0.01 * own.dq[k] * own.dq[k].abs() + 0.004, 0.01)),
        ("inertia and a drift", trace(|own, _, k| 0.002 * own.ddq[k] + 0.03 * k as f64 / N as f64, 0.01)),
        ("a spring that stiffens", trace(|own, _, k| 0.02 * own.q[k] + 0.05 * own.q[k].powi(3), 0.004)),
        ("friction on one side", about_a_rest),
        ("friction under load", trace(|own, _, k| 0.02 * smooth_sign(own.dq[k]) * own.command[k].abs(), 0.005)),
        ("a dead zone", trace(|own, _, k| 0.02 * (own.command[k] / 1e-3).tanh(), 0.01)),
        ("a gain", trace(|own, _, k| 0.05 * own.command[k], 0.01)),
        ("teeth and their neighbours", trace(|own, _, k| 0.01 * (23.0 * own.q[k]).sin(), 0.006)),
        ("the other joint", trace(|_, other, k| 0.004 * other.ddq[k] + 0.01 * other.dq[k], 0.01)),
        ("a shared drag", trace(|own, other, k| 0.02 * smooth_sign(own.dq[k] + other.dq[k]), 0.01)),
        ("a loose joint", trace(|own, _, k| 0.01 * noise[k] * spread(own, k), 0.0)),
        ("where it is late", trace(|_, _, k| 0.01 * noise[k] * if 3 * k > 2 * N { 3.0 } else { 0.5 }, 0.0)),
        ("two lines", lines([2.1, 2.35])),
        ("one line", lines([6.0, 6.0])),
        ("of the position", of_position),
        ("few samples", short),
        ("noise", trace(|_, _, _| 0.0, 0.01)),
    ];
    let mut text = String::new();
    for (name, made) in made {
        for (part, made) in [("", made.clone()), (", partly used", partly_used(made))] {
            text.push_str(&format!("{name}{part}\n"));
            of_trace(&made).iter().for_each(|found| text.push_str(&format!("  {}\n", in_short(found))));
        }
    }
    insta::assert_snapshot!(text);
}

/// What is found, with the digits that every machine has.
fn in_short(found: &Finding) -> String {
    let Finding { kind, share, expected, regression, rank, .. } = found;
    format!("{kind:.6?} {share:.4} of {expected:.3e} {rank:.4} {regression:?}")
}

/// Of a joint that goes up for a second and down for the next, eight times, at one speed or at twice that.
#[test]
fn regions_hold_the_samples_that_their_names_say() {
    const SECOND: usize = 120;
    let mut made = trace(|_, _, k| (k % 7) as f64, 0.0);
    let n = 16 * SECOND;
    let speed = |k: usize| {
        let second = k / SECOND;
        let size = (if second < 8 { 1.0 } else { 2.0 }) * (1.0 + 1e-6 * k as f64);
        if second.is_multiple_of(2) { size } else { -size }
    };
    made.own.dq = (0..n).map(speed).collect();
    made.own.q = (0..n).map(|k| (7 * k % n) as f64).collect();
    made.own.command = (0..n).map(|k| -((11 * k % n) as f64)).collect();
    (made.residual, made.used, made.rest) = (vec![1.0; n], vec![true; n], 400.0);
    let found = super::region::named(&made);
    let expected = |name: &str, k: usize| match name {
        // Near a turn are 7.5 % of a second on both its sides: nine samples.
        "reversals" => {
            let turn = ((k + SECOND / 2) / SECOND * SECOND) as i64;
            let from_turn = k as i64 - turn;
            (1..16).contains(&(turn / SECOND as i64)) && (-9..9).contains(&from_turn)
        }
        "low speed" => k < n / 5,
        "high speed" => k > n - n / 5,
        "end of range" => !(n / 10..=n - n / 10).contains(&(7 * k % n)),
        "below" => 7 * k % n <= 400,
        "above" => 7 * k % n > 400,
        "high command" => 11 * k % n > n - n / 5,
        "first" => 3 * k / n == 0,
        "second" => 3 * k / n == 1,
        "last" => 3 * k / n == 2,
        other => panic!("{other}"),
    };
    assert_eq!(found.len(), 10);
    for (name, inside) in found {
        let wrong: Vec<usize> = (0..n).filter(|k| inside[*k] != expected(name, *k)).collect();
        assert!(wrong.is_empty(), "{name}: {wrong:?}");
    }
}

/// What by chance lies in a band of a torque error, against noise of positions that goes the way of one: through the filter,
/// differentiated twice, through the filter again.
#[test]
fn noise_of_positions_is_expected_where_it_falls() {
    const CUTOFF_HZ: f64 = 5.0;
    let filter = Lowpass::new(CUTOFF_HZ, 1.0 / STEP).expect("below half the rate");
    let mut error = Trace { bandwidth_hz: CUTOFF_HZ, ..trace(|_, _, _| 0.0, 0.0) };
    let resolution = 1.0 / (STEP * N as f64);
    let n_seen = (CUTOFF_HZ / resolution) as usize;
    let mut random = Random::new(5);
    let mut power = vec![0.0; N / 2 + 1];
    for _ in 0..300 {
        let noise: Vec<f64> = (0..N).map(|_| random.normal()).collect();
        error.residual = filter.apply(&second_derivative(&filter.apply(&noise), STEP));
        power.iter_mut().zip(periodogram(&error)).for_each(|(sum, power)| *sum += power);
    }
    let total: f64 = power.iter().sum();
    for (from_hz, to_hz) in [(2.5, 3.0), (3.0, 3.5), (3.5, 4.0), (4.0, 4.5), (4.5, 5.0)] {
        let (from, to) = ((from_hz / resolution) as usize, (to_hz / resolution) as usize - 1);
        let white = (to + 1 - from) as f64 / n_seen as f64;
        let found = (power[from..=to].iter().sum::<f64>() / total).max(white);
        let expected = by_chance(&error, resolution, power.len(), n_seen, from, to);
        assert!((found - expected).abs() < 0.05 * found, "{from_hz} Hz: {found} {expected}");
    }
}

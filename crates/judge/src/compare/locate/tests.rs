//! Synthetic errors whose cause is known.

use std::f64::consts::TAU;

use super::{
    Finding, FindingKind, Signal, between_runs, of_trace,
    trace::{Signals, Trace},
};
use dynid_random::Random;

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
        let message: Vec<Finding> =
            of_trace(&made).into_iter().filter(|finding| finding.kind != FindingKind::Band).collect();
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
    assert_eq!(found.kind, FindingKind::Offset);
    assert!(found.what.contains("0.0200") && (found.share - 16.0 / 17.0).abs() < 0.01, "{found:?}");
}

#[test]
fn friction_is_reported_by_the_sign_of_the_speed() {
    let found = first(&trace(|own, _, k| 0.03 * (own.dq[k] / 1e-3).tanh(), 0.01));
    assert_eq!(found.kind, FindingKind::Direction, "{found:?}");
    assert!(found.share > 0.85 && found.expected < 0.01, "{found:?}");
}

#[test]
fn what_lies_at_reversals_is_reported_there() {
    let found = of_trace(&trace(|own, _, k| 0.05 * (-(own.dq[k] / 0.1).powi(2)).exp() * own.ddq[k].signum(), 0.003));
    let reversal = found
        .iter()
        .find(|finding| matches!(finding.kind, FindingKind::Reversal | FindingKind::LowSpeed))
        .expect("located");
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
    let first = &found[0];
    assert!(matches!(first.kind, FindingKind::LowSpeed | FindingKind::Reversal), "{found:?}");
    assert!(first.what.contains("that is also where it lies") && first.what.contains("reversals"), "{}", first.what);
    let of_places = |kind: FindingKind| found.iter().filter(|finding| finding.kind == kind).count();
    assert_eq!(of_places(FindingKind::LowSpeed) + of_places(FindingKind::Reversal), 1, "{found:?}");
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
    let kinds: Vec<FindingKind> = of_trace(&made).iter().map(|finding| finding.kind).collect();
    assert!(kinds.contains(&FindingKind::PartOfRun), "{kinds:?}");
    assert!(kinds.contains(&FindingKind::LowSpeed) || kinds.contains(&FindingKind::Reversal), "{kinds:?}");
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
    assert!(message[0].what.ends_with("the position error says the same (40 % of its square)"), "{}", message[0].what);
    assert_eq!(message[1], elsewhere);
}

#[test]
fn what_differs_between_the_errors_is_said_twice() {
    let torque = first(&trace(|own, _, k| 0.03 * (own.dq[k] / 1e-3).tanh(), 0.01));
    let position = Finding { error: Signal::Position, ..torque.clone() };
    let parts = ["first", "last"].map(|part| Finding {
        kind: FindingKind::PartOfRun,
        about: part.to_owned(),
        error: if part == "first" { Signal::Torque } else { Signal::Position },
        ..torque.clone()
    });
    assert_eq!(super::twins_together(parts.to_vec()), parts);
    let runs = [torque.clone(), Finding { run_index: 1, ..position.clone() }];
    assert_eq!(super::twins_together(runs.to_vec()), runs, "two runs of one log");
    let in_band = |finding: &Finding, band| Finding { kind: FindingKind::Band, band_hz: Some(band), ..finding.clone() };
    let apart = [in_band(&torque, [1.0, 2.0]), in_band(&position, [5.0, 8.0])];
    assert_eq!(super::twins_together(apart.to_vec()), apart);
    let near = vec![in_band(&torque, [1.0, 2.0]), in_band(&position, [1.8, 3.0])];
    assert_eq!(super::twins_together(near).len(), 1);
}

#[test]
fn a_repetition_in_position_is_reported_with_its_period() {
    let found = first(&trace(|own, _, k| 0.01 * (14.0 * own.q[k] + 0.3).sin(), 0.004));
    assert_eq!(found.kind, FindingKind::PeriodicPosition, "{found:?}");
    let period = TAU / 14.0;
    let message: f64 =
        found.what.split("every ").nth(1).and_then(|rest| rest.split(' ').next()).unwrap().parse().unwrap();
    assert!((message / period - 1.0).abs() < 0.06, "{message} {period}: {}", found.what);
}

#[test]
fn a_spring_is_reported_by_position() {
    let found = first(&trace(|own, _, k| 0.05 * own.q[k].powi(3), 0.002));
    assert_eq!(found.kind, FindingKind::Position, "{found:?}");
}

#[test]
fn another_joints_torque_is_reported_with_the_joint() {
    let found = first(&trace(|_, other, k| -0.2 * other.command[k], 0.02));
    assert_eq!((found.kind, found.other), (FindingKind::OtherTorque, Some(5)), "{found:?}");
    assert!(found.what.contains("\u{2212}0.199") || found.what.contains("\u{2212}0.200"), "{}", found.what);
}

#[test]
fn a_drift_and_an_end_are_reported() {
    let found = first(&trace(|_, _, k| 0.02 * (k as f64 / N as f64 - 0.5), 0.002));
    assert_eq!(found.kind, FindingKind::Drift, "{found:?}");
    let mut random = Random::new(3);
    let mut late = trace(|_, _, _| 0.0, 0.0);
    late.residual = (0..N).map(|k| random.normal() * if 3 * k > 2 * N { 3.0 } else { 0.5 }).collect();
    assert_eq!(first(&late).kind, FindingKind::PartOfRun);
}

#[test]
fn two_causes_are_reported_one_after_the_other() {
    let found = of_trace(&trace(|own, other, k| 0.03 * (own.dq[k] / 1e-3).tanh() - 0.03 * other.command[k], 0.003));
    let kinds: Vec<FindingKind> = found.iter().map(|finding| finding.kind).collect();
    assert_eq!(kinds[0], FindingKind::Direction, "{found:?}");
    assert!(kinds.contains(&FindingKind::OtherTorque), "{found:?}");
    assert!(!kinds.contains(&FindingKind::Load) && !kinds.contains(&FindingKind::Offset), "{found:?}");
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
    assert_eq!((found[0].kind, found[1].kind), (FindingKind::Direction, FindingKind::Speed), "{found:?}");
    let size = |text: &str, before: &str| -> f64 {
        let number = text.split(before).nth(1).and_then(|rest| rest.split(' ').next()).unwrap();
        number.replace('\u{2212}', "-").parse().unwrap()
    };
    assert!((size(&found[0].what, "sign of the speed, ") - 0.03).abs() < 0.002, "{}", found[0].what);
    assert!((size(&found[1].what, "follows the speed, ") + stood_in).abs() < 0.1 * stood_in, "{}", found[1].what);
    assert!(found[1].what.starts_with("besides, "), "{}", found[1].what);
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
    let beat = found.iter().find(|finding| finding.kind == FindingKind::Beat).expect("it beats");
    assert!(beat.what.contains("every 4.0") || beat.what.contains("every 3.9"), "{}", beat.what);
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
    assert_eq!((found[0].run.as_str(), found[0].kind), ("1.csv", FindingKind::BetweenRuns));
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

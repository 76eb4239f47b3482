//! Where an error lies and what it follows.

use std::f64::consts::TAU;

use dynid_format::number;
use dynid_judge::compare::{
    Finding, FindingKind,
    locate::{OtherSignal, OwnSignal, Region, Regressor, Side, Signal, Third},
};
use serde_json::Value;

/// What is found, with numbers.
pub fn sentence(finding: &Finding) -> String {
    let mut text = alone(finding);
    if let Some(twin) = &finding.twin {
        text.push_str(&format!(
            "; the {} says the same ({:.0} % of its square)",
            error(twin.error),
            100.0 * twin.share
        ));
    }
    text
}

/// The finding with its sentence, and what it is about in a word.
///
/// # Errors
/// None that these values can cause.
pub fn json(finding: &Finding) -> serde_json::Result<Value> {
    let mut json = serde_json::to_value(finding)?;
    put(finding, &mut json);
    json["what"] = sentence(finding).into();
    Ok(json)
}

/// What a finding is about, in a word, and the other joint where one has to do with it.
pub(crate) fn put(finding: &Finding, json: &mut Value) {
    json["kind"] = topic(&finding.kind).into();
    if let FindingKind::FollowsOther { joint, .. } = finding.kind {
        json["other"] = joint.into();
    }
}

/// As an error is called.
pub(crate) fn error(error: Signal) -> &'static str {
    match error {
        Signal::Torque => "torque error",
        Signal::Position => "position error",
    }
}

fn topic(kind: &FindingKind) -> &'static str {
    match kind {
        FindingKind::Follows { signal, .. } => match signal {
            OwnSignal::Position => "position",
            OwnSignal::Speed => "speed",
            OwnSignal::SpeedSquared => "speed_squared",
            OwnSignal::Acceleration => "acceleration",
            OwnSignal::SpeedSign => "direction",
            OwnSignal::LoadFriction => "load_friction",
            OwnSignal::Command => "load",
            OwnSignal::CommandSign => "load_sign",
            OwnSignal::CommandRate => "load_rate",
        },
        FindingKind::FollowsOther { signal, .. } => match signal {
            OtherSignal::Command => "other_torque",
            OtherSignal::SummedSpeedSign => "common_direction",
            OtherSignal::Position | OtherSignal::Speed | OtherSignal::Acceleration | OtherSignal::SpeedSign => {
                "other_motion"
            }
        },
        FindingKind::FollowsSmoothly { .. } => "position",
        FindingKind::HasSidedFriction { .. } => "sided_friction",
        FindingKind::Repeats { .. } => "periodic_position",
        FindingKind::Drifts { .. } => "drift",
        FindingKind::Offset { .. } => "offset",
        FindingKind::DiffersBetweenRuns { .. } => "between_runs",
        FindingKind::LiesIn { region, .. } => match region {
            Region::Reversals { .. } => "reversal",
            Region::LowSpeed { .. } => "low_speed",
            Region::HighSpeed { .. } => "high_speed",
            Region::EndOfRange { .. } => "end_of_range",
            Region::OneSide { .. } => "one_side",
            Region::HighCommand { .. } => "high_load",
            Region::PartOfRun { .. } => "part_of_run",
        },
        FindingKind::LiesInBand { .. } => "band",
        FindingKind::Beats { .. } => "beat",
    }
}

/// Without what the other error says.
fn alone(finding: &Finding) -> String {
    let Finding { unit, position_unit, share, expected, .. } = finding;
    let error = error(finding.error);
    let (share, expected) = (100.0 * share, 100.0 * expected);
    match &finding.kind {
        FindingKind::Offset { constant } => format!(
            "the {error} has a constant part of {} {unit}: {share:.0} % of the squared error ({expected:.1} % by chance)",
            number(*constant)
        ),
        FindingKind::DiffersBetweenRuns { here, overall } => format!(
            "the mean {error} differs between runs: {} {unit} here, {} over all ({share:.0} % of the squared error, \
             {expected:.1} % by chance)",
            number(*here),
            number(*overall)
        ),
        FindingKind::LiesIn { region, also } => {
            let place = |region: &Region| place(region, position_unit);
            let also: Vec<String> =
                also.iter().map(|also| format!("{} ({:.0} %)", place(&also.region), 100.0 * also.share)).collect();
            let besides = match also.is_empty() {
                true => String::new(),
                false => format!("; that is also where it lies {}", also.join(", and ")),
            };
            let place = place(region);
            format!("{share:.0} % of the squared {error} lies {place} ({expected:.0} % of the samples){besides}")
        }
        FindingKind::LiesInBand { low_hz, high_hz } => format!(
            "{share:.0} % of the squared {error} lies between {} and {} Hz ({expected:.1} % by chance)",
            number(*low_hz),
            number(*high_hz)
        ),
        FindingKind::Beats { low_hz, high_hz } => format!(
            "the {error} beats: {} and {} Hz hold {share:.0} % of its square ({expected:.1} % by chance) and meet every {} s",
            number(*low_hz),
            number(*high_hz),
            number(1.0 / (high_hz - low_hz))
        ),
        _ => {
            let is_first = finding.regression.as_ref().is_none_or(|step| step.order <= 1);
            let (besides, more) = if is_first { ("", "") } else { ("besides, ", "more ") };
            let nearly: Vec<String> = finding
                .regression
                .iter()
                .flat_map(|step| &step.nearly)
                .map(|nearly| name(*nearly, finding.joint))
                .collect();
            let nearly = match nearly.is_empty() {
                true => String::new(),
                false => format!("; {} would explain nearly as much", nearly.join(", ")),
            };
            format!(
                "{besides}the {error} {}: {share:.0} % {more}of the squared error ({expected:.1} % by chance){nearly}",
                followed(finding)
            )
        }
    }
}

/// What the error does, as a predicate.
fn followed(finding: &Finding) -> String {
    let Finding { unit, position_unit, .. } = finding;
    match &finding.kind {
        FindingKind::Follows { signal, per_unit } => follows(finding, *signal, *per_unit),
        FindingKind::FollowsOther { joint, signal, per_unit } => {
            let name = name(Regressor::Other { joint: *joint, signal: *signal }, finding.joint);
            format!("follows {name}, {} {unit} per unit of it", number(*per_unit))
        }
        FindingKind::FollowsSmoothly { coefficients: [first, second, third], .. } => format!(
            "is a smooth function of the position, ({}) d + ({}) d^2 + ({}) d^3 {unit} with d in {position_unit} from where the \
             joint rests",
            number(*first),
            number(*second),
            number(*third)
        ),
        FindingKind::HasSidedFriction { amplitude, rest } => format!(
            "has the sign of the speed, {} {unit}, only below {}, where the joint rests",
            number(*amplitude),
            number(*rest)
        ),
        FindingKind::Repeats { period, amplitude } => {
            let turns = match position_unit.as_str() {
                "rad" => format!(", {} times a turn", number(TAU / period)),
                _ => String::new(),
            };
            format!(
                "repeats with the position every {} {position_unit}{turns}, amplitude {} {unit}",
                number(*period),
                number(*amplitude)
            )
        }
        FindingKind::Drifts { change, duration_s } => {
            format!("drifts by {} {unit} during the {duration_s:.0} s of the run", number(*change))
        }
        // Said as a whole, not as a predicate.
        FindingKind::Offset { .. }
        | FindingKind::DiffersBetweenRuns { .. }
        | FindingKind::LiesIn { .. }
        | FindingKind::LiesInBand { .. }
        | FindingKind::Beats { .. } => String::new(),
    }
}

fn follows(finding: &Finding, signal: OwnSignal, per_unit: f64) -> String {
    let Finding { unit, position_unit, .. } = finding;
    let size = number(per_unit);
    match signal {
        OwnSignal::Position => {
            format!("grows with the position, {size} {unit} per {position_unit}, as a spring does")
        }
        OwnSignal::Speed => format!("follows the speed, {size} {unit} per {position_unit}/s"),
        OwnSignal::SpeedSquared => {
            format!("follows the speed squared, with its sign, {size} {unit} per ({position_unit}/s)^2")
        }
        OwnSignal::Acceleration => {
            format!("follows the acceleration, as inertia does, {size} {unit} per {position_unit}/s^2")
        }
        OwnSignal::SpeedSign => format!("has the sign of the speed, {size} {unit}, as friction has"),
        OwnSignal::LoadFriction => {
            format!("has the sign of the speed and the size of the commanded torque, {size} {unit} per unit of it")
        }
        OwnSignal::Command => format!("follows the commanded torque, {size} {unit} per unit of it"),
        OwnSignal::CommandSign => {
            format!("has the sign of the commanded torque, {size} {unit}, as after a dead zone")
        }
        OwnSignal::CommandRate => {
            let is_late = finding.error == Signal::Torque && per_unit > 0.0;
            let late = if is_late { format!(", as if it came {size} s late") } else { String::new() };
            format!("follows the rate of the commanded torque, {size} {unit} s per unit of it{late}")
        }
    }
}

/// As a regressor is called, for an error at joint `own`.
fn name(regressor: Regressor, own: usize) -> String {
    match regressor {
        Regressor::Own { signal } => match signal {
            OwnSignal::Position => "the position",
            OwnSignal::Speed => "the speed",
            OwnSignal::SpeedSquared => "the speed squared",
            OwnSignal::Acceleration => "the acceleration",
            OwnSignal::SpeedSign => "the sign of the speed",
            OwnSignal::LoadFriction => "friction that grows with the load",
            OwnSignal::Command => "the commanded torque",
            OwnSignal::CommandSign => "the sign of the commanded torque",
            OwnSignal::CommandRate => "a delay of the commanded torque",
        }
        .to_owned(),
        Regressor::Other { joint, signal } => match signal {
            OtherSignal::Command => format!("joint {joint}'s commanded torque"),
            OtherSignal::Position => format!("joint {joint}'s position"),
            OtherSignal::Speed => format!("joint {joint}'s speed"),
            OtherSignal::Acceleration => format!("joint {joint}'s acceleration"),
            OtherSignal::SpeedSign => format!("the sign of joint {joint}'s speed"),
            OtherSignal::SummedSpeedSign => format!("the sign of the summed speed of joints {own} and {joint}"),
        },
        Regressor::SmoothPosition => "a smooth function of the position".to_owned(),
        Regressor::SidedFriction => "friction on one side of the rest position".to_owned(),
        Regressor::Repetition => "a repetition in position".to_owned(),
        Regressor::Time => "the time".to_owned(),
    }
}

/// As in "lies ..".
fn place(region: &Region, position_unit: &str) -> String {
    match region {
        Region::Reversals { within_s, count } => {
            format!("within {} s of its {count} velocity reversals", number(*within_s))
        }
        Region::LowSpeed { below } => format!("at speeds below {} {position_unit}/s", number(*below)),
        Region::HighSpeed { above } => format!("at speeds above {} {position_unit}/s", number(*above)),
        Region::EndOfRange { below, above } => {
            format!("below {} or above {} {position_unit}", number(*below), number(*above))
        }
        Region::OneSide { side, rest } => {
            let side = match side {
                Side::Below => "below",
                Side::Above => "above",
            };
            format!("{side} {} {position_unit}, where the joint rests", number(*rest))
        }
        Region::HighCommand { above } => format!("at commanded torques above {}", number(*above)),
        Region::PartOfRun { third } => {
            let third = match third {
                Third::First => "first",
                Third::Second => "second",
                Third::Last => "last",
            };
            format!("in the {third} third of the run")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_judge::compare::locate::{AlsoIn, RegressionStep, Twin};

    fn finding(kind: FindingKind) -> Finding {
        Finding {
            run: "a.csv".to_owned(),
            joint: 4,
            error: Signal::Torque,
            unit: "N*m".to_owned(),
            position_unit: "rad".to_owned(),
            kind,
            share: 0.434,
            expected: 0.0021,
            regression: None,
            twin: None,
            run_index: 0,
            rank: 0.0,
        }
    }

    /// As said, and called in a word.
    fn said(kind: FindingKind) -> (String, &'static str) {
        (alone(&finding(kind.clone())), topic(&kind))
    }

    /// A finding of a regression: what stands between the error's name and its share.
    fn predicate(kind: FindingKind) -> (String, &'static str) {
        let (text, topic) = said(kind);
        let text = text.strip_prefix("the torque error ").expect("of the torque error");
        let text = text.strip_suffix(": 43 % of the squared error (0.2 % by chance)").expect("with shares");
        (text.to_owned(), topic)
    }

    #[test]
    fn every_signal_of_the_joint_is_said() {
        let follows = |signal| predicate(FindingKind::Follows { signal, per_unit: 0.03 });
        for (signal, text, topic) in [
            (OwnSignal::Position, "grows with the position, 0.03000 N*m per rad, as a spring does", "position"),
            (OwnSignal::Speed, "follows the speed, 0.03000 N*m per rad/s", "speed"),
            (
                OwnSignal::SpeedSquared,
                "follows the speed squared, with its sign, 0.03000 N*m per (rad/s)^2",
                "speed_squared",
            ),
            (
                OwnSignal::Acceleration,
                "follows the acceleration, as inertia does, 0.03000 N*m per rad/s^2",
                "acceleration",
            ),
            (OwnSignal::SpeedSign, "has the sign of the speed, 0.03000 N*m, as friction has", "direction"),
            (
                OwnSignal::LoadFriction,
                "has the sign of the speed and the size of the commanded torque, 0.03000 N*m per unit of it",
                "load_friction",
            ),
            (OwnSignal::Command, "follows the commanded torque, 0.03000 N*m per unit of it", "load"),
            (
                OwnSignal::CommandSign,
                "has the sign of the commanded torque, 0.03000 N*m, as after a dead zone",
                "load_sign",
            ),
            (
                OwnSignal::CommandRate,
                "follows the rate of the commanded torque, 0.03000 N*m s per unit of it, as if it came 0.03000 s late",
                "load_rate",
            ),
        ] {
            assert_eq!(follows(signal), (text.to_owned(), topic));
        }
        let early = predicate(FindingKind::Follows { signal: OwnSignal::CommandRate, per_unit: -0.03 }).0;
        assert_eq!(early, "follows the rate of the commanded torque, \u{2212}0.03000 N*m s per unit of it");
    }

    #[test]
    fn every_signal_of_another_joint_is_said() {
        for (signal, name, topic) in [
            (OtherSignal::Command, "joint 5's commanded torque", "other_torque"),
            (OtherSignal::Position, "joint 5's position", "other_motion"),
            (OtherSignal::Speed, "joint 5's speed", "other_motion"),
            (OtherSignal::Acceleration, "joint 5's acceleration", "other_motion"),
            (OtherSignal::SpeedSign, "the sign of joint 5's speed", "other_motion"),
            (OtherSignal::SummedSpeedSign, "the sign of the summed speed of joints 4 and 5", "common_direction"),
        ] {
            let own = predicate(FindingKind::FollowsOther { joint: 5, signal, per_unit: -0.2 });
            assert_eq!(own, (format!("follows {name}, \u{2212}0.2000 N*m per unit of it"), topic));
        }
    }

    #[test]
    fn every_other_law_is_said() {
        let smooth = FindingKind::FollowsSmoothly { coefficients: [0.1, -0.2, 0.05], rest: 0.3 };
        let sided = FindingKind::HasSidedFriction { amplitude: 0.02, rest: 0.3 };
        for (kind, text, topic) in [
            (
                smooth,
                "is a smooth function of the position, (0.1000) d + (\u{2212}0.2000) d^2 + (0.05000) d^3 N*m with d in rad \
                 from where the joint rests",
                "position",
            ),
            (
                sided,
                "has the sign of the speed, 0.02000 N*m, only below 0.3000, where the joint rests",
                "sided_friction",
            ),
            (
                FindingKind::Repeats { period: 0.5, amplitude: 0.01 },
                "repeats with the position every 0.5000 rad, 12.57 times a turn, amplitude 0.01000 N*m",
                "periodic_position",
            ),
            (
                FindingKind::Drifts { change: 0.02, duration_s: 60.0 },
                "drifts by 0.02000 N*m during the 60 s of the run",
                "drift",
            ),
            (FindingKind::Offset { constant: 0.02 }, "has a constant part of 0.02000 N*m", "offset"),
        ] {
            assert_eq!(predicate(kind), (text.to_owned(), topic));
        }
        let along =
            Finding { position_unit: "m".to_owned(), ..finding(FindingKind::Repeats { period: 0.5, amplitude: 0.01 }) };
        assert!(followed(&along).starts_with("repeats with the position every 0.5000 m, amplitude"), "no turns");
        let between = FindingKind::DiffersBetweenRuns { here: 0.5, overall: 0.17 };
        let text = "the mean torque error differs between runs: 0.5000 N*m here, 0.1700 over all (43 % of the squared error, \
                    0.2 % by chance)";
        assert_eq!(said(between), (text.to_owned(), "between_runs"));
    }

    #[test]
    fn every_place_is_said() {
        let lies = |region| said(FindingKind::LiesIn { region, also: Vec::new() });
        for (region, place, topic) in [
            (
                Region::Reversals { within_s: 0.05, count: 38 },
                "within 0.05000 s of its 38 velocity reversals",
                "reversal",
            ),
            (Region::LowSpeed { below: 0.2 }, "at speeds below 0.2000 rad/s", "low_speed"),
            (Region::HighSpeed { above: 2.0 }, "at speeds above 2.000 rad/s", "high_speed"),
            (
                Region::EndOfRange { below: -0.4, above: 0.5 },
                "below \u{2212}0.4000 or above 0.5000 rad",
                "end_of_range",
            ),
            (Region::OneSide { side: Side::Below, rest: 0.1 }, "below 0.1000 rad, where the joint rests", "one_side"),
            (Region::OneSide { side: Side::Above, rest: 0.1 }, "above 0.1000 rad, where the joint rests", "one_side"),
            (Region::HighCommand { above: 0.7 }, "at commanded torques above 0.7000", "high_load"),
            (Region::PartOfRun { third: Third::First }, "in the first third of the run", "part_of_run"),
            (Region::PartOfRun { third: Third::Second }, "in the second third of the run", "part_of_run"),
            (Region::PartOfRun { third: Third::Last }, "in the last third of the run", "part_of_run"),
        ] {
            let text = format!("43 % of the squared torque error lies {place} (0 % of the samples)");
            assert_eq!(lies(region), (text, topic));
        }
        let slow = AlsoIn { region: Region::LowSpeed { below: 0.2 }, share: 0.31 };
        let end = AlsoIn { region: Region::EndOfRange { below: -0.4, above: 0.5 }, share: 0.3 };
        let region = Region::PartOfRun { third: Third::Last };
        let (text, _) = said(FindingKind::LiesIn { region, also: vec![slow, end] });
        let also = "; that is also where it lies at speeds below 0.2000 rad/s (31 %), and below \u{2212}0.4000 or above 0.5000 \
                    rad (30 %)";
        assert!(text.ends_with(also), "{text}");
    }

    #[test]
    fn frequencies_are_said() {
        let band = FindingKind::LiesInBand { low_hz: 2.0, high_hz: 4.0 };
        let text = "43 % of the squared torque error lies between 2.000 and 4.000 Hz (0.2 % by chance)";
        assert_eq!(said(band), (text.to_owned(), "band"));
        let beat = FindingKind::Beats { low_hz: 2.0, high_hz: 2.25 };
        let text = "the torque error beats: 2.000 and 2.250 Hz hold 43 % of its square (0.2 % by chance) and meet every 4.000 s";
        assert_eq!(said(beat), (text.to_owned(), "beat"));
    }

    #[test]
    fn a_later_step_a_rival_and_a_twin_are_said_beside_it() {
        let nearly = vec![
            Regressor::Own { signal: OwnSignal::SpeedSign },
            Regressor::Other { joint: 5, signal: OtherSignal::SummedSpeedSign },
            Regressor::SmoothPosition,
        ];
        let kind = FindingKind::Follows { signal: OwnSignal::Speed, per_unit: 0.03 };
        let twin = Some(Twin { error: Signal::Position, share: 0.4 });
        let regression = Some(RegressionStep { order: 2, nearly });
        let own = Finding { regression, twin, ..finding(kind.clone()) };
        assert_eq!(
            sentence(&own),
            "besides, the torque error follows the speed, 0.03000 N*m per rad/s: 43 % more of the squared error (0.2 % by \
             chance); the sign of the speed, the sign of the summed speed of joints 4 and 5, a smooth function of the position \
             would explain nearly as much; the position error says the same (40 % of its square)"
        );
        let first = Finding { regression: Some(RegressionStep { order: 1, nearly: Vec::new() }), ..finding(kind) };
        assert!(sentence(&first).starts_with("the torque error follows"));
    }

    #[test]
    fn every_regressor_has_a_name() {
        let own = |signal| name(Regressor::Own { signal }, 4);
        for (signal, expected) in [
            (OwnSignal::Position, "the position"),
            (OwnSignal::Speed, "the speed"),
            (OwnSignal::SpeedSquared, "the speed squared"),
            (OwnSignal::Acceleration, "the acceleration"),
            (OwnSignal::SpeedSign, "the sign of the speed"),
            (OwnSignal::LoadFriction, "friction that grows with the load"),
            (OwnSignal::Command, "the commanded torque"),
            (OwnSignal::CommandSign, "the sign of the commanded torque"),
            (OwnSignal::CommandRate, "a delay of the commanded torque"),
        ] {
            assert_eq!(own(signal), expected);
        }
        assert_eq!(name(Regressor::SmoothPosition, 4), "a smooth function of the position");
        assert_eq!(name(Regressor::SidedFriction, 4), "friction on one side of the rest position");
        assert_eq!(name(Regressor::Repetition, 4), "a repetition in position");
        assert_eq!(name(Regressor::Time, 4), "the time");
    }

    #[test]
    fn a_finding_stands_in_json_as_sentence_and_typed() {
        let own = finding(FindingKind::FollowsOther { joint: 5, signal: OtherSignal::Command, per_unit: -0.2 });
        let json = json(&own).expect("plain values");
        let typed = serde_json::json!({ "kind": "follows_other", "joint": 5, "signal": "command", "per_unit": -0.2 });
        assert_eq!(json["finding"], typed);
        assert_eq!((&json["kind"], &json["other"]), (&"other_torque".into(), &5.into()));
        assert_eq!(json["what"], sentence(&own));
        assert_eq!((&json["error"], &json["share"]), (&"torque".into(), &0.434.into()));
        let alone = super::json(&finding(FindingKind::Offset { constant: 0.02 })).expect("plain values");
        assert!(alone.get("other").is_none(), "no other joint has to do with it: {alone}");
    }
}

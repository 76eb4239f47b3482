//! How far a model is from its logs, and what that means.

use dynid_format::number;
use dynid_judge::compare::{
    Comparison, CorrelationOutcome, Finding, InputCorrelation, JointComparison, Meaning, Remainder, RunComparison,
    RunNote, locate::Signal,
};
use dynid_judge::predictions::{Predicted, Predictions};
use serde_json::Value;

use crate::{all, each, finding};

/// Why an error of a run is missing or means little.
pub fn note(note: &RunNote) -> String {
    match note {
        RunNote::NoTorqueError { reason } => format!("no torque error: {reason}"),
        RunNote::SensorsNotInTorqueError => {
            "the torque error takes the logged positions for the true ones: the model's sensor effects are not in it"
                .to_owned()
        }
        RunNote::NoPositionError { error } => format!("no position error: {error}"),
        RunNote::SimulationLost => {
            "the simulation from the commanded torque drifts away from the log: judge by the torque error".to_owned()
        }
    }
}

/// All notes of a run.
pub fn notes(run: &RunComparison) -> Vec<String> {
    all(&run.notes, note)
}

/// What a number of a joint means.
pub fn meaning(meaning: &Meaning) -> String {
    match meaning {
        Meaning::SimulationLost => {
            "The simulation has lost the log, so the size of the position error means nothing.".to_owned()
        }
        Meaning::PositionError { times_noise, left } => {
            let times = if times_noise.is_finite() { format!("{times_noise:.2} times") } else { "above".to_owned() };
            let left = match left {
                Remainder::Nothing => "nothing is left to explain",
                Remainder::Little => "little is left",
                Remainder::Something => "the model misses something",
            };
            format!("The position error is {times} the noise of the log: {left}.")
        }
        Meaning::White { statistic, bound } => {
            format!("What is left has no pattern in time (Ljung-Box {statistic:.1}, below {bound:.1}).")
        }
        Meaning::Patterned { statistic, bound } => {
            format!("What is left has a pattern in time (Ljung-Box {statistic:.1}; noise stays below {bound:.1}).")
        }
        Meaning::TorqueUnexplained { percent } => {
            format!("The model leaves {percent:.1} % of the commanded torque unexplained.")
        }
        Meaning::FollowsNoInput => {
            "What is left goes along with no commanded torque more than chance would.".to_owned()
        }
        Meaning::FollowsInput { correlation: own } => correlation(own),
    }
}

/// What all numbers of a joint mean.
pub fn meanings(joint: &JointComparison) -> Vec<String> {
    all(&joint.means, meaning)
}

/// What predictions from each sample to the next leave.
pub fn predictions(predictions: &Predictions) -> Vec<String> {
    let of_role = |predicted: &Option<Predicted>, runs: &str| {
        let own = predicted.as_ref()?;
        let (joint, times) = own.worst()?;
        let correction = own.joints.iter().find(|own| own.joint == joint).map_or(0.0, |own| 100.0 * own.correction);
        let trust = match correction {
            share if share < 0.5 => "the model is trusted altogether".to_owned(),
            share => format!("{share:.0} % of an error corrects the next prediction"),
        };
        Some(format!(
            "One sample ahead, {runs}: at most {times:.2} times the noise of the logs (joint {joint}; {trust})."
        ))
    };
    let roles = [(&predictions.fit, "runs to fit to"), (&predictions.validate, "held-out runs")];
    roles.into_iter().filter_map(|(predicted, runs)| of_role(predicted, runs)).collect()
}

/// Whether an error goes along with a commanded torque.
pub fn correlation(correlation: &InputCorrelation) -> String {
    let InputCorrelation { error, input, lag_s, value, bound, outcome } = correlation;
    let error = match error {
        Signal::Torque => "torque",
        Signal::Position => "position",
    };
    let (lag_s, value, bound) = (number(*lag_s), number(*value), number(*bound));
    match outcome {
        CorrelationOutcome::Significant => format!(
            "The {error} error goes along with joint {input}'s commanded torque ({value} at {lag_s} s; chance stays below \
             {bound}): the model misses part of what that torque does."
        ),
        CorrelationOutcome::Undecidable => format!(
            "Whether the {error} error goes along with joint {input}'s commanded torque cannot be decided: both repeat too few \
             times ({value} at {lag_s} s; chance stays below {bound})."
        ),
        CorrelationOutcome::Insignificant => format!(
            "The {error} error does not go along with joint {input}'s commanded torque ({value}; chance stays below {bound})."
        ),
    }
}

/// The comparison, and where the two part, as [`dynid_judge::compare::locate()`] finds it.
///
/// # Errors
/// None that these values can cause.
pub fn json(comparison: &Comparison, own: &Predictions, found: &[Finding]) -> serde_json::Result<Value> {
    let mut json = serde_json::to_value(comparison)?;
    json["predictions"] = serde_json::to_value(own)?;
    json["predictions"]["what"] = predictions(own).into();
    each(&mut json, "runs", &comparison.runs, |run, json| {
        json["notes"] = notes(run).into();
        each(json, "joints", &run.joints, |joint, json| {
            json["means"] = meanings(joint).into();
            each(json, "inputs", &joint.inputs, |input, json| {
                json["what"] = correlation(input).into();
                Ok(())
            })
        })
    })?;
    json["where"] = findings_json(found)?;
    Ok(json)
}

/// Findings, in their order.
///
/// # Errors
/// None that these values can cause.
pub fn findings_json(found: &[Finding]) -> serde_json::Result<Value> {
    found.iter().map(finding::json).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_judge::predictions::PredictedJoint;
    use dynid_logs::motion::MotionError;

    fn input(value: f64, bound: f64, outcome: CorrelationOutcome) -> InputCorrelation {
        InputCorrelation { error: Signal::Torque, input: 5, lag_s: 0.08, value, bound, outcome }
    }

    #[test]
    fn every_note_is_said() {
        let reason = MotionError::Gap { file: "a.csv".to_owned(), from: 1.0, to: 2.0 };
        let said = [
            (
                RunNote::NoTorqueError { reason },
                "no torque error: a.csv: nothing is logged from 1 s to 2 s, too long to go across; keep the part before or \
                 after it (rows = [from, to])",
            ),
            (
                RunNote::SensorsNotInTorqueError,
                "the torque error takes the logged positions for the true ones: the model's sensor effects are not in it",
            ),
            (RunNote::NoPositionError { error: "it diverges".to_owned() }, "no position error: it diverges"),
            (
                RunNote::SimulationLost,
                "the simulation from the commanded torque drifts away from the log: judge by the torque error",
            ),
        ];
        for (typed, expected) in said {
            assert_eq!(note(&typed), expected);
        }
    }

    #[test]
    fn every_meaning_is_said() {
        let error = |times_noise, left| Meaning::PositionError { times_noise, left };
        let significant = input(-0.9, 0.1, CorrelationOutcome::Significant);
        let said = [
            (
                Meaning::SimulationLost,
                "The simulation has lost the log, so the size of the position error means nothing.",
            ),
            (
                error(1.0, Remainder::Nothing),
                "The position error is 1.00 times the noise of the log: nothing is left to explain.",
            ),
            (error(1.5, Remainder::Little), "The position error is 1.50 times the noise of the log: little is left."),
            (
                error(f64::INFINITY, Remainder::Something),
                "The position error is above the noise of the log: the model misses something.",
            ),
            (
                Meaning::White { statistic: 20.0, bound: 37.566 },
                "What is left has no pattern in time (Ljung-Box 20.0, below 37.6).",
            ),
            (
                Meaning::Patterned { statistic: 90.0, bound: 37.566 },
                "What is left has a pattern in time (Ljung-Box 90.0; noise stays below 37.6).",
            ),
            (
                Meaning::TorqueUnexplained { percent: 12.34 },
                "The model leaves 12.3 % of the commanded torque unexplained.",
            ),
            (Meaning::FollowsNoInput, "What is left goes along with no commanded torque more than chance would."),
            (Meaning::FollowsInput { correlation: significant.clone() }, &correlation(&significant)),
        ];
        for (typed, expected) in said {
            assert_eq!(meaning(&typed), expected);
        }
    }

    #[test]
    fn every_correlation_is_said() {
        let said = [
            (
                input(-0.9, 0.1, CorrelationOutcome::Significant),
                "The torque error goes along with joint 5's commanded torque (\u{2212}0.9000 at 0.08000 s; chance stays below \
                 0.1000): the model misses part of what that torque does.",
            ),
            (
                input(0.4, 0.6, CorrelationOutcome::Undecidable),
                "Whether the torque error goes along with joint 5's commanded torque cannot be decided: both repeat too few \
                 times (0.4000 at 0.08000 s; chance stays below 0.6000).",
            ),
            (
                InputCorrelation { error: Signal::Position, ..input(0.05, 0.1, CorrelationOutcome::Insignificant) },
                "The position error does not go along with joint 5's commanded torque (0.05000; chance stays below 0.1000).",
            ),
        ];
        for (typed, expected) in said {
            assert_eq!(correlation(&typed), expected);
        }
    }

    #[test]
    fn notes_meanings_and_correlations_stand_in_json_as_sentences_and_typed() {
        let own = input(0.05, 0.1, CorrelationOutcome::Insignificant);
        let joint = JointComparison {
            joint: 4,
            rmse: Some(2e-3),
            fit_percent: None,
            max_abs: None,
            noise_floor: 1e-3,
            white: true,
            torque_rmse: None,
            torque_percent: None,
            whiteness: None,
            inputs: vec![own.clone()],
            means: vec![Meaning::FollowsNoInput],
        };
        let run = RunComparison {
            file: "a.csv".to_owned(),
            role: "fit".to_owned(),
            joints: vec![joint],
            cutoff_hz: None,
            torque_cutoff_hz: None,
            notes: vec![RunNote::SimulationLost],
            lost: true,
            simulated: None,
            torque: Vec::new(),
        };
        let comparison = Comparison {
            runs: vec![run],
            rmse_fit: None,
            rmse_validate: None,
            torque_percent_fit: None,
            torque_percent_validate: None,
        };
        let joint = PredictedJoint {
            joint: 4,
            deviation: 2e-3,
            noise_floor: 1e-3,
            times_noise: Some(2.0),
            correction: 0.25,
            whiteness: 1.0,
        };
        let fit = Some(Predicted { log_likelihood: 1.0, samples: 10.0, joints: vec![joint] });
        let json = json(&comparison, &Predictions { fit, validate: None }, &[]).expect("plain values");
        let one_ahead = "One sample ahead, runs to fit to: at most 2.00 times the noise of the logs (joint 4; 25 % of an error \
                         corrects the next prediction).";
        assert_eq!(json["predictions"]["what"], serde_json::json!([one_ahead]));
        assert_eq!(json["predictions"]["fit"]["joints"][0]["times_noise"], 2.0);
        let run = &json["runs"][0];
        assert_eq!(run["notes"], serde_json::json!([note(&RunNote::SimulationLost)]));
        assert_eq!(run["typed_notes"], serde_json::json!([{ "kind": "simulation_lost" }]));
        let joint = &run["joints"][0];
        assert_eq!(joint["means"], serde_json::json!([meaning(&Meaning::FollowsNoInput)]));
        assert_eq!(joint["typed_means"], serde_json::json!([{ "kind": "follows_no_input" }]));
        assert_eq!(joint["inputs"][0]["what"], correlation(&own));
        assert_eq!(joint["inputs"][0]["outcome"], "insignificant");
        assert_eq!(json["where"], serde_json::json!([]));
    }
}

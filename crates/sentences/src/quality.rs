//! What a log is worth.

use dynid_logs::quality::{LEAST_RANGE_IN_NOISES, LEAST_REVERSALS, Quality, QualityWarning};
use serde_json::Value;

use crate::all;

/// One warning.
pub fn warning(warning: &QualityWarning) -> String {
    match warning {
        QualityWarning::Gaps { count, longest_s } => format!("{count} gaps, the longest {longest_s:.4} s"),
        QualityWarning::UnevenSampling { percent } => format!("the sample time varies by {percent:.0} % of itself"),
        QualityWarning::ConstantPosition { joint } => format!("q{joint} is constant although joint {joint} is free"),
        QualityWarning::HardlyMoves { joint, .. } => {
            format!("joint {joint} hardly moves: its range is below {LEAST_RANGE_IN_NOISES:.0} times the noise")
        }
        QualityWarning::FewReversals { joint, .. } => {
            format!("joint {joint} reverses fewer than {LEAST_REVERSALS} times, which tells little of friction")
        }
        QualityWarning::ConstantCommand { joint } => format!("tau{joint} is constant"),
        QualityWarning::Saturated { joint, percent } => {
            format!("tau{joint} stands at its largest size for {percent:.0} % of the run: it may be cut off there")
        }
    }
}

/// All that is known of a log.
///
/// # Errors
/// None that these values can cause.
pub fn json(quality: &Quality) -> serde_json::Result<Value> {
    let mut json = serde_json::to_value(quality)?;
    json["warnings"] = all(&quality.warnings, warning).into();
    Ok(json)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_warning_is_said() {
        let said = [
            (QualityWarning::Gaps { count: 2, longest_s: 0.51 }, "2 gaps, the longest 0.5100 s"),
            (QualityWarning::UnevenSampling { percent: 12.4 }, "the sample time varies by 12 % of itself"),
            (QualityWarning::ConstantPosition { joint: 4 }, "q4 is constant although joint 4 is free"),
            (
                QualityWarning::HardlyMoves { joint: 4, range_in_noises: 7.3 },
                "joint 4 hardly moves: its range is below 10 times the noise",
            ),
            (
                QualityWarning::FewReversals { joint: 4, reversals: 2 },
                "joint 4 reverses fewer than 4 times, which tells little of friction",
            ),
            (QualityWarning::ConstantCommand { joint: 4 }, "tau4 is constant"),
            (
                QualityWarning::Saturated { joint: 4, percent: 39.85 },
                "tau4 stands at its largest size for 40 % of the run: it may be cut off there",
            ),
        ];
        for (typed, expected) in said {
            assert_eq!(warning(&typed), expected);
        }
    }

    #[test]
    fn a_warning_stands_in_json_as_sentence_and_typed() {
        let quality = Quality {
            run: "a.csv".to_owned(),
            role: "fit".to_owned(),
            n_samples: 100,
            duration_s: 1.0,
            rate_hz: 100.0,
            jitter_s: 0.0,
            gaps: 0,
            longest_step_s: 0.01,
            joints: Vec::new(),
            warnings: vec![QualityWarning::Saturated { joint: 4, percent: 12.5 }],
        };
        let json = json(&quality).expect("plain values");
        assert_eq!(json["typed_warnings"], serde_json::json!([{ "kind": "saturated", "joint": 4, "percent": 12.5 }]));
        assert_eq!(json["warnings"], serde_json::json!([warning(&quality.warnings[0])]));
        assert_eq!(json["run"], "a.csv");
    }
}

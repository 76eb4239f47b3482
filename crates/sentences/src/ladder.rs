//! What should be known of a ladder of models.

use dynid_judge::ladder::{Ladder, LadderNote};
use serde_json::Value;

use crate::all;

/// What the Bayesian information criterion of a ladder is, as it is reported with the numbers.
pub const FORMULA: &str = "BIC = -2 log L + k ln n; L: likelihood of the runs to fit to under one-step predictions; n: their samples; \
                           k: free parameters";

/// One note.
pub fn note(note: &LadderNote) -> String {
    match note {
        LadderNote::NothingHeldOut => {
            "no run is held out (role = \"validate\"), so a lower error may only be more parameters".to_owned()
        }
        LadderNote::SimulationsLost { models } => {
            format!("simulations of {} drift away from a log: judge by the torque error", models.join(", "))
        }
        LadderNote::NotAChild { model, before, parent_digest, before_digest } => format!(
            "{model} is not the child of {before}: its [fit] names the model {parent_digest:.12}.. as parent, {before} is \
             {before_digest:.12}.."
        ),
        LadderNote::UnknownDescent { model, before } => {
            format!("{model} has no [fit], so nothing says that it comes from {before}")
        }
        LadderNote::NotFittedYet { model, before } => {
            format!("{model} is {before} with effects added, not fitted yet")
        }
        LadderNote::FittedToDifferentLogs => "the models were not all fitted to the same samples".to_owned(),
    }
}

/// All notes of a ladder.
pub fn notes(ladder: &Ladder) -> Vec<String> {
    all(&ladder.notes, note)
}

/// The ladder.
///
/// # Errors
/// None that these values can cause.
pub fn json(ladder: &Ladder) -> serde_json::Result<Value> {
    let mut json = serde_json::to_value(ladder)?;
    json["bic_formula"] = FORMULA.into();
    json["notes"] = notes(ladder).into();
    Ok(json)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_note_is_said() {
        let (model, before) = ("better".to_owned(), "fitted".to_owned());
        let said = [
            (
                LadderNote::NothingHeldOut,
                "no run is held out (role = \"validate\"), so a lower error may only be more parameters",
            ),
            (
                LadderNote::SimulationsLost { models: vec![before.clone(), model.clone()] },
                "simulations of fitted, better drift away from a log: judge by the torque error",
            ),
            (
                LadderNote::NotAChild {
                    model: model.clone(),
                    before: before.clone(),
                    parent_digest: "0123456789abcdef".to_owned(),
                    before_digest: "fedcba9876543210".to_owned(),
                },
                "better is not the child of fitted: its [fit] names the model 0123456789ab.. as parent, fitted is \
                 fedcba987654..",
            ),
            (
                LadderNote::UnknownDescent { model: model.clone(), before: before.clone() },
                "better has no [fit], so nothing says that it comes from fitted",
            ),
            (LadderNote::NotFittedYet { model, before }, "better is fitted with effects added, not fitted yet"),
            (LadderNote::FittedToDifferentLogs, "the models were not all fitted to the same samples"),
        ];
        for (typed, expected) in said {
            assert_eq!(note(&typed), expected);
        }
    }

    #[test]
    fn a_note_stands_in_json_as_sentence_and_typed() {
        let ladder = Ladder {
            rungs: Vec::new(),
            noise_floor: None,
            bic_error: None,
            independent_samples: None,
            notes: vec![LadderNote::NothingHeldOut],
        };
        let json = json(&ladder).expect("plain values");
        assert_eq!(json["typed_notes"], serde_json::json!([{ "kind": "nothing_held_out" }]));
        assert_eq!(json["notes"], serde_json::json!([note(&LadderNote::NothingHeldOut)]));
        assert_eq!(json["bic_formula"], FORMULA);
    }
}

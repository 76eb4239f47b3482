//! What a fit found, for programs.

use dynid_identify::identify::{FitResult, FittedParameter};
use dynid_judge::compare::Comparison;
use dynid_user_model::Model;
use serde_json::{Value, json};

/// The fit as JSON: what `found` makes of the model `start`, and how far that is from all of the logs.
pub fn json(start: &Model, found: &FitResult, judged: &Comparison) -> Value {
    let open = |parts: &Vec<(String, f64)>| -> Vec<Value> {
        parts.iter().map(|(name, part)| json!({ "name": name, "part": part })).collect()
    };
    json!({
        "error": found.error.to_string(),
        "status": found.status.as_str(),
        "cost_before": found.cost_before.and_then(finite),
        "cost_after": finite(found.cost_after),
        "rmse_fit": judged.rmse_fit,
        "rmse_validate": judged.rmse_validate,
        "torque_percent_fit": judged.torque_percent_fit,
        "torque_percent_validate": judged.torque_percent_validate,
        "iterations": found.iterations,
        "parameters": found.parameters.iter().map(|found| parameter(start, found)).collect::<Vec<Value>>(),
        "open": found.open.iter().map(open).collect::<Vec<_>>(),
        "correlations": found.correlations.iter().map(|pair| json!({ "one": pair.one, "other": pair.other, "value": pair.value })).collect::<Vec<Value>>(),
        "steps": found.steps,
        "budget": found.budget,
        "starts": found.tried,
        "best_start": found.best_start,
        "notes": found.notes,
    })
}

/// JSON knows no infinity.
fn finite(value: f64) -> Option<f64> {
    Some(value).filter(|value| value.is_finite())
}

fn parameter(model: &Model, found: &FittedParameter) -> Value {
    json!({
        "name": found.name,
        "unit": model.unit(&found.name),
        "start": found.start,
        "value": found.value,
        "std_error": found.std_error.and_then(finite),
        "identifiable": found.identifiable,
        "at_bound": found.held,
    })
}

//! What the tour carries: logs of a wrist's two joints, made by the independent plant of `tests/plant` with an effect that
//! the believed model lacks.
//!
//! `tour/recipe.toml` says how the logs were made; a test makes them again and compares bytes.

use std::collections::BTreeMap;

/// Name and text of every file that the tour starts from, `experiment.toml` among them.
pub const FILES: [(&str, &str); 6] = [
    ("believed.toml", include_str!("tour/believed.toml")),
    ("experiment.toml", include_str!("tour/experiment.toml")),
    ("recipe.toml", include_str!("tour/recipe.toml")),
    ("wrist-1.csv", include_str!("tour/wrist-1.csv")),
    ("wrist-2.csv", include_str!("tour/wrist-2.csv")),
    ("wrist-3.csv", include_str!("tour/wrist-3.csv")),
];

/// The values that made the logs, by parameter name, as far as they differ from the device file's.
pub fn truth() -> BTreeMap<String, f64> {
    let recipe = FILES.iter().find(|(name, _)| *name == "recipe.toml").map_or("", |(_, text)| text);
    let recipe: toml::Table = recipe.parse().unwrap_or_default();
    let mut truth = BTreeMap::new();
    if let Some(parameters) = recipe.get("parameters").and_then(toml::Value::as_table) {
        truth.extend(parameters.iter().filter_map(|(name, value)| Some((name.clone(), value.as_float()?))));
    }
    for effect in recipe.get("effect").and_then(toml::Value::as_array).into_iter().flatten() {
        let (Some(id), Some(joint)) =
            (effect.get("id").and_then(toml::Value::as_str), effect.get("joint").and_then(toml::Value::as_integer))
        else {
            continue;
        };
        let from =
            effect.get("from").and_then(toml::Value::as_integer).map_or(String::new(), |from| format!("{from}."));
        for (symbol, value) in effect.as_table().into_iter().flatten() {
            if let Some(value) = value.as_float() {
                truth.insert(format!("joint.{joint}.{id}.{from}{symbol}"), value);
            }
        }
    }
    truth
}

#[cfg(test)]
mod tests {
    use super::truth;

    #[test]
    fn the_truth_is_read_from_the_recipe() {
        let truth = truth();
        assert_eq!(truth.get("joint.4.spring.Ks"), Some(&0.0272));
        assert_eq!(truth.get("joint.4.input_coupling.5.gain"), Some(&-0.21));
        assert_eq!(truth.len(), 4 + 1 + 4);
    }
}

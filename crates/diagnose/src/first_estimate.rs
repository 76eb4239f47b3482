//! A first estimate for an effect that stands where it vanishes: what a fit starts from.

use std::collections::BTreeMap;

use dynid_logs::experiment::{Role, Run};
use dynid_user_model::{EffectInstance, Model};

use crate::Candidate;
use crate::missing::Logs;
use crate::settings::Settings;

/// Where a fit of a model with new effects starts.
#[derive(Debug, Clone)]
pub struct FirstEstimates {
    /// The model with the most promising estimates.
    pub model: Model,
    /// Other starts that may lead further; only where a single effect is new.
    pub others: Vec<Model>,
    /// The effects that got an estimate.
    pub labels: Vec<String>,
}

/// `model` with a first estimate for every effect that stands where it vanishes and whose shape is unknown, from those of `runs` that are for
/// fitting.
///
/// The estimate is the step that the score test promises most of; where it promises nothing the effect stays.
pub fn with_first_estimates(model: &Model, runs: &[&Run]) -> FirstEstimates {
    let mut found = FirstEstimates { model: model.clone(), others: Vec::new(), labels: Vec::new() };
    let new: Vec<EffectInstance> =
        model.effects.iter().filter(|own| own.payload.is_none() && vanishes(own)).cloned().collect();
    let is_single = new.len() == 1;
    let to_fit = runs.iter().filter(|run| run.role == Role::Fit);
    let fit = model.looked_at(to_fit.copied(), Settings::default().search.samples);
    for instance in new {
        let candidate = Candidate { effect: instance.effect.id.clone(), joint: instance.joint, from: instance.from };
        let mut without = found.model.clone();
        if without.remove_effect(&candidate.effect, candidate.joint, candidate.from).is_err() {
            continue;
        }
        let logs = Logs::new(&without, fit.clone(), Vec::new());
        let Some(starts) = logs.promising(&candidate) else { continue };
        let estimates: Vec<Model> =
            starts.iter().map(|start| with_values(&found.model, &instance, &start.stepped())).collect();
        let Some(first) = estimates.first().cloned() else { continue };
        if is_single {
            let mut seen = BTreeMap::from([(first.digest(), ())]);
            let is_new = |other: &Model| seen.insert(other.digest(), ()).is_none();
            found.others = estimates.into_iter().filter(is_new).take(OTHERS).collect();
        }
        found.model = first;
        found.labels.push(instance.label());
    }
    found
}

/// As many other starts.
const OTHERS: usize = 3;

/// `model` with the values that `estimate` has for `instance`.
fn with_values(model: &Model, instance: &EffectInstance, estimate: &Model) -> Model {
    let mut model = model.clone();
    for index in 0..instance.parameters.len() {
        let name = instance.parameter_name(index);
        let own = instance.parameters[index];
        if let Some(found) = estimate.parameter(&name)
            && (!own.fixed || instance.effect.parameters[index].scan.is_some())
        {
            // The name is the model's own.
            let _ = model.set_value(&name, found.value.clamp(own.lower, own.upper));
        }
    }
    model
}

/// Whether an effect does nothing of its own, and no small step tells its shape: every parameter that has a null value is there, at
/// least one has one, and another is free and has none, or one is looked for by a scan. What it keeps of an effect whose place it took says nothing about that,
/// unless there is nothing else.
fn vanishes(instance: &EffectInstance) -> bool {
    let effect = instance.effect;
    let is_kept =
        |symbol: &str| effect.replaces.iter().any(|replaced| replaced.carry.iter().any(|(own, _)| own == symbol));
    let nulls: Vec<(bool, bool)> = effect
        .parameters
        .iter()
        .zip(&instance.parameters)
        .filter_map(|(own, parameter)| Some((is_kept(&own.symbol), parameter.value == own.null? && !parameter.fixed)))
        .collect();
    let has_own = nulls.iter().any(|(is_kept, _)| !is_kept);
    let mut parameters = effect.parameters.iter().zip(&instance.parameters);
    let has_shape = parameters.any(|(own, given)| own.scan.is_some() || (own.null.is_none() && !given.fixed));
    has_shape
        && !nulls.is_empty()
        && nulls.iter().filter(|(is_kept, _)| !(has_own && *is_kept)).all(|(_, is_null)| *is_null)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn vanishes_with(effect: &str) -> bool {
        let text = format!("device = \"planar2r\"\n[[effect]]\njoint = 1\n{effect}");
        let model = Model::parse(&text, Path::new("made.toml")).unwrap_or_else(|error| panic!("{error}"));
        vanishes(&model.effects[0])
    }

    #[test]
    fn an_effect_vanishes_where_it_does_nothing_and_its_shape_is_open() {
        let fixed = |value: f64| format!("{{ value = {value:?}, fixed = true }}");
        let open = "v_eps = { value = 0.01, fixed = false }\n";
        assert!(vanishes_with(&format!("id = \"coulomb\"\nFc = 0.0\n{open}")));
        assert!(!vanishes_with(&format!("id = \"coulomb\"\nFc = 0.1\n{open}")), "it brakes");
        assert!(!vanishes_with(&format!("id = \"coulomb\"\nFc = {}\n{open}", fixed(0.0))), "it is to stay away");
        assert!(!vanishes_with("id = \"coulomb\"\nFc = 0.0\n"), "with a shape that is held a step finds Fc");
        assert!(!vanishes_with("id = \"viscous\"\nFv = 0.0\n"), "it has no shape");
        let both = |backwards: f64| format!("id = \"coulomb_asymmetric\"\nFc_p = 0.0\nFc_n = {backwards:?}\n{open}");
        assert!(vanishes_with(&both(0.0)) && !vanishes_with(&both(0.1)));
        // A scan tells where a spring rests, also where that is held.
        assert!(vanishes_with(&format!("id = \"spring\"\nKs = 0.0\nqeq = {}\n", fixed(0.3))));
    }
}

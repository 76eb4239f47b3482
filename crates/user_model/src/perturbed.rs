//! Models that are off as far as a fit's standard errors allow.

use std::collections::BTreeMap;

use dynid_model::Stage;

use super::Model;
use dynid_random::Random;

impl Model {
    /// This model off by the standard errors of its `[fit]`, each parameter by itself and within its bounds; itself where no fit
    /// stated any.
    ///
    /// A record of a fit has no correlations but one that is known without it: torques, masses and gains share a scale that no
    /// motion reveals and no command of this model feels. What the errors of all gains have in common, relative to their
    /// values, is that scale's, and not drawn.
    #[must_use]
    pub fn off_by_errors(&self, random: &mut Random) -> Self {
        let Some(fit) = &self.fit else { return self.clone() };
        let errors = &fit.std_error;
        let relative = |name: &str| Some(errors.get(name)? / self.parameter(name)?.value.abs());
        let gains: Vec<String> = self
            .effects
            .iter()
            .filter(|instance| instance.effect.stage == Some(Stage::Gain))
            .flat_map(|gain| (0..gain.parameters.len()).map(|index| gain.parameter_name(index)))
            .collect();
        let common = gains.iter().map(|name| relative(name).unwrap_or(0.0)).reduce(f64::min).unwrap_or(0.0);
        // A gain has the scale also where commands are stated as torques, and its unit is none.
        let scales = |name: &String| {
            let has_unit = |unit: String| unit.starts_with('N') || unit.starts_with("kg");
            gains.contains(name) || self.unit(name).is_some_and(has_unit)
        };
        // In the order of the map, so that a seed stands for one draw.
        let values: BTreeMap<&str, f64> = errors
            .iter()
            .filter_map(|(name, error)| {
                let value = self.parameter(name)?.value;
                let shared = if scales(name) { common * value } else { 0.0 };
                let own = (error * error - shared * shared).max(0.0).sqrt();
                Some((name.as_str(), value + own * random.normal()))
            })
            .collect();
        self.with_values(&|name| values.get(name).copied())
    }
}

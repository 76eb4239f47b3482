//! How each interval between samples is integrated: in many steps where friction reverses, in few elsewhere.

use dynid_dynamics::simulate::Scheme;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

/// Shorter steps have to leave no more than this share of what others err by: where motions part whatever the steps, they bring little.
pub(crate) const WORTH_STEPS: f64 = 0.5;

/// Of every run, the scheme of each interval.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plan(Vec<Vec<Scheme>>);

impl Plan {
    pub(crate) fn new(schemes: Vec<Vec<Scheme>>) -> Self {
        Self(schemes)
    }

    /// Of one run; what is not planned takes one step.
    pub(crate) fn of_run(&self, run: usize) -> &[Scheme] {
        self.0.get(run).map_or(&[], Vec::as_slice)
    }

    /// With implicit steps everywhere, shorter ones where they were: for equations that are stiffer than those it was planned for. What
    /// takes the finest scheme keeps it.
    #[must_use]
    pub fn stiffer(&self) -> Self {
        let stiffer = |scheme: &Scheme| match scheme {
            Scheme::Explicit(_) => Scheme::Implicit(1),
            &Scheme::FINEST => Scheme::FINEST,
            Scheme::Implicit(_) => scheme.finer(),
        };
        Self(self.0.iter().map(|run| run.iter().map(stiffer).collect()).collect())
    }

    /// With every step halved.
    #[must_use]
    pub(crate) fn halved(&self) -> Self {
        Self(self.0.iter().map(|run| run.iter().map(|scheme| scheme.finer()).collect()).collect())
    }

    /// Where each interval takes the finest scheme of so many on either side: what is steep there may move.
    #[must_use]
    pub(crate) fn spread(&self, reach: usize) -> Self {
        // What is on no ladder is stated, and stays.
        let place = |scheme: &Scheme| Scheme::LADDER.iter().position(|own| own == scheme);
        let of_run = |run: &Vec<Scheme>| {
            let places: Vec<Option<usize>> = run.iter().map(place).collect();
            let finest = |around: &[Option<usize>]| around.iter().flatten().max().map(|place| Scheme::LADDER[*place]);
            let around = |interval: usize| &places[interval.saturating_sub(reach)..run.len().min(interval + reach + 1)];
            let own = |(interval, scheme): (usize, &Scheme)| match places[interval] {
                Some(_) => finest(around(interval)).unwrap_or(*scheme),
                None => *scheme,
            };
            run.iter().enumerate().map(own).collect()
        };
        Self(self.0.iter().map(of_run).collect())
    }

    /// What an interval costs in the mean, in explicit steps.
    pub fn mean_steps(&self) -> f64 {
        /// What an implicit step with its derivatives comes to.
        const IMPLICIT: f64 = 5.0;
        let cost = |scheme: &Scheme| match scheme {
            Scheme::Explicit(_) => scheme.steps() as f64,
            Scheme::Implicit(_) => IMPLICIT * scheme.steps() as f64,
        };
        let intervals: usize = self.0.iter().map(Vec::len).sum();
        if intervals == 0 { 1.0 } else { self.0.iter().flatten().map(cost).sum::<f64>() / intervals as f64 }
    }

    /// Of the beginnings of its runs; the whole plan where they are no such.
    #[must_use]
    pub(crate) fn beginning(&self, intervals: &[usize]) -> Self {
        let cut = self.0.iter().zip(intervals).map(|(run, intervals)| run.get(..*intervals).map(<[Scheme]>::to_vec));
        cut.collect::<Option<Vec<_>>>().filter(|cut| cut.len() == intervals.len()).map_or_else(|| self.clone(), Self)
    }

    /// Of longer runs that begin with its runs: what comes later is taken to be like what is known.
    #[must_use]
    pub(crate) fn continued(&self, intervals: &[usize]) -> Self {
        let longer = |(run, intervals): (&Vec<Scheme>, &usize)| run.iter().copied().cycle().take(*intervals).collect();
        Self(self.0.iter().zip(intervals).map(longer).collect())
    }

    /// Whether it is of runs with so many intervals each.
    pub(crate) fn fits(&self, intervals: impl Iterator<Item = usize>) -> bool {
        self.0.iter().map(Vec::len).eq(intervals)
    }
}

/// Of each interval its place on the ladder, as one digit (of base 36).
impl Serialize for Plan {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let digit = |scheme: &Scheme| {
            let place = Scheme::LADDER.iter().position(|own| own == scheme).unwrap_or(Scheme::LADDER.len() - 1);
            u32::try_from(place).ok().and_then(|place| char::from_digit(place, 36)).unwrap_or('z')
        };
        serializer.collect_seq(self.0.iter().map(|run| run.iter().map(digit).collect::<String>()))
    }
}

impl<'de> Deserialize<'de> for Plan {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let runs = Vec::<String>::deserialize(deserializer)?;
        let scheme = |digit: char| Scheme::LADDER.get(digit.to_digit(36)? as usize).copied();
        let plan = runs.iter().map(|digits| digits.chars().map(scheme).collect()).collect::<Option<Vec<_>>>();
        plan.map(Self).ok_or_else(|| D::Error::custom("integration steps are planned by digits"))
    }
}

#[cfg(test)]
mod tests {
    use super::{Plan, Scheme};

    #[test]
    fn a_plan_survives_its_text_and_has_a_stiffer_one() {
        let plan = Plan::new(vec![Scheme::LADDER.to_vec(), vec![]]);
        let text = serde_json::to_string(&plan).unwrap();
        assert_eq!(text, r#"["0123456789abcdefghijklmn",""]"#);
        assert_eq!(serde_json::from_str::<Plan>(&text).unwrap(), plan);
        assert_eq!(serde_json::to_string(&plan.stiffer()).unwrap(), r#"["jjjjjjjjjjjjjjjjjjjklmnn",""]"#);
        assert!(serde_json::from_str::<Plan>(r#"["0z"]"#).is_err());
        assert_eq!(plan.beginning(&[2, 0]), Plan::new(vec![Scheme::LADDER[..2].to_vec(), vec![]]));
        assert_eq!(plan.beginning(&[2, 1]), plan, "the second run is shorter");
        assert_eq!(plan.beginning(&[2, 0]).continued(&[3, 0]).0[0], [0, 1, 0].map(|place| Scheme::LADDER[place]));
    }
}

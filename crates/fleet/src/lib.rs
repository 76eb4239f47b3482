//! What has changed on which of many robots, and since when; and which robots are unlike the others.
//!
//! The input is a table of [`Estimate`]s: what a fit says of each parameter of each robot in each night. [`analyse`] looks at
//! each robot's series of each parameter for the night in which it begins to be another ([`Change`]), against a scatter that
//! the whole fleet tells ([`Scatter`]), and at the robots beside each other ([`Unlike`]).
//!
//! Every look is counted: a statement is made where the chance that a fleet in which nothing happens shows anything of its kind is
//! below [`Settings::false_alarms`], all robots, parameters, nights and shapes together (Bonferroni).

mod change;
mod scatter;
mod series;
mod unlike;

use rayon::prelude::*;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};

use change::Explained;
pub use change::{Change, Shape};
pub use scatter::Scatter;
pub use series::Series;
pub use unlike::{Lacking, Unlike};

/// One number of one robot in one night.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Which robot.
    pub robot: String,
    /// Which night. Nights are put in the order of their names, with numbers by their sizes (`n2` before `n10`).
    pub night: String,
    /// What was estimated, e.g. `joint.1.viscous.Fv`.
    pub quantity: String,
    /// Its value.
    pub value: f64,
    /// Its standard error, where there is one; 0 where not.
    pub std_error: f64,
}

/// How sure a statement must be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Probability of any false statement of a kind in the whole fleet.
    pub false_alarms: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { false_alarms: 0.05 }
    }
}

/// What a fleet's estimates show.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Analysis {
    /// Robots, by name.
    pub robots: Vec<String>,
    /// Nights, in their order.
    pub nights: Vec<String>,
    /// What every night differs by, by quantity.
    pub scatter: Vec<Scatter>,
    /// What has changed, by robot and night; nights that stand alone are among them ([`Shape::Stray`]).
    pub changes: Vec<Change>,
    /// Robots whose last value is unlike that of the others.
    pub unlike: Vec<Unlike>,
    /// Robots that do not have what most others have.
    pub lacking: Vec<Lacking>,
    /// How many looks were taken for changes; each counts.
    pub looks: usize,
    /// What was looked at, by quantity and robot, without what all robots do alike.
    #[serde(skip)]
    pub series: Vec<Series>,
}

/// What happened to a robot at one time: changes whose nights may be the same.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Event {
    /// Which robot.
    pub robot: String,
    /// The night of the surest of its changes.
    pub night: String,
    /// Its place among the fleet's nights.
    pub index: usize,
    /// The surest first.
    pub changes: Vec<Change>,
}

impl Analysis {
    /// What lasts, put together by robot and time. Strays are no events.
    pub fn events(&self) -> Vec<Event> {
        let mut events: Vec<(Event, [usize; 2])> = Vec::new();
        let mut lasting: Vec<&Change> = self.changes.iter().filter(|own| own.shape != Shape::Stray).collect();
        lasting.sort_by(|a, b| (&a.robot, a.between[0]).cmp(&(&b.robot, b.between[0])));
        for own in lasting {
            match events.last_mut().filter(|(event, [_, to])| event.robot == own.robot && own.between[0] <= *to) {
                Some((event, [_, to])) => {
                    *to = (*to).max(own.between[1]);
                    event.changes.push(own.clone());
                }
                None => {
                    let event =
                        Event { robot: own.robot.clone(), night: String::new(), index: 0, changes: vec![own.clone()] };
                    events.push((event, own.between));
                }
            }
        }
        let finished = |(mut event, _): (Event, [usize; 2])| {
            event.changes.sort_by(|a, b| a.chance.total_cmp(&b.chance).then_with(|| a.quantity.cmp(&b.quantity)));
            (event.night, event.index) = (event.changes[0].night.clone(), event.changes[0].index);
            event
        };
        events.into_iter().map(finished).collect()
    }
}

/// Larger numbers are taken for none: their squares are infinite.
const LARGEST: f64 = 1e100;

/// Looks at all estimates. Values that are no numbers are left out; that a robot has one says that it does not lack the quantity.
pub fn analyse(estimates: &[Estimate], settings: &Settings) -> Analysis {
    let (robots, nights) = (series::names(estimates, |own| &own.robot), series::names(estimates, |own| &own.night));
    let all = series::of(estimates, &robots, &nights);
    let lacking = unlike::lacking(estimates, &robots);
    let mut quantities: Vec<Vec<Series>> =
        all.chunk_by(|a, b| a.quantity == b.quantity).map(<[Series]>::to_vec).collect();
    quantities.iter_mut().for_each(|own| series::without_common(own, nights.len()));
    let looks = all.iter().map(|own| change::looks(own.len())).sum();
    let level = Level { looks, false_alarms: settings.false_alarms };
    let explained: Vec<(Scatter, Vec<Explained>)> = quantities.par_iter().map(|own| explained(own, level)).collect();
    let mut unlike: Vec<Unlike> = quantities
        .iter()
        .zip(&explained)
        .flat_map(|(own, (_, explained))| unlike::unlike(own, explained, settings, quantities.len()))
        .collect();
    unlike.sort_by(|a, b| (&a.robot, &a.quantity).cmp(&(&b.robot, &b.quantity)));
    let (scatter, explained): (Vec<Scatter>, Vec<Vec<Explained>>) = explained.into_iter().unzip();
    let mut changes: Vec<Change> = explained.into_iter().flatten().flat_map(|own| own.changes).collect();
    changes.iter_mut().for_each(|own| own.name(&nights));
    changes.sort_by(|a, b| (&a.robot, a.index, &a.quantity).cmp(&(&b.robot, b.index, &b.quantity)));
    Analysis { robots, nights, scatter, changes, unlike, lacking, looks, series: quantities.concat() }
}

/// The series of one quantity, each with what explains it, and the scatter that is left.
///
/// At first all that happens is taken for scatter. What is sure beside that is taken out, and so on: the scatter falls from
/// above to what it is, and what is only scatter is never taken for a change meanwhile.
fn explained(all: &[Series], level: Level) -> (Scatter, Vec<Explained>) {
    /// Each finds more than the one before; a fleet has no more layers.
    const ROUNDS: usize = 10;
    let mut scatter = Scatter::of(all);
    let explain = |scatter: &Scatter, rest: &[Series]| {
        let own = scatter.of_each(rest);
        all.iter().zip(own).map(|(series, own)| change::explain(series, scatter, own, level)).collect::<Vec<_>>()
    };
    let mut explained = explain(&scatter, all);
    for _ in 0..ROUNDS {
        let rest: Vec<Series> = explained.iter().map(|own| own.rest.clone()).collect();
        scatter = Scatter::of(&rest);
        let next = explain(&scatter, &rest);
        let count = |all: &[Explained]| all.iter().map(|own| own.changes.len()).sum::<usize>();
        let is_done = count(&next) == count(&explained);
        explained = next;
        if is_done {
            break;
        }
    }
    (scatter, explained)
}

/// How sure something must be, and how often it was looked for.
#[derive(Debug, Clone, Copy)]
struct Level {
    looks: usize,
    false_alarms: f64,
}

impl Level {
    /// Probability that one of the looks shows a value so many standard errors from nothing, by chance; the standard error is known by so
    /// many degrees of freedom.
    fn chance(self, deviation: f64, freedom: f64) -> f64 {
        if !deviation.is_finite() {
            return 1.0;
        }
        let tail = StudentsT::new(0.0, 1.0, freedom.max(1.0)).map_or(1.0, |t| 2.0 * t.cdf(-deviation.abs()));
        (tail * self.looks as f64).min(1.0)
    }

    fn is_sure(self, chance: f64) -> bool {
        chance < self.false_alarms
    }
}

/// The middle of some numbers; `None` where there are none.
fn median(values: Vec<f64>) -> Option<f64> {
    (!values.is_empty()).then(|| dynid_signal::statistics::median(values))
}

#[cfg(test)]
mod tests;

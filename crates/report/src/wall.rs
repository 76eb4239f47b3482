//! Virtual walls on a page: how each resists, what a hand feels, and how still and solid each is under all hands.

mod pictures;
mod tables;

use dynid_model::device::JointKind;

use super::{Part, Section, Verdict, number};
use dynid_control::{Law, LinearLaw, Partition, Wall};
use dynid_haptics::{
    wall, wall::Case, wall::Contact, wall::Measures, wall::OwnDamping, wall::Setting, wall::WallError, wall::WallFile,
    wall::median,
};
use dynid_user_model::Model;

/// Everything that a page tells of some walls.
#[derive(Debug)]
pub struct WallReport<'a> {
    setting: &'a Setting,
    walls: Vec<Shown>,
    /// Of every wall, approach and hand.
    cases: Vec<Case>,
    /// Damping that the device has of its own.
    own: OwnDamping,
    unit: Unit,
}

/// A wall, and how the typical hand meets it.
#[derive(Debug)]
struct Shown {
    name: String,
    title: String,
    wall: Wall,
    /// Whether a passivity controller watches it.
    passive: bool,
    /// The linear law that its rules were made from.
    base: Option<LinearLaw>,
    /// One for each approach.
    contacts: Vec<Contact>,
}

/// Units of the joint that meets the wall.
#[derive(Debug, Clone, Copy)]
struct Unit {
    /// Of its position.
    position: &'static str,
    /// A thousandth of it.
    small: &'static str,
    velocity: &'static str,
    torque: &'static str,
    stiffness: &'static str,
    damping: &'static str,
    inertia: &'static str,
}

impl Unit {
    /// Those of the setting's joint.
    fn of(setting: &Setting) -> Self {
        match setting.device.joints[setting.joint].kind {
            JointKind::Revolute => Self {
                position: "rad",
                small: "mrad",
                velocity: "rad/s",
                torque: "N*m",
                stiffness: "N*m/rad",
                damping: "N*m*s/rad",
                inertia: "kg*m^2",
            },
            JointKind::Prismatic => Self {
                position: "m",
                small: "mm",
                velocity: "m/s",
                torque: "N",
                stiffness: "N/m",
                damping: "N*s/m",
                inertia: "kg",
            },
        }
    }
}

/// A sentence on the damping that a device has of its own, to stand beside what Colgate & Schenkel's bound asks for.
pub fn damping_in_words(own: &OwnDamping, setting: &Setting) -> String {
    if own.from.is_empty() {
        return "By the model friction at this joint does not grow with speed, and dry friction does not count: the bound asks for \
                more than there is."
            .to_owned();
    }
    format!(
        "By the model the device damps with {} {} of its own ({}); dry friction does not count.",
        short(own.value),
        Unit::of(setting).damping,
        own.from.join(", ")
    )
}

/// Why a page has nothing to show.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WallReportError {
    /// The simulation of a contact.
    #[error(transparent)]
    Wall(#[from] WallError),
    /// A wall's numbers.
    #[error("wall `{name}`: {source}")]
    Law {
        /// The wall.
        name: String,
        /// What is wrong with it.
        source: dynid_control::WallError,
    },
    /// Two walls of one name.
    #[error("two walls are named `{name}`: rename one of the files")]
    Name {
        /// The name.
        name: String,
    },
    /// Nobody touches the wall.
    #[error("no hand ever comes to the wall `{name}`: let the setting start nearer, or aim further")]
    Untouched {
        /// The wall.
        name: String,
    },
}

impl<'a> WallReport<'a> {
    /// Plays every hand against every wall; the first wall is what the others are compared with.
    ///
    /// # Errors
    /// As [`wall::contact`]; walls of one name; a wall that no hand touches.
    pub fn new(model: &Model, setting: &'a Setting, walls: &[(String, WallFile)]) -> Result<Self, WallReportError> {
        let mut shown = Vec::with_capacity(walls.len());
        let mut named: Vec<(String, Wall)> = Vec::with_capacity(walls.len());
        for (name, file) in walls {
            if named.iter().any(|(known, _)| known == name) {
                return Err(WallReportError::Name { name: name.clone() });
            }
            let wall = file.wall(setting).map_err(|source| WallReportError::Law { name: name.clone(), source })?;
            let contacts = setting
                .approaches
                .iter()
                .map(|approach| {
                    wall::contact(model, setting, &wall, &setting.hand, approach)
                        .map_err(|error| error.in_case(name, approach, None))
                })
                .collect::<Result<Vec<_>, _>>()?;
            named.push((name.clone(), wall.clone()));
            let (title, passive, base) = (file.title.clone(), file.passive, file.base);
            shown.push(Shown { name: name.clone(), title, wall, passive, base, contacts });
        }
        let cases = wall::compare(model, setting, &named)?;
        if let Some((name, _)) = named.iter().find(|(name, _)| !cases.iter().any(|case| case.controller == *name)) {
            return Err(WallReportError::Untouched { name: name.clone() });
        }
        Ok(Self { setting, walls: shown, cases, own: wall::own_damping(model, setting)?, unit: Unit::of(setting) })
    }

    /// Every case.
    pub fn cases(&self) -> &[Case] {
        &self.cases
    }

    /// What was found: the first wall, the stillest of the others, and where the handle settles.
    pub fn sentences(&self) -> Vec<String> {
        let first = &self.walls[0].name;
        let small = self.unit.small;
        let count = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
        let mut sentences = vec![format!(
            "Held by {} at {}, the handle at the wall {first} shakes by {} {small} RMS in the median ({} {small} peak to peak \
             at {:.1} Hz), and by {}.",
            count(self.setting.hands, "kind of hand").replace("kind of hands", "kinds of hand"),
            count(self.setting.approaches.len(), "speed"),
            milli(self.median(first, None, |m| m.chatter_rms)),
            milli(self.median(first, None, |m| m.peak_to_peak)),
            self.median(first, None, |m| m.frequency),
            self.worst_hand(first)
        )];
        let mut others: Vec<&String> = self.walls[1..].iter().map(|own| &own.name).collect();
        others.sort_by(|a, b| self.worst(a).total_cmp(&self.worst(b)));
        if let Some(&name) = others.first() {
            // What stands beside the best says what the best is worth.
            let next = others.get(1).map_or_else(String::new, |next| {
                format!(
                    "; next comes {next}, {} {small} in the median and {} at worst, with {} {}",
                    milli(self.median(next, None, |m| m.chatter_rms)),
                    milli(self.worst(next)),
                    short(self.median(next, None, |m| m.stiffness)),
                    self.unit.stiffness
                )
            });
            let ratios = self.ratios(name);
            let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
            let of: Vec<&Measures> = self.of(name, None);
            let outside = of.iter().map(|m| m.outside).fold(0.0, f64::max);
            let energy = of.iter().map(|m| m.energy_out).fold(0.0, f64::max);
            let given = if energy > 0.0 {
                format!("gives out at most {} mJ", short(1e3 * energy))
            } else {
                "gives nothing out".to_owned()
            };
            let left = if outside > 0.0 {
                format!("left for at most {:.1} % of the time", 100.0 * outside)
            } else {
                "never left".to_owned()
            };
            sentences.push(format!(
                "Of the other walls {name} is the stillest with its worst hand: it shakes by {} {small} RMS in the median and by \
                 {}, {} times less than {first} in the median and {} times less at least, with {} {} of stiffness instead of {}; \
                 it {given} and, from {} s after the touch, is {left}{next}.",
                milli(self.median(name, None, |m| m.chatter_rms)),
                self.worst_hand(name),
                short(median(ratios)),
                short(least),
                short(self.median(name, None, |m| m.stiffness)),
                self.unit.stiffness,
                short(self.median(first, None, |m| m.stiffness)),
                wall::FROM_S,
            ));
        }
        let settled: Vec<f64> = self
            .setting
            .approaches
            .iter()
            .map(|approach| self.median(first, Some(&approach.name), |m| m.settled_position))
            .collect();
        let names: Vec<&str> = self.setting.approaches.iter().map(|approach| approach.name.as_str()).collect();
        let by_speed =
            |a: &usize, b: &usize| self.setting.approaches[*a].peak.total_cmp(&self.setting.approaches[*b].peak);
        let mut order: Vec<usize> = (0..settled.len()).collect();
        order.sort_by(by_speed);
        let is_deeper = order.len() > 1 && order.windows(2).all(|pair| settled[pair[1]] < settled[pair[0]]);
        let holds: Vec<String> =
            self.setting.approaches.iter().map(|approach| plain(self.setting.hold_after(approach))).collect();
        sentences.push(format!(
            "At {first} the handle settles at {} {small} after a {} approach{}, where the arm holds with {} {}.",
            listed(
                &settled
                    .iter()
                    .map(|settled| format!("{:.1}", 1e3 * settled).replace('-', "\u{2212}"))
                    .collect::<Vec<_>>()
            ),
            listed(&names),
            if is_deeper { ", deeper the faster" } else { "" },
            listed(&holds),
            self.unit.torque,
        ));
        sentences
    }

    /// All sections but that which tells where everything came from.
    pub fn sections(&self) -> Vec<Box<dyn Section>> {
        let part = |title: &'static str, html: String| -> Box<dyn Section> { Box::new(Part { title, html }) };
        let mut sections: Vec<Box<dyn Section>> = vec![
            Box::new(Verdict { sentences: self.sentences() }),
            part("Chatter of every hand", self.chatter()),
            part("Measures", self.measures()),
            part("A typical hand at the wall", self.approaches()),
            part("Where the handle settles", self.settled()),
            part("What holds against a steady push", self.static_torque()),
        ];
        let surfaces = self.surfaces();
        if !surfaces.is_empty() {
            sections.push(part("Torque over position and velocity", surfaces));
        }
        if self.walls.iter().any(|own| matches!(own.wall.law(), Law::Rules(_))) {
            sections.push(part("Fuzzy sets", self.memberships()));
            sections.push(part("Rules", self.rules()));
        }
        sections.push(part("The setting", self.setting_in_words()));
        sections
    }

    /// Measures of a wall, of one approach or of all, in the order of the cases.
    fn of(&self, name: &str, speed: Option<&str>) -> Vec<&Measures> {
        self.cases
            .iter()
            .filter(|case| case.controller == name && speed.is_none_or(|speed| case.speed == speed))
            .map(|case| &case.measures)
            .collect()
    }

    fn median(&self, name: &str, speed: Option<&str>, value: impl Fn(&Measures) -> f64) -> f64 {
        median(self.of(name, speed).into_iter().map(value).collect())
    }

    fn worst_case(&self, name: &str) -> Option<&Case> {
        let of = self.cases.iter().filter(|case| case.controller == name);
        of.max_by(|a, b| a.measures.chatter_rms.total_cmp(&b.measures.chatter_rms))
    }

    fn worst(&self, name: &str) -> f64 {
        self.worst_case(name).map_or(f64::NAN, |case| case.measures.chatter_rms)
    }

    fn worst_hand(&self, name: &str) -> String {
        let Some(case) = self.worst_case(name) else { return number(f64::NAN) };
        format!(
            "{} {} with the worst (hand {}, {})",
            milli(case.measures.chatter_rms),
            self.unit.small,
            case.hand,
            case.speed
        )
    }

    /// Chatter of the first wall over that of this one, hand by hand.
    fn ratios(&self, name: &str) -> Vec<f64> {
        wall::chatter_ratios(&self.cases, name, &self.walls[0].name)
    }

    /// The deepest median settled position of any wall; a little below the surface where all stay outside.
    fn deepest(&self) -> f64 {
        let settled = self.walls.iter().flat_map(|own| {
            let speeds = self.setting.approaches.iter().map(|approach| approach.name.as_str());
            speeds.map(|speed| self.median(&own.name, Some(speed), |m| m.settled_position)).collect::<Vec<_>>()
        });
        settled.filter(|settled| settled.is_finite()).fold(-1e-3, f64::min)
    }
}

/// The part of an input where its sets stand densest.
fn densest(sets: &Partition) -> [f64; 2] {
    let peaks = sets.peaks();
    let gap = |index: usize| peaks[index + 1] - peaks[index];
    let least = (0..peaks.len() - 1).map(gap).fold(f64::INFINITY, f64::min);
    let is_dense = |index: &usize| gap(*index) <= 1.01 * least;
    let Some(first) = (0..peaks.len() - 1).find(is_dense) else { return [peaks[0], peaks[peaks.len() - 1]] };
    let last = (first..peaks.len() - 1).take_while(is_dense).last().unwrap_or(first);
    [peaks[first], peaks[last + 1]]
}

/// A thousand times a value, in three digits.
fn milli(value: f64) -> String {
    short(1e3 * value)
}

/// A number in three digits, without an exponent where it can do without.
fn short(value: f64) -> String {
    let size = value.abs();
    if !value.is_finite() || size == 0.0 || !(1e-4..1e6).contains(&size) {
        return number(value);
    }
    let decimals = (2.0 - size.log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{value:.decimals$}").replace('-', "\u{2212}")
}

/// The same without zeros at its end: a number that somebody gave.
fn plain(value: f64) -> String {
    let text = short(value);
    if text.contains('.') && !text.contains('e') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// `a, b and c`.
fn listed<T: AsRef<str>>(words: &[T]) -> String {
    match words {
        [] => String::new(),
        [only] => only.as_ref().to_owned(),
        [before @ .., last] => {
            let before: Vec<&str> = before.iter().map(AsRef::as_ref).collect();
            format!("{} and {}", before.join(", "), last.as_ref())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sets(peaks: &[f64]) -> Partition {
        Partition::new((0..peaks.len()).map(|index| format!("S{index}")).collect(), peaks.to_vec()).expect("ascending")
    }

    #[test]
    fn the_densest_part_is_that_of_the_shipped_tables_range_of_interest() {
        let Law::Rules(table) = wall::shipped("fuzzy").expect("shipped").law else { panic!("rules") };
        assert_eq!(densest(table.position()), [-25e-3, 5e-3]);
        assert_eq!(densest(table.velocity()), [-5.0, 5.0]);
        assert_eq!(densest(&sets(&[0.0, 1.0, 2.0])), [0.0, 2.0]);
        assert_eq!(densest(&sets(&[0.0, 3.0])), [0.0, 3.0]);
    }

    #[test]
    fn numbers_and_lists_read_well() {
        assert_eq!([12.345, -0.0501, 1234.0, 0.0].map(short), ["12.3", "\u{2212}0.0501", "1234", "0"]);
        assert_eq!(listed(&["a", "b", "c"]), "a, b and c");
        assert_eq!([0.7, 1e-4, 100.0, 1200.0, 0.0].map(plain), ["0.7", "0.0001", "100", "1200", "0"]);
        assert_eq!(listed(&["a"]), "a");
        assert_eq!(median(vec![3.0, 1.0, 2.0, 10.0]), 2.5);
    }
}

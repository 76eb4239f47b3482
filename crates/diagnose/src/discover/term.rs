//! Products of the signals at hand: what a formula may be made of.

use std::collections::BTreeSet;

use dynid_model::device::JointKind;

use dynid_identify::prediction::Signals;

/// Speed below which a sign is smoothed [rad/s or m/s].
pub(super) const SMOOTH: f64 = 0.01;
/// Highest harmonic of an angle that is tried.
const HARMONICS: u32 = 12;

/// One signal of a joint, or a function of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Factor {
    /// Torque that the drive path delivers at the joint itself.
    Load,
    /// Its size.
    LoadSize,
    /// Command of another joint.
    Command(usize),
    /// Its size.
    CommandSize(usize),
    /// Time since the start of the run.
    Time,
    /// Position.
    Position(usize),
    /// `sin(k q)`
    Sine(usize, u32),
    /// `cos(k q)`
    Cosine(usize, u32),
    /// Speed.
    Speed(usize),
    /// Its size.
    SpeedSize(usize),
    /// Its sign, smoothed.
    Sign(usize),
}

use Factor::{Command, CommandSize, Cosine, Load, LoadSize, Position, Sign, Sine, Speed, SpeedSize, Time};

impl Factor {
    /// The joint whose motion or command it is; `None` for time and the own drive's torque.
    pub(super) fn joint(self) -> Option<usize> {
        match self {
            Load | LoadSize | Time => None,
            Command(joint)
            | CommandSize(joint)
            | Position(joint)
            | Sine(joint, _)
            | Cosine(joint, _)
            | Speed(joint)
            | SpeedSize(joint)
            | Sign(joint) => Some(joint),
        }
    }

    /// Powers of torque, angle, second and command.
    fn dimension(self) -> [i32; 4] {
        match self {
            Load | LoadSize => [1, 0, 0, 0],
            Command(_) | CommandSize(_) => [0, 0, 0, 1],
            Time => [0, 0, 1, 0],
            Position(_) => [0, 1, 0, 0],
            Speed(_) | SpeedSize(_) => [0, 1, -1, 0],
            Sine(..) | Cosine(..) | Sign(_) => [0; 4],
        }
    }

    /// As people read it, at joint `own`.
    fn label(self, own: usize) -> String {
        let angle = |joint: usize, k: u32| if k == 1 { format!("q{joint}") } else { format!("{k}*q{joint}") };
        match self {
            Load => format!("load{own}"),
            LoadSize => format!("|load{own}|"),
            Command(joint) => format!("command{joint}"),
            CommandSize(joint) => format!("|command{joint}|"),
            Time => "t".to_owned(),
            Position(joint) => format!("q{joint}"),
            Sine(joint, k) => format!("sin({})", angle(joint, k)),
            Cosine(joint, k) => format!("cos({})", angle(joint, k)),
            Speed(joint) => format!("dq{joint}"),
            SpeedSize(joint) => format!("|dq{joint}|"),
            Sign(joint) => format!("sign(dq{joint})"),
        }
    }

    /// As an effect file at joint `own` writes it.
    fn in_file(self, own: usize) -> String {
        let of = |name: &str, joint: usize| if joint == own { name.to_owned() } else { format!("{name}_from") };
        match self {
            Load => "load".to_owned(),
            LoadSize => "abs(load)".to_owned(),
            Command(_) => "command_from".to_owned(),
            CommandSize(_) => "abs(command_from)".to_owned(),
            Time => "t".to_owned(),
            Position(joint) => of("q", joint),
            Sine(joint, k) => format!("sin(2 * pi * {} / period_{k})", of("q", joint)),
            Cosine(joint, k) => format!("cos(2 * pi * {} / period_{k})", of("q", joint)),
            Speed(joint) => of("dq", joint),
            SpeedSize(joint) => format!("abs({})", of("dq", joint)),
            Sign(joint) => format!("tanh({} / v_eps)", of("dq", joint)),
        }
    }
}

/// A product of factors.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Term(Vec<Factor>);

impl Term {
    pub(super) fn new(mut factors: Vec<Factor>) -> Self {
        factors.sort();
        Self(factors)
    }

    /// The torque that the drive path delivers.
    pub(super) fn load() -> Self {
        Self(vec![Load])
    }

    /// Whether the drive's own torque is in it.
    pub(super) fn has_load(&self) -> bool {
        self.0.iter().any(|factor| matches!(factor, Load | LoadSize))
    }

    pub(super) fn factors(&self) -> &[Factor] {
        &self.0
    }

    /// Joints besides `own` whose signals it needs.
    pub(super) fn others(&self, own: usize) -> BTreeSet<usize> {
        self.0.iter().filter_map(|factor| factor.joint()).filter(|joint| *joint != own).collect()
    }

    /// Whether it is a part of the command rather than a torque that resists.
    pub(super) fn is_command(&self) -> bool {
        self.0.iter().any(|factor| matches!(factor, Command(_) | CommandSize(_)))
    }

    /// How much it asks one to believe: a factor each, a little for a higher harmonic.
    pub(super) fn complexity(&self) -> f64 {
        let factor = |factor: &Factor| match factor {
            Sine(_, k) | Cosine(_, k) => 1.25 + 0.25 * f64::from(*k).ln(),
            SpeedSize(_) | LoadSize | CommandSize(_) => 1.1,
            _ => 1.0,
        };
        self.0.iter().map(factor).sum()
    }

    /// E.g. `sin(3*q4) * dq4`.
    pub(super) fn label(&self, own: usize) -> String {
        self.0.iter().map(|factor| factor.label(own)).collect::<Vec<String>>().join(" * ")
    }

    /// As an effect file at joint `own` writes it.
    pub(super) fn in_file(&self, own: usize) -> String {
        self.0.iter().map(|factor| factor.in_file(own)).collect::<Vec<String>>().join(" * ")
    }

    /// Unit of its coefficient at revolute joints.
    pub(super) fn coefficient_unit(&self) -> String {
        let mut powers = if self.is_command() { [0, 0, 0, 1] } else { [1, 0, 0, 0] };
        for factor in &self.0 {
            powers.iter_mut().zip(factor.dimension()).for_each(|(power, own)| *power -= own);
        }
        let [torque, angle, second, command] = powers;
        let atoms = [("N", torque), ("m", torque), ("s", second), ("command", command), ("rad", angle)];
        let power = |name: &str, power: i32| if power == 1 { name.to_owned() } else { format!("{name}^{power}") };
        let above: Vec<String> = atoms.iter().filter(|atom| atom.1 > 0).map(|atom| power(atom.0, atom.1)).collect();
        let mut unit = if above.is_empty() { "1".to_owned() } else { above.join("*") };
        for (name, exponent) in atoms.iter().filter(|atom| atom.1 < 0) {
            unit.push('/');
            unit.push_str(&power(name, -exponent));
        }
        unit
    }

    /// Its values along a model's predictions, at joint `own`; `free` are the joints that move.
    pub(super) fn values(&self, signals: &Signals, free: &[usize], own: usize) -> Vec<f64> {
        let slot = |joint: usize| free.iter().position(|other| *other == joint).unwrap_or_default();
        let mut values = vec![1.0; signals.time.len()];
        for &factor in &self.0 {
            let signal: &[f64] = match factor {
                Load | LoadSize => &signals.delivered[slot(own)],
                Command(joint) | CommandSize(joint) => &signals.command[joint],
                Time => &signals.time,
                Position(joint) | Sine(joint, _) | Cosine(joint, _) => &signals.q[slot(joint)],
                Speed(joint) | SpeedSize(joint) | Sign(joint) => &signals.dq[slot(joint)],
            };
            for (value, signal) in values.iter_mut().zip(signal) {
                *value *= match factor {
                    Load | Command(_) | Position(_) | Speed(_) | Time => *signal,
                    LoadSize | CommandSize(_) | SpeedSize(_) => signal.abs(),
                    Sine(_, order) => (f64::from(order) * signal).sin(),
                    Cosine(_, order) => (f64::from(order) * signal).cos(),
                    Sign(_) => (signal / SMOOTH).tanh(),
                };
            }
        }
        values
    }
}

/// All products that are tried at joint `own` when the joints `free` move; `kinds` are those of all joints.
pub(super) fn dictionary(own: usize, free: &[usize], kinds: &[JointKind]) -> Vec<Term> {
    let mut terms = BTreeSet::new();
    let mut add = |parts: &[&[Factor]]| {
        let factors = parts.concat();
        // The drive's own torque by itself explains any error, by undoing the drive.
        if !factors.is_empty() && factors != [Load] {
            terms.insert(Term::new(factors));
        }
    };
    let turns = |joint: usize| kinds.get(joint) == Some(&JointKind::Revolute);
    let waves = |joint: usize, highest: u32| -> Vec<Vec<Factor>> {
        let highest = if turns(joint) { highest } else { 0 };
        (1..=highest).flat_map(|k| [vec![Sine(joint, k)], vec![Cosine(joint, k)]]).collect()
    };
    let speeds = |joint: usize| -> Vec<Vec<Factor>> {
        vec![
            vec![Speed(joint)],
            vec![SpeedSize(joint)],
            vec![Speed(joint), SpeedSize(joint)],
            vec![Speed(joint), Speed(joint)],
            vec![Sign(joint)],
        ]
    };
    // Own place times own motion, torque or time.
    let mut places = vec![vec![], vec![Position(own)], vec![Position(own), Position(own)]];
    places.extend(waves(own, HARMONICS));
    let mut motions = vec![vec![], vec![Speed(own); 3], vec![Time]];
    motions.extend(speeds(own));
    motions.extend([vec![Load], vec![LoadSize], vec![Load, LoadSize], vec![Load, Load], vec![Load; 3]]);
    for place in &places {
        for motion in &motions {
            add(&[place, motion]);
        }
    }
    add(&[&[Position(own); 3]]);
    for by in [Time, Load, LoadSize] {
        for speed in speeds(own) {
            add(&[&[by], &speed]);
        }
    }
    add(&[&[Time, Time]]);
    for load in [Load, LoadSize] {
        add(&[&[Time, load]]);
    }
    // With another joint.
    let mut near = vec![vec![], vec![Position(own)], vec![Load], vec![LoadSize], vec![Time]];
    near.extend(waves(own, 1));
    near.extend(speeds(own));
    let others: Vec<usize> = free.iter().copied().filter(|joint| *joint != own).collect();
    for &other in &others {
        let mut far = vec![vec![Position(other)], vec![Position(other), Position(other)]];
        far.extend(waves(other, 1));
        far.extend(speeds(other));
        for own in &near {
            for other in &far {
                add(&[own, other]);
            }
        }
        for place in [vec![vec![Position(other)]], waves(other, 1)].concat() {
            for speed in speeds(other) {
                add(&[&place, &speed]);
            }
        }
        for wave in waves(other, HARMONICS) {
            add(&[&wave]);
        }
        add(&[&[Command(other)]]);
        add(&[&[Command(other), CommandSize(other)]]);
        add(&[&[Command(other), Command(other)]]);
        add(&[&[Command(other); 3]]);
    }
    // Of two other joints.
    for (index, &one) in others.iter().enumerate() {
        for &two in &others[index + 1..] {
            for first in [Position(one), Speed(one)] {
                for second in [Position(two), Speed(two)] {
                    add(&[&[first, second]]);
                }
            }
        }
    }
    terms.into_iter().collect()
}

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

#[cfg(test)]
mod tests {
    use super::*;

    /// At joint 4; joints 2 and 4 move.
    fn signals() -> Signals {
        Signals {
            time: vec![0.5, 2.0],
            q: vec![vec![0.3, -0.4], vec![1.1, 0.7]],
            dq: vec![vec![0.02, -0.5], vec![-0.01, 3.0]],
            command: (0..5).map(|joint| vec![f64::from(joint) - 3.5, f64::from(joint)]).collect(),
            delivered: vec![vec![5.0, 6.0], vec![-7.0, 8.0]],
            per_command: vec![1.0, 1.0],
        }
    }

    #[test]
    fn a_term_is_the_product_of_its_factors() {
        let cases: [(&[Factor], &str, [f64; 2]); 10] = [
            (&[], "", [1.0, 1.0]),
            (&[Load], "load4", [-7.0, 8.0]),
            (&[LoadSize, Time], "|load4| * t", [3.5, 16.0]),
            (&[Command(1), CommandSize(1)], "command1 * |command1|", [-6.25, 1.0]),
            (&[Position(2), Position(4)], "q2 * q4", [0.33, -0.28]),
            (&[Sine(2, 1)], "sin(q2)", [0.3_f64.sin(), -(0.4_f64.sin())]),
            (&[Cosine(4, 3)], "cos(3*q4)", [3.3_f64.cos(), 2.1_f64.cos()]),
            (&[Speed(4), Speed(4), Speed(4)], "dq4 * dq4 * dq4", [-1e-6, 27.0]),
            (&[Speed(2), SpeedSize(4)], "dq2 * |dq4|", [2e-4, -1.5]),
            (&[Sign(4)], "sign(dq4)", [-(1.0_f64.tanh()), 1.0]),
        ];
        for (factors, label, expected) in cases {
            let term = Term::new(factors.to_vec());
            assert_eq!(term.label(4), label);
            let found = term.values(&signals(), &[2, 4], 4);
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{label}: {found:?} {expected:?}");
        }
    }

    #[test]
    fn a_term_knows_its_unit_its_joints_and_what_it_asks_to_be_believed() {
        let term = |factors: &[Factor]| Term::new(factors.to_vec());
        let units = [
            (term(&[Position(4), Position(4)]), "N*m/rad^2"),
            (term(&[Speed(4), Time]), "N*m/rad"),
            (term(&[SpeedSize(4), Speed(4)]), "N*m*s^2/rad^2"),
            (term(&[Load, Load]), "1/N/m"),
            (term(&[LoadSize, Sign(4)]), "1"),
            (term(&[Command(2), CommandSize(2), CommandSize(2)]), "1/command^2"),
            (term(&[Time, Time]), "N*m/s^2"),
        ];
        for (term, unit) in units {
            assert_eq!(term.coefficient_unit(), unit, "{}", term.label(4));
        }
        assert_eq!(term(&[Position(2), Speed(4), Load, Time]).others(4), BTreeSet::from([2]));
        assert!(term(&[LoadSize]).has_load() && !term(&[Time, Speed(4)]).has_load());
        assert!(term(&[CommandSize(2)]).is_command() && !term(&[Load]).is_command());
        let asks = |factors: &[Factor], expected: f64| assert!((term(factors).complexity() - expected).abs() < 1e-12);
        asks(&[Position(4), Sign(4), Time], 3.0);
        asks(&[SpeedSize(4), LoadSize, CommandSize(2)], 3.3);
        asks(&[Sine(4, 1), Cosine(4, 6)], 2.5 + 0.25 * 6.0_f64.ln());
    }

    #[test]
    fn the_dictionary_holds_products_of_places_and_motions() {
        use JointKind::{Prismatic, Revolute};
        let all = |own: usize, free: &[usize], kinds: &[JointKind]| -> Vec<String> {
            dictionary(own, free, kinds).iter().map(|term| term.label(own)).collect()
        };
        // 3 places and 13 motions of one slide, without nothing and the load; its cube; its 5 speeds by time and by each load; time squared;
        // two loads that drift.
        let slide = all(0, &[0], &[Prismatic]);
        assert_eq!(slide.len(), 3 * 13 - 2 + 1 + 3 * 5 + 1 + 2);
        assert!(slide.iter().all(|label| !label.contains("sin") && label != "load0"), "{slide:?}");
        // 24 waves are places more.
        let hinge = all(0, &[0], &[Revolute]);
        assert_eq!(hinge.len(), slide.len() + 24 * 13);
        for label in
            ["|load0| * cos(12*q0)", "q0 * q0 * dq0 * |dq0|", "t * t", "dq0 * dq0 * dq0", "load0 * load0 * load0"]
        {
            assert!(hinge.iter().any(|own| own == label), "{label}");
        }
        assert!(!hinge.iter().any(|label| label.contains("13*")));
        let three = all(1, &[0, 1, 2], &[Revolute, Prismatic, Revolute]);
        let named =
            ["command0 * command0 * command0", "q0 * q2", "dq0 * dq2", "sin(q2) * |dq0|", "sin(12*q0)", "q1 * q2"];
        assert_eq!(named.map(|label| three.iter().any(|own| own == label)), [true, true, true, false, true, true]);
        assert!(three.iter().any(|label| label == "q2 * dq0"), "in the order of kinds");
        assert!(!three.iter().any(|label| label.contains("command1") || label.contains("sin(q1)")), "{three:?}");
        let labels: BTreeSet<&String> = three.iter().collect();
        assert_eq!(labels.len(), three.len(), "each stands once");
    }
}

//! What the name of a column says: a quantity, whose it is, in which unit.
//!
//! A name is parted into words and numbers (`/joint_states/position[0]`, `actPos1`, `tau_J_0 [Nm]`). Words that a field's
//! vocabulary knows say the quantity, whether it was measured or asked for, and the unit; words that it does not know speak
//! against a column. No product's header is known as a whole.

use std::f64::consts::PI;

use dynid_model::{Device, JointKind};
use serde::Serialize;

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Time.
    Time,
    /// Joint position.
    Position,
    /// Joint speed.
    Speed,
    /// Joint acceleration.
    Acceleration,
    /// Torque or force.
    Torque,
    /// Motor current.
    Current,
    /// Motor voltage.
    Voltage,
}

/// Whether a column was measured or asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Origin {
    Measured,
    Unsaid,
    Commanded,
}

impl Quantity {
    /// Whether it is what drives a joint.
    pub(crate) fn drives(self) -> bool {
        matches!(self, Self::Torque | Self::Current | Self::Voltage)
    }
}

/// A unit and its factor to SI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Unit {
    pub name: &'static str,
    pub quantity: Quantity,
    pub factor: f64,
}

impl Unit {
    /// Whether a column of `quantity` may be in it: speeds and accelerations are told by the unit of their position.
    pub fn is_of(&self, quantity: Quantity) -> bool {
        let position =
            if matches!(quantity, Quantity::Speed | Quantity::Acceleration) { Quantity::Position } else { quantity };
        self.quantity == position
    }

    /// Whether a position of such a joint may be in it.
    pub fn is_of_joint(&self, kind: JointKind) -> bool {
        let is_length = matches!(self.name, "m" | "mm");
        self.quantity == Quantity::Position && is_length == (kind == JointKind::Prismatic)
    }
}

/// Which joint a name means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum JointKey {
    /// The device's joint of that title.
    Title(usize),
    /// A number, counted from 0 or from 1.
    Number(usize),
    /// None is said.
    Unsaid,
}

/// What a name says.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Meaning {
    pub quantity: Option<Quantity>,
    pub origin: Origin,
    pub unit: Option<Unit>,
    pub joint: JointKey,
    /// What no vocabulary knows.
    pub unknown: Vec<String>,
}

/// What the name of a column of a log of `device` says.
pub(crate) fn meaning(name: &str, device: &Device) -> Meaning {
    let (bare, in_brackets) = without_unit_in_brackets(name);
    let mut words = words(&bare);
    let title = take_title(&mut words, device);
    let is_number = |word: &String| word.bytes().all(|byte| byte.is_ascii_digit());
    let number = match title {
        Some(_) => None,
        None => words.iter().rposition(is_number).and_then(|place| words.remove(place).parse().ok()),
    };
    let among_words = if in_brackets.is_none() { take_unit(&mut words) } else { None };
    let mut own = Meaning {
        quantity: None,
        origin: Origin::Unsaid,
        unit: in_brackets,
        joint: JointKey::Unsaid,
        unknown: Vec::new(),
    };
    let is_reference = words.iter().any(|word| word == "ref" || word == "reference");
    for word in words {
        if let Some(quantity) = quantity(&word) {
            own.quantity = own.quantity.max(Some(quantity));
        } else if let Some(origin) = origin(&word) {
            own.origin = origin;
        } else if !is_neutral(&word) {
            own.unknown.push(word);
        }
    }
    if let Some((word, unit)) = among_words {
        if is_clear(&word, &unit, own.quantity) {
            own.unit = Some(unit);
        } else if !is_neutral(&word) {
            own.unknown.push(word);
        }
    }
    if let Some(unit) = own.unit {
        // What drives a joint is what its unit says, whatever it is called: `torque [A]` is a current.
        let said = own.quantity.filter(|said| !(said.drives() && unit.quantity.drives()));
        own.quantity = said.or(Some(unit.quantity));
    }
    // A reference of nothing is one of the position.
    if own.quantity.is_none() && is_reference {
        own.quantity = Some(Quantity::Position);
    }
    own.joint = title.map_or(number.map_or(JointKey::Unsaid, JointKey::Number), JointKey::Title);
    own
}

/// Lower-case words and numbers of a name: parted at signs, between letters and digits, and where a capital follows a small
/// letter, unless that makes a unit: `mA`.
pub(crate) fn words(name: &str) -> Vec<String> {
    let is_edge = |before: char, letter: char| before.is_ascii_digit() != letter.is_ascii_digit();
    let runs = name.split(|letter: char| !letter.is_alphanumeric()).flat_map(|run| parted_where(run, is_edge));
    let is_hump = |before: char, letter: char| before.is_lowercase() && letter.is_uppercase();
    let words = runs
        .flat_map(|run| if unit_of(&run.to_lowercase()).is_some() { vec![run] } else { parted_where(run, is_hump) });
    words.map(str::to_lowercase).flat_map(parted).collect()
}

/// The parts of a text, which begin where two letters are an edge.
fn parted_where(text: &str, is_edge: impl Fn(char, char) -> bool) -> Vec<&str> {
    let pairs = text.char_indices().zip(text.char_indices().skip(1));
    let edges = pairs.filter(|((_, before), (_, letter))| is_edge(*before, *letter)).map(|(_, (place, _))| place);
    let mut parts = Vec::new();
    let mut from = 0;
    for edge in edges.chain([text.len()]).filter(|edge| *edge > 0) {
        parts.push(&text[from..edge]);
        from = edge;
    }
    parts
}

/// A word that the vocabulary does not know, in two that it does: `jointpos`.
fn parted(word: String) -> Vec<String> {
    let is_known = |word: &str| quantity(word).is_some() || origin(word).is_some() || is_neutral(word);
    if is_known(&word) || unit_of(&word).is_some() || !word.is_ascii() {
        return vec![word];
    }
    let halves = (2..word.len().saturating_sub(1)).map(|at| word.split_at(at));
    match halves.into_iter().find(|(first, last)| is_known(first) && is_known(last)) {
        Some((first, last)) => vec![first.to_owned(), last.to_owned()],
        None => vec![word],
    }
}

fn quantity(word: &str) -> Option<Quantity> {
    Some(match word {
        "t" | "time" | "times" | "timestamp" | "stamp" | "clock" | "elapsed" => Quantity::Time,
        "q" | "qpos" | "pos" | "position" | "positions" | "angle" | "angles" | "theta" | "enc" | "encoder" => {
            Quantity::Position
        }
        "qd" | "dq" | "qdot" | "qvel" | "vel" | "velocity" | "velocities" | "speed" | "omega" => Quantity::Speed,
        "qdd" | "ddq" | "qddot" | "qacc" | "acc" | "accel" | "acceleration" => Quantity::Acceleration,
        "tau" | "torque" | "torques" | "trq" | "effort" | "efforts" | "moment" | "moments" | "force" => {
            Quantity::Torque
        }
        "current" | "currents" | "curr" | "cur" | "i" => Quantity::Current,
        "voltage" | "volt" | "volts" | "u" => Quantity::Voltage,
        _ => return None,
    })
}

fn origin(word: &str) -> Option<Origin> {
    Some(match word {
        "ref" | "reference" | "target" | "des" | "desired" | "d" | "cmd" | "command" | "commanded" | "set"
        | "setpoint" | "goal" => Origin::Commanded,
        "act" | "actual" | "meas" | "measured" | "msr" | "fb" | "feedback" => Origin::Measured,
        _ => return None,
    })
}

/// Words that say nothing here.
fn is_neutral(word: &str) -> bool {
    const WORDS: [&str; 17] = [
        "joint", "joints", "jnt", "j", "axis", "ax", "a", "dof", "state", "states", "robot", "arm", "value", "values",
        "data", "header", "msg",
    ];
    WORDS.contains(&word)
}

fn unit_of(word: &str) -> Option<Unit> {
    use Quantity::{Current, Position, Time, Torque, Voltage};
    let (name, quantity, factor) = match word {
        "rad" | "rads" | "radians" => ("rad", Position, 1.0),
        "deg" | "degs" | "degree" | "degrees" | "grad" => ("degrees", Position, PI / 180.0),
        "rev" | "revs" | "turns" => ("turns", Position, 2.0 * PI),
        "mm" | "mms" => ("mm", Position, 1e-3),
        "m" => ("m", Position, 1.0),
        "s" | "sec" | "secs" | "second" | "seconds" => ("s", Time, 1.0),
        "ms" | "msec" | "msecs" | "millis" | "milliseconds" => ("ms", Time, 1e-3),
        "us" | "usec" | "usecs" | "micros" | "microseconds" => ("us", Time, 1e-6),
        "ns" | "nsec" | "nsecs" | "nanos" | "nanosec" | "nanosecs" | "nanoseconds" => ("ns", Time, 1e-9),
        "nm" => ("N*m", Torque, 1.0),
        "mnm" => ("mN*m", Torque, 1e-3),
        "n" => ("N", Torque, 1.0),
        "a" => ("A", Current, 1.0),
        "ma" => ("mA", Current, 1e-3),
        "v" => ("V", Voltage, 1.0),
        "mv" => ("mV", Voltage, 1e-3),
        _ => return None,
    };
    Some(Unit { name, quantity, factor })
}

/// `q1 [deg]`, `tau (N*m)`: the unit, and the name without it. What stands in brackets and is no unit stays.
fn without_unit_in_brackets(name: &str) -> (String, Option<Unit>) {
    let open = name.rfind(['[', '(']);
    let close = name.rfind([']', ')']);
    if let (Some(open), Some(close)) = (open, close)
        && open < close
    {
        let letters = name[open..close].chars().filter(|letter| letter.is_alphabetic());
        if let Some(unit) = unit_of(&letters.flat_map(char::to_lowercase).collect::<String>()) {
            return (format!("{} {}", &name[..open], &name[close + 1..]), Some(unit));
        }
    }
    (name.to_owned(), None)
}

/// A unit among the words, and the word, which it takes out: of several letters anywhere, of one letter only as the last word of several.
fn take_unit(words: &mut Vec<String>) -> Option<(String, Unit)> {
    let n_words = words.len();
    let is_unit = |place: usize, word: &str| {
        let may_be = word.len() > 1 || (n_words > 1 && place + 1 == n_words);
        unit_of(word).filter(|_| may_be)
    };
    let place = (0..n_words).rev().find(|place| is_unit(*place, &words[*place]).is_some())?;
    let word = words.remove(place);
    unit_of(&word).map(|unit| (word, unit))
}

/// Whether a word that may be a unit is one, beside words that say this quantity: `q_a` is no position in amperes, nor
/// `second_joint_torque` one in seconds, but `q_ms` asks to be looked at.
fn is_clear(word: &str, unit: &Unit, quantity: Option<Quantity>) -> bool {
    match quantity {
        Some(quantity) => unit.is_of(quantity) || (word.len() > 1 && (unit.factor != 1.0 || unit.quantity.drives())),
        None => word.len() > 1,
    }
}

/// The joint whose title stands among the words, which it leaves; of several the longest.
fn take_title(words: &mut Vec<String>, device: &Device) -> Option<usize> {
    let mut found: Option<(usize, usize, usize)> = None;
    for (joint, own) in device.joints.iter().enumerate() {
        let whole = self::words(&own.title);
        let short: Vec<String> = whole.iter().filter(|word| !is_neutral(word)).cloned().collect();
        for title in [whole, short] {
            let says_little = |word: &String| quantity(word).is_some() || word.bytes().all(|b| b.is_ascii_digit());
            if title.iter().all(says_little) {
                continue;
            }
            let place = words.windows(title.len()).position(|window| window == title);
            if let Some(place) = place.filter(|_| found.is_none_or(|(_, _, length)| title.len() > length)) {
                found = Some((joint, place, title.len()));
            }
        }
    }
    let (joint, place, length) = found?;
    words.drain(place..place + length);
    Some(joint)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str) -> (Option<Quantity>, Origin, Option<&'static str>, JointKey) {
        let device = dynid_model::device("planar2r").expect("a shipped device");
        let own = meaning(name, device);
        (own.quantity, own.origin, own.unit.map(|unit| unit.name), own.joint)
    }

    #[test]
    fn names_of_many_habits_are_read() {
        use JointKey::{Number, Title, Unsaid as NoJoint};
        use Origin::{Commanded, Measured, Unsaid};
        use Quantity::*;
        let cases = [
            ("t", (Some(Time), Unsaid, None, NoJoint)),
            ("t_ms", (Some(Time), Unsaid, Some("ms"), NoJoint)),
            ("time [s]", (Some(Time), Unsaid, Some("s"), NoJoint)),
            ("header.stamp.nanosec", (Some(Time), Unsaid, Some("ns"), NoJoint)),
            ("q0", (Some(Position), Unsaid, None, Number(0))),
            ("q_1", (Some(Position), Unsaid, None, Number(1))),
            ("/joint_states/position[0]", (Some(Position), Unsaid, None, Number(0))),
            ("pos.joint1", (Some(Position), Unsaid, None, Number(1))),
            ("jointpos1", (Some(Position), Unsaid, None, Number(1))),
            ("ActPos2 (deg)", (Some(Position), Measured, Some("degrees"), Number(2))),
            ("q_d3", (Some(Position), Commanded, None, Number(3))),
            ("target_q_0", (Some(Position), Commanded, None, Number(0))),
            ("qd0", (Some(Speed), Unsaid, None, Number(0))),
            ("dq3", (Some(Speed), Unsaid, None, Number(3))),
            ("actual_qd_4", (Some(Speed), Measured, None, Number(4))),
            ("speed_1 [rad/s]", (Some(Speed), Unsaid, Some("rad"), Number(1))),
            ("tau_J_0", (Some(Torque), Unsaid, None, Number(0))),
            ("effort.elbow", (Some(Torque), Unsaid, None, Title(1))),
            ("motor torque 1 [mN*m]", (Some(Torque), Unsaid, Some("mN*m"), Number(1))),
            ("actual_current_5", (Some(Current), Measured, None, Number(5))),
            ("shoulder angle [deg]", (Some(Position), Unsaid, Some("degrees"), Title(0))),
            ("temperature_1", (None, Unsaid, None, Number(1))),
            ("motor1 [A]", (Some(Current), Unsaid, Some("A"), Number(1))),
            ("motor_1_mA", (Some(Current), Unsaid, Some("mA"), Number(1))),
            ("motor torque 1 mNm", (Some(Torque), Unsaid, Some("mN*m"), Number(1))),
            ("tau0 [mA]", (Some(Current), Unsaid, Some("mA"), Number(0))),
            ("force_2 [N]", (Some(Torque), Unsaid, Some("N"), Number(2))),
            ("tau_2 [N]", (Some(Torque), Unsaid, Some("N"), Number(2))),
            ("q0_ms", (Some(Position), Unsaid, Some("ms"), Number(0))),
            ("q2 [mm]", (Some(Position), Unsaid, Some("mm"), Number(2))),
            ("torque_a", (Some(Torque), Unsaid, None, NoJoint)),
            ("soll_a", (None, Unsaid, None, NoJoint)),
            ("second_joint_torque", (Some(Torque), Unsaid, None, NoJoint)),
        ];
        for (name, expected) in cases {
            assert_eq!(of(name), expected, "{name}");
        }
    }

    #[test]
    fn what_is_not_understood_is_kept() {
        let device = dynid_model::device("planar2r").expect("a shipped device");
        assert_eq!(meaning("tau_ext_hat_0", device).unknown, ["ext", "hat"]);
    }
}

//! SI units and the dimension analysis of formulas.
//!
//! Effect files give units *at a revolute joint* (`rad`, `N*m`). The same law serves a prismatic joint when `rad`
//! becomes `m` and torque becomes force: `N*m*s/rad` -> `N*s/m`, `kg*m^2` -> `kg`.

use std::fmt;

use crate::{
    device::JointKind,
    expression::{BinaryOperator, Expression, Function},
};

/// A product of powers of `kg m s A rad N V command`; `command` is the unit of the logged command before the gain.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unit {
    factors: Vec<(Atom, i32)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Atom {
    Newton,
    Kilogram,
    Metre,
    Second,
    Ampere,
    Volt,
    Radian,
    Command,
}

/// Exponents of kg, m, s, A and the command's unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Dimension([i32; 5]);

impl Unit {
    /// Reads e.g. `N*m*s/rad`, `kg*m^2`, `1`.
    ///
    /// # Errors
    /// Says which part is no SI unit.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut factors: Vec<(Atom, i32)> = Vec::new();
        let mut sign = 1;
        let mut rest = text.trim();
        if rest.is_empty() {
            return Err("the unit is empty; write `1` for a number without a unit".to_owned());
        }
        loop {
            let end = rest.find(['*', '/']).unwrap_or(rest.len());
            let (name, exponent) = match rest[..end].split_once('^') {
                Some((name, exponent)) => {
                    let exponent = exponent.trim().parse::<i32>();
                    (name.trim(), exponent.map_err(|_| format!("`{}` has no whole exponent", rest[..end].trim()))?)
                }
                None => (rest[..end].trim(), 1),
            };
            if name != "1" {
                let atom = Atom::named(name)?;
                add_factor(&mut factors, atom, sign * exponent);
            }
            if end == rest.len() {
                factors.retain(|(_, exponent)| *exponent != 0);
                return Ok(Self { factors });
            }
            sign = if rest.as_bytes()[end] == b'/' { -1 } else { 1 };
            rest = &rest[end + 1..];
        }
    }

    /// The unit of the same quantity at a joint of this kind.
    #[must_use]
    pub fn at(&self, kind: JointKind) -> Self {
        if kind == JointKind::Revolute {
            return self.clone();
        }
        // `kg*m^2` is an inertia, which a mass replaces; a mass itself stays one.
        let is_mass = !self.factors.iter().any(|(atom, _)| *atom == Atom::Metre);
        let mut metres = 0;
        let mut factors = Vec::new();
        for &(atom, exponent) in &self.factors {
            match atom {
                Atom::Radian | Atom::Metre => metres += exponent,
                Atom::Newton => metres -= exponent,
                Atom::Kilogram if !is_mass => metres -= 2 * exponent,
                _ => {}
            }
            if !matches!(atom, Atom::Radian | Atom::Metre) {
                factors.push((atom, exponent));
            }
        }
        if metres != 0 {
            // After the force or the mass, as one writes N/m, kg/m.
            let place = factors.iter().take_while(|(atom, _)| matches!(atom, Atom::Newton | Atom::Kilogram)).count();
            factors.insert(place, (Atom::Metre, metres));
        }
        Self { factors }
    }

    /// The unit with that of a joint's command in the place of `command`.
    #[must_use]
    pub fn with_command(&self, command: &Self) -> Self {
        let mut factors = Vec::new();
        for &(atom, exponent) in &self.factors {
            if atom == Atom::Command {
                for &(other, power) in &command.factors {
                    add_factor(&mut factors, other, power * exponent);
                }
            } else {
                add_factor(&mut factors, atom, exponent);
            }
        }
        factors.retain(|(_, exponent)| *exponent != 0);
        Self { factors }
    }

    /// What it measures; `rad` counts as a number.
    pub fn dimension(&self) -> Dimension {
        self.factors.iter().fold(Dimension::default(), |sum, (atom, exponent)| sum.times(atom.dimension(), *exponent))
    }
}

fn add_factor(factors: &mut Vec<(Atom, i32)>, atom: Atom, exponent: i32) {
    match factors.iter_mut().find(|(known, _)| *known == atom) {
        Some((_, sum)) => *sum += exponent,
        None => factors.push((atom, exponent)),
    }
}

/// `N*m*s/rad`, `1/s`, `1`.
impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let power = |f: &mut fmt::Formatter<'_>, name: &str, exponent: i32| {
            if exponent == 1 { f.write_str(name) } else { write!(f, "{name}^{exponent}") }
        };
        let mut first = true;
        for (atom, exponent) in self.factors.iter().filter(|(_, exponent)| *exponent > 0) {
            f.write_str(if first { "" } else { "*" })?;
            power(f, atom.name(), *exponent)?;
            first = false;
        }
        if first {
            f.write_str("1")?;
        }
        for (atom, exponent) in self.factors.iter().filter(|(_, exponent)| *exponent < 0) {
            f.write_str("/")?;
            power(f, atom.name(), -exponent)?;
        }
        Ok(())
    }
}

impl Atom {
    const ALL: [Self; 8] = [
        Self::Newton,
        Self::Kilogram,
        Self::Metre,
        Self::Second,
        Self::Ampere,
        Self::Volt,
        Self::Radian,
        Self::Command,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Newton => "N",
            Self::Kilogram => "kg",
            Self::Metre => "m",
            Self::Second => "s",
            Self::Ampere => "A",
            Self::Volt => "V",
            Self::Radian => "rad",
            Self::Command => "command",
        }
    }

    fn named(name: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|atom| atom.name() == name).ok_or_else(|| {
            let known = Self::ALL.map(Self::name).join(", ");
            format!("`{name}` is not an SI unit that is known here ({known}, 1)")
        })
    }

    fn dimension(self) -> Dimension {
        Dimension(match self {
            Self::Newton => [1, 1, -2, 0, 0],
            Self::Kilogram => [1, 0, 0, 0, 0],
            Self::Metre => [0, 1, 0, 0, 0],
            Self::Second => [0, 0, 1, 0, 0],
            Self::Ampere => [0, 0, 0, 1, 0],
            Self::Volt => [1, 2, -3, -1, 0],
            Self::Radian => [0; 5],
            Self::Command => [0, 0, 0, 0, 1],
        })
    }
}

impl Dimension {
    /// A pure number.
    pub const NUMBER: Self = Self([0; 5]);

    /// `self * other^exponent`.
    #[must_use]
    pub fn times(self, other: Self, exponent: i32) -> Self {
        Self(std::array::from_fn(|base| self.0[base] + exponent * other.0[base]))
    }

    fn root(self) -> Option<Self> {
        self.0.iter().all(|exponent| exponent % 2 == 0).then(|| Self(self.0.map(|exponent| exponent / 2)))
    }
}

/// `kg*m^2/s^2`; `1` for a number.
impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let atoms = [Atom::Kilogram, Atom::Metre, Atom::Second, Atom::Ampere, Atom::Command];
        let factors = atoms.into_iter().zip(self.0).filter(|(_, exponent)| *exponent != 0).collect();
        Unit { factors }.fmt(f)
    }
}

/// Why a formula has no dimension; `symbol` is one that stands in the offending part.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DimensionError {
    /// What does not fit.
    pub message: String,
    /// The first symbol of the offending part.
    pub symbol: Option<String>,
}

/// The dimension of a formula; `None` for one that is zero and so fits everywhere.
///
/// # Errors
/// Sums of different dimensions, functions of what is no number, symbols that `dimension_of` does not know.
pub fn dimension(
    expression: &Expression,
    dimension_of: &dyn Fn(&str) -> Option<Dimension>,
) -> Result<Option<Dimension>, DimensionError> {
    let error = |message: String, part: &Expression| {
        let mut symbol = None;
        part.for_each_symbol(&mut |name| {
            if symbol.is_none() {
                symbol = Some(name.to_owned());
            }
        });
        DimensionError { message, symbol }
    };
    let same = |a: &Expression, b: &Expression, verb: &str| -> Result<Option<Dimension>, DimensionError> {
        match (dimension(a, dimension_of)?, dimension(b, dimension_of)?) {
            (Some(x), Some(y)) if x != y => {
                Err(error(format!("`{a}` [{x}] and `{b}` [{y}] cannot be {verb}: their units differ"), b))
            }
            (x, y) => Ok(x.or(y)),
        }
    };
    match expression {
        Expression::Number(value) => Ok((*value != 0.0).then_some(Dimension::NUMBER)),
        Expression::Symbol(name) => match dimension_of(name) {
            Some(found) => Ok(Some(found)),
            None => Err(error(format!("unknown symbol `{name}`"), expression)),
        },
        Expression::Negate(x) => dimension(x, dimension_of),
        Expression::Binary(BinaryOperator::Add, a, b) => same(a, b, "added"),
        Expression::Binary(BinaryOperator::Subtract, a, b) => same(a, b, "subtracted"),
        Expression::Binary(operator, a, b) => {
            let exponent = if *operator == BinaryOperator::Multiply { 1 } else { -1 };
            Ok(match (dimension(a, dimension_of)?, dimension(b, dimension_of)?) {
                (Some(x), Some(y)) => Some(x.times(y, exponent)),
                _ => None,
            })
        }
        Expression::Call(function, arguments) => match (function, arguments.as_slice()) {
            (Function::Abs, [x]) => dimension(x, dimension_of),
            (Function::Sign, [x]) => dimension(x, dimension_of).map(|_| Some(Dimension::NUMBER)),
            (Function::Min | Function::Max, [a, b]) => same(a, b, "compared"),
            (Function::Sqrt, [x]) => match dimension(x, dimension_of)? {
                None => Ok(None),
                Some(square) => match square.root() {
                    Some(root) => Ok(Some(root)),
                    None => Err(error(format!("`{x}` [{square}] has no square root in whole units"), x)),
                },
            },
            (_, arguments) => {
                for x in arguments {
                    match dimension(x, dimension_of)? {
                        None | Some(Dimension::NUMBER) => {}
                        Some(found) => {
                            let name = function.name();
                            return Err(error(
                                format!("`{name}` takes a number without a unit, but `{x}` is in [{found}]"),
                                x,
                            ));
                        }
                    }
                }
                Ok(Some(Dimension::NUMBER))
            }
        },
        Expression::IfElse(_, parts) => {
            let [a, b, x, y] = &**parts;
            same(a, b, "compared")?;
            same(x, y, "alternatives of one `if`")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(text: &str) -> Unit {
        Unit::parse(text).unwrap()
    }

    #[test]
    fn units_at_a_prismatic_joint() {
        let pairs = [
            ("N*m*s/rad", "N*s/m"),
            ("N*m", "N"),
            ("kg*m^2", "kg"),
            ("kg", "kg"),
            ("rad/N/m", "m/N"),
            ("rad/s", "m/s"),
            ("N*m/command", "N/command"),
            ("N*m/rad", "N/m"),
            ("N*m/rad^3", "N/m^3"),
            ("1/s", "1/s"),
            ("1", "1"),
        ];
        for (revolute, prismatic) in pairs {
            assert_eq!(unit(revolute).to_string(), revolute);
            assert_eq!(unit(revolute).at(JointKind::Revolute).to_string(), revolute);
            assert_eq!(unit(revolute).at(JointKind::Prismatic).to_string(), prismatic);
        }
    }

    #[test]
    fn volt_is_watt_per_ampere() {
        assert_eq!(unit("V*A*s").dimension(), unit("N*m").dimension());
    }

    #[test]
    fn units_that_are_none() {
        assert!(Unit::parse("Nm").unwrap_err().contains("`Nm`"));
        assert!(Unit::parse("").is_err());
        assert!(Unit::parse("m^x").is_err());
        assert!(Unit::parse("deg/s").is_err());
        assert!(Unit::parse("m*").is_err());
    }

    #[test]
    fn dimensions_of_formulas() {
        let of = |text: &str| {
            dimension(&Expression::parse(text).unwrap(), &|name| match name {
                "Fc" => Some(unit("N*m").dimension()),
                "dq" | "v" => Some(unit("m/s").dimension()),
                _ => None,
            })
            .map(|found| found.map(|found| found.to_string()))
        };
        assert_eq!(of("Fc * tanh(dq / v)"), Ok(Some("kg*m^2/s^2".to_owned())));
        assert_eq!(of("max(Fc, 0)"), Ok(Some("kg*m^2/s^2".to_owned())));
        assert_eq!(of("sqrt(dq * v) + dq"), Ok(Some("m/s".to_owned())));
        assert_eq!(of("0"), Ok(None));
        assert!(of("Fc + dq").unwrap_err().message.contains("cannot be added"));
        assert!(of("exp(dq)").unwrap_err().message.contains("without a unit"));
        assert!(of("sqrt(dq)").is_err());
        assert_eq!(of("Fc * x").unwrap_err().symbol.as_deref(), Some("x"));
        assert!(of("if dq < Fc { 1 } else { 2 }").is_err());
    }
}

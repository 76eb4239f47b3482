//! Numbers that keep the text they were written in.

use std::f64::consts::FRAC_PI_2;

/// An angle so near a whole number of quarter turns \[rad\] is meant to be that: it is what ten digits write, and what the
/// reader of device files takes for one.
const ROUNDING: f64 = 3e-10;

/// A number, and its text where it was read.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Number {
    pub value: f64,
    text: Option<String>,
}

impl Number {
    pub const ZERO: Self = Self { value: 0.0, text: None };

    /// A number as XML descriptions write it; infinite ones are numbers, undefined ones are not.
    pub fn parse(text: &str) -> Option<Self> {
        let value: f64 = text.parse().ok().filter(|value: &f64| !value.is_nan())?;
        Some(Self { value, text: Some(text.to_owned()).filter(|text| value.is_finite() && is_toml_number(text)) })
    }

    /// As a TOML value.
    pub fn toml(&self) -> String {
        match &self.text {
            _ if self.value == 0.0 => "0".to_owned(),
            Some(text) => text.clone(),
            None if self.value.is_infinite() => if self.value > 0.0 { "inf" } else { "-inf" }.to_owned(),
            None => format!("{:?}", self.value),
        }
    }

    /// As a TOML value of an angle: quarter turns in terms of pi.
    pub fn toml_angle(&self) -> String {
        match quarter_turns(self.value) {
            Some(0) => "0".to_owned(),
            Some(quarters) => format!("\"{}\"", name_of(quarters)),
            None => self.toml(),
        }
    }

    /// As a term of an expression that follows others: ` + 0.1`, ` - pi/2`, nothing for 0.
    pub fn term(&self, is_angle: bool) -> String {
        let quarters = if is_angle { quarter_turns(self.value) } else { None };
        let size = match quarters {
            Some(quarters) => name_of(quarters.abs()),
            None => format!("{:?}", self.value.abs()),
        };
        match (self.value, quarters) {
            (_, Some(0)) | (0.0, _) => String::new(),
            (value, _) if value < 0.0 => format!(" - {size}"),
            _ => format!(" + {size}"),
        }
    }

    /// The angle \[rad\] that the reader takes it for.
    pub fn angle(&self) -> f64 {
        quarter_turns(self.value).map_or(self.value, |quarters| f64::from(quarters) * FRAC_PI_2)
    }

    /// Whether somebody meant a quarter turn and wrote too few digits for the reader to see it.
    pub fn is_rough_quarter_turn(&self) -> bool {
        let quarters = (self.value / FRAC_PI_2).round();
        quarters != 0.0 && quarter_turns(self.value).is_none() && (self.value - quarters * FRAC_PI_2).abs() < 1e-3
    }
}

impl From<f64> for Number {
    fn from(value: f64) -> Self {
        Self { value, text: None }
    }
}

/// Integers past 15 digits may not fit into TOML's.
fn is_toml_number(text: &str) -> bool {
    let unsigned = text.strip_prefix(['+', '-']).unwrap_or(text);
    let (mantissa, exponent) = unsigned.split_once(['e', 'E']).map_or((unsigned, None), |(a, b)| (a, Some(b)));
    let (whole, fraction) = mantissa.split_once('.').map_or((mantissa, None), |(a, b)| (a, Some(b)));
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let is_float = fraction.is_some() || exponent.is_some();
    digits(whole)
        && (whole.len() == 1 || !whole.starts_with('0'))
        && (is_float || whole.len() <= 15)
        && fraction.is_none_or(digits)
        && exponent.is_none_or(|exponent| digits(exponent.strip_prefix(['+', '-']).unwrap_or(exponent)))
}

/// How many quarter turns the angle is meant to be, if it is a whole number of them and not many.
pub(crate) fn quarter_turns(angle: f64) -> Option<i32> {
    let quarters = (angle / FRAC_PI_2).round();
    (quarters.abs() <= 8.0 && (angle - quarters * FRAC_PI_2).abs() < ROUNDING).then_some(quarters as i32)
}

fn name_of(quarters: i32) -> String {
    let sign = if quarters < 0 { "-" } else { "" };
    match (quarters.abs() % 2, quarters.abs()) {
        (0, 2) => format!("{sign}pi"),
        (0, size) => format!("{sign}{}*pi", size / 2),
        (_, 1) => format!("{sign}pi/2"),
        (_, size) => format!("{sign}{size}*pi/2"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn toml(text: &str) -> String {
        Number::parse(text).unwrap().toml()
    }

    #[test]
    fn text_is_kept_where_toml_has_it() {
        let kept = ["0.40", "1e-3", "-2.5E+04", "+3.10", "12", "6.123233995736766e-17"];
        assert_eq!(kept.map(toml), kept);
        let rewritten = ["1.", ".5", "-.25", "007", "0", "-0.0", "1e400", "123456789012345678901"].map(toml);
        assert_eq!(rewritten, ["1.0", "0.5", "-0.25", "7.0", "0", "0", "inf", "1.2345678901234568e20"]);
        assert!(["", "nan", "1,5", "0.1m", "${x}"].iter().all(|text| Number::parse(text).is_none()));
    }

    #[test]
    fn quarter_turns_are_named() {
        let angle = |text: &str| Number::parse(text).unwrap().toml_angle();
        let named = ["1.5707963268", "-1.570796327", "3.14159265359", "-3.14159265358979", "4.71238898038", "1e-11"];
        assert_eq!(named.map(angle), ["\"pi/2\"", "\"-pi/2\"", "\"pi\"", "\"-pi\"", "\"3*pi/2\"", "0"]);
        assert_eq!(["1.5708", "3.1416", "0.1"].map(angle), ["1.5708", "3.1416", "0.1"]);
        assert_eq!(
            ["1.5708", "3.1416", "0.1"].map(|text| Number::parse(text).unwrap().is_rough_quarter_turn()),
            [true, true, false]
        );
    }

    /// What is written is read as the same number, to the last bit.
    #[test]
    fn numbers_survive() {
        for value in [0.1, 1.0 / 3.0, -6.02e23, 5e-324, 1.25, -0.00012345678901234567] {
            let written = Number::from(value).toml();
            assert_eq!(written.parse::<f64>(), Ok(value));
            assert!(is_toml_number(&written), "{written}");
        }
    }
}

//! Fractions that say where they grow too large, instead of being wrong.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A fraction in lowest terms; or none, once something was too large or divided by 0: every result that it has a part in is none too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fraction {
    numerator: i128,
    /// Positive; 0 for none.
    denominator: i128,
}

impl Fraction {
    /// 0
    pub const ZERO: Self = Self { numerator: 0, denominator: 1 };
    /// 1
    pub const ONE: Self = Self { numerator: 1, denominator: 1 };
    /// What is left of a number that was too large.
    pub const NONE: Self = Self { numerator: 0, denominator: 0 };

    /// `numerator / denominator`
    pub fn new(numerator: i128, denominator: i128) -> Self {
        let divisor = common_divisor(numerator.unsigned_abs(), denominator.unsigned_abs());
        let (Ok(divisor), true) = (i128::try_from(divisor), denominator != 0) else { return Self::NONE };
        let (numerator, denominator) = (numerator / divisor, denominator / divisor);
        if denominator > 0 {
            return Self { numerator, denominator };
        }
        match (numerator.checked_neg(), denominator.checked_neg()) {
            (Some(numerator), Some(denominator)) => Self { numerator, denominator },
            _ => Self::NONE,
        }
    }

    /// Numerator and denominator, unless it is none.
    pub fn parts(self) -> Option<(i128, i128)> {
        (self.denominator > 0).then_some((self.numerator, self.denominator))
    }

    /// The nearest number, rounded twice where both parts are large; no number for none.
    pub fn to_f64(self) -> f64 {
        self.parts().map_or(f64::NAN, |(numerator, denominator)| numerator as f64 / denominator as f64)
    }

    fn of(parts: Option<(i128, i128)>) -> Self {
        parts.map_or(Self::NONE, |(numerator, denominator)| Self::new(numerator, denominator))
    }
}

impl From<i64> for Fraction {
    fn from(value: i64) -> Self {
        Self { numerator: value.into(), denominator: 1 }
    }
}

impl Add for Fraction {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let sum = || {
            let ((a, b), (c, d)) = (self.parts()?, other.parts()?);
            Some((a.checked_mul(d)?.checked_add(c.checked_mul(b)?)?, b.checked_mul(d)?))
        };
        Self::of(sum())
    }
}

impl Mul for Fraction {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let product = || {
            let ((a, b), (c, d)) = (self.parts()?, other.parts()?);
            Some((a.checked_mul(c)?, b.checked_mul(d)?))
        };
        Self::of(product())
    }
}

impl Neg for Fraction {
    type Output = Self;

    fn neg(self) -> Self {
        Self::of(self.parts().and_then(|(numerator, denominator)| Some((numerator.checked_neg()?, denominator))))
    }
}

impl Sub for Fraction {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Div for Fraction {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        let quotient = || {
            let ((a, b), (c, d)) = (self.parts()?, other.parts()?);
            Some((a.checked_mul(d)?, b.checked_mul(c)?))
        };
        Self::of(quotient())
    }
}

fn common_divisor(mut a: u128, mut b: u128) -> u128 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_are_in_lowest_terms_and_obey_the_rules() {
        let all: Vec<Fraction> = (-6..=6).flat_map(|a| (1..=6).map(move |b| Fraction::new(a, b))).collect();
        for a in &all {
            for b in &all {
                assert_eq!(*a + *b - *b, *a);
                if *b != Fraction::ZERO {
                    assert_eq!(*a * *b / *b, *a);
                }
                assert_eq!((*a * *b).to_f64().total_cmp(&0.0), (*b * *a).to_f64().total_cmp(&0.0));
                assert!(((*a + *b).to_f64() - (a.to_f64() + b.to_f64())).abs() < 1e-12);
            }
        }
        assert_eq!(Fraction::new(6, -4).parts(), Some((-3, 2)));
        assert_eq!(Fraction::new(0, -4), Fraction::ZERO);
    }

    #[test]
    fn what_is_too_large_is_none_and_stays_so() {
        let large = Fraction::new(i128::MAX, 1);
        for none in [large * large, large + large, Fraction::ONE / Fraction::ZERO, Fraction::new(i128::MIN, -1)] {
            assert_eq!(none, Fraction::NONE);
            assert_eq!(none * Fraction::ZERO, Fraction::NONE, "what is not known is not 0 either");
            assert!(none.to_f64().is_nan());
        }
    }
}

//! Polynomials by Symbolica.

use std::sync::Arc;

use dynid_equations::{arithmetic::Arithmetic, fraction::Fraction};
use symbolica::{
    domains::rational::{Q, Rational, RationalField},
    poly::{PolyVariable, polynomial::MultivariatePolynomial},
    symbol,
};

/// A polynomial as Symbolica holds it: sorted lexicographically.
#[derive(Debug, Clone, PartialEq)]
pub struct ByAlgebra(MultivariatePolynomial<RationalField, u8>);

impl Arithmetic for ByAlgebra {
    type Symbols = Arc<Vec<PolyVariable>>;

    fn symbols(names: &[String]) -> Self::Symbols {
        Arc::new(names.iter().map(|name| symbol!(format!("dynid::{name}")).into()).collect())
    }

    fn from_terms(symbols: &Self::Symbols, terms: impl IntoIterator<Item = (Vec<u8>, Fraction)>) -> Self {
        let mut polynomial = MultivariatePolynomial::new(&Q, None, symbols.clone());
        for (exponents, coefficient) in terms {
            if coefficient != Fraction::ZERO {
                polynomial.append_monomial(rational(coefficient), &exponents);
            }
        }
        Self(polynomial)
    }

    fn terms(&self) -> impl Iterator<Item = (Fraction, &[u8])> {
        let width = self.0.variables.len();
        self.0.coefficients.iter().map(fraction).zip(self.0.exponents.chunks_exact(width.max(1)))
    }

    fn plus(&self, other: &Self) -> Self {
        Self(&self.0 + &other.0)
    }

    fn minus(&self, other: &Self) -> Self {
        Self(&self.0 - &other.0)
    }

    fn times(&self, other: &Self) -> Self {
        Self(&self.0 * &other.0)
    }

    fn negative(&self) -> Self {
        Self(-self.0.clone())
    }

    fn by(&self, position: usize) -> Self {
        Self(self.0.derivative(position))
    }
}

/// None is a number that is too large for a fraction, and so is none again when it is asked for.
fn rational(fraction: Fraction) -> Rational {
    let Some((numerator, denominator)) = fraction.parts() else {
        let large = whole(u128::MAX);
        return &large * &large;
    };
    let size = &whole(numerator.unsigned_abs()) / &whole(denominator.unsigned_abs());
    if numerator < 0 { -size } else { size }
}

/// Digit by digit: what a number is made of has 64 bits.
fn whole(value: u128) -> Rational {
    const BITS: u32 = 32;
    let base = Rational::from(1_i64 << BITS);
    let digits = (0..u128::BITS / BITS).rev().map(|place| value >> (place * BITS) & ((1 << BITS) - 1));
    digits.fold(Rational::from(0), |sum, digit| &(&sum * &base) + &Rational::from(i64::try_from(digit).unwrap_or(0)))
}

/// None where it is no fraction of numbers of 128 bits.
fn fraction(rational: &Rational) -> Fraction {
    let text = rational.to_string();
    let (numerator, denominator) = text.split_once('/').unwrap_or((&text, "1"));
    let parts = numerator.parse().ok().zip(denominator.parse().ok());
    parts.map_or(Fraction::NONE, |(numerator, denominator)| Fraction::new(numerator, denominator))
}

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

/// What no longer is a number of 64 bits is 0: [`fraction`] finds none of that size.
fn rational(fraction: Fraction) -> Rational {
    let small = |(numerator, denominator)| Some((i64::try_from(numerator).ok()?, i64::try_from(denominator).ok()?));
    fraction.parts().and_then(small).map_or_else(|| Rational::from(0), Rational::from)
}

/// None where it is no fraction of numbers of 64 bits.
fn fraction(rational: &Rational) -> Fraction {
    let parts = rational.numerator().to_i64().zip(rational.denominator().to_i64());
    parts.map_or(Fraction::NONE, |(numerator, denominator)| Fraction::new(numerator.into(), denominator.into()))
}

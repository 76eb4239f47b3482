//! Exact arithmetic of polynomials with rational coefficients: what a derivation takes from computer algebra.

use std::fmt::Debug;

use crate::fraction::Fraction;

/// Polynomials in a fixed list of symbols.
///
/// Terms stand in the lexicographic order of their exponents, none is zero and no two are alike, so that equal polynomials are equal
/// values and every implementation leads to the same equations, byte for byte.
pub trait Arithmetic: Clone + PartialEq + Debug + Sized + 'static {
    /// The symbols of all polynomials that meet each other.
    type Symbols: Clone;

    /// Symbols by their names, which are letters, digits and `_`.
    fn symbols(names: &[String]) -> Self::Symbols;

    /// A polynomial of these terms; like ones are added up.
    fn from_terms(symbols: &Self::Symbols, terms: impl IntoIterator<Item = (Vec<u8>, Fraction)>) -> Self;

    /// Coefficients and the exponent of each symbol, term by term.
    fn terms(&self) -> impl Iterator<Item = (Fraction, &[u8])>;

    /// `self + other`
    fn plus(&self, other: &Self) -> Self;

    /// `self - other`
    fn minus(&self, other: &Self) -> Self;

    /// `self * other`
    fn times(&self, other: &Self) -> Self;

    /// `-self`
    fn negative(&self) -> Self;

    /// The partial derivative by the symbol at `position`.
    fn by(&self, position: usize) -> Self;
}

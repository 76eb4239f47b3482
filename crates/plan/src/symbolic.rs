//! Numbers that are polynomials in lengths, recognised: from values at random lengths to `1/2*L2^2 + L2*L3`.

use std::{collections::BTreeMap, fmt};

use dynid_random::Random;
use nalgebra::{DMatrix, DVector};

/// A factor of a combination of parameters: a polynomial in lengths, or a number where no polynomial was found.
#[derive(Debug, Clone, PartialEq)]
pub enum Factor {
    /// Exact: it was verified at lengths that it was not found from.
    Exact(Polynomial),
    /// The value at the model's lengths.
    Number(f64),
}

/// `sum(factor * product of lengths)`, over a length where two chains of different lengths carry one body.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Polynomial {
    terms: Vec<(Rational, Vec<String>)>,
    denominator: Option<String>,
}

/// `numerator / denominator * sqrt(radicand)`
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Rational {
    numerator: i64,
    denominator: i64,
    radicand: i64,
}

impl Rational {
    /// The simplest number near `value`.
    fn near(value: f64) -> Option<Self> {
        /// The value comes from a solution of linear equations, whose rounding this must not exceed by much.
        const TOLERANCE: f64 = 1e-7;
        for radicand in [1_i64, 2, 3] {
            for denominator in [1_i64, 2, 3, 4, 6, 8] {
                let scaled = value / (radicand as f64).sqrt() * denominator as f64;
                let numerator = scaled.round();
                if (scaled - numerator).abs() < TOLERANCE && numerator.abs() < 1e4 {
                    return Some(Self { numerator: numerator as i64, denominator, radicand });
                }
            }
        }
        None
    }

    fn value(self) -> f64 {
        self.numerator as f64 / self.denominator as f64 * (self.radicand as f64).sqrt()
    }

    fn is_unit(self) -> bool {
        self.numerator.abs() == 1 && self.denominator == 1 && self.radicand == 1
    }
}

impl fmt::Display for Rational {
    /// Without its sign.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numerator = self.numerator.abs();
        match (numerator, self.radicand) {
            (1, 2..) => write!(f, "sqrt({})", self.radicand)?,
            (_, 2..) => write!(f, "{numerator}*sqrt({})", self.radicand)?,
            _ => write!(f, "{numerator}")?,
        }
        if self.denominator == 1 { Ok(()) } else { write!(f, "/{}", self.denominator) }
    }
}

impl Polynomial {
    /// Its value, `length` giving that of each symbol.
    pub fn value(&self, length: &dyn Fn(&str) -> f64) -> f64 {
        let term = |(factor, symbols): &(Rational, Vec<String>)| {
            symbols.iter().fold(factor.value(), |product, symbol| product * length(symbol))
        };
        self.terms.iter().map(term).sum::<f64>() / self.denominator.as_ref().map_or(1.0, |symbol| length(symbol))
    }

    /// Whether it is zero.
    pub fn is_zero(&self) -> bool {
        self.terms.is_empty()
    }

    /// `self * parameter` with its sign in front, e.g. ` + 2*L2*link.3.mx`.
    fn times(&self, parameter: &str) -> String {
        match self.terms.as_slice() {
            [(factor, symbols)] => {
                let mut factors: Vec<String> = Vec::new();
                if !factor.is_unit() {
                    factors.push(factor.to_string());
                }
                factors.extend(powers(symbols));
                if let Some(denominator) = &self.denominator {
                    let last = factors.pop().unwrap_or_else(|| "1".to_owned());
                    factors.push(format!("{last}/{denominator}"));
                }
                factors.push(parameter.to_owned());
                format!(" {} {}", if factor.numerator < 0 { '-' } else { '+' }, factors.join("*"))
            }
            _ => format!(" + ({self})*{parameter}"),
        }
    }
}

impl fmt::Display for Polynomial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.terms.is_empty() {
            return write!(f, "0");
        }
        let bracketed = self.denominator.is_some() && self.terms.len() > 1;
        f.write_str(if bracketed { "(" } else { "" })?;
        for (index, (factor, symbols)) in self.terms.iter().enumerate() {
            let sign = match (index, factor.numerator < 0) {
                (0, true) => "-",
                (0, false) => "",
                (_, true) => " - ",
                (_, false) => " + ",
            };
            let mut factors =
                if factor.is_unit() && !symbols.is_empty() { Vec::new() } else { vec![factor.to_string()] };
            factors.extend(powers(symbols));
            write!(f, "{sign}{}", factors.join("*"))?;
        }
        f.write_str(if bracketed { ")" } else { "" })?;
        self.denominator.as_ref().map_or(Ok(()), |symbol| write!(f, "/{symbol}"))
    }
}

impl Factor {
    /// With its sign in front: ` + L2^2*link.3.m`.
    pub fn times(&self, parameter: &str) -> String {
        match self {
            Self::Exact(polynomial) => polynomial.times(parameter),
            Self::Number(value) => {
                format!(" {} {:.9}*{parameter}", if *value < 0.0 { '-' } else { '+' }, value.abs())
            }
        }
    }

    /// Its value, `length` giving that of each symbol.
    pub fn value(&self, length: &dyn Fn(&str) -> f64) -> f64 {
        match self {
            Self::Exact(polynomial) => polynomial.value(length),
            Self::Number(value) => *value,
        }
    }
}

/// `["L2", "L2", "L3"]` as `["L2^2", "L3"]`; equal symbols stand together.
fn powers(symbols: &[String]) -> Vec<String> {
    let power = |group: &[String]| match group {
        [symbol] => symbol.clone(),
        _ => format!("{}^{}", group[0], group.len()),
    };
    symbols.chunk_by(|a, b| a == b).map(power).collect()
}

/// Those entries of a matrix that are polynomials in these lengths; `at` gives it at values of all of them.
///
/// Each is sought in the lengths alone that it depends on: they are few, whereas an arm has two a joint, and the points
/// that a polynomial is found from grow with the cube of their number.
pub fn recognised(lengths: &[String], mut at: impl FnMut(&[f64]) -> DMatrix<f64>) -> DMatrix<Option<Polynomial>> {
    let mut random = Random::new(31);
    let mut point = || random.vector(lengths.len(), 0.4, 1.6);
    let (start, other) = (point(), point());
    let at_start = at(&start);
    let moved = |length: usize| {
        let mut point = start.clone();
        point[length] = other[length];
        at(&point)
    };
    let moved: Vec<DMatrix<f64>> = (0..lengths.len()).map(moved).collect();
    let depends_on = at_start.map_with_location(|row, column, value| -> Vec<usize> {
        let is_same = |length: usize| (moved[length][(row, column)] - value).abs() < AGREEMENT * value.abs().max(1.0);
        (0..lengths.len()).filter(|&length| !is_same(length)).collect()
    });
    let most = depends_on.iter().map(Vec::len).filter(|n| *n <= READABLE).max().unwrap_or(0);
    let points: Vec<Vec<f64>> = (0..Recogniser::n_points(most)).map(|_| point()).collect();
    let values: Vec<DMatrix<f64>> = points.iter().map(|point| at(point)).collect();
    let mut recognisers: BTreeMap<Vec<usize>, Recogniser> = BTreeMap::new();
    depends_on.map_with_location(|row, column, own| {
        if own.len() > READABLE {
            return None;
        }
        let n_points = Recogniser::n_points(own.len());
        let recogniser = recognisers.entry(own).or_insert_with_key(|own| {
            let names: Vec<String> = own.iter().map(|&length| lengths[length].clone()).collect();
            let points: Vec<Vec<f64>> =
                points[..n_points].iter().map(|point| own.iter().map(|&length| point[length]).collect()).collect();
            Recogniser::new(&names, &points)
        });
        let values: Vec<f64> = values[..n_points].iter().map(|matrix| matrix[(row, column)]).collect();
        recogniser.polynomial(&values)
    })
}

/// A polynomial in more lengths tells a reader no more than its value, and takes hundreds of points to find.
const READABLE: usize = 8;

/// Finds polynomials from their values at many points: of second degree at most, or homogeneous ones of up to third
/// degree over one length.
struct Recogniser {
    lengths: Vec<String>,
    /// One row a point.
    points: Vec<Vec<f64>>,
    plain: Basis,
    over_a_length: Vec<Basis>,
}

/// Products of lengths, and how to find their factors from values at points.
struct Basis {
    monomials: Vec<Vec<usize>>,
    /// Factors = inverse * values, by least squares.
    inverse: DMatrix<f64>,
}

/// Points kept back to verify.
const VERIFY: usize = 4;

impl Recogniser {
    /// Number of points needed for so many lengths.
    fn n_points(n_lengths: usize) -> usize {
        let plain: usize = (0..=2).map(|degree| monomials(n_lengths, degree).len()).sum();
        plain.max(monomials(n_lengths, 3).len()) + 3 + VERIFY
    }

    /// `points` holds the values of the `lengths`, one row a point.
    fn new(lengths: &[String], points: &[Vec<f64>]) -> Self {
        let n = lengths.len();
        let n_found_from = points.len() - VERIFY;
        let plain = Basis::new((0..=2).flat_map(|degree| monomials(n, degree)).collect(), &points[..n_found_from]);
        let degrees = if n == 0 { 1..1 } else { 1..4 };
        let over_a_length = degrees.map(|degree| Basis::new(monomials(n, degree), &points[..n_found_from])).collect();
        Self { lengths: lengths.to_vec(), points: points.to_vec(), plain, over_a_length }
    }

    /// The polynomial that has these values at the points; `None` where there is none with simple factors.
    fn polynomial(&self, values: &[f64]) -> Option<Polynomial> {
        if values.iter().all(|value| value.abs() < AGREEMENT) {
            return Some(Polynomial::default());
        }
        let over = || {
            let pairs =
                (0..self.lengths.len()).flat_map(|length| self.over_a_length.iter().map(move |basis| (length, basis)));
            pairs.into_iter().find_map(|(length, basis)| self.found(basis, Some(length), values))
        };
        self.found(&self.plain, None, values).or_else(over)
    }

    fn found(&self, basis: &Basis, denominator: Option<usize>, values: &[f64]) -> Option<Polynomial> {
        let over = |point: &[f64]| denominator.map_or(1.0, |length| point[length]);
        let scaled: Vec<f64> = values.iter().zip(&self.points).map(|(value, point)| value * over(point)).collect();
        let n_found_from = basis.inverse.ncols();
        let factors = &basis.inverse * DVector::from_column_slice(&scaled[..n_found_from]);
        let mut terms = Vec::new();
        for (factor, monomial) in factors.iter().zip(&basis.monomials) {
            let factor = Rational::near(*factor)?;
            if factor.numerator != 0 {
                terms.push((factor, monomial.iter().map(|&length| self.lengths[length].clone()).collect()));
            }
        }
        let found = Polynomial { terms, denominator: denominator.map(|length| self.lengths[length].clone()) };
        let agrees = values.iter().zip(&self.points).all(|(value, point)| {
            let length = |symbol: &str| {
                self.lengths.iter().position(|known| known == symbol).map_or(f64::NAN, |place| point[place])
            };
            (found.value(&length) - value).abs() < AGREEMENT * value.abs().max(1.0)
        });
        agrees.then_some(found)
    }
}

/// What verification may leave, relative to the values.
const AGREEMENT: f64 = 1e-8;

impl Basis {
    fn new(monomials: Vec<Vec<usize>>, points: &[Vec<f64>]) -> Self {
        let values = DMatrix::from_fn(points.len(), monomials.len(), |row, column| {
            monomials[column].iter().map(|&length| points[row][length]).product()
        });
        // Without an inverse no factor is simple, and nothing is recognised.
        let undefined = DMatrix::from_element(monomials.len(), points.len(), f64::NAN);
        Self { monomials, inverse: values.pseudo_inverse(1e-13).unwrap_or(undefined) }
    }
}

/// Products of `degree` lengths: indices, ascending.
fn monomials(n_lengths: usize, degree: usize) -> Vec<Vec<usize>> {
    if degree == 0 {
        return vec![Vec::new()];
    }
    let longer = |shorter: Vec<usize>| {
        let from = shorter.last().copied().unwrap_or(0);
        (from..n_lengths).map(move |next| shorter.iter().copied().chain([next]).collect())
    };
    monomials(n_lengths, degree - 1).into_iter().flat_map(longer).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recogniser(random: &mut Random) -> (Recogniser, Vec<Vec<f64>>) {
        let lengths = ["L2".to_owned(), "L3".to_owned()];
        let points: Vec<Vec<f64>> = (0..Recogniser::n_points(2)).map(|_| random.vector(2, 0.5, 1.5)).collect();
        (Recogniser::new(&lengths, &points), points)
    }

    #[test]
    fn polynomials_are_recognised_and_written() {
        let (recogniser, points) = recogniser(&mut Random::new(1));
        let reported = |f: &dyn Fn(f64, f64) -> f64| {
            let values: Vec<f64> = points.iter().map(|point| f(point[0], point[1])).collect();
            recogniser.polynomial(&values).map(|found| (found.to_string(), found.times("m")))
        };
        let both = |plain: &str, times: &str| Some((plain.to_owned(), times.to_owned()));
        assert_eq!(reported(&|a, _| a * a), both("L2^2", " + L2^2*m"));
        assert_eq!(reported(&|a, b| -2.0 * a * b), both("-2*L2*L3", " - 2*L2*L3*m"));
        assert_eq!(reported(&|a, b| 0.5 * a - b * b), both("1/2*L2 - L3^2", " + (1/2*L2 - L3^2)*m"));
        assert_eq!(reported(&|_, _| -1.0), both("-1", " - m"));
        assert_eq!(reported(&|a, b| 2.0 * a * a / b), both("2*L2^2/L3", " + 2*L2^2/L3*m"));
        let sum = reported(&|a, b| (a * a * b + 2.0 * a * a * a) / b);
        assert_eq!(sum, both("(2*L2^3 + L2^2*L3)/L3", " + ((2*L2^3 + L2^2*L3)/L3)*m"));
        assert_eq!(reported(&|a, b| 1.0 - a / b), both("(-L2 + L3)/L3", " + ((-L2 + L3)/L3)*m"));
        assert_eq!(reported(&|a, _| 2.0_f64.sqrt() * a), both("sqrt(2)*L2", " + sqrt(2)*L2*m"));
    }

    /// Each in few of ten lengths, so that some dozens of points are enough; but one in too many.
    #[test]
    fn a_polynomial_is_sought_in_its_own_lengths() {
        let names: Vec<String> = (0..10).map(|length| format!("L{length}")).collect();
        let mut n_points = 0;
        let found = recognised(&names, |point| {
            n_points += 1;
            let sum: f64 = point[..9].iter().sum();
            let odd = (point[0] + point[4]).sin();
            DMatrix::from_row_slice(2, 3, &[point[3].powi(2), point[1] / point[9], 0.5, 0.0, sum, odd])
        });
        let told: Vec<Option<String>> =
            found.transpose().iter().map(|entry| entry.as_ref().map(Polynomial::to_string)).collect();
        let exact = |text: &str| Some(text.to_owned());
        assert_eq!(told, [exact("L3^2"), exact("L1/L9"), exact("1/2"), exact("0"), None, None]);
        assert_eq!(n_points, 1 + 10 + Recogniser::n_points(2));
    }

    #[test]
    fn what_is_no_polynomial_is_not_taken_for_one() {
        let (recogniser, points) = recogniser(&mut Random::new(2));
        let values: Vec<f64> = points.iter().map(|point| (point[0] / point[1]).sin()).collect();
        assert_eq!(recogniser.polynomial(&values), None);
        let odd: Vec<f64> = points.iter().map(|point| 0.123_456 * point[0]).collect();
        assert_eq!(recogniser.polynomial(&odd), None);
    }
}

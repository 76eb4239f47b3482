//! Polynomials in a device's symbols.
//!
//! The cosine and sine of each angle are symbols of their own, so that every quantity of a mechanism is a polynomial
//! with rational coefficients. `sin^2 + cos^2 = 1` is applied after each product: a reduced polynomial is in normal
//! form, and two equal quantities are equal polynomials.

use std::{collections::BTreeMap, fmt};

use crate::{DeriveError, arithmetic::Arithmetic, fraction::Fraction};
use dynid_lower::{Node, Program};
use dynid_model::{
    Device, JointKind, Link,
    device::joint_variable,
    expression::{BinaryOperator, Expression},
};

/// An angle whose cosine and sine are symbols.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Angle {
    /// A joint variable times a positive factor: 1, or one whose cosine the addition theorem does not give in few terms.
    Joint(usize, f64),
    /// A constant that is no multiple of a quarter turn (rad).
    Constant(f64),
}

/// What a variable of the polynomials stands for.
#[derive(Debug, Clone, PartialEq)]
pub enum Symbol {
    /// Cosine of an angle.
    Cosine(Angle),
    /// Sine of an angle.
    Sine(Angle),
    /// A joint variable itself, where it stands outside of an angle [rad or m].
    Position(usize),
    /// A number that is no small fraction.
    Number(f64),
    /// A parameter's full name and unit.
    Parameter(String, &'static str),
}

/// The symbols of one device in their fixed order, and arithmetic over them.
pub struct Algebra<A: Arithmetic> {
    symbols: Vec<Symbol>,
    variables: A::Symbols,
    /// Positions of each angle's cosine and sine.
    pairs: Vec<(usize, usize)>,
}

/// A polynomial in the symbols of one [`Algebra`].
#[derive(Clone, PartialEq)]
pub struct Polynomial<A>(A);

/// `constant + sum(slope * q)`, the slopes by joint.
pub type Affine<A> = (Polynomial<A>, BTreeMap<usize, Polynomial<A>>);

/// `sum(factor * q) + constant`
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AngleSum {
    /// By joint; none is zero.
    pub factors: BTreeMap<usize, f64>,
    /// rad
    pub constant: f64,
}

impl AngleSum {
    /// Whether its constant is a whole number of quarter turns.
    pub fn is_in_quarters(&self) -> bool {
        is_whole(self.constant / std::f64::consts::FRAC_PI_2)
    }
}

impl<A: Arithmetic> Algebra<A> {
    /// Declares every symbol of the device, in an order that depends on nothing but the device.
    ///
    /// # Errors
    /// A frame whose angle is no sum of joint variables, or whose lengths are no polynomial.
    pub fn new(device: &Device) -> Result<Algebra<A>, DeriveError> {
        let mut symbols = Vec::new();
        for angle in angles(device)? {
            symbols.push(Symbol::Cosine(angle));
            symbols.push(Symbol::Sine(angle));
        }
        symbols.extend((0..device.joints.len()).map(Symbol::Position));
        let mut numbers = Vec::new();
        for frame in &device.frames {
            collect_numbers(&frame.d, &mut numbers);
            collect_numbers(&frame.a, &mut numbers);
        }
        for symbol in &symbols {
            if let Symbol::Cosine(Angle::Joint(_, factor)) = symbol {
                collect_numbers(&Expression::Number(*factor), &mut numbers);
            }
        }
        symbols.extend(numbers.into_iter().map(Symbol::Number));
        for length in &device.lengths {
            symbols.push(Symbol::Parameter(format!("length.{}", length.symbol), "m"));
        }
        for (axis, up) in ["gx", "gy", "gz"].into_iter().zip(device.up) {
            if up != 0.0 {
                symbols.push(Symbol::Parameter(format!("base.{axis}"), "m/s^2"));
            }
        }
        for link in 1..=device.links.len() {
            for (name, unit) in Link::SYMBOLS.into_iter().zip(INERTIAL_UNITS) {
                symbols.push(Symbol::Parameter(format!("link.{link}.{name}"), unit));
            }
        }
        let names: Vec<String> = symbols.iter().map(Symbol::to_string).collect();
        let pairs = symbols
            .windows(2)
            .enumerate()
            .filter(|(_, pair)| matches!(pair, [Symbol::Cosine(_), Symbol::Sine(_)]))
            .map(|(at, _)| (at, at + 1))
            .collect();
        Ok(Algebra { symbols, variables: A::symbols(&names), pairs })
    }

    /// Whether cosines or sines of constant angles stand in it, which are no quarter turns.
    pub fn has_constant_angles(&self, polynomial: &Polynomial<A>) -> bool {
        let is_constant =
            |symbol: &Symbol| matches!(symbol, Symbol::Cosine(Angle::Constant(_)) | Symbol::Sine(Angle::Constant(_)));
        polynomial.terms().any(|(_, exponents)| {
            self.symbols.iter().zip(exponents).any(|(symbol, exponent)| *exponent > 0 && is_constant(symbol))
        })
    }

    /// The symbols, in order: position `k` is exponent `k` of [`Polynomial::terms`].
    pub fn symbols(&self) -> &[Symbol] {
        &self.symbols
    }

    /// 0
    pub fn zero(&self) -> Polynomial<A> {
        self.from_terms([])
    }

    /// A whole number.
    pub fn integer(&self, value: i64) -> Polynomial<A> {
        self.term(Fraction::from(value), vec![0; self.symbols.len()])
    }

    /// A fraction.
    pub fn fraction(&self, numerator: i64, denominator: i64) -> Polynomial<A> {
        self.term(Fraction::new(numerator.into(), denominator.into()), vec![0; self.symbols.len()])
    }

    /// One symbol; 0 for a symbol that the device does not have (a gravity component that vanishes).
    pub fn symbol(&self, wanted: &Symbol) -> Polynomial<A> {
        match self.symbols.iter().position(|known| known == wanted) {
            Some(position) => self.variable(position),
            None => self.zero(),
        }
    }

    /// A parameter by its full name; 0 for one that the device does not have.
    pub fn parameter(&self, name: &str) -> Polynomial<A> {
        let position =
            self.symbols.iter().position(|known| matches!(known, Symbol::Parameter(known, _) if known == name));
        position.map_or_else(|| self.zero(), |position| self.variable(position))
    }

    /// Cosine and sine of a sum of joint variables and constants, by the addition theorem.
    pub fn cos_sin(&self, angle: &AngleSum) -> (Polynomial<A>, Polynomial<A>) {
        let quarter = angle.constant / std::f64::consts::FRAC_PI_2;
        let mut sum = if angle.is_in_quarters() {
            let (cosine, sine) = [(1, 0), (0, 1), (-1, 0), (0, -1)][(quarter.round() as i64).rem_euclid(4) as usize];
            (self.integer(cosine), self.integer(sine))
        } else {
            let (magnitude, sign) = (angle.constant.abs(), angle.constant.signum() as i64);
            let cosine = self.symbol(&Symbol::Cosine(Angle::Constant(magnitude)));
            let sine = self.symbol(&Symbol::Sine(Angle::Constant(magnitude)));
            (cosine, &self.integer(sign) * &sine)
        };
        for (&joint, &factor) in &angle.factors {
            let own = Angle::Joint(joint, factor.abs());
            let (unit, n_times) =
                if self.has(own) { (own, 1) } else { (Angle::Joint(joint, 1.0), factor.abs().round() as u32) };
            let cosine = self.symbol(&Symbol::Cosine(unit));
            let sine = &self.integer(factor.signum() as i64) * &self.symbol(&Symbol::Sine(unit));
            for _ in 0..n_times {
                sum = (
                    self.reduce(&(&(&sum.0 * &cosine) - &(&sum.1 * &sine))),
                    self.reduce(&(&(&sum.1 * &cosine) + &(&sum.0 * &sine))),
                );
            }
        }
        sum
    }

    /// Whether cosine and sine of `factor * q[joint]` are polynomials in the symbols.
    pub fn reaches(&self, joint: usize, factor: f64) -> bool {
        self.has(Angle::Joint(joint, factor.abs())) || (is_expanded(factor.abs()) && self.has(Angle::Joint(joint, 1.0)))
    }

    fn has(&self, angle: Angle) -> bool {
        self.symbols.contains(&Symbol::Cosine(angle))
    }

    /// A number that stands in the device's rows.
    pub fn number(&self, value: f64) -> Polynomial<A> {
        match small_fraction(value) {
            Some((numerator, denominator)) => self.fraction(numerator, denominator),
            None => {
                let magnitude = self.symbol(&Symbol::Number(value.abs()));
                if value < 0.0 { -&magnitude } else { magnitude }
            }
        }
    }

    /// A length expression of a frames table.
    ///
    /// # Errors
    /// What is wrong with it, where it is no polynomial.
    pub fn length(&self, expression: &Expression) -> Result<Polynomial<A>, String> {
        use BinaryOperator::*;
        if let Some(value) = expression.constant() {
            return Ok(self.number(value));
        }
        Ok(match expression {
            Expression::Number(_) => unreachable!("a number is a constant"),
            Expression::Symbol(name) => match joint_variable(name) {
                Some(joint) => self.symbol(&Symbol::Position(joint)),
                None => self.parameter(&format!("length.{name}")),
            },
            Expression::Negate(x) => -&self.length(x)?,
            Expression::Binary(Add, a, b) => &self.length(a)? + &self.length(b)?,
            Expression::Binary(Subtract, a, b) => &self.length(a)? - &self.length(b)?,
            Expression::Binary(Multiply, a, b) => &self.length(a)? * &self.length(b)?,
            Expression::Binary(Divide, a, b) => {
                let Some(divisor) = b.constant().filter(|divisor| *divisor != 0.0) else {
                    return Err("a length is divided by something that is no number".to_owned());
                };
                let factor = match small_fraction(divisor) {
                    Some((numerator, denominator)) => self.fraction(numerator.signum() * denominator, numerator.abs()),
                    None => self.length(&Expression::Number(1.0 / divisor))?,
                };
                &self.length(a)? * &factor
            }
            Expression::Call(..) | Expression::IfElse(..) => {
                return Err("a length is a sum of products of length symbols, joint variables and numbers".to_owned());
            }
        })
    }

    /// The normal form: no sine to a higher power than one.
    pub fn reduce(&self, polynomial: &Polynomial<A>) -> Polynomial<A> {
        self.eliminate(polynomial, |_| true)
    }

    /// Replaces higher powers of one of each angle's pair by the other: of the sine where `eliminate_sine(k)` holds
    /// for the k-th angle, else of the cosine.
    pub fn eliminate(&self, polynomial: &Polynomial<A>, eliminate_sine: impl Fn(usize) -> bool) -> Polynomial<A> {
        let pairs: Vec<(usize, usize)> = (self.pairs.iter().enumerate())
            .map(|(k, &(cosine, sine))| if eliminate_sine(k) { (sine, cosine) } else { (cosine, sine) })
            .collect();
        let is_normal = |exponents: &[u8]| pairs.iter().all(|&(gone, _)| exponents[gone] < 2);
        if polynomial.terms().all(|(_, exponents)| is_normal(exponents)) {
            return polynomial.clone();
        }
        let mut normal = Vec::new();
        let mut open: Vec<(Vec<u8>, Fraction)> =
            polynomial.terms().map(|(coefficient, exponents)| (exponents.to_vec(), coefficient)).collect();
        while let Some((mut exponents, coefficient)) = open.pop() {
            match pairs.iter().find(|&&(gone, _)| exponents[gone] >= 2) {
                Some(&(gone, kept)) => {
                    exponents[gone] -= 2;
                    let mut other = exponents.clone();
                    other[kept] += 2;
                    open.push((other, -coefficient));
                    open.push((exponents, coefficient));
                }
                None => normal.push((exponents, coefficient)),
            }
        }
        self.from_terms(normal)
    }

    /// Product in normal form.
    pub fn product(&self, a: &Polynomial<A>, b: &Polynomial<A>) -> Polynomial<A> {
        self.reduce(&(a * b))
    }

    /// `sum(a[k] * b[k])` in normal form.
    pub fn dot<'a>(&self, pairs: impl IntoIterator<Item = (&'a Polynomial<A>, &'a Polynomial<A>)>) -> Polynomial<A> {
        let mut sum = self.zero();
        for (a, b) in pairs {
            if !a.is_zero() && !b.is_zero() {
                sum = &sum + &(a * b);
            }
        }
        self.reduce(&sum)
    }

    /// `d/dq = d/dq + sum over factors f of q of f (cos d/dsin - sin d/dcos)`, in normal form.
    pub fn derivative(&self, polynomial: &Polynomial<A>, joint: usize) -> Polynomial<A> {
        let at = |wanted: Symbol| self.symbols.iter().position(|known| *known == wanted);
        let mut sum = self.zero();
        if let Some(position) = at(Symbol::Position(joint)) {
            sum = Polynomial(polynomial.0.by(position));
        }
        for &(cosine, sine) in &self.pairs {
            let Symbol::Cosine(Angle::Joint(own, factor)) = self.symbols[cosine] else { continue };
            if own == joint {
                let by_sine = Polynomial(polynomial.0.by(sine));
                let by_cosine = Polynomial(polynomial.0.by(cosine));
                let turned = &(&by_sine * &self.variable(cosine)) - &(&by_cosine * &self.variable(sine));
                sum = &sum + &(&self.number(factor) * &turned);
            }
        }
        self.reduce(&sum)
    }

    /// The polynomial as `constant + sum(slope * q)` over the positions of the joints of `free` that stand outside of
    /// angles; `None` where it is not affine in them.
    pub fn affine_in_positions(&self, polynomial: &Polynomial<A>, free: &[usize]) -> Option<Affine<A>> {
        let mut constant = Vec::new();
        let mut slopes: BTreeMap<usize, Vec<(Vec<u8>, Fraction)>> = BTreeMap::new();
        for (coefficient, exponents) in polynomial.terms() {
            let mut moving = None;
            for (position, symbol) in self.symbols.iter().enumerate() {
                match symbol {
                    Symbol::Position(joint) if free.contains(joint) && exponents[position] > 0 => {
                        if exponents[position] > 1 || moving.is_some() {
                            return None;
                        }
                        moving = Some((position, *joint));
                    }
                    _ => {}
                }
            }
            let mut exponents = exponents.to_vec();
            match moving {
                Some((position, joint)) => {
                    exponents[position] = 0;
                    slopes.entry(joint).or_default().push((exponents, coefficient));
                }
                None => constant.push((exponents, coefficient)),
            }
        }
        let slopes = slopes.into_iter().map(|(joint, terms)| (joint, self.from_terms(terms))).collect();
        Some((self.from_terms(constant), slopes))
    }

    /// A polynomial of these terms.
    pub fn from_terms(&self, terms: impl IntoIterator<Item = (Vec<u8>, Fraction)>) -> Polynomial<A> {
        Polynomial(A::from_terms(&self.variables, terms))
    }

    /// The value, where `value` gives that of each symbol.
    pub fn evaluate(&self, polynomial: &Polynomial<A>, value: &[f64]) -> f64 {
        polynomial
            .terms()
            .map(|(coefficient, exponents)| {
                exponents
                    .iter()
                    .zip(value)
                    .filter(|(exponent, _)| **exponent > 0)
                    .fold(coefficient.to_f64(), |product, (&exponent, value)| product * value.powi(i32::from(exponent)))
            })
            .sum()
    }

    /// The value of each symbol, from those of joints and parameters.
    pub fn values(&self, q: &[f64], parameter: &dyn Fn(&str) -> f64) -> Vec<f64> {
        let angle = |angle: &Angle| match *angle {
            Angle::Joint(joint, factor) => factor * q[joint],
            Angle::Constant(value) => value,
        };
        self.symbols
            .iter()
            .map(|symbol| match symbol {
                Symbol::Cosine(of) => angle(of).cos(),
                Symbol::Sine(of) => angle(of).sin(),
                Symbol::Position(joint) => q[*joint],
                Symbol::Number(value) => *value,
                Symbol::Parameter(name, _) => parameter(name),
            })
            .collect()
    }

    /// The symbol as a term of a program in which the joints of `free` move and the others are locked.
    pub fn node(&self, position: usize, device: &Device, free: &[usize], program: &mut Program) -> Node {
        match &self.symbols[position] {
            Symbol::Cosine(Angle::Constant(value)) => program.number(value.cos()),
            Symbol::Sine(Angle::Constant(value)) => program.number(value.sin()),
            Symbol::Number(value) => program.number(*value),
            Symbol::Parameter(name, unit) => program.parameter(name, unit),
            Symbol::Position(joint) => joint_position(*joint, device, free, program),
            Symbol::Cosine(Angle::Joint(joint, factor)) => {
                let angle = joint_angle(*joint, *factor, device, free, program);
                let cosine = program.cos(angle);
                program.name(cosine, &format!("c{joint}"))
            }
            Symbol::Sine(Angle::Joint(joint, factor)) => {
                let angle = joint_angle(*joint, *factor, device, free, program);
                let sine = program.sin(angle);
                program.name(sine, &format!("s{joint}"))
            }
        }
    }

    /// True where a symbol changes while the joints of `free` move.
    pub fn moves(&self, position: usize, free: &[usize]) -> bool {
        match self.symbols[position] {
            Symbol::Cosine(Angle::Joint(joint, _)) | Symbol::Sine(Angle::Joint(joint, _)) | Symbol::Position(joint) => {
                free.contains(&joint)
            }
            _ => false,
        }
    }

    /// Positions of the cosine and sine of each angle.
    pub fn pairs(&self) -> &[(usize, usize)] {
        &self.pairs
    }

    fn variable(&self, position: usize) -> Polynomial<A> {
        let mut exponents = vec![0; self.symbols.len()];
        exponents[position] = 1;
        self.term(Fraction::ONE, exponents)
    }

    fn term(&self, coefficient: Fraction, exponents: Vec<u8>) -> Polynomial<A> {
        self.from_terms([(exponents, coefficient)])
    }
}

impl<A: Arithmetic> Polynomial<A> {
    /// Coefficients and exponents, in the lexicographic order of these.
    pub fn terms(&self) -> impl Iterator<Item = (Fraction, &[u8])> {
        self.0.terms()
    }

    /// True for 0.
    pub fn is_zero(&self) -> bool {
        self.terms().next().is_none()
    }

    /// Number of terms; 0 has none.
    pub fn n_terms(&self) -> usize {
        self.terms().count()
    }

    /// The value, if it is a whole number.
    pub fn as_integer(&self) -> Option<i64> {
        if self.is_zero() {
            return Some(0);
        }
        let mut terms = self.terms();
        match (terms.next(), terms.next()) {
            (Some((coefficient, exponents)), None) if exponents.iter().all(|&exponent| exponent == 0) => {
                let value = coefficient.to_f64();
                (value.fract() == 0.0).then_some(value as i64)
            }
            _ => None,
        }
    }
}

impl<A: Arithmetic> fmt::Debug for Polynomial<A> {
    fn fmt(&self, text: &mut fmt::Formatter) -> fmt::Result {
        text.debug_list().entries(self.terms()).finish()
    }
}

impl<A: Arithmetic> std::ops::Add for &Polynomial<A> {
    type Output = Polynomial<A>;
    fn add(self, other: &Polynomial<A>) -> Polynomial<A> {
        Polynomial(self.0.plus(&other.0))
    }
}

impl<A: Arithmetic> std::ops::Sub for &Polynomial<A> {
    type Output = Polynomial<A>;
    fn sub(self, other: &Polynomial<A>) -> Polynomial<A> {
        Polynomial(self.0.minus(&other.0))
    }
}

impl<A: Arithmetic> std::ops::Mul for &Polynomial<A> {
    type Output = Polynomial<A>;
    fn mul(self, other: &Polynomial<A>) -> Polynomial<A> {
        Polynomial(self.0.times(&other.0))
    }
}

impl<A: Arithmetic> std::ops::Neg for &Polynomial<A> {
    type Output = Polynomial<A>;
    fn neg(self) -> Polynomial<A> {
        Polynomial(self.0.negative())
    }
}

impl fmt::Display for Symbol {
    fn fmt(&self, text: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Symbol::Cosine(Angle::Joint(joint, 1.0)) => write!(text, "c{joint}"),
            Symbol::Sine(Angle::Joint(joint, 1.0)) => write!(text, "s{joint}"),
            Symbol::Cosine(Angle::Joint(joint, factor)) => write!(text, "c{joint}_{:x}", factor.to_bits()),
            Symbol::Sine(Angle::Joint(joint, factor)) => write!(text, "s{joint}_{:x}", factor.to_bits()),
            Symbol::Cosine(Angle::Constant(value)) => write!(text, "cos_{:x}", value.to_bits()),
            Symbol::Sine(Angle::Constant(value)) => write!(text, "sin_{:x}", value.to_bits()),
            Symbol::Position(joint) => write!(text, "q{joint}"),
            Symbol::Number(value) => write!(text, "number_{:x}", value.to_bits()),
            Symbol::Parameter(name, _) => write!(text, "p_{}", name.replace('.', "_")),
        }
    }
}

/// An angle of a frames table.
///
/// # Errors
/// What is wrong with it, where it is no sum of joint variables.
pub fn angle_sum(expression: &Expression) -> Result<AngleSum, String> {
    let wanted = "an angle is a sum of joint variables with constant factors and a constant";
    let affine = expression.affine().ok_or(wanted)?;
    let mut factors = BTreeMap::new();
    for (name, factor) in affine.coefficients {
        let joint = joint_variable(&name).ok_or(wanted)?;
        let factor = if is_whole(factor) { factor.round() } else { factor };
        if factor != 0.0 {
            factors.insert(joint, factor);
        }
    }
    Ok(AngleSum { factors, constant: affine.constant })
}

/// Units of [`Link::SYMBOLS`].
const INERTIAL_UNITS: [&str; 10] = ["kg", "m", "m", "m", "kg*m^2", "kg*m^2", "kg*m^2", "kg*m^2", "kg*m^2", "kg*m^2"];

/// Angles closer than this to a multiple of a quarter turn, in quarter turns, are that multiple. A numerical choice.
const WHOLE: f64 = 1e-12;

fn is_whole(value: f64) -> bool {
    (value - value.round()).abs() < WHOLE
}

/// Whole factors of a joint variable up to this one are expanded by the addition theorem, so that angles share sines and cosines;
/// those of `n q` are polynomials of degree `n`, whose numbers lose a digit with every few. A numerical choice.
const MOST_TURNS: f64 = 8.0;

fn is_expanded(factor: f64) -> bool {
    is_whole(factor) && factor <= MOST_TURNS
}

/// The unit of a joint's variable.
pub fn joint_unit(device: &Device, joint: usize) -> &'static str {
    match device.joints[joint].kind {
        JointKind::Revolute => "rad",
        JointKind::Prismatic => "m",
    }
}

fn joint_position(joint: usize, device: &Device, free: &[usize], program: &mut Program) -> Node {
    let unit = joint_unit(device, joint);
    if free.contains(&joint) { program.position(joint, unit) } else { program.locked(joint, unit) }
}

fn joint_angle(joint: usize, factor: f64, device: &Device, free: &[usize], program: &mut Program) -> Node {
    let position = joint_position(joint, device, free, program);
    let factor = program.number(factor);
    program.multiply(factor, position)
}

/// Joint angles first, each with its factors ascending, then the constants in the order of the frames.
fn angles(device: &Device) -> Result<Vec<Angle>, DeriveError> {
    let mut joints: Vec<Vec<f64>> = vec![Vec::new(); device.joints.len()];
    let mut constants: Vec<f64> = Vec::new();
    for frame in &device.frames {
        for expression in [&frame.theta, &frame.alpha] {
            let angle = angle_sum(expression).map_err(|what| DeriveError::frame(device, frame, what))?;
            for (&joint, factor) in &angle.factors {
                let known = joints
                    .get_mut(joint)
                    .ok_or_else(|| DeriveError::frame(device, frame, format!("there is no joint q{joint}")))?;
                let size = factor.abs();
                let unit = if is_expanded(size) { 1.0 } else { size };
                if !known.contains(&unit) {
                    known.push(unit);
                }
            }
            let magnitude = angle.constant.abs();
            if !is_whole(magnitude / std::f64::consts::FRAC_PI_2) && !constants.contains(&magnitude) {
                constants.push(magnitude);
            }
        }
    }
    let joints = joints.into_iter().enumerate().flat_map(|(joint, mut factors)| {
        factors.sort_by(f64::total_cmp);
        factors.into_iter().map(move |factor| Angle::Joint(joint, factor))
    });
    Ok(joints.chain(constants.into_iter().map(Angle::Constant)).collect())
}

/// Numbers that become symbols: those that are no small fraction.
fn collect_numbers(expression: &Expression, numbers: &mut Vec<f64>) {
    if let Some(value) = expression.constant() {
        if small_fraction(value).is_none() && !numbers.contains(&value.abs()) {
            numbers.push(value.abs());
        }
        return;
    }
    match expression {
        Expression::Negate(x) => collect_numbers(x, numbers),
        Expression::Binary(BinaryOperator::Divide, a, b) => {
            collect_numbers(a, numbers);
            if let Some(divisor) = b.constant().filter(|divisor| small_fraction(*divisor).is_none()) {
                collect_numbers(&Expression::Number(1.0 / divisor), numbers);
            }
        }
        Expression::Binary(_, a, b) => {
            collect_numbers(a, numbers);
            collect_numbers(b, numbers);
        }
        _ => {}
    }
}

/// `value` as an exact fraction with a denominator that is a small power of two.
fn small_fraction(value: f64) -> Option<(i64, i64)> {
    (0..=6).map(|power| 1i64 << power).find_map(|denominator| {
        let numerator = value * denominator as f64;
        (numerator.fract() == 0.0 && numerator.abs() < 1e6).then_some((numerator as i64, denominator))
    })
}

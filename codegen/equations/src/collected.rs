//! Lagrange's equations of few free joints, collected: polynomials in what moves, with lumps as coefficients.
//!
//! A lump is what stands before one product of the free joints' cosines, sines and positions: parameters, lengths and
//! locked angles, computed once per parameter set. Lumps that are multiples of each other are one; those of the torque
//! are linearly independent, as each is a column of the regressor.

use std::collections::BTreeMap;

use dynid_lower::{Node, Program};

use crate::{
    algebra::{Polynomial, joint_unit},
    arithmetic::Arithmetic,
    emit::{Context, Term, nested},
    fraction::Fraction,
    kernel::{Group, pairs},
    lagrangian::Lagrangian,
};

/// The subset equations of the free joints as polynomials.
pub struct Subset<A: Arithmetic> {
    /// `D[i][j]`, i <= j.
    inertia: BTreeMap<(usize, usize), Polynomial<A>>,
    /// What stands before `dq[i] dq[j]`, i <= j, in row k: (k, i, j).
    velocity: BTreeMap<(usize, usize, usize), Polynomial<A>>,
    /// phi.
    gravity: BTreeMap<usize, Polynomial<A>>,
}

impl<A: Arithmetic> Subset<A> {
    /// Rows and columns of the free joints; `None` where D has more than `limit` products of what moves.
    pub fn new(context: &Context<A>, lagrangian: &Lagrangian<A>, limit: usize) -> Option<Subset<A>> {
        let algebra = context.algebra;
        let inertia: BTreeMap<_, _> =
            pairs(context.free).into_iter().map(|(i, j)| ((i, j), lagrangian.inertia_entry(algebra, i, j))).collect();
        let n_products: usize = inertia.values().map(|entry| products(context, entry).len()).sum();
        if n_products > limit {
            return None;
        }
        let gravity = context.free.iter().map(|&k| (k, lagrangian.gravity(algebra, k))).collect();
        let mut velocity = BTreeMap::new();
        for &k in context.free {
            for (i, j) in pairs(context.free) {
                let symbol = lagrangian.christoffel(algebra, i, j, k);
                let sum = if i == j { symbol } else { &algebra.integer(2) * &symbol };
                velocity.insert((k, i, j), sum);
            }
        }
        Some(Subset { inertia, velocity, gravity })
    }

    /// A group of outputs; bit k of `kept_sines` says that squares of the k-th moving angle's cosine are eliminated
    /// rather than of its sine.
    pub fn program(&self, context: &Context<A>, group: Group, kept_sines: usize) -> Program {
        let mut writer = Writer {
            context,
            group,
            kept_sines,
            program: Program::new(),
            lumps: Vec::new(),
            basis: Basis::default(),
            independent: Vec::new(),
            values: Vec::new(),
        };
        let free = context.free;
        let inertia: BTreeMap<(usize, usize), Node> = match group {
            Group::Bias => BTreeMap::new(),
            _ => self
                .inertia
                .iter()
                .map(|(&(i, j), entry)| ((i, j), writer.emit(entry, &format!("d_{i}_{j}"))))
                .collect(),
        };
        if group == Group::Inertia {
            for ((i, j), entry) in inertia {
                writer.program.output(&format!("D_{i}_{j}"), entry);
            }
            return writer.program;
        }
        for (&k, output) in free.iter().zip(group.outputs(free)) {
            let coriolis = self.velocity_terms(&mut writer, k);
            writer.program.name(coriolis, &format!("coriolis{k}"));
            let gravity = writer.emit(&self.gravity[&k], &format!("phi{k}"));
            let mut sum = writer.program.add(coriolis, gravity);
            if group == Group::Torque {
                for &j in free {
                    let unit = format!("{}/s^2", joint_unit(context.device, j));
                    let acceleration = writer.program.acceleration(j, &unit);
                    let inertial = writer.program.multiply(inertia[&(k.min(j), k.max(j))], acceleration);
                    sum = writer.program.add(sum, inertial);
                }
            }
            writer.program.output(&output, sum);
        }
        writer.program
    }

    /// `sum over i <= j of velocity[k][i][j] dq[i] dq[j]`, common factors in front.
    fn velocity_terms(&self, writer: &mut Writer<A>, k: usize) -> Node {
        let device = writer.context.device;
        let factors: Vec<(f64, Node, [usize; 2])> = (self.velocity.range((k, 0, 0)..(k + 1, 0, 0)))
            .map(|(&(_, i, j), symbol)| {
                let (scale, value) = writer.emit_scaled(symbol, &format!("c_{k}_{i}_{j}"));
                (scale, value, [i, j])
            })
            .filter(|(scale, ..)| *scale != 0.0)
            .collect();
        // The symbols of this sum: values first, so that `value * dq` is shared between rows, then velocities.
        let mut values: Vec<Node> = factors.iter().map(|&(_, value, _)| value).collect();
        values.sort();
        values.dedup();
        let terms = factors
            .into_iter()
            .map(|(coefficient, value, joints)| {
                let mut exponents = vec![0; values.len() + device.joints.len()];
                exponents[values.partition_point(|&known| known < value)] = 1;
                joints.into_iter().for_each(|joint| exponents[values.len() + joint] += 1);
                Term { coefficient, leaf: None, exponents }
            })
            .collect();
        let mut symbol = |position: usize, program: &mut Program| match values.get(position) {
            Some(&value) => value,
            None => {
                let joint = position - values.len();
                program.velocity(joint, &format!("{}/s", joint_unit(device, joint)))
            }
        };
        nested(&mut writer.program, terms, &mut symbol)
    }
}

/// Writes polynomials over a growing list of lumps.
struct Writer<'a, A: Arithmetic> {
    context: &'a Context<'a, A>,
    group: Group,
    kept_sines: usize,
    program: Program,
    /// Lumps divided by their leading coefficient, that coefficient, and their terms in the program.
    lumps: Vec<(Polynomial<A>, f64, Node)>,
    /// Linearly independent lumps, and their terms in the program.
    basis: Basis,
    independent: Vec<Node>,
    /// As `lumps`, of polynomials in what moves.
    values: Vec<(Polynomial<A>, f64, Node)>,
}

impl<A: Arithmetic> Writer<'_, A> {
    /// The polynomial's value. What does not move is added last, so that entries that differ by it share the rest.
    fn emit(&mut self, polynomial: &Polynomial<A>, name: &str) -> Node {
        let context = self.context;
        let polynomial = self.normal_form(polynomial);
        let (moving, still): (Vec<_>, Vec<_>) = polynomial
            .terms()
            .map(|(coefficient, exponents)| (exponents.to_vec(), coefficient))
            .partition(|(exponents, _)| {
                let moves = |position: usize| exponents[position] > 0 && context.algebra.moves(position, context.free);
                (0..exponents.len()).any(moves)
            });
        let (scale, value) = self.emit_scaled(&context.algebra.from_terms(moving), name);
        let scale = self.program.number(scale);
        let moving = self.program.multiply(scale, value);
        let still = context.algebra.from_terms(still);
        if still.is_zero() {
            return moving;
        }
        let parts: Vec<Node> = (self.lump(&still).into_iter())
            .map(|(ratio, lump)| {
                let ratio = self.program.number(ratio);
                self.program.multiply(ratio, lump)
            })
            .collect();
        let still = self.program.sum(&parts);
        self.program.add(moving, still)
    }

    /// The polynomial with the chosen one of each moving angle's squares eliminated.
    fn normal_form(&self, polynomial: &Polynomial<A>) -> Polynomial<A> {
        let context = self.context;
        let moving_angles: Vec<usize> = (context.algebra.pairs().iter().enumerate())
            .filter(|(_, (cosine, _))| context.algebra.moves(*cosine, context.free))
            .map(|(angle, _)| angle)
            .collect();
        context.algebra.eliminate(polynomial, |angle| match moving_angles.iter().position(|&known| known == angle) {
            Some(bit) => self.kept_sines >> bit & 1 == 0,
            None => true,
        })
    }

    /// A factor and the value of the polynomial without it; multiples of one polynomial share the value.
    fn emit_scaled(&mut self, polynomial: &Polynomial<A>, name: &str) -> (f64, Node) {
        let context = self.context;
        let polynomial = self.normal_form(polynomial);
        if polynomial.is_zero() {
            return (0.0, self.program.number(0.0));
        }
        let (leading, normal) = normalised(context, &polynomial);
        if let Some((_, first, value)) = self.values.iter().find(|(known, _, _)| *known == normal) {
            return (leading / first, *value);
        }
        let mut terms = Vec::new();
        for (exponents, coefficient) in products(context, &polynomial) {
            for (ratio, lump) in self.lump(&coefficient) {
                terms.push(Term { coefficient: ratio, leaf: Some(lump), exponents: exponents.clone() });
            }
        }
        let mut symbol = |position: usize, program: &mut Program| {
            context.algebra.node(position, context.device, context.free, program)
        };
        let value = nested(&mut self.program, terms, &mut symbol);
        self.program.name(value, name);
        self.values.push((normal, leading, value));
        (1.0, value)
    }

    /// The polynomial as a sum of multiples of lumps.
    fn lump(&mut self, polynomial: &Polynomial<A>) -> Vec<(f64, Node)> {
        if let Some(whole) = polynomial.as_integer() {
            return vec![(whole as f64, self.program.number(1.0))];
        }
        match self.group {
            // A multiple of a lump is a constant that `prepare` computes.
            Group::Inertia | Group::Bias => {
                let (leading, normal) = normalised(self.context, polynomial);
                let lump = match self.lumps.iter().find(|(known, _, _)| *known == normal) {
                    Some(&(_, first, lump)) => {
                        let ratio = self.program.number(leading / first);
                        self.program.multiply(ratio, lump)
                    }
                    None => {
                        let lump = self.write_lump(polynomial, self.lumps.len());
                        self.lumps.push((normal, leading, lump));
                        lump
                    }
                };
                vec![(1.0, lump)]
            }
            // The regressor has one column per lump: only independent ones.
            Group::Torque => {
                let n_known = self.basis.len();
                match self.basis.express(polynomial) {
                    Some(parts) => parts.into_iter().map(|(part, ratio)| (ratio, self.independent[part])).collect(),
                    None => {
                        let lump = self.write_lump(polynomial, n_known);
                        self.independent.push(lump);
                        vec![(1.0, lump)]
                    }
                }
            }
        }
    }

    fn write_lump(&mut self, polynomial: &Polynomial<A>, number: usize) -> Node {
        let lump = self.context.emit(&mut self.program, polynomial);
        self.program.name(lump, &format!("{}_lump{number}", self.group.symbol().to_lowercase()))
    }
}

/// Linearly independent polynomials, in echelon form.
#[derive(Default)]
struct Basis {
    rows: Vec<Row>,
}

/// What is left of a polynomial after the earlier ones.
struct Row {
    rest: BTreeMap<Vec<u8>, Fraction>,
    /// A product of symbols that no later row has.
    pivot: Vec<u8>,
    /// How many times each polynomial is in `rest`.
    made_of: Vec<Fraction>,
}

impl Basis {
    fn len(&self) -> usize {
        self.rows.len()
    }

    /// The polynomial as a combination of those before: which ones, and how many times. An independent one joins
    /// the basis.
    fn express<A: Arithmetic>(&mut self, polynomial: &Polynomial<A>) -> Option<Vec<(usize, f64)>> {
        let zero = Fraction::ZERO;
        let mut rest: BTreeMap<Vec<u8>, Fraction> =
            polynomial.terms().map(|(coefficient, exponents)| (exponents.to_vec(), coefficient)).collect();
        let mut parts = vec![zero; self.rows.len()];
        for Row { rest: row, pivot, made_of } in &self.rows {
            let Some(at_pivot) = rest.get(pivot) else { continue };
            let ratio = *at_pivot / row[pivot];
            for (exponents, coefficient) in row {
                let entry = rest.entry(exponents.clone()).or_insert(zero);
                *entry = *entry - ratio * *coefficient;
            }
            rest.retain(|_, coefficient| *coefficient != zero);
            for (part, coefficient) in parts.iter_mut().zip(made_of) {
                *part = *part + ratio * *coefficient;
            }
        }
        let Some(pivot) = rest.keys().next().cloned() else {
            let parts = parts.into_iter().enumerate().filter(|(_, part)| *part != zero);
            return Some(parts.map(|(at, part)| (at, part.to_f64())).collect());
        };
        // rest = polynomial - sum(parts)
        let mut made_of: Vec<Fraction> = parts.into_iter().map(|part| -part).collect();
        made_of.push(Fraction::ONE);
        self.rows.push(Row { rest, pivot, made_of });
        None
    }
}

/// The first coefficient, and the polynomial divided by it.
fn normalised<A: Arithmetic>(context: &Context<A>, polynomial: &Polynomial<A>) -> (f64, Polynomial<A>) {
    let Some((leading, _)) = polynomial.terms().next() else { return (0.0, polynomial.clone()) };
    let terms = polynomial.terms().map(|(coefficient, exponents)| (exponents.to_vec(), coefficient / leading));
    (leading.to_f64(), context.algebra.from_terms(terms))
}

/// The polynomial as a polynomial in what moves: exponents and coefficients.
fn products<A: Arithmetic>(context: &Context<A>, polynomial: &Polynomial<A>) -> BTreeMap<Vec<u8>, Polynomial<A>> {
    let algebra = context.algebra;
    let moves: Vec<bool> = (0..algebra.symbols().len()).map(|position| algebra.moves(position, context.free)).collect();
    let mut groups: BTreeMap<Vec<u8>, Vec<(Vec<u8>, Fraction)>> = BTreeMap::new();
    for (coefficient, exponents) in polynomial.terms() {
        let part = |moving: bool| -> Vec<u8> {
            exponents.iter().zip(&moves).map(|(&exponent, &moves)| if moves == moving { exponent } else { 0 }).collect()
        };
        groups.entry(part(true)).or_default().push((part(false), coefficient));
    }
    groups.into_iter().map(|(exponents, terms)| (exponents, algebra.from_terms(terms))).collect()
}

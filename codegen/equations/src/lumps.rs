//! Inertial parameters regrouped: fewer of them move the same mechanism.
//!
//! Mass is carried as second moments `M = integral of r r^T dm` (so that `J = trace(M) 1 - M`), first moments `m c` and
//! masses, in the axes of a turning and about a place. What a rotation about z does not show moves on to the turning
//! below: masses, the first moment along z and `Mzz` (Khalil & Kleinfinger 1987; Gautier 1991 put the same with J,
//! eliminating `Jyy` instead); of a turning without a joint all does. A mass at a place becomes part of the turning in
//! which the place is fixed. All of it depends on parameters and locked angles only, so it is computed once per
//! parameter set.

use std::collections::BTreeMap;

use dynid_lower::{Node, Program};

use crate::{
    algebra::Polynomial,
    arithmetic::Arithmetic,
    emit::Context,
    spatial::{ENTRIES, Matrix, Symmetric, Vector, add, apply, entry, rotate_symmetric, scale},
    tree::{Body, Place, Tree},
};

/// Places by number; 0 is the base's origin.
#[derive(Debug)]
pub struct Places<A: Arithmetic> {
    places: Vec<Place<A>>,
}

impl<A: Arithmetic> Places<A> {
    /// The number of a place.
    pub fn number(&mut self, place: &Place<A>) -> usize {
        if let Some(known) = self.places.iter().position(|known| known == place) {
            return known;
        }
        self.places.push(place.clone());
        self.places.len() - 1
    }

    /// The place of a number.
    pub fn place(&self, number: usize) -> &Place<A> {
        &self.places[number]
    }

    /// All places, in order of their numbers.
    pub fn all(&self) -> &[Place<A>] {
        &self.places
    }
}

/// A first moment whose place moves with another turning than the moment does: together they act like the mixed
/// second moment `first offset^T`.
#[derive(Debug, Clone)]
pub struct Coupling {
    /// Whose axes the first moment is fixed in.
    pub turning: usize,
    /// First moment [kg m], or times a length if `offset` is a unit vector.
    pub first: Vector<Node>,
    /// In whose axes the offset is fixed.
    pub carrier: usize,
    /// From the regular place to the actual one (m).
    pub offset: Vector<Node>,
}

/// What is left of a device's inertial parameters in one configuration.
pub struct Lumps<A: Arithmetic> {
    /// The places that are needed.
    pub places: Places<A>,
    /// Second moments by turning [kg m^2]; `Mzz` is 0.
    pub second: Vec<Symmetric>,
    /// First moments [kg m] by turning and place.
    pub first: BTreeMap<(usize, usize), Vector<Node>>,
    /// Masses (kg) by place: only at places that slide.
    pub mass: BTreeMap<usize, Node>,
    /// First moments at places that turn with something else.
    pub couplings: Vec<Coupling>,
    /// The constant rotations of the turnings as program terms.
    pub fixed: Vec<Matrix<Node>>,
}

impl<A: Arithmetic> Lumps<A> {
    /// Regroups the parameters of all links.
    pub fn new(context: &Context<A>, tree: &Tree<A>, program: &mut Program) -> Lumps<A> {
        let zero = program.number(0.0);
        let fixed = tree.turnings.iter().map(|turning| emit_matrix(context, program, &turning.fixed)).collect();
        let mut lumps = Lumps {
            places: Places { places: vec![Place::new()] },
            second: vec![[zero; 6]; tree.turnings.len()],
            first: BTreeMap::new(),
            mass: BTreeMap::new(),
            couplings: Vec::new(),
            fixed,
        };
        for body in &tree.bodies {
            lumps.add_body(context, tree, program, body);
        }
        for turning in (1..tree.turnings.len()).rev() {
            lumps.hand_down(context, tree, program, turning);
        }
        lumps.name(program);
        lumps
    }

    /// Second moments, first moment and mass of a link, in the axes of its turning.
    fn add_body(&mut self, context: &Context<A>, tree: &Tree<A>, program: &mut Program, body: &Body<A>) {
        let rotation = emit_matrix(context, program, &body.rotation);
        let mut parameter =
            |symbol: &str| context.emit(program, &context.algebra.parameter(&format!("link.{}.{symbol}", body.link)));
        let mass = parameter("m");
        let centroid = ["x", "y", "z"].map(&mut parameter);
        let [xx, xy, xz, yy, yz, zz] = ["Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"].map(&mut parameter);

        let first = scale(program, mass, centroid);
        // Integral of x^2 from the inertia about the centroid: (Iyy + Izz - Ixx) / 2; products change their sign.
        let half = program.number(0.5);
        let mut square = |plus: [Node; 2], minus: Node| {
            let sum = program.add(plus[0], plus[1]);
            let sum = program.subtract(sum, minus);
            program.multiply(half, sum)
        };
        let diagonal = [square([yy, zz], xx), square([xx, zz], yy), square([xx, yy], zz)];
        let about_centroid =
            [diagonal[0], program.negate(xy), program.negate(xz), diagonal[1], program.negate(yz), diagonal[2]];
        let mut second = about_centroid;
        for (at, (row, column)) in ENTRIES.into_iter().enumerate() {
            let steiner = program.multiply(first[row], centroid[column]);
            second[at] = program.add(second[at], steiner);
        }
        for (name, node) in ["xx", "xy", "xz", "yy", "yz", "zz"].into_iter().zip(second) {
            program.name(node, &format!("link{}_m{name}", body.link));
        }
        for (name, node) in ["x", "y", "z"].into_iter().zip(first) {
            program.name(node, &format!("link{}_m{name}", body.link));
        }
        let second = rotate_symmetric(program, &rotation, &second);
        let first = apply(program, &rotation, first);
        self.add_second(program, body.turning, second);
        self.add_first(context, tree, program, body.turning, body.place.clone(), first);
        self.add_mass(context, tree, program, body.place.clone(), mass);
    }

    /// Hands what rotating about z does not show to the turning below; all, where there is no joint.
    fn hand_down(&mut self, context: &Context<A>, tree: &Tree<A>, program: &mut Program, turning: usize) {
        let parent = tree.turnings[turning].parent;
        let fixed = self.fixed[turning];
        let zero = program.number(0.0);
        let is_joint = tree.turnings[turning].joint.is_some();
        let mut hidden = [zero; 6];
        let from = if is_joint { entry(2, 2) } else { 0 };
        hidden[from..].swap_with_slice(&mut self.second[turning][from..]);
        if !tree.stands_still(parent) {
            let below = rotate_symmetric(program, &fixed, &hidden);
            self.add_second(program, parent, below);
        }
        let keys: Vec<(usize, usize)> = self.first.keys().filter(|(of, _)| *of == turning).copied().collect();
        for key in keys {
            let Some(first) = self.first.get_mut(&key) else { continue };
            let mut hidden = [zero; 3];
            let from = if is_joint { 2 } else { 0 };
            hidden[from..].swap_with_slice(&mut first[from..]);
            let place = self.places.place(key.1).clone();
            let below = apply(program, &fixed, hidden);
            self.add_first(context, tree, program, parent, place, below);
        }
    }

    fn add_second(&mut self, program: &mut Program, turning: usize, second: Symmetric) {
        for (sum, part) in self.second[turning].iter_mut().zip(second) {
            *sum = program.add(*sum, part);
        }
    }

    /// A first moment at a place. The parts of the place that are fixed in the turning itself make second moments;
    /// those that turn with something that does not carry the turning make couplings.
    fn add_first(
        &mut self,
        context: &Context<A>,
        tree: &Tree<A>,
        program: &mut Program,
        turning: usize,
        mut place: Place<A>,
        first: Vector<Node>,
    ) {
        if tree.stands_still(turning) || first.iter().all(|&component| program.is_zero(component)) {
            return;
        }
        // What is fixed in the base does not matter: it does not move.
        place.retain(|&carrier, segment| !tree.stands_still(carrier) || !segment.slides.is_empty());
        let fixed_in_it = place.get(&turning).filter(|segment| segment.slides.is_empty()).cloned();
        if let Some(segment) = fixed_in_it {
            place.remove(&turning);
            let offset = emit_vector(context, program, &segment.constant);
            let second = ENTRIES.map(|(row, column)| {
                let one = program.multiply(first[row], offset[column]);
                let other = program.multiply(first[column], offset[row]);
                program.add(one, other)
            });
            self.add_second(program, turning, second);
        }
        let irregular: Vec<usize> = (place.iter())
            .filter(|(carrier, segment)| !tree.carries(**carrier, turning) && segment.slides.is_empty())
            .map(|(carrier, _)| *carrier)
            .collect();
        for carrier in irregular {
            let Some(segment) = place.remove(&carrier) else { continue };
            let offset = emit_vector(context, program, &segment.constant);
            let coupling = unit_offset(program, Coupling { turning, first, carrier, offset });
            self.couplings.push(coupling);
        }
        let number = self.places.number(&place);
        let zero = program.number(0.0);
        let sum = self.first.entry((turning, number)).or_insert([zero; 3]);
        *sum = add(program, *sum, first);
    }

    /// A mass at a place belongs to the turning in which the place is fixed.
    fn add_mass(
        &mut self,
        context: &Context<A>,
        tree: &Tree<A>,
        program: &mut Program,
        mut place: Place<A>,
        mass: Node,
    ) {
        while let Some((&turning, segment)) = place.last_key_value() {
            if !segment.slides.is_empty() {
                let number = self.places.number(&place);
                let zero = program.number(0.0);
                let sum = self.mass.entry(number).or_insert(zero);
                *sum = program.add(*sum, mass);
                return;
            }
            if tree.stands_still(turning) {
                place.remove(&turning);
                continue;
            }
            let offset = emit_vector(context, program, &segment.constant);
            place.remove(&turning);
            let first = scale(program, mass, offset);
            let second = ENTRIES.map(|(row, column)| program.multiply(first[row], offset[column]));
            self.add_second(program, turning, second);
            self.add_first(context, tree, program, turning, place.clone(), first);
        }
    }

    fn name(&self, program: &mut Program) {
        for (turning, second) in self.second.iter().enumerate() {
            for (name, &node) in ["xx", "xy", "xz", "yy", "yz", "zz"].into_iter().zip(second) {
                program.name(node, &format!("m{name}{turning}"));
            }
        }
        for ((turning, place), first) in &self.first {
            for (name, &node) in ["x", "y", "z"].into_iter().zip(first) {
                program.name(node, &format!("m{name}{turning}_p{place}"));
            }
        }
        for coupling in &self.couplings {
            for (name, &node) in ["x", "y", "z"].into_iter().zip(&coupling.first) {
                program.name(node, &format!("m{name}{}_with{}", coupling.turning, coupling.carrier));
            }
        }
    }
}

/// An offset along one axis becomes a unit vector, its length going into the first moment.
fn unit_offset(program: &mut Program, coupling: Coupling) -> Coupling {
    let along: Vec<usize> = (0..3).filter(|&k| !program.is_zero(coupling.offset[k])).collect();
    let [axis] = along[..] else { return coupling };
    let (zero, one) = (program.number(0.0), program.number(1.0));
    let mut offset = [zero; 3];
    offset[axis] = one;
    let first = scale(program, coupling.offset[axis], coupling.first);
    Coupling { first, offset, ..coupling }
}

/// A matrix of polynomials as program terms.
pub fn emit_matrix<A: Arithmetic>(
    context: &Context<A>,
    program: &mut Program,
    matrix: &Matrix<Polynomial<A>>,
) -> Matrix<Node> {
    [0, 1, 2].map(|row| emit_vector(context, program, &matrix[row]))
}

/// A vector of polynomials as program terms.
pub fn emit_vector<A: Arithmetic>(
    context: &Context<A>,
    program: &mut Program,
    vector: &Vector<Polynomial<A>>,
) -> Vector<Node> {
    [0, 1, 2].map(|k| context.emit(program, &vector[k]))
}

//! The inertia matrix by composite bodies (Walker & Orin 1982; Featherstone's CRBA), over turnings and places.
//!
//! From the tips inwards, each turning takes in the second and first moments of what it carries. Turning at unit
//! acceleration, the composite gives a moment and forces; what they ask of the turnings below is a column of D. A column of a joint that
//! slides is the recursion at its unit acceleration.

use std::collections::BTreeMap;

use dynid_lower::{Node, Program};

use crate::{
    arithmetic::Arithmetic,
    emit::Context,
    lumps::Coupling,
    recursion::{Mechanism, Motion},
    spatial::{ENTRIES, Symmetric, Vector, add, cross, dot, entry, rotate_symmetric, scale},
    tree::{Place, Segment},
};

/// Inertia between turnings, (upper, lower) with the lower index first; what vanishes is missing.
type TurningInertia = BTreeMap<(usize, usize), Node>;

/// D by joint pairs (i, j), i <= j; what vanishes may be missing.
pub fn inertia<A: Arithmetic>(mechanism: &Mechanism<A>, program: &mut Program) -> BTreeMap<(usize, usize), Node> {
    let by_turning = Composite::new(mechanism, program).turning_inertia();
    let turnings = &mechanism.tree.turnings;
    let mut inertia: BTreeMap<(usize, usize), Node> = BTreeMap::new();
    for (&(a, b), &value) in &by_turning {
        let (Some(i), Some(j)) = (turnings[a].joint, turnings[b].joint) else { continue };
        // Two turnings of one joint meet twice in its diagonal entry.
        let count = if a != b && i == j { 2 } else { 1 };
        let factor = program.number(f64::from(count) * turnings[a].factor * turnings[b].factor);
        let part = program.multiply(factor, value);
        let zero = program.number(0.0);
        let sum = inertia.entry((i.min(j), i.max(j))).or_insert(zero);
        *sum = program.add(*sum, part);
    }
    let places = mechanism.lumps.places.all();
    let slides =
        |joint: usize| places.iter().flat_map(BTreeMap::values).any(|segment| segment.slides.contains_key(&joint));
    for &sliding in mechanism.context.free.iter().filter(|joint| slides(**joint)) {
        let motion = unit_acceleration(&mechanism.context, program, sliding);
        let torques = mechanism.torques(program, &motion);
        for &joint in mechanism.context.free {
            inertia.insert((joint.min(sliding), joint.max(sliding)), torques[joint]);
        }
    }
    inertia
}

/// Unit acceleration of one joint from rest, without gravity: the torques are a column of D.
fn unit_acceleration<A: Arithmetic>(context: &Context<A>, program: &mut Program, joint: usize) -> Motion {
    let (zero, one): (Node, Node) = (program.number(0.0), program.number(1.0));
    let dq = vec![zero; context.device.joints.len()];
    let mut ddq = dq.clone();
    ddq[joint] = one;
    Motion { dq, ddq, gravity: [zero; 3], prefix: format!("s{joint}_") }
}

/// Composite bodies under way.
struct Composite<'a, 'b, A: Arithmetic> {
    mechanism: &'b Mechanism<'a, A>,
    program: &'b mut Program,
    places: Vec<Place<A>>,
    second: Vec<Symmetric>,
    first: BTreeMap<(usize, usize), Vector<Node>>,
    /// First moments at places that turn with something else.
    irregular: Vec<Coupling>,
    /// Moments on lower turnings that unit acceleration of a turning asks for through couplings: by (of, on).
    extra: BTreeMap<(usize, usize), Vector<Node>>,
    inertia: TurningInertia,
}

impl<'a, 'b, A: Arithmetic> Composite<'a, 'b, A> {
    fn new(mechanism: &'b Mechanism<'a, A>, program: &'b mut Program) -> Self {
        let lumps = mechanism.lumps;
        Composite {
            mechanism,
            places: lumps.places.all().to_vec(),
            second: lumps.second.clone(),
            first: BTreeMap::new(),
            irregular: lumps.couplings.clone(),
            extra: BTreeMap::new(),
            inertia: BTreeMap::new(),
            program,
        }
    }

    fn turning_inertia(mut self) -> TurningInertia {
        self.take_in_places();
        self.couplings();
        for turning in (1..self.mechanism.tree.turnings.len()).rev() {
            self.take_in_own_offsets(turning);
            if self.mechanism.tree.turnings[turning].joint.is_some() {
                self.column(turning);
            }
            self.hand_down(turning);
        }
        self.inertia
    }

    /// What lies at places that slide, where it is now: masses and first moments become second ones and couplings.
    fn take_in_places(&mut self) {
        for (&(turning, place), &first) in &self.mechanism.lumps.first {
            self.take_in_first(turning, self.mechanism.lumps.places.place(place).clone(), first);
        }
        for (&place, &mass) in &self.mechanism.lumps.mass {
            let mut place = self.mechanism.lumps.places.place(place).clone();
            while let Some((turning, segment)) = place.pop_last() {
                let offset = self.mechanism.offset(self.program, &segment);
                let first = scale(self.program, mass, offset);
                for (at, (row, column)) in ENTRIES.into_iter().enumerate() {
                    let product = self.program.multiply(first[row], offset[column]);
                    self.second[turning][at] = self.program.add(self.second[turning][at], product);
                }
                self.take_in_first(turning, place.clone(), first);
            }
        }
    }

    /// A first moment at a place, all of whose parts then carry the turning.
    fn take_in_first(&mut self, turning: usize, mut place: Place<A>, first: Vector<Node>) {
        place.retain(|&carrier, _| !self.mechanism.tree.stands_still(carrier));
        if let Some(segment) = place.remove(&turning) {
            self.take_in_offset(turning, &segment, first);
        }
        let carries = |carrier: &usize| self.mechanism.tree.carries(*carrier, turning);
        let irregular: Vec<usize> = place.keys().copied().filter(|carrier| !carries(carrier)).collect();
        for carrier in irregular {
            let Some(segment) = place.remove(&carrier) else { continue };
            let offset = self.mechanism.offset(self.program, &segment);
            self.irregular.push(Coupling { turning, first, carrier, offset });
        }
        self.add_first(turning, place, first);
    }

    fn take_in_offset(&mut self, turning: usize, segment: &Segment<A>, first: Vector<Node>) {
        let offset = self.mechanism.offset(self.program, segment);
        for (at, (row, column)) in ENTRIES.into_iter().enumerate() {
            let one = self.program.multiply(first[row], offset[column]);
            let other = self.program.multiply(first[column], offset[row]);
            let both = self.program.add(one, other);
            self.second[turning][at] = self.program.add(self.second[turning][at], both);
        }
    }

    /// First moments at places that end in the turning itself move to where it turns about.
    fn take_in_own_offsets(&mut self, turning: usize) {
        let ends_here = |places: &[Place<A>], place: usize| {
            places[place].last_key_value().is_some_and(|(&last, _)| last == turning)
        };
        let keys: Vec<(usize, usize)> =
            self.first.keys().filter(|key| key.0 == turning && ends_here(&self.places, key.1)).copied().collect();
        for key in keys {
            let (Some(first), Some(segment)) = (self.first.remove(&key), self.places[key.1].get(&turning).cloned())
            else {
                continue;
            };
            self.take_in_offset(turning, &segment, first);
            let mut before = self.places[key.1].clone();
            before.remove(&turning);
            self.add_first(turning, before, first);
        }
    }

    /// Unit acceleration about the turning's axis.
    fn column(&mut self, turning: usize) {
        let zero = self.program.number(0.0);
        let second = self.second[turning];
        let [xz, yz] = [second[entry(0, 2)], second[entry(1, 2)]].map(|product| self.program.negate(product));
        let axial = self.program.add(second[entry(0, 0)], second[entry(1, 1)]);
        let mut moments = vec![[zero; 3]; self.mechanism.tree.turnings.len()];
        moments[turning] = [xz, yz, axial];
        for (&(_, on), &moment) in self.extra.range((turning, 0)..(turning + 1, 0)) {
            moments[on] = add(self.program, moments[on], moment);
        }
        let forces = self
            .first
            .range((turning, 0)..(turning + 1, 0))
            .map(|(&(_, place), &[x, y, _])| (place, [self.program.negate(y), x, zero]))
            .collect::<Vec<_>>();
        let forces = forces.into_iter().map(|(place, force)| ((place, turning), force)).collect();
        let motion = Motion { dq: Vec::new(), ddq: Vec::new(), gravity: [zero; 3], prefix: format!("e{turning}_") };
        let places = &self.places;
        let moments = self.mechanism.axial_moments(self.program, &motion, places, forces, moments);
        for below in (1..=turning).filter(|&below| self.mechanism.tree.carries(below, turning)) {
            self.add_inertia(below, turning, moments[below]);
        }
    }

    /// The turning below carries the composite.
    fn hand_down(&mut self, turning: usize) {
        let parent = self.mechanism.tree.turnings[turning].parent;
        if self.mechanism.tree.stands_still(parent) {
            return;
        }
        let (c, s) = self.mechanism.cos_sin(self.program, turning);
        let program = &mut *self.program;
        let [xx, xy, xz, yy, yz, zz] = self.second[turning];
        // Rz(q) M Rz(q)^T, with v = s (Mxx - Myy) + 2 c Mxy.
        let (difference, twice) = (program.subtract(xx, yy), program.add(xy, xy));
        let (v1, v2) = (program.multiply(s, difference), program.multiply(c, twice));
        let v = program.add(v1, v2);
        let (sv, cv) = (program.multiply(s, v), program.multiply(c, v));
        let (cxz, syz) = (program.multiply(c, xz), program.multiply(s, yz));
        let (sxz, cyz) = (program.multiply(s, xz), program.multiply(c, yz));
        let turned = [
            program.subtract(xx, sv),
            program.subtract(cv, xy),
            program.subtract(cxz, syz),
            program.add(yy, sv),
            program.add(sxz, cyz),
            zz,
        ];
        let below = rotate_symmetric(program, &self.mechanism.lumps.fixed[turning], &turned);
        for (at, name) in ["xx", "xy", "xz", "yy", "yz", "zz"].into_iter().enumerate() {
            let sum = program.add(self.second[parent][at], below[at]);
            program.name(sum, &format!("composite{parent}_{name}"));
            self.second[parent][at] = sum;
        }
        let firsts: Vec<(usize, Vector<Node>)> =
            self.first.range((turning, 0)..(turning + 1, 0)).map(|(&(_, place), &first)| (place, first)).collect();
        for (place, first) in firsts {
            let below = self.mechanism.down_from(self.program, turning, first);
            let place = self.places[place].clone();
            self.add_first(parent, place, below);
        }
    }

    /// Mixed second moments between two turnings: part of the composite where both are carried, moments and cross
    /// terms above.
    fn couplings(&mut self) {
        let tree = self.mechanism.tree;
        for coupling in std::mem::take(&mut self.irregular) {
            let (turning, carrier) = (coupling.turning, coupling.carrier);
            let mut common = turning;
            while !tree.carries(common, carrier) {
                common = tree.turnings[common].parent;
            }
            let (first, first_rates) = self.rates_above(common, turning, coupling.first);
            let (offset, offset_rates) = self.rates_above(common, carrier, coupling.offset);
            if !tree.stands_still(common) {
                for (at, (row, column)) in ENTRIES.into_iter().enumerate() {
                    let one = self.program.multiply(first[row], offset[column]);
                    let other = self.program.multiply(first[column], offset[row]);
                    let both = self.program.add(one, other);
                    self.second[common][at] = self.program.add(self.second[common][at], both);
                }
                for (rates, arm) in [(&first_rates, offset), (&offset_rates, first)] {
                    for &(of, rate) in rates {
                        let moment = cross(self.program, arm, rate);
                        let zero = self.program.number(0.0);
                        let sum = self.extra.entry((of, common)).or_insert([zero; 3]);
                        *sum = add(self.program, *sum, moment);
                    }
                }
            }
            for &(one, first_rate) in &first_rates {
                for &(other, offset_rate) in &offset_rates {
                    let value = dot(self.program, first_rate, offset_rate);
                    self.add_inertia(one.min(other), one.max(other), value);
                }
            }
        }
    }

    /// A vector fixed in `turning`, in the axes of `common`, and its change as each turning in between turns.
    fn rates_above(
        &mut self,
        common: usize,
        mut turning: usize,
        mut vector: Vector<Node>,
    ) -> (Vector<Node>, Vec<(usize, Vector<Node>)>) {
        let zero = self.program.number(0.0);
        let mut rates: Vec<(usize, Vector<Node>)> = Vec::new();
        while turning != common {
            rates.push((turning, [self.program.negate(vector[1]), vector[0], zero]));
            vector = self.mechanism.down_from(self.program, turning, vector);
            for (_, rate) in &mut rates {
                *rate = self.mechanism.down_from(self.program, turning, *rate);
            }
            turning = self.mechanism.tree.turnings[turning].parent;
        }
        (vector, rates)
    }

    fn add_inertia(&mut self, lower: usize, upper: usize, value: Node) {
        let zero = self.program.number(0.0);
        let sum = self.inertia.entry((lower, upper)).or_insert(zero);
        *sum = self.program.add(*sum, value);
    }

    fn add_first(&mut self, turning: usize, place: Place<A>, first: Vector<Node>) {
        let number = match self.places.iter().position(|known| *known == place) {
            Some(known) => known,
            None => {
                self.places.push(place);
                self.places.len() - 1
            }
        };
        let zero = self.program.number(0.0);
        let sum = self.first.entry((turning, number)).or_insert([zero; 3]);
        *sum = add(self.program, *sum, first);
    }
}

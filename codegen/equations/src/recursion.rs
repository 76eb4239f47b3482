//! The symbolic recursion: Newton-Euler for torques, every step a named term.
//!
//! Each turning has a matrix `U = [dw]x + [w]x [w]x`, so that a point `r` of its axes accelerates by `U r`. A body gives
//! the force `U m c` at its place and the moment that the second moments `M` make with U:
//! `integral of r x (U r) dm`. Forces pass from place to place (principle of virtual power), moments from turning to
//! turning; what does not move is never computed, as the program's constructors fold zeros.

use std::collections::BTreeMap;

use dynid_lower::{Node, Program};

use crate::{
    arithmetic::Arithmetic,
    emit::Context,
    lumps::{Lumps, emit_vector},
    spatial::{Matrix, Vector, add, apply, cross, entry, scale, transposed},
    tree::{Place, Tree},
};

/// How the mechanism moves: by the device's joint index, zeros for locked joints.
pub struct Motion {
    /// Joint velocities.
    pub dq: Vec<Node>,
    /// Joint accelerations.
    pub ddq: Vec<Node>,
    /// Acceleration of the base, i.e. gravity upwards [m/s^2].
    pub gravity: Vector<Node>,
    /// What the names of terms start with.
    pub prefix: String,
}

/// A mechanism with its regrouped parameters, ready for recursions.
pub struct Mechanism<'a, A: Arithmetic> {
    /// Symbols, device, free joints.
    pub context: Context<'a, A>,
    /// Turnings and places.
    pub tree: &'a Tree<A>,
    /// Regrouped parameters.
    pub lumps: &'a Lumps<A>,
}

/// Velocity and acceleration of a turning, in its own axes.
struct Rates {
    /// Angular velocity [rad/s].
    w: Vector<Node>,
    /// Angular acceleration [rad/s^2]; x and y are only there where they were needed.
    dw: [Option<Node>; 3],
    /// `[dw]x + [w]x [w]x` [1/s^2].
    u: Matrix<Node>,
    /// `Uxx - Uzz = wx^2 - wz^2`.
    xx_minus_zz: Node,
}

/// One recursion under way.
struct Recursion<'a, 'b, A: Arithmetic> {
    mechanism: &'b Mechanism<'a, A>,
    motion: &'b Motion,
    program: &'b mut Program,
    rates: Vec<Rates>,
    /// Acceleration of a place in the axes of a turning [m/s^2].
    accelerations: BTreeMap<(usize, usize), Vector<Node>>,
    /// Forces at places, in the axes of turnings (N).
    forces: BTreeMap<(usize, usize), Vector<Node>>,
    /// Moments on turnings, in their axes [N m].
    moments: Vec<Vector<Node>>,
    /// Moment about each turning's axis [N m].
    axial: Vec<Node>,
    /// Sum at each joint [N m or N].
    torques: Vec<Node>,
    /// Places, those on the way to the lumps' places included.
    places: Vec<Place<A>>,
}

impl<A: Arithmetic> Mechanism<'_, A> {
    /// Joint torques that make the motion, by the device's joint index.
    pub fn torques(&self, program: &mut Program, motion: &Motion) -> Vec<Node> {
        let mut recursion = self.start(program, motion);
        recursion.outward();
        recursion.bodies();
        recursion.inward();
        recursion.torques
    }

    /// Moments about the axis of each turning that balance these forces at places (in the axes of turnings) and
    /// moments on turnings.
    pub fn axial_moments(
        &self,
        program: &mut Program,
        motion: &Motion,
        places: &[Place<A>],
        forces: BTreeMap<(usize, usize), Vector<Node>>,
        moments: Vec<Vector<Node>>,
    ) -> Vec<Node> {
        let mut recursion = self.start(program, motion);
        recursion.places = places.to_vec();
        recursion.forces = forces;
        recursion.moments = moments;
        recursion.inward();
        recursion.axial
    }

    fn start<'b>(&'b self, program: &'b mut Program, motion: &'b Motion) -> Recursion<'b, 'b, A> {
        let zero = program.number(0.0);
        Recursion {
            mechanism: self,
            motion,
            rates: Vec::new(),
            accelerations: BTreeMap::new(),
            forces: BTreeMap::new(),
            moments: vec![[zero; 3]; self.tree.turnings.len()],
            axial: vec![zero; self.tree.turnings.len()],
            torques: vec![zero; self.context.device.joints.len()],
            places: self.lumps.places.all().to_vec(),
            program,
        }
    }

    /// Cosine and sine of a turning's rotation.
    pub fn cos_sin(&self, program: &mut Program, turning: usize) -> (Node, Node) {
        let turning = &self.tree.turnings[turning];
        let factors = turning.joint.map(|joint| (joint, turning.factor)).into_iter().collect();
        let angle = crate::algebra::AngleSum { factors, constant: turning.offset };
        let (cosine, sine) = self.context.algebra.cos_sin(&angle);
        (self.context.emit(program, &cosine), self.context.emit(program, &sine))
    }

    /// A vector in the axes of a turning, from those of the turning below.
    pub fn up_into(&self, program: &mut Program, turning: usize, vector: Vector<Node>) -> Vector<Node> {
        let [x, y, z] = self.before_spin(program, turning, vector);
        let (c, s) = self.cos_sin(program, turning);
        let (cx, sy) = (program.multiply(c, x), program.multiply(s, y));
        let (cy, sx) = (program.multiply(c, y), program.multiply(s, x));
        [program.add(cx, sy), program.subtract(cy, sx), z]
    }

    /// A vector in the axes before a turning's rotation, from those of the turning below.
    pub fn before_spin(&self, program: &mut Program, turning: usize, vector: Vector<Node>) -> Vector<Node> {
        apply(program, &transposed(&self.lumps.fixed[turning]), vector)
    }

    /// A vector in the axes of the turning below.
    pub fn down_from(&self, program: &mut Program, turning: usize, [x, y, z]: Vector<Node>) -> Vector<Node> {
        let (c, s) = self.cos_sin(program, turning);
        let (cx, sy) = (program.multiply(c, x), program.multiply(s, y));
        let (cy, sx) = (program.multiply(c, y), program.multiply(s, x));
        let before = [program.subtract(cx, sy), program.add(cy, sx), z];
        apply(program, &self.lumps.fixed[turning], before)
    }

    /// A vector in the axes of `to`, from those of `from`.
    pub fn carry(&self, program: &mut Program, from: usize, to: usize, vector: Vector<Node>) -> Vector<Node> {
        if from == to {
            vector
        } else if self.tree.carries(from, to) {
            let below = self.carry(program, from, self.tree.turnings[to].parent, vector);
            self.up_into(program, to, below)
        } else {
            let below = self.down_from(program, from, vector);
            self.carry(program, self.tree.turnings[from].parent, to, below)
        }
    }
}

impl<A: Arithmetic> Recursion<'_, '_, A> {
    fn name<const N: usize>(&mut self, nodes: [Node; N], stem: &str) -> [Node; N] {
        let prefix = &self.motion.prefix;
        for (axis, node) in ["x", "y", "z"].into_iter().zip(nodes) {
            self.program.name(node, &format!("{prefix}{stem}_{axis}"));
        }
        nodes
    }

    /// Velocities and accelerations of the turnings, from the base outwards.
    fn outward(&mut self) {
        let zero = self.program.number(0.0);
        self.rates.push(Rates { w: [zero; 3], dw: [Some(zero); 3], u: [[zero; 3]; 3], xx_minus_zz: zero });
        for turning in 1..self.mechanism.tree.turnings.len() {
            let rates = self.rates_of(turning);
            self.name(rates.w, &format!("w{turning}"));
            for (row, name) in ["x", "y", "z"].into_iter().enumerate() {
                self.name(rates.u[row], &format!("u{turning}_{name}"));
            }
            self.rates.push(rates);
        }
    }

    fn rates_of(&mut self, turning: usize) -> Rates {
        let mechanism = self.mechanism;
        let description = &mechanism.tree.turnings[turning];
        let parent = description.parent;
        let zero = self.program.number(0.0);
        let of_joint = |rates: &[Node]| description.joint.map_or(zero, |joint| rates[joint]);
        let factor = self.program.number(description.factor);
        let rate = self.program.multiply(factor, of_joint(&self.motion.dq));
        let rate_change = self.program.multiply(factor, of_joint(&self.motion.ddq));

        let w = mechanism.up_into(self.program, turning, self.rates[parent].w);
        let w = [w[0], w[1], self.program.add(w[2], rate)];
        let fixed = mechanism.lumps.fixed[turning];
        let axis_row =
            fixed.iter().position(|row| self.program.number_of(row[2]).is_some_and(|value| value.abs() == 1.0));
        let program = &mut *self.program;
        let (xy, xz, yz) = (program.multiply(w[0], w[1]), program.multiply(w[0], w[2]), program.multiply(w[1], w[2]));
        let (xx, zz) = (program.multiply(w[0], w[0]), program.multiply(w[2], w[2]));

        let Some(axis_row) = axis_row else {
            // The parent's angular acceleration is carried along as it is.
            let dw_parent = [0, 1, 2].map(|k| self.angular_acceleration(parent, k));
            let dw = mechanism.up_into(self.program, turning, dw_parent);
            let program = &mut *self.program;
            let (gyro_x, gyro_y) = (program.multiply(rate, w[1]), program.multiply(rate, w[0]));
            let dw = [program.add(dw[0], gyro_x), program.subtract(dw[1], gyro_y), program.add(dw[2], rate_change)];
            let yy = program.multiply(w[1], w[1]);
            let u = [
                [sum_negated(program, yy, zz), program.subtract(xy, dw[2]), program.add(xz, dw[1])],
                [program.add(xy, dw[2]), sum_negated(program, xx, zz), program.subtract(yz, dw[0])],
                [program.subtract(xz, dw[1]), program.add(yz, dw[0]), sum_negated(program, xx, yy)],
            ];
            let xx_minus_zz = program.subtract(xx, zz);
            return Rates { w, dw: dw.map(Some), u, xx_minus_zz };
        };
        // A rotation about z leaves Uzz and turns (Uxz, Uyz) like a vector: both come from the parent's U.
        let column = fixed[axis_row][2];
        let along = [0, 1, 2].map(|row| self.rates[parent].u[row][axis_row]);
        let along = scale(self.program, column, along);
        let [u_xz, u_yz, u_zz] = mechanism.up_into(self.program, turning, along);
        let dw_axis = self.angular_acceleration(parent, axis_row);
        let program = &mut *self.program;
        let dw_axis = program.multiply(column, dw_axis);
        let dw_z = program.add(dw_axis, rate_change);
        let twice = program.add(w[2], w[2]);
        let (twice_xz, twice_yz) = (program.multiply(twice, w[0]), program.multiply(twice, w[1]));
        let xx_minus_zz = program.subtract(xx, zz);
        let u = [
            [program.add(u_zz, xx_minus_zz), program.subtract(xy, dw_z), u_xz],
            [program.add(xy, dw_z), sum_negated(program, xx, zz), u_yz],
            [program.subtract(twice_xz, u_xz), program.subtract(twice_yz, u_yz), u_zz],
        ];
        Rates { w, dw: [None, None, Some(dw_z)], u, xx_minus_zz }
    }

    /// One component of a turning's angular acceleration, from U where it was not carried along.
    fn angular_acceleration(&mut self, turning: usize, axis: usize) -> Node {
        let Rates { w, dw, u, .. } = &self.rates[turning];
        if let Some(known) = dw[axis] {
            return known;
        }
        let (other, sign) = if axis == 0 { (1, -1.0) } else { (0, 1.0) };
        let gyro = self.program.multiply(w[other], w[2]);
        let difference = self.program.subtract(u[other][2], gyro);
        let sign = self.program.number(sign);
        self.program.multiply(sign, difference)
    }

    /// Acceleration of a place in the axes of a turning.
    fn acceleration(&mut self, place: usize, turning: usize) -> Vector<Node> {
        if let Some(&known) = self.accelerations.get(&(place, turning)) {
            return known;
        }
        let tree = self.mechanism.tree;
        let last = self.places[place].last_key_value().map_or(0, |(&last, _)| last);
        let value = if turning == last {
            self.acceleration_at_source(place, last)
        } else if turning != 0 && tree.carries(last, turning) {
            let below = self.acceleration(place, tree.turnings[turning].parent);
            self.mechanism.up_into(self.program, turning, below)
        } else {
            // Towards the last turning of the place: one step of the way from there.
            let towards = (turning + 1..tree.turnings.len())
                .find(|&child| tree.turnings[child].parent == turning && tree.carries(child, last));
            match towards {
                Some(child) => {
                    let above = self.acceleration(place, child);
                    self.mechanism.down_from(self.program, child, above)
                }
                None => {
                    let below = self.acceleration(place, tree.turnings[turning].parent);
                    self.mechanism.up_into(self.program, turning, below)
                }
            }
        };
        let value = self.name(value, &format!("a{turning}_p{place}"));
        self.accelerations.insert((place, turning), value);
        value
    }

    /// Acceleration of a place in the axes of its last segment.
    fn acceleration_at_source(&mut self, place: usize, last: usize) -> Vector<Node> {
        let Some(segment) = self.places[place].get(&last).cloned() else { return self.motion.gravity };
        let before = self.place_without(place, last);
        let mut sum = self.acceleration(before, last);
        let offset = self.offset(&segment);
        let turned = apply(self.program, &self.rates[last].u, offset);
        sum = add(self.program, sum, turned);
        for (&joint, slope) in &segment.slides {
            let direction = emit_vector(&self.mechanism.context, self.program, slope);
            let along = scale(self.program, self.motion.ddq[joint], direction);
            sum = add(self.program, sum, along);
            let two = self.program.number(2.0);
            let twice = self.program.multiply(two, self.motion.dq[joint]);
            let across = cross(self.program, self.rates[last].w, direction);
            let coriolis = scale(self.program, twice, across);
            sum = add(self.program, sum, coriolis);
        }
        sum
    }

    /// A segment's vector at the current joint positions.
    fn offset(&mut self, segment: &crate::tree::Segment<A>) -> Vector<Node> {
        self.mechanism.offset(self.program, segment)
    }

    /// The number of a place without one of its segments.
    fn place_without(&mut self, place: usize, turning: usize) -> usize {
        let mut before = self.places[place].clone();
        before.remove(&turning);
        match self.places.iter().position(|known| *known == before) {
            Some(known) => known,
            None => {
                self.places.push(before);
                self.places.len() - 1
            }
        }
    }

    /// Forces and moments of all lumps.
    fn bodies(&mut self) {
        let lumps = self.mechanism.lumps;
        for turning in 1..self.mechanism.tree.turnings.len() {
            let moment = self.moment_of_second_moments(turning);
            self.moments[turning] = add(self.program, self.moments[turning], moment);
        }
        for (&(turning, place), &first) in &lumps.first {
            let force = apply(self.program, &self.rates[turning].u, first);
            self.add_force(place, turning, force);
            let acceleration = self.acceleration(place, turning);
            let moment = cross(self.program, first, acceleration);
            self.moments[turning] = add(self.program, self.moments[turning], moment);
        }
        for (&place, &mass) in &lumps.mass {
            let last = self.places[place].last_key_value().map_or(0, |(&last, _)| last);
            let acceleration = self.acceleration(place, last);
            let force = scale(self.program, mass, acceleration);
            self.add_force(place, last, force);
        }
        for coupling in &lumps.couplings {
            let (turning, carrier) = (coupling.turning, coupling.carrier);
            let force = apply(self.program, &self.rates[turning].u, coupling.first);
            let force = self.mechanism.carry(self.program, turning, carrier, force);
            let moment = cross(self.program, coupling.offset, force);
            self.moments[carrier] = add(self.program, self.moments[carrier], moment);
            let acceleration = apply(self.program, &self.rates[carrier].u, coupling.offset);
            let acceleration = self.mechanism.carry(self.program, carrier, turning, acceleration);
            let moment = cross(self.program, coupling.first, acceleration);
            self.moments[turning] = add(self.program, self.moments[turning], moment);
        }
    }

    /// `integral of r x (U r) dm` for the second moments of a turning, whose `Mzz` is 0.
    fn moment_of_second_moments(&mut self, turning: usize) -> Vector<Node> {
        let m = self.mechanism.lumps.second[turning];
        let Rates { u, xx_minus_zz, .. } = self.rates[turning];
        let program = &mut *self.program;
        let [xx, xy, xz, yy, yz] = [m[0], m[1], m[2], m[3], m[4]];
        let differences = [program.subtract(u[2][2], u[1][1]), xx_minus_zz, program.subtract(u[1][1], u[0][0])];
        let mut sum = |terms: [(Node, Node, bool); 5]| {
            let mut sum = program.number(0.0);
            for (lump, rate, plus) in terms {
                let product = program.multiply(lump, rate);
                sum = if plus { program.add(sum, product) } else { program.subtract(sum, product) };
            }
            sum
        };
        if self.mechanism.tree.stands_still(self.mechanism.tree.turnings[turning].parent) {
            // About a fixed axis only the inertia Jzz = Mxx + Myy shows.
            let axial = self.program.add(xx, yy);
            self.program.name(axial, &format!("jzz{turning}"));
            let zero = self.program.number(0.0);
            let moment = self.program.multiply(axial, u[1][0]);
            return [zero, zero, moment];
        }
        let none = (m[entry(2, 2)], u[0][0], true);
        [
            sum([(xy, u[2][0], true), (yy, u[2][1], true), (yz, differences[0], true), (xz, u[1][0], false), none]),
            sum([(xz, differences[1], true), (yz, u[0][1], true), (xx, u[2][0], false), (xy, u[2][1], false), none]),
            sum([
                (xx, u[1][0], true),
                (xy, differences[2], true),
                (xz, u[1][2], true),
                (yy, u[0][1], false),
                (yz, u[0][2], false),
            ]),
        ]
    }

    fn add_force(&mut self, place: usize, turning: usize, force: Vector<Node>) {
        let zero = self.program.number(0.0);
        let sum = self.forces.entry((place, turning)).or_insert([zero; 3]);
        *sum = add(self.program, *sum, force);
    }

    /// Forces to moments, moments to torques, from the tips inwards.
    fn inward(&mut self) {
        let tree = self.mechanism.tree;
        // Places of many segments first: each hands its force to one of fewer.
        while let Some(place) =
            self.forces.keys().map(|&(place, _)| place).max_by_key(|&place| (self.places[place].len(), place))
        {
            let Some((&last, segment)) = self.places[place].last_key_value() else { break };
            let segment = segment.clone();
            let force = self.force_in(place, last);
            let offset = self.offset(&segment);
            let moment = cross(self.program, offset, force);
            self.moments[last] = add(self.program, self.moments[last], moment);
            for (&joint, slope) in &segment.slides {
                let direction = emit_vector(&self.mechanism.context, self.program, slope);
                let power = crate::spatial::dot(self.program, direction, force);
                self.torques[joint] = self.program.add(self.torques[joint], power);
            }
            let before = self.place_without(place, last);
            self.add_force(before, last, force);
        }
        for turning in (1..tree.turnings.len()).rev() {
            let moment = self.moments[turning];
            let moment = self.name(moment, &format!("n{turning}"));
            let description = &tree.turnings[turning];
            self.axial[turning] = moment[2];
            if let Some(joint) = description.joint {
                let factor = self.program.number(description.factor);
                let power = self.program.multiply(factor, moment[2]);
                self.torques[joint] = self.program.add(self.torques[joint], power);
            }
            if !tree.stands_still(description.parent) {
                let below = self.mechanism.down_from(self.program, turning, moment);
                self.moments[description.parent] = add(self.program, self.moments[description.parent], below);
            }
        }
    }

    /// All forces at a place, taken from the list and brought into the axes of its last segment.
    fn force_in(&mut self, place: usize, last: usize) -> Vector<Node> {
        let tree = self.mechanism.tree;
        let zero = self.program.number(0.0);
        let mut sums = vec![None; tree.turnings.len()];
        let keys: Vec<(usize, usize)> = self.forces.keys().filter(|(at, _)| *at == place).copied().collect();
        for key in keys {
            sums[key.1] = self.forces.remove(&key);
        }
        let join = |program: &mut Program, sum: &mut Option<Vector<Node>>, part| {
            *sum = Some(match *sum {
                Some(known) => add(program, known, part),
                None => part,
            });
        };
        for turning in (1..tree.turnings.len()).rev().filter(|&turning| !tree.carries(turning, last)) {
            if let Some(force) = sums[turning].take() {
                let below = self.mechanism.down_from(self.program, turning, force);
                join(self.program, &mut sums[tree.turnings[turning].parent], below);
            }
        }
        for turning in (1..=last).filter(|&turning| tree.carries(turning, last)) {
            if let Some(force) = sums[tree.turnings[turning].parent].take() {
                let above = self.mechanism.up_into(self.program, turning, force);
                join(self.program, &mut sums[turning], above);
            }
        }
        let force = sums[last].unwrap_or([zero; 3]);
        self.name(force, &format!("f{last}_p{place}"))
    }
}

impl<A: Arithmetic> Mechanism<'_, A> {
    /// A segment's vector at the current joint positions.
    pub fn offset(&self, program: &mut Program, segment: &crate::tree::Segment<A>) -> Vector<Node> {
        let mut offset = emit_vector(&self.context, program, &segment.constant);
        for (&joint, slope) in &segment.slides {
            let direction = emit_vector(&self.context, program, slope);
            let unit = crate::algebra::joint_unit(self.context.device, joint);
            let position = program.position(joint, unit);
            let along = scale(program, position, direction);
            offset = add(program, offset, along);
        }
        offset
    }
}

fn sum_negated(program: &mut Program, a: Node, b: Node) -> Node {
    let sum = program.add(a, b);
    program.negate(sum)
}

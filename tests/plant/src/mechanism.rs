//! Rigid-body dynamics of a tree of Denavit-Hartenberg frames, by virtual power.
//!
//! Every row of the frames table is four elementary motions, each along or about an axis of the frame it has reached.
//! Position, velocity and acceleration are carried through them in base coordinates, so that a frame may turn with
//! any expression of any joints. With the partial velocities `v_j = dv/d(dq_j)`, `w_j = dw/d(dq_j)` of each link
//! (Kane & Levinson, Dynamics, 1985):
//!
//! `tau_j = sum over links of v_j . m (a + g) + w_j . (I alpha + omega x I omega)`
//!
//! Nothing here is symbolic, nothing is differenced, and nothing is shared with the code that derives the kernels.

use dynid_model::{Convention, Device, Expression, Link, device::joint_variable};
use nalgebra::{Matrix3, Vector3};

use crate::jet::{self, Jet};

/// A device with numbers in it.
#[derive(Debug, Clone)]
pub struct Mechanism {
    n_joints: usize,
    convention: Convention,
    rows: Vec<Row>,
    bodies: Vec<Body>,
    /// Up, times the magnitude of gravity (m/s^2), in the base frame.
    gravity: Vector3<f64>,
    /// How a frame stands that no free joint moves, where that is known.
    still: Vec<Option<Sweep>>,
}

#[derive(Debug, Clone)]
struct Row {
    parent: Option<usize>,
    theta: Entry,
    d: Entry,
    a: Entry,
    alpha: Entry,
}

#[derive(Debug, Clone, Copy)]
enum Elementary {
    Turn,
    Shift,
}

impl Row {
    /// About and along which axes it goes, in order.
    fn motions(&self, convention: Convention) -> [(Elementary, usize, &Entry); 4] {
        use Elementary::{Shift, Turn};
        match convention {
            Convention::Standard => {
                [(Turn, Z, &self.theta), (Shift, Z, &self.d), (Shift, X, &self.a), (Turn, X, &self.alpha)]
            }
            Convention::Modified => {
                [(Turn, X, &self.alpha), (Shift, X, &self.a), (Turn, Z, &self.theta), (Shift, Z, &self.d)]
            }
        }
    }
}

/// An entry of the frames table, with lengths put in.
#[derive(Debug, Clone)]
enum Entry {
    Constant(f64),
    /// A constant, and factors of joint variables.
    Affine(f64, Vec<(usize, f64)>),
    Moving(Expression),
}

impl Entry {
    fn is_constant(&self) -> bool {
        matches!(self, Self::Constant(_))
    }

    /// Value, rate and acceleration while the `free` joints move at constant speeds.
    fn jet(&self, free: &[usize], q: &[f64], dq_free: &[f64]) -> Jet {
        let speed = |joint: usize| free.iter().position(|&own| own == joint).map_or(0.0, |slot| dq_free[slot]);
        match self {
            Self::Constant(value) => Jet::constant(*value),
            Self::Affine(constant, factors) => {
                let mut jet = Jet::constant(*constant);
                for &(joint, factor) in factors {
                    jet.value += factor * q[joint];
                    jet.rate += factor * speed(joint);
                }
                jet
            }
            Self::Moving(expression) => jet::evaluate(expression, &|name| {
                let joint = joint_variable(name).expect("lengths are already numbers, so only joints are left");
                Jet { value: q[joint], rate: speed(joint), acceleration: 0.0 }
            }),
        }
    }

    /// Tells the derivative by every free joint that the entry depends on.
    fn for_each_factor(&self, free: &[usize], q: &[f64], tell: &mut dyn FnMut(usize, f64)) {
        match self {
            Self::Constant(_) => {}
            Self::Affine(_, factors) => {
                for &(joint, factor) in factors {
                    if let Some(slot) = free.iter().position(|&own| own == joint) {
                        tell(slot, factor);
                    }
                }
            }
            Self::Moving(_) => {
                for slot in 0..free.len() {
                    tell(slot, self.jet(free, q, &unit(free.len(), slot)).rate);
                }
            }
        }
    }

    /// An expression of joint variables; affine where its derivatives are constant.
    fn of(expression: Expression, n_joints: usize) -> Self {
        if !moves(&expression) {
            return Self::Constant(jet::evaluate(&expression, &|_| Jet::default()).value);
        }
        let joints: Vec<usize> = (0..n_joints).collect();
        let factors_at = |entry: &Self, place: f64| -> Vec<f64> {
            let mut factors = vec![0.0; n_joints];
            // at different angles, or a difference of two would stand still
            let q: Vec<f64> = joints.iter().map(|&joint| place * (joint + 1) as f64).collect();
            entry.for_each_factor(&joints, &q, &mut |joint, factor| factors[joint] = factor);
            factors
        };
        let moving = Self::Moving(expression);
        let factors = factors_at(&moving, 0.0);
        if [0.7, -1.3].iter().any(|place| factors_at(&moving, *place) != factors) {
            return moving;
        }
        let constant = moving.jet(&[], &vec![0.0; n_joints], &[]).value;
        Self::Affine(constant, factors.into_iter().enumerate().filter(|(_, factor)| *factor != 0.0).collect())
    }
}

/// What of a frame's motion its bodies' dynamics need, in base coordinates.
#[derive(Debug, Clone, Copy)]
struct Sweep {
    rotation: Matrix3<f64>,
    /// Angular velocity (rad/s).
    spin: Vector3<f64>,
    /// Angular acceleration (rad/s^2).
    spin_rate: Vector3<f64>,
    /// Of the origin (m/s^2).
    acceleration: Vector3<f64>,
}

impl Sweep {
    fn at_rest() -> Self {
        let zero = Vector3::zeros();
        Self { rotation: Matrix3::identity(), spin: zero, spin_rate: zero, acceleration: zero }
    }

    /// Turns about an axis of its own, and tells which way that axis points.
    fn turn(&mut self, axis: usize, angle: Jet) -> Vector3<f64> {
        let direction = self.rotation.column(axis).into_owned();
        if angle == Jet::default() {
            return direction;
        }
        let (s, c) = angle.value.sin_cos();
        let (one, two) = if axis == X { (1, 2) } else { (0, 1) };
        let (first, second) = (self.rotation.column(one).into_owned(), self.rotation.column(two).into_owned());
        self.rotation.set_column(one, &(first * c + second * s));
        self.rotation.set_column(two, &(second * c - first * s));
        self.spin_rate += direction * angle.acceleration + self.spin.cross(&direction) * angle.rate;
        self.spin += direction * angle.rate;
        direction
    }

    /// Moves along an axis of its own, and tells which way that axis points and how far it went.
    fn shift(&mut self, axis: usize, distance: Jet) -> (Vector3<f64>, Vector3<f64>) {
        let direction = self.rotation.column(axis).into_owned();
        if distance == Jet::default() {
            return (direction, Vector3::zeros());
        }
        let offset = direction * distance.value;
        self.acceleration += self.spin_rate.cross(&offset)
            + self.spin.cross(&self.spin.cross(&offset))
            + direction * distance.acceleration
            + self.spin.cross(&direction) * (2.0 * distance.rate);
        (direction, offset)
    }
}

#[derive(Debug, Clone)]
struct Body {
    frame: usize,
    /// kg
    mass: f64,
    /// Centroid in the frame's axes (m).
    centroid: Vector3<f64>,
    /// About the centroid, in the frame's axes (kg m^2).
    inertia: Matrix3<f64>,
}

/// How a frame stands and moves, in base coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Turns coordinates of the frame into coordinates of the base.
    pub rotation: Matrix3<f64>,
    /// Of the frame's origin (m).
    pub position: Vector3<f64>,
    /// Of the frame's origin (m/s).
    pub velocity: Vector3<f64>,
    /// rad/s
    pub angular_velocity: Vector3<f64>,
    /// Of the frame's origin (m/s^2), without gravity.
    pub acceleration: Vector3<f64>,
    /// rad/s^2
    pub angular_acceleration: Vector3<f64>,
}

impl Motion {
    /// The base: at the origin, at rest.
    pub fn at_rest() -> Self {
        Self {
            rotation: Matrix3::identity(),
            position: Vector3::zeros(),
            velocity: Vector3::zeros(),
            angular_velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            angular_acceleration: Vector3::zeros(),
        }
    }

    /// Turned about its own axis by `angle`.
    fn turned(self, axis: usize, angle: Jet) -> Self {
        let direction = self.rotation.column(axis).into_owned();
        Self {
            rotation: self.rotation * elementary_rotation(axis, angle.value),
            angular_velocity: self.angular_velocity + direction * angle.rate,
            angular_acceleration: self.angular_acceleration
                + direction * angle.acceleration
                + self.angular_velocity.cross(&direction) * angle.rate,
            ..self
        }
    }

    /// Moved along its own axis by `distance`.
    fn moved(self, axis: usize, distance: Jet) -> Self {
        let direction = self.rotation.column(axis).into_owned();
        let mut moved = self.at(direction * distance.value);
        moved.velocity += direction * distance.rate;
        moved.acceleration +=
            direction * distance.acceleration + self.angular_velocity.cross(&direction) * (2.0 * distance.rate);
        moved
    }

    /// The same body at another of its points, `offset` (m) away in base coordinates.
    fn at(self, offset: Vector3<f64>) -> Self {
        let swept = self.angular_velocity.cross(&offset);
        Self {
            position: self.position + offset,
            velocity: self.velocity + swept,
            acceleration: self.acceleration
                + self.angular_acceleration.cross(&offset)
                + self.angular_velocity.cross(&swept),
            ..self
        }
    }
}

impl Mechanism {
    /// Puts numbers into `device`: `parameters` is asked for `link.*`, `length.*` and `base.*` by name.
    pub fn new(device: &Device, parameters: &dyn Fn(&str) -> f64) -> Self {
        let n_joints = device.joints.len();
        let entry = |expression: &Expression| Entry::of(with_lengths(expression, parameters), n_joints);
        let rows = device
            .frames
            .iter()
            .map(|frame| Row {
                parent: frame.parent,
                theta: entry(&frame.theta),
                d: entry(&frame.d),
                a: entry(&frame.a),
                alpha: entry(&frame.alpha),
            })
            .collect();
        let bodies = device
            .links
            .iter()
            .enumerate()
            .map(|(index, link)| {
                let [m, x, y, z, ixx, ixy, ixz, iyy, iyz, izz] =
                    Link::SYMBOLS.map(|symbol| parameters(&format!("link.{}.{symbol}", index + 1)));
                Body {
                    frame: link.frame,
                    mass: m,
                    centroid: Vector3::new(x, y, z),
                    inertia: Matrix3::new(ixx, ixy, ixz, ixy, iyy, iyz, ixz, iyz, izz),
                }
            })
            .collect();
        let component = |axis: usize, name: &str| if device.up[axis] == 0.0 { 0.0 } else { parameters(name) };
        let gravity = Vector3::new(component(0, "base.gx"), component(1, "base.gy"), component(2, "base.gz"));
        let still = vec![None; device.frames.len()];
        Self { n_joints, convention: device.convention, rows, bodies, gravity, still }
    }

    /// The same device with all but the `free` joints held at `q`: frames that then stand still are computed once.
    #[must_use]
    pub fn holding(&self, free: &[usize], q: &[f64]) -> Self {
        let mut holding = self.clone();
        let held = |entry: &mut Entry| {
            if let Entry::Affine(constant, factors) = entry {
                let is_free = |&&(joint, _): &&(usize, f64)| free.contains(&joint);
                *constant += factors.iter().filter(|of| !is_free(of)).map(|(joint, by)| by * q[*joint]).sum::<f64>();
                factors.retain(|of| is_free(&of));
                if factors.is_empty() {
                    *entry = Entry::Constant(*constant);
                }
            }
        };
        for row in &mut holding.rows {
            for entry in [&mut row.theta, &mut row.d, &mut row.a, &mut row.alpha] {
                held(entry);
            }
        }
        for index in 0..holding.rows.len() {
            let row = &holding.rows[index];
            let from = row.parent.map_or_else(|| Some(Sweep::at_rest()), |parent| holding.still[parent]);
            let motions = row.motions(self.convention);
            if let (Some(mut sweep), true) = (from, motions.iter().all(|(_, _, entry)| entry.is_constant())) {
                for (elementary, axis, entry) in motions {
                    let jet = entry.jet(&[], q, &[]);
                    match elementary {
                        Elementary::Turn => sweep.turn(axis, jet),
                        Elementary::Shift => sweep.shift(axis, jet).0,
                    };
                }
                holding.still[index] = Some(sweep);
            }
        }
        holding
    }

    /// Number of joint variables.
    pub fn n_joints(&self) -> usize {
        self.n_joints
    }

    /// How every frame moves, in the order of the device's frames.
    pub fn motions(&self, q: &[f64], dq: &[f64], ddq: &[f64]) -> Vec<Motion> {
        for slice in [q, dq, ddq] {
            assert_eq!(slice.len(), self.n_joints, "a state has one entry per joint of the device");
        }
        let symbol = |name: &str| {
            let joint = joint_variable(name).expect("lengths are already numbers, so only joints are left");
            Jet { value: q[joint], rate: dq[joint], acceleration: ddq[joint] }
        };
        let value = |entry: &Entry| match entry {
            Entry::Constant(value) => Jet::constant(*value),
            Entry::Affine(constant, factors) => {
                factors.iter().fold(Jet::constant(*constant), |sum, &(joint, factor)| Jet {
                    value: sum.value + factor * q[joint],
                    rate: sum.rate + factor * dq[joint],
                    acceleration: sum.acceleration + factor * ddq[joint],
                })
            }
            Entry::Moving(expression) => jet::evaluate(expression, &symbol),
        };
        let mut motions: Vec<Motion> = Vec::with_capacity(self.rows.len());
        for row in &self.rows {
            let parent = row.parent.map_or_else(Motion::at_rest, |parent| motions[parent]);
            let [theta, d, a, alpha] = [&row.theta, &row.d, &row.a, &row.alpha].map(value);
            motions.push(match self.convention {
                Convention::Standard => parent.turned(Z, theta).moved(Z, d).moved(X, a).turned(X, alpha),
                Convention::Modified => parent.turned(X, alpha).moved(X, a).turned(Z, theta).moved(Z, d),
            });
        }
        motions
    }

    /// Torque (or force) at every joint for a motion: `D ddq + C dq + phi`.
    pub fn inverse_dynamics(&self, q: &[f64], dq: &[f64], ddq: &[f64]) -> Vec<f64> {
        let joints: Vec<usize> = (0..self.n_joints).collect();
        self.torque(&joints, &self.partial_velocities(&joints, q), q, dq, ddq, self.gravity)
    }

    /// `C dq + phi` at every joint.
    pub fn bias(&self, q: &[f64], dq: &[f64]) -> Vec<f64> {
        self.inverse_dynamics(q, dq, &vec![0.0; self.n_joints])
    }

    /// `phi`: torque that holds every joint against gravity.
    pub fn gravity(&self, q: &[f64]) -> Vec<f64> {
        self.bias(q, &vec![0.0; self.n_joints])
    }

    /// `D`, row-major, `n_joints x n_joints`: thesis Eq. 3.2 with the partial velocities as Jacobian columns.
    pub fn inertia(&self, q: &[f64]) -> Vec<f64> {
        let joints: Vec<usize> = (0..self.n_joints).collect();
        self.inertia_of(&joints, &self.partial_velocities(&joints, q), q)
    }

    /// `C` by Christoffel symbols (thesis Eq. 3.3), row-major.
    ///
    /// `C dq` is a quadratic form in `dq` whose coefficients are those symbols, `h_k = sum c_ijk dq_i dq_j` with
    /// `c_ijk = c_jik`. So they follow from it by polarisation, `2 c_ijk = h_k(e_i + e_j) - h_k(e_i) - h_k(e_j)`,
    /// without a difference quotient.
    pub fn coriolis(&self, q: &[f64], dq: &[f64]) -> Vec<f64> {
        let n = self.n_joints;
        let joints: Vec<usize> = (0..n).collect();
        let partial = self.partial_velocities(&joints, q);
        let rest = vec![0.0; n];
        let centrifugal = |speed: &[f64]| self.torque(&joints, &partial, q, speed, &rest, Vector3::zeros());
        let alone: Vec<Vec<f64>> = (0..n).map(|joint| centrifugal(&unit(n, joint))).collect();
        let mut coriolis = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..n {
                let mut both = unit(n, i);
                both[j] += 1.0;
                let together = centrifugal(&both);
                for k in 0..n {
                    let symbol = 0.5 * (together[k] - alone[i][k] - alone[j][k]);
                    coriolis[k * n + j] += symbol * dq[i];
                }
            }
        }
        coriolis
    }

    /// Kinetic energy and potential `V = g up . sum(m p)` (J) (thesis Eq. B.4).
    pub fn energy(&self, q: &[f64], dq: &[f64]) -> [f64; 2] {
        let motions = self.motions(q, dq, &vec![0.0; self.n_joints]);
        let mut energy = [0.0; 2];
        for body in &self.bodies {
            let frame = motions[body.frame];
            let centroid = frame.at(frame.rotation * body.centroid);
            let spin = frame.rotation.transpose() * frame.angular_velocity;
            energy[0] += 0.5 * body.mass * centroid.velocity.norm_squared() + 0.5 * spin.dot(&(body.inertia * spin));
            energy[1] += body.mass * self.gravity.dot(&centroid.position);
        }
        energy
    }

    /// `D` and `C dq + phi` of the `free` joints while all others stand still; `q` is every joint's.
    ///
    /// The same sums as [`Mechanism::inertia`] and [`Mechanism::bias`], in one sweep over the frames: a played run asks for
    /// them a million times.
    pub fn inertia_and_bias(&self, free: &[usize], q: &[f64], dq_free: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let n = free.len();
        let mut sweeps: Vec<Sweep> = Vec::with_capacity(self.rows.len());
        // velocity of the origin and angular velocity of each frame when only one joint moves, at unit speed
        let mut partial = vec![(Vector3::zeros(), Vector3::zeros()); n * self.rows.len()];
        for (index, row) in self.rows.iter().enumerate() {
            if let Some(still) = self.still[index] {
                sweeps.push(still);
                continue;
            }
            let mut sweep = row.parent.map_or_else(Sweep::at_rest, |parent| sweeps[parent]);
            let (before, after) = partial.split_at_mut(n * index);
            let of_frame = &mut after[..n];
            if let Some(parent) = row.parent {
                of_frame.copy_from_slice(&before[n * parent..n * (parent + 1)]);
            }
            for (elementary, axis, entry) in row.motions(self.convention) {
                let jet = entry.jet(free, q, dq_free);
                match elementary {
                    Elementary::Turn => {
                        let direction = sweep.turn(axis, jet);
                        entry.for_each_factor(free, q, &mut |slot, factor| of_frame[slot].1 += direction * factor);
                    }
                    Elementary::Shift => {
                        let (direction, offset) = sweep.shift(axis, jet);
                        for (velocity, angular_velocity) in of_frame.iter_mut() {
                            *velocity += angular_velocity.cross(&offset);
                        }
                        entry.for_each_factor(free, q, &mut |slot, factor| of_frame[slot].0 += direction * factor);
                    }
                }
            }
            sweeps.push(sweep);
        }
        let (mut inertia, mut bias) = (vec![0.0; n * n], vec![0.0; n]);
        let mut of_body = vec![(Vector3::zeros(), Vector3::zeros(), Vector3::zeros()); n];
        for body in &self.bodies {
            let of_frame = &partial[n * body.frame..n * (body.frame + 1)];
            if of_frame.iter().all(|(velocity, angular)| *velocity == Vector3::zeros() && *angular == Vector3::zeros())
            {
                continue;
            }
            let sweep = &sweeps[body.frame];
            let arm = sweep.rotation * body.centroid;
            let spin = sweep.spin;
            let acceleration = sweep.acceleration + sweep.spin_rate.cross(&arm) + spin.cross(&spin.cross(&arm));
            let force = (acceleration + self.gravity) * body.mass;
            // turning is counted in the body's own axes, where its inertia stands still
            let (own_spin, own_rate) = (sweep.rotation.tr_mul(&spin), sweep.rotation.tr_mul(&sweep.spin_rate));
            let moment = body.inertia * own_rate + own_spin.cross(&(body.inertia * own_spin));
            for (of_joint, (velocity, angular)) in of_body.iter_mut().zip(of_frame) {
                let own = sweep.rotation.tr_mul(angular);
                *of_joint = (velocity + angular.cross(&arm), own, body.inertia * own);
            }
            for row in 0..n {
                let (velocity, own, _) = of_body[row];
                bias[row] += velocity.dot(&force) + own.dot(&moment);
                for column in 0..=row {
                    inertia[row * n + column] +=
                        body.mass * velocity.dot(&of_body[column].0) + own.dot(&of_body[column].2);
                }
            }
        }
        for row in 0..n {
            for column in 0..row {
                inertia[column * n + row] = inertia[row * n + column];
            }
        }
        (inertia, bias)
    }

    /// Per given joint, per body: velocity of the centroid and angular velocity when only that joint moves, at unit
    /// speed.
    fn partial_velocities(&self, joints: &[usize], q: &[f64]) -> Vec<Vec<(Vector3<f64>, Vector3<f64>)>> {
        let rest = vec![0.0; self.n_joints];
        joints
            .iter()
            .map(|&joint| {
                let motions = self.motions(q, &unit(self.n_joints, joint), &rest);
                let of = |body: &Body| {
                    let frame = motions[body.frame];
                    (frame.at(frame.rotation * body.centroid).velocity, frame.angular_velocity)
                };
                self.bodies.iter().map(of).collect()
            })
            .collect()
    }

    fn torque(
        &self,
        joints: &[usize],
        partial: &[Vec<(Vector3<f64>, Vector3<f64>)>],
        q: &[f64],
        dq: &[f64],
        ddq: &[f64],
        gravity: Vector3<f64>,
    ) -> Vec<f64> {
        let motions = self.motions(q, dq, ddq);
        let mut torque = vec![0.0; joints.len()];
        for (index, body) in self.bodies.iter().enumerate() {
            let frame = motions[body.frame];
            let centroid = frame.at(frame.rotation * body.centroid);
            let force = body.mass * (centroid.acceleration + gravity);
            let inertia = frame.rotation * body.inertia * frame.rotation.transpose();
            let spin = frame.angular_velocity;
            let moment = inertia * frame.angular_acceleration + spin.cross(&(inertia * spin));
            for (slot, of_joint) in partial.iter().enumerate() {
                let (velocity, angular_velocity) = of_joint[index];
                torque[slot] += velocity.dot(&force) + angular_velocity.dot(&moment);
            }
        }
        torque
    }

    fn inertia_of(&self, joints: &[usize], partial: &[Vec<(Vector3<f64>, Vector3<f64>)>], q: &[f64]) -> Vec<f64> {
        let rest = vec![0.0; self.n_joints];
        let motions = self.motions(q, &rest, &rest);
        let n = joints.len();
        let mut inertia = vec![0.0; n * n];
        for (index, body) in self.bodies.iter().enumerate() {
            let rotation = motions[body.frame].rotation;
            let turned = rotation * body.inertia * rotation.transpose();
            for row in 0..n {
                for column in 0..=row {
                    let (v_row, w_row) = partial[row][index];
                    let (v_column, w_column) = partial[column][index];
                    let entry = body.mass * v_row.dot(&v_column) + w_row.dot(&(turned * w_column));
                    inertia[row * n + column] += entry;
                    if row != column {
                        inertia[column * n + row] += entry;
                    }
                }
            }
        }
        inertia
    }
}

const X: usize = 0;
const Z: usize = 2;

fn elementary_rotation(axis: usize, angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    match axis {
        X => Matrix3::new(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c),
        _ => Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0),
    }
}

fn unit(n: usize, index: usize) -> Vec<f64> {
    let mut unit = vec![0.0; n];
    unit[index] = 1.0;
    unit
}

fn with_lengths(expression: &Expression, parameters: &dyn Fn(&str) -> f64) -> Expression {
    let inner = |part: &Expression| with_lengths(part, parameters);
    match expression {
        Expression::Symbol(name) if joint_variable(name).is_none() => {
            Expression::Number(parameters(&format!("length.{name}")))
        }
        Expression::Number(_) | Expression::Symbol(_) => expression.clone(),
        Expression::Negate(part) => Expression::Negate(Box::new(inner(part))),
        Expression::Binary(operator, left, right) => {
            Expression::Binary(*operator, Box::new(inner(left)), Box::new(inner(right)))
        }
        Expression::Call(function, arguments) => Expression::Call(*function, arguments.iter().map(inner).collect()),
        Expression::IfElse(comparison, parts) => {
            Expression::IfElse(*comparison, Box::new([0, 1, 2, 3].map(|part: usize| inner(&parts[part]))))
        }
    }
}

fn moves(expression: &Expression) -> bool {
    match expression {
        Expression::Number(_) => false,
        Expression::Symbol(name) => joint_variable(name).is_some(),
        Expression::Negate(part) => moves(part),
        Expression::Binary(_, left, right) => moves(left) || moves(right),
        Expression::Call(_, arguments) => arguments.iter().any(moves),
        Expression::IfElse(_, parts) => parts.iter().any(moves),
    }
}

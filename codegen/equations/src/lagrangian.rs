//! The definition of the equations of motion: Lagrange's, as in the thesis (Section 3.2, Appendices B and C).
//!
//! `D = sum over links of m Jv^T Jv + Jw^T R I R^T Jw` (Eq. 3.2), C by Christoffel symbols of D (Eq. 3.3) and
//! `phi = dV/dq` with `V = sum of m g . p` (Eq. 3.4), all joints moving. It shares only the symbols with the
//! recursion: it knows nothing of turnings, places or regrouped parameters.

use std::collections::BTreeMap;

use dynid_model::{Convention, Device};

use crate::{
    DeriveError,
    algebra::{Algebra, AngleSum, Polynomial, angle_sum},
    arithmetic::Arithmetic,
    spatial::{Axis, Matrix, Vector, identity, product, rotation},
};

/// Lagrange's equations with all joints free; those of a configuration are the rows and columns of its free joints.
pub struct Lagrangian<A: Arithmetic> {
    /// Inertia matrix: (i, j), i <= j; what vanishes is missing [kg m^2].
    pub inertia: BTreeMap<(usize, usize), Polynomial<A>>,
    /// Potential energy (J).
    pub potential: Polynomial<A>,
}

/// A frame in base axes, and how it turns with each joint.
#[derive(Clone)]
struct Pose<A: Arithmetic> {
    rotation: Matrix<Polynomial<A>>,
    position: Vector<Polynomial<A>>,
    /// Column of Jw by joint, in the frame's own axes.
    turns: BTreeMap<usize, Vector<Polynomial<A>>>,
}

impl<A: Arithmetic> Lagrangian<A> {
    /// Forms D and V.
    ///
    /// # Errors
    /// A row of the frames table with an angle or a length that is no polynomial.
    pub fn new(algebra: &Algebra<A>, device: &Device) -> Result<Lagrangian<A>, DeriveError> {
        let zero = || algebra.zero();
        let origin = Pose { rotation: identity(algebra), position: [zero(), zero(), zero()], turns: BTreeMap::new() };
        let mut poses: Vec<Pose<A>> = Vec::new();
        for frame in &device.frames {
            let problem = |what: String| DeriveError::frame(device, frame, what);
            let mut pose = frame.parent.map_or(&origin, |parent| &poses[parent]).clone();
            let theta = angle_sum(&frame.theta).map_err(problem)?;
            let alpha = angle_sum(&frame.alpha).map_err(problem)?;
            let d = algebra.length(&frame.d).map_err(problem)?;
            let a = algebra.length(&frame.a).map_err(problem)?;
            match device.convention {
                Convention::Standard => {
                    pose.turn(algebra, Axis::Z, &theta);
                    pose.shift(algebra, Axis::Z, &d);
                    pose.shift(algebra, Axis::X, &a);
                    pose.turn(algebra, Axis::X, &alpha);
                }
                Convention::Modified => {
                    pose.turn(algebra, Axis::X, &alpha);
                    pose.shift(algebra, Axis::X, &a);
                    pose.turn(algebra, Axis::Z, &theta);
                    pose.shift(algebra, Axis::Z, &d);
                }
            }
            poses.push(pose);
        }
        let mut lagrangian = Lagrangian { inertia: BTreeMap::new(), potential: algebra.zero() };
        for (link, number) in device.links.iter().zip(1..) {
            lagrangian.add_link(algebra, device.joints.len(), number, &poses[link.frame]);
        }
        lagrangian.inertia.retain(|_, entry| !entry.is_zero());
        Ok(lagrangian)
    }

    fn add_link(&mut self, algebra: &Algebra<A>, n_joints: usize, link: usize, pose: &Pose<A>) {
        let parameter = |symbol: &str| algebra.parameter(&format!("link.{link}.{symbol}"));
        let mass = parameter("m");
        // The centroid is at p + x Rx + y Ry + z Rz.
        let weights = [algebra.integer(1), parameter("x"), parameter("y"), parameter("z")];
        let axis = |k: usize| [0, 1, 2].map(|row| pose.rotation[row][k].clone());
        let vectors = [pose.position.clone(), axis(0), axis(1), axis(2)];

        let gravity = ["base.gx", "base.gy", "base.gz"].map(|name| algebra.parameter(name));
        for (weight, vector) in weights.iter().zip(&vectors) {
            let height = algebra.dot(gravity.iter().zip(vector));
            self.potential = &self.potential + &(&(&mass * weight) * &height);
        }

        let inertia = {
            let [xx, xy, xz, yy, yz, zz] = ["Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"].map(parameter);
            [[xx, xy.clone(), xz.clone()], [xy, yy, yz.clone()], [xz, yz, zz]]
        };
        let derivatives: Vec<[Vector<Polynomial<A>>; 4]> = (0..n_joints)
            .map(|joint| vectors.clone().map(|vector| vector.map(|component| algebra.derivative(&component, joint))))
            .collect();
        for i in 0..n_joints {
            for j in i..n_joints {
                let mut sum = algebra.zero();
                for (weight_i, vector_i) in weights.iter().zip(&derivatives[i]) {
                    for (weight_j, vector_j) in weights.iter().zip(&derivatives[j]) {
                        let product = algebra.dot(vector_i.iter().zip(vector_j));
                        if !product.is_zero() {
                            sum = &sum + &(&(&mass * &(weight_i * weight_j)) * &product);
                        }
                    }
                }
                if let (Some(turn_i), Some(turn_j)) = (pose.turns.get(&i), pose.turns.get(&j)) {
                    for row in 0..3 {
                        for column in 0..3 {
                            let product = algebra.product(&turn_i[row], &turn_j[column]);
                            sum = &sum + &(&inertia[row][column] * &product);
                        }
                    }
                }
                let entry = self.inertia.entry((i, j)).or_insert_with(|| algebra.zero());
                *entry = &*entry + &sum;
            }
        }
    }

    /// `D[i][j]`, either order.
    pub fn inertia_entry(&self, algebra: &Algebra<A>, i: usize, j: usize) -> Polynomial<A> {
        self.inertia.get(&(i.min(j), i.max(j))).cloned().unwrap_or_else(|| algebra.zero())
    }

    /// `phi[k] = dV/dq[k]` (Eq. 3.4).
    pub fn gravity(&self, algebra: &Algebra<A>, joint: usize) -> Polynomial<A> {
        algebra.derivative(&self.potential, joint)
    }

    /// The Christoffel symbol `c[i][j][k]` of Eq. 3.3 (B.9): `C[k][j] = sum over i of c[i][j][k] dq[i]`.
    pub fn christoffel(&self, algebra: &Algebra<A>, i: usize, j: usize, k: usize) -> Polynomial<A> {
        let derivative = |row, column, by| algebra.derivative(&self.inertia_entry(algebra, row, column), by);
        let sum = &(&derivative(k, j, i) + &derivative(k, i, j)) - &derivative(i, j, k);
        &algebra.fraction(1, 2) * &sum
    }
}

impl<A: Arithmetic> Pose<A> {
    fn turn(&mut self, algebra: &Algebra<A>, axis: Axis, angle: &AngleSum) {
        let turn = rotation(algebra, axis, &algebra.cos_sin(angle));
        self.rotation = product(algebra, &self.rotation, &turn);
        for column in self.turns.values_mut() {
            *column = [0, 1, 2].map(|row| algebra.dot((0..3).map(|k| (&turn[k][row], &column[k]))));
        }
        for (&joint, &factor) in &angle.factors {
            let column = self.turns.entry(joint).or_insert_with(|| [(); 3].map(|()| algebra.zero()));
            column[axis.index()] = &column[axis.index()] + &algebra.number(factor);
        }
    }

    fn shift(&mut self, algebra: &Algebra<A>, axis: Axis, amount: &Polynomial<A>) {
        self.position =
            [0, 1, 2].map(|row| &self.position[row] + &algebra.product(&self.rotation[row][axis.index()], amount));
    }
}

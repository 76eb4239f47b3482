//! Which inertial parameters a body can have, and how to stay among them.
//!
//! A link's ten numbers are physical when a mass distribution has them: `m > 0` and `S = trace(I)/2 1 - I`, the second
//! moment about the centroid, positive semi-definite. That is the pseudo-inertia's positive semi-definiteness (Wensing,
//! Kim & Slotine 2018, IEEE Robotics and Automation Letters 3(1), 60-67): its Schur complement with respect to the mass
//! is `S`. In mass, centroid and inertia about the centroid both conditions are convex, and so are bounds on each number.
//!
//! Torques are linear in the *standard* parameters about the frame's origin, `pi = (m, m c, J)`, with
//! `J = I + m (c.c 1 - c c^T)`. Entries of I and J stand in the order xx, xy, xz, yy, yz, zz.

use nalgebra::{Matrix3, Matrix4};

/// Row and column of each of the six entries of a symmetric 3x3 matrix.
pub(crate) const ENTRIES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// Standard parameters `(m, m x, m y, m z, Jxx, Jxy, Jxz, Jyy, Jyz, Jzz)` of a body that has the given mass, centroid
/// and inertia about the centroid (order of `Link::SYMBOLS` of `dynid-model`).
pub fn standard(inertial: &[f64; 10]) -> [f64; 10] {
    let [m, x, y, z, xx, xy, xz, yy, yz, zz] = *inertial;
    [
        m,
        m * x,
        m * y,
        m * z,
        xx + m * (y * y + z * z),
        xy - m * x * y,
        xz - m * x * z,
        yy + m * (x * x + z * z),
        yz - m * y * z,
        zz + m * (x * x + y * y),
    ]
}

/// The inverse of [`standard`]: mass, centroid and inertia about the centroid. Not finite for a body without mass.
pub fn inertial(standard: &[f64; 10]) -> [f64; 10] {
    let [m, mx, my, mz, xx, xy, xz, yy, yz, zz] = *standard;
    let [x, y, z] = [mx / m, my / m, mz / m];
    [
        m,
        x,
        y,
        z,
        xx - my * y - mz * z,
        xy + mx * y,
        xz + mx * z,
        yy - mx * x - mz * z,
        yz + my * z,
        zz - mx * x - my * y,
    ]
}

/// Derivative of [`standard`]: entry `[row][column]` is that of standard parameter `row` by inertial parameter
/// `column`.
pub fn standard_jacobian(inertial: &[f64; 10]) -> [[f64; 10]; 10] {
    let [m, x, y, z, ..] = *inertial;
    let mut jacobian = [[0.0; 10]; 10];
    (0..10).for_each(|index| jacobian[index][index] = 1.0);
    for (axis, centroid) in [x, y, z].into_iter().enumerate() {
        jacobian[1 + axis][0] = centroid;
        jacobian[1 + axis][1 + axis] = m;
    }
    let by_mass = [y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y];
    let by_centroid = [
        [0.0, 2.0 * m * y, 2.0 * m * z],
        [-m * y, -m * x, 0.0],
        [-m * z, 0.0, -m * x],
        [2.0 * m * x, 0.0, 2.0 * m * z],
        [0.0, -m * z, -m * y],
        [2.0 * m * x, 2.0 * m * y, 0.0],
    ];
    for entry in 0..6 {
        jacobian[4 + entry][0] = by_mass[entry];
        jacobian[4 + entry][1..4].copy_from_slice(&by_centroid[entry]);
    }
    jacobian
}

/// The pseudo-inertia `[[Sigma, m c], [m c^T, m]]` with `Sigma = trace(J)/2 1 - J` about the frame's origin.
/// Positive semi-definite exactly when a mass distribution has these parameters.
pub fn pseudo_inertia(inertial: &[f64; 10]) -> Matrix4<f64> {
    let [m, mx, my, mz, xx, xy, xz, yy, yz, zz] = standard(inertial);
    let half = 0.5 * (xx + yy + zz);
    Matrix4::new(half - xx, -xy, -xz, mx, -xy, half - yy, -yz, my, -xz, -yz, half - zz, mz, mx, my, mz, m)
}

/// The symmetric matrix of six entries.
pub(crate) fn symmetric(entries: &[f64; 6]) -> Matrix3<f64> {
    let [xx, xy, xz, yy, yz, zz] = *entries;
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

/// `S = trace(I)/2 1 - I`, the second moment about the centroid.
pub(crate) fn second_moment(inertia: &[f64; 6]) -> Matrix3<f64> {
    let inertia = symmetric(inertia);
    Matrix3::identity() * (0.5 * inertia.trace()) - inertia
}

/// `-log det` of the pseudo-inertia with its first and second derivatives by the standard parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyBarrier {
    pub(crate) value: f64,
    pub(crate) gradient: [f64; 10],
    pub(crate) hessian: [[f64; 10]; 10],
}

/// `-log det P = -log m - log det S` alone; `None` where P is not positive definite.
pub fn body_barrier_value(inertial: &[f64; 10]) -> Option<f64> {
    // The factors of the Schur complement are well scaled where P itself may not be.
    let factor = second_moment(&std::array::from_fn(|entry| inertial[4 + entry])).cholesky()?;
    let value = -2.0 * factor.l_dirty().diagonal().iter().map(|entry| entry.ln()).sum::<f64>() - inertial[0].ln();
    (inertial[0] > 0.0 && value.is_finite()).then_some(value)
}

/// The barrier of a body; `None` where its pseudo-inertia is not positive definite.
pub fn body_barrier(inertial: &[f64; 10]) -> Option<BodyBarrier> {
    let value = body_barrier_value(inertial)?;
    let inverse = pseudo_inertia(inertial).cholesky()?.inverse();
    // d(-log det P)/dpi_k = -tr(P^-1 P_k); second derivative tr(P^-1 P_k P^-1 P_l), P being linear in pi.
    let products: [Matrix4<f64>; 10] = std::array::from_fn(|index| inverse * pseudo_inertia_by(index));
    let gradient = std::array::from_fn(|index| -products[index].trace());
    let hessian = std::array::from_fn(|row| std::array::from_fn(|column| (products[row] * products[column]).trace()));
    Some(BodyBarrier { value, gradient, hessian })
}

/// Derivative of the pseudo-inertia by one standard parameter.
fn pseudo_inertia_by(index: usize) -> Matrix4<f64> {
    let mut matrix = Matrix4::zeros();
    match index {
        0 => matrix[(3, 3)] = 1.0,
        1..=3 => {
            matrix[(index - 1, 3)] = 1.0;
            matrix[(3, index - 1)] = 1.0;
        }
        _ => {
            let (row, column) = ENTRIES[index - 4];
            if row == column {
                (0..3).for_each(|axis| matrix[(axis, axis)] = 0.5);
                matrix[(row, row)] -= 1.0;
            } else {
                matrix[(row, column)] = -1.0;
                matrix[(column, row)] = -1.0;
            }
        }
    }
    matrix
}

/// The inertia nearest to `inertia` for which every eigenvalue of S is at least `least`.
pub fn inside(inertia: &[f64; 6], least: f64) -> [f64; 6] {
    let mut eigen = second_moment(inertia).symmetric_eigen();
    if eigen.eigenvalues.iter().all(|value| *value >= least) {
        return *inertia;
    }
    eigen.eigenvalues.iter_mut().for_each(|value| *value = value.max(least));
    let moment = eigen.recompose();
    // I = trace(S) 1 - S
    let trace = moment.trace();
    std::array::from_fn(|entry| {
        let (row, column) = ENTRIES[entry];
        let symmetric = 0.5 * (moment[(row, column)] + moment[(column, row)]);
        if row == column { trace - symmetric } else { -symmetric }
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The ten parameters of point masses `[x, y, z, m]`: a body by construction.
    fn of_points(points: &[[f64; 4]]) -> [f64; 10] {
        let m: f64 = points.iter().map(|point| point[3]).sum();
        let c: [f64; 3] = std::array::from_fn(|axis| points.iter().map(|p| p[3] * p[axis]).sum::<f64>() / m);
        let mut moment = Matrix3::zeros();
        for point in points {
            let r = nalgebra::Vector3::from_fn(|axis, _| point[axis] - c[axis]);
            moment += point[3] * r * r.transpose();
        }
        let trace = moment.trace();
        let inertia = Matrix3::from_diagonal_element(trace) - moment;
        let [xx, xy, xz, yy, yz, zz] = ENTRIES.map(|place| inertia[place]);
        [m, c[0], c[1], c[2], xx, xy, xz, yy, yz, zz]
    }

    fn points(number: std::ops::Range<usize>) -> impl Strategy<Value = Vec<[f64; 4]>> {
        prop::collection::vec([-1.0..1.0f64, -1.0..1.0, -1.0..1.0, 0.1..2.0], number)
    }

    /// Masses near the corners of an octahedron, stretched along its axes and moved: nowhere near a plane, of which the
    /// moment would be singular.
    fn body_in_general_position() -> impl Strategy<Value = Vec<[f64; 4]>> {
        let near = [-0.2..0.2f64, -0.2..0.2, -0.2..0.2, 0.1..2.0];
        let corners = prop::collection::vec(near, 6);
        (corners, prop::array::uniform3(0.2..1.0f64), prop::array::uniform3(-1.0..1.0f64)).prop_map(
            |(mut points, stretch, centre)| {
                for (corner, point) in points.iter_mut().enumerate() {
                    point[corner / 2] += if corner % 2 == 0 { 1.0 } else { -1.0 };
                    (0..3).for_each(|axis| point[axis] = centre[axis] + stretch[axis] * point[axis]);
                }
                points
            },
        )
    }

    proptest! {
        /// Second moments of point masses about the origin, summed directly.
        #[test]
        fn pseudo_inertia_is_the_second_moment_of_the_masses(points in points(1..6)) {
            let matrix = pseudo_inertia(&of_points(&points));
            let mut expected = Matrix4::zeros();
            for [x, y, z, m] in points {
                let r = nalgebra::Vector4::new(x, y, z, 1.0);
                expected += m * r * r.transpose();
            }
            prop_assert!((matrix - expected).abs().max() < 1e-12);
        }

        #[test]
        fn standard_parameters_lead_back(points in points(1..6)) {
            let body = of_points(&points);
            for (there, back) in body.iter().zip(inertial(&standard(&body))) {
                prop_assert!((there - back).abs() < 1e-13);
            }
        }

        #[test]
        fn standard_jacobian_agrees_with_differences(inertial in prop::array::uniform10(-1.0..1.0f64)) {
            let jacobian = standard_jacobian(&inertial);
            let step = 1e-6;
            for column in 0..10 {
                let (mut low, mut high) = (inertial, inertial);
                low[column] -= step;
                high[column] += step;
                let (low, high) = (standard(&low), standard(&high));
                for row in 0..10 {
                    let difference = (high[row] - low[row]) / (2.0 * step);
                    prop_assert!((jacobian[row][column] - difference).abs() < 1e-8);
                }
            }
        }

        /// Along straight lines of the standard parameters.
        ///
        /// `-log det` is self-concordant: along a line on which its second derivative is h, the third and fourth are at
        /// most `2 h^(3/2)` and `6 h^2`. So with a step of `s / sqrt(h)` the differences are off by `s^2 / 3` and `s^2`
        /// in units of `sqrt(h)` for the gradient and the like for the Hessian, however near the boundary is. Rounding
        /// adds the condition number of P times 1e-16 over s: some 1e-8 for these bodies.
        #[test]
        fn barrier_derivatives_agree_with_differences(points in body_in_general_position()) {
            const STEP: f64 = 1e-4;
            const TOLERANCE: f64 = 1e-6;
            let body = of_points(&points);
            let barrier = body_barrier(&body).expect("points in general position have a definite moment");
            for column in 0..10 {
                let unit = barrier.hessian[column][column].sqrt();
                let step = STEP / unit;
                let at = |sign: f64| {
                    let mut moved = standard(&body);
                    moved[column] += sign * step;
                    body_barrier(&inertial(&moved)).expect("a small step stays inside")
                };
                let (low, high) = (at(-1.0), at(1.0));
                let difference = (high.value - low.value) / (2.0 * step);
                prop_assert!((barrier.gradient[column] - difference).abs() <= TOLERANCE * unit);
                for row in 0..10 {
                    let difference = (high.gradient[row] - low.gradient[row]) / (2.0 * step);
                    let size = unit * barrier.hessian[row][row].sqrt();
                    prop_assert!((barrier.hessian[row][column] - difference).abs() <= TOLERANCE * size);
                }
            }
        }

        /// Whatever the six numbers, what comes back has eigenvalues of at least the one asked for.
        #[test]
        fn inside_is_inside(inertia in prop::array::uniform6(-1.0..1.0f64)) {
            let moved = inside(&inertia, 1e-3);
            prop_assert!(second_moment(&moved).symmetric_eigenvalues().min() > 1e-3 - 1e-12);
            prop_assert_eq!(inside(&moved, 0.9e-3), moved);
        }
    }

    #[test]
    fn no_barrier_outside() {
        let body = |m: f64, xx: f64, yy: f64, zz: f64| [m, 0.0, 0.0, 0.0, xx, 0.0, 0.0, yy, 0.0, zz];
        assert_eq!(body_barrier(&body(1.0, 1.0, 1.0, 2.1)), None, "violates the triangle inequality");
        assert_eq!(body_barrier(&body(1.0, 0.0, 0.0, 0.0)), None);
        assert_eq!(body_barrier(&body(-1.0, 1.0, 1.0, 1.0)), None);
        // A solid cube of unit moments and mass 2: S = 1/2 1, -log det P = 3 log 2 - log 2.
        let cube = body_barrier(&body(2.0, 1.0, 1.0, 1.0)).expect("a cube is a body");
        assert!((cube.value - 2.0 * 2.0_f64.ln()).abs() < 1e-14);
    }
}

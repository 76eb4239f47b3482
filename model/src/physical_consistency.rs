//! Which ten numbers can be the inertial parameters of a body.
//!
//! A mass distribution has `m >= 0` and a second moment `S = trace(I)/2 * 1 - I` about the centroid that is positive
//! semi-definite; together that is the positive semi-definite pseudo-inertia (Wensing, Kim & Slotine 2018). For the
//! principal moments it means that the sum of any two is at least the third, which includes that none is negative.

use std::fmt;

/// Why no body has these inertial parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Impossible {
    /// `m < 0`: the mass \[kg\].
    NegativeMass(f64),
    /// The inertia matrix has a negative principal moment: the principal moments, ascending [kg m^2].
    NegativeMoment([f64; 3]),
    /// One principal moment exceeds the sum of the others: the principal moments, ascending [kg m^2].
    Triangle([f64; 3]),
}

/// Eigenvalues may fall this much below zero, relative to the trace of the inertia: rounding, not physics.
const TOLERANCE: f64 = 1e-9;

/// Checks mass, centroid and inertia about the centroid, in the order of [`crate::Link::SYMBOLS`].
///
/// # Errors
/// Why no body has them.
pub fn check_body(inertial: &[f64; 10]) -> Result<(), Impossible> {
    let [mass, _, _, _, xx, xy, xz, yy, yz, zz] = *inertial;
    if mass < 0.0 {
        return Err(Impossible::NegativeMass(mass));
    }
    let moments = principal_moments([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]);
    let slack = TOLERANCE * moments.iter().map(|moment| moment.abs()).sum::<f64>();
    if moments[0] < -slack {
        return Err(Impossible::NegativeMoment(moments));
    }
    if moments[2] > moments[0] + moments[1] + slack {
        return Err(Impossible::Triangle(moments));
    }
    Ok(())
}

impl fmt::Display for Impossible {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NegativeMass(mass) => write!(f, "the mass {mass} kg is negative"),
            Self::NegativeMoment([a, b, c]) => {
                write!(f, "principal moments {a:.4e}, {b:.4e}, {c:.4e} kg*m^2: the first is negative")
            }
            Self::Triangle([a, b, c]) => write!(
                f,
                "principal moments {a:.4e}, {b:.4e}, {c:.4e} kg*m^2: the last exceeds the sum of the others by {:.2e}",
                c - a - b
            ),
        }
    }
}

/// Eigenvalues of a symmetric matrix, ascending, by Jacobi rotations.
fn principal_moments(mut matrix: [[f64; 3]; 3]) -> [f64; 3] {
    // Each sweep squares the off-diagonal size; eight are more than doubles can use.
    for _ in 0..8 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if matrix[p][q] == 0.0 {
                continue;
            }
            let theta = (matrix[q][q] - matrix[p][p]) / (2.0 * matrix[p][q]);
            let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
            let sine = tangent * cosine;
            let mut rotation = [[0.0; 3]; 3];
            (0..3).for_each(|axis| rotation[axis][axis] = 1.0);
            rotation[p][p] = cosine;
            rotation[q][q] = cosine;
            rotation[p][q] = sine;
            rotation[q][p] = -sine;
            let half = product(&matrix, &rotation);
            matrix = product(&transposed(&rotation), &half);
            matrix[p][q] = 0.0;
            matrix[q][p] = 0.0;
        }
    }
    let mut moments = [matrix[0][0], matrix[1][1], matrix[2][2]];
    moments.sort_by(f64::total_cmp);
    moments
}

fn product(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|row| std::array::from_fn(|column| (0..3).map(|k| a[row][k] * b[k][column]).sum()))
}

fn transposed(a: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|row| std::array::from_fn(|column| a[column][row]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Ten parameters of point masses, which are a body by construction.
    fn of_points(points: &[[f64; 4]]) -> [f64; 10] {
        let mass: f64 = points.iter().map(|p| p[3]).sum();
        let centroid: [f64; 3] =
            std::array::from_fn(|axis| points.iter().map(|p| p[3] * p[axis]).sum::<f64>() / mass.max(1e-300));
        let mut inertia = [[0.0; 3]; 3];
        for p in points {
            let r: [f64; 3] = std::array::from_fn(|axis| p[axis] - centroid[axis]);
            let square: f64 = r.iter().map(|x| x * x).sum();
            for row in 0..3 {
                for column in 0..3 {
                    inertia[row][column] += p[3] * (if row == column { square } else { 0.0 } - r[row] * r[column]);
                }
            }
        }
        let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = inertia;
        [mass, centroid[0], centroid[1], centroid[2], xx, xy, xz, yy, yz, zz]
    }

    proptest! {
        #[test]
        fn point_masses_are_a_body(points in prop::collection::vec([-1.0..1.0f64, -1.0..1.0, -1.0..1.0, 0.0..2.0], 1..6)) {
            prop_assert_eq!(check_body(&of_points(&points)), Ok(()));
        }

        #[test]
        fn eigenvalues_keep_the_invariants(entries in prop::array::uniform6(-1.0..1.0f64)) {
            let [xx, xy, xz, yy, yz, zz] = entries;
            let [a, b, c] = principal_moments([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]);
            let determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
            prop_assert!((a + b + c - (xx + yy + zz)).abs() < 1e-13);
            prop_assert!((a * b * c - determinant).abs() < 1e-13);
            let squares = xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + xz * xz + yz * yz);
            prop_assert!((a * a + b * b + c * c - squares).abs() < 1e-12);
        }
    }

    #[test]
    fn no_body() {
        let with = |xx, xy, yy, zz| [1.0, 0.0, 0.0, 0.0, xx, xy, 0.0, yy, 0.0, zz];
        assert!(matches!(check_body(&with(1.0, 0.0, 1.0, 2.1)), Err(Impossible::Triangle(_))));
        assert!(matches!(check_body(&with(1.0, 2.0, 1.0, 1.0)), Err(Impossible::NegativeMoment(_))));
        assert!(matches!(check_body(&[-1.0; 10]), Err(Impossible::NegativeMass(_))));
        assert_eq!(check_body(&with(1.0, 0.0, 1.0, 2.0)), Ok(()), "a flat plate is a body");
        assert_eq!(check_body(&[0.0; 10]), Ok(()), "a link without mass is allowed");
    }
}

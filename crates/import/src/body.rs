//! Bodies: merged where they move as one, and mended where no body is like that.

use dynid_model::physical_consistency::{Impossible, check_body};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use crate::{
    number::Number,
    pose::{Pose, without_rounding},
    urdf::Inertial,
};

/// A rigid body in the axes of a frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Body {
    pub mass: f64,
    pub centroid: Vector3<f64>,
    /// About the centroid.
    pub inertia: Matrix3<f64>,
}

impl Body {
    pub fn of(inertial: &Inertial) -> Self {
        let [xx, xy, xz, yy, yz, zz] = [0, 1, 2, 3, 4, 5].map(|place| inertial.moments[place].value);
        let pose = inertial.origin.pose();
        let inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        Self {
            mass: inertial.mass.value,
            centroid: pose.place,
            inertia: pose.rotation * inertia * pose.rotation.transpose(),
        }
    }

    /// Whether it does nothing to the equations of motion.
    pub fn is_nothing(&self) -> bool {
        self.mass == 0.0 && self.inertia == Matrix3::zeros()
    }

    /// The same body, seen from where `pose` is seen from.
    pub fn seen_from(&self, pose: &Pose) -> Self {
        Self {
            mass: self.mass,
            centroid: pose.place + pose.rotation * self.centroid,
            inertia: pose.rotation * self.inertia * pose.rotation.transpose(),
        }
    }

    /// Bodies that move as one, by the parallel axis theorem.
    pub fn merged(bodies: &[Self]) -> Self {
        if let [alone] = bodies {
            return alone.clone();
        }
        let mass: f64 = bodies.iter().map(|body| body.mass).sum();
        let first_moment: Vector3<f64> = bodies.iter().map(|body| body.mass * body.centroid).sum();
        let centroid = if mass > 0.0 { first_moment / mass } else { Vector3::zeros() };
        let about_centroid = |body: &Self| {
            let arm = body.centroid - centroid;
            body.inertia + body.mass * (Matrix3::identity() * arm.norm_squared() - arm * arm.transpose())
        };
        Self { mass, centroid, inertia: bodies.iter().map(about_centroid).sum() }
    }

    /// In the order of [`dynid_model::Link::SYMBOLS`].
    pub fn values(&self) -> [f64; 10] {
        let entry = |row: usize, column: usize| (self.inertia[(row, column)] + self.inertia[(column, row)]) / 2.0;
        // What a rotation leaves of a product that is zero is far below what any inertia is known to.
        let size = 1e-16 * self.inertia.abs().max();
        let product = |row, column| if entry(row, column).abs() < size { 0.0 } else { entry(row, column) };
        let [x, y, z] = [0, 1, 2].map(|axis| without_rounding(self.centroid[axis]));
        [self.mass, x, y, z, entry(0, 0), product(0, 1), product(0, 2), entry(1, 1), product(1, 2), entry(2, 2)]
    }

    /// The nearest body that can be, where this one cannot: second moments that are negative become 0.
    ///
    /// The second moments about the centroid are `S = trace(I)/2 - I`, so the smaller principal moments rise by what the largest
    /// exceeds their sum by, half each, and the largest stays.
    pub fn mended(&self) -> Option<(Self, Impossible)> {
        let impossible = check_body(&self.values()).err()?;
        let symmetric = (self.inertia + self.inertia.transpose()) / 2.0;
        let second = Matrix3::identity() * (symmetric.trace() / 2.0) - symmetric;
        let mut eigen = SymmetricEigen::new(second);
        eigen.eigenvalues.apply(|value| *value = value.max(0.0));
        let second = eigen.recompose();
        let inertia = Matrix3::identity() * second.trace() - second;
        Some((Self { inertia, ..self.clone() }, impossible))
    }
}

/// A single body's numbers as they are written, where its axes are those of the frame.
pub(crate) fn as_written(inertial: &Inertial) -> Option<[Number; 10]> {
    if inertial.origin.pose().is_turned() {
        return None;
    }
    let ([x, y, z], [xx, xy, xz, yy, yz, zz]) = (inertial.origin.xyz.clone(), inertial.moments.clone());
    Some([inertial.mass.clone(), x, y, z, xx, xy, xz, yy, yz, zz])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rod(mass: f64, length: f64, centroid: [f64; 3], along: usize) -> Body {
        let across = mass * length * length / 12.0;
        let mut inertia = Matrix3::identity() * across;
        inertia[(along, along)] = 0.0;
        Body { mass, centroid: Vector3::from(centroid), inertia }
    }

    /// Two halves of a rod are the rod, wherever it lies.
    #[test]
    fn halves_are_the_whole() {
        let halves = [rod(1.5, 0.4, [0.2, 0.1, 0.0], 0), rod(1.5, 0.4, [0.6, 0.1, 0.0], 0)];
        let whole = rod(3.0, 0.8, [0.4, 0.1, 0.0], 0);
        let merged = Body::merged(&halves);
        for (found, expected) in merged.values().iter().zip(whole.values()) {
            assert!((found - expected).abs() < 1e-15, "{found} {expected}");
        }
    }

    /// A right angle of two rods, turned and moved: centroid and products by hand.
    #[test]
    fn right_angle_has_its_products() {
        let (mass, length) = (2.0, 0.6);
        let angle = [rod(mass, length, [0.3, 0.0, 0.0], 0), rod(mass, length, [0.0, 0.3, 0.0], 1)];
        let merged = Body::merged(&angle);
        let across = mass * length * length / 12.0;
        // Each rod's centroid is (+-0.15, -+0.15) from the common one at (0.15, 0.15).
        let arm = 0.15;
        let expected = [
            2.0 * mass,
            arm,
            arm,
            0.0,
            across + 2.0 * mass * arm * arm,
            2.0 * mass * arm * arm,
            0.0,
            across + 2.0 * mass * arm * arm,
            0.0,
            2.0 * across + 4.0 * mass * arm * arm,
        ];
        for (found, expected) in merged.values().iter().zip(expected) {
            assert!((found - expected).abs() < 1e-15, "{found} {expected}");
        }
    }

    #[test]
    fn mended_body_is_possible_and_near() {
        let inertia = Matrix3::from_diagonal(&Vector3::new(0.01, 0.02, 0.032));
        let body = Body { mass: 1.0, centroid: Vector3::zeros(), inertia };
        let (mended, why) = body.mended().unwrap();
        assert!(matches!(why, Impossible::Triangle(_)));
        assert_eq!(check_body(&mended.values()), Ok(()));
        let moments = [0, 1, 2].map(|axis| mended.inertia[(axis, axis)]);
        for (found, expected) in moments.iter().zip([0.011, 0.021, 0.032]) {
            assert!((found - expected).abs() < 1e-15, "{moments:?}");
        }
        assert_eq!(mended.mended(), None);
    }
}

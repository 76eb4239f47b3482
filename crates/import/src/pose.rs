//! Where a frame stands in another.

use dynid_model::transform::{Rotation, roll_pitch_yaw};
use nalgebra::{Matrix3, Vector3};

use crate::number::{Number, quarter_turns};

/// What rounding leaves of an exact zero, in metres and in entries of a rotation.
const EXACT_ZERO: f64 = 1e-15;

/// Where something stands, as it is written.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Origin {
    pub xyz: [Number; 3],
    pub turned: Turned,
}

impl Origin {
    pub const IDENTITY: Self = Self { xyz: [Number::ZERO; 3], turned: Turned::Angles([Number::ZERO; 3]) };

    pub fn pose(&self) -> Pose {
        let rotation = match &self.turned {
            Turned::Angles(rpy) => roll_pitch_yaw([0, 1, 2].map(|axis| rpy[axis].angle())),
            Turned::Matrix(rows) => *rows,
        };
        let place = Vector3::from([0, 1, 2].map(|axis| self.xyz[axis].value));
        Pose { rotation: Matrix3::from_fn(|row, column| rotation[row][column]), place }
    }
}

/// A rotation, and a place \[m\].
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pose {
    pub rotation: Matrix3<f64>,
    pub place: Vector3<f64>,
}

/// A rotation as a device file states it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Turned {
    Angles([Number; 3]),
    Matrix(Rotation),
}

impl Pose {
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), place: Vector3::zeros() }
    }

    pub fn is_turned(&self) -> bool {
        self.rotation != Matrix3::identity()
    }

    pub fn then(&self, next: &Self) -> Self {
        Self { rotation: self.rotation * next.rotation, place: self.place + self.rotation * next.place }
    }

    /// What stands in a device file for this pose followed by `origin`; the text of `origin` wherever it stays true.
    pub fn placement(&self, origin: &Origin) -> ([Number; 3], Turned) {
        if *self == Self::identity() {
            return (origin.xyz.clone(), origin.turned.clone());
        }
        let whole = self.then(&origin.pose());
        let xyz = [0, 1, 2].map(|axis| Number::from(without_rounding(whole.place[axis])));
        let turned = if self.is_turned() { stated(&whole.rotation) } else { origin.turned.clone() };
        (xyz, turned)
    }
}

pub(crate) fn without_rounding(value: f64) -> f64 {
    if value.abs() < EXACT_ZERO { 0.0 } else { value }
}

/// Roll, pitch and yaw, or the matrix where angles lose digits (near a pitch of a quarter turn).
pub(crate) fn stated(rotation: &Matrix3<f64>) -> Turned {
    let rows: Rotation = [0, 1, 2].map(|row| [0, 1, 2].map(|column| without_rounding(rotation[(row, column)])));
    let level = rows[0][0].hypot(rows[1][0]);
    let pitch = (-rows[2][0]).atan2(level);
    let [roll, yaw] = if level < EXACT_ZERO {
        [(-rows[1][2]).atan2(rows[1][1]), 0.0]
    } else {
        [rows[2][1].atan2(rows[2][2]), rows[1][0].atan2(rows[0][0])]
    };
    let angles = [roll, pitch, yaw].map(|angle| {
        let number = Number::from(angle);
        // A quarter turn that is none but for rounding would be read as one and move others.
        if quarter_turns(angle).is_some() { Number::from(number.angle()) } else { number }
    });
    let again = roll_pitch_yaw([0, 1, 2].map(|axis| angles[axis].value));
    let differs = rows.iter().flatten().zip(again.iter().flatten()).any(|(a, b)| (a - b).abs() > EXACT_ZERO);
    if differs { Turned::Matrix(rows) } else { Turned::Angles(angles) }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;

    fn origin(xyz: [f64; 3], rpy: [f64; 3]) -> Origin {
        Origin { xyz: xyz.map(Number::from), turned: Turned::Angles(rpy.map(Number::from)) }
    }

    /// What is stated is the composed rotation, for angles of every kind.
    #[test]
    fn stated_rotation_is_the_composed_one() {
        let angles = [0.0, FRAC_PI_2, -FRAC_PI_2, PI, 0.3, -2.4, FRAC_PI_2 - 3e-8];
        for at in 0..343 {
            let rpy = [angles[at % 7], angles[at / 7 % 7], angles[at / 49]];
            let first = origin([0.1, 0.2, 0.3], rpy);
            let second = origin([0.0, 0.5, 0.0], [rpy[2], rpy[0], rpy[1]]);
            let (xyz, turned) = first.pose().placement(&second);
            let expected = first.pose().then(&second.pose());
            let found = Origin { xyz: xyz.clone(), turned }.pose().rotation;
            assert!((found - expected.rotation).abs().max() < 3e-15, "{rpy:?}");
            (0..3).for_each(|axis| assert!((xyz[axis].value - expected.place[axis]).abs() < 1e-15));
        }
    }

    #[test]
    fn quarter_turns_stay_named() {
        let first = origin([0.0, 0.0, 0.1], [0.0, FRAC_PI_2, 0.0]).pose();
        let (xyz, turned) = first.placement(&origin([0.2, 0.0, 0.0], [0.0, FRAC_PI_2, 0.0]));
        assert_eq!(xyz.map(|number| number.value), [0.0, 0.0, -0.1]);
        let Turned::Angles(rpy) = turned else { panic!("{turned:?}") };
        let named = rpy.map(|angle| angle.toml_angle());
        assert!(named.iter().all(|name| name == "0" || name.contains("pi")), "{named:?}");
    }
}

//! General fixed transforms, with a joint about or along any axis, as rows of a Denavit-Hartenberg table.
//!
//! A frame is `parent Trans(xyz) R Rot(axis, turn)` or `.. Trans(slide axis)`. With `A` a rotation that turns z to the axis,
//! `Rot(axis, turn) = A Rz(turn) A^T`, and any rotation is `Rz Rx Rz`; so a few rows of the standard convention,
//! `Rz(theta) Tz(d) Tx(a) Rx(alpha)`, are the same frame exactly, and all that reads devices knows but rows.

use std::{collections::BTreeMap, f64::consts::FRAC_PI_2};

use crate::{
    device::Frame,
    expression::{BinaryOperator, Expression},
};

/// A rotation matrix, by rows.
pub type Rotation = [[f64; 3]; 3];

/// theta, d, a and alpha.
pub type Row = [Expression; 4];

/// An angle that is so near a whole number of quarter turns (rad), or a component of a vector that is so small, is meant to be
/// that: ten digits of pi are as near.
const ROUNDING: f64 = 3e-10;

/// What moves a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// A rotation about the axis \[rad\].
    Turn(Expression),
    /// A translation along the axis \[m\].
    Slide(Expression),
}

/// General frames as rows of the standard convention, as they are added.
///
/// A joint at general angles is its classical Denavit-Hartenberg row: the turn about the earlier axis belongs to the earlier joint's
/// angle, where that carries one joint first. So only rotations about x are left between axes, which cost least.
#[derive(Debug, Default)]
pub struct GeneralFrames {
    /// The rows; a parent is an index of one.
    pub rows: Vec<Frame>,
    /// One per frame that was added.
    poses: Vec<Pose>,
    /// By its row: the angle of a joint at general angles.
    spins: BTreeMap<usize, Spin>,
}

/// Where a frame is seen from a row's frame; from the base without one.
#[derive(Debug, Clone, Copy)]
struct Pose {
    row: Option<usize>,
    rotation: Rotation,
    place: [f64; 3],
    /// The row that is the frame itself.
    named: usize,
}

#[derive(Debug)]
struct Spin {
    constant: f64,
    turn: Expression,
    /// Whether a joint's turn about this axis has become a part of the constant.
    leads: bool,
}

impl GeneralFrames {
    /// Adds a frame at `xyz` in its parent, one of those that were added, by number. `motion` is about or along an axis of length 1 in
    /// the frame that `rotation` turns to.
    pub fn add(
        &mut self,
        name: &str,
        parent: Option<usize>,
        xyz: [Expression; 3],
        rotation: Rotation,
        motion: Option<(Motion, [f64; 3])>,
    ) {
        let numbers = xyz.iter().map(Expression::constant).collect::<Option<Vec<f64>>>();
        let place = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
        let from = parent.map(|parent| self.poses[parent]);
        // What has symbols is seen from the parent itself.
        let (row, rotation, at) = match (from, place) {
            (None, place) => (None, rotation, place),
            (Some(from), Some(place)) => {
                let moved = apply(&from.rotation, place);
                let at = [0, 1, 2].map(|k| from.place[k] + moved[k]);
                (from.row, product(&from.rotation, &rotation), Some(at))
            }
            (Some(from), None) => (Some(from.named), rotation, None),
        };
        let axes = motion.as_ref().map(|(_, axis)| to_axis(*axis));
        if let (Some(at), Some((motion, _)), Some(axes)) = (at, &motion, &axes) {
            let before = product(&rotation, &transposed(axes));
            if let Some(classical) = Classical::new(&before, at) {
                self.add_joint(name, row, &classical, motion.clone(), axes);
                return;
            }
        }
        let xyz = at.map_or(xyz, |at| at.map(literal));
        let has_joint = motion.is_some();
        let named = self.push(name, row, rows(xyz, rotation, motion));
        let seen_from_row = at.filter(|_| !has_joint && !is_in_quarters(&rotation));
        self.poses.push(match seen_from_row {
            Some(place) => Pose { row, rotation, place, named },
            None => Pose { row: Some(named), rotation: IDENTITY, place: [0.0; 3], named },
        });
    }

    /// A joint at general angles, then the frame, whose axes are seen from the joint's by `axes`.
    fn add_joint(&mut self, name: &str, parent: Option<usize>, classical: &Classical, motion: Motion, axes: &Rotation) {
        let Classical { first, d, a, alpha, last, slide } = *classical;
        let first = match parent {
            Some(row) if self.lead(row, first) => 0.0,
            _ => first,
        };
        let (theta, along, turn) = match motion {
            Motion::Turn(turn) => (sum(last, turn.clone()), literal(slide), Some(turn)),
            Motion::Slide(moving) => (angle(last), sum_of_lengths(slide, moving), None),
        };
        let row = [angle(first), literal(d), literal(a), angle(alpha)];
        let joint = self.push(&format!("{name} (axis)"), parent, vec![row, [theta, along, zero(), zero()]]);
        if let Some(turn) = turn {
            self.spins.insert(joint, Spin { constant: last, turn, leads: false });
        }
        let named = self.push(name, Some(joint), rows([(); 3].map(|()| zero()), *axes, None));
        self.poses.push(Pose { row: Some(joint), rotation: *axes, place: [0.0; 3], named });
    }

    /// Lets a joint's own angle take a turn about its axis, which all that is on it turns back; false where that gains nothing.
    fn lead(&mut self, row: usize, by: f64) -> bool {
        let Some(spin) = self.spins.get_mut(&row).filter(|spin| !spin.leads && quarters(by) % FRAC_PI_2 != 0.0) else {
            return false;
        };
        spin.leads = true;
        spin.constant = quarters(spin.constant + by);
        self.rows[row].theta = sum(spin.constant, spin.turn.clone());
        for other in self.rows.iter_mut().filter(|other| other.parent == Some(row)) {
            let theta = std::mem::replace(&mut other.theta, zero());
            other.theta = match theta.constant() {
                Some(constant) => angle(constant - by),
                None => sum(-by, theta),
            };
        }
        for pose in self.poses.iter_mut().filter(|pose| pose.row == Some(row)) {
            pose.rotation = product(&about_z(-by), &pose.rotation);
            pose.place = apply(&about_z(-by), pose.place);
        }
        true
    }

    /// Adds rows, the first on `parent`, the last with that name.
    fn push(&mut self, name: &str, mut parent: Option<usize>, rows: Vec<Row>) -> usize {
        let n_rows = rows.len();
        for (number, [theta, d, a, alpha]) in (1..).zip(rows) {
            let name = if number == n_rows { name.to_owned() } else { format!("{name} (row {number})") };
            self.rows.push(Frame { name, parent, theta, d, a, alpha });
            parent = Some(self.rows.len() - 1);
        }
        self.rows.len() - 1
    }
}

/// `Rz(first) Tz(d) Tx(a) Rx(alpha) Rz(last) Tz(slide)` of a joint's axes before it moves.
#[derive(Debug, Clone, Copy)]
struct Classical {
    first: f64,
    d: f64,
    a: f64,
    alpha: f64,
    last: f64,
    slide: f64,
}

/// Axes whose directions differ by less (rad) have their common normal far away: lengths would lose digits.
const NEARLY_PARALLEL: f64 = 0.1;

impl Classical {
    /// None where all is quarter turns, which cost nothing as they are, and where axes are nearly parallel.
    fn new(rotation: &Rotation, place: [f64; 3]) -> Option<Classical> {
        let [first, alpha, last] = z_x_z(rotation);
        if is_in_quarters(rotation) {
            return None;
        }
        if alpha.sin() < ROUNDING {
            // Parallel axes: any common normal will do, and this one leads to the place.
            let normal = place[1].atan2(place[0]);
            let last = if alpha < FRAC_PI_2 { first - normal } else { normal - first };
            return Some(Classical {
                first: normal,
                d: place[2],
                a: place[0].hypot(place[1]),
                alpha,
                last,
                slide: 0.0,
            });
        }
        if alpha.sin() < NEARLY_PARALLEL {
            return None;
        }
        let [x, y, z] = apply(&about_z(-first), place);
        let slide = -y / alpha.sin();
        Some(Classical { first, d: z - slide * alpha.cos(), a: x, alpha, last, slide })
    }
}

/// The rows of one frame; at least one.
fn rows([x, y, z]: [Expression; 3], rotation: Rotation, motion: Option<(Motion, [f64; 3])>) -> Vec<Row> {
    let is_zero = |length: &Expression| length.constant() == Some(0.0);
    let mut rows = Vec::new();
    if !is_zero(&x) || !is_zero(&z) {
        rows.push([zero(), z, x, zero()]);
    }
    let mut rest = rotation;
    if !is_zero(&y) {
        rows.push([Expression::Number(FRAC_PI_2), zero(), y, zero()]);
        rest = product(&about_z(-FRAC_PI_2), &rest);
    }
    let Some((motion, axis)) = motion else {
        let [first, about_x, last] = z_x_z(&rest);
        rows.push([angle(first), zero(), zero(), angle(about_x)]);
        rows.push([angle(last), zero(), zero(), zero()]);
        return without_idle(rows);
    };
    let axes = to_axis(axis);
    let [first, about_x, last] = z_x_z(&product(&rest, &transposed(&axes)));
    rows.push([angle(first), zero(), zero(), angle(about_x)]);
    let [azimuth, tilt, rest_of_it] = z_x_z(&axes);
    rows.push(match motion {
        Motion::Turn(turn) => [sum(last, turn), zero(), zero(), zero()],
        Motion::Slide(slide) => [angle(last), slide, zero(), zero()],
    });
    rows.push([angle(azimuth), zero(), zero(), angle(tilt)]);
    rows.push([angle(rest_of_it), zero(), zero(), zero()]);
    without_idle(rows)
}

/// `Rx(tilt) Rz(azimuth)`: the axes of a frame, seen from axes whose z is the direction `[x, y, z]` of that frame.
fn to_axis([x, y, z]: [f64; 3]) -> Rotation {
    let out_of_z = x.hypot(y);
    let azimuth = if out_of_z < ROUNDING { 0.0 } else { x.atan2(y) };
    product(&about_x_axis(quarters(out_of_z.atan2(z))), &about_z(quarters(azimuth)))
}

/// `Rz(yaw) Ry(pitch) Rx(roll)`: turns about fixed x, then y, then z.
pub fn roll_pitch_yaw([roll, pitch, yaw]: [f64; 3]) -> Rotation {
    let [roll, pitch, yaw] = [roll, pitch, yaw].map(quarters);
    let (sine, cosine) = sine_cosine(pitch);
    let about_y = [[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]];
    product(&about_z(yaw), &product(&about_y, &about_x_axis(roll)))
}

/// Largest difference of `R R^T` from the identity; infinite for a reflection.
pub fn distance_from_rotation(of: &Rotation) -> f64 {
    let [a, b, c] = of;
    let cross = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
    let dot = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    if dot(a, &cross) < 0.0 {
        return f64::INFINITY;
    }
    let entry = |row: usize, column: usize| (dot(&of[row], &of[column]) - f64::from(u8::from(row == column))).abs();
    (0..9).map(|place| entry(place / 3, place % 3)).fold(0.0, f64::max)
}

/// Rows that move nothing are left out, but for one.
fn without_idle(mut rows: Vec<Row>) -> Vec<Row> {
    let is_idle = |row: &Row| row.iter().all(|cell| cell.constant() == Some(0.0));
    let idle = rows.last().cloned();
    rows.retain(|row| !is_idle(row));
    if rows.is_empty() {
        rows.extend(idle);
    }
    rows
}

/// `first`, `about_x` and `last` of `Rz(first) Rx(about_x) Rz(last)`.
fn z_x_z(of: &Rotation) -> [f64; 3] {
    let out_of_z = of[0][2].hypot(of[1][2]);
    let about_x = out_of_z.atan2(of[2][2]);
    if out_of_z < ROUNDING {
        return [of[1][0].atan2(of[0][0]), about_x, 0.0];
    }
    [of[0][2].atan2(-of[1][2]), about_x, of[2][0].atan2(of[2][1])]
}

/// A whole number of quarter turns, where the angle is meant to be one.
fn quarters(angle: f64) -> f64 {
    let nearest = (angle / FRAC_PI_2).round() * FRAC_PI_2;
    if (angle - nearest).abs() < ROUNDING { nearest } else { angle }
}

fn angle(value: f64) -> Expression {
    let value = quarters(value);
    // -pi is pi.
    let value = if value < -2.0 * FRAC_PI_2 + ROUNDING { value + 4.0 * FRAC_PI_2 } else { value };
    literal(value)
}

fn zero() -> Expression {
    Expression::Number(0.0)
}

fn literal(value: f64) -> Expression {
    if value < 0.0 { Expression::Negate(Box::new(Expression::Number(-value))) } else { Expression::Number(value) }
}

fn sum(constant: f64, moving: Expression) -> Expression {
    plus(moving, angle(constant))
}

fn sum_of_lengths(constant: f64, moving: Expression) -> Expression {
    plus(moving, literal(constant))
}

fn plus(moving: Expression, constant: Expression) -> Expression {
    if constant.constant() == Some(0.0) {
        return moving;
    }
    Expression::Binary(BinaryOperator::Add, Box::new(moving), Box::new(constant))
}

/// Whether it turns axes to axes.
fn is_in_quarters(rotation: &Rotation) -> bool {
    rotation.iter().flatten().all(|entry| (entry - entry.round()).abs() < ROUNDING)
}

/// Exact for quarter turns.
fn sine_cosine(angle: f64) -> (f64, f64) {
    let quarters = angle / FRAC_PI_2;
    if quarters == quarters.round() {
        return [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][(quarters as i64).rem_euclid(4) as usize];
    }
    angle.sin_cos()
}

fn about_z(angle: f64) -> Rotation {
    let (sine, cosine) = sine_cosine(angle);
    [[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]
}

fn about_x_axis(angle: f64) -> Rotation {
    let (sine, cosine) = sine_cosine(angle);
    [[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]]
}

const IDENTITY: Rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn transposed(of: &Rotation) -> Rotation {
    std::array::from_fn(|row| std::array::from_fn(|column| of[column][row]))
}

fn apply(rotation: &Rotation, vector: [f64; 3]) -> [f64; 3] {
    rotation.map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum())
}

fn product(a: &Rotation, b: &Rotation) -> Rotation {
    std::array::from_fn(|row| std::array::from_fn(|column| (0..3).map(|k| a[row][k] * b[k][column]).sum()))
}

#[cfg(test)]
mod tests {
    use super::*;

    type Pose = (Rotation, [f64; 3]);

    fn then((rotation, place): &Pose, (next, by): &Pose) -> Pose {
        let moved = std::array::from_fn(|row| place[row] + (0..3).map(|k| rotation[row][k] * by[k]).sum::<f64>());
        (product(rotation, next), moved)
    }

    /// `Rz(theta) Tz(d) Tx(a) Rx(alpha)` row by row from the base, by sines and cosines.
    fn of_row(rows: &[Frame], row: usize, q: f64) -> Pose {
        let Frame { parent, theta, d, a, alpha, .. } = &rows[row];
        let below = parent.map_or((about_z(0.0), [0.0; 3]), |parent| of_row(rows, parent, q));
        let [theta, d, a, alpha] = [theta, d, a, alpha].map(|cell| cell.evaluate(&|_| Some(q)).unwrap());
        let (s, c) = theta.sin_cos();
        let (sa, ca) = alpha.sin_cos();
        then(&below, &([[c, -s * ca, s * sa], [s, c * ca, -c * sa], [0.0, sa, ca]], [a * c, a * s, d]))
    }

    /// Rodrigues' formula.
    fn about([x, y, z]: [f64; 3], angle: f64) -> Rotation {
        let (s, c) = angle.sin_cos();
        let v = 1.0 - c;
        [
            [c + x * x * v, x * y * v - z * s, x * z * v + y * s],
            [y * x * v + z * s, c + y * y * v, y * z * v - x * s],
            [z * x * v - y * s, z * y * v + x * s, c + z * z * v],
        ]
    }

    fn assert_same((a, at_a): &Pose, (b, at_b): &Pose, what: &str) {
        let pairs = a.iter().flatten().zip(b.iter().flatten()).chain(at_a.iter().zip(at_b));
        pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-14, "{what}: {a} {b}"));
    }

    fn rpy_by_turns([roll, pitch, yaw]: [f64; 3]) -> Rotation {
        let turns = [([1.0, 0.0, 0.0], roll), ([0.0, 1.0, 0.0], pitch), ([0.0, 0.0, 1.0], yaw)];
        turns.iter().fold(about_z(0.0), |sum, &(axis, angle)| product(&about(axis, angle), &sum))
    }

    fn next(seed: &mut u64) -> usize {
        *seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*seed >> 33) as usize
    }

    /// Trees of frames with angles and axes of every kind: turning, sliding and fixed ones, lengths with symbols among them.
    #[test]
    fn rows_are_the_transforms() {
        let angles = [0.0, FRAC_PI_2, -FRAC_PI_2, 2.0 * FRAC_PI_2, 0.3, -2.4, 1.1, 0.02];
        let axes: [[f64; 3]; 9] = [
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
            [1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0],
            [1.0, 2.0, -0.5],
            [-1.0, 0.3, 0.2],
            [0.0, 1.0, 1.0],
        ];
        for mut seed in 0..400 {
            let random = &mut seed;
            let (mut frames, mut expected) = (GeneralFrames::default(), Vec::new());
            for number in 0..6 {
                let parent = (number > 0 && !next(random).is_multiple_of(5))
                    .then(|| if !next(random).is_multiple_of(3) { number - 1 } else { next(random) % number });
                let mut place = [0.0; 3].map(|_| [0.0, 0.0, 0.1, -0.4, 0.35][next(random) % 5]);
                let mut xyz = place.map(literal);
                if next(random).is_multiple_of(4) {
                    (place[1], xyz[1]) = (0.7, Expression::Symbol("L".to_owned()));
                }
                let rpy = [0.0; 3].map(|_| angles[next(random) % angles.len()]);
                let axis = axes[next(random) % axes.len()];
                let axis = axis.map(|own| own / axis.iter().map(|own| own * own).sum::<f64>().sqrt());
                let q = || Expression::Symbol("q".to_owned());
                // The symbol is 0.7, be it a joint or a length.
                let (motion, moved) = match next(random) % 3 {
                    0 => (None, (about_z(0.0), [0.0; 3])),
                    1 => (Some((Motion::Turn(q()), axis)), (about(axis, 0.7), [0.0; 3])),
                    _ => (Some((Motion::Slide(q()), axis)), (about_z(0.0), axis.map(|own| 0.7 * own))),
                };
                let name = format!("f{number}");
                frames.add(&name, parent, xyz, roll_pitch_yaw(rpy), motion);
                let below = parent.map_or((about_z(0.0), [0.0; 3]), |parent: usize| expected[parent]);
                expected.push(then(&then(&below, &(rpy_by_turns(rpy), place)), &moved));
            }
            for (number, expected) in expected.iter().enumerate() {
                let row = frames.rows.iter().position(|row| row.name == format!("f{number}")).unwrap();
                assert_same(&of_row(&frames.rows, row, 0.7), expected, &format!("seed {seed}, frame {number}"));
            }
        }
    }

    /// A chain at general angles: between its axes only rotations about x are left.
    #[test]
    fn a_chain_becomes_its_classical_rows() {
        let mut frames = GeneralFrames::default();
        for number in 0..4_usize {
            let turn = Motion::Turn(Expression::Symbol(format!("q{number}")));
            let rotation = roll_pitch_yaw([0.5, -0.7, 1.0 + number as f64]);
            let xyz = [0.1, 0.2, 0.3].map(Expression::Number);
            frames.add(&format!("f{number}"), number.checked_sub(1), xyz, rotation, Some((turn, [0.6, 0.0, 0.8])));
        }
        let between = frames.rows.iter().filter(|row| row.name.ends_with("(axis) (row 1)")).skip(1);
        assert!(between.clone().all(|row| row.theta.constant() == Some(0.0)) && between.count() == 3, "{frames:#?}");
    }

    #[test]
    fn what_is_quarter_turns_stays_exact() {
        let rows = rows(
            [0.0, 0.0, 0.3].map(Expression::Number),
            roll_pitch_yaw([1e-10 - FRAC_PI_2, 0.0, 0.0]),
            Some((Motion::Turn(Expression::Symbol("q1".to_owned())), [0.0, 1.0, 0.0])),
        );
        let constant = |cell: &Expression| cell.affine().map(|affine| affine.constant);
        let angles = rows.iter().flat_map(|[theta, _, _, alpha]| [constant(theta), constant(alpha)]);
        assert!(angles.flatten().all(|angle| (angle / FRAC_PI_2).fract() == 0.0), "{rows:?}");
    }

    #[test]
    fn a_reflection_is_no_rotation() {
        assert!(distance_from_rotation(&roll_pitch_yaw([0.3, -0.2, 1.0])) < 1e-15);
        assert_eq!(distance_from_rotation(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]), f64::INFINITY);
        assert!(distance_from_rotation(&[[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) > 0.01);
    }
}

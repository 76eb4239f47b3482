//! How a device moves while some of its joints are free: what turns with what, and where things are.
//!
//! Orientations and positions are kept apart. A *turning* is one free joint's rotation about the z axis of its own
//! axes, on top of another turning; frames whose orientations differ by a constant rotation share a turning, however
//! their chains reach it. A *place* is a sum of vectors, each constant in the axes of one turning. So a link that
//! keeps the orientation of another one is found from the frames, and locked joints are constant rotations.
//!
//! The product of many constant rotations is a polynomial of very many terms. Once it has more than [`LONG`] it becomes
//! a turning without a joint, which stands still, and is computed like the others.

use std::collections::BTreeMap;

use dynid_model::{Convention, Device};

use crate::{
    DeriveError,
    algebra::{Affine, Algebra, AngleSum, Polynomial, angle_sum},
    arithmetic::Arithmetic,
    spatial::{Axis, Matrix, Vector, column, identity, product, rotation, transposed, z_to_x},
};

/// A rotation by `factor * q[joint] + offset` about z, after the constant rotation `fixed` from the axes of `parent`.
#[derive(Debug, Clone)]
pub struct Turning<A: Arithmetic> {
    /// Index of the turning below; 0 is the base, which does not turn.
    pub parent: usize,
    /// From the axes before the joint's rotation to those of `parent`.
    pub fixed: Matrix<Polynomial<A>>,
    /// The free joint; none of the base, and of a long constant rotation.
    pub joint: Option<usize>,
    /// How far it turns per unit of the joint variable.
    pub factor: f64,
    /// Where it stands at 0 (rad); only what is no quarter turn, which would fill `fixed` with numbers.
    pub offset: f64,
}

/// A vector in the axes of one turning: `constant + sum(slope * q)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment<A: Arithmetic> {
    /// The part that does not change (m).
    pub constant: Vector<Polynomial<A>>,
    /// By free joint; none is zero.
    pub slides: BTreeMap<usize, Vector<Polynomial<A>>>,
}

/// A position as a sum of vectors, by the turning in whose axes they stand; none is zero.
pub type Place<A> = BTreeMap<usize, Segment<A>>;

/// A link's frame: `R(turning) rotation` and a place.
#[derive(Debug, Clone)]
pub struct Body<A: Arithmetic> {
    /// Link number, from 1.
    pub link: usize,
    /// Whose axes it turns with.
    pub turning: usize,
    /// From the link's frame to the axes of the turning.
    pub rotation: Matrix<Polynomial<A>>,
    /// Origin of the link's frame.
    pub place: Place<A>,
}

/// A device whose joints of `free` move.
#[derive(Debug, Clone)]
pub struct Tree<A: Arithmetic> {
    /// Parents come before their children; the first is the base.
    pub turnings: Vec<Turning<A>>,
    /// One per link.
    pub bodies: Vec<Body<A>>,
    /// A polynomial of more terms is long.
    most_terms: usize,
}

/// Terms of a polynomial that may be multiplied by another one; a numerical choice.
pub const LONG: usize = 64;

/// Where a frame stands.
#[derive(Debug, Clone)]
struct Cursor<A: Arithmetic> {
    turning: usize,
    rotation: Matrix<Polynomial<A>>,
    place: Place<A>,
}

impl<A: Arithmetic> Tree<A> {
    /// Follows the rows of the frames table.
    ///
    /// # Errors
    /// A row that is no Denavit-Hartenberg row with affine joint variables.
    pub fn new(algebra: &Algebra<A>, device: &Device, free: &[usize]) -> Result<Tree<A>, DeriveError> {
        Self::with_long(LONG, algebra, device, free)
    }

    /// As [`Self::new`], polynomials of more than so many terms being long.
    ///
    /// # Errors
    /// As there.
    pub fn with_long(
        most_terms: usize,
        algebra: &Algebra<A>,
        device: &Device,
        free: &[usize],
    ) -> Result<Tree<A>, DeriveError> {
        let base = Turning { parent: 0, fixed: identity(algebra), joint: None, factor: 0.0, offset: 0.0 };
        let mut tree = Tree { turnings: vec![base], bodies: Vec::new(), most_terms };
        let origin = Cursor { turning: 0, rotation: identity(algebra), place: Place::new() };
        let mut cursors: Vec<Cursor<A>> = Vec::new();
        for frame in &device.frames {
            let problem = |what: String| DeriveError::frame(device, frame, what);
            let mut cursor = frame.parent.map_or(&origin, |parent| &cursors[parent]).clone();
            let theta = angle_sum(&frame.theta).map_err(problem)?;
            let alpha = angle_sum(&frame.alpha).map_err(problem)?;
            let d = algebra.length(&frame.d).map_err(problem)?;
            let a = algebra.length(&frame.a).map_err(problem)?;
            let affine = |length: &Polynomial<A>| {
                algebra
                    .affine_in_positions(length, free)
                    .ok_or_else(|| problem("a length is an affine function of the joint variables".to_owned()))
            };
            let (d, a) = (affine(&d)?, affine(&a)?);
            match device.convention {
                Convention::Standard => {
                    tree.turn(algebra, &mut cursor, Axis::Z, &theta, free);
                    tree.shift(algebra, &mut cursor, Axis::Z, &d);
                    tree.shift(algebra, &mut cursor, Axis::X, &a);
                    tree.turn(algebra, &mut cursor, Axis::X, &alpha, free);
                }
                Convention::Modified => {
                    tree.turn(algebra, &mut cursor, Axis::X, &alpha, free);
                    tree.shift(algebra, &mut cursor, Axis::X, &a);
                    tree.turn(algebra, &mut cursor, Axis::Z, &theta, free);
                    tree.shift(algebra, &mut cursor, Axis::Z, &d);
                }
            }
            cursors.push(cursor);
        }
        tree.bodies = (device.links.iter().zip(1..))
            .map(|(link, number)| {
                let Cursor { turning, rotation, place } = cursors[link.frame].clone();
                Body { link: number, turning, rotation, place }
            })
            .collect();
        Ok(tree)
    }

    /// True where `ancestor` is `turning` or below it.
    pub fn carries(&self, ancestor: usize, mut turning: usize) -> bool {
        while turning > ancestor {
            turning = self.turnings[turning].parent;
        }
        turning == ancestor
    }

    /// Whether a turning does not move: the base, and what only constant rotations join to it.
    pub fn stands_still(&self, mut turning: usize) -> bool {
        while turning != 0 && self.turnings[turning].joint.is_none() {
            turning = self.turnings[turning].parent;
        }
        turning == 0
    }

    fn is_long(&self, vector: &Vector<Polynomial<A>>) -> bool {
        vector.iter().any(|component| component.n_terms() > self.most_terms)
    }

    /// Makes a long constant rotation a turning, so that it is not multiplied out further.
    fn keep_apart(&mut self, algebra: &Algebra<A>, cursor: &mut Cursor<A>) {
        if !cursor.rotation.iter().any(|row| self.is_long(row)) {
            return;
        }
        let parent = cursor.turning;
        let fixed = std::mem::replace(&mut cursor.rotation, identity(algebra));
        let same = |known: &Turning<A>| known.parent == parent && known.joint.is_none() && known.fixed == fixed;
        cursor.turning = self.turnings.iter().position(same).unwrap_or(self.turnings.len());
        if cursor.turning == self.turnings.len() {
            self.turnings.push(Turning { parent, fixed, joint: None, factor: 0.0, offset: 0.0 });
        }
    }

    /// Turns a frame about one of its axes.
    fn turn(&mut self, algebra: &Algebra<A>, cursor: &mut Cursor<A>, axis: Axis, angle: &AngleSum, free: &[usize]) {
        let (moving, still) = angle.factors.iter().partition(|(joint, _)| free.contains(joint));
        let moving: BTreeMap<usize, f64> = moving;
        let turns_afterwards = axis == Axis::Z && !moving.is_empty() && !angle.is_in_quarters();
        let constant = if turns_afterwards { 0.0 } else { angle.constant };
        let still: BTreeMap<usize, f64> = still;
        let of_joint = |(joint, factor)| AngleSum { factors: [(joint, factor)].into(), constant: 0.0 };
        let constant = AngleSum { factors: BTreeMap::new(), constant };
        for part in still.into_iter().map(of_joint).chain([constant]) {
            self.keep_apart(algebra, cursor);
            let fixed = rotation(algebra, axis, &algebra.cos_sin(&part));
            cursor.rotation = product(algebra, &cursor.rotation, &fixed);
        }
        let n_known = self.turnings.len();
        for (joint, factor) in moving {
            match axis {
                Axis::Z => self.spin(algebra, cursor, joint, factor),
                Axis::X => {
                    let to_x = z_to_x(algebra);
                    cursor.rotation = product(algebra, &cursor.rotation, &to_x);
                    self.spin(algebra, cursor, joint, factor);
                    cursor.rotation = product(algebra, &cursor.rotation, &transposed(&to_x));
                }
            }
        }
        if turns_afterwards {
            self.turn_by(algebra, cursor, angle.constant, n_known);
        }
    }

    /// Turns a frame about its z axis: its turning's offset, where that is none of the first `n_known`, whose axes others use.
    fn turn_by(&mut self, algebra: &Algebra<A>, cursor: &mut Cursor<A>, angle: f64, n_known: usize) {
        if cursor.turning >= n_known && cursor.rotation == identity(algebra) {
            self.turnings[cursor.turning].offset = angle;
        } else {
            cursor.rotation = product(algebra, &cursor.rotation, &about_z(algebra, angle));
        }
    }

    /// Adds `Rz(factor * q[joint])` to a frame's orientation.
    fn spin(&mut self, algebra: &Algebra<A>, cursor: &mut Cursor<A>, joint: usize, factor: f64) {
        if factor == 0.0 {
            return;
        }
        // Rotations about parallel axes commute: an earlier one by the same joint takes this one in.
        let mut run = Vec::new();
        let mut after = cursor.rotation.clone();
        let mut turning = cursor.turning;
        let mut sign = 1.0;
        while let Some(known) = self.turnings[turning].joint {
            match along_z(&after) {
                Some(direction) => sign *= direction,
                None => break,
            }
            run.push(turning);
            let Turning { parent, fixed, factor: known_factor, .. } = self.turnings[turning].clone();
            let total = known_factor + sign * factor;
            if known == joint && (total == 0.0 || algebra.reaches(joint, total)) {
                return self.rebuild(algebra, cursor, &run, total);
            }
            after = fixed;
            turning = parent;
        }
        let axis = column(&cursor.rotation, 2);
        let turns_alike = |child: &Turning<A>| {
            child.parent == cursor.turning && child.joint == Some(joint) && (child.factor.abs() == factor.abs()) && {
                let same = child.factor == factor;
                let known = column(&child.fixed, 2);
                (0..3).all(|k| if same { known[k] == axis[k] } else { known[k] == -&axis[k] })
            }
        };
        match (1..self.turnings.len()).find(|&child| turns_alike(&self.turnings[child])) {
            Some(child) => {
                let Turning { fixed, offset, .. } = &self.turnings[child];
                cursor.rotation = product(algebra, &transposed(fixed), &cursor.rotation);
                cursor.rotation = product(algebra, &about_z(algebra, -offset), &cursor.rotation);
                cursor.turning = child;
            }
            None => {
                let fixed = std::mem::replace(&mut cursor.rotation, identity(algebra));
                self.turnings.push(Turning { parent: cursor.turning, fixed, joint: Some(joint), factor, offset: 0.0 });
                cursor.turning = self.turnings.len() - 1;
            }
        }
    }

    /// Builds a run of parallel rotations (last first) again, the first of them turning by `total` instead.
    fn rebuild(&mut self, algebra: &Algebra<A>, cursor: &mut Cursor<A>, run: &[usize], total: f64) {
        let last = cursor.rotation.clone();
        let chain: Vec<Turning<A>> = run.iter().rev().map(|&turning| self.turnings[turning].clone()).collect();
        cursor.turning = chain[0].parent;
        cursor.rotation = chain[0].fixed.clone();
        for (at, turning) in chain.iter().enumerate() {
            let factor = if at == 0 { total } else { turning.factor };
            // There is one: a run ends at a turning without.
            turning.joint.into_iter().for_each(|joint| self.spin(algebra, cursor, joint, factor));
            cursor.rotation = product(algebra, &cursor.rotation, &about_z(algebra, turning.offset));
            let next = chain.get(at + 1).map_or(&last, |next| &next.fixed);
            cursor.rotation = product(algebra, &cursor.rotation, next);
        }
    }

    /// Moves a frame along one of its axes.
    fn shift(&self, algebra: &Algebra<A>, cursor: &mut Cursor<A>, axis: Axis, (constant, slides): &Affine<A>) {
        let direction = column(&cursor.rotation, axis.index());
        let along = |amount: &Polynomial<A>| direction.clone().map(|component| algebra.product(&component, amount));
        self.extend(algebra, &mut cursor.place, cursor.turning, None, along(constant));
        for (&joint, slope) in slides {
            self.extend(algebra, &mut cursor.place, cursor.turning, Some(joint), along(slope));
        }
    }

    /// Adds a vector (times `q[slide]`) to a place. What lies along a turning's own axis does not turn with it, but for axes at general
    /// angles, where every length would reach all turnings below, and where that takes a long polynomial.
    pub fn extend(
        &self,
        algebra: &Algebra<A>,
        place: &mut Place<A>,
        turning: usize,
        slide: Option<usize>,
        mut vector: Vector<Polynomial<A>>,
    ) {
        if turning != 0 && !vector[2].is_zero() {
            let Turning { parent, fixed, .. } = &self.turnings[turning];
            let axis = column(fixed, 2);
            let is_general = axis.iter().any(|component| algebra.has_constant_angles(component));
            let n_products = vector[2].n_terms() * axis.iter().map(Polynomial::n_terms).max().unwrap_or(0);
            if !is_general && n_products <= self.most_terms {
                let below = axis.map(|component| algebra.product(&component, &vector[2]));
                vector[2] = algebra.zero();
                self.extend(algebra, place, *parent, slide, below);
            }
        }
        if vector.iter().all(Polynomial::is_zero) {
            return;
        }
        let none = || [(); 3].map(|()| algebra.zero());
        let segment = place.entry(turning).or_insert_with(|| Segment { constant: none(), slides: BTreeMap::new() });
        let sum = match slide {
            None => &mut segment.constant,
            Some(joint) => segment.slides.entry(joint).or_insert_with(none),
        };
        *sum = [0, 1, 2].map(|k| &sum[k] + &vector[k]);
        segment.slides.retain(|_, slope| !slope.iter().all(Polynomial::is_zero));
        if segment.slides.is_empty() && segment.constant.iter().all(Polynomial::is_zero) {
            place.remove(&turning);
        }
    }
}

fn about_z<A: Arithmetic>(algebra: &Algebra<A>, angle: f64) -> Matrix<Polynomial<A>> {
    rotation(algebra, Axis::Z, &algebra.cos_sin(&AngleSum { factors: BTreeMap::new(), constant: angle }))
}

/// 1 or -1 where a rotation keeps or reverses z.
fn along_z<A: Arithmetic>(rotation: &Matrix<Polynomial<A>>) -> Option<f64> {
    rotation[2][2].as_integer().filter(|value| value.abs() == 1).map(|value| value as f64)
}

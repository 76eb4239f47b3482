//! 3-vectors and rotation matrices, of polynomials and of program terms.

use dynid_lower::{Node, Program};

use crate::algebra::{Algebra, Polynomial};
use crate::arithmetic::Arithmetic;

/// Components along x, y, z.
pub type Vector<T> = [T; 3];
/// Rows of a 3x3 matrix.
pub type Matrix<T> = [[T; 3]; 3];

/// The axis that a Denavit-Hartenberg step turns about or moves along.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// x
    X,
    /// z
    Z,
}

impl Axis {
    /// Position of its component in a vector.
    pub fn index(self) -> usize {
        match self {
            Axis::X => 0,
            Axis::Z => 2,
        }
    }
}

/// The unit matrix.
pub fn identity<A: Arithmetic>(algebra: &Algebra<A>) -> Matrix<Polynomial<A>> {
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| algebra.integer(i64::from(row == column))))
}

/// The rotation about an axis, from the angle's cosine and sine.
pub fn rotation<A: Arithmetic>(
    algebra: &Algebra<A>,
    axis: Axis,
    (cosine, sine): &(Polynomial<A>, Polynomial<A>),
) -> Matrix<Polynomial<A>> {
    let (zero, one) = (algebra.zero(), algebra.integer(1));
    let (c, s, minus_s) = (cosine.clone(), sine.clone(), -sine);
    match axis {
        Axis::X => [[one, zero.clone(), zero.clone()], [zero.clone(), c.clone(), minus_s], [zero, s, c]],
        Axis::Z => [[c.clone(), minus_s, zero.clone()], [s, c, zero.clone()], [zero.clone(), zero, one]],
    }
}

/// The rotation that takes z to x, x to y and y to z.
pub fn z_to_x<A: Arithmetic>(algebra: &Algebra<A>) -> Matrix<Polynomial<A>> {
    let (zero, one) = (|| algebra.zero(), || algebra.integer(1));
    [[zero(), zero(), one()], [one(), zero(), zero()], [zero(), one(), zero()]]
}

/// `a b` in normal form.
pub fn product<A: Arithmetic>(
    algebra: &Algebra<A>,
    a: &Matrix<Polynomial<A>>,
    b: &Matrix<Polynomial<A>>,
) -> Matrix<Polynomial<A>> {
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| algebra.dot((0..3).map(|k| (&a[row][k], &b[k][column])))))
}

/// The transpose.
pub fn transposed<T: Clone>(matrix: &Matrix<T>) -> Matrix<T> {
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| matrix[column][row].clone()))
}

/// One column.
pub fn column<T: Clone>(matrix: &Matrix<T>, index: usize) -> Vector<T> {
    [0, 1, 2].map(|row| matrix[row][index].clone())
}

/// `a + b`, of program terms.
pub fn add(program: &mut Program, a: Vector<Node>, b: Vector<Node>) -> Vector<Node> {
    [0, 1, 2].map(|k| program.add(a[k], b[k]))
}

/// `factor * a`, of program terms.
pub fn scale(program: &mut Program, factor: Node, a: Vector<Node>) -> Vector<Node> {
    a.map(|component| program.multiply(factor, component))
}

/// `a . b`, of program terms.
pub fn dot(program: &mut Program, a: Vector<Node>, b: Vector<Node>) -> Node {
    let products = [0, 1, 2].map(|k| program.multiply(a[k], b[k]));
    program.sum(&products)
}

/// `a x b`, of program terms.
pub fn cross(program: &mut Program, a: Vector<Node>, b: Vector<Node>) -> Vector<Node> {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| {
        let plus = program.multiply(a[i], b[j]);
        let minus = program.multiply(a[j], b[i]);
        program.subtract(plus, minus)
    })
}

/// `matrix a`, of program terms.
pub fn apply(program: &mut Program, matrix: &Matrix<Node>, a: Vector<Node>) -> Vector<Node> {
    [0, 1, 2].map(|row| dot(program, matrix[row], a))
}

/// A symmetric matrix by its entries xx, xy, xz, yy, yz, zz.
pub type Symmetric = [Node; 6];

/// Where entry (row, column) of a [`Symmetric`] matrix stands.
pub fn entry(row: usize, column: usize) -> usize {
    [[0, 1, 2], [1, 3, 4], [2, 4, 5]][row][column]
}

/// The six different entries of a symmetric matrix: (row, column).
pub const ENTRIES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// `rotation matrix rotation^T`, of program terms.
pub fn rotate_symmetric(program: &mut Program, rotation: &Matrix<Node>, matrix: &Symmetric) -> Symmetric {
    let columns = [0, 1, 2].map(|column| apply(program, rotation, [0, 1, 2].map(|row| matrix[entry(row, column)])));
    ENTRIES.map(|(row, column)| {
        let left = [0, 1, 2].map(|k| columns[k][row]);
        dot(program, left, rotation[column])
    })
}

//! A cost near a point.

use nalgebra::{DMatrix, DVector};

/// A cost near a point: `cost + gradient . d + d . hessian d / 2`.
#[derive(Debug, Clone, PartialEq)]
pub struct Quadratic {
    /// At the point.
    pub cost: f64,
    /// There.
    pub gradient: DVector<f64>,
    /// Second derivative, or what stands for it: symmetric, positive semi-definite.
    pub hessian: DMatrix<f64>,
}

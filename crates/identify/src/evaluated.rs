//! What residuals are at some values.

/// Least and largest values.
pub type Bounds = (Vec<f64>, Vec<f64>);

/// Residuals with their derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluated {
    /// The residuals.
    pub residuals: Vec<f64>,
    /// Their derivatives, one row a residual.
    pub jacobian: Vec<f64>,
}

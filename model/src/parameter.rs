//! A value with its bounds.

/// One number of a model: its value, the range it may take and whether a fit may move it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// In the SI unit of the quantity.
    pub value: f64,
    /// Smallest value that a fit may return; `-inf` where there is none.
    pub lower: f64,
    /// Largest value that a fit may return; `inf` where there is none.
    pub upper: f64,
    /// A fixed parameter is known: no fit moves it.
    pub fixed: bool,
}

impl Parameter {
    /// A known value.
    pub const fn known(value: f64) -> Self {
        Self { value, lower: value, upper: value, fixed: true }
    }

    /// Whether a value lies within the bounds.
    pub fn contains(&self, value: f64) -> bool {
        (self.lower..=self.upper).contains(&value)
    }
}

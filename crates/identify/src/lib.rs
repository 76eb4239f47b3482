//! Parameter identification: from a model and logs to fitted values with standard errors ([`identify::identify`]).
//!
//! - [`position`]: nonlinear least squares on the position error (output error), by simulation with [`sensitivity`] equations;
//! - [`torque`]: least squares on the torque error (equation error);
//! - [`sequence`]: a method, one configuration after another; estimates are handed on with their information;
//! - [`residuals`]: what fits make small, with its Jacobian, for other optimisers;
//! - [`starts`]: random starts within the bounds;
//! - [`checkpoint`]: the file from which an interrupted fit goes on.
//!
//! # States
//!
//! Each layer of a position fit has a state that its `watch` function is shown after every iteration, and from which it can go
//! on: `sqp::State` within [`position::State`] within [`sequence::State`] within [`identify::State`]. A state holds only what
//! cannot be computed anew. Cost and derivatives depend on the point alone, so that a resumed fit takes the same steps to the
//! last bit. Whoever changes what a search carries from one iteration to the next adds it to the state and raises `FORMAT` in
//! `checkpoint.rs`.

pub mod checkpoint;
mod error;
mod error_budget;
mod evaluated;
mod follows_log;
pub mod identify;
mod plan;
pub mod position;
pub mod prediction;
pub mod residuals;
pub mod sensitivity;
pub mod sequence;
pub mod starts;
pub mod torque;

pub use dynid_optimise::sqp::SearchControl;
pub use error::FitError;
pub use follows_log::{stays_near, steps_beside, strays};

use dynid_model::{Link, expression::Comparison};

use serde::{Deserialize, Serialize};

use dynid_user_model::Model;

/// `(larger, smaller)`: names of the parameters of which the effects of `model` want one not below the other, e.g.
/// LuGre's `Fs >= Fc` (thesis Eq. 4.1).
pub fn orders(model: &Model) -> Vec<(String, String)> {
    let mut orders = Vec::new();
    for instance in &model.effects {
        let name = |symbol: &str| {
            let index = instance.effect.parameters.iter().position(|parameter| parameter.symbol == symbol)?;
            Some(instance.parameter_name(index))
        };
        for (left, comparison, right) in &instance.effect.inequalities {
            let (Some(left), Some(right)) = (name(left), name(right)) else { continue };
            orders.push(match comparison {
                Comparison::Greater => (left, right),
                Comparison::Less => (right, left),
            });
        }
    }
    orders
}

/// How a fit ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum FitStatus {
    /// Step and gradient are below tolerance.
    Converged,
    /// Converged, and at least one parameter is held by its bound or by physics, not by the data.
    HeldByBound,
    /// Converged, and some parameters or combinations do not change the prediction: they kept their start values.
    NotIdentifiable,
    /// Too many iterations.
    IterationLimit,
    /// The cost is not finite, or no step lowers it although the gradient is not small.
    NumericalError,
}

impl FitStatus {
    /// Whether the result is a minimum, so that a model may take it.
    pub fn may_update_model(self) -> bool {
        matches!(self, Self::Converged | Self::HeldByBound | Self::NotIdentifiable)
    }

    /// As it stands in files and reports.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::HeldByBound => "held by bound",
            Self::NotIdentifiable => "not identifiable",
            Self::IterationLimit => "iteration limit",
            Self::NumericalError => "numerical error",
        }
    }
}

/// `link.<n>.<symbol>` as number and place of the symbol.
fn link_parameter(name: &str) -> Option<(usize, usize)> {
    let (number, symbol) = name.strip_prefix("link.")?.split_once('.')?;
    Some((number.parse().ok()?, Link::SYMBOLS.iter().position(|known| *known == symbol)?))
}

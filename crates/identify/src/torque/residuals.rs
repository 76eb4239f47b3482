//! The torque error and its derivatives at any values of the unknowns, for optimisers outside of this crate.

use std::collections::BTreeMap;

use dynid_user_model::Model;
use nalgebra::DMatrix;
use rayon::prelude::*;

use super::{Data, JointRows, Layout, PRIOR_SCALES, RigidColumns, TorqueFitError, TorqueRun, rigid_columns, run_rows};
use crate::evaluated::{Bounds, Evaluated};

/// The torque errors of all runs to fit to, each over the standard deviation of its joint's at the start, then the weak prior about the
/// start. Half the sum of their squares is what a torque fit makes small for these standard deviations, which it finds along with the
/// parameters: at its result they are the same.
pub struct TorqueResiduals {
    layout: Layout,
    runs: Vec<TorqueRun>,
    rigid: Vec<Vec<RigidColumns>>,
    /// Standard deviation of each joint's torque error [unit of the command].
    sigma: BTreeMap<usize, f64>,
}

impl TorqueResiduals {
    /// Of these runs, which all are fitted to, from the values of `model` on.
    ///
    /// # Errors
    /// No run, one without samples, nothing to fit.
    pub fn new(model: &Model, runs: Vec<TorqueRun>) -> Result<Self, TorqueFitError> {
        let all: Vec<&TorqueRun> = runs.iter().collect();
        super::check_runs(&all)?;
        let layout = Layout::new(&all, &model.parameters())?;
        let rigid: Vec<Vec<RigidColumns>> = runs.iter().map(|run| rigid_columns(&run.system, &run.motion)).collect();
        let data = Data::new(&layout, &all, &rigid, &layout.start, false);
        let layout = layout.touched(&data);
        if layout.start.is_empty() {
            return Err(TorqueFitError::NothingToFit);
        }
        Ok(Self { layout, runs, rigid, sigma: data.deviations() })
    }

    /// Names of the unknowns.
    pub fn names(&self) -> Vec<String> {
        self.layout.names.clone()
    }

    /// The values of the model.
    pub fn start(&self) -> &[f64] {
        &self.layout.start
    }

    /// Between which values each unknown may lie.
    pub fn bounds(&self) -> Bounds {
        (self.layout.lower.clone(), self.layout.upper.clone())
    }

    /// All of them at `x`.
    pub fn at(&self, x: &[f64]) -> Vec<f64> {
        let of_run = |own: &JointRows| -> Vec<f64> {
            let sigma = self.sigma[&own.joint];
            own.counted().map(|residual| residual / sigma).collect()
        };
        let errors = self.rows(x).iter().flat_map(of_run).collect::<Vec<f64>>();
        errors.into_iter().chain(self.prior(x)).collect()
    }

    /// All of them at `x`, with their derivatives by the unknowns.
    pub fn with_jacobian(&self, x: &[f64]) -> Evaluated {
        let n = x.len();
        let by_x = self.layout.jacobian(x);
        let (mut residuals, mut jacobian) = (Vec::new(), Vec::new());
        for own in self.rows(x) {
            let sigma = self.sigma[&own.joint];
            residuals.extend(own.counted().map(|residual| residual / sigma));
            let rows: DMatrix<f64> = own.matrix.columns(0, own.spread.nrows()) * (&own.spread * &by_x) / -sigma;
            jacobian.extend(rows.transpose().iter());
        }
        residuals.extend(self.prior(x));
        for (row, scale) in self.layout.scale.iter().enumerate() {
            jacobian.extend((0..n).map(|column| if column == row { 1.0 / (PRIOR_SCALES * scale) } else { 0.0 }));
        }
        Evaluated { residuals, jacobian }
    }

    /// The equations of all runs about `x`, in their order.
    fn rows(&self, x: &[f64]) -> Vec<JointRows> {
        let of_run = |(run, rigid): (&TorqueRun, &Vec<RigidColumns>)| run_rows(&self.layout, run, rigid, x);
        let rows: Vec<Vec<JointRows>> = self.runs.par_iter().zip(&self.rigid).map(of_run).collect();
        rows.into_iter().flatten().collect()
    }

    fn prior(&self, x: &[f64]) -> impl Iterator<Item = f64> {
        let layout = &self.layout;
        x.iter().zip(&layout.start).zip(&layout.scale).map(|((x, start), scale)| (x - start) / (PRIOR_SCALES * scale))
    }
}

//! Where the unknowns of a fit enter one of its runs.

use nalgebra::DMatrix;

use super::{FitRun, Unknown};
use crate::sensitivity::{self, Columns, Lumps};
use dynid_dynamics::{simulate::Options, simulate::Predictor, simulate::Scheme, system::System};

/// Where an unknown enters a run.
#[derive(Debug, Clone, Copy)]
enum Role {
    /// Index among the kernel's parameters.
    Link(usize),
    /// Index among the system's effect parameters.
    Effect(usize),
}

/// A run's own unknowns: parameters that occur in it, its initial positions (and speeds), and the rates of a predictor.
#[derive(Debug, Clone)]
pub(crate) struct RunUnknowns {
    columns: Columns,
    /// Unknown and its role; unknowns without one do not occur here.
    roles: Vec<(usize, Role)>,
    /// Indices of the initial positions, then speeds, among all unknowns.
    initial: std::ops::Range<usize>,
    /// Index of each free joint's rate among all unknowns; none where no predictor is at work.
    rates: Vec<usize>,
}

impl RunUnknowns {
    /// Of `run`, whose initial positions stand from `first_initial` on among all unknowns.
    pub(crate) fn new(run: &FitRun, unknowns: &[Unknown], first_initial: usize) -> Self {
        let system = &run.system;
        let mut roles = Vec::new();
        for (unknown, entry) in unknowns.iter().enumerate() {
            let name = entry.name.as_str();
            if let Some(index) = system.kernel().parameters.iter().position(|known| *known == name) {
                roles.push((unknown, Role::Link(index)));
            } else if let Some(index) = system.effect_names().iter().position(|known| known == name) {
                roles.push((unknown, Role::Effect(index)));
            }
        }
        let lumps =
            if roles.iter().any(|(_, role)| matches!(role, Role::Link(_))) { Lumps::Wanted } else { Lumps::Known };
        let wanted = |name: &str| unknowns.iter().any(|unknown| unknown.name == name);
        let columns = Columns::new(system, wanted, lumps);
        let columns = if run.moving { columns.moving(system.n_free()) } else { columns };
        Self { columns, roles, initial: first_initial..first_initial + run.n_initial(), rates: Vec::new() }
    }

    /// With a predictor, whose rates stand at these places among all unknowns.
    #[must_use]
    pub(crate) fn predicting(self, rates: Vec<usize>) -> Self {
        Self { columns: self.columns.predicting(rates.len()), rates, ..self }
    }

    pub(crate) fn columns(&self) -> &Columns {
        &self.columns
    }

    /// Number of parameters that occur.
    pub(crate) fn n_parameters(&self) -> usize {
        self.roles.len()
    }

    /// The run's system with the values of `x`.
    pub(crate) fn system(&self, run: &FitRun, x: &[f64]) -> System {
        let mut system = run.system.clone();
        let mut links = system.link_parameters().to_vec();
        let mut effects = system.effect_parameters().to_vec();
        for &(unknown, role) in &self.roles {
            match role {
                Role::Link(index) => links[index] = x[unknown],
                Role::Effect(index) => effects[index] = x[unknown],
            }
        }
        system.set_parameters(&links, &effects);
        system
    }

    pub(crate) fn initial<'x>(&self, x: &'x [f64]) -> &'x [f64] {
        &x[self.initial.clone()]
    }

    /// The rates of the predictor [1/s].
    pub(crate) fn rates(&self, x: &[f64]) -> Vec<f64> {
        self.rates.iter().map(|index| x[*index]).collect()
    }

    /// Derivative of the columns by this run's unknowns: parameters in the order of `roles`, then initial positions, then rates.
    pub(crate) fn chain(&self, system: &System) -> DMatrix<f64> {
        let kernel = system.kernel();
        let n_links = kernel.parameters.len();
        let mut by_link = vec![0.0; kernel.prepared.len() * n_links];
        if !self.columns.lumps().is_empty() {
            kernel.functions.prepare_gradient(system.link_parameters(), system.locked(), &mut by_link);
        }
        let mut chain = DMatrix::zeros(self.columns.count(), self.places().len());
        for (own, (_, role)) in self.roles.iter().enumerate() {
            match role {
                Role::Link(index) => {
                    for (lump, column) in self.columns.lumps().enumerate() {
                        chain[(column, own)] = by_link[lump * n_links + index];
                    }
                }
                Role::Effect(index) => {
                    if let Some(column) = self.columns.effect(*index) {
                        chain[(column, own)] = 1.0;
                    }
                }
            }
        }
        for (slot, column) in self.columns.initial().chain(self.columns.rates()).enumerate() {
            chain[(column, self.roles.len() + slot)] = 1.0;
        }
        chain
    }

    /// Predicts the run with these rates [1/s] and hands each sample that counts to `observe`: its index, the predictions and their
    /// derivatives by the columns; returns what makes derivatives by this run's unknowns of those.
    pub(crate) fn along(
        &self,
        run: &FitRun,
        x: &[f64],
        (rates, schemes): (&[f64], &[Scheme]),
        mut observe: impl FnMut(usize, &[f64], &[f64]),
    ) -> Option<DMatrix<f64>> {
        let system = self.system(run, x);
        let predictor = Predictor { position: &run.position, rates, schemes };
        let first = run.first_sample();
        let counted = |sample: usize, position: &[f64], rows: &[f64]| {
            if sample >= first {
                observe(sample, position, rows);
            }
        };
        let options = Options::default();
        sensitivity::predict(&system, &self.columns, &run.input(), &predictor, self.initial(x), &options, counted)
            .ok()?;
        Some(self.chain(&system))
    }

    /// Index among all unknowns of each of this run's own.
    pub(crate) fn places(&self) -> Vec<usize> {
        let parameters = self.roles.iter().map(|(unknown, _)| *unknown);
        parameters.chain(self.initial.clone()).chain(self.rates.iter().copied()).collect()
    }
}

//! A sequence of configurations that the program finds itself.
//!
//! Of the device's configurations the next is the one with the fewest new unknowns that still
//! reveals something new: a parameter not met yet, or a direction of the linear parameters that the earlier ones left flat.
//! The sequence ends when what all configurations reveal together is revealed.

use std::collections::BTreeSet;

use nalgebra::DMatrix;

use super::{
    base::{Analysis, independent},
    depends_on,
};
use crate::PlanError;
use dynid_user_model::Model;

/// A configuration that may come next.
struct Next {
    /// Number of new parameters, number of free joints, place in the device's list: the least comes first.
    order: (usize, usize, usize),
    /// What it and the earlier ones reveal together.
    rows: DMatrix<f64>,
    rank: usize,
}

/// Numbers of the configurations, from 1, in the order found.
pub(super) fn sequence(model: &Model) -> Result<Vec<usize>, PlanError> {
    let device = model.device;
    let free: Vec<Vec<usize>> = device.configurations.iter().map(|known| known.free.clone()).collect();
    let kernels = free.iter().map(|free| dynid_kernels::kernel(device, free)).collect::<Result<Vec<_>, _>>()?;
    let analysis = Analysis::new(model, &free)?;
    let revealed: Vec<DMatrix<f64>> = (0..free.len()).map(|index| analysis.revealed(index)).collect();
    let parameters: Vec<BTreeSet<String>> =
        kernels.iter().map(|kernel| depends_on(model, kernel).into_iter().collect()).collect();
    let mut left: Vec<usize> = (0..free.len()).collect();
    let mut seen = BTreeSet::new();
    let mut span = DMatrix::zeros(0, analysis.parameters.names.len());
    let mut rank = 0;
    let mut sequence = Vec::new();
    while !left.is_empty() {
        let mut best: Option<Next> = None;
        // What reveals nothing new now never will.
        let mut useful = Vec::new();
        for &index in &left {
            let n_new = parameters[index].difference(&seen).count();
            let rows = stacked(&span, &revealed[index]);
            let reached = independent(&rows).len();
            if n_new == 0 && reached == rank {
                continue;
            }
            useful.push(index);
            let order = (n_new, kernels[index].free.len(), index);
            if best.as_ref().is_none_or(|least| order < least.order) {
                best = Some(Next { order, rows, rank: reached });
            }
        }
        let Some(Next { order: (.., index), rows, rank: reached }) = best else { break };
        span = rows.qr().r();
        rank = reached;
        seen.extend(parameters[index].iter().cloned());
        sequence.push(index + 1);
        left = useful.into_iter().filter(|other| *other != index).collect();
    }
    Ok(sequence)
}

fn stacked(above: &DMatrix<f64>, below: &DMatrix<f64>) -> DMatrix<f64> {
    let mut rows = DMatrix::zeros(above.nrows() + below.nrows(), below.ncols());
    rows.rows_mut(0, above.nrows()).copy_from(above);
    rows.rows_mut(above.nrows(), below.nrows()).copy_from(below);
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FOUND, base::base_parameters, plan};

    /// What the sequence reveals is what all configurations reveal, and no step frees more unknowns than the best next one.
    #[test]
    fn every_device_is_revealed_as_far_as_it_can_be() {
        for device in dynid_model::devices() {
            let model = Model::of_device(device);
            let found = plan(&model, FOUND).unwrap();
            let all: Vec<Vec<usize>> = device.configurations.iter().map(|known| known.free.clone()).collect();
            let sequence: Vec<Vec<usize>> = found.steps.iter().map(|step| step.free.clone()).collect();
            let rank = |free: &[Vec<usize>]| {
                let analysis = Analysis::new(&model, free).unwrap();
                let rows = (0..free.len()).fold(DMatrix::zeros(0, analysis.parameters.names.len()), |rows, index| {
                    stacked(&rows, &analysis.revealed(index))
                });
                independent(&rows).len()
            };
            assert_eq!(rank(&sequence), rank(&all), "{}", device.id);
            assert_eq!(rank(&all), base_parameters(&model, &all).unwrap().rank(), "{}", device.id);
            let mut once = sequence.clone();
            once.sort_unstable();
            once.dedup();
            assert_eq!(once.len(), sequence.len(), "{}: {sequence:?}", device.id);
            let first = &found.steps[0];
            assert!(found.steps.iter().all(|step| step.parameters.len() >= first.parameters.len()), "{}", device.id);
        }
    }
}

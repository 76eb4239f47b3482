//! A search without derivatives: separable CMA-ES (Ros & Hansen 2008), whose cost grows linearly with the unknowns.

use rayon::prelude::*;

use dynid_random::Random;

/// The best point found, from `start` with the spread `spread`; smaller is better. The same seed gives the same point on
/// any number of threads.
pub fn minimise(
    cost: &(dyn Fn(&[f64]) -> f64 + Sync),
    start: &[f64],
    spread: f64,
    evaluations: usize,
    seed: u64,
) -> (Vec<f64>, f64) {
    let mut random = Random::new(seed);
    let n = start.len() as f64;
    let n_children = 4 + (3.0 * n.ln()).floor() as usize;
    let n_parents = n_children / 2;
    let raw: Vec<f64> = (1..=n_parents).map(|rank| (n_parents as f64 + 0.5).ln() - (rank as f64).ln()).collect();
    let total: f64 = raw.iter().sum();
    let weights: Vec<f64> = raw.iter().map(|weight| weight / total).collect();
    let mass = 1.0 / weights.iter().map(|weight| weight * weight).sum::<f64>();
    let step_memory = (mass + 2.0) / (n + mass + 5.0);
    let damping = 1.0 + 2.0 * (((mass - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + step_memory;
    let path_memory = (4.0 + mass / n) / (n + 4.0 + 2.0 * mass / n);
    // Learning rates of the full method times (n + 2) / 3: only the diagonal is learnt.
    let faster = (n + 2.0) / 3.0;
    let by_path = (faster * 2.0 / ((n + 1.3).powi(2) + mass)).min(1.0);
    let by_ranks = (faster * 2.0 * (mass - 2.0 + 1.0 / mass) / ((n + 2.0).powi(2) + mass)).min(1.0 - by_path).max(0.0);
    let expected_length = n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n));

    let mut mean = start.to_vec();
    let mut best = (start.to_vec(), cost(start));
    let mut sigma = spread;
    let mut variance = vec![1.0_f64; start.len()];
    let (mut step_path, mut path) = (vec![0.0; start.len()], vec![0.0; start.len()]);
    for generation in 1..=(evaluations / n_children).max(1) {
        let draws: Vec<Vec<f64>> = (0..n_children).map(|_| start.iter().map(|_| random.normal()).collect()).collect();
        let point = |draw: &Vec<f64>| -> Vec<f64> {
            (0..start.len()).map(|k| mean[k] + sigma * variance[k].sqrt() * draw[k]).collect()
        };
        let mut children: Vec<(f64, usize)> =
            draws.par_iter().map(|draw| cost(&point(draw))).collect::<Vec<_>>().into_iter().zip(0..).collect();
        children.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        if children[0].0 < best.1 {
            best = (point(&draws[children[0].1]), children[0].0);
        }
        let parents: Vec<(f64, &Vec<f64>)> =
            weights.iter().zip(&children).map(|(weight, child)| (*weight, &draws[child.1])).collect();
        let move_of = |k: usize| parents.iter().map(|(weight, draw)| weight * draw[k]).sum::<f64>();
        let moves: Vec<f64> = (0..start.len()).map(move_of).collect();
        let mut length = 0.0;
        for k in 0..start.len() {
            mean[k] += sigma * variance[k].sqrt() * moves[k];
            step_path[k] =
                (1.0 - step_memory) * step_path[k] + (step_memory * (2.0 - step_memory) * mass).sqrt() * moves[k];
            length += step_path[k] * step_path[k];
        }
        let length = length.sqrt();
        let usual = (1.0 - (1.0 - step_memory).powi(2 * generation as i32)).sqrt();
        let stalled = length / usual < (1.4 + 2.0 / (n + 1.0)) * expected_length;
        for k in 0..start.len() {
            let scaled = variance[k].sqrt();
            let growth =
                if stalled { (path_memory * (2.0 - path_memory) * mass).sqrt() * scaled * moves[k] } else { 0.0 };
            path[k] = (1.0 - path_memory) * path[k] + growth;
            let ranks: f64 = parents.iter().map(|(weight, draw)| weight * (scaled * draw[k]).powi(2)).sum();
            variance[k] = (1.0 - by_path - by_ranks) * variance[k] + by_path * path[k] * path[k] + by_ranks * ranks;
        }
        sigma *= ((step_memory / damping) * (length / expected_length - 1.0)).exp();
    }
    best
}

#[cfg(test)]
mod tests {
    use super::minimise;

    #[test]
    fn an_ellipsoid_is_found_the_same_every_time() {
        let cost = |x: &[f64]| -> f64 {
            x.iter().enumerate().map(|(k, x)| 10.0_f64.powf(k as f64 / 2.0) * (x - 1.0).powi(2)).sum()
        };
        let (x, value) = minimise(&cost, &[0.0; 8], 0.5, 6000, 7);
        assert!(value < 1e-8, "{value:e} at {x:?}");
        assert_eq!(minimise(&cost, &[0.0; 8], 0.5, 6000, 7).0, x);
    }
}

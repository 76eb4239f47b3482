//! A search without derivatives: the covariance matrix adaptation evolution strategy.
//!
//! Equations are those of Hansen 2016, The CMA Evolution Strategy: A Tutorial (arXiv 1604.00772), appendix A, with the
//! parents' positive weights alone and without the small correction of Eq. 47 while the step's path is too long. Where only
//! the diagonal is learnt it is the separable form (Ros & Hansen 2008), whose cost grows linearly with the unknowns.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use dynid_random::Random;

/// What is learnt of how the unknowns go together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Covariance {
    /// How far each goes by itself: for many unknowns.
    Diagonal,
    /// Every pair, at the price of an eigenvalue problem a generation: for few unknowns that are tied to each other.
    Full,
}

/// How a search goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// What is learnt.
    pub covariance: Covariance,
    /// Standard deviation of the first points about the start, the same for all unknowns.
    pub spread: f64,
    /// About as many points are tried beside the start: whole generations, at least one.
    pub evaluations: usize,
    /// What the points are drawn from.
    pub seed: u64,
    /// When to end before that; `None` where every evaluation may be used.
    pub tolerance: Option<Tolerance>,
}

/// Where nothing is left to be gained (appendix B.3 of the tutorial).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// The last generation's costs, and the least ones of some generations, differ by less.
    pub cost: f64,
    /// Points scatter by less, and move by less, in every unknown.
    pub step: f64,
}

/// The best point found and its cost, smaller being better, from a point and its cost. The same seed gives the same point on
/// any number of threads.
pub fn minimise(cost: &(dyn Fn(&[f64]) -> f64 + Sync), start: (Vec<f64>, f64), options: &Options) -> (Vec<f64>, f64) {
    let mut random = Random::new(options.seed);
    let width = start.0.len();
    let strategy = Strategy::new(width, options.covariance);
    let mut mean = start.0.clone();
    let mut best = start;
    let mut sigma = options.spread;
    let mut learnt = match options.covariance {
        Covariance::Diagonal => Learnt::Diagonal { variance: vec![1.0; width] },
        Covariance::Full => Learnt::Full {
            matrix: DMatrix::identity(width, width),
            axes: DMatrix::identity(width, width),
            lengths: DVector::from_element(width, 1.0),
        },
    };
    let (mut step_path, mut path) = (vec![0.0; width], vec![0.0; width]);
    let mut least = Vec::new();
    for generation in 1..=(options.evaluations / strategy.n_children).max(1) {
        // Eq. 38 to 40: z, y = B D z, x = m + sigma y.
        let draws: Vec<Vec<f64>> =
            (0..strategy.n_children).map(|_| (0..width).map(|_| random.normal()).collect()).collect();
        let point = |draw: &Vec<f64>| -> Vec<f64> {
            mean.iter().zip(learnt.shaped(sigma, draw)).map(|(mean, step)| mean + step).collect()
        };
        let mut children: Vec<(f64, usize)> =
            draws.par_iter().map(|draw| cost(&point(draw))).collect::<Vec<_>>().into_iter().zip(0..).collect();
        children.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        if children[0].0 < best.1 {
            best = (point(&draws[children[0].1]), children[0].0);
        }
        let parents: Vec<(f64, &Vec<f64>)> =
            strategy.weights.iter().zip(&children).map(|(weight, child)| (*weight, &draws[child.1])).collect();
        // Eq. 41 in terms of z: the mean of the parents, of which y is `shaped`.
        let move_of = |k: usize| parents.iter().map(|(weight, draw)| weight * draw[k]).sum::<f64>();
        let moves: Vec<f64> = (0..width).map(move_of).collect();
        // Eq. 42, the whole way.
        mean.iter_mut().zip(learnt.shaped(sigma, &moves)).for_each(|(mean, step)| *mean += step);
        // Eq. 43: C^(-1/2) y is B z.
        let mut length = 0.0;
        for (path, own) in step_path.iter_mut().zip(learnt.turned(&moves)) {
            *path = (1.0 - strategy.step_memory) * *path + strategy.step_growth * own;
            length += *path * *path;
        }
        let length = length.sqrt();
        let usual = (1.0 - (1.0 - strategy.step_memory).powi(2 * generation as i32)).sqrt();
        let is_usual = length / usual < (1.4 + 2.0 / (width as f64 + 1.0)) * strategy.expected_length;
        // Eq. 45: a step that grows quickly tells nothing of the shape.
        let growth = if is_usual { learnt.shaped(strategy.path_growth, &moves) } else { vec![0.0; width] };
        for (path, growth) in path.iter_mut().zip(growth) {
            *path = (1.0 - strategy.path_memory) * *path + growth;
        }
        learnt.learn(&strategy, &path, &parents);
        // Eq. 44.
        sigma *= ((strategy.step_memory / strategy.damping) * (length / strategy.expected_length - 1.0)).exp();
        least.push(children[0].0);
        let spread = children.last().map_or(0.0, |worst| worst.0 - children[0].0);
        if options.tolerance.is_some_and(|tolerance| {
            strategy.is_level(tolerance.cost, spread, &least) || learnt.is_short(tolerance.step, sigma, &path)
        }) {
            break;
        }
    }
    best
}

/// The constants of a search (Eq. 49 to 58), in the tutorial's letters.
struct Strategy {
    /// lambda
    n_children: usize,
    /// w, of the mu parents
    weights: Vec<f64>,
    /// c_sigma
    step_memory: f64,
    /// The root of c_sigma (2 - c_sigma) mu_eff
    step_growth: f64,
    /// d_sigma
    damping: f64,
    /// c_c
    path_memory: f64,
    /// The root of c_c (2 - c_c) mu_eff
    path_growth: f64,
    /// c_1
    by_path: f64,
    /// c_mu
    by_ranks: f64,
    /// Of a vector of normal numbers
    expected_length: f64,
}

impl Strategy {
    fn new(width: usize, covariance: Covariance) -> Self {
        let n = width as f64;
        let n_children = 4 + (3.0 * n.ln()).floor() as usize;
        let n_parents = n_children / 2;
        let raw: Vec<f64> = (1..=n_parents).map(|rank| (n_parents as f64 + 0.5).ln() - (rank as f64).ln()).collect();
        let total: f64 = raw.iter().sum();
        let weights: Vec<f64> = raw.iter().map(|weight| weight / total).collect();
        let mass = 1.0 / weights.iter().map(|weight| weight * weight).sum::<f64>();
        let step_memory = (mass + 2.0) / (n + mass + 5.0);
        let path_memory = (4.0 + mass / n) / (n + 4.0 + 2.0 * mass / n);
        // With a diagonal alone there is less to learn, and it may be learnt faster.
        let faster = match covariance {
            Covariance::Diagonal => (n + 2.0) / 3.0,
            Covariance::Full => 1.0,
        };
        let by_path = (faster * 2.0 / ((n + 1.3).powi(2) + mass)).min(1.0);
        let by_ranks =
            (faster * 2.0 * (mass - 2.0 + 1.0 / mass) / ((n + 2.0).powi(2) + mass)).min(1.0 - by_path).max(0.0);
        Self {
            n_children,
            weights,
            step_memory,
            step_growth: (step_memory * (2.0 - step_memory) * mass).sqrt(),
            damping: 1.0 + 2.0 * (((mass - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + step_memory,
            path_memory,
            path_growth: (path_memory * (2.0 - path_memory) * mass).sqrt(),
            by_path,
            by_ranks,
            expected_length: n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n)),
        }
    }

    /// Whether neither the last generation, whose costs differ by `spread`, nor the `least` ones before promise more.
    fn is_level(&self, tolerance: f64, spread: f64, least: &[f64]) -> bool {
        let n = self.expected_length.powi(2);
        let looked = 10 + (30.0 * n / self.n_children as f64).ceil() as usize;
        let Some(last) = least.len().checked_sub(looked).map(|first| &least[first..]) else { return false };
        let (low, high) =
            last.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), cost| (low.min(*cost), high.max(*cost)));
        spread < tolerance && high - low < tolerance
    }
}

/// C, as far as it is learnt.
enum Learnt {
    Diagonal {
        variance: Vec<f64>,
    },
    /// C = B D^2 B^T
    Full {
        matrix: DMatrix<f64>,
        /// B
        axes: DMatrix<f64>,
        /// D
        lengths: DVector<f64>,
    },
}

impl Learnt {
    /// `factor B D z`: a step with the covariance C.
    fn shaped(&self, factor: f64, z: &[f64]) -> Vec<f64> {
        match self {
            Self::Diagonal { variance } => {
                z.iter().zip(variance).map(|(z, variance)| factor * variance.sqrt() * z).collect()
            }
            Self::Full { axes, lengths, .. } => {
                let stretched = DVector::from_iterator(z.len(), z.iter().zip(lengths).map(|(z, d)| factor * d * z));
                (axes * stretched).as_slice().to_vec()
            }
        }
    }

    /// `B z`.
    fn turned(&self, z: &[f64]) -> Vec<f64> {
        match self {
            Self::Diagonal { .. } => z.to_vec(),
            Self::Full { axes, .. } => (axes * DVector::from_column_slice(z)).as_slice().to_vec(),
        }
    }

    /// Eq. 47: from the path by rank one, and from the parents by rank mu.
    fn learn(&mut self, strategy: &Strategy, path: &[f64], parents: &[(f64, &Vec<f64>)]) {
        let Strategy { by_path, by_ranks, .. } = *strategy;
        let steps: Vec<(f64, Vec<f64>)> =
            parents.iter().map(|(weight, draw)| (*weight, self.shaped(1.0, draw))).collect();
        match self {
            Self::Diagonal { variance } => {
                for k in 0..path.len() {
                    let ranks: f64 = steps.iter().map(|(weight, step)| weight * step[k].powi(2)).sum();
                    variance[k] =
                        (1.0 - by_path - by_ranks) * variance[k] + by_path * path[k] * path[k] + by_ranks * ranks;
                }
            }
            Self::Full { matrix, axes, lengths } => {
                *matrix *= 1.0 - by_path - by_ranks;
                let path = DVector::from_column_slice(path);
                matrix.ger(by_path, &path, &path, 1.0);
                for (weight, step) in steps {
                    let step = DVector::from_vec(step);
                    matrix.ger(by_ranks * weight, &step, &step, 1.0);
                }
                let eigen = matrix.clone().symmetric_eigen();
                // Rounding may leave a direction that hardly moves any more below zero.
                *lengths = eigen.eigenvalues.map(|value| value.max(0.0).sqrt());
                *axes = eigen.eigenvectors;
            }
        }
    }

    /// Whether points scatter and move by less than `tolerance` in every unknown.
    fn is_short(&self, tolerance: f64, sigma: f64, path: &[f64]) -> bool {
        let variance = |k: usize| match self {
            Self::Diagonal { variance } => variance[k],
            Self::Full { matrix, .. } => matrix[(k, k)],
        };
        (0..path.len()).all(|k| sigma * variance(k).sqrt() < tolerance && sigma * path[k].abs() < tolerance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(covariance: Covariance, evaluations: usize) -> Options {
        Options { covariance, spread: 0.5, evaluations, seed: 7, tolerance: None }
    }

    fn found(cost: &(dyn Fn(&[f64]) -> f64 + Sync), start: &[f64], options: &Options) -> (Vec<f64>, f64) {
        minimise(cost, (start.to_vec(), cost(start)), options)
    }

    fn sphere(x: &[f64]) -> f64 {
        x.iter().map(|x| (x - 1.0).powi(2)).sum()
    }

    /// Axes from 1 to 1e3 long.
    fn ellipsoid(x: &[f64]) -> f64 {
        let n = x.len() as f64 - 1.0;
        x.iter().enumerate().map(|(k, x)| 1e6_f64.powf(k as f64 / n) * (x - 1.0).powi(2)).sum()
    }

    /// The same, none of its axes along an unknown: reflected on a plane (Householder).
    fn turned_ellipsoid(x: &[f64]) -> f64 {
        let normal: Vec<f64> = (0..x.len()).map(|k| 1.0 + k as f64).collect();
        let square: f64 = normal.iter().map(|v| v * v).sum();
        let along: f64 = normal.iter().zip(x).map(|(v, x)| v * x).sum();
        ellipsoid(&x.iter().zip(&normal).map(|(x, v)| x - 2.0 * along / square * v).collect::<Vec<f64>>())
    }

    fn rosenbrock(x: &[f64]) -> f64 {
        x.windows(2).map(|pair| 100.0 * (pair[1] - pair[0] * pair[0]).powi(2) + (1.0 - pair[0]).powi(2)).sum()
    }

    #[test]
    fn both_forms_find_the_middle_of_a_sphere_and_of_an_ellipsoid() {
        for covariance in [Covariance::Diagonal, Covariance::Full] {
            for cost in [sphere, ellipsoid] {
                let (x, value) = found(&cost, &[0.0; 8], &options(covariance, 6000));
                assert!(value < 1e-8, "{covariance:?}: {value:e} at {x:?}");
            }
        }
    }

    /// What is tied to each other, a diagonal cannot tell.
    #[test]
    fn the_full_form_learns_axes_that_lie_aslant() {
        let (x, value) = found(&turned_ellipsoid, &[0.0; 8], &options(Covariance::Full, 6000));
        assert!(value < 1e-8, "{value:e} at {x:?}");
        let (_, value) = found(&turned_ellipsoid, &[0.0; 8], &options(Covariance::Diagonal, 6000));
        assert!(value > 1e-3, "{value:e}");
    }

    #[test]
    fn the_full_form_follows_a_bent_valley() {
        let (x, value) = found(&rosenbrock, &[0.0; 6], &options(Covariance::Full, 8000));
        assert!(value < 1e-8 && x.iter().all(|x| (x - 1.0).abs() < 1e-3), "{value:e} at {x:?}");
    }

    #[test]
    fn a_seed_stands_for_one_search_on_any_number_of_threads() {
        for covariance in [Covariance::Diagonal, Covariance::Full] {
            let on = |threads: usize, seed: u64| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
                let options = Options { seed, ..options(covariance, 500) };
                pool.install(|| found(&rosenbrock, &[0.0; 5], &options))
            };
            assert_eq!(on(1, 7), on(3, 7));
            assert_ne!(on(1, 7), on(1, 8));
        }
    }

    /// A start that nothing is better than is what comes out, and a search that has nothing to gain ends.
    #[test]
    fn a_search_ends_where_nothing_is_to_be_gained() {
        let tried = std::sync::atomic::AtomicUsize::new(0);
        let counted = |x: &[f64]| {
            tried.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            sphere(x)
        };
        let tolerance = Some(Tolerance { cost: 1e-4, step: 1e-3 });
        let options = Options { tolerance, ..options(Covariance::Full, 6000) };
        let (x, value) = minimise(&counted, (vec![1.0; 3], 0.0), &options);
        assert_eq!((x, value), (vec![1.0; 3], 0.0));
        let tried = tried.into_inner();
        assert!((100..1500).contains(&tried), "{tried}");
    }
}

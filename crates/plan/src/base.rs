//! Base parameters: the combinations of inertial parameters that a motion can reveal.
//!
//! The regressor `W` of the linear parameters ([`super::linear`]), stacked over random motions, has linearly dependent
//! columns. Going through them in order, a column that the earlier ones span is given up and its parameter joins theirs:
//! with `W_d = W_k C`, `W pi = W_k (pi_k + C pi_d)` (Gautier 1991). `C` depends on lengths alone; it is found at many
//! random lengths and recognised as polynomials in them ([`super::symbolic`]).
//!
//! Lengths that are zero in the model stay zero, all others are general. Locked joints stand anywhere: the combinations are
//! those that runs at several poses reveal; a single pose reveals fewer ([`BaseParameters::rank_at_one_pose`]).

use dynid_model::Parameter;
use nalgebra::{DMatrix, DVector};

use super::{
    linear::{LinearParameters, Motion, Regressor},
    symbolic::{Factor, recognised},
};
use crate::PlanError;
use dynid_dynamics::system::System;
use dynid_random::Random;
use dynid_user_model::Model;

/// What the motions of some configurations reveal of the linear parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseParameters {
    /// All linear parameters of the model.
    pub names: Vec<String>,
    /// How many of them belong to links.
    pub n_link: usize,
    /// Each is one combination; their number is the rank of the regressor.
    pub combinations: Vec<Combination>,
    /// Number of combinations that one random pose of the locked joints reveals in each of the configurations.
    pub rank_at_one_pose: Vec<usize>,
}

/// `leading + sum(factor * other)`
#[derive(Debug, Clone, PartialEq)]
pub struct Combination {
    /// Index of the parameter with factor 1.
    pub leading: usize,
    /// The others: index and factor.
    pub others: Vec<(usize, Factor)>,
}

/// Columns shorter than this share of their length after all earlier ones are projected out depend on those.
const DEPENDENT: f64 = 1e-8;

/// The systems with these joints free, and their linear parameters.
pub struct Analysis {
    pub(crate) parameters: LinearParameters,
    systems: Vec<System>,
    lengths: Vec<(String, f64)>,
}

impl Analysis {
    /// Of some sets of free joints of the model's device, locked ones at zero.
    pub fn new(model: &Model, free: &[Vec<usize>]) -> Result<Self, PlanError> {
        let systems = free.iter().map(|free| model.system(free, |_| 0.0)).collect::<Result<Vec<_>, _>>()?;
        let parameters = LinearParameters::of_model(model, &systems);
        let names = model.device.lengths.iter().map(|length| length.symbol.clone());
        let lengths = names.zip(&model.lengths).map(|(name, length)| (name, length.value)).collect();
        Ok(Self { parameters, systems, lengths })
    }

    /// Stacked rows of one of the systems at random motions; at one random pose of the locked joints, or at many.
    fn stacked(&self, system: usize, lengths: &[(String, f64)], poses: Poses, random: &mut Random) -> DMatrix<f64> {
        let system = &self.systems[system];
        let kernel = system.kernel();
        let n = system.n_free();
        let n_columns = self.parameters.names.len();
        let n_motions = (n_columns + 10).div_ceil(n);
        let n_poses = if kernel.locked.is_empty() || poses == Poses::One { 1 } else { n_motions };
        let mut values = system.link_parameters().to_vec();
        for (value, name) in values.iter_mut().zip(kernel.parameters) {
            let symbol = name.strip_prefix("length.");
            if let Some((_, length)) = lengths.iter().find(|(known, _)| Some(known.as_str()) == symbol) {
                *value = *length;
            }
        }
        let mut rows = DMatrix::zeros(n_motions * n, n_columns);
        for pose in 0..n_poses {
            let locked = random.vector(kernel.locked.len(), -3.0, 3.0);
            let mut regressor = Regressor::new(system, &self.parameters, &values, &locked);
            for motion in (pose..n_motions).step_by(n_poses) {
                regressor.rows(&Motion::random(n, random), &mut rows, motion * n);
            }
        }
        rows
    }

    /// Rows of all systems whose free joints are not a part of another's: those add nothing.
    fn all(&self, lengths: &[(String, f64)], random: &mut Random) -> DMatrix<f64> {
        let free = |index: usize| self.systems[index].kernel().free;
        let within = |a: usize, b: usize| a != b && free(a).iter().all(|joint| free(b).contains(joint));
        let n_systems = self.systems.len();
        let blocks: Vec<DMatrix<f64>> = (0..n_systems)
            .filter(|&index| !(0..n_systems).any(|other| within(index, other)))
            .map(|index| self.stacked(index, lengths, Poses::Many, random))
            .collect();
        let n_rows = blocks.iter().map(DMatrix::nrows).sum();
        let mut rows = DMatrix::zeros(n_rows, self.parameters.names.len());
        let mut first = 0;
        for block in blocks {
            rows.rows_mut(first, block.nrows()).copy_from(&block);
            first += block.nrows();
        }
        rows
    }

    /// Triangular factor of the rows of one system over many poses at the model's lengths: which directions of the linear
    /// parameters it reveals.
    pub fn revealed(&self, system: usize) -> DMatrix<f64> {
        self.stacked(system, &self.lengths, Poses::Many, &mut Random::new(17)).qr().r()
    }

    /// The base parameters of all systems together, `C` being recognised.
    pub fn base(&self) -> BaseParameters {
        let mut random = Random::new(23);
        let own = self.all(&self.lengths, &mut random);
        let leading = independent(&own);
        let present = (0..own.ncols()).filter(|&column| own.column(column).amax() > 0.0);
        let dependent: Vec<usize> = present.filter(|column| !leading.contains(column)).collect();
        let used: Vec<String> =
            self.lengths.iter().filter(|(_, value)| *value != 0.0).map(|(name, _)| name.clone()).collect();
        let recognised = recognised(&used, |point| {
            let value = |name: &str| used.iter().position(|known| known == name).map_or(0.0, |place| point[place]);
            let lengths: Vec<(String, f64)> =
                self.lengths.iter().map(|(name, _)| (name.clone(), value(name))).collect();
            factors(&self.all(&lengths, &mut random), &leading, &dependent)
        });
        let at_model = factors(&own, &leading, &dependent);
        let combination = |(row, &leading): (usize, &usize)| {
            let factor = |(column, &other): (usize, &usize)| match &recognised[(row, column)] {
                Some(polynomial) if polynomial.is_zero() => None,
                Some(polynomial) => Some((other, Factor::Exact(polynomial.clone()))),
                None => Some((other, Factor::Number(at_model[(row, column)]))),
            };
            Combination { leading, others: dependent.iter().enumerate().filter_map(factor).collect() }
        };
        let combinations = leading.iter().enumerate().map(combination).collect();
        let rank_at_one_pose = (0..self.systems.len())
            .map(|system| independent(&self.stacked(system, &self.lengths, Poses::One, &mut random)).len())
            .collect();
        BaseParameters {
            names: self.parameters.names.clone(),
            n_link: self.parameters.n_link,
            combinations,
            rank_at_one_pose,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Poses {
    One,
    Many,
}

/// What motions with these sets of joints free reveal together.
///
/// # Errors
/// Free joints without a kernel, or an effect that cannot be simulated.
pub fn base_parameters(model: &Model, free: &[Vec<usize>]) -> Result<BaseParameters, PlanError> {
    Ok(Analysis::new(model, free)?.base())
}

/// Indices of the columns that the columns before them do not span.
pub fn independent(rows: &DMatrix<f64>) -> Vec<usize> {
    let mut basis: Vec<DVector<f64>> = Vec::new();
    let mut kept = Vec::new();
    for (index, column) in rows.column_iter().enumerate() {
        let length = column.norm();
        if length == 0.0 {
            continue;
        }
        let mut rest = column.into_owned() / length;
        // Twice is enough (Kahan; Parlett 1998, section 6.9).
        for _ in 0..2 {
            for direction in &basis {
                let along = direction.dot(&rest);
                rest.axpy(-along, direction, 1.0);
            }
        }
        let left = rest.norm();
        if left > DEPENDENT {
            basis.push(rest / left);
            kept.push(index);
        }
    }
    kept
}

/// `C` of `W_d = W_k C`.
pub fn factors(rows: &DMatrix<f64>, leading: &[usize], dependent: &[usize]) -> DMatrix<f64> {
    if leading.is_empty() || dependent.is_empty() {
        return DMatrix::zeros(leading.len(), dependent.len());
    }
    let qr = rows.select_columns(leading).qr();
    let right = qr.q().transpose() * rows.select_columns(dependent);
    // `leading` was independent at other lengths; where it is not here, nothing is recognised.
    qr.r()
        .solve_upper_triangular(&right)
        .unwrap_or_else(|| DMatrix::from_element(leading.len(), dependent.len(), f64::NAN))
}

impl BaseParameters {
    /// Number of combinations.
    pub fn rank(&self) -> usize {
        self.combinations.len()
    }

    /// `link.2.Jzz + L2^2*link.3.m - ...`
    pub fn formula(&self, combination: &Combination) -> String {
        let others = combination.others.iter().map(|(other, factor)| factor.times(&self.names[*other]));
        self.names[combination.leading].clone() + &others.collect::<String>()
    }

    /// Linear parameters that are base parameters by themselves.
    pub fn alone(&self) -> Vec<&str> {
        let alone = self.combinations.iter().filter(|combination| combination.others.is_empty());
        alone.map(|combination| self.names[combination.leading].as_str()).collect()
    }

    /// Linear parameters of links in no combination: the motion does not depend on them.
    pub fn vanishing(&self) -> Vec<&str> {
        let stands = |index: usize| {
            let within = |combination: &Combination| {
                combination.leading == index || combination.others.iter().any(|(other, _)| *other == index)
            };
            self.combinations.iter().any(within)
        };
        (0..self.n_link).filter(|&index| !stands(index)).map(|index| self.names[index].as_str()).collect()
    }

    /// Whether every factor is exact.
    pub fn is_exact(&self) -> bool {
        let mut factors = self.combinations.iter().flat_map(|combination| &combination.others);
        factors.all(|(_, factor)| matches!(factor, Factor::Exact(_)))
    }

    /// `B` of `beta = B pi` at the model's lengths: one row a combination, one column a linear parameter.
    pub fn matrix(&self, model: &Model) -> DMatrix<f64> {
        let length = |symbol: &str| model.parameter(&format!("length.{symbol}")).map_or(0.0, |length| length.value);
        let mut matrix = DMatrix::zeros(self.rank(), self.names.len());
        for (row, combination) in self.combinations.iter().enumerate() {
            matrix[(row, combination.leading)] = 1.0;
            for (other, factor) in &combination.others {
                matrix[(row, *other)] = factor.value(&length);
            }
        }
        matrix
    }

    /// As [`Self::formula`], the effects left out.
    pub fn links_in_words(&self, combination: &Combination) -> String {
        let others = combination.others.iter().filter(|(other, _)| *other < self.n_link);
        let reported = others.map(|(other, factor)| factor.times(&self.names[*other]));
        self.names[combination.leading].clone() + &reported.collect::<String>()
    }

    /// Names of the standard parameters (`link.2.m`, `link.2.x`, `link.2.Izz`, ..) that the base parameters determine by
    /// themselves. Fixed ones have their values, the others are general.
    pub fn identifiable_alone(&self, model: &Model) -> Vec<String> {
        let mut random = Random::new(29);
        let mut general = |own: &Parameter| if own.fixed { own.value } else { random.between(0.5, 1.5) };
        let bodies: Vec<[f64; 10]> =
            model.links.iter().map(|link| std::array::from_fn(|k| general(&link[k]))).collect();
        let by_linear = self.matrix(model).columns(0, self.n_link).into_owned();
        let by_standard = by_linear * LinearParameters::by_standard(&bodies);
        let links = model.parameters().into_iter().filter(|(name, _)| name.starts_with("link."));
        let (unknown, names): (Vec<usize>, Vec<String>) =
            links.enumerate().filter(|(_, (_, own))| !own.fixed).map(|(place, (name, _))| (place, name)).unzip();
        let by_unknown = by_standard.select_columns(&unknown);
        let n = unknown.len();
        if n == 0 || by_unknown.nrows() == 0 {
            return Vec::new();
        }
        let standing = dynid_optimise::identifiability::standing(&by_unknown, &DMatrix::identity(n, n), &vec![1.0; n]);
        names.into_iter().zip(standing.identifiable).filter(|(_, alone)| *alone).map(|(name, _)| name).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(device: &str) -> Model {
        Model::of_device(dynid_model::device(device).unwrap())
    }

    fn all_configurations(model: &Model) -> Vec<Vec<usize>> {
        model.device.configurations.iter().map(|known| known.free.clone()).collect()
    }

    /// Independent closed form (e.g. Siciliano et al. 2009, section 7.3.2): the torques of a planar arm with two links follow
    /// from inertia about the joint axis and first moments of each link, the second link's mass acting at the elbow. The
    /// frames of this device stand at the far ends of its links.
    #[test]
    fn planar_arm_has_its_closed_form() {
        let mut model = model("planar2r");
        model.effects.clear();
        let base = base_parameters(&model, &all_configurations(&model)).unwrap();
        let reported: Vec<String> = base.combinations.iter().map(|combination| base.formula(combination)).collect();
        assert_eq!(
            reported,
            [
                "link.1.Jzz - L1^2*link.1.m - L1^2*link.2.m",
                "link.1.mx + L1*link.1.m + L1*link.2.m",
                "link.1.my",
                "link.2.Jzz - L2^2*link.2.m",
                "link.2.mx + L2*link.2.m",
                "link.2.my",
            ]
        );
        let pi = DVector::from_vec(LinearParameters::of_model(&model, &[]).values(&model));
        let beta = base.matrix(&model) * pi;
        let value = |name: &str| model.parameter(name).unwrap().value;
        let (l1, l2) = (value("length.L1"), value("length.L2"));
        let link = |n: usize| ["m", "x", "y", "Izz"].map(|symbol| value(&format!("link.{n}.{symbol}")));
        let ([m1, x1, y1, i1], [m2, x2, y2, i2]) = (link(1), link(2));
        let closed = [
            i1 + m1 * ((l1 + x1).powi(2) + y1 * y1) + m2 * l1 * l1,
            m1 * (l1 + x1) + m2 * l1,
            m1 * y1,
            i2 + m2 * ((l2 + x2).powi(2) + y2 * y2),
            m2 * (l2 + x2),
            m2 * y2,
        ];
        let ours = [beta[0] + 2.0 * l1 * beta[1], beta[1], beta[2], beta[3] + 2.0 * l2 * beta[4], beta[4], beta[5]];
        for (ours, closed) in ours.iter().zip(&closed) {
            assert!((ours - closed).abs() < 1e-14, "{ours} {closed}");
        }
    }

    /// On random motions of robots with random lengths (those that are zero stay so): base parameters give the torques of
    /// the whole regressor, and their columns are independent.
    #[test]
    fn base_parameters_give_every_torque() {
        for device in dynid_model::devices() {
            let model = Model::of_device(device);
            let analysis = Analysis::new(&model, &all_configurations(&model)).unwrap();
            let base = analysis.base();
            let reported: Vec<String> = base.combinations.iter().map(|combination| base.formula(combination)).collect();
            assert!(base.is_exact(), "{}: {reported:#?}", device.id);
            let mut random = Random::new(101);
            let mut other = model.clone();
            for length in other.lengths.iter_mut().filter(|length| length.value != 0.0) {
                length.value = random.between(0.1, 2.0);
            }
            let lengths: Vec<(String, f64)> =
                analysis.lengths.iter().zip(&other.lengths).map(|((name, _), own)| (name.clone(), own.value)).collect();
            let rows = analysis.all(&lengths, &mut random);
            let leading: Vec<usize> = base.combinations.iter().map(|combination| combination.leading).collect();
            let kept = rows.select_columns(&leading);
            let error = (&rows - &kept * base.matrix(&other)).amax();
            assert!(error < 1e-9 * rows.amax(), "{}: {error:e}", device.id);
            let singular = DMatrix::from_columns(
                &rows
                    .column_iter()
                    .filter(|column| column.norm() > 0.0)
                    .map(|column| column.normalize())
                    .collect::<Vec<_>>(),
            )
            .singular_values();
            let rank = singular.iter().filter(|value| **value > 1e-9 * singular.max()).count();
            assert_eq!(rank, base.rank(), "{}", device.id);
        }
    }

    #[test]
    fn a_pendulum_shows_one_inertia_and_two_moments() {
        let mut model = model("double_pendulum");
        model.effects.clear();
        // joint 1 alone: inertia about its axis, and what gravity does in two directions
        let base = base_parameters(&model, &[vec![1]]).unwrap();
        assert_eq!(base.alone(), ["link.2.Jzz", "link.2.mx", "link.2.my"]);
    }
}

//! The parameters in which the torques are linear, and the regressor of them: `drive = W(q, dq, ddq) pi`.
//!
//! The inertial parameters of a link enter linearly as mass `m`, first moments `mx = m x`, `my`, `mz` and the inertia `J`
//! about the *origin* of the link's frame, `Jxx = Ixx + m (y^2 + z^2)`, `Jxy = Ixy - m x y`, .. (Khalil & Dombre 2002,
//! section 9.2). With them come those parameters of effects in which the torque is linear whatever the command and the
//! states of effects are: viscous and Coulomb friction, stiffness, rotor inertia, offset.

use std::collections::BTreeSet;

use dynid_generated::Kernel;
use nalgebra::DMatrix;

use dynid_dynamics::{system::Linear, system::System};
use dynid_optimise::pseudo_inertia::standard;
use dynid_random::Random;
use dynid_user_model::Model;

/// Symbols of a link's linear parameters, in the order in which base parameters prefer to keep them: what comes later is
/// expressed by what comes earlier, which makes the factors products of lengths instead of quotients.
const SYMBOLS: [&str; 10] = ["Jxx", "Jxy", "Jxz", "Jyy", "Jyz", "Jzz", "mx", "my", "mz", "m"];

/// Ten bodies `m x y z Ixx Ixy Ixz Iyy Iyz Izz` whose linear parameters are one of [`SYMBOLS`] each, where those of a
/// first moment also hold the mass 1, which is taken off again.
const BODIES: [[f64; 10]; 10] = [
    [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
    [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, -1.0],
    [1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0],
    [1.0, 0.0, 0.0, 1.0, -1.0, 0.0, 0.0, -1.0, 0.0, 0.0],
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
];
const MASS: usize = 9;

/// Linear parameters of a body `m x y z Ixx Ixy Ixz Iyy Iyz Izz`, in the order of [`SYMBOLS`].
fn linear_of_body(inertial: [f64; 10]) -> [f64; 10] {
    let [m, mx, my, mz, xx, xy, xz, yy, yz, zz] = standard(&inertial);
    [xx, xy, xz, yy, yz, zz, mx, my, mz, m]
}

/// The linear parameters of a model: those of all links, then those of its effects.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearParameters {
    /// `link.3.Jxx`, `link.3.mx`, `joint.0.viscous.Fv`.
    pub names: Vec<String>,
    /// How many of them belong to links: ten a link.
    pub n_link: usize,
}

impl LinearParameters {
    /// Of a model, as far as one of `systems` has them.
    pub fn of_model(model: &Model, systems: &[System]) -> Self {
        let links = 1..=model.links.len();
        let mut names: Vec<String> =
            links.flat_map(|link| SYMBOLS.map(|symbol| format!("link.{link}.{symbol}"))).collect();
        let n_link = names.len();
        let found: BTreeSet<String> = systems.iter().flat_map(linear_effects).collect();
        names.extend(model.names().into_iter().filter(|name| found.contains(name)));
        Self { names, n_link }
    }

    /// Their values.
    pub fn values(&self, model: &Model) -> Vec<f64> {
        let links = model.links.iter().flat_map(|link| linear_of_body(link.map(|parameter| parameter.value)));
        let effects = self.names[self.n_link..].iter().map(|name| model.parameter(name).map_or(0.0, |own| own.value));
        links.chain(effects).collect()
    }

    /// Derivatives of the linear parameters of the links by the standard ones at `links`: both ten a link.
    pub fn by_standard(links: &[[f64; 10]]) -> DMatrix<f64> {
        let n = 10 * links.len();
        let mut jacobian = DMatrix::zeros(n, n);
        for (link, body) in links.iter().enumerate() {
            for column in 0..10 {
                // At most cubic, and quadratic in each number: central differences are exact but for rounding.
                let step = 0.5 * body[column].abs().max(1e-3);
                let at = |sign: f64| {
                    let mut moved = *body;
                    moved[column] += sign * step;
                    linear_of_body(moved)
                };
                let (plus, minus) = (at(1.0), at(-1.0));
                for row in 0..10 {
                    jacobian[(10 * link + row, 10 * link + column)] = (plus[row] - minus[row]) / (2.0 * step);
                }
            }
        }
        jacobian
    }
}

/// One state of motion of the free joints, and what else an effect may read.
#[derive(Debug, Clone)]
pub struct Motion {
    /// s
    pub t: f64,
    /// [rad or m]
    pub q: Vec<f64>,
    /// [rad/s or m/s]
    pub dq: Vec<f64>,
    /// [rad/s^2 or m/s^2]
    pub ddq: Vec<f64>,
}

impl Motion {
    /// Anything.
    pub fn random(n_free: usize, random: &mut Random) -> Self {
        const REACH: f64 = 3.0;
        let mut draw = || random.vector(n_free, -REACH, REACH);
        let (q, dq, ddq) = (draw(), draw(), draw());
        Self { t: random.between(0.0, 100.0), q, dq, ddq }
    }
}

/// The regressor of one configuration, of the linear parameters of the whole model: columns of parameters that do not act
/// in it are zero.
pub struct Regressor<'a> {
    system: &'a System,
    linear: Linear,
    /// d lump / d linear parameter, n_lumps x n_parameters
    lumps: DMatrix<f64>,
    prepared: Vec<f64>,
    /// Effect parameter and its column.
    effects: Vec<(usize, usize)>,
    y: Vec<f64>,
}

impl<'a> Regressor<'a> {
    /// `values` are those of the kernel's parameters, of which only lengths and gravity count; `locked` where the locked
    /// joints stand.
    pub fn new(system: &'a System, parameters: &LinearParameters, values: &[f64], locked: &[f64]) -> Self {
        let kernel = system.kernel();
        let effects = system.effect_names().iter().enumerate().filter_map(|(index, name)| {
            let column = parameters.names[parameters.n_link..].iter().position(|known| known == name)?;
            Some((index, parameters.n_link + column))
        });
        let (lumps, prepared) = lumps(kernel, parameters, values, locked);
        Self {
            system,
            linear: Linear::new(system),
            lumps,
            prepared,
            effects: effects.collect(),
            y: vec![0.0; kernel.free.len() * kernel.n_lumps],
        }
    }

    /// At the system's own lengths, gravity and locked positions.
    pub fn of_system(system: &'a System, parameters: &LinearParameters) -> Self {
        Self::new(system, parameters, system.link_parameters(), system.locked())
    }

    /// Writes the rows `W` of a motion, one a free joint, from row `first` on.
    pub fn rows(&mut self, motion: &Motion, rows: &mut DMatrix<f64>, first: usize) {
        let n = self.system.n_free();
        let kernel = self.system.kernel();
        let mut block = rows.rows_mut(first, n);
        block.fill(0.0);
        if kernel.n_lumps > 0 {
            kernel.functions.regressor(&self.prepared, &motion.q, &motion.dq, &motion.ddq, &mut self.y);
            let n_columns = self.lumps.ncols();
            for row in 0..n {
                for lump in 0..kernel.n_lumps {
                    let factor = self.y[row * kernel.n_lumps + lump];
                    if factor != 0.0 {
                        for column in 0..n_columns {
                            block[(row, column)] += factor * self.lumps[(lump, column)];
                        }
                    }
                }
            }
        }
        if self.effects.is_empty() {
            return;
        }
        let columns = effect_columns(self.system, &mut self.linear, motion, None, &vec![0.0; self.system.n_joints()]);
        for (row, parameter, value) in columns {
            if let Some((_, column)) = self.effects.iter().find(|(index, _)| *index == parameter) {
                block[(row, *column)] += value;
            }
        }
    }
}

/// How the lumps of a kernel follow from the linear parameters, and what `prepare` makes of a device without mass.
fn lumps(kernel: &Kernel, parameters: &LinearParameters, values: &[f64], locked: &[f64]) -> (DMatrix<f64>, Vec<f64>) {
    let mut prepared = vec![0.0; kernel.prepared.len()];
    let mut massless = values.to_vec();
    for (value, _) in massless.iter_mut().zip(kernel.parameters).filter(|(_, name)| name.starts_with("link.")) {
        *value = 0.0;
    }
    let mut matrix = DMatrix::zeros(kernel.n_lumps, parameters.names.len());
    let mut body_lumps = vec![0.0; kernel.prepared.len()];
    for link in 0..parameters.n_link / 10 {
        let prefix = format!("link.{}.", link + 1);
        let own: Vec<(usize, usize)> = kernel
            .parameters
            .iter()
            .enumerate()
            .filter_map(|(place, name)| {
                let symbol = name.strip_prefix(&prefix)?;
                Some((place, dynid_model::Link::SYMBOLS.iter().position(|known| *known == symbol)?))
            })
            .collect();
        if own.is_empty() {
            continue;
        }
        for (column, body) in BODIES.iter().enumerate() {
            let mut with_body = massless.clone();
            own.iter().for_each(|&(place, symbol)| with_body[place] = body[symbol]);
            kernel.functions.prepare(&with_body, locked, &mut body_lumps);
            for lump in 0..kernel.n_lumps {
                matrix[(lump, 10 * link + column)] = body_lumps[lump];
            }
        }
        for first_moment in (0..10).filter(|&column| column != MASS && BODIES[column][0] != 0.0) {
            for lump in 0..kernel.n_lumps {
                let mass = matrix[(lump, 10 * link + MASS)];
                matrix[(lump, 10 * link + first_moment)] -= mass;
            }
        }
    }
    kernel.functions.prepare(values, locked, &mut prepared);
    (matrix, prepared)
}

/// Derivatives of the torque that the motion needs by the effects' parameters: free joint, parameter, value.
fn effect_columns(
    system: &System,
    linear: &mut Linear,
    motion: &Motion,
    states: Option<&[f64]>,
    command: &[f64],
) -> Vec<(usize, usize, f64)> {
    let n = system.n_free();
    let mut x = system.rest(&motion.q);
    x[n..2 * n].copy_from_slice(&motion.dq);
    if let Some(states) = states {
        x[2 * n..].copy_from_slice(states);
    }
    let mut dx = vec![0.0; system.n_states()];
    linear.along(system, motion.t, &x, Some(&motion.ddq), command, &mut dx);
    linear.torque_by_parameter.iter().map(|&(row, parameter, value)| (row, parameter, -value)).collect()
}

/// Names of the effects' parameters in which the torque is linear, whatever the command and the states are.
///
/// A parameter is one if its own value, those of the others taken so far, the command and the states leave its column as
/// it is, and if no state depends on it.
fn linear_effects(system: &System) -> Vec<String> {
    const STATES: usize = 6;
    const ROUNDING: f64 = 1e-9;
    let mut random = Random::new(5);
    let n = system.n_free();
    let n_states = system.n_states() - 2 * n;
    let n_parameters = system.effect_names().len();
    let motions: Vec<Motion> = (0..STATES).map(|_| Motion::random(n, &mut random)).collect();
    let columns = |system: &System, random: &mut Random| -> DMatrix<f64> {
        let mut linear = Linear::new(system);
        let mut columns = DMatrix::zeros(STATES * n, n_parameters);
        for (index, motion) in motions.iter().enumerate() {
            let command = random.vector(system.n_joints(), -1.0, 1.0);
            let states = random.vector(n_states, -0.1, 0.1);
            for (row, parameter, value) in effect_columns(system, &mut linear, motion, Some(&states), &command) {
                columns[(index * n + row, parameter)] += value;
            }
            for &(_, parameter, value) in &linear.rate_by_parameter {
                if value != 0.0 {
                    columns[(index * n, parameter)] = f64::NAN;
                }
            }
        }
        columns
    };
    let plain = columns(system, &mut random);
    let mut taken: Vec<usize> = Vec::new();
    for parameter in 0..n_parameters {
        if plain.column(parameter).iter().all(|entry| *entry == 0.0) {
            continue;
        }
        let mut moved = system.clone();
        let mut values = system.effect_parameters().to_vec();
        for &other in taken.iter().chain(std::iter::once(&parameter)) {
            values[other] += random.between(0.3, 0.7) * values[other].abs().max(0.1);
        }
        moved.set_parameters(system.link_parameters(), &values);
        let changed = columns(&moved, &mut random);
        let same = |column: usize| {
            let size = plain.column(column).amax();
            // An undefined entry (a state depends on the parameter) is not below any bound.
            (plain.column(column) - changed.column(column)).iter().all(|change| change.abs() <= ROUNDING * size)
        };
        if taken.iter().chain(std::iter::once(&parameter)).all(|&column| same(column)) {
            taken.push(parameter);
        }
    }
    taken.into_iter().map(|parameter| system.effect_names()[parameter].clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The torques of any robot follow from `W pi`, `pi` of any bodies: against the kernels' own inverse dynamics.
    #[test]
    fn the_regressor_of_linear_parameters_gives_the_torques() {
        let mut random = Random::new(1);
        for device in dynid_model::devices() {
            let mut model = Model::of_device(device);
            model.effects.clear();
            for configuration in &device.configurations {
                let mut system = model.system(&configuration.free, |_| 0.0).unwrap();
                let kernel = system.kernel();
                let values: Vec<f64> = kernel.parameters.iter().map(|_| random.between(0.2, 1.2)).collect();
                system.set_parameters(&values, &[]);
                let parameters = LinearParameters::of_model(&model, std::slice::from_ref(&system));
                let bodies = (1..=device.links.len()).flat_map(|link| {
                    linear_of_body(dynid_model::Link::SYMBOLS.map(|symbol| {
                        let name = format!("link.{link}.{symbol}");
                        kernel.parameters.iter().position(|known| *known == name).map_or(0.0, |place| values[place])
                    }))
                });
                let pi = nalgebra::DVector::from_iterator(parameters.n_link, bodies);
                let n = system.n_free();
                let motion = Motion::random(n, &mut random);
                let mut rows = DMatrix::zeros(n, parameters.names.len());
                Regressor::of_system(&system, &parameters).rows(&motion, &mut rows, 0);
                let mut tau = vec![0.0; n];
                kernel.functions.inverse_dynamics(system.prepared(), &motion.q, &motion.dq, &motion.ddq, &mut tau);
                for (found, expected) in (rows * pi).iter().zip(&tau) {
                    let size = tau.iter().fold(1.0_f64, |size, tau| size.max(tau.abs()));
                    assert!(
                        (found - expected).abs() < 1e-10 * size,
                        "{} {:?}: {found} {expected}",
                        device.id,
                        configuration.free
                    );
                }
            }
        }
    }

    #[test]
    fn which_effects_are_linear_is_found() {
        let linear = |device: &str| {
            let model = Model::of_device(dynid_model::device(device).unwrap());
            let last = model.device.configurations.last().unwrap();
            linear_effects(&model.system(&last.free, |_| 0.0).unwrap())
        };
        assert_eq!(linear("servo_pendulum").len(), 3, "viscous, coulomb and rotor inertia, not the gain");
        let freedom = linear("freedom6s");
        for name in ["joint.3.spring.Ks", "joint.3.lugre.sigma2"] {
            assert!(freedom.contains(&name.to_owned()), "{freedom:?}");
        }
        let nonlinear = ["Kp", "sigma0", "sigma1", "vs", "Fs", "Fc", "qeq"];
        assert!(freedom.iter().all(|name| nonlinear.iter().all(|symbol| !name.ends_with(&format!(".{symbol}")))));
    }
}

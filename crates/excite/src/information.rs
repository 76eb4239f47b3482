//! What a motion would tell: the information of the regressor along it, and the standard errors to be expected.
//!
//! With torques known up to white noise of standard deviation `sigma_i` at joint i, the base parameters `beta` of
//! `tau = W beta` have the covariance `(sum W' Sigma^-1 W)^-1` over the samples. `log det` of the sum is what a D-optimal
//! experiment maximises; another choice of base parameters only adds a constant to it.

use nalgebra::{DMatrix, DVector};

use dynid_dynamics::{system::Linear, system::System, system::SystemError};
use dynid_plan::{base::factors, base::independent, linear::LinearParameters, linear::Motion, linear::Regressor};
use dynid_random::Random;
use dynid_user_model::Model;

/// A motion of the free joints, one row a sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Path {
    /// s
    pub time: Vec<f64>,
    /// [rad or m]
    pub q: Vec<Vec<f64>>,
    /// [rad/s or m/s]
    pub dq: Vec<Vec<f64>>,
    /// [rad/s^2 or m/s^2]
    pub ddq: Vec<Vec<f64>>,
}

impl Path {
    /// Of positions and speeds at the samples; accelerations are central differences.
    pub fn of_speeds(time: &[f64], q: Vec<Vec<f64>>, dq: Vec<Vec<f64>>) -> Self {
        let last = time.len().saturating_sub(1);
        let ddq = (0..time.len())
            .map(|k| {
                let (from, to) = (k.saturating_sub(1), (k + 1).min(last));
                let span_s = (time[to] - time[from]).max(f64::MIN_POSITIVE);
                dq[to].iter().zip(&dq[from]).map(|(to, from)| (to - from) / span_s).collect()
            })
            .collect();
        Self { time: time.to_vec(), q, dq, ddq }
    }

    /// Of positions alone: speeds are central differences, too.
    pub fn of_positions(time: &[f64], q: Vec<Vec<f64>>) -> Self {
        let speeds = Self::of_speeds(time, q.clone(), q.clone()).ddq;
        Self::of_speeds(time, q, speeds)
    }

    fn motion(&self, sample: usize) -> Motion {
        Motion {
            t: self.time[sample],
            q: self.q[sample].clone(),
            dq: self.dq[sample].clone(),
            ddq: self.ddq[sample].clone(),
        }
    }
}

/// The standard error that a motion leaves a base parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct ExpectedError {
    /// Name of the parameter that leads the combination; ` + ..` follows where there are others.
    pub name: String,
    /// The combination's value in the model.
    pub value: f64,
    /// One standard deviation; infinite where the motion does not tell.
    pub std_error: f64,
}

/// What a motion would tell.
#[derive(Debug, Clone, PartialEq)]
pub struct Expected {
    /// Standard deviation of the torque noise of each free joint that this assumes [N*m or N].
    pub noise: Vec<f64>,
    /// Natural logarithm of the determinant of the information; `-inf` where a base parameter stays dark.
    pub log_det: f64,
    /// Condition number of the regressor, columns scaled to one length.
    pub condition: f64,
    /// One a base parameter at this pose of the locked joints.
    pub errors: Vec<ExpectedError>,
}

/// The regressor of the base parameters of one system at its pose.
pub struct BaseRegressor<'a> {
    system: &'a System,
    parameters: LinearParameters,
    leading: Vec<usize>,
    names: Vec<String>,
    values: Vec<f64>,
}

impl<'a> BaseRegressor<'a> {
    /// Of a system that was made of `model`.
    pub fn new(model: &Model, system: &'a System) -> Self {
        let parameters = LinearParameters::of_model(model, std::slice::from_ref(system));
        let mut random = Random::new(61);
        let n = system.n_free();
        let n_motions = (parameters.names.len() + 10).div_ceil(n);
        let mut rows = DMatrix::zeros(n_motions * n, parameters.names.len());
        let mut regressor = Regressor::of_system(system, &parameters);
        for motion in 0..n_motions {
            regressor.rows(&Motion::random(n, &mut random), &mut rows, motion * n);
        }
        let leading = independent(&rows);
        let present = (0..rows.ncols()).filter(|&column| rows.column(column).amax() > 0.0);
        let dependent: Vec<usize> = present.filter(|column| !leading.contains(column)).collect();
        let factors = factors(&rows, &leading, &dependent);
        let pi = parameters.values(model);
        let (mut names, mut values) = (Vec::new(), Vec::new());
        for (row, &index) in leading.iter().enumerate() {
            let joined: Vec<usize> =
                (0..dependent.len()).filter(|&column| factors[(row, column)].abs() > 1e-9).collect();
            let terms: Vec<f64> = joined
                .iter()
                .map(|&column| factors[(row, column)] * pi[dependent[column]])
                .chain(std::iter::once(pi[index]))
                .collect();
            let (sum, size) = terms.iter().fold((0.0, 0.0), |(sum, size), term| (sum + term, size + term.abs()));
            names.push(format!("{}{}", parameters.names[index], if joined.is_empty() { "" } else { " + .." }));
            // What is left of terms that cancel is rounding.
            values.push(if sum.abs() > 1e-12 * size { sum } else { 0.0 });
        }
        Self { system, parameters, leading, names, values }
    }

    /// Number of base parameters.
    pub fn rank(&self) -> usize {
        self.leading.len()
    }

    /// Number of base parameters that a general pose of the locked joints reveals; a special one may reveal fewer.
    ///
    /// # Errors
    /// As [`Model::system`].
    pub fn rank_elsewhere(&self, model: &Model) -> Result<usize, SystemError> {
        let pose = Random::new(73).vector(self.system.n_joints(), -3.0, 3.0);
        let elsewhere = model.system(self.system.kernel().free, |joint| pose[joint])?;
        Ok(BaseRegressor::new(model, &elsewhere).rank())
    }

    /// Rows along a motion, one a sample and free joint.
    pub fn rows(&self, path: &Path) -> DMatrix<f64> {
        let n = self.system.n_free();
        let mut regressor = Regressor::of_system(self.system, &self.parameters);
        let mut rows = DMatrix::zeros(n, self.parameters.names.len());
        let mut kept = DMatrix::zeros(n * path.time.len(), self.leading.len());
        for sample in 0..path.time.len() {
            regressor.rows(&path.motion(sample), &mut rows, 0);
            for (column, &leading) in self.leading.iter().enumerate() {
                for row in 0..n {
                    kept[(sample * n + row, column)] = rows[(row, leading)];
                }
            }
        }
        kept
    }

    /// What `path` would tell, the torque noise of the free joints being `noise`.
    pub fn expected(&self, path: &Path, noise: &[f64]) -> Expected {
        let rows = weighted(self.rows(path), noise);
        let lengths: Vec<f64> = rows.column_iter().map(|column| column.norm()).collect();
        let dark = lengths.contains(&0.0);
        let mut scaled = rows;
        for (mut column, length) in scaled.column_iter_mut().zip(&lengths) {
            column /= if *length > 0.0 { *length } else { 1.0 };
        }
        let gram = scaled.transpose() * &scaled;
        let singular = scaled.qr().r().singular_values();
        let condition = if dark { f64::INFINITY } else { singular.max() / singular.min() };
        let cholesky = gram.cholesky().filter(|_| condition < 1e8);
        let log_det = match &cholesky {
            Some(cholesky) => {
                let shape: f64 = cholesky.l().diagonal().iter().map(|entry| 2.0 * entry.ln()).sum();
                shape + lengths.iter().map(|length| 2.0 * length.ln()).sum::<f64>()
            }
            None => f64::NEG_INFINITY,
        };
        let inverse = cholesky.map(|cholesky| cholesky.inverse());
        let errors = (0..self.rank())
            .map(|index| ExpectedError {
                name: self.names[index].clone(),
                value: self.values[index],
                std_error: inverse
                    .as_ref()
                    .map_or(f64::INFINITY, |inverse| inverse[(index, index)].max(0.0).sqrt() / lengths[index]),
            })
            .collect();
        Expected { noise: noise.to_vec(), log_det, condition, errors }
    }
}

/// Rows over the noise of their joint.
fn weighted(mut rows: DMatrix<f64>, noise: &[f64]) -> DMatrix<f64> {
    for (index, mut row) in rows.row_iter_mut().enumerate() {
        row /= noise[index % noise.len()];
    }
    rows
}

/// `log det` of the information of the columns in which a kernel and the effects are linear: what an optimisation compares,
/// cheaper than [`BaseRegressor::expected`] and larger by a constant.
pub struct Information<'a> {
    system: &'a System,
    /// Of the kernel's lumps, those that are independent.
    lumps: Vec<usize>,
    /// Of the system's effect parameters, those that are linear and independent of the lumps.
    effects: Vec<usize>,
}

impl<'a> Information<'a> {
    pub(crate) fn new(model: &Model, system: &'a System) -> Self {
        let parameters = LinearParameters::of_model(model, std::slice::from_ref(system));
        let linear: Vec<usize> = (0..system.effect_names().len())
            .filter(|&index| parameters.names[parameters.n_link..].contains(&system.effect_names()[index]))
            .collect();
        let n_lumps = system.kernel().n_lumps;
        let all = Self { system, lumps: (0..n_lumps).collect(), effects: linear };
        let n = system.n_free();
        let mut random = Random::new(67);
        let motions = (n_lumps + all.effects.len() + 10).div_ceil(n);
        let draws: Vec<Motion> = (0..motions).map(|_| Motion::random(n, &mut random)).collect();
        let path = Path {
            time: draws.iter().map(|motion| motion.t).collect(),
            q: draws.iter().map(|motion| motion.q.clone()).collect(),
            dq: draws.iter().map(|motion| motion.dq.clone()).collect(),
            ddq: draws.iter().map(|motion| motion.ddq.clone()).collect(),
        };
        let kept = independent(&all.rows(&path));
        let (lumps, effects): (Vec<usize>, Vec<usize>) = kept.into_iter().partition(|&column| column < n_lumps);
        let effects = effects.into_iter().map(|column| all.effects[column - n_lumps]).collect();
        Self { system, lumps, effects }
    }

    fn rows(&self, path: &Path) -> DMatrix<f64> {
        let kernel = self.system.kernel();
        let n = self.system.n_free();
        let n_columns = self.lumps.len() + self.effects.len();
        let mut rows = DMatrix::zeros(n * path.time.len(), n_columns);
        let mut y = vec![0.0; n * kernel.n_lumps];
        let mut linear = Linear::new(self.system);
        let command = vec![0.0; self.system.n_joints()];
        let mut x = self.system.rest(&vec![0.0; n]);
        let mut dx = vec![0.0; self.system.n_states()];
        for sample in 0..path.time.len() {
            let (q, dq, ddq) = (&path.q[sample], &path.dq[sample], &path.ddq[sample]);
            if kernel.n_lumps > 0 {
                kernel.functions.regressor(self.system.prepared(), q, dq, ddq, &mut y);
            }
            for row in 0..n {
                for (column, &lump) in self.lumps.iter().enumerate() {
                    rows[(sample * n + row, column)] = y[row * kernel.n_lumps + lump];
                }
            }
            if self.effects.is_empty() {
                continue;
            }
            x[..n].copy_from_slice(q);
            x[n..2 * n].copy_from_slice(dq);
            linear.along(self.system, path.time[sample], &x, Some(ddq), &command, &mut dx);
            for &(row, parameter, value) in &linear.torque_by_parameter {
                if let Some(column) = self.effects.iter().position(|known| *known == parameter) {
                    rows[(sample * n + row, self.lumps.len() + column)] -= value;
                }
            }
        }
        rows
    }

    /// `-inf` where something stays dark.
    pub fn log_det(&self, path: &Path, noise: &[f64]) -> f64 {
        let mut rows = weighted(self.rows(path), noise);
        let mut sum = 0.0;
        for mut column in rows.column_iter_mut() {
            let length = column.norm();
            if length == 0.0 {
                return f64::NEG_INFINITY;
            }
            column /= length;
            sum += 2.0 * length.ln();
        }
        let gram = rows.transpose() * &rows;
        match gram.cholesky() {
            Some(cholesky) => sum + cholesky.l().diagonal().iter().map(|entry| 2.0 * entry.ln()).sum::<f64>(),
            None => f64::NEG_INFINITY,
        }
    }
}

/// Torque that each free joint needs along a motion, one row a sample: rigid body, link effects and joint effects, whose
/// states follow the motion from where they start.
pub fn needed_torque(system: &System, path: &Path) -> Vec<Vec<f64>> {
    /// A step is at most this share of the fastest state's time constant; Runge-Kutta is stable up to 2.8.
    const STEP_SHARE: f64 = 0.7;
    const MOST_STEPS: f64 = 400.0;
    let n = system.n_free();
    let command = vec![0.0; system.n_joints()];
    let groups = system.state_groups();
    let mut scratch = system.scratch();
    let mut linear = Linear::new(system);
    let mut dx = vec![0.0; system.n_states()];
    let mut states = system.rest(&vec![0.0; n])[2 * n..].to_vec();
    let mut x = system.rest(&vec![0.0; n]);
    let mut torques = Vec::with_capacity(path.time.len());
    for sample in 0..path.time.len() {
        let (q, dq, ddq) = (&path.q[sample], &path.dq[sample], &path.ddq[sample]);
        x[..n].copy_from_slice(q);
        x[n..2 * n].copy_from_slice(dq);
        x[2 * n..].copy_from_slice(&states);
        linear.along(system, path.time[sample], &x, None, &command, &mut dx);
        let mut torque = vec![0.0; n];
        system.kernel().functions.inverse_dynamics(system.prepared(), q, dq, ddq, &mut torque);
        system.add_inertia_torque(ddq, &mut torque);
        torque.iter_mut().zip(linear.load()).for_each(|(torque, load)| *torque += load);
        torques.push(torque);
        let Some(&end) = path.time.get(sample + 1) else { break };
        if states.is_empty() {
            continue;
        }
        let span_s = end - path.time[sample];
        let own = linear.rate_by_state.iter().filter(|(state, other, _)| state == other);
        let fastest = own.fold(0.0_f64, |fastest, (.., rate)| fastest.max(rate.abs()));
        let n_steps = (1.5 * fastest * span_s / STEP_SHARE).ceil().clamp(4.0, MOST_STEPS) as usize;
        let step = span_s / n_steps as f64;
        let mut rate = |share: f64, z: &[f64]| -> Vec<f64> {
            for slot in 0..n {
                x[slot] = q[slot] + share * (path.q[sample + 1][slot] - q[slot]);
                x[n + slot] = dq[slot] + share * (path.dq[sample + 1][slot] - dq[slot]);
            }
            x[2 * n..].copy_from_slice(z);
            let t = path.time[sample] + share * span_s;
            groups.iter().for_each(|group| system.follow(group, &mut scratch, t, &x, &command, &mut dx));
            dx[2 * n..].to_vec()
        };
        for index in 0..n_steps {
            let share = |part: f64| (index as f64 + part) / n_steps as f64;
            let moved = |rate: &[f64], by: f64| -> Vec<f64> {
                states.iter().zip(rate).map(|(z, rate)| z + by * step * rate).collect()
            };
            let k1 = rate(share(0.0), &states);
            let k2 = rate(share(0.5), &moved(&k1, 0.5));
            let k3 = rate(share(0.5), &moved(&k2, 0.5));
            let k4 = rate(share(1.0), &moved(&k3, 1.0));
            for (index, z) in states.iter_mut().enumerate() {
                *z += step / 6.0 * (k1[index] + 2.0 * (k2[index] + k3[index]) + k4[index]);
            }
        }
    }
    torques
}

/// The drive path as `torque = slope command + offset`, where it is that: gains, couplings, offsets.
#[derive(Debug, Clone, PartialEq)]
pub struct Drive {
    inverse: DMatrix<f64>,
    offset: DVector<f64>,
}

impl Drive {
    /// `None` where the drive path has a memory, is no straight line, or cannot be inverted.
    pub fn of(system: &System) -> Option<Self> {
        if !system.steady_drive() {
            return None;
        }
        let n = system.n_free();
        let free = system.kernel().free;
        let mut linear = Linear::new(system);
        let x = system.rest(&vec![0.0; n]);
        let mut dx = vec![0.0; system.n_states()];
        let mut drive = |command: &DVector<f64>| -> DVector<f64> {
            let mut commands = vec![0.0; system.n_joints()];
            free.iter().zip(command.iter()).for_each(|(&joint, value)| commands[joint] = *value);
            linear.along(system, 0.0, &x, None, &commands, &mut dx);
            DVector::from_column_slice(linear.drive())
        };
        let offset = drive(&DVector::zeros(n));
        let columns: Vec<DVector<f64>> = (0..n)
            .map(|slot| drive(&DVector::from_fn(n, |row, _| f64::from(u8::from(row == slot)))) - &offset)
            .collect();
        let slope = DMatrix::from_columns(&columns);
        let mut random = Random::new(71);
        for size in [1e-3, 1.0, 1e3] {
            let command = DVector::from_vec(random.vector(n, -size, size));
            let straight = &slope * &command + &offset;
            if (drive(&command) - &straight).amax() > 1e-9 * straight.amax() {
                return None;
            }
        }
        Some(Self { inverse: slope.try_inverse()?, offset })
    }

    /// Size of the command of a free joint that makes a torque of one there, the others commanding what keeps theirs.
    pub fn command_per_torque(&self, slot: usize) -> f64 {
        self.inverse[(slot, slot)].abs()
    }

    /// The commands that make these torques.
    pub fn command(&self, torque: &[f64]) -> Vec<f64> {
        (&self.inverse * (DVector::from_column_slice(torque) - &self.offset)).as_slice().to_vec()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::times;

    pub(crate) fn arm() -> (Model, System) {
        let model = Model::of_device(dynid_model::device("planar2r").unwrap());
        let system = model.system(&[0, 1], |_| 0.0).unwrap();
        (model, system)
    }

    fn swing(frequency: f64) -> Path {
        let time = times(4.0, 0.01);
        let place = |t: &f64| vec![(frequency * t).sin(), 0.7 * (1.7 * frequency * t).cos()];
        Path::of_positions(&time, time.iter().map(place).collect())
    }

    /// Least squares on torques with noise, many times over: the scatter is what was expected.
    #[test]
    fn expected_errors_are_those_of_least_squares() {
        const TRIALS: usize = 400;
        let (model, system) = arm();
        let regressor = BaseRegressor::new(&model, &system);
        let (path, noise) = (swing(2.0), [0.05, 0.02]);
        let expected = regressor.expected(&path, &noise);
        let rows = weighted(regressor.rows(&path), &noise);
        let beta = DVector::from_iterator(regressor.rank(), expected.errors.iter().map(|error| error.value));
        let solver = rows.clone().svd(true, true);
        let mut random = Random::new(3);
        let mut scatter = vec![0.0; beta.len()];
        for _ in 0..TRIALS {
            let torque = &rows * &beta + DVector::from_fn(rows.nrows(), |_, _| random.normal());
            let found = solver.solve(&torque, 0.0).unwrap();
            scatter.iter_mut().zip((found - &beta).iter()).for_each(|(sum, error)| *sum += error * error);
        }
        for (error, scatter) in expected.errors.iter().zip(scatter) {
            // the standard deviation of 400 draws is known to 3.5 %; four of those
            let ratio = (scatter / TRIALS as f64).sqrt() / error.std_error;
            assert!((ratio - 1.0).abs() < 0.14, "{}: {ratio}", error.name);
        }
        let information = rows.transpose() * &rows;
        assert!((expected.log_det - information.determinant().ln()).abs() < 1e-6);
    }

    /// Other coordinates of the same base parameters: only a constant apart.
    #[test]
    fn the_search_compares_what_is_reported() {
        let (model, system) = arm();
        let (regressor, information) = (BaseRegressor::new(&model, &system), Information::new(&model, &system));
        let noise = [0.05, 0.02];
        let apart = |path: &Path| information.log_det(path, &noise) - regressor.expected(path, &noise).log_det;
        let (slow, fast) = (apart(&swing(1.0)), apart(&swing(3.0)));
        assert!((slow - fast).abs() < 1e-6, "{slow} {fast}");
    }

    #[test]
    fn a_drive_path_is_inverted_where_it_is_straight() {
        let mut model = Model::of_device(dynid_model::device("freedom6s").unwrap());
        model.add_effect("input_coupling", Some(4), Some(5)).unwrap();
        model.set_value("joint.4.input_coupling.5.gain", -0.2).unwrap();
        let drive = Drive::of(&model.system(&[4, 5], |_| 0.0).unwrap()).unwrap();
        // Eqs 4.5, 4.6: Kp4 (u4 - 0.2 u5) and Kp5 u5
        let kp = |joint: usize| model.parameter(&format!("joint.{joint}.gain.Kp")).unwrap().value;
        let (u4, u5) = (0.3, -0.7);
        let command = drive.command(&[kp(4) * (u4 - 0.2 * u5), kp(5) * u5]);
        assert!((command[0] - u4).abs() < 1e-12 && (command[1] - u5).abs() < 1e-12, "{command:?}");
        model.add_effect("dead_zone", Some(4), None).unwrap();
        for parameter in model.names().into_iter().filter(|name| name.contains("dead_zone")) {
            model.set_value(&parameter, 0.1).unwrap();
        }
        assert_eq!(Drive::of(&model.system(&[4, 5], |_| 0.0).unwrap()), None);
    }

    /// The wrist's last joint, gravity along its axis: two moments stay dark.
    #[test]
    fn a_special_pose_reveals_less() {
        let model = Model::of_device(dynid_model::device("freedom6s").unwrap());
        let upright = model.system(&[4, 5], |_| 0.0).unwrap();
        let regressor = BaseRegressor::new(&model, &upright);
        assert!(regressor.rank() < regressor.rank_elsewhere(&model).unwrap());
    }
}

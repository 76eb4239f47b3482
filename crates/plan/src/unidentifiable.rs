//! Unidentifiable directions: changes of parameters that leave every motion as it is.
//!
//! Along a motion, `drive - load - (D ddq + h) = 0` and the states of effects follow their rates. A change of parameters
//! leaves the motion as it is if it changes neither, a state being free to change its own scale. The rows of these first
//! order changes, stacked over random states and commands, have a null space: what stands in it is found from the model
//! alone. That of the link parameters by themselves is what the base parameters already tell ([`super::base`]); here is
//! what effects add, e.g. a scale shared by gains, stiffnesses, frictions and inertias.

use nalgebra::DMatrix;

use super::{base::BaseParameters, linear::LinearParameters};
use crate::PlanError;
use dynid_dynamics::{system::Linear, system::System};
use dynid_optimise::identifiability::standing;
use dynid_random::Random;
use dynid_user_model::Model;

/// A change of parameters that leaves every motion as it is.
#[derive(Debug, Clone, PartialEq)]
pub struct UnidentifiableDirection {
    /// Effects' parameters and the combinations of link parameters that change, largest first: name, and the change
    /// relative to the value (absolute where the value is zero), the largest being 1.
    pub changes: Vec<(String, f64)>,
    /// Parameters of which any one, once fixed, removes the direction.
    pub fix_one_of: Vec<String>,
}

impl UnidentifiableDirection {
    /// Whether it is a scale: everything that changes does so in one proportion.
    pub fn is_scale(&self) -> bool {
        self.changes.iter().all(|(_, change)| (change - 1.0).abs() < SAME)
    }
}

/// Joints that are free together, and what the machine carries then: a load that is known tells a scale.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Circumstances {
    /// The free joints, ascending.
    pub free: Vec<usize>,
    /// The payload, as a run names it; nothing where there is none.
    pub payload: Option<String>,
}

/// Changes that differ by less are the same.
const SAME: f64 = 1e-5;

/// The unidentifiable directions of a model in all of these circumstances together; fixed parameters stay as they are.
///
/// # Errors
/// Free joints without a kernel, or an effect that cannot be simulated.
pub fn unidentifiable_directions(
    model: &Model,
    circumstances: &[Circumstances],
    base: &BaseParameters,
) -> Result<Vec<UnidentifiableDirection>, PlanError> {
    let system = |own: &Circumstances| model.system_carrying(own.payload.as_deref(), &own.free, |_| 0.0);
    let systems = circumstances.iter().map(system).collect::<Result<Vec<_>, _>>()?;
    let unknown: Vec<(String, f64)> = model
        .parameters()
        .into_iter()
        .filter(|(name, parameter)| {
            let acts = |system: &System| {
                system.effect_names().contains(name) || super::appearing(system.kernel()).contains(name)
            };
            !parameter.fixed && systems.iter().any(acts)
        })
        .map(|(name, parameter)| {
            let range = 0.5 * (parameter.upper - parameter.lower);
            let spread = if range > 0.0 && range.is_finite() { range } else { 1.0 };
            (name, if parameter.value == 0.0 { spread } else { parameter.value.abs() })
        })
        .collect();
    let n_links = unknown.iter().filter(|(name, _)| name.starts_with("link.")).count();
    let n_states: usize = systems.iter().map(|system| system.n_states() - 2 * system.n_free()).sum();
    let mut random = Random::new(41);
    let n_unknown = unknown.len();
    let n_columns = n_unknown + n_states;
    if n_columns == 0 {
        return Ok(Vec::new());
    }
    let mut first_state = n_unknown;
    let mut factor = DMatrix::zeros(0, n_columns);
    for system in &systems {
        let rows = sensitivity(model, system, &unknown, n_columns, first_state, &mut random)?;
        first_state += system.n_states() - 2 * system.n_free();
        factor = stacked(&factor, &rows).qr().r();
    }
    // What the link parameters can do, without what they can do unseen: their coordinates in the row space.
    let links = factor.columns(0, n_links).into_owned();
    let visible = visible_directions(&links);
    let rank = visible.ncols();
    let mut reduced = DMatrix::zeros(factor.nrows(), rank + n_columns - n_links);
    reduced.columns_mut(0, rank).copy_from(&(&links * &visible));
    reduced.columns_mut(rank, n_columns - n_links).copy_from(&factor.columns(n_links, n_columns - n_links));
    let n_reduced = reduced.ncols();
    let found = standing(&reduced, &DMatrix::identity(n_reduced, n_reduced), &vec![1.0; n_reduced]);
    let alone = base.identifiable_alone(model);
    let by_base = BaseChange::new(model, base, &unknown[..n_links]);
    Ok(found
        .flat
        .iter()
        .filter_map(|flat| {
            let links = &visible * DMatrix::from_column_slice(rank, 1, &flat[..rank]);
            let effects = &flat[rank..rank + n_unknown - n_links];
            let mut changes: Vec<(String, f64)> =
                unknown[n_links..].iter().map(|(name, _)| name.clone()).zip(effects.iter().copied()).collect();
            let mut fix_one_of: Vec<String> =
                changes.iter().filter(|(_, change)| change.abs() > SAME).map(|(name, _)| name.clone()).collect();
            let fixing = (0..n_links).filter(|&index| alone.contains(&unknown[index].0) && links[index].abs() > SAME);
            fix_one_of.extend(fixing.map(|index| unknown[index].0.clone()));
            changes.extend(by_base.of(links.as_slice()));
            let largest =
                changes.iter().fold(
                    0.0_f64,
                    |largest, (_, change)| {
                        if change.abs() > largest.abs() + SAME { *change } else { largest }
                    },
                );
            // Only a state changed its scale: nothing that has a name.
            if largest == 0.0 {
                return None;
            }
            changes.iter_mut().for_each(|(_, change)| *change /= largest);
            changes.retain(|(_, change)| change.abs() > SAME);
            Some(UnidentifiableDirection { changes, fix_one_of })
        })
        .collect())
}

/// Orthonormal directions of the columns of `rows` that its rows see.
fn visible_directions(rows: &DMatrix<f64>) -> DMatrix<f64> {
    /// As in [`dynid_optimise::identifiability`].
    const RANK_TOLERANCE: f64 = 1e-9;
    let lengths: Vec<f64> = rows.column_iter().map(|column| column.norm()).collect();
    let largest_length = lengths.iter().fold(0.0_f64, |largest, length| largest.max(*length));
    let used: Vec<usize> = (0..lengths.len()).filter(|&index| lengths[index] > 1e-11 * largest_length).collect();
    if used.is_empty() {
        return DMatrix::zeros(rows.ncols(), 0);
    }
    let scaled =
        DMatrix::from_fn(rows.nrows(), used.len(), |row, column| rows[(row, used[column])] / lengths[used[column]]);
    let svd = scaled.svd(false, true);
    let largest = svd.singular_values.max();
    let Some(v_t) = svd.v_t else { return DMatrix::zeros(rows.ncols(), 0) };
    let seen: Vec<usize> =
        (0..svd.singular_values.len()).filter(|&index| svd.singular_values[index] > RANK_TOLERANCE * largest).collect();
    let mut directions = DMatrix::zeros(rows.ncols(), seen.len());
    for (column, &index) in seen.iter().enumerate() {
        for (place, &parameter) in used.iter().enumerate() {
            directions[(parameter, column)] = v_t[(index, place)] / lengths[parameter] * largest_length;
        }
    }
    directions
}

fn stacked(above: &DMatrix<f64>, below: &DMatrix<f64>) -> DMatrix<f64> {
    let mut rows = DMatrix::zeros(above.nrows() + below.nrows(), below.ncols());
    rows.rows_mut(0, above.nrows()).copy_from(above);
    rows.rows_mut(above.nrows(), below.nrows()).copy_from(below);
    rows
}

/// First-order changes of the equations by the unknowns (over their sizes) and by the scales of the effects' states, each
/// row of length one.
fn sensitivity(
    model: &Model,
    system: &System,
    unknown: &[(String, f64)],
    n_columns: usize,
    first_state: usize,
    random: &mut Random,
) -> Result<DMatrix<f64>, PlanError> {
    let kernel = system.kernel();
    let n = system.n_free();
    let n_states = system.n_states();
    let n_z = n_states - 2 * n;
    let place = |name: &str| unknown.iter().position(|(known, _)| known == name);
    let link_columns: Vec<(usize, usize)> =
        kernel.parameters.iter().enumerate().filter_map(|(index, name)| Some((index, place(name)?))).collect();
    let effect_columns: Vec<Option<usize>> = system.effect_names().iter().map(|name| place(name)).collect();
    let n_moments = (2 * n_columns).div_ceil(n);
    let mut rows = DMatrix::zeros(n_moments * (n + n_z), n_columns);
    let mut linear = Linear::new(system);
    let mut scratch = system.scratch();
    let mut dx = vec![0.0; n_states];
    let mut gradient = vec![0.0; kernel.prepared.len() * kernel.parameters.len()];
    for moment in 0..n_moments {
        // Locked joints stand elsewhere each time; runs at several poses are one experiment.
        let pose = random.vector(system.n_joints(), -3.0, 3.0);
        let moved = model.system(kernel.free, |joint| pose[joint])?;
        kernel.functions.prepare_gradient(moved.link_parameters(), moved.locked(), &mut gradient);
        let mut x = random.vector(n_states, -1.0, 1.0);
        for speed in &mut x[n..2 * n] {
            // from creeping to fast: friction changes its face by decades
            *speed = speed.signum() * 10.0_f64.powf(random.between(-3.0, 1.0));
        }
        let command = random.vector(system.n_joints(), -1.0, 1.0);
        let t = random.between(0.0, 100.0);
        linear.set_late(random.vector(moved.delays().len(), -1.0, 1.0));
        moved.derivative(&mut scratch, t, &x, &command, &mut dx);
        let ddq = dx[n..2 * n].to_vec();
        linear.along(&moved, t, &x, Some(&ddq), &command, &mut dx);
        let first = moment * (n + n_z);
        for row in 0..n {
            for &(parameter, column) in &link_columns {
                let change: f64 = (0..kernel.n_lumps)
                    .map(|lump| {
                        linear.regressor[row * kernel.n_lumps + lump]
                            * gradient[lump * kernel.parameters.len() + parameter]
                    })
                    .sum();
                rows[(first + row, column)] -= change;
            }
            for z in 0..n_z {
                rows[(first + row, first_state + z)] +=
                    linear.torque_by_state[row * n_states + 2 * n + z] * x[2 * n + z];
            }
        }
        for &(row, parameter, value) in &linear.torque_by_parameter {
            if let Some(column) = effect_columns[parameter] {
                rows[(first + row, column)] += value;
            }
        }
        for &(state, parameter, value) in &linear.rate_by_parameter {
            if let Some(column) = effect_columns[parameter] {
                rows[(first + n + state - 2 * n, column)] += value;
            }
        }
        for &(state, other, value) in linear.rate_by_state.iter().filter(|(_, other, _)| *other >= 2 * n) {
            rows[(first + n + state - 2 * n, first_state + other - 2 * n)] += value * x[other];
        }
        for z in 0..n_z {
            rows[(first + n + z, first_state + z)] -= dx[2 * n + z];
        }
    }
    for (column, (_, size)) in unknown.iter().enumerate() {
        rows.column_mut(column).scale_mut(*size);
    }
    for mut row in rows.row_iter_mut() {
        let length = row.norm();
        if length > 0.0 {
            row /= length;
        }
    }
    Ok(rows)
}

/// How the base parameters of links change with the standard ones.
struct BaseChange {
    /// The combinations, without what effects add to them.
    names: Vec<String>,
    /// Their values; exactly zero where only rounding is left.
    values: Vec<f64>,
    /// Rows a combination, columns an unknown over its size.
    by_unknown: DMatrix<f64>,
}

impl BaseChange {
    fn new(model: &Model, base: &BaseParameters, unknown: &[(String, f64)]) -> Self {
        let bodies: Vec<[f64; 10]> = model.links.iter().map(|link| link.map(|parameter| parameter.value)).collect();
        let of_links: Vec<usize> =
            (0..base.rank()).filter(|&index| base.combinations[index].leading < base.n_link).collect();
        let matrix = base.matrix(model).columns(0, base.n_link).into_owned().select_rows(&of_links);
        let by_standard = &matrix * LinearParameters::by_standard(&bodies);
        let standard: Vec<String> = model.names().into_iter().filter(|name| name.starts_with("link.")).collect();
        let mut by_unknown = DMatrix::zeros(of_links.len(), unknown.len());
        for (column, (name, size)) in unknown.iter().enumerate() {
            if let Some(place) = standard.iter().position(|known| known == name) {
                by_unknown.column_mut(column).copy_from(&(by_standard.column(place) * *size));
            }
        }
        let linear = LinearParameters { names: base.names[..base.n_link].to_vec(), n_link: base.n_link }.values(model);
        let values = (0..matrix.nrows()).map(|row| {
            let terms =
                || matrix.row(row).iter().zip(&linear).map(|(factor, value)| factor * value).collect::<Vec<f64>>();
            let (sum, size) = terms().iter().fold((0.0, 0.0), |(sum, size), term| (sum + term, size + term.abs()));
            if sum.abs() > 1e-12 * size { sum } else { 0.0 }
        });
        Self {
            names: of_links.iter().map(|&index| base.links_in_words(&base.combinations[index])).collect(),
            values: values.collect(),
            by_unknown,
        }
    }

    /// Relative change of each combination (absolute where it is zero) with the unknowns.
    fn of(&self, change: &[f64]) -> Vec<(String, f64)> {
        let change = &self.by_unknown * DMatrix::from_column_slice(change.len(), 1, change);
        let relative = |(change, value): (&f64, &f64)| if *value == 0.0 { *change } else { change / value };
        self.names.iter().cloned().zip(change.iter().zip(&self.values).map(relative)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::base_parameters;
    use dynid_dynamics::{simulate::Input, simulate::Intersample, simulate::Options, simulate::simulate};

    fn flat(model: &Model, configurations: &[usize]) -> Vec<UnidentifiableDirection> {
        carrying(model, configurations, &[None])
    }

    fn carrying(model: &Model, configurations: &[usize], payloads: &[Option<&str>]) -> Vec<UnidentifiableDirection> {
        let configuration = |number: &usize| model.device.configurations[number - 1].free.clone();
        let free: Vec<Vec<usize>> = configurations.iter().map(configuration).collect();
        let base = base_parameters(model, &free).unwrap();
        let with = |payload: &Option<&str>| {
            let payload = payload.map(str::to_owned);
            free.iter().map(move |free| Circumstances { free: free.clone(), payload: payload.clone() })
        };
        let all: Vec<Circumstances> = payloads.iter().flat_map(with).collect();
        unidentifiable_directions(model, &all, &base).unwrap()
    }

    fn freedom() -> Model {
        Model::of_device(dynid_model::device("freedom6s").unwrap())
    }

    /// One joint of the wrist: gain, friction, spring and what the link weighs share one scale. Scaled by 30 %, a
    /// simulation shows the same motion.
    #[test]
    fn a_joint_with_unknown_gain_has_a_scale() {
        let model = freedom();
        let found = flat(&model, &[1]);
        let [scale] = found.as_slice() else { panic!("{found:#?}") };
        assert!(scale.is_scale(), "{scale:#?}");
        let names: Vec<&str> = scale.changes.iter().map(|(name, _)| name.as_str()).collect();
        for name in ["gain.Kp", "spring.Ks", "lugre.sigma0", "lugre.sigma1", "lugre.sigma2", "lugre.Fs", "lugre.Fc"] {
            assert!(names.contains(&format!("joint.4.{name}").as_str()), "{name} is not in {names:?}");
        }
        assert!(["link.7.Jzz", "link.7.mx", "link.7.my"].iter().all(|name| names.contains(name)), "{names:?}");
        assert_eq!(names.len(), 10, "{names:?}");

        let time: Vec<f64> = (0..300).map(|k| f64::from(k) * 0.01).collect();
        let command: Vec<f64> = time.iter().flat_map(|t| [0.0, 0.0, 0.0, 0.0, 0.01 * (3.0 * t).cos(), 0.0]).collect();
        let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
        let run = |model: &Model| {
            let system = model.system(&[4], |_| 0.3).unwrap();
            simulate(&system, &input, &[0.1], &Options::default()).unwrap().q
        };
        let mut scaled = model.clone();
        for name in names.iter().filter(|name| name.starts_with("joint")) {
            scaled.set_value(name, 1.3 * model.parameter(name).unwrap().value).unwrap();
        }
        for symbol in ["m", "Izz"] {
            let name = format!("link.7.{symbol}");
            scaled.set_value(&name, 1.3 * model.parameter(&name).unwrap().value).unwrap();
        }
        let (before, after) = (run(&model), run(&scaled));
        assert!(before.iter().any(|q| (q - before[0]).abs() > 0.1), "it moves");
        let change = before.iter().zip(&after).fold(0.0_f64, |change, (a, b)| change.max((a - b).abs()));
        assert!(change < 1e-11, "{change:e}");
    }

    #[test]
    fn what_is_fixed_removes_the_direction() {
        let mut model = freedom();
        let [scale] = flat(&model, &[1]).try_into().unwrap();
        assert!(scale.fix_one_of.contains(&"joint.4.gain.Kp".to_owned()));
        for name in ["joint.4.gain.Kp", "joint.4.spring.Ks"] {
            let known = model.parameter(name).unwrap();
            model.set(name, dynid_model::Parameter { fixed: true, ..known }).unwrap();
            assert_eq!(flat(&model, &[1]), [], "{name}");
            model.set(name, known).unwrap();
        }
        // a centroid has no scale: with it known, the direction stays
        let name = "link.7.x";
        model.set(name, dynid_model::Parameter { fixed: true, ..model.parameter(name).unwrap() }).unwrap();
        assert_eq!(flat(&model, &[1]).len(), 1);
    }

    /// Gains of coupled joints share one scale: the inertia ties them.
    #[test]
    fn coupled_joints_share_one_scale() {
        let found = flat(&freedom(), &[12]);
        assert_eq!(found.len(), 1, "{found:#?}");
        assert!(found[0].is_scale());
        let gains = found[0].changes.iter().filter(|(name, _)| name.ends_with("gain.Kp")).count();
        assert_eq!(gains, 6);
    }

    /// Torques in N*m without a gain in between fix the scale.
    #[test]
    fn without_a_gain_nothing_is_flat() {
        let model = Model::of_device(dynid_model::device("double_pendulum").unwrap());
        let found = flat(&model, &[1, 2, 3]);
        assert!(found.iter().all(|direction| !direction.is_scale()), "{found:#?}");
    }

    /// A load that was weighed tells what an ampere is worth, where some runs carry it and some do not.
    #[test]
    fn a_known_payload_tells_the_scale() {
        let text = "device = \"planar2r\"\n[[effect]]\nid = \"gain\"\njoint = 1\n[[effect]]\nid = \"viscous\"\njoint = 1\n\
                    [[effect]]\nid = \"payload\"\njoint = 1\npayload = \"weight\"\nm = { value = 0.5, fixed = true }\n\
                    x = { value = 0.1, fixed = true }\ny = { value = 0.0, fixed = true }\nz = { value = 0.0, fixed = true }\n";
        let model = Model::parse(text, std::path::Path::new("model.toml")).unwrap();
        let bare = flat(&model, &[2]);
        assert!(bare.len() == 1 && bare[0].is_scale(), "{bare:#?}");
        assert_eq!(carrying(&model, &[2], &[None, Some("weight")]), []);
        // Of two bodies that always move as one, the known one tells nothing.
        assert_eq!(carrying(&model, &[2], &[Some("weight")]).len(), 1);
        assert_eq!(carrying(&model, &[2], &[None, Some("another")]).len(), 1);
    }
}

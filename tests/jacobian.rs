//! The exact derivatives of simulated positions against central differences, on a whole device.

use dynid_dynamics::{
    simulate, simulate::Input, simulate::Intersample, simulate::Options, simulate::Steps, system::System,
};
use dynid_identify::{sensitivity, sensitivity::Columns, sensitivity::Lumps};
use dynid_plant::random::Noise;
use dynid_user_model::Model;
use rayon::prelude::*;

/// Every joint is free.
const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];
const SAMPLES: usize = 101;
const OPTIONS: Options = Options { steps: Steps::PerSample(20), position_limit: 1e3 };
/// What a change of an unknown does to the positions, at most [rad]: well above rounding, well below all curvature.
const CHANGE: f64 = 1e-7;

/// The device with coupled tendons, every value up to 20 % off its own.
///
/// Without friction bias: at its jump a numeric solution has steps of its own, which differences see.
fn model(noise: &mut Noise) -> Model {
    let mut model = Model::of_device(dynid_model::device("freedom6s").expect("a shipped device"));
    let add = |model: &mut Model, id: &str, joint: usize, from: Option<usize>| {
        model.add_effect(id, Some(joint), from).expect("an effect of the library");
    };
    add(&mut model, "input_coupling", 4, Some(5));
    add(&mut model, "input_coupling", 5, Some(4));
    let start: Vec<(String, f64)> =
        model.parameters().into_iter().map(|(name, parameter)| (name, parameter.value)).collect();
    for (name, value) in start {
        let value = if name.contains("input_coupling") { 0.3 } else { value };
        let off = if name.starts_with("length") || name.starts_with("base") { 0.0 } else { 0.2 };
        model.set_value(&name, value * (1.0 + off * (2.0 * noise.uniform() - 1.0))).expect("its own name");
    }
    model
}

/// Chirps that keep every joint moving, and turn it round more than once.
fn command(time: &[f64], noise: &mut Noise) -> Vec<f64> {
    const AMPLITUDES: [f64; 6] = [0.1, 0.2, 0.1, 0.02, 0.02, 0.05];
    let phases: Vec<f64> = ALL.iter().map(|_| 6.0 * noise.uniform()).collect();
    let torque = |joint: usize, t: f64| AMPLITUDES[joint] * ((6.0 + joint as f64 + 2.0 * t) * t + phases[joint]).cos();
    time.iter().flat_map(|t| ALL.map(|joint| torque(joint, *t))).collect()
}

/// Where an unknown enters.
#[derive(Clone, Copy)]
enum Unknown {
    Link(usize),
    Effect(usize),
    Initial(usize),
}

/// A system, what drives it and where it starts.
struct Case {
    system: System,
    command: Vec<f64>,
    time: Vec<f64>,
    q0: Vec<f64>,
}

impl Case {
    fn new(seed: u64) -> Self {
        let mut noise = Noise::new(seed);
        let model = model(&mut noise);
        let system = model.system(&ALL, |_| 0.0).expect("a configuration of the device");
        let time: Vec<f64> = (0..SAMPLES).map(|k| 0.01 * k as f64).collect();
        let command = command(&time, &mut noise);
        let q0 = ALL.iter().map(|_| 0.2 * noise.uniform() - 0.1).collect();
        Self { system, command, time, q0 }
    }

    fn input(&self) -> Input<'_> {
        Input { time: &self.time, command: &self.command, intersample: Intersample::ZeroOrder }
    }

    fn positions(&self, unknown: Unknown, change: f64) -> Vec<f64> {
        let mut system = self.system.clone();
        let mut links = system.link_parameters().to_vec();
        let mut effects = system.effect_parameters().to_vec();
        let mut q0 = self.q0.clone();
        match unknown {
            Unknown::Link(index) => links[index] += change,
            Unknown::Effect(index) => effects[index] += change,
            Unknown::Initial(slot) => q0[slot] += change,
        }
        system.set_parameters(&links, &effects);
        simulate::simulate(&system, &self.input(), &q0, &OPTIONS).expect("it stays bounded").q
    }

    /// How far to move an unknown that changes positions by up to `scale` each; effects never far by their own measure.
    fn size(&self, unknown: Unknown, scale: f64) -> f64 {
        const SHARE: f64 = 5e-4;
        match unknown {
            Unknown::Effect(index) => (CHANGE / scale).min(SHARE * self.system.effect_parameters()[index].abs()),
            Unknown::Link(_) | Unknown::Initial(_) => CHANGE / scale,
        }
    }

    /// Richardson's extrapolation of two central differences: the error is of fourth order.
    fn difference(&self, unknown: Unknown, size: f64) -> Vec<f64> {
        let [plus, minus, plus2, minus2] = [1.0, -1.0, 2.0, -2.0].map(|share| self.positions(unknown, share * size));
        (0..plus.len()).map(|k| (8.0 * (plus[k] - minus[k]) - (plus2[k] - minus2[k])) / (12.0 * size)).collect()
    }

    /// Every unknown that changes a position, with its name and its exact derivative of the positions.
    fn exact(&self) -> Vec<(String, Unknown, Vec<f64>)> {
        let system = &self.system;
        let kernel = system.kernel();
        let columns = Columns::new(system, |_| true, Lumps::Wanted);
        let mut rows: Vec<Vec<f64>> = Vec::new();
        sensitivity::simulate(system, &columns, &self.input(), &self.q0, &OPTIONS, |_, _, sample| {
            rows.extend(sample.chunks(columns.width()).map(<[f64]>::to_vec));
        })
        .expect("it stays bounded");
        let n_links = kernel.parameters.len();
        let mut by_link = vec![0.0; kernel.prepared.len() * n_links];
        kernel.functions.prepare_gradient(system.link_parameters(), system.locked(), &mut by_link);
        let link = |index: usize| -> Vec<f64> {
            let chain = |row: &Vec<f64>| {
                columns.lumps().enumerate().map(|(lump, column)| row[column] * by_link[lump * n_links + index]).sum()
            };
            rows.iter().map(chain).collect()
        };
        let inertial = kernel.parameters.iter().enumerate().filter(|(_, name)| name.starts_with("link."));
        let links = inertial.map(|(index, name)| ((*name).to_owned(), Unknown::Link(index), link(index)));
        let column = |column: usize| rows.iter().map(|row| row[column]).collect();
        let effects = system.effect_names().iter().enumerate().map(|(index, name)| {
            (name.clone(), Unknown::Effect(index), column(columns.effect(index).expect("every effect is wanted")))
        });
        let initial = columns
            .initial()
            .enumerate()
            .map(|(slot, index)| (format!("initial position {slot}"), Unknown::Initial(slot), column(index)));
        links.chain(effects).chain(initial).collect()
    }
}

#[test]
fn derivatives_of_all_joints_are_those_of_central_differences_at_three_points() {
    for seed in [1, 2, 3] {
        let case = Case::new(seed);
        let exact = case.exact();
        let worst = exact
            .par_iter()
            .filter_map(|(name, unknown, exact)| {
                let scale = exact.iter().fold(0.0_f64, |scale, value| scale.max(value.abs()));
                // Centroids and inertias that cancel: their columns are rounding.
                if scale < 1e-9 {
                    return None;
                }
                let difference = case.difference(*unknown, case.size(*unknown, scale));
                let error = exact.iter().zip(&difference).fold(0.0_f64, |error, (a, b)| error.max((a - b).abs()));
                Some((error / scale, name.as_str()))
            })
            .collect::<Vec<_>>();
        assert!(worst.len() > 110, "{} unknowns matter", worst.len());
        let (error, name) = worst.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).expect("there are unknowns");
        println!("point {seed}: {error:.2e} ({name})");
        assert!(error <= 1e-5, "point {seed}, {name}: {error:.2e}");
    }
}

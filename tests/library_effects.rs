//! Every effect of the library at work: it vanishes at its null, and simulated positions have exact derivatives by its
//! parameters, in open loop and on a tether of samples, held or straight commands.

use dynid::{
    fit::sensitivity::{self, Columns, Lumps},
    model::Model,
    simulate::{self, Hold, Input, Options},
    system::System,
};
use dynid_model::{Effect, Scope};

#[path = "library_effects/values.rs"]
mod values;
use values::VALUES;

const FREE: [usize; 2] = [0, 1];
const SAMPLES: usize = 61;
const STEP_S: f64 = 0.01;
const OPTIONS: Options = Options { substeps: 12, position_limit: 1e3 };
/// What a change of a parameter does to the positions, at most [rad]: well above rounding, well below all curvature.
const CHANGE: f64 = 1e-7;

/// The arm hanging on springs, with an effect of the library.
fn model(effect: &Effect) -> Model {
    let mut model = Model::of_device(dynid_model::device("planar2r").expect("a shipped device"));
    model.effects.clear();
    let set = |model: &mut Model, name: &str, value: f64| model.set_value(name, value).expect("within its bounds");
    for (joint, rest) in [(0, -1.9), (1, -0.7)] {
        model.add_effect("spring", Some(joint), None).expect("an effect of the library");
        model.add_effect("viscous", Some(joint), None).expect("an effect of the library");
        set(&mut model, &format!("joint.{joint}.spring.Ks"), 3.0);
        set(&mut model, &format!("joint.{joint}.spring.qeq"), rest);
        set(&mut model, &format!("joint.{joint}.viscous.Fv"), 0.25);
    }
    let (joint, from) = match effect.scope {
        Scope::Joint => (Some(1), None),
        Scope::Pair => (Some(0), Some(1)),
        Scope::Device => (None, None),
    };
    if !model.effects.iter().any(|own| own.effect.id == effect.id && own.joint == joint) {
        model.add_effect(&effect.id, joint, from).expect("an effect of the library");
    }
    if effect.id == "friction_bias" {
        // A rest position out of reach: where the arm passes one, a numeric solution has steps that differences see.
        set(&mut model, "joint.1.spring.Ks", 0.01);
        set(&mut model, "joint.1.spring.qeq", 3.0);
    }
    for (id, symbol, value) in VALUES {
        if id == effect.id {
            let own = model
                .names()
                .into_iter()
                .find(|name| name.contains(&format!(".{id}.")) && name.ends_with(&format!(".{symbol}")));
            set(&mut model, &own.unwrap_or_else(|| panic!("{id} has {symbol}")), value);
        }
    }
    model
}

/// Where an unknown enters.
#[derive(Clone, Copy)]
enum Unknown {
    Effect(usize),
    Link(usize),
    /// Positions, then speeds.
    Start(usize),
}

struct Case {
    system: System,
    time: Vec<f64>,
    command: Vec<f64>,
    hold: Hold,
}

impl Case {
    fn new(effect: &Effect, hold: Hold) -> Self {
        let system = System::of_model(&model(effect), &FREE, |_| 0.0).expect("a configuration of the device");
        let time: Vec<f64> = (0..SAMPLES).map(|k| STEP_S * k as f64).collect();
        let command = time.iter().flat_map(|t| [3.0 * (11.0 * t + 0.4).cos(), 3.0 * (17.0 * t).sin() - 0.4]).collect();
        Self { system, time, command, hold }
    }

    fn input(&self) -> Input<'_> {
        Input { time: &self.time, command: &self.command, hold: self.hold }
    }

    /// Positions, then speeds, at the start.
    const START: [f64; 4] = [-1.5, -0.4, 0.3, -0.5];

    fn positions(&self, unknown: Unknown, change: f64) -> Vec<f64> {
        let mut system = self.system.clone();
        let mut effects = system.effect_parameters().to_vec();
        let mut links = system.link_parameters().to_vec();
        let mut start = Self::START;
        match unknown {
            Unknown::Effect(index) => effects[index] += change,
            Unknown::Link(index) => links[index] += change,
            Unknown::Start(index) => start[index] += change,
        }
        system.set_parameters(&links, &effects);
        simulate::simulate(&system, &self.input(), &start, &OPTIONS).expect("it stays bounded").q
    }

    /// Richardson's extrapolation of two central differences: the error is of fourth order.
    fn difference(&self, unknown: Unknown, size: f64) -> Vec<f64> {
        let [plus, minus, plus2, minus2] = [1.0, -1.0, 2.0, -2.0].map(|share| self.positions(unknown, share * size));
        (0..plus.len()).map(|k| (8.0 * (plus[k] - minus[k]) - (plus2[k] - minus2[k])) / (12.0 * size)).collect()
    }

    /// Every unknown with its name and the derivatives of all positions by it.
    fn exact(&self) -> Vec<(String, Unknown, Vec<f64>)> {
        let (system, kernel) = (&self.system, self.system.kernel());
        let columns = Columns::new(system, |_| true, Lumps::Wanted).moving(FREE.len());
        let mut rows: Vec<Vec<f64>> = Vec::new();
        let observe = |_: usize, _: &[f64], sample: &[f64]| {
            rows.extend(sample.chunks(columns.width()).map(<[f64]>::to_vec));
        };
        sensitivity::simulate(system, &columns, &self.input(), None, &Self::START, &OPTIONS, observe)
            .expect("it stays bounded");
        let column = |column: usize| -> Vec<f64> { rows.iter().map(|row| row[column]).collect() };
        let n_links = kernel.parameters.len();
        let mut by_link = vec![0.0; kernel.prepared.len() * n_links];
        (kernel.prepare_gradient)(system.link_parameters(), system.locked(), &mut by_link);
        let link = |index: usize| -> Vec<f64> {
            let chain = |row: &Vec<f64>| {
                columns.lumps().enumerate().map(|(lump, column)| row[column] * by_link[lump * n_links + index]).sum()
            };
            rows.iter().map(chain).collect()
        };
        let inertial = kernel.parameters.iter().enumerate().filter(|(_, name)| name.starts_with("link."));
        let links = inertial.map(|(index, name)| ((*name).to_owned(), Unknown::Link(index), link(index)));
        let effects = system.effect_names().iter().enumerate().map(|(index, name)| {
            (name.clone(), Unknown::Effect(index), column(columns.effect(index).expect("every effect is wanted")))
        });
        let start = columns
            .initial()
            .enumerate()
            .map(|(index, place)| (format!("number {index} of the start"), Unknown::Start(index), column(place)));
        links.chain(effects).chain(start).collect()
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |size, value| size.max(value.abs()))
}

/// The motion of the arm with the effect at its null values is that without it.
#[test]
fn every_effect_vanishes_at_its_null() {
    for effect in dynid_model::effects() {
        let mut with = model(effect);
        let index = with.effects.iter().position(|own| own.effect.id == effect.id).expect("it was added");
        for (parameter, own) in with.effects[index].parameters.iter_mut().zip(&effect.parameters) {
            parameter.value = own.null.unwrap_or(parameter.value);
        }
        let mut without = with.clone();
        without.effects.remove(index);
        for hold in [Hold::Zero, Hold::Linear] {
            let run = |model: &Model| {
                let case = Case {
                    system: System::of_model(model, &FREE, |_| 0.0).expect("a configuration"),
                    ..Case::new(effect, hold)
                };
                simulate::simulate(&case.system, &case.input(), &Case::START, &OPTIONS).expect("it stays bounded").q
            };
            let (with, without) = (run(&with), run(&without));
            let error = with.iter().zip(&without).fold(0.0_f64, |error, (a, b)| error.max((a - b).abs()));
            assert!(error <= 1e-12, "{} ({hold:?}): {error:.2e} rad", effect.id);
        }
    }
}

#[test]
fn derivatives_by_every_effect_are_those_of_central_differences() {
    let mut wrong = Vec::new();
    for effect in dynid_model::effects() {
        for hold in [Hold::Zero, Hold::Linear] {
            let case = Case::new(effect, hold);
            let mut met = 0;
            for (name, unknown, exact) in case.exact() {
                let scale = largest(&exact);
                // Of no weight in the arm's plane, or a choice of the numerics that does not act here.
                if scale < 1e-9 {
                    continue;
                }
                let mut size = CHANGE / scale;
                if let Unknown::Effect(parameter) = unknown {
                    met += usize::from(name.contains(&format!(".{}.", effect.id)));
                    size = size.min(1e-3 * case.system.effect_parameters()[parameter].abs().max(1e-3));
                }
                let difference = case.difference(unknown, size);
                let error = largest(&exact.iter().zip(&difference).map(|(a, b)| a - b).collect::<Vec<_>>()) / scale;
                if error > 2e-5 {
                    wrong.push(format!("with {}: {name} ({hold:?}): {error:.2e} of {scale:.2e}", effect.id));
                }
            }
            assert!(met >= 1, "{} has no effect on the motion", effect.id);
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

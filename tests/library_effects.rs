//! Every effect of the library at work: it vanishes at its null, and simulated positions have exact derivatives by its
//! parameters, in open loop and with an observer of samples, held or straight commands.

use dynid_dynamics::{
    simulate, simulate::Input, simulate::Intersample, simulate::Options, simulate::SimulationError, simulate::Steps,
    simulate::control, simulate::control::Controller, simulate::control::Filter, system::System,
};
use dynid_identify::{sensitivity, sensitivity::Columns, sensitivity::Lumps};
use dynid_model::{Effect, Scope};
use dynid_plant::random::Noise;
use dynid_user_model::Model;

mod values;
use values::VALUES;

const FREE: [usize; 2] = [0, 1];
const SAMPLES: usize = 61;
const STEP_S: f64 = 0.01;
const OPTIONS: Options = Options { steps: Steps::PerSample(12), position_limit: 1e3 };
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
    intersample: Intersample,
}

impl Case {
    fn new(effect: &Effect, intersample: Intersample) -> Self {
        let system = model(effect).system(&FREE, |_| 0.0).expect("a configuration of the device");
        let time: Vec<f64> = (0..SAMPLES).map(|k| STEP_S * k as f64).collect();
        let command = time.iter().flat_map(|t| [3.0 * (11.0 * t + 0.4).cos(), 3.0 * (17.0 * t).sin() - 0.4]).collect();
        Self { system, time, command, intersample }
    }

    fn input(&self) -> Input<'_> {
        Input { time: &self.time, command: &self.command, intersample: self.intersample }
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
        sensitivity::simulate(system, &columns, &self.input(), &Self::START, &OPTIONS, observe)
            .expect("it stays bounded");
        let column = |column: usize| -> Vec<f64> { rows.iter().map(|row| row[column]).collect() };
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
        for intersample in [Intersample::ZeroOrder, Intersample::FirstOrder] {
            let run = |model: &Model| {
                let case = Case {
                    system: model.system(&FREE, |_| 0.0).expect("a configuration"),
                    ..Case::new(effect, intersample)
                };
                simulate::simulate(&case.system, &case.input(), &Case::START, &OPTIONS).expect("it stays bounded").q
            };
            let (with, without) = (run(&with), run(&without));
            let error = with.iter().zip(&without).fold(0.0_f64, |error, (a, b)| error.max((a - b).abs()));
            assert!(error <= 1e-12, "{} ({intersample:?}): {error:.2e} rad", effect.id);
        }
    }
}

/// One function of all joint effects, made while the program runs, has the bits of the effects' own kernels: the same motion.
#[test]
fn fused_effects_have_the_bits_of_each_alone() {
    let mut n_fused = 0;
    for effect in dynid_model::effects() {
        let model = model(effect);
        for free in [&FREE[..], &FREE[..1], &FREE[1..]] {
            let system = |evaluations: usize| {
                let system = model.system(free, |_| 0.2).expect("a configuration");
                let is_fused = system.announce(evaluations);
                (system, is_fused)
            };
            let ((alone, _), (fused, is_fused)) = (system(0), system(1_000_000));
            // Springs at both joints are no reason not to; a second law that calls what has lanes is.
            n_fused += usize::from(is_fused);
            let n_states = alone.n_states();
            for turn in 0..40 {
                let number = |k: usize| ((turn * n_states + k) as f64 * 0.618_033_988_749_895).fract() * 2.4 - 1.2;
                let mut x: Vec<f64> = (0..n_states).map(number).collect();
                if turn % 4 == 0 {
                    x[free.len()..].fill(0.0);
                }
                let command = [number(n_states), number(n_states + 1)];
                let run = |system: &System| {
                    let (mut scratch, mut dx) = (system.scratch(), vec![0.0; n_states]);
                    system.derivative(&mut scratch, 0.3 * turn as f64, &x, &command, &mut dx);
                    dx
                };
                assert_eq!(run(&alone), run(&fused), "{} with {free:?} free, at {x:?}", effect.id);
            }
        }
    }
    let n_systems = 3 * dynid_model::effects().len();
    assert!(dynid_kernels::are_interpreted() || 10 * n_fused >= 9 * n_systems, "{n_fused} of {n_systems} are fused");
}

#[test]
fn derivatives_by_every_effect_are_those_of_central_differences() {
    let mut wrong = Vec::new();
    for effect in dynid_model::effects() {
        for intersample in [Intersample::ZeroOrder, Intersample::FirstOrder] {
            let case = Case::new(effect, intersample);
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
                    wrong.push(format!("with {}: {name} ({intersample:?}): {error:.2e} of {scale:.2e}", effect.id));
                }
            }
            assert!(met >= 1, "{} has no effect on the motion", effect.id);
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn effect(id: &str) -> &'static Effect {
    dynid_model::effect(id).expect("an effect of the library")
}

/// The case of an effect with one of its parameters set.
fn case(id: &str, symbol: &str, value: f64, intersample: Intersample) -> Case {
    let mut case = Case::new(effect(id), intersample);
    let mut effects = case.system.effect_parameters().to_vec();
    let named = |name: &String| name.ends_with(&format!(".{id}.{symbol}"));
    effects[case.system.effect_names().iter().position(named).expect("its own name")] = value;
    let links = case.system.link_parameters().to_vec();
    case.system.set_parameters(&links, &effects);
    case
}

fn positions(case: &Case) -> Result<Vec<f64>, SimulationError> {
    simulate::simulate(&case.system, &case.input(), &Case::START, &OPTIONS).map(|trajectory| trajectory.q)
}

fn difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |error, (a, b)| error.max((a - b).abs()))
}

#[test]
fn a_delay_of_whole_samples_shifts_the_commands() {
    const SHIFT: usize = 3;
    for intersample in [Intersample::ZeroOrder, Intersample::FirstOrder] {
        let late = case("input_delay", "delay", SHIFT as f64 * STEP_S, intersample);
        let mut shifted = case("input_delay", "delay", 0.0, intersample);
        // Joint 1 alone is late.
        for sample in 0..SAMPLES {
            shifted.command[2 * sample + 1] = late.command[2 * sample.saturating_sub(SHIFT) + 1];
        }
        let (late, shifted) = (positions(&late).expect("bounded"), positions(&shifted).expect("bounded"));
        assert!(difference(&late, &shifted) < 1e-12, "{intersample:?}: {:.2e}", difference(&late, &shifted));
    }
}

/// What a controller commands arrives as late as what a log does.
#[test]
fn a_controller_s_commands_are_late_too() {
    let late = case("input_delay", "delay", 0.0137, Intersample::ZeroOrder);
    let controller = Controller {
        proportional: vec![4.0, 2.0],
        derivative: vec![0.1, 0.05],
        filter: Filter::THESIS,
        limit: vec![f64::INFINITY; 2],
        position_quantum: 0.0,
        torque_quantum: 0.0,
    };
    let reference: Vec<f64> = late.time.iter().flat_map(|t| [-1.5 + 0.2 * (6.0 * t).sin(), -0.4]).collect();
    let start = &Case::START[..2];
    let run = |case: &Case| {
        control::simulate(&case.system, &controller, &case.time, &reference, start, &OPTIONS).expect("bounded")
    };
    let (motion, command) = run(&late);
    let input = Input { time: &late.time, command: &command, intersample: Intersample::ZeroOrder };
    assert_eq!(simulate::simulate(&late.system, &input, start, &OPTIONS).expect("bounded"), motion);
    let (prompt, _) = run(&case("input_delay", "delay", 0.0, Intersample::ZeroOrder));
    assert!(difference(&prompt.q, &motion.q) > 1e-3, "the delay acts");
}

/// Down to nothing, time constants and gaps do no more than their size, and no step of the integration blows up.
#[test]
fn effects_that_are_too_fast_for_a_step_fade() {
    let cases = [
        ("input_lag", "T", vec![1e-12, 1e-6, 1e-4, 5e-4, 1e-3, 2e-3], 40.0),
        ("input_delay", "delay", vec![1e-12, 1e-6, 1e-4, 1e-3], 40.0),
        ("joint_elasticity", "compliance", vec![1e-15, 1e-12, 1e-9, 1e-7], 2e4),
        ("backlash", "gap", vec![1e-15, 1e-9, 1e-7, 1e-6], 2e5),
    ];
    for (id, symbol, values, slope) in cases {
        for intersample in [Intersample::ZeroOrder, Intersample::FirstOrder] {
            let null = positions(&case(id, symbol, 0.0, intersample)).expect("bounded");
            for &value in &values {
                let moved = difference(&positions(&case(id, symbol, value, intersample)).expect("bounded"), &null);
                assert!(moved <= slope * value + 1e-13, "{id} {symbol} = {value:e}: {moved:.2e} rad ({intersample:?})");
            }
        }
        for value in [0.01, 0.1, 1.0] {
            assert!(positions(&case(id, symbol, value, Intersample::ZeroOrder)).is_ok(), "{id} {symbol} = {value}");
        }
    }
}

/// A motor that no step can resolve is an error that says so, not a panic.
#[test]
fn a_motor_without_inertia_diverges() {
    let error = positions(&case("joint_elasticity", "Jm", 0.0, Intersample::ZeroOrder)).expect_err("0/0");
    assert!(matches!(error, SimulationError::Diverged { .. }), "{error}");
}

/// On every device, at every joint and in every configuration: parallel axes, by hand.
#[test]
fn a_payload_is_a_part_of_the_last_link_that_its_joint_moves() {
    let mut noise = Noise::new(4);
    for device in dynid_model::devices() {
        for joint in 0..device.joints.len() {
            let Some(link) = device.last_link_moved_by(joint) else { continue };
            let mut with = Model::of_device(device);
            with.effects.clear();
            let without = with.clone();
            with.add_effect("payload", Some(joint), None).expect("an effect of the library");
            let [m, x, y, z] = [(); 4].map(|()| 0.1 + noise.uniform());
            for (symbol, value) in [("m", m), ("x", x), ("y", -y), ("z", z)] {
                with.set_value(&format!("joint.{joint}.payload.{symbol}"), value).expect("within its bounds");
            }
            let of_link = |symbol: &str| {
                without.parameter(&format!("link.{}.{symbol}", link + 1)).expect("a number of the link").value
            };
            let (own_m, own) = (of_link("m"), ["x", "y", "z"].map(of_link));
            let mass = own_m + m;
            let at = [x, -y, z];
            let centroid: [f64; 3] = std::array::from_fn(|axis| (own_m * own[axis] + m * at[axis]) / mass);
            let merged = |symbol: &str| -> f64 {
                let axes: Vec<usize> = symbol.chars().filter_map(|axis| "xyz".find(axis)).collect();
                match (symbol, axes.as_slice()) {
                    ("m", _) => mass,
                    (_, &[axis]) => centroid[axis],
                    (_, &[a, b]) => {
                        let steiner = |mass: f64, place: [f64; 3]| {
                            let d: [f64; 3] = std::array::from_fn(|axis| place[axis] - centroid[axis]);
                            let square: f64 = d.iter().map(|d| d * d).sum();
                            mass * (f64::from(u8::from(a == b)) * square - d[a] * d[b])
                        };
                        of_link(symbol) + steiner(own_m, own) + steiner(m, at)
                    }
                    _ => unreachable!("no number of a link"),
                }
            };
            for configuration in &device.configurations {
                let system = |model: &Model| {
                    model.system(&configuration.free, |joint| 0.3 + 0.2 * joint as f64).expect("complete")
                };
                let with = system(&with);
                let mut without = system(&without);
                let prefix = format!("link.{}.", link + 1);
                let values: Vec<f64> = (without.kernel().parameters.iter().zip(without.link_parameters()))
                    .map(|(name, value)| name.strip_prefix(&prefix).map_or(*value, merged))
                    .collect();
                without.set_parameters(&values, &[]);
                let size = without.prepared().iter().fold(0.0_f64, |size, lump| size.max(lump.abs()));
                let error = difference(with.prepared(), without.prepared());
                assert!(error <= 1e-12 * size, "{} joint {joint} {:?}: {error:.2e}", device.id, configuration.free);
            }
        }
    }
}

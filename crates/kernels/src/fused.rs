//! The joint effects of a system as one function: the operations of their own kernels, but that what is known to be 0 is not added.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, OnceLock, PoisonError},
};

use dynid_compile::Routine;
use dynid_dynamics::system::{Fuse, Fused, Law, Laws, Source};
use dynid_generated::N_SIGNALS;
use dynid_lower::{
    Input, Node, Program,
    effect::EffectKernels,
    kernel::{Argument, Function, Results},
    program::{Function as Call, Operation},
};

/// Makes them.
pub struct Fuser;

/// What was made, or could not be, by what it hangs on.
type Known = HashMap<Vec<u64>, Option<Arc<Loads>>>;

impl Fuse for Fuser {
    fn fuse(&self, laws: &Laws) -> Option<Arc<dyn Fused>> {
        /// What was made is kept, up to so many: a diagnosis asks for the same effects with other values.
        const MOST: usize = 1_000;
        static MADE: OnceLock<Mutex<Known>> = OnceLock::new();
        let known = || MADE.get_or_init(Mutex::default).lock().unwrap_or_else(PoisonError::into_inner);
        let key = key(laws);
        let found = known().get(&key).cloned();
        let made = found.unwrap_or_else(|| {
            let made = Loads::new(laws).map(Arc::new);
            let mut known = known();
            if known.len() >= MOST {
                known.clear();
            }
            known.insert(key, made.clone());
            made
        });
        made.map(|made| made as Arc<dyn Fused>)
    }
}

/// What a function of these laws hangs on.
fn key(laws: &Laws) -> Vec<u64> {
    let Laws { laws, n_parameters, n_free, n_states } = laws;
    let mut key: Vec<u64> = [*n_parameters, *n_free, *n_states].map(|number| number as u64).to_vec();
    for law in laws {
        let Law { kernel, is_friction, first_parameter, first_state, signals, torques } = law;
        let own = [super::address(*kernel), usize::from(*is_friction), *first_parameter, *first_state, torques.len()];
        key.extend(own.map(|number| number as u64));
        key.extend(torques.iter().flat_map(|(output, slot)| [*output as u64, *slot as u64]));
        key.extend(signals.iter().flat_map(|source| match *source {
            Source::Constant(value) => [0, value.to_bits()],
            Source::State(place) => [1, place as u64],
            Source::Parameter(place) => [2, place as u64],
            Source::Time => [3, 0],
            Source::Drive(slot) => [4, slot as u64],
            Source::Friction(slot) => [5, slot as u64],
        }));
    }
    key
}

struct Loads(Routine<f64>);

impl Fused for Loads {
    #[inline]
    fn loads(
        &self,
        (parameters, x, drive, t): (&[f64], &[f64], &[f64], f64),
        sums: [&mut [f64]; 2],
        rates: &mut [f64],
    ) {
        let [loads, frictions] = sums;
        self.0.call([parameters, x, drive, &[t]], [loads, frictions, rates]);
    }
}

impl Loads {
    /// `None` where a law is not known by its formulas, where two of one kind do better side by side, and where there is no machine
    /// code.
    fn new(laws: &Laws) -> Option<Self> {
        let mut program = Program::new();
        let mut sums: Vec<Option<Node>> = vec![None; laws.n_free];
        let mut frictions = None;
        let mut known = Vec::new();
        let n_moving = 2 * laws.n_free;
        let mut rates = vec![String::new(); laws.n_states - n_moving];
        for law in &laws.laws {
            let effect = dynid_model::effect(law.kernel.id)?;
            if !std::ptr::eq(super::effect(effect).ok()?, law.kernel) {
                return None;
            }
            let own = EffectKernels::new(effect).ok()?;
            if known.contains(&law.kernel.id) && calls_what_has_lanes(&own.eval.program) {
                return None;
            }
            known.push(law.kernel.id);
            if !law.is_friction && frictions.is_none() {
                frictions = Some(sums.clone());
            }
            let of_slots = frictions.as_ref().unwrap_or(&sums);
            let values = program.inline(&own.eval.program, |input, program| {
                Some(given(law, &own.eval.arguments, input, of_slots, program))
            });
            let named: HashMap<&str, Node> =
                own.eval.program.outputs().iter().map(|(name, _)| name.as_str()).zip(values).collect();
            let [outputs, own_rates] = &own.eval.results[..] else { return None };
            for &(output, slot) in &law.torques {
                let torque = *named.get(outputs.elements[output].as_str())?;
                sums[slot] = Some(sums[slot].map_or(torque, |sum| program.add(sum, torque)));
            }
            for (state, name) in own_rates.elements.iter().enumerate() {
                let place = law.first_state + state - n_moving;
                rates[place] = format!("rate{place}");
                program.output(&rates[place], *named.get(name.as_str())?);
            }
        }
        let frictions = frictions.unwrap_or_else(|| sums.clone());
        let mut written = |name: &'static str, sums: Vec<Option<Node>>| {
            let elements = (0..laws.n_free).map(|slot| format!("{name}{slot}")).collect::<Vec<_>>();
            for (element, sum) in elements.iter().zip(sums) {
                let sum = sum.unwrap_or_else(|| program.number(0.0));
                program.output(element, sum);
            }
            Results { name, elements }
        };
        let results =
            vec![written("load", sums), written("friction", frictions), Results { name: "rates", elements: rates }];
        let numbered =
            |name: &'static str, n: usize| Argument { name, elements: (0..n).map(|k| element(name, k)).collect() };
        let function = Function {
            name: "loads",
            title: "The sums of the joint effects' torques, and the rates of their states.",
            form: String::new(),
            arguments: vec![
                numbered(PARAMETER, laws.n_parameters),
                numbered(STATE, laws.n_states),
                numbered(DRIVE, laws.n_free),
                numbered(TIME, 1),
            ],
            results,
            program: program.compact(),
        };
        let routine = Routine::new(&function);
        routine.is_machine_code().then_some(Self(routine))
    }
}

const PARAMETER: &str = "p";
const STATE: &str = "x";
const DRIVE: &str = "drive";
const TIME: &str = "t";

/// An element of an argument of the whole function.
fn element(name: &str, place: usize) -> Input {
    Input::Signal(format!("{name}{place}"))
}

/// What an input of a law is in the whole function.
fn given(law: &Law, arguments: &[Argument], input: &Input, frictions: &[Option<Node>], program: &mut Program) -> Node {
    let place = |argument: usize| arguments[argument].elements.iter().position(|own| own == input);
    if let Some(parameter) = place(0) {
        return program.input(element(PARAMETER, law.first_parameter + parameter), "");
    }
    if let Some(state) = place(2) {
        return program.input(element(STATE, law.first_state + state), "");
    }
    let signal = place(1).filter(|signal| *signal < N_SIGNALS);
    match signal.map_or(Source::Constant(0.0), |signal| law.signals[signal]) {
        Source::Constant(value) => program.number(value),
        Source::State(place) => program.input(element(STATE, place), ""),
        Source::Parameter(place) => program.input(element(PARAMETER, place), ""),
        Source::Time => program.input(element(TIME, 0), ""),
        Source::Drive(slot) => program.input(element(DRIVE, slot), ""),
        Source::Friction(slot) => frictions[slot].unwrap_or_else(|| program.number(0.0)),
    }
}

/// Whether a law calls a function that takes no longer for two numbers side by side than for one.
fn calls_what_has_lanes(program: &Program) -> bool {
    let has_lanes =
        |node: Node| matches!(program.operation_of(node), Operation::Call(Call::Exp | Call::Sin | Call::Cos, _));
    program.live().into_iter().any(has_lanes)
}

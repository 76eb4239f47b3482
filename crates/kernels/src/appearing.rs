//! Which parameters appear in equations whose table is not compiled in.
//!
//! What a program names is no answer: by the recursion, terms may cancel. So each parameter that it names is moved, at random states
//! and values of all others, to see whether an output moves.

use dynid_lower::{Input, Program};
use dynid_random::Random;

/// States at which a parameter is moved: that a smooth function is level at all of them, but not everywhere, has no chance.
const STATES: u64 = 3;

/// What counts as moved, of the output's size: far above rounding, far below what a parameter of size one does.
const MOVED: f64 = 1e-9;

/// Names of the parameters on which an output of the program depends, in order of declaration.
pub(crate) fn appearing(program: &Program) -> Vec<String> {
    let inputs = program.live_inputs();
    let states: Vec<(Random, Vec<f64>)> = (0..STATES)
        .map(|seed| {
            let random = Random::new(seed);
            let values = values(program, random.clone(), None);
            (random, values)
        })
        .collect();
    let moves = |parameter: &Input| {
        states.iter().any(|(random, before)| {
            let after = values(program, random.clone(), Some(parameter));
            before.iter().zip(&after).any(|(a, b)| (a - b).abs() > MOVED * (1.0 + a.abs().max(b.abs())))
        })
    };
    let name = |input: &Input| match input {
        Input::Parameter(name) if moves(input) => Some(name.clone()),
        _ => None,
    };
    inputs.into_iter().filter_map(name).collect()
}

/// The outputs where every input is random, one of them moved by one.
fn values(program: &Program, mut random: Random, moved: Option<&Input>) -> Vec<f64> {
    program.evaluate(|input| random.between(0.5, 1.5) + if Some(input) == moved { 1.0 } else { 0.0 })
}

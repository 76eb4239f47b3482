//! From an effect's formulas to the programs of its kernels. No computer algebra: adding an effect costs a
//! `cargo build`.

use std::collections::BTreeMap;

use dynid_model::effect::{Effect, EffectParameter, SIGNALS};
use dynid_model::expression::Expression;

use crate::kernel::{Argument, Function, Results};
use crate::{Input, Node, Program};

/// The kernels of one effect.
#[derive(Debug, Clone)]
pub struct EffectKernels {
    /// Id of the effect.
    pub id: String,
    /// One line for people.
    pub title: String,
    /// Number of parameters.
    pub n_parameters: usize,
    /// Number of states.
    pub n_states: usize,
    /// Number of outputs.
    pub n_outputs: usize,
    /// Outputs and state rates.
    pub eval: Function,
    /// The same and their Jacobian by (parameters, signals, states), row-major.
    pub eval_gradient: Function,
}

/// A symbol in an effect's formula that is nothing it may read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("effect `{effect}`: `{formula}` reads `{symbol}`, which is none of its parameters, states, terms or signals ({})", SIGNALS.join(", "))]
pub struct UnknownSymbol {
    effect: String,
    formula: String,
    symbol: String,
}

impl EffectKernels {
    /// Makes the programs from the formulas. A name stands for the effect's own parameter, state or earlier term
    /// first, and for a signal otherwise.
    pub fn new(effect: &Effect) -> Result<EffectKernels, UnknownSymbol> {
        let mut formulas = Formulas::new(effect);
        for (name, expression) in &effect.terms {
            let node = formulas.node(name, expression)?;
            formulas.program.name(node, name);
            formulas.scope.insert(name.clone(), node);
        }
        let mut values = Vec::new();
        for (name, expression) in &effect.outputs {
            values.push((format!("output_{name}"), formulas.node(name, expression)?));
        }
        for state in &effect.states {
            values.push((format!("rate_{}", state.symbol), formulas.node(&state.symbol, &state.rate)?));
        }
        for (name, node) in &values {
            formulas.program.output(name, *node);
        }
        let names: Vec<String> = values.iter().map(|(name, _)| name.clone()).collect();
        let (outputs, rates) = names.split_at(effect.outputs.len());
        let results = vec![
            Results { name: "outputs", elements: outputs.to_vec() },
            Results { name: "rates", elements: rates.to_vec() },
        ];
        let arguments = arguments(effect);
        let program = formulas.program;
        let eval_gradient = gradient(program.clone(), &values, &arguments, results.clone());
        let eval = Function {
            name: "eval",
            title: "Outputs and state rates.",
            form: String::new(),
            arguments,
            results,
            program: program.compact(),
        };
        Ok(EffectKernels {
            id: effect.id.clone(),
            title: effect.title.clone(),
            n_parameters: effect.parameters.len(),
            n_states: effect.states.len(),
            n_outputs: effect.outputs.len(),
            eval,
            eval_gradient,
        })
    }
}

fn gradient(
    mut program: Program,
    values: &[(String, Node)],
    arguments: &[Argument],
    mut results: Vec<Results>,
) -> Function {
    let nodes: Vec<Node> = values.iter().map(|&(_, node)| node).collect();
    let mut columns = Vec::new();
    for input in arguments.iter().flat_map(|argument| &argument.elements) {
        let by = program.input(input.clone(), "");
        columns.push(program.derivative(&nodes, by));
    }
    let mut elements = Vec::new();
    for row in 0..nodes.len() {
        for column in &columns {
            let name = format!("jacobian[{}]", elements.len());
            program.output(&name, column[row]);
            elements.push(name);
        }
    }
    results.push(Results { name: "jacobian", elements });
    Function {
        name: "eval_gradient",
        title: "As `eval`, and the Jacobian of (outputs, rates) by (parameters, signals, states), row-major.",
        form: String::new(),
        arguments: arguments.to_vec(),
        results,
        program: program.compact(),
    }
}

fn parameter_input(parameter: &EffectParameter) -> Input {
    Input::Parameter(parameter.symbol.clone())
}

fn arguments(effect: &Effect) -> Vec<Argument> {
    let states = effect.states.iter().map(|state| Input::State(state.symbol.clone()));
    vec![
        Argument { name: "parameters", elements: effect.parameters.iter().map(parameter_input).collect() },
        Argument { name: "signals", elements: SIGNALS.iter().map(|&name| Input::Signal(name.to_owned())).collect() },
        Argument { name: "states", elements: states.collect() },
    ]
}

struct Formulas<'a> {
    effect: &'a Effect,
    program: Program,
    scope: BTreeMap<String, Node>,
}

impl Formulas<'_> {
    fn new(effect: &Effect) -> Formulas<'_> {
        let mut program = Program::new();
        let mut scope = BTreeMap::new();
        for signal in SIGNALS {
            scope.insert(signal.to_owned(), program.input(Input::Signal(signal.to_owned()), ""));
        }
        for parameter in &effect.parameters {
            scope.insert(parameter.symbol.clone(), program.input(parameter_input(parameter), &parameter.unit));
        }
        for state in &effect.states {
            scope.insert(state.symbol.clone(), program.input(Input::State(state.symbol.clone()), &state.unit));
        }
        Formulas { effect, program, scope }
    }

    fn node(&mut self, formula: &str, expression: &Expression) -> Result<Node, UnknownSymbol> {
        self.program.expression(expression, &self.scope).map_err(|symbol| UnknownSymbol {
            effect: self.effect.id.clone(),
            formula: formula.to_owned(),
            symbol,
        })
    }
}

//! From a configuration's equations to the programs of its kernels.
//!
//! The `.kir` gives D, h and tau. Everything else is made from them here: gravity is h at rest, C comes from D by
//! Christoffel symbols, the regressor and the gradient from tau by the chain rule, forward dynamics from D and h by
//! elimination.

mod christoffel;
mod solve;

use crate::{Input, Kir, Node, OperationCounts, Program, Split};

/// A straight-line function from arrays to arrays.
#[derive(Debug, Clone)]
pub struct Function {
    /// Its identifier.
    pub name: &'static str,
    /// What it computes, for its documentation.
    pub title: &'static str,
    /// Which form of the equations it was made from, e.g. `lagrangian`.
    pub form: String,
    /// The arrays that it reads.
    pub arguments: Vec<Argument>,
    /// The arrays that it writes.
    pub results: Vec<Results>,
    /// The terms; every node that [`Results`] mention is an output.
    pub program: Program,
}

/// An array argument: its name and what its elements are.
#[derive(Debug, Clone)]
pub struct Argument {
    /// Its identifier.
    pub name: &'static str,
    /// Its elements.
    pub elements: Vec<Input>,
}

/// An array that a function fills: its name and the outputs of the program that its elements are.
#[derive(Debug, Clone)]
pub struct Results {
    /// Its identifier.
    pub name: &'static str,
    /// Names of outputs, one per element.
    pub elements: Vec<String>,
}

/// The kernels of one configuration.
#[derive(Debug, Clone)]
pub struct Configuration {
    /// Id of the device.
    pub device: String,
    /// Number of the configuration, from 1.
    pub number: usize,
    /// Free joints, ascending.
    pub free: Vec<usize>,
    /// Locked joints, ascending.
    pub locked: Vec<usize>,
    /// Names of the model parameters that `prepare` takes, in order.
    pub parameters: Vec<String>,
    /// Names of what `prepare` makes, in order.
    pub prepared: Vec<String>,
    /// The first so many of `prepared` are the lumps that the regressor belongs to.
    pub n_lumps: usize,
    /// Operations of `prepare`.
    pub prepare_counts: OperationCounts,
    /// `prepare` and then the kernels, in the order of `dynid_generated::Kernel`.
    pub functions: [Function; 10],
}

/// What is missing in a `.kir` to make kernels from it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{device}, configuration {configuration}: output `{output}` is missing; write the equations anew with `cargo xtask gen --device {device} --config {configuration}`"
)]
pub struct MissingOutput {
    device: String,
    configuration: usize,
    output: String,
}

impl Configuration {
    /// Makes the kernels' programs from the equations.
    pub fn new(kir: &Kir) -> Result<Configuration, MissingOutput> {
        for output in expected_outputs(&kir.free) {
            if kir.program.find_output(&output).is_none() {
                return Err(MissingOutput { device: kir.device.clone(), configuration: kir.configuration, output });
            }
        }
        let split = kir.program.split();
        let parameters = parameters(&split.prepare);
        let builder = Builder { kir, split: &split };
        let functions = [
            prepare(&split, &parameters, &kir.locked),
            builder.inertia(),
            builder.coriolis(),
            builder.gravity(),
            builder.bias(),
            builder.inertia_and_bias(),
            builder.inverse_dynamics(),
            builder.forward_dynamics(),
            builder.regressor(),
            builder.inverse_dynamics_gradient(),
        ];
        Ok(Configuration {
            device: kir.device.clone(),
            number: kir.configuration,
            free: kir.free.clone(),
            locked: kir.locked.clone(),
            parameters,
            prepared: split.prepared,
            n_lumps: split.n_lumps,
            prepare_counts: split.prepare.operations(),
            functions,
        })
    }
}

fn expected_outputs(free: &[usize]) -> Vec<String> {
    let inertia = free.iter().enumerate().flat_map(|(row, i)| free[row..].iter().map(move |j| format!("D_{i}_{j}")));
    let vectors = free.iter().flat_map(|i| [format!("h_{i}"), format!("tau_{i}")]);
    inertia.chain(vectors).collect()
}

fn parameters(prepare: &Program) -> Vec<String> {
    let names = prepare.live_inputs().into_iter().filter_map(|input| match input {
        Input::Parameter(name) => Some(name.clone()),
        _ => None,
    });
    names.collect()
}

fn prepare(split: &Split, parameters: &[String], locked: &[usize]) -> Function {
    Function {
        name: "prepare",
        title: "What depends on parameters and locked angles alone, computed once per parameter set.",
        form: String::new(),
        arguments: vec![
            Argument { name: "parameters", elements: parameters.iter().cloned().map(Input::Parameter).collect() },
            Argument { name: "locked", elements: locked.iter().copied().map(Input::Locked).collect() },
        ],
        results: vec![Results { name: "prepared", elements: split.prepared.clone() }],
        program: split.prepare.clone(),
    }
}

/// Makes the functions of one configuration from its equations over prepared values.
struct Builder<'a> {
    kir: &'a Kir,
    split: &'a Split,
}

impl Builder<'_> {
    fn inertia(&self) -> Function {
        let title = "Inertia matrix `D`.";
        self.function("inertia", title, &["D"], &["q"], vec![self.inertia_results()], self.eval())
    }

    fn coriolis(&self) -> Function {
        let mut program = self.eval();
        let rows = christoffel::matrix(&mut program, &self.kir.free);
        let results = self.outputs(&mut program, "c", "C", &rows);
        let title = "Matrix `C` of centrifugal and Coriolis terms by Christoffel symbols (Eq. 3.3).";
        self.function("coriolis", title, &["D"], &["q", "dq"], vec![results], program)
    }

    fn gravity(&self) -> Function {
        let still = self.eval().substitute(|input, program| match input {
            Input::Velocity(_) => Some(program.number(0.0)),
            _ => None,
        });
        let title = "Gravity vector `phi`: the bias at rest.";
        self.function("gravity", title, &["h"], &["q"], vec![self.vector("phi", "h")], still)
    }

    fn bias(&self) -> Function {
        let title = "Bias `h = C dq + phi`.";
        self.function("bias", title, &["h"], &["q", "dq"], vec![self.vector("h", "h")], self.eval())
    }

    fn inertia_and_bias(&self) -> Function {
        let title = "Inertia matrix `D` and bias `h = C dq + phi`.";
        let results = vec![self.inertia_results(), self.vector("h", "h")];
        self.function("inertia_and_bias", title, &["D", "h"], &["q", "dq"], results, self.eval())
    }

    fn inverse_dynamics(&self) -> Function {
        let title = "Inverse dynamics `tau = D ddq + h`.";
        let results = vec![self.vector("tau", "tau")];
        self.function("inverse_dynamics", title, &["tau"], &["q", "dq", "ddq"], results, self.eval())
    }

    fn forward_dynamics(&self) -> Function {
        let mut program = self.eval();
        let free = &self.kir.free;
        let matrix: Vec<Vec<Node>> =
            free.iter().map(|&i| free.iter().map(|&j| find(&mut program, &entry("D", i, j))).collect()).collect();
        let right: Vec<Node> = free
            .iter()
            .map(|&joint| {
                let torque = program.input(Input::Torque(joint), "");
                let bias = find(&mut program, &format!("h_{joint}"));
                program.subtract(torque, bias)
            })
            .collect();
        let accelerations = solve::symmetric(&mut program, matrix, right);
        let results = self.outputs(&mut program, "ddq", "ddq", &accelerations);
        let title = "Forward dynamics `ddq = D^-1 (tau - h)`.";
        self.function("forward_dynamics", title, &["D", "h"], &["q", "dq", "tau"], vec![results], program)
    }

    fn regressor(&self) -> Function {
        let mut program = self.eval();
        let torques = self.torques(&mut program);
        let columns: Vec<Vec<Node>> = self.split.prepared[..self.split.n_lumps]
            .iter()
            .map(|name| {
                let lump = program.input(Input::Prepared(name.clone()), "");
                program.derivative(&torques, lump)
            })
            .collect();
        let rows: Vec<Node> =
            (0..torques.len()).flat_map(|row| columns.iter().map(move |column| column[row])).collect();
        let results = self.outputs(&mut program, "y", "Y", &rows);
        let title = "Regressor `Y`: partial derivatives of `tau` by the lumps, in which it is linear.";
        self.function("regressor", title, &["tau"], &["q", "dq", "ddq"], vec![results], program)
    }

    fn inverse_dynamics_gradient(&self) -> Function {
        let mut program = self.eval();
        let torques = self.torques(&mut program);
        let mut matrix = |input: fn(usize) -> Input| -> Vec<Node> {
            let columns: Vec<Vec<Node>> = self
                .kir
                .free
                .iter()
                .map(|&joint| {
                    let by = program.input(input(joint), "");
                    program.derivative(&torques, by)
                })
                .collect();
            (0..torques.len()).flat_map(|row| columns.iter().map(move |column| column[row])).collect()
        };
        let by_q = matrix(Input::Position);
        let by_dq = matrix(Input::Velocity);
        let results = vec![
            self.vector("tau", "tau"),
            self.outputs(&mut program, "by_q", "by_q", &by_q),
            self.outputs(&mut program, "by_dq", "by_dq", &by_dq),
        ];
        let title = "`tau` and its partial derivatives by `q` and `dq` (the one by `ddq` is `D`).";
        self.function("inverse_dynamics_gradient", title, &["tau"], &["q", "dq", "ddq"], results, program)
    }

    fn function(
        &self,
        name: &'static str,
        title: &'static str,
        made_from: &[&str],
        arguments: &[&'static str],
        results: Vec<Results>,
        program: Program,
    ) -> Function {
        let outputs: Vec<&str> = results.iter().flat_map(|array| array.elements.iter().map(String::as_str)).collect();
        let joints = |input: fn(usize) -> Input| self.kir.free.iter().copied().map(input).collect();
        let argument = |name: &'static str| Argument {
            name,
            elements: match name {
                "q" => joints(Input::Position),
                "dq" => joints(Input::Velocity),
                "ddq" => joints(Input::Acceleration),
                _ => joints(Input::Torque),
            },
        };
        let prepared = self.split.prepared.iter().cloned().map(Input::Prepared).collect();
        let mut all = vec![Argument { name: "prepared", elements: prepared }];
        all.extend(arguments.iter().map(|&name| argument(name)));
        let program = program.select_outputs(&outputs);
        Function { name, title, form: self.form(made_from), arguments: all, results, program }
    }

    /// The forms that the outputs were written in, each once.
    fn form(&self, outputs: &[&str]) -> String {
        let mut forms: Vec<&str> = Vec::new();
        for form in self.kir.forms.iter().filter(|form| outputs.contains(&form.outputs.as_str())) {
            if !forms.contains(&form.form.as_str()) {
                forms.push(&form.form);
            }
        }
        forms.join(" + ")
    }

    fn eval(&self) -> Program {
        self.split.eval.clone()
    }

    fn torques(&self, program: &mut Program) -> Vec<Node> {
        self.kir.free.iter().map(|joint| find(program, &format!("tau_{joint}"))).collect()
    }

    fn inertia_results(&self) -> Results {
        let free = &self.kir.free;
        let elements = free.iter().flat_map(|&i| free.iter().map(move |&j| entry("D", i, j))).collect();
        Results { name: "d", elements }
    }

    fn vector(&self, name: &'static str, output: &str) -> Results {
        Results { name, elements: self.kir.free.iter().map(|joint| format!("{output}_{joint}")).collect() }
    }

    /// Declares `nodes` as outputs and as the elements of an array.
    fn outputs(&self, program: &mut Program, array: &'static str, prefix: &str, nodes: &[Node]) -> Results {
        let elements: Vec<String> = (0..nodes.len()).map(|place| format!("{prefix}[{place}]")).collect();
        for (name, &node) in elements.iter().zip(nodes) {
            program.output(name, node);
        }
        Results { name: array, elements }
    }
}

/// The name of an entry of a symmetric matrix: only the upper triangle has names.
fn entry(matrix: &str, i: usize, j: usize) -> String {
    format!("{matrix}_{}_{}", i.min(j), i.max(j))
}

/// The node of an output that [`Configuration::new`] has checked to exist.
fn find(program: &mut Program, output: &str) -> Node {
    match program.find_output(output) {
        Some(node) => node,
        None => program.number(f64::NAN),
    }
}

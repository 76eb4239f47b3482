//! Programs that nobody wrote: machine code, the tape, and a plain walk over the operations compute the same bits.

use std::array;

use dynid_compile::{Routine, Word};
use dynid_generated::{Lanes, Scalar};
use dynid_lower::{
    Input, Node, Operation, Program,
    kernel::{Argument, Function, Results},
    program::{Comparison, Function as Call},
};
use dynid_random::Random;

const CALLS: [Call; 9] =
    [Call::Sin, Call::Cos, Call::Tan, Call::Tanh, Call::Exp, Call::Ln, Call::Sqrt, Call::Abs, Call::Sign];

/// Zeros, what is beyond every number, what is no number, the smallest, and angles that take another reduction.
const RARE: [f64; 10] = [0.0, -0.0, 1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 1.0e-310, 1.5e6, -3.0e9];

fn below(random: &mut Random, n: usize) -> usize {
    (random.unit() * n as f64) as usize
}

/// One of the nodes, often one of the last.
fn pick(random: &mut Random, nodes: &[Node]) -> Node {
    let recent = if random.unit() < 0.5 { nodes.len().min(8) } else { nodes.len() };
    nodes[nodes.len() - 1 - below(random, recent)]
}

/// One more operation of what is there.
fn operation(random: &mut Random, program: &mut Program, nodes: &[Node]) -> Node {
    let [a, b, c, d] = array::from_fn(|_| pick(random, nodes));
    match below(random, 13) {
        0 => {
            let value = if random.unit() < 0.3 { 0.5 * below(random, 5) as f64 } else { random.between(-3.0, 3.0) };
            program.number(value)
        }
        1 => program.negate(a),
        2 | 3 => program.add(a, b),
        4 | 5 => program.subtract(a, b),
        6 | 7 => program.multiply(a, b),
        8 => program.divide(a, b),
        9 => program.minimum(a, b),
        10 => program.maximum(a, b),
        11 => {
            let comparison = if random.unit() < 0.5 { Comparison::Less } else { Comparison::Greater };
            program.select(comparison, [a, b, c, d])
        }
        _ => program.call(CALLS[below(random, CALLS.len())], a),
    }
}

/// Two arrays to two: up to eight inputs, 400 operations, forty results.
fn drawn(random: &mut Random) -> Function {
    let mut program = Program::new();
    let inputs: [Vec<Input>; 2] = ["x", "p"].map(|name| {
        let n = 1 + below(random, 4);
        (0..n).map(|place| Input::Signal(format!("{name}{place}"))).collect()
    });
    let mut nodes: Vec<Node> = inputs.iter().flatten().map(|input| program.input(input.clone(), "")).collect();
    for _ in 0..1 + below(random, 400) {
        let node = operation(random, &mut program, &nodes);
        nodes.push(node);
    }
    let results = ["y", "z"].map(|name| {
        let elements: Vec<String> = (0..1 + below(random, 20)).map(|place| format!("{name}{place}")).collect();
        for element in &elements {
            let node = pick(random, &nodes);
            program.output(element, node);
        }
        Results { name, elements }
    });
    let [x, p] = inputs;
    Function {
        name: "function",
        title: "",
        form: String::new(),
        arguments: vec![Argument { name: "x", elements: x }, Argument { name: "p", elements: p }],
        results: results.into(),
        program,
    }
}

/// The results one after another, each node by the scalar's own function.
fn walked<S: Scalar>(function: &Function, inputs: &[S]) -> Vec<S> {
    let mut values: Vec<S> = Vec::new();
    let program = &function.program;
    let names: Vec<&Input> = function.arguments.iter().flat_map(|argument| &argument.elements).collect();
    let operations = program.reached(program.outputs().iter().map(|(_, node)| *node));
    let zero = S::constant(0.0);
    for node in operations {
        let of = |node: Node| values[node.index()];
        let value = match program.operation_of(node) {
            Operation::Number(bits) => S::constant(f64::from_bits(bits)),
            Operation::Input(index) => {
                let (input, _) = &program.inputs()[index];
                inputs[names.iter().position(|name| *name == input).expect("an argument")]
            }
            Operation::Negate(a) => -of(a),
            Operation::Add(a, b) => of(a) + of(b),
            Operation::Subtract(a, b) => of(a) - of(b),
            Operation::Multiply(a, b) => of(a) * of(b),
            Operation::Divide(a, b) => of(a) / of(b),
            Operation::Minimum(a, b) => of(a).minimum(of(b)),
            Operation::Maximum(a, b) => of(a).maximum(of(b)),
            Operation::Select(Comparison::Less, [a, b, x, y]) => S::if_less(of(a), of(b), of(x), of(y)),
            Operation::Select(Comparison::Greater, [a, b, x, y]) => S::if_less(of(b), of(a), of(x), of(y)),
            Operation::Call(call, a) => {
                let a = of(a);
                match call {
                    Call::Sin => S::sines_cosines([a]).0[0],
                    Call::Cos => S::sines_cosines([a]).1[0],
                    Call::Tan => a.tan(),
                    Call::Tanh => a.tanh(),
                    Call::Exp => a.exp(),
                    Call::Ln => a.ln(),
                    Call::Sqrt => a.sqrt(),
                    Call::Abs => a.abs(),
                    Call::Sign => a.sign(),
                    Call::Min | Call::Max => unreachable!("operations of two numbers"),
                }
            }
        };
        values.resize(values.len().max(node.index() + 1), zero);
        values[node.index()] = value;
    }
    program.outputs().iter().map(|(_, node)| values[node.index()]).collect()
}

fn called<S: Word>(routine: &Routine<S>, function: &Function, inputs: &[S]) -> Vec<S> {
    let (x, p) = inputs.split_at(function.arguments[0].elements.len());
    let blank = |place: usize| vec![S::constant(7.0); function.results[place].elements.len()];
    let (mut y, mut z) = (blank(0), blank(1));
    routine.call([x, p], [&mut y, &mut z]);
    [y, z].concat()
}

/// One NaN is as good as another.
fn bits(numbers: impl IntoIterator<Item = f64>) -> Vec<u64> {
    numbers.into_iter().map(|number| if number.is_nan() { f64::NAN.to_bits() } else { number.to_bits() }).collect()
}

/// Machine code and tape of a function against the walk.
fn compare<S: Word>(what: &str, function: &Function, all_inputs: &[Vec<S>], numbers: impl Fn(S) -> Vec<f64>) {
    let routines = [Routine::<S>::new(function), Routine::interpreted(function)];
    #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
    assert_eq!(routines.each_ref().map(Routine::is_machine_code), [true, false]);
    for inputs in all_inputs {
        let flat = |values: Vec<S>| bits(values.into_iter().flat_map(&numbers));
        let expected = flat(walked(function, inputs));
        for routine in &routines {
            let machine = routine.is_machine_code();
            assert_eq!(flat(called(routine, function, inputs)), expected, "{what}, machine code: {machine}");
        }
    }
}

/// Two thousand programs, each at three everyday points and at three of rare numbers.
#[test]
fn programs_that_nobody_wrote_have_the_same_bits() {
    let mut random = Random::new(30);
    let mut n_operations = 0;
    for number in 0..2_000 {
        let function = drawn(&mut random);
        n_operations += function.program.live().len();
        let n = function.arguments.iter().map(|argument| argument.elements.len()).sum();
        let points: Vec<Vec<f64>> = (0..6)
            .map(|point| {
                let is_rare = |random: &mut Random| point >= 3 && random.unit() < 0.5;
                let mut one = || match is_rare(&mut random) {
                    true => RARE[below(&mut random, RARE.len())],
                    false => random.between(-3.0, 3.0),
                };
                (0..n).map(|_| one()).collect()
            })
            .collect();
        let what = format!("program {number}");
        compare(&what, &function, &points, |number| vec![number]);
        let pairs: Vec<Vec<Lanes>> = [0, 2, 4]
            .map(|at| points[at].iter().zip(&points[at + 1]).map(|(&a, &b)| Lanes::new([a, b])).collect())
            .into();
        compare(&what, &function, &pairs, |lanes| lanes.to_array().to_vec());
    }
    // what is drawn is no toy
    assert!(n_operations > 100_000, "{n_operations} operations of 2,000 programs");
}

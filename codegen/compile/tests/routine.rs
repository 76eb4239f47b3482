//! What holds of every routine, whatever it computes.

use std::{array, thread};

use dynid_compile::{Routine, Word};
use dynid_generated::{Dual, Lanes, Scalar};
use dynid_lower::{
    Input, Node, Program,
    kernel::{Argument, Function, Results},
    program::{Comparison, Function as Call},
};
use dynid_random::Random;

/// The two ways to carry out a function.
fn both<S: Word>(function: &Function) -> [Routine<S>; 2] {
    [Routine::new(function), Routine::interpreted(function)]
}

/// From an array `x` to an array `y`.
fn function(n: usize, outputs: impl FnOnce(&mut Program, &[Node]) -> Vec<Node>) -> Function {
    let mut program = Program::new();
    let inputs: Vec<Input> = (0..n).map(|place| Input::Signal(format!("x{place}"))).collect();
    let nodes: Vec<Node> = inputs.iter().map(|input| program.input(input.clone(), "")).collect();
    let outputs = outputs(&mut program, &nodes);
    let names: Vec<String> = (0..outputs.len()).map(|place| format!("y{place}")).collect();
    names.iter().zip(outputs).for_each(|(name, node)| program.output(name, node));
    Function {
        name: "function",
        title: "",
        form: String::new(),
        arguments: vec![Argument { name: "x", elements: inputs }],
        results: vec![Results { name: "y", elements: names }],
        program,
    }
}

/// Every operation that a program may have, of two numbers.
fn every_operation() -> Function {
    function(2, |program, x| {
        let [a, b] = [x[0], x[1]];
        let constant = program.number(-2.5);
        let mut all = vec![a, b, constant, program.negate(a), program.add(a, b), program.subtract(a, b)];
        all.extend([program.multiply(a, b), program.divide(a, b), program.minimum(a, b), program.maximum(a, b)]);
        all.push(program.select(Comparison::Less, [a, b, constant, a]));
        all.push(program.select(Comparison::Greater, [a, b, constant, a]));
        let calls =
            [Call::Sin, Call::Cos, Call::Tan, Call::Tanh, Call::Exp, Call::Ln, Call::Sqrt, Call::Abs, Call::Sign];
        all.extend(calls.map(|call| program.call(call, a)));
        let sine = program.sin(b);
        let nested = program.call(Call::Exp, sine);
        all.push(nested);
        all.push(program.sin(nested));
        all.push(program.number(3.0));
        all
    })
}

/// What [`every_operation`] is, with the scalar's own functions: sines and cosines of all inputs at once, as the emitted Rust has them.
fn expected<S: Scalar>([a, b]: [S; 2]) -> Vec<S> {
    let constant = S::constant(-2.5);
    let ([sine_a, sine_b], [cosine_a, _]) = S::sines_cosines([a, b]);
    let nested = sine_b.exp();
    let mut all = vec![a, b, constant, -a, a + b, a - b, a * b, a / b, a.minimum(b), a.maximum(b)];
    all.extend([S::if_less(a, b, constant, a), S::if_less(b, a, constant, a)]);
    all.extend([sine_a, cosine_a, a.tan(), a.tanh(), a.exp(), a.ln(), a.sqrt(), a.abs(), a.sign()]);
    all.extend([nested, S::sines_cosines([nested]).0[0], S::constant(3.0)]);
    all
}

fn bits(numbers: impl IntoIterator<Item = f64>) -> Vec<u64> {
    // One NaN is as good as another.
    numbers.into_iter().map(|number| if number.is_nan() { f64::NAN.to_bits() } else { number.to_bits() }).collect()
}

const NUMBERS: [f64; 14] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.3,
    -2.7,
    800.0,
    -800.0,
    1.0e-310,
    1.0e5,
    f64::MAX,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::NAN,
];

#[test]
fn every_operation_is_the_scalars_own() {
    let function = every_operation();
    let n = function.results[0].elements.len();
    let (alone, in_lanes) = (both::<f64>(&function), both::<Lanes>(&function));
    for a in NUMBERS {
        for b in NUMBERS {
            for routine in &alone {
                let mut results = vec![7.0; n];
                routine.call([&[a, b]], [&mut results]);
                let what = format!("{a}, {b}, machine code: {}", routine.is_machine_code());
                assert_eq!(bits(results), bits(expected([a, b])), "{what}");
            }
            let pair = [Lanes::new([a, 0.5]), Lanes::new([b, a])];
            for routine in &in_lanes {
                let mut results = vec![Lanes::constant(7.0); n];
                routine.call([&pair], [&mut results]);
                let what = format!("{a}, {b}, machine code: {}", routine.is_machine_code());
                let numbers = |lanes: Vec<Lanes>| bits(lanes.into_iter().flat_map(Lanes::to_array));
                assert_eq!(numbers(results), numbers(expected(pair)), "{what}");
            }
        }
    }
}

#[test]
fn derivatives_are_carried_along() {
    let function = function(2, |program, x| vec![program.multiply(x[0], x[1])]);
    let x: [Dual<2>; 2] = [Dual::variable(3.0, 0), Dual::variable(5.0, 1)];
    let mut y = [Dual::constant(0.0)];
    Routine::interpreted(&function).call([&x], [&mut y]);
    assert_eq!((y[0].value, y[0].partials), (15.0, [5.0, 3.0]));
}

/// Sums and products at random of what came before, with sines among them, so that much is handed on from part to part.
fn long(n_operations: usize) -> Function {
    function(4, |program, x| {
        let (mut random, mut nodes) = (Random::new(4), x.to_vec());
        while nodes.len() < n_operations {
            let mut pick = || nodes[(random.unit() * nodes.len() as f64) as usize];
            let [a, b, c] = array::from_fn(|_| pick());
            let node = match nodes.len() % 97 {
                0 => program.sin(a),
                1 => program.cos(a),
                2 => program.call(Call::Tanh, a),
                _ => {
                    let half = program.number(0.5);
                    let mean = program.add(a, b);
                    let mean = program.multiply(half, mean);
                    program.subtract(mean, c)
                }
            };
            nodes.push(node);
        }
        nodes.split_off(n_operations - 600)
    })
}

#[test]
fn a_long_function_is_cut_into_parts() {
    let function = long(5_000);
    assert!(function.program.live().len() > 5_000);
    let (alone, in_lanes) = (both::<f64>(&function), both::<Lanes>(&function));
    let mut random = Random::new(5);
    for _ in 0..5 {
        let x: [[f64; 4]; 2] = array::from_fn(|_| array::from_fn(|_| random.between(-1.0, 1.0)));
        let of_each = x.map(|x| {
            let [machine, tape] = alone.each_ref().map(|routine| {
                let mut y = vec![7.0; 600];
                routine.call([&x], [&mut y]);
                bits(y)
            });
            assert_eq!(machine, tape);
            machine
        });
        let x: [Lanes; 4] = array::from_fn(|place| Lanes::new([x[0][place], x[1][place]]));
        for routine in &in_lanes {
            let mut y = vec![Lanes::constant(7.0); 600];
            routine.call([&x], [&mut y]);
            for lane in 0..2 {
                assert_eq!(bits(y.iter().map(|lanes| lanes.to_array()[lane])), of_each[lane]);
            }
        }
    }
}

#[test]
fn threads_share_a_routine() {
    for routine in both::<f64>(&long(3_000)) {
        let of = |seed: u64| {
            let x = Random::new(seed).vector(4, -1.0, 1.0);
            let mut y = vec![7.0; 600];
            routine.call([&x], [&mut y]);
            bits(y)
        };
        let alone: Vec<_> = (0..8).map(of).collect();
        let together: Vec<_> = thread::scope(|scope| {
            let all: Vec<_> = (0..8).map(|seed| scope.spawn(move || (0..200).map(|_| of(seed)).next_back())).collect();
            all.into_iter().map(|one| one.join().expect("no panic")).collect()
        });
        assert_eq!(together, alone.into_iter().map(Some).collect::<Vec<_>>());
    }
}

#[test]
fn many_routines_come_and_go() {
    for round in 0..200 {
        let function = function(1, |program, x| {
            let constant = program.number(f64::from(round));
            vec![program.add(x[0], constant)]
        });
        let (routine, mut y) = (Routine::<f64>::new(&function), [0.0]);
        routine.call([&[1.0]], [&mut y]);
        assert_eq!(y, [f64::from(round + 1)]);
    }
}

#[test]
#[cfg_attr(debug_assertions, should_panic = "every slice has the length")]
fn slices_of_other_lengths_stay_as_they_are() {
    let function = every_operation();
    let n = function.results[0].elements.len();
    for routine in both::<f64>(&function) {
        let (mut y, mut longer) = (vec![7.0; n], vec![7.0; n + 1]);
        routine.call([&[1.0]], [&mut y]);
        routine.call([&[1.0, 2.0, 3.0]], [&mut y]);
        routine.call([&[1.0, 2.0]], [&mut longer]);
        routine.call([&[1.0, 2.0], &[]], [&mut y]);
        routine.call([&[1.0, 2.0]], [&mut y, &mut []]);
        routine.call([], [&mut y]);
        assert!(y.iter().chain(&longer).all(|&value| value == 7.0));
    }
}

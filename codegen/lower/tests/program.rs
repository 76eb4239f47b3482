//! The graph of operations: its text, its passes and its derivatives.

use std::path::Path;

use dynid_lower::{Input, Kir, Node, OperationCounts, Program};
use dynid_model::expression::{Comparison, Function};
use proptest::prelude::*;

const PLANAR2R: &str = include_str!("kir/planar2r.kir");

fn planar2r() -> Kir {
    Kir::parse(PLANAR2R, Path::new("planar2r.kir")).unwrap()
}

/// A value for each input, without any pattern.
fn value(input: &Input) -> f64 {
    let seed = input.identifier().bytes().fold(7u64, |seed, byte| seed.wrapping_mul(31).wrapping_add(byte.into()));
    0.2 + (seed % 1009) as f64 / 1009.0
}

#[test]
fn text_survives_a_round_trip() {
    assert_eq!(planar2r().to_string(), PLANAR2R);
}

#[test]
fn broken_lines_are_pointed_at() {
    let error = |from: &str, to: &str| {
        let broken = PLANAR2R.replace(from, to);
        assert_ne!(broken, PLANAR2R);
        Kir::parse(&broken, Path::new("c01.kir")).unwrap_err().to_string()
    };
    insta::assert_snapshot!(error("s1 = sin(q1)", "s1 = sin(q2)"), @"c01.kir:22:14: `q2` is not defined above this line; write the file anew with `cargo xtask gen`");
    insta::assert_snapshot!(error("s1 = sin(q1)", "s1 = sine(q1)"), @"c01.kir:22:10: `sine` is no known function; write the file anew with `cargo xtask gen`");
    insta::assert_snapshot!(error("let c1", "let s1"), @"c01.kir:23:5: `s1` is defined twice; write the file anew with `cargo xtask gen`");
    insta::assert_snapshot!(error("free 0 1", "free 0 x"), @"c01.kir:4:6: `x`: expected a number; write the file anew with `cargo xtask gen`");
    insta::assert_snapshot!(error("device planar2r\n", ""), @"c01.kir:48:1: the header line `device <id>` is missing; write the file anew with `cargo xtask gen`");
    insta::assert_snapshot!(error("= d00;", "= d00"), @"c01.kir:43:8: expected `name = expression;`; write the file anew with `cargo xtask gen`");
    insta::assert_snapshot!(error("mx2 * link_2_x;", "mx2 ** link_2_x;"), @"c01.kir:28:34: expected a number, a name, a sum, a product, a call or `if .. { .. } else { .. }`; write the file anew with `cargo xtask gen`");
}

#[test]
fn only_live_terms_are_counted_and_each_once() {
    let counts = planar2r().program.operations_for(&["D_0_0", "D_0_1", "D_1_1"]);
    // mx2, inertia2 (2), coupling, inertia1 (7), coupling_cos, d00 (2), d01
    assert_eq!((counts.adds, counts.muls, counts.sincos), (6, 9, 1));
    assert_eq!(OperationCounts { divs: 4, ..counts }.arithmetic(), 6 + 9 + 4);
}

#[test]
fn split_computes_the_same() {
    let program = planar2r().program;
    let split = program.split();
    let prepared = split.prepare.evaluate(value);
    let outputs = split.eval.evaluate(|input| match input {
        Input::Prepared(name) => prepared[split.prepared.iter().position(|known| known == name).unwrap()],
        other => value(other),
    });
    assert_eq!(outputs, program.evaluate(value));
    assert_eq!(split.prepared, ["inertia2", "coupling", "inertia1", "gravity1", "gravity2"]);
    assert_eq!(split.n_lumps, 5);
    assert!(split.eval.inputs().iter().all(|(input, _)| !matches!(input, Input::Parameter(_))));
}

#[test]
fn substitution_of_rest_leaves_gravity() {
    let program = planar2r().program;
    let still = program.substitute(|input, copy| matches!(input, Input::Velocity(_)).then(|| copy.number(0.0)));
    let h0 = still.find_output("h_0").unwrap();
    assert_eq!(still.name_of(h0), Some("phi0"));
}

#[test]
fn torque_is_linear_in_the_lumps() {
    let mut eval = planar2r().program.split().eval;
    let tau: Vec<Node> = ["tau_0", "tau_1"].iter().map(|name| eval.find_output(name).unwrap()).collect();
    let lumps: Vec<Node> = eval
        .inputs()
        .to_vec()
        .iter()
        .filter(|(input, _)| matches!(input, Input::Prepared(_)))
        .map(|(input, _)| eval.find_input(input).unwrap())
        .collect();
    let zero = eval.number(0.0);
    for (row, &tau) in tau.iter().enumerate() {
        let terms: Vec<Node> = lumps
            .iter()
            .map(|&lump| {
                let slope = eval.derivative(&[tau], lump)[0];
                for &other in &lumps {
                    assert_eq!(eval.derivative(&[slope], other), [zero], "tau_{row} is not linear");
                }
                eval.multiply(slope, lump)
            })
            .collect();
        let sum = eval.sum(&terms);
        eval.output(&format!("sum_{row}"), sum);
    }
    let outputs = eval.evaluate(value);
    let at = |name: &str| outputs[eval.outputs().iter().position(|(known, _)| known == name).unwrap()];
    for row in 0..2 {
        let (tau, sum) = (at(&format!("tau_{row}")), at(&format!("sum_{row}")));
        assert!((tau - sum).abs() <= 1e-14 * tau.abs(), "{tau} {sum}");
    }
}

/// What needs no operation has none, and what was computed under another sign is taken from there.
#[test]
fn programs_are_built_simplified() {
    let mut program = Program::new();
    let program = &mut program;
    let (x, y) = (program.position(0, "rad"), program.position(1, "rad"));
    let numbers = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0];
    let [zero, one, two, three, four, five, six, eight] = numbers.map(|value| program.number(value));
    let (minus_x, minus_y) = (program.negate(x), program.negate(y));
    assert_eq!((program.negate(zero), program.negate(minus_x), program.number(-0.0)), (zero, x, zero));
    let minus_two = program.number(-2.0);
    assert_eq!((program.number_of(minus_two), program.negate(minus_two)), (Some(-2.0), two));

    let (sum, twice) = (program.add(x, y), program.multiply(two, x));
    let minus_sum = program.negate(sum);
    assert_eq!([program.add(two, three), program.add(zero, x), program.add(x, zero)], [five, x, x]);
    assert_eq!([program.add(x, x), program.add(minus_x, minus_y)], [twice, minus_sum]);

    let difference = program.subtract(x, y);
    let opposite = program.negate(difference);
    assert_eq!([program.add(x, minus_y), program.add(minus_y, x)], [difference, difference]);
    assert_eq!([program.subtract(y, x), program.subtract(minus_x, minus_y)], [opposite, opposite]);
    assert_eq!([program.subtract(x, minus_y), program.subtract(minus_x, y)], [sum, minus_sum]);
    assert_eq!([program.subtract(five, three), program.subtract(x, x)], [two, zero]);
    assert_eq!([program.subtract(zero, x), program.subtract(x, zero)], [minus_x, x]);

    let (product, four_x, eight_x) = (program.multiply(x, y), program.multiply(four, x), program.multiply(eight, x));
    let minus_product = program.negate(product);
    assert_eq!([program.multiply(two, three), program.multiply(zero, x), program.multiply(x, zero)], [six, zero, zero]);
    assert_eq!([program.multiply(one, x), program.multiply(x, one)], [x, x]);
    assert_eq!([program.multiply(minus_x, y), program.multiply(minus_x, minus_y)], [minus_product, product]);
    // Powers of two lose nothing where they are taken together; other factors round.
    assert_eq!([program.multiply(two, four_x), program.multiply(four_x, two)], [eight_x, eight_x]);
    let three_x = program.multiply(three, x);
    let six_x = program.multiply(six, x);
    assert!(program.multiply(two, three_x) != six_x && program.multiply(three, twice) != six_x);

    let quotient = program.divide(x, y);
    let minus_quotient = program.negate(quotient);
    assert_eq!([program.divide(six, three), program.divide(zero, x), program.divide(x, one)], [two, zero, x]);
    assert_eq!([program.divide(minus_x, y), program.divide(minus_x, minus_y)], [minus_quotient, quotient]);
    let by_zero = program.divide(one, zero);
    assert_eq!(program.number_of(by_zero), None, "no infinity is written as a number");

    use Function::{Abs, Cos, Exp, Ln, Sign, Sin, Sqrt, Tan, Tanh};
    for function in [Sin, Tan, Tanh, Sign] {
        let value = program.call(function, x);
        let minus_value = program.negate(value);
        assert_eq!(
            [program.call(function, zero), program.call(function, minus_x)],
            [zero, minus_value],
            "{function:?}"
        );
    }
    for function in [Cos, Abs] {
        assert_eq!(program.call(function, minus_x), program.call(function, x), "{function:?}");
    }
    for function in [Exp, Sqrt, Ln] {
        assert_ne!(program.call(function, minus_x), program.call(function, x), "{function:?}");
    }
    assert_eq!([Cos, Exp].map(|function| program.call(function, zero)), [one, one]);
    assert_eq!([Sqrt, Abs].map(|function| program.call(function, zero)), [zero, zero]);
    assert_eq!([program.call(Sqrt, one), program.call(Ln, one)], [one, zero]);
    assert_eq!([program.call(Abs, minus_two), program.call(Sign, three)], [two, one]);
    let minus_one = program.number(-1.0);
    assert_eq!(program.call(Sign, minus_two), minus_one);
    let logarithm = program.call(Ln, two);
    assert_eq!(program.number_of(logarithm), None, "what rounds is left to the kernel");

    assert_eq!([program.minimum(x, x), program.maximum(x, x)], [x, x]);
    assert_ne!(program.minimum(x, y), program.maximum(x, y));
    assert_eq!(program.select(Comparison::Less, [x, y, two, two]), two);
    for (comparison, expected) in [(Comparison::Less, [x, y, y]), (Comparison::Greater, [y, x, y])] {
        let found = [[two, three], [three, two], [two, two]].map(|[a, b]| program.select(comparison, [a, b, x, y]));
        assert_eq!(found, expected, "{comparison:?}");
    }
    assert_eq!((program.sum(&[]), program.product(&[])), (zero, one));
    assert_eq!((program.sum(&[x, y]), program.product(&[x, y])), (sum, product));
}

/// The interpreter against the functions of the standard library, one operation at a time.
#[test]
fn every_operation_is_evaluated() {
    use Function::{Abs, Cos, Exp, Ln, Sign, Sin, Sqrt, Tan, Tanh};
    type Value = fn(f64) -> f64;
    let functions: [(Function, Value); 8] = [
        (Sin, f64::sin),
        (Cos, f64::cos),
        (Tan, f64::tan),
        (Tanh, f64::tanh),
        (Exp, f64::exp),
        (Ln, f64::ln),
        (Sqrt, f64::sqrt),
        (Abs, f64::abs),
    ];
    for (a, b) in [(0.7_f64, 0.3_f64), (0.3, 0.7), (0.5, 0.5), (1.9, -0.4)] {
        let mut program = Program::new();
        let (x, y) = (program.position(0, "rad"), program.position(1, "rad"));
        let mut outputs = vec![program.negate(x), program.add(x, y), program.subtract(x, y), program.multiply(x, y)];
        outputs.extend([program.divide(x, y), program.minimum(x, y), program.maximum(x, y), program.number(2.5)]);
        outputs.push(program.select(Comparison::Less, [x, y, x, y]));
        outputs.push(program.select(Comparison::Greater, [x, y, x, y]));
        outputs.extend([program.call(Sign, x), program.call(Sign, y)]);
        let difference = program.subtract(x, y);
        outputs.push(program.call(Sign, difference));
        let mut expected = vec![-a, a + b, a - b, a * b, a / b, a.min(b), a.max(b), 2.5];
        expected.extend([if a < b { a } else { b }, if a > b { a } else { b }, 1.0, if b < 0.0 { -1.0 } else { 1.0 }]);
        expected.push(if a == b { 0.0 } else { (a - b).signum() });
        for (function, value) in functions {
            outputs.push(program.call(function, x));
            expected.push(value(a));
        }
        for (place, node) in outputs.into_iter().enumerate() {
            program.output(&format!("y{place}"), node);
        }
        assert_eq!(program.evaluate(at([a, b, f64::NAN])), expected);
    }
}

/// Also of what no equations of motion have: what was prepared, an effect's signals and states.
#[test]
fn every_kind_of_input_survives_a_round_trip() {
    let mut program = Program::new();
    let inputs = [
        Input::Parameter("link.1.m".to_owned()),
        Input::Locked(2),
        Input::Position(0),
        Input::Velocity(0),
        Input::Acceleration(1),
        Input::Torque(1),
        Input::Prepared("inertia2".to_owned()),
        Input::Signal("dq".to_owned()),
        Input::State("z".to_owned()),
    ];
    let nodes: Vec<Node> = inputs.iter().map(|input| program.input(input.clone(), "")).collect();
    let sum = program.sum(&nodes);
    program.output("sum", sum);
    let text = Kir { program, ..planar2r() }.to_string();
    let read = Kir::parse(&text, Path::new("made.kir")).unwrap();
    let found: Vec<&Input> = read.program.inputs().iter().map(|(input, _)| input).collect();
    assert_eq!(found, inputs.iter().collect::<Vec<_>>());
    assert_eq!(read.to_string(), text);
}

/// Also functions that no equations of motion have: the text that is read is that of the program, and computes the same.
#[test]
fn every_operation_survives_a_round_trip() {
    use Function::{Abs, Cos, Exp, Ln, Sign, Sin, Sqrt, Tan, Tanh};
    let mut program = Program::new();
    assert!(program.is_empty());
    let (x, y) = (program.position(0, "rad"), program.position(1, "rad"));
    assert!(!program.is_empty());
    assert_eq!(program.len(), 2);
    let mut nodes = vec![program.minimum(x, y), program.maximum(y, x), program.divide(x, y), program.subtract(x, y)];
    nodes.extend([Abs, Cos, Exp, Ln, Sign, Sin, Sqrt, Tan, Tanh].map(|function| program.call(function, x)));
    nodes.push(program.select(Comparison::Less, [x, y, x, y]));
    nodes.push(program.select(Comparison::Greater, [x, y, y, x]));
    for (place, node) in nodes.into_iter().enumerate() {
        program.output(&format!("y{place}"), node);
    }
    let kir = Kir { program, ..planar2r() };
    let read = Kir::parse(&kir.to_string(), Path::new("made.kir")).unwrap();
    assert_eq!(read.to_string(), kir.to_string());
    for (a, b) in [(0.7, 0.3), (0.2, 1.9)] {
        let values = |kir: &Kir| kir.program.evaluate(at([a, b, f64::NAN]));
        assert_eq!(values(&read), values(&kir));
    }
    for (call, message) in [("min(q0)", "takes two arguments"), ("sin(q0, q1)", "takes one argument")] {
        let broken = PLANAR2R.replace("s1 = sin(q1)", &format!("s1 = {call}"));
        let error = Kir::parse(&broken, Path::new("c01.kir")).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
}

/// Builds a random smooth program of three inputs from a list of choices.
fn random_program(choices: &[(u8, u8, u8)]) -> (Program, Node) {
    let mut program = Program::new();
    let mut nodes: Vec<Node> = (0..3).map(|joint| program.position(joint, "rad")).collect();
    nodes.push(program.number(1.5));
    for &(kind, a, b) in choices {
        let (a, b) = (nodes[a as usize % nodes.len()], nodes[b as usize % nodes.len()]);
        let node = match kind % 12 {
            0 | 1 => program.add(a, b),
            2 | 3 => program.subtract(a, b),
            4 | 5 => {
                // Bounded factors keep the finite differences honest.
                let (a, b) = (program.call(Function::Tanh, a), program.sin(b));
                program.multiply(a, b)
            }
            6 => program.sin(a),
            7 => program.cos(a),
            8 => program.negate(a),
            9 => {
                let (two, sine) = (program.number(2.0), program.sin(b));
                let denominator = program.add(two, sine);
                program.divide(a, denominator)
            }
            10 => {
                let sine = program.sin(a);
                program.call(Function::Exp, sine)
            }
            _ => {
                let zero = program.number(0.0);
                program.select(Comparison::Less, [a, zero, a, b])
            }
        };
        nodes.push(node);
    }
    let last = nodes[nodes.len() - 1];
    program.name(last, "last");
    program.output("y", last);
    (program, last)
}

fn at(q: [f64; 3]) -> impl FnMut(&Input) -> f64 {
    move |input| match input {
        Input::Position(joint) => q[*joint],
        _ => f64::NAN,
    }
}

proptest! {
    /// Writing, reading and writing again changes no character, and reading changes no bit of any output.
    #[test]
    fn random_programs_survive_a_round_trip(choices: Vec<(u8, u8, u8)>, q in [-2.0..2.0, -2.0..2.0, -2.0..2.0f64]) {
        let kir = Kir { program: random_program(&choices).0, ..planar2r() };
        let text = kir.to_string();
        let read = Kir::parse(&text, Path::new("random.kir")).unwrap();
        prop_assert_eq!(&read.to_string(), &text);
        let (before, after) = (kir.program.evaluate(at(q))[0], read.program.evaluate(at(q))[0]);
        prop_assert!(before == after || before.is_nan() && after.is_nan());
        prop_assert_eq!(kir.program.operations(), read.program.operations());
    }

    #[test]
    fn derivative_is_the_central_difference(
        choices in prop::collection::vec(any::<(u8, u8, u8)>(), 1..25),
        q in [-2.0..2.0, -2.0..2.0, -2.0..2.0f64],
    ) {
        let (mut program, last) = random_program(&choices);
        for joint in 0..3 {
            let by = program.position(joint, "rad");
            let slope = program.derivative(&[last], by)[0];
            program.output(&format!("slope_{joint}"), slope);
        }
        let step = 1e-5;
        let slopes = program.evaluate(at(q));
        for joint in 0..3 {
            let shifted = |by: f64| {
                let mut q = q;
                q[joint] += by;
                program.evaluate(at(q))[0]
            };
            // Second differences tell where a kink or a strong curvature lies within the step.
            let (below, middle, above) = (shifted(-step), shifted(0.0), shifted(step));
            prop_assume!((above - 2.0 * middle + below).abs() < 1e-7);
            let difference = (above - below) / (2.0 * step);
            let slope = slopes[1 + joint];
            prop_assert!((difference - slope).abs() <= 1e-5 * (1.0 + slope.abs()), "{difference} {slope}");
        }
    }
}

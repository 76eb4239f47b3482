//! Machine code and tape compute what the compiled-in kernels do, bit by bit.

use std::{fs, path::Path};

use dynid_compile::{Routine, Word};
use dynid_generated::{EffectFunctions, EndPointFunctions, KernelFunctions, Lanes, Scalar};
use dynid_lower::{
    Kir, Operation,
    effect::EffectKernels,
    end_point::EndPoint,
    kernel::{Configuration, Function},
    program::Function as Call,
};
use dynid_random::Random;

/// The configurations whose kernels are compiled in.
fn configurations() -> impl Iterator<Item = (Configuration, &'static dyn KernelFunctions)> {
    dynid_generated::kernels().iter().map(|kernel| {
        let number = kernel.configuration.expect("a configuration");
        let file = format!("../../generated/{}/c{number:02}.kir", kernel.device);
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
        let kir = Kir::parse(&fs::read_to_string(&path).expect("equations"), &path).expect("well formed");
        (Configuration::new(&kir).expect("complete"), kernel.functions)
    })
}

type Arrays<S> = Vec<Vec<S>>;

fn lengths(function: &Function) -> (Vec<usize>, Vec<usize>) {
    let arguments = function.arguments.iter().map(|own| own.elements.len());
    (arguments.collect(), function.results.iter().map(|own| own.elements.len()).collect())
}

/// Calls a routine with as many arrays as it has.
fn call<S: Scalar>(routine: &Routine<S>, arguments: &[Vec<S>], results: &mut [Vec<S>]) {
    match (arguments, results) {
        ([a, b], [x]) => routine.call([a, b], [x]),
        ([a, b], [x, y]) => routine.call([a, b], [x, y]),
        ([a, b], [x, y, z]) => routine.call([a, b], [x, y, z]),
        ([a, b, c], [x]) => routine.call([a, b, c], [x]),
        ([a, b, c], [x, y]) => routine.call([a, b, c], [x, y]),
        ([a, b, c], [x, y, z]) => routine.call([a, b, c], [x, y, z]),
        ([a, b, c, d], [x]) => routine.call([a, b, c, d], [x]),
        ([a, b, c, d], [x, y, z]) => routine.call([a, b, c, d], [x, y, z]),
        _ => panic!("a number of arrays that no function has"),
    }
}

fn kernel(functions: &dyn KernelFunctions, name: &str, arguments: &[Vec<f64>], results: &mut [Vec<f64>]) {
    match (name, arguments, results) {
        ("prepare", [p, l], [x]) => functions.prepare(p, l, x),
        ("inertia", [p, q], [x]) => functions.inertia(p, q, x),
        ("coriolis", [p, q, dq], [x]) => functions.coriolis(p, q, dq, x),
        ("gravity", [p, q], [x]) => functions.gravity(p, q, x),
        ("bias", [p, q, dq], [x]) => functions.bias(p, q, dq, x),
        ("inertia_and_bias", [p, q, dq], [x, y]) => functions.inertia_and_bias(p, q, dq, x, y),
        ("inverse_dynamics", [p, q, dq, ddq], [x]) => functions.inverse_dynamics(p, q, dq, ddq, x),
        ("forward_dynamics", [p, q, dq, tau], [x]) => functions.forward_dynamics(p, q, dq, tau, x),
        ("regressor", [p, q, dq, ddq], [x]) => functions.regressor(p, q, dq, ddq, x),
        ("inverse_dynamics_gradient", [p, q, dq, ddq], [x, y, z]) => {
            functions.inverse_dynamics_gradient(p, q, dq, ddq, x, y, z);
        }
        _ => panic!("{name}: no such kernel"),
    }
}

/// False of a function that is not compiled in for lanes.
fn kernel_lanes(
    functions: &dyn KernelFunctions,
    name: &str,
    arguments: &[Vec<Lanes>],
    results: &mut [Vec<Lanes>],
) -> bool {
    match (name, arguments, results) {
        ("inertia", [p, q], [x]) => functions.inertia_lanes(p, q, x),
        ("regressor", [p, q, dq, ddq], [x]) => functions.regressor_lanes(p, q, dq, ddq, x),
        ("inverse_dynamics_gradient", [p, q, dq, ddq], [x, y, z]) => {
            functions.inverse_dynamics_gradient_lanes(p, q, dq, ddq, x, y, z);
        }
        _ => return false,
    }
    true
}

fn law(functions: &dyn EffectFunctions, name: &str, arguments: &[Vec<f64>], results: &mut [Vec<f64>]) {
    match (name, arguments, results) {
        ("eval", [p, s, z], [x, y]) => functions.eval(p, s, z, x, y),
        ("eval_gradient", [p, s, z], [x, y, j]) => functions.eval_gradient(p, s, z, x, y, j),
        _ => panic!("{name}: no such function"),
    }
}

fn law_lanes(
    functions: &dyn EffectFunctions,
    name: &str,
    arguments: &[Vec<Lanes>],
    results: &mut [Vec<Lanes>],
) -> bool {
    match (name, arguments, results) {
        ("eval", [p, s, z], [x, y]) => functions.eval_lanes(p, s, z, x, y),
        ("eval_gradient", [p, s, z], [x, y, j]) => functions.eval_gradient_lanes(p, s, z, x, y, j),
        _ => panic!("{name}: no such function"),
    }
    true
}

fn chain(functions: &dyn EndPointFunctions, name: &str, arguments: &[Vec<f64>], results: &mut [Vec<f64>]) {
    match (name, arguments, results) {
        ("pose", [l, q], [x, r]) => functions.pose(l, q, x, r),
        ("motion", [l, q], [x, r, j]) => functions.motion(l, q, x, r, j),
        _ => panic!("{name}: no such function"),
    }
}

fn equal_bits(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

fn assert_equal_bits<S: Copy + PartialEq>(
    what: &str,
    numbers: impl Fn(S) -> Vec<f64>,
    expected: &Arrays<S>,
    results: &Arrays<S>,
) {
    for (array, (expected, results)) in expected.iter().zip(results).enumerate() {
        for (element, (&expected, &result)) in expected.iter().zip(results).enumerate() {
            let (expected, result) = (numbers(expected), numbers(result));
            let equal = expected.iter().zip(&result).all(|(&a, &b)| equal_bits(a, b));
            assert!(equal, "{what}, result {array}, element {element}: {result:?}, not {expected:?}");
        }
    }
}

/// Random numbers of one lane, of everyday size mostly; `rare` replaces one in a hundred.
fn numbers(random: &mut Random, lengths: &[usize], rare: &[f64]) -> Arrays<f64> {
    let mut one = || match rare.len() {
        0 => random.between(-2.0, 2.0),
        n if random.unit() < 0.01 => rare[(random.unit() * n as f64) as usize],
        _ => random.between(-2.0, 2.0),
    };
    lengths.iter().map(|&length| (0..length).map(|_| one()).collect()).collect()
}

fn in_lanes(first: &Arrays<f64>, second: &Arrays<f64>) -> Arrays<Lanes> {
    let lanes = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(&a, &b)| Lanes::new([a, b])).collect();
    first.iter().zip(second).map(lanes).collect()
}

/// What is no number, what is beyond every number, both zeros, and angles that take another reduction.
const RARE: [f64; 8] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -0.0, 1.5e6, -3.0e9, 1.0e-310];

/// Machine code and tape against `compiled`, at random arguments.
fn compare(
    what: &str,
    function: &Function,
    random: &mut Random,
    compiled: impl Fn(&[Vec<f64>], &mut [Vec<f64>]),
    compiled_lanes: impl Fn(&[Vec<Lanes>], &mut [Vec<Lanes>]) -> bool,
) {
    fn both<S: Word>(function: &Function) -> [Routine<S>; 2] {
        let routines = [Routine::new(function), Routine::interpreted(function)];
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        assert_eq!(routines.each_ref().map(Routine::is_machine_code), [true, false]);
        routines
    }
    let (routines, lanes_routines) = (both::<f64>(function), both::<Lanes>(function));
    let (n_arguments, n_results) = lengths(function);
    for rare in [&[][..], &[], &[], &RARE, &RARE] {
        let arguments = [numbers(random, &n_arguments, rare), numbers(random, &n_arguments, rare)];
        let blank: Arrays<f64> = n_results.iter().map(|&length| vec![7.0; length]).collect();
        let lanes_blank = in_lanes(&blank, &blank);
        for arguments in &arguments {
            let mut expected = blank.clone();
            compiled(arguments, &mut expected);
            for routine in &routines {
                let mut results = blank.clone();
                call(routine, arguments, &mut results);
                assert_equal_bits(what, |number| vec![number], &expected, &results);
            }
        }
        let arguments = in_lanes(&arguments[0], &arguments[1]);
        let mut expected = lanes_blank.clone();
        let is_compiled_in = compiled_lanes(&arguments, &mut expected);
        let results = lanes_routines.each_ref().map(|routine| {
            let mut results = lanes_blank.clone();
            call(routine, &arguments, &mut results);
            results
        });
        let numbers = |lanes: Lanes| lanes.to_array().to_vec();
        assert_equal_bits(what, numbers, &results[0], &results[1]);
        if is_compiled_in {
            assert_equal_bits(what, numbers, &expected, &results[0]);
        }
    }
}

#[test]
fn kernels_have_the_bits_of_those_compiled_in() {
    let mut random = Random::new(1);
    for (configuration, functions) in configurations() {
        for function in &configuration.functions {
            let what = format!("{}, configuration {}, {}", configuration.device, configuration.number, function.name);
            compare(
                &what,
                function,
                &mut random,
                |arguments, results| kernel(functions, function.name, arguments, results),
                |arguments, results| kernel_lanes(functions, function.name, arguments, results),
            );
        }
    }
}

#[test]
fn effects_have_the_bits_of_those_compiled_in() {
    let mut random = Random::new(2);
    for effect in dynid_model::effects() {
        let functions = dynid_generated::effect(&effect.id).expect("compiled in").functions;
        let own = EffectKernels::new(effect).expect("formulas");
        for function in [&own.eval, &own.eval_gradient] {
            compare(
                &format!("{}, {}", effect.id, function.name),
                function,
                &mut random,
                |arguments, results| law(functions, function.name, arguments, results),
                |arguments, results| law_lanes(functions, function.name, arguments, results),
            );
        }
    }
}

#[test]
fn end_points_have_the_bits_of_those_compiled_in() {
    let mut random = Random::new(3);
    for device in dynid_model::devices() {
        let Some(own) = EndPoint::new(device).expect("a chain") else { continue };
        let functions = dynid_generated::end_point(&device.id).expect("compiled in").functions;
        for function in &own.functions {
            compare(
                &format!("{}, {}", device.id, function.name),
                function,
                &mut random,
                |arguments, results| chain(functions, function.name, arguments, results),
                |_, _| false,
            );
        }
    }
}

/// The corpus has what the two back ends treat apart.
#[test]
fn compared_functions_have_every_call_and_several_parts() {
    let effects = dynid_model::effects().iter().map(|effect| EffectKernels::new(effect).expect("formulas"));
    let functions: Vec<Function> = effects.flat_map(|own| [own.eval, own.eval_gradient]).collect();
    let operations: Vec<Operation> = functions
        .iter()
        .flat_map(|function| function.program.live().into_iter().map(|node| function.program.operation_of(node)))
        .collect();
    for call in [Call::Sin, Call::Cos, Call::Tanh, Call::Exp, Call::Abs, Call::Sign] {
        assert!(
            operations.iter().any(|operation| matches!(operation, Operation::Call(own, _) if *own == call)),
            "{call:?}"
        );
    }
    let longest = configurations().flat_map(|(own, _)| own.functions).map(|own| own.program.live().len()).max();
    assert!(longest > Some(2_000), "{longest:?}");
}

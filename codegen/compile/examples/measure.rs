//! What routines cost beside the kernels that are compiled in: those of the Freedom 6S with all joints free.
//!
//! Each time is the least of many rounds, in which all take turns. A result goes into the next state, so that a call waits for the
//! one before.

use std::{
    fs,
    hint::black_box,
    ops::{Add, Div, Mul, Neg, Sub},
    path::Path,
    time::Instant,
};

use dynid_compile::Routine;
use dynid_generated::{Lanes, Scalar};
use dynid_lower::{Kir, kernel::Configuration};
use dynid_random::Random;

/// Numbers side by side, of which a tape does each operation at once.
const MANY: usize = 16;

#[derive(Debug, Clone, Copy)]
struct Many([f64; MANY]);

impl Many {
    fn each(self, of: impl Fn(f64) -> f64) -> Self {
        Many(self.0.map(of))
    }
}

macro_rules! operators {
    ($($operator:ident $method:ident)*) => {
        $(impl $operator for Many {
            type Output = Many;
            #[inline(always)]
            fn $method(self, other: Many) -> Many {
                Many(std::array::from_fn(|lane| self.0[lane].$method(other.0[lane])))
            }
        })*
    };
}

operators!(Add add Sub sub Mul mul Div div);

impl Neg for Many {
    type Output = Many;
    fn neg(self) -> Many {
        self.each(|value| -value)
    }
}

impl Scalar for Many {
    fn constant(value: f64) -> Many {
        Many([value; MANY])
    }
    fn sines_cosines<const N: usize>(angles: [Many; N]) -> ([Many; N], [Many; N]) {
        let (mut sines, mut cosines) = (angles, angles);
        for place in 0..N {
            (sines[place].0, cosines[place].0) = f64::sines_cosines(angles[place].0);
        }
        (sines, cosines)
    }
    fn tan(self) -> Many {
        self.each(Scalar::tan)
    }
    fn tanh(self) -> Many {
        self.each(Scalar::tanh)
    }
    fn exp(self) -> Many {
        self.each(Scalar::exp)
    }
    fn ln(self) -> Many {
        self.each(Scalar::ln)
    }
    fn sqrt(self) -> Many {
        self.each(Scalar::sqrt)
    }
    fn abs(self) -> Many {
        self.each(Scalar::abs)
    }
    fn sign(self) -> Many {
        self.each(Scalar::sign)
    }
    fn if_less(a: Many, b: Many, then: Many, otherwise: Many) -> Many {
        Many(std::array::from_fn(|lane| if a.0[lane] < b.0[lane] { then.0[lane] } else { otherwise.0[lane] }))
    }
}

const DEVICE: &str = "freedom6s";
const ROUNDS: usize = 400;

/// What is measured: its name, its calls in a row, and what it is divided by.
struct Work<'a> {
    name: &'a str,
    states_per_call: usize,
    call: Box<dyn FnMut() + 'a>,
    least: f64,
}

/// A tenth of a millisecond or so of each in turn.
fn measure(works: &mut [Work]) {
    for round in 0..ROUNDS {
        for work in &mut *works {
            let calls = if work.states_per_call > 1 { 20 } else { 100 };
            let start = Instant::now();
            (0..calls).for_each(|_| (work.call)());
            let per_state = start.elapsed().as_secs_f64() * 1e9 / (calls * work.states_per_call) as f64;
            if round > 0 {
                work.least = work.least.min(per_state);
            }
        }
    }
    for work in works.iter() {
        println!("  {:<24} {:>7.0} ns  {:>5.2}", work.name, work.least, work.least / works[0].least);
    }
}

/// A dependent chain: what a call gives goes, small, into the next state.
fn chained<'a, S: Scalar + 'a>(
    name: &'a str,
    states_per_call: usize,
    n: usize,
    given: &'a [Vec<f64>; 4],
    mut call: impl FnMut([&[S]; 4], &mut [S]) + 'a,
) -> Work<'a> {
    let [prepared, mut q, dq, last] = given.clone().map(|own| own.into_iter().map(S::constant).collect::<Vec<S>>());
    let still = q.clone();
    let mut result = vec![S::constant(0.0); n];
    let call = move || {
        call([&prepared, &q, &dq, &last], &mut result);
        for ((angle, &still), &result) in q.iter_mut().zip(&still).zip(&result) {
            *angle = still + result * S::constant(1e-9);
        }
        black_box(&result);
    };
    Work { name, states_per_call, call: Box::new(call), least: f64::INFINITY }
}

fn main() {
    let of_device = |kernel: &&&dynid_generated::Kernel| kernel.device == DEVICE;
    let all_free = dynid_generated::kernels().iter().filter(of_device).max_by_key(|kernel| kernel.free.len());
    let kernel = all_free.expect("the device is compiled in");
    let n = kernel.free.len();
    let file = format!("../../generated/{DEVICE}/c{:02}.kir", kernel.configuration.expect("a configuration"));
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
    let kir = Kir::parse(&fs::read_to_string(&path).expect("equations"), &path).expect("well formed");
    let configuration = Configuration::new(&kir).expect("complete");
    let function = |name: &str| configuration.functions.iter().find(|own| own.name == name).expect("a kernel");

    println!("to make, alone / in lanes / as a tape:");
    let least = |mut make: Box<dyn FnMut()>| {
        let times = (0..5).map(|_| {
            let start = Instant::now();
            make();
            start.elapsed().as_secs_f64() * 1e3
        });
        times.fold(f64::INFINITY, f64::min)
    };
    let mut sums = [0.0; 3];
    for own in &configuration.functions {
        let (alone, lanes, tape) = (own.clone(), own.clone(), own.clone());
        let times = [
            least(Box::new(move || drop(black_box(Routine::<f64>::new(&alone))))),
            least(Box::new(move || drop(black_box(Routine::<Lanes>::new(&lanes))))),
            least(Box::new(move || drop(black_box(Routine::<f64>::interpreted(&tape))))),
        ];
        let operations = own.program.live().len();
        println!("  {:<26} {operations:>5} nodes {:>6.1} {:>6.1} {:>6.2} ms", own.name, times[0], times[1], times[2]);
        sums.iter_mut().zip(times).for_each(|(sum, time)| *sum += time);
    }
    println!("  {:<38} {:>6.1} {:>6.1} {:>6.2} ms", "all", sums[0], sums[1], sums[2]);

    let mut random = Random::new(1);
    let parameters = random.vector(kernel.parameters.len(), 0.1, 1.0);
    let mut prepared = vec![0.0; kernel.prepared.len()];
    kernel.functions.prepare(&parameters, &random.vector(kernel.locked.len(), -1.0, 1.0), &mut prepared);
    let given = [prepared, random.vector(n, -1.0, 1.0), random.vector(n, -1.0, 1.0), random.vector(n, -1.0, 1.0)];

    println!("forward dynamics, per state:");
    let own = function("forward_dynamics");
    let (machine, tape) = (Routine::<f64>::new(own), Routine::<f64>::interpreted(own));
    let (lanes, many) = (Routine::<Lanes>::new(own), Routine::<Many>::interpreted(own));
    assert!(machine.is_machine_code(), "no machine code can be made here");
    measure(&mut [
        chained("compiled in", 1, n, &given, |[p, q, dq, tau]: [&[f64]; 4], ddq| {
            kernel.functions.forward_dynamics(p, q, dq, tau, ddq);
        }),
        chained("machine code", 1, n, &given, |given: [&[f64]; 4], ddq| machine.call(given, [ddq])),
        chained("machine code, two lanes", 2, n, &given, |given: [&[Lanes]; 4], ddq| lanes.call(given, [ddq])),
        chained("tape", 1, n, &given, |given: [&[f64]; 4], ddq| tape.call(given, [ddq])),
        chained("tape, 16 at once", MANY, n, &given, |given: [&[Many]; 4], ddq| many.call(given, [ddq])),
    ]);

    println!("inverse dynamics with gradient, per state:");
    let own = function("inverse_dynamics_gradient");
    let (machine, lanes) = (Routine::<f64>::new(own), Routine::<Lanes>::new(own));
    let tape = Routine::<f64>::interpreted(own);
    let mut by = [vec![0.0; n * n], vec![0.0; n * n]];
    let [mut by_machine, mut by_tape] = [by.clone(), by.clone()];
    let mut by_lanes = [vec![Lanes::constant(0.0); n * n], vec![Lanes::constant(0.0); n * n]];
    let mut by_lanes_compiled = by_lanes.clone();
    measure(&mut [
        chained("compiled in", 1, n, &given, |[p, q, dq, ddq]: [&[f64]; 4], tau| {
            let [by_q, by_dq] = &mut by;
            kernel.functions.inverse_dynamics_gradient(p, q, dq, ddq, tau, by_q, by_dq);
        }),
        chained("machine code", 1, n, &given, |given: [&[f64]; 4], tau| {
            let [by_q, by_dq] = &mut by_machine;
            machine.call(given, [tau, by_q, by_dq]);
        }),
        chained("compiled in, two lanes", 2, n, &given, |[p, q, dq, ddq]: [&[Lanes]; 4], tau| {
            let [by_q, by_dq] = &mut by_lanes_compiled;
            kernel.functions.inverse_dynamics_gradient_lanes(p, q, dq, ddq, tau, by_q, by_dq);
        }),
        chained("machine code, two lanes", 2, n, &given, |given: [&[Lanes]; 4], tau| {
            let [by_q, by_dq] = &mut by_lanes;
            lanes.call(given, [tau, by_q, by_dq]);
        }),
        chained("tape", 1, n, &given, |given: [&[f64]; 4], tau| {
            let [by_q, by_dq] = &mut by_tape;
            tape.call(given, [tau, by_q, by_dq]);
        }),
    ]);
}

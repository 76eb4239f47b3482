//! The equations against other derivations.

mod robots;

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use dynid_equations::{
    Options,
    algebra::Symbol,
    collected::Subset,
    emit::Context,
    exact::Exact,
    kernel::{self, Group, pairs},
    structure::Structure,
    tree::{LONG, Tree},
};
use dynid_lower::{Input, Program};
use dynid_model::Device;
use robots::{Random, chain, random_robot, random_robot_of};

type Algebra = dynid_equations::algebra::Algebra<Exact>;
type Lagrangian = dynid_equations::lagrangian::Lagrangian<Exact>;

/// Largest difference between derivations, relative to the largest entry of D, h or tau.
const AGREEMENT: f64 = 1e-12;

#[test]
fn of_shipped_devices_every_form_agrees() {
    for device in dynid_model::devices() {
        every_form_agrees(device, 10, true);
        the_same_bytes_twice(device);
    }
}

#[test]
fn of_random_robots_every_form_agrees() {
    for seed in 0..30 {
        every_form_agrees(&random_robot(seed), 4, false);
    }
}

/// However few terms are long: with none, every constant rotation is a turning without a joint.
#[test]
fn constant_rotations_may_be_kept_apart() {
    for seed in 0..60 {
        let device = random_robot_of(seed, 2 + seed as usize % 6, seed % 3 == 0);
        let algebra = Algebra::new(&device).expect("it has equations");
        let mut random = Random(seed);
        for free in [(0..device.joints.len()).collect::<Vec<_>>(), vec![0], vec![device.joints.len() - 1]] {
            let context = Context { algebra: &algebra, device: &device, free: &free };
            for most_terms in [0, 1, 4] {
                let tree = Tree::with_long(most_terms, &algebra, &device, &free).expect("it has equations");
                let n_apart = tree.turnings.iter().skip(1).filter(|turning| turning.joint.is_none()).count();
                assert!(n_apart > 0 || most_terms > 0);
                for program in Group::ALL.map(|group| kernel::recursion(&context, &tree, group)) {
                    for _ in 0..2 {
                        let sample = Sample::new(&device, &algebra, &free, &mut random);
                        let expected = sample.by_the_plant(&device);
                        for ((name, _), value) in program.outputs().iter().zip(sample.evaluate(&program)) {
                            let difference = expected.difference(name, value);
                            let what = format!("seed {seed}, {free:?}, {most_terms}: {name} differs by {difference:e}");
                            assert!(difference <= AGREEMENT, "{what}");
                        }
                    }
                }
            }
        }
    }
}

/// A chain of many joints, one of them free: multiplied out, the locked ones made a million terms.
#[test]
fn many_locked_joints_make_no_long_polynomials() {
    for (n_joints, at_right_angles) in [(16, false), (24, true)] {
        let device = chain(n_joints, at_right_angles);
        let algebra = Algebra::new(&device).expect("it has equations");
        for free in [0, n_joints / 2, n_joints - 1] {
            let tree = Tree::new(&algebra, &device, &[free]).expect("it has equations");
            assert!(tree.turnings.iter().skip(1).any(|turning| turning.joint.is_none()));
            let fixed = tree.turnings.iter().flat_map(|turning| turning.fixed.iter().flatten());
            let of_bodies = tree.bodies.iter().flat_map(|body| body.rotation.iter().flatten());
            let segments = tree.bodies.iter().flat_map(|body| body.place.values());
            let of_places = segments.flat_map(|segment| &segment.constant);
            let longest = fixed.chain(of_bodies).chain(of_places).map(|polynomial| polynomial.n_terms()).max();
            // Each frame adds a long one at most to where things are.
            assert!(longest <= Some(n_joints * LONG), "{n_joints} joints, {free} free: {longest:?} terms");
        }
    }
}

/// Lagrange's equations, the recursion, the collected subset and what was chosen, against the plant and each other.
fn every_form_agrees(device: &Device, n_samples: usize, told: bool) {
    let algebra = Algebra::new(device).expect("it has equations");
    let lagrangian = Lagrangian::new(&algebra, device).expect("it has equations");
    let mut random = Random(7);
    for configuration in &device.configurations {
        let free = &configuration.free;
        let context = Context { algebra: &algebra, device, free };
        let tree = Tree::new(&algebra, device, free).expect("it has equations");
        let mut programs =
            vec![kernel::derive(&algebra, Some(&lagrangian), device, free).expect("it has equations").program];
        programs.extend(Group::ALL.map(|group| kernel::recursion(&context, &tree, group)));
        if let Some(subset) = Subset::new(&context, &lagrangian, 40) {
            programs.extend([0, 1].map(|kept_sines| subset.program(&context, Group::Torque, kept_sines)));
        }
        let names = |groups: &[Group]| -> BTreeSet<String> { groups.iter().flat_map(|of| of.outputs(free)).collect() };
        for (at, program) in programs.iter().enumerate() {
            // First what was chosen for all groups, then the recursion group by group, then the collected subset.
            let expected = match at {
                0 => names(&Group::ALL),
                1..=3 => names(&Group::ALL[at - 1..at]),
                _ => names(&[Group::Torque]),
            };
            let found: BTreeSet<String> = program.outputs().iter().map(|(name, _)| name.clone()).collect();
            assert_eq!(found, expected, "{} {free:?}: outputs of form {at}", device.id);
            assert_eq!(program.outputs().len(), expected.len(), "an output stands twice");
        }
        let mut worst: f64 = 0.0;
        let mut agree = |name: &str, difference: f64| {
            // Not a number is no agreement.
            assert!(difference <= AGREEMENT, "{} {free:?}: {name} differs by {difference:e}", device.id);
            worst = worst.max(difference);
        };
        for _ in 0..n_samples {
            let sample = Sample::new(device, &algebra, free, &mut random);
            let expected = sample.by_the_plant(device);
            let defined = sample.by_definition(&algebra, &lagrangian, free);
            for (name, value) in &defined {
                agree(name, expected.difference(name, *value));
            }
            for program in &programs {
                for ((name, _), value) in program.outputs().iter().zip(sample.evaluate(program)) {
                    agree(name, expected.difference(name, value));
                }
            }
        }
        if told {
            println!("{} {free:?}: largest relative difference {worst:.1e}", device.id);
        }
    }
}

fn the_same_bytes_twice(device: &Device) {
    let once = dynid_equations::generate::<Exact>(device, &Options::default()).expect("it has equations");
    let twice = dynid_equations::generate::<Exact>(device, &Options::default()).expect("it has equations");
    assert!(once == twice, "{}: the same device gave other text the second time", device.id);
    for number in 1..=device.configurations.len() {
        let alone = dynid_equations::generate::<Exact>(device, &Options { configuration: Some(number) })
            .expect("it has equations");
        assert!(alone.iter().all(|(path, text)| once.get(path) == Some(text)), "{}: one alone differs", device.id);
    }
}

/// The thesis's Figure 4.2: how many inertial parameters appear first in each of the seven isolated configurations.
#[test]
fn figure_4_2_of_the_thesis() {
    let device = dynid_model::device("freedom6s").expect("it is shipped");
    let algebra = Algebra::new(device).expect("it has equations");
    let structure =
        Structure::new(&algebra, &Lagrangian::new(&algebra, device).expect("it has equations"), device.joints.len());
    let mut seen = BTreeSet::new();
    let mut new = Vec::new();
    for configuration in &device.configurations[..7] {
        let before = seen.len();
        seen.extend(structure.parameters_of(&configuration.free).into_iter().filter(|name| name.starts_with("link.")));
        new.push(seen.len() - before);
    }
    assert_eq!(new, [4, 4, 6, 13, 17, 16, 4], "new parameters per configuration");
    let never: Vec<&str> = (algebra.symbols().iter())
        .filter_map(|symbol| match symbol {
            Symbol::Parameter(name, _) if name.starts_with("link.") && !seen.contains(name.as_str()) => Some(&**name),
            _ => None,
        })
        .collect();
    assert_eq!(never, ["link.1.z", "link.1.Ixx", "link.1.Ixy", "link.1.Ixz", "link.1.Iyy", "link.1.Iyz"]);
}

/// Additions and multiplications of D and h after `prepare` is split off, besides sines and cosines.
#[test]
fn few_operations() {
    let device = dynid_model::device("freedom6s").expect("it is shipped");
    let algebra = Algebra::new(device).expect("it has equations");
    let lagrangian = Lagrangian::new(&algebra, device).expect("it has equations");
    for (free, most) in [(vec![0, 1, 2, 3, 4, 5], 760), (vec![0, 1], 40), (vec![4], 4)] {
        let at = device.configurations.iter().position(|known| known.free == free).expect("a configuration");
        let program = kernel::derive(&algebra, Some(&lagrangian), device, &device.configurations[at].free)
            .expect("it has equations")
            .program;
        let cost: usize = [Group::Inertia, Group::Bias]
            .map(|group| {
                let names = group.outputs(&free);
                let names: Vec<&str> = names.iter().map(String::as_str).collect();
                program.select_outputs(&names).split().eval.operations().arithmetic()
            })
            .iter()
            .sum();
        println!("freedom6s, free {free:?}: D and h cost {cost} operations, at most {most}");
        assert!(cost <= most, "joints {free:?}: D and h cost {cost} operations, more than {most}");
    }
}

/// Cosines of large multiples of a locked angle are polynomials with numbers of many digits.
#[test]
fn numbers_that_are_too_large_are_an_error_and_never_wrong() {
    let text = |n_rows: usize| {
        let rows: String = (1..=n_rows)
            .map(|row| {
                let parent = if row == 1 { "base".to_owned() } else { format!("a{}", row - 1) };
                format!("{{ name = \"a{row}\", parent = \"{parent}\", theta = \"8*q0\", d = \"0\", a = \"L1\", alpha = \"0\" }},\n")
            })
            .collect();
        format!(
            "title = \"two joints\"\nsource = \"made\"\n\
             [units]\nangle = \"rad\"\nlength = \"m\"\nmass = \"kg\"\ninertia = \"kg*m^2\"\ntime = \"s\"\ncommand = \"N*m\"\n\
             [base]\ngravity = 9.81\nup = [0, 1, 0]\n[lengths]\nL1 = 0.4\n\
             [kinematics]\nconvention = \"standard\"\nframes = [\n\
             {rows}\
             {{ name = \"b\", parent = \"a{n_rows}\", theta = \"q1\", d = \"0\", a = \"L1\", alpha = \"0\" }},\n]\n\
             {joint}{joint}[bounds]\nmass = 0.5\ncentroid = 0.3\ninertia = 0.5\n\
             [[link]]\ntitle = \"link\"\nframe = \"b\"\nm = 1.0\nx = 0.1\ny = 0.2\nz = 0.3\n\
             Ixx = 0.02\nIxy = 0.001\nIxz = 0.002\nIyy = 0.02\nIyz = 0.001\nIzz = 0.02\n\
             [identification]\nconfigurations = [[1]]\n\
             [[identification.method]]\nname = \"coupling\"\nsequence = [1]\n",
            joint = "[[joint]]\ntitle = \"joint\"\nposition = [-inf, inf]\nspeed = inf\ntorque = inf\n"
        )
    };
    let generated = |n_rows: usize| {
        let device = Device::parse(&text(n_rows), Path::new("two_joints.toml")).expect("a device");
        dynid_equations::generate::<Exact>(&device, &Options::default())
    };
    assert!(generated(1).is_ok());
    let error = generated(19).expect_err("a number of 45 digits");
    assert!(error.to_string().contains("free: a number in its equations is too large"), "{error}");
}

/// Between -1 and 1.
fn number(random: &mut Random) -> f64 {
    random.bits() as f64 / u64::MAX as f64 * 2.0 - 1.0
}

/// A state and a parameter set, drawn at random. Parameters need not be physical: the equations are polynomials.
struct Sample {
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    parameters: BTreeMap<String, f64>,
}

impl Sample {
    fn new(device: &Device, algebra: &Algebra, free: &[usize], random: &mut Random) -> Sample {
        let joints = 0..device.joints.len();
        let mut moving = |joint: usize| if free.contains(&joint) { 2.0 * number(random) } else { 0.0 };
        let dq = joints.clone().map(&mut moving).collect();
        let ddq = joints.clone().map(&mut moving).collect();
        let q = joints.map(|_| 3.0 * number(random)).collect();
        let parameters = (algebra.symbols().iter())
            .filter_map(|symbol| match symbol {
                Symbol::Parameter(name, _) => Some((name.clone(), number(random))),
                _ => None,
            })
            .collect();
        Sample { q, dq, ddq, parameters }
    }

    fn parameter(&self, name: &str) -> f64 {
        self.parameters.get(name).copied().unwrap_or(0.0)
    }

    fn evaluate(&self, program: &Program) -> Vec<f64> {
        program.evaluate(|input| match input {
            Input::Parameter(name) => self.parameter(name),
            Input::Locked(joint) | Input::Position(joint) => self.q[*joint],
            Input::Velocity(joint) => self.dq[*joint],
            Input::Acceleration(joint) => self.ddq[*joint],
            other => panic!("{other:?} is no input of the equations"),
        })
    }

    fn by_the_plant(&self, device: &Device) -> Expected {
        let parameter = |name: &str| self.parameter(name);
        Expected {
            n_joints: device.joints.len(),
            inertia: dynid_plant::inertia(device, &parameter, &self.q),
            bias: dynid_plant::bias(device, &parameter, &self.q, &self.dq),
            torque: dynid_plant::inverse_dynamics(device, &parameter, &self.q, &self.dq, &self.ddq),
        }
    }

    /// D and h of the free joints from Lagrange's equations as they are defined: Christoffel symbols and dV/dq.
    fn by_definition(&self, algebra: &Algebra, lagrangian: &Lagrangian, free: &[usize]) -> Vec<(String, f64)> {
        let values = algebra.values(&self.q, &|name| self.parameter(name));
        let mut defined = Vec::new();
        for (i, j) in pairs(free) {
            let entry = lagrangian.inertia_entry(algebra, i, j);
            defined.push((format!("D_{i}_{j}"), algebra.evaluate(&entry, &values)));
        }
        // All Christoffel symbols of many joints would take long: the derivatives of D are evaluated instead.
        let slope: BTreeMap<(usize, usize, usize), f64> = (free.iter())
            .flat_map(|&by| pairs(free).into_iter().map(move |(i, j)| (i, j, by)))
            .map(|(i, j, by)| {
                let slope = algebra.derivative(&lagrangian.inertia_entry(algebra, i, j), by);
                ((i, j, by), algebra.evaluate(&slope, &values))
            })
            .collect();
        let slope = |i: usize, j: usize, by: usize| slope[&(i.min(j), i.max(j), by)];
        for &k in free {
            let mut sum = algebra.evaluate(&lagrangian.gravity(algebra, k), &values);
            for &i in free {
                for &j in free {
                    let symbol = 0.5 * (slope(k, j, i) + slope(k, i, j) - slope(i, j, k));
                    sum += symbol * self.dq[i] * self.dq[j];
                }
            }
            defined.push((format!("h_{k}"), sum));
        }
        defined
    }
}

/// What the plant says.
struct Expected {
    n_joints: usize,
    inertia: Vec<f64>,
    bias: Vec<f64>,
    torque: Vec<f64>,
}

impl Expected {
    /// Of an output, relative to the largest of its kind.
    fn difference(&self, output: &str, value: f64) -> f64 {
        let mut words = output.split('_');
        let kind = words.next();
        let indices: Vec<usize> = words.filter_map(|index| index.parse().ok()).collect();
        let (all, at) = match (kind, indices.as_slice()) {
            (Some("D"), [i, j]) => (&self.inertia, i * self.n_joints + j),
            (Some("h"), [i]) => (&self.bias, *i),
            (Some("tau"), [i]) => (&self.torque, *i),
            _ => panic!("{output} is no output of the equations"),
        };
        let scale = all.iter().fold(1e-3, |most: f64, value| most.max(value.abs()));
        (value - all[at]).abs() / scale
    }
}

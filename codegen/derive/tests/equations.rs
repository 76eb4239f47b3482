//! The equations against other derivations. One process and one thread: Symbolica allows no more.

use dynid_derive::{
    algebra::Algebra,
    emit::Context,
    kernel::{self, Group},
    lagrangian::Lagrangian,
    session,
    tree::Tree,
};
use dynid_lower::{Input, Kir, Program};
use dynid_model::Device;

fn main() -> anyhow::Result<()> {
    let _session = session::start()?;
    for device in dynid_model::devices() {
        every_form_agrees_with_the_plant(device)?;
    }
    Ok(())
}

/// Numbers between -1 and 1 from a seed (splitmix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) as f64 / u64::MAX as f64 * 2.0 - 1.0
    }

    fn vector(&mut self, n: usize, scale: f64) -> Vec<f64> {
        (0..n).map(|_| scale * self.next()).collect()
    }
}

/// A state and a parameter set, drawn at random. Parameters need not be physical: the equations are polynomials.
struct Sample {
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    parameters: std::collections::BTreeMap<String, f64>,
}

impl Sample {
    fn new(device: &Device, algebra: &Algebra, free: &[usize], random: &mut Random) -> Sample {
        let n = device.joints.len();
        let only_free = |values: Vec<f64>| -> Vec<f64> {
            values
                .into_iter()
                .enumerate()
                .map(|(joint, value)| if free.contains(&joint) { value } else { 0.0 })
                .collect()
        };
        let parameters = algebra
            .symbols()
            .iter()
            .filter_map(|symbol| match symbol {
                dynid_derive::algebra::Symbol::Parameter(name, _) => Some((name.clone(), random.next())),
                _ => None,
            })
            .collect();
        Sample {
            q: random.vector(n, 3.0),
            dq: only_free(random.vector(n, 2.0)),
            ddq: only_free(random.vector(n, 2.0)),
            parameters,
        }
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
}

fn every_form_agrees_with_the_plant(device: &Device) -> anyhow::Result<()> {
    let algebra = Algebra::new(device)?;
    let lagrangian = Lagrangian::new(&algebra, device)?;
    let mut random = Random(7);
    let n = device.joints.len();
    for number in 1..=device.configurations.len() {
        let free = &device.configurations[number - 1].free;
        let kir: Kir = kernel::derive(&algebra, &lagrangian, device, number)?;
        let context = Context { algebra: &algebra, device, free };
        let tree = Tree::new(&algebra, device, free)?;
        let recursions = Group::ALL.map(|group| kernel::recursion(&context, &tree, group));
        let mut worst: f64 = 0.0;
        for _ in 0..20 {
            let sample = Sample::new(device, &algebra, free, &mut random);
            let parameter = |name: &str| sample.parameter(name);
            let inertia = dynid_plant::inertia(device, &parameter, &sample.q);
            let bias = dynid_plant::bias(device, &parameter, &sample.q, &sample.dq);
            let torque = dynid_plant::inverse_dynamics(device, &parameter, &sample.q, &sample.dq, &sample.ddq);
            for program in recursions.iter().chain([&kir.program]) {
                let values = sample.evaluate(program);
                let scale = |wanted: &[f64]| wanted.iter().fold(1e-3, |most: f64, value| most.max(value.abs()));
                for ((name, _), value) in program.outputs().iter().zip(values) {
                    let indices: Vec<usize> = name.split('_').skip(1).filter_map(|index| index.parse().ok()).collect();
                    let (wanted, scale) = match (name.split('_').next(), indices.as_slice()) {
                        (Some("D"), [i, j]) => (inertia[i * n + j], scale(&inertia)),
                        (Some("h"), [i]) => (bias[*i], scale(&bias)),
                        (Some("tau"), [i]) => (torque[*i], scale(&torque)),
                        _ => panic!("{name} is no output of the equations"),
                    };
                    let error = (value - wanted).abs() / scale;
                    worst = worst.max(error);
                    assert!(error <= 1e-12, "{} {number}: {name} = {value}, the plant says {wanted}", device.id);
                }
            }
        }
        println!("{} configuration {number}, free {free:?}: largest relative difference {worst:.1e}", device.id);
    }
    Ok(())
}

//! Random states and parameter sets, and both derivations at them. Also of the tests of `dynid-kernels`.

#![allow(dead_code)]

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use dynid_generated::Kernel;
use dynid_lower::{Input, Kir};
use dynid_model::Device;
use dynid_plant::Mechanism;
use dynid_plant::random::Noise;

/// Random states per kernel.
pub const STATES: usize = 1_000;

/// One kernel at one random state of one random, physically possible parameter set.
pub struct Case {
    pub kernel: &'static Kernel,
    number: usize,
    device: &'static Device,
    values: BTreeMap<String, f64>,
    /// Every joint's position.
    positions: Vec<f64>,
    pub parameters: Vec<f64>,
    pub locked: Vec<f64>,
    pub prepared: Vec<f64>,
    pub q: Vec<f64>,
    pub dq: Vec<f64>,
    pub ddq: Vec<f64>,
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Kernel { device, free, .. } = self.kernel;
        write!(f, "{device}, free {free:?}, case {}: q {:?}, dq {:?}", self.number, self.q, self.dq)
    }
}

/// As many cases as asked for, of a kernel that is compiled in.
pub fn cases(kernel: &'static Kernel, noise: Noise, count: usize) -> impl Iterator<Item = Case> {
    let device = dynid_model::device(kernel.device).expect("the kernels are those of the library's devices");
    cases_of(device, kernel, noise, count)
}

/// As many cases as asked for, of a kernel of any device.
pub fn cases_of(
    device: &'static Device,
    kernel: &'static Kernel,
    mut noise: Noise,
    count: usize,
) -> impl Iterator<Item = Case> {
    (0..count).map(move |number| {
        let values = random_parameters(device, &mut noise);
        let mut random = |size: f64| size * (2.0 * noise.uniform() - 1.0);
        let positions: Vec<f64> = device.joints.iter().map(|_| random(3.0)).collect();
        let free = |of: &mut dyn FnMut() -> f64| kernel.free.iter().map(|_| of()).collect::<Vec<f64>>();
        let (dq, ddq) = (free(&mut || random(3.0)), free(&mut || random(10.0)));
        Case::new(kernel, device, number, values, positions, dq, ddq)
    })
}

/// Lengths and gravity around those of the device, and for each link a body made of random points of mass.
fn random_parameters(device: &Device, noise: &mut Noise) -> BTreeMap<String, f64> {
    let mut values = BTreeMap::new();
    let mut random = |low: f64, high: f64| low + (high - low) * noise.uniform();
    for length in &device.lengths {
        values.insert(format!("length.{}", length.symbol), length.value * random(0.5, 1.5) + random(-0.1, 0.1));
    }
    for name in ["base.gx", "base.gy", "base.gz"] {
        values.insert(name.to_owned(), random(-10.0, 10.0));
    }
    for number in 1..=device.links.len() {
        let points: Vec<[f64; 4]> =
            (0..5).map(|_| [random(-0.3, 0.3), random(-0.3, 0.3), random(-0.3, 0.3), random(0.05, 1.0)]).collect();
        for (symbol, value) in dynid_model::Link::SYMBOLS.iter().zip(body(&points)) {
            values.insert(format!("link.{number}.{symbol}"), value);
        }
    }
    values
}

/// Mass, centroid and inertia about it of points `[x, y, z, mass]`.
fn body(points: &[[f64; 4]]) -> [f64; 10] {
    let mass: f64 = points.iter().map(|point| point[3]).sum();
    let centroid = [0, 1, 2].map(|axis| points.iter().map(|point| point[3] * point[axis]).sum::<f64>() / mass);
    let second = |a: usize, b: usize| -> f64 {
        points.iter().map(|point| point[3] * (point[a] - centroid[a]) * (point[b] - centroid[b])).sum()
    };
    let [xx, yy, zz] = [second(0, 0), second(1, 1), second(2, 2)];
    let [x, y, z] = centroid;
    [mass, x, y, z, yy + zz, -second(0, 1), -second(0, 2), xx + zz, -second(1, 2), xx + yy]
}

impl Case {
    fn new(
        kernel: &'static Kernel,
        device: &'static Device,
        number: usize,
        values: BTreeMap<String, f64>,
        positions: Vec<f64>,
        dq: Vec<f64>,
        ddq: Vec<f64>,
    ) -> Case {
        let parameters: Vec<f64> = kernel.parameters.iter().map(|name| values[*name]).collect();
        let locked: Vec<f64> = kernel.locked.iter().map(|&joint| positions[joint]).collect();
        let q = kernel.free.iter().map(|&joint| positions[joint]).collect();
        let mut prepared = vec![f64::NAN; kernel.prepared.len()];
        kernel.functions.prepare(&parameters, &locked, &mut prepared);
        Case { kernel, number, device, values, positions, parameters, locked, prepared, q, dq, ddq }
    }

    /// The same state in another configuration of the device; joints that this one locks stand still.
    pub fn in_kernel(&self, kernel: &'static Kernel) -> Case {
        let (dq, ddq) = (self.of_all_joints(&self.dq), self.of_all_joints(&self.ddq));
        let pick = |all: &[f64]| kernel.free.iter().map(|&joint| all[joint]).collect();
        Case::new(kernel, self.device, self.number, self.values.clone(), self.positions.clone(), pick(&dq), pick(&ddq))
    }

    fn with_state(&self, q: &[f64], dq: &[f64]) -> Case {
        let mut positions = self.positions.clone();
        for (&joint, &position) in self.kernel.free.iter().zip(q) {
            positions[joint] = position;
        }
        Case::new(self.kernel, self.device, self.number, self.values.clone(), positions, dq.to_vec(), self.ddq.clone())
    }

    pub fn shifted_q(&self, place: usize, by: f64) -> Case {
        let mut q = self.q.clone();
        q[place] += by;
        self.with_state(&q, &self.dq)
    }

    pub fn shifted_dq(&self, place: usize, by: f64) -> Case {
        let mut dq = self.dq.clone();
        dq[place] += by;
        self.with_state(&self.q, &dq)
    }

    /// What `prepare` makes when one parameter is moved.
    pub fn prepared_with(&self, column: usize, by: f64) -> Vec<f64> {
        let mut parameters = self.parameters.clone();
        parameters[column] += by;
        let mut prepared = vec![f64::NAN; self.kernel.prepared.len()];
        self.kernel.functions.prepare(&parameters, &self.locked, &mut prepared);
        prepared
    }

    // --- the kernels ------------------------------------------------------------------------------------------

    fn vector(&self) -> Vec<f64> {
        vec![f64::NAN; self.q.len()]
    }

    fn matrix(&self) -> Vec<f64> {
        vec![f64::NAN; self.q.len() * self.q.len()]
    }

    pub fn inertia(&self) -> Vec<f64> {
        let mut d = self.matrix();
        self.kernel.functions.inertia(&self.prepared, &self.q, &mut d);
        d
    }

    pub fn coriolis(&self) -> Vec<f64> {
        let mut c = self.matrix();
        self.kernel.functions.coriolis(&self.prepared, &self.q, &self.dq, &mut c);
        c
    }

    pub fn gravity(&self) -> Vec<f64> {
        let mut phi = self.vector();
        self.kernel.functions.gravity(&self.prepared, &self.q, &mut phi);
        phi
    }

    pub fn bias(&self) -> Vec<f64> {
        let mut h = self.vector();
        self.kernel.functions.bias(&self.prepared, &self.q, &self.dq, &mut h);
        h
    }

    pub fn inertia_and_bias(&self) -> (Vec<f64>, Vec<f64>) {
        let (mut d, mut h) = (self.matrix(), self.vector());
        self.kernel.functions.inertia_and_bias(&self.prepared, &self.q, &self.dq, &mut d, &mut h);
        (d, h)
    }

    pub fn inverse_dynamics(&self, ddq: &[f64]) -> Vec<f64> {
        let mut tau = self.vector();
        self.kernel.functions.inverse_dynamics(&self.prepared, &self.q, &self.dq, ddq, &mut tau);
        tau
    }

    pub fn forward_dynamics(&self, tau: &[f64]) -> Vec<f64> {
        let mut ddq = self.vector();
        self.kernel.functions.forward_dynamics(&self.prepared, &self.q, &self.dq, tau, &mut ddq);
        ddq
    }

    pub fn regressor(&self) -> Vec<f64> {
        let mut y = vec![f64::NAN; self.q.len() * self.kernel.n_lumps];
        self.kernel.functions.regressor(&self.prepared, &self.q, &self.dq, &self.ddq, &mut y);
        y
    }

    pub fn inverse_dynamics_gradient(&self) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let (mut tau, mut by_q, mut by_dq) = (self.vector(), self.matrix(), self.matrix());
        let functions = self.kernel.functions;
        functions.inverse_dynamics_gradient(
            &self.prepared,
            &self.q,
            &self.dq,
            &self.ddq,
            &mut tau,
            &mut by_q,
            &mut by_dq,
        );
        (tau, by_q, by_dq)
    }

    // --- the plant --------------------------------------------------------------------------------------------

    fn plant(&self) -> Mechanism {
        Mechanism::new(self.device, &|name| self.values[name])
    }

    fn of_all_joints(&self, of_free: &[f64]) -> Vec<f64> {
        let mut all = vec![0.0; self.positions.len()];
        for (&joint, &value) in self.kernel.free.iter().zip(of_free) {
            all[joint] = value;
        }
        all
    }

    fn of_free_joints(&self, all: &[f64]) -> Vec<f64> {
        self.kernel.free.iter().map(|&joint| all[joint]).collect()
    }

    pub fn plant_inertia_and_bias(&self) -> (Vec<f64>, Vec<f64>) {
        self.plant().inertia_and_bias(self.kernel.free, &self.positions, &self.dq)
    }

    /// `dD/dt` by a central difference along `dq`.
    pub fn plant_rate_of_inertia(&self) -> Vec<f64> {
        let along = self.of_all_joints(&self.dq);
        let step = 1e-5 / along.iter().map(|dq| dq.abs()).sum::<f64>();
        let inertia = |by: f64| {
            let moved: Vec<f64> = self.positions.iter().zip(&along).map(|(q, dq)| q + by * dq).collect();
            self.plant().inertia_and_bias(self.kernel.free, &moved, &self.dq).0
        };
        let difference = |(above, below): (f64, f64)| (above - below) / (2.0 * step);
        inertia(step).into_iter().zip(inertia(-step)).map(difference).collect()
    }

    pub fn plant_gravity(&self) -> Vec<f64> {
        self.of_free_joints(&self.plant().gravity(&self.positions))
    }

    pub fn plant_inverse_dynamics(&self) -> Vec<f64> {
        let (dq, ddq) = (self.of_all_joints(&self.dq), self.of_all_joints(&self.ddq));
        self.of_free_joints(&self.plant().inverse_dynamics(&self.positions, &dq, &ddq))
    }

    /// The same when one parameter is moved.
    pub fn plant_inverse_dynamics_with(&self, parameter: &str, by: f64) -> Vec<f64> {
        let value = |name: &str| self.values[name] + if name == parameter { by } else { 0.0 };
        let (dq, ddq) = (self.of_all_joints(&self.dq), self.of_all_joints(&self.ddq));
        self.of_free_joints(&Mechanism::new(self.device, &value).inverse_dynamics(&self.positions, &dq, &ddq))
    }

    pub fn plant_coriolis(&self) -> Vec<f64> {
        let (n, free) = (self.positions.len(), self.kernel.free);
        let c = self.plant().coriolis(&self.positions, &self.of_all_joints(&self.dq));
        free.iter().flat_map(|i| free.iter().map(|j| c[i * n + j]).collect::<Vec<_>>()).collect()
    }

    // --- sizes ------------------------------------------------------------------------------------------------
    //
    // A torque may cancel to nothing, so an error is relative to the size that a torque of its kind can have at this
    // posture. With the partial velocities `v_i` of all points of mass, `D_ij = sum m v_i . v_j`; by Cauchy-Schwarz
    // `|phi_i| = |sum m g . v_i| <= g sqrt(M D_ii)` and `|D_ij| <= sqrt(D_ii D_jj)`.

    /// `sqrt(D_ii)` of the free joints.
    fn reach(&self) -> Vec<f64> {
        let (d, _) = self.plant_inertia_and_bias();
        let n = self.q.len();
        (0..n).map(|joint| d[joint * n + joint].sqrt()).collect()
    }

    pub fn gravity_size(&self) -> Vec<f64> {
        let axes = ["base.gx", "base.gy", "base.gz"].into_iter().zip(self.device.up);
        let felt = axes.filter(|(_, up)| *up != 0.0).map(|(name, _)| self.values[name].powi(2));
        let g = felt.sum::<f64>().sqrt();
        let mass: f64 = (1..=self.device.links.len()).map(|number| self.values[&format!("link.{number}.m")]).sum();
        self.reach().iter().map(|reach| g * mass.sqrt() * reach).collect()
    }

    /// n x n, as C: `C_ij = sum_k c_ijk dq_k`.
    pub fn coriolis_size(&self) -> Vec<f64> {
        let (reach, speed) = (self.reach(), self.dq.iter().map(|dq| dq.abs()).sum::<f64>());
        reach.iter().flat_map(|i| reach.iter().map(move |j| i * j * speed)).collect()
    }

    pub fn bias_size(&self) -> Vec<f64> {
        let coriolis = self.coriolis_size();
        let speeds: Vec<f64> = self.dq.iter().map(|dq| dq.abs()).collect();
        let moving = coriolis.chunks(self.q.len()).map(|row| dot(row, &speeds));
        moving.zip(self.gravity_size()).map(|(moving, gravity)| moving + gravity).collect()
    }

    pub fn torque_size(&self) -> Vec<f64> {
        let reach = self.reach();
        let pull: f64 = reach.iter().zip(&self.ddq).map(|(reach, ddq)| reach * ddq.abs()).sum();
        reach.iter().zip(self.bias_size()).map(|(reach, bias)| bias + reach * pull).collect()
    }

    /// Total energy, and the size of its two parts [J].
    pub fn energy(&self) -> (f64, f64) {
        let [kinetic, potential] = self.plant().energy(&self.positions, &self.of_all_joints(&self.dq));
        (kinetic + potential, kinetic.abs() + potential.abs())
    }

    /// The state after moving freely for `span_s`, by a Runge-Kutta method of fourth order.
    pub fn swung_freely(&self, span_s: f64, steps: usize) -> Case {
        let n = self.q.len();
        let step = span_s / steps as f64;
        let rest = vec![0.0; n];
        let mut state: Vec<f64> = self.q.iter().chain(&self.dq).copied().collect();
        let rate = |state: &[f64]| -> Vec<f64> {
            let (q, dq) = state.split_at(n);
            let mut ddq = vec![f64::NAN; n];
            self.kernel.functions.forward_dynamics(&self.prepared, q, dq, &rest, &mut ddq);
            dq.iter().chain(&ddq).copied().collect()
        };
        let moved = |state: &[f64], rate: &[f64], by: f64| -> Vec<f64> {
            state.iter().zip(rate).map(|(value, rate)| value + by * rate).collect()
        };
        for _ in 0..steps {
            let first = rate(&state);
            let second = rate(&moved(&state, &first, 0.5 * step));
            let third = rate(&moved(&state, &second, 0.5 * step));
            let fourth = rate(&moved(&state, &third, step));
            for place in 0..2 * n {
                let slope = first[place] + 2.0 * (second[place] + third[place]) + fourth[place];
                state[place] += step / 6.0 * slope;
            }
        }
        let (q, dq) = state.split_at(n);
        self.with_state(q, dq)
    }
}

/// The checked-in equations of a kernel.
pub fn equations(kernel: &Kernel) -> Kir {
    let name = format!("{}/c{:02}.kir", kernel.device, kernel.configuration.unwrap_or_default());
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(name);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    Kir::parse(&text, &path).unwrap_or_else(|error| panic!("{error}"))
}

/// What an input of the equations is in a case.
pub fn input_value(case: &Case, input: &Input) -> f64 {
    let of_free = |values: &[f64], joint: usize| {
        values[case.kernel.free.iter().position(|&free| free == joint).expect("only free joints move")]
    };
    match input {
        Input::Parameter(name) => case.values[name],
        Input::Locked(joint) | Input::Position(joint) => case.positions[*joint],
        Input::Velocity(joint) => of_free(&case.dq, *joint),
        Input::Acceleration(joint) => of_free(&case.ddq, *joint),
        other => panic!("{other:?} is no input of a .kir"),
    }
}

pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// What a vector may differ by, relative to its largest entry. A single entry may cancel to nothing, where several
/// hardly all do at once.
const OF_LARGEST: f64 = 1e-12;

/// Entry by entry, relative to the size that each could have; and all relative to the largest.
pub fn assert_vector(computed: &[f64], expected: &[f64], size: &[f64], tolerance: f64, what: impl Fn() -> String) {
    assert_eq!((computed.len(), size.len()), (expected.len(), expected.len()), "{}", what());
    if expected.len() > 1 {
        let largest_of = |of: &[f64]| of.iter().fold(0.0f64, |largest, entry| largest.max(entry.abs()));
        let largest = largest_of(expected);
        let agree = computed
            .iter()
            .zip(expected)
            .all(|(computed, expected)| (computed - expected).abs() <= OF_LARGEST * largest);
        // Where nothing acts at all, there is rounding alone.
        let is_rounding = largest <= tolerance * largest_of(size);
        assert!(agree || is_rounding, "{}: {computed:?}, not {expected:?}", what());
    }
    for (place, ((computed, expected), size)) in computed.iter().zip(expected).zip(size).enumerate() {
        let error = (computed - expected).abs();
        assert!(error <= tolerance * size, "entry {place} of {}: {computed:e}, not {expected:e}", what());
    }
}

/// Entry by entry, relative to `sqrt(size_ii size_jj)`: small joints count as much as large ones.
pub fn assert_matrix(computed: &[f64], expected: &[f64], size: &[f64], tolerance: f64, what: impl Fn() -> String) {
    assert_eq!(computed.len(), expected.len(), "{}", what());
    let n = (computed.len() as f64).sqrt() as usize;
    for row in 0..n {
        for column in 0..n {
            let (computed, expected) = (computed[row * n + column], expected[row * n + column]);
            let size = (size[row * n + row] * size[column * n + column]).sqrt();
            let error = (computed - expected).abs();
            assert!(error <= tolerance * size, "({row}, {column}) of {}: {computed:e}, not {expected:e}", what());
        }
    }
}

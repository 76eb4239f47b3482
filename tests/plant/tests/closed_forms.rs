//! The plant against textbook equations, against Lagrange's equation and against energy.

use std::collections::BTreeMap;

use dynid_model::device::{Configuration, Convention, Device, Frame, Joint, JointKind, Link};
use dynid_model::expression::BinaryOperator;
use dynid_model::{Expression, Parameter};
use dynid_plant::Mechanism;

fn number(value: f64) -> Expression {
    Expression::Number(value)
}

fn symbol(name: &str) -> Expression {
    Expression::Symbol(name.to_owned())
}

fn minus(expression: Expression) -> Expression {
    Expression::Negate(Box::new(expression))
}

fn sum(left: Expression, right: Expression) -> Expression {
    Expression::Binary(BinaryOperator::Add, Box::new(left), Box::new(right))
}

fn frame(parent: Option<usize>, row: [Expression; 4]) -> Frame {
    let [theta, d, a, alpha] = row;
    Frame { name: String::new(), parent, theta, d, a, alpha }
}

/// A device of `kinds.len()` joints whose links are fixed to the given frames.
fn device(convention: Convention, kinds: &[JointKind], frames: Vec<Frame>, links: &[usize], up: [f64; 3]) -> Device {
    let zero = Parameter { value: 0.0, lower: 0.0, upper: 0.0, fixed: false };
    Device {
        id: "test".to_owned(),
        file: None,
        title: String::new(),
        source: String::new(),
        convention,
        gravity: 9.80665,
        up,
        lengths: Vec::new(),
        joints: kinds
            .iter()
            .map(|&kind| Joint {
                kind,
                title: String::new(),
                position_limits: [-1.0, 1.0],
                speed_limit: f64::INFINITY,
                torque_limit: f64::INFINITY,
                command_unit: "N*m".to_owned(),
            })
            .collect(),
        frames,
        links: links.iter().map(|&frame| Link { frame, title: String::new(), inertial: [zero; 10] }).collect(),
        configurations: vec![Configuration { free: (0..kinds.len()).collect() }],
        methods: Vec::new(),
        end_point: None,
        effects: Vec::new(),
    }
}

fn mechanism(device: &Device, values: &[(&str, f64)]) -> Mechanism {
    let values: BTreeMap<&str, f64> = values.iter().copied().collect();
    let value = |name: &str| match name.strip_prefix("base.g") {
        Some("x") => device.gravity * device.up[0],
        Some("y") => device.gravity * device.up[1],
        Some(_) => device.gravity * device.up[2],
        None => values.get(name).copied().unwrap_or(0.0),
    };
    Mechanism::new(device, &value)
}

fn assert_close(got: &[f64], want: &[f64], tolerance: f64) {
    assert_eq!(got.len(), want.len());
    let scale = want.iter().fold(1.0, |scale: f64, value| scale.max(value.abs()));
    for (got, want) in got.iter().zip(want) {
        assert!((got - want).abs() <= tolerance * scale, "{got} is not {want}");
    }
}

const REVOLUTE: JointKind = JointKind::Revolute;
const PRISMATIC: JointKind = JointKind::Prismatic;

#[test]
fn pendulum() {
    let frames = vec![frame(None, [symbol("q0"), number(0.0), number(0.0), number(0.0)])];
    let device = device(Convention::Standard, &[REVOLUTE], frames, &[0], [0.0, 1.0, 0.0]);
    let (m, c, i) = (0.7, 0.31, 0.02);
    let pendulum = mechanism(&device, &[("link.1.m", m), ("link.1.x", c), ("link.1.Izz", i)]);
    let (q, dq, ddq) = (0.4_f64, 1.7, -2.1);
    let tau = (i + m * c * c) * ddq + m * 9.80665 * c * q.cos();
    assert_close(&pendulum.inverse_dynamics(&[q], &[dq], &[ddq]), &[tau], 1e-14);
}

/// Craig, Introduction to Robotics, section 6.7, with inertia about the centroids.
#[test]
fn two_link_arm_in_both_conventions() {
    let (l1, m1, c1, i1) = (0.4, 1.3, 0.22, 0.013);
    let (m2, c2, i2) = (0.8, 0.15, 0.007);
    let (q, dq, ddq) = ([0.3_f64, -0.9], [1.1, -0.4], [0.6, 2.3]);
    let (cos, sin) = (q[1].cos(), q[1].sin());
    let coupling = m2 * l1 * c2;
    let d = [
        i1 + i2 + m1 * c1 * c1 + m2 * (l1 * l1 + c2 * c2) + 2.0 * coupling * cos,
        i2 + m2 * c2 * c2 + coupling * cos,
        i2 + m2 * c2 * c2 + coupling * cos,
        i2 + m2 * c2 * c2,
    ];
    let c = [-coupling * sin * dq[1], -coupling * sin * (dq[0] + dq[1]), coupling * sin * dq[0], 0.0];
    let g = 9.80665;
    let phi =
        [(m1 * c1 + m2 * l1) * g * q[0].cos() + m2 * c2 * g * (q[0] + q[1]).cos(), m2 * c2 * g * (q[0] + q[1]).cos()];
    let tau: Vec<f64> =
        (0..2).map(|i| (0..2).map(|j| d[2 * i + j] * ddq[j] + c[2 * i + j] * dq[j]).sum::<f64>() + phi[i]).collect();

    let zero = || number(0.0);
    // standard: frame k sits at the far end of link k, so centroids are counted from there
    let standard = device(
        Convention::Standard,
        &[REVOLUTE, REVOLUTE],
        vec![
            frame(None, [symbol("q0"), zero(), number(l1), zero()]),
            frame(Some(0), [symbol("q1"), zero(), number(0.3), zero()]),
        ],
        &[0, 1],
        [0.0, 1.0, 0.0],
    );
    let modified = device(
        Convention::Modified,
        &[REVOLUTE, REVOLUTE],
        vec![
            frame(None, [symbol("q0"), zero(), zero(), zero()]),
            frame(Some(0), [symbol("q1"), zero(), number(l1), zero()]),
        ],
        &[0, 1],
        [0.0, 1.0, 0.0],
    );
    for (device, x1, x2) in [(&standard, c1 - l1, c2 - 0.3), (&modified, c1, c2)] {
        let values = [
            ("link.1.m", m1),
            ("link.1.x", x1),
            ("link.1.Izz", i1),
            ("link.2.m", m2),
            ("link.2.x", x2),
            ("link.2.Izz", i2),
        ];
        let arm = mechanism(device, &values);
        assert_close(&arm.inertia(&q), &d, 1e-14);
        assert_close(&arm.coriolis(&q, &dq), &c, 1e-14);
        assert_close(&arm.gravity(&q), &phi, 1e-14);
        assert_close(&arm.inverse_dynamics(&q, &dq, &ddq), &tau, 1e-14);
    }
}

/// A bar that turns back by what its carrier turned (a parallelogram) never turns: its inertia does not matter.
#[test]
fn parallelogram_bar_keeps_its_orientation() {
    let back = sum(minus(symbol("q0")), number(-std::f64::consts::FRAC_PI_2));
    let frames = vec![
        frame(None, [symbol("q0"), number(0.0), number(0.5), number(0.0)]),
        frame(Some(0), [back, number(0.0), number(0.2), number(0.0)]),
    ];
    let device = device(Convention::Standard, &[REVOLUTE], frames, &[1], [0.0, 1.0, 0.0]);
    let bar = mechanism(&device, &[("link.1.m", 2.0), ("link.1.x", 0.1), ("link.1.Izz", 123.0)]);
    let q = 0.8_f64;
    let tau = 2.0 * 0.25 * 3.0 + 2.0 * 9.80665 * 0.5 * q.cos();
    assert_close(&bar.inverse_dynamics(&[q], &[1.5], &[3.0]), &[tau], 1e-14);
}

/// Polar arm: a point mass on a slide that turns. `m (r w' + 2 r' w) r` and `m (r'' - r w^2)`, without gravity.
#[test]
fn prismatic_joint_on_a_revolute_one() {
    let turn = number(std::f64::consts::FRAC_PI_2);
    let frames = vec![
        // alpha turns z into the plane of motion, so that the slide runs across the axis of rotation
        frame(None, [symbol("q0"), number(0.0), number(0.0), turn]),
        frame(Some(0), [number(0.0), symbol("q1"), number(0.0), number(0.0)]),
    ];
    let device = device(Convention::Standard, &[REVOLUTE, PRISMATIC], frames, &[1], [0.0, 0.0, 1.0]);
    let arm = mechanism(&device, &[("link.1.m", 1.4)]);
    let (r, w, dr, dw, ddr) = (0.6, 1.2, -0.7, 2.0, 0.9);
    let tau = [1.4 * (r * r * dw + 2.0 * r * dr * w), 1.4 * (ddr - r * w * w)];
    assert_close(&arm.inverse_dynamics(&[0.3, r], &[w, dr], &[dw, ddr]), &tau, 1e-14);
}

/// A branching spatial tree with a shared joint, a slide and a tilted base.
fn tree(convention: Convention) -> (Device, Mechanism) {
    let half = std::f64::consts::FRAC_PI_2;
    let norm = (0.2_f64 * 0.2 + 0.3 * 0.3 + 0.9 * 0.9).sqrt();
    let frames = vec![
        frame(None, [symbol("q0"), number(0.1), number(0.05), number(half)]),
        frame(Some(0), [symbol("q1"), number(0.2), number(0.3), number(-half)]),
        frame(Some(1), [sum(symbol("q2"), number(0.3)), number(0.0), number(0.2), number(0.4)]),
        frame(Some(0), [symbol("q1"), number(0.0), number(0.1), number(0.7)]),
        frame(Some(3), [sum(minus(symbol("q2")), minus(symbol("q1"))), number(0.1), number(0.1), number(0.0)]),
        frame(Some(2), [number(0.2), sum(symbol("q3"), number(0.1)), number(0.0), number(-0.5)]),
    ];
    let kinds = [REVOLUTE, REVOLUTE, REVOLUTE, PRISMATIC];
    let device = device(convention, &kinds, frames, &[0, 1, 2, 4, 5], [0.2 / norm, -0.3 / norm, 0.9 / norm]);
    let values: Vec<(String, f64)> = (1..=5)
        .flat_map(|link| {
            let k = link as f64;
            [
                ("m", 0.3 + 0.1 * k),
                ("x", 0.02 * k),
                ("y", 0.05 - 0.01 * k),
                ("z", 0.03 * (k - 2.5)),
                ("Ixx", 0.004 + 0.001 * k),
                ("Ixy", 0.0004 * (k - 3.0)),
                ("Ixz", -0.0002 * k),
                ("Iyy", 0.005 + 0.0007 * k),
                ("Iyz", 0.0003 * (2.0 - k)),
                ("Izz", 0.006),
            ]
            .map(|(symbol, value)| (format!("link.{link}.{symbol}"), value))
        })
        .collect();
    let borrowed: Vec<(&str, f64)> = values.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    let mechanism = mechanism(&device, &borrowed);
    (device, mechanism)
}

const Q: [f64; 4] = [0.3, -0.7, 1.1, 0.12];
const DQ: [f64; 4] = [0.9, -1.3, 0.7, 0.4];
const DDQ: [f64; 4] = [-0.6, 1.9, 2.2, -1.0];

fn shifted(values: [f64; 4], index: usize, step: f64) -> [f64; 4] {
    let mut shifted = values;
    shifted[index] += step;
    shifted
}

/// `tau_k = d/dt dL/d(dq_k) - dL/dq_k` with every derivative a central difference of the energies.
#[test]
fn obeys_lagranges_equation() {
    let h = 1e-4;
    for convention in [Convention::Standard, Convention::Modified] {
        let (_, tree) = tree(convention);
        let lagrangian = |q: [f64; 4], dq: [f64; 4]| {
            let [kinetic, potential] = tree.energy(&q, &dq);
            kinetic - potential
        };
        let momentum = |k: usize, q: [f64; 4], dq: [f64; 4]| {
            (lagrangian(q, shifted(dq, k, h)) - lagrangian(q, shifted(dq, k, -h))) / (2.0 * h)
        };
        let along = |t: f64| {
            let q: [f64; 4] = std::array::from_fn(|k| Q[k] + DQ[k] * t + 0.5 * DDQ[k] * t * t);
            let dq: [f64; 4] = std::array::from_fn(|k| DQ[k] + DDQ[k] * t);
            (q, dq)
        };
        let tau: Vec<f64> = (0..4)
            .map(|k| {
                let ((q_after, dq_after), (q_before, dq_before)) = (along(h), along(-h));
                let rate = (momentum(k, q_after, dq_after) - momentum(k, q_before, dq_before)) / (2.0 * h);
                rate - (lagrangian(shifted(Q, k, h), DQ) - lagrangian(shifted(Q, k, -h), DQ)) / (2.0 * h)
            })
            .collect();
        assert_close(&tree.inverse_dynamics(&Q, &DQ, &DDQ), &tau, 1e-6);
    }
}

#[test]
fn pieces_add_up_to_the_torque() {
    for convention in [Convention::Standard, Convention::Modified] {
        let (_, tree) = tree(convention);
        let (d, c, phi) = (tree.inertia(&Q), tree.coriolis(&Q, &DQ), tree.gravity(&Q));
        let tau: Vec<f64> = (0..4)
            .map(|i| (0..4).map(|j| d[4 * i + j] * DDQ[j] + c[4 * i + j] * DQ[j]).sum::<f64>() + phi[i])
            .collect();
        assert_close(&tree.inverse_dynamics(&Q, &DQ, &DDQ), &tau, 1e-14);
        let kinetic: f64 = 0.5 * (0..16).map(|entry| DQ[entry / 4] * d[entry] * DQ[entry % 4]).sum::<f64>();
        assert_close(&[kinetic], &[tree.energy(&Q, &DQ)[0]], 1e-14);
    }
}

/// `dD/dt - 2C` is skew-symmetric, which holds for the Christoffel `C` alone among all that give the same `C dq`.
#[test]
fn christoffel_matrix_passes_the_skew_test() {
    let (_, tree) = tree(Convention::Standard);
    let h = 1e-5;
    let moved = |t: f64| -> Vec<f64> { (0..4).map(|k| Q[k] + DQ[k] * t).collect() };
    let (after, before) = (tree.inertia(&moved(h)), tree.inertia(&moved(-h)));
    let c = tree.coriolis(&Q, &DQ);
    for i in 0..4 {
        for j in 0..4 {
            let rate = (after[4 * i + j] - before[4 * i + j]) / (2.0 * h);
            assert!((rate - c[4 * i + j] - c[4 * j + i]).abs() < 1e-8, "entry {i}, {j}");
        }
    }
}

/// With every other joint still, a part of the joints obeys the rows and columns of the whole.
#[test]
fn locked_joints_leave_a_part_of_the_equations() {
    for convention in [Convention::Standard, Convention::Modified] {
        let (_, tree) = tree(convention);
        let whole = tree.inertia(&Q);
        let (d, h) = tree.inertia_and_bias(&[1, 3], &Q, &[0.8, -0.5]);
        assert_close(&d, &[whole[5], whole[7], whole[13], whole[15]], 1e-14);
        let bias = tree.bias(&Q, &[0.0, 0.8, 0.0, -0.5]);
        assert_close(&h, &[bias[1], bias[3]], 1e-14);
        let held = tree.holding(&[1, 3], &Q).inertia_and_bias(&[1, 3], &Q, &[0.8, -0.5]);
        assert_close(&held.0, &d, 1e-14);
        assert_close(&held.1, &h, 1e-14);
        let held = tree.holding(&[3], &Q).inertia_and_bias(&[3], &Q, &[-0.5]);
        assert_close(&held.0, &[whole[15]], 1e-14);
        assert_close(&held.1, &[tree.bias(&Q, &[0.0, 0.0, 0.0, -0.5])[3]], 1e-14);
        let (d, h) = tree.inertia_and_bias(&[0, 1, 2, 3], &Q, &DQ);
        assert_close(&d, &whole, 1e-14);
        assert_close(&h, &tree.bias(&Q, &DQ), 1e-14);
    }
}

/// Left to itself the tree keeps its energy.
#[test]
fn keeps_energy() {
    let (_, tree) = tree(Convention::Standard);
    let rates = |state: &[f64]| -> Vec<f64> {
        let (d, h) = tree.inertia_and_bias(&[0, 1, 2, 3], &state[..4], &state[4..]);
        let force = nalgebra::DVector::from_iterator(4, h.iter().map(|h| -h));
        let acceleration = nalgebra::DMatrix::from_row_slice(4, 4, &d).cholesky().expect("D is positive").solve(&force);
        state[4..].iter().copied().chain(acceleration.iter().copied()).collect()
    };
    let mut state: Vec<f64> = Q.iter().chain(&DQ).copied().collect();
    let total = |state: &[f64]| tree.energy(&state[..4], &state[4..]).iter().sum::<f64>();
    let start = total(&state);
    let step = 1e-3;
    for _ in 0..200 {
        let ahead = |slope: &[f64], part: f64| -> Vec<f64> {
            state.iter().zip(slope).map(|(x, k)| x + part * step * k).collect()
        };
        let k1 = rates(&state);
        let k2 = rates(&ahead(&k1, 0.5));
        let k3 = rates(&ahead(&k2, 0.5));
        let k4 = rates(&ahead(&k3, 1.0));
        for (index, x) in state.iter_mut().enumerate() {
            *x += step / 6.0 * (k1[index] + 2.0 * (k2[index] + k3[index]) + k4[index]);
        }
    }
    assert!((total(&state) - start).abs() < 1e-10 * start.abs().max(1.0), "{} is not {start}", total(&state));
}

/// A played log of a damped oscillator, row by row, against `e^(-a t) (cos wt + a/w sin wt)`.
#[test]
fn played_log_follows_the_closed_form() {
    use dynid_plant::effects::EffectEntry;
    use dynid_plant::recipe::{Recipe, RunEntry, make};

    let frames = vec![frame(None, [symbol("q0"), number(0.0), number(0.0), number(0.0)])];
    let device = device(Convention::Standard, &[REVOLUTE], frames, &[0], [0.0, 0.0, 1.0]);
    let effect = |id: &str, values: &[(&str, f64)]| EffectEntry {
        id: id.to_owned(),
        joint: 0,
        from: None,
        values: values.iter().map(|&(name, value)| (name.to_owned(), value)).collect(),
    };
    let (inertia, rotor, stiffness, damping, rest, start) = (0.02, 0.01, 0.9, 0.03, 0.1, 0.6);
    let recipe = Recipe {
        device: "test".to_owned(),
        seed: 1,
        sample_s: 0.01,
        steps_per_sample: 20,
        noise_rms: 0.0,
        quantum: 0.0,
        start: vec![start],
        parameters: [("link.1.m".to_owned(), 1.0), ("link.1.Izz".to_owned(), inertia)].into(),
        effects: vec![
            effect("spring", &[("Ks", stiffness), ("qeq", rest)]),
            effect("viscous", &[("Fv", damping)]),
            effect("rotor_inertia", &[("Ia", rotor)]),
        ],
        runs: vec![RunEntry {
            file: "swing.csv".to_owned(),
            free: vec![0],
            role: "fit".to_owned(),
            duration_s: 2.0,
            ..RunEntry::default()
        }],
        ..Recipe::default()
    };
    let files = make(&recipe, &device).unwrap();
    assert!(files["experiment.toml"].contains("file = \"swing.csv\"\nfree = [0]\nrole = \"fit\""));
    let log = &files["swing.csv"];
    assert_eq!(log.lines().next(), Some("t,tau0,q0"));
    assert_eq!(log.lines().count(), 202);
    let total = inertia + rotor;
    let decay = damping / (2.0 * total);
    let frequency = (stiffness / total - decay * decay).sqrt();
    for line in log.lines().skip(1) {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        let (t, q) = (cells[0], cells[2]);
        let swing = (frequency * t).cos() + decay / frequency * (frequency * t).sin();
        let want = rest + (start - rest) * (-decay * t).exp() * swing;
        assert!((q - want).abs() < 2e-9, "t = {t}: {q} is not {want}");
    }
}

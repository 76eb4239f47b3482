//! Played effects against closed forms: a rotor of inertia `I` in no gravity, pushed by a constant torque from rest.

use std::collections::BTreeMap;

use dynid_model::device::{Configuration, Convention, Device, Frame, Joint, JointKind, Link};
use dynid_model::{Expression, Parameter};
use dynid_plant::effects::{EffectEntry, by_joint, carry};
use dynid_plant::recipe::{Cosine, Plant, Recipe, RunEntry};
use dynid_plant::{Mechanism, effects::Moment};

const INERTIA: f64 = 0.02;
const TORQUE: f64 = 0.3;

/// One bar that turns about an axis; `up` is y, across the axis, or nothing.
fn rotor(gravity: f64) -> Device {
    let symbol = |name: &str| Expression::Symbol(name.to_owned());
    let zero = || Expression::Number(0.0);
    let known = |value: f64| Parameter::known(value);
    let mut inertial = [known(0.0); 10];
    (inertial[0], inertial[9]) = (known(1.0), known(INERTIA));
    Device {
        id: "rotor".to_owned(),
        file: None,
        title: String::new(),
        source: String::new(),
        convention: Convention::Standard,
        gravity,
        up: [0.0, if gravity > 0.0 { 1.0 } else { 0.0 }, 0.0],
        lengths: Vec::new(),
        joints: vec![Joint {
            kind: JointKind::Revolute,
            title: String::new(),
            position_limits: [-1.0, 1.0],
            speed_limit: f64::INFINITY,
            torque_limit: f64::INFINITY,
            command_unit: "N*m".to_owned(),
        }],
        frames: vec![Frame {
            name: String::new(),
            parent: None,
            theta: symbol("q0"),
            d: zero(),
            a: zero(),
            alpha: zero(),
        }],
        links: vec![Link { frame: 0, title: String::new(), inertial }],
        configurations: vec![Configuration { free: vec![0] }],
        methods: Vec::new(),
        end_point: None,
        effects: Vec::new(),
    }
}

fn entry(id: &str, values: &[(&str, f64)]) -> EffectEntry {
    let values = values.iter().map(|&(symbol, value)| (symbol.to_owned(), value)).collect();
    EffectEntry { id: id.to_owned(), joint: 0, from: None, values }
}

/// Positions at 0, 10, 20 .. ms while `TORQUE cos(2 pi hz t)` is commanded.
fn played(effects: Vec<EffectEntry>, hz: f64, duration_s: f64) -> Vec<f64> {
    let recipe = Recipe {
        device: "rotor".to_owned(),
        seed: 1,
        sample_s: 0.01,
        steps_per_sample: 80,
        noise_rms: 0.0,
        quantum: 0.0,
        start: vec![0.0],
        effects,
        ..Recipe::default()
    };
    let run = RunEntry {
        file: String::new(),
        free: vec![0],
        role: String::new(),
        duration_s,
        torque: vec![Cosine { joint: 0, amplitude: TORQUE, hz, hz_per_s: 0.0, phase: 0.0 }],
        ..RunEntry::default()
    };
    let device = rotor(0.0);
    let trace = Plant::new(&recipe, &device).unwrap().play(&run).unwrap();
    trace.seen.iter().map(|row| row[0]).collect()
}

fn assert_follows(played: &[f64], tolerance: f64, closed_form: impl Fn(f64) -> f64) {
    for (row, q) in played.iter().enumerate() {
        let t = 0.01 * row as f64;
        let want = closed_form(t);
        assert!((q - want).abs() <= tolerance, "t = {t}: {q} is not {want}");
    }
}

/// `q'' = u(t - d)/I` with a staircase `u`: parabolas that begin where a step arrives, be it between two rows.
#[test]
fn a_delayed_staircase_stays_a_staircase() {
    let (delay, hz) = (0.0234, 1.3);
    let played = played(vec![entry("input_delay", &[("delay", delay)])], hz, 0.5);
    let command = |row: i64| {
        let t = 0.01 * row.max(0) as f64;
        ((TORQUE * (std::f64::consts::TAU * hz * t).cos()) * 1e6).round() / 1e6
    };
    assert_follows(&played, 1e-12, |t| {
        // every step of the command adds a ramp of speed from when it arrives; the first holds before the log starts
        let steps = (1..=50).map(|row| (0.01 * row as f64 + delay, command(row) - command(row - 1)));
        let mut q = 0.5 * command(0) / INERTIA * t * t;
        for (arrives, step) in steps {
            let since = f64::max(t - arrives, 0.0);
            q += 0.5 * step / INERTIA * since * since;
        }
        q
    });
}

/// `q'' = tau/I (1 - exp(-t/T))`
#[test]
fn a_lagging_drive_gives_its_torque_exponentially() {
    let time = 0.037;
    let played = played(vec![entry("input_lag", &[("T", time)])], 0.0, 0.5);
    assert_follows(&played, 1e-11, |t| {
        TORQUE / INERTIA * (0.5 * t * t - time * t + time * time * (1.0 - (-t / time).exp()))
    });
}

/// `I w' = tau - c w^2`: `q = I/c ln cosh(t sqrt(tau c)/I)`
#[test]
fn quadratic_drag_ends_in_a_steady_speed() {
    let drag: f64 = 0.004;
    let played = played(vec![entry("quadratic_drag", &[("Cd", drag)])], 0.0, 1.0);
    assert_follows(&played, 1e-10, |t| INERTIA / drag * (t * (TORQUE * drag).sqrt() / INERTIA).cosh().ln());
}

/// Two rotors on a shaft. The deflection answers a step as a damped oscillator, `x'' + 2 a x' + w^2 x = tau/Jm`, and the
/// momentum of both is `tau t`, so `(I + Jm) q = tau t^2/2 - Jm x`.
#[test]
fn an_elastic_joint_rings_as_two_rotors_on_a_shaft() {
    let (compliance, damping, motor) = (0.2, 0.004, 0.005);
    let values = [("compliance", compliance), ("damping", damping), ("Jm", motor), ("T_min", 1e-3)];
    let played = played(vec![entry("joint_elasticity", &values)], 0.0, 1.0);
    let share = 1.0 / motor + 1.0 / INERTIA;
    let (decay, square) = (0.5 * damping * share, share / compliance);
    let ringing = (square - decay * decay).sqrt();
    assert_follows(&played, 1e-9, |t| {
        let steady = TORQUE / motor / square;
        let decayed = (-decay * t).exp() * ((ringing * t).cos() + decay / ringing * (ringing * t).sin());
        let deflection = steady * (1.0 - decayed);
        (0.5 * TORQUE * t * t - motor * deflection) / (INERTIA + motor)
    });
}

/// The joint rests while the motor crosses its half of the gap, for `sqrt(gap Jm / tau)`; afterwards both share the
/// momentum `tau t`, the motor at most a gap and a little ahead.
#[test]
fn play_is_crossed_before_the_joint_moves() {
    let (gap, motor) = (0.04, 0.005);
    let played = played(vec![entry("backlash", &[("gap", gap), ("Jm", motor), ("T_contact", 1e-3)])], 0.0, 1.0);
    let crossed = (gap * motor / TORQUE).sqrt();
    for (row, q) in played.iter().enumerate() {
        let t = 0.01 * row as f64;
        if t <= crossed {
            assert_eq!(*q, 0.0, "t = {t}");
            continue;
        }
        let ahead = (0.5 * TORQUE * t * t - (INERTIA + motor) * q) / motor;
        assert!(ahead.abs() < 0.5 * gap + 5e-3, "t = {t}: {ahead}");
    }
    assert!(crossed > 0.02 && played[100] > 0.0);
}

/// A body that hangs on a spring outside of the library obeys the same equations as the rotor behind an elastic shaft.
#[test]
fn a_resonance_is_two_rotors_on_a_shaft() {
    let (j, k, d) = (0.005, 3.0, 0.006);
    let played = played(vec![entry("resonance", &[("J", j), ("K", k), ("d", d)])], 0.0, 1.0);
    let share = 1.0 / j + 1.0 / INERTIA;
    let (decay, square) = (0.5 * d * share, k * share);
    let ringing = (square - decay * decay).sqrt();
    assert_follows(&played, 1e-9, |t| {
        let steady = TORQUE / INERTIA / square;
        let decayed = (-decay * t).exp() * ((ringing * t).cos() + decay / ringing * (ringing * t).sin());
        // the joint runs ahead of the body by the deflection
        (0.5 * TORQUE * t * t + j * steady * (1.0 - decayed)) / (INERTIA + j)
    });
}

/// A point mass `m` at `r` adds `m r^2 q'' + m g r cos(q)` to a bar.
#[test]
fn a_payload_adds_its_weight_and_inertia() {
    let device = rotor(9.81);
    let (m, r, q, ddq) = (0.7, 0.31, 0.4_f64, -2.2);
    let joints = by_joint(&[entry("payload", &[("m", m), ("x", r), ("y", 0.0), ("z", 0.1)])], 1).unwrap();
    let symbols = Link::SYMBOLS.iter().zip(&device.links[0].inertial);
    let mut values: BTreeMap<String, f64> =
        symbols.map(|(symbol, parameter)| (format!("link.1.{symbol}"), parameter.value)).collect();
    carry(&joints, &device, &mut values).unwrap();
    let value = |name: &str| match name {
        "base.gy" => 9.81,
        _ => values.get(name).copied().unwrap_or(0.0),
    };
    let torque = Mechanism::new(&device, &value).inverse_dynamics(&[q], &[1.3], &[ddq]);
    let want = (INERTIA + m * r * r) * ddq + m * 9.81 * r * q.cos();
    assert!((torque[0] - want).abs() < 1e-14, "{} is not {want}", torque[0]);
}

/// Pushed from its undeflected state, a Dahl contact gives `Fc (1 - exp(-sigma0 x/Fc))`, and so the rotor obeys
/// `I w^2/2 = tau x - Fc x + Fc^2/sigma0 (1 - exp(-sigma0 x/Fc))`.
#[test]
fn a_dahl_contact_takes_up_work_as_it_bends() {
    let (sigma0, fc) = (4.0, 0.12);
    let played = played(vec![entry("dahl", &[("sigma0", sigma0), ("Fc", fc)])], 0.0, 0.5);
    for rows in played.windows(5) {
        // speed in the middle, by the difference formula of fourth order
        let speed = (rows[0] - 8.0 * rows[1] + 8.0 * rows[3] - rows[4]) / 0.12;
        let x = rows[2];
        let work = (TORQUE - fc) * x + fc * fc / sigma0 * (1.0 - (-sigma0 * x / fc).exp());
        assert!((0.5 * INERTIA * speed * speed - work).abs() < 2e-6, "x = {x}: {work}");
    }
}

/// Thesis Fig. 3.4: through its corners, without a jump, and odd.
#[test]
fn turners_curve_goes_through_its_corners() {
    let (s1, v1, fk, v4, s2) = (5.0, 0.1, 0.2, 0.5, 0.04);
    let joints =
        by_joint(&[entry("turner", &[("s1", s1), ("v1", v1), ("Fk", fk), ("v4", v4), ("s2", s2)])], 1).unwrap();
    let torque = |v: f64| {
        let moment = Moment { joint: 0, q: &[0.0], dq: &[v], time: 0.0, torque: 0.0, commands: &[0.0] };
        joints[0].load(&moment, &[], &mut [])
    };
    for (v, want) in [(0.05, 0.25), (0.1, 0.5), (0.3, 0.35), (0.5, 0.2), (1.0, 0.22), (0.0, 0.0)] {
        assert!((torque(v) - want).abs() < 1e-15 && (torque(-v) + want).abs() < 1e-15, "{v}: {}", torque(v));
    }
    for v in [v1, v4] {
        assert!((torque(v + 1e-9) - torque(v - 1e-9)).abs() < 1e-7);
    }
}

/// What leaves dead zone and saturation, and the encoder's view.
#[test]
fn drive_and_sensor_bend_signals_as_stated() {
    let values = [
        entry("dead_zone", &[("width", 0.2)]),
        entry("saturation", &[("limit", 0.5)]),
        entry("sensor_scale", &[("scale", 0.1)]),
        entry("sensor_offset", &[("shift", -0.3)]),
    ];
    let joints = by_joint(&values, 1).unwrap();
    for (command, want) in [(0.1, 0.0), (-0.2, 0.0), (0.4, 0.2), (-0.4, -0.2), (0.9, 0.5), (-2.0, -0.5)] {
        assert!((joints[0].drive.before_lag(command) - want).abs() < 1e-15, "{command}");
    }
    assert!((joints[0].seen(2.0) - 1.9).abs() < 1e-15);
}

//! For tests: a mass on a spring that may stiffen, integrated here and not by the program's own equations; models of it, and
//! candidates.

use std::f64::consts::TAU;
use std::path::Path;

use dynid_logs::experiment::{Role, Run, Settings};
use dynid_logs::log::Log;
use dynid_random::Random;
use dynid_user_model::Model;

use crate::candidate::Candidate;
use crate::score_test::Start;

/// Noise of the logged positions (m).
pub const NOISE: f64 = 1e-4;
/// Time from sample to sample (s).
pub const SAMPLE_S: f64 = 0.01;
/// Of the mass (kg).
const MASS: f64 = 8e-4;
/// Of the damper (N s/m).
const DAMPING: f64 = 0.006;

/// A model of this stiffness (N/m), with more effects.
pub fn model(stiffness: f64, more: &str) -> Model {
    let text = format!(
        "device = \"oscillator\"\n[link.1]\nm = {MASS:?}\n[[effect]]\nid = \"gain\"\njoint = 0\n[[effect]]\nid = \"viscous\"\njoint = \
         0\nFv = {DAMPING:?}\n[[effect]]\nid = \"spring\"\njoint = 0\nKs = {stiffness:?}\n{more}"
    );
    Model::parse(&text, Path::new("made.toml")).expect("a model")
}

/// Cubic stiffness as an effect of a model.
pub fn cubic(stiffness: f64) -> String {
    format!("[[effect]]\nid = \"spring_cubic\"\njoint = 0\nK3 = {stiffness:?}\n")
}

/// `m x'' + Fv x' + Ks x + K3 x^3 = u`, from rest, logged with noise.
pub struct Oscillator {
    /// Ks (N/m).
    pub stiffness: f64,
    /// K3 (N/m^3).
    pub cubic: f64,
}

impl Oscillator {
    /// So many seconds under sines of these amplitudes (N) and frequencies (Hz), held between samples; with noise of this seed.
    pub fn run(&self, sines: &[(f64, f64)], seconds: f64, role: (Role, u64)) -> Run {
        self.run_carrying(0.0, sines, seconds, role)
    }

    /// The same with so much more mass (kg).
    pub fn run_carrying(&self, load: f64, sines: &[(f64, f64)], seconds: f64, role: (Role, u64)) -> Run {
        self.driven(load, sines, seconds, role, |now, _, _| now)
    }

    /// The same with a command that runs straight from sample to sample.
    pub fn run_with_straight_command(&self, sines: &[(f64, f64)], seconds: f64, role: (Role, u64)) -> Run {
        self.driven(0.0, sines, seconds, role, |now, next, share| now + share * (next - now))
    }

    /// `force` is told this and the next sample's, and which share of the time between them is over.
    fn driven(
        &self,
        load: f64,
        sines: &[(f64, f64)],
        seconds: f64,
        (role, seed): (Role, u64),
        force: fn(f64, f64, f64) -> f64,
    ) -> Run {
        const SUBSTEPS: usize = 20;
        let t: Vec<f64> = (0..(seconds / SAMPLE_S) as usize).map(|k| k as f64 * SAMPLE_S).collect();
        let tau: Vec<f64> =
            t.iter().map(|t| sines.iter().map(|(amplitude, hz)| amplitude * (TAU * hz * t).sin()).sum()).collect();
        let mut random = Random::new(seed);
        let (mut x, mut v) = (0.0, 0.0);
        let mut q = Vec::with_capacity(t.len());
        for (k, now) in tau.iter().copied().enumerate() {
            q.push(x + NOISE * random.normal());
            let next = tau.get(k + 1).copied().unwrap_or(now);
            let h = SAMPLE_S / SUBSTEPS as f64;
            let share = |step: f64| step / SUBSTEPS as f64;
            // Runge and Kutta's method
            for step in 0..SUBSTEPS {
                let acceleration = |part: f64, x: f64, v: f64| {
                    let force = force(now, next, share(step as f64 + part));
                    (force - DAMPING * v - self.stiffness * x - self.cubic * x.powi(3)) / (MASS + load)
                };
                let (v1, a1) = (v, acceleration(0.0, x, v));
                let (v2, a2) = (v + 0.5 * h * a1, acceleration(0.5, x + 0.5 * h * v1, v + 0.5 * h * a1));
                let (v3, a3) = (v + 0.5 * h * a2, acceleration(0.5, x + 0.5 * h * v2, v + 0.5 * h * a2));
                let (v4, a4) = (v + h * a3, acceleration(1.0, x + h * v3, v + h * a3));
                x += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
                v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
            }
        }
        let log = Log { t, tau: vec![tau], q: vec![q], reference: None, mask: None, left_out: Vec::new() };
        let settings = Settings { min_speed: vec![0.0], ..Settings::default() };
        let file = "made.csv".to_owned();
        Run { file, role, free: vec![0], payload: None, configuration: 1, log, settings }
    }
}

/// An effect at the only joint.
pub fn candidate(effect: &str) -> Candidate {
    Candidate { effect: effect.to_owned(), joint: Some(0), from: None }
}

/// A start of it that takes no step.
pub fn start(effect: &str, promise: f64, probe: usize) -> Start {
    Start { candidate: candidate(effect), model: model(1.0, ""), promise, probe, step: Vec::new() }
}

/// Equal but for rounding.
pub fn close(found: f64, expected: f64) {
    assert!((found / expected - 1.0).abs() < 1e-9, "{found}, not {expected}");
}

//! A long log at 1 kHz, as ordinary CSV: the log of a pendulum.

use std::{
    fs::{self, File},
    io::{BufWriter, Write},
    path::{Path, PathBuf},
};

use anyhow::Result;
use dynid_random::Random;

/// Steps of integration between two samples, and the time between samples (s).
const FINER: usize = 4;
const STEP: f64 = 1e-3;

/// Writes an experiment with one log of so many seconds to a folder, and says where the experiment is.
///
/// A pendulum with friction under a command of many sines, with white noise on the position; every number has all its digits.
pub fn write(folder: &Path, seconds: usize) -> Result<PathBuf> {
    let experiment = folder.join("experiment.toml");
    let text = "device = \"servo_pendulum\"\n\n[[run]]\nfile = \"long.csv\"\nfree = [0]\nrole = \"fit\"\n";
    fs::write(&experiment, text)?;
    let mut csv = BufWriter::new(File::create(folder.join("long.csv"))?);
    let mut random = Random::new(3600);
    let sines: Vec<[f64; 3]> = (1..=12)
        .map(|k| [0.1 / f64::from(k).sqrt(), 0.37 * f64::from(k) + random.between(0.0, 0.3), random.between(0.0, 6.0)])
        .collect();
    let (mut q, mut dq) = (0.0_f64, 0.0_f64);
    writeln!(csv, "t,tau0,q0")?;
    for k in 0..seconds * 1000 {
        let t = k as f64 * STEP;
        let tau: f64 = sines.iter().map(|[size, speed, phase]| size * (speed * t + phase).sin()).sum();
        writeln!(csv, "{t},{tau},{}", q + 1e-4 * random.normal())?;
        for _ in 0..FINER {
            let step = STEP / FINER as f64;
            dq += step * (tau - 0.8 * q.sin() - 0.05 * dq - 0.05 * (20.0 * dq).tanh()) / 0.04;
            q += step * dq;
        }
    }
    csv.flush()?;
    Ok(experiment)
}

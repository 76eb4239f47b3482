//! A long log: `write <folder> <seconds>` makes an experiment with one log of a joint at 1 kHz in a folder, `read <experiment.toml>` says how
//! long reading one takes, and how much memory the process needed at most.
//!
//! `cargo run --release -p dynid-logs --example long_log -- write target/hour 3600`, then `.. -- read target/hour/experiment.toml`

use std::{
    error::Error,
    fs::{self, File},
    io::{BufWriter, Write},
    path::Path,
    time::Instant,
};

use dynid_logs::experiment::Experiment;
use dynid_random::Random;

/// Steps of integration between two samples, and the time between samples (s).
const FINER: usize = 4;
const STEP: f64 = 1e-3;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["write", folder, seconds] => write(Path::new(folder), seconds.parse()?),
        ["read", experiment] => read(experiment),
        _ => Err("say `write <folder> <seconds>` or `read <experiment.toml>`".into()),
    }
}

/// A pendulum with friction under a command of many sines, with white noise on the position; every number has all its digits.
fn write(folder: &Path, seconds: f64) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(folder)?;
    let experiment = "device = \"servo_pendulum\"\n\n[[run]]\nfile = \"long.csv\"\nfree = [0]\nrole = \"fit\"\n";
    fs::write(folder.join("experiment.toml"), experiment)?;
    let mut csv = BufWriter::new(File::create(folder.join("long.csv"))?);
    let mut random = Random::new(3600);
    let sines: Vec<[f64; 3]> = (1..=12)
        .map(|k| [0.1 / f64::from(k).sqrt(), 0.37 * f64::from(k) + random.between(0.0, 0.3), random.between(0.0, 6.0)])
        .collect();
    let (mut q, mut dq) = (0.0_f64, 0.0_f64);
    writeln!(csv, "t,tau0,q0")?;
    for k in 0..(seconds / STEP).round() as usize {
        let t = k as f64 * STEP;
        let tau: f64 = sines.iter().map(|[size, speed, phase]| size * (speed * t + phase).sin()).sum();
        writeln!(csv, "{t},{tau},{}", q + 1e-4 * random.normal())?;
        for _ in 0..FINER {
            let step = STEP / FINER as f64;
            dq += step * (tau - 0.8 * q.sin() - 0.05 * dq - 0.05 * (20.0 * dq).tanh()) / 0.04;
            q += step * dq;
        }
    }
    Ok(csv.flush()?)
}

fn read(experiment: &str) -> Result<(), Box<dyn Error>> {
    let began = Instant::now();
    let read = Experiment::load(experiment)?;
    let seconds = began.elapsed().as_secs_f64();
    let samples: usize = read.runs.iter().map(|run| run.log.len()).sum();
    println!("{samples} samples in {seconds:.3} s, at most {} of memory, digest {}", memory(), read.digest);
    Ok(())
}

/// The most memory that this process had, where the system tells.
fn memory() -> String {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let most = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    most.map_or("not known".to_owned(), |most| most.trim().to_owned())
}

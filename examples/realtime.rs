//! The skeleton of a controller's loop: read the sensors, make a wall and carry the device, write the torques.
//!
//! ```sh
//! cargo run --release --example realtime -- --ticks 1000000            as fast as it goes: what does a tick take?
//! cargo run --release --example realtime -- --ticks 10000 --paced      once per millisecond, as on a robot
//! ```
//!
//! The sensors here belong to a simulated Freedom 6S of six free joints that a hand moves about. A robot's own go in place
//! of [`Device`]; so does whatever gives its thread a core and a priority of its own, which is the operating system's
//! affair. Only the tick is measured: estimator, a wall at a joint, a wall that is a plane in space, compensation. On a machine
//! that does other things too the worst tick is that in which something else had the core; `--passes 3` makes the same ticks
//! again, and tells besides what is left of the worst one if each tick counts by the fastest of its passes.

use std::time::{Duration, Instant};

use dynid_control::{Compensation, CompensationRatios, Estimator, PlaneWall};
use dynid_haptics::{wall, wall::Setting, wall::space};
use dynid_user_model::Model;

const SAMPLE_S: f64 = 1e-3;
const QUANTUM: f64 = 1e-4;
const JOINTS: usize = 6;

/// What stands for sensors and amplifiers.
struct Device {
    tick: u64,
}

impl Device {
    /// Positions as encoders show them: every joint is moved about at a pace of its own.
    fn read(&mut self, q: &mut [f64; JOINTS]) {
        let t = self.tick as f64 * SAMPLE_S;
        for (joint, q) in q.iter_mut().enumerate() {
            let own = joint as f64;
            let position = 0.4 * ((1.7 + 0.6 * own) * t).sin() + 0.1 * ((11.0 + own) * t + own).sin();
            *q = (position / QUANTUM).round() * QUANTUM;
        }
        self.tick += 1;
    }

    fn write(&mut self, command: &[f64]) {
        std::hint::black_box(command);
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let after = |name: &str| arguments.iter().position(|own| own == name).map(|index| arguments.get(index + 1));
    let number = |name: &str, usual: usize| -> Result<usize, Box<dyn std::error::Error>> {
        let Some(value) = after(name) else { return Ok(usual) };
        let value = value.ok_or_else(|| format!("{name} needs a number"))?;
        Ok(value.parse().map_err(|error| format!("{name} {value}: {error}; give a whole number"))?)
    };
    let ticks = number("--ticks", 1_000_000)?;
    let passes = number("--passes", 1)?.max(1);
    let paced = after("--paced").is_some();

    // Everything that allocates or may fail comes first.
    let device = dynid_model::device("freedom6s").ok_or("the device is not in the library")?;
    let free: Vec<usize> = (0..JOINTS).collect();
    let model = Model::of_device(device);
    let system = model.system(&free, |_| 0.0)?;
    // A plane in space before the handle.
    let mut place = space::Setting::shipped()?;
    place.sampling.sample_s = SAMPLE_S;
    let kinematics = model.kinematics(&free, &place.posture)?;
    let felt = (place.wall(&wall::shipped("fuzzy")?)?, place.lever);
    let first_plane = PlaneWall::new(&system, kinematics, place.plane, felt, &place.torque_limits)?;
    let mut compensation = Compensation::new(system, CompensationRatios::default(), SAMPLE_S)?;
    let mut estimator = Estimator::new(JOINTS, SAMPLE_S, 20.0, QUANTUM, 1);
    // A fuzzy wall at joint 0, below its position 0.
    let setting = Setting { sample_s: SAMPLE_S, ..Setting::shipped()? };
    let first_wall = wall::shipped("fuzzy")?.wall(&setting)?;
    let mut device = Device { tick: 0 };
    let [mut reading, mut q, mut dq, mut ddq, mut command] = [[0.0; JOINTS]; 5];
    let mut spans: Vec<u32> = Vec::with_capacity(ticks);
    let mut fastest: Vec<u32> = vec![u32::MAX; ticks];

    for _ in 0..passes {
        spans.clear();
        device.tick = 0;
        estimator.restart();
        compensation.restart();
        let (mut wall, mut plane) = (first_wall.clone(), first_plane.clone());
        let start = Instant::now();
        for fastest in &mut fastest {
            if paced {
                // The last stretch is waited for actively: a sleep ends when the system pleases.
                let due = start + Duration::from_secs_f64(device.tick as f64 * SAMPLE_S);
                let left = due.saturating_duration_since(Instant::now());
                std::thread::sleep(left.saturating_sub(Duration::from_micros(200)));
                while Instant::now() < due {
                    std::hint::spin_loop();
                }
            }
            device.read(&mut reading);
            let before = Instant::now();
            estimator.tick(&reading, &mut q, &mut dq, &mut ddq);
            command.copy_from_slice(compensation.tick(&q, &dq, &ddq));
            command[0] += wall.tick(q[0], dq[0]);
            command.iter_mut().zip(plane.tick(&q, &dq)).for_each(|(command, felt)| *command += felt);
            let span = before.elapsed().as_nanos().min(u128::from(u32::MAX)) as u32;
            spans.push(span);
            *fastest = span.min(*fastest);
            device.write(&command);
        }
    }

    spans.sort_unstable();
    let at = |share: f64| spans.get(((spans.len() as f64 * share) as usize).min(spans.len().saturating_sub(1)));
    let reported = |name: &str, span: Option<&u32>| {
        if let Some(span) = span {
            println!("{name:>22}  {:8.2} us", f64::from(*span) / 1e3);
        }
    };
    println!("{ticks} ticks of estimator, compensation, a wall at a joint and one in space, {JOINTS} joints");
    reported("median", at(0.5));
    reported("99 %", at(0.99));
    reported("99.99 %", at(0.9999));
    reported("worst", spans.last());
    if passes > 1 {
        reported("the same, fastest pass", fastest.iter().max());
    }
    Ok(())
}

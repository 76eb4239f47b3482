//! `dynid excite`: what to play on the robot so that its motion tells the parameters.

mod between;

use std::f64::consts::PI;
use std::fmt::Write;
use std::path::PathBuf;

use anyhow::{anyhow, bail};
use clap::ValueEnum;
use dynid_dynamics::system::System;
use dynid_dynamics::{simulate, simulate::Input, simulate::Intersample};
use dynid_excite::wave::Wave;
use dynid_excite::{Excitation, times};
use dynid_excite::{fourier, fourier::Limits};
use dynid_excite::{
    information::BaseRegressor, information::Drive, information::Expected, information::Path,
    information::needed_torque,
};
use dynid_files::{Overwrite, check_output, write_new};
use dynid_model::{Device, JointKind, NamedInput, Quantity, inputs};
use dynid_report::{plot, plot::Curve};
use dynid_user_model::Model;
use serde_json::{Value, json};

use super::table::{Align, Table};
use super::table_file::{format_of, log_file};
use super::{Answer, Outcome, devices};

/// Write commands to play on the robot, and say which standard errors to expect from the run.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid excite freedom6s --list                                           inputs of published experiments
  dynid excite freedom6s --input table-4.7-configuration-3 --out run.csv
  dynid excite freedom6s --free 4,5 --signal chirp --from 0.1 --to 1 --amplitude 0.004 --out run.csv
  dynid excite staubli_tx40 --free 4,5 --signal optimised --period 10 --out run.csv
  dynid excite planar2r --free 0,1 --signal optimised --position-limits=-1:1,-2:0 --as torque --out run.csv
  dynid excite --between cubic.toml straight.toml --free 0 --position-limits=-0.1:0.1 --out run.csv

The file has the columns t and tau0.. (torques, open loop) or ref0.. (positions for the robot's controller). Lists have
one entry a free joint, or one for all of them. An optimised motion is a Fourier series that starts and ends at rest and
keeps the limits of position, speed and torque of the device, or those given here; among those it is the one that makes
the determinant of the information on the base parameters largest (D-optimal). With --between it is the torques, a
Fourier series within the same limits, under which two models part most: the first counts as true, and what the free
parameters of the second could absorb is taken off (T-optimal). To see what a model would do, name the
file in an experiment, with `start`, and run `dynid simulate`.")]
pub struct Arguments {
    /// Id of a device, e.g. `freedom6s`; not needed with a model.
    #[arg(required_unless_present_any = ["model", "between"])]
    pub device: Option<String>,
    /// A model whose values and effects count instead of the device's default ones.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Two rival models: play the torques that tell the first, if it is true, from the second.
    #[arg(long, num_args = 2, value_names = ["A", "B"], conflicts_with_all = ["model", "list", "input", "signal", "amplitude", "frequency", "from", "to", "noise"])]
    pub between: Vec<PathBuf>,
    /// Standard deviation of the position noise [rad or m], for --between. Without it, a ten-thousandth of each joint's range, or
    /// of 1.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_name = "LIST", requires = "between")]
    position_noise: Vec<f64>,
    /// List the inputs of published experiments with the device.
    #[arg(long)]
    list: bool,
    /// Play an input of that list.
    #[arg(long, value_name = "NAME", conflicts_with_all = ["signal", "free", "amplitude", "frequency", "from", "to", "harmonics"])]
    input: Option<String>,
    /// Play a signal of this kind.
    #[arg(long, value_enum)]
    signal: Option<Signal>,
    /// Free joints, e.g. `4,5`.
    #[arg(long, value_delimiter = ',', value_name = "JOINTS")]
    free: Vec<usize>,
    /// Torques or positions. Without it, positions for an optimised motion, else torques.
    #[arg(long = "as", value_enum)]
    quantity: Option<Kind>,
    /// Amplitudes [N*m or N, rad or m].
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_name = "LIST")]
    amplitude: Vec<f64>,
    /// Frequency of a cosine [Hz].
    #[arg(long, value_name = "HZ")]
    frequency: Option<f64>,
    /// Lowest frequency of a chirp or multisine [Hz].
    #[arg(long, value_name = "HZ")]
    from: Option<f64>,
    /// Highest frequency of a chirp or multisine [Hz].
    #[arg(long, value_name = "HZ")]
    to: Option<f64>,
    /// Length [s]. Without it, that of the named input, one period of an optimised motion, else 60 s.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    duration: Option<f64>,
    /// Samples a second [Hz]. Without it, that of the named input, else 100 Hz.
    #[arg(long, value_name = "HZ", allow_hyphen_values = true)]
    rate: Option<f64>,
    /// Period of an optimised motion, or of --between [s].
    #[arg(long, value_name = "S", default_value_t = 10.0, allow_hyphen_values = true)]
    period: f64,
    /// Harmonics of an optimised motion, or of --between, at least 2: the band of the commands.
    #[arg(long, value_name = "N", default_value_t = 5)]
    harmonics: usize,
    /// Motions that the optimisation looks at.
    #[arg(long, value_name = "N", default_value_t = 2000)]
    evaluations: usize,
    /// Seed of the optimisation: the same seed gives the same motion.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Where all joints stand at the start and locked ones stay [rad or m], one a joint of the device. Without it, 0 or the
    /// nearest position within the limits.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_name = "LIST")]
    pose: Vec<f64>,
    /// Limits of position [rad or m], e.g. `--position-limits=-1:1,0:0.5`, instead of the device's.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_name = "LOW:HIGH", value_parser = range)]
    position_limits: Vec<[f64; 2]>,
    /// Largest speeds [rad/s or m/s], instead of the device's.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_name = "LIST")]
    speed_limit: Vec<f64>,
    /// Largest commands, instead of those that make the device's largest torques.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_name = "LIST")]
    torque_limit: Vec<f64>,
    /// Standard deviation of the torque noise at the joints [N*m or N], for the errors to be expected. Without it, 1 % of
    /// the largest torque of each joint.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_name = "LIST")]
    noise: Vec<f64>,
    /// The file to write: .csv, .parquet or .arrow.
    #[arg(long, required_unless_present = "list")]
    out: Option<PathBuf>,
    /// A picture of commands and expected motion, as SVG.
    #[arg(long, value_name = "SVG")]
    picture: Option<PathBuf>,
    /// Overwrite files that are there.
    #[arg(long)]
    force: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Signal {
    /// One frequency.
    Cosine,
    /// A frequency that runs from one to another.
    Chirp,
    /// Many frequencies at once, with Schroeder's phases.
    Multisine,
    /// The periodic motion within the limits that tells most.
    #[value(alias = "optimized", alias = "optimal")]
    Optimised,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// Torques, open loop.
    Torque,
    /// Positions for the robot's controller.
    Reference,
}

/// `-1:0.5`
fn range(text: &str) -> Result<[f64; 2], String> {
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    match text.split_once(':').map(|(low, high)| (number(low), number(high))) {
        Some((Some(low), Some(high))) if low < high => Ok([low, high]),
        Some((Some(_), Some(_))) => Err("the lower limit is not below the upper one".to_owned()),
        _ => Err("write a lower and an upper limit as LOW:HIGH, e.g. -1:1".to_owned()),
    }
}

/// What is to be played, and what the model expects of it.
struct Planned {
    /// What it is, for people.
    title: String,
    excitation: Excitation,
    /// Where all joints stand at the start.
    start: Vec<f64>,
    /// The motion that the model expects; `None` where its simulation gives none.
    path: Option<Path>,
    expected: Option<Expected>,
    /// What it tells of two models.
    ratio: Option<between::Ratio>,
    notes: Vec<String>,
}

/// Plans, then writes.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let device = arguments.device.as_deref().map(devices::find).transpose()?;
    let rivals = between::rivals(&arguments.between)?;
    let model = match (arguments.model.as_ref().or(arguments.between.first()), device) {
        (Some(path), _) => Model::load(path)?,
        (None, Some(device)) => Model::of_device(device),
        (None, None) => bail!("nothing to excite; name a device, or give a model with `--model`"),
    };
    if let Some(device) = device.filter(|device| !model.device.is_same_as(device)) {
        bail!("the model is of device `{}`, not of `{}`; give a model of that device", model.device.id, device.id);
    }
    if arguments.list {
        return Ok(list(model.device));
    }
    let Some(out) = &arguments.out else { bail!("nowhere to write to; give a file with `--out`") };
    let overwrite = Overwrite::if_forced(arguments.force);
    let format = format_of(out)?;
    check_output(out, overwrite)?;
    if let Some(picture) = &arguments.picture {
        if picture == out {
            bail!("--out and --picture are both {}; give each a file of its own", out.display());
        }
        check_output(picture, overwrite)?;
    }
    let planned = plan(arguments, &model, rivals.as_ref())?;
    write_new(out, &log_file(planned.excitation.columns(), format), overwrite)?;
    if let Some(path) = &arguments.picture {
        write_new(path, &picture(model.device, &planned), overwrite)?;
    }
    let file = out.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    Ok(Outcome {
        text: as_text(model.device, &planned, &file),
        json: described(&model, &planned, out, arguments.seed),
        answer: Answer::Yes,
    })
}

fn list(device: &Device) -> Outcome {
    let known = inputs(device);
    let mut table = Table::new(&[
        ("input", Align::Left),
        ("free", Align::Left),
        ("what", Align::Left),
        ("length", Align::Right),
        ("", Align::Left),
    ]);
    for input in known {
        table.row([
            input.name.clone(),
            joints(&input.free),
            quantity(input.quantity).to_owned(),
            format!("{} s", input.duration_s),
            input.note.clone().unwrap_or_default(),
        ]);
    }
    let text = if known.is_empty() {
        format!("no published input of `{}` is known; see `--signal`\n", device.id)
    } else {
        table.text()
    };
    let described: Vec<Value> = known
        .iter()
        .map(|input| {
            json!({
                "name": input.name, "free": input.free, "quantity": quantity(input.quantity),
                "duration_s": input.duration_s, "sample_s": input.sample_s, "note": input.note,
            })
        })
        .collect();
    Outcome { text, json: json!({ "device": device.id, "inputs": described }), answer: Answer::Yes }
}

/// Checks the arguments and makes the excitation.
fn plan(arguments: &Arguments, model: &Model, rivals: Option<&[Model; 2]>) -> anyhow::Result<Planned> {
    let device = model.device;
    let input = arguments.input.as_deref().map(|name| find_input(device, name)).transpose()?;
    let free = match input {
        Some(input) => input.free.clone(),
        None => free_joints(device, &arguments.free)?,
    };
    let mut limits = limits(arguments, device, &free)?;
    let pose = pose(arguments, device, &free, &limits)?;
    if arguments.torque_limit.is_empty() {
        limits.torque = command_limits(model, &free, &pose, limits.torque)?;
    }
    let positive = |name: &str, value: f64| match value {
        value if value > 0.0 && value.is_finite() => Ok(value),
        value => Err(anyhow!("--{name} {value}: expected a positive number")),
    };
    let sample_s = match arguments.rate {
        Some(rate) => 1.0 / positive("rate", rate)?,
        None => input.map_or(0.01, |input| input.sample_s),
    };
    let is_optimised = arguments.signal == Some(Signal::Optimised) || rivals.is_some();
    let period_s = positive("period", arguments.period)?;
    let duration_s = match arguments.duration {
        Some(duration) => positive("duration", duration)?,
        None if is_optimised => period_s,
        None => input.map_or(60.0, |input| input.duration_s),
    };
    /// More samples than anybody plays, and a file of hundreds of megabytes.
    const MOST_SAMPLES: f64 = 1e7;
    if duration_s > MOST_SAMPLES * sample_s {
        bail!(
            "--duration {duration_s} s holds more than {MOST_SAMPLES:.0} samples of {sample_s} s; give a shorter one, or a lower --rate"
        );
    }
    if duration_s < 2.0 * sample_s {
        bail!(
            "--duration {duration_s} s holds less than two samples of {sample_s} s; give a longer one, or a higher --rate"
        );
    }
    if let Some(rivals) = rivals {
        return between::planned(arguments, rivals, &free, pose, &limits, (duration_s, sample_s));
    }
    let system = model.system(&free, |joint| pose[joint])?;
    match (input, arguments.signal) {
        (Some(input), _) => {
            check_nyquist(input.highest_frequency(duration_s) / (2.0 * PI), sample_s)?;
            let excitation = Excitation::of_input(input, &pose, duration_s, sample_s);
            let title = input.name.clone();
            if let Some(kind) =
                arguments.quantity.filter(|kind| (*kind == Kind::Torque) != (input.quantity == Quantity::Torque))
            {
                bail!("--as {}: the input `{title}` holds {}; leave --as out", name_of(kind), quantity(input.quantity));
            }
            expected(model, &system, title, excitation, pose, &limits, arguments)
        }
        (None, Some(Signal::Optimised)) => optimised(arguments, model, &system, pose, &limits, (duration_s, sample_s)),
        (None, Some(signal)) => {
            let wave = wave(arguments, signal, sample_s, duration_s)?;
            let kind = arguments.quantity.unwrap_or(Kind::Torque);
            let amplitude = per_joint("amplitude", &arguments.amplitude, free.len())?.ok_or_else(|| {
                anyhow!("the amplitude is not said; give it with --amplitude, one for all joints or one a free joint")
            })?;
            let target = if kind == Kind::Torque { Quantity::Torque } else { Quantity::Position };
            let mut excitation = Excitation {
                quantity: target,
                free: free.clone(),
                time: times(duration_s, sample_s),
                values: vec![Vec::new(); pose.len()],
            };
            let values = wave.values(free.len(), &excitation.time, duration_s).ok_or_else(|| {
                anyhow!(
                    "the multisine has fewer harmonics of 1/{duration_s} Hz between --from and --to than there are free joints; \
                     give a longer --duration, or frequencies further apart"
                )
            })?;
            let n_samples = excitation.time.len();
            for joint in 0..pose.len() {
                let rest = if target == Quantity::Torque { 0.0 } else { pose[joint] };
                excitation.values[joint] = match free.iter().position(|known| *known == joint) {
                    Some(slot) => values[slot].iter().map(|value| rest + amplitude[slot] * value).collect(),
                    None => vec![rest; n_samples],
                };
            }
            check_limits(&excitation, &limits)?;
            let title = format!("{} of {}", name_of(signal), quantity(target));
            expected(model, &system, title, excitation, pose, &limits, arguments)
        }
        (None, None) => bail!("what to play is not said; give --signal, or --input with a name that --list shows"),
    }
}

fn find_input<'a>(device: &'a Device, name: &str) -> anyhow::Result<&'a NamedInput> {
    let known = inputs(device);
    known.iter().find(|input| input.name == name).ok_or_else(|| {
        if known.is_empty() {
            anyhow!("there is no input `{name}`: none of `{}` is known; use --signal", device.id)
        } else {
            let near = dynid_model::nearest(name, known.iter().map(|input| input.name.as_str()));
            let help = near.map_or_else(
                || "`--list` shows them".to_owned(),
                |near| format!("did you mean `{near}`? `--list` shows all"),
            );
            anyhow!("there is no input `{name}` of `{}`; {help}", device.id)
        }
    })
}

fn free_joints(device: &Device, wanted: &[usize]) -> anyhow::Result<Vec<usize>> {
    let mut free = wanted.to_vec();
    free.sort_unstable();
    free.dedup();
    let n_joints = device.joints.len();
    if let Some(joint) = free.iter().find(|joint| **joint >= n_joints) {
        bail!("--free {joint}: `{}` has the joints 0 to {}", device.id, n_joints - 1);
    }
    if free.is_empty() {
        let known = device.configurations.iter().map(|known| joints(&known.free)).collect::<Vec<_>>().join("; ");
        bail!("the free joints are not said; give them with --free, e.g. those of a configuration: {known}");
    }
    Ok(free)
}

/// One entry for all joints, or one a free joint; nothing where nothing is given.
fn per_joint<T: Copy>(name: &str, list: &[T], n_free: usize) -> anyhow::Result<Option<Vec<T>>> {
    match list {
        [] => Ok(None),
        [one] => Ok(Some(vec![*one; n_free])),
        _ if list.len() == n_free => Ok(Some(list.to_vec())),
        _ => bail!("--{name}: {} entries for {n_free} free joints; give one for all, or one each", list.len()),
    }
}

fn limits(arguments: &Arguments, device: &Device, free: &[usize]) -> anyhow::Result<Limits> {
    let own = |value: &dyn Fn(usize) -> f64| free.iter().map(|&joint| value(joint)).collect::<Vec<f64>>();
    let at_least_zero = |name: &str, list: &[f64]| match list.iter().find(|value| value.is_nan() || **value <= 0.0) {
        Some(value) => bail!("--{name} {value}: expected a positive number"),
        None => per_joint(name, list, free.len()),
    };
    Ok(Limits {
        position: per_joint("position-limits", &arguments.position_limits, free.len())?
            .unwrap_or_else(|| free.iter().map(|&joint| device.joints[joint].position_limits).collect()),
        speed: at_least_zero("speed-limit", &arguments.speed_limit)?
            .unwrap_or_else(|| own(&|joint| device.joints[joint].speed_limit)),
        torque: at_least_zero("torque-limit", &arguments.torque_limit)?
            .unwrap_or_else(|| own(&|joint| device.joints[joint].torque_limit)),
    })
}

/// The commands that make a device's largest torques, where a command is no torque; infinite where the drive is no straight line.
fn command_limits(model: &Model, free: &[usize], pose: &[f64], torque: Vec<f64>) -> anyhow::Result<Vec<f64>> {
    let is_torque = |joint: usize| ["N*m", "N"].contains(&model.device.joints[joint].command_unit.as_str());
    if free.iter().all(|joint| is_torque(*joint)) {
        return Ok(torque);
    }
    let drive = Drive::of(&model.system(free, |joint| pose[joint])?);
    let command = |(slot, (joint, torque)): (usize, (&usize, f64))| match &drive {
        _ if is_torque(*joint) => torque,
        Some(drive) => torque * drive.command_per_torque(slot),
        None => f64::INFINITY,
    };
    Ok(free.iter().zip(torque).enumerate().map(command).collect())
}

/// Where all joints stand.
fn pose(arguments: &Arguments, device: &Device, free: &[usize], limits: &Limits) -> anyhow::Result<Vec<f64>> {
    let n_joints = device.joints.len();
    let range = |joint: usize| {
        let slot = free.iter().position(|known| *known == joint);
        slot.map_or(device.joints[joint].position_limits, |slot| limits.position[slot])
    };
    if arguments.pose.is_empty() {
        return Ok((0..n_joints).map(|joint| 0.0_f64.clamp(range(joint)[0], range(joint)[1])).collect());
    }
    if arguments.pose.len() != n_joints {
        bail!(
            "--pose: {} positions for {n_joints} joints; give one for each joint of the device",
            arguments.pose.len()
        );
    }
    for (joint, position) in arguments.pose.iter().enumerate() {
        let [low, high] = range(joint);
        if !(low..=high).contains(position) {
            bail!("--pose: joint {joint} stands at {position}, outside its limits {low:.4} to {high:.4}");
        }
    }
    Ok(arguments.pose.clone())
}

fn wave(arguments: &Arguments, signal: Signal, sample_s: f64, duration_s: f64) -> anyhow::Result<Wave> {
    let given = |name: &str, value: Option<f64>| match value {
        Some(value) if value > 0.0 => Ok(value),
        Some(value) => Err(anyhow!("--{name} {value}: expected a positive frequency [Hz]")),
        None => Err(anyhow!("a {} needs --{name} [Hz]", name_of(signal))),
    };
    let wave = match signal {
        Signal::Cosine => Wave::Cosine { frequency: given("frequency", arguments.frequency)? },
        Signal::Chirp => Wave::Chirp { from: given("from", arguments.from)?, to: given("to", arguments.to)? },
        _ => {
            let from = arguments.from.map_or(Ok(1.0 / duration_s), |from| given("from", Some(from)))?;
            let to = given("to", arguments.to)?;
            if to < from {
                bail!("--to {to} Hz is below --from {from} Hz; exchange them");
            }
            Wave::Multisine { from, to }
        }
    };
    check_nyquist(wave.highest(), sample_s)?;
    Ok(wave)
}

fn check_nyquist(highest: f64, sample_s: f64) -> anyhow::Result<()> {
    let nyquist = 0.5 / sample_s;
    if highest >= nyquist {
        bail!(
            "{highest} Hz is not below half of the sample rate, {nyquist} Hz; give a lower frequency, or a higher --rate than {} Hz",
            1.0 / sample_s
        );
    }
    Ok(())
}

/// What is commanded must be possible: torques within their limits, positions within theirs.
fn check_limits(excitation: &Excitation, limits: &Limits) -> anyhow::Result<()> {
    for (slot, &joint) in excitation.free.iter().enumerate() {
        let values = &excitation.values[joint];
        match excitation.quantity {
            Quantity::Torque => {
                let (peak, limit) = (excitation.peaks()[slot], limits.torque[slot]);
                if peak > limit * (1.0 + 1e-9) {
                    bail!(
                        "joint {joint}: the command reaches {peak:.4}, its limit is {limit:.4}; give a smaller --amplitude"
                    );
                }
            }
            Quantity::Position => {
                let [low, high] = limits.position[slot];
                if let Some(value) = values.iter().find(|value| !(low..=high).contains(*value)) {
                    bail!(
                        "joint {joint}: the reference reaches {value:.4}, its limits are {low:.4} to {high:.4}; \
                         give a smaller --amplitude, or another --pose"
                    );
                }
            }
        }
    }
    Ok(())
}

fn optimised(
    arguments: &Arguments,
    model: &Model,
    system: &System,
    mut start: Vec<f64>,
    limits: &Limits,
    (duration_s, sample_s): (f64, f64),
) -> anyhow::Result<Planned> {
    let free = system.kernel().free;
    if arguments.harmonics < 2 {
        bail!("--harmonics {}: a motion that starts at rest needs at least 2", arguments.harmonics);
    }
    check_nyquist(arguments.harmonics as f64 / arguments.period, sample_s)?;
    if let Some(slot) = limits.position.iter().position(|range| range.iter().any(|limit| limit.is_infinite())) {
        bail!("joint {} has no limits of position; give them with --position-limits", free[slot]);
    }
    let drive = Drive::of(system);
    if drive.is_none() && arguments.quantity == Some(Kind::Torque) {
        bail!(
            "the drive path of this model is no straight line from command to torque, so that no command is known; use --as reference"
        );
    }
    let options = fourier::Options {
        period_s: arguments.period,
        harmonics: arguments.harmonics,
        evaluations: arguments.evaluations,
        seed: arguments.seed,
    };
    let weights = match per_joint("noise", &arguments.noise, free.len())? {
        Some(noise) => checked_noise(noise)?,
        None => {
            let some = fourier::random(model, system, limits, &vec![1.0; free.len()], &options)?;
            let needed = needed_torque(system, &some.path(&times(arguments.period, arguments.period / 100.0)));
            hundredth(&needed, free.len())
        }
    };
    let motion = fourier::optimised(model, system, limits, &weights, &options)?;
    let time = times(duration_s, sample_s);
    let path = motion.path(&time);
    for (slot, &joint) in free.iter().enumerate() {
        start[joint] = path.q[0][slot];
    }
    let kind = arguments.quantity.unwrap_or(Kind::Reference);
    let needed = needed_torque(system, &path);
    let mut values: Vec<Vec<f64>> = match kind {
        Kind::Torque => vec![vec![0.0; time.len()]; start.len()],
        Kind::Reference => start.iter().map(|position| vec![*position; time.len()]).collect(),
    };
    for sample in 0..time.len() {
        let row = match (kind, &drive) {
            (Kind::Torque, Some(drive)) => drive.command(&needed[sample]),
            _ => path.q[sample].clone(),
        };
        for (slot, &joint) in free.iter().enumerate() {
            values[joint][sample] = row[slot];
        }
    }
    let quantity = if kind == Kind::Torque { Quantity::Torque } else { Quantity::Position };
    let excitation = Excitation { quantity, free: free.to_vec(), time, values };
    let regressor = BaseRegressor::new(model, system);
    let noise = if arguments.noise.is_empty() { hundredth(&needed, free.len()) } else { weights };
    let expected = regressor.expected(&path, &noise);
    let elsewhere = regressor.rank_elsewhere(model)?;
    let title = format!(
        "optimised motion of {} harmonics of 1/{} Hz, seed {}",
        arguments.harmonics, arguments.period, arguments.seed
    );
    let mut notes = beyond(&path, &needed, drive.as_ref(), free, limits);
    notes.extend(special(regressor.rank(), elsewhere));
    Ok(Planned { title, excitation, start, path: Some(path), expected: Some(expected), ratio: None, notes })
}

/// The motion that the model expects, and what it would tell.
fn expected(
    model: &Model,
    system: &System,
    title: String,
    excitation: Excitation,
    mut start: Vec<f64>,
    limits: &Limits,
    arguments: &Arguments,
) -> anyhow::Result<Planned> {
    let free = system.kernel().free;
    let mut notes = Vec::new();
    let path = match excitation.quantity {
        Quantity::Position => {
            for &joint in free {
                start[joint] = excitation.values[joint][0];
            }
            let rows =
                (0..excitation.time.len()).map(|k| free.iter().map(|&joint| excitation.values[joint][k]).collect());
            Some(Path::of_positions(&excitation.time, rows.collect()))
        }
        Quantity::Torque => match simulated(system, &excitation, &start) {
            Ok(path) => Some(path),
            Err(error) => {
                notes.push(format!("what this run would tell is not known: {error}"));
                None
            }
        },
    };
    let expected = match &path {
        Some(path) => {
            let needed = needed_torque(system, path);
            notes.extend(beyond(path, &needed, Drive::of(system).as_ref(), free, limits));
            let noise = match per_joint("noise", &arguments.noise, free.len())? {
                Some(noise) => checked_noise(noise)?,
                None => hundredth(&needed, free.len()),
            };
            let regressor = BaseRegressor::new(model, system);
            notes.extend(special(regressor.rank(), regressor.rank_elsewhere(model)?));
            Some(regressor.expected(path, &noise))
        }
        None => None,
    };
    Ok(Planned { title, excitation, start, path, expected, ratio: None, notes })
}

/// What to say of a pose of the locked joints that hides something.
fn special(rank: usize, elsewhere: usize) -> Option<String> {
    (elsewhere > rank).then(|| {
        format!("the locked joints stand where {rank} base parameters can be identified; elsewhere it would be {elsewhere} (see --pose)")
    })
}

fn checked_noise(noise: Vec<f64>) -> anyhow::Result<Vec<f64>> {
    match noise.iter().find(|noise| !(**noise > 0.0 && noise.is_finite())) {
        Some(wrong) => bail!("--noise {wrong}: expected a positive number"),
        None => Ok(noise),
    }
}

/// A hundredth of each joint's largest torque; 1 where there is none.
fn hundredth(torque: &[Vec<f64>], n_free: usize) -> Vec<f64> {
    let peak = |slot: usize| torque.iter().fold(0.0_f64, |peak, row| peak.max(row[slot].abs()));
    (0..n_free).map(peak).map(|peak| if peak > 0.0 { 0.01 * peak } else { 1.0 }).collect()
}

fn simulated(system: &System, excitation: &Excitation, start: &[f64]) -> anyhow::Result<Path> {
    let free = system.kernel().free;
    let rows = 0..excitation.time.len();
    let command: Vec<f64> = rows.flat_map(|k| excitation.values.iter().map(move |joint| joint[k])).collect();
    let input = Input { time: &excitation.time, command: &command, intersample: Intersample::ZeroOrder };
    let first: Vec<f64> = free.iter().map(|&joint| start[joint]).collect();
    let options = simulate::Options { steps: simulate::Steps::EXACT, ..simulate::Options::default() };
    let trajectory = simulate::simulate(system, &input, &first, &options)?;
    let rows = |values: &[f64]| values.chunks_exact(free.len()).map(<[f64]>::to_vec).collect();
    Ok(Path::of_speeds(&excitation.time, rows(&trajectory.q), rows(&trajectory.dq)))
}

/// Where the expected motion leaves limits.
fn beyond(path: &Path, needed: &[Vec<f64>], drive: Option<&Drive>, free: &[usize], limits: &Limits) -> Vec<String> {
    /// What the search's own sampling may miss.
    const SLACK: f64 = 1.02;
    let mut notes = Vec::new();
    for (slot, &joint) in free.iter().enumerate() {
        let [low, high] = limits.position[slot];
        let out = path.q.iter().position(|q| !(low..=high).contains(&q[slot]));
        if let Some(sample) = out {
            notes.push(format!(
                "joint {joint} would leave its limits of position, {low:.4} to {high:.4}, at {} s",
                path.time[sample]
            ));
        }
        let fastest = path.dq.iter().fold(0.0_f64, |fastest, dq| fastest.max(dq[slot].abs()));
        if fastest > SLACK * limits.speed[slot] {
            notes.push(format!(
                "joint {joint} would reach {fastest:.4}, its limit of speed is {:.4}",
                limits.speed[slot]
            ));
        }
        if let Some(drive) = drive {
            let largest = needed.iter().fold(0.0_f64, |largest, torque| largest.max(drive.command(torque)[slot].abs()));
            if largest > SLACK * limits.torque[slot] {
                notes.push(format!(
                    "joint {joint} would need a command of {largest:.4}, its limit is {:.4}",
                    limits.torque[slot]
                ));
            }
        }
    }
    notes
}

fn joints(free: &[usize]) -> String {
    free.iter().map(usize::to_string).collect::<Vec<_>>().join(",")
}

fn quantity(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::Torque => "torques",
        Quantity::Position => "positions",
    }
}

fn name_of(value: impl ValueEnum) -> String {
    value.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
}

fn unit(device: &Device, joint: usize, what: Quantity) -> String {
    match (what, device.joints[joint].kind) {
        (Quantity::Torque, _) => device.joints[joint].command_unit.clone(),
        (Quantity::Position, JointKind::Revolute) => "rad".to_owned(),
        (Quantity::Position, JointKind::Prismatic) => "m".to_owned(),
    }
}

fn as_text(device: &Device, planned: &Planned, file: &str) -> String {
    let excitation = &planned.excitation;
    let duration_s = excitation.time.last().copied().unwrap_or(0.0);
    let rate = (excitation.time.len() - 1) as f64 / duration_s;
    let mut text = format!(
        "{}: {}; {} of {} samples, {duration_s} s at {rate:.0} Hz\n\n",
        device.id,
        planned.title,
        quantity(excitation.quantity),
        excitation.time.len()
    );
    let mut table = Table::new(&[
        ("joint", Align::Right),
        ("largest command", Align::Right),
        ("", Align::Left),
        ("expected from", Align::Right),
        ("to", Align::Right),
        ("fastest", Align::Right),
    ]);
    let known = |value: f64| if value.is_finite() { format!("{value:.4}") } else { "-".to_owned() };
    for (slot, (&joint, peak)) in excitation.free.iter().zip(excitation.peaks()).enumerate() {
        let column = |rows: &[Vec<f64>], fold: fn(f64, f64) -> f64, start: f64| {
            rows.iter().map(|row| row[slot]).fold(start, fold)
        };
        let [low, high, fastest] = planned.path.as_ref().map_or([f64::NAN; 3], |path| {
            [
                column(&path.q, f64::min, f64::INFINITY),
                column(&path.q, f64::max, f64::NEG_INFINITY),
                column(&path.dq, |a, b| a.max(b.abs()), 0.0),
            ]
        });
        table.row([
            joint.to_string(),
            format!("{peak:.4}"),
            unit(device, joint, excitation.quantity),
            known(low),
            known(high),
            known(fastest),
        ]);
    }
    text.push_str(&table.text());
    if let Some(expected) = &planned.expected {
        let noise: Vec<String> = expected
            .noise
            .iter()
            .zip(&excitation.free)
            .map(|(noise, &joint)| {
                let unit = match device.joints[joint].kind {
                    JointKind::Revolute => "N*m",
                    JointKind::Prismatic => "N",
                };
                format!("{noise:.3e} {unit}")
            })
            .collect();
        let _ = write!(
            text,
            "\nErrors to be expected, one standard deviation, if the torques at the joints are known up to noise of {}:\n\n",
            noise.join(", ")
        );
        let mut errors = Table::new(&[
            ("base parameter", Align::Left),
            ("value", Align::Right),
            ("\u{b1}", Align::Right),
            ("%", Align::Right),
        ]);
        for error in &expected.errors {
            let percent = 100.0 * error.std_error / error.value.abs();
            errors.row([
                error.name.clone(),
                format!("{:.4e}", error.value),
                format!("{:.1e}", error.std_error),
                match percent {
                    percent if percent < 1000.0 => format!("{percent:.2}"),
                    percent if percent.is_finite() => "> 1000".to_owned(),
                    _ => "-".to_owned(),
                },
            ]);
        }
        text.push_str(&errors.text());
        let _ = writeln!(
            text,
            "\nlog det of the information {:.2}, condition number of the regressor {:.1}",
            expected.log_det, expected.condition
        );
    }
    if let Some(ratio) = &planned.ratio {
        text.push_str(&ratio.text(device, &excitation.free));
    }
    for note in &planned.notes {
        let _ = writeln!(text, "note: {note}");
    }
    let start: Vec<String> = planned.start.iter().map(|position| format!("{:.6}", position + 0.0)).collect();
    let _ = write!(
        text,
        "\nTo simulate it first, name it in an experiment:\n\n[[run]]\nfile = \"{file}\"\nfree = [{}]\nrole = \"validate\"\nstart = [{}]\n",
        excitation.free.iter().map(usize::to_string).collect::<Vec<_>>().join(", "),
        start.join(", ")
    );
    if excitation.quantity == Quantity::Position {
        text.push_str("controller = \"controller.toml\"   # the gains P and D of all joints\n");
    }
    text
}

fn described(model: &Model, planned: &Planned, out: &std::path::Path, seed: u64) -> Value {
    let excitation = &planned.excitation;
    // JSON knows no infinity: an error that is not known is null
    let finite = |value: f64| Some(value).filter(|value| value.is_finite());
    let expected = planned.expected.as_ref();
    let errors: Vec<Value> = expected
        .map(|expected| expected.errors.as_slice())
        .unwrap_or_default()
        .iter()
        .map(|error| json!({ "name": error.name, "value": error.value, "std_error": finite(error.std_error) }))
        .collect();
    json!({
        "device": model.device.id,
        "out": out.display().to_string(),
        "what": planned.title,
        "quantity": quantity(excitation.quantity),
        "free": excitation.free,
        "n_samples": excitation.time.len(),
        "duration_s": excitation.time.last(),
        "peaks": excitation.peaks(),
        "start": planned.start,
        "seed": seed,
        "noise": expected.map(|expected| expected.noise.clone()),
        "log_det": expected.and_then(|expected| finite(expected.log_det)),
        "condition": expected.and_then(|expected| finite(expected.condition)),
        "expected": errors,
        "between": planned.ratio.as_ref().map(between::Ratio::json),
        "notes": planned.notes,
    })
}

/// Commands and expected positions of the free joints.
fn picture(device: &Device, planned: &Planned) -> String {
    let excitation = &planned.excitation;
    let mut curves = Vec::new();
    for (slot, &joint) in excitation.free.iter().enumerate() {
        let word = if excitation.quantity == Quantity::Torque { "torque" } else { "reference" };
        curves.push(Curve {
            title: format!("joint {joint}: {word}"),
            quantity: format!("{word} [{}]", unit(device, joint, excitation.quantity)),
            time: excitation.time.clone(),
            values: excitation.values[joint].clone(),
        });
        if let (Some(path), Quantity::Torque) = (&planned.path, excitation.quantity) {
            curves.push(Curve {
                title: format!("joint {joint}: position that the model expects"),
                quantity: format!("position [{}]", unit(device, joint, Quantity::Position)),
                time: path.time.clone(),
                values: path.q.iter().map(|q| q[slot]).collect(),
            });
        }
    }
    plot::curves(&curves)
}

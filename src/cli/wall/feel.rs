//! `dynid wall feel`: what a hand feels of the device itself, bare and carried by the identified model.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::bail;
use dynid_control::{CompensationRatios, Holding, largest_inertia_share};
use dynid_files::{Overwrite, check_output, write_new};
use dynid_haptics::{
    rendered_impedance::Impedance, rendered_impedance::JointImpedance, rendered_impedance::Options,
    rendered_impedance::Survey, rendered_impedance::survey,
};
use dynid_haptics::{wall::Hand, wall::Setting};
use dynid_report::{plot::steps::Steps, plot::steps::standalone};
use dynid_user_model::Model;
use serde_json::{Value, json};

use super::super::inputs::of_device;
use super::super::table::{Align, Table};
use super::{Answer, Outcome};

/// Where a hand's slow motion ends (Hz).
const BAND: (f64, f64) = (0.0, 2.0);

#[derive(clap::Args)]
pub struct Arguments {
    /// The model that the controller believes; without it, the default model of the setting's device. Where it states standard
    /// errors, models that are off by them are tried too.
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// The device that is felt, as a model of its own; without it, the believed model is right.
    #[arg(long, value_name = "FILE")]
    pub plant: Option<PathBuf>,
    /// The free joints; without them, the largest configuration of the device.
    #[arg(long, value_delimiter = ',', value_name = "JOINTS")]
    free: Option<Vec<usize>>,
    /// At which frequencies (Hz).
    #[arg(long, value_delimiter = ',', value_name = "HZ")]
    frequencies: Option<Vec<f64>>,
    /// How far the hand moves a joint to either side [rad or m].
    #[arg(long, value_name = "A", default_value_t = 0.2)]
    amplitude: f64,
    /// Share of the inertia that is carried, 0 to 1.
    #[arg(long, value_name = "SHARE", default_value_t = CompensationRatios::default().inertia)]
    inertia: f64,
    /// Share of the friction that is carried, 0 to 1.
    #[arg(long, value_name = "SHARE", default_value_t = CompensationRatios::default().friction)]
    friction: f64,
    /// Rate of the controller (Hz).
    #[arg(long, value_name = "HZ", default_value_t = 1000.0)]
    rate: f64,
    /// One count of the encoders [rad or m]; 0 for exact ones.
    #[arg(long, value_name = "STEP", default_value_t = 1e-4)]
    quantum: f64,
    /// Poles of the filter that estimates the motion (Hz).
    #[arg(long, value_name = "HZ", default_value_t = 20.0)]
    bandwidth: f64,
    /// How many models that are off by their standard errors.
    #[arg(long, value_name = "N", default_value_t = 4)]
    draws: usize,
    /// What they are drawn from.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Where to draw a picture (SVG).
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Overwrite the output if it is there.
    #[arg(long)]
    force: bool,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let overwrite = Overwrite::if_forced(arguments.force);
    if let Some(out) = &arguments.out {
        check_output(out, overwrite)?;
    }
    let setting = Setting::shipped()?;
    let controller_model = match &arguments.model {
        Some(path) => Model::load(path)?,
        None => Model::of_device(setting.device),
    };
    let plant = match &arguments.plant {
        Some(path) => {
            let model = Model::load(path)?;
            of_device(&model, path, controller_model.device, "the model that the controller believes")?;
            model
        }
        None => controller_model.clone(),
    };
    let device = controller_model.device;
    let largest = device.configurations.iter().map(|configuration| &configuration.free).max_by_key(|free| free.len());
    let mut free = match (&arguments.free, largest) {
        (Some(free), _) => free.clone(),
        (None, Some(free)) => free.clone(),
        (None, None) => bail!("device `{}` has no configuration", device.id),
    };
    free.sort_unstable();
    free.dedup();
    if !(arguments.rate > 0.0 && arguments.rate.is_finite()) {
        bail!("--rate takes a positive number of ticks a second");
    }
    let usual = Options::new(device.joints.len());
    let mut frequencies = arguments.frequencies.clone().unwrap_or_else(|| usual.frequencies.clone());
    frequencies.sort_by(f64::total_cmp);
    let options = Options {
        frequencies,
        amplitude: arguments.amplitude,
        sample_s: 1.0 / arguments.rate,
        quantum: arguments.quantum,
        bandwidth_hz: arguments.bandwidth,
        inertia_share: arguments.inertia,
        friction_share: arguments.friction,
        draws: arguments.draws,
        seed: arguments.seed,
        ..usual
    };
    let survey = survey(&plant, &controller_model, &free, &options)?;
    let borne = setting.device.is_same_as(device).then(|| borne(&survey, &setting)).flatten();
    let mut text = as_text(&survey);
    if let Some((typical, worst)) = borne {
        let _ = writeln!(
            text,
            "joint {}: by linear analysis the setting's hand bears a share of {typical:.2} of the inertia, the worst of {} hands \
             like it {worst:.2}; {:.2} was asked for",
            setting.joint, setting.hands, options.inertia_share
        );
    }
    if let Some(out) = &arguments.out {
        write_new(out, &standalone(&pictures(&survey)), overwrite)?;
        let _ = writeln!(text, "written: {}", out.display());
    }
    let joints: Vec<Value> = survey
        .joints
        .iter()
        .map(|joint| {
            let JointImpedance { joint: index, bare, carried, drawn } = joint;
            let worst = joint.worst(BAND.0, BAND.1);
            json!({ "joint": index, "bare": bare, "carried": carried, "drawn": drawn, "left": worst })
        })
        .collect();
    let hands = borne.map(|(typical, worst)| json!({ "joint": setting.joint, "typical": typical, "worst": worst }));
    let json = json!({ "options": survey.options, "joints": joints, "share_borne": hands });
    Ok(Outcome { text, json, answer: Answer::Yes })
}

/// The share of the inertia of the setting's joint that its hand bears, and the worst of the hands like it.
fn borne(survey: &Survey, setting: &Setting) -> Option<(f64, f64)> {
    let joint = survey.joints.iter().find(|joint| joint.joint == setting.joint)?;
    let fastest = joint.bare.last()?;
    let Options { sample_s, bandwidth_hz, delay_samples, .. } = survey.options;
    // Friction helps where it slides; none is counted on.
    let of = |hand: &Hand| {
        let holding = Holding {
            inertia: hand.inertia,
            grip_stiffness: hand.grip_stiffness,
            grip_damping: hand.grip_damping,
            arm_stiffness: hand.arm_stiffness,
            arm_damping: hand.arm_damping,
        };
        largest_inertia_share((fastest.inertia, 0.0), Some(&holding), sample_s, bandwidth_hz, delay_samples)
    };
    let hands = setting.hand.population(setting.spread, setting.hands, setting.seed);
    Some((of(&setting.hand), hands.iter().map(of).fold(1.0, f64::min)))
}

/// What is left of a bare value, in per cent.
fn left(own: f64, bare: f64) -> String {
    format!("{:.0} %", 100.0 * own / bare)
}

fn as_text(survey: &Survey) -> String {
    let options = &survey.options;
    let mut text = format!(
        "carried: gravity, springs, {:.0} % of the inertia, {:.0} % of the friction; controller at {:.0} Hz, counts of {:.0e}, the \
         hand moves one joint by {} to either side\n",
        100.0 * options.inertia_share,
        100.0 * options.friction_share,
        1.0 / options.sample_s,
        options.quantum,
        options.amplitude
    );
    let mut table = Table::new(&[
        ("joint", Align::Right),
        ("Hz", Align::Right),
        ("inertia, bare", Align::Right),
        ("left", Align::Right),
        ("model off", Align::Right),
        ("friction, bare", Align::Right),
        ("left", Align::Right),
        ("model off", Align::Right),
    ]);
    for joint in &survey.joints {
        for (index, (bare, carried)) in joint.bare.iter().zip(&joint.carried).enumerate() {
            let off = |value: fn(&Impedance) -> f64| {
                let drawn = joint.drawn.iter().map(|drawn| value(&drawn[index]));
                let worst = drawn.reduce(|worst, own| if own.abs() > worst.abs() { own } else { worst });
                worst.map_or_else(|| "-".to_owned(), |worst| left(worst, value(bare)))
            };
            table.row([
                joint.joint.to_string(),
                format!("{}", bare.frequency_hz),
                format!("{:.2e}", bare.inertia),
                left(carried.inertia, bare.inertia),
                off(|impedance| impedance.inertia),
                format!("{:.2e}", bare.damping),
                left(carried.damping, bare.damping),
                off(|impedance| impedance.damping),
            ]);
        }
    }
    text.push_str(&table.text());
    let off = match survey.joints.first().map_or(0, |joint| joint.drawn.len()) {
        0 => "the model states no standard errors".to_owned(),
        draws => format!("the worst of {draws} models off by their standard errors"),
    };
    let _ = writeln!(
        text,
        "inertia in kg*m^2 or kg; friction as the damping that takes as much, in N*m*s/rad or N*s/m; below 0 the device pushes \
         the hand on; model off: {off}"
    );
    for joint in &survey.joints {
        let worst = joint.worst(BAND.0, BAND.1);
        let both = |one: f64, other: f64| {
            format!("{:.0} % of its inertia and {:.0} % of its friction", 100.0 * one, 100.0 * other)
        };
        let _ = write!(text, "joint {}: up to 2 Hz at most {}", joint.joint, both(worst.inertia, worst.damping));
        if let (Some(inertia), Some(damping)) = (worst.inertia_drawn, worst.damping_drawn) {
            let _ = write!(text, "; with the model off, {}", both(inertia, damping));
        }
        text.push('\n');
    }
    text
}

/// Two pictures a joint, inertia and friction over frequency.
fn pictures(survey: &Survey) -> Vec<Steps> {
    type Quantity = (&'static str, &'static str, fn(&Impedance) -> f64);
    let values: [Quantity; 2] = [
        ("inertia", "size [kg*m^2 or kg]", |impedance| impedance.inertia),
        ("friction", "size [N*m*s/rad or N*s/m]", |impedance| impedance.damping),
    ];
    let of = |joint: &JointImpedance| {
        let rungs: Vec<String> = joint.bare.iter().map(|impedance| format!("{} Hz", impedance.frequency_hz)).collect();
        values.map(|(name, quantity, value)| {
            let sizes =
                |own: &[Impedance]| own.iter().map(|impedance| Some(value(impedance).abs())).collect::<Vec<_>>();
            let mut series =
                vec![("bare".to_owned(), sizes(&joint.bare)), ("carried".to_owned(), sizes(&joint.carried))];
            let drawn: Vec<Option<f64>> = (0..rungs.len())
                .map(|index| joint.drawn.iter().map(|drawn| value(&drawn[index]).abs()).reduce(f64::max))
                .collect();
            if drawn.iter().any(Option::is_some) {
                series.push(("model off".to_owned(), drawn));
            }
            // A logarithm has no sign.
            let pushed: Vec<&str> = joint
                .carried
                .iter()
                .zip(&rungs)
                .filter(|(impedance, _)| value(impedance) < 0.0)
                .map(|(_, rung)| &**rung)
                .collect();
            let sign = if pushed.is_empty() { String::new() } else { format!("; below 0 at {}", pushed.join(", ")) };
            Steps {
                title: format!("joint {}: felt {name}{sign}", joint.joint),
                quantity: quantity.to_owned(),
                rungs: rungs.clone(),
                series,
                floor: None,
            }
        })
    };
    survey.joints.iter().flat_map(of).collect()
}

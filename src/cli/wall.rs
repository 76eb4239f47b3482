//! `dynid wall`: touch a virtual wall.

mod feel;
mod space;

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, bail};
use clap::{Subcommand, ValueEnum};
use dynid::Done;
use dynid_control::{Law, Wall};
use dynid_files::{Overwrite, check_output, write_new};
use dynid_format::number;
use dynid_haptics::{
    wall, wall::Approach, wall::Case, wall::Contact, wall::Goal, wall::Measures, wall::OwnDamping, wall::Setting,
    wall::TuneProgress, wall::WallFile,
};
use dynid_model::Device;
use dynid_report::{Provenance, Section, WallReport, damping_in_words};
use dynid_user_model::Model;
use serde_json::json;

use super::table::{Align, Table};
use super::table_file::{format_of, log_file};
use super::{Answer, Outcome, progress};

/// Touch a virtual wall: a sampled controller, the identified device, and hands of many kinds.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid wall compare                                  the walls that the program carries, under 16 hands at three speeds
  dynid wall compare --model fitted.toml --wall mine.toml
  dynid wall run --wall fuzzy --speed fast --out contact.csv
  dynid wall tune --law rules --out tuned.toml        a monotone rule table, by an evolution strategy
  dynid wall report --wall pd,fuzzy --out wall.html   a page with pictures: torque surfaces, contacts, chatter of every hand
  dynid wall space --compensate --out space.html      the whole device in a hand, at a plane; the model carries its weight
  dynid wall feel --model fitted.toml --out felt.svg  what a hand feels of the device with and without its model

A setting file says which joint of which device meets the wall, how the controller is sampled and who moves the handle;
without one it is the thesis's. `dynid wall show setting` and `dynid wall show fuzzy` print what the program carries, to start
from.")]
pub struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Walls under the same hands.
    Compare(CompareArguments),
    /// One hand's approach to one wall.
    Run(RunArguments),
    /// A better wall, found by trying it under many hands, on a device whose drive delivers up to 1.3 times what is commanded. Of a
    /// model that states standard errors, models are tried that are off by them, each parameter by itself: its file has no
    /// covariances, so what only a combination of parameters determines scatters more than the fit allows.
    Tune(TuneArguments),
    /// Walls under the same hands, as a page that opens with no network.
    Report(ReportArguments),
    /// A setting or a wall that the program carries, as a file.
    Show(ShowArguments),
    /// The whole device in a hand, at a wall that is a plane in space.
    Space(space::Arguments),
    /// What a hand feels of the device itself: inertia and friction over frequency, bare and carried by the model.
    Feel(feel::Arguments),
}

/// Where, and who.
#[derive(clap::Args)]
struct Where {
    /// The setting; without it, the program's own (`dynid wall show setting` or `space` prints it).
    #[arg(long, value_name = "FILE")]
    setting: Option<PathBuf>,
    /// The model of the device; without it, the device's default.
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// As many hands, instead of the setting's number.
    #[arg(long, value_name = "N")]
    hands: Option<usize>,
    /// What the hands are drawn from, instead of the setting's seed.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
}

#[derive(clap::Args)]
struct CompareArguments {
    #[command(flatten)]
    place: Where,
    /// Walls: names of those that the program carries, or files; without any, the thesis's, their like, and what was tuned.
    #[arg(long, value_delimiter = ',', value_name = "WALLS")]
    wall: Option<Vec<String>>,
    /// All walls that the program carries: also one behind a virtual coupling, a passive and a leaky one.
    #[arg(long, conflicts_with = "wall")]
    all: bool,
}

#[derive(clap::Args)]
struct RunArguments {
    #[command(flatten)]
    place: Where,
    /// The wall: a name of one that the program carries, or a file.
    #[arg(long, value_name = "WALL", default_value = "pd")]
    wall: String,
    /// Which approach of the setting; without it, its first.
    #[arg(long, value_name = "NAME")]
    speed: Option<String>,
    /// Which hand, from 0; without it, the typical one.
    #[arg(long, value_name = "N")]
    hand: Option<usize>,
    /// Where to write what happened at every tick: .csv, .parquet or .arrow.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Overwrite the output if it is there.
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// A monotone rule table.
    Rules,
    /// A spring and a damper.
    Linear,
    /// A wall behind a virtual coupling.
    Coupled,
    /// A spring that gives back less than it took, and a damper.
    Leaky,
}

#[derive(clap::Args)]
struct TuneArguments {
    #[command(flatten)]
    place: Where,
    /// What is tuned.
    #[arg(long, value_enum, default_value = "rules")]
    law: Kind,
    /// Static stiffness that the wall should have [N*m/rad or N/m].
    #[arg(long, value_name = "K", default_value_t = 6.6)]
    stiffness: f64,
    /// A wall to start from: the name of one that the program carries, or a file. Every law starts from a wall of gains, a
    /// coupling or a leaky spring also from one of its kind; rules start from no rules. Without it, gains that suit the stiffness.
    #[arg(long, value_name = "WALL")]
    start: Option<String>,
    /// About as many walls are tried: the search ends with a whole generation.
    #[arg(long, value_name = "N", default_value_t = 400)]
    evaluations: usize,
    /// Where to write the wall.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Overwrite the output if it is there.
    #[arg(long)]
    force: bool,
}

#[derive(clap::Args)]
struct ReportArguments {
    #[command(flatten)]
    place: Where,
    /// Walls: names of those that the program carries, or files; the first is what the others are compared with. Without any,
    /// all that it carries.
    #[arg(long, value_delimiter = ',', value_name = "WALLS")]
    wall: Option<Vec<String>>,
    /// The page to write (HTML).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Overwrite the page if it is there.
    #[arg(long)]
    force: bool,
}

#[derive(clap::Args)]
struct ShowArguments {
    /// `setting`, `space` (the setting with a plane), or the name of a wall.
    name: String,
}

impl Arguments {
    /// The models and settings that are read.
    pub fn files(&self) -> Vec<&Path> {
        match &self.verb {
            Verb::Compare(own) => own.place.files(),
            Verb::Run(own) => own.place.files(),
            Verb::Tune(own) => own.place.files(),
            Verb::Report(own) => own.place.files(),
            Verb::Space(own) => own.place.files(),
            Verb::Feel(own) => own.model.iter().chain(&own.plant).map(PathBuf::as_path).collect(),
            Verb::Show(_) => Vec::new(),
        }
    }
}

/// Does what is asked.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match &arguments.verb {
        Verb::Compare(arguments) => compare(arguments),
        Verb::Run(arguments) => contact(arguments),
        Verb::Tune(arguments) => tune(arguments),
        Verb::Report(arguments) => report(arguments),
        Verb::Show(arguments) => show(arguments),
        Verb::Space(arguments) => space::run(arguments),
        Verb::Feel(arguments) => feel::run(arguments),
    }
}

impl Where {
    fn files(&self) -> Vec<&Path> {
        self.model.iter().chain(&self.setting).map(PathBuf::as_path).collect()
    }

    fn setting(&self) -> anyhow::Result<Setting> {
        let mut setting = match &self.setting {
            Some(path) => Setting::load(path)?,
            None => Setting::shipped()?,
        };
        if let Some(hands) = self.hands {
            check_hands(hands)?;
            setting.hands = hands;
        }
        if let Some(seed) = self.seed {
            setting.seed = seed;
        }
        Ok(setting)
    }

    /// The options that were given, as they stand in a command.
    fn as_text(&self) -> String {
        let Self { setting, model, hands, seed } = self;
        let mut text = String::new();
        for (option, path) in [("setting", setting), ("model", model)] {
            if let Some(path) = path {
                let _ = write!(text, " --{option} {}", path.display());
            }
        }
        for (option, value) in [("hands", hands.map(|hands| hands as u64)), ("seed", *seed)] {
            if let Some(value) = value {
                let _ = write!(text, " --{option} {value}");
            }
        }
        text
    }

    fn model(&self, setting: &Setting) -> anyhow::Result<Model> {
        model_of(self.model.as_deref(), setting.device)
    }
}

fn check_hands(hands: usize) -> anyhow::Result<()> {
    if !(1..=Setting::MOST_HANDS).contains(&hands) {
        bail!("--hands {hands}: give a number from 1 to {}", Setting::MOST_HANDS);
    }
    Ok(())
}

/// The model of a file, which must be of the setting's device; or the device's own.
pub(super) fn model_of(path: Option<&Path>, device: &'static Device) -> anyhow::Result<Model> {
    let Some(path) = path else { return Ok(Model::of_device(device)) };
    let model = Model::load(path)?;
    super::inputs::of_device(&model, path, device, "the setting")?;
    Ok(model)
}

/// A wall by its name or its file; a file's name is that of the wall.
pub(super) fn wall_of(asked: &str) -> anyhow::Result<(String, WallFile)> {
    let path = Path::new(asked);
    if path.extension().is_none_or(|extension| extension != "toml") {
        return Ok((asked.to_owned(), wall::shipped(asked)?));
    }
    let name = path.file_stem().map_or_else(|| asked.to_owned(), |stem| stem.to_string_lossy().into_owned());
    Ok((name, WallFile::load(path)?))
}

/// The walls that were asked for; without any, these.
fn or(asked: Option<&[String]>, usual: impl Iterator<Item = (&'static str, &'static str)>) -> Vec<String> {
    asked.map_or_else(|| usual.map(|(name, _)| name.to_owned()).collect(), <[String]>::to_vec)
}

fn compare(arguments: &CompareArguments) -> anyhow::Result<Outcome> {
    let setting = arguments.place.setting()?;
    let model = arguments.place.model(&setting)?;
    let asked = match &arguments.wall {
        None if arguments.all => or(None, wall::library()),
        asked => or(asked.as_deref(), wall::SHIPPED.into_iter()),
    };
    let mut walls: Vec<(String, Wall)> = Vec::new();
    for asked in &asked {
        let (name, file) = wall_of(asked)?;
        if walls.iter().any(|(other, _)| *other == name) {
            bail!("--wall: two walls are named `{name}`; rename the file of one");
        }
        walls.push((name, file.wall(&setting)?));
    }
    let cases = wall::compare(&model, &setting, &walls)?;
    let never = walls.len() * setting.approaches.len() * setting.hands - cases.len();
    if never > 0 {
        say!("note: {never} approaches never came to the wall and are left out: start nearer, or aim further");
    }
    let text = as_text(&setting, &walls, &cases, &wall::own_damping(&model, &setting)?);
    Ok(Outcome { text, json: json!({ "cases": cases }), answer: Answer::Yes })
}

/// A row for each wall and approach: the median hand, and the worst where that matters.
fn as_text(setting: &Setting, walls: &[(String, Wall)], cases: &[Case], own: &OwnDamping) -> String {
    let mut text = format!(
        "joint {} of {}, {} hands, controller at {} Hz\n",
        setting.joint,
        setting.device.id,
        setting.hands,
        number(1.0 / setting.sample_s)
    );
    let mut table = Table::new(&[
        ("wall", Align::Left),
        ("approach", Align::Left),
        ("chatter, mrad rms", Align::Right),
        ("worst", Align::Right),
        ("peak to peak", Align::Right),
        ("Hz", Align::Right),
        ("settled, mrad", Align::Right),
        ("stiffness", Align::Right),
        ("energy out, mJ", Align::Right),
        ("outside", Align::Right),
    ]);
    for (name, _) in walls {
        for approach in &setting.approaches {
            let of: Vec<&Measures> = cases
                .iter()
                .filter(|case| case.controller == *name && case.speed == approach.name)
                .map(|case| &case.measures)
                .collect();
            let median =
                |value: &dyn Fn(&Measures) -> f64| wall::median(of.iter().map(|measures| value(measures)).collect());
            let most = |value: &dyn Fn(&Measures) -> f64| {
                of.iter().map(|measures| value(measures)).reduce(f64::max).unwrap_or(f64::NAN)
            };
            table.row([
                name.clone(),
                approach.name.clone(),
                fixed(1e3 * median(&|m| m.chatter_rms), 3, ""),
                fixed(1e3 * most(&|m| m.chatter_rms), 3, ""),
                fixed(1e3 * median(&|m| m.peak_to_peak), 2, ""),
                fixed(median(&|m| m.frequency), 1, ""),
                fixed(1e3 * median(&|m| m.settled_position), 1, ""),
                fixed(median(&|m| m.stiffness), 2, ""),
                fixed(1e3 * most(&|m| m.energy_out), 2, ""),
                fixed(100.0 * most(&|m| m.outside), 0, " %"),
            ]);
        }
    }
    text.push_str(&table.text());
    text.push_str("medians over the hands; energy out and time outside are those of the worst hand\n");
    for (name, _) in &walls[1..] {
        let ratios = wall::chatter_ratios(cases, name, &walls[0].0);
        let Some(least) = ratios.iter().copied().reduce(f64::min) else {
            let _ = writeln!(text, "{name}: no hand met both it and {}", walls[0].0);
            continue;
        };
        let _ = writeln!(
            text,
            "{name}: {:.1} times less chatter than {} in the median, {least:.1} at worst",
            wall::median(ratios),
            walls[0].0
        );
    }
    let bounds: Vec<(&String, f64)> =
        walls.iter().filter_map(|(name, wall)| Some((name, wall::passive_above(wall, setting.sample_s)?))).collect();
    for (name, bound) in &bounds {
        let _ = writeln!(
            text,
            "{name}: passive whoever touches it only if the device itself damps with more than {} (K T / 2 + B, Colgate & \
             Schenkel 1997; filter and delay ask for more)",
            number(*bound)
        );
    }
    if !bounds.is_empty() {
        let _ = writeln!(text, "{}", damping_in_words(own, setting));
    }
    text
}

/// A number and its unit; a dash where there is none.
fn fixed(value: f64, decimals: usize, unit: &str) -> String {
    if value.is_finite() { format!("{value:.decimals$}{unit}") } else { number(value) }
}

fn contact(arguments: &RunArguments) -> anyhow::Result<Outcome> {
    let overwrite = Overwrite::if_forced(arguments.force);
    if let Some(out) = &arguments.out {
        format_of(out)?;
        check_output(out, overwrite)?;
    }
    let setting = arguments.place.setting()?;
    let model = arguments.place.model(&setting)?;
    let (name, file) = wall_of(&arguments.wall)?;
    let speed = arguments.speed.as_deref();
    let Played { contact, measures, felt: json } = played(&model, &setting, (&name, &file), speed, arguments.hand)?;
    let approach = approach_of(&setting, speed)?;
    let mut text = format!("{}, {} approach\n", file.title, approach.name);
    let _ = writeln!(
        text,
        "  chatter {:.3} mrad rms, {:.2} mrad peak to peak at {:.1} Hz; settled at {:.1} mrad; {:.2} mJ given out; {:.0} % of the \
         time outside",
        1e3 * measures.chatter_rms,
        1e3 * measures.peak_to_peak,
        measures.frequency,
        1e3 * measures.settled_position,
        1e3 * measures.energy_out,
        100.0 * measures.outside
    );
    if let Some(out) = &arguments.out {
        // Rounded far below what is felt: short in a text.
        let rounded = |value: f64| (value * 1e9).round() / 1e9;
        let column = |name: &str, values: &[f64]| (name.to_owned(), values.iter().map(|v| rounded(*v)).collect());
        let t: Vec<f64> = (0..contact.position.len()).map(|tick| tick as f64 * contact.sample_s).collect();
        let columns = vec![
            column("t", &t),
            column("q", &contact.position),
            column("dq", &contact.velocity),
            column("tau", &contact.torque),
        ];
        write_new(out, &log_file(columns, format_of(out)?), overwrite)?;
        let _ = writeln!(text, "written: {}", out.display());
    }
    Ok(Outcome { text, json, answer: Answer::Yes })
}

/// One hand's approach to one wall.
pub(super) struct Played {
    pub contact: Contact,
    pub measures: Measures,
    /// What `dynid wall run --json` prints.
    pub felt: serde_json::Value,
}

/// Plays it; without a hand's number the typical one, without a speed the first of the setting.
pub(super) fn played(
    model: &Model,
    setting: &Setting,
    (name, file): (&str, &WallFile),
    speed: Option<&str>,
    hand: Option<usize>,
) -> anyhow::Result<Played> {
    let wall = file.wall(setting)?;
    let approach = approach_of(setting, speed)?;
    let own = match hand {
        None => setting.hand,
        Some(index) => {
            let hands = setting.hand.population(setting.spread, setting.hands, setting.seed);
            match hands.get(index) {
                Some(hand) => *hand,
                None => bail!("--hand {index}: the setting's hands are 0 to {}", hands.len() - 1),
            }
        }
    };
    let contact =
        wall::contact(model, setting, &wall, &own, approach).map_err(|error| error.in_case(name, approach, hand))?;
    let Some(measures) = Measures::of(&contact, &wall) else {
        bail!("the hand never comes to the wall: start nearer, or aim further");
    };
    let felt = json!({ "wall": name, "speed": approach.name, "measures": measures });
    Ok(Played { contact, measures, felt })
}

fn approach_of<'a>(setting: &'a Setting, speed: Option<&str>) -> anyhow::Result<&'a Approach> {
    let Some(asked) = speed else { return Ok(&setting.approaches[0]) };
    let names: Vec<&str> = setting.approaches.iter().map(|approach| approach.name.as_str()).collect();
    let found = setting.approaches.iter().find(|approach| approach.name == asked);
    found.with_context(|| format!("--speed {asked}: the setting's approaches are {}", names.join(", ")))
}

fn tune(arguments: &TuneArguments) -> anyhow::Result<Outcome> {
    let overwrite = Overwrite::if_forced(arguments.force);
    check_output(&arguments.out, overwrite)?;
    if !(arguments.stiffness > 0.0 && arguments.stiffness.is_finite()) {
        bail!("--stiffness takes a positive number [N*m/rad or N/m]");
    }
    let mut setting = arguments.place.setting()?;
    // Tuned on other hands than those that judge.
    setting.seed = arguments.place.seed.unwrap_or(setting.seed + 1000);
    let model = arguments.place.model(&setting)?;
    let (family, scale) = start(arguments)?;
    let goal = Goal {
        stiffness: arguments.stiffness,
        outside: 0.03,
        energy_out: 4e-3,
        evaluations: arguments.evaluations.max(1),
        seed: setting.seed,
        drive: 1.3,
    };
    let interrupt = super::interrupt::Interrupt::listen()?;
    let stopped = AtomicBool::new(false);
    let stop = || stopped.fetch_or(interrupt.is_asked(), Ordering::Relaxed) || interrupt.is_asked();
    let tuned = progress::counted("walls tried", &stop, |progress| {
        let reported =
            |reported: TuneProgress| progress(Done { done: reported.evaluations, of: goal.evaluations }).is_break();
        wall::tune(&model, &setting, &family, scale, &goal, &reported)
    })?;
    let errors = match &model.fit {
        Some(fit) if !fit.std_error.is_empty() => {
            "models that are off by the fit's standard errors (each parameter by itself: the record has no covariances)"
        }
        _ => "the model as it is",
    };
    let comment = format!(
        "Tuned by `{}`\non {} hands of seed {}, {errors}, and drives up to {} times the model's: {} walls tried, cost {:.3} at the \
         start, {:.3} at the end.",
        tuned_by(arguments),
        setting.hands,
        setting.seed,
        goal.drive,
        tuned.evaluations,
        tuned.cost_at_start,
        tuned.cost
    );
    write_new(&arguments.out, &tuned.wall.to_toml(&comment), overwrite)?;
    let answer = if stopped.load(Ordering::Relaxed) { Answer::Interrupted } else { Answer::Yes };
    let text = format!(
        "{} walls tried; cost {:.3}, {:.3} at the start\nwritten: {}\n",
        tuned.evaluations,
        tuned.cost,
        tuned.cost_at_start,
        arguments.out.display()
    );
    let json = json!({
        "cost": tuned.cost,
        "cost_at_start": tuned.cost_at_start,
        "evaluations": tuned.evaluations,
        "out": arguments.out.display().to_string(),
    });
    Ok(Outcome { text, json, answer })
}

/// What is varied, and where it starts: at a wall that was named, or at gains that suit the stiffness.
fn start(arguments: &TuneArguments) -> anyhow::Result<(wall::Family, f64)> {
    let own = arguments.start.as_ref().map(|asked| Ok::<_, anyhow::Error>((asked, wall_of(asked)?.1))).transpose()?;
    // A tuning multiplies.
    let positive = |asked: &str, numbers: &[(&str, f64)]| match numbers.iter().find(|(_, value)| *value <= 0.0) {
        Some((number, value)) => {
            bail!(
                "--start {asked}: {number} is {value}; a tuning multiplies numbers, so give a wall whose {number} is positive"
            )
        }
        None => Ok(()),
    };
    let (linear, scale) = match (&own, arguments.law) {
        (Some((asked, WallFile { passive: true, .. })), _) => {
            bail!(
                "--start {asked}: a passivity controller watches this wall, and a tuning plays none; give a wall without \
                 `passive = true`, and add it to what comes out"
            )
        }
        (None, _) => {
            let scale = wall::shipped("pd")?.scale;
            (wall::Family::linear_start(arguments.stiffness / scale), scale)
        }
        (Some((asked, WallFile { scale, law: Law::Linear(law), .. })), _) => {
            positive(asked, &[("k1", law.k1), ("k2", law.k2)])?;
            (*law, *scale)
        }
        (Some((_, WallFile { scale, law: Law::Coupled(tool), .. })), Kind::Coupled) => {
            return Ok((wall::Family::Coupled(*tool), *scale));
        }
        (Some((asked, WallFile { scale, law: Law::Leaky { linear, stiffness, share }, .. })), Kind::Leaky) => {
            positive(
                asked,
                &[("k1", linear.k1), ("k2", linear.k2), ("the leak's stiffness", *stiffness), ("share", *share)],
            )?;
            return Ok((wall::Family::Leaky { linear: *linear, stiffness: *stiffness, share: *share }, *scale));
        }
        (Some((asked, _)), _) => {
            bail!(
                "--start {asked}: a tuning starts from a wall of gains, [linear] without [rules] or [leak]; that of a coupling or \
                 a leaky spring also from one of its kind"
            )
        }
    };
    let family = match arguments.law {
        Kind::Linear => wall::Family::Linear(linear),
        Kind::Coupled => wall::Family::Coupled(wall::Family::coupled_start(&linear)),
        Kind::Leaky => wall::Family::Leaky { linear, stiffness: 1.0, share: 0.3 },
        Kind::Rules => {
            let Law::Rules(table) = wall::shipped("fuzzy")?.law else { bail!("the shipped fuzzy wall has no rules") };
            wall::Family::Rules { position: table.position().clone(), velocity: table.velocity().clone(), linear }
        }
    };
    Ok((family, scale))
}

/// The command that makes the same file again.
fn tuned_by(arguments: &TuneArguments) -> String {
    let law = arguments.law.to_possible_value().map_or_else(String::new, |law| law.get_name().to_owned());
    let mut command = format!("dynid wall tune --law {law}{}", arguments.place.as_text());
    if let Some(start) = &arguments.start {
        let _ = write!(command, " --start {start}");
    }
    let TuneArguments { stiffness, evaluations, out, .. } = arguments;
    let _ = write!(command, " --stiffness {stiffness} --evaluations {evaluations} --out {}", out.display());
    command
}

fn report(arguments: &ReportArguments) -> anyhow::Result<Outcome> {
    let overwrite = Overwrite::if_forced(arguments.force);
    check_output(&arguments.out, overwrite)?;
    let setting = arguments.place.setting()?;
    let model = arguments.place.model(&setting)?;
    let asked = or(arguments.wall.as_deref(), wall::library());
    let walls = asked.iter().map(|asked| wall_of(asked)).collect::<anyhow::Result<Vec<(String, WallFile)>>>()?;
    let report = WallReport::new(&model, &setting, &walls)?;
    let mut sections = report.sections();
    let mut command = format!("dynid wall report{}", arguments.place.as_text());
    if arguments.wall.is_some() {
        let _ = write!(command, " --wall {}", asked.join(","));
    }
    let _ = write!(command, " --out {}", arguments.out.display());
    sections.push(Box::new(came_from(command, &arguments.place, wall::SETTING, &model, &asked)?));
    let shown: Vec<&dyn Section> = sections.iter().map(Box::as_ref).collect();
    let title = format!("Touch a wall: joint {} of {}", setting.joint, setting.device.title);
    write_new(&arguments.out, &dynid_report::page(&title, &shown), overwrite)?;
    let sentences = report.sentences();
    let titles: Vec<&str> = shown.iter().map(|section| section.title()).collect();
    let text = format!("{}\nwritten: {}\n", sentences.join("\n"), arguments.out.display());
    let json = json!({
        "page": arguments.out.display().to_string(),
        "sentences": sentences,
        "sections": titles,
        "cases": report.cases(),
    });
    Ok(Outcome { text, json, answer: Answer::Yes })
}

/// What a page was made of, to the byte, and by which command; `shipped` is the setting where none is named.
fn came_from(
    command: String,
    place: &Where,
    shipped: &str,
    model: &Model,
    asked: &[String],
) -> anyhow::Result<Provenance> {
    let text_of =
        |path: &Path| dynid_model::document::read_text(path).with_context(|| format!("cannot read {}", path.display()));
    let digest = |text: &str| format!("sha256 {}", dynid_model::sha256_hex(text.as_bytes()));
    let Where { setting, model: model_path, .. } = place;
    let shown = |path: &Option<PathBuf>, without: &str| {
        path.as_ref().map_or_else(|| without.to_owned(), |path| path.display().to_string())
    };
    let setting_text = setting.as_ref().map_or_else(|| Ok(shipped.to_owned()), |path| text_of(path))?;
    let mut entries = vec![
        ("setting".to_owned(), format!("{}, {}", shown(setting, "the program's"), digest(&setting_text))),
        ("model".to_owned(), format!("{}, sha256 {}", shown(model_path, "the device's"), model.digest())),
    ];
    for asked in asked {
        let carried = wall::library().find(|(known, _)| known == asked);
        let text = carried.map_or_else(|| text_of(Path::new(asked)), |(_, text)| Ok(text.to_owned()))?;
        entries.push((format!("wall {asked}"), digest(&text)));
    }
    entries.push(("program".to_owned(), format!("dynid {}", env!("CARGO_PKG_VERSION"))));
    Ok(Provenance { entries, commands: vec![command] })
}

fn show(arguments: &ShowArguments) -> anyhow::Result<Outcome> {
    let name = arguments.name.as_str();
    let text = if name == "setting" {
        wall::SETTING
    } else if name == "space" {
        wall::space::SETTING
    } else {
        wall::shipped(name)?;
        wall::library().find(|(known, _)| *known == name).map_or("", |(_, text)| text)
    };
    Ok(Outcome { text: text.to_owned(), json: json!({ "name": name, "text": text }), answer: Answer::Yes })
}

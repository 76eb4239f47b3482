//! `dynid wall space`: the whole device in a hand meets a plane.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::bail;
use dynid_control::{CompensationRatios, Wall};
use dynid_files::{Overwrite, check_output, write_new};
use dynid_format::number;
use dynid_haptics::{wall::WallFile, wall::median};
use dynid_haptics::{wall::space, wall::space::Case, wall::space::Setting};
use dynid_model::JointKind;
use dynid_report::{Section, SpaceReport, carried_in_words};
use dynid_user_model::Model;
use serde_json::json;

use super::super::inputs;
use super::super::table::{Align, Table};
use super::{Answer, Outcome, Where, came_from, wall_of};

#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    pub place: Where,
    /// Walls: names of those that the program carries, or files.
    #[arg(long, value_delimiter = ',', value_name = "WALLS", default_value = "pd,pd_tuned,fuzzy_tuned")]
    wall: Vec<String>,
    /// The controller carries the device's weight by the model; without it, the hand does.
    #[arg(long)]
    compensate: bool,
    /// Share of the device's inertia that is carried too, 0 to 1; not every hand bears much.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, requires = "compensate")]
    inertia: f64,
    /// Share of the device's friction that is carried too, 0 to 1.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, requires = "compensate")]
    friction: f64,
    /// Where to write a page with pictures (HTML).
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Overwrite the page if it is there.
    #[arg(long)]
    force: bool,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let overwrite = Overwrite::if_forced(arguments.force);
    if let Some(out) = &arguments.out {
        check_output(out, overwrite)?;
    }
    let place = &arguments.place;
    let given = place.model.as_deref().map(|path| Ok::<_, anyhow::Error>((path, Model::load(path)?))).transpose()?;
    let mut setting = match &place.setting {
        Some(path) => Setting::load(path, given.as_ref().map(|(_, model)| model))?,
        None => Setting::shipped()?,
    };
    if let Some(hands) = place.hands {
        super::check_hands(hands)?;
        setting.people.count = hands;
    }
    setting.people.seed = place.seed.unwrap_or(setting.people.seed);
    let model = match given {
        Some((path, model)) => {
            inputs::of_device(&model, path, setting.device, "the setting")?;
            model
        }
        None => Model::of_device(setting.device),
    };
    let mut files: Vec<(String, WallFile)> = Vec::new();
    let mut walls: Vec<(String, Wall)> = Vec::new();
    for asked in &arguments.wall {
        let (name, file) = wall_of(asked)?;
        if walls.iter().any(|(other, _)| *other == name) {
            bail!("--wall: two walls are named `{name}`; rename the file of one");
        }
        walls.push((name.clone(), setting.wall(&file)?));
        files.push((name, file));
    }
    let shares = CompensationRatios { inertia: arguments.inertia, friction: arguments.friction };
    let carried = arguments.compensate.then_some(shares);
    let cases = space::compare(&model, &setting, &walls, carried)?;
    let never = walls.len() * setting.reaching.approaches.len() * setting.people.count - cases.len();
    if cases.is_empty() {
        bail!("no hand ever comes to the wall: start nearer, or aim further");
    }
    if never > 0 {
        say!("note: {never} approaches never came to the wall and are left out: start nearer, or aim further");
    }
    let mut text = as_text(&setting, &walls, &cases, carried);
    if let Some(out) = &arguments.out {
        let report = SpaceReport::new(&model, &setting, &walls, &cases, carried)?;
        let mut sections = report.sections();
        let mut command = format!("dynid wall space{}", place.as_text());
        if let Some(CompensationRatios { inertia, friction }) = carried {
            let _ = write!(command, " --compensate --inertia {inertia} --friction {friction}");
        }
        let _ = write!(command, " --wall {} --out {}", arguments.wall.join(","), out.display());
        sections.push(Box::new(came_from(command, place, space::SETTING, &model, &arguments.wall)?));
        let shown: Vec<&dyn Section> = sections.iter().map(Box::as_ref).collect();
        let title = format!("Touch a plane: {}", setting.device.title);
        write_new(out, &dynid_report::page(&title, &shown), overwrite)?;
        let _ = writeln!(text, "written: {}", out.display());
    }
    let json = json!({ "cases": cases, "carried": carried.map(|own| json!({ "inertia": own.inertia, "friction": own.friction })) });
    Ok(Outcome { text, json, answer: Answer::Yes })
}

/// A row for each wall and approach, the median hand; then how the joints moved.
fn as_text(setting: &Setting, walls: &[(String, Wall)], cases: &[Case], carried: Option<CompensationRatios>) -> String {
    let mut text = format!(
        "the end point of {} at a plane, {} hands, controller at {} Hz; {}\n",
        setting.device.id,
        setting.people.count,
        number(1.0 / setting.sampling.sample_s),
        carried_in_words(carried)
    );
    let right = |heading: &'static str| (heading, Align::Right);
    let mut table = Table::new(&[
        ("wall", Align::Left),
        ("approach", Align::Left),
        right("chatter, mm rms"),
        right("worst"),
        right("Hz"),
        right("settled, mm"),
        right("N/m"),
        right("energy out, mJ"),
        right("outside"),
        right("settled slip, mm"),
        right("turned, mrad"),
        right("limited"),
    ]);
    let unit = |joint: &usize| match setting.device.joints[*joint].kind {
        JointKind::Revolute => "mrad",
        JointKind::Prismatic => "mm",
    };
    let names: Vec<String> = setting.free.iter().map(|joint| format!("q{joint}, {}", unit(joint))).collect();
    let mut heads = vec![("wall", Align::Left), ("approach", Align::Left)];
    heads.extend(names.iter().map(|name| (name.as_str(), Align::Right)));
    let mut joints = Table::new(&heads);
    for (name, _) in walls {
        for approach in &setting.reaching.approaches {
            let of: Vec<&Case> =
                cases.iter().filter(|case| case.controller == *name && case.speed == approach.name).collect();
            if of.is_empty() {
                continue;
            }
            let middle = |value: &dyn Fn(&Case) -> f64| median(of.iter().map(|case| value(case)).collect());
            let most = |value: &dyn Fn(&Case) -> f64| of.iter().map(|case| value(case)).fold(0.0, f64::max);
            table.row([
                name.clone(),
                approach.name.clone(),
                format!("{:.3}", 1e3 * middle(&|case| case.measures.chatter_rms)),
                format!("{:.3}", 1e3 * most(&|case| case.measures.chatter_rms)),
                format!("{:.1}", middle(&|case| case.measures.frequency)),
                format!("{:.1}", 1e3 * middle(&|case| case.measures.settled_position)),
                format!("{:.1}", middle(&|case| case.measures.stiffness)),
                format!("{:.2}", 1e3 * most(&|case| case.measures.energy_out)),
                format!("{:.0} %", 100.0 * most(&|case| case.measures.outside)),
                format!("{:.1}", 1e3 * middle(&|case| case.coupling.settled_slip)),
                format!("{:.0}", 1e3 * middle(&|case| case.coupling.turned)),
                format!("{:.0} %", 100.0 * middle(&|case| case.coupling.limited)),
            ]);
            let mut cells = vec![name.clone(), approach.name.clone()];
            cells.extend(
                (0..setting.free.len())
                    .map(|slot| format!("{:.0}", (1e3 * middle(&|case| case.coupling.moved[slot])).round() + 0.0)),
            );
            joints.cells(cells);
        }
    }
    text.push_str(&table.text());
    text.push_str(
        "medians over the hands; energy out and time outside are those of the worst hand; settled slip: along the wall, from where \
         it was met to where it settles; limited: time in which a joint's limit shortened the force\n",
    );
    text.push_str("joints, from the first contact to where they settle:\n");
    text.push_str(&joints.text());
    text
}

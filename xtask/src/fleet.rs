//! Many robots over many nights, in some of which something changes: logs of the plant, jobs, fits, and what `dynid fleet` says.
//!
//! Everything lies in `target/fleet`; what is done there already is not done again.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::Context;
use dynid_plant::recipe::{self, Recipe};
use dynid_random::Random;
use serde_json::Value;

use crate::shell;

/// Asks `dynid job` and `dynid fleet` for the robots in which something changes.
#[derive(clap::Args)]
pub struct Arguments {
    /// Robots; something happens to six of them.
    #[arg(long, default_value_t = 40)]
    robots: usize,
    /// Nights of each.
    #[arg(long, default_value_t = 30)]
    nights: usize,
    /// Of the robots' values, of the nights and of the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Where the program is; without it, it is built.
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
    /// Writes `docs/fleet.md` anew.
    #[arg(long)]
    write_docs: bool,
}

/// What happens to a robot.
struct Change {
    robot: usize,
    /// The first night that is another.
    night: usize,
    what: &'static str,
    kind: Kind,
}

enum Kind {
    /// A parameter moves by this share of itself each night.
    Drift(&'static str, f64),
    /// A parameter is another from this night on.
    Step(&'static str, f64),
    /// An effect that no model knows (TOML).
    Effect(&'static str),
}

/// Six of them, in robots and nights that the seed draws.
fn changes(random: &mut Random, robots: usize, nights: usize) -> Vec<Change> {
    let kinds = [
        ("viscous friction grows by 3 % a night", Kind::Drift("Fv", 0.03)),
        ("Coulomb friction falls by 3 % a night", Kind::Drift("Fc", -0.03)),
        ("Coulomb friction is 30 % larger", Kind::Step("Fc", 1.3)),
        ("a spring is slack: 25 % softer", Kind::Step("Ks", 0.75)),
        (
            "a cable goes slack: the drive turns free for 0.03 rad",
            Kind::Effect("id = \"backlash\"\ngap = 0.03\nJm = 2e-5\nT_contact = 0.004"),
        ),
        (
            "friction of another law: it falls with speed",
            Kind::Effect("id = \"stribeck\"\nFs = 0.004\nFc = 0.0\nvs = 0.2\nv_eps = 0.02"),
        ),
    ];
    let mut taken: Vec<usize> = Vec::new();
    let place = |(what, kind): (&'static str, Kind)| {
        let mut robot = (random.unit() * robots as f64) as usize;
        while taken.contains(&robot) {
            robot = (robot + 1) % robots;
        }
        taken.push(robot);
        // So that there is something before it and something after it.
        let night = (nights as f64 * random.between(0.2, 0.8)) as usize;
        Change { robot, night, what, kind }
    };
    kinds.into_iter().map(place).collect()
}

const SAMPLES: &str = "sample_s = 0.01\nsteps_per_sample = 40\nnoise_rms = 2e-4\nquantum = 1e-4\n";

/// The logs of a robot in a night.
fn recipe(robot: usize, night: usize, own: &[f64; 4], warmth: f64, changes: &[Change], seed: u64) -> String {
    let change = changes.iter().find(|own| own.robot == robot && night >= own.night);
    let factor = |name: &str| match change.map(|own| (&own.kind, own.night)) {
        Some((Kind::Drift(moved, share), since)) if *moved == name => 1.0 + share * (night - since + 1) as f64,
        Some((Kind::Step(moved, factor), _)) if *moved == name => *factor,
        _ => 1.0,
    };
    let [spring, viscous, coulomb, phase] = *own;
    let more = match change.map(|own| &own.kind) {
        Some(Kind::Effect(effect)) => format!("\n[[effect]]\njoint = 4\n{effect}\n"),
        _ => String::new(),
    };
    let torque = |a: f64, b: f64| {
        format!(
            "[{{ joint = 4, amplitude = 0.006, hz = 0.31, phase = {a} }}, {{ joint = 4, amplitude = 0.0035, hz = 0.83, phase = {b} }}]"
        )
    };
    format!(
        "device = \"freedom6s\"\nseed = {seed}\n{SAMPLES}start = [0.1, -0.05, 0.0, 0.0, -0.28, -0.3]\n\n\
         [[effect]]\nid = \"gain\"\njoint = 4\nKp = 7.15\n\n\
         [[effect]]\nid = \"spring\"\njoint = 4\nKs = {}\nqeq = -0.25\n\n\
         [[effect]]\nid = \"viscous\"\njoint = 4\nFv = {}\n\n\
         [[effect]]\nid = \"coulomb\"\njoint = 4\nFc = {}\nv_eps = 0.02\n{more}\n\
         [[run]]\nfile = \"log.csv\"\nfree = [4]\nrole = \"fit\"\nduration_s = 10.0\ntorque = {}\n",
        spring * factor("Ks"),
        // Oil is thinner in a warm night, in all robots alike.
        viscous * (1.0 - 0.1 * warmth) * factor("Fv"),
        coulomb * factor("Fc"),
        torque(phase, 1.7 * phase),
    )
}

const MODEL: &str = "device = \"freedom6s\"\n\n[[effect]]\nid = \"gain\"\njoint = 4\nKp = { value = 7.15, fixed = true }\n\n\
                     [[effect]]\nid = \"spring\"\njoint = 4\nKs = 0.025\nqeq = -0.25\n\n[[effect]]\nid = \"viscous\"\njoint = 4\nFv = 0.01\n\n\
                     [[effect]]\nid = \"coulomb\"\njoint = 4\nFc = 0.005\nv_eps = { value = 0.02, fixed = true }\n";

/// Makes, asks, scores.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let program = match &arguments.program {
        Some(program) => program.canonicalize().with_context(|| program.display().to_string())?,
        None => {
            shell::succeed(&mut shell::cargo(&["build", "--release", "--locked"]))?;
            shell::root().join("target/release/dynid")
        }
    };
    let folder =
        shell::root().join(format!("target/fleet/{}-{}-{}", arguments.robots, arguments.nights, arguments.seed));
    let changes = logs(arguments, &folder)?;
    let dynid = |words: &[&str]| -> anyhow::Result<Value> {
        let output =
            Command::new(&program).arg("--json").args(words).current_dir(&folder).stderr(Stdio::inherit()).output()?;
        serde_json::from_slice(&output.stdout).with_context(|| format!("dynid {words:?} printed no JSON"))
    };
    let fit = ["fit", "{experiment}", "--model", "nominal.toml", "--out", "{out}.toml"];
    dynid(&[&["job", "jobs", "--from", "nights.csv", "--"][..], &fit].concat())?;
    let begun = Instant::now();
    let done = dynid(&["job", "jobs", "--out", "results"])?;
    println!("fits: {done} in {:.0} s", begun.elapsed().as_secs_f64());
    let begun = Instant::now();
    let found = dynid(&["fleet", "results", "--out", "fleet.html", "--force"])?;
    let table = score(&found, &changes, arguments)?;
    println!(
        "{table}\nlooked at in {:.2} s; page: {}",
        begun.elapsed().as_secs_f64(),
        folder.join("fleet.html").display()
    );
    if arguments.write_docs {
        fs::write(shell::root().join("docs/fleet.md"), table)?;
    }
    Ok(())
}

/// Writes the logs of every night that has none yet, and the table of all.
fn logs(arguments: &Arguments, folder: &Path) -> anyhow::Result<Vec<Change>> {
    let mut random = Random::new(arguments.seed);
    let changes = changes(&mut random, arguments.robots, arguments.nights);
    let own: Vec<[f64; 4]> = (0..arguments.robots)
        .map(|_| {
            let mut near = |value: f64| value * (1.0 + 0.1 * random.normal());
            [near(0.0272), near(0.0136), near(0.004), random.unit()]
        })
        .collect();
    let warmth = random.vector(arguments.nights, -1.0, 1.0);
    let mut table = "robot,night,experiment\n".to_owned();
    for (robot, own) in own.iter().enumerate() {
        for (night, warmth) in warmth.iter().enumerate() {
            // Each night is played otherwise, and a little colder or warmer in each robot.
            let mut own = *own;
            own[3] += night as f64;
            let warmth = warmth + 0.2 * random.normal();
            let place = format!("r{robot:02}/n{night:02}");
            let _ = writeln!(table, "r{robot:02},n{night:02},{place}/experiment.toml");
            let path = folder.join(&place);
            if path.join("experiment.toml").is_file() {
                continue;
            }
            let seed = arguments.seed * 1_000_000 + (robot * arguments.nights + night) as u64;
            let recipe: Recipe = toml::from_str(&recipe(robot, night, &own, warmth, &changes, seed))?;
            let device = dynid_model::device(&recipe.device).context("the device is carried")?;
            let files = recipe::make(&recipe, device).map_err(anyhow::Error::msg)?;
            fs::create_dir_all(&path)?;
            // The experiment last: with it the night is whole.
            for (name, text) in files.iter().rev() {
                fs::write(path.join(name), text)?;
            }
        }
    }
    fs::create_dir_all(folder)?;
    fs::write(folder.join("nights.csv"), table)?;
    fs::write(folder.join("nominal.toml"), MODEL)?;
    Ok(changes)
}

/// What was found of what was hidden, as Markdown.
fn score(found: &Value, changes: &[Change], arguments: &Arguments) -> anyhow::Result<String> {
    let events = found["events"].as_array().context("events")?;
    let mut page = format!(
        "# A fleet: {} robots, {} nights each, something happens to six\n\nWritten by `cargo xtask fleet --robots {} --nights {} --seed {} --write-docs`.\n\n\
         | robot | what happens | night | what `dynid fleet` says | nights that it holds possible |\n| --- | --- | --- | --- | --- |\n",
        arguments.robots, arguments.nights, arguments.robots, arguments.nights, arguments.seed
    );
    let mut named = 0;
    for own in changes {
        let robot = format!("r{:02}", own.robot);
        let of_robot = || events.iter().filter(|event| event["robot"] == robot.as_str());
        let span = |event: &Value| -> Option<[u64; 2]> {
            let between = &event["changes"][0]["between"];
            Some([between[0].as_u64()?, between[1].as_u64()?])
        };
        // A drift is still nothing in the night before its first step.
        let night = own.night as u64 - u64::from(matches!(own.kind, Kind::Drift(..)));
        let is_right = |event: &&Value| span(event).is_some_and(|[from, to]| from <= night && night <= to);
        let best = of_robot().find(is_right).or_else(|| of_robot().next());
        named += usize::from(of_robot().any(|event| is_right(&event)));
        let said = best.and_then(|event| event["what"].as_str()).unwrap_or("nothing").replace('|', "\\|");
        let possible = best.and_then(span).map_or(String::new(), |[from, to]| format!("n{from:02} to n{to:02}"));
        let _ = writeln!(page, "| {robot} | {} | n{night:02} | {said} | {possible} |", own.what);
    }
    let is_true = |event: &&Value| changes.iter().any(|own| event["robot"] == format!("r{:02}", own.robot).as_str());
    let mut wrong: Vec<&str> =
        events.iter().filter(|event| !is_true(event)).filter_map(|event| event["robot"].as_str()).collect();
    wrong.dedup();
    let more = events.len() - wrong.len() - named;
    let _ = writeln!(
        page,
        "\nNamed with their night: {named} of {}. Robots falsely named: {}. Further changes told of the six: {more}.",
        changes.len(),
        wrong.len()
    );
    Ok(page)
}

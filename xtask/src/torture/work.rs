//! The commands that are disturbed, and the folder that they work on.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, bail};
use dynid_plant::recipe::{self, Recipe};

/// How a command that was stopped is gone on with.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Again {
    /// With `--resume` where there is a checkpoint, else from the start with `--force`.
    Resume,
    /// The same with `--force`.
    Force,
    /// The same with `--again`.
    Failed,
}

/// A command and how it goes on.
pub struct Work {
    pub name: &'static str,
    pub arguments: &'static [&'static str],
    pub again: Again,
    /// The command is sent to the server of `dynid open`.
    pub by_server: bool,
}

const FIT: &[&str] = &["fit", "experiment.toml", "--model", "nominal.toml", "--out", "out/fitted.toml"];
const POSITION: &[&str] = &[
    "fit",
    "experiment.toml",
    "--model",
    "nominal.toml",
    "--error",
    "position",
    "--substeps",
    "30",
    "--out",
    "out/fitted.toml",
];

pub const ALL: [Work; 8] = [
    Work { name: "fit", arguments: FIT, again: Again::Resume, by_server: false },
    Work { name: "fit-position", arguments: POSITION, again: Again::Resume, by_server: false },
    Work {
        name: "fit-method",
        arguments: &[
            "fit",
            "experiment.toml",
            "--model",
            "nominal.toml",
            "--method",
            "isolated",
            "--substeps",
            "20",
            "--out",
            "out/fitted.toml",
        ],
        again: Again::Resume,
        by_server: false,
    },
    Work {
        name: "diagnose",
        arguments: &[
            "diagnose",
            "experiment.toml",
            "--model",
            "lacks.toml",
            "--depth",
            "1",
            "--out",
            "out/better.toml",
            "--save",
            "out/diagnosis.json",
        ],
        again: Again::Force,
        by_server: false,
    },
    Work {
        name: "ladder",
        arguments: &[
            "ladder",
            "experiment.toml",
            "lacks.toml",
            "nominal.toml",
            "--out",
            "out/ladder.svg",
            "--report",
            "out/ladder.html",
        ],
        again: Again::Force,
        by_server: false,
    },
    Work {
        name: "wall-tune",
        arguments: &["wall", "tune", "--hands", "2", "--evaluations", "40", "--out", "out/wall.toml"],
        again: Again::Force,
        by_server: false,
    },
    Work { name: "job", arguments: &["job", "jobs", "--out", "out"], again: Again::Failed, by_server: false },
    Work { name: "open", arguments: POSITION, again: Again::Resume, by_server: true },
];

const RUN_SECONDS: f64 = 1.5;

fn recipe(seed: u64) -> String {
    let run = |file: &str, role: &str, phase: f64| {
        format!(
            "[[run]]\nfile = \"{file}\"\nfree = [4]\nrole = \"{role}\"\nduration_s = {RUN_SECONDS:?}\ntorque = [{{ joint = 4, \
             amplitude = 0.006, hz = 0.71, phase = {phase:?} }}, {{ joint = 4, amplitude = 0.0035, hz = 1.83, phase = 0.5 }}]\n\n"
        )
    };
    format!(
        "device = \"freedom6s\"\nseed = {seed}\nsample_s = 0.01\nsteps_per_sample = 40\nnoise_rms = 2e-4\nquantum = 1e-4\n\
         start = [0.1, -0.05, 0.0, 0.0, -0.28, -0.3]\n\n\
         [[effect]]\nid = \"gain\"\njoint = 4\nKp = 7.15\n\n\
         [[effect]]\nid = \"spring\"\njoint = 4\nKs = 0.0272\nqeq = -0.25\n\n\
         [[effect]]\nid = \"viscous\"\njoint = 4\nFv = 0.0136\n\n\
         [[effect]]\nid = \"coulomb\"\njoint = 4\nFc = 0.004\nv_eps = 0.02\n\n{}{}",
        run("fitted.csv", "fit", 0.1),
        run("held.csv", "validate", 1.3)
    )
}

const LACKS: &str = "device = \"freedom6s\"\n\n[[effect]]\nid = \"gain\"\njoint = 4\nKp = { value = 7.15, fixed = true }\n\n\
                     [[effect]]\nid = \"spring\"\njoint = 4\nKs = 0.025\nqeq = -0.25\n\n[[effect]]\nid = \"viscous\"\njoint = 4\nFv = 0.01\n";
const COULOMB: &str = "\n[[effect]]\nid = \"coulomb\"\njoint = 4\nFc = 0.005\nv_eps = { value = 0.02, fixed = true }\n";

/// The folder that every command starts from: logs of the plant, models, jobs, and an empty folder for what comes out.
pub fn base(folder: &Path, program: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(folder.join("out"))?;
    let recipe: Recipe = toml::from_str(&recipe(2006))?;
    let device = dynid_model::device(&recipe.device).context("the device is carried")?;
    for (name, text) in recipe::make(&recipe, device).map_err(anyhow::Error::msg)? {
        fs::write(folder.join(name), text)?;
    }
    fs::write(folder.join("lacks.toml"), LACKS)?;
    fs::write(folder.join("nominal.toml"), format!("{LACKS}{COULOMB}"))?;
    fs::write(
        folder.join("nights.csv"),
        "robot,night,experiment\na,1,experiment.toml\na,2,experiment.toml\nb,1,experiment.toml\n",
    )?;
    let mut make = Command::new(program);
    make.args(["job", "jobs", "--from", "nights.csv", "--", "fit", "{experiment}", "--model", "nominal.toml"]);
    make.args(["--out", "{out}.toml"]).current_dir(folder).stdout(Stdio::null());
    let status = make.status()?;
    if !status.success() {
        bail!("the jobs cannot be made: {status}");
    }
    Ok(())
}

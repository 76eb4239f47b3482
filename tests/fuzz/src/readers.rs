//! Every reader, as the program calls it, with the files that its inputs are made from.

use std::{
    fs,
    path::{Path, PathBuf},
};

use dynid_haptics::wall;
use dynid_identify::checkpoint::{self, Identity};
use dynid_logs::experiment::Experiment;
use dynid_model::{Device, Effect, NamedInput};
use dynid_tables::Table;
use dynid_user_model::Model;

use crate::{
    draw::Draw,
    mutate::{self, binary, csv},
};

/// Bytes that unpacked content may have here. The program allows more ([`dynid_tables::LARGEST_UNPACKED`]), by the same code.
pub const UNPACKED: u64 = 32 << 20;

/// Where an input and the files that it names lie.
pub struct Place {
    pub folder: PathBuf,
}

impl Place {
    /// With the files that experiments and models of the corpus name.
    pub fn new(folder: &Path) -> anyhow::Result<Self> {
        let rows = |text: &str, count: usize| text.split_inclusive('\n').take(count).collect::<String>();
        for log in ["wrist-1.csv", "wrist-2.csv", "wrist-3.csv"] {
            fs::write(folder.join(log), rows(&fs::read_to_string(root().join("src/tour").join(log))?, 40))?;
        }
        fs::write(folder.join("arm.toml"), fs::read_to_string(root().join("model/devices/planar2r.toml"))?)?;
        fs::write(folder.join("control.toml"), fs::read_to_string(corpus("controller").join("one.toml"))?)?;
        Ok(Self { folder: folder.to_owned() })
    }

    fn file(&self, name: &str, bytes: &[u8]) -> Result<PathBuf, String> {
        let path = self.folder.join(name);
        fs::write(&path, bytes).map_err(|error| format!("the fuzzer cannot write {}: {error}", path.display()))?;
        Ok(path)
    }
}

/// Whether an input was accepted; an error where what was made of it is wrong.
type Tried = Result<bool, String>;

/// How inputs are made from files of the corpus.
type Mutate = fn(&[u8], &[Vec<u8>], &mut Draw) -> Vec<u8>;

pub struct Reader {
    pub name: &'static str,
    /// Ending of the files of its corpus.
    pub ending: &'static str,
    /// Files and folders of the repository that the corpus has, beside its own folder.
    seeds: &'static [&'static str],
    mutate: Mutate,
    pub read: fn(&Place, &[u8]) -> Tried,
    /// How many of all inputs it gets, relative to others: where an input takes longer, fewer.
    pub share: u64,
}

pub const READERS: [Reader; 22] = [
    text("device", "toml", &["model/devices"], device, 8),
    text("urdf", "urdf", &["crates/import/tests/urdf", "tests/own_robot"], description, 6),
    text("mjcf", "xml", &["crates/import/tests/mjcf"], description, 6),
    text("written-back", "urdf", &["crates/import/tests/urdf/pan_tilt_tool.urdf", "tests/own_robot"], written_back, 4),
    text("effect", "toml", &["model/effects"], effect, 8),
    text("input", "toml", &["model/inputs"], input, 1),
    text("model", "toml", &["src/tour/believed.toml", "tests/wrist/believed.toml"], model, 8),
    text("experiment", "toml", &["src/tour/experiment.toml"], experiment, 4),
    text("controller", "toml", &[], controller, 8),
    text("wall", "toml", &["crates/haptics/src/wall/shipped"], wall_file, 6),
    text("wall-setting", "toml", &["crates/haptics/src/wall/shipped/setting.toml"], setting, 6),
    text("wall-space", "toml", &["crates/haptics/src/wall/shipped/space.toml"], space, 6),
    text("job", "json", &[], job, 8),
    text("checkpoint-fit", "toml", &[], fit_checkpoint, 6),
    text("checkpoint-diagnosis", "toml", &[], diagnosis_checkpoint, 6),
    Reader { name: "csv", ending: "csv", seeds: &[], mutate: csv::of, read: table_csv, share: 8 },
    Reader { name: "csv-gzip", ending: "gz", seeds: &[], mutate: packed_gzip, read: table_gzip, share: 3 },
    Reader { name: "csv-zstd", ending: "zst", seeds: &[], mutate: packed_zstd, read: table_zstd, share: 3 },
    Reader {
        name: "parquet",
        ending: "parquet",
        seeds: &["crates/tables/tests/files"],
        mutate: mutate::of_bytes,
        read: table_parquet,
        share: 4,
    },
    Reader {
        name: "arrow",
        ending: "arrow",
        seeds: &["crates/tables/tests/files"],
        mutate: mutate::of_bytes,
        read: table_arrow,
        share: 4,
    },
    Reader {
        name: "mcap",
        ending: "mcap",
        seeds: &["crates/tables/tests/files"],
        mutate: binary::of_mcap,
        read: table_mcap,
        share: 4,
    },
    Reader {
        name: "matlab",
        ending: "mat",
        seeds: &["crates/tables/tests/files"],
        mutate: binary::of_matlab,
        read: table_matlab,
        share: 4,
    },
];

const fn text(
    name: &'static str,
    ending: &'static str,
    seeds: &'static [&'static str],
    read: fn(&Place, &[u8]) -> Tried,
    share: u64,
) -> Reader {
    Reader { name, ending, seeds, mutate: of_text, read, share }
}

impl Reader {
    pub fn named(name: &str) -> Option<&'static Self> {
        READERS.iter().find(|reader| reader.name == name)
    }

    /// The corpus: files that were right, and those that were wrong once.
    pub fn corpus(&self) -> anyhow::Result<Vec<(PathBuf, Vec<u8>)>> {
        let own = corpus(self.name);
        let mut places: Vec<PathBuf> = self.seeds.iter().map(|seed| root().join(seed)).collect();
        places.extend(own.is_dir().then_some(own));
        let mut files = Vec::new();
        for place in places {
            let mut paths = vec![place.clone()];
            if place.is_dir() {
                paths = fs::read_dir(&place)?.map(|entry| Ok(entry?.path())).collect::<anyhow::Result<_>>()?;
                paths.retain(|path| path.extension().is_some_and(|ending| ending == self.ending));
                paths.sort();
            }
            for path in paths {
                let bytes = fs::read(&path)?;
                files.push((path, bytes));
            }
        }
        anyhow::ensure!(!files.is_empty(), "the reader {} has no corpus", self.name);
        Ok(files)
    }

    /// The input of this number: first the corpus as it is.
    pub fn input(&self, corpus: &[Vec<u8>], seed: u64, number: u64) -> Vec<u8> {
        if let Some(own) = usize::try_from(number).ok().and_then(|number| corpus.get(number)) {
            return own.clone();
        }
        let mut draw = Draw::of(seed, self.name, number);
        let own = draw.of_these(corpus);
        (self.mutate)(own, corpus, &mut draw)
    }
}

/// Of the repository.
pub fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

fn corpus(name: &str) -> PathBuf {
    root().join("tests/fuzz/corpus").join(name)
}

fn of_text(seed: &[u8], others: &[Vec<u8>], draw: &mut Draw) -> Vec<u8> {
    mutate::of_text(&String::from_utf8_lossy(seed), others, draw)
}

fn packed_gzip(seed: &[u8], others: &[Vec<u8>], draw: &mut Draw) -> Vec<u8> {
    binary::of_packed_text(seed, others, true, draw)
}

fn packed_zstd(seed: &[u8], others: &[Vec<u8>], draw: &mut Draw) -> Vec<u8> {
    binary::of_packed_text(seed, others, false, draw)
}

/// What is no text, the program refuses where it reads the file.
fn utf8(bytes: &[u8]) -> Option<&str> {
    std::str::from_utf8(bytes).ok()
}

/// No number that is none stands in what was accepted.
fn without_nan(what: &impl std::fmt::Debug) -> Tried {
    let numbers = without_texts(&format!("{what:?}"));
    let Some((before, _)) = numbers.split_once("NaN") else { return Ok(true) };
    let from = before.char_indices().rev().nth(80).map_or(0, |(at, _)| at);
    Err(format!("a NaN was accepted: ..{}NaN", &before[from..]))
}

/// What `Debug` writes, but for the texts in it, which may say anything.
fn without_texts(told: &str) -> String {
    let (mut is_text, mut is_escaped) = (false, false);
    let is_kept = |own: &char| {
        let is_quote = *own == '"' && !is_escaped;
        is_escaped = *own == '\\' && !is_escaped;
        is_text ^= is_quote;
        !is_text && !is_quote
    };
    told.chars().filter(is_kept).collect()
}

#[test]
fn a_text_may_say_anything_and_a_number_may_not() {
    assert_eq!(without_texts(r#"{ name: "a \" NaN", value: -NaN }"#), "{ name: , value: -NaN }");
    assert!(without_nan(&("NaN", "\\", 1.0)).is_ok());
    assert!(without_nan(&("NaN \"", f64::NAN)).is_err());
}

fn device(place: &Place, bytes: &[u8]) -> Tried {
    let Some(text) = utf8(bytes) else { return Ok(false) };
    match Device::parse_own(text, Path::new("robot.toml"), place.folder.join("robot.toml")) {
        Ok(device) => {
            let Device { gravity, lengths, joints, frames, links, effects, .. } = &device;
            without_nan(&(gravity, lengths, joints, frames, links, effects))
        }
        Err(error) => said(&error.to_string()),
    }
}

/// An error says something, and not without end.
fn said(message: &str) -> Tried {
    if message.is_empty() {
        return Err("an error says nothing".to_owned());
    }
    if message.len() > 20_000 {
        return Err(format!("an error of {} bytes: {}", message.len(), message.chars().take(300).collect::<String>()));
    }
    Ok(false)
}

fn description(place: &Place, bytes: &[u8]) -> Tried {
    let Some(text) = utf8(bytes) else { return Ok(false) };
    match dynid_import::device_from_description(text, Path::new("robot.urdf"), None) {
        Ok(imported) => {
            // `new` and `device import` read it back before they write it.
            match Device::parse_own(&imported.toml, Path::new("robot.toml"), place.folder.join("robot.toml")) {
                Ok(device) => without_nan(&(&device.gravity, &device.joints, &device.frames, &device.links)),
                Err(error) => said(&error.to_string()),
            }
        }
        Err(error) => said(&error.to_string()),
    }
}

/// A body that can be: mass, centroid, inertia.
const BODY: [f64; 10] = [1.0, 0.1, 0.0, 0.0, 0.1, 0.0, 0.0, 0.1, 0.0, 0.1];

fn written_back(place: &Place, bytes: &[u8]) -> Tried {
    use std::sync::OnceLock;
    static DEVICE: OnceLock<Option<Device>> = OnceLock::new();
    let Some(text) = utf8(bytes) else { return Ok(false) };
    let device = DEVICE.get_or_init(|| {
        let text = fs::read_to_string(root().join("tests/own_robot/arm.urdf")).ok()?;
        let imported = dynid_import::device_from_description(&text, Path::new("arm.urdf"), None).ok()?;
        Device::parse_own(&imported.toml, Path::new("arm.toml"), place.folder.join("arm.toml")).ok()
    });
    let Some(device) = device else { return Err("the robot of the corpus is not read".to_owned()) };
    let identified = dynid_import::Identified {
        bodies: device.links.iter().map(|link| (device.frames[link.frame].name.clone(), BODY)).collect(),
        joints: vec![dynid_import::JointValues { viscous: 0.1, ..Default::default() }; device.joints.len()],
        gravity: [0.0, 0.0, -9.81],
    };
    match dynid_import::description_with(text, Path::new("arm.urdf"), device, &identified) {
        Ok(described) if described.text.contains("NaN") && !text.contains("NaN") => {
            Err("a NaN was written into a description".to_owned())
        }
        Ok(_) => Ok(true),
        Err(error) => said(&error.to_string()),
    }
}

fn effect(_: &Place, bytes: &[u8]) -> Tried {
    let Some(text) = utf8(bytes) else { return Ok(false) };
    match Effect::parse(text, Path::new("mine.toml")) {
        Ok(effect) => {
            let numbers = |own: &dynid_model::EffectParameter| [own.initial, own.lower, own.upper];
            without_nan(&effect.parameters.iter().map(numbers).collect::<Vec<_>>())
        }
        Err(error) => said(&error.to_string()),
    }
}

fn input(_: &Place, bytes: &[u8]) -> Tried {
    let (Some(text), Some(device)) = (utf8(bytes), dynid_model::device("freedom6s")) else { return Ok(false) };
    match NamedInput::parse(text, Path::new("freedom6s.toml"), device) {
        Ok(inputs) => without_nan(&inputs),
        Err(error) => said(&error.to_string()),
    }
}

fn model(place: &Place, bytes: &[u8]) -> Tried {
    let Some(text) = utf8(bytes) else { return Ok(false) };
    let path = place.folder.join("model.toml");
    match Model::parse(text, &path) {
        Ok(model) => {
            // What is written can be read, and is the same.
            let written = model.to_toml_at(&path);
            let again = Model::parse(&written, &path)
                .map_err(|error| format!("a model that was accepted is refused once it is written: {error}"))?;
            if again.digest() != model.digest() {
                return Err("a model is another once it is written and read".to_owned());
            }
            without_nan(&model.parameters())
        }
        Err(error) => said(&error.to_string()),
    }
}

fn experiment(place: &Place, bytes: &[u8]) -> Tried {
    let path = place.file("experiment.toml", bytes)?;
    match Experiment::load(&path) {
        Ok(experiment) => {
            for run in &experiment.runs {
                let log = &run.log;
                let all = std::iter::once(&log.t).chain(&log.q).chain(&log.tau);
                if all.flatten().any(|value| !value.is_finite()) {
                    return Err("a log with a number that is not finite was accepted".to_owned());
                }
            }
            Ok(true)
        }
        // It quotes what it found whole; the program cuts what it prints.
        Err(error) => said(&error.to_string().chars().take(8000).collect::<String>()),
    }
}

fn controller(place: &Place, bytes: &[u8]) -> Tried {
    let path = place.file("controller.toml", bytes)?;
    match dynid_logs::controller::read(&path, "wrist-1.csv", 2, 0.01) {
        Ok(controller) => without_nan(&controller),
        Err(error) => said(&error.to_string()),
    }
}

fn wall_file(_: &Place, bytes: &[u8]) -> Tried {
    let Some(text) = utf8(bytes) else { return Ok(false) };
    match wall::WallFile::parse(text, Path::new("wall.toml")) {
        Ok(file) => without_nan(&file),
        Err(error) => said(&error.to_string()),
    }
}

fn setting(place: &Place, bytes: &[u8]) -> Tried {
    let Some(text) = utf8(bytes) else { return Ok(false) };
    match wall::Setting::parse(text, &place.folder.join("setting.toml")) {
        Ok(_) => Ok(true),
        Err(error) => said(&error.to_string()),
    }
}

fn space(place: &Place, bytes: &[u8]) -> Tried {
    let Some(text) = utf8(bytes) else { return Ok(false) };
    match wall::space::Setting::parse(text, &place.folder.join("space.toml"), None) {
        Ok(_) => Ok(true),
        Err(error) => said(&error.to_string()),
    }
}

fn job(_: &Place, bytes: &[u8]) -> Tried {
    let Some(text) = utf8(bytes) else { return Ok(false) };
    match dynid::cli::readers::job(text) {
        Ok(()) => Ok(true),
        Err(error) => said(&error),
    }
}

fn fit_checkpoint(place: &Place, bytes: &[u8]) -> Tried {
    #[derive(serde::Deserialize)]
    struct Own {
        identity: Identity,
    }
    // It is asked for by whom it says that it belongs to: else a digest would refuse all before the state is looked at.
    let identity = utf8(bytes).and_then(|text| toml::from_str::<Own>(text).ok());
    let Some(Own { identity }) = identity else {
        // Whatever is no checkpoint must be refused, and not only here.
        let path = place.file("fitted.toml.checkpoint", bytes)?;
        let other = toml::from_str::<Identity>("format = 0\nversion = \"\"\ndata = \"\"\nmodel = \"\"\noptions = \"\"");
        let other = other.map_err(|error| error.to_string())?;
        return match checkpoint::read(&path, &other) {
            Ok(_) => Err("a checkpoint without an identity was accepted".to_owned()),
            Err(error) => said(&error.to_string()),
        };
    };
    let path = place.file("fitted.toml.checkpoint", bytes)?;
    match checkpoint::read(&path, &identity) {
        Ok(_) => Ok(true),
        Err(error) => said(&error.to_string()),
    }
}

fn diagnosis_checkpoint(_: &Place, bytes: &[u8]) -> Tried {
    let Some(text) = utf8(bytes) else { return Ok(false) };
    Ok(dynid::cli::readers::diagnosis_checkpoint(text))
}

fn table_csv(place: &Place, bytes: &[u8]) -> Tried {
    table(place, "log.csv", bytes)
}

fn table_gzip(place: &Place, bytes: &[u8]) -> Tried {
    table(place, "log.csv.gz", bytes)
}

fn table_zstd(place: &Place, bytes: &[u8]) -> Tried {
    table(place, "log.csv.zst", bytes)
}

fn table_parquet(place: &Place, bytes: &[u8]) -> Tried {
    table(place, "log.parquet", bytes)
}

fn table_arrow(place: &Place, bytes: &[u8]) -> Tried {
    table(place, "log.arrow", bytes)
}

fn table_mcap(place: &Place, bytes: &[u8]) -> Tried {
    table(place, "log.mcap", bytes)
}

fn table_matlab(place: &Place, bytes: &[u8]) -> Tried {
    table(place, "log.mat", bytes)
}

/// All that is asked of a log's table: names, numbers, a cell that is no number, a row that is too long.
fn table(place: &Place, name: &str, bytes: &[u8]) -> Tried {
    let path = place.file(name, bytes)?;
    let table = match Table::open_within(&path, UNPACKED) {
        Ok(table) => table,
        Err(error) => return said(&error.to_string()),
    };
    let n_rows = table.n_rows();
    // As many as a log of many joints has.
    let places: Vec<usize> = (0..table.names().len().min(64)).collect();
    let columns = match table.columns(&places, 0..n_rows) {
        Ok(columns) => columns,
        Err(error) => return said(&error.to_string()),
    };
    for (place, column) in columns.iter().enumerate() {
        if column.values.len() != n_rows {
            return Err(format!("column {place} has {} values of {n_rows} rows", column.values.len()));
        }
        if let Some(row) = column.no_number {
            if row >= n_rows {
                return Err(format!("row {row} of {n_rows} is no number"));
            }
            if let Err(error) = table.cell(row, place) {
                said(&error.to_string())?;
            }
        }
    }
    if n_rows > 2 {
        let part = table.columns(&places, 1..n_rows - 1).map_err(|error| error.to_string())?;
        for (part, whole) in part.iter().zip(&columns) {
            let same = part.values.iter().zip(&whole.values[1..]).all(|(a, b)| a.to_bits() == b.to_bits());
            if !same || part.values.len() != n_rows - 2 {
                return Err("a part of a column is not what stands in the whole".to_owned());
            }
        }
    }
    let _ = table.ragged_row();
    Ok(true)
}

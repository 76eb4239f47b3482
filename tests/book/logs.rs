//! The book's logs are what their recipes make: an independent simulator (`tests/plant`) plays `recipe.toml` of each folder on
//! the device that it names, or on `arm.urdf` beside it, and `as-logged.toml` gives the columns the names and units that a
//! robot's own log has. With `truth.csv` there is a log for each of its rows.

use std::fs;
use std::path::Path;
use std::process::Command;

use dynid_model::{Device, device, device_named};
use dynid_plant::recipe::{self, Files, Recipe};
use serde::Deserialize;

use crate::{book, is_written, read};

/// How a robot writes its logs.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AsLogged {
    column: Vec<Column>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Column {
    of: String,
    name: String,
    times: f64,
    decimals: usize,
}

#[test]
fn the_plant_makes_the_books_logs_again() {
    for folder in fs::read_dir(book().join("logs")).unwrap().map(|entry| entry.unwrap().path()) {
        for (name, text) in made(&folder) {
            let file = folder.join(&name);
            if is_written() {
                fs::create_dir_all(file.parent().unwrap()).unwrap();
                fs::write(&file, text).unwrap();
            } else {
                let is_same = read(&file) == text;
                assert!(is_same, "{} is not what its recipe makes; `DYNID_BOOK=write` writes it", file.display());
            }
        }
    }
}

/// Name -> text of the files of a folder that its recipe makes.
fn made(folder: &Path) -> Files {
    let path = folder.join("recipe.toml");
    let recipe: Recipe = toml::from_str(&read(&path)).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let truth = folder.join("truth.csv");
    if truth.is_file() {
        return nights(&recipe, &read(&truth));
    }
    let work = tempfile::tempdir().unwrap();
    let device = device(&recipe.device).unwrap_or_else(|| imported(&recipe.device, folder, work.path()));
    let mut files = recipe::make(&recipe, device).unwrap();
    let foreign = folder.join("as-logged.toml");
    if foreign.is_file() {
        // The reader writes what is no log.
        files.retain(|name, _| name.ends_with(".csv"));
        let foreign: AsLogged = toml::from_str(&read(&foreign)).unwrap();
        for text in files.values_mut() {
            *text = as_logged(text, &foreign);
        }
    }
    files
}

/// The device of a description beside the recipe.
fn imported(name: &str, folder: &Path, work: &Path) -> &'static Device {
    let description = folder.join(format!("{name}.urdf"));
    let file = work.join(format!("{name}.toml"));
    let mut import = Command::new(env!("CARGO_BIN_EXE_dynid"));
    import.args(["device", "import"]).arg(&description).arg("--out").arg(&file);
    assert!(import.output().unwrap().status.success(), "{} is imported", description.display());
    device_named(&file.to_string_lossy(), work).unwrap()
}

/// One log for each row of a table of robots and nights: its columns `viscous` and `coulomb` say the friction, `phase` the input.
fn nights(recipe: &Recipe, truth: &str) -> Files {
    let mut files = Files::new();
    let mut table = "robot,night,experiment\n".to_owned();
    for (seed, row) in (1..).zip(truth.lines().skip(1)) {
        let cells: Vec<&str> = row.split(',').collect();
        let [robot, night, viscous, coulomb, phase] = cells[..] else { panic!("{row}") };
        let mut own = Recipe { seed, ..recipe.clone() };
        for (id, symbol, value) in [("viscous", "Fv", viscous), ("coulomb", "Fc", coulomb)] {
            let effect = own.effects.iter_mut().find(|effect| effect.id == id).unwrap();
            effect.values.insert(symbol.to_owned(), value.parse().unwrap());
        }
        own.runs[0].file = format!("{night}.csv");
        for wave in &mut own.runs[0].torque {
            wave.phase = phase.parse().unwrap();
        }
        for (name, text) in recipe::make(&own, device(&own.device).unwrap()).unwrap() {
            files.insert(format!("{robot}/{}", name.replace("experiment", night)), text);
        }
        table += &format!("{robot},{night},{robot}/{night}.toml\n");
    }
    files.insert("nights.csv".to_owned(), table);
    files
}

fn as_logged(log: &str, own: &AsLogged) -> String {
    let mut lines = log.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let at = |column: &Column| {
        header.iter().position(|name| *name == column.of).unwrap_or_else(|| panic!("no column {}", column.of))
    };
    let places: Vec<usize> = own.column.iter().map(at).collect();
    let names: Vec<&str> = own.column.iter().map(|column| column.name.as_str()).collect();
    let mut text = names.join(",") + "\n";
    for line in lines {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        let row: Vec<String> = own
            .column
            .iter()
            .zip(&places)
            .map(|(column, place)| format!("{:.*}", column.decimals, cells[*place] * column.times))
            .collect();
        text += &(row.join(",") + "\n");
    }
    text
}

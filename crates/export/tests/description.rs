//! Values written back into descriptions, against Pinocchio and MuJoCo, which read the files by code of their own.
//!
//! Each sample is imported, its links and effects are changed, and the changed device is written back. What the other program computes
//! from that file must be what the changed device computes. `DYNID_PYTHON` and `DYNID_URDF_FOLDER` are as for the tests of the import.

#[path = "../../import/tests/support/mod.rs"]
mod support;

use std::fs;
use std::path::{Path, PathBuf};

use dynid_export::{Format, as_description};
use dynid_import::{Imported, device_from_description};
use dynid_model::{Device, ModelError, device_named};
use dynid_random::Random;
use dynid_user_model::Model;
use support::{Other, assert_same, files_in};
use toml_edit::{DocumentMut, Item, value};

const PINOCCHIO: Other = Other {
    module: "pinocchio",
    package: "pin",
    script: "../../import/tests/by_pinocchio.py",
    import: changed_device,
};

const MUJOCO: Other =
    Other { module: "mujoco", package: "mujoco", script: "../../import/tests/by_mujoco.py", import: changed_device };

/// The device that a description was written from: it lies beside it.
fn changed_device(_: &str, path: &Path) -> Result<Imported, ModelError> {
    Ok(Imported { toml: fs::read_to_string(path.with_extension("toml")).unwrap(), notes: Vec::new() })
}

/// A device file with other bodies and other effects. A body more on each link keeps them such that bodies can be so.
fn changed(toml: &str) -> String {
    let mut document: DocumentMut = toml.parse().unwrap();
    let mut random = Random::new(3);
    let number = |item: &Item| item.as_float().or(item.as_integer().map(|own| own as f64)).unwrap();
    for link in document["link"].as_array_of_tables_mut().unwrap().iter_mut() {
        let keys = dynid_model::Link::SYMBOLS;
        let own = keys.map(|key| number(&link[key]));
        let mass = 0.3 * own[0] + 0.01;
        let place = random.vector(3, -0.1, 0.1);
        let inertia = [0.004, 0.0003, -0.0002, 0.005, 0.0004, 0.0035].map(|moment| moment * (1.0 + own[0]));
        // About the common centroid: both bodies are moved by the reduced mass.
        let total = own[0] + mass;
        let reduced = own[0] * mass / total;
        let arm: Vec<f64> = (0..3).map(|axis| place[axis] - own[1 + axis]).collect();
        let square: f64 = arm.iter().map(|own| own * own).sum();
        let mut values = vec![total];
        values.extend((0..3).map(|axis| (own[0] * own[1 + axis] + mass * place[axis]) / total));
        for (at, (row, column)) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].into_iter().enumerate() {
            let moved = if row == column { square } else { 0.0 } - arm[row] * arm[column];
            values.push(own[4 + at] + inertia[at] + reduced * moved);
        }
        keys.iter().zip(values).for_each(|(key, own)| link[key] = value(own));
    }
    if let Some(effects) = document.get_mut("effect").and_then(Item::as_array_of_tables_mut) {
        for effect in effects.iter_mut() {
            for key in ["Fv", "Fc", "Ia"] {
                if let Some(own) = effect.get(key).filter(|own| !own.is_inline_table()).map(number) {
                    effect[key] = value(0.75 * own);
                }
            }
        }
    }
    document.to_string()
}

/// Writes the changed device of each description back into it; the new files, which have their devices beside them.
fn written_back(files: &[PathBuf], format: Format, folder: &Path) -> Vec<PathBuf> {
    let mut written = Vec::new();
    for (number, file) in files.iter().enumerate() {
        // What cannot be imported is the importer's to test.
        let Ok(text) = fs::read_to_string(file) else { continue };
        let Ok(imported) = device_from_description(&text, file) else { continue };
        let name = format!("{}_{number}", file.file_stem().unwrap().to_string_lossy().to_lowercase().replace(['-', '.'], "_"));
        fs::write(folder.join(format!("{name}.toml")), changed(&imported.toml)).unwrap();
        let device = device_named(&format!("{name}.toml"), folder).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let exported = as_description(&Model::of_device(device), format, &text, file)
            .unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let path = folder.join(&name).with_extension(file.extension().unwrap());
        fs::write(&path, &exported.text).unwrap();
        assert_only_numbers_differ(&text, &exported.text, file);
        assert_imported_again(device, &exported.text, &path);
        written.push(path);
    }
    written
}

/// Without bodies and losses, both texts are the same.
fn assert_only_numbers_differ(original: &str, exported: &str, file: &Path) {
    assert_ne!(original, exported, "{}", file.display());
    assert_eq!(without_values(original), without_values(exported), "{}", file.display());
}

/// A text without `<inertial>`, `<dynamics>`, the losses of an MJCF's joints, blanks, and the mark of an element without children.
fn without_values(text: &str) -> String {
    let mut rest = text;
    let mut kept = String::new();
    while let Some(start) = rest.find('<') {
        kept.push_str(&rest[..start]);
        let tag = &rest[start..];
        let end = tag.find('>').unwrap() + 1;
        let is_empty = tag[..end].ends_with("/>");
        if tag.starts_with("<inertial") && !is_empty {
            rest = tag.split_once("</inertial>").unwrap().1;
        } else {
            let is_value = tag.starts_with("<inertial") || tag.starts_with("<dynamics");
            let is_joint = tag.starts_with("<joint");
            kept.push_str(&if is_value { String::new() } else if is_joint { without_losses(&tag[..end]) } else { tag[..end].to_owned() });
            rest = &tag[end..];
        }
    }
    kept.push_str(rest);
    kept.retain(|character| !character.is_whitespace());
    ["link", "body", "joint"].iter().fold(kept, |kept, name| kept.replace(&format!("></{name}>"), "/>"))
}

fn without_losses(tag: &str) -> String {
    let mut tag = tag.to_owned();
    for attribute in [" damping=", " frictionloss=", " armature="] {
        if let Some(start) = tag.find(attribute) {
            let value = start + attribute.len();
            let quote = &tag[value..=value];
            let end = value + 1 + tag[value + 1..].find(quote).unwrap() + 1;
            tag.replace_range(start..end, "");
        }
    }
    tag
}

/// Where all values are there already, nothing but what is within quotes changes.
#[test]
fn nothing_but_values_changes() {
    let file = &samples("urdf", "urdf").into_iter().find(|file| file.ends_with("six_axis.urdf")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let written = written_back(std::slice::from_ref(file), Format::Urdf, folder.path());
    let outside_quotes = |path: &Path| -> Vec<String> {
        fs::read_to_string(path).unwrap().split('"').step_by(2).map(str::to_owned).collect()
    };
    assert_eq!(outside_quotes(file), outside_quotes(&written[0]));
}

/// Imported again, it is the same device: bodies to rounding, effects to the last digit but one.
fn assert_imported_again(device: &Device, text: &str, path: &Path) {
    let imported = device_from_description(text, path).unwrap();
    let again = Device::parse(&imported.toml, Path::new("again.toml")).unwrap();
    assert_eq!(again.links.len(), device.links.len(), "{}", path.display());
    for (own, again) in device.links.iter().zip(&again.links) {
        let (own, again) = (own.values(), again.values());
        for part in [0..1, 1..4, 4..10] {
            let size = own[part.clone()].iter().fold(1e-6_f64, |size, value| size.max(value.abs()));
            part.for_each(|at| assert!((own[at] - again[at]).abs() <= 1e-12 * size, "{}: {own:?} {again:?}", path.display()));
        }
    }
    assert_eq!(again.effects.len(), device.effects.len(), "{}", path.display());
    for (own, again) in device.effects.iter().zip(&again.effects) {
        assert_eq!((&own.id, own.joint), (&again.id, again.joint));
        let (own, again) = (own.values[0].1.value, again.values[0].1.value);
        assert!((own - again).abs() <= 1e-14 * own.abs(), "{}: {own} {again}", path.display());
    }
}

fn samples(folder: &str, extension: &str) -> Vec<PathBuf> {
    files_in(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../import/tests").join(folder), extension)
}

#[test]
fn samples_agree_with_pinocchio() {
    let (folder, files) = (tempfile::tempdir().unwrap(), samples("urdf", "urdf"));
    let written = written_back(&files, Format::Urdf, folder.path());
    assert_eq!(written.len(), files.len());
    assert_same(&PINOCCHIO, &written, false);
}

#[test]
fn robots_of_a_folder_agree_with_pinocchio() {
    let Ok(from) = std::env::var("DYNID_URDF_FOLDER") else {
        eprintln!("SKIPPED: DYNID_URDF_FOLDER names no folder of URDFs");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let written = written_back(&files_in(Path::new(&from), "urdf"), Format::Urdf, folder.path());
    assert_same(&PINOCCHIO, &written, true);
}

#[test]
fn samples_agree_with_mujoco() {
    let (folder, files) = (tempfile::tempdir().unwrap(), samples("mjcf", "xml"));
    let written = written_back(&files, Format::Mjcf, folder.path());
    assert_eq!(written.len(), files.len());
    assert_same(&MUJOCO, &written, false);
}

//! Imported devices against a program that reads the same descriptions by code of its own.

use std::{
    collections::BTreeMap,
    error::Error,
    fs,
    path::{Path, PathBuf},
    process::Command,
    time::Instant,
};

use dynid_import::Imported;
use dynid_kernels::kernel;
use dynid_model::{Device, Link, ModelError, device_named};
use serde_json::Value;

/// What both may differ by, relative to the size that a torque or an entry of the inertia matrix can have.
const TOLERANCE: f64 = 1e-9;

const STATES: usize = 10;

/// The other program: a module of Python, and the script that asks it.
pub struct Other {
    pub module: &'static str,
    pub package: &'static str,
    pub script: &'static str,
    pub import: fn(&str, &Path) -> Result<Imported, ModelError>,
}

/// What the other program says of each file; `None` where it is not there.
pub fn asked(other: &Other, files: &[PathBuf]) -> Option<Vec<Value>> {
    let python = std::env::var("DYNID_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let Other { module, package, script, .. } = other;
    let is_there = Command::new(&python).args(["-c", &format!("import {module}, numpy")]).output();
    if !is_there.is_ok_and(|output| output.status.success()) {
        eprintln!("SKIPPED: `{python}` has no {module} (`pip install {package}`; DYNID_PYTHON names another Python)");
        return None;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(script);
    let output = Command::new(python).arg("-B").arg(script).arg(STATES.to_string()).args(files).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    Some(text.lines().map(|line| serde_json::from_str(line).unwrap()).collect())
}

/// One robot's figures.
struct Compared {
    n_joints: usize,
    /// Links whose inertia no body has: they were mended, and are put back for the comparison.
    n_mended: usize,
    torque_error: f64,
    inertia_error: f64,
    body_error: f64,
    operations: usize,
    import_s: f64,
    kernel_s: f64,
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap_or(f64::NAN)).collect()
}

/// Values of all parameters that a kernel may ask for.
fn values_of(device: &Device, bodies: &[[f64; 10]]) -> BTreeMap<String, f64> {
    let up = ["base.gx", "base.gy", "base.gz"].into_iter().zip(device.up);
    let mut values: BTreeMap<String, f64> = up.map(|(name, up)| (name.to_owned(), device.gravity * up)).collect();
    values.extend(device.lengths.iter().map(|length| (format!("length.{}", length.symbol), length.value)));
    for (number, body) in (1..).zip(bodies) {
        let own = Link::SYMBOLS.iter().zip(body).map(|(symbol, value)| (format!("link.{number}.{symbol}"), *value));
        values.extend(own);
    }
    values
}

fn compared(other: &Other, file: &Path, answer: &Value) -> Result<Compared, Box<dyn Error>> {
    if let Some(error) = answer.get("error") {
        return Err(format!("{} refuses it: {error}", other.module).into());
    }
    let text = fs::read_to_string(file)?;
    let started = Instant::now();
    let imported = (other.import)(&text, file)?;
    let folder = tempfile::tempdir()?;
    fs::write(folder.path().join("robot.toml"), &imported.toml)?;
    let device =
        device_named("robot.toml", folder.path()).map_err(|error| format!("the reader refuses it: {error}"))?;
    let import_s = started.elapsed().as_secs_f64();
    let n = device.joints.len();
    let all: Vec<usize> = (0..n).collect();
    let started = Instant::now();
    let kernel = kernel(device, &all)?;

    let mended = |link: &Link| {
        imported.notes.iter().any(|note| note.starts_with("no body has") && note.contains(&format!("`{}`", link.title)))
    };
    let mut body_error = 0.0_f64;
    let mut n_mended = 0;
    let mut bodies = Vec::new();
    for link in &device.links {
        let mut own = link.values();
        let Some(expected) = answer["bodies"].get(&link.title).map(numbers) else {
            bodies.push(own);
            continue;
        };
        if mended(link) {
            n_mended += 1;
            own = <[f64; 10]>::try_from(expected).map_err(|_| "ten numbers")?;
        } else {
            for part in [0..1, 1..4, 4..10] {
                let size = expected[part.clone()].iter().fold(1e-9_f64, |size, value| size.max(value.abs()));
                let errors = part.map(|place| (own[place] - expected[place]).abs() / size);
                body_error = errors.fold(body_error, f64::max);
            }
        }
        bodies.push(own);
    }
    let values = values_of(device, &bodies);
    let parameters: Vec<f64> = kernel.parameters.iter().map(|name| values[*name]).collect();
    let mut prepared = vec![f64::NAN; kernel.prepared.len()];
    kernel.functions.prepare(&parameters, &[], &mut prepared);

    // The other has its own order of joints.
    let names: Vec<&str> = answer["joints"].as_array().ok_or("joints")?.iter().filter_map(Value::as_str).collect();
    let place: Vec<usize> = device
        .joints
        .iter()
        .map(|joint| names.iter().position(|name| *name == joint.title).ok_or_else(|| format!("no `{}`", joint.title)))
        .collect::<Result<_, _>>()?;
    if names.len() != n {
        return Err(format!("{n} joints, the other has {}", names.len()).into());
    }
    let total: f64 = bodies.iter().map(|body| body[0]).sum();
    let (mut torque_error, mut inertia_error) = (0.0_f64, 0.0_f64);
    let mut kernel_s = f64::NAN;
    for state in answer["states"].as_array().ok_or("states")? {
        let pick = |key: &str| {
            let of = numbers(&state[key]);
            place.iter().map(|place| of[*place]).collect::<Vec<f64>>()
        };
        let (q, dq, ddq, expected) = (pick("q"), pick("dq"), pick("ddq"), pick("torque"));
        let (mut torque, mut d, mut h) = (vec![f64::NAN; n], vec![f64::NAN; n * n], vec![f64::NAN; n]);
        kernel.functions.inertia_and_bias(&prepared, &q, &dq, &mut d, &mut h);
        if kernel_s.is_nan() {
            kernel_s = started.elapsed().as_secs_f64();
        }
        kernel.functions.inverse_dynamics(&prepared, &q, &dq, &ddq, &mut torque);
        let flat = numbers(&state["inertia"]);
        let inertia = |row: usize, column: usize| flat[place[row] * n + place[column]];
        // `|D_ij| <= sqrt(D_ii D_jj)`, `|phi_i| <= g sqrt(M D_ii)`: what cancels to nothing has no relative error.
        let reach: Vec<f64> = (0..n).map(|joint| inertia(joint, joint).abs().sqrt()).collect();
        let sum_of = |of: &[f64]| of.iter().map(|value| value.abs()).sum::<f64>();
        let pull: f64 = reach.iter().zip(&ddq).map(|(reach, ddq)| reach * ddq.abs()).sum();
        let swing: f64 = reach.iter().zip(&dq).map(|(reach, dq)| reach * dq.abs()).sum::<f64>() * sum_of(&dq);
        for row in 0..n {
            let size = reach[row] * (pull + swing + device.gravity * total.sqrt());
            torque_error = torque_error.max((torque[row] - expected[row]).abs() / size);
            for column in 0..n {
                let error = (d[row * n + column] - inertia(row, column)).abs();
                inertia_error = inertia_error.max(error / (reach[row] * reach[column]));
            }
        }
        if torque.iter().chain(&d).any(|value| !value.is_finite()) {
            return Err("a kernel's value is no number".into());
        }
    }
    let operations = kernel.operations.iter().find(|of| of.kernel == "inertia_and_bias").ok_or("operations")?;
    let operations = operations.adds + operations.muls + operations.divs;
    Ok(Compared { n_joints: n, n_mended, torque_error, inertia_error, body_error, operations, import_s, kernel_s })
}

/// Files of a folder, and of those in it.
pub fn files_in(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files_in(&path, extension));
        } else if path.extension().is_some_and(|own| own == extension) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// All of them, shown as a table.
fn table(other: &Other, files: &[PathBuf]) -> Option<Vec<Result<Compared, Box<dyn Error>>>> {
    let answers = asked(other, files)?;
    assert_eq!(answers.len(), files.len());
    eprintln!(
        "| robot | joints | mended links | torque error | D error | body error | D + h operations | import [ms] | kernel [ms] |"
    );
    eprintln!("| --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    let mut all = Vec::new();
    for (file, answer) in files.iter().zip(&answers) {
        let name = file.file_stem().unwrap_or_default().to_string_lossy();
        let found = compared(other, file, answer);
        match &found {
            Ok(found) => eprintln!(
                "| {name} | {} | {} | {:.1e} | {:.1e} | {:.1e} | {} | {:.1} | {:.0} |",
                found.n_joints,
                found.n_mended,
                found.torque_error,
                found.inertia_error,
                found.body_error,
                found.operations,
                1e3 * found.import_s,
                1e3 * found.kernel_s
            ),
            Err(error) => eprintln!("| {name} | {} |", error.to_string().lines().take(3).collect::<Vec<_>>().join(" ")),
        }
        all.push(found);
    }
    Some(all)
}

/// # Panics
/// If a file cannot be compared (unless `may_refuse`), or both differ.
pub fn assert_same(other: &Other, files: &[PathBuf], may_refuse: bool) {
    for (file, found) in files.iter().zip(table(other, files).into_iter().flatten()) {
        let found = match found {
            Ok(found) => found,
            Err(_) if may_refuse => continue,
            Err(error) => panic!("{}: {error}", file.display()),
        };
        let worst = found.torque_error.max(found.inertia_error).max(found.body_error);
        assert!(worst <= TOLERANCE, "{}: {worst:e}", file.display());
    }
}

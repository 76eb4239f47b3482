//! The file of a closed-loop run's controller.

use std::path::Path;

use dynid_dynamics::simulate::control::{Controller, Filter};
use dynid_files::DocumentError;
use dynid_model::{ModelError, document, document::Table, error::Source};

const KEYS: [&str; 8] = ["file", "P", "D", "cutoff_hz", "filter", "limit", "position_quantum", "torque_quantum"];

/// Reads the controller of the run `file` (as the experiment names it) from a controller file: a table with the
/// gains `P` and `D` of all joints, or one such table per run, each naming its `file`. Without `filter` or
/// `cutoff_hz` the filter is the thesis's.
///
/// # Errors
/// A file that cannot be read, gains of another number than joints, a run without a controller.
pub fn read(path: &Path, file: &str, n_joints: usize, sample_s: f64) -> Result<Controller, DocumentError> {
    let text = dynid_files::read(path)?;
    Ok(parse(&Source::new(path, &text), file, n_joints, sample_s)?)
}

fn parse(source: &Source, file: &str, n_joints: usize, sample_s: f64) -> Result<Controller, ModelError> {
    let document = document::parse(source)?;
    let root = Table::root(source, &document);
    if root.optional("P").is_some() {
        return of_table(&root, n_joints, sample_s);
    }
    for (name, _) in root.keys() {
        let table = root.table(name, "a controller: P, D")?;
        if table.required("file", "the run's file")?.text()? == file {
            return of_table(&table, n_joints, sample_s);
        }
    }
    let help = format!("add a table with `file = \"{file}\"`, P and D");
    Err(root.error(format!("no controller for the run `{file}`")).help(help))
}

fn of_table(table: &Table<'_>, n_joints: usize, sample_s: f64) -> Result<Controller, ModelError> {
    table.only(&KEYS)?;
    let gains = |key: &str| -> Result<Vec<f64>, ModelError> {
        let entry = table.required(key, "one gain per joint")?;
        let values = entry.array()?.iter().map(|value| value.finite()).collect::<Result<Vec<_>, _>>()?;
        if values.len() == n_joints {
            return Ok(values);
        }
        let message = format!("`{key}` has {} values, the device {n_joints} joints", values.len());
        let zero = if key == "limit" { "" } else { "; 0 for a joint that is not controlled" };
        Err(entry.error(message).help(format!("give one value per joint{zero}")))
    };
    let positive = |key: &str| -> Result<Option<f64>, ModelError> {
        let Some(entry) = table.optional(key) else { return Ok(None) };
        let value = entry.finite()?;
        if value > 0.0 {
            return Ok(Some(value));
        }
        Err(entry.error(format!("`{key}` is {value}")).help("give a positive number, or leave it out"))
    };
    let filter = match (table.optional("filter"), positive("cutoff_hz")?) {
        (Some(entry), _) => {
            let filter = entry.table("the filter of Eq. 4.7: a2, a3, b1, b2")?;
            filter.only(&["a2", "a3", "b1", "b2"])?;
            let factor = |key: &str| filter.required(key, "a factor of Eq. 4.7")?.finite();
            Filter { a2: factor("a2")?, a3: factor("a3")?, b1: factor("b1")?, b2: factor("b2")? }
        }
        (None, Some(cutoff_hz)) => {
            let filter = Filter::butterworth(cutoff_hz, sample_s);
            if ![filter.a2, filter.a3, filter.b1, filter.b2].iter().all(|factor| factor.is_finite()) {
                let message = format!("`cutoff_hz` is {cutoff_hz}, of which no filter can be made");
                return Err(table.error(message).help("give a frequency below half of the samples a second"));
            }
            filter
        }
        (None, None) => Filter::THESIS,
    };
    let limit = match table.optional("limit") {
        Some(entry) => {
            let limits = gains("limit")?;
            if let Some((wrong, limit)) = entry.array()?.iter().zip(&limits).find(|(_, limit)| **limit <= 0.0) {
                let help = "give the largest torque that each joint can have, a positive number";
                return Err(wrong.error(format!("`limit` is {limit}")).help(help));
            }
            limits
        }
        None => vec![f64::INFINITY; n_joints],
    };
    Ok(Controller {
        proportional: gains("P")?,
        derivative: gains("D")?,
        filter,
        limit,
        position_quantum: positive("position_quantum")?.unwrap_or(0.0),
        torque_quantum: positive("torque_quantum")?.unwrap_or(0.0),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_holds_one_controller_or_one_per_run() {
        let parse = |text: &str| super::parse(&Source::new(Path::new("c.toml"), text), "b.csv", 1, 0.01);
        let single = parse("P = [2]\nD = [0.1]\ncutoff_hz = 15\nlimit = [0.5]").unwrap();
        assert_eq!((single.proportional[0], single.limit[0]), (2.0, 0.5));
        assert_eq!(single.filter, Filter::butterworth(15.0, 0.01));
        let text = "[slow]\nfile = \"a.csv\"\nP = [1]\nD = [0]\n[fast]\nfile = \"b.csv\"\nP = [3]\nD = [0.2]\n";
        assert_eq!(parse(text).unwrap().proportional, [3.0]);
        let wrong = parse("P = [1, 2]\nD = [0]").unwrap_err().to_string();
        assert!(wrong.contains("`P` has 2 values, the device 1 joints") && wrong.contains("c.toml:1:"), "{wrong}");
        let missing = parse("[slow]\nfile = \"a.csv\"\nP = [1]\nD = [0]").unwrap_err().to_string();
        assert!(missing.contains("no controller for the run `b.csv`"), "{missing}");
        // The cosine of its angle would be no number, and with it every torque.
        let huge = parse("P = [1]\nD = [0]\ncutoff_hz = 1.79e308").unwrap_err().to_string();
        assert!(huge.contains("of which no filter can be made"), "{huge}");
        let typo = parse("P = [1]\nD = [0]\ncutof_hz = 3").unwrap_err().to_string();
        assert!(typo.contains("cutoff_hz"), "{typo}");
    }
}

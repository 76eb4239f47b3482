//! Tables that the program writes for others: which format, by a name or as asked.

use std::path::Path;

use anyhow::bail;
use dynid_tables::{Format, Values, ending, written};

/// A format as an argument.
#[derive(Debug, Clone, Copy)]
pub struct LogFormat(pub Format);

impl std::str::FromStr for LogFormat {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = Format::ALL.into_iter().find_map(|(name, format)| (name == text).then_some(Self(format)));
        known.ok_or_else(|| format!("expected {}", names()))
    }
}

fn names() -> String {
    Format::ALL.map(|(name, _)| name).join(", ")
}

/// The format that a file's name promises: CSV where it promises none.
pub fn format_of(path: &Path) -> anyhow::Result<Format> {
    match (Format::of(path), ending(path)) {
        (Some(format), _) => Ok(format),
        (None, Some(ending)) if ending != "txt" => {
            bail!("{}: .{ending} is read but not written; let the name end in one of {}", path.display(), names())
        }
        (None, _) => Ok(Format::Csv),
    }
}

/// A file of numbers.
pub fn log_file(columns: Vec<(String, Vec<f64>)>, format: Format) -> Vec<u8> {
    let columns: Vec<(String, Values)> =
        columns.into_iter().map(|(name, values)| (name, Values::Numbers(values))).collect();
    written(&columns, format)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_promises_what_is_written() {
        assert_eq!(format_of(Path::new("a/run.Parquet")).unwrap(), Format::Parquet);
        assert_eq!(format_of(Path::new("run")).unwrap(), Format::Csv);
        let error = format_of(Path::new("run.csv.gz")).unwrap_err().to_string();
        assert!(error.contains(".csv.gz is read but not written") && error.contains("parquet"), "{error}");
    }
}

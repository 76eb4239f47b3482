//! Files that other libraries wrote (`files/README.md`), whole, damaged and cut.

use std::{
    fs,
    path::{Path, PathBuf},
};

use dynid_random::Random;
use dynid_tables::{Cells, ENDINGS, Remark, Table};

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/files").join(name)
}

/// All columns, a line each; `-` where there is nothing.
fn columns(path: &Path) -> Result<Vec<String>, String> {
    let table = Table::open(path).map_err(|error| error.to_string())?;
    let places: Vec<usize> = (0..table.names().len()).collect();
    let columns = table.columns(&places, 0..table.n_rows()).map_err(|error| error.to_string())?;
    let mut lines = Vec::new();
    for ((place, name), column) in table.names().iter().enumerate().zip(columns) {
        let cells = column.values.iter().enumerate().map(|(row, value)| match value {
            value if value.is_nan() => match table.cell(row, place) {
                Ok(cell) if cell.text.is_empty() => "-".to_owned(),
                Ok(cell) => cell.text,
                Err(error) => error.to_string(),
            },
            value => value.to_string(),
        });
        lines.push(format!("{name}: {}", cells.collect::<Vec<_>>().join(" ")));
    }
    Ok(lines)
}

fn remarks(name: &str) -> Vec<Remark> {
    Table::open(&file(name)).unwrap().remarks().to_vec()
}

/// What is wrong with a file.
fn refusal(path: &Path) -> String {
    columns(path).expect_err("the file is not usable")
}

#[test]
fn a_log_has_the_same_numbers_in_every_format() {
    let text = columns(&file("../../../../src/tour/wrist-1.csv")).unwrap();
    for name in ["wrist-1.csv.gz", "wrist-1.csv.zst", "wrist-1.parquet", "wrist-1.feather", "wrist-1.mat"] {
        assert_eq!(columns(&file(name)).unwrap(), text, "{name}");
    }
    let renamed = |line: &String| {
        let (name, numbers) = line.split_once(':').unwrap();
        let joint = name.trim_start_matches(|c: char| c.is_alphabetic());
        let field = if name.starts_with("tau") { "effort" } else { "position" };
        let own = if name == "t" { name.to_owned() } else { format!("/joint_states.{field}[joint_{joint}]") };
        format!("{own}:{numbers}")
    };
    let mut expected: Vec<String> = text.iter().map(renamed).collect();
    // Positions come first in a message.
    expected[1..].rotate_left(6);
    assert_eq!(columns(&file("wrist-1.mcap")).unwrap(), expected);
}

#[test]
fn every_ending_is_that_of_a_file_here_or_of_text() {
    let read = ["csv.gz", "csv.zst", "parquet", "arrow", "feather", "mat", "mcap"];
    for ending in ENDINGS {
        let is_text = ["csv", "tsv", "txt"].contains(&ending.split('.').next().unwrap());
        assert!(is_text || read.contains(&ending), "{ending}");
    }
}

#[test]
fn columns_of_numbers_lists_and_structs_are_read_and_others_left_out() {
    let expected = [
        "stamp: 0 0.0015 0.003",
        "ms: 0 - 0.002",
        "int: -1 - 3",
        "large: 1 9223372036854776000 3",
        "single: 0.5 NaN -2",
        "on: 1 0 -",
        "q[0]: 1 3 -",
        "q[1]: 2 - -",
        "fixed[0]: 1 3 5",
        "fixed[1]: 2 4 6",
        "arm.tau: 1 - 3",
    ];
    for name in ["kinds.parquet", "kinds-lz4.parquet", "kinds-gzip.parquet", "kinds.arrow", "kinds-stream.arrow"] {
        assert_eq!(columns(&file(name)).unwrap(), expected, "{name}");
    }
    assert!(refusal(&file("ragged.parquet")).contains("the lists in column `q` are not all of 2 items as the first"));
    assert!(refusal(&file("ragged.arrow")).contains("the lists in column `q` have 2 items and 1"));
}

#[test]
fn parts_of_columns_are_read() {
    for name in ["kinds.parquet", "kinds.arrow"] {
        let table = Table::open(&file(name)).unwrap();
        let [q, int] = &table.columns(&[7, 2], 1..3).unwrap()[..] else { panic!("two are asked for") };
        assert_eq!((q.no_number, int.no_number), (Some(1), Some(1)), "{name}");
        assert_eq!(int.values[1], 3.0, "{name}");
        assert_eq!(table.cell(1, 2).unwrap().line, None);
    }
}

#[test]
fn variables_of_matlab_that_are_as_long_as_most_are_columns() {
    let expected = [
        "t: 0 0.5 1 1.5",
        "q[0]: 0 2 4 6",
        "q[1]: 1 3 5 7",
        "wide[0]: 0 1 2 3",
        "wide[1]: 4 5 6 7",
        "wide[2]: 8 9 10 11",
        "on: 1 0 1 1",
        "arm.tau: 1 2 3 4",
        "arm.deep.u: 0 1 2 3",
        "cube: 0 1 2 3",
    ];
    let found = columns(&file("kinds.mat")).unwrap();
    let (cube, rest) = (found.last().unwrap(), &found[..9]);
    assert_eq!(rest, &expected[..9]);
    assert_eq!(cube, expected[9]);
    let gain = Remark::OtherLengths { n_rows: 4, names: vec!["gain".to_owned()] };
    assert_eq!(remarks("kinds.mat"), [gain]);
}

#[test]
fn topics_of_other_rates_are_joined_on_the_times_of_the_richest() {
    let expected = [
        "t: 0 0.01 0.02",
        "/joint_states.position[shoulder]: 1 2 3",
        "/joint_states.position[elbow]: 11 12 13",
        "/joint_states.velocity[shoulder]: 1 1 1",
        "/joint_states.velocity[elbow]: 2 2 2",
        // The command of 5 ms holds until that of 15 ms, and that until 35 ms.
        "/commands.effort[shoulder]: 5 15 15",
        "/commands.effort[elbow]: -5 -15 -15",
        // On the line between 0 and 0.02 at 20 ms and 0.036 at 36 ms.
        "/joint_states.position[finger]: 0.01 0.02 0.03",
    ];
    assert_eq!(columns(&file("joined.mcap")).unwrap(), expected);
    let others = vec!["/commands".to_owned(), "/joint_states".to_owned()];
    assert_eq!(remarks("joined.mcap"), [Remark::Joined { clock: "/joint_states".to_owned(), others, left_out: 2 }]);
}

#[test]
fn messages_without_stamps_have_the_times_of_logging_and_json_is_read_too() {
    let found = columns(&file("unstamped.mcap")).unwrap();
    assert_eq!(found[..2], ["t: 0 0.01 0.02 0.03 0.04", "/joint_states.position[shoulder]: 0 1 2 3 4"]);
    assert_eq!(remarks("unstamped.mcap"), [Remark::TimeOfLogging]);
    let expected = ["t: 0 0.000001 0.000002", "/joints.position[a]: 0 1 2", "/joints.effort[a]: 0 -1 -2"];
    assert_eq!(columns(&file("json.mcap")).unwrap(), expected);
}

const ALL: [&str; 13] = [
    "wrist-1.csv.gz",
    "wrist-1.csv.zst",
    "kinds.parquet",
    "kinds-lz4.parquet",
    "kinds-gzip.parquet",
    "kinds.arrow",
    "kinds-stream.arrow",
    "ragged.arrow",
    "kinds.mat",
    "wrist-1.mat",
    "joined.mcap",
    "unstamped.mcap",
    "json.mcap",
];

/// Opens bytes as a file of this name.
fn open_bytes(folder: &Path, name: &str, bytes: &[u8]) -> Result<Vec<String>, String> {
    let path = folder.join(name);
    fs::write(&path, bytes).unwrap();
    columns(&path)
}

#[test]
fn a_third_of_a_file_is_refused_in_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    for name in ALL {
        let bytes = fs::read(file(name)).unwrap();
        let error = open_bytes(folder.path(), name, &bytes[..bytes.len() / 3]).expect_err(name);
        assert!(!error.contains('\n') && error.len() < 300, "{name}: {error}");
    }
    let error = open_bytes(folder.path(), "log.parquet", b"t,q0\n0,1\n").unwrap_err();
    assert_eq!(error, "it does not begin as a file of Parquet does");
    let error = open_bytes(folder.path(), "log.mat", b"MATLAB 7.3 MAT-file").unwrap_err();
    assert!(error.contains("it is no whole file of MATLAB 7.3"), "{error}");
}

#[test]
fn damaged_files_are_read_or_refused_in_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random::new(7);
    let mut below = |end: usize| (random.unit() * end as f64) as usize;
    for name in ALL {
        let whole = fs::read(file(name)).unwrap();
        for _ in 0..150 {
            let mut bytes = whole.clone();
            for _ in 0..1 + below(3) {
                let place = below(bytes.len());
                // Lengths become absurd where all bits are set.
                bytes[place] = if below(2) == 0 { 0xff } else { below(256) as u8 };
            }
            bytes.truncate(bytes.len() - if below(4) == 0 { below(bytes.len() / 2) } else { 0 });
            if let Err(error) = open_bytes(folder.path(), name, &bytes) {
                assert!(!error.contains('\n'), "{name}: {error}");
            }
        }
    }
}

/// A limit of what may be unpacked holds in each format that packs, and for all of its parts together.
#[test]
fn no_more_is_unpacked_than_may_be() {
    let read = |name: &str, unpacked: u64| {
        let table = Table::open_within(&file(name), unpacked).map_err(|error| error.to_string())?;
        let places: Vec<usize> = (0..table.names().len()).collect();
        table.columns(&places, 0..table.n_rows()).map_err(|error| error.to_string())
    };
    for name in ["wrist-1.csv.gz", "wrist-1.csv.zst", "wrist-1.parquet", "wrist-1.mat", "wrist-1.mcap"] {
        assert!(read(name, 1 << 20).is_ok(), "{name}");
        let error = read(name, 1 << 11).expect_err(name);
        assert!(error.contains("more than"), "{name}: {error}");
    }
}

#[cfg(unix)]
#[test]
fn a_pipe_is_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("log.csv");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let error = Table::open(&pipe).unwrap_err().to_string();
    assert!(error.contains("a pipe or a device"), "{error}");
}

#[test]
fn nights_of_older_writers_are_dates() {
    let read = Cells::open(&file("nights-int96.parquet")).unwrap();
    let nights: Vec<&str> = read.rows.iter().map(|row| row.cells[1].as_str()).collect();
    assert_eq!(nights, ["2026-03-01", "2026-03-02 00:00:01.500", ""]);
}

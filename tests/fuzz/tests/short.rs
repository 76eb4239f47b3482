//! So many inputs of every reader as a change can wait for; `cargo xtask fuzz` tries many more, and the program and its server.

use std::process::Command;

fn fuzz(arguments: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_dynid-fuzz"))
        .args(arguments)
        .arg("--failures")
        .arg(folder.path())
        .output()
        .unwrap();
    let (told, failed) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{told}\n{failed}");
    told.into_owned()
}

#[test]
fn no_reader_is_broken_by_some_thousand_inputs() {
    let told = fuzz(&["--inputs", "22000", "--seed", "1"]);
    // Each of the readers accepts some inputs and refuses others: what refuses all would find nothing.
    let rows: Vec<Vec<&str>> = told.lines().skip(2).map(|line| line.split('|').map(str::trim).collect()).collect();
    assert_eq!(rows.len(), 23, "{told}");
    for row in &rows {
        let count = |column: usize| row[column].parse::<u64>().unwrap();
        let (inputs, accepted, refused) = (count(2), count(4), count(5));
        assert!(accepted > 0 && refused > 0 && accepted + refused == inputs, "{}", row.join(" | "));
    }
}

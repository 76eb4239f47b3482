//! What was measured, as a table in the terminal and as docs/speed.md.

use std::fs;
use std::process::Command;
use std::thread;

use serde_json::Value;

use super::{Row, Work};
use crate::shell;

const PAGE: &str = "docs/speed.md";

/// Prints the table, and why peers are missing.
pub fn print(rows: &[Row], measured: &Value) {
    println!("\n{:<34} {:<18} {:>10} {:>8}  the same work?", "work", "by", "seconds", "ratio");
    for Row { work, by, seconds, ratio, same } in rows {
        println!("{work:<34} {by:<18} {seconds:>10.2e} {ratio:>8.2}  {same}");
    }
    missing(measured).iter().for_each(|line| println!("{line}"));
}

/// Writes the page.
pub fn write(works: &[Work], rows: &[Row], ours: &Value, measured: &Value, sizes: &Value) -> anyhow::Result<()> {
    let page = shell::root().join(PAGE);
    fs::write(&page, text(works, rows, ours, measured, sizes))?;
    println!("\nwrote {PAGE}");
    Ok(())
}

fn text(works: &[Work], rows: &[Row], ours: &Value, measured: &Value, sizes: &Value) -> String {
    let mut text = String::from(
        "# What things cost\n\n\
         Written by `cargo xtask bench --peers`, which measures all of this in one run: do not edit. One core, but where threads are named.\n\
         Beside other programs: CPU seconds of one thread, the best of five, of our fits the best of three, of the peers' the only one.\n\
         Against size: wall time.\n\
         Accelerations of a million states at once, from Python, beside Pinocchio's Python and CasADi: [`python/README.md`](../python/README.md#arrays).\n\
         A peer counts only where a number shows that it did the same work: that is the last column.\n\n",
    );
    let mut line = |line: String| text += &(line + "\n");
    line(format!(
        "- machine: {}, {} cores",
        processor(),
        thread::available_parallelism().map_or(1, |cores| cores.get())
    ));
    line(format!("- commit: {}", commit()));
    let versions = measured["peers"].as_array().into_iter().flatten().flat_map(|peer| strings(&peer["versions"]));
    let mut versions: Vec<String> =
        said("rustc", &["--version"]).into_iter().chain(strings(&measured["tools"])).chain(versions).collect();
    let mut known = Vec::new();
    versions.retain(|version| {
        let is_new = !known.contains(version);
        known.push(version.clone());
        is_new
    });
    line(format!("- versions: {}", versions.join("; ")));
    line("\n## Beside other programs\n".to_owned());
    works.iter().for_each(|work| line(format!("- `{}`: {}", work.id, work.what)));
    line("\n| work | by | seconds | ratio | the same work? |".to_owned());
    line("| --- | --- | ---: | ---: | --- |".to_owned());
    for Row { work, by, seconds, ratio, same } in rows {
        line(format!("| `{work}` | {by} | {seconds:.2e} | {ratio:.2} | {same} |"));
    }
    let missing = missing(measured);
    if !missing.is_empty() {
        line(format!("\n{}", missing.join("\n\n")));
    }
    line("\n## Lanes\n".to_owned());
    line("One acceleration of the Freedom 6S, all six joints free: alone, and a state's share where eight are computed at once, with the same bits.".to_owned());
    line("The floor is what its additions, multiplications and divisions take where none waits for another, measured in the same registers.\n".to_owned());
    line("| numbers in a register | seconds | floor (s) |".to_owned());
    line("| ---: | ---: | ---: |".to_owned());
    for row in ours["lanes"].as_array().into_iter().flatten() {
        let floor = row["floor"].as_f64().map_or(String::new(), |floor| format!("{floor:.2e}"));
        line(format!("| {} | {:.2e} | {floor} |", row["lanes"], row["seconds"].as_f64().unwrap_or(f64::NAN)));
    }
    line("\n## Adapted steps\n".to_owned());
    line("As many steps of a sample as the peers take, and as few as a tolerance asks for, which is what a user gets who states nothing;".to_owned());
    line("how far the latter are from steps ten times as short as the former.\n".to_owned());
    line("| work | steps of 1/6 ms (s) | adapted (s) | times as fast | largest deviation (rad) |".to_owned());
    line("| --- | ---: | ---: | ---: | ---: |".to_owned());
    for row in ours["adapted"].as_array().into_iter().flatten() {
        let number = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
        let (stated, adapted) = (number("stated_s"), number("adapted_s"));
        let what = row["what"].as_str().unwrap_or_default();
        line(format!("| {what} | {stated:.2e} | {adapted:.2e} | {:.1} | {:.0e} |", stated / adapted, number("away")));
    }
    line("\n## Cost against size\n".to_owned());
    line("The exponent is that of the power law through the larger half of the sizes, by least squares of the logarithms; each size has".to_owned());
    line("a process of its own, and its peak memory is that process's.".to_owned());
    for work in sizes.as_array().into_iter().flatten() {
        let of = |key: &str| work[key].as_str().unwrap_or_default().to_owned();
        let exponent = work["exponent"].as_f64().unwrap_or(f64::NAN);
        line(format!("\n**{}**: {}. Exponent {exponent:.2}.\n", of("name"), of("what")));
        line(format!("| {} | seconds | peak memory (MB) |", of("size")));
        line("| ---: | ---: | ---: |".to_owned());
        for point in work["points"].as_array().into_iter().flatten() {
            let memory = point["peak_kb"].as_f64().map_or("not known".to_owned(), |kb| format!("{:.0}", kb / 1000.0));
            line(format!("| {} | {:.2e} | {memory} |", point["size"], point["seconds"].as_f64().unwrap_or(f64::NAN)));
        }
    }
    text
}

/// Why peers are missing, a sentence each.
fn missing(measured: &Value) -> Vec<String> {
    let failed = measured["failed"].as_str().map(|why| format!("No peer was measured: {why}"));
    let peers = measured["peers"].as_array().into_iter().flatten();
    let missing = peers.filter_map(|peer| Some((peer["name"].as_str()?, peer["missing"].as_str()?)));
    failed.into_iter().chain(missing.map(|(name, why)| format!("{name} is missing: {why}"))).collect()
}

fn strings(value: &Value) -> Vec<String> {
    value.as_array().into_iter().flatten().filter_map(Value::as_str).map(str::to_owned).collect()
}

/// First line of what a program says.
fn said(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).current_dir(shell::root()).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    text.lines().next().filter(|_| output.status.success()).map(|line| line.trim().to_owned())
}

/// What the processor calls itself, where the system tells.
fn processor() -> String {
    let information = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = information.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let model = model.map(|(_, model)| model.trim().to_owned());
    let model = model.or_else(|| said("sysctl", &["-n", "machdep.cpu.brand_string"]));
    model.unwrap_or_else(|| "a processor that is not known".to_owned())
}

/// The commit that was measured, and whether the tree was another.
fn commit() -> String {
    let Some(commit) = said("git", &["rev-parse", "--short=12", "HEAD"]) else { return "not known".to_owned() };
    let page = format!(":!{PAGE}");
    let changed = said("git", &["status", "--porcelain", "--", ".", &page]).is_some();
    if changed { format!("{commit}, with changes") } else { commit }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::WORKS;
    use super::*;

    #[test]
    fn the_page_has_the_rows_the_sizes_and_why_a_peer_is_missing() {
        let measured = json!({
            "peers": [
                { "name": "this", "versions": ["this 1.0", "that 2.0"], "simulate": 2.0, "away": 1e-9 },
                { "name": "that", "versions": ["that 2.0"], "missing": "there is no C compiler (cc)" },
            ],
            "tools": ["Python 3.11.7"],
        });
        let verdict = WORKS[1].check.verdict(&measured["peers"][0]);
        let row = Row { work: WORKS[1].id, by: "this".to_owned(), seconds: 2.0, ratio: 4.0, same: verdict };
        let points =
            json!([{ "size": 1, "seconds": 1e-3, "peak_kb": 2000 }, { "size": 2, "seconds": 1e-2, "peak_kb": null }]);
        let sizes = json!([{ "name": "read", "what": "reading", "size": "rows", "points": points, "exponent": 1.25 }]);
        let ours = json!({
            "adapted": [{ "what": "one joint", "stated_s": 0.2, "adapted_s": 0.025, "away": 2e-6 }],
            "lanes": [{ "lanes": 1, "seconds": 2e-7, "floor": null }, { "lanes": 8, "seconds": 4e-8, "floor": 2e-8 }],
        });
        let text = text(&WORKS, &[row], &ours, &measured, &sizes);
        let row = "| `simulate/freedom6s/all_60s` | this | 2.00e0 | 4.00 | yes: 1e-9 rad from our final positions |\n";
        let others = [
            "; Python 3.11.7; this 1.0; that 2.0\n",
            "\nthat is missing: there is no C compiler (cc)\n",
            "\n| 1 | 2.00e-7 |  |\n| 8 | 4.00e-8 | 2.00e-8 |\n",
            "\n| one joint | 2.00e-1 | 2.50e-2 | 8.0 | 2e-6 |\n",
            "**read**: reading. Exponent 1.25.\n",
            "| 1 | 1.00e-3 | 2 |\n| 2 | 1.00e-2 | not known |\n",
        ];
        for part in [row].into_iter().chain(others) {
            assert!(text.contains(part), "{part:?} is not in\n{text}");
        }
        let failed = missing(&json!({ "failed": "there is no python3" }));
        assert_eq!(failed, ["No peer was measured: there is no python3"]);
    }

    #[test]
    fn other_work_and_no_answer_are_not_the_same_work() {
        let verdict = |peer: Value| WORKS[1].check.verdict(&peer);
        assert_eq!(verdict(json!({ "away": 0.2 })), "NO: 2e-1 rad from our final positions");
        assert!(verdict(json!({})).starts_with("NO"));
        let fit = WORKS[2].check.verdict(&json!({ "rmse": 0.1, "noise_reached": false }));
        assert_eq!(fit, "NO: stops at 1.00e-1 rad");
    }
}

//! `dynid wall report`: one page that needs no network, the same bytes whatever the number of threads, true to `wall compare`.

use std::fs;
use std::path::Path;
use std::process::Output;

use crate::page::{is_well_formed, opens_with_no_network};
use assert_cmd::Command;
use serde_json::Value;

fn run(folder: &Path, arguments: &[&str], threads: &str) -> Output {
    let mut command = Command::cargo_bin("dynid").unwrap();
    command.arg("wall").args(arguments).env("RAYON_NUM_THREADS", threads).current_dir(folder).output().unwrap()
}

fn answered(folder: &Path, arguments: &[&str]) -> Value {
    let output = run(folder, &[arguments, &["--json"]].concat(), "2");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, &[&["report"], arguments].concat(), "2");
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", String::from_utf8_lossy(&output.stdout));
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(message.lines().filter(|line| line.starts_with("error: ")).count(), 1, "{message}");
    message
}

#[test]
fn the_page_holds_everything_and_reaches_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let walls = ["--wall", "pd,fuzzy", "--hands", "3"];
    let json = answered(folder.path(), &[&["report"], &walls[..], &["--out", "page.html"]].concat());
    let page = fs::read_to_string(folder.path().join("page.html")).unwrap();
    opens_with_no_network(&page);
    is_well_formed(&page);
    for heading in [
        "Verdict",
        "Chatter of every hand",
        "Measures",
        "A typical hand at the wall",
        "Where the handle settles",
        "What holds against a steady push",
        "Torque over position and velocity",
        "Fuzzy sets",
        "Rules",
        "The setting",
        "Where this came from",
    ] {
        assert!(page.contains(&format!("<h2>{heading}</h2>")), "{heading}");
        assert!(json["sections"].as_array().unwrap().contains(&heading.into()), "{heading}");
    }
    // dots; three approaches; three settled; static torque; two surfaces and their difference; sets of two inputs and a zoom.
    assert_eq!(page.matches("<svg class=\"dynid-plot").count(), 1 + 3 + 3 + 1 + 3 + 3);
    // two walls, three speeds, three hands
    assert_eq!(page.matches("<path class=\"mark hue").count(), 2 * 3 * 3 + 3, "a dot for each case, and the legend's");
    assert_eq!(page.matches(" class=\"core\"").count(), 7 * 9, "the thesis's range of interest");
    // Figure 5.6: seven rules in each of the columns N6 to N3 and Z0, three in N2, six in N1
    assert_eq!(page.matches("\u{2022}</b></td>").count(), 5 * 7 + 3 + 6, "modified rules are marked");
    assert!(page.contains("the device damps with 0.00351 N*m*s/rad of its own (joint.0.lugre.sigma2)"));
    assert!(!page.contains("NaN") && !page.contains(">inf"), "every number is one");
    for part in ["fuzzy less pd", "@media print", "dynid wall report --hands 3 --wall pd,fuzzy --out page.html"] {
        assert!(page.contains(part), "{part}");
    }
    for (name, text) in dynid_haptics::wall::SHIPPED.iter().filter(|(name, _)| ["pd", "fuzzy"].contains(name)) {
        let digest = dynid_model::sha256_hex(text.as_bytes());
        assert!(page.contains(&format!("<dt>wall {name}</dt><dd>sha256 {digest}</dd>")), "{name}");
    }
    // the cases are those of `compare`, and the sentences are made of them
    let compared = answered(folder.path(), &[&["compare"], &walls[..]].concat());
    assert_eq!(json["cases"], compared["cases"]);
    let cases = compared["cases"].as_array().unwrap();
    let worst = cases
        .iter()
        .filter(|case| case["controller"] == "pd")
        .max_by(|a, b| a["chatter_rms"].as_f64().unwrap().total_cmp(&b["chatter_rms"].as_f64().unwrap()))
        .unwrap();
    let sentences = json["sentences"].as_array().unwrap();
    assert_eq!(sentences.len(), 3, "{json}");
    let hand = format!("(hand {}, {})", worst["hand"], worst["speed"].as_str().unwrap());
    assert!(sentences[0].as_str().unwrap().contains(&hand), "{hand}: {}", sentences[0]);

    for threads in ["1", "3"] {
        let output =
            run(folder.path(), &[&["report"], &walls[..], &["--out", "page.html", "--force"]].concat(), threads);
        assert!(output.status.success());
        let other = fs::read_to_string(folder.path().join("page.html")).unwrap();
        assert!(other == page, "{threads} threads make another page");
    }
}

#[test]
fn a_page_without_rules_has_no_sections_about_them() {
    let folder = tempfile::tempdir().unwrap();
    let json = answered(folder.path(), &["report", "--wall", "pd", "--hands", "1", "--out", "page.html"]);
    let page = fs::read_to_string(folder.path().join("page.html")).unwrap();
    is_well_formed(&page);
    assert_eq!(json["sentences"].as_array().unwrap().len(), 2, "nothing to compare with: {json}");
    assert!(!page.contains("<h2>Rules</h2>") && !page.contains("NaN"));
}

/// Without a choice all walls that the program carries stand on the page, and each says what it is.
#[test]
fn laws_of_other_kinds_stand_beside() {
    let folder = tempfile::tempdir().unwrap();
    let json = answered(folder.path(), &["report", "--hands", "1", "--out", "page.html"]);
    let page = fs::read_to_string(folder.path().join("page.html")).unwrap();
    is_well_formed(&page);
    opens_with_no_network(&page);
    assert_eq!(json["cases"].as_array().unwrap().len(), 8 * 3, "eight walls, three speeds");
    for part in ["watched by a passivity controller", "pushed in it holds like", "a tool of inertia"] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("NaN"));
    assert!(page.contains(" kg*m^2 behind "), "an inertia has its unit");
    // Colgate & Schenkel's bound is that of a spring and damper, and the device's damping stands beside it only.
    assert_eq!(page.matches("Colgate &amp; Schenkel").count(), 2, "pd and pd_tuned");
    assert!(page.contains("of its own (joint.0.lugre.sigma2)"));
    answered(folder.path(), &["report", "--wall", "leaky,fuzzy", "--hands", "1", "--out", "other.html"]);
    let page = fs::read_to_string(folder.path().join("other.html")).unwrap();
    assert!(!page.contains("Colgate") && !page.contains("of its own (joint.0.lugre.sigma2)"));
}

#[test]
fn what_makes_no_page_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    put("mine.html", "mine");
    put("pd.toml", dynid_haptics::wall::SHIPPED[0].1);
    put("broken.toml", "title = \"x\"\ntorque_per_unit = 1\n");
    let bad = |arguments: &[&str]| refused(folder.path(), arguments);
    let message = bad(&["--out", "mine.html"]);
    assert!(message.contains("mine.html exists already") && message.contains("--force"), "{message}");
    assert!(bad(&["--wall", "fuzy", "--out", "new.html"]).contains("`fuzzy`"));
    assert!(bad(&["--wall", "absent.toml", "--out", "new.html"]).contains("absent.toml"));
    assert!(bad(&["--wall", "broken.toml", "--out", "new.html"]).contains("no law"));
    assert!(bad(&["--wall", "pd,pd.toml", "--out", "new.html"]).contains("two walls are named `pd`"));
    assert!(bad(&["--setting", "absent.toml", "--out", "new.html"]).contains("absent.toml"));
    assert!(bad(&["--model", "absent.toml", "--out", "new.html"]).contains("absent.toml"));
    assert_eq!(fs::read_to_string(folder.path().join("mine.html")).unwrap(), "mine");
    assert!(!folder.path().join("new.html").exists());
}

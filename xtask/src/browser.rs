//! The live page in a real browser, where there is one or one may be installed.

use std::process::{Command, Stdio};

use crate::shell;

/// Programs that the tests start, and the packages of Debian that hold them.
const NEEDED: [(&str, &str); 2] = [("chromium", "chromium"), ("chromedriver", "chromium-driver")];

/// Uses the page as people do; without a browser it says loudly that nobody did, and fails where `CI` is set.
pub fn tests() -> anyhow::Result<()> {
    if !missing().is_empty()
        && is_root()
        && is_there("apt-get")
        && let Err(error) = install()
    {
        eprintln!("{error:#}");
    }
    let missing = missing();
    if !missing.is_empty() {
        let message = format!(
            "the live page was NOT tested in a browser: {} not here; install Debian's packages chromium and chromium-driver",
            if missing.len() == 1 { format!("{} is", missing[0]) } else { format!("{} are", missing.join(" and ")) }
        );
        anyhow::ensure!(std::env::var_os("CI").is_none(), message);
        eprintln!("\n{0}\n{message}\n{0}\n", "!".repeat(message.len()));
        return Ok(());
    }
    // The tests start the program that lies beside them. Left out are `pictures`, which write the README's.
    shell::built_for_tests("dynid")?;
    let tests = ["--test", "page", "--test", "live", "--no-fail-fast", "--", "--ignored", "--show-output"];
    shell::succeed(&mut shell::cargo_test(&tests))
}

fn missing() -> Vec<&'static str> {
    NEEDED.iter().map(|(program, _)| *program).filter(|program| !is_there(program)).collect()
}

fn is_there(program: &str) -> bool {
    let mut command = Command::new(program);
    command.arg("--version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

fn is_root() -> bool {
    Command::new("id").arg("-u").output().is_ok_and(|output| output.stdout.trim_ascii() == b"0")
}

fn install() -> anyhow::Result<()> {
    let apt = |arguments: &[&str]| {
        let mut command = Command::new("apt-get");
        command.args(arguments).env("DEBIAN_FRONTEND", "noninteractive").stdin(Stdio::null());
        shell::succeed(&mut command)
    };
    apt(&["update"])?;
    apt(&[&["install", "--yes"][..], &NEEDED.map(|(_, package)| package)].concat())
}

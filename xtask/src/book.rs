//! The pages of the book, where mdBook is there to build them. What the book says is tested elsewhere: `tests/book.rs`,
//! `python/tests/test_book.py`.

use std::process::{Command, Stdio};

use crate::shell;

/// Builds `docs/book` into `target/book`; without mdBook it says so, and fails where `CI` is set.
pub fn build() -> anyhow::Result<()> {
    if !is_there() {
        let message = "the book was NOT built: mdbook is not here; `.ci/run` installs it, or `cargo install mdbook`";
        anyhow::ensure!(std::env::var_os("CI").is_none(), message);
        eprintln!("{message}");
        return Ok(());
    }
    let target = shell::root().join("target/book");
    let mut command = mdbook();
    command.arg("build").arg(shell::root().join("docs/book")).arg("--dest-dir").arg(&target);
    shell::succeed(&mut command)?;
    anyhow::ensure!(target.join("index.html").is_file(), "mdbook wrote no target/book/index.html");
    Ok(())
}

fn is_there() -> bool {
    let mut command = mdbook();
    command.arg("--version").stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

fn mdbook() -> Command {
    let mut command = Command::new("mdbook");
    command.stdin(Stdio::null());
    command
}

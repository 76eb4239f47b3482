//! The program under test: as a server of the page, and as it answers on a terminal.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use serde_json::Value;
use tempfile::TempDir;

/// The `dynid` that was built beside this test.
///
/// # Panics
///
/// Where it is not built.
#[must_use]
pub fn program() -> PathBuf {
    let own = std::env::current_exe().expect("a test has a path");
    let folder = own.parent().and_then(Path::parent).expect("tests are built into target/PROFILE/deps");
    let program = folder.join(format!("dynid{}", std::env::consts::EXE_SUFFIX));
    assert!(program.is_file(), "{} is not there; build it first: cargo build --release", program.display());
    program
}

/// What a command prints with `--json`.
///
/// # Panics
///
/// Where it prints anything else.
#[must_use]
pub fn json(folder: &Path, arguments: &[&str]) -> Value {
    let output = Command::new(program()).args(arguments).arg("--json").current_dir(folder).output().expect("it starts");
    let said = String::from_utf8_lossy(&output.stderr);
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("dynid {arguments:?}: {error}: {said}"))
}

/// A folder with these of the tour's files, in whose logs the motor of joint 5 pulls at joint 4.
///
/// # Panics
///
/// Where one cannot be copied.
#[must_use]
pub fn tour(names: &[&str]) -> TempDir {
    let folder = TempDir::new().expect("a temporary folder");
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../src/tour");
    for name in names {
        fs::copy(from.join(name), folder.path().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    }
    folder
}

/// A `dynid open` of a folder; killed when it is dropped.
pub struct Server {
    child: Child,
    /// Where its page is, with the slash at the end.
    pub address: String,
}

impl Server {
    /// Starts it in a folder.
    ///
    /// # Panics
    ///
    /// Where it does not print its address.
    #[must_use]
    pub fn open(folder: &Path, arguments: &[&str]) -> Self {
        let mut child = Command::new(program())
            .arg("open")
            .args(arguments)
            .arg("--no-browser")
            .current_dir(folder)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("dynid starts");
        let mut line = String::new();
        BufReader::new(child.stdout.as_mut().expect("it is piped")).read_line(&mut line).expect("it prints");
        let address = line.trim().strip_prefix("open: ").unwrap_or_else(|| panic!("no address: {line}")).to_owned();
        Self { child, address }
    }

    /// The port that it listens at.
    ///
    /// # Panics
    ///
    /// Where its address has none.
    #[must_use]
    pub fn port(&self) -> &str {
        self.address.split([':', '/']).nth(4).expect("http://HOST:PORT/TOKEN/")
    }

    /// Ends it at once, as a power failure would.
    ///
    /// # Panics
    ///
    /// Where it cannot be killed.
    pub fn kill(&mut self) {
        self.child.kill().expect("it can be killed");
        self.child.wait().expect("it is gone");
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

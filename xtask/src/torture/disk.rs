//! A small disk of a test's own, which can be full or read-only even for root.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::bail;

/// A tmpfs over a folder; gone when dropped.
pub struct Disk {
    place: PathBuf,
}

const FILLER: &str = ".filler";

fn succeeds(program: &str, arguments: &[&str], place: &Path) -> bool {
    let mut command = Command::new(program);
    command.args(arguments).arg(place).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

impl Disk {
    /// Where this process may mount one.
    pub fn mount(place: &Path) -> anyhow::Result<Self> {
        fs::create_dir_all(place)?;
        if succeeds("mount", &["-t", "tmpfs", "-o", "size=2m", "dynid-torture"], place) {
            Ok(Self { place: place.to_owned() })
        } else {
            bail!("no tmpfs may be mounted")
        }
    }

    /// Fills it but for so many bytes.
    pub fn fill(&self, but: u64) -> std::io::Result<()> {
        let path = self.place.join(FILLER);
        let mut file = File::create(&path)?;
        let block = [0; 4096];
        while file.write_all(&block).is_ok() {}
        file.set_len(file.metadata()?.len().saturating_sub(but))
    }

    /// Whether writing was taken away: not while a file is being written.
    pub fn lock(&self) -> bool {
        succeeds("mount", &["-o", "remount,ro"], &self.place)
    }

    /// As it was.
    pub fn mend(&self) {
        succeeds("mount", &["-o", "remount,rw"], &self.place);
        // It may never have been filled.
        let _ = fs::remove_file(self.place.join(FILLER));
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        succeeds("umount", &["-l"], &self.place);
    }
}

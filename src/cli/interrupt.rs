//! Ctrl-C: the first asks the fit to stop after its iteration, the second ends the program at once.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::{flag, low_level};

/// Exit status of a program that Ctrl-C ended: 128 and the number of the signal.
pub const STATUS: u8 = 130;

/// Whether somebody asked to stop.
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens from now on.
    pub fn listen() -> anyhow::Result<Self> {
        let asked = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            // The order matters: what ends the program looks at the flag before this signal raises it.
            flag::register_conditional_shutdown(signal, i32::from(STATUS), Arc::clone(&asked))
                .and_then(|_| flag::register(signal, Arc::clone(&asked)))
                .context("cannot listen for Ctrl-C")?;
        }
        Ok(Self(asked))
    }

    /// Whether somebody did.
    pub fn is_asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Does as Ctrl-C does once stdin ends: nobody holds the other end of the pipe any more.
pub fn when_stdin_ends() {
    std::thread::spawn(|| {
        // What comes before the end does not matter, nor does how it ends.
        let _ = io::copy(&mut io::stdin().lock(), &mut io::sink());
        let _ = low_level::raise(SIGINT);
    });
}

//! The live page of `dynid open` in a real browser: Chromium, headless, driven through WebDriver as a user does it.
//!
//! [`Server`] is the program, serving a folder; [`Browser`] opens its page, clicks, types and drags, and keeps what
//! Chromium logs: errors on the console and every request. Everything here is for tests and panics where it cannot go on.

mod browser;
mod keys;
mod program;

pub use browser::{Browser, Scheme};
pub use program::{Server, json, program, tour};

//! Touching a virtual wall: a sampled controller, a device that is simulated between its ticks, and a hand that holds it
//! (thesis chapter 5).
//!
//! [`Setting`] says which joint of which device meets the wall, how the controller is sampled, and who moves the handle;
//! [`contact()`] plays one approach; [`Measures`] tell how still and how solid the wall felt; [`compare()`] puts several walls
//! under the same hands; [`tune()`] looks for a better one. [`space`] is the same with the whole device, at a plane.

mod compare;
mod contact;
mod damping;
mod eight;
mod encounter;
mod error;
mod hand;
mod measure;
mod setting;
pub mod space;
mod tune;
mod wall_file;

pub use compare::{Case, chatter_ratios, compare, compare_with};
pub use contact::{Contact, contact};
pub use damping::{OwnDamping, own_damping};
pub use dynid_signal::statistics::median;
pub use error::{StartError, WallError};
pub use hand::Hand;
pub use measure::{FROM_S, Measures, SETTLED_S, SLOWEST_HZ, TO_S, chatter_floor, passive_above, stability_bound};
pub use setting::{Approach, People, Reaching, Sampling, Setting};
pub use tune::{Family, Goal, TuneProgress, Tuned, tune};
pub use wall_file::WallFile;

use dynid_files::DocumentError;
use dynid_format::UnknownName;

/// Walls that the program carries, by the names that `dynid wall` gives them; each file names the command that made it.
pub const SHIPPED: [(&str, &str); 5] = [
    ("pd", include_str!("wall/shipped/pd.toml")),
    ("pd_tuned", include_str!("wall/shipped/pd_tuned.toml")),
    ("fuzzy_literal", include_str!("wall/shipped/fuzzy_literal.toml")),
    ("fuzzy", include_str!("wall/shipped/fuzzy.toml")),
    ("fuzzy_tuned", include_str!("wall/shipped/fuzzy_tuned.toml")),
];

/// Walls that the program carries too, other answers to the same chatter; `dynid wall compare` plays them when asked.
pub const BESIDE: [(&str, &str); 3] = [
    ("coupled", include_str!("wall/shipped/coupled.toml")),
    ("passive", include_str!("wall/shipped/passive.toml")),
    ("leaky", include_str!("wall/shipped/leaky.toml")),
];

/// Names and files of all walls that the program carries: [`SHIPPED`], then [`BESIDE`].
pub fn library() -> impl Iterator<Item = (&'static str, &'static str)> {
    SHIPPED.into_iter().chain(BESIDE)
}

/// The setting that the program carries: the thesis's.
pub const SETTING: &str = include_str!("wall/shipped/setting.toml");

/// No wall to play.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NoWall {
    /// A name that no wall has.
    #[error(transparent)]
    Unknown(#[from] UnknownName),
    /// Its file.
    #[error(transparent)]
    Document(#[from] DocumentError),
}

/// A wall that the program carries, of [`SHIPPED`] or [`BESIDE`].
///
/// # Errors
/// No wall of that name.
pub fn shipped(name: &str) -> Result<WallFile, NoWall> {
    let Some((_, text)) = library().find(|(known, _)| *known == name) else {
        return Err(UnknownName::among("wall", name, library().map(|(name, _)| name)).into());
    };
    Ok(WallFile::parse(text, std::path::Path::new(&format!("{name}.toml"))).map_err(DocumentError::from)?)
}

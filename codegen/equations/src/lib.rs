//! Derivation of a device's equations of motion as named terms, over any exact arithmetic of polynomials: from a device to
//! `generated/<device>/cNN.kir` and `structure.toml`.
//!
//! What derives the shipped devices is a computer algebra system (`dynid-derive`); [`exact`] is an arithmetic of our own, for where
//! there is none. Both give the same bytes. The format of `.kir` is described in `dynid-lower` (module `kir`), that of
//! `structure.toml` in the module `structure`.

pub mod algebra;
pub mod arithmetic;
pub mod collected;
pub mod composite;
pub mod emit;
pub mod exact;
pub mod fraction;
pub mod kernel;
pub mod lagrangian;
pub mod lumps;
pub mod recursion;
pub mod spatial;
pub mod structure;
pub mod tree;

use std::{collections::BTreeMap, path::PathBuf};

use arithmetic::Arithmetic;
use dynid_lower::Kir;
use dynid_model::{Device, Frame};
use exact::Exact;

/// Why a device's equations cannot be formed.
#[derive(Debug, Clone, thiserror::Error)]
pub enum DeriveError {
    /// A row of the frames table.
    #[error("device `{device}`, frame `{frame}`: {what}")]
    Frame {
        /// Device id.
        device: String,
        /// Frame name.
        frame: String,
        /// What was expected.
        what: String,
    },
    /// Whole numbers of the equations that the arithmetic cannot hold.
    #[error(
        "device `{device}`, joints {free:?} free: a number in its equations is too large to be exact; \
         angles about one axis that add up to a large multiple of a joint variable make such numbers"
    )]
    TooLarge {
        /// Device id.
        device: String,
        /// The free joints.
        free: Vec<usize>,
    },
}

impl DeriveError {
    fn frame(device: &Device, frame: &Frame, what: impl Into<String>) -> DeriveError {
        DeriveError::Frame { device: device.id.clone(), frame: frame.name.clone(), what: what.into() }
    }
}

/// The equations of any set of free joints, ascending, by the recursion alone: in milliseconds, where Lagrange's equations of a
/// robot whose axes stand at general angles take seconds.
///
/// # Errors
/// A frames table that no mechanism can be made of, or whose equations have numbers that are too large.
pub fn by_recursion(device: &Device, free: &[usize]) -> Result<Kir, DeriveError> {
    kernel::derive(&algebra::Algebra::<Exact>::new(device)?, None, device, free)
}

/// What to generate.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Only this configuration.
    pub configuration: Option<usize>,
}

/// The equations of a device's configurations: path below `generated/` and text.
///
/// # Errors
/// A frames table that no mechanism can be made of, or whose equations have numbers that are too large.
pub fn generate<A: Arithmetic>(device: &Device, options: &Options) -> Result<BTreeMap<PathBuf, String>, DeriveError> {
    let algebra = algebra::Algebra::<A>::new(device)?;
    let lagrangian = lagrangian::Lagrangian::new(&algebra, device)?;
    let mut files = BTreeMap::new();
    for number in 1..=device.configurations.len() {
        if options.configuration.is_none_or(|wanted| wanted == number) {
            let free = &device.configurations[number - 1].free;
            let kir = kernel::derive(&algebra, Some(&lagrangian), device, free)?;
            files.insert(PathBuf::from(&device.id).join(format!("c{number:02}.kir")), kir.to_string());
        }
    }
    let structure = structure::Structure::new(&algebra, &lagrangian, device.joints.len());
    files.insert(PathBuf::from(&device.id).join("structure.toml"), structure.to_toml(device));
    Ok(files)
}

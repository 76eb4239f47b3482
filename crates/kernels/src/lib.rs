//! The kernels of any device, any set of free joints and any effect.
//!
//! | what | found by |
//! | --- | --- |
//! | the equations of a device with these joints free | [`kernel`] |
//! | an effect's functions | [`effect`] |
//! | where the end point is and how it moves | [`end_point`] |
//! | the joint effects of a system as one function | [`Fuser`] |
//! | equations of many states at once, and their derivatives | [`batch`] |
//! | all of these as C99, for other programs | [`c_kernels`] |
//!
//! What ships is compiled in (`dynid-generated`). Everything else is made here when it is first asked for, from the same
//! programs: equations by the recursion (`dynid-equations`), kernels from them (`dynid-lower`), machine code of those functions that
//! are called (`dynid-compile`). A caller cannot tell the two apart, but for the order of rounding.
//!
//! What was made stays until the process ends: a process works with few devices.

mod appearing;
pub mod batch;
mod c99;
mod fused;
mod made;

use std::{
    any::Any,
    collections::HashMap,
    hash::Hash,
    sync::{Mutex, OnceLock, PoisonError, atomic::Ordering},
};

use dynid_equations::DeriveError;
use dynid_generated::{EffectKernel, EndPoint, Kernel};
use dynid_lower::{effect::UnknownSymbol, end_point::NoChain, kernel::MissingOutput};
use dynid_model::{Device, Effect};

pub use c99::{CFunction, CKernels, c_kernels, c_number};
pub use fused::Fuser;

/// Why there are no kernels.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum KernelError {
    /// The device has no equations.
    #[error(transparent)]
    Derive(#[from] DeriveError),
    /// The equations lack an output: a bug of ours.
    #[error(transparent)]
    MissingOutput(#[from] MissingOutput),
    /// The device has no chain to its end point.
    #[error(transparent)]
    NoChain(#[from] NoChain),
    /// A formula of the effect reads what no effect may read.
    #[error(transparent)]
    UnknownSymbol(#[from] UnknownSymbol),
    /// No joint, a joint twice or one that the device does not have.
    #[error("device `{device}` has no free joints {free:?}; name each once, from 0 to {last}", last = n_joints.saturating_sub(1))]
    NoSuchJoints {
        /// Device id.
        device: String,
        /// As asked for.
        free: Vec<usize>,
        /// Number of its joints.
        n_joints: usize,
    },
}

/// The kernel of a device whose joints `free` (ascending) move, the others being locked.
///
/// # Errors
/// Joints that the device does not have, or a frames table without equations.
pub fn kernel(device: &'static Device, free: &[usize]) -> Result<&'static Kernel, KernelError> {
    static MADE: Made<(usize, Vec<usize>), Kernel> = Made::new();
    check_joints(device, free)?;
    let number = device.configuration_of(free).filter(|_| ships(device));
    if let Some(compiled_in) = number.and_then(|number| dynid_generated::kernel(&device.id, number)) {
        return Ok(compiled_in);
    }
    MADE.get_or_make((address(device), free.to_vec()), || made::kernel(device, free))
}

/// The kernel of an effect.
///
/// # Errors
/// A formula that reads what no effect may read.
pub fn effect(effect: &'static Effect) -> Result<&'static EffectKernel, KernelError> {
    static MADE: Made<usize, EffectKernel> = Made::new();
    match dynid_generated::effect(&effect.id).filter(|_| dynid_model::library::is_shipped(effect)) {
        Some(compiled_in) => Ok(compiled_in),
        None => MADE.get_or_make(address(effect), || made::effect(effect)),
    }
}

/// The end point of a device, where its file names one.
///
/// # Errors
/// A frames table without a chain to it.
pub fn end_point(device: &'static Device) -> Result<Option<&'static EndPoint>, KernelError> {
    static MADE: Made<usize, Option<EndPoint>> = Made::new();
    match dynid_generated::end_point(&device.id).filter(|_| ships(device)) {
        Some(compiled_in) => Ok(Some(compiled_in)),
        None => Ok(MADE.get_or_make(address(device), || made::end_point(device))?.as_ref()),
    }
}

/// Whether functions that were made are interpreted: there is no code generator for the processor, or the system grants no
/// executable memory.
pub fn are_interpreted() -> bool {
    made::INTERPRETED.load(Ordering::Relaxed)
}

fn check_joints(device: &Device, free: &[usize]) -> Result<(), KernelError> {
    let n_joints = device.joints.len();
    if free.is_empty() || !free.is_sorted_by(|a, b| a < b) || free.iter().any(|&joint| joint >= n_joints) {
        return Err(KernelError::NoSuchJoints { device: device.id.clone(), free: free.to_vec(), n_joints });
    }
    Ok(())
}

/// Whether the device is one of the library's, for which everything is compiled in. A user's file may have the same id.
fn ships(device: &Device) -> bool {
    dynid_model::device(&device.id).is_some_and(|shipped| std::ptr::eq(shipped, device))
}

/// Tells apart what is never freed.
fn address<T>(of: &'static T) -> usize {
    std::ptr::from_ref(of).addr()
}

/// What was made, by what it was made for.
struct Made<K, T: 'static>(OnceLock<Mutex<HashMap<K, &'static T>>>);

impl<K: Eq + Hash, T: Any> Made<K, T> {
    const fn new() -> Self {
        Made(OnceLock::new())
    }

    /// Nobody makes the same twice: who comes second waits.
    fn get_or_make(&self, key: K, make: impl FnOnce() -> Result<T, KernelError>) -> Result<&'static T, KernelError> {
        let mut known = self.0.get_or_init(Mutex::default).lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(&made) = known.get(&key) {
            return Ok(made);
        }
        let made: &'static T = Box::leak(Box::new(make()?));
        known.insert(key, made);
        Ok(made)
    }
}

//! The same kernels as C99.

pub use dynid_lower::c99::number as c_number;
use dynid_lower::c99::{Linkage, definition, prototype, runtime};
use dynid_lower::{effect::EffectKernels, end_point, kernel::Configuration, kernel::Function};
use dynid_model::{Device, Effect};

use crate::{KernelError, check_joints};

/// The functions of a device and of effects as C99: straight-line code over doubles, which needs `<math.h>` and `<stdint.h>`.
///
/// Every name begins with a prefix; vectors and matrices are as in [`dynid_generated::KernelFunctions`].
#[derive(Debug, Clone)]
pub struct CKernels {
    /// What the functions call.
    pub helpers: String,
    /// `prepare`, then the functions of the equations, in the order of [`dynid_generated::KernelFunctions`].
    pub equations: Vec<CFunction>,
    /// `end_point_pose` and `end_point_motion`, where the device names an end point.
    pub end_point: Vec<CFunction>,
    /// One for each effect that was asked for, as [`dynid_generated::EffectFunctions::eval`]; of its file only.
    pub laws: Vec<CFunction>,
    /// Names of the model parameters that `prepare` takes, in order.
    pub parameters: Vec<String>,
    /// Number of values that `prepare` makes.
    pub n_prepared: usize,
    /// The first so many of them are lumps, in which the torque is linear.
    pub n_lumps: usize,
    /// Names of the model parameters that the functions of the end point take, in order.
    pub lengths: Vec<String>,
}

/// One function.
#[derive(Debug, Clone)]
pub struct CFunction {
    /// Its name, with the prefix.
    pub name: String,
    /// What it computes.
    pub title: String,
    /// Its head, without a semicolon.
    pub prototype: String,
    /// All of it.
    pub definition: String,
}

/// The kernel of a device whose joints `free` (ascending) move, its end point and the laws of `effects`, each named once.
///
/// The equations are those that [`crate::kernel`] makes at run time; of a device whose kernel is compiled in they have other
/// roundings.
///
/// # Errors
/// As [`crate::kernel`], [`crate::effect`] and [`crate::end_point`].
pub fn c_kernels(device: &Device, free: &[usize], effects: &[&Effect], prefix: &str) -> Result<CKernels, KernelError> {
    check_joints(device, free)?;
    let configuration = Configuration::new(&dynid_equations::by_recursion(device, free)?)?;
    let end_point = end_point::EndPoint::new(device)?;
    let laws = effects.iter().map(|effect| {
        let name = format!("{prefix}_law_{}", effect.id);
        let own = EffectKernels::new(effect)?;
        Ok(written(&name, prefix, &own.eval, &own.title, Linkage::Internal))
    });
    let external = |part: &str, own: &Function| {
        written(&format!("{prefix}_{part}{}", own.name), prefix, own, own.title, Linkage::External)
    };
    Ok(CKernels {
        helpers: runtime(prefix),
        equations: configuration.functions.iter().map(|own| external("", own)).collect(),
        end_point: end_point.iter().flat_map(|own| &own.functions).map(|own| external("end_point_", own)).collect(),
        laws: laws.collect::<Result<_, KernelError>>()?,
        parameters: configuration.parameters,
        n_prepared: configuration.prepared.len(),
        n_lumps: configuration.n_lumps,
        lengths: end_point.map_or_else(Vec::new, |own| own.parameters),
    })
}

fn written(name: &str, prefix: &str, function: &Function, title: &str, linkage: Linkage) -> CFunction {
    CFunction {
        name: name.to_owned(),
        title: title.to_owned(),
        prototype: prototype(name, function),
        definition: definition(name, prefix, function, linkage),
    }
}

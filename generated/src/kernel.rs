//! [`Kernel`]: the table entry of one configuration, a struct of function pointers.

use crate::Lanes;

/// The kernels of one configuration of a device, for `f64`. With n = `free.len()`; the generic functions behind it
/// are in the configuration's module, e.g. `dynid_generated::planar2r::c01::inertia`.
///
/// A slice of a length other than stated makes a kernel return without writing (a debug build asserts).
#[derive(Debug, Clone, Copy)]
#[allow(clippy::type_complexity)]
pub struct Kernel {
    /// Id of the device.
    pub device: &'static str,
    /// Number of the configuration, from 1, as in the device file.
    pub configuration: usize,
    /// Free joints, ascending.
    pub free: &'static [usize],
    /// Locked joints, ascending.
    pub locked: &'static [usize],
    /// Names of what `prepare` takes, in order.
    pub parameters: &'static [&'static str],
    /// Names of what `prepare` makes, in order.
    pub prepared: &'static [&'static str],
    /// The first so many of `prepared` are lumps of inertial parameters; tau is linear in them. Lumps that only D or h reads
    /// come after them, then what no link parameter enters.
    pub n_lumps: usize,
    /// What each function costs.
    pub operations: &'static [Operations],
    /// Parameters and angles of the locked joints to prepared values.
    pub prepare: fn(parameters: &[f64], locked: &[f64], prepared: &mut [f64]),
    /// Partial derivatives of the prepared values by the parameters: `prepared.len()` x `parameters.len()`.
    pub prepare_gradient: fn(parameters: &[f64], locked: &[f64], jacobian: &mut [f64]),
    /// Inertia matrix D, n x n.
    pub inertia: fn(prepared: &[f64], q: &[f64], d: &mut [f64]),
    /// Matrix C of centrifugal and Coriolis terms by Christoffel symbols (Eq. 3.3), n x n.
    pub coriolis: fn(prepared: &[f64], q: &[f64], dq: &[f64], c: &mut [f64]),
    /// Gravity vector phi.
    pub gravity: fn(prepared: &[f64], q: &[f64], phi: &mut [f64]),
    /// Bias h = C dq + phi.
    pub bias: fn(prepared: &[f64], q: &[f64], dq: &[f64], h: &mut [f64]),
    /// D and h.
    pub inertia_and_bias: fn(prepared: &[f64], q: &[f64], dq: &[f64], d: &mut [f64], h: &mut [f64]),
    /// tau = D ddq + h.
    pub inverse_dynamics: fn(prepared: &[f64], q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]),
    /// ddq = D^-1 (tau - h).
    pub forward_dynamics: fn(prepared: &[f64], q: &[f64], dq: &[f64], tau: &[f64], ddq: &mut [f64]),
    /// Regressor Y: d tau / d lump, n x `n_lumps`.
    pub regressor: fn(prepared: &[f64], q: &[f64], dq: &[f64], ddq: &[f64], y: &mut [f64]),
    /// tau and its partial derivatives by q and dq, n x n each; the one by ddq is D.
    pub inverse_dynamics_gradient:
        fn(prepared: &[f64], q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64], by_q: &mut [f64], by_dq: &mut [f64]),
    /// As `inertia`, at several states at once.
    pub inertia_lanes: fn(prepared: &[Lanes], q: &[Lanes], d: &mut [Lanes]),
    /// As `regressor`, at several states at once.
    pub regressor_lanes: fn(prepared: &[Lanes], q: &[Lanes], dq: &[Lanes], ddq: &[Lanes], y: &mut [Lanes]),
    /// As `inverse_dynamics_gradient`, at several states at once.
    pub inverse_dynamics_gradient_lanes: fn(
        prepared: &[Lanes],
        q: &[Lanes],
        dq: &[Lanes],
        ddq: &[Lanes],
        tau: &mut [Lanes],
        by_q: &mut [Lanes],
        by_dq: &mut [Lanes],
    ),
}

/// What one function of a kernel costs. Negations are free.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Operations {
    /// Name of the function.
    pub kernel: &'static str,
    /// The form of the equations that it was made from: the cheaper one.
    pub form: &'static str,
    /// Additions and subtractions.
    pub adds: usize,
    /// Multiplications.
    pub muls: usize,
    /// Divisions.
    pub divs: usize,
    /// Angles whose sine or cosine is computed.
    pub sincos: usize,
    /// Additions, multiplications and divisions of the configuration's `prepare`.
    pub prepare_ops: usize,
}

impl Operations {
    /// `counts`: adds, muls, divs, sincos.
    pub(crate) const fn new(
        kernel: &'static str,
        form: &'static str,
        counts: [usize; 4],
        prepare_ops: usize,
    ) -> Operations {
        let [adds, muls, divs, sincos] = counts;
        Operations { kernel, form, adds, muls, divs, sincos, prepare_ops }
    }
}

/// A function over slices of a scalar type from a generic one over arrays: it runs if every slice has the right length.
macro_rules! checked {
    ($function:ident::<$scalar:ty>($($slice:ident),*)) => {
        |$($slice),*| match ($($slice.try_into()),*) {
            ($(Ok($slice)),*) => $function::<$scalar>($($slice),*),
            _ => $crate::wrong_length(),
        }
    };
}
pub(crate) use checked;

//! [`Kernel`]: one configuration of a device: what its functions take, and the functions.

use core::fmt::Debug;

use crate::{Eight, Lanes, Width};

/// A trait of functions over slices, and the table of functions that are compiled in, which implements it.
macro_rules! functions {
    ($(#[$about:meta])* $trait:ident, $table:ident {
        $($(#[$does:meta])* $name:ident($($argument:ident: $slice:ty),*);)*
    }) => {
        $(#[$about])*
        #[allow(clippy::too_many_arguments)]
        pub trait $trait: Debug + Send + Sync {
            $($(#[$does])* fn $name(&self, $($argument: $slice),*);)*
        }

        #[doc = concat!("Pointers to the functions of [`", stringify!($trait), "`].")]
        #[derive(Debug, Clone, Copy)]
        #[allow(clippy::type_complexity)]
        pub struct $table {
            $($(#[$does])* pub $name: fn($($argument: $slice),*),)*
        }

        impl $trait for $table {
            $(#[inline]
            fn $name(&self, $($argument: $slice),*) {
                (self.$name)($($argument),*)
            })*
        }
    };
}
pub(crate) use functions;

/// The kernels of one configuration of a device, with n = `free.len()`. The generic functions behind one that is compiled in
/// are in the configuration's module, e.g. `dynid_generated::planar2r::c01::inertia`.
///
/// A slice of a length other than stated makes a kernel return without writing (a debug build asserts).
#[derive(Debug, Clone, Copy)]
pub struct Kernel {
    /// Id of the device.
    pub device: &'static str,
    /// Number of the configuration, from 1, as in the device file; none for joints that are free together in no configuration.
    pub configuration: Option<usize>,
    /// Free joints, ascending.
    pub free: &'static [usize],
    /// Locked joints, ascending.
    pub locked: &'static [usize],
    /// Names of what `prepare` takes, in order.
    pub parameters: &'static [&'static str],
    /// Names of the parameters on which the equations depend, in the device's order: `prepare` may take more, whose terms cancel.
    pub appearing: &'static [&'static str],
    /// Names of what `prepare` makes, in order.
    pub prepared: &'static [&'static str],
    /// The first so many of `prepared` are lumps of inertial parameters; tau is linear in them. Lumps that only D or h reads
    /// come after them, then what no link parameter enters.
    pub n_lumps: usize,
    /// What each function costs.
    pub operations: &'static [Operations],
    /// The functions themselves.
    pub functions: &'static dyn KernelFunctions,
}

functions! {
    /// The functions of a [`Kernel`]: compiled in, or made while the program runs.
    KernelFunctions, KernelTable {
        /// Parameters and angles of the locked joints to prepared values.
        prepare(parameters: &[f64], locked: &[f64], prepared: &mut [f64]);
        /// Partial derivatives of the prepared values by the parameters: `prepared.len()` x `parameters.len()`.
        prepare_gradient(parameters: &[f64], locked: &[f64], jacobian: &mut [f64]);
        /// Inertia matrix D, n x n.
        inertia(prepared: &[f64], q: &[f64], d: &mut [f64]);
        /// Matrix C of centrifugal and Coriolis terms by Christoffel symbols (Eq. 3.3), n x n.
        coriolis(prepared: &[f64], q: &[f64], dq: &[f64], c: &mut [f64]);
        /// Gravity vector phi.
        gravity(prepared: &[f64], q: &[f64], phi: &mut [f64]);
        /// Bias h = C dq + phi.
        bias(prepared: &[f64], q: &[f64], dq: &[f64], h: &mut [f64]);
        /// D and h.
        inertia_and_bias(prepared: &[f64], q: &[f64], dq: &[f64], d: &mut [f64], h: &mut [f64]);
        /// tau = D ddq + h.
        inverse_dynamics(prepared: &[f64], q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]);
        /// ddq = D^-1 (tau - h).
        forward_dynamics(prepared: &[f64], q: &[f64], dq: &[f64], tau: &[f64], ddq: &mut [f64]);
        /// Regressor Y: d tau / d lump, n x `n_lumps`.
        regressor(prepared: &[f64], q: &[f64], dq: &[f64], ddq: &[f64], y: &mut [f64]);
        /// tau and its partial derivatives by q and dq, n x n each; the one by ddq is D.
        inverse_dynamics_gradient(prepared: &[f64], q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64], by_q: &mut [f64], by_dq: &mut [f64]);
        /// As `forward_dynamics`, of eight states: prepared values, q, dq and tau stand one behind the other.
        forward_dynamics_of_eight(width: Width, given: &[Eight], ddq: &mut [Eight]);
        /// As `inertia`, at several states at once.
        inertia_lanes(prepared: &[Lanes], q: &[Lanes], d: &mut [Lanes]);
        /// As `regressor`, at several states at once.
        regressor_lanes(prepared: &[Lanes], q: &[Lanes], dq: &[Lanes], ddq: &[Lanes], y: &mut [Lanes]);
        /// As `inverse_dynamics_gradient`, at several states at once.
        inverse_dynamics_gradient_lanes(prepared: &[Lanes], q: &[Lanes], dq: &[Lanes], ddq: &[Lanes], tau: &mut [Lanes], by_q: &mut [Lanes], by_dq: &mut [Lanes]);
    }
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
    pub const fn new(kernel: &'static str, form: &'static str, counts: [usize; 4], prepare_ops: usize) -> Operations {
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

//! Kernels that are made while the program runs. A function becomes machine code when it is first called.

use std::sync::{
    OnceLock,
    atomic::{AtomicBool, Ordering},
};

use dynid_compile::{Routine, Word};
use dynid_generated::{
    Dual, EffectFunctions, EffectKernel, Eight, EndPoint, EndPointFunctions, Kernel, KernelFunctions, LANES, Lanes,
    Operations, Scalar, Width,
};
use dynid_lower::{effect::EffectKernels, kernel::Configuration, kernel::Function};
use dynid_model::{Device, Effect};

use crate::{KernelError, appearing::appearing};

pub(crate) fn kernel(device: &'static Device, free: &[usize]) -> Result<Kernel, KernelError> {
    let equations = dynid_equations::by_recursion(device, free)?;
    let configuration = Configuration::new(&equations)?;
    let prepare_ops = configuration.prepare_counts.arithmetic();
    let operations: Vec<_> = configuration.functions.iter().map(|own| operations(own, prepare_ops)).collect();
    Ok(Kernel {
        device: &device.id,
        configuration: device.configuration_of(free),
        free: configuration.free.leak(),
        locked: configuration.locked.leak(),
        parameters: names(configuration.parameters),
        appearing: names(appearing(&equations.program)),
        prepared: names(configuration.prepared),
        n_lumps: configuration.n_lumps,
        operations: operations.leak(),
        functions: Box::leak(Box::new(Equations::new(configuration.functions))),
    })
}

pub(crate) fn effect(effect: &'static Effect) -> Result<EffectKernel, KernelError> {
    let EffectKernels { n_parameters, n_states, n_outputs, eval, eval_gradient, .. } = EffectKernels::new(effect)?;
    let functions = Law { eval: eval.into(), eval_gradient: eval_gradient.into() };
    Ok(EffectKernel { id: &effect.id, n_parameters, n_states, n_outputs, functions: Box::leak(Box::new(functions)) })
}

pub(crate) fn end_point(device: &'static Device) -> Result<Option<EndPoint>, KernelError> {
    let Some(own) = dynid_lower::end_point::EndPoint::new(device)? else { return Ok(None) };
    let operations: Vec<_> = own.functions.iter().map(|own| operations(own, 0)).collect();
    let [pose, motion] = own.functions.map(Lazy::from);
    Ok(Some(EndPoint {
        device: &device.id,
        frame: own.frame.leak(),
        n_joints: own.n_joints,
        parameters: names(own.parameters),
        operations: operations.leak(),
        functions: Box::leak(Box::new(Chain { pose, motion })),
    }))
}

/// What never changes for a kernel's life, which is the process's.
fn names(names: Vec<String>) -> &'static [&'static str] {
    names.into_iter().map(|name| &*name.leak()).collect::<Vec<&str>>().leak()
}

fn operations(function: &Function, prepare_ops: usize) -> Operations {
    let counts = function.program.operations();
    let counts = [counts.adds, counts.muls, counts.divs, counts.sincos];
    Operations::new(function.name, function.form.clone().leak(), counts, prepare_ops)
}

/// A function that is compiled for a scalar type when it is first called with it.
#[derive(Debug)]
struct Lazy {
    function: Function,
    alone: OnceLock<Routine<f64>>,
    in_lanes: OnceLock<Routine<Lanes>>,
}

impl From<Function> for Lazy {
    fn from(function: Function) -> Self {
        Lazy { function, alone: OnceLock::new(), in_lanes: OnceLock::new() }
    }
}

/// Whether a function could not become machine code.
pub(crate) static INTERPRETED: AtomicBool = AtomicBool::new(false);

fn routine<S: Word>(function: &Function) -> Routine<S> {
    let routine = Routine::new(function);
    if !routine.is_machine_code() {
        INTERPRETED.store(true, Ordering::Relaxed);
    }
    routine
}

impl Lazy {
    #[inline]
    fn call<const A: usize, const R: usize>(&self, arguments: [&[f64]; A], results: [&mut [f64]; R]) {
        self.alone.get_or_init(|| routine(&self.function)).call(arguments, results);
    }

    #[inline]
    fn call_lanes<const A: usize, const R: usize>(&self, arguments: [&[Lanes]; A], results: [&mut [Lanes]; R]) {
        self.in_lanes.get_or_init(|| routine(&self.function)).call(arguments, results);
    }

    /// Of eight, whose arguments and results stand one behind the other: two after the other, whatever the processor has, for what makes
    /// the code knows no wider registers.
    fn call_of_eight<const A: usize, const R: usize>(&self, given: &[Eight], results: &mut [Eight]) {
        let mut room = vec![Lanes::constant(0.0); given.len() + results.len()];
        let (own, own_results) = room.split_at_mut(given.len());
        for part in 0..8 / LANES {
            own.iter_mut().zip(given).for_each(|(own, row)| *own = Lanes::new(row.as_chunks().0[part]));
            let arguments = self.function.arguments.iter().map(|argument| argument.elements.len());
            let of = self.function.results.iter().map(|results| results.elements.len());
            self.call_lanes(parts::<_, A>(own, arguments).map(|part| &*part), parts::<_, R>(own_results, of));
            results.iter_mut().zip(&*own_results).for_each(|(row, own)| row.as_chunks_mut().0[part] = own.to_array());
        }
    }
}

/// A slice in parts of these lengths.
fn parts<T, const N: usize>(mut rest: &mut [T], mut lengths: impl Iterator<Item = usize>) -> [&mut [T]; N] {
    std::array::from_fn(|_| {
        let length = lengths.next().unwrap_or(0).min(rest.len());
        rest.split_off_mut(..length).unwrap_or_default()
    })
}

/// The functions of a kernel.
#[derive(Debug)]
struct Equations {
    prepare: Lazy,
    /// `prepare` with derivatives.
    derivatives: OnceLock<Routine<Dual<PARTIALS>>>,
    inertia: Lazy,
    coriolis: Lazy,
    gravity: Lazy,
    bias: Lazy,
    inertia_and_bias: Lazy,
    inverse_dynamics: Lazy,
    forward_dynamics: Lazy,
    regressor: Lazy,
    inverse_dynamics_gradient: Lazy,
}

impl Equations {
    fn new(functions: [Function; 10]) -> Self {
        let [
            prepare,
            inertia,
            coriolis,
            gravity,
            bias,
            inertia_and_bias,
            inverse_dynamics,
            forward_dynamics,
            regressor,
            inverse_dynamics_gradient,
        ] = functions.map(Lazy::from);
        Equations {
            prepare,
            derivatives: OnceLock::new(),
            inertia,
            coriolis,
            gravity,
            bias,
            inertia_and_bias,
            inverse_dynamics,
            forward_dynamics,
            regressor,
            inverse_dynamics_gradient,
        }
    }
}

impl KernelFunctions for Equations {
    fn prepare(&self, parameters: &[f64], locked: &[f64], prepared: &mut [f64]) {
        self.prepare.call([parameters, locked], [prepared]);
    }

    fn prepare_gradient(&self, parameters: &[f64], locked: &[f64], jacobian: &mut [f64]) {
        let lengths = self.prepare.function.arguments.iter().map(|argument| argument.elements.len());
        let n_prepared = self.prepare.function.results.iter().map(|results| results.elements.len()).sum::<usize>();
        let is_right = lengths.eq([parameters.len(), locked.len()]) && jacobian.len() == n_prepared * parameters.len();
        debug_assert!(is_right, "every slice has the length that the kernel's table states");
        if !is_right {
            return;
        }
        let prepare = self.derivatives.get_or_init(|| Routine::interpreted(&self.prepare.function));
        // A place beyond all partial derivatives makes a constant.
        let constant = |&value: &f64| Dual::<PARTIALS>::variable(value, PARTIALS);
        let locked: Vec<_> = locked.iter().map(constant).collect();
        let mut prepared = vec![constant(&0.0); n_prepared];
        for first in (0..parameters.len()).step_by(PARTIALS) {
            let variable =
                |(place, &value): (usize, &f64)| Dual::variable(value, place.checked_sub(first).unwrap_or(PARTIALS));
            let seeded: Vec<_> = parameters.iter().enumerate().map(variable).collect();
            prepare.call([&seeded, &locked], [&mut prepared]);
            for (row, value) in jacobian.chunks_exact_mut(parameters.len()).zip(&prepared) {
                row[first..].iter_mut().zip(value.partials).for_each(|(entry, partial)| *entry = partial);
            }
        }
    }

    fn inertia(&self, prepared: &[f64], q: &[f64], d: &mut [f64]) {
        self.inertia.call([prepared, q], [d]);
    }

    fn coriolis(&self, prepared: &[f64], q: &[f64], dq: &[f64], c: &mut [f64]) {
        self.coriolis.call([prepared, q, dq], [c]);
    }

    fn gravity(&self, prepared: &[f64], q: &[f64], phi: &mut [f64]) {
        self.gravity.call([prepared, q], [phi]);
    }

    fn bias(&self, prepared: &[f64], q: &[f64], dq: &[f64], h: &mut [f64]) {
        self.bias.call([prepared, q, dq], [h]);
    }

    fn inertia_and_bias(&self, prepared: &[f64], q: &[f64], dq: &[f64], d: &mut [f64], h: &mut [f64]) {
        self.inertia_and_bias.call([prepared, q, dq], [d, h]);
    }

    fn inverse_dynamics(&self, prepared: &[f64], q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        self.inverse_dynamics.call([prepared, q, dq, ddq], [tau]);
    }

    fn forward_dynamics(&self, prepared: &[f64], q: &[f64], dq: &[f64], tau: &[f64], ddq: &mut [f64]) {
        self.forward_dynamics.call([prepared, q, dq, tau], [ddq]);
    }

    fn regressor(&self, prepared: &[f64], q: &[f64], dq: &[f64], ddq: &[f64], y: &mut [f64]) {
        self.regressor.call([prepared, q, dq, ddq], [y]);
    }

    fn inverse_dynamics_gradient(
        &self,
        prepared: &[f64],
        q: &[f64],
        dq: &[f64],
        ddq: &[f64],
        tau: &mut [f64],
        by_q: &mut [f64],
        by_dq: &mut [f64],
    ) {
        self.inverse_dynamics_gradient.call([prepared, q, dq, ddq], [tau, by_q, by_dq]);
    }

    fn forward_dynamics_of_eight(&self, _: Width, given: &[Eight], ddq: &mut [Eight]) {
        self.forward_dynamics.call_of_eight::<4, 1>(given, ddq);
    }

    fn inertia_lanes(&self, prepared: &[Lanes], q: &[Lanes], d: &mut [Lanes]) {
        self.inertia.call_lanes([prepared, q], [d]);
    }

    fn regressor_lanes(&self, prepared: &[Lanes], q: &[Lanes], dq: &[Lanes], ddq: &[Lanes], y: &mut [Lanes]) {
        self.regressor.call_lanes([prepared, q, dq, ddq], [y]);
    }

    fn inverse_dynamics_gradient_lanes(
        &self,
        prepared: &[Lanes],
        q: &[Lanes],
        dq: &[Lanes],
        ddq: &[Lanes],
        tau: &mut [Lanes],
        by_q: &mut [Lanes],
        by_dq: &mut [Lanes],
    ) {
        self.inverse_dynamics_gradient.call_lanes([prepared, q, dq, ddq], [tau, by_q, by_dq]);
    }
}

/// Partial derivatives that are carried along at once: a numerical choice.
const PARTIALS: usize = 8;

/// The functions of an effect.
#[derive(Debug)]
struct Law {
    eval: Lazy,
    eval_gradient: Lazy,
}

impl EffectFunctions for Law {
    fn eval(&self, parameters: &[f64], signals: &[f64], states: &[f64], outputs: &mut [f64], rates: &mut [f64]) {
        self.eval.call([parameters, signals, states], [outputs, rates]);
    }

    fn eval_gradient(
        &self,
        parameters: &[f64],
        signals: &[f64],
        states: &[f64],
        outputs: &mut [f64],
        rates: &mut [f64],
        jacobian: &mut [f64],
    ) {
        self.eval_gradient.call([parameters, signals, states], [outputs, rates, jacobian]);
    }

    fn eval_lanes(
        &self,
        parameters: &[Lanes],
        signals: &[Lanes],
        states: &[Lanes],
        outputs: &mut [Lanes],
        rates: &mut [Lanes],
    ) {
        self.eval.call_lanes([parameters, signals, states], [outputs, rates]);
    }

    fn eval_of_eight(&self, _: Width, given: &[Eight], results: &mut [Eight]) {
        self.eval.call_of_eight::<3, 2>(given, results);
    }

    fn eval_gradient_lanes(
        &self,
        parameters: &[Lanes],
        signals: &[Lanes],
        states: &[Lanes],
        outputs: &mut [Lanes],
        rates: &mut [Lanes],
        jacobian: &mut [Lanes],
    ) {
        self.eval_gradient.call_lanes([parameters, signals, states], [outputs, rates, jacobian]);
    }
}

/// The functions of an end point.
#[derive(Debug)]
struct Chain {
    pose: Lazy,
    motion: Lazy,
}

impl EndPointFunctions for Chain {
    fn pose(&self, lengths: &[f64], q: &[f64], position: &mut [f64], rotation: &mut [f64]) {
        self.pose.call([lengths, q], [position, rotation]);
    }

    fn motion(&self, lengths: &[f64], q: &[f64], position: &mut [f64], rotation: &mut [f64], jacobian: &mut [f64]) {
        self.motion.call([lengths, q], [position, rotation, jacobian]);
    }
}

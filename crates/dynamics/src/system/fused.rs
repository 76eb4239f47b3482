//! The joint effects of a system as one function, without a call and a look at each by itself.
//!
//! Effects are small: what leads to a law costs more than the law. Whoever can make functions while the program runs
//! ([`System::fusing`]) makes one of all of them, with the same bits but for the sign of a zero (of numbers: what is infinite or none may
//! differ); without it, each effect is evaluated by its own kernel.

use std::fmt;
use std::sync::{
    Arc, OnceLock,
    atomic::{AtomicUsize, Ordering},
};

use dynid_generated::{EffectKernel, N_SIGNALS, Signal};

use super::{Block, Element, NONE, System};

/// All joint effects of a system: first the frictions, then the others, each in the order in which they add up.
#[derive(Clone)]
pub struct Laws {
    /// The effects.
    pub laws: Vec<Law>,
    /// Number of the effects' parameters.
    pub n_parameters: usize,
    /// Number of free joints.
    pub n_free: usize,
    /// Length of the state.
    pub n_states: usize,
}

/// One joint effect: what it reads and what it acts on.
#[derive(Clone)]
pub struct Law {
    /// Its kernel.
    pub kernel: &'static EffectKernel,
    /// Whether it is one of those whose sum at a joint others may read.
    pub is_friction: bool,
    /// Index of its first parameter.
    pub first_parameter: usize,
    /// Index in the state of the first of its own states.
    pub first_state: usize,
    /// Where its signals come from.
    pub signals: [Source; N_SIGNALS],
    /// Its outputs that are torques, and the free joints that they act on.
    pub torques: Vec<(usize, usize)>,
}

/// Where a signal comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Source {
    /// A number that does not change while joints move: where a joint is locked, or nothing.
    Constant(f64),
    /// Index in the state.
    State(usize),
    /// Index among the effects' parameters.
    Parameter(usize),
    /// The time.
    Time,
    /// What the drive of a free joint delivers.
    Drive(usize),
    /// The sum of the frictions of a free joint.
    Friction(usize),
}

/// One function of all joint effects.
pub trait Fused: Send + Sync {
    /// From the effects' parameters, the state, what the free joints' drives deliver and the time (s), in this order, to the sums of the
    /// torques of each free joint, all and those of the frictions, and the rates of the effects' states (those of effects that are no
    /// joint effects are left as they are).
    fn loads(&self, given: (&[f64], &[f64], &[f64], f64), sums: [&mut [f64]; 2], rates: &mut [f64]);
}

/// Makes one function of many effects.
pub trait Fuse: Sync {
    /// `None` where that would not be faster, or cannot be done.
    fn fuse(&self, laws: &Laws) -> Option<Arc<dyn Fused>>;
}

/// A system's effects as one function, once somebody has asked for it; clones share it.
#[derive(Clone)]
pub(super) struct Fusion {
    maker: &'static dyn Fuse,
    shared: Arc<Shared>,
}

#[derive(Default)]
struct Shared {
    /// Evaluations that were announced.
    evaluations: AtomicUsize,
    made: OnceLock<Option<Arc<dyn Fused>>>,
}

impl fmt::Debug for Fusion {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Fusion").finish_non_exhaustive()
    }
}

impl Fusion {
    pub(super) fn new(maker: &'static dyn Fuse) -> Self {
        Self { maker, shared: Arc::default() }
    }

    /// That of other effects by the same maker.
    pub(super) fn anew(&self) -> Self {
        Self::new(self.maker)
    }

    pub(super) fn made(&self) -> Option<&dyn Fused> {
        self.shared.made.get()?.as_deref()
    }
}

impl System {
    /// With a maker of one function of all its joint effects.
    #[must_use]
    pub fn fusing(mut self, maker: &'static dyn Fuse) -> Self {
        self.fusion = Some(Fusion::new(maker));
        self
    }

    /// Announces so many evaluations of this system. Where there is a maker, and all that were announced are worth it, it makes one
    /// function of all joint effects; says whether there is one.
    pub fn announce(&self, evaluations: usize) -> bool {
        /// What making it costs, in evaluations without it.
        const WORTH: usize = 5_000;
        let Some(fusion) = &self.fusion else { return false };
        let Fusion { maker, shared } = fusion;
        if shared.evaluations.fetch_add(evaluations, Ordering::Relaxed) + evaluations >= WORTH {
            shared.made.get_or_init(|| self.laws().and_then(|laws| maker.fuse(&laws)));
        }
        fusion.made().is_some()
    }

    /// Its joint effects; `None` where there are none.
    fn laws(&self) -> Option<Laws> {
        let in_order = |(blocks, alone): &(Vec<Block>, Vec<Element>), is_friction: bool| -> Vec<Law> {
            let of_blocks = blocks.iter().flat_map(Block::effects);
            of_blocks.chain(alone).map(|element| self.law(element, is_friction)).collect()
        };
        let laws = [in_order(&self.friction_blocks, true), in_order(&self.load_blocks, false)].concat();
        let n_parameters = self.effect_parameters.len();
        (!laws.is_empty()).then(|| Laws { laws, n_parameters, n_free: self.n_free(), n_states: self.n_states() })
    }

    /// What [`System::signals`] and [`System::loads`] give an effect to read.
    fn law(&self, element: &Element, is_friction: bool) -> Law {
        let n = self.n_free();
        let mut signals = [Source::Constant(0.0); N_SIGNALS];
        let ends = [(element.joint, Signal::Q, Signal::Dq), (element.from, Signal::QFrom, Signal::DqFrom)];
        for (end, position, speed) in ends {
            let (q, dq) = match end.slot {
                NONE => (Source::Constant(end.angle), Source::Constant(0.0)),
                slot => (Source::State(slot), Source::State(n + slot)),
            };
            (signals[position as usize], signals[speed as usize]) = (q, dq);
        }
        signals[Signal::T as usize] = Source::Time;
        if element.qeq != NONE {
            signals[Signal::Qeq as usize] = Source::Parameter(element.qeq);
        }
        if element.joint.slot != NONE {
            signals[Signal::Load as usize] = Source::Drive(element.joint.slot);
            if !is_friction {
                signals[Signal::Friction as usize] = Source::Friction(element.joint.slot);
            }
        }
        let torques = [(element.torque, element.joint.slot), (element.torque_from, element.from.slot)];
        let acts = |(output, slot): &(usize, usize)| *output != NONE && *slot != NONE;
        Law {
            kernel: element.kernel,
            is_friction,
            first_parameter: element.p,
            first_state: element.z,
            signals,
            torques: torques.into_iter().filter(acts).collect(),
        }
    }
}

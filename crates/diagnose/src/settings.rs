//! The numbers that decide how a diagnosis searches and when it ends; what is asked at which rates stands with the score test, what a
//! formula needs in `discover`, and what is at the floor of free simulations in `verdict`.

use dynid_identify::prediction;

/// How a diagnosis goes about it. None of these is there for one machine, log or effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Settings {
    /// How each fit searches.
    pub(super) search: prediction::Settings,
    /// An effect is chance if its log likelihood rises by less than the logarithm of the places asked over this.
    pub(super) chance: f64,
    /// Models are told apart by a difference of so many of its standard errors: one in a hundred is larger, this way, by chance.
    pub(super) apart: f64,
    /// Innovations are white up to this multiple of what Box and Pierce's sum is expected to be.
    pub(super) white: f64,
    /// A model is trusted altogether that is corrected by less than this share of an innovation at every sample.
    pub(super) trusted: f64,
    /// A command that runs straight must leave so much less of the squared errors.
    pub(super) straight: f64,
    /// An effect that does not explain all is the missing one if it explains this share, of what a formula explains, too.
    pub(super) much: f64,
    /// Where an effect counts only if it explains all, more are looked for if the most promising ones explain this share.
    pub(super) hopeful: f64,
    /// Errors below this multiple of the noise are near it: what no effect of the library explains there is no news. So is what acts besides
    /// a model, of the noise of the torque.
    pub(super) near: f64,
    /// So many effects are looked for one after the other, unless it is said how many.
    pub(super) depth: usize,
    /// So long a part of the runs decides what is fitted to all of them (s), and of each run at least so much.
    pub(super) beginning: (f64, f64),
    /// As many candidates, the most promising, are asked at other rates and from other values too.
    pub(super) further: usize,
    /// Arms of a batch, and batches at most.
    pub(super) arms: usize,
    pub(super) batches: usize,
    /// Arms that start at the values of the best.
    pub(super) later_arms: usize,
    /// Arms that are followed to their end.
    pub(super) last: usize,
    /// Linearisations of an arm's first round, if each takes one integration step a sample, and of the last that another follows.
    pub(super) linearisations: (usize, usize),
    /// So many rounds like the last one should bring an arm to the best one.
    pub(super) rounds: f64,
    /// What the values of a fit to the beginnings may lack of the log likelihood of all, per sample.
    pub(super) rough: f64,
    /// Effects of a step that are shown.
    pub(super) shown: usize,
}

impl Settings {
    /// Linearisations of a round of a search, of so many if each took one integration step a sample.
    pub(super) fn of_round(&self, steps: usize, search: &prediction::Search<'_>) -> usize {
        (steps / search.state().plan.mean_steps().ceil() as usize).clamp(1, self.search.iterations)
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            search: prediction::Settings::default(),
            chance: 0.01,
            apart: 2.33,
            white: 3.0,
            trusted: 0.05,
            straight: 0.3,
            much: 0.9,
            hopeful: 0.5,
            near: 1.5,
            depth: 2,
            beginning: (30.0, 5.0),
            further: 32,
            arms: 16,
            batches: 2,
            later_arms: 8,
            last: 3,
            linearisations: (8, 640),
            rounds: 5.0,
            rough: 0.1,
            shown: 5,
        }
    }
}

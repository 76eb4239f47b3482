//! How an interval between two samples is integrated.

/// Steps of an interval: where it says `k`, `2^k` of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scheme {
    /// The classical Runge-Kutta scheme of fourth order.
    Explicit(u8),
    /// The scheme of [`Implicit`](super::implicit::Implicit).
    Implicit(u8),
}

impl Scheme {
    /// One explicit step.
    pub const PLAIN: Self = Self::Explicit(0);
    /// In the order in which they are tried: implicit steps cost about ten explicit ones each.
    pub const LADDER: [Self; 11] = [
        Self::Explicit(0),
        Self::Explicit(1),
        Self::Explicit(2),
        Self::Explicit(3),
        Self::Implicit(0),
        Self::Implicit(1),
        Self::Explicit(4),
        Self::Implicit(2),
        Self::Explicit(5),
        Self::Implicit(3),
        Self::FINEST,
    ];
    /// What is taken where nothing else will do: whatever it errs by, what decays does not grow.
    pub const FINEST: Self = Self::Implicit(4);
    /// Explicit steps of an interval where implicit ones find no end.
    pub const UNSOLVED: usize = 64;

    /// Number of steps.
    pub fn steps(self) -> usize {
        match self {
            Self::Explicit(halvings) | Self::Implicit(halvings) => 1 << halvings,
        }
    }

    /// Place on the ladder of what is tried after this one, which stands at `place`; explicit steps that halving did not help are too
    /// long to be stable, so implicit ones come next.
    pub(super) fn next(self, place: usize, is_unstable: bool) -> usize {
        let is_implicit = |scheme: &Self| matches!(scheme, Self::Implicit(_));
        let implicit = Self::LADDER.iter().position(is_implicit).filter(|first| is_unstable && *first > place);
        implicit.unwrap_or(place + 1).min(Self::LADDER.len() - 1)
    }

    /// Numbers of implicit steps that are tried, `first` to begin with: where a step finds no end, a shorter one may.
    pub fn implicit_steps(first: usize) -> impl Iterator<Item = usize> {
        [1, 4, 16, 64].into_iter().map(move |parts| parts * first)
    }

    /// With every step halved.
    #[must_use]
    pub fn finer(self) -> Self {
        match self {
            Self::Explicit(halvings) => Self::Explicit(halvings + 1),
            Self::Implicit(halvings) => Self::Implicit(halvings + 1),
        }
    }
}

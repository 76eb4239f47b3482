//! How an interval between two samples is integrated.

/// Steps of an interval, all of one length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scheme {
    /// So many of the classical Runge-Kutta scheme of fourth order.
    Explicit(u32),
    /// So many of the scheme of [`Implicit`](super::implicit::Implicit).
    Implicit(u32),
}

impl Scheme {
    /// One explicit step.
    pub const PLAIN: Self = Self::Explicit(1);
    /// In the order in which they are tried: implicit steps cost about ten explicit ones each, and of a lower order, so that they are
    /// for what explicit ones are not stable in.
    pub const LADDER: [Self; 24] = [
        Self::Explicit(1),
        Self::Explicit(2),
        Self::Explicit(3),
        Self::Explicit(4),
        Self::Explicit(5),
        Self::Explicit(6),
        Self::Explicit(8),
        Self::Explicit(10),
        Self::Explicit(12),
        Self::Explicit(16),
        Self::Explicit(20),
        Self::Explicit(24),
        Self::Explicit(32),
        Self::Explicit(48),
        Self::Explicit(64),
        Self::Explicit(96),
        Self::Explicit(128),
        Self::Explicit(192),
        Self::Explicit(256),
        Self::Implicit(1),
        Self::Implicit(2),
        Self::Implicit(4),
        Self::Implicit(8),
        Self::FINEST,
    ];
    /// Explicit steps of an interval that is crossed again and again, at most. Where friction reverses, no scheme keeps its order, and
    /// only many explicit steps find their way: those are for what is crossed once.
    pub const MOST_REPEATED: u32 = 48;
    /// What is taken where nothing else will do: whatever it errs by, what decays does not grow.
    pub const FINEST: Self = Self::Implicit(16);
    /// Explicit steps of an interval where implicit ones find no end.
    pub const UNSOLVED: usize = 64;

    /// So many explicit steps.
    pub fn explicit(steps: usize) -> Self {
        Self::Explicit(u32::try_from(steps).unwrap_or(u32::MAX))
    }

    /// Number of steps.
    pub fn steps(self) -> usize {
        match self {
            Self::Explicit(steps) | Self::Implicit(steps) => steps as usize,
        }
    }

    /// Numbers of implicit steps that are tried, `first` to begin with: where a step finds no end, a shorter one may.
    pub fn implicit_steps(first: usize) -> impl Iterator<Item = usize> {
        [1, 4, 16, 64].into_iter().map(move |parts| parts * first)
    }

    /// With every step halved.
    #[must_use]
    pub fn finer(self) -> Self {
        match self {
            Self::Explicit(steps) => Self::Explicit(2 * steps),
            Self::Implicit(steps) => Self::Implicit(2 * steps),
        }
    }
}

//! One physical effect: a formula with parameters that vanishes at its null value.

pub use dynid_signal_chain::{Place, Stage};

use crate::{Expression, Parameter, device::JointKind, expression::Comparison, unit::Unit};

/// An effect as its file describes it, checked.
#[derive(Debug, Clone)]
pub struct Effect {
    /// The file's stem, e.g. `lugre`.
    pub id: String,
    /// One line for people.
    pub title: String,
    /// Where on the signal chain it sits.
    pub place: Place,
    /// One joint, an ordered pair, or the device.
    pub scope: Scope,
    /// `friction` marks laws whose sum at a joint is its friction (what `friction_bias` scales).
    pub family: Option<String>,
    /// Of the effects that share this word, a joint has at most one.
    pub alternatives: Option<String>,
    /// It is a curve of any shape and no particular cause: a user may add it, but no diagnosis names it.
    pub general: bool,
    /// What this effect takes the place of when it is added.
    pub replaces: Vec<Replacement>,
    /// Where on the drive path an actuator effect acts.
    pub stage: Option<Stage>,
    /// Parameters in the order in which kernels take them.
    pub parameters: Vec<EffectParameter>,
    /// Own states, integrated along.
    pub states: Vec<EffectState>,
    /// Named intermediate terms, in order.
    pub terms: Vec<(String, Expression)>,
    /// What the place asks for: output name and formula (see [`Place`]).
    pub outputs: Vec<(String, Expression)>,
    /// Linear inequalities between parameters, e.g. `Fs > Fc` (thesis Eq. 4.1).
    pub inequalities: Vec<(String, Comparison, String)>,
    /// What the residual looks like when this effect is missing.
    pub seen_as: String,
    /// What it is mistaken for.
    pub not_seen_as: String,
    /// Where the equation comes from.
    pub source: String,
}

/// Signals that formulas may name, in the order in which kernels take them.
pub const SIGNALS: [&str; 11] =
    ["q", "dq", "ddq", "t", "load", "friction", "qeq", "q_from", "dq_from", "command", "command_from"];

/// A parameter of this name (the spring's) is what the signal of this name shows to the other effects of its joint.
/// In a formula, a parameter hides a signal.
pub const REST_POSITION: &str = "qeq";

impl Effect {
    /// The parameter of that symbol.
    pub fn parameter(&self, symbol: &str) -> Option<&EffectParameter> {
        self.parameters.iter().find(|parameter| parameter.symbol == symbol)
    }

    /// Number of different signals that its formulas read.
    pub fn n_signals(&self) -> usize {
        SIGNALS.into_iter().filter(|signal| self.reads(signal)).count()
    }

    /// Whether its formulas read that signal; a parameter of the same name hides it.
    pub fn reads(&self, signal: &str) -> bool {
        let mut occurs = false;
        let formulas = self.terms.iter().chain(&self.outputs).map(|(_, formula)| formula);
        for formula in formulas.chain(self.states.iter().map(|state| &state.rate)) {
            formula.for_each_symbol(&mut |symbol| occurs |= symbol == signal);
        }
        occurs && self.parameter(signal).is_none()
    }

    /// Terms, outputs and state rates at one point: outputs in order, then rates.
    ///
    /// `lookup` gives the value of every signal, parameter and state.
    ///
    /// # Errors
    /// The first symbol that nobody knows.
    pub fn evaluate(&self, lookup: &dyn Fn(&str) -> Option<f64>) -> Result<(Vec<f64>, Vec<f64>), String> {
        let mut terms: Vec<(&str, f64)> = Vec::new();
        for (name, formula) in &self.terms {
            let value = formula.evaluate(&|symbol| with_terms(&terms, symbol, lookup))?;
            terms.push((name, value));
        }
        let all = |symbol: &str| with_terms(&terms, symbol, lookup);
        let outputs = self.outputs.iter().map(|(_, formula)| formula.evaluate(&all)).collect::<Result<_, _>>()?;
        let rates = self.states.iter().map(|state| state.rate.evaluate(&all)).collect::<Result<_, _>>()?;
        Ok((outputs, rates))
    }
}

fn with_terms(terms: &[(&str, f64)], symbol: &str, lookup: &dyn Fn(&str) -> Option<f64>) -> Option<f64> {
    terms.iter().find(|(name, _)| *name == symbol).map(|(_, value)| *value).or_else(|| lookup(symbol))
}

/// An effect that another one contains.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Replacement {
    /// The effect that is taken out.
    pub id: String,
    /// `(own symbol, its symbol)` of parameters that keep their value; those of equal symbol are included.
    pub carry: Vec<(String, String)>,
}

/// What an effect is attached to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Scope {
    /// `joint = i`
    Joint,
    /// `from = j`, `joint = i`
    Pair,
    /// neither
    Device,
}

/// A parameter of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectParameter {
    /// E.g. `sigma0`. Its parameter name is `joint.<i>.<effect>.<symbol>` or `joint.<i>.<effect>.<from>.<symbol>`.
    pub symbol: String,
    /// SI unit at a revolute joint, e.g. `N*m*s/rad`.
    pub unit: String,
    /// What it means.
    pub title: String,
    /// First guess.
    pub initial: f64,
    /// Default bounds.
    pub lower: f64,
    /// Default bounds.
    pub upper: f64,
    /// The value at which the effect vanishes; `None` for a parameter that does not matter then.
    pub null: Option<f64>,
    /// Physics to be identified, or a choice of the numerics (e.g. `v_eps`).
    pub origin: Origin,
    /// True where no fit should move it; numerical choices are, unless the file says otherwise.
    pub fixed: bool,
    /// Values that a diagnosis tries for what it cannot find by a linear step.
    pub scan: Option<Scan>,
}

/// Values to try for a parameter, in units of what the joint does.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    /// What the values are multiples of.
    pub of: Measure,
    /// The multiples.
    pub at: Vec<f64>,
}

/// A size that a log shows of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Measure {
    /// 1: the values are the parameter's own.
    Value,
    /// Root mean square of the speed.
    Speed,
    /// A place: the middle of the positions, and multiples of half their range on top.
    Position,
    /// The range of the positions, *divided* by the multiple: the length of one of so many periods.
    PerRange,
    /// The range of the positions, times the multiple.
    Range,
    /// Root mean square of the command.
    Command,
    /// Root mean square of the torque that the drive path delivers.
    Torque,
    /// Torque over the range of positions.
    Stiffness,
    /// The range of positions over torque.
    Compliance,
    /// Torque over speed.
    Damping,
    /// Torque over acceleration.
    Inertia,
    /// Length of the log (s).
    Duration,
}

/// What kind of number a parameter is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// A property of the machine.
    Physics,
    /// A choice that makes the law computable.
    Numerical,
}

impl EffectParameter {
    /// The first guess with the default bounds.
    pub fn parameter(&self) -> Parameter {
        Parameter { value: self.initial, lower: self.lower, upper: self.upper, fixed: self.fixed }
    }

    /// The unit at a joint of this kind, with the joint's command unit put in: `N*m/command` -> `N*m/V`.
    pub fn unit_at(&self, kind: JointKind, command_unit: &str) -> String {
        match (Unit::parse(&self.unit), Unit::parse(command_unit)) {
            (Ok(unit), Ok(command)) => unit.at(kind).with_command(&command).to_string(),
            (Ok(unit), Err(_)) => unit.at(kind).to_string(),
            _ => self.unit.clone(),
        }
    }
}

/// A state of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectState {
    /// E.g. `z`.
    pub symbol: String,
    /// Unit at a revolute joint.
    pub unit: String,
    /// Value at the start of a run; 0 where it starts as a signal.
    pub initial: f64,
    /// Whether it starts as the speed of its joint (`initial = "dq"`): a motor that moves with it.
    pub starts_at_speed: bool,
    /// Its time derivative.
    pub rate: Expression,
}

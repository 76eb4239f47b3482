//! Integrates a [`System`] over a log: what position would it have shown under these torques?
//!
//! Classical Runge-Kutta of fourth order, with as many steps between two samples as a tolerance asks for or a user states; predictions are
//! planned interval by interval ([`Scheme`]). Where explicit steps are not stable, implicit ones are taken. Torques are held over the
//! sample (`tau` of row k acts from t_k to t_k+1) or run linearly from one to the next.

mod adapt;
pub mod control;
pub mod implicit;
mod late;
mod predictor;
mod scheme;

pub use late::Commands;
pub use predictor::{Gains, Planned, Predictor, correct_by, plan, plan_across_gaps};
pub use scheme::Scheme;

use crate::{system::Scratch, system::System};
use adapt::{Adaptation, Tolerance};
use implicit::Implicit;

/// How the commanded torque runs between samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Intersample {
    /// The torque of row `k` acts from `t_k` to `t_(k+1)`.
    ZeroOrder,
    /// The torque runs straight from row to row.
    FirstOrder,
}

/// What drives a simulation.
#[derive(Debug, Clone, Copy)]
pub struct Input<'a> {
    /// Sample times (s), ascending.
    pub time: &'a [f64],
    /// Commanded torques [N*m or N] of all joints, one row per sample.
    pub command: &'a [f64],
    /// Between the samples.
    pub intersample: Intersample,
}

impl<'a> Input<'a> {
    /// The commands as a simulation plays them.
    pub fn commands(&self, n_joints: usize) -> Commands<'a> {
        Commands { time: self.time, rows: self.command, n_joints, intersample: self.intersample }
    }

    /// The commands of a sample and of the one after it.
    pub fn around(&self, sample: usize, n_joints: usize) -> (&'a [f64], &'a [f64]) {
        self.command[sample * n_joints..(sample + 2) * n_joints].split_at(n_joints)
    }

    /// What arrives at `t` within step `index` of `steps` from a sample to the next.
    pub fn command_at(
        &self,
        system: &System,
        sample: usize,
        (index, steps): (usize, usize),
        t: f64,
        command: &mut [f64],
    ) {
        let (now, next) = self.around(sample, system.n_joints());
        let (start, end) = (self.time[sample], self.time[sample + 1]);
        match self.intersample {
            Intersample::ZeroOrder => command.copy_from_slice(now),
            Intersample::FirstOrder => interpolate((t - start) / (end - start), now, next, command),
        }
        if !system.delays().is_empty() {
            self.commands(system.n_joints()).arrive(system, t, step_bounds(start, end, steps, index), command, None);
        }
    }

    /// The first `samples` samples.
    #[must_use]
    pub fn first(self, samples: usize) -> Self {
        let samples = samples.min(self.time.len());
        let n_joints = self.command.len() / self.time.len().max(1);
        Self {
            time: &self.time[..samples],
            command: &self.command[..samples * n_joints],
            intersample: self.intersample,
        }
    }
}

/// How to integrate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// How long steps are.
    pub steps: Steps,
    /// A position beyond this [rad or m] counts as diverged.
    pub position_limit: f64,
}

/// How long integration steps are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Steps {
    /// So many explicit ones in a (mean) sample time; a longer gap between two samples takes proportionally more. The thesis's
    /// coupled joints take 60.
    PerSample(usize),
    /// As few as leave the error that is estimated of an interval within this share, of each state, of the largest that it was so far.
    Within(f64),
}

impl Steps {
    /// What is taken where nothing is said: 60 s of the Freedom 6S, one joint or all, stay within 1e-5 rad of steps ten times as short as
    /// the thesis's (`docs/speed.md`).
    pub const ADAPTIVE: Self = Self::Within(Self::ADAPTIVE_SHARE);
    /// The share of it.
    pub const ADAPTIVE_SHARE: f64 = 3e-5;
    /// What is taken where the motion is handed on as the model's own.
    pub const EXACT: Self = Self::Within(1e-7);
    /// Steps of a (mean) sample time where none can be adapted.
    const NOT_ADAPTED: usize = 60;

    /// Shorter ones, which tell what these err by.
    #[must_use]
    pub fn finer(self) -> Self {
        match self {
            Self::PerSample(steps) => Self::PerSample(2 * steps),
            // Of fourth order: about half as long.
            Self::Within(share) => Self::Within(share / 16.0),
        }
    }

    /// Explicit steps in a sample time where none can be adapted.
    pub fn per_sample(self) -> usize {
        match self {
            Self::PerSample(steps) => steps,
            Self::Within(_) => Self::NOT_ADAPTED,
        }
    }
}

/// Evaluations of the equations that a sample takes, at least.
const EVALUATIONS: usize = 4;

/// What counts as diverged where nothing else is said [rad or m]: a numerical choice, far beyond any joint.
pub const POSITION_LIMIT: f64 = 1e3;

impl Default for Options {
    fn default() -> Self {
        Self { steps: Steps::ADAPTIVE, position_limit: POSITION_LIMIT }
    }
}

impl Options {
    /// So many explicit steps per sample.
    pub fn per_sample(steps: usize) -> Self {
        Self { steps: Steps::PerSample(steps), ..Self::default() }
    }
}

/// Positions and speeds at the samples, n_samples x n_free, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Number of free joints.
    pub n_free: usize,
    /// Logged positions [rad or m]: true positions, or what sensor effects make of them.
    pub q: Vec<f64>,
    /// Speeds [rad/s or m/s].
    pub dq: Vec<f64>,
    /// The whole state at the last sample.
    pub last: Vec<f64>,
}

impl Trajectory {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.q.len().checked_div(self.n_free).unwrap_or(0)
    }

    /// True where nothing was simulated.
    pub fn is_empty(&self) -> bool {
        self.q.is_empty()
    }
}

/// Why a simulation gave no answer.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimulationError {
    /// The motion left all bounds, or its equations lost their meaning.
    #[error(
        "the simulation diverges at {time_s:.4} s at joint {joint}: with these values the model is unstable, or steps that \
         were stated are too long (take more substeps)"
    )]
    Diverged {
        /// When (s).
        time_s: f64,
        /// The device's joint index.
        joint: usize,
    },
    /// Inputs of different lengths.
    #[error("{what}: {found} values given, {expected} needed")]
    Length {
        /// Which vector.
        what: &'static str,
        /// How many came.
        found: usize,
        /// How many are needed.
        expected: usize,
    },
    /// The time does not run forward.
    #[error("time does not run forward at sample {sample}")]
    Time {
        /// Index of the offending sample.
        sample: usize,
    },
}

/// Simulates from `q0`: the free joints' positions [rad or m], at rest; or their positions, then their speeds.
pub fn simulate(
    system: &System,
    input: &Input<'_>,
    q0: &[f64],
    options: &Options,
) -> Result<Trajectory, SimulationError> {
    check(system, input, q0)?;
    simulate_from(system, input, &system.rest(q0), options)
}

/// Simulates from the state `x0 = [q, dq, effect states]`.
pub fn simulate_from(
    system: &System,
    input: &Input<'_>,
    x0: &[f64],
    options: &Options,
) -> Result<Trajectory, SimulationError> {
    sample_by_sample(system, input, x0, options, None, |_, _, _| ())
}

/// One-step predictions of a log: as [`simulate`], but once a sample is compared its prediction's error corrects the motion that
/// is simulated on from there. The trajectory holds the predictions.
pub fn predict(
    system: &System,
    input: &Input<'_>,
    predictor: &Predictor<'_>,
    q0: &[f64],
    options: &Options,
) -> Result<Trajectory, SimulationError> {
    check(system, input, q0)?;
    sample_by_sample(system, input, &system.rest(q0), options, Some(predictor), |sample, shown, x| {
        predictor.correct(system, input.time, sample, shown, x);
    })
}

/// Simulates, each interval in its own steps where a predictor has planned them; `after` sees each sample, what is logged of it, and the
/// state, which it may change.
fn sample_by_sample(
    system: &System,
    input: &Input<'_>,
    x0: &[f64],
    options: &Options,
    predictor: Option<&Predictor<'_>>,
    mut after: impl FnMut(usize, &[f64], &mut [f64]),
) -> Result<Trajectory, SimulationError> {
    check(system, input, x0.get(..system.n_free()).unwrap_or(&[]))?;
    if x0.len() != system.n_states() {
        return Err(SimulationError::Length { what: "initial state", found: x0.len(), expected: system.n_states() });
    }
    let mut recorder = Recorder::new(system, input.time.len());
    let mut stepper = Stepper::new(system, x0);
    recorder.take(system, input.time.first().copied().unwrap_or(0.0), &stepper.x, options)?;
    after(0, recorder.last(), &mut stepper.x);
    system.announce(EVALUATIONS * input.time.len());
    let mut course = Course::new(system, input.time, options, predictor);
    for sample in 0..input.time.len().saturating_sub(1) {
        course.cross(&mut stepper, system, input, sample);
        recorder.take(system, input.time[sample + 1], &stepper.x, options)?;
        after(sample + 1, recorder.last(), &mut stepper.x);
    }
    Ok(recorder.finish(stepper.x))
}

/// Whether an input and a start fit a system.
///
/// # Errors
/// A length that is not the system's, or a time that does not rise.
pub fn check(system: &System, input: &Input<'_>, q0: &[f64]) -> Result<(), SimulationError> {
    let expected = input.time.len() * system.n_joints();
    if input.command.len() != expected {
        return Err(SimulationError::Length { what: "commanded torques", found: input.command.len(), expected });
    }
    if q0.len() != system.n_free() && q0.len() != 2 * system.n_free() {
        return Err(SimulationError::Length { what: "initial positions", found: q0.len(), expected: system.n_free() });
    }
    match input.time.windows(2).position(|pair| pair[0].partial_cmp(&pair[1]) != Some(std::cmp::Ordering::Less)) {
        Some(sample) => Err(SimulationError::Time { sample: sample + 1 }),
        None => Ok(()),
    }
}

/// Says whether a state is one to go on from, and which joint it is that is not.
pub fn check_state(system: &System, time_s: f64, x: &[f64], options: &Options) -> Result<(), SimulationError> {
    let n = system.n_free();
    let sound = |slot: usize| x[slot].abs() <= options.position_limit && x[n + slot].is_finite();
    let failed = (0..n).find(|slot| !sound(*slot)).or_else(|| {
        // A bristle that overflows takes its joint along at the next step; until then the joint is not known.
        (!x[2 * n..].iter().all(|z| z.is_finite())).then_some(0)
    });
    match failed {
        Some(slot) => Err(SimulationError::Diverged { time_s, joint: system.kernel().free[slot] }),
        None => Ok(()),
    }
}

/// How a simulation goes from sample to sample.
enum Course<'a> {
    Grid(Grid),
    Planned(&'a Predictor<'a>),
    Adapted { adaptation: Box<Adaptation<'a>>, grid: Grid },
}

impl<'a> Course<'a> {
    fn new(system: &System, time: &[f64], options: &Options, predictor: Option<&'a Predictor<'a>>) -> Self {
        match (predictor, options.steps) {
            (Some(predictor), _) => Self::Planned(predictor),
            (None, Steps::PerSample(steps)) => Self::Grid(Grid::new(time, steps)),
            (None, Steps::Within(share)) => {
                let adaptation = Adaptation::new(system, Tolerance::of_all(system, share), &[], false);
                Self::Adapted { adaptation: Box::new(adaptation), grid: Grid::new(time, 1) }
            }
        }
    }

    fn cross(&mut self, stepper: &mut Stepper, system: &System, input: &Input<'_>, sample: usize) {
        let (start, end) = (input.time[sample], input.time[sample + 1]);
        match self {
            Self::Grid(grid) => stepper.explicit(system, input, sample, grid.steps(start, end)),
            Self::Planned(predictor) => stepper.across(system, input, sample, predictor.scheme(sample)),
            Self::Adapted { adaptation, grid } => {
                match grid.gap(start, end) {
                    Some(samples) => adaptation.cross_gap(stepper, system, (input, sample), samples),
                    None => adaptation.cross(stepper, system, input, sample),
                };
            }
        }
    }
}

/// How many steps an interval between samples takes.
pub struct Grid {
    step: f64,
}

impl Grid {
    /// Steps of samples that are as far apart as these are in the mean.
    pub fn new(time: &[f64], substeps: usize) -> Self {
        let span = time.last().copied().unwrap_or(0.0) - time.first().copied().unwrap_or(0.0);
        let intervals = time.len().saturating_sub(1).max(1);
        Self { step: span / intervals as f64 / substeps.max(1) as f64 }
    }

    /// Steps that are not adapted, where they could be.
    pub fn of(time: &[f64], steps: Steps) -> Self {
        Self::new(time, steps.per_sample())
    }

    /// As a plan of all intervals.
    pub fn schemes(&self, time: &[f64]) -> Vec<Scheme> {
        time.windows(2).map(|pair| Scheme::explicit(self.steps(pair[0], pair[1]))).collect()
    }

    /// How many sample times an interval spans that is a gap between samples; a clock that is uneven makes none.
    fn gap(&self, start: f64, end: f64) -> Option<usize> {
        let samples = self.steps(start, end);
        (samples > 2).then_some(samples)
    }

    /// At least one; rounding of the log's times does not add a step.
    pub fn steps(&self, start: f64, end: f64) -> usize {
        (((end - start) / self.step - 1e-3).ceil() as usize).max(1)
    }
}

struct Recorder {
    trajectory: Trajectory,
    position: Vec<f64>,
}

impl Recorder {
    fn new(system: &System, samples: usize) -> Self {
        let n_free = system.n_free();
        let room = samples * n_free;
        Self {
            trajectory: Trajectory {
                n_free,
                q: Vec::with_capacity(room),
                dq: Vec::with_capacity(room),
                last: Vec::new(),
            },
            position: vec![0.0; n_free],
        }
    }

    fn take(&mut self, system: &System, t: f64, x: &[f64], options: &Options) -> Result<(), SimulationError> {
        check_state(system, t, x, options)?;
        let n = system.n_free();
        if system.has_sensors() {
            system.measure(t, x, &mut self.position);
            self.trajectory.q.extend_from_slice(&self.position);
        } else {
            self.trajectory.q.extend_from_slice(&x[..n]);
        }
        self.trajectory.dq.extend_from_slice(&x[n..2 * n]);
        Ok(())
    }

    /// What is logged of the last sample.
    fn last(&self) -> &[f64] {
        let n_free = self.trajectory.n_free;
        &self.trajectory.q[self.trajectory.q.len() - n_free..]
    }

    fn finish(mut self, last: Vec<f64>) -> Trajectory {
        self.trajectory.last = last;
        self.trajectory
    }
}

/// Takes steps, explicit or implicit, and has the room for them.
pub struct Stepper {
    /// The state: positions and speeds of the free joints, then the effects' states.
    pub x: Vec<f64>,
    scratch: Scratch,
    stage: Vec<f64>,
    rate: Vec<f64>,
    sum: Vec<f64>,
    command: Vec<f64>,
    implicit: Option<Box<Implicit>>,
    /// Whether explicit steps estimate what they err by; then `error` adds up what they do.
    estimates: bool,
    error: Vec<f64>,
    last_slope: Vec<f64>,
}

impl Stepper {
    /// Room for a simulation that starts at `x0`.
    pub fn new(system: &System, x0: &[f64]) -> Self {
        let room = vec![0.0; x0.len()];
        Self {
            x: x0.to_vec(),
            scratch: system.scratch(),
            stage: room.clone(),
            rate: room.clone(),
            sum: room.clone(),
            command: vec![0.0; system.n_joints()],
            implicit: None,
            estimates: false,
            error: room.clone(),
            last_slope: room,
        }
    }

    /// From a sample to the next in explicit steps.
    fn explicit(&mut self, system: &System, input: &Input<'_>, sample: usize, steps: usize) {
        let (now, next) = input.around(sample, system.n_joints());
        let (start, end) = (input.time[sample], input.time[sample + 1]);
        let late = input.commands(system.n_joints());
        match input.intersample {
            Intersample::ZeroOrder => self.held(system, start, end, steps, now, &late),
            Intersample::FirstOrder => self.running(system, (start, end), steps, (now, next), &late),
        }
    }

    /// From a sample to the next by a scheme; where no implicit steps find an end, by explicit ones.
    fn across(&mut self, system: &System, input: &Input<'_>, sample: usize, scheme: Scheme) {
        match scheme {
            Scheme::Explicit(_) => self.explicit(system, input, sample, scheme.steps()),
            Scheme::Implicit(_) => {
                let implicit = self.implicit.get_or_insert_with(|| Box::new(Implicit::new(system)));
                self.stage.copy_from_slice(&self.x);
                let is_solved = Scheme::implicit_steps(scheme.steps()).any(|steps| {
                    self.x.copy_from_slice(&self.stage);
                    (0..steps).all(|index| implicit.step_of(system, input, sample, (index, steps), &mut self.x))
                });
                if !is_solved {
                    self.x.copy_from_slice(&self.stage);
                    self.explicit(system, input, sample, Scheme::UNSOLVED);
                }
            }
        }
    }

    /// As [`Stepper::explicit`]; returns what each state is estimated to err by at the end.
    fn estimated(&mut self, system: &System, input: &Input<'_>, sample: usize, steps: usize) -> &[f64] {
        self.estimates = true;
        self.explicit(system, input, sample, steps);
        self.estimates = false;
        &self.error
    }

    /// From `start` to `end` (s) in `steps` steps under constant commands; `late` is where late joints find theirs.
    pub fn held(&mut self, system: &System, start: f64, end: f64, steps: usize, command: &[f64], late: &Commands<'_>) {
        if !system.delays().is_empty() {
            self.running(system, (start, end), steps, (command, command), late);
        } else if system.steady_drive() {
            system.drive(&mut self.scratch, start, &self.x, command, &mut self.rate);
            self.explicitly((start, end), steps, true, |scratch, _, _, t, x, dx| system.motion(scratch, t, x, dx));
        } else {
            self.explicitly((start, end), steps, true, |scratch, _, _, t, x, dx| {
                system.derivative(scratch, t, x, command, dx);
            });
        }
    }

    /// From `start` to `end` (s) in `steps` steps under commands that run from `now` to `next`, or arrive as `late` says.
    fn running(
        &mut self,
        system: &System,
        (start, end): (f64, f64),
        steps: usize,
        (now, next): (&[f64], &[f64]),
        late: &Commands<'_>,
    ) {
        let is_continuous = system.delays().is_empty();
        self.explicitly((start, end), steps, is_continuous, |scratch, command, step, t, x, dx| {
            interpolate((t - start) / (end - start), now, next, command);
            late.arrive(system, t, step_bounds(start, end, steps, step), command, None);
            system.derivative(scratch, t, x, command, dx);
        });
    }

    /// From `start` to `end` (s) in `steps` steps with the rates that `rate` makes of room, a step's index, the time and the state;
    /// `is_continuous` where the rates of two steps meet.
    fn explicitly(
        &mut self,
        (start, end): (f64, f64),
        steps: usize,
        is_continuous: bool,
        mut rate: impl FnMut(&mut Scratch, &mut [f64], usize, f64, &[f64], &mut [f64]),
    ) {
        let step = (end - start) / steps as f64;
        let Self { x, scratch, stage, rate: slope, sum, command, last_slope, error, estimates, .. } = self;
        let rate = |k: usize, t: f64, x: &[f64], dx: &mut [f64]| rate(scratch, command, k, t, x, dx);
        let room = [x, stage, slope, sum];
        if *estimates {
            runge_kutta_estimated(rate, (start, step, steps), is_continuous, room, [last_slope, error]);
        } else {
            runge_kutta_steps(rate, (start, step, steps), room);
        }
    }
}

/// So many steps of the classical scheme from `start` (s), each `step` (s) long; `rate` is also told the step's index. Room as for
/// [`runge_kutta`].
fn runge_kutta_steps(
    mut rate: impl FnMut(usize, f64, &[f64], &mut [f64]),
    (start, step, steps): (f64, f64, usize),
    [x, stage, slope, sum]: [&mut Vec<f64>; 4],
) {
    for k in 0..steps {
        let rate = |t: f64, x: &[f64], dx: &mut [f64]| rate(k, t, x, dx);
        runge_kutta(rate, start + k as f64 * step, step, [x, stage, slope, sum]);
    }
}

/// The same steps, and what each element is estimated to err by: where the slope at the end takes the place of the last stage's in the
/// scheme, an embedded formula of third order, whose differences add up in the last vector. The one before it is room. Where the rates of
/// two steps meet (`is_continuous`), a step begins with that slope.
pub fn runge_kutta_estimated(
    mut rate: impl FnMut(usize, f64, &[f64], &mut [f64]),
    (start, step, steps): (f64, f64, usize),
    is_continuous: bool,
    [x, stage, slope, sum]: [&mut Vec<f64>; 4],
    [last_slope, error]: [&mut Vec<f64>; 2],
) {
    let at = |k: usize| start + k as f64 * step;
    error.fill(0.0);
    for k in 0..steps {
        let mut rate = |t: f64, x: &[f64], dx: &mut [f64]| rate(k, t, x, dx);
        if k == 0 || !is_continuous {
            rate(at(k), x, slope);
        }
        runge_kutta_from(&mut rate, at(k), step, [x, stage, slope, sum]);
        rate(at(k + 1), x, last_slope);
        for ((error, last), end) in error.iter_mut().zip(&*slope).zip(&*last_slope) {
            *error += (step / 6.0 * (last - end)).abs();
        }
        std::mem::swap(slope, last_slope);
    }
}

/// Where step `k` of an interval begins and ends (s): the last one ends with the interval, to the last bit.
pub fn step_bounds(start: f64, end: f64, steps: usize, k: usize) -> (f64, f64) {
    let step = (end - start) / steps as f64;
    let at = |k: usize| if k == steps { end } else { start + k as f64 * step };
    (at(k), at(k + 1))
}

/// `command` at a share of the way from `now` to `next`.
pub fn interpolate(share: f64, now: &[f64], next: &[f64], command: &mut [f64]) {
    for ((command, now), next) in command.iter_mut().zip(now).zip(next) {
        *command = now + share * (next - now);
    }
}

/// One step of the classical scheme; `room` is the state, then three vectors of its length.
pub fn runge_kutta(
    mut rate: impl FnMut(f64, &[f64], &mut [f64]),
    t: f64,
    step: f64,
    [x, stage, slope, sum]: [&mut Vec<f64>; 4],
) {
    rate(t, x, slope);
    runge_kutta_from(rate, t, step, [x, stage, slope, sum]);
}

/// As [`runge_kutta`], where the slope at `x` is there already: in the third vector, which then holds the slope of the last stage.
fn runge_kutta_from(
    mut rate: impl FnMut(f64, &[f64], &mut [f64]),
    t: f64,
    step: f64,
    [x, stage, slope, sum]: [&mut Vec<f64>; 4],
) {
    let n = x.len();
    let (x, stage, slope, sum) = (&mut x[..n], &mut stage[..n], &mut slope[..n], &mut sum[..n]);
    let half = 0.5 * step;
    for i in 0..n {
        sum[i] = slope[i];
        stage[i] = x[i] + half * slope[i];
    }
    rate(t + half, stage, slope);
    for i in 0..n {
        sum[i] += 2.0 * slope[i];
        stage[i] = x[i] + half * slope[i];
    }
    rate(t + half, stage, slope);
    for i in 0..n {
        sum[i] += 2.0 * slope[i];
        stage[i] = x[i] + step * slope[i];
    }
    rate(t + step, stage, slope);
    let sixth = step / 6.0;
    for i in 0..n {
        x[i] += sixth * (sum[i] + slope[i]);
    }
}

#[cfg(test)]
mod tests;

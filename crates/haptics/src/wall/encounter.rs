//! A device and a hand between the ticks of a controller: what every contact, at a joint or in space, is simulated with.
//!
//! Device and hand are integrated by Runge-Kutta between the ticks, torques are held over each tick and reach the joints through
//! the model's own drive path. The energy that a held torque gives out is exact, if the drive delivers what is commanded.

use std::collections::VecDeque;

use super::{Hand, WallError, hand::Wanted, setting::Sampling};
use dynid_dynamics::{
    simulate, simulate::SimulationError, simulate::control::round_to, system::Scratch, system::System,
};

/// What a hand holds of a device, in `D` directions: a joint itself, or a point in space.
pub(super) trait Held<const D: usize> {
    /// Where the handle is and how fast it moves in the state `x` of the device.
    fn handle(&mut self, x: &[f64]) -> [[f64; D]; 2];
    /// Torques at the free joints of the hand's `force` at the handle, in the state that [`Held::handle`] was asked last.
    fn torques(&mut self, x: &[f64], force: [f64; D], torques: &mut [f64]);
    /// What the arm wants at a time (s), `touched` being when the wall was first met.
    fn wanted(&self, t: f64, touched: Option<f64>) -> Wanted<D>;
    /// How far a handle is outside of the wall; negative inside.
    fn distance(&self, handle: [f64; D]) -> f64;
}

/// What is at hand at a tick.
pub(super) struct Tick<'a> {
    /// State of the device `[q, dq, z]`.
    pub(super) device: &'a [f64],
    /// What the controller had said so many ticks ago that it acts until the next: commands of all joints, then what it told
    /// besides.
    pub(super) acting: &'a [f64],
    /// Energy that the hand has put into the device since the start (J).
    pub(super) hand_work: f64,
}

/// That no command arrives late: what a controller says is played when it says it.
///
/// # Errors
/// [`WallError::Late`].
pub(super) fn refuse_delays(system: &System) -> Result<(), WallError> {
    match system.delays().iter().find(|delay| delay.span_s > 0.0) {
        Some(delay) => Err(WallError::Late { joint: delay.joint, span_s: delay.span_s }),
        None => Ok(()),
    }
}

/// A device and a hand, about to meet a wall.
pub(super) struct Encounter<'a> {
    pub(super) system: &'a System,
    pub(super) sampling: Sampling,
    pub(super) hand: &'a Hand,
    /// Positions of the free joints at the start, at rest.
    pub(super) start: &'a [f64],
    /// How long a hand is waited for that does not get to the wall (s).
    pub(super) patience_s: f64,
    /// What acts until the controller's first answer arrives.
    pub(super) first: &'a [f64],
}

impl Encounter<'_> {
    /// Plays it. `control` answers what the sensors show with commands of all joints and, behind them, what is to be reported;
    /// `tell` hears of every tick. Answers the tick of the first contact.
    ///
    /// # Errors
    /// [`WallError::Diverged`]; [`WallError::Late`].
    pub(super) fn play<const D: usize>(
        &self,
        held: &mut impl Held<D>,
        mut control: impl FnMut(&[f64], &mut [f64]),
        mut tell: impl FnMut(&Tick<'_>),
    ) -> Result<Option<usize>, WallError> {
        let Self { system, sampling, hand, .. } = *self;
        let mut sampled = Sampled::new(self)?;
        system.announce(4 * sampling.steps().0 * sampled.after);
        let (n_states, n_joints) = (system.n_states(), system.n_joints());
        let mut x = system.rest(self.start);
        let place = held.handle(&x)[0];
        x.extend(Hand::rest(place));
        x.push(0.0);
        let rooms = [x.clone(), x.clone(), x.clone()];
        let scratch = system.scratch();
        let [external, driven] = [(); 2].map(|()| vec![0.0; system.n_free()]);
        let mut integrator = Integrator { system, hand, held, scratch, external, driven, x, rooms };
        let (substeps, step) = sampling.steps();
        for tick in 0.. {
            let t = tick as f64 * sampling.sample_s;
            let away = integrator.away();
            let hand_work = integrator.x[n_states + Hand::n_states(D)];
            let device = &integrator.x[..n_states];
            if !sampled.goes_on(tick, device, (away, hand_work), &mut control, &mut tell)? {
                break;
            }
            let command = &sampled.acting()[..n_joints];
            integrator.hold(t, command);
            for k in 0..substeps {
                let now = t + k as f64 * step;
                let touched_s = sampled.touched_s.or_else(|| (integrator.away() < 0.0).then_some(now));
                sampled.touched_s = touched_s;
                integrator.step(now, step, &sampled.acting()[..n_joints], touched_s);
            }
        }
        Ok(sampled.touched)
    }
}

/// An encounter as its controller sees it.
pub(super) struct Sampled<'a> {
    system: &'a System,
    sampling: Sampling,
    first: &'a [f64],
    shown: Vec<f64>,
    underway: VecDeque<Vec<f64>>,
    /// Ticks to wait for a hand that does not get to the wall, and from the first contact to the end.
    patience: usize,
    after: usize,
    /// The tick of the first contact.
    pub(super) touched: Option<usize>,
    /// When the wall was first met between two ticks (s).
    pub(super) touched_s: Option<f64>,
}

impl<'a> Sampled<'a> {
    /// # Errors
    /// [`WallError::Late`].
    pub(super) fn new(encounter: &Encounter<'a>) -> Result<Self, WallError> {
        let Encounter { system, sampling, first, patience_s, .. } = *encounter;
        refuse_delays(system)?;
        let after = (sampling.after_s / sampling.sample_s).round() as usize;
        Ok(Self {
            system,
            sampling,
            first,
            shown: vec![0.0; system.n_free()],
            underway: VecDeque::from(vec![first.to_vec(); sampling.delay_samples + 1]),
            patience: (patience_s / sampling.sample_s).ceil() as usize,
            after,
            touched: None,
            touched_s: None,
        })
    }

    /// What happens at a tick, `away` from the wall; says whether another one follows.
    ///
    /// # Errors
    /// [`WallError::Diverged`].
    pub(super) fn goes_on(
        &mut self,
        tick: usize,
        device: &[f64],
        (away, hand_work): (f64, f64),
        control: &mut impl FnMut(&[f64], &mut [f64]),
        tell: &mut impl FnMut(&Tick<'_>),
    ) -> Result<bool, WallError> {
        let Self { system, sampling, shown, .. } = self;
        let t = tick as f64 * sampling.sample_s;
        simulate::check_state(system, t, device, &simulate::Options::default()).map_err(|error| match error {
            SimulationError::Diverged { time_s, joint } => WallError::Diverged { time_s, joint },
            _ => WallError::Diverged { time_s: t, joint: system.kernel().free[0] },
        })?;
        system.measure(t, device, shown);
        shown.iter_mut().for_each(|shown| *shown = round_to(*shown, sampling.position_quantum));
        // The oldest answer has acted its time; its room takes the newest.
        let mut answer = self.underway.pop_front().unwrap_or_else(|| self.first.to_vec());
        control(shown, &mut answer);
        self.underway.push_back(answer);
        if self.touched.is_none() && away < 0.0 {
            self.touched = Some(tick);
        }
        tell(&Tick { device, acting: self.acting(), hand_work });
        Ok(tick < self.touched.map_or(self.patience, |touched| touched + self.after))
    }

    /// What acts until the next tick.
    pub(super) fn acting(&self) -> &[f64] {
        self.underway.front().map_or(self.first, Vec::as_slice)
    }
}

/// State of the device, of the hand, then the energy that the hand has put in.
struct Integrator<'a, H> {
    system: &'a System,
    hand: &'a Hand,
    held: &'a mut H,
    scratch: Scratch,
    external: Vec<f64>,
    /// What the drives deliver, where that depends on the commands alone.
    driven: Vec<f64>,
    x: Vec<f64>,
    rooms: [Vec<f64>; 3],
}

impl<H> Integrator<'_, H> {
    /// How far the handle is from the wall.
    fn away<const D: usize>(&mut self) -> f64
    where
        H: Held<D>,
    {
        let handle = self.held.handle(&self.x)[0];
        self.held.distance(handle)
    }

    /// Takes a command that is held from now on.
    fn hold(&mut self, t: f64, command: &[f64]) {
        let Self { system, scratch, driven, x, rooms: [rates, ..], .. } = self;
        let n_states = system.n_states();
        if system.steady_drive() {
            system.drive(scratch, t, &x[..n_states], command, &mut rates[..n_states]);
            driven.copy_from_slice(&scratch.drive);
        }
    }

    /// One step of the classical Runge-Kutta scheme, under the command that was held last.
    fn step<const D: usize>(&mut self, t: f64, step: f64, command: &[f64], touched: Option<f64>)
    where
        H: Held<D>,
    {
        let Self { system, hand, held, scratch, external, driven, x, rooms: [stage, slope, sum] } = self;
        let (n_states, n) = (system.n_states(), system.n_free());
        let is_steady = system.steady_drive();
        // Two stages are at the same time.
        let mut last = (t, held.wanted(t, touched));
        let mut rate = |t: f64, x: &[f64], dx: &mut [f64]| {
            let (device, person) = x.split_at(n_states);
            let (d_device, d_person) = dx.split_at_mut(n_states);
            let handle = held.handle(device);
            if last.0 != t {
                last = (t, held.wanted(t, touched));
            }
            let grip = hand.rates(handle, &last.1, person, d_person);
            held.torques(device, grip, external);
            if is_steady {
                for ((drive, driven), external) in scratch.drive.iter_mut().zip(&*driven).zip(&*external) {
                    *drive = driven + external;
                }
                system.motion(scratch, t, device, d_device);
            } else {
                system.derivative_under(scratch, t, device, command, external, d_device);
            }
            let power = external.iter().zip(&device[n..2 * n]).map(|(torque, speed)| torque * speed);
            d_person[Hand::n_states(D)] = power.sum();
        };
        simulate::runge_kutta(&mut rate, t, step, [x, stage, slope, sum]);
    }
}

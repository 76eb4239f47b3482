//! Virtual walls: what a joint, or a point of the device, feels below position 0.
//!
//! Signs are those of the thesis: the wall's surface is at 0 and its inside below; a law's output `u` is negative where it
//! pushes out, and the torque on the joint is `-scale u`.

use std::collections::VecDeque;

use super::rules::{LinearLaw, RuleTable};

/// How the wall resists.
#[derive(Debug, Clone, PartialEq)]
pub enum Law {
    /// A spring and a damper (thesis section 5.3).
    Linear(LinearLaw),
    /// A fuzzy associative memory (section 5.5).
    Rules(RuleTable),
    /// A tool of its own touches the wall; the device is coupled to it by a spring and a damper (Colgate, Stanley & Brown
    /// 1995).
    Coupled(VirtualTool),
    /// A spring that gives back less than it took: an elastic-plastic element stands beside it (after Goldfarb & Wang 1999).
    Leaky {
        /// Spring and damper.
        linear: LinearLaw,
        /// The element's stiffness over the spring's.
        stiffness: f64,
        /// The largest share of the spring's output that the element adds or takes away.
        share: f64,
    },
}

/// The tool of a virtual coupling, in units of the law's output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VirtualTool {
    /// Its inertia.
    pub inertia: f64,
    /// Stiffness of the wall that it touches.
    pub wall_stiffness: f64,
    /// Damping of that wall.
    pub wall_damping: f64,
    /// Stiffness of the coupling.
    pub stiffness: f64,
    /// Damping of the coupling.
    pub damping: f64,
}

/// A wall at work.
#[derive(Debug, Clone)]
pub struct Wall {
    law: Law,
    scale: f64,
    sample_s: f64,
    limit: f64,
    /// The passivity controller, if one watches it.
    watch: Option<Watch>,
    state: State,
}

/// Why no wall could be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WallError {
    /// A number that must be positive.
    #[error("the wall's {what} is {value}: give a positive number")]
    NotPositive {
        /// Which.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A number of the law that it cannot work with.
    #[error("the wall's {what} is {value}: give a number from 0")]
    Negative {
        /// Which.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A leak that would take away more than the spring gives.
    #[error("the leak's share is {value}: give a number up to 1, for with more the wall pulls inwards on the way out")]
    Share {
        /// The share.
        value: f64,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct State {
    /// Position and velocity of the tool; it starts where the device does.
    tool: Option<[f64; 2]>,
    /// Output of the elastic-plastic element.
    element: f64,
    last_position: f64,
    inside: bool,
}

/// Time-domain passivity observer and controller (Hannaford & Ryu 2002).
#[derive(Debug, Clone)]
struct Watch {
    /// Torques that were answered and have not been booked: the first acted over the interval that ends now, the others act
    /// one after the other from now on.
    underway: VecDeque<f64>,
    /// Where the joint was at the last tick; `None` where its sensors showed no number, or there was none.
    last_position: Option<f64>,
    /// What the wall has taken up, less what it gave out (J).
    energy: f64,
}

impl Watch {
    /// Before the first tick, of a wall whose torques act `delay_samples` ticks after the position that they answer.
    fn new(delay_samples: usize) -> Self {
        Self { underway: VecDeque::from(vec![0.0; delay_samples + 1]), last_position: None, energy: 0.0 }
    }

    /// Books `-torque dq` of the interval that ends with this tick, and gives the torque that acts next: that of the law, and a
    /// damper where the wall would otherwise have given out more than it took by the end of the interval over which this
    /// torque acts, if the joint goes on as it moved from the last tick to this one. (A filtered velocity would be later still.)
    ///
    /// Outside, once no torque is underway, energy that was taken is forgotten, and energy that was given out is not: each
    /// contact has to be passive by itself.
    fn tick(&mut self, position: f64, limit: f64, torque: f64) -> f64 {
        let acted = self.underway.pop_front().unwrap_or(0.0);
        // Where the interval began is not known after a tick that was missed: what acted in it is not booked.
        let moved = self.last_position.map_or(0.0, |last| position - last);
        self.energy -= acted * moved;
        self.last_position = Some(position);
        if position >= 0.0 && self.underway.iter().all(|torque| *torque == 0.0) {
            self.energy = self.energy.min(0.0);
        }
        let expected = self.energy - (self.underway.iter().sum::<f64>() + torque) * moved;
        let mut answered = torque;
        if position < 0.0 && expected < 0.0 && moved != 0.0 {
            answered = (torque + expected / moved).clamp(-limit, limit);
        }
        // As long as it was before: room for one was just made.
        self.underway.push_back(answered);
        answered
    }

    /// A tick whose sensors show no number, and that is answered with nothing. What acts before it and after it, to the next tick
    /// with a number, is not booked.
    fn missed(&mut self) {
        self.last_position = None;
        let _ = self.underway.pop_front();
        self.underway.push_back(0.0);
    }
}

impl Wall {
    /// A wall that is asked every `sample_s`, with `scale` units of torque [N*m or N] for one of the law's output, and torques
    /// up to `limit`.
    ///
    /// # Errors
    /// A sample time, scale or limit that is not positive; a number of the law that is negative; a leak's share above 1.
    pub fn new(law: Law, scale: f64, sample_s: f64, limit: f64) -> Result<Self, WallError> {
        for (what, value) in [("scale", scale), ("sample time", sample_s), ("limit", limit)] {
            if value.is_nan() || value <= 0.0 {
                return Err(WallError::NotPositive { what, value });
            }
        }
        let own: &[(&'static str, f64)] = match &law {
            Law::Leaky { stiffness, share, .. } => &[("leak's stiffness", *stiffness), ("leak's share", *share)],
            Law::Coupled(tool) => &[
                ("tool's inertia", tool.inertia),
                ("tool's wall", tool.wall_stiffness),
                ("tool's wall damping", tool.wall_damping),
                ("coupling's stiffness", tool.stiffness),
                ("coupling's damping", tool.damping),
            ],
            Law::Linear(_) | Law::Rules(_) => &[],
        };
        if let Some(&(what, value)) = own.iter().find(|(_, value)| !(*value >= 0.0 && value.is_finite())) {
            return Err(WallError::Negative { what, value });
        }
        match law {
            Law::Leaky { share, .. } if share > 1.0 => return Err(WallError::Share { value: share }),
            _ => {}
        }
        Ok(Self { law, scale, sample_s, limit, watch: None, state: State::default() })
    }

    /// With a passivity observer that damps where the wall would give out more than it has taken (Hannaford & Ryu 2002), in a
    /// controller whose torques act `delay_samples` ticks after the position that they answer.
    #[must_use]
    pub fn passive(self, delay_samples: usize) -> Self {
        Self { watch: Some(Watch::new(delay_samples)), ..self }
    }

    /// What the passivity observer says that the wall has taken up, less what it gave out, up to the last tick (J); `None`
    /// where there is no observer. Exact for the positions that it was shown, if the drive delivers what is commanded.
    pub fn observed_energy(&self) -> Option<f64> {
        self.watch.as_ref().map(|watch| watch.energy)
    }

    /// Tells the wall that what it answered last will act as this torque, e.g. because other limits than its own shortened it:
    /// that is what its observer books.
    pub fn delivered(&mut self, torque: f64) {
        if let Some(newest) = self.watch.as_mut().and_then(|watch| watch.underway.back_mut()) {
            *newest = torque;
        }
    }

    /// The law.
    pub fn law(&self) -> &Law {
        &self.law
    }

    /// Torque for one unit of the law's output.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// The torque of a wall at rest at this position: what holds against a steady push. A leaky spring holds that, its element
    /// included, where the joint was pushed in from the surface; where it came back from deeper inside, less.
    pub fn static_torque(&self, position: f64) -> f64 {
        if position >= 0.0 {
            return 0.0;
        }
        let output = match &self.law {
            Law::Linear(law) => law.output(position, 0.0),
            Law::Leaky { linear, stiffness, share } => {
                linear.output(position, 0.0) + stiffness.min(*share) * linear.k1 * position
            }
            Law::Rules(table) => table.output(position, 0.0),
            Law::Coupled(tool) => {
                position * tool.stiffness * tool.wall_stiffness / (tool.stiffness + tool.wall_stiffness)
            }
        };
        (-self.scale * output).clamp(-self.limit, self.limit)
    }

    /// The torque from this tick to the next; none where the sensors show no number.
    pub fn tick(&mut self, position: f64, velocity: f64) -> f64 {
        if !(position.is_finite() && velocity.is_finite()) {
            if let Some(watch) = &mut self.watch {
                watch.missed();
            }
            return 0.0;
        }
        let inside = position < 0.0;
        let state = &mut self.state;
        if inside && !state.inside {
            state.element = 0.0;
        }
        let entered_at = if state.inside { state.last_position } else { 0.0 };
        let output = match &self.law {
            Law::Coupled(tool) => {
                let own = state.tool.get_or_insert([position, velocity]);
                tool.tick(position, velocity, self.sample_s, own)
            }
            _ if !inside => 0.0,
            Law::Linear(law) => law.output(position, velocity),
            Law::Rules(table) => table.output(position, velocity),
            Law::Leaky { linear, stiffness, share } => {
                let spring = linear.k1 * position;
                let most = share * spring.abs();
                let moved = stiffness * linear.k1 * (position - entered_at);
                state.element = (state.element + moved).clamp(-most, most);
                linear.output(position, velocity) + state.element
            }
        };
        let mut torque = (-self.scale * output).clamp(-self.limit, self.limit);
        if let Some(watch) = &mut self.watch {
            torque = watch.tick(position, self.limit, torque);
        }
        self.state.inside = inside;
        self.state.last_position = position;
        torque
    }
}

impl VirtualTool {
    /// Moves the tool by one step of the implicit Euler scheme and gives the coupling's output on the device. The tool
    /// touches the wall where it would end up inside.
    fn tick(&self, position: f64, velocity: f64, step: f64, tool: &mut [f64; 2]) -> f64 {
        let Self { inertia, stiffness, damping, .. } = *self;
        let moved = |wall_stiffness: f64, wall_damping: f64| {
            let pull = stiffness * (position - tool[0]) + damping * velocity - wall_stiffness * tool[0];
            let resists = inertia / step + damping + wall_damping + step * (stiffness + wall_stiffness);
            (inertia / step * tool[1] + pull) / resists
        };
        let free = moved(0.0, 0.0);
        let rate = if tool[0] + step * free < 0.0 { moved(self.wall_stiffness, self.wall_damping) } else { free };
        *tool = [tool[0] + step * rate, rate];
        stiffness * (position - tool[0]) + damping * (velocity - tool[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pressed(law: Law, depth: f64) -> f64 {
        let mut wall = Wall::new(law, 0.5, 0.001, 100.0).expect("a wall");
        (0..20_000).map(|_| wall.tick(-depth, 0.0)).last().expect("ticks")
    }

    #[test]
    fn a_pressed_wall_holds_as_its_springs_do() {
        let spring = LinearLaw { k1: 100.0, k2: 1.0, offset: 0.0 };
        assert_eq!(pressed(Law::Linear(spring), 0.02), 1.0);
        let tool =
            VirtualTool { inertia: 0.1, wall_stiffness: 300.0, wall_damping: 5.0, stiffness: 100.0, damping: 2.0 };
        // two springs in series: 75
        assert!((pressed(Law::Coupled(tool), 0.02) - 0.75).abs() < 1e-6, "{}", pressed(Law::Coupled(tool), 0.02));
        let leaky = |stiffness, share| Law::Leaky { linear: spring, stiffness, share };
        for law in [Law::Linear(spring), Law::Coupled(tool), leaky(0.1, 0.3), leaky(2.0, 0.3)] {
            let wall = Wall::new(law.clone(), 0.5, 0.001, 100.0).expect("a wall");
            assert!((wall.static_torque(-0.02) - pressed(law, 0.02)).abs() < 1e-6);
            assert_eq!(wall.static_torque(0.001), 0.0);
        }
    }

    /// Energy that the wall gives out over slow cycles into it and out, and what its observer says of that [J]. Torques act
    /// `delay` ticks late.
    fn given(law: Law, watched: bool, delay: usize) -> (f64, Option<f64>) {
        let mut wall = Wall::new(law, 0.5, 0.001, 100.0).expect("a wall");
        if watched {
            wall = wall.passive(delay);
        }
        let place = |k: i32| 0.01 * (f64::from(k) * 0.002 * std::f64::consts::PI).cos();
        let mut torques = VecDeque::from(vec![0.0; delay]);
        let mut given = 0.0;
        // Eight times into the wall and out of it, and on until no torque is underway.
        for k in 1..8020 {
            torques.push_back(wall.tick(place(k), (place(k) - place(k - 1)) / 0.001));
            given += torques.pop_front().expect("pushed") * (place(k + 1) - place(k));
        }
        (given, wall.observed_energy())
    }

    #[test]
    fn a_leaky_spring_keeps_energy_and_a_sampled_one_gives_some() {
        let spring = LinearLaw { k1: 100.0, k2: 0.0, offset: 0.0 };
        let (leaky, _) = given(Law::Leaky { linear: spring, stiffness: 2.0, share: 0.3 }, false, 0);
        assert!(leaky < -1e-4, "{leaky}");
        for delay in [0, 1, 3] {
            let (sampled, unseen) = given(Law::Linear(spring), false, delay);
            assert!(sampled > 0.0 && unseen.is_none(), "a spring that is asked late gives energy out: {sampled}");
            let (watched, _) = given(Law::Linear(spring), true, delay);
            assert!(watched < 0.1 * sampled, "{delay} late: {watched} of {sampled}");
        }
    }

    /// What was given out in a contact stays booked; the energy of the one contact is that of the torques that acted.
    #[test]
    fn the_observer_books_torques_when_they_act() {
        let law = LinearLaw { k1: 100.0, k2: 0.3, offset: 0.0 };
        for delay in [0, 1, 4] {
            let mut wall = Wall::new(Law::Linear(law), 0.5, 0.001, 100.0).expect("a wall").passive(delay);
            let place = |k: i32| 0.01 * (f64::from(k) * 0.003).cos();
            let mut torques = VecDeque::from(vec![0.0; delay]);
            let (mut taken, mut most) = (0.0, 0.0_f64);
            for k in 1..1570 {
                torques.push_back(wall.tick(place(k), (place(k) - place(k - 1)) / 0.001));
                let observed = wall.observed_energy().expect("it is watched");
                assert!((observed - taken).abs() < 1e-15, "{delay} late, tick {k}: {observed} for {taken}");
                taken -= torques.pop_front().expect("pushed") * (place(k + 1) - place(k));
                most = most.max(taken);
            }
            // Half the stiffness times the square of the depth, nearly: torques come late.
            assert!((0.0024..0.0026).contains(&most) && taken > -1e-6, "{most}, {taken} at the end");
        }
    }

    #[test]
    fn a_coupled_tool_follows_freely_and_meets_the_wall_without_a_jump() {
        let tool =
            VirtualTool { inertia: 1e-3, wall_stiffness: 300.0, wall_damping: 5.0, stiffness: 100.0, damping: 2.0 };
        let mut wall = Wall::new(Law::Coupled(tool), 0.03, 0.001, 1.0).expect("a wall");
        assert!((0..50).all(|_| wall.tick(0.4, 0.0) == 0.0), "at rest outside there is nothing");
        let path = |k: i32| 0.01 * (0.01 * f64::from(k)).cos();
        let torques: Vec<f64> = (0..2000).map(|k| wall.tick(path(k), (path(k) - path(k - 1)) / 0.001)).collect();
        let jump = torques.windows(2).skip(60).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        let most = torques.iter().skip(60).fold(0.0_f64, |most, torque| most.max(torque.abs()));
        assert!(most > 0.01 && jump < 0.2 * most, "{jump} of {most}");
    }

    #[test]
    fn what_is_no_number_is_answered_with_nothing() {
        let spring = LinearLaw { k1: 100.0, k2: 1.0, offset: 0.0 };
        let mut wall = Wall::new(Law::Linear(spring), 0.5, 0.001, 100.0).expect("a wall");
        assert_eq!((wall.tick(f64::NAN, 0.0), wall.tick(-0.01, f64::INFINITY)), (0.0, 0.0));
        for (share, is_fine) in [(-0.1, false), (0.0, true), (1.0, true), (1.001, false), (f64::NAN, false)] {
            let wall = Wall::new(Law::Leaky { linear: spring, stiffness: 1.0, share }, 0.5, 0.001, 1.0);
            assert_eq!(wall.is_ok(), is_fine, "{share}");
        }
    }

    /// Of two intervals nobody knows how far the joint moved in each; all others are booked as without them.
    #[test]
    fn a_tick_without_a_number_is_a_gap_in_the_books() {
        const MISSED: i32 = 400;
        let law = LinearLaw { k1: 100.0, k2: 0.3, offset: 0.0 };
        for delay in [0, 1, 4] {
            let mut wall = Wall::new(Law::Linear(law), 0.5, 0.001, 100.0).expect("a wall").passive(delay);
            let place = |k: i32| 0.01 * (f64::from(k) * 0.003).cos();
            let mut torques = VecDeque::from(vec![0.0; delay]);
            let mut taken = 0.0;
            for k in 1..700 {
                let shown = if k == MISSED { f64::NAN } else { place(k) };
                torques.push_back(wall.tick(shown, (place(k) - place(k - 1)) / 0.001));
                let observed = wall.observed_energy().expect("it is watched");
                // What no tick has booked yet of the interval that was missed is no fault.
                assert!(k == MISSED || (observed - taken).abs() < 1e-15, "{delay} late, {k}: {observed} for {taken}");
                let acts = torques.pop_front().expect("pushed");
                if ![MISSED - 1, MISSED].contains(&k) {
                    taken -= acts * (place(k + 1) - place(k));
                }
            }
            assert!(taken > 1e-4, "{taken}");
        }
    }

    #[test]
    fn outside_there_is_nothing() {
        let law = LinearLaw { k1: 100.0, k2: 100.0, offset: 0.0 };
        let mut wall = Wall::new(Law::Linear(law), 0.03, 0.01, 1.0).expect("a wall");
        assert_eq!(wall.tick(0.001, -3.0), 0.0);
        assert_eq!(wall.tick(-0.001, -3.0), 1.0, "the limit");
        assert!(Wall::new(Law::Linear(law), 0.0, 0.01, 1.0).is_err());
    }
}

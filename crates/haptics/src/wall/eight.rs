//! Encounters at a joint that do not depend on each other, eight at a time: each to the bits that it has alone.
//!
//! The controllers and what the arms want are computed one after the other, device and hands side by side.

use dynid_control::Wall;
use dynid_dynamics::{simulate, system::EightSystems, system::System};
use dynid_generated::{Eight, Lanewise, Scalar};
use rayon::prelude::*;

use super::{
    Approach, Contact, Hand, Setting, WallError,
    contact::{Controller, Plant, encounter, played},
    encounter::Sampled,
    hand::{Plan, Wanted, grip},
};

/// One encounter.
#[derive(Clone, Copy)]
pub(super) struct Meeting<'a> {
    pub(super) plant: &'a Plant,
    pub(super) wall: &'a Wall,
    pub(super) hand: &'a Hand,
    pub(super) approach: &'a Approach,
}

/// Plays all, and answers in their order.
pub(super) fn all_played(setting: &Setting, meetings: &[Meeting<'_>]) -> Vec<Result<Contact, WallError>> {
    let of_some = |some: &[Meeting<'_>]| {
        let last = some[some.len() - 1];
        let eight = std::array::from_fn(|lane| *some.get(lane).unwrap_or(&last));
        // One alone does not need lanes; late commands are refused either way.
        match EightSystems::new(eight.map(|meeting| &meeting.plant.system)).filter(|_| some.len() > 1) {
            Some(systems) => played_together(setting, eight, systems, some.len()),
            None => {
                let alone = |meeting: &Meeting<'_>| {
                    played(meeting.plant, setting, meeting.wall, meeting.hand, meeting.approach)
                };
                some.iter().map(alone).collect()
            }
        }
    };
    meetings.par_chunks(8).flat_map_iter(of_some).collect()
}

/// What is one encounter's own.
struct Lane<'a> {
    sampled: Sampled<'a>,
    controller: Controller,
    plan: Plan,
    reported: Contact,
    /// How it ended.
    end: Option<Result<(), WallError>>,
}

/// The first `count` of eight encounters.
fn played_together(
    setting: &Setting,
    meetings: [Meeting<'_>; 8],
    mut systems: EightSystems<'_>,
    count: usize,
) -> Vec<Result<Contact, WallError>> {
    let system = systems.systems()[0];
    let first = vec![0.0; system.n_joints() + 1];
    let lanes = meetings[..count].iter().map(|&Meeting { plant, wall, hand, approach }| {
        let plan = Plan::new(setting.start, &setting.reaching(), approach);
        Ok(Lane {
            sampled: Sampled::new(&encounter(plant, setting, hand, &plan, &first))?,
            controller: Controller::new(plant, setting, wall),
            plan,
            reported: Contact::begun(setting.sample_s),
            end: None,
        })
    });
    let mut lanes: Vec<Lane<'_>> = match lanes.collect::<Result<_, WallError>>() {
        Ok(lanes) => lanes,
        Err(error) => return vec![Err(error); count],
    };
    let (n_states, n_joints) = (system.n_states(), system.n_joints());
    let hands = meetings.map(|meeting| meeting.hand.numbers());
    let hands = std::array::from_fn(|number| hands.map(|hand| hand[number]));
    let starts = systems.systems().map(|system| start(system, setting));
    let mut x: Vec<f64> = (0..starts[0].len()).flat_map(|row| starts.each_ref().map(|start| start[row])).collect();
    let mut rooms = [x.clone(), x.clone(), x.clone()];
    let mut command = vec![[0.0; 8]; n_joints];
    let mut device = vec![0.0; n_states];
    let sampling = setting.sampling();
    let (substeps, step) = sampling.steps();
    for tick in 0.. {
        let t = tick as f64 * sampling.sample_s;
        for (place, lane) in lanes.iter_mut().enumerate().filter(|(_, lane)| lane.end.is_none()) {
            device.iter_mut().zip(x.as_chunks().0).for_each(|(own, row): (_, &Eight)| *own = row[place]);
            let Lane { sampled, controller, reported, end, .. } = lane;
            // Nobody asks for the hand's work.
            let goes_on = sampled.goes_on(
                tick,
                &device,
                (device[0], 0.0),
                &mut |shown, answer| controller.answer(shown, answer),
                &mut |tick| reported.take(tick, n_joints),
            );
            *end = match goes_on {
                Ok(true) => None,
                Ok(false) => Some(Ok(())),
                Err(error) => Some(Err(error)),
            };
            command.iter_mut().zip(sampled.acting()).for_each(|(row, acting)| row[place] = *acting);
        }
        if lanes.iter().all(|lane| lane.end.is_some()) {
            break;
        }
        if system.steady_drive() {
            let (device, rates) = (&x.as_chunks().0[..n_states], &mut rooms[0].as_chunks_mut().0[..n_states]);
            systems.drive([t; 8], device, &command, rates);
        }
        for k in 0..substeps {
            let now = t + k as f64 * step;
            for (place, lane) in lanes.iter_mut().enumerate() {
                if lane.sampled.touched_s.is_none() && x[place] < 0.0 {
                    lane.sampled.touched_s = Some(now);
                }
            }
            let mut last = (now, wanted(&lanes, now));
            let rate = |t: f64, x: &[f64], dx: &mut [f64]| {
                // Two stages are at the same time.
                if last.0 != t {
                    last = (t, wanted(&lanes, t));
                }
                rates(&mut systems, t, x, (&command, &hands, &last.1), dx);
            };
            let [stage, slope, sum] = &mut rooms;
            simulate::runge_kutta(rate, now, step, [&mut x, stage, slope, sum]);
        }
    }
    let ended = lanes.into_iter().map(|Lane { mut reported, sampled, end, .. }| {
        end.unwrap_or(Ok(()))?;
        reported.touched = sampled.touched;
        Ok(reported)
    });
    ended.collect()
}

/// State of a device and of the hand that rests with it.
fn start(system: &System, setting: &Setting) -> Vec<f64> {
    let mut x = system.rest(&[setting.start]);
    x.extend(Hand::rest([setting.start]));
    x
}

/// What the arms want: position, velocity and hold of each.
fn wanted(lanes: &[Lane<'_>], t: f64) -> [Eight; 3] {
    let mut wanted = [[0.0; 8]; 3];
    for (place, lane) in lanes.iter().enumerate() {
        let Wanted { position: [position], velocity: [velocity], hold: [hold] } =
            lane.plan.at(t, lane.sampled.touched_s);
        wanted.iter_mut().zip([position, velocity, hold]).for_each(|(row, value)| row[place] = value);
    }
    wanted
}

/// Rates of devices and hands.
fn rates(
    systems: &mut EightSystems<'_>,
    t: f64,
    x: &[f64],
    (command, hands, wanted): (&[Eight], &[Eight; 7], &[Eight; 3]),
    dx: &mut [f64],
) {
    let n_states = systems.systems()[0].n_states();
    let (device, person) = x.as_chunks().0.split_at(n_states);
    let (d_device, d_person) = dx.as_chunks_mut().0.split_at_mut(n_states);
    let mut given = [[0.0; 8]; 15];
    given[..7].copy_from_slice(hands);
    given[7..9].copy_from_slice(&device[..2]);
    given[9..12].copy_from_slice(wanted);
    given[12..].copy_from_slice(person);
    let mut results = [[0.0; 8]; 4];
    systems.width().of_eight(&Grip, &given, &mut results);
    let [external, of_hand @ ..] = results;
    d_person.copy_from_slice(&of_hand);
    if !systems.systems()[0].steady_drive() {
        systems.drive([t; 8], device, command, d_device);
    }
    systems.motion([t; 8], device, &[external], d_device);
}

/// A hand's numbers, position and velocity of the joint, what the arm wants and the hand's state, to the torque of the grip and the rates
/// of that state.
struct Grip;

impl Lanewise<15, 4> for Grip {
    #[inline(always)]
    fn of<S: Scalar>(&self, given: &[S; 15]) -> [S; 4] {
        let [i, k, d, ak, ad, tightening, shakes, q, dq, position, velocity, hold, place, speed, shaken] = *given;
        let mut rates = [S::constant(0.0); 3];
        let numbers = [i, k, d, ak, ad, tightening, shakes];
        let wanted = [&[position], &[velocity], &[hold]];
        let [torque] = grip(&numbers, [[q], [dq]], wanted, &[place, speed, shaken], &mut rates);
        let [of_place, of_speed, of_shakes] = rates;
        [torque, of_place, of_speed, of_shakes]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wall::shipped;
    use dynid_user_model::Model;

    /// Of several walls, hands and approaches, on devices that differ; more than eight, and one left over.
    #[test]
    fn together_they_have_the_bits_of_each_alone() {
        let setting = Setting::shipped().expect("shipped");
        let model = Model::of_device(setting.device);
        let plant = |factor: f64| Plant::new(&model, &setting).expect("a plant").delivering(factor);
        let plants = [plant(1.0), plant(1.2)];
        let walls = ["pd", "fuzzy", "coupled", "leaky"]
            .map(|name| shipped(name).expect("shipped").wall(&setting).expect("a wall"));
        let hands = setting.hand.population(setting.spread, 17, 3);
        let meetings: Vec<Meeting<'_>> = hands
            .iter()
            .enumerate()
            .map(|(k, hand)| Meeting {
                plant: &plants[k % 2],
                wall: &walls[k % walls.len()],
                hand,
                approach: &setting.approaches[k % setting.approaches.len()],
            })
            .collect();
        let together = all_played(&setting, &meetings);
        assert_eq!(together.len(), meetings.len());
        for (together, Meeting { plant, wall, hand, approach }) in together.into_iter().zip(meetings) {
            let alone = played(plant, &setting, wall, hand, approach).expect("a contact");
            assert!(alone.touched.is_some() && together.expect("a contact") == alone);
        }
    }
}

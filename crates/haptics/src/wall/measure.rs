//! How still and how solid a wall felt.

use serde::Serialize;

use super::{Approach, Contact, Setting, hand::Plan};
use dynid_control::{Law, Wall};
use dynid_signal::Lowpass;

/// How still and how solid a wall felt.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Measures {
    /// Root mean square of the position from [`FROM_S`] to [`TO_S`] after the contact, without what lies below
    /// [`SLOWEST_HZ`] (zero-phase Butterworth high-pass of second order over the whole contact) [rad or m]. A little of the
    /// approach leaks into it ([`chatter_floor`]), and so does the way in which the handle comes to rest: at the fastest approach
    /// of the shipped setting a wall of the tuned ones' stiffness and damping shows about 0.2 mrad in the median, also where it is
    /// asked at once, exactly and every millisecond, and does not chatter at all.
    pub chatter_rms: f64,
    /// Largest less smallest of the same [rad or m].
    pub peak_to_peak: f64,
    /// Its frequency, by its changes of sign (Hz).
    pub frequency: f64,
    /// Mean position of the last [`SETTLED_S`] [rad or m].
    pub settled_position: f64,
    /// What the wall holds against a steady push there, over how deep it is [N*m/rad or N/m]; 0 outside. A leaky
    /// wall holds more pushed in than let out: of it this is the mean torque of the last [`SETTLED_S`], over that depth.
    pub stiffness: f64,
    /// The most that the wall has given out, net of what it took, at any time since the contact (J; the passivity observer of
    /// Hannaford & Ryu 2002). Torques are held from tick to tick, so that it is exact where the drive delivers them: a drive
    /// with a dead zone, a limit or a lag delivers less, or later.
    pub energy_out: f64,
    /// Share of the time from [`FROM_S`] to [`TO_S`] after the contact outside of the wall.
    pub outside: f64,
}

/// Begin of the time that counts, after the contact (s).
pub const FROM_S: f64 = 0.6;
/// Its end (s).
pub const TO_S: f64 = 2.1;
/// What is slower is no chatter (Hz).
pub const SLOWEST_HZ: f64 = 2.0;
/// How long the end is in which the position has settled (s).
pub const SETTLED_S: f64 = 0.5;

impl Measures {
    /// Of a contact with `wall`; `None` where the wall was never met.
    pub fn of(contact: &Contact, wall: &Wall) -> Option<Self> {
        let Contact { position, torque, .. } = contact;
        // The torque is held from tick to tick: what it gives out is exact.
        let given = |tick: usize| torque[tick] * (position[tick + 1] - position[tick]);
        Self::along(contact, wall, 1.0, given)
    }

    /// Of a contact with a wall that is asked as if it were a joint's with its handle at this `lever`, and that gives out
    /// `given(tick)` from a tick to the next.
    pub(super) fn along(contact: &Contact, wall: &Wall, lever: f64, given: impl Fn(usize) -> f64) -> Option<Self> {
        let touched = contact.touched?;
        let position = &contact.position;
        let (from, to) = counted(contact, touched);
        let fast = fast(contact, touched)?;
        let count = fast.len().max(1) as f64;
        let largest = fast.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let smallest = fast.iter().copied().fold(f64::INFINITY, f64::min);
        let turns = fast.windows(2).filter(|pair| (pair[0] < 0.0) != (pair[1] < 0.0)).count() as f64;
        let settled_position = mean(settled(position, contact.sample_s));
        let held = match wall.law() {
            // What it holds at a depth depends on how it came there.
            Law::Leaky { .. } => mean(settled(&contact.torque, contact.sample_s)),
            Law::Linear(_) | Law::Rules(_) | Law::Coupled(_) => wall.static_torque(settled_position / lever) / lever,
        };
        let stiffness = if settled_position < 0.0 { held / -settled_position } else { 0.0 };
        let (mut out, mut energy_out) = (0.0, 0.0_f64);
        for tick in touched..position.len().saturating_sub(1) {
            out += given(tick);
            energy_out = energy_out.max(out);
        }
        Some(Self {
            chatter_rms: root_mean_square(&fast),
            peak_to_peak: if fast.is_empty() { 0.0 } else { largest - smallest },
            frequency: turns / (2.0 * count * contact.sample_s),
            settled_position,
            stiffness,
            energy_out,
            outside: position[from..to].iter().filter(|position| **position >= 0.0).count() as f64 / count,
        })
    }
}

/// What there is of the last [`SETTLED_S`].
fn settled(values: &[f64], sample_s: f64) -> &[f64] {
    let last = (SETTLED_S / sample_s).round() as usize;
    &values[values.len().saturating_sub(last.max(1))..]
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// The ticks from [`FROM_S`] to [`TO_S`] after the contact.
fn counted(contact: &Contact, touched: usize) -> (usize, usize) {
    let tick = |after_s: f64| (touched + (after_s / contact.sample_s).round() as usize).min(contact.position.len());
    (tick(FROM_S), tick(TO_S))
}

/// What is faster than [`SLOWEST_HZ`], of the ticks that count.
fn fast(contact: &Contact, touched: usize) -> Option<Vec<f64>> {
    let (from, to) = counted(contact, touched);
    let slow = Lowpass::second_order(SLOWEST_HZ, 1.0 / contact.sample_s)?.apply(&contact.position);
    Some(contact.position[from..to].iter().zip(&slow[from..to]).map(|(all, slow)| all - slow).collect())
}

fn root_mean_square(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// The chatter that is measured where there is none: the arm comes as it planned, and a wall stops it dead at its surface
/// [rad or m]. What the high-pass leaves of such an approach is a floor under all that is measured.
pub fn chatter_floor(setting: &Setting, approach: &Approach) -> f64 {
    let plan = Plan::new(setting.start, &setting.reaching(), approach);
    let sample_s = setting.sample_s;
    let ticks = ((plan.duration_s() + setting.after_s) / sample_s).ceil() as usize;
    let planned = (0..=ticks).map(|tick| plan.at(tick as f64 * sample_s, None).position[0]);
    let touched = planned.clone().position(|position| position < 0.0).unwrap_or(0);
    let after = (setting.after_s / sample_s).round() as usize;
    let position: Vec<f64> = planned.map(|position| position.max(0.0)).take(touched + after + 1).collect();
    let contact = Contact { sample_s, velocity: Vec::new(), torque: Vec::new(), touched: Some(touched), position };
    fast(&contact, touched).map_or(0.0, |fast| root_mean_square(&fast))
}

/// The damping that the device must have of its own for a sampled spring and damper to be passive whoever touches it:
/// `b > K T / 2 + B` (Colgate & Schenkel 1997), for a wall of that stiffness and damping asked every `sample_s`.
pub fn stability_bound(stiffness: f64, damping: f64, sample_s: f64) -> f64 {
    0.5 * stiffness * sample_s + damping.abs()
}

/// The same of a wall that is such a spring and damper, at work as it is; `None` where it is another law or is watched, which
/// the bound says nothing of.
pub fn passive_above(wall: &Wall, sample_s: f64) -> Option<f64> {
    match wall.law() {
        Law::Linear(law) if wall.observed_energy().is_none() => {
            Some(stability_bound(wall.scale() * law.k1, wall.scale() * law.k2, sample_s))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use dynid_control::LinearLaw;

    fn wall() -> Wall {
        let law = LinearLaw { k1: 100.0, k2: 0.0, offset: 0.0 };
        Wall::new(Law::Linear(law), 0.03, 0.01, 1.0).expect("a wall")
    }

    #[test]
    fn a_sine_about_a_depth_is_measured_as_what_it_is() {
        let position: Vec<f64> = (0..400).map(|k| -0.03 + 0.01 * (TAU * 8.0 * f64::from(k) * 0.01).sin()).collect();
        let contact =
            Contact { sample_s: 0.01, velocity: vec![0.0; 400], torque: vec![0.0; 400], touched: Some(50), position };
        let reported = Measures::of(&contact, &wall()).expect("a contact");
        // forwards and backwards the gain at 8 Hz is (f/fc)^4 / (1 + (f/fc)^4), prewarped
        let ratio = ((0.08 * std::f64::consts::PI).tan() / (0.02 * std::f64::consts::PI).tan()).powi(4);
        let gain = ratio / (1.0 + ratio);
        assert!((reported.chatter_rms - gain * 0.01 / 2.0_f64.sqrt()).abs() < 2e-5, "{}", reported.chatter_rms);
        assert!((reported.frequency - 8.0).abs() < 0.5, "{}", reported.frequency);
        assert!((reported.settled_position + 0.03).abs() < 1e-4 && reported.outside == 0.0);
        assert!((reported.stiffness - 3.0).abs() < 1e-12, "{}", reported.stiffness);
    }

    /// Pushed in to a depth it holds more than let out to the same, and the measure tells either.
    #[test]
    fn a_leaky_wall_is_as_stiff_as_what_it_held() {
        let linear = LinearLaw { k1: 100.0, k2: 0.0, offset: 0.0 };
        let stiffness = |deepest: f64| {
            let mut wall =
                Wall::new(Law::Leaky { linear, stiffness: 2.0, share: 0.3 }, 0.03, 0.01, 10.0).expect("a wall");
            let asked = wall.clone();
            // In within a second, and back to 0.02 within another, where it stays.
            let position: Vec<f64> = (0..400)
                .map(|k| 0.01 * f64::from(k))
                .map(|t| if t < 1.0 { -deepest * t } else { (-deepest + (t - 1.0)).min(-0.02) })
                .collect();
            let torque = position.iter().map(|position| wall.tick(*position, 0.0)).collect();
            let contact = Contact { sample_s: 0.01, velocity: vec![0.0; 400], torque, touched: Some(0), position };
            Measures::of(&contact, &asked).expect("a contact").stiffness
        };
        let (pushed, let_out) = (stiffness(0.02), stiffness(0.1));
        assert!((pushed - 3.0 * 1.3).abs() < 1e-9 && (let_out - 3.0 * 0.7).abs() < 1e-9, "{pushed} {let_out}");
    }

    #[test]
    fn what_a_wall_gives_out_is_the_most_at_any_time() {
        let contact = Contact {
            sample_s: 0.01,
            position: vec![0.1, -0.1, -0.2, 0.0, -0.1],
            velocity: vec![0.0; 5],
            torque: vec![0.0, 1.0, 2.0, 3.0, 0.0],
            touched: Some(1),
        };
        // takes 0.1, gives 0.4, takes 0.3: 0.3 J more was out than in
        let reported = Measures::of(&contact, &wall()).expect("a contact");
        assert!((reported.energy_out - 0.3).abs() < 1e-12, "{}", reported.energy_out);
    }

    #[test]
    fn a_dead_stop_leaves_less_than_a_tenth_of_a_thousandth() {
        let setting = Setting::shipped().expect("shipped");
        let floors: Vec<f64> = setting.approaches.iter().map(|approach| chatter_floor(&setting, approach)).collect();
        assert!(floors.windows(2).all(|pair| pair[0] < pair[1]), "more the faster: {floors:?}");
        assert!(floors[0] > 1e-5 && floors[2] < 1e-4, "{floors:?}");
    }

    /// Colgate & Schenkel's example of the limit: with no damping of the wall, b = K T / 2.
    #[test]
    fn the_bound_is_half_a_sample_of_stiffness_and_the_damping() {
        assert_eq!(stability_bound(1000.0, 0.0, 0.001), 0.5);
        assert_eq!(stability_bound(3.0, 3.0, 0.01), 3.015);
    }

    #[test]
    fn the_bound_is_reported_of_plain_springs_and_dampers_only() {
        let setting = Setting::shipped().expect("shipped");
        let bounded: Vec<&str> = crate::wall::library()
            .map(|(name, _)| name)
            .filter(|name| {
                let wall = crate::wall::shipped(name).expect("shipped").wall(&setting).expect("a wall");
                passive_above(&wall, setting.sample_s).is_some()
            })
            .collect();
        assert_eq!(bounded, ["pd", "pd_tuned"]);
    }
}

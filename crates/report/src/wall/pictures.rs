//! Pictures of walls; those of the thesis's chapter 5 are named by their numbers there.

use std::fmt::Write;

use super::{Shown, WallReport, densest, listed, milli, plain};
use crate::{
    plot::dots, plot::dots::Dots, plot::memberships, plot::memberships::Memberships, plot::surface,
    plot::surface::Surface, plot::traces, plot::traces::Trace, plot::traces::Traces,
};
use dynid_control::{Law, Partition};
use dynid_format::escaped;
use dynid_haptics::wall::Contact;

/// How much of a contact is shown, before and after the first touch (s).
const BEFORE_S: f64 = 0.1;
const AFTER_S: f64 = 2.4;
/// Columns and rows of a torque surface, beside those that it needs for its corners.
const FINE: usize = 40;

impl WallReport<'_> {
    pub(super) fn chatter(&self) -> String {
        let speeds: Vec<String> = self.setting.approaches.iter().map(|approach| approach.name.clone()).collect();
        let chatter = |name: &str, speed: &str| {
            self.of(name, Some(speed)).iter().map(|measures| 1e3 * measures.chatter_rms).collect::<Vec<f64>>()
        };
        let values =
            self.walls.iter().map(|own| speeds.iter().map(|speed| chatter(&own.name, speed)).collect()).collect();
        let dots = Dots {
            title: "Chatter: a dot for each hand".to_owned(),
            quantity: format!("chatter [{} RMS]", self.unit.small),
            groups: self.walls.iter().map(|own| own.name.clone()).collect(),
            kinds: speeds,
            values,
        };
        let floors: Vec<String> = self
            .setting
            .approaches
            .iter()
            .map(|approach| milli(dynid_haptics::wall::chatter_floor(self.setting, approach)))
            .collect();
        let names: Vec<&str> = self.setting.approaches.iter().map(|approach| approach.name.as_str()).collect();
        format!(
            "<figure>\n{}</figure>\n<p class=\"note\">The same hands in the same order at every wall. Chatter is what is left of \
             the position above {} Hz, from {} to {} s after the first touch. The filter sees the whole contact, so that a little \
             of the approach leaks into that: where a wall stops a {} approach dead, {} {} would be measured.</p>\n",
            dots::inline(&dots),
            dynid_haptics::wall::SLOWEST_HZ,
            dynid_haptics::wall::FROM_S,
            dynid_haptics::wall::TO_S,
            escaped(&listed(&names)),
            listed(&floors),
            self.unit.small
        )
    }

    /// Figures 5.10 to 5.12, with every wall.
    pub(super) fn approaches(&self) -> String {
        let up = self.seen(&self.walls.iter().flat_map(|own| &own.contacts).collect::<Vec<_>>());
        let mut html = String::new();
        for (index, approach) in self.setting.approaches.iter().enumerate() {
            let curves =
                self.walls.iter().map(|own| trace(own.name.clone(), &own.contacts[index])).collect::<Vec<Trace>>();
            let traces = Traces {
                title: format!("{} approach, {} {}", approach.name, plain(approach.peak), self.unit.velocity),
                along: "time since the first touch [s]".to_owned(),
                quantity: format!("position [{}]", self.unit.position),
                across: [-BEFORE_S, AFTER_S],
                up,
                curves,
                levels: vec![0.0],
            };
            let _ = writeln!(html, "<figure>\n{}</figure>", traces::inline(&traces));
        }
        let _ = writeln!(
            html,
            "<p class=\"note\">Figures 5.10 to 5.12 of the thesis: the joint's position, in all pictures on the same axes; the wall \
             is below 0. Buttons, arrow keys, + and \u{2212} zoom; so does the wheel after a click; drag to move.</p>"
        );
        html
    }

    /// Figure 5.13: the first wall, with where the handle settles.
    pub(super) fn settled(&self) -> String {
        let first = &self.walls[0];
        let up = self.seen(&first.contacts.iter().collect::<Vec<_>>());
        let mut html = String::new();
        for (approach, contact) in self.setting.approaches.iter().zip(&first.contacts) {
            let settled =
                dynid_haptics::wall::Measures::of(contact, &first.wall).map(|measures| measures.settled_position);
            let reported = settled.map_or_else(String::new, |settled| {
                format!(": settles at {} {}", super::milli(settled), self.unit.small)
            });
            let traces = Traces {
                title: format!(
                    "{}, {} approach ({} {}){reported}",
                    first.name,
                    approach.name,
                    plain(approach.peak),
                    self.unit.velocity
                ),
                along: "time since the first touch [s]".to_owned(),
                quantity: format!("position [{}]", self.unit.position),
                across: [-BEFORE_S, AFTER_S],
                up,
                curves: vec![trace(first.name.clone(), contact)],
                levels: settled.into_iter().collect(),
            };
            let _ = writeln!(html, "<figure>\n{}</figure>", traces::inline(&traces));
        }
        let _ = writeln!(
            html,
            "<p class=\"note\">Figure 5.13 of the thesis: <code>{}</code> under the typical hand, identically scaled; broken: the mean \
             position of the last {} s.</p>",
            escaped(&first.name),
            dynid_haptics::wall::SETTLED_S
        );
        html
    }

    pub(super) fn static_torque(&self) -> String {
        let depth = -1.4 * self.deepest();
        // Fine enough for the corners of a rule table to be where they are.
        let depths: Vec<f64> = (0..=400).map(|k| f64::from(k) / 400.0 * depth).collect();
        let curves: Vec<Trace> = self
            .walls
            .iter()
            .map(|own| Trace {
                name: own.name.clone(),
                along: depths.clone(),
                values: depths.iter().map(|depth| own.wall.static_torque(-depth)).collect(),
            })
            .collect();
        let holds: Vec<f64> =
            self.setting.approaches.iter().map(|approach| self.setting.hold_after(approach)).collect();
        // Beyond what a hand could reach by far, nothing has to be seen.
        let most = curves.iter().flat_map(|own| own.values.iter().copied()).fold(0.0, f64::max);
        let traces = Traces {
            title: "Torque of a wall at rest".to_owned(),
            along: format!("depth [{}]", self.unit.position),
            quantity: format!("torque [{}]", self.unit.torque),
            across: [0.0, depth],
            up: [0.0, holds.iter().copied().fold(most, f64::max)],
            curves,
            levels: holds,
        };
        format!(
            "<figure>\n{}</figure>\n<p class=\"note\">Broken: what the arm holds with \
             after each approach; its own stiffness carries a part of that.</p>\n",
            traces::inline(&traces)
        )
    }

    /// Figures 5.7 to 5.9: torques of every wall that depends on nothing else, and what rules change.
    pub(super) fn surfaces(&self) -> String {
        let memoryless: Vec<&Shown> = self
            .walls
            .iter()
            .filter(|own| !own.passive && matches!(own.wall.law(), Law::Linear(_) | Law::Rules(_)))
            .collect();
        let (x, y) = self.grid(&memoryless);
        let torque = |own: &Shown| -> Vec<f64> {
            let mut wall = own.wall.clone();
            y.iter().flat_map(|dq| x.iter().map(|q| wall.tick(*q, *dq)).collect::<Vec<f64>>()).collect()
        };
        let picture = |title: String, values: Vec<f64>| {
            surface::inline(&Surface {
                title,
                along: format!("position [{}]", self.unit.position),
                up: format!("velocity [{}]", self.unit.velocity),
                quantity: format!("torque [{}]", self.unit.torque),
                x: x.clone(),
                y: y.clone(),
                values,
            })
        };
        let mut html = String::new();
        for own in &memoryless {
            let _ = writeln!(html, "<figure>\n{}</figure>", picture(own.name.clone(), torque(own)));
        }
        let reference = &self.walls[0];
        if matches!(reference.wall.law(), Law::Linear(_)) && !reference.passive {
            let linear = torque(reference);
            for own in memoryless.iter().filter(|own| matches!(own.wall.law(), Law::Rules(_))) {
                let difference = torque(own).iter().zip(&linear).map(|(own, linear)| own - linear).collect();
                let title = format!("{} less {}", own.name, reference.name);
                let _ = writeln!(html, "<figure>\n{}</figure>", picture(title, difference));
            }
        }
        if html.is_empty() {
            return html;
        }
        format!(
            "<div class=\"pictures\">\n{html}</div>\n<p class=\"note\">Figures 5.7 to 5.9 of the thesis, as pictures of level lines: \
             the torque on the joint, within its limit of {} {}; positive pushes out. Every picture has colours of its own \
             scale.</p>\n",
            plain(self.setting.torque_limit),
            self.unit.torque
        )
    }

    /// Where torque surfaces are asked: evenly, and at every peak of a fuzzy set, and on both sides of the wall's surface.
    fn grid(&self, walls: &[&Shown]) -> (Vec<f64>, Vec<f64>) {
        let tables = || {
            walls.iter().filter_map(|own| match own.wall.law() {
                Law::Rules(table) => Some(table),
                _ => None,
            })
        };
        let deepest = 1.1 * self.deepest();
        let fastest = self.setting.approaches.iter().map(|approach| approach.peak).fold(0.0, f64::max);
        let mut across = [deepest, -0.1 * deepest];
        let mut up = [-fastest, fastest];
        for table in tables() {
            across = joined(across, densest(table.position()));
            up = joined(up, densest(table.velocity()));
        }
        let filled = |[from, to]: [f64; 2], more: Vec<f64>| {
            let mut places: Vec<f64> =
                (0..=FINE).map(|k| from + (to - from) * k as f64 / FINE as f64).chain(more).collect();
            places.retain(|place| (from..=to).contains(place));
            places.sort_by(f64::total_cmp);
            places.dedup();
            places
        };
        let mut corners: Vec<f64> = tables().flat_map(|table| table.position().peaks().to_vec()).collect();
        // Just inside and at the surface: there the torque jumps.
        corners.extend([1e-9 * deepest, 0.0]);
        let speeds = tables().flat_map(|table| table.velocity().peaks().to_vec()).collect();
        (filled(across, corners), filled(up, speeds))
    }

    /// Figures 5.3 to 5.5, once for walls that share their sets.
    pub(super) fn memberships(&self) -> String {
        let mut html = String::new();
        let inputs: [(&str, &str, PartitionOf); 2] = [
            ("position", self.unit.position, |table| table.position()),
            ("velocity", self.unit.velocity, |table| table.velocity()),
        ];
        for (input, unit, of) in inputs {
            let mut distinct: Vec<(&Partition, Vec<&str>)> = Vec::new();
            for own in &self.walls {
                let Law::Rules(table) = own.wall.law() else { continue };
                let sets = of(table);
                match distinct.iter_mut().find(|(known, _)| *known == sets) {
                    Some((_, names)) => names.push(&own.name),
                    None => distinct.push((sets, vec![&own.name])),
                }
            }
            for (sets, names) in distinct {
                let whole = [sets.peaks()[0], sets.peaks()[sets.len() - 1]];
                let dense = densest(sets);
                let mut ranges = vec![(whole, (dense != whole).then_some(dense))];
                // Where the names do not find room in the whole.
                if dense[1] - dense[0] < 0.2 * (whole[1] - whole[0]) {
                    ranges.push((dense, None));
                }
                for (range, shaded) in ranges {
                    let part = if range == whole { "" } else { ", the shaded part" };
                    let picture = Memberships {
                        title: format!("Sets of the {input}{part} ({})", names.join(", ")),
                        along: format!("{input} [{unit}]"),
                        sets,
                        range,
                        shaded,
                    };
                    let _ = writeln!(html, "<figure>\n{}</figure>", memberships::inline(&picture));
                }
            }
        }
        html.push_str(
            "<p class=\"note\">Figures 5.3 to 5.5 of the thesis: memberships add up to one everywhere. Shaded: where the sets stand \
             densest, the range of interest.</p>\n",
        );
        html
    }

    /// The range of positions that these contacts show since the first touch.
    fn seen(&self, contacts: &[&Contact]) -> [f64; 2] {
        let mut range = [0.0_f64, 0.0];
        for contact in contacts {
            let Some(touched) = contact.touched else { continue };
            let last = touched + (AFTER_S / contact.sample_s).round() as usize;
            for position in contact.position.iter().skip(touched).take(last - touched) {
                range = joined(range, [*position, *position]);
            }
        }
        range
    }
}

type PartitionOf = fn(&dynid_control::RuleTable) -> &Partition;

fn joined(one: [f64; 2], other: [f64; 2]) -> [f64; 2] {
    [one[0].min(other[0]), one[1].max(other[1])]
}

/// Position over the time since the first touch.
fn trace(name: String, contact: &Contact) -> Trace {
    let touched = contact.touched.unwrap_or(0) as f64;
    let along = (0..contact.position.len()).map(|tick| (tick as f64 - touched) * contact.sample_s);
    let shown = along.zip(&contact.position).filter(|(t, _)| (-BEFORE_S - 0.02..=AFTER_S + 0.02).contains(t));
    let (along, values) = shown.map(|(t, position)| (t, *position)).unzip();
    Trace { name, along, values }
}

//! A plane in space on a page: the way of the end point, how deep it is, and the torques of the joints.

use std::fmt::Write;

use dynid_model::JointKind;

use super::{Part, Section, number};
use crate::{plot::traces, plot::traces::Trace, plot::traces::Traces};
use dynid_control::{CompensationRatios, Wall};
use dynid_dynamics::{kinematics::Vector, kinematics::dot, kinematics::plus};
use dynid_format::escaped;
use dynid_haptics::{
    wall::WallError, wall::median, wall::space::Case, wall::space::Contact, wall::space::Setting, wall::space::contact,
};
use dynid_user_model::Model;

/// How much of a contact is shown, before and after the first touch (s).
const BEFORE_S: f64 = 0.3;
const AFTER_S: f64 = 2.4;

/// What a page tells of walls on a plane: the typical hand at each, and the measures of all hands.
#[derive(Debug)]
pub struct SpaceReport<'a> {
    setting: &'a Setting,
    cases: &'a [Case],
    carried: Option<CompensationRatios>,
    /// Name, and a contact for each approach.
    shown: Vec<(String, Vec<Contact>)>,
    /// The direction along the wall in which the end points slip most.
    along: Vector,
}

impl<'a> SpaceReport<'a> {
    /// Plays the typical hand against every wall.
    ///
    /// # Errors
    /// As [`contact`].
    pub fn new(
        model: &Model,
        setting: &'a Setting,
        walls: &[(String, Wall)],
        cases: &'a [Case],
        carried: Option<CompensationRatios>,
    ) -> Result<Self, WallError> {
        let hand = &setting.people.typical;
        let mut shown = Vec::with_capacity(walls.len());
        for (name, wall) in walls {
            let approaches = setting.reaching.approaches.iter();
            let contacts = approaches.map(|approach| {
                contact(model, setting, wall, (hand, approach), carried)
                    .map_err(|error| error.in_case(name, approach, None))
            });
            shown.push((name.clone(), contacts.collect::<Result<Vec<_>, _>>()?));
        }
        let along = main_direction(setting, &shown);
        Ok(Self { setting, cases, carried, shown, along })
    }

    /// The page's parts.
    pub fn sections(&self) -> Vec<Box<dyn Section>> {
        let parts = [
            Part { title: "What a hand feels", html: self.sentences() + &self.table() },
            Part { title: "The way of the end point, from the side", html: self.ways() },
            Part { title: "Depth", html: self.depths() },
            Part { title: "Torques of the joints", html: self.torques() },
        ];
        parts.into_iter().map(|part| Box::new(part) as Box<dyn Section>).collect()
    }

    fn of(&self, name: &str, value: impl Fn(&Case) -> f64) -> f64 {
        median(self.cases.iter().filter(|case| case.controller == name).map(value).collect())
    }

    fn sentences(&self) -> String {
        let Setting { plane, people, sampling, device, .. } = self.setting;
        let mut html = format!(
            "<p>The end point of {} meets a plane with the normal ({}) in {} hands; the controller runs at {} Hz; {}.</p>\n",
            escaped(&device.title),
            plane.normal.map(number).join(", "),
            people.count,
            number(1.0 / sampling.sample_s),
            carried_in_words(self.carried),
        );
        for (name, _) in &self.shown {
            if self.cases.iter().all(|case| case.controller != *name) {
                let _ = writeln!(html, "<p><code>{}</code>: no hand came to it.</p>", escaped(name));
                continue;
            }
            let _ = writeln!(
                html,
                "<p><code>{}</code>: shakes by {} mm RMS, holds with {} N/m; the handle slips {} mm along the wall and turns by {} \
                 mrad (medians over hands and speeds).</p>",
                escaped(name),
                number(1e3 * self.of(name, |case| case.measures.chatter_rms)),
                number(self.of(name, |case| case.measures.stiffness)),
                number(1e3 * self.of(name, |case| case.coupling.settled_slip)),
                number(1e3 * self.of(name, |case| case.coupling.turned)),
            );
        }
        html
    }

    fn table(&self) -> String {
        let mut html = String::from(
            "<div class=\"wide\"><table>\n<tr><th class=\"word\">wall</th><th class=\"word\">approach</th><th>chatter<br>[mm RMS]</th>\
             <th>worst hand<br>[mm RMS]</th><th>frequency<br>[Hz]</th><th>settled<br>[mm]</th><th>stiffness<br>[N/m]</th>\
             <th>settled slip<br>[mm]</th><th>turned<br>[mrad]</th><th>energy out<br>[mJ]</th></tr>\n",
        );
        for (name, _) in &self.shown {
            for approach in &self.setting.reaching.approaches {
                let of = self.cases.iter().filter(|case| case.controller == *name && case.speed == approach.name);
                let of: Vec<&Case> = of.collect();
                if of.is_empty() {
                    let _ = writeln!(
                        html,
                        "<tr><td class=\"word\"><code>{}</code></td><td class=\"word\">{}</td><td colspan=\"8\">no hand came to \
                         it</td></tr>",
                        escaped(name),
                        escaped(&approach.name)
                    );
                    continue;
                }
                let middle = |value: fn(&Case) -> f64| median(of.iter().map(|case| value(case)).collect());
                let most = |value: fn(&Case) -> f64| of.iter().map(|case| value(case)).fold(f64::NAN, f64::max);
                let _ = writeln!(
                    html,
                    "<tr><td class=\"word\"><code>{}</code></td><td class=\"word\">{}</td><td>{:.3}</td><td>{:.3}</td><td>{:.1}</td>\
                     <td>{:.1}</td><td>{:.1}</td><td>{:.1}</td><td>{:.0}</td><td>{:.2}</td></tr>",
                    escaped(name),
                    escaped(&approach.name),
                    1e3 * middle(|case| case.measures.chatter_rms),
                    1e3 * most(|case| case.measures.chatter_rms),
                    middle(|case| case.measures.frequency),
                    1e3 * middle(|case| case.measures.settled_position),
                    middle(|case| case.measures.stiffness),
                    1e3 * middle(|case| case.coupling.settled_slip),
                    1e3 * middle(|case| case.coupling.turned),
                    1e3 * most(|case| case.measures.energy_out),
                );
            }
        }
        html.push_str(
            "</table></div>\n<p class=\"note\">Medians over the hands; energy given out is that of the worst. Slip and turn are from \
             the first touch to where the handle settles.</p>\n",
        );
        html
    }

    /// Along the wall to the right, out of it upwards.
    fn ways(&self) -> String {
        let ways: Vec<Vec<Trace>> = (0..self.setting.reaching.approaches.len())
            .map(|index| self.shown.iter().map(|(name, contacts)| self.way(name, &contacts[index])).collect())
            .collect();
        let up = self.near();
        let seen = ways.iter().flatten().flat_map(|trace| trace.along.iter().zip(&trace.values));
        let across = span(seen.filter(|(_, distance)| **distance < up[1]).map(|(along, _)| along));
        let pictures = self.setting.reaching.approaches.iter().zip(&ways).map(|(approach, curves)| Traces {
            title: format!("{} approach, {} m/s", approach.name, approach.peak),
            along: "along the wall, from where it was met [mm]".to_owned(),
            quantity: "distance [mm]".to_owned(),
            across,
            up,
            curves: curves.clone(),
            levels: vec![0.0],
        });
        let note = "The typical hand comes from above; the plane is the broken line, the wall below it. The two axes have scales of \
                    their own.";
        figures(pictures, note)
    }

    /// The distances from the plane that matter \[mm\].
    fn near(&self) -> [f64; 2] {
        let depths = self.shown.iter().flat_map(|(_, contacts)| contacts).flat_map(|own| &own.along.position);
        let deepest = 1e3 * depths.copied().fold(-1e-3, f64::min);
        [1.1 * deepest, -0.7 * deepest]
    }

    fn way(&self, name: &str, contact: &Contact) -> Trace {
        let met = contact.met().map(|met| met.point);
        let origin = met.or(contact.point.first().copied()).unwrap_or_default();
        let along = contact.point.iter().map(|point| 1e3 * dot(self.along, plus(*point, -1.0, origin)));
        Trace {
            name: name.to_owned(),
            along: along.collect(),
            values: contact.along.position.iter().map(|distance| 1e3 * distance).collect(),
        }
    }

    fn depths(&self) -> String {
        let curve = |name: &str, contact: &Contact| {
            let values: Vec<f64> = contact.along.position.iter().map(|distance| 1e3 * distance).collect();
            Trace { name: name.to_owned(), along: since_touch(contact), values }
        };
        let of = |index: usize| -> Vec<Trace> {
            self.shown.iter().map(|(name, contacts)| curve(name, &contacts[index])).collect()
        };
        let approaches = self.setting.reaching.approaches.iter().enumerate();
        let pictures = approaches.map(|(index, approach)| Traces {
            title: format!("{} approach, {} m/s", approach.name, approach.peak),
            along: "time since the first touch [s]".to_owned(),
            quantity: "distance [mm]".to_owned(),
            across: [-BEFORE_S, AFTER_S],
            up: self.near(),
            curves: of(index),
            levels: vec![0.0],
        });
        figures(pictures, "Of the typical hand, along the plane's normal; the wall is below 0.")
    }

    fn torques(&self) -> String {
        let last = self.setting.reaching.approaches.len() - 1;
        let approach = &self.setting.reaching.approaches[last];
        let of = |contact: &Contact, slot: usize, joint: usize| Trace {
            name: format!("joint {joint}"),
            along: since_touch(contact),
            values: contact.torque.iter().map(|torque| torque[slot]).collect(),
        };
        let slides = |joint: &usize| self.setting.device.joints[*joint].kind == JointKind::Prismatic;
        let sliding = self.setting.free.iter().filter(|joint| slides(joint)).count();
        let quantity = match sliding {
            0 => "torque [N*m]",
            all if all == self.setting.free.len() => "force [N]",
            _ => "torque [N*m] or force [N]",
        };
        let pictures = self.shown.iter().map(|(name, contacts)| {
            let joints = self.setting.free.iter().enumerate();
            let curves: Vec<Trace> = joints.map(|(slot, joint)| of(&contacts[last], slot, *joint)).collect();
            Traces {
                title: format!("{name}, {} approach", approach.name),
                along: "time since the first touch [s]".to_owned(),
                quantity: quantity.to_owned(),
                across: [-BEFORE_S, AFTER_S],
                up: span(curves.iter().flat_map(|trace| &trace.values)),
                curves,
                levels: vec![0.0],
            }
        });
        figures(pictures, "What the wall asks of each joint: its force, by the transpose of the Jacobian.")
    }
}

/// What the controller carries, in words.
pub fn carried_in_words(carried: Option<CompensationRatios>) -> String {
    match carried {
        None => "the device's weight is in the hand".to_owned(),
        Some(CompensationRatios::WEIGHT) => "the device's weight is carried by the model".to_owned(),
        Some(CompensationRatios { inertia, friction }) => format!(
            "carried by the model: the device's weight, {} % of its inertia, {} % of its friction",
            number(100.0 * inertia),
            number(100.0 * friction)
        ),
    }
}

fn figures(pictures: impl Iterator<Item = Traces>, note: &str) -> String {
    let mut html = String::new();
    for picture in pictures {
        let _ = writeln!(html, "<figure>\n{}</figure>", traces::inline(&picture));
    }
    let _ = writeln!(html, "<p class=\"note\">{note}</p>");
    html
}

fn since_touch(contact: &Contact) -> Vec<f64> {
    let touched = contact.along.touched.unwrap_or(0) as f64;
    (0..contact.q.len()).map(|tick| (tick as f64 - touched) * contact.along.sample_s).collect()
}

fn span<'a>(values: impl Iterator<Item = &'a f64>) -> [f64; 2] {
    let (low, high) =
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(*value), high.max(*value)));
    if low < high { [low, high] } else { [-1.0, 1.0] }
}

/// The direction in the plane of the largest way along it of any contact; any of the plane's where nothing slips.
fn main_direction(setting: &Setting, shown: &[(String, Vec<Contact>)]) -> Vector {
    let normal = setting.plane.normal;
    let in_plane = |way: Vector| plus(way, -dot(way, normal), normal);
    let mut largest = [0.0; 3];
    for contact in shown.iter().flat_map(|(_, contacts)| contacts) {
        let (Some(touched), Some(met)) = (contact.along.touched, contact.met()) else { continue };
        for point in &contact.point[touched..] {
            let way = in_plane(plus(*point, -1.0, met.point));
            if dot(way, way) > dot(largest, largest) {
                largest = way;
            }
        }
    }
    if dot(largest, largest) == 0.0 {
        let least = (0..3).min_by(|a, b| normal[*a].abs().total_cmp(&normal[*b].abs())).unwrap_or(0);
        largest[least] = 1.0;
        largest = in_plane(largest);
    }
    let length = dot(largest, largest).sqrt();
    largest.map(|component| component / length)
}

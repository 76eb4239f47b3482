//! Measures, rules and the setting, as tables.

use std::fmt::Write;

use super::{Shown, WallReport, damping_in_words, densest, median, milli, number, plain, short};
use dynid_control::{Law, LinearLaw, RuleTable, VirtualTool};
use dynid_format::escaped;
use dynid_haptics::{wall, wall::Measures};

/// The deepest tint of a cell of a rule table.
const TINT: f64 = 0.55;

impl WallReport<'_> {
    pub(super) fn measures(&self) -> String {
        let (small, stiffness) = (self.unit.small, self.unit.stiffness);
        let mut html = String::from(
            "<div class=\"wide\"><table>\n<tr><th class=\"word\">wall</th><th class=\"word\">approach</th>",
        );
        for (quantity, unit) in [
            ("chatter", format!("{small} RMS")),
            ("worst hand", format!("{small} RMS")),
            ("peak to peak", small.to_owned()),
            ("frequency", "Hz".to_owned()),
            ("settled", small.to_owned()),
            ("stiffness", stiffness.to_owned()),
            ("energy out", "mJ".to_owned()),
            ("outside", "%".to_owned()),
        ] {
            let _ = write!(html, "<th>{quantity}<br>[{unit}]</th>");
        }
        html.push_str("</tr>\n");
        for own in &self.walls {
            for approach in &self.setting.approaches {
                let of = self.of(&own.name, Some(&approach.name));
                let middle = |value: fn(&Measures) -> f64| median(of.iter().map(|m| value(m)).collect());
                let most = |value: fn(&Measures) -> f64| of.iter().map(|m| value(m)).fold(f64::NAN, f64::max);
                let _ = writeln!(
                    html,
                    "<tr><td class=\"word\"><code>{}</code></td><td class=\"word\">{}</td><td>{}</td><td>{}</td><td>{}</td>\
                     <td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
                    escaped(&own.name),
                    escaped(&approach.name),
                    milli(middle(|m| m.chatter_rms)),
                    milli(most(|m| m.chatter_rms)),
                    milli(middle(|m| m.peak_to_peak)),
                    fixed(middle(|m| m.frequency), 1),
                    fixed(1e3 * middle(|m| m.settled_position), 1),
                    short(middle(|m| m.stiffness)),
                    fixed(1e3 * most(|m| m.energy_out), 2),
                    fixed(100.0 * most(|m| m.outside), 0),
                );
            }
        }
        let _ = writeln!(
            html,
            "</table></div>\n<p class=\"note\">Medians over {} hands; energy given out and time outside are those of the worst. \
             Stiffness is static: what the wall holds where the handle settles, over how deep that is.</p>",
            self.setting.hands
        );
        html.push_str(&self.compared());
        // It stands beside the bounds that stand below.
        if self.walls.iter().any(|own| self.passive_above(own).is_some()) {
            let _ = writeln!(html, "<p>{}</p>", escaped(&damping_in_words(&self.own, self.setting)));
        }
        html.push_str("<dl>\n");
        for own in &self.walls {
            let _ = writeln!(
                html,
                "<dt><code>{}</code></dt><dd>{}</dd>",
                escaped(&own.name),
                escaped(&self.description(own))
            );
        }
        html.push_str("</dl>\n");
        html
    }

    /// Chatter hand by hand, of the first wall over each of the others.
    fn compared(&self) -> String {
        let mut html = String::new();
        for own in &self.walls[1..] {
            let ratios = self.ratios(&own.name);
            let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
            let more = ratios.iter().filter(|ratio| **ratio >= 10.0).count();
            let _ = writeln!(
                html,
                "<li><code>{}</code>: {} times less chatter than <code>{}</code> in the median, {} times at worst, at least ten \
                 times less in {more} of {} cases</li>",
                escaped(&own.name),
                short(median(ratios.clone())),
                escaped(&self.walls[0].name),
                short(least),
                ratios.len()
            );
        }
        if html.is_empty() { html } else { format!("<p>Hand by hand:</p>\n<ul>\n{html}</ul>\n") }
    }

    fn passive_above(&self, own: &Shown) -> Option<f64> {
        wall::passive_above(&own.wall, self.setting.sample_s)
    }

    /// What a wall is.
    fn description(&self, own: &Shown) -> String {
        let scale = own.wall.scale();
        let law = match own.wall.law() {
            Law::Linear(law) | Law::Leaky { linear: law, .. } => {
                let (stiffness, damping) = (scale * law.k1, scale * law.k2);
                let bound = self.passive_above(own).map_or_else(String::new, |bound| {
                    format!(
                        "; passive whoever touches it only if the device itself damps with more than {} (K T / 2 + B, Colgate & \
                         Schenkel 1997; filter and delay ask for more)",
                        short(bound)
                    )
                });
                format!(
                    "{} {}, damping {} {}{bound}",
                    short(stiffness),
                    self.unit.stiffness,
                    short(damping),
                    self.unit.damping
                )
            }
            Law::Rules(table) => {
                let kind = if table.is_monotone() { "monotone" } else { "not monotone" };
                format!("{} x {} rules, {kind}", table.velocity().len(), table.position().len())
            }
            Law::Coupled(tool) => {
                let VirtualTool { inertia, stiffness, damping, wall_stiffness, wall_damping } = *tool;
                let [inertia, coupling, coupling_damping, wall, wall_damping] =
                    [inertia, stiffness, damping, wall_stiffness, wall_damping].map(|value| short(scale * value));
                format!(
                    "a tool of inertia {inertia} {2} behind {coupling} {0}, damping {coupling_damping} {1}, meets a wall of {wall} {0}, \
                     damping {wall_damping} {1}",
                    self.unit.stiffness, self.unit.damping, self.unit.inertia
                )
            }
        };
        let leaky = match own.wall.law() {
            // At rest the element has slid as far as it goes, or it is still stuck.
            Law::Leaky { linear, stiffness, share } => {
                let held = stiffness.min(*share);
                format!(
                    "; pushed in it holds like {} {stiffness_unit}, let out as little as like {} {stiffness_unit}",
                    short(scale * linear.k1 * (1.0 + held)),
                    short(scale * linear.k1 * (1.0 - share).max(0.0)),
                    stiffness_unit = self.unit.stiffness
                )
            }
            _ => String::new(),
        };
        let watched = if own.passive { "; watched by a passivity controller" } else { "" };
        format!("{}: {law}{leaky}{watched}", own.title)
    }

    /// Figure 5.6, for every wall that has rules.
    pub(super) fn rules(&self) -> String {
        let mut html = String::new();
        for own in &self.walls {
            let Law::Rules(table) = own.wall.law() else { continue };
            let _ = write!(
                html,
                "<h3><code>{}</code>: {}</h3>\n<div class=\"wide\"><table class=\"rules\">\n<tr><th class=\"word\">velocity<br>by \
                 position</th>",
                escaped(&own.name),
                escaped(&own.title)
            );
            html.push_str(&cells(table, own.base.as_ref()));
            let _ = writeln!(
                html,
                "</table></div>\n<p class=\"note\">One for each pair of sets; 1 is \u{2212}{} {} on the joint.</p>",
                plain(own.wall.scale()),
                self.unit.torque
            );
        }
        html.push_str(
            "<p class=\"note\">Figure 5.6 of the thesis: below zero pushes out of the wall (blue), above pulls in (vermilion). Framed: \
             the range of interest. Bold and marked \u{2022}: modified, that is not what the linear law of the wall's file gives at the \
             peaks of the two sets, nor nothing outside.</p>\n",
        );
        html
    }

    pub(super) fn setting_in_words(&self) -> String {
        let own = self.setting;
        let (position, torque) = (self.unit.position, self.unit.torque);
        let hand = &own.hand;
        let mut entries: Vec<(String, String)> = vec![
            ("device".to_owned(), format!("{}, joint {}; the others are locked", own.device.title, own.joint)),
            (
                "controller".to_owned(),
                format!(
                    "{} Hz, answers after {} more tick{}, positions in steps of {} {position}, at most {} {torque}",
                    plain(1.0 / own.sample_s),
                    own.delay_samples,
                    if own.delay_samples == 1 { "" } else { "s" },
                    plain(own.position_quantum),
                    plain(own.torque_limit)
                ),
            ),
            (
                "typical hand".to_owned(),
                format!(
                    "inertia {}, grip {} and {}, arm {} and {} (stiffness and damping), tightens by {}",
                    plain(hand.inertia),
                    plain(hand.grip_stiffness),
                    plain(hand.grip_damping),
                    plain(hand.arm_stiffness),
                    plain(hand.arm_damping),
                    plain(hand.tightening)
                ),
            ),
            (
                "hands".to_owned(),
                format!(
                    "{}, each number within a factor of {}, drawn with seed {}",
                    own.hands,
                    plain(own.spread),
                    own.seed
                ),
            ),
        ];
        for approach in &own.approaches {
            entries.push((
                approach.name.clone(),
                format!(
                    "from {} {position}, at most {} {}, then holding with {} {torque}",
                    plain(own.start),
                    plain(approach.peak),
                    self.unit.velocity,
                    plain(own.hold_after(approach))
                ),
            ));
        }
        entries.push((
            "simulation".to_owned(),
            format!("steps of {} s, {} s after the first touch", plain(own.step_s), plain(own.after_s)),
        ));
        let mut html = String::from("<dl>\n");
        for (what, value) in entries {
            let _ = writeln!(html, "<dt>{}</dt><dd>{}</dd>", escaped(&what), escaped(&value));
        }
        html.push_str("</dl>\n");
        html
    }
}

/// Heading and rows of a rule table, tinted by the output; marked where it is not what `base` makes of it (Eq. 5.5).
fn cells(table: &RuleTable, base: Option<&LinearLaw>) -> String {
    let mut html = String::new();
    for name in table.position().names() {
        let _ = write!(html, "<th>{}</th>", escaped(name));
    }
    html.push_str("</tr>\n");
    let inside = |[from, to]: [f64; 2], peak: f64| (from..=to).contains(&peak);
    let (across, up) = (densest(table.position()), densest(table.velocity()));
    let largest = table.outputs().iter().fold(0.0_f64, |most, output| most.max(output.abs()));
    for (row, name) in table.velocity().names().iter().enumerate() {
        let _ = write!(html, "<tr><td class=\"word\">{}</td>", escaped(name));
        for column in 0..table.position().len() {
            let output = table.rule(row, column);
            // The square root tells small outputs apart too.
            let tint = if largest > 0.0 { TINT * (output.abs() / largest).sqrt() } else { 0.0 };
            let colour = if output < 0.0 { "0,114,178" } else { "213,94,0" };
            let (position, rate) = (table.position().peaks()[column], table.velocity().peaks()[row]);
            let is_core = inside(across, position) && inside(up, rate);
            let given = |base: &LinearLaw| if position > 0.0 { 0.0 } else { base.output(position, rate) };
            let reported = match base {
                Some(base) if output != given(base) => format!("<b>{}\u{2022}</b>", short(output)),
                _ => short(output),
            };
            let _ = write!(
                html,
                "<td{} style=\"background:rgba({colour},{tint:.2})\">{reported}</td>",
                if is_core { " class=\"core\"" } else { "" },
            );
        }
        html.push_str("</tr>\n");
    }
    html
}

fn fixed(value: f64, decimals: usize) -> String {
    if value.is_finite() { format!("{value:.decimals$}").replace('-', "\u{2212}") } else { number(value) }
}

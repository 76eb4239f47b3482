//! The ladder on a page: a table and a picture.

use std::fmt::Write;

use super::{Section, number};
use crate::{plot::steps, plot::steps::Steps};
use dynid_format::escaped;
use dynid_judge::{ladder::Ladder, ladder::Rung};
use dynid_sentences::{self as sentences, ladder::FORMULA};

/// Errors of the models of a lineage, one rung each.
#[derive(Debug, Clone)]
pub struct LadderSection<'a> {
    /// What is shown.
    pub ladder: &'a Ladder,
}

/// What a rung did to the one before it, in a few words.
pub fn changes(rung: &Rung) -> String {
    let mut parts: Vec<String> = rung.added.iter().map(|place| format!("+ {place}")).collect();
    parts.extend(rung.removed.iter().map(|place| format!("\u{2212} {place}")));
    match rung.changed.len() {
        0 => {}
        1 => parts.push(rung.changed[0].name.clone()),
        more => parts.push(format!("{more} values")),
    }
    parts.join(", ")
}

/// The position error's ladder, and the torque error's where there is one.
pub fn ladder_pictures(ladder: &Ladder) -> Vec<Steps> {
    let rungs: Vec<String> = ladder.rungs.iter().map(|rung| rung.model.clone()).collect();
    let n_joints = ladder.rungs.first().map_or(0, |rung| rung.joints.len());
    let has_validate = ladder.rungs.iter().any(|rung| rung.rmse_validate.or(rung.torque_percent_validate).is_some());
    let role = if has_validate { "held-out runs" } else { "runs fitted to" };
    let joint_name = |index: usize| format!("joint {}", ladder.rungs[0].joints[index].joint);
    let series = |of: &dyn Fn(&Rung, usize) -> Option<f64>| -> Vec<(String, Vec<Option<f64>>)> {
        (0..n_joints)
            .map(|index| (joint_name(index), ladder.rungs.iter().map(|rung| of(rung, index)).collect::<Vec<_>>()))
            .filter(|(_, values)| values.iter().any(Option::is_some))
            .collect()
    };
    let mut pictures = Vec::new();
    let position = series(&|rung, joint| {
        let joint = &rung.joints[joint];
        if has_validate { joint.rmse_validate } else { joint.rmse_fit }
    });
    if !position.is_empty() {
        pictures.push(Steps {
            title: format!("Position error on the {role}"),
            quantity: "RMS [rad or m]".to_owned(),
            rungs: rungs.clone(),
            series: position,
            floor: ladder.noise_floor,
        });
    }
    let torque = series(&|rung, joint| {
        let joint = &rung.joints[joint];
        if has_validate { joint.torque_percent_validate } else { joint.torque_percent_fit }
    });
    if !torque.is_empty() {
        pictures.push(Steps {
            title: format!("Torque error on the {role}"),
            quantity: "% of the torque".to_owned(),
            rungs,
            series: torque,
            floor: None,
        });
    }
    pictures
}

impl Section for LadderSection<'_> {
    fn title(&self) -> &str {
        "The ladder"
    }

    fn html(&self) -> String {
        let ladder = self.ladder;
        let size = |value: Option<f64>| number(value.unwrap_or(f64::NAN));
        let percent = |value: Option<f64>| value.map_or_else(|| number(f64::NAN), |value| format!("{value:.1}"));
        let whole = |value: Option<f64>| {
            value.map_or_else(|| number(f64::NAN), |value| format!("{value:.0}").replace('-', "\u{2212}"))
        };
        let mut html = String::from(
            "<div class=\"wide\"><table class=\"prose\">\n<tr><th class=\"word\" rowspan=\"2\">model</th><th colspan=\"2\">position</th>\
             <th colspan=\"2\">torque %</th><th rowspan=\"2\">free</th><th rowspan=\"2\">BIC</th><th rowspan=\"2\">\u{394} BIC</th>\
             <th class=\"word\" rowspan=\"2\">what changed</th></tr>\n<tr><th>fit</th><th>validate</th><th>fit</th><th>validate</th>\
             </tr>\n",
        );
        for rung in &ladder.rungs {
            let _ = writeln!(
                html,
                "<tr><td class=\"word\">{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>\
                 <td class=\"word\">{}</td></tr>",
                escaped(&rung.model),
                size(rung.rmse_fit),
                size(rung.rmse_validate),
                percent(rung.torque_percent_fit),
                percent(rung.torque_percent_validate),
                rung.free_parameters,
                whole(rung.bic),
                whole(rung.delta_bic),
                escaped(&changes(rung))
            );
        }
        html.push_str("</table></div>\n");
        let floor =
            ladder.noise_floor.map_or_else(String::new, |floor| format!(" The logs' own noise is {}.", number(floor)));
        let bic = ladder.independent_samples.map_or_else(String::new, |samples| {
            format!(" {FORMULA}; {samples:.0} samples; differences below \u{2212}10 are strong.")
        });
        let _ = writeln!(
            html,
            "<p class=\"note\">Position: RMS [rad or m]. Free: parameters that a fit may move.{floor}{}</p>",
            escaped(&bic)
        );
        for note in sentences::ladder::notes(ladder) {
            let _ = writeln!(html, "<p class=\"note\">Note: {}</p>", escaped(&note));
        }
        for picture in ladder_pictures(ladder) {
            let _ = writeln!(html, "<figure>\n{}</figure>", steps::inline(&picture));
        }
        html
    }
}

//! Where model and logs part, and how the measured torque is made up, on a page.

use std::fmt::Write;

use super::{Section, number};
use crate::{plot::terms, plot::terms::Terms};
use dynid_format::escaped;
use dynid_judge::compare::Finding;
use dynid_sentences as sentences;
use dynid_torque::JointTerms;

/// Findings, the most telling first.
#[derive(Debug, Clone)]
pub struct Where<'a> {
    /// As [`dynid_judge::compare::locate()`] tells them.
    pub findings: &'a [Finding],
    /// The model before this one and its findings: what led to the change between them.
    pub before: Option<(&'a str, &'a [Finding])>,
}

/// Findings that stand in the table at once; the others are folded away.
const OPEN: usize = 12;
/// Findings of the model before that are reported.
const OPEN_BEFORE: usize = 6;

impl Section for Where<'_> {
    fn title(&self) -> &str {
        "Where they part"
    }

    fn html(&self) -> String {
        let mut html = if self.findings.is_empty() {
            "<p>Nothing that differs from chance: what is left follows no signal and lies nowhere in particular.</p>\n"
                .to_owned()
        } else {
            let (open, folded) = self.findings.split_at(self.findings.len().min(OPEN));
            let mut html = rows(open);
            if !folded.is_empty() {
                let _ = writeln!(html, "<details><summary>{} more</summary>\n{}</details>", folded.len(), rows(folded));
            }
            html
        };
        if let Some((name, findings)) = self.before.filter(|(_, findings)| !findings.is_empty()) {
            let most = &findings[..findings.len().min(OPEN_BEFORE)];
            let _ = writeln!(html, "<h3>Before, in {}</h3>\n{}", escaped(name), rows(most));
        }
        html.push_str(
            "<p class=\"note\">Share of the squared error of that joint in that run; the line in a bar is what chance would give. \
             Reported is only what chance gives in less than about one case of 100 000.</p>\n",
        );
        html
    }
}

fn rows(findings: &[Finding]) -> String {
    let mut html = String::from(
        "<div class=\"wide\"><table class=\"prose\">\n<tr><th class=\"word\">run</th><th>joint</th><th class=\"word\">share</th>\
         <th class=\"word\">what</th></tr>\n",
    );
    for finding in findings {
        let percent = |share: f64| 100.0 * share.clamp(0.0, 1.0);
        let _ = writeln!(
            html,
            "<tr><td class=\"word\">{}</td><td>{}</td><td class=\"word\"><span class=\"bar\"><span style=\"width:{:.1}%\"></span>\
             <i style=\"left:{:.1}%\"></i></span></td><td class=\"word\">{}</td></tr>",
            escaped(&finding.run),
            finding.joint,
            percent(finding.share),
            percent(finding.expected),
            escaped(&sentences::finding::sentence(finding))
        );
    }
    html.push_str("</table></div>\n");
    html
}

/// The torque of measured motions by physical term.
#[derive(Debug, Clone, Default)]
pub struct TorqueTerms {
    /// Run, and the terms of its joints with the unit of the command.
    pub runs: Vec<(String, Vec<(JointTerms, String)>)>,
}

impl Section for TorqueTerms {
    fn title(&self) -> &str {
        "What the torque is made of"
    }

    fn html(&self) -> String {
        let mut html = String::new();
        for (run, joints) in &self.runs {
            for (joint, unit) in joints {
                let title = format!("{run}, joint {}", joint.joint);
                let counted = |values: &[f64]| -> Vec<f64> {
                    values.iter().zip(&joint.used).map(|(&value, &used)| if used { value } else { f64::NAN }).collect()
                };
                let picture = Terms {
                    title: title.clone(),
                    quantity: format!("torque [{unit}]"),
                    time: joint.time.clone(),
                    whole: ("commanded".to_owned(), counted(&joint.command)),
                    parts: joint.terms.iter().map(|(name, values)| (name.clone(), counted(values))).collect(),
                };
                let _ = writeln!(html, "<figure>\n{}</figure>", terms::inline(&picture));
                let whole = joint.rms(&joint.command);
                let parts: Vec<String> = joint
                    .terms
                    .iter()
                    .map(|(name, values)| {
                        let rms = joint.rms(values);
                        let share =
                            if whole > 0.0 { format!(" ({:.1} %)", 100.0 * rms / whole) } else { String::new() };
                        format!("{name} {}{share}", number(rms))
                    })
                    .collect();
                let _ = writeln!(
                    html,
                    "<p class=\"note\">RMS [{}]: commanded {}; {}.</p>",
                    escaped(unit),
                    number(whole),
                    escaped(&parts.join("; "))
                );
            }
        }
        html.push_str(
            "<p class=\"note\">Along the measured, filtered motion, in the unit of the command. Effects are taken \
             out one after the other, first those that build on others; an effect's term is what the torque error then has more. \
             Shares of the RMS do not add up to 100 %, for terms stand against each other.</p>\n",
        );
        html
    }
}

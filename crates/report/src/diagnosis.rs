//! A diagnosis on a page: the ranking with evidence for and against, what was refused and why.
//!
//! It is read from the JSON that `dynid diagnose` writes, and what is not in there is left out, so that a page can be made
//! from any version's.

use std::fmt::Write;

use serde_json::Value;

use super::{Section, number, prose};
use dynid_format::escaped;

/// Candidates, the best first.
#[derive(Debug, Clone)]
pub struct Ranking<'a> {
    /// As `dynid diagnose --json` prints it.
    pub diagnosis: &'a Value,
}

/// The sentences of a diagnosis, if it has some.
pub fn sentences(diagnosis: &Value) -> Vec<String> {
    texts(&diagnosis["sentences"])
}

/// `coulomb at joint 2`, `input_coupling at joint 4 from 5`, `.. of the device`.
pub fn placed(entry: &Value) -> String {
    let effect = entry["effect"].as_str().unwrap_or("?");
    match (entry["joint"].as_u64(), entry["from"].as_u64()) {
        (Some(joint), Some(from)) => format!("{effect} at joint {joint} from {from}"),
        (Some(joint), None) => format!("{effect} at joint {joint}"),
        _ => format!("{effect} of the device"),
    }
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

fn texts(value: &Value) -> Vec<String> {
    list(value).iter().filter_map(|entry| entry.as_str().map(str::to_owned)).collect()
}

fn as_number(value: &Value) -> String {
    number(value.as_f64().unwrap_or(f64::NAN))
}

fn percent(value: &Value) -> String {
    value.as_f64().map_or_else(|| number(f64::NAN), |value| format!("{value:.1}"))
}

impl Section for Ranking<'_> {
    fn title(&self) -> &str {
        "Which effect is missing"
    }

    fn html(&self) -> String {
        let mut html = String::new();
        let verdict = match self.diagnosis["verdict"].as_str() {
            Some("missing_effect") => "An effect is missing.",
            Some("nothing_missing") => "Nothing is missing that the library knows.",
            Some("unexplained") => "What is left is not explained.",
            _ => "",
        };
        if !verdict.is_empty() {
            let _ = writeln!(html, "<p><strong>{verdict}</strong></p>");
        }
        for sentence in sentences(self.diagnosis) {
            let _ = writeln!(html, "<p>{}</p>", prose(&sentence));
        }
        let ranking = list(&self.diagnosis["ranking"]);
        if !ranking.is_empty() {
            html.push_str(&table(ranking));
            ranking.iter().enumerate().for_each(|(index, entry)| html.push_str(&evidence(index, entry)));
        }
        let refused =
            list(&self.diagnosis["refused"]).chunk_by(|one, next| one["reason"] == next["reason"]).map(|alike| {
                let candidates: Vec<String> = alike.iter().map(placed).collect();
                format!("{}: {}", candidates.join(", "), alike[0]["reason"].as_str().unwrap_or(""))
            });
        html.push_str(&listed("Refused", refused));
        let moved = list(&self.diagnosis["moved"]).iter().map(|entry| {
            format!(
                "{} in {}: {} standard errors",
                entry["parameter"].as_str().unwrap_or("?"),
                entry["run"].as_str().unwrap_or("?"),
                as_number(&entry["change_in_std_errors"])
            )
        });
        html.push_str(&listed("Parameters that moved between runs", moved));
        for note in texts(&self.diagnosis["notes"]) {
            let _ = writeln!(html, "<p class=\"note\">Note: {}</p>", prose(&note));
        }
        html
    }
}

/// Entries under a heading, where there are any.
fn listed(heading: &str, entries: impl Iterator<Item = String>) -> String {
    let items: String = entries.map(|line| format!("<li>{}</li>\n", prose(&line))).collect();
    if items.is_empty() { items } else { format!("<h3>{heading}</h3>\n<ul>\n{items}</ul>\n") }
}

fn table(ranking: &[Value]) -> String {
    let mut html = String::from(
        "<div class=\"wide\"><table class=\"prose\">\n<tr><th></th><th class=\"word\">effect</th>\
         <th>position before</th><th>after</th><th>torque % before</th><th>after</th><th>\u{394} BIC</th>\
         <th class=\"word\">cannot be told from</th></tr>\n",
    );
    for (index, entry) in ranking.iter().enumerate() {
        let confounded: Vec<String> = list(&entry["confounded_with"]).iter().map(placed).collect();
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td class=\"word\">{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>\
             <td class=\"word\">{}</td></tr>",
            index + 1,
            escaped(&placed(entry)),
            as_number(&entry["rmse_validate_before"]),
            as_number(&entry["rmse_validate_after"]),
            percent(&entry["torque_percent_before"]),
            percent(&entry["torque_percent_after"]),
            percent(&entry["delta_bic"]).replace('-', "\u{2212}"),
            escaped(&confounded.join(", "))
        );
    }
    html.push_str(
        "</table></div>\n<p class=\"note\">Before and after adding the effect and fitting anew, on the held-out runs (position: RMS \
         [rad or m]). \u{394} BIC: what the effect's parameters cost is counted; below \u{2212}10 is strong.</p>\n",
    );
    html
}

fn evidence(index: usize, entry: &Value) -> String {
    let (pro, contra) = (texts(&entry["evidence_for"]), texts(&entry["evidence_against"]));
    let parameters = list(&entry["parameters"]);
    let experiment = entry["experiment"].as_str();
    if pro.is_empty() && contra.is_empty() && parameters.is_empty() && experiment.is_none() {
        return String::new();
    }
    let mut html = format!("<h3>{}. {}</h3>\n", index + 1, escaped(&placed(entry)));
    html.push_str("<div class=\"columns\">\n");
    for (heading, class, lines) in [("For", "good", pro), ("Against", "bad", contra)] {
        let _ = writeln!(html, "<div><strong class=\"{class}\">{heading}</strong>\n<ul>");
        for line in &lines {
            let _ = writeln!(html, "<li>{}</li>", prose(line));
        }
        html.push_str(if lines.is_empty() { "<li class=\"faint\">nothing</li></ul></div>\n" } else { "</ul></div>\n" });
    }
    html.push_str("</div>\n");
    let values: Vec<String> = parameters
        .iter()
        .map(|own| {
            let error =
                own["std_error"].as_f64().map_or_else(String::new, |error| format!(" \u{b1} {}", number(error)));
            format!("{} = {}{error}", own["name"].as_str().unwrap_or("?"), as_number(&own["value"]))
        })
        .collect();
    if !values.is_empty() {
        let _ = writeln!(html, "<p class=\"note\">{}</p>", escaped(&values.join("; ")));
    }
    if let Some(experiment) = experiment {
        let _ = writeln!(html, "<p>To tell them apart: {}</p>", prose(experiment));
    }
    html
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_full_diagnosis_is_reported_whole() {
        let diagnosis = json!({
            "verdict": "missing_effect",
            "sentences": ["Joint 4 lacks <Coulomb> friction, `coulomb`."],
            "ranking": [{
                "effect": "coulomb", "joint": 4, "rmse_validate_before": 0.1, "rmse_validate_after": 2e-4,
                "torque_percent_before": 30.0, "torque_percent_after": 2.0, "delta_bic": -4000.0,
                "confounded_with": [{"effect": "stribeck", "joint": 4}],
                "parameters": [{"name": "joint.4.coulomb.Fc", "value": 0.015, "std_error": 1e-4}],
                "evidence_for": ["the error has the sign of the speed"], "evidence_against": [],
                "experiment": "lock all but joint 4 and move slowly"
            }],
            "refused": [
                {"effect": "cogging", "joint": 4, "reason": "no gain on held-out runs"},
                {"effect": "backlash", "joint": 4, "reason": "no gain on held-out runs"},
                {"effect": "dahl", "joint": 4, "reason": "a parameter is at its bound"}
            ],
            "moved": [{"parameter": "joint.4.spring.qeq", "run": "a.csv", "change_in_std_errors": 9.0}],
            "notes": ["no validate run for joint 3"]
        });
        let html = Ranking { diagnosis: &diagnosis }.html();
        for part in [
            "Joint 4 lacks &lt;Coulomb&gt; friction, <code>coulomb</code>.",
            "coulomb at joint 4",
            "stribeck at joint 4",
            "\u{2212}4000.0",
            "the error has the sign of the speed",
            "joint.4.coulomb.Fc = 0.01500 \u{b1} 1.000e\u{2212}4",
            "To tell them apart: lock all but",
            "<li>cogging at joint 4, backlash at joint 4: no gain on held-out runs</li>",
            "<li>dahl at joint 4: a parameter",
            "joint.4.spring.qeq in a.csv: 9.000",
            "Note: no validate run",
        ] {
            assert!(html.contains(part), "{part}: {html}");
        }
    }

    #[test]
    fn what_a_diagnosis_does_not_say_is_left_out() {
        for diagnosis in [json!({}), json!(null), json!({"ranking": [{"effect": "coulomb"}, 3], "refused": 1})] {
            let html = Ranking { diagnosis: &diagnosis }.html();
            assert!(!html.contains("null") && !html.contains("NaN"), "{html}");
        }
    }
}

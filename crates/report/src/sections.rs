//! The sections that a report is made of.

use std::fmt::Write;

use super::{Section, number, prose};
use crate::{plot, plot::Panel};
use dynid_format::escaped;
use dynid_logs::experiment::Experiment;
use dynid_user_model::Model;

/// What came out, in a few sentences.
#[derive(Debug, Clone, Default)]
pub struct Verdict {
    /// Each becomes a line of its own.
    pub sentences: Vec<String>,
}

impl Section for Verdict {
    fn title(&self) -> &str {
        "Verdict"
    }

    fn html(&self) -> String {
        self.sentences.iter().fold(String::new(), |mut html, sentence| {
            let _ = writeln!(html, "<p>{}</p>", prose(sentence));
            html
        })
    }
}

/// Sentences, one a line.
#[derive(Debug, Clone, Default)]
pub struct Sentences {
    /// Heading.
    pub title: String,
    /// Each a line of a list.
    pub sentences: Vec<String>,
}

impl Section for Sentences {
    fn title(&self) -> &str {
        &self.title
    }

    fn html(&self) -> String {
        let lines: Vec<String> =
            self.sentences.iter().map(|sentence| format!("<li>{}</li>", prose(sentence))).collect();
        format!("<ul>\n{}\n</ul>\n", lines.join("\n"))
    }
}

/// Error per run and joint, for one model after the other: a ladder that should lead down.
#[derive(Debug, Clone, Default)]
pub struct Errors {
    /// Headings of the models, e.g. `start`, `fitted`.
    pub models: Vec<String>,
    /// Run, role, joint, and the error of each model.
    pub rows: Vec<(String, String, usize, Vec<f64>)>,
    /// What the numbers are, e.g. `RMSE (rad)`.
    pub quantity: String,
    /// What is said below the table.
    pub note: String,
}

impl Section for Errors {
    fn title(&self) -> &str {
        "How far off"
    }

    fn html(&self) -> String {
        let mut html = String::from(
            "<div class=\"wide\"><table>\n<tr><th class=\"word\">run</th><th class=\"word\">role</th><th>joint</th>",
        );
        for model in &self.models {
            let _ = write!(html, "<th>{}, {}</th>", escaped(model), escaped(&self.quantity));
        }
        html.push_str("</tr>\n");
        for (run, role, joint, errors) in &self.rows {
            let _ = write!(
                html,
                "<tr><td class=\"word\">{}</td><td class=\"word\">{}</td><td>{joint}</td>",
                escaped(run),
                escaped(role)
            );
            for error in errors {
                let _ = write!(html, "<td>{}</td>", number(*error));
            }
            html.push_str("</tr>\n");
        }
        let _ = writeln!(html, "</table></div>\n<p class=\"note\">{}</p>", escaped(&self.note));
        html
    }
}

/// Pictures, one below the other.
#[derive(Debug, Clone, Default)]
pub struct Figures {
    /// Heading.
    pub title: String,
    /// One picture each.
    pub panels: Vec<Panel>,
    /// What is said below the pictures.
    pub note: String,
}

impl Section for Figures {
    fn title(&self) -> &str {
        &self.title
    }

    fn html(&self) -> String {
        let mut html = String::new();
        for panel in &self.panels {
            let _ = writeln!(html, "<figure>\n{}</figure>", plot::inline(panel));
        }
        let _ = writeln!(html, "<p class=\"note\">{}</p>", escaped(&self.note));
        html
    }
}

/// A parameter before and after a fit.
#[derive(Debug, Clone, Default)]
pub struct ParameterRow {
    /// E.g. `joint.4.lugre.Fc`.
    pub name: String,
    /// SI.
    pub unit: String,
    /// Where the fit began.
    pub start: f64,
    /// What it found.
    pub value: f64,
    /// Its standard error; absent where the data say nothing.
    pub std_error: Option<f64>,
    /// Whether the data determine it.
    pub identifiable: bool,
    /// The value that made the data, where somebody knows it.
    pub truth: Option<f64>,
}

/// What the fit found.
#[derive(Debug, Clone, Default)]
pub struct Parameters {
    /// In the order of the model.
    pub rows: Vec<ParameterRow>,
    /// What is said below the table.
    pub note: String,
}

impl Section for Parameters {
    fn title(&self) -> &str {
        "Parameters"
    }

    fn html(&self) -> String {
        let with_truth = self.rows.iter().any(|row| row.truth.is_some());
        let mut html = String::from(
            "<div class=\"wide\"><table>\n<tr><th class=\"word\">parameter</th><th class=\"word\">unit</th>\
             <th>start</th><th>fitted</th><th>\u{b1}</th>",
        );
        html.push_str(if with_truth { "<th>truth</th>" } else { "" });
        html.push_str("<th class=\"word\"></th></tr>\n");
        for row in &self.rows {
            let _ = write!(
                html,
                "<tr><td class=\"word\"><code>{}</code></td><td class=\"word\">{}</td><td>{}</td><td>{}</td><td>{}</td>",
                escaped(&row.name),
                escaped(&row.unit),
                number(row.start),
                number(row.value),
                row.std_error.map_or_else(|| number(f64::NAN), number)
            );
            if with_truth {
                let _ = write!(html, "<td>{}</td>", row.truth.map_or_else(|| number(f64::NAN), number));
            }
            let flag = if row.identifiable { "" } else { "<span class=\"bad\">not alone</span>" };
            let _ = writeln!(html, "<td class=\"word\">{flag}</td></tr>");
        }
        let _ = writeln!(html, "</table></div>\n<p class=\"note\">{}</p>", escaped(&self.note));
        html
    }
}

/// Where everything came from.
#[derive(Debug, Clone, Default)]
pub struct Provenance {
    /// What and its value, e.g. `log`, `sha256 3f..`.
    pub entries: Vec<(String, String)>,
    /// Commands that lead here.
    pub commands: Vec<String>,
}

impl Provenance {
    /// Logs, models with their parents, device and program.
    pub fn of_models(experiment: &Experiment, models: &[(String, Model)]) -> Self {
        let mut entries =
            vec![("logs".to_owned(), format!("{}, sha256 {}", experiment.path.display(), experiment.digest))];
        for (name, model) in models {
            entries.push((name.clone(), format!("sha256 {}", model.digest())));
            if let Some(fit) = &model.fit {
                let is_same = if fit.data_digest == experiment.digest { ", these ones" } else { ", not these ones" };
                entries.push((
                    String::new(),
                    format!(
                        "fitted ({} error, {}) from the model with sha256 {}, to logs with sha256 {}{is_same}",
                        fit.error, fit.status, fit.parent_digest, fit.data_digest
                    ),
                ));
            }
        }
        entries.push(("device".to_owned(), experiment.device.id.clone()));
        entries.push(("program".to_owned(), format!("dynid {}", env!("CARGO_PKG_VERSION"))));
        Self { entries, commands: Vec::new() }
    }
}

impl Section for Provenance {
    fn title(&self) -> &str {
        "Where this came from"
    }

    fn html(&self) -> String {
        let mut html = String::from("<dl>\n");
        for (what, value) in &self.entries {
            let _ = writeln!(html, "<dt>{}</dt><dd>{}</dd>", escaped(what), escaped(value));
        }
        html.push_str("</dl>\n");
        if !self.commands.is_empty() {
            let _ = writeln!(html, "<p>Commands:</p>\n<pre>{}</pre>", escaped(&self.commands.join("\n")));
        }
        html
    }
}

//! Sections about models: their parameters side by side (thesis Appendix D), how far off they are per run and joint
//! (Figures 4.13 to 4.41), and where what is left comes from.

use std::fmt::Write;

use super::{Section, number};
use dynid_format::escaped;
use dynid_judge::compare::Comparison;
use dynid_user_model::{ErrorShare, FitRecord, Model};

/// Parameters of several models of one device side by side.
#[derive(Debug, Clone, Default)]
pub struct Models {
    /// What each is called, e.g. `start`, `isolated`, `coupling`.
    pub names: Vec<String>,
    /// For each whether it comes from a fit, so that its values have errors and flags.
    pub fitted: Vec<bool>,
    /// In the models' order.
    pub rows: Vec<ModelsRow>,
}

/// One parameter in several models.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelsRow {
    /// E.g. `joint.4.lugre.Fc`.
    pub name: String,
    /// SI.
    pub unit: String,
    /// One a model; `None` where it has no such parameter.
    pub cells: Vec<Option<Cell>>,
}

/// A parameter's value and standing in one model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// In the unit of the row.
    pub value: f64,
    /// One standard deviation, where the fit states it.
    pub std_error: Option<f64>,
    /// How it stands.
    pub standing: Standing,
}

/// How a parameter stands after a fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standing {
    /// The data determine it.
    Determined,
    /// The data determine it only together with others, or not at all.
    NotAlone,
    /// A bound holds it.
    HeldByBound,
    /// The fit did not move it: fixed, or in none of its runs.
    NotFitted,
}

impl Standing {
    /// As it stands in tables; nothing where all is well.
    pub fn flag(self) -> &'static str {
        match self {
            Self::Determined => "",
            Self::NotAlone => "not alone",
            Self::HeldByBound => "at its bound",
            Self::NotFitted => "not fitted",
        }
    }

    /// As programs read it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Determined => "determined",
            Self::NotAlone => "not identifiable",
            Self::HeldByBound => "held by bound",
            Self::NotFitted => "not fitted",
        }
    }

    pub(super) fn of(fit: &FitRecord, name: &str) -> Self {
        if fit.at_bound.iter().any(|other| other == name) {
            Self::HeldByBound
        } else if fit.not_identifiable.iter().any(|other| other == name) {
            Self::NotAlone
        } else if fit.std_error.contains_key(name) {
            Self::Determined
        } else {
            Self::NotFitted
        }
    }
}

impl Models {
    /// The parameters that a fit of any of `models` moved or that differ between them, in the order of the first model
    /// that has them.
    pub fn new(models: &[(String, Model)]) -> Self {
        let mut names: Vec<String> = Vec::new();
        for (_, model) in models {
            for name in model.names() {
                if !names.contains(&name) {
                    names.push(name);
                }
            }
        }
        let row = |name: String| ModelsRow {
            unit: models.iter().find_map(|(_, model)| model.unit(&name)).unwrap_or_default(),
            cells: models.iter().map(|(_, model)| cell(model, &name)).collect(),
            name,
        };
        Self {
            names: models.iter().map(|(name, _)| name.clone()).collect(),
            fitted: models.iter().map(|(_, model)| model.fit.is_some()).collect(),
            rows: names.into_iter().map(row).filter(ModelsRow::tells).collect(),
        }
    }
}

impl ModelsRow {
    fn tells(&self) -> bool {
        let moved = self.cells.iter().flatten().any(|cell| cell.standing != Standing::NotFitted);
        moved || self.cells.windows(2).any(|pair| pair[0].map(|cell| cell.value) != pair[1].map(|cell| cell.value))
    }
}

fn cell(model: &Model, name: &str) -> Option<Cell> {
    let parameter = model.parameter(name)?;
    let fit = model.fit.as_ref();
    Some(Cell {
        value: parameter.value,
        std_error: fit.and_then(|fit| fit.std_error.get(name).copied()),
        standing: fit.map_or(Standing::NotFitted, |fit| Standing::of(fit, name)),
    })
}

impl Section for Models {
    fn title(&self) -> &str {
        "Parameters"
    }

    fn html(&self) -> String {
        let mut html = String::from(
            "<div class=\"wide\"><table>\n<tr><th class=\"word\">parameter</th><th class=\"word\">unit</th>",
        );
        for (name, fitted) in self.names.iter().zip(&self.fitted) {
            let _ = write!(html, "<th>{}</th>", escaped(name));
            html.push_str(if *fitted { "<th>\u{b1}</th><th class=\"word\"></th>" } else { "" });
        }
        html.push_str("</tr>\n");
        for row in &self.rows {
            let _ = write!(
                html,
                "<tr><td class=\"word\"><code>{}</code></td><td class=\"word\">{}</td>",
                escaped(&row.name),
                escaped(&row.unit)
            );
            for (cell, fitted) in row.cells.iter().zip(&self.fitted) {
                let none = || number(f64::NAN);
                let _ = write!(html, "<td>{}</td>", cell.map_or_else(none, |cell| number(cell.value)));
                if *fitted {
                    let error = cell.and_then(|cell| cell.std_error).map_or_else(none, number);
                    let standing = cell.map_or(Standing::NotFitted, |cell| cell.standing);
                    let class = if standing == Standing::NotFitted { "faint" } else { "bad" };
                    let flag = if cell.is_some() { standing.flag() } else { "" };
                    let _ =
                        write!(html, "<td>{error}</td><td class=\"word\"><span class=\"{class}\">{flag}</span></td>");
                }
            }
            html.push_str("</tr>\n");
        }
        html.push_str(
            "</table></div>\n<p class=\"note\">\u{b1}: one standard deviation, from the fit's Hessian and what it left. \
             Not alone: the logs determine it only together with others, and it stays near its start. At its bound: the \
             bound holds it, not the logs.</p>\n",
        );
        html
    }
}

/// How far a model is off, per run and joint.
#[derive(Debug, Clone)]
pub struct Accuracy<'a> {
    /// Heading.
    pub title: String,
    /// The runs.
    pub comparison: &'a Comparison,
    /// Whether the torque error is reported too.
    pub with_torque: bool,
}

impl Section for Accuracy<'_> {
    fn title(&self) -> &str {
        &self.title
    }

    fn html(&self) -> String {
        let mut html = String::from(
            "<div class=\"wide\"><table>\n<tr><th class=\"word\">run</th><th class=\"word\">role</th><th>joint</th>\
             <th>RMS</th><th>noise</th><th>RMS / noise</th><th>largest</th><th>fit %</th><th class=\"word\">white</th>",
        );
        html.push_str(if self.with_torque { "<th>torque %</th></tr>\n" } else { "</tr>\n" });
        let reported = |value: Option<f64>| number(value.unwrap_or(f64::NAN));
        let percent = |value: Option<f64>| value.map_or_else(|| reported(None), |value| format!("{value:.2}"));
        for run in &self.comparison.runs {
            for joint in &run.joints {
                let ratio = joint.times_noise();
                let white =
                    joint.rmse.map_or_else(|| reported(None), |_| if joint.white { "yes" } else { "no" }.to_owned());
                let _ = write!(
                    html,
                    "<tr><td class=\"word\">{}</td><td class=\"word\">{}</td><td>{}</td><td>{}</td><td>{}</td>\
                     <td>{}</td><td>{}</td><td>{}</td><td class=\"word\">{}</td>",
                    escaped(&run.file),
                    escaped(&run.role),
                    joint.joint,
                    reported(joint.rmse),
                    number(joint.noise_floor),
                    percent(ratio.filter(|ratio| ratio.is_finite())),
                    reported(joint.max_abs),
                    percent(joint.fit_percent),
                    white,
                );
                if self.with_torque {
                    let _ = write!(html, "<td>{}</td>", percent(joint.torque_percent));
                }
                html.push_str("</tr>\n");
            }
        }
        html.push_str(
            "</table></div>\n<p class=\"note\">RMS, noise and largest are of measured minus simulated position [rad or \
             m]; noise is the log's own. White: no pattern is left.",
        );
        html.push_str(if self.with_torque {
            " Torque: commanded minus what the measured motion needs, as a share of it.</p>\n"
        } else {
            "</p>\n"
        });
        for run in &self.comparison.runs {
            for note in dynid_sentences::compare::notes(run) {
                let _ = writeln!(html, "<p class=\"note\">{}: {}</p>", escaped(&run.file), escaped(&note));
            }
        }
        html
    }
}

/// How much of each joint's remaining error comes from which configuration.
#[derive(Debug, Clone)]
pub struct Budget<'a> {
    /// Heading.
    pub title: String,
    /// As a fit along a method recorded them.
    pub shares: &'a [ErrorShare],
}

impl Section for Budget<'_> {
    fn title(&self) -> &str {
        &self.title
    }

    fn html(&self) -> String {
        let mut html = String::from(
            "<div class=\"wide\"><table>\n<tr><th>configuration</th><th>joint</th><th>noise</th><th>residual</th>\
             <th>model off by</th>",
        );
        for source in self.shares.first().map_or(&[][..], |share| &share.from) {
            let _ = write!(html, "<th>from {}</th>", source.configuration);
        }
        html.push_str("<th>from ranges</th></tr>\n");
        for share in self.shares {
            let _ = write!(html, "<tr><td>{}</td><td>{}</td>", share.configuration, share.joint);
            let values = [share.noise_floor, share.rmse, share.remaining];
            let from = share.from.iter().map(|source| source.rms);
            for value in values.into_iter().chain(from).chain([share.range]) {
                let _ = write!(html, "<td>{}</td>", number(value));
            }
            html.push_str("</tr>\n");
        }
        html.push_str(
            "</table></div>\n<p class=\"note\">Root mean squares [rad or m]. Model off by: how far the simulated position \
             may be off for the parameters' uncertainty; the columns after it say which configuration's noise it comes \
             from (their squares add up), and what comes from ranges that no log narrows.</p>\n",
        );
        html
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_stand_side_by_side_with_their_standing() {
        let start = Model::of_device(dynid_model::device("planar2r").expect("a shipped device"));
        let mut fitted = start.clone();
        fitted.set_value("link.1.m", 1.5).expect("a parameter");
        fitted.fit = Some(FitRecord {
            std_error: [("link.1.m".to_owned(), 0.1), ("link.1.x".to_owned(), 0.2)].into(),
            not_identifiable: vec!["link.2.m".to_owned()],
            at_bound: vec!["link.1.x".to_owned()],
            ..FitRecord::default()
        });
        let models = Models::new(&[("start".to_owned(), start), ("<fitted>".to_owned(), fitted)]);
        let reported: Vec<(&str, &str)> =
            models.rows.iter().filter_map(|row| Some((row.name.as_str(), row.cells[1]?.standing.as_str()))).collect();
        assert_eq!(
            reported,
            [("link.1.m", "determined"), ("link.1.x", "held by bound"), ("link.2.m", "not identifiable")],
            "only what the fit moved"
        );
        let html = models.html();
        assert!(html.contains("&lt;fitted&gt;") && html.contains("at its bound") && html.contains("1.500"), "{html}");
    }
}

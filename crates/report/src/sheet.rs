//! One model's parameters with all that is known of each, and the quality of the logs, on a page.

use std::fmt::Write;

use super::{Section, Standing, number};
use dynid_format::escaped;
use dynid_logs::quality::Quality;
use dynid_user_model::Model;

/// The parameters of a model that occur in the runs.
#[derive(Debug, Clone)]
pub struct Sheet<'a> {
    /// The model.
    pub model: &'a Model,
    /// Whether a parameter of this name occurs in the equations of a run.
    pub occurs: Vec<bool>,
}

impl Section for Sheet<'_> {
    fn title(&self) -> &str {
        "Parameters"
    }

    fn html(&self) -> String {
        let mut html = String::from(
            "<div class=\"wide\"><table>\n<tr><th class=\"word\">parameter</th><th class=\"word\">unit</th><th>value</th>\
             <th>\u{b1}</th><th>lower</th><th>upper</th><th class=\"word\"></th></tr>\n",
        );
        let mut n_absent = 0;
        for ((name, parameter), occurs) in self.model.parameters().iter().zip(&self.occurs) {
            if !occurs {
                n_absent += 1;
                continue;
            }
            let fit = self.model.fit.as_ref();
            let error = fit.and_then(|fit| fit.std_error.get(name).copied()).unwrap_or(f64::NAN);
            let standing = fit.map_or(Standing::NotFitted, |fit| Standing::of(fit, name));
            let (class, flag) = match (parameter.fixed, standing) {
                (true, _) => ("faint", "fixed"),
                (false, Standing::NotFitted) => ("faint", "not fitted"),
                (false, Standing::NotAlone) => ("bad", "not identifiable alone"),
                (false, standing) => ("bad", standing.flag()),
            };
            let _ = writeln!(
                html,
                "<tr><td class=\"word\"><code>{}</code></td><td class=\"word\">{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>\
                 <td class=\"word\"><span class=\"{class}\">{flag}</span></td></tr>",
                escaped(name),
                escaped(&self.model.unit(name).unwrap_or_default()),
                number(parameter.value),
                number(error),
                number(parameter.lower),
                number(parameter.upper),
            );
        }
        let _ = writeln!(
            html,
            "</table></div>\n<p class=\"note\">\u{b1}: one standard deviation, from the fit. Not identifiable alone: the logs \
             determine it only together with others, and it stays near its start. At its bound: the bound holds it, not the logs. \
             {n_absent} more parameters do not occur in these runs.</p>"
        );
        html
    }
}

/// What the logs are worth.
#[derive(Debug, Clone)]
pub struct DataQuality {
    /// One a run.
    pub runs: Vec<Quality>,
}

impl Section for DataQuality {
    fn title(&self) -> &str {
        "The logs"
    }

    fn html(&self) -> String {
        let mut html = String::from(
            "<div class=\"wide\"><table>\n<tr><th class=\"word\">run</th><th class=\"word\">role</th><th>samples</th><th>s</th>\
             <th>Hz</th><th>jitter [ms]</th><th>gaps</th><th>joint</th><th>noise</th><th>last digit</th><th>from</th><th>to</th>\
             <th>RMS speed</th><th>reversals</th><th>seen to [Hz]</th><th>command from</th><th>to</th></tr>\n",
        );
        for run in &self.runs {
            for joint in &run.joints {
                let optional = |value: Option<f64>| number(value.unwrap_or(f64::NAN));
                let _ = writeln!(
                    html,
                    "<tr><td class=\"word\">{}</td><td class=\"word\">{}</td><td>{}</td><td>{:.1}</td><td>{:.1}</td><td>{}</td>\
                     <td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>\
                     <td>{}</td></tr>",
                    escaped(&run.run),
                    escaped(&run.role),
                    run.n_samples,
                    run.duration_s,
                    run.rate_hz,
                    if run.jitter_s < 1e-6 / run.rate_hz { "0".to_owned() } else { number(1e3 * run.jitter_s) },
                    run.gaps,
                    joint.joint,
                    number(joint.noise_floor),
                    number(joint.quantum),
                    number(joint.range[0]),
                    number(joint.range[1]),
                    optional(joint.rms_speed),
                    joint.reversals.map_or_else(|| number(f64::NAN), |count| count.to_string()),
                    optional(joint.bandwidth_hz),
                    number(joint.command[0]),
                    number(joint.command[1]),
                );
            }
        }
        html.push_str(
            "</table></div>\n<p class=\"note\">Noise, last digit, from, to: of the measured position [rad or m]; noise is estimated \
             from the log alone. Seen to: the highest frequency at which the motion exceeds its noise.</p>\n",
        );
        for run in &self.runs {
            for warning in &run.warnings {
                let _ = writeln!(
                    html,
                    "<p><span class=\"bad\">\u{26a0}</span> {}: {}</p>",
                    escaped(&run.run),
                    escaped(&dynid_sentences::quality::warning(warning))
                );
            }
        }
        html
    }
}

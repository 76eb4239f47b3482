//! Which effect is missing, and what speaks for and against each.

use dynid_diagnose::{
    Candidate, Diagnosis, DistinguishingExperiment, ErrorLeft, Evidence, Note, Place, Ranked, Rejection, SinePhase,
    Speaks, Statement,
};
use dynid_format::{listed, number};
use serde_json::Value;

use crate::{all, discovered, each, finding};

/// The answer in words.
pub fn sentences(diagnosis: &Diagnosis) -> Vec<String> {
    all(&diagnosis.statements, statement)
}

/// What should be known besides.
pub fn notes(diagnosis: &Diagnosis) -> Vec<String> {
    all(&diagnosis.notes, note)
}

/// What speaks for an effect, or against it.
pub fn evidence_that(speaks: Speaks, ranked: &Ranked) -> Vec<String> {
    ranked.evidence.iter().filter(|own| own.speaks() == speaks).map(evidence).collect()
}

/// A part of the answer.
pub fn statement(statement: &Statement) -> String {
    match statement {
        Statement::ModelLeaves { left } => {
            let left = match left {
                ErrorLeft::NearNoise { times_noise } | ErrorLeft::AboveNoise { times_noise } => {
                    format!("{times_noise:.2} times the noise at the worst joint")
                }
                ErrorLeft::OfTorque { percent } => format!("{percent:.1} % of the torque"),
                ErrorLeft::Unknown => "an error that is not known".to_owned(),
            };
            format!("Refitted, the model leaves {left} on the held-out runs.")
        }
        Statement::OnlyNoise => "Nothing is missing: what is left is noise.".to_owned(),
        Statement::NearNoise => {
            "Nothing is named: what is left is near the noise; it has a pattern, but no effect of the library explains it."
                .to_owned()
        }
        Statement::Missing { candidate, left } => {
            let law = candidate.law().map_or("", |law| law.title.as_str());
            format!("Missing: {candidate} ({law}); with it {}.", left_with(left))
        }
        Statement::CouldAsWellBe { candidates } => {
            let names: Vec<String> = candidates.iter().map(Candidate::to_string).collect();
            format!("It could as well be {}.", names.join(" or "))
        }
        Statement::MoreIsUnexplained => {
            "Something more is left that no effect of the library explains.".to_owned()
        }
        Statement::NoEffectExplains => "No effect of the library explains it.".to_owned(),
        Statement::Nearest { candidate } => {
            format!("The nearest is {candidate}, which explains only part of it.")
        }
        Statement::HeldOutRunsDiffer => {
            "The runs fitted to are explained to their noise; those held out are not, and it was not found why."
                .to_owned()
        }
        Statement::ValuesMoved { most } => format!(
            "No effect is missing: every run by itself is explained to its noise, but not all by the same values; {} \
             moved most ({} by {:+.0} standard errors).",
            most.parameter, most.run, most.change_in_std_errors
        ),
        Statement::BodyCarried { most } => format!(
            "No effect is missing, but {} is explained only with a body that the other runs do not carry: {} is {:.0} \
             standard errors from nothing.",
            most.run,
            most.parameter,
            most.change_in_std_errors.abs()
        ),
        Statement::FormulaExplains { joint, acts_on, formula, percent } => {
            discovered::found(*joint, *acts_on, formula, *percent)
        }
        Statement::NoFormulaExplains => discovered::nothing(),
    }
}

/// What a named effect leaves, as a clause.
fn left_with(left: &ErrorLeft) -> String {
    match left {
        ErrorLeft::NearNoise { times_noise } => format!("{times_noise:.2} times the noise is left"),
        ErrorLeft::AboveNoise { times_noise } => {
            format!("{times_noise:.1} times the noise is left at the worst joint, so that it is not the whole answer")
        }
        ErrorLeft::OfTorque { percent } => format!("{percent:.1} % of the torque is left"),
        ErrorLeft::Unknown => "an error that is not known is left".to_owned(),
    }
}

/// What speaks for or against an effect.
pub fn evidence(evidence: &Evidence) -> String {
    match evidence {
        Evidence::HeldOutFalls { joint, percent } => {
            format!("the squared held-out error of joint {joint} falls by {percent:.1} %")
        }
        Evidence::BicChanges { delta_bic, unknowns } => {
            let counted = format!("{unknowns:.0}");
            let unknowns = if counted == "1" { "unknown" } else { "unknowns" };
            format!("BIC changes by {delta_bic:+.0} on the runs fitted to, {counted} {unknowns} included")
        }
        Evidence::LeavesNoise { times_noise } => {
            format!("what is left is {times_noise:.2} times the noise at the worst joint")
        }
        Evidence::LeavesMore { times_noise } => {
            format!("what is left is still {times_noise:.1} times the noise at the worst joint")
        }
        Evidence::NotDetermined { parameter } => format!("these runs do not determine {parameter}"),
        Evidence::NotConverged { status } => format!("its fit did not converge ({})", status.as_str()),
    }
}

/// Why an effect is given no credit.
pub fn rejection(rejection: &Rejection) -> String {
    match rejection {
        Rejection::NotWorthItsParameters { delta_bic } => {
            format!("on the runs fitted to it is not worth its parameters (BIC changes by {delta_bic:+.0})")
        }
    }
}

/// What should be known of a diagnosis besides.
pub fn note(note: &Note) -> String {
    match note {
        Note::LastPartHeldOut { parts } => format!(
            "no run has the role \"validate\": of every run the last of {parts} equal parts is held out instead. A run of its own \
             would be surer"
        ),
        Note::FittedWithoutTorqueError { reason } => {
            format!("no torque error: {reason}; only simulations tell what a model of it lacks")
        }
        Note::JudgedWithoutTorqueError { reason } => format!("no torque error: {reason}"),
        Note::NeverHeldOut { joints } => {
            let joints: Vec<String> = joints.iter().map(|joint| format!("joint {joint}")).collect();
            format!("{}: free in no held-out run, so judged by the runs that are fitted to", joints.join(", "))
        }
        Note::StandsStill { run, joint, range_in_noises, parameters } => {
            let open = match parameters.is_empty() {
                true => String::new(),
                false => format!(", so it tells little of {}", listed(parameters)),
            };
            format!("{run}: joint {joint} is free but stays within {range_in_noises:.0} times its noise{open}")
        }
        Note::StraightCommand { rmse_straight, rmse_standing } => {
            let error = |rmse: &Option<f64>| rmse.map_or_else(|| "?".to_owned(), number);
            format!(
                "the logs show a command that runs straight from sample to sample, not one that stands still between them: with \
                 it the refitted model leaves {} of the held-out runs instead of {}, and all that follows takes it so; say hold = \
                 \"linear\" in the experiment",
                error(rmse_straight),
                error(rmse_standing)
            )
        }
        Note::LinksNotDetermined { links } => format!(
            "these runs do not determine {}, only in combinations: `dynid plan` says which can be identified",
            of_links(*links)
        ),
        Note::NotDetermined { parameters, links, joints, still, range_in_noises } => {
            let and = if *links > 0 { format!(", nor {}", of_links(*links)) } else { String::new() };
            let why = match still.len() {
                0 => String::new(),
                count => {
                    let stay = if count == 1 { "stays" } else { "stay" };
                    format!("{} {stay} within {range_in_noises:.0} times the noise in every run; ", numbered(still))
                }
            };
            let what = if joints.is_empty() { "the joints".to_owned() } else { numbered(joints) };
            format!(
                "these runs do not determine {}{and}: {why}excite {what} more, both ways, slowly and fast, over more of the range \
                 (`dynid excite`)",
                listed(parameters)
            )
        }
    }
}

fn of_links(parameters: usize) -> String {
    match parameters {
        1 => "one parameter of the links by itself".to_owned(),
        count => format!("{count} parameters of the links by themselves"),
    }
}

/// `joint 4`, `joints 4, 5`
fn numbered(joints: &[usize]) -> String {
    let numbers: Vec<String> = joints.iter().map(usize::to_string).collect();
    format!("{} {}", if joints.len() == 1 { "joint" } else { "joints" }, numbers.join(", "))
}

/// What would tell an effect from another that fits as well.
pub fn experiment(experiment: &DistinguishingExperiment) -> String {
    match experiment {
        DistinguishingExperiment::Sine {
            locked,
            joint,
            amplitude,
            unit,
            frequency_hz,
            phase,
            from,
            times_noise,
            duration_s,
        } => {
            let wave = match phase {
                SinePhase::Zero => "sin",
                SinePhase::Quarter => "cos",
            };
            let locked: Vec<String> = locked.iter().map(usize::to_string).collect();
            let lock = match locked.is_empty() {
                true => "leave all joints free".to_owned(),
                false => format!("lock the joints {}", locked.join(", ")),
            };
            format!(
                "{lock} and command {} {unit} * {wave}(2 pi * {frequency_hz:.2} Hz * t) at joint {joint}: there it differs from \
                 {from} by {times_noise:.0} times the noise (root mean square over {duration_s} s)",
                number(*amplitude)
            )
        }
        DistinguishingExperiment::NoneFound { from, times_noise } => format!(
            "none of the sines tried tells it from {from}: at best they differ by {times_noise:.1} times the noise"
        ),
    }
}

/// Where the model fails.
pub fn place(place: &Place) -> String {
    let likewise = match place.also_in.is_empty() {
        true => String::new(),
        false => format!("; likewise in {}", place.also_in.join(", ")),
    };
    finding::sentence(&place.finding) + &likewise
}

/// The diagnosis.
///
/// # Errors
/// None that these values can cause.
pub fn json(diagnosis: &Diagnosis) -> serde_json::Result<Value> {
    let mut json = serde_json::to_value(diagnosis)?;
    json["sentences"] = sentences(diagnosis).into();
    json["notes"] = notes(diagnosis).into();
    each(&mut json, "ranking", &diagnosis.ranking, |ranked, json| {
        json["evidence_for"] = evidence_that(Speaks::For, ranked).into();
        json["evidence_against"] = evidence_that(Speaks::Against, ranked).into();
        json["experiment"] = ranked.experiment.as_ref().map(experiment).into();
        Ok(())
    })?;
    each(&mut json, "refused", &diagnosis.rejected, |rejected, json| {
        json["reason"] = rejection(&rejected.reason).into();
        Ok(())
    })?;
    each(&mut json, "where", &diagnosis.places, |own, json| {
        finding::put(&own.finding, json);
        json["what"] = place(own).into();
        Ok(())
    })?;
    Ok(json)
}

#[cfg(test)]
mod tests;

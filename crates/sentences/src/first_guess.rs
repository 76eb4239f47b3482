//! What logs suggest of an experiment, each guess with its reason.

use dynid_check::{FindingKind, finding::DegreesBecause};
use dynid_first_guess::{
    ColumnGuess, Factor, FactorReason, FirstGuess, Quantity, Remark, RoleReason, WhyColumn, WhyFree,
};
use dynid_format::number;
use serde_json::Value;

use crate::{all, check, each};

/// Why a column was taken for what it is.
pub fn column(own: &ColumnGuess) -> String {
    let why = match &own.why {
        WhyColumn::Said => "said with --column".to_owned(),
        WhyColumn::OwnName => "dynid's own name".to_owned(),
        WhyColumn::Number { number, first } => format!("number {number}, where joint 0 is {first}"),
        WhyColumn::Title { title } => format!("named after {title}"),
        WhyColumn::OnlyOne => "by its name".to_owned(),
        WhyColumn::Order => "no joint is named: in the order of the columns".to_owned(),
        WhyColumn::RisesEvenly => "nothing is named a time, and this rises evenly".to_owned(),
        WhyColumn::IsFollowed => "a command that the position follows: a reference".to_owned(),
        WhyColumn::IsNotFollowed => "a command that the position does not follow: a torque".to_owned(),
    };
    match own.others.as_slice() {
        [] => why,
        others => {
            let others: Vec<String> = others.iter().map(|other| format!("`{other}`")).collect();
            format!("{why}; or {}?", others.join(", "))
        }
    }
}

/// Why a column of the project's name has a factor.
pub fn factor(own: &ColumnGuess, factor: &Factor) -> String {
    let joint = own.joint().map_or(String::new(), |joint| joint.to_string());
    match &factor.reason {
        FactorReason::UnitInName { unit } => format!("in {unit}, as its name says"),
        FactorReason::SampleRate { unit, step, rate_hz } => {
            format!("in {unit}: then its steps of {} make {} Hz", number(*step), number(*rate_hz))
        }
        FactorReason::Speed { column, ratio } => format!(
            "{}: only so the position changes as `{column}` says ({} times as much as logged)",
            if own.kind() == "t" { "not in s" } else { "in degrees" },
            number(*ratio)
        ),
        FactorReason::Turn { turn } => format!("it begins anew after {}: that is a turn", number(*turn)),
        FactorReason::Needed { quantity, correlation } => format!(
            "a {}: the torque that the device's own values need for the motion, per unit of it (correlation {}). A guess: better is \
             the motor's constant times the gear ratio",
            named(*quantity),
            number(*correlation)
        ),
        FactorReason::Finding { finding } => match finding {
            FindingKind::Degrees { largest, because: DegreesBecause::Limits { lower, upper } } => format!(
                "in degrees: a position reaches {}, the joint only {} to {} rad",
                number(*largest),
                number(*lower),
                number(*upper)
            ),
            FindingKind::Degrees { because: DegreesBecause::Torque { ratio, ratio_as_degrees }, .. } => format!(
                "in degrees: then a torque is {} times what the motion needs, in radians {} times",
                number(*ratio_as_degrees),
                number(*ratio)
            ),
            FindingKind::Thousand { factor } => {
                format!("in thousandths: a torque is {} times what the motion needs", number(*factor))
            }
            FindingKind::WrongSign { correlation, .. } => format!(
                "sign turned: it goes against what the motion needs (correlation {}) and takes energy out of it. Is it the position \
                 that is wrong? Then q{joint} = -1 instead",
                number(*correlation)
            ),
            other => {
                check::finding(&dynid_check::Finding { run: String::new(), joint: own.joint(), kind: other.clone() })
            }
        },
    }
}

/// Why joints are taken for free.
pub fn free(why: WhyFree) -> &'static str {
    match why {
        WhyFree::Said => "said with --free",
        WhyFree::Moves => "they move by more than their noise",
    }
}

/// Why a run is for fitting or held out.
pub fn role(why: &RoleReason) -> String {
    match why {
        RoleReason::Name { word } => format!("its name says `{word}`"),
        RoleReason::Last => "the last of the logs with these joints, about a fifth".to_owned(),
        RoleReason::LastQuarter => "the last quarter of a single log".to_owned(),
        RoleReason::Rest => "not held out".to_owned(),
        RoleReason::NothingToHoldOut => {
            "nothing can be held out: log one more run in which the same joints move".to_owned()
        }
    }
}

/// What was seen beside the guesses.
pub fn remark(remark: &Remark) -> String {
    match remark {
        Remark::ClosedLoop { correlation } => format!(
            "Closed loop: the positions follow references (correlation {}). The logged torque is what acts; a file of the \
             controller, `controller`, is needed only to simulate the loop.",
            number(*correlation)
        ),
        Remark::OpenLoop => {
            "No column is a reference that the positions follow: taken for open loop, moved by the logged torque."
                .to_owned()
        }
        Remark::JoinedTopics { log, clock, others, left_out } => {
            let cut = match left_out {
                0 => String::new(),
                count => {
                    format!(" {count} of its messages are left out, because another topic had not begun or had ended.")
                }
            };
            format!(
                "{log}: each row is a message of {clock}. Of {} the positions are taken from the straight line between two messages, \
                 all else from the message before.{cut}",
                others.join(", ")
            )
        }
        Remark::TimeOfLogging { log } => {
            format!("{log}: some messages have no stamp, so the time of each is that at which it was logged.")
        }
        Remark::OtherLengths { log, n_rows, names } => format!(
            "{log}: {} cannot be columns: the others have {n_rows} values.",
            names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
        ),
        Remark::RepeatedTimes { log, count, percent } => format!(
            "{log}: {count} rows ({percent:.1} %) have the time of the row before; they are left out. Log the time with more digits, \
             if that is why."
        ),
        Remark::SpeedOfOtherJoint { column, joint, fits } => format!(
            "`{column}` should be the speed of joint {joint}, but goes with the position of joint {fits}: are the joints' columns \
             exchanged?"
        ),
        Remark::SpeedAgainstPosition { column, joint } => format!(
            "`{column}` goes against the position of joint {joint}: one of them has the wrong sign. If it is the position, write \
             q{joint} = -1 under [scale]."
        ),
        Remark::UnknownFactor { column, quantity, joint } => format!(
            "`{column}` is a {}, and the motion does not tell how much torque it makes: write tau{joint} = motor constant times gear \
             ratio under [scale].",
            named(*quantity)
        ),
        Remark::UnitOfOther { column, unit, logical } => format!(
            "`{column}` is taken for {logical}, of which {unit} is no unit: it has no factor. If it is {logical}, write one under [scale]; \
             else name the right column with `--column {logical}=NAME`."
        ),
        Remark::RowsFarApart { column, step_s } => format!(
            "`{column}` is dynid's own name, so it is taken to be in s; then rows are {} s apart. If it is in ms, write {column} = 1e-3 under \
             [scale].",
            number(*step_s)
        ),
        Remark::NeverMoves { joints } => {
            let joints: Vec<String> = joints.iter().map(usize::to_string).collect();
            format!("In no log moves joint {}: taken for locked.", joints.join(", "))
        }
    }
}

fn named(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::Time => "time",
        Quantity::Position => "position",
        Quantity::Speed => "speed",
        Quantity::Acceleration => "acceleration",
        Quantity::Torque => "torque",
        Quantity::Current => "current",
        Quantity::Voltage => "voltage",
    }
}

/// All guesses, each with its sentence beside it.
///
/// # Errors
/// None that these values can cause.
pub fn json(guess: &FirstGuess) -> serde_json::Result<Value> {
    let mut json = serde_json::to_value(guess)?;
    json["remarks"] = all(&guess.remarks, remark).into();
    each(&mut json, "columns", &guess.columns, |own, entry| {
        entry["what"] = column(own).into();
        entry["scale"] = own.scale().into();
        each(entry, "factors", &own.factors, |one, entry| {
            entry["what"] = factor(own, one).into();
            Ok(())
        })
    })?;
    each(&mut json, "runs", &guess.runs, |own, entry| {
        entry["what"] = role(&own.why).into();
        Ok(())
    })?;
    each(&mut json, "findings", &guess.findings, |own, entry| {
        entry["what"] = check::finding(own).into();
        Ok(())
    })?;
    Ok(json)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn torque(reason: FactorReason) -> (ColumnGuess, Factor) {
        let factor = Factor { factor: -1.0, reason };
        let own = ColumnGuess {
            logical: "tau1".to_owned(),
            name: "effort_1".to_owned(),
            why: WhyColumn::Number { number: 1, first: 0 },
            others: vec!["cmd_1".to_owned()],
            factors: vec![factor.clone()],
            turn: None,
        };
        (own, factor)
    }

    #[test]
    fn a_guess_says_its_reason_and_what_else_it_could_be() {
        let finding = FindingKind::WrongSign { correlation: -0.96, mean_power: -0.1 };
        let (own, reason) = torque(FactorReason::Finding { finding });
        assert_eq!(column(&own), "number 1, where joint 0 is 0; or `cmd_1`?");
        let said = factor(&own, &reason);
        assert!(said.starts_with("sign turned: it goes against what the motion needs (correlation −0.9600)"), "{said}");
        assert!(said.ends_with("Then q1 = -1 instead"), "{said}");
        let (own, reason) = torque(FactorReason::Needed { quantity: Quantity::Current, correlation: 0.9 });
        assert!(factor(&own, &reason).starts_with("a current: the torque that the device's own values need"));
        let (own, reason) = torque(FactorReason::SampleRate { unit: "ms", step: 10.0, rate_hz: 100.0 });
        assert_eq!(factor(&own, &reason), "in ms: then its steps of 10.00 make 100.0 Hz");
    }

    #[test]
    fn remarks_name_the_remedy() {
        let said = remark(&Remark::UnknownFactor { column: "i_2".to_owned(), quantity: Quantity::Current, joint: 2 });
        assert!(said.contains("`i_2` is a current") && said.contains("write tau2 = motor constant"), "{said}");
        let said = remark(&Remark::SpeedAgainstPosition { column: "qd0".to_owned(), joint: 0 });
        assert!(said.contains("q0 = -1 under [scale]"), "{said}");
        let (column, logical) = ("q1 [mm]".to_owned(), "q1".to_owned());
        assert_eq!(
            remark(&Remark::UnitOfOther { column, unit: "mm", logical }),
            "`q1 [mm]` is taken for q1, of which mm is no unit: it has no factor. If it is q1, write one under [scale]; else name the \
             right column with `--column q1=NAME`."
        );
        let said = remark(&Remark::RowsFarApart { column: "t".to_owned(), step_s: 10.0 });
        assert!(said.ends_with("rows are 10.00 s apart. If it is in ms, write t = 1e-3 under [scale]."), "{said}");
        let others = vec!["/commands".to_owned()];
        let joined =
            Remark::JoinedTopics { log: "a.mcap".to_owned(), clock: "/states".to_owned(), others, left_out: 2 };
        let said = remark(&joined);
        assert!(said.starts_with("a.mcap: each row is a message of /states. Of /commands the positions"), "{said}");
        assert!(
            said.ends_with("2 of its messages are left out, because another topic had not begun or had ended."),
            "{said}"
        );
        let said = remark(&Remark::RepeatedTimes { log: "a.csv".to_owned(), count: 3, percent: 0.4 });
        assert!(said.starts_with("a.csv: 3 rows (0.4 %)"), "{said}");
    }
}

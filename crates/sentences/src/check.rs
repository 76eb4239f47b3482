//! What logs cannot answer, how to excite what is missing, and what looks wrong in them.

use dynid_check::{
    Checked, Finding, FindingKind, Question, Suggestion, Unanswered, Verdict, finding::DegreesBecause,
    suggestion::Signal,
};
use dynid_dynamics::simulate::Intersample;
use dynid_format::{listed, number};
use serde_json::{Value, json};

use crate::{all, each, quality};

/// The answer in one sentence.
pub fn verdict(checked: &Checked) -> String {
    match checked.verdict {
        Verdict::NothingWrong => {
            "Nothing looks wrong in these logs, and they excite every parameter that they can reveal.".to_owned()
        }
        Verdict::NothingToLearn => {
            let everything = checked.unanswered.iter().find(|own| own.is_everything());
            format!("These logs answer nothing: {}.", everything.map(unanswered).unwrap_or_default())
        }
        Verdict::Warnings => {
            let count = |count: usize, one: &str, many: &str| match count {
                0 => None,
                1 => Some(format!("1 {one}")),
                count => Some(format!("{count} {many}")),
            };
            let open = checked.unanswered.iter().filter(|own| own.is_warning()).count();
            let said: Vec<String> = [
                count(checked.findings.len(), "thing looks wrong", "things look wrong"),
                count(open, "question stays open", "questions stay open"),
            ]
            .into_iter()
            .flatten()
            .collect();
            format!("{}.", said.join(", "))
        }
    }
}

/// What looks wrong, a line each; what is alike in several runs is one line.
pub fn findings(findings: &[Finding]) -> Vec<String> {
    /// Runs that are named.
    const NAMED: usize = 3;
    let mut lines: Vec<String> = Vec::new();
    let alike = |a: &Finding, b: &Finding| {
        a.joint == b.joint && std::mem::discriminant(&a.kind) == std::mem::discriminant(&b.kind)
    };
    for (index, own) in findings.iter().enumerate() {
        if findings[..index].iter().any(|before| alike(before, own)) {
            continue;
        }
        let mut others: Vec<&str> =
            findings[index + 1..].iter().filter(|other| alike(own, other)).map(|other| other.run.as_str()).collect();
        others.retain(|other| *other != own.run);
        others.dedup();
        let also = match others.len() {
            0 => String::new(),
            count if count <= NAMED => format!(" (alike: {})", others.join(", ")),
            count => format!(" (alike: {} and {} more runs)", others[..NAMED].join(", "), count - NAMED),
        };
        lines.push(format!("{}: {}{also}", own.run, finding(own)));
    }
    lines
}

/// Something that looks wrong.
pub fn finding(finding: &Finding) -> String {
    let joint = finding.joint.map_or_else(|| "?".to_owned(), |joint| joint.to_string());
    match &finding.kind {
        FindingKind::Gaps { count: 1, longest_s } => format!("a gap of {} s", number(*longest_s)),
        FindingKind::Gaps { count, longest_s } => format!("{count} gaps, the longest {} s", number(*longest_s)),
        FindingKind::UnevenSampling { percent } => format!("the sample time varies by {percent:.0} % of itself"),
        FindingKind::BunchedSamples { count, shortest_s, typical_s } => format!(
            "{count} rows follow the one before after {} s at least, where {} s are typical: stamps of when they were read, not of \
             when they were sampled?",
            number(*shortest_s),
            number(*typical_s)
        ),
        FindingKind::EncoderWrap { count, jump } => {
            format!(
                "q{joint} jumps {count} times by about {}, a whole turn: the encoder wraps; unwrap it",
                number(*jump)
            )
        }
        FindingKind::RepeatedPositions { percent } => format!(
            "q{joint} stands still from one row to the next in {percent:.0} % of the rows in which the joint moves: it is sampled \
             less often than it is logged"
        ),
        FindingKind::NoNoise { noise, range } => format!(
            "q{joint} moves over {} with noise of {} only: a reference, a simulation or a filtered signal, not a measurement?",
            number(*range),
            number(*noise)
        ),
        FindingKind::CoarseQuantum { quantum, noise, acceleration_percent } => format!(
            "the last digit of q{joint} is {}, above its noise of {}, and makes an error of {acceleration_percent:.0} % of the \
             acceleration: log more digits, or lower cutoff_hz",
            number(*quantum),
            number(*noise)
        ),
        FindingKind::ZeroTorque { needed } => format!(
            "tau{joint} is zero throughout, but the motion needs {} RMS: if the joint was driven, the torque is missing",
            number(*needed)
        ),
        FindingKind::Saturated { levels, percent } => {
            let levels: Vec<String> = levels.iter().map(|level| number(*level)).collect();
            format!("tau{joint} stands at {} for {percent:.0} % of the run: it is cut off there", levels.join(" or "))
        }
        FindingKind::Degrees { largest, because: DegreesBecause::Limits { lower, upper } } => format!(
            "q{joint} reaches {}, and the joint only {} to {} rad: degrees? Then scale = {{ q{joint} = 0.0174533 }}",
            number(*largest),
            number(*lower),
            number(*upper)
        ),
        FindingKind::Degrees { because: DegreesBecause::Torque { ratio, ratio_as_degrees }, .. } => format!(
            "tau{joint} is {} times what the motion needs, and {} times if q{joint} is in degrees: then scale = {{ q{joint} = \
             0.0174533 }}",
            number(*ratio),
            number(*ratio_as_degrees)
        ),
        FindingKind::Thousand { factor } if *factor > 1.0 => format!(
            "tau{joint} is {} times what the motion needs: milli-units? Then scale = {{ tau{joint} = 0.001 }}",
            number(*factor)
        ),
        FindingKind::Thousand { factor } => format!(
            "tau{joint} is {} times what the motion needs: positions in milli-units? Then scale = {{ q{joint} = 0.001 }}",
            number(*factor)
        ),
        FindingKind::WrongSign { correlation, mean_power } => format!(
            "tau{joint} goes against what the motion needs (correlation {}) and takes energy out of it (mean power {}): one of \
             tau{joint} and q{joint} has the wrong sign; scale = {{ tau{joint} = -1 }}",
            number(*correlation),
            number(*mean_power)
        ),
        FindingKind::Delay { samples, delay_s, left_percent, left_percent_shifted } => {
            let (first, later, remedy) = match *samples > 0.0 {
                true => (format!("tau{joint}"), format!("q{joint}"), "; `input_delay` models a late command"),
                false => (format!("q{joint}"), format!("tau{joint}"), ""),
            };
            format!(
                "{later} comes {} samples ({} s) after {first}: with that shift {left_percent_shifted:.1} % of the torque stay \
                 unexplained instead of {left_percent:.1} %{remedy}",
                samples.abs(),
                number(delay_s.abs())
            )
        }
        FindingKind::Hold { looks, left_percent, left_percent_other } => {
            let (how, line) = match looks {
                Intersample::FirstOrder => ("runs straight from sample to sample", "hold = \"linear\""),
                Intersample::ZeroOrder => ("stands still between samples", "hold = \"zero\""),
            };
            format!(
                "tau{joint} looks like a command that {how}: {left_percent_other:.1} % of the torque stay unexplained with {line}, \
                 {left_percent:.1} % without (half a sample of delay looks the same)"
            )
        }
        FindingKind::Contradicts { factor, correlation } => format!(
            "tau{joint} is {} times what the other runs predict for this motion (correlation {}): another unit, sign, load or drive?",
            number(*factor),
            number(*correlation)
        ),
    }
}

/// Something that these logs cannot answer.
pub fn unanswered(unanswered: &Unanswered) -> String {
    match unanswered {
        Unanswered::NothingMoves { joints, range_in_noises } => format!(
            "no joint moves by more than {range_in_noises:.0} times its noise in any run (free: {})",
            numbered(joints)
        ),
        Unanswered::AllTooShort { samples, needed } => {
            format!("the longest run has {samples} samples, and a pattern is told from noise in {needed} at least")
        }
        Unanswered::TooShort { run, samples, needed } => {
            format!("{run}: {samples} samples are too few, {needed} are needed")
        }
        Unanswered::NoTorqueBalance { reason } => format!("no torque balance: {reason}"),
        Unanswered::NeverMoves { joint, range_in_noises, parameters } => {
            let open =
                if parameters.is_empty() { String::new() } else { format!(": nothing tells {}", listed(parameters)) };
            format!("joint {joint} is free but stays within {range_in_noises:.0} times its noise in every run{open}")
        }
        Unanswered::StandsStill { run, joint, range_in_noises } => {
            format!("{run}: joint {joint} is free but stays within {range_in_noises:.0} times its noise")
        }
        Unanswered::NeverFree { joints } => {
            format!("{}: locked in every run, so nothing is learnt of what only they show", numbered(joints))
        }
        Unanswered::FewFrequencies { joint, frequencies_hz, unknowns, determined } => {
            let list: Vec<String> = frequencies_hz.iter().map(|hz| number(*hz)).collect();
            let frequency = if list.len() == 1 { "frequency" } else { "frequencies" };
            format!(
                "joint {joint} moves at {} {frequency} only ({} Hz): that determines {determined} of the {unknowns} unknowns of \
                 its torque",
                list.len(),
                list.join(", ")
            )
        }
        Unanswered::LeftOpen { parameters, of } => {
            /// Parameters that are named with their numbers.
            const NAMED: usize = 6;
            let mut each: Vec<String> = parameters
                .iter()
                .take(NAMED)
                .map(|own| match own.std_error {
                    Some(error) => format!("{} ({} \u{b1} {})", own.name, number(own.value), number(error)),
                    None => format!("{} (not at all)", own.name),
                })
                .collect();
            if parameters.len() > NAMED {
                each.push(format!("and {} more, with --json", parameters.len() - NAMED));
            }
            format!(
                "by the torque error, {} of {of} combinations of parameters would stay uncertain by more than their size: {}",
                parameters.len(),
                each.join(", ")
            )
        }
        Unanswered::NoMotionReveals { fix_one_of, .. } if fix_one_of.len() == 1 => {
            format!("no motion tells {} from what the links do: fix it", fix_one_of[0])
        }
        Unanswered::NoMotionReveals { is_scale, fix_one_of } => {
            let what = if *is_scale { "the scale that is shared by" } else { "a direction among" };
            format!("no motion tells {what} {}: fix one of them", listed(fix_one_of))
        }
    }
}

/// What was asked, as it is where nothing looks wrong.
pub fn question(question: Question) -> &'static str {
    match question {
        Question::TimeStamps => "Time stamps are even and complete",
        Question::Positions => "Positions are measured, finely and without jumps",
        Question::Commands => "Commands are there and not cut off",
        Question::Units => "Units are right",
        Question::Signs => "Signs are right",
        Question::Timing => "Command and position belong to the same time",
        Question::Agreement => "Runs agree with each other",
    }
}

/// What to play.
pub fn suggestion(suggestion: &Suggestion) -> String {
    let Suggestion { free, joints, parameters, from_hz, to_hz, speed, .. } = suggestion;
    let fastest: Vec<String> = free
        .iter()
        .zip(speed)
        .filter(|(joint, _)| joints.contains(joint))
        .filter_map(|(joint, speed)| Some(format!("joint {joint} up to {} per s", number((*speed)?))))
        .collect();
    let range = match &suggestion.signal {
        Signal::Optimised { position, .. } => {
            let ranges = free.iter().zip(position).filter(|(joint, _)| joints.contains(joint));
            let ranges: Vec<String> = ranges
                .map(|(joint, [low, high])| format!("joint {joint} from {} to {}", number(*low), number(*high)))
                .collect();
            format!(", {}", ranges.join(", "))
        }
        Signal::Multisine { .. } => String::new(),
    };
    let speed = if fastest.is_empty() { String::new() } else { format!(", {}", fastest.join(", ")) };
    let why = if parameters.is_empty() { String::new() } else { format!(", for {}", listed(parameters)) };
    format!("move {} between {} and {} Hz{range}{speed}{why}", numbered(joints), number(*from_hz), number(*to_hz))
}

/// The command line that makes it: [`arguments`] as a shell takes them.
pub fn command(suggestion: &Suggestion, model: Option<&str>) -> String {
    dynid_format::shell_line(&arguments(suggestion, model))
}

/// The arguments of `dynid` that make it.
pub fn arguments(suggestion: &Suggestion, model: Option<&str>) -> Vec<String> {
    let Suggestion { device, free, from_hz, to_hz, rate_hz, signal, .. } = suggestion;
    let plain = |value: f64| format!("{}", (value * 1e4).round() / 1e4);
    let list = |each: Vec<String>| each.join(",");
    let joints: Vec<String> = free.iter().map(usize::to_string).collect();
    let mut words = vec!["excite".to_owned()];
    words.extend(model.map(|_| "--model".to_owned()));
    words.push(model.unwrap_or(device).to_owned());
    let mut option = |key: &str, value: String| words.extend([key.to_owned(), value]);
    option("--free", joints.join(","));
    match signal {
        Signal::Optimised { position, as_torque } => {
            option("--signal", "optimised".to_owned());
            option("--period", plain(1.0 / from_hz));
            option("--harmonics", (to_hz / from_hz).round().max(2.0).to_string());
            let ranges = position.iter().map(|[low, high]| format!("{}:{}", plain(*low), plain(*high)));
            // One word: limits may begin with a minus.
            words.push(format!("--position-limits={}", list(ranges.collect())));
            if *as_torque {
                words.extend(["--as", "torque"].map(str::to_owned));
            }
        }
        Signal::Multisine { amplitude } => {
            let amplitudes = amplitude.as_ref().map(|own| list(own.iter().map(|own| plain(*own)).collect()));
            option("--signal", "multisine".to_owned());
            option("--from", plain(*from_hz));
            option("--to", plain(*to_hz));
            option("--amplitude", amplitudes.unwrap_or_else(|| "<AMPLITUDE>".to_owned()));
        }
    }
    let last = ["--rate", &plain(rate_hz.round().max(1.0)), "--out", &format!("excite-{}.csv", joints.join("-"))];
    words.extend(last.map(str::to_owned));
    words
}

fn numbered(joints: &[usize]) -> String {
    let word = if joints.len() == 1 { "joint" } else { "joints" };
    let list: Vec<String> = joints.iter().map(usize::to_string).collect();
    format!("{word} {}", list.join(", "))
}

/// All that a check says.
///
/// # Errors
/// None that these values can cause.
pub fn json(checked: &Checked, model: Option<&str>) -> serde_json::Result<Value> {
    let mut json = serde_json::to_value(checked)?;
    json["what"] = verdict(checked).into();
    json["unanswered"] = all(&checked.unanswered, unanswered).into();
    each(&mut json, "findings", &checked.findings, |own, entry| {
        entry["what"] = finding(own).into();
        entry["question"] = json!(own.kind.question());
        Ok(())
    })?;
    each(&mut json, "questions", &checked.questions, |own, entry| {
        entry["what"] = question(own.question).into();
        Ok(())
    })?;
    each(&mut json, "suggestions", &checked.suggestions, |own, entry| {
        entry["what"] = suggestion(own).into();
        entry["command"] = command(own, model).into();
        entry["arguments"] = arguments(own, model).into();
        Ok(())
    })?;
    json["quality"] = json!(checked.quality.iter().map(quality::json).collect::<serde_json::Result<Vec<Value>>>()?);
    Ok(json)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_check::unanswered::OpenParameter;

    fn said(kind: FindingKind) -> String {
        finding(&Finding { run: "a.csv".to_owned(), joint: Some(1), kind })
    }

    #[test]
    fn every_finding_is_said_with_its_numbers() {
        let kinds = [
            (FindingKind::Gaps { count: 2, longest_s: 0.5 }, "2 gaps, the longest 0.5000 s"),
            (FindingKind::UnevenSampling { percent: 10.2 }, "the sample time varies by 10 % of itself"),
            (FindingKind::BunchedSamples { count: 3, shortest_s: 1e-3, typical_s: 0.02 }, "3 rows follow"),
            (FindingKind::EncoderWrap { count: 4, jump: 6.3 }, "q1 jumps 4 times by about 6.300, a whole turn"),
            (FindingKind::RepeatedPositions { percent: 50.0 }, "in 50 % of the rows in which the joint moves"),
            (FindingKind::NoNoise { noise: 1e-12, range: 2.0 }, "q1 moves over 2.000 with noise of"),
            (
                FindingKind::CoarseQuantum { quantum: 0.02, noise: 0.0, acceleration_percent: 33.0 },
                "makes an error of 33 % of the acceleration",
            ),
            (FindingKind::ZeroTorque { needed: 0.5 }, "tau1 is zero throughout, but the motion needs 0.5000 RMS"),
            (
                FindingKind::Saturated { levels: vec![-0.5, 0.5], percent: 12.0 },
                "tau1 stands at \u{2212}0.5000 or 0.5000 for 12 % of the run",
            ),
            (
                FindingKind::Degrees { largest: 90.0, because: DegreesBecause::Limits { lower: -2.0, upper: 2.0 } },
                "q1 reaches 90.00, and the joint only \u{2212}2.000 to 2.000 rad: degrees?",
            ),
            (
                FindingKind::Degrees {
                    largest: 90.0,
                    because: DegreesBecause::Torque { ratio: 0.02, ratio_as_degrees: 1.0 },
                },
                "scale = { q1 = 0.0174533 }",
            ),
            (FindingKind::Thousand { factor: 980.0 }, "milli-units? Then scale = { tau1 = 0.001 }"),
            (FindingKind::Thousand { factor: 0.0011 }, "positions in milli-units? Then scale = { q1 = 0.001 }"),
            (FindingKind::WrongSign { correlation: -0.9, mean_power: -1.0 }, "scale = { tau1 = -1 }"),
            (
                FindingKind::Delay { samples: 3.0, delay_s: 0.03, left_percent: 9.0, left_percent_shifted: 1.0 },
                "q1 comes 3 samples (0.03000 s) after tau1: with that shift 1.0 % of the torque stay unexplained instead of \
                 9.0 %; `input_delay` models a late command",
            ),
            (
                FindingKind::Delay { samples: -3.0, delay_s: -0.03, left_percent: 9.0, left_percent_shifted: 1.0 },
                "tau1 comes 3 samples (0.03000 s) after q1",
            ),
            (
                FindingKind::Hold { looks: Intersample::FirstOrder, left_percent: 30.0, left_percent_other: 12.0 },
                "12.0 % of the torque stay unexplained with hold = \"linear\", 30.0 % without",
            ),
            (FindingKind::Contradicts { factor: 3.0, correlation: 0.99 }, "tau1 is 3.000 times what the other runs"),
        ];
        for (kind, expected) in kinds {
            let sentence = said(kind);
            assert!(sentence.contains(expected), "{sentence}\n{expected}");
        }
    }

    #[test]
    fn what_is_alike_is_one_line() {
        let gaps = |run: &str| Finding {
            run: run.to_owned(),
            joint: None,
            kind: FindingKind::Gaps { count: 1, longest_s: 0.5 },
        };
        let lines = findings(&[gaps("a.csv"), gaps("b.csv"), gaps("a.csv")]);
        assert_eq!(lines, ["a.csv: a gap of 0.5000 s (alike: b.csv)"]);
    }

    #[test]
    fn every_question_that_stays_open_is_said() {
        let open = |std_error| OpenParameter { name: "joint.1.viscous.Fv".to_owned(), value: 0.1, std_error, joint: 1 };
        let questions = [
            (
                Unanswered::NothingMoves { joints: vec![0, 1], range_in_noises: 10.0 },
                "no joint moves by more than 10 times its noise in any run (free: joints 0, 1)",
            ),
            (Unanswered::AllTooShort { samples: 20, needed: 64 }, "the longest run has 20 samples"),
            (
                Unanswered::TooShort { run: "a.csv".to_owned(), samples: 20, needed: 64 },
                "a.csv: 20 samples are too few, 64 are needed",
            ),
            (
                Unanswered::NeverMoves {
                    joint: 1,
                    range_in_noises: 10.0,
                    parameters: vec!["joint.1.viscous.Fv".to_owned()],
                },
                "in every run: nothing tells joint.1.viscous.Fv",
            ),
            (
                Unanswered::StandsStill { run: "a.csv".to_owned(), joint: 1, range_in_noises: 10.0 },
                "a.csv: joint 1 is free but stays within 10 times its noise",
            ),
            (Unanswered::NeverFree { joints: vec![3] }, "joint 3: locked in every run"),
            (
                Unanswered::FewFrequencies { joint: 1, frequencies_hz: vec![0.5], unknowns: 6, determined: 3 },
                "joint 1 moves at 1 frequency only (0.5000 Hz): that determines 3 of the 6 unknowns of its torque",
            ),
            (
                Unanswered::LeftOpen { parameters: vec![open(Some(0.3)), open(None)], of: 7 },
                "2 of 7 combinations of parameters would stay uncertain by more than their size: joint.1.viscous.Fv (0.1000 \
                 \u{b1} 0.3000), joint.1.viscous.Fv (not at all)",
            ),
            (
                Unanswered::NoMotionReveals { is_scale: true, fix_one_of: vec!["a".to_owned(), "b".to_owned()] },
                "no motion tells the scale that is shared by a, b: fix one of them",
            ),
        ];
        for (typed, expected) in questions {
            let sentence = unanswered(&typed);
            assert!(sentence.contains(expected), "{sentence}\n{expected}");
        }
    }

    #[test]
    fn a_suggestion_is_a_command_that_can_be_typed() {
        let optimised = Suggestion {
            device: "planar2r".to_owned(),
            free: vec![0, 1],
            joints: vec![1],
            parameters: vec!["joint.1.viscous.Fv".to_owned()],
            signal: Signal::Optimised { position: vec![[-1.0, 1.0], [-2.0, 0.0]], as_torque: true },
            from_hz: 0.1,
            to_hz: 1.0,
            speed: vec![None, Some(2.0)],
            rate_hz: 100.0,
        };
        assert_eq!(
            suggestion(&optimised),
            "move joint 1 between 0.1000 and 1.000 Hz, joint 1 from \u{2212}2.000 to 0, joint 1 up to 2.000 per s, for \
             joint.1.viscous.Fv"
        );
        assert_eq!(
            command(&optimised, Some("model.toml")),
            "dynid excite --model model.toml --free 0,1 --signal optimised --period 10 --harmonics 10 \
             --position-limits=-1:1,-2:0 --as torque --rate 100 --out excite-0-1.csv"
        );
        assert_eq!(arguments(&optimised, Some("my model.toml"))[..3], ["excite", "--model", "my model.toml"]);
        let multisine = Suggestion { signal: Signal::Multisine { amplitude: Some(vec![0.5, 0.1]) }, ..optimised };
        assert_eq!(
            command(&multisine, None),
            "dynid excite planar2r --free 0,1 --signal multisine --from 0.1 --to 1 --amplitude 0.5,0.1 --rate 100 --out \
             excite-0-1.csv"
        );
    }
}

//! What logs cannot answer, how to excite what is missing, and what looks wrong in them.

use dynid_check::{
    Checked, Finding, FindingKind, Suggestion, Unanswered, Verdict, finding::DegreesBecause, suggestion::Signal,
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

/// The command line that makes it.
pub fn command(suggestion: &Suggestion, model: Option<&str>) -> String {
    let Suggestion { device, free, from_hz, to_hz, rate_hz, signal, .. } = suggestion;
    let joints: Vec<String> = free.iter().map(usize::to_string).collect();
    let plain = |value: f64| format!("{}", (value * 1e4).round() / 1e4);
    let what = match signal {
        Signal::Optimised { position, as_torque } => {
            let ranges: Vec<String> =
                position.iter().map(|[low, high]| format!("{}:{}", plain(*low), plain(*high))).collect();
            let harmonics = (to_hz / from_hz).round().max(2.0);
            format!(
                "--signal optimised --period {} --harmonics {harmonics} --position-limits={}{}",
                plain(1.0 / from_hz),
                ranges.join(","),
                if *as_torque { " --as torque" } else { "" }
            )
        }
        Signal::Multisine { amplitude } => {
            let amplitude = match amplitude {
                Some(list) => list.iter().map(|own| plain(*own)).collect::<Vec<_>>().join(","),
                None => "<AMPLITUDE>".to_owned(),
            };
            format!("--signal multisine --from {} --to {} --amplitude {amplitude}", plain(*from_hz), plain(*to_hz))
        }
    };
    let model = model.map_or_else(|| device.clone(), |path| format!("--model {path}"));
    format!(
        "dynid excite {model} --free {} {what} --rate {} --out excite-{}.csv",
        joints.join(","),
        plain(rate_hz.round().max(1.0)),
        joints.join("-")
    )
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
        Ok(())
    })?;
    each(&mut json, "suggestions", &checked.suggestions, |own, entry| {
        entry["what"] = suggestion(own).into();
        entry["command"] = command(own, model).into();
        Ok(())
    })?;
    json["quality"] = json!(checked.quality.iter().map(quality::json).collect::<serde_json::Result<Vec<Value>>>()?);
    Ok(json)
}

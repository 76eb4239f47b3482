//! Scores of drawn cases as tables.

use std::collections::BTreeMap;
use std::fmt::Write;

use dynid_plant::hidden::Kind;
use dynid_plant::hidden::draw::{Drive, SHOWS};
use dynid_plant::hidden::score::{Outcome, WHOLE};

/// Of the table with a [`row`] a case.
pub const HEADER: &str = "| case | hidden | verdict | first | rank | whole | s | |\n\
                          | --- | --- | --- | --- | --- | --- | --- | --- |";

const DASH: &str = "\u{2014}";

/// One case.
pub fn row(outcome: &Outcome) -> String {
    let score = &outcome.score;
    let hidden = if outcome.hidden.is_empty() { DASH.to_owned() } else { outcome.hidden.join(", ") };
    let mut judged = if score.right { "right" } else { "WRONG" }.to_owned();
    match score.discovered {
        Some(true) => judged.push_str(", discovered"),
        Some(false) => judged.push_str(", not discovered"),
        None => {}
    }
    let rank = score.rank.map_or_else(|| DASH.to_owned(), |rank| rank.to_string());
    let whole = score.is_whole.map_or(DASH, |is_whole| if is_whole { "yes" } else { "no" });
    let first = score.first.as_deref().unwrap_or(DASH);
    let seconds = outcome.seconds;
    format!(
        "| {} | {hidden} | {} | {first} | {rank} | {whole} | {seconds:.1} | {judged} |",
        outcome.name, score.verdict
    )
}

/// `docs/hidden-effects.md`.
pub fn page(outcomes: &[Outcome], jobs: usize) -> String {
    let mut text = head(outcomes, jobs);
    text.push_str(&by_kind(outcomes));
    text.push_str(&error_bars(outcomes));
    let single: Vec<&Outcome> = of(outcomes, |outcome| outcome.kind == Kind::Hidden);
    let all: Vec<&Outcome> = outcomes.iter().collect();
    text.push_str("\n## By effect\n\nSingle effects of the library.\n\n");
    text.push_str(&groups("effect", &single, &|outcome| outcome.effects.join(", ")));
    text.push_str("\nLaws that no library has; right is to say so.\n\n");
    let outside = of(outcomes, |outcome| outcome.kind == Kind::Outside);
    text.push_str(&groups("law", &outside, &|outcome| outcome.effects.join(", ")));
    text.push_str("\n## By instrument\n\nCases of all kinds.\n\n");
    text.push_str(&groups("sample rate", &all, &|outcome| rate(outcome.instrument.rate_hz).to_owned()));
    text.push('\n');
    text.push_str(&groups("position noise", &all, &|outcome| noise(outcome.instrument.noise_rms).to_owned()));
    text.push('\n');
    text.push_str(&groups("encoder quantum", &all, &|outcome| quantum(outcome).to_owned()));
    text.push('\n');
    text.push_str(&groups("loop", &all, &|outcome| drive(outcome).to_owned()));
    text.push('\n');
    text.push_str(&groups("runs", &all, &|outcome| runs(outcome.instrument.n_runs).to_owned()));
    text.push_str("\n## By device\n\n");
    text.push_str(&groups("device", &all, &|outcome| outcome.device.clone()));
    text.push('\n');
    text.push_str(&groups("arms", &all, &|outcome| arm(outcome).to_owned()));
    text.push_str("\n## Seconds\n\n");
    text.push_str(&seconds(outcomes));
    text.push_str("\n## Wrong answers\n\n");
    let _ = writeln!(text, "{HEADER}");
    for outcome in outcomes.iter().filter(|outcome| !outcome.score.right) {
        let _ = writeln!(text, "{}", row(outcome));
    }
    text
}

fn head(outcomes: &[Outcome], jobs: usize) -> String {
    let mut draws: Vec<String> = outcomes.iter().map(|outcome| outcome.draw.to_string()).collect();
    draws.dedup();
    let mut commits: Vec<&str> = outcomes.iter().map(|outcome| outcome.commit.as_str()).collect();
    commits.sort_unstable();
    commits.dedup();
    let timeout = outcomes.iter().map(|outcome| outcome.timeout_s).fold(0.0, f64::max);
    format!(
        "# Hidden effects\n\n\
         Written by `cargo xtask hidden-effects --draw {} --write-docs`; do not edit.\n\
         Machine, instrument, belief and what is hidden are drawn at random, {} cases in all; each is one call of `dynid diagnose` \
         with default options on a model that was not fitted.\n\
         Commit {}; {jobs} at a time; no answer in {timeout:.0} s counts as wrong.\n\n\
         An effect is hidden where the logs show its amplitude by at least {SHOWS:.0} standard errors \
         (`tests/plant/src/hidden/draw/visibility.rs` says how that is reckoned).\n\
         Right is the true effect first, at its place or at one that is the same physically; whole, that at most {WHOLE} times the \
         noise is left then.\n",
        draws.join(","),
        outcomes.len(),
        commits.join(", "),
    )
}

fn by_kind(outcomes: &[Outcome]) -> String {
    let mut text = "\n## By what is asked\n\n\
                    | asked | cases | right | first | in the first three | whole | formula holds the term |\n\
                    | --- | --- | --- | --- | --- | --- | --- |\n"
        .to_owned();
    for (kind, asked) in [
        (Kind::Hidden, "one effect is missing"),
        (Kind::Nothing, "nothing is missing"),
        (Kind::Outside, "a law of no library is missing"),
        (Kind::TwoAtOnce, "two effects are missing"),
        (Kind::PayloadInOneRun, "a body is carried in one run"),
    ] {
        let cases = of(outcomes, |outcome| outcome.kind == kind);
        let has_effect = matches!(kind, Kind::Hidden | Kind::TwoAtOnce);
        let count = |is: &dyn Fn(&Outcome) -> bool| cases.iter().filter(|outcome| is(outcome)).count();
        let ranked = |most: usize| {
            let n = count(&|outcome| outcome.score.rank.is_some_and(|rank| rank <= most));
            if has_effect { share(n, cases.len()) } else { DASH.to_owned() }
        };
        let named = count(&|outcome| outcome.score.right && outcome.score.is_whole.is_some());
        let whole = count(&|outcome| outcome.score.right && outcome.score.is_whole == Some(true));
        let asked_for = count(&|outcome| outcome.score.discovered.is_some());
        let discovered = count(&|outcome| outcome.score.discovered == Some(true));
        let _ = writeln!(
            text,
            "| {asked} | {} | {} | {} | {} | {} | {} |",
            cases.len(),
            share(count(&|outcome| outcome.score.right), cases.len()),
            ranked(1),
            ranked(3),
            share(whole, named),
            share(discovered, asked_for)
        );
    }
    let two = of(outcomes, |outcome| outcome.kind == Kind::TwoAtOnce);
    let one = two.iter().filter(|outcome| outcome.score.n_found >= 1).count();
    let _ = writeln!(text, "\nOf two effects at least one is named in {}.", share(one, two.len()));
    text
}

fn error_bars(outcomes: &[Outcome]) -> String {
    let covered: usize = outcomes.iter().map(|outcome| outcome.score.n_covered).sum();
    let all: usize = outcomes.iter().map(|outcome| outcome.score.n_error_bars).sum();
    format!(
        "\n## Error bars\n\nOf effects that are named rightly, {} true values lie within 1.96 standard errors of the estimate \
         (95 % would, were all errors as stated).\n",
        share(covered, all)
    )
}

fn seconds(outcomes: &[Outcome]) -> String {
    let mut text = "| free joints | cases | median | worst | no answer |\n| --- | --- | --- | --- | --- |\n".to_owned();
    let mut groups: BTreeMap<usize, Vec<&Outcome>> = BTreeMap::new();
    for outcome in outcomes {
        groups.entry(outcome.n_free).or_default().push(outcome);
    }
    for (n_free, cases) in groups {
        let unanswered = cases.iter().filter(|outcome| !outcome.score.is_answered).count();
        let (median, worst) = median_and_worst(&cases);
        let _ = writeln!(text, "| {n_free} | {} | {median:.1} | {worst:.1} | {unanswered} |", cases.len());
    }
    text
}

/// A row for every group of cases, by name.
fn groups(what: &str, outcomes: &[&Outcome], name: &dyn Fn(&Outcome) -> String) -> String {
    let mut text = format!(
        "| {what} | cases | right | in the first three | true values in their error bars | median s |\n\
         | --- | --- | --- | --- | --- | --- |\n"
    );
    let mut groups: BTreeMap<String, Vec<&Outcome>> = BTreeMap::new();
    for outcome in outcomes {
        groups.entry(name(outcome)).or_default().push(outcome);
    }
    for (name, cases) in groups {
        let right = cases.iter().filter(|outcome| outcome.score.right).count();
        let with_effect: Vec<&&Outcome> =
            cases.iter().filter(|outcome| matches!(outcome.kind, Kind::Hidden | Kind::TwoAtOnce)).collect();
        let in_three = with_effect.iter().filter(|outcome| outcome.score.rank.is_some_and(|rank| rank <= 3)).count();
        let covered = cases.iter().map(|outcome| outcome.score.n_covered).sum();
        let error_bars = cases.iter().map(|outcome| outcome.score.n_error_bars).sum();
        let _ = writeln!(
            text,
            "| {name} | {} | {} | {} | {} | {:.1} |",
            cases.len(),
            share(right, cases.len()),
            share(in_three, with_effect.len()),
            share(covered, error_bars),
            median_and_worst(&cases).0
        );
    }
    text
}

fn of(outcomes: &[Outcome], is: impl Fn(&Outcome) -> bool) -> Vec<&Outcome> {
    outcomes.iter().filter(|outcome| is(outcome)).collect()
}

fn share(count: usize, of: usize) -> String {
    if of == 0 {
        return DASH.to_owned();
    }
    format!("{count} of {of} ({:.0} %)", 100.0 * count as f64 / of as f64)
}

fn median_and_worst(outcomes: &[&Outcome]) -> (f64, f64) {
    let mut seconds: Vec<f64> = outcomes.iter().map(|outcome| outcome.seconds).collect();
    seconds.sort_by(f64::total_cmp);
    let at = |index: usize| seconds.get(index).copied().unwrap_or(0.0);
    (at(seconds.len() / 2), at(seconds.len().saturating_sub(1)))
}

// Names of groups begin so that they sort by size.

fn rate(hz: f64) -> &'static str {
    match hz {
        ..100.0 => "050 to 100 Hz",
        ..200.0 => "100 to 200 Hz",
        ..500.0 => "200 to 500 Hz",
        _ => "500 to 1000 Hz",
    }
}

fn noise(rms: f64) -> &'static str {
    match rms {
        ..5e-5 => "1: 1e-5 to 5e-5",
        ..2e-4 => "2: 5e-5 to 2e-4",
        ..7e-4 => "3: 2e-4 to 7e-4",
        _ => "4: 7e-4 to 2e-3",
    }
}

fn quantum(outcome: &Outcome) -> &'static str {
    let instrument = &outcome.instrument;
    match instrument.quantum {
        0.0 => "1: none",
        quantum if quantum < instrument.noise_rms => "2: below the noise",
        quantum if quantum < 4.0 * instrument.noise_rms => "3: one to four times the noise",
        _ => "4: above four times the noise",
    }
}

fn drive(outcome: &Outcome) -> &'static str {
    let instrument = &outcome.instrument;
    match (instrument.drive, instrument.torque_is_scaled) {
        (Drive::OpenLoop, _) => "open",
        (Drive::ClosedLoop, _) if instrument.torque_noise == 0.0 => "closed, torque as commanded",
        (Drive::ClosedLoop, false) => "closed, torque measured",
        (Drive::ClosedLoop, true) => "closed, torque measured in a unit that is not quite known",
    }
}

fn runs(n_runs: usize) -> &'static str {
    match n_runs {
        1 => "1, none held out",
        2..=3 => "2 to 3",
        _ => "4 to 6",
    }
}

fn arm(outcome: &Outcome) -> &'static str {
    let is_closed = outcome.instrument.drive == Drive::ClosedLoop;
    if outcome.n_free >= 5 && is_closed { "five joints or more in closed loop" } else { "all others" }
}

//! What one call of `dynid diagnose` on a drawn case is worth.

use dynid_model::Origin;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::draw::{DrawnCase, HiddenEffect, Instrument};
use super::trial::{discovers, spot};
use super::{Kind, Spot};

/// An answer is the whole one if it leaves at most this many noises at the worst joint.
pub const WHOLE: f64 = 1.3;
/// True values lie within so many standard errors in 95 of 100 cases.
const COVERS: f64 = 1.96;

/// What an answer is worth.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// As `diagnose` says it; else why there is none.
    pub verdict: String,
    /// Whether the program answered.
    pub is_answered: bool,
    /// What it ranks first.
    pub first: Option<String>,
    /// Place of a right answer in its ranking, from 1.
    pub rank: Option<usize>,
    /// Whether the answer is right: a hidden effect comes first at its place, or at one that is the same physically; both of two are
    /// found; the verdict is right where the library has no answer; the run that carries a body is named.
    pub right: bool,
    /// Whether what is ranked first leaves only noise; `None` where nothing is named, or the program does not know.
    pub is_whole: Option<bool>,
    /// Whether the formula that is discovered holds the term it must; `None` where that is not asked.
    pub discovered: Option<bool>,
    /// How many of the hidden effects are found, one after the other.
    pub n_found: usize,
    /// How many of the right effect's true values lie within their error bars.
    pub n_covered: usize,
    /// How many of them have error bars.
    pub n_error_bars: usize,
}

impl Score {
    /// Of no answer: it failed, or took too long.
    pub fn without_answer(reason: &str) -> Self {
        Self { verdict: reason.to_owned(), ..Self::default() }
    }

    /// Of the diagnosis as JSON.
    ///
    /// # Errors
    /// What is no diagnosis.
    pub fn of(case: &DrawnCase, diagnosis: &Value) -> Result<Self, String> {
        let verdict = diagnosis["verdict"].as_str().ok_or("diagnose says no `verdict`")?.to_owned();
        let ranking = diagnosis["ranking"].as_array().ok_or("diagnose says no `ranking`")?;
        let spots = ranking.iter().map(spot).collect::<Result<Vec<Spot>, String>>()?;
        let is_right = |spot: &Spot| case.hidden.iter().any(|hidden| hidden.accepted.contains(spot));
        let rank = spots.iter().position(is_right).map(|index| index + 1);
        let is_named = verdict == "missing_effect";
        let found = if is_named { found(ranking, &spots) } else { Vec::new() };
        let is_found = |hidden: &&HiddenEffect| found.iter().any(|(spot, _)| hidden.accepted.contains(spot));
        let n_found = case.hidden.iter().filter(is_found).count();
        let right = match case.card.kind {
            Kind::Hidden => is_named && rank == Some(1),
            Kind::TwoAtOnce => n_found == case.hidden.len(),
            Kind::Nothing => verdict == "nothing_missing" && diagnosis["moved"].as_array().is_none_or(Vec::is_empty),
            Kind::Outside => verdict == "unexplained",
            Kind::PayloadInOneRun => {
                let moved = diagnosis["moved"][0]["run"].as_str();
                verdict == "nothing_missing" && moved.is_some() && moved == case.run_with_payload.as_deref()
            }
        };
        let is_asked = case.card.kind == Kind::Outside && !case.terms.is_empty() && verdict == "unexplained";
        let is_whole = match (is_named, found.last().and_then(|(_, entry)| entry["worst_ratio_after"].as_f64())) {
            (true, Some(ratio)) => Some(ratio <= WHOLE),
            _ => None,
        };
        let mut score = Self {
            verdict,
            is_answered: true,
            first: spots.first().map(ToString::to_string),
            rank,
            right,
            is_whole,
            discovered: is_asked.then(|| discovers(&case.terms, &diagnosis["discovered"])),
            n_found,
            n_covered: 0,
            n_error_bars: 0,
        };
        for hidden in &case.hidden {
            if let Some((_, entry)) = found.iter().find(|(spot, _)| hidden.accepted.contains(spot)) {
                score.count_error_bars(hidden, entry);
            }
        }
        Ok(score)
    }

    /// Of the effect's own physical parameters, named e.g. `joint.3.lugre.sigma0`.
    fn count_error_bars(&mut self, hidden: &HiddenEffect, entry: &Value) {
        let effect = dynid_model::effect(&hidden.entry.id);
        for parameter in entry["parameters"].as_array().into_iter().flatten() {
            let symbol = parameter["name"].as_str().and_then(|name| name.rsplit('.').next()).unwrap_or_default();
            let is_physical = effect
                .and_then(|effect| effect.parameter(symbol))
                .is_some_and(|parameter| parameter.origin != Origin::Numerical);
            if let (true, Some(truth), Some(value), Some(error)) = (
                is_physical,
                hidden.entry.values.get(symbol),
                parameter["value"].as_f64(),
                parameter["std_error"].as_f64(),
            ) {
                self.n_error_bars += 1;
                self.n_covered += usize::from((value - truth).abs() <= COVERS * error);
            }
        }
    }
}

/// What a search found, one effect after the other: the first of every depth.
fn found<'a>(ranking: &'a [Value], spots: &[Spot]) -> Vec<(Spot, &'a Value)> {
    let mut depths = Vec::new();
    let mut found = Vec::new();
    for (entry, spot) in ranking.iter().zip(spots) {
        let depth = entry["depth"].as_u64().unwrap_or(1);
        if !depths.contains(&depth) {
            depths.push(depth);
            found.push((spot.clone(), entry));
        }
    }
    found
}

/// What came of a drawn case, with what tables are sorted by.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Of the cases ([`super::draw::EDITION`]).
    pub edition: u32,
    /// SHA-256 of the program.
    pub program: String,
    /// Commit that the program was built from.
    pub commit: String,
    /// Seconds that it was given.
    pub timeout_s: f64,
    /// Seed of the draw.
    pub draw: u32,
    /// Of the case in its draw.
    pub number: usize,
    /// Of the case.
    pub name: String,
    /// What is asked.
    pub kind: Kind,
    /// What is hidden, with its place.
    pub hidden: Vec<String>,
    /// Ids of the hidden effects.
    pub effects: Vec<String>,
    /// By how many standard errors each of them shows.
    pub standard_errors: Vec<f64>,
    /// The machine.
    pub device: String,
    /// Its free joints.
    pub n_free: usize,
    /// How it is measured.
    pub instrument: Instrument,
    /// What the answer is worth.
    pub score: Score,
    /// Seconds until the answer.
    pub seconds: f64,
}

impl Outcome {
    /// Of a case; what the program is and did is filled in by who ran it.
    pub fn of(case: &DrawnCase, score: Score, seconds: f64) -> Self {
        let place = |hidden: &HiddenEffect| {
            let entry = &hidden.entry;
            Spot { effect: entry.id.clone(), joint: entry.joint, from: entry.from }.to_string()
        };
        Self {
            edition: super::draw::EDITION,
            program: String::new(),
            commit: String::new(),
            timeout_s: 0.0,
            draw: case.draw,
            number: case.card.number,
            name: case.name.clone(),
            kind: case.card.kind,
            hidden: case.hidden.iter().map(place).collect(),
            effects: case.hidden.iter().map(|hidden| hidden.entry.id.clone()).collect(),
            standard_errors: case.hidden.iter().map(|hidden| hidden.visibility.standard_errors).collect(),
            device: case.truth.device.clone(),
            n_free: case.free.len(),
            instrument: case.instrument.clone(),
            score,
            seconds,
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::hidden::draw;

    fn case(kind: Kind, effects: &[&str]) -> DrawnCase {
        let card =
            draw::Card { number: 1, kind, effects: effects.iter().map(|&id| id.to_owned()).collect(), is_arm: false };
        draw::case(0, &card).unwrap()
    }

    fn told(hidden: &HiddenEffect, depth: usize) -> Value {
        let parameters: Vec<Value> = hidden
            .entry
            .values
            .iter()
            .map(|(symbol, value)| json!({ "name": format!("joint.0.x.{symbol}"), "value": value, "std_error": 0.1 }))
            .collect();
        json!({
            "effect": hidden.entry.id, "joint": hidden.entry.joint, "from": hidden.entry.from, "depth": depth,
            "worst_ratio_after": 1.0, "parameters": parameters,
        })
    }

    #[test]
    fn the_hidden_effect_must_come_first_and_be_named_missing() {
        let case = case(Kind::Hidden, &["coulomb"]);
        let right = told(&case.hidden[0], 1);
        let other = json!({ "effect": "spring", "joint": 0, "depth": 1 });
        let diagnosis = json!({ "verdict": "missing_effect", "ranking": [right, other] });
        let score = Score::of(&case, &diagnosis).unwrap();
        assert!(score.right && score.is_whole == Some(true) && score.rank == Some(1), "{score:?}");
        assert_eq!((score.n_covered, score.n_error_bars), (1, 1), "v_eps is no physical parameter: {score:?}");
        let diagnosis = json!({ "verdict": "missing_effect", "ranking": [other, right] });
        let score = Score::of(&case, &diagnosis).unwrap();
        assert!(!score.right && score.rank == Some(2) && score.n_error_bars == 0, "{score:?}");
        let diagnosis = json!({ "verdict": "unexplained", "ranking": [right] });
        assert!(!Score::of(&case, &diagnosis).unwrap().right);
        assert!(Score::of(&case, &json!({})).is_err());
        assert!(!Score::without_answer("took too long").right);
    }

    #[test]
    fn both_of_two_must_be_found_one_after_the_other() {
        let case = case(Kind::TwoAtOnce, &["coulomb", "cogging"]);
        let [one, other] = case.hidden.as_slice() else { panic!("two are hidden") };
        let diagnosis = json!({ "verdict": "missing_effect", "ranking": [told(other, 1), told(one, 2)] });
        let score = Score::of(&case, &diagnosis).unwrap();
        assert!(score.right && score.n_found == 2, "{score:?}");
        // An alternative to the first is no second one.
        let diagnosis = json!({ "verdict": "missing_effect", "ranking": [told(other, 1), told(one, 1)] });
        let score = Score::of(&case, &diagnosis).unwrap();
        assert!(!score.right && score.n_found == 1 && score.rank == Some(1), "{score:?}");
    }

    #[test]
    fn the_run_that_carries_a_body_must_be_named() {
        let case = case(Kind::PayloadInOneRun, &[]);
        let moved = |run: &str| json!({ "verdict": "nothing_missing", "ranking": [], "moved": [{ "run": run }] });
        assert!(Score::of(&case, &moved(case.run_with_payload.as_deref().unwrap())).unwrap().right);
        assert!(!Score::of(&case, &moved("another.csv")).unwrap().right);
    }
}

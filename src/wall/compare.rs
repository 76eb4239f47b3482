//! Several walls under the same hands.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::Serialize;

use super::{
    Approach, Hand, Measures, Setting, WallError,
    contact::{Plant, played},
};
use crate::{control::Wall, model::Model};

/// One hand's approach to one wall.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Case {
    /// The wall's name.
    pub controller: String,
    /// The approach's.
    pub speed: String,
    /// Which hand, from 0.
    pub hand: usize,
    /// How it felt.
    #[serde(flatten)]
    pub measures: Measures,
}

/// Plays every approach of every hand against every wall; in the order of the walls, approaches and hands.
///
/// # Errors
/// As [`super::contact()`]; the first that fails.
pub fn compare(model: &Model, setting: &Setting, walls: &[(String, Wall)]) -> Result<Vec<Case>, WallError> {
    let hands = setting.hand.population(setting.spread, setting.hands, setting.seed);
    compare_with(model, setting, walls, &hands)
}

/// As [`compare()`], with these hands. A hand that never meets the wall is left out.
///
/// # Errors
/// As [`compare()`].
pub fn compare_with(
    model: &Model,
    setting: &Setting,
    walls: &[(String, Wall)],
    hands: &[Hand],
) -> Result<Vec<Case>, WallError> {
    let plant = Plant::new(model, setting)?;
    let mut asked: Vec<(&str, &Wall, &Approach, usize)> = Vec::new();
    for (name, wall) in walls {
        for approach in &setting.approaches {
            asked.extend((0..hands.len()).map(|hand| (name.as_str(), wall, approach, hand)));
        }
    }
    let cases: Vec<Result<Option<Case>, WallError>> = asked
        .par_iter()
        .map(|&(name, wall, approach, hand)| {
            let contact = played(&plant, setting, wall, &hands[hand], approach)
                .map_err(|error| error.in_case(name, approach, Some(hand)))?;
            let measures = Measures::of(&contact, wall);
            Ok(measures.map(|measures| Case {
                controller: name.to_owned(),
                speed: approach.name.clone(),
                hand,
                measures,
            }))
        })
        .collect();
    // One after the other: whichever thread was first, the error told is that of the first case.
    let cases = cases.into_iter().collect::<Result<Vec<Option<Case>>, WallError>>()?;
    Ok(cases.into_iter().flatten().collect())
}

/// Chatter of the wall `than` over that of the wall `name`, for every approach and hand that met both.
pub fn chatter_ratios(cases: &[Case], name: &str, than: &str) -> Vec<f64> {
    /// Below a picometre there is no chatter to compare with.
    const NONE: f64 = 1e-12;
    let than: BTreeMap<(&str, usize), f64> = cases
        .iter()
        .filter(|case| case.controller == than)
        .map(|case| ((case.speed.as_str(), case.hand), case.measures.chatter_rms))
        .collect();
    cases
        .iter()
        .filter(|case| case.controller == name)
        .filter_map(|case| Some(than.get(&(case.speed.as_str(), case.hand))? / case.measures.chatter_rms.max(NONE)))
        .collect()
}

//! Several walls under the same hands.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::Serialize;

use super::{
    Approach, Hand, Measures, Setting, WallError,
    contact::Plant,
    eight::{Meeting, all_played},
};
use dynid_control::Wall;
use dynid_user_model::Model;

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
    let asked = asked(walls, &setting.approaches, hands);
    let meetings: Vec<Meeting<'_>> = asked
        .iter()
        .map(|&Asked { wall, hand, approach, .. }| Meeting { plant: &plant, wall, hand, approach })
        .collect();
    let contacts = all_played(setting, &meetings);
    let cases = asked.into_par_iter().zip(contacts).map(|(Asked { name, wall, approach, number, .. }, contact)| {
        let contact = contact.map_err(|error| error.in_case(name, approach, Some(number)))?;
        let case =
            |measures| Case { controller: name.to_owned(), speed: approach.name.clone(), hand: number, measures };
        Ok(Measures::of(&contact, wall).map(case))
    });
    in_order(cases.collect())
}

/// One hand's approach to one wall, to be played.
pub(super) struct Asked<'a> {
    /// The wall's name.
    pub(super) name: &'a str,
    /// The wall.
    pub(super) wall: &'a Wall,
    /// The approach.
    pub(super) approach: &'a Approach,
    /// Which hand, from 0.
    pub(super) number: usize,
    /// The hand.
    pub(super) hand: &'a Hand,
}

/// What `play` makes of every approach of every hand against every wall, in the order of the walls, approaches and hands,
/// without those of which it makes nothing.
///
/// # Errors
/// Its own, of the first in that order that has one, whichever thread was there first.
pub(super) fn every<T: Send>(
    walls: &[(String, Wall)],
    approaches: &[Approach],
    hands: &[Hand],
    play: &(dyn Fn(Asked<'_>) -> Result<Option<T>, WallError> + Sync),
) -> Result<Vec<T>, WallError> {
    let play = |asked: Asked<'_>| {
        let Asked { name, approach, number, .. } = asked;
        play(asked).map_err(|error| error.in_case(name, approach, Some(number)))
    };
    in_order(asked(walls, approaches, hands).into_par_iter().map(play).collect())
}

/// Every approach of every hand against every wall, in the order of the walls, approaches and hands.
fn asked<'a>(walls: &'a [(String, Wall)], approaches: &'a [Approach], hands: &'a [Hand]) -> Vec<Asked<'a>> {
    let mut asked: Vec<Asked<'_>> = Vec::new();
    for (name, wall) in walls {
        for approach in approaches {
            let numbered = hands.iter().enumerate();
            asked.extend(numbered.map(|(number, hand)| Asked { name, wall, approach, number, hand }));
        }
    }
    asked
}

/// What there is, or the first error.
fn in_order<T>(reported: Vec<Result<Option<T>, WallError>>) -> Result<Vec<T>, WallError> {
    let reported = reported.into_iter().collect::<Result<Vec<Option<T>>, WallError>>()?;
    Ok(reported.into_iter().flatten().collect())
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

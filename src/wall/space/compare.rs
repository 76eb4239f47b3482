//! Several walls on one plane under the same hands.

use rayon::prelude::*;
use serde::Serialize;

use super::{
    Coupling, Setting,
    contact::{Plant, played},
};
use crate::{
    control::{Shares, Wall},
    model::Model,
    wall::{Approach, Hand, Measures, WallError},
};

/// One hand's approach to one wall.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Case {
    /// The wall's name.
    pub controller: String,
    /// The approach's.
    pub speed: String,
    /// Which hand, from 0.
    pub hand: usize,
    /// How it felt along the normal, in m and N.
    #[serde(flatten)]
    pub measures: Measures,
    /// What happened beside.
    pub coupling: Coupling,
}

/// Plays every approach of every hand against every wall; in the order of the walls, approaches and hands. A hand that
/// never meets the wall is left out.
///
/// # Errors
/// As [`super::contact()`]; the first that fails.
pub fn compare(
    model: &Model,
    setting: &Setting,
    walls: &[(String, Wall)],
    carried: Option<Shares>,
) -> Result<Vec<Case>, WallError> {
    let plant = Plant::new(model, setting, carried)?;
    let hands = setting.people.all();
    let mut asked: Vec<(&str, &Wall, &Approach, usize, &Hand)> = Vec::new();
    for (name, wall) in walls {
        for approach in &setting.reaching.approaches {
            asked.extend(hands.iter().enumerate().map(|(index, hand)| (name.as_str(), wall, approach, index, hand)));
        }
    }
    let cases: Vec<Result<Option<Case>, WallError>> = asked
        .par_iter()
        .map(|&(name, wall, approach, index, hand)| {
            let contact = played(&plant, setting, wall, hand, approach)
                .map_err(|error| error.in_case(name, approach, Some(index)))?;
            let told = contact.measures(wall, setting.lever).zip(contact.coupling(setting));
            Ok(told.map(|(measures, coupling)| Case {
                controller: name.to_owned(),
                speed: approach.name.clone(),
                hand: index,
                measures,
                coupling,
            }))
        })
        .collect();
    // One after the other: whichever thread was first, the error told is that of the first case.
    let cases = cases.into_iter().collect::<Result<Vec<Option<Case>>, WallError>>()?;
    Ok(cases.into_iter().flatten().collect())
}

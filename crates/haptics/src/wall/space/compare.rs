//! Several walls on one plane under the same hands.

use serde::Serialize;

use super::{
    Coupling, Setting,
    contact::{Plant, played},
};
use crate::{wall::Measures, wall::WallError, wall::compare::Asked, wall::compare::every};
use dynid_control::{CompensationRatios, Wall};
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
    carried: Option<CompensationRatios>,
) -> Result<Vec<Case>, WallError> {
    let plant = Plant::new(model, setting, carried)?;
    every(
        walls,
        &setting.reaching.approaches,
        &setting.people.all(),
        &|Asked { name, wall, approach, number, hand }| {
            let contact = played(&plant, setting, wall, hand, approach)?;
            let reported = contact.measures(wall, setting.lever).zip(contact.coupling(setting));
            Ok(reported.map(|(measures, coupling)| Case {
                controller: name.to_owned(),
                speed: approach.name.clone(),
                hand: number,
                measures,
                coupling,
            }))
        },
    )
}

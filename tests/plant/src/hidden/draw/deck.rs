//! What the cases of a draw ask, in the order in which they come.

use super::dice::Dice;
use super::place;
use crate::effects::outside;
use crate::hidden::Kind;

/// As many cases has a draw unless another number is asked for.
pub const N_CASES: usize = 300;

/// What one case asks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Card {
    /// Place in the draw, from 1.
    pub number: usize,
    /// What is asked.
    pub kind: Kind,
    /// Ids of the effects that are hidden.
    pub effects: Vec<String>,
    /// Whether it is a torque log of an arm of five joints or more.
    pub is_arm: bool,
}

/// Of [`N_CASES`], with as many arms among them; what is left are single effects.
const SHARES: [(Kind, usize, usize); 4] =
    [(Kind::Nothing, 60, 10), (Kind::Outside, 40, 4), (Kind::TwoAtOnce, 30, 4), (Kind::PayloadInOneRun, 8, 2)];
const ARMS_WITH_ONE: usize = 30;

/// All cases of a draw: of any first part of them the kinds have about the same shares.
pub fn deck(draw: u32) -> Vec<Card> {
    let mut dice = Dice::new(0x0d1d_dec0 + (u64::from(draw) << 32));
    let library: Vec<&str> = dynid_model::effects().iter().map(|effect| effect.id.as_str()).filter(known).collect();
    let mut cards = Vec::new();
    let mut add = |kind: Kind, effects: Vec<&str>, is_arm: bool| {
        let effects = effects.into_iter().map(str::to_owned).collect();
        cards.push(Card { number: 0, kind, effects, is_arm });
    };
    for (kind, count, n_arms) in SHARES {
        let mut laws = outside::IDS;
        dice.shuffle(&mut laws);
        for index in 0..count {
            let is_arm = index < n_arms;
            let effects = match kind {
                Kind::Outside => vec![laws[index % laws.len()]],
                Kind::TwoAtOnce => two_of(&library, is_arm, &mut dice),
                _ => Vec::new(),
            };
            add(kind, effects, is_arm);
        }
    }
    let n_single = N_CASES - SHARES.iter().map(|(_, count, _)| count).sum::<usize>();
    let mut n_arms = 0;
    let mut order = library.clone();
    for index in 0..n_single {
        if index % order.len() == 0 {
            dice.shuffle(&mut order);
        }
        let id = order[index % order.len()];
        // Every effect has its turn on a small machine first.
        let is_arm = index >= order.len() && n_arms < ARMS_WITH_ONE && place::fits_an_arm(id);
        n_arms += usize::from(is_arm);
        add(Kind::Hidden, vec![id], is_arm);
    }
    dice.shuffle(&mut cards);
    for (number, card) in (1..).zip(&mut cards) {
        card.number = number;
    }
    cards
}

/// Effects of a user's own have no size that could be drawn.
fn known(id: &&str) -> bool {
    place::IDS.contains(id)
}

fn two_of<'a>(library: &[&'a str], is_arm: bool, dice: &mut Dice) -> Vec<&'a str> {
    let fits = |id: &str| !is_arm || place::fits_an_arm(id);
    // What only shows where links are known to a few per cent would ask that of both.
    let allowed: Vec<&str> = library.iter().copied().filter(|id| fits(id) && !place::needs_known_links(id)).collect();
    let first = *dice.pick(&allowed);
    let others: Vec<&str> = allowed.iter().copied().filter(|id| place::go_together(first, id)).collect();
    vec![first, *dice.pick(&others)]
}

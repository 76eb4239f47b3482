use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering};

use dynid_model::Link;
use dynid_model::physical_consistency::check_body;

use super::*;

#[test]
fn a_draw_is_the_same_again_and_another_is_not() {
    let cards = deck(3);
    assert_eq!(cards, deck(3));
    assert_ne!(cards, deck(4));
    for card in cards.iter().filter(|card| !card.is_arm).take(4) {
        let (one, other) = (case(3, card).unwrap(), case(3, card).unwrap());
        assert_eq!(one.name, other.name);
        assert_eq!(one.files().unwrap(), other.files().unwrap());
    }
}

#[test]
fn every_effect_of_the_library_is_hidden_in_draws() {
    let own: BTreeSet<&str> = place::IDS.into();
    for effect in dynid_model::effects().iter().filter(|effect| !effect.general) {
        assert!(own.contains(effect.id.as_str()), "no draw has a place and a size for `{}`", effect.id);
    }
    for draw in 0..10 {
        let cards = deck(draw);
        let counts = hidden_in(&cards);
        for id in place::IDS {
            assert!(counts[id] >= 4, "draw {draw} hides `{id}` {} times", counts[id]);
        }
        let count = |is: &dyn Fn(&Card) -> bool| cards.iter().filter(|card| is(card)).count();
        assert_eq!(cards.len(), N_CASES);
        assert!(count(&|card| card.kind == Kind::Hidden) >= 160);
        assert_eq!(count(&|card| card.kind == Kind::Nothing), 60);
        assert_eq!(count(&|card| card.kind == Kind::Outside), 40);
        assert_eq!(count(&|card| card.kind == Kind::TwoAtOnce), 30);
        assert!(count(&|card| card.is_arm) >= 40);
    }
}

/// Of one draw every effect of the library, two of each other kind, and an arm: [`case`] has played the machine with and
/// without what is hidden.
#[test]
fn cases_play_and_show_what_they_hide() {
    let (arms, others): (Vec<Card>, Vec<Card>) = deck(0).into_iter().partition(|card| card.is_arm);
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    let is_new = |card: &&Card| {
        let (what, enough) = match card.kind {
            Kind::Hidden => (card.effects[0].as_str(), 1),
            kind => (kind.as_str(), 2),
        };
        let count = seen.entry(what.to_owned()).or_default();
        *count += 1;
        *count <= enough
    };
    let cards: Vec<&Card> = others.iter().filter(is_new).chain(arms.first()).collect();
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                while let Some(card) = cards.get(next.fetch_add(1, Ordering::Relaxed)) {
                    check(card);
                }
            });
        }
    });
}

fn check(card: &Card) {
    let case = case(0, card).unwrap_or_else(|reason| panic!("{reason}"));
    let device = device(&case.truth.device);
    assert!(device.configuration_of(&case.free).is_some(), "{}", case.name);
    assert!(!card.is_arm || (case.free.len() >= 5 && case.instrument.drive == Drive::ClosedLoop), "{}", case.name);
    for hidden in &case.hidden {
        assert!(hidden.visibility.shows, "{}", case.name);
        assert!(hidden.visibility.moves_by_noises.iter().all(|moves| moves.is_finite()), "{}", case.name);
        let is_outside = dynid_model::effect(&hidden.entry.id).is_none();
        assert_eq!(hidden.accepted.is_empty(), is_outside, "{}", case.name);
    }
    let n_hidden = match card.kind {
        Kind::Nothing => 0,
        Kind::TwoAtOnce => 2,
        _ => 1,
    };
    assert_eq!(case.hidden.len(), n_hidden, "{}", case.name);
    let is_held_out = |role: &str| case.truth.runs.iter().filter(|run| run.role == role).count();
    assert!(is_held_out("fit") > 0 && (case.truth.runs.len() == 1 || is_held_out("validate") > 0), "{}", case.name);
    for (number, link) in (1..).zip(&device.links) {
        let value = |index: usize| {
            let name = format!("link.{number}.{}", Link::SYMBOLS[index]);
            case.truth.parameters.get(&name).copied().unwrap_or(link.inertial[index].value)
        };
        check_body(&std::array::from_fn(value)).unwrap_or_else(|reason| panic!("{}: {reason}", case.name));
    }
}

/// A controller sees what the log shows, so that the log's torques follow from its own columns.
#[test]
fn a_closed_loop_log_holds_what_the_controller_saw_and_did() {
    let card = deck(1).into_iter().find(|card| card.kind == Kind::Nothing && card.is_arm).unwrap();
    let mut case = case(1, &card).unwrap();
    case.truth.torque_noise_rms.clear();
    case.truth.runs.truncate(1);
    case.truth.runs[0].duration_s = 1.0;
    let files = case.files().unwrap();
    let log = &files[&case.truth.runs[0].file];
    let gains = case.truth.controller.as_ref().unwrap();
    let joint = case.free[0];
    let n_joints = case.truth.start.len();
    let mut lines = log.lines();
    assert!(lines.next().unwrap().ends_with(&format!("ref{}", n_joints - 1)));
    let first: Vec<f64> = lines.next().unwrap().split(',').map(|cell| cell.parse().unwrap()).collect();
    let error = first[1 + 2 * n_joints + joint] - first[1 + n_joints + joint];
    assert!((first[1 + joint] - gains.proportional[joint] * error).abs() < 2e-6 * gains.proportional[joint].max(1.0));
    assert!(
        files["experiment.toml"].contains("controller = \"controller.toml\"") && files.contains_key("controller.toml")
    );
}

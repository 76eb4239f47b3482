//! Starts of a fit, drawn at random within the bounds: a search that ends at one cost from many of them has met no local
//! minimum on its way.

use dynid_model::{Parameter, physical_consistency::check_body};

use super::orders;
use dynid_random::Random;
use dynid_user_model::Model;

/// From where a fit is tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Starts {
    /// How many; the first is the model as it stands.
    pub count: usize,
    /// What the others are drawn from.
    pub seed: u64,
    /// Whether a search that comes to no good end is followed by one from the prior values.
    pub prior: bool,
}

impl Default for Starts {
    fn default() -> Self {
        Self { count: 1, seed: 0, prior: true }
    }
}

/// Bounds of one sign that lie further apart than this factor are drawn from by their logarithm.
const WIDE: f64 = 10.0;
/// A drawn link that no body can have is moved half-way to the model's, so often at most.
const HALVINGS: usize = 60;

/// The start of that number, from 0: the model itself, then draws. Parameters that the runs do not depend on (`occurs` is
/// false) stay, for no fit brings them back; so do fixed ones and those without two finite bounds. Orders (`Fs >= Fc`)
/// hold, and every link is one that a body can have.
pub fn draw(model: &Model, occurs: &dyn Fn(&str) -> bool, seed: u64, number: usize) -> Model {
    let mut drawn = model.clone();
    if number == 0 {
        return drawn;
    }
    // One stream per start, far from the others.
    let mut random = Random::new(seed ^ (number as u64).wrapping_mul(0xd134_2543_de82_ef95));
    for (name, parameter) in model.parameters() {
        // Every parameter takes its number, so that fixing one does not change the others.
        let share = random.unit();
        if occurs(&name) && !parameter.fixed && parameter.lower.is_finite() && parameter.upper.is_finite() {
            // The name is the model's own.
            let _known = drawn.set_value(&name, between(&parameter, share));
        }
    }
    for (larger, smaller) in orders(model) {
        let (Some(above), Some(below)) = (drawn.parameter(&larger), drawn.parameter(&smaller)) else { continue };
        if above.value >= below.value {
            continue;
        }
        let exchanged = !above.fixed && !below.fixed && above.contains(below.value) && below.contains(above.value);
        let (one, other) = if exchanged {
            (Some(below.value), Some(above.value))
        } else {
            let own = |name: &str| model.parameter(name).map(|parameter| parameter.value);
            (own(&larger), own(&smaller))
        };
        for (name, value) in [(larger, one), (smaller, other)] {
            let _known = value.map(|value| drawn.set_value(&name, value));
        }
    }
    for link in 0..model.links.len() {
        make_a_body(model, &mut drawn, link);
    }
    drawn
}

fn between(parameter: &Parameter, share: f64) -> f64 {
    let Parameter { lower, upper, .. } = *parameter;
    let value = if lower > 0.0 && upper > WIDE * lower {
        lower * (share * (upper / lower).ln()).exp()
    } else {
        lower + share * (upper - lower)
    };
    value.clamp(lower, upper)
}

/// Moves a drawn link towards the model's until some body has its inertia. The set of such links is convex, and the
/// model's lies in it.
fn make_a_body(model: &Model, drawn: &mut Model, link: usize) {
    for _ in 0..HALVINGS {
        if check_body(&drawn.links[link].map(|parameter| parameter.value)).is_ok() {
            return;
        }
        for (own, start) in drawn.links[link].iter_mut().zip(&model.links[link]) {
            own.value = 0.5 * (own.value + start.value);
        }
    }
    drawn.links[link] = model.links[link];
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_lie_within_the_bounds_and_can_be() {
        let model = Model::of_device(dynid_model::device("freedom6s").unwrap());
        let all = |_: &str| true;
        assert_eq!(draw(&model, &all, 7, 0).digest(), model.digest(), "the first is the model");
        let mut digests = Vec::new();
        for number in 1..20 {
            let start = draw(&model, &all, 7, number);
            assert_eq!(start.digest(), draw(&model, &all, 7, number).digest(), "the same every time");
            for ((name, own), (_, prior)) in start.parameters().into_iter().zip(model.parameters()) {
                assert!(prior.contains(own.value), "{name} = {}", own.value);
                assert!(!prior.fixed || own.value == prior.value, "{name} is fixed");
            }
            for (larger, smaller) in orders(&model) {
                let value = |name: &str| start.parameter(name).unwrap().value;
                assert!(value(&larger) >= value(&smaller), "{larger} and {smaller}");
            }
            for (index, link) in start.links.iter().enumerate() {
                let body = link.map(|parameter| parameter.value);
                assert!(check_body(&body).is_ok(), "link {}: {body:?}", index + 1);
            }
            digests.push(start.digest());
        }
        digests.sort();
        digests.dedup();
        assert_eq!(digests.len(), 19, "no two are alike");
        assert_ne!(draw(&model, &all, 8, 1).digest(), draw(&model, &all, 7, 1).digest(), "another seed, other starts");
    }

    /// Evenly, or evenly in the logarithm where the bounds are positive and far apart.
    #[test]
    fn a_draw_lies_at_its_share_of_the_bounds() {
        let bounds = |lower: f64, upper: f64| Parameter { value: lower, lower, upper, fixed: false };
        for (share, even, logarithmic) in [(0.0, -2.0, 0.01), (0.25, -1.0, 0.1), (0.5, 0.0, 1.0), (1.0, 2.0, 100.0)] {
            assert_eq!(between(&bounds(-2.0, 2.0), share), even);
            let found = between(&bounds(0.01, 100.0), share);
            assert!((found / logarithmic - 1.0).abs() < 1e-12, "{share}: {found}");
        }
        assert_eq!(between(&bounds(1.0, 10.0), 0.5), 5.5, "these are not far apart");
        assert_eq!(between(&bounds(0.0, 100.0), 0.5), 50.0, "zero has no logarithm");
    }

    /// What the runs do not depend on would stay at its draw: the fitted link might be no body with the rest of its values.
    #[test]
    fn what_the_runs_do_not_depend_on_stays() {
        let model = Model::of_device(dynid_model::device("freedom6s").unwrap());
        let occurs = |name: &str| name.starts_with("joint.4.") || name == "link.7.Izz";
        let start = draw(&model, &occurs, 7, 1);
        let mut drawn = 0;
        for ((name, own), (_, prior)) in start.parameters().into_iter().zip(model.parameters()) {
            assert!(occurs(&name) || own.value == prior.value, "{name} = {}", own.value);
            drawn += usize::from(own.value != prior.value);
        }
        assert!(drawn > 5, "{drawn} drawn");
    }
}

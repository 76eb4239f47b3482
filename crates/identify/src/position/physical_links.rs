//! The bodies of a position fit: which links it may move, and starts that no body has.

use std::collections::BTreeMap;

use dynid_model::Link;
use dynid_optimise::{body::Body, region::Entry};
use dynid_user_model::Model;

use crate::link_parameter;

/// The links that have an unknown moment of inertia or mass. Links of which not all values are given are left out; where
/// their centroids are does not matter.
pub(crate) fn bodies(unknowns: &[&str], known: &BTreeMap<String, f64>) -> Vec<Body> {
    let matters = |symbol: usize| symbol == 0 || symbol >= 4;
    let parts = unknowns.iter().filter_map(|name| link_parameter(name));
    let mut links: Vec<usize> = parts.filter(|(_, symbol)| matters(*symbol)).map(|(link, _)| link).collect();
    links.sort_unstable();
    links.dedup();
    let entry = |link: usize, symbol: usize| {
        let name = format!("link.{link}.{}", Link::SYMBOLS[symbol]);
        match unknowns.iter().position(|unknown| *unknown == name) {
            Some(index) => Some(Entry::Unknown(index)),
            None => known.get(&name).copied().map(Entry::Known),
        }
    };
    let body = |link: usize| {
        let mut inertial = [Entry::Known(0.0); 10];
        for (symbol, slot) in inertial.iter_mut().enumerate() {
            match entry(link, symbol) {
                Some(entry) => *slot = entry,
                None if matters(symbol) => return None,
                None => {}
            }
        }
        Some(Body { link, inertial })
    };
    links.into_iter().filter_map(body).collect()
}

/// Moves those of `bodies` that cannot exist to ones near by, within the bounds; their links.
pub(crate) fn make_physical(bodies: &[Body], x: &mut [f64], lower: &[f64], upper: &[f64]) -> Vec<usize> {
    let moved = bodies.iter().filter(|body| !body.is_physical(x) && body.make_physical(x, lower, upper));
    moved.map(|body| body.link).collect()
}

/// Moves every link of `model` that no body can be to one near by, within the bounds, and notes it. A link that its bounds
/// keep impossible stays.
pub fn made_physical(mut model: Model) -> Model {
    let (mut names, mut x, mut lower, mut upper) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut known = BTreeMap::new();
    for (name, parameter) in model.parameters() {
        if parameter.fixed {
            known.insert(name, parameter.value);
        } else {
            names.push(name);
            x.push(parameter.value);
            lower.push(parameter.lower);
            upper.push(parameter.upper);
        }
    }
    let unknowns: Vec<&str> = names.iter().map(String::as_str).collect();
    for link in make_physical(&bodies(&unknowns, &known), &mut x, &lower, &upper) {
        model.notes.push(format!("link {link} started with an inertia that no body has; moved to a body's near by"));
    }
    for (name, value) in names.iter().zip(&x) {
        // The names are the model's own.
        let _known = model.set_value(name, *value);
    }
    model
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_with_a_mass_or_a_moment_to_find_is_a_body() {
        let symbols = |given: &[&str]| given.iter().map(|symbol| format!("link.2.{symbol}")).collect::<Vec<String>>();
        let inertias = symbols(&["m", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz"]);
        let known: BTreeMap<String, f64> = inertias.iter().cloned().zip([1.0, 0.3, 0.0, 0.0, 0.2, 0.0]).collect();
        let found = bodies(&["link.2.x", "link.2.Izz"], &known);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].unknowns().collect::<Vec<_>>(), [(1, 0), (9, 1)]);
        assert_eq!(found[0].at(&[0.5, 0.4]), [1.0, 0.5, 0.0, 0.0, 0.3, 0.0, 0.0, 0.2, 0.0, 0.4]);
        assert_eq!(bodies(&["link.2.x"], &known), [], "where the mass lies does not matter");
        assert_eq!(bodies(&["link.3.Izz"], &known), [], "of which the rest is not given");
    }
}

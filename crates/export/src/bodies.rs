//! Bodies that effects add to links, such as a payload.

use dynid_model::Link;
use dynid_user_model::{EffectInstance, Model};

/// The model with these bodies in its links' values. Its effects are those that it had.
pub(crate) fn joined(model: &Model) -> Model {
    let mut joined = model.clone();
    for instance in &model.effects {
        let Some((link, body)) = body_of(model, instance) else { continue };
        let own = joined.links[link].map(|parameter| parameter.value);
        for (parameter, value) in joined.links[link].iter_mut().zip(sum(&own, &body)) {
            parameter.value = value;
        }
    }
    joined
}

/// The link, from 0, that an effect's body joins, and the body in the link's frame; `None` of effects that are no bodies, or of what the
/// robot only carries in some runs.
pub(crate) fn body_of(model: &Model, instance: &EffectInstance) -> Option<(usize, [f64; 10])> {
    if instance.payload.is_some() {
        return None;
    }
    let outputs = &instance.effect.outputs;
    let is_body = outputs.iter().any(|(name, _)| Link::SYMBOLS.contains(&name.as_str()));
    let link = model.device.last_link_moved_by(instance.joint?).filter(|_| is_body)?;
    // A body reads its parameters alone.
    let (values, _) = instance.effect.evaluate(&|symbol| instance.value(symbol)).ok()?;
    let value = |symbol: &str| outputs.iter().position(|(name, _)| name == symbol).map_or(0.0, |index| values[index]);
    let body = Link::SYMBOLS.map(value);
    body.iter().any(|value| *value != 0.0).then_some((link, body))
}

/// Two bodies that move as one: mass, centroid, inertia about the centroid, by the parallel axis theorem.
pub(crate) fn sum(a: &[f64; 10], b: &[f64; 10]) -> [f64; 10] {
    let mass = a[0] + b[0];
    let centroid = [1, 2, 3].map(|axis| if mass == 0.0 { 0.0 } else { (a[0] * a[axis] + b[0] * b[axis]) / mass });
    let mut sum = [mass, centroid[0], centroid[1], centroid[2], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    for body in [a, b] {
        let [x, y, z] = [0, 1, 2].map(|axis| body[1 + axis] - centroid[axis]);
        let moved = [y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y];
        for (place, moved) in (4..10).zip(moved) {
            sum[place] += body[place] + body[0] * moved;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A payload at the tip of the last link: centroid and inertia by hand.
    #[test]
    fn payload_joins_the_last_link() {
        let mut model = Model::of_device(dynid_model::device("planar2r").unwrap());
        let link = [2.0, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.01];
        model.links[1].iter_mut().zip(link).for_each(|(own, value)| own.value = value);
        let mut payload = EffectInstance::new(model.device, "payload", Some(1), None).unwrap();
        for (own, value) in payload.parameters.iter_mut().zip([1.0, 0.5, 0.0, 0.0]) {
            own.value = value;
        }
        model.effects.push(payload);
        let found = joined(&model).links[1].map(|own| own.value);
        // Reduced mass 2/3 kg, 0.3 m apart.
        let inertia = 0.01 + 2.0 / 3.0 * 0.09;
        let expected = [3.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, inertia, 0.0, inertia];
        found
            .iter()
            .zip(expected)
            .for_each(|(found, expected)| assert!((found - expected).abs() < 1e-15, "{found} {expected}"));
    }
}

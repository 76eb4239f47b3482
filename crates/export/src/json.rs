//! A model as JSON, for programs that read neither TOML nor robot descriptions.

use dynid_model::{Convention, JointKind, Link, Place};
use dynid_user_model::{EffectInstance, FitRecord, Model};
use serde_json::{Value, json};

/// Device, links, joints, frames and effects of a model with their values; units stand in the keys or beside the values.
///
/// A number that is not finite (a limit that there is not) is `null`, and so is a standard deviation that no fit has found.
pub fn as_json(model: &Model) -> Value {
    let device = model.device;
    json!({
        "device": {
            "id": device.id,
            "title": device.title,
            "source": device.source,
            "structure_digest": device.structure_digest(),
        },
        "model_digest": model.digest(),
        "gravity_m_s2": model.base.map(|component| -component.value),
        "joints": joints(model),
        "frames": frames(model),
        "lengths": parameters(model, |name| name.starts_with("length.")),
        "links": (0..model.links.len()).map(|link| of_link(model, link)).collect::<Vec<_>>(),
        "effects": model.effects.iter().map(|instance| of_effect(model, instance)).collect::<Vec<_>>(),
        "fit": model.fit.as_ref().map(of_fit),
    })
}

fn joints(model: &Model) -> Vec<Value> {
    let of_joint = |(number, joint): (usize, &dynid_model::Joint)| {
        json!({
            "joint": number,
            "name": joint.title,
            "kind": if joint.kind == JointKind::Revolute { "revolute" } else { "prismatic" },
            "position_unit": if joint.kind == JointKind::Revolute { "rad" } else { "m" },
            "position_limits": joint.position_limits,
            "speed_limit": joint.speed_limit,
            "torque_limit": joint.torque_limit,
            "command_unit": joint.command_unit,
        })
    };
    model.device.joints.iter().enumerate().map(of_joint).collect()
}

/// Rows of the table of frames, with the formulas that they hold.
fn frames(model: &Model) -> Value {
    let device = model.device;
    let rows = device.frames.iter().map(|frame| {
        json!({
            "name": frame.name,
            "parent": frame.parent.map_or("base", |parent| &device.frames[parent].name),
            "theta_rad": frame.theta.to_string(),
            "d_m": frame.d.to_string(),
            "a_m": frame.a.to_string(),
            "alpha_rad": frame.alpha.to_string(),
        })
    });
    let convention = match device.convention {
        Convention::Standard => "Rz(theta) Tz(d) Tx(a) Rx(alpha)",
        Convention::Modified => "Rx(alpha) Tx(a) Rz(theta) Tz(d)",
    };
    json!({ "convention": convention, "rows": rows.collect::<Vec<_>>() })
}

fn of_link(model: &Model, link: usize) -> Value {
    let own = &model.device.links[link];
    let [m, x, y, z, xx, xy, xz, yy, yz, zz] = model.links[link].map(|parameter| parameter.value);
    let about_centroid = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let arm = [x, y, z];
    let squares = x * x + y * y + z * z;
    let about_origin: [[f64; 3]; 3] = std::array::from_fn(|row| {
        std::array::from_fn(|column| {
            let own = if row == column { squares } else { 0.0 };
            about_centroid[row][column] + m * (own - arm[row] * arm[column])
        })
    });
    let prefix = format!("link.{}.", link + 1);
    let std_error = |symbol: &str| model.fit.as_ref()?.std_error.get(&format!("{prefix}{symbol}")).copied();
    let errors: serde_json::Map<String, Value> =
        Link::SYMBOLS.iter().map(|symbol| ((*symbol).to_owned(), json!(std_error(symbol)))).collect();
    json!({
        "link": link + 1,
        "name": own.title,
        "frame": model.device.frames[own.frame].name,
        "mass_kg": m,
        "centroid_m": arm,
        "first_moment_kg_m": arm.map(|component| m * component),
        "inertia_about_centroid_kg_m2": about_centroid,
        "inertia_about_origin_kg_m2": about_origin,
        "std_error": errors,
        "not_identifiable": not_identifiable(model, |name| name.starts_with(&prefix)),
    })
}

fn of_effect(model: &Model, instance: &EffectInstance) -> Value {
    let names: Vec<String> = (0..instance.parameters.len()).map(|index| instance.parameter_name(index)).collect();
    let place = match instance.effect.place {
        Place::Actuator => "actuator",
        Place::Transmission => "transmission",
        Place::Joint => "joint",
        Place::Link => "link",
        Place::Sensor => "sensor",
    };
    json!({
        "effect": instance.effect.id,
        "title": instance.effect.title,
        "place": place,
        "joint": instance.joint,
        "from": instance.from,
        "payload": instance.payload,
        "formulas": formulas(instance),
        "parameters": parameters(model, |name| names.iter().any(|own| own == name)),
    })
}

/// Terms, outputs and rates of states by their names, as their file has them.
fn formulas(instance: &EffectInstance) -> Value {
    let effect = instance.effect;
    let written = |named: &[(String, dynid_model::Expression)]| -> serde_json::Map<String, Value> {
        named.iter().map(|(name, formula)| (name.clone(), json!(formula.to_string()))).collect()
    };
    let rates: serde_json::Map<String, Value> =
        effect.states.iter().map(|state| (state.symbol.clone(), json!(state.rate.to_string()))).collect();
    json!({ "terms": written(&effect.terms), "outputs": written(&effect.outputs), "rates": rates })
}

fn parameters(model: &Model, is_wanted: impl Fn(&str) -> bool) -> Vec<Value> {
    let fit = model.fit.as_ref();
    let wanted = model.parameters().into_iter().filter(|(name, _)| is_wanted(name));
    let of_parameter = |(name, parameter): (String, dynid_model::Parameter)| {
        json!({
            "name": name,
            "value": parameter.value,
            "unit": model.unit(&name),
            "std_error": fit.and_then(|fit| fit.std_error.get(&name)),
            "identifiable": fit.map(|fit| !fit.not_identifiable.contains(&name)),
        })
    };
    wanted.map(of_parameter).collect()
}

fn not_identifiable(model: &Model, is_wanted: impl Fn(&str) -> bool) -> Option<Vec<&str>> {
    let fit = model.fit.as_ref()?;
    Some(fit.not_identifiable.iter().map(String::as_str).filter(|name| is_wanted(name)).collect())
}

fn of_fit(fit: &FitRecord) -> Value {
    json!({
        "error": fit.error,
        "status": fit.status,
        "method": fit.method,
        "data_digest": fit.data_digest,
        "parent_digest": fit.parent_digest,
        "cost_before": fit.cost_before,
        "cost_after": fit.cost_after,
        "at_bound": fit.at_bound,
    })
}

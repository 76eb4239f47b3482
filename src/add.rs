//! A model with one effect more.

use dynid_model::{Device, Parameter};
use dynid_user_model::{Added, Model};

use crate::Error;

/// Which effect, where, and with which values.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Addition {
    /// Its name in the library, e.g. `coulomb`.
    pub effect: String,
    /// The joint that it acts on; `None` for an effect of the whole device.
    pub joint: Option<usize>,
    /// The other joint of a pair.
    pub from: Option<usize>,
    /// Values of its parameters by their symbols, e.g. `("Fc", 0.02)`; the others stand where the effect vanishes.
    pub values: Vec<(String, f64)>,
}

/// `model` with an effect more, where it does nothing yet; [`crate::fit()`] finds its values. A law that contains another takes
/// its place and keeps what they share.
///
/// # Errors
/// No such effect, or one that cannot stand there; a symbol that it does not have; a value outside its bounds.
///
/// ```
/// use dynid::{Addition, Model};
/// # let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/tour");
/// let model = Model::load(format!("{folder}/believed.toml"))?;
/// let addition = Addition { effect: "coulomb".to_owned(), joint: Some(4), ..Addition::default() };
/// let (better, added) = dynid::add(&model, &addition)?;
/// assert_eq!(added.label, "`coulomb` at joint 4");
/// assert_eq!(better.parameter("joint.4.coulomb.Fc").map(|own| own.value), Some(0.0));
/// # Ok::<(), dynid::Error>(())
/// ```
pub fn add(model: &Model, addition: &Addition) -> Result<(Model, Added), Error> {
    let mut model = model.clone();
    let added = model.add_effect_at_null(&addition.effect, addition.joint, addition.from)?;
    set_values(&mut model, &added, &addition.values)?;
    Ok((model, added))
}

/// The model of `device` with these effects and no others, each with the device's values or its first guesses, but for those that are
/// said.
///
/// # Errors
/// As [`add()`].
///
/// ```
/// use dynid::Addition;
/// let device = dynid::device("freedom6s").expect("it ships");
/// let values = vec![("Fv".to_owned(), 0.1)];
/// let viscous = Addition { effect: "viscous".to_owned(), joint: Some(0), values, ..Addition::default() };
/// let model = dynid::with_effects(device, &[viscous])?;
/// assert_eq!(model.effects.len(), 1);
/// assert_eq!(model.parameter("joint.0.viscous.Fv").map(|own| own.value), Some(0.1));
/// # Ok::<(), dynid::Error>(())
/// ```
pub fn with_effects(device: &'static Device, effects: &[Addition]) -> Result<Model, Error> {
    let mut model = Model::of_device(device);
    model.effects.clear();
    for Addition { effect, joint, from, values } in effects {
        let added = model.add_effect(effect, *joint, *from)?;
        set_values(&mut model, &added, values)?;
    }
    Ok(model)
}

/// Gives a parameter of `model` a value within its bounds.
///
/// # Errors
/// No such parameter; a value outside its bounds.
pub fn set_value(model: &mut Model, name: &str, value: f64) -> Result<(), Error> {
    let Parameter { lower, upper, .. } = model.require(name)?;
    if !(lower..=upper).contains(&value) {
        return Err(Error::OutsideBounds { name: name.to_owned(), value, lower, upper });
    }
    Ok(model.set_value(name, value)?)
}

/// Values of an effect that was just added, by its symbols.
fn set_values(model: &mut Model, added: &Added, values: &[(String, f64)]) -> Result<(), Error> {
    let symbol_of = |name: &String| name.rsplit('.').next().unwrap_or_default().to_owned();
    for (symbol, value) in values {
        let Some(name) = added.parameters.iter().find(|name| symbol_of(name) == *symbol) else {
            let known: Vec<String> = added.parameters.iter().map(symbol_of).collect();
            let (effect, symbol) = (added.label.clone(), symbol.clone());
            return Err(Error::NoSuchSymbol { effect, symbol, known: known.join(", ") });
        };
        set_value(model, name, *value)?;
    }
    Ok(())
}

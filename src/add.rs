//! A model with one effect more.

use dynid_model::Parameter;
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
    for (symbol, value) in &addition.values {
        let own = |name: &&String| name.rsplit('.').next() == Some(symbol);
        let Some(name) = added.parameters.iter().find(own) else {
            let symbols: Vec<&str> = added.parameters.iter().filter_map(|name| name.rsplit('.').next()).collect();
            return Err(Error::NoSuchSymbol { effect: added.label, symbol: symbol.clone(), known: symbols.join(", ") });
        };
        let Parameter { lower, upper, .. } = model.require(name)?;
        if !(lower..=upper).contains(value) {
            return Err(Error::OutsideBounds { name: name.clone(), value: *value, lower, upper });
        }
        model.set_value(name, *value)?;
    }
    Ok((model, added))
}

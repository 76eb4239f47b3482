//! From a [`Model`] to the text of its file: the text it was read from with its comments and order, where there is one.

use std::path::Path;

use dynid_model::{Link, Parameter, sha256_hex};
use toml_edit::{ArrayOfTables, DocumentMut, InlineTable, Item, Table, TableLike, Value, value};

use super::{BASE_SYMBOLS, EffectInstance, Model, default_parameter, fit_record::write_numbers, widened};

impl Model {
    /// The model file, to lie in the current folder. What was read and did not change keeps its place, its comments and its digits.
    pub fn to_toml(&self) -> String {
        self.to_toml_at(Path::new(""))
    }

    /// The model file, to lie at `path`: a device file is named by its path from there.
    pub fn to_toml_at(&self, path: &Path) -> String {
        let document = match self.origin.as_ref().and_then(|text| text.parse::<DocumentMut>().ok()) {
            Some(document) => self.updated(document),
            None => self.canonical(true),
        };
        self.with_device_named_from(document, path.parent().unwrap_or(path)).to_string()
    }

    fn with_device_named_from(&self, mut document: DocumentMut, folder: &Path) -> DocumentMut {
        let name = self.device.name_from(folder);
        if let Some(known) =
            document.get_mut("device").and_then(Item::as_value_mut).filter(|known| known.as_str() != Some(&*name))
        {
            let decor = known.decor().clone();
            *known = name.into();
            *known.decor_mut() = decor;
        }
        document
    }

    /// SHA-256 (hex) of every parameter, whatever the file looks like; how the values were found is not in it.
    pub fn digest(&self) -> String {
        sha256_hex(self.canonical(false).to_string().as_bytes())
    }

    /// All parameters in the model's order.
    fn canonical(&self, with_fit: bool) -> DocumentMut {
        let mut document = DocumentMut::new();
        document.insert("device", value(&self.device.id));
        let mut links = Table::new();
        links.set_implicit(true);
        for (link, parameters) in self.links.iter().enumerate() {
            let mut table = Table::new();
            for (index, symbol) in Link::SYMBOLS.iter().enumerate() {
                let default = self.device.links[link].inertial[index];
                table.insert(symbol, Item::Value(stated(parameters[index], default)));
            }
            links.insert(&(link + 1).to_string(), Item::Table(table));
        }
        document.insert("link", Item::Table(links));
        let mut lengths = Table::new();
        for (length, parameter) in self.device.lengths.iter().zip(&self.lengths) {
            lengths.insert(&length.symbol, Item::Value(stated(*parameter, Parameter::known(parameter.value))));
        }
        if !lengths.is_empty() {
            document.insert("length", Item::Table(lengths));
        }
        let mut base = Table::new();
        for (axis, symbol) in BASE_SYMBOLS.iter().enumerate().filter(|(axis, _)| self.device.up[*axis] != 0.0) {
            base.insert(symbol, Item::Value(stated(self.base[axis], Parameter::known(self.base[axis].value))));
        }
        if !base.is_empty() {
            document.insert("base", Item::Table(base));
        }
        let mut effects = ArrayOfTables::new();
        for instance in &self.effects {
            effects.push(self.effect_table(instance));
        }
        if !effects.is_empty() {
            document.insert("effect", Item::ArrayOfTables(effects));
        }
        if with_fit {
            self.write_history(&mut document);
        }
        document
    }

    fn effect_table(&self, instance: &EffectInstance) -> Table {
        let mut table = Table::new();
        table.insert("id", value(&instance.effect.id));
        // Joint numbers are small.
        if let Some(from) = instance.from {
            table.insert("from", value(from as i64));
        }
        if let Some(joint) = instance.joint {
            table.insert("joint", value(joint as i64));
        }
        if let Some(payload) = &instance.payload {
            table.insert("payload", value(payload));
        }
        for (own, parameter) in instance.effect.parameters.iter().zip(&instance.parameters) {
            let default = self.effect_default(instance, &own.symbol).unwrap_or_else(|| own.parameter());
            table.insert(&own.symbol, Item::Value(stated(*parameter, default)));
        }
        table
    }

    fn effect_default(&self, instance: &EffectInstance, symbol: &str) -> Option<Parameter> {
        default_parameter(self.device, instance.effect, (instance.joint, instance.from), symbol)
    }

    /// The file that was read, with what has changed since.
    fn updated(&self, mut document: DocumentMut) -> DocumentMut {
        for (link, parameters) in self.links.iter().enumerate() {
            let number = (link + 1).to_string();
            for (index, symbol) in Link::SYMBOLS.iter().enumerate() {
                update(
                    &mut document,
                    &["link", &number],
                    symbol,
                    parameters[index],
                    self.device.links[link].inertial[index],
                );
            }
        }
        for (length, parameter) in self.device.lengths.iter().zip(&self.lengths) {
            update(&mut document, &["length"], &length.symbol, *parameter, Parameter::known(length.value));
        }
        for (axis, symbol) in BASE_SYMBOLS.iter().enumerate().filter(|(axis, _)| self.device.up[*axis] != 0.0) {
            let default = Parameter::known(self.device.gravity * self.device.up[axis]);
            update(&mut document, &["base"], symbol, self.base[axis], default);
        }
        self.update_effects(&mut document);
        document.remove("fit");
        document.remove("believed");
        self.write_history(&mut document);
        document
    }

    /// How the values were found, and what they were believed to be before.
    fn write_history(&self, document: &mut DocumentMut) {
        if let Some(fit) = &self.fit {
            document.insert("fit", fit.write());
        }
        if !self.prior.is_empty() {
            document.insert("believed", write_numbers(&self.prior));
        }
    }

    /// Effects that are in the file keep their tables; new ones get tables, and those that are gone lose theirs.
    fn update_effects(&self, document: &mut DocumentMut) {
        let empty = ArrayOfTables::new();
        let old = document.get("effect").and_then(Item::as_array_of_tables).unwrap_or(&empty).clone();
        let mut new = ArrayOfTables::new();
        let mut shared: Vec<&EffectInstance> = Vec::new();
        for instance in &self.effects {
            if shared.iter().any(|known| known.is_same_place(instance)) {
                continue;
            }
            let Some(found) = old.iter().find(|table| self.is_of(table, instance)) else {
                new.push(self.effect_table(instance));
                continue;
            };
            let mut table = self.updated_table(found, instance);
            // A table of several joints stays one as long as it says the same of all of them.
            let named: Vec<&EffectInstance> = self.effects.iter().filter(|own| self.is_of(found, own)).collect();
            let n_named = self.joints_of(found).len();
            let says_the_same = |own: &&EffectInstance| self.updated_table(found, own).to_string() == table.to_string();
            if named.len() == n_named && named.iter().all(says_the_same) {
                shared.extend(named);
            } else if let (Some(joint), true) = (instance.joint, n_named > 1) {
                replace(&mut table, "joint", Value::from(joint as i64));
            }
            new.push(table);
        }
        if new.is_empty() {
            document.remove("effect");
        } else {
            document.insert("effect", Item::ArrayOfTables(new));
        }
    }
}

impl Model {
    /// A table of the file with the values of this effect.
    fn updated_table(&self, table: &Table, instance: &EffectInstance) -> Table {
        let mut table = table.clone();
        for (own, parameter) in instance.effect.parameters.iter().zip(&instance.parameters) {
            let default = self.effect_default(instance, &own.symbol).unwrap_or_else(|| own.parameter());
            update_in(&mut table, &own.symbol, *parameter, default);
        }
        table
    }

    /// Whether a table of the file stands for this effect, perhaps among others.
    fn is_of(&self, table: &Table, instance: &EffectInstance) -> bool {
        let text = |key: &str| table.get(key).and_then(Item::as_str);
        text("id") == Some(instance.effect.id.as_str())
            && text("payload") == instance.payload.as_deref()
            && table.get("from").and_then(Item::as_integer) == instance.from.map(|from| from as i64)
            && match instance.joint {
                Some(joint) => self.joints_of(table).contains(&(joint as i64)),
                None => true,
            }
    }

    /// The joints that an `[[effect]]` table names: one, several or all.
    fn joints_of(&self, table: &Table) -> Vec<i64> {
        let Some(item) = table.get("joint") else { return Vec::new() };
        let from = table.get("from").and_then(Item::as_integer);
        match (item.as_integer(), item.as_array()) {
            (Some(joint), _) => vec![joint],
            (_, Some(joints)) => joints.iter().filter_map(Value::as_integer).collect(),
            _ => (0..self.device.joints.len() as i64).filter(|joint| Some(*joint) != from).collect(),
        }
    }
}

/// A number, where that says it all; otherwise a table with bounds.
fn stated(parameter: Parameter, default: Parameter) -> Value {
    if widened(default, parameter.value) == parameter {
        return Value::from(parameter.value);
    }
    let mut table = InlineTable::new();
    table.insert("value", Value::from(parameter.value));
    table.insert("lower", Value::from(parameter.lower));
    table.insert("upper", Value::from(parameter.upper));
    if parameter.fixed != (parameter.lower == parameter.upper) {
        table.insert("fixed", Value::from(parameter.fixed));
    }
    Value::InlineTable(table)
}

/// Brings one key of a table, which is made where it is missing, to a parameter.
fn update(document: &mut DocumentMut, path: &[&str], key: &str, parameter: Parameter, default: Parameter) {
    let mut table: &mut dyn TableLike = document.as_table_mut();
    for (depth, name) in path.iter().enumerate() {
        if !table.contains_key(name) {
            if parameter == default {
                return;
            }
            let mut new = Table::new();
            new.set_implicit(depth + 1 < path.len());
            table.insert(name, Item::Table(new));
        }
        match table.get_mut(name).and_then(Item::as_table_like_mut) {
            Some(next) => table = next,
            None => return,
        }
    }
    update_in(table, key, parameter, default);
}

fn update_in(table: &mut dyn TableLike, key: &str, parameter: Parameter, default: Parameter) {
    let Some(item) = table.get_mut(key) else {
        if parameter != default {
            table.insert(key, Item::Value(stated(parameter, default)));
        }
        return;
    };
    if let Some(own) = item.as_table_like_mut() {
        return update_fields(own, parameter, default);
    }
    if number(item) == Some(parameter.value) && widened(default, parameter.value) == parameter {
        return;
    }
    if let Some(old) = item.as_value_mut() {
        let decor = old.decor().clone();
        *old = stated(parameter, default);
        *old.decor_mut() = decor;
    }
}

/// `{ value = .., lower = .., .. }`: changes what is no longer so, and adds what must now be said.
fn update_fields(own: &mut dyn TableLike, parameter: Parameter, default: Parameter) {
    let default = widened(default, parameter.value);
    let bounds_stated = own.contains_key("lower") || own.contains_key("upper");
    let implied = parameter.lower == parameter.upper || (default.fixed && !bounds_stated);
    for (key, new, unstated) in [
        ("value", parameter.value, f64::NAN),
        ("lower", parameter.lower, default.lower),
        ("upper", parameter.upper, default.upper),
    ] {
        let old = own.get(key).and_then(number).unwrap_or(unstated);
        if old != new {
            replace(own, key, Value::from(new));
        }
    }
    let fixed = own.get("fixed").and_then(Item::as_bool).unwrap_or(implied);
    let now_stated = own.contains_key("lower") || own.contains_key("upper");
    if fixed != parameter.fixed || now_stated != bounds_stated {
        replace(own, "fixed", Value::from(parameter.fixed));
    }
}

fn replace(table: &mut dyn TableLike, key: &str, new: Value) {
    match table.get_mut(key).and_then(Item::as_value_mut) {
        Some(old) => {
            let decor = old.decor().clone();
            *old = new;
            *old.decor_mut() = decor;
        }
        None => {
            table.insert(key, Item::Value(new));
        }
    }
}

fn number(item: &Item) -> Option<f64> {
    item.as_float().or_else(|| item.as_integer().map(|value| value as f64))
}

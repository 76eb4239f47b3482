//! From a model file to a checked [`Model`].

use std::path::Path;

use dynid_model::{
    Device, Link, ModelError, Parameter, Source, device_named,
    device_reader::check_mass,
    did_you_mean,
    document::{self, Table},
    effects,
    instance::{check_instances, read_instances},
    physical_consistency::check_body,
};

use super::{BASE_SYMBOLS, EffectInstance, FitRecord, Model, default_parameter, fit_record::numbers, widened};
use dynid_files::DocumentError;

/// Whether a link must be one that a body can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Bodies {
    Checked,
    Unchecked,
}

/// The device that a file is about: its key `device`, an id or the path of a device file from the file's folder.
pub fn device_of(root: &Table<'_>) -> Result<&'static Device, ModelError> {
    let entry = root.required("device", "\"<device>\"")?;
    let folder = root.source.path.parent().unwrap_or(Path::new(""));
    device_named(entry.text()?, folder).map_err(|error| entry.error(error.to_string()).help(error.remedy()))
}

impl Model {
    /// Reads a model file.
    ///
    /// # Errors
    /// A file that cannot be read, or the first thing that is wrong in it, with its place.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, DocumentError> {
        let path = path.as_ref();
        let text = dynid_files::read(path)?;
        Ok(Self::parse(&text, path)?)
    }

    /// Reads the text of a model file; `path` is for messages.
    ///
    /// # Errors
    /// The first thing that is wrong, with its place.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ModelError> {
        Self::parse_with(text, path, Bodies::Checked, None)
    }

    /// As [`Model::parse`], for a device that is known already, whatever the text calls it.
    ///
    /// # Errors
    /// The first thing that is wrong, with its place.
    pub fn parse_of(device: &'static Device, text: &str, path: &Path) -> Result<Self, ModelError> {
        Self::parse_with(text, path, Bodies::Checked, Some(device))
    }

    pub(super) fn parse_with(
        text: &str,
        path: &Path,
        bodies: Bodies,
        device: Option<&'static Device>,
    ) -> Result<Self, ModelError> {
        let source = Source::new(path, text);
        let document = document::parse(&source)?;
        let root = Table::root(&source, &document);
        root.only(&["device", "link", "length", "base", "effect", "fit", "believed"])?;
        let device = device.map_or_else(|| device_of(&root), Ok)?;
        let mut model = Self::of_device(device);
        model.effects.clear();
        read_links(&root, &mut model, bodies)?;
        read_lengths(&root, &mut model)?;
        read_base(&root, &mut model)?;
        read_effects(&root, &mut model)?;
        model.fit = root.optional("fit").map(|entry| FitRecord::read(&entry.table("[fit]")?)).transpose()?;
        model.prior = numbers(&root, "believed", "[believed]")?;
        let names = model.names();
        let unknown = model.prior.keys().filter(|name| !names.contains(name));
        let notes: Vec<String> = unknown
            .map(|name| {
                let help = did_you_mean(name, names.iter().map(String::as_str));
                format!("[believed]: the model has no parameter `{name}`, and the entry is not used ({help})")
            })
            .collect();
        model.notes.extend(notes);
        model.prior.retain(|name, _| names.contains(name));
        model.origin = Some(text.to_owned());
        Ok(model)
    }

    /// Reads one parameter and notes when it lies outside the bounds that the device gives.
    fn read_parameter(
        &mut self,
        table: &Table,
        key: &str,
        name: &str,
        default: Parameter,
    ) -> Result<Option<Parameter>, ModelError> {
        let Some(entry) = table.optional(key) else { return Ok(None) };
        let parameter = entry.parameter(&|value| widened(default, value))?;
        self.note_outside(name, parameter, default);
        Ok(Some(parameter))
    }

    fn note_outside(&mut self, name: &str, parameter: Parameter, default: Parameter) {
        let inherited = parameter.lower == default.lower.min(parameter.value)
            && parameter.upper == default.upper.max(parameter.value);
        if inherited && !default.contains(parameter.value) {
            let Parameter { lower, upper, .. } = default;
            let value = parameter.value;
            self.notes.push(format!(
                "{name} = {value} lies outside the bounds {lower} .. {upper} of device {}; they are widened to hold it",
                self.device.id
            ));
        }
    }
}

fn read_links(root: &Table, model: &mut Model, bodies: Bodies) -> Result<(), ModelError> {
    let Some(entry) = root.optional("link") else { return Ok(()) };
    let links = entry.table("[link]")?;
    let n_links = model.links.len();
    for (key, span) in links.keys() {
        let number = key.parse::<usize>().ok().filter(|number| (1..=n_links).contains(number));
        // `01` and `+1` would be second names of link 1.
        let number = number.filter(|number| number.to_string() == key);
        let Some(number) = number else {
            let error = root.source.error(span, format!("unknown link `{key}` of device `{}`", model.device.id));
            return Err(error.help(format!("links are numbered 1 to {n_links}, e.g. [link.1]")));
        };
        let table = links.required(key, "{}")?.table(&format!("link {number}"))?;
        table.only(&Link::SYMBOLS)?;
        for (index, symbol) in Link::SYMBOLS.iter().enumerate() {
            let default = model.links[number - 1][index];
            let name = format!("link.{number}.{symbol}");
            let Some(parameter) = model.read_parameter(&table, symbol, &name, default)? else { continue };
            if index == 0 {
                check_mass(&table.required(symbol, "<kg>")?, &table.what, &parameter)?;
            }
            model.links[number - 1][index] = parameter;
        }
        if bodies == Bodies::Unchecked {
            continue;
        }
        check_body(&model.links[number - 1].map(|parameter| parameter.value)).map_err(|impossible| {
            let stated = Link::SYMBOLS.iter().find(|symbol| symbol.starts_with('I') && table.optional(symbol).is_some());
            let span = stated.map_or(span, |symbol| table.key_span(symbol));
            root.source.error(span, format!("no body has the inertial parameters of link {number}: {impossible}")).help(
                "the sum of any two principal moments about the centroid is at least the third; what is not stated has the \
                 device's value",
            )
        })?;
    }
    Ok(())
}

fn read_lengths(root: &Table, model: &mut Model) -> Result<(), ModelError> {
    let Some(entry) = root.optional("length") else { return Ok(()) };
    let table = entry.table("[length]")?;
    let symbols: Vec<&str> = model.device.lengths.iter().map(|length| length.symbol.as_str()).collect();
    table.only(&symbols)?;
    for (index, symbol) in symbols.into_iter().enumerate() {
        if let Some(entry) = table.optional(symbol) {
            // A length is known unless the file gives it bounds.
            model.lengths[index] = entry.parameter(&Parameter::known)?;
        }
    }
    Ok(())
}

fn read_base(root: &Table, model: &mut Model) -> Result<(), ModelError> {
    let Some(entry) = root.optional("base") else { return Ok(()) };
    let table = entry.table("[base]")?;
    table.only(&BASE_SYMBOLS)?;
    for (axis, symbol) in BASE_SYMBOLS.into_iter().enumerate() {
        let Some(entry) = table.optional(symbol) else { continue };
        let parameter = entry.parameter(&Parameter::known)?;
        if model.device.up[axis] == 0.0 && parameter != Parameter::known(0.0) {
            return Err(entry
                .error(format!(
                    "`{symbol}` is not in the equations of device `{}`: its `up` has a 0 there",
                    model.device.id
                ))
                .help("tilt the base in the device file, which derives new equations"));
        }
        model.base[axis] = parameter;
    }
    Ok(())
}

fn read_effects(root: &Table, model: &mut Model) -> Result<(), ModelError> {
    let device = model.device;
    let tables = root.tables("effect", "effect", 1)?;
    let mut instances = Vec::new();
    for table in &tables {
        let read = read_instances(table, device.joints.len(), effects(), &|effect, place, symbol, stated| {
            let default = default_parameter(device, effect, place, symbol)?;
            Some(stated.map_or(default, |value| widened(default, value)))
        })?;
        for read in read {
            let Some(mut instance) = EffectInstance::new(device, &read.id, read.joint, read.from) else { continue };
            instance.payload.clone_from(&read.payload);
            for (symbol, parameter) in &read.values {
                let index = instance.effect.parameters.iter().position(|own| own.symbol == *symbol);
                let Some(index) = index else { continue };
                model.note_outside(&instance.parameter_name(index), *parameter, instance.parameters[index]);
                instance.parameters[index] = *parameter;
            }
            model.effects.push(instance);
            instances.push((table, read));
        }
    }
    check_instances(&instances, effects())
}

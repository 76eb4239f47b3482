//! Typed access to a TOML text that knows where everything stands.

use std::{fs, io, io::Read, ops::Range, path::Path};

use toml_edit::{ArrayOfTables, Document, Item, TableLike, Value};

use crate::{
    Expression,
    error::{ModelError, Source, did_you_mean},
    parameter::Parameter,
};

/// Bytes of a text that is read whole: no description of a robot, and no state of a fit, comes near.
pub const LARGEST_TEXT: u64 = 256 << 20;

/// Tables of one list of a document: joints, frames, links, effects, ..
pub const MOST_TABLES: usize = 4096;

/// The text of a file. Only what is a file is read: a pipe that nobody writes to, or a device without end, would keep the program for
/// ever.
///
/// # Errors
/// What is no file, is larger than [`LARGEST_TEXT`], or is no text.
pub fn read_text(path: &Path) -> io::Result<String> {
    if !fs::metadata(path)?.is_file() {
        // A folder says so itself.
        if !path.is_dir() {
            return Err(io::Error::other("it is no file but a pipe or a device; save what it gives to a file first"));
        }
    }
    let mut text = String::new();
    fs::File::open(path)?.take(LARGEST_TEXT + 1).read_to_string(&mut text)?;
    if text.len() as u64 > LARGEST_TEXT {
        return Err(io::Error::other(format!(
            "it has more than {LARGEST_TEXT} bytes, the most that a text may have here"
        )));
    }
    Ok(text)
}

/// Parses the text of a source.
///
/// # Errors
/// What is no TOML, with its place.
pub fn parse(source: &Source) -> Result<Document<String>, ModelError> {
    Document::parse(source.text.clone()).map_err(|error| {
        let message = error.message().replace('\n', ", ");
        source.error(error.span().unwrap_or(0..0), format!("this is not TOML: {message}"))
    })
}

/// A table with its name and place.
#[derive(Clone)]
pub struct Table<'a> {
    /// The file.
    pub source: &'a Source,
    /// What it describes, for messages, e.g. "link 3".
    pub what: String,
    /// Where it stands.
    pub span: Range<usize>,
    table: &'a dyn TableLike,
}

/// A value with its place and the name it has in messages.
#[derive(Clone)]
pub struct Entry<'a> {
    /// The file.
    pub source: &'a Source,
    /// E.g. "`m` of link 3".
    pub what: String,
    /// Where the value stands.
    pub span: Range<usize>,
    node: Node<'a>,
}

#[derive(Clone, Copy)]
enum Node<'a> {
    Value(&'a Value),
    Table(&'a dyn TableLike),
    Tables(&'a ArrayOfTables),
}

impl<'a> Table<'a> {
    /// The whole document.
    pub fn root(source: &'a Source, document: &'a Document<String>) -> Self {
        Self { source, what: "the file".to_owned(), span: 0..0, table: document.as_table() }
    }

    /// An error at this table.
    pub fn error(&self, message: impl Into<String>) -> ModelError {
        self.source.error(self.span.clone(), message)
    }

    /// The same table under another name in messages.
    #[must_use]
    pub fn named(&self, what: String) -> Self {
        Self { what, ..self.clone() }
    }

    /// Every key and its place, in the order of the file.
    pub fn keys(&self) -> Vec<(&'a str, Range<usize>)> {
        self.table.iter().map(|(key, _)| (key, self.key_span(key))).collect()
    }

    /// Where a key stands; the table's place without such a key.
    pub fn key_span(&self, key: &str) -> Range<usize> {
        self.table.get_key_value(key).and_then(|(key, _)| key.span()).unwrap_or_else(|| self.span.clone())
    }

    /// Refuses keys that are not in `known`.
    ///
    /// # Errors
    /// The first unknown key, with the nearest known one.
    pub fn only(&self, known: &[&str]) -> Result<(), ModelError> {
        for (key, span) in self.keys() {
            if !known.contains(&key) {
                let message = format!("unknown key `{key}` in {}", self.what);
                return Err(self.source.error(span, message).help(did_you_mean(key, known.iter().copied())));
            }
        }
        Ok(())
    }

    /// The value of a key, if it is there.
    pub fn optional(&self, key: &str) -> Option<Entry<'a>> {
        let item = self.table.get(key)?;
        let span = item.span().unwrap_or_else(|| self.key_span(key));
        let node = match item {
            Item::Value(value) => Node::Value(value),
            Item::Table(table) => Node::Table(table),
            Item::ArrayOfTables(tables) => Node::Tables(tables),
            Item::None => return None,
        };
        Some(Entry { source: self.source, what: format!("`{key}` of {}", self.what), span, node })
    }

    /// The value of a key.
    ///
    /// # Errors
    /// A missing key; `expected` says what should stand there.
    pub fn required(&self, key: &str, expected: &str) -> Result<Entry<'a>, ModelError> {
        self.optional(key).ok_or_else(|| {
            self.error(format!("`{key}` is missing in {}", self.what)).help(format!("add `{key} = {expected}`"))
        })
    }

    /// A sub-table that must be there.
    ///
    /// # Errors
    /// It is missing or is no table.
    pub fn table(&self, key: &str, expected: &str) -> Result<Table<'a>, ModelError> {
        match self.optional(key) {
            Some(entry) => entry.table(&format!("[{key}]")),
            None => Err(self
                .error(format!("the table `[{key}]` is missing in {}", self.what))
                .help(format!("add `[{key}]` with {expected}"))),
        }
    }

    /// The tables of `[[key]]`, or of an array of inline tables; none if the key is absent. `what` is their name.
    ///
    /// # Errors
    /// It is something else.
    pub fn tables(&self, key: &str, what: &str, from: usize) -> Result<Vec<Table<'a>>, ModelError> {
        let Some(entry) = self.optional(key) else { return Ok(Vec::new()) };
        let count = match entry.node {
            Node::Tables(array) => array.len(),
            Node::Value(Value::Array(array)) => array.len(),
            _ => 0,
        };
        if count > MOST_TABLES {
            let message = format!("`{key}` has {count} entries, more than {MOST_TABLES}");
            return Err(entry.error(message).help(format!("keep at most {MOST_TABLES}")));
        }
        let mut tables = Vec::new();
        match entry.node {
            Node::Tables(array) => {
                for (index, table) in array.iter().enumerate() {
                    let span = table.span().unwrap_or_else(|| entry.span.clone());
                    tables.push(Table { source: self.source, what: format!("{what} {}", index + from), span, table });
                }
            }
            Node::Value(Value::Array(array)) => {
                for (index, value) in array.iter().enumerate() {
                    let span = value.span().unwrap_or_else(|| entry.span.clone());
                    let Some(table) = value.as_inline_table() else {
                        return Err(self
                            .source
                            .error(span, format!("`{key}` holds tables `{{ .. }}`, found {}", kind(value))));
                    };
                    tables.push(Table { source: self.source, what: format!("{what} {}", index + from), span, table });
                }
            }
            _ => {
                return Err(entry
                    .error(format!("`{key}` must be a list of tables"))
                    .help(format!("write `[[{key}]]`")));
            }
        }
        Ok(tables)
    }
}

impl<'a> Entry<'a> {
    /// An error at this value.
    pub fn error(&self, message: impl Into<String>) -> ModelError {
        self.source.error(self.span.clone(), message)
    }

    fn wrong(&self, expected: &str) -> ModelError {
        let found = match self.node {
            Node::Value(value) => kind(value),
            Node::Table(_) => "a table",
            Node::Tables(_) => "a list of tables",
        };
        self.error(format!("{} must be {expected}, found {found}", self.what))
    }

    /// A text.
    ///
    /// # Errors
    /// It is none, or it is empty.
    pub fn text(&self) -> Result<&'a str, ModelError> {
        match self.string() {
            Some(text) if text.trim().is_empty() => {
                Err(self.error(format!("{} is empty", self.what)).help("fill it in, or remove the key"))
            }
            Some(text) => Ok(text),
            None => Err(self.wrong("a text in quotes")),
        }
    }

    /// A number; `inf` is one, `nan` is not. A text holds an expression of numbers such as `"pi/2"`.
    ///
    /// # Errors
    /// It is none.
    pub fn number(&self) -> Result<f64, ModelError> {
        let value = match self.node {
            Node::Value(Value::Float(value)) => *value.value(),
            // Integers of a description are small; those past 2^53 lose digits as every literal does.
            Node::Value(Value::Integer(value)) => *value.value() as f64,
            Node::Value(Value::String(_)) => {
                let expression = self.expression()?;
                match expression.evaluate(&|_| None) {
                    Ok(value) => value,
                    Err(symbol) => {
                        let message = format!("{} must be a number, found the symbol `{symbol}`", self.what);
                        return Err(self.symbol_error(&symbol, message).help("give a number, e.g. 0.5 or \"pi/2\""));
                    }
                }
            }
            _ => return Err(self.wrong("a number")),
        };
        if value.is_nan() {
            return Err(self.error(format!("{} is not a number", self.what)).help("give its value"));
        }
        Ok(value)
    }

    /// A number that is neither infinite nor undefined.
    ///
    /// # Errors
    /// It is none.
    pub fn finite(&self) -> Result<f64, ModelError> {
        match self.number()? {
            value if value.is_finite() => Ok(value),
            value => Err(self.error(format!("{} must be finite, found {value}", self.what)).help("give a number")),
        }
    }

    /// A whole number from 0.
    ///
    /// # Errors
    /// It is none.
    pub fn index(&self) -> Result<usize, ModelError> {
        let value = self.value().and_then(Value::as_integer).ok_or_else(|| self.wrong("a whole number"))?;
        usize::try_from(value).map_err(|_| self.error(format!("{} must not be negative, found {value}", self.what)))
    }

    /// `true` or `false`.
    ///
    /// # Errors
    /// It is neither.
    pub fn flag(&self) -> Result<bool, ModelError> {
        self.value().and_then(Value::as_bool).ok_or_else(|| self.wrong("`true` or `false`"))
    }

    /// The elements of an array.
    ///
    /// # Errors
    /// It is none.
    pub fn array(&self) -> Result<Vec<Entry<'a>>, ModelError> {
        let array = self.value().and_then(Value::as_array).ok_or_else(|| self.wrong("a list `[ .. ]`"))?;
        Ok(array
            .iter()
            .enumerate()
            .map(|(index, value)| Entry {
                source: self.source,
                what: format!("entry {} of {}", index + 1, self.what),
                span: value.span().unwrap_or_else(|| self.span.clone()),
                node: Node::Value(value),
            })
            .collect())
    }

    /// The sub-table at this key.
    ///
    /// # Errors
    /// It is none.
    pub fn table(&self, what: &str) -> Result<Table<'a>, ModelError> {
        let table: &dyn TableLike = match self.node {
            Node::Value(Value::InlineTable(table)) => table,
            Node::Table(table) => table,
            _ => return Err(self.wrong("a table")),
        };
        Ok(Table { source: self.source, what: what.to_owned(), span: self.span.clone(), table })
    }

    /// Whether a table stands here, inline or not.
    pub fn is_table(&self) -> bool {
        matches!(self.node, Node::Table(_) | Node::Value(Value::InlineTable(_)))
    }

    /// Whether a list stands here.
    pub fn is_array(&self) -> bool {
        matches!(self.node, Node::Value(Value::Array(_)))
    }

    /// An expression: a text, or a plain number.
    ///
    /// # Errors
    /// It is none; the error points into the text.
    pub fn expression(&self) -> Result<Expression, ModelError> {
        match self.node {
            Node::Value(Value::Integer(_) | Value::Float(_)) => {
                let value = self.finite()?;
                // The parser makes no negative literals either: printed and parsed again, it is the same tree.
                let size = Expression::Number(value.abs());
                Ok(if value < 0.0 { Expression::Negate(Box::new(size)) } else { size })
            }
            _ => {
                let text = self.string().ok_or_else(|| self.wrong("an expression in quotes, or a number"))?;
                Expression::parse(text).map_err(|error| {
                    let start = self.text_start(text);
                    let span = start + error.span.start..start + error.span.end;
                    self.source.error(span, format!("{} in {}", error.message, self.what)).help(error.help)
                })
            }
        }
    }

    /// An error at the first place where a symbol stands in this expression.
    pub fn symbol_error(&self, symbol: &str, message: impl Into<String>) -> ModelError {
        let span = self.string().and_then(|text| {
            let is_name = |character: char| character.is_alphanumeric() || character == '_';
            let (place, _) = text.match_indices(symbol).find(|(place, _)| {
                !text[..*place].ends_with(is_name) && !text[place + symbol.len()..].starts_with(is_name)
            })?;
            let start = self.text_start(text) + place;
            Some(start..start + symbol.len())
        });
        self.source.error(span.unwrap_or_else(|| self.span.clone()), message)
    }

    fn value(&self) -> Option<&'a Value> {
        if let Node::Value(value) = self.node { Some(value) } else { None }
    }

    fn string(&self) -> Option<&'a str> {
        self.value().and_then(Value::as_str)
    }

    /// Where the content of a quoted text begins in the file; a text with escapes is found by its opening quote.
    fn text_start(&self, text: &str) -> usize {
        let quoted = self.source.text.get(self.span.clone()).unwrap_or_default();
        self.span.start + quoted.find(text).unwrap_or(1)
    }

    /// A parameter: a number, or `{ value, lower, upper, fixed }`. What is not given is taken from `default`, whose
    /// bounds are asked for by the value. Who states bounds frees a parameter that is fixed by default.
    ///
    /// # Errors
    /// Bounds that cross, a value outside of them, an infinite value, an unknown key.
    pub fn parameter(&self, default: &dyn Fn(f64) -> Parameter) -> Result<Parameter, ModelError> {
        if !self.is_table() {
            let value = self.finite()?;
            let parameter = default(value);
            return self.within(value, parameter, self.span.clone());
        }
        let table = self.table(&self.what)?;
        table.only(&["value", "lower", "upper", "fixed"])?;
        let value_entry = table.required("value", "<number>")?;
        let value = value_entry.finite()?;
        let mut parameter = default(value);
        if let Some(lower) = table.optional("lower") {
            parameter.lower = lower.number()?;
        }
        if let Some(upper) = table.optional("upper") {
            parameter.upper = upper.number()?;
        }
        if parameter.lower > parameter.upper {
            let message = format!(
                "the bounds of {} cross: lower {} is above upper {}",
                self.what, parameter.lower, parameter.upper
            );
            return Err(self.error(message).help("exchange them"));
        }
        let stated = table.optional("lower").is_some() || table.optional("upper").is_some();
        parameter.fixed = match table.optional("fixed") {
            Some(fixed) => fixed.flag()?,
            None => parameter.lower == parameter.upper || (parameter.fixed && !stated),
        };
        self.within(value, parameter, value_entry.span)
    }

    fn within(&self, value: f64, parameter: Parameter, span: Range<usize>) -> Result<Parameter, ModelError> {
        if !parameter.contains(value) {
            let Parameter { lower, upper, .. } = parameter;
            let message = format!("{} is {value}, outside its bounds {lower} .. {upper}", self.what);
            return Err(self
                .source
                .error(span, message)
                .help("change the value, or give other bounds: `{ value = .., lower = .., upper = .. }`"));
        }
        Ok(Parameter { value, ..parameter })
    }
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::String(_) => "a text",
        Value::Integer(_) | Value::Float(_) => "a number",
        Value::Boolean(_) => "`true` or `false`",
        Value::Datetime(_) => "a date",
        Value::Array(_) => "a list",
        Value::InlineTable(_) => "a table",
    }
}

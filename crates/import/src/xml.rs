//! XML with places: elements, attributes and numbers in them, or errors that point there.

use std::ops::Range;

use dynid_model::{ModelError, Source};
use roxmltree::{Document, Error, Node, TextPos};

use crate::number::Number;

/// Prefixes of names that nobody declared.
const MOST_PREFIXES: usize = 32;

const RUN_XACRO: &str = "this file is a template; run xacro first, e.g. `xacro robot.urdf.xacro > robot.urdf`";

/// Text that stands in for the file's, place for place, where XML is stricter than readers of robot descriptions are: whatever comes
/// before the declaration, and prefixes that nobody declared.
pub(crate) fn tolerant(source: &Source) -> Result<String, ModelError> {
    let mut text = source.text.replacen('\u{feff}', "   ", 1);
    if let Some((start, length)) = text.find("<?xml ").and_then(|start| Some((start, text[start..].find("?>")? + 2))) {
        let blank: String = text[start..start + length].chars().map(|c| if c == '\n' { '\n' } else { ' ' }).collect();
        if blank.len() == length {
            text.replace_range(start..start + length, &blank);
        }
    }
    // Each prefix costs a look at the whole text.
    for _ in 0..=MOST_PREFIXES {
        match Document::parse(&text).err() {
            None => return Ok(text),
            Some(Error::UnknownNamespace(prefix, position)) => {
                let place = offset(&text, position);
                if prefix == "xacro" {
                    return Err(source
                        .error(place..place + 1, "xacro is left in: the prefix `xacro:`")
                        .help(RUN_XACRO));
                }
                let without: Vec<(String, String)> = ["<", "</", " ", "\n", "\t"]
                    .iter()
                    .map(|before| (format!("{before}{prefix}:"), format!("{before}{prefix}_")))
                    .collect();
                let renamed = without.iter().fold(text.clone(), |text, (from, to)| text.replace(from, to));
                if renamed == text {
                    return Err(malformed(source, &Error::UnknownNamespace(prefix, position)));
                }
                text = renamed;
            }
            Some(error) => return Err(malformed(source, &error)),
        }
    }
    let message = format!("more than {MOST_PREFIXES} prefixes are declared nowhere");
    Err(source.error(0..1, message).help("declare them, `xmlns:prefix=\"..\"`, or take them out"))
}

fn malformed(source: &Source, error: &Error) -> ModelError {
    let place = offset(&source.text, error.pos());
    let message = error.to_string();
    // The place is shown as everywhere; the parser's own wording of it would stand twice.
    let message = message.rsplit_once(" at ").map_or(message.as_str(), |(message, _)| message);
    source
        .error(place..place + 1, format!("this is no XML: {message}"))
        .help("mend the file, or write it again with the program that made it")
}

fn offset(text: &str, position: TextPos) -> usize {
    let row = position.row.saturating_sub(1) as usize;
    let start: usize = text.split_inclusive('\n').take(row).map(str::len).sum();
    let column = position.col.saturating_sub(1) as usize;
    start + text[start..].chars().take(column).map(char::len_utf8).sum::<usize>()
}

/// Refuses what xacro should have replaced.
pub(crate) fn refuse_xacro(source: &Source, document: &Document) -> Result<(), ModelError> {
    for node in document.descendants().filter(Node::is_element) {
        if node.tag_name().namespace().is_some_and(|namespace| namespace.contains("xacro")) {
            let message = format!("xacro is left in: the element `xacro:{}`", node.tag_name().name());
            return Err(source.error(tag(node), message).help(RUN_XACRO));
        }
        for attribute in node.attributes() {
            let is_xacro = attribute.namespace().is_some_and(|namespace| namespace.contains("xacro"));
            if is_xacro || attribute.value().contains("${") || attribute.value().contains("$(") {
                let message = format!("xacro is left in: `{}`", &source.text[attribute.range()]);
                return Err(source.error(attribute.range(), message).help(RUN_XACRO));
            }
        }
    }
    Ok(())
}

/// Where an element begins: `<joint`.
pub(crate) fn tag(node: Node) -> Range<usize> {
    let start = node.range().start;
    start..start + 1 + node.tag_name().name().len()
}

/// The first child element of a name.
pub(crate) fn child<'a>(node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|child| child.has_tag_name(name))
}

/// The text of an attribute, and where it stands.
pub(crate) fn text<'a>(source: &Source, node: Node<'a, 'a>, name: &str) -> Result<(&'a str, Range<usize>), ModelError> {
    let element = node.tag_name().name();
    let Some(attribute) = node.attribute_node(name) else {
        return Err(source
            .error(tag(node), format!("`<{element}>` has no `{name}`"))
            .help(format!("add the attribute `{name}=\"..\"`")));
    };
    let text = attribute.value().trim();
    if text.is_empty() {
        return Err(source.error(attribute.range(), format!("`{name}` of `<{element}>` is empty")).help("fill it in"));
    }
    Ok((text, attribute.range_value()))
}

/// One number; `None` where the attribute is missing.
pub(crate) fn number(source: &Source, node: Node, name: &str) -> Result<Option<Number>, ModelError> {
    Ok(numbers(source, node, name)?.map(|[number]| number))
}

/// One finite number that must be there.
pub(crate) fn required_number(source: &Source, node: Node, name: &str) -> Result<Number, ModelError> {
    let (_, place) = text(source, node, name)?;
    match number(source, node, name)? {
        Some(number) if number.value.is_finite() => Ok(number),
        _ => Err(source.error(place, format!("`{name}` must be finite")).help("give a number")),
    }
}

/// So many numbers; `None` where the attribute is missing.
pub(crate) fn numbers<const COUNT: usize>(
    source: &Source,
    node: Node,
    name: &str,
) -> Result<Option<[Number; COUNT]>, ModelError> {
    let Some(attribute) = node.attribute_node(name) else { return Ok(None) };
    let element = node.tag_name().name();
    let mut found = Vec::new();
    for word in attribute.value().split_whitespace() {
        let Some(number) = Number::parse(word) else {
            let within = source.text[attribute.range_value()].find(word).unwrap_or(0);
            let start = attribute.range_value().start + within;
            return Err(source
                .error(start..start + word.len(), format!("`{name}` of `<{element}>`: `{word}` is no number"))
                .help("write a number such as 0.5 or 1e-3"));
        };
        found.push(number);
    }
    <[Number; COUNT]>::try_from(found).map(Some).map_err(|found| {
        let message = format!("`{name}` of `<{element}>` holds {}, found {}", counted(COUNT, "number"), found.len());
        source.error(attribute.range(), message).help("separate numbers by spaces")
    })
}

/// `3 joints`, `1 joint`.
pub(crate) fn counted(count: usize, what: &str) -> String {
    if count == 1 { format!("1 {what}") } else { format!("{count} {what}s") }
}

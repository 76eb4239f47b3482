//! Changes of a text, by where they are in it.

use std::ops::Range;

use roxmltree::Node;

/// Changes of an XML text that leave everything else as it is.
#[derive(Debug)]
pub(super) struct Edits<'a> {
    text: &'a str,
    /// What takes the place of which part; parts do not overlap.
    parts: Vec<(Range<usize>, String)>,
}

impl<'a> Edits<'a> {
    pub fn new(text: &'a str) -> Self {
        Self { text, parts: Vec::new() }
    }

    /// Gives an attribute a value, which is added where the element does not have it.
    pub fn set(&mut self, element: Node, attribute: &str, value: &str) {
        match element.attribute_node(attribute) {
            Some(own) => self.parts.push((own.range_value(), value.to_owned())),
            None => {
                let after_name = element.range().start + 1 + element.tag_name().name().len();
                let place = element.attributes().next_back().map_or(after_name, |last| last.range().end);
                self.insert(place, &format!(" {attribute}=\"{value}\""));
            }
        }
    }

    /// Gives an attribute numbers, unless it has them already.
    pub fn set_numbers(&mut self, element: Node, attribute: &str, numbers: &[f64]) {
        let stated = element
            .attribute(attribute)
            .map(|text| text.split_whitespace().map(|word| word.parse().unwrap_or(f64::NAN)).collect::<Vec<f64>>());
        if stated.as_deref() != Some(numbers) {
            let words: Vec<String> = numbers.iter().map(|number| written(*number)).collect();
            self.set(element, attribute, &words.join(" "));
        }
    }

    /// As [`Edits::set_numbers`], where an element without the attribute has `default`.
    pub fn set_numbers_or_default(&mut self, element: Node, attribute: &str, numbers: &[f64], default: &[f64]) {
        if element.has_attribute(attribute) || numbers != default {
            self.set_numbers(element, attribute, numbers);
        }
    }

    /// Another attribute in the place of one.
    pub fn rename(&mut self, element: Node, attribute: &str, new: &str, numbers: &[f64]) {
        let words: Vec<String> = numbers.iter().map(|number| written(*number)).collect();
        match element.attribute_node(attribute) {
            Some(own) => self.parts.push((own.range(), format!("{new}=\"{}\"", words.join(" ")))),
            None => self.set(element, new, &words.join(" ")),
        }
    }

    /// Takes out an attribute, and the blanks before it.
    pub fn remove_attribute(&mut self, element: Node, attribute: &str) {
        if let Some(own) = element.attribute_node(attribute) {
            self.parts.push((self.with_blanks_before(own.range()), String::new()));
        }
    }

    /// Adds an element as the first in another, on a line of its own where the others are.
    pub fn add_child(&mut self, parent: Node, child: &str) {
        if let Some(first) = parent.children().find(Node::is_element) {
            let place = first.range().start;
            let blanks = self.with_blanks_before(first.range()).start..place;
            let between = self.text[blanks].to_owned();
            self.insert(place, &format!("{child}{between}"));
            return;
        }
        let range = parent.range();
        let name = parent.tag_name().name();
        if self.text[range.clone()].ends_with("/>") {
            self.parts.push((range.end - 2..range.end, format!(">{child}</{name}>")));
        } else {
            let place = self.text[range.clone()].rfind("</").map_or(range.end, |place| range.start + place);
            self.insert(place, child);
        }
    }

    /// The text with all changes.
    pub fn applied(mut self) -> String {
        self.parts.sort_by_key(|(range, _)| (range.start, range.end));
        let mut text = String::with_capacity(self.text.len());
        let mut from = 0;
        for (range, new) in &self.parts {
            text.push_str(&self.text[from..range.start]);
            text.push_str(new);
            from = range.end;
        }
        text.push_str(&self.text[from..]);
        text
    }

    fn insert(&mut self, place: usize, text: &str) {
        self.parts.push((place..place, text.to_owned()));
    }

    fn with_blanks_before(&self, range: Range<usize>) -> Range<usize> {
        self.text[..range.start].trim_end().len()..range.end
    }
}

/// The shortest text that is read as the same number.
pub(super) fn written(number: f64) -> String {
    if number == 0.0 { "0".to_owned() } else { format!("{number:?}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roxmltree::Document;

    #[test]
    fn only_what_is_changed_changes() {
        let text = "<robot>\n  <!-- a -->\n  <link  name='a' mass = \"1.50\" pose='0 0'/>\n  <link name=\"b\">\n    <x/>\n  </link>\n</robot>\n";
        let document = Document::parse(text).unwrap();
        let links: Vec<Node> = document.root_element().children().filter(Node::is_element).collect();
        let mut edits = Edits::new(text);
        edits.set_numbers(links[0], "mass", &[1.5]);
        edits.set_numbers(links[0], "pose", &[0.0, 0.1]);
        edits.add_child(links[0], "<y/>");
        edits.add_child(links[1], "<y/>");
        edits.set_numbers(links[1], "mass", &[2.0]);
        assert_eq!(
            edits.applied(),
            "<robot>\n  <!-- a -->\n  <link  name='a' mass = \"1.50\" pose='0 0.1'><y/></link>\n  <link name=\"b\" mass=\"2.0\">\n    <y/>\n    <x/>\n  </link>\n</robot>\n"
        );
        let mut edits = Edits::new(text);
        edits.remove_attribute(links[0], "mass");
        assert_eq!(
            edits.applied(),
            "<robot>\n  <!-- a -->\n  <link  name='a' pose='0 0'/>\n  <link name=\"b\">\n    <x/>\n  </link>\n</robot>\n"
        );
    }
}

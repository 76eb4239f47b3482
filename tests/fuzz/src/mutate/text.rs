//! Changes of TOML, XML and JSON by what they all have: words, numbers, texts in quotes, brackets, lines, sections.

use std::ops::Range;

use super::{NUMBERS, WORDS};
use crate::draw::Draw;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Number,
    Word,
    Quoted,
    Other,
}

/// One change.
pub fn change(text: &mut String, other: &str, draw: &mut Draw) {
    match draw.below(12) {
        0..=5 => change_token(text, other, draw),
        6..=8 => change_lines(text, other, draw),
        9 => change_section(text, other, draw),
        10 if draw.one_in(8) => nest(text, draw),
        11 => {
            let at = place(text, draw);
            let more: String = match draw.below(3) {
                0 => (*draw.of_these(&WORDS)).to_owned(),
                1 => (*draw.of_these(&[
                    "[",
                    "]",
                    "{",
                    "}",
                    "(",
                    ")",
                    "<",
                    ">",
                    "</",
                    "/>",
                    "=",
                    ",",
                    "\"",
                    "'",
                    "#",
                    "\\u",
                    "&#",
                    "&a;",
                    "\"\"\"",
                    "<!--",
                    "<![CDATA[",
                ]))
                .to_owned(),
                _ => draw.of_these(&["a", "0", "\"", "-", " ", "\n", "["]).repeat(draw.size(100)),
            };
            text.insert_str(at, &more);
        }
        _ => {}
    }
}

fn place(text: &str, draw: &mut Draw) -> usize {
    let at = draw.below(text.len() + 1);
    (0..=at).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0)
}

/// The tokens that are no blanks.
fn tokens(text: &str) -> Vec<(Kind, Range<usize>)> {
    let mut found = Vec::new();
    let bytes = text.as_bytes();
    let mut at = 0;
    while at < bytes.len() {
        let start = at;
        let first = bytes[at];
        at += 1;
        let is_number = |byte: u8| byte.is_ascii_digit() || matches!(byte, b'.' | b'e' | b'E' | b'+' | b'-' | b'_');
        let is_word = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-' | b':') || byte >= 0x80;
        let kind = match first {
            b'"' => {
                while at < bytes.len() && bytes[at] != b'"' && bytes[at] != b'\n' {
                    at += if bytes[at] == b'\\' { 2 } else { 1 };
                }
                at = (at + 1).min(bytes.len());
                Kind::Quoted
            }
            b'0'..=b'9' | b'-' | b'+' => {
                while at < bytes.len() && is_number(bytes[at]) {
                    at += 1;
                }
                Kind::Number
            }
            _ if is_word(first) => {
                while at < bytes.len() && is_word(bytes[at]) {
                    at += 1;
                }
                Kind::Word
            }
            b' ' | b'\n' | b'\r' | b'\t' => continue,
            _ => Kind::Other,
        };
        if text.is_char_boundary(start) && text.is_char_boundary(at) {
            found.push((kind, start..at));
        }
    }
    found
}

fn change_token(text: &mut String, other: &str, draw: &mut Draw) {
    let own = tokens(text);
    if own.is_empty() {
        return;
    }
    let (kind, range) = draw.of_these(&own).clone();
    let new = match (draw.below(8), kind) {
        (0..=2, Kind::Number) => (*draw.of_these(&NUMBERS)).to_owned(),
        (0, Kind::Quoted) => format!("\"{}\"", draw.of_these(&WORDS).escape_debug()),
        // What stands in quotes in XML is made of words and numbers itself; in a formula too.
        (1 | 2, Kind::Quoted) => {
            let inner = text[range.clone()].trim_matches('"').to_owned();
            let parts = tokens(&inner);
            if parts.is_empty() {
                return;
            }
            let (_, part) = draw.of_these(&parts).clone();
            let new: &str = if draw.one_in(2) {
                draw.copy_of(&NUMBERS)
            } else {
                draw.copy_of(&["", "(", ")", "-", "*", "/ 0", "q0", "sin(", "x", "if", "1e400", "\u{e9}"])
            };
            format!("\"{}{new}{}\"", &inner[..part.start], &inner[part.end..])
        }
        (0, _) => (*draw.of_these(&WORDS)).to_owned(),
        (3, _) => String::new(),
        (4, _) => text[range.clone()].repeat(2),
        // Another of the same kind, of here or of elsewhere.
        (5, _) => {
            let theirs = tokens(other);
            let same: Vec<_> = theirs.iter().filter(|(other, _)| *other == kind).collect();
            if same.is_empty() {
                return;
            }
            other[draw.of_these(&same).1.clone()].to_owned()
        }
        _ => {
            let same: Vec<_> = own.iter().filter(|(other, at)| *other == kind && *at != range).collect();
            if same.is_empty() {
                return;
            }
            let with = draw.of_these(&same).1.clone();
            let (first, second) = if with.start < range.start { (with, range) } else { (range, with) };
            let (one, two) = (text[first.clone()].to_owned(), text[second.clone()].to_owned());
            text.replace_range(second, &one);
            text.replace_range(first, &two);
            return;
        }
    };
    text.replace_range(range, &new);
}

fn change_lines(text: &mut String, other: &str, draw: &mut Draw) {
    let mut lines: Vec<&str> = text.split_inclusive('\n').collect();
    let theirs: Vec<&str> = other.split_inclusive('\n').collect();
    if lines.is_empty() {
        return;
    }
    let (at, with) = (draw.below(lines.len()), draw.below(lines.len()));
    match draw.below(5) {
        0 => drop(lines.remove(at)),
        1 => lines.insert(with, lines[at]),
        2 => lines.swap(at, with),
        3 if !theirs.is_empty() => lines.insert(at, draw.copy_of(&theirs)),
        _ => {
            let end = (at + draw.size(12)).min(lines.len());
            let own = lines[at..end].to_vec();
            lines.splice(with..with, own);
        }
    }
    *text = lines.concat();
}

/// A table of TOML, an element of XML, an object of JSON: removed, doubled, moved, taken from elsewhere.
fn change_section(text: &mut String, other: &str, draw: &mut Draw) {
    let Some(own) = section(text, draw) else { return };
    let content = text[own.clone()].to_owned();
    match draw.below(4) {
        0 => text.replace_range(own, ""),
        1 => text.insert_str(own.end, &content),
        2 => {
            let times = draw.size(200);
            text.insert_str(own.end, &content.repeat(times.min(100_000 / content.len().max(1))));
        }
        _ => {
            if let Some(theirs) = section(other, draw) {
                text.replace_range(own, &other[theirs]);
            }
        }
    }
}

fn section(text: &str, draw: &mut Draw) -> Option<Range<usize>> {
    let starts: Vec<usize> = match draw.below(3) {
        0 => text.match_indices("\n[").map(|(at, _)| at + 1).collect(),
        1 => text.match_indices(['{', '[']).map(|(at, _)| at).collect(),
        _ => text.match_indices('<').map(|(at, _)| at).collect(),
    };
    if starts.is_empty() {
        return None;
    }
    let at = draw.below(starts.len());
    let start = starts[at];
    let rest = &text[start..];
    let end = match rest.as_bytes()[0] {
        b'<' => {
            let name: String = rest[1..].chars().take_while(|own| own.is_alphanumeric() || *own == '_').collect();
            let closing = format!("</{name}>");
            match (rest.find("/>"), rest.find(&closing)) {
                (Some(short), Some(long)) if short < long && !rest[..short].contains('>') => start + short + 2,
                (_, Some(long)) => start + long + closing.len(),
                (Some(short), None) => start + short + 2,
                (None, None) => return None,
            }
        }
        b'[' if start == 0 || text.as_bytes()[start - 1] == b'\n' => {
            rest[1..].find("\n[").map_or(text.len(), |end| start + end + 2)
        }
        _ => {
            let mut depth = 0_i32;
            let end = rest.bytes().position(|byte| {
                depth += i32::from(matches!(byte, b'{' | b'[')) - i32::from(matches!(byte, b'}' | b']'));
                depth == 0
            });
            start + end? + 1
        }
    };
    (text.is_char_boundary(start) && text.is_char_boundary(end)).then_some(start..end)
}

/// Something within itself, very often.
fn nest(text: &mut String, draw: &mut Draw) {
    let depth = draw.size(20_000);
    let pairs = [
        ("[", "]"),
        ("{a=", "}"),
        ("{\"a\":", "}"),
        ("(", ")"),
        ("-", ""),
        ("sin(", ")"),
        ("1+", ""),
        ("1*", ""),
        ("a.", ""),
        ("if 1 < 2 { ", " } else { 1 }"),
        ("if 1 < 2 { 1 } else ", ""),
        ("<a>", "</a>"),
        ("<link>", "</link>"),
        ("[[", "]]"),
        ("!", ""),
        ("&", ""),
        ("|x|", ""),
        (
            "<body name=\"b\"><inertial mass=\"1\" pos=\"0 0 0\" diaginertia=\"1 1 1\"/><joint axis=\"0 0 1\"/>",
            "</body>",
        ),
        ("<default>", "</default>"),
        ("1-(", ")"),
        ("/*", "*/"),
        ("<x:y a:b=\"\">", "</x:y>"),
    ];
    let (opening, closing) = *draw.of_these(&pairs);
    let own = tokens(text);
    let Some((kind, range)) = own.get(draw.below(own.len())).cloned() else { return };
    let inner = text[range.clone()].to_owned();
    let (before, after) = (opening.repeat(depth), closing.repeat(depth));
    // Within quotes, formulas nest.
    let new = match kind {
        Kind::Quoted if inner.len() >= 2 && inner.ends_with('"') => {
            format!("\"{before}{}{after}\"", &inner[1..inner.len() - 1])
        }
        _ => format!("{before}{inner}{after}"),
    };
    text.replace_range(range, &new);
}

/// The same text as another program might have saved it.
pub fn in_another_encoding(bytes: &[u8], draw: &mut Draw) -> Vec<u8> {
    let text = String::from_utf8_lossy(bytes);
    match draw.below(6) {
        0 => [&[0xef, 0xbb, 0xbf], bytes].concat(),
        1 => [0xfeff].into_iter().chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect(),
        2 => [0xfeff].into_iter().chain(text.encode_utf16()).flat_map(u16::to_be_bytes).collect(),
        3 => text.replace('\n', "\r\n").into_bytes(),
        4 => text.replace('\n', "\r").into_bytes(),
        // Latin-1.
        _ => text.chars().map(|own| if (own as u32) < 256 { own as u8 } else { b'?' }).collect(),
    }
}

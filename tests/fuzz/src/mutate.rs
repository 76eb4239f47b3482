//! From files that are right to files that are not: a few changes each, of bytes or of what the format is made of.

pub mod binary;
pub mod csv;
pub mod text;

use crate::draw::Draw;

/// Bytes of an input, so that many can be tried; a change that makes more is cut.
pub const LARGEST: usize = 1 << 18;

/// Numbers that programs stumble over.
pub const NUMBERS: [&str; 42] = [
    "0",
    "-0",
    "-0.0",
    "1",
    "-1",
    "2",
    "3",
    "7",
    "8",
    "16",
    "255",
    "256",
    "65535",
    "65536",
    "1000000",
    "2147483647",
    "2147483648",
    "-2147483648",
    "4294967295",
    "9007199254740993",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551616",
    "1e308",
    "-1e308",
    "1.7976931348623157e308",
    "1e309",
    "-1e400",
    "5e-324",
    "-5e-324",
    "1e-308",
    "2.2250738585072014e-308",
    "1e-200",
    "1e200",
    "inf",
    "-inf",
    "nan",
    "-nan",
    "0.1",
    "1e-9",
    "1e9",
    "3.141592653589793",
];

/// Texts that programs stumble over.
pub const WORDS: [&str; 26] = [
    "",
    " ",
    "\t",
    "\u{0}",
    "\u{feff}",
    "é",
    "Δ",
    "関節",
    "🤖",
    "e\u{301}",
    "\u{202e}abc",
    "a\nb",
    "'",
    "\"",
    "\\",
    "..",
    "/",
    "../../..",
    "pi",
    "sin(x)",
    "self",
    "fn",
    "q0",
    "NaN",
    "x\u{0}y",
    "1/0",
];

/// Some random changes of a text.
pub fn of_text(seed: &str, others: &[Vec<u8>], draw: &mut Draw) -> Vec<u8> {
    let mut text = seed.to_owned();
    for _ in 0..draw.size(8) {
        let other = String::from_utf8_lossy(draw.of_these(others).as_slice()).into_owned();
        text::change(&mut text, &other, draw);
        if text.len() > LARGEST {
            let end = (0..=LARGEST).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
            text.truncate(end);
        }
    }
    let mut bytes = text.into_bytes();
    if draw.one_in(16) {
        binary::change(&mut bytes, draw.of_these(others).as_slice(), draw);
    }
    if draw.one_in(32) {
        bytes = text::in_another_encoding(&bytes, draw);
    }
    bytes
}

/// Some random changes of bytes.
pub fn of_bytes(seed: &[u8], others: &[Vec<u8>], draw: &mut Draw) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..draw.size(12) {
        binary::change(&mut bytes, draw.of_these(others).as_slice(), draw);
        bytes.truncate(LARGEST);
    }
    bytes
}

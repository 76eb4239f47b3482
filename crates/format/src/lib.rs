//! Text for people: numbers in four digits ([`number`]), characters that HTML and SVG need escaped ([`escaped`]), the error
//! of an unknown name with the nearest known one ([`UnknownName`]), and command lines as a shell takes them ([`shell_line`]).

/// Text as it may stand in SVG and HTML.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A command line of `dynid` with these arguments.
pub fn shell_line<S: AsRef<str>>(arguments: &[S]) -> String {
    let words = arguments.iter().map(|word| shell_word(word.as_ref()));
    ["dynid".to_owned()].into_iter().chain(words).collect::<Vec<_>>().join(" ")
}

/// A word as a shell takes it.
fn shell_word(word: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_./,=:@%+".contains(&byte);
    if !word.is_empty() && word.bytes().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// A number as people read it: four digits, an exponent only where it helps, a true minus sign.
pub fn number(value: f64) -> String {
    if !value.is_finite() {
        return if value > 0.0 {
            "\u{221e}".to_owned()
        } else if value < 0.0 {
            "\u{2212}\u{221e}".to_owned()
        } else {
            "\u{2014}".to_owned()
        };
    }
    let size = value.abs();
    let text = if size == 0.0 {
        "0".to_owned()
    } else if (1e-3..1e4).contains(&size) {
        let decimals = (3.0 - size.log10().floor()).clamp(0.0, 6.0) as usize;
        format!("{value:.decimals$}")
    } else {
        format!("{value:.3e}")
    };
    text.replace('-', "\u{2212}")
}

/// The first six names, and how many more there are.
pub fn listed(names: &[String]) -> String {
    const NAMED: usize = 6;
    let shown = names[..names.len().min(NAMED)].join(", ");
    match names.len().saturating_sub(NAMED) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

/// A name that nothing has: a device, an effect, a parameter.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown {kind} `{name}`; {help}")]
pub struct UnknownName {
    /// What was looked for.
    pub kind: &'static str,
    /// As the user wrote it.
    pub name: String,
    /// The nearest known name.
    pub help: String,
}

impl UnknownName {
    /// `name` is no `kind`; the help says which of `known` is nearest.
    pub fn among<'a>(kind: &'static str, name: &str, known: impl IntoIterator<Item = &'a str>) -> Self {
        Self { kind, name: name.to_owned(), help: dynid_model::did_you_mean(name, known) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_reported_in_four_digits() {
        let reported: Vec<String> =
            [0.0, 1.0, -0.376, 12.34567, 4321.0, 1.5e-5, -2.02e7, f64::INFINITY, f64::NAN].map(number).into();
        assert_eq!(
            reported,
            [
                "0",
                "1.000",
                "\u{2212}0.3760",
                "12.35",
                "4321",
                "1.500e\u{2212}5",
                "\u{2212}2.020e7",
                "\u{221e}",
                "\u{2014}"
            ]
        );
    }

    #[test]
    fn a_shell_reads_the_words_that_were_given() {
        let words = ["check", "my log's.csv", "--column", "tau0=load [N*m]", ""];
        assert_eq!(shell_line(&words), "dynid check 'my log'\\''s.csv' --column 'tau0=load [N*m]' ''");
    }
}

//! One error type for every text file that a person writes: it points at the place.

use std::{
    fmt,
    ops::Range,
    path::{Path, PathBuf},
};

/// A text file and where it lies, so that errors can show the line.
#[derive(Debug, Clone)]
pub struct Source {
    /// As the user gave it.
    pub path: PathBuf,
    /// The whole text.
    pub text: String,
}

impl Source {
    /// A text that was read from `path`.
    pub fn new(path: &Path, text: &str) -> Self {
        Self { path: path.to_owned(), text: text.to_owned() }
    }

    /// An error at a byte range of this text.
    pub fn error(&self, span: Range<usize>, message: impl Into<String>) -> ModelError {
        let start = floor_char_boundary(&self.text, span.start);
        let line_start = self.text[..start].rfind('\n').map_or(0, |newline| newline + 1);
        let line_end = self.text[start..].find('\n').map_or(self.text.len(), |newline| start + newline);
        let end = floor_char_boundary(&self.text, span.end.clamp(start, line_end));
        let column = self.text[line_start..start].chars().count();
        // Of a long line, what stands around the place.
        let left_out = if column > LONGEST_EXCERPT / 2 { column - LONGEST_EXCERPT / 4 } else { 0 };
        let line = self.text[line_start..line_end].trim_end();
        let excerpt: String = line.chars().skip(left_out).take(LONGEST_EXCERPT).collect();
        let width = self.text[start..end].trim_end().chars().take(LONGEST_EXCERPT - (column - left_out)).count();
        ModelError(Box::new(Inner {
            path: self.path.clone(),
            line: 1 + self.text[..start].matches('\n').count(),
            column: 1 + column,
            excerpt: excerpt.replace('\t', " "),
            caret: column - left_out,
            width: width.max(1),
            message: shortened(message.into(), LONGEST_MESSAGE),
            help: None,
        }))
    }
}

/// Characters of a line that an error shows; a file may be a single line.
const LONGEST_EXCERPT: usize = 400;

/// Bytes of a message or a remedy, which quote what stands in a file.
pub const LONGEST_MESSAGE: usize = 2000;

/// No more bytes than these of a text, and a sign that there are more.
#[must_use]
pub fn shortened(mut text: String, longest: usize) -> String {
    if text.len() > longest {
        text.truncate(floor_char_boundary(&text, longest));
        text.push_str(" ..");
    }
    text
}

/// What is wrong in a device, effect or model file: where, what was expected and found, and what to do.
///
/// `Display` prints the whole report: message, `path:line:column`, the line with a caret, the remedy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModelError(Box<Inner>);

#[derive(Debug, Clone, PartialEq, Eq)]
struct Inner {
    path: PathBuf,
    line: usize,
    column: usize,
    /// Of the line, as much as is shown.
    excerpt: String,
    /// Where in the excerpt the place begins, in characters.
    caret: usize,
    width: usize,
    message: String,
    help: Option<String>,
}

impl ModelError {
    /// Adds the remedy.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.0.help = Some(shortened(help.into(), LONGEST_MESSAGE));
        self
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// Line, from 1.
    pub fn line(&self) -> usize {
        self.0.line
    }

    /// Column in characters, from 1.
    pub fn column(&self) -> usize {
        self.0.column
    }

    /// What was expected and what was found.
    pub fn message(&self) -> &str {
        &self.0.message
    }

    /// The remedy.
    pub fn remedy(&self) -> Option<&str> {
        self.0.help.as_deref()
    }
}

impl fmt::Display for ModelError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Inner { path, line, column, excerpt, caret, width, message, help } = &*self.0;
        let number = line.to_string();
        let margin = " ".repeat(number.len());
        writeln!(f, "{message}")?;
        writeln!(f, "{margin}--> {}:{line}:{column}", path.display())?;
        writeln!(f, "{margin} |")?;
        writeln!(f, "{number} | {excerpt}")?;
        write!(f, "{margin} | {}{}", " ".repeat(*caret), "^".repeat(*width))?;
        match help {
            Some(help) => write!(f, "\n{margin} = help: {help}"),
            None => Ok(()),
        }
    }
}

impl std::error::Error for ModelError {}

/// The remedy for an unknown name: the nearest known one, and all of them when they are few.
pub fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    let known: Vec<&str> = known.into_iter().collect();
    let all = match known.len() {
        0 => "there is none to choose from".to_owned(),
        1..=16 => format!("known: {}", known.join(", ")),
        n => format!("{n} are known, among them {}", known[..12].join(", ")),
    };
    match nearest(name, known.iter().copied()) {
        Some(near) => format!("did you mean `{near}`? {all}"),
        None => all,
    }
}

/// The known name with the fewest typing slips between it and `name`, if they are few; a part of a name counts as one.
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let allowed = 1 + name.chars().count() / 3;
    known
        .into_iter()
        .map(|candidate| {
            let (name, known) = (name.to_lowercase(), candidate.to_lowercase());
            let part = name.len() > 2 && known.contains(&name);
            (if part { 1.min(slips(&name, &known)) } else { slips(&name, &known) }, candidate)
        })
        .filter(|(distance, _)| *distance <= allowed)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// Optimal string alignment distance: insertions, deletions, replacements, neighbours swapped.
fn slips(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    // Row i, column j: from the first i letters of `a` to the first j of `b`; the border is right from the start.
    let mut rows: Vec<Vec<usize>> = (0..=a.len()).map(|i| (i..=i + b.len()).collect()).collect();
    for i in 1..=a.len() {
        for j in 1..=b.len() {
            let replace = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let mut least = replace.min(rows[i - 1][j] + 1).min(rows[i][j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                least = least.min(rows[i - 2][j - 2] + 1);
            }
            rows[i][j] = least;
        }
    }
    rows[a.len()][b.len()]
}

fn floor_char_boundary(text: &str, index: usize) -> usize {
    let mut index = index.min(text.len());
    while !text.is_char_boundary(index) {
        index -= 1;
    }
    index
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_points_at_the_place() {
        let source = Source::new(Path::new("arm.toml"), "a = 1\nlength = \"L9\"\n");
        let error = source.error(16..18, "unknown length `L9`").help("did you mean `L2`?");
        insta::assert_snapshot!(error, @r#"
        unknown length `L9`
         --> arm.toml:2:11
          |
        2 | length = "L9"
          |           ^^
          = help: did you mean `L2`?
        "#);
    }

    #[test]
    fn a_long_text_is_cut_between_two_characters() {
        assert_eq!(shortened("short".to_owned(), 5), "short");
        assert_eq!(shortened("\u{e9}".repeat(3), 5), "\u{e9}\u{e9} ..");
    }

    #[test]
    fn nearest_name_survives_slips() {
        let known = ["viscous", "coulomb", "lugre"];
        assert_eq!(nearest("columb", known), Some("coulomb"));
        assert_eq!(nearest("LuGer", known), Some("lugre"));
        assert_eq!(nearest("backlash", known), None);
    }

    #[test]
    fn span_past_the_end_still_points_into_the_text() {
        let source = Source::new(Path::new("a.toml"), "é");
        assert_eq!(source.error(99..120, "x").column(), 2);
        assert_eq!(source.error(1..2, "x").column(), 1);
    }
}

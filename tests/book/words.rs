//! A command line to words, as a shell takes the plain ones: quotes keep blanks together.

/// The words of a line; an error for what only a shell understands.
pub fn split(line: &str) -> Result<Vec<String>, String> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quote = None;
    for c in line.chars() {
        match (quote, c) {
            (Some(open), _) if c == open => quote = None,
            (Some(_), _) => word.get_or_insert_default().push(c),
            (None, '\'' | '"') => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (None, ' ') => words.extend(word.take()),
            (None, '|' | '>' | '<' | '&' | ';' | '*' | '$' | '`' | '\\') => {
                return Err(format!("`{c}` needs a shell, which the book's commands do not have: {line}"));
            }
            (None, _) => word.get_or_insert_default().push(c),
        }
    }
    if quote.is_some() {
        return Err(format!("a quote is not closed: {line}"));
    }
    words.extend(word);
    Ok(words)
}

#[test]
fn quotes_keep_blanks_together() {
    assert_eq!(split("a 'b c'  d\"e f\" ''").unwrap(), ["a", "b c", "de f", ""]);
    assert!(split("a | b").is_err() && split("'a").is_err());
    assert_eq!(split("'{out}.toml' '*.csv'").unwrap(), ["{out}.toml", "*.csv"]);
}

//! What a block shows against what there is: a line of `...` stands for any lines, `[..]` within a line for any text.

/// Whether `shown` is all of `said`.
pub fn is_all(shown: &[&str], said: &[&str]) -> bool {
    match shown.split_first() {
        None => said.is_empty(),
        Some((&"...", rest)) => (0..=said.len()).any(|from| is_all(rest, &said[from..])),
        Some((line, rest)) => said.split_first().is_some_and(|(own, after)| is_line(line, own) && is_all(rest, after)),
    }
}

/// Whether `shown` is a part of `said`, of whole lines.
pub fn is_part(shown: &[&str], said: &[&str]) -> bool {
    is_all(&[&["..."], shown, &["..."]].concat(), said)
}

fn is_line(shown: &str, said: &str) -> bool {
    let (shown, said) = (shown.trim_end(), said.trim_end());
    let Some((before, after)) = shown.split_once("[..]") else { return shown == said };
    let Some(rest) = said.strip_prefix(before) else { return false };
    let starts = rest.char_indices().map(|(at, _)| at).chain([rest.len()]);
    starts.into_iter().any(|at| is_line(after, &rest[at..]))
}

#[test]
fn dots_stand_for_any_lines_and_nothing_else_does() {
    assert!(is_all(&["a", "...", "c"], &["a", "b", "b", "c"]));
    assert!(is_all(&["a", "...", "c"], &["a", "c"]));
    assert!(!is_all(&["a", "...", "c"], &["a", "b", "c", "d"]));
    assert!(!is_all(&["a"], &["a", "b"]) && !is_all(&["a", "b"], &["a"]));
    assert!(is_part(&["b", "c"], &["a", "b", "c", "d"]) && !is_part(&["a", "c"], &["a", "b", "c"]));
    assert!(is_all(&["took [..] s, ±[..]."], &["took 6 s, ±1."]) && !is_all(&["took [..] s"], &["took 6 min"]));
}

//! Mutants behind switches: `a + b` becomes `(if is_active(7) { a - b } else { a + b })`.
//!
//! What an operator has on its two sides stays: of `a - b * c` the mutant is `a - (b + c)`, where `cargo mutants` writes
//! `a - b + c`.

use std::ops::Range;

use proc_macro2::{LineColumn, Span};
use syn::spanned::Spanned;
use syn::visit::{self, Visit};

use super::Mutant;

/// Added to a crate: which of its switches is on, and, where somebody listens, which of them are come by.
pub const MODULE: &str = r#"
#[allow(warnings, clippy::all)]
pub(crate) mod mutant_switch {
    use std::io::Write as _;
    use std::sync::LazyLock;
    use std::sync::atomic::{AtomicBool, Ordering};

    struct Mode {
        active: Option<usize>,
        listener: Option<String>,
        seen: Vec<AtomicBool>,
    }

    static MODE: LazyLock<Mode> = LazyLock::new(|| {
        let listener = std::env::var("MUTANTS_LISTENER").ok();
        Mode {
            active: std::env::var("MUTANT").ok().and_then(|number| number.parse().ok()),
            seen: if listener.is_some() { (0..100_000).map(|_| AtomicBool::new(false)).collect() } else { Vec::new() },
            listener,
        }
    });

    pub(crate) fn is_active(number: usize) -> bool {
        let mode = &*MODE;
        if let Some(file) = &mode.listener {
            if !mode.seen[number].swap(true, Ordering::Relaxed) {
                let opened = std::fs::OpenOptions::new().create(true).append(true).open(file);
                let _ = opened.and_then(|mut file| file.write_all(format!("{number}\n").as_bytes()));
            }
        }
        mode.active == Some(number)
    }
}
"#;

/// A replacement of a part of a file's text.
#[derive(Debug)]
pub struct Edit {
    /// The mutant's number.
    pub number: usize,
    pub range: Range<usize>,
    pub text: String,
}

impl Edit {
    /// Whether one changes what the other does; two insertions at one place do not.
    pub fn overlaps(&self, other: &Self) -> bool {
        self.range.start < other.range.end && other.range.start < self.range.end
    }
}

/// The edit that plants a mutant; none where it is of a kind that cannot be switched.
pub fn edit(source: &str, file: &syn::File, mutant: &Mutant) -> Option<Edit> {
    let number = mutant.number;
    let active = format!("crate::mutant_switch::is_active({number})");
    let replacement = &mutant.replacement;
    let mut finder = Finder { start: mutant.start, genre: &mutant.genre, found: None };
    finder.visit_file(file);
    if mutant.genre == "FnValue" && finder.found.is_none() {
        let place = offset(source, mutant.start)?;
        let text = format!("if {active} {{ return {replacement}; }} ");
        return Some(Edit { number, range: place..place, text });
    }
    let at = |range: &Range<usize>| source.get(range.clone());
    let (range, text) = match finder.found? {
        Found::Binary { whole, operator } => {
            let (left, right) = (at(&(whole.start..operator.start))?, at(&(operator.end..whole.end))?);
            let text = format!("(if {active} {{ {left}{replacement}{right} }} else {{ {} }})", at(&whole)?);
            (whole, text)
        }
        Found::Unary { whole, operand } => {
            let text = format!("(if {active} {{ {} }} else {{ {} }})", at(&operand)?, at(&whole)?);
            (whole, text)
        }
        Found::Guard(guard) => {
            let text = format!("(if {active} {{ {replacement} }} else {{ {} }})", at(&guard)?);
            (guard, text)
        }
        Found::Opaque => return None,
        Found::Arm(pattern) => {
            let text = format!("{} if !{active}", at(&pattern)?);
            (pattern, text)
        }
    };
    Some(Edit { number, range, text })
}

/// The text with its edits, which do not overlap and come in the order of their places; and where each of them is then.
pub fn planted(source: &str, edits: &[Edit]) -> (String, Vec<(usize, Range<usize>)>) {
    let (mut text, mut places, mut done) = (String::new(), Vec::new(), 0);
    for edit in edits {
        text.push_str(&source[done..edit.range.start]);
        let start = text.len();
        text.push_str(&edit.text);
        places.push((edit.number, start..text.len()));
        done = edit.range.end;
    }
    text.push_str(&source[done..]);
    (text, places)
}

/// The byte at a line and a column, both from 1.
fn offset(source: &str, (line, column): (usize, usize)) -> Option<usize> {
    let start: usize = source.split_inclusive('\n').take(line.checked_sub(1)?).map(str::len).sum();
    let (place, _) = source.get(start..)?.char_indices().nth(column.checked_sub(1)?)?;
    Some(start + place)
}

enum Found {
    Binary {
        whole: Range<usize>,
        operator: Range<usize>,
    },
    Unary {
        whole: Range<usize>,
        operand: Range<usize>,
    },
    Guard(Range<usize>),
    /// The pattern of an arm without a guard: others are not deleted.
    Arm(Range<usize>),
    /// The body of a function that returns an `impl Trait`: that is one type, and a mutant's value has another.
    Opaque,
}

/// Looks for what begins at a place.
struct Finder<'a> {
    start: (usize, usize),
    genre: &'a str,
    found: Option<Found>,
}

impl Finder<'_> {
    fn is_at(&self, span: Span) -> bool {
        let LineColumn { line, column } = span.start();
        (line, column + 1) == self.start
    }

    fn look_at_function(&mut self, signature: &syn::Signature, body: &syn::Block) {
        if self.genre == "FnValue" && body.stmts.first().is_some_and(|first| self.is_at(first.span())) {
            let mut returned = IsOpaque(false);
            returned.visit_return_type(&signature.output);
            self.found = returned.0.then_some(Found::Opaque);
        }
    }
}

/// Whether an `impl Trait` is in a type.
struct IsOpaque(bool);

impl Visit<'_> for IsOpaque {
    fn visit_type_impl_trait(&mut self, _: &syn::TypeImplTrait) {
        self.0 = true;
    }
}

impl<'ast> Visit<'ast> for Finder<'_> {
    fn visit_item_fn(&mut self, function: &'ast syn::ItemFn) {
        self.look_at_function(&function.sig, &function.block);
        visit::visit_item_fn(self, function);
    }

    fn visit_impl_item_fn(&mut self, function: &'ast syn::ImplItemFn) {
        self.look_at_function(&function.sig, &function.block);
        visit::visit_impl_item_fn(self, function);
    }

    fn visit_expr_binary(&mut self, expression: &'ast syn::ExprBinary) {
        if self.genre == "BinaryOperator" && self.is_at(expression.op.span()) {
            let whole = expression.left.span().byte_range().start..expression.right.span().byte_range().end;
            self.found = Some(Found::Binary { whole, operator: expression.op.span().byte_range() });
        }
        visit::visit_expr_binary(self, expression);
    }

    fn visit_expr_unary(&mut self, expression: &'ast syn::ExprUnary) {
        if self.genre == "UnaryOperator" && self.is_at(expression.op.span()) {
            let operand = expression.expr.span().byte_range();
            self.found = Some(Found::Unary { whole: expression.op.span().byte_range().start..operand.end, operand });
        }
        visit::visit_expr_unary(self, expression);
    }

    fn visit_arm(&mut self, arm: &'ast syn::Arm) {
        match &arm.pat {
            syn::Pat::Guard(guarded) if self.genre == "MatchArmGuard" && self.is_at(guarded.guard.span()) => {
                self.found = Some(Found::Guard(guarded.guard.span().byte_range()));
            }
            pattern if self.genre == "MatchArm" && self.is_at(pattern.span()) => {
                self.found = Some(Found::Arm(pattern.span().byte_range()));
            }
            _ => {}
        }
        visit::visit_arm(self, arm);
    }
}

#[cfg(test)]
mod tests {
    use super::{Edit, Mutant, edit, planted};

    /// A mutant of what begins at a line and a column.
    fn mutant(genre: &str, start: (usize, usize), replacement: &str) -> Mutant {
        Mutant {
            number: 7,
            diff: String::new(),
            package: String::new(),
            file: "lib.rs".into(),
            genre: genre.to_owned(),
            name: String::new(),
            replacement: replacement.to_owned(),
            start,
        }
    }

    /// The text with one mutant.
    fn text(source: &str, genre: &str, start: (usize, usize), replacement: &str) -> String {
        let mutant = mutant(genre, start, replacement);
        let edit = edit(source, &syn::parse_file(source).unwrap(), &mutant).unwrap();
        let (text, places) = planted(source, &[edit]);
        syn::parse_file(&text).unwrap_or_else(|error| panic!("{text}: {error}"));
        assert_eq!(places[0].0, 7);
        text.replace("crate::mutant_switch::is_active(7)", "ON")
    }

    #[test]
    fn each_kind_of_mutant_is_behind_a_switch() {
        let sum = "fn f(a: f64) -> f64 {\n    2.0 * a + 1.0\n}\n";
        assert_eq!(
            text(sum, "BinaryOperator", (2, 13), "-"),
            "fn f(a: f64) -> f64 {\n    (if ON { 2.0 * a - 1.0 } else { 2.0 * a + 1.0 })\n}\n"
        );
        assert_eq!(
            text(sum, "BinaryOperator", (2, 9), "/"),
            "fn f(a: f64) -> f64 {\n    (if ON { 2.0 / a } else { 2.0 * a }) + 1.0\n}\n"
        );
        assert_eq!(
            text(sum, "FnValue", (2, 5), "0.0"),
            "fn f(a: f64) -> f64 {\n    if ON { return 0.0; } 2.0 * a + 1.0\n}\n"
        );
        let not = "fn f(ä: bool) -> bool { let é = ä; !é }";
        assert_eq!(
            text(not, "UnaryOperator", (1, 36), ""),
            "fn f(ä: bool) -> bool { let é = ä; (if ON { é } else { !é }) }"
        );
        let arms = "fn f(a: u8) -> u8 { match a { 1 => 2, 3 if a > 2 => 4, _ => a } }";
        assert_eq!(
            text(arms, "MatchArm", (1, 31), ""),
            "fn f(a: u8) -> u8 { match a { 1 if !ON => 2, 3 if a > 2 => 4, _ => a } }"
        );
        assert_eq!(
            text(arms, "MatchArmGuard", (1, 44), "true"),
            "fn f(a: u8) -> u8 { match a { 1 => 2, 3 if (if ON { true } else { a > 2 }) => 4, _ => a } }"
        );
    }

    /// Its value is of one type that has no name, and what a mutant returns is of another.
    #[test]
    fn what_returns_an_opaque_type_has_no_switch() {
        let source = "struct A;\nimpl A {\n    fn f(&self) -> Option<impl Iterator<Item = u8>> {\n        None::<Empty<u8>>\n    }\n    fn \
                      g(&self, of: impl Fn() -> u8) -> u8 {\n        of()\n    }\n}\n";
        let file = syn::parse_file(source).unwrap();
        assert!(edit(source, &file, &mutant("FnValue", (4, 9), "Some(once(1))")).is_none());
        assert!(edit(source, &file, &mutant("FnValue", (7, 9), "1")).is_some());
    }

    /// Several in one file: an insertion where an expression begins is apart from that expression, its parts are not.
    #[test]
    fn edits_that_do_not_overlap_are_planted_together() {
        let source = "fn f(a: f64) -> f64 {\n    2.0 * a + 1.0\n}\n";
        let edit =
            |number: usize, range: std::ops::Range<usize>, text: &str| Edit { number, range, text: text.to_owned() };
        let (whole, product) = (source.find("2.0").unwrap(), source.find(" + ").unwrap());
        let insertion = edit(3, whole..whole, "return 0.0; ");
        let sum = edit(1, whole..source.find("\n}").unwrap(), "(sum)");
        let part = edit(2, whole..product, "(product)");
        assert!(!insertion.overlaps(&sum) && !sum.overlaps(&insertion));
        assert!(sum.overlaps(&part) && part.overlaps(&sum));
        assert!(edit(4, whole + 1..whole + 1, "").overlaps(&sum), "within");
        let (text, places) = planted(source, &[insertion, sum]);
        assert_eq!(text, "fn f(a: f64) -> f64 {\n    return 0.0; (sum)\n}\n");
        let found: Vec<(usize, &str)> = places.iter().map(|(number, range)| (*number, &text[range.clone()])).collect();
        assert_eq!(found, [(3, "return 0.0; "), (1, "(sum)")]);
    }
}

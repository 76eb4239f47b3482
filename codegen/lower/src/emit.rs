//! From programs to formatted Rust.
//!
//! The emitted code is straight-line and generic over `Scalar`. It allocates nothing, and every index is a constant
//! within a fixed-size array, so that no check is left that could fail.

mod effects;
mod end_point;
mod function;
mod kernels;
mod term;

pub use effects::effects_module;
pub use end_point::end_point_module;
pub use kernels::configuration_module;

use proc_macro2::{Ident, Literal, TokenStream};
use quote::{format_ident, quote};

use crate::OperationCounts;
use crate::kernel::Function;

/// rustc's time and memory grow faster than linearly in a function's length, so no function is longer.
pub const MOST_STATEMENTS: usize = 1_000;

/// What is emitted for registers of any width. It becomes part of the function that is compiled for a processor's own, for what
/// it would call is not.
const OF_EIGHT: [&str; 2] = ["forward_dynamics", "eval"];

/// Source text that is not valid Rust: a bug of ours, said with the place.
#[derive(Debug, thiserror::Error)]
#[error("the emitted code of {what} does not parse: {error}")]
pub struct EmitError {
    what: String,
    error: syn::Error,
}

/// Tokens to formatted text.
fn format(what: &str, tokens: TokenStream) -> Result<String, EmitError> {
    match syn::parse2(tokens) {
        Ok(file) => Ok(prettyplease::unparse(&file)),
        Err(error) => Err(EmitError { what: what.to_owned(), error }),
    }
}

/// `12 adds, 9 muls, 1 sincos`, without what there is none of.
pub fn describe(counts: &OperationCounts) -> String {
    let parts = [
        (counts.adds, "adds"),
        (counts.muls, "muls"),
        (counts.divs, "divs"),
        (counts.sincos, "sincos"),
        (counts.calls, "calls"),
    ];
    let told: Vec<String> =
        parts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")).collect();
    if told.is_empty() { "no operation".to_owned() } else { told.join(", ") }
}

/// An identifier as a token; names come from `.kir` and effect files, which admit identifiers only.
fn identifier(name: &str) -> Ident {
    format_ident!("{name}")
}

/// The names of a function's arguments and results, in order.
fn slices(function: &Function) -> Vec<Ident> {
    let arguments = function.arguments.iter().map(|argument| identifier(argument.name));
    arguments.chain(function.results.iter().map(|results| identifier(results.name))).collect()
}

/// The entry of a function of eight in a table: its name and what it is.
fn of_eight(function: &Function) -> TokenStream {
    let name = identifier(function.name);
    let entry = format_ident!("{}_of_eight", function.name);
    let arguments = function.arguments.iter().map(|argument| (argument.name, argument.elements.len()));
    let results = function.results.iter().map(|results| (results.name, results.elements.len()));
    let sized = |(name, length): (&str, usize)| {
        let (name, length) = (identifier(name), size(length));
        quote!(#name: #length)
    };
    let (arguments, results) = (arguments.map(sized), results.map(sized));
    quote!(#entry: of_eight!(#name, [#(#arguments),*], [#(#results),*]))
}

/// A length or an index, without a suffix.
fn size(value: usize) -> Literal {
    Literal::usize_unsuffixed(value)
}

/// `&[..]` of literals.
fn list<T: quote::ToTokens>(items: impl IntoIterator<Item = T>) -> TokenStream {
    let items = items.into_iter();
    quote!(&[#(#items),*])
}

//! From programs to C99 that needs `<math.h>` and nothing else.
//!
//! [`prototype`] and [`definition`] write a [`Function`]: straight-line code over doubles, the operations and their order those of the
//! emitted Rust. [`runtime()`] writes what such functions call: sines, cosines and exponentials by the polynomials of
//! `dynid-generated`, so that both languages give the same bits where the compiler contracts no operations.
//!
//! Every identifier of file scope begins with a prefix of the caller's, so that several files can be linked, or included, together.

mod body;
mod runtime;

pub use runtime::runtime;

use crate::kernel::Function;
use body::Body;

/// Who may call a function.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Linkage {
    /// Everybody.
    External,
    /// Those of the same file.
    Internal,
}

/// `void <name>(const double q[2], double tau[2])`, without a semicolon.
pub fn prototype(name: &str, function: &Function) -> String {
    let arguments = function.arguments.iter().map(|own| parameter("const double ", own.name, own.elements.len()));
    let results = function.results.iter().map(|own| parameter("double ", own.name, own.elements.len()));
    format!("void {name}({})", arguments.chain(results).collect::<Vec<_>>().join(", "))
}

/// The whole function. All results are written after the last argument was read, so that arrays may be the same.
pub fn definition(name: &str, prefix: &str, function: &Function, linkage: Linkage) -> String {
    let linkage = if linkage == Linkage::Internal { "static " } else { "" };
    format!("{linkage}{}\n{{\n{}}}\n", prototype(name, function), Body::new(function, prefix).text())
}

/// A number as C reads it back to the last bit.
pub fn number(value: f64) -> String {
    match value {
        _ if value.is_nan() => "NAN".to_owned(),
        f64::INFINITY => "INFINITY".to_owned(),
        f64::NEG_INFINITY => "-INFINITY".to_owned(),
        _ => format!("{value:?}"),
    }
}

/// A parameter that is an array; C has none of length 0.
fn parameter(kind: &str, name: &str, length: usize) -> String {
    if length == 0 { format!("{kind}*{name}") } else { format!("{kind}{name}[{length}]") }
}

//! The module of a device's end point: its functions and its entry in the table.

use quote::quote;

use super::{EmitError, describe, format, function::function, identifier, list, size, slices};
use crate::end_point::EndPoint;

/// The text of an end point's module. It expects to be a module of `dynid_generated`.
pub fn end_point_module(end_point: &EndPoint) -> Result<String, EmitError> {
    let EndPoint { device, frame, n_joints, parameters, functions } = end_point;
    let head = format!(" @generated from `model/devices/{device}.toml` at every `cargo build`.");
    let about = format!(
        " The point of frame `{frame}`, from {n_joints} joints and the lengths {}. Vectors stand in base axes, rotation \
         and Jacobian are row-major.",
        parameters.join(" ")
    );
    let documented = functions.iter().map(|own| {
        let cost = describe(&own.program.operations());
        function(own, &[format!(" {}", own.title), String::new(), format!(" {cost}.")])
    });
    let operations = list(functions.iter().map(|own| {
        let (name, counts) = (own.name, own.program.operations());
        let counts = [counts.adds, counts.muls, counts.divs, counts.sincos].map(size);
        quote!(Operations::new(#name, "", [#(#counts),*], 0))
    }));
    let entries = functions.iter().map(|own| {
        let (name, slices) = (identifier(own.name), slices(own));
        quote!(#name: checked!(#name::<f64>(#(#slices),*)))
    });
    let (parameters, n_joints) = (list(parameters), size(*n_joints));
    let tokens = quote! {
        #![doc = #head]
        #![doc = ""]
        #![doc = #about]
        use crate::{EndPoint, EndPointTable, Operations, Scalar, checked};
        /// The table entry.
        pub static END_POINT: EndPoint = EndPoint {
            device: #device,
            frame: #frame,
            n_joints: #n_joints,
            parameters: #parameters,
            operations: #operations,
            functions: &EndPointTable { #(#entries),* },
        };
        #(#documented)*
    };
    format(&format!("the end point of {device}"), tokens)
}

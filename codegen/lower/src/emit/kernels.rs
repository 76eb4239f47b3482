//! The module of one configuration: its functions and its entry in the table of kernels.

use proc_macro2::TokenStream;
use quote::{format_ident, quote};

use super::{EmitError, OF_EIGHT, describe, format, function::function, identifier, list, of_eight, size, slices};
use crate::kernel::{Configuration, Function};

/// How many partial derivatives `prepare_gradient` carries along at once. More would run faster, once per parameter
/// set, but four take rustc 21 s for a `prepare` of 1,300 operations where one takes 5 s.
const PARTIALS: usize = 1;

/// What a fit evaluates at several states at once: the table has these in lanes, too.
const IN_LANES: [&str; 3] = ["inertia", "regressor", "inverse_dynamics_gradient"];

/// The text of a configuration's module. It expects to be a module of `dynid_generated`. `appearing`: names of the parameters on
/// which the equations depend.
pub fn configuration_module(configuration: &Configuration, appearing: &[String]) -> Result<String, EmitError> {
    let (device, number) = (&configuration.device, configuration.number);
    let head = format!(
        " @generated from `generated/{device}/c{number:02}.kir`; change `model/devices/{device}.toml`, then run \
         `cargo xtask gen --device {device} --config {number}`."
    );
    let about = format!(
        " Free joints: {}. Locked: {}. {} parameters, {} prepared values of which {} are lumps. Rows and vectors are \
         in the order of the free joints.",
        joints(&configuration.free),
        joints(&configuration.locked),
        configuration.parameters.len(),
        configuration.prepared.len(),
        configuration.n_lumps
    );
    let functions = configuration.functions.iter().map(|one| function(one, &documentation(one)));
    let kernel = table_entry(configuration, appearing);
    let tokens = quote! {
        #![doc = #head]
        #![doc = ""]
        #![doc = #about]
        use crate::{Kernel, KernelTable, Lanes, Operations, Scalar, checked, gradient::jacobian_of, lanes::of_eight};
        #kernel
        #(#functions)*
    };
    format(&format!("{device}, configuration {number}"), tokens)
}

/// What stands above a function: what it computes, from which form, at what cost, and its parameters by name.
fn documentation(function: &Function) -> Vec<String> {
    let cost = describe(&function.program.operations());
    let form = if function.form.is_empty() { String::new() } else { format!(" From: {}.", function.form) };
    let mut lines = vec![format!(" {}", function.title), String::new(), format!(" {cost}.{form}")];
    if function.name == "prepare" {
        lines.push(String::new());
        for argument in &function.arguments {
            let names = argument.elements.iter().map(|input| match input {
                crate::Input::Parameter(name) => name.clone(),
                other => other.identifier(),
            });
            let names = names.collect::<Vec<_>>().join(" ");
            lines.push(format!(" - `{}`: {}", argument.name, if names.is_empty() { "none" } else { &names }));
        }
        lines.push(format!(" - `prepared`: {}", function.results[0].elements.join(" ")));
    }
    lines
}

fn joints(joints: &[usize]) -> String {
    match joints {
        [] => "none".to_owned(),
        _ => joints.iter().map(usize::to_string).collect::<Vec<_>>().join(" "),
    }
}

fn table_entry(configuration: &Configuration, appearing: &[String]) -> TokenStream {
    let (device, number) = (&configuration.device, size(configuration.number));
    let free = list(configuration.free.iter().copied().map(size));
    let locked = list(configuration.locked.iter().copied().map(size));
    let parameters = list(&configuration.parameters);
    let appearing = list(appearing);
    let prepared = list(&configuration.prepared);
    let n_lumps = size(configuration.n_lumps);
    let prepare_ops = size(configuration.prepare_counts.arithmetic());
    let operations = list(configuration.functions.iter().map(|function| {
        let counts = function.program.operations();
        let (name, form) = (function.name, &function.form);
        let counts = [counts.adds, counts.muls, counts.divs, counts.sincos].map(size);
        quote!(Operations::new(#name, #form, [#(#counts),*], #prepare_ops))
    }));
    let entries = configuration.functions.iter().map(|function| {
        let (name, slices) = (identifier(function.name), slices(function));
        quote!(#name: checked!(#name::<f64>(#(#slices),*)))
    });
    let in_lanes =
        configuration.functions.iter().filter(|function| IN_LANES.contains(&function.name)).map(|function| {
            let (name, slices) = (identifier(function.name), slices(function));
            let entry = format_ident!("{}_lanes", function.name);
            quote!(#entry: checked!(#name::<Lanes>(#(#slices),*)))
        });
    let of_eight = configuration.functions.iter().filter(|function| OF_EIGHT.contains(&function.name)).map(of_eight);
    let [partials, n_parameters, n_locked, n_prepared] =
        [PARTIALS, configuration.parameters.len(), configuration.locked.len(), configuration.prepared.len()].map(size);
    quote! {
        /// The table entry: this configuration's kernels.
        pub static KERNEL: Kernel = Kernel {
            device: #device,
            configuration: Some(#number),
            free: #free,
            locked: #locked,
            parameters: #parameters,
            appearing: #appearing,
            prepared: #prepared,
            n_lumps: #n_lumps,
            operations: #operations,
            functions: &KernelTable {
                prepare_gradient: |parameters, locked, jacobian| {
                    jacobian_of::<#partials, #n_parameters, #n_locked, #n_prepared>(
                        prepare, parameters, locked, jacobian,
                    )
                },
                #(#entries,)*
                #(#of_eight,)*
                #(#in_lanes),*
            },
        };
    }
}

//! The module of the effects: one module each, and the table.

use proc_macro2::TokenStream;
use quote::{format_ident, quote};

use super::{EmitError, describe, format, function::function, identifier, of_eight, size, slices};
use crate::effect::EffectKernels;
use crate::kernel::Function;

/// The text of a module with all effects. It expects to be a module of `dynid_generated`.
pub fn effects_module(effects: &[EffectKernels]) -> Result<String, EmitError> {
    let modules = effects.iter().map(module);
    let names = effects.iter().map(|effect| identifier(&effect.id));
    let tokens = quote! {
        #![doc = " @generated from `model/effects/*.toml` at every `cargo build`."]
        use crate::EffectKernel;
        #(#modules)*
        /// Every effect, in the order of the ids.
        pub static EFFECTS: &[&EffectKernel] = &[#(&#names::EFFECT),*];
    };
    format("the effects", tokens)
}

fn module(effect: &EffectKernels) -> TokenStream {
    let name = identifier(&effect.id);
    let title = format!(" {}", effect.title);
    let id = &effect.id;
    let [n_parameters, n_states, n_outputs] = [effect.n_parameters, effect.n_states, effect.n_outputs].map(size);
    let functions = [&effect.eval, &effect.eval_gradient].map(|one| function(one, &documentation(one)));
    let entries = [&effect.eval, &effect.eval_gradient].map(|one| {
        let (name, slices) = (identifier(one.name), slices(one));
        let in_lanes = format_ident!("{}_lanes", one.name);
        quote! {
            #name: checked!(#name::<f64>(#(#slices),*)),
            #in_lanes: checked!(#name::<Lanes>(#(#slices),*))
        }
    });
    let of_eight = of_eight(&effect.eval);
    quote! {
        #[doc = #title]
        pub mod #name {
            use crate::{EffectKernel, EffectTable, Lanes, Scalar, checked, lanes::of_eight};
            /// The table entry: this effect's kernels.
            pub static EFFECT: EffectKernel = EffectKernel {
                id: #id,
                n_parameters: #n_parameters,
                n_states: #n_states,
                n_outputs: #n_outputs,
                functions: &EffectTable { #(#entries,)* #of_eight },
            };
            #(#functions)*
        }
    }
}

fn documentation(function: &Function) -> Vec<String> {
    let mut lines = vec![format!(" {}", function.title), String::new()];
    for argument in &function.arguments {
        let names: Vec<String> = argument.elements.iter().map(|input| input.identifier()).collect();
        lines.push(format!(
            " - `{}`: {}",
            argument.name,
            if names.is_empty() { "none".to_owned() } else { names.join(" ") }
        ));
    }
    lines.push(String::new());
    lines.push(format!(" {}.", describe(&function.program.operations())));
    lines
}

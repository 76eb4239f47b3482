//! One straight-line function, or several in a row where it would be too long.

use std::collections::{BTreeMap, BTreeSet};

use dynid_model::expression::Function as Call;
use proc_macro2::{Ident, Literal, TokenStream};
use quote::{format_ident, quote};

use super::{MOST_STATEMENTS, OF_EIGHT, identifier, size, term::Terms};
use crate::kernel::Function;
use crate::names::Names;
use crate::{Node, Operation, Program};

/// The function's tokens: `pub fn name<S: Scalar>(..)`, and the private functions that it is split into.
pub(super) fn function(function: &Function, doc: &[String]) -> TokenStream {
    let body = Body::new(function);
    let statements = body.statements();
    let name = identifier(function.name);
    let arguments = function.arguments.iter().map(|argument| {
        let (name, length) = (identifier(argument.name), size(argument.elements.len()));
        quote!(#name: &[S; #length])
    });
    let results = function.results.iter().map(|results| {
        let (name, length) = (identifier(results.name), size(results.elements.len()));
        quote!(#name: &mut [S; #length])
    });
    let signature: Vec<TokenStream> = arguments.chain(results).collect();
    let inline = OF_EIGHT.contains(&function.name).then(|| quote!(#[inline(always)]));
    let parts: Vec<&[Statement]> = statements.chunks(MOST_STATEMENTS).collect();
    if let [] | [_] = parts.as_slice() {
        let tokens = statements.iter().map(|statement| &statement.tokens);
        let loads = body.loads(&statements);
        return quote! {
            #(#[doc = #doc])*
            #inline
            pub fn #name<S: Scalar>(#(#signature),*) {
                #(#loads)*
                #(#tokens)*
            }
        };
    }

    // Terms that a later part reads travel in an array.
    let shared = shared(&parts);
    let slots: BTreeMap<Node, Literal> = shared.iter().enumerate().map(|(slot, &node)| (node, size(slot))).collect();
    let n_shared = size(shared.len());
    let names: Vec<Ident> = (1..=parts.len()).map(|number| format_ident!("{}_part{number}", function.name)).collect();
    let passed: Vec<Ident> = function
        .arguments
        .iter()
        .map(|argument| identifier(argument.name))
        .chain(function.results.iter().map(|results| identifier(results.name)))
        .collect();
    let bodies = parts.iter().zip(&names).map(|(part, name)| {
        let defined: BTreeSet<Node> = part.iter().flat_map(|statement| statement.defines.iter().copied()).collect();
        let read: BTreeSet<Node> = part.iter().flat_map(|statement| statement.reads.iter().copied()).collect();
        let loads = body.loads(part);
        let from_earlier = read.iter().filter(|node| !defined.contains(node)).filter_map(|node| {
            let (slot, name) = (slots.get(node)?, body.names.get(node)?);
            Some(quote!(let #name = shared[#slot];))
        });
        let tokens = part.iter().map(|statement| &statement.tokens);
        let to_later = defined.iter().filter_map(|node| {
            let (slot, name) = (slots.get(node)?, body.names.get(node)?);
            Some(quote!(shared[#slot] = #name;))
        });
        quote! {
            #[allow(unused_variables, clippy::too_many_arguments)]
            #inline
            fn #name<S: Scalar>(#(#signature),*, shared: &mut [S; #n_shared]) {
                #(#loads)*
                #(#from_earlier)*
                #(#tokens)*
                #(#to_later)*
            }
        }
    });
    let calls = names.iter().map(|part| quote!(#part(#(#passed),*, &mut shared);));
    quote! {
        #(#[doc = #doc])*
        #inline
        pub fn #name<S: Scalar>(#(#signature),*) {
            let mut shared = [S::constant(0.0); #n_shared];
            #(#calls)*
        }
        #(#bodies)*
    }
}

/// Terms that one part defines and a later one reads.
fn shared(parts: &[&[Statement]]) -> BTreeSet<Node> {
    let mut defined_in = BTreeMap::new();
    let mut shared = BTreeSet::new();
    for (number, part) in parts.iter().enumerate() {
        for statement in *part {
            let earlier = |node: &&Node| defined_in.get(*node).is_some_and(|&definer| definer < number);
            shared.extend(statement.reads.iter().filter(earlier));
            defined_in.extend(statement.defines.iter().map(|&node| (node, number)));
        }
    }
    shared
}

/// One line of a function.
struct Statement {
    tokens: TokenStream,
    /// Named terms and inputs that it reads.
    reads: BTreeSet<Node>,
    /// Terms that it defines.
    defines: Vec<Node>,
}

/// The terms of a function and their names.
struct Body<'a> {
    function: &'a Function,
    program: &'a Program,
    names: BTreeMap<Node, Ident>,
}

impl<'a> Body<'a> {
    fn new(function: &'a Function) -> Body<'a> {
        let program = &function.program;
        let mut body = Body { function, program, names: BTreeMap::new() };
        body.give_names();
        body
    }

    /// Inputs, named terms, shared terms, and all sines and cosines have a name.
    fn give_names(&mut self) {
        let arrays = self.function.arguments.iter().map(|argument| argument.name);
        let results = self.function.results.iter().map(|results| results.name);
        let taken = arrays.chain(results).chain(["shared", "S"]).map(str::to_owned).collect();
        let live = self.program.live();
        let mut names = Names::new(self.program, &live, taken);
        let angles = live
            .iter()
            .filter(|&&node| matches!(self.program.operation_of(node), Operation::Call(Call::Sin | Call::Cos, _)));
        let mut unnamed: BTreeSet<Node> = self.program.statements().into_iter().chain(angles.copied()).collect();
        unnamed.extend(self.written_twice());
        unnamed.into_iter().for_each(|node| names.number(node));
        self.names = names.into_map().into_iter().map(|(node, name)| (node, identifier(&name))).collect();
    }

    /// Terms that stand in several places of the results, as the entries of a symmetric matrix do.
    fn written_twice(&self) -> Vec<Node> {
        let outputs = self.function.results.iter().flat_map(|results| &results.elements);
        let mut nodes: Vec<Node> = outputs.filter_map(|output| self.program.find_output(output)).collect();
        nodes.sort_unstable();
        let is_term = |node: &Node| {
            let operation = self.program.operation_of(*node);
            !matches!(operation, Operation::Number(_) | Operation::Input(_) | Operation::Negate(_))
        };
        nodes.windows(2).filter(|pair| pair[0] == pair[1]).map(|pair| pair[0]).filter(is_term).collect()
    }

    /// `let q0 = q[0];` for every input that these statements read.
    fn loads(&self, statements: &[Statement]) -> Vec<TokenStream> {
        let read: BTreeSet<Node> = statements.iter().flat_map(|statement| statement.reads.iter().copied()).collect();
        let mut loads = Vec::new();
        for argument in &self.function.arguments {
            let array = identifier(argument.name);
            for (place, input) in argument.elements.iter().enumerate() {
                let node = self.program.find_input(input).filter(|node| read.contains(node));
                if let Some(name) = node.and_then(|node| self.names.get(&node)) {
                    let place = size(place);
                    loads.push(quote!(let #name = #array[#place];));
                }
            }
        }
        loads
    }

    /// The named terms in order, then the results. All sines and cosines of angles that come from inputs alone are
    /// computed at once, so that the scalar type may work on them side by side.
    fn statements(&self) -> Vec<Statement> {
        let live = self.program.live();
        let angles = self.angles(&live);
        let (first, others): (Vec<Node>, Vec<Node>) = angles.keys().partition(|angle| self.is_from_inputs(**angle));
        let before: BTreeSet<Node> = self.program.reached(first.iter().copied()).into_iter().collect();

        let mut statements = Vec::new();
        for &node in live.iter().filter(|node| before.contains(node)) {
            self.define(node, &mut statements);
        }
        if !first.is_empty() {
            statements.push(self.sines_and_cosines(&first, &angles));
        }
        let mut pending: BTreeSet<Node> = others.into_iter().collect();
        for &node in live.iter().filter(|node| !before.contains(node)) {
            match self.program.operation_of(node) {
                Operation::Call(Call::Sin | Call::Cos, angle) => {
                    if pending.remove(&angle) {
                        statements.push(self.sines_and_cosines(&[angle], &angles));
                    }
                }
                _ => self.define(node, &mut statements),
            }
        }
        self.write_results(&mut statements);
        statements
    }

    fn define(&self, node: Node, statements: &mut Vec<Statement>) {
        let Some(name) = self.names.get(&node) else { return };
        if matches!(self.program.operation_of(node), Operation::Input(_)) {
            return;
        }
        let value = self.terms().definition(node);
        let mut reads = BTreeSet::new();
        for operand in self.program.operation_of(node).operands() {
            self.collect_reads(operand, &mut reads);
        }
        statements.push(Statement { tokens: quote!(let #name = #value;), reads, defines: vec![node] });
    }

    /// `let ([s0, s1], [c0, _]) = S::sines_cosines([q0, q1]);`
    fn sines_and_cosines(&self, of: &[Node], angles: &BTreeMap<Node, [Option<Node>; 2]>) -> Statement {
        let column = |which: usize| {
            of.iter().map(move |angle| match angles[angle][which].and_then(|node| self.names.get(&node)) {
                Some(name) => quote!(#name),
                None => quote!(_),
            })
        };
        let (sines, cosines) = (column(0), column(1));
        let arguments = of.iter().map(|&angle| self.terms().reference(angle));
        let mut reads = BTreeSet::new();
        for &angle in of {
            self.collect_reads(angle, &mut reads);
        }
        Statement {
            tokens: quote!(let ([#(#sines),*], [#(#cosines),*]) = S::sines_cosines([#(#arguments),*]);),
            reads,
            defines: of.iter().flat_map(|angle| angles[angle]).flatten().collect(),
        }
    }

    fn write_results(&self, statements: &mut Vec<Statement>) {
        for results in &self.function.results {
            let array = identifier(results.name);
            for (place, output) in results.elements.iter().enumerate() {
                if let Some(node) = self.program.find_output(output) {
                    let (place, value) = (size(place), self.terms().reference(node));
                    let mut reads = BTreeSet::new();
                    self.collect_reads(node, &mut reads);
                    statements.push(Statement { tokens: quote!(#array[#place] = #value;), reads, defines: Vec::new() });
                }
            }
        }
    }

    /// Per angle its sine and its cosine, where needed.
    fn angles(&self, live: &[Node]) -> BTreeMap<Node, [Option<Node>; 2]> {
        let mut angles: BTreeMap<Node, [Option<Node>; 2]> = BTreeMap::new();
        for &node in live {
            match self.program.operation_of(node) {
                Operation::Call(Call::Sin, angle) => angles.entry(angle).or_default()[0] = Some(node),
                Operation::Call(Call::Cos, angle) => angles.entry(angle).or_default()[1] = Some(node),
                _ => {}
            }
        }
        angles
    }

    fn is_from_inputs(&self, node: Node) -> bool {
        self.program.reached([node]).iter().all(|&node| !matches!(self.program.operation_of(node), Operation::Call(..)))
    }

    /// The names that `node` is written with.
    fn collect_reads(&self, node: Node, reads: &mut BTreeSet<Node>) {
        if self.names.contains_key(&node) {
            reads.insert(node);
            return;
        }
        for operand in self.program.operation_of(node).operands() {
            self.collect_reads(operand, reads);
        }
    }

    fn terms(&self) -> Terms<'_> {
        Terms { program: self.program, names: &self.names }
    }
}

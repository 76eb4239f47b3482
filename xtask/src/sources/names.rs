//! What a path names: through imports, globs and re-exports, into other crates of the workspace.

use std::collections::BTreeSet;

use syn::Item;

use super::{Bound, ModuleId, Sources};

/// What a name or path stands for.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Meaning {
    Module(ModuleId),
    Item {
        module: ModuleId,
        /// In the module's items.
        index: usize,
    },
    /// A part of an item: an enum's variant, a type's function.
    Part {
        module: ModuleId,
        index: usize,
        path: String,
    },
    /// Of a module that has unseen items, and not among those that are seen.
    Unseen {
        module: ModuleId,
        name: String,
    },
    /// Of a crate that is not read.
    Foreign(String),
}

/// A meaning and how it was found.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Found {
    pub meaning: Meaning,
    /// Every module that names a part of the way.
    pub through: Vec<ModuleId>,
}

impl Found {
    fn at_once(meaning: Meaning) -> Self {
        Self { meaning, through: Vec::new() }
    }

    fn is_module(&self) -> bool {
        matches!(self.meaning, Meaning::Module(_))
    }

    fn after(mut self, through: &[ModuleId]) -> Self {
        self.through.extend(through);
        self
    }
}

/// What a path stands for, seen from a module: several things at once where a module and a function share a name.
pub fn resolve(sources: &Sources, from: ModuleId, path: &[String]) -> Vec<Found> {
    Search { sources, pending: BTreeSet::new() }.path(from, path, false)
}

/// What a name that other crates can see stands for.
pub fn public(sources: &Sources, module: ModuleId, name: &str) -> BTreeSet<Meaning> {
    let found = Search { sources, pending: BTreeSet::new() }.name(module, name, true);
    found.into_iter().map(|found| found.meaning).collect()
}

/// Names that other crates can see in a module, each once.
pub fn public_names(sources: &Sources, module: ModuleId) -> Vec<String> {
    let mut names = BTreeSet::new();
    gather_public(sources, module, &mut BTreeSet::new(), &mut names);
    names.into_iter().filter(|name| name != "_").collect()
}

fn gather_public(sources: &Sources, module: ModuleId, visited: &mut BTreeSet<ModuleId>, names: &mut BTreeSet<String>) {
    if !visited.insert(module) {
        return;
    }
    let bindings = &sources.modules[module].bindings;
    let public = bindings.iter().filter(|(_, bindings)| bindings.iter().any(|binding| binding.is_public));
    names.extend(public.map(|(name, _)| name.clone()));
    for glob in sources.modules[module].globs.iter().filter(|glob| glob.is_public) {
        for found in resolve(sources, module, &glob.path) {
            match found.meaning {
                Meaning::Module(other) => gather_public(sources, other, visited, names),
                Meaning::Item { module, index } => {
                    if let Item::Enum(item) = &sources.modules[module].items[index] {
                        names.extend(item.variants.iter().map(|variant| variant.ident.to_string()));
                    }
                }
                _ => {}
            }
        }
    }
}

struct Search<'a> {
    sources: &'a Sources,
    /// What is being looked up: imports may go in circles.
    pending: BTreeSet<(ModuleId, String, bool)>,
}

impl Search<'_> {
    /// `public`: only what its module shows to other crates.
    fn path(&mut self, from: ModuleId, path: &[String], public: bool) -> Vec<Found> {
        let Some((first, rest)) = path.split_first() else { return Vec::new() };
        let mut rest = rest.iter();
        let mut here = match first.as_str() {
            "crate" => vec![Found::at_once(Meaning::Module(self.sources.lineage(from)[0]))],
            "self" => vec![Found::at_once(Meaning::Module(from))],
            "super" => self.parent(from),
            "" => rest.next().map(|name| self.library(name)).into_iter().collect(),
            name => {
                let found = self.name(from, name, public && path.len() == 1);
                if found.is_empty() { vec![self.library(name)] } else { found }
            }
        };
        while let Some(name) = rest.next() {
            let public = public && rest.len() == 0;
            // a path goes on from the module, where the name stands for something else too
            if here.iter().any(Found::is_module) {
                here.retain(Found::is_module);
            }
            here = here.into_iter().flat_map(|found| self.step(found, name, public)).collect();
        }
        here
    }

    fn step(&mut self, here: Found, name: &str, public: bool) -> Vec<Found> {
        let Found { meaning, through } = here;
        let next = match meaning {
            Meaning::Module(module) if name == "super" => self.parent(module),
            Meaning::Module(module) => {
                let found = self.name(module, name, public);
                if found.is_empty() && self.sources.modules[module].has_unseen_items {
                    vec![Found::at_once(Meaning::Unseen { module, name: name.to_owned() })]
                } else {
                    found
                }
            }
            Meaning::Item { module, index } => {
                vec![Found::at_once(Meaning::Part { module, index, path: name.to_owned() })]
            }
            Meaning::Part { module, index, path } => {
                vec![Found::at_once(Meaning::Part { module, index, path: format!("{path}::{name}") })]
            }
            Meaning::Unseen { module, name: before } => {
                vec![Found::at_once(Meaning::Unseen { module, name: format!("{before}::{name}") })]
            }
            Meaning::Foreign(path) => vec![Found::at_once(Meaning::Foreign(format!("{path}::{name}")))],
        };
        next.into_iter().map(|found| found.after(&through)).collect()
    }

    fn parent(&self, module: ModuleId) -> Vec<Found> {
        let parent = self.sources.modules[module].parent;
        parent.map(|parent| Found::at_once(Meaning::Module(parent))).into_iter().collect()
    }

    fn library(&self, name: &str) -> Found {
        Found::at_once(match self.sources.libraries.get(name) {
            Some(&root) => Meaning::Module(root),
            None => Meaning::Foreign(name.to_owned()),
        })
    }

    fn name(&mut self, module: ModuleId, name: &str, public: bool) -> Vec<Found> {
        let key = (module, name.to_owned(), public);
        if !self.pending.insert(key.clone()) {
            return Vec::new();
        }
        let sources = self.sources;
        let mut found = Vec::new();
        for binding in sources.modules[module].bindings.get(name).into_iter().flatten() {
            if public && !binding.is_public {
                continue;
            }
            match &binding.bound {
                Bound::Module(child) => found.push(Found::at_once(Meaning::Module(*child))),
                Bound::Item(index) => found.push(Found::at_once(Meaning::Item { module, index: *index })),
                Bound::Path(path) => found.extend(self.path(module, path, public)),
            }
        }
        if found.is_empty() {
            for glob in sources.modules[module].globs.iter().filter(|glob| glob.is_public || !public) {
                for Found { meaning, through } in self.path(module, &glob.path, false) {
                    let next = match meaning {
                        Meaning::Module(other) => self.name(other, name, public),
                        Meaning::Item { module, index } if has_variant(&sources.modules[module].items[index], name) => {
                            vec![Found::at_once(Meaning::Part { module, index, path: name.to_owned() })]
                        }
                        _ => Vec::new(),
                    };
                    found.extend(next.into_iter().map(|found| found.after(&through)));
                }
            }
        }
        self.pending.remove(&key);
        found.sort();
        found.dedup();
        found.into_iter().map(|found| found.after(&[module])).collect()
    }
}

fn has_variant(item: &Item, name: &str) -> bool {
    matches!(item, Item::Enum(item) if item.variants.iter().any(|variant| variant.ident == name))
}

//! The sources of crates as a tree of modules, each with its items and with the names that it binds.

mod names;

pub use names::{Found, Meaning, public, public_names, resolve};

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use syn::punctuated::Punctuated;
use syn::spanned::Spanned;
use syn::{Attribute, Item, Meta, Token, UseTree, Visibility};

use crate::workspace;

/// Number of a module in [`Sources`].
pub type ModuleId = usize;

/// Which conditional items are read; what depends on other conditions always is.
#[derive(Debug, Clone, Copy)]
pub struct Conditions {
    /// What holds of `cfg(test)`.
    pub test: bool,
    /// What holds of every `cfg(feature = "..")`.
    pub features: bool,
}

/// Modules of several crates.
#[derive(Default)]
pub struct Sources {
    modules: Vec<Module>,
    libraries: BTreeMap<String, ModuleId>,
}

/// A module: a file, or a part of one.
pub struct Module {
    /// Its name; the crate's for a root.
    pub name: String,
    pub file: PathBuf,
    /// Whether it is written within its parent's file.
    pub is_inline: bool,
    pub parent: Option<ModuleId>,
    /// Without the contents of inline modules: these are modules of their own.
    pub items: Vec<Item>,
    /// Whether a macro or a build script makes items of it that nobody sees here.
    pub has_unseen_items: bool,
    bindings: BTreeMap<String, Vec<Binding>>,
    globs: Vec<Glob>,
}

/// What a name stands for in a module.
struct Binding {
    is_public: bool,
    bound: Bound,
}

enum Bound {
    Module(ModuleId),
    /// Index in the module's items.
    Item(usize),
    Path(Vec<String>),
}

/// `use path::*`.
struct Glob {
    is_public: bool,
    path: Vec<String>,
}

/// One name that a `use` brings: its path, and what it is called here (nothing: all names of the path).
pub struct Import {
    pub path: Vec<String>,
    pub name: Option<String>,
}

/// A module as it is about to be read.
struct Unread {
    name: String,
    file: PathBuf,
    parent: Option<ModuleId>,
    /// Where the files of its children are.
    folder: PathBuf,
    is_inline: bool,
}

impl Sources {
    /// Reads a library: other crates' paths may begin with its name.
    pub fn add_library(&mut self, name: &str, root: &Path, conditions: Conditions) -> anyhow::Result<ModuleId> {
        let id = self.add_crate(name, root, conditions)?;
        self.libraries.insert(name.to_owned(), id);
        Ok(id)
    }

    /// Reads a crate from its root file.
    pub fn add_crate(&mut self, name: &str, root: &Path, conditions: Conditions) -> anyhow::Result<ModuleId> {
        let folder = root.parent().unwrap_or(Path::new("")).to_path_buf();
        let items = parse(root)?;
        self.add(
            Unread { name: name.to_owned(), file: root.to_path_buf(), parent: None, folder, is_inline: false },
            items,
            conditions,
        )
    }

    /// Root of the library of this name.
    pub fn library(&self, name: &str) -> Option<ModuleId> {
        self.libraries.get(name).copied()
    }

    /// Every module, in the order of reading: a parent before its children.
    pub fn modules(&self) -> impl Iterator<Item = (ModuleId, &Module)> {
        self.modules.iter().enumerate()
    }

    /// The module of this number.
    pub fn module(&self, id: ModuleId) -> &Module {
        &self.modules[id]
    }

    /// The modules around this one, from its crate's root to itself.
    pub fn lineage(&self, id: ModuleId) -> Vec<ModuleId> {
        let mut lineage: Vec<_> = std::iter::successors(Some(id), |&id| self.modules[id].parent).collect();
        lineage.reverse();
        lineage
    }

    /// As a path in code: `crate::a::b`.
    pub fn path(&self, id: ModuleId) -> String {
        let names = self.lineage(id).into_iter().skip(1).map(|id| self.modules[id].name.clone());
        std::iter::once("crate".to_owned()).chain(names).collect::<Vec<_>>().join("::")
    }

    fn add(&mut self, unread: Unread, items: Vec<Item>, conditions: Conditions) -> anyhow::Result<ModuleId> {
        let id = self.modules.len();
        self.modules.push(Module {
            name: unread.name,
            file: unread.file.clone(),
            is_inline: unread.is_inline,
            parent: unread.parent,
            items: Vec::new(),
            has_unseen_items: false,
            bindings: BTreeMap::new(),
            globs: Vec::new(),
        });
        for mut item in items {
            if is_left_out(attributes(&item), conditions) {
                continue;
            }
            match &mut item {
                Item::Mod(module) => {
                    let content = module.content.take().map(|(_, items)| items);
                    let child = self.child(id, module, content, &unread.folder, conditions)?;
                    self.bind(id, &module.ident, &module.vis, Bound::Module(child));
                }
                Item::Use(import) => {
                    for Import { mut path, name } in imports(&import.tree) {
                        if import.leading_colon.is_some() {
                            path.insert(0, String::new());
                        }
                        let is_public = is_public(&import.vis);
                        match name {
                            Some(name) => self.modules[id]
                                .bindings
                                .entry(name)
                                .or_default()
                                .push(Binding { is_public, bound: Bound::Path(path) }),
                            None => self.modules[id].globs.push(Glob { is_public, path }),
                        }
                    }
                }
                Item::Impl(implementation) => {
                    implementation.items.retain(|item| match item {
                        syn::ImplItem::Const(item) => !is_left_out(&item.attrs, conditions),
                        syn::ImplItem::Fn(item) => !is_left_out(&item.attrs, conditions),
                        syn::ImplItem::Type(item) => !is_left_out(&item.attrs, conditions),
                        _ => true,
                    });
                }
                Item::Macro(item) => match &item.ident {
                    Some(_) if item.attrs.iter().any(|attribute| attribute.path().is_ident("macro_export")) => {
                        bail!(
                            "{}:{}: exported macros are not read here; export a function instead",
                            workspace::shown(&unread.file),
                            item.span().start().line
                        );
                    }
                    Some(_) => {}
                    None => self.modules[id].has_unseen_items = true,
                },
                _ => {}
            }
            if let Some((name, visibility)) = named(&item) {
                let index = self.modules[id].items.len();
                self.bind(id, &name.clone(), &visibility.clone(), Bound::Item(index));
            }
            self.modules[id].items.push(item);
        }
        Ok(id)
    }

    fn bind(&mut self, id: ModuleId, name: &syn::Ident, visibility: &Visibility, bound: Bound) {
        let binding = Binding { is_public: is_public(visibility), bound };
        self.modules[id].bindings.entry(name.to_string()).or_default().push(binding);
    }

    /// Reads a module that is declared in `parent`, whose children's files are in `folder`.
    fn child(
        &mut self,
        parent: ModuleId,
        module: &syn::ItemMod,
        content: Option<Vec<Item>>,
        folder: &Path,
        conditions: Conditions,
    ) -> anyhow::Result<ModuleId> {
        let name = module.ident.to_string();
        let declared_in = self.modules[parent].file.clone();
        let unread = |file: PathBuf, folder, is_inline| Unread {
            name: name.clone(),
            file,
            parent: Some(parent),
            folder,
            is_inline,
        };
        if let Some(items) = content {
            return self.add(unread(declared_in, folder.join(&name), true), items, conditions);
        }
        let beside = folder.join(format!("{name}.rs"));
        let within = folder.join(&name).join("mod.rs");
        let unread = if let Some(path) = stated_path(&module.attrs) {
            let of_declaration = declared_in.parent().unwrap_or(Path::new(""));
            let file = if self.modules[parent].is_inline { folder } else { of_declaration }.join(path);
            let folder = file.parent().unwrap_or(Path::new("")).to_path_buf();
            unread(file, folder, false)
        } else if beside.is_file() {
            unread(beside, folder.join(&name), false)
        } else if within.is_file() {
            unread(within, folder.join(&name), false)
        } else {
            bail!(
                "{}:{}: `mod {name};` has no file; make {} or remove the line",
                workspace::shown(&declared_in),
                module.span().start().line,
                workspace::shown(&beside)
            );
        };
        let items = parse(&unread.file)?;
        self.add(unread, items, conditions)
    }
}

/// What a `use` brings, name by name.
pub fn imports(tree: &UseTree) -> Vec<Import> {
    let mut found = Vec::new();
    gather(tree, &mut Vec::new(), &mut found);
    found
}

fn gather(tree: &UseTree, before: &mut Vec<String>, found: &mut Vec<Import>) {
    let mut tell = |last: &syn::Ident, name: &syn::Ident| {
        let mut path = before.clone();
        let mut name = name.to_string();
        if last != "self" || path.is_empty() {
            path.push(last.to_string());
        } else if name == "self" {
            // `a::{self}` is `a`
            name = path[path.len() - 1].clone();
        }
        found.push(Import { path, name: Some(name) });
    };
    match tree {
        UseTree::Path(step) => {
            before.push(step.ident.to_string());
            gather(&step.tree, before, found);
            before.pop();
        }
        UseTree::Name(leaf) => tell(&leaf.ident, &leaf.ident),
        UseTree::Rename(leaf) => tell(&leaf.ident, &leaf.rename),
        UseTree::Glob(_) => found.push(Import { path: before.clone(), name: None }),
        UseTree::Group(group) => {
            for tree in &group.items {
                gather(tree, before, found);
            }
        }
    }
}

fn parse(file: &Path) -> anyhow::Result<Vec<Item>> {
    let text = std::fs::read_to_string(file).with_context(|| format!("reading {}", workspace::shown(file)))?;
    let parsed = syn::parse_file(&text).map_err(|error| {
        anyhow::anyhow!("{}:{}: {error}; `cargo check` says more", workspace::shown(file), error.span().start().line)
    })?;
    Ok(parsed.items)
}

/// Whether other crates may see it, if they see what it is in.
pub fn is_public(visibility: &Visibility) -> bool {
    matches!(visibility, Visibility::Public(_))
}

fn stated_path(attributes: &[Attribute]) -> Option<String> {
    attributes.iter().find_map(|attribute| match &attribute.meta {
        Meta::NameValue(pair) if pair.path.is_ident("path") => match &pair.value {
            syn::Expr::Lit(syn::ExprLit { lit: syn::Lit::Str(path), .. }) => Some(path.value()),
            _ => None,
        },
        _ => None,
    })
}

fn is_left_out(attributes: &[Attribute], conditions: Conditions) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("cfg")
            && attribute.parse_args().is_ok_and(|condition: Meta| holds(&condition, conditions) == Some(false))
    })
}

/// Nothing where it depends on what is not known here.
fn holds(condition: &Meta, conditions: Conditions) -> Option<bool> {
    match condition {
        Meta::Path(path) => path.is_ident("test").then_some(conditions.test),
        Meta::NameValue(pair) => pair.path.is_ident("feature").then_some(conditions.features),
        Meta::List(list) => {
            let parts = list.parse_args_with(Punctuated::<Meta, Token![,]>::parse_terminated).ok()?;
            let parts: Vec<Option<bool>> = parts.iter().map(|part| holds(part, conditions)).collect();
            let decisive = if list.path.is_ident("not") {
                return parts.first().copied().flatten().map(|held| !held);
            } else {
                list.path.is_ident("any")
            };
            if parts.contains(&Some(decisive)) {
                Some(decisive)
            } else if parts.contains(&None) {
                None
            } else {
                Some(!decisive)
            }
        }
    }
}

fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(item) => &item.attrs,
        Item::Enum(item) => &item.attrs,
        Item::ExternCrate(item) => &item.attrs,
        Item::Fn(item) => &item.attrs,
        Item::ForeignMod(item) => &item.attrs,
        Item::Impl(item) => &item.attrs,
        Item::Macro(item) => &item.attrs,
        Item::Mod(item) => &item.attrs,
        Item::Static(item) => &item.attrs,
        Item::Struct(item) => &item.attrs,
        Item::Trait(item) => &item.attrs,
        Item::TraitAlias(item) => &item.attrs,
        Item::Type(item) => &item.attrs,
        Item::Union(item) => &item.attrs,
        Item::Use(item) => &item.attrs,
        _ => &[],
    }
}

/// Name and visibility of what a path can name, but for modules and imports.
fn named(item: &Item) -> Option<(&syn::Ident, &Visibility)> {
    match item {
        Item::Const(item) => Some((&item.ident, &item.vis)),
        Item::Enum(item) => Some((&item.ident, &item.vis)),
        Item::Fn(item) => Some((&item.sig.ident, &item.vis)),
        Item::Macro(item) => item.ident.as_ref().map(|name| (name, &Visibility::Inherited)),
        Item::Static(item) => Some((&item.ident, &item.vis)),
        Item::Struct(item) => Some((&item.ident, &item.vis)),
        Item::Trait(item) => Some((&item.ident, &item.vis)),
        Item::TraitAlias(item) => Some((&item.ident, &item.vis)),
        Item::Type(item) => Some((&item.ident, &item.vis)),
        Item::Union(item) => Some((&item.ident, &item.vis)),
        _ => None,
    }
}

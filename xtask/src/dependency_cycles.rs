//! No circle between folders: what stands side by side in a crate is used one way.
//!
//! A module and everything below it (`torque.rs` and the folder `torque/`) is one *subtree*, in whatever file a line of
//! it is. Two subtrees are *beside* each other where one module declares both. Forbidden is, at every level of every
//! crate, a circle among subtrees that are beside each other and of which one has a folder: `a` uses `b`, and `b`, perhaps by
//! way of `c`, uses `a`. Files of one folder may use each other.
//!
//! A module that declares others, and they, may use each other both ways: `torque.rs` uses its child `torque/states.rs`,
//! and that child uses `super::Memory`. So is what a parent passes on between its children by functions of its own; a
//! name that it only re-exports counts as what it is a name of.
//!
//! Uses are imports, paths and paths within macros' arguments; methods are not, for a method's place is unknown without
//! types. What only tests compile does not count.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::PathBuf;

use anyhow::bail;
use proc_macro2::{Span, TokenStream, TokenTree};
use syn::Item;
use syn::visit::{self, Visit};

use crate::sources::{Conditions, Found, Import, Meaning, ModuleId, Sources, imports, resolve};
use crate::workspace::{self, Member, TargetKind};

/// Fails on the first circle through each module.
pub fn check() -> anyhow::Result<()> {
    let members = workspace::members()?;
    let mut told = Vec::new();
    let mut n_files = 0;
    for member in &members {
        let (circles, files) = circles_of(member)?;
        told.extend(circles);
        n_files += files;
    }
    if !told.is_empty() {
        bail!(
            "{}\nMove what both sides need to a module of its own, or what one side takes from the other to where it is \
             used",
            told.join("\n")
        );
    }
    println!("{n_files} files, no circle between folders");
    Ok(())
}

/// Circles of all targets of a member that are no tests, and the number of files looked at.
fn circles_of(member: &Member) -> anyhow::Result<(Vec<String>, usize)> {
    let mut told = Vec::new();
    let mut n_files = 0;
    for target in member.targets.iter().filter(|target| target.kind != TargetKind::Trial) {
        let mut sources = Sources::default();
        sources.add_crate(&member.identifier(), &target.root, Conditions { test: false, features: true })?;
        n_files += sources.modules().filter(|(_, module)| !module.is_inline).count();
        told.extend(circles(&sources).iter().map(|circle| format!("{}: {circle}", member.name)));
    }
    Ok((told, n_files))
}

/// A place where one module uses another.
#[derive(Debug, Clone)]
struct Use {
    file: PathBuf,
    line: usize,
    path: String,
}

/// By user and used, both children of one module; in the order of reading.
type Uses = BTreeMap<(ModuleId, ModuleId), Vec<Use>>;

/// Every circle, in words.
fn circles(sources: &Sources) -> Vec<String> {
    let mut uses_below: BTreeMap<ModuleId, Uses> = BTreeMap::new();
    for (user, module) in sources.modules() {
        for path in paths_in(&module.items) {
            let mut meanings = resolve(sources, user, &path.names);
            let names_module = |found: &Found| matches!(found.meaning, Meaning::Module(_));
            if path.is_import && meanings.len() > 1 && meanings.iter().any(names_module) {
                // a module and a function of one name: which of them is meant, the uses of the import say
                continue;
            }
            if !path.is_import && path.names.len() == 1 {
                // a lone word that is no import means no module
                meanings.retain(|found| !names_module(found));
            }
            let mut used = BTreeSet::new();
            for Found { meaning, through } in meanings {
                used.extend(through);
                used.extend(match meaning {
                    Meaning::Module(module)
                    | Meaning::Item { module, .. }
                    | Meaning::Part { module, .. }
                    | Meaning::Unseen { module, .. } => Some(module),
                    Meaning::Foreign(_) => None,
                });
            }
            for used in used {
                let Some((parent, ours, theirs)) = beside(sources, user, used) else { continue };
                uses_below.entry(parent).or_default().entry((ours, theirs)).or_default().push(Use {
                    file: module.file.clone(),
                    line: path.at.start().line,
                    path: path.names.join("::"),
                });
            }
        }
    }
    let folders = with_folder(sources);
    let mut told = Vec::new();
    for (parent, uses) in &uses_below {
        for circle in circles_among(uses, &folders) {
            told.push(in_words(sources, *parent, &circle, uses));
        }
    }
    told
}

/// The subtrees of one module that the two are in, where these are not the same.
fn beside(sources: &Sources, user: ModuleId, used: ModuleId) -> Option<(ModuleId, ModuleId, ModuleId)> {
    let files = |id| {
        let mut lineage = sources.lineage(id);
        // what is written within a file belongs to that file
        while lineage.last().is_some_and(|&id| sources.module(id).is_inline) {
            lineage.pop();
        }
        lineage
    };
    let (ours, theirs) = (files(user), files(used));
    let n_common = ours.iter().zip(&theirs).take_while(|(ours, theirs)| ours == theirs).count();
    Some((*ours.get(n_common.checked_sub(1)?)?, *ours.get(n_common)?, *theirs.get(n_common)?))
}

/// Modules with files below their own.
fn with_folder(sources: &Sources) -> BTreeSet<ModuleId> {
    let in_own_file = sources.modules().filter(|(_, module)| !module.is_inline);
    in_own_file.flat_map(|(id, _)| sources.lineage(id).into_iter().filter(move |&above| above != id)).collect()
}

/// For each module with a folder that is on a circle, the shortest one, unless another that was told goes through it.
fn circles_among(uses: &Uses, folders: &BTreeSet<ModuleId>) -> Vec<Vec<ModuleId>> {
    let mut told = BTreeSet::new();
    let mut circles = Vec::new();
    let users: BTreeSet<ModuleId> = uses.keys().map(|(user, _)| *user).collect();
    for start in users {
        if !folders.contains(&start) || told.contains(&start) {
            continue;
        }
        if let Some(circle) = shortest_circle(start, uses) {
            told.extend(circle.iter().copied());
            circles.push(circle);
        }
    }
    circles
}

fn shortest_circle(start: ModuleId, uses: &Uses) -> Option<Vec<ModuleId>> {
    let mut came_from: BTreeMap<ModuleId, ModuleId> = BTreeMap::new();
    let mut waiting = VecDeque::from([start]);
    while let Some(user) = waiting.pop_front() {
        for (_, used) in uses.keys().filter(|(other, _)| *other == user) {
            if *used == start {
                let mut circle: Vec<ModuleId> =
                    std::iter::successors(Some(user), |id| came_from.get(id).copied()).collect();
                circle.reverse();
                return Some(circle);
            }
            if !came_from.contains_key(used) {
                came_from.insert(*used, user);
                waiting.push_back(*used);
            }
        }
    }
    None
}

fn in_words(sources: &Sources, parent: ModuleId, circle: &[ModuleId], uses: &Uses) -> String {
    let name = |id: ModuleId| format!("`{}`", sources.module(id).name);
    let names: Vec<String> = circle.iter().map(|&id| name(id)).collect();
    let mut text = format!("a circle among {} in `{}`", names.join(", "), sources.path(parent));
    for (&user, &used) in circle.iter().zip(circle.iter().cycle().skip(1)) {
        let places = &uses[&(user, used)];
        let place = &places[0];
        text.push_str(&format!(
            "\n    {} uses {}: {}:{}: {}",
            name(user),
            name(used),
            workspace::shown(&place.file),
            place.line,
            place.path
        ));
        if places.len() > 1 {
            text.push_str(&format!(", and {} more", places.len() - 1));
        }
    }
    text
}

/// A path as it is written.
struct Path {
    names: Vec<String>,
    at: Span,
    is_import: bool,
}

fn paths_in(items: &[Item]) -> Vec<Path> {
    let mut paths = Paths(Vec::new());
    for item in items {
        paths.visit_item(item);
    }
    paths.0
}

struct Paths(Vec<Path>);

impl<'ast> Visit<'ast> for Paths {
    fn visit_item_use(&mut self, import: &'ast syn::ItemUse) {
        if import.leading_colon.is_some() {
            return;
        }
        for Import { path, .. } in imports(&import.tree) {
            self.0.push(Path { names: path, at: import.use_token.span, is_import: true });
        }
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        if let (None, Some(first)) = (path.leading_colon, path.segments.first()) {
            let names = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
            self.0.push(Path { names, at: first.ident.span(), is_import: false });
        }
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        self.visit_path(&call.path);
        self.tokens(call.tokens.clone());
    }

    // names of attributes are no paths of ours
    fn visit_attribute(&mut self, _: &'ast syn::Attribute) {}
}

impl Paths {
    /// Every `a::b::c` among a macro's arguments.
    fn tokens(&mut self, tokens: TokenStream) {
        let mut path: Option<Path> = None;
        let mut n_colons = 0;
        for token in tokens {
            match token {
                TokenTree::Ident(name) => match &mut path {
                    Some(path) if n_colons == 2 => path.names.push(name.to_string()),
                    _ => {
                        let next = Path { names: vec![name.to_string()], at: name.span(), is_import: false };
                        self.0.extend(path.replace(next));
                    }
                },
                TokenTree::Punct(mark) if mark.as_char() == ':' => {
                    n_colons += 1;
                    continue;
                }
                TokenTree::Group(group) => {
                    self.0.extend(path.take());
                    self.tokens(group.stream());
                }
                _ => self.0.extend(path.take()),
            }
            n_colons = 0;
        }
        self.0.extend(path);
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::circles;
    use crate::sources::{Conditions, Sources};

    fn circles_in(files: &[(&str, &str)]) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        let mut sources = Sources::default();
        let conditions = Conditions { test: false, features: true };
        sources.add_crate("it", &folder.path().join("lib.rs"), conditions).unwrap();
        circles(&sources)
    }

    #[test]
    fn one_way_and_parents_with_their_children_are_no_circle() {
        let told = circles_in(&[
            ("lib.rs", "mod a; mod b; pub use a::A; pub fn shared() -> A { A }"),
            ("a.rs", "mod inner; use crate::b::B; pub struct A; impl A { fn of(_: B, _: inner::I) {} }"),
            ("a/inner.rs", "use super::A; pub struct I; fn of(_: A) { crate::b::f() }"),
            ("b.rs", "pub struct B; pub fn f() {} #[cfg(test)] mod tests { use crate::a::A; }"),
        ]);
        assert_eq!(told, [""; 0]);
    }

    #[test]
    fn a_circle_by_way_of_a_third_folder_is_told_with_its_places() {
        let told = circles_in(&[
            ("lib.rs", "mod a; mod b; mod c;"),
            ("a.rs", "pub mod inner;\npub struct A;"),
            ("a/inner.rs", "\nfn f() { crate::b::f() }"),
            ("b.rs", "use super::{c::{self, C}};\npub fn f() {}"),
            ("c.rs", "pub struct C;\n\n// why\nfn f() { println!(\"{}\", super::a::inner::f()) }"),
        ]);
        assert_eq!(told.len(), 1, "{told:?}");
        assert!(told[0].starts_with("a circle among `a`, `b`, `c` in `crate`"), "{told:?}");
        assert!(told[0].contains("a/inner.rs:2: crate::b::f\n"), "{told:?}");
        assert!(told[0].contains("b.rs:1: super::c, and 1 more\n"), "{told:?}");
        assert!(told[0].contains("c.rs:4: super::a::inner::f"), "{told:?}");
    }

    #[test]
    fn a_circle_by_a_re_export_of_the_parent_is_told() {
        let told = circles_in(&[
            ("lib.rs", "mod a; mod b; pub use b::B; use a::*;"),
            ("a.rs", "mod inner; use crate::B; pub struct A;"),
            ("a/inner.rs", ""),
            ("b.rs", "use super::*; pub struct B(A);"),
        ]);
        assert_eq!(told.len(), 1, "{told:?}");
    }

    #[test]
    fn a_module_is_told_from_a_function_of_its_name() {
        let told = circles_in(&[
            ("lib.rs", "mod library; pub mod device; pub use library::device;"),
            ("device.rs", "pub struct Device;"),
            ("library.rs", "use crate::device::Device; pub fn device() -> Device { Device }"),
        ]);
        assert_eq!(told, [""; 0]);
        let told = circles_in(&[
            ("lib.rs", "mod library; pub mod device; pub use library::device;"),
            ("device.rs", "mod inner; use crate::device; pub struct Device; fn f() { device() }"),
            ("device/inner.rs", ""),
            ("library.rs", "use crate::device::Device; pub fn device() -> Device { Device }"),
        ]);
        assert_eq!(told.len(), 1, "{told:?}");
    }

    #[test]
    fn a_circle_deep_within_a_folder_is_told() {
        let told = circles_in(&[
            ("lib.rs", "mod a;"),
            ("a.rs", "mod left; mod right;"),
            ("a/left.rs", "mod inner; use super::right::R; pub enum L { One }"),
            ("a/left/inner.rs", ""),
            ("a/right.rs", "pub struct R; fn f() -> super::left::L { crate::a::left::L::One }"),
        ]);
        assert_eq!(told.len(), 1, "{told:?}");
        assert!(told[0].starts_with("a circle among `left`, `right` in `crate::a`"), "{told:?}");
    }

    #[test]
    fn files_of_one_folder_may_use_each_other() {
        let told = circles_in(&[
            ("lib.rs", "mod a; mod b;"),
            ("a.rs", "use crate::b::B; pub struct A;"),
            ("b.rs", "use crate::a::A; pub struct B;"),
        ]);
        assert_eq!(told, [""; 0]);
    }
}

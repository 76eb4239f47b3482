//! The public items of the library that users see, one a line, in `docs/api.txt`: whoever changes them changes that
//! file too, and a reviewer sees it.
//!
//! Listed is what a path from `dynid` reaches, through re-exports into the other crates of the workspace, under each
//! name that it has: functions, types with their public fields, variants and functions, traits, constants. A signature
//! names types as the crate that has it does. Not listed are implementations of traits, what a build script or a macro
//! makes, and items of crates from elsewhere, but for the name that re-exports them.

mod signature;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::PathBuf;

use anyhow::{Context, bail};
use syn::{Item, ItemImpl};

use crate::sources::{Conditions, Meaning, ModuleId, Sources, public, public_names, resolve};
use crate::{shell, workspace};

/// The library that users see.
const FACADE: &str = "dynid";

/// Rewrites the list.
pub fn write() -> anyhow::Result<()> {
    let path = list_path();
    let text = current()?;
    fs::write(&path, &text).with_context(|| format!("writing {}", path.display()))?;
    println!("{}: {} lines", workspace::shown(&path), text.lines().count());
    Ok(())
}

/// Fails where the list is not what the library is.
pub fn check() -> anyhow::Result<()> {
    let path = list_path();
    let listed = fs::read_to_string(&path).with_context(|| {
        format!("reading {}, the list of `{FACADE}`'s public items; `cargo xtask api` writes it", path.display())
    })?;
    let text = current()?;
    if listed != text {
        bail!(
            "{} is not the public items of `{FACADE}` as they are now:\n{}\nWhere the change is meant, run `cargo xtask \
             api` and commit the file",
            workspace::shown(&path),
            differences(&listed, &text)
        );
    }
    println!("{} public items, as listed", text.lines().count());
    Ok(())
}

fn list_path() -> PathBuf {
    shell::root().join("docs/api.txt")
}

/// Lines that only one of the two has.
fn differences(listed: &str, current: &str) -> String {
    let (before, now): (BTreeSet<&str>, BTreeSet<&str>) = (listed.lines().collect(), current.lines().collect());
    let gone = before.difference(&now).map(|line| format!("- {line}"));
    let new = now.difference(&before).map(|line| format!("+ {line}"));
    let lines: Vec<String> = gone.chain(new).collect();
    if lines.is_empty() { "the order of lines or their ends differ".to_owned() } else { lines.join("\n") }
}

fn current() -> anyhow::Result<String> {
    let mut sources = Sources::default();
    for member in workspace::members()? {
        if let Some(root) = member.library() {
            let conditions = Conditions { test: false, features: false };
            sources.add_library(&member.identifier(), root, conditions)?;
        }
    }
    let root = sources.library(FACADE).with_context(|| format!("the workspace has no library `{FACADE}`"))?;
    Ok(list(&sources, root))
}

/// Every public item below a library's root.
fn list(sources: &Sources, root: ModuleId) -> String {
    let mut list = List { sources, implementations: implementations(sources), lines: BTreeSet::new() };
    list.module(root, &sources.module(root).name, &mut Vec::new());
    list.lines.into_iter().map(|line| line.text + "\n").collect()
}

/// Functions and constants of types, by the type: its module and its index there.
type Implementations<'a> = BTreeMap<(ModuleId, usize), Vec<&'a ItemImpl>>;

fn implementations(sources: &Sources) -> Implementations<'_> {
    let mut found: Implementations = BTreeMap::new();
    for (id, module) in sources.modules() {
        for item in &module.items {
            let Item::Impl(implementation) = item else { continue };
            let (None, syn::Type::Path(of)) = (&implementation.trait_, &*implementation.self_ty) else { continue };
            let path: Vec<String> = of.path.segments.iter().map(|segment| segment.ident.to_string()).collect();
            for of in resolve(sources, id, &path) {
                if let Meaning::Item { module, index } = of.meaning {
                    found.entry((module, index)).or_default().push(implementation);
                }
            }
        }
    }
    found
}

/// A line of the list, which is in the order of paths.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Line {
    path: String,
    text: String,
}

struct List<'a> {
    sources: &'a Sources,
    implementations: Implementations<'a>,
    lines: BTreeSet<Line>,
}

impl List<'_> {
    fn tell(&mut self, path: &str, text: String) {
        self.lines.insert(Line { path: path.to_owned(), text });
    }

    /// `around`: the modules that the path goes through, for a module can re-export one that it is in.
    fn module(&mut self, id: ModuleId, path: &str, around: &mut Vec<ModuleId>) {
        self.tell(path, format!("pub mod {path}"));
        if around.contains(&id) {
            return;
        }
        around.push(id);
        for name in public_names(self.sources, id) {
            let path = format!("{path}::{name}");
            for meaning in public(self.sources, id, &name) {
                match meaning {
                    Meaning::Module(module) => self.module(module, &path, around),
                    Meaning::Item { module, index } => self.item(module, index, &path),
                    Meaning::Part { module, index, path: part } => {
                        let whole = signature::name(&self.sources.module(module).items[index]);
                        self.tell(&path, format!("pub use {whole}::{part} as {path}"));
                    }
                    Meaning::Unseen { module, name } => {
                        let library = self.sources.module(self.sources.lineage(module)[0]).name.clone();
                        let within = self.sources.path(module).replacen("crate", &library, 1);
                        self.tell(&path, format!("pub use {within}::{name} as {path}"));
                    }
                    Meaning::Foreign(other) => self.tell(&path, format!("pub use {other} as {path}")),
                }
            }
        }
        around.pop();
    }

    fn item(&mut self, module: ModuleId, index: usize, path: &str) {
        let sources = self.sources;
        for (path, text) in signature::of_item(&sources.module(module).items[index], path) {
            self.tell(&path, text);
        }
        for implementation in self.implementations.get(&(module, index)).into_iter().flatten() {
            for (path, text) in signature::of_implementation(implementation, path) {
                self.lines.insert(Line { path, text });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::{differences, list};
    use crate::sources::{Conditions, Sources};

    /// The list of `facade`, which may re-export from `parts`; every library is one file.
    fn listed(facade: &str, parts: &[(&str, &str)]) -> String {
        let folder = tempfile::tempdir().unwrap();
        let mut sources = Sources::default();
        let mut roots = Vec::new();
        for (name, text) in parts.iter().chain(&[("facade", facade)]) {
            let path = folder.path().join(format!("{name}.rs"));
            fs::write(&path, text).unwrap();
            let conditions = Conditions { test: false, features: false };
            roots.push(sources.add_library(name, &path, conditions).unwrap());
        }
        list(&sources, roots[roots.len() - 1])
    }

    #[test]
    fn items_are_listed_with_their_signatures_and_what_is_private_is_not() {
        let text = listed(
            "/// Told.\n#[derive(Debug)] #[non_exhaustive] pub struct Model<T: Copy> { /// Name.\n pub name: String, values: Vec<T> }\n\
             impl<T: Copy> Model<T> { pub const N: usize = 3; pub fn set(&mut self, mut value: T) -> Result<(), Error> { loop {} } \
             fn hidden() {} pub(crate) fn also_hidden() {} }\n\
             impl Model<f64> { pub const fn of(text: &'static str) -> Self { loop {} } }\n\
             impl<T: Copy> Drop for Model<T> { fn drop(&mut self) {} }\n\
             pub enum Error { /// It.\n Plain, Tuple(f64, Vec<u8>), Named { at: usize } }\n\
             pub struct Pair(pub f64, u8); pub struct Unit; struct Hidden; pub(crate) struct AlsoHidden;\n\
             pub trait Law: Send { const ORDER: usize; type Out: Clone + Send; fn torque(&self, q: &[f64]) -> Self::Out; fn reset(&mut self) {} }\n\
             pub const RATE: f64 = 1.0; pub static NAMES: &[&str] = &[]; pub type Both<T> = (T, T);\n\
             pub fn far<T>(a: T, b: &mut [f64]) -> impl Iterator<Item = T> where T: Clone { std::iter::once(a) }\n\
             #[cfg(test)] pub fn tested() {} #[cfg(any(test, feature = \"x\"))] pub mod fixtures {}\n\
             mod private { pub fn unreachable() {} }",
            &[],
        );
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines,
            [
                "pub mod facade",
                "pub type facade::Both<T> = (T, T)",
                "pub enum facade::Error",
                "facade::Error::Named { at: usize }",
                "facade::Error::Plain",
                "facade::Error::Tuple(f64, Vec<u8>)",
                "pub trait facade::Law: Send",
                "const facade::Law::ORDER: usize",
                "type facade::Law::Out: Clone + Send",
                "fn facade::Law::reset(&mut self) { .. }",
                "fn facade::Law::torque(&self, q: &[f64]) -> Self::Out",
                "#[non_exhaustive] pub struct facade::Model<T: Copy> { .. }",
                "pub const facade::Model::N: usize, in impl<T: Copy> Model<T>",
                "pub facade::Model::name: String",
                "pub const fn facade::Model::of(text: &'static str) -> Self, in impl Model<f64>",
                "pub fn facade::Model::set(&mut self, value: T) -> Result<(), Error>, in impl<T: Copy> Model<T>",
                "pub static facade::NAMES: &[&str]",
                "pub struct facade::Pair(pub f64, _)",
                "pub const facade::RATE: f64",
                "pub struct facade::Unit",
                "pub fn facade::far<T>(a: T, b: &mut [f64]) -> impl Iterator<Item = T> where T: Clone",
            ]
        );
    }

    #[test]
    fn re_exports_are_followed_into_other_crates_under_the_names_that_they_have_here() {
        let parts = [
            (
                "low",
                "pub mod inner { pub struct Deep { pub a: f64 } impl Deep { pub fn go(&self) {} } }\n\
                 pub struct Glob; pub(crate) struct Private; mod hidden { pub fn shown() {} } pub use hidden::shown;\n\
                 pub enum Shape { Round } include!(concat!(env!(\"OUT_DIR\"), \"/made.rs\"));",
            ),
            (
                "middle",
                "pub use low::inner::Deep as Renamed; pub mod all { pub use low::*; } pub use elsewhere::Thing;",
            ),
        ];
        let text = listed(
            "pub use middle::{Renamed, Thing, all::{Glob, shown as seen}}; pub mod whole { pub use middle::all; }\n\
             pub use low as base; pub use low::Shape::Round; pub use low::made; use low::Shape;",
            &parts,
        );
        for line in [
            "pub struct facade::Renamed",
            "pub facade::Renamed::a: f64",
            "pub fn facade::Renamed::go(&self)",
            "pub use elsewhere::Thing as facade::Thing",
            "pub struct facade::Glob",
            "pub fn facade::seen()",
            "pub mod facade::whole",
            "pub mod facade::whole::all",
            "pub fn facade::whole::all::shown()",
            "pub struct facade::whole::all::inner::Deep",
            "pub mod facade::base",
            "pub enum facade::base::Shape",
            "pub use Shape::Round as facade::Round",
            "pub use low::made as facade::made",
        ] {
            assert!(text.lines().any(|other| other == line), "`{line}` is not in\n{text}");
        }
        for word in ["Private", "hidden", "facade::Shape"] {
            assert!(!text.contains(word), "`{word}` is in\n{text}");
        }
    }

    #[test]
    fn a_long_signature_is_one_line() {
        let text = listed(
            "pub fn long(first_of_many: &mut BTreeMap<String, Vec<f64>>, second_of_many: impl Fn(&str, usize) -> \
             Result<f64, Error>, third: [f64; 3]) -> Result<(Vec<f64>, BTreeMap<String, Vec<f64>>), Box<dyn Error>> {}",
            &[],
        );
        assert_eq!(
            text.lines().nth(1).unwrap(),
            "pub fn facade::long(first_of_many: &mut BTreeMap<String, Vec<f64>>, second_of_many: impl Fn(&str, usize) \
             -> Result<f64, Error>, third: [f64; 3]) -> Result<(Vec<f64>, BTreeMap<String, Vec<f64>>), Box<dyn Error>>"
        );
    }

    #[test]
    fn modules_that_re_export_each_other_come_to_an_end() {
        let text = listed("pub mod a { pub use crate::b; } pub mod b { pub use crate::a; pub struct It; }", &[]);
        assert!(text.contains("pub struct facade::a::b::It\n"), "{text}");
    }

    #[test]
    fn differences_are_told_line_by_line() {
        assert_eq!(differences("a\nb\n", "b\nc\n"), "- a\n+ c");
    }

    #[test]
    fn the_list_is_up_to_date() {
        super::check().unwrap();
    }
}

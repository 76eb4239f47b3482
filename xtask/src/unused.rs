//! No dependency that nothing uses: each costs everyone a build and a licence to read.
//!
//! A dependency is used where code names its crate: by `name::` or `use name`. Normal ones must be named by the library
//! or a program outside of `cfg(test)`, those of a build script by what it is made of, and those of tests by anything. A
//! dependency of tests that is a normal one already must ask for features that the normal one does not have.

use std::collections::BTreeSet;

use anyhow::bail;
use proc_macro2::{TokenStream, TokenTree};
use quote::ToTokens;

use crate::sources::{Conditions, Sources};
use crate::workspace::{self, Dependency, Kind, Member, TargetKind};

/// Dependencies that nothing names, for they only turn a feature on: crate, dependency and what the feature is for.
const FOR_A_FEATURE: &[(&str, &str, &str)] =
    &[("dynid-model", "proc_macro2", "`span-locations` gives what syn reads its line and column")];

/// Fails on dependencies that no source of theirs names.
pub fn check() -> anyhow::Result<()> {
    let mut wrong = Vec::new();
    let mut n_checked = 0;
    let members = workspace::members()?;
    for member in &members {
        n_checked += member.dependencies.len();
        wrong.extend(unused(member, FOR_A_FEATURE)?);
    }
    for (name, _, _) in FOR_A_FEATURE {
        if !members.iter().any(|member| member.name == *name) {
            wrong.push(format!("xtask/src/unused.rs excepts a dependency of `{name}`, which is no crate; remove it"));
        }
    }
    if !wrong.is_empty() {
        bail!("{}", wrong.join("\n"));
    }
    println!("{n_checked} dependencies, each named by the code that it is for");
    Ok(())
}

fn unused(member: &Member, excepted: &[(&str, &str, &str)]) -> anyhow::Result<Vec<String>> {
    let excepted: BTreeSet<&str> =
        excepted.iter().filter(|(name, ..)| *name == member.name).map(|(_, dependency, _)| *dependency).collect();
    let mut wrong = Vec::new();
    for dependency in &excepted {
        if !member.dependencies.iter().any(|other| other.identifier == *dependency) {
            wrong.push(format!(
                "xtask/src/unused.rs excepts `{dependency}`, which `{}` does not need any more; remove it",
                member.name
            ));
        }
    }
    for kind in [Kind::Normal, Kind::Build, Kind::Development] {
        let mut dependencies = member.dependencies.iter().filter(|dependency| dependency.kind == kind).peekable();
        if dependencies.peek().is_none() {
            continue;
        }
        let named = names_in_code(member, kind)?;
        for dependency in dependencies {
            if kind == Kind::Development && is_normal_already(member, dependency) {
                wrong.push(format!(
                    "{}: `{}` is in [dependencies] with the same features; remove it from [dev-dependencies]",
                    workspace::shown(&member.manifest),
                    dependency.package,
                ));
                continue;
            }
            if named.contains(&dependency.identifier) || excepted.contains(dependency.identifier.as_str()) {
                continue;
            }
            let (place, where_to) = match kind {
                Kind::Normal => ("its library or programs", "; what only tests need belongs into [dev-dependencies]"),
                Kind::Build => ("its build script", ""),
                Kind::Development => ("its code, tests, benchmarks or examples", ""),
            };
            wrong.push(format!(
                "{}: nothing in {place} names `{}`; remove `{}` from [{}]{where_to}",
                workspace::shown(&member.manifest),
                dependency.identifier,
                dependency.package,
                kind.table()
            ));
        }
    }
    Ok(wrong)
}

fn is_normal_already(member: &Member, dependency: &Dependency) -> bool {
    member.dependencies.iter().any(|normal| {
        normal.kind == Kind::Normal
            && normal.identifier == dependency.identifier
            && dependency.features.iter().all(|feature| normal.features.contains(feature))
    })
}

/// Every word that code for this kind of dependency names a crate by, and some that it does not.
fn names_in_code(member: &Member, kind: Kind) -> anyhow::Result<BTreeSet<String>> {
    let mut sources = Sources::default();
    for target in &member.targets {
        let is_for_it = match target.kind {
            TargetKind::Library | TargetKind::Program => kind != Kind::Build,
            TargetKind::BuildScript => kind == Kind::Build,
            TargetKind::Trial => kind == Kind::Development,
        };
        if is_for_it {
            let conditions = Conditions { test: kind == Kind::Development, features: true };
            sources.add_crate(&member.identifier(), &target.root, conditions)?;
        }
    }
    let mut named = BTreeSet::new();
    for (_, module) in sources.modules() {
        for item in &module.items {
            gather(item.to_token_stream(), &mut named);
        }
    }
    Ok(named)
}

/// Words with `::` after and none before them, and those after `use` and `extern crate`.
fn gather(tokens: TokenStream, named: &mut BTreeSet<String>) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let is_colon = |at: Option<&TokenTree>| matches!(at, Some(TokenTree::Punct(mark)) if mark.as_char() == ':');
    let is_path = |at: Option<usize>| at.is_some_and(|at| is_colon(tokens.get(at)) && is_colon(tokens.get(at + 1)));
    let word = |at: Option<usize>| match at.and_then(|at| tokens.get(at)) {
        Some(TokenTree::Ident(word)) => word.to_string(),
        _ => String::new(),
    };
    for (at, token) in tokens.iter().enumerate() {
        match token {
            TokenTree::Group(group) => gather(group.stream(), named),
            TokenTree::Ident(name) => {
                // `::name` without a word before it is an absolute path
                let goes_on =
                    is_path(at.checked_sub(2)) && !["", "use", "in"].contains(&word(at.checked_sub(3)).as_str());
                let is_imported = ["use", "crate"].contains(&word(at.checked_sub(1)).as_str());
                if is_imported || (is_path(Some(at + 1)) && !goes_on) {
                    named.insert(name.to_string());
                }
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::fs;

    use super::{gather, unused};
    use crate::workspace::{Dependency, Kind, Member, Target, TargetKind};

    #[test]
    fn crates_are_named_by_paths_and_imports_alone() {
        let code = "use anyhow; use csv::Reader; extern crate wide; fn serde(toml: f64) -> ::rayon::Pool { \
                    let rustfft = toml; format!(\"{}\", sha2::new(rustfft, self::text::of(toml))) }";
        let mut named = BTreeSet::new();
        gather(code.parse().unwrap(), &mut named);
        let named: Vec<&str> = named.iter().map(String::as_str).collect();
        assert_eq!(named, ["anyhow", "csv", "rayon", "self", "sha2", "wide"]);
    }

    fn needs(identifier: &str, kind: Kind, features: &[&str]) -> Dependency {
        Dependency {
            package: identifier.replace('_', "-"),
            identifier: identifier.to_owned(),
            kind,
            features: features.iter().copied().map(str::to_owned).collect(),
        }
    }

    /// What is told of a crate with these dependencies.
    fn told(dependencies: Vec<Dependency>, excepted: &[(&str, &str, &str)]) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let target = |kind, name: &str, text: &str| {
            fs::write(folder.path().join(name), text).unwrap();
            Target { kind, root: folder.path().join(name) }
        };
        let targets = vec![
            target(TargetKind::Library, "lib.rs", "use b_b::B; #[cfg(test)] mod tests { use a::A; }"),
            target(TargetKind::Trial, "trial.rs", "use c::C;"),
            target(TargetKind::BuildScript, "build.rs", "fn main() { a::run() }"),
        ];
        let member = Member { name: "it".to_owned(), manifest: "it/Cargo.toml".into(), dependencies, targets };
        unused(&member, excepted).unwrap()
    }

    #[test]
    fn what_only_tests_name_is_no_normal_dependency_and_what_nothing_names_is_none() {
        let dependencies = vec![
            needs("a", Kind::Normal, &[]),
            needs("b_b", Kind::Normal, &[]),
            needs("a", Kind::Build, &[]),
            needs("b_b", Kind::Build, &[]),
            needs("c", Kind::Development, &[]),
            needs("d", Kind::Development, &[]),
        ];
        assert_eq!(
            told(dependencies, &[]),
            [
                "it/Cargo.toml: nothing in its library or programs names `a`; remove `a` from [dependencies]; what only \
                 tests need belongs into [dev-dependencies]",
                "it/Cargo.toml: nothing in its build script names `b_b`; remove `b-b` from [build-dependencies]",
                "it/Cargo.toml: nothing in its code, tests, benchmarks or examples names `d`; remove `d` from \
                 [dev-dependencies]",
            ]
        );
    }

    #[test]
    fn a_dependency_is_stated_again_for_tests_only_where_they_need_more_of_it() {
        let again = |features| vec![needs("b_b", Kind::Normal, &["x"]), needs("b_b", Kind::Development, features)];
        assert_eq!(told(again(&["x", "y"]), &[]), [""; 0]);
        let told = told(again(&["x"]), &[]);
        assert!(told.len() == 1 && told[0].contains("remove it from [dev-dependencies]"), "{told:?}");
    }

    #[test]
    fn an_exception_holds_for_what_is_there_alone() {
        let excepted = [("it", "d", "why"), ("other", "c", "why")];
        assert_eq!(told(vec![needs("d", Kind::Normal, &[])], &excepted), [""; 0]);
        let told = told(Vec::new(), &excepted);
        assert!(told.len() == 1 && told[0].contains("excepts `d`"), "{told:?}");
    }

    #[test]
    fn every_dependency_is_used() {
        super::check().unwrap();
    }
}

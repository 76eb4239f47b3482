//! Links of the documentation: each leads to a file that is there, and to a heading that it has.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::{book, read};

#[test]
fn no_link_leads_nowhere() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut documents: Vec<PathBuf> = [
        "README.md",
        "python/README.md",
        "ARCHITECTURE.md",
        "NOTICE.md",
        "model/devices/README.md",
        "model/effects/README.md",
    ]
    .iter()
    .map(|name| root.join(name))
    .collect();
    documents.extend(of_folder(&root.join("docs")));
    documents.extend(of_folder(&book().join("src")));
    let mut dead = Vec::new();
    for document in &documents {
        for link in links(&read(document)) {
            if let Err(reason) = check(document, &link) {
                dead.push(format!("{}: ({link}): {reason}", document.display()));
            }
        }
    }
    assert!(dead.is_empty(), "\n{}", dead.join("\n"));
}

#[test]
fn the_summary_lists_every_chapter_and_every_picture_is_shown() {
    let source = book().join("src");
    let listed: BTreeSet<String> = links(&read(&source.join("SUMMARY.md"))).into_iter().collect();
    let names = |path: PathBuf| path.file_name().unwrap().to_string_lossy().into_owned();
    let chapters: BTreeSet<String> =
        of_folder(&source).into_iter().map(names).filter(|name| name != "SUMMARY.md").collect();
    assert_eq!(listed, chapters);
    let shown: BTreeSet<PathBuf> = of_folder(&source)
        .iter()
        .flat_map(|chapter| links(&read(chapter)))
        .filter(|link| link.starts_with("pictures/"))
        .map(|link| source.join(link))
        .collect();
    let mut kept = BTreeSet::new();
    for folder in fs::read_dir(source.join("pictures")).unwrap().map(|entry| entry.unwrap().path()) {
        kept.extend(fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()));
    }
    assert_eq!(shown, kept);
}

/// Markdown files of a folder, in order.
fn of_folder(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|own| own == "md"))
        .collect();
    files.sort();
    files
}

/// What a link leads to is a file, or a heading of one. Those to other hosts are not asked.
fn check(document: &Path, link: &str) -> Result<(), String> {
    if link.starts_with("https://") {
        return Ok(());
    }
    let (file, anchor) = link.split_once('#').map_or((link, None), |(file, anchor)| (file, Some(anchor)));
    let folder = document.parent().ok_or("no folder")?;
    let target = if file.is_empty() { document.to_owned() } else { folder.join(file) };
    let target = target.canonicalize().map_err(|_| "there is no such file".to_owned())?;
    // The built pages lie elsewhere.
    if document.starts_with(book())
        && !target.starts_with(book().canonicalize().map_err(|error| error.to_string())?.join("src"))
    {
        return Err("it leads out of the book".to_owned());
    }
    match anchor {
        Some(anchor) if !anchors(&read(&target)).contains(anchor) => Err(format!("there is no heading `{anchor}`")),
        _ => Ok(()),
    }
}

/// Targets of `[text](target)` and `![text](target)` outside of code.
fn links(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for line in prose(text) {
        // Every second part stands between back quotes.
        let without_code: String = line.split('`').step_by(2).collect::<Vec<&str>>().join("code");
        for rest in without_code.split("](").skip(1) {
            found.extend(rest.split(')').next().map(str::to_owned));
        }
    }
    found
}

/// Lines outside of fenced blocks.
fn prose(text: &str) -> impl Iterator<Item = &str> {
    let mut is_code = false;
    text.lines().filter(move |line| {
        let is_fence = line.trim_start().starts_with("```");
        is_code ^= is_fence;
        !is_code && !is_fence
    })
}

/// Names that headings get: small letters, blanks as hyphens, other signs left out; a second one of a name is numbered.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut anchors = BTreeSet::new();
    for heading in prose(text).filter(|line| line.starts_with('#')) {
        let heading = heading.trim_start_matches('#').trim().to_lowercase();
        let kept = heading.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
        let name: String = kept.map(|c| if c == ' ' { '-' } else { c }).collect();
        let mut numbered = name.clone();
        let mut n = 0;
        while !anchors.insert(numbered.clone()) {
            n += 1;
            numbered = format!("{name}-{n}");
        }
    }
    anchors
}

#[test]
fn links_and_headings_are_read() {
    let text = "# A b\n[x](y.md#z) `[no](no)` ![p](q.svg)\n```\n[no](no)\n```\n## A `b`, *c*!\n## A b\n";
    assert_eq!(links(text), ["y.md#z", "q.svg"]);
    assert_eq!(anchors(text), ["a-b", "a-b-c", "a-b-1"].map(str::to_owned).into());
}

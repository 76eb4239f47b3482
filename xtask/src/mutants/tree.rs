//! A copy of the workspace in which mutants are planted.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, bail};
use serde_json::Value;

use super::Mutant;
use super::switches::{self, Edit, MODULE};
use crate::{shell, workspace};

/// A program of tests, as cargo built it.
#[derive(Debug, Clone)]
pub struct Program {
    pub file: PathBuf,
    /// Folder of its package, in which it is run.
    pub folder: PathBuf,
}

/// Where planted mutants are, by file: number and range of bytes.
type Places = BTreeMap<PathBuf, Vec<(usize, Range<usize>)>>;

pub struct Tree {
    /// The copy, what is built of it, and what is learnt, side by side.
    folder: PathBuf,
    /// Root files of the libraries that mutants are planted in, as the workspace's root sees them.
    libraries: Vec<PathBuf>,
}

impl Tree {
    /// Copies what git knows of, with its changes, and nothing else. A file that is there already and equal is left as it is, so
    /// that little is compiled anew.
    pub fn new(folder: &Path, packages: &[String]) -> anyhow::Result<Self> {
        let members = workspace::members()?;
        let library = |package: &String| {
            let member = members.iter().find(|member| member.name == *package);
            let file = member.and_then(|member| member.library());
            let file = file.with_context(|| format!("no package with a library is called `{package}`"))?;
            Ok(file.strip_prefix(shell::root())?.to_owned())
        };
        let libraries = packages.iter().map(library).collect::<anyhow::Result<_>>()?;
        let tree = Self { folder: folder.to_owned(), libraries };
        let names: BTreeSet<PathBuf> = tree.names()?.into_iter().collect();
        for name in names.iter().filter(|name| !tree.is_judged(name)) {
            tree.write(name, &original(name)?)?;
        }
        tree.forget_others(&tree.root(), &names)?;
        Ok(tree)
    }

    /// Removes files of the copy that are not, or no longer, of the workspace: a test among them would go on catching mutants.
    fn forget_others(&self, folder: &Path, names: &BTreeSet<PathBuf>) -> anyhow::Result<()> {
        for entry in fs::read_dir(folder).with_context(|| format!("reading {}", folder.display()))? {
            let path = entry?.path();
            if path.is_dir() {
                self.forget_others(&path, names)?;
            } else if !names.contains(path.strip_prefix(self.root())?) {
                fs::remove_file(&path).with_context(|| format!("removing {}", path.display()))?;
            }
        }
        Ok(())
    }

    fn root(&self) -> PathBuf {
        self.folder.join("tree")
    }

    /// Files that git knows of or would take.
    fn names(&self) -> anyhow::Result<Vec<PathBuf>> {
        let mut git = Command::new("git");
        git.args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"]).current_dir(shell::root());
        let names = shell::stdout_of(&mut git)?;
        let there = |name: &PathBuf| shell::root().join(name).is_file();
        Ok(names.split('\0').filter(|name| !name.is_empty()).map(PathBuf::from).filter(there).collect())
    }

    /// Whether mutants may be planted in a file.
    fn is_judged(&self, name: &Path) -> bool {
        let holds = |library: &PathBuf| library.parent().is_some_and(|folder| name.starts_with(folder));
        name.extension().is_some_and(|extension| extension == "rs") && self.libraries.iter().any(holds)
    }

    fn write(&self, name: &Path, content: &[u8]) -> anyhow::Result<()> {
        let file = self.root().join(name);
        if fs::read(&file).is_ok_and(|before| before == content) {
            return Ok(());
        }
        fs::create_dir_all(file.parent().context("a file without a folder")?)?;
        fs::write(&file, content).with_context(|| format!("writing {}", file.display()))
    }

    /// An empty folder for what tests say while they are listened to.
    pub fn listeners(&self) -> anyhow::Result<PathBuf> {
        let folder = self.folder.join("heard");
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder)?;
        Ok(folder)
    }

    /// Verdicts of this and earlier runs.
    pub fn verdicts(&self) -> PathBuf {
        self.folder.join("verdicts.jsonl")
    }

    /// Plants `each` mutants of every list: the first that can be switched, compile, and do not overlap.
    pub fn plant(&self, lists: &[Vec<Mutant>], each: usize) -> anyhow::Result<Vec<Mutant>> {
        let sources: BTreeMap<PathBuf, (String, syn::File)> = self
            .names()?
            .into_iter()
            .filter(|name| self.is_judged(name))
            .map(|name| {
                let text = String::from_utf8(original(&name)?)?;
                let parsed = syn::parse_file(&text).with_context(|| format!("parsing {}", name.display()))?;
                Ok((name, (text, parsed)))
            })
            .collect::<anyhow::Result<_>>()?;
        let mut refused = BTreeSet::new();
        loop {
            let (mut chosen, mut n_passed_over) = (Vec::new(), 0);
            let mut edits: BTreeMap<&Path, Vec<Edit>> = BTreeMap::new();
            for list in lists {
                let mut left = each;
                for mutant in list.iter().filter(|mutant| !refused.contains(&mutant.number)) {
                    if left == 0 {
                        break;
                    }
                    let (text, parsed) = sources
                        .get(&mutant.file)
                        .with_context(|| format!("{}: no such file", mutant.file.display()))?;
                    let others = edits.entry(&mutant.file).or_default();
                    let edit = switches::edit(text, parsed, mutant);
                    let Some(edit) = edit.filter(|edit| others.iter().all(|other| !other.overlaps(edit))) else {
                        n_passed_over += 1;
                        continue;
                    };
                    others.push(edit);
                    chosen.push(mutant.clone());
                    left -= 1;
                }
            }
            let broken = self.broken(self.write_planted(&sources, edits)?)?;
            if broken.is_empty() {
                let n_broken = refused.len();
                println!(
                    "for {n_broken} that do not compile and {n_passed_over} that have no switch others were drawn"
                );
                return Ok(chosen);
            }
            refused.extend(broken);
        }
    }

    /// Writes the sources of what is judged, with their switches.
    fn write_planted(
        &self,
        sources: &BTreeMap<PathBuf, (String, syn::File)>,
        mut edits: BTreeMap<&Path, Vec<Edit>>,
    ) -> anyhow::Result<Places> {
        let mut places = Places::new();
        for (name, (text, _)) in sources {
            let mut edits = edits.remove(name.as_path()).unwrap_or_default();
            edits.sort_by_key(|edit| (edit.range.start, edit.range.end));
            let (mut text, own) = switches::planted(text, &edits);
            places.insert(name.clone(), own);
            if self.libraries.contains(name) {
                text.push_str(MODULE);
            }
            self.write(name, text.as_bytes())?;
        }
        Ok(places)
    }

    /// Cargo on all that can be tested, in the copy.
    fn cargo(&self, verb: &str, arguments: &[&str]) -> Command {
        let mut command = shell::cargo_on_all(verb, arguments);
        command.arg("--message-format=json").current_dir(self.root()).stderr(Stdio::inherit());
        command.env("CARGO_TARGET_DIR", self.folder.join("build")).env("RUSTFLAGS", "--cap-lints=warn");
        command
    }

    /// Numbers of the mutants that the compiler has something against.
    fn broken(&self, places: Places) -> anyhow::Result<BTreeSet<usize>> {
        let output = self.cargo("check", &["--keep-going"]).output().context("starting cargo")?;
        let mut broken = BTreeSet::new();
        for message in messages(&output.stdout) {
            if message["message"]["level"] != "error" {
                continue;
            }
            let spans = message["message"]["spans"].as_array().cloned().unwrap_or_default();
            let blamed: Vec<usize> = spans.iter().flat_map(|span| planted_at(&places, span)).collect();
            if blamed.is_empty() && !spans.is_empty() {
                bail!("the copy does not compile:\n{}", message["message"]["rendered"].as_str().unwrap_or_default());
            }
            broken.extend(blamed);
        }
        if broken.is_empty() && !output.status.success() {
            bail!("`cargo check` of the copy ended with {}", output.status);
        }
        Ok(broken)
    }

    /// Builds all tests.
    pub fn programs(&self) -> anyhow::Result<Vec<Program>> {
        let output = self.cargo("test", &["--no-run"]).output().context("starting cargo")?;
        if !output.status.success() {
            bail!("the tests of the copy do not build");
        }
        let program = |message: &Value| {
            let is_test = message["profile"]["test"] == true;
            let file = message["executable"].as_str().filter(|_| is_test)?;
            let folder = Path::new(message["manifest_path"].as_str()?).parent()?;
            Some(Program { file: file.into(), folder: folder.to_owned() })
        };
        Ok(messages(&output.stdout).iter().filter_map(program).collect())
    }
}

/// A file of the workspace.
fn original(name: &Path) -> anyhow::Result<Vec<u8>> {
    fs::read(shell::root().join(name)).with_context(|| format!("reading {}", name.display()))
}

/// What cargo says in JSON, line by line.
fn messages(stdout: &[u8]) -> Vec<Value> {
    String::from_utf8_lossy(stdout).lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}

/// Mutants that a span of the compiler's touches.
fn planted_at(places: &Places, span: &Value) -> Vec<usize> {
    let file = span["file_name"].as_str().unwrap_or_default();
    let byte = |key: &str| span[key].as_u64().unwrap_or_default() as usize;
    let (start, end) = (byte("byte_start"), byte("byte_end"));
    let own = places.get(Path::new(file)).into_iter().flatten();
    own.filter(|(_, range)| range.start < end && start < range.end).map(|(number, _)| *number).collect()
}

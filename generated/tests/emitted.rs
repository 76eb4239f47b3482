//! The emitted Rust as a person reviews it, and what a 1 kHz controller relies on: no panic path, no allocation.

use std::fs;
use std::path::{Path, PathBuf};

use dynid_generated::{Kernel, effects, kernels};

fn emitted(file: &str) -> String {
    let path = Path::new(env!("OUT_DIR")).join(file);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn module(kernel: &Kernel) -> String {
    format!("{}_c{:02}", kernel.device, kernel.configuration.unwrap_or_default())
}

/// Modules of one or two free joints whole; of others what tells a change: documentation (with operation counts,
/// parameters and prepared values by name) and signatures.
#[test]
fn modules_are_as_reviewed() {
    let mut settings = insta::Settings::clone_current();
    settings.set_prepend_module_to_snapshot(false);
    settings.set_omit_expression(true);
    settings.bind(|| {
        for kernel in kernels() {
            let module = module(kernel);
            let text = emitted(&format!("{module}.rs"));
            let shown = if kernel.free.len() <= 2 { text } else { outline(&text) };
            insta::assert_snapshot!(module, shown);
        }
        for device in dynid_model::devices().iter().filter(|device| device.end_point.is_some()) {
            let module = format!("{}_end_point", device.id);
            insta::assert_snapshot!(module.clone(), emitted(&format!("{module}.rs")));
        }
        let library = emitted("effect_library.rs");
        for effect in effects() {
            let start = library.find(&format!("pub mod {} {{", effect.id)).expect("every effect is a module");
            let length = library[start..].find("\n}\n").expect("every module ends") + 3;
            insta::assert_snapshot!(format!("effect_{}", effect.id), &library[start..start + length]);
        }
    });
}

fn outline(text: &str) -> String {
    let mut lines = Vec::new();
    let mut in_signature = false;
    for line in text.lines() {
        let shown = line.trim_start();
        in_signature |= shown.starts_with("pub fn ");
        if in_signature || shown.starts_with("//") || shown.starts_with("Operations::new") {
            lines.push(line);
        }
        in_signature &= !line.ends_with('{');
    }
    lines.join("\n") + "\n"
}

/// Every function stays short enough for rustc.
#[test]
fn no_function_is_longer_than_its_cap() {
    for kernel in kernels() {
        let mut length = 0;
        for line in emitted(&format!("{}.rs", module(kernel))).lines() {
            length = if line.starts_with("pub fn ") || line.starts_with("fn ") { 0 } else { length + 1 };
            // A statement may take several lines, and inputs are loaded on top.
            assert!(length < 8_000, "{}: {line}", module(kernel));
        }
    }
}

/// Reads the object code of this crate that the test itself is linked against. A call that could panic or allocate
/// would stand there as an undefined symbol. Proven for the `f64` instances of every kernel and effect, in release
/// builds; `libm`, called for tangents, exponentials and angles beyond 10^6 rad, is a crate of its own.
#[test]
fn compiled_kernels_neither_panic_nor_allocate() {
    if cfg!(debug_assertions) || !cfg!(target_os = "linux") {
        // A debug build asserts that slices have the right length; `objects` reads ELF, the format of Linux.
        return;
    }
    let library = library();
    let archive = fs::read(&library).expect("the library that this test was linked with is still there");
    let objects = objects(&archive);
    assert!(!objects.is_empty(), "{} holds no object code", library.display());
    let code: Vec<u8> = objects.concat();
    assert!(contains(&code, b"dynid_generated"), "the symbols are readable");
    // `_fail` is what `core` calls for a wrong index or length; the last two are the crates `std` and `alloc` in
    // mangled names.
    for forbidden in ["panic", "_fail", "unwrap", "__rust_alloc", "3std", "5alloc"] {
        assert!(!contains(&code, forbidden.as_bytes()), "`{forbidden}` is called in {}", library.display());
    }
}

#[test]
fn the_crate_needs_no_standard_library() {
    let root = include_str!("../src/lib.rs");
    assert!(root.contains("#![no_std]") && !root.contains("extern crate"));
}

/// A device becomes a module beside those of this crate, and a folder beside `src`.
#[test]
fn no_device_takes_the_name_of_a_module() {
    let modules = include_str!("../src/lib.rs").lines().filter_map(|line| line.strip_prefix("mod ")?.strip_suffix(';'));
    let taken: Vec<&str> = modules.chain(["effect_library", "build", "src", "tests"]).collect();
    assert!(taken.len() > 10);
    for name in taken {
        let error = dynid_model::Device::parse("", Path::new(&format!("{name}.toml"))).unwrap_err();
        assert!(error.message().contains("taken"), "{name}: {error}");
    }
}

/// The newest library of this crate beside the test's own program.
fn library() -> PathBuf {
    let program = std::env::current_exe().expect("a running test has a program");
    let folder = program.parent().expect("a program lies in a folder");
    let files = fs::read_dir(folder).expect("the folder can be read").filter_map(Result::ok);
    let libraries = files.map(|entry| entry.path()).filter(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("libdynid_generated-") && name.ends_with(".rlib")
    });
    let written = |path: &PathBuf| fs::metadata(path).and_then(|data| data.modified()).ok();
    libraries.max_by_key(written).expect("the test was linked with a library")
}

/// The members of an `ar` archive that hold object code; the others describe the crate to the compiler.
fn objects(archive: &[u8]) -> Vec<&[u8]> {
    let mut objects = Vec::new();
    let mut rest = archive.strip_prefix(b"!<arch>\n").expect("a library is an archive");
    while rest.len() > 60 {
        let (header, members) = rest.split_at(60);
        let size: usize = String::from_utf8_lossy(&header[48..58]).trim().parse().expect("a member has a size");
        let member = &members[..size];
        if member.starts_with(b"\x7fELF") && !header.starts_with(b"lib.rmeta") {
            objects.push(member);
        }
        rest = &members[(size + size % 2).min(members.len())..];
    }
    objects
}

fn contains(text: &[u8], part: &[u8]) -> bool {
    text.windows(part.len()).any(|window| window == part)
}

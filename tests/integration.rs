//! The facade and the program from outside, as one crate: linked once, and its tests share all cores to their end.
//!
//! Apart are `book`, which is also called by name, and `real_time`, which has an allocator of its own that counts.
//! `lineage`, `page` and `wrist` help the others.

mod add;
mod bad_input;
mod check;
mod command_line;
mod diagnose;
mod diagnose_path;
mod discover;
mod excite;
mod export;
mod figures;
mod formats;
mod hidden_effect;
mod jacobian;
mod job;
mod ladder;
mod library;
mod library_effects;
mod lineage;
mod new;
mod open;
mod own_effect;
mod own_robot;
mod page;
mod plan;
mod position_fit;
mod readme;
mod real_drives;
mod rendered_impedance;
mod report;
mod resume;
mod space;
mod tables_and_pages;
mod torque_fit;
mod tour;
mod wall;
mod wall_report;
mod wrist;

#[test]
fn no_file_is_forgotten() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let is_source = path.extension().is_some_and(|extension| extension == "rs");
        let is_apart = include_str!("../Cargo.toml").contains(&format!("[[test]]\nname = \"{name}\""));
        let is_here = include_str!("integration.rs").contains(&format!("\nmod {name};"));
        assert!(!is_source || is_apart || is_here, "{} is run by nothing", path.display());
    }
}

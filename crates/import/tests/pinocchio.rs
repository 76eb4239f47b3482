//! Imported devices against Pinocchio, which reads the same URDFs by code of its own.
//!
//! `DYNID_PYTHON` names a Python that has `pin` (else `python3`); where there is none, this is skipped aloud.
//! `DYNID_URDF_FOLDER` names a folder whose URDFs are compared too, and shown as a table.

mod support;

use std::path::Path;

use dynid_import::device_from_urdf;
use support::{Other, assert_same, files_in};

const PINOCCHIO: Other =
    Other { module: "pinocchio", package: "pin", script: "by_pinocchio.py", import: device_from_urdf };

#[test]
fn samples_agree_with_pinocchio() {
    let files = files_in(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/urdf"), "urdf");
    assert!(files.len() >= 8);
    assert_same(&PINOCCHIO, &files, false);
}

#[test]
fn robots_of_a_folder_agree_with_pinocchio() {
    match std::env::var("DYNID_URDF_FOLDER") {
        // What either refuses stands in the table.
        Ok(folder) => assert_same(&PINOCCHIO, &files_in(Path::new(&folder), "urdf"), true),
        Err(_) => eprintln!("SKIPPED: DYNID_URDF_FOLDER names no folder of URDFs"),
    }
}

//! The equations that are shipped, which a computer algebra system derived, against those of the arithmetic of our own.

use std::{fs, path::Path};

use dynid_equations::{Options, exact::Exact, generate};

#[test]
fn both_arithmetics_lead_to_the_same_bytes() {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../generated");
    for device in dynid_model::devices() {
        let files = generate::<Exact>(device, &Options::default()).expect("a shipped device has equations");
        assert!(!files.is_empty());
        for (path, text) in files {
            let known = fs::read_to_string(shipped.join(&path)).expect("it is shipped");
            assert!(known == text, "{} is other with the arithmetic of our own", path.display());
        }
    }
}

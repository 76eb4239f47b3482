//! The emitted Rust, as a person reviews it.

use std::path::Path;

use dynid_lower::Kir;
use dynid_lower::emit::configuration_module;
use dynid_lower::kernel::Configuration;

fn planar2r() -> Configuration {
    Configuration::new(&Kir::parse(include_str!("kir/planar2r.kir"), Path::new("planar2r.kir")).unwrap()).unwrap()
}

#[test]
fn planar2r_module() {
    insta::assert_snapshot!(configuration_module(&planar2r()).unwrap());
}

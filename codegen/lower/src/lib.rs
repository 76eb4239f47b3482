//! From named equations to Rust kernels, without computer algebra.

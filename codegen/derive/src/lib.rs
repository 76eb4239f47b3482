//! From a device to its named equations of motion, by computer algebra.

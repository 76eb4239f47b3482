//! The kernels: straight-line functions of every configuration of every device, and of every effect.

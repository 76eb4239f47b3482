//! The facade and the program from outside, as one crate: linked once, and its tests share all cores to their end.
//!
//! Apart are `book`, which is also called by name, and `real_time`, which counts what all its threads allocate.

mod add;
mod bad_input;
mod check;
mod command_line;
mod diagnose;
mod discover;
mod excite;
mod export;
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

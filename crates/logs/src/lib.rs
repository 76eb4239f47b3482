//! What was measured: experiments and their logs, the motion that they show, its noise, and how good they are.

pub mod controller;
pub mod experiment;
pub mod log;
pub mod motion;
pub mod noise;
pub mod quality;

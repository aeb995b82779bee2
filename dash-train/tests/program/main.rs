//! The program `dash` from outside: what its commands print, write and exit with.
//!
//! One test binary: each would link Burn once more.

mod bad_input;
mod benchmark;
mod command_line;
mod common;
mod compare;
mod curve;
mod doctor;
mod kill;
mod leave_out;
mod lpips;
mod quickstart;
mod report;
mod splat_files;
#[cfg(unix)]
mod stops;

//! The program `dash` from outside: what its commands print, write and exit with, how recordings are read, and a format of
//! one's own.
//!
//! One test binary: each would link Burn once more.

mod backdrop;
mod bad_input;
mod benchmark;
mod command_line;
mod common;
mod compare;
mod curve;
mod doctor;
mod jobs;
mod kill;
mod leave_out;
mod lpips;
mod own_format;
mod quickstart;
mod recordings;
mod report;
mod splat_files;
#[cfg(unix)]
mod stops;
mod windows;

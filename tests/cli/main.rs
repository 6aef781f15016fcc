//! The `surflux` command as users and scripts meet it: exit codes, messages, files, bytes.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking, in its helpers too")]

mod command_lines;
mod help;
mod hostile_files;
mod interrupts;
mod irradiance;
mod other_commands;
mod pictures;
mod same_bytes;
mod statistics;
mod support;
mod sweep;

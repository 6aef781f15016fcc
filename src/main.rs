//! The `surflux` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(surflux::cli::main())
}

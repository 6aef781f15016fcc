//! Ctrl-C: the first asks the run to stop at the next convenient point, the second ends the process at once.

use crate::error::{Error, Result};
use signal_hook::consts::SIGINT;
use signal_hook::flag;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock, Once};

static REQUESTED: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

/// Exit code of a process that the user stopped: 128 + SIGINT.
const EXIT_CODE: i32 = 130;

/// Installs the handler; later calls do nothing. Where the system refuses, Ctrl-C goes on ending the process at once.
pub fn install() {
    static INSTALLED: Once = Once::new();
    INSTALLED.call_once(|| {
        // Actions run in this order: only a request that is already there ends the process.
        if flag::register_conditional_shutdown(SIGINT, EXIT_CODE, Arc::clone(&REQUESTED)).is_ok() {
            let _ = flag::register(SIGINT, Arc::clone(&REQUESTED));
        }
    });
}

/// To be asked wherever work can stop: between batches, rows, files.
///
/// # Errors
/// [`Error::Interrupted`] once the user has pressed Ctrl-C.
pub fn check() -> Result<()> {
    if requested() { Err(Error::Interrupted) } else { Ok(()) }
}

/// Whether the user has pressed Ctrl-C: for loops that leave out the rest of their work, and whose caller asks [`check`].
pub fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}

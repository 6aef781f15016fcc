//! Memory that was freed goes back to the system where that helps.

/// Gives back what the allocator keeps for later. The GNU C library keeps the workspaces of every thread, a hundred bytes a
/// surfel after a million have been generated; other systems need no help.
pub fn give_back() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        unsafe extern "C" {
            /// `malloc_trim(3)`.
            fn malloc_trim(pad: usize) -> i32;
        }
        // SAFETY: the function may be called at any time by any thread; it touches free memory only.
        unsafe { malloc_trim(0) };
    }
}

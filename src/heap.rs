//! How the GNU C library's allocator hands freed memory back to the system; other systems' need no help.

/// From so many surfels on, what work on them leaves behind is worth the time that it takes to give it back.
const MANY_SURFELS: usize = 200_000;

/// Gives back what the allocator keeps for later after work on so many surfels: it keeps the workspaces of every thread, a
/// hundred bytes a surfel after a million have been generated.
pub fn give_back_after(surfels: usize) {
    if surfels < MANY_SURFELS {
        return;
    }
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: the function may be called at any time by any thread; it touches free memory only.
    unsafe {
        libc::malloc_trim(0);
    }
}

/// Keeps memory that is freed within the process.
///
/// The stages of a picture take and free large arrays one after the other, and a page that comes fresh from the system costs more than what most
/// stages do with it. A software Vulkan driver takes and frees a block for the vertices of every draw. Blocks above a threshold go back to the system each
/// time, and so does what is free at the end of the heap; the kernel then clears the same pages again and again, which cost
/// lavapipe a fifth to a third of its time. With both thresholds raised, freed memory is used again.
pub fn keep_freed_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        /// Bytes. The largest value that every glibc takes for the first; a peak of this size stays with the process.
        const THRESHOLD: libc::c_int = 32 << 20;
        static ONCE: std::sync::Once = std::sync::Once::new();
        ONCE.call_once(|| {
            for parameter in [libc::M_MMAP_THRESHOLD, libc::M_TRIM_THRESHOLD] {
                // SAFETY: mallopt takes the allocator's lock, and these parameters only steer when memory goes back. A value
                // that is refused leaves the default, which is merely slower.
                unsafe { libc::mallopt(parameter, THRESHOLD) };
            }
        });
    }
}

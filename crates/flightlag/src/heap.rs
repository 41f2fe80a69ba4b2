//! How freed memory goes back to the system.

/// glibc maps blocks one by one from a size on that grows to 32 MiB while a program runs. Columns of a long flight are smaller,
/// so that they share a heap whose holes stay with the process: up to twice the memory of what is in use. A size that is set
/// stays, and blocks of it go back when they are freed.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "there is no other way to set this than the C function")]
pub(crate) fn return_large_blocks() {
    const MAPPED_BYTES: i32 = 4 << 20;
    // What small blocks leave at the end of the heap goes back from twice that on, as it does without a size that is set.
    for (parameter, bytes) in [(libc::M_MMAP_THRESHOLD, MAPPED_BYTES), (libc::M_TRIM_THRESHOLD, 2 * MAPPED_BYTES)] {
        // SAFETY: `mallopt` takes two numbers, and sets a parameter of the allocator under the allocator's lock.
        let _ = unsafe { libc::mallopt(parameter, bytes) };
    }
}

/// Other allocators decide by themselves.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(crate) fn return_large_blocks() {}

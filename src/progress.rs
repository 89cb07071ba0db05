//! Progress reports of long work: the library calls, the CLI draws.

/// Receives the progress of long work. Calls come from any thread.
pub trait Progress: Sync {
    /// A new stage begins, of `total` steps (0: unknown).
    fn stage(&self, name: &str, total: u64);
    /// `steps` more steps of the stage are done.
    fn advance(&self, steps: u64);
}

/// Reports to nobody.
pub struct Quiet;

impl Progress for Quiet {
    fn stage(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
}

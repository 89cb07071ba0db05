//! Memory that laying a source into a grid takes, counted before it is taken, also by many threads at once.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::{Error, Result};

/// Bytes that were taken, of those that are allowed.
#[derive(Debug)]
pub struct Ledger {
    taken: AtomicU64,
    allowed: u64,
}

impl Ledger {
    /// Nothing taken of `allowed` bytes.
    pub fn new(allowed: u64) -> Ledger {
        Ledger { taken: AtomicU64::new(0), allowed }
    }

    /// Take `count` elements of `size` bytes; false where there is no room for them, as from then on.
    pub fn take(&self, count: usize, size: u64) -> bool {
        let bytes = size.saturating_mul(count as u64).min(u64::MAX / 4);
        // Each thread adds once more at the most after the sum is above what is allowed, so it does not wrap around.
        let before = self.taken.load(Ordering::Relaxed);
        before <= self.allowed && self.taken.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes) <= self.allowed
    }

    /// # Errors
    /// [`Error::Limit`] on `what` where there was no room for something.
    pub fn check(&self, what: &str) -> Result<()> {
        let needed = self.taken.load(Ordering::Relaxed);
        if needed <= self.allowed {
            return Ok(());
        }
        let what = format!("{what} (allow more memory, or lower the resolution), in bytes,");
        Err(Error::Limit { what, needed, allowed: self.allowed })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_allowed_can_be_taken_and_no_more() {
        let ledger = Ledger::new(100);
        assert!(ledger.take(10, 6) && ledger.take(4, 10));
        ledger.check("it").unwrap();
        assert!(!ledger.take(1, 1) && !ledger.take(usize::MAX, u64::MAX));
        let error = ledger.check("it").unwrap_err().to_string();
        assert!(error.contains("it (allow more memory") && error.contains("101"), "{error}");
        assert!(Ledger::new(u64::MAX).take(usize::MAX, u64::MAX));
    }
}

//! Budget of the memory that staging a source takes. Threads count memory before they allocate it.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::{Error, Result};

/// Number of bytes that were taken, and of those that may be taken.
#[derive(Debug)]
pub struct MemoryBudget {
    taken: AtomicU64,
    allowed: u64,
}

impl MemoryBudget {
    /// Budget of `allowed` bytes, of which nothing is taken.
    pub fn new(allowed: u64) -> MemoryBudget {
        MemoryBudget { taken: AtomicU64::new(0), allowed }
    }

    /// Take memory for `count` elements of `size` bytes. Returns false where that exceeds the budget; then every later call does, too.
    pub fn take(&self, count: usize, size: u64) -> bool {
        let bytes = size.saturating_mul(count as u64).min(u64::MAX / 4);
        // Once the sum exceeds the budget, each thread adds at most one more term, so the sum cannot overflow.
        let before = self.taken.load(Ordering::Relaxed);
        before <= self.allowed && self.taken.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes) <= self.allowed
    }

    /// Check that the budget was never exceeded; `what` is the work that the memory is for, in messages.
    ///
    /// # Errors
    /// [`Error::Limit`] where it was.
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
        let ledger = MemoryBudget::new(100);
        assert!(ledger.take(10, 6) && ledger.take(4, 10));
        ledger.check("it").unwrap();
        assert!(!ledger.take(1, 1) && !ledger.take(usize::MAX, u64::MAX));
        let error = ledger.check("it").unwrap_err().to_string();
        assert!(error.contains("it (allow more memory") && error.contains("101"), "{error}");
        assert!(MemoryBudget::new(u64::MAX).take(usize::MAX, u64::MAX));
    }
}

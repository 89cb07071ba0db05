//! Limits of deriving and drawing an L-system: symbols that are rewritten or looked at, and memory.

use crate::{Error, Result};

/// Limits of one derivation, and the symbols counted so far.
#[derive(Debug, Clone, Copy)]
pub struct Budget {
    max_symbols: u64,
    max_bytes: u64,
    symbols: u64,
}

impl Budget {
    pub fn new(max_symbols: u64, max_bytes: u64) -> Budget {
        Budget { max_symbols, max_bytes, symbols: 0 }
    }

    /// Count symbols that were written or looked at.
    pub fn spend(&mut self, symbols: u64) -> Result<()> {
        self.symbols = self.symbols.saturating_add(symbols);
        if self.symbols <= self.max_symbols {
            return Ok(());
        }
        Err(Error::Limit {
            what:
                "the L-system (lower option `iterations` or raise option `max_symbols`), in symbols rewritten or looked at,"
                    .into(),
            needed: self.symbols,
            allowed: self.max_symbols,
        })
    }

    /// Check memory before it is taken.
    pub fn holds(&self, bytes: usize) -> Result<()> {
        if bytes as u64 <= self.max_bytes {
            return Ok(());
        }
        Err(Error::Limit {
            what: "the L-system (lower option `iterations` or raise option `memory`), in bytes,".into(),
            needed: bytes as u64,
            allowed: self.max_bytes,
        })
    }

    pub fn symbols(&self) -> u64 {
        self.symbols
    }
}

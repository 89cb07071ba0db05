//! Any source → texel.

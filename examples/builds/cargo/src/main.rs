//! A program with a texel in it.

/// The texel that `build.rs` has baked.
static CARD: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/card.vtex"));

fn main() {
    println!("card.vtex has {} bytes", CARD.len());
}

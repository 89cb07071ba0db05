//! Rebuilds `samples/` from nothing but numbers: `cargo run --release --example make_samples [FOLDER]`.

#![allow(clippy::expect_used)] // A tool of the repository: what it expects cannot fail.

mod glb;
mod leaf;
mod random;
mod terrain;
mod tree;
mod tube;

use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "samples".into()));
    for (name, bytes) in [("tree.glb", tree::broadleaf()), ("terrain.glb", terrain::valley())] {
        let path = folder.join(name);
        std::fs::write(&path, &bytes)?;
        println!("{} {} bytes", path.display(), bytes.len());
    }
    Ok(())
}

//! Rebuilds `samples/` from nothing but numbers: `cargo run --release --example make_samples [FOLDER]`.

#![allow(clippy::expect_used)] // A tool of the repository: what it expects cannot fail.

mod card;
mod dandelion;
mod fern;
mod glb;
mod hill;
mod leaf;
mod random;
mod shell;
mod spruce;
mod terrain;
mod tree;
mod tube;

use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "samples".into()));
    let samples = [
        ("tree.glb", tree::broadleaf()),
        ("spruce.glb", spruce::spruce()),
        ("fern.glb", fern::fern()),
        ("terrain.glb", terrain::valley()),
        ("hill.obj", hill::hill()),
        ("curves/dandelion.csv", dandelion::table().into_bytes()),
    ];
    let whole = samples.map(|(name, bytes)| (name.to_owned(), bytes));
    for (name, bytes) in whole.into_iter().chain(shell::slices()) {
        let path = folder.join(name);
        path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
        std::fs::write(&path, &bytes)?;
        println!("{} {} bytes", path.display(), bytes.len());
    }
    Ok(())
}

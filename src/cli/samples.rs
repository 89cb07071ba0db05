//! The built-in samples: `vtex demo` and `vtex bench` need no file besides the program.

use std::collections::BTreeMap;

use crate::{Error, Result};

/// Name and number of bytes of each, in the order in which they are packed.
const SAMPLES: [(&str, usize); 7] = [
    ("tree.glb", 3_900_976),
    ("spruce.glb", 2_360_676),
    ("fern.glb", 92_016),
    ("terrain.glb", 328_924),
    ("landscapes/mountains.glb", 953_764),
    ("landscapes/million.glb", 1_148_212),
    ("landscapes/valley.glb", 1_428_228),
];
/// The samples one after the other, of each every fourth byte from the first on, then from the second on, and so on: their
/// floats and indices pack better so. One frame of zstd, which makes 3.4 MB of 10.2.
static PACKED: &[u8] = include_bytes!("samples.zst");
/// Path and bytes of each.
macro_rules! small {
    ($($path:literal,)*) => { &[$(($path, include_bytes!(concat!("../../samples/", $path)))),*] };
}

/// What is small, as it is: by its path below `samples/`.
static SMALL: &[(&str, &[u8])] = small![
    "landscapes/crypt.glb",
    "landscapes/lawn.glb",
    "landscapes/million.csv",
    "landscapes/million.png",
    "landscapes/teddy.glb",
    "landscapes/trees.glb",
    "landscapes/wind.glb",
    "landscapes/zoom.csv",
    "hypertextures/eroded.toml",
    "lsystems/birch.lsys",
    "lsystems/fern.lsys",
    "lsystems/hazel.lsys",
    "lsystems/larch.lsys",
    "lsystems/maple.lsys",
    "lsystems/oak.lsys",
    "lsystems/pine.lsys",
    "lsystems/poplar.lsys",
    "lsystems/spruce.lsys",
    "lsystems/tree.lsys",
    "lsystems/willow.lsys",
    "recipes/forest.toml",
    "recipes/fur.toml",
    "recipes/lawn.toml",
    "recipes/lawn-grass.toml",
    "recipes/meadow.toml",
    "recipes/skull.toml",
    "recipes/undergrowth.toml",
    "stacks/head.nrrd",
];

/// Path below `samples/` and bytes of those that `paths` names, and of what recipes among them draw.
///
/// # Errors
/// `Options` where one is not there; as [`unpack`].
pub fn find(paths: &[&str]) -> Result<BTreeMap<String, Vec<u8>>> {
    let packed = if paths.iter().any(|path| SAMPLES.iter().any(|s| s.0 == *path)) { unpack()? } else { Vec::new() };
    let small = SMALL.iter().map(|&(path, bytes)| (path, bytes.to_vec()));
    let all: BTreeMap<&str, Vec<u8>> = packed.into_iter().chain(small).collect();
    let mut found = BTreeMap::new();
    let mut wanted: Vec<String> = paths.iter().map(|&path| path.to_owned()).collect();
    while let Some(path) = wanted.pop() {
        let bytes = all.get(path.as_str()).cloned();
        let bytes = bytes.ok_or_else(|| Error::Options(format!("there is no built-in sample {path:?}")))?;
        if path.ends_with(".toml") {
            wanted.extend(drawn_by(&bytes).into_iter().filter(|other| !found.contains_key(other)));
        }
        found.insert(path, bytes);
    }
    Ok(found)
}

/// The samples that a recipe of `samples/recipes` draws: what it names by `"../…"`.
fn drawn_by(recipe: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(recipe);
    text.split('"').filter_map(|word| word.strip_prefix("../")).map(str::to_owned).collect()
}

/// Name and bytes of each of [`SAMPLES`].
///
/// # Errors
/// [`Error::Io`] where they cannot be unpacked, which only a damaged program can bring about.
pub fn unpack() -> Result<Vec<(&'static str, Vec<u8>)>> {
    let all = zstd::decode_all(PACKED).map_err(|e| Error::io("the built-in samples", e))?;
    let mut rest = &all[..];
    let mut samples = Vec::new();
    for (name, length) in SAMPLES {
        let Some((planes, after)) = rest.split_at_checked(length) else {
            return Err(Error::io("the built-in samples", std::io::ErrorKind::UnexpectedEof.into()));
        };
        rest = after;
        let plane = length / 4;
        samples.push((name, (0..length).map(|i| planes[i % 4 * plane + i / 4]).collect()));
    }
    Ok(samples)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn file(name: &str) -> Vec<u8> {
        std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name)).unwrap()
    }

    #[test]
    fn the_built_in_samples_are_those_of_the_folder() {
        for (name, bytes) in unpack().unwrap().into_iter().filter(|s| s.0.ends_with(".glb")) {
            let how = "`cargo test --release -- --ignored pack_the_samples` packs them anew";
            assert!(bytes == file(name), "{name} is another file: {how}, and their lengths are above");
        }
    }

    #[test]
    #[ignore = "writes src/cli/samples.zst"]
    fn pack_the_samples() {
        let planes = |bytes: &[u8]| (0..4).flat_map(|n| bytes.iter().skip(n).step_by(4).copied()).collect::<Vec<_>>();
        let all: Vec<u8> = SAMPLES.iter().flat_map(|s| planes(&file(s.0))).collect();
        let to = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/cli/samples.zst");
        std::fs::write(to, zstd::encode_all(&all[..], 19).unwrap()).unwrap();
    }
}

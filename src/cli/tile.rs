//! `vtex render --tile`: a part of the picture, that `vtex stitch` puts together with the others.

use std::path::Path;

use sha2::{Digest, Sha256};

use crate::Result;
use crate::format::read_file;
use crate::render::{Film, Options, Sky, Tile};
use crate::scene::files::hex;

/// A film as it is stored.
pub struct Picture {
    pub film: Film,
    /// Where it belongs, if it is a part of a picture.
    pub tile: Option<Tile>,
}

impl Picture {
    /// # Errors
    /// As [`Film::save`].
    pub fn save(&self, path: &Path) -> Result<()> {
        match &self.tile {
            Some(tile) => tile.save(&self.film, path),
            None => self.film.save(path),
        }
    }
}

/// The tile that `options` ask for. Tiles of one picture agree on the landscape's bytes, on `said` (what else decides on the
/// picture, but not on its files' places), on the options and on the version of the program.
///
/// # Errors
/// `Io` where the landscape cannot be read.
pub fn tile(landscape: &Path, options: &Options, said: &str) -> Result<Option<Tile>> {
    let Some(window) = options.crop else { return Ok(None) };
    // Machines of a farm may have a picture of the sky in folders of different names.
    let sky = options.sky.clone().map(|sky| match sky {
        Sky::Picture(path) => Sky::Picture(path.file_name().unwrap_or_default().into()),
        other => other,
    });
    let options = Options { crop: None, threads: 0, memory: 0, sky, ..options.clone() };
    let choices = format!("{} {said} {options:?}", env!("CARGO_PKG_VERSION"));
    let digest = Sha256::new().chain_update(read_file(landscape, u64::MAX)?).chain_update(choices).finalize();
    Ok(Some(Tile { window, whole: options.size, picture: hex(digest) }))
}

//! `vtex render --reference`: many samples a pixel, in pieces that are kept.

use std::path::Path;

use sha2::{Digest, Sha256};

use super::Ui;
use crate::format::read_file;
use crate::render::metrics::flip::DEFAULT_PPD;
use crate::render::reference::{Reference, reference};
use crate::render::{Film, Options, SourceLod, Tone};
use crate::scene::Scene;
use crate::scene::files::{extension, hex};
use crate::{Error, Result};

/// Samples between two times that the picture is stored.
const PIECE: u32 = 64;

pub struct Job<'a> {
    pub landscape: &'a Path,
    pub scene: &'a Scene,
    /// Which of the landscape's scenes was asked for.
    pub scene_name: Option<&'a str>,
    /// What else decides on how the scene was read.
    pub moment: String,
    pub options: &'a Options,
    /// Of a .png.
    pub tone: Tone,
    /// A pixel.
    pub samples: u32,
    pub output: &'a Path,
}

impl Job<'_> {
    /// Trace, store, and say how noisy the picture is; with `resume`, go on from what `output` holds.
    pub fn run(&self, resume: bool, ui: &Ui) -> Result<(Reference, serde_json::Value)> {
        let exr = extension(self.output) == "exr";
        if resume && !exr {
            return Err(Error::Options("--resume needs an output that ends in .exr: it holds the samples".into()));
        }
        let key = self.key()?;
        let mut done = None;
        if resume && self.output.exists() {
            let found = Reference::load(self.output, Some(&key))?;
            ui.say(&format!("{}: {} samples a pixel so far", self.output.display(), found.samples));
            done = Some(found);
        }
        let mut spoken = false;
        loop {
            let first = done.as_ref().map_or(0, |d: &Reference| d.samples);
            if first >= self.samples {
                break;
            }
            let end = if exr { self.samples.min(first + PIECE) } else { self.samples };
            let more = reference(self.scene, self.options, first..end, ui)?;
            ui.finish();
            if !spoken {
                more.notes.iter().for_each(|note| ui.say(note));
                ui.warn(&more.warnings)?;
                spoken = true;
            }
            match &mut done {
                Some(done) => done.add(more),
                None => done = Some(more),
            }
            if let (true, Some(done)) = (exr, &done) {
                done.save(self.output, &key)?;
            }
        }
        let Some(done) = done else { return Err(Error::Options("--reference needs a sample".into())) };
        if !exr {
            let mut shown = done.film.clone();
            self.tone.apply(&mut shown);
            shown.save(self.output)?;
        }
        let noise = done.noise(DEFAULT_PPD)?;
        let rmse = 0.5 * noise.all.rmse;
        let Film { width, height, .. } = done.film;
        let (samples, path, flip) = (done.samples, self.output.display(), noise.all.flip);
        ui.say(&format!(
            "{path}: {width}×{height}, {samples} samples a pixel; noise: RMSE {rmse:.6}, FLIP {flip:.5} between its halves"
        ));
        let told = serde_json::json!({ "samples": samples, "noise_rmse": rmse, "noise_flip_of_halves": flip });
        Ok((done, told))
    }

    /// What a picture is of: the landscape's bytes and all options that change it.
    fn key(&self) -> Result<String> {
        let bytes = read_file(self.landscape, u64::MAX)?;
        let options = Options {
            threads: 0,
            lanes: 1,
            depth_bias: 0.0,
            shadow_bias: 0.0,
            source_lod: SourceLod::default(),
            ..self.options.clone()
        };
        let choices = format!("{:?} {} {options:?}", self.scene_name, self.moment);
        let digest = Sha256::new().chain_update(bytes).chain_update(choices).finalize();
        Ok(hex(digest))
    }
}

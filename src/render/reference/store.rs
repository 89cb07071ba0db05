//! References as EXR files, from which they can be continued: the film as R, G, B, A, its two halves as even.R … odd.A,
//! and in the attributes how many samples it has and what of.

use std::collections::BTreeMap;
use std::path::Path;

use super::Reference;
use crate::render::film::Film;
use crate::render::image_io::{Planes, read_planes, write_planes};
use crate::render::metrics;
use crate::render::metrics::Comparison;
use crate::render::stats::Stats;
use crate::{Error, Result, Warnings};

const SAMPLES: &str = "vtex:samples";
const SCENE: &str = "vtex:scene";
const HALVES: [&str; 2] = ["even.", "odd."];
const CHANNELS: [&str; 4] = ["R", "G", "B", "A"];

impl Reference {
    /// Write the film and its halves; `key` tells what they are of.
    ///
    /// # Errors
    /// `Io` where the file cannot be written.
    pub fn save(&self, path: &Path, key: &str) -> Result<()> {
        let mut planes = BTreeMap::new();
        for (prefix, film) in [("", &self.film), (HALVES[0], &self.halves[0]), (HALVES[1], &self.halves[1])] {
            for (k, channel) in CHANNELS.iter().enumerate() {
                planes.insert(format!("{prefix}{channel}"), film.pixels.iter().map(|p| p[k]).collect());
            }
        }
        let texts = BTreeMap::from([(SAMPLES.into(), self.samples.to_string()), (SCENE.into(), key.into())]);
        let [width, height] = [self.film.width, self.film.height].map(|n| n as usize);
        write_planes(path, &Planes { width, height, planes, texts })
    }

    /// Read what [`Reference::save`] wrote, without its statistics; under `key`, if one is given.
    ///
    /// # Errors
    /// `Input` where the file is no such reference or is one of something else.
    pub fn load(path: &Path, key: Option<&str>) -> Result<Reference> {
        let found = read_planes(path)?;
        let Some(samples) = found.texts.get(SAMPLES).and_then(|n| n.parse::<u32>().ok()).filter(|&n| n > 0) else {
            return Err(Error::input(path, "", "is no reference that could be continued"));
        };
        if key.is_some_and(|key| found.texts.get(SCENE).is_none_or(|scene| scene != key)) {
            let what = "is a reference of another scene or with other options; remove it or choose another name";
            return Err(Error::input(path, "", what));
        }
        let film = |prefix: &str| {
            let planes = CHANNELS.map(|channel| found.planes.get(&format!("{prefix}{channel}")));
            let [Some(r), Some(g), Some(b), Some(a)] = planes else {
                return Err(Error::input(
                    path,
                    "",
                    format!("has no channels {prefix}R, {prefix}G, {prefix}B, {prefix}A"),
                ));
            };
            let pixels = (0..r.len()).map(|i| [r[i], g[i], b[i], a[i]]).collect();
            Ok(Film { width: found.width as u32, height: found.height as u32, pixels })
        };
        Ok(Reference {
            film: film("")?,
            halves: [film(HALVES[0])?, film(HALVES[1])?],
            samples,
            stats: Stats::default(),
            warnings: Warnings::default(),
            notes: Vec::new(),
        })
    }

    /// The first half against the second: the film's own noise is half of this RMSE.
    ///
    /// # Errors
    /// `Options` where `ppd` is out of range.
    pub fn noise(&self, ppd: f64) -> Result<Comparison> {
        let [even, odd] = &self.halves;
        metrics::compare(&even.image(), &odd.image(), &metrics::Options { ppd, background: None })
    }

    /// Add samples `self.samples ..` of the same picture, which `more` holds; statistics and warnings become `more`'s.
    /// Nothing is added where the sizes differ.
    pub fn add(&mut self, more: Reference) {
        if (self.film.width, self.film.height) != (more.film.width, more.film.height) {
            return;
        }
        let first = self.samples;
        let even = |n: u32| n.div_ceil(2);
        let counts = |from: u32, to: u32| [even(to) - even(from), to / 2 - from / 2];
        let (own, added) = (counts(0, first), counts(first, first + more.samples));
        blend(&mut self.film, &more.film, first, more.samples);
        for k in 0..2 {
            blend(&mut self.halves[k], &more.halves[k], own[k], added[k]);
        }
        self.samples += more.samples;
        (self.stats, self.warnings, self.notes) = (more.stats, more.warnings, more.notes);
    }
}

/// The mean of `n` samples in `film` and `m` in `more`.
fn blend(film: &mut Film, more: &Film, n: u32, m: u32) {
    let total = f64::from((n + m).max(1));
    for (p, q) in film.pixels.iter_mut().zip(&more.pixels) {
        *p =
            std::array::from_fn(|k| ((f64::from(n) * f64::from(p[k]) + f64::from(m) * f64::from(q[k])) / total) as f32);
    }
}

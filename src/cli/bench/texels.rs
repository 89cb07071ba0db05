//! What a scene's texel is worth on its own: opacity, normals, colour and light against its source, and how much the brightness
//! of the picture changes from depth to depth.

use serde::Serialize;

use super::context::Bench;
use super::made::{Made, Recipe};
use super::scenes::{Layout, Place};
use crate::cli::{Ui, error};
use crate::format::{Limits, Reader};
use crate::progress::Quiet;
use crate::render::error::{DepthError, Options as Measure};
use crate::render::{Options, SourceLod, render};
use crate::source;
use crate::source::OpenOptions;
use crate::volume::Octree;
use crate::{Error, Result};

/// The texel of a scene, measured.
#[derive(Debug, Clone, Serialize)]
pub struct Texel {
    pub scene: &'static str,
    pub resolution: u32,
    /// Its two finest depths, coarser first; none for a scene that shares its texel with one before.
    pub depths: Vec<DepthError>,
    /// Mean luminance of the picture, its sides halved again and again, over the one before, less 1.
    pub steps: Vec<f64>,
}

/// Bytes of the source's facets.
const FACETS: u64 = 2 << 30;
/// Pictures of a zoom.
const ZOOM: u32 = 4;

impl Bench<'_> {
    /// Measure the texel of a scene; its depths only where `depths` is wanted.
    pub fn texel(&self, place: &Place, depths: bool) -> Result<Texel> {
        let source = self.source(place)?;
        let made = self.made(place, &source, Recipe::plain(place.resolution))?;
        let depths = if depths {
            let tree = Octree::new(Reader::open(&made.texel, &Limits { decoded_bytes: u64::MAX })?)?;
            let source = source::open(&source, &OpenOptions::default())?;
            let [pixels, most] = if self.quick { [8, 256] } else { [24, 1024] };
            let options = Measure { pixels, rays: [64, most], turned: true, depths: 2, ..Measure::default() };
            let found = error::against(&tree, &*source, &options, FACETS, &Ui::new(true, false))?;
            tree.into_failure().map_or(Ok(found), Err)?
        } else {
            Vec::new()
        };
        Ok(Texel { scene: place.name, resolution: place.resolution, depths, steps: self.steps(place, &made)? })
    }

    /// Voxels alone, so that nothing but their depth changes.
    fn steps(&self, place: &Place, made: &Made) -> Result<Vec<f64>> {
        let options = self.options(&place.layout, made)?;
        let least = if matches!(place.layout, Layout::Alone) { 16 } else { 45 };
        let mut bright: Vec<f64> = Vec::new();
        for k in 0..ZOOM {
            let size = options.size.map(|n| n >> k);
            if size[1] < least {
                break;
            }
            let options = Options { size, lanes: 16, source_lod: SourceLod::Voxels, ..options.clone() };
            let film = render(&made.scene, &options, &Quiet)?.film;
            let luminance = |p: &[f32; 4]| f64::from(0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2]);
            let sky = options.background.map_or(0.0, |b| 0.2126 * b[0] + 0.7152 * b[1] + 0.0722 * b[2]);
            // Over what is seen: light of the matter alone.
            let cover = film.pixels.iter().map(|p| f64::from(p[3])).sum::<f64>();
            let light = film.pixels.iter().map(|p| luminance(p) - (1.0 - f64::from(p[3])) * sky).sum::<f64>();
            if cover.is_nan() || cover <= 0.0 {
                return Err(Error::input(&made.path, "", "shows nothing"));
            }
            bright.push(light / cover);
        }
        Ok(bright.windows(2).map(|w| w[1] / w[0] - 1.0).collect())
    }
}

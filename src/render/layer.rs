//! A layer of a shell, ready for rays: the texels that its cells may hold, and what varies them.

use super::jitter::JitterNoise;
use crate::geom::{Aabb, DVec3, Vec3};
use crate::scene::cycle::Cycle;
use crate::scene::shell::Layer;
use crate::volume::Info;
use crate::{Error, Result};

/// A layer, ready for rays.
#[derive(Debug, Clone)]
pub struct TexelLayer {
    pub layer: Layer,
    /// Texels that the hash chooses from; at least one.
    pub choices: Vec<TexelChoice>,
    /// Noise that bends its coordinates.
    pub jitter: Option<JitterNoise>,
    /// Number of cells by which a copy may reach beyond its own, along each axis.
    pub reach: [i64; 3],
    /// Number of groups of layers that this one is composited over, see [`Layer::over`].
    pub rank: u32,
}

/// A texel that a cell may hold.
#[derive(Debug, Clone)]
pub struct TexelChoice {
    /// Index into the scene's texels.
    pub texel: usize,
    /// Number of the texel's frames, which follow `texel` in the scene's list, and the rule by which a cell shows one of them.
    pub frames: u32,
    pub cycle: Option<Cycle>,
    /// Cumulative probability of this choice and the earlier ones, rising to 1.
    pub cumulative: f64,
    /// The box of its content, texel space.
    pub content: Aabb,
    /// Multiplies its albedo.
    pub tint: Vec3,
    /// Number of its Phong parameters in the scene's [`super::phong::PhongTable`].
    pub phong: u32,
}

impl TexelChoice {
    /// The scene's first texel, still and in its own colours, whose content fills `content`.
    #[cfg(test)]
    pub fn plain(content: Aabb) -> TexelChoice {
        TexelChoice { texel: 0, frames: 1, cycle: None, cumulative: 1.0, content, tint: Vec3::ONE, phong: 0 }
    }

    /// Index of the texel that `cell` shows: of an animated one, the frame of the moment.
    pub fn texel_of(&self, cell: [i64; 3]) -> usize {
        let Some(cycle) = self.cycle.filter(|_| self.frames > 1) else { return self.texel };
        let hash = Cycle::cell_hash(cell);
        let place = DVec3::new(cell[0] as f64, cell[1] as f64, cell[2] as f64);
        self.texel + cycle.frame(self.frames, cycle.phase_of(hash, place), hash) as usize
    }
}

/// What the frames of a texel have in common.
pub struct TexelFrames<'a> {
    /// Head of the first frame's file.
    pub info: &'a Info,
    /// Bounding box of all frames' contents, texel space.
    pub content: Aabb,
}

/// The `frames` of a texel, from `first` on; `None` where one of them is not open.
///
/// # Errors
/// [`Error::Options`] where they do not cover the same box: an animation would jump.
pub fn texel_frames<'i>(
    first: usize,
    frames: u32,
    info: impl Fn(usize) -> Option<&'i Info>,
) -> Result<Option<TexelFrames<'i>>> {
    let Some(own) = info(first) else { return Ok(None) };
    let mut content = own.content;
    for k in 1..frames as usize {
        let Some(next) = info(first + k) else { return Ok(None) };
        if next.bounds != own.bounds || next.up != own.up {
            return Err(Error::Options(format!(
                "frame {k} of a texel covers another box than frame 0; bake them together, as frames"
            )));
        }
        content = content.union(next.content);
    }
    Ok(Some(TexelFrames { info: own, content }))
}

impl TexelLayer {
    /// `choices`: at least one.
    pub fn new(layer: Layer, choices: Vec<TexelChoice>) -> TexelLayer {
        let jitter = layer.continuous.as_ref().map(JitterNoise::new);
        let mut made = TexelLayer { layer, choices, jitter, reach: [0; 3], rank: 0 };
        made.reach = made.reach();
        made
    }
}

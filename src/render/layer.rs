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
    /// Texels that the hash chooses from, at least one.
    pub choices: Vec<TexelChoice>,
    /// Noise that bends its coordinates.
    pub jitter: Option<JitterNoise>,
    /// Cells that a copy reaches beyond its own, along each axis.
    pub reach: [i64; 3],
    /// How many layers' groups of the shell it lies over, see [`Layer::over`].
    pub rank: u32,
}

/// A texel that a cell may hold.
#[derive(Debug, Clone)]
pub struct TexelChoice {
    /// Index into the scene's texels.
    pub texel: usize,
    /// Frames of the texel, in a row from `texel` on, and which of them a cell shows.
    pub frames: u32,
    pub cycle: Option<Cycle>,
    /// The chance of this or an earlier one, rising to 1.
    pub cumulative: f64,
    /// The box of its content, texel space.
    pub content: Aabb,
    /// Multiplies its albedo.
    pub tint: Vec3,
    /// What else is made of its surfaces: a number of the scene's [`super::phong::PhongTable`].
    pub phong: u32,
}

impl TexelChoice {
    /// The scene's first texel, still and in its own colours, whose content fills `content`.
    #[cfg(test)]
    pub fn plain(content: Aabb) -> TexelChoice {
        TexelChoice { texel: 0, frames: 1, cycle: None, cumulative: 1.0, content, tint: Vec3::ONE, phong: 0 }
    }

    /// The texel that `cell` shows: of one that has frames, one of them.
    pub fn shown(&self, cell: [i64; 3]) -> usize {
        let Some(cycle) = self.cycle.filter(|_| self.frames > 1) else { return self.texel };
        let lot = Cycle::lot(cell);
        let place = DVec3::new(cell[0] as f64, cell[1] as f64, cell[2] as f64);
        self.texel + cycle.frame(self.frames, cycle.ahead(lot, place), lot) as usize
    }
}

/// The frames of a texel together.
pub struct Row<'a> {
    /// What the first says.
    pub info: &'a Info,
    /// The box of all their contents.
    pub content: Aabb,
}

/// The `frames` of a texel, `first` and those behind it; `None` where one of them is not open.
///
/// # Errors
/// [`Error::Options`] where they do not cover one box: what stands in it would jump.
pub fn row<'i>(first: usize, frames: u32, info: impl Fn(usize) -> Option<&'i Info>) -> Result<Option<Row<'i>>> {
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
    Ok(Some(Row { info: own, content }))
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

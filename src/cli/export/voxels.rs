//! The voxels of one depth, each with its place in the copy's own space: what every exporter begins with.

use glam::{DAffine3, DVec3};

use crate::format::Reader;
use crate::morton;
use crate::scene::copies::to_texel;
use crate::volume::octree::PAGE;
use crate::volume::{Pages, Sggx, Voxel};
use crate::{Error, Result};

/// Matter of one depth, or a coarser node that stands for all of its cells.
pub struct Cell {
    /// Low corner in the cube, in edges of a voxel of the depth that was asked for.
    pub corner: [u32; 3],
    /// Edge, in the same unit: 1, or more where a coarser node is the finest there is.
    pub edge: u32,
    pub voxel: Voxel,
}

impl Cell {
    /// The box of its matter in the unit cube; `resolution` voxels are along the cube.
    pub fn support(&self, resolution: u32) -> (DVec3, DVec3) {
        let edge = f64::from(self.edge) / f64::from(resolution);
        let corner = DVec3::from(self.corner.map(f64::from)) / f64::from(resolution);
        let (low, high) = self.voxel.support_box();
        (corner + low.as_dvec3() * edge, corner + high.as_dvec3() * edge)
    }

    /// Share of the light that it takes in the mean over the three axes, in [0, 1].
    pub fn opacity(&self) -> f64 {
        let rate = f64::from(crate::volume::voxel::decode_rate(self.voxel.rate));
        let shape = Sggx::decode(self.voxel.ndf);
        let (low, high) = self.voxel.support_box();
        let along = |k: usize, area: f32| {
            let deep = f64::from((high - low)[k]);
            1.0 - libm::exp(-rate * f64::from(area.max(0.0).sqrt()) * deep)
        };
        (along(0, shape.xx) + along(1, shape.yy) + along(2, shape.zz)) / 3.0
    }
}

/// One depth of a texel.
pub struct Voxels {
    /// Voxels along the cube's edge.
    pub resolution: u32,
    pub cells: Vec<Cell>,
    /// The unit cube → the copy's own space: metres, +Y up, the source's origin at 0.
    pub to_own: DAffine3,
}

/// The cells of `depth`, or of the finest depth if the texel has no such depth, in Morton order. At most `most` of them.
///
/// # Errors
/// [`Error::Limit`] where there are more, or what the reader finds.
pub fn of(reader: &Reader, depth: usize, most: usize) -> Result<Voxels> {
    let counts = reader.counts();
    let depth = depth.min(counts.len().saturating_sub(1));
    let mut cells = Vec::new();
    let mut nodes = if counts.first().is_some_and(|n| *n > 0) { vec![0u64] } else { Vec::new() };
    for d in 0..=depth {
        let masks = if d < depth { reader.masks(d)? } else { Vec::new() };
        let mut page = Vec::new();
        let mut next = Vec::new();
        for (rank, &code) in nodes.iter().enumerate() {
            if rank % PAGE == 0 {
                page = reader.voxels(d, rank / PAGE)?;
            }
            let mask = masks.get(rank).copied().unwrap_or(0);
            next.extend((0..8).filter(|child| mask >> child & 1 == 1).map(|child| code << 3 | child));
            let shown = page.get(rank % PAGE).filter(|voxel| mask == 0 && voxel.rate > 0);
            if let Some(&voxel) = shown {
                let edge = 1 << (depth - d);
                cells.push(Cell { corner: morton::decode(code).map(|x| x * edge), edge, voxel });
            }
        }
        if cells.len() + next.len() > most {
            return Err(Error::Limit {
                what: format!("the number of voxels at depth {depth} (--depth takes a coarser one)"),
                needed: (cells.len() + next.len()) as u64,
                allowed: most as u64,
            });
        }
        nodes = next;
    }
    cells.sort_by_key(|cell| morton::encode(cell.corner));
    Ok(Voxels { resolution: 1 << depth, cells, to_own: to_texel(&reader.head().info).inverse() })
}

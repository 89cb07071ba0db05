//! The matter of one depth as a plain list, for exports to programs that have no octrees.

use super::octree::PAGE;
use super::voxel::decode_rate;
use super::{Mix, Pages, Sggx, Voxel};
use crate::geom::DVec3;
use crate::{Error, Result, morton};

/// Matter of one depth, or a coarser node that stands for all of its cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    /// Lower corner along (u, v, w), in edges of a voxel of the depth that was asked for.
    pub corner: [u32; 3],
    /// Edge, in the same unit: 1, or a larger power of two for a terminal node of a coarser depth.
    pub edge: u32,
    /// Voxel of the cell. Its rate is in hits per edge of the cell, however large that is.
    pub voxel: Voxel,
    /// Shares of the texel's materials.
    pub mix: Mix,
}

impl Cell {
    /// Support box in the unit cube, lower and upper corner, where `resolution` is the number of voxels along the cube's edge.
    pub fn support(&self, resolution: u32) -> (DVec3, DVec3) {
        let edge = f64::from(self.edge) / f64::from(resolution);
        let corner = DVec3::from_array(self.corner.map(f64::from)) / f64::from(resolution);
        let (low, high) = self.voxel.support_box();
        (corner + low.as_dvec3() * edge, corner + high.as_dvec3() * edge)
    }

    /// Opacity of the support box, averaged over the three coordinate axes, in [0, 1]; matter is taken to be uncorrelated.
    pub fn opacity(&self) -> f64 {
        let rate = f64::from(decode_rate(self.voxel.rate));
        let shape = Sggx::decode(self.voxel.ndf);
        let (low, high) = self.voxel.support_box();
        let along = |k: usize, area: f32| {
            let deep = f64::from((high - low)[k]);
            1.0 - libm::exp(-rate * f64::from(area.max(0.0).sqrt()) * deep)
        };
        (along(0, shape.xx) + along(1, shape.yy) + along(2, shape.zz)) / 3.0
    }
}

/// Cells of `depth` that hold matter, in Morton order of their corners; those of the finest depth if the texel has no such depth.
///
/// # Errors
/// [`Error::Limit`] where there are more than `most`, and what reading `pages` gives.
pub fn cells(pages: &(impl Pages + ?Sized), depth: usize, most: usize) -> Result<Vec<Cell>> {
    let counts = pages.counts();
    let depth = depth.min(counts.len().saturating_sub(1));
    let mut cells = Vec::new();
    let mut nodes = if counts.first().is_some_and(|n| *n > 0) { vec![0u64] } else { Vec::new() };
    for d in 0..=depth {
        let masks = if d < depth { pages.masks(d)? } else { Vec::new() };
        let (mut voxels, mut mixes) = (Vec::new(), Vec::new());
        let mut next = Vec::new();
        for (rank, &code) in nodes.iter().enumerate() {
            if rank % PAGE == 0 {
                voxels = pages.voxels(d, rank / PAGE)?;
                mixes = pages.mixes(d, rank / PAGE)?;
            }
            let mask = masks.get(rank).copied().unwrap_or(0);
            next.extend((0..8).filter(|child| mask >> child & 1 == 1).map(|child| code << 3 | child));
            let shown = voxels.get(rank % PAGE).filter(|voxel| mask == 0 && voxel.rate > 0);
            if let Some(&voxel) = shown {
                let edge = 1 << (depth - d);
                let mix = mixes.get(rank % PAGE).copied().unwrap_or_default();
                cells.push(Cell { corner: morton::decode(code).map(|x| x * edge), edge, voxel, mix });
            }
        }
        if cells.len() + next.len() > most {
            return Err(Error::Limit {
                what: format!("the number of voxels at depth {depth} (option `depth`: a coarser one has fewer)"),
                needed: (cells.len() + next.len()) as u64,
                allowed: most as u64,
            });
        }
        nodes = next;
    }
    cells.sort_by_key(|cell| morton::encode(cell.corner));
    Ok(cells)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::{Depth, Info, Volume};

    /// A root with children 1 and 6; child 1 is terminal, child 6 has the grandchild 3, and another without matter.
    fn volume() -> Volume {
        let voxel = |rate| Voxel { rate, ..Voxel::default() };
        let depth = |masks: &[u8], rates: &[u8]| Depth {
            masks: masks.to_vec(),
            voxels: rates.iter().map(|r| voxel(*r)).collect(),
            mixes: Vec::new(),
        };
        let depths =
            vec![depth(&[0b0100_0010], &[200]), depth(&[0, 0b1000_1000], &[150, 160]), depth(&[0, 0], &[170, 0])];
        Volume { info: Info::default(), depths }
    }

    #[test]
    fn coarser_nodes_stand_for_their_cells() {
        let seen = |depth| -> Vec<_> {
            let all = cells(&volume(), depth, 9).unwrap();
            all.iter().map(|c| (c.corner, c.edge, c.voxel.rate)).collect()
        };
        assert_eq!(seen(0), [([0, 0, 0], 1, 200)]);
        assert_eq!(seen(1), [([1, 0, 0], 1, 150), ([0, 1, 1], 1, 160)]);
        assert_eq!(seen(2), [([2, 0, 0], 2, 150), ([1, 3, 2], 1, 170)]);
        assert_eq!(seen(9), seen(2), "no such depth: the finest");
    }

    #[test]
    fn more_than_the_most_are_refused() {
        assert!(matches!(cells(&volume(), 2, 1), Err(Error::Limit { needed: 2, allowed: 1, .. })));
    }

    #[test]
    fn nothing_has_no_cells() {
        assert!(cells(&Volume { info: Info::default(), depths: vec![] }, 3, 9).unwrap().is_empty());
    }
}

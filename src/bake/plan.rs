//! Where a source lies in the bake's grid.

use super::options::{MAX_RESOLUTION, Options};
use crate::error::short;
use crate::geom::{Aabb, DAffine3, DVec3};
use crate::source::Placement;
use crate::{Error, Result};

/// Margin of the cube around the source, relative, so that no matter lies on its upper faces.
const MARGIN: f64 = 1.0 / (1u32 << 20) as f64;

/// Largest number of bytes that staging a source may take where the options set no limit, so that a small file with a million copies
/// of its content cannot fill the machine's memory.
const LAY_OUT_MEMORY: u64 = 8 << 30;

/// Place a source of these `bounds` in the grid: centred across, and standing on w = 0.
///
/// # Errors
/// [`Error::Options`] on a resolution, voxel size or bounds out of range.
pub fn plan(bounds: Aabb, options: &Options) -> Result<Placement> {
    if options.resolution == 0 || options.resolution > MAX_RESOLUTION {
        return Err(Error::Options(format!(
            "a resolution of {} is out of range: it is 1 to {MAX_RESOLUTION}",
            options.resolution
        )));
    }
    let extent = extent(bounds, options);
    // The cube is larger than the source. A cube beyond the largest number would be noticed only when the texel is written.
    let reach = extent + bounds.min.abs().max(bounds.max.abs()).max_element();
    if !bounds.is_empty() && !(2.0 * reach).is_finite() {
        return Err(Error::Options("the source is too large: its bounds reach beyond 1e307".into()));
    }
    let side = match options.voxel_size {
        Some(edge) => side_for_voxel_size(extent, edge, options)?,
        None => options.resolution.next_power_of_two(),
    };
    if let Some(cube) = options.cube {
        return Ok(placement(cube, cube.size().x, options.resolution.next_power_of_two(), options));
    }
    let edge = options.voxel_size.unwrap_or(extent / f64::from(side)) * f64::from(side);
    let base = if bounds.is_empty() { Aabb::new(DVec3::ZERO, DVec3::ONE) } else { bounds };
    let mut min = base.centre() - 0.5 * edge;
    min[usize::from(options.up)] = base.min[usize::from(options.up)];
    Ok(placement(Aabb::new(min, min + edge), edge, side, options))
}

/// Depth at which the matter of texels with few voxels is measured: the facets' sums in a voxel as large as the source, or half as
/// large, say too little about its shape.
const MIN_MEASURED_DEPTH: usize = 4;
/// Texels of this depth and finer ones are measured at their own depth.
const MEASURED_AS_IS: usize = 3;

/// Grid in which the matter of a texel is measured: `place` itself, or 16³ voxels in the same cube where `place` has 4³ or fewer.
pub fn measured_grid(place: &Placement) -> Placement {
    if place.depth >= MEASURED_AS_IS {
        return *place;
    }
    let finer = f64::from(1u32 << (MIN_MEASURED_DEPTH - place.depth));
    Placement { depth: MIN_MEASURED_DEPTH, scale: place.scale * finer, ..*place }
}

/// Grid of `side` voxels along the edges of `cube`, which are `edge` long.
fn placement(cube: Aabb, edge: f64, side: u32, options: &Options) -> Placement {
    Placement {
        bounds: cube,
        transform: DAffine3::IDENTITY,
        scale: f64::from(side) / edge,
        depth: side.trailing_zeros() as usize,
        up: options.up,
        cyclic: options.cyclic,
        memory: if options.memory == 0 { LAY_OUT_MEMORY } else { options.memory },
    }
}

/// Edge of the cube that the source needs, in source units. Where the voxel size is given, cyclic axes do not count, since what
/// reaches beyond the cube along them comes in again on the other side.
fn extent(bounds: Aabb, options: &Options) -> f64 {
    let size = if bounds.is_empty() { DVec3::ONE } else { bounds.size() };
    // The texel's u runs along the source's x; v and w along z and y, or y and z.
    let is_cyclic = |axis: usize| match axis {
        0 => options.cyclic[0],
        a if a == usize::from(options.up) => options.cyclic[2],
        _ => options.cyclic[1],
    };
    let counts = |&axis: &usize| options.voxel_size.is_none() || !is_cyclic(axis);
    let needed = (0..3).filter(counts).map(|a| size[a]).fold(0.0, f64::max);
    let extent = needed * (1.0 + MARGIN);
    if extent > 0.0 { extent } else { 1.0 }
}

/// Number of voxels of the edge length `voxel_size` along a cube that holds `extent`, a power of two.
fn side_for_voxel_size(extent: f64, voxel_size: f64, options: &Options) -> Result<u32> {
    let want = (extent / voxel_size).ceil();
    if !(voxel_size > 0.0 && want <= f64::from(MAX_RESOLUTION)) {
        return Err(Error::Options(format!(
            "a voxel size of {} is out of range: it is {:.6} or more, for at most {MAX_RESOLUTION} voxels along \
             {extent:.6}",
            short(voxel_size),
            extent / f64::from(MAX_RESOLUTION)
        )));
    }
    let least = if options.cyclic == [false; 3] { 1 } else { options.resolution };
    Ok((want as u32).max(least).next_power_of_two())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_as_large_as_numbers_are_is_refused_at_once() {
        let across = |size: f64| Aabb::new(DVec3::ZERO, DVec3::new(1.0, 1.0, size));
        assert!(plan(across(1e300), &Options::default()).is_ok());
        for size in [1.08e308, f64::MAX, f64::INFINITY] {
            assert!(matches!(plan(across(size), &Options::default()), Err(Error::Options(_))), "{size}");
        }
    }
}

//! Any source → texel.
//!
//! A source gives its matter as planar convex facets; the bake cuts them exactly into voxels, measures coverage along 13
//! axes at every depth, and fits each voxel's directional rate, correlation and colour.

mod beams;
mod chord;
mod clip;
mod ellipsoid;
mod fit;
mod measure;
pub mod mesh;
mod mtl;
pub mod obj;
mod polygon;
mod source;
mod tree;

pub use clip::{MAX_CORNERS, Polygon};
pub use mesh::MeshSource;
pub use source::{Placement, Source, Staged, Surface};

use crate::geom::{Aabb, DVec3};
use crate::progress::Progress;
use crate::volume::{Channels, Depth, Info, Model, Volume};
use crate::{Error, Result, Warnings, morton, par};
use tree::{Node, Output, Region};

/// Largest resolution that may be asked for.
pub const MAX_RESOLUTION: u32 = 4096;

/// What is to be baked of a source.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Voxels along the cube's edge, 1 … 4096; rounded up to a power of two.
    pub resolution: u32,
    /// Edge of the finest voxel in source units; overrides `resolution`.
    pub voxel_size: Option<f64>,
    pub model: Model,
    /// Axes u, v, w along which the texel is to match itself.
    pub cyclic: [bool; 3],
    /// Source axis that becomes w: 1 (+Y) or 2 (+Z).
    pub up: u8,
}

impl Default for Options {
    fn default() -> Self {
        Options { resolution: 512, voxel_size: None, model: Model::Coverage, cyclic: [false; 3], up: 1 }
    }
}

/// What the bake says besides the volume.
#[derive(Debug, Clone, Default)]
pub struct Report {
    pub warnings: Warnings,
    /// Voxels at each depth, root first.
    pub voxels: Vec<u64>,
}

/// Bake `source`. Fails with [`Error::Options`] on options out of range.
pub fn bake(source: &dyn Source, options: &Options, progress: &dyn Progress) -> Result<(Volume, Report)> {
    let place = plan(source.bounds(), options)?;
    let mut report = Report { warnings: source.warnings().clone(), ..Report::default() };
    let staged = source.stage(&place, progress)?;
    let (depths, content) = build(&*staged, &place, options, progress);
    report.voxels = depths.iter().map(|d| d.voxels.len() as u64).collect();
    let info = Info {
        bounds: place.bounds,
        metres_per_unit: source.metres_per_unit(),
        up: place.up,
        cyclic: options.cyclic,
        model: options.model,
        content,
        facet_size: source.facet_size() * place.scale / f64::from(place.side()),
        channels: Channels {
            correlation: options.model == Model::Coverage,
            support: options.model == Model::Coverage,
            albedo: source.has_colour(),
            mean_normal: depths.iter().flat_map(|d| &d.voxels).any(|v| v.one_sidedness() > 0.0),
        },
        meta: Default::default(),
    };
    Ok((Volume { info, depths }, report))
}

/// Where a source of `bounds` lies in the grid.
fn plan(bounds: Aabb, options: &Options) -> Result<Placement> {
    if options.resolution == 0 || options.resolution > MAX_RESOLUTION {
        return Err(Error::Options(format!("-r {}: the resolution is 1 to {MAX_RESOLUTION}", options.resolution)));
    }
    let mut place = Placement { bounds: Aabb::UNIT, scale: 1.0, depth: 0, up: options.up };
    let size = if bounds.is_empty() { DVec3::ONE } else { bounds.size() };
    let extent = size.max_element() * (1.0 + 1.0 / f64::from(1 << 20));
    let extent = if extent > 0.0 { extent } else { 1.0 };
    let side = match options.voxel_size {
        Some(edge) => {
            let want = (extent / edge).ceil();
            if !(edge > 0.0 && want <= f64::from(MAX_RESOLUTION)) {
                return Err(Error::Options(format!(
                    "--voxel-size {edge}: from {:.6} on, for at most {MAX_RESOLUTION} voxels along {extent:.6}",
                    extent / f64::from(MAX_RESOLUTION)
                )));
            }
            (want as u32).next_power_of_two()
        }
        None => options.resolution.next_power_of_two(),
    };
    let edge = options.voxel_size.unwrap_or(extent / f64::from(side)) * f64::from(side);
    // Centred across, standing on w = 0.
    let base = if bounds.is_empty() { Aabb::new(DVec3::ZERO, DVec3::ONE) } else { bounds };
    let mut min = base.centre() - 0.5 * edge;
    min[usize::from(options.up)] = base.min[usize::from(options.up)];
    place.bounds = Aabb::new(min, min + edge);
    place.scale = f64::from(side) / edge;
    place.depth = side.trailing_zeros() as usize;
    Ok(place)
}

/// All depths, and the content's box in the unit cube.
fn build(staged: &dyn Staged, place: &Placement, options: &Options, progress: &dyn Progress) -> (Vec<Depth>, Aabb) {
    let regions = staged.regions();
    let levels = place.region_log2();
    let top = place.depth - levels;
    progress.stage("measure", regions.len() as u64);
    let empty = || Output::new(place.depth + 1, options.model);
    let parts: Vec<(Option<Box<Node>>, Output)> = par::map(regions.len(), |i| {
        let origin = morton::decode(regions[i]).map(|v| v << levels);
        let corner = DVec3::from(origin.map(f64::from));
        let mut facets = Vec::new();
        staged.emit(i, &mut facets);
        let reach = corner + f64::from(1u32 << levels);
        let facets: Vec<Polygon> = facets.iter().filter_map(|f| f.clip(corner, reach)).collect();
        let mut region = Region::new(staged, None, empty());
        let node = region.node(top, levels, origin, &facets);
        progress.advance(1);
        (node, region.output)
    });
    let mut output = empty();
    let mut nodes = Vec::with_capacity(parts.len());
    for (&code, (node, part)) in regions.iter().zip(parts) {
        output.append(part);
        nodes.extend(node.map(|n| (code, n)));
    }
    let mut upper = empty();
    let root = tree::join_up(top, nodes, &mut upper);
    // Depths that joining fitted come from above the regions alone, so order does not matter here.
    output.append(upper);
    match root {
        Some(root) => (output.depths, Aabb::new(root.lo, root.hi)),
        None => (Vec::new(), Aabb::EMPTY),
    }
}

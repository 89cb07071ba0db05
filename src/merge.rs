//! Texels in one grid: merged, tiled, cut, and at another resolution; where a voxel of one input lies in the grid as it was,
//! and nothing else is there, it is kept byte for byte.

use crate::bake::{Options, Report, calibrate, measure_and_fit};
use crate::geom::{Aabb, DAffine3, DMat3, DVec3};
use crate::progress::Progress;
use crate::source::Source;
use crate::source::field::{Block, FieldSource};
use crate::source::group::{GroupSource, Part};
use crate::source::layers::{LayersSource, Mode};
use crate::source::materials::{UNNAMED, renamed};
use crate::source::texel::{TexelSource, codes, own_grid, snapped};
use crate::volume::level::{self, Level};
use crate::volume::{MAX_DEPTH, Volume};
use crate::{Error, Result, Warnings, morton};

/// What is to be made of texels.
#[derive(Debug, Clone, Default)]
pub struct MergeOptions {
    /// Where each input is placed: the space of its bounds → the result's. What is missing is not moved.
    pub transforms: Vec<DAffine3>,
    /// Voxels along the result's cube; by default the finest input's voxels are kept.
    pub resolution: Option<u32>,
    /// Only what is in this box of the result's space.
    pub crop: Option<Aabb>,
    /// Copies side by side along u, v and w.
    pub tile: [u32; 3],
    /// Bytes that the work may take; 0: any.
    pub memory: u64,
}

/// Most copies by tiling.
const MAX_TILES: u64 = 1 << 12;

/// One texel of `inputs`.
///
/// # Errors
/// [`Error::Options`] where the inputs' axes differ or options are out of range, and what [`bake`] gives.
pub fn merge(
    inputs: Vec<(Volume, Warnings)>,
    options: &MergeOptions,
    progress: &dyn Progress,
) -> Result<(Volume, Report)> {
    let Some(first) = inputs.first().map(|(v, _)| v.info.clone()) else {
        return Err(Error::Options("there is no texel to merge".into()));
    };
    if inputs.iter().any(|(v, _)| v.info.up != first.up || v.info.model != first.model) {
        return Err(Error::Options("texels of different up axes or models cannot be merged: bake them alike".into()));
    }
    let tiles = options.tile.map(|n| n.max(1));
    let count = tiles.iter().map(|&n| u64::from(n)).product::<u64>();
    if count > MAX_TILES {
        return Err(Error::Limit { what: "the number of tiles".into(), needed: count, allowed: MAX_TILES });
    }
    let placed: Vec<DAffine3> =
        (0..inputs.len()).map(|i| options.transforms.get(i).copied().unwrap_or(DAffine3::IDENTITY)).collect();
    let edge = |v: &Volume, t: &DAffine3| {
        v.info.bounds.size().x / f64::from(v.resolution()) * libm::cbrt(t.matrix3.determinant().abs())
    };
    let voxel = inputs.iter().zip(&placed).map(|((v, _), t)| edge(v, t)).fold(f64::INFINITY, f64::min);
    // The axes of the source along which u, v and w run, and a tile's width.
    let side = first.bounds.size();
    let axes = if first.up == 1 { [DVec3::X, DVec3::NEG_Z, DVec3::Y] } else { [DVec3::X, DVec3::Y, DVec3::Z] };
    let mut steps = Vec::new();
    for k in 0..tiles[2] {
        for j in 0..tiles[1] {
            for i in 0..tiles[0] {
                let n = [i, j, k].map(f64::from);
                steps.push((0..3).map(|a| n[a] * axes[a] * side).sum::<DVec3>());
            }
        }
    }
    let volumes: Vec<Volume> = inputs.iter().map(|(v, _)| v.clone()).collect();
    let mut parts = Vec::new();
    for (source, transform) in placed.iter().enumerate() {
        let step = |s: &DVec3| Part { source, transform: DAffine3::from_translation(*s) * *transform };
        parts.extend(steps.iter().map(step));
    }
    let sources = inputs.into_iter().map(|(v, w)| Box::new(TexelSource::new(v, w)) as Box<dyn Source>).collect();
    let mut source: Box<dyn Source> = Box::new(GroupSource::new(sources, &parts, first.metres_per_unit));
    if let Some(crop) = options.crop {
        let block = FieldSource::new(Box::new(Block { min: crop.min, max: crop.max, round: 0.0 }), None)?;
        source = Box::new(LayersSource::new(
            vec![(Mode::Add, source), (Mode::Multiply, Box::new(block))],
            first.metres_per_unit,
        ));
    }
    let cube = match options.resolution {
        // The first input's own cube, where all fits into it; else one of the same voxels that holds all.
        None => Some(grid(source.bounds(), first.bounds, voxel)?),
        Some(_) => None,
    };
    let whole = tiles == [1; 3] && options.crop.is_none();
    let bake_options = Options {
        resolution: match (cube, options.resolution) {
            (Some((_, side)), _) => side,
            (None, Some(r)) => r,
            (None, None) => 1,
        },
        cube: cube.map(|c| c.0),
        model: first.model,
        cyclic: if whole { first.cyclic } else { [false; 3] },
        up: first.up,
        memory: options.memory,
        refine: 0,
        voxel_size: None,
        ..Options::default()
    };
    let (mut volume, report) = measure_and_fit(&*source, &bake_options, progress, &mut |_| {})?;
    if options.crop.is_none() {
        keep(&mut volume, &volumes, &parts);
    }
    let finest = inherited(&volume, &volumes, &parts);
    Ok((calibrate(volume, finest)?, report))
}

/// The brightness factor of the result's finest depth: the mean of the factors that the parts have at the depths whose voxels
/// are nearest in size, weighted by how many voxels those have.
fn inherited(volume: &Volume, inputs: &[Volume], parts: &[Part]) -> Level {
    let edge = volume.info.bounds.size().x / f64::from(volume.resolution());
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for part in parts {
        let input = &inputs[part.source];
        let own = input.info.bounds.size().x * libm::cbrt(part.transform.matrix3.determinant().abs());
        let depth = libm::log2(own / edge).round().clamp(0.0, input.depths.len().saturating_sub(1) as f64) as usize;
        let Some(weight) = input.depths.get(depth).map(|d| d.voxels.len() as f64) else { continue };
        let factor = level::levels(&input.info)[depth.min(MAX_DEPTH)];
        sum.iter_mut().zip(factor.light).for_each(|(s, f)| *s += weight * f64::from(f));
        weights += weight;
    }
    if weights > 0.0 { Level::new(sum.map(|s| s / weights)) } else { Level::PLAIN }
}

/// A cube on the lattice of `first`'s voxels, a power of two of them wide, that holds `extent`; and how many.
fn grid(extent: Aabb, first: Aabb, voxel: f64) -> Result<(Aabb, u32)> {
    let all = if extent.is_empty() { first } else { extent };
    let lattice = |v: DVec3| (v - first.min) / voxel;
    // What reaches beyond by roundings does not count.
    let (lo, hi) = ((lattice(all.min) + 1e-6).floor(), (lattice(all.max) - 1e-6).ceil());
    let own = (first.size().x / voxel).round();
    let fits = lo.min_element() >= 0.0 && hi.max_element() <= own && (own as u64).is_power_of_two();
    let (lo, side) = if fits { (DVec3::ZERO, own) } else { (lo, (hi - lo).max_element().max(1.0)) };
    if side.is_nan() || side > f64::from(crate::bake::MAX_RESOLUTION) {
        return Err(Error::Options(format!(
            "{side:.0} voxels of {voxel:.6} a side would be needed, at most {} are made: give -r",
            crate::bake::MAX_RESOLUTION
        )));
    }
    let side = (side as u32).next_power_of_two();
    let min = first.min + lo * voxel;
    Ok((Aabb::new(min, min + voxel * f64::from(side)), side))
}

/// Put the inputs' own voxels where they lie in the grid as they were, and alone.
fn keep(volume: &mut Volume, inputs: &[Volume], parts: &[Part]) {
    let finest = volume.depths.len().saturating_sub(1);
    let nodes = codes(&volume.depths);
    // What an input's ids of materials have become.
    let id = |name: &str| volume.info.materials.iter().position(|m| m.name == name).unwrap_or(0) as u16;
    let named = |v: &Volume| match &v.info.materials[..] {
        [] => vec![id(UNNAMED)],
        own => own.iter().map(|m| id(&m.name)).collect(),
    };
    let ids: Vec<Vec<u16>> = inputs.iter().map(named).collect();
    let sets: Vec<Vec<Vec<u64>>> = inputs.iter().map(|v| codes(&v.depths)).collect();
    for (depth, nodes) in nodes.iter().enumerate() {
        let grid = own_grid(&volume.info, depth).grid_map();
        // Each part's depth of this size, and how far it is moved, in whole voxels.
        let place = |part: &Part| {
            let input = &inputs[part.source];
            let own = (input.depths.len() + depth).checked_sub(finest + 1)?;
            let map = snapped(grid * part.transform * own_grid(&input.info, own).grid_map().inverse());
            let shift = map.translation;
            (map.matrix3 == DMat3::IDENTITY && shift == shift.round()).then_some((part.source, own, shift))
        };
        let Some(placed) = parts.iter().map(place).collect::<Option<Vec<_>>>() else { continue };
        let level = &mut volume.depths[depth];
        for (n, (code, voxel)) in nodes.iter().zip(&mut level.voxels).enumerate() {
            let at = DVec3::from(morton::decode(*code).map(f64::from));
            let mut found = placed.iter().filter_map(|&(input, own, shift)| {
                let p = at - shift;
                let inner = p.min_element() >= 0.0 && p.max_element() < f64::from(1u32 << own);
                let code = morton::encode(p.max(DVec3::ZERO).as_uvec3().to_array());
                let i = sets[input][own].binary_search(&code).ok().filter(|_| inner)?;
                inputs[input].depths[own].voxels.get(i).map(|voxel| (input, own, i, voxel))
            });
            if let (Some((input, own, i, kept)), None) = (found.next(), found.next()) {
                *voxel = *kept;
                if let Some(mix) = level.mixes.get_mut(n) {
                    let own = inputs[input].depths[own].mixes.get(i).copied().unwrap_or_default();
                    *mix = renamed(&own, &ids[input]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::bake;
    use crate::progress::Quiet;
    use crate::source::field::Sphere;

    fn ball(centre: DVec3) -> (Volume, Warnings) {
        let source = FieldSource::new(Box::new(Sphere { centre, radius: 1.0 }), None).unwrap();
        let options = Options { resolution: 32, ..Options::default() };
        (bake(&source, &options, &Quiet, &mut |_| {}).unwrap().0, Warnings::default())
    }

    /// What the root covers along an axis, in source units.
    fn covered(v: &Volume) -> f64 {
        let root = &v.depths[0].voxels[0];
        let shape = crate::volume::Sggx::decode(root.ndf);
        let (lo, hi) = root.support_box();
        let e = (hi - lo).as_dvec3();
        let rate = crate::volume::voxel::rate_table()[usize::from(root.rate)] * shape.sigma(crate::geom::Vec3::X);
        let t = crate::volume::opacity::advance_f64(1.0, f64::from(rate) * e.x, root.c().into());
        (1.0 - t) * e.y * e.z * v.info.bounds.size().x.powi(2)
    }

    #[test]
    fn disjoint_texels_keep_their_voxels() {
        let (a, b) = (ball(DVec3::ZERO), ball(DVec3::new(4.0, 0.0, 0.0)));
        let both = merge(vec![a.clone(), b.clone()], &MergeOptions::default(), &Quiet).unwrap().0;
        assert_eq!(both.resolution(), 128);
        let sorted = |v: &[&Volume]| {
            let mut all: Vec<String> =
                v.iter().flat_map(|v| &v.depths.last().unwrap().voxels).map(|v| format!("{v:?}")).collect();
            all.sort_unstable();
            all
        };
        let (got, want) = (sorted(&[&both]), sorted(&[&a.0, &b.0]));
        assert_eq!(got.len(), want.len());
        assert!(got == want, "byte for byte");
    }

    #[test]
    fn a_texel_in_another_grid_covers_as_much() {
        let (a, w) = ball(DVec3::ZERO);
        for resolution in [16, 64] {
            let options = MergeOptions { resolution: Some(resolution), ..MergeOptions::default() };
            let other = merge(vec![(a.clone(), w.clone())], &options, &Quiet).unwrap().0;
            let share = covered(&other) / covered(&a);
            println!("{resolution}: {share}");
            // The silhouette's voxels, an eighth of the radius at 16 and a sixteenth at 64, become clouds as wide as they are:
            // measured .10 and .16, of which .025 is what the ball itself covers too much.
            assert!((share - 1.0).abs() < 0.18, "{resolution}: {share}");
        }
    }

    #[test]
    fn brightness_factors_are_kept() {
        let (a, w) = ball(DVec3::ZERO);
        let own = level::levels(&a.info);
        let again = merge(vec![(a.clone(), w.clone())], &MergeOptions::default(), &Quiet).unwrap().0;
        assert_eq!(level::levels(&again.info), own, "nothing was changed");
        // A depth that becomes the finest keeps the factor that it had against the depths below it, to a step of 1/256.
        let dimmed = Level::new([0.5, 0.75, 1.25]);
        let mut factors = own[..6].to_vec();
        factors[4] = dimmed;
        let mut other = a.clone();
        level::store(&factors, &mut other.info.meta);
        let options = MergeOptions { resolution: Some(16), ..MergeOptions::default() };
        let coarse = merge(vec![(other, w)], &options, &Quiet).unwrap().0;
        assert_eq!(level::levels(&coarse.info)[4], dimmed);
    }

    #[test]
    fn crops_and_tiles() {
        let a = ball(DVec3::ZERO);
        let tiled = MergeOptions { tile: [2, 1, 1], ..MergeOptions::default() };
        let two = merge(vec![a.clone()], &tiled, &Quiet).unwrap().0;
        assert_eq!(two.depths.last().unwrap().voxels.len(), 2 * a.0.depths.last().unwrap().voxels.len());
        let crop = Some(Aabb::new(DVec3::new(0.0, -1.0, -1.0), DVec3::ONE));
        let half = merge(vec![a.clone()], &MergeOptions { crop, ..MergeOptions::default() }, &Quiet).unwrap().0;
        let size = half.info.content.size() * half.info.bounds.size();
        // The content is told in sixteenths of the cube.
        assert!((size.x - 1.0).abs() < 0.2 && (size.y - 2.0).abs() < 0.2, "{size}");
        assert!(merge(Vec::new(), &MergeOptions::default(), &Quiet).is_err());
    }
}

//! Texels baked again into one grid: merged, tiled, cropped, and resampled.
//!
//! The inputs' voxels are sources of a bake like any others. A voxel that lies in the new grid as it lay in its own, and is alone
//! there, is kept byte for byte instead.

use crate::bake::{MAX_RESOLUTION, Options, Report, calibrate, measure_and_fit};
use crate::error::short;
use crate::geom::{Aabb, DAffine3, DMat3, DVec3};
use crate::progress::Progress;
use crate::source::Source;
use crate::source::field::{FieldSource, RoundedBox};
use crate::source::group::{GroupSource, Part};
use crate::source::layers::{LayersSource, Mode};
use crate::source::materials::{UNNAMED, renamed};
use crate::source::texel::{TexelSource, codes, own_grid, snapped};
use crate::volume::axes::source_to_uvw;
use crate::volume::brightness::{self, BrightnessFactors};
use crate::volume::surface::{self, SurfaceParams};
use crate::volume::{Info, MAX_DEPTH, Material, Volume};
use crate::{Error, Result, Warnings, morton};

/// Options of [`merge`].
#[derive(Debug, Clone, Default)]
pub struct MergeOptions {
    /// Placement of each input: from the space of its bounds to the result's, which has the unit of the first input. Inputs without
    /// one are placed by [`to_unit_of`].
    pub transforms: Vec<DAffine3>,
    /// Voxels along the result's cube; by default the finest input's voxel size is kept.
    pub resolution: Option<u32>,
    /// Box of the result's space to which the matter is cut.
    pub crop: Option<Aabb>,
    /// Number of copies side by side along u, v and w; 0 counts as 1.
    pub tile: [u32; 3],
    /// Most bytes of memory that the work may take; 0: no limit.
    pub memory: u64,
}

/// Most copies by tiling.
const MAX_TILES: u64 = 1 << 12;
/// Most voxels that a result may have whose resolution nobody asked for: some minutes of work.
const MAX_VOXELS: f64 = (1u64 << 27) as f64;
/// Distance, in voxels, by which matter may reach beyond a voxel's border and still count as within it: more than rounding errors.
const GRID_TOLERANCE: f64 = 1e-6;

/// The map from the unit of one texel to that of another; the identity where one of them is not known.
pub fn to_unit_of(info: &Info, other: &Info) -> DAffine3 {
    let scale = info.metres_per_unit / other.metres_per_unit;
    let is_known = scale.is_normal() && scale != 1.0;
    if is_known { DAffine3::from_scale(DVec3::splat(scale)) } else { DAffine3::IDENTITY }
}

/// One texel of `inputs`, each with the warnings that it was read with.
///
/// # Errors
/// [`Error::Options`] where the inputs' axes differ or options are out of range, and what [`bake`](crate::bake::bake) gives.
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
    let own = |(i, (volume, _)): (usize, &(Volume, Warnings))| {
        options.transforms.get(i).copied().unwrap_or_else(|| to_unit_of(&volume.info, &first))
    };
    let placed: Vec<DAffine3> = inputs.iter().enumerate().map(own).collect();
    let voxel = finest_voxel(&inputs, &placed);
    let offsets = tile_offsets(&first, options.tile)?;
    let volumes: Vec<Volume> = inputs.iter().map(|(v, _)| v.clone()).collect();
    let mut parts = Vec::new();
    for (source, transform) in placed.iter().enumerate() {
        let copy = |offset: &DVec3| Part { source, transform: DAffine3::from_translation(*offset) * *transform };
        parts.extend(offsets.iter().map(copy));
    }
    let sources = inputs.into_iter().map(|(v, w)| Box::new(TexelSource::new(v, w)) as Box<dyn Source>).collect();
    let mut source: Box<dyn Source> = Box::new(GroupSource::new(sources, &parts, first.metres_per_unit));
    if let Some(crop) = options.crop {
        source = cropped(source, crop, first.metres_per_unit)?;
    }
    let grid = match options.resolution {
        None => {
            let grid = result_grid(source.bounds(), first.bounds, voxel)?;
            check_work(&volumes, &placed, offsets.len(), grid.cube.size().x / f64::from(grid.side))?;
            Some(grid)
        }
        Some(_) => None,
    };
    let is_whole = offsets.len() == 1 && options.crop.is_none();
    let bake_options = Options {
        resolution: grid.as_ref().map(|g| g.side).or(options.resolution).unwrap_or(1),
        cube: grid.map(|g| g.cube),
        model: first.model,
        cyclic: if is_whole { first.cyclic } else { [false; 3] },
        up: first.up,
        memory: options.memory,
        refine: 0,
        voxel_size: None,
        ..Options::default()
    };
    let (mut volume, report) = measure_and_fit(&*source, &bake_options, progress, &mut |_| {})?;
    if options.crop.is_none() {
        keep_voxels(&mut volume, &volumes, &parts);
    }
    keep_materials(&mut volume, &volumes, &parts, options.crop.is_none());
    let finest = inherited_factors(&volume, &volumes, &parts);
    Ok((calibrate(volume, finest)?, report))
}

/// Give the materials the colours and properties that they have in the inputs. A voxel has one colour for all of its materials, so what
/// was measured of voxels is a mixture of those of its neighbours. Where a material is in several inputs, it gets the mean by visible area.
fn keep_materials(volume: &mut Volume, inputs: &[Volume], parts: &[Part], is_whole: bool) {
    let area = |part: &Part| {
        let input = &inputs[part.source];
        let voxels = input.depths.last().map_or(0, |depth| depth.voxels.len());
        voxels as f64 * voxel_edge(input, &part.transform).powi(2)
    };
    // Parts that show it: area, material and properties; nothing where an input does not know its colour.
    let shown = |name: &str| -> Option<Vec<(f64, Material, SurfaceParams)>> {
        let mut found = Vec::new();
        for part in parts {
            let info = &inputs[part.source].info;
            match info.materials.iter().position(|m| m.name == name) {
                Some(i) => {
                    let surface = surface::read(info).get(i).copied().unwrap_or_default();
                    found.push((area(part) * info.materials[i].share, info.materials[i].clone(), surface));
                }
                None if info.materials.is_empty() && name == UNNAMED => return None,
                None => {}
            }
        }
        (!found.is_empty()).then_some(found)
    };
    let measured = surface::read(&volume.info);
    let mut surfaces = Vec::new();
    let alone = parts.iter().all(|part| part.source == parts[0].source) && is_whole;
    for (i, material) in volume.info.materials.iter_mut().enumerate() {
        let Some(found) = shown(&material.name) else {
            surfaces.push(measured.get(i).copied().unwrap_or_default());
            continue;
        };
        let whole: f64 = found.iter().map(|(area, ..)| area).sum();
        let is_same = found.iter().all(|(_, m, s)| m.albedo == found[0].1.albedo && *s == found[0].2);
        if is_same || whole <= 0.0 {
            material.albedo = found[0].1.albedo;
            surfaces.push(found[0].2);
        } else {
            let mean = |get: &dyn Fn(&Material, &SurfaceParams) -> f64| {
                let mean = found.iter().map(|(area, m, s)| area * get(m, s)).sum::<f64>() / whole;
                (mean * 1e4).round() / 1e4
            };
            material.albedo = [0, 1, 2].map(|k| mean(&|m, _| m.albedo[k]));
            surfaces.push(SurfaceParams {
                transmission: [0, 1, 2].map(|k| mean(&|_, s| s.transmission[k])),
                unlit: mean(&|_, s| s.unlit),
                one_sided: mean(&|_, s| s.one_sided),
            });
        }
        if alone {
            material.share = found[0].1.share;
        }
    }
    if !surfaces.is_empty() {
        volume.info.meta.remove(surface::META_KEY);
        surface::store(&surfaces, &mut volume.info.meta);
    }
}

/// Brightness factors of the result's finest depth: the mean of those that the parts have at the depth whose voxels are nearest in
/// size, weighted by the number of voxels there.
fn inherited_factors(volume: &Volume, inputs: &[Volume], parts: &[Part]) -> BrightnessFactors {
    let edge = volume.info.bounds.size().x / f64::from(volume.resolution());
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for part in parts {
        let input = &inputs[part.source];
        let own = input.info.bounds.size().x * libm::cbrt(part.transform.matrix3.determinant().abs());
        let depth = libm::log2(own / edge).round().clamp(0.0, input.depths.len().saturating_sub(1) as f64) as usize;
        let Some(weight) = input.depths.get(depth).map(|d| d.voxels.len() as f64) else { continue };
        let factors = brightness::read(&input.info)[depth.min(MAX_DEPTH)];
        sum.iter_mut().zip(factors.light).for_each(|(s, f)| *s += weight * f64::from(f));
        weights += weight;
    }
    if weights > 0.0 { BrightnessFactors::new(sum.map(|s| s / weights)) } else { BrightnessFactors::PLAIN }
}

/// Edge of a voxel of an input that is placed by `map`, in the result's units.
fn voxel_edge(volume: &Volume, map: &DAffine3) -> f64 {
    volume.info.bounds.size().x / f64::from(volume.resolution()) * libm::cbrt(map.matrix3.determinant().abs())
}

/// Edge of the smallest voxel of all inputs, in the result's units.
fn finest_voxel(inputs: &[(Volume, Warnings)], placed: &[DAffine3]) -> f64 {
    inputs.iter().zip(placed).map(|((v, _), t)| voxel_edge(v, t)).fold(f64::INFINITY, f64::min)
}

/// Refuse what would cut large voxels into very many small ones, since nobody asked for as many.
fn check_work(volumes: &[Volume], placed: &[DAffine3], copies: usize, voxel: f64) -> Result<()> {
    let pieces = |v: &Volume, map: &DAffine3| {
        let own = v.depths.last().map_or(0, |depth| depth.voxels.len());
        own as f64 * (voxel_edge(v, map) / voxel).powi(3).min(f64::MAX)
    };
    let all = copies as f64 * volumes.iter().zip(placed).map(|(v, map)| pieces(v, map)).sum::<f64>();
    if all <= MAX_VOXELS {
        return Ok(());
    }
    let widest = volumes.iter().zip(placed).map(|(v, map)| voxel_edge(v, map)).fold(0.0, f64::max);
    Err(Error::Options(format!(
        "voxels of {} a side, the smallest of the inputs, would cut others of up to {} into about {all:.1e}: give a resolution (-r)",
        short(voxel),
        short(widest)
    )))
}

/// Offsets of the copies of a tiling, in source units; they are as far apart as the texel `first` is wide.
fn tile_offsets(first: &Info, tile: [u32; 3]) -> Result<Vec<DVec3>> {
    let tiles = tile.map(|n| n.max(1));
    let count = tiles.iter().map(|&n| u64::from(n)).product::<u64>();
    if count > MAX_TILES {
        return Err(Error::Limit { what: "the number of tiles".into(), needed: count, allowed: MAX_TILES });
    }
    // Its columns are the source axes along which u, v and w run.
    let axes = source_to_uvw(first.up).transpose();
    let size = first.bounds.size();
    let mut offsets = Vec::new();
    for k in 0..tiles[2] {
        for j in 0..tiles[1] {
            for i in 0..tiles[0] {
                let n = [i, j, k].map(f64::from);
                offsets.push((0..3).map(|a| n[a] * axes.col(a) * size).sum::<DVec3>());
            }
        }
    }
    Ok(offsets)
}

/// The part of `source` in the box `crop`.
fn cropped(source: Box<dyn Source>, crop: Aabb, metres_per_unit: f64) -> Result<Box<dyn Source>> {
    let block = FieldSource::new(Box::new(RoundedBox { min: crop.min, max: crop.max, round: 0.0 }), None)?;
    Ok(Box::new(LayersSource::new(vec![(Mode::Add, source), (Mode::Multiply, Box::new(block))], metres_per_unit)))
}

/// Grid of a result.
struct Grid {
    cube: Aabb,
    /// Voxels along the cube's edge, a power of two.
    side: u32,
}

/// Grid on the lattice of voxels of the edge `voxel` in the cube `first`: that cube itself where `extent` fits into it, else one that
/// holds `extent`.
fn result_grid(extent: Aabb, first: Aabb, voxel: f64) -> Result<Grid> {
    let extent = if extent.is_empty() { first } else { extent };
    let lattice = |v: DVec3| (v - first.min) / voxel;
    let (lo, hi) = ((lattice(extent.min) + GRID_TOLERANCE).floor(), (lattice(extent.max) - GRID_TOLERANCE).ceil());
    let own = (first.size().x / voxel).round();
    let fits = lo.min_element() >= 0.0 && hi.max_element() <= own && (own as u64).is_power_of_two();
    let (lo, side) = if fits { (DVec3::ZERO, own) } else { (lo, (hi - lo).max_element().max(1.0)) };
    if side.is_nan() || side > f64::from(MAX_RESOLUTION) {
        return Err(Error::Options(format!(
            "{side:.0} voxels of {voxel:.6} a side would be needed, at most {MAX_RESOLUTION} are made: give a resolution (-r)"
        )));
    }
    let side = (side as u32).next_power_of_two();
    let min = first.min + lo * voxel;
    Ok(Grid { cube: Aabb::new(min, min + voxel * f64::from(side)), side })
}

/// A depth of an input whose voxels lie on the result's voxels of some depth.
struct AlignedDepth {
    /// Index of the input, and its depth.
    input: usize,
    depth: usize,
    /// Offset of its voxels in the result's, in whole voxels.
    offset: DVec3,
}

/// Put back the inputs' own voxels wherever one lies in the grid as it lay in its own, and is alone there.
fn keep_voxels(volume: &mut Volume, inputs: &[Volume], parts: &[Part]) {
    let finest = volume.depths.len().saturating_sub(1);
    let nodes = codes(&volume.depths);
    // Ids that the inputs' materials have in the result.
    let id = |name: &str| volume.info.materials.iter().position(|m| m.name == name).unwrap_or(0) as u16;
    let new_ids = |v: &Volume| match &v.info.materials[..] {
        [] => vec![id(UNNAMED)],
        own => own.iter().map(|m| id(&m.name)).collect(),
    };
    let ids: Vec<Vec<u16>> = inputs.iter().map(new_ids).collect();
    let input_codes: Vec<Vec<Vec<u64>>> = inputs.iter().map(|v| codes(&v.depths)).collect();
    for (depth, nodes) in nodes.iter().enumerate() {
        let grid = own_grid(&volume.info, depth).grid_map();
        let align = |part: &Part| {
            let input = &inputs[part.source];
            let own = (input.depths.len() + depth).checked_sub(finest + 1)?;
            let map = snapped(grid * part.transform * own_grid(&input.info, own).grid_map().inverse());
            let offset = map.translation;
            let aligned = map.matrix3 == DMat3::IDENTITY && offset == offset.round();
            aligned.then_some(AlignedDepth { input: part.source, depth: own, offset })
        };
        // A part that is not aligned may reach any voxel.
        let Some(aligned) = parts.iter().map(align).collect::<Option<Vec<_>>>() else { continue };
        let level = &mut volume.depths[depth];
        for (n, (code, voxel)) in nodes.iter().zip(&mut level.voxels).enumerate() {
            let at = DVec3::from(morton::decode(*code).map(f64::from));
            let mut found = aligned.iter().filter_map(|part| {
                let p = at - part.offset;
                let within = p.min_element() >= 0.0 && p.max_element() < f64::from(1u32 << part.depth);
                let code = morton::encode(p.max(DVec3::ZERO).as_uvec3().to_array());
                let i = input_codes[part.input][part.depth].binary_search(&code).ok().filter(|_| within)?;
                inputs[part.input].depths[part.depth].voxels.get(i).map(|voxel| (part, i, voxel))
            });
            if let (Some((part, i, kept)), None) = (found.next(), found.next()) {
                *voxel = *kept;
                if let Some(mix) = level.mixes.get_mut(n) {
                    let own = inputs[part.input].depths[part.depth].mixes.get(i).copied().unwrap_or_default();
                    *mix = renamed(&own, &ids[part.input]);
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
        ball_of(centre, 1.0, 32)
    }

    fn ball_of(centre: DVec3, radius: f64, resolution: u32) -> (Volume, Warnings) {
        let source = FieldSource::new(Box::new(Sphere { centre, radius }), None).unwrap();
        let options = Options { resolution, ..Options::default() };
        (bake(&source, &options, &Quiet, &mut |_| {}).unwrap().0, Warnings::default())
    }

    /// Area that the root covers along x, in source units.
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
            // The silhouette's voxels, an eighth of the radius at 16 and a sixteenth at 64, become clouds as wide as they are:
            // measured .10 and .16, of which .025 is what the ball itself covers too much.
            assert!((share - 1.0).abs() < 0.18, "{resolution}: {share}");
        }
    }

    #[test]
    fn brightness_factors_are_kept() {
        let (a, w) = ball(DVec3::ZERO);
        let own = brightness::read(&a.info);
        let again = merge(vec![(a.clone(), w.clone())], &MergeOptions::default(), &Quiet).unwrap().0;
        assert_eq!(brightness::read(&again.info), own, "nothing was changed");
        // A depth that becomes the finest keeps the factor that it had against the depths below it, to a step of 1/256.
        let dimmed = BrightnessFactors::new([0.5, 0.75, 1.25]);
        let mut factors = own[..6].to_vec();
        factors[4] = dimmed;
        let mut other = a.clone();
        brightness::store(&factors, &mut other.info.meta);
        let options = MergeOptions { resolution: Some(16), ..MergeOptions::default() };
        let coarse = merge(vec![(other, w)], &options, &Quiet).unwrap().0;
        assert_eq!(brightness::read(&coarse.info)[4], dimmed);
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
        // Bounds of the content are rounded to sixteenths of the cube.
        assert!((size.x - 1.0).abs() < 0.2 && (size.y - 2.0).abs() < 0.2, "{size}");
        assert!(merge(Vec::new(), &MergeOptions::default(), &Quiet).is_err());
    }

    /// A texel of two materials, whose leaves let light through.
    fn tree() -> (Volume, Warnings) {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/tree.glb");
        let source = crate::source::open(&path, &crate::source::OpenOptions::default()).unwrap();
        let options = Options { resolution: 16, refine: 0, ..Options::default() };
        let mut volume = bake(&*source, &options, &Quiet, &mut |_| {}).unwrap().0;
        let leaf = SurfaceParams { transmission: [0.02, 0.05, 0.01], unlit: 0.25, one_sided: 0.5 };
        surface::store(&[SurfaceParams::default(), leaf], &mut volume.info.meta);
        (volume, Warnings::default())
    }

    #[test]
    fn materials_keep_their_colours_and_properties() {
        let a = tree();
        assert_eq!(a.0.info.materials.len(), 2);
        for tile in [[1; 3], [2, 1, 1]] {
            let options = MergeOptions { tile, ..MergeOptions::default() };
            let again = merge(vec![a.clone()], &options, &Quiet).unwrap().0;
            assert_eq!(again.info.materials, a.0.info.materials, "{tile:?}");
            assert_eq!(surface::read(&again.info), surface::read(&a.0.info), "{tile:?}");
        }
        // Of a brighter one of the same size: half of both.
        let mut b = a.clone();
        b.0.info.materials[0].albedo = a.0.info.materials[0].albedo.map(|c| (3e4 * c).round() / 1e4);
        surface::store(&[SurfaceParams { unlit: 0.5, ..SurfaceParams::default() }], &mut b.0.info.meta);
        let beside = DAffine3::from_translation(2.0 * a.0.info.bounds.size().x * DVec3::X);
        let transforms = vec![DAffine3::IDENTITY, beside];
        let both =
            merge(vec![a.clone(), b], &MergeOptions { transforms, ..MergeOptions::default() }, &Quiet).unwrap().0;
        for k in 0..3 {
            let (found, own) = (both.info.materials[0].albedo[k], a.0.info.materials[0].albedo[k]);
            assert!((found - 2.0 * own).abs() < 2e-4, "{found} {own}");
        }
        let surfaces = surface::read(&both.info);
        assert_eq!((surfaces[0].unlit, surfaces[1].one_sided, surfaces[1].unlit), (0.25, 0.25, 0.125));
    }

    /// A texel in centimetres is as large as it is beside one in metres, and keeps its voxels.
    #[test]
    fn units_are_those_of_the_first() {
        let (mut a, mut b) = (ball(DVec3::ZERO), ball_of(DVec3::new(400.0, 0.0, 0.0), 100.0, 32));
        (a.0.info.metres_per_unit, b.0.info.metres_per_unit) = (1.0, 0.01);
        let both = merge(vec![a.clone(), b.clone()], &MergeOptions::default(), &Quiet).unwrap().0;
        assert_eq!(both.resolution(), 128);
        assert_eq!(both.info.metres_per_unit, 1.0);
        let sorted = |volumes: &[&Volume]| {
            let mut all: Vec<String> =
                volumes.iter().flat_map(|v| &v.depths.last().unwrap().voxels).map(|v| format!("{v:?}")).collect();
            all.sort_unstable();
            all
        };
        assert!(sorted(&[&both]) == sorted(&[&a.0, &b.0]), "byte for byte");
        // Where a unit is not known, numbers are taken as they are.
        let unknown = Info { metres_per_unit: 0.0, ..Info::default() };
        assert_eq!(to_unit_of(&unknown, &Info::default()), DAffine3::IDENTITY);
        assert_eq!(to_unit_of(&Info::default(), &unknown), DAffine3::IDENTITY);
    }

    /// A texel beside one that is a hundred times as large is no work of hours that nobody asked for.
    #[test]
    fn what_would_be_cut_into_very_many_voxels_is_refused() {
        let inputs = || vec![ball_of(DVec3::ZERO, 1.0, 16), ball_of(DVec3::new(300.0, 0.0, 0.0), 100.0, 16)];
        let refused = merge(inputs(), &MergeOptions::default(), &Quiet).unwrap_err().to_string();
        assert!(refused.contains("give a resolution"), "{refused}");
        let options = MergeOptions { resolution: Some(16), ..MergeOptions::default() };
        assert_eq!(merge(inputs(), &options, &Quiet).unwrap().0.resolution(), 16);
    }

    /// Whatever source axis is up: copies beside each other along u, v or w do not meet.
    #[test]
    fn tiles_follow_the_axes_of_the_texel() {
        for up in 0..3 {
            let mut a = ball_of(DVec3::ZERO, 1.0, 8);
            a.0.info.up = up;
            for (axis, tile) in [[2, 1, 1], [1, 2, 1], [1, 1, 2]].into_iter().enumerate() {
                let options = MergeOptions { tile, ..MergeOptions::default() };
                let two = merge(vec![a.clone()], &options, &Quiet).unwrap().0;
                let size = two.info.content.size();
                // The result's cube has twice the edge.
                let mut wanted = DVec3::splat(0.5);
                wanted[axis] = 1.0;
                assert!((size - wanted).abs().max_element() < 0.15, "{up} {tile:?}: {size}");
            }
        }
    }
}

//! A texel as a source: its voxels as media in another grid. What merges texels and changes their resolution.
//!
//! Based on: E. Heitz et al., *The SGGX Microflake Distribution*, SIGGRAPH 2015 (a voxel's normals as flakes).
//!
//! Voxels of the depth that is about as fine as the other grid are laid into it, each as matter that fills its support box
//! and covers, along 13 axes, what the voxel covers. What is known of how matter in one voxel hides matter in the next (the
//! block correlation) is measured again, as of independent matter.

use std::path::Path;

use super::mixture::mix;
use super::placement::Placement;
use super::traits::{Source, Staged, Surface};
use crate::format::{Limits, Reader};
use crate::geom::polygon::Polygon;
use crate::geom::{Aabb, DAffine3, DMat3, DVec3, directions13};
use crate::progress::Progress;
use crate::source::Medium;
use crate::volume::chord::{Chords, Lanes, MAX_RATE, OPAQUE};
use crate::volume::surface::{self, SurfaceMeans};
use crate::volume::voxel::{RATE_MAX, rate_table};
use crate::volume::{Depth, Info, Mix, Sggx, Volume, Voxel};
use crate::{Error, Result, Warnings, morton};

/// A texel in memory.
pub struct TexelSource {
    volume: Volume,
    bounds: Aabb,
    materials: Vec<String>,
    warnings: Warnings,
}

/// Most regions that voxels may reach, one by one.
const MAX_ENTRIES: usize = 1 << 28;

impl TexelSource {
    /// Read the texel `path`, of at most `max_bytes` decoded bytes.
    ///
    /// # Errors
    /// Result of reading.
    pub fn open(path: &Path, max_bytes: u64) -> Result<TexelSource> {
        let reader = Reader::open(path, &Limits { decoded_bytes: max_bytes })?;
        let volume = reader.read_all()?;
        Ok(TexelSource::new(volume, reader.warnings()))
    }

    /// Source of a texel in memory; `warnings` are passed on to what is baked of it.
    pub fn new(volume: Volume, warnings: Warnings) -> TexelSource {
        let materials = volume.info.materials.iter().map(|m| m.name.clone()).collect();
        let mut source = TexelSource { volume, bounds: Aabb::EMPTY, materials, warnings };
        if !source.volume.depths.iter().all(|d| d.voxels.is_empty()) {
            let unit = own_grid(&source.volume.info, 0).grid_map().inverse();
            source.bounds = source.volume.info.content.transformed(unit);
        }
        source
    }

    /// Voxels of `depth`, and coarser ones that have no children: first code at `depth`, own depth, voxel.
    fn leaves(&self, depth: usize) -> Vec<Leaf> {
        let mut leaves = Vec::new();
        for ((d, level), codes) in self.volume.depths.iter().enumerate().take(depth + 1).zip(codes(&self.volume.depths))
        {
            let levels = (depth - d) as u32;
            for (i, ((code, &mask), &voxel)) in codes.into_iter().zip(&level.masks).zip(&level.voxels).enumerate() {
                if d == depth || mask == 0 {
                    let materials = level.mixes.get(i).copied().unwrap_or_default();
                    leaves.push(Leaf { code: code << (3 * levels), levels, voxel, materials });
                }
            }
        }
        leaves.sort_unstable_by_key(|l| l.code);
        leaves
    }
}

/// A texel's own grid at a depth, in the space of its bounds.
pub fn own_grid(info: &Info, depth: usize) -> Placement {
    Placement {
        bounds: info.bounds,
        transform: DAffine3::IDENTITY,
        scale: f64::from(1u32 << depth) / info.bounds.size().x.max(f64::MIN_POSITIVE),
        depth,
        up: info.up,
        cyclic: [false; 3],
        memory: u64::MAX,
    }
}

/// A map between two grids that agree but for roundings, as if there were none: otherwise a hair of every voxel would lie in
/// the next.
pub fn snapped(map: DAffine3) -> DAffine3 {
    let size = libm::exp2(libm::log2(map.matrix3.x_axis.x.abs()).round());
    let even = DMat3::from_diagonal(DVec3::splat(size));
    let turned = (map.matrix3 - even).to_cols_array().iter().any(|v| v.abs() > 1e-6 * size);
    let whole = map.translation.round();
    if turned || (map.translation - whole).abs().max_element() > 1e-3 {
        return map;
    }
    DAffine3::from_mat3_translation(even, whole)
}

/// Codes of all nodes, a list a depth.
pub fn codes(depths: &[Depth]) -> Vec<Vec<u64>> {
    let mut all: Vec<Vec<u64>> = Vec::with_capacity(depths.len());
    let mut codes = vec![0u64];
    for level in depths {
        codes.truncate(level.masks.len());
        let children =
            |(&code, &mask): (&u64, &u8)| (0..8).filter(move |j| mask >> j & 1 != 0).map(move |j| code << 3 | j);
        let next = codes.iter().zip(&level.masks).flat_map(children).collect();
        all.push(std::mem::replace(&mut codes, next));
    }
    all
}

/// A voxel that is laid into another grid.
#[derive(Clone, Copy)]
struct Leaf {
    /// Code of its first voxel, at the depth that was chosen.
    code: u64,
    /// log2 of its edge, in voxels of that depth.
    levels: u32,
    voxel: Voxel,
    materials: Mix,
}

impl Leaf {
    fn is_solid(&self) -> bool {
        self.voxel.rate == RATE_MAX && self.voxel.support == [0; 3]
    }

    fn lowest(&self) -> DVec3 {
        DVec3::from(morton::decode(self.code).map(f64::from))
    }

    fn edge(&self) -> f64 {
        f64::from(1u32 << self.levels)
    }
}

impl Source for TexelSource {
    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn metres_per_unit(&self) -> f64 {
        self.volume.info.metres_per_unit
    }

    fn facet_size(&self) -> f64 {
        self.volume.info.facet_size * self.volume.info.bounds.size().x
    }

    fn has_colour(&self) -> bool {
        self.volume.info.channels.albedo
    }

    fn materials(&self) -> &[String] {
        &self.materials
    }

    fn surfaces(&self) -> Vec<SurfaceMeans> {
        let info = &self.volume.info;
        let albedo = |i: usize| info.materials.get(i).map_or([1.0; 3], |m| m.albedo);
        let mean = |(i, params)| SurfaceMeans { reflected: albedo(i), params };
        surface::read(info).into_iter().enumerate().map(mean).collect()
    }

    fn warnings(&self) -> &Warnings {
        &self.warnings
    }

    fn stage<'a>(&'a self, place: &Placement, _: &dyn Progress) -> Result<Box<dyn Staged + 'a>> {
        let finest = self.volume.depths.len().saturating_sub(1);
        // The depth whose voxels are nearest to the other grid's.
        let stretch = place.grid_map() * own_grid(&self.volume.info, finest).grid_map().inverse();
        let edge = libm::cbrt(stretch.matrix3.determinant().abs());
        let coarser = libm::log2(1.0 / edge).round().clamp(0.0, finest as f64) as usize;
        let depth = finest - coarser;
        let map = snapped(place.grid_map() * own_grid(&self.volume.info, depth).grid_map().inverse());
        let leaves = self.leaves(depth);
        let levels = place.region_log2();
        let width = f64::from(1u32 << levels);
        let last = DVec3::splat(f64::from((place.side() >> levels) - 1));
        let cube = Aabb::new(DVec3::ZERO, DVec3::splat(f64::from(place.side())));
        let shifts = place.shifts(self.bounds.transformed(place.grid_map()));
        let mut entries: Vec<(u64, u32, u32)> = Vec::new();
        let room = place.memory / size_of_val(&[(0u64, 0u32, 0u32)]) as u64;
        let most = usize::try_from(room).unwrap_or(usize::MAX).min(MAX_ENTRIES);
        for (s, shift) in shifts.iter().enumerate() {
            for (i, leaf) in leaves.iter().enumerate() {
                let at = leaf.lowest();
                let b = Aabb::new(at, at + leaf.edge()).transformed(map);
                // Roundings must not reach into the next region.
                let b = Aabb::new(b.min + shift + 1e-6, b.max + shift - 1e-6);
                if !b.overlaps(cube) {
                    continue;
                }
                let region = |p: DVec3| (p / width).floor().clamp(DVec3::ZERO, last).as_uvec3();
                let (lo, hi) = (region(b.min), region(b.max));
                for z in lo.z..=hi.z {
                    for y in lo.y..=hi.y {
                        for x in lo.x..=hi.x {
                            entries.push((morton::encode([x, y, z]), s as u32, i as u32));
                        }
                    }
                }
                if entries.len() > most {
                    let (needed, allowed) = (entries.len() as u64, most as u64);
                    return Err(Error::Limit {
                        what: "the number of regions that voxels reach".into(),
                        needed,
                        allowed,
                    });
                }
            }
        }
        entries.sort_unstable();
        let mut regions: Vec<u64> = entries.iter().map(|e| e.0).collect();
        regions.dedup();
        let starts = regions.iter().map(|r| entries.partition_point(|e| e.0 < *r)).chain([entries.len()]).collect();
        let maps = shifts.iter().map(|s| DAffine3::from_translation(*s) * map).map(|m| (m, m.inverse())).collect();
        Ok(Box::new(StagedTexel { leaves, maps, rates: rate_table(), regions, starts, entries, levels }))
    }
}

struct StagedTexel {
    leaves: Vec<Leaf>,
    /// The texel's own grid → the other, and back; more than one along cyclic axes.
    maps: Vec<(DAffine3, DAffine3)>,
    rates: [f32; 256],
    regions: Vec<u64>,
    starts: Vec<usize>,
    /// Region, map, leaf.
    entries: Vec<(u64, u32, u32)>,
    levels: usize,
}

impl StagedTexel {
    /// Coverage of a voxel as independent matter: hits per edge along 13 axes.
    fn rates(&self, voxel: &Voxel) -> [f64; 13] {
        let shape = Sggx::decode(voxel.ndf);
        let rate = self.rates[usize::from(voxel.rate)];
        let (lo, hi) = voxel.support_box();
        let chords = Chords::new((hi - lo).as_dvec3());
        let mut own: Lanes = [1e-6; 16];
        for (own, w) in own.iter_mut().zip(directions13()) {
            *own = (rate * shape.sigma(w.as_vec3())).clamp(1e-6, MAX_RATE);
        }
        let blocked = chords.opacity(&own, voxel.c()).map(|share| share.clamp(0.0, OPAQUE));
        let rates = chords.solve_rates(&blocked, 0.0).rates;
        std::array::from_fn(|k| rates[k].into())
    }

    /// The voxel as a medium of the other grid: one per voxel that its support box reaches.
    fn lay(&self, leaf: &Leaf, map: &DAffine3, region: Aabb, each: &mut dyn FnMut(Medium)) {
        let (lo, hi) = leaf.voxel.support_box();
        let (corner, edge) = (leaf.lowest(), leaf.edge());
        let whole = Aabb::new(corner + edge * lo.as_dvec3(), corner + edge * hi.as_dvec3()).transformed(*map);
        let b = whole.intersection(region);
        if b.is_empty() {
            return;
        }
        let rates = self.rates(&leaf.voxel);
        let mean = rates.iter().sum::<f64>() / 13.0;
        let size = libm::cbrt(map.matrix3.determinant().abs()) * edge;
        // A box that is turned fills more than the voxel did.
        let spread = (size / edge).powi(3) * (edge * (hi - lo).as_dvec3()).element_product()
            / whole.size().element_product().max(1e-30);
        let most = (0..13).max_by(|&a, &b| rates[a].total_cmp(&rates[b])).unwrap_or(0);
        let facing = f64::from(leaf.voxel.one_sidedness());
        let own = if facing > 0.0 { leaf.voxel.mean_normal().as_dvec3() } else { directions13()[most] };
        // Normals go with the transposed inverse.
        let normal = (map.matrix3.inverse().transpose() * own).normalize_or(DVec3::Z);
        let albedo = leaf.voxel.albedo().to_array();
        let flat = (rates[most] / mean.max(1e-30) - 1.0).clamp(0.0, 1.0);
        let (first, last) = (b.min.floor(), (b.max.ceil() - 1.0).max(b.min.floor()));
        let count = (last - first + 1.0).as_uvec3();
        for z in 0..count.z {
            for y in 0..count.y {
                for x in 0..count.x {
                    let at = first + DVec3::new(x.into(), y.into(), z.into());
                    let part = Medium {
                        lo: (b.min - at).clamp(DVec3::ZERO, DVec3::ONE),
                        hi: (b.max - at).clamp(DVec3::ZERO, DVec3::ONE),
                        extinction: mean / size * spread.min(1.0),
                        flat,
                        normal,
                        facing,
                        scattered: false,
                        materials: leaf.materials,
                        ..Medium::even(at.as_uvec3().to_array(), 0, 1.0, albedo)
                    };
                    // Slivers of rounding.
                    if (part.hi - part.lo).min_element() > 1e-6 && part.is_valid() {
                        each(part);
                    }
                }
            }
        }
    }
}

impl Staged for StagedTexel {
    fn regions(&self) -> &[u64] {
        &self.regions
    }

    fn weight(&self, region: usize) -> u64 {
        (self.starts[region + 1] - self.starts[region]) as u64
    }

    fn facets(&self) -> u32 {
        0
    }

    fn emit(&self, _: usize, _: &mut dyn FnMut(&Polygon)) {}

    fn surface(&self, _: u32, _: DVec3, _: f64) -> Surface {
        Surface { albedo: [1.0; 3], alpha: 1.0 }
    }

    fn has_alpha(&self, _: u32) -> bool {
        false
    }

    fn one_sided(&self, _: u32) -> bool {
        false
    }

    fn medium(&self, region: usize, each: &mut dyn FnMut(&Medium)) {
        let corner = DVec3::from(morton::decode(self.regions[region]).map(|v| f64::from(v << self.levels)));
        let cube = Aabb::new(corner, corner + f64::from(1u32 << self.levels));
        let mut all = Vec::new();
        for &(_, map, leaf) in &self.entries[self.starts[region]..self.starts[region + 1]] {
            let leaf = &self.leaves[leaf as usize];
            if !leaf.is_solid() && leaf.voxel.rate > 0 {
                self.lay(leaf, &self.maps[map as usize].0, cube, &mut |m| all.push(m));
            }
        }
        mix(&all, &|m| !self.inside(DVec3::from(m.at.map(f64::from)) + 0.5)).iter().for_each(each);
    }

    fn inside(&self, at: DVec3) -> bool {
        self.maps.iter().any(|(_, back)| {
            let p = back.transform_point3(at).floor();
            let most = f64::from(1u32 << crate::volume::MAX_DEPTH);
            if !(p.min_element() >= 0.0 && p.max_element() < most) {
                return false;
            }
            let code = morton::encode(p.as_uvec3().to_array());
            let after = self.leaves.partition_point(|l| l.code <= code);
            let leaf = after.checked_sub(1).and_then(|i| self.leaves.get(i));
            leaf.is_some_and(|l| l.is_solid() && code >> (3 * l.levels) == l.code >> (3 * l.levels))
        })
    }
}

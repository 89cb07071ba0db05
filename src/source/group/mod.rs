//! A source made of other sources, each placed once or many times.
//!
//! A source that is placed a few times is laid into the grid for each place. One that is placed often is laid once into a
//! grid of its own, at the resolution of its largest copy; what a copy has in a region is carried over when it is asked for,
//! so that a copy takes a few bytes a region it reaches and not a few a facet.

mod kept;
mod placed;

use self::kept::{Kept, List};
use self::placed::{MappedAlpha, PlacedCopy, carry};
use super::mesh::patch::weighted_median;
use super::mixture::mix;
use super::placement::Placement;
use super::traits::{AlphaSampler, Source, Staged, Surface};
use crate::geom::polygon::Polygon;
use crate::geom::{Aabb, DAffine3, DVec3};
use crate::progress::Progress;
use crate::source::Medium;
use crate::source::materials::{renamed, unite, unite_surfaces};
use crate::{Error, Result, Warnings, morton};

/// One source at one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Index into the group's sources.
    pub source: usize,
    /// The source's space → the group's.
    pub transform: DAffine3,
}

/// Sources and where they are placed.
pub struct GroupSource {
    sources: Vec<Box<dyn Source>>,
    /// A list a source.
    places: Vec<Vec<DAffine3>>,
    materials: Vec<String>,
    /// A list a source: what its own ids of materials become.
    ids: Vec<Vec<u16>>,
    bounds: Aabb,
    facet_size: f64,
    metres_per_unit: f64,
    warnings: Warnings,
    notes: Vec<String>,
}

/// Copies of a source up to which each is laid into the grid by itself; and of one whose facets are made a facet a voxel.
const FEW: [usize; 2] = [4, 2000];
/// Factor by which the own grid of a source that answers for the middles of its voxels is finer than its largest copy.
const FINER: f64 = 2.0;
/// Copies times the regions of one, summed up, up to which a group is laid out.
const MAX_ENTRIES: u64 = 1 << 28;
/// Bytes of memory that one of these takes while they are sorted by region.
const ENTRY_MEMORY: u64 = 24;

impl GroupSource {
    /// `metres_per_unit` of the group's space: 0 where unknown. Parts of sources that there are not, and parts whose
    /// transform is singular or not finite, are left out with a warning.
    pub fn new(sources: Vec<Box<dyn Source>>, parts: &[Part], metres_per_unit: f64) -> GroupSource {
        let mut warnings = Warnings::default();
        sources.iter().for_each(|source| warnings.merge(source.warnings().clone()));
        let mut places = vec![Vec::new(); sources.len()];
        let mut bounds = Aabb::EMPTY;
        let mut sizes = Vec::with_capacity(parts.len());
        for part in parts {
            let volume = part.transform.matrix3.determinant().abs();
            let (Some(source), true) = (sources.get(part.source), part.transform.is_finite() && volume > 0.0) else {
                warnings.add("parts that are placed nowhere, or flattened to nothing, are left out");
                continue;
            };
            let transform = part.transform * DAffine3::from_translation(source.origin());
            let loose = source.bounds().transformed(transform);
            if bounds.union(loose) != bounds {
                bounds = bounds.union(source.bounds_in(transform));
            }
            sizes.push((libm::cbrt(volume) * source.facet_size(), 1.0));
            places[part.source].push(transform);
        }
        sizes.retain(|s| s.0 > 0.0);
        let (materials, ids) = unite(sources.iter().map(|s| &**s));
        let facet_size = weighted_median(sizes);
        GroupSource {
            sources,
            places,
            materials,
            ids,
            bounds,
            facet_size,
            metres_per_unit,
            warnings,
            notes: Vec::new(),
        }
    }

    /// What was found out of the group as it was read.
    pub fn with_notes(self, notes: Vec<String>) -> GroupSource {
        GroupSource { notes, ..self }
    }

    /// The same, taken to fill `bounds`.
    pub fn with_bounds(mut self, bounds: Aabb) -> GroupSource {
        self.bounds = bounds;
        self
    }
}

impl Source for GroupSource {
    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn bounds_in(&self, transform: DAffine3) -> Aabb {
        let mut bounds = Aabb::EMPTY;
        for (source, places) in self.sources.iter().zip(&self.places) {
            let loose = source.bounds();
            for place in places.iter().map(|p| transform * *p) {
                if bounds.union(loose.transformed(place)) != bounds {
                    bounds = bounds.union(source.bounds_in(place));
                }
            }
        }
        bounds
    }

    fn metres_per_unit(&self) -> f64 {
        self.metres_per_unit
    }

    fn facet_size(&self) -> f64 {
        self.facet_size
    }

    fn has_colour(&self) -> bool {
        self.sources.iter().zip(&self.places).any(|(s, p)| !p.is_empty() && s.has_colour())
    }

    fn materials(&self) -> &[String] {
        &self.materials
    }

    fn surfaces(&self) -> Vec<crate::volume::surface::SurfaceMeans> {
        unite_surfaces(self.sources.iter().map(|s| &**s).zip(&self.ids), self.materials.len())
    }

    fn warnings(&self) -> &Warnings {
        &self.warnings
    }

    fn is_inside_exact(&self) -> bool {
        self.sources.iter().all(|s| s.is_inside_exact())
    }

    fn stage<'a>(&'a self, place: &Placement, progress: &dyn Progress) -> Result<Box<dyn Staged + 'a>> {
        let mut staged = StagedGroup {
            pieces: Vec::new(),
            facets: 0,
            regions: Vec::new(),
            starts: Vec::new(),
            entries: Vec::new(),
            kept: Kept::new(kept::BYTES),
            kept_bytes: 0,
            region_log2: place.region_log2(),
            last: f64::from((place.side() >> place.region_log2()) - 1),
        };
        let mut entries = Vec::new();
        for ((source, places), ids) in self.sources.iter().zip(&self.places).zip(&self.ids) {
            let few = FEW[usize::from(source.is_inside_exact())];
            let left = Placement { memory: place.memory.saturating_sub(staged.bytes() + bytes_of(&entries)), ..*place };
            let often =
                if places.len() > few { StagedCopies::often(&**source, places, &left, progress)? } else { None };
            if let Some(piece) = often {
                staged.add(StagedCopies { ids, ..piece }, &mut entries, place.memory)?;
                continue;
            }
            for transform in places {
                let memory = place.memory.saturating_sub(staged.bytes() + bytes_of(&entries));
                let own = Placement { memory, ..place.within(*transform) };
                let piece = StagedCopies::once(source.stage(&own, progress)?);
                staged.add(StagedCopies { ids, ..piece }, &mut entries, place.memory)?;
            }
        }
        entries.sort_unstable();
        entries.dedup();
        for (i, entry) in entries.iter().enumerate() {
            if staged.regions.last() != Some(&entry.0) {
                staged.regions.push(entry.0);
                staged.starts.push(i);
            }
        }
        staged.starts.push(entries.len());
        staged.entries = entries.into_iter().map(|(_, piece, copy)| (piece, copy)).collect();
        Ok(Box::new(staged))
    }
}

/// A source in a grid, and its copies.
struct StagedCopies<'a> {
    staged: Box<dyn Staged + 'a>,
    /// Number of facets of the source itself.
    facets: u32,
    /// Number of the first facet of its first copy.
    first: u32,
    /// Material of the group for each material of the source.
    ids: &'a [u16],
    /// None where it is in the group's grid itself.
    copies: Vec<PlacedCopy>,
    /// log2 of the voxels a region of its own grid is wide.
    region_log2: usize,
}

impl<'a> StagedCopies<'a> {
    fn once(staged: Box<dyn Staged + 'a>) -> StagedCopies<'a> {
        StagedCopies { facets: staged.facets(), staged, first: 0, ids: &[], copies: Vec::new(), region_log2: 0 }
    }

    /// `None` for what has no matter, and for media: voxels are not carried from grid to grid.
    fn often(
        source: &'a dyn Source,
        places: &[DAffine3],
        place: &Placement,
        progress: &dyn Progress,
    ) -> Result<Option<StagedCopies<'a>>> {
        let bounds = source.bounds();
        if bounds.is_empty() {
            return Ok(None);
        }
        let maps: Vec<DAffine3> = places.iter().map(|p| place.within(*p).grid_map()).collect();
        let stretch = |m: &DAffine3| (0..3).map(|i| m.matrix3.col(i).length()).fold(0.0, f64::max);
        let largest = maps.iter().map(stretch).fold(0.0, f64::max);
        // A hair larger all around, so that what lies on the upper faces is within.
        let extent = bounds.size().max_element().max(1.0 / largest);
        let pad = extent / f64::from(1 << 20);
        let (least, extent) = (bounds.min - pad, extent + 2.0 * pad);
        let scale = largest * if source.is_inside_exact() { 1.0 } else { FINER };
        let want = libm::log2((extent * scale).max(1.0)).ceil();
        let depth = (want as usize).min(kept::MAX_DEPTH).min(place.depth + 1);
        let side = f64::from(1u32 << depth);
        // Voxels of just that size: a cube of a power of two has room to spare.
        let extent = extent.max(side / scale);
        let own = Placement {
            bounds: Aabb::new(least, least + extent),
            transform: DAffine3::IDENTITY,
            scale: side / extent,
            depth,
            cyclic: [false; 3],
            ..*place
        };
        let back = own.grid_map().inverse();
        let staged = source.stage(&own, progress)?;
        let mut cloudy = false;
        for region in 0..staged.regions().len() {
            staged.medium(region, &mut |_| cloudy = true);
            if cloudy {
                return Ok(None);
            }
        }
        let region_log2 = own.region_log2();
        let extent = staged.regions().iter().fold(Aabb::EMPTY, |b, &code| b.union(cube(code, region_log2)));
        let mut copies = Vec::with_capacity(maps.len());
        for map in maps.iter().map(|m| *m * back) {
            let bounds = extent.transformed(map);
            for shift in place.shifts(bounds) {
                let map = DAffine3::from_translation(shift) * map;
                let determinant = map.matrix3.determinant();
                copies.push(PlacedCopy {
                    map,
                    back: map.inverse(),
                    scale: 1.0 / libm::cbrt(determinant.abs()),
                    mirrored: determinant < 0.0,
                    bounds: Aabb::new(bounds.min + shift, bounds.max + shift),
                });
            }
        }
        Ok(Some(StagedCopies { facets: staged.facets(), staged, first: 0, ids: &[], copies, region_log2 }))
    }

    /// The copy of a facet, and its number in the piece.
    fn find(&self, facet: u32) -> (Option<&PlacedCopy>, u32) {
        let local = facet - self.first;
        match self.copies.get((local / self.facets.max(1)) as usize) {
            Some(copy) => (Some(copy), local % self.facets.max(1)),
            None => (None, local),
        }
    }

    /// Give what lies in the region `own` of its own grid: a facet in several regions is to be given once, so each gives its
    /// part.
    fn emit(&self, own: usize, each: &mut dyn FnMut(&Polygon)) {
        let bounds = cube(self.staged.regions()[own], self.region_log2);
        self.staged.emit(own, &mut |p| {
            let mut room = None;
            p.clip(bounds.min, bounds.max, &mut room).into_iter().for_each(&mut *each);
        });
    }

    /// Regions of its own grid that may reach into the box `box_` of that grid.
    fn reaching(&self, box_: Aabb, each: &mut dyn FnMut(usize)) {
        let width = f64::from(1u32 << self.region_log2);
        let regions = self.staged.regions();
        let Some(&last) = regions.last() else { return };
        // Codes grow with every coordinate, but the last code need not have the largest.
        let most = f64::from(1u32 << (64 - last.leading_zeros()).div_ceil(3));
        let lo = (box_.min / width).floor().clamp(DVec3::ZERO, DVec3::splat(most)).as_uvec3();
        let hi = (box_.max / width).floor().clamp(DVec3::ZERO, DVec3::splat(most)).as_uvec3();
        let cells = (hi - lo + 1).as_u64vec3().element_product();
        if cells > regions.len() as u64 {
            for (i, &code) in regions.iter().enumerate() {
                let at = morton::decode(code);
                if (0..3).all(|a| (lo[a]..=hi[a]).contains(&at[a])) {
                    each(i);
                }
            }
            return;
        }
        for z in lo.z..=hi.z {
            for y in lo.y..=hi.y {
                for x in lo.x..=hi.x {
                    if let Ok(i) = regions.binary_search(&morton::encode([x, y, z])) {
                        each(i);
                    }
                }
            }
        }
    }
}

/// The box of a region.
fn cube(code: u64, region_log2: usize) -> Aabb {
    let corner = DVec3::from(morton::decode(code).map(|v| f64::from(v << region_log2)));
    Aabb::new(corner, corner + f64::from(1u32 << region_log2))
}

/// Bytes of memory of a list.
fn bytes_of(entries: &[Entry]) -> u64 {
    entries.len() as u64 * ENTRY_MEMORY
}

/// Region, piece, copy (0 where the piece has none); for a piece without copies its own index of the region.
type Entry = (u64, u32, u32);

struct StagedGroup<'a> {
    pieces: Vec<StagedCopies<'a>>,
    facets: u32,
    regions: Vec<u64>,
    /// Start of each region's entries, and the end of the last.
    starts: Vec<usize>,
    /// Piece, and its copy or its own index of the region.
    entries: Vec<(u32, u32)>,
    kept: Kept,
    /// Bytes of the pieces.
    kept_bytes: u64,
    region_log2: usize,
    /// Highest coordinate of a region.
    last: f64,
}

impl<'a> StagedGroup<'a> {
    fn add(&mut self, mut piece: StagedCopies<'a>, entries: &mut Vec<Entry>, memory: u64) -> Result<()> {
        let index = self.pieces.len() as u32;
        piece.first = self.facets;
        let count = u64::from(piece.facets) * piece.copies.len().max(1) as u64;
        let needed = u64::from(self.facets) + count;
        let limit = |what: &str, needed, allowed| Err(Error::Limit { what: what.into(), needed, allowed });
        if needed > u64::from(u32::MAX) {
            return limit("the number of facets of all copies", needed, u32::MAX.into());
        }
        self.facets = needed as u32;
        if piece.copies.is_empty() {
            entries.extend(piece.staged.regions().iter().enumerate().map(|(i, &code)| (code, index, i as u32)));
        }
        let work = piece.copies.len() as u64 * piece.staged.regions().len() as u64;
        if work > MAX_ENTRIES {
            return limit("the number of copies times the regions of one", work, MAX_ENTRIES);
        }
        let width = f64::from(1u32 << self.region_log2);
        let clamped = |v: DVec3| (v / width).floor().clamp(DVec3::ZERO, DVec3::splat(self.last)).as_uvec3();
        let grid = Aabb::new(DVec3::ZERO, DVec3::splat((self.last + 1.0) * width));
        for (n, copy) in piece.copies.iter().enumerate() {
            let before = entries.len();
            for &code in piece.staged.regions() {
                let reach = cube(code, piece.region_log2).transformed(copy.map);
                if !reach.overlaps(grid) {
                    continue;
                }
                let (lo, hi) = (clamped(reach.min), clamped(reach.max));
                for z in lo.z..=hi.z {
                    for y in lo.y..=hi.y {
                        for x in lo.x..=hi.x {
                            entries.push((morton::encode([x, y, z]), index, n as u32));
                        }
                    }
                }
            }
            // Neighbouring regions of a copy reach the same of the group's.
            entries[before..].sort_unstable();
            let mut kept = before;
            for i in before..entries.len() {
                if i == before || entries[i] != entries[kept - 1] {
                    entries[kept] = entries[i];
                    kept += 1;
                }
            }
            entries.truncate(kept);
            let most = MAX_ENTRIES.min(memory / ENTRY_MEMORY);
            if entries.len() as u64 > most {
                return limit("the number of regions that copies reach", entries.len() as u64, most);
            }
        }
        self.kept_bytes += piece.staged.bytes() + size_of_val(&piece.copies[..]) as u64;
        self.pieces.push(piece);
        Ok(())
    }

    fn find(&self, facet: u32) -> (&StagedCopies<'a>, Option<&PlacedCopy>, u32) {
        let at = self.pieces.partition_point(|p| p.first <= facet) - 1;
        let piece = &self.pieces[at];
        let (copy, local) = piece.find(facet);
        (piece, copy, local)
    }

    /// The copies that may reach `at`, each with that place in its own space.
    fn around(&self, at: DVec3) -> impl Iterator<Item = (&(dyn Staged + 'a), DVec3)> {
        let width = f64::from(1u32 << self.region_log2);
        let region = (at / width).floor().clamp(DVec3::ZERO, DVec3::splat(self.last)).as_uvec3();
        let found = self.regions.binary_search(&morton::encode(region.to_array()));
        let entries = found.map_or(&[][..], |region| self.entries(region));
        entries.iter().filter_map(move |&(piece, copy)| {
            let piece = &self.pieces[piece as usize];
            let Some(copy) = piece.copies.get(copy as usize) else { return Some((&*piece.staged, at)) };
            let within = at.cmpge(copy.bounds.min).all() && at.cmple(copy.bounds.max).all();
            within.then(|| (&*piece.staged, copy.back.transform_point3(at)))
        })
    }

    fn entries(&self, region: usize) -> &[(u32, u32)] {
        &self.entries[self.starts[region]..self.starts[region + 1]]
    }
}

impl Staged for StagedGroup<'_> {
    fn regions(&self) -> &[u64] {
        &self.regions
    }

    fn weight(&self, region: usize) -> u64 {
        let of = |&(piece, at): &(u32, u32)| {
            let piece = &self.pieces[piece as usize];
            if piece.copies.is_empty() { piece.staged.weight(at as usize) } else { 1 }
        };
        self.entries(region).iter().map(of).sum()
    }

    fn facets(&self) -> u32 {
        self.facets
    }

    fn bytes(&self) -> u64 {
        self.kept_bytes + size_of_val(&self.entries[..]) as u64 + 16 * self.regions.len() as u64
    }

    fn emit(&self, region: usize, each: &mut dyn FnMut(&Polygon)) {
        let target = cube(self.regions[region], self.region_log2);
        for &(index, at) in self.entries(region) {
            let piece = &self.pieces[index as usize];
            let Some(copy) = piece.copies.get(at as usize) else {
                piece.staged.emit(at as usize, &mut |p| {
                    let mut numbered = *p;
                    numbered.facet += piece.first;
                    each(&numbered);
                });
                continue;
            };
            let first = piece.first + at * piece.facets;
            let own_target = target.transformed(copy.back).rounded_out();
            let mut carry = |corners: &[DVec3], facet: u32| {
                if own_target.overlaps(Aabb::around(corners.iter().copied())) {
                    carry(corners, copy, first + facet, each);
                }
            };
            piece.reaching(own_target, &mut |own| {
                if piece.staged.weight(own) > 0 {
                    return piece.emit(own, &mut |p| carry(p.corners(), p.facet));
                }
                // Facets that are not in memory already take work: the copies share it.
                let list = self.kept.get((index, own as u32), || {
                    let mut list = List::default();
                    piece.emit(own, &mut |p| list.push(p));
                    list
                });
                list.iter().for_each(|(corners, facet)| carry(corners, facet));
            });
        }
    }

    fn surface(&self, facet: u32, at: DVec3, width: f64) -> Surface {
        match self.find(facet) {
            (piece, None, local) => piece.staged.surface(local, at, width),
            (piece, Some(copy), local) => {
                piece.staged.surface(local, copy.back.transform_point3(at), width * copy.scale)
            }
        }
    }

    fn normal(&self, facet: u32, at: DVec3, own: DVec3) -> DVec3 {
        let (piece, copy, local) = self.find(facet);
        let Some(copy) = copy else { return piece.staged.normal(local, at, own) };
        // Normals go with the transposed inverse; a mirrored copy turned its facets, and with them their normals.
        let turn = if copy.mirrored { -1.0 } else { 1.0 };
        let into = |n: DVec3, map: &DAffine3| (map.matrix3.transpose() * n).try_normalize();
        let Some(inner) = into(turn * own, &copy.map) else { return own };
        let given = piece.staged.normal(local, copy.back.transform_point3(at), inner);
        if given == inner { own } else { into(turn * given, &copy.back).unwrap_or(own) }
    }

    fn material(&self, facet: u32) -> u16 {
        let (piece, _, local) = self.find(facet);
        piece.ids.get(usize::from(piece.staged.material(local))).copied().unwrap_or(0)
    }

    fn has_alpha(&self, facet: u32) -> bool {
        let (piece, _, local) = self.find(facet);
        piece.staged.has_alpha(local)
    }

    fn alpha_sampler(&self, facet: u32) -> Option<Box<dyn AlphaSampler + '_>> {
        let (piece, copy, local) = self.find(facet);
        let sampler = piece.staged.alpha_sampler(local)?;
        Some(match copy {
            None => sampler,
            Some(copy) => Box::new(MappedAlpha { sampler, back: copy.back, scale: copy.scale }),
        })
    }

    fn one_sided(&self, facet: u32) -> bool {
        let (piece, _, local) = self.find(facet);
        piece.staged.one_sided(local)
    }

    fn closed(&self, facet: u32) -> bool {
        let (piece, _, local) = self.find(facet);
        piece.staged.closed(local)
    }

    fn medium(&self, region: usize, each: &mut dyn FnMut(&Medium)) {
        let (mut media, mut givers, mut others) = (Vec::new(), 0, 0);
        for &(piece, at) in self.entries(region) {
            let (piece, before) = (&self.pieces[piece as usize], media.len());
            if piece.copies.is_empty() {
                let renamed = |m: &Medium| Medium { materials: renamed(&m.materials, piece.ids), ..*m };
                piece.staged.medium(at as usize, &mut |m| media.push(renamed(m)));
            }
            let gave = media.len() > before;
            givers += usize::from(gave);
            others += usize::from(!gave);
        }
        if givers + others.min(1) > 1 {
            media = mix(&media, &|m| !self.inside(DVec3::from(m.at.map(f64::from)) + 0.5));
        }
        media.iter().for_each(each);
    }

    fn inside(&self, at: DVec3) -> bool {
        self.around(at).any(|(staged, at)| staged.inside(at))
    }

    fn implicit_value(&self, at: DVec3) -> f64 {
        self.around(at).map(|(staged, at)| staged.implicit_value(at)).fold(1.0, f64::min)
    }

    fn is_box_inside(&self, b: &Aabb) -> Option<bool> {
        let mut outside = true;
        for piece in &self.pieces {
            let alone = piece.copies.is_empty().then(|| piece.staged.is_box_inside(b));
            let copies = piece.copies.iter().filter(|c| c.bounds.overlaps(*b));
            let sides = alone.into_iter().chain(copies.map(|c| piece.staged.is_box_inside(&b.transformed(c.back))));
            for side in sides {
                match side {
                    Some(true) => return Some(true),
                    Some(false) => {}
                    None => outside = false,
                }
            }
        }
        outside.then_some(false)
    }
}

#[cfg(test)]
mod tests;

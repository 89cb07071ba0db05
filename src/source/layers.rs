//! Sources drawn onto one another in order: the drawing modes of a recipe, and CSG of any sources.
//!
//! Based on: F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, INRIA RR-2846, 1996, section 3 (building a
//! shape as painting in a volume); A. Requicha, H. Voelcker, *Boolean Operations in Solid Modeling: Boundary Evaluation and
//! Merging Algorithms*, Proc. IEEE 73, 1985 (faces are kept where they bound the result).
//!
//! Facets are cut to voxels, and there along the surface of the other source: by its level where it has one, else by the
//! voxels that it holds. A face stays where the result's matter is beneath it and not above it.

use super::mixture::mix;
use super::placement::Placement;
use super::traits::{AlphaSampler, Source, Staged, Surface};
use crate::geom::polygon::Polygon;
use crate::geom::{Aabb, DVec3};
use crate::progress::Progress;
use crate::source::Medium;
use crate::source::materials::{renamed, unite, unite_surfaces};
use crate::volume::surface::SurfaceMeans;
use crate::{Error, Result, Warnings, morton};

/// Operation by which a layer is drawn onto those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Both are there.
    Add,
    /// Both are there, and no face within the other.
    Union,
    /// Matter within the layer is removed, then the layer is drawn.
    Set,
    /// Matter within the layer is removed; the cut gets the layer's faces.
    Subtract,
    /// Matter outside of the layer is removed; the cut gets the layer's faces.
    Multiply,
    /// Facets within the layer get its normals.
    Normals,
    /// Facets within the layer keep a share of what they cover: the layer's own alpha.
    Opacity,
    /// Facets within the layer stay whole where their alpha is at least the layer's, and go elsewhere.
    Threshold,
}

impl Mode {
    /// Whether the layer's own facets are drawn.
    fn draws(self) -> bool {
        !matches!(self, Mode::Normals | Mode::Opacity | Mode::Threshold)
    }
}

/// Sources and how each is drawn.
pub struct LayersSource {
    layers: Vec<(Mode, Box<dyn Source>)>,
    materials: Vec<String>,
    /// A list a layer: what its own ids of materials become.
    ids: Vec<Vec<u16>>,
    bounds: Aabb,
    metres_per_unit: f64,
    warnings: Warnings,
}

impl LayersSource {
    /// `metres_per_unit`: 0 where unknown.
    pub fn new(layers: Vec<(Mode, Box<dyn Source>)>, metres_per_unit: f64) -> LayersSource {
        let mut warnings = Warnings::default();
        for (_, source) in &layers {
            warnings.merge(source.warnings().clone());
        }
        let bounds = bounds(&layers, |s| s.bounds());
        let drawn = layers.iter().filter(|(mode, _)| mode.draws()).map(|(_, s)| &**s);
        let (materials, drawn) = unite(drawn);
        let mut drawn = drawn.into_iter();
        let own = |(mode, _): &(Mode, _)| if mode.draws() { drawn.next().unwrap_or_default() } else { Vec::new() };
        let ids = layers.iter().map(own).collect();
        LayersSource { layers, materials, ids, bounds, metres_per_unit, warnings }
    }
}

/// A box of what is left.
fn bounds(layers: &[(Mode, Box<dyn Source>)], of: impl Fn(&dyn Source) -> Aabb) -> Aabb {
    layers.iter().fold(Aabb::EMPTY, |b, (mode, source)| match mode {
        Mode::Add | Mode::Union | Mode::Set => b.union(of(&**source)),
        Mode::Multiply => b.intersection(of(&**source)),
        _ => b,
    })
}

impl Source for LayersSource {
    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn bounds_in(&self, transform: crate::geom::DAffine3) -> Aabb {
        bounds(&self.layers, |s| s.bounds_in(transform))
    }

    fn metres_per_unit(&self) -> f64 {
        self.metres_per_unit
    }

    fn facet_size(&self) -> f64 {
        self.layers.iter().find(|(mode, _)| mode.draws()).map_or(0.0, |(_, s)| s.facet_size())
    }

    fn has_colour(&self) -> bool {
        self.layers.iter().any(|(mode, s)| mode.draws() && s.has_colour())
    }

    fn materials(&self) -> &[String] {
        &self.materials
    }

    fn surfaces(&self) -> Vec<SurfaceMeans> {
        let drawn = self.layers.iter().zip(&self.ids).filter(|((mode, _), _)| mode.draws());
        unite_surfaces(drawn.map(|((_, source), ids)| (&**source, ids)), self.materials.len())
    }

    fn warnings(&self) -> &Warnings {
        &self.warnings
    }

    fn is_inside_exact(&self) -> bool {
        self.layers.iter().all(|(_, s)| s.is_inside_exact())
    }

    fn stage<'a>(&'a self, place: &Placement, progress: &dyn Progress) -> Result<Box<dyn Staged + 'a>> {
        let mut layers = Vec::with_capacity(self.layers.len());
        let mut first = 0u64;
        for ((mode, source), ids) in self.layers.iter().zip(&self.ids) {
            let left = place.memory.saturating_sub(layers.iter().map(|l: &Layer| l.staged.bytes()).sum());
            let staged = source.stage(&Placement { memory: left, ..*place }, progress)?;
            let facets = staged.facets();
            let reach = source.bounds_in(place.grid_map());
            // Copies along cyclic axes reach anywhere.
            let reach =
                if place.cyclic == [false; 3] { reach } else { Aabb::new(DVec3::NEG_INFINITY, DVec3::INFINITY) };
            let reach = Aabb::new(reach.min - MARGIN, reach.max + MARGIN);
            layers.push(Layer { mode: *mode, staged, ids, first: first as u32, reach });
            first += u64::from(facets);
            if first > u64::from(u32::MAX) {
                let what = "the number of facets of all layers".into();
                return Err(Error::Limit { what, needed: first, allowed: u32::MAX.into() });
            }
        }
        let mut regions: Vec<u64> = layers
            .iter()
            .filter(|l| matches!(l.mode, Mode::Add | Mode::Union | Mode::Set))
            .flat_map(|l| l.staged.regions().iter().copied())
            .collect();
        regions.sort_unstable();
        regions.dedup();
        let width = f64::from(1u32 << place.region_log2());
        Ok(Box::new(StagedLayers { layers, regions, facets: first as u32, width }))
    }
}

struct Layer<'a> {
    mode: Mode,
    staged: Box<dyn Staged + 'a>,
    /// New ids of its materials.
    ids: &'a [u16],
    /// Number of its first facet.
    first: u32,
    /// Box of its matter.
    reach: Aabb,
}

struct StagedLayers<'a> {
    layers: Vec<Layer<'a>>,
    regions: Vec<u64>,
    facets: u32,
    /// Width of a region, in voxels.
    width: f64,
}

/// Distance beneath and above a face at which it is asked what is there, in voxels: far more than surfaces are off where two
/// of them agree, far less than what is seen.
const BENEATH: f64 = 1e-3;
/// A layer's box is taken larger by this, in voxels.
const MARGIN: f64 = 0.01;
/// Halvings by which a cut is found.
const STEPS: usize = 24;
/// Halvings of a facet, within a voxel, whose corners do not tell how it is to be cut.
const SPLITS: usize = 4;

/// Whose level decides whether a facet stays.
#[derive(Clone, Copy)]
enum Other {
    /// One layer.
    Layer(usize),
    /// All layers before this one together.
    Before(usize),
}

/// A facet stays where the other's level, at a distance above the facet, is below 0 (or not).
#[derive(Clone, Copy)]
struct Filter {
    other: Other,
    above: f64,
    within: bool,
}

impl StagedLayers<'_> {
    /// Signed distance to the matter that the first `count` layers leave: negative within.
    fn level_of(&self, count: usize, at: DVec3) -> f64 {
        let mut level = f64::INFINITY;
        for layer in &self.layers[..count] {
            let own = || self.level_of_layer(layer, at);
            level = match layer.mode {
                Mode::Add | Mode::Union | Mode::Set => level.min(own()),
                // What is left of nothing is nothing.
                _ if level > 0.0 => level,
                Mode::Subtract => level.max(-own()),
                Mode::Multiply => level.max(own()),
                Mode::Normals | Mode::Opacity | Mode::Threshold => level,
            };
        }
        level
    }

    fn level_of_layer(&self, layer: &Layer, at: DVec3) -> f64 {
        let near = at.cmpge(layer.reach.min).all() && at.cmple(layer.reach.max).all();
        if near { layer.staged.implicit_value(at) } else { 1.0 }
    }

    fn level_by(&self, other: Other, at: DVec3) -> f64 {
        match other {
            Other::Layer(i) => self.level_of_layer(&self.layers[i], at),
            Other::Before(i) => self.level_of(i, at),
        }
    }

    /// Filters that decide whether facets of layer `i` stay.
    fn filters(&self, i: usize, solid: bool) -> Vec<Filter> {
        let beneath = if solid { -BENEATH } else { 0.0 };
        let above = -beneath;
        let mut filters = Vec::new();
        let before = Other::Before(i);
        match self.layers[i].mode {
            Mode::Subtract => {
                // The face is turned around: what it bounds is above it.
                filters.push(Filter { other: before, above: -beneath, within: true });
                if solid {
                    filters.push(Filter { other: before, above: -above, within: true });
                }
            }
            Mode::Multiply => {
                filters.push(Filter { other: before, above: beneath, within: true });
                if solid {
                    filters.push(Filter { other: before, above, within: true });
                }
            }
            Mode::Union | Mode::Set if i > 0 => {
                filters.push(Filter { other: before, above, within: false });
                if solid && self.layers[i].mode == Mode::Union {
                    filters.push(Filter { other: before, above: beneath, within: false });
                }
            }
            _ => {}
        }
        let beneath = if self.layers[i].mode == Mode::Subtract { -beneath } else { beneath };
        for (j, later) in self.layers.iter().enumerate().skip(i + 1) {
            let other = Other::Layer(j);
            match later.mode {
                Mode::Subtract | Mode::Set => filters.push(Filter { other, above: beneath, within: false }),
                Mode::Multiply => filters.push(Filter { other, above: beneath, within: true }),
                Mode::Union => filters.push(Filter { other, above: -beneath, within: false }),
                _ => {}
            }
        }
        filters
    }

    /// Whether what the first `count` layers leave fills the box, or leaves it empty.
    fn side_of(&self, count: usize, b: &Aabb) -> Option<bool> {
        let mut side = Some(false);
        for layer in &self.layers[..count] {
            let own = || self.side_of_layer(layer, b);
            side = match layer.mode {
                Mode::Add | Mode::Union | Mode::Set => either(side, own()),
                Mode::Subtract => either(side.map(|s| !s), own()).map(|s| !s),
                Mode::Multiply => either(side.map(|s| !s), own().map(|s| !s)).map(|s| !s),
                Mode::Normals | Mode::Opacity | Mode::Threshold => side,
            };
        }
        side
    }

    fn side_of_layer(&self, layer: &Layer, b: &Aabb) -> Option<bool> {
        if layer.reach.overlaps(*b) { layer.staged.is_box_inside(b) } else { Some(false) }
    }

    /// Whether all that is in the box stays by the filter (true), or goes; `None` where it is to be cut.
    fn settled(&self, filter: &Filter, b: &Aabb) -> Option<bool> {
        let b = Aabb::new(b.min - MARGIN, b.max + MARGIN);
        let side = match filter.other {
            Other::Layer(i) => self.side_of_layer(&self.layers[i], &b),
            Other::Before(i) => self.side_of(i, &b),
        };
        side.map(|within| within == filter.within)
    }

    /// Filters that are still to be asked in the box; `None` where nothing stays.
    fn unsettled(&self, filters: &[Filter], b: &Aabb) -> Option<Vec<Filter>> {
        let mut left = Vec::new();
        for filter in filters {
            match self.settled(filter, b) {
                Some(true) => {}
                Some(false) => return None,
                None => left.push(*filter),
            }
        }
        Some(left)
    }

    /// Give what of `polygon`, which lies in one voxel and has the unit normal `normal`, all `filters` let pass.
    fn pass(&self, polygon: &Polygon, normal: DVec3, filters: &[Filter], each: &mut dyn FnMut(&Polygon)) {
        let Some((filter, rest)) = filters.split_first() else { return each(polygon) };
        let offset = filter.above * normal;
        let keeps = |p: DVec3| (self.level_by(filter.other, p + offset) < 0.0) == filter.within;
        cut(polygon, &keeps, SPLITS, &mut |piece| self.pass(piece, normal, rest, each));
    }

    /// The layer of a facet, and its number there.
    fn find(&self, facet: u32) -> (usize, u32) {
        let at = self.layers.partition_point(|l| l.first <= facet) - 1;
        (at, facet - self.layers[at].first)
    }

    /// Layers after `i` of the mode within which `at` is.
    fn later(&self, i: usize, at: DVec3, is: impl Fn(Mode) -> bool) -> impl Iterator<Item = &Layer<'_>> {
        self.layers[i + 1..].iter().filter(move |l| is(l.mode) && self.level_of_layer(l, at) < 0.0)
    }
}

/// Whether a box lies within one of two, of which it is known whether it does.
fn either(a: Option<bool>, b: Option<bool>) -> Option<bool> {
    match (a, b) {
        (Some(true), _) | (_, Some(true)) => Some(true),
        (Some(false), Some(false)) => Some(false),
        _ => None,
    }
}

/// Give what of the convex `polygon` is kept.
fn cut(polygon: &Polygon, keeps: &dyn Fn(DVec3) -> bool, splits: usize, each: &mut dyn FnMut(&Polygon)) {
    let corners = polygon.corners();
    let middle = keeps(polygon.corner_mean());
    let mut kept = [false; crate::geom::polygon::MAX_PIECE_CORNERS];
    for (kept, c) in kept.iter_mut().zip(corners) {
        // Corners on a border of two facets are asked a hair within, so that both sides answer for themselves.
        *kept = keeps(*c + 1e-6 * (polygon.corner_mean() - *c));
    }
    let kept = &kept[..corners.len()];
    let changes = (0..kept.len()).filter(|&i| kept[i] != kept[(i + 1) % kept.len()]).count();
    if changes == 0 && kept.first() == Some(&middle) {
        if middle {
            each(polygon);
        }
        return;
    }
    if changes != 2 && splits > 0 {
        let (lo, hi) = polygon.bounds();
        let size = hi - lo;
        let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).unwrap_or(0);
        let plane = 0.5 * (lo[axis] + hi[axis]);
        if lo[axis] < plane && plane < hi[axis] {
            return polygon.split(axis, plane).iter().for_each(|piece| cut(piece, keeps, splits - 1, each));
        }
    }
    if changes != 2 {
        if middle {
            each(polygon);
        }
        return;
    }
    let mut out = Vec::with_capacity(corners.len() + 1);
    for (i, &from) in corners.iter().enumerate() {
        let j = (i + 1) % corners.len();
        let to = corners[j];
        if kept[i] {
            out.push(from);
        }
        if kept[i] != kept[j] {
            let (mut inner, mut outer) = if kept[i] { (from, to) } else { (to, from) };
            for _ in 0..STEPS {
                let half = 0.5 * (inner + outer);
                if keeps(half) { inner = half } else { outer = half }
            }
            out.push(inner);
        }
    }
    Polygon::from_convex(&out, polygon.facet, each);
}

impl Staged for StagedLayers<'_> {
    fn regions(&self) -> &[u64] {
        &self.regions
    }

    fn weight(&self, region: usize) -> u64 {
        let code = self.regions[region];
        let of = |l: &Layer| l.staged.regions().binary_search(&code).map_or(0, |i| l.staged.weight(i));
        self.layers.iter().map(of).sum()
    }

    fn facets(&self) -> u32 {
        self.facets
    }

    fn bytes(&self) -> u64 {
        self.layers.iter().map(|l| l.staged.bytes()).sum::<u64>() + size_of_val(&self.regions[..]) as u64
    }

    fn emit(&self, region: usize, each: &mut dyn FnMut(&Polygon)) {
        let code = self.regions[region];
        let corner = DVec3::from(morton::decode(code).map(f64::from)) * self.width;
        for (i, layer) in self.layers.iter().enumerate() {
            let Ok(own) = layer.staged.regions().binary_search(&code) else { continue };
            if !layer.mode.draws() {
                continue;
            }
            let turned = layer.mode == Mode::Subtract;
            // Outside, inside, frontier: by region first, then by facet.
            let whole = Aabb::new(corner, corner + self.width);
            let filters = [false, true].map(|solid| self.unsettled(&self.filters(i, solid), &whole));
            if filters.iter().all(Option::is_none) {
                continue;
            }
            layer.staged.emit(own, &mut |polygon| {
                let solid = layer.staged.one_sided(polygon.facet) && layer.staged.closed(polygon.facet);
                let Some(filters) = &filters[usize::from(solid)] else { return };
                let mut numbered = *polygon;
                numbered.facet += layer.first;
                let (lo, hi) = numbered.bounds();
                let Some(filters) = &self.unsettled(filters, &Aabb::new(lo, hi)) else { return };
                if filters.is_empty() {
                    return if turned { each(&numbered.reversed()) } else { each(&numbered) };
                }
                let Some(normal) = numbered.area_vector().try_normalize() else { return };
                let mut room = None;
                let Some(numbered) = numbered.clip(corner, corner + self.width, &mut room) else { return };
                numbered.split_voxels(&mut |piece, _| {
                    self.pass(piece, normal, filters, &mut |left| {
                        if turned { each(&left.reversed()) } else { each(left) }
                    });
                });
            });
        }
    }

    fn surface(&self, facet: u32, at: DVec3, width: f64) -> Surface {
        let (i, local) = self.find(facet);
        let mut surface = self.layers[i].staged.surface(local, at, width);
        for layer in self.later(i, at, |m| matches!(m, Mode::Opacity | Mode::Threshold)) {
            let value = layer.staged.surface(0, at, width).alpha;
            surface.alpha = match layer.mode {
                Mode::Opacity => surface.alpha * value,
                _ => f32::from(u8::from(surface.alpha >= value)),
            };
        }
        surface
    }

    fn material(&self, facet: u32) -> u16 {
        let (i, local) = self.find(facet);
        let layer = &self.layers[i];
        layer.ids.get(usize::from(layer.staged.material(local))).copied().unwrap_or(0)
    }

    fn has_alpha(&self, facet: u32) -> bool {
        let (i, local) = self.find(facet);
        let changed = |l: &Layer| matches!(l.mode, Mode::Opacity | Mode::Threshold);
        self.layers[i].staged.has_alpha(local) || self.layers[i + 1..].iter().any(changed)
    }

    fn alpha_sampler(&self, facet: u32) -> Option<Box<dyn AlphaSampler + '_>> {
        let (i, local) = self.find(facet);
        let changed = |l: &Layer| matches!(l.mode, Mode::Opacity | Mode::Threshold);
        if self.layers[i + 1..].iter().any(changed) { None } else { self.layers[i].staged.alpha_sampler(local) }
    }

    fn one_sided(&self, facet: u32) -> bool {
        let (i, local) = self.find(facet);
        self.layers[i].staged.one_sided(local)
    }

    fn closed(&self, facet: u32) -> bool {
        let (i, local) = self.find(facet);
        self.layers[i].staged.closed(local)
    }

    fn normal(&self, facet: u32, at: DVec3, own: DVec3) -> DVec3 {
        let (i, local) = self.find(facet);
        let own = self.layers[i].staged.normal(local, at, own);
        let Some(layer) = self.later(i, at, |m| m == Mode::Normals).last() else { return own };
        let slope = |d: DVec3| layer.staged.implicit_value(at + 0.25 * d) - layer.staged.implicit_value(at - 0.25 * d);
        let along = DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z));
        along.try_normalize().map_or(own, |n| if n.dot(own) < 0.0 { -n } else { n })
    }

    fn medium(&self, region: usize, each: &mut dyn FnMut(&Medium)) {
        let code = self.regions[region];
        let mut media: Vec<Medium> = Vec::new();
        let mut givers = 0;
        for layer in &self.layers {
            let own = layer.staged.regions().binary_search(&code).ok();
            let within = |m: &Medium| self.level_of_layer(layer, DVec3::from(m.at.map(f64::from)) + 0.5) < 0.0;
            match layer.mode {
                Mode::Subtract | Mode::Set => media = mix(&media, &|m| !within(m)),
                Mode::Multiply => media = mix(&media, &within),
                Mode::Opacity | Mode::Threshold => {
                    media = mix(&media, &|_| true);
                    for m in media.iter_mut().filter(|m| within(m)) {
                        let value = layer.staged.surface(0, DVec3::from(m.at.map(f64::from)) + 0.5, 0.0).alpha;
                        // What a voxel of it covers is what is compared.
                        let stays = layer.mode == Mode::Opacity || 1.0 - libm::exp(-m.extinction) >= f64::from(value);
                        m.extinction *=
                            if layer.mode == Mode::Opacity { value.into() } else { f64::from(u8::from(stays)) };
                    }
                    media.retain(Medium::is_valid);
                }
                Mode::Add | Mode::Union | Mode::Normals => {}
            }
            if let Some(own) = own.filter(|_| layer.mode.draws()) {
                let before = media.len();
                let renamed = |m: &Medium| Medium { materials: renamed(&m.materials, layer.ids), ..*m };
                layer.staged.medium(own, &mut |m| media.push(renamed(m)));
                givers += usize::from(media.len() > before);
            }
        }
        if givers > 0 && self.layers.len() > 1 {
            media = mix(&media, &|m| !self.inside(DVec3::from(m.at.map(f64::from)) + 0.5));
        }
        media.iter().for_each(each);
    }

    fn inside(&self, at: DVec3) -> bool {
        let mut within = false;
        for layer in &self.layers {
            let near = at.cmpge(layer.reach.min).all() && at.cmple(layer.reach.max).all();
            let own = || near && layer.staged.inside(at);
            within = match layer.mode {
                Mode::Add | Mode::Union | Mode::Set => within || own(),
                Mode::Subtract => within && !own(),
                Mode::Multiply => within && own(),
                Mode::Opacity => within && !(own() && layer.staged.surface(0, at, 0.0).alpha < 1.0),
                Mode::Threshold | Mode::Normals => within,
            };
        }
        within
    }

    fn implicit_value(&self, at: DVec3) -> f64 {
        self.level_of(self.layers.len(), at)
    }

    fn is_box_inside(&self, b: &Aabb) -> Option<bool> {
        self.side_of(self.layers.len(), b)
    }
}

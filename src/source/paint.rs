//! Colour, opacity and roughness laid on any source: even, by a picture, or varying through space.
//!
//! Based on: D. Peachey, *Solid Texturing of Complex Surfaces*, SIGGRAPH 1985; J. Blinn, *Simulation of Wrinkled Surfaces*,
//! SIGGRAPH 1978 (normals tilted by the slope of a height).

use std::sync::Arc;

use super::placement::Placement;
use super::traits::{AlphaSampler, Source, Staged, Surface};
use crate::geom::polygon::Polygon;
use crate::geom::{Aabb, DAffine3, DVec3};
use crate::progress::Progress;
use crate::scene::Texture;
use crate::source::Medium;
use crate::volume::Mix;
use crate::volume::surface::SurfaceMeans;
use crate::{Result, Warnings};

/// A value at every point of the source's own space.
pub type Varying<T> = Arc<dyn Fn(DVec3) -> T + Send + Sync>;

/// A colour at a point of the source's own space, averaged over about a width (source units).
pub type Colouring = Arc<dyn Fn(DVec3, f64) -> [f32; 4] + Send + Sync>;

/// Colours that are laid on.
#[derive(Default, Clone)]
pub struct Paint {
    /// Linear Rec. 709, and the share that is there.
    pub colour: Option<Colouring>,
    /// Whether the colour's share is below 1 anywhere.
    pub cuts: bool,
    /// Multiply the source's own colours, and don't replace them.
    pub tint: bool,
    /// Share that is there, in [0, 1].
    pub opacity: Option<Varying<f64>>,
    /// The slope of a height above the surface.
    pub bump: Option<Varying<DVec3>>,
    /// Name of all of its matter, whatever it was called before.
    pub material: Option<String>,
    /// Share of the diffuse light that comes through what the source does not say so of.
    pub translucency: Vec<Translucency>,
}

/// Light that comes through a material.
#[derive(Debug, Clone, PartialEq)]
pub struct Translucency {
    /// Name of the material; `None`: of all that are not named.
    pub material: Option<String>,
    /// Share of what it reflects that comes out on its other side, in [0, 0.9].
    pub share: f64,
}

/// Projection by which a picture is laid on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// From the corner `origin` along two axes, of a picture so wide and high; it repeats itself.
    Planar {
        /// Lower left corner of the picture.
        origin: DVec3,
        /// From there along the picture's width, as long as it is wide.
        right: DVec3,
        /// From there along its height, as long as it is high.
        up: DVec3,
    },
    /// Around the axis `up` (unit) through `origin`, once; so high.
    Cylindrical {
        /// Point of the axis at the picture's lower edge.
        origin: DVec3,
        /// Unit direction of the axis.
        up: DVec3,
        /// Height of the picture along the axis.
        height: f64,
    },
    /// Around the axis `up` (unit) through `origin`, from pole to pole.
    Spherical {
        /// Middle of the sphere.
        origin: DVec3,
        /// Unit direction of the upper pole.
        up: DVec3,
    },
}

impl Projection {
    /// Texture coordinates at `p` (v from the top), and what of the picture a length of 1 covers there, along u.
    fn place(&self, p: DVec3) -> ([f32; 2], f64) {
        let around = |d: DVec3, up: DVec3| {
            let side = up.any_orthonormal_vector();
            let front = side.cross(up);
            let turn = libm::atan2(d.dot(front), d.dot(side)) / std::f64::consts::TAU;
            (turn - turn.floor(), (d - d.dot(up) * up).length())
        };
        let (u, v, density) = match *self {
            Projection::Planar { origin, right, up } => {
                let d = p - origin;
                let (width, height) = (right.length_squared(), up.length_squared());
                (d.dot(right) / width, 1.0 - d.dot(up) / height, 1.0 / width.sqrt())
            }
            Projection::Cylindrical { origin, up, height } => {
                let d = p - origin;
                let (u, radius) = around(d, up);
                (u, 1.0 - d.dot(up) / height, 1.0 / (std::f64::consts::TAU * radius).max(1e-9))
            }
            Projection::Spherical { origin, up } => {
                let d = p - origin;
                let (u, radius) = around(d, up);
                let v = libm::acos((d.dot(up) / d.length().max(1e-300)).clamp(-1.0, 1.0)) / std::f64::consts::PI;
                (u, v, 1.0 / (std::f64::consts::TAU * radius).max(1e-9))
            }
        };
        ([u as f32, v as f32], density)
    }
}

/// Colours of a picture.
pub fn picture(texture: Texture, projection: Projection) -> Colouring {
    Arc::new(move |p, width| {
        let (uv, density) = projection.place(p);
        let footprint = (width * density).min(1.0) * f64::from(texture.width);
        if footprint > 1.0 { texture.average(uv, footprint as f32) } else { texture.sample(uv) }
    })
}

/// Colours evenly spaced over `along` from 0 to 1, linear in between; at least one.
pub fn ramp(colours: Vec<[f32; 3]>, along: impl Fn(DVec3) -> f64 + Send + Sync + 'static) -> Colouring {
    Arc::new(move |p, _| {
        let last = colours.len().saturating_sub(1);
        let t = (along(p).clamp(0.0, 1.0) * last as f64).max(0.0);
        let i = (t as usize).min(last.saturating_sub(1));
        let f = (t - i as f64) as f32;
        let (a, b) = (colours.get(i), colours.get(i + 1).or(colours.get(i)));
        match (a, b) {
            (Some(a), Some(b)) => {
                let [r, g, b] = std::array::from_fn(|e| a[e] + f * (b[e] - a[e]));
                [r, g, b, 1.0]
            }
            _ => [1.0; 4],
        }
    })
}

/// A source with paint on it.
pub struct PaintedSource {
    inner: Box<dyn Source>,
    paint: Paint,
}

impl PaintedSource {
    /// The source `inner` with `paint` on it.
    pub fn new(inner: Box<dyn Source>, paint: Paint) -> PaintedSource {
        PaintedSource { inner, paint }
    }

    /// What the source's own materials are, by their ids, with the light that the paint lets through.
    fn own_surfaces(&self) -> Vec<SurfaceMeans> {
        let (mut own, names) = (self.inner.surfaces(), self.inner.materials());
        if own.is_empty() && self.paint.translucency.is_empty() {
            return own;
        }
        own.resize(names.len().max(1), SurfaceMeans::default());
        for (k, surface) in own.iter_mut().enumerate().filter(|(_, s)| s.params.is_plain()) {
            let said = |t: &&Translucency| t.material.is_some() && t.material.as_ref() == names.get(k);
            let rest = |t: &&Translucency| t.material.is_none();
            let all = &self.paint.translucency;
            if let Some(t) = all.iter().rfind(said).or(all.iter().rfind(rest)) {
                surface.reflected = [1.0 - t.share; 3];
                surface.params.transmission = [t.share; 3];
            }
        }
        own
    }
}

impl Source for PaintedSource {
    fn bounds(&self) -> Aabb {
        self.inner.bounds()
    }

    fn origin(&self) -> DVec3 {
        self.inner.origin()
    }

    fn bounds_in(&self, transform: DAffine3) -> Aabb {
        self.inner.bounds_in(transform)
    }

    fn metres_per_unit(&self) -> f64 {
        self.inner.metres_per_unit()
    }

    fn facet_size(&self) -> f64 {
        self.inner.facet_size()
    }

    fn has_colour(&self) -> bool {
        self.paint.colour.is_some() || self.inner.has_colour()
    }

    fn materials(&self) -> &[String] {
        self.paint.material.as_ref().map_or(self.inner.materials(), std::slice::from_ref)
    }

    fn surfaces(&self) -> Vec<SurfaceMeans> {
        let own = self.own_surfaces();
        if own.is_empty() || self.paint.material.is_none() { own } else { vec![SurfaceMeans::mean(&own)] }
    }

    fn warnings(&self) -> &Warnings {
        self.inner.warnings()
    }

    fn notes(&self) -> &[String] {
        self.inner.notes()
    }

    fn up(&self) -> u8 {
        self.inner.up()
    }

    fn is_inside_exact(&self) -> bool {
        self.inner.is_inside_exact()
    }

    fn stage<'a>(&'a self, place: &Placement, progress: &dyn Progress) -> Result<Box<dyn Staged + 'a>> {
        let inner = self.inner.stage(place, progress)?;
        let to_source = place.grid_map().inverse();
        let unit = libm::cbrt(to_source.matrix3.determinant().abs());
        let (before, repainted) = (self.inner.surfaces(), self.paint.colour.is_some() && !self.paint.tint);
        let share = |(k, s): (usize, SurfaceMeans)| {
            // What the source says of its light is in its own colours already.
            let said = before.get(k).is_some_and(|b| !b.params.is_plain());
            if said && !repainted { [1.0; 3] } else { s.ratio().map(|r| (1.0 / (1.0 + r)) as f32) }
        };
        let reflected = self.own_surfaces().into_iter().enumerate().map(share).collect();
        Ok(Box::new(StagedPaint { inner, paint: &self.paint, to_source, unit, reflected }))
    }
}

struct StagedPaint<'a> {
    inner: Box<dyn Staged + 'a>,
    paint: &'a Paint,
    to_source: DAffine3,
    /// Source units in a voxel's edge.
    unit: f64,
    /// Share of each of the source's materials that is reflected of what they send back and let through; none where all is.
    reflected: Vec<[f32; 3]>,
}

impl StagedPaint<'_> {
    /// Colour and share at `at` of what has the colour `own`.
    fn surface_of(&self, own: Surface, at: DVec3, width: f64) -> Surface {
        let p = self.to_source.transform_point3(at);
        let mut s = own;
        if let Some(colour) = &self.paint.colour {
            let [r, g, b, alpha] = colour(p, width * self.unit);
            let factor = if self.paint.tint { s.albedo } else { [1.0; 3] };
            s.albedo = [r * factor[0], g * factor[1], b * factor[2]].map(|v| v.clamp(0.0, 1.0));
            s.alpha *= alpha;
        }
        if let Some(opacity) = &self.paint.opacity {
            s.alpha *= opacity(p).clamp(0.0, 1.0) as f32;
        }
        s
    }

    /// The part of `albedo` that is reflected by what shows of the source's materials.
    fn reflected(&self, albedo: [f32; 3], materials: impl Iterator<Item = (u16, f64)>) -> [f32; 3] {
        if self.reflected.is_empty() {
            return albedo;
        }
        let mut share = [0.0; 3];
        for (id, weight) in materials {
            let own = self.reflected.get(usize::from(id)).copied().unwrap_or([1.0; 3]);
            share.iter_mut().zip(own).for_each(|(s, o)| *s += weight as f32 * o);
        }
        [0, 1, 2].map(|k| albedo[k] * share[k])
    }
}

impl Staged for StagedPaint<'_> {
    fn regions(&self) -> &[u64] {
        self.inner.regions()
    }

    fn weight(&self, region: usize) -> u64 {
        self.inner.weight(region)
    }

    fn facets(&self) -> u32 {
        self.inner.facets()
    }

    fn bytes(&self) -> u64 {
        self.inner.bytes()
    }

    fn emit(&self, region: usize, each: &mut dyn FnMut(&Polygon)) {
        self.inner.emit(region, each);
    }

    fn surface(&self, facet: u32, at: DVec3, width: f64) -> Surface {
        let s = self.surface_of(self.inner.surface(facet, at, width), at, width);
        let own = std::iter::once((self.inner.material(facet), 1.0));
        Surface { albedo: self.reflected(s.albedo, own), ..s }
    }

    fn material(&self, facet: u32) -> u16 {
        if self.paint.material.is_some() { 0 } else { self.inner.material(facet) }
    }

    fn closed(&self, facet: u32) -> bool {
        self.inner.closed(facet)
    }

    fn has_alpha(&self, facet: u32) -> bool {
        self.paint.opacity.is_some() || self.paint.cuts || self.inner.has_alpha(facet)
    }

    fn alpha_sampler(&self, facet: u32) -> Option<Box<dyn AlphaSampler + '_>> {
        let own = self.paint.opacity.is_none() && !self.paint.cuts;
        if own { self.inner.alpha_sampler(facet) } else { None }
    }

    fn one_sided(&self, facet: u32) -> bool {
        self.inner.one_sided(facet)
    }

    fn normal(&self, facet: u32, at: DVec3, own: DVec3) -> DVec3 {
        let own = self.inner.normal(facet, at, own);
        let Some(bump) = &self.paint.bump else { return own };
        // The slope of the height, in voxels per voxel, along the grid's axes.
        let slope = self.to_source.matrix3.transpose() * bump(self.to_source.transform_point3(at)) / self.unit;
        (own - (slope - slope.dot(own) * own)).try_normalize().unwrap_or(own)
    }

    fn medium(&self, region: usize, each: &mut dyn FnMut(&Medium)) {
        self.inner.medium(region, &mut |m| {
            let edge = f64::from(1u32 << m.edge_log2);
            let at = DVec3::from(m.at.map(f64::from)) + 0.5 * edge;
            let s = self.surface_of(Surface { albedo: m.albedo, alpha: 1.0 }, at, edge);
            let albedo = self.reflected(s.albedo, m.materials.weights().map(|(id, share)| (id.into(), share)));
            let materials = if self.paint.material.is_some() { Mix::default() } else { m.materials };
            each(&Medium { albedo, extinction: m.extinction * f64::from(s.alpha), materials, ..*m });
        });
    }

    fn inside(&self, at: DVec3) -> bool {
        // What lets light through is not opaque within.
        self.paint.opacity.is_none() && self.inner.inside(at)
    }

    fn implicit_value(&self, at: DVec3) -> f64 {
        self.inner.implicit_value(at)
    }

    fn is_box_inside(&self, b: &Aabb) -> Option<bool> {
        self.inner.is_box_inside(b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ramps_pass_through_their_colours() {
        let ramp = ramp(vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0; 3]], |p| p.x);
        let at = |x: f64| ramp(DVec3::new(x, 0.0, 0.0), 0.0);
        assert_eq!(at(-1.0), [0.0, 0.0, 0.0, 1.0]);
        assert_eq!(at(0.25), [0.5, 0.0, 0.0, 1.0]);
        assert_eq!(at(0.5), [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(at(9.0), [1.0; 4]);
    }

    #[test]
    fn pictures_are_laid_on_as_said() {
        let texture = Texture::new("t", 2, 1, vec![[255, 0, 0, 255], [0, 0, 255, 255]]);
        let plane = Projection::Planar { origin: DVec3::ONE, right: 4.0 * DVec3::X, up: 2.0 * DVec3::Y };
        let colour = picture(texture.clone(), plane);
        // The middles of the two texels.
        assert_eq!(colour(DVec3::new(2.0, 1.5, 7.0), 0.0), [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(colour(DVec3::new(4.0, 1.5, 7.0), 0.0), [0.0, 0.0, 1.0, 1.0]);
        // As wide as the picture: its mean.
        let mean = colour(DVec3::new(3.0, 1.5, 7.0), 4.0);
        assert!((mean[0] - 0.5).abs() < 0.01 && (mean[2] - 0.5).abs() < 0.01, "{mean:?}");
        let round = Projection::Spherical { origin: DVec3::ZERO, up: DVec3::Z };
        let ((a, _), (b, _)) = (round.place(DVec3::new(1.0, 2.0, 0.0)), round.place(DVec3::new(-1.0, -2.0, 0.0)));
        assert!(((a[0] - b[0]).abs() - 0.5).abs() < 1e-6 && a[1] == 0.5);
    }
}

//! What the turtle draws: limbs, polygons and placed surfaces, within the memory that is allowed.

use std::collections::BTreeMap;

use super::grammar::Surface;
use crate::geom::{DAffine3, DMat3, DVec3};
use crate::scene::model::Part;
use crate::scene::triangulate::Triangulator;
use crate::source::curve::Strand;
use crate::{Error, Result, Warnings};

/// Largest number of corners of a polygon. Triangulating larger ones takes too long.
const MAX_CORNERS: usize = 1 << 16;

/// Bytes per segment: its end in the limb, in the source that is made of the limb (a list that grows by doubling), and in a
/// path. 126 bytes each were measured for two million segments in a row.
const SEGMENT_BYTES: usize = 126;

/// Cones that make a ball. Inscribed, its shadow from the side is sin x / x of a circle's, x = π / 16: 0.6 % less.
const BALL_CONES: usize = 16;
/// Corners of a disc. Inscribed, its area is sin x / x of a circle's, x = π / 16: 0.6 % less.
const DISC_CORNERS: usize = 32;

/// Geometry drawn so far.
#[derive(Debug, Default)]
pub struct Plant {
    /// Chains of segments.
    pub limbs: Vec<Strand>,
    /// Triangles of polygons, with their colours, by material.
    pub polygons: BTreeMap<u16, Part>,
    /// Transforms of the copies of each surface that is a mesh.
    pub meshes: BTreeMap<char, Vec<DAffine3>>,
    pub counts: Counts,
    pub warnings: Warnings,
    /// Approximate bytes of memory of all of it.
    pub bytes: usize,
}

/// Number of primitives drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Terminal segments: F and G.
    pub segments: u64,
    /// `{…}` and surfaces that are polygons.
    pub polygons: u64,
    /// Surfaces that are meshes.
    pub meshes: u64,
}

/// A chain of segments to which more may be added.
#[derive(Debug, Clone, Default)]
pub struct Limb {
    pub points: Vec<DVec3>,
    pub radii: Vec<f32>,
    pub colour: [f32; 3],
    pub material: u16,
    /// Whether the last radius was given as the end width of its segment, so that only a segment of exactly that width continues it.
    pub fixed: bool,
}

/// Colour and material in which primitives are drawn.
#[derive(Debug, Clone, Copy)]
pub struct DrawStyle {
    pub colour: [f32; 3],
    pub material: u16,
}

impl Plant {
    /// Draw a segment of the width `width` at its start and `end`, if given, at its end. It continues `limb` where width, colour and
    /// material allow that, and else begins another limb.
    pub fn segment(&mut self, limb: &mut Limb, [from, to]: [DVec3; 2], width: f64, end: Option<f64>, style: DrawStyle) {
        self.counts.segments += 1;
        let radius = (0.5 * width) as f32;
        // A limb thins as its segments do; where it gets wider, or another colour, another begins.
        let goes_on = limb.colour == style.colour
            && limb.material == style.material
            && limb.radii.last().is_some_and(|r| if limb.fixed { *r == radius } else { *r >= radius });
        if !goes_on {
            self.end_limb(limb);
        }
        match limb.radii.last_mut() {
            Some(last) => *last = radius,
            None => {
                (limb.colour, limb.material) = (style.colour, style.material);
                limb.points.push(from);
                limb.radii.push(radius);
            }
        }
        limb.points.push(to);
        limb.radii.push(end.map_or(radius, |w| (0.5 * w) as f32));
        limb.fixed = end.is_some();
        self.bytes += SEGMENT_BYTES;
    }

    pub fn end_limb(&mut self, limb: &mut Limb) {
        let limb = std::mem::take(limb);
        if limb.points.len() > 1 {
            self.strand(limb.points, limb.radii, DrawStyle { colour: limb.colour, material: limb.material });
        }
    }

    fn strand(&mut self, points: Vec<DVec3>, radii: Vec<f32>, style: DrawStyle) {
        let [r, g, b] = style.colour;
        let colours = vec![[r, g, b, 1.0]];
        self.limbs.push(Strand { points, radii, colours, material: style.material, ..Strand::default() });
        self.bytes += 2 * size_of::<Strand>() + size_of::<[f32; 4]>();
    }

    /// Draw a ball around `centre`, as cones along `axis`.
    pub fn ball(&mut self, centre: DVec3, axis: DVec3, radius: f64, style: DrawStyle) {
        let ring = |i: usize| super::expr::sin_cos(180.0 * i as f64 / BALL_CONES as f64);
        let points = (0..=BALL_CONES).map(|i| centre - ring(i).1 * radius * axis).collect();
        let radii = (0..=BALL_CONES).map(|i| (ring(i).0 * radius) as f32).collect();
        self.strand(points, radii, style);
        self.counts.segments += 1;
        self.bytes += SEGMENT_BYTES * BALL_CONES;
    }

    /// Draw a disc around `centre` in the plane of two axes.
    pub fn disc(
        &mut self,
        triangulator: &mut Triangulator,
        centre: DVec3,
        [a, b]: [DVec3; 2],
        radius: f64,
        style: DrawStyle,
    ) {
        let corner = |i: usize| {
            let (sin, cos) = super::expr::sin_cos(360.0 * i as f64 / DISC_CORNERS as f64);
            centre + radius * (cos * a + sin * b)
        };
        let corners: Vec<DVec3> = (0..DISC_CORNERS).map(corner).collect();
        self.fill(triangulator, &corners, style);
    }

    /// Add a corner to the innermost of the polygons that are open.
    ///
    /// # Errors
    /// [`Error::Limit`] where a polygon has too many.
    pub fn corner(&mut self, open: &mut [Vec<DVec3>], position: DVec3) -> Result<()> {
        let Some(polygon) = open.last_mut() else {
            self.warnings.add("a . outside of { } is left out");
            return Ok(());
        };
        // Corners in the same place are one.
        if polygon.last() != Some(&position) {
            polygon.push(position);
            self.bytes += size_of::<DVec3>();
        }
        if polygon.len() > MAX_CORNERS {
            return Err(Error::Limit {
                what: "a polygon of the L-system, in corners,".into(),
                needed: polygon.len() as u64,
                allowed: MAX_CORNERS as u64,
            });
        }
        Ok(())
    }

    /// Fill a polygon as its corners were given.
    pub fn polygon(&mut self, triangulator: &mut Triangulator, mut polygon: Vec<DVec3>, style: DrawStyle) {
        let Some(&first) = polygon.first() else {
            self.warnings.add("polygons of fewer than three corners are left out");
            return;
        };
        // The start may be given again at the end, but for roundings.
        let size = polygon.iter().fold(0.0, |s: f64, p| s.max((*p - first).length()));
        while polygon.len() > 1 && polygon.last().is_some_and(|last| (*last - first).length() <= 1e-9 * size) {
            polygon.pop();
        }
        if polygon.len() < 3 {
            self.warnings.add("polygons of fewer than three corners are left out");
            return;
        }
        self.fill(triangulator, &polygon, style);
    }

    fn fill(&mut self, triangulator: &mut Triangulator, polygon: &[DVec3], style: DrawStyle) {
        let [r, g, b] = style.colour;
        let part = self.polygons.entry(style.material).or_default();
        let first = part.positions.len() as u32;
        part.positions.extend(polygon.iter().map(|p| p.as_vec3().to_array()));
        part.colors.get_or_insert_default().resize(part.positions.len(), [r, g, b, 1.0]);
        let before = part.triangles.len();
        triangulator.triangulate(polygon, |t| part.triangles.push(t.map(|i| first + i as u32)));
        self.counts.polygons += 1;
        self.bytes += polygon_bytes(polygon.len(), part.triangles.len() - before);
    }

    /// Draw `surface`, which `symbol` names, in the turtle's `frame` at `position`, scaled to its right, ahead and up. The
    /// material of `style` is the surface's.
    pub fn place(
        &mut self,
        triangulator: &mut Triangulator,
        (symbol, surface): (char, &Surface),
        (position, frame): (DVec3, DMat3),
        [x, y, z]: [f64; 3],
        style: DrawStyle,
    ) {
        let axes = DMat3::from_cols(-x * frame.y_axis, y * frame.x_axis, z * frame.z_axis);
        let to_world = DAffine3::from_mat3_translation(axes, position);
        match surface {
            Surface::Polygon { corners, colour } => {
                let corners: Vec<DVec3> = corners.iter().map(|c| to_world.transform_point3(*c)).collect();
                self.fill(triangulator, &corners, DrawStyle { colour: colour.unwrap_or(style.colour), ..style });
            }
            Surface::Patches { positions, colours, triangles, .. } => {
                let part = self.polygons.entry(style.material).or_default();
                let first = part.positions.len() as u32;
                part.positions.extend(positions.iter().map(|p| to_world.transform_point3(*p).as_vec3().to_array()));
                let colours = colours.iter().map(|c| c.unwrap_or(style.colour)).map(|[r, g, b]| [r, g, b, 1.0]);
                part.colors.get_or_insert_default().extend(colours);
                part.triangles.extend(triangles.iter().map(|t| t.map(|i| first + i)));
                self.counts.polygons += 1;
                self.bytes += polygon_bytes(positions.len(), triangles.len());
            }
            Surface::Mesh { .. } => {
                self.meshes.entry(symbol).or_default().push(to_world);
                self.counts.meshes += 1;
                self.bytes += 4 * size_of::<DAffine3>();
            }
        }
    }
}

/// Approximate bytes of memory of a polygon: the analysis of the mesh takes as much again as the mesh, and more.
fn polygon_bytes(corners: usize, triangles: usize) -> usize {
    2 * (28 * corners + 100 * triangles)
}

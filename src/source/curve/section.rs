//! Outlines of sections, the rings that they make at a path's knots, and the facets between rings.

use std::f64::consts::{PI, TAU};

use super::Section;
use super::path::Knot;
use crate::geom::polygon::{MAX_CORNERS, Polygon};
use crate::geom::{DAffine3, DVec2, DVec3};

/// Sides of a round section of a radius in voxels: odd, because an odd polygon's width varies as little as that of one of
/// twice as many sides, and so many that the chords stay within 1/16 voxel of the circle of the same perimeter: they are
/// r π² / 3 n² within it, and half as much beyond.
pub fn sides(radius: f64) -> u16 {
    let least = PI * (16.0 / 3.0 * radius.min(4096.0)).sqrt();
    (least.ceil() as u16).max(3) | 1
}

/// Farthest distance of a section's outline from its path, in half widths.
pub fn reach(section: Section) -> f64 {
    match section {
        Section::Round => 1.0,
        Section::Rectangular { thickness } => f64::from(thickness).hypot(1.0),
        Section::V { angle } => 1.0 / libm::sin(0.5 * f64::from(angle)),
    }
}

/// Test whether the section encloses an area.
pub fn closed(section: Section) -> bool {
    match section {
        Section::Round => true,
        Section::Rectangular { thickness } => thickness > 0.0,
        Section::V { .. } => false,
    }
}

/// Regular polygons of 3 sides and more, on the unit circle.
pub struct Circles(Vec<Vec<DVec2>>);

impl Circles {
    pub fn new(most: u16) -> Circles {
        let corner = |n: usize| move |i: usize| TAU * i as f64 / n as f64;
        let circle = |n: usize| (0..n).map(corner(n)).map(|a| DVec2::new(libm::cos(a), libm::sin(a))).collect();
        Circles((3..=usize::from(most).max(4)).map(circle).collect())
    }

    fn of(&self, sides: usize) -> &[DVec2] {
        &self.0[sides.clamp(3, self.0.len() + 2) - 3]
    }
}

/// Sweeps sections; keeps its working memory between pieces.
pub struct Sweep<'a> {
    circles: &'a Circles,
    /// Source space → grid, and whether it mirrors.
    to_grid: DAffine3,
    mirrored: bool,
    outline: Vec<DVec2>,
    rings: [Vec<DVec3>; 2],
}

/// A plane that a piece ends in: where the path of direction `way` turns to `next`.
pub struct Cut {
    pub at: DVec3,
    pub radius: f64,
    pub next: DVec3,
}

/// The frame of a piece: the direction of its path, and what is along the section's width.
#[derive(Clone, Copy)]
pub struct Frame {
    pub way: DVec3,
    pub across: DVec3,
}

impl<'a> Sweep<'a> {
    pub fn new(circles: &'a Circles, to_grid: DAffine3) -> Sweep<'a> {
        let mirrored = to_grid.matrix3.determinant() < 0.0;
        Sweep { circles, to_grid, mirrored, outline: Vec::new(), rings: Default::default() }
    }

    /// Take the section of a knot.
    pub fn section(&mut self, section: Section, sides: u16) {
        self.outline.clear();
        match section {
            Section::Round => {
                let n = usize::from(sides);
                // The perimeter is the circle's, so areas and mean projected widths are too (Cauchy).
                let half = PI / n as f64;
                let factor = half / libm::sin(half);
                self.outline.extend(self.circles.of(n).iter().map(|p| factor * *p));
            }
            Section::Rectangular { thickness } => {
                let t = f64::from(thickness);
                let corners = [(-1.0, -t), (1.0, -t), (1.0, t), (-1.0, t)].map(DVec2::from);
                let count = if t > 0.0 { 4 } else { 2 };
                self.outline.extend_from_slice(&corners[..count]);
            }
            Section::V { angle } => {
                let half = 0.5 * f64::from(angle);
                let height = libm::cos(half) / libm::sin(half);
                self.outline.extend([(-1.0, height), (0.0, 0.0), (1.0, height)].map(DVec2::from));
            }
        }
    }

    /// Ring `which` in the grid: the outline in `frame` at the cut's place, slid along the path into its plane.
    pub fn ring(&mut self, which: usize, frame: Frame, cut: &Cut) {
        let over = frame.way.cross(frame.across);
        let mitre = frame.way + cut.next;
        let slope = frame.way * (1.0 / frame.way.dot(mitre));
        let ring = &mut self.rings[which];
        ring.clear();
        for p in &self.outline {
            let offset = cut.radius * (p.x * frame.across + p.y * over);
            ring.push(self.to_grid.transform_point3(cut.at + offset - slope * offset.dot(mitre)));
        }
    }

    fn give(&self, corners: &mut [DVec3], facet: u32, each: &mut dyn FnMut(&Polygon)) {
        if self.mirrored {
            corners.reverse();
        }
        each(&Polygon::new(corners, facet));
    }

    /// The facets between both rings.
    pub fn sides(&self, closed: bool, facet: u32, each: &mut dyn FnMut(&Polygon)) {
        let [low, high] = &self.rings;
        let n = low.len();
        for i in 0..if closed { n } else { n - 1 } {
            let j = (i + 1) % n;
            let mut quad = [low[i], low[j], high[j], high[i]];
            if flat(&quad) {
                self.give(&mut quad, facet, each);
            } else {
                let [a, b, c, d] = quad;
                self.give(&mut [a, b, c], facet, each);
                self.give(&mut [a, c, d], facet, each);
            }
        }
    }

    /// The face that closes the path in the plane of ring `which`.
    pub fn cap(&self, which: usize, facet: u32, each: &mut dyn FnMut(&Polygon)) {
        let ring = &self.rings[which];
        let mut next = 1;
        while next + 1 < ring.len() {
            let last = (next + MAX_CORNERS - 2).min(ring.len() - 1);
            let mut corners = [ring[0]; MAX_CORNERS];
            let count = last - next + 2;
            corners[1..count].copy_from_slice(&ring[next..=last]);
            if which == 0 {
                corners[..count].reverse();
            }
            self.give(&mut corners[..count], facet, each);
            next = last;
        }
    }

    /// A ball of the radius of `knot` about it, of the area of the sphere.
    pub fn ball(&self, knot: &Knot, facet: u32, each: &mut dyn FnMut(&Polygon)) {
        let m = (usize::from(knot.sides) + 1).max(4);
        let bands = m / 2;
        let row = |j: usize| {
            let a = PI * j as f64 / bands as f64;
            // Poles are points.
            if j == 0 || j == bands { (0.0, if j == 0 { 1.0 } else { -1.0 }) } else { (libm::sin(a), libm::cos(a)) }
        };
        let half = PI / m as f64;
        let (edge, apothem) = (2.0 * libm::sin(half), libm::cos(half));
        let band = |j: usize| {
            let ((r0, z0), (r1, z1)) = (row(j), row(j + 1));
            0.5 * edge * (r0 + r1) * (apothem * (r1 - r0)).hypot(z1 - z0)
        };
        let area: f64 = m as f64 * (0..bands).map(band).sum::<f64>();
        let radius = f64::from(knot.radius) * (4.0 * PI / area).sqrt();
        let circle = self.circles.of(m);
        let at = |(r, z): (f64, f64), k: usize| {
            let c = circle[k % m];
            self.to_grid.transform_point3(knot.at + radius * DVec3::new(r * c.x, r * c.y, z))
        };
        for j in 0..bands {
            let (upper, lower) = (row(j), row(j + 1));
            for k in 0..m {
                let mut quad = [at(lower, k), at(lower, k + 1), at(upper, k + 1), at(upper, k)];
                if j == 0 {
                    self.give(&mut quad[..3], facet, each);
                } else if j + 1 == bands {
                    self.give(&mut quad[1..], facet, each);
                } else {
                    self.give(&mut quad, facet, each);
                }
            }
        }
    }
}

/// Whether a quad may be taken as planar and convex: to 1/256 voxel.
fn flat(q: &[DVec3; 4]) -> bool {
    let near = (q[1] - q[0]).cross(q[3] - q[0]);
    let far = (q[3] - q[2]).cross(q[1] - q[2]);
    let lift = near.dot(q[2] - q[0]).abs();
    lift <= near.length() / 256.0 && near.dot(far) >= 0.0
}

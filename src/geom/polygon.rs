//! Planar convex polygons, cut exactly by the planes between voxels.
//!
//! Based on: I. Sutherland, G. Hodgman, *Reentrant Polygon Clipping*, CACM 1974.
//!
//! Voxels are half-open boxes: a piece that lies in the plane between two voxels belongs to the upper one. So no area is lost
//! or counted twice.

use super::{DAffine3, DVec3};

/// Most corners of a polygon that a source emits.
pub const MAX_CORNERS: usize = 8;
/// Most corners of a piece that is clipped to a box: each of the box's six planes adds at most one.
pub const MAX_PIECE_CORNERS: usize = MAX_CORNERS + 6;

/// Planar convex polygon, and the number of the source's facet that it is a piece of.
#[derive(Debug, Clone, Copy)]
pub struct Polygon {
    corners: [DVec3; MAX_PIECE_CORNERS],
    len: usize,
    /// The source's own number of the facet.
    pub facet: u32,
}

/// Side of a plane on which a polygon lies.
enum Side {
    Below,
    Above,
    Both,
}

/// How a polygon lies among the unit voxels.
pub enum VoxelSplit {
    /// Within one voxel, of this lower corner.
    Inside(DVec3),
    /// Across several, parted by the plane `p[axis] = at`.
    Plane {
        /// 0 x, 1 y or 2 z.
        axis: usize,
        /// Coordinate of the plane along that axis.
        at: f64,
    },
}

impl Polygon {
    /// Polygon of the first [`MAX_CORNERS`] of `corners`; more are ignored.
    pub fn new(corners: &[DVec3], facet: u32) -> Polygon {
        let len = corners.len().min(MAX_CORNERS);
        let mut polygon = Polygon { corners: [DVec3::ZERO; MAX_PIECE_CORNERS], len, facet };
        polygon.corners[..len].copy_from_slice(&corners[..len]);
        polygon
    }

    /// Call `each` with the convex polygon of at most [`MAX_PIECE_CORNERS`] `corners`: as a whole, or in two parts where it has
    /// more than [`MAX_CORNERS`].
    pub fn from_convex(corners: &[DVec3], facet: u32, each: &mut dyn FnMut(&Polygon)) {
        if corners.len() <= MAX_CORNERS {
            return each(&Polygon::new(corners, facet));
        }
        each(&Polygon::new(&corners[..MAX_CORNERS], facet));
        let mut rest = Polygon::new(&corners[MAX_CORNERS - 1..], facet);
        rest.push(corners[0]);
        each(&rest);
    }

    /// Same polygon with its corners in reverse order, so that it faces the other way.
    pub fn reversed(&self) -> Polygon {
        let mut reversed = *self;
        reversed.corners[..self.len].reverse();
        reversed
    }

    /// Corners, in order around the polygon.
    pub fn corners(&self) -> &[DVec3] {
        &self.corners[..self.len]
    }

    /// Area times unit normal, by the right-hand rule.
    pub fn area_vector(&self) -> DVec3 {
        let c = self.corners();
        let mut sum = DVec3::ZERO;
        for i in 2..c.len() {
            sum += (c[i - 1] - c[0]).cross(c[i] - c[0]);
        }
        0.5 * sum
    }

    /// Mean of the corners.
    pub fn corner_mean(&self) -> DVec3 {
        self.corners().iter().sum::<DVec3>() / self.len.max(1) as f64
    }

    /// Polygon moved by `-origin`.
    pub fn relative_to(&self, origin: DVec3) -> Polygon {
        let mut moved = *self;
        for c in &mut moved.corners[..self.len] {
            *c -= origin;
        }
        moved
    }

    /// Polygon scaled by `factor` about the origin.
    pub fn scaled(&self, factor: f64) -> Polygon {
        let mut larger = *self;
        for c in &mut larger.corners[..self.len] {
            *c *= factor;
        }
        larger
    }

    /// Polygon with its corners mapped by `map`.
    pub fn transformed(&self, map: DAffine3) -> Polygon {
        let mut moved = *self;
        for c in &mut moved.corners[..self.len] {
            *c = map.transform_point3(*c);
        }
        moved
    }

    fn side(&self, axis: usize, plane: f64) -> Side {
        let (mut below, mut above) = (false, false);
        for c in self.corners() {
            below |= c[axis] < plane;
            above |= c[axis] > plane;
        }
        match (below, above) {
            (true, true) => Side::Both,
            (true, false) => Side::Below,
            _ => Side::Above,
        }
    }

    fn push(&mut self, p: DVec3) {
        if self.len < MAX_PIECE_CORNERS {
            self.corners[self.len] = p;
            self.len += 1;
        }
    }

    fn empty_like(&self) -> Polygon {
        Polygon { corners: [DVec3::ZERO; MAX_PIECE_CORNERS], len: 0, facet: self.facet }
    }

    /// Pieces below and above the plane `p[axis] = plane`, which must cross the polygon. Both get the same corners on the cut.
    pub fn split(&self, axis: usize, plane: f64) -> [Polygon; 2] {
        let mut pieces = [self.empty_like(), self.empty_like()];
        let [below, above] = &mut pieces;
        let mut from = self.corners[self.len.saturating_sub(1)];
        for &to in self.corners() {
            let (a, b) = (from[axis] - plane, to[axis] - plane);
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                // The cut is always computed from the edge's lower end, so that an edge which two facets share is cut at one point.
                let (low, high, t) = if a < 0.0 { (from, to, a / (a - b)) } else { (to, from, b / (b - a)) };
                let mut cut = low + t * (high - low);
                cut[axis] = plane;
                below.push(cut);
                above.push(cut);
            }
            if b <= 0.0 {
                below.push(to);
            }
            if b >= 0.0 {
                above.push(to);
            }
            from = to;
        }
        pieces
    }

    /// Part of the polygon in the half-open box `[lo, hi)`, `None` if it is empty. The result borrows the polygon itself where
    /// nothing is cut off, and `room` otherwise, so that a polygon within the box is not copied.
    pub fn clip<'a>(&'a self, lo: DVec3, hi: DVec3, room: &'a mut Option<Polygon>) -> Option<&'a Polygon> {
        let (least, most) = self.bounds();
        if least.cmpge(hi).any() || most.cmplt(lo).any() {
            return None;
        }
        *room = None;
        if least.cmpge(lo).all() && most.cmplt(hi).all() {
            return Some(self);
        }
        for axis in 0..3 {
            for (upper, plane) in [(true, lo[axis]), (false, hi[axis])] {
                let piece = room.as_ref().unwrap_or(self);
                match (piece.side(axis, plane), upper) {
                    (Side::Both, _) => *room = Some(piece.split(axis, plane)[usize::from(upper)]),
                    (Side::Above, true) | (Side::Below, false) => {}
                    _ => return None,
                }
            }
        }
        Some(room.as_ref().unwrap_or(self))
    }

    /// Voxel that holds the polygon, or the middle one of the planes between unit voxels that cross it, along the axis with
    /// the most of them.
    pub fn voxel_split(&self) -> VoxelSplit {
        let (lo, hi) = self.bounds();
        let cell = lo.floor();
        // A piece that only touches the voxel's upper plane from below does not cross it.
        let planes = (hi - cell).ceil() - 1.0;
        let axis = if planes.x >= planes.y && planes.x >= planes.z {
            0
        } else if planes.y >= planes.z {
            1
        } else {
            2
        };
        if planes[axis].is_nan() || planes[axis] < 1.0 {
            return VoxelSplit::Inside(cell);
        }
        VoxelSplit::Plane { axis, at: cell[axis] + (0.5 * planes[axis]).ceil() }
    }

    /// Cut the polygon by unit voxels, and call `each` with every piece and its voxel's lower corner. A polygon that lies in one
    /// voxel is not copied.
    pub fn split_voxels(&self, each: &mut impl FnMut(&Polygon, DVec3)) {
        match self.voxel_split() {
            VoxelSplit::Inside(cell) => each(self, cell),
            VoxelSplit::Plane { axis, at } => {
                self.split(axis, at).iter().for_each(|piece| piece.split_voxels(each));
            }
        }
    }

    /// Lower and upper corner of the polygon's tight box.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.corners().iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), &c| (lo.min(c), hi.max(c)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Pieces by octant of the cube of edge 2.
    fn octants(p: &Polygon) -> [Vec<Polygon>; 8] {
        let mut out: [Vec<Polygon>; 8] = Default::default();
        p.split_voxels(&mut |piece, at| out[at.dot(DVec3::new(1.0, 2.0, 4.0)) as usize].push(*piece));
        out
    }

    #[test]
    fn a_facet_on_a_face_belongs_to_the_upper_voxel() {
        let p = Polygon::new(&[DVec3::new(0.2, 0.2, 1.0), DVec3::new(0.8, 0.2, 1.0), DVec3::new(0.2, 0.8, 1.0)], 7);
        let out = octants(&p);
        assert_eq!(out.iter().map(Vec::len).collect::<Vec<_>>(), [0, 0, 0, 0, 1, 0, 0, 0]);
        assert!(p.clip(DVec3::ZERO, DVec3::ONE, &mut None).is_none());
        assert!(p.clip(DVec3::Z, DVec3::new(1.0, 1.0, 2.0), &mut None).is_some());
    }

    proptest! {
        #[test]
        fn areas_add_up(v in proptest::array::uniform9(0.0f64..2.0)) {
            let c = [DVec3::from_slice(&v[0..3]), DVec3::from_slice(&v[3..6]), DVec3::from_slice(&v[6..9])];
            let p = Polygon::new(&c, 0);
            let sum: DVec3 = octants(&p).iter().flatten().map(Polygon::area_vector).sum();
            // Areas up to 2·sqrt(3), a few dozen roundings of 1e-16.
            prop_assert!((sum - p.area_vector()).length() < 1e-13);
            for (j, pieces) in octants(&p).iter().enumerate() {
                let lo = DVec3::new((j & 1) as f64, (j >> 1 & 1) as f64, (j >> 2) as f64);
                let clipped = p.clip(lo, lo + 1.0, &mut None).map_or(DVec3::ZERO, |q| q.area_vector());
                let split: DVec3 = pieces.iter().map(Polygon::area_vector).sum();
                prop_assert!((split - clipped).length() < 1e-13);
            }
        }
    }
}

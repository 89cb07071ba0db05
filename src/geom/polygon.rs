//! Planar convex polygons, cut exactly by the planes between voxels.
//!
//! Based on: I. Sutherland, G. Hodgman, *Reentrant Polygon Clipping*, CACM 1974.
//!
//! A piece that lies in the plane between two voxels belongs to the upper one (voxels are half-open), so areas add up.

use super::{DAffine3, DVec3};

/// Most corners that a source may give a polygon; six planes add one each.
pub const MAX_CORNERS: usize = 8;
/// Most corners of a piece.
pub const ROOM: usize = MAX_CORNERS + 6;

/// A planar convex polygon and the facet of the source that it is a piece of.
#[derive(Debug, Clone, Copy)]
pub struct Polygon {
    corners: [DVec3; ROOM],
    len: usize,
    /// The source's own number for what this is a piece of.
    pub facet: u32,
}

/// Where a polygon lies.
enum Side {
    Below,
    Above,
    Both,
}

impl Polygon {
    /// At most [`MAX_CORNERS`] corners are taken.
    pub fn new(corners: &[DVec3], facet: u32) -> Polygon {
        let len = corners.len().min(MAX_CORNERS);
        let mut polygon = Polygon { corners: [DVec3::ZERO; ROOM], len, facet };
        polygon.corners[..len].copy_from_slice(&corners[..len]);
        polygon
    }

    /// Give the convex polygon of at most [`ROOM`] corners, in two where it has more than a facet may have.
    pub fn convex(corners: &[DVec3], facet: u32, each: &mut dyn FnMut(&Polygon)) {
        if corners.len() <= MAX_CORNERS {
            return each(&Polygon::new(corners, facet));
        }
        each(&Polygon::new(&corners[..MAX_CORNERS], facet));
        let mut rest = Polygon::new(&corners[MAX_CORNERS - 1..], facet);
        rest.push(corners[0]);
        each(&rest);
    }

    /// The same seen from the other side.
    pub fn turned(&self) -> Polygon {
        let mut turned = *self;
        turned.corners[..self.len].reverse();
        turned
    }

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

    /// The mean of the corners.
    pub fn middle(&self) -> DVec3 {
        self.corners().iter().sum::<DVec3>() / self.len.max(1) as f64
    }

    /// The same, moved by `-origin`.
    pub fn relative_to(&self, origin: DVec3) -> Polygon {
        let mut moved = *self;
        for c in &mut moved.corners[..self.len] {
            *c -= origin;
        }
        moved
    }

    /// The same, larger by `factor` about the origin.
    pub fn scaled(&self, factor: f64) -> Polygon {
        let mut larger = *self;
        for c in &mut larger.corners[..self.len] {
            *c *= factor;
        }
        larger
    }

    /// The same in another space.
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
        if self.len < ROOM {
            self.corners[self.len] = p;
            self.len += 1;
        }
    }

    fn empty_like(&self) -> Polygon {
        Polygon { corners: [DVec3::ZERO; ROOM], len: 0, facet: self.facet }
    }

    /// The pieces below and above the plane `p[axis] = plane`, which crosses it; both get the same corners on the cut.
    pub fn split(&self, axis: usize, plane: f64) -> [Polygon; 2] {
        let mut pieces = [self.empty_like(), self.empty_like()];
        let [below, above] = &mut pieces;
        let mut from = self.corners[self.len.saturating_sub(1)];
        for &to in self.corners() {
            let (a, b) = (from[axis] - plane, to[axis] - plane);
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                // From the lower end always, so that an edge shared by two facets is cut at one point.
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

    /// What of it is in the half-open box `[lo, hi)`; in `room` where that is not all of it.
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

    /// The middle one of the planes between unit voxels that part it, as axis and place, or its voxel's lower corner.
    pub fn middle_plane(&self) -> Result<(usize, f64), DVec3> {
        let (lo, hi) = self.bounds();
        let cell = lo.floor();
        // A piece that reaches the plane above from below lies below.
        let planes = (hi - cell).ceil() - 1.0;
        let axis = if planes.x >= planes.y && planes.x >= planes.z {
            0
        } else if planes.y >= planes.z {
            1
        } else {
            2
        };
        if planes[axis].is_nan() || planes[axis] < 1.0 {
            return Err(cell);
        }
        Ok((axis, cell[axis] + (0.5 * planes[axis]).ceil()))
    }

    /// Cut it into the unit voxels, and give each piece with its voxel's lower corner. What lies in one voxel is not copied.
    pub fn split_voxels(&self, each: &mut impl FnMut(&Polygon, DVec3)) {
        match self.middle_plane() {
            Err(cell) => each(self, cell),
            Ok((axis, plane)) => {
                self.split(axis, plane).iter().for_each(|piece| piece.split_voxels(each));
            }
        }
    }

    /// Its tight box.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.corners().iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), &c| (lo.min(c), hi.max(c)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// By voxel of the cube of edge 2.
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

//! Point-in-solid test by winding numbers along the vertical lines through the centres of the finest voxels.
//!
//! Based on: E. Haines, *Point in Polygon Strategies*, Graphics Gems IV, 1994 (half-open crossing rules), a dimension up.

use crate::geom::DVec3;
use crate::source::memory_budget::MemoryBudget;
use crate::{Result, par};

/// Crossings of vertical lines with closed surfaces.
pub struct Interior {
    side: u32,
    /// Start of each line's crossings in `crossings`, and one past the last; the line of (x, y) is x + side · y.
    starts: Vec<u32>,
    /// Height, and +1 where the line goes out.
    crossings: Vec<(f32, i8)>,
}

/// Triangles in a chunk of parallel work.
const CHUNK: usize = 4096;
/// Bytes of memory per crossing while they are sorted by line.
const CROSSING_MEMORY: u64 = 32;

impl Interior {
    /// `triangle(i)` for `i` in `0..count` is a triangle in grid space whose normal points outward, or none.
    ///
    /// # Errors
    /// `Limit` where that takes more than `memory` bytes.
    pub fn new(
        side: u32,
        count: usize,
        memory: u64,
        triangle: impl Fn(usize) -> Option<[DVec3; 3]> + Sync,
    ) -> Result<Interior> {
        let ledger = MemoryBudget::new(memory);
        let lines = side as usize * side as usize + 1;
        ledger.take(lines, size_of::<u32>() as u64);
        let lists = par::map(count.div_ceil(CHUNK), |chunk| {
            let mut out = Vec::new();
            for i in chunk * CHUNK..count.min((chunk + 1) * CHUNK) {
                if let Some(t) = triangle(i) {
                    // A row at a time: a triangle may cross as many lines as there are.
                    if !cross(&t, side, &mut out, &mut |row| ledger.take(row, CROSSING_MEMORY)) {
                        return Vec::new();
                    }
                }
            }
            out
        });
        ledger.check("to find what is inside of closed surfaces")?;
        let mut all: Vec<(u32, f32, i8)> = lists.concat();
        all.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
        let mut starts = vec![0u32; lines];
        for c in &all {
            starts[c.0 as usize + 1] += 1;
        }
        let mut sum = 0;
        for s in &mut starts {
            sum += *s;
            *s = sum;
        }
        Ok(Interior { side, starts, crossings: all.into_iter().map(|(_, z, way)| (z, way)).collect() })
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.starts[..]) + size_of_val(&self.crossings[..])) as u64
    }

    /// Test whether `p` is inside: the winding number of its voxel's vertical line at the height of `p` is positive.
    pub fn holds(&self, p: DVec3) -> bool {
        let last = f64::from(self.side - 1);
        if !(p.x >= 0.0 && p.y >= 0.0 && p.x <= last + 1.0 && p.y <= last + 1.0) {
            return false;
        }
        let line = p.x.min(last) as usize + self.side as usize * p.y.min(last) as usize;
        let range = self.starts[line] as usize..self.starts[line + 1] as usize;
        self.crossings[range].iter().filter(|c| f64::from(c.0) > p.z).map(|c| i32::from(c.1)).sum::<i32>() > 0
    }
}

/// Crossings of one triangle. An edge's crossing is computed from its ends in a fixed order, so that both triangles at
/// the edge agree, and each line crosses exactly one of them. False where `room` for the crossings of a row is not left.
fn cross(t: &[DVec3; 3], side: u32, out: &mut Vec<(u32, f32, i8)>, room: &mut dyn FnMut(usize) -> bool) -> bool {
    let normal = (t[1] - t[0]).cross(t[2] - t[0]);
    if normal.z == 0.0 || !normal.is_finite() {
        return true;
    }
    let way = if normal.z > 0.0 { 1 } else { -1 };
    let (lo, hi) = (t[0].min(t[1]).min(t[2]), t[0].max(t[1]).max(t[2]));
    let clamp = |v: f64| v.clamp(0.0, f64::from(side)) as u32;
    for y in clamp((lo.y - 0.5).ceil())..clamp((hi.y - 0.5).ceil()) {
        let v = f64::from(y) + 0.5;
        let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
        for i in 0..3 {
            let (a, b) = (t[i], t[(i + 1) % 3]);
            if (a.y <= v) == (b.y <= v) {
                continue;
            }
            let (a, b) = if a.y < b.y { (a, b) } else { (b, a) };
            let x = a.x + (v - a.y) / (b.y - a.y) * (b.x - a.x);
            ends = [ends[0].min(x), ends[1].max(x)];
        }
        if ends[0] > ends[1] {
            continue;
        }
        let row = clamp((ends[0] - 0.5).ceil())..clamp((ends[1] - 0.5).ceil());
        if !room(row.len()) {
            return false;
        }
        for x in row {
            let p = f64::from(x) + 0.5;
            let z = t[0].z - (normal.x * (p - t[0].x) + normal.y * (v - t[0].y)) / normal.z;
            out.push((x + side * y, z as f32, way));
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_within() {
        // A box from (2, 2, 3) to (6, 6, 7): top and bottom alone cross vertical lines.
        let quad = |z: f64, flip: bool| {
            let c =
                [DVec3::new(2.0, 2.0, z), DVec3::new(6.0, 2.0, z), DVec3::new(6.0, 6.0, z), DVec3::new(2.0, 6.0, z)];
            let order = if flip { [[0, 2, 1], [0, 3, 2]] } else { [[0, 1, 2], [0, 2, 3]] };
            order.map(|o| o.map(|i: usize| c[i]))
        };
        let triangles = [quad(7.0, false), quad(3.0, true)].concat();
        let inside = Interior::new(8, triangles.len(), u64::MAX, |i| Some(triangles[i])).unwrap();
        assert_eq!(inside.crossings.len(), 2 * 16);
        assert!(inside.holds(DVec3::new(2.5, 5.5, 3.5)));
        assert!(inside.holds(DVec3::new(4.0, 4.0, 6.9)));
        for out in [[1.5, 3.0, 4.0], [3.0, 3.0, 2.9], [3.0, 3.0, 7.1], [6.5, 3.0, 5.0], [-1.0, 3.0, 5.0]] {
            assert!(!inside.holds(DVec3::from(out)));
        }
        // 65 starts of lines of 4 bytes, and 32 crossings of 32.
        let with = |memory| Interior::new(8, triangles.len(), memory, |i| Some(triangles[i]));
        assert!(with(65 * 4 + 32 * 32).is_ok() && with(65 * 4 + 32 * 32 - 1).is_err());
    }
}

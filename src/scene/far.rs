//! Coordinates far from 0, as in maps (UTM) and globes (ECEF): a round number is subtracted from them once, so that they keep their detail in
//! single precision and in the grid.

use crate::geom::{Aabb, DVec3};

/// Largest coordinate, in extents of the whole, that counts as near 0: a step of single precision is then at most 2^-20 of the extent, which is
/// a 256th of a voxel at 4096 voxels.
const NEAR: f64 = 16.0;

/// Offset to subtract from coordinates that fill `bounds`: a round decimal number near their middle along axes along which they are far from 0,
/// else 0.
pub fn offset(bounds: Aabb) -> DVec3 {
    let extent = bounds.size().max_element();
    if bounds.is_empty() || !(extent.is_finite() && bounds.min.is_finite()) {
        return DVec3::ZERO;
    }
    // Whole units, or a decimal fraction of them that is at most as large as the extent. A point has no extent.
    let per_unit = if extent > 0.0 { libm::pow(10.0, (-libm::log10(extent)).ceil().clamp(0.0, 15.0)) } else { 1.0 };
    let middle = bounds.centre();
    DVec3::from([0, 1, 2].map(|axis| {
        let farthest = bounds.min[axis].abs().max(bounds.max[axis].abs());
        let rounded = (middle[axis] * per_unit).round() / per_unit;
        if farthest > NEAR * extent { rounded } else { 0.0 }
    }))
}

/// Most digits after the decimal point of the numbers of a text; `None` if one has an exponent, or if numbers are binary.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Decimals(Option<u32>);

impl Decimals {
    /// For the numbers of a text, before the first one.
    pub fn new() -> Decimals {
        Decimals(Some(0))
    }

    /// Record a number as it is written.
    pub fn see(&mut self, word: &str) {
        let fraction = word.split_once('.').map_or("", |(_, digits)| digits);
        let plain = word.bytes().all(|b| b.is_ascii_digit() || b"+-.".contains(&b));
        self.0 = self.0.filter(|_| plain).map(|d| d.max(fraction.len().min(99) as u32));
    }
}

/// `p` − `offset`. If a text writes the coordinates with a number of `decimals`, the difference is rounded to as many: it is the number that the
/// text would hold if it were written relative to the offset.
pub fn subtract(p: DVec3, offset: DVec3, decimals: Decimals) -> DVec3 {
    let Some(decimals) = decimals.0.filter(|d| *d <= 15) else { return p - offset };
    let scale = libm::pow(10.0, f64::from(decimals));
    let rounded = |axis: usize| {
        let difference = p[axis] - offset[axis];
        let digits = (difference * scale).round();
        // Beyond 2^53 f64 does not hold all integers; along axes without an offset nothing changes.
        if offset[axis] == 0.0 || digits.abs() > 9e15 { difference } else { digits / scale }
    };
    DVec3::from([0, 1, 2].map(rounded))
}

/// Note about the `offset` that is subtracted.
pub fn note(offset: DVec3) -> String {
    let DVec3 { x, y, z } = offset;
    format!(
        "coordinates are far from 0: ({x}, {y}, {z}) is subtracted while they are baked; the texel's bounds tell where they were"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn around(centre: DVec3, radius: f64) -> Aabb {
        Aabb::new(centre - radius, centre + radius)
    }

    #[test]
    fn offsets_are_round_and_only_where_they_are_needed() {
        let utm = DVec3::new(448_262.3, 5_411_932.2, 12.0);
        assert_eq!(offset(around(utm, 1.0)), DVec3::new(448_262.0, 5_411_932.0, 0.0));
        assert_eq!(offset(around(utm, 0.02)), DVec3::new(448_262.3, 5_411_932.2, 12.0));
        assert_eq!(offset(around(DVec3::splat(100.0), 7.0)), DVec3::ZERO);
        assert_eq!(offset(around(DVec3::splat(7.0), 0.0)), DVec3::splat(7.0), "a point is far from 0 anywhere");
        assert_eq!(offset(Aabb::EMPTY), DVec3::ZERO);
        assert_eq!(offset(Aabb::new(DVec3::ZERO, DVec3::INFINITY)), DVec3::ZERO);
    }

    #[test]
    fn what_is_left_is_what_the_text_had_around_0() {
        let (x, y): (f64, f64) = ("448261.474269".parse().unwrap(), "5411932.850651".parse().unwrap());
        let p = DVec3::new(x, y, 0.1);
        let offset = DVec3::new(448_262.0, 5_411_932.0, 0.0);
        let mut six = Decimals::new();
        ["448261.474269", "-1", ".5", "1e3"].iter().for_each(|word| six.see(word));
        assert_eq!(six, Decimals(None), "exponents may hide digits");
        six = Decimals::new();
        ["448261.474269", "-1", ".5"].iter().for_each(|word| six.see(word));
        assert_ne!(p - offset, DVec3::new(-0.525731, 0.850651, 0.1), "double precision alone does not do it");
        assert_eq!(subtract(p, offset, six), DVec3::new(-0.525731, 0.850651, 0.1));
        assert_eq!(subtract(p, offset, Decimals::default()), p - offset);
    }
}

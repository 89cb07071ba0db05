//! Corners of a shell's boxes, and the stretches of a ray that are led through them.

use crate::geom::{DMat3, DVec3};

/// At most so many cells along one piece of a ray are looked into; one that runs through more is not cut any further.
pub const MOST_CELLS: u32 = 1 << 16;

/// A corner of a face: base position, height vector, texel coordinate at the base, and how much w grows to the top.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    pub p: DVec3,
    pub h: DVec3,
    pub q: DVec3,
    pub dw: f64,
    /// Strength of continuous jitter there, in [0, 1].
    pub jitter: f64,
}

/// A stretch of a ray on which texel coordinates are (nearly) linear in t: from `q0` at `t0` to `q1` at `t1`.
#[derive(Debug, Clone, Copy)]
pub struct ShellSegment {
    pub t0: f64,
    pub t1: f64,
    pub q0: DVec3,
    pub q1: DVec3,
    /// World → texel, the linear part.
    pub to_texel: DMat3,
    /// Where the ends stand in the shell.
    pub feet: [Foot; 2],
}

/// How a point of a shell stands over the base.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Foot {
    /// How far w has risen since the base.
    pub rise: f64,
    /// Share of the height vector, in [0, 1].
    pub height: f64,
    /// Strength of continuous jitter, in [0, 1].
    pub mask: f64,
}

/// A point of a shell: its texel coordinates and its [`Foot`].
#[derive(Debug, Clone, Copy)]
pub struct ShellPoint {
    pub q: DVec3,
    pub rise: f64,
    pub height: f64,
    pub mask: f64,
}

impl ShellSegment {
    /// The point at t, between the ends.
    pub fn at(&self, t: f64) -> ShellPoint {
        let share = (t - self.t0) / (self.t1 - self.t0);
        let [a, b] = &self.feet;
        let mix = |a: f64, b: f64| a + share * (b - a);
        ShellPoint {
            q: self.q0.lerp(self.q1, share),
            rise: mix(a.rise, b.rise),
            height: mix(a.height, b.height),
            mask: mix(a.mask, b.mask),
        }
    }
}

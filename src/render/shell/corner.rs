//! Corners of a shell's boxes, and the segments of a ray that are mapped through the boxes into texel coordinates.

use crate::geom::{DMat3, DVec3};

/// Most cells that one segment of a ray visits; a segment through more cells is not subdivided any further.
pub const MAX_CELLS: u32 = 1 << 16;

/// A corner of a face of the shell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Position at the base.
    pub p: DVec3,
    /// Height vector.
    pub h: DVec3,
    /// Texel coordinates at the base.
    pub q: DVec3,
    /// Growth of w from the base to the top.
    pub dw: f64,
    /// Strength of continuous jitter there, in [0, 1].
    pub jitter: f64,
}

/// A segment of a ray on which texel coordinates are (nearly) linear in t: from `q0` at `t0` to `q1` at `t1`.
#[derive(Debug, Clone, Copy)]
pub struct ShellSegment {
    pub t0: f64,
    pub t1: f64,
    pub q0: DVec3,
    pub q1: DVec3,
    /// Linear part of the map from the renderer's space to texel coordinates.
    pub to_texel: DMat3,
    /// Heights of both ends in the shell.
    pub end_heights: [HeightInShell; 2],
}

/// Height of a point above the base of the shell, in three measures.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HeightInShell {
    /// Difference of w from the base.
    pub rise: f64,
    /// Share of the height vector, in [0, 1].
    pub height: f64,
    /// Strength of continuous jitter, in [0, 1].
    pub mask: f64,
}

/// A point of a shell: its texel coordinates and its [`HeightInShell`].
#[derive(Debug, Clone, Copy)]
pub struct ShellPoint {
    pub q: DVec3,
    pub rise: f64,
    pub height: f64,
    pub mask: f64,
}

impl ShellSegment {
    /// The part from t0 to t1, which lie between the ends.
    pub fn part(&self, [t0, t1]: [f64; 2]) -> ShellSegment {
        if (t0, t1) == (self.t0, self.t1) {
            return *self;
        }
        let (a, b) = (self.at(t0), self.at(t1));
        let foot = |p: ShellPoint| HeightInShell { rise: p.rise, height: p.height, mask: p.mask };
        ShellSegment { t0, t1, q0: a.q, q1: b.q, end_heights: [foot(a), foot(b)], ..*self }
    }

    /// The point at t, between the ends.
    pub fn at(&self, t: f64) -> ShellPoint {
        let share = (t - self.t0) / (self.t1 - self.t0);
        let [a, b] = &self.end_heights;
        let mix = |a: f64, b: f64| a + share * (b - a);
        ShellPoint {
            q: self.q0.lerp(self.q1, share),
            rise: mix(a.rise, b.rise),
            height: mix(a.height, b.height),
            mask: mix(a.mask, b.mask),
        }
    }
}

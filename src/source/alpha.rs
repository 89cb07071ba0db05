//! Mean alpha of a texture over any box of its texels, in constant time.
//!
//! Based on: F. Crow, *Summed-Area Tables for Texture Mapping*, SIGGRAPH 1984.

use crate::scene::texture::{Texture, Wrap};

/// Bound on the alpha of a piece of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlphaClass {
    /// Alpha is 0 everywhere.
    Transparent,
    /// Alpha is 1 everywhere.
    Opaque,
    /// Anything else, also where no bound is known.
    Mixed,
}

/// Summed-area table of a texture's alpha.
pub struct AlphaSums {
    size: [u32; 2],
    wrap: [Wrap; 2],
    /// (width + 1) · (height + 1) sums of values 0 … 255. Sums may wrap around; their differences over a box of at most 2^24
    /// texels are exact nevertheless.
    sums: Vec<u32>,
}

/// Number of texels of the largest box that is summed.
const MOST: u64 = 1 << 24;

/// Up to two intervals of texels, `from..to`.
type Spans = [(u32, u32); 2];

impl AlphaSums {
    /// Table of `texture`, whose alpha codes mean the alpha `there(code)`, in 255ths.
    pub fn new(texture: &Texture, there: impl Fn(u8) -> u8) -> AlphaSums {
        let there: [u8; 256] = std::array::from_fn(|code| there(code as u8));
        let (w, h) = (texture.width as usize, texture.height as usize);
        let mut sums = vec![0u32; (w + 1) * (h + 1)];
        for y in 0..h {
            let (above, row) = sums[y * (w + 1)..(y + 2) * (w + 1)].split_at_mut(w + 1);
            let texels = texture.texels.get(y * w..).unwrap_or_default();
            let mut sum = 0u32;
            for (x, texel) in texels.iter().take(w).enumerate() {
                sum = sum.wrapping_add(u32::from(there[usize::from(texel[3])]));
                row[x + 1] = above[x + 1].wrapping_add(sum);
            }
        }
        AlphaSums { size: [texture.width, texture.height], wrap: texture.wrap, sums }
    }

    /// Bound on what a lookup between the texture coordinates `lo` and `hi` can find, filtered or not.
    pub fn classify(&self, lo: [f64; 2], hi: [f64; 2]) -> AlphaClass {
        // A bilinear lookup reads the four texels whose centres surround it.
        let spans = [0, 1].map(|k| {
            let size = f64::from(self.size[k]);
            self.spans(k, whole((lo[k] * size - 0.5).floor()), whole((hi[k] * size - 0.5).floor() + 2.0))
        });
        if !lo.iter().chain(&hi).all(|v| v.is_finite()) {
            return AlphaClass::Mixed;
        }
        let Some((sum, count)) = self.sum(spans) else { return AlphaClass::Mixed };
        if sum == 0 {
            AlphaClass::Transparent
        } else if u64::from(sum) == 255 * count {
            AlphaClass::Opaque
        } else {
            AlphaClass::Mixed
        }
    }

    /// Mean alpha, in [0, 1], of the box of `width` texels (1 or more) around `uv`.
    #[inline]
    pub fn mean(&self, uv: [f64; 2], width: f64) -> f32 {
        let ends = [0, 1].map(|k| {
            let at = uv[k] * f64::from(self.size[k]);
            let (from, to) = (rounded(at - 0.5 * width), rounded(at + 0.5 * width));
            (from, to.max(from + 1))
        });
        // Most boxes lie within the image, where the wrap mode does not matter.
        let within = |k: usize| ends[k].0 >= 0 && ends[k].1 <= i64::from(self.size[k]);
        let found = if within(0) && within(1) {
            let [(x0, x1), (y0, y1)] = ends.map(|(from, to)| (from as u32, to as u32));
            let count = u64::from(x1 - x0) * u64::from(y1 - y0);
            (count <= MOST).then(|| (self.box_sum([x0, x1], [y0, y1]), count))
        } else {
            self.sum([0, 1].map(|k| self.spans(k, ends[k].0, ends[k].1)))
        };
        found.map_or(0.0, |(sum, count)| (f64::from(sum) / (255.0 * count.max(1) as f64)) as f32)
    }

    /// Sum over the texels from x[0] to before x[1], the same of y.
    #[inline]
    fn box_sum(&self, x: [u32; 2], y: [u32; 2]) -> u32 {
        let stride = self.size[0] as usize + 1;
        let at = |x: u32, y: u32| self.sums[y as usize * stride + x as usize];
        at(x[1], y[1]).wrapping_sub(at(x[0], y[1])).wrapping_sub(at(x[1], y[0])).wrapping_add(at(x[0], y[0]))
    }

    /// Sum and number of texels; `None` of more than [`MOST`].
    fn sum(&self, spans: [Spans; 2]) -> Option<(u32, u64)> {
        let (mut sum, mut count) = (0u32, 0u64);
        for (y0, y1) in spans[1] {
            for (x0, x1) in spans[0] {
                count += u64::from(x1 - x0) * u64::from(y1 - y0);
                sum = sum.wrapping_add(self.box_sum([x0, x1], [y0, y1]));
            }
        }
        (count <= MOST).then_some((sum, count))
    }

    /// Texels, at least one, that the wrap mode assigns to the positions `from..to` of axis `k`.
    fn spans(&self, k: usize, from: i64, to: i64) -> Spans {
        const NONE: (u32, u32) = (0, 0);
        let n = i64::from(self.size[k]);
        let whole = [(0, self.size[k]), NONE];
        let to = to.max(from + 1);
        let pair = |a: (i64, i64), b: (i64, i64)| [a, b].map(|(from, to)| (from as u32, to as u32));
        match self.wrap[k] {
            _ if n == 0 => [NONE; 2],
            Wrap::Clamp => {
                let first = from.clamp(0, n - 1);
                pair((first, to.clamp(first + 1, n)), (0, 0))
            }
            _ if to - from >= n => whole,
            Wrap::Repeat => {
                let first = from.rem_euclid(n);
                let last = first + (to - from);
                pair((first, last.min(n)), (0, (last - n).max(0)))
            }
            Wrap::Mirror => {
                let first = from.rem_euclid(2 * n);
                let last = first + (to - from);
                let back = |a: i64, b: i64| (2 * n - b, 2 * n - a);
                match (first < n, last <= n, last <= 2 * n) {
                    (true, true, _) => pair((first, last), (0, 0)),
                    (true, false, _) => pair((first, n), back(n, last)),
                    (false, _, true) => pair(back(first, last), (0, 0)),
                    (false, _, false) => pair(back(first, 2 * n), (0, last - 2 * n)),
                }
            }
        }
    }
}

/// `v`, a whole number, as an integer; far out of range it is clamped, since no texture is that wide.
fn whole(v: f64) -> i64 {
    v.clamp(-1e15, 1e15) as i64
}

/// Nearest whole number, halves away from zero, as `f64::round` has it; that one is a library call where the processor may lack
/// an instruction for it.
#[inline]
fn rounded(v: f64) -> i64 {
    let v = v.clamp(-1e15, 1e15);
    let toward_zero = v as i64;
    let rest = v - toward_zero as f64;
    toward_zero + i64::from(rest >= 0.5) - i64::from(rest <= -0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// 8 × 6 texels; those with x + y < 5 are there.
    fn corner(wrap: Wrap) -> Texture {
        let texels = (0..48u32).map(|i| [0, 0, 0, if i % 8 + i / 8 < 5 { 255 } else { 0 }]).collect();
        let mut texture = Texture::new("corner", 8, 6, texels);
        texture.wrap = [wrap; 2];
        texture
    }

    #[test]
    fn boxes_of_texels() {
        let sums = AlphaSums::new(&corner(Wrap::Repeat), |a| a);
        assert_eq!(sums.classify([0.1, 0.1], [0.2, 0.3]), AlphaClass::Opaque);
        assert_eq!(sums.classify([0.7, 0.7], [0.9, 0.9]), AlphaClass::Transparent);
        assert_eq!(sums.classify([0.1, 0.1], [0.7, 0.9]), AlphaClass::Mixed);
        assert_eq!(sums.classify([-1e30, 0.1], [f64::NAN, 0.2]), AlphaClass::Mixed);
        // 5 + 4 + 3 + 2 + 1 of 48, over one or many periods.
        assert!((sums.mean([0.5, 0.5], 8.0) - 15.0 / 48.0).abs() < 1e-6);
        assert!((sums.mean([7.3, -2.1], 800.0) - 15.0 / 48.0).abs() < 1e-6);
        assert_eq!(sums.mean([0.5 / 8.0, 0.5 / 6.0], 1.0), 1.0);
        let none = AlphaSums::new(&Texture::default(), |a| a);
        assert_eq!(none.classify([0.0, 0.0], [1.0, 1.0]), AlphaClass::Transparent);
        assert_eq!(none.mean([0.3, 0.3], 2.0), 0.0);
    }

    #[test]
    fn halves_are_rounded_away_from_zero() {
        for v in [0.0, 0.5, 0.499_999_999_999_999_94, -0.5, -0.6, 1.5, -2.5, 7.3, -7.7, 1e15, 1e30, -1e30] {
            assert_eq!(rounded(v), whole(f64::round(v)), "{v}");
        }
    }

    proptest! {
        /// Whatever a lookup finds in a box, the box's share does not say the contrary.
        #[test]
        fn shares_bound_what_is_sampled(
            lo in prop::array::uniform2(-3.0f64..3.0), size in prop::array::uniform2(0.0f64..0.6),
            at in prop::array::uniform2(0.0f64..1.0), wrap in 0usize..3,
        ) {
            let texture = corner([Wrap::Repeat, Wrap::Mirror, Wrap::Clamp][wrap]);
            let sums = AlphaSums::new(&texture, |a| a);
            let hi = [lo[0] + size[0], lo[1] + size[1]];
            let found = texture.sample([0, 1].map(|k| (lo[k] + at[k] * size[k]) as f32))[3];
            match sums.classify(lo, hi) {
                // f32's steps of the coordinate: 3e-7 of a period, 2e-6 of a texel.
                AlphaClass::Transparent => prop_assert!(found < 1e-5),
                AlphaClass::Opaque => prop_assert!(found > 1.0 - 1e-5),
                AlphaClass::Mixed => {}
            }
        }
    }
}

//! Mean alpha of any box of a texture's texels in constant time, after the cutoff of a mask.
//!
//! Based on: F. Crow, *Summed-Area Tables for Texture Mapping*, SIGGRAPH 1984.
//!
//! The cutoff is a threshold on a bilinear lookup, and the threshold of an average is not the average of the threshold. So the table holds,
//! for each texel, the share of its square in which a bilinear lookup passes the cutoff. A box of any size then has the mean coverage of
//! point samples in it, for the baker and the renderer alike.

use super::model::{Alpha, Material};
use super::texture::{Texture, Wrap, wrapped};

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

/// Summed-area table of the coverage of each texel.
pub struct AlphaSums {
    size: [u32; 2],
    wrap: [Wrap; 2],
    /// (width + 1) · (height + 1) sums of values 0 … 255. Sums may wrap around; their differences over a box of at most 2^24
    /// texels are exact nevertheless.
    sums: Vec<u32>,
}

/// Most texels of a box whose sum is exact.
const MAX_TEXELS: u64 = 1 << 24;
/// Columns of a quarter of a texel; the part of each column that passes the cutoff is computed exactly.
const COLUMNS: usize = 8;

/// Up to two intervals of texels, `from..to`.
type Spans = [(u32, u32); 2];

impl AlphaSums {
    /// Bytes that the table of a texture takes.
    pub fn bytes(texture: &Texture) -> u64 {
        4 * (u64::from(texture.width) + 1) * (u64::from(texture.height) + 1)
    }

    /// Table of a material's texture times its factor: shares that pass the cutoff of a mask, mean alpha of a blend. `None`
    /// where the material is opaque or has no texture.
    pub fn of(material: &Material) -> Option<AlphaSums> {
        let texture = &*material.texture.as_ref()?.texture;
        let alpha: [f32; 256] = std::array::from_fn(|code| material.base_color[3] * code as f32 / 255.0);
        match material.alpha {
            Alpha::Opaque => None,
            Alpha::Mask(_) if !texture.nearest => {
                Some(AlphaSums::sum_rows(texture, |y, row| filtered(texture, &alpha, material.alpha, y, row)))
            }
            _ => {
                let there = alpha.map(|a| (material.alpha.share(a) * 255.0).round() as u8);
                Some(AlphaSums::sum_rows(texture, |y, row| {
                    row.iter_mut().enumerate().for_each(|(x, share)| *share = there[code(texture, x, y)]);
                }))
            }
        }
    }

    /// The table of the values that `fill` writes for each row y, in 255ths.
    fn sum_rows(texture: &Texture, fill: impl Fn(usize, &mut [u8])) -> AlphaSums {
        let (w, h) = (texture.width as usize, texture.height as usize);
        let mut sums = vec![0u32; (w + 1) * (h + 1)];
        let mut shares = vec![0; w];
        for y in 0..h {
            fill(y, &mut shares);
            let (above, row) = sums[y * (w + 1)..(y + 2) * (w + 1)].split_at_mut(w + 1);
            let mut sum = 0u32;
            for (x, &share) in shares.iter().enumerate() {
                sum = sum.wrapping_add(u32::from(share));
                row[x + 1] = above[x + 1].wrapping_add(sum);
            }
        }
        AlphaSums { size: [texture.width, texture.height], wrap: texture.wrap, sums }
    }

    /// Bound on the result of any lookup between the texture coordinates `lo` and `hi`, filtered or not.
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
            (count <= MAX_TEXELS).then(|| (self.box_sum([x0, x1], [y0, y1]), count))
        } else {
            self.sum([0, 1].map(|k| self.spans(k, ends[k].0, ends[k].1)))
        };
        found.map_or(0.0, |(sum, count)| (f64::from(sum) / (255.0 * count.max(1) as f64)) as f32)
    }

    /// Mean coverage, in [0, 1], of the box of `widths` texels around `uv`; texels on its border count by the part that is inside. The part of
    /// the box beyond the texture coordinates `lo` … `hi` is mirrored back into them. So the mean over all `uv` in that range equals the
    /// range's own mean however wide the box is, and neighbours of a card in an atlas do not count.
    pub fn mean_within(&self, uv: [f64; 2], widths: [f64; 2], [lo, hi]: [[f64; 2]; 2]) -> f32 {
        let folded = [0, 1].map(|k| {
            let size = f64::from(self.size[k]);
            fold(uv[k] * size, widths[k], lo[k] * size, hi[k] * size)
        });
        let pieces = |k: usize| folded[k].into_iter().flatten().flat_map(pieces);
        let (mut sum, mut area) = (0.0, 0.0);
        for (y0, y1, high) in pieces(1) {
            for (x0, x1, wide) in pieces(0) {
                let Some((own, texels)) = self.sum([self.spans(0, x0, x1), self.spans(1, y0, y1)]) else {
                    return self.mean(uv, widths[0].max(widths[1]));
                };
                sum += wide * high * f64::from(own);
                area += wide * high * texels as f64;
            }
        }
        (sum / (255.0 * area.max(f64::MIN_POSITIVE))) as f32
    }

    /// Sum over the texels from x[0] to before x[1], the same of y.
    #[inline]
    fn box_sum(&self, x: [u32; 2], y: [u32; 2]) -> u32 {
        let stride = self.size[0] as usize + 1;
        let at = |x: u32, y: u32| self.sums[y as usize * stride + x as usize];
        at(x[1], y[1]).wrapping_sub(at(x[0], y[1])).wrapping_sub(at(x[1], y[0])).wrapping_add(at(x[0], y[0]))
    }

    /// Sum and number of texels; `None` of more than [`MAX_TEXELS`].
    fn sum(&self, spans: [Spans; 2]) -> Option<(u32, u64)> {
        let (mut sum, mut count) = (0u32, 0u64);
        for (y0, y1) in spans[1] {
            for (x0, x1) in spans[0] {
                count += u64::from(x1 - x0) * u64::from(y1 - y0);
                sum = sum.wrapping_add(self.box_sum([x0, x1], [y0, y1]));
            }
        }
        (count <= MAX_TEXELS).then_some((sum, count))
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

/// The interval of `width` around `at` as intervals within `lo` … `hi`; the part beyond an end is mirrored at it.
fn fold(at: f64, width: f64, lo: f64, hi: f64) -> [Option<(f64, f64)>; 2] {
    let (from, to) = (at - 0.5 * width, at + 0.5 * width);
    // An interval as wide as the range shows all of it, wherever it is.
    let (first, rest) = if width.is_nan() || width >= hi - lo {
        ((lo, hi), None)
    } else if from < lo {
        ((lo, to), Some((lo, 2.0 * lo - from)))
    } else if to > hi {
        ((from, hi), Some((2.0 * hi - to, hi)))
    } else {
        ((from, to), None)
    };
    [Some(first), rest]
}

/// An interval as up to three ranges `from..to` of texels, with the part of each texel that is inside.
fn pieces((from, to): (f64, f64)) -> impl Iterator<Item = (i64, i64, f64)> {
    /// An interval as narrow as this, in texels, stands for the texel that it lies in.
    const POINT: f64 = 1e-6;
    let (first, last) = (whole(from.floor()), whole(to.floor()));
    let all = if first == last || to - from < POINT {
        [(first, first + 1, if to - from < POINT { 1.0 } else { to - from }), (0, 0, 0.0), (0, 0, 0.0)]
    } else {
        [(first, first + 1, (first + 1) as f64 - from), (first + 1, last, 1.0), (last, last + 1, to - last as f64)]
    };
    all.into_iter().filter(|&(from, to, part)| from < to && part > 0.0)
}

/// The alpha code of a texel; 0 where the image has none.
fn code(texture: &Texture, x: usize, y: usize) -> usize {
    texture.texels.get(y * texture.width as usize + x).map_or(0, |t| usize::from(t[3]))
}

/// For each texel of row y the share in which a bilinear lookup passes the cutoff, in 255ths; 0 and 255 stand for exactly none and all. `alpha`
/// maps codes to alpha.
fn filtered(texture: &Texture, alpha: &[f32; 256], mask: Alpha, y: usize, row: &mut [u8]) {
    let near = |i: usize, step: i32, k: usize, size: u32| wrapped(i as i32 + step, size, texture.wrap[k]);
    let rows = [-1, 0, 1].map(|step| near(y, step, 1, texture.height));
    for (x, share) in row.iter_mut().enumerate() {
        let columns = [-1, 0, 1].map(|step| near(x, step, 0, texture.width));
        let around = rows.map(|y| columns.map(|x| alpha[code(texture, x, y)]));
        let passing = around.iter().flatten().filter(|&&a| mask.share(a) > 0.0).count();
        *share = match passing {
            0 => 0,
            9 => 255,
            _ => {
                let quarters = [(0, 0), (0, 2), (2, 0), (2, 2)]
                    .map(|(i, j)| quarter([around[1][1], around[1][i], around[j][1], around[j][i]], mask));
                let sum: f32 = quarters.iter().sum();
                // Parts, however small, must not be rounded to none or all.
                let least = u8::from(quarters.iter().any(|&q| q > 0.0));
                let most = 255 - u8::from(quarters.iter().any(|&q| q < 1.0));
                ((sum * 63.75).round() as u8).clamp(least, most)
            }
        };
    }
}

/// The share of a quarter of a texel in which a bilinear lookup passes the cutoff. The arguments are alpha in the middle of the texel, of its
/// neighbour in the row, of that in the column, and of the diagonal one.
fn quarter([own, row, column, across]: [f32; 4], mask: Alpha) -> f32 {
    let Alpha::Mask(cutoff) = mask else { return 0.0 };
    let passes = |a: f32| mask.share(a) > 0.0;
    let corners = [own, 0.5 * (own + row), 0.5 * (own + column), 0.25 * (own + row + column + across)];
    if corners.iter().all(|&a| passes(a)) {
        return 1.0;
    }
    // Where alpha reaches the cutoff (up to rounding) but does not exceed it, only a line or a point passes, as between texels of 0 and 1 with a
    // cutoff of ½. If that counted, every texel beside an edge would get a share of 1/255.
    if corners.iter().all(|&a| a <= cutoff + 1e-6) {
        return 0.0;
    }
    let sum: f32 = (0..COLUMNS)
        .map(|k| {
            let p = (k as f32 + 0.5) / (2 * COLUMNS) as f32;
            // Alpha is linear along a column, from a to b.
            let a = own + p * (row - own);
            let b = 0.5 * (a + column + p * (across - column));
            match (passes(a), passes(b)) {
                (true, true) => 1.0,
                (false, false) => 0.0,
                (first, _) => ((if first { a } else { b } - cutoff) / (a - b).abs()).clamp(0.0, 1.0),
            }
        })
        .sum();
    // Some of the corners pass and some do not, so the share is neither 0 nor 1.
    (sum / COLUMNS as f32).clamp(1e-3, 1.0 - 1e-3)
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
    use std::sync::Arc;

    use super::*;
    use crate::scene::TextureRef;
    use proptest::prelude::*;

    /// 8 × 6 texels; those with x + y < 5 are there.
    fn corner(wrap: Wrap) -> Texture {
        let texels = (0..48u32).map(|i| [0, 0, 0, if i % 8 + i / 8 < 5 { 255 } else { 0 }]).collect();
        let mut texture = Texture::new("corner", 8, 6, texels);
        texture.wrap = [wrap; 2];
        texture
    }

    fn sums(texture: &Texture, alpha: Alpha) -> AlphaSums {
        let transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let texture = Some(TextureRef { texture: Arc::new(texture.clone()), tex_coord: 0, transform });
        AlphaSums::of(&Material { texture, alpha, ..Material::default() }).unwrap()
    }

    #[test]
    fn boxes_of_texels() {
        let blend = sums(&corner(Wrap::Repeat), Alpha::Blend);
        assert_eq!(blend.classify([0.1, 0.1], [0.2, 0.3]), AlphaClass::Opaque);
        assert_eq!(blend.classify([0.7, 0.7], [0.9, 0.9]), AlphaClass::Transparent);
        assert_eq!(blend.classify([0.1, 0.1], [0.7, 0.9]), AlphaClass::Mixed);
        assert_eq!(blend.classify([-1e30, 0.1], [f64::NAN, 0.2]), AlphaClass::Mixed);
        // 5 + 4 + 3 + 2 + 1 of 48, over one or many periods.
        assert!((blend.mean([0.5, 0.5], 8.0) - 15.0 / 48.0).abs() < 1e-6);
        assert!((blend.mean([7.3, -2.1], 800.0) - 15.0 / 48.0).abs() < 1e-6);
        assert_eq!(blend.mean([0.5 / 8.0, 0.5 / 6.0], 1.0), 1.0);
        let none = sums(&Texture::default(), Alpha::Blend);
        assert_eq!(none.classify([0.0, 0.0], [1.0, 1.0]), AlphaClass::Transparent);
        assert_eq!(none.mean([0.3, 0.3], 2.0), 0.0);
    }

    /// Squares of 3 × 3 texels of 0 and 1: the border between them is where alpha is ½.
    #[test]
    fn a_checkerboard_covers_half() {
        let texels = (0..36 * 36).map(|i| [0, 0, 0, if (i % 36 / 3 + i / 108) % 2 == 0 { 255 } else { 0 }]).collect();
        let board = sums(&Texture::new("board", 36, 36, texels), Alpha::Mask(0.5));
        assert_eq!(board.mean([0.5; 2], 36.0), 0.5);
    }

    #[test]
    fn an_opaque_material_or_one_without_texture_has_no_table() {
        assert!(AlphaSums::of(&Material { alpha: Alpha::Mask(0.5), ..Material::default() }).is_none());
    }

    /// A lone opaque texel under a cutoff c: a bilinear lookup passes where (1 − x)(1 − y) ≥ c, which is four times
    /// 1 − c + c ln c of a texel's area.
    #[test]
    fn a_mask_covers_what_filtered_lookups_pass() {
        let texels = (0..64).map(|i| [0, 0, 0, if i == 27 { 255 } else { 0 }]).collect();
        let mut lone = Texture::new("lone", 8, 8, texels);
        for cutoff in [0.1f64, 0.5, 0.9] {
            let found = 64.0 * f64::from(sums(&lone, Alpha::Mask(cutoff as f32)).mean([0.5; 2], 8.0));
            let right = 4.0 * (1.0 - cutoff + cutoff * cutoff.ln());
            // Nine texels rounded to 255ths, and columns of a sixteenth.
            assert!((found - right).abs() < 0.02, "{cutoff}: {found} {right}");
        }
        lone.nearest = true;
        assert_eq!(sums(&lone, Alpha::Mask(0.9)).mean([0.5; 2], 8.0), 1.0 / 64.0);
    }

    /// However wide the box, the mean over a range is the range's own; what is beside it does not count.
    #[test]
    fn folded_boxes_keep_a_ranges_mean() {
        let blend = sums(&corner(Wrap::Repeat), Alpha::Blend);
        // The upper left 4 × 3 texels: all but the one at (3, 2), where x + y = 5.
        let range = [[0.0, 0.0], [0.5, 0.5]];
        for width in [1.0, 1.3, 2.0, 2.7, 3.0, 4.0, 5.5, 1000.0] {
            const N: u32 = 120;
            let at = |i: u32, size: f64| (f64::from(i) + 0.5) / f64::from(N) * size;
            let places = (0..N * N).map(|i| [at(i % N, 0.5), at(i / N, 0.5)]);
            let mean =
                places.map(|uv| f64::from(blend.mean_within(uv, [width; 2], range))).sum::<f64>() / f64::from(N * N);
            // 120 places an axis, none of which lies on a texel's border: 1e-3 of the mean of what is linear between them.
            assert!((mean - 11.0 / 12.0).abs() < 2e-3, "{width}: {mean}");
        }
        assert_eq!(fold(1.0, 4.0, 0.0, 8.0), [Some((0.0, 3.0)), Some((0.0, 1.0))]);
        assert_eq!(fold(7.5, 4.0, 0.0, 8.0), [Some((5.5, 8.0)), Some((6.5, 8.0))]);
        assert_eq!(pieces((5.5, 8.0)).collect::<Vec<_>>(), [(5, 6, 0.5), (6, 8, 1.0)]);
        assert_eq!(pieces((5.25, 5.75)).collect::<Vec<_>>(), [(5, 6, 0.5)]);
        assert_eq!(pieces((-0.5, 1.25)).collect::<Vec<_>>(), [(-1, 0, 0.5), (0, 1, 1.0), (1, 2, 0.25)]);
        assert_eq!(pieces((0.2, 0.2)).collect::<Vec<_>>(), [(0, 1, 1.0)]);
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
            let hi = [lo[0] + size[0], lo[1] + size[1]];
            let found = texture.sample([0, 1].map(|k| (lo[k] + at[k] * size[k]) as f32))[3];
            match sums(&texture, Alpha::Mask(0.3)).classify(lo, hi) {
                AlphaClass::Transparent => prop_assert!(found < 0.3 + 1e-5),
                AlphaClass::Opaque => prop_assert!(found > 0.3 - 1e-5),
                AlphaClass::Mixed => {}
            }
            let sums = sums(&texture, Alpha::Blend);
            match sums.classify(lo, hi) {
                // f32's steps of the coordinate: 3e-7 of a period, 2e-6 of a texel.
                AlphaClass::Transparent => prop_assert!(found < 1e-5),
                AlphaClass::Opaque => prop_assert!(found > 1.0 - 1e-5),
                AlphaClass::Mixed => {}
            }
        }
    }
}

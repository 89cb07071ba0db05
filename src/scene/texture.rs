//! Textures: point lookups and prefiltered averages of images, in linear light.
//!
//! Based on: Williams, *Pyramidal Parametrics*, 1983 (mip levels); Porter & Duff, *Compositing Digital Images*, 1984
//! (colour is averaged weighted by alpha, so that what is not there does not tint what is).

use std::sync::{Arc, LazyLock, OnceLock};

/// Continuation of a texture beyond [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wrap {
    /// The texture is repeated.
    #[default]
    Repeat,
    /// The texture is repeated, every second copy mirrored.
    Mirror,
    /// The texels at the edge continue.
    Clamp,
}

/// A texture as a material uses it.
#[derive(Debug, Clone)]
pub struct TextureRef {
    /// The image.
    pub texture: Arc<Texture>,
    /// Index into the part's sets of texture coordinates, after KHR_texture_transform's override.
    pub tex_coord: usize,
    /// uv' = rows · (u, v, 1): KHR_texture_transform, identity where absent.
    pub transform: [[f32; 3]; 2],
}

impl TextureRef {
    /// The transformed texture coordinate.
    pub fn map(&self, uv: [f32; 2]) -> [f32; 2] {
        self.transform.map(|r| r[0] * uv[0] + r[1] * uv[1] + r[2])
    }
}

/// A decoded image: 8-bit RGBA, sRGB-encoded colour, linear alpha, row 0 at v = 0 (the top, as in glTF).
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Texture {
    /// Name, for messages.
    pub name: String,
    /// Texels per row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// `width * height` texels, row by row.
    pub texels: Vec<[u8; 4]>,
    /// Continuation along u and v.
    pub wrap: [Wrap; 2],
    /// Nearest texel instead of bilinear.
    pub nearest: bool,
    /// Levels 1, 2, … of the pyramid, made when first asked for.
    levels: OnceLock<Vec<Level>>,
}

/// A coarser copy: linear colour times alpha, and alpha, both of 65535.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Level {
    width: u32,
    height: u32,
    texels: Vec<[u16; 4]>,
}

/// Linear value of each sRGB code (IEC 61966-2-1).
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|code| {
        let c = code as f64 / 255.0;
        (if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) }) as f32
    })
});

/// The linear value in [0, 1] of an sRGB code.
pub fn srgb_to_linear(code: u8) -> f32 {
    LINEAR[usize::from(code)]
}

impl Texture {
    /// An image of `width` × `height` texels that repeats and is filtered.
    /// Missing texels read as transparent black.
    pub fn new(name: impl Into<String>, width: u32, height: u32, texels: Vec<[u8; 4]>) -> Self {
        Texture { name: name.into(), width, height, texels, ..Texture::default() }
    }

    /// Whether at least a hundredth of the image is more transparent than opaque, so that its alpha was probably meant as a cutout.
    pub fn has_cutouts(&self) -> bool {
        let transparent = self.texels.iter().filter(|t| t[3] < 128).count();
        transparent > 0 && 100 * transparent >= self.texels.len()
    }

    /// The alpha of [`Texture::sample`].
    pub fn alpha(&self, uv: [f32; 2]) -> f32 {
        let alpha =
            |x: usize, y: usize| f32::from(self.texels.get(y * self.width as usize + x).map_or(0, |t| t[3])) / 255.0;
        if self.nearest {
            let [x, y] = self.nearest(uv);
            return alpha(x, y);
        }
        bilinear(uv, self.wrap, [self.width, self.height]).iter().map(|&(x, y, w)| w * alpha(x, y)).sum()
    }

    /// Linear RGBA at `uv`, bilinear between the four nearest texels, or the nearest one where the texture says so.
    /// Colour is weighted by alpha; it is not multiplied by it.
    pub fn sample(&self, uv: [f32; 2]) -> [f32; 4] {
        if self.nearest {
            let [x, y] = self.nearest(uv);
            return self.texel(x, y);
        }
        let taps = bilinear(uv, self.wrap, [self.width, self.height]);
        let (mut weighted, mut plain, mut alpha) = ([0.0; 3], [0.0; 3], 0.0);
        for (x, y, w) in taps {
            let t = self.texel(x, y);
            for c in 0..3 {
                weighted[c] += w * t[3] * t[c];
                plain[c] += w * t[c];
            }
            alpha += w * t[3];
        }
        let colour = if alpha > 0.0 { weighted.map(|c| c / alpha) } else { plain };
        [colour[0], colour[1], colour[2], alpha]
    }

    /// Linear RGBA averaged over a square of `footprint` texels a side around `uv`: colour weighted by alpha (black
    /// where alpha is 0 throughout), and the mean alpha. A footprint of 1 or less is [`Texture::sample`].
    pub fn average(&self, uv: [f32; 2], footprint: f32) -> [f32; 4] {
        // Bilinear lookup in level k weighs texels by a box convolved with a box of 2^k: its variance is that of one
        // box √2 · 2^k wide.
        let lod = footprint.max(1.0).log2() - 0.5;
        if lod.is_nan() || lod <= 0.0 {
            return self.sample(uv);
        }
        let levels = self.levels();
        let lod = lod.min(levels.len() as f32);
        let (fine, t) = (lod.floor() as usize, lod.fract());
        let mut sum = self.premultiplied(levels, fine, uv);
        if t > 0.0 {
            let coarse = self.premultiplied(levels, fine + 1, uv);
            for c in 0..4 {
                sum[c] += t * (coarse[c] - sum[c]);
            }
        }
        let a = sum[3];
        if a > 0.0 { [sum[0] / a, sum[1] / a, sum[2] / a, a] } else { [0.0; 4] }
    }

    /// Bilinear lookup in level `k` (0: the image), colour multiplied by alpha.
    fn premultiplied(&self, levels: &[Level], k: usize, uv: [f32; 2]) -> [f32; 4] {
        let Some(level) = k.checked_sub(1).and_then(|k| levels.get(k)) else {
            let s = self.sample(uv);
            return [s[0] * s[3], s[1] * s[3], s[2] * s[3], s[3]];
        };
        let mut sum = [0.0; 4];
        for (x, y, w) in bilinear(uv, self.wrap, [level.width, level.height]) {
            let t = level.texels[y * level.width as usize + x];
            for c in 0..4 {
                sum[c] += w * f32::from(t[c]);
            }
        }
        sum.map(|v| v / 65535.0)
    }

    /// The texel that `uv` lies in.
    fn nearest(&self, uv: [f32; 2]) -> [usize; 2] {
        let at = |k: usize, size: u32| {
            let x = period(uv[k], self.wrap[k]) * size as f32;
            wrapped(x.floor() as i32, size, self.wrap[k])
        };
        [at(0, self.width), at(1, self.height)]
    }

    /// Linear RGBA of one texel.
    fn texel(&self, x: usize, y: usize) -> [f32; 4] {
        let t = self.texels.get(y * self.width as usize + x).copied().unwrap_or_default();
        [srgb_to_linear(t[0]), srgb_to_linear(t[1]), srgb_to_linear(t[2]), f32::from(t[3]) / 255.0]
    }

    fn levels(&self) -> &[Level] {
        self.levels.get_or_init(|| {
            let mut levels: Vec<Level> = Vec::new();
            let (mut w, mut h) = (self.width, self.height);
            while w > 1 || h > 1 {
                let size = [(w / 2).max(1), (h / 2).max(1)];
                let level = match levels.last() {
                    None => halve([w, h], size, |x, y| {
                        let t = self.texel(x, y);
                        [t[0] * t[3], t[1] * t[3], t[2] * t[3], t[3]]
                    }),
                    Some(finer) => halve([w, h], size, |x, y| {
                        finer.texels[y * finer.width as usize + x].map(|v| f32::from(v) / 65535.0)
                    }),
                };
                levels.push(level);
                [w, h] = size;
            }
            levels
        })
    }
}

/// The exact box filter from `from` to `to` texels, odd sizes included.
fn halve(from: [u32; 2], to: [u32; 2], texel: impl Fn(usize, usize) -> [f32; 4]) -> Level {
    let (columns, rows) = (spans(from[0], to[0]), spans(from[1], to[1]));
    let mut texels = Vec::with_capacity(columns.len() * rows.len());
    for row in &rows {
        for column in &columns {
            let mut sum = [0.0; 4];
            for &(y, wy) in row {
                for &(x, wx) in column {
                    let t = texel(x, y);
                    for c in 0..4 {
                        sum[c] += wx * wy * t[c];
                    }
                }
            }
            texels.push(sum.map(|v| (v * 65535.0 + 0.5) as u16));
        }
    }
    Level { width: to[0], height: to[1], texels }
}

/// For each of `to` cells the up to three of `from` cells that it overlaps, with their shares.
fn spans(from: u32, to: u32) -> Vec<Vec<(usize, f32)>> {
    let scale = f64::from(from) / f64::from(to);
    (0..to)
        .map(|i| {
            let (a, b) = (f64::from(i) * scale, f64::from(i + 1) * scale);
            (a.floor() as u32..(b.ceil() as u32).min(from))
                .map(|x| (x as usize, ((b.min(f64::from(x) + 1.0) - a.max(f64::from(x))) / scale) as f32))
                .collect()
        })
        .collect()
}

/// The coordinate brought into one period, so that its cell index is small; 0 where it is not a number.
fn period(u: f32, wrap: Wrap) -> f32 {
    let u = match wrap {
        Wrap::Repeat => u - u.floor(),
        Wrap::Mirror => u - 2.0 * (0.5 * u).floor(),
        Wrap::Clamp => u.clamp(-1.0, 2.0),
    };
    if u.is_finite() { u } else { 0.0 }
}

/// Index of the texel that cell `i` shows.
pub(super) fn wrapped(i: i32, size: u32, wrap: Wrap) -> usize {
    let n = size.clamp(1, i32::MAX as u32 / 2) as i32;
    (match wrap {
        Wrap::Repeat => i.rem_euclid(n),
        Wrap::Mirror => {
            let m = i.rem_euclid(2 * n);
            m.min(2 * n - 1 - m)
        }
        Wrap::Clamp => i.clamp(0, n - 1),
    }) as usize
}

/// The four texels around `uv` and their weights.
fn bilinear(uv: [f32; 2], wrap: [Wrap; 2], size: [u32; 2]) -> [(usize, usize, f32); 4] {
    let axis = |k: usize| {
        let x = period(uv[k], wrap[k]) * size[k] as f32 - 0.5;
        let cell = x.floor();
        let i = cell as i32;
        (wrapped(i, size[k], wrap[k]), wrapped(i + 1, size[k], wrap[k]), x - cell)
    };
    let ((x0, x1, tx), (y0, y1, ty)) = (axis(0), axis(1));
    [(x0, y0, (1.0 - tx) * (1.0 - ty)), (x1, y0, tx * (1.0 - ty)), (x0, y1, (1.0 - tx) * ty), (x1, y1, tx * ty)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checker(n: u32) -> Texture {
        let texels =
            (0..n * n).map(|i| if (i % n + i / n).is_multiple_of(2) { [255; 4] } else { [0, 0, 0, 255] }).collect();
        Texture::new("checker", n, n, texels)
    }

    #[test]
    fn srgb_codes_are_linearised() {
        assert_eq!((srgb_to_linear(0), srgb_to_linear(255)), (0.0, 1.0));
        // IEC 61966-2-1 by hand: ((128/255 + .055) / 1.055)^2.4.
        assert!((srgb_to_linear(128) - 0.215_860_5).abs() < 1e-6);
    }

    #[test]
    fn wraps_show_the_right_texel() {
        let row: Vec<[u8; 4]> = [10, 20, 30, 40].map(|v| [v, v, v, 255]).to_vec();
        let mut t = Texture::new("row", 4, 1, row);
        t.nearest = true;
        let mut code = |wrap, u: f32| {
            t.wrap = [wrap; 2];
            let v = t.sample([u, 0.5])[0];
            (0..=255u8).find(|&c| srgb_to_linear(c) == v).unwrap()
        };
        for (u, repeat, mirror, clamp) in [
            (0.1, 10, 10, 10),
            (0.9, 40, 40, 40),
            (1.1, 10, 40, 40),
            (-0.1, 40, 10, 10),
            (2.3, 20, 20, 40),
            (1e30, 10, 10, 40),
            (f32::NAN, 10, 10, 10),
            (f32::INFINITY, 10, 10, 40),
        ] {
            assert_eq!(code(Wrap::Repeat, u), repeat, "{u}");
            assert_eq!(code(Wrap::Mirror, u), mirror, "{u}");
            assert_eq!(code(Wrap::Clamp, u), clamp, "{u}");
        }
    }

    #[test]
    fn averages_are_in_linear_light_and_weighted_by_alpha() {
        let t = checker(8);
        assert!((t.sample([0.125, 0.0625])[0] - 0.5).abs() < 1e-6, "half-way between a white and a black texel");
        for uv in [[0.3, 0.7], [0.0, 0.0], [-3.2, 9.9]] {
            // Beyond level 1 a checker is a constant, to the 16 bits of a level.
            assert!((t.average(uv, 4.0)[0] - 0.5).abs() < 2e-5);
            assert!((t.average(uv, 1e9)[0] - 0.5).abs() < 2e-5);
        }
        // A red leaf on transparent white stays red.
        let leaf = Texture::new("leaf", 2, 1, vec![[255, 0, 0, 255], [255, 255, 255, 0]]);
        let a = leaf.average([0.5, 0.5], 64.0);
        assert_eq!((a[0], a[1], a[2]), (1.0, 0.0, 0.0));
        assert!((a[3] - 0.5).abs() < 1e-4);
        assert_eq!(leaf.sample([0.5, 0.5]), [1.0, 0.0, 0.0, 0.5]);
    }

    #[test]
    fn odd_sizes_keep_their_mean() {
        let texels: Vec<[u8; 4]> = (0..35u8).map(|i| [0, 0, 0, i * 7]).collect();
        let mean = texels.iter().map(|t| f64::from(t[3])).sum::<f64>() / 35.0 / 255.0;
        let t = Texture::new("odd", 7, 5, texels);
        // One rounding to 16 bits a level, three levels.
        assert!((f64::from(t.average([0.2, 0.4], 1e6)[3]) - mean).abs() < 3.0 / 65535.0);
    }

    #[test]
    fn an_image_without_texels_is_transparent() {
        for t in [Texture::new("none", 0, 0, vec![]), Texture::new("short", 4, 4, vec![])] {
            assert_eq!(t.sample([0.5, 0.5]), [0.0; 4]);
            assert_eq!(t.average([0.5, 0.5], 8.0), [0.0; 4]);
        }
    }
}

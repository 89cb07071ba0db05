//! Discrete jitter: a hash of the cell decides whether it holds a copy, of which texel, and how that is turned, mirrored, scaled, displaced
//! and tinted. Normative:
//! `format-spec/landscape-1.md`, §1 and §2.
//!
//! Based on: F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, RR-2846, 1996 (discrete jittering);
//! M. Jarzynski, M. Olano, *Hash Functions for GPU Rendering*, JCGT 2020 (pcg4d).

use super::layer::TexelLayer;
use crate::geom::{Aabb, DMat3, DVec3, Vec3};
use crate::scene::shell::{CellWrap, Discrete, Orientations};

/// pcg4d on (u, v, w, seed), coordinates and seed as 32-bit two's complement.
pub fn hash(cell: [i64; 3], seed: u32) -> [u32; 4] {
    let mut v = [cell[0] as u32, cell[1] as u32, cell[2] as u32, seed]
        .map(|x| x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let mix = |v: &mut [u32; 4]| {
        v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[3]));
        v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
        v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
        v[3] = v[3].wrapping_add(v[1].wrapping_mul(v[2]));
    };
    mix(&mut v);
    v = v.map(|x| x ^ (x >> 16));
    mix(&mut v);
    v
}

/// Seeds of the second and third group of four numbers of a cell.
fn second_seed(seed: u32) -> u32 {
    !seed
}
fn third_seed(seed: u32) -> u32 {
    seed ^ 0x9e37_79b9
}

fn unit(x: u32) -> f64 {
    f64::from(x) * (1.0 / 4_294_967_296.0)
}

/// The point about which copies are scaled: the middle of the cube's floor.
const BASE: DVec3 = DVec3::new(0.5, 0.5, 0.0);
/// The point about which copies are turned.
const CENTRE: DVec3 = DVec3::splat(0.5);

/// The copy of one cell.
#[derive(Debug, Clone, Copy)]
pub struct PlacedCopy {
    pub texel: usize,
    /// Multiplies its albedo.
    pub tint: Vec3,
    /// See [`super::layer::TexelChoice::phong`].
    pub phong: u32,
    /// Map from the cell to texel space: x = linear · y + offset.
    pub linear: DMat3,
    pub offset: DVec3,
    /// 1 / its scale.
    pub inverse_scale: f64,
}

impl TexelLayer {
    /// The copy of `cell`, without the reflection of a mirrored cell; `None` where the cell is empty.
    pub fn place(&self, cell: [i64; 3]) -> Option<PlacedCopy> {
        let Some(discrete) = &self.layer.discrete else {
            let first = self.choices.first()?;
            let (texel, tint, phong) = (first.texel_of(cell), first.tint, first.phong);
            return Some(PlacedCopy {
                texel,
                tint,
                phong,
                linear: DMat3::IDENTITY,
                offset: DVec3::ZERO,
                inverse_scale: 1.0,
            });
        };
        let h = hash(cell, discrete.seed).map(unit);
        if h[0] >= discrete.presence {
            return None;
        }
        let choice = self.choices.iter().find(|c| h[1] < c.cumulative).or(self.choices.last())?;
        let moved = discrete.displace.iter().any(|&d| d != 0.0) || discrete.mirror.contains(&true);
        let h2 = if moved { hash(cell, second_seed(discrete.seed)).map(unit) } else { [0.5; 4] };
        let scale = discrete.scale[0] + h[3] * (discrete.scale[1] - discrete.scale[0]);
        let mut turn = orientation(discrete.orientations, h[2]);
        let bits = (8.0 * h2[3]) as u32;
        for k in (0..3).filter(|&k| discrete.mirror[k] && bits >> k & 1 == 1) {
            let mut flip = DVec3::ONE;
            flip[k] = -1.0;
            turn = DMat3::from_diagonal(flip) * turn;
        }
        // Texel → cell: y = shift + scale · turn · (x − CENTRE).
        let mut shift = BASE + scale * (CENTRE - BASE);
        if moved {
            let corners = [choice.content.min, choice.content.max];
            let extent = Aabb::around(corners.map(|c| scale * (turn * (c - CENTRE)) + shift));
            for k in 0..3 {
                let by = discrete.displace[k] * (2.0 * h2[k] - 1.0);
                shift[k] += if self.layer.wrap[k] == CellWrap::Empty {
                    by.clamp((-extent.min[k]).min(0.0), (1.0 - extent.max[k]).max(0.0))
                } else {
                    by
                };
            }
        }
        let linear = turn.transpose() * (1.0 / scale);
        let ramp = self.ramp(discrete, cell);
        let offset = CENTRE - linear * shift;
        let (tint, phong) = (choice.tint * ramp, choice.phong);
        Some(PlacedCopy { texel: choice.texel_of(cell), tint, phong, linear, offset, inverse_scale: 1.0 / scale })
    }

    /// The tint that the hash chooses from the layer's colour ramp.
    fn ramp(&self, discrete: &Discrete, cell: [i64; 3]) -> Vec3 {
        let [first, .., last] = &discrete.tint[..] else {
            return discrete.tint.first().map_or(Vec3::ONE, |t| Vec3::from_array(t.map(|v| v as f32)));
        };
        let x = unit(hash(cell, third_seed(discrete.seed))[0]) * (discrete.tint.len() - 1) as f64;
        let j = x as usize;
        let [a, b] = [discrete.tint.get(j).unwrap_or(first), discrete.tint.get(j + 1).unwrap_or(last)];
        Vec3::from_array(std::array::from_fn(|k| (a[k] + (x - j as f64) * (b[k] - a[k])) as f32))
    }

    /// Number of cells by which the content of a copy may reach beyond its own cell, along each axis.
    pub fn reach(&self) -> [i64; 3] {
        let Some(discrete) = &self.layer.discrete else { return [0; 3] };
        // Largest distance of the content from the middle of the cube, along axis k, after any of the orientations.
        let from_middle = |k: usize| {
            let far = |c: &Aabb, k: usize| (c.min[k] - 0.5).abs().max((c.max[k] - 0.5).abs());
            let axes: &[usize] = match discrete.orientations {
                Orientations::Identity => &[k],
                Orientations::W4 | Orientations::W8 => {
                    if k < 2 {
                        &[0, 1]
                    } else {
                        &[2]
                    }
                }
                Orientations::Cube24 | Orientations::Cube48 => &[0, 1, 2],
            };
            let all = self.choices.iter().flat_map(|c| axes.iter().map(move |&axis| far(&c.content, axis)));
            all.fold(0.0, f64::max)
        };
        std::array::from_fn(|k| match self.layer.wrap[k] {
            CellWrap::Empty => 0,
            _ => {
                // Along w copies are scaled about the floor of the cell, which keeps the content in the cube as well.
                let room = if k == 2 { 0.5 } else { discrete.scale[1] * from_middle(k) };
                (discrete.displace[k] + room - 0.5 - 1e-9).ceil().clamp(0.0, 1e3) as i64
            }
        })
    }
}

/// The matrix of an orientation, chosen by h in [0, 1).
fn orientation(of: Orientations, h: f64) -> DMat3 {
    let number = |n: f64| (h * n) as usize;
    match of {
        Orientations::Identity => DMat3::IDENTITY,
        Orientations::W4 => w_orientation(number(4.0)),
        Orientations::W8 => w_orientation(number(8.0)),
        Orientations::Cube24 => (0..48)
            .map(signed_permutation)
            .filter(|m| m.determinant() > 0.0)
            .nth(number(24.0))
            .unwrap_or(DMat3::IDENTITY),
        Orientations::Cube48 => signed_permutation(number(48.0)),
    }
}

/// Orientation i of 8: quarter turns about w, from 4 on after v is mirrored.
fn w_orientation(i: usize) -> DMat3 {
    let (cos, sin) = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][i & 3];
    let m = if i >= 4 { -1.0 } else { 1.0 };
    DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::new(-sin * m, cos * m, 0.0), DVec3::Z)
}

/// Orientation i of 48: a signed permutation of the axes.
fn signed_permutation(i: usize) -> DMat3 {
    const PERMUTATIONS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let permutation = PERMUTATIONS[(i / 8).min(5)];
    let mut rows = [DVec3::ZERO; 3];
    for k in 0..3 {
        rows[k][permutation[k]] = if i >> k & 1 == 1 { -1.0 } else { 1.0 };
    }
    DMat3::from_cols(rows[0], rows[1], rows[2]).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::layer::TexelChoice;
    use crate::scene::shell::Layer;

    /// Frozen: files that vary copies by the hash must look the same for ever. Computed apart, from the text of the specification.
    #[test]
    fn the_vectors_of_the_specification() {
        let text = include_str!("../../format-spec/vectors/landscape-1.txt");
        let (mut hashes, mut turns, mut places) = (0, 0, 0);
        for line in text.lines().filter(|l| !l.starts_with('#')) {
            let (given, wanted) = line.split_once(" → ").unwrap();
            let words: Vec<&str> = given.split(' ').collect();
            let number = |i: usize| words[i].parse::<f64>().unwrap();
            let whole = |i: usize| words[i].parse::<i64>().unwrap();
            let wanted: Vec<f64> = wanted.split(' ').map(|w| w.parse().unwrap()).collect();
            let kind = |i: usize| match words[i] {
                "w4" => (Orientations::W4, 4.0),
                "w8" => (Orientations::W8, 8.0),
                "cube24" => (Orientations::Cube24, 24.0),
                "cube48" => (Orientations::Cube48, 48.0),
                _ => (Orientations::Identity, 1.0),
            };
            match words[0] {
                "hash" => {
                    let found = hash([whole(1), whole(2), whole(3)], whole(4) as u32);
                    assert_eq!(found.map(f64::from), wanted[..], "{line}");
                    hashes += 1;
                }
                "orient" => {
                    let (of, n) = kind(1);
                    let found = orientation(of, (number(2) + 0.5) / n).transpose().to_cols_array();
                    assert_eq!(found, wanted[..], "{line}");
                    turns += 1;
                }
                "place" => {
                    let mirror = [0, 1, 2].map(|k| whole(3) >> k & 1 == 1);
                    let discrete = Discrete {
                        seed: whole(1) as u32,
                        orientations: kind(2).0,
                        mirror,
                        scale: [number(4), number(5)],
                        displace: [number(6), number(7), number(8)],
                        ..Discrete::default()
                    };
                    let layer = Layer { wrap: [CellWrap::Repeat; 3], discrete: Some(discrete), ..Layer::default() };
                    let layer = TexelLayer::new(layer, vec![TexelChoice::plain(Aabb::UNIT)]);
                    let copy = layer.place([whole(9), whole(10), whole(11)]).unwrap();
                    let y = DVec3::from_slice(&wanted);
                    let x = DVec3::new(number(12), number(13), number(14));
                    // Numbers of at most some units, inverted once: 1e-12 is a thousand roundings.
                    assert!((copy.linear * y + copy.offset - x).abs().max_element() < 1e-12, "{line}");
                    places += 1;
                }
                _ => {}
            }
        }
        assert!(hashes >= 5 && turns >= 20 && places >= 15);
    }

    #[test]
    fn orientations_are_all_different() {
        for (of, n) in [(Orientations::W8, 8), (Orientations::Cube24, 24), (Orientations::Cube48, 48)] {
            let all: Vec<DMat3> = (0..n).map(|i| orientation(of, (f64::from(i) + 0.5) / f64::from(n))).collect();
            for (i, a) in all.iter().enumerate() {
                assert!((*a * a.transpose()).abs_diff_eq(DMat3::IDENTITY, 0.0) && !all[..i].contains(a));
            }
            let right = all.iter().filter(|m| m.determinant() > 0.0).count();
            assert_eq!(right, if n == 24 { 24 } else { n as usize / 2 });
        }
    }

    #[test]
    fn ramps_run_from_the_first_to_the_last_colour() {
        let tint = vec![[0.0, 1.0, 0.5], [1.0, 1.0, 0.5], [1.0, 3.0, 0.5]];
        let discrete = Discrete { seed: 9, tint, ..Discrete::default() };
        let choice = TexelChoice { tint: Vec3::splat(2.0), ..TexelChoice::plain(Aabb::UNIT) };
        let layer = TexelLayer::new(Layer { discrete: Some(discrete), ..Layer::default() }, vec![choice]);
        let tints: Vec<Vec3> = (0..1000).map(|i| layer.place([i, 3, 0]).unwrap().tint).collect();
        let first = tints.iter().filter(|t| t.y == 2.0).count();
        assert!(tints.iter().all(|t| t.z == 1.0 && (t.y == 2.0 || t.x == 2.0) && t.y <= 6.0));
        // Half of 1000, of which the standard deviation is 16.
        assert!((436..=564).contains(&first), "{first}");
    }
}

//! Continuous jitter: noise that displaces texel coordinates along a ray. Normative: `format-spec/landscape-1.md`, §4.
//!
//! Based on: F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, RR-2846, 1996 (continuous jittering of texture
//! coordinates, of height vectors' directions and lengths); K. Perlin, *Improving Noise*, SIGGRAPH 2002; S. Porumbescu et al.,
//! *Shell Maps*, SIGGRAPH 2005 (a ray is a curve in texture space).
//!
//! The noise is a function of a point's position in the shell, and not of its face. It is evaluated along the ray, whose path in texel
//! coordinates is then a curve; that is subdivided into chords. So a picture does not depend on how finely the mesh is tessellated.

use super::shell::{ShellPoint, ShellSegment};
use crate::geom::{DMat3, DVec3};
use crate::noise::Noise;
use crate::scene::shell::Continuous;

/// Upper bound of the magnitude of the noise, of one octave or of the weighted sum of several.
const NOISE_MAX: f64 = 1.04;
/// Length of the first chords, in lattice cells of the finest octave: shorter than any feature of the noise.
const FIRST_CHORD: f64 = 0.5;
/// Most first chords of one segment. A ray that grazes a thousand cells sees them so small that coarser chords do not show.
const MAX_CHORDS: f64 = 4096.0;
/// Most halvings of a first chord.
const MAX_DEPTH: u32 = 8;
/// Margin of w coordinates against rounding, in cells.
const REACH_SLACK: f64 = 1e-6;
/// Distance between the seeds of the six noises; octaves take up to eight seeds each.
const SEED_STRIDE: u32 = 16;

/// The noises of a layer: of u, v and w, of the two tilts of the height vectors, and of their lengths.
#[derive(Debug, Clone)]
pub struct JitterNoise {
    noises: [Noise; 6],
    amplitude: DVec3,
    tilt: f64,
    scale: f64,
}

/// A point after jitter.
struct JitteredPoint {
    q: DVec3,
    /// Height in the shell as a share of the height vector.
    height: f64,
}

/// Factor by which a shell must be higher than its height vectors to hold what continuous jitter lengthens.
pub fn height_stretch(continuous: Option<&Continuous>) -> f64 {
    continuous.map_or(1.0, |c| 1.0 + NOISE_MAX * c.height_scale)
}

impl JitterNoise {
    /// The noises of a layer.
    pub fn new(continuous: &Continuous) -> JitterNoise {
        let noise = |k: u32| Noise {
            seed: continuous.seed.wrapping_add(SEED_STRIDE * k),
            frequency: DVec3::from_array(continuous.frequency),
            origin: DVec3::ZERO,
            period: [0; 3],
            octaves: continuous.octaves,
            turbulence: false,
        };
        JitterNoise {
            noises: [0, 1, 2, 3, 4, 5].map(noise),
            amplitude: DVec3::from_array(continuous.uvw_amplitude),
            tilt: continuous.height_tilt,
            scale: continuous.height_scale,
        }
    }

    /// Noise number `k` at a base point; 0 without evaluation where its amplitude is 0.
    fn noise(&self, k: usize, base: DVec3) -> f64 {
        let strength = [self.amplitude.x, self.amplitude.y, self.amplitude.z, self.tilt, self.tilt, self.scale][k];
        if strength == 0.0 { 0.0 } else { self.noises[k].value(base) }
    }

    /// A point after jitter, in the layer's texel coordinates, and its height in the shell as a share of the height vector.
    #[cfg(feature = "bake")]
    pub fn jittered(&self, p: &ShellPoint) -> (DVec3, f64) {
        let point = self.at(p);
        (point.q, point.height)
    }

    fn at(&self, p: &ShellPoint) -> JitteredPoint {
        let base = DVec3::new(p.q.x, p.q.y, p.q.z - p.rise);
        let n: [f64; 6] = std::array::from_fn(|k| p.mask * self.noise(k, base));
        let longer = 1.0 + self.scale * n[5];
        let lean = [n[3], n[4]].map(|n| p.rise * libm::tan(self.tilt * n));
        let q = base + self.amplitude * DVec3::new(n[0], n[1], n[2]);
        JitteredPoint { q: q + DVec3::new(-lean[0], -lean[1], p.rise / longer), height: p.height / longer }
    }

    /// d(u', v', w') / d(u, v, w) at constant base height and mask.
    fn derivative(&self, p: &ShellPoint) -> DMat3 {
        let base = DVec3::new(p.q.x, p.q.y, p.q.z - p.rise);
        // Value and slope along u and v.
        let all: [(f64, [f64; 2]); 6] = std::array::from_fn(|k| {
            let (value, slope) = self.noises[k].at(base);
            (p.mask * value, [p.mask * slope.x, p.mask * slope.y])
        });
        let longer = 1.0 + self.scale * all[5].0;
        let lean = |k: usize| {
            let angle = libm::tan(self.tilt * all[k].0);
            (angle, p.rise * self.tilt * (1.0 + angle * angle))
        };
        let (lean_u, lean_v) = (lean(3), lean(4));
        let along = |axis: usize| {
            DVec3::new(
                self.amplitude.x * all[0].1[axis] - lean_u.1 * all[3].1[axis],
                self.amplitude.y * all[1].1[axis] - lean_v.1 * all[4].1[axis],
                self.amplitude.z * all[2].1[axis] - p.rise * self.scale * all[5].1[axis] / (longer * longer),
            )
        };
        DMat3::from_cols(DVec3::X + along(0), DVec3::Y + along(1), DVec3::new(-lean_u.0, -lean_v.0, 1.0 / longer))
    }

    /// The part of a segment, as an interval of t, outside of which no jitter can bring the ray to w coordinates in `range`; `None` where
    /// that is nowhere.
    pub fn within_reach(&self, segment: &ShellSegment, range: [f64; 2]) -> Option<[f64; 2]> {
        let rises = segment.end_heights.map(|end| end.rise);
        let least = 1.0 - NOISE_MAX * self.scale.abs();
        // Points below the base lean the other way, and heights without a bound reach anywhere.
        if rises.iter().any(|&rise| rise.is_nan() || rise < -REACH_SLACK) || least <= 0.0 {
            return Some([segment.t0, segment.t1]);
        }
        let moved = NOISE_MAX * self.amplitude.z.abs() + REACH_SLACK;
        let bases = [segment.q0.z - rises[0], segment.q1.z - rises[1]];
        // Both are linear along the segment, as the base and the height are.
        let highest = [0, 1].map(|k| bases[k] + rises[k] / least + moved - range[0]);
        let lowest = [0, 1].map(|k| range[1] - (bases[k] + rises[k] / (2.0 - least) - moved));
        let (mut near, mut far) = (0.0f64, 1.0f64);
        for [a, b] in [highest, lowest] {
            let zero = a / (a - b);
            match (a < 0.0, b < 0.0) {
                (true, true) => return None,
                (true, false) => near = near.max(zero),
                (false, true) => far = far.min(zero),
                (false, false) => {}
            }
        }
        let at = |share: f64| segment.t0 + share * (segment.t1 - segment.t0);
        (near < far).then(|| [at(near), if far == 1.0 { segment.t1 } else { at(far) }])
    }

    /// Call `each` for chords of the jittered curve of a segment, in the layer's texel coordinates and in order, until it returns false.
    /// Chords deviate from the curve by at most `tolerance(t, to_texel)`, in cells. Parts above the shell's top are left out; the box is
    /// `height_stretch` times as high as that. Returns false if stopped.
    pub fn for_each_chord(
        &self,
        segment: &ShellSegment,
        height_stretch: f64,
        tolerance: &dyn Fn(f64, &DMat3) -> f64,
        each: &mut dyn FnMut(&ShellSegment) -> bool,
    ) -> bool {
        let finest = self.noises[0].frequency * f64::from(1u32 << (self.noises[0].octaves - 1));
        let cells = ((segment.q1 - segment.q0) * finest).abs();
        let count = (cells.x.max(cells.y) / FIRST_CHORD).ceil().clamp(1.0, MAX_CHORDS);
        let mut walk = ChordSubdivision { noise: self, segment, height_stretch, tolerance, each };
        let mut from = walk.end(segment.t0);
        for i in 1..=count as u32 {
            let t = if f64::from(i) == count {
                segment.t1
            } else {
                segment.t0 + (segment.t1 - segment.t0) * f64::from(i) / count
            };
            let to = walk.end(t);
            if !walk.cut(&from, &to, 0) {
                return false;
            }
            from = to;
        }
        true
    }
}

/// One end of a chord.
struct ChordEnd {
    t: f64,
    point: JitteredPoint,
}

struct ChordSubdivision<'a> {
    noise: &'a JitterNoise,
    segment: &'a ShellSegment,
    height_stretch: f64,
    tolerance: &'a dyn Fn(f64, &DMat3) -> f64,
    each: &'a mut dyn FnMut(&ShellSegment) -> bool,
}

impl ChordSubdivision<'_> {
    fn end(&self, t: f64) -> ChordEnd {
        ChordEnd { t, point: self.noise.at(&self.segment.at(t)) }
    }

    fn cut(&mut self, from: &ChordEnd, to: &ChordEnd, depth: u32) -> bool {
        let middle = self.end(0.5 * (from.t + to.t));
        let allowed = (self.tolerance)(middle.t, &self.segment.to_texel);
        let strays = |at: &ChordEnd, share: f64| at.point.q.distance(from.point.q.lerp(to.point.q, share)) > allowed;
        if depth < MAX_DEPTH && (strays(&middle, 0.5) || strays(&self.end(0.75 * from.t + 0.25 * to.t), 0.25)) {
            return self.cut(from, &middle, depth + 1) && self.cut(&middle, to, depth + 1);
        }
        let to_texel = self.noise.derivative(&self.segment.at(middle.t)) * self.segment.to_texel;
        // The chord is clipped at the top; heights are interpolated along it as coordinates are.
        let [a, b] = [from, to].map(|end| end.point.height * self.height_stretch - 1.0);
        let top = a / (a - b);
        let (mut low, mut high) = (0.0, 1.0);
        match (a <= 0.0, b <= 0.0) {
            (true, true) => {}
            (true, false) => high = top,
            (false, true) => low = top,
            (false, false) => return true,
        }
        let point = |share: f64| (from.t + share * (to.t - from.t), from.point.q.lerp(to.point.q, share));
        let ((t0, q0), (t1, q1)) = (point(low), point(high));
        if t0.is_nan() || t1.is_nan() || t0 >= t1 || !to_texel.is_finite() {
            return true;
        }
        (self.each)(&ShellSegment { t0, t1, q0, q1, to_texel, ..*self.segment })
    }
}

#[cfg(test)]
mod tests {
    use super::super::shell::HeightInShell;
    use super::*;

    fn continuous() -> Continuous {
        Continuous {
            seed: 3,
            frequency: [0.7, 0.5, 0.4],
            octaves: 2,
            uvw_amplitude: [0.3, 0.2, 0.05],
            height_tilt: 0.4,
            height_scale: 0.3,
        }
    }

    #[test]
    fn the_vectors_of_the_specification() {
        let text = include_str!("../../format-spec/vectors/landscape-1.txt");
        let (mut noises, mut bends) = (0, 0);
        for line in text.lines() {
            let Some((given, wanted)) = line.split_once(" → ") else { continue };
            let (kind, numbers) = given.split_once(' ').unwrap();
            let n: Vec<f64> = numbers.split(' ').filter_map(|w| w.parse().ok()).collect();
            let wanted: Vec<f64> = wanted.split(' ').map(|w| w.parse().unwrap()).collect();
            match kind {
                "noise" => {
                    let (seed, octaves) = (n[0] as u32, n[1] as u32);
                    let (frequency, origin) = (DVec3::ONE, DVec3::ZERO);
                    let noise = Noise { seed, frequency, origin, period: [0; 3], octaves, turbulence: false };
                    assert!((noise.value(DVec3::from_slice(&n[2..])) - wanted[0]).abs() < 1e-12, "{line}");
                    noises += 1;
                }
                "bend" => {
                    let continuous = Continuous {
                        seed: n[0] as u32,
                        octaves: n[1] as u32,
                        frequency: [n[2], n[3], n[4]],
                        uvw_amplitude: [n[5], n[6], n[7]],
                        height_tilt: n[8],
                        height_scale: n[9],
                    };
                    let q = DVec3::new(n[11], n[12], n[13] + n[14]);
                    let point = ShellPoint { q, rise: n[14], height: 0.0, mask: n[10] };
                    let found = JitterNoise::new(&continuous).at(&point).q;
                    assert!((found - DVec3::from_slice(&wanted)).abs().max_element() < 1e-12, "{line} {found}");
                    bends += 1;
                }
                _ => {}
            }
        }
        assert!(noises >= 10 && bends >= 6);
    }

    #[test]
    fn the_derivative_is_the_slope() {
        let bend = JitterNoise::new(&continuous());
        for i in 0..50 {
            let q = DVec3::new(0.37, 0.71, 0.013) * f64::from(i);
            let point = ShellPoint { q, rise: q.z, height: q.z, mask: 0.8 };
            let slope = bend.derivative(&point);
            for axis in 0..3 {
                const STEP: f64 = 1e-5;
                let mut step = DVec3::ZERO;
                step[axis] = STEP;
                // The base stays where w alone changes.
                let at = |s: DVec3| bend.at(&ShellPoint { q: q + s, rise: q.z + s.z, ..point }).q;
                let found = (at(step) - at(-step)) / (2.0 * STEP);
                // Third derivatives of some hundreds, times STEP² / 6.
                assert!((found - slope.col(axis)).abs().max_element() < 1e-6, "{i} {axis} {found} {slope}");
            }
        }
    }

    /// Chords abut, keep to the tolerance everywhere, and end where the shell does.
    #[test]
    fn chords_follow_the_bent_way() {
        let (continuous, bend) = (continuous(), JitterNoise::new(&continuous()));
        let height_stretch = height_stretch(Some(&continuous));
        let end_heights = [HeightInShell { rise: 0.1, height: 0.1 / height_stretch, mask: 1.0 }; 2];
        let (q0, q1) = (DVec3::new(-3.0, 1.2, 0.1), DVec3::new(5.0, 2.9, 0.1));
        let mut segment = ShellSegment { t0: 2.0, t1: 10.0, q0, q1, to_texel: DMat3::IDENTITY, end_heights };
        for tolerance in [1e-2, 1e-3] {
            let (mut last, mut worst, mut chords) = (2.0, 0.0f64, 0);
            bend.for_each_chord(&segment, height_stretch, &|_, _| tolerance, &mut |chord| {
                assert!(chord.t0 == last && chord.t1 > chord.t0);
                last = chord.t1;
                chords += 1;
                for k in 0..=16 {
                    let share = f64::from(k) / 16.0;
                    let t = chord.t0 + share * (chord.t1 - chord.t0);
                    worst = worst.max(bend.at(&segment.at(t)).q.distance(chord.q0.lerp(chord.q1, share)));
                }
                true
            });
            // Tested at two places of a chord; between them the way bends a little more.
            assert!(last == 10.0 && worst < 1.5 * tolerance, "{worst} {chords}");
        }
        // A ray that rises through the top of the box: shorter or longer, it ends at height 1.
        segment.q1 = DVec3::new(-2.9, 1.3, height_stretch);
        segment.end_heights[1] = HeightInShell { rise: height_stretch, height: 1.0, mask: 1.0 };
        let mut end = 0.0;
        bend.for_each_chord(&segment, height_stretch, &|_, _| 1e-4, &mut |chord| {
            end = chord.t1;
            true
        });
        let height = bend.at(&segment.at(end)).height * height_stretch;
        assert!(end < 10.0 && (height - 1.0).abs() < 1e-3, "{end} {height}");
    }

    /// What is left out is out of reach, and no more than the noise's bound is kept.
    #[test]
    fn segments_end_where_nothing_is_in_reach() {
        let bend = JitterNoise::new(&continuous());
        let end = |rise: f64| HeightInShell { rise, height: rise / 9.0, mask: 1.0 };
        let mut shares = [0.0; 2];
        for i in 0..200 {
            let (foot, top) = (0.02 * f64::from(i % 10), 9.0 - 0.03 * f64::from(i));
            let (q0, q1) = (DVec3::new(0.13 * f64::from(i), 0.4, foot), DVec3::new(4.0, 0.21 * f64::from(i), top));
            let end_heights = [end(foot), end(top)];
            let segment = ShellSegment { t0: 1.0, t1: 3.0, q0, q1, to_texel: DMat3::IDENTITY, end_heights };
            let range = if i % 2 == 0 { [0.0, 1.0] } else { [3.0, 3.5] };
            let [t0, t1] = bend.within_reach(&segment, range).unwrap();
            assert!((1.0..3.0).contains(&t0) && t0 < t1 && t1 <= 3.0);
            shares[i as usize % 2] += (t1 - t0) / 2.0;
            for k in 0..=400 {
                let t = 1.0 + 2.0 * f64::from(k) / 400.0;
                let w = bend.at(&segment.at(t)).q.z;
                assert!((t0..=t1).contains(&t) || !(range[0]..=range[1]).contains(&w), "{i} {t} {w}");
            }
        }
        // Of a way of about 6 cells: 1 cell is up to 1.4 high, and 3 to 3.5 are 2.0 to 4.7.
        assert!(shares[0] < 50.0 && shares[1] < 80.0, "{shares:?}");
        let end_heights = [end(5.0), end(6.0)];
        let (q0, q1) = (DVec3::new(0.0, 0.0, 5.0), DVec3::new(1.0, 0.0, 6.0));
        let segment = ShellSegment { t0: 1.0, t1: 3.0, q0, q1, to_texel: DMat3::IDENTITY, end_heights };
        assert!(bend.within_reach(&segment, [0.0, 1.0]).is_none());
    }

    #[test]
    fn endless_segments_are_left_after_a_bound() {
        let bend = JitterNoise::new(&continuous());
        let end_heights = [HeightInShell { rise: 0.1, height: 0.1, mask: 1.0 }; 2];
        let q1 = DVec3::new(1e12, 0.0, 0.1);
        let segment = ShellSegment { t0: 0.0, t1: 1.0, q0: DVec3::ZERO, q1, to_texel: DMat3::IDENTITY, end_heights };
        let mut n = 0;
        bend.for_each_chord(&segment, 1.3, &|_, _| 1.0, &mut |_| {
            n += 1;
            true
        });
        // Noise strays by less than a cell: no chord is cut again.
        assert_eq!(f64::from(n), MAX_CHORDS);
    }
}

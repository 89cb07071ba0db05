//! Wind: gusts that travel over the land bend the height vectors of shells, and lean rigid copies. Normative text:
//! `format-spec/landscape-1.md`.
//!
//! Based on: F. Neyret, *Animated Texels*, Eurographics Workshop on Computer Animation and Simulation 1995 (height vectors that
//! move); K. Perlin, *Improving Noise*, SIGGRAPH 2002.

use crate::geom::{DMat3, DVec3};
use crate::noise::Noise;

/// Wind over a landscape, with the parameters of the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wind {
    /// Unit direction in which it blows, world space.
    pub direction: DVec3,
    /// Tangent of the mean angle by which upright objects lean, 0 … 4.
    pub strength: f64,
    /// Distance between gusts, metres, > 0.
    pub gust_scale: f64,
    /// Speed at which gusts travel, metres per second, ≥ 0.
    pub speed: f64,
    /// Seed of the gusts.
    pub seed: u32,
}

impl Default for Wind {
    fn default() -> Self {
        Wind { direction: DVec3::X, strength: 0.25, gust_scale: 12.0, speed: 5.0, seed: 0 }
    }
}

/// Largest [`Wind::strength`].
pub const MAX_STRENGTH: f64 = 4.0;
/// Speed at which gusts change shape, as a share of the speed at which they travel.
const CHANGE: f64 = 0.25;
/// Amplitude of the noise of gusts, relative to the mean strength.
const CONTRAST: f64 = 1.6;

/// Wind at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindField {
    wind: Wind,
    /// Distance that gusts have travelled, metres.
    travel: f64,
    noise: Noise,
}

impl Wind {
    /// The wind field at a time, in seconds.
    pub fn at(self, time: f64) -> WindField {
        // Crests of the noise are about two lattice cells apart, so a cell is half the distance between gusts.
        let frequency = DVec3::splat(2.0 / self.gust_scale);
        let noise =
            Noise { seed: self.seed, frequency, origin: DVec3::ZERO, period: [0; 3], octaves: 2, turbulence: false };
        WindField { wind: self, travel: self.speed * time, noise }
    }
}

impl WindField {
    /// Tangent of the lean at a place, world space, metres: ≥ 0, continuous in place and time.
    pub fn lean_tangent(&self, at: DVec3) -> f64 {
        if self.wind.strength <= 0.0 {
            return 0.0;
        }
        // Noise over the ground plane moves with the wind; its third axis is time, so that gusts also grow and fade.
        let blown = at - self.travel * self.wind.direction;
        let place = DVec3::new(blown.x, CHANGE * self.travel, blown.z);
        let gust = (1.0 + CONTRAST * self.noise.value(place)).max(0.0);
        self.wind.strength * gust
    }

    /// A height vector at a position, rotated towards the wind's direction; its length is kept.
    pub fn bend(&self, at: DVec3, height: DVec3) -> DVec3 {
        let length = height.length();
        let lean = self.lean_tangent(at);
        if lean <= 0.0 || !length.is_normal() {
            return height;
        }
        (height / length + lean * self.wind.direction).try_normalize().map_or(height, |way| length * way)
    }

    /// The linear map about the foot by which a rigid copy leans; its foot is at `foot` and its own up is `up` (both world space). Directions at
    /// right angles to `up` are kept, and `up` becomes what [`WindField::bend`] makes of it.
    pub fn lean(&self, foot: DVec3, up: DVec3) -> DMat3 {
        let Some(up) = up.try_normalize() else { return DMat3::IDENTITY };
        let moved = self.bend(foot, up) - up;
        // x + (bent − up) (up · x).
        let lean = DMat3::IDENTITY + DMat3::from_cols(moved * up.x, moved * up.y, moved * up.z);
        // A copy that is bent down to the ground or below would have no volume left.
        if lean.determinant() < 1e-3 { DMat3::IDENTITY } else { lean }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wind() -> Wind {
        Wind { direction: DVec3::new(0.6, 0.0, 0.8), strength: 0.5, gust_scale: 8.0, speed: 3.0, seed: 7 }
    }

    #[test]
    fn heights_keep_their_length_and_turn_downwind() {
        let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
        for i in 0..2000 {
            let at = DVec3::new(f64::from(i % 50), 3.0, f64::from(i / 50) * 1.7);
            let moment = wind().at(0.05 * f64::from(i));
            let height = DVec3::new(0.2, 2.0, -0.1);
            let bent = moment.bend(at, height);
            assert!((bent.length() - height.length()).abs() < 1e-12);
            assert!(bent.dot(wind().direction) >= height.dot(wind().direction));
            let lean = moment.lean_tangent(at);
            // Straight up, the lean is the lean itself.
            let up = moment.bend(at, DVec3::Y);
            assert!((up.dot(wind().direction) / up.y - lean).abs() < 1e-12);
            (least, most) = (least.min(lean), most.max(lean));
        }
        // Gusts and lulls about the strength.
        assert!(least < 0.25 && most > 0.75 && most < 0.5 * (1.0 + 1.04 * CONTRAST), "{least} {most}");
    }

    #[test]
    fn gusts_travel_with_the_wind_and_nothing_jumps() {
        // A gust at a place is, a little later, about the same further on: it changes by a quarter of what it moves.
        let (now, later) = (wind().at(2.0), wind().at(2.1));
        let (mut moved, mut stayed) = (0.0, 0.0);
        for i in 0..400 {
            let at = DVec3::new(f64::from(i) * 0.83, 0.0, f64::from(i % 20) * 1.9);
            moved += (later.lean_tangent(at + 0.3 * wind().direction) - now.lean_tangent(at)).abs();
            stayed += (later.lean_tangent(at) - now.lean_tangent(at)).abs();
            // The noise's slope is at most 3.76 a cell of 4 m in each octave, of which the second is twice as steep and half as
            // high: a step of time moves 3 m/s along the wind and a quarter of that along the third axis.
            let slope = 0.5 * CONTRAST * 2.0 * (2.0 / 3.0) * 3.76 / 4.0 * 3.0 * (1.0 + CHANGE);
            let step = (wind().at(2.001).lean_tangent(at) - now.lean_tangent(at)).abs();
            assert!(step <= 1e-3 * slope, "{step}");
        }
        assert!(moved < 0.5 * stayed, "{moved} {stayed}");
    }

    #[test]
    fn copies_lean_about_their_feet() {
        let (foot, up) = (DVec3::new(4.0, 1.0, -2.0), DVec3::new(0.1, 1.0, 0.0).normalize());
        let moment = wind().at(1.5);
        let map = moment.lean(foot, up);
        let near = |a: DVec3, b: DVec3| assert!((a - b).length() < 1e-12, "{a} is not {b}");
        near(map * up, moment.bend(foot, up));
        let across = up.cross(DVec3::Z);
        near(map * across, across);
        let calm = Wind { strength: 0.0, ..wind() }.at(1.5);
        assert_eq!(calm.lean(foot, up), DMat3::IDENTITY);
        // Against the wind, and beyond it: nothing is turned inside out.
        let against = Wind { strength: 4.0, ..wind() }.at(0.0);
        assert!(against.lean(foot, -wind().direction).determinant() > 0.0);
    }

    /// Frozen: landscapes look the same for ever. The numbers are those of `format-spec/landscape-1.md`.
    #[test]
    fn vectors() {
        for (at, time, lean) in VECTORS {
            let got = wind().at(time).lean_tangent(DVec3::from_array(at));
            assert!((got - lean).abs() < 1e-12, "{at:?} {time}: {got}");
        }
    }

    /// Made by another program, from the text.
    const VECTORS: [([f64; 3], f64, f64); 5] = [
        ([0.0, 0.0, 0.0], 0.0, 0.5),
        ([1.0, 5.0, 2.0], 0.0, 0.30234375),
        ([1.0, 5.0, 2.0], 1.5, 0.5195848707778457),
        ([-40.25, 0.0, 17.5], 10.0, 0.643640052509376),
        ([3.5, 100.0, -7.25], -2.5, 0.4913346992915327),
    ];
}

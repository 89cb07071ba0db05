//! Tone mapping: from unbounded radiance to the range of a display.
//!
//! Based on: T. Sobotka, *AgX*, 2022, with the curve as B. Wrensch's polynomial (*Minimal AgX Implementation*, 2023); Khronos
//! Group, *PBR Neutral Tone Mapper*, 2024.

use glam::{DMat3, DVec3};

use super::film::Film;

/// Tone curve from radiance to the display's linear values. White is 1 in both.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Tone {
    /// No curve: values are clipped at white.
    #[default]
    None,
    /// Bright colours fade to white gradually, as on film: 0.18 stays a middle grey, and white is reached at 16.
    Agx,
    /// Colours below 0.76 keep their values, less .04; brighter ones are compressed below 1.
    Neutral,
}

impl Tone {
    /// Radiance that is mapped to white, or nearly so.
    pub fn white(self) -> f32 {
        if self == Tone::None { 1.0 } else { 4.0 }
    }

    /// Apply the curve to a colour, linear Rec. 709 before and after; negative values and NaN count as 0.
    pub fn curve(self, rgb: [f32; 3]) -> [f32; 3] {
        let clean = rgb.map(|c| if c > 0.0 { f64::from(c).min(1e30) } else { 0.0 });
        match self {
            Tone::None => rgb,
            Tone::Agx => agx(DVec3::from_array(clean)).as_vec3().to_array(),
            Tone::Neutral => neutral(DVec3::from_array(clean)).as_vec3().to_array(),
        }
    }

    /// Apply the curve to every pixel.
    pub fn apply(self, film: &mut Film) {
        if self != Tone::None {
            for p in &mut film.pixels {
                let [r, g, b] = self.curve([p[0], p[1], p[2]]);
                *p = [r, g, b, p[3]];
            }
        }
    }
}

fn columns(m: [[f64; 3]; 3]) -> DMat3 {
    DMat3::from_cols_array_2d(&m)
}

fn agx(rgb: DVec3) -> DVec3 {
    // Rec. 709 → Rec. 2020, whose primaries are then moved inwards.
    let wide = columns([[0.6274, 0.0691, 0.0164], [0.3293, 0.9195, 0.0880], [0.0433, 0.0113, 0.8956]]);
    let inset = columns([
        [0.856_627_153_315_983, 0.137_318_972_929_847, 0.111_898_212_999_95],
        [0.095_121_240_538_158_8, 0.761_241_990_602_591, 0.076_799_418_603_190_3],
        [0.048_251_606_145_858_3, 0.101_439_036_467_562, 0.811_302_368_396_859],
    ]);
    let outset = columns([
        [1.127_100_581_814_436_8, -0.141_329_763_498_438_3, -0.141_329_763_498_438_26],
        [-0.110_606_643_096_603_23, 1.157_823_702_216_272, -0.110_606_643_096_602_94],
        [-0.016_493_938_717_834_573, -0.016_493_938_717_834_257, 1.251_936_406_595_040_5],
    ]);
    let narrow = columns([[1.6605, -0.1246, -0.0182], [-0.5876, 1.1329, -0.1006], [-0.0728, -0.0083, 1.1187]]);
    // Stops about middle grey, 10 below and 6.5 above.
    const MIN: f64 = -12.473_93;
    const MAX: f64 = 4.026_069;
    let channel = |c: f64| {
        let x = ((libm::log2(c.max(1e-10)) - MIN) / (MAX - MIN)).clamp(0.0, 1.0);
        let (x2, x4) = (x * x, x * x * x * x);
        15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.002_32
    };
    let v = inset * (wide * rgb);
    let v = outset * DVec3::new(channel(v.x), channel(v.y), channel(v.z));
    let v = v.max(DVec3::ZERO);
    let linear = narrow * DVec3::new(libm::pow(v.x, 2.2), libm::pow(v.y, 2.2), libm::pow(v.z, 2.2));
    linear.clamp(DVec3::ZERO, DVec3::ONE)
}

fn neutral(rgb: DVec3) -> DVec3 {
    const START: f64 = 0.8 - 0.04;
    const DESATURATION: f64 = 0.15;
    let least = rgb.min_element();
    let offset = if least < 0.08 { least - 6.25 * least * least } else { 0.04 };
    let rgb = rgb - offset;
    let peak = rgb.max_element();
    if peak < START {
        return rgb;
    }
    let room = 1.0 - START;
    let pressed = 1.0 - room * room / (peak + room - START);
    let grey = 1.0 - 1.0 / (DESATURATION * (peak - pressed) + 1.0);
    (rgb * (pressed / peak)).lerp(DVec3::splat(pressed), grey)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neutral_keeps_colours_and_presses_lights() {
        // The specification: below .8 a colour loses .04 (its F90), and .04² / .16 where it is darker than .08.
        let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(near(Tone::Neutral.curve([0.5, 0.3, 0.2]), [0.46, 0.26, 0.16]));
        assert!(near(Tone::Neutral.curve([0.04; 3]), [0.01; 3]));
        assert!(near(Tone::Neutral.curve([0.5, 0.2, 0.0]), [0.5, 0.2, 0.0]));
        // 1 - .24² / (peak + .24 - .76), peak = 1.96.
        assert!(near(Tone::Neutral.curve([2.0; 3]), [1.0 - 0.0576 / 1.44; 3]));
    }

    #[test]
    fn agx_has_its_middle_and_its_ends() {
        let grey = |v: f32| Tone::Agx.curve([v; 3]);
        // Middle grey is encoded as the curve's pivot, 1/2 (by the polynomial .496).
        let middle = grey(0.18)[1];
        assert!((middle.powf(1.0 / 2.2) - 0.496).abs() < 2e-3, "{middle}");
        assert!(grey(0.0)[0] < 1e-4 && grey(17.0)[0] > 0.97);
        // Greys stay grey, to the rounding of the published matrices.
        for v in [0.01, 0.18, 1.0, 4.0] {
            let [r, g, b] = grey(v);
            assert!((r - g).abs() < 3e-3 && (b - g).abs() < 3e-3, "{r} {g} {b}");
        }
        // A strong blue light loses its colour, not its brightness.
        let [r, g, b] = Tone::Agx.curve([0.0, 0.0, 50.0]);
        assert!(r > 0.2 && g > 0.2 && b > 0.8, "{r} {g} {b}");
    }

    #[test]
    fn curves_rise_and_stay_on_the_display() {
        for tone in [Tone::Agx, Tone::Neutral] {
            let mut before = -1.0;
            for step in 0..400 {
                let v = 1e-4 * 1.05f32.powi(step);
                let g = tone.curve([v; 3])[1];
                assert!(g >= before && (0.0..=1.0).contains(&g), "{tone:?} {v}: {g}");
                before = g;
            }
            for odd in [f32::NAN, f32::INFINITY, -1.0] {
                assert!(tone.curve([odd, 0.5, 0.5]).iter().all(|c| (0.0..=1.0).contains(c)), "{tone:?} {odd}");
            }
        }
        assert_eq!(Tone::None.curve([7.0, -1.0, 0.5]), [7.0, -1.0, 0.5]);
    }

    #[test]
    fn a_film_keeps_its_alpha() {
        let mut film = Film { width: 1, height: 1, pixels: vec![[3.0, 3.0, 3.0, 0.25]] };
        Tone::Agx.apply(&mut film);
        assert!(film.pixels[0][0] < 1.0 && film.pixels[0][3] == 0.25);
    }
}

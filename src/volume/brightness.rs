//! Brightness factors, which make the depths of a texel equally bright. A coarse voxel does not know which of its matter lies in
//! front, and so how much of the visible matter is lit. `march::calibrate` measures the factors against the finest depth when a
//! texel is baked, META stores them, and shading applies them, so that the brightness does not step where the depth changes.

use serde_json::{Map, Value, json};

use super::{Info, MAX_DEPTH};

/// The factors of one depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrightnessFactors {
    /// Factors of the radiance due to a light that shines from behind the matter, from the side, and from the viewer's side.
    pub light: [f32; 3],
}

/// Key in META of an array of `{"light": [behind, side, front]}`, root first.
pub const META_KEY: &str = "levels";
/// Largest factor; the smallest is its reciprocal.
const MAX_FACTOR: f32 = 4.0;
/// Number of steps in which a factor of 1 is stored.
const STEPS_PER_UNIT: f32 = 256.0;

impl BrightnessFactors {
    /// No change.
    pub const PLAIN: BrightnessFactors = BrightnessFactors { light: [1.0; 3] };

    /// Nearest factors to `light` that can be stored; 1 in place of a factor that is not finite.
    pub fn new(light: [f64; 3]) -> BrightnessFactors {
        let limited = |v: f64| {
            let v = if v.is_finite() { v as f32 } else { 1.0 };
            (v.clamp(1.0 / MAX_FACTOR, MAX_FACTOR) * STEPS_PER_UNIT).round() / STEPS_PER_UNIT
        };
        BrightnessFactors { light: light.map(limited) }
    }

    /// Factor for a light at the given cosine, in [−1, 1], between the directions to the light and to the viewer. It is linear
    /// between −1, 0 and 1.
    #[inline]
    pub fn at_cosine(&self, cosine: f32) -> f32 {
        let [behind, side, front] = self.light;
        side + if cosine < 0.0 { (side - behind) * cosine } else { (front - side) * cosine }
    }
}

/// Store the factors of all depths, root first, in META.
pub fn store(factors: &[BrightnessFactors], meta: &mut Map<String, Value>) {
    let all: Vec<Value> = factors.iter().map(|f| json!({ "light": f.light })).collect();
    meta.insert(META_KEY.into(), all.into());
}

/// Read the factors of all depths, root first; [`BrightnessFactors::PLAIN`] where META has none.
pub fn read(info: &Info) -> [BrightnessFactors; MAX_DEPTH + 1] {
    let mut out = [BrightnessFactors::PLAIN; MAX_DEPTH + 1];
    let stored = info.meta.get(META_KEY).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    for (factors, value) in out.iter_mut().zip(stored) {
        let number = |v: Option<&Value>| v.and_then(Value::as_f64).unwrap_or(1.0);
        *factors = BrightnessFactors::new([0, 1, 2].map(|k| number(value["light"].get(k))));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stored_factors_read_back() {
        let dimmed = BrightnessFactors::new([0.5, 0.75, 1.25]);
        let mut info = crate::volume::Info::default();
        store(&[BrightnessFactors::PLAIN, dimmed], &mut info.meta);
        let back = read(&info);
        assert_eq!((back[0], back[1], back[2]), (BrightnessFactors::PLAIN, dimmed, BrightnessFactors::PLAIN));
        assert_eq!([-1.0, -0.5, 0.0, 0.5, 1.0].map(|c| dimmed.at_cosine(c)), [0.5, 0.625, 0.75, 1.0, 1.25]);
    }

    #[test]
    fn whatever_meta_holds_is_bounded() {
        let mut info = crate::volume::Info::default();
        for hostile in ["7", "[]", "[null]", r#"[{"light":[-1,"x",1e300]}]"#, r#"[{"light":{}}]"#] {
            info.meta.insert(META_KEY.into(), serde_json::from_str(hostile).unwrap());
            for factors in read(&info) {
                assert!(factors.light.iter().all(|v| (0.25..=4.0).contains(v)), "{hostile}: {factors:?}");
            }
        }
    }
}

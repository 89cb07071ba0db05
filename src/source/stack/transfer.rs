//! Transfer functions of a stack: opacity and colour by value and by how steeply it changes.
//!
//! Based on: M. Levoy, *Display of Surfaces from Volume Data*, CG&A 1988 (opacity by value and gradient).

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::{Error, Result};

/// Smallest opacity that counts as opaque, so that matter is solid.
pub const OPAQUE: f64 = 0.996;

/// Bytes of a table.
const MAX_TABLE: u64 = 1 << 24;

/// A transfer function. Where it is empty, values from Otsu's threshold on are opaque.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct TransferSpec {
    /// Smallest value that is opaque, with a hard surface.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub iso: Option<f64>,
    /// Points with ascending values. Opacity and colour are interpolated linearly between them, and constant beyond the ends.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<TransferPoint>,
    /// Factors of the opacity by the change of the value per distance of samples, with ascending changes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub gradient: Vec<GradientPoint>,
}

/// Opacity and colour of a value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct TransferPoint {
    /// The stack's value, in the units that it has after its own rescaling.
    pub value: f64,
    /// Share of light, [0, 1], that a layer as thick as samples are apart takes away, from whichever side it is
    /// seen; where the spacing differs by axis, the layer is the cube root of the spacings' product thick.
    pub opacity: f64,
    /// Linear Rec. 709, [0, 1]; white, or the stack's own colour, where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour: Option<[f32; 3]>,
}

/// Factor on opacity by how steeply the value changes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct GradientPoint {
    /// Change of the value from one sample to the next.
    pub magnitude: f64,
    /// Factor, [0, 1].
    pub opacity: f64,
}

/// Piecewise linear interpolation of `f` at `x`, between points with ascending positions `at`; 1 where there are no points.
fn between<P: Copy>(points: &[P], at: impl Fn(P) -> f64, x: f64, f: impl Fn(P) -> f64) -> f64 {
    let n = points.partition_point(|p| at(*p) <= x);
    match (n.checked_sub(1).and_then(|i| points.get(i)), points.get(n)) {
        (Some(a), Some(b)) => f(*a) + (f(*b) - f(*a)) * (x - at(*a)) / (at(*b) - at(*a)),
        (Some(one), None) | (None, Some(one)) => f(*one),
        (None, None) => 1.0,
    }
}

impl TransferSpec {
    /// Transfer function of a hard surface: values of at least `iso` are opaque.
    pub fn hard(iso: f64) -> TransferSpec {
        TransferSpec { iso: Some(iso), ..TransferSpec::default() }
    }

    /// Read a transfer function as JSON.
    ///
    /// # Errors
    /// [`Error::Io`] where the file is not there, [`Error::Input`] with line and column where it is not one.
    pub fn read(path: &Path) -> Result<TransferSpec> {
        let bytes = crate::scene::files::read(path, MAX_TABLE)?;
        serde_json::from_slice(&crate::scene::text::utf8(&bytes)).map_err(|e| {
            let text = e.to_string();
            let what = text.split(" at line").next().unwrap_or_default();
            Error::input(path, format!("line {}, column {}", e.line(), e.column()), what)
        })
    }

    /// Transfer function whose opacity rises from 0 at `lo` to 1 at `hi`.
    pub fn window(lo: f64, hi: f64) -> TransferSpec {
        let point = |value, opacity| TransferPoint { value, opacity, colour: None };
        TransferSpec { points: vec![point(lo, 0.0), point(hi, 1.0)], ..TransferSpec::default() }
    }

    /// Whether no opacity is given: neither a surface nor points.
    pub fn is_empty(&self) -> bool {
        self.iso.is_none() && self.points.is_empty()
    }

    /// # Errors
    /// [`Error::Options`] where a number is out of range or out of order.
    pub fn check(&self) -> Result<()> {
        let wrong = |what: String| Err(Error::Options(format!("transfer function: {what}")));
        let ordered = |list: &[f64]| list.windows(2).all(|w| w[0] < w[1]) && list.iter().all(|v| v.is_finite());
        let share = |v: f64| (0.0..=1.0).contains(&v);
        if let Some(iso) = self.iso.filter(|v| !v.is_finite()) {
            return wrong(format!("iso {iso}: not a number"));
        }
        let values: Vec<f64> = self.points.iter().map(|p| p.value).collect();
        let magnitudes: Vec<f64> = self.gradient.iter().map(|p| p.magnitude).collect();
        if !ordered(&values) || !ordered(&magnitudes) {
            return wrong("values and magnitudes have to ascend".into());
        }
        let opacities = self.points.iter().map(|p| p.opacity).chain(self.gradient.iter().map(|p| p.opacity));
        if let Some(bad) = opacities.into_iter().find(|v| !share(*v)) {
            return wrong(format!("opacity {bad}: 0 to 1"));
        }
        let colours = self.points.iter().filter_map(|p| p.colour).flatten();
        if let Some(bad) = colours.into_iter().find(|v| !share(f64::from(*v))) {
            return wrong(format!("colour {bad}: 0 to 1"));
        }
        if self.points.is_empty() && !self.gradient.is_empty() {
            return wrong("a gradient needs points, whose opacity it changes".into());
        }
        Ok(())
    }

    /// Whether any matter lets light through.
    pub fn is_soft(&self) -> bool {
        !self.points.is_empty()
    }

    /// Smallest value from which on all matter is solid, whatever the gradient; infinite where there is none.
    pub fn solid_from(&self) -> f64 {
        let mut from = f64::INFINITY;
        if self.gradient.is_empty() {
            for pair in self.points.windows(2).rev() {
                // Once opaque up to the last point: where it begins to be.
                let (a, b) = (pair[0], pair[1]);
                if b.opacity < OPAQUE {
                    break;
                }
                let t = if a.opacity < OPAQUE { (OPAQUE - a.opacity) / (b.opacity - a.opacity) } else { 0.0 };
                from = a.value + t * (b.value - a.value);
            }
        }
        from.min(self.iso.unwrap_or(f64::INFINITY))
    }

    /// Value below which there is no matter; −infinite where every value may be matter.
    pub fn matter_from(&self) -> f64 {
        let first = match self.points.iter().position(|p| p.opacity > 0.0) {
            None => f64::INFINITY,
            Some(0) => f64::NEG_INFINITY,
            Some(n) => self.points[n - 1].value,
        };
        first.min(self.iso.unwrap_or(f64::INFINITY))
    }

    /// Largest opacity of the values in `lo ..= hi`.
    pub fn most(&self, lo: f64, hi: f64) -> f64 {
        let inner = self.points.iter().filter(|p| (lo..=hi).contains(&p.value)).map(|p| p.opacity);
        inner.fold(self.by_value(lo).max(self.by_value(hi)), f64::max)
    }

    /// Opacity of `value`, without the factor of the gradient; 0 where there are no points.
    pub fn by_value(&self, value: f64) -> f64 {
        if self.points.is_empty() { 0.0 } else { between(&self.points, |p| p.value, value, |p| p.opacity) }
    }

    /// Factor of the opacity where the value changes by `magnitude` per distance of samples.
    pub fn by_gradient(&self, magnitude: f64) -> f64 {
        between(&self.gradient, |p| p.magnitude, magnitude, |p| p.opacity)
    }

    /// Whether any point has a colour.
    pub fn has_colour(&self) -> bool {
        self.points.iter().any(|p| p.colour.is_some())
    }

    /// Linear colour of a value.
    pub fn colour(&self, value: f64) -> [f32; 3] {
        std::array::from_fn(|c| {
            between(&self.points, |p| p.value, value, |p| f64::from(p.colour.map_or(1.0, |v| v[c]))) as f32
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_is_a_ramp_that_ends_solid() {
        let w = TransferSpec::window(100.0, 300.0);
        assert!(w.check().is_ok() && w.is_soft() && !w.has_colour());
        assert_eq!([0.0, 100.0, 200.0, 300.0, 900.0].map(|v| w.by_value(v)), [0.0, 0.0, 0.5, 1.0, 1.0]);
        assert!((w.solid_from() - (100.0 + 200.0 * OPAQUE)).abs() < 1e-9);
        assert_eq!(w.matter_from(), 100.0);
        assert_eq!(w.most(-5.0, 50.0), 0.0);
        assert_eq!(w.most(150.0, 200.0), 0.5);
        assert_eq!(TransferSpec::hard(7.0).solid_from(), 7.0);
        assert_eq!(TransferSpec::hard(7.0).matter_from(), 7.0);
        assert_eq!(TransferSpec::hard(7.0).by_value(9.0), 0.0, "what is hard is not soft as well");
    }

    #[test]
    fn tables_are_read_and_checked() {
        let text = r#"{"points":[{"value":0,"opacity":0},{"value":10,"opacity":0.4,"colour":[1,0,0]},{"value":20,"opacity":0}],
            "gradient":[{"magnitude":0,"opacity":0},{"magnitude":2,"opacity":1}]}"#;
        let spec: TransferSpec = serde_json::from_str(text).unwrap();
        assert!(spec.check().is_ok());
        assert_eq!(spec.by_value(15.0), 0.2);
        assert_eq!(spec.by_gradient(1.0), 0.5);
        assert_eq!(spec.by_gradient(5.0), 1.0);
        assert_eq!(spec.colour(10.0), [1.0, 0.0, 0.0]);
        assert_eq!(spec.colour(5.0), [1.0, 0.5, 0.5]);
        assert_eq!(spec.solid_from(), f64::INFINITY);
        for bad in [
            r#"{"points":[{"value":5,"opacity":0},{"value":5,"opacity":1}]}"#,
            r#"{"points":[{"value":5,"opacity":1.5}]}"#,
            r#"{"gradient":[{"magnitude":0,"opacity":0}]}"#,
            r#"{"points":[{"value":5,"opacity":1,"colour":[2,0,0]}]}"#,
        ] {
            assert!(serde_json::from_str::<TransferSpec>(bad).unwrap().check().is_err(), "{bad}");
        }
        assert!(serde_json::from_str::<TransferSpec>(r#"{"izo":5}"#).is_err());
    }
}

//! `--exposure`: how bright a picture is.

use crate::render;

/// Irradiance from which on light is that of a real day, not of a display's: ten times what makes white of white.
const PHYSICAL: f64 = 30.0;

/// How bright a picture is, in stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Exposure {
    /// From what suits the landscape's lights.
    Auto(f64),
    /// From the lights as they are.
    Stops(f64),
}

impl Exposure {
    /// What suits the landscape's lights.
    pub const AUTO: Exposure = Exposure::Auto(0.0);

    /// The film's exposure in stops, and the factor of the lights. `lux`: the irradiance that the lights give, where the file has
    /// them in lux and candela.
    pub fn of(self, lux: Option<f64>) -> (f64, f64) {
        match (self, lux) {
            (Exposure::Stops(stops) | Exposure::Auto(stops), None) | (Exposure::Stops(stops), _) => (stops, 1.0),
            (Exposure::Auto(stops), Some(lux)) => {
                // A sun as bright as the real one is brought to what suits a display: a white surface that faces it to 1.
                let irradiance = lux / render::LUMENS_PER_WATT;
                let own = if irradiance > PHYSICAL { (std::f64::consts::PI / irradiance).log2() } else { 0.0 };
                (own + stops, 1.0 / render::LUMENS_PER_WATT)
            }
        }
    }

    /// Stops, from where the exposure begins.
    #[cfg(feature = "bake")]
    pub fn stops(self) -> f64 {
        let (Exposure::Auto(stops) | Exposure::Stops(stops)) = self;
        stops
    }
}

/// `auto`, a number of stops, or both.
pub fn exposure(text: &str) -> Result<Exposure, String> {
    let text = text.trim();
    let (is_auto, stops) = match text.get(..4).filter(|head| head.eq_ignore_ascii_case("auto")) {
        Some(_) => (true, &text[4..]),
        None => (false, text),
    };
    if is_auto && stops.is_empty() {
        return Ok(Exposure::AUTO);
    }
    // Who writes "auto3" may mean anything.
    let number = stops.parse().ok().filter(|v: &f64| v.is_finite() && (!is_auto || stops.starts_with(['+', '-'])));
    let number = number.ok_or_else(|| format!("{text:?} is neither a number of stops, nor auto, nor auto+STOPS"))?;
    Ok(if is_auto { Exposure::Auto(number) } else { Exposure::Stops(number) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stops_are_read() {
        for (text, wanted) in [
            ("auto", Exposure::AUTO),
            (" Auto ", Exposure::AUTO),
            ("auto+1.5", Exposure::Auto(1.5)),
            ("AUTO-2", Exposure::Auto(-2.0)),
            ("-1", Exposure::Stops(-1.0)),
            ("+0.25", Exposure::Stops(0.25)),
        ] {
            assert_eq!(exposure(text), Ok(wanted), "{text}");
        }
        for text in ["", "auto3", "auto+", "auto + 1", "autos", "nan", "auto+inf", "1 stop", "aut\u{f6}+1"] {
            assert!(exposure(text).is_err(), "{text}");
        }
    }

    #[test]
    fn stops_go_on_from_what_suits_the_lights() {
        let sun = Some(100_000.0);
        let (own, scale) = Exposure::AUTO.of(sun);
        assert!(own < -4.0 && scale < 0.01);
        assert_eq!(Exposure::Auto(1.5).of(sun), (own + 1.5, scale));
        assert_eq!(Exposure::Stops(1.5).of(sun), (1.5, 1.0));
        assert_eq!(Exposure::Auto(1.5).of(None), (1.5, 1.0));
    }
}

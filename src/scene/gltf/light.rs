//! Cameras and KHR_lights_punctual.

use gltf_json::extensions::scene::khr_lights_punctual::Type;
use gltf_json::validation::Checked;

use super::document::Document;
use crate::geom::DAffine3;
use crate::scene::model::{Camera, Light, LightKind, Projection};
use crate::{Result, Warnings};

/// The camera `index`, placed; none where its numbers are of no use.
pub fn camera(
    document: &Document,
    index: usize,
    node: &str,
    to_world: DAffine3,
    warnings: &mut Warnings,
) -> Result<Option<Camera>> {
    let camera = document.root.cameras.get(index);
    let camera = camera.ok_or_else(|| document.error(format!("cameras[{index}]"), "does not exist"))?;
    let projection = match (&camera.perspective, &camera.orthographic) {
        (Some(p), _) if p.yfov > 0.0 && p.yfov < std::f32::consts::PI => {
            Projection::Perspective { yfov: p.yfov.into() }
        }
        (None, Some(o)) if o.ymag != 0.0 && o.ymag.is_finite() => {
            Projection::Orthographic { ymag: f64::from(o.ymag).abs() }
        }
        _ => {
            warnings.add("a camera without a usable field of view is left out");
            return Ok(None);
        }
    };
    Ok(Some(Camera { name: named(&camera.name, node), to_world, projection }))
}

/// The light `index`, placed; none where its numbers are of no use.
pub fn light(
    document: &Document,
    index: usize,
    node: &str,
    to_world: DAffine3,
    warnings: &mut Warnings,
) -> Result<Option<Light>> {
    let lights = document.root.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
    let light = lights.and_then(|l| l.lights.get(index));
    let light =
        light.ok_or_else(|| document.error(format!("KHR_lights_punctual.lights[{index}]"), "does not exist"))?;
    let kind = match (&light.type_, &light.spot) {
        (Checked::Valid(Type::Directional), _) => LightKind::Directional,
        (Checked::Valid(Type::Point), _) => LightKind::Point,
        (Checked::Valid(Type::Spot), spot) => {
            // The defaults of the extension, where it has no `spot`.
            let (inner, outer) =
                spot.as_ref().map_or((0.0, std::f32::consts::FRAC_PI_4), |s| (s.inner_cone_angle, s.outer_cone_angle));
            LightKind::Spot { inner: inner.into(), outer: outer.into() }
        }
        (Checked::Invalid, _) => {
            warnings.add("a light of an unknown type is left out");
            return Ok(None);
        }
    };
    let intensity = light.color.map(|c| f64::from(c) * f64::from(light.intensity));
    let cone = match kind {
        LightKind::Spot { inner, outer } => {
            inner >= 0.0 && inner <= outer && outer <= std::f64::consts::FRAC_PI_2 + 1e-6
        }
        _ => true,
    };
    if !cone || !intensity.iter().all(|c| c.is_finite() && *c >= 0.0) {
        warnings.add("a light with negative or infinite colour, or a cone that is none, is left out");
        return Ok(None);
    }
    let range = light.range.map(f64::from).filter(|r| *r > 0.0).unwrap_or(f64::INFINITY);
    Ok(Some(Light { name: named(&light.name, node), to_world, intensity, kind, range }))
}

fn named(own: &Option<String>, node: &str) -> String {
    own.clone().filter(|n| !n.is_empty()).unwrap_or_else(|| node.to_string())
}

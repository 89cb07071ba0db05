//! Punctual lights (KHR_lights_punctual): their direction from a point, and the irradiance that they bring there.

use super::environment_light::Sun;
use crate::geom::{Aabb, DVec3, Vec3};
use crate::scene::{Light, LightKind, Scene};

/// A light in the renderer's space.
#[derive(Debug, Clone)]
pub struct PunctualLight {
    /// Linear Rec. 709: irradiance of a directional light, radiant intensity of the others.
    intensity: DVec3,
    position: DVec3,
    /// Unit direction in which it shines.
    axis: DVec3,
    kind: LightKind,
    /// Metres.
    range: f64,
    /// Metres in the renderer's unit of length.
    unit: f64,
    /// Half of the angular size of a directional light, radians.
    radius: f64,
}

/// A light as a point sees it.
#[derive(Debug, Clone, Copy)]
pub struct IncidentLight {
    /// Unit, towards the light.
    pub dir: DVec3,
    /// Distance to the light in the renderer's units; infinite for a directional light.
    pub distance: f64,
    /// Irradiance on a surface that faces the light, if nothing occludes it.
    pub irradiance: Vec3,
    /// Half of its angular size, radians; 0 for a point.
    pub radius: f64,
}

impl PunctualLight {
    /// The light times `scale`, in the renderer's space, which is (world − eye) / unit. `None` for a light that gives
    /// nothing or has no direction.
    pub fn new(light: &Light, scale: f64, eye: DVec3, unit: f64) -> Option<PunctualLight> {
        let intensity = scale * DVec3::from_array(light.intensity);
        let axis = (-light.to_world.matrix3.z_axis).try_normalize().unwrap_or(DVec3::NEG_Z);
        let position = (light.to_world.translation - eye) / unit;
        let shines = intensity.is_finite() && intensity.max_element() > 0.0 && position.is_finite();
        let (kind, range) = (light.kind, light.range);
        shines.then_some(PunctualLight { intensity, position, axis, kind, range, unit, radius: 0.0 })
    }

    /// A sun: parallel light but for its angular size.
    pub fn from_sun(sun: &Sun) -> PunctualLight {
        PunctualLight {
            intensity: sun.irradiance,
            position: DVec3::ZERO,
            axis: -sun.towards,
            kind: LightKind::Directional,
            range: f64::INFINITY,
            unit: 1.0,
            radius: sun.radius,
        }
    }

    /// The same light with an angular size of twice `radius`, in radians, if it is parallel.
    pub fn with_radius(self, radius: f64) -> PunctualLight {
        let radius = if self.kind == LightKind::Directional { radius } else { 0.0 };
        PunctualLight { radius, ..self }
    }

    /// Parallel light as a sun; `None` for other lights.
    pub fn sun(&self) -> Option<Sun> {
        let sun = Sun { towards: -self.axis, irradiance: self.intensity, radius: self.radius };
        (self.kind == LightKind::Directional).then_some(sun)
    }

    /// The light as it arrives at `x`, a point of the renderer's space; `None` where it brings nothing.
    pub fn incident(&self, x: DVec3) -> Option<IncidentLight> {
        if self.kind == LightKind::Directional {
            let irradiance = self.intensity.as_vec3();
            let (dir, radius) = (-self.axis, self.radius);
            return Some(IncidentLight { dir, distance: f64::INFINITY, irradiance, radius });
        }
        let to = self.position - x;
        let distance = to.length();
        let dir = to.try_normalize()?;
        let metres = distance * self.unit;
        let mut fall = 1.0 / (metres * metres);
        if self.range.is_finite() {
            // The extension's window function, which brings the light to 0 at its range.
            fall *= (1.0 - (metres / self.range).powi(4)).clamp(0.0, 1.0);
        }
        if let LightKind::Spot { inner, outer } = self.kind {
            let scale = 1.0 / (inner.cos() - outer.cos()).max(1e-3);
            let cone = ((-dir.dot(self.axis) - outer.cos()) * scale).clamp(0.0, 1.0);
            fall *= cone * cone;
        }
        let irradiance = (fall * self.intensity).as_vec3();
        (irradiance.is_finite() && irradiance.max_element() > 0.0).then_some(IncidentLight {
            dir,
            distance,
            irradiance,
            radius: 0.0,
        })
    }
}

/// Photometric units per radiometric unit as exporters assume it (Blender's *Standard* unit of lights): lm / W.
pub const LUMENS_PER_WATT: f64 = 683.0;

/// Irradiance from which on lights count as photometric. A white surface under a light that suits a display gets about π,
/// and 683 times as much where the same light is given in lux; this is between the two, about as far from either.
const PHOTOMETRIC: f64 = 100.0;

/// Most points of a scene at which its irradiance is sampled.
const PLACES: usize = 1 << 14;

/// The irradiance of a scene's lights, if it is so large that they must be meant in lux and candela: the median over its
/// objects (centres and corners of their boxes) of what all lights bring there, whatever stands between. It does not depend
/// on the view, so all pictures of a scene are exposed alike.
pub fn photometric(scene: &Scene) -> Option<f64> {
    let model = &scene.model;
    let lights: Vec<PunctualLight> =
        model.lights.iter().filter_map(|light| PunctualLight::new(light, 1.0, DVec3::ZERO, 1.0)).collect();
    let step = (9 * model.instances.len()).div_ceil(PLACES).max(1);
    let places = model.instances.iter().step_by(step).flat_map(|instance| {
        let part = model.parts.get(instance.part).filter(|part| !part.triangles.is_empty());
        let points = part.into_iter().flat_map(|part| &part.positions);
        let own = Aabb::around(points.map(|p| DVec3::from_array(p.map(f64::from))));
        let corner = move |k: usize| {
            let pick = |a: usize| if k >> a & 1 == 0 { own.min[a] } else { own.max[a] };
            DVec3::new(pick(0), pick(1), pick(2))
        };
        let all = (0..8).map(corner).chain([own.centre()]);
        all.filter(move |_| !own.is_empty()).map(|p| instance.transform.transform_point3(p))
    });
    let at = |place: DVec3| -> f64 {
        lights
            .iter()
            .filter_map(|light| light.incident(place))
            .map(|incident| f64::from(incident.irradiance.max_element()))
            .sum()
    };
    let mut found: Vec<f64> = places.map(at).collect();
    found.sort_unstable_by(f64::total_cmp);
    found.get(found.len() / 2).copied().filter(|&irradiance| irradiance > PHOTOMETRIC)
}

/// The sun of a file without lights: from the left, behind and above the usual camera.
pub fn default_sun() -> Light {
    let towards = DVec3::new(-0.5, 0.75, 0.42).normalize();
    Light {
        name: "default sun".into(),
        to_world: glam::DAffine3::from_quat(glam::DQuat::from_rotation_arc(DVec3::Z, towards)),
        intensity: [3.0, 2.85, 2.6],
        kind: LightKind::Directional,
        range: f64::INFINITY,
    }
}

/// Radiance of the sky where neither the file nor the caller says, and no sun stands in it.
pub const DEFAULT_SKY: [f64; 3] = [0.35, 0.42, 0.52];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::DAffine3;
    use crate::scene::{Instance, Model, Part};

    fn light(kind: LightKind, range: f64) -> Light {
        let to_world = DAffine3::from_translation(DVec3::new(0.0, 0.0, 10.0));
        Light { name: String::new(), to_world, intensity: [8.0, 4.0, 2.0], kind, range }
    }

    #[test]
    fn falls_off_with_the_square_in_metres() {
        let point = PunctualLight::new(&light(LightKind::Point, f64::INFINITY), 1.0, DVec3::ZERO, 2.0).unwrap();
        let incident = point.incident(DVec3::new(0.0, 0.0, 3.0)).unwrap();
        assert_eq!(incident.distance, 2.0);
        assert_eq!(incident.irradiance, Vec3::new(8.0, 4.0, 2.0) / 16.0);
        assert_eq!(incident.dir, DVec3::Z);
    }

    #[test]
    fn range_and_cone_end() {
        let ranged = PunctualLight::new(&light(LightKind::Point, 5.0), 1.0, DVec3::ZERO, 1.0).unwrap();
        assert!(ranged.incident(DVec3::new(0.0, 0.0, 4.9)).is_none());
        assert!(ranged.incident(DVec3::new(0.0, 0.0, 5.1)).is_some());
        let spot = LightKind::Spot { inner: 0.2, outer: 0.4 };
        let spot = PunctualLight::new(&light(spot, f64::INFINITY), 1.0, DVec3::ZERO, 1.0).unwrap();
        let at = |angle: f64| spot.incident(DVec3::new(angle.tan(), 0.0, 9.0)).map_or(0.0, |s| s.irradiance.x);
        assert_eq!(at(0.0), 8.0);
        assert_eq!(at(0.41), 0.0);
        assert!(at(0.3) > 0.0 && at(0.3) < at(0.19));
    }

    /// A ground of 20 m, lit from 10 m above its middle.
    fn ground(kind: LightKind, intensity: f64) -> Scene {
        let corners = [[-10.0f32, -10.0], [10.0, -10.0], [10.0, 10.0]].map(|[x, y]| [x, y, 0.0]);
        let part = Part { positions: corners.to_vec(), triangles: vec![[0, 1, 2]], ..Part::default() };
        let instance = Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() };
        let lights = vec![Light { intensity: [intensity; 3], ..light(kind, f64::INFINITY) }];
        let model = Model { parts: vec![part], instances: vec![instance], lights, ..Model::default() };
        Scene { model, ..Scene::default() }
    }

    #[test]
    fn lux_and_candela_are_told_from_watts() {
        for strength in [0.5, 1.0, 3.0, 10.0] {
            assert_eq!(photometric(&ground(LightKind::Directional, strength)), None);
            let lux = LUMENS_PER_WATT * strength;
            assert_eq!(photometric(&ground(LightKind::Directional, lux)), Some(lux));
        }
        // A light of 2 kW and one of 20 kW: 1.6 and 16 W / m² right below, a third of that at the corners.
        for watts in [2e3, 2e4] {
            let intensity = watts / (4.0 * std::f64::consts::PI);
            assert_eq!(photometric(&ground(LightKind::Point, intensity)), None);
            let corner = intensity * LUMENS_PER_WATT / 300.0;
            let found = photometric(&ground(LightKind::Point, intensity * LUMENS_PER_WATT)).unwrap();
            assert!((found / corner - 1.0).abs() < 1e-6, "{found} {corner}");
        }
        assert_eq!(photometric(&Scene::default()), None);
    }

    #[test]
    fn the_sun_is_the_same_everywhere() {
        let sun = PunctualLight::new(&default_sun(), 1.0, DVec3::splat(1e6), 1e3).unwrap();
        let a = sun.incident(DVec3::ZERO).unwrap();
        assert!(a.dir.y > 0.5 && a.distance.is_infinite());
    }
}

//! Cameras: the ray and the cone of a pixel.

use crate::geom::{Aabb, DVec3, Ray};
use crate::scene::{Camera, Projection};

/// Eye and projection of a picture. Rays start relative to `eye`, and are in a unit of length that the caller chooses.
#[derive(Debug, Clone)]
pub struct View {
    /// Origin of the rays' space: the eye, unless the view was [moved](View::moved). World space, metres.
    pub eye: DVec3,
    /// Vector from there to the camera, metres.
    shift: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    size: [f64; 2],
    projection: Projection,
    /// Half of the picture's height: at distance 1 in a perspective view, in metres in a parallel one.
    half: f64,
}

/// A pixel's ray with the width of its cone.
#[derive(Debug, Clone, Copy)]
pub struct Cone {
    /// Unit direction.
    pub ray: Ray,
    /// Width at t = 0.
    pub width: f64,
    /// Growth of the width per unit of t.
    pub growth: f64,
}

impl Cone {
    pub fn width_at(&self, t: f64) -> f64 {
        self.width + self.growth * t
    }
}

impl View {
    /// The file's camera; `None` where its matrix has no direction.
    pub fn new(camera: &Camera, size: [u32; 2]) -> Option<View> {
        let m = camera.to_world.matrix3;
        Self::towards(camera.to_world.translation, -m.z_axis, m.y_axis, size, camera.projection)
    }

    /// A view along `forward`, with `up` upwards as far as that allows.
    pub fn towards(eye: DVec3, forward: DVec3, up: DVec3, size: [u32; 2], projection: Projection) -> Option<View> {
        let forward = forward.try_normalize()?;
        let right = forward.cross(up).try_normalize().or_else(|| forward.cross(DVec3::Z).try_normalize());
        let right = right.or_else(|| forward.cross(DVec3::X).try_normalize())?;
        let half = match projection {
            Projection::Perspective { yfov } => (0.5 * yfov).tan(),
            Projection::Orthographic { ymag } => ymag,
        };
        let valid = match projection {
            Projection::Perspective { yfov } => yfov > 0.0 && yfov < std::f64::consts::PI,
            Projection::Orthographic { ymag } => ymag > 0.0 && ymag.is_finite(),
        };
        (valid && eye.is_finite()).then_some(View {
            eye,
            shift: DVec3::ZERO,
            right,
            up: right.cross(forward),
            forward,
            size: size.map(f64::from),
            projection,
            half,
        })
    }

    /// A view in which all of `bounds` (not empty) is seen, from the front, the right and above.
    pub fn framing(bounds: &Aabb, size: [u32; 2]) -> Option<View> {
        const YFOV: f64 = 0.7;
        let radius = (0.5 * bounds.size().length()).max(f64::MIN_POSITIVE);
        let across = (0.5 * YFOV).tan() * (f64::from(size[0]) / f64::from(size[1])).min(1.0);
        let from = DVec3::new(0.45, 0.4, 0.8).normalize();
        let eye = bounds.centre() + from * (radius / across.atan().sin());
        Self::towards(eye, -from, DVec3::Y, size, Projection::Perspective { yfov: YFOV })
    }

    /// The same view, whose rays are relative to `origin`.
    pub fn moved(self, origin: DVec3) -> View {
        View { shift: self.place() - origin, eye: origin, ..self }
    }

    /// Where the camera stands, world space, metres.
    pub fn place(&self) -> DVec3 {
        self.eye + self.shift
    }

    /// Unit direction through the picture's middle.
    pub fn ahead(&self) -> DVec3 {
        self.forward
    }

    /// Perspective or parallel.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// The ray of [`View::cone`].
    pub fn ray(&self, x: f64, y: f64, unit: f64) -> Ray {
        let across = self.across(x, y);
        match self.projection {
            Projection::Perspective { .. } => {
                Ray { origin: self.shift / unit, dir: (self.forward + self.half * across).normalize() }
            }
            Projection::Orthographic { .. } => {
                Ray { origin: self.half / unit * across + self.shift / unit, dir: self.forward }
            }
        }
    }

    /// Vector from the picture's middle to the pixel position (x, y), in half heights.
    fn across(&self, x: f64, y: f64) -> DVec3 {
        let [width, height] = self.size;
        (2.0 * x - width) / height * self.right + (1.0 - 2.0 * y / height) * self.up
    }

    /// The cone through (x, y), in pixels from the upper left corner; `unit` is the length that becomes 1.
    pub fn cone(&self, x: f64, y: f64, unit: f64) -> Cone {
        let ray = self.ray(x, y, unit);
        let pixel = 2.0 * self.half / self.size[1];
        match self.projection {
            Projection::Perspective { .. } => {
                let cos = ray.dir.dot(self.forward);
                // The square root of a pixel's solid angle.
                Cone { ray, width: 0.0, growth: pixel * cos * cos.sqrt() }
            }
            Projection::Orthographic { .. } => Cone { ray, width: pixel / unit, growth: 0.0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_tile_the_view() {
        let size = [400, 200];
        let view = View::towards(
            DVec3::new(1e6, 0.0, 0.0),
            DVec3::X,
            DVec3::Y,
            size,
            Projection::Perspective { yfov: std::f64::consts::FRAC_PI_2 },
        )
        .unwrap();
        let middle = view.cone(200.0, 100.0, 1.0);
        assert!((middle.ray.dir - DVec3::X).length() < 1e-15);
        assert!((middle.growth - 0.01).abs() < 1e-15);
        // The upper edge is at 45 degrees; +z is to the right of +x.
        let top = view.cone(200.0, 0.0, 1.0).ray.dir;
        assert!((top - DVec3::new(1.0, 1.0, 0.0).normalize()).length() < 1e-15);
        assert!(view.cone(400.0, 100.0, 1.0).ray.dir.z > 0.8);
        // The pixels' solid angles add up to that of the pyramid, 4 asin(sin(a) sin(b)) with half angles 45° and atan 2.
        let sum: f64 = (0..size[0] * size[1])
            .map(|i| view.cone(f64::from(i % size[0]) + 0.5, f64::from(i / size[0]) + 0.5, 1.0).growth.powi(2))
            .sum();
        let pyramid = 4.0 * (0.5f64.sqrt() * (2.0 / 5f64.sqrt())).asin();
        assert!((sum / pyramid - 1.0).abs() < 1e-4, "{sum} {pyramid}");
    }

    #[test]
    fn framing_sees_every_corner() {
        let bounds = Aabb::new(DVec3::new(-5.0, 0.0, -1.0), DVec3::new(3.0, 2.0, 9.0));
        for size in [[640, 360], [100, 400]] {
            let view = View::framing(&bounds, size).unwrap();
            for k in 0..8 {
                let pick = |a: usize| if k >> a & 1 == 0 { bounds.min[a] } else { bounds.max[a] };
                let d = DVec3::new(pick(0), pick(1), pick(2)) - view.eye;
                let (x, y, z) = (d.dot(view.right), d.dot(view.up), d.dot(view.forward));
                let tan = 0.35f64.tan();
                assert!(z > 0.0 && y.abs() <= z * tan && x.abs() <= z * tan * f64::from(size[0]) / f64::from(size[1]));
            }
        }
    }
}

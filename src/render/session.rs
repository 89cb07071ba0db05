//! One scene, many pictures: texels stay open, and a picture is made window by window, so that whoever waits for it can show
//! a part, or turn to another view.

use std::sync::Arc;

use super::options::{CropWindow, Options};
use super::pixel::Tracer;
use super::prepare::World;
use super::trace::{Trace, TraceEvent};
use super::{Film, Opened, check, film, pixel_of, shared};
use crate::geom::{Aabb, DVec3};
use crate::progress::Quiet;
use crate::scene::{Projection, Scene};
use crate::volume::Octree;
use crate::{Error, Result, Warnings, par};

/// A scene whose texels are open. What is decoded of them stays in memory.
pub struct Session<'a> {
    scene: &'a Scene,
    trees: Vec<Option<Arc<Octree>>>,
}

impl<'a> Session<'a> {
    /// Open the scene's texels.
    ///
    /// # Errors
    /// As [`super::render`].
    pub fn new(scene: &'a Scene) -> Result<Session<'a>> {
        Ok(Session { scene, trees: shared(Opened::new(scene)?.trees()?) })
    }

    /// Make everything ready for pictures by `options`; its `crop` has no effect.
    ///
    /// # Errors
    /// As [`super::render`].
    pub fn prepare(&self, options: Options) -> Result<Prepared<'a>> {
        let options = Options { crop: None, ..options };
        check(&options)?;
        let world = par::with_threads(options.threads, || World::new(self.scene, self.trees.clone(), &options))??;
        Ok(Prepared { world, options })
    }
}

/// From where a picture is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Viewpoint {
    /// World space, metres.
    pub eye: DVec3,
    /// Unit direction through the picture's middle.
    pub ahead: DVec3,
    /// Perspective or parallel.
    pub projection: Projection,
}

/// A scene as seen by one camera in a picture of one size.
pub struct Prepared<'a> {
    world: World<'a>,
    options: Options,
}

impl Prepared<'_> {
    /// The camera.
    pub fn viewpoint(&self) -> Viewpoint {
        let view = &self.world.view;
        Viewpoint { eye: view.eye, ahead: view.ahead(), projection: view.projection() }
    }

    /// The box of all that may be seen, world space, metres; may be empty.
    pub fn bounds(&self) -> Aabb {
        self.world.bounds
    }

    /// What was mended or left out.
    pub fn warnings(&self) -> &Warnings {
        &self.world.warnings
    }

    /// From now on, so many cones a pixel: 1, 2, 4, 8 or 16.
    pub fn set_lanes(&mut self, lanes: u32) {
        self.options.lanes = lanes;
    }

    /// The pixels of `window`, as [`super::render`] makes them.
    ///
    /// # Errors
    /// `Options` where the window is not within the picture; what reading a texel says.
    pub fn film(&self, window: CropWindow) -> Result<Film> {
        let options = Options { crop: Some(window), ..self.options.clone() };
        check(&options)?;
        let (film, _) = par::with_threads(options.threads, || film(&self.world, &options, &Quiet))?;
        let failure = self.world.texels.iter().flatten().find_map(|texel| texel.tree.failure());
        failure.map_or(Ok(film), |error| Err(Error::Failed(error.to_string())))
    }

    /// The point that is seen at pixel (x, y), world space, metres: where less than half of the light comes from beyond.
    /// `None` outside of the picture, or where nothing is.
    pub fn point(&self, x: u32, y: u32) -> Option<DVec3> {
        if x >= self.options.size[0] || y >= self.options.size[1] {
            return None;
        }
        let mut tracer = Tracer::new(&self.world, &self.options);
        tracer.trace = Some(Trace::new());
        pixel_of(&mut tracer, x, y);
        let metres = nearest(&tracer.trace.take().unwrap_or_default())?;
        let ray = self.world.view.ray(f64::from(x) + 0.5, f64::from(y) + 0.5, self.world.unit);
        Some(self.world.view.eye + ray.origin * self.world.unit + ray.dir * metres)
    }
}

/// Distance of the first thing that stops more than half of what comes to it.
fn nearest(trace: &Trace) -> Option<f64> {
    let met = trace.iter().filter_map(|event| match event {
        TraceEvent::Cell { metres, before, after, .. } | TraceEvent::Near { metres, before, after, .. } => {
            (*after < 0.5 * before).then_some(0.5 * (metres[0] + metres[1]))
        }
        TraceEvent::Surface { metres, .. } => Some(*metres),
        _ => None,
    });
    met.min_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{CameraChoice, render};
    use crate::scene::{Instance, Part};

    /// A square of 2 m, a metre above the ground, seen from 3 m above.
    fn square() -> Scene {
        let mut scene = Scene::default();
        scene.model.parts = vec![Part {
            positions: vec![[-1.0, 1.0, -1.0], [1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]],
            triangles: vec![[0, 2, 1], [0, 3, 2]],
            ..Part::default()
        }];
        scene.model.materials = vec![crate::scene::Material::default()];
        scene.model.instances = vec![Instance { part: 0, transform: glam::DAffine3::IDENTITY, node: String::new() }];
        scene
    }

    #[test]
    fn windows_are_parts_of_the_picture() {
        let scene = square();
        let camera =
            CameraChoice::LookAt { eye: DVec3::new(0.0, 4.0, 0.1), target: DVec3::new(0.3, 1.0, 0.0), yfov: 1.0 };
        let options = Options { size: [40, 30], camera, ..Options::default() };
        let whole = render(&scene, &options, &Quiet).unwrap().film;
        let session = Session::new(&scene).unwrap();
        let prepared = session.prepare(options).unwrap();
        let part = prepared.film(CropWindow { at: [20, 10], size: [17, 9] }).unwrap();
        for (i, pixel) in part.pixels.iter().enumerate() {
            assert_eq!(*pixel, whole.pixels[(10 + i / 17) * 40 + 20 + i % 17]);
        }
        assert!(prepared.film(CropWindow { at: [30, 0], size: [11, 1] }).is_err());
        // The middle of the picture lies where the camera looks, to within a pixel.
        let point = prepared.point(20, 15).unwrap();
        assert!((point - DVec3::new(0.3, 1.0, 0.0)).length() < 0.2 && (point.y - 1.0).abs() < 1e-9, "{point}");
        assert_eq!(prepared.point(40, 0), None);
        assert_eq!(prepared.viewpoint().eye, DVec3::new(0.0, 4.0, 0.1));
        assert_eq!(prepared.bounds().max, DVec3::splat(1.0));
    }
}

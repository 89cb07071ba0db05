//! Sessions render many pictures of one scene: texels stay open, and a picture is rendered window by window, so that a viewer can show parts
//! of it at once, or change the camera in between.

use std::sync::Arc;

use super::options::{CropWindow, Options, SourceLod};
use super::pixel::Tracer;
use super::prepare::{self, World};
use super::source_lod::LazySource;
use super::trace::{Trace, TraceEvent};
use super::{Film, Opened, adaptive, check, into_shared};
use crate::geom::{Aabb, DVec3};
use crate::progress::Quiet;
use crate::scene::{Projection, Scene};
use crate::volume::Octree;
use crate::{Error, Result, Warnings, par};

/// A scene whose texels are open. Decoded voxels and the triangles of sources stay in memory.
pub struct Session<'a> {
    scene: &'a Scene,
    trees: Vec<Option<Arc<Octree>>>,
    sources: Vec<Option<Arc<LazySource>>>,
}

impl<'a> Session<'a> {
    /// Open the scene's texels.
    ///
    /// # Errors
    /// As [`super::render`].
    pub fn new(scene: &'a Scene) -> Result<Session<'a>> {
        Ok(Session { scene, trees: into_shared(Opened::new(scene)?.trees()?), sources: prepare::sources(scene) })
    }

    /// Make everything ready for pictures by `options`; its `crop` has no effect.
    ///
    /// # Errors
    /// As [`super::render`].
    pub fn prepare(&self, options: Options) -> Result<Prepared<'a>> {
        let options = Options { crop: None, ..options };
        check(&options)?;
        // Prepared without sources, since the session has them already and adds them below.
        let plain = Options { source_lod: SourceLod::Voxels, ..options.clone() };
        let world = par::with_threads(options.threads, || World::new(self.scene, self.trees.clone(), &plain))??;
        let mut prepared = Prepared { world, options: plain, sources: self.sources.clone() };
        prepared.show_sources(options.source_lod);
        prepared.options = options;
        Ok(prepared)
    }
}

/// The camera of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Viewpoint {
    /// World space, metres.
    pub eye: DVec3,
    /// Unit direction through the picture's middle.
    pub ahead: DVec3,
    /// Perspective or parallel.
    pub projection: Projection,
}

/// A scene as seen by one camera in a picture of one size; both can be changed.
pub struct Prepared<'a> {
    world: World<'a>,
    options: Options,
    sources: Vec<Option<Arc<LazySource>>>,
}

impl Prepared<'_> {
    /// The camera.
    pub fn viewpoint(&self) -> Viewpoint {
        let view = &self.world.view;
        Viewpoint { eye: view.place(), ahead: view.ahead(), projection: view.projection() }
    }

    /// Change the picture: from now on the camera, `size`, `lanes`, `exposure` and `source_lod` are those of `options`, whose other
    /// fields have to be as before. Nothing is prepared anew. If the camera has moved, pictures may differ by rounding from those of a scene that is prepared for
    /// the new position, the more so the further it has moved (see [`Prepared::distance`]).
    ///
    /// # Errors
    /// `Options` where there is no such camera or picture.
    pub fn look(&mut self, options: Options) -> Result<()> {
        let options = Options { crop: None, ..options };
        check(&options)?;
        let view = prepare::view(self.world.scene, &self.world.bounds, &options, &mut Vec::new())?;
        self.world.view = view.moved(self.world.view.eye);
        self.show_sources(options.source_lod);
        self.options = options;
        Ok(())
    }

    /// Distance of the camera of `options` from the position for which the scene was prepared, in units of about the distance from there to the
    /// scene's farthest corner. At 0, pictures are the same as those of a scene that is prepared for that camera.
    ///
    /// # Errors
    /// `Options` where there is no such camera.
    pub fn distance(&self, options: &Options) -> Result<f64> {
        let view = prepare::view(self.world.scene, &self.world.bounds, options, &mut Vec::new())?;
        Ok((view.eye - self.world.view.eye).length() / self.world.unit)
    }

    fn show_sources(&mut self, lod: SourceLod) {
        if lod != self.options.source_lod && self.sources.iter().any(Option::is_some) {
            let none = vec![None; self.sources.len()];
            self.world.show_sources(if lod == SourceLod::Geometry { &self.sources } else { &none });
        }
    }

    /// Bounding box of the scene, world space, metres; may be empty.
    pub fn bounds(&self) -> Aabb {
        self.world.bounds
    }

    /// Warnings about what was mended or left out.
    pub fn warnings(&self) -> &Warnings {
        &self.world.warnings
    }

    /// The pixels of `window`, as [`super::render`] makes them.
    ///
    /// # Errors
    /// `Options` where the window is not within the picture; what reading a texel says.
    pub fn film(&self, window: CropWindow) -> Result<Film> {
        let options = Options { crop: Some(window), ..self.options.clone() };
        check(&options)?;
        let (film, _) = par::with_threads(options.threads, || adaptive::film(&self.world, &options, &Quiet))?;
        let failure = self.world.texels.iter().flatten().find_map(|texel| texel.tree.failure());
        failure.map_or(Ok(film), |error| Err(Error::Failed(error.to_string())))
    }

    /// The point that is seen at pixel (x, y), world space, metres: where more than half of the light has been stopped. `None` outside of the
    /// picture, or where the background shows.
    pub fn point(&self, x: u32, y: u32) -> Option<DVec3> {
        if x >= self.options.size[0] || y >= self.options.size[1] {
            return None;
        }
        // A single lane goes through the pixel's middle.
        let options = Options { lanes: 1, ..self.options.clone() };
        let mut tracer = Tracer::new(&self.world, &options);
        tracer.trace = Some(Trace::new());
        adaptive::Pixel::first(&mut tracer, [x, y]);
        let metres = nearest(&tracer.trace.take().unwrap_or_default())?;
        let ray = self.world.view.ray(f64::from(x) + 0.5, f64::from(y) + 0.5, self.world.unit);
        Some(self.world.view.eye + ray.origin * self.world.unit + ray.dir * metres)
    }
}

/// Distance, metres, of the nearest copy or surface that stops more than half of the light that reaches it.
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

    #[test]
    fn a_prepared_scene_turns_to_other_pictures() {
        let scene = square();
        let look = |eye: DVec3, target: DVec3, size| {
            let camera = CameraChoice::LookAt { eye, target, yfov: 1.0 };
            Options { size, camera, lanes: 4, ..Options::default() }
        };
        let whole = |size: [u32; 2]| CropWindow { at: [0, 0], size };
        let eye = DVec3::new(0.0, 4.0, 0.1);
        let session = Session::new(&scene).unwrap();
        let mut prepared = session.prepare(look(eye, DVec3::Y, [40, 30])).unwrap();
        // From the same place: the same, bit for bit.
        let other = look(eye, DVec3::new(0.5, 1.0, 0.2), [33, 20]);
        assert_eq!(prepared.distance(&other).unwrap(), 0.0);
        prepared.look(other.clone()).unwrap();
        let made = render(&scene, &other, &Quiet).unwrap().film;
        let prepared_before = made.pixels;
        assert!(prepared.film(whole([33, 20])).unwrap().pixels == prepared_before);
        // As bright as others want it, again the same.
        let brighter = Options { exposure: 1.5, ..other.clone() };
        prepared.look(brighter.clone()).unwrap();
        let made = render(&scene, &brighter, &Quiet).unwrap().film;
        let film = prepared.film(whole([33, 20])).unwrap();
        assert!(film.pixels == made.pixels && film.pixels[300] != prepared_before[300]);
        // From another: but for roundings.
        let moved = look(DVec3::new(0.7, 2.5, -0.4), DVec3::new(0.2, 1.0, 0.0), [40, 30]);
        assert!(prepared.distance(&moved).unwrap() > 0.1);
        prepared.look(moved.clone()).unwrap();
        assert!((prepared.viewpoint().eye - DVec3::new(0.7, 2.5, -0.4)).length() < 1e-15);
        let made = render(&scene, &moved, &Quiet).unwrap().film;
        let film = prepared.film(whole([40, 30])).unwrap();
        let apart = film.pixels.iter().flatten().zip(made.pixels.iter().flatten()).map(|(a, b)| (a - b).abs());
        assert!(apart.fold(0.0, f32::max) < 1e-4);
        let point = prepared.point(20, 15).unwrap();
        assert!((point - DVec3::new(0.2, 1.0, 0.0)).length() < 0.2 && (point.y - 1.0).abs() < 1e-9, "{point}");
        assert!(prepared.look(Options { size: [0, 1], ..moved.clone() }).is_err());
        assert!(prepared.look(look(eye, eye, [40, 30])).is_err());
    }
}

//! A landscape's page and its pictures: coarse first, finer for as long as the camera rests.
//!
//! A picture is a stream of records. Each begins with eight integers of 16 bits, little-endian: kind, lanes, width and height of
//! the picture that it belongs to, and x, y, width and height of a tile, whose pixels follow row by row, three bytes each. Later
//! pictures have more pixels, the last one more lanes. The kind is 1 for a tile, 2 for the end, 3 for a failure, whose text follows
//! and is as long as the number of 32 bits in place of the tile's width and height.

use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde_json::{Value, json};

use super::super::exposure::{Exposure, exposure};
use super::super::flags;
use super::super::render::{self, Look};
use super::super::ui::Ui;
use super::http::{Client, NOTHING, Request};
use crate::Result;
use crate::geom::DVec3;
use crate::render::session::{Prepared, Session};
use crate::render::{CameraChoice, CropWindow, Options, SourceLod};
use crate::scene::Projection;

const PAGE: &str = include_str!("page/landscape.html");
const STYLE: &str = concat!(include_str!("../export/page/common.css"), include_str!("page/landscape.css"));
/// Its modules; what listens to mouse, keys and fingers is the texel page's, and so is the style of what both have.
const MODULES: [(&str, &str); 4] = [
    ("/landscape.mjs", include_str!("page/landscape.mjs")),
    ("/camera.mjs", include_str!("page/camera.mjs")),
    ("/pictures.mjs", include_str!("page/pictures.mjs")),
    ("/view.mjs", include_str!("../export/page/view.mjs")),
];
/// The page loads what this server has, and nothing else.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; base-uri 'none'; \
                      form-action 'none'; frame-ancestors 'none'";

/// Most pixels a side of a picture, and its coarsest pixel in pixels of the finest.
const MAX_PIXELS: u32 = 4096;
const COARSEST: u32 = 64;
/// Cones a pixel of the last picture.
const LANES: u32 = 4;
/// How far the camera may go, in units about as long as the scene, before even coarse pictures want it prepared anew: at one unit,
/// 32 bits place things to a ten-millionth of it.
const NEAR_ENOUGH: f64 = 1.0;
/// Pixels a side of what is sent at once.
const TILE: u32 = 128;
/// Vertical field of view that takes the place of parallel rays, degrees.
const FOV: f64 = 20.0;

const KIND_TILE: u16 = 1;
const KIND_END: u16 = 2;
const KIND_FAILURE: u16 = 3;

/// A landscape that is looked at.
pub struct Landscape<'a> {
    session: Session<'a>,
    look: &'a Look,
    /// What the page is told of it.
    about: Value,
    /// Who renders: one at a time, so that several pages share the processor. It holds what was prepared last.
    turn: Mutex<Option<Place<'a>>>,
}

/// The scene, prepared for a place of the camera.
type Place<'a> = Arc<Mutex<Prepared<'a>>>;

/// A camera that a page asks for.
struct Camera {
    eye: DVec3,
    target: DVec3,
    /// Radians.
    yfov: f64,
    size: [u32; 2],
    /// The coarsest pixel, in pixels: a power of two.
    step: u32,
    exposure: Exposure,
}

/// Why a picture ended early.
enum Ended {
    Gone(io::Error),
    Failed(crate::Error),
}

impl From<io::Error> for Ended {
    fn from(e: io::Error) -> Ended {
        Ended::Gone(e)
    }
}

impl From<crate::Error> for Ended {
    fn from(e: crate::Error) -> Ended {
        Ended::Failed(e)
    }
}

impl<'a> Landscape<'a> {
    /// `command`: how a command line that renders it begins.
    ///
    /// # Errors
    /// As [`crate::render::render`]; under `--strict` also where something was mended.
    pub fn new(look: &'a Look, name: String, command: String, ui: &Ui) -> Result<Landscape<'a>> {
        let session = Session::new(&look.scene)?;
        let first = session.prepare(Options { size: [64, 36], ..look.options.clone() })?;
        ui.warn(first.warnings())?;
        let (camera, radius) = first_camera(&first);
        let about = json!({
            "name": name, "command": command, "camera": camera, "radius": radius, "lanes": look.options.lanes.max(LANES),
            "exposure": {
                "said": look.is_exposed,
                "auto": look.lux.is_some() && matches!(look.exposure, Exposure::Auto(_)),
                "stops": look.exposure.stops(),
            },
        });
        Ok(Landscape { session, look, about, turn: Mutex::new(Some(Arc::new(Mutex::new(first)))) })
    }

    /// Answer a request of a page.
    ///
    /// # Errors
    /// Where the client has gone.
    pub fn answer(&self, request: &Request, client: &mut Client) -> io::Result<()> {
        let path = request.path.as_str();
        if let Some((_, text)) = MODULES.iter().find(|(name, _)| *name == path) {
            return client.answer("200 OK", "text/javascript; charset=utf-8", NOTHING, text.as_bytes());
        }
        match path {
            "/" => client.answer("200 OK", "text/html; charset=utf-8", POLICY, PAGE.as_bytes()),
            "/landscape.css" => client.answer("200 OK", "text/css; charset=utf-8", NOTHING, STYLE.as_bytes()),
            "/scene" => json_answer(client, &self.about),
            "/picture" => match self.camera_of(request) {
                Ok(camera) => self.picture(&camera, client),
                Err(what) => bad(client, &what),
            },
            "/point" => match (self.camera_of(request), pixel_of(request)) {
                (Ok(camera), Ok([x, y])) => {
                    let found = self.point(&camera, [x, y]);
                    json_answer(client, &json!(found.ok().flatten().map(|p| p.to_array())))
                }
                (Err(what), _) | (_, Err(what)) => bad(client, &what),
            },
            _ => client.missing(),
        }
    }

    fn camera_of(&self, request: &Request) -> Result<Camera, String> {
        let camera = camera_of(request, self.look.exposure)?;
        // The scene is prepared with its lights as they are, or for what suits them.
        let (_, scale) = camera.exposure.of(self.look.lux);
        if scale == self.look.options.light_scale {
            return Ok(camera);
        }
        Err("exposure: the command line says whether it begins at auto, and no page changes that".into())
    }

    fn turn(&self) -> MutexGuard<'_, Option<Place<'a>>> {
        held(&self.turn)
    }

    /// The scene as it is prepared for `camera`, exactly, or near enough where pixels are `step` wide.
    fn place(&self, kept: &mut Option<Place<'a>>, camera: &Camera, step: u32) -> Result<Place<'a>> {
        let options = self.options(camera, step);
        if let Some(place) = kept {
            let distance = held(place).distance(&options)?;
            if distance == 0.0 || step > 1 && distance < NEAR_ENOUGH {
                return Ok(place.clone());
            }
        }
        // What was prepared before is let go first, so that memory need not hold both.
        *kept = None;
        let place = Arc::new(Mutex::new(self.session.prepare(options)?));
        *kept = Some(place.clone());
        Ok(place)
    }

    fn point(&self, camera: &Camera, [x, y]: [u32; 2]) -> Result<Option<DVec3>> {
        let mut turn = self.turn();
        // Any pixel is wide enough for a place to turn around.
        let place = self.place(&mut turn, camera, COARSEST)?;
        let mut prepared = held(&place);
        prepared.look(self.options(camera, 1))?;
        Ok(prepared.point(x, y))
    }

    /// Of a picture whose pixels are `step` wide.
    fn options(&self, camera: &Camera, step: u32) -> Options {
        let mut options = self.look.options.clone();
        options.size = camera.size.map(|side| side.div_ceil(step));
        options.exposure = camera.exposure.of(self.look.lux).0;
        options.camera = CameraChoice::LookAt { eye: camera.eye, target: camera.target, yfov: camera.yfov };
        if step > 1 {
            // What pixels as wide as these see of a source's triangles is not worth reading them.
            (options.lanes, options.source_lod) = (1, SourceLod::Voxels);
        }
        options
    }

    fn picture(&self, camera: &Camera, client: &mut Client) -> io::Result<()> {
        client.begin("application/octet-stream", NOTHING)?;
        match self.pictures(camera, client) {
            Ok(()) => client.send(&record([KIND_END, 0, 0, 0, 0, 0, 0, 0])),
            Err(Ended::Gone(e)) => Err(e),
            Err(Ended::Failed(e)) => {
                let line = e.to_string();
                let text = flags::named(&line);
                let length = text.len() as u32;
                client.send(&record([KIND_FAILURE, 0, 0, 0, 0, 0, length as u16, (length >> 16) as u16]))?;
                client.send(text.as_bytes())
            }
        }
    }

    fn pictures(&self, camera: &Camera, client: &mut Client) -> Result<(), Ended> {
        let mut step = camera.step;
        while step > 1 {
            self.tiles(camera, step, self.options(camera, step), client)?;
            // A sixteenth of the pixels at a time, down to all of them.
            step = if step > 2 { step / 4 } else { 1 };
        }
        let own = self.look.options.lanes;
        for lanes in [own, LANES].into_iter().take(if own < LANES { 2 } else { 1 }) {
            self.tiles(camera, 1, Options { lanes, ..self.options(camera, 1) }, client)?;
        }
        Ok(())
    }

    fn tiles(&self, camera: &Camera, step: u32, options: Options, client: &mut Client) -> Result<(), Ended> {
        let (size, lanes) = (options.size, options.lanes);
        let mut place = None;
        for tile in from_the_middle(size) {
            let mut film = {
                let mut turn = self.turn();
                still_there(client)?;
                let place = match &place {
                    Some(place) => place,
                    None => place.insert(self.place(&mut turn, camera, step)?),
                };
                let mut prepared = held(place);
                prepared.look(options.clone())?;
                prepared.film(tile)?
            };
            self.look.tone.apply(&mut film);
            let [x, y, w, h] = [tile.at[0], tile.at[1], tile.size[0], tile.size[1]].map(|n| n as u16);
            let mut bytes = record([KIND_TILE, lanes as u16, size[0] as u16, size[1] as u16, x, y, w, h]);
            bytes.extend(film.rgb8());
            client.send(&bytes)?;
        }
        Ok(())
    }
}

fn held<T>(what: &Mutex<T>) -> MutexGuard<'_, T> {
    what.lock().unwrap_or_else(PoisonError::into_inner)
}

fn still_there(client: &Client) -> io::Result<()> {
    if client.is_gone() { Err(io::ErrorKind::ConnectionAborted.into()) } else { Ok(()) }
}

fn record(words: [u16; 8]) -> Vec<u8> {
    words.into_iter().flat_map(u16::to_le_bytes).collect()
}

fn json_answer(client: &mut Client, value: &Value) -> io::Result<()> {
    client.answer("200 OK", "application/json", NOTHING, value.to_string().as_bytes())
}

fn bad(client: &mut Client, what: &str) -> io::Result<()> {
    client.answer("400 Bad Request", "text/plain; charset=utf-8", NOTHING, format!("{what}\n").as_bytes())
}

/// Where a page begins, and half of the scene's extent, metres.
fn first_camera(prepared: &Prepared<'_>) -> (Value, f64) {
    let (view, bounds) = (prepared.viewpoint(), prepared.bounds());
    let radius = if bounds.is_empty() { 1.0 } else { (0.5 * bounds.size().length()).max(1e-6) };
    let seen = prepared.point(32, 18).map(|point| (point - view.eye).length());
    let beside = || (bounds.centre() - view.eye).dot(view.ahead).clamp(0.05 * radius, 4.0 * radius);
    let distance = seen.unwrap_or_else(beside);
    let target = view.eye + view.ahead * distance;
    let (eye, fov) = match view.projection {
        Projection::Perspective { yfov } => (view.eye, yfov.to_degrees()),
        // From so far away that as much is seen around the target.
        Projection::Orthographic { ymag } => (target - view.ahead * (ymag / (0.5 * FOV).to_radians().tan()), FOV),
    };
    (json!({ "eye": eye.to_array(), "target": target.to_array(), "fov": fov }), radius)
}

/// As the query of a request has it; `otherwise`: the exposure of one that says none.
fn camera_of(request: &Request, otherwise: Exposure) -> Result<Camera, String> {
    let value = |name: &str| request.value(name).ok_or_else(|| format!("{name} is missing"));
    let point = |name: &str| value(name).and_then(|text| render::triple(text).map_err(|e| format!("{name}: {e}")));
    let fov: f64 = value("fov")?.parse().map_err(|_| "fov is no number of degrees".to_owned())?;
    if !(fov > 0.0 && fov < 180.0) {
        return Err("fov lies between 0 and 180 degrees".into());
    }
    let size = render::size(value("size")?).map_err(|e| format!("size: {e}"))?;
    if size.iter().any(|side| !(1..=MAX_PIXELS).contains(side)) {
        return Err(format!("size: each side has 1 to {MAX_PIXELS} pixels"));
    }
    let step: u32 = value("step")?.parse().map_err(|_| "step is no whole number".to_owned())?;
    if !step.is_power_of_two() || step > COARSEST {
        return Err(format!("step is a power of two up to {COARSEST}"));
    }
    let (eye, target) = (DVec3::from_array(point("eye")?), DVec3::from_array(point("target")?));
    let exposure = request.value("exposure").map_or(Ok(otherwise), exposure).map_err(|e| format!("exposure: {e}"))?;
    Ok(Camera { eye, target, yfov: fov.to_radians(), size, step, exposure })
}

fn pixel_of(request: &Request) -> Result<[u32; 2], String> {
    let side = |name: &str| {
        request.value(name).and_then(|text| text.parse().ok()).ok_or_else(|| format!("{name} is no number of a pixel"))
    };
    Ok([side("x")?, side("y")?])
}

/// Tiles that make up a picture, those in its middle first.
fn from_the_middle([width, height]: [u32; 2]) -> Vec<CropWindow> {
    let starts = |length: u32| (0..length).step_by(TILE as usize);
    let tile = |x: u32, y: u32| CropWindow { at: [x, y], size: [TILE.min(width - x), TILE.min(height - y)] };
    let mut tiles: Vec<_> = starts(height).flat_map(|y| starts(width).map(move |x| tile(x, y))).collect();
    let off = |at: u32, size: u32, length: u32| i64::from(2 * at + size) - i64::from(length);
    tiles.sort_by_key(|t| off(t.at[0], t.size[0], width).pow(2) + off(t.at[1], t.size[1], height).pow(2));
    tiles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_a_picture_once_from_the_middle() {
        for size in [[1, 1], [128, 128], [300, 200], [1280, 720], [129, 4096]] {
            let tiles = from_the_middle(size);
            let pixels: u32 = tiles.iter().map(|t| t.size[0] * t.size[1]).sum();
            assert_eq!(pixels, size[0] * size[1]);
            assert!(tiles.iter().all(|t| t.is_within(size)));
            let apart = |i: usize| !tiles[..i].iter().any(|other| other.overlaps(&tiles[i]));
            assert!((0..tiles.len()).all(apart));
        }
        let first = from_the_middle([1280, 720])[0];
        assert!(first.at[0] <= 640 && first.at[0] + first.size[0] >= 640 && first.at[1] <= 360);
    }

    #[test]
    fn records_are_sixteen_bytes() {
        assert_eq!(record([1, 4, 1280, 720, 0, 128, 256, 64])[..6], [1, 0, 4, 0, 0, 5]);
        assert_eq!(record([0; 8]).len(), 16);
    }
}

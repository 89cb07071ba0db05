//! The same picture by another tracer: the landscape's triangles written for it, its pictures read, timed and compared.
//!
//! The file that it gets, little-endian: `VTEXTRI1`; the number of meshes, and of each the numbers of vertices, of normals (all or
//! none) and of triangles, positions, normals, linear colours, indices; the number of copies, and of each its mesh and the map
//! from the mesh to the world as three rows of four; the unit direction to the sun, its irradiance, the sky's radiance and the
//! background's; eye and target in metres and the vertical field of view in radians, in 64 bits. All else is in 32.

use std::path::Path;
use std::process::{Command, Stdio};

use serde::Deserialize;

use super::context::Bench;
use super::land;
use super::made::{Made, Recipe, relief};
use super::points::{Point, compared, shown};
use super::scenes::{Layout, Place};
use crate::format::{self, Limits, Reader};
use crate::geom::{DAffine3, DMat3, DVec3, Vec3};
use crate::progress::Quiet;
use crate::render::metrics::flip::DEFAULT_PPD;
use crate::render::reference::{Reference, SourceMesh, reference as trace};
use crate::render::{CameraChoice, Film, Options, Sky, Stats, image_io};
use crate::scene::copies::to_texel;
use crate::scene::{Model, Part};
use crate::volume::{Pages, Palette};
use crate::{Error, Result, Warnings, par};

/// What a peer says of a picture.
#[derive(Deserialize)]
struct Told {
    build_cpu_seconds: f64,
    trace_cpu_seconds: f64,
    build_seconds: f64,
    trace_seconds: f64,
}

/// Samples a pixel that a peer traces besides the reference.
const SAMPLES: [u32; 6] = [1, 2, 4, 8, 16, 32];
/// The first of them: none that a reference has.
const FIRST: u32 = 1 << 24;
/// Samples of the pictures by which it is seen that a peer traces the same landscape.
const SAME: u32 = 4;

impl Bench<'_> {
    /// Pictures of one, two and four lanes beside those of a tracer of triangles, `program`, whose own picture of many samples
    /// is the reference; and how far that one is from ours where the samples are the same.
    pub fn against(&self, place: &Place, program: &Path) -> Result<Vec<Point>> {
        let source = self.source(place)?;
        let made = self.made(place, &source, Recipe::plain(place.resolution))?;
        let options = self.options(&place.layout, &made)?;
        let file = self.folder.join(format!("{}.triangles", place.name));
        format::save(&file, &landscape(place, &made, &source, &options)?)?;
        let peer = Peer { program, file: &file, options: &options, folder: self.folder };
        let half = self.samples / 2;
        let halves = [0, half].map(|first| peer.picture((first, half.max(1)), "reference").map(|done| done.0));
        let [even, odd] = halves;
        let halves = [even?, odd?];
        let mut film = halves[0].clone();
        for (p, q) in film.pixels.iter_mut().zip(&halves[1].pixels) {
            p.iter_mut().zip(q).for_each(|(a, b)| *a = 0.5 * (*a + b));
        }
        let (stats, warnings) = (Stats::default(), Warnings::default());
        let reference = Reference { film, halves, samples: 2 * half.max(1), stats, warnings, notes: Vec::new() };
        let noise = reference.noise(DEFAULT_PPD)?.all.flip;
        let blank = Point { near: true, noise, ..Point::blank(place) };
        let mut points = Vec::new();
        let ours = trace(&made.scene, &options, 0..SAME, &Quiet)?;
        let (theirs, [seconds, cpu, _]) = peer.picture((0, SAME), "same")?;
        let same = Point { kind: "same", model: "triangles", samples: SAME, ..blank.clone() };
        let same = compared(same, &theirs, &ours, [seconds, cpu])?;
        self.ui.say(&format!(
            "{}: traced by {} and by vtex with the same {SAME} samples: FLIP {:.4} between them, RMSE {:.5}, covered area {:.5}",
            place.name,
            program.display(),
            same.flip,
            same.rmse,
            same.area
        ));
        points.push(same);
        for lanes in [1, 2, 4] {
            points.push(shown(&made, &options, &reference, Point { lanes, ..blank.clone() })?);
        }
        for samples in SAMPLES {
            let (picture, [seconds, cpu, setup_cpu]) = peer.picture((FIRST, samples), "peer")?;
            let point = Point { kind: "peer", model: "triangles", samples, ..blank.clone() };
            points.push(Point { setup_cpu, ..compared(point, &picture, &reference, [seconds, cpu])? });
        }
        Ok(points)
    }
}

struct Peer<'a> {
    program: &'a Path,
    file: &'a Path,
    options: &'a Options,
    folder: &'a Path,
}

impl Peer<'_> {
    /// The picture of so many samples from the first on, and its seconds, CPU seconds, and CPU seconds before the first ray.
    fn picture(&self, (first, samples): (u32, u32), name: &str) -> Result<(Film, [f64; 3])> {
        let out = self.folder.join(format!("{name}.exr"));
        let [width, height] = self.options.size;
        let run = Command::new(self.program)
            .arg(self.file)
            .arg("-o")
            .arg(&out)
            .args(["--size", &format!("{width}x{height}"), "--first", &first.to_string()])
            .args(["--samples", &samples.to_string(), "--threads", &par::threads().to_string()])
            .stderr(Stdio::inherit())
            .output()
            .map_err(|e| Error::io(self.program, e))?;
        let told: Option<Told> = serde_json::from_slice(&run.stdout).ok();
        let Some(told) = told.filter(|_| run.status.success()) else {
            return Err(Error::input(self.program, "", format!("made no picture ({})", run.status)));
        };
        let picture = image_io::read(&out)?;
        let film = Film { width, height, pixels: picture.rgba };
        let cpu = told.build_cpu_seconds + told.trace_cpu_seconds;
        Ok((film, [told.build_seconds + told.trace_seconds, cpu, told.build_cpu_seconds]))
    }
}

/// The landscape as [the file](self) has it.
fn landscape(place: &Place, made: &Made, source: &Path, options: &Options) -> Result<Vec<u8>> {
    let unknown = |what: &str| Error::Options(format!("{}: {what}", place.name));
    let texel = made.scene.texels.first().and_then(|t| t.frames.first()).ok_or_else(|| unknown("names no texel"))?;
    let info = Reader::open(texel, &Limits::default())?.info().clone();
    let source = SourceMesh::open(source, &info, (&Palette::default(), None), &mut Warnings::default())?;
    let mut out = Out(b"VTEXTRI1".to_vec());
    let plain: Vec<usize> = (0..made.scene.model.instances.len()).filter(|&i| is_plain(&made.scene.model, i)).collect();
    out.count(1 + plain.len());
    out.mesh(&source.model, 0..source.model.instances.len());
    plain.iter().for_each(|&i| out.mesh(&made.scene.model, i..i + 1));
    let copies = copies(place, made, to_texel(&info).inverse()).ok_or_else(|| unknown("is no landscape of stands"))?;
    out.count(copies.len() + plain.len());
    copies.iter().for_each(|map| out.copy(0, map));
    (1..=plain.len()).for_each(|mesh| out.copy(mesh, &DAffine3::IDENTITY));
    let sun = made.scene.model.lights.first().ok_or_else(|| unknown("has no sun"))?;
    out.vector(sun.to_world.matrix3.z_axis.normalize());
    out.vector(DVec3::from_array(sun.intensity));
    let Some(Sky::Constant(sky)) = options.sky else { return Err(unknown("has no constant sky")) };
    out.vector(DVec3::from_array(sky));
    out.vector(DVec3::from_array(options.background.unwrap_or(sky)));
    let CameraChoice::LookAt { eye, target, yfov } = options.camera else { return Err(unknown("has no camera")) };
    for value in [eye.to_array(), target.to_array()].concat().into_iter().chain([yfov]) {
        out.0.extend(value.to_le_bytes());
    }
    Ok(out.0)
}

/// Whether an instance is seen as it is.
fn is_plain(model: &Model, i: usize) -> bool {
    let part = model.instances.get(i).and_then(|instance| model.parts.get(instance.part));
    part.and_then(|part| model.materials.get(part.material)).is_some_and(|material| material.shell.is_none())
}

/// The maps from the texel's cube to the world; `own`: from there to a copy's own space.
fn copies(place: &Place, made: &Made, own: DAffine3) -> Option<Vec<DAffine3>> {
    let Layout::Stands { side, rigid, hilly, .. } = place.layout else { return None };
    if rigid {
        let sets = made.scene.copies.iter();
        return Some(sets.flat_map(|set| (0..set.len()).map(move |i| set.to_world * set.local(i) * own)).collect());
    }
    let maps = land::all_stands(side, relief(hilly)).map(|stand| {
        let [along, across, up] = stand.edges;
        let translation = stand.foot - 0.5 * (along + across);
        DAffine3 { matrix3: DMat3::from_cols(along, across, up), translation }
    });
    Some(maps.collect())
}

struct Out(Vec<u8>);

impl Out {
    fn count(&mut self, n: usize) {
        self.0.extend((n as u32).to_le_bytes());
    }

    fn vector(&mut self, v: DVec3) {
        self.0.extend(v.as_vec3().to_array().into_iter().flat_map(f32::to_le_bytes));
    }

    fn copy(&mut self, mesh: usize, map: &DAffine3) {
        self.count(mesh);
        let (m, t) = (map.matrix3.transpose(), map.translation);
        for row in [m.x_axis.extend(t.x), m.y_axis.extend(t.y), m.z_axis.extend(t.z)] {
            self.0.extend(row.as_vec4().to_array().into_iter().flat_map(f32::to_le_bytes));
        }
    }

    /// Instances of a model, placed, as one mesh. What is lit alike on both sides and has no texture is all that a bench has.
    fn mesh(&mut self, model: &Model, instances: std::ops::Range<usize>) {
        let parts: Vec<(&Part, DAffine3)> = model.instances[instances]
            .iter()
            .filter_map(|instance| Some((model.parts.get(instance.part)?, instance.transform)))
            .collect();
        let has_normals = parts.iter().all(|(part, _)| part.normals.is_some());
        let vertices: usize = parts.iter().map(|(part, _)| part.positions.len()).sum();
        self.count(vertices);
        self.count(if has_normals { vertices } else { 0 });
        self.count(parts.iter().map(|(part, _)| part.triangles.len()).sum());
        let wide = |v: &[f32; 3]| DVec3::from_array(v.map(f64::from));
        for (part, transform) in &parts {
            part.positions.iter().for_each(|p| self.vector(transform.transform_point3(wide(p))));
        }
        for (part, transform) in parts.iter().filter(|_| has_normals) {
            let turn = transform.matrix3.inverse().transpose();
            part.normals.iter().flatten().for_each(|n| self.vector((turn * wide(n)).normalize_or_zero()));
        }
        for (part, _) in &parts {
            let [r, g, b, _] = model.materials.get(part.material).map_or([1.0; 4], |m| m.base_color);
            for i in 0..part.positions.len() {
                let [s, t, u, _] = part.colors.as_ref().and_then(|c| c.get(i)).copied().unwrap_or([1.0; 4]);
                self.vector(Vec3::new(r * s, g * t, b * u).as_dvec3());
            }
        }
        let mut base = 0;
        for (part, _) in &parts {
            part.triangles.iter().flatten().for_each(|v| self.count((base + v) as usize));
            base += part.positions.len() as u32;
        }
    }
}

#[cfg(unix)]
#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;
    use crate::cli::Ui;
    use crate::cli::bench::scenes::Matter;

    fn place(rigid: bool) -> Place {
        let (eye, target) = ([0.0, 8.0, 25.0], [0.0, 4.0, 0.0]);
        Place {
            name: "four",
            about: "four trees",
            matter: Matter::Sample("fern.glb"),
            layout: Layout::Stands { side: 2, rigid, hilly: false, eye, target },
            resolution: 8,
            quick: true,
            on_request: true,
        }
    }

    #[test]
    fn a_peer_gets_the_landscape_and_its_pictures_are_compared() {
        let dir = tempfile::tempdir().unwrap();
        let ui = Ui::silent();
        let bench = Bench { folder: dir.path(), size: [16, 9], samples: 2, quick: true, ui: &ui };
        // A peer that sees a grey wall.
        let film = Film { width: 16, height: 9, pixels: vec![[0.5, 0.5, 0.5, 1.0]; 16 * 9] };
        film.save(&dir.path().join("wall.exr")).unwrap();
        let program = dir.path().join("peer");
        let told = r#"{"build_cpu_seconds": 1, "build_seconds": 1, "trace_cpu_seconds": 2, "trace_seconds": 2}"#;
        std::fs::write(&program, format!("#!/bin/sh\ncp \"$(dirname \"$1\")/wall.exr\" \"$3\"\necho '{told}'\n"))
            .unwrap();
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
        for rigid in [false, true] {
            let points = bench.against(&place(rigid), &program).unwrap();
            let kinds = |kind: &str| points.iter().filter(|p| p.kind == kind).count();
            assert_eq!([kinds("same"), kinds("render"), kinds("peer")], [1, 3, SAMPLES.len()]);
            // Against the same wall, and against what is really there.
            assert!(points.iter().filter(|p| p.kind == "peer").all(|p| p.flip == 0.0 && p.time() == 3.0));
            assert!(points.iter().filter(|p| p.kind != "peer").all(|p| p.flip > 0.01));
            check(&std::fs::read(dir.path().join("four.triangles")).unwrap());
        }
        std::fs::write(&program, "#!/bin/sh\nexit 3\n").unwrap();
        let failed = bench.against(&place(false), &program).map(|_| ()).unwrap_err();
        assert!(failed.to_string().contains("made no picture"), "{failed}");
    }

    /// Two meshes, four copies of the first and one of the second, and nothing after the camera.
    fn check(bytes: &[u8]) {
        assert_eq!(&bytes[..8], b"VTEXTRI1");
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let real = |at: usize| f32::from_bits(word(at));
        assert_eq!(word(8), 2);
        let (mut at, mut boxes) = (12, Vec::new());
        for _ in 0..2 {
            let [vertices, normals, triangles] = [0, 4, 8].map(|k| word(at + k) as usize);
            at += 12;
            let y: Vec<f32> = (0..vertices).map(|i| real(at + 12 * i + 8)).collect();
            boxes.push(y.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v))));
            at += 12 * (2 * vertices + normals);
            assert!((0..3 * triangles).all(|i| (word(at + 4 * i) as usize) < vertices));
            at += 12 * triangles;
        }
        // The first is in the texel's cube.
        assert!(boxes[0].0 >= -1e-6 && boxes[0].1 <= 1.0 + 1e-6, "{boxes:?}");
        assert_eq!(word(at), 5);
        at += 4;
        for i in 0..5 {
            assert_eq!(word(at), u32::from(i == 4));
            // Upright: w is up, and its edge between .8 and 1.2 of the stands' width; the ground is where it is.
            let up = real(at + 4 + 4 * 6);
            assert!(if i == 4 { up == 0.0 } else { (8.0..14.0).contains(&up) }, "{up}");
            at += 52;
        }
        assert_eq!(bytes.len(), at + 12 * 4 + 7 * 8);
    }
}

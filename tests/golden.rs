//! One small picture a feature of the renderer, against pictures kept in tests/golden. `VTEX_BLESS=1` stores new ones: look at
//! them before they are committed.

use std::path::Path;
use std::sync::Arc;

use vtex::geom::{Aabb, DAffine3, DVec3};
use vtex::morton;
use vtex::progress::Quiet;
use vtex::render::{Ambient, CameraChoice, Options, render_with};
use vtex::scene::phong::Phong;
use vtex::scene::shell::{
    CellWrap, Continuous, Discrete, Environment, Layer, Orientations, ShellMaterial, TexelRef, Variant,
};
use vtex::scene::wind::Wind;
use vtex::scene::{
    Alpha, Instance, Light, LightKind, Material, Model, Part, ReadOptions, Scene, Texture, TextureRef, gltf,
};
use vtex::volume::palette::Restyled;
use vtex::volume::{Depth, Info, Octree, Palette, Sggx, Style, Volume, Voxel, voxel};

const SIDE: u32 = 64;

/// A texel in which no two turns look alike: a red ball on a trunk, with a blue arm along +u and a yellow one along +v.
fn figure() -> Octree {
    const FINEST: usize = 5;
    let colour = |p: DVec3| {
        let from = |x, y, z| p - DVec3::new(x, y, z);
        let ball = from(0.5, 0.5, 0.6).length() < 0.24;
        let trunk = from(0.5, 0.5, p.z).length() < 0.07 && p.z < 0.5;
        let arm = |a: DVec3| a.x > 0.0 && a.x < 0.42 && a.y.abs() < 0.06 && a.z.abs() < 0.06;
        let (along_u, along_v) = (from(0.5, 0.5, 0.25), from(0.5, 0.5, 0.6));
        let yellow = arm(DVec3::new(along_v.y, along_v.x, along_v.z));
        match (ball, yellow, arm(along_u), trunk) {
            (true, ..) => Some([0.7, 0.12, 0.08]),
            (_, true, ..) => Some([0.7, 0.6, 0.1]),
            (_, _, true, _) => Some([0.1, 0.2, 0.7]),
            (.., true) => Some([0.3, 0.2, 0.1]),
            _ => None,
        }
    };
    // (code, sum of colours, voxels of the finest depth below it)
    let mut nodes: Vec<(u64, DVec3, f64)> = (0..1u64 << (3 * FINEST))
        .filter_map(|code| {
            let p = morton::decode(code).map(|k| (f64::from(k) + 0.5) / f64::from(1u32 << FINEST));
            Some((code, DVec3::from_array(colour(DVec3::from_array(p))?), 1.0))
        })
        .collect();
    let mut depths = vec![Depth::default(); FINEST + 1];
    depths[FINEST].masks = vec![0; nodes.len()];
    for depth in (0..=FINEST).rev() {
        let edge = f64::from(1u32 << (FINEST - depth));
        let voxel = |&(_, rgb, n): &(u64, DVec3, f64)| {
            let rate = voxel::encode_rate(2.0 * n / (edge * edge));
            let mut voxel = Voxel { rate, ndf: Sggx::ISOTROPIC.encode(), ..Voxel::default() };
            voxel.set_albedo((rgb / n).to_array());
            voxel
        };
        depths[depth].voxels = nodes.iter().map(voxel).collect();
        if depth > 0 {
            let mut parents: Vec<(u64, DVec3, f64)> = Vec::new();
            for &(code, rgb, n) in &nodes {
                let bit = 1u8 << (code & 7);
                match parents.last_mut() {
                    Some(last) if last.0 == code >> 3 => {
                        (last.1, last.2) = (last.1 + rgb, last.2 + n);
                        *depths[depth - 1].masks.last_mut().unwrap() |= bit;
                    }
                    _ => {
                        parents.push((code >> 3, rgb, n));
                        depths[depth - 1].masks.push(bit);
                    }
                }
            }
            nodes = parents;
        }
    }
    let info = Info {
        content: Aabb::new(DVec3::new(0.25, 0.25, 0.0), DVec3::new(0.9375, 0.9375, 0.875)),
        facet_size: 0.05,
        ..Info::default()
    };
    Octree::new(Volume { info, depths }).unwrap()
}

fn shell(thickness: f64, layer: Layer) -> Material {
    let layers = vec![layer];
    let shell = ShellMaterial { thickness, layers, ..ShellMaterial::default() };
    Material { base_color: [0.3, 0.35, 0.3, 1.0], shell: Some(Arc::new(shell)), ..Default::default() }
}

fn plain(base_color: [f32; 4]) -> Material {
    Material { base_color, ..Default::default() }
}

/// A sheet of `n`^2 tiles over (s, t) in the unit square, with `repeat` copies along each side.
fn sheet(n: u32, repeat: f32, material: usize, at: impl Fn(f64, f64) -> DVec3) -> Part {
    let mut part = Part { uvs: vec![vec![]], material, ..Default::default() };
    for k in 0..(n + 1) * (n + 1) {
        let [s, t] = [k % (n + 1), k / (n + 1)].map(|i| f64::from(i) / f64::from(n));
        part.positions.push(at(s, t).as_vec3().to_array());
        part.uvs[0].push([s as f32 * repeat, t as f32 * repeat]);
        if k % (n + 1) < n && k / (n + 1) < n {
            part.triangles.extend([[k, k + 1, k + n + 1], [k + 1, k + n + 2, k + n + 1]]);
        }
    }
    part
}

/// A level square of side 2 `half` that faces up.
fn square(half: f64, repeat: f32, material: usize) -> Part {
    sheet(1, repeat, material, |s, t| DVec3::new(half * (2.0 * s - 1.0), 0.0, half * (1.0 - 2.0 * t)))
}

fn up(y: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::Y * y)
}

fn light(kind: LightKind, at: DVec3, to: DVec3, intensity: f64) -> Light {
    let turn = glam::DQuat::from_rotation_arc(DVec3::Z, (at - to).normalize());
    let to_world = DAffine3::from_rotation_translation(turn, at);
    Light { name: String::new(), to_world, intensity: [intensity; 3], kind, range: f64::INFINITY }
}

fn sun() -> Light {
    light(LightKind::Directional, DVec3::new(-0.6, 1.0, 0.5), DVec3::ZERO, 3.0)
}

/// Render the parts, placed, and compare with the picture of that name.
fn golden(name: &str, parts: Vec<(Part, DAffine3)>, materials: Vec<Material>, lights: Vec<Light>, options: Options) {
    golden_of(figure(), name, parts, materials, lights, options);
}

/// [`golden`] with another texel.
fn golden_of(
    texel: Octree,
    name: &str,
    parts: Vec<(Part, DAffine3)>,
    materials: Vec<Material>,
    lights: Vec<Light>,
    options: Options,
) {
    let (parts, places): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
    let place = |(part, transform)| Instance { part, transform, node: String::new() };
    let instances = places.into_iter().enumerate().map(place).collect();
    let model = Model { parts, materials, instances, lights, metres_per_unit: 1.0, ..Default::default() };
    let texels = vec![TexelRef { name: "figure".into(), frames: vec![], ..TexelRef::default() }];
    let environment = Environment { sky: Some([0.3, 0.35, 0.4].into()), background: None, ..Default::default() };
    let done =
        render_with(&Scene { model, texels, copies: Vec::new(), environment }, vec![Some(texel)], &options, &Quiet)
            .unwrap();
    assert!(done.warnings.is_empty(), "{:?}", done.warnings);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(format!("{name}.png"));
    if std::env::var_os("VTEX_BLESS").is_some() {
        return done.film.save(&path).unwrap();
    }
    let dir = tempfile::tempdir().unwrap();
    done.film.save(&dir.path().join("new.png")).unwrap();
    let new = image::open(dir.path().join("new.png")).unwrap().to_rgb8();
    let old = image::open(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display())).to_rgb8();
    assert_eq!(new.dimensions(), old.dimensions());
    let off: Vec<u8> = new.iter().zip(old.iter()).map(|(a, b)| a.abs_diff(*b)).collect();
    let mean = off.iter().map(|&d| f64::from(d)).sum::<f64>() / off.len() as f64;
    let wrong = off.iter().filter(|&&d| d > 2).count();
    // The arithmetic is the same everywhere but for exp() of the platform, a last bit: at most that a code rounds to its
    // neighbour, and a ray that touches a voxel's edge falls on its other side.
    if mean > 0.05 || wrong > off.len() / 200 {
        let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.png"));
        done.film.save(&kept).unwrap();
        panic!("{name}: mean difference {mean:.3} codes, {wrong} codes off by more than 2: see {}", kept.display());
    }
}

fn looking(eye: [f64; 3], target: [f64; 3]) -> Options {
    let (eye, target) = (DVec3::from_array(eye), DVec3::from_array(target));
    Options { size: [SIDE; 2], camera: CameraChoice::LookAt { eye, target, yfov: 0.7 }, ..Options::measuring() }
}

#[test]
fn a_ball_is_overgrown() {
    let ball = sheet(16, 8.0, 0, |s, t| {
        let (a, b) = (std::f64::consts::TAU * s, std::f64::consts::PI * (0.1 + 0.8 * t));
        DVec3::new(b.sin() * a.cos(), -b.cos(), -b.sin() * a.sin())
    });
    let options = looking([1.5, 2.0, 4.0], [0.0; 3]);
    golden("ball", vec![(ball, DAffine3::IDENTITY)], vec![shell(0.4, Layer::default())], vec![sun()], options);
}

#[test]
fn copies_repeat_and_are_mirrored() {
    let wrap = [CellWrap::Mirror, CellWrap::Repeat, CellWrap::Empty];
    let options = looking([0.6, 4.0, 4.0], [0.0; 3]);
    let ground = vec![(square(1.5, 3.0, 0), DAffine3::IDENTITY)];
    golden("mirror", ground, vec![shell(0.8, Layer { wrap, ..Layer::default() })], vec![sun()], options);
}

#[test]
fn copies_vary() {
    let discrete = Discrete {
        seed: 3,
        orientations: Orientations::W8,
        scale: [0.5, 1.0],
        displace: [0.2, 0.2, 0.0],
        presence: 0.8,
        ..Discrete::default()
    };
    let options = looking([0.6, 4.0, 4.0], [0.0; 3]);
    let ground = vec![(square(1.5, 4.0, 0), DAffine3::IDENTITY)];
    golden(
        "vary",
        ground,
        vec![shell(0.7, Layer { discrete: Some(discrete), ..Layer::default() })],
        vec![sun()],
        options,
    );
}

#[test]
fn copies_reach_over_their_cells() {
    let discrete = Discrete {
        seed: 6,
        scale: [0.8, 1.0],
        displace: [0.6, 0.6, 0.0],
        tint: vec![[1.0; 3], [0.3, 0.3, 1.0]],
        ..Discrete::default()
    };
    let layer = Layer { discrete: Some(discrete), ..Layer::default() };
    let options = looking([0.6, 4.0, 4.0], [0.0; 3]);
    golden("reach", vec![(square(1.5, 4.0, 0), DAffine3::IDENTITY)], vec![shell(0.7, layer)], vec![sun()], options);
}

#[test]
fn copies_turn_any_way() {
    let orientations = Orientations::Cube48;
    let discrete = Discrete { seed: 2, orientations, mirror: [true; 3], ..Discrete::default() };
    let layer = Layer { discrete: Some(discrete), ..Layer::default() };
    let options = looking([0.6, 4.0, 4.0], [0.0; 3]);
    golden("cube", vec![(square(1.5, 3.0, 0), DAffine3::IDENTITY)], vec![shell(0.9, layer)], vec![sun()], options);
}

fn noise() -> Continuous {
    Continuous {
        seed: 4,
        frequency: [0.4, 0.4, 0.4],
        octaves: 2,
        uvw_amplitude: [0.4, 0.4, 0.0],
        height_tilt: 0.8,
        height_scale: 0.7,
    }
}

#[test]
fn noise_bends_copies() {
    let layer = Layer { continuous: Some(noise()), ..Layer::default() };
    let options = looking([0.6, 4.0, 4.0], [0.0; 3]);
    golden("bent", vec![(square(1.5, 5.0, 0), DAffine3::IDENTITY)], vec![shell(0.6, layer)], vec![sun()], options);
}

/// Each triangle cut into four, by the middles of its edges.
fn cut_finer(part: &Part) -> Part {
    let mut fine = Part { uvs: vec![vec![]], heights: Some(vec![]), jitter: Some(vec![]), ..part.clone() };
    (fine.positions, fine.triangles) = (vec![], vec![]);
    let (heights, jitter) = (part.heights.as_ref().unwrap(), part.jitter.as_ref().unwrap());
    for t in &part.triangles {
        let [a, b, c] = t.map(|v| v as usize);
        let first = fine.positions.len() as u32;
        for [i, j] in [[a, a], [b, b], [c, c], [a, b], [b, c], [c, a]] {
            fn middle<const N: usize>(of: &[[f32; N]], [i, j]: [usize; 2]) -> [f32; N] {
                std::array::from_fn(|k| 0.5 * (of[i][k] + of[j][k]))
            }
            fine.positions.push(middle(&part.positions, [i, j]));
            fine.uvs[0].push(middle(&part.uvs[0], [i, j]));
            fine.heights.as_mut().unwrap().push(middle(heights, [i, j]));
            fine.jitter.as_mut().unwrap().push(0.5 * (jitter[i] + jitter[j]));
        }
        fine.triangles.extend([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]].map(|t| t.map(|k| first + k)));
    }
    fine
}

/// What noise bends looks the same however finely the mesh is cut: a hill, and the same with 16 times the faces.
#[test]
fn bent_copies_do_not_depend_on_the_faces() {
    let mut hill =
        sheet(4, 6.0, 0, |s, t| DVec3::new(3.0 * s - 1.5, 0.6 * (3.1 * s).sin() * (2.0 * t).cos(), 1.5 - 3.0 * t));
    hill.heights = Some(hill.positions.iter().map(|[x, _, z]| [0.1 * x, 0.6, 0.1 * z]).collect());
    hill.jitter = Some(hill.positions.iter().map(|[x, ..]| 0.5 + 0.3 * x).collect());
    let fine = cut_finer(&cut_finer(&hill));
    assert_eq!(fine.triangles.len(), 16 * hill.triangles.len());
    let picture = |part: Part| {
        let layer = Layer { continuous: Some(noise()), ..Layer::default() };
        let instances = vec![Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() }];
        let (parts, materials) = (vec![part], vec![shell(0.6, layer)]);
        let model =
            Model { parts, materials, instances, lights: vec![sun()], metres_per_unit: 1.0, ..Model::default() };
        let texels = vec![TexelRef { name: "figure".into(), ..TexelRef::default() }];
        let environment = Environment { sky: Some([0.3, 0.35, 0.4].into()), ..Default::default() };
        let scene = Scene { model, texels, copies: Vec::new(), environment };
        let options = Options { size: [160, 120], ..looking([0.6, 3.0, 4.0], [0.0; 3]) };
        render_with(&scene, vec![Some(figure())], &options, &Quiet).unwrap().film.image()
    };
    let (coarse, fine) = (picture(hill), picture(fine));
    let map = vtex::render::metrics::compare(&coarse, &fine, &Default::default()).unwrap().flip_map;
    let flip = map.iter().sum::<f32>() / map.len() as f32;
    // A change of what is seen, as by noise that is taken at vertices, gives tenths. The aim is 0.01 in a landscape, where a meadow
    // has 0.0075 and a fern 0.0053, with noise or without; this picture has 0.0135.
    assert!(flip <= 0.015, "{flip}");
}

#[test]
fn a_shell_bends_and_twists() {
    let mut part = sheet(4, 4.0, 0, |s, t| DVec3::new(3.0 * s - 1.5, (3.1 * s).sin() * 0.6, 1.5 - 3.0 * t));
    let lean = |[x, _, z]: &[f32; 3]| [0.3 * x, 0.8 + 0.2 * z, 0.2 * x * z];
    part.heights = Some(part.positions.iter().map(lean).collect());
    let options = looking([1.0, 3.0, 4.0], [0.0, 0.5, 0.0]);
    golden("twist", vec![(part, DAffine3::IDENTITY)], vec![shell(0.8, Layer::default())], vec![sun()], options);
}

#[test]
fn shadows_fall_between_meshes_and_texels() {
    let plate = sheet(1, 1.0, 1, |s, t| DVec3::new(s - 2.3, 1.6, 0.9 - t));
    let materials = vec![shell(0.9, Layer::default()), plain([0.6, 0.6, 0.6, 1.0])];
    let parts = vec![(square(1.5, 3.0, 0), up(0.02)), (square(4.0, 1.0, 1), up(0.0)), (plate, up(0.0))];
    golden("shadows", parts, materials, vec![sun()], looking([1.0, 4.0, 5.0], [0.0, 0.2, 0.0]));
}

#[test]
fn boxes_overlap() {
    let mut leaning = square(1.2, 2.0, 1);
    leaning.heights = Some(vec![[0.7, 0.9, 0.0]; 4]);
    let blue = Layer { phong: Phong::tint([0.4, 0.7, 1.0]), ..Layer::default() };
    let parts = vec![(square(1.2, 2.0, 0), up(0.0)), (leaning, up(0.15))];
    let materials = vec![shell(1.0, Layer::default()), shell(1.0, blue)];
    golden("overlap", parts, materials, vec![sun()], looking([1.0, 3.0, 4.0], [0.2, 0.4, 0.0]));
}

#[test]
fn masked_cards_stand_before_texels() {
    let texels = (0..64).map(|i| [90, 160, 60, if (i % 8 + i / 8) % 3 == 0 { 0 } else { 255 }]).collect();
    let mut texture = Texture::new("holes", 8, 8, texels);
    texture.nearest = true;
    let transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let card = Material {
        texture: Some(TextureRef { texture: Arc::new(texture), tex_coord: 0, transform }),
        alpha: Alpha::Mask(0.5),
        double_sided: true,
        ..Default::default()
    };
    let upright = sheet(1, 1.0, 1, |s, t| DVec3::new(1.6 * s - 0.8, 1.6 * t, 1.8));
    let parts = vec![(square(1.5, 2.0, 0), up(0.0)), (upright, up(0.0))];
    golden(
        "mask",
        parts,
        vec![shell(1.2, Layer::default()), card],
        vec![sun()],
        looking([0.8, 1.6, 5.0], [0.0, 0.6, 0.0]),
    );
}

#[test]
fn lamps_and_spots() {
    let above = DVec3::new(0.8, 1.6, 0.4);
    let spot = LightKind::Spot { inner: 0.3, outer: 0.5 };
    let aside = DVec3::new(-2.0, 3.0, 1.0);
    let lights =
        vec![light(LightKind::Point, above, DVec3::ZERO, 2.0), light(spot, aside, DVec3::new(-0.6, 0.0, 0.0), 30.0)];
    let options = Options { sky: Some([0.02; 3].into()), ..looking([0.0, 4.0, 4.0], [0.0; 3]) };
    golden("lamps", vec![(square(2.0, 3.0, 0), up(0.0))], vec![shell(0.8, Layer::default())], lights, options);
}

#[test]
fn the_sky_is_hidden_by_matter() {
    let dark = light(LightKind::Directional, DVec3::Y, DVec3::ZERO, 0.0);
    let options = Options {
        ambient: Ambient::Occluded,
        sky: Some([1.0; 3].into()),
        background: Some([0.2; 3]),
        ..looking([0.6, 3.0, 4.0], [0.0, 0.2, 0.0])
    };
    golden("occluded", vec![(square(1.2, 3.0, 0), up(0.0))], vec![shell(0.8, Layer::default())], vec![dark], options);
}

#[test]
fn a_camera_stands_in_the_shell() {
    let options = looking([0.05, 0.35, 1.02], [-0.3, 0.45, -3.0]);
    golden("inside", vec![(square(4.0, 8.0, 0), up(0.0))], vec![shell(1.0, Layer::default())], vec![sun()], options);
}

/// The sample tree, its leaves red and its bark darker, in a row of variants of which each is tinted.
#[test]
fn restyled() {
    let sample = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/tree.glb");
    let model = vtex::scene::gltf::read(Path::new(sample), &Default::default()).unwrap().model;
    let source = vtex::source::MeshSource::new(model, &Default::default());
    let baking = vtex::bake::Options { resolution: 64, ..Default::default() };
    let tree = vtex::bake::bake(&source, &baking, &Quiet, &mut |_| ()).unwrap().0;
    let tree = super::readable::readable(tree);
    let style = |name: &str, factor, keep| (name.to_owned(), Style { factor, keeps_albedo: keep, ..Style::UNCHANGED });
    let styles = [style("leaf", [0.7, 0.15, 0.03], false), style("bark", [0.4, 0.5, 0.8], true)].into();
    let tree = Octree::new(Restyled::new(tree, &Palette { styles, ..Palette::default() })).unwrap();
    let variant = |weight, diffuse| Variant { weight, phong: Phong::tint(diffuse), ..Variant::alone(0) };
    let discrete = Discrete {
        seed: 4,
        orientations: Orientations::W8,
        scale: [0.8, 1.0],
        displace: [0.0; 3],
        presence: 1.0,
        variants: vec![variant(1.0, [1.0; 3]), variant(1.0, [1.0, 2.5, 1.0]), variant(1.0, [0.4, 2.0, 1.0])],
        ..Discrete::default()
    };
    let layer = Layer { discrete: Some(discrete), ..Layer::default() };
    let ground = vec![(square(1.0, 3.0, 0), DAffine3::IDENTITY)];
    let options = looking([0.6, 1.0, 2.4], [0.0, 0.2, 0.1]);
    golden_of(tree, "restyled", ground, vec![shell(0.66, layer)], vec![sun()], options);
}

/// A lawn in the wind at two times: gusts have gone 1.2 m to the right.
#[test]
fn wind_bends_what_grows() {
    let wind = Wind { direction: DVec3::X, strength: 0.4, gust_scale: 3.0, speed: 1.5, seed: 5 };
    for (name, time) in [("wind-0", 0.0), ("wind-1", 0.8)] {
        let grown = Material { wind: Some(wind.at(time)), ..shell(0.5, Layer::default()) };
        let lawn = sheet(12, 8.0, 0, |s, t| DVec3::new(2.0 * s - 1.0, 0.0, 1.0 - 2.0 * t));
        let options = looking([0.0, 1.1, 2.4], [0.0, 0.15, 0.1]);
        golden(name, vec![(lawn, DAffine3::IDENTITY)], vec![grown], vec![sun()], options);
    }
}

/// A card on two bones, the upper of which has turned by a quarter half-way through its animation; its shell follows.
#[test]
fn a_shell_on_bones_is_posed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pose.gltf");
    std::fs::write(&path, bones().to_string()).unwrap();
    let read = ReadOptions { time: Some(1.0), ..ReadOptions::default() };
    let model = gltf::read(&path, &read).unwrap().model;
    let parts = model.instances.iter().map(|i| (model.parts[i.part].clone(), i.transform)).collect();
    let options = looking([-1.2, 1.4, 3.4], [-0.3, 0.9, 0.0]);
    golden("pose", parts, vec![shell(0.3, Layer::default())], vec![sun()], options);
}

/// A strip of 8 tiles, 0.6 m wide and 2 m high, whose upper half bends to the left within two seconds.
fn bones() -> serde_json::Value {
    use base64::Engine;
    use serde_json::json;
    let (mut bin, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    let mut add = |kind: &str, component: u32, count: usize, bytes: Vec<u8>| {
        views.push(json!({"buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len()}));
        accessors
            .push(json!({"bufferView": views.len() - 1, "componentType": component, "type": kind, "count": count}));
        bin.extend(bytes);
        accessors.len() - 1
    };
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let rows: Vec<f32> = (0..9).map(|i| i as f32 / 8.0).collect();
    let each = |f: &dyn Fn(f32, f32) -> Vec<f32>| {
        rows.iter().flat_map(|&t| [f(0.0, t), f(1.0, t)]).flatten().collect::<Vec<_>>()
    };
    let positions = add("VEC3", 5126, 18, floats(&each(&|s, t| vec![0.6 * s - 0.3, 2.0 * t, 0.0])));
    let uvs = add("VEC2", 5126, 18, floats(&each(&|s, t| vec![2.0 * s, 6.0 * t])));
    let heights = add("VEC3", 5126, 18, floats(&each(&|_, _| vec![0.0, 0.0, 0.3])));
    let bent = |t: f32| ((t - 0.25) * 2.0).clamp(0.0, 1.0);
    let weights = add("VEC4", 5126, 18, floats(&each(&|_, t| vec![1.0 - bent(t), bent(t), 0.0, 0.0])));
    let joints = add("VEC4", 5121, 18, [0u8, 1, 0, 0].repeat(18));
    let faces: Vec<u16> = (0..8u16).flat_map(|i| [0, 1, 2, 1, 3, 2].map(|k| 2 * i + k)).collect();
    let indices = add("SCALAR", 5123, 48, faces.iter().flat_map(|v| v.to_le_bytes()).collect());
    let shift = |y: f32| [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., y, 0., 1.];
    let binds = add("MAT4", 5126, 2, floats(&[shift(0.0), shift(-1.0)].concat()));
    let times = add("SCALAR", 5126, 2, floats(&[0.0, 2.0]));
    // Half a turn, of which half is done at 1 s.
    let turns = add("VEC4", 5126, 2, floats(&[0., 0., 0., 1., 0., 0., 1., 0.]));
    let data = base64::engine::general_purpose::STANDARD.encode(&bin);
    json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "skin": 0}, {"children": [2]}, {"translation": [0, 1, 0]}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": binds}],
        "meshes": [{"primitives": [{"indices": indices, "attributes": {"POSITION": positions, "TEXCOORD_0": uvs,
            "_VTEX_HEIGHT": heights, "JOINTS_0": joints, "WEIGHTS_0": weights}}]}],
        "animations": [{"channels": [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}],
            "samplers": [{"input": times, "output": turns}]}],
        "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": bin.len(), "uri": format!("data:application/octet-stream;base64,{data}")}],
    })
}

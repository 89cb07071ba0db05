//! Phong's parameters of layers: highlights of voxels against formula and facets, images and noise, the commands.

use std::path::Path;
use std::sync::Arc;

use vtex::bake::{self, Options};
use vtex::geom::{DAffine3, DVec3, Vec3};
use vtex::noise::Noise;
use vtex::progress::Quiet;
use vtex::render::reference::{SourceMesh, reference_with};
use vtex::render::{CameraChoice, Film, Options as RenderOptions, render_with};
use vtex::scene::phong::{NoiseSpace, Phong, PhongNoise, Variation};
use vtex::scene::shell::{Environment, Layer, ShellMaterial, TexelRef};
use vtex::scene::{Instance, Light, LightKind, Material, Model, Part, Scene, Texture, TextureRef};
use vtex::source::{Fill, MeshOptions, MeshSource};
use vtex::volume::palette::Restyled;
use vtex::volume::{Finish, Octree, Palette, Style, Volume};

const SUN: f64 = 3.0;

fn instance(part: usize) -> Instance {
    Instance { part, transform: DAffine3::IDENTITY, node: String::new() }
}

/// A square of 2 m on the ground.
fn square() -> Part {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0f32]];
    Part {
        positions: corners.map(|[x, z]| [x, 0.0, z]).to_vec(),
        normals: Some(vec![[0.0, 1.0, 0.0]; 4]),
        uvs: vec![corners.map(|[x, z]| [0.5 * (x + 1.0), 0.5 * (1.0 - z)]).to_vec()],
        triangles: vec![[0, 3, 1], [1, 3, 2]],
        ..Part::default()
    }
}

/// A level sheet of 2 m, halfway up in a cube of 2 m; specks beside the picture hold its floor and ceiling.
fn sheet() -> Model {
    let mut model = leaves(1, 0.999, || DVec3::Y);
    let part = &mut model.parts[0];
    part.positions.iter_mut().for_each(|p| p[1] = 1.06);
    for y in [0.0, 2.0] {
        let base = part.positions.len() as u32;
        part.positions.extend([[0.9, y, 0.9], [0.9, y, 0.901], [0.901, y, 0.9]]);
        part.triangles.push([base, base + 1, base + 2]);
    }
    model
}

/// Leaves of the normals `normal(i)` in a cube of 2 m that stands on the ground; every second one of a second material.
fn leaves(count: usize, half: f64, mut normal: impl FnMut() -> DVec3) -> Model {
    let mut place = vtex::random::SplitMix64::new(11);
    let mut parts = [0, 1].map(|material| Part { material, ..Part::default() });
    for i in 0..count {
        let mut within = || (2.0 - 2.0 * half) * place.unit() + half;
        let centre = DVec3::new(within() - 1.0, within(), within() - 1.0);
        let (a, b) = normal().any_orthonormal_pair();
        let part = &mut parts[i % 2];
        let base = part.positions.len() as u32;
        for (x, y) in [(-half, -half), (half, -half), (half, half), (-half, half)] {
            part.positions.push((centre + x * a + y * b).as_vec3().to_array());
        }
        part.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    }
    let material = |name: &str| Material {
        name: name.into(),
        base_color: [0.5, 0.5, 0.5, 1.0],
        double_sided: true,
        ..Material::default()
    };
    let parts: Vec<Part> = parts.into_iter().filter(|p| !p.triangles.is_empty()).collect();
    Model {
        instances: (0..parts.len()).map(instance).collect(),
        parts,
        materials: vec![material("leaf"), material("bark")],
        metres_per_unit: 1.0,
        ..Model::default()
    }
}

fn baked(model: Model, resolution: u32) -> Volume {
    let source = MeshSource::new(model, &MeshOptions { fill: Fill::Surface });
    let options = Options { resolution, ..Options::default() };
    super::readable::readable(bake::bake(&source, &options, &Quiet, &mut |_| ()).unwrap().0)
}

/// A landscape of one square whose shell shows a texel, with what is made of its surfaces.
struct Landscape {
    source: Model,
    volume: Volume,
    palette: Palette,
    layers: Vec<Layer>,
    sun: DVec3,
    sky: f64,
    options: RenderOptions,
}

impl Landscape {
    /// Seen from `eye`.
    fn new(source: Model, resolution: u32, eye: DVec3) -> Landscape {
        let camera = CameraChoice::LookAt { eye, target: DVec3::Y, yfov: 0.1 };
        let options = RenderOptions { size: [32, 32], camera, shadows: false, ..RenderOptions::measuring() };
        let volume = baked(source.clone(), resolution);
        let (palette, layers) = (Palette::default(), vec![Layer::default()]);
        Landscape { source, volume, palette, layers, sun: DVec3::Y, sky: 0.0, options }
    }

    /// As voxels, and as triangles.
    fn drawn(&self) -> [Film; 2] {
        let shell = ShellMaterial {
            thickness: 2.0,
            surface_visible: false,
            layers: self.layers.clone(),
            ..ShellMaterial::default()
        };
        let towards = glam::DQuat::from_rotation_arc(DVec3::Z, self.sun.normalize());
        let sun = Light {
            name: String::new(),
            to_world: DAffine3::from_quat(towards),
            intensity: [SUN; 3],
            kind: LightKind::Directional,
            range: f64::INFINITY,
        };
        let model = Model {
            parts: vec![square()],
            materials: vec![Material { shell: Some(Arc::new(shell)), ..Material::default() }],
            instances: vec![instance(0)],
            lights: vec![sun],
            ..Model::default()
        };
        let texels = vec![TexelRef { palette: self.palette.clone(), ..TexelRef::default() }];
        let environment =
            Environment { sky: Some([self.sky; 3].into()), background: Some([0.0; 3]), ..Default::default() };
        let scene = Scene { model, texels, environment, ..Scene::default() };
        let tree = || vec![Some(Octree::new(Restyled::new(self.volume.clone(), &self.palette)).unwrap())];
        let mut source = self.source.clone();
        vtex::render::reference::restyle(&mut source, &self.palette);
        let source = SourceMesh::new(source, &self.volume.info, &mut vtex::Warnings::default());
        let traced = reference_with(&scene, tree(), &[Some(source)], &self.options, 0..16, &Quiet).unwrap();
        [render_with(&scene, tree(), &self.options, &Quiet).unwrap().film, traced.film]
    }
}

fn mean(film: &Film, mut of: impl FnMut(usize) -> bool) -> Vec3 {
    let chosen: Vec<_> = film.pixels.iter().enumerate().filter(|(i, _)| of(i % film.width as usize)).collect();
    chosen.iter().map(|(_, p)| Vec3::new(p[0], p[1], p[2])).sum::<Vec3>() / chosen.len() as f32
}

fn glossy(specular: f64, shininess: f64) -> Finish {
    Finish { specular: Some([specular; 3]), shininess: Some(shininess), ..Finish::PLAIN }
}

/// A level sheet that fills the picture: `format-spec/landscape-1-materials.md`, §1.
#[test]
fn a_sheet_shines_as_the_formula_says() {
    let eye = DVec3::new(3.0, 9.0, 0.0);
    let mut land = Landscape::new(sheet(), 16, eye);
    land.layers[0].phong = Phong { finish: glossy(0.5, 40.0), ..Phong::tint([0.4; 3]) };
    for sun in [DVec3::new(-3.0, 8.0, 0.0), DVec3::new(-1.0, 5.0, 0.5), DVec3::new(0.5, 1.0, -0.5)] {
        land.sun = sun;
        let (view, light) = ((eye - DVec3::Y).normalize(), sun.normalize());
        let lobe = (view + light).normalize().y.powf(40.0);
        let want = SUN / std::f64::consts::PI * light.y * (0.2 + 0.5 * 48.0 / 8.0 * lobe);
        for film in land.drawn() {
            let found = f64::from(mean(&film, |_| true).x);
            // The picture is 6 degrees wide, over which the lobe bends: 1 %; S is coded in steps of 1/255.
            assert!((found / want - 1.0).abs() < 0.03, "{sun}: {found} {want}");
        }
    }
}

/// Voxels of leaves in many directions, highlights alone.
#[test]
fn clouds_of_leaves_shine_as_their_facets_do() {
    let mut random = vtex::random::SplitMix64::new(7);
    let mut any = move || {
        let z = 2.0 * random.unit() - 1.0;
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * random.unit());
        DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
    };
    let mut other = any.clone();
    let lying = move || (DVec3::Y + 0.4 * other()).normalize();
    let eye = DVec3::new(0.0, 6.0, 10.0);
    let clouds: [(Model, f32); 2] = [(leaves(900, 0.06, &mut any), 0.1), (leaves(900, 0.06, lying), 0.1)];
    for (model, tolerance) in clouds {
        let mut land = Landscape::new(model, 32, eye);
        land.sun = DVec3::new(0.3, 8.0, -8.0);
        for shininess in [8.0, 60.0] {
            land.layers[0].phong = Phong { finish: glossy(0.5, shininess), ..Phong::tint([0.0; 3]) };
            let [drawn, traced] = land.drawn().map(|film| mean(&film, |_| true).x);
            // The lobe's integral is off by up to .15 for single voxels and views (`src/march/specular.rs`), less in the mean;
            // the covered area by .03; the few hundred leaves that shine are chosen by chance, in both alike.
            assert!((drawn / traced - 1.0).abs() < tolerance + 0.05, "{shininess}: {drawn} {traced}");
        }
    }
}

/// Half of the rates, and half of the facets.
#[test]
fn thinner_layers_let_the_same_light_through_as_their_facets() {
    let mut random = vtex::random::SplitMix64::new(3);
    let normal = move || DVec3::new(random.signed(), random.signed(), 0.5).normalize();
    let mut land = Landscape::new(leaves(250, 0.1, normal), 32, DVec3::new(0.0, 1.0, 12.0));
    let mut covered = |scale: f64| {
        land.layers[0].opacity_scale = scale;
        land.drawn().map(|film| film.pixels.iter().map(|p| p[3]).sum::<f32>() / film.pixels.len() as f32)
    };
    let [all, _] = covered(1.0);
    let [drawn, traced] = covered(0.4);
    // 1024 pixels of 16 samples: .004. Voxels: .03 of covered area, as without a scale; and that leaves of one block hide each
    // other less than by chance (its correlation), which half of them would not: measured .034 in all.
    assert!(drawn < 0.75 * all && (drawn - traced).abs() < 0.045, "{all} {drawn} {traced}");
    assert_eq!(covered(0.0), [0.0; 2]);
}

#[test]
fn materials_of_a_palette_shine_each_for_itself() {
    let mut random = vtex::random::SplitMix64::new(3);
    let tilted = move || DVec3::new(random.unit() - 0.5, 2.0, random.unit() - 0.5).normalize();
    let mut land = Landscape::new(leaves(900, 0.06, tilted), 32, DVec3::new(0.0, 8.0, 8.0));
    land.sun = DVec3::new(0.0, 8.0, -7.0);
    land.layers[0].phong = Phong { finish: glossy(0.2, 10.0), ..Phong::tint([0.0; 3]) };
    let bright = |land: &Landscape| land.drawn().map(|film| mean(&film, |_| true).x);
    let [all, _] = bright(&land);
    let style = Style { finish: glossy(0.0, 10.0), ..Style::UNCHANGED };
    land.palette.styles.insert("bark".into(), style);
    let [half, traced] = bright(&land);
    // Every second leaf, within what a few hundred of them are by chance.
    assert!((half / all - 0.5).abs() < 0.08, "{half} {all}");
    assert!((half / traced - 1.0).abs() < 0.12, "{half} {traced}");
}

#[test]
fn ambient_factors_multiply_light_from_around() {
    let mut random = vtex::random::SplitMix64::new(3);
    let normal = move || DVec3::new(random.signed(), random.signed(), 0.5).normalize();
    let mut land = Landscape::new(leaves(300, 0.1, normal), 16, DVec3::new(0.0, 1.0, 12.0));
    (land.sky, land.sun) = (1.0, -DVec3::Z);
    land.options.ambient = vtex::render::Ambient::Constant;
    // Lit from behind: what is seen is of the sky alone.
    let before = land.drawn();
    land.layers[0].phong.finish.ambient = [0.5, 0.0, 1.0];
    for (film, plain) in land.drawn().iter().zip(&before) {
        let ratio = mean(film, |_| true) / mean(plain, |_| true);
        assert!((ratio - Vec3::new(0.5, 0.0, 1.0)).abs().max_element() < 1e-3, "{ratio}");
    }
}

#[test]
fn images_and_noise_vary_over_the_ground() {
    let mut random = vtex::random::SplitMix64::new(3);
    let normal = move || DVec3::new(random.signed(), random.signed(), 0.5).normalize();
    let mut land = Landscape::new(leaves(900, 0.1, normal), 32, DVec3::new(0.0, 20.0, 0.01));
    let mut halves = Texture::new("halves", 2, 1, vec![[255, 0, 0, 255], [0, 0, 255, 255]]);
    halves.nearest = true;
    let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let image = TextureRef { texture: Arc::new(halves), tex_coord: 0, transform: identity };
    let variation = Variation { diffuse: Some(image), ..Variation::default() };
    land.layers[0].phong.variations = vec![Arc::new(variation)];
    for film in land.drawn() {
        let (left, right) = (mean(&film, |x| x < 15), mean(&film, |x| x > 16));
        // u runs with x, which runs to the right; y and the picture's up are apart by the thousandth of the eye.
        assert!(left.x > 0.05 && left.z < 0.05 * left.x, "{left}");
        assert!(right.z > 0.05 && right.x < 0.05 * right.z, "{right}");
    }
    let noise = Noise {
        seed: 5,
        frequency: DVec3::new(2.5, 2.5, 0.0),
        origin: DVec3::ZERO,
        period: [0; 3],
        octaves: 1,
        turbulence: false,
    };
    let colours = PhongNoise {
        noise,
        space: NoiseSpace::Texel,
        ambient: [[1.0; 3]; 2],
        diffuse: [[0.0, 1.0, 1.0], [1.0, 0.0, 1.0]],
        specular: [[1.0; 3]; 2],
        shininess: [1.0; 2],
    };
    land.layers[0].phong.variations = vec![Arc::new(Variation { noise: Some(colours), ..Variation::default() })];
    let [drawn, traced] = land.drawn();
    // Red over blue is the ramp itself, whatever the light: its parameter at each pixel.
    let ramp = |film: &Film| -> Vec<f32> { film.pixels.iter().map(|p| p[0] / p[2].max(1e-6)).collect() };
    let (a, b) = (ramp(&drawn), ramp(&traced));
    let off = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.len() as f32;
    let spread = b.iter().map(|v| (v - 0.5).abs()).sum::<f32>() / b.len() as f32;
    // Pixels are 4 cm wide, cells of noise 80: over one it changes by some hundredths.
    assert!(off < 0.03 && spread > 0.1, "{off} {spread}");
    // In the world, metres: cells half as many.
    let world = PhongNoise {
        space: NoiseSpace::World,
        noise: Noise { frequency: DVec3::new(0.9, 0.0, 0.9), ..noise },
        ..colours
    };
    land.layers[0].phong.variations = vec![Arc::new(Variation { noise: Some(world), ..Variation::default() })];
    let [drawn, traced] = land.drawn();
    let off = ramp(&drawn).iter().zip(ramp(&traced)).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.len() as f32;
    assert!(off < 0.03, "{off}");
}

fn vtex(folder: &Path, arguments: &[&str]) -> (i32, String) {
    let output =
        std::process::Command::new(env!("CARGO_BIN_EXE_vtex")).args(arguments).current_dir(folder).output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn map_writes_highlights() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let sample = |name: &str| format!("{}/samples/{name}", env!("CARGO_MANIFEST_DIR"));
    let (fern, ground) = (sample("fern.glb"), sample("terrain.glb"));
    assert_eq!(vtex(folder, &["bake", &fern, "-r", "8", "-o", "fern.vtex"]).0, 0);
    let mapped =
        |gloss: &str| vtex(folder, &["map", &ground, "--texel", "fern.vtex", "--gloss", gloss, "-o", "a.gltf"]);
    for (gloss, words) in [
        ("", "COLOUR"),
        ("2", "from 0 to 1"),
        ("=0.1", "name is missing"),
        ("0.1:x", "x"),
        ("0.1:99999", "from 0 to 10000"),
    ] {
        let (code, errors) = mapped(gloss);
        assert_eq!(code, 2, "{gloss}: {errors}");
        assert!(words == "COLOUR" || errors.contains(words), "{gloss}: {errors}");
        assert!(!folder.join("a.gltf").exists());
    }
    let (code, errors) = mapped("0.04:50");
    assert_eq!(code, 0, "{errors}");
    let scene = vtex::scene::gltf::read(&folder.join("a.gltf"), &Default::default()).unwrap();
    let finish = scene.copies[0].variants[0].phong.finish;
    assert_eq!((finish.specular, finish.shininess), (Some([0.04; 3]), Some(50.0)));
}

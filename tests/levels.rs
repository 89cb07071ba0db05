//! A zoom: the same picture with ever larger pixels, so that ever coarser depths are read, must stay as bright.

use std::sync::Arc;

use vtex::bake;
use vtex::geom::{DAffine3, DVec3};
use vtex::march::calibrate;
use vtex::progress::Quiet;
use vtex::render::{CameraChoice, Options, render_with};
use vtex::scene::shell::{Environment, ShellMaterial, TexelRef};
use vtex::scene::{Instance, Light, LightKind, Material, Model, Part, Scene};
use vtex::source;
use vtex::source::OpenOptions;
use vtex::volume::{Octree, Volume, brightness};

const FINEST: u32 = 64;

/// A tile, invisible itself, with one copy on it, in the sun.
fn scene() -> Scene {
    let shell = ShellMaterial { surface_visible: false, ..ShellMaterial::default() };
    let corners = [[0.0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let tile = Part {
        positions: corners.map(|[u, v]| [u - 0.5, 0.0, 0.5 - v]).to_vec(),
        normals: Some(vec![[0.0, 1.0, 0.0]; 4]),
        uvs: vec![corners.to_vec()],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Part::default()
    };
    let turn = glam::DQuat::from_rotation_arc(DVec3::Z, DVec3::new(0.36, 0.75, 0.55).normalize());
    let sun = Light {
        name: String::new(),
        to_world: DAffine3::from_quat(turn),
        intensity: [3.0; 3],
        kind: LightKind::Directional,
        range: f64::INFINITY,
    };
    let model = Model {
        parts: vec![tile],
        materials: vec![Material { shell: Some(Arc::new(shell)), ..Material::default() }],
        instances: vec![Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() }],
        lights: vec![sun],
        metres_per_unit: 1.0,
        ..Model::default()
    };
    let texel = TexelRef { name: "tree".into(), frames: vec![], ..TexelRef::default() };
    let environment =
        Environment { sky: Some([0.35, 0.42, 0.52].into()), background: Some([0.0; 3]), ..Default::default() };
    Scene { model, texels: vec![texel], copies: Vec::new(), environment }
}

/// Mean luminance of the copy with pixels of 1, 2, 4, 8 of its finest voxels.
fn zoom(volume: &Arc<Volume>, eye: DVec3) -> Vec<f64> {
    let shot = |side: u32| {
        let tree = Octree::new(Arc::clone(volume)).unwrap();
        // The cube is about as high as the picture.
        let camera = CameraChoice::LookAt { eye: 20.0 * eye, target: DVec3::new(0.0, 0.5, 0.0), yfov: 0.05 };
        let options = Options { size: [side; 2], camera, lanes: 16, ..Options::measuring() };
        let film = render_with(&scene(), vec![Some(tree)], &options, &Quiet).unwrap().film;
        let luminance = |p: &[f32; 4]| f64::from(0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2]);
        film.pixels.iter().map(luminance).sum::<f64>() / film.pixels.len() as f64
    };
    [FINEST, FINEST / 2, FINEST / 4, FINEST / 8].map(shot).to_vec()
}

/// The largest step from one picture to the next, relative.
fn step(zoom: &[f64]) -> f64 {
    zoom.windows(2).map(|w| (w[1] / w[0] - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn a_change_of_depth_does_not_show() {
    let spruce = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/spruce.glb");
    let source = source::open(spruce.as_ref(), &OpenOptions::default()).unwrap();
    let options = bake::Options { resolution: FINEST, calibrate: false, ..bake::Options::default() };
    let (volume, _) = bake::bake(&*source, &options, &Quiet, &mut |_| ()).unwrap();
    let plain = Arc::new(super::readable::readable(volume));
    let mut levelled = (*plain).clone();
    let measured = calibrate::measure(Octree::new(Arc::clone(&plain)).unwrap()).unwrap();
    assert_eq!(measured.len(), 7);
    assert_eq!(
        measured[6],
        brightness::BrightnessFactors::PLAIN,
        "the finest depth is what the others are held against"
    );
    brightness::store(&measured, &mut levelled.info.meta);
    let levelled = Arc::new(levelled);
    let (mut before, mut after) = (0.0, 0.0);
    for eye in [DVec3::new(0.6, 0.3, 0.8), DVec3::new(-0.8, 0.1, 0.6), DVec3::new(0.05, 1.0, 0.1)] {
        let (rough, smooth) = (zoom(&plain, eye), zoom(&levelled, eye));
        // The levels are roots of means over all directions of view and sun; what is left shows more the fewer voxels there
        // are, and the last picture has 8×8 pixels.
        assert!(step(&smooth[..2]) < 0.025 && step(&smooth) < 0.12, "{eye}: {smooth:?}, without the levels {rough:?}");
        let (rough, smooth) = (step(&rough), step(&smooth));
        (before, after) = (before + rough, after + smooth);
    }
    assert!(after < 0.85 * before, "{after} against {before}");
}

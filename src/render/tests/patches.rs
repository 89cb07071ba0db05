//! Pictures of bilinear patches against finer meshes of triangles, by the renderer and by the reference.

use super::*;
use crate::random::SplitMix64;
use crate::render::reference::reference_with;
use crate::render::source_mesh::SourceMesh;

/// A ground of 4 × 3 patches, none of which is flat, each with a cell of the texel or a part of one; all attributes differ from
/// vertex to vertex.
fn ground() -> Part {
    const N: [u32; 2] = [4, 3];
    let mut random = SplitMix64::new(11);
    let mut part = Part { name: "ground".into(), ..Part::default() };
    let (mut uvw, mut heights, mut dw, mut jitter) = (vec![], vec![], vec![], vec![]);
    for j in 0..=N[1] {
        for i in 0..=N[0] {
            let [x, z] = [f64::from(i) - 2.0, 1.5 - f64::from(j)];
            let mut off = |by: f64| by * random.signed();
            let p = [x + off(0.1), off(0.25), z + off(0.1)];
            part.positions.push(p.map(|v| v as f32));
            let (u, v, w) = (1.1 * f64::from(i) + off(0.1), 0.9 * f64::from(j) + 0.2 * x + off(0.1), off(0.05));
            uvw.push([u as f32, v as f32, w as f32]);
            heights.push([off(0.2) as f32, (0.8 + off(0.2)) as f32, off(0.2) as f32]);
            dw.push((1.0 + off(0.2)) as f32);
            jitter.push((0.5 + off(0.5)) as f32);
        }
    }
    let at = |i: u32, j: u32| j * (N[0] + 1) + i;
    for (i, j) in (0..N[1]).flat_map(|j| (0..N[0]).map(move |i| (i, j))) {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        part.patches.push([a, b, c, d]);
        part.triangles.extend([[a, b, c], [a, c, d]]);
    }
    Part { uvw: Some(uvw), heights: Some(heights), dw: Some(dw), jitter: Some(jitter), ..part }
}

/// The same surface and shell as `columns` × `rows` pairs of triangles for each patch.
fn twin(part: &Part, columns: u32, rows: u32) -> Part {
    let mut out = Part { name: "twin".into(), ..Part::default() };
    let (mut uvw, mut heights, mut dw, mut jitter) = (vec![], vec![], vec![], vec![]);
    for patch in &part.patches {
        let first = out.positions.len() as u32;
        for j in 0..=rows {
            for i in 0..=columns {
                let [u, v] = [f64::from(i) / f64::from(columns), f64::from(j) / f64::from(rows)];
                let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), u * v, (1.0 - u) * v];
                let mix = |of: &dyn Fn(usize) -> f32| {
                    (0..4).map(|k| weights[k] * f64::from(of(patch[k] as usize))).sum::<f64>() as f32
                };
                let mix3 = |list: &[[f32; 3]]| [0, 1, 2].map(|axis| mix(&|v| list[v][axis]));
                out.positions.push(mix3(&part.positions));
                uvw.push(mix3(part.uvw.as_ref().unwrap()));
                heights.push(mix3(part.heights.as_ref().unwrap()));
                dw.push(mix(&|v| part.dw.as_ref().unwrap()[v]));
                jitter.push(mix(&|v| part.jitter.as_ref().unwrap()[v]));
            }
        }
        let at = |i: u32, j: u32| first + j * (columns + 1) + i;
        for (i, j) in (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j))) {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            out.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    Part { uvw: Some(uvw), heights: Some(heights), dw: Some(dw), jitter: Some(jitter), ..out }
}

fn landscape(part: Part, layers: Vec<Layer>) -> Scene {
    let shell = ShellMaterial { layers, ..ShellMaterial::default() };
    let material = Material { base_color: [0.5, 0.4, 0.3, 1.0], shell: Some(Arc::new(shell)), ..Material::default() };
    let mut scene = scene(vec![part], vec![material], vec![DAffine3::IDENTITY]);
    scene.model.lights = vec![sun(DVec3::new(0.5, 0.8, 0.4), 3.0)];
    scene
}

/// Posts and slabs.
fn posts() -> Octree {
    let inside = |p: DVec3| (p.x - 0.4).abs().max((p.y - 0.6).abs()) < 0.2 || (p.z - 0.7).abs() < 0.1 && p.x > 0.5;
    texel(5, grey(0.4), inside)
}

fn options(eye: DVec3, target: DVec3) -> Options {
    Options { sky: Some([0.3; 3].into()), ..looking(eye, target, 56) }
}

/// Mean difference of two pictures.
fn apart(a: &Film, b: &Film) -> f64 {
    let pair = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|k| f64::from((a[k] - b[k]).abs())).sum::<f64>();
    a.pixels.iter().zip(&b.pixels).map(pair).sum::<f64>() / (3 * a.pixels.len()) as f64
}

#[test]
fn the_reference_traces_the_same_patches() {
    let bounds = crate::geom::Aabb::UNIT;
    let info = Info { bounds, ..Info::default() };
    let board = |x: f32| Part {
        positions: vec![[x, 0.0, 0.2], [x, 1.0, 0.2], [x + 0.1, 1.0, 0.8], [x + 0.1, 0.0, 0.8]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Part::default()
    };
    let instance = |part: usize| Instance { part, transform: DAffine3::IDENTITY, node: String::new() };
    let source = || Model {
        parts: vec![board(0.2), board(0.6)],
        materials: vec![Material::default()],
        instances: vec![instance(0), instance(1)],
        ..Model::default()
    };
    let options = options(DVec3::new(2.5, 2.6, 4.5), DVec3::new(0.0, 0.2, 0.0));
    let of = |part: Part| {
        let tree = Octree::new(Volume { info: info.clone(), depths: vec![] }).unwrap();
        let source = SourceMesh::new(source(), &info, &mut Warnings::default());
        let scene = landscape(part, vec![Layer::default()]);
        reference_with(&scene, vec![Some(tree)], &[Some(source)], &options, 0..4, &Quiet).unwrap()
    };
    let (patches, fine, coarse) = (of(ground()), of(twin(&ground(), 16, 16)), of(twin(&ground(), 1, 1)));
    assert_eq!((patches.stats.patches, fine.stats.patches), (12, 0));
    let (off, other) = (apart(&patches.film, &fine.film), apart(&coarse.film, &fine.film));
    // Edges are sharp: a sample on the other side of one is off by all. Of 512 triangles, edges are within 1/256 of the twist,
    // about a thousandth of a patch, which is a twentieth of a pixel here.
    assert!(off < 4e-3 && other > 4.0 * off, "{off} {other}");
}

/// A flat rectangle with affine coordinates is the two triangles that it is.
#[test]
fn a_flat_patch_is_its_two_triangles() {
    let options = options(DVec3::new(2.5, 2.6, 4.5), DVec3::ZERO);
    let of = |patches: Vec<[u32; 4]>| {
        let mut part = Part { patches, ..square(1.5, 3.0, 0) };
        part.triangles.reverse();
        shot(&landscape(part, vec![Layer::default()]), vec![Some(posts())], &options)
    };
    let (patch, triangles) = (of(vec![[3, 2, 1, 0]]), of(vec![]));
    // To rounding of f32.
    assert!(patch.pixels.iter().zip(&triangles.pixels).all(|(a, b)| (0..4).all(|k| (a[k] - b[k]).abs() < 1e-5)));
}

/// A patch that is folded is counted, and two triangles stand for it.
#[test]
fn folded_patches_are_their_two_triangles() {
    let mut part = ground();
    // One vertex in the middle of the ground goes down instead of up.
    part.heights.as_mut().unwrap()[6] = [0.0, -0.5, 0.0];
    let options = options(DVec3::new(2.5, 2.6, 4.5), DVec3::ZERO);
    let of = |part: Part| {
        let scene = landscape(part, vec![Layer::default()]);
        render_with(&scene, vec![Some(posts())], &options, &Quiet).unwrap()
    };
    let done = of(part.clone());
    assert_eq!((done.stats.patches, done.stats.split_patches), (8, 4));
    assert!(done.warnings.iter().any(|(text, n)| text.contains("taken as two triangles") && n == 4));
    assert!(done.film.pixels.iter().flatten().all(|v| v.is_finite()));
    // As if the file had said so.
    part.patches.retain(|p| !p.contains(&6));
    let is_whole = |t: &[u32; 3]| part.patches.iter().any(|p| t.iter().all(|v| p.contains(v)));
    part.triangles.sort_by_key(|t| !is_whole(t));
    let told = of(part);
    assert!(apart(&done.film, &told.film) < 1e-6);
}

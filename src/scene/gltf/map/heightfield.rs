//! Conversion of a height map (PNG, TIFF, GeoTIFF) to a ground mesh that is then mapped: one vertex per pixel, in a temporary .glb.

use std::path::Path;

use serde_json::json;

use super::surface::WRITTEN;
use super::temp_glb;
use super::temp_glb::TempGlb;
use crate::geom::DVec3;
use crate::scene::raster::Raster;
use crate::{Error, Result};

/// Most pixels of a height map.
const MAX_VERTICES: u64 = 1 << 24;

/// Whether the file name is that of a height map.
pub fn is_picture(path: &Path) -> bool {
    path.extension().is_some_and(|e| ["png", "tif", "tiff"].iter().any(|known| e.eq_ignore_ascii_case(known)))
}

/// Scale of a height map, where it is not to be taken from the file.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Scales {
    /// Width and height of a pixel, metres.
    pub pixel: Option<f64>,
    /// Heights of black and of white, metres.
    pub relief: Option<[f64; 2]>,
}

/// Make the ground of a height map. North, which is up in the picture, is −z, and the picture's middle is x = z = 0.
///
/// # Errors
/// As [`Raster::open`]; `Options` where neither the file nor `scales` tells the size of a pixel, or the heights of a PNG.
pub fn make(path: &Path, scales: Scales, notes: &mut Vec<String>) -> Result<TempGlb> {
    let raster = Raster::open(path)?;
    let (columns, rows) = (raster.width, raster.height);
    let needed = columns as u64 * rows as u64;
    if needed > MAX_VERTICES {
        let what = format!("{}: the pixels of a ground (resample it to fewer)", path.display());
        return Err(Error::Limit { what, needed, allowed: MAX_VERTICES });
    }
    if columns < 2 || rows < 2 {
        return Err(Error::input(path, "", "a ground needs two pixels each way at the least"));
    }
    let place = raster.place.map(|p| (p.pixel, p.height_unit));
    let pixel = match (scales.pixel, place) {
        (Some(metres), _) => [metres; 2],
        (None, Some((pixel, _))) => pixel,
        (None, None) => {
            let what = format!("{}: it does not say how wide a pixel is; option `pixel` does", path.display());
            return Err(Error::Options(what));
        }
    };
    let metres = metres(path, &raster, scales.relief, place.map_or(1.0, |p| p.1))?;
    let (vertices, holes) = vertices(&raster, pixel, metres);
    let triangles = triangles(columns, rows, &vertices);
    if triangles.is_empty() {
        return Err(Error::input(path, "", "has no four neighbouring pixels with heights"));
    }
    let size = [pixel[0] * columns as f64, pixel[1] * rows as f64];
    let origin = raster.place.map(|p| [p.corner[0] + 0.5 * size[0], p.corner[1] - 0.5 * size[1]]);
    let (least, most) =
        vertices.iter().filter(|v| v.y.is_finite()).fold((f64::MAX, f64::MIN), |b, v| (b.0.min(v.y), b.1.max(v.y)));
    let at = origin.map_or(String::new(), |[east, north]| {
        format!("; its middle, {east:.1} east and {north:.1} north, is x = z = 0")
    });
    notes.push(format!("ground: {:.1} × {:.1} m, {least:.1} to {most:.1} m high{at}", size[0], size[1]));
    if holes > 0 {
        notes.push(format!("ground: {holes} pixels without a height are holes"));
    }
    write(path, (&vertices, [columns, rows]), &triangles, origin)
}

/// Height in metres of a stored number: `[of 0, per unit]`.
fn metres(path: &Path, raster: &Raster, relief: Option<[f64; 2]>, unit: f64) -> Result<[f64; 2]> {
    match (relief, raster.white, raster.measured) {
        (Some([low, high]), Some(white), _) => Ok([low, (high - low) / f64::from(white)]),
        (Some(_), None, _) => {
            let what =
                "its numbers are no shades from black to white: they are taken as metres, without option `relief`";
            Err(Error::Options(format!("{}: {what}", path.display())))
        }
        (None, _, true) => Ok([0.0, unit]),
        (None, ..) => {
            let what = format!(
                "{}: a PNG does not say how high it is; option `relief` gives the metres of black and white",
                path.display()
            );
            Err(Error::Options(what))
        }
    }
}

/// One vertex at the middle of each pixel, and the number of those without a height (NaN).
fn vertices(raster: &Raster, pixel: [f64; 2], [base, step]: [f64; 2]) -> (Vec<DVec3>, usize) {
    let (columns, rows) = (raster.width, raster.height);
    let along = |i: usize, n: usize, metres: f64| (i as f64 + 0.5 - 0.5 * n as f64) * metres;
    let at = |k: usize| {
        let (i, j) = (k % columns, k / columns);
        let height = base + step * f64::from(raster.get(i, j));
        let y = if height.is_finite() && height.abs() < 1e7 { height } else { f64::NAN };
        DVec3::new(along(i, columns, pixel[0]), y, along(j, rows, pixel[1]))
    };
    let vertices: Vec<DVec3> = (0..columns * rows).map(at).collect();
    let holes = vertices.iter().filter(|v| v.y.is_nan()).count();
    (vertices, holes)
}

/// Two triangles per four pixels that have heights, counter-clockwise from above.
fn triangles(columns: usize, rows: usize, vertices: &[DVec3]) -> Vec<[u32; 3]> {
    let mut out = Vec::with_capacity(2 * (columns - 1) * (rows - 1));
    let known = |k: usize| vertices.get(k).is_some_and(|v| !v.y.is_nan());
    for j in 0..rows - 1 {
        for i in 0..columns - 1 {
            let k = j * columns + i;
            let (a, b, c, d) = (k, k + columns, k + 1, k + columns + 1);
            if [a, b, c, d].into_iter().all(known) {
                out.extend([[a, b, c], [c, b, d]].map(|t| t.map(|v| v as u32)));
            }
        }
    }
    out
}

/// Unit normal of vertex k, from its neighbours' heights.
fn normal(vertices: &[DVec3], [columns, rows]: [usize; 2], k: usize) -> DVec3 {
    let (i, j) = (k % columns, k / columns);
    let known = |k: usize, or: DVec3| vertices.get(k).copied().filter(|v| !v.y.is_nan()).unwrap_or(or);
    let own = vertices[k];
    let (west, east) = (known(if i > 0 { k - 1 } else { k }, own), known(if i + 1 < columns { k + 1 } else { k }, own));
    let (north, south) =
        (known(if j > 0 { k - columns } else { k }, own), known(if j + 1 < rows { k + columns } else { k }, own));
    (south - north).cross(east - west).try_normalize().unwrap_or(DVec3::Y)
}

fn write(
    path: &Path,
    (vertices, size): (&[DVec3], [usize; 2]),
    triangles: &[[u32; 3]],
    origin: Option<[f64; 2]>,
) -> Result<TempGlb> {
    let mut bin: Vec<u8> = Vec::with_capacity(vertices.len() * 32 + triangles.len() * 12);
    let mut put = |v: f64| bin.extend((v as f32).to_le_bytes());
    // The vertex of a hole belongs to no triangle, but needs finite coordinates.
    let sound = |v: &DVec3| if v.y.is_nan() { DVec3::new(v.x, 0.0, v.z) } else { *v };
    vertices.iter().for_each(|v| sound(v).to_array().into_iter().for_each(&mut put));
    (0..vertices.len()).for_each(|k| normal(vertices, size, k).to_array().into_iter().for_each(&mut put));
    for k in 0..vertices.len() {
        put(((k % size[0]) as f64 + 0.5) / size[0] as f64);
        put(((k / size[0]) as f64 + 0.5) / size[1] as f64);
    }
    let indices = bin.len();
    triangles.iter().flatten().for_each(|i| bin.extend(i.to_le_bytes()));
    let n = vertices.len();
    let bounds = crate::geom::Aabb::around(vertices.iter().map(sound));
    let [min, max] = [bounds.min, bounds.max].map(|p| p.to_array().map(|v| v as f32));
    let json = json!({
        "asset": {"version": "2.0", "generator": "vtex"},
        "extras": origin.map(|o| json!({WRITTEN: {"origin": o}})).unwrap_or_else(|| json!({})),
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "name": "ground"}],
        "materials": [{"name": "ground", "pbrMetallicRoughness":
            {"baseColorFactor": [0.16, 0.17, 0.09, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}}],
        "meshes": [{"name": "ground", "primitives": [
            {"attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}, "indices": 3, "material": 0}]}],
        "buffers": [{"byteLength": bin.len()}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 12 * n, "target": 34962},
            {"buffer": 0, "byteOffset": 12 * n, "byteLength": 12 * n, "target": 34962},
            {"buffer": 0, "byteOffset": 24 * n, "byteLength": 8 * n, "target": 34962},
            {"buffer": 0, "byteOffset": indices, "byteLength": bin.len() - indices, "target": 34963}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": n, "type": "VEC3", "min": min, "max": max},
            {"bufferView": 1, "componentType": 5126, "count": n, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5126, "count": n, "type": "VEC2"},
            {"bufferView": 3, "componentType": 5125, "count": 3 * triangles.len(), "type": "SCALAR"}],
    });
    temp_glb::save(path, &json, &bin)
}

//! Points, and Gaussian splats by `KHR_gaussian_splatting`, which programs that do not know it show as points.

use std::path::Path;

use serde_json::{Value, json};

use super::super::write::{Editor, Saved};
use crate::geom::DVec3;
use crate::{Error, Result};

/// Store points around `origin`, each of a linear RGBA colour that light does not change, as `.glb` or `.gltf`.
///
/// # Errors
/// `Input` where there are none; else as [`super::save`].
pub fn save_points(
    name: &str,
    origin: DVec3,
    positions: &[[f32; 3]],
    colors: &[[f32; 4]],
    output: &Path,
) -> Result<()> {
    let mut file = editor(output, positions)?;
    let attributes = json!({"POSITION": file.add_floats(positions, true)?, "COLOR_0": file.add_floats(colors, true)?});
    finish(file, (name, origin), json!({"attributes": attributes, "mode": 0}), output)
}

/// Gaussian splats, one entry of each list for each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Splats {
    /// Centres, metres.
    pub positions: Vec<[f32; 3]>,
    /// Quaternions x, y, z, w from a splat's axes to those of the scene.
    pub rotations: Vec<[f32; 4]>,
    /// Standard deviations along the splat's axes, metres.
    pub scales: Vec<[f32; 3]>,
    /// In the middle, 0 to 1.
    pub opacities: Vec<[f32; 1]>,
    /// Harmonics of degree 0 of the sRGB colour, less a half.
    pub harmonics: Vec<[f32; 3]>,
    /// Linear colour, and opacity, of the points that stand for splats elsewhere.
    pub colors: Vec<[f32; 4]>,
}

/// Store splats around `origin` as `.glb` or `.gltf`.
///
/// # Errors
/// As [`save_points`].
pub fn save_splats(name: &str, origin: DVec3, splats: &Splats, output: &Path) -> Result<()> {
    const EXTENSION: &str = "KHR_gaussian_splatting";
    let mut file = editor(output, &splats.positions)?;
    let mut attributes = json!({
        "POSITION": file.add_floats(&splats.positions, true)?,
        "COLOR_0": file.add_floats(&splats.colors, true)?,
    });
    for (semantic, accessor) in [
        ("ROTATION", file.add_floats(&splats.rotations, true)?),
        ("SCALE", file.add_floats(&splats.scales, true)?),
        ("OPACITY", file.add_floats(&splats.opacities, true)?),
        ("SH_DEGREE_0_COEF_0", file.add_floats(&splats.harmonics, true)?),
    ] {
        attributes[format!("{EXTENSION}:{semantic}")] = json!(accessor);
    }
    file.use_extension(EXTENSION)?;
    let kernel = json!({"kernel": "ellipse", "colorSpace": "srgb_rec709_display"});
    finish(
        file,
        (name, origin),
        json!({"attributes": attributes, "mode": 0, "extensions": {EXTENSION: kernel}}),
        output,
    )
}

fn editor(output: &Path, positions: &[[f32; 3]]) -> Result<Editor> {
    if positions.is_empty() {
        return Err(Error::input(output, "", "nothing is drawn"));
    }
    Ok(Editor::new(output))
}

/// Show one primitive in a material that light does not change.
fn finish(mut file: Editor, (name, origin): (&str, DVec3), mut primitive: Value, output: &Path) -> Result<()> {
    file.use_extension("KHR_materials_unlit")?;
    let material = file.push("materials", json!({"name": name, "extensions": {"KHR_materials_unlit": {}}}))?;
    primitive["material"] = json!(material);
    let mesh = file.push("meshes", json!({"name": name, "primitives": [primitive]}))?;
    let mut node = json!({"name": name, "mesh": mesh});
    if origin != DVec3::ZERO {
        node["translation"] = json!(origin.to_array());
    }
    let node = file.push("nodes", node)?;
    file.push("scenes", json!({"nodes": [node]}))?;
    file.json["scene"] = json!(0);
    file.save(output, &Saved::default())
}

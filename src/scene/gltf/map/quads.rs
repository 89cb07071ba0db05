//! Quads of a covered primitive as bilinear patches.

use serde_json::{Value, json};

use super::super::write::Editor;
use super::super::{extension, patches};
use super::surface::Surface;
use crate::Result;

/// Write the patches of a primitive that has polygons and lists none yet; or, where `wanted` is false, take them away.
pub fn write(wanted: bool, surface: &Surface, mesh: usize, editor: &mut Editor) -> Result<()> {
    let at = format!("/meshes/{mesh}/primitives/{}", surface.primitive);
    let Some(primitive) = editor.json.pointer_mut(&at).and_then(Value::as_object_mut) else { return Ok(()) };
    if !wanted {
        if let Some(extensions) = primitive.get_mut("extensions").and_then(Value::as_object_mut) {
            extensions.shift_remove(extension::NAME);
            if extensions.is_empty() {
                primitive.shift_remove("extensions");
            }
        }
        return Ok(());
    }
    let listed = primitive.get("extensions").and_then(|e| e.get(extension::NAME)?.get("patches")).is_some();
    if listed || !surface.geometry.polygons {
        return Ok(());
    }
    let (quads, triangles) = patches::of_polygons(&surface.geometry.triangles);
    if quads.is_empty() {
        return Ok(());
    }
    let (quads, triangles) = apart(quads, triangles);
    let listed = editor.add_long_indices(&quads)?;
    let indices = editor.add_long_indices(&triangles)?;
    let Some(primitive) = editor.json.pointer_mut(&at).and_then(Value::as_object_mut) else { return Ok(()) };
    primitive.insert("indices".into(), json!(indices));
    let extensions = primitive.entry("extensions").or_insert_with(|| json!({}));
    if let Some(extensions) = extensions.as_object_mut() {
        extensions.insert(extension::NAME.into(), json!({"patches": listed}));
    }
    Ok(())
}

/// Patches that follow one another begin at different vertices, or else a reader of FB_ngon_encoding would take them for one
/// polygon: a quad is the same from its third corner on, and so are its triangles.
fn apart(mut quads: Vec<[u32; 4]>, mut triangles: Vec<[u32; 3]>) -> (Vec<[u32; 4]>, Vec<[u32; 3]>) {
    let mut last = None;
    for (i, quad) in quads.iter_mut().enumerate() {
        if last == Some(quad[0]) {
            let [a, b, c, d] = *quad;
            *quad = [c, d, a, b];
            for (slot, triangle) in triangles.iter_mut().skip(2 * i).zip(patches::triangles_of(*quad)) {
                *slot = triangle;
            }
        }
        last = Some(quad[0]);
    }
    (quads, triangles)
}

/// A file whose quads are to be triangles has no polygons.
pub fn forget_polygons(editor: &mut Editor) {
    if let Some(used) = editor.json.get_mut("extensionsUsed").and_then(Value::as_array_mut) {
        used.retain(|name| name != patches::NGON);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patches_in_a_row_begin_at_different_vertices() {
        let quads = vec![[0, 1, 2, 3], [0, 4, 5, 6], [5, 7, 8, 9]];
        let triangles: Vec<[u32; 3]> = quads.iter().flat_map(|q| patches::triangles_of(*q)).collect();
        let (quads, triangles) = apart(quads, triangles);
        assert_eq!(quads, [[0, 1, 2, 3], [5, 6, 0, 4], [8, 9, 5, 7]]);
        assert_eq!(patches::of_polygons(&triangles).0, quads);
    }
}

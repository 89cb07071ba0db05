//! Bilinear patches of a primitive: those that the extension lists, or the quads that FB_ngon_encoding marks among triangles.

use serde_json::Value;

use super::document::Document;
use super::extension;
use crate::Result;

/// The draft extension by which triangles that follow one another and begin at the same vertex are one polygon.
pub const NGON: &str = "FB_ngon_encoding";

/// A primitive of triangles.
pub struct Primitive<'a> {
    pub document: &'a Document,
    /// Its extension objects by name.
    pub extension: Option<&'a Value>,
    pub material: Option<usize>,
    /// Place in the file, for messages.
    pub at: &'a str,
    /// Number of its vertices.
    pub vertices: usize,
}

/// Corners of the patches at (U, V) = (0, 0), (1, 0), (1, 1), (0, 1). `triangles` are reordered so that those of patches come first.
///
/// # Errors
/// Where the file lists patches that do not match the primitive's triangles.
pub fn read(primitive: &Primitive<'_>, triangles: &mut Vec<[u32; 3]>) -> Result<Vec<[u32; 4]>> {
    if let Some(listed) = primitive.extension.and_then(|e| e.get("patches")) {
        return primitive.listed(listed, triangles);
    }
    if !uses_polygons(primitive.document) || !primitive.has_shell() {
        return Ok(Vec::new());
    }
    let (patches, ordered) = of_polygons(triangles);
    *triangles = ordered;
    Ok(patches)
}

/// Whether a file encodes polygons by its triangles (FB_ngon_encoding).
pub fn uses_polygons(document: &Document) -> bool {
    document.root.extensions_used.iter().any(|name| name == NGON)
}

/// The quads among polygons, and all triangles, with those of the quads first.
pub fn of_polygons(triangles: &[[u32; 3]]) -> (Vec<[u32; 4]>, Vec<[u32; 3]>) {
    let (mut patches, mut ordered, mut loose) = (Vec::new(), Vec::new(), Vec::new());
    for polygon in triangles.chunk_by(|s, t| s[0] == t[0]) {
        match polygon {
            [s, t] if s[2] == t[1] => {
                patches.push([s[0], s[1], s[2], t[2]]);
                ordered.extend(polygon);
            }
            _ => loose.extend(polygon),
        }
    }
    ordered.append(&mut loose);
    (patches, ordered)
}

/// The two triangles of a patch.
pub fn triangles_of([a, b, c, d]: [u32; 4]) -> [[u32; 3]; 2] {
    [[a, b, c], [a, c, d]]
}

impl Primitive<'_> {
    /// Whether its material has a shell; polygons of other surfaces stay triangles.
    fn has_shell(&self) -> bool {
        let material = self.material.and_then(|m| self.document.root.materials.get(m));
        let shell = material.and_then(|m| m.extensions.as_ref()?.others.get(extension::NAME));
        shell.is_some_and(|e| e.get("layers").is_some())
    }

    fn listed(&self, listed: &Value, triangles: &[[u32; 3]]) -> Result<Vec<[u32; 4]>> {
        let at = format!("{}.{}.patches", self.at, extension::NAME);
        let error = |what: String| self.document.error(&*at, what);
        let accessor = listed.as_u64().and_then(|v| usize::try_from(v).ok());
        let accessor = accessor.ok_or_else(|| error("is not an accessor's index".into()))?;
        let indices: Vec<u32> = self.document.read_uints::<1>(accessor, &at)?.into_iter().map(|[i]| i).collect();
        self.document.charge(16 * (indices.len() as u64 / 4), &at)?;
        let (patches, rest) = indices.as_chunks::<4>();
        if !rest.is_empty() {
            return Err(error(format!("has {} indices; a patch has 4", indices.len())));
        }
        for (i, patch) in patches.iter().enumerate() {
            if let Some(v) = patch.iter().find(|&&v| v as usize >= self.vertices) {
                return Err(error(format!("patch {i} has the vertex {v}; the primitive has {}", self.vertices)));
            }
            let [first, second] = triangles_of(*patch);
            let is = |k: usize, t: [u32; 3]| triangles.get(k).is_some_and(|own| turns(t).contains(own));
            if !is(2 * i, first) || !is(2 * i + 1, second) {
                let [a, b, c, d] = patch;
                return Err(error(format!(
                    "patch {i} needs the triangles {} and {} to be ({a}, {b}, {c}) and ({a}, {c}, {d})",
                    2 * i,
                    2 * i + 1
                )));
            }
        }
        Ok(patches.to_vec())
    }
}

/// A triangle beginning with each of its corners.
fn turns([a, b, c]: [u32; 3]) -> [[u32; 3]; 3] {
    [[a, b, c], [b, c, a], [c, a, b]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_are_told_by_their_first_vertex() {
        let triangles = [[0, 1, 2], [3, 4, 5], [3, 5, 6], [7, 8, 9], [7, 9, 10], [7, 10, 11], [1, 2, 3], [2, 3, 4]];
        let (patches, ordered) = of_polygons(&triangles);
        assert_eq!(patches, [[3, 4, 5, 6]]);
        assert_eq!(ordered[..3], [[3, 4, 5], [3, 5, 6], [0, 1, 2]]);
        assert_eq!(ordered.len(), triangles.len());
        // Two triangles that begin alike and are no quad.
        assert!(of_polygons(&[[0, 1, 2], [0, 3, 4]]).0.is_empty());
    }
}

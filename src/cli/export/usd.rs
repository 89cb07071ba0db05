//! A texel as a `.usda` of OpenUSD: splats, blocks and points as levels of detail by the schemas of `usdLod` and `usdVol`, which
//! OpenUSD has since 26.8.

use std::fmt::{Display, Write};

use glam::DVec3;

use super::splats::Splat;
use super::voxels::Voxels;
use crate::scene::Part;

/// A picture of this many pixels, and the tangent of half of its field of view, both vertical: a level takes over where its
/// voxels are a pixel of it.
const PIXELS: f64 = 1080.0;
const HALF_VIEW: f64 = 0.364;
/// That each point of a mesh or of a cloud has its own value.
const VERTEX: &str = " (\n                interpolation = \"vertex\"\n            )";

/// What the file shows, each of its own depth.
pub struct Levels<'a> {
    /// Near the viewer.
    pub splats: &'a [Splat],
    /// Further away, from voxels of such an edge, metres.
    pub blocks: (&'a Part, f64),
    /// Far away; and the edge of their voxels.
    pub points: (&'a Voxels, f64),
}

/// The file; `name`: the texel's.
pub fn of(levels: &Levels<'_>, name: &str) -> String {
    let name = identifier(name);
    let (blocks, block_edge) = levels.blocks;
    let (low, high) = bounds(&blocks.positions);
    let far = |edge: f64| edge * PIXELS / (2.0 * HALF_VIEW);
    let centre = (low + high) / 2.0;
    let origin = levels.points.0.origin;
    let place = if origin == DVec3::ZERO {
        String::new()
    } else {
        let [x, y, z] = origin.to_array();
        format!(
            "    double3 xformOp:translate = ({x}, {y}, {z})\n    uniform token[] xformOpOrder = [\"xformOp:translate\"]\n\n"
        )
    };
    let mut out = format!(
        "#usda 1.0\n(\n    doc = \"A texel of vtex. Kept: places, colours, projected areas. Lost: block correlation, light, other \
         depths.\"\n    defaultPrim = \"{name}\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n)\n\ndef Xform \"{name}\" (\n    kind = \
         \"component\"\n)\n{{\n{place}    def Scope \"heuristics\"\n    {{\n        def LODDistanceHeuristic \"distance\"\n        {{\n\
                     uniform token lod:domain = \"imaging\"\n            point3f center = {}\n            uniform float[] thresholds \
         = [{}, {}]\n        }}\n    }}\n\n    def Xform \"levels\" (\n        prepend apiSchemas = [\"LODRootAPI\"]\n    )\n    \
         {{\n        int lod:default:index = 1\n        rel lod:heuristics = </{name}/heuristics/distance>\n",
        tuple(&centre.to_array()),
        far(block_edge) as f32,
        far(levels.points.1) as f32,
    );
    splats(levels.splats, &mut out);
    mesh(blocks, &mut out);
    points(levels.points.0, &mut out);
    out += "    }\n}\n";
    out
}

/// A name that a prim may have.
fn identifier(name: &str) -> String {
    let mut out: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if !out.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') {
        out.insert(0, '_');
    }
    out
}

fn tuple(values: &[f64]) -> String {
    format!("({})", values.iter().map(|v| (*v as f32).to_string()).collect::<Vec<_>>().join(", "))
}

fn bounds(positions: &[[f32; 3]]) -> (DVec3, DVec3) {
    let all = positions.iter().map(|p| DVec3::from_array(p.map(f64::from)));
    let (low, high) = all.fold((DVec3::MAX, DVec3::MIN), |(low, high), p| (low.min(p), high.max(p)));
    if low.x <= high.x { (low, high) } else { (DVec3::ZERO, DVec3::ZERO) }
}

fn list<T: Display>(out: &mut String, kind: &str, name: &str, values: impl Iterator<Item = T>, more: &str) {
    let _ = write!(out, "            {kind}[] {name} = [");
    for (i, value) in values.enumerate() {
        let _ = write!(out, "{}{value}", if i > 0 { ", " } else { "" });
    }
    let _ = writeln!(out, "]{more}");
}

fn begin(out: &mut String, kind: &str, name: &str, (low, high): (DVec3, DVec3)) {
    let _ = write!(out, "\n        def {kind} \"{name}\"\n        {{\n");
    list(out, "float3", "extent", [low, high].iter().map(|p| tuple(&p.to_array())), "");
}

fn splats(splats: &[Splat], out: &mut String) {
    let ends = splats.iter().map(|s| (s.centre, 3.0 * s.deviations.max_element()));
    let around = ends.fold((DVec3::MAX, DVec3::MIN), |(low, high), (p, r)| (low.min(p - r), high.max(p + r)));
    begin(out, "ParticleField3DGaussianSplat", "splats", if splats.is_empty() { Default::default() } else { around });
    list(out, "point3f", "positions", splats.iter().map(|s| tuple(&s.centre.to_array())), "");
    let turn = |s: &Splat| tuple(&[s.turn.w, s.turn.x, s.turn.y, s.turn.z]);
    list(out, "quatf", "orientations", splats.iter().map(turn), "");
    list(out, "float3", "scales", splats.iter().map(|s| tuple(&s.deviations.to_array())), "");
    list(out, "float", "opacities", splats.iter().map(|s| s.opacity as f32), "");
    *out += "            uniform int radiance:sphericalHarmonicsDegree = 0\n";
    let name = "radiance:sphericalHarmonicsCoefficients";
    list(out, "float3", name, splats.iter().map(|s| tuple(&s.harmonic())), "");
    *out += "        }\n";
}

/// Four corners a face, one after the other.
fn mesh(blocks: &Part, out: &mut String) {
    begin(out, "Mesh", "blocks", bounds(&blocks.positions));
    let vector = |p: &[f32]| tuple(&[p[0], p[1], p[2]].map(f64::from));
    list(out, "point3f", "points", blocks.positions.iter().map(|p| vector(p)), "");
    list(out, "int", "faceVertexCounts", (0..blocks.positions.len() / 4).map(|_| 4), "");
    list(out, "int", "faceVertexIndices", 0..blocks.positions.len(), "");
    *out += "            uniform token subdivisionScheme = \"none\"\n";
    list(out, "normal3f", "normals", blocks.normals.iter().flatten().map(|n| vector(n)), VERTEX);
    list(out, "color3f", "primvars:displayColor", blocks.colors.iter().flatten().map(|c| vector(c)), VERTEX);
    *out += "        }\n";
}

fn points(voxels: &Voxels, out: &mut String) {
    let middles: Vec<DVec3> = voxels.cells.iter().map(|cell| voxels.own_middle(cell)).collect();
    let width = |cell: &crate::volume::cells::Cell| {
        // A ball whose disk takes as much light as the voxel's matter.
        let (low, high) = cell.support(voxels.resolution);
        let size = (high - low) * voxels.size();
        let area = cell.opacity() * (size.x * size.y + size.y * size.z + size.z * size.x) / 3.0;
        2.0 * (area / std::f64::consts::PI).sqrt()
    };
    let widths: Vec<f64> = voxels.cells.iter().map(width).collect();
    let ends = middles.iter().zip(&widths);
    let around =
        ends.fold((DVec3::MAX, DVec3::MIN), |(low, high), (p, w)| (low.min(*p - 0.5 * *w), high.max(*p + 0.5 * *w)));
    begin(out, "Points", "points", if middles.is_empty() { Default::default() } else { around });
    list(out, "point3f", "points", middles.iter().map(|p| tuple(&p.to_array())), "");
    list(out, "float", "widths", widths.iter().map(|w| *w as f32), VERTEX);
    let colors = voxels.cells.iter().map(|cell| tuple(&cell.voxel.albedo().as_dvec3().to_array()));
    list(out, "color3f", "primvars:displayColor", colors, VERTEX);
    *out += "        }\n";
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_prims() {
        assert_eq!([identifier("a tree-2"), identifier("3"), identifier("")], ["a_tree_2", "_3", "_"]);
    }
}

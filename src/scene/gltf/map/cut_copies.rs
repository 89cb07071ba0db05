//! Warnings about copies that a shell would cut or stretch: where the mesh or its texture coordinates end, and where these are stretched.

use std::collections::HashMap;

use super::options::MapOptions;
use super::plan::{Plan, SurfacePlan};
use super::surface::{Coordinates, Surface};
use crate::Warnings;
use crate::error::length;
use crate::geom::DVec3;

/// Ratio of a cell's sides from which on its copies are reported as stretched.
const STRETCHED: f64 = 1.25;
/// Largest distance of an edge from a border of cells on which it counts as lying, in cells.
const ON_BORDER: f64 = 0.01;
/// Meshes of more triangles are not checked, but taken to have a border somewhere.
const MAX_TRIANGLES: usize = 1 << 20;

/// Warn of cut and stretched copies on the faces of the material `name`.
pub fn warn(
    options: &MapOptions,
    plan: &Plan,
    members: &[(&Surface, &SurfacePlan)],
    name: &str,
    warnings: &mut Warnings,
) {
    for (_, planned) in members {
        let [width, depth] = planned.cell;
        if planned.coordinates != Coordinates::Own && width.max(depth) > STRETCHED * width.min(depth) {
            let (width, depth) = (length(width), length(depth));
            warnings.add(format!("{name}: copies are stretched to {width} × {depth} m; option `cells` sets them"));
        }
    }
    // Cyclic texels continue from cell to cell, so no cut shows.
    if options.texels.iter().all(|(_, info)| info.cyclic[0] && info.cyclic[1]) || !cuts(options, plan, members) {
        return;
    }
    warnings.add(format!(
        "{name}: copies that stand where it or its texture coordinates end are cut there; rigid ones, without option `bend`, \
         are whole"
    ));
}

/// An edge: the bits of the positions of its ends, the lower first.
type Edge = [[u32; 3]; 2];

/// Whether some copy is cut. That is so at an edge that only one face has, or at which texture coordinates are discontinuous, unless the edge
/// lies on a border of cells and copies are not displaced over it.
fn cuts(options: &MapOptions, plan: &Plan, members: &[(&Surface, &SurfacePlan)]) -> bool {
    if members.iter().map(|(s, _)| s.geometry.triangles.len()).sum::<usize>() > MAX_TRIANGLES {
        return true;
    }
    let displaced = options.displace[..2].iter().any(|d| *d > 0.0);
    // For each edge the cell coordinates of its ends in the first face, and whether a second face was found.
    let mut open: HashMap<Edge, ([[f64; 2]; 2], bool)> = HashMap::new();
    let mut cut = false;
    for (surface, planned) in members {
        let origin = if matches!(planned.coordinates, Coordinates::Planar(_)) { plan.origin } else { [0.0; 2] };
        for face in surface.faces(surface.world(), planned.coordinates) {
            let cells = face.chart.map(|c| [0, 1].map(|k| (c[k] - origin[k]) * planned.scale[k]));
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                let mut ends = [(place(face.corners[a]), cells[a]), (place(face.corners[b]), cells[b])];
                ends.sort_by_key(|end| end.0);
                let at = ends.map(|end| end.1);
                match open.get_mut(&ends.map(|end| end.0)) {
                    None => drop(open.insert(ends.map(|end| end.0), (at, false))),
                    Some((first, met)) => {
                        *met = true;
                        let jumps = (0..4).any(|i| (first[i / 2][i % 2] - at[i / 2][i % 2]).abs() > ON_BORDER);
                        cut |= jumps && (displaced || !is_border(at) || !is_border(*first));
                    }
                }
            }
        }
    }
    cut || open.values().any(|(at, met)| !met && (displaced || !is_border(*at)))
}

/// The bits of a position in single precision, for comparison.
fn place(p: DVec3) -> [u32; 3] {
    p.as_vec3().to_array().map(|v| (v + 0.0).to_bits())
}

/// Whether an edge runs along the border of cells.
fn is_border([a, b]: [[f64; 2]; 2]) -> bool {
    (0..2).any(|k| (a[k] - a[k].round()).abs() < ON_BORDER && (a[k] - b[k]).abs() < ON_BORDER)
}

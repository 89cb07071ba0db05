//! A texel as a mesh that any program shows: a block or a point for each voxel. It stands in for the texel where a program
//! cannot draw it, for example in the viewport of a modeller.

use std::collections::HashMap;
use std::path::Path;

use glam::{DAffine3, DVec3};

use super::splats::Splat;
use super::voxels::Voxels;
use crate::scene::gltf::save::points::{Splats, save_points, save_splats};
use crate::scene::gltf::save::save;
use crate::scene::{Instance, Material, Model, Part};
use crate::volume::cells::Cell;
use crate::{Result, Warnings};

/// What stands for a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Form {
    /// A block as large as the voxel's matter, without the faces that blocks beside it hide
    Blocks,
    /// A point in the middle of its matter
    Points,
    /// A Gaussian splat, by KHR_gaussian_splatting
    Splats,
}

/// Write blocks or points. Voxels that take less than the share `least` of the light are left out. Gives the number of voxels in it.
///
/// # Errors
/// Where nothing is left, or what writing says.
pub fn write(voxels: &Voxels, form: Form, least: f64, name: &str, output: &Path) -> Result<usize> {
    let cells: Vec<&Cell> = voxels.cells.iter().filter(|cell| cell.opacity() >= least).collect();
    if form == Form::Points {
        let positions: Vec<_> = cells.iter().map(|cell| voxels.own_middle(cell).as_vec3().to_array()).collect();
        let colors: Vec<_> = cells.iter().map(|cell| color(cell)).collect();
        save_points(name, voxels.origin, &positions, &colors, output)?;
        return Ok(cells.len());
    }
    let material = Material { name: name.into(), ..Material::default() };
    let model = Model {
        parts: vec![Part { name: name.into(), ..blocks(voxels, &cells) }],
        materials: vec![material],
        instances: vec![Instance { part: 0, transform: DAffine3::from_translation(voxels.origin), node: name.into() }],
        metres_per_unit: 1.0,
        ..Model::default()
    };
    save(&model, output, &mut Warnings::default())?;
    Ok(cells.len())
}

/// Write splats, which are around `origin`.
///
/// # Errors
/// As [`write`].
pub fn write_splats(splats: &[Splat], origin: DVec3, name: &str, output: &Path) -> Result<()> {
    let narrow = |v: DVec3| v.as_vec3().to_array();
    let color = |s: &Splat| s.albedo.extend(s.opacity).as_vec4().to_array();
    let lists = Splats {
        positions: splats.iter().map(|s| narrow(s.centre)).collect(),
        rotations: splats.iter().map(|s| s.turn.as_quat().normalize().to_array()).collect(),
        scales: splats.iter().map(|s| narrow(s.deviations)).collect(),
        opacities: splats.iter().map(|s| [s.opacity as f32]).collect(),
        harmonics: splats.iter().map(|s| s.harmonic().map(|v| v as f32)).collect(),
        colors: splats.iter().map(color).collect(),
    };
    save_splats(name, origin, &lists, output)
}

fn own(voxels: &Voxels, p: DVec3) -> [f32; 3] {
    voxels.to_own.transform_point3(p).as_vec3().to_array()
}

fn color(cell: &Cell) -> [f32; 4] {
    cell.voxel.albedo().extend(1.0).to_array()
}

/// The faces of blocks that no other hides: four corners each, one face after the other, and two triangles.
pub fn blocks(voxels: &Voxels, cells: &[&Cell]) -> Part {
    let at: HashMap<[u32; 3], &Cell> =
        cells.iter().filter(|cell| cell.edge == 1).map(|cell| (cell.corner, *cell)).collect();
    let (mut positions, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    let mut triangles = Vec::new();
    for cell in cells {
        let (low, high) = cell.support(voxels.resolution);
        for (axis, up) in [(0, false), (0, true), (1, false), (1, true), (2, false), (2, true)] {
            if hidden(cell, axis, up, &at) {
                continue;
            }
            let first = positions.len() as u32;
            let mut outward = DVec3::ZERO;
            outward[axis] = if up { 1.0 } else { -1.0 };
            // Counter-clockwise seen from outside; the map to the copy's own space is a turn, so that it stays so.
            let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
            for (along_a, along_b) in [(false, false), (true, false), (true, true), (false, true)] {
                let mut p = if up { high } else { low };
                // From below the same walk would be clockwise: a is mirrored.
                p[a] = if along_a == up { high[a] } else { low[a] };
                p[b] = if along_b { high[b] } else { low[b] };
                positions.push(own(voxels, p));
                normals.push(voxels.to_own.transform_vector3(outward).normalize().as_vec3().to_array());
                colors.push(color(cell));
            }
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
    }
    Part { positions, normals: Some(normals), colors: Some(colors), triangles, ..Part::default() }
}

/// Whether the face of a block lies wholly against the next block.
fn hidden(cell: &Cell, axis: usize, up: bool, at: &HashMap<[u32; 3], &Cell>) -> bool {
    if cell.edge != 1 {
        return false;
    }
    let (low, high) = cell.voxel.support_box();
    let mut beside = cell.corner;
    let Some(place) = (if up { beside[axis].checked_add(1) } else { beside[axis].checked_sub(1) }) else {
        return false;
    };
    beside[axis] = place;
    let Some(other) = at.get(&beside) else { return false };
    let (other_low, other_high) = other.voxel.support_box();
    let reaches =
        if up { high[axis] >= 1.0 && other_low[axis] <= 0.0 } else { low[axis] <= 0.0 && other_high[axis] >= 1.0 };
    let covers = |k: usize| other_low[k] <= low[k] && other_high[k] >= high[k];
    reaches && covers((axis + 1) % 3) && covers((axis + 2) % 3)
}

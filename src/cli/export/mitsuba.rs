//! A texel as a scene of Mitsuba 3: three grids (density, albedo, SGGX matrix) and the scene file that lights them.
//!
//! E. Heitz, J. Dupuy, C. Crassin, C. Dachsbacher, *The SGGX Microflake Distribution*, SIGGRAPH 2015: the phase function that
//! both programs know.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::voxels::Voxels;
use crate::format::save;
use crate::volume::Sggx;
use crate::{Error, Result};

/// Voxels along the edge of the largest grid: ten numbers of four bytes for each of its cells are 640 MiB.
pub const MAX_RESOLUTION: u32 = 256;

/// Write `path`, an .xml, and its grids beside it. Gives the grids' names.
pub fn write(voxels: &Voxels, path: &Path) -> Result<Vec<PathBuf>> {
    let n = voxels.resolution as usize;
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let [mut density, mut albedo, mut sggx] = [1, 3, 6].map(|channels| vec![0f32; n * n * n * channels]);
    for cell in &voxels.cells {
        let rate = voxels.extinction(cell) as f32;
        let corner = voxels.own_corner(cell);
        let s = turned(&Sggx::decode(cell.voxel.ndf));
        for x in 0..cell.edge {
            for y in 0..cell.edge {
                for z in 0..cell.edge {
                    let [x, y, z] = [corner[0] + x, corner[1] + y, corner[2] + z].map(|k| k as usize);
                    let at = (z * n + y) * n + x;
                    density[at] = rate * n as f32;
                    albedo[3 * at..3 * at + 3].copy_from_slice(&cell.voxel.albedo().to_array());
                    sggx[6 * at..6 * at + 6].copy_from_slice(&s);
                }
            }
        }
    }
    let mut names = Vec::new();
    for (what, channels, grid) in [("density", 1, density), ("albedo", 3, albedo), ("sggx", 6, sggx)] {
        let name = path.with_file_name(format!("{stem}-{what}.vol"));
        save(&name, &vol(n as i32, channels, &grid))?;
        names.push(name);
    }
    save(path, scene(voxels, &names)?.as_bytes())?;
    Ok(names)
}

/// Added to the diagonal of every matrix. Mitsuba's phase function divides by the matrix's determinant, which is 0 for a flat
/// facet: without it, single pixels of a tree come out 10⁵ times too bright; with 10⁻⁴, still ten times.
const ROUNDER: f32 = 1e-3;

/// The matrix in the copy's own axes (u, w, −v), in Mitsuba's order: xx, yy, zz, xy, xz, yz.
fn turned(s: &Sggx) -> [f32; 6] {
    [s.xx + ROUNDER, s.zz + ROUNDER, s.yy + ROUNDER, s.xz, -s.xy, -s.yz]
}

/// A grid file: version 3, 32-bit floats, x fastest.
fn vol(n: i32, channels: i32, grid: &[f32]) -> Vec<u8> {
    let mut out = Vec::with_capacity(48 + grid.len() * 4);
    out.extend(b"VOL\x03");
    out.extend([1, n, n, n, channels].iter().flat_map(|v| v.to_le_bytes()));
    out.extend([0f32, 0.0, 0.0, 1.0, 1.0, 1.0].iter().flat_map(|v| v.to_le_bytes()));
    out.extend(grid.iter().flat_map(|v| v.to_le_bytes()));
    out
}

/// The volume `name` of a medium, from the grid `file`.
fn grid_volume(name: &str, file: &str, place: &str) -> String {
    let file = file.replace('&', "&amp;").replace('"', "&quot;").replace('<', "&lt;");
    format!(
        "<volume type=\"gridvolume\" name=\"{name}\">\n      <string name=\"filename\" value=\"{file}\"/>\n      \
         <boolean name=\"raw\" value=\"true\"/>\n      <string name=\"filter_type\" value=\"nearest\"/>\n      {place}\n    </volume>"
    )
}

/// The scene: the texel at its own place and size, a sky and a camera that frames it.
fn scene(voxels: &Voxels, grids: &[PathBuf]) -> Result<String> {
    let (corner, size) = (voxels.origin + voxels.own_origin(), voxels.size());
    let centre = corner + size / 2.0;
    let eye = centre + DVec3::new(0.6, 0.35, 1.0).normalize() * size * 2.2;
    let names: Vec<_> = grids.iter().map(|p| p.file_name().map(|n| n.to_string_lossy().into_owned())).collect();
    let [Some(density), Some(albedo), Some(sggx)] = &names[..] else {
        return Err(Error::Options("the output has no file name".into()));
    };
    let place = format!(
        "<transform name=\"to_world\"><scale value=\"{size}\"/><translate x=\"{}\" y=\"{}\" z=\"{}\"/></transform>",
        corner.x, corner.y, corner.z
    );
    Ok(format!(
        r#"<?xml version="1.0"?>
<!-- A texel of vtex. Kept: rates of opacity, normals (SGGX), albedo. Lost: how matter in a block of voxels hides itself
     (block correlation), support boxes, one-sided surfaces, materials, depths but this one. Mitsuba's microflakes are
     mirrors where those of vtex are dull: a sun would glint in single pixels, so that a sky alone lights this scene. -->
<scene version="3.0.0">
  <default name="spp" value="64"/>
  <default name="size" value="256"/>
  <integrator type="volpath">
    <integer name="max_depth" value="2"/><integer name="rr_depth" value="64"/><boolean name="hide_emitters" value="true"/>
  </integrator>
  <sensor type="perspective">
    <float name="fov" value="36"/>
    <transform name="to_world"><lookat origin="{ex}, {ey}, {ez}" target="{cx}, {cy}, {cz}" up="0, 1, 0"/></transform>
    <sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>
    <film type="hdrfilm">
      <integer name="width" value="$size"/><integer name="height" value="$size"/>
      <string name="pixel_format" value="rgba"/><rfilter type="box"/>
    </film>
  </sensor>
  <emitter type="constant"><rgb name="radiance" value="1, 1, 1"/></emitter>
  <medium type="heterogeneous" id="texel">
    {density}
    {albedo}
    <float name="scale" value="{rate}"/>
    <phase type="sggx">
    {sggx}
    </phase>
  </medium>
  <shape type="cube">
    <transform name="to_world"><translate x="1" y="1" z="1"/><scale value="{half}"/><translate x="{x}" y="{y}" z="{z}"/></transform>
    <bsdf type="null"/>
    <ref name="interior" id="texel"/>
  </shape>
</scene>
"#,
        ex = eye.x,
        ey = eye.y,
        ez = eye.z,
        cx = centre.x,
        cy = centre.y,
        cz = centre.z,
        density = grid_volume("sigma_t", density, &place),
        albedo = grid_volume("albedo", albedo, &place),
        sggx = grid_volume("S", sggx, &place),
        rate = 1.0 / size,
        half = size / 2.0,
        x = corner.x,
        y = corner.y,
        z = corner.z,
    ))
}

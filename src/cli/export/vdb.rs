//! A texel as grids of OpenVDB: `density`, the extinction in the mean over all directions, per metre, and `color`, the albedo,
//! linear.
//!
//! Based on: K. Museth, *VDB: High-Resolution Sparse Volumes with Dynamic Topology*, TOG 2013 (the tree); the layout of files of
//! version 224 as OpenVDB 6 and newer read it.

mod grid;

use sha2::{Digest, Sha256};

use super::voxels::Voxels;
use crate::volume::Sggx;
use crate::{Error, Result};
use grid::{Grid, Place, text};

/// Voxels that are written one by one: 16 bytes each, besides their masks.
const MAX_VALUES: u64 = 1 << 26;

/// The file.
///
/// # Errors
/// `Limit` where there are too many voxels.
pub fn of(voxels: &Voxels) -> Result<Vec<u8>> {
    let needed: u64 = voxels.cells.iter().map(|cell| if cell.edge < 8 { u64::from(cell.edge).pow(3) } else { 1 }).sum();
    if needed > MAX_VALUES {
        let what = "the number of voxels in the grids (--depth takes a coarser one)".into();
        return Err(Error::Limit { what, needed, allowed: MAX_VALUES });
    }
    let scale = voxels.size();
    let (mut density, mut color) = (Grid::<1>::new("density", "float"), Grid::<3>::new("color", "vec3s"));
    for cell in &voxels.cells {
        let per_metre =
            voxels.extinction(cell) * mean_area(&Sggx::decode(cell.voxel.ndf)) * f64::from(voxels.resolution) / scale;
        let at = voxels.own_corner(cell);
        density.fill(at, cell.edge, [per_metre as f32]);
        color.fill(at, cell.edge, cell.voxel.albedo().to_array());
    }
    // Whole numbers are the middles of voxels.
    let edge = scale / f64::from(voxels.resolution);
    let place = Place { origin: (voxels.origin + voxels.own_origin() + 0.5 * edge).to_array(), edge };
    let mut out = Vec::new();
    // Magic number, version of the layout, of the library that is said to have written it, and that grids have offsets.
    out.extend(0x5644_4220u64.to_le_bytes());
    out.extend([224u32, 10, 0].iter().flat_map(|v| v.to_le_bytes()));
    out.push(1);
    out.extend(identity(voxels).as_bytes());
    out.extend(1u32.to_le_bytes());
    text(&mut out, "creator");
    text(&mut out, "string");
    text(&mut out, concat!("vtex ", env!("CARGO_PKG_VERSION")));
    out.extend(2u32.to_le_bytes());
    density.write(place, &mut out).map_err(|e| Error::io("density", e))?;
    color.write(place, &mut out).map_err(|e| Error::io("color", e))?;
    Ok(out)
}

/// Area of the facets in the mean over all directions, against the largest: a quarter of the surface of the ellipsoid whose shadows
/// they are, by a sum over directions that are spread evenly (within 1 % for the flattest).
fn mean_area(s: &Sggx) -> f64 {
    const N: usize = 64;
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let area = |i: usize| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / N as f64;
        let (r, turn) = ((1.0 - z * z).sqrt(), golden * i as f64);
        f64::from(s.sigma(glam::DVec3::new(r * libm::cos(turn), r * libm::sin(turn), z).as_vec3()))
    };
    (0..N).map(area).sum::<f64>() / N as f64
}

/// What names the file: the same for the same voxels.
fn identity(voxels: &Voxels) -> String {
    let mut sha = Sha256::new();
    sha.update(voxels.resolution.to_le_bytes());
    for cell in &voxels.cells {
        cell.corner.iter().chain([&cell.edge]).for_each(|k| sha.update(k.to_le_bytes()));
        sha.update([cell.voxel.rate]);
    }
    let hex: String = sha.finalize().iter().take(16).map(|byte| format!("{byte:02x}")).collect();
    let part = |from: usize, to: usize| hex.get(from..to).unwrap_or_default();
    [part(0, 8), part(8, 12), part(12, 16), part(16, 20), part(20, 32)].join("-")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_areas_are_those_of_ellipsoids() {
        let of = |xx: f32, yy: f32, zz: f32| mean_area(&Sggx { xx, yy, zz, xy: 0.0, xz: 0.0, yz: 0.0 });
        // A ball's shadow is the same from everywhere; of a flat facet it is |cos| of the angle, a half in the mean; of a thread's
        // facets sin, π/4.
        assert!((of(1.0, 1.0, 1.0) - 1.0).abs() < 1e-6);
        assert!((of(0.0, 0.0, 1.0) - 0.5).abs() < 0.005, "{}", of(0.0, 0.0, 1.0));
        assert!((of(1.0, 1.0, 0.0) - std::f64::consts::FRAC_PI_4).abs() < 0.008, "{}", of(1.0, 1.0, 0.0));
        assert!((of(1.0, 0.0, 0.0) - 0.5).abs() < 0.01, "{}", of(1.0, 0.0, 0.0));
    }
}

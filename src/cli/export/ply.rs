//! Splats as a `.ply` of the layout that viewers of Gaussian splats read.
//!
//! B. Kerbl, G. Kopanas, T. Leimkühler, G. Drettakis, *3D Gaussian Splatting for Real-Time Radiance Field Rendering*, TOG 2023.

use glam::{DQuat, DVec3};

use super::splats::Splat;

/// Half a turn about z. Such files have +Y down, as the photographs that the first were made from, and what reads them turns them.
const HALF_TURN: DQuat = DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0);

/// The file: +Y down; degree 0 of the harmonics, logits of opacities, logarithms of deviations, quaternions with the real part first.
pub fn of(splats: &[Splat]) -> Vec<u8> {
    let names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"];
    let names = names.into_iter().chain(["scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]);
    let mut out = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", splats.len());
    for name in names {
        out += &format!("property float {name}\n");
    }
    out += "end_header\n";
    let mut out = out.into_bytes();
    for splat in splats {
        let logit = libm::log(splat.opacity / (1.0 - splat.opacity));
        let [x, y, z, w] = (HALF_TURN * splat.turn).to_array();
        let centre = splat.centre * DVec3::new(-1.0, -1.0, 1.0);
        let numbers = centre.to_array().into_iter().chain([0.0; 3]).chain(splat.harmonic()).chain([logit]);
        let numbers = numbers.chain(splat.deviations.to_array().map(libm::log)).chain([w, x, y, z]);
        out.extend(numbers.flat_map(|v| (v as f32).to_le_bytes()));
    }
    out
}

//! How the copies of `vtex map` differ: presets, and the sets of turns that copies take.

use clap::ValueEnum;

use crate::scene::gltf::map::Arrangement;
use crate::scene::shell::{Continuous, Orientations};

/// How copies differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum JitterPreset {
    /// Nothing differs: copies stand in rows, all alike
    None,
    /// Grown: turned, of uneven size, irregularly spread; cyclic texels are bent by noise
    Natural,
    /// The same, more of it
    Wild,
    /// Planted: turned, of uneven size, in rows
    Orchard,
}

/// What a preset sets.
pub struct Preset {
    pub orientations: Orientations,
    pub scale: [f64; 2],
    pub displace: [f64; 3],
    pub arrangement: Arrangement,
    pub continuous: Option<Continuous>,
}

impl JitterPreset {
    /// `isolated`: of objects that do not go on from cell to cell.
    pub fn preset(self, isolated: bool, seed: u32) -> Preset {
        let rows = if matches!(self, JitterPreset::None | JitterPreset::Orchard) {
            Arrangement::Rows
        } else {
            Arrangement::Scattered
        };
        let alike = Preset {
            orientations: Orientations::Identity,
            scale: [1.0; 2],
            displace: [0.0; 3],
            arrangement: rows,
            continuous: None,
        };
        // Lattice cells of some three texels, so that neither grid is seen in the other.
        let noise = |strength: f64| Continuous {
            seed,
            frequency: [0.31, 0.31, 0.31],
            octaves: 2,
            uvw_amplitude: [0.35 * strength, 0.35 * strength, 0.0],
            height_tilt: 0.4 * strength,
            height_scale: 0.35 * strength,
        };
        match (self, isolated) {
            (JitterPreset::None, _) => alike,
            (JitterPreset::Natural | JitterPreset::Orchard, false) => Preset { continuous: Some(noise(1.0)), ..alike },
            (JitterPreset::Wild, false) => Preset { continuous: Some(noise(1.8)), ..alike },
            (JitterPreset::Natural, true) => {
                Preset { orientations: Orientations::W8, scale: [0.8, 1.0], displace: [0.1, 0.1, 0.0], ..alike }
            }
            (JitterPreset::Wild, true) => {
                Preset { orientations: Orientations::W8, scale: [0.5, 1.0], displace: [0.5, 0.5, 0.0], ..alike }
            }
            (JitterPreset::Orchard, true) => {
                Preset { orientations: Orientations::W8, scale: [0.9, 1.0], displace: [0.04, 0.04, 0.0], ..alike }
            }
        }
    }
}

/// Sets of turns and mirrorings.
#[derive(Clone, Copy, ValueEnum)]
pub enum Turns {
    Identity,
    W4,
    W8,
    Cube24,
    Cube48,
}

impl From<Turns> for Orientations {
    fn from(turns: Turns) -> Orientations {
        match turns {
            Turns::Identity => Orientations::Identity,
            Turns::W4 => Orientations::W4,
            Turns::W8 => Orientations::W8,
            Turns::Cube24 => Orientations::Cube24,
            Turns::Cube48 => Orientations::Cube48,
        }
    }
}

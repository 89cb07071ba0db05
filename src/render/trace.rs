//! What one pixel's rays met, for `--pixel x,y`.

/// Everything in the order in which it was met.
pub type Trace = Vec<TraceEvent>;

/// Lengths are metres along the ray, positions relative to the camera.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[serde(tag = "met", rename_all = "kebab-case")]
pub enum TraceEvent {
    /// The cone of one lane: unit direction, and its width at the start and a metre further.
    Cone { direction: [f64; 3], width: f64, growth: f64 },
    /// A layer of a shell's box.
    Box { index: u32, layer: u32, metres: [f64; 2] },
    /// A copy of a texel: the depth and number of its voxels that stopped light, transmittance before and after.
    Cell { texel: String, cell: [i64; 3], metres: [f64; 2], depth: Option<u8>, voxels: usize, before: f32, after: f32 },
    /// A copy of a texel whose source was traced instead of voxels.
    Near { texel: String, cell: [i64; 3], metres: [f64; 2], contacts: usize, before: f32, after: f32 },
    /// The opaque surface that ends the ray, and how much of the light comes from it.
    Surface { metres: f64, albedo: [f32; 3], normal: [f64; 3], through: f32 },
    /// A ray to a light: what it would bring, and the share that it does.
    Shadow { origin: [f64; 3], light: [f32; 3], seen: f32 },
    /// What the lane saw.
    Radiance { rgb: [f32; 3], alpha: f32 },
}

//! A record of what the rays of one pixel met, as the option `--pixel` prints it.

/// Everything in the order in which it was met.
pub type Trace = Vec<TraceEvent>;

/// Lengths are metres along the ray, positions relative to the camera.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[serde(tag = "met", rename_all = "kebab-case")]
pub enum TraceEvent {
    /// The cone of one lane.
    Cone {
        /// Unit.
        direction: [f64; 3],
        /// Width at the start, metres.
        width: f64,
        /// Growth of the width per metre.
        growth: f64,
    },
    /// A layer of a shell's box.
    Box {
        /// Number of the box in the scene; copies under affine maps are counted after the boxes.
        index: u32,
        /// Number of the layer in the box.
        layer: u32,
        /// Interval of the ray in the box.
        metres: [f64; 2],
    },
    /// A copy of a texel that was marched.
    Cell {
        /// Name of the texel.
        texel: String,
        /// Cell of the layer; for a rigid copy, its number comes first.
        cell: [i64; 3],
        /// Interval of the ray in the cell.
        metres: [f64; 2],
        /// Depth of the first voxel that stopped light; `None` where none did.
        depth: Option<u8>,
        /// Number of voxels that stopped light.
        voxels: usize,
        /// Transmittance before the copy.
        before: f32,
        /// Transmittance after the copy.
        after: f32,
    },
    /// A copy of a texel whose source was traced instead of voxels.
    Near {
        /// Name of the texel.
        texel: String,
        /// Cell of the layer; for a rigid copy, its number comes first.
        cell: [i64; 3],
        /// Interval of the ray in the cell.
        metres: [f64; 2],
        /// Number of triangles that stopped light.
        contacts: usize,
        /// Transmittance before the copy.
        before: f32,
        /// Transmittance after the copy.
        after: f32,
    },
    /// The opaque surface that ends the ray.
    Surface {
        /// Distance along the ray.
        metres: f64,
        /// Linear Rec. 709.
        albedo: [f32; 3],
        /// Unit, towards the viewer.
        normal: [f64; 3],
        /// Share of the cone's light that comes from it.
        through: f32,
    },
    /// A ray to a light.
    Shadow {
        /// Start, metres from the camera.
        origin: [f64; 3],
        /// Radiance that the light brings where nothing stands before it.
        light: [f32; 3],
        /// Share of it that arrives.
        seen: f32,
    },
    /// Result of the lane.
    Radiance {
        /// Linear Rec. 709.
        rgb: [f32; 3],
        /// Share that is not background.
        alpha: f32,
    },
}

//! Statistics of a render: counts of what its rays met, time by stage, memory.

use std::time::Duration;

use crate::march::transmittance::MarchStats;

/// Counts of one thread's rays, or of all together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Camera cones.
    pub cones: u64,
    /// Intervals of rays inside shells' boxes, and segments in affine copies.
    pub boxes: u64,
    /// Copies whose source's triangles were traced instead of voxels.
    pub near_copies: u64,
    /// Shadow rays towards lights.
    pub shadow_rays: u64,
    /// Cones towards the sky.
    pub sky_cones: u64,
    /// Marches of camera rays and shadow rays together.
    pub march: MarchStats,
}

impl Counts {
    /// Add the counts of another thread.
    pub fn merge(&mut self, other: &Counts) {
        self.cones += other.cones;
        self.boxes += other.boxes;
        self.near_copies += other.near_copies;
        self.shadow_rays += other.shadow_rays;
        self.sky_cones += other.sky_cones;
        self.march.merge(&other.march);
    }
}

/// Report of a render.
#[derive(Debug, Clone, Default)]
pub struct Stats {
    /// Counts of all threads together.
    pub counts: Counts,
    /// Boxes and affine copies in the scene.
    pub shell_boxes: u64,
    /// Those of them that are over bilinear patches.
    pub patches: u64,
    /// Bilinear patches that are collapsed or folded: two prisms each stand for them.
    pub split_patches: u64,
    /// Bytes that were read from `.vtex` files.
    pub bytes_read: u64,
    /// Size of the `.vtex` files, in bytes.
    pub bytes_in_files: u64,
    /// Decoded pages of voxels, each of up to 4096.
    pub bricks: u64,
    /// Voxels in the decoded pages.
    pub voxels: u64,
    /// Deepest depth of which voxels were decoded.
    pub deepest: usize,
    /// Triangles of texels' sources that were read for copies near the camera.
    pub near_triangles: u64,
    /// Stage and wall-clock time, in order.
    pub times: Vec<(&'static str, Duration)>,
    /// Most memory that the process has had, where the system tells.
    pub peak_bytes: Option<u64>,
}

/// The most memory that the process has had (Linux), in bytes.
pub fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<u64>().ok().map(|k| k * 1024)
}

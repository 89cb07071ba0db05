//! What a render did, as JSON and as lines: what was read, what rays met, in all and a pixel, and how long it took.

use serde::Serialize;
use serde_json::{Value, json};

use crate::render::Stats;
use crate::{Result, par};

/// What the rays of a pixel met, the mean of a picture's: camera and shadow rays together.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct PerPixel {
    /// Stretches in shells' boxes and in the boxes of rigid copies.
    pub boxes: f64,
    /// Copies of texels that were marched.
    pub copies: f64,
    /// Nodes of their trees that were crossed, and voxels met.
    pub cells: f64,
    pub voxels: f64,
    /// Copies traced as triangles.
    pub near_copies: f64,
    pub shadow_rays: f64,
    pub sky_cones: f64,
    /// Of a thread, without reading and set-up; by the clock, so only on a quiet machine what the work takes.
    pub microseconds: f64,
}

impl PerPixel {
    /// Of a picture of that size, made with the option `threads`.
    pub fn of(stats: &Stats, [width, height]: [u32; 2], threads: usize) -> PerPixel {
        let pixels = (f64::from(width) * f64::from(height)).max(1.0);
        let threads = if threads == 0 { par::threads() } else { threads };
        let c = &stats.counts;
        let tracing = stats.times.iter().find(|t| t.0 == "trace").map_or(0.0, |t| t.1.as_secs_f64());
        PerPixel {
            boxes: c.boxes as f64 / pixels,
            copies: c.march.segments as f64 / pixels,
            cells: c.march.cells as f64 / pixels,
            voxels: c.march.voxels as f64 / pixels,
            near_copies: c.near_copies as f64 / pixels,
            shadow_rays: c.shadow_rays as f64 / pixels,
            sky_cones: c.sky_cones as f64 / pixels,
            microseconds: 1e6 * tracing * threads as f64 / pixels,
        }
    }
}

/// As JSON.
pub fn described(stats: &Stats, pixel: &PerPixel) -> Value {
    let c = &stats.counts;
    let times: serde_json::Map<_, _> =
        stats.times.iter().map(|(name, t)| (name.replace([' ', '-'], "_"), t.as_secs_f64().into())).collect();
    json!({
        "bytes_read": stats.bytes_read,
        "bytes_in_files": stats.bytes_in_files,
        "bricks_decoded": stats.bricks,
        "voxels_decoded": stats.voxels,
        "deepest_depth": stats.deepest,
        "shell_boxes": stats.shell_boxes,
        "patches": stats.patches,
        "split_patches": stats.split_patches,
        "cones": c.cones,
        "boxes_entered": c.boxes,
        "copies_marched": c.march.segments,
        "cells_marched": c.march.cells,
        "voxels_met": c.march.voxels,
        "near_copies": c.near_copies,
        "near_triangles": stats.near_triangles,
        "shadow_rays": c.shadow_rays,
        "sky_cones": c.sky_cones,
        "per_pixel": pixel,
        "seconds": times,
        "peak_bytes": stats.peak_bytes,
    })
}

/// As lines on stdout.
pub fn print_stats(stats: &Stats, pixel: &PerPixel) -> Result<()> {
    let c = &stats.counts;
    let share = 100.0 * stats.bytes_read as f64 / (stats.bytes_in_files.max(1)) as f64;
    let row = |name: &str, value: String| outln!("{name:<16} {value}");
    row("bytes read", format!("{} of {} in the texels' files ({share:.1} %)", stats.bytes_read, stats.bytes_in_files))?;
    row("bricks decoded", format!("{}, {} voxels, down to depth {}", stats.bricks, stats.voxels, stats.deepest))?;
    row("boxes entered", format!("{} of {} in the scene", c.boxes, stats.shell_boxes))?;
    if stats.patches + stats.split_patches > 0 {
        let split = stats.split_patches;
        row("patches", format!("{} bilinear, and {split} collapsed or folded ones as two prisms", stats.patches))?;
    }
    row(
        "cells marched",
        format!("{} in {} copies of texels, {} voxels met", c.march.cells, c.march.segments, c.march.voxels),
    )?;
    let (copies, triangles) = (c.near_copies, stats.near_triangles);
    row("near", format!("{copies} copies traced as triangles of their source, of which {triangles} were read"))?;
    row("cones", c.cones.to_string())?;
    row("shadow rays", c.shadow_rays.to_string())?;
    row("sky cones", c.sky_cones.to_string())?;
    let PerPixel { boxes, copies, cells, voxels, shadow_rays, microseconds, .. } = pixel;
    row(
        "a pixel",
        format!(
            "{boxes:.1} boxes, {copies:.1} copies, {cells:.0} cells, {voxels:.1} voxels, {shadow_rays:.2} shadow rays; {microseconds:.2} µs of a thread"
        ),
    )?;
    let times: Vec<_> = stats.times.iter().map(|(name, t)| format!("{name} {:.2}", t.as_secs_f64())).collect();
    row("seconds", times.join(", "))?;
    if let Some(peak) = stats.peak_bytes {
        row("peak memory", format!("{:.1} MiB", peak as f64 / f64::from(1 << 20)))?;
    }
    Ok(())
}

//! `vtex render --pixel`: what the rays of one pixel met, a line each.

use super::ui::put_json;
use crate::Result;
use crate::render::TraceEvent;

/// Print it, as lines or as JSON.
///
/// # Errors
/// `Io` where it cannot be written.
pub fn print(trace: &[TraceEvent], json: bool) -> Result<()> {
    if json {
        return put_json(&trace);
    }
    for met in trace {
        match met {
            TraceEvent::Cone { direction: [x, y, z], width, growth } => {
                outln!("cone      along {x:.4} {y:.4} {z:.4}, {width:.3e} m wide, growing {growth:.3e} a metre")?;
            }
            TraceEvent::Box { index, layer, metres: [a, b] } => {
                outln!("box       {index}, layer {layer}: {a:.4} … {b:.4} m")?;
            }
            TraceEvent::Cell { texel, cell: [u, v, w], metres: [a, b], depth, voxels, before, after } => {
                let depth = depth.map_or("nothing".into(), |d| format!("{voxels} voxels at depth {d}"));
                outln!(
                    "  copy    {texel} in cell {u} {v} {w}: {a:.4} … {b:.4} m, {depth}, T {before:.4} → {after:.4}"
                )?;
            }
            TraceEvent::Near { texel, cell: [u, v, w], metres: [a, b], contacts, before, after } => outln!(
                "  near    {texel} in cell {u} {v} {w}: {a:.4} … {b:.4} m, {contacts} triangles, T {before:.4} → {after:.4}"
            )?,
            TraceEvent::Surface { metres, albedo: [r, g, b], normal: [x, y, z], through } => outln!(
                "surface   at {metres:.4} m, albedo {r:.3} {g:.3} {b:.3}, normal {x:.3} {y:.3} {z:.3}, {through:.4} of the light"
            )?,
            TraceEvent::Shadow { origin: [x, y, z], light: [r, g, b], seen } => {
                outln!("  shadow  from {x:.3} {y:.3} {z:.3}: {seen:.4} of {r:.4} {g:.4} {b:.4}")?;
            }
            TraceEvent::Radiance { rgb: [r, g, b], alpha } => {
                outln!("radiance  {r:.5} {g:.5} {b:.5}, alpha {alpha:.4}")?
            }
        }
    }
    Ok(())
}

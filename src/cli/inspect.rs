//! `vtex inspect`: what a file holds, depth by depth and channel by channel; reads the head alone, but for a preview.

use std::path::PathBuf;

use serde_json::{Value, json};

use super::download::{self, DownloadArgs, Need};
#[cfg(feature = "render")]
use super::outputs;
use super::quantity::size;
use super::results::{each, shown};
use super::text::one_line;
use super::ui::Ui;
use crate::Result;
use crate::format::{Channel, Head, Limits, Reader, StreamEntry};
use crate::scene::files::hex;
use crate::volume::material::SHARE_SUM;
use crate::volume::octree::Pages;

/// Print what is in .vtex files
#[derive(clap::Args)]
pub struct Args {
    /// The .vtex files, or URLs of such
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Print JSON instead of tables
    #[arg(long)]
    json: bool,
    /// Also write a PNG with three lit views (front, side, top) and slices through the middle below them
    #[cfg(feature = "render")]
    #[arg(long, value_name = "PNG")]
    preview: Option<PathBuf>,
    /// Width of each of the preview's six pictures, in pixels
    #[cfg(feature = "render")]
    #[arg(long, value_name = "PIXELS", default_value_t = 400, requires = "preview")]
    preview_size: usize,
    // Last: what stands below a heading stays below it.
    #[command(flatten)]
    download: DownloadArgs,
}

impl Args {
    fn need(&self) -> Need {
        #[cfg(feature = "render")]
        if self.preview.is_some() {
            return Need::Depths;
        }
        Need::Head
    }
}

pub fn run(mut args: Args, ui: &Ui) -> Result<()> {
    #[cfg(feature = "render")]
    {
        if args.preview.is_some() && args.files.len() > 1 {
            return Err(crate::Error::Options("--preview is of one file; inspect the others by themselves".into()));
        }
        outputs::check(&args.files, args.preview.as_deref())?;
    }
    let need = args.need();
    let _downloads = download::local(&mut args.files, need, &args.download, ui)?;
    let mut first = true;
    each(&args.files, args.json, ui, |path| {
        let reader = Reader::open_prefix(path, &Limits { decoded_bytes: u64::MAX })?;
        ui.warn(&reader.warnings())?;
        let found = if args.json { describe(&reader) } else { Value::Null };
        if !args.json {
            let gap = if std::mem::take(&mut first) { "" } else { "\n" };
            out!("{gap}{}", tables(&reader))?;
        }
        #[cfg(feature = "render")]
        if let Some(png) = &args.preview {
            let tree = crate::volume::Octree::new(reader)?;
            let sheet = crate::render::preview::preview(tree, args.preview_size)?;
            crate::render::image_io::write_png(png, sheet.width, sheet.height, &sheet.rgb)?;
        }
        Ok(found)
    })
}

/// Bits that `bytes` are for each of `voxels`; 0 for an empty texel.
fn bits_per(bytes: u64, voxels: u64) -> f64 {
    if voxels == 0 { 0.0 } else { 8.0 * bytes as f64 / voxels as f64 }
}

fn finest(head: &Head) -> u64 {
    head.depths.last().map_or(0, |d| d.nodes)
}

/// Share of the cells of depth `d` that `nodes` are.
fn occupancy(d: usize, nodes: u64) -> f64 {
    nodes as f64 / libm::exp2(3.0 * d as f64)
}

/// The certificate's entry of a depth, if the bake left one.
fn depth_error(head: &Head, d: usize) -> Option<&Value> {
    head.info.meta.get("error")?.get("depths")?.get(d).filter(|error| !error.is_null())
}

/// Values that a code may have; of materials, those of a share.
fn steps(stream: &StreamEntry) -> u16 {
    if stream.channel() == Some(Channel::Material) { u16::from(SHARE_SUM) + 1 } else { stream.quant_max + 1 }
}

fn describe(reader: &Reader) -> Value {
    let (head, finest) = (reader.head(), finest(reader.head()));
    let info = reader.info();
    let up = ["x", "y", "z"].get(usize::from(info.up));
    let depths = head.depths.iter().zip(head.depth_sizes()).enumerate().map(|(d, (depth, bytes))| {
        json!({
            "depth": d, "resolution": 1u64 << d, "voxels": depth.nodes, "inner": depth.internal, "bytes": bytes,
            "occupancy": occupancy(d, depth.nodes), "prefix_bytes": depth.block_end, "whole": d < reader.whole_depths(),
            "error": depth_error(head, d),
        })
    });
    let streams = head
        .streams
        .iter()
        .map(|s| json!({ "steps": steps(s), "max_abs_error": s.max_abs_error, "constant": s.is_constant() }));
    let mut channels = vec![];
    let details = std::iter::once(json!({})).chain(streams);
    for ((name, bytes), mut detail) in head.channel_sizes().into_iter().zip(details) {
        if let Some(map) = detail.as_object_mut() {
            map.insert("name".into(), name.into());
            map.insert("bytes".into(), bytes.into());
            map.insert("bits_per_finest_voxel".into(), bits_per(bytes, finest).into());
        }
        channels.push(detail);
    }
    json!({
        "input": shown(reader.path()),
        "resolution": head.resolution(),
        "model": info.model,
        "file_bytes": reader.file_bytes(),
        "head_bytes": head.depths.first().map_or(0, |d| d.block_offset),
        "finest_voxels": finest,
        "voxels": head.depths.iter().map(|d| d.nodes).sum::<u64>(),
        "bits_per_finest_voxel": bits_per(reader.file_bytes(), finest),
        "bounds": { "min": info.bounds.min.to_array(), "max": info.bounds.max.to_array() },
        "content": { "min": info.content.min.to_array(), "max": info.content.max.to_array() },
        "metres_per_unit": info.metres_per_unit,
        "up": up,
        "cyclic": info.cyclic,
        "facet_size": info.facet_size,
        "content_id": hex(head.content_id()),
        "depths": depths.collect::<Vec<_>>(),
        "channels": channels,
        "materials": info.materials,
        "meta": info.meta,
    })
}

fn tables(reader: &Reader) -> String {
    let (head, info, finest) = (reader.head(), reader.info(), finest(reader.head()));
    let mut out = String::new();
    let mut line = |text: String| {
        out.push_str(text.trim_end());
        out.push('\n');
    };
    let n = head.resolution();
    let model = serde_json::to_value(info.model).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default();
    line(format!("{}: {n}^3, model {model}, {}", reader.path().display(), size(reader.file_bytes())));
    let metres = match info.metres_per_unit {
        0.0 => "unknown scale".to_owned(),
        m => format!("{} m in the file's unit, voxel {} m", number(m), number(m * info.bounds.size().x / f64::from(n))),
    };
    line(format!("  bounds      {} to {}, {metres}", corner(info.bounds.min), corner(info.bounds.max)));
    line(format!("  content     {} to {} of the cube", corner(info.content.min), corner(info.content.max)));
    let axes: String = "uvw".chars().zip(info.cyclic).filter(|(_, c)| *c).map(|(a, _)| a).collect();
    line(format!("  cyclic      {}", if axes.is_empty() { "no" } else { &axes }));
    line(format!("  facet size  {}", number(info.facet_size)));
    line(format!("  content id  {}", hex(head.content_id())));
    for (key, value) in info.meta.iter().filter(|(key, _)| *key != "error") {
        line(format!("  {:<11} {}", one_line(key), brief(value)));
    }
    for (i, m) in info.materials.iter().enumerate() {
        let key = if i == 0 { "materials" } else { "" };
        let [r, g, b] = m.albedo.map(number);
        line(format!("  {key:<11} {:>5}%  {}, albedo {r} {g} {b}", number(100.0 * m.share), one_line(&m.name)));
    }
    let with_error = (0..head.depths.len()).any(|d| depth_error(head, d).is_some());
    let heading = if with_error { "error" } else { "" };
    line(format!("\n  depth  voxels a side      voxels  occupancy       bytes  bytes so far  {heading}"));
    for (d, (depth, bytes)) in head.depths.iter().zip(head.depth_sizes()).enumerate() {
        let error = depth_error(head, d).map(brief).unwrap_or_default();
        let share = 100.0 * occupancy(d, depth.nodes);
        let row = format!("  {d:>5}  {:>13}  {:>10}  {:>8}%", 1u64 << d, depth.nodes, number(share));
        line(format!("{row}  {bytes:>10}  {:>12}  {error}", depth.block_end));
    }
    line("\n  channel                bytes  bits per finest voxel  steps  largest error".into());
    let streams = std::iter::once(None).chain(head.streams.iter().map(Some));
    for ((name, bytes), stream) in head.channel_sizes().into_iter().zip(streams) {
        let row = format!("  {name:<17} {bytes:>10}  {:>21.2}", bits_per(bytes, finest));
        line(match stream {
            None => row,
            Some(s) if s.is_constant() => format!("{row}  constant"),
            Some(s) => format!("{row}  {:>5}  {:>13}", steps(s), number(f64::from(s.max_abs_error))),
        });
    }
    let all = bits_per(reader.file_bytes(), finest);
    line(format!("  {:<17} {:>10}  {all:>21.2}", "the whole file", reader.file_bytes()));
    out
}

/// Four significant digits.
fn number(v: f64) -> String {
    if v == 0.0 {
        return "0".into();
    }
    let digits = 3 - v.abs().log10().floor().clamp(-12.0, 12.0) as i32;
    let text = format!("{v:.*}", digits.max(0) as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

fn corner(p: crate::geom::DVec3) -> String {
    format!("({}, {}, {})", number(p.x), number(p.y), number(p.z))
}

/// A META value in one line: numbers short, an object as `key value` pairs, long texts cut.
fn brief(value: &Value) -> String {
    const LONGEST: usize = 100;
    let text = match value {
        Value::String(text) => one_line(text).into_owned(),
        Value::Number(n) => n.as_f64().map(number).unwrap_or_default(),
        Value::Array(items) => items.iter().map(brief).collect::<Vec<_>>().join("; "),
        Value::Object(map) => {
            map.iter().map(|(key, v)| format!("{} {}", one_line(key), brief(v))).collect::<Vec<_>>().join(", ")
        }
        other => other.to_string(),
    };
    match text.char_indices().nth(LONGEST) {
        Some((cut, _)) => format!("{} …", &text[..cut]),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_four_digits() {
        let samples =
            [(0.0, "0"), (1.0, "1"), (12345.678, "12346"), (0.012345, "0.01235"), (-2.5, "-2.5"), (100.0, "100")];
        for (v, text) in samples {
            assert_eq!(number(v), text);
        }
    }
}

//! A bench's points as a table, as CSV and as plots.

use std::path::Path;

use super::points::Point;
use super::summary;
use super::texels::Texel;
use crate::bake::REFINE;
use crate::cli::plot;
use crate::cli::plot::{Axis, Chart, Scale, Series};
use crate::{Result, format};

/// `bench.csv`, `bench.md`, `bench.svg` and `bench.png` in `folder`.
pub fn write(folder: &Path, points: &[Point], texels: &[Texel]) -> Result<()> {
    let has_peer = points.iter().any(|p| p.kind == "peer");
    let tables = if has_peer { summary::beside_peer(points) } else { summary::markdown(points, texels) };
    for (name, text) in [("bench.csv", csv(points)), ("bench.md", tables)] {
        let path = folder.join(name);
        format::save(path, text.as_bytes())?;
    }
    let charts = charts(points);
    ["bench.svg", "bench.png"].iter().try_for_each(|name| plot::write(&folder.join(name), &charts, 3))
}

fn csv(points: &[Point]) -> String {
    let mut out = String::from(
        "scene,kind,model,resolution,refine,light,lanes,depth_bias,shadow_bias,near,samples,seconds,cpu_seconds,flip,rmse,bias,area,reference_noise,setup_cpu,boxes,copies,cells,voxels,shadow_rays,microseconds\n",
    );
    for p in points {
        out += &format!(
            "{},{},{},{},{},{},{},{},{},{},{},{:.3},{:.2},{:.5},{:.6},{:.5},{:.5},{:.5},{:.2},{:.2},{:.2},{:.1},{:.2},{:.3},{:.2}\n",
            p.scene,
            p.kind,
            p.model,
            p.resolution,
            p.refine,
            p.light,
            p.lanes,
            p.depth_bias,
            p.shadow_bias,
            p.near,
            p.samples,
            p.seconds,
            p.cpu_seconds,
            p.flip,
            p.rmse,
            p.bias,
            p.area,
            p.noise,
            p.setup_cpu,
            p.per_pixel.boxes,
            p.per_pixel.copies,
            p.per_pixel.cells,
            p.per_pixel.voxels,
            p.per_pixel.shadow_rays,
            p.per_pixel.microseconds
        );
    }
    out
}

/// A scene each: time against FLIP of pictures; then one of all bakes.
fn charts(points: &[Point]) -> Vec<Chart> {
    let mut scenes: Vec<&str> = points.iter().map(|p| p.scene).collect();
    scenes.dedup();
    let axis = |label: &str| Axis { label: label.into(), scale: Scale::Log };
    let series = |name: &str, line: bool, of: &dyn Fn(&&Point) -> bool| {
        let mut list: Vec<(f64, f64)> = points.iter().filter(of).map(|p| (p.time(), p.flip)).collect();
        list.sort_by(|a, b| a.0.total_cmp(&b.0));
        Series { name: name.into(), points: list, line }
    };
    let mut charts: Vec<Chart> = scenes
        .iter()
        .map(|&scene| {
            let render = |p: &&Point, model: &str| {
                p.scene == scene && p.kind == "render" && p.light == "all" && p.model == model
            };
            let plain = |p: &Point| p.depth_bias == 0.0 && p.shadow_bias == 0.0 && p.refine == REFINE && !p.near;
            let whole = points.iter().filter(|p| p.scene == scene).map(|p| p.resolution).max().unwrap_or(0);
            let mut chart = Chart {
                title: scene.into(),
                x: axis("CPU seconds"),
                y: axis("FLIP"),
                series: vec![
                    series("lanes", true, &|p| render(p, "coverage") && plain(p) && p.resolution == whole),
                    series("triangles where near", true, &|p| render(p, "coverage") && p.near),
                    series("other depths, other shadows", false, &|p| {
                        render(p, "coverage") && (p.depth_bias != 0.0 || p.shadow_bias != 0.0)
                    }),
                    series("coarser, or refined otherwise", false, &|p| {
                        render(p, "coverage") && (p.resolution != whole || p.refine != REFINE)
                    }),
                    series("model of 1996", false, &|p| render(p, "neyret")),
                    series("averaged SGGX", false, &|p| render(p, "density")),
                    series("triangles, 1 to 64 rays", true, &|p| p.scene == scene && p.kind == "reference"),
                    series("another tracer", true, &|p| p.scene == scene && p.kind == "peer"),
                ],
                aims: vec![0.03, 0.035],
            };
            chart.series.retain(|series| !series.points.is_empty());
            chart
        })
        .collect();
    let bakes = |scene: &&str| series(scene, true, &|p| p.scene == *scene && p.kind == "bake" && p.model == "coverage");
    if !points.iter().any(|p| p.kind == "bake") {
        return charts;
    }
    charts.push(Chart {
        title: "bakes: resolutions".into(),
        x: axis("CPU seconds of the bake"),
        y: axis("FLIP of the picture"),
        series: scenes.iter().map(bakes).collect(),
        aims: Vec::new(),
    });
    charts
}

/// What stands out of each scene.
pub fn table(points: &[Point]) -> String {
    let mut out = format!(
        "{:13} {:10} {:10} {:>5} {:>6} {:>8} {:>5} {:>5} {:>6} {:>5} {:>7}  {:>8} {:>8}  {:>7} {:>8} {:>8} {:>7}\n",
        "scene",
        "kind",
        "model",
        "r",
        "refine",
        "light",
        "lanes",
        "bias",
        "shadow",
        "near",
        "samples",
        "s",
        "CPU s",
        "FLIP",
        "RMSE",
        "bright",
        "area"
    );
    let mut last = "";
    for p in points {
        if p.scene != last && !last.is_empty() {
            out.push('\n');
        }
        last = p.scene;
        out += &format!(
            "{:13} {:10} {:10} {:>5} {:>6} {:>8} {:>5} {:>5} {:>6} {:>5} {:>7}  {:>8.2} {:>8.2}  {:>7.4} {:>8.5} {:>+7.2}% {:>7.4}\n",
            p.scene,
            p.kind,
            p.model,
            p.resolution,
            p.refine,
            p.light,
            p.lanes,
            p.depth_bias,
            p.shadow_bias,
            if p.near { "yes" } else { "no" },
            p.samples,
            p.seconds,
            p.cpu_seconds,
            p.flip,
            p.rmse,
            100.0 * p.bias,
            p.area
        );
    }
    out
}

#[cfg(test)]
pub mod tests {
    use super::*;

    pub fn point(kind: &'static str, cpu_seconds: f64) -> Point {
        Point {
            scene: "tree",
            kind,
            model: "coverage",
            resolution: 64,
            refine: REFINE,
            light: "all",
            lanes: 1,
            depth_bias: 0.0,
            shadow_bias: 0.0,
            near: false,
            samples: 0,
            seconds: 2.0,
            cpu_seconds,
            flip: 0.03,
            rmse: 0.01,
            bias: 0.0,
            area: 1.0,
            noise: 0.005,
            setup_cpu: 0.0,
            per_pixel: Default::default(),
        }
    }

    #[test]
    fn points_are_written_and_drawn() {
        let dir = tempfile::tempdir().unwrap();
        let points = [point("render", 1.0), point("bake", 0.0)];
        write(dir.path(), &points, &[]).unwrap();
        let text = std::fs::read_to_string(dir.path().join("bench.csv")).unwrap();
        assert_eq!(text.lines().count(), 3);
        assert_eq!(text.lines().next().unwrap().split(',').count(), text.lines().nth(1).unwrap().split(',').count());
        assert!(dir.path().join("bench.svg").exists() && dir.path().join("bench.png").exists());
        assert_eq!((points[0].time(), points[1].time()), (1.0, 2.0));
        assert!(table(&points).contains("tree"));
    }
}

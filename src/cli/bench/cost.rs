//! What a picture costs by the number of trees, the faces of the ground, pixels and lanes: CPU seconds, plots, fitted exponents.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::context::{Bench, timed};
use super::made::{Made, Recipe};
use super::scenes::Layout;
use crate::cli::Ui;
use crate::cli::plot::{self, Axis, Chart, Scale, Series};
use crate::cli::results::print;
use crate::progress::Quiet;
use crate::render::{Options, SourceLod, render};
use crate::scene::gltf;
use crate::{Error, Result, format, par};

/// One picture.
#[derive(Debug, Clone, Serialize)]
struct Cost {
    /// What is varied: `trees`, `faces`, `pixels`, or `lanes`.
    by: &'static str,
    n: f64,
    /// CPU seconds of reading the landscape, of what comes before the first ray, and of the rays.
    read: f64,
    setup: f64,
    trace: f64,
}

/// What is varied, and what is seen.
const ABOUT: [(&str, &str); 4] = [
    ("trees", "trees, each a shell of its own, all in view"),
    ("faces", "faces of the ground, 1 369 trees in one shell over it"),
    ("pixels", "pixels, 10 000 trees"),
    ("lanes", "lanes, 10 000 trees"),
];
/// Voxels along a side of the tree's texel.
const RESOLUTION: u32 = 128;
/// CPU seconds that a time is the mean of at the least, as a tick is a hundredth of one.
const LEAST: f64 = 0.25;

/// CPU seconds below which a fit would be one of ticks.
const TOLD: f64 = 0.02;

/// Measure, print and write `cost.csv`, `cost.svg` and `cost.png` into `folder`.
pub fn run(folder: &Path, (quick, threads): (bool, usize), json: bool, ui: &Ui) -> Result<()> {
    let size = if quick { [192, 108] } else { [384, 216] };
    let bench = Bench { folder, size, samples: 0, quick, ui };
    let costs = par::with_threads(threads, || bench.costs())??;
    ui.finish();
    let mut text = String::from("by,n,read_cpu_seconds,setup_cpu_seconds,trace_cpu_seconds\n");
    for c in &costs {
        text += &format!("{},{},{:.4},{:.4},{:.4}\n", c.by, c.n, c.read, c.setup, c.trace);
    }
    let path = folder.join("cost.csv");
    format::save(&path, text.as_bytes())?;
    let charts = ABOUT.map(|(by, about)| chart(by, about, &costs));
    ["cost.svg", "cost.png"].iter().try_for_each(|name| plot::write(&folder.join(name), &charts, 2))?;
    let fits: Vec<_> = ABOUT.iter().flat_map(|(by, _)| fits(by, &costs)).collect();
    if json {
        let fits: Vec<_> =
            fits.iter().map(|(by, of, e)| serde_json::json!({"by": by, "of": of, "exponent": e})).collect();
        print(serde_json::json!({ "size": size, "costs": costs, "exponents": fits }), true, ui)?;
    } else {
        outln!("{:>8} {:>10} {:>10} {:>10} {:>10}", "by", "n", "read s", "set-up s", "picture s")?;
        for c in &costs {
            outln!("{:>8} {:>10} {:>10.3} {:>10.3} {:>10.3}", c.by, c.n, c.read, c.setup, c.trace)?;
        }
        for (by, of, exponent) in &fits {
            outln!("{of} grows as {by}^{exponent:.2} over the larger half")?;
        }
    }
    ui.say(&format!("{}: cost.csv, cost.svg, cost.png", folder.display()));
    Ok(())
}

impl Bench<'_> {
    fn costs(&self) -> Result<Vec<Cost>> {
        let source = self.sample("tree.glb")?;
        let (texel, _) = self.baked(&source, Recipe::plain(RESOLUTION))?;
        let of = (texel.as_path(), source.as_path());
        let mut costs = Vec::new();
        for side in [1, 3, 10, 32, 100, 178, 316, 1000].into_iter().filter(|&side| !self.quick || side <= 316) {
            let made = self.landscape(&format!("trees-{side}"), &trees(side), of)?;
            costs.push(self.cost("trees", f64::from(side * side), &made, 1, self.size)?);
        }
        for side in [1, 4, 16, 64, 256, 707].into_iter().filter(|&side| !self.quick || side <= 256) {
            let wide = 10.0 * f64::from(CELLS);
            let layout =
                Layout::Cut { side, cells: CELLS, eye: [0.0, 0.21 * wide + 60.0, 0.8 * wide], target: [0.0; 3] };
            let made = self.landscape(&format!("faces-{side}"), &layout, of)?;
            costs.push(self.cost("faces", f64::from(2 * side * side), &made, 1, self.size)?);
        }
        let made = self.landscape("trees-100", &trees(100), of)?;
        for k in [1, 2, 4, 8, 16].into_iter().filter(|&k| !self.quick || k <= 8) {
            let size = [80 * k, 45 * k];
            costs.push(self.cost("pixels", f64::from(size[0] * size[1]), &made, 1, size)?);
        }
        for lanes in [1, 2, 4, 8, 16] {
            costs.push(self.cost("lanes", f64::from(lanes), &made, lanes, self.size)?);
        }
        Ok(costs)
    }

    /// A landscape that is there is not made again.
    fn landscape(&self, name: &str, layout: &Layout, of: (&Path, &Path)) -> Result<(PathBuf, Layout)> {
        let path = self.folder.join(format!("cost-{name}.gltf"));
        if !path.exists() {
            self.laid(&format!("cost-{name}"), layout, of, &path)?;
        }
        Ok((path, *layout))
    }

    fn cost(
        &self,
        by: &'static str,
        n: f64,
        (path, layout): &(PathBuf, Layout),
        lanes: u32,
        size: [u32; 2],
    ) -> Result<Cost> {
        self.ui.say(&format!("{n} {by}"));
        let mut sums = [0.0; 3];
        let mut times = 0.0;
        // Once at the least.
        while times == 0.0 || sums.iter().sum::<f64>() < LEAST {
            let ([_, read], scene) = timed(|| gltf::read(path, &gltf::ReadOptions::default()));
            let made = Made { scene: scene?, path: path.clone(), texel: PathBuf::new(), bake: [0.0; 2] };
            let options = Options { lanes, size, source_lod: SourceLod::Voxels, ..self.options(layout, &made)? };
            let ([_, cpu], done) = timed(|| render(&made.scene, &options, &Quiet));
            let stages = done?.stats.times;
            let share = |name: &str| stages.iter().find(|t| t.0 == name).map_or(0.0, |t| t.1.as_secs_f64());
            let before = share("prepare") / (share("prepare") + share("trace")).max(1e-9);
            sums = [sums[0] + read, sums[1] + cpu * before, sums[2] + cpu * (1.0 - before)];
            times += 1.0;
            if cpu == 0.0 && times >= 1000.0 {
                return Err(Error::Options("this system does not tell CPU seconds, which --cost is of".into()));
            }
        }
        let [read, setup, trace] = sums.map(|sum| sum / times);
        Ok(Cost { by, n, read, setup, trace })
    }
}

/// Cells along a side of the ground whose faces are counted.
const CELLS: u32 = 37;

/// `side`^2 trees on flat ground, all of which are seen.
fn trees(side: u32) -> Layout {
    let wide = 6.0 * f64::from(side);
    let eye = [0.0, 0.21 * wide + 10.0, 0.8 * wide + 15.0];
    Layout::Stands { side, rigid: false, hilly: false, eye, target: [0.0, 3.0, -0.06 * wide] }
}

/// What is measured of a picture: a name, and where it stands.
type Stage = (&'static str, fn(&Cost) -> f64);
const STAGES: [Stage; 3] = [("reading", |c| c.read), ("set-up", |c| c.setup), ("picture", |c| c.trace)];

fn chart(by: &str, about: &str, costs: &[Cost]) -> Chart {
    let axis = |label: &str| Axis { label: label.into(), scale: Scale::Log };
    let series = |(name, of): Stage| {
        let points = costs.iter().filter(|c| c.by == by).map(|c| (c.n, of(c))).collect();
        Series { name: name.into(), points, line: true }
    };
    Chart {
        title: about.into(),
        x: axis(by),
        y: axis("CPU seconds"),
        series: STAGES.into_iter().map(series).collect(),
        aims: Vec::new(),
    }
}

/// The exponents of what grows, by the larger half of what is varied, and there by what takes no less than [`TOLD`].
fn fits<'a>(by: &'a str, costs: &[Cost]) -> Vec<(&'a str, &'static str, f64)> {
    let own: Vec<&Cost> = costs.iter().filter(|c| c.by == by).collect();
    let larger = &own[own.len() / 2..];
    let fit = |(name, of): Stage| {
        let told = larger.iter().filter(|c| of(c) >= TOLD);
        let points: Vec<(f64, f64)> = told.map(|c| (c.n.ln(), of(c).ln())).collect();
        slope(&points).map(|exponent| (by, name, exponent))
    };
    STAGES.into_iter().filter_map(fit).collect()
}

/// Of the straight line through points that leaves the least squares; `None` where there is none.
fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let n = points.len() as f64;
    let (x, y) = points.iter().fold((0.0, 0.0), |(x, y), p| (x + p.0 / n, y + p.1 / n));
    let (up, across) =
        points.iter().fold((0.0, 0.0), |(a, b), p| (a + (p.0 - x) * (p.1 - y), b + (p.0 - x) * (p.0 - x)));
    (across > 0.0).then(|| up / across)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents_are_those_of_powers() {
        let cost = |n: f64| Cost { by: "trees", n, read: 0.0, setup: 3.0 * n, trace: 5.0 * n.sqrt() };
        let costs = [1.0, 10.0, 100.0, 1000.0].map(cost);
        // Reading takes nothing that is told.
        let found = fits("trees", &costs);
        // Rounding of logarithms is all that is between.
        let near = |k: usize, of: &str, e: f64| found[k].1 == of && (found[k].2 - e).abs() < 1e-12;
        assert!(found.len() == 2 && near(0, "set-up", 1.0) && near(1, "picture", 0.5), "{found:?}");
        assert_eq!(slope(&[(1.0, 2.0)]), None);
        assert_eq!(chart("trees", "trees", &costs).series[2].points[1], (10.0, 5.0 * 10f64.sqrt()));
    }
}

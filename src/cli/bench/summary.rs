//! The few figures of a bench that decide, as tables to be quoted.

use super::points::Point;
use super::texels::Texel;
use crate::bake::REFINE;

/// Pictures of lanes beside those of a peer, and the peer's time for the same error over ours; in Markdown.
pub fn beside_peer(points: &[Point]) -> String {
    let mut out = String::from(
        "| FLIP in CPU seconds | 1 lane | 2 lanes | 4 lanes | peer, samples a pixel | peer's time at the FLIP of 1, 2, 4 lanes, over ours | peer's build | noise of the reference |\n|---|---|---|---|---|---|---|---|\n",
    );
    let mut scenes: Vec<&str> = points.iter().filter(|p| p.kind == "peer").map(|p| p.scene).collect();
    scenes.dedup();
    for scene in scenes {
        let of = Of { points, scene };
        let lanes = [1, 2, 4].map(|n| of.render("coverage", move |p| p.lanes == n && p.near));
        let ratios = lanes.map(|p| {
            let time = p.and_then(|p| Some(of.traced("peer", p.flip)? / p.time().max(0.005)));
            time.map_or("–".into(), |t| format!("{t:.2}"))
        });
        let peers: Vec<&Point> = of.all().filter(|p| p.kind == "peer").collect();
        let samples: Vec<String> =
            peers.iter().map(|p| format!("{}: {:.4} in {:.2}", p.samples, p.flip, p.time())).collect();
        out += &format!(
            "| {scene} | {} | {} | {:.2} | {:.4} |\n",
            lanes.map(shown).join(" | "),
            [samples.join("; "), ratios.join(", ")].join(" | "),
            peers.last().map_or(0.0, |p| p.setup_cpu),
            peers.last().map_or(0.0, |p| p.noise),
        );
    }
    out
}

/// A table of pictures, of causes of error, and of texels; in Markdown.
pub fn markdown(points: &[Point], texels: &[Texel]) -> String {
    let mut scenes: Vec<&str> = points.iter().map(|p| p.scene).collect();
    scenes.dedup();
    let mut out = String::from(
        "| FLIP in CPU seconds | 1 lane | 4 lanes | with triangles, 1 and 4 lanes | averaged SGGX | model of 1996 | its error over ours (RMSE) | triangles: FLIP of 1 lane takes | of 4 lanes | noise of the reference |\n|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for scene in &scenes {
        out += &row(&Of { points, scene });
    }
    if points.iter().any(|p| p.light != "all") {
        out += "\n| FLIP, 1 and 4 lanes | all | without shadows | constant sky only | area |\n|---|---|---|---|---|\n";
        for scene in &scenes {
            let of = Of { points, scene };
            let flip = |light: &str| {
                let both = [1, 4].map(|lanes| of.render("coverage", |p| p.light == light && p.lanes == lanes));
                both.map(|p| p.map_or("–".into(), |p| format!("{:.4}", p.flip))).join(", ")
            };
            let area = of.render("coverage", |p| p.light == "all" && p.lanes == 4).map_or(0.0, |p| p.area);
            out += &format!("| {scene} | {} | {} | {} | {area:.4} |\n", flip("all"), flip("shadows"), flip("sky"));
        }
    }
    if !texels.is_empty() {
        out += "\n| texel | depth | \\|ΔT\\| at pixel = voxel | at 4 voxels | area | sigma | albedo | light | steps of brightness |\n|---|---|---|---|---|---|---|---|---|\n";
    }
    for texel in texels {
        let steps: Vec<String> = texel.steps.iter().map(|s| format!("{:+.2} %", 100.0 * s)).collect();
        let steps = steps.join(", ");
        let name = format!("{} {}", texel.scene, texel.resolution);
        if texel.depths.is_empty() {
            out += &format!("| {name} | | | | | | | | {steps} |\n");
        }
        for d in texel.depths.iter().rev() {
            out += &format!(
                "| {name} | {} | {:.3} | {:.3} | {:.3} | {:.3} | {:.3} | {:.3} | {steps} |\n",
                d.depth,
                d.opacity.spread.mean,
                d.opacity_at_4.map_or(0.0, |o| o.spread.mean),
                d.opacity.area,
                d.sigma.map_or(0.0, |s| s.mean),
                d.albedo.mean,
                d.light.mean,
            );
        }
    }
    out
}

/// The points of one scene.
struct Of<'a> {
    points: &'a [Point],
    scene: &'a str,
}

impl<'a> Of<'a> {
    fn all(&self) -> impl Iterator<Item = &'a Point> {
        let (points, scene) = (self.points, self.scene);
        points.iter().filter(move |p| p.scene == scene)
    }

    /// The picture of full resolution with nothing unusual about it but what `which` asks for.
    fn render(&self, model: &str, which: impl Fn(&Point) -> bool) -> Option<&'a Point> {
        let whole = self.all().map(|p| p.resolution).max()?;
        self.all().find(|p| {
            let plain = p.depth_bias == 0.0 && p.shadow_bias == 0.0 && p.refine == REFINE && p.resolution == whole;
            p.kind == "render" && p.model == model && plain && which(p)
        })
    }

    /// CPU seconds in which rays against triangles come as near, by the two counts of rays about it, or the last two
    /// (errors are powers of the time).
    fn traced(&self, kind: &str, flip: f64) -> Option<f64> {
        let known: Vec<(f64, f64)> =
            self.all().filter(|p| p.kind == kind).map(|p| (p.time().max(0.005).ln(), p.flip.max(1e-6).ln())).collect();
        let pair = known.windows(2).find(|w| w[1].1 <= flip.ln()).or(known.windows(2).last())?;
        let slope = (pair[1].0 - pair[0].0) / (pair[1].1 - pair[0].1);
        Some((pair[0].0 + (flip.ln() - pair[0].1) * slope).exp()).filter(|t| t.is_finite())
    }
}

fn shown(p: Option<&Point>) -> String {
    p.map_or("–".into(), |p| format!("{:.4} in {:.2}", p.flip, p.time()))
}

fn row(of: &Of) -> String {
    let lanes = |n: u32, near: bool| of.render("coverage", move |p| p.light == "all" && p.lanes == n && p.near == near);
    let (one, four) = (lanes(1, false), lanes(4, false));
    let worse = |model: &str| of.render(model, |p| p.lanes == 1 && !p.near);
    let ratio = one
        .zip(worse("neyret"))
        .map_or("–".into(), |(a, b)| format!("{:.1} ({:.1})", b.flip / a.flip.max(1e-9), b.rmse / a.rmse.max(1e-9)));
    let rays = |p: Option<&Point>| {
        p.and_then(|p| Some((p, of.traced("reference", p.flip)?)))
            .map_or("–".into(), |(p, t)| format!("{t:.2} ({:.1}×)", t / p.time().max(0.005)))
    };
    format!(
        "| {} | {} | {} | {}; {} | {} | {} | {ratio} | {} | {} | {:.4} |\n",
        of.scene,
        shown(one),
        shown(four),
        shown(lanes(1, true)),
        shown(lanes(4, true)),
        shown(worse("density")),
        shown(worse("neyret")),
        rays(one),
        rays(four),
        one.map_or(0.0, |p| p.noise),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::bench::report::tests::point;

    #[test]
    fn rays_that_come_as_near_are_interpolated() {
        let ray = |samples: u32, cpu: f64, flip: f64| Point { samples, flip, ..point("reference", cpu) };
        let points = [ray(1, 1.0, 0.1), ray(4, 4.0, 0.05), ray(16, 16.0, 0.025), point("render", 0.5)];
        let of = Of { points: &points, scene: "tree" };
        // Error is the inverse square root of time.
        assert!((of.traced("reference", 0.05).unwrap() - 4.0).abs() < 1e-9);
        assert!((of.traced("reference", 0.1 / 3.0).unwrap() - 9.0).abs() < 1e-9);
        assert!((of.traced("reference", 0.0125).unwrap() - 64.0).abs() < 1e-9, "beyond the last as well");
        let text = markdown(&points, &[]);
        assert!(text.contains("| tree | 0.0300 in 0.50 |"), "{text}");
        assert_eq!(text.lines().count(), 3);
    }
}

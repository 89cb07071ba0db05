//! Bodies against their formulas over resolutions, and one ball through several converters: `cargo bench --bench analytic`
//! prints the tables of docs/measuring.md (`-- --fine` adds 256 voxels).
#![allow(clippy::panic)]

mod bodies;
mod converters;
mod measure;

fn main() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("analytic");
    if let Err(e) = std::fs::create_dir_all(&folder) {
        panic!("{}: {e}", folder.display());
    }
    let fine = std::env::args().any(|word| word == "--fine");
    let resolutions: &[u32] = if fine { &[16, 32, 64, 128, 256] } else { &[16, 32, 64, 128] };
    println!(
        "| body | voxels | area | sigma, worst of 26 | volume | mean \\|ΔT\\| | covered |\n|---|---|---|---|---|---|---|"
    );
    for body in bodies::all() {
        let mut all = Vec::new();
        for &n in resolutions {
            let e = measure::errors(&body, &folder, n);
            let volume = e.volume.map_or("–".into(), |v| format!("{v:+.1e}"));
            println!(
                "| {} | {n} | {:+.1e} | {:.1e} | {volume} | {:.4} | {:+.4} |",
                body.name, e.area, e.sigma, e.opacity, e.covered
            );
            all.push(e);
        }
        // Between the coarsest and the finest, per doubling.
        let (first, last, times) = (all[0], all[all.len() - 1], (all.len() - 1) as f64);
        let order = |a: f64, b: f64| (a / b).abs().log2() / times;
        let volume = first.volume.zip(last.volume).map_or("–".into(), |(a, b)| format!("{:.1}", order(a, b)));
        println!(
            "| | order | {:.1} | {:.1} | {volume} | {:.1} | |",
            order(first.area, last.area),
            order(first.sigma, last.sigma),
            order(first.opacity, last.opacity)
        );
    }
    for n in [64, 128] {
        println!(
            "\n| ball, {n} voxels | mean \\|ΔT\\| to the recipe's | covered | mean \\|ΔT\\| to the formula | covered |\n|---|---|---|---|---|"
        );
        let balls = converters::balls(&folder, n);
        for ball in &balls {
            let ((a, b), (c, d)) = (ball.against(&balls[0]), ball.against_formula());
            println!("| {} | {a:.4} | {b:+.4} | {c:.4} | {d:+.4} |", ball.name);
        }
    }
}

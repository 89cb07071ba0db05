//! Bodies against their formulas and one ball through several converters: `cargo bench --bench analytic` in small.

#[path = "../bench/analytic/bodies.rs"]
mod bodies;
#[path = "../bench/analytic/converters.rs"]
mod converters;
#[path = "../bench/analytic/measure.rs"]
mod measure;

#[test]
fn errors_fall_with_resolution() {
    let dir = tempfile::tempdir().unwrap();
    for body in bodies::all() {
        let [coarse, fine] = [16, 64].map(|n| measure::errors(&body, dir.path(), n));
        let name = body.name;
        if name == "plane" {
            // Flat facets are the plane itself, but for f32 corners.
            assert!(fine.area.abs() < 1e-5 && fine.sigma < 1e-5, "{fine:?}");
        } else {
            let order = |a: f64, b: f64| 0.5 * (a / b).abs().log2();
            let volumes = (coarse.volume.unwrap(), fine.volume.unwrap());
            // Curved creases are cut by a part of a voxel: their areas are of first order, volumes of second.
            // Facets may bend by a fiftieth of a voxel, which takes as little of every area at any resolution.
            let (area, sigma) = if ["cylinder", "cone"].contains(&name) { (0.5, 0.5) } else { (0.8, 1.4) };
            assert!(
                order(coarse.area, fine.area) > area && order(coarse.sigma, fine.sigma) > sigma,
                "{name} {coarse:?} {fine:?}"
            );
            // 16 voxels wide, the blend's ring is two voxels thick: vertices beyond its bends make up for what loops cut off.
            let volume = if name.starts_with("torus") { 0.5 } else { 1.6 };
            assert!(order(volumes.0, volumes.1) > volume, "{name} {coarse:?} {fine:?}");
            // As measured and printed in docs/measuring.md, and a half.
            assert!(fine.area.abs() < 4e-3 && fine.sigma < 0.021 && volumes.1.abs() < 5e-3, "{name} {fine:?}");
            assert!(fine.opacity < 0.6 * coarse.opacity, "{name} {coarse:?} {fine:?}");
        }
        assert!(fine.covered.abs() < if name == "plane" { 0.12 } else { 0.05 }, "{name} {fine:?}");
    }
}

#[test]
fn one_ball_through_all_converters() {
    let dir = tempfile::tempdir().unwrap();
    let balls = converters::balls(dir.path(), 64);
    for ball in &balls {
        let ((apart, covers), (wrong, covered)) = (ball.against(&balls[0]), ball.against_formula());
        let name = ball.name;
        // Measured: .015 apart for the mesh, which its poles leave open and so hollow, and .018 from the formula; others a third.
        assert!(apart < 0.018 && covers.abs() < 0.01, "{name} {apart} {covers}");
        assert!(wrong < 0.02 && covered.abs() < 0.016, "{name} {wrong} {covered}");
    }
}

//! Iso-surfaces and soft matter of analytic fields.

use super::*;
use crate::geom::Aabb;
use crate::progress::Quiet;
use crate::source::placement::Placement;

/// A ball of `radius` samples in the middle of `n`^3, as distances.
fn ball(dir: &Dir, n: usize, radius: f64) -> PathBuf {
    let c = 0.5 * (n - 1) as f64;
    let mut bytes = format!(
        "NRRD0004\ntype: float\ndimension: 3\nsizes: {n} {n} {n}\nspacings: 1 1 1\nendian: little\nencoding: raw\n\n"
    )
    .into_bytes();
    for i in 0..n * n * n {
        let p = DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) - c;
        bytes.extend(((radius - p.length()) as f32).to_le_bytes());
    }
    dir.save(&format!("ball{n}.nrrd"), &bytes)
}

/// Area, enclosed volume and the sum of area vectors of all facets, in samples.
fn facets(source: &StackSource, depth: usize) -> (f64, f64, DVec3) {
    let bounds = source.bounds();
    let edge = bounds.size().max_element() * 1.001;
    let place = Placement {
        bounds: Aabb::new(bounds.min, bounds.min + edge),
        transform: DAffine3::IDENTITY,
        scale: f64::from(1u32 << depth) / edge,
        depth,
        up: 2,
        cyclic: [false; 3],
        memory: u64::MAX,
    };
    let staged = source.stage(&place, &Quiet).unwrap();
    let width = f64::from(1u32 << place.region_log2());
    let (mut area, mut volume, mut sum) = (0.0, 0.0, DVec3::ZERO);
    for (n, code) in staged.regions().iter().enumerate() {
        let corner = DVec3::from(crate::morton::decode(*code).map(f64::from)) * width;
        staged.emit(n, &mut |facet| {
            let mut room = None;
            if let Some(piece) = facet.clip(corner, corner + width, &mut room) {
                let a = piece.area_vector();
                area += a.length();
                sum += a;
                volume += a.dot(piece.corner_mean()) / 3.0;
            }
        });
    }
    let s = place.scale;
    (area / (s * s), volume / (s * s * s), sum / (s * s))
}

#[test]
fn a_balls_surface_closes_and_its_area_errs_by_the_square_of_the_distance() {
    let dir = Dir::new();
    let mut before = f64::INFINITY;
    for n in [16, 32, 64] {
        let radius = 0.4 * n as f64;
        let options = StackOptions { transfer: TransferSpec::hard(0.0), sigma: 0.0, ..StackOptions::default() };
        let source = StackSource::new(open(&ball(&dir, n, radius)).unwrap(), &options).unwrap();
        // As many voxels as samples: cells shrink with both.
        let (area, volume, sum) = facets(&source, n.trailing_zeros() as usize);
        let exact = 4.0 * std::f64::consts::PI * radius * radius;
        let error = (area / exact - 1.0).abs();
        // A facet as wide as samples are apart is flat: (1/radius)^2 of the area is lost, about.
        assert!(error < 1.2 / (radius * radius), "{n}: {error}");
        assert!(error < before / 3.0, "{n}: second order: {error} after {before}");
        before = error;
        assert!((volume / (exact * radius / 3.0) - 1.0).abs() < 2.0 / (radius * radius), "{n}: {volume}");
        // Nothing is open: area vectors cancel but for rounding, and for facets that are not quite flat.
        assert!(sum.length() < 1e-4 * area, "{n}: {sum}");
    }
}

#[test]
fn a_filter_and_finer_cells_move_a_ball_by_its_curvature_alone() {
    let dir = Dir::new();
    let path = ball(&dir, 24, 8.0);
    for sigma in [0.3, 0.6, 1.0] {
        let options = StackOptions { transfer: TransferSpec::hard(0.0), sigma, ..StackOptions::default() };
        let source = StackSource::new(open(&path).unwrap(), &options).unwrap();
        // A distance that is filtered falls by sigma^2 times the mean curvature: the ball shrinks by sigma^2 / radius.
        let radius = 0.5 * source.bounds().size().max_element();
        let want = 8.0 - sigma * sigma / 8.0;
        assert!((radius - want).abs() < 0.03, "{sigma}: {radius} {want}");
    }
}

#[test]
fn what_reaches_the_border_is_closed_there() {
    let dir = Dir::new();
    let text = NRRD.replace("(0,2,0) (-3,0,0) (0,0,4)", "(1,0,0) (0,1,0) (0,0,1)");
    let path = dir.save("full.nrrd", &[format!("{text}encoding: raw\n\n").into_bytes(), little()].concat());
    let options = StackOptions { transfer: TransferSpec::hard(-5.0), ..StackOptions::default() };
    let source = StackSource::new(open(&path).unwrap(), &options).unwrap();
    // All of it is matter: a box of 4 × 3 × 2 about the samples' centres.
    let b = source.bounds();
    assert!(
        (b.min - DVec3::new(9.5, 19.5, 29.5)).length() < 1e-12
            && (b.size() - DVec3::new(4.0, 3.0, 2.0)).length() < 1e-12
    );
    let (area, volume, sum) = facets(&source, 4);
    assert!((area - 52.0).abs() < 1e-6 && (volume - 24.0).abs() < 1e-6 && sum.length() < 1e-9, "{area} {volume} {sum}");
}

/// A NRRD header of n³ bytes at distances of 1.
fn header_of_cube(n: usize) -> Vec<u8> {
    format!("NRRD0004\ntype: uchar\ndimension: 3\nsizes: {n} {n} {n}\nspacings: 1 1 1\nencoding: raw\n\n").into_bytes()
}

#[test]
fn regions_are_made_where_there_is_matter_and_nowhere_else() {
    // Two balls of radius 5 in opposite corners of 64³ samples.
    let dir = Dir::new();
    let n = 64usize;
    let mut bytes = header_of_cube(n);
    bytes.extend((0..n * n * n).map(|i| {
        let p = DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64);
        let away = (p - 6.0).length().min((p - 57.0).length());
        (128.0 + 40.0 * (5.0 - away)).clamp(0.0, 255.0) as u8
    }));
    let path = dir.save("two.nrrd", &bytes);
    let options = StackOptions { transfer: TransferSpec::hard(128.0), sigma: 0.0, ..StackOptions::default() };
    let source = StackSource::new(open(&path).unwrap(), &options).unwrap();
    let place = Placement {
        bounds: source.bounds(),
        transform: DAffine3::IDENTITY,
        scale: 256.0 / source.bounds().size().x,
        depth: 8,
        up: 2,
        cyclic: [false; 3],
        memory: u64::MAX,
    };
    // Of 4096 regions of 16³ voxels a ball, 42 voxels wide, meets at least 3³; bricks of samples around it a few more.
    let staged = source.stage(&place, &Quiet).unwrap();
    assert!((54..=216).contains(&staged.regions().len()), "{}", staged.regions().len());
}

#[test]
fn opacity_follows_value_and_gradient() {
    // 32³ samples: 50 in one half, and from there on a ramp of 4 a sample along x.
    let dir = Dir::new();
    let n = 32usize;
    let mut bytes = header_of_cube(n);
    bytes.extend((0..n * n * n).map(|i| 50 + 4 * (i % n).saturating_sub(15) as u8));
    let path = dir.save("ramp.nrrd", &bytes);
    // Opacity .1 a sample, all of it where values change by 4, none where they do not.
    let table = r#"{"points": [{"value": 0, "opacity": 0.1}, {"value": 255, "opacity": 0.1}],
        "gradient": [{"magnitude": 0, "opacity": 0}, {"magnitude": 4, "opacity": 1}]}"#;
    let options =
        StackOptions { transfer: serde_json::from_str(table).unwrap(), sigma: 0.0, ..StackOptions::default() };
    let source = StackSource::new(open(&path).unwrap(), &options).unwrap();
    let place = Placement {
        bounds: Aabb::new(DVec3::splat(-0.5), DVec3::splat(31.5)),
        transform: DAffine3::IDENTITY,
        scale: 2.0,
        depth: 6,
        up: 2,
        cyclic: [false; 3],
        memory: u64::MAX,
    };
    let staged = source.stage(&place, &Quiet).unwrap();
    let mut halves = [0.0, 0.0];
    for region in 0..staged.regions().len() {
        staged.medium(region, &mut |m| {
            let half = usize::from(m.at[0] >= 32);
            halves[half] += m.extinction * f64::from(8u32.pow(m.edge_log2));
        });
    }
    // Optical depth along x, over 64² lines of voxels: -ln .9 a sample, 16 samples of it; the first is half flat.
    let depth = halves.map(|h| h / 4096.0);
    let want = -16.0 * 0.9f64.ln();
    assert!((depth[1] / want - 1.0).abs() < 0.06 && depth[0] < 0.05 * want, "{depth:?} {want}");
}

#[test]
fn what_is_larger_than_memory_is_the_same() {
    let dir = Dir::new();
    let packed = [format!("{NRRD}encoding: gzip\n\n").into_bytes(), gzip(&little())].concat();
    let path = dir.save("z.nrrd", &packed);
    let by = |memory: u64| values(&read(&path, &StackOptions::default(), memory).unwrap());
    assert_eq!(by(0), by(1 << 20));
}

#[test]
fn a_ramp_takes_the_same_from_every_side() {
    // Opacity rises along x from 0 at sample 4 to .9 at sample 28, or to .9 within three samples, which are 1 × 1 × 4 wide.
    let dir = Dir::new();
    let (n, deep) = (32usize, 8usize);
    for width in [24.0, 3.0] {
        let mut bytes =
            format!("NRRD0004\ntype: uchar\ndimension: 3\nsizes: {n} {n} {deep}\nspacings: 1 1 4\nencoding: raw\n\n")
                .into_bytes();
        bytes.extend((0..n * n * deep).map(|i| 8 * (i % n) as u8));
        let path = dir.save("ramp.nrrd", &bytes);
        let transfer = format!(
            r#"{{"points": [{{"value": 32, "opacity": 0}}, {{"value": {}, "opacity": 0.9}}]}}"#,
            32.0 + 8.0 * width
        );
        let options =
            StackOptions { transfer: serde_json::from_str(&transfer).unwrap(), sigma: 0.0, ..StackOptions::default() };
        let source = StackSource::new(open(&path).unwrap(), &options).unwrap();
        let place = Placement {
            bounds: source.bounds(),
            transform: DAffine3::IDENTITY,
            scale: 2.0,
            depth: 6,
            up: 2,
            cyclic: [false; 3],
            memory: u64::MAX,
        };
        let staged = source.stage(&place, &Quiet).unwrap();
        let mut sums = [0.0; 13];
        for region in 0..staged.regions().len() {
            staged.medium(region, &mut |m| sums.iter_mut().zip(m.rates(m.edge_log2)).for_each(|(sum, r)| *sum += r));
        }
        // Optical depth along x, in the mean over 64² lines: that of a layer of opacity p is −ln(1 − p) for each ∛4 of its
        // thickness, and ∫ −ln(1 − .9 s) ds from 0 to 1 is (.1 ln .1 + .9) / .9. After the ramp, .9 to the end at 31.5.
        let ramp = width * (0.1 * 0.1f64.ln() + 0.9) / 0.9;
        let want = (ramp - (31.5 - 4.0 - width) * 0.1f64.ln()) / 4.0f64.cbrt();
        // Points in the middles of eighths of samples, and half a sample at the border.
        for (k, sum) in sums.into_iter().enumerate() {
            let got = sum / 4096.0;
            assert!((got / want - 1.0).abs() < 0.03, "ramp of {width}, axis {k}: {got} {want}");
        }
    }
}

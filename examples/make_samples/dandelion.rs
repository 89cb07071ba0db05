//! A dandelion's seed head as strands: a hollow stalk, and seeds with their stalks and parachutes.

use std::f64::consts::TAU;
use std::fmt::Write as _;

use glam::DVec3;

use super::random::{Random, turn};

/// Metres.
const STALK: f64 = 0.16;
const SEEDS: u32 = 96;
const HAIRS: u32 = 10;

/// Rows of a table: id, t, x, y, z, radius, r, g, b.
pub fn table() -> String {
    let mut random = Random::new(19);
    let mut out = String::from(
        "# A dandelion's seed head: a stalk, 96 seeds, 10 hairs a seed. Metres; colours sRGB.\nid,t,x,y,z,radius,r,g,b\n",
    );
    let mut id = 0;
    let mut strand = |points: &[(DVec3, f64)], colour: [f64; 3]| {
        for (t, (p, radius)) in points.iter().enumerate() {
            let [r, g, b] = colour;
            let _ = writeln!(out, "{id},{t},{:.5},{:.5},{:.5},{radius:.5},{r},{g},{b}", p.x, p.y, p.z);
        }
        id += 1;
    };
    let bend = |y: f64| DVec3::new(0.012 * (y / STALK).powi(2), y, 0.004 * (y / STALK));
    let stalk: Vec<(DVec3, f64)> = (0..=5).map(|i| (bend(STALK * f64::from(i) / 5.0), 0.0021)).collect();
    strand(&stalk, [0.52, 0.62, 0.3]);
    let top = bend(STALK);
    strand(&[(top, 0.005), (top + DVec3::new(0.0, 0.004, 0.0), 0.0035)], [0.55, 0.5, 0.3]);
    for i in 0..SEEDS {
        // Spread evenly over a ball but for where the stalk comes in, by the golden angle.
        let height = 1.0 - 1.75 * (f64::from(i) + 0.5) / f64::from(SEEDS);
        let (s, c) = turn(TAU * 0.618_034 * f64::from(i));
        let flat = (1.0 - height * height).sqrt();
        let out = (DVec3::new(flat * c, height, flat * s) + 0.05 * random.ball()).normalize();
        let root = top + DVec3::new(0.0, 0.002, 0.0) + 0.004 * out;
        let crown = root + random.around(0.021, 0.0015) * out;
        strand(&[(root, 0.0003), (root + 0.0035 * out, 0.0006)], [0.36, 0.24, 0.12]);
        strand(&[(root + 0.0035 * out, 0.00014), (crown, 0.0001)], [0.8, 0.76, 0.66]);
        let (a, b) = out.any_orthonormal_pair();
        for j in 0..HAIRS {
            let (s, c) = turn(TAU * (f64::from(j) + random.around(0.0, 0.3)) / f64::from(HAIRS));
            let side = c * a + s * b;
            let reach = random.around(0.0075, 0.0008);
            let tip = crown + reach * (0.95 * side + 0.36 * out);
            strand(&[(crown, 0.00013), (tip, 0.00008)], [0.93, 0.92, 0.9]);
        }
    }
    out
}

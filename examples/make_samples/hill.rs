//! A rounded hill of bilinear patches, for the lawn of 1996: 40 × 35 quads of about 10 cm, none of which is flat.

use std::fmt::Write;

const COLUMNS: u32 = 40;
const ROWS: u32 = 35;
/// Width of a quad, metres.
const QUAD: f64 = 0.1;

/// Colour of the ground, sRGB.
const SOIL: &str = "0.25 0.22 0.15";

/// Height of the ground: a mound, and softer ones beside it.
fn height(x: f64, z: f64) -> f64 {
    let mound = |cx: f64, cz: f64, width: f64| {
        let (dx, dz) = ((x - cx) / width, (z - cz) / width);
        libm::exp(-(dx * dx + dz * dz))
    };
    0.62 * mound(-0.35, -0.5, 0.95) + 0.2 * mound(1.2, 0.4, 0.7) - 0.12 * mound(-1.3, 1.0, 0.6)
}

/// `hill.obj`.
pub fn hill() -> Vec<u8> {
    let mut text = String::from("# A hill of 1400 quads. vtex map hill.obj --texel lawn.vtex --repeat 40,35\no hill\n");
    let centred = |k: u32, n: u32| QUAD * (f64::from(k) - 0.5 * f64::from(n));
    for j in 0..=ROWS {
        for i in 0..=COLUMNS {
            // Rows and columns bend, so that quads differ in shape.
            let (x, z) = (centred(i, COLUMNS), centred(j, ROWS));
            let (x, z) = (x + 0.03 * libm::sin(2.0 * z + 1.0), z + 0.03 * libm::sin(2.3 * x));
            let _ = writeln!(text, "v {x:.5} {:.5} {z:.5} {SOIL}", height(x, z));
        }
    }
    for j in 0..=ROWS {
        for i in 0..=COLUMNS {
            let (u, v) = (f64::from(i) / f64::from(COLUMNS), 1.0 - f64::from(j) / f64::from(ROWS));
            let _ = writeln!(text, "vt {u:.6} {v:.6}");
        }
    }
    for j in 0..ROWS {
        for i in 0..COLUMNS {
            // Counter-clockwise from above, from the corner in front on the left.
            let at = |i: u32, j: u32| j * (COLUMNS + 1) + i + 1;
            let [a, b, c, d] = [at(i, j + 1), at(i + 1, j + 1), at(i + 1, j), at(i, j)];
            let _ = writeln!(text, "f {a}/{a} {b}/{b} {c}/{c} {d}/{d}");
        }
    }
    text.into_bytes()
}

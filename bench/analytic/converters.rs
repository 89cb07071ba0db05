//! One ball through several converters.

use std::fmt::Write as _;
use std::path::Path;

use vtex::geom::DVec3;
use vtex::source::stack::TransferSpec;
use vtex::source::{OpenOptions, StackOptions};

use super::measure::{Texel, baked, compared, open};

/// The texel of a ball by one converter, and its radius in that converter's units; its middle is at the origin, or at `centre`.
pub struct Ball {
    pub name: &'static str,
    pub texel: Texel,
    radius: f64,
    centre: DVec3,
}

/// A sphere of meridians and parallels, OBJ.
fn mesh(around: usize, radius: f64) -> String {
    use std::f64::consts::PI;
    let half = around / 2;
    let mut text = String::new();
    for i in 0..=half {
        for j in 0..around {
            let (a, b) = (PI * i as f64 / half as f64, 2.0 * PI * j as f64 / around as f64);
            let p = radius * DVec3::new(a.sin() * b.cos(), a.cos(), a.sin() * b.sin());
            let _ = writeln!(text, "v {} {} {}", p.x, p.y, p.z);
        }
    }
    for i in 0..half {
        for j in 0..around {
            let v = |i: usize, j: usize| i * around + j % around + 1;
            let _ = writeln!(text, "f {} {} {} {}", v(i, j), v(i, j + 1), v(i + 1, j + 1), v(i + 1, j));
        }
    }
    text
}

/// A stack of n slices whose values say how far the ball's surface is, 500 to a sample's distance.
fn stack(n: usize, radius: f64) -> Vec<u8> {
    let mut out = format!(
        "NRRD0004\ntype: ushort\ndimension: 3\nsizes: {n} {n} {n}\nspacings: 1 1 1\nendian: little\nencoding: raw\n\n"
    )
    .into_bytes();
    let middle = 0.5 * (n as f64 - 1.0);
    for i in 0..n * n * n {
        let p = DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) - middle;
        out.extend(((32768.0 + 500.0 * (radius - p.length())).clamp(0.0, 65535.0) as u16).to_le_bytes());
    }
    out
}

/// A recipe's ball first, then the same as mesh, implicit function, stack of 256 slices, L-system and curve.
pub fn balls(folder: &Path, resolution: u32) -> Vec<Ball> {
    let make = |name, file: &str, text: &[u8], options: &OpenOptions, radius, centre| {
        let source = open(folder, file, text, options);
        Ball { name, texel: baked(&*source, resolution), radius, centre }
    };
    let plain = OpenOptions::default();
    let slices = OpenOptions {
        stack: StackOptions { transfer: TransferSpec::hard(32768.0), ..StackOptions::default() },
        ..OpenOptions::default()
    };
    let skeleton = "[[draw]]\nimplicit = { kind = \"skeleton\", elements = [{ point = [0, 0, 0] }] }";
    let middle = DVec3::splat(127.5);
    vec![
        make("recipe", "ball.toml", b"[[draw]]\nsphere = { radius = 1 }", &plain, 1.0, DVec3::ZERO),
        make("mesh", "ball.obj", mesh(256, 1.0).as_bytes(), &plain, 1.0, DVec3::ZERO),
        make("implicit", "implicit.toml", skeleton.as_bytes(), &plain, 1.0, DVec3::ZERO),
        make("stack of 256 slices", "ball.nrrd", &stack(256, 120.0), &slices, 120.0, middle),
        make("curve of one point", "ball.csv", b"id,t,x,y,z,radius\n1,0,0,0,0,1\n", &plain, 1.0, DVec3::ZERO),
    ]
}

impl Ball {
    fn opacity(&self, origin: DVec3, dir: DVec3) -> f64 {
        1.0 - self.texel.through(self.centre + self.radius * origin, dir)
    }

    /// Mean |ΔT| and covered area − 1 against another, by pixels as wide as a voxel.
    pub fn against(&self, other: &Ball) -> (f64, f64) {
        let width = self.texel.voxel() / self.radius;
        let (opacity, covered) =
            compared(DVec3::ZERO, 1.5, width, |o, d| self.opacity(o, d), |o, d| other.opacity(o, d));
        (opacity, covered - 1.0)
    }

    /// The same against the formula.
    pub fn against_formula(&self) -> (f64, f64) {
        let width = self.texel.voxel() / self.radius;
        let ball = |o: DVec3, d: DVec3| f64::from(u8::from(o.cross(d).length() < 1.0));
        let (opacity, covered) = compared(DVec3::ZERO, 1.5, width, |o, d| self.opacity(o, d), ball);
        (opacity, covered - 1.0)
    }
}

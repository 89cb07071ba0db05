//! Leaf cards: strips with a drawn, alpha-masked texture, and the drawing.

use glam::{DVec2, DVec3};

use crate::glb::{self, Mesh};
use crate::random::turn;

/// What the texture holds at a point: x across in [-1, 1], y along in [0, 1] from base to tip. Linear RGB where there is
/// something, `None` where there is nothing.
pub trait Drawing {
    fn at(&self, p: DVec2) -> Option<DVec3>;
}

/// Draw a PNG of `width` × `height`; 4 × 4 samples a pixel. Empty pixels take the mean colour, so that filters do not
/// darken rims. The base is at the bottom (v = 1).
pub fn draw(drawing: &dyn Drawing, width: u32, height: u32) -> Vec<u8> {
    let mut sums = Vec::new();
    for j in 0..height {
        for i in 0..width {
            let (mut sum, mut hits) = (DVec3::ZERO, 0.0);
            for s in 0..16 {
                let x = (f64::from(i) + (f64::from(s % 4) + 0.5) / 4.0) / f64::from(width);
                let y = (f64::from(j) + (f64::from(s / 4) + 0.5) / 4.0) / f64::from(height);
                if let Some(color) = drawing.at(DVec2::new(2.0 * x - 1.0, 1.0 - y)) {
                    sum += color;
                    hits += 1.0;
                }
            }
            sums.push((sum, hits));
        }
    }
    let (all, hits) = sums.iter().fold((DVec3::ZERO, 0.0), |(c, n), s| (c + s.0, n + s.1));
    let mean = all / f64::max(hits, 1.0);
    let code = |x: f64| (libm::pow(x.clamp(0.0, 1.0), 1.0 / 2.2) * 255.0).round() as u8;
    let image = image::RgbaImage::from_fn(width, height, |i, j| {
        let (sum, hits) = sums[(j * width + i) as usize];
        let [r, g, b] = if hits > 0.0 { sum / hits } else { mean }.to_array().map(code);
        image::Rgba([r, g, b, (hits * 255.0 / 16.0) as u8])
    });
    glb::png(&image::DynamicImage::from(image))
}

/// One side leaf of a frond or one needle: a tapered stroke from a point on the rachis.
#[derive(Clone, Copy)]
pub struct Stroke {
    pub base: DVec2,
    pub along: DVec2,
    pub length: f64,
    pub half_width: f64,
    /// Teeth of its outline: how many, and how deep in [0, 1].
    pub teeth: (f64, f64),
    pub color: DVec3,
}

/// Strokes on a rachis; units of the card's length, x to both sides of the rachis.
pub struct Frond {
    pub strokes: Vec<Stroke>,
    /// Half the card's width, in its length.
    pub half_width: f64,
    pub rachis: (f64, DVec3),
}

impl Drawing for Frond {
    fn at(&self, p: DVec2) -> Option<DVec3> {
        let p = DVec2::new(p.x * self.half_width, p.y);
        let (thick, color) = self.rachis;
        if p.x.abs() < thick * (1.1 - p.y) {
            return Some(color);
        }
        self.strokes.iter().find_map(|s| {
            let d = p - s.base;
            let (a, b) = (d.dot(s.along) / s.length, d.perp_dot(s.along).abs());
            if !(0.0..1.0).contains(&a) {
                return None;
            }
            let lance = libm::pow(a + 0.02, 0.3) * (1.0 - a) * 1.55;
            let (tooth, _) = turn(a * s.teeth.0 * std::f64::consts::TAU);
            let width = s.half_width * lance.min(1.0) * (1.0 - s.teeth.1 * (0.5 + 0.5 * tooth));
            (b < width).then(|| s.color * (1.12 - 0.35 * (b / s.half_width) - 0.1 * a))
        })
    }
}

/// Where a card lies: a strip along `points` (base to tip), `half_width` to each side of it.
pub struct Strip<'a> {
    pub points: &'a [DVec3],
    /// Across the strip at its base.
    pub side: DVec3,
    pub half_width: f64,
    /// How far the middle lies below the rims, in half widths.
    pub fold: f64,
    pub tint: DVec3,
}

/// Add a strip; its texture runs over the whole unit square.
pub fn add(mesh: &mut Mesh, strip: &Strip) {
    let last = strip.points.len() - 1;
    for (i, &p) in strip.points.iter().enumerate() {
        let along = (strip.points[(i + 1).min(last)] - strip.points[i.saturating_sub(1)]).normalize();
        let side = (strip.side - along * along.dot(strip.side)).normalize();
        let up = side.cross(along);
        for k in [-1.0, 0.0, 1.0] {
            let lift = if k == 0.0 { 0.0 } else { strip.fold };
            let index =
                mesh.vertex(p + strip.half_width * (side * k + up * lift), up - side * k * strip.fold, strip.tint);
            mesh.uvs.push(DVec2::new(0.5 + 0.5 * k, 1.0 - i as f64 / last as f64));
            if i > 0 && k > -1.0 {
                let (a, b, c, d) = (index - 4, index - 3, index - 1, index);
                mesh.triangles.extend([[a, b, d], [a, d, c]]);
            }
        }
    }
}

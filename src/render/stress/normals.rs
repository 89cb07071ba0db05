//! The law of opacity and the normals of a voxel, sample by sample.

use super::{Random, Tally};
use crate::geom::{DMat3, DVec3, Vec3};
use crate::march::vndf::{EQUAL, POINTS, visible_normals};
use crate::volume::Sggx;
use crate::volume::opacity::{advance, advance_f64};

/// Four roundings of values of at most 1 on each side.
const ROUNDING: f64 = 1e-6;

pub fn law(random: &mut Random, samples: u64) -> Tally {
    let mut tally = Tally { rays: samples, ..Tally::default() };
    for _ in 0..samples {
        let t = match random.below(4) {
            0 => 1.0,
            1 => random.magnitude(-30.0, 0.0) as f32,
            _ => random.unit() as f32,
        };
        // A rate of 1e-12 to 1e12 over a length of 1e-6 to 2.
        let tau = (random.magnitude(-12.0, 12.0) * random.magnitude(-6.0, 0.3)) as f32;
        let c = match random.below(4) {
            0 => 0.0,
            1 => 1.0,
            2 => 1.0 - random.magnitude(-7.0, -1.0) as f32,
            _ => random.unit() as f32,
        };
        let whole = advance(t, tau, c);
        if !(0.0..=t).contains(&whole) {
            tally.nan += u64::from(!(0.0..=1.0).contains(&whole));
            tally.rises += u64::from(whole > t);
        }
        let split = random.unit() as f32;
        let parts = advance(advance(t, tau * split, c), tau * (1.0 - split), c);
        let step = f64::from((whole - parts).abs());
        tally.worst_step = tally.worst_step.max(step);
        tally.steps += u64::from(step.is_nan() || step > ROUNDING);
        tally.compare(whole.into(), advance_f64(t.into(), tau.into(), c.into()), ROUNDING);
    }
    tally
}

/// What is asked of a voxel's normals, in f64, from the same code: projected area, and the mean of max(0, n·l) over the
/// normals that are seen.
struct Oracle {
    s: DMat3,
}

impl Oracle {
    fn new(s: &Sggx) -> Oracle {
        let [xx, yy, zz, xy, xz, yz] = [s.xx, s.yy, s.zz, s.xy, s.xz, s.yz].map(f64::from);
        Oracle { s: DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz)) }
    }

    fn sigma(&self, w: DVec3) -> f64 {
        w.dot(self.s * w).max(0.0).sqrt()
    }
}

pub fn normals(random: &mut Random, samples: u64) -> Tally {
    let mut tally = Tally { rays: samples, ..Tally::default() };
    for _ in 0..samples {
        let s = ellipsoid(random);
        let (view, light) = (random.awkward_direction(), random.awkward_direction());
        // Six products of values of at most 1, and a root: near 0 it magnifies the rounding of its argument.
        let oracle = Oracle::new(&s);
        let (got, want) = (f64::from(s.sigma(view)), oracle.sigma(view.as_dvec3()));
        tally.nan += u64::from(!(got.is_finite() && got >= 0.0));
        tally.deviations += u64::from((got * got - want * want).abs() > 2e-6);
        if want > 0.1 {
            tally.worst = tally.worst.max((got - want).abs());
            tally.worst_relative = tally.worst_relative.max((got - want).abs() / want);
        }
        let normals = visible_normals(&s, view);
        let mut inside = true;
        for i in 0..POINTS {
            let n = Vec3::new(normals.x[i], normals.y[i], normals.z[i]);
            tally.nan += u64::from(!n.is_finite());
            // Of unit length, and on the viewer's side.
            inside &= (n.length() - 1.0).abs() < 1e-4 && n.dot(view) > -1e-3;
        }
        tally.leaks += u64::from(!inside);
        let mean = random.awkward_direction();
        for weights in [EQUAL, normals.one_sided(mean, random.unit() as f32)] {
            let sum: f32 = weights.iter().sum();
            let lit = normals.diffuse(&weights, light);
            tally.nan += u64::from(!(lit.is_finite() && (-1e-6..=1.0 + 1e-5).contains(&lit)));
            tally.deviations += u64::from(sum.is_nan() || (sum - 1.0).abs() > 1e-5);
        }
    }
    tally
}

/// An SGGX that went through its code, as every voxel's has.
fn ellipsoid(random: &mut Random) -> Sggx {
    let code = match random.below(4) {
        0 => {
            let mut code = [0; 6];
            code.iter_mut().for_each(|b| *b = random.bits() as u8);
            code
        }
        1 => Sggx::ISOTROPIC.encode(),
        _ => {
            // Near rank 1: one normal and a little of the others.
            let n = random.direction();
            let thin = if random.once_in(2) { 0.0 } else { random.magnitude(-8.0, -1.0) };
            let of = |a: f64, b: f64, same: f64| (a * b * (1.0 - thin) + same * thin) as f32;
            let s = Sggx {
                xx: of(n.x, n.x, 1.0),
                yy: of(n.y, n.y, 1.0),
                zz: of(n.z, n.z, 1.0),
                xy: of(n.x, n.y, 0.0),
                xz: of(n.x, n.z, 0.0),
                yz: of(n.y, n.z, 0.0),
            };
            s.encode()
        }
    };
    Sggx::decode(code)
}

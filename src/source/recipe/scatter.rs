//! Places of scattered copies.
//!
//! Based on: R. Cook, *Stochastic Sampling in Computer Graphics*, TOG 5, 1986 (darts that keep a distance).

use std::collections::BTreeMap;

use super::checks::about;
use super::model::Scatter;
use crate::geom::{DAffine3, DMat3, DVec3};
use crate::random::SplitMix64;

/// Trials for each copy until it is far enough from the others.
const TRIALS: usize = 30;

/// The copies' transforms.
pub fn places(scatter: &Scatter) -> Vec<DAffine3> {
    let (lo, hi) = (scatter.min.0.min(scatter.max.0), scatter.min.0.max(scatter.max.0));
    let mut origins = Origins::new(scatter.apart.0);
    let mut places = Vec::new();
    for copy in 0..scatter.count {
        // A stream of its own for each: one more copy leaves the others where they are.
        let mut random = SplitMix64::new(scatter.seed ^ u64::from(copy).wrapping_mul(0xd605_bbb5_8c8a_bc2b));
        random.unit();
        let mut origin = None;
        for _ in 0..TRIALS {
            let share = DVec3::new(random.unit(), random.unit(), random.unit());
            let from_middle =
                (2.0 * share - 1.0) * DVec3::from((hi - lo).to_array().map(|s| f64::from(u8::from(s > 0.0))));
            let at = lo + share * (hi - lo);
            if (!scatter.round || from_middle.length_squared() <= 1.0) && origins.take(at) {
                origin = Some(at);
                break;
            }
        }
        let Some(origin) = origin else { continue };
        let axis = scatter.axis.0;
        let turn = (random.unit() - 0.5) * scatter.turn.0.to_radians();
        let side = about(axis, random.unit() * std::f64::consts::TAU) * axis.any_orthonormal_vector();
        let tilt = random.unit() * scatter.tilt.0.to_radians();
        let [least, most] = scatter.scale.map(|s| s.0);
        let size = least + random.unit() * (most - least);
        let turned = about(side, tilt) * about(axis, turn) * DMat3::from_diagonal(DVec3::splat(size));
        places.push(DAffine3::from_mat3_translation(turned, origin));
    }
    places
}

/// Origins that keep a distance.
struct Origins {
    apart: f64,
    /// By cells as wide as the distance.
    cells: BTreeMap<[i64; 3], Vec<DVec3>>,
}

impl Origins {
    fn new(apart: f64) -> Origins {
        Origins { apart, cells: BTreeMap::new() }
    }

    /// Whether `at` is far enough from all; then it is one of them.
    fn take(&mut self, at: DVec3) -> bool {
        if self.apart <= 0.0 {
            return true;
        }
        let cell = (at / self.apart).floor().as_i64vec3().to_array();
        for i in 0..27 {
            let near = [
                cell[0].saturating_add(i % 3 - 1),
                cell[1].saturating_add(i / 3 % 3 - 1),
                cell[2].saturating_add(i / 9 - 1),
            ];
            if self.cells.get(&near).is_some_and(|list| list.iter().any(|p| p.distance(at) < self.apart)) {
                return false;
            }
        }
        self.cells.entry(cell).or_default().push(at);
        true
    }
}

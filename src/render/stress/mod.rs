//! Rays through hostile geometry, counted: what is not a number, walls that are not crossed exactly once, transmittance that
//! rises, results that depend on steps, and how far everything is from an oracle in f64.
//!
//! Based on: M. Pharr, W. Jakob, G. Humphreys, *Physically Based Rendering*, 4th ed., 2023, 6.8 (managing rounding error);
//! I. Wald et al. / S. Woop et al., *Watertight Ray/Triangle Intersection*, JCGT 2013 (what watertight means).
//!
//! An oracle in f64 cannot be compared with f32 blindly: a ray that runs within rounding of a face has two right answers.
//! So oracles give an interval: the results for matter grown and shrunk by the rounding of a position, and what lies
//! outside of it is an event.

mod boxes;
#[cfg(test)]
pub(crate) use boxes::octasphere;
mod normals;
mod patches;
mod random;
mod scenes;
mod trees;

use serde::Serialize;

use crate::progress::Progress;
use crate::{Error, Result, par};
use random::Random;

/// What was counted; all but the first and the last three are events.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Tally {
    /// Rays; of `law` and `normals`, samples.
    pub rays: u64,
    /// Results that are no finite number, or outside of what they can be.
    pub nan: u64,
    /// Walls crossed not exactly once: matter skipped, met twice, or out of order.
    pub leaks: u64,
    /// Transmittance that is larger farther along a ray.
    pub rises: u64,
    /// Results that change by more than rounding with how a ray is cut, or a scene is placed.
    pub steps: u64,
    /// Results farther from the oracle than rounding of positions allows.
    pub deviations: u64,
    /// Largest difference by cutting, and largest deviation from the oracle, on rays along which rounding is not magnified.
    pub worst_step: f64,
    /// Largest deviation from the oracle, on rays along which rounding is not magnified.
    pub worst: f64,
    /// The same, relative to the oracle's result.
    pub worst_relative: f64,
}

impl Tally {
    /// How many things went wrong.
    pub fn events(&self) -> u64 {
        self.nan + self.leaks + self.rises + self.steps + self.deviations
    }

    fn merge(&mut self, other: &Tally) {
        self.rays += other.rays;
        self.nan += other.nan;
        self.leaks += other.leaks;
        self.rises += other.rises;
        self.steps += other.steps;
        self.deviations += other.deviations;
        self.worst_step = self.worst_step.max(other.worst_step);
        self.worst = self.worst.max(other.worst);
        self.worst_relative = self.worst_relative.max(other.worst_relative);
    }

    /// Count a deviation of `got` from `want`, of at most `allowed`.
    fn compare(&mut self, got: f64, want: f64, allowed: f64) {
        let off = self.measure(got, want);
        self.nan += u64::from(!off.is_finite());
        self.deviations += u64::from(off > allowed);
    }

    /// How far `got` is from `want`, which the worst of all are kept of.
    fn measure(&mut self, got: f64, want: f64) -> f64 {
        let off = (got - want).abs();
        self.worst = self.worst.max(off);
        if want.abs() > 1e-3 {
            self.worst_relative = self.worst_relative.max(off / want.abs());
        }
        off
    }
}

/// One kind of hostility.
pub struct Suite {
    /// Name, as `--only` takes it.
    pub name: &'static str,
    /// What is done to what.
    pub about: &'static str,
    /// Share of all rays, in hundredths.
    pub share: u64,
    /// Rays that one call casts through one thing that it makes up.
    batch: u64,
    run: fn(&mut Random, u64) -> Tally,
}

/// All suites, in the order in which they run.
pub const SUITES: [Suite; 12] = [
    Suite {
        name: "law",
        about: "the law of opacity: rates 1e-12 to 1e12, any correlation; against f64, cut in two",
        share: 10,
        batch: 8192,
        run: normals::law,
    },
    Suite {
        name: "normals",
        about: "SGGX near rank 1, isotropic, and of random codes; lit and seen from anywhere; against f64",
        share: 10,
        batch: 4096,
        run: normals::normals,
    },
    Suite {
        name: "trees",
        about: "random octrees of up to 32^3, rates 1e-12 to 1e12; rays along axes, faces, edges, vertices, grazing",
        share: 20,
        batch: 256,
        run: trees::random_trees,
    },
    Suite {
        name: "deep",
        about: "17 depths (65536^3): clusters of single voxels",
        share: 5,
        batch: 128,
        run: trees::deep_trees,
    },
    Suite {
        name: "walls",
        about: "opaque walls of voxels in any direction, through lattice edges and vertices: nothing comes through, once",
        share: 12,
        batch: 512,
        run: trees::walls,
    },
    Suite {
        name: "shells",
        about: "closed shells of twisted boxes, sheared, mirrored, flattened, at scales 1e-6 to 1e6 and 1e7 m away",
        share: 15,
        batch: 256,
        run: boxes::shells,
    },
    Suite {
        name: "prisms",
        about: "flat shells of prisms: through shared edges and vertices, along walls, from inside",
        share: 9,
        batch: 256,
        run: boxes::prisms,
    },
    Suite {
        name: "upright",
        about: "boxes of uneven heights under an affine map, where texel coordinates are known in closed form",
        share: 5,
        batch: 64,
        run: boxes::upright,
    },
    Suite {
        name: "broken",
        about: "slivers, collapsed, folded and huge boxes: spans stay ordered and finite",
        share: 5,
        batch: 32,
        run: boxes::broken,
    },
    Suite {
        name: "patches",
        about: "closed shells of bilinear patches and triangles, placed as `shells`; and upright ones in closed form",
        share: 5,
        batch: 128,
        run: patches::patches,
    },
    Suite {
        name: "folds",
        about: "patches that are collapsed, concave, twisted beyond measure or folded, or the prisms in their place",
        share: 3,
        batch: 32,
        run: patches::folds,
    },
    Suite {
        name: "scenes",
        about: "pictures of a landscape moved by 1e7 m and scaled by 2^-20 to 2^20, also from inside a shell",
        share: 1,
        batch: 3072,
        run: scenes::scenes,
    },
];

/// How much is cast.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Rays of all suites together, at least.
    pub rays: u64,
    /// Seed of the rays.
    pub seed: u64,
}

/// Run the suites of which `wanted` is true; a tally each. Same figures for any number of threads.
///
/// # Errors
/// `Options` for no rays at all.
pub fn stress(
    options: &Options,
    wanted: &dyn Fn(&Suite) -> bool,
    progress: &dyn Progress,
) -> Result<Vec<(&'static Suite, Tally)>> {
    if options.rays == 0 {
        return Err(Error::Options("option `rays` = 0: nothing to cast".into()));
    }
    let chosen: Vec<(usize, &Suite)> = SUITES.iter().enumerate().filter(|(_, s)| wanted(s)).collect();
    let shares: u64 = chosen.iter().map(|(_, s)| s.share).sum();
    let batches = |s: &Suite| {
        (u128::from(options.rays) * u128::from(s.share)).div_ceil(u128::from(shares.max(1) * s.batch)) as usize
    };
    progress.stage("stress", chosen.iter().map(|(_, s)| batches(s) as u64).sum());
    let mut found = Vec::with_capacity(chosen.len());
    for (index, suite) in chosen {
        let mut all = Tally::default();
        let (count, mut first) = (batches(suite), 0);
        while first < count {
            // Not all at once, so that tallies of 1e9 rays need no memory.
            let part = (count - first).min(1 << 14);
            let tallies = par::map(part, |i| {
                let mut random = Random::new(options.seed, index as u64, (first + i) as u64);
                let tally = (suite.run)(&mut random, suite.batch);
                progress.advance(1);
                tally
            });
            tallies.iter().for_each(|t| all.merge(t));
            first += part;
        }
        found.push((suite, all));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Quiet;

    #[test]
    fn nothing_happens() {
        let found = stress(&Options { rays: 200_000, seed: 7 }, &|_| true, &Quiet).unwrap();
        for (suite, tally) in &found {
            assert_eq!(tally.events(), 0, "{}: {tally:?}", suite.name);
            assert!(tally.rays >= 200_000 * suite.share / 100, "{}: {tally:?}", suite.name);
        }
        assert_eq!(SUITES.iter().map(|s| s.share).sum::<u64>(), 100);
        assert!(stress(&Options { rays: 0, seed: 7 }, &|_| true, &Quiet).is_err());
    }

    #[test]
    fn the_same_for_any_number_of_threads() {
        let run = |threads| {
            let options = Options { rays: 20_000, seed: 3 };
            let found =
                par::with_threads(threads, || stress(&options, &|s| s.name != "scenes", &Quiet)).unwrap().unwrap();
            found.into_iter().map(|f| f.1).collect::<Vec<_>>()
        };
        assert_eq!(run(1), run(3));
    }
}

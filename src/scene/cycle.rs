//! Animated texels: which frame a copy shows at a time. Normative text: `format-spec/landscape-1.md`.
//!
//! Based on: F. Neyret, *Animated Texels*, Eurographics Workshop on Computer Animation and Simulation 1995 (a texel a frame,
//! copies at phases of their own).

use crate::geom::DVec3;
use crate::noise::Noise;
use crate::random::SplitMix64;

/// Order in which frames are shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// First to last, and again.
    #[default]
    Loop,
    /// First to last and back.
    PingPong,
    /// A random frame at every step.
    Random,
}

/// Phase of a copy in the cycle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Phase {
    /// All show the same frame.
    #[default]
    Global,
    /// Random for every cell or copy.
    PerCell,
    /// Noise, so that neighbours have similar phases; the width of its lattice in cells, or in metres for rigid copies.
    Noise(f64),
}

/// An animation at one time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cycle {
    /// Order in which the frames follow one another.
    pub mode: Mode,
    /// Rule for the phases of cells or copies.
    pub phase: Phase,
    /// Number of frames since the beginning: the first frame's number plus time · frames per second.
    pub position: f64,
    /// Seed of random frames and phases.
    pub seed: u32,
}

/// Added to the seed of the noise of phases.
const NOISE_SEED: u32 = 0x5048_4153;

impl Cycle {
    /// The number of the frame, of `count` (≥ 1), that is shown at the phase `ahead`, a share of the cycle; `hash` distinguishes cells or copies
    /// where frames are random.
    pub fn frame(&self, count: u32, ahead: f64, hash: u64) -> u32 {
        let count = i64::from(count.max(1));
        let way = match self.mode {
            Mode::PingPong => (2 * count - 2).max(1),
            Mode::Loop | Mode::Random => count,
        };
        // Clamped, so that an infinite time stays within the range of exact integers.
        let step = (self.position + ahead * way as f64).floor().clamp(-9e15, 9e15) as i64;
        let frame = match self.mode {
            Mode::Loop => step.rem_euclid(count),
            Mode::PingPong => {
                let k = step.rem_euclid(way);
                if k < count { k } else { way - k }
            }
            Mode::Random => {
                let seed = hash ^ (u64::from(self.seed) << 32);
                let own = SplitMix64::new(seed).bits();
                (SplitMix64::new(own ^ step as u64).bits() % count as u64) as i64
            }
        };
        frame as u32
    }

    /// Phase of a copy, as a share of the cycle in [0, 1). `hash` is its own; `place` is its position (cells, or metres for rigid copies).
    pub fn phase_of(&self, hash: u64, place: DVec3) -> f64 {
        match self.phase {
            Phase::Global => 0.0,
            Phase::PerCell => SplitMix64::new(hash ^ u64::from(self.seed)).unit(),
            Phase::Noise(width) => {
                let noise = Noise {
                    seed: self.seed.wrapping_add(NOISE_SEED),
                    frequency: DVec3::splat(1.0 / width),
                    origin: DVec3::ZERO,
                    period: [0; 3],
                    octaves: 1,
                    turbulence: false,
                };
                let value = noise.value(place);
                value - value.floor()
            }
        }
    }

    /// A hash of a cell.
    pub fn cell_hash(cell: [i64; 3]) -> u64 {
        cell.iter().fold(0, |hash, &k| SplitMix64::new(hash ^ k as u64).bits())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(mode: Mode, count: u32, steps: std::ops::Range<i32>) -> Vec<u32> {
        let cycle = |k: i32| Cycle { mode, position: f64::from(k) + 0.5, ..Cycle::default() };
        steps.map(|k| cycle(k).frame(count, 0.0, 3)).collect()
    }

    #[test]
    fn ways_through_frames() {
        assert_eq!(run(Mode::Loop, 3, -2..5), [1, 2, 0, 1, 2, 0, 1]);
        assert_eq!(run(Mode::PingPong, 4, -1..8), [1, 0, 1, 2, 3, 2, 1, 0, 1]);
        assert_eq!(run(Mode::PingPong, 1, 0..3), [0, 0, 0]);
        assert_eq!(run(Mode::PingPong, 2, 0..4), [0, 1, 0, 1]);
        let drawn = run(Mode::Random, 5, 0..4000);
        for frame in 0..5 {
            // 4000 draws at a fifth: standard deviation 25.
            let n = drawn.iter().filter(|f| **f == frame).count();
            assert!((675..925).contains(&n), "{n}");
        }
    }

    #[test]
    fn phases() {
        let cycle = |phase| Cycle { phase, seed: 4, ..Cycle::default() };
        let ahead = |phase, x: i64| cycle(phase).phase_of(Cycle::cell_hash([x, 0, 0]), DVec3::X * x as f64);
        assert_eq!(ahead(Phase::Global, 9), 0.0);
        let mean: f64 = (0..1000).map(|x| ahead(Phase::PerCell, x)).sum::<f64>() / 1000.0;
        // Standard deviation of the mean of 1000 numbers in [0, 1): .009.
        assert!((mean - 0.5).abs() < 0.04, "{mean}");
        for x in -50..50 {
            let (a, b) = (ahead(Phase::Noise(40.0), x), ahead(Phase::Noise(40.0), x + 1));
            assert!((0.0..1.0).contains(&a));
            // The noise's slope is at most 3.76 a lattice cell.
            let apart = (a - b).abs();
            assert!(apart.min(1.0 - apart) <= 3.76 / 40.0, "{a} {b}");
        }
    }
}

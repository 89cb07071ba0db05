//! From measures to voxels: the block correlation that makes a marched block cover what was measured, then rate and SGGX.
//!
//! Based on: E. Heitz et al., *The SGGX Microflake Distribution*, SIGGRAPH 2015; D. Vicini et al., *A Non-Exponential
//! Transmittance Model for Volumetric Scene Representations*, SIGGRAPH 2021; G. Loubet, F. Neyret, *Hybrid Mesh-Volume
//! LoDs for All-Scale Pre-Filtering*, EG 2017.

use multiversion::multiversion;

use super::beams::Beams;
use super::ellipsoid::{SIDE, fit_weighted, sigmas};
use super::march::{Lines, MARCH_LINES, Trial};
use super::measure::Measure;
use super::refine::{Errors, Passed};
use crate::geom::{DVec3, Vec3, larger, smaller};
use crate::volume::chord::{Chords, LENGTHS, Lanes, MAX_RATE, box_areas, depth_for, exp_neg};
use crate::volume::voxel::{RATE_MAX, encode_rate};
use crate::volume::{Model, Sggx, Voxel};

/// Share of a support box from which on it is taken for opaque.
const OPAQUE: f32 = 0.996;
/// What a box that is opaque is taken to lose at least where its rate falls, by the rate's logarithm.
const LEAST_SLOPE: f32 = 0.15;
/// Fits of normals after the first; the factor from which on an opaque axis is taken for larger than asked for, and what its error
/// then weighs.
const ROUNDS: usize = 3;
const FREE: f32 = 1.02;
const LITTLE: f32 = 1e-4;

/// A voxel of a block, to be fitted.
pub struct Cell<'a> {
    /// Place in the block: x, y, z.
    pub at: [u8; 3],
    pub measure: &'a Measure,
}

/// What is known of all cells together.
pub struct Block<'a> {
    pub measure: &'a Measure,
    /// Which lines they block, with the insides of solids.
    pub beams: &'a Beams,
    /// Oblique area of what they block, with the insides of solids, an axis.
    pub cover: [f64; 13],
    /// Octants that are opaque, and no cells.
    pub closed: [bool; 8],
    /// Cells along the block's edge.
    pub width: usize,
}

/// What is known of a cell along the 13 axes, through the support box that a ray will see.
struct Seen {
    lo: Vec3,
    hi: Vec3,
    /// Share of the box that is blocked.
    blocked: Lanes,
    chords: Chords,
    /// Area of the box as it is seen.
    area: Lanes,
    /// `blocked` and `chords` of the box of what is there, before it is rounded outward: a layer that no line along it gets
    /// through is opaque that way, and not what is left when it is spread over a wider box.
    tight: (Lanes, Chords),
}

/// Thinnest tight box, voxel edges: as thin as a support box is. Rates beyond [`MAX_RATE`] would all be the same.
const THIN: f64 = 1.0 / 16.0;

impl Seen {
    #[inline(always)]
    fn new(cell: &Measure, voxel: &mut Voxel) -> Seen {
        voxel.set_support(cell.lo.to_array(), cell.hi.to_array());
        let (lo, hi) = voxel.support_box();
        let e = (hi - lo).as_dvec3();
        let oblique = box_areas(e);
        let tight = (cell.hi - cell.lo).max(DVec3::splat(THIN));
        let narrow = box_areas(tight);
        let mut cover = [0.0; 16];
        cover.iter_mut().zip(&cell.cover).for_each(|(to, &cover)| *to = cover as f32);
        let (mut blocked, mut area, mut inner) = ([0.0; 16], [0.0; 16], [0.0; 16]);
        for k in 0..16 {
            blocked[k] = (cover[k] / oblique[k]).clamp(0.0, OPAQUE);
            area[k] = oblique[k] / LENGTHS[k];
            inner[k] = (cover[k] / narrow[k]).clamp(0.0, OPAQUE);
        }
        Seen { lo, hi, blocked, chords: Chords::new(e), area, tight: (inner, Chords::new(tight)) }
    }

    /// How much an error of a rate counts along each axis, by what it changes of the area that is blocked, from 1 where little
    /// is: rates at which a box is opaque may be larger, and a thin sheet seen edge-on has no area.
    #[inline(always)]
    fn weights(&self, rates: &Lanes, slopes: &Lanes) -> Lanes {
        let (blocked, chords) = &self.tight;
        let mut weights = [1.0; 16];
        for k in 0..16 {
            // Towards opaque nothing is gained, but a lower rate loses.
            let slope = larger(slopes[k], LEAST_SLOPE * blocked[k]);
            let change = chords.inverse_mean[k] * slope / larger(rates[k], 1e-20);
            let weight = larger(smaller(change * change, 1.0), 1e-4);
            weights[k] = if rates[k] > 0.0 { weight } else { 1.0 };
        }
        weights
    }
}

/// What is asked of a cell's ellipsoid of normals, and the ellipsoid.
struct Wanted {
    /// Place among the cells.
    cell: usize,
    rates: Lanes,
    /// What an error of each counts.
    weights: Lanes,
    normals: Option<Sggx>,
}

/// Find the ellipsoids whose rates are nearest to what is wanted. Where a box is opaque, they may be any larger.
#[inline(always)]
fn find_normals(wanted: &mut [Wanted], seen: &[Seen]) {
    let mut left: Vec<usize> = (0..wanted.len()).collect();
    let mut lighter: Vec<Lanes> = wanted.iter().map(|w| w.weights).collect();
    for round in 0..=ROUNDS {
        for side in left.chunks(SIDE) {
            // Nothing is wanted of lanes without a cell.
            let (mut rates, mut weights) = ([[0.0; 16]; SIDE], [[0.0; 16]; SIDE]);
            for (n, &i) in side.iter().enumerate() {
                (rates[n], weights[n]) = (wanted[i].rates, lighter[i]);
            }
            for (&i, normals) in side.iter().zip(fit_weighted(&rates, &weights)) {
                wanted[i].normals = normals;
            }
        }
        if round == ROUNDS {
            return;
        }
        let mut again = Vec::with_capacity(left.len());
        for i in left {
            let Wanted { cell, rates, weights, normals } = &wanted[i];
            let Some(s) = normals else { continue };
            let (sigma, tight) = (sigmas(s), &seen[*cell].tight.0);
            lighter[i] = *weights;
            let mut any = false;
            for k in 0..13 {
                let free = tight[k] >= OPAQUE && sigma[k] > FREE * rates[k];
                lighter[i][k] *= if free { LITTLE } else { 1.0 };
                any |= free;
            }
            if any {
                again.push(i);
            }
        }
        left = again;
    }
}

/// Steps in which errors are summed: far below what they are, and 2^40 errors fit.
const UNIT: f32 = 16_777_216.0;
/// Steps of the errors' histogram, from 0 to 1.
const BINS: usize = 256;

/// How far fitted blocks are from what was measured: |share of a square one voxel wide that is covered, marched − measured|, of
/// all squares in which there is anything, along 13 axes.
#[derive(Debug, Clone, Default)]
pub struct Certificate {
    count: u64,
    /// In parts of 1 / `UNIT`.
    sum: u64,
    /// Squares by error, in four counts that are added to by turns, since many follow one another that count alike; the last are
    /// those with nothing in them.
    histogram: Vec<[u64; 4]>,
}

impl Certificate {
    /// Add the errors of a block's squares; there is nothing in those whose error is below 0.
    #[inline(always)]
    fn add(&mut self, errors: &Errors) {
        self.histogram.resize(BINS + 2, [0; 4]);
        let (mut sums, mut counts) = ([0u32; 16], [0u32; 16]);
        for errors in errors.as_chunks::<16>().0 {
            let mut steps = [0; 16];
            for n in 0..16 {
                // Summed in fixed steps, so that the order in which regions are joined cannot show.
                sums[n] += (larger(errors[n], 0.0) * UNIT) as i32 as u32;
                counts[n] += u32::from(errors[n] >= 0.0);
                let step = (errors[n] * BINS as f32) as i32;
                steps[n] = if errors[n] >= 0.0 { step.min(BINS as i32) } else { BINS as i32 + 1 };
            }
            for n in 0..16 {
                if let Some(counts) = self.histogram.get_mut(steps[n] as usize) {
                    counts[n % 4] += 1;
                }
            }
        }
        for n in 0..16 {
            self.count += u64::from(counts[n]);
            self.sum += u64::from(sums[n]);
        }
    }

    pub fn merge(&mut self, other: &Certificate) {
        self.count += other.count;
        self.sum += other.sum;
        self.histogram.resize(BINS + 2, [0; 4]);
        for (mine, theirs) in self.histogram.iter_mut().zip(&other.histogram) {
            for n in 0..4 {
                mine[n] += theirs[n];
            }
        }
    }

    /// Mean and 95th percentile; 0 where there are no voxels.
    pub fn figures(&self) -> (f64, f64) {
        let mean = self.sum as f64 / f64::from(UNIT) / self.count.max(1) as f64;
        let mut left = self.count - self.count * 95 / 100;
        for (step, counts) in self.histogram.iter().enumerate().take(BINS + 1).rev() {
            let n = counts.iter().sum::<u64>();
            if n >= left {
                return (mean, (step as f64 + 0.5) / BINS as f64);
            }
            left -= n;
        }
        (mean, 0.0)
    }
}

/// Fit all cells of one block. Voxels come in the order of the cells. Gives what a ray finds of them, where `march` asks for it.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt+popcnt"))]
pub fn fit_block(
    cells: &[Cell],
    of: &Block,
    march: bool,
    model: Model,
    voxels: &mut Vec<Voxel>,
    certificate: &mut Certificate,
) -> Option<Passed> {
    let (block, width) = (of.measure, of.width);
    let mut fitted = [Voxel::default(); 64];
    let mut seen = Vec::with_capacity(cells.len());
    for (voxel, cell) in fitted.iter_mut().zip(cells) {
        seen.push(Seen::new(cell.measure, voxel));
    }
    let lines = Lines::new(cells.iter().zip(&seen).map(|(cell, seen)| (cell.at, seen.lo, seen.hi)), width);
    // Specks are independent by nature, and known exactly; which lines they meet is drawn by chance.
    let soft = block.is_soft();
    let code = if soft { 0 } else { correlation(cells, &seen, &lines, block, width) };
    let c = f32::from(code) / 15.0;
    // Hits a voxel edge along each axis.
    let mut along = vec![[0.0f32; 16]; cells.len()];
    let mut levels = [0.0f32; 64];
    let mut open = Vec::with_capacity(cells.len());
    for (i, (voxel, cell)) in fitted.iter_mut().zip(cells).enumerate() {
        let m = cell.measure;
        voxel.correlation = code;
        voxel.set_albedo(m.albedo.to_array());
        if m.total > 0.0 {
            voxel.set_mean_normal(m.mean.to_array(), m.mean.length() / m.total);
        }
        if m.solid {
            voxel.rate = RATE_MAX;
            along[i] = [MAX_RATE; 16];
        } else {
            let (inner, chords) = &seen[i].tight;
            let (rates, slopes) = chords.rates(inner, c);
            open.push(Wanted { cell: i, rates, weights: seen[i].weights(&rates, &slopes), normals: None });
        }
    }
    find_normals(&mut open, &seen);
    for &Wanted { cell: i, normals, .. } in &open {
        let Some(s) = normals else { continue };
        fitted[i].ndf = s.encode();
        let sigma = sigmas(&Sggx::decode(fitted[i].ndf));
        levels[i] = level(&sigma, s.scale(), &seen[i], c);
        for k in 0..16 {
            along[i][k] = levels[i] * sigma[k];
        }
    }
    let depths = lines.depths(&along);
    let mut through = Passed::of_block(MARCH_LINES * width, c, (cells.len(), of.closed), &depths);
    let mut log = 0.0;
    if cells.len() > 1 && !soft {
        log = through.wish(&of.cover);
        through.change(log);
    }
    if model == Model::Coverage {
        certificate.add(&through.compare(of.beams));
    }
    for ((voxel, cell), &rate) in fitted.iter_mut().zip(cells).zip(&levels) {
        if rate > 0.0 {
            let e = exp_neg(log.abs());
            voxel.rate = encode_rate(f64::from(if log < 0.0 { rate * e } else { rate / e }));
        }
        if model == Model::Neyret {
            neyret(voxel, cell.measure);
        }
        voxels.push(*voxel);
    }
    march.then_some(through)
}

/// The rate, near `rate`, with which a voxel whose normals have the projected areas `sigma` covers the area that was measured,
/// summed over the 13 axes.
#[inline(always)]
fn level(sigma: &Lanes, rate: f32, seen: &Seen, c: f32) -> f32 {
    // By area: a thin sheet seen edge-on has next to none.
    let want = sum_areas(&seen.blocked, seen);
    let mut rate = rate;
    for _ in 0..2 {
        let mut rates = *sigma;
        rates.iter_mut().for_each(|r| *r = larger(*r * rate, 1e-12));
        let more = want / sum_areas(&seen.chords.blocked(&rates, c), seen);
        if (more - 1.0).abs() < 0.005 {
            break;
        }
        // Where almost all is blocked, the sum hardly moves with the rate.
        rate = (rate * more.clamp(0.5, 2.0)).min(MAX_RATE);
    }
    rate
}

/// What `shares` of a box cover, summed over the 13 axes.
#[inline(always)]
fn sum_areas(shares: &Lanes, seen: &Seen) -> f32 {
    (0..13).map(|k| shares[k] * seen.area[k]).sum()
}

/// The paper's own model: one isotropic opacity, the mean of what is covered, as a rate that takes that much away over a
/// voxel's edge; the ellipsoid is left for shading, and there is neither support nor correlation.
fn neyret(voxel: &mut Voxel, m: &Measure) {
    voxel.correlation &= 0xf0;
    voxel.support = Voxel::default().support;
    if !m.solid {
        let opacity = m.averaged.min(OPAQUE.into());
        voxel.rate = encode_rate(-libm::log(1.0 - opacity));
    }
}

/// The code of the c with which the marched block best covers what was measured, in 13 directions.
#[inline(always)]
fn correlation(cells: &[Cell], seen: &[Seen], lines: &Lines, block: &Measure, width: usize) -> u8 {
    if cells.len() < 2 {
        return 15;
    }
    let (apart, full) = (trial::<false>(seen, lines), trial::<true>(seen, lines));
    // What the cells cover one by one, an axis.
    let mut parts = [0.0; 13];
    for cell in cells {
        for k in 0..13 {
            parts[k] += cell.measure.cover[k];
        }
    }
    // What hides behind other cells at c = 1, and how much more at 0, and of that at 1/2; as measured; and how much it counts.
    let (mut least_hides, mut more, mut middle) = ([0.0f32; 16], [0.0f32; 16], [0.0f32; 16]);
    let (mut wanted, mut weight) = ([0.0f32; 16], [0.0f32; 16]);
    for k in 0..13 {
        if parts[k] <= 0.0 {
            continue;
        }
        wanted[k] = (1.0 - (width * width) as f64 * block.cover[k] / parts[k]).clamp(0.0, 1.0) as f32;
        weight[k] = parts[k] as f32 / LENGTHS[k];
        let hidden = |t: &Trial| if t.alone[k] > 0.0 { 1.0 - t.together[k] / t.alone[k] } else { wanted[k] };
        let (most, least) = (hidden(&apart), hidden(&full));
        (least_hides[k], more[k]) = (least, most - least);
        middle[k] = MIDDLE[0] + MIDDLE[1] * most + MIDDLE[2] * least;
    }
    let (mut best, mut least) = (0, f32::INFINITY);
    for code in 0..16u8 {
        let c = f32::from(code) / 15.0;
        // Through the three: Lagrange's parabola.
        let (first, second) = ((1.0 - c) * (1.0 - 2.0 * c), 4.0 * c * (1.0 - c));
        let mut misses = [0.0f32; 16];
        for k in 0..16 {
            let hides = least_hides[k] + more[k] * (first + second * middle[k]);
            let miss = weight[k] * (hides - wanted[k]);
            misses[k] = miss * miss;
        }
        let error = misses.iter().sum();
        if error < least {
            (best, least) = (code, error);
        }
    }
    best
}

/// What hides at c = 1/2 lies between what does at c = 1 and at 0, by this share: a constant, and what hides at 0 and at 1 times these.
/// By least squares over the blocks of four texels (a nut, a wall, fur, a tree of triangles; 64^3): right to .005, rms, of what is
/// covered, as good as marching once more.
const MIDDLE: [f32; 3] = [0.21, 1.6, -2.22];

/// What the cells block at c = 0, or at 1 if they are `FULL`y correlated, with rates by the mean chord: what hides behind what hardly
/// depends on it.
#[inline(always)]
fn trial<const FULL: bool>(seen: &[Seen], lines: &Lines) -> Trial {
    let mut rates = Vec::with_capacity(seen.len());
    for s in seen {
        let mut own = [0.0; 16];
        for k in 0..16 {
            own[k] = s.chords.inverse_mean[k] * depth_for(s.blocked[k], if FULL { 1.0 } else { 0.0 });
        }
        rates.push(own);
    }
    lines.blocked::<FULL>(&rates)
}

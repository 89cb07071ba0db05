//! A stack as a source: its iso-surface is extracted a region at a time, and matter with values above the threshold is opaque.

use super::lattice::{Lattice, MAX_SIGMA, Scratch, margin};
use super::march::LatticeBlock;
use super::ranges::{Range, Scan};
use super::soft::{Field, MediumSampler};
use super::transfer::TransferSpec;
use super::{Stack, StackOptions};
use crate::error::short;
use crate::geom::polygon::Polygon;
use crate::geom::{Aabb, DAffine3, DMat3, DVec3};
use crate::progress::Progress;
use crate::source::loops::facets;
use crate::source::placement::Placement;
use crate::source::traits::{Source, Staged, Surface};
use crate::source::{Medium, min_extinction};
use crate::{Error, Result, Warnings, morton, par};

/// A stack, and the transfer function that says which of its values are matter.
pub struct StackSource {
    stack: Stack,
    transfer: TransferSpec,
    /// Smallest value that is solid; infinite where none is.
    iso: f32,
    sigma: f64,
    bricks: Vec<Range>,
    /// Number of bricks along each axis.
    size: [usize; 3],
    /// Value that stands for the outside of the stack.
    outside: f32,
    /// Whether samples without a value have to be skipped one by one, because every value may be soft matter and so none can stand for
    /// empty space.
    masked: bool,
    bounds: Aabb,
    notes: Vec<String>,
}

/// Number of cells along the longest axis of the lattice by which the bounds are found.
const BOUNDS_CELLS: usize = 256;

const NO_VALUE: &str = "samples without a value (NaN, infinite or padding) count as nothing";

/// A value that is clearly smaller.
fn below(value: f32) -> f32 {
    value - value.abs().max(1.0)
}

/// Transfer function of the options and their table. Where neither has any opacity, it is Otsu's threshold, and `notes` gets a line that
/// says so.
fn transfer_function(
    options: &StackOptions,
    stack: &Stack,
    scan: &Scan,
    notes: &mut Vec<String>,
) -> Result<TransferSpec> {
    let mut transfer = options.transfer.clone();
    if let Some(path) = &options.table {
        let table = TransferSpec::read(path)?;
        transfer = TransferSpec { iso: transfer.iso.or(table.iso), ..table };
    }
    transfer.check()?;
    if transfer.is_empty() {
        let otsu = scan.otsu(&stack.samples).ok_or_else(|| {
            let what = "all its values are the same: there is nothing to tell apart; give option `iso`";
            Error::input(&stack.path, "", what)
        })?;
        let [at, lo, hi] = [otsu, scan.whole.lo, scan.whole.hi].map(|v| short(v.into()));
        notes.push(format!("option `iso` = {at}: Otsu's threshold of values from {lo} to {hi}"));
        transfer.iso = Some(f64::from(otsu));
    }
    Ok(transfer)
}

impl StackSource {
    /// Source of the matter that the options' transfer function makes of a stack.
    ///
    /// # Errors
    /// [`Error::Options`] where an option is out of range, [`Error::Input`] where no sample has a value, or all values are the same and
    /// the options have no threshold.
    pub fn new(mut stack: Stack, options: &StackOptions) -> Result<StackSource> {
        if !(0.0..=MAX_SIGMA).contains(&options.sigma) {
            return Err(Error::Options(format!(
                "option `sigma` = {}: 0 to {MAX_SIGMA}, in distances of samples",
                short(options.sigma)
            )));
        }
        let samples = &mut stack.samples;
        samples.value_is_alpha(samples.has_alpha());
        let mut scan = Scan::new(samples);
        if samples.has_alpha() && scan.whole.lo == scan.whole.hi {
            // Opaque everywhere: that says nothing.
            samples.value_is_alpha(false);
            scan = Scan::new(samples);
        }
        if scan.whole.hi < scan.whole.lo {
            return Err(Error::input(
                &stack.path,
                "",
                "none of its samples has a value: all are NaN, infinite or padding",
            ));
        }
        stack.warnings.add_many(NO_VALUE, scan.missing);
        let mut notes = Vec::new();
        let transfer = transfer_function(options, &stack, &scan, &mut notes)?;
        let dims = stack.samples.dims();
        let (iso, least) = (transfer.solid_from() as f32, transfer.matter_from() as f32);
        // A value that is no matter, whatever the threshold.
        let outside = if least > scan.whole.lo { scan.whole.lo } else { below(least) };
        stack.samples.missing = match () {
            // The value that programs without NaN write in its place.
            () if least > 0.0 => 0.0,
            () if least > f32::NEG_INFINITY => outside,
            // Any value may be soft matter: voxels leave these samples out one by one.
            () => scan.whole.lo.min(below(iso)),
        };
        let masked = scan.missing > 0 && least == f32::NEG_INFINITY;
        scan.fill_missing(stack.samples.missing);
        let (bricks, size) = scan.bricks(dims, margin(options.sigma));
        let mut source = StackSource {
            stack,
            transfer,
            iso,
            sigma: options.sigma,
            bricks,
            size,
            outside,
            masked,
            bounds: Aabb::EMPTY,
            notes,
        };
        source.bounds = source.find_bounds(least);
        Ok(source)
    }

    fn brick(&self, at: [usize; 3]) -> Range {
        self.bricks[(at[2] * self.size[1] + at[1]) * self.size[0] + at[0]]
    }

    /// Whether the iso-surface may pass through a brick: its values are on both sides of the threshold, or above it at the stack's border.
    fn may_cross(&self, at: [usize; 3], iso: f32) -> bool {
        let range = self.brick(at);
        let border = (0..3).any(|a| at[a] == 0 || at[a] + 1 == self.size[a]);
        range.hi >= iso && (range.lo < iso || border)
    }

    /// Whether there may be semi-transparent matter in a brick.
    fn may_be_soft(&self, at: [usize; 3]) -> bool {
        let range = self.brick(at);
        let (lo, hi) = (f64::from(range.lo), f64::from(range.hi));
        self.transfer.is_soft() && range.lo < self.iso && self.transfer.most(lo, hi) > 0.0
    }

    /// The loops at `iso` of a brick's cells that overlap the index-space box.
    fn loops(
        &self,
        lattice: &Lattice,
        (at, window): ([usize; 3], Aabb),
        iso: f32,
        scratch: &mut Scratch,
        each: &mut dyn FnMut(&[DVec3]),
    ) {
        let cells: [std::ops::Range<usize>; 3] =
            std::array::from_fn(|a| lattice.axes[a].cells(at[a], window.min[a], window.max[a]));
        if cells.iter().any(std::ops::Range::is_empty) {
            return;
        }
        let from = cells.each_ref().map(|c| c.start);
        let size = cells.each_ref().map(|c| c.len() + 1);
        lattice.fill(&self.stack.samples, from, size, self.outside, scratch);
        let above = scratch.values.iter().filter(|v| **v >= iso).count();
        if above > 0 && above < scratch.values.len() {
            LatticeBlock { lattice, from, size, iso }.loops(scratch, each);
        }
    }

    /// Box around all matter, whose values are at least `least`.
    fn find_bounds(&self, least: f32) -> Aabb {
        let dims = self.stack.samples.dims();
        if least == f32::NEG_INFINITY {
            return index_bounds(dims).transformed(self.stack.affine);
        }
        let longest = dims.iter().copied().max().unwrap_or(1);
        let lattice = Lattice::new(dims, [(BOUNDS_CELLS / longest).clamp(1, 8); 3], self.sigma);
        let everywhere = Aabb::new(DVec3::NEG_INFINITY, DVec3::INFINITY);
        let layers = par::map(self.size[2], |z| {
            let mut bounds = Aabb::EMPTY;
            let mut scratch = Scratch::default();
            for y in 0..self.size[1] {
                for x in 0..self.size[0] {
                    if self.may_cross([x, y, z], least) {
                        let brick = ([x, y, z], everywhere);
                        self.loops(&lattice, brick, least, &mut scratch, &mut |corners| {
                            for c in corners {
                                bounds = bounds.grow(self.stack.affine.transform_point3(*c));
                            }
                        });
                    }
                }
            }
            bounds
        });
        layers.into_iter().fold(Aabb::EMPTY, Aabb::union)
    }
}

impl Source for StackSource {
    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn metres_per_unit(&self) -> f64 {
        self.stack.metres_per_unit
    }

    fn facet_size(&self) -> f64 {
        0.0
    }

    fn has_colour(&self) -> bool {
        self.stack.samples.has_colour() || self.transfer.has_colour()
    }

    fn warnings(&self) -> &Warnings {
        &self.stack.warnings
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn up(&self) -> u8 {
        2
    }

    fn stage<'a>(&'a self, place: &Placement, progress: &dyn Progress) -> Result<Box<dyn Staged + 'a>> {
        let origin = place.to_grid(self.stack.affine.translation);
        let along = |axis: DVec3| place.to_grid(self.stack.affine.transform_point3(axis)) - origin;
        let matrix = DMat3::from_cols(along(DVec3::X), along(DVec3::Y), along(DVec3::Z));
        let to_grid = DAffine3 { matrix3: matrix, translation: origin };
        // Cells no larger than voxels.
        let parts = std::array::from_fn(|a| matrix.col(a).length().ceil().clamp(1.0, MAX_PARTS) as usize);
        let dims = self.stack.samples.dims();
        let bounds = index_bounds(dims);
        let images: Vec<PeriodicImage> = place
            .shifts(bounds.transformed(to_grid))
            .into_iter()
            .map(|shift| {
                let to_grid = DAffine3 { translation: to_grid.translation + shift, ..to_grid };
                PeriodicImage { shift, to_grid, to_index: to_grid.inverse() }
            })
            .collect();
        let mut staged = StagedStack {
            source: self,
            place: *place,
            lattice: Lattice::aligned(dims, &to_grid, self.sigma)
                .unwrap_or_else(|| Lattice::new(dims, parts, self.sigma)),
            images,
            mirrored: matrix.determinant() < 0.0,
            distance: libm::cbrt(matrix.determinant().abs()),
            width: f64::from(1u32 << place.region_log2()),
            regions: Vec::new(),
            weights: Vec::new(),
        };
        staged.find_regions(place, bounds, progress);
        Ok(Box::new(staged))
    }
}

/// Largest number of cells between two samples.
const MAX_PARTS: f64 = 8192.0;
/// Voxels along the edge of a block whose soft matter is found together.
const MEDIUM_BLOCK: u32 = 8;
/// Number of facets that a brick is counted as.
const BRICK_WEIGHT: u64 = 64;

/// Box of a stack in index space.
fn index_bounds(dims: [usize; 3]) -> Aabb {
    Aabb::new(DVec3::splat(-0.5), DVec3::from(dims.map(|d| d as f64 - 0.5)))
}

/// Move coordinates that are within rounding errors of a plane between voxels onto it, so that clipping leaves no slivers.
fn snapped(p: DVec3) -> DVec3 {
    // Adding and subtracting this constant rounds to the nearest whole number, since at its magnitude the last bit is worth 1.
    const ROUND: f64 = 1.5 * (1u64 << 52) as f64;
    let plane = (p + ROUND) - ROUND;
    DVec3::select((p - plane).abs().cmplt(DVec3::splat(1e-7)), plane, p)
}

/// One of the periodic images of the stack, which repeats along cyclic axes of the grid.
struct PeriodicImage {
    shift: DVec3,
    to_grid: DAffine3,
    to_index: DAffine3,
}

struct StagedStack<'a> {
    source: &'a StackSource,
    place: Placement,
    lattice: Lattice,
    images: Vec<PeriodicImage>,
    mirrored: bool,
    /// Distance of samples, in voxels: the geometric mean of the three.
    distance: f64,
    /// Width of a region, in voxels.
    width: f64,
    regions: Vec<u64>,
    weights: Vec<u64>,
}

impl StagedStack<'_> {
    /// Box of the region `code` in the index space of an image, enlarged by a rounding error.
    fn region(&self, code: u64, image: &PeriodicImage) -> Aabb {
        let lo = DVec3::from(morton::decode(code).map(f64::from)) * self.width;
        Aabb::new(lo, lo + self.width).transformed(image.to_index).rounded_out()
    }

    /// Call `each` for the bricks that overlap a box in index space.
    fn bricks(&self, window: Aabb, each: &mut dyn FnMut([usize; 3])) {
        let beyond = |a: usize| {
            let last = *self.lattice.axes[a].nodes.last().unwrap_or(&0.0);
            window.max[a] < -0.5 || window.min[a] > last
        };
        if (0..3).any(beyond) {
            return;
        }
        let span = |a: usize| self.lattice.axes[a].bricks(window.min[a], window.max[a]);
        for z in span(2) {
            for y in span(1) {
                for x in span(0) {
                    each([x, y, z]);
                }
            }
        }
    }

    fn find_regions(&mut self, place: &Placement, bounds: Aabb, progress: &dyn Progress) {
        let across = f64::from(place.side() >> place.region_log2());
        // Codes of the regions that an image's box overlaps.
        let mut codes = Vec::new();
        for image in &self.images {
            let b = bounds.transformed(image.to_grid);
            let lo = (b.min / self.width).floor().clamp(DVec3::ZERO, DVec3::splat(across)).as_uvec3();
            let hi = ((b.max / self.width).floor() + 1.0).clamp(DVec3::ZERO, DVec3::splat(across)).as_uvec3();
            for z in lo.z..hi.z {
                for y in lo.y..hi.y {
                    codes.extend((lo.x..hi.x).map(|x| morton::encode([x, y, z])));
                }
            }
        }
        codes.sort_unstable();
        codes.dedup();
        progress.stage("sort", codes.len() as u64);
        let weights = par::map(codes.len(), |i| {
            let (mut there, mut crossing) = (false, 0);
            for image in &self.images {
                self.bricks(self.region(codes[i], image), &mut |at| {
                    let source = self.source;
                    there |= source.brick(at).hi >= source.iso || source.may_be_soft(at);
                    crossing += u64::from(source.may_cross(at, source.iso));
                });
            }
            progress.advance(1);
            there.then_some(crossing * BRICK_WEIGHT)
        });
        for (code, weight) in codes.into_iter().zip(weights) {
            if let Some(weight) = weight {
                self.regions.push(code);
                self.weights.push(weight);
            }
        }
    }

    /// The soft matter of a cube of `width` voxels.
    fn medium_of_block(&self, corner: [u32; 3], width: u32, scratch: &mut Scratch, each: &mut dyn FnMut(&Medium)) {
        let source = self.source;
        let samples = &source.stack.samples;
        let lo = DVec3::from(corner.map(f64::from));
        let own = |p: DVec3| (samples.has_colour() && !source.transfer.has_colour()).then(|| source.colour(p));
        // Whether each voxel got its medium from an earlier image.
        let mut taken = vec![false; (width * width * width) as usize];
        for image in &self.images {
            let block = Aabb::new(lo, lo + f64::from(width)).transformed(image.to_index);
            let mut there = false;
            self.bricks(block, &mut |at| there |= source.may_be_soft(at));
            if !there {
                continue;
            }
            let field = Field::new(&self.lattice, samples, block, scratch);
            let sampler = MediumSampler {
                transfer: &source.transfer,
                solid_from: f64::from(source.iso),
                to_index: image.to_index,
                distance: self.distance,
                least: min_extinction(self.place.side()),
                index_bounds: index_bounds(samples.dims()),
                masked: source.masked,
            };
            for (n, taken) in taken.iter_mut().enumerate().filter(|t| !*t.1) {
                let n = n as u32;
                let step = [n % width, n / width % width, n / width / width];
                let medium = sampler.voxel(&field, std::array::from_fn(|a| corner[a] + step[a]), &own);
                if let Some(medium) = medium {
                    each(&medium);
                    *taken = true;
                }
            }
        }
    }

    /// Position in index space, and value, of the first image that contains the grid point `at`.
    fn value(&self, at: DVec3) -> Option<(DVec3, f32)> {
        self.images.iter().find_map(|image| {
            let index = image.to_index.transform_point3(at);
            Some((index, self.lattice.value(&self.source.stack.samples, index.to_array())?))
        })
    }
}

impl Staged for StagedStack<'_> {
    fn regions(&self) -> &[u64] {
        &self.regions
    }

    fn weight(&self, region: usize) -> u64 {
        self.weights[region]
    }

    fn facets(&self) -> u32 {
        1
    }

    fn emit(&self, region: usize, each: &mut dyn FnMut(&Polygon)) {
        let mut scratch = Scratch::default();
        let bounds = self.source.bounds;
        for image in &self.images {
            // By the same steps as the bounds, which facets of finer cells may pass by a hair: nothing sticks out.
            let to_grid = |index: DVec3| {
                let p = self.source.stack.affine.transform_point3(index);
                snapped(self.place.to_grid(p.clamp(bounds.min, bounds.max)) + image.shift)
            };
            let window = self.region(self.regions[region], image);
            self.bricks(window, &mut |at| {
                if self.source.may_cross(at, self.source.iso) {
                    let iso = self.source.iso;
                    self.source.loops(&self.lattice, (at, window), iso, &mut scratch, &mut |corners| {
                        let mut points = [DVec3::ZERO; 12];
                        let n = corners.len().min(points.len());
                        for (i, c) in corners.iter().take(n).enumerate() {
                            points[if self.mirrored { n - 1 - i } else { i }] = to_grid(*c);
                        }
                        facets(&points[..n], each);
                    });
                }
            });
        }
    }

    fn surface(&self, _: u32, at: DVec3, _: f64) -> Surface {
        let source = self.source;
        let mut albedo = [1.0; 3];
        if source.transfer.has_colour() {
            albedo = source.transfer.colour(f64::from(source.iso));
        } else if source.stack.samples.has_colour() {
            let dims = source.stack.samples.dims();
            let there = |p: &DVec3| (0..3).all(|a| p[a] > -1.0 && p[a] < dims[a] as f64);
            let p = self.images.iter().map(|c| c.to_index.transform_point3(at)).find(there);
            albedo = p.map_or(albedo, |p| source.colour(p));
        }
        Surface { albedo, alpha: 1.0 }
    }

    fn has_alpha(&self, _: u32) -> bool {
        false
    }

    fn one_sided(&self, _: u32) -> bool {
        true
    }

    fn medium(&self, region: usize, each: &mut dyn FnMut(&Medium)) {
        if !self.source.transfer.is_soft() {
            return;
        }
        let corner = morton::decode(self.regions[region]).map(|v| v * self.width as u32);
        let block = MEDIUM_BLOCK.min(self.width as u32);
        let mut scratch = Scratch::default();
        for n in 0..u64::from(self.width as u32 / block).pow(3) {
            let step = morton::decode(n);
            self.medium_of_block(std::array::from_fn(|a| corner[a] + step[a] * block), block, &mut scratch, each);
        }
    }

    fn inside(&self, at: DVec3) -> bool {
        self.value(at).is_some_and(|(_, v)| v >= self.source.iso)
    }
}

impl StackSource {
    /// Linear colour at an index-space point, between the samples around that are matter, or all of them.
    fn colour(&self, p: DVec3) -> [f32; 3] {
        let samples = &self.stack.samples;
        let dims = samples.dims();
        let mut sums = [[0.0f32; 4]; 2];
        for c in 0..8usize {
            let mut weight = 1.0;
            let index: [usize; 3] = std::array::from_fn(|a| {
                let x = p[a].clamp(0.0, (dims[a] - 1) as f64);
                let upper = c >> a & 1;
                let t = x - x.floor();
                weight *= if upper == 1 { t } else { 1.0 - t } as f32;
                (x as usize + upper).min(dims[a] - 1)
            });
            if weight <= 0.0 {
                continue;
            }
            let mut value = [0.0];
            samples.row(index[0], index[1], index[2], &mut value);
            let [r, g, b] = samples.colour(index);
            let matter = f64::from(value[0]) >= self.transfer.matter_from();
            for sum in &mut sums[usize::from(!matter)..] {
                sum.iter_mut().zip([r, g, b, 1.0]).for_each(|(s, v)| *s += weight * v);
            }
        }
        let [r, g, b, w] = if sums[0][3] > 0.0 { sums[0] } else { sums[1] };
        [r, g, b].map(|v| (v / w.max(1e-20)).clamp(0.0, 1.0))
    }
}

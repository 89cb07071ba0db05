//! A trilinear map of the unit cube into space, and its inverse, computed with a guarantee that no solution is missed.
//!
//! Based on: R. Krawczyk, *Newton-Algorithmen zur Bestimmung von Nullstellen mit Fehlerschranken*, Computing 1969, and R. Moore,
//! *A Test for Existence of Solutions to Nonlinear Systems*, SINUM 1977 (a map that differs from its linear part by less than
//! that itself has one root in a cell, and where it lies is found by contraction; other cells are cut); R. Farouki, *The Bernstein
//! Polynomial Basis*, CAGD 2012 (a polynomial lies within the bounds of its coefficients, closer the smaller the cell).
//!
//! With J the derivative in the middle of a cell, J⁻¹ times the map differs from the identity by a remainder. The derivative is linear
//! along each axis, so the norm of the remainder's derivative (the cell's strain) is largest at one of the cell's corners.

use crate::geom::{DMat3, DVec3};

/// x(U, V, W) = a₀ + U a₁ + V a₂ + UV a₃ + W (b₀ + U b₁ + V b₂ + UV b₃).
#[derive(Debug, Clone)]
pub struct Trilinear {
    a: [DVec3; 4],
    b: [DVec3; 4],
}

/// A cube of parameters (U, V, W), and the map linearised around its middle.
#[derive(Debug, Clone, Copy)]
struct Cell {
    low: DVec3,
    size: f64,
    /// The inverse of the derivative in the middle.
    inverse: DMat3,
    /// Largest norm (maximum norm) of `inverse` times the derivative, less the identity, over the cell.
    strain: f64,
    /// Lower and upper bounds of the images of the cell's corners, times `inverse`, padded against rounding.
    hull: [DVec3; 2],
}

/// A trilinear map that is known to have an inverse.
#[derive(Debug, Clone)]
pub struct Inverse {
    map: Trilinear,
    whole: Cell,
}

/// Distance beyond the unit cube at which a solution is still found.
pub const RIM: f64 = 1e-6;
/// Below this strain the iteration in a cell contracts to its root; a cell of larger strain is subdivided.
const CONTRACTION_STRAIN: f64 = 0.5;
/// Most subdivisions of a cell, each into eight: in the test that the map has an inverse, and in the search for a solution.
const VALIDITY_CUTS: u32 = 3;
const SEARCH_CUTS: u32 = 8;
/// Newton's steps double the digits: after one of this size nothing is left of the error.
const LAST_STEP: f64 = 1e-9;

impl Trilinear {
    /// `base` and `rise` at (U, V) = (0, 0), (1, 0), (1, 1), (0, 1): x = base + W rise.
    pub fn new(base: [DVec3; 4], rise: [DVec3; 4]) -> Trilinear {
        let form = |[p00, p10, p11, p01]: [DVec3; 4]| [p00, p10 - p00, p01 - p00, (p11 - p10) - (p01 - p00)];
        Trilinear { a: form(base), b: form(rise) }
    }

    pub fn at(&self, s: DVec3) -> DVec3 {
        self.mix(&self.a, s) + s.z * self.mix(&self.b, s)
    }

    fn mix(&self, [c0, c1, c2, c3]: &[DVec3; 4], s: DVec3) -> DVec3 {
        *c0 + s.x * *c1 + s.y * (*c2 + s.x * *c3)
    }

    /// d x / d (U, V, W).
    pub fn derivative(&self, s: DVec3) -> DMat3 {
        let ([_, a1, a2, a3], [_, b1, b2, b3]) = (&self.a, &self.b);
        DMat3::from_cols(
            *a1 + s.y * *a3 + s.z * (*b1 + s.y * *b3),
            *a2 + s.x * *a3 + s.z * (*b2 + s.x * *b3),
            self.mix(&self.b, s),
        )
    }

    /// The second derivative of x(s + r v) with respect to r, at r = 0.
    pub fn second_derivative(&self, s: DVec3, v: DVec3) -> DVec3 {
        let ([.., a3], [_, b1, b2, b3]) = (&self.a, &self.b);
        let (uv, uw, vw) = (*a3 + s.z * *b3, *b1 + s.y * *b3, *b2 + s.x * *b3);
        2.0 * (v.x * v.y * uv + v.x * v.z * uw + v.y * v.z * vw)
    }

    /// `None` where the derivative in the middle has no inverse.
    fn cell(&self, low: DVec3, size: f64) -> Option<Cell> {
        let inverse = self.derivative(low + 0.5 * size).inverse();
        if !inverse.is_finite() {
            return None;
        }
        let strain = corners(low, size)
            .map(|s| {
                let off = inverse * self.derivative(s) - DMat3::IDENTITY;
                (off.x_axis.abs() + off.y_axis.abs() + off.z_axis.abs()).max_element()
            })
            .fold(0.0, f64::max);
        let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for s in corners(low, size) {
            let y = inverse * self.at(s);
            (least, most) = (least.min(y), most.max(y));
        }
        let pad = 1e-14 * (least.abs().max(most.abs()).max_element() + size);
        strain.is_finite().then_some(Cell { low, size, inverse, strain, hull: [least - pad, most + pad] })
    }

    /// Whether the determinant of the derivative provably has one sign in all of a cell, by at most `cuts` subdivisions. It is a
    /// polynomial of degree 2 along each axis, so it lies between its least and its largest Bernstein coefficient.
    fn has_signed_volume(&self, low: DVec3, size: f64, cuts: u32) -> bool {
        let at = |k: usize| DVec3::new((k % 3) as f64, (k / 3 % 3) as f64, (k / 9) as f64);
        let mut c: [f64; 27] = std::array::from_fn(|k| self.derivative(low + 0.5 * size * at(k)).determinant());
        let has_sign = |v: &f64| v.is_finite() && *v != 0.0 && (*v > 0.0) == (c[0] > 0.0);
        if !c.iter().all(has_sign) {
            return false;
        }
        for step in [1, 3, 9] {
            for k in (0..27).filter(|k| k / step % 3 == 1) {
                c[k] = 2.0 * c[k] - 0.5 * (c[k - step] + c[k + step]);
            }
        }
        if c.iter().all(|v| *v != 0.0 && (*v > 0.0) == (c[0] > 0.0)) {
            return true;
        }
        cuts > 0 && corners(low, 0.5 * size).all(|low| self.has_signed_volume(low, 0.5 * size, cuts - 1))
    }
}

/// The eight corners of a cube.
fn corners(low: DVec3, size: f64) -> impl Iterator<Item = DVec3> {
    (0..8).map(move |k: u32| low + size * DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2)))
}

/// Distance of a point outside of the unit cube (maximum norm); 0 or negative inside.
pub fn outside(s: DVec3) -> f64 {
    (-s).max(s - 1.0).max_element()
}

impl Inverse {
    /// `None` where the map is not provably invertible in the unit cube: it turns inside out or is flat somewhere, or nearly so.
    pub fn new(map: Trilinear) -> Option<Inverse> {
        if !map.has_signed_volume(DVec3::ZERO, 1.0, VALIDITY_CUTS) {
            return None;
        }
        let whole = map.cell(DVec3::splat(-RIM), 1.0 + 2.0 * RIM)?;
        Some(Inverse { map, whole })
    }

    pub fn map(&self) -> &Trilinear {
        &self.map
    }

    /// The point in the unit cube, or up to [`RIM`] outside, that the map takes to `x`.
    pub fn locate(&self, x: DVec3) -> Option<DVec3> {
        self.search(x, &self.whole, SEARCH_CUTS)
    }

    /// [`Inverse::locate`], faster where `guess` is near the solution.
    pub fn locate_from(&self, x: DVec3, guess: DVec3) -> Option<DVec3> {
        const STEPS: u32 = 6;
        let mut s = guess;
        for _ in 0..STEPS {
            let step = self.map.derivative(s).inverse() * (x - self.map.at(s));
            s += step;
            if step.abs().max_element() < LAST_STEP {
                return if outside(s) <= RIM { Some(s) } else { self.locate(x) };
            }
        }
        self.locate(x)
    }

    fn search(&self, x: DVec3, cell: &Cell, cuts: u32) -> Option<DVec3> {
        // A trilinear map takes a cell into the convex hull of its corners' images, also after a linear map.
        let (y, [least, most]) = (cell.inverse * x, cell.hull);
        if !(y.cmpge(least).all() && y.cmple(most).all()) {
            return None;
        }
        if cell.strain < CONTRACTION_STRAIN || cuts == 0 {
            return self.contract(x, cell);
        }
        let half = 0.5 * cell.size;
        corners(cell.low, half).find_map(|low| self.search(x, &self.map.cell(low, half)?, cuts - 1))
    }

    /// The root in a cell, if there is one. The first steps use the middle's derivative and halve the error at least, even where they
    /// are clamped to the cell; then Newton's method takes over.
    fn contract(&self, x: DVec3, cell: &Cell) -> Option<DVec3> {
        const HALVINGS: u32 = 3;
        const STEPS: u32 = 24;
        // Neighbouring cells overlap a little, so that no place is lost between them.
        let (low, high) = (cell.low - RIM * cell.size, cell.low + (1.0 + RIM) * cell.size);
        let mut s = cell.low + 0.5 * cell.size;
        for i in 0..STEPS {
            let left = x - self.map.at(s);
            let newton = if i < HALVINGS { cell.inverse } else { self.map.derivative(s).inverse() };
            let step = if newton.is_finite() { newton * left } else { cell.inverse * left };
            let next = (s + step).clamp(low, high);
            let moved = (next - s).abs().max_element();
            s = next;
            if step.abs().max_element() < LAST_STEP {
                return Some(s);
            }
            if i >= HALVINGS && moved < LAST_STEP {
                return None;
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix64;

    fn point(random: &mut SplitMix64) -> DVec3 {
        DVec3::new(random.unit(), random.unit(), random.unit())
    }

    /// A patch over the unit square, of which each corner is moved by up to `rough`.
    fn patch(random: &mut SplitMix64, rough: f64) -> Trilinear {
        let mut off = || rough * (2.0 * point(random) - 1.0);
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let base = square.map(|[x, y]| DVec3::new(x, y, 0.0) + off());
        Trilinear::new(base, [0; 4].map(|_| DVec3::Z + off()))
    }

    #[test]
    fn derivatives_are_slopes() {
        let mut random = SplitMix64::new(1);
        for _ in 0..100 {
            let map = patch(&mut random, 0.5);
            let (s, v) = (point(&mut random), point(&mut random) - 0.5);
            const STEP: f64 = 1e-4;
            let [a, b, c] = [-STEP, 0.0, STEP].map(|r| map.at(s + r * v));
            // The third derivative is 6 UVW's coefficient, at most 12 here: times STEP²; and rounding over STEP².
            assert!(((c - a) / (2.0 * STEP) - map.derivative(s) * v).length() < 1e-6);
            assert!(((a - 2.0 * b + c) / (STEP * STEP) - map.second_derivative(s, v)).length() < 1e-6);
        }
    }

    /// Places are found again, and points outside are told from points inside.
    #[test]
    fn places_are_found_and_nothing_else() {
        let mut random = SplitMix64::new(2);
        let (mut found, mut refused) = (0, 0);
        while found < 400 {
            let rough = 0.1 + 0.4 * random.unit();
            let Some(inverse) = Inverse::new(patch(&mut random, rough)) else {
                refused += 1;
                continue;
            };
            found += 1;
            for _ in 0..50 {
                let mut s = point(&mut random);
                // On faces and edges, too.
                for k in 0..3 {
                    if random.bits().is_multiple_of(3) {
                        s[k] = s[k].round();
                    }
                }
                let x = inverse.map.at(s);
                let back = inverse.locate(x).unwrap();
                // Maps that are barely not folded magnify rounding some thousand times.
                assert!(inverse.map.at(back).distance(x) < 1e-13 && back.distance(s) < 1e-9, "{s} {back}");
                assert!(inverse.locate_from(x, s + 0.1 * (point(&mut random) - 0.5)).unwrap().distance(s) < 1e-9);
                // From a face straight out.
                let k = (random.bits() % 3) as usize;
                s[k] = if random.bits().is_multiple_of(2) { -0.01 } else { 1.01 };
                if inverse.whole.strain < 0.5 {
                    assert!(inverse.locate(inverse.map.at(s)).is_none(), "{s}");
                }
            }
        }
        assert!(refused > 20);
    }

    #[test]
    fn maps_without_an_inverse_are_refused() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
        let up = [DVec3::Z; 4];
        assert!(Inverse::new(Trilinear::new(square, up)).is_some());
        assert!(Inverse::new(Trilinear::new(square, [DVec3::ZERO; 4])).is_none());
        assert!(Inverse::new(Trilinear::new(square, [DVec3::X; 4])).is_none());
        // One height down; an arrowhead; two corners that agree; a bow tie; height vectors that cross.
        assert!(Inverse::new(Trilinear::new(square, [DVec3::Z, DVec3::Z, -DVec3::Z, DVec3::Z])).is_none());
        let with = |corner: DVec3| [square[0], square[1], corner, square[3]];
        assert!(Inverse::new(Trilinear::new(with(DVec3::new(0.2, 0.2, 0.0)), up)).is_none());
        assert!(Inverse::new(Trilinear::new(with(square[1]), up)).is_none());
        assert!(Inverse::new(Trilinear::new([square[0], square[1], square[3], square[2]], up)).is_none());
        let leaning = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]].map(|[x, y]| DVec3::new(x, y, 1.0));
        assert!(Inverse::new(Trilinear::new(square, leaning)).is_none());
        assert!(Inverse::new(Trilinear::new(square, leaning.map(|h| 0.45 * h))).is_some());
        assert!(Inverse::new(Trilinear::new(square, [DVec3::NAN; 4])).is_none());
    }
}

//! One voxel: integer codes in 16 bytes, four to a cache line, and the equations that decode them.
//!
//! These are the codes in memory, of full precision. A file may hold a stream with fewer steps, which the reader widens to
//! them. Rates are in hits per voxel edge *of the voxel's own depth*, so that codes look alike at every depth.

use super::ndf::Sggx;
use crate::geom::Vec3;

/// A voxel's codes. The default is a voxel without matter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C, align(16))]
pub struct Voxel {
    /// 0 for no matter; else the rate is 2^((code − 144) / 16), from 2^−8.9 to 2^6.9 hits per voxel edge.
    pub rate: u8,
    /// Low nibble: block correlation c = code / 15. High nibble: one-sidedness |mean area vector| / area = code / 15.
    pub correlation: u8,
    /// SGGX shape, see [`Sggx::encode`].
    pub ndf: [u8; 6],
    /// Support box in sixteenths of the voxel, rounded outward: byte k = lo(axis k) | (15 − last(axis k)) << 4,
    /// where the support spans sixteenths lo ..= last.
    pub support: [u8; 3],
    /// Linear Rec. 709 albedo = (code / 255)^2.
    pub albedo: [u8; 3],
    /// Direction of the mean area vector, octahedral, each component code / 127.5 − 1; meaningless if one-sidedness is 0.
    pub mean_normal: [u8; 2],
}

const _: () = assert!(size_of::<Voxel>() == 16);

impl Default for Voxel {
    fn default() -> Self {
        Voxel {
            rate: 0,
            correlation: 0,
            ndf: Sggx::ISOTROPIC.encode(),
            support: [0; 3],
            albedo: [255; 3],
            mean_normal: [128; 2],
        }
    }
}

/// Code of the largest rate: opaque in any voxel.
pub const RATE_MAX: u8 = 255;
const RATE_BIAS: f32 = 144.0;
const RATE_STEPS: f32 = 16.0;

/// Rates of all codes, in hits per voxel edge. They are computed by `libm` and not by the platform's functions, so that they
/// are the same everywhere.
pub fn rate_table() -> [f32; 256] {
    std::array::from_fn(|code| decode_rate(code as u8))
}

/// Rate of a code, in hits per voxel edge.
pub fn decode_rate(code: u8) -> f32 {
    if code == 0 { 0.0 } else { libm::exp2f((f32::from(code) - RATE_BIAS) / RATE_STEPS) }
}

/// Code nearest to the rate `rho` ≥ 0 on a logarithmic scale: 0 below half of the smallest rate, [`RATE_MAX`] above the largest.
pub fn encode_rate(rho: f64) -> u8 {
    if rho.is_nan() || rho < libm::exp2(-9.0 - 0.5 / 16.0) {
        return 0;
    }
    (libm::log2(rho) * f64::from(RATE_STEPS) + f64::from(RATE_BIAS)).round().clamp(1.0, 255.0) as u8
}

/// Values i / 15 of the 4-bit codes.
static FIFTEENTHS: [f32; 16] = {
    let mut table = [0.0; 16];
    let mut i = 0;
    while i < 16 {
        table[i] = i as f32 / 15.0;
        i += 1;
    }
    table
};

/// Lower and upper end of the support along an axis, in voxel edges, by its byte: see [`Voxel::support`].
pub static SUPPORT_ENDS: [[f32; 2]; 256] = {
    let mut table = [[0.0; 2]; 256];
    let mut byte = 0;
    while byte < 256 {
        table[byte] = [(byte & 15) as f32 / 16.0, (16 - (byte >> 4)) as f32 / 16.0];
        byte += 1;
    }
    table
};

/// Edge of the voxels of `depth` ≤ 16, in edges of the texel's cube.
#[inline(always)]
pub fn voxel_edge(depth: u8) -> f32 {
    // 2^-depth by its exponent; depths are below 17.
    f32::from_bits((127 - u32::from(depth)) << 23)
}

impl Voxel {
    /// Block correlation c in [0, 1].
    #[inline(always)]
    pub fn c(&self) -> f32 {
        FIFTEENTHS[usize::from(self.correlation & 15)]
    }

    /// |mean area vector| / area in [0, 1]: 0 for facets seen from both sides, 1 for one face of a solid.
    #[inline(always)]
    pub fn one_sidedness(&self) -> f32 {
        FIFTEENTHS[usize::from(self.correlation >> 4)]
    }

    /// Whether this is the opaque inside of a solid, without facets of its own.
    #[inline(always)]
    pub fn is_inside(&self) -> bool {
        self.rate == RATE_MAX && self.correlation >> 4 == 0
    }

    /// The support box, lower and upper corner in voxel edges, within [0, 1]^3.
    pub fn support_box(&self) -> (Vec3, Vec3) {
        let ends = self.support.map(|byte| SUPPORT_ENDS[usize::from(byte)]);
        (Vec3::from_array(ends.map(|e| e[0])), Vec3::from_array(ends.map(|e| e[1])))
    }

    /// Set the support to the smallest box of sixteenths around `lo ..= hi` (voxel edges), at least a sixteenth thick.
    pub fn set_support(&mut self, lo: [f64; 3], hi: [f64; 3]) {
        for k in 0..3 {
            let first = (lo[k] * 16.0).floor().clamp(0.0, 15.0) as u8;
            let last = ((hi[k] * 16.0).ceil() - 1.0).clamp(f64::from(first), 15.0) as u8;
            self.support[k] = first | (15 - last) << 4;
        }
    }

    /// Linear albedo, each channel in [0, 1].
    #[inline(always)]
    pub fn albedo(&self) -> Vec3 {
        let decode = |c: u8| (f32::from(c) / 255.0) * (f32::from(c) / 255.0);
        Vec3::new(decode(self.albedo[0]), decode(self.albedo[1]), decode(self.albedo[2]))
    }

    /// Set the albedo from linear values, clamped to [0, 1].
    pub fn set_albedo(&mut self, rgb: [f64; 3]) {
        self.albedo = rgb.map(|v| (libm::sqrt(v.clamp(0.0, 1.0)) * 255.0).round() as u8);
    }

    /// The unit direction of the mean area vector.
    pub fn mean_normal(&self) -> Vec3 {
        let (x, y) = (f32::from(self.mean_normal[0]) / 127.5 - 1.0, f32::from(self.mean_normal[1]) / 127.5 - 1.0);
        let z = 1.0 - x.abs() - y.abs();
        let fold = (-z).max(0.0);
        Vec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize()
    }

    /// Set the mean area vector: `direction` need not be of unit length; `one_sidedness` in [0, 1].
    pub fn set_mean_normal(&mut self, direction: [f64; 3], one_sidedness: f64) {
        let n = direction.map(f64::abs).iter().sum::<f64>();
        if n.is_nan() || n <= 0.0 {
            self.correlation &= 15;
            return;
        }
        self.correlation = self.correlation & 15 | ((one_sidedness.clamp(0.0, 1.0) * 15.0).round() as u8) << 4;
        let [mut x, mut y, z] = direction.map(|v| v / n);
        if z < 0.0 {
            (x, y) = ((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y));
        }
        self.mean_normal = [x, y].map(|v| ((v + 1.0) * 127.5).round() as u8);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_round_trip_within_half_a_step() {
        let table = rate_table();
        for code in 1..=255u8 {
            assert_eq!(encode_rate(f64::from(table[code as usize])), code);
        }
        assert_eq!(encode_rate(0.0), 0);
        assert_eq!(encode_rate(1e30), RATE_MAX);
        assert_eq!(encode_rate(f64::NAN), 0);
    }

    #[test]
    fn support_is_rounded_outward() {
        let mut v = Voxel::default();
        v.set_support([0.26, 0.0, 0.5], [0.3, 1.0, 0.5]);
        let (lo, hi) = v.support_box();
        assert_eq!((lo, hi), (Vec3::new(0.25, 0.0, 0.5), Vec3::new(0.3125, 1.0, 0.5625)));
        assert_eq!(Voxel::default().support_box(), (Vec3::ZERO, Vec3::ONE));
    }

    #[test]
    fn mean_normal_round_trips() {
        let mut v = Voxel::default();
        for d in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, -0.64, -0.48], [-1.0, 0.0, 0.0], [0.1, 0.9, 0.42]] {
            v.set_mean_normal(d, 1.0);
            let want = Vec3::new(d[0] as f32, d[1] as f32, d[2] as f32).normalize();
            // Octahedral 8 + 8 bit: worst angle about 0.95 degrees (Cigolle et al. 2014, table 1).
            assert!(v.mean_normal().dot(want) > 0.9997, "{d:?} {:?}", v.mean_normal());
            assert_eq!(v.one_sidedness(), 1.0);
        }
    }
}

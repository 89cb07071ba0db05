//! Samples on a lattice as they are stored; nothing is converted before it is asked for.

use super::bytes::Bytes;
use crate::scene::texture::srgb_to_linear;

/// How one number is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl Kind {
    pub fn bytes(self) -> usize {
        match self {
            Kind::U8 | Kind::I8 => 1,
            Kind::U16 | Kind::I16 => 2,
            Kind::U32 | Kind::I32 | Kind::F32 => 4,
            Kind::U64 | Kind::I64 | Kind::F64 => 8,
        }
    }

    fn is_float(self) -> bool {
        matches!(self, Kind::F32 | Kind::F64)
    }

    /// The largest value of an unsigned kind, which stands for full colour; 1 for the others.
    fn full(self) -> f32 {
        match self {
            Kind::U8 => 255.0,
            Kind::U16 => 65535.0,
            _ => 1.0,
        }
    }
}

/// How the numbers of a lattice are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Coding {
    pub kind: Kind,
    pub big_endian: bool,
    /// Numbers a sample.
    pub channels: usize,
}

impl Coding {
    #[cfg(test)]
    pub fn little(kind: Kind, channels: usize) -> Coding {
        Coding { kind, big_endian: false, channels }
    }

    /// As the programs of this machine store it.
    pub fn native(kind: Kind, channels: usize) -> Coding {
        Coding { kind, big_endian: cfg!(target_endian = "big"), channels }
    }

    /// Bytes of a sample.
    pub fn sample(&self) -> usize {
        self.kind.bytes() * self.channels
    }

    /// slope · (channels weighed) + intercept of each sample.
    fn decode(&self, bytes: &[u8], weights: &[f32; 4], rescale: (f64, f64), out: &mut [f32]) {
        let (slope, intercept) = rescale;
        let plain = rescale == (1.0, 0.0);
        macro_rules! read {
            ($type:ty) => {{
                const N: usize = size_of::<$type>();
                let big = self.big_endian;
                let number = |b: [u8; N]| if big { <$type>::from_be_bytes(b) } else { <$type>::from_le_bytes(b) };
                let numbers = bytes.as_chunks::<N>().0;
                if self.channels == 1 && plain {
                    out.iter_mut().zip(numbers).for_each(|(v, b)| *v = number(*b) as f32);
                } else if self.channels == 1 {
                    out.iter_mut().zip(numbers).for_each(|(v, b)| *v = (number(*b) as f64 * slope + intercept) as f32);
                } else {
                    for (v, sample) in out.iter_mut().zip(numbers.chunks_exact(self.channels)) {
                        let sum: f32 = sample.iter().zip(weights).map(|(b, w)| w * number(*b) as f32).sum();
                        *v = (f64::from(sum) * slope + intercept) as f32;
                    }
                }
            }};
        }
        match self.kind {
            Kind::U8 => read!(u8),
            Kind::I8 => read!(i8),
            Kind::U16 => read!(u16),
            Kind::I16 => read!(i16),
            Kind::U32 => read!(u32),
            Kind::I32 => read!(i32),
            Kind::U64 => read!(u64),
            Kind::I64 => read!(i64),
            Kind::F32 => read!(f32),
            Kind::F64 => read!(f64),
        }
    }
}

/// Numbers on a lattice, x fastest, then y, then z; all channels of a sample side by side.
pub struct Samples {
    bytes: Bytes,
    start: usize,
    coding: Coding,
    dims: [usize; 3],
    /// value = slope · stored + intercept.
    pub rescale: (f64, f64),
    /// How channels are weighed to give the value.
    weights: [f32; 4],
    /// Stands for NaN and infinities.
    pub missing: f32,
}

/// Weights of linear light, Rec. 709.
const LUMA: [f32; 4] = [0.2126, 0.7152, 0.0722, 0.0];

/// Longest side of a lattice.
const MAX_SIDE: usize = 1 << 20;

/// Bytes that a lattice takes; `None` where it is empty, or too large for any machine.
pub fn byte_count(dims: [usize; 3], coding: Coding) -> Option<usize> {
    let whole = dims.iter().try_fold(coding.sample(), |n, &d| n.checked_mul(d))?;
    (dims.iter().all(|&d| d <= MAX_SIDE) && whole > 0 && whole < isize::MAX as usize).then_some(whole)
}

impl Samples {
    /// The lattice that begins at byte `start`. The error says what is wrong.
    pub fn new(bytes: Bytes, start: usize, coding: Coding, dims: [usize; 3]) -> Result<Samples, String> {
        let [x, y, z] = dims;
        if !(1..=4).contains(&coding.channels) {
            return Err(format!(
                "{} channels a sample; 1 to 4 are read: take one out with another tool",
                coding.channels
            ));
        }
        let needed =
            byte_count(dims, coding).ok_or_else(|| format!("{x}×{y}×{z} samples: not a size that can be read"))?;
        let there = bytes.len().saturating_sub(start);
        if needed > there {
            return Err(format!(
                "{x}×{y}×{z} samples need {needed} bytes, {there} are there: it is cut short, or lies"
            ));
        }
        // Grey and alpha: grey. Colour: its lightness.
        let weights = if coding.channels >= 3 { LUMA } else { [1.0, 0.0, 0.0, 0.0] };
        Ok(Samples { bytes, start, coding, dims, rescale: (1.0, 0.0), weights, missing: 0.0 })
    }

    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    pub fn has_colour(&self) -> bool {
        self.coding.channels >= 3
    }

    /// Whether colour comes with opacity.
    pub fn has_alpha(&self) -> bool {
        self.coding.channels == 4
    }

    /// Take the opacity for the value, or the lightness.
    pub fn value_is_alpha(&mut self, alpha: bool) {
        if self.has_colour() {
            self.weights = if alpha { [0.0, 0.0, 0.0, 1.0] } else { LUMA };
        }
    }

    pub fn is_float(&self) -> bool {
        self.coding.kind.is_float()
    }

    fn at(&self, [i, j, k]: [usize; 3]) -> usize {
        self.start + ((k * self.dims[1] + j) * self.dims[0] + i) * self.coding.sample()
    }

    /// The values from (i, j, k) on along x, as many as `out` holds; all of them have to be in the lattice.
    pub fn row(&self, i: usize, j: usize, k: usize, out: &mut [f32]) {
        self.row_as_stored(i, j, k, out);
        if self.is_float() {
            for v in out.iter_mut().filter(|v| !v.is_finite()) {
                *v = self.missing;
            }
        }
    }

    /// The same, with NaN and infinities where there are any.
    pub fn row_as_stored(&self, i: usize, j: usize, k: usize, out: &mut [f32]) {
        let first = self.at([i, j, k]);
        if let Some(bytes) = self.bytes.get(first..first + out.len() * self.coding.sample()) {
            self.coding.decode(bytes, &self.weights, self.rescale, out);
        }
    }

    /// The linear colour of a sample; white where samples have none.
    pub fn colour(&self, at: [usize; 3]) -> [f32; 3] {
        if !self.has_colour() {
            return [1.0; 3];
        }
        let one = Coding { channels: 1, ..self.coding };
        let first = self.at(at);
        let mut rgb = [1.0f32; 3];
        if let Some(bytes) = self.bytes.get(first..first + 3 * one.sample()) {
            one.decode(bytes, &LUMA, (1.0, 0.0), &mut rgb);
        }
        rgb.map(|v| {
            let v = (v / one.kind.full()).clamp(0.0, 1.0);
            // Whole numbers are sRGB; floating-point colour is linear.
            match () {
                () if v.is_nan() => 0.0,
                () if self.is_float() => v,
                () => srgb_to_linear((v * 255.0).round() as u8),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(v: &[u8]) -> Bytes {
        Bytes::Memory(v.to_vec())
    }

    #[test]
    fn numbers_are_read_as_they_are_stored() {
        let mut out = [0.0; 2];
        let big = Coding { kind: Kind::I16, big_endian: true, channels: 1 };
        let mut s = Samples::new(bytes(&[9, 0xff, 0xfe, 1, 0]), 1, big, [2, 1, 1]).unwrap();
        s.row(0, 0, 0, &mut out);
        assert_eq!(out, [-2.0, 256.0]);
        s.rescale = (0.5, -1024.0);
        s.row(0, 0, 0, &mut out);
        assert_eq!(out, [-1025.0, -896.0]);
        let floats: Vec<u8> = [f64::NAN, 3.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        let mut s = Samples::new(bytes(&floats), 0, Coding::little(Kind::F64, 1), [2, 1, 1]).unwrap();
        s.missing = -7.0;
        s.row(0, 0, 0, &mut out);
        assert_eq!(out, [-7.0, 3.0]);
    }

    #[test]
    fn colour_is_linear_and_its_value_its_lightness() {
        let s = Samples::new(bytes(&[255, 0, 0, 10, 10, 10]), 0, Coding::little(Kind::U8, 3), [1, 1, 2]).unwrap();
        assert_eq!(s.colour([0, 0, 0]), [1.0, 0.0, 0.0]);
        let mut v = [0.0];
        s.row(0, 0, 0, &mut v);
        assert!((v[0] - 0.2126 * 255.0).abs() < 1e-3);
        s.row(0, 0, 1, &mut v);
        assert!((v[0] - 10.0).abs() < 1e-4);
    }

    #[test]
    fn sizes_that_lie_are_refused() {
        let coding = Coding::little(Kind::U16, 1);
        for dims in [[1_000_000_000; 3], [0, 1, 1], [3, 3, 3], [usize::MAX, 2, 1], [1 << 40, 1, 1]] {
            assert!(Samples::new(bytes(&[0; 53]), 0, coding, dims).is_err(), "{dims:?}");
        }
        assert!(Samples::new(bytes(&[0; 54]), 0, coding, [3, 3, 3]).is_ok());
        assert!(Samples::new(bytes(&[0; 54]), 60, coding, [1, 1, 1]).is_err());
        assert!(Samples::new(bytes(&[0; 99]), 0, Coding::little(Kind::U8, 5), [1, 1, 1]).is_err());
    }
}

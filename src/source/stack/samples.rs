//! Samples on a lattice as they are stored in a file. Numbers are converted only when they are read.

use super::bytes::Bytes;
use super::coding::{Coding, MAX_CHANNELS, Value, byte_count};
use crate::scene::texture::srgb_to_linear;

/// Numbers on a lattice, x fastest, then y, then z; all channels of a sample side by side.
pub struct Samples {
    bytes: Bytes,
    start: usize,
    coding: Coding,
    dims: [usize; 3],
    /// value = slope · stored + intercept.
    pub rescale: (f64, f64),
    /// Rule that makes one value of a sample's channels.
    value: Value,
    /// Whether the first three channels are red, green and blue.
    colour: bool,
    /// Least and greatest value, rescaled, that mark a sample without a value, as DICOM's padding does.
    pub padding: Option<[f32; 2]>,
    /// Stands for the value of samples that have none: NaN, infinities and padding.
    pub missing: f32,
}

impl Samples {
    /// The lattice that begins at byte `start`. The error says what is wrong.
    pub fn new(bytes: Bytes, start: usize, coding: Coding, dims: [usize; 3]) -> Result<Samples, String> {
        let [x, y, z] = dims;
        if !(1..=MAX_CHANNELS).contains(&coding.channels) {
            return Err(format!("{} channels per sample; 1 to {MAX_CHANNELS} are read", coding.channels));
        }
        let needed =
            byte_count(dims, coding).ok_or_else(|| format!("{x}×{y}×{z} samples: not a size that can be read"))?;
        let there = bytes.len().saturating_sub(start);
        if needed > there {
            return Err(format!(
                "{x}×{y}×{z} samples need {needed} bytes, {there} are there: it is cut short, or lies"
            ));
        }
        let colour = matches!(coding.channels, 3 | 4);
        let value = if colour { Value::Luma } else { Value::Channel(0) };
        Ok(Samples { bytes, start, coding, dims, rescale: (1.0, 0.0), value, colour, padding: None, missing: 0.0 })
    }

    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Number of channels per sample.
    pub fn channels(&self) -> usize {
        self.coding.channels
    }

    /// Take one channel for the value: channels are no colours.
    pub fn choose_channel(&mut self, channel: usize) {
        self.colour = false;
        self.value = Value::Channel(channel);
    }

    pub fn has_colour(&self) -> bool {
        self.colour
    }

    /// Whether colour comes with opacity.
    pub fn has_alpha(&self) -> bool {
        self.colour && self.coding.channels == 4
    }

    /// Take the opacity for the value, or the lightness.
    pub fn value_is_alpha(&mut self, alpha: bool) {
        if self.colour {
            self.value = if alpha { Value::Channel(3) } else { Value::Luma };
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
        self.row_with_nan(i, j, k, out);
        if self.may_miss() {
            for v in out.iter_mut().filter(|v| !v.is_finite()) {
                *v = self.missing;
            }
        }
    }

    /// The same, but what has no value is NaN or infinite.
    pub fn row_with_nan(&self, i: usize, j: usize, k: usize, out: &mut [f32]) {
        let first = self.at([i, j, k]);
        if let Some(bytes) = self.bytes.get(first..first + out.len() * self.coding.sample()) {
            self.coding.decode(bytes, self.value, self.rescale, out);
        }
        if let Some([lo, hi]) = self.padding {
            for v in out.iter_mut().filter(|v| (lo..=hi).contains(*v)) {
                *v = f32::NAN;
            }
        }
    }

    /// Whether there can be samples without a value.
    fn may_miss(&self) -> bool {
        self.is_float() || self.padding.is_some()
    }

    /// Whether a sample has no value.
    pub fn is_missing(&self, [i, j, k]: [usize; 3]) -> bool {
        let mut value = [0.0];
        self.row_with_nan(i, j, k, &mut value);
        !value[0].is_finite()
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
            one.decode(bytes, Value::Channel(0), (1.0, 0.0), &mut rgb);
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
    use super::super::coding::Kind;
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
        s.padding = Some([2.5, 3.0]);
        s.row(0, 0, 0, &mut out);
        assert_eq!(out, [-7.0, -7.0], "padding is no value either");
        assert!(s.is_missing([1, 0, 0]));
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
        assert!(Samples::new(bytes(&[0; 99]), 0, Coding::little(Kind::U8, 0), [1, 1, 1]).is_err());
    }

    #[test]
    fn one_channel_of_many_is_the_value() {
        let mut s =
            Samples::new(bytes(&[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]), 0, Coding::little(Kind::U8, 5), [2, 1, 1]).unwrap();
        assert!(!s.has_colour());
        s.choose_channel(3);
        let mut out = [0.0; 2];
        s.row(0, 0, 0, &mut out);
        assert_eq!(out, [4.0, 9.0]);
    }
}

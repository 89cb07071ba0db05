//! Storage of samples: kind of number, byte order, channels.

/// Storage of one number.
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
    /// Number of bytes per number.
    pub fn bytes(self) -> usize {
        match self {
            Kind::U8 | Kind::I8 => 1,
            Kind::U16 | Kind::I16 => 2,
            Kind::U32 | Kind::I32 | Kind::F32 => 4,
            Kind::U64 | Kind::I64 | Kind::F64 => 8,
        }
    }

    pub fn is_float(self) -> bool {
        matches!(self, Kind::F32 | Kind::F64)
    }

    /// The largest value of an unsigned kind, which stands for full colour; 1 for the others.
    pub fn full(self) -> f32 {
        match self {
            Kind::U8 => 255.0,
            Kind::U16 => 65535.0,
            _ => 1.0,
        }
    }
}

/// Storage of the numbers of a lattice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Coding {
    pub kind: Kind,
    pub big_endian: bool,
    /// Number of channels per sample.
    pub channels: usize,
}

impl Coding {
    #[cfg(test)]
    pub fn little(kind: Kind, channels: usize) -> Coding {
        Coding { kind, big_endian: false, channels }
    }

    /// Numbers in this machine's byte order.
    pub fn native(kind: Kind, channels: usize) -> Coding {
        Coding { kind, big_endian: cfg!(target_endian = "big"), channels }
    }

    /// Number of bytes per sample.
    pub fn sample(&self) -> usize {
        self.kind.bytes() * self.channels
    }

    /// Write slope · value + intercept of each sample to `out`.
    pub fn decode(&self, bytes: &[u8], value: Value, rescale: (f64, f64), out: &mut [f32]) {
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
                } else if let Value::Channel(channel) = value {
                    for (v, sample) in out.iter_mut().zip(numbers.chunks_exact(self.channels)) {
                        *v = (sample.get(channel).map_or(0.0, |b| number(*b) as f64) * slope + intercept) as f32;
                    }
                } else {
                    for (v, sample) in out.iter_mut().zip(numbers.chunks_exact(self.channels)) {
                        let sum: f32 = sample.iter().zip(LUMA).map(|(b, w)| w * number(*b) as f32).sum();
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

/// Rule that makes one value of a sample's channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Value {
    Channel(usize),
    /// The weighted sum of red, green and blue.
    Luma,
}

/// Weights of red, green and blue, Rec. 709.
const LUMA: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Channels of a sample at most.
pub const MAX_CHANNELS: usize = 1 << 16;

/// Longest side of a lattice.
const MAX_SIDE: usize = 1 << 20;

/// Bytes that a lattice takes; `None` where it is empty, or too large for any machine.
pub fn byte_count(dims: [usize; 3], coding: Coding) -> Option<usize> {
    let whole = dims.iter().try_fold(coding.sample(), |n, &d| n.checked_mul(d))?;
    (dims.iter().all(|&d| d <= MAX_SIDE) && whole > 0 && whole < isize::MAX as usize).then_some(whole)
}

/// Red, green and blue of luma and chroma in eight bits each, full-range BT.601, as JPEG has them.
pub fn rgb_of_ycbcr([y, cb, cr]: [u8; 3]) -> [u8; 3] {
    let (y, cb, cr) = (f32::from(y), f32::from(cb) - 128.0, f32::from(cr) - 128.0);
    [y + 1.402 * cr, y - 0.344_136 * cb - 0.714_136 * cr, y + 1.772 * cb].map(|v| v.round() as u8)
}

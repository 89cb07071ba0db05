//! Decoding of the filters of meshopt compression: octahedral normals, quaternions, shared exponents, YCoCg colours.
//!
//! Based on: EXT_meshopt_compression, KHR_meshopt_compression; Meyer et al., *On Floating-Point Normal Vectors*, 2010.

/// Filter by which decoded elements still have to be converted, with the bytes of one number where that varies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Filter {
    Octahedral(usize),
    Quaternion,
    Exponential,
    Color(usize),
}

impl Filter {
    /// By its name in the JSON, for elements of `stride` bytes.
    pub fn named(name: &str, stride: usize) -> Option<Self> {
        match (name, stride) {
            ("OCTAHEDRAL", 4 | 8) => Some(Filter::Octahedral(stride / 4)),
            ("QUATERNION", 8) => Some(Filter::Quaternion),
            ("EXPONENTIAL", _) => Some(Filter::Exponential),
            ("COLOR", 4 | 8) => Some(Filter::Color(stride / 4)),
            _ => None,
        }
    }
}

/// Undo `filter` on elements of `stride` bytes, in place.
pub fn apply(filter: Filter, bytes: &mut [u8], stride: usize) {
    for element in bytes.chunks_exact_mut(stride) {
        match filter {
            Filter::Octahedral(size) => four(element, size, octahedral),
            Filter::Quaternion => four(element, 2, quaternion),
            Filter::Color(size) => four(element, size, color),
            Filter::Exponential => {
                for number in element.as_chunks_mut::<4>().0 {
                    *number = exponential(i32::from_le_bytes(*number)).to_le_bytes();
                }
            }
        }
    }
}

/// Apply `f` to four signed numbers of `size` bytes; `f` also learns the largest of their type.
fn four(element: &mut [u8], size: usize, f: fn([i32; 4], i32) -> [i32; 4]) {
    let mut numbers = [0; 4];
    for (n, b) in numbers.iter_mut().zip(element.chunks_exact(size)) {
        *n = if size == 1 { i32::from(b[0] as i8) } else { i32::from(i16::from_le_bytes([b[0], b[1]])) };
    }
    let numbers = f(numbers, (1 << (8 * size - 1)) - 1);
    for (n, b) in numbers.iter().zip(element.chunks_exact_mut(size)) {
        b.copy_from_slice(&n.to_le_bytes()[..size]);
    }
}

/// To the nearest integer, halves away from zero.
fn rounded(v: f32) -> i32 {
    (v + 0.5f32.copysign(v)) as i32
}

/// x and y on the octahedron whose |x| + |y| + |z| is the third number → a vector of length `max`.
fn octahedral([x, y, one, w]: [i32; 4], max: i32) -> [i32; 4] {
    let (x, y) = (x as f32, y as f32);
    let z = one as f32 - x.abs() - y.abs();
    let fold = z.min(0.0);
    let (x, y) = (x + if x >= 0.0 { fold } else { -fold }, y + if y >= 0.0 { fold } else { -fold });
    let scale = max as f32 / (x * x + y * y + z * z).sqrt();
    [rounded(x * scale), rounded(y * scale), rounded(z * scale), w]
}

/// The three smaller components, the scale, and which is left out → a unit quaternion.
fn quaternion([x, y, z, meta]: [i32; 4], max: i32) -> [i32; 4] {
    let scale = std::f32::consts::FRAC_1_SQRT_2 / (meta | 3) as f32;
    let [x, y, z] = [x, y, z].map(|v| v as f32 * scale);
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    let left_out = (meta & 3) as usize;
    let mut q = [0; 4];
    for (k, v) in [w, x, y, z].into_iter().enumerate() {
        q[(left_out + k) & 3] = rounded(v * max as f32);
    }
    q
}

/// An exponent in the high byte and a signed 24-bit mantissa → float.
fn exponential(v: i32) -> f32 {
    let (exponent, mantissa) = (v >> 24, v << 8 >> 8);
    // Both factors are exact; the product is rounded once.
    (f64::from(mantissa) * f64::powi(2.0, exponent)) as f32
}

/// Y, Co, Cg and alpha, all scaled by the highest bit that is set in alpha → unsigned RGBA.
fn color([y, co, cg, a]: [i32; 4], max: i32) -> [i32; 4] {
    let unsigned = 2 * max + 1;
    let (y, a) = (y & unsigned, a & unsigned);
    let ones = if a == 0 { 0 } else { i32::MAX >> (a.leading_zeros() - 1) };
    let a = ((a << 1) & ones) | (a & 1);
    let scale = unsigned as f32 / ones as f32;
    [y + co - cg, y + cg, y - co - cg, a].map(|v| (v as f32 * scale + 0.5) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents_are_exact() {
        assert_eq!(exponential(3), 3.0);
        assert_eq!(exponential((-4i32 << 24) | 0x00FF_FFFF), -0.0625);
        assert_eq!(exponential((2 << 24) | 5), 20.0);
        assert_eq!(exponential(0x7F00_0001), 2f32.powi(127));
    }

    #[test]
    fn octahedral_vectors_have_full_length() {
        assert_eq!(octahedral([0, 0, 127, 9], 127), [0, 0, 127, 9]);
        assert_eq!(octahedral([127, 0, 127, 0], 127), [127, 0, 0, 0]);
        // The lower half is folded out: (127, 127) is straight down.
        assert_eq!(octahedral([127, 127, 127, 0], 127), [0, 0, -127, 0]);
    }

    #[test]
    fn quaternions_regain_the_largest_component() {
        assert_eq!(quaternion([0, 0, 0, 32764 | 3], 32767), [0, 0, 0, 32767]);
        assert_eq!(quaternion([0, 0, 0, 32764], 32767), [32767, 0, 0, 0]);
    }

    #[test]
    fn colours_are_scaled_by_alpha() {
        // Full-range white and black at 8 bits: alpha has its top bit as scale, ones = 255.
        assert_eq!(color([255, 0, 0, 255], 127)[..3], [255, 255, 255]);
        assert_eq!(color([0, 0, 0, 255], 127)[..3], [0, 0, 0]);
        assert_eq!(color([0, 0, 0, 0], 127), [0, 0, 0, 0]);
    }
}

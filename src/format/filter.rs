//! Reversible reorderings of a page's codes, so that what is alike lies together; one is chosen a section.

/// How many filters there are: 1 is one plane a component.
pub const COUNT: u8 = 3;
/// Codes of a voxel lie together.
pub const INTERLEAVED: u8 = 0;
/// Planes of the differences to the voxel before, modulo Q + 1, folded so that small ones of either sign are small.
pub const DELTA: u8 = 2;

/// Filter `codes` (interleaved, each ≤ `q_max`) of voxels of `components` codes.
pub fn forward(filter: u8, codes: &[u8], components: usize, q_max: u8) -> Vec<u8> {
    if filter == INTERLEAVED {
        return codes.to_vec();
    }
    let modulus = u16::from(q_max) + 1;
    let mut out = Vec::with_capacity(codes.len());
    for k in 0..components {
        let mut before = 0;
        for &code in codes.iter().skip(k).step_by(components) {
            out.push(if filter == DELTA { fold(code, before, modulus) } else { code });
            before = code;
        }
    }
    out
}

/// Undo [`forward`]. `false`: a code above `q_max` was found.
#[must_use]
pub fn inverse(filter: u8, bytes: &mut Vec<u8>, components: usize, q_max: u8) -> bool {
    if bytes.iter().any(|&b| b > q_max) {
        return false;
    }
    if filter == INTERLEAVED {
        return true;
    }
    let modulus = u16::from(q_max) + 1;
    let voxels = bytes.len() / components.max(1);
    let mut out = vec![0; bytes.len()];
    for (k, plane) in bytes.chunks_exact(voxels.max(1)).enumerate() {
        let mut before = 0;
        for (&b, slot) in plane.iter().zip(out.iter_mut().skip(k).step_by(components)) {
            *slot = if filter == DELTA { unfold(b, before, modulus) } else { b };
            before = *slot;
        }
    }
    *bytes = out;
    true
}

/// (code − before) mod m: 0, −1, 1, −2, 2 … as 0, 1, 2, 3, 4 …
fn fold(code: u8, before: u8, m: u16) -> u8 {
    let d = (u16::from(code) + m - u16::from(before)) % m;
    (if 2 * d < m { 2 * d } else { 2 * (m - d) - 1 }) as u8
}

/// The code that [`fold`] made `b` of.
#[inline]
fn unfold(b: u8, before: u8, m: u16) -> u8 {
    let b = u16::from(b);
    let d = if b & 1 == 0 { b / 2 } else { m - b.div_ceil(2) };
    let sum = u16::from(before) + d;
    (if sum >= m { sum - m } else { sum }) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn fold_is_a_bijection_within_the_range() {
        for m in [2u16, 3, 15, 16, 64, 129, 255, 256] {
            for before in 0..m {
                let mut seen = vec![false; m.into()];
                for code in 0..m {
                    let b = fold(code as u8, before as u8, m);
                    assert!(u16::from(b) < m && !seen[usize::from(b)], "{code} after {before} mod {m}: {b}");
                    seen[usize::from(b)] = true;
                    assert_eq!(u16::from(unfold(b, before as u8, m)), code);
                }
            }
        }
        assert_eq!([5, 4, 6, 3, 7].map(|c| fold(c, 5, 256)), [0, 1, 2, 3, 4]);
    }

    proptest! {
        #[test]
        fn round_trip(codes in proptest::collection::vec(0u8..=30, 0..60), components in 1usize..=6, filter in 0..COUNT) {
            let whole = codes.len() / components * components;
            let mut bytes = forward(filter, &codes[..whole], components, 30);
            prop_assert!(inverse(filter, &mut bytes, components, 30));
            prop_assert_eq!(&bytes[..], &codes[..whole]);
        }
    }
}

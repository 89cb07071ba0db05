//! Reversible reorderings of a page's codes, so that what is alike lies together; one is chosen a section.

/// Number of filters: 1 is one plane per component.
pub const COUNT: u8 = 3;
/// Codes of a voxel lie together.
pub const INTERLEAVED: u8 = 0;
/// Planes of the differences to the voxel before, modulo the component's largest code + 1, folded so that small ones of either sign are small.
pub const DELTA: u8 = 2;

/// Filter the interleaved `codes` of voxels whose component k is at most `most[k]`.
pub fn forward(filter: u8, codes: &[u8], most: &[u8]) -> Vec<u8> {
    if filter == INTERLEAVED {
        return codes.to_vec();
    }
    let mut out = Vec::with_capacity(codes.len());
    for (k, &most_k) in most.iter().enumerate() {
        let modulus = u16::from(most_k) + 1;
        let mut before = 0;
        for &code in codes.iter().skip(k).step_by(most.len()) {
            out.push(if filter == DELTA { fold(code, before, modulus) } else { code });
            before = code;
        }
    }
    out
}

/// Undo [`forward`]. `false`: a code above its component's largest was found.
#[must_use]
pub fn inverse(filter: u8, bytes: &mut Vec<u8>, most: &[u8]) -> bool {
    if filter == INTERLEAVED {
        return bytes.chunks(most.len().max(1)).all(|v| v.iter().zip(most).all(|(b, most)| b <= most));
    }
    let voxels = (bytes.len() / most.len().max(1)).max(1);
    let mut out = vec![0; bytes.len()];
    for (k, (plane, &most_k)) in bytes.chunks_exact(voxels).zip(most).enumerate() {
        if plane.iter().any(|&b| b > most_k) {
            return false;
        }
        let modulus = u16::from(most_k) + 1;
        let mut before = 0;
        for (&b, slot) in plane.iter().zip(out.iter_mut().skip(k).step_by(most.len())) {
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
            let most = [30, 31, 32, 33, 34, 35];
            let mut bytes = forward(filter, &codes[..whole], &most[..components]);
            prop_assert!(inverse(filter, &mut bytes, &most[..components]));
            prop_assert_eq!(&bytes[..], &codes[..whole]);
        }
    }
}

//! Filters: reversible reorderings of a page's codes before compression, so that similar codes are neighbours. Each section has one.

/// Number of filters. Filter 1 puts the codes of each component into a plane of their own.
pub const COUNT: u8 = 3;
/// Filter that changes nothing: the codes of a voxel are neighbours.
pub const INTERLEAVED: u8 = 0;
/// Filter that puts into each plane the differences to the previous voxel, modulo the component's largest code + 1, and maps them to
/// 0, 1, 2 … by their absolute value.
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

/// Undo [`forward`] in place. Returns false where a code is above its component's largest, `most[k]`.
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

/// Code of the difference (code − before) mod m: 0, 1, 2, 3, 4 … for 0, −1, 1, −2, 2 …
fn fold(code: u8, before: u8, m: u16) -> u8 {
    let d = (u16::from(code) + m - u16::from(before)) % m;
    (if 2 * d < m { 2 * d } else { 2 * (m - d) - 1 }) as u8
}

/// Inverse of [`fold`]: the code that gave `b`.
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

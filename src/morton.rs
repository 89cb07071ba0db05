//! 63-bit Morton codes: 21 bits an axis, x in the lowest bit of each triple.

/// Largest coordinate + 1 that a code holds.
pub const MAX_COORD: u32 = 1 << 21;

/// Spread the low 21 bits of `v` so that two zero bits follow each.
const fn spread(v: u32) -> u64 {
    let mut x = (v & (MAX_COORD - 1)) as u64;
    x = (x | x << 32) & 0x001f_0000_0000_ffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

const fn gather(code: u64) -> u32 {
    let mut x = code & 0x1249_2492_4924_9249;
    x = (x | x >> 2) & 0x10c3_0c30_c30c_30c3;
    x = (x | x >> 4) & 0x100f_00f0_0f00_f00f;
    x = (x | x >> 8) & 0x001f_0000_ff00_00ff;
    x = (x | x >> 16) & 0x001f_0000_0000_ffff;
    ((x | x >> 32) & 0x001f_ffff) as u32
}

/// Code of the voxel (x, y, z); each coordinate below [`MAX_COORD`].
pub const fn encode(p: [u32; 3]) -> u64 {
    spread(p[0]) | spread(p[1]) << 1 | spread(p[2]) << 2
}

/// The voxel (x, y, z) of a code.
pub const fn decode(code: u64) -> [u32; 3] {
    [gather(code), gather(code >> 1), gather(code >> 2)]
}

/// The parents of ascending `codes`, in the same order, and a mask for each of which of its eight children are there.
pub fn parents(codes: &[u64]) -> (Vec<u64>, Vec<u8>) {
    let (mut up, mut masks): (Vec<u64>, Vec<u8>) = (Vec::new(), Vec::new());
    for code in codes {
        if up.last() != Some(&(code >> 3)) {
            up.push(code >> 3);
            masks.push(0);
        }
        if let Some(mask) = masks.last_mut() {
            *mask |= 1 << (code & 7);
        }
    }
    (up, masks)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip_and_order() {
        for p in [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [5, 9, 1023], [MAX_COORD - 1; 3]] {
            assert_eq!(decode(encode(p)), p);
        }
        assert_eq!(encode([1, 0, 0]), 1);
        assert_eq!(encode([0, 1, 0]), 2);
        assert_eq!(encode([0, 0, 1]), 4);
        assert_eq!(encode([3, 3, 3]), 63);
    }

    #[test]
    fn parents_know_their_children() {
        assert_eq!(parents(&[0, 3, 7, 8, 63]), (vec![0, 1, 7], vec![0b1000_1001, 1, 0b1000_0000]));
        assert_eq!(parents(&[]), (vec![], vec![]));
    }
}

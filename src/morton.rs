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
}

//! One grid: a tree of nodes of 32³, 16³ and 8³, and how a file has it.
//!
//! Based on: K. Museth, *VDB: High-Resolution Sparse Volumes with Dynamic Topology*, TOG 2013.

use std::collections::BTreeMap;
use std::io::{self, Write};

use flate2::Compression;
use flate2::write::ZlibEncoder;

/// log2 of the children along an edge of an upper node, a lower node and a leaf, and of the voxels along the edge of each.
const UPPER: u32 = 5;
const LOWER: u32 = 4;
const LEAF: u32 = 3;
const LOWER_EDGE: u32 = LOWER + LEAF;
const UPPER_EDGE: u32 = UPPER + LOWER_EDGE;
/// Values of a leaf.
const VALUES: usize = 1 << (3 * LEAF);
/// Flags of what is stored: active values alone, by zlib.
const ACTIVE_BY_ZLIB: u32 = 1 | 2;
/// Values that are not active are the background, and not stored.
const BACKGROUND_ELSEWHERE: u8 = 0;

/// Active voxels, and all others of value 0; `N` numbers each.
pub struct Grid<const N: usize> {
    name: &'static str,
    value: &'static str,
    /// By the corner of each upper node.
    roots: BTreeMap<[i32; 3], Upper<N>>,
    count: u64,
    low: [i32; 3],
    high: [i32; 3],
}

/// Children by their number in the node.
struct Upper<const N: usize>(BTreeMap<u32, Lower<N>>);

/// Leaves, and cells of 8³ voxels that have one value.
struct Lower<const N: usize>(BTreeMap<u32, Child<N>>);

enum Child<const N: usize> {
    Tile([f32; N]),
    Leaf(Box<Leaf<N>>),
}

struct Leaf<const N: usize> {
    active: [u64; VALUES / 64],
    values: [[f32; N]; VALUES],
}

/// Place of a grid in the world: the centre of voxel 0, 0, 0 and the edge of a voxel, metres.
#[derive(Clone, Copy)]
pub struct Place {
    pub origin: [f64; 3],
    pub edge: f64,
}

/// Number of a child in its node: z fastest; `shift`: log2 of the child's edge, `log`: of the node's children along an edge.
fn slot(at: [u32; 3], shift: u32, log: u32) -> u32 {
    let [x, y, z] = at.map(|k| k >> shift & ((1 << log) - 1));
    (x << log | y) << log | z
}

impl<const N: usize> Grid<N> {
    /// No voxels; `value`: OpenVDB's name for `N` numbers.
    pub fn new(name: &'static str, value: &'static str) -> Grid<N> {
        Grid { name, value, roots: BTreeMap::new(), count: 0, low: [i32::MAX; 3], high: [i32::MIN; 3] }
    }

    /// Give a cube of voxels a value; `edge` is a power of two, and `at` a multiple of it.
    pub fn fill(&mut self, at: [u32; 3], edge: u32, value: [f32; N]) {
        let step = if edge < 1 << LEAF { 1 } else { 1 << LEAF };
        for x in (0..edge).step_by(step) {
            for y in (0..edge).step_by(step) {
                for z in (0..edge).step_by(step) {
                    self.put([at[0] + x, at[1] + y, at[2] + z], step > 1, value);
                }
            }
        }
        self.count += u64::from(edge).pow(3);
        for k in 0..3 {
            self.low[k] = self.low[k].min(at[k] as i32);
            self.high[k] = self.high[k].max((at[k] + edge - 1) as i32);
        }
    }

    fn put(&mut self, at: [u32; 3], is_tile: bool, value: [f32; N]) {
        let corner = at.map(|k| (k >> UPPER_EDGE << UPPER_EDGE) as i32);
        let upper = self.roots.entry(corner).or_insert_with(|| Upper(BTreeMap::new()));
        let lower = upper.0.entry(slot(at, LOWER_EDGE, UPPER)).or_insert_with(|| Lower(BTreeMap::new()));
        let number = slot(at, LEAF, LOWER);
        if is_tile {
            lower.0.insert(number, Child::Tile(value));
            return;
        }
        let fresh = || Child::Leaf(Box::new(Leaf { active: [0; VALUES / 64], values: [[0.0; N]; VALUES] }));
        if let Child::Leaf(leaf) = lower.0.entry(number).or_insert_with(fresh) {
            let i = slot(at, 0, LEAF) as usize;
            leaf.active[i / 64] |= 1 << (i % 64);
            leaf.values[i] = value;
        }
    }

    /// Append the grid with its description.
    ///
    /// # Errors
    /// What packing says.
    pub fn write(&self, place: Place, out: &mut Vec<u8>) -> io::Result<()> {
        text(out, self.name);
        text(out, &format!("Tree_{}_5_4_3", self.value));
        text(out, "");
        // Where the grid begins, where its leaves' values begin, and where it ends: filled in below.
        let offsets = out.len();
        out.extend([0; 24]);
        let start = out.len();
        out.extend(ACTIVE_BY_ZLIB.to_le_bytes());
        self.metadata(out);
        text(out, "UniformScaleTranslateMap");
        let edge = place.edge;
        for vector in [place.origin, [edge; 3], [edge; 3], [1.0 / edge; 3], [1.0 / (edge * edge); 3], [0.5 / edge; 3]] {
            out.extend(vector.iter().flat_map(|v| v.to_le_bytes()));
        }
        self.topology(out)?;
        let values = out.len();
        for leaf in self.roots.values().flat_map(|u| u.0.values()).flat_map(|l| l.0.values()).filter_map(Child::leaf) {
            out.extend(leaf.mask());
            out.push(BACKGROUND_ELSEWHERE);
            let active = (0..VALUES).filter(|i| leaf.active[i / 64] >> (i % 64) & 1 == 1).map(|i| leaf.values[i]);
            packed(active, out)?;
        }
        for (i, at) in [start, values, out.len()].into_iter().enumerate() {
            out[offsets + 8 * i..offsets + 8 * i + 8].copy_from_slice(&(at as u64).to_le_bytes());
        }
        Ok(())
    }

    fn metadata(&self, out: &mut Vec<u8>) {
        let ints = |v: [i32; 3]| v.iter().flat_map(|k| k.to_le_bytes()).collect::<Vec<u8>>();
        let (low, high) = if self.count > 0 { (self.low, self.high) } else { ([0; 3], [-1; 3]) };
        let mut items = vec![
            ("class", "string", if N == 1 { "fog volume" } else { "unknown" }.as_bytes().to_vec()),
            ("file_bbox_max", "vec3i", ints(high)),
            ("file_bbox_min", "vec3i", ints(low)),
            ("file_voxel_count", "int64", self.count.to_le_bytes().to_vec()),
            ("is_saved_as_half_float", "bool", vec![0]),
            ("name", "string", self.name.as_bytes().to_vec()),
        ];
        if N == 3 {
            items.push(("vector_type", "string", b"invariant".to_vec()));
        }
        out.extend((items.len() as u32).to_le_bytes());
        for (name, kind, value) in items {
            text(out, name);
            text(out, kind);
            out.extend((value.len() as u32).to_le_bytes());
            out.extend(value);
        }
    }

    fn topology(&self, out: &mut Vec<u8>) -> io::Result<()> {
        // One buffer of values, the background, no tiles at the root.
        out.extend(1u32.to_le_bytes());
        out.extend([0.0f32; N].iter().flat_map(|v| v.to_le_bytes()));
        out.extend([0, self.roots.len() as u32].iter().flat_map(|v| v.to_le_bytes()));
        for (corner, upper) in &self.roots {
            out.extend(corner.iter().flat_map(|k| k.to_le_bytes()));
            inner::<N>(UPPER, upper.0.keys().copied(), &[], out)?;
            for lower in upper.0.values() {
                let is_leaf = |child: &Child<N>| child.leaf().is_some();
                let leaves = lower.0.iter().filter(|(_, child)| is_leaf(child)).map(|(number, _)| *number);
                let tile = |(number, child): (&u32, &Child<N>)| match child {
                    Child::Tile(value) => Some((*number, *value)),
                    Child::Leaf(_) => None,
                };
                inner(LOWER, leaves, &lower.0.iter().filter_map(tile).collect::<Vec<_>>(), out)?;
                lower.0.values().filter_map(Child::leaf).for_each(|leaf| out.extend(leaf.mask()));
            }
        }
        Ok(())
    }
}

impl<const N: usize> Child<N> {
    fn leaf(&self) -> Option<&Leaf<N>> {
        if let Child::Leaf(leaf) = self { Some(leaf) } else { None }
    }
}

impl<const N: usize> Leaf<N> {
    fn mask(&self) -> impl Iterator<Item = u8> {
        self.active.into_iter().flat_map(u64::to_le_bytes)
    }
}

/// A node with its children's and tiles' masks, and the tiles' values.
fn inner<const N: usize>(
    log: u32,
    children: impl Iterator<Item = u32>,
    tiles: &[(u32, [f32; N])],
    out: &mut Vec<u8>,
) -> io::Result<()> {
    let mask = |numbers: &mut dyn Iterator<Item = u32>| {
        let mut bytes = vec![0u8; 1 << (3 * log - 3)];
        numbers.for_each(|i| bytes[(i / 8) as usize] |= 1 << (i % 8));
        bytes
    };
    out.extend(mask(&mut { children }));
    out.extend(mask(&mut tiles.iter().map(|tile| tile.0)));
    out.push(BACKGROUND_ELSEWHERE);
    packed(tiles.iter().map(|tile| tile.1), out)
}

/// Values by zlib behind their packed length; as they are behind their negative length, where that is not shorter.
fn packed<const N: usize>(values: impl Iterator<Item = [f32; N]>, out: &mut Vec<u8>) -> io::Result<()> {
    let plain: Vec<u8> = values.flatten().flat_map(f32::to_le_bytes).collect();
    let mut zlib = ZlibEncoder::new(Vec::new(), Compression::default());
    zlib.write_all(&plain)?;
    let short = zlib.finish()?;
    if short.len() < plain.len() {
        out.extend((short.len() as i64).to_le_bytes());
        out.extend(short);
    } else {
        out.extend((-(plain.len() as i64)).to_le_bytes());
        out.extend(plain);
    }
    Ok(())
}

/// A text behind its length.
pub fn text(out: &mut Vec<u8>, text: &str) {
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(text.as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_are_numbered_with_z_fastest() {
        assert_eq!(slot([1, 2, 3], 0, LEAF), 1 << 6 | 2 << 3 | 3);
        assert_eq!(slot([8, 0, 127], LEAF, LOWER), 1 << 8 | 15);
        assert_eq!(slot([4096 + 128, 0, 0], LOWER_EDGE, UPPER), 1 << 10);
    }

    #[test]
    fn what_does_not_pack_is_stored_as_it_is() {
        let mut out = Vec::new();
        packed([[1.5f32]].into_iter(), &mut out).unwrap();
        assert_eq!(out[..8], (-4i64).to_le_bytes());
        assert_eq!(out[8..], 1.5f32.to_le_bytes());
        let mut out = Vec::new();
        packed([[0.25f32]; 512].into_iter(), &mut out).unwrap();
        assert!(out.len() < 100 && out[7] == 0);
    }

    #[test]
    fn a_grid_counts_its_voxels_and_its_offsets_hold() {
        let mut grid = Grid::<1>::new("density", "float");
        grid.fill([0, 0, 0], 1, [2.0]);
        grid.fill([16, 0, 0], 16, [3.0]);
        assert_eq!((grid.count, grid.low, grid.high), (4097, [0; 3], [31, 15, 15]));
        let mut out = vec![7; 5];
        grid.write(Place { origin: [0.5; 3], edge: 1.0 }, &mut out).unwrap();
        let at = 5 + (4 + 7) + (4 + 16) + 4;
        let offset = |i: usize| u64::from_le_bytes(out[at + 8 * i..at + 8 * i + 8].try_into().unwrap()) as usize;
        assert_eq!(offset(0), at + 24);
        assert_eq!(offset(2), out.len());
        // The one leaf: its mask, the kind of its rest, and one value that is not packed.
        assert_eq!(offset(2) - offset(1), 64 + 1 + 8 + 4);
    }
}

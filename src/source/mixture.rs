//! Sum of several semi-transparent media in one region: where they share voxels, their matter is added.

use crate::geom::DVec3;
use crate::morton;
use crate::source::Medium;
use crate::volume::Mix;
use crate::volume::material::FINE_STEP;

/// Call `each` with the part of `medium` in every voxel of its cube.
pub fn voxels(medium: &Medium, each: &mut dyn FnMut(Medium)) {
    let side = 1u32 << medium.edge_log2;
    let whole = f64::from(side);
    let (lo, hi) = (medium.lo * whole, medium.hi * whole);
    for code in 0..u64::from(side).pow(3) {
        let cell = morton::decode(code);
        let corner = DVec3::from(cell.map(f64::from));
        let part = Medium {
            at: std::array::from_fn(|a| medium.at[a] + cell[a]),
            edge_log2: 0,
            lo: (lo - corner).clamp(DVec3::ZERO, DVec3::ONE),
            hi: (hi - corner).clamp(DVec3::ZERO, DVec3::ONE),
            ..*medium
        };
        if part.is_valid() {
            each(part);
        }
    }
}

/// The media `parts` of one region as voxels that do not overlap, in Morton order. Voxels for which `keep` is false are left out.
pub fn mix(parts: &[Medium], keep: &dyn Fn(&Medium) -> bool) -> Vec<Medium> {
    let mut all = Vec::new();
    for part in parts {
        voxels(part, &mut |v| {
            if keep(&v) {
                all.push(v);
            }
        });
    }
    // Stable, so that sums are taken in the order of the sources.
    all.sort_by_key(|v| morton::encode(v.at));
    all.chunk_by(|a, b| a.at == b.at).filter_map(sum).collect()
}

/// Sum of all matter in one voxel.
fn sum(parts: &[Medium]) -> Option<Medium> {
    let first = parts.first()?;
    if parts.len() == 1 {
        return Some(*first);
    }
    let (lo, hi) = parts.iter().fold((first.lo, first.hi), |(lo, hi), p| (lo.min(p.lo), hi.max(p.hi)));
    let volume = |lo: DVec3, hi: DVec3| (hi - lo).element_product();
    let (mut matter, mut scattered, mut flat) = (0.0, 0.0, 0.0);
    let (mut facing, mut normal) = (DVec3::ZERO, DVec3::ZERO);
    let mut albedo = DVec3::ZERO;
    for p in parts {
        let own = p.extinction * volume(p.lo, p.hi);
        matter += own;
        scattered += if p.scattered { own } else { 0.0 };
        flat += own * p.flat;
        // Flakes with opposite normals are the same: all are turned to the side of the first.
        normal += own * p.flat * p.normal * if p.normal.dot(first.normal) < 0.0 { -1.0 } else { 1.0 };
        facing += own * p.facing * p.normal;
        albedo += own * DVec3::from(p.albedo.map(f64::from));
    }
    let way = if normal.dot(facing) < 0.0 { -normal } else { normal };
    let way = way.try_normalize().or_else(|| facing.try_normalize()).unwrap_or(DVec3::ZERO);
    let weights = parts.iter().flat_map(|p| {
        let own = p.extinction * volume(p.lo, p.hi);
        p.materials.weights().map(move |(id, share)| (id, own * share))
    });
    let mut materials: std::collections::BTreeMap<u8, f64> = std::collections::BTreeMap::new();
    weights.for_each(|(id, weight)| *materials.entry(id).or_default() += weight);
    Some(Medium {
        materials: Mix::new(materials, FINE_STEP),
        lo,
        hi,
        extinction: matter / volume(lo, hi),
        flat: if flat > 0.0 { normal.length() / matter } else { 0.0 },
        normal: way,
        scattered: scattered > 0.5 * matter,
        facing: (facing.dot(way) / matter).clamp(0.0, 1.0),
        albedo: (albedo / matter).as_vec3().to_array(),
        ..*first
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matter_adds_up() {
        let whole = Medium { hi: DVec3::new(1.0, 1.0, 0.75), ..Medium::even([4, 0, 8], 2, 0.5, [1.0, 0.0, 0.0]) };
        let one = Medium::even([5, 1, 9], 0, 1.5, [0.0, 1.0, 0.0]);
        let matter = |list: &[Medium]| list.iter().map(|m| m.extinction * (m.hi - m.lo).element_product()).sum::<f64>();
        let mixed = mix(&[whole, one], &|_| true);
        assert_eq!(mixed.len(), 48);
        assert!((matter(&mixed) - (0.5 * 48.0 + 1.5)).abs() < 1e-12);
        let shared = mixed.iter().find(|m| m.at == one.at).unwrap();
        assert_eq!((shared.extinction, shared.albedo), (2.0, [0.25, 0.75, 0.0]));
        assert_eq!(mix(&[whole, one], &|m| m.at != one.at).len(), 47);
    }
}

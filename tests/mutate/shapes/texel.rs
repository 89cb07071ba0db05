//! A texel of any tree, codes and description: what is written is valid, what is read and written again holds the same, and rays lose
//! between nothing and all.

use std::path::Path;
use std::sync::Arc;

use arbitrary::{Result, Unstructured};
use vtex::format::{Limits, Quality, Reader, WriteOptions, truncate, verify, write};
use vtex::geom::{Aabb, DVec3, Vec3};
use vtex::random::SplitMix64;
use vtex::render::{DepthChoice, MarchSegment, MarchStats, transmittance};
use vtex::volume::material::{Material, Mix};
use vtex::volume::{Channels, Depth, Info, Model, Octree, Volume, Voxel};

use super::{number, one_in};
use crate::targets::MEMORY;

/// Nodes of a depth.
const MAX_NODES: usize = 300;

/// A voxel of any codes; most have an axis whose diagonal element is 1, as all that are baked do.
fn voxel(u: &mut Unstructured) -> Result<Voxel> {
    let mut voxel = Voxel {
        rate: u.arbitrary()?,
        correlation: u.arbitrary()?,
        ndf: u.arbitrary()?,
        support: u.arbitrary()?,
        albedo: u.arbitrary()?,
        mean_normal: u.arbitrary()?,
    };
    if !one_in(u, 16)? {
        voxel.ndf[u.int_in_range(0..=2usize)?] = 255;
    }
    Ok(voxel)
}

fn materials(u: &mut Unstructured) -> Result<Vec<Material>> {
    let count = if one_in(u, 2)? { 0 } else { u.int_in_range(0..=7u8)? };
    let unit = |u: &mut Unstructured| Ok(f64::from(u.arbitrary::<u8>()?) / 255.0);
    (0..count)
        .map(|n| Ok(Material { name: format!("m{n}"), albedo: [unit(u)?, unit(u)?, unit(u)?], share: unit(u)? }))
        .collect()
}

fn info(u: &mut Unstructured) -> Result<Info> {
    let corner = DVec3::new(number(u)?, number(u)?, number(u)?);
    let edge = if one_in(u, 16)? { number(u)? } else { f64::from(u.int_in_range(1..=1000u16)?) / 100.0 };
    let unit = |u: &mut Unstructured| Ok(f64::from(u.arbitrary::<u8>()?) / 255.0);
    let mut corners = [DVec3::ZERO; 2];
    for k in 0..3 {
        let (a, b): (f64, f64) = (unit(u)?, unit(u)?);
        (corners[0][k], corners[1][k]) = (a.min(b), a.max(b));
    }
    Ok(Info {
        bounds: Aabb::new(corner, corner + DVec3::splat(edge)),
        metres_per_unit: if one_in(u, 8)? { number(u)? } else { 1.0 },
        up: u.int_in_range(0..=2)?,
        cyclic: u.arbitrary()?,
        model: if one_in(u, 4)? { Model::Neyret } else { Model::Coverage },
        content: Aabb::new(corners[0], corners[1]),
        facet_size: 2.0 * unit(u)?,
        channels: Channels {
            correlation: u.arbitrary()?,
            support: u.arbitrary()?,
            albedo: u.arbitrary()?,
            mean_normal: u.arbitrary()?,
        },
        materials: materials(u)?,
        ..Info::default()
    })
}

fn mix(u: &mut Unstructured, materials: u8) -> Result<Mix> {
    let mut weights = Vec::new();
    for id in 0..materials {
        weights.push((id, f64::from(u.arbitrary::<u8>()?)));
    }
    Ok(Mix::new(weights, 1))
}

fn volume(u: &mut Unstructured) -> Result<Volume> {
    let info = info(u)?;
    let count = u.int_in_range(0..=6usize)?;
    let kinds = info.materials.len() as u8;
    let mut depths: Vec<Depth> = Vec::new();
    let mut nodes = 1usize;
    for d in 0..count {
        let mut depth = Depth::default();
        let mut below = 0;
        for _ in 0..nodes {
            depth.voxels.push(voxel(u)?);
            if kinds > 1 {
                depth.mixes.push(mix(u, kinds)?);
            }
            let mask: u8 = if d + 1 == count || below > MAX_NODES { 0 } else { u.arbitrary()? };
            below += mask.count_ones() as usize;
            depth.masks.push(mask);
        }
        nodes = below;
        depths.push(depth);
    }
    Ok(Volume { info, depths })
}

/// Rays through a texel: each loses between nothing and all, and more the farther it goes.
pub fn crossed(tree: &Octree, seed: u32) {
    let mut dice = SplitMix64::new(seed.into());
    for _ in 0..4 {
        let mut point = || Vec3::new(dice.unit() as f32, dice.unit() as f32, dice.unit() as f32);
        let (from, to) = (point(), point());
        let dir = (to - from).try_normalize().unwrap_or(Vec3::X);
        let origin = from - 2.0 * dir;
        let footprint = dice.unit() as f32;
        let mut before = 1.0;
        for length in [0.5, 2.0, 5.0] {
            let segment = MarchSegment { origin, dir, length, footprint, growth: 0.1, opacity_scale: 1.0 };
            let through = transmittance(tree, &segment, DepthChoice::default(), 0.0, &mut MarchStats::default());
            // A part of a block is summed in another order, to a few roundings.
            assert!((0.0..=before + 1e-6).contains(&through), "{through} of {before} are left after {length}");
            before = through;
        }
    }
}

pub fn made(u: &mut Unstructured, folder: &Path) -> Result<vtex::Result<()>> {
    let volume = volume(u)?;
    let quality = if one_in(u, 3)? { Quality::Lean } else { Quality::Full };
    let (seed, cut) = (u.arbitrary()?, u.int_in_range(0..=6usize)?);
    Ok(checked(&volume, quality, seed, cut, folder))
}

fn checked(volume: &Volume, quality: Quality, seed: u32, cut: usize, folder: &Path) -> vtex::Result<()> {
    let [path, again, short] = ["made.vtex", "again.vtex", "short.vtex"].map(|name| folder.join(name));
    let options = WriteOptions { level: 1, quality };
    // What contradicts itself is refused before there is a file.
    write(volume, &path, &options)?;
    verify(&path).unwrap_or_else(|e| panic!("what was written is not valid: {e}"));
    let reader = Arc::new(Reader::open(&path, &Limits { decoded_bytes: MEMORY })?);
    let back = reader.read_all()?;
    // A texel of no depth is one without a root.
    let masks = |v: &Volume| v.depths.iter().map(|d| d.masks.clone()).filter(|m| !m.is_empty()).collect::<Vec<_>>();
    assert_eq!(masks(&back), masks(volume), "the tree");
    // Colours that became alike by their steps are kept in finer steps the next time, with the same values. Then it stays so.
    write(&back, &again, &options)?;
    let twice = Reader::open(&again, &Limits { decoded_bytes: MEMORY })?.read_all()?;
    assert!(twice.depths == back.depths, "what was read and written holds something else");
    let third = folder.join("third.vtex");
    write(&twice, &third, &options)?;
    let bytes = |path: &Path| std::fs::read(path).unwrap();
    assert!(bytes(&again) == bytes(&third), "what was read is written as other bytes");
    if cut < back.depths.len() {
        truncate(&path, cut, &short)?;
        verify(&short).unwrap_or_else(|e| panic!("what was cut is not valid: {e}"));
    }
    crossed(&Octree::new(reader)?, seed);
    Ok(())
}

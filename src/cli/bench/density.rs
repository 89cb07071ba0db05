//! The baseline of linear filtering: an SGGX and a density that are averages over a voxel, with no coverage measured.
//!
//! Based on: E. Heitz, J. Dupuy, C. Crassin, C. Dachsbacher, *The SGGX Microflake Distribution*, SIGGRAPH 2015 (projected
//! areas filter linearly).

use std::path::Path;

use crate::bake;
use crate::cli::Ui;
use crate::format;
use crate::format::{Limits, Reader, WriteOptions};
use crate::source;
use crate::source::OpenOptions;
use crate::source::Placement;
use crate::volume::voxel::encode_rate;
use crate::volume::{Voxel, brightness};
use crate::{Error, Result};

/// Bytes that the source's facets may take.
const FACETS: u64 = 2 << 30;

/// Write to `out` the texel `baked` with its rates and normals taken from the projected areas of the facets in each voxel,
/// at every depth: hits in a voxel's edge are area over volume. Colours and opaque insides stay.
pub fn write(source: &Path, baked: &Path, out: &Path, ui: &Ui) -> Result<()> {
    let mut volume = Reader::open(baked, &Limits { decoded_bytes: u64::MAX })?.read_all()?;
    let Some(finest) = volume.depths.len().checked_sub(1) else {
        return Err(Error::input(baked, "", "is an empty texel"));
    };
    let source = source::open(source, &OpenOptions::default())?;
    let place = Placement::of(&volume.info, finest);
    let staged = source.stage(&place, ui)?;
    let mut areas = source::facets(&*staged, &place, FACETS, ui)?.areas;
    let mut codes = vec![vec![0u64]];
    for depth in &volume.depths[..finest] {
        let nodes = codes.last().into_iter().flatten().zip(&depth.masks);
        let children =
            nodes.flat_map(|(code, mask)| (0..8).filter(move |j| mask >> j & 1 != 0).map(move |j| code << 3 | j));
        let below = children.collect();
        codes.push(below);
    }
    for (depth, codes) in volume.depths.iter_mut().zip(&codes).rev() {
        for (voxel, code) in depth.voxels.iter_mut().zip(codes) {
            let Ok(found) = areas.binary_search_by_key(code, |a| a.0) else { continue };
            voxel.correlation &= 0xf0;
            voxel.support = Voxel::default().support;
            if let Some(s) = bake::fit_sggx(&areas[found].1) {
                voxel.ndf = s.encode();
                voxel.rate = encode_rate(s.scale().into());
            }
        }
        // In squares of the parent's edge.
        areas.iter_mut().for_each(|a| *a = (a.0 >> 3, a.1.map(|v| 0.25 * v)));
        areas.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            if same {
                kept.1.iter_mut().zip(next.1).for_each(|(sum, area)| *sum += area);
            }
            same
        });
    }
    volume.info.meta.remove(brightness::META_KEY);
    volume.info.meta.remove("error");
    format::write(&volume, out, &WriteOptions::default()).map(|_| ())
}

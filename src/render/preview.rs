//! Preview of one texel: a sheet of three lit orthographic views and three slices.

use crate::geom::{Aabb, Vec2, Vec3};
use crate::volume::octree::Octree;
use crate::{Error, Result, par};

use super::image_io::srgb8;
use crate::march::shade::Shader;
use crate::march::transmittance::{DepthChoice, MarchSegment, MarchStats, march, transmittance_from_own_matter};

/// An 8-bit sRGB picture, rows from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sheet {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` pixels, row by row from the top.
    pub rgb: Vec<[u8; 3]>,
}

/// The view of one tile of the sheet: the rectangle on which its rays start, and their direction.
struct View {
    /// Rightward and downward edge of the tile, texel space.
    right: Vec3,
    down: Vec3,
    into: Vec3,
    /// The tile's centre, on the plane that the rays start from.
    centre: Vec3,
    /// Length of its rays.
    reach: f32,
    lit: bool,
}

/// Number of tiles across and down the sheet.
const TILES: [usize; 2] = [3, 2];
const MARGIN: f32 = 1.03;
/// Direction to the sun in each view, along (right, down, into): from the upper left, behind the viewer's shoulder.
const TO_SUN: [f32; 3] = [-0.45, -0.75, -0.55];
/// Irradiance / π of the sun, and radiance of the sky: they add up to 1, so a white facet that faces the sun is white.
const SUN: f32 = 0.75;
const SKY: f32 = 0.25;
const BACKGROUND: f32 = 0.9;
/// Thickness of a slice, as a share of the content's largest edge.
const SLICE: f32 = 1.0 / 128.0;

/// The sheet of `tree`, each tile `tile` pixels per side: above from the front (along v, as the source's −Z to +Z), from the
/// side (along −u) and from above, below slices through the middle in the same three directions. Fails where the texel
/// cannot be read, or `tile` is not in 16 ..= 4096.
pub fn preview(tree: Octree, tile: usize) -> Result<Sheet> {
    if !(16..=4096).contains(&tile) {
        return Err(Error::Options(format!("a preview's tiles are 16 to 4096 pixels wide, not {tile}")));
    }
    let views = views(&tree.info().content.intersection(Aabb::UNIT));
    let [width, height] = TILES.map(|n| n * tile);
    let mut rgb = vec![[0; 3]; width * height];
    par::chunks_mut(&mut rgb, width, |row, pixels| {
        for (column, pixel) in pixels.iter_mut().enumerate() {
            let view = &views[row / tile * TILES[0] + column / tile];
            let at = Vec2::new((column % tile) as f32 + 0.5, (row % tile) as f32 + 0.5) / tile as f32 - 0.5;
            *pixel = shade(&tree, view, at, 1.0 / tile as f32).to_array().map(srgb8);
        }
    });
    match tree.into_failure() {
        Some(e) => Err(e),
        None => Ok(Sheet { width, height, rgb }),
    }
}

fn views(content: &Aabb) -> Vec<View> {
    let content = if content.is_empty() { Aabb::UNIT } else { *content };
    let (centre, size) = (content.centre().as_vec3(), content.size().as_vec3());
    let edge = size.max_element().max(1e-6) * MARGIN;
    // Right, down, into.
    let frames = [[Vec3::X, -Vec3::Z, Vec3::Y], [Vec3::Y, -Vec3::Z, -Vec3::X], [Vec3::X, -Vec3::Y, -Vec3::Z]];
    let mut views = Vec::new();
    for lit in [true, false] {
        for [right, down, into] in frames {
            let reach = if lit { edge * 1.01 } else { edge * SLICE };
            let centre = centre - into * (0.5 * reach);
            views.push(View { right: right * edge, down: down * edge, into, centre, reach, lit });
        }
    }
    views
}

fn shade(tree: &Octree, view: &View, at: Vec2, pixel: f32) -> Vec3 {
    let edge = view.right.length();
    let origin = view.centre + view.right * at.x + view.down * at.y;
    let footprint = pixel * edge;
    let segment =
        MarchSegment { origin, dir: view.into, length: view.reach, footprint, growth: 0.0, opacity_scale: 1.0 };
    let choice = DepthChoice::default();
    let mut stats = MarchStats::default();
    let sun = view.right.normalize() * TO_SUN[0] + view.down.normalize() * TO_SUN[1] + view.into * TO_SUN[2];
    let to_sun = [sun.normalize()];
    let mut groups = Vec::new();
    let lights = if view.lit { &to_sun[..] } else { &[] };
    let mut shader = Shader::new(-view.into, lights, None, Vec3::ONE, tree.brightness_factors(), &mut groups);
    shader = shader.with_surfaces_of(tree);
    let t = march(tree, &segment, choice, 1.0, &mut shader, &mut stats);
    shader.finish();
    let ambient = if view.lit { SKY } else { 1.0 };
    let mut radiance = (shader.albedo + shader.transmission) * ambient + shader.unlit + BACKGROUND * t;
    for group in &groups {
        let origin = group.position + group.start(tree.info().facet_size as f32, to_sun[0]);
        let shadow = MarchSegment { origin, dir: to_sun[0], length: 2.0, ..segment };
        radiance +=
            group.energy * (SUN * transmittance_from_own_matter(tree, &shadow, choice, 1.0 / 256.0, &mut stats));
    }
    radiance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::march::transmittance::tests::sparse;
    use crate::volume::Voxel;
    use crate::volume::voxel::RATE_MAX;

    #[test]
    fn an_opaque_cube_fills_its_tiles() {
        let red = Voxel { rate: RATE_MAX, albedo: [255, 0, 0], ..Voxel::default() };
        let volume = sparse(3, &(0..512).collect::<Vec<_>>(), &[red; 512], red);
        let sheet = preview(Octree::new(volume).unwrap(), 32).unwrap();
        assert_eq!((sheet.width, sheet.height, sheet.rgb.len()), (96, 64, 96 * 64));
        let pixel = |x: usize, y: usize| sheet.rgb[y * sheet.width + x];
        for tile in 0..3 {
            let (lit, slice) = (pixel(16 + 32 * tile, 16), pixel(16 + 32 * tile, 48));
            assert!(lit[0] > 60 && lit[1..] == [0, 0], "{lit:?}");
            assert_eq!(slice, [255, 0, 0]);
        }
    }

    #[test]
    fn an_empty_texel_is_blank() {
        let mut volume = sparse(2, &[], &[], Voxel::default());
        volume.depths.clear();
        let sheet = preview(Octree::new(volume).unwrap(), 16).unwrap();
        assert!(sheet.rgb.iter().flatten().all(|&v| v == srgb8(BACKGROUND)));
        assert!(preview(Octree::new(sparse(0, &[0], &[Voxel::default()], Voxel::default())).unwrap(), 3).is_err());
    }
}

//! The plan of a mapping: the direction in which copies grow, the texture coordinates by which they are laid out, and their size on each
//! primitive.

use super::options::{Cells, Chart, Heights, MapOptions};
use super::surface::{Coordinates, Surface, SurfaceStats};
use crate::error::length;
use crate::geom::DVec3;
use crate::scene::shell::Orientations;
use crate::volume::Info;
use crate::{Error, Result, Warnings};

/// Mean cosine between the ground's normals and up above which heights are straight up by default; below its negative, the ground faces down.
const FACES_UP: f64 = 0.7;
/// Least number of copies along the mesh's shorter side. If fewer fit, copies are made smaller, so that `FEW_FIT` of them fit.
const FEW: f64 = 3.0;
const FEW_FIT: f64 = 16.0;
/// Charts whose metres per unit agree within this factor get copies of the same size.
const SAME_DENSITY: f64 = 1.1;
/// Height vectors of the file seem to have been made with Z up if their mean cosine with the normals is below the first value, and above the
/// second one after they are turned from Z up to Y up.
const LIES_FLAT: f64 = 0.3;
const STANDS_UP: f64 = 0.7;

/// The decisions of a mapping.
pub struct Plan {
    /// Unit direction in which all copies grow; `None` for along the normals.
    pub up: Option<DVec3>,
    pub chart: Chart,
    /// Origin of the planar chart, metres.
    pub origin: [f64; 2],
    /// Share of the texel's cube, along w, that the shell holds.
    pub dw: f64,
    /// One plan per surface.
    pub surfaces: Vec<SurfacePlan>,
}

/// What is decided for one surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePlan {
    pub coordinates: Coordinates,
    /// Cells per unit of the chart; v runs against the texel's where it is negative.
    pub scale: [f64; 2],
    /// Metres that a cell covers along u and v.
    pub cell: [f64; 2],
    /// Height of the shell, metres.
    pub thickness: f64,
    /// Square metres, of all placements.
    pub area: f64,
    /// Whether the file's own `_VTEX_UVW` and `_VTEX_HEIGHT` stay.
    pub keeps_uvw: bool,
    pub keeps_heights: bool,
}

impl Plan {
    /// Decide; `rigid` tells that rigid copies are placed, which need no texture coordinates.
    pub fn new(
        options: &MapOptions,
        surfaces: &[Surface],
        rigid: bool,
        notes: &mut Vec<String>,
        warnings: &mut Warnings,
    ) -> Result<Plan> {
        let up = up(options, surfaces, notes, warnings);
        let kept =
            |s: &Surface, name: &str| !rigid && !options.replace && (options.add || s.geometry.is_authored(name));
        let keeps_uvw: Vec<bool> = surfaces.iter().map(|s| s.geometry.uvw.is_some() && kept(s, "_VTEX_UVW")).collect();
        let keeps_heights: Vec<bool> =
            surfaces.iter().map(|s| s.geometry.heights.is_some() && kept(s, "_VTEX_HEIGHT")).collect();
        if options.z_up && !keeps_heights.iter().any(|k| *k) {
            return Err(Error::Options("option `z_up` turns _VTEX_HEIGHT vectors of the file, which has none".into()));
        }
        let chart = chart(options, surfaces, &keeps_uvw, up, rigid, notes)?;
        let planar = if let Chart::Planar(axis) = chart { Some(Coordinates::Planar(axis)) } else { None };
        let coordinates: Vec<Coordinates> = keeps_uvw
            .iter()
            .map(|&own| if own { Coordinates::Own } else { planar.unwrap_or(Coordinates::Uv) })
            .collect();
        let groups = groups(surfaces, &coordinates, up);
        check_charts(options, surfaces, &groups, (rigid, planar.is_some()))?;
        let origin = groups
            .iter()
            .find(|g| Some(g.coordinates) == planar)
            .map_or([0.0; 2], |g| [g.stats.span[0][0], g.stats.span[1][0]]);
        let width = if rigid { 1.0 } else { width(options, &groups, notes, warnings) };
        let heights_kept = !options.add && keeps_heights.iter().any(|k| *k);
        let dw = if heights_kept { 1.0 } else { share_of_cube(options) };
        let mut planned = vec![None; surfaces.len()];
        for group in &groups {
            let (scale, cell) = match options.cells {
                Cells::Wide(width) if rigid => ([1.0; 2], [width; 2]),
                Cells::Texel if rigid => ([1.0; 2], [1.0; 2]),
                _ => group.cells(options, width),
            };
            for &i in &group.members {
                let Some(surface) = surfaces.get(i) else { continue };
                let given = surface.height_facts().filter(|_| keeps_heights[i] && !options.add).map(|f| f[0]);
                let natural = (cell[0] * cell[1]).sqrt() * dw;
                planned[i] = Some(SurfacePlan {
                    coordinates: group.coordinates,
                    scale,
                    cell,
                    thickness: options.thickness.or(given.filter(|h| *h > 0.0)).unwrap_or(natural),
                    area: SurfaceStats::of([surface], group.coordinates, up).area,
                    keeps_uvw: keeps_uvw[i],
                    keeps_heights: keeps_heights[i],
                });
            }
        }
        let surfaces = planned.into_iter().flatten().collect();
        Ok(Plan { up, chart, origin, dw, surfaces })
    }
}

/// Check that every chart that is needed has an area; the flags tell whether rigid copies are placed, and whether the chart is planar.
///
/// # Errors
/// `Options`, with the mesh whose chart has none.
fn check_charts(
    options: &MapOptions,
    surfaces: &[Surface],
    groups: &[Group],
    (rigid, is_planar): (bool, bool),
) -> Result<()> {
    // Rigid copies need texture coordinates only where their number is given in units of these.
    if rigid && !matches!(options.cells, Cells::Repeat(_)) {
        return Ok(());
    }
    let unusable = |g: &&Group| !g.stats.usable() && (options.add || g.coordinates != Coordinates::Own);
    let Some(group) = groups.iter().find(unusable) else { return Ok(()) };
    let mesh = surfaces.get(group.members[0]).map_or(0, |s| s.mesh);
    let what = if is_planar {
        "is flat along u or v of this chart; use another axis for option `chart`"
    } else {
        "has texture coordinates that cover no area; use option `chart` along y"
    };
    Err(Error::Options(format!("the mesh {what} (meshes[{mesh}])")))
}

/// Share of the texel's cube, along w, that a shell has to hold: up to the top of the content, unless copies may be turned upside down or
/// displaced along w.
fn share_of_cube(options: &MapOptions) -> f64 {
    let top = options.texels.iter().map(|(_, info)| info.content.max.z).fold(0.0, f64::max);
    let upright = !matches!(options.orientations, Orientations::Cube24 | Orientations::Cube48) && !options.mirror[2];
    if !upright || options.displace[2] > 0.0 || top <= 0.0 { 1.0 } else { (top * 1.001).min(1.0) }
}

/// The direction in which copies grow, with warnings about unusual grounds.
fn up(options: &MapOptions, surfaces: &[Surface], notes: &mut Vec<String>, warnings: &mut Warnings) -> Option<DVec3> {
    for surface in surfaces {
        if options.replace || !surface.geometry.is_authored("_VTEX_HEIGHT") {
            continue;
        }
        let Some([_, flat, turned]) = surface.height_facts() else { continue };
        if !options.z_up && flat.abs() < LIES_FLAT && turned > STANDS_UP {
            warnings.add(
                "the file's _VTEX_HEIGHT vectors lie flat on the ground: they seem to have been made with Z up; \
                 option `z_up` turns them up, option `replace` makes new ones",
            );
        }
    }
    let all = SurfaceStats::of(surfaces, Coordinates::Uv, None);
    let facing = all.facing.y / all.area;
    match options.heights {
        Heights::Along(d) => d.try_normalize(),
        Heights::Normals => {
            if facing < -FACES_UP {
                warnings.add(
                    "the ground faces down (its triangles run clockwise from above), and copies hang below it along its \
                     normals; option `heights` along 0,1,0 makes them grow up",
                );
            }
            None
        }
        Heights::Auto if facing > FACES_UP => {
            notes.push("heights: straight up, because the mesh mostly faces up".into());
            Some(DVec3::Y)
        }
        Heights::Auto if facing < -FACES_UP => {
            warnings.add(
                "the ground faces down (its triangles run clockwise from above); copies grow straight up all the same \
                 (option `heights` along normals lets them hang); turn its faces over in the program that made it",
            );
            Some(DVec3::Y)
        }
        Heights::Auto => None,
    }
}

/// The chart of the surfaces that do not keep the file's own _VTEX_UVW.
fn chart(
    options: &MapOptions,
    surfaces: &[Surface],
    keeps_uvw: &[bool],
    up: Option<DVec3>,
    rigid: bool,
    notes: &mut Vec<String>,
) -> Result<Chart> {
    let has_uvs = surfaces
        .iter()
        .zip(keeps_uvw)
        .all(|(s, &kept)| kept || (s.geometry.has_uvs() && SurfaceStats::of([s], Coordinates::Uv, up).usable()));
    match options.chart {
        Chart::Auto if has_uvs => Ok(Chart::Uv(0)),
        Chart::Auto => {
            if !rigid {
                notes.push("no texture coordinates: planar coordinates seen from above are written".into());
            }
            Ok(Chart::Planar(1))
        }
        Chart::Uv(set) if !has_uvs => {
            Err(Error::Options(format!("the mesh has no usable TEXCOORD_{set}; use option `chart` along y")))
        }
        chart => Ok(chart),
    }
}

/// Surfaces that share a chart and its density, so that copies continue from one to the next.
struct Group {
    coordinates: Coordinates,
    members: Vec<usize>,
    stats: SurfaceStats,
}

fn groups(surfaces: &[Surface], coordinates: &[Coordinates], up: Option<DVec3>) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for (i, (surface, &coordinates)) in surfaces.iter().zip(coordinates).enumerate() {
        let stats = SurfaceStats::of([surface], coordinates, up);
        let close = |g: &&mut Group| {
            let planar = matches!(coordinates, Coordinates::Planar(_));
            let near = |k: usize| {
                let (a, b) = (g.stats.metres[k], stats.metres[k]);
                a <= SAME_DENSITY * b && b <= SAME_DENSITY * a
            };
            g.coordinates == coordinates && (planar || (near(0) && near(1) && g.stats.mirrored == stats.mirrored))
        };
        match groups.iter_mut().find(close) {
            Some(group) => group.members.push(i),
            None => groups.push(Group { coordinates, members: vec![i], stats }),
        }
    }
    for group in groups.iter_mut().filter(|g| g.members.len() > 1) {
        group.stats = SurfaceStats::of(group.members.iter().filter_map(|&i| surfaces.get(i)), group.coordinates, up);
    }
    groups
}

impl Group {
    /// Metres that one unit of the chart covers.
    fn metres(&self) -> [f64; 2] {
        if matches!(self.coordinates, Coordinates::Planar(_)) { [1.0; 2] } else { self.stats.metres }
    }

    /// Metres that the chart spans along its shorter axis.
    fn shorter(&self) -> f64 {
        let (metres, extent) = (self.metres(), self.stats.extent());
        (metres[0] * extent[0]).min(metres[1] * extent[1])
    }

    /// Cells per unit of the chart, and the size of a cell in metres; `width` is the wanted size.
    fn cells(&self, options: &MapOptions, width: f64) -> ([f64; 2], [f64; 2]) {
        let (metres, span) = (self.metres(), self.stats.extent());
        let planar = matches!(self.coordinates, Coordinates::Planar(_));
        if self.coordinates == Coordinates::Own && !options.add {
            // The file's own _VTEX_UVW are in units of copies.
            return ([1.0; 2], metres);
        }
        let own = self.coordinates == Coordinates::Own;
        // A whole number of copies fits the mesh, or the unit square of texture coordinates if the mesh fills it.
        let whole = |k: usize| {
            let n = metres[k] * span[k] / width;
            let square = planar || (!own && (span[k] - 1.0).abs() < 0.1);
            if square { n.round().max(1.0) / span[k] } else { n / span[k] }
        };
        let mut scale = match options.cells {
            Cells::Repeat(n) if planar => [n[0] / span[0], n[1] / span[1]],
            Cells::Repeat(n) => n,
            Cells::Wide(_) | Cells::Texel => [whole(0), whole(1)],
        };
        let cell = [metres[0] / scale[0], metres[1] / scale[1]];
        if self.coordinates == Coordinates::Uv && self.stats.mirrored {
            scale[1] = -scale[1];
        }
        (scale, cell)
    }
}

/// The wanted width of a copy in a shell, metres.
fn width(options: &MapOptions, groups: &[Group], notes: &mut Vec<String>, warnings: &mut Warnings) -> f64 {
    if let Cells::Wide(width) = options.cells {
        return width;
    }
    if let Cells::Repeat(_) = options.cells {
        return 1.0;
    }
    let widths = widths(options, notes);
    let widest = widths.iter().copied().fold(0.0, f64::max);
    let narrowest = widths.iter().copied().fold(f64::INFINITY, f64::min);
    if narrowest < 0.5 * widest {
        warnings.add(format!(
            "the texels are {} to {} m wide, and all are drawn as wide as the widest; map them one by one",
            length(narrowest),
            length(widest)
        ));
    }
    let widest = if widest > 0.0 && widest.is_finite() { widest } else { 1.0 };
    let room = groups.iter().map(Group::shorter).fold(0.0, f64::max);
    let all_kept = groups.iter().all(|g| g.coordinates == Coordinates::Own) && !options.add;
    if all_kept || room >= FEW * widest {
        return widest;
    }
    let fit = room / FEW_FIT;
    warnings.add(format!(
        "the mesh is {} m across and the texel {} m: copies are made {} m wide (option `cells` sets it)",
        length(room),
        length(widest),
        length(fit)
    ));
    fit
}

/// The width of each texel's cube, metres.
fn widths(options: &MapOptions, notes: &mut Vec<String>) -> Vec<f64> {
    let width = |(path, info): &(std::path::PathBuf, Info)| {
        if info.metres_per_unit <= 0.0 {
            notes.push(format!("{}: the source's unit is unknown and taken as a metre", path.display()));
        }
        info.bounds.size().max_element() * metres_per_unit(info)
    };
    options.texels.iter().map(width).collect()
}

/// Metres in a unit of the texel's source.
pub fn metres_per_unit(info: &Info) -> f64 {
    if info.metres_per_unit > 0.0 { info.metres_per_unit } else { 1.0 }
}

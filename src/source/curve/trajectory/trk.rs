//! TrackVis tracts (`.trk`, versions 1 and 2), placed in millimetres right, anterior, superior.

use super::{Content, Cursor, Fault, at_byte, point};
use crate::geom::{DAffine3, DMat3, DVec3};
use crate::source::curve::Strand;

const HEADER: u32 = 1000;

/// Scalars of points that are named as colours become such.
pub fn read(bytes: &[u8]) -> Result<Content, Fault> {
    let mut file = Cursor::new(bytes);
    if !bytes.starts_with(b"TRACK") {
        return Err(at_byte(0, "a tract file begins with TRACK"));
    }
    file.at = HEADER as usize - 4;
    let size = file.u32()?;
    file.big_endian = match size {
        HEADER => false,
        s if s.swap_bytes() == HEADER => true,
        s => return Err(at_byte(996, format!("the header's size is {s} and should be {HEADER}"))),
    };
    let header = Header::read(&mut file)?;
    file.at = HEADER as usize;
    let mut content = Content { metres_per_unit: 1e-3, ..Content::default() };
    if header.unordered {
        content.warnings.add("the file says not along which axes its voxels run: LPS is taken, as TrackVis does");
    }
    if header.guessed {
        content.warnings.add("the file says not where its voxels lie: their own axes and size are taken");
    }
    let mut left = header.count;
    while left != Some(0) && file.left() > 0 {
        let at = file.at;
        let count = file.u32()? as usize;
        if count as i32 <= 0 {
            return Err(at_byte(at, format!("a tract of {} points", count as i32)));
        }
        let width = 3 + header.scalars;
        let values = file.f32s(count.saturating_mul(width))?;
        file.take(4 * header.properties)?;
        let mut strand = Strand::default();
        for v in values.chunks_exact(width) {
            strand.points.push(header.to_mm.transform_point3(point([v[0], v[1], v[2]])));
            if let Some(c) = header.colour {
                strand.colours.push([v[3 + c], v[4 + c], v[5 + c], 1.0]);
            }
        }
        content.strands.push(strand);
        left = left.map(|n| n - 1);
    }
    if left.is_some_and(|n| n > 0) {
        content.warnings.add_many("tracts that the header counts are missing", left.unwrap_or(0).into());
    }
    let whole = content.strands.iter().flat_map(|s| &s.colours).flat_map(|c| &c[..3]).any(|v| *v > 1.0);
    if whole {
        content.strands.iter_mut().flat_map(|s| &mut s.colours).for_each(|[r, g, b, _]| {
            [*r, *g, *b] = [*r, *g, *b].map(|v| v / 255.0);
        });
    }
    Ok(content)
}

struct Header {
    /// Number of values per point besides its position, and per tract.
    scalars: usize,
    properties: usize,
    /// The first of three scalars that are a colour.
    colour: Option<usize>,
    /// None: until the file ends.
    count: Option<u32>,
    /// Voxel corner, in millimetres along the voxels' axes → scanner space.
    to_mm: DAffine3,
    guessed: bool,
    /// True where the file does not say the order of the voxels' axes.
    unordered: bool,
}

impl Header {
    fn read(file: &mut Cursor) -> Result<Header, Fault> {
        file.at = 6;
        let dim = [file.u16()?, file.u16()?, file.u16()?].map(f64::from);
        let mut voxel = DVec3::new(file.f32()?.into(), file.f32()?.into(), file.f32()?.into());
        file.at = 36;
        let scalars = usize::from(file.u16()?);
        let names = file.take(200)?;
        let properties = usize::from(file.u16()?);
        file.take(200)?;
        let mut rows = [[0.0f64; 4]; 4];
        for value in rows.iter_mut().flatten() {
            *value = file.f32()?.into();
        }
        file.at = 948;
        let order = file.take(4)?;
        file.at = 988;
        let count = file.u32()?;
        let mut guessed = false;
        if !(voxel.is_finite() && voxel.min_element() > 0.0) {
            (voxel, guessed) = (DVec3::ONE, true);
        }
        let column = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
        let mut affine = DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(1), column(2)), column(3));
        let sound = |a: &DAffine3| a.is_finite() && a.matrix3.determinant() != 0.0;
        if rows[3][3] == 0.0 || !sound(&affine) {
            (affine, guessed) = (DAffine3::from_scale(voxel), true);
        }
        // Points are measured from the first voxel's corner; the matrix takes its middle.
        let to_voxels = DAffine3::from_translation(DVec3::splat(-0.5)) * DAffine3::from_scale(1.0 / voxel);
        let unordered = order.iter().all(|b| matches!(b, 0 | b' '));
        let to_mm = affine * reordered(if unordered { b"LPS" } else { order }, dim, &affine) * to_voxels;
        Ok(Header {
            scalars,
            properties,
            colour: colour(names, scalars),
            count: (count > 0).then_some(count),
            to_mm,
            guessed,
            unordered,
        })
    }
}

/// The first scalar of a group of three named as a colour. A name takes 20 bytes; after a NUL stands the number of scalars that it names.
fn colour(names: &[u8], scalars: usize) -> Option<usize> {
    let mut first = 0;
    for name in names.as_chunks::<20>().0 {
        let mut parts = name.split(|b| *b == 0).map(|p| String::from_utf8_lossy(p).to_ascii_lowercase());
        let (word, number) = (parts.next().unwrap_or_default(), parts.next().unwrap_or_default());
        if word.is_empty() {
            break;
        }
        let count = number.parse().unwrap_or(1usize);
        if count == 3 && (word.contains("colo") || word.contains("rgb")) && first + 3 <= scalars {
            return Some(first);
        }
        first = first.saturating_add(count);
    }
    None
}

/// Voxel coordinates along the axes that `order` names (such as LPS) → those along the matrix' own axes.
fn reordered(order: &[u8], dim: [f64; 3], affine: &DAffine3) -> DAffine3 {
    // World axis and sense of a letter.
    let letter = |l: u8| match l.to_ascii_uppercase() {
        b'R' => Some((0, 1.0)),
        b'L' => Some((0, -1.0)),
        b'A' => Some((1, 1.0)),
        b'P' => Some((1, -1.0)),
        b'S' => Some((2, 1.0)),
        b'I' => Some((2, -1.0)),
        _ => None,
    };
    let named: Vec<(usize, f64)> = order.iter().take(3).filter_map(|l| letter(*l)).collect();
    let own = nearest_axes(affine.matrix3);
    let mut columns = [DVec3::ZERO; 3];
    let mut shift = DVec3::ZERO;
    for (j, &(axis, sense)) in own.iter().enumerate() {
        let Some(i) = named.iter().position(|n| n.0 == axis).filter(|_| named.len() == 3) else {
            return DAffine3::IDENTITY;
        };
        let same = named[i].1 == sense;
        columns[i][j] = if same { 1.0 } else { -1.0 };
        shift[j] = if same { 0.0 } else { dim[i] - 1.0 };
    }
    DAffine3::from_mat3_translation(DMat3::from_cols(columns[0], columns[1], columns[2]), shift)
}

/// The world axis and sense that each voxel axis runs along best; no two share one.
fn nearest_axes(m: DMat3) -> [(usize, f64); 3] {
    let columns = [m.x_axis, m.y_axis, m.z_axis].map(DVec3::normalize_or_zero);
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let fit = |o: &[usize; 3]| (0..3).map(|i| columns[i][o[i]].abs()).sum::<f64>();
    let best = orders.iter().fold(orders[0], |best, o| if fit(o) > fit(&best) + 1e-12 { *o } else { best });
    std::array::from_fn(|i| (best[i], if columns[i][best[i]] < 0.0 { -1.0 } else { 1.0 }))
}

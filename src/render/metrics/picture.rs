//! Error maps in false colour, and pictures side by side.

use crate::render::image_io::{Image, srgb8};

/// Columns of grey between the pictures of a sheet.
const GAP: usize = 8;

/// `values` (0 … 1) in the magma colours that FLIP's maps use: black 0, light yellow 1; sRGB.
pub fn false_colour(values: &[f32]) -> Vec<[u8; 3]> {
    let table: [[u8; 3]; 256] = std::array::from_fn(|i| colorous::MAGMA.eval_rational(i, 256).as_array());
    values.iter().map(|v| table[(255.0 * v.clamp(0.0, 1.0)).round() as usize]).collect()
}

/// The picture as a display shows it, over black.
pub fn display(image: &Image) -> Vec<[u8; 3]> {
    image.rgba.iter().map(|p| [srgb8(p[0]), srgb8(p[1]), srgb8(p[2])]).collect()
}

/// Pictures of `width` columns each and one height, left to right with a grey gap between: (columns, pixels).
pub fn side_by_side(width: usize, pictures: &[&[[u8; 3]]]) -> (usize, Vec<[u8; 3]>) {
    let height = pictures.first().map_or(0, |p| p.len() / width.max(1));
    let columns = pictures.len() * width + pictures.len().saturating_sub(1) * GAP;
    let mut sheet = Vec::with_capacity(columns * height);
    for y in 0..height {
        for (k, picture) in pictures.iter().enumerate() {
            if k > 0 {
                sheet.extend([[128; 3]; GAP]);
            }
            sheet.extend_from_slice(&picture[y * width..(y + 1) * width]);
        }
    }
    (columns, sheet)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn magma_runs_from_black_to_light_yellow() {
        assert_eq!(false_colour(&[0.0, 1.0, f32::NAN, -3.0]), [[0, 0, 4], [252, 253, 191], [0, 0, 4], [0, 0, 4]]);
    }

    #[test]
    fn sheet_holds_each_row_of_each_picture() {
        let (a, b) = ([[1; 3], [2; 3]], [[3; 3], [4; 3]]);
        let (columns, sheet) = side_by_side(1, &[&a, &b]);
        assert_eq!((columns, sheet.len()), (2 + GAP, 2 * (2 + GAP)));
        assert_eq!([sheet[0], sheet[1], sheet[1 + GAP]], [[1; 3], [128; 3], [3; 3]]);
        assert_eq!([sheet[columns], sheet[2 * columns - 1]], [[2; 3], [4; 3]]);
    }
}

//! Tiles: parts of a picture in files of their own that record their position in it, and the assembly of the picture from them.
//!
//! A tile is a `.png` or `.exr` as the picture itself would be, with the text `X,Y,W,H of WIDTHxHEIGHT in PICTURE` under the
//! name `vtex:tile`: in a PNG a tEXt chunk, in an EXR an attribute of the layer. There its data window also lies in the
//! display window as the tile lies in the picture, so that other programs show it in its place.

use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use exr::prelude::{
    AttributeValue, Encoding, IntegerBounds, Layer, LayerAttributes, SpecificChannels, Vec2, WritableImage,
};

use super::film::Film;
use super::image_io;
use super::options::CropWindow;
use crate::format;
use crate::scene::files::extension;
use crate::{Error, Result};

/// Name of the text that makes a picture a tile.
const NAME: &str = "vtex:tile";

/// Where a part of a picture belongs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tile {
    /// Pixels of the picture that it holds.
    pub window: CropWindow,
    /// Width and height of the picture.
    pub whole: [u32; 2],
    /// Identity of the picture, such as a digest of the scene and the options; one word.
    pub picture: String,
}

impl std::fmt::Display for Tile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [width, height] = self.whole;
        write!(f, "{} of {width}x{height} in {}", self.window, self.picture)
    }
}

impl Tile {
    /// `None` where the text does not describe a tile, or the tile is not within its picture.
    fn parse(text: &str) -> Option<Tile> {
        let [window, "of", whole, "in", picture] = text.split(' ').collect::<Vec<_>>()[..] else { return None };
        let (width, height) = whole.split_once('x')?;
        let whole = [width.parse().ok()?, height.parse().ok()?];
        let window: CropWindow = window.parse().ok()?;
        window.is_within(whole).then(|| Tile { window, whole, picture: picture.to_owned() })
    }

    /// Store a film as this tile of its picture, by the path's extension as [`Film::save`].
    ///
    /// # Errors
    /// `Options` where the film has another size than the tile; else as [`Film::save`].
    pub fn save(&self, film: &Film, path: &Path) -> Result<()> {
        Film::check_name(path)?;
        if [film.width, film.height] != self.window.size {
            let [width, height] = self.window.size;
            let what = format!("a film of {}×{} pixels is no tile of {width}×{height}", film.width, film.height);
            return Err(Error::Options(what));
        }
        let bytes = if extension(path) == "exr" { self.exr(film) } else { self.png(film) };
        format::save(path, &bytes.map_err(|e| Error::io(path, e))?)
    }

    fn png(&self, film: &Film) -> std::io::Result<Vec<u8>> {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, film.width, film.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.add_text_chunk(NAME.into(), self.to_string())?;
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&film.rgb8())?;
        writer.finish()?;
        Ok(out)
    }

    fn exr(&self, film: &Film) -> std::io::Result<Vec<u8>> {
        let [width, height] = self.window.size.map(|n| n as usize);
        let channels = SpecificChannels::rgba(|at: Vec2<usize>| {
            let [r, g, b, a] = film.pixels.get(at.1 * width + at.0).copied().unwrap_or_default();
            (r, g, b, a)
        });
        let [x, y] = self.window.at.map(|n| n as i32);
        let mut attributes = LayerAttributes { layer_position: Vec2(x, y), ..LayerAttributes::default() };
        attributes.other.insert(NAME.into(), AttributeValue::Text(self.to_string().as_str().into()));
        let layer = Layer::new((width, height), attributes, Encoding::default(), channels);
        let mut image = exr::prelude::Image::from_layer(layer);
        let whole = self.whole.map(|n| n as usize);
        image.attributes.display_window = IntegerBounds::new((0, 0), (whole[0], whole[1]));
        let mut out = Cursor::new(Vec::new());
        image.write().to_buffered(&mut out).map_err(std::io::Error::other)?;
        Ok(out.into_inner())
    }
}

/// A tile's pixels in the form in which its file stores them.
enum Pixels {
    Rgb8(Vec<u8>),
    Linear(Vec<[f32; 4]>),
}

/// Read a tile.
///
/// # Errors
/// `Input` where the file is broken or no tile, or has not the size that it says; else as [`image_io::read`].
fn read(path: &Path) -> Result<(Tile, Pixels)> {
    let (text, size, pixels) = if extension(path) == "exr" {
        let mut found = image_io::read_planes(path)?;
        let planes = ["R", "G", "B", "A"].map(|name| found.planes.remove(name));
        let [Some(r), Some(g), Some(b), Some(a)] = planes else {
            return Err(Error::input(path, "", "is no tile: an EXR file without the channels R, G, B and A"));
        };
        let pixels = (0..r.len()).map(|i| [r[i], g[i], b[i], a[i]]).collect();
        (found.texts.remove(NAME), [found.width, found.height].map(|n| n as u32), Pixels::Linear(pixels))
    } else {
        let found = image_io::read_rgb8(path, NAME)?;
        (found.text, found.size, Pixels::Rgb8(found.rgb))
    };
    let text = text.ok_or_else(|| {
        Error::input(path, "", "is no tile: it does not say where it belongs; `vtex render --tile` writes tiles")
    })?;
    let tile = Tile::parse(&text).filter(|tile| tile.window.size == size);
    let tile = tile.ok_or_else(|| Error::input(path, "", format!("is no tile: {NAME} is {text:?}")))?;
    Ok((tile, pixels))
}

/// Assemble a picture from its tiles; the file has the same bytes as if the picture had been rendered whole. All files must have the extension
/// of `output`. Returns the picture's width and height.
///
/// # Errors
/// `Options` where there are no tiles or the extensions differ; `Input` where a file is no tile, belongs to another picture than
/// the others, overlaps another or leaves a part of the picture empty; `Limit` where the picture is too large; `Io` where a file
/// cannot be read or written.
pub fn stitch(tiles: &[PathBuf], output: &Path) -> Result<[u32; 2]> {
    Film::check_name(output)?;
    if let Some(other) = tiles.iter().find(|tile| extension(tile) != extension(output)) {
        let what = format!("{}: is not of the kind of {}", other.display(), output.display());
        return Err(Error::Options(what));
    }
    let (mut placed, mut canvas): (Vec<(&Path, Tile)>, Option<Canvas>) = (Vec::new(), None);
    for path in tiles {
        let (tile, pixels) = read(path)?;
        check_fits(path, &tile, &placed)?;
        let canvas = match &mut canvas {
            Some(canvas) => canvas,
            None => canvas.insert(Canvas::new(tile.whole, &pixels)?),
        };
        canvas.paint(&tile.window, &pixels);
        placed.push((path, tile));
    }
    let (Some(canvas), Some((_, first))) = (canvas, placed.first()) else {
        return Err(Error::Options("there are no tiles".into()));
    };
    let windows: Vec<CropWindow> = placed.iter().map(|(_, tile)| tile.window).collect();
    if let Some([x, y]) = first_gap(&windows, first.whole) {
        let what =
            format!("pixel {x},{y} of {}×{} is in none of the {} tiles", first.whole[0], first.whole[1], tiles.len());
        return Err(Error::input(output, "", what));
    }
    canvas.save(output)?;
    Ok(first.whole)
}

/// Check that a tile belongs to the same picture as the tiles in `placed`, and overlaps none of them.
fn check_fits(path: &Path, tile: &Tile, placed: &[(&Path, Tile)]) -> Result<()> {
    let Some((first_path, first)) = placed.first() else { return Ok(()) };
    let wrong = |what: String| Err(Error::input(path, "", what));
    if tile.whole != first.whole {
        let ([w, h], [fw, fh]) = (tile.whole, first.whole);
        return wrong(format!("is of a picture of {w}×{h} pixels, {} of one of {fw}×{fh}", first_path.display()));
    }
    if tile.picture != first.picture {
        let what = "of another landscape, moment, choice of options or version of the program";
        return wrong(format!("is {what} than {}", first_path.display()));
    }
    match placed.iter().find(|(_, other)| other.window.overlaps(&tile.window)) {
        Some((other, _)) => wrong(format!("overlaps {}", other.display())),
        None => Ok(()),
    }
}

/// The first pixel, row by row, that is in none of the windows.
fn first_gap(windows: &[CropWindow], [width, height]: [u32; 2]) -> Option<[u32; 2]> {
    // The pixel above the first gap is outside of the picture, or the last row of a window.
    let rows: BTreeSet<u32> = windows.iter().map(|w| w.at[1] + w.size[1]).chain([0]).filter(|&y| y < height).collect();
    rows.into_iter().find_map(|y| {
        let crossing = windows.iter().filter(|w| (w.at[1]..w.at[1] + w.size[1]).contains(&y));
        let mut spans: Vec<[u32; 2]> = crossing.map(|w| [w.at[0], w.at[0] + w.size[0]]).collect();
        spans.sort_unstable();
        let mut end = 0;
        for [from, to] in spans {
            if from > end {
                break;
            }
            end = to.max(end);
        }
        (end < width).then_some([end, y])
    })
}

/// The picture while it is assembled.
struct Canvas {
    size: [u32; 2],
    pixels: Pixels,
}

impl Canvas {
    /// An empty canvas whose pixels have the same form as `like`.
    fn new(size: [u32; 2], like: &Pixels) -> Result<Canvas> {
        let count = u64::from(size[0]) * u64::from(size[1]);
        if count > image_io::MAX_PIXELS {
            let what = "the picture's pixels".to_owned();
            return Err(Error::Limit { what, needed: count, allowed: image_io::MAX_PIXELS });
        }
        let pixels = match like {
            Pixels::Rgb8(_) => Pixels::Rgb8(vec![0; 3 * count as usize]),
            Pixels::Linear(_) => Pixels::Linear(vec![[0.0; 4]; count as usize]),
        };
        Ok(Canvas { size, pixels })
    }

    fn paint(&mut self, window: &CropWindow, tile: &Pixels) {
        match (&mut self.pixels, tile) {
            (Pixels::Rgb8(to), Pixels::Rgb8(from)) => copy_rows(to, self.size[0], window, from, 3),
            (Pixels::Linear(to), Pixels::Linear(from)) => copy_rows(to, self.size[0], window, from, 1),
            // All tiles have one extension.
            _ => {}
        }
    }

    fn save(self, path: &Path) -> Result<()> {
        let [width, height] = self.size;
        match self.pixels {
            Pixels::Rgb8(rgb) => image_io::write_png(path, width as usize, height as usize, rgb.as_chunks().0),
            Pixels::Linear(pixels) => Film { width, height, pixels }.save(path),
        }
    }
}

/// Copy the rows of a tile into a picture that is `width` pixels wide, of `channels` values each.
fn copy_rows<T: Copy>(to: &mut [T], width: u32, window: &CropWindow, from: &[T], channels: usize) {
    let [x, y] = window.at.map(|n| n as usize);
    let columns = channels * window.size[0] as usize;
    for (row, values) in from.chunks_exact(columns).enumerate() {
        let start = channels * ((y + row) * width as usize + x);
        to[start..start + columns].copy_from_slice(values);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(x: u32, y: u32, w: u32, h: u32) -> CropWindow {
        CropWindow { at: [x, y], size: [w, h] }
    }

    /// A film whose pixels all differ, some brighter than white, some less than black.
    fn film([width, height]: [u32; 2]) -> Film {
        let pixel = |i: u32| [i as f32 * 0.01, 3.0 - i as f32 * 0.1, -0.0, (i % 3) as f32 * 0.5];
        Film { width, height, pixels: (0..width * height).map(pixel).collect() }
    }

    fn part(film: &Film, window: &CropWindow) -> Film {
        let ([x, y], [width, height]) = (window.at, window.size);
        let pixel = |i: u32| film.pixels[((y + i / width) * film.width + x + i % width) as usize];
        Film { width, height, pixels: (0..width * height).map(pixel).collect() }
    }

    /// Tiles of a film of 7×5 pixels, in files of their own.
    fn tiles(folder: &Path, windows: &[CropWindow], ending: &str) -> Vec<PathBuf> {
        let whole = film([7, 5]);
        let save = |window: &CropWindow| {
            let path = folder.join(format!("{window}.{ending}"));
            let tile = Tile { window: *window, whole: [7, 5], picture: "p".into() };
            tile.save(&part(&whole, window), &path).unwrap();
            path
        };
        windows.iter().map(save).collect()
    }

    /// Three tiles that no grid has: two beside each other, and one below both.
    const WHOLE: [CropWindow; 3] = [
        CropWindow { at: [4, 0], size: [3, 2] },
        CropWindow { at: [0, 2], size: [7, 3] },
        CropWindow { at: [0, 0], size: [4, 2] },
    ];

    #[test]
    fn tiles_make_the_bytes_of_the_whole() {
        let dir = tempfile::tempdir().unwrap();
        for ending in ["png", "exr"] {
            let [whole, stitched] = ["whole", "stitched"].map(|name| dir.path().join(format!("{name}.{ending}")));
            film([7, 5]).save(&whole).unwrap();
            assert_eq!(stitch(&tiles(dir.path(), &WHOLE, ending), &stitched).unwrap(), [7, 5]);
            assert!(std::fs::read(&whole).unwrap() == std::fs::read(&stitched).unwrap(), "{ending}");
        }
    }

    #[test]
    fn tiles_that_do_not_fit_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let refused = |tiles: &[PathBuf]| stitch(tiles, &dir.path().join("out.png")).unwrap_err().to_string();
        let all = tiles(dir.path(), &WHOLE, "png");
        assert!(refused(&[]).contains("there are no tiles"));
        assert!(refused(&all[..2]).ends_with("out.png: pixel 0,0 of 7×5 is in none of the 2 tiles"));
        assert!(refused(&all[1..]).contains("pixel 4,0 of"));
        let over = tiles(dir.path(), &[window(3, 1, 2, 1)], "png");
        let line = refused(&[all.clone(), over].concat());
        assert!(line.contains("3,1,2,1.png: overlaps ") && line.ends_with("4,0,3,2.png"), "{line}");
        assert!(refused(&[all.clone(), all[..1].to_vec()].concat()).contains("overlaps"), "given twice");
        let exr = tiles(dir.path(), &WHOLE[..1], "exr");
        assert!(refused(&exr).contains("is not of the kind of"));

        let other = dir.path().join("other.png");
        let mut tile = Tile { window: window(0, 0, 4, 2), whole: [7, 5], picture: "q".into() };
        let film = film([4, 2]);
        tile.save(&film, &other).unwrap();
        assert!(refused(&[all[0].clone(), other.clone()]).contains("is of another landscape"));
        tile.whole = [8, 5];
        tile.save(&film, &other).unwrap();
        assert!(refused(&[all[0].clone(), other.clone()]).contains("is of a picture of 8×5 pixels"));
        film.save(&other).unwrap();
        assert!(refused(std::slice::from_ref(&other)).contains("is no tile"));
        assert!(!dir.path().join("out.png").exists());
        tile.window.size = [3, 2];
        assert!(tile.save(&film, &other).is_err());
    }

    #[test]
    fn texts_of_tiles() {
        let tile = Tile { window: window(4, 0, 3, 2), whole: [7, 5], picture: "ab12".into() };
        assert_eq!(tile.to_string(), "4,0,3,2 of 7x5 in ab12");
        assert_eq!(Tile::parse(&tile.to_string()), Some(tile));
        for wrong in
            ["", "4,0,3,2 of 6x5 in a", "4,0,3,2 of 7x5", "0,0,0,1 of 7x5 in a", "4294967295,0,2,1 of 7x5 in a"]
        {
            assert_eq!(Tile::parse(wrong), None, "{wrong}");
        }
    }

    /// Against every pixel looked at.
    #[test]
    fn gaps_are_found() {
        let mut random = crate::random::SplitMix64::new(7);
        let mut with_gap = 0;
        for _ in 0..2000 {
            let size = [6, 5];
            let mut draw = |n: u32| (random.bits() % u64::from(n)) as u32;
            let windows: Vec<CropWindow> = (0..1 + draw(6))
                .map(|_| {
                    let at = [draw(6), draw(5)];
                    window(at[0], at[1], 1 + draw(6 - at[0]), 1 + draw(5 - at[1]))
                })
                .collect();
            let pixels = (0..5).flat_map(|y| (0..6).map(move |x| [x, y]));
            let mut empty = pixels.filter(|&[x, y]| !windows.iter().any(|w| w.overlaps(&window(x, y, 1, 1))));
            let found = first_gap(&windows, size);
            assert_eq!(found, empty.next(), "{windows:?}");
            with_gap += u32::from(found.is_some());
        }
        assert!((100..2000).contains(&with_gap), "{with_gap}");
    }
}

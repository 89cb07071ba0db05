//! Rasters: pictures whose pixels are numbers, as density maps and height maps, with the georeference of a GeoTIFF.
//!
//! Based on: OGC 19-008r4, *GeoTIFF Standard*, 2019 (pixel scale, tie point, keys of units).

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageFormat};
use tiff::ColorType;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

use super::image::decoder;
use super::{files, tiff_file};
use crate::{Error, Result};

/// One channel of a picture, row 0 at the top.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Raster {
    /// Number of columns, at least 1.
    pub width: usize,
    /// Number of rows, at least 1.
    pub height: usize,
    /// The stored numbers, row by row; NaN where the file marks a pixel as without data.
    pub values: Vec<f32>,
    /// The largest code of unsigned integers, which is white; `None` for signed numbers and floats.
    pub white: Option<f32>,
    /// Whether the numbers are heights in a unit (TIFF), and not mere shades of grey (PNG).
    pub measured: bool,
    /// Georeference of a GeoTIFF.
    pub place: Option<GeoPlace>,
}

/// Place of a GeoTIFF in a projected coordinate system, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeoPlace {
    /// Width and height of a pixel.
    pub pixel: [f64; 2],
    /// East and north of the outer corner of the first pixel of the first row.
    pub corner: [f64; 2],
    /// Metres in a unit of the heights.
    pub height_unit: f64,
}

/// Most pixels of a raster.
const MAX_PIXELS: u64 = 1 << 26;
/// Largest ratio of pixels to bytes of a file, which no compression of real pictures exceeds.
const MAX_RATIO: u64 = 8 * 1032;
/// Bytes that a TIFF may take as it is decoded: pixels of four channels of 64 bits, and some more.
const MAX_DECODED: u64 = 1 << 32;

impl Raster {
    /// Read a PNG (8 or 16 bits; colours become their luma) or a TIFF (8 to 64 bits, whole or floating; its first channel).
    ///
    /// # Errors
    /// `Io`, `Input` where the file is neither or is broken, `Limit` beyond 2^26 pixels.
    pub fn open(path: &Path) -> Result<Raster> {
        let bytes = files::read(path, 4 << 30)?;
        match bytes.get(..4) {
            Some(b"\x89PNG") => png(path, &bytes),
            Some(b"II*\0" | b"MM\0*" | b"II+\0" | b"MM\0+") => Tiff::new(path, &bytes)?.read(),
            _ => Err(Error::input(path, "", "is neither a PNG nor a TIFF; convert the picture to one of them")),
        }
    }

    /// The value of a pixel; NaN outside of the raster.
    pub fn get(&self, x: usize, y: usize) -> f32 {
        if x < self.width { self.values.get(y * self.width + x).copied().unwrap_or(f32::NAN) } else { f32::NAN }
    }

    /// The raster with its values divided by white, in [0, 1].
    ///
    /// # Errors
    /// `Input` where a value is NaN or not in [0, 1].
    pub fn into_shares(mut self, path: &Path) -> Result<Raster> {
        let white = self.white.unwrap_or(1.0);
        for (i, v) in self.values.iter_mut().enumerate() {
            let share = *v / white;
            if !(0.0..=1.0).contains(&share) {
                let (x, y) = (i % self.width, i / self.width);
                let is = if share.is_nan() { "no number".to_owned() } else { format!("{share:.4}") };
                let what = format!("is {is}; the numbers of a mask lie in 0 … 1");
                return Err(Error::input(path, format!("column {}, row {}", x + 1, y + 1), what));
            }
            *v = share;
        }
        self.white = Some(1.0);
        Ok(self)
    }

    /// Value at (s, t), in [0, 1] from the upper left corner, bilinear between the middles of pixels. Beyond [0, 1] the picture `repeats`, or else
    /// its border pixels continue.
    pub fn sample(&self, s: f64, t: f64, repeats: bool) -> f64 {
        let along = |x: f64, n: usize| -> ([usize; 2], f64) {
            let x = if repeats { x - x.floor() } else { x.clamp(0.0, 1.0) };
            let x = if x.is_finite() { x * n as f64 - 0.5 } else { 0.0 };
            let low = x.floor();
            let at = |i: f64| {
                let i = i as i64;
                if repeats { i.rem_euclid(n as i64) as usize } else { i.clamp(0, n as i64 - 1) as usize }
            };
            ([at(low), at(low + 1.0)], x - low)
        };
        let (([x0, x1], fx), ([y0, y1], fy)) = (along(s, self.width), along(t, self.height));
        let v = |x, y| f64::from(self.get(x, y));
        let (a, b) = (v(x0, y0) + fx * (v(x1, y0) - v(x0, y0)), v(x0, y1) + fx * (v(x1, y1) - v(x0, y1)));
        a + fy * (b - a)
    }
}

/// The size that a header claims, of a file of `stored` bytes.
fn check_size(path: &Path, width: u64, height: u64, stored: u64) -> Result<()> {
    let needed = width.saturating_mul(height);
    if needed == 0 {
        return Err(Error::input(path, "", "has no pixels"));
    }
    if needed > MAX_PIXELS {
        let what = format!("{}: the pixels of a mask or a ground (resample it to fewer)", path.display());
        return Err(Error::Limit { what, needed, allowed: MAX_PIXELS });
    }
    if needed / MAX_RATIO > stored {
        return Err(Error::input(path, "", format!("{stored} bytes cannot hold {width}×{height} pixels")));
    }
    Ok(())
}

fn png(path: &Path, bytes: &[u8]) -> Result<Raster> {
    let broken = |e: image::ImageError| Error::input(path, "", format!("cannot be read as a PNG: {e}"));
    let decoder = decoder(bytes, ImageFormat::Png).map_err(broken)?;
    let (width, height) = decoder.dimensions();
    check_size(path, width.into(), height.into(), bytes.len() as u64)?;
    let grey = DynamicImage::from_decoder(decoder).map_err(broken)?.into_luma16();
    Ok(Raster {
        width: width as usize,
        height: height as usize,
        values: grey.into_raw().into_iter().map(f32::from).collect(),
        white: Some(65535.0),
        measured: false,
        place: None,
    })
}

struct Tiff<'a> {
    path: &'a Path,
    decoder: Decoder<Cursor<&'a [u8]>>,
    /// Bytes of the file.
    bytes: u64,
}

impl<'a> Tiff<'a> {
    fn new(path: &'a Path, bytes: &'a [u8]) -> Result<Tiff<'a>> {
        let decoder = tiff_file::open(path, bytes, MAX_DECODED, |_, e| broken(path, e))?;
        Ok(Tiff { path, decoder, bytes: bytes.len() as u64 })
    }

    fn read(mut self) -> Result<Raster> {
        let path = self.path;
        let (width, height) = self.decoder.dimensions().map_err(|e| broken(path, e))?;
        check_size(path, width.into(), height.into(), self.bytes)?;
        if matches!(self.decoder.colortype().map_err(|e| broken(path, e))?, ColorType::Palette(_)) {
            return Err(Error::unsupported(path, "a TIFF of palette colours as a mask or a ground"));
        }
        let place = self.place()?;
        let no_data = self.decoder.get_tag_ascii_string(Tag::GdalNodata).ok();
        let no_data: Option<f64> = no_data.and_then(|t| t.trim_end_matches('\0').trim().parse().ok());
        let image = self.decoder.read_image().map_err(|e| broken(path, e))?;
        let (mut values, white) = numbers(image);
        let pixels = width as usize * height as usize;
        let samples = values.len() / pixels;
        if samples > 1 {
            values = values.into_iter().step_by(samples).collect();
        }
        values.truncate(pixels);
        if values.len() < pixels {
            return Err(Error::input(path, "", "has fewer numbers than pixels"));
        }
        if self.decoder.find_tag_unsigned::<u16>(Tag::PhotometricInterpretation).ok().flatten() == Some(0) {
            // The decoder inverts values of pictures whose white is 0. That is a matter of display, so the inversion is undone.
            values.iter_mut().for_each(|v| *v = white.unwrap_or(1.0) - *v);
        }
        if let Some(no_data) = no_data {
            values.iter_mut().filter(|v| **v == no_data as f32).for_each(|v| *v = f32::NAN);
        }
        Ok(Raster { width: width as usize, height: height as usize, values, white, measured: true, place })
    }

    fn tag<T>(&mut self, tag: Tag, as_list: fn(tiff::decoder::ifd::Value) -> tiff::TiffResult<Vec<T>>) -> Vec<T> {
        self.decoder.find_tag(tag).ok().flatten().and_then(|v| as_list(v).ok()).unwrap_or_default()
    }

    /// Scale and tie point, in metres; `None` where the file has no scale.
    fn place(&mut self) -> Result<Option<GeoPlace>> {
        use tiff::decoder::ifd::Value;
        let scale: Vec<f64> = self.tag(Tag::ModelPixelScaleTag, Value::into_f64_vec);
        let tie: Vec<f64> = self.tag(Tag::ModelTiepointTag, Value::into_f64_vec);
        let keys: Vec<u16> = self.tag(Tag::GeoKeyDirectoryTag, Value::into_u16_vec);
        let [x, y, ..] = scale[..] else { return Ok(None) };
        if !(x > 0.0 && y > 0.0 && x.is_finite() && y.is_finite()) {
            return Err(Error::input(self.path, "ModelPixelScale", "is not above 0"));
        }
        let key = |id: u16| {
            let entries = keys.get(4..).unwrap_or_default().as_chunks::<4>().0;
            entries.iter().find(|e| e[0] == id && e[1] == 0).map(|e| e[3])
        };
        const MODEL_TYPE: u16 = 1024;
        const PROJECTED_UNIT: u16 = 3076;
        const VERTICAL_UNIT: u16 = 4099;
        const GEOGRAPHIC: u16 = 2;
        if key(MODEL_TYPE) == Some(GEOGRAPHIC) {
            let what = "a GeoTIFF in degrees (project it to metres first, as by `gdalwarp -t_srs` to UTM)";
            return Err(Error::unsupported(self.path, what));
        }
        let metres = |unit: Option<u16>| match unit {
            None | Some(0 | 9001 | 32767) => Ok(1.0),
            Some(9002) => Ok(0.3048),
            Some(9003) => Ok(1200.0 / 3937.0),
            Some(9036) => Ok(1000.0),
            Some(code) => Err(Error::unsupported(self.path, format!("a GeoTIFF in units of EPSG code {code}"))),
        };
        let unit = metres(key(PROJECTED_UNIT))?;
        let [i, j, _, east, north] = std::array::from_fn(|k| tie.get(k).copied().unwrap_or(0.0));
        let corner = [(east - i * x) * unit, (north + j * y) * unit];
        Ok(Some(GeoPlace { pixel: [x * unit, y * unit], corner, height_unit: metres(key(VERTICAL_UNIT))? }))
    }
}

fn broken(path: &Path, e: tiff::TiffError) -> Error {
    match e {
        tiff::TiffError::UnsupportedError(e) => Error::unsupported(path, e.to_string()),
        e => Error::input(path, "", format!("cannot be read as a TIFF: {e}")),
    }
}

/// The values of all samples, and the largest code of unsigned integers.
fn numbers(image: DecodingResult) -> (Vec<f32>, Option<f32>) {
    fn wide<T: Copy>(v: &[T], as_f64: impl Fn(T) -> f64) -> Vec<f32> {
        v.iter().map(|&x| as_f64(x) as f32).collect()
    }
    match image {
        DecodingResult::U8(v) => (wide(&v, f64::from), Some(255.0)),
        DecodingResult::U16(v) => (wide(&v, f64::from), Some(65535.0)),
        DecodingResult::U32(v) => (wide(&v, f64::from), Some(u32::MAX as f32)),
        DecodingResult::U64(v) => (wide(&v, |x| x as f64), Some(u64::MAX as f32)),
        DecodingResult::I8(v) => (wide(&v, f64::from), None),
        DecodingResult::I16(v) => (wide(&v, f64::from), None),
        DecodingResult::I32(v) => (wide(&v, f64::from), None),
        DecodingResult::I64(v) => (wide(&v, |x| x as f64), None),
        DecodingResult::F32(v) => (v, None),
        DecodingResult::F64(v) => (wide(&v, |x| x), None),
        DecodingResult::F16(v) => (wide(&v, |x| x.to_f64()), None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tiff::encoder::{TiffEncoder, colortype};

    fn geotiff(path: &Path, model: u16, unit: u16) {
        let mut file = std::fs::File::create(path).unwrap();
        let mut encoder = TiffEncoder::new(&mut file).unwrap();
        let mut image = encoder.new_image::<colortype::Gray32Float>(3, 2).unwrap();
        let tags = image.encoder();
        tags.write_tag(Tag::ModelPixelScaleTag, &[2.0f64, 3.0, 0.0][..]).unwrap();
        tags.write_tag(Tag::ModelTiepointTag, &[1.0f64, 0.0, 0.0, 500.0, 900.0, 0.0][..]).unwrap();
        let keys = [1u16, 1, 0, 2, 1024, 0, 1, model, 3076, 0, 1, unit];
        tags.write_tag(Tag::GeoKeyDirectoryTag, &keys[..]).unwrap();
        tags.write_tag(Tag::GdalNodata, "-9999").unwrap();
        image.write_data(&[1.0f32, 2.0, -9999.0, 4.0, 5.5, 6.0]).unwrap();
    }

    #[test]
    fn a_geotiff_lies_where_its_tags_say() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("g.tif");
        geotiff(&path, 1, 9001);
        let raster = Raster::open(&path).unwrap();
        // The tie point is the corner of column 1: the picture begins one pixel to the west.
        let place = GeoPlace { pixel: [2.0, 3.0], corner: [498.0, 900.0], height_unit: 1.0 };
        assert_eq!((raster.width, raster.height, raster.place), (3, 2, Some(place)));
        assert!(raster.get(2, 0).is_nan() && raster.get(1, 1) == 5.5 && raster.get(3, 0).is_nan());
        assert!(raster.measured && raster.white.is_none());
        let error = raster.into_shares(&path).unwrap_err().to_string();
        assert!(error.contains("column 2, row 1: is 2.0000"), "{error}");
        geotiff(&path, 1, 9002);
        assert_eq!(Raster::open(&path).unwrap().place.unwrap().pixel, [2.0 * 0.3048, 3.0 * 0.3048]);
        geotiff(&path, 2, 9001);
        assert!(Raster::open(&path).unwrap_err().to_string().contains("degrees"));
        geotiff(&path, 1, 9035);
        assert!(Raster::open(&path).unwrap_err().to_string().contains("9035"));
    }

    #[test]
    fn numbers_are_as_stored() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("w.tif");
        // A TIFF of one row of two numbers, by hand: bits per sample, format of samples, photometric interpretation.
        let save = |bits: u32, format: u32, photometric: u32, data: [u8; 4]| {
            let entries =
                [(256u16, 2u32), (257, 1), (258, bits), (262, photometric), (273, 8), (279, bits / 4), (339, format)];
            let mut file = b"II*\0\x0c\0\0\0".to_vec();
            file.extend(data);
            file.extend((entries.len() as u16).to_le_bytes());
            for (tag, value) in entries {
                file.extend(tag.to_le_bytes());
                file.extend([4, 0, 1, 0, 0, 0]);
                file.extend(value.to_le_bytes());
            }
            file.extend([0; 4]);
            std::fs::write(&path, file).unwrap();
            Raster::open(&path).unwrap().values
        };
        for photometric in [0, 1] {
            // Grey of 8 and 16 bits; a stored 0 is a height of 0 whatever colour a viewer gives it.
            assert_eq!(save(8, 1, photometric, [0, 250, 0, 0]), [0.0, 250.0]);
            assert_eq!(save(16, 1, photometric, [0, 0, 0xe8, 3]), [0.0, 1000.0]);
        }
        // Floats of 16 bits.
        assert_eq!(save(16, 3, 1, [0, 0x3c, 0, 0x58]), [1.0, 128.0]);
    }

    #[test]
    fn shares_are_bilinear_between_the_middles() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.png");
        image::ImageBuffer::<image::Luma<u16>, _>::from_raw(2, 1, vec![0u16, 65535]).unwrap().save(&path).unwrap();
        let raster = Raster::open(&path).unwrap().into_shares(&path).unwrap();
        assert_eq!([0.0, 0.25, 0.5, 0.75, 1.0].map(|s| raster.sample(s, 0.5, false)), [0.0, 0.0, 0.5, 1.0, 1.0]);
        // Beyond the middle of the last pixel the first one follows.
        assert_eq!([0.0, 1.0, -0.25].map(|s| raster.sample(s, 7.5, true)), [0.5, 0.5, 1.0]);
        assert!(raster.sample(f64::NAN, f64::INFINITY, true).is_finite());
    }

    #[test]
    fn broken_bytes_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("g.tif");
        geotiff(&path, 1, 9001);
        let whole = std::fs::read(&path).unwrap();
        for cut in 0..whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            assert!(Raster::open(&path).is_err(), "{cut}");
        }
    }
}

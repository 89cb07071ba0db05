//! NIfTI-1 and -2 (.nii, .nii.gz, .hdr with .img), and the ANALYZE header they grew out of.
//!
//! Based on: R. W. Cox et al., *A (sort of) new image data format standard: NIfTI-1*, 2004; the NIfTI-2 header, 2011.

use std::path::{Path, PathBuf};

use byteorder::{BigEndian, ByteOrder, LittleEndian};

use super::bytes::map_file;
use super::choice::{Choice, OuterAxes};
use super::coding::{Coding, Kind};
use super::data::{Data, Packing, binary_header};
use super::{Channels, Stack};

use crate::geom::{DAffine3, DMat3, DVec3};
use crate::{Error, Result, Warnings};

/// What the magic number says of the file.
#[derive(PartialEq, Eq)]
enum Form {
    /// Header and samples in one.
    Whole,
    /// The header of a pair.
    Pair,
    /// The header of a pair, as it was before NIfTI.
    Analyze,
}

/// A header's bytes in its byte order, and where its fields are: NIfTI-2 has wider ones in other places.
struct Header {
    bytes: Vec<u8>,
    big: bool,
    two: bool,
    form: Form,
}

impl Header {
    /// Bytes of the longest one.
    const MOST: usize = 544;

    /// The header that a file begins with, of either version in either byte order.
    fn parse(bytes: Vec<u8>) -> Result<Header, String> {
        let first = bytes.get(..4);
        let (big, two) = match (first.map(LittleEndian::read_i32), first.map(BigEndian::read_i32)) {
            (Some(348), _) => (false, false),
            (_, Some(348)) => (true, false),
            (Some(540), _) => (false, true),
            (_, Some(540)) => (true, true),
            _ => return Err("not a NIfTI file: it does not begin with the length of a header, 348 or 540".into()),
        };
        if bytes.len() < if two { 540 } else { 348 } {
            return Err("its header is cut short".into());
        }
        let magic = if two { &bytes[4..8] } else { &bytes[344..348] };
        let form = match magic {
            b"n+1\0" | b"n+2\0" => Form::Whole,
            b"ni1\0" | b"ni2\0" => Form::Pair,
            _ if two => return Err("not a NIfTI-2 file: its magic number is wrong".into()),
            _ => Form::Analyze,
        };
        Ok(Header { bytes, big, two, form })
    }

    /// A field in the header's byte order, by `little` or `big`; 0 beyond the header's end.
    fn field<T: Default>(&self, at: usize, little: fn(&[u8]) -> T, big: fn(&[u8]) -> T) -> T {
        let there = self.bytes.get(at..at + size_of::<T>());
        there.map_or_else(T::default, if self.big { big } else { little })
    }

    fn i16(&self, at: usize) -> i16 {
        self.field(at, LittleEndian::read_i16, BigEndian::read_i16)
    }

    fn i32(&self, at: usize) -> i32 {
        self.field(at, LittleEndian::read_i32, BigEndian::read_i32)
    }

    fn i64(&self, at: usize) -> i64 {
        self.field(at, LittleEndian::read_i64, BigEndian::read_i64)
    }

    fn f32(&self, at: usize) -> f32 {
        self.field(at, LittleEndian::read_f32, BigEndian::read_f32)
    }

    fn f64(&self, at: usize) -> f64 {
        self.field(at, LittleEndian::read_f64, BigEndian::read_f64)
    }

    /// A field by its places in the two versions, where it is a float.
    fn float(&self, one: usize, two: usize) -> f64 {
        if self.two { self.f64(two) } else { f64::from(self.f32(one)) }
    }

    fn code(&self, one: usize, two: usize) -> i32 {
        if self.two { self.i32(two) } else { i32::from(self.i16(one)) }
    }

    fn dim(&self, n: usize) -> i64 {
        if self.two { self.i64(16 + 8 * n) } else { i64::from(self.i16(40 + 2 * n)) }
    }

    /// Number of samples along each of the seven axes; 0 where it cannot be one.
    fn sizes(&self) -> Result<[usize; 7], String> {
        let rank = self.dim(0);
        if !(1..=7).contains(&rank) {
            return Err(format!("{rank} dimensions; 1 to 7 are possible"));
        }
        let size = |n: usize| if n as i64 <= rank { self.dim(n) } else { 1 };
        Ok([1, 2, 3, 4, 5, 6, 7].map(|n| usize::try_from(size(n)).unwrap_or(0)))
    }

    /// Type of the numbers, and how many there are per sample.
    fn kind(&self) -> Result<(Kind, usize), String> {
        kind(i32::from(self.i16(if self.two { 12 } else { 70 })))
    }

    fn metres_per_unit(&self) -> f64 {
        let units = if self.two { self.i32(500) } else { i32::from(self.bytes[123]) };
        match units & 7 {
            1 => 1.0,
            3 => 1e-6,
            _ => 1e-3,
        }
    }

    /// Bytes before the samples.
    fn offset(&self) -> Result<u64, String> {
        let offset = match () {
            () if self.form == Form::Analyze => 0.0,
            () if self.two => self.i64(168) as f64,
            () => f64::from(self.f32(108)),
        };
        if (0.0..1e15).contains(&offset) { Ok(offset as u64) } else { Err("its samples begin nowhere".into()) }
    }

    /// Slope and intercept that take samples to values, where there are any.
    fn rescale(&self) -> Option<(f64, f64)> {
        let (slope, intercept) = (self.float(112, 176), self.float(116, 184));
        let is_given = self.form != Form::Analyze && slope != 0.0 && slope.is_finite() && intercept.is_finite();
        is_given.then_some((slope, intercept))
    }

    /// Distance of samples along an axis, or what else the header keeps in that list.
    fn pixdim(&self, n: usize) -> f64 {
        self.float(76 + 4 * n, 104 + 8 * n)
    }

    /// Index → space, by the first of three ways that the header uses.
    fn affine(&self, warnings: &mut Warnings) -> DAffine3 {
        let along_axes = || DAffine3::from_scale(DVec3::from([1, 2, 3].map(|n| self.pixdim(n).abs())));
        if self.form == Form::Analyze {
            warnings.add("an ANALYZE header does not say how the stack lies; along the axes");
            along_axes()
        } else if self.code(254, 348) > 0 {
            self.sform()
        } else if self.code(252, 344) > 0 {
            self.qform()
        } else {
            along_axes()
        }
    }

    fn sform(&self) -> DAffine3 {
        let row =
            |r: usize| -> [f64; 4] { std::array::from_fn(|c| self.float(280 + 16 * r + 4 * c, 400 + 32 * r + 8 * c)) };
        let [x, y, z] = [row(0), row(1), row(2)];
        let column = |c: usize| DVec3::new(x[c], y[c], z[c]);
        DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
    }

    fn qform(&self) -> DAffine3 {
        let q = |n: usize| self.float(256 + 4 * n, 352 + 8 * n);
        let (b, c, d) = (q(0), q(1), q(2));
        // Past the unit sphere by rounding alone: a half turn.
        let a = (1.0 - (b * b + c * c + d * d)).max(0.0).sqrt();
        let handed = if self.pixdim(0) < 0.0 { -1.0 } else { 1.0 };
        let rotation = DMat3::from_cols(
            DVec3::new(a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c)),
            DVec3::new(2.0 * (b * c - a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d + a * b)),
            DVec3::new(2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a + d * d - b * b - c * c),
        );
        let scale = DVec3::new(self.pixdim(1).abs(), self.pixdim(2).abs(), handed * self.pixdim(3).abs());
        DAffine3 { matrix3: rotation * DMat3::from_diagonal(scale), translation: DVec3::new(q(3), q(4), q(5)) }
    }
}

/// Type of the numbers of this code, and how many there are per sample.
fn kind(code: i32) -> Result<(Kind, usize), String> {
    Ok(match code {
        2 => (Kind::U8, 1),
        4 => (Kind::I16, 1),
        8 => (Kind::I32, 1),
        16 => (Kind::F32, 1),
        64 => (Kind::F64, 1),
        128 => (Kind::U8, 3),
        256 => (Kind::I8, 1),
        512 => (Kind::U16, 1),
        768 => (Kind::U32, 1),
        1024 => (Kind::I64, 1),
        1280 => (Kind::U64, 1),
        2304 => (Kind::U8, 4),
        1 => return Err("NIfTI of single bits (data type 1)".into()),
        32 | 1792 | 2048 => return Err(format!("NIfTI of complex numbers (data type {code})")),
        1536 => return Err("NIfTI of 128-bit floats (data type 1536)".into()),
        other => return Err(format!("NIfTI of data type {other}")),
    })
}

/// The other file of a pair, where there is one: with the ending `.hdr` or `.img`, packed or not.
fn partner(path: &Path, ending: &str) -> Option<PathBuf> {
    let bare = |p: &Path| {
        if p.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz")) { p.with_extension("") } else { p.into() }
    };
    let stem = bare(path).with_extension("");
    let endings =
        [ending.to_owned(), format!("{ending}.gz"), ending.to_uppercase(), format!("{}.GZ", ending.to_uppercase())];
    endings.iter().map(|e| PathBuf::from(format!("{}.{e}", stem.display()))).find(|p| p.is_file())
}

/// The files that `path` stands for: header and samples; the same where both are in one.
pub fn files(path: &Path) -> (PathBuf, PathBuf) {
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default().to_ascii_lowercase();
    let ends = |e: &str| name.ends_with(e) || name.ends_with(&format!("{e}.gz"));
    let whole = path.to_path_buf();
    if ends(".img") {
        (partner(path, "hdr").unwrap_or_else(|| whole.clone()), whole)
    } else if ends(".hdr") {
        (whole.clone(), partner(path, "img").unwrap_or(whole))
    } else {
        (whole.clone(), whole)
    }
}

/// Read the stack `path`, a header or its samples.
pub fn read(choice: &Choice, in_memory: u64) -> Result<Stack> {
    let (header_path, data_path) = files(choice.path);
    let wrong = |what: String| Error::input(&header_path, "", what);
    let (bytes, header_packing) = binary_header(&header_path, Header::MOST)?;
    let header = Header::parse(bytes).map_err(wrong)?;
    if header.form != Form::Whole && header_path == data_path {
        let need = if header_packing == Packing::Raw { ".img" } else { ".img or .img.gz" };
        return Err(wrong(format!("a header without samples: put the {need} file of the same name beside it")));
    }
    let mut warnings = Warnings::default();
    let [x, y, z, outer @ ..] = header.sizes().map_err(wrong)?;
    // The fourth axis is time, the fifth the components of a vector; what is beyond counts as time.
    let axes = outer.iter().enumerate().map(|(n, size)| (*size.max(&1), n == 1));
    let volume = OuterAxes { axes: axes.collect() }.choose(choice, &mut warnings)?;
    let (kind, channels) = header.kind().map_err(|what| Error::unsupported(&header_path, what))?;
    let affine = super::with_thickness(header.affine(&mut warnings), [x, y, z]);
    let offset = header.offset().map_err(wrong)?;
    let packing = Packing::of_whole(&map_file(&data_path)?);
    let (skip, skip_unpacked) = packing.skips_of_whole(offset);
    let data = Data {
        header: &header_path,
        files: vec![data_path.clone()],
        skip,
        skip_unpacked,
        packing,
        coding: Coding { kind, big_endian: header.big, channels },
        dims: [x, y, z],
        volume,
    };
    let mut samples = data.load(in_memory)?;
    if let Some(rescale) = header.rescale().filter(|_| channels == 1) {
        samples.rescale = rescale;
    }
    let mut stack = Stack::new(&header_path, samples, affine, header.metres_per_unit(), warnings)?;
    let [_, components, ..] = outer;
    if components > 1 {
        stack.channels = Channels::Chosen;
    }
    Ok(stack)
}

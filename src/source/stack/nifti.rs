//! NIfTI-1 and -2 (.nii, .nii.gz, .hdr with .img), and the ANALYZE header they grew out of.
//!
//! Based on: R. W. Cox et al., *A (sort of) new image data format standard: NIfTI-1*, 2004; the NIfTI-2 header, 2011.

use std::io::Read;
use std::path::{Path, PathBuf};

use byteorder::{BigEndian, ByteOrder, LittleEndian};

use super::bytes::map_file;
use super::choice::{Choice, OuterAxes};
use super::coding::{Coding, Kind};
use super::data::{Data, Packing, inflate};
use super::{Channels, Stack};

use crate::geom::{DAffine3, DMat3, DVec3};
use crate::{Error, Result, Warnings};

/// A header's bytes in its byte order, and where its fields are: NIfTI-2 has wider ones in other places.
struct Header {
    bytes: Vec<u8>,
    big: bool,
    two: bool,
}

impl Header {
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

    /// Distance of samples along an axis, or what else the header keeps in that list.
    fn pixdim(&self, n: usize) -> f64 {
        self.float(76 + 4 * n, 104 + 8 * n)
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
    let wrong = |what: &str| Error::input(&header_path, "", what);
    let map = map_file(&header_path)?;
    let packed = map.starts_with(&[0x1f, 0x8b]);
    let mut bytes = Vec::new();
    if packed {
        let cut = |e| Error::input(&header_path, "", format!("its packed header is broken: {e}"));
        inflate(&map).take(544).read_to_end(&mut bytes).map_err(cut)?;
    } else {
        bytes.extend_from_slice(&map[..map.len().min(544)]);
    }
    let first = bytes.get(..4);
    let (big, two) = match (first.map(LittleEndian::read_i32), first.map(BigEndian::read_i32)) {
        (Some(348), _) => (false, false),
        (_, Some(348)) => (true, false),
        (Some(540), _) => (false, true),
        (_, Some(540)) => (true, true),
        _ => return Err(wrong("not a NIfTI file: it does not begin with the length of a header, 348 or 540")),
    };
    if bytes.len() < if two { 540 } else { 348 } {
        return Err(wrong("its header is cut short"));
    }
    let h = Header { bytes, big, two };
    let magic = if two { &h.bytes[4..8] } else { &h.bytes[344..348] };
    let (attached, analyze) = match magic {
        b"n+1\0" | b"n+2\0" => (true, false),
        b"ni1\0" | b"ni2\0" => (false, false),
        _ if two => return Err(wrong("not a NIfTI-2 file: its magic number is wrong")),
        _ => (false, true),
    };
    if !attached && header_path == data_path {
        let need = if packed { ".img or .img.gz" } else { ".img" };
        return Err(wrong(&format!("a header without samples: put the {need} file of the same name beside it")));
    }
    let mut warnings = Warnings::default();
    let rank = h.dim(0);
    if !(1..=7).contains(&rank) {
        return Err(wrong(&format!("{rank} dimensions; 1 to 7 are possible")));
    }
    let dim = |n: usize| if n as i64 <= rank { h.dim(n) } else { 1 };
    let dims = [1, 2, 3].map(|n| usize::try_from(dim(n)).unwrap_or(0));
    // The fourth axis is time, the fifth the components of a vector; what is beyond counts as time.
    let axis = |n: usize| (usize::try_from(dim(n)).unwrap_or(1).max(1), n == 5);
    let outer = OuterAxes { axes: (4..=7).map(axis).collect() };
    let volume = outer.choose(choice, &mut warnings)?;
    let (kind, channels) =
        kind(i32::from(h.i16(if two { 12 } else { 70 }))).map_err(|what| Error::unsupported(&header_path, what))?;
    let units = if two { h.i32(500) } else { i32::from(h.bytes[123]) };
    let metres_per_unit = match units & 7 {
        1 => 1.0,
        3 => 1e-6,
        _ => 1e-3,
    };
    let affine = if analyze {
        warnings.add("an ANALYZE header does not say how the stack lies; along the axes");
        DAffine3::from_scale(DVec3::from([1, 2, 3].map(|n| h.pixdim(n).abs())))
    } else if h.code(254, 348) > 0 {
        h.sform()
    } else if h.code(252, 344) > 0 {
        h.qform()
    } else {
        DAffine3::from_scale(DVec3::from([1, 2, 3].map(|n| h.pixdim(n).abs())))
    };
    // A single slice need not say how thick it is.
    let affine = super::with_thickness(affine, dims);
    let offset = match () {
        () if analyze => 0.0,
        () if two => h.i64(168) as f64,
        () => f64::from(h.f32(108)),
    };
    let offset =
        if (0.0..1e15).contains(&offset) { offset as u64 } else { return Err(wrong("its samples begin nowhere")) };
    let packing = if map_file(&data_path)?.starts_with(&[0x1f, 0x8b]) { Packing::Deflate } else { Packing::Raw };
    let (skip, skip_unpacked) = if packing == Packing::Raw { (offset, 0) } else { (0, offset) };
    let data = Data {
        header: &header_path,
        files: vec![data_path.clone()],
        skip: Some(skip),
        skip_unpacked,
        packing,
        coding: Coding { kind, big_endian: big, channels },
        dims,
        volume,
    };
    let mut samples = data.load(in_memory)?;
    let (slope, intercept) = (h.float(112, 176), h.float(116, 184));
    if !analyze && slope != 0.0 && slope.is_finite() && intercept.is_finite() && channels == 1 {
        samples.rescale = (slope, intercept);
    }
    let mut stack = Stack::new(&header_path, samples, affine, metres_per_unit, warnings)?;
    if dim(5) > 1 {
        stack.channels = Channels::Chosen;
    }
    Ok(stack)
}

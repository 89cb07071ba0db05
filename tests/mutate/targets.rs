//! What fuzzers call: each reader by itself, with the bytes of one file, and what is made of bytes by its shape.
//!
//! `fuzz/` chooses the bytes by coverage. The tests give mutated seeds to the same readers.

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use vtex::format::{Limits, Reader};
use vtex::progress::Quiet;
use vtex::render::{image_io, reference};
use vtex::scene::raster::Raster;
use vtex::scene::{self, ReadOptions, gltf};
use vtex::source::curve::trajectory;
use vtex::source::lsystem::Dialect;
use vtex::source::stack::{self, TransferSpec};
use vtex::source::{
    self, LSystemOptions, OpenOptions, PaintOptions, Source, StackOptions, StackSource, TrajectoryOptions,
};
use vtex::volume::Octree;
use vtex::{Error, Result, bake, render};

use crate::mutators::{self, Dice, Kind};
use crate::seeds::{Format, kind, put as put_file};
use crate::{shapes, small};

/// Bytes that a reader may take: little, so that an input is done with in microseconds.
pub const MEMORY: u64 = 4 << 20;
/// What an input may take in all: as much for the file as for what is made of it, and buffers of decoders.
const MOST: usize = 2 * MEMORY as usize + (32 << 20);
/// Pictures that are compared, and rasters, have 2^26 pixels at most, whatever else is allowed.
const MAX_OF_PICTURES: usize = (1 << 30) + (32 << 20);

/// One reader, or one kind of thing that is made of bytes.
pub struct Target {
    pub name: &'static str,
    /// Formats whose seeds are this target's, and whose other files lie beside what is read.
    formats: &'static [&'static str],
    /// Names of files that the bytes may be; the first byte of an input chooses one.
    files: &'static [&'static str],
    read: Read,
    /// Bytes that an input may take.
    pub most: usize,
}

enum Read {
    File(fn(&Call) -> Result<()>),
    Shape(shapes::Shape),
}

/// A file to be read.
struct Call<'a> {
    path: &'a Path,
    /// The input's first byte.
    first: u8,
    /// Of the input: what takes longer is done for few.
    hash: u32,
}

const fn file(
    name: &'static str,
    formats: &'static [&'static str],
    files: &'static [&'static str],
    read: fn(&Call) -> Result<()>,
) -> Target {
    Target { name, formats, files, read: Read::File(read), most: MOST }
}

const fn shape(name: &'static str, formats: &'static [&'static str], shape: shapes::Shape) -> Target {
    Target { name, formats, files: &[], read: Read::Shape(shape), most: MOST }
}

const fn pictures(target: Target) -> Target {
    Target { most: MAX_OF_PICTURES, ..target }
}

pub const ALL: &[Target] = &[
    file("vtex", &["vtex"], &["a.vtex"], texel),
    file("landscape", &["landscape"], &["a.gltf", "a.glb"], landscape),
    file("gltf", &["glTF"], &["a.gltf", "a.glb"], model),
    file("obj", &["OBJ"], &["a.obj", "by.mtl"], obj),
    file("lsystem", &["L-system"], &["a.lsys", "a.ls", "a.l", "a.lpy", "a.ini", "by.v", "by.map"], grammar),
    file("recipe", &["recipe"], &["a.toml", "a.json"], recipe),
    file("transfer", &["transfer"], &["a.json"], transfer),
    file("albedo", &["albedo"], &["a.toml", "a.png", "a.json"], albedo),
    file("csv", &["csv"], &["a.csv", "a.tsv"], curves),
    file("swc", &["swc"], &["a.swc"], curves),
    file("hair", &["hair"], &["a.hair"], curves),
    file("trk", &["trk"], &["a.trk"], curves),
    file("tck", &["tck"], &["a.tck"], curves),
    file("trx", &["trx"], &["a.trx"], curves),
    file("dicom", &["DICOM"], &["a.dcm"], volume),
    file("nifti", &["NIfTI"], &["a.nii", "a.hdr", "a.mgh"], volume),
    file("nrrd", &["NRRD"], &["a.nrrd", "a.nhdr"], volume),
    file("metaimage", &["MetaImage"], &["a.mha", "a.mhd"], volume),
    file("tiff", &["TIFF"], &["a.tif"], volume),
    file("exr", &["EXR"], &["a.exr"], volume),
    file("picture", &["PNG", "JPEG"], &["a.png", "a.jpg"], volume),
    pictures(file("raster", &["TIFF", "PNG"], &["a.tif", "a.png"], raster)),
    pictures(file("compare", &["compare"], &["a.png", "a.exr", "a.hdr"], compared)),
    shape("shape-texel", &["vtex"], shapes::texel::made),
    shape("shape-landscape", &["landscape"], shapes::schema::landscape),
    shape("shape-recipe", &["recipe"], shapes::schema::recipe),
];

/// A target with its folder, in which each input takes the place of the one before.
pub struct Desk {
    target: &'static Target,
    folder: PathBuf,
    files: Vec<File>,
}

impl Desk {
    /// Lay out in `folder` what lies beside the inputs.
    pub fn new(target: &'static Target, folder: &Path, formats: &[Format]) -> Desk {
        std::fs::create_dir_all(folder).unwrap();
        let put = |name: &str, bytes: &[u8]| {
            let path = folder.join(name);
            if !path.exists() {
                put_file(&path, bytes);
            }
        };
        let seeds = || formats.iter().filter(|f| target.formats.contains(&f.name)).flat_map(|f| &f.seeds);
        seeds().flat_map(|s| &s.files).for_each(|(name, bytes)| put(name, bytes));
        put("by.obj", small::OBJ.replace("a.mtl", "by.mtl").as_bytes());
        put("by.l", small::DIALECTS[2].as_bytes());
        put("ball.nrrd", &small::nrrd());
        put("quad.obj", small::OBJ.as_bytes());
        let open = |name: &&str| {
            File::options().create(true).truncate(false).read(true).write(true).open(folder.join(name)).unwrap()
        };
        Desk { target, folder: folder.into(), files: target.files.iter().map(open).collect() }
    }

    /// Read one input; a panic is a fault, and so is an error that is not one line.
    pub fn run(&mut self, data: &[u8]) -> Result<()> {
        let result = match &self.target.read {
            Read::Shape(shape) => {
                // Bytes that do not suffice are no input.
                shape(&mut arbitrary::Unstructured::new(data), &self.folder).unwrap_or(Ok(()))
            }
            Read::File(read) => {
                let (&first, bytes) = data.split_first().unwrap_or((&0, &[]));
                let n = usize::from(first) % self.files.len();
                let file = &mut self.files[n];
                file.seek(SeekFrom::Start(0)).unwrap();
                file.write_all(bytes).unwrap();
                file.set_len(bytes.len() as u64).unwrap();
                let path = self.folder.join(self.target.files[n]);
                read(&Call { path: &path, first, hash: crc32fast::hash(data) })
            }
        };
        if let Err(e) = &result {
            let text = e.to_string();
            assert!(!text.is_empty() && !text.contains(['\n', '\r']), "not one line: {text:?}");
        }
        result
    }
}

impl Target {
    pub fn is_shape(&self) -> bool {
        matches!(self.read, Read::Shape(_))
    }

    /// Inputs made of the seeds of its formats: each file by itself, behind the byte that chooses its name.
    pub fn seeds(&self, formats: &[Format]) -> Vec<Vec<u8>> {
        let ending = |name: &str| name.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
        let mut all = Vec::new();
        for (name, bytes) in
            formats.iter().filter(|f| self.formats.contains(&f.name)).flat_map(|f| &f.seeds).flat_map(|s| &s.files)
        {
            // Texels are read as they are, and with their checksums put right.
            let marks: &[u8] = if self.name == "vtex" { &[0, 1] } else { &[0] };
            for (n, _) in self.files.iter().enumerate().filter(|(_, own)| ending(own) == ending(name)) {
                all.extend(marks.iter().map(|mark| [&[n as u8 + mark], &bytes[..]].concat()));
            }
        }
        if self.name == "lsystem" {
            let places = self.files.len();
            let chosen =
                |n: usize| (0..=u8::MAX).find(|b| dialect(*b) == Dialect::ALL[n].0 && usize::from(*b) % places == 2);
            all.extend(
                small::DIALECTS
                    .iter()
                    .enumerate()
                    .map(|(n, text)| [&[chosen(n).unwrap_or(2)], text.as_bytes()].concat()),
            );
        }
        all.sort();
        all.dedup();
        all
    }

    /// Another input, made of one and parts of `other`.
    pub fn mutated(&self, dice: &mut Dice, data: &[u8], other: &[u8]) -> Vec<u8> {
        if self.is_shape() {
            return mutators::mutate(dice, Kind::Binary, data, other);
        }
        let (&first, bytes) = data.split_first().unwrap_or((&0, &[]));
        let kind = kind(self.files[usize::from(first) % self.files.len()]);
        // A texel's checksums are put right as it is read.
        let kind = if kind == Kind::Texel { Kind::Binary } else { kind };
        let first = if dice.one_in(16) { dice.below(256) as u8 } else { first };
        [&[first], &mutators::mutate(dice, kind, bytes, other.get(1..).unwrap_or_default())[..]].concat()
    }
}

fn read_options() -> ReadOptions {
    ReadOptions { max_bytes: MEMORY, max_instances: 1 << 12, max_pixels: 1 << 18, ..ReadOptions::default() }
}

fn open_options() -> OpenOptions {
    OpenOptions {
        read: read_options(),
        lsystem: LSystemOptions { max_symbols: 2000, ..LSystemOptions::default() },
        trajectory: TrajectoryOptions { width: Some(0.1), ..TrajectoryOptions::default() },
        ..OpenOptions::default()
    }
}

/// Bake a source, of one in so many inputs.
pub fn baked(source: &dyn Source, hash: u32) -> Result<()> {
    if hash.is_multiple_of(128) {
        let options =
            bake::Options { resolution: 4, memory: MEMORY, up: source.up(), calibrate: false, ..Default::default() };
        bake::bake(source, &options, &Quiet, &mut |_| ())?;
    }
    Ok(())
}

fn texel(call: &Call) -> Result<()> {
    let mut bytes = std::fs::read(call.path).map_err(|e| Error::io(call.path, e))?;
    if call.first & 1 == 1 {
        mutators::mend_texel(&mut bytes);
    }
    let reader = Reader::from_bytes(call.path, bytes.into(), &Limits { decoded_bytes: MEMORY })?;
    reader.read_all()?;
    let tree = Octree::new(reader)?;
    shapes::texel::crossed(&tree, call.hash);
    if call.hash.is_multiple_of(64) {
        render::preview::preview(tree, 16)?;
    }
    Ok(())
}

/// A picture of a landscape: finite, whatever it holds.
pub fn seen(scene: &scene::Scene) -> Result<()> {
    let options = render::Options { size: [4, 4], threads: 1, memory: MEMORY, ..render::Options::default() };
    let rendered = render::render(scene, &options, &Quiet)?;
    let wrong = rendered.film.pixels.iter().flatten().find(|v| !v.is_finite());
    assert!(wrong.is_none(), "a pixel of the picture is {wrong:?}");
    Ok(())
}

fn landscape(call: &Call) -> Result<()> {
    let scene = gltf::read(call.path, &ReadOptions { contained: true, ..read_options() })?;
    if call.hash.is_multiple_of(64) { seen(&scene) } else { Ok(()) }
}

fn model(call: &Call) -> Result<()> {
    if call.hash.is_multiple_of(16) {
        source::dependencies(call.path);
    }
    scene::read_model(call.path, &read_options())?;
    if call.hash.is_multiple_of(128) { baked(&*source::open(call.path, &open_options())?, call.hash) } else { Ok(()) }
}

fn obj(call: &Call) -> Result<()> {
    model(&Call { path: &call.path.with_extension("obj"), ..*call })
}

/// The notation that a byte chooses.
fn dialect(first: u8) -> Dialect {
    Dialect::ALL[usize::from(first >> 3) % Dialect::ALL.len()].0
}

fn grammar(call: &Call) -> Result<()> {
    let is_beside = call.path.extension().is_some_and(|e| e == "v" || e == "map");
    let path = if is_beside { call.path.with_extension("l") } else { call.path.to_path_buf() };
    let mut options = open_options();
    options.lsystem.dialect = Some(if is_beside { Dialect::Cpfg } else { dialect(call.first) });
    let source = source::lsystem::open(Some(&path), &options.lsystem, &options.read, &options.mesh)?;
    baked(&*source, call.hash)
}

fn recipe(call: &Call) -> Result<()> {
    baked(&*source::recipe::open(call.path, &open_options(), source::open)?, call.hash)
}

fn transfer(call: &Call) -> Result<()> {
    let transfer = TransferSpec::read(call.path)?;
    transfer.check()?;
    let shares =
        [f64::NEG_INFINITY, -1.0, 0.0, 0.5, 100.0, 1e300].map(|v| transfer.by_value(v) * transfer.by_gradient(v));
    assert!(shares.iter().all(|s| (0.0..=1.0).contains(s)), "{shares:?}");
    if call.hash.is_multiple_of(256) {
        let options = StackOptions { transfer, ..StackOptions::default() };
        let stack = stack::read(&call.path.with_file_name("ball.nrrd"), &options, MEMORY)?;
        return baked(&StackSource::new(stack, &options)?, call.hash);
    }
    Ok(())
}

fn albedo(call: &Call) -> Result<()> {
    let options = open_options();
    let quad = source::open(&call.path.with_file_name("quad.obj"), &options)?;
    let paint = PaintOptions { albedo: Some(call.path.to_string_lossy().into()), ..PaintOptions::default() };
    baked(&*source::apply_paint(quad, &paint, &options.read)?, call.hash)
}

fn curves(call: &Call) -> Result<()> {
    let options = open_options();
    baked(&trajectory::read(call.path, MEMORY, &options.trajectory)?, call.hash)
}

fn volume(call: &Call) -> Result<()> {
    let options = StackOptions::default();
    let stack = stack::read(call.path, &options, MEMORY)?;
    // Its surface is looked for in all samples.
    if !call.hash.is_multiple_of(16) {
        return Ok(());
    }
    let source = StackSource::new(stack, &options)?;
    // A voxel of so few is filtered from many samples.
    if call.hash.is_multiple_of(1024) { baked(&source, call.hash) } else { Ok(()) }
}

fn raster(call: &Call) -> Result<()> {
    Raster::open(call.path).map(drop)
}

fn compared(call: &Call) -> Result<()> {
    if call.path.extension().is_some_and(|e| e == "exr") {
        let _ = reference::Reference::load(call.path, None);
    }
    let a = image_io::read(call.path)?;
    if a.width * a.height <= 64 {
        let b = image_io::Image::from_fn(a.width, a.height, |x, y| [x as f32 / 8.0, y as f32 / 8.0, 0.5, 1.0]);
        render::metrics::compare(&a, &b, &Default::default())?;
    }
    Ok(())
}

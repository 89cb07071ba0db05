//! What is done with an input: it is read as a user's command would, at a small resolution, and what is written is verified.

use std::path::Path;

use vtex::bake::Options;
use vtex::format::{Limits, Reader, WriteOptions};
use vtex::progress::Quiet;
use vtex::render::image_io;
use vtex::scene::gltf::map::{MapOptions, map};
use vtex::scene::{ReadOptions, gltf};
use vtex::source::{LSystemOptions, OpenOptions, PaintOptions, Source, StackOptions, TrajectoryOptions};
use vtex::{Error, Result, bake, format, merge, render, source};

/// Bytes that a source may take as it is read, and that its bake may take.
pub const MEMORY: u64 = 32 << 20;
/// What an input may take in all: as much as its source and its bake are allowed, and what the program takes besides: tables,
/// buffers of decoders, pictures of a few pixels, messages.
pub const MAX_MEMORY: u64 = 2 * MEMORY + (32 << 20);

/// What a format's inputs are given to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    Bake,
    /// As the transfer function of the stack `ball.nrrd`.
    Transfer,
    /// As the paint on `quad.obj`.
    Albedo,
    Texel,
    Render,
    Map,
    /// Against a picture of the same size.
    Compare,
}

/// Run the command on `input`; its outputs go beside it. `number` chooses among options.
pub fn run(command: Command, input: &Path, number: u64) -> Result<()> {
    let beside = |name: &str| input.with_file_name(name);
    match command {
        Command::Bake => read_and_bake(input, &beside("out.vtex"), number),
        Command::Transfer => {
            let stack = StackOptions { table: Some(input.into()), ..StackOptions::default() };
            baked(&beside("ball.nrrd"), &OpenOptions { stack, ..open_options() }, &PaintOptions::default(), number)
        }
        Command::Albedo => {
            let paint = PaintOptions { albedo: Some(input.to_string_lossy().into()), ..PaintOptions::default() };
            baked(&beside("quad.obj"), &open_options(), &paint, number)
        }
        Command::Texel => texel(input, number),
        Command::Render => picture(input),
        Command::Map => mapped(input, &beside("leaf.vtex"), &beside("out.gltf"), number),
        Command::Compare => compared(input),
    }
}

fn read_options() -> ReadOptions {
    ReadOptions { max_bytes: MEMORY, max_instances: 1 << 16, ..ReadOptions::default() }
}

pub fn open_options() -> OpenOptions {
    OpenOptions {
        read: read_options(),
        lsystem: LSystemOptions { max_symbols: 200_000, ..LSystemOptions::default() },
        trajectory: TrajectoryOptions { width: Some(0.1), ..TrajectoryOptions::default() },
        ..OpenOptions::default()
    }
}

/// Bake a source of any kind to `output`.
pub fn read_and_bake(input: &Path, output: &Path, number: u64) -> Result<()> {
    source::dependencies(input);
    written(&*source::open(input, &open_options())?, output, number)
}

fn baked(input: &Path, options: &OpenOptions, paint: &PaintOptions, number: u64) -> Result<()> {
    source::dependencies(input);
    let opened = source::open(input, options)?;
    let opened = source::apply_paint(opened, paint, &options.read)?;
    written(&*opened, &input.with_file_name("out.vtex"), number)
}

/// Bake a source, write and verify it.
fn written(source: &dyn Source, output: &Path, number: u64) -> Result<()> {
    let resolution = if number.is_multiple_of(8) { 16 } else { 8 };
    // To measure the brightness of depths takes longer than all the rest.
    let calibrate = number.is_multiple_of(32);
    let options = Options { resolution, memory: MEMORY, up: source.up(), calibrate, ..Options::default() };
    let (volume, report) = bake::bake(source, &options, &Quiet, &mut |_| ())?;
    if volume.depths.is_empty() {
        return Err(Error::input(
            "input",
            "",
            format!("there is nothing in it to bake{}", report.warnings.as_reasons()),
        ));
    }
    format::write(&volume, output, &WriteOptions::default())?;
    verified(output);
    Ok(())
}

/// A file that was written is whole.
fn verified(output: &Path) {
    if let Err(e) = format::verify(output) {
        panic!("what was written is not valid: {e}");
    }
}

fn texel(input: &Path, number: u64) -> Result<()> {
    let reader = Reader::open(input, &Limits { decoded_bytes: MEMORY })?;
    let whole = format::verify(input).is_ok();
    let volume = reader.read_all()?;
    if whole {
        // A valid file can be written again, and then is valid.
        let again = input.with_file_name("again.vtex");
        format::write(&volume, &again, &WriteOptions::default())?;
        verified(&again);
        let short = input.with_file_name("short.vtex");
        format::truncate(input, volume.depths.len() / 2, &short)?;
        verified(&short);
    }
    if number.is_multiple_of(4) {
        render::preview::preview(
            vtex::volume::Octree::new(Reader::open(input, &Limits { decoded_bytes: MEMORY })?)?,
            16,
        )?;
    }
    if number.is_multiple_of(16) {
        let options = merge::MergeOptions { resolution: Some(8), memory: MEMORY, ..Default::default() };
        let (merged, _) = merge::merge(vec![(volume, Default::default())], &options, &Quiet)?;
        if !merged.depths.is_empty() {
            let output = input.with_file_name("merged.vtex");
            format::write(&merged, &output, &WriteOptions::default())?;
            verified(&output);
        }
    }
    let source = source::open(input, &open_options())?;
    written(&*source, &input.with_file_name("out.vtex"), number)
}

fn picture(input: &Path) -> Result<()> {
    let scene = gltf::read(input, &ReadOptions { contained: true, ..read_options() })?;
    let options = render::Options { size: [8, 8], threads: 1, memory: MEMORY, ..render::Options::default() };
    let rendered = render::render(&scene, &options, &Quiet)?;
    let wrong = rendered.film.pixels.iter().flatten().find(|v| !v.is_finite());
    assert!(wrong.is_none(), "a pixel of the picture is {wrong:?}");
    Ok(())
}

fn mapped(input: &Path, texel: &Path, output: &Path, number: u64) -> Result<()> {
    let info = Reader::open(texel, &Limits::default())?.head().info.clone();
    let options = MapOptions {
        texels: vec![(texel.into(), info)],
        bend: number.is_multiple_of(2),
        sizes: if number.is_multiple_of(2) { Vec::new() } else { vec![1.0] },
        density: (!number.is_multiple_of(2)).then_some(0.05),
        ..MapOptions::default()
    };
    map(input, &options, output)?;
    picture(output)
}

fn compared(input: &Path) -> Result<()> {
    let a = image_io::read(input)?;
    if a.width * a.height > 1 << 12 {
        return Ok(());
    }
    let b = image_io::Image::from_fn(a.width, a.height, |x, y| [x as f32 / 16.0, y as f32 / 16.0, 0.5, 1.0]);
    render::metrics::compare(&a, &b, &Default::default())?;
    let _ = render::reference::Reference::load(input, None);
    Ok(())
}

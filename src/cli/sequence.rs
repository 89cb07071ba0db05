//! `vtex render --frames`: numbered pictures, or one that moves.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, RgbaImage};

use super::frames::{self, Frames};
use super::tile::Picture;
use super::{Ui, outputs};
use crate::format::PartFile;
use crate::render::Film;
use crate::render::image_io::{self, Image};
use crate::{Error, Result, Warnings};

/// When a picture is, and which moments a sequence has.
#[derive(clap::Args)]
#[command(next_help_heading = "Motion")]
pub struct MotionArgs {
    /// The moment, seconds: of the file's animations, of texels of frames and of the wind [default: nodes stand at rest, and
    /// all else as at 0]
    #[arg(long, value_name = "SECONDS", value_parser = super::quantity::finite, allow_hyphen_values = true, conflicts_with = "frames")]
    time: Option<f64>,
    /// Play this animation of the file, by name or number; may be given again [default: the first, and every other that moves
    /// nothing that one before it moves]
    #[arg(long, value_name = "NAME")]
    animation: Vec<String>,
    /// Begin the file's animations anew after their last key, where they else stand still
    #[arg(long = "loop")]
    repeat: bool,
    /// Render frames A to B, or 0 to N−1, frame k at k / fps seconds: to pic.####.png or .exr, a file each, or to one .gif or
    /// .apng that moves. Numbered frames that are there, whole, and newer than all that is read are kept
    #[arg(long, value_name = "A..B|N", value_parser = frames::parse, conflicts_with_all = ["pixel", "resume"])]
    frames: Option<Frames>,
    /// Frames a second
    #[arg(long, value_name = "F", default_value_t = 24.0, value_parser = super::quantity::positive, requires = "frames")]
    fps: f64,
    /// Render frames that are there as well
    #[arg(long, requires = "frames")]
    force: bool,
}

impl MotionArgs {
    /// How the landscape is read for a picture at a time of the sequence, or of a single picture.
    pub fn read(&self, read: crate::scene::ReadOptions, time: Option<f64>) -> crate::scene::ReadOptions {
        let time = time.or(self.time);
        crate::scene::ReadOptions { time, animations: self.animation.clone(), repeat: self.repeat, ..read }
    }

    /// The moment in words, of a single picture.
    pub fn moment(&self) -> String {
        format!("{:?} {:?} {}", self.time, self.animation, self.repeat)
    }

    /// That a single picture is asked for.
    ///
    /// # Errors
    /// `Options` where it is not: a sequence is of one landscape, and needs a name to go to.
    pub fn only_one(&self) -> Result<()> {
        let what = "--frames needs one landscape, and -o: pic.####.png, or one .gif or .apng that moves";
        if self.frames.is_some() { Err(Error::Options(what.into())) } else { Ok(()) }
    }

    /// The sequence that goes to `output`, if one is asked for; `size`: what is known of its pictures.
    ///
    /// # Errors
    /// `Options` where the name of the output is not one of a sequence, or a single picture's name is one.
    pub fn sequence<'a>(&self, output: &'a Path, size: Option<[u32; 2]>) -> Result<Option<Sequence<'a>>> {
        let Some(frames) = self.frames else {
            if Kind::of(output) != Kind::Still {
                let what = format!("{}: --frames is needed for a picture that moves", output.display());
                return Err(Error::Options(what));
            }
            return Ok(None);
        };
        let kind = Kind::of(output);
        if kind == Kind::Still {
            Film::check_name(output)?;
            if !frames::is_numbered(output) {
                let (path, numbered) = (output.display(), frames::with_place(output));
                let what = format!(
                    "{path}: --frames writes a file each, such as {}, or one .gif or .apng that moves",
                    numbered.display()
                );
                return Err(Error::Options(what));
            }
        }
        Ok(Some(Sequence { frames, fps: self.fps, force: self.force, output, kind, size }))
    }
}

/// What the output holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// One picture a file.
    Still,
    Gif,
    Apng,
}

impl Kind {
    fn of(path: &Path) -> Kind {
        match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("gif") => Kind::Gif,
            Some("apng") => Kind::Apng,
            _ => Kind::Still,
        }
    }
}

/// Pictures in a row.
pub struct Sequence<'a> {
    frames: Frames,
    fps: f64,
    force: bool,
    output: &'a Path,
    kind: Kind,
    /// Pixels, where they are asked for.
    size: Option<[u32; 2]>,
}

/// Lines that were said already: a sequence says each once.
#[derive(Default)]
pub struct Said(std::collections::BTreeSet<String>);

impl Said {
    pub fn say(&mut self, ui: &Ui, line: &str) {
        if self.0.insert(line.to_owned()) {
            ui.say(line);
        }
    }

    pub fn warn(&mut self, ui: &Ui, warnings: &Warnings) -> Result<()> {
        let mut news = Warnings::default();
        for (text, n) in warnings.iter().filter(|(text, _)| self.0.insert((*text).to_owned())) {
            news.add_many(text, n);
        }
        ui.warn(&news)
    }
}

impl Sequence<'_> {
    /// Whether all frames go to one file.
    pub fn is_one_file(&self) -> bool {
        self.kind != Kind::Still
    }

    /// Render and store all of it: `frame` makes the picture of a time. `inputs`: the files that are read.
    ///
    /// # Errors
    /// What `frame` gives, and `Io` where a file cannot be written. Pictures that were stored before stay.
    pub fn run(&self, inputs: &[PathBuf], ui: &Ui, frame: &mut dyn FnMut(f64) -> Result<Picture>) -> Result<()> {
        match self.kind {
            Kind::Still => self.numbered(inputs, ui, frame),
            Kind::Gif | Kind::Apng => self.animated(inputs, ui, frame),
        }
    }

    fn time(&self, frame: u32) -> f64 {
        f64::from(frame) / self.fps
    }

    fn numbered(&self, inputs: &[PathBuf], ui: &Ui, frame: &mut dyn FnMut(f64) -> Result<Picture>) -> Result<()> {
        let files: Vec<PathBuf> = self.frames.numbers().map(|n| frames::file(self.output, n)).collect();
        outputs::check(inputs, files.iter().map(PathBuf::as_path))?;
        let newest = inputs.iter().filter_map(|p| modified(p)).max();
        let mut kept = 0;
        for (number, file) in self.frames.numbers().zip(&files) {
            if !self.force && is_kept(file, newest, self.size) {
                kept += 1;
                continue;
            }
            let start = std::time::Instant::now();
            let picture = frame(self.time(number))?;
            ui.finish();
            picture.save(file)?;
            let done = number - self.frames.first + 1;
            let seconds = start.elapsed().as_secs_f64();
            ui.say(&format!("{}: {done} of {}, {seconds:.2} s", file.display(), self.frames.count()));
        }
        if kept > 0 {
            ui.say(&format!("{kept} frames that were there already are kept (--force renders them as well)"));
        }
        Ok(())
    }

    fn animated(&self, inputs: &[PathBuf], ui: &Ui, frame: &mut dyn FnMut(f64) -> Result<Picture>) -> Result<()> {
        outputs::check(inputs, [self.output])?;
        let start = std::time::Instant::now();
        let mut part = PartFile::create(self.output)?;
        let mut next = |number: u32| -> Result<Film> {
            let picture = frame(self.time(number))?;
            ui.finish();
            ui.say(&format!("{} of {}", number - self.frames.first + 1, self.frames.count()));
            Ok(picture.film)
        };
        let first = next(self.frames.first)?;
        let (width, height) = (first.width, first.height);
        if self.kind == Kind::Gif {
            self.gif(first, &mut part, &mut next)?;
        } else {
            self.apng(first, &mut part, &mut next)?;
        }
        part.finish()?;
        let (path, count, seconds) = (self.output.display(), self.frames.count(), start.elapsed().as_secs_f64());
        ui.say(&format!("{path}: {count} frames of {width}×{height} in {seconds:.2} s"));
        Ok(())
    }

    /// 256 colours a frame; how long frames last is in hundredths of a second, and rounded so that no error adds up.
    fn gif(&self, first: Film, part: &mut PartFile, next: &mut dyn FnMut(u32) -> Result<Film>) -> Result<()> {
        let failed = |e: image::ImageError| Error::io(self.output, std::io::Error::other(e));
        let mut encoder = GifEncoder::new_with_speed(part, 10);
        encoder.set_repeat(Repeat::Infinite).map_err(failed)?;
        let mut waiting = Some(first);
        let hundredths = |n: u32| (100.0 * f64::from(n) / self.fps).round() as u32;
        for (k, frame) in self.frames.numbers().enumerate() {
            let picture = match waiting.take() {
                Some(first) => first,
                None => next(frame)?,
            };
            let rgba: Vec<u8> = picture.rgb8().chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
            let image = RgbaImage::from_raw(picture.width, picture.height, rgba);
            let image = image.ok_or_else(|| Error::Options("a frame of another size than its pixels".into()))?;
            let k = k as u32;
            let delay = Delay::from_numer_denom_ms(10 * (hundredths(k + 1) - hundredths(k)), 1);
            encoder.encode_frame(image::Frame::from_parts(image, 0, 0, delay)).map_err(failed)?;
        }
        Ok(())
    }

    /// Lossless.
    fn apng(&self, first: Film, part: &mut PartFile, next: &mut dyn FnMut(u32) -> Result<Film>) -> Result<()> {
        let failed = |e: png::EncodingError| Error::io(self.output, std::io::Error::other(e));
        let size = (first.width, first.height);
        let mut encoder = png::Encoder::new(part, size.0, size.1);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_animated(self.frames.count(), 0).map_err(failed)?;
        let (numerator, denominator) = delay(self.fps);
        encoder.set_frame_delay(numerator, denominator).map_err(failed)?;
        let mut writer = encoder.write_header().map_err(failed)?;
        let mut waiting = Some(first);
        for frame in self.frames.numbers() {
            let picture = match waiting.take() {
                Some(first) => first,
                None => next(frame)?,
            };
            if (picture.width, picture.height) != size {
                return Err(Error::Options("the frames differ in size: give one by --size".into()));
            }
            writer.write_image_data(&picture.rgb8()).map_err(failed)?;
        }
        writer.finish().map_err(failed)
    }
}

/// Seconds that a frame lasts, as a fraction of 16-bit numbers.
fn delay(fps: f64) -> (u16, u16) {
    let whole = fps.round();
    if (fps - whole).abs() < 1e-9 && (1.0..=65_535.0).contains(&whole) {
        return (1, whole as u16);
    }
    ((1000.0 / fps).round().clamp(1.0, 65_535.0) as u16, 1000)
}

fn modified(path: &Path) -> Option<SystemTime> {
    std::fs::metadata(path).ok()?.modified().ok()
}

/// Whether a frame's file is whole, of the size that is asked for, and no older than the inputs.
fn is_kept(file: &Path, newest: Option<SystemTime>, size: Option<[u32; 2]>) -> bool {
    let Some(made) = modified(file) else { return false };
    let fits = |there: Image| size.is_none_or(|size| [there.width, there.height] == size.map(|n| n as usize));
    newest.is_none_or(|newest| made >= newest) && image_io::read(file).is_ok_and(fits)
}

//! `docs/sources.png`: every sample baked, put on a plate and rendered, by the commands that a user would type.
//! `cargo run --release --example contact_sheet [OUT.png]`; texels that are in `target/sheet` already are not baked again.

#![allow(clippy::expect_used, clippy::panic)] // A tool of the repository.

use std::path::{Path, PathBuf};
use std::process::Command;

use embedded_graphics::mono_font::{MonoTextStyle, ascii::FONT_6X10};
use embedded_graphics::pixelcolor::BinaryColor;
use embedded_graphics::prelude::{DrawTarget, Drawable, OriginDimensions, Pixel, Point, Size};
use embedded_graphics::text::{Alignment, Text};
use image::{Rgb, RgbImage};
use vtex::format::{Limits, Reader};

/// A sample, how it is baked, and from how far above it is seen, degrees.
const SAMPLES: [(&str, &[&str], f64); 24] = [
    ("tree.glb", &[], 12.0),
    ("spruce.glb", &[], 12.0),
    ("fern.glb", &[], 28.0),
    ("lsystems/tree.lsys", &[], 12.0),
    ("lsystems/spruce.lsys", &[], 12.0),
    ("lsystems/willow.lsys", &[], 12.0),
    ("lsystems/fern.lsys", &[], 28.0),
    ("lsystems/flower.lsys", &[], 28.0),
    ("lsystems/plant-b.lsys", &[], 12.0),
    ("lsystems/plant-f.lsys", &[], 12.0),
    ("curves/dandelion.csv", &["--curve", "catmull-rom"], 12.0),
    ("stacks/shell", &["--spacing", "1,1,2", "--iso", "60"], 28.0),
    ("recipes/nut.toml", &[], 40.0),
    ("recipes/part.toml", &[], 28.0),
    ("recipes/wall.toml", &["--cyclic", "u"], 18.0),
    ("recipes/meadow.toml", &["--cyclic", "u,v"], 28.0),
    ("recipes/lawn.toml", &["--cyclic", "u,v"], 28.0),
    ("recipes/grove.toml", &[], 18.0),
    ("hypertextures/fur.toml", &[], 18.0),
    ("hypertextures/fire.toml", &[], 18.0),
    ("hypertextures/marble.toml", &[], 40.0),
    ("hypertextures/melt.toml", &[], 18.0),
    ("hypertextures/eroded.toml", &["--cyclic", "u,v"], 40.0),
    ("recipes/ring.toml", &[], 28.0),
];
const COLUMNS: u32 = 6;
/// Pixels of a cell, and of the line of text below it.
const CELL: u32 = 180;
const TEXT: u32 = 14;

fn vtex(args: &[&str]) {
    let own = std::env::current_exe().expect("its own path");
    let program = own.parent().and_then(Path::parent).expect("target/release").join("vtex");
    let status = Command::new(&program).args(args).arg("--quiet").status();
    assert!(status.is_ok_and(|s| s.success()), "{} {}", program.display(), args.join(" "));
}

/// A square plate of edge 1 about the origin, as glTF.
fn plate() -> String {
    let corners: [f32; 12] = [-0.5, 0.0, -0.5, 0.5, 0.0, -0.5, 0.5, 0.0, 0.5, -0.5, 0.0, 0.5];
    let mut bytes: Vec<u8> = corners.iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0u16, 2, 1, 0, 3, 2].iter().flat_map(|v| v.to_le_bytes()));
    let data = base64::Engine::encode(&base64::engine::general_purpose::STANDARD, &bytes);
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"material":0}}]}}],
        "materials":[{{"pbrMetallicRoughness":{{"baseColorFactor":[0.62,0.6,0.56,1],"metallicFactor":0}}}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[-0.5,0,-0.5],"max":[0.5,0,0.5]}},
        {{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":12}}],
        "buffers":[{{"byteLength":60,"uri":"data:application/octet-stream;base64,{data}"}}]}}"#
    )
}

/// Black text on a picture.
struct Ink<'a>(&'a mut RgbImage);

impl OriginDimensions for Ink<'_> {
    fn size(&self) -> Size {
        Size::new(self.0.width(), self.0.height())
    }
}

impl DrawTarget for Ink<'_> {
    type Color = BinaryColor;
    type Error = std::convert::Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<BinaryColor>>>(&mut self, pixels: I) -> Result<(), Self::Error> {
        for Pixel(at, colour) in pixels {
            let place = u32::try_from(at.x).ok().zip(u32::try_from(at.y).ok());
            if let Some(pixel) = place.and_then(|(x, y)| self.0.get_pixel_mut_checked(x, y)).filter(|_| colour.is_on())
            {
                *pixel = Rgb([30; 3]);
            }
        }
        Ok(())
    }
}

/// The sample's picture: its texel stands on the plate, one edge wide.
fn picture(folder: &Path, name: &str, args: &[&str], above: f64) -> RgbImage {
    let file = |end: &str| folder.join(format!("{}{end}", name.replace(['/', '.'], "-"))).display().to_string();
    let (texel, land, png) = (file(".vtex"), file(".gltf"), file(".png"));
    if !Path::new(&texel).exists() {
        println!("baking {name}");
        let sample = format!("samples/{name}");
        vtex(&[&["bake", &sample, "-r", "256", "-o", &texel], args].concat());
    }
    let reader = Reader::open(&texel, &Limits::default()).expect("a texel that was just baked");
    let content = reader.read_all().expect("its voxels").info.content;
    let plate = folder.join("plate.gltf").display().to_string();
    vtex(&[
        "map",
        &plate,
        "--texel",
        &texel,
        "--repeat",
        "1",
        "--orientations",
        "identity",
        "--scale",
        "1,1",
        "--displace",
        "0",
        "-o",
        &land,
    ]);
    // Seen so that the content fills the picture, whatever part of the plate's cube it takes; the texel's w is up.
    let middle = 0.5 * (content.min + content.max);
    let target = [middle.x - 0.5, middle.z, 0.5 - middle.y];
    let reach = 0.5 * content.size().length().max(0.5);
    let (fov, turn) = (24f64.to_radians(), 30f64.to_radians());
    let distance = reach / (0.5 * fov).sin();
    let (flat, up) = (distance * above.to_radians().cos(), distance * above.to_radians().sin());
    let eye = [target[0] + flat * turn.sin(), target[1] + up, target[2] + flat * turn.cos()];
    let list = |v: [f64; 3]| format!("{:.4},{:.4},{:.4}", v[0], v[1], v[2]);
    let size = format!("{CELL}x{CELL}");
    vtex(&[
        "render",
        &land,
        "-o",
        &png,
        "--size",
        &size,
        "--eye",
        &list(eye),
        "--look-at",
        &list(target),
        "--fov",
        "24",
        "--lanes",
        "4",
        "--background",
        "0.86,0.88,0.9",
    ]);
    image::open(&png).expect("the picture").to_rgb8()
}

fn main() {
    let out = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "docs/sources.png".into()));
    let folder = Path::new("target/sheet");
    std::fs::create_dir_all(folder).expect("target/sheet");
    std::fs::write(folder.join("plate.gltf"), plate()).expect("the plate");
    let rows = (SAMPLES.len() as u32).div_ceil(COLUMNS);
    let mut sheet = RgbImage::from_pixel(COLUMNS * CELL, rows * (CELL + TEXT), Rgb([255; 3]));
    for (i, (name, args, above)) in SAMPLES.iter().enumerate() {
        let (x, y) = (i as u32 % COLUMNS * CELL, i as u32 / COLUMNS * (CELL + TEXT));
        image::imageops::replace(&mut sheet, &picture(folder, name, args, *above), i64::from(x), i64::from(y));
        let style = MonoTextStyle::new(&FONT_6X10, BinaryColor::On);
        let at = Point::new((x + CELL / 2) as i32, (y + CELL + 10) as i32);
        let _ = Text::with_alignment(name, at, style, Alignment::Center).draw(&mut Ink(&mut sheet));
    }
    sheet.save(&out).expect("the sheet");
    println!("{}", out.display());
}

//! A small valid input of every format, made by hand.

use std::io::{Cursor, Write};
use std::path::Path;

use serde_json::json;

use crate::seeds::Seed;

pub const OBJ: &str = "mtllib a.mtl\nv 0 0 0 1 0.5 0.2\nv 1 0 0 0 1 0\nv 1 1 0.2 0 0 1\nv 0 1 0 1 1 1\nvt 0 0\nvt 1 0\nvt 1 1\n\
                       vn 0 0 1\no leaf\ng a\nusemtl leaf\nf 1/1/1 2/2/1 3/3/1 4/1/1\nusemtl stem\nf -4//1 -2//1 -1//1\nl 1 2 3\np 4\n";
pub const MTL: &str = "newmtl leaf\nKd 0.2 0.6 0.1\nd 0.7\nmap_Kd -s 2 2 1 -o 0.1 0 0 leaf.png\nmap_d leaf.png\nnewmtl stem\nKd 0.4 0.3 0.2\n";
pub const LSYSTEM: &str = "# A bush.\n#iterations 3\n#seed 4\n#angle 25\n#define n 3\n#colour 0 #4f6b2c\n#material leaf 0\n\
                           #surface P { 0 0, .16 .1, 0 1 }\naxiom: !(.1)A(1, n)\n\
                           A(s, k) : k > 0 -> F(s)[+(30)A(s*.7, k-1)][-A(s*.7^2, k-1)]/(137.5 + ran(3))A(s*.7, k-1)~P(s)\n\
                           F(s) -> F(s*1.1)\n#homomorphism\nA(s, k) -> '(0)~P(.2)\n";
/// The same kind of plant in each notation, in the order of `Dialect::ALL`.
pub const DIALECTS: [&str; 7] = [
    LSYSTEM,
    "Plant { ; of the book\nangle 14\naxiom F\n F=F[+F]@.7F[-F]!F\\20D/3M\n}\nOther {\nangle 8\naxiom X\nX=F[+X]<1C2F\n}\n",
    "#define r .9\n#define STEPS 4\n#define max(a,b) ((a)>(b)?(a):(b))\nLsystem: 1\nSeed: 3\nderivation length: STEPS\nignore: +-\nconsider: AF\n\
     Define: { array v[2] = { 1, 2 }; }\nStart: { s = 1; }\nAxiom: A(1,10)~l(2)\n\
     A(l,w) : l > .1 { x = l*r; if (x > 1) { x = 1; } } --> !(w)F(l)[&(45)+A(x,w*.7)]\\(137.5)@vA(l*r,max(w*.7,1)) : .7\n\
     B < A(l,w) > C --> F\nhomomorphism\nF(l) --> ;(2)@o(l/4)F(l)\nendlsystem\n",
    "\"\"\"A tree\"\"\"\nfrom math import *\nR = 1.456\na = 85\nmodule A(s)\nAxiom: _(.1)A(1)\nderivation length: 4\nproduction:\n\
     A(s) :\n  if s > .3:\n    nproduce F(s)\n    for i in range(2):\n      nproduce [+(a - 170*i)A(s/R)]\n  else:\n    produce F(s)\n\
     interpretation:\nF(s) --> ,(2)F(s,.1)\nendlsystem\n",
    "[L-System]\niterations=3\naxiom=GH\nangle=25.7\nrule0=G>GFX[+G][-G]\nrule1=X>X[-FFF][+FFF]FX\n; end\n",
    "premise = A(1,.1)\nangle = 30\nstep = 1\ngenerations = 4\nseed = 2\nrule1 = A(l,w):l>.2=!(w)F(l)[+A(l*b,w*.7)]-A(l*b,w*.7):.8\nrule2 = F(l)=F(l*1.1)J(1)\nb=.7\n",
    "lsystem tree {\nset iterations = 3;\nset angle = 25;\nignore: +-;\naxiom: F(1)X;\nr1: X -> F[+X][-X]FX;\nr2: F(l) : l < 4 -> F(l*1.5);\n}\n",
];
pub const RECIPE: &str = "# Several kinds in one.\nmetres_per_unit = 0.5\n[define.stick]\n\
    cylinder = { from = [0, 0, 0], to = [0, 1, 0], radius = 0.1 }\n[[draw]]\nsphere = { radius = 0.5, centre = [0, 1, 0] }\n\
    albedo = \"#308040\"\n[[draw]]\nsource = \"quad.obj\"\ntranslate = [0, 0.5, 0]\nscale = 0.5\n[[draw]]\nuse = \"stick\"\n\
    scatter = { count = 5, min = [-1, 0, -1], max = [1, 0, 1], round = true, apart = 0.1, tilt = 8, scale = [0.6, 1.2], seed = 5 }\n\
    [[draw]]\nmode = \"multiply\"\ndifference = [{ box = { min = [-1, 0, -1], max = [1, 1, 1], round = 0.2 } }, { use = \"stick\" }]\n\
    [[draw]]\nimplicit = { kind = \"torus\", radius = 0.5, thickness = 0.1 }\n[[draw]]\n\
    hypertexture = { preset = \"fire\", base = { kind = \"sphere\", radius = 0.3 } }\n";
pub const TRANSFER: &str = r#"{"points": [{"value": 20, "opacity": 0}, {"value": 120, "opacity": 0.6, "colour": [1, 0.5, 0.2]},
    {"value": 200, "opacity": 1}], "gradient": [{"magnitude": 0, "opacity": 0.2}, {"magnitude": 50, "opacity": 1}]}"#;
pub const ALBEDO: &str = "noise = { scale = 0.4, octaves = 3 }\ncolours = [\"#553311\", \"#998866\"]\n";
pub const LINES: &str = "strand,x,y,z,radius,r,g,b\n0,0,0,0,0.1,1,0,0\n0,0,1,0,0.05,0,1,0\n1,1,0,0,0.1,0,0,1\n1,1,1,0.5,0.1,1,1,1\n1,1,2,0,0,1,1,1\n";
pub const SWC: &str = "# neuron\n1 1 0 0 0 1 -1\n2 3 0 2 0 0.3 1\n3 3 1 3 0 0.2 2\n4 3 -1 3 0.5 0.2 2\n";

pub fn obj() -> Seed {
    let files = [("a.obj", OBJ.as_bytes().to_vec()), ("a.mtl", MTL.into()), ("leaf.png", png(4, 4))];
    Seed { main: "a.obj".into(), files: files.map(|(name, bytes)| (name.to_owned(), bytes)).to_vec() }
}

/// A picture with some of it transparent.
pub fn png(width: u32, height: u32) -> Vec<u8> {
    let pixel = |x: u32, y: u32| image::Rgba([(40 * x) as u8, (60 * y) as u8, 90, if x > y { 255 } else { 20 }]);
    encoded(image::RgbaImage::from_fn(width, height, pixel).into(), image::ImageFormat::Png)
}

pub fn jpeg() -> Vec<u8> {
    let pixel = |x: u32, y: u32| image::Luma([if x > 2 && y > 2 { 220 } else { 10 }]);
    encoded(image::GrayImage::from_fn(8, 8, pixel).into(), image::ImageFormat::Jpeg)
}

fn encoded(image: image::DynamicImage, format: image::ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

pub fn exr(folder: &Path) -> Vec<u8> {
    let path = folder.join("made.exr");
    exr::prelude::write_rgba_file(&path, 5, 4, |x, y| (x as f32, y as f32, 0.5f32, 1.0f32)).unwrap();
    std::fs::read(path).unwrap()
}

/// A folder of three slices.
pub fn slices(extension: &str, slice: impl Fn(usize) -> Vec<u8>) -> Seed {
    let files = (0..3).map(|i| (format!("stack/{i}.{extension}"), slice(i))).collect();
    Seed { main: "stack".into(), files }
}

pub fn tiff() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut file = tiff::encoder::TiffEncoder::new(&mut bytes).unwrap();
    for page in 0..3u16 {
        let pixels: Vec<u16> = (0..20).map(|i| 100 * i + page).collect();
        file.write_image::<tiff::encoder::colortype::Gray16>(5, 4, &pixels).unwrap();
    }
    bytes.into_inner()
}

/// A page of 5 × 4 numbers of 8 bits, packed by LZMA.
pub fn tiff_by_lzma() -> Vec<u8> {
    // What liblzma makes of 0, 10, … 190, with a delta filter of a byte.
    const PACKED: [u8; 60] = [
        0xfd, 0x37, 0x7a, 0x58, 0x5a, 0x00, 0x00, 0x00, 0xff, 0x12, 0xd9, 0x41, 0x02, 0x01, 0x03, 0x01, 0x00, 0x21,
        0x01, 0x16, 0x79, 0x20, 0xc4, 0xee, 0xe0, 0x00, 0x13, 0x00, 0x07, 0x5d, 0x00, 0x00, 0x03, 0x19, 0xac, 0x8b,
        0x90, 0x00, 0x00, 0x00, 0x00, 0x01, 0x1b, 0x14, 0xcc, 0xaa, 0x6a, 0x93, 0x06, 0x72, 0x9e, 0x7a, 0x01, 0x00,
        0x00, 0x00, 0x00, 0x00, 0x59, 0x5a,
    ];
    let tags: [(u16, u32); 9] = [
        (256, 5),
        (257, 4),
        (258, 8),
        (259, 34925),
        (262, 1),
        (273, 8),
        (277, 1),
        (278, 4),
        (279, PACKED.len() as u32),
    ];
    let mut file = [&b"II*\0"[..], &(8 + PACKED.len() as u32).to_le_bytes(), &PACKED].concat();
    file.extend((tags.len() as u16).to_le_bytes());
    for (tag, value) in tags {
        // One number of 32 bits.
        file.extend([tag, 4].iter().flat_map(|v| v.to_le_bytes()));
        file.extend([1, value].iter().flat_map(|v| v.to_le_bytes()));
    }
    file.extend([0; 4]);
    file
}

/// A ball of bytes, 6 to each side.
fn ball() -> Vec<u8> {
    let square = |v: usize| (v as f32 - 2.5).powi(2);
    (0..216).map(|i| (250.0 - 25.0 * (square(i % 6) + square(i / 6 % 6) + square(i / 36))).max(0.0) as u8).collect()
}

pub fn nrrd() -> Vec<u8> {
    let head = "NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: 6 6 6\n\
                space directions: (1,0,0) (0,1,0) (0,0,1.5)\nspace origin: (0,0,0)\nencoding: gzip\n\n";
    [head.as_bytes().to_vec(), super::mutators::gzip(&ball())].concat()
}

pub fn nhdr() -> Seed {
    let head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 6 6 6\nspacings: 1 1 2\nencoding: raw\nbyte skip: 0\ndata file: a.raw\n";
    Seed { main: "a.nhdr".into(), files: vec![("a.nhdr".into(), head.into()), ("a.raw".into(), ball())] }
}

const META: &str = "ObjectType = Image\nNDims = 3\nDimSize = 6 6 6\nElementSpacing = 1 1 2\nOffset = 0 0 0\n\
                    TransformMatrix = 1 0 0 0 1 0 0 0 1\nElementType = MET_UCHAR\nElementByteOrderMSB = False\n";

pub fn mha() -> Vec<u8> {
    [META.as_bytes(), b"ElementDataFile = LOCAL\n", &ball()].concat()
}

pub fn mhd() -> Seed {
    let head = format!("{META}HeaderSize = 0\nElementDataFile = a.raw\n");
    Seed { main: "a.mhd".into(), files: vec![("a.mhd".into(), head.into()), ("a.raw".into(), ball())] }
}

pub fn nifti() -> Vec<u8> {
    let mut head = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    [3, 6, 6, 6, 1, 1, 1, 1].iter().enumerate().for_each(|(i, v)| put(40 + 2 * i, &(*v as i16).to_le_bytes()));
    put(70, &2i16.to_le_bytes());
    put(72, &8i16.to_le_bytes());
    (0..8).for_each(|i| put(76 + 4 * i, &1f32.to_le_bytes()));
    put(108, &352f32.to_le_bytes());
    put(112, &1f32.to_le_bytes());
    put(123, &[2]);
    put(254, &1i16.to_le_bytes());
    (0..3).for_each(|i| put(280 + 20 * i, &1f32.to_le_bytes()));
    put(344, b"n+1\0");
    [head, ball()].concat()
}

/// Three DICOM files of a series.
pub fn dicom() -> Seed {
    let file = |z: usize| {
        let mut out = [vec![0; 128], b"DICM".to_vec()].concat();
        let mut put = |group: u16, element: u16, kind: &[u8; 2], value: &[u8]| {
            let long = kind == b"OW";
            out.extend([group.to_le_bytes(), element.to_le_bytes()].concat());
            out.extend(kind);
            let length = value.len().next_multiple_of(2);
            if long {
                out.extend([0, 0]);
                out.extend((length as u32).to_le_bytes());
            } else {
                out.extend((length as u16).to_le_bytes());
            }
            out.extend(value);
            out.resize(out.len() + length - value.len(), b' ');
        };
        let us = |v: u16| v.to_le_bytes();
        put(2, 0x10, b"UI", b"1.2.840.10008.1.2.1\0");
        put(8, 0x60, b"CS", b"MR");
        put(0x18, 0x50, b"DS", b"2");
        put(0x20, 0x0e, b"UI", b"1.2.7\0");
        put(0x20, 0x32, b"DS", format!("0\\0\\{z}").as_bytes());
        put(0x20, 0x37, b"DS", b"1\\0\\0\\0\\1\\0");
        put(0x28, 0x02, b"US", &us(1));
        put(0x28, 0x04, b"CS", b"MONOCHROME2");
        put(0x28, 0x10, b"US", &us(4));
        put(0x28, 0x11, b"US", &us(4));
        put(0x28, 0x30, b"DS", b"1\\1");
        for (element, value) in [(0x100, 16), (0x101, 16), (0x102, 15), (0x103, 0)] {
            put(0x28, element, b"US", &us(value));
        }
        let pixels: Vec<u8> = (0..16u16).flat_map(|i| (100 * i + z as u16).to_le_bytes()).collect();
        put(0x7fe0, 0x10, b"OW", &pixels);
        out
    };
    Seed { main: "series".into(), files: (0..3).map(|z| (format!("series/{z}.dcm"), file(z))).collect() }
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

pub fn hair() -> Vec<u8> {
    let mut out = b"HAIR".to_vec();
    [2u32, 5, 1 | 2 | 4 | 8 | 16, 0].iter().for_each(|v| out.extend(v.to_le_bytes()));
    out.extend(floats(&[0.1, 0.0, 0.5, 0.4, 0.3]));
    out.resize(128, 0);
    [1u16, 2].iter().for_each(|v| out.extend(v.to_le_bytes()));
    out.extend(floats(&[0., 0., 0., 0., 1., 0., 1., 0., 0., 1., 1., 0.5, 1., 2., 0.]));
    out.extend(floats(&[0.1; 5]));
    out.extend(floats(&[0.25; 5]));
    out.extend(floats(&[0.5; 15]));
    out
}

pub fn trk() -> Vec<u8> {
    let mut head = vec![0; 1000];
    let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, b"TRACK\0");
    [10i16, 10, 10].iter().enumerate().for_each(|(i, v)| put(6 + 2 * i, &v.to_le_bytes()));
    put(12, &floats(&[1., 1., 1.]));
    [0, 5, 10, 15].iter().for_each(|k| put(440 + 4 * k, &1f32.to_le_bytes()));
    put(948, b"RAS\0");
    put(988, &2i32.to_le_bytes());
    put(992, &2i32.to_le_bytes());
    put(996, &1000i32.to_le_bytes());
    for n in [2i32, 3] {
        head.extend(n.to_le_bytes());
        (0..n).for_each(|i| head.extend(floats(&[n as f32, 2.0 * i as f32, 0.5])));
    }
    head
}

pub fn tck() -> Vec<u8> {
    let head = "mrtrix tracks\ndatatype: Float32LE\ncount: 2\nfile: . 64\nEND\n";
    let mut out = head.as_bytes().to_vec();
    out.resize(64, b'\n');
    let nan = f32::NAN;
    let end = f32::INFINITY;
    out.extend(floats(&[0., 0., 0., 0., 2., 0., nan, nan, nan, 1., 0., 0., 1., 2., 1., nan, nan, nan, end, end, end]));
    out
}

pub fn trx() -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let points = floats(&[0., 0., 0., 0., 2., 0., 1., 0., 0., 1., 2., 1.]);
    let offsets: Vec<u8> = [0u64, 2, 4].iter().flat_map(|v| v.to_le_bytes()).collect();
    let header = json!({ "DIMENSIONS": [10, 10, 10], "NB_VERTICES": 4, "NB_STREAMLINES": 2,
        "VOXEL_TO_RASMM": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]] });
    let files = [
        ("header.json", header.to_string().into_bytes()),
        ("positions.3.float32", points),
        ("offsets.uint64", offsets),
    ];
    for (name, bytes) in files {
        let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
        archive.start_file(name, stored).unwrap();
        archive.write_all(&bytes).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

/// Four corners of a square of 4 m in the XZ plane, their texture coordinates, and its two triangles.
pub fn corners() -> Vec<u8> {
    let positions = floats(&[0., 0., 0., 0., 0., 4., 4., 0., 4., 4., 0., 0.]);
    let uvs = floats(&[0., 0., 0., 1., 1., 1., 1., 0.]);
    [positions, uvs, vec![0, 1, 2, 0, 2, 3, 0, 0]].concat()
}

/// The square as glTF with its files apart, and as GLB without a picture.
pub fn grounds() -> [Vec<u8>; 2] {
    let mut file = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0, 1, 2] }],
        "nodes": [{ "mesh": 0, "name": "ground" }, { "camera": 0, "translation": [2, 3, 8], "rotation": [-0.17, 0, 0, 0.985] },
            { "extensions": { "KHR_lights_punctual": { "light": 0 } }, "matrix": [1,0,0,0, 0,0,-1,0, 0,1,0,0, 0,9,0,1] }],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1, "zfar": 100, "aspectRatio": 1.5 } }],
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "directional", "intensity": 3, "color": [1, 0.9, 0.8] }] } },
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 2 }, "indices": 1, "material": 0 }] }],
        "materials": [{ "name": "grass", "alphaMode": "MASK", "alphaCutoff": 0.4, "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.6, 0.4, 1], "baseColorTexture": { "index": 0, "extensions": {
                "KHR_texture_transform": { "scale": [2, 2], "rotation": 0.3, "offset": [0.1, 0] } } } } }],
        "textures": [{ "source": 0, "sampler": 0 }], "samplers": [{ "wrapS": 33071, "magFilter": 9728 }],
        "images": [{ "uri": "grass.png" }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [4, 0, 4] },
            { "bufferView": 2, "componentType": 5121, "count": 6, "type": "SCALAR" },
            { "bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 32 },
            { "buffer": 0, "byteOffset": 80, "byteLength": 6 }],
        "buffers": [{ "byteLength": 88, "uri": "ground.bin" }],
    });
    let gltf = file.to_string().into_bytes();
    file["buffers"] = json!([{ "byteLength": 88 }]);
    file["materials"][0]["pbrMetallicRoughness"] = json!({ "baseColorFactor": [0.5, 0.6, 0.4, 1] });
    for key in ["textures", "samplers", "images"] {
        file.as_object_mut().unwrap().shift_remove(key);
    }
    let mut json = file.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let bin = corners();
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend(((28 + json.len() + bin.len()) as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", bin)] {
        glb.extend((chunk.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(chunk);
    }
    [gltf, glb]
}

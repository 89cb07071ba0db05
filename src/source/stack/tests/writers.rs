//! Stacks by the conventions of programs that nobody thought of at first: one place for all frames, extents in place of distances,
//! pictures that are parts of larger ones.

use super::dicoms::{Element, PLAIN, file, numbers as words, text, us};
use super::*;

/// Four frames of 2 × 2 pixels of one file, whose place is said once; each pixel is its frame's number from 1 on.
fn frames(dir: &Dir, more: &[Element]) -> Result<Stack> {
    let own = [&[text(0x20, 0x32, b"DS", "10\\20\\30"), text(0x28, 8, b"IS", "4"), text(0x18, 0x50, b"DS", "3")], more]
        .concat();
    let pixels: Vec<u16> = (0..16).map(|n| n / 4 + 1).collect();
    open(&dir.save("frames.dcm", &file(PLAIN, &own, Some(&words(&pixels)))))
}

/// Values of the slices, the first pixel of the first, and the step to the next.
fn lie(stack: &Stack) -> (Vec<f32>, DVec3, DVec3) {
    let list = values(stack).chunks(4).map(|c| c[0]).collect();
    (list, stack.affine.translation, stack.affine.matrix3.z_axis)
}

#[test]
fn frames_whose_place_is_said_once_lie_one_behind_the_other() {
    let dir = Dir::new();
    let up = |z: f64| DVec3::new(0.0, 0.0, z);
    let first = DVec3::new(10.0, 20.0, 30.0);
    let rising = vec![1.0, 2.0, 3.0, 4.0];
    // As thick as slices are, or as they are apart, which a sign turns round.
    assert_eq!(lie(&frames(&dir, &[]).unwrap()), (rising.clone(), first, up(3.0)));
    let apart = |words: &str| [text(0x18, 0x88, b"DS", words)];
    assert_eq!(lie(&frames(&dir, &apart("2.5")).unwrap()), (rising.clone(), first, up(2.5)));
    let (list, at, step) = lie(&frames(&dir, &apart("-2.5")).unwrap());
    assert_eq!((list, at, step), (vec![4.0, 3.0, 2.0, 1.0], first - up(7.5), up(2.5)));
    // A dose: offsets from the first frame, or the z of each; and what a stored 1 is.
    let dose = |offsets: &str| [text(0x3004, 0x0c, b"DS", offsets), text(0x3004, 0x0e, b"DS", "0.5")];
    let half = vec![0.5, 1.0, 1.5, 2.0];
    assert_eq!(lie(&frames(&dir, &dose("0\\4\\8\\12")).unwrap()), (half.clone(), first, up(4.0)));
    assert_eq!(lie(&frames(&dir, &dose("30\\34\\38\\42")).unwrap()), (half.clone(), first, up(4.0)));
    let (list, at, step) = lie(&frames(&dir, &dose("0\\-4\\-8\\-12")).unwrap());
    assert_eq!((list, at, step), (vec![2.0, 1.5, 1.0, 0.5], first - up(12.0), up(4.0)));
    // Seen from below: the normal points down, and so do offsets, but not a z.
    let below = text(0x20, 0x37, b"DS", "1\\0\\0\\0\\-1\\0");
    let turned = |offsets: &str| frames(&dir, &[&dose(offsets)[..], std::slice::from_ref(&below)].concat()).unwrap();
    assert_eq!(lie(&turned("0\\4\\8\\12")), (half.clone(), first, up(-4.0)));
    assert_eq!(lie(&turned("30\\34\\38\\42")), (vec![2.0, 1.5, 1.0, 0.5], first + up(12.0), up(-4.0)));
    // A film: all frames are in one place.
    let film = [(0x28, 9, *b"AT", words(&[0x18, 0x1063]))];
    let one = frames(&dir, &film).unwrap();
    assert_eq!(one.samples.dims(), [2, 2, 1]);
    assert!(one.warnings.as_reasons().contains("4 stacks"), "{}", one.warnings.as_reasons());
}

#[test]
fn frames_of_a_detector_lie_as_it_says() {
    let dir = Dir::new();
    let mut item = Vec::new();
    for (tag, words) in [(0x32u16, "1\\2\\3 "), (0x37, "0\\1\\0\\0\\0\\1 ")] {
        item.extend([0x20, 0, tag as u8, 0, b'D', b'S', words.len() as u8, 0]);
        item.extend(words.as_bytes());
    }
    let sequence = [vec![0xfe, 0xff, 0x00, 0xe0], (item.len() as u32).to_le_bytes().to_vec(), item].concat();
    // Frames in any order, by the vector of their slices.
    let own = [
        (0x54, 0x22, *b"SQ", sequence),
        us(0x54, 0x80, &[2, 1, 4, 3]),
        text(0x28, 8, b"IS", "4"),
        text(0x18, 0x88, b"DS", "3"),
        text(0x20, 0x37, b"DS", ""),
    ];
    let pixels: Vec<u16> = (0..16).map(|n| n / 4 + 1).collect();
    let stack = open(&dir.save("nm.dcm", &file(PLAIN, &own, Some(&words(&pixels))))).unwrap();
    let expected = (vec![2.0, 1.0, 4.0, 3.0], DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 0.0, 0.0));
    assert_eq!(lie(&stack), expected);
}

#[test]
fn a_deflated_file_is_unpacked_within_the_memory() {
    let dir = Dir::new();
    let whole = file("1.2.840.10008.1.2.1.99", &[], Some(&vec![0; 1 << 20]));
    let start = whole.windows(4).position(|w| w == [8, 0, 0x60, 0]).unwrap();
    let mut packer = flate2::write::DeflateEncoder::new(whole[..start].to_vec(), flate2::Compression::fast());
    packer.write_all(&whole[start..]).unwrap();
    let path = dir.save("deflated.dcm", &packer.finish().unwrap());
    let with = |memory| read(&path, &StackOptions::default(), memory).err().map(|e| e.to_string());
    assert!(with(1 << 19).unwrap().contains("the limit is"));
    assert_eq!(with(1 << 21), None);
}

#[test]
fn extents_of_nrrd_place_samples() {
    let dir = Dir::new();
    let nrrd = |fields: &str, data: &[u8]| {
        let text = format!("NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\n{fields}\n\n");
        dir.save("a.nrrd", &[text.as_bytes(), data].concat())
    };
    let raw = "endian: little\nencoding: raw\n";
    // Cells are 2, 3 and 4 wide; samples are in their middles, unless they are nodes.
    let place = |p: DVec3| DVec3::new(11.0, 21.5, 32.0) + DVec3::new(2.0, 3.0, 4.0) * p;
    expect(&nrrd(&format!("{raw}spacings: 2 3 4\naxis mins: 10 20 30"), &little()), place);
    expect(&nrrd(&format!("{raw}axis mins: 10 20 30\naxis maxs: 18 29 38"), &little()), place);
    expect(&nrrd(&format!("{raw}centers: cell cell cell\naxismins: 10 20 30\naxismaxs: 18 29 38"), &little()), place);
    let nodes = |p: DVec3| DVec3::new(10.0, 20.0, 30.0) + DVec3::new(2.0, 3.0, 4.0) * p;
    expect(
        &nrrd(&format!("{raw}centerings: node node node\naxis mins: 10 20 30\naxis maxs: 16 26 34"), &little()),
        nodes,
    );
    // Directions say it better; what is unknown is not known.
    let both = format!("{raw}space directions: (1,0,0) (0,1,0) (0,0,1)\naxis mins: 10 20 30");
    expect(&nrrd(&both, &little()), |p| p);
    expect(&nrrd(&format!("{raw}spacings: nan nan nan\naxis mins: nan nan nan"), &little()), |p| p);
    // As SimpleITK writes four axes from 0 on; and text, in capitals.
    let text: String = super::numbers().iter().map(|v| format!("{v} ")).collect();
    let four =
        "space dimension: 4\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0,0)\nencoding: ASCII";
    expect(&nrrd(four, text.as_bytes()), |p| p);
}

#[test]
fn a_colon_of_meta_image_is_an_equals_sign_and_a_byte_order_mark_is_none() {
    let dir = Dir::new();
    let head =
        "\u{feff}DimSize: 4 3 2\nNDims: 3\nElementType: MET_SHORT\nElementSpacing: 2 3 4\nElementDataFile: LOCAL\n";
    expect(&dir.save("a.mha", &[head.as_bytes(), &little()].concat()), |p| DVec3::new(2.0, 3.0, 4.0) * p);
}

#[test]
fn animations_are_no_slices() {
    use image::{Delay, Frame, RgbaImage};
    let dir = Dir::new();
    let gif = |count: usize| {
        let mut out = Vec::new();
        let mut encoder = image::codecs::gif::GifEncoder::new(&mut out);
        let frame = || Frame::from_parts(RgbaImage::new(4, 3), 0, 0, Delay::from_numer_denom_ms(100, 1));
        encoder.encode_frames((0..count).map(|_| frame())).unwrap();
        drop(encoder);
        out
    };
    let folder = |name: &str, bytes: &[u8]| {
        let folder = tempfile::tempdir_in(dir.0.path()).unwrap();
        for n in 0..2 {
            std::fs::write(folder.path().join(format!("{n}.{name}")), bytes).unwrap();
        }
        open(folder.path()).err().map(|e| e.to_string())
    };
    assert_eq!(folder("gif", &gif(1)), None);
    assert!(folder("gif", &gif(2)).unwrap().contains("animation"));
    let png = |animated: bool| {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, 4, 3);
        if animated {
            encoder.set_animated(2, 0).unwrap();
        }
        let mut writer = encoder.write_header().unwrap();
        (0..if animated { 2 } else { 1 }).for_each(|_| writer.write_image_data(&[7; 12]).unwrap());
        writer.finish().unwrap();
        out
    };
    assert_eq!(folder("png", &png(false)), None);
    assert!(folder("png", &png(true)).unwrap().contains("animation"));
}

#[test]
fn slices_that_are_parts_of_pictures_are_the_same_parts() {
    use exr::prelude::*;
    let dir = Dir::new();
    let save = |name: &str, at: (i32, i32)| {
        let list = AnyChannels::sort(std::iter::once(AnyChannel::new("Y", FlatSamples::F32(vec![1.0; 4]))).collect());
        let layer =
            Layer::new((2, 2), LayerAttributes::named("").with_position(at.into()), Encoding::UNCOMPRESSED, list);
        let attributes = ImageAttributes::new(IntegerBounds::from_dimensions((9, 9)));
        Image::from_layers(attributes, vec![layer]).write().to_file(dir.0.path().join(name)).unwrap();
    };
    save("s0.exr", (3, 4));
    save("s1.exr", (3, 4));
    assert_eq!(open(dir.0.path()).unwrap().samples.dims(), [2, 2, 2]);
    save("s1.exr", (4, 4));
    let said = error(dir.0.path());
    assert!(said.contains("from pixel (4, 4) on") && said.contains("from pixel (3, 4) on"), "{said}");
}

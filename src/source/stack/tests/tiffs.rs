//! TIFFs as microscopes and their programs write them: metadata, channels and frames, and every layout of samples.

use super::*;

enum Value {
    Short(Vec<u16>),
    Text(&'static str),
    Ratio(u32, u32),
}

/// A page: its tags and its one strip.
struct Page {
    tags: Vec<(u16, Value)>,
    data: Vec<u8>,
}

/// A little-endian TIFF of uncompressed pages of 2 × 2 pixels, but for what their tags say.
fn tiff(pages: &[Page]) -> Vec<u8> {
    let mut out = b"II*\0\0\0\0\0".to_vec();
    let mut link = 4;
    for page in pages {
        let strip = out.len() as u32;
        out.extend(&page.data);
        out.extend(vec![0; out.len() % 2]);
        let long = |v: u32| (4u16, 1u32, v.to_le_bytes().to_vec());
        let short = |list: &[u16]| (3, list.len() as u32, list.iter().flat_map(|v| v.to_le_bytes()).collect());
        let mut tags = std::collections::BTreeMap::from([
            (256u16, short(&[2])),
            (257, short(&[2])),
            (258, short(&[16])),
            (259, short(&[1])),
            (262, short(&[1])),
            (273, long(strip)),
            (277, short(&[1])),
            (278, short(&[2])),
            (279, long(page.data.len() as u32)),
        ]);
        for (tag, value) in &page.tags {
            let entry = match value {
                Value::Short(list) => short(list),
                Value::Text(text) => (2, text.len() as u32 + 1, [text.as_bytes(), b"\0"].concat()),
                Value::Ratio(a, b) => (5, 1, [a.to_le_bytes(), b.to_le_bytes()].concat()),
            };
            tags.insert(*tag, entry);
        }
        let mut directory = (tags.len() as u16).to_le_bytes().to_vec();
        for (tag, (kind, count, bytes)) in tags {
            directory.extend(tag.to_le_bytes());
            directory.extend(u16::to_le_bytes(kind));
            directory.extend(count.to_le_bytes());
            if bytes.len() <= 4 {
                directory.extend([bytes, vec![0; 4]].concat().iter().take(4));
            } else {
                directory.extend((out.len() as u32).to_le_bytes());
                out.extend(&bytes);
                out.extend(vec![0; out.len() % 2]);
            }
        }
        let at = (out.len() as u32).to_le_bytes();
        out[link..link + 4].copy_from_slice(&at);
        out.extend(directory);
        link = out.len();
        out.extend([0; 4]);
    }
    out
}

/// `count` pages whose pixels are all their number, the first with a description and .5 µm pixels.
fn numbered(count: u16, description: &'static str) -> Vec<u8> {
    let page = |n: u16| {
        let mut tags = Vec::new();
        if n == 0 {
            tags = vec![(270, Value::Text(description)), (282, Value::Ratio(2, 1)), (283, Value::Ratio(4, 1))];
        }
        Page { tags, data: [n; 4].iter().flat_map(|v| v.to_le_bytes()).collect() }
    };
    tiff(&(0..count).map(page).collect::<Vec<_>>())
}

/// The value of each slice, whose pixels are all the same.
fn slices(stack: &Stack) -> Vec<f32> {
    values(stack).chunks(4).map(|c| c[0]).collect()
}

const HYPERSTACK: &str =
    "ImageJ=1.53t\nimages=12\nchannels=2\nslices=3\nframes=2\nhyperstack=true\nspacing=3.0\nunit=um\n";

#[test]
fn imagej_says_how_far_and_which_channel_and_frame() {
    let dir = Dir::new();
    let path = dir.save("hyper.tif", &numbered(12, HYPERSTACK));
    let first = open(&path).unwrap();
    assert_eq!(slices(&first), [0.0, 2.0, 4.0]);
    let warnings = first.warnings.as_reasons();
    assert!(warnings.contains("2 channels") && warnings.contains("2 frames"), "{warnings}");
    let size = first.affine.matrix3 * DVec3::ONE;
    // .5 × .25 × 3 µm, in millimetres.
    assert!((size - DVec3::new(5e-4, 2.5e-4, 3e-3)).length() < 1e-12 && first.metres_per_unit == 1e-3, "{size}");
    let last = open_with(&path, Some("2"), Some(2)).unwrap();
    assert_eq!((slices(&last), last.warnings.is_empty()), (vec![7.0, 9.0, 11.0], true));
    for (channel, frame) in [(Some("3"), None), (None, Some(3)), (None, Some(0))] {
        assert!(open_with(&path, channel, frame).is_err());
    }
    // Another count of pages than the description's: all of them, with a warning.
    let odd = open(&dir.save("odd.tif", &numbered(5, HYPERSTACK))).unwrap();
    assert!(slices(&odd).len() == 5 && odd.warnings.as_reasons().contains("12 planes"));
    // A stack that was saved as a film.
    let film = open(&dir.save("film.tif", &numbered(4, "ImageJ=1.53t\nimages=4\nframes=4\n"))).unwrap();
    assert_eq!(slices(&film), [0.0, 1.0, 2.0, 3.0]);
    assert_eq!(film.metres_per_unit, 0.0);
}

#[test]
fn imagej_writes_large_stacks_behind_one_page() {
    let dir = Dir::new();
    let text = "ImageJ=1.53t\nimages=6\nchannels=2\nslices=3\nspacing=2\nunit=micron\n";
    let data: Vec<u8> = (0..24u16).flat_map(|n| (n / 4).to_le_bytes()).collect();
    let page = Page { tags: vec![(270, Value::Text(text))], data };
    let path = dir.save("large.tif", &tiff(&[page]));
    assert_eq!(slices(&open_with(&path, Some("2"), None).unwrap()), [1.0, 3.0, 5.0]);
    // More than the file is long.
    let text = "ImageJ=1.53t\nimages=6000\nslices=6000\nspacing=2\nunit=micron\n";
    let short = Page { tags: vec![(270, Value::Text(text))], data: vec![0; 16] };
    assert!(error(&dir.save("short.tif", &tiff(&[short]))).contains("no more follows"));
}

#[test]
fn ome_names_channels_and_orders_pages() {
    let dir = Dir::new();
    let text = "<?xml version=\"1.0\" encoding=\"UTF-8\"?><OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\"><Image \
        ID=\"Image:0\"><Pixels DimensionOrder=\"XYZCT\" SizeX=\"2\" SizeY=\"2\" SizeZ=\"3\" SizeC=\"2\" SizeT=\"1\" \
        PhysicalSizeX=\"0.5\" PhysicalSizeXUnit=\"\u{b5}m\" PhysicalSizeY=\"0.5\" PhysicalSizeZ=\"3.0\"><Channel Name=\"DAPI\"/>\
        <Channel Name=\"GFP\"/><TiffData IFD=\"0\" PlaneCount=\"6\"/></Pixels></Image></OME>";
    let path = dir.save("z.ome.tif", &numbered(6, text));
    let gfp = open_with(&path, Some("GFP"), None).unwrap();
    assert_eq!(slices(&gfp), [3.0, 4.0, 5.0]);
    let size = gfp.affine.matrix3 * DVec3::ONE;
    assert!((size - DVec3::new(5e-4, 5e-4, 3e-3)).length() < 1e-12, "{size}");
    assert!(open(&path).unwrap().warnings.as_reasons().contains("1 DAPI, 2 GFP"));
    let elsewhere = "<OME><Image><Pixels DimensionOrder=\"XYZCT\" SizeZ=\"2\"><TiffData IFD=\"0\"><UUID FileName=\"a.ome.tif\"/>\
        </TiffData><TiffData IFD=\"0\" FirstZ=\"1\"><UUID FileName=\"b.ome.tif\"/></TiffData></Pixels></Image></OME>";
    assert!(error(&dir.save("a.ome.tif", &numbered(2, elsewhere))).contains("b.ome.tif"));
}

#[test]
fn a_micro_sign_of_an_old_program_and_axes_without_names_are_understood() {
    let dir = Dir::new();
    // One byte in Latin-1, where the text has another one.
    let mut file = numbered(2, "ImageJ=1.33\nimages=2\nslices=2\nspacing=3.0\nunit=Um\n");
    let at = file.windows(2).position(|w| w == b"Um").unwrap();
    file[at] = 0xb5;
    let stack = open(&dir.save("latin.tif", &file)).unwrap();
    let size = stack.affine.matrix3 * DVec3::ONE;
    assert!((size - DVec3::new(5e-4, 2.5e-4, 3e-3)).length() < 1e-12 && stack.metres_per_unit == 1e-3, "{size}");
    // Two volumes of three slices, as an array of four axes is written.
    let path = dir.save("shaped.tif", &numbered(6, r#"{"shape": [2, 3, 2, 2]}"#));
    let first = open(&path).unwrap();
    assert_eq!(slices(&first), [0.0, 1.0, 2.0]);
    assert!(first.warnings.as_reasons().contains("2 frames"), "{}", first.warnings.as_reasons());
    assert_eq!(slices(&open_with(&path, None, Some(2)).unwrap()), [3.0, 4.0, 5.0]);
    // Where it does not agree with the pages, it is none of theirs.
    let other = open(&dir.save("other.tif", &numbered(5, r#"{"shape": [2, 3, 2, 2]}"#))).unwrap();
    assert_eq!((slices(&other).len(), other.warnings.is_empty()), (5, true));
}

/// A TIFF of one page with these tags.
fn one(dir: &Dir, tags: Vec<(u16, Value)>, data: &[u8]) -> Stack {
    open(&dir.save("one.tif", &tiff(&[Page { tags, data: data.to_vec() }]))).unwrap()
}

#[test]
fn every_layout_of_samples_is_read() {
    let dir = Dir::new();
    let short = |v: &[u16]| Value::Short(v.to_vec());
    // Half floats: 1, .5, 2, NaN.
    let half: Vec<u8> = [0x3c00u16, 0x3800, 0x4000, 0x7e00].iter().flat_map(|v| v.to_le_bytes()).collect();
    let stack = one(&dir, vec![(339, short(&[3]))], &half);
    assert_eq!(values(&stack)[..3], [1.0, 0.5, 2.0]);
    assert!(stack.samples.is_missing([1, 1, 0]));
    // Two samples that are no opacity, side by side and in planes.
    let two =
        |planar: u16| vec![(277, short(&[2])), (258, short(&[8, 8])), (338, short(&[0])), (284, short(&[planar]))];
    for (planar, data) in [(1, [1, 5, 2, 6, 3, 7, 4, 8]), (2, [1, 2, 3, 4, 5, 6, 7, 8])] {
        let page = Page { tags: two(planar), data: data.to_vec() };
        let mut file = tiff(&[page]);
        if planar == 2 {
            // Each plane is a strip.
            let page = Page { tags: two(2), data: data.to_vec() };
            file = planes(&page, 2);
        }
        let path = dir.save("two.tif", &file);
        assert_eq!(values(&open(&path).unwrap()), [1.0, 2.0, 3.0, 4.0], "{planar}");
        assert_eq!(values(&open_with(&path, Some("2"), None).unwrap()), [5.0, 6.0, 7.0, 8.0], "{planar}");
        assert!(open(&path).unwrap().warnings.as_reasons().contains("2 channels"));
    }
    // Colours in planes are colours.
    let tags = vec![(277, short(&[3])), (258, short(&[8; 3])), (262, short(&[2])), (284, short(&[2]))];
    let path = dir.save("rgb.tif", &planes(&Page { tags, data: vec![255, 0, 0, 0, 0, 255, 0, 0, 0, 0, 255, 0] }, 3));
    let stack = open(&path).unwrap();
    assert_eq!(
        [0, 1, 2, 3].map(|n| stack.samples.colour([n % 2, n / 2, 0])),
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]]
    );
    // Packed with Zstandard.
    let packed = zstd::encode_all(&[1u8, 0, 2, 0, 3, 0, 4, 0][..], 3).unwrap();
    assert_eq!(values(&one(&dir, vec![(259, short(&[50000]))], &packed)), [1.0, 2.0, 3.0, 4.0]);
    // Packed as nothing here unpacks: JPEG 2000, and what nobody knows.
    for method in [34712, 4711] {
        let page = Page { tags: vec![(259, short(&[method]))], data: vec![0; 64] };
        let said = error(&dir.save("packed.tif", &tiff(&[page])));
        assert!(said.contains("tiffcp -c zip") && !said.contains('\n'), "{said}");
    }
    // Single bits, a row at a time.
    assert_eq!(values(&one(&dir, vec![(258, short(&[1]))], &[0b1000_0000, 0b0100_0000])), [1.0, 0.0, 0.0, 1.0]);
    // White is zero: values are as stored.
    assert_eq!(values(&one(&dir, vec![(262, short(&[0]))], &[1, 0, 2, 0, 0, 1, 4, 0])), [1.0, 2.0, 256.0, 4.0]);
    assert_eq!(values(&one(&dir, vec![(262, short(&[0])), (258, short(&[8]))], &[1, 2, 3, 4])), [1.0, 2.0, 3.0, 4.0]);
}

/// What liblzma makes of the numbers 1, 2, 3, 4 of 16 bits, as libtiff calls it: with a delta filter of 2 bytes.
const BY_DELTA: &str = "fd377a585a000000ff12d94102010301012101161c4778560100070100010001000100000001180840a546ac06729e7a01\
    0000000000595a";
/// Of 1, 1, 3, 1 without a filter: the rows' differences of 1, 2 and 3, 4.
const DIFFERENCES: &str = "fd377a585a000000ff12d9410200210116000000742fe5a30100070100010003000100000001180840a546ac06729e7a\
    010000000000595a";
/// Of 1, 2, 3, 4, with a dictionary of 1 GiB.
const WIDE: &str = "fd377a585a000000ff12d94102002101240000005e1fc7f90100070100020003000400000001180840a546ac06729e7a01000000\
    0000595a";

fn bytes_of(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).unwrap()).collect()
}

#[test]
fn lzma_is_unpacked_within_the_memory() {
    let dir = Dir::new();
    let options = StackOptions::default();
    // The usual dictionary has 8 MiB.
    let open = |path: &Path| read(path, &options, 1 << 26);
    let error = |path: &Path| open(path).err().unwrap().to_string();
    let short = |v: &[u16]| Value::Short(v.to_vec());
    let page = |more: Vec<(u16, Value)>, data: &[u8]| Page {
        tags: std::iter::once((259, short(&[34925]))).chain(more).collect(),
        data: data.to_vec(),
    };
    let packed = bytes_of(BY_DELTA);
    // Two pages of one strip.
    let path = dir.save("two.tif", &tiff(&[page(vec![], &packed), page(vec![], &packed)]));
    assert_eq!(values(&open(&path).unwrap()), [1.0, 2.0, 3.0, 4.0].repeat(2));
    let path = dir.save("predicted.tif", &tiff(&[page(vec![(317, short(&[2]))], &bytes_of(DIFFERENCES))]));
    assert_eq!(values(&open(&path).unwrap()), [1.0, 2.0, 3.0, 4.0]);
    let path = dir.save("wide.tif", &tiff(&[page(vec![], &bytes_of(WIDE))]));
    assert!(error(&path).contains("takes more memory than is allowed"));
    assert_eq!(values(&read(&path, &options, 2 << 30).unwrap()), [1.0, 2.0, 3.0, 4.0]);
    // Cut short before its numbers end, and with any byte changed, it is an error of one line or other numbers.
    for end in 0..35 {
        let said = error(&dir.save("short.tif", &tiff(&[page(vec![], &packed[..end])])));
        assert!(said.contains("strip or tile 1, packed by LZMA,") && !said.contains('\n'), "{end}: {said}");
    }
    for at in 0..packed.len() {
        for flip in [1, 128] {
            let mut broken = packed.clone();
            broken[at] ^= flip;
            let path = dir.save("broken.tif", &tiff(&[page(vec![], &broken)]));
            assert!(open(&path).map_or_else(|e| !e.to_string().is_empty(), |stack| values(&stack).len() == 4));
        }
    }
    // A tile far larger than its page and the file.
    let tags = vec![(322, short(&[65535])), (323, short(&[65535])), (324, short(&[8])), (325, short(&[56]))];
    let mut large = page(tags, &packed);
    large.tags.extend([(256, short(&[1])), (257, short(&[1]))]);
    let mut file = tiff(&[large]);
    // Without the tags of strips, which tiles exclude.
    for tag in [273u16, 279] {
        let at = file.windows(2).rposition(|w| w == tag.to_le_bytes()).unwrap();
        file[at..at + 2].copy_from_slice(&(tag - 273 + 60000).to_le_bytes());
    }
    assert!(!error(&dir.save("tile.tif", &file)).is_empty());
}

/// A TIFF of one page whose data are as many strips as planes.
fn planes(page: &Page, count: usize) -> Vec<u8> {
    let mut out = b"II*\0\0\0\0\0".to_vec();
    out.extend(&page.data);
    out.extend(vec![0; out.len() % 2]);
    let size = page.data.len() / count;
    let lists: Vec<(u16, Vec<u32>)> =
        vec![(273, (0..count).map(|n| (8 + n * size) as u32).collect()), (279, vec![size as u32; count])];
    let mut tags: std::collections::BTreeMap<u16, (u16, Vec<u32>)> =
        [(256, 2), (257, 2), (259, 1), (262, 1), (278, 2)].map(|(tag, v)| (tag, (3, vec![v]))).into();
    tags.extend(lists.into_iter().map(|(tag, list)| (tag, (4, list))));
    for (tag, value) in &page.tags {
        let Value::Short(list) = value else { panic!("numbers alone") };
        tags.insert(*tag, (3, list.iter().map(|v| u32::from(*v)).collect()));
    }
    let mut directory = (tags.len() as u16).to_le_bytes().to_vec();
    for (tag, (kind, list)) in tags {
        let bytes: Vec<u8> =
            list.iter().flat_map(|v| v.to_le_bytes()[..if kind == 3 { 2 } else { 4 }].to_vec()).collect();
        directory.extend([tag, kind].iter().flat_map(|v| v.to_le_bytes()));
        directory.extend((list.len() as u32).to_le_bytes());
        if bytes.len() <= 4 {
            directory.extend([bytes, vec![0; 4]].concat().iter().take(4));
        } else {
            directory.extend((out.len() as u32).to_le_bytes());
            out.extend(bytes);
            out.extend(vec![0; out.len() % 2]);
        }
    }
    let at = (out.len() as u32).to_le_bytes();
    out[4..8].copy_from_slice(&at);
    out.extend(directory);
    out.extend([0; 4]);
    out
}

#[test]
fn a_jpeg_of_luma_and_chroma_is_in_colour() {
    let dir = Dir::new();
    let (side, colour) = (16u16, [200u8, 80, 40]);
    let mut jpeg = Vec::new();
    let pixels = colour.repeat(usize::from(side) * usize::from(side));
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 100)
        .encode(&pixels, side.into(), side.into(), image::ExtendedColorType::Rgb8)
        .unwrap();
    let short = |v: &[u16]| Value::Short(v.to_vec());
    let tags = vec![
        (256, short(&[side])),
        (257, short(&[side])),
        (278, short(&[side])),
        (258, short(&[8; 3])),
        (259, short(&[7])),
        (262, short(&[6])),
        (277, short(&[3])),
        (530, short(&[2, 2])),
    ];
    let stack = one(&dir, tags, &jpeg);
    let linear = colour.map(crate::scene::texture::srgb_to_linear);
    for at in [[0, 0, 0], [7, 9, 0], [15, 15, 0]] {
        let got = stack.samples.colour(at);
        // Chroma and coefficients are rounded to whole numbers: two steps of 255, which are .014 at the brightest.
        assert!(got.iter().zip(linear).all(|(a, b)| (a - b).abs() < 0.015), "{got:?} {linear:?}");
    }
}

#[test]
fn smaller_copies_of_a_page_are_no_slices() {
    let dir = Dir::new();
    let page = |reduced: u16, n: u8| Page {
        tags: vec![(254, Value::Short(vec![reduced]))],
        data: vec![n, 0, n, 0, n, 0, n, 0],
    };
    let stack = open(&dir.save("p.tif", &tiff(&[page(0, 1), page(1, 9), page(0, 2)]))).unwrap();
    assert_eq!(slices(&stack), [1.0, 2.0]);
    assert!(stack.warnings.as_reasons().contains("smaller copies"));
}

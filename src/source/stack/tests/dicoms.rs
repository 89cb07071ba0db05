//! DICOM series of several stacks, and what tells how stored numbers are meant.

use super::*;

pub type Element = (u16, u16, [u8; 2], Vec<u8>);

pub fn us(group: u16, element: u16, values: &[u16]) -> Element {
    (group, element, *b"US", values.iter().flat_map(|v| v.to_le_bytes()).collect())
}

pub fn text(group: u16, element: u16, kind: &[u8; 2], text: &str) -> Element {
    (group, element, *kind, text.as_bytes().to_vec())
}

fn put(out: &mut Vec<u8>, (group, element, kind, value): &Element) {
    let padded = [value.clone(), vec![if kind == b"OW" { 0 } else { b' ' }; value.len() % 2]].concat();
    out.extend([group.to_le_bytes(), element.to_le_bytes()].concat());
    out.extend(kind);
    if [b"OW", b"OB", b"OF", b"OD", b"SQ", b"OV"].contains(&kind) {
        out.extend([0, 0]);
        out.extend((padded.len() as u32).to_le_bytes());
    } else {
        out.extend((padded.len() as u16).to_le_bytes());
    }
    out.extend(padded);
}

/// A file of 2 × 2 pixels of 16 bits with these elements in place of, or besides, the usual ones.
pub fn file(syntax: &str, own: &[Element], pixels: Option<&[u8]>) -> Vec<u8> {
    let mut all: std::collections::BTreeMap<(u16, u16), Element> = std::collections::BTreeMap::new();
    let usual = [
        text(8, 0x60, b"CS", "MR"),
        text(0x18, 0x50, b"DS", "2"),
        text(0x20, 0x0e, b"UI", "1.2.7"),
        text(0x20, 0x11, b"IS", "7"),
        text(0x20, 0x37, b"DS", "1\\0\\0\\0\\1\\0"),
        us(0x28, 0x02, &[1]),
        text(0x28, 0x04, b"CS", "MONOCHROME2"),
        us(0x28, 0x10, &[2]),
        us(0x28, 0x11, &[2]),
        text(0x28, 0x30, b"DS", "1\\1"),
        us(0x28, 0x100, &[16]),
        us(0x28, 0x101, &[16]),
        us(0x28, 0x102, &[15]),
        us(0x28, 0x103, &[0]),
    ];
    for element in usual.iter().chain(own) {
        all.insert((element.0, element.1), element.clone());
    }
    let mut out = [vec![0; 128], b"DICM".to_vec()].concat();
    put(&mut out, &text(2, 0x10, b"UI", syntax));
    all.values().for_each(|element| put(&mut out, element));
    if let Some(pixels) = pixels {
        put(&mut out, &(0x7fe0, 0x10, *b"OW", pixels.to_vec()));
    }
    out
}

pub const PLAIN: &str = "1.2.840.10008.1.2.1";

pub fn numbers(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A slice at `z` whose pixels are all `value`, with more that is said of it.
fn slice(dir: &Dir, name: &str, z: f64, value: u16, more: &[Element]) {
    let own = [&[text(0x20, 0x32, b"DS", &format!("0\\0\\{z}"))], more].concat();
    dir.save(name, &file(PLAIN, &own, Some(&numbers(&[value; 4]))));
}

fn series(dir: &Dir, series: &str) -> Result<Stack> {
    read(dir.0.path(), &StackOptions { series: Some(series.into()), ..StackOptions::default() }, 1 << 20)
}

fn slices(stack: &Stack) -> Vec<f32> {
    values(stack).chunks(4).map(|c| c[0]).collect()
}

/// Stacks of a series whose slices differ by one attribute, three of 4 slices each, mixed file by file.
fn mixed(attribute: impl Fn(usize) -> Vec<Element>) -> Dir {
    let dir = Dir::new();
    for n in 0..12 {
        let (z, stack) = (n / 3, n % 3);
        let more = [attribute(stack), vec![text(0x20, 0x13, b"IS", &n.to_string())]].concat();
        slice(&dir, &format!("{n:02}.dcm"), 2.0 * z as f64, (100 * stack + z) as u16, &more);
    }
    dir
}

#[test]
fn a_series_of_several_stacks_gives_one_whole() {
    let number = |n: usize| n.to_string();
    let double = |v: f64| v.to_le_bytes().to_vec();
    type Elements = Box<dyn Fn(usize) -> Vec<Element>>;
    let segment = |n: usize| {
        let mut item = Vec::new();
        put(&mut item, &us(0x62, 0x0b, &[n as u16 + 1]));
        [vec![0xfe, 0xff, 0x00, 0xe0], (item.len() as u32).to_le_bytes().to_vec(), item].concat()
    };
    let cases: [(&str, Elements); 9] = [
        ("segment 1", Box::new(move |n| vec![(0x62, 0x0a, *b"SQ", segment(n))])),
        ("echo 1", Box::new(move |n| vec![text(0x18, 0x86, b"IS", &number(n + 1))])),
        ("echo time 30", Box::new(move |n| vec![text(0x18, 0x81, b"DS", &number(30 * (n + 1)))])),
        ("time 1", Box::new(move |n| vec![text(0x20, 0x100, b"IS", &number(n + 1))])),
        ("b 0", Box::new(move |n| vec![(0x18, 0x9087, *b"FD", double(500.0 * n as f64))])),
        ("acquisition 1", Box::new(move |n| vec![text(0x20, 0x12, b"IS", &number(n + 1))])),
        (
            "type ORIGINAL\\PRIMARY\\M",
            Box::new(|n| {
                vec![text(8, 8, b"CS", ["ORIGINAL\\PRIMARY\\M", "ORIGINAL\\PRIMARY\\P", "ORIGINAL\\PRIMARY\\R"][n])]
            }),
        ),
        ("volume 1", Box::new(move |n| vec![text(0x18, 0x1060, b"DS", &number(100 * n))])),
        ("volume 1", Box::new(|_| Vec::new())),
    ];
    for (label, attribute) in cases {
        let dir = mixed(attribute);
        let first = open(dir.0.path()).unwrap();
        assert_eq!(slices(&first), [0.0, 1.0, 2.0, 3.0], "{label}");
        assert_eq!(first.affine.matrix3.z_axis, DVec3::new(0.0, 0.0, 2.0));
        let warnings = first.warnings.as_reasons();
        assert!(warnings.contains("3 stacks") && warnings.contains(label), "{label}: {warnings}");
        let third = series(&dir, "7:3").unwrap();
        assert_eq!((slices(&third), third.warnings.is_empty()), (vec![200.0, 201.0, 202.0, 203.0], true), "{label}");
        assert_eq!(slices(&series(&dir, "1.2.7:2").unwrap()), [100.0, 101.0, 102.0, 103.0], "{label}");
        let frame = |n| read(dir.0.path(), &StackOptions { frame: Some(n), ..StackOptions::default() }, 1 << 20);
        assert_eq!(slices(&frame(2).unwrap()), [100.0, 101.0, 102.0, 103.0], "{label}");
        let wrong = frame(4).err().unwrap().to_string();
        assert!(wrong.contains("there are 1 to 3"), "{wrong}");
        let wrong = series(&dir, "7:4").err().unwrap().to_string();
        assert!(wrong.contains(label) && wrong.contains("4 slices"), "{wrong}");
    }
}

#[test]
fn numbers_that_count_the_slices_of_one_stack_part_nothing() {
    let dir = Dir::new();
    for z in 0..4u16 {
        let n = z.to_string();
        let more = [text(0x20, 0x12, b"IS", &n), text(0x20, 0x100, b"IS", &n), text(0x18, 0x1060, b"DS", &n)];
        slice(&dir, &format!("{z}.dcm"), 2.0 * f64::from(z), z, &more);
    }
    // A scout that lies another way, in the same series.
    slice(&dir, "scout.dcm", 1.0, 50, &[text(0x20, 0x37, b"DS", "1\\0\\0\\0\\0\\-1")]);
    let stack = open(dir.0.path()).unwrap();
    assert_eq!(slices(&stack), [0.0, 1.0, 2.0, 3.0]);
    assert!(stack.warnings.as_reasons().contains("coronal"), "{}", stack.warnings.as_reasons());
    std::fs::remove_file(dir.0.path().join("scout.dcm")).unwrap();
    assert!(open(dir.0.path()).unwrap().warnings.is_empty());
}

fn one(dir: &Dir, own: &[Element], pixels: &[u8]) -> Stack {
    open(&dir.save("one.dcm", &file(PLAIN, own, Some(pixels)))).unwrap()
}

#[test]
fn stored_numbers_mean_what_tables_and_padding_say() {
    let dir = Dir::new();
    let stored = numbers(&[10, 11, 12, 63536]);
    // Padding, also as a range, and rescaled.
    let own = [
        us(0x28, 0x120, &[63536]),
        us(0x28, 0x103, &[1]),
        text(0x28, 0x1053, b"DS", "2"),
        text(0x28, 0x1052, b"DS", "-5"),
    ];
    let stack = one(&dir, &own, &stored);
    assert_eq!(values(&stack)[..3], [15.0, 17.0, 19.0]);
    assert!(stack.samples.is_missing([1, 1, 0]) && !stack.samples.is_missing([0, 1, 0]));
    // A slope of 0 is none.
    let flat = one(&dir, &[text(0x28, 0x1053, b"DS", "0"), text(0x28, 0x1052, b"DS", "-5")], &stored);
    assert_eq!(values(&flat)[..3], [5.0, 6.0, 7.0]);
    assert!(flat.warnings.as_reasons().contains("Slope is 0"), "{}", flat.warnings.as_reasons());
    let range = one(&dir, &[us(0x28, 0x120, &[63000]), us(0x28, 0x121, &[65535])], &stored);
    assert!(range.samples.is_missing([1, 1, 0]) && !range.samples.is_missing([0, 1, 0]));
    // Otsu parts what is left: without padding it would part -2000 from the rest.
    let own = [us(0x28, 0x120, &[63536]), us(0x28, 0x103, &[1])];
    let source = StackSource::new(one(&dir, &own, &numbers(&[10, 10, 90, 63536])), &StackOptions::default()).unwrap();
    let note = source.notes().join(" ");
    assert!(note.contains("from 10 to 90"), "{note}");
    // A Modality LUT of three entries from 11 on.
    let mut item = Vec::new();
    put(&mut item, &us(0x28, 0x3002, &[3, 11, 16]));
    put(&mut item, &us(0x28, 0x3006, &[700, 800, 900]));
    let sequence = [vec![0xfe, 0xff, 0x00, 0xe0], (item.len() as u32).to_le_bytes().to_vec(), item].concat();
    let stack = one(&dir, &[(0x28, 0x3000, *b"SQ", sequence)], &numbers(&[10, 11, 12, 99]));
    assert_eq!(values(&stack), [700.0, 700.0, 800.0, 900.0]);
    // How a viewer shows them changes nothing.
    let stack = one(&dir, &[text(0x28, 4, b"CS", "MONOCHROME1")], &numbers(&[1, 2, 3, 4]));
    assert_eq!(values(&stack), [1.0, 2.0, 3.0, 4.0]);
    // Colours by a palette.
    let table = |n: u16, list: [u16; 2]| {
        [us(0x28, 0x1101 + n, &[2, 10, 16]), (0x28, 0x1201 + n, *b"OW", numbers(&list.map(|v| v << 8)))]
    };
    let own = [
        &table(0, [255, 0])[..],
        &table(1, [0, 255])[..],
        &table(2, [0, 0])[..],
        &[text(0x28, 4, b"CS", "PALETTE COLOR")],
    ]
    .concat();
    let stack = one(&dir, &own, &numbers(&[10, 11, 10, 11]));
    assert_eq!([stack.samples.colour([0, 0, 0]), stack.samples.colour([1, 0, 0])], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    // The same in segments: two values, and a line of three more that ends at full; a run of five; one that never ends.
    let segments =
        |n: u16, list: &[u16]| [us(0x28, 0x1101 + n, &[5, 10, 16]), (0x28, 0x1221 + n, *b"OW", numbers(list))];
    let red = segments(0, &[0, 2, 0x0000, 0x4000, 1, 3, 0xff00]);
    let with = |green: &[u16]| {
        let own = [&red[..], &segments(1, green)[..], &segments(2, &[0, 5, 0, 0, 0, 0, 0xff00])[..]].concat();
        [own, vec![text(0x28, 4, b"CS", "PALETTE COLOR")]].concat()
    };
    let stack = one(&dir, &with(&[0, 1, 0xff00, 1, 4, 0xff00]), &numbers(&[10, 12, 14, 13]));
    assert_eq!([stack.samples.colour([0, 0, 0]), stack.samples.colour([0, 1, 0])], [[0.0, 1.0, 0.0], [1.0; 3]]);
    // The high byte of 0x4000 + (0xff00 − 0x4000) / 3 is 127, of sRGB; .2122 is right to its digits.
    assert!((stack.samples.colour([1, 0, 0])[0] - 0.2122).abs() < 1e-4);
    for broken in [&[1, 4, 0xff00][..], &[0, 9, 1], &[2, 1, 0, 0], &[0, 1, 7]] {
        let file = file(PLAIN, &with(broken), Some(&numbers(&[10, 12, 14, 13])));
        let said = error(&dir.save("broken.dcm", &file));
        assert!(said.contains("segments"), "{said}");
    }
}

#[test]
fn floats_are_pixels_too() {
    let dir = Dir::new();
    let floats = [0.5f32, 1.5, f32::NAN, -2.0];
    let own = [us(0x28, 0x100, &[32]), (0x7fe0, 8, *b"OF", floats.iter().flat_map(|v| v.to_le_bytes()).collect())];
    let stack = open(&dir.save("f.dcm", &file(PLAIN, &own, None))).unwrap();
    assert_eq!(values(&stack)[..2], [0.5, 1.5]);
    assert!(stack.samples.is_missing([0, 1, 0]));
    let doubles = [0.5f64, 1.5, 2.5, -2.0];
    let own = [us(0x28, 0x100, &[64]), (0x7fe0, 9, *b"OD", doubles.iter().flat_map(|v| v.to_le_bytes()).collect())];
    assert_eq!(values(&open(&dir.save("d.dcm", &file(PLAIN, &own, None))).unwrap()), [0.5, 1.5, 2.5, -2.0]);
    let none = error(&dir.save("none.dcm", &file(PLAIN, &[], None)));
    assert!(none.contains("holds pixels"), "{none}");
}

#[test]
fn frames_in_several_pieces_are_joined_by_their_offsets_or_their_marks() {
    let dir = Dir::new();
    let jpeg = |value: u8| {
        let mut out = Vec::new();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut out, 100)
            .encode(&[value; 64], 8, 8, image::ExtendedColorType::L8)
            .unwrap();
        out.extend(vec![0; out.len() % 2]);
        out
    };
    let frames = [jpeg(40), jpeg(200)];
    for with_table in [true, false] {
        let mut pieces: Vec<u8> = Vec::new();
        let item = |bytes: &[u8]| {
            [vec![0xfe, 0xff, 0x00, 0xe0], (bytes.len() as u32).to_le_bytes().to_vec(), bytes.to_vec()].concat()
        };
        let mut offsets = Vec::new();
        for frame in &frames {
            offsets.extend((pieces.len() as u32).to_le_bytes());
            let (a, b) = frame.split_at(frame.len() / 4 * 2);
            pieces.extend([item(a), item(b)].concat());
        }
        let own = [
            text(0x28, 8, b"IS", "2"),
            us(0x28, 0x10, &[8]),
            us(0x28, 0x11, &[8]),
            us(0x28, 0x100, &[8]),
            us(0x28, 0x101, &[8]),
            us(0x28, 0x102, &[7]),
        ];
        let mut bytes = file("1.2.840.10008.1.2.4.50", &own, None);
        bytes.extend([0xe0, 0x7f, 0x10, 0x00, b'O', b'B', 0, 0, 0xff, 0xff, 0xff, 0xff]);
        bytes.extend(item(if with_table { &offsets } else { &[] }));
        bytes.extend(&pieces);
        bytes.extend([0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0]);
        let stack = open(&dir.save("j.dcm", &bytes)).unwrap();
        assert_eq!(stack.samples.dims(), [8, 8, 2]);
        let values = values(&stack);
        // One grey in all of a block: its coefficient is rounded to an eighth of a step.
        assert!((values[5] - 40.0).abs() <= 1.0 && (values[64 + 5] - 200.0).abs() <= 1.0, "{with_table}: {values:?}");
    }
}

//! Each format as it is written by hand, whole, cut short and broken.

use super::*;

#[test]
fn nrrd_attached_and_apart() {
    let dir = Dir::new();
    let head = |rest: &str| format!("{NRRD}{rest}").into_bytes();
    expect(&dir.save("raw.nrrd", &[head("encoding: raw\n\n"), little()].concat()), nrrd_place);
    expect(&dir.save("gz.nrrd", &[head("encoding: gzip\n\n"), gzip(&little())].concat()), nrrd_place);
    let text: Vec<String> = numbers().iter().map(i16::to_string).collect();
    expect(&dir.save("text.nrrd", &[head("encoding: ascii\n\n"), text.join(" ").into_bytes()].concat()), nrrd_place);
    dir.save("a.raw", &[vec![7; 5], little()].concat());
    let apart = dir.save("a.nhdr", &head("encoding: raw\nbyte skip: -1\ndata file: a.raw\n"));
    expect(&apart, nrrd_place);
    assert_eq!(files(&apart).len(), 2);
    // As an editor saves it: with a byte-order mark and carriage returns.
    let edited =
        String::from_utf8(head("encoding: raw\nbyte skip: -1\ndata file: a.raw\n")).unwrap().replace('\n', "\r\n");
    expect(&dir.save("edited.nhdr", format!("\u{feff}{edited}").as_bytes()), nrrd_place);
    for (n, slice) in little().chunks(24).enumerate() {
        dir.save(&format!("s{n:02}.raw"), slice);
    }
    expect(&dir.save("list.nhdr", &head("encoding: raw\ndata file: LIST\ns00.raw\ns01.raw\n")), nrrd_place);
    expect(&dir.save("count.nhdr", &head("encoding: raw\ndata file: s%02d.raw 0 1 1\n")), nrrd_place);
}

#[test]
fn metaimage_local_packed_and_apart() {
    let dir = Dir::new();
    let head = |rest: &str| {
        format!(
            "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementType = MET_SHORT\nElementSpacing = 2 3 4\n\
             TransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 10 20 30\n{rest}"
        )
        .into_bytes()
    };
    expect(&dir.save("a.mha", &[head("ElementDataFile = LOCAL\n"), little()].concat()), nrrd_place);
    let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    zlib.write_all(&little()).unwrap();
    let packed = zlib.finish().unwrap();
    expect(
        &dir.save("z.mha", &[head("CompressedData = True\nElementDataFile = LOCAL\n"), packed].concat()),
        nrrd_place,
    );
    let big: Vec<u8> = numbers().iter().flat_map(|v| v.to_be_bytes()).collect();
    dir.save("b.raw", &big);
    let apart = dir.save("b.mhd", &head("BinaryDataByteOrderMSB = True\nElementDataFile = b.raw\n"));
    expect(&apart, nrrd_place);
    assert_eq!(files(&apart).len(), 2);
    let bad = dir.save("n.mha", &[head("ElementDataFile = LOCAL\n"), little()].concat());
    let text = std::fs::read_to_string(&bad).unwrap().replace("2 3 4", "2 -3 4");
    assert!(error(&dir.save("n.mha", text.as_bytes())).contains("above 0"));
}

/// A NIfTI-1 header with the sform of `nrrd_place`.
fn nifti(magic: &[u8; 4], offset: f32) -> Vec<u8> {
    let mut h = vec![0u8; 352];
    let mut put = |at: usize, bytes: &[u8]| h[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    for (n, d) in [3i16, 4, 3, 2, 1, 1, 1, 1].iter().enumerate() {
        put(40 + 2 * n, &d.to_le_bytes());
    }
    put(70, &4i16.to_le_bytes());
    put(72, &16i16.to_le_bytes());
    for (n, d) in [1f32, 2.0, 3.0, 4.0].iter().enumerate() {
        put(76 + 4 * n, &d.to_le_bytes());
    }
    put(108, &offset.to_le_bytes());
    put(123, &[2]);
    put(254, &1i16.to_le_bytes());
    for (n, v) in [0f32, -3.0, 0.0, 10.0, 2.0, 0.0, 0.0, 20.0, 0.0, 0.0, 4.0, 30.0].iter().enumerate() {
        put(280 + 4 * n, &v.to_le_bytes());
    }
    put(344, magic);
    h
}

/// A FreeSurfer header with the place of `nrrd_place`: its middle is at (2, 1.5, 1) of the indices.
fn freesurfer() -> Vec<u8> {
    let ints = [1i32, 4, 3, 2, 1, 4, 0].map(i32::to_be_bytes).concat();
    let directions = [0f32, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let floats = [&[2f32, 3.0, 4.0], &directions[..], &[5.5, 24.0, 34.0]].concat();
    let mut h = [ints, vec![0, 1], floats.iter().flat_map(|v| v.to_be_bytes()).collect()].concat();
    h.resize(284, 0);
    h
}

#[test]
fn freesurfer_plain_and_packed() {
    let dir = Dir::new();
    let big: Vec<u8> = numbers().iter().flat_map(|v| v.to_be_bytes()).collect();
    // What follows the samples is of no interest.
    let whole = [freesurfer(), big.clone(), b"tags".to_vec()].concat();
    expect(&dir.save("a.mgh", &whole), nrrd_place);
    expect(&dir.save("a.mgz", &gzip(&whole)), nrrd_place);
    let mut nowhere = freesurfer();
    nowhere[29] = 0;
    let stack = open(&dir.save("n.mgh", &[nowhere, big.clone()].concat())).unwrap();
    assert_eq!(stack.affine.matrix3 * DVec3::new(1.0, 2.0, 3.0), DVec3::new(-1.0, 3.0, -2.0));
    assert!(stack.warnings.iter().any(|(text, _)| text.contains("how it lies")));
    let with = |at: usize, byte: u8| {
        let mut h = freesurfer();
        h[at] = byte;
        error(&dir.save("w.mgh", &[h, big.clone()].concat()))
    };
    assert!(with(3, 2).contains("version 1") && with(23, 7).contains("data type 7") && with(7, 0).contains("0×3×2"));
    for cut in [0, 3, 100, 283, 290] {
        error(&dir.save("c.mgh", &whole[..cut]));
        error(&dir.save("c.mgz", &gzip(&whole)[..cut.min(60)]));
    }
}

#[test]
fn zarr_is_refused_with_what_to_do() {
    let dir = Dir::new();
    for name in ["zarr.json", ".zattrs"] {
        let folder = dir.0.path().join(name.trim_start_matches('.').replace("json", "x"));
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(folder.join(name), "{}").unwrap();
        let error = error(&folder);
        assert!(error.contains("OME-Zarr") && error.contains("tifffile"), "{error}");
    }
}

#[test]
fn nifti_alone_packed_and_in_pairs() {
    let dir = Dir::new();
    let whole = [nifti(b"n+1\0", 352.0), little()].concat();
    expect(&dir.save("a.nii", &whole), nrrd_place);
    expect(&dir.save("a.nii.gz", &gzip(&whole)), nrrd_place);
    let header = dir.save("p.hdr", &nifti(b"ni1\0", 0.0)[..348]);
    assert!(error(&header).contains(".img"));
    let image = dir.save("p.img", &little());
    expect(&header, nrrd_place);
    expect(&image, nrrd_place);
    assert_eq!(files(&image), [header, image]);
    // The quaternion of a quarter turn about z instead: (cos 45°, 0, 0, sin 45°).
    let mut turned = whole;
    turned[254] = 0;
    turned[252] = 1;
    turned[264..268].copy_from_slice(&0.5f32.sqrt().to_le_bytes());
    for (n, v) in [10f32, 20.0, 30.0].iter().enumerate() {
        turned[268 + 4 * n..272 + 4 * n].copy_from_slice(&v.to_le_bytes());
    }
    expect(&dir.save("q.nii", &turned), nrrd_place);
    // Slope and intercept.
    turned[112..116].copy_from_slice(&0.5f32.to_le_bytes());
    turned[116..120].copy_from_slice(&7f32.to_le_bytes());
    assert_eq!(values(&open(&dir.save("s.nii", &turned)).unwrap())[23], 0.5 * 123.0 + 7.0);
}

#[test]
fn folders_count_as_people_do_and_hold_one_kind() {
    use std::cmp::Ordering::{Greater, Less};
    assert_eq!(natural::natural("slice2.png", "slice10.png"), Less);
    assert_eq!(natural::natural("a10b2", "a10b10"), Less);
    assert_eq!(natural::natural("b1", "a2"), Greater);
    assert_eq!(natural::natural("07", "7"), Less);
    let dir = Dir::new();
    let png = |name: &str, width: u32, value: u16| {
        let image = image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(width, 2, image::Luma([value]));
        image::DynamicImage::from(image).save(dir.0.path().join(name)).unwrap();
    };
    for n in [10, 9, 1] {
        png(&format!("s{n}.png"), 3, n);
    }
    dir.save("notes.txt", b"text");
    let stack = open(dir.0.path()).unwrap();
    assert_eq!(stack.samples.dims(), [3, 2, 3]);
    assert_eq!(values(&stack).iter().step_by(6).copied().collect::<Vec<_>>(), [1.0, 9.0, 10.0]);
    assert!(!stack.warnings.is_empty());
    png("s11.png", 4, 1);
    let text = error(dir.0.path());
    assert!(text.contains("s11.png") && text.contains("4×2") && text.contains("3×2"), "{text}");
    dir.save("s12.jpg", b"");
    assert!(error(dir.0.path()).contains("1 .jpg, 4 .png"));
}

/// A DICOM file of 2 × 2 pixels in explicit little endian.
fn dicom(series: &str, position: [f64; 3], instance: u32, value: i16) -> Vec<u8> {
    let mut out = vec![0; 128];
    out.extend(b"DICM");
    let mut put = |group: u16, element: u16, kind: &[u8; 2], value: &[u8]| {
        out.extend(group.to_le_bytes());
        out.extend(element.to_le_bytes());
        out.extend(kind);
        if kind == b"OW" {
            out.extend([0, 0]);
            out.extend((value.len() as u32).to_le_bytes());
        } else {
            out.extend(((value.len() + value.len() % 2) as u16).to_le_bytes());
        }
        out.extend(value);
        if value.len() % 2 == 1 {
            out.push(b' ');
        }
    };
    put(2, 0x10, b"UI", b"1.2.840.10008.1.2.1");
    put(8, 0x60, b"CS", b"CT");
    put(0x18, 0x50, b"DS", b"5");
    put(0x20, 0x0e, b"UI", series.as_bytes());
    put(0x20, 0x11, b"IS", series.rsplit('.').next().unwrap().as_bytes());
    put(0x20, 0x13, b"IS", instance.to_string().as_bytes());
    put(0x20, 0x32, b"DS", position.map(|v| v.to_string()).join("\\").as_bytes());
    put(0x20, 0x37, b"DS", b"1\\0\\0\\0\\1\\0");
    put(0x28, 0x02, b"US", &1u16.to_le_bytes());
    put(0x28, 0x04, b"CS", b"MONOCHROME2");
    for (element, v) in [(0x10, 2u16), (0x11, 2), (0x100, 16), (0x101, 12), (0x102, 11), (0x103, 1)] {
        if element == 0x100 {
            put(0x28, 0x30, b"DS", b"0.5\\0.25");
        }
        put(0x28, element, b"US", &v.to_le_bytes());
    }
    put(0x28, 0x1052, b"DS", b"-1000");
    put(0x28, 0x1053, b"DS", b"2");
    // Rubbish in the four bits that are not the number's.
    let pixel = (value & 0x0fff) | 0x3000;
    put(0x7fe0, 0x10, b"OW", &[pixel, 1, 2, 3].iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>());
    out
}

#[test]
fn dicom_is_sorted_rescaled_and_sheared_as_its_positions_say() {
    let dir = Dir::new();
    // A gantry that leans: y moves by 1 where z moves by 3.
    for (n, name) in [(0, "c"), (1, "a"), (2, "d"), (3, "b")] {
        let at = [5.0, 6.0 + f64::from(n), 7.0 + 3.0 * f64::from(n)];
        dir.save(name, &dicom("1.2.3", at, 9 - n as u32, if n == 0 { -3 } else { n as i16 }));
    }
    dir.save("LICENSE", b"text");
    let stack = open(dir.0.path()).unwrap();
    assert_eq!(stack.samples.dims(), [2, 2, 4]);
    assert_eq!(values(&stack).iter().step_by(4).copied().collect::<Vec<_>>(), [-1006.0, -998.0, -996.0, -994.0]);
    let p = stack.affine.transform_point3(DVec3::new(1.0, 1.0, 2.0));
    assert!((p - DVec3::new(5.25, 6.0 + 0.5 + 2.0, 13.0)).length() < 1e-12, "{p}");
    let warnings = stack.warnings.as_reasons();
    assert!(warnings.contains("18.43°") && warnings.contains("not DICOM"), "{warnings}");
    assert_eq!(stack.metres_per_unit, 1e-3);

    dir.save("e", &dicom("1.2.4", [0.0; 3], 1, 1));
    let text = error(dir.0.path());
    assert!(text.contains("2 series") && text.contains("UID 1.2.3") && text.contains("UID 1.2.4"), "{text}");
    let choose = |series: &str| StackOptions { series: Some(series.into()), ..StackOptions::default() };
    assert_eq!(read(dir.0.path(), &choose("1.2.4"), 99).unwrap().samples.dims(), [2, 2, 1]);
    assert_eq!(read(dir.0.path(), &choose("3"), 99).unwrap().samples.dims(), [2, 2, 4]);
    assert!(read(dir.0.path(), &choose("8"), 99).err().unwrap().to_string().contains("UID 1.2.4"));
    // One slice is a slab as thick as it says.
    let one = open(&dir.0.path().join("e")).unwrap();
    assert_eq!(one.affine.matrix3.z_axis, DVec3::new(0.0, 0.0, 5.0));
    std::fs::remove_file(dir.0.path().join("e")).unwrap();
    std::fs::remove_file(dir.0.path().join("a")).unwrap();
    assert!(error(dir.0.path()).contains("not evenly apart"));
}

#[test]
fn broken_files_are_refused_and_never_panic() {
    let dir = Dir::new();
    let nrrd = [format!("{NRRD}encoding: raw\n\n").into_bytes(), little()].concat();
    let packed = [format!("{NRRD}encoding: gzip\n\n").into_bytes(), gzip(&little())].concat();
    let meta = b"NDims = 3\nDimSize = 4 3 2\nElementType = MET_SHORT\nElementDataFile = LOCAL\n".to_vec();
    let whole = [nifti(b"n+1\0", 352.0), little()].concat();
    let samples: Vec<(&str, Vec<u8>)> = vec![
        ("a.nrrd", nrrd.clone()),
        ("z.nrrd", packed),
        ("a.mha", [meta, little()].concat()),
        ("a.nii", whole.clone()),
        ("z.nii.gz", gzip(&whole)),
        ("a.dcm", dicom("1.2.3", [0.0; 3], 1, 5)),
    ];
    for (name, bytes) in &samples {
        assert!(open(&dir.save(name, bytes)).is_ok(), "{name}");
        for cut in 0..bytes.len() {
            // A DICOM file may end between elements, gzip before its checksum.
            let _ = open(&dir.save(name, &bytes[..cut]));
        }
        for at in (0..bytes.len()).step_by(3) {
            let mut wrong = bytes.clone();
            for flip in [0xff, 0x01] {
                wrong[at] ^= flip;
                let _ =
                    open(&dir.save(name, &wrong)).map(|s| StackSource::new(s, &StackOptions::default()).map(|_| ()));
                wrong[at] ^= flip;
            }
        }
    }
    let lie = |from: &str, to: &str| {
        let text = NRRD.replace(from, to);
        error(&dir.save("lie.nrrd", &[format!("{text}encoding: raw\n\n").into_bytes(), little()].concat()))
    };
    assert!(lie("sizes: 4 3 2", "sizes: 1000000000 1000000000 1000000000").contains("not a size"));
    assert!(lie("sizes: 4 3 2", "sizes: 400 300 200").contains("cut short, or lies"));
    assert!(lie("sizes: 4 3 2", "sizes: 4 -3 2").contains("line 5"));
    assert!(lie("(0,2,0)", "(0,0,0)").contains("span no space"));
    assert!(lie("(0,2,0)", "(-3,0,0)").contains("span no space"));
    assert!(lie("(0,2,0)", "(nan,2,0)").contains("space directions"));
    let bomb = [NRRD.replace("4 3 2", "4000 3000 2000").into_bytes(), b"encoding: gzip\n\n".to_vec(), gzip(&[0; 9999])];
    assert!(error(&dir.save("bomb.nrrd", &bomb.concat())).contains("cut short, or lies"));
    let none = dir.save("nan.nrrd", &{
        let text = NRRD.replace("short", "float").replace("4 3 2", "2 2 1");
        let values = [f32::NAN, 1.0, f32::INFINITY, 3.0];
        [format!("{text}encoding: raw\n\n").into_bytes(), values.iter().flat_map(|v| v.to_le_bytes()).collect()]
            .concat()
    });
    let source = StackSource::new(open(&none).unwrap(), &StackOptions::default()).unwrap();
    assert!(source.warnings().as_reasons().contains("2 × samples without a value"));
    assert!(!source.bounds().is_empty());
}

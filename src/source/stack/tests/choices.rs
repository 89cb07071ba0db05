//! Files of more than three axes, folders of channels and EXRs of many parts: one volume is taken, and all are listed.

use super::*;

/// Bytes of volumes of 4 × 3 × 2 whose samples are those of [`numbers`] plus 1000 per volume.
fn volumes(count: i16) -> Vec<u8> {
    (0..count).flat_map(|n| numbers().into_iter().flat_map(move |v| (v + 1000 * n).to_le_bytes())).collect()
}

/// Which of [`volumes`] was read; all of it has to be one.
fn volume(stack: &Stack) -> i16 {
    let values: Vec<i16> = values(stack).iter().map(|v| *v as i16).collect();
    let n = values[0] / 1000;
    assert_eq!(values, numbers().iter().map(|v| v + 1000 * n).collect::<Vec<_>>());
    n
}

fn nrrd(fields: &str, data: &[u8]) -> Vec<u8> {
    [format!("NRRD0004\ntype: short\nendian: little\n{fields}\n\n").into_bytes(), data.to_vec()].concat()
}

#[test]
fn four_axes_of_nrrd_are_frames_wherever_they_stand() {
    let dir = Dir::new();
    // As SimpleITK writes it: four axes of a space of four.
    let itk = "dimension: 4\nspace dimension: 4\nsizes: 4 3 2 3\nspace directions: (0,2,0,0) (-3,0,0,0) (0,0,4,0) (0,0,0,1)\n\
        kinds: domain domain domain domain\nencoding: gzip\nspace origin: (10,20,30,0)";
    let path = dir.save("itk.nrrd", &nrrd(itk, &gzip(&volumes(3))));
    let first = open(&path).unwrap();
    assert_eq!((volume(&first), first.samples.dims()), (0, [4, 3, 2]));
    assert!(first.warnings.as_reasons().contains("3 frames"), "{}", first.warnings.as_reasons());
    assert_eq!(first.affine.transform_point3(DVec3::ONE), DVec3::new(7.0, 22.0, 34.0));
    let third = open_with(&path, None, Some(3)).unwrap();
    assert_eq!((volume(&third), third.warnings.is_empty()), (2, true));
    assert!(open_with(&path, None, Some(4)).err().unwrap().to_string().contains("1 to 3"));
    // As Slicer writes sequences: the list comes first, sample by sample.
    let mixed: Vec<u8> =
        numbers().into_iter().flat_map(|v| (0..3).flat_map(move |n| (v + 1000 * n).to_le_bytes())).collect();
    let list = "dimension: 4\nsizes: 3 4 3 2\nspace: left-posterior-superior\n\
        space directions: none (1,0,0) (0,1,0) (0,0,1)\nkinds: list domain domain domain\nencoding: raw";
    assert_eq!(volume(&open_with(&dir.save("list.nrrd", &nrrd(list, &mixed)), None, Some(2)).unwrap()), 1);
    // The same axis of another kind counts channels; three of them without a kind are colours.
    let vector = list.replace("kinds: list", "kinds: 3-vector");
    let path = dir.save("vector.nrrd", &nrrd(&vector, &mixed));
    assert_eq!(volume(&open_with(&path, Some("3"), None).unwrap()), 2);
    assert!(open(&path).unwrap().warnings.as_reasons().contains("3 channels"));
    let colour = open(&dir.save("rgb.nrrd", &nrrd(&list.replace("kinds: list", "kinds: RGB-color"), &mixed))).unwrap();
    assert!(colour.samples.has_colour() && colour.warnings.is_empty());
    // An axis in the midst.
    let midst = list.replace("none (1,0,0) (0,1,0)", "(1,0,0) none (0,1,0)").replace("list domain", "domain list");
    assert!(error(&dir.save("midst.nrrd", &nrrd(&midst, &mixed))).contains("put it first or last"));
}

#[test]
fn volumes_in_other_files_and_from_the_end() {
    let dir = Dir::new();
    let head = "dimension: 4\nsizes: 4 3 2 2\nspacings: 1 1 1 1\nkinds: domain domain domain domain\n";
    dir.save("all.raw", &[vec![9; 7], volumes(2)].concat());
    let end = dir.save("end.nhdr", &nrrd(&format!("{head}byte skip: -1\nencoding: raw\ndata file: all.raw"), &[]));
    assert_eq!([None, Some(2)].map(|f| volume(&open_with(&end, None, f).unwrap())), [0, 1]);
    for (n, slice) in volumes(2).chunks(24).enumerate() {
        dir.save(&format!("s{n}.gz"), &gzip(slice));
    }
    let list = format!("{head}encoding: gzip\ndata file: LIST\ns0.gz\ns1.gz\ns2.gz\ns3.gz");
    let list = dir.save("list.nhdr", &nrrd(&list, &[]));
    assert_eq!([None, Some(2)].map(|f| volume(&open_with(&list, None, f).unwrap())), [0, 1]);
    let words: Vec<String> = volumes(2).chunks(2).map(|b| i16::from_le_bytes([b[0], b[1]]).to_string()).collect();
    let text = dir.save("text.nrrd", &nrrd(&format!("{head}encoding: ascii"), words.join(" ").as_bytes()));
    assert_eq!(volume(&open_with(&text, None, Some(2)).unwrap()), 1);
    // From the end of what is packed: nobody says where that is.
    let skip = format!("{head}byte skip: -1\nencoding: gzip\ndata file: s0.gz");
    let error = error(&dir.save("skip.nhdr", &nrrd(&skip, &[])));
    assert!(error.contains("byte skip -1") && error.contains("line 8"), "{error}");
}

#[test]
fn metaimage_and_nifti_choose_as_well() {
    let dir = Dir::new();
    let head =
        |rest: &str| format!("NDims = 4\nDimSize = 4 3 2 3\nElementType = MET_SHORT\n{rest}ElementDataFile = LOCAL\n");
    let path = dir.save("a.mha", &[head("").into_bytes(), volumes(3)].concat());
    assert_eq!([None, Some(2), Some(3)].map(|f| volume(&open_with(&path, None, f).unwrap())), [0, 1, 2]);
    let two = head("ElementNumberOfChannels = 2\n").replace("2 3\n", "2 1\n");
    let mixed: Vec<u8> = numbers().into_iter().flat_map(|v| [v, v + 1000].map(i16::to_le_bytes).concat()).collect();
    let path = dir.save("c.mha", &[two.into_bytes(), mixed].concat());
    assert_eq!([None, Some("2")].map(|c| volume(&open_with(&path, c, None).unwrap())), [0, 1]);
    // NIfTI: two times of two components.
    let mut nifti = vec![0u8; 352];
    nifti[..4].copy_from_slice(&348i32.to_le_bytes());
    for (n, v) in [5i16, 4, 3, 2, 2, 2].iter().enumerate() {
        nifti[40 + 2 * n..][..2].copy_from_slice(&v.to_le_bytes());
    }
    nifti[70..72].copy_from_slice(&4i16.to_le_bytes());
    (1..4).for_each(|n| nifti[76 + 4 * n..][..4].copy_from_slice(&1f32.to_le_bytes()));
    nifti[108..112].copy_from_slice(&352f32.to_le_bytes());
    nifti[344..348].copy_from_slice(b"n+1\0");
    nifti.extend(volumes(4));
    for (name, bytes) in [("a.nii", nifti.clone()), ("b.nii.gz", gzip(&nifti))] {
        let path = dir.save(name, &bytes);
        let all = [(None, None), (Some("1"), Some(2)), (Some("2"), Some(1)), (Some("2"), Some(2))];
        assert_eq!(all.map(|(c, f)| volume(&open_with(&path, c, f).unwrap())), [0, 1, 2, 3], "{name}");
        let warnings = open(&path).unwrap().warnings.as_reasons();
        assert!(warnings.contains("2 frames") && warnings.contains("2 channels"), "{warnings}");
    }
}

/// A picture of 2 × 2 pixels of one value.
fn picture(value: u8) -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    image::GrayImage::from_pixel(2, 2, image::Luma([value])).write_to(&mut out, image::ImageFormat::Png).unwrap();
    out.into_inner()
}

fn slices(stack: &Stack) -> Vec<f32> {
    values(stack).chunks(4).map(|c| c[0]).collect()
}

#[test]
fn folders_hold_channels_by_name_and_by_folder() {
    let dir = Dir::new();
    for (z, c) in [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)] {
        dir.save(&format!("cell_z{z}_ch{c}.png"), &picture(10 * c + z));
    }
    let first = open(dir.0.path()).unwrap();
    assert_eq!(slices(&first), [0.0, 1.0, 2.0]);
    assert!(first.warnings.as_reasons().contains("2 channels"), "{}", first.warnings.as_reasons());
    assert_eq!(slices(&open_with(dir.0.path(), Some("2"), None).unwrap()), [10.0, 11.0, 12.0]);
    let dir = Dir::new();
    for (c, name) in ["green", "red"].iter().enumerate() {
        std::fs::create_dir(dir.0.path().join(name)).unwrap();
        (0..3).for_each(|z| drop(dir.save(&format!("{name}/{z}.png"), &picture(10 * c as u8 + z))));
    }
    assert_eq!(slices(&open(dir.0.path()).unwrap()), [0.0, 1.0, 2.0]);
    assert_eq!(slices(&open_with(dir.0.path(), Some("red"), None).unwrap()), [10.0, 11.0, 12.0]);
    assert_eq!(files(dir.0.path()).len(), 6);
    let none = open_with(dir.0.path(), Some("blue"), None).err().unwrap().to_string();
    assert!(none.contains("1 green, 2 red"), "{none}");
    // Of a colour picture, one of its colours.
    let dir = Dir::new();
    let mut out = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(2, 2, image::Rgb([3, 5, 7])).write_to(&mut out, image::ImageFormat::Png).unwrap();
    let path = dir.save("a.png", &out.into_inner());
    assert_eq!(slices(&open_with(&path, Some("green"), None).unwrap()), [5.0]);
}

#[test]
fn parts_of_an_exr_are_slices_and_layers_are_channels() {
    use exr::prelude::*;
    let dir = Dir::new();
    let part = |name: &str, channels: &[(&str, f32)]| {
        let list = channels.iter().map(|(n, v)| AnyChannel::new(*n, FlatSamples::F32(vec![*v; 4]))).collect();
        let attributes = LayerAttributes::named(name);
        Layer::new((2, 2), attributes, Encoding::UNCOMPRESSED, AnyChannels::sort(list))
    };
    let save = |name: &str, layers: Vec<Layer<AnyChannels<FlatSamples>>>| {
        let path = dir.0.path().join(name);
        let attributes = ImageAttributes::new(IntegerBounds::from_dimensions((2, 2)));
        Image::from_layers(attributes, layers).write().to_file(&path).unwrap();
        path
    };
    let parts = [(10, 3.0), (2, 1.0), (9, 2.0)].map(|(n, v)| part(&format!("s{n}"), &[("Y", v)]));
    let stack = open(&save("parts.exr", parts.to_vec())).unwrap();
    assert_eq!((slices(&stack), stack.warnings.is_empty()), (vec![1.0, 2.0, 3.0], true), "by their numbers");
    // Parts that are not alike: one kind is taken.
    let path = save("kinds.exr", vec![part("colour", &[("Y", 1.0)]), part("depth", &[("Z", 5.0)])]);
    assert_eq!(slices(&open(&path).unwrap()), [1.0]);
    assert_eq!(slices(&open_with(&path, Some("depth"), None).unwrap()), [5.0]);
    assert!(open(&path).unwrap().warnings.as_reasons().contains("1 colour, 2 depth"));
    // Layers in one part.
    let path = save("layers.exr", vec![part("", &[("R", 1.0), ("G", 1.0), ("B", 1.0), ("Z", 7.0), ("mask.Y", 4.0)])]);
    assert!(open(&path).unwrap().samples.has_colour());
    assert_eq!(slices(&open_with(&path, Some("Z"), None).unwrap()), [7.0]);
    assert_eq!(slices(&open_with(&path, Some("mask"), None).unwrap()), [4.0]);
}

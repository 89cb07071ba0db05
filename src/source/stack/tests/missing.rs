//! Samples without a value are empty, whatever the format and the transfer function.

use super::*;

/// Edge of the lattice, in samples.
const N: usize = 12;

/// A block of 6³ samples of values from 3.2 on in the middle; `empty` around it.
fn thresholded_map(empty: f32) -> Vec<f32> {
    (0..N * N * N)
        .map(|i| {
            let at = [i % N, i / N % N, i / N / N];
            if at.iter().all(|c| (3..9).contains(c)) { 3.2 + 0.1 * at[0] as f32 } else { empty }
        })
        .collect()
}

fn bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// The values as a stack of every format that can hold them.
fn stacks(dir: &Dir, name: &str, values: &[f32]) -> Vec<PathBuf> {
    let header = format!("NRRD0004\ntype: float\ndimension: 3\nsizes: {N} {N} {N}\nspacings: 1 1 1\nendian: little\n");
    let nrrd = [format!("{header}encoding: raw\n\n").into_bytes(), bytes(values)].concat();
    let words: Vec<String> = values.iter().map(f32::to_string).collect();
    let text = [format!("{header}encoding: ascii\n\n"), words.join(" ")].concat();
    let meta = format!("NDims = 3\nDimSize = {N} {N} {N}\nElementType = MET_FLOAT\nElementDataFile = LOCAL\n");
    let mut nifti = vec![0u8; 352];
    nifti[..4].copy_from_slice(&348i32.to_le_bytes());
    for (n, side) in [3, N as i16, N as i16, N as i16].iter().enumerate() {
        nifti[40 + 2 * n..][..2].copy_from_slice(&side.to_le_bytes());
    }
    nifti[70..72].copy_from_slice(&16i16.to_le_bytes());
    for n in 1..4 {
        nifti[76 + 4 * n..][..4].copy_from_slice(&1f32.to_le_bytes());
    }
    nifti[108..112].copy_from_slice(&352f32.to_le_bytes());
    nifti[344..348].copy_from_slice(b"n+1\0");
    nifti.extend(bytes(values));
    let mut tiff = std::io::Cursor::new(Vec::new());
    let mut encoder = tiff::encoder::TiffEncoder::new(&mut tiff).unwrap();
    let slices = dir.0.path().join(name);
    std::fs::create_dir(&slices).unwrap();
    for (n, slice) in values.chunks(N * N).enumerate() {
        encoder.write_image::<tiff::encoder::colortype::Gray32Float>(N as u32, N as u32, slice).unwrap();
        let pixel = |x: usize, y: usize| (slice[y * N + x], slice[y * N + x], slice[y * N + x]);
        exr::prelude::write_rgb_file(slices.join(format!("{n:02}.exr")), N, N, pixel).unwrap();
    }
    vec![
        dir.save(&format!("{name}.nrrd"), &nrrd),
        dir.save(&format!("{name}_text.nrrd"), text.as_bytes()),
        dir.save(&format!("{name}.mha"), &[meta.into_bytes(), bytes(values)].concat()),
        dir.save(&format!("{name}.nii"), &nifti),
        dir.save(&format!("{name}.nii.gz"), &gzip(&nifti)),
        dir.save(&format!("{name}.tif"), &tiff.into_inner()),
        slices,
    ]
}

fn source(path: &Path, transfer: TransferSpec) -> StackSource {
    let options = StackOptions { transfer, spacing: Some([1.0; 3]), ..StackOptions::default() };
    StackSource::new(read(path, &options, 1 << 20).unwrap(), &options).unwrap()
}

#[test]
fn a_thresholded_map_is_the_same_with_nan_and_with_zeros() {
    let dir = Dir::new();
    let (nan, zero) = (stacks(&dir, "nan", &thresholded_map(f32::NAN)), stacks(&dir, "zero", &thresholded_map(0.0)));
    for (nan, zero) in nan.iter().zip(&zero) {
        for transfer in [TransferSpec::hard(3.0), TransferSpec::window(2.0, 4.0), TransferSpec::window(3.0, 9.0)] {
            let (a, b) = (source(nan, transfer.clone()), source(zero, transfer.clone()));
            assert_eq!(a.bounds(), b.bounds(), "{} {transfer:?}", nan.display());
            // Nearer to the block's samples than to those around it.
            assert!(a.bounds().min.cmpgt(DVec3::splat(2.0)).all() && a.bounds().max.cmplt(DVec3::splat(9.0)).all());
            assert!(a.warnings().as_reasons().contains("samples without a value"));
        }
    }
}

#[test]
fn otsu_parts_only_the_values_that_there_are() {
    let dir = Dir::new();
    // Two classes, 3.5 to 3.7 and 4.1 to 4.3, among far more samples of no value.
    let values: Vec<f32> =
        thresholded_map(f32::NAN).iter().enumerate().map(|(i, v)| if i % N < 6 { v - 0.1 } else { v + 0.2 }).collect();
    for path in stacks(&dir, "otsu", &values) {
        let source = source(&path, TransferSpec::default());
        let note = source.notes().join(" ");
        let threshold: f64 = note.split([' ', ':']).nth(3).unwrap().parse().unwrap();
        assert!((3.6..4.0).contains(&threshold), "{}: {note}", path.display());
        // The upper half of the block alone.
        assert!(source.bounds().min.x > 5.0 && source.bounds().max.x < 9.0, "{:?}", source.bounds());
    }
}

#[test]
fn values_below_zero_and_tables_without_an_empty_value_leave_nan_out_too() {
    let dir = Dir::new();
    let values: Vec<f32> = thresholded_map(f32::NAN).iter().map(|v| v - 10.0).collect();
    let negative = &stacks(&dir, "negative", &values)[0];
    // Everything that has a value is above -7.
    let hard = source(negative, TransferSpec::hard(-7.0));
    assert!(hard.bounds().min.cmpgt(DVec3::splat(2.0)).all() && hard.bounds().max.cmplt(DVec3::splat(9.0)).all());
    // Opacity everywhere, least where values are great: no value stands for nothing.
    let table = r#"{"points": [{"value": -7, "opacity": 0.5}, {"value": -6, "opacity": 0.2}]}"#;
    let soft = source(negative, serde_json::from_str(table).unwrap());
    let place = crate::source::placement::Placement {
        bounds: crate::geom::Aabb::new(DVec3::splat(-0.5), DVec3::splat(11.5)),
        transform: DAffine3::IDENTITY,
        scale: 16.0 / 12.0,
        depth: 4,
        up: 2,
        cyclic: [false; 3],
        memory: u64::MAX,
    };
    let staged = soft.stage(&place, &crate::progress::Quiet).unwrap();
    let mut count = 0;
    for region in 0..staged.regions().len() {
        staged.medium(region, &mut |m| {
            count += 1;
            // The block's cells, 2.5 to 8.5, are voxels 4 to 12.
            assert!(m.at.iter().all(|c| (4..12).contains(c)), "{:?}", m.at);
        });
    }
    assert_eq!(count, 8 * 8 * 8);
}

#[test]
fn a_stack_of_nothing_but_nan_says_so() {
    let dir = Dir::new();
    let path = &stacks(&dir, "none", &[f32::NAN; N * N * N])[0];
    let error = StackSource::new(open(path).unwrap(), &StackOptions::default()).err().unwrap();
    assert!(error.to_string().contains("none of its samples has a value"), "{error}");
}

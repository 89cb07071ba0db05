//! Files of curves written by hand: what they hold arrives, and what is wrong with them is said where it is.

use proptest::prelude::*;

use super::*;

fn error(result: Result<Content, Fault>) -> String {
    let (at, what) = result.err().unwrap();
    format!("{at}: {what}")
}

#[test]
fn a_table_is_read_by_its_names_in_any_order() {
    let text = "x;y;z;T;Strand;width;R;G;B;note\n\
                1;2;3;1;b;0.4;255;0;51;last\n\
                0;0;0;0;a;0.2;0;0;0;\n\
                4;5;6;0;\"b\";;0;255;0;first\n";
    let content = csv::read(text).unwrap();
    assert_eq!(content.strands.len(), 2);
    let b = &content.strands[0];
    assert_eq!(b.points, [DVec3::new(4.0, 5.0, 6.0), DVec3::new(1.0, 2.0, 3.0)]);
    assert!(b.radii[0].is_nan() && b.radii[1] == 0.2);
    assert!((b.colours[1][2] - 0.2).abs() < 1e-6 && b.colours[1][0] == 1.0);
    assert_eq!(content.warnings.as_reasons(), "; 1 × columns of other names are ignored");
}

#[test]
fn tables_without_names_and_with_blanks_or_tabs() {
    for text in
        ["1 0 0.5 1 2\n1 1 3 4 5\n", "1\t0\t0.5\t1\t2\n\n# more\n1\t1\t3\t4\t5", "  1  0  0.5  1  2  \r\n1 1 3 4 5\r\n"]
    {
        let content = csv::read(text).unwrap();
        assert_eq!(content.strands[0].points, [DVec3::new(0.5, 1.0, 2.0), DVec3::new(3.0, 4.0, 5.0)], "{text}");
    }
    let content = csv::read("x,y,z,r\n1,2,3,4\n").unwrap();
    assert_eq!(content.strands[0].radii, [4.0]);
    assert!(csv::read("").unwrap().strands.is_empty());
}

#[test]
fn a_table_is_faulted_by_line_and_column() {
    assert_eq!(error(csv::read("id,x,y,z\n1,2,3,4\n1,2,thre,4\n")), "line 3, column 5: y is `thre` and not a number");
    assert!(error(csv::read("id,x,y,z\n1,2,3\n")).starts_with("line 2, column 6: 3 values"));
    assert!(error(csv::read("id,x,y\n1,2,3\n")).starts_with("line 1: no column is named z"));
    assert!(error(csv::read("x,y,z,x\n1,2,3,4\n")).contains("second"));
    assert!(error(csv::read("1,2\n")).starts_with("line 1: 2 columns"));
    let gaps = csv::read("x,y,z\n1,,3\n1,2,3\n").unwrap();
    assert_eq!((gaps.strands[0].points.len(), gaps.warnings.is_empty()), (1, false));
}

/// Two strands of 2 and 3 points with every array.
fn hair(flags: u32) -> Vec<u8> {
    let mut out = b"HAIR".to_vec();
    [2u32, 5, flags, 0].iter().for_each(|v| out.extend(v.to_le_bytes()));
    [0.5f32, 0.25, 0.1, 0.2, 0.3].iter().for_each(|v| out.extend(v.to_le_bytes()));
    out.resize(128, 0);
    let mut floats = |on: u32, values: Vec<f32>| {
        if flags & on != 0 {
            values.iter().for_each(|v| out.extend(v.to_le_bytes()));
        }
    };
    if flags & 1 != 0 {
        // As one float of these bytes.
        floats(1, vec![f32::from_le_bytes([1, 0, 2, 0])]);
    }
    floats(2, (0..15).map(|v| v as f32).collect());
    floats(4, (0..5).map(|v| v as f32).collect());
    floats(8, vec![0.0, 0.5, 1.0, 0.0, 0.0]);
    floats(16, (0..15).map(|v| v as f32 / 15.0).collect());
    out
}

#[test]
fn hair_with_and_without_its_arrays() {
    let full = hair::read(&hair(31)).unwrap();
    assert_eq!(full.strands.len(), 2);
    let second = &full.strands[1];
    assert_eq!(second.points[0], DVec3::new(6.0, 7.0, 8.0));
    assert_eq!(second.radii, [1.0, 1.5, 2.0]);
    assert_eq!(second.colours[0], [6.0 / 15.0, 7.0 / 15.0, 8.0 / 15.0, 0.0]);
    let bare = hair::read(&hair(3)).unwrap();
    assert_eq!(bare.strands[1].radii, [0.25]);
    assert_eq!(bare.strands[1].colours, [[0.1, 0.2, 0.3, 0.75]]);
    let mut even = hair(2);
    assert!(error(hair::read(&even)).contains("2 strands of 0 segments are not 5 points"));
    even[4] = 1;
    even[16] = 4;
    assert_eq!(hair::read(&even).unwrap().strands[0].points.len(), 5);
    assert!(error(hair::read(&hair(1))).contains("no array of points"));
    let mut lies = hair(31);
    lies[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(error(hair::read(&lies)).contains("ends too early"));
    lies[8..12].copy_from_slice(&6u32.to_le_bytes());
    assert!(error(hair::read(&lies)).contains("the strands have 5 points"));
    lies[12] = 2;
    lies[16] = 1;
    lies[4..8].copy_from_slice(&0x7fff_ffffu32.to_le_bytes());
    lies[8..12].copy_from_slice(&0xffff_fffeu32.to_le_bytes());
    assert!(error(hair::read(&lies)).contains("ends too early"));
}

/// A tract file of one tract of two points.
fn trk(big_endian: bool, order: &[u8; 4], affine: [[f32; 4]; 4]) -> Vec<u8> {
    let mut out = vec![0u8; 1000];
    out[..5].copy_from_slice(b"TRACK");
    let mut put = |at: usize, bytes: &[u8]| {
        let mut bytes = bytes.to_vec();
        if big_endian {
            bytes.reverse();
        }
        out[at..at + bytes.len()].copy_from_slice(&bytes);
    };
    [4u16, 5, 6].iter().enumerate().for_each(|(i, v)| put(6 + 2 * i, &v.to_le_bytes()));
    [2.0f32, 3.0, 1.0].iter().enumerate().for_each(|(i, v)| put(12 + 4 * i, &v.to_le_bytes()));
    put(36, &3u16.to_le_bytes());
    put(238, &1u16.to_le_bytes());
    affine.iter().flatten().enumerate().for_each(|(i, v)| put(440 + 4 * i, &v.to_le_bytes()));
    put(988, &1u32.to_le_bytes());
    put(996, &1000u32.to_le_bytes());
    out[38..46].copy_from_slice(b"colors\x003");
    out[948..952].copy_from_slice(order);
    let mut add = |bytes: [u8; 4]| {
        out.extend(if big_endian { bytes.into_iter().rev().collect::<Vec<_>>() } else { bytes.to_vec() })
    };
    add(2u32.to_le_bytes());
    for v in [1.0f32, 1.5, 0.5, 255.0, 0.0, 51.0, 3.0, 4.5, 1.5, 0.0, 0.0, 0.0, 9.0] {
        add(v.to_le_bytes());
    }
    out
}

#[test]
fn tracts_are_placed_as_their_header_says() {
    // Voxels of 2 × 3 × 1 mm from (10, 20, 30) on.
    let affine = [[2.0, 0.0, 0.0, 10.0], [0.0, 3.0, 0.0, 20.0], [0.0, 0.0, 1.0, 30.0], [0.0, 0.0, 0.0, 1.0]];
    for big_endian in [false, true] {
        let content = trk::read(&trk(big_endian, b"RAS\0", affine)).unwrap();
        let strand = &content.strands[0];
        // The first point is the middle of the first voxel.
        assert_eq!(strand.points, [DVec3::new(10.0, 20.0, 30.0), DVec3::new(12.0, 23.0, 31.0)]);
        assert_eq!(strand.colours[0], [1.0, 0.0, 0.2, 1.0]);
        assert_eq!(content.metres_per_unit, 1e-3);
    }
    // Stored left, posterior, superior: from the last of 4 and of 5 voxels backwards.
    let turned = trk::read(&trk(false, b"LPS\0", affine)).unwrap();
    assert_eq!(turned.strands[0].points, [DVec3::new(16.0, 32.0, 30.0), DVec3::new(14.0, 29.0, 31.0)]);
    // Where no order is said TrackVis has just that one.
    let unsaid = trk::read(&trk(false, b"\0\0\0\0", affine)).unwrap();
    assert_eq!(unsaid.strands[0].points, turned.strands[0].points);
    assert!(unsaid.warnings.as_reasons().contains("LPS is taken") && turned.warnings.is_empty());
    let none = trk::read(&trk(false, b"LPS\0", [[0.0; 4]; 4])).unwrap();
    assert!(!none.warnings.is_empty());
}

#[test]
fn broken_tracts_are_told() {
    let whole = trk(false, b"RAS\0", [[1.0; 4]; 4]);
    assert!(error(trk::read(&whole[..1020])).contains("ends too early"));
    assert!(error(trk::read(&whole[..500])).contains("byte"));
    assert!(error(trk::read(b"TRICK")).contains("begins with TRACK"));
    let mut many = whole.clone();
    many[1000..1004].copy_from_slice(&0x7fff_ffffu32.to_le_bytes());
    assert!(error(trk::read(&many)).contains("ends too early"));
    let mut short = whole.clone();
    short[988] = 9;
    assert!(trk::read(&short).unwrap().warnings.as_reasons().contains("8 × tracts"));
}

#[test]
fn mrtrix_tracts_in_four_kinds_of_numbers() {
    let points =
        [[1.0f64, 2.0, 3.0], [4.0, 5.0, 6.0], [f64::NAN; 3], [7.0, 8.0, 9.0], [f64::NAN; 3], [f64::INFINITY; 3]];
    for kind in ["Float32LE", "Float32BE", "Float64LE", "Float64BE"] {
        let header = format!("mrtrix tracks\ncount: 2\ndatatype: {kind}\nfile: . 100\nEND\n");
        let mut bytes = header.into_bytes();
        bytes.resize(100, 0);
        for v in points.iter().flatten() {
            match kind {
                "Float32LE" => bytes.extend((*v as f32).to_le_bytes()),
                "Float32BE" => bytes.extend((*v as f32).to_be_bytes()),
                "Float64LE" => bytes.extend(v.to_le_bytes()),
                _ => bytes.extend(v.to_be_bytes()),
            }
        }
        let content = tck::read(&bytes).unwrap();
        assert_eq!(content.strands.len(), 2, "{kind}");
        assert_eq!(content.strands[0].points[1], DVec3::new(4.0, 5.0, 6.0));
        assert!(content.warnings.is_empty());
        let cut = bytes.len() - 30;
        assert!(tck::read(&bytes[..cut]).is_err() || !tck::read(&bytes[..cut]).unwrap().warnings.is_empty());
    }
    let bad = |text: &str| error(tck::read(text.as_bytes()));
    assert!(bad("mrtrix tracks\ndatatype: Int8\nEND\n").starts_with("line 2: datatype Int8"));
    assert!(bad("mrtrix tracks\nfile: other 5\nEND\n").starts_with("line 2: `file: other 5`"));
    assert!(bad("mrtrix tracks\ndatatype: Float32LE\nfile: . 9999\nEND\n").contains("begin at byte 9999"));
    assert!(bad("mrtrix tracks\n").contains("no line END"));
    assert!(bad("mrtrix image\n").starts_with("line 1"));
}

#[test]
fn a_neuron_becomes_its_branches() {
    let text = "# a comment\n1 1 0 0 0 5 -1\n2 3 10 0 0 2 1\n3 3 20 0 0 1 2\n4 3 10 10 0 .5 2\n5 1 99 0 0 7 -1\n";
    let content = swc::read(text).unwrap();
    let sizes: Vec<usize> = content.strands.iter().map(|s| s.points.len()).collect();
    assert_eq!(sizes, [1, 3, 2, 1]);
    assert_eq!(content.strands[0].radii, [5.0], "a cell body of one point is a ball");
    assert_eq!(content.strands[1].radii, [2.0, 2.0, 1.0], "what grows out of it is not as wide as it");
    assert_eq!(content.strands[2].radii, [0.5, 0.5]);
    assert_eq!(content.metres_per_unit, 1e-6);
    let error = |t: &str| error(swc::read(t));
    assert!(error("1 1 0 0 0\n").starts_with("line 1: 5 words"));
    assert!(error("1 1 0 0 x 1 -1\n").starts_with("line 1: z is `x`"));
    assert!(error("1 1 0 0 0 1 -1\n1 1 0 0 0 1 -1\n").starts_with("line 2: node 1"));
    let ring = swc::read("1 1 0 0 0 1 2\n2 1 1 0 0 1 1\n3 1 0 0 0 1 77\n").unwrap();
    assert_eq!((ring.strands.len(), ring.warnings.is_empty()), (1, false));
}

#[test]
fn a_cell_body_of_three_points_is_a_cylinder() {
    // As NeuroMorpho.org writes it: as long as it is wide.
    let text = "1 1 10 0 0 5 -1\n2 1 10 -5 0 5 1\n3 1 10 5 0 5 1\n4 3 20 0 0 1 1\n5 3 30 0 0 1 4\n";
    let content = swc::read(text).unwrap();
    let points: Vec<Vec<DVec3>> = content.strands.iter().map(|s| s.points.clone()).collect();
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    assert_eq!(
        points,
        [vec![at(10.0, -5.0), at(10.0, 0.0), at(10.0, 5.0)], vec![at(10.0, 0.0), at(20.0, 0.0), at(30.0, 0.0)]]
    );
    assert_eq!((&content.strands[0].radii[..], &content.strands[1].radii[..]), (&[5.0][..], &[1.0, 1.0, 1.0][..]));
    // Another shape of three points stays the cones that it is.
    let bent = swc::read(&text.replace("10 5 0", "13 9 0")).unwrap();
    assert_eq!(bent.strands.iter().map(|s| s.points.len()).collect::<Vec<_>>(), [2, 2, 3]);
}

#[test]
fn radii_that_were_not_measured_are_filled_in() {
    let content = swc::read("1 3 0 0 0 2 -1\n2 3 1 0 0 0 1\n3 3 2 0 0 -1 2\n").unwrap();
    assert_eq!(content.strands[0].radii, [2.0; 3]);
    assert!(content.warnings.as_reasons().contains("2 × nodes without a radius"));
    let dir = tempfile::tempdir().unwrap();
    use crate::source::traits::Source;
    let options = TrajectoryOptions { width: Some(0.5), ..TrajectoryOptions::default() };
    for (name, text) in [("a.swc", "1 3 0 0 0 0 -1\n2 3 9 0 0 0 1\n"), ("a.csv", "x,y,z,radius\n0,0,0,0\n9,0,0,0\n")] {
        std::fs::write(dir.path().join(name), text).unwrap();
        let source = read(&dir.path().join(name), 1 << 20, &options).unwrap();
        assert!((source.facet_size() - 0.5).abs() < 1e-6, "{name}");
    }
    // A chain of nodes that name their parents below them, none with a radius but the last.
    let n = 50_000;
    let chain: String = (1..n).map(|i| format!("{i} 3 {i} 0 0 0 {}\n", i + 1)).collect();
    let content = swc::read(&format!("{chain}{n} 3 0 0 0 1 -1\n")).unwrap();
    assert_eq!(content.strands[0].radii, vec![1.0; n]);
}

#[test]
fn marks_and_broken_lines_are_read() {
    let dir = tempfile::tempdir().unwrap();
    for (name, text) in [("a.csv", "x,y,\\\nz\n1,2,3\n4,5,6\n"), ("a.swc", "1 3 1 2 3 \\\r\n1 -1\n2 3 4 5 6 1 1\n")] {
        let path = dir.path().join(name);
        for bytes in [
            format!("\u{feff}{text}").into_bytes(),
            [255, 254].into_iter().chain(text.encode_utf16().flat_map(u16::to_le_bytes)).collect(),
        ] {
            std::fs::write(&path, bytes).unwrap();
            let source =
                read(&path, 1 << 20, &TrajectoryOptions { width: Some(0.1), ..TrajectoryOptions::default() }).unwrap();
            use crate::source::traits::Source;
            assert!((source.bounds().centre() - DVec3::new(2.5, 3.5, 4.5)).length() < 1e-6, "{name}");
            assert!(source.bounds().size().x > 2.9, "{name}");
        }
    }
    let mut tracts = "\u{feff}mrtrix tracks\ndatatype: Float32LE\nfile: . 80\nEND\n".as_bytes().to_vec();
    tracts.resize(80, 0);
    [[1.0f32, 2.0, 3.0], [4.0, 5.0, 6.0], [f32::NAN; 3], [f32::INFINITY; 3]]
        .iter()
        .flatten()
        .for_each(|v| tracts.extend(v.to_le_bytes()));
    assert_eq!(tck::read(&tracts).unwrap().strands[0].points.len(), 2);
}

#[test]
fn far_from_0_points_are_what_they_are_near_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.csv");
    use crate::source::traits::Source;
    let source = |x: f64| {
        std::fs::write(&path, format!("x,y,z,r\n{:.3},0,0,.01\n{:.3},1,0,.01\n", x - 0.123, x + 0.777)).unwrap();
        read(&path, 1 << 20, &TrajectoryOptions::default()).unwrap()
    };
    let (near, far) = (source(0.0), source(5_411_932.0));
    assert_eq!((near.origin(), near.notes().len()), (DVec3::ZERO, 0));
    assert_eq!((far.origin(), far.notes().len()), (DVec3::new(5_411_932.0, 0.0, 0.0), 1));
    assert_eq!(far.bounds(), near.bounds());
}

#[test]
fn packed_files_are_unpacked_within_the_limit() {
    use std::io::Write;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.TRK.gz");
    let affine = [[2.0, 0.0, 0.0, 10.0], [0.0, 3.0, 0.0, 20.0], [0.0, 0.0, 1.0, 30.0], [0.0, 0.0, 0.0, 1.0]];
    let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packer.write_all(&trk(false, b"RAS\0", affine)).unwrap();
    let packed = packer.finish().unwrap();
    std::fs::write(&path, &packed).unwrap();
    assert_eq!(extension(&path), "trk");
    assert!(read(&path, 1 << 20, &TrajectoryOptions::default()).is_ok());
    assert!(matches!(read(&path, 900, &TrajectoryOptions::default()), Err(Error::Limit { .. })));
    std::fs::write(&path, &packed[..packed.len() - 9]).unwrap();
    assert!(read(&path, 1 << 20, &TrajectoryOptions::default()).unwrap_err().to_string().contains("gzip"));
}

/// A TRX archive of two tracts of 2 and 1 points.
fn trx_file(kind: &str, closed: bool) -> Vec<u8> {
    use std::io::Write;
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let mut add = |name: &str, bytes: &[u8]| {
        let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
        zip.start_file(name, options).unwrap();
        zip.write_all(bytes).unwrap();
    };
    add("header.json", br#"{"DIMENSIONS":[1,1,1],"NB_VERTICES":3,"NB_STREAMLINES":2}"#);
    let values = (0..9).map(|i| 0.5 * f64::from(i));
    let positions: Vec<u8> = match kind {
        "float16" => values.flat_map(|v| half::f16::from_f64(v).to_le_bytes()).collect(),
        "float32" => values.flat_map(|v| (v as f32).to_le_bytes()).collect(),
        _ => values.flat_map(f64::to_le_bytes).collect(),
    };
    add(&format!("positions.3.{kind}"), &positions);
    let starts: &[u64] = if closed { &[0, 2, 3] } else { &[0, 2] };
    add("offsets.uint64", &starts.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    add("dpv/color.3.uint8", &[255, 0, 51, 0, 0, 0, 255, 255, 255]);
    zip.finish().unwrap().into_inner()
}

#[test]
fn trx_archives_in_three_kinds_of_numbers() {
    for kind in ["float16", "float32", "float64"] {
        for closed in [false, true] {
            let content = trx::read(&trx_file(kind, closed), 1 << 20).unwrap();
            assert_eq!(content.strands.len(), 2, "{kind}");
            assert_eq!(content.strands[0].points, [DVec3::new(0.0, 0.5, 1.0), DVec3::new(1.5, 2.0, 2.5)]);
            assert_eq!(content.strands[0].colours[0], [1.0, 0.0, 0.2, 1.0]);
            assert_eq!(content.metres_per_unit, 1e-3);
        }
    }
    let whole = trx_file("float32", true);
    assert!(error(trx::read(&whole, 100)).contains("raise option `memory`"));
    assert!(error(trx::read(&whole[..200], 1 << 20)).contains("zip archive"));
    assert!(error(trx::read(&trx_file("float128", true), 1 << 20)).contains("float128"));
}

#[test]
fn widths_that_are_missing_are_filled_in() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.csv");
    std::fs::write(&path, "x,y,z\n0,0,0\n0,100,0\n").unwrap();
    let source = read(&path, 1 << 20, &TrajectoryOptions::default()).unwrap();
    use crate::source::traits::Source;
    assert!((source.facet_size() - 0.2).abs() < 1e-6);
    assert!(source.warnings().as_reasons().contains("0.2 is taken"));
    let options = TrajectoryOptions { width: Some(4.0), width_scale: 0.5, ..TrajectoryOptions::default() };
    let source = read(&path, 1 << 20, &options).unwrap();
    assert!((source.facet_size() - 2.0).abs() < 1e-6 && source.warnings().is_empty());
    assert!(matches!(read(&path, 10, &options), Err(Error::Limit { .. })));
    std::fs::write(&path, "x,y,z\n").unwrap();
    assert!(read(&path, 1 << 20, &options).unwrap_err().to_string().contains("no point"));
}

proptest! {
    /// Whatever is cut off or changed: an answer, and no panic.
    #[test]
    fn damage_is_survived(kind in 0..6usize, cut in 0.0f64..1.0, at in 0.0f64..1.0, value in any::<u8>()) {
        let mut bytes = match kind {
            0 => hair(31),
            1 => trk(false, b"RAS\0", [[1.0; 4]; 4]),
            2 => b"mrtrix tracks\ndatatype: Float32LE\nfile: . 60\nEND\n0123456789012345678901234567890123456789".to_vec(),
            5 => trx_file("float16", true),
            3 => b"id,t,x,y,z\n1,2,3,4,5\n\"1\",3,3,3,3\n".to_vec(),
            _ => b"1 1 0 0 0 5 -1\n2 3 10 0 0 2 1\n3 3 20 0 0 1 2\n".to_vec(),
        };
        let i = ((bytes.len() - 1) as f64 * at) as usize;
        bytes[i] = value;
        bytes.truncate((bytes.len() as f64 * (0.2 + cut)) as usize);
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let _ = hair::read(&bytes);
        let _ = trk::read(&bytes);
        let _ = tck::read(&bytes);
        let _ = trx::read(&bytes, 1 << 20);
        let _ = csv::read(&text);
        let _ = swc::read(&text);
    }
}

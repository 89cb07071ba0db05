//! Tiny files that claim to hold much: counts of a TIFF's directories, directories within one another, packed profiles of a PNG.
//! None takes memory for what is not there.

use std::io::{Cursor, Write as _};
use std::path::Path;

use vtex::scene::raster::Raster;

use crate::memory::{alone, peak};
use crate::run::{Command, run};
use crate::seeds::put;
use crate::small;

/// What a file of a few bytes may take: tables of the program, and messages.
const LITTLE: usize = 4 << 20;

/// A TIFF of one or two pages of one pixel, whose last page's entry `tag` counts so many `values`.
fn tiff(is_big: bool, big_endian: bool, pages: usize, tag: u16, values: u64) -> Vec<u8> {
    let mut file = if big_endian { b"MM".to_vec() } else { b"II".to_vec() };
    let number = |file: &mut Vec<u8>, value: u64, width: usize| {
        let bytes =
            if big_endian { value.to_be_bytes()[8 - width..].to_vec() } else { value.to_le_bytes()[..width].to_vec() };
        file.extend(bytes);
    };
    let (wide, head) = if is_big { (8, 8) } else { (4, 2) };
    if is_big {
        [43, 8, 0].into_iter().for_each(|v| number(&mut file, v, 2));
    } else {
        number(&mut file, 42, 2);
    }
    let first = file.len() + wide;
    number(&mut file, first as u64, wide);
    for page in 0..pages {
        // Width, height, bits, no packing, black is zero, place and length of the strip, and what is claimed of.
        let mut entries = vec![(256u16, 1u64), (257, 1), (258, 8), (259, 1), (262, 1), (273, 8), (278, 1), (279, 1)];
        if !entries.iter().any(|e| e.0 == tag) {
            entries.push((tag, 8));
        }
        entries.sort_unstable();
        number(&mut file, entries.len() as u64, head);
        for (own, value) in entries {
            number(&mut file, own.into(), 2);
            // Whole numbers of 32 bits, and of GeoTIFF's tags doubles.
            number(&mut file, if own > 30000 { 12 } else { 4 }, 2);
            let is_claim = own == tag && page + 1 == pages;
            number(&mut file, if is_claim { values } else { 1 }, wide);
            if is_claim {
                number(&mut file, 8, wide);
            } else {
                // A value that is shorter than its place stands at its beginning, whatever the order of bytes.
                number(&mut file, value, 4);
                number(&mut file, 0, wide - 4);
            }
        }
        let next = if page + 1 < pages { file.len() + wide } else { 0 };
        number(&mut file, next as u64, wide);
    }
    file
}

/// What the command says of a file, which takes little.
fn refused(folder: &Path, name: &str, bytes: &[u8]) -> String {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    let (baked, most) = peak(|| vtex::par::with_threads(1, || run(Command::Bake, &path, 1)).unwrap());
    assert!(most < LITTLE, "{name}: {baked:?}, {} KiB", most >> 10);
    let (raster, most) = peak(|| Raster::open(&path));
    assert!(most < LITTLE, "{name} as a raster: {raster:?}, {} KiB", most >> 10);
    baked.unwrap_err().to_string()
}

#[test]
fn counts_of_a_tiff_are_weighed_against_its_length() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let said = refused(folder.path(), "whole.tif", &tiff(false, false, 1, 273, 1));
    assert!(said.contains("values are the same"), "it can be read: {said}");
    for (is_big, big_endian) in [(false, false), (false, true), (true, false), (true, true)] {
        for pages in [1, 2] {
            // Places and lengths of strips, bits, sample formats, a description, tables, and tags of GeoTIFF.
            for tag in [256, 258, 259, 270, 273, 277, 279, 338, 339, 347, 33550, 34735] {
                let values = if is_big { [4_194_305, u64::MAX / 4] } else { [4_194_305, u32::MAX.into()] };
                for values in values {
                    let said = refused(folder.path(), "claim.tif", &tiff(is_big, big_endian, pages, tag, values));
                    let place = format!("page {pages}: its tag {tag} has {values} values");
                    assert!(said.contains(&place), "{is_big} {big_endian} {tag} {values}: {said}");
                }
            }
            // What is a program's own is not read.
            let said = refused(folder.path(), "own.tif", &tiff(is_big, big_endian, pages, 65000, 4_194_305));
            assert!(said.contains("values are the same"), "{is_big} {big_endian}: {said}");
        }
    }
}

#[test]
fn directories_of_a_tiff_lie_apart() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    // A directory at every sixth byte, of 100 entries each. The place of the next stands behind these, 200 times six bytes on.
    let mut file = b"II*\0\x08\0\0\0".to_vec();
    for n in 0..2200u32 {
        file.extend(100u16.to_le_bytes());
        file.extend((8 + 6 * n.saturating_sub(199)).to_le_bytes());
    }
    let said = refused(folder.path(), "within.tif", &file);
    assert!(said.contains("bytes of entries"), "{said}");
}

/// A picture of 5 × 4 pixels with a packed profile of this many bytes.
fn profiled(length: usize) -> Vec<u8> {
    let plain = small::png(5, 4);
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    (0..length >> 20).for_each(|_| packed.write_all(&[0; 1 << 20]).unwrap());
    let chunk = [b"iCCPname\0\0", &packed.finish().unwrap()[..]].concat();
    let mut out = Cursor::new(Vec::new());
    // Behind the signature and the header.
    out.write_all(&plain[..33]).unwrap();
    out.write_all(&(chunk.len() as u32 - 4).to_be_bytes()).unwrap();
    out.write_all(&chunk).unwrap();
    out.write_all(&crc32fast::hash(&chunk).to_be_bytes()).unwrap();
    out.write_all(&plain[33..]).unwrap();
    out.into_inner()
}

#[test]
fn packed_profiles_of_pictures_are_not_unpacked_without_bound() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let picture = profiled(256 << 20);
    assert!(picture.len() < 1 << 20, "{} bytes", picture.len());
    // What a decoder may take for what is beside the pixels, doubled where it grows, and what else the program takes.
    let most_beside = (32 << 20) + LITTLE;
    let ([gltf, _], corners) = (small::grounds(), small::corners());
    type Files<'a> = Vec<(&'a str, &'a [u8])>;
    let all: [(&str, Command, &str, Files); 4] = [
        ("slice", Command::Bake, "s", vec![("s/0.png", &picture), ("s/1.png", &picture)]),
        ("glTF", Command::Bake, "a.gltf", vec![("a.gltf", &gltf), ("ground.bin", &corners), ("grass.png", &picture)]),
        ("compare", Command::Compare, "a.png", vec![("a.png", &picture)]),
        ("albedo", Command::Albedo, "a.png", vec![("a.png", &picture), ("quad.obj", small::OBJ.as_bytes())]),
    ];
    for (name, command, main, files) in all {
        let own = folder.path().join(name);
        for (file, bytes) in &files {
            put(&own.join(file), bytes);
        }
        let work = || vtex::par::with_threads(1, || run(command, &own.join(main), 1)).unwrap();
        let (result, most) = peak(work);
        assert!(most < most_beside, "{name} takes {} MiB: {result:?}", most >> 20);
    }
    let path = folder.path().join("mask.png");
    std::fs::write(&path, &picture).unwrap();
    let (result, most) = peak(|| Raster::open(&path));
    assert!(most < most_beside, "a mask takes {} MiB: {result:?}", most >> 20);
}

//! FreeSurfer's volumes (.mgh, and packed as .mgz).
//!
//! Based on: B. Fischl, *FreeSurfer*, NeuroImage 62, 2012, and FreeSurfer's description of its file formats.

use byteorder::{BigEndian, ByteOrder};

use super::Stack;
use super::choice::{Choice, OuterAxes};
use super::coding::{Coding, Kind};
use super::data::{Data, binary_header};

use crate::geom::{DAffine3, DMat3, DVec3};
use crate::{Error, Result, Warnings};

/// Bytes before the samples.
const HEADER: usize = 284;

/// Read the stack `choice.path`.
pub fn read(choice: &Choice, in_memory: u64) -> Result<Stack> {
    let path = choice.path;
    let (h, packing) = binary_header(path, HEADER)?;
    if h.len() < HEADER || BigEndian::read_i32(&h) != 1 {
        return Err(Error::input(path, "", "not a FreeSurfer volume: it does not begin with a header of version 1"));
    }
    let int = |at: usize| BigEndian::read_i32(&h[at..]);
    let dims = [4, 8, 12].map(|at| usize::try_from(int(at)).unwrap_or(0));
    let kind = match int(20) {
        0 => Kind::U8,
        1 => Kind::I32,
        3 => Kind::F32,
        4 => Kind::I16,
        10 => Kind::U16,
        other => return Err(Error::unsupported(path, format!("a FreeSurfer volume of data type {other}"))),
    };
    let mut warnings = Warnings::default();
    let outer = OuterAxes { axes: vec![(usize::try_from(int(16)).unwrap_or(1).max(1), false)] };
    let volume = outer.choose(choice, &mut warnings)?;
    let (skip, skip_unpacked) = packing.skips_of_whole(HEADER as u64);
    let samples = Data {
        header: path,
        files: vec![path.to_path_buf()],
        skip,
        skip_unpacked,
        packing,
        coding: Coding { kind, big_endian: true, channels: 1 },
        dims,
        volume,
    }
    .load(in_memory)?;
    let affine = if BigEndian::read_i16(&h[28..]) > 0 {
        let vector = |at: usize| DVec3::from([0, 4, 8].map(|k| f64::from(BigEndian::read_f32(&h[at + k..]))));
        let spacing = vector(30);
        // Directions of the three axes, then the middle of the volume.
        let matrix3 = DMat3::from_cols(vector(42), vector(54), vector(66)) * DMat3::from_diagonal(spacing);
        DAffine3 { matrix3, translation: vector(78) - matrix3 * (0.5 * DVec3::from(dims.map(|d| d as f64))) }
    } else {
        warnings.add("the volume does not say how it lies; it is taken as coronal slices of 1 mm");
        DAffine3::from_mat3(DMat3::from_cols(DVec3::NEG_X, DVec3::NEG_Z, DVec3::Y))
    };
    Stack::new(path, samples, super::with_thickness(affine, dims), 1e-3, warnings)
}

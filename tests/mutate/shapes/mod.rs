//! Things that are valid by their make and arbitrary in all else: texels, landscapes, recipes. Readers of bytes seldom get that far.

pub mod schema;
pub mod texel;

use std::path::Path;

use arbitrary::{Result, Unstructured};

/// Makes a thing of bytes, in files of a folder, and does with it what the program does.
pub type Shape = fn(&mut Unstructured, &Path) -> Result<vtex::Result<()>>;

/// One time in `n`, as long as there are bytes.
pub fn one_in(u: &mut Unstructured, n: u32) -> Result<bool> {
    Ok(!u.is_empty() && u.int_in_range(1..=n)? == 1)
}

/// A number that programs meet, or one that none should.
pub fn number(u: &mut Unstructured) -> Result<f64> {
    const FAR: [f64; 16] = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        1e-30,
        1e-300,
        1e10,
        -1e30,
        3.4e38,
        1e308,
        255.0,
        65536.0,
        4294967296.0,
        0.1,
        -1e-9,
        1e15,
    ];
    Ok(match u.int_in_range(0..=15u8)? {
        0 => *u.choose(&FAR)?,
        1 => f64::from(u.arbitrary::<i32>()?),
        2 => f64::from(u.arbitrary::<f32>()?),
        3..=6 => f64::from(u.arbitrary::<i8>()?),
        _ => f64::from(u.arbitrary::<i16>()?) / 8192.0,
    })
}

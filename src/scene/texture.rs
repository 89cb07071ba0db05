//! An image as a material samples it.

/// How a texture continues beyond [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wrap {
    #[default]
    Repeat,
    Mirror,
    Clamp,
}

/// A decoded image: 8-bit RGBA, sRGB-encoded colour, linear alpha, row 0 at v = 0 (the top, as in glTF).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Texture {
    pub name: String,
    pub width: u32,
    pub height: u32,
    /// `width * height` texels, row by row.
    pub texels: Vec<[u8; 4]>,
    pub wrap: [Wrap; 2],
    /// Nearest texel instead of bilinear.
    pub nearest: bool,
}

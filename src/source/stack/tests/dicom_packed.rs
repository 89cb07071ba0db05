//! DICOM's packed pixels: JPEG 2000, JPEG-LS, deflate, and chroma that pixels share.

use super::dicoms::{Element, PLAIN, file, numbers, text, us};
use super::*;

const JPEG_2000: &str = "1.2.840.10008.1.2.4.90";
const JPEG_LS: &str = "1.2.840.10008.1.2.4.80";
const DEFLATED: &str = "1.2.840.10008.1.2.8.1";

/// Codestreams of OpenJPEG 2.5.4, lossless, two resolutions, of 6 × 5 pixels: `GREY`, `WIDE` and `COLOUR` below.
const GREY_J2K: &str = "ff4fff510029000000000006000000050000000000000000000000060000000500000000000000000001070101ff5\
    2000c00000001000104040001ff5c00074040484850ff640025000143726561746564206279204f70656e4a5045472076657273696f6e20322e35\
    2e34ff90000a0000000000360001ff93df805006a010a308feb85813b5cfc0263ed058fc010018e193d4199dfc2f7613e93fe77f10d9be97ffd9";
const WIDE_J2K: &str = "ff4fff5100290000000000060000000500000000000000000000000600000005000000000000000000010f0101ff5\
    2000c00000001000104040001ff5c00074080888890ff640025000143726561746564206279204f70656e4a5045472076657273696f6e20322e35\
    2e34ff90000a00000000004c0001ff93dff890a006972435cfe8718a19f8f9e5927f6211cc41b7efcffc484e1ff830247fe24060124ff9f9622ee8\
    326aa911c77ec8a58c13d9630e303e180e7ee3ffd9";
const COLOUR_J2K: &str = "ff4fff51002f000000000006000000050000000000000000000000060000000500000000000000000003070101\
    070101070101ff52000c00000001010104040001ff5c00074040484850ff640025000143726561746564206279204f70656e4a5045472076657273\
    696f6e20322e352e34ff90000a00000000006a0001ff93df805806a04733d114832dd31befdf80580cc3ad98c167e9c5a6e6dfcfb4240cf6d0e94d4f8\
    97e3fc3ea0881f20383ea0215945ebf88c13b3f14c67f14c9c3ea0400169430d7df98443ea038fc00801b2a229f537a179a14c6bf14c9ffd9";

fn of_hex(text: &str) -> Vec<u8> {
    text.as_bytes().chunks(2).map(|c| u8::from_str_radix(std::str::from_utf8(c).unwrap(), 16).unwrap()).collect()
}

/// A value for each of the 6 × 5 pixels, row by row.
fn each<T>(value: impl Fn(u32, u32) -> T) -> Vec<T> {
    (0..30).map(|n| value(n % 6, n / 6)).collect()
}

fn grey() -> Vec<u8> {
    each(|x, y| (7 * x * x + 29 * y + 3 * x * y) as u8)
}

fn wide() -> Vec<u16> {
    each(|x, y| (7001 * x * x + 2903 * y + 31 * x * y) as u16)
}

fn colour() -> Vec<u8> {
    each(|x, y| [7 * x * x + 29 * y, 40 * x + 3 * y, 50 * y + x].map(|v| v as u8)).concat()
}

/// Description of 6 × 5 pixels of so many bits.
fn about(bits: u16, signed: bool) -> Vec<Element> {
    vec![
        us(0x28, 0x10, &[5]),
        us(0x28, 0x11, &[6]),
        us(0x28, 0x100, &[bits]),
        us(0x28, 0x101, &[bits]),
        us(0x28, 0x102, &[bits - 1]),
        us(0x28, 0x103, &[u16::from(signed)]),
    ]
}

fn colours(photometric: &str) -> Vec<Element> {
    [about(8, false), vec![us(0x28, 2, &[3]), text(0x28, 4, b"CS", photometric)]].concat()
}

/// A file whose only frame is `packed`.
fn packed(syntax: &str, own: &[Element], packed: &[u8]) -> Vec<u8> {
    let mut bytes = file(syntax, own, None);
    bytes.extend([0xe0, 0x7f, 0x10, 0x00, b'O', b'B', 0, 0, 0xff, 0xff, 0xff, 0xff]);
    let padded = [packed, &[0][..packed.len() % 2]].concat();
    for item in [&[][..], &padded[..]] {
        bytes.extend([0xfe, 0xff, 0x00, 0xe0]);
        bytes.extend((item.len() as u32).to_le_bytes());
        bytes.extend(item);
    }
    bytes.extend([0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0]);
    bytes
}

fn read_packed(syntax: &str, own: &[Element], stream: &[u8]) -> Result<Stack> {
    open(&Dir::new().save("p.dcm", &packed(syntax, own, stream)))
}

fn floats<T: Copy + Into<f32>>(list: &[T]) -> Vec<f32> {
    list.iter().map(|v| (*v).into()).collect()
}

#[test]
fn jpeg_2000_gives_the_numbers_that_were_packed() {
    let read = |own: &[Element], stream: &[u8]| values(&read_packed(JPEG_2000, own, stream).unwrap());
    let (stream, wide_stream) = (of_hex(GREY_J2K), of_hex(WIDE_J2K));
    assert_eq!(read(&about(8, false), &stream), floats(&grey()));
    assert_eq!(read(&about(16, false), &wide_stream), floats(&wide()));
    // Fewer bits than a number takes.
    assert_eq!(read(&about(16, false), &stream), floats(&grey()));
    // In the boxes of a .jp2 file, of which the first says nothing of pixels.
    let length = (8 + stream.len() as u32).to_be_bytes();
    let boxed = [&[0, 0, 0, 12][..], b"jP  \r\n\x87\n", &length, b"jp2c", &stream].concat();
    assert_eq!(read(&about(8, false), &boxed), floats(&grey()));
    // Signed numbers are stored as they are, others with half of their range taken off.
    let mut signed = stream.clone();
    signed[42] |= 0x80;
    let around_0: Vec<f32> = grey().iter().map(|v| f32::from(*v) - 128.0).collect();
    assert_eq!(read(&about(8, true), &signed), around_0);
    // Where only the file says that they are signed, the bits are.
    assert_eq!(read(&about(8, true), &stream), floats(&grey().iter().map(|v| *v as i8).collect::<Vec<_>>()));
}

#[test]
fn colours_of_jpeg_2000_are_those_of_plain_pixels() {
    let dir = Dir::new();
    let plain = open(&dir.save("a.dcm", &file(PLAIN, &colours("RGB"), Some(&colour())))).unwrap();
    let packed = read_packed(JPEG_2000, &colours("YBR_RCT"), &of_hex(COLOUR_J2K)).unwrap();
    for at in each(|x, y| [x as usize, y as usize, 0]) {
        assert_eq!(packed.samples.colour(at), plain.samples.colour(at), "{at:?}");
    }
    let wrong = read_packed(JPEG_2000, &about(8, false), &of_hex(COLOUR_J2K)).err().unwrap().to_string();
    assert!(wrong.contains("another size or kind"), "{wrong}");
}

#[test]
fn jpeg_ls_gives_the_numbers_that_were_packed() {
    let encode = |list: &[u16]| {
        let mut out = Vec::new();
        jpegls::encode(list, 6, 5, &mut out).unwrap();
        out
    };
    let read = |own: &[Element], list: &[u16]| values(&read_packed(JPEG_LS, own, &encode(list)).unwrap());
    assert_eq!(read(&about(16, false), &wide()), floats(&wide()));
    assert_eq!(read(&about(8, false), &grey().iter().map(|v| u16::from(*v)).collect::<Vec<_>>()), floats(&grey()));
    let signed: Vec<i16> = wide().iter().map(|v| *v as i16).collect();
    assert_eq!(read(&about(16, true), &wide()), floats(&signed));
    let colour = read_packed(JPEG_LS, &colours("RGB"), &encode(&wide())).err().unwrap().to_string();
    assert!(colour.contains("3 channels") && colour.contains("gdcmconv"), "{colour}");
}

#[test]
fn deflated_frames_lie_as_plain_ones() {
    let mut packer = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::best());
    packer.write_all(&numbers(&wide())).unwrap();
    let stream = packer.finish().unwrap();
    assert_eq!(values(&read_packed(DEFLATED, &about(16, false), &stream).unwrap()), floats(&wide()));
    assert!(read_packed(DEFLATED, &about(16, false), &stream[..stream.len() / 2]).is_err());
}

#[test]
fn two_pixels_may_share_their_chroma() {
    // Grey needs none: 128 is no chroma. Then pure red in full-range BT.601: luma 76, blue 85, red 255.
    let dir = Dir::new();
    let mut pixels: Vec<u8> = grey().chunks(2).flat_map(|pair| [pair[0], pair[1], 128, 128]).collect();
    pixels[..4].copy_from_slice(&[76, 76, 85, 255]);
    let stack = open(&dir.save("y.dcm", &file(PLAIN, &colours("YBR_FULL_422"), Some(&pixels)))).unwrap();
    let all_red: Vec<u8> = [vec![[254, 0, 0]; 2], grey()[2..].iter().map(|v| [*v; 3]).collect()].concat().concat();
    let plain = open(&dir.save("r.dcm", &file(PLAIN, &colours("RGB"), Some(&all_red)))).unwrap();
    for at in each(|x, y| [x as usize, y as usize, 0]) {
        assert_eq!(stack.samples.colour(at), plain.samples.colour(at), "{at:?}");
    }
}

#[test]
fn broken_streams_are_refused_or_read_and_never_more() {
    let mut ls = Vec::new();
    jpegls::encode(&wide(), 6, 5, &mut ls).unwrap();
    let dir = Dir::new();
    let streams = [
        (JPEG_2000, about(8, false), of_hex(GREY_J2K)),
        (JPEG_2000, about(16, false), of_hex(WIDE_J2K)),
        (JPEG_2000, colours("YBR_RCT"), of_hex(COLOUR_J2K)),
        (JPEG_LS, about(16, false), ls),
    ];
    for (syntax, own, stream) in streams {
        let read = |stream: &[u8]| open(&dir.save("b.dcm", &packed(syntax, &own, stream)));
        for at in 0..stream.len() {
            for value in [0, 1, 0x7f, 0x80, 0xff, stream[at] ^ 1, stream[at] ^ 0x10, stream[at].wrapping_add(1)] {
                let mut broken = stream.clone();
                broken[at] = value;
                if let Ok(stack) = read(&broken) {
                    assert_eq!(stack.samples.dims(), [6, 5, 1]);
                }
            }
        }
        // Cut short within its head or in the middle of its pixels.
        for end in (0..stream.len() - 8).step_by(3) {
            let what = read(&stream[..end]).err().unwrap_or_else(|| panic!("{syntax} is read of {end} bytes"));
            assert_eq!(what.to_string().lines().count(), 1, "{what}");
        }
    }
}

//! What is done to an input: bytes, text, JSON and texels each in their own way.

use serde_json::Value;
use vtex::random::SplitMix64;

/// Random choices, the same for the same seed on every machine.
pub struct Dice(SplitMix64);

impl Dice {
    pub fn new(seed: u64, number: u64) -> Dice {
        Dice(SplitMix64::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ number.wrapping_mul(0xd134_2543_de82_ef95)))
    }

    /// A number below `n`; 0 where `n` is 0.
    pub fn below(&mut self, n: usize) -> usize {
        (self.0.bits() >> 11) as usize % n.max(1)
    }

    pub fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }

    pub fn of<'a, T>(&mut self, list: &'a [T]) -> &'a T {
        &list[self.below(list.len())]
    }

    fn byte(&mut self) -> u8 {
        self.0.bits() as u8
    }

    /// A range of `0..length`, mostly short.
    fn range(&mut self, length: usize) -> std::ops::Range<usize> {
        let start = self.below(length + 1);
        let scale = 1 << self.below(12);
        let end = start + self.below(scale + 1);
        start..end.min(length)
    }
}

/// How an input is mutated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    Binary,
    Text,
    Json,
    Glb,
    Texel,
    /// Text as it is in a gzip stream.
    PackedText,
    Png,
}

/// The mutated input; `other` is another of its kind, of which parts are taken.
pub fn mutate(dice: &mut Dice, kind: Kind, input: &[u8], other: &[u8]) -> Vec<u8> {
    let rounds = 1 + dice.below(2) + if dice.one_in(4) { dice.below(8) } else { 0 };
    // Also structured inputs are broken as plain bytes now and then.
    let plain = dice.one_in(6);
    match kind {
        Kind::Json | Kind::Glb if !plain => json_of(dice, kind, input, rounds),
        Kind::Text | Kind::Json => (0..rounds).fold(input.to_vec(), |bytes, _| text(dice, bytes, other)),
        Kind::PackedText if !plain => {
            let unpacked = gunzip(input);
            let mutated = (0..rounds).fold(unpacked, |bytes, _| text(dice, bytes, &gunzip(other)));
            gzip(&mutated)
        }
        Kind::Png if !plain => {
            let mut bytes = (0..rounds).fold(input.to_vec(), |bytes, _| binary(dice, bytes, other));
            mend_png(&mut bytes);
            bytes
        }
        Kind::Texel => {
            let mut bytes = (0..rounds).fold(input.to_vec(), |bytes, _| binary(dice, bytes, other));
            if !plain {
                mend_texel(&mut bytes);
            }
            bytes
        }
        _ => (0..rounds).fold(input.to_vec(), |bytes, _| binary(dice, bytes, other)),
    }
}

fn gunzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    let _ = std::io::Read::read_to_end(&mut flate2::read::GzDecoder::new(bytes), &mut out);
    out
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut out, bytes).unwrap();
    out.finish().unwrap()
}

const WHOLE: [u64; 16] = [
    0,
    1,
    2,
    3,
    0x7f,
    0x80,
    0xff,
    0x100,
    0x7fff,
    0xffff,
    0x10_0000,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x7fff_ffff_ffff_ffff,
    u64::MAX,
];
const REAL: [f64; 14] =
    [0.0, -0.0, 1.0, -1.0, 0.5, 1e-30, 1e-300, 1e10, 1e30, 3.4e38, 1e308, f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

/// One change of bytes.
fn binary(dice: &mut Dice, mut bytes: Vec<u8>, other: &[u8]) -> Vec<u8> {
    // Headers decide on more than what follows them.
    let n = if dice.one_in(2) { bytes.len().min(1 << (5 + dice.below(6))) } else { bytes.len() };
    match dice.below(9) {
        0 | 1 if n > 0 => {
            let at = dice.below(n);
            bytes[at] ^= 1 << dice.below(8);
        }
        2 if n > 0 => {
            let at = dice.below(n);
            bytes[at] = *dice.of(&[0, 1, 2, 0x7f, 0x80, 0xfe, 0xff, b' ', b'\n', b'0']);
        }
        3 => {
            let range = dice.range(n);
            let fill = if dice.one_in(2) { dice.byte() } else { 0xff * dice.below(2) as u8 };
            bytes[range].fill(fill);
        }
        4 => drop(bytes.drain(dice.range(n))),
        5 => {
            let part = bytes[dice.range(n)].to_vec();
            let at = dice.below(bytes.len() + 1);
            bytes.splice(at..at, part);
        }
        6 => {
            let (from, to) = (dice.range(other.len()), dice.range(n));
            bytes.splice(to, other[from].iter().copied());
        }
        7 if dice.one_in(2) => bytes.truncate(dice.below(bytes.len() + 1)),
        _ => number(dice, &mut bytes[..n]),
    }
    bytes
}

/// A number of 2, 4 or 8 bytes replaced by an extreme one, or by one near what it is.
fn number(dice: &mut Dice, bytes: &mut [u8]) {
    let width = 2 << dice.below(3);
    let places = bytes.len() / width;
    if places == 0 {
        return;
    }
    let at = dice.below(places) * width + if dice.one_in(4) { dice.below(bytes.len() % width + 1) } else { 0 };
    let place = &mut bytes[at..at + width];
    let whole = *dice.of(&WHOLE);
    let real = *dice.of(&REAL);
    let mut value = match dice.below(3) {
        0 if width == 4 => (real as f32).to_le_bytes().to_vec(),
        0 if width == 8 => real.to_le_bytes().to_vec(),
        1 => {
            let mut all = [0; 8];
            all[..width].copy_from_slice(place);
            let near = u64::from_le_bytes(all).wrapping_add(dice.below(5) as u64).wrapping_sub(2);
            near.to_le_bytes()[..width].to_vec()
        }
        _ => whole.to_le_bytes()[..width].to_vec(),
    };
    if dice.one_in(3) {
        value.reverse();
    }
    place.copy_from_slice(&value);
}

const NUMBERS: [&str; 22] = [
    "0",
    "-1",
    "-0",
    "1",
    "2",
    "0.5",
    "1e-30",
    "1e30",
    "1e308",
    "-1e308",
    "1e999",
    "nan",
    "inf",
    "-inf",
    "255",
    "65536",
    "1000000",
    "2147483647",
    "2147483648",
    "4294967296",
    "9223372036854775808",
    "",
];

/// One change of text.
fn text(dice: &mut Dice, mut bytes: Vec<u8>, other: &[u8]) -> Vec<u8> {
    match dice.below(10) {
        0..=3 => {
            let numbers = numbers(&bytes);
            if !numbers.is_empty() {
                let range = dice.of(&numbers).clone();
                bytes.splice(range, dice.of(&NUMBERS).bytes());
            }
        }
        4 => {
            // A line twice, gone, or somewhere else.
            let mut lines: Vec<Vec<u8>> = bytes.split_inclusive(|b| *b == b'\n').map(<[u8]>::to_vec).collect();
            if !lines.is_empty() {
                let line = lines.remove(dice.below(lines.len()));
                for _ in 0..dice.below(3) {
                    let at = dice.below(lines.len() + 1);
                    lines.insert(at, line.clone());
                }
            }
            bytes = lines.concat();
        }
        5 if dice.one_in(4) => {
            // Deep or long: what recursion or a quadratic loop would stumble over.
            let unit =
                *dice.of(&["(", "[", "{", "-", "!", "F", "[F", "a.", "((", "[[[", "\"", "0 ", "\\\n", "# ", "^2"]);
            let many = unit.repeat(1 << dice.below(15));
            let at = dice.below(bytes.len() + 1);
            bytes.splice(at..at, many.bytes());
        }
        6 => {
            let marks = b" \n\t,;:=()[]{}\"'#/\\*+-.^&~!<>%$@0\0\xef\xbb\xbf\x80\xff";
            let at = dice.below(bytes.len() + 1);
            bytes.insert(at, *dice.of(marks));
        }
        _ => bytes = binary(dice, bytes, other),
    }
    bytes
}

/// Where numbers stand in text.
fn numbers(text: &[u8]) -> Vec<std::ops::Range<usize>> {
    let mut found = Vec::new();
    let mut start = None;
    for (i, b) in text.iter().chain(b" ").enumerate() {
        let within = b.is_ascii_digit() || (start.is_some() && b".eE-+".contains(b)) || (start.is_none() && *b == b'-');
        match start {
            None if within => start = Some(i),
            Some(from) if !within => {
                found.push(from..i);
                start = None;
            }
            _ => {}
        }
    }
    found
}

/// JSON, by itself or in a GLB, with some of its values changed.
fn json_of(dice: &mut Dice, kind: Kind, input: &[u8], rounds: usize) -> Vec<u8> {
    let length = |at: usize| input.get(at..at + 4).map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let (json, rest) = match kind {
        Kind::Glb => (input.get(20..20 + length(12)), input.get(20 + length(12)..).unwrap_or_default()),
        _ => (Some(input), [].as_slice()),
    };
    let Some(mut value) = json.and_then(|json| serde_json::from_slice::<Value>(json).ok()) else {
        return binary(dice, input.to_vec(), input);
    };
    for _ in 0..rounds {
        let all = count(&value);
        let donor = nth(&value, &mut dice.below(all)).cloned().unwrap_or_default();
        let mut at = dice.below(all);
        if let Some(place) = nth_mut(&mut value, &mut at) {
            change(dice, place, donor);
        }
    }
    let mut json = serde_json::to_vec(&value).unwrap();
    if kind == Kind::Json {
        return json;
    }
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = (20 + json.len() + rest.len()) as u32;
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend(total.to_le_bytes());
    out.extend((json.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(json);
    // The BIN chunk changes now and then as well.
    out.extend(if dice.one_in(3) { binary(dice, rest.to_vec(), input) } else { rest.to_vec() });
    out
}

fn count(value: &Value) -> usize {
    1 + match value {
        Value::Array(list) => list.iter().map(count).sum(),
        Value::Object(map) => map.values().map(count).sum(),
        _ => 0,
    }
}

fn nth<'a>(value: &'a Value, left: &mut usize) -> Option<&'a Value> {
    if *left == 0 {
        return Some(value);
    }
    *left -= 1;
    match value {
        Value::Array(list) => list.iter().find_map(|v| nth(v, left)),
        Value::Object(map) => map.values().find_map(|v| nth(v, left)),
        _ => None,
    }
}

fn nth_mut<'a>(value: &'a mut Value, left: &mut usize) -> Option<&'a mut Value> {
    if *left == 0 {
        return Some(value);
    }
    *left -= 1;
    match value {
        Value::Array(list) => list.iter_mut().find_map(|v| nth_mut(v, left)),
        Value::Object(map) => map.values_mut().find_map(|v| nth_mut(v, left)),
        _ => None,
    }
}

/// One change of a JSON value.
fn change(dice: &mut Dice, place: &mut Value, donor: Value) {
    match (place, dice.below(6)) {
        (Value::Object(map), 0 | 1) if !map.is_empty() => {
            let key = map.keys().nth(dice.below(map.len())).cloned().unwrap_or_default();
            map.shift_remove(&key);
        }
        (Value::Object(map), 2 | 3) if map.len() > 1 => {
            let keys: Vec<String> = map.keys().cloned().collect();
            let (a, b) = (dice.of(&keys), dice.of(&keys));
            let (x, y) = (map[a].clone(), map[b].clone());
            map.insert(a.clone(), y);
            map.insert(b.clone(), x);
        }
        (Value::Array(list), 0) if !list.is_empty() => drop(list.remove(dice.below(list.len()))),
        (Value::Array(list), 1 | 2) if !list.is_empty() => {
            let again = dice.of(list).clone();
            let most = if dice.one_in(20) { 12 } else { 3 };
            for _ in 0..1 << dice.below(most) {
                list.push(again.clone());
            }
        }
        (Value::Array(list), 3) => list.push(donor),
        (place @ Value::Number(_), 0..=4) => {
            let near = place.as_i64().map(|n| n.saturating_add(dice.below(5) as i64 - 2));
            *place = match dice.below(3) {
                0 => near.into(),
                1 => serde_json::from_str::<Value>(NUMBERS[dice.below(NUMBERS.len())])
                    .unwrap_or((*dice.of(&REAL)).into()),
                _ => donor,
            };
        }
        (Value::String(text), 0..=2) => {
            let others =
                ["", "..", "/dev/zero", "data:,", "data:;base64,AAAA", "a\nb\u{1b}[31m", "%00", "é%2e%2e/x", "*"];
            *text = (*dice.of(&others)).into();
        }
        (Value::Bool(yes), _) => *yes = !*yes,
        (place, 5) => {
            let depth = 1 << dice.below(8);
            *place = (0..depth).fold(place.clone(), |v, _| Value::Array(vec![v]));
        }
        (place, _) => *place = donor,
    }
}

/// Put right the checksums of a PNG's chunks.
fn mend_png(file: &mut [u8]) {
    let mut at = 8usize;
    while let Some(length) = file.get(at..at.saturating_add(4)) {
        let length = u32::from_be_bytes([length[0], length[1], length[2], length[3]]) as usize;
        let end = at.saturating_add(8).saturating_add(length);
        let Some(crc) = file.get(at + 4..end).map(crc32fast::hash) else { return };
        if let Some(place) = file.get_mut(end..end + 4) {
            place.copy_from_slice(&crc.to_be_bytes());
        }
        at = end + 4;
    }
}

/// Put right what a change of a `.vtex` file has broken for certain: its length, the checksums of pages, indices and META, the
/// content's identity and the head's checksum. What stays wrong is wrong in its meaning.
pub fn mend_texel(file: &mut [u8]) {
    const HEADER: usize = 128;
    const DEPTH: usize = 64;
    const STREAM: usize = 32;
    const SECTION: usize = 48;
    let whole = file.len();
    if whole < HEADER {
        return;
    }
    let u64_at = |file: &[u8], at: usize| file.get(at..at + 8).map_or(0, |b| u64::from_le_bytes(b.try_into().unwrap()));
    let u32_at = |file: &[u8], at: usize| file.get(at..at + 4).map_or(0, |b| u32::from_le_bytes(b.try_into().unwrap()));
    let put = |file: &mut [u8], at: usize, bytes: &[u8]| {
        if let Some(place) = file.get_mut(at..at.saturating_add(bytes.len())) {
            place.copy_from_slice(bytes);
        }
    };
    put(file, 24, &(whole as u64).to_le_bytes());
    let (depths, streams, sections) =
        (usize::from(file[40]), usize::from(file[41]), usize::from(file[46]) + 256 * usize::from(file[47]));
    let (stream_at, section_at) = (HEADER + depths * DEPTH, HEADER + depths * DEPTH + streams * STREAM);
    for entry in (0..sections).map(|i| section_at + i * SECTION).filter(|at| at + SECTION <= whole) {
        let (from, length) = (u64_at(file, entry + 8) as usize, u64_at(file, entry + 16) as usize);
        let Some(end) = from.checked_add(length).filter(|end| *end <= whole) else { continue };
        let index = match &file[entry..entry + 4] {
            b"TOPO" => 24,
            b"PAGE" => 16,
            _ => 0,
        };
        let pages = u32_at(file, entry + 32) as usize;
        let mut covered = end;
        if index > 0 {
            covered = from.saturating_add(pages.saturating_mul(index)).min(end);
            for at in (from..covered).step_by(index).take(1024) {
                let page = from.saturating_add(u64_at(file, at) as usize);
                let page = page..page.saturating_add(u32_at(file, at + 8) as usize);
                if let Some(crc) = file.get(page).map(crc32fast::hash) {
                    put(file, at + 12, &crc.to_le_bytes());
                }
            }
        }
        let crc = crc32fast::hash(&file[from..covered]);
        put(file, entry + 36, &crc.to_le_bytes());
    }
    if section_at <= whole {
        put(file, 112, &content_id(file, HEADER..stream_at, stream_at..section_at));
    }
    let head = (u32_at(file, 16) as usize).min(whole);
    put(file, 20, &[0; 4]);
    let crc = crc32fast::hash(&file[..head]);
    put(file, 20, &crc.to_le_bytes());
}

fn content_id(file: &[u8], depths: std::ops::Range<usize>, streams: std::ops::Range<usize>) -> [u8; 16] {
    use sha2::{Digest, Sha256};
    let mut digest = Sha256::new();
    digest.update([file[40], file[44], file[45]]);
    digest.update(&file[48..104]);
    digest.update(&file[streams]);
    for depth in file[depths].chunks_exact(64) {
        digest.update(&depth[..8]);
        digest.update(&depth[32..]);
    }
    let whole = digest.finalize();
    std::array::from_fn(|i| whole[i])
}

//! Decoder of EXT_meshopt_compression and KHR_meshopt_compression: buffer views that are packed by byte-wise deltas.
//!
//! Based on: the glTF extensions of those names (bitstream versions 0 and 1 for attributes, 1 for indices).

use serde_json::Value;

use super::filters;
use super::filters::Filter;

/// Number of bytes in a group, which are packed with the same width.
const GROUP: usize = 16;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Mode {
    Attributes,
    Triangles,
    Indices,
}

/// A compressed buffer view, as its JSON has it.
#[derive(Debug)]
pub struct Spec {
    pub buffer: usize,
    pub byte_offset: u64,
    pub byte_length: u64,
    /// Bytes per element after decoding.
    pub stride: usize,
    count: usize,
    mode: Mode,
    filter: Option<Filter>,
}

impl Spec {
    /// The error says what is wrong.
    pub fn parse(json: &Value) -> Result<Self, String> {
        let number = |key: &str| json.get(key).map(|v| v.as_u64().ok_or(format!("{key} is not a whole number")));
        let needed = |key: &str| number(key).unwrap_or_else(|| Err(format!("meshopt compression without {key}")));
        let text = |key: &str| json.get(key).and_then(Value::as_str);
        let mode = match text("mode") {
            Some("ATTRIBUTES") => Mode::Attributes,
            Some("TRIANGLES") => Mode::Triangles,
            Some("INDICES") => Mode::Indices,
            other => return Err(format!("meshopt mode {} is not known", other.unwrap_or("(none)"))),
        };
        let size = |key| needed(key).and_then(|n| usize::try_from(n).map_err(|_| format!("{key} is too large")));
        let (stride, count) = (size("byteStride")?, size("count")?);
        let fits = match mode {
            Mode::Attributes => (4..=256).contains(&stride) && stride % 4 == 0,
            Mode::Triangles => (stride == 2 || stride == 4) && count % 3 == 0,
            Mode::Indices => stride == 2 || stride == 4,
        };
        if !fits {
            return Err(format!("meshopt compression: byteStride {stride} and count {count} do not fit the mode"));
        }
        let filter =
            match text("filter") {
                None | Some("NONE") => None,
                Some(name) => Some(Filter::named(name, stride).ok_or_else(|| {
                    format!("meshopt filter {name} is not known, or not for elements of {stride} bytes")
                })?),
            };
        if filter.is_some() && mode != Mode::Attributes {
            return Err("a meshopt filter is for attributes only".into());
        }
        let byte_offset = number("byteOffset").unwrap_or(Ok(0))?;
        Ok(Spec {
            buffer: size("buffer")?,
            byte_offset,
            byte_length: needed("byteLength")?,
            stride,
            count,
            mode,
            filter,
        })
    }

    pub fn decoded_len(&self) -> u64 {
        (self.count as u64).saturating_mul(self.stride as u64)
    }

    /// The fewest bytes that can hold so many elements.
    fn least_len(&self) -> usize {
        match self.mode {
            // Two bits for each group of 16 of each byte, in version 1 a control byte for each block of 4 bytes.
            Mode::Attributes => 1 + self.count / 256 * (self.stride / 4),
            Mode::Triangles => 1 + self.count / 3 + 16,
            Mode::Indices => 1 + self.count + 4,
        }
    }
}

/// Decode all elements of `spec`, whose decoded length the caller has checked.
pub fn decode(spec: &Spec, packed: &[u8]) -> Result<Vec<u8>, String> {
    if packed.len() < spec.least_len() {
        return Err(format!("{} bytes cannot hold {} elements", packed.len(), spec.count));
    }
    let cut = "is cut short or damaged";
    match spec.mode {
        Mode::Attributes => {
            let mut out = attributes(packed, spec.count, spec.stride).ok_or(cut)?;
            if let Some(filter) = spec.filter {
                filters::apply(filter, &mut out, spec.stride);
            }
            Ok(out)
        }
        Mode::Triangles => Ok(narrow(&triangles(packed, spec.count).ok_or(cut)?, spec.stride)),
        Mode::Indices => Ok(narrow(&sequence(packed, spec.count).ok_or(cut)?, spec.stride)),
    }
}

fn narrow(indices: &[u32], stride: usize) -> Vec<u8> {
    indices.iter().flat_map(|i| i.to_le_bytes().into_iter().take(stride)).collect()
}

/// A cursor over bytes; reading past the end gives `None`.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(head)
    }

    fn byte(&mut self) -> Option<u8> {
        self.take(1).map(|b| b[0])
    }

    /// A variable-length integer: seven bits per byte, lowest first, at most five bytes.
    fn varint(&mut self) -> Option<u32> {
        let mut value = 0;
        for shift in (0..35).step_by(7) {
            let b = self.byte()?;
            value |= u32::from(b & 127) << shift;
            if b < 128 {
                break;
            }
        }
        Some(value)
    }
}

fn unzigzag(v: u32) -> u32 {
    (v >> 1) ^ (v & 1).wrapping_neg()
}

fn attributes(packed: &[u8], count: usize, stride: usize) -> Option<Vec<u8>> {
    let version = match packed.first()? {
        0xA0 => 0,
        0xA1 => 1,
        _ => return None,
    };
    // The tail holds the element before the first one and, in version 1, the coding of each four bytes of an element.
    let channels = if version == 0 { 0 } else { stride / 4 };
    let tail_len = (stride + channels).max(if version == 0 { 32 } else { 24 });
    let body_len = packed.len().checked_sub(1 + tail_len)?;
    let tail = &packed[packed.len() - stride - channels..];
    let mut last = tail[..stride].to_vec();
    let channels = &tail[stride..];

    let mut data = Bytes(&packed[1..1 + body_len]);
    let mut out = vec![0; count * stride];
    let block = ((8192 / stride) & !(GROUP - 1)).min(256);
    for elements in out.chunks_mut(block * stride) {
        let n = elements.len() / stride;
        let control = data.take(if version == 0 { 0 } else { stride / 4 })?;
        for k in (0..stride).step_by(4) {
            let mut deltas: [Vec<u8>; 4] = Default::default();
            for (j, bytes) in deltas.iter_mut().enumerate() {
                let coding = control.get(k / 4).map(|c| c >> (2 * j) & 3);
                *bytes = match coding {
                    Some(3) => data.take(n)?.to_vec(),
                    Some(2) => vec![0; n],
                    Some(1) => byte_groups(&mut data, n, [1, 2, 4, 8])?,
                    Some(_) => byte_groups(&mut data, n, [0, 1, 2, 4])?,
                    None => byte_groups(&mut data, n, [0, 2, 4, 8])?,
                };
            }
            let channel = channels.get(k / 4).copied().unwrap_or(0);
            undo_deltas(&deltas, channel, &mut last[k..k + 4], elements, k, stride)?;
        }
    }
    data.0.is_empty().then_some(out)
}

/// `n` bytes in groups of 16, each with one of four widths.
fn byte_groups(data: &mut Bytes, n: usize, widths: [u32; 4]) -> Option<Vec<u8>> {
    let groups = n.div_ceil(GROUP);
    let header = data.take(groups.div_ceil(4))?;
    let mut out = Vec::with_capacity(groups * GROUP);
    for g in 0..groups {
        let width = widths[usize::from(header[g / 4] >> (g % 4 * 2) & 3)];
        match width {
            0 => out.extend([0; GROUP]),
            8 => out.extend(data.take(GROUP)?),
            _ => {
                let packed = data.take(GROUP * width as usize / 8)?;
                let all_ones = (1u8 << width) - 1;
                let per_byte = 8 / width;
                for i in 0..GROUP as u32 {
                    // Single bits go from the lowest up, the others from the highest down.
                    let at = if width == 1 { i % 8 } else { 8 - width - i % per_byte * width };
                    let v = packed[(i / per_byte) as usize] >> at & all_ones;
                    out.push(if v == all_ones { data.byte()? } else { v });
                }
            }
        }
    }
    out.truncate(n);
    Some(out)
}

/// Sum up the deltas of four byte streams, into bytes `k..k + 4` of each element.
fn undo_deltas(
    deltas: &[Vec<u8>; 4],
    channel: u8,
    last: &mut [u8],
    elements: &mut [u8],
    k: usize,
    stride: usize,
) -> Option<()> {
    let width = match channel & 3 {
        0 => 1,
        1 => 2,
        2 => 4,
        _ => return None,
    };
    for lane in (0..4).step_by(width) {
        let word =
            |bytes: &mut dyn Iterator<Item = u8>| bytes.enumerate().fold(0u32, |v, (j, b)| v | u32::from(b) << (8 * j));
        let mut previous = word(&mut last[lane..lane + width].iter().copied());
        for (i, element) in elements.chunks_exact_mut(stride).enumerate() {
            let v = word(&mut deltas[lane..lane + width].iter().map(|d| d[i]));
            previous = match width {
                4 => v.rotate_right(u32::from(channel >> 4)) ^ previous,
                _ => previous.wrapping_add(unzigzag(v)),
            };
            element[k + lane..k + lane + width].copy_from_slice(&previous.to_le_bytes()[..width]);
        }
        last[lane..lane + width].copy_from_slice(&previous.to_le_bytes()[..width]);
    }
    Some(())
}

/// A ring of the last sixteen items; `get(0)` is the newest.
struct Fifo<T> {
    items: [T; 16],
    next: usize,
}

impl<T: Copy> Fifo<T> {
    fn new(value: T) -> Self {
        Fifo { items: [value; 16], next: 0 }
    }

    fn get(&self, age: usize) -> T {
        self.items[self.next.wrapping_sub(1 + age) & 15]
    }

    /// Write an item, and advance only if `keep` is set.
    fn push(&mut self, value: T, keep: bool) {
        self.items[self.next] = value;
        self.next = (self.next + usize::from(keep)) & 15;
    }
}

/// Decoder of triangles: what was seen last, and where the stream is.
struct TriangleDecoder<'a> {
    /// What does not fit into codes.
    data: Bytes<'a>,
    /// Pairs of ages that codes stand for.
    table: &'a [u8],
    edges: Fifo<[u32; 2]>,
    vertices: Fifo<u32>,
    /// The vertex that is new, and the last that was given by its difference.
    next: u32,
    last: u32,
}

impl TriangleDecoder<'_> {
    fn fresh(&mut self) -> u32 {
        let vertex = self.next;
        self.next = vertex.wrapping_add(1);
        vertex
    }

    fn by_difference(&mut self) -> Option<u32> {
        self.last = self.last.wrapping_add(unzigzag(self.data.varint()?));
        Some(self.last)
    }

    /// A triangle on a known edge.
    fn on_edge(&mut self, code: u8) -> Option<[u32; 3]> {
        let [a, b] = self.edges.get(usize::from(code >> 4));
        let kind = code & 15;
        let c = match kind {
            0 => self.fresh(),
            1..13 => self.vertices.get(usize::from(kind)),
            13 | 14 => {
                self.last = if kind == 13 { self.last.wrapping_sub(1) } else { self.last.wrapping_add(1) };
                self.last
            }
            _ => self.by_difference()?,
        };
        self.vertices.push(c, !(1..13).contains(&kind));
        self.edges.push([c, b], true);
        self.edges.push([a, c], true);
        Some([a, b, c])
    }

    /// A triangle by itself.
    fn apart(&mut self, code: u8) -> Option<[u32; 3]> {
        let free = code >= 0xFE;
        let aux = if free { self.data.byte()? } else { self.table[usize::from(code & 15)] };
        if free && aux == 0 {
            self.next = 0;
        }
        let ages = [if code == 0xFF { 15 } else { 0 }, aux >> 4, aux & 15];
        let mut corners = [0; 3];
        for (corner, &age) in corners.iter_mut().zip(&ages) {
            *corner = match age {
                0 => self.fresh(),
                15 if free => continue,
                // Ages count from the newest as 1 here.
                _ => self.vertices.get(usize::from(age) - 1),
            };
        }
        for (corner, &age) in corners.iter_mut().zip(&ages) {
            if free && age == 15 {
                *corner = self.by_difference()?;
            }
        }
        for (corner, &age) in corners.iter().zip(&ages) {
            self.vertices.push(*corner, age == 0 || (free && age == 15));
        }
        let [a, b, c] = corners;
        self.edges.push([b, a], true);
        self.edges.push([c, b], true);
        self.edges.push([a, c], true);
        Some(corners)
    }
}

fn triangles(packed: &[u8], count: usize) -> Option<Vec<u32>> {
    if *packed.first()? != 0xE1 {
        return None;
    }
    let (rest, table) = packed[1..].split_at_checked(packed.len().checked_sub(17)?)?;
    let (codes, data) = rest.split_at_checked(count / 3)?;
    let (edges, vertices) = (Fifo::new([0; 2]), Fifo::new(0));
    let mut decoder = TriangleDecoder { data: Bytes(data), table, edges, vertices, next: 0, last: 0 };
    let mut out = Vec::with_capacity(count);
    for &code in codes {
        out.extend(if code < 0xF0 { decoder.on_edge(code)? } else { decoder.apart(code)? });
    }
    decoder.data.0.is_empty().then_some(out)
}

fn sequence(packed: &[u8], count: usize) -> Option<Vec<u32>> {
    if *packed.first()? != 0xD1 {
        return None;
    }
    let mut data = Bytes(packed.get(1..packed.len().checked_sub(4)?)?);
    let mut last = [0u32; 2];
    let mut out = Vec::with_capacity(count);
    for _ in 0..count {
        let v = data.varint()?;
        let baseline = &mut last[(v & 1) as usize];
        *baseline = baseline.wrapping_add(unzigzag(v >> 1));
        out.push(*baseline);
    }
    data.0.is_empty().then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    // Streams made by an encoder of the published format; what they hold is known by formula.
    const V0: &str = "a02a0eeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeee0000000010002000001f0002060a0e12161a1e22262a2e32363a3e42464a4e52565a5e62666a6e72767affff00007e82868a8e92969a14800200808080000000002f002020202020202020101010101010101010101010101010100808080808080888888888000000000100008000152aaaaaaaaaaaaaaaaaaa000000150000800080008000800000001f0006182638445664768294a2b4c0d2e0f2feefe1cfc3b1a39185736553473527ffff000015090816283446540000000000000000000000000000000000000000000000000000803f00000000";
    const V1: &str = "a1b968d92a0eeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeee000000000002060a0e12161a1e22262a2e32363a3e42464a4e52565a5e62666a6e72767a7e82868a8e92969a0100011f1a04c4f4c4f262e2621cfcf262e262f13171311e3edddd00000f030703152aaaaaaaaaaaaaaaaaaa000000000102010102020100020006182638445664768294a2b4c0d2e0f2feefe1cfc3b1a391857365534735271509081628344654000000000000000000000000000000803f00000000016200";
    const TRIANGLES: &str =
        "e1fe1e100e100e8e1e140e130e8e1e130e130effff0f08afea0dd8b7082bddc508007687566778a9866589689801690000";
    const SEQUENCE: &str = "d100040c000a100e040c000a100e040c000a100a040c000a100e040c000a100e040c000a100a040c000a100e040c000a100e040c000a10911c2eb1ef1006afef101800000000";

    fn bytes(hex: &str) -> Vec<u8> {
        hex.as_bytes().chunks(2).map(|h| u8::from_str_radix(std::str::from_utf8(h).unwrap(), 16).unwrap()).collect()
    }

    fn spec(mode: &str, stride: usize, count: usize) -> Spec {
        Spec::parse(
            &serde_json::json!({"buffer": 0, "byteLength": 1, "byteStride": stride, "count": count, "mode": mode}),
        )
        .unwrap()
    }

    fn elements() -> Vec<u8> {
        let element = |i: u32| {
            let mut e = Vec::new();
            e.extend((i as u16 * 7).to_le_bytes());
            e.extend((i as u16 * i as u16).to_le_bytes());
            e.extend((1.0 + i as f32 * 0.125).to_le_bytes());
            e.extend([i as u8, 0, (i / 8) as u8, ((i * i * 31) >> 3) as u8]);
            e
        };
        (0..40).flat_map(element).collect()
    }

    #[test]
    fn attributes_of_both_versions_are_decoded() {
        for packed in [V0, V1] {
            assert_eq!(decode(&spec("ATTRIBUTES", 12, 40), &bytes(packed)).unwrap(), elements());
        }
    }

    #[test]
    fn indices_of_a_grid_and_strays_are_decoded() {
        // A grid of 4 × 4 vertices, then two triangles of far indices.
        let mut corners: Vec<u32> = Vec::new();
        for p in (0..3).flat_map(|y| (0..3).map(move |x| y * 4 + x)) {
            corners.extend([p, p + 1, p + 4, p + 4, p + 1, p + 5]);
        }
        corners.extend([900, 3, 70_000, 1, 900, 7]);
        let of = |bytes: Vec<u8>| bytes.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect::<Vec<_>>();
        assert_eq!(of(decode(&spec("INDICES", 4, 60), &bytes(SEQUENCE)).unwrap()), corners);
        // The triangle codec may turn a triangle, not turn it over.
        let turned = |t: &[u32; 3]| {
            let k = (0..3).min_by_key(|&k| t[k]).unwrap();
            [t[k], t[(k + 1) % 3], t[(k + 2) % 3]]
        };
        let decoded = of(decode(&spec("TRIANGLES", 4, 60), &bytes(TRIANGLES)).unwrap());
        let all = |c: &[u32]| c.as_chunks::<3>().0.iter().map(turned).collect::<Vec<_>>();
        assert_eq!(all(&decoded), all(&corners));
    }

    #[test]
    fn filters_follow_the_decoder() {
        let filtered = |name: &str, hex: &str| {
            let mut b = bytes(hex);
            filters::apply(Filter::named(name, 8).unwrap(), &mut b, 8);
            b
        };
        let oct = filtered("OCTAHEDRAL", "6d030000ff07ff7fcbfac405ff070180");
        assert_eq!(oct, bytes("c54c00006b66ff7f97c2ca4c0dae0180"));
        let quat = filtered("QUATERNION", "a70559faa705fc072101ea072101fd07");
        assert_eq!(quat, bytes("0f40fa3f06c0fa3fc70c9f59c70c9459"));
        let color = filtered("COLOR", "000801fc0000ff0f8004ff0681fb000c");
        assert_eq!(color, bytes("14400880fbbfffffefff100002200880"));
    }

    #[test]
    fn damaged_streams_are_refused_and_never_read_past_their_end() {
        for (mode, stride, count, hex) in [
            ("ATTRIBUTES", 12, 40, V0),
            ("ATTRIBUTES", 12, 40, V1),
            ("TRIANGLES", 2, 60, TRIANGLES),
            ("INDICES", 4, 60, SEQUENCE),
        ] {
            let (spec, whole) = (spec(mode, stride, count), bytes(hex));
            for cut in 0..whole.len() {
                assert!(decode(&spec, &whole[..cut]).is_err(), "{mode} cut at {cut}");
            }
            // Every byte changed in three ways: an error or other numbers, no panic.
            for at in 0..whole.len() {
                for change in [1, 0x80, 0xFF] {
                    let mut damaged = whole.clone();
                    damaged[at] ^= change;
                    let _ = decode(&spec, &damaged);
                }
            }
        }
        let huge = Spec { count: usize::MAX / 512, ..spec("ATTRIBUTES", 256, 1) };
        assert!(decode(&huge, &bytes(V0)).unwrap_err().contains("cannot hold"));
    }

    #[test]
    fn headers_are_checked() {
        let parse = |key: &str, value: serde_json::Value| {
            let mut json =
                serde_json::json!({"buffer": 0, "byteLength": 9, "byteStride": 4, "count": 3, "mode": "TRIANGLES"});
            json[key] = value;
            Spec::parse(&json).map(|_| ()).unwrap_err()
        };
        assert!(parse("mode", "MESHLETS".into()).contains("MESHLETS"));
        assert!(parse("byteStride", 3.into()).contains("do not fit"));
        assert!(parse("count", 4.into()).contains("do not fit"));
        assert!(parse("count", "4".into()).contains("whole number"));
        assert!(parse("filter", "OCTAHEDRAL".into()).contains("attributes only"));
        assert!(parse("filter", "ZIP".into()).contains("ZIP"));
    }
}

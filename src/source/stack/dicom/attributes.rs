//! Attributes by which slices of one series belong to different stacks: segment, echo, time, phase, diffusion weighting and others.
//!
//! Based on: NEMA PS3.3, sections C.7.6.16 (multi-frame functional groups), C.8.3 and C.8.13 (MR images), C.8.20 (segmentations).

use super::dataset::{Dataset, File, Tag};

/// An attribute by which slices of a series can belong to different stacks.
pub struct Attribute {
    pub name: &'static str,
    /// Whether it never changes within a stack, so that it parts slices that lie apart, too.
    pub constant: bool,
    /// Its place: a sequence of the functional groups (0: none) and the attribute in it; the first that is there counts.
    places: &'static [(Tag, Tag)],
    read: fn(&File, &Dataset, Tag) -> Option<String>,
}

fn text(file: &File, data: &Dataset, tag: Tag) -> Option<String> {
    file.text(data, tag)
}

fn binary(file: &File, data: &Dataset, tag: Tag) -> Option<String> {
    file.floats(data, tag).map(|list| list.iter().map(f64::to_string).collect::<Vec<_>>().join("/"))
}

fn whole(file: &File, data: &Dataset, tag: Tag) -> Option<String> {
    file.whole(data, tag).map(|n| n.to_string())
}

/// Diffusion weighting, as the standard and as three makers write it: a double, a word, a float, or a word with a large offset.
fn b_value(file: &File, data: &Dataset, tag: Tag) -> Option<String> {
    match tag {
        0x0019_100c => file.text(data, tag),
        0x0043_1039 => Some((file.numbers(data, tag)?.first()? % 1e5).to_string()),
        _ => binary(file, data, tag),
    }
}

/// From what decides most to what decides least.
pub const ATTRIBUTES: [Attribute; 14] = [
    Attribute { name: "segment", constant: true, places: &[(0x0062_000a, 0x0062_000b)], read: whole },
    Attribute { name: "stack", constant: true, places: &[(0x0020_9111, 0x0020_9056)], read: text },
    Attribute { name: "echo", constant: true, places: &[(0, 0x0018_0086)], read: text },
    Attribute { name: "echo time", constant: true, places: &[(0, 0x0018_0081)], read: text },
    Attribute { name: "echo time", constant: true, places: &[(0x0018_9114, 0x0018_9082)], read: binary },
    Attribute {
        name: "b",
        constant: true,
        places: &[(0x0018_9117, 0x0018_9087), (0, 0x0019_100c), (0, 0x2001_1003), (0, 0x0043_1039)],
        read: b_value,
    },
    Attribute { name: "time", constant: true, places: &[(0, 0x0020_0100)], read: text },
    Attribute { name: "time", constant: true, places: &[(0x0020_9111, 0x0020_9128)], read: whole },
    Attribute { name: "type", constant: false, places: &[(0x0018_9226, 0x0008_9007), (0, 0x0008_0008)], read: text },
    Attribute { name: "inversion time", constant: false, places: &[(0, 0x0018_0082)], read: text },
    Attribute { name: "flip angle", constant: false, places: &[(0, 0x0018_1314)], read: text },
    Attribute { name: "acquisition", constant: false, places: &[(0, 0x0020_0012)], read: text },
    Attribute { name: "direction", constant: false, places: &[(0, 0x0018_9089)], read: binary },
    Attribute { name: "phase", constant: false, places: &[(0x0018_9118, 0x0020_9153)], read: binary },
];

/// Attributes of a frame, from what is said of itself, of all frames, and of the file, in this order.
pub fn attributes(file: &File, places: &[Option<&Dataset>]) -> Vec<Option<String>> {
    let find = |attribute: &Attribute| {
        attribute.places.iter().find_map(|&(sequence, tag)| {
            places.iter().flatten().find_map(|place| {
                let deep = place.items(sequence).first().and_then(|d| (attribute.read)(file, d, tag));
                deep.or_else(|| (attribute.read)(file, place, tag))
            })
        })
    };
    ATTRIBUTES.iter().map(find).collect()
}

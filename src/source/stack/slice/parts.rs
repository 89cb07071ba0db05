//! The parts of an EXR: one, or several that are the slices of a stack; of each, one layer.

use std::io::Cursor;
use std::path::Path;

use exr::prelude::{ReadChannels, ReadLayers};

use super::{ImageInfo, MAX_PIXELS, Sink, Slice, check_memory, check_size};
use crate::source::stack::choice::Choice;
use crate::source::stack::coding::{Coding, Kind};
use crate::source::stack::natural::natural;
use crate::{Error, Result};

type Layer = exr::prelude::Layer<exr::prelude::AnyChannels<exr::prelude::FlatSamples>>;

/// Pixels of all parts together.
const MAX_ALL: u64 = 4 * MAX_PIXELS;

/// Give the slices of an EXR.
pub fn read(choice: &Choice, path: &Path, bytes: &[u8], sink: &mut dyn Sink) -> Result<()> {
    let broken = |e: exr::error::Error| match e {
        exr::error::Error::NotSupported(e) => Error::unsupported(path, e.into_owned()),
        e => Error::input(path, "", format!("cannot be read as an EXR: {e}")),
    };
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?;
    let (mut all, mut needed) = (0u64, 0u64);
    for header in &meta.headers {
        let (width, height) = (header.layer_size.width() as u64, header.layer_size.height() as u64);
        check_size(path, width, height, bytes.len() as u64)?;
        all = all.saturating_add(width.saturating_mul(height));
        // All parts are decoded at once, and one of them is held as numbers of 32 bits, twice.
        let (own, channels) = (header.channels.bytes_per_pixel as u64, header.channels.list.len() as u64);
        needed = needed.saturating_add(width.saturating_mul(height).saturating_mul(own + 8 * channels));
    }
    if all > MAX_ALL {
        let what = format!("the number of pixels of all parts of {}", path.display());
        return Err(Error::Limit { what, needed: all, allowed: MAX_ALL });
    }
    check_memory(choice, path, needed)?;
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(broken)?;
    let mut about = ImageInfo::default();
    choice.frame(1, &mut about.warnings)?;
    let mut groups = alike(image.layer_data.into_iter().collect());
    let mut group = 0;
    if groups.len() > 1 {
        let names: Vec<String> = groups.iter().map(|g| name(&g[0])).collect();
        group = choice.channel(&names, &mut about.warnings)?;
        about.chosen = true;
    }
    let parts = groups.swap_remove(group);
    let sets = channel_sets(&parts[0]);
    let mut set = 0;
    if sets.len() > 1 && !about.chosen {
        let names: Vec<String> = sets.iter().map(|s| s.0.clone()).collect();
        set = choice.channel(&names, &mut about.warnings)?;
        about.chosen = true;
    }
    let Some((_, channels)) = sets.into_iter().nth(set) else {
        return Err(Error::input(path, "", "an EXR without channels"));
    };
    sink.about(about)?;
    for part in parts {
        let wrong = || {
            Error::unsupported(
                path,
                format!("an EXR whose channels {channels:?} have fewer samples than it has pixels"),
            )
        };
        sink.slice(slice(&part, &channels).ok_or_else(wrong)?)?;
    }
    Ok(())
}

fn name(part: &Layer) -> String {
    part.attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default()
}

fn channel_names(part: &Layer) -> Vec<String> {
    part.channel_data.list.iter().map(|c| c.name.to_string()).collect()
}

/// Parts of the same size and channels together; those whose names differ by their numbers alone in the numbers' order.
fn alike(parts: Vec<Layer>) -> Vec<Vec<Layer>> {
    let mut groups: Vec<Vec<Layer>> = Vec::new();
    for part in parts {
        let like = |g: &&mut Vec<Layer>| g[0].size == part.size && channel_names(&g[0]) == channel_names(&part);
        match groups.iter_mut().find(like) {
            Some(group) => group.push(part),
            None => groups.push(vec![part]),
        }
    }
    for group in &mut groups {
        let bare = |part: &Layer| name(part).replace(|c: char| c.is_ascii_digit(), "");
        if group.iter().all(|part| bare(part) == bare(&group[0])) {
            group.sort_by(|a, b| natural(&name(a), &name(b)));
        }
    }
    groups
}

/// Names of the images that a part holds, each with its channels: colours and luminance first.
fn channel_sets(part: &Layer) -> Vec<(String, Vec<String>)> {
    let all = channel_names(part);
    let mut prefixes: Vec<&str> = vec![""];
    for name in &all {
        let prefix = name.rfind('.').map_or("", |at| &name[..=at]);
        if !prefixes.contains(&prefix) {
            prefixes.push(prefix);
        }
    }
    let (mut sets, mut taken) = (Vec::new(), Vec::new());
    for prefix in prefixes {
        let colours: [&[&str]; 3] = [&["R", "G", "B", "A"], &["R", "G", "B"], &["Y"]];
        let found = colours.into_iter().map(|list| list.iter().map(|c| format!("{prefix}{c}")).collect::<Vec<_>>());
        if let Some(list) = found.into_iter().find(|list| list.iter().all(|c| all.contains(c))) {
            let label = if prefix.is_empty() { list.concat() } else { prefix.trim_end_matches('.').to_owned() };
            // Chroma of a luminance, and an opacity beside it, are no images.
            taken.extend(["RY", "BY", "A"].map(|c| format!("{prefix}{c}")));
            taken.extend(list.iter().cloned());
            sets.push((label, list));
        }
    }
    let rest = all.into_iter().filter(|c| !taken.contains(c));
    sets.extend(rest.map(|c| (c.clone(), vec![c])));
    sets
}

fn slice(part: &Layer, channels: &[String]) -> Option<Slice> {
    let (width, height) = (part.size.width(), part.size.height());
    let plane = |name: &String| -> Option<Vec<f32>> {
        let channel = part.channel_data.list.iter().find(|c| c.name.to_string() == *name)?;
        let values: Vec<f32> = channel.sample_data.values_as_f32().collect();
        (values.len() == width * height).then_some(values)
    };
    let planes: Vec<Vec<f32>> = channels.iter().map(plane).collect::<Option<_>>()?;
    let mut bytes = Vec::with_capacity(width * height * planes.len() * 4);
    for i in 0..width * height {
        planes.iter().for_each(|plane| bytes.extend(plane[i].to_ne_bytes()));
    }
    let at = part.attributes.layer_position;
    Some(Slice { width, height, coding: Coding::native(Kind::F32, planes.len()), bytes, origin: [at.x(), at.y()] })
}

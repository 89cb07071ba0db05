//! Descriptions that programs write into a TIFF about its pages: ImageJ's hyperstacks, OME, and the axes that tifffile writes.
//!
//! Based on: the Open Microscopy Environment's OME-TIFF specification, schema 2016-06; ImageJ's `TiffEncoder`.

use std::collections::{BTreeMap, BTreeSet};

use super::Spacing;
use crate::source::stack::header::metres;

/// Planes that a description may list.
const MAX_PLANES: usize = 1 << 22;

/// Arrangement of pages as slices, channels and frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    pub slices: usize,
    pub channels: usize,
    pub frames: usize,
    /// One per channel, empty where it has none.
    pub names: Vec<String>,
    pub spacing: Option<Spacing>,
    /// What is to be said of how it was understood.
    pub notes: Vec<String>,
    /// Whether it names no axes: then it counts only where it agrees with the pages.
    pub is_guess: bool,
    /// Pages from one slice, channel and frame to the next.
    strides: [usize; 3],
    /// Page of each plane where they are listed; `Err` with the name of the other file that it is in.
    listed: Option<BTreeMap<usize, Result<usize, String>>>,
}

/// What a page says of itself by a TIFF's own tags.
#[derive(Debug, Clone, Copy, Default)]
pub struct Page {
    pub width: usize,
    pub height: usize,
    /// Pixels per unit along rows and columns.
    pub x: Option<f64>,
    pub y: Option<f64>,
    /// Code of the unit: 2 for inches, 3 for centimetres.
    pub unit: u16,
}

impl Description {
    /// For axes in the order of `letters`, the fastest first, of which Z, C and T count.
    fn new(letters: &str, [slices, channels, frames]: [usize; 3]) -> Option<Description> {
        let mut strides = [0; 3];
        let mut stride = 1usize;
        for letter in letters.chars() {
            let (axis, size) = match letter {
                'Z' => (0, slices),
                'C' => (1, channels),
                'T' => (2, frames),
                _ => continue,
            };
            strides[axis] = stride;
            stride = stride.checked_mul(size)?;
        }
        let names = vec![String::new(); channels.min(MAX_PLANES)];
        let known = (1..=MAX_PLANES).contains(&stride) && strides.iter().all(|s| *s > 0);
        let plain = Description {
            slices,
            channels,
            frames,
            names,
            spacing: None,
            notes: Vec::new(),
            is_guess: false,
            strides,
            listed: None,
        };
        known.then_some(plain)
    }

    /// Description in `text`; `None` where it is of none of these programs.
    pub fn parse(text: &str, page: Page, own_name: &str) -> Option<Description> {
        let text = text.trim_start_matches('\u{feff}').trim_start();
        if text.starts_with("ImageJ=") {
            imagej(text, page)
        } else if text.starts_with('{') {
            tifffile(text, page)
        } else if text.starts_with('<') && text.contains("<OME") {
            ome(text, own_name)
        } else {
            None
        }
    }

    /// Number of planes.
    pub fn count(&self) -> usize {
        self.slices * self.channels * self.frames
    }

    /// Whether each plane's page is listed.
    pub fn is_listed(&self) -> bool {
        self.listed.is_some()
    }

    /// Take frames of one slice each for slices.
    pub fn frames_are_slices(&mut self) {
        self.slices = self.frames;
        self.frames = 1;
        self.strides.swap(0, 2);
    }

    /// Page of a plane; the error says where it is instead.
    pub fn page(&self, slice: usize, channel: usize, frame: usize) -> Result<usize, String> {
        let [z, c, t] = self.strides;
        let plane = slice * z + channel * c + frame * t;
        match &self.listed {
            None => Ok(plane),
            Some(list) => list.get(&plane).cloned().unwrap_or_else(|| Err("nowhere in it".into())),
        }
    }
}

fn imagej(text: &str, page: Page) -> Option<Description> {
    let value = |key: &str| text.lines().find_map(|l| l.strip_prefix(key)?.strip_prefix('=')).map(str::trim);
    let count = |key: &str| value(key).and_then(|v| v.parse::<usize>().ok()).filter(|n| *n > 0).unwrap_or(1);
    let images = count("images");
    let (channels, mut slices, frames) = (count("channels"), count("slices"), count("frames"));
    if channels.saturating_mul(slices).saturating_mul(frames) != images {
        slices = (images / channels.saturating_mul(frames).max(1)).max(1);
    }
    let mut description = Description::new("CZT", [slices, channels, frames])?;
    let distance = |pixels: Option<f64>| pixels.map(|p| 1.0 / p).filter(|d| d.is_finite() && *d > 0.0);
    let between = value("spacing").and_then(|v| v.parse::<f64>().ok()).map(f64::abs);
    let between = between.filter(|d| d.is_finite() && *d > 0.0);
    let unit = value("unit").and_then(metres).or(match page.unit {
        2 => metres("inch"),
        3 => metres("cm"),
        _ => None,
    });
    let (columns, rows) = (distance(page.x).unwrap_or(1.0), distance(page.y).unwrap_or(1.0));
    if unit.is_some() || between.is_some() || columns != rows {
        description.spacing = Some(millimetres(columns, rows, between, unit));
    }
    Some(description)
}

/// In millimetres, where metres per unit are known.
fn millimetres(columns: f64, rows: f64, slices: Option<f64>, unit: Option<f64>) -> Spacing {
    let factor = unit.map_or(1.0, |m| m * 1e3);
    let metres = if unit.is_some() { 1e-3 } else { 0.0 };
    Spacing { columns: columns * factor, rows: rows * factor, slices: slices.map(|s| s * factor), metres }
}

/// `{"shape": [2, 16, 24, 20], "axes": "CZYX"}`: the slowest axis first. Without axes, the last before those of a page are slices,
/// and the others frames.
fn tifffile(text: &str, page: Page) -> Option<Description> {
    let json: serde_json::Value = serde_json::from_str(text).ok()?;
    let shape: Vec<usize> =
        json.get("shape")?.as_array()?.iter().map(|v| usize::try_from(v.as_u64()?).ok()).collect::<Option<_>>()?;
    let Some(axes) = json.get("axes") else {
        let is_page = |n: &usize| shape[*n..*n + 2] == [page.height, page.width];
        let at = [2, 3].iter().filter_map(|n| shape.len().checked_sub(*n)).find(is_page)?;
        let (slices, frames) = shape[..at].split_last().filter(|(_, frames)| !frames.is_empty())?;
        let frames = frames.iter().try_fold(1usize, |product, n| product.checked_mul(*n))?;
        return Some(Description { is_guess: true, ..Description::new("ZCT", [*slices, 1, frames])? });
    };
    let mut letters: Vec<char> = axes.as_str()?.chars().collect();
    if letters.len() != shape.len() || shape.contains(&0) {
        return None;
    }
    // One axis of another name is of frames, beside slices.
    let is_other = |(n, l): &(usize, &char)| !"TCZYXS".contains(**l) && shape[*n] > 1;
    if let (Some((other, _)), true, false) =
        (letters.iter().enumerate().find(is_other), letters.contains(&'Z'), letters.contains(&'T'))
    {
        letters[other] = 'T';
    }
    let size = |letter: char| letters.iter().position(|&l| l == letter).map_or(1, |n| shape[n]);
    // An axis of another name would be lost.
    let known = letters.iter().zip(&shape).all(|(l, n)| "TCZYXS".contains(*l) || *n == 1);
    let mut fastest: String = letters.iter().rev().collect();
    "ZCT".chars().filter(|l| !letters.contains(l)).for_each(|l| fastest.push(l));
    known.then(|| Description::new(&fastest, ['Z', 'C', 'T'].map(size)))?
}

fn ome(text: &str, own_name: &str) -> Option<Description> {
    let document = roxmltree::Document::parse(text.trim_end_matches(['\0', ' ', '\n', '\r'])).ok()?;
    let is = |n: &roxmltree::Node, name: &str| n.is_element() && n.tag_name().name() == name;
    let pixels = document.descendants().find(|n| is(n, "Pixels"))?;
    let children = |name: &'static str| pixels.children().filter(move |n| is(n, name));
    let size =
        |name: &str| pixels.attribute(name).and_then(|v| v.parse::<usize>().ok()).filter(|n| *n > 0).unwrap_or(1);
    // Red, green and blue are three channels in the count and one plane.
    let wide = |c: &roxmltree::Node| c.attribute("SamplesPerPixel").and_then(|v| v.parse::<usize>().ok()).unwrap_or(1);
    let channels: Vec<roxmltree::Node> = children("Channel").collect();
    let samples: usize = channels.iter().map(wide).fold(0, usize::saturating_add);
    let planes = if !channels.is_empty() && samples == size("SizeC") { channels.len() } else { size("SizeC") };
    let letters = pixels.attribute("DimensionOrder").unwrap_or("XYCZT");
    let mut out = Description::new(letters, [size("SizeZ"), planes, size("SizeT")])?;
    let images = document.descendants().filter(|n| is(n, "Pixels")).count();
    if images > 1 {
        out.notes.push(format!("its description tells of {images} images: the first is taken"));
    }
    for (name, channel) in out.names.iter_mut().zip(&channels) {
        *name = channel.attribute("Name").unwrap_or_default().to_owned();
    }
    let length = |axis: &str| -> Option<(f64, f64)> {
        let value = pixels.attribute(format!("PhysicalSize{axis}").as_str())?.parse::<f64>().ok()?;
        let unit = pixels.attribute(format!("PhysicalSize{axis}Unit").as_str()).unwrap_or("um");
        (value.is_finite() && value > 0.0).then_some((value, metres(unit)?))
    };
    let (width, height) = (length("X"), length("Y"));
    if width.is_some() != height.is_some() {
        out.notes
            .push("its description gives the size of a pixel along one axis: the other is taken for the same".into());
    }
    if let (Some((x, unit)), Some((y, unit_y))) = (width.or(height), height.or(width)) {
        let slices = length("Z").map(|(z, unit_z)| z * unit_z / unit);
        out.spacing = Some(millimetres(x, y * unit_y / unit, slices, Some(unit)));
    }
    let data: Vec<roxmltree::Node> = children("TiffData").collect();
    if !data.is_empty() {
        let (list, renamed) = listed(&out, &data, own_name);
        out.listed = Some(list);
        let note = |name| format!("its description calls it {name}: it is taken for that file under another name");
        out.notes.extend(renamed.map(note));
    }
    Some(out)
}

/// The element that names the file of a plane.
fn named<'a, 'i>(plane: &roxmltree::Node<'a, 'i>) -> Option<roxmltree::Node<'a, 'i>> {
    plane.children().find(|n| n.attribute("FileName").is_some())
}

/// Page of each plane by the elements that list them. A file that was given another name is known by its UUID, and where all
/// planes are in one file, that is it; then its other name comes second.
fn listed(
    out: &Description,
    data: &[roxmltree::Node],
    own_name: &str,
) -> (BTreeMap<usize, Result<usize, String>>, Option<String>) {
    let mut list = BTreeMap::new();
    let total = out.count();
    let names: BTreeSet<Option<String>> =
        data.iter().map(|n| named(n)?.attribute("FileName").map(str::to_owned)).collect();
    let root = data.first().and_then(|n| n.document().root_element().attribute("UUID").map(str::trim));
    let is_own = |n: &roxmltree::Node| {
        let uuid = n.text().map(str::trim);
        names.len() == 1 || n.attribute("FileName") == Some(own_name) || uuid.is_some() && uuid == root
    };
    for node in data {
        let number = |name: &str| node.attribute(name).and_then(|v| v.parse::<usize>().ok());
        let [z, c, t] = out.strides;
        let first = ["FirstZ", "FirstC", "FirstT"].map(|n| number(n).unwrap_or(0).min(total));
        let plane = first[0] * z + first[1] * c + first[2] * t;
        let page = number("IFD");
        let count = number("PlaneCount").unwrap_or(if page.is_some() { 1 } else { total });
        let file = named(node).filter(|n| !is_own(n)).and_then(|n| n.attribute("FileName"));
        for n in 0..count.min(total.saturating_sub(plane)) {
            let place =
                file.map_or_else(|| Ok(page.unwrap_or(0).saturating_add(n)), |f| Err(format!("in the file {f:?}")));
            list.insert(plane + n, place);
        }
    }
    let only = if names.len() == 1 { names.into_iter().next().flatten() } else { None };
    (list, only.filter(|name| name != own_name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn imagej_counts_channels_before_slices_before_frames() {
        let text = "ImageJ=1.53t\nimages=24\nchannels=2\nslices=4\nframes=3\nspacing=2.5\nunit=\\u00B5m\n";
        let page = Page { x: Some(4.0), y: Some(2.0), unit: 1, ..Page::default() };
        let d = Description::parse(text, page, "").unwrap();
        assert_eq!((d.slices, d.channels, d.frames, d.count()), (4, 2, 3, 24));
        assert_eq!(d.page(3, 1, 2), Ok(23));
        assert_eq!(d.page(1, 1, 0), Ok(3));
        let s = d.spacing.unwrap();
        assert!((s.columns - 0.25e-3).abs() < 1e-12 && (s.rows - 0.5e-3).abs() < 1e-12 && s.metres == 1e-3);
        assert!((s.slices.unwrap() - 2.5e-3).abs() < 1e-12);
        // Without a unit only the ratio is known; without anything, nothing.
        let plain = "ImageJ=1.53t\nimages=5\nslices=5\n";
        assert_eq!(Description::parse(plain, Page::default(), "").unwrap().spacing, None);
        let ratio = Description::parse(&format!("{plain}spacing=3\n"), Page::default(), "").unwrap().spacing;
        assert_eq!(ratio, Some(Spacing { columns: 1.0, rows: 1.0, slices: Some(3.0), metres: 0.0 }));
    }

    #[test]
    fn ome_lists_planes_in_its_own_order() {
        let text = r#"<?xml version="1.0"?><OME xmlns="http://x"><Image><Pixels DimensionOrder="XYZTC" SizeZ="3" SizeC="2"
            SizeT="2" PhysicalSizeX="0.5" PhysicalSizeY="500" PhysicalSizeYUnit="nm" PhysicalSizeZ="0.003" PhysicalSizeZUnit="mm">
            <Channel Name="DAPI"/><Channel/><TiffData FirstC="1" IFD="0" PlaneCount="6"/><TiffData IFD="6" PlaneCount="3"/>
            <TiffData FirstT="1" IFD="0" PlaneCount="3"><UUID FileName="b.ome.tif"/></TiffData></Pixels></Image></OME>"#;
        let d = Description::parse(text, Page::default(), "a.ome.tif").unwrap();
        assert_eq!((d.slices, d.channels, d.frames), (3, 2, 2));
        assert_eq!(d.names, ["DAPI", ""]);
        assert_eq!([d.page(0, 1, 0), d.page(2, 1, 1), d.page(2, 0, 0)], [Ok(0), Ok(5), Ok(8)]);
        assert!(d.page(1, 0, 1).unwrap_err().contains("b.ome.tif"));
        let s = d.spacing.unwrap();
        assert!((s.rows - s.columns).abs() < 1e-12 && (s.slices.unwrap() / s.columns - 6.0).abs() < 1e-9);
    }

    #[test]
    fn a_file_of_ome_that_got_another_name_is_known() {
        let ome = |planes: &str| {
            let text = format!(
                r#"<OME UUID="urn:uuid:1"><Image><Pixels DimensionOrder="XYZCT" SizeZ="2" PhysicalSizeX="0.5">{planes}</Pixels>
                </Image><Image><Pixels DimensionOrder="XYZCT"/></Image></OME>"#
            );
            Description::parse(&text, Page::default(), "new.tif").unwrap()
        };
        let plane = |z: usize, file: &str, uuid: &str| {
            format!(r#"<TiffData FirstZ="{z}" IFD="{z}"><UUID FileName="{file}">urn:uuid:{uuid}</UUID></TiffData>"#)
        };
        let alone = ome(&[plane(0, "old.tif", "7"), plane(1, "old.tif", "7")].concat());
        assert_eq!([alone.page(0, 0, 0), alone.page(1, 0, 0)], [Ok(0), Ok(1)]);
        assert!(alone.notes.iter().any(|n| n.contains("old.tif")), "{:?}", alone.notes);
        let several = ome(&[plane(0, "old.tif", "1"), plane(1, "other.tif", "2")].concat());
        assert_eq!(several.page(0, 0, 0), Ok(0));
        assert!(several.page(1, 0, 0).unwrap_err().contains("other.tif"));
        let s = several.spacing.unwrap();
        assert_eq!((s.rows, several.notes.len()), (s.columns, 2), "{:?}", several.notes);
    }

    #[test]
    fn axes_of_tifffile_are_the_slowest_first_and_nonsense_is_none() {
        let d = Description::parse(r#"{"shape": [3, 2, 8, 9], "axes": "ZCYX"}"#, Page::default(), "").unwrap();
        assert_eq!((d.slices, d.channels, d.frames, d.page(2, 1, 0)), (3, 2, 1, Ok(5)));
        // Without axes, and with one of another name: two volumes of three slices.
        let page = Page { width: 9, height: 8, ..Page::default() };
        for text in [
            r#"{"shape": [2, 3, 8, 9]}"#,
            r#"{"shape": [2, 3, 8, 9, 3]}"#,
            r#"{"shape": [2, 3, 8, 9], "axes": "QZYX"}"#,
        ] {
            let d = Description::parse(text, page, "").unwrap();
            assert_eq!((d.slices, d.channels, d.frames, d.page(2, 0, 1)), (3, 1, 2, Ok(5)), "{text}");
        }
        assert_eq!(Description::parse(r#"{"shape": [3, 8, 9]}"#, page, ""), None, "one volume");
        for text in [
            "a picture",
            r#"{"shape": [3, 2, 8, 9]}"#,
            r#"{"shape": [3], "axes": "ZYX"}"#,
            r#"{"shape": [4, 3, 8, 9], "axes": "QRYX"}"#,
            "<OME><Pixels",
            r#"<OME><Pixels DimensionOrder="XYCZT" SizeZ="99999999" SizeT="99999999"/></OME>"#,
            "ImageJ=1\nimages=99999999999\n",
        ] {
            assert_eq!(Description::parse(text, Page::default(), ""), None, "{text}");
        }
    }
}

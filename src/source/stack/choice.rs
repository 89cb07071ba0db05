//! Selection of a channel and a frame in files that hold several. Where the options select none, the first is used, with a warning that
//! lists all.

use std::path::Path;

use super::coding::MAX_CHANNELS;
use super::options::StackOptions;
use crate::{Error, Result, Warnings};

/// Entries that a list names.
const MAX_LISTED: usize = 20;

/// Channel and frame that are asked for of one file or folder.
#[derive(Clone, Copy)]
pub struct Choice<'a> {
    pub path: &'a Path,
    channel: Option<&'a str>,
    frame: Option<usize>,
    /// UID or number of a DICOM series, and after a colon the number of a stack in it.
    pub series: Option<&'a str>,
    /// Bytes that decoding may take at a time.
    pub memory: u64,
}

/// "1 DAPI, 2 GFP", numbers alone where names say no more.
fn listed(names: &[String]) -> String {
    let entry = |(n, name): (usize, &String)| {
        let number = (n + 1).to_string();
        if name.is_empty() || *name == number { number } else { format!("{number} {name}") }
    };
    let mut list: Vec<String> = names.iter().enumerate().take(MAX_LISTED).map(entry).collect();
    if names.len() > MAX_LISTED {
        list.push(format!("… {}", names.len()));
    }
    list.join(", ")
}

impl<'a> Choice<'a> {
    pub fn new(path: &'a Path, options: &'a StackOptions, memory: u64) -> Choice<'a> {
        let (channel, series) = (options.channel.as_deref(), options.series.as_deref());
        Choice { path, channel, frame: options.frame, series, memory }
    }

    /// Whether a channel was asked for.
    pub fn names_channel(&self) -> bool {
        self.channel.is_some()
    }

    /// Whether a frame was asked for.
    pub fn names_frame(&self) -> bool {
        self.frame.is_some()
    }

    /// Choices left to ask of the files of a folder, where the folder itself told channels or frames apart.
    pub fn within(self, by_channel: bool, by_frame: bool) -> Choice<'a> {
        let channel = self.channel.filter(|_| !by_channel);
        Choice { channel, frame: self.frame.filter(|_| !by_frame), ..self }
    }

    /// Index of the channel that is taken of those with these names, which may be empty: the one that was asked for by name or
    /// number, or the first, with a warning that lists all.
    ///
    /// # Errors
    /// [`Error::Input`] where none of them is the one that was asked for.
    pub fn channel(&self, names: &[String], warnings: &mut Warnings) -> Result<usize> {
        let Some(wanted) = self.channel else {
            if names.len() > 1 {
                let what = format!(
                    "{} channels are in it ({}): the first is taken, or choose with option `channel`",
                    names.len(),
                    listed(names)
                );
                warnings.add(what);
            }
            return Ok(0);
        };
        let by_name = names.iter().position(|n| n == wanted && !n.is_empty());
        let by_number = || wanted.parse::<usize>().ok()?.checked_sub(1).filter(|n| *n < names.len());
        by_name.or_else(by_number).ok_or_else(|| {
            let what = format!("option `channel` = {wanted} is not in it; there are: {}", listed(names));
            Error::input(self.path, "", what)
        })
    }

    /// Index of the frame that is taken of `count`: the one that was asked for, or the first, with a warning.
    ///
    /// # Errors
    /// [`Error::Input`] where there are not as many.
    pub fn frame(&self, count: usize, warnings: &mut Warnings) -> Result<usize> {
        match self.frame {
            None if count > 1 => {
                warnings.add(format!(
                    "{count} frames (volumes) are in it: the first is taken, or choose with option `frame` = 1 to {count}"
                ));
                Ok(0)
            }
            None => Ok(0),
            Some(wanted) if (1..=count).contains(&wanted) => Ok(wanted - 1),
            Some(wanted) => Err(Error::input(
                self.path,
                "",
                format!("option `frame` = {wanted} is not in it; there are 1 to {count}"),
            )),
        }
    }
}

/// Axes of a file beyond the three of space: its volumes are stored one after the other.
pub struct OuterAxes {
    /// Number of samples along each outer axis, the first fastest, and whether it counts channels.
    pub axes: Vec<(usize, bool)>,
}

/// One of several volumes in a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoredVolume {
    pub index: u64,
    pub count: u64,
}

impl StoredVolume {
    pub const ONLY: StoredVolume = StoredVolume { index: 0, count: 1 };
}

impl OuterAxes {
    fn count(&self, channels: bool) -> usize {
        self.axes.iter().filter(|a| a.1 == channels).fold(1, |n, a| n.saturating_mul(a.0))
    }

    /// The volume of the channel and the frame that `choice` takes.
    pub fn choose(&self, choice: &Choice, warnings: &mut Warnings) -> Result<StoredVolume> {
        let frame = choice.frame(self.count(false), warnings)?;
        let channels = self.count(true);
        if channels > MAX_CHANNELS {
            let what = format!("{channels} channels, one after the other; up to {MAX_CHANNELS} are read");
            return Err(Error::input(choice.path, "", what));
        }
        let mut left = [frame, 0];
        if channels > 1 || choice.names_channel() && self.axes.iter().any(|a| a.1) {
            left[1] = choice.channel(&vec![String::new(); channels], warnings)?;
        }
        let (mut index, mut stride) = (0u64, 1u64);
        for &(size, is_channel) in &self.axes {
            // An axis without samples is an error elsewhere.
            let size = size.max(1);
            let rest = &mut left[usize::from(is_channel)];
            index = index.saturating_add(stride.saturating_mul((*rest % size) as u64));
            *rest /= size;
            stride = stride.saturating_mul(size as u64);
        }
        Ok(StoredVolume { index, count: stride })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Their names take memory before any sample is looked at: a header of a few bytes asked for 2^63 of them.
    #[test]
    fn more_channels_than_are_read_are_refused() {
        let options = StackOptions::default();
        let choose = |size: usize, channels: bool| {
            let outer = OuterAxes { axes: vec![(2, channels), (size, channels)] };
            outer.choose(&Choice::new(Path::new("a"), &options, 1 << 30), &mut Warnings::default())
        };
        assert_eq!(choose(MAX_CHANNELS / 2, true).unwrap().count, MAX_CHANNELS as u64);
        for size in [MAX_CHANNELS, 1 << 40, usize::MAX] {
            let said = choose(size, true).unwrap_err().to_string();
            assert!(said.contains("channels, one after the other; up to 65536 are read"), "{said}");
        }
        // Frames have no names, and whether all are there is asked of the samples.
        assert_eq!(choose(1 << 40, false).unwrap().count, 1 << 41);
    }

    #[test]
    fn channels_go_by_name_and_number_and_are_listed() {
        let names = ["DAPI".to_owned(), "2".to_owned(), String::new()];
        let mut options = StackOptions::default();
        let mut warnings = Warnings::default();
        assert_eq!(Choice::new(Path::new("a"), &options, 1 << 30).channel(&names, &mut warnings).unwrap(), 0);
        assert!(warnings.as_reasons().contains("3 channels are in it (1 DAPI, 2, 3)"), "{}", warnings.as_reasons());
        for (wanted, index) in [("DAPI", 0), ("1", 0), ("2", 1), ("3", 2)] {
            options.channel = Some(wanted.into());
            let mut warnings = Warnings::default();
            assert_eq!(Choice::new(Path::new("a"), &options, 1 << 30).channel(&names, &mut warnings).unwrap(), index);
            assert!(warnings.is_empty());
        }
        for wrong in ["0", "4", "dapi", ""] {
            options.channel = Some(wrong.into());
            let error = Choice::new(Path::new("a"), &options, 1 << 30).channel(&names, &mut warnings).unwrap_err();
            assert!(error.to_string().contains("1 DAPI, 2, 3"), "{wrong}: {error}");
        }
    }

    #[test]
    fn volumes_are_counted_with_the_first_axis_fastest() {
        // Three frames, two channels, and four frames more.
        let outer = OuterAxes { axes: vec![(3, false), (2, true), (4, false)] };
        let mut options = StackOptions { frame: Some(8), channel: Some("2".into()), ..StackOptions::default() };
        let mut warnings = Warnings::default();
        // Frame 8 is the second of the third row: 1 + 3 · 1 + 6 · 2.
        let volume = outer.choose(&Choice::new(Path::new("a"), &options, 1 << 30), &mut warnings).unwrap();
        assert_eq!((volume, warnings.is_empty()), (StoredVolume { index: 16, count: 24 }, true));
        options.frame = Some(13);
        let error = outer.choose(&Choice::new(Path::new("a"), &options, 1 << 30), &mut warnings).unwrap_err();
        assert!(error.to_string().contains("1 to 12"), "{error}");
    }
}

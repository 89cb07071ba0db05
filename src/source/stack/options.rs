//! Options of reading a stack.

use std::path::PathBuf;

use super::transfer::TransferSpec;

/// Options by which a stack is read.
#[derive(Debug, Clone, PartialEq)]
pub struct StackOptions {
    /// Matter by value; where it is empty, values from Otsu's threshold on are opaque.
    pub transfer: TransferSpec,
    /// A file of a transfer function, which is added to `transfer`.
    pub table: Option<PathBuf>,
    /// Standard deviation of the Gaussian that values are filtered with, in distances of samples.
    pub sigma: f64,
    /// Distances of samples in millimetres, in place of all that the file says of how it lies.
    pub spacing: Option<[f64; 3]>,
    /// Series of a DICOM folder, by UID or number; after a colon the number of a stack, where the series holds several.
    pub series: Option<String>,
    /// Channel, by name or by its number from 1 on; `None`: the colours, or the first channel.
    pub channel: Option<String>,
    /// Frame (time, volume) by its number from 1 on; `None`: the first.
    pub frame: Option<usize>,
}

impl Default for StackOptions {
    fn default() -> Self {
        StackOptions {
            transfer: TransferSpec::default(),
            table: None,
            sigma: 0.6,
            spacing: None,
            series: None,
            channel: None,
            frame: None,
        }
    }
}

//! The JSON of animations: channels, samplers and their targets, as serde reads them.

use serde::Deserialize;

/// An animation as the JSON has it.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct Animation {
    pub name: Option<String>,
    pub channels: Vec<Channel>,
    pub samplers: Vec<Sampler>,
}

#[derive(Debug, Deserialize)]
pub struct Channel {
    pub sampler: usize,
    pub target: ChannelTarget,
}

#[derive(Debug, Deserialize)]
pub struct ChannelTarget {
    /// Absent where an extension names the target.
    pub node: Option<usize>,
    pub path: String,
}

#[derive(Debug, Deserialize)]
pub struct Sampler {
    pub input: usize,
    pub output: usize,
    pub interpolation: Option<String>,
}

impl Animation {
    /// Whether all channels move properties of nodes, which core glTF knows.
    pub fn is_core(&self) -> bool {
        self.channels.iter().all(|c| c.target.node.is_some())
    }
}

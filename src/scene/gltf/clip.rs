//! Animations as the JSON of a file has them: which keys move what.

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
    pub target: Target,
}

#[derive(Debug, Deserialize)]
pub struct Target {
    /// Absent where an extension says what moves.
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
    /// Whether all it moves are nodes.
    pub fn is_core(&self) -> bool {
        self.channels.iter().all(|c| c.target.node.is_some())
    }
}

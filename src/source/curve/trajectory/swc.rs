//! Neurons as trees of truncated cones (`.swc`), in micrometres.
//!
//! Based on: R. Cannon et al., *An On-line Archive of Reconstructed Hippocampal Neurons*, J. Neurosci. Methods 1998.

use std::collections::BTreeMap;

use super::{Content, Fault};
use crate::geom::DVec3;
use crate::source::curve::Strand;

struct Node {
    at: DVec3,
    radius: f32,
    parent: Option<usize>,
    /// Of its children the one that goes on; others branch off.
    next: Option<usize>,
}

/// A branch begins at its parent's place with its own radius; a root without children is a ball.
pub fn read(text: &str) -> Result<Content, Fault> {
    let mut nodes: Vec<Node> = Vec::new();
    let mut parents: Vec<(i64, usize)> = Vec::new();
    let mut names: BTreeMap<i64, usize> = BTreeMap::new();
    for (number, line) in text.lines().enumerate() {
        let fault = |what: String| (format!("line {}", number + 1), what);
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let words: Vec<&str> = line.split_whitespace().collect();
        let [id, _, x, y, z, radius, parent, ..] = words[..] else {
            return Err(fault(format!("{} words where a node has seven: id type x y z radius parent", words.len())));
        };
        let number = |name: &str, word: &str| {
            let value = word.parse::<f64>().ok().filter(|v| v.is_finite());
            value.ok_or_else(|| fault(format!("{name} is `{word}` and not a number")))
        };
        let whole = |name: &str, word: &str| number(name, word).map(|v| v as i64);
        let at = DVec3::new(number("x", x)?, number("y", y)?, number("z", z)?);
        let radius = number("the radius", radius)? as f32;
        let id = whole("the id", id)?;
        if names.insert(id, nodes.len()).is_some() {
            return Err(fault(format!("node {id} was there before")));
        }
        parents.push((whole("the parent", parent)?, nodes.len()));
        nodes.push(Node { at, radius, parent: None, next: None });
    }
    let mut content = Content { metres_per_unit: 1e-6, ..Content::default() };
    for &(parent, node) in &parents {
        if parent < 0 {
            continue;
        }
        match names.get(&parent) {
            Some(&p) if p != node => nodes[node].parent = Some(p),
            _ => content.warnings.add("nodes whose parent is not there begin a tree of their own"),
        }
    }
    // The thickest child goes on; the first of equals.
    for i in 0..nodes.len() {
        let Some(parent) = nodes[i].parent else { continue };
        if nodes[parent].next.is_none_or(|n| nodes[i].radius > nodes[n].radius) {
            nodes[parent].next = Some(i);
        }
    }
    let mut seen = 0;
    for (i, node) in nodes.iter().enumerate() {
        let mut strand = Strand::default();
        match node.parent {
            Some(p) if nodes[p].next == Some(i) => continue,
            Some(p) => {
                strand.points.push(nodes[p].at);
                strand.radii.push(node.radius);
            }
            None => {}
        }
        let mut at = Some(i);
        while let Some(n) = at.and_then(|n| nodes.get(n)) {
            strand.points.push(n.at);
            strand.radii.push(n.radius);
            seen += 1;
            at = n.next;
        }
        content.strands.push(strand);
    }
    if seen < nodes.len() {
        content.warnings.add_many("nodes that are their own ancestors are left out", (nodes.len() - seen) as u64);
    }
    Ok(content)
}

//! Neurons as trees of truncated cones (`.swc`), in micrometres.
//!
//! Based on: R. Cannon et al., *An On-line Archive of Reconstructed Hippocampal Neurons*, J. Neurosci. Methods 1998.

use std::collections::BTreeMap;

use super::{Content, Fault};
use crate::geom::DVec3;
use crate::scene::far::Decimals;
use crate::scene::text::logical_lines;
use crate::source::curve::Strand;

/// Type of the nodes of a cell body.
const SOMA: i64 = 1;
/// Share of its radius by which a point of a cell body may be beside the place where NeuroMorpho puts it.
const BESIDE: f64 = 0.05;

struct Node {
    at: DVec3,
    /// NaN where the file gives none.
    radius: f32,
    is_soma: bool,
    parent: Option<usize>,
    /// The child with which the branch goes on; the others branch off.
    next: Option<usize>,
}

/// A branch begins at its parent's place with its own radius; a root that nothing goes on from is a ball. So a cell body of one
/// point is a ball, and one of three points, as NeuroMorpho.org writes it, a cylinder as long as it is wide: its area is that of
/// the ball of that radius.
pub fn read(text: &str) -> Result<Content, Fault> {
    let mut content = Content { metres_per_unit: 1e-6, decimals: Decimals::new(), ..Content::default() };
    let mut nodes = nodes(text, &mut content)?;
    inherit_radii(&mut nodes, &mut content);
    continue_branches(&mut nodes);
    let (strands, reached) = strands(&nodes);
    content.strands = strands;
    if reached < nodes.len() {
        content.warnings.add_many("nodes that are their own ancestors are left out", (nodes.len() - reached) as u64);
    }
    Ok(content)
}

/// The nodes in the order of the file, each with its parent.
fn nodes(text: &str, content: &mut Content) -> Result<Vec<Node>, Fault> {
    let mut nodes: Vec<Node> = Vec::new();
    let mut parents: Vec<i64> = Vec::new();
    let mut names: BTreeMap<i64, usize> = BTreeMap::new();
    for (number, line) in logical_lines(text) {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let fault = |what: String| (format!("line {number}"), what);
        let Line { id, parent, node } = Line::parse(line, &mut content.decimals).map_err(fault)?;
        if names.insert(id, nodes.len()).is_some() {
            return Err(fault(format!("node {id} was there before")));
        }
        parents.push(parent);
        nodes.push(node);
    }
    for (i, parent) in parents.into_iter().enumerate().filter(|(_, parent)| *parent >= 0) {
        match names.get(&parent) {
            Some(&p) if p != i => nodes[i].parent = Some(p),
            _ => content.warnings.add("nodes whose parent is not there begin a tree of their own"),
        }
    }
    Ok(nodes)
}

/// A node with the numbers by which nodes name each other.
struct Line {
    id: i64,
    /// Negative of a root.
    parent: i64,
    node: Node,
}

impl Line {
    fn parse(line: &str, decimals: &mut Decimals) -> Result<Line, String> {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [id, kind, x, y, z, radius, parent, ..] = words[..] else {
            return Err(format!("{} words where a node has seven: id type x y z radius parent", words.len()));
        };
        let number = |name: &str, word: &str| {
            let value = word.parse::<f64>().ok().filter(|v| v.is_finite());
            value.ok_or_else(|| format!("{name} is `{word}` and not a number"))
        };
        let whole = |name: &str, word: &str| number(name, word).map(|v| v as i64);
        [x, y, z].iter().for_each(|word| decimals.see(word));
        let at = DVec3::new(number("x", x)?, number("y", y)?, number("z", z)?);
        let radius = number("the radius", radius)? as f32;
        // A radius that was not measured is written as 0 or −1.
        let radius = if radius > 0.0 { radius } else { f32::NAN };
        let node = Node { at, radius, is_soma: kind.parse() == Ok(SOMA), parent: None, next: None };
        Ok(Line { id: whole("the id", id)?, parent: whole("the parent", parent)?, node })
    }
}

/// Choose the child with which each branch goes on: the thickest, the first of equals. Nothing but a cell body goes on from a
/// cell body.
fn continue_branches(nodes: &mut [Node]) {
    for i in 0..nodes.len() {
        let Some(parent) = nodes[i].parent else { continue };
        if nodes[parent].is_soma && !nodes[i].is_soma {
            continue;
        }
        if nodes[parent].next.is_none_or(|n| nodes[i].radius > nodes[n].radius) {
            nodes[parent].next = Some(i);
        }
    }
}

/// The branches, and the cylinders of cell bodies, as strands; and how many nodes are in them.
fn strands(nodes: &[Node]) -> (Vec<Strand>, usize) {
    let (mut strands, mut reached, cylinders) = (Vec::new(), 0, cylinders(nodes));
    for (i, node) in nodes.iter().enumerate() {
        let mut strand = Strand::default();
        if let Some(&[below, above]) = cylinders.get(&i) {
            strand.points = [below, i, above].map(|n| nodes[n].at).to_vec();
            strand.radii.push(node.radius);
            strands.push(strand);
            reached += 3;
            continue;
        }
        if node.parent.is_some_and(|p| cylinders.get(&p).is_some_and(|ends| ends.contains(&i))) {
            continue;
        }
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
            reached += 1;
            at = n.next;
        }
        strands.push(strand);
    }
    (strands, reached)
}

/// Where some nodes have a radius, those without one take that of the nearest node towards the root that has.
fn inherit_radii(nodes: &mut [Node], content: &mut Content) {
    if nodes.iter().all(|n| n.radius.is_nan()) {
        return;
    }
    let mut visited = vec![false; nodes.len()];
    let mut chain = Vec::new();
    for i in 0..nodes.len() {
        // From a node without a radius towards the root, each node once.
        let mut at = Some(i);
        while let Some(n) = at.filter(|&n| nodes[n].radius.is_nan() && !visited[n]) {
            visited[n] = true;
            chain.push(n);
            at = nodes[n].parent;
        }
        let radius = at.map_or(f32::NAN, |n| nodes[n].radius);
        let missing = if radius.is_nan() { 0 } else { chain.len() as u64 };
        content.warnings.add_many("nodes without a radius are as wide as the node before them", missing);
        chain.drain(..).for_each(|n| nodes[n].radius = radius);
    }
}

/// The ends of each cell body of three points, by the root between them: two more points of its type and radius, a radius away
/// on either side, from which no cell body goes on.
fn cylinders(nodes: &[Node]) -> BTreeMap<usize, [usize; 2]> {
    let mut points: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, node) in nodes.iter().enumerate().filter(|(_, n)| n.is_soma) {
        if let Some(parent) = node.parent.filter(|&p| nodes[p].is_soma) {
            points.entry(parent).or_default().push(i);
        }
    }
    let is_cylinder = |root: usize, below: usize, above: usize| {
        let (r, near) = (f64::from(nodes[root].radius), BESIDE * f64::from(nodes[root].radius));
        let [a, b] = [below, above].map(|n| nodes[n].at - nodes[root].at);
        let alike =
            |n: usize| f64::from((nodes[n].radius - nodes[root].radius).abs()) <= near && !points.contains_key(&n);
        (a.length() - r).abs() <= near && (a + b).length() <= near && alike(below) && alike(above)
    };
    let ends = points.iter().filter_map(|(&root, children)| match children[..] {
        [a, b] if nodes[root].parent.is_none() && is_cylinder(root, a, b) => Some((root, [a, b])),
        _ => None,
    });
    ends.collect()
}

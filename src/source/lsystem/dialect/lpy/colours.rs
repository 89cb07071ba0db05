//! Colours of L-Py: those that it begins with, and those that its window wrote into the file.

use std::collections::BTreeMap;

use crate::source::lsystem::directive::linear;

/// Materials that L-Py begins with: ambient colour in bytes, and what it is multiplied by for the diffuse one.
const MATERIALS: [([f64; 3], f64); 6] = [
    ([160.0, 160.0, 160.0], 1.0),
    ([65.0, 45.0, 15.0], 3.0),
    ([30.0, 60.0, 10.0], 3.0),
    ([60.0, 0.0, 0.0], 3.0),
    ([60.0, 60.0, 15.0], 3.0),
    ([0.0, 0.0, 60.0], 3.0),
];

/// Linear colours by index. `window`: what follows the line that the window writes; lines such as
/// `Color_1 = pgl.Material("Color_1", ambient = (65,45,15), diffuse = 3)` and `context.turtle.setMaterial(1, Color_1)`.
pub fn materials(window: &str) -> BTreeMap<i64, [f32; 3]> {
    let colour = |(ambient, diffuse): ([f64; 3], f64)| linear(ambient.map(|c| c * diffuse / 255.0));
    let mut out: BTreeMap<i64, [f32; 3]> = (0..).zip(MATERIALS.map(colour)).collect();
    let mut named = BTreeMap::new();
    for line in window.lines().map(str::trim) {
        if let Some((name, call)) = line.split_once('=')
            && let Some((_, arguments)) = call.split_once("Material(")
        {
            named.insert(name.trim(), (numbers(arguments, "ambient"), numbers(arguments, "diffuse")));
        } else if let Some((_, arguments)) = line.split_once("turtle.setMaterial(")
            && let Some((index, name)) = arguments.trim_end_matches(')').split_once(',')
            && let Ok(index) = index.trim().parse()
            && let Some((ambient, diffuse)) = named.get(name.trim())
        {
            let ambient: [f64; 3] = ambient.as_slice().try_into().unwrap_or(MATERIALS[0].0);
            out.insert(index, colour((ambient, diffuse.first().copied().unwrap_or(1.0))));
        }
    }
    out
}

/// The numbers after `key =`: one, or three in parentheses.
fn numbers(arguments: &str, key: &str) -> Vec<f64> {
    let Some((_, rest)) = arguments.split_once(key) else { return Vec::new() };
    let rest = rest.trim_start_matches([' ', '=']).trim_start_matches("Color3");
    let end = if rest.starts_with('(') { rest.find(')') } else { rest.find([',', ')']) };
    let list = rest.get(..end.unwrap_or(rest.len())).unwrap_or_default();
    list.trim_matches(['(', ' ']).split(',').filter_map(|n| n.trim().parse().ok()).collect()
}

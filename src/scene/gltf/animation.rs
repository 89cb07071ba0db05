//! Evaluation of animations at one time: transforms and morph weights of nodes are interpolated between keyframes. Skins and morphed meshes
//! follow, since they are read from the nodes.
//!
//! Based on: glTF 2.0, 3.11 (animations) and appendix C (interpolation); K. Shoemake, *Animating Rotation with Quaternion
//! Curves*, SIGGRAPH 1985 (slerp).

use std::collections::BTreeSet;
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};

use super::ReadOptions;
use super::animation_json::{Animation, Sampler};
use super::document::Document;
use crate::{Error, Result, Warnings};

/// Duration and names of a file's animations.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Timeline {
    /// Time of the last keyframe of the animations that play, seconds; 0 if none plays.
    pub duration: f64,
    /// Names of the animations that play; numbers for those without a name.
    pub playing: Vec<String>,
}

/// How long the chosen animations of a file last.
///
/// # Errors
/// As [`super::read`], of what concerns animations.
pub fn timeline(path: &Path, options: &ReadOptions) -> Result<Timeline> {
    let document = Document::open(path, options)?;
    let chosen = select_animations(&document, &options.animations, &mut Warnings::default())?;
    let playing = chosen.iter().map(|&i| name(&document.animations[i], i)).collect();
    Ok(Timeline { duration: duration(&document, &chosen)?, playing })
}

/// Pose the nodes of a document as its animations have them at `options.time`; without a time they keep the file's own transforms.
pub fn pose(document: &mut Document, options: &ReadOptions, warnings: &mut Warnings) -> Result<()> {
    let Some(mut time) = options.time else { return Ok(()) };
    if !time.is_finite() {
        return Err(Error::Options(format!("a time of {time}: it must be a finite number of seconds")));
    }
    let chosen = select_animations(document, &options.animations, warnings)?;
    if options.repeat {
        let duration = duration(document, &chosen)?;
        if duration > 0.0 {
            time -= duration * (time / duration).floor();
        }
    }
    for animation in chosen {
        for channel in 0..document.animations[animation].channels.len() {
            if let Some((node, moved)) = evaluate(document, animation, channel, time, warnings)? {
                set_property(document, node, moved, warnings);
            }
        }
    }
    Ok(())
}

/// A property of a node with its animated value.
enum NodeProperty {
    Translation([f64; 3]),
    Rotation([f64; 4]),
    Scale([f64; 3]),
    Weights(Vec<f32>),
}

fn set_property(document: &mut Document, node: usize, moved: NodeProperty, warnings: &mut Warnings) {
    let Some(place) = document.places.get_mut(node) else { return };
    if let (Some(m), false) = (place.matrix, matches!(moved, NodeProperty::Weights(_))) {
        warnings.add("a node with a matrix is animated: the matrix is taken apart");
        let column = |k: usize| DVec3::new(m[4 * k], m[4 * k + 1], m[4 * k + 2]);
        let matrix3 = DMat3::from_cols(column(0), column(1), column(2));
        let whole = crate::geom::DAffine3 { matrix3, translation: column(3) };
        let (scale, rotation, translation) = whole.to_scale_rotation_translation();
        place.matrix = None;
        place.translation = Some(translation.to_array());
        place.rotation = Some(rotation.to_array());
        place.scale = Some(scale.to_array());
    }
    match moved {
        NodeProperty::Translation(v) => place.translation = Some(v),
        NodeProperty::Rotation(q) => place.rotation = Some(q),
        NodeProperty::Scale(v) => place.scale = Some(v),
        NodeProperty::Weights(w) => {
            if let Some(node) = document.root.nodes.get_mut(node) {
                node.weights = Some(w);
            }
        }
    }
}

fn name(animation: &Animation, index: usize) -> String {
    animation.name.clone().filter(|n| !n.is_empty()).unwrap_or_else(|| index.to_string())
}

/// Indices of the animations that play: those asked for by name or number; by default the first, and each further one that moves no property
/// that an earlier one moves.
fn select_animations(document: &Document, asked: &[String], warnings: &mut Warnings) -> Result<Vec<usize>> {
    let all = &document.animations;
    if asked.is_empty() {
        let mut moved = BTreeSet::new();
        let mut out = Vec::new();
        for (i, animation) in all.iter().enumerate() {
            let own: BTreeSet<_> =
                animation.channels.iter().filter_map(|c| Some((c.target.node?, c.target.path.as_str()))).collect();
            if moved.is_disjoint(&own) {
                moved.extend(own);
                out.push(i);
            } else {
                warnings.add(format!(
                    "animation {:?} moves what one before it moves, and does not play (option `animation` plays it alone)",
                    name(animation, i)
                ));
            }
        }
        return Ok(out);
    }
    let find = |wanted: &String| {
        let by_name = all.iter().position(|a| a.name.as_ref() == Some(wanted));
        by_name.or_else(|| wanted.parse().ok().filter(|&i: &usize| i < all.len())).ok_or_else(|| {
            let known: Vec<String> = all.iter().enumerate().map(|(i, a)| name(a, i)).collect();
            let known = if known.is_empty() { "none".into() } else { known.join(", ") };
            Error::Options(format!("no animation is named {wanted}; the file has: {known}"))
        })
    };
    asked.iter().map(find).collect()
}

/// Time of the last keyframe of the chosen animations, seconds.
fn duration(document: &Document, chosen: &[usize]) -> Result<f64> {
    let mut last = 0.0_f64;
    for &i in chosen {
        for (k, sampler) in document.animations[i].samplers.iter().enumerate() {
            let keys = times(document, sampler, &format!("animations[{i}].samplers[{k}]"))?;
            last = last.max(keys.last().copied().unwrap_or(0.0));
        }
    }
    Ok(last)
}

/// The times of a sampler's keys, checked.
fn times(document: &Document, sampler: &Sampler, at: &str) -> Result<Vec<f64>> {
    let at = format!("{at}.input");
    let times: Vec<f64> =
        document.read_floats::<1>(sampler.input, 1, [0.0], &at)?.into_iter().map(|[t]| f64::from(t)).collect();
    if times.is_empty() {
        return Err(document.error(at, "has no keys"));
    }
    if let Some(i) = times.iter().position(|t| !t.is_finite() || *t < 0.0) {
        return Err(document.error(at, format!("key {i} is at {} s; times are finite and not negative", times[i])));
    }
    if let Some(i) = times.windows(2).position(|t| t[1] < t[0]) {
        let (a, b) = (times[i], times[i + 1]);
        return Err(document.error(at, format!("times do not ascend: key {i} is at {a} s, key {} at {b} s", i + 1)));
    }
    Ok(times)
}

/// The keyframes before and after a time, and its position between them in [0, 1]. Beyond the ends both are the last one.
fn locate_keys(times: &[f64], time: f64) -> (usize, usize, f64) {
    let after = times.partition_point(|t| *t <= time);
    match after {
        0 => (0, 0, 0.0),
        n if n == times.len() => (n - 1, n - 1, 0.0),
        n => (n - 1, n, (time - times[n - 1]) / (times[n] - times[n - 1])),
    }
}

/// The node and the property that a channel moves, with its value at a time; `None` if the channel moves nothing that is read.
fn evaluate(
    document: &Document,
    animation: usize,
    channel: usize,
    time: f64,
    warnings: &mut Warnings,
) -> Result<Option<(usize, NodeProperty)>> {
    let all = &document.animations[animation];
    let (at, channel) = (format!("animations[{animation}].channels[{channel}]"), &all.channels[channel]);
    let Some(node) = channel.target.node else {
        if channel.target.path == "pointer" {
            warnings.add("what KHR_animation_pointer moves stands still");
        }
        return Ok(None);
    };
    if document.places.get(node).is_none() {
        return Err(document.error(at, format!("moves nodes[{node}], which does not exist")));
    }
    let missing = || document.error(&*at, format!("samplers[{}] does not exist", channel.sampler));
    let sampler = all.samplers.get(channel.sampler).ok_or_else(missing)?;
    let at = format!("animations[{animation}].samplers[{}]", channel.sampler);
    let track = Track::new(document, sampler, time, at)?;
    Ok(Some((
        node,
        match channel.target.path.as_str() {
            "translation" => NodeProperty::Translation(track.vector()?),
            "scale" => NodeProperty::Scale(track.vector()?),
            "rotation" => NodeProperty::Rotation(track.rotation()?),
            "weights" => NodeProperty::Weights(track.weights()?),
            other => {
                warnings.add(format!("an animation of {other:?} is no part of glTF and is ignored"));
                return Ok(None);
            }
        },
    )))
}

/// Interpolation between keyframes.
#[derive(Clone, Copy, PartialEq)]
enum Interpolation {
    Linear,
    Step,
    /// Cubic Hermite spline, with three elements per keyframe: in-tangent, value, out-tangent.
    CubicSpline,
}

/// A sampler, located at one time.
struct Track<'a> {
    document: &'a Document,
    output: usize,
    at: String,
    keys: usize,
    interpolation: Interpolation,
    /// Keyframes before and after the time, and its position between them in [0, 1].
    span: (usize, usize, f64),
    /// Seconds between them.
    seconds: f64,
}

impl<'a> Track<'a> {
    fn new(document: &'a Document, sampler: &Sampler, time: f64, at: String) -> Result<Self> {
        let interpolation = match sampler.interpolation.as_deref() {
            None | Some("LINEAR") => Interpolation::Linear,
            Some("STEP") => Interpolation::Step,
            Some("CUBICSPLINE") => Interpolation::CubicSpline,
            Some(other) => {
                return Err(document.error(at, format!("interpolation {other:?} is not LINEAR, STEP or CUBICSPLINE")));
            }
        };
        let times = times(document, sampler, &at)?;
        let span = locate_keys(&times, time);
        let seconds = times[span.1] - times[span.0];
        let at = format!("{at}.output");
        Ok(Track { document, output: sampler.output, at, keys: times.len(), interpolation, span, seconds })
    }

    /// Elements per keyframe.
    fn each(&self) -> usize {
        if self.interpolation == Interpolation::CubicSpline { 3 } else { 1 }
    }

    /// All elements of the output, each of `N` numbers, checked to be finite.
    fn read<const N: usize>(&self) -> Result<Vec<[f64; N]>> {
        let values = self.document.read_floats::<N>(self.output, N, [0.0; N], &self.at)?;
        if let Some(i) = values.iter().position(|v| v.iter().any(|x| !x.is_finite())) {
            return Err(self.document.error(&*self.at, format!("element {i} holds a NaN or an infinity")));
        }
        Ok(values.into_iter().map(|v| v.map(f64::from)).collect())
    }

    fn wrong_count(&self, have: usize, needed: String) -> Error {
        let times = if self.each() == 3 { " as cubic splines" } else { "" };
        self.document.error(&*self.at, format!("has {have} elements; {} keys{times} need {needed}", self.keys))
    }

    /// Interpolated value of one component; `value(key, part)` gives its in-tangent (part 0), value (1) and out-tangent (2) at a keyframe.
    fn blend(&self, value: impl Fn(usize, usize) -> f64) -> f64 {
        let (a, b, t) = self.span;
        match self.interpolation {
            _ if a == b => value(a, 1),
            Interpolation::Step => value(a, 1),
            Interpolation::Linear => value(a, 1) + t * (value(b, 1) - value(a, 1)),
            Interpolation::CubicSpline => {
                let (t2, t3) = (t * t, t * t * t);
                (2.0 * t3 - 3.0 * t2 + 1.0) * value(a, 1)
                    + self.seconds * (t3 - 2.0 * t2 + t) * value(a, 2)
                    + (3.0 * t2 - 2.0 * t3) * value(b, 1)
                    + self.seconds * (t3 - t2) * value(b, 0)
            }
        }
    }

    /// All elements of `N` numbers, one or three per keyframe.
    fn elements<const N: usize>(&self) -> Result<Vec<[f64; N]>> {
        let values = self.read::<N>()?;
        if values.len() != self.keys * self.each() {
            return Err(self.wrong_count(values.len(), (self.keys * self.each()).to_string()));
        }
        Ok(values)
    }

    fn blend_all<const N: usize>(&self, values: &[[f64; N]]) -> [f64; N] {
        let each = self.each();
        std::array::from_fn(|k| self.blend(|key, part| values[key * each + if each == 3 { part } else { 0 }][k]))
    }

    fn vector(&self) -> Result<[f64; 3]> {
        Ok(self.blend_all(&self.elements::<3>()?))
    }

    fn rotation(&self) -> Result<[f64; 4]> {
        let values = self.elements::<4>()?;
        let (a, b, t) = self.span;
        if self.interpolation == Interpolation::Linear && a != b {
            let unit = |v: [f64; 4]| {
                let q = DQuat::from_array(v);
                if q.length().is_normal() { q / q.length() } else { DQuat::IDENTITY }
            };
            return Ok(slerp(unit(values[a]), unit(values[b]), t).to_array());
        }
        Ok(self.blend_all(&values))
    }

    fn weights(&self) -> Result<Vec<f32>> {
        let values = self.read::<1>()?;
        let (each, width) = (self.each(), values.len() / (self.keys * self.each()));
        if values.len() != self.keys * each * width || width == 0 {
            return Err(self.wrong_count(values.len(), format!("a multiple of {}", self.keys * each)));
        }
        // For each keyframe all in-tangents, then all values, then all out-tangents.
        let value = |target: usize, key: usize, part: usize| {
            values[(key * each + if each == 3 { part } else { 0 }) * width + target][0]
        };
        Ok((0..width).map(|target| self.blend(|key, part| value(target, key, part)) as f32).collect())
    }
}

/// Spherical linear interpolation between unit quaternions along the shorter arc.
fn slerp(a: DQuat, b: DQuat, t: f64) -> DQuat {
    let dot = a.dot(b);
    let (b, dot) = if dot < 0.0 { (-b, -dot) } else { (b, dot) };
    // Nearly the same: the sine of the angle has no digits left, and the straight line is as good.
    if dot > 1.0 - 1e-9 {
        return (a * (1.0 - t) + b * t).normalize();
    }
    let angle = libm::acos(dot.min(1.0));
    let (from, to) = (libm::sin((1.0 - t) * angle), libm::sin(t * angle));
    (a * from + b * to).normalize()
}

#[cfg(test)]
mod tests;

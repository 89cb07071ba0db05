//! Motion in a landscape, as a mapping writes it: the frames of animated texels, the animation of copies, and the wind.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::super::extension::NAME;
use super::super::write::{Saved, reference};
use crate::Result;

/// Motion that a mapping writes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Motion {
    /// The files of the frames of each texel, in order, with the pose of its geometry; none for a texel that is one file.
    pub frames: Vec<Vec<(PathBuf, Option<Value>)>>,
    /// The `animation` of the layers and copies of texels that have frames.
    pub animation: Option<Value>,
    /// The `wind` of what is covered.
    pub wind: Option<Value>,
}

/// The `frames` of the texel number `k`, whose file is `path`.
pub fn frames(motion: &Motion, k: usize, path: &Path, output: &Path, saved: &mut Saved) -> Result<Value> {
    let Some(list) = motion.frames.get(k).filter(|list| list.len() > 1) else {
        return Ok(json!([{"uri": reference(path, output, saved)?}]));
    };
    let mut out = Vec::with_capacity(list.len());
    for (file, pose) in list {
        let mut frame = json!({"uri": reference(file, output, saved)?});
        if let Some(pose) = pose {
            frame["pose"] = pose.clone();
        }
        out.push(frame);
    }
    Ok(out.into())
}

/// Write the wind to all materials that show one of `texels` (indices of the root's list), and the animation to layers and copies that show
/// one with frames and have no animation of their own.
pub fn write(json: &mut Value, motion: &Motion, texels: &[usize]) {
    let has_frames = |k: usize| motion.frames.get(k).is_some_and(|list| list.len() > 1);
    let moving: Vec<usize> = texels.iter().enumerate().filter(|(k, _)| has_frames(*k)).map(|(_, i)| *i).collect();
    let animation = motion.animation.as_ref();
    let animate = |object: &mut Value| {
        let Some(animation) = animation.filter(|_| shows(object, &moving)) else { return };
        if let Some(object) = object.as_object_mut().filter(|o| !o.contains_key("animation")) {
            object.insert("animation".into(), animation.clone());
        }
    };
    for material in json.get_mut("materials").and_then(Value::as_array_mut).into_iter().flatten() {
        let Some(own) = material.pointer_mut(&format!("/extensions/{NAME}")) else { continue };
        let layers = own.get_mut("layers").and_then(Value::as_array_mut).into_iter().flatten();
        let mut blows = false;
        for layer in layers {
            blows |= shows(layer, texels);
            animate(layer);
        }
        if let (Some(wind), true) = (&motion.wind, blows) {
            own["wind"] = wind.clone();
        }
        if let Some(copies) = own.get_mut("copies") {
            animate(copies);
            if let Some(wind) = motion.wind.as_ref().filter(|_| shows(copies, texels)) {
                copies["wind"] = wind.clone();
            }
        }
    }
}

/// Whether a layer, or copies, show one of `texels`.
fn shows(object: &Value, texels: &[usize]) -> bool {
    let is = |v: Option<&Value>| v.and_then(Value::as_u64).is_some_and(|i| texels.contains(&(i as usize)));
    let variants = [object.get("variants"), object.pointer("/jitter/discrete/variants")];
    let mut variants = variants.into_iter().flatten().filter_map(Value::as_array).flatten();
    is(object.get("texel")) || variants.any(|v| is(v.get("texel")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_covered_moves() {
        let mut json = json!({"materials": [
            {"extensions": {NAME: {"layers": [{"texel": 0}, {"texel": 2}, {"texel": 2, "animation": {"mode": "random"}}]}}},
            {"extensions": {NAME: {"copies": {"variants": [{"texel": 0}, {"texel": 2}]}}}}, {},
            {"extensions": {NAME: {"copies": {"texel": 1}}}}]});
        let file = |n: &str| (PathBuf::from(n), None);
        let motion = Motion {
            frames: vec![vec![], vec![file("a"), file("b")]],
            animation: Some(json!({"phase": "perCell"})),
            wind: Some(json!({"strength": 0.5})),
        };
        write(&mut json, &motion, &[0, 2]);
        let at = |i: usize, p: &str| json.pointer(&format!("/materials/{i}/extensions/{NAME}/{p}")).cloned();
        assert_eq!(at(0, "wind/strength"), Some(json!(0.5)));
        assert_eq!(at(1, "copies/wind/strength"), Some(json!(0.5)));
        assert_eq!(at(3, "copies"), Some(json!({"texel": 1})));
        assert_eq!(at(0, "layers/0/animation"), None);
        assert_eq!(at(0, "layers/1/animation/phase"), Some(json!("perCell")));
        assert_eq!(at(0, "layers/2/animation/mode"), Some(json!("random")));
        assert_eq!(at(1, "copies/animation/phase"), Some(json!("perCell")));
    }
}

//! Lines and points of meshes as strands: what follows on from one another becomes one, so that it bends without gaps.

use super::{Section, Strand};
use crate::geom::DVec3;
use crate::scene::model::{Alpha, Instance, Model};

/// Take the lines and points out of the model, as strands `width` wide (source units) in the model's space; their materials
/// are the model's.
pub fn take(model: &mut Model, width: f64, section: Section) -> Vec<Strand> {
    let mut strands = Vec::new();
    for instance in &model.instances {
        let part = &model.parts[instance.part];
        for run in runs(&part.lines) {
            strands.push(strand(model, instance, &run, width, section));
        }
        for &p in &part.points {
            strands.push(strand(model, instance, &[p], width, section));
        }
    }
    for part in &mut model.parts {
        part.lines.clear();
        part.points.clear();
    }
    strands.retain(|s| s.colours.iter().any(|c| c[3] > 0.0));
    strands
}

/// Lines that begin where the one before ends, as corners in a row.
fn runs(lines: &[[u32; 2]]) -> Vec<Vec<u32>> {
    let mut runs: Vec<Vec<u32>> = Vec::new();
    for &[a, b] in lines {
        match runs.last_mut() {
            Some(run) if run.last() == Some(&a) => run.push(b),
            _ => runs.push(vec![a, b]),
        }
    }
    runs
}

fn strand(model: &Model, instance: &Instance, corners: &[u32], width: f64, section: Section) -> Strand {
    let part = &model.parts[instance.part];
    let material = &model.materials[part.material];
    let at = |i: &u32| part.positions[*i as usize].map(f64::from);
    let colour = |i: &u32| {
        let tint = part.colors.as_ref().map_or([1.0; 4], |c| c[*i as usize]);
        let mut rgba: [f32; 4] = std::array::from_fn(|e| material.base_color[e] * tint[e]);
        rgba[3] = match material.alpha {
            Alpha::Opaque => 1.0,
            Alpha::Mask(cutoff) => f32::from(u8::from(rgba[3] >= cutoff)),
            Alpha::Blend => rgba[3],
        };
        rgba
    };
    Strand {
        points: corners.iter().map(|i| instance.transform.transform_point3(DVec3::from(at(i)))).collect(),
        radii: vec![0.5 * width as f32],
        colours: corners.iter().map(colour).collect(),
        section,
        material: part.material.min(u16::MAX.into()) as u16,
        up: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::DAffine3;
    use crate::scene::model::{Material, Part};

    #[test]
    fn a_polyline_is_one_strand_and_a_point_a_ball() {
        let part = Part {
            positions: vec![[0.0; 3], [0.0, 0.0, 3.0], [1.0, 0.0, 3.0], [5.0; 3]],
            lines: vec![[0, 1], [1, 2], [0, 3]],
            points: vec![3],
            colors: Some(vec![[1.0, 0.5, 1.0, 0.25]; 4]),
            ..Part::default()
        };
        let material = Material { base_color: [0.5, 1.0, 1.0, 1.0], alpha: Alpha::Blend, ..Material::default() };
        let transform = DAffine3::from_scale(DVec3::splat(2.0));
        let instance = Instance { part: 0, transform, node: String::new() };
        let mut model =
            Model { parts: vec![part], materials: vec![material], instances: vec![instance], ..Model::default() };
        let strands = take(&mut model, 0.1, Section::Round);
        let sizes: Vec<usize> = strands.iter().map(|s| s.points.len()).collect();
        assert_eq!(sizes, [3, 2, 1]);
        assert_eq!(strands[0].points[2], DVec3::new(2.0, 0.0, 6.0));
        assert_eq!((strands[0].radii[0], strands[0].colours[0]), (0.05, [0.5, 0.5, 1.0, 0.25]));
        assert!(model.parts[0].lines.is_empty() && model.parts[0].points.is_empty());
        model.materials[0].alpha = Alpha::Mask(0.5);
        model.parts[0].points.push(3);
        assert!(take(&mut model, 0.1, Section::Round).is_empty());
    }
}

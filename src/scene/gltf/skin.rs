//! Skinning: vertices are moved by the joints of a skin as the nodes stand.

use gltf::json::mesh::Semantic;

use super::attributes::Reader;
use super::document::{Document, index};
use super::nodes::{Graph, Placed};
use crate::geom::{DAffine3, DMat3, DVec3};
use crate::scene::model::Part;
use crate::{Result, Warnings};

/// The joints of a skin as the nodes stand.
pub struct Skeleton {
    /// Origin of the posed vertices, near the joints, so that vertices far from the world's origin keep their precision.
    pub origin: DAffine3,
    /// Mesh space → `origin`'s space, for each joint.
    joints: Vec<DAffine3>,
    /// Mesh space → `origin`'s space for vertices that no joint moves.
    rest: DAffine3,
}

impl Skeleton {
    pub fn read(document: &Document, graph: &Graph, skin: usize, placed: &Placed) -> Result<Self> {
        let at = format!("skins[{skin}]");
        let skin = document.root.skins.get(skin).ok_or_else(|| document.error(&*at, "does not exist"))?;
        let inverse_binds = match index(skin.inverse_bind_matrices) {
            Some(accessor) => {
                let m = document.read_floats::<16>(accessor, 16, [0.0; 16], &format!("{at}.inverseBindMatrices"))?;
                if m.len() < skin.joints.len() {
                    return Err(document.error(at, "has fewer inverse bind matrices than joints"));
                }
                m.iter().map(affine).collect()
            }
            None => vec![DAffine3::IDENTITY; skin.joints.len()],
        };
        let mut worlds = Vec::with_capacity(skin.joints.len());
        for joint in &skin.joints {
            worlds.push(graph.world(document, joint.value())?);
        }
        let first = worlds.first().ok_or_else(|| document.error(&*at, "has no joints"))?;
        let origin = DAffine3::from_translation(first.translation);
        let to_origin = DAffine3::from_translation(-first.translation);
        let joints = worlds.iter().zip(&inverse_binds).map(|(w, b): (&DAffine3, &DAffine3)| to_origin * *w * *b);
        Ok(Skeleton { joints: joints.collect(), rest: to_origin * placed.world, origin })
    }

    /// Move the vertices of a part, its normals and height vectors, to where the joints put them.
    pub fn pose(&self, reader: &Reader, part: &mut Part, warnings: &mut Warnings) -> Result<()> {
        let n = part.positions.len();
        let mut blends = vec![(DMat3::ZERO, DVec3::ZERO, 0.0f64); n];
        let mut beyond = 0;
        for set in 0.. {
            let (Some(joints), Some(weights)) = (
                reader.accessor(&Semantic::Joints(set)),
                reader.floats(&Semantic::Weights(set), 4, [0.0; 4], Some(n))?,
            ) else {
                break;
            };
            let at = format!("{}.JOINTS_{set}", reader.at);
            reader.same_count(joints, Some(n), &at)?;
            let joints = reader.document.read_uints::<4>(joints, &at)?;
            for ((blend, joints), weights) in blends.iter_mut().zip(joints).zip(weights) {
                for (joint, weight) in joints.into_iter().zip(weights) {
                    // Weights that are negative or no numbers count as none.
                    if !(weight > 0.0 && weight.is_finite()) {
                        continue;
                    }
                    let Some(m) = self.joints.get(joint as usize) else {
                        beyond += 1;
                        continue;
                    };
                    let w = f64::from(weight);
                    blend.0 += m.matrix3 * w;
                    blend.1 += m.translation * w;
                    blend.2 += w;
                }
            }
        }
        warnings.add_many("a vertex weight for a joint that does not exist is ignored", beyond);
        for (i, (matrix, translation, weight)) in blends.into_iter().enumerate() {
            let m = if weight > 0.0 {
                DAffine3 { matrix3: matrix * weight.recip(), translation: translation * weight.recip() }
            } else {
                self.rest
            };
            let wide = |v: [f32; 3]| DVec3::from(v.map(f64::from));
            let matrix = m.matrix3;
            part.positions[i] = m.transform_point3(wide(part.positions[i])).as_vec3().to_array();
            if let Some(normal) = part.normals.as_mut().and_then(|n| n.get_mut(i)) {
                // Cofactors, not the inverse: a joint of scale 0 still has them.
                let turned = cofactor(matrix) * wide(*normal) * matrix.determinant().signum();
                *normal = turned.normalize_or_zero().as_vec3().to_array();
            }
            if let Some(height) = part.heights.as_mut().and_then(|h| h.get_mut(i)) {
                *height = (matrix * wide(*height)).as_vec3().to_array();
            }
        }
        Ok(())
    }
}

/// The matrix of signed minors, which takes area vectors along.
fn cofactor(m: DMat3) -> DMat3 {
    DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}

fn affine(m: &[f32; 16]) -> DAffine3 {
    let column = |k: usize| DVec3::new(m[4 * k].into(), m[4 * k + 1].into(), m[4 * k + 2].into());
    DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
}

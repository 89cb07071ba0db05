//! Shadow rays that several copies share. A cone first collects the groups of voxels of all copies; then groups that lie close
//! together and are too small for a shadow ray of their own are merged, whichever copy they belong to. Where copies overlap, each
//! leaves such a small group at its end.

use super::shadow::ShadowCone;
use crate::geom::Vec3;
use crate::march::shade::GROUP_WEIGHT;

/// Radiance that one light adds to a cone if no occluder is found, and the shadow cone by which that is tested.
#[derive(Clone, Copy)]
pub struct LitGroup {
    /// Index into the world's lights.
    pub light: usize,
    /// The camera ray's parameter.
    pub t: f64,
    /// Largest distance along the ray to a group that may share its shadow ray.
    pub reach: f64,
    /// Share of the camera ray's light, see [`crate::march::shade::ShadowGroup::weight`].
    pub weight: f32,
    pub radiance: Vec3,
    pub cone: ShadowCone,
}

/// Merge groups of one light that are too small for a shadow ray of their own with their neighbours along the ray. The shadow cone
/// of the heavier one stands for both.
pub fn merge_small_groups(groups: &mut Vec<LitGroup>) {
    groups.sort_by(|a, b| a.light.cmp(&b.light).then(a.t.total_cmp(&b.t)));
    let mut kept = 0usize;
    for i in 0..groups.len() {
        let next = groups[i];
        let last = kept.checked_sub(1).map(|k| groups[k]).filter(|last| {
            let is_small = last.weight < GROUP_WEIGHT && next.weight < GROUP_WEIGHT;
            is_small && last.light == next.light && next.t - last.t <= last.reach.min(next.reach)
        });
        match last {
            Some(last) => {
                let heavier = if next.weight > last.weight { next } else { last };
                let (weight, radiance) = (last.weight + next.weight, last.radiance + next.radiance);
                groups[kept - 1] = LitGroup { weight, radiance, ..heavier };
            }
            None => {
                groups[kept] = next;
                kept += 1;
            }
        }
    }
    groups.truncate(kept);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{DVec3, Ray};

    fn group(light: usize, t: f64, weight: f32) -> LitGroup {
        let ray = Ray { origin: t * DVec3::X, dir: DVec3::Y };
        let cone = ShadowCone { ray, end: f64::INFINITY, start: None, width: 0.1, growth: 0.0 };
        LitGroup { light, t, reach: 1.0, weight, radiance: Vec3::splat(weight), cone }
    }

    #[test]
    fn small_groups_that_lie_close_are_one() {
        // Out of order, of two lights; the fifth is heavy enough for a ray of its own, and the last is far away.
        let mut groups = vec![
            group(0, 2.0, 0.05),
            group(0, 1.5, 0.1),
            group(1, 1.6, 0.1),
            group(0, 2.4, 0.18),
            group(0, 3.0, 0.3),
            group(0, 3.2, 0.1),
            group(0, 9.0, 0.1),
        ];
        let all: f32 = groups.iter().map(|g| g.radiance.x).sum();
        merge_small_groups(&mut groups);
        let found: Vec<(usize, f64)> = groups.iter().map(|g| (g.light, g.t)).collect();
        assert_eq!(found, [(0, 2.4), (0, 3.0), (0, 3.2), (0, 9.0), (1, 1.6)]);
        assert!(groups.iter().all(|g| g.cone.ray.origin.x == g.t));
        assert!((groups.iter().map(|g| g.radiance.x).sum::<f32>() - all).abs() < 1e-6);
        assert!((groups[0].weight - 0.33).abs() < 1e-6);
        merge_small_groups(&mut Vec::new());
    }
}

//! Visible area and mean colour of each material in a voxel.

use crate::geom::DVec3;
use crate::volume::material::MAX_MATERIALS;
use crate::volume::{Material, Mix};
use crate::{Error, Result};

/// Weight of one material in a voxel.
#[derive(Debug, Clone, Copy)]
struct Weight {
    id: u8,
    /// Visible area, any unit.
    area: f32,
    /// Linear albedo times `area`.
    colour: [f32; 3],
}

/// Visible area and mean colour of every material of a voxel; areas are in any unit.
#[derive(Debug, Clone, Default)]
pub struct MaterialWeights(Vec<Weight>);

impl MaterialWeights {
    /// Add the visible `area` of the material `id` with its linear `albedo`.
    pub fn add(&mut self, id: u8, area: f64, albedo: DVec3) {
        self.accumulate(Weight { id, area: area as f32, colour: (area * albedo).as_vec3().to_array() });
    }

    /// Add all of `other`, with areas multiplied by `share`.
    pub fn add_all(&mut self, other: &MaterialWeights, share: f64) {
        let share = share as f32;
        other
            .0
            .iter()
            .for_each(|w| self.accumulate(Weight { area: share * w.area, colour: w.colour.map(|c| share * c), ..*w }));
    }

    fn accumulate(&mut self, new: Weight) {
        match self.0.iter_mut().find(|w| w.id == new.id) {
            Some(own) => {
                own.area += new.area;
                own.colour.iter_mut().zip(new.colour).for_each(|(sum, c)| *sum += c);
            }
            None => self.0.push(new),
        }
    }

    /// Divide all areas by `whole`.
    pub fn divide(&mut self, whole: f64) {
        let share = (1.0 / whole) as f32;
        for w in &mut self.0 {
            w.area *= share;
            w.colour = w.colour.map(|c| share * c);
        }
    }

    /// Mix as a voxel stores it, in steps of `step`.
    pub fn mix(&self, step: u8) -> Mix {
        match self.0[..] {
            [] => Mix::default(),
            [one] => Mix::one(one.id),
            _ => Mix::new(self.0.iter().map(|w| (w.id, w.area.into())), step),
        }
    }

    /// Materials of a texel: name, mean albedo and share of each of `names`, where these weights are the root's. Numbers are rounded
    /// to four places.
    pub fn summarize(&self, names: &[String]) -> Vec<Material> {
        let round = |v: f64| (v.clamp(0.0, 1.0) * 1e4).round() / 1e4;
        let whole: f64 = self.0.iter().map(|w| f64::from(w.area)).sum();
        let of = |(id, name): (usize, &String)| {
            let own = self.0.iter().find(|w| usize::from(w.id) == id);
            let area = own.map_or(0.0, |w| f64::from(w.area));
            let albedo = own.filter(|_| area > 0.0).map_or([1.0; 3], |w| w.colour.map(|c| round(f64::from(c) / area)));
            Material { name: name.clone(), albedo, share: round(if whole > 0.0 { area / whole } else { 0.0 }) }
        };
        names.iter().enumerate().map(of).collect()
    }
}

/// Check that a texel can hold so many materials.
///
/// # Errors
/// [`Error::Limit`] of too many.
pub fn check_count(names: &[String]) -> Result<()> {
    if names.len() <= MAX_MATERIALS {
        return Ok(());
    }
    Err(Error::Limit {
        what: "the number of materials of different names (select fewer of them, or bake without materials)".into(),
        needed: names.len() as u64,
        allowed: MAX_MATERIALS as u64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::material::FINE_STEP;

    #[test]
    fn summaries_hold_shares_and_mean_colours() {
        let mut low = MaterialWeights::default();
        low.add(1, 3.0, DVec3::new(0.5, 0.0, 1.0));
        low.add(0, 1.0, DVec3::ONE);
        low.add(1, 1.0, DVec3::new(0.1, 0.4, 1.0));
        low.divide(5.0);
        let mut all = MaterialWeights::default();
        all.add_all(&low, 2.0);
        assert_eq!(all.mix(FINE_STEP), Mix::new([(0, 1.0), (1, 4.0)], FINE_STEP));
        let summary = all.summarize(&["bark".into(), "leaf".into(), "moss".into()]);
        assert_eq!(summary[1], Material { name: "leaf".into(), albedo: [0.4, 0.1, 1.0], share: 0.8 });
        assert_eq!((summary[0].share, summary[2].share), (0.2, 0.0));
    }
}

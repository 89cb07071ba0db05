//! Materials by name, and how much of each is seen of a voxel.

use crate::geom::DVec3;
use crate::volume::material::MOST_MATERIALS;
use crate::volume::{Material, Mix};
use crate::{Error, Result};

/// One material of a voxel.
#[derive(Debug, Clone, Copy)]
struct Weight {
    id: u8,
    seen: f32,
    /// Linear albedo times `seen`.
    colour: [f32; 3],
}

/// Of every material how much of it is seen, and in which colour; any unit.
#[derive(Debug, Clone, Default)]
pub struct Weights(Vec<Weight>);

impl Weights {
    pub fn add(&mut self, id: u8, seen: f64, albedo: DVec3) {
        self.put(Weight { id, seen: seen as f32, colour: (seen * albedo).as_vec3().to_array() });
    }

    /// Add `share` of all that is in `other`.
    pub fn add_all(&mut self, other: &Weights, share: f64) {
        let share = share as f32;
        other
            .0
            .iter()
            .for_each(|w| self.put(Weight { seen: share * w.seen, colour: w.colour.map(|c| share * c), ..*w }));
    }

    fn put(&mut self, new: Weight) {
        match self.0.iter_mut().find(|w| w.id == new.id) {
            Some(own) => {
                own.seen += new.seen;
                own.colour.iter_mut().zip(new.colour).for_each(|(sum, c)| *sum += c);
            }
            None => self.0.push(new),
        }
    }

    /// Divide all by `whole`.
    pub fn divide(&mut self, whole: f64) {
        let share = (1.0 / whole) as f32;
        for w in &mut self.0 {
            w.seen *= share;
            w.colour = w.colour.map(|c| share * c);
        }
    }

    /// As a voxel holds them, in steps of `step`.
    pub fn mix(&self, step: u8) -> Mix {
        match self.0[..] {
            [] => Mix::default(),
            [one] => Mix::one(one.id),
            _ => Mix::new(self.0.iter().map(|w| (w.id, w.seen.into())), step),
        }
    }

    /// What the texel says of `names`, of which the root has these weights; numbers to four places.
    pub fn told(&self, names: &[String]) -> Vec<Material> {
        let round = |v: f64| (v.clamp(0.0, 1.0) * 1e4).round() / 1e4;
        let whole: f64 = self.0.iter().map(|w| f64::from(w.seen)).sum();
        let of = |(id, name): (usize, &String)| {
            let own = self.0.iter().find(|w| usize::from(w.id) == id);
            let seen = own.map_or(0.0, |w| f64::from(w.seen));
            let albedo = own.filter(|_| seen > 0.0).map_or([1.0; 3], |w| w.colour.map(|c| round(f64::from(c) / seen)));
            Material { name: name.clone(), albedo, share: round(if whole > 0.0 { seen / whole } else { 0.0 }) }
        };
        names.iter().enumerate().map(of).collect()
    }
}

/// That a texel can hold so many.
pub fn check(names: &[String]) -> Result<()> {
    if names.len() <= MOST_MATERIALS {
        return Ok(());
    }
    Err(Error::Limit {
        what: "the number of materials of different names (name fewer with --material NAME, or leave them out with --materials off)".into(),
        needed: names.len() as u64,
        allowed: MOST_MATERIALS as u64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::material::FINE;

    #[test]
    fn weights_are_told_by_share_and_mean_colour() {
        let mut low = Weights::default();
        low.add(1, 3.0, DVec3::new(0.5, 0.0, 1.0));
        low.add(0, 1.0, DVec3::ONE);
        low.add(1, 1.0, DVec3::new(0.1, 0.4, 1.0));
        low.divide(5.0);
        let mut all = Weights::default();
        all.add_all(&low, 2.0);
        assert_eq!(all.mix(FINE), Mix::new([(0, 1.0), (1, 4.0)], FINE));
        let told = all.told(&["bark".into(), "leaf".into(), "moss".into()]);
        assert_eq!(told[1], Material { name: "leaf".into(), albedo: [0.4, 0.1, 1.0], share: 0.8 });
        assert_eq!((told[0].share, told[2].share), (0.2, 0.0));
    }
}

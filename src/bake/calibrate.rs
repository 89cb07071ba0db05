//! The last step of a bake: brightness factors of all depths, measured against the finest depth or, in deeper texels, against
//! depth 9.

use std::sync::Arc;

use crate::Result;
use crate::march::calibrate::measure;
use crate::volume::brightness::{self, BrightnessFactors};
use crate::volume::{Octree, Volume};

/// Store in META of the texel the factors that make its depths equally bright. Rays are marched through every depth to find them.
///
/// `finest`: the factor that the finest depth itself needs, [`BrightnessFactors::PLAIN`] for matter that was measured at that depth. A
/// texel that was made of the coarser depths of another inherits theirs.
///
/// # Errors
/// [`crate::Error::Limit`] where there are more depths than a texel may have.
pub fn calibrate(volume: Volume, finest: BrightnessFactors) -> Result<Volume> {
    let volume = Arc::new(volume);
    let mut factors = measure(Octree::new(Arc::clone(&volume))?)?;
    for factor in &mut factors {
        *factor = BrightnessFactors::new([0, 1, 2].map(|k| f64::from(factor.light[k]) * f64::from(finest.light[k])));
    }
    let mut volume = Arc::unwrap_or_clone(volume);
    brightness::store(&factors, &mut volume.info.meta);
    Ok(volume)
}

//! Checks of a whole value right after it is read, while an error still has a place in the text.

use serde::de::{Deserialize, Deserializer};

/// A value that is checked as a whole once it is read, while an error still has a place.
#[derive(Debug, Clone)]
pub struct Checked<T>(pub T);

pub trait Check {
    /// Text that says what is wrong with it, if something is.
    fn check(&self) -> Result<(), String>;
}

impl<'de, T: Deserialize<'de> + Check> Deserialize<'de> for Checked<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = T::deserialize(deserializer)?;
        value.check().map_err(serde::de::Error::custom)?;
        Ok(Checked(value))
    }
}

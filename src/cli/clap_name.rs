//! Names of the values of an argument, as they are typed.

use clap::ValueEnum;

/// The name of an argument's value, as it is typed.
pub trait Name {
    fn name(&self) -> String;
}

impl<T: ValueEnum> Name for T {
    fn name(&self) -> String {
        self.to_possible_value().map(|v| v.get_name().to_owned()).unwrap_or_default()
    }
}

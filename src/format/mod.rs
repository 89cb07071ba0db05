//! The bytes of a `.vtex` file.

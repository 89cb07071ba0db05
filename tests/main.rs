//! The integration tests, one binary so that they link once. Tests over real assets run where `VTEX_ASSETS` names their folder.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

<<<<<<< HEAD
mod compare;
=======
mod bake;
>>>>>>> 0686e57 (vtex bake; solids, textures, cut-outs, lines, cyclic axes, memory estimate; tests)
mod import;
mod layers;
mod map;

//! The integration tests, one binary so that they link once. Tests over real assets run where `VTEX_ASSETS` names their folder.
mod layers;

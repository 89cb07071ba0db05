//! The integration tests, one binary so that they link once. Tests over real assets run where `VTEX_ASSETS` names their folder.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod analytic;
mod animation;
mod assets;
mod bake;
mod bake_cli;
mod bench;
mod builds;
mod cards;
mod circles;
mod coarse;
mod compare;
mod copies;
mod corpus;
mod curves;
mod demo;
mod depfile;
#[cfg(feature = "http")]
mod download;
mod emission;
mod error;
mod expand;
mod export;
mod extremes;
mod farm;
mod files;
mod golden;
mod haze;
mod import;
mod json;
#[cfg(unix)]
mod kills;
mod layers;
mod levels;
mod lsystem;
mod map;
mod map_measure;
mod map_place;
mod materials;
mod medium;
mod near;
mod outputs;
mod patches;
mod phong;
mod readable;
mod reference;
mod render;
mod reported;
mod rewrite;
mod schema;
mod stack;
mod tiles;
mod translucency;
mod unchanged;
mod vectors;
mod view;

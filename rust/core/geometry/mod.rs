//! Rigid motions, neighbour search, point-cloud resolution.

pub(crate) mod angle;
pub mod ball_search;
mod grid;
pub mod nearest_sets;
pub mod neighbors;
pub mod proximity;
pub mod resolution;
pub mod rigid;
pub(crate) mod symmetric;

//! Rigid motions, neighbour search, point-cloud resolution, placement of an outline on a top-view map.

pub(crate) mod angle;
pub mod ball_search;
pub mod distinct;
mod grid;
pub mod nearest_sets;
pub mod neighbors;
pub mod own_axes;
pub mod placements;
pub mod proximity;
pub mod resolution;
pub mod rigid;
pub(crate) mod singular;
pub(crate) mod symmetric;

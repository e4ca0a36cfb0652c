//! Rigid motions, neighbour search, point-cloud resolution.

pub mod rigid;

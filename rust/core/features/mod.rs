//! The front end: from a cloud to keypoints, local reference frames, descriptors and matches.
//!
//! | the paper | here |
//! |---|---|
//! | Harris 3D (H3D), ISS | [`harris3d`], [`iss`] |
//! | local reference frame | [`shot_lrf`], [`toldi_lrf`] |
//! | SHOT, LFSH, RCS | [`shot`], [`lfsh`], [`rcs`] |
//! | beyond it | [`voxels`], [`fpfh`] |
//! | feature matching | [`matching`] |

pub mod fpfh;
pub mod harris3d;
pub mod iss;
pub mod keypoints;
pub mod lfsh;
pub mod matching;
pub mod maxima;
mod mesh_edges;
pub mod mesh_normals;
pub mod normals;
mod pair_angles;
pub mod rcs;
pub mod shot;
pub mod shot_lrf;
pub mod toldi_lrf;
mod voxel_grid;
pub mod voxels;

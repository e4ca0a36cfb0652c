//! The front end: from a cloud to keypoints, local reference frames, descriptors and matches.
//!
//! | the paper | here |
//! |---|---|
//! | Harris 3D (H3D) | [`harris3d`] |
//! | local reference frame | [`shot_lrf`] |
//! | SHOT | [`shot`] |
//! | feature matching | [`matching`] |

pub mod harris3d;
pub mod keypoints;
pub mod matching;
pub mod maxima;
pub mod normals;
pub mod shot;
pub mod shot_lrf;

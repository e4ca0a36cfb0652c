//! Files of point clouds and meshes: bytes in, a cloud out; and PLY, PCD and E57 out.
//!
//! The bytes may come from any source. Declared sizes are checked against the length of the file before
//! memory is reserved for them, and invalid content is an [`Error::InvalidInput`](crate::Error::InvalidInput)
//! that names the place. Errors do not name the file, which only the caller knows.
//!
//! | format | function |
//! |---|---|
//! | PLY: ASCII, binary of either byte order | [`ply::parse`] |
//! | PCD 0.5 to 0.7: ASCII, binary, compressed | [`pcd::parse`] |
//! | Wavefront OBJ | [`obj::parse`] |
//! | Geomview OFF, with normals and colours | [`off::parse`] |
//! | STL: ASCII, binary | [`stl::parse`] |
//! | text: columns of numbers, with or without a line of names | [`text::parse`] |
//! | PTS: as text, after a count | [`pts::parse`] |
//! | LAS 1.0 to 1.5, also compressed as LAZ | [`las::parse`] |
//! | PTX: grids of scanners, with their poses | [`ptx::parse`] |
//! | VTK, the legacy format: ASCII, binary | [`vtk::parse`] |
//! | KITTI's scans: x y z reflectance in float32 | [`kitti::parse`] |
//! | glTF 2.0 and GLB: the triangles and points of a scene | [`gltf::parse`] |
//! | COLMAP: the numbers of a model's files, which can be replaced | [`colmap::File`] |
//! | E57: only the points of a scan, from a description that the caller has parsed | [`e57::unpack`] |

mod cloud_content;
pub mod colmap;
mod columns;
mod commas;
pub mod e57;
pub mod encode;
mod fans;
pub mod gltf;
pub mod kitti;
pub mod las;
mod lines;
pub mod lzf;
pub mod obj;
pub mod off;
pub mod pcd;
pub mod ply;
pub mod pts;
pub mod ptx;
mod repeats;
pub mod rows;
mod scalar;
pub mod stl;
pub mod table;
pub mod text;
pub mod vtk;

use crate::error::Result;
use crate::execution::Execution;

pub use cloud_content::CloudContent;

/// A parser of one format.
pub type Parser = fn(&[u8], &Execution) -> Result<CloudContent>;

/// All parsers, by the usual suffix of their files.
pub const PARSERS: [(&str, Parser); 16] = [
    ("bin", kitti::parse),
    ("csv", text::parse),
    ("gltf", gltf::parse),
    ("las", las::parse),
    ("obj", obj::parse),
    ("off", off::parse),
    ("pcd", pcd::parse),
    ("ply", ply::parse),
    ("pts", pts::parse),
    ("ptx", ptx::parse),
    ("stl", stl::parse),
    ("txt", text::parse),
    ("vtk", vtk::parse),
    ("xyz", text::parse),
    ("xyzn", text::parse_with_normals),
    ("xyzrgb", text::parse_with_colors),
];

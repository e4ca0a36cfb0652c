//! Thin binding of the core: extract, release the GIL, call, convert.

#![expect(clippy::needless_pass_by_value, reason = "pyo3 extracts arguments by value")]

mod background;
mod cloud;
mod cloud_formats;
mod convert;
mod error;
mod features;
mod grouping;
mod heap;
mod options;
mod placements;
mod pose_graph;
mod proximity;
mod registration;
mod run;
mod scaled;
mod scans;
mod targets;
mod verification;

use pyo3::prelude::*;

// No global lock is needed: classes are frozen, inputs are copied and then checked, thread pools are behind a
// mutex.
/// The compiled core of cgroup. Use it through the `cgroup` package.
#[pymodule(gil_used = false)]
mod _core {
    #[pymodule_export]
    use super::cloud::Cloud;
    #[pymodule_export]
    use super::cloud_formats::{
        ColmapFile, E57Writer, TextRows, columns_of, decompress_lzf, encode_cloud, gltf_files, parse_cloud,
        parse_gltf, parse_table, seal_pages, unpack_e57, wrong_page,
    };
    #[pymodule_export]
    use super::features::{
        choose_voxel, drop_isolated, fpfh, harris3d, iss, lfsh, match_descriptors, mesh_normals, normals,
        rcs, resolution, shot, shot_lrf, toldi_lrf, voxel_downsample,
    };
    #[pymodule_export]
    use super::grouping::{bound_rivals, group, group_motions, match_probabilities, rigid_fit};
    #[pymodule_export]
    use super::options::describe_methods;
    #[pymodule_export]
    use super::placements::best_placements;
    #[pymodule_export]
    use super::pose_graph::{optimize_poses, pose_covariances, squared_errors};
    #[pymodule_export]
    use super::proximity::{nearest, nearest_rows, within};
    #[pymodule_export]
    use super::registration::{
        Level, Prepared, Registered, Scan, choose_apart, covariance, register, share_probability, weigh,
    };
    #[pymodule_export]
    use super::scaled::{Scaled, find_scale};
    #[pymodule_export]
    use super::scans::{distinct_points, fill_between_rings, find_outliers, shows_layers, suit_voxel};
    #[pymodule_export]
    use super::targets::fit_targets;
    #[pymodule_export]
    use super::verification::{FineSurface, Surface, align, places, plane_distances, score_poses, verify};

    use numpy::PyArray1;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        super::heap::keep_freed_blocks();
        // The first lookup of NumPy's interface panics if Ctrl-C interrupts it, so it is done at import.
        PyArray1::<f64>::zeros(module.py(), 0, false);
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("DIFFERENT_POSES", cgroup::verification::DIFFERENT)?;
        module.add("MOST_LOST", cgroup::cloud_formats::encode::MOST_LOST)?;
        module.add("DEBUG_BUILD", cfg!(debug_assertions))
    }
}

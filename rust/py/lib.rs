//! Thin binding of the core: extract, release the GIL, call, convert.

#![expect(clippy::needless_pass_by_value, reason = "pyo3 extracts arguments by value")]

mod convert;
mod error;
mod features;
mod grouping;
mod options;
mod run;

use pyo3::prelude::*;

/// The compiled core of cgroup. Use it through the `cgroup` package.
#[pymodule(gil_used = false)]
mod _core {
    #[pymodule_export]
    use super::features::{
        drop_isolated, harris3d, iss, lfsh, match_descriptors, mesh_normals, normals, rcs, resolution, shot,
        shot_lrf, toldi_lrf,
    };
    #[pymodule_export]
    use super::grouping::{group, rigid_fit};

    use pyo3::prelude::*;

    /// Size of blocks that the C library shall keep when they are freed.
    const KEPT: usize = 4 << 20;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        // glibc gives freed blocks back to the system, and clearing their pages anew takes half of a short call,
        // until a block of their size has once been freed. This one is never touched, and takes no memory.
        drop(std::hint::black_box(Vec::<u8>::with_capacity(KEPT)));
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("DEBUG_BUILD", cfg!(debug_assertions))
    }
}

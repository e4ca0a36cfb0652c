//! What several methods select correspondences with: a threshold, the best of them, an eigenvector.

pub mod eigenvector;
mod lanczos;
pub mod otsu;
pub mod top_k;
mod tridiagonal;

//! Selection of correspondences by several methods: a threshold, the best k, an eigenvector.

pub mod eigenvector;
mod lanczos;
pub mod otsu;
pub mod top_k;
mod tridiagonal;

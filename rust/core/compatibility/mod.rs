//! compatibility.

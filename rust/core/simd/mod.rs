//! Vector code: one way to write it, compiled for each instruction set, chosen at run time.

pub mod arithmetic;
pub mod dispatch;
pub mod lanes;

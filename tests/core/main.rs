//! Tests of the core through its public interface, in one program: each further one would link the whole core
//! again.

#[path = "../common/mod.rs"]
mod common;
mod determinism;
mod front_end_memory_refused;
mod invariance;
mod matching_problems;
mod memory_refused;
#[path = "../common/refusing_allocator.rs"]
mod refusing_allocator;

#[global_allocator]
static ALLOCATOR: refusing_allocator::RefusingAllocator = refusing_allocator::RefusingAllocator;

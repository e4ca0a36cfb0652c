//! An allocator that refuses blocks on demand, to test computations under memory failures.
//!
//! A test binary declares it as its `#[global_allocator]` and calls [`refuse_each_block`]. Only blocks
//! requested by the threads of that function's pool are counted and refused, and only those of [`LEAST`]
//! bytes or more: memory that does not grow with the input is smaller.
#![allow(dead_code, reason = "each test file uses its own part")]
#![expect(unsafe_code, reason = "an allocator requires it")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io::Write;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use cgroup::{Error, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Size from which blocks are counted.
pub const LEAST: usize = 1 << 10;

/// Blocks that the queues of rayon's threads allocate at first and occasionally later; refusing one would end
/// the process.
const OF_QUEUES: [usize; 2] = [2_304, 2_072];

/// Blocks that are refused one by one; later blocks are sampled.
const EACH: usize = 100;
const DRAWN: usize = 25;

/// The system's allocator, except for refused blocks.
pub struct RefusingAllocator;

/// Blocks requested since the last start, and the range of refused ones.
static ASKED: AtomicUsize = AtomicUsize::new(0);
static FIRST: AtomicUsize = AtomicUsize::new(usize::MAX);
static END: AtomicUsize = AtomicUsize::new(usize::MAX);

/// The counts are those of one test at a time.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

thread_local! {
    static WATCHED: Cell<bool> = const { Cell::new(false) };
}

fn is_refused(bytes: usize) -> bool {
    if bytes < LEAST || OF_QUEUES.contains(&bytes) || !WATCHED.get() {
        return false;
    }
    let number = ASKED.fetch_add(1, Ordering::SeqCst);
    (FIRST.load(Ordering::SeqCst)..END.load(Ordering::SeqCst)).contains(&number)
}

// SAFETY: all blocks come from the system's allocator and go back to it; null reports a refusal.
unsafe impl GlobalAlloc for RefusingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if is_refused(layout.size()) {
            return std::ptr::null_mut();
        }
        // SAFETY: the caller's promises are those that the system's allocator requires.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if is_refused(layout.size()) {
            return std::ptr::null_mut();
        }
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        if new_size > layout.size() && is_refused(new_size) {
            return std::ptr::null_mut();
        }
        // SAFETY: as above; the block is the system's.
        unsafe { System.realloc(block, layout, new_size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(block, layout) }
    }
}

/// Refuses each block that a computation requests, alone, then it and all later ones; the outcome must be an
/// [`Error::OutOfMemory`] or the undisturbed result. Returns the number of blocks.
///
/// A block that is not reserved fallibly ends the process; the attempt is announced on standard error before.
///
/// # Panics
/// If the outcome is another one.
pub fn refuse_each_block<T: PartialEq + Send>(
    name: &str,
    threads: usize,
    work: impl Fn() -> Result<T> + Sync,
) -> Result<usize> {
    let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let pool = watched_pool(threads)?;
    announce(&format!("refusing blocks of {name} on {threads} thread(s): "));
    refusing(0..0, &pool, &work)?; // allocates caches that later runs reuse
    let undisturbed = refusing(0..0, &pool, &work)?;
    let blocks = ASKED.load(Ordering::SeqCst);
    announce(&format!("{blocks} blocks\n"));
    for first in tried(blocks) {
        for refused in [first..first + 1, first..usize::MAX] {
            let what = format!("{name}: blocks {refused:?} of {blocks} refused");
            let outcome = refusing(refused, &pool, &work);
            let expected = matches!(outcome, Err(Error::OutOfMemory { .. }))
                || matches!(&outcome, Ok(result) if *result == undisturbed);
            assert!(expected, "{what}: {:?}", outcome.map(|_| "another outcome"));
        }
    }
    Ok(blocks)
}

/// All of a few blocks; the first of many and a sample of the others.
fn tried(blocks: usize) -> impl Iterator<Item = usize> {
    let rest = blocks.saturating_sub(EACH);
    let drawn = (0..DRAWN.min(rest)).map(move |k| EACH + k * rest / DRAWN.min(rest));
    (0..blocks.min(EACH)).chain(drawn)
}

fn refusing<T: Send>(
    blocks: Range<usize>,
    pool: &ThreadPool,
    work: &(impl Fn() -> Result<T> + Sync),
) -> Result<T> {
    pool.install(|| {
        FIRST.store(blocks.start, Ordering::SeqCst);
        END.store(blocks.end, Ordering::SeqCst);
        ASKED.store(0, Ordering::SeqCst);
        let outcome = work();
        END.store(0, Ordering::SeqCst);
        outcome
    })
}

fn watched_pool(threads: usize) -> Result<ThreadPool> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).start_handler(|_| WATCHED.set(true)).build();
    pool.map_err(|error| Error::invalid("threads", threads, error.to_string()))
}

/// Written directly to standard error: output captured by the test harness is lost if the process ends.
fn announce(text: &str) {
    drop(std::io::stderr().write_all(text.as_bytes()));
}

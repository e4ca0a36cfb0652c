//! Many concurrent callers on kept thread pools, some of them interrupted: the binding without Python.

#[path = "../rust/py/background.rs"]
mod background;

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use background::{Failure, compute, give_back, take_pool};
use cgroup::{Error, Execution};
use rayon::prelude::*;

/// Concurrent callers, and calls of each.
const CALLERS: usize = 6;
const CALLS: usize = 25;

type Outcome = Result<Result<usize, Error>, Failure<&'static str>>;

fn call(
    threads: usize,
    deadline: Option<Instant>,
    work: impl FnOnce(&Execution) -> Result<usize, Error> + Send + 'static,
    look_around: impl FnMut() -> Result<(), &'static str>,
) -> Outcome {
    let Ok(pool) = take_pool(threads) else { return Err(Failure::Lost) };
    let execution = Arc::new(Execution::default());
    let outcome = compute(&pool, &execution, deadline, work, look_around);
    if !matches!(outcome, Err(Failure::Interrupted(_))) {
        give_back(pool);
    }
    outcome
}

/// The sum of the numbers below `count`, on all threads of the pool.
fn sum(execution: &Execution, count: usize) -> Result<usize, Error> {
    execution.report(0, count)?;
    let each = |i| execution.advance().map(|()| i);
    (0..count).into_par_iter().map(each).sum()
}

/// Works until it is asked to stop or interrupted.
fn work_on(execution: &Execution) -> Result<usize, Error> {
    while !execution.is_stopped() {
        execution.check()?;
        std::thread::yield_now();
    }
    Ok(0)
}

#[test]
fn callers_at_once_get_their_own_results() {
    std::thread::scope(|scope| {
        for caller in 0..CALLERS {
            scope.spawn(move || {
                for i in 0..CALLS {
                    let (threads, count) = (1 + (caller + i) % 3, 100 * caller + i + 1);
                    let outcome = call(threads, None, move |execution| sum(execution, count), || Ok(()));
                    assert!(
                        matches!(outcome, Ok(Ok(total)) if total == count * (count - 1) / 2),
                        "{outcome:?}"
                    );
                }
            });
        }
    });
}

#[test]
fn interrupted_work_ends() {
    let running = Arc::new(AtomicUsize::new(0));
    std::thread::scope(|scope| {
        for _ in 0..CALLERS {
            let running = Arc::clone(&running);
            scope.spawn(move || {
                let counted = Arc::clone(&running);
                let work = move |execution: &Execution| {
                    counted.fetch_add(1, Ordering::Relaxed);
                    let outcome = work_on(execution);
                    counted.fetch_sub(1, Ordering::Relaxed);
                    outcome
                };
                let outcome = call(2, None, work, || Err("Ctrl-C"));
                assert!(matches!(outcome, Err(Failure::Interrupted("Ctrl-C"))), "{outcome:?}");
            });
        }
    });
    while running.load(Ordering::Relaxed) > 0 {
        std::thread::yield_now();
    }
}

#[test]
fn work_ends_early_at_its_deadline() {
    let deadline = Instant::now().checked_add(Duration::from_millis(20));
    let outcome = call(1, deadline, work_on, || Ok(()));
    assert!(matches!(outcome, Ok(Ok(0))), "{outcome:?}");
}

#[test]
#[expect(clippy::panic, reason = "the test panics on purpose")]
fn a_panic_is_an_error() {
    for threads in [1, 2] {
        let outcome = call(threads, None, |_| panic!("on purpose"), || Ok(()));
        assert!(matches!(outcome, Err(Failure::Panicked)), "{outcome:?}");
        assert!(matches!(call(threads, None, |execution| sum(execution, 3), || Ok(())), Ok(Ok(3))));
    }
}
